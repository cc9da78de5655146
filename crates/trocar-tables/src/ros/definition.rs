//! Definitions of ROS messages: the text that bags contain for each type (`ros2msg`, `ros1msg`),
//! parsed into a tree.
//!
//! A few standard types ([`STANDARD`]) supply the types to which a text refers without defining
//! them, and the types of bags without any text. Constants and defaults are skipped, since only the
//! layout matters here.

use std::collections::HashMap;

use crate::content::Storage;

/// How a number of a type is serialised: its size is also its alignment.
fn storage(name: &str) -> Option<Storage> {
    Some(match name {
        "int8" => Storage::I8,
        "bool" | "uint8" | "byte" | "char" => Storage::U8,
        "int16" => Storage::I16,
        "uint16" => Storage::U16,
        "int32" => Storage::I32,
        "uint32" => Storage::U32,
        "int64" => Storage::I64,
        "uint64" => Storage::U64,
        "float32" => Storage::F32,
        "float64" => Storage::F64,
        _ => return None,
    })
}

/// Type of a field.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Kind {
    Number(Storage),
    /// Seconds and nanoseconds since the zero of its clock.
    Stamp,
    /// Seconds and nanoseconds of a duration.
    Span,
    Text,
    /// Text in UTF-16, whose layout differs between implementations: no later field can be located.
    WideText,
    Struct(Struct),
}

/// Number of elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Arity {
    One,
    Fixed(usize),
    /// As many as the preceding count states.
    Counted,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Field {
    pub(crate) name: String,
    pub(crate) kind: Kind,
    pub(crate) arity: Arity,
}

/// A message, or a part of one.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Struct {
    /// `package/Type`.
    pub(crate) name: String,
    pub(crate) fields: Vec<Field>,
}

/// Deepest nesting, and most fields of a message including nested ones: far above those of real
/// messages.
const DEEPEST: usize = 32;
const MOST_FIELDS: usize = 20_000;

/// `package/Type` of `package/msg/Type`, which ROS 2 writes in some places and not in others.
pub(crate) fn short(name: &str) -> String {
    match name.split('/').collect::<Vec<_>>()[..] {
        [package, "msg", kind] => format!("{package}/{kind}"),
        _ => name.to_owned(),
    }
}

/// The message `name` as `text` defines it; with an empty text, one of the standard messages.
///
/// # Errors
/// A message when a type is not defined, the text has a line that is not a field, or the nesting
/// does not end.
pub(crate) fn parse(name: &str, text: &str) -> Result<Struct, String> {
    let name = short(name);
    let mut sections: HashMap<String, Vec<Line>> = HashMap::new();
    for (standard, fields) in STANDARD {
        sections.insert((*standard).into(), fields.lines().filter_map(Line::read).collect());
    }
    let mut current = name.clone();
    if !text.trim().is_empty() {
        sections.insert(name.clone(), Vec::new());
    } else if !sections.contains_key(&name) {
        return Err(
            "the file carries no definition of its type, and it is none of the standard ones"
                .into(),
        );
    }
    for line in text.lines().map(str::trim) {
        if line.len() > 2 && line.bytes().all(|byte| byte == b'=') {
            continue;
        }
        if line.starts_with("IDL:") {
            return Err("its definition is written in IDL, which is not read".into());
        }
        if let Some(next) = line.strip_prefix("MSG:") {
            current = short(next.trim());
            sections.insert(current.clone(), Vec::new());
        } else if let Some(field) = Line::read(line) {
            sections.entry(current.clone()).or_default().push(field);
        }
    }
    Resolver { sections: &sections, fields: 0 }.resolve(&name, 0)
}

/// One line of a definition: a field.
struct Line {
    kind: String,
    arity: Arity,
    name: String,
}

impl Line {
    /// `float64[<=5] name default # comment`; `None` for constants, comments and blank lines.
    fn read(line: &str) -> Option<Self> {
        let mut words = line.split_whitespace();
        let (kind, name) = (words.next()?, words.next()?);
        let is_constant =
            name.contains('=') || words.next().is_some_and(|word| word.starts_with('='));
        if kind.starts_with('#') || name.starts_with('#') || is_constant {
            return None;
        }
        let (kind, arity) = match kind.split_once('[') {
            None => (kind, Arity::One),
            Some((kind, count)) => {
                let count =
                    count.trim_end_matches(']').parse().map_or(Arity::Counted, Arity::Fixed);
                (kind, count)
            }
        };
        let kind = kind.split("<=").next().unwrap_or(kind);
        Some(Self { kind: kind.to_owned(), arity, name: name.to_owned() })
    }
}

struct Resolver<'a> {
    sections: &'a HashMap<String, Vec<Line>>,
    fields: usize,
}

impl Resolver<'_> {
    fn resolve(&mut self, name: &str, depth: usize) -> Result<Struct, String> {
        let lines = self
            .sections
            .get(name)
            .ok_or_else(|| format!("the type {name} is not defined in the file"))?;
        self.fields += lines.len();
        if depth > DEEPEST || self.fields > MOST_FIELDS {
            return Err(format!("its definition nests without end, at {name}"));
        }
        let package = name.split('/').next().unwrap_or("");
        let fields = lines
            .iter()
            .map(|line: &Line| -> Result<Field, String> {
                let kind = self.kind(&line.kind, package, depth)?;
                Ok(Field { name: line.name.clone(), kind, arity: line.arity })
            })
            .collect::<Result<_, _>>()?;
        Ok(Struct { name: name.to_owned(), fields })
    }

    fn kind(&mut self, name: &str, package: &str, depth: usize) -> Result<Kind, String> {
        if let Some(storage) = storage(name) {
            return Ok(Kind::Number(storage));
        }
        let name = short(name);
        Ok(match &*name {
            "string" => Kind::Text,
            "wstring" => Kind::WideText,
            "time" | "builtin_interfaces/Time" => Kind::Stamp,
            "duration" | "builtin_interfaces/Duration" => Kind::Span,
            "Header" => Kind::Struct(self.resolve("std_msgs/Header", depth + 1)?),
            _ if name.contains('/') => Kind::Struct(self.resolve(&name, depth + 1)?),
            _ => Kind::Struct(self.resolve(&format!("{package}/{name}"), depth + 1)?),
        })
    }
}

/// Messages of ROS 2's common interfaces, for bags that carry no definitions (rosbag2 before schema
/// version 4).
const STANDARD: &[(&str, &str)] = &[
    ("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id"),
    ("std_msgs/Float64", "float64 data"),
    ("std_msgs/Float32", "float32 data"),
    ("std_msgs/MultiArrayDimension", "string label\nuint32 size\nuint32 stride"),
    ("std_msgs/MultiArrayLayout", "MultiArrayDimension[] dim\nuint32 data_offset"),
    ("std_msgs/Float64MultiArray", "MultiArrayLayout layout\nfloat64[] data"),
    ("std_msgs/Float32MultiArray", "MultiArrayLayout layout\nfloat32[] data"),
    ("sensor_msgs/JointState", JOINT_STATE),
    ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z"),
    ("geometry_msgs/Vector3Stamped", "std_msgs/Header header\nVector3 vector"),
    ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z"),
    ("geometry_msgs/PointStamped", "std_msgs/Header header\nPoint point"),
    ("geometry_msgs/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w"),
    ("geometry_msgs/Pose", "Point position\nQuaternion orientation"),
    ("geometry_msgs/PoseStamped", "std_msgs/Header header\nPose pose"),
    ("geometry_msgs/Twist", "Vector3 linear\nVector3 angular"),
    ("geometry_msgs/TwistStamped", "std_msgs/Header header\nTwist twist"),
    ("geometry_msgs/Wrench", "Vector3 force\nVector3 torque"),
    ("geometry_msgs/WrenchStamped", "std_msgs/Header header\nWrench wrench"),
    ("geometry_msgs/Transform", "Vector3 translation\nQuaternion rotation"),
    ("geometry_msgs/TransformStamped", TRANSFORM_STAMPED),
];

const JOINT_STATE: &str = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort";

const TRANSFORM_STAMPED: &str =
    "std_msgs/Header header\nstring child_frame_id\nTransform transform";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn standard_messages_need_no_text() {
        for (name, _) in STANDARD {
            assert!(parse(name, "").is_ok(), "{name}");
        }
        let wrench = parse("geometry_msgs/msg/WrenchStamped", "").unwrap();
        assert_eq!(wrench.name, "geometry_msgs/WrenchStamped");
        assert!(parse("my_msgs/msg/Seal", "").is_err());
    }

    #[test]
    fn texts_are_read_with_constants_defaults_bounds_and_comments() {
        let text = "# a comment\nuint8 OFF=0\nuint8 ON = 1\nfloat64 level 0.5  # volts\nstring<=10[<=3] tags\nint16[9] cov\n\
                    Inner inner\nother_msgs/msg/Outer[] outer\n================\nMSG: my_msgs/Inner\nfloat32 a\n\
                    ====================\nMSG: other_msgs/Outer\nmy_msgs/Inner b\nduration d\n";
        let message = parse("my_msgs/msg/Seal", text).unwrap();
        let names: Vec<&str> = message.fields.iter().map(|f| &*f.name).collect();
        assert_eq!(names, ["level", "tags", "cov", "inner", "outer"]);
        let arities: Vec<Arity> = message.fields.iter().map(|f| f.arity).collect();
        assert_eq!(
            arities,
            [Arity::One, Arity::Counted, Arity::Fixed(9), Arity::One, Arity::Counted]
        );
        let Kind::Struct(outer) = &message.fields[4].kind else { panic!("a struct") };
        assert_eq!(outer.fields[1].kind, Kind::Span);
    }

    #[test]
    fn a_text_goes_before_the_standard_message_of_the_same_name() {
        let message = parse("std_msgs/msg/Float64", "float32 other").unwrap();
        assert_eq!(message.fields.len(), 1);
        assert_eq!(message.fields[0].name, "other");
    }

    #[test]
    fn types_that_contain_themselves_or_multiply_are_refused() {
        assert!(parse("a/A", "A again").unwrap_err().contains("without end"));
        let mut text = String::from("B0 x\n");
        for level in 0..12 {
            text.push_str(&format!("===\nMSG: a/B{level}\n"));
            (0..10).for_each(|k| text.push_str(&format!("B{} f{k}\n", level + 1)));
        }
        text.push_str("===\nMSG: a/B12\nfloat64 x\n");
        assert!(parse("a/A", &text).unwrap_err().contains("without end"));
        assert!(parse("a/A", "missing_msgs/Thing x").unwrap_err().contains("missing_msgs/Thing"));
    }
}
