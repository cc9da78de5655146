//! Topics of robot logs as tables: the numbers in their messages, and how to extract some of them.
//!
//! The columns of a topic are `log_time_s`, `publish_time_s` if the log has it, and every number of
//! its first message under its path. Elements of arrays are named by a list of names of the same
//! length that precedes them in the message (`position[insertion]`), otherwise by their index
//! (`position[2]`). A later message may have more or fewer elements: missing ones are NaN.
//!
//! Stamps are integer nanoseconds and are converted to seconds only after the log's first time has
//! been subtracted. Stamps of a separate clock, further than [`SAME_CLOCK`] from the log's time,
//! count from the first of them.

use serde_json::Value;

use super::Block;
use super::cdr::{self, Cursor, Layout, Names, Plan, Step, Visitor};
use super::definition::{self, Field, Kind, Struct};
use crate::content::{Column, HEADER_STAMP, LOG_TIME, PUBLISH_TIME, Table};

/// Largest distance of stamps of the log's clock from its first time, ns: 11 days, within which
/// seconds resolve 0.1 ns.
const SAME_CLOCK: u64 = 1_000_000_000_000_000;

/// Longest array listed element by element, and most columns of a topic.
const LONGEST_ARRAY: usize = 64;
const MOST_COLUMNS: usize = 1000;

/// Origins of the stamps, in ns.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Epochs {
    /// The log's first time.
    pub log: i64,
    /// The first stamp of a clock that is not the log's.
    pub other: i64,
}

/// A topic of a log.
#[derive(Debug, Clone)]
pub struct Topic {
    /// Its columns; its name and the type of its messages.
    pub table: Table,
    codec: Codec,
    sources: Vec<Source>,
    /// First `header.stamp`, ns.
    stamp: Option<i64>,
}

#[derive(Debug, Clone)]
enum Codec {
    Ros(Layout, Struct),
    Json,
    None,
}

/// Source of the values of a column.
#[derive(Debug, Clone)]
enum Source {
    Log,
    Publish,
    Ros(Vec<Step>),
    Json(Vec<Key>, bool),
    Unreadable,
}

#[derive(Debug, Clone)]
enum Key {
    Name(String),
    At(usize),
}

/// Description of a topic in a log.
pub struct Description<'a> {
    /// Its name.
    pub name: &'a str,
    /// Type of its messages.
    pub kind: &'a str,
    /// Encoding of messages: `cdr`, `ros1`, `json`.
    pub encoding: &'a str,
    /// Language of the definition: `ros2msg`, `ros1msg`, or empty.
    pub schema_encoding: &'a str,
    /// The definition of the type.
    pub definition: &'a str,
    /// Number of messages, if the log states it.
    pub rows: Option<u64>,
    /// Whether messages have a time at which they were published.
    pub has_publish_time: bool,
}

impl Topic {
    /// The topic according to `description` and its first message, and the reason if it cannot be
    /// read.
    pub fn new(description: &Description, first: Option<&[u8]>) -> (Self, Option<String>) {
        let mut topic = Self {
            table: Table {
                name: description.name.to_owned(),
                kind: description.kind.to_owned(),
                rows: description.rows,
                columns: Vec::new(),
            },
            codec: Codec::None,
            sources: Vec::new(),
            stamp: None,
        };
        topic.add(column(LOG_TIME, Some("s")), Source::Log);
        if description.has_publish_time {
            topic.add(column(PUBLISH_TIME, Some("s")), Source::Publish);
        }
        let problem = match codec(description) {
            Ok(codec) => {
                topic.codec = codec;
                first.and_then(|payload| topic.list(payload))
            }
            Err(problem) => Some(problem),
        };
        (topic, problem.map(|problem| format!("topic {}: {problem}", description.name)))
    }

    fn add(&mut self, column: Column, source: Source) {
        if self.sources.len() < MOST_COLUMNS {
            self.table.columns.push(column);
            self.sources.push(source);
        }
    }

    /// Adds the columns of one message.
    fn list(&mut self, payload: &[u8]) -> Option<String> {
        let problem = match self.codec.clone() {
            Codec::Ros(layout, message) => {
                let Some(mut cursor) = Cursor::new(layout, payload) else {
                    return Some("its messages are not plain CDR of version 1".into());
                };
                let mut lister = Lister {
                    message: &message,
                    names: Vec::new(),
                    labels: None,
                    found: Vec::new(),
                };
                let whole =
                    cdr::visit(&message, &mut cursor, &mut Vec::new(), &mut lister).is_some();
                for (column, source) in lister.found {
                    self.add(column, source);
                }
                (!whole).then(|| "its first message ends before its definition does".to_owned())
            }
            Codec::Json => match serde_json::from_slice(payload) {
                Ok(value) => {
                    self.list_json(&value, &mut Vec::new(), "");
                    None
                }
                Err(error) => Some(format!("its first message is not JSON: {error}")),
            },
            Codec::None => None,
        };
        self.stamp = self.first_stamp(payload);
        problem
    }

    fn first_stamp(&self, payload: &[u8]) -> Option<i64> {
        let place = self.table.columns.iter().position(|column| column.name == HEADER_STAMP)?;
        match (&self.codec, &self.sources[place]) {
            (Codec::Ros(layout, message), Source::Ros(path)) => {
                cdr::stamp(*layout, message, path, payload)
            }
            (Codec::Json, Source::Json(path, true)) => {
                json_stamp(json_at(&serde_json::from_slice(payload).ok()?, path)?)
            }
            _ => None,
        }
    }

    fn list_json(&mut self, value: &Value, path: &mut Vec<Key>, name: &str) {
        let dotted =
            |key: &str| if name.is_empty() { key.to_owned() } else { format!("{name}.{key}") };
        match value {
            Value::Number(_) | Value::Bool(_) => {
                self.add(column(name, None), Source::Json(path.clone(), false))
            }
            _ if json_stamp(value).is_some() => {
                self.add(column(&format!("{name}_s"), Some("s")), Source::Json(path.clone(), true));
            }
            Value::Object(fields) => {
                for (key, value) in fields {
                    path.push(Key::Name(key.clone()));
                    self.list_json(value, path, &dotted(key));
                    path.pop();
                }
            }
            Value::Array(elements) if elements.len() <= LONGEST_ARRAY => {
                for (k, value) in elements.iter().enumerate() {
                    path.push(Key::At(k));
                    self.list_json(value, path, &format!("{name}[{k}]"));
                    path.pop();
                }
            }
            _ => {
                let column = Column { name: name.to_owned(), unit: None, is_numeric: false };
                self.add(column, Source::Unreadable);
            }
        }
    }

    /// Whether `header.stamp` follows the log's clock.
    fn stamps_are_of_log(&self, log: i64) -> bool {
        self.stamp.is_none_or(|stamp| stamp.abs_diff(log) <= SAME_CLOCK)
    }

    /// 1 for stamps of a clock other than the log's, otherwise 0.
    pub fn clock(&self, column: usize, epochs: Epochs) -> usize {
        let is_logged = matches!(self.sources.get(column), Some(Source::Log | Source::Publish));
        usize::from(!is_logged && !self.stamps_are_of_log(epochs.log))
    }

    /// Extracts the numbers of `columns` from messages.
    pub fn extractor(&self, columns: &[usize], epochs: Epochs) -> Extractor {
        let columns: Vec<Option<usize>> = columns.iter().copied().map(Some).collect();
        self.extractor_of(&columns, epochs)
    }

    /// The same with columns that this topic lacks, which are NaN.
    pub fn extractor_of(&self, columns: &[Option<usize>], epochs: Epochs) -> Extractor {
        let stamps = if self.stamps_are_of_log(epochs.log) { epochs.log } else { epochs.other };
        let mut outputs = Vec::new();
        let mut ros = Vec::new();
        let mut json = Vec::new();
        for column in columns {
            outputs.push(
                match column.map_or(&Source::Unreadable, |column| &self.sources[column]) {
                    Source::Log => Output::Log,
                    Source::Publish => Output::Publish,
                    Source::Ros(path) => {
                        ros.push((&path[..], ros.len()));
                        Output::Field(ros.len() - 1)
                    }
                    Source::Json(path, is_stamp) => {
                        json.push((path.clone(), *is_stamp));
                        Output::Field(json.len() - 1)
                    }
                    Source::Unreadable => Output::Missing,
                },
            );
        }
        let fields = ros.len().max(json.len());
        let decoder = match &self.codec {
            Codec::Ros(layout, message) if fields > 0 => {
                Decoder::Ros(Plan::new(*layout, message, &ros, stamps))
            }
            Codec::Json if fields > 0 => Decoder::Json(json, stamps),
            _ => Decoder::None,
        };
        Extractor { outputs, decoder, row: vec![f64::NAN; fields], log: epochs.log }
    }
}

/// Origins of the stamps of `topics`: the log's first time, and the first stamp of any clock other
/// than the log's.
pub fn epochs<'a>(topics: impl Iterator<Item = &'a Topic>, log: i64) -> Epochs {
    let others =
        topics.filter(|topic| !topic.stamps_are_of_log(log)).filter_map(|topic| topic.stamp);
    Epochs { log, other: others.min().unwrap_or(log) }
}

/// Notes about the origins of the stamps.
pub fn epoch_notes<'a>(topics: impl Iterator<Item = &'a Topic>, epochs: Epochs) -> Vec<String> {
    let mut notes = vec![format!("times count from {} ns, the first time of the log", epochs.log)];
    let others: Vec<&str> = topics
        .filter(|topic| !topic.stamps_are_of_log(epochs.log))
        .map(|topic| &*topic.table.name)
        .collect();
    if !others.is_empty() {
        let (names, from) = (others.join(", "), epochs.other);
        notes.push(format!(
            "stamps of {names} are of another clock than the log's and count from {from} ns"
        ));
    }
    notes
}

fn column(name: &str, unit: Option<&str>) -> Column {
    Column { name: name.to_owned(), unit: unit.map(str::to_owned), is_numeric: true }
}

fn codec(description: &Description) -> Result<Codec, String> {
    let layout = match description.encoding {
        "cdr" => Layout::Cdr,
        "ros1" => Layout::Ros1,
        "json" => return Ok(Codec::Json),
        "" => return Err("the log does not say how its messages are written".into()),
        other => {
            return Err(format!(
                "its messages are written in {other}, which is not read; ROS (cdr, ros1) and JSON are"
            ));
        }
    };
    // The standard messages of ROS 2 differ from those of ROS 1 in their headers.
    if layout == Layout::Ros1 && description.definition.trim().is_empty() {
        return match definition::parse(description.kind, "") {
            Ok(_) => Err("the file carries no definition of its type".to_owned()),
            Err(_) => Ok(Codec::Ros(
                layout,
                Struct { name: description.kind.to_owned(), fields: Vec::new() },
            )),
        };
    }
    match description.schema_encoding {
        "ros2msg" | "ros1msg" | "" => definition::parse(description.kind, description.definition),
        other => definition::parse(description.kind, "")
            .map_err(|_| format!("its definition is written in {other}, which is not read")),
    }
    .map(|message| Codec::Ros(layout, message))
}

/// Extracts numbers from the messages of one topic.
#[derive(Clone)]
pub struct Extractor {
    outputs: Vec<Output>,
    decoder: Decoder,
    row: Vec<f64>,
    log: i64,
}

#[derive(Clone, Copy)]
enum Output {
    Log,
    Publish,
    Field(usize),
    Missing,
}

#[derive(Clone)]
enum Decoder {
    Ros(Plan),
    Json(Vec<(Vec<Key>, bool)>, i64),
    None,
}

impl Extractor {
    /// Number of its columns.
    pub fn width(&self) -> usize {
        self.outputs.len()
    }

    /// Adds one message to `block`; values missing from it are NaN.
    pub fn add(&mut self, log: u64, publish: u64, payload: &[u8], block: &mut Block) {
        self.row.fill(f64::NAN);
        let whole = match &mut self.decoder {
            Decoder::None => true,
            Decoder::Ros(plan) => plan.run(payload, &mut self.row).is_some(),
            Decoder::Json(paths, epoch) => {
                json_row(payload, paths, *epoch, &mut self.row).is_some()
            }
        };
        if !whole {
            self.row.fill(f64::NAN);
            block.undecoded += 1;
        }
        block.log.push(log);
        let [log, publish] =
            [log, publish].map(|time| cdr::seconds((time as i64).wrapping_sub(self.log)));
        for (output, column) in self.outputs.iter().zip(&mut block.columns) {
            column.push(match output {
                Output::Log => log,
                Output::Publish => publish,
                Output::Field(place) => self.row[*place],
                Output::Missing => f64::NAN,
            });
        }
    }
}

fn json_row(payload: &[u8], paths: &[(Vec<Key>, bool)], epoch: i64, row: &mut [f64]) -> Option<()> {
    let value: Value = serde_json::from_slice(payload).ok()?;
    for ((path, is_stamp), cell) in paths.iter().zip(row) {
        *cell = match json_at(&value, path) {
            Some(value) if *is_stamp => {
                json_stamp(value).map(|stamp| cdr::seconds(stamp.wrapping_sub(epoch)))
            }
            Some(Value::Bool(truth)) => Some(f64::from(u8::from(*truth))),
            Some(value) => value.as_f64(),
            None => None,
        }
        .unwrap_or(f64::NAN);
    }
    Some(())
}

fn json_at<'a>(value: &'a Value, path: &[Key]) -> Option<&'a Value> {
    path.iter().try_fold(value, |value, key| match key {
        Key::Name(name) => value.get(name),
        Key::At(place) => value.get(place),
    })
}

/// `{"sec": 1, "nsec": 2}`, as Foxglove and ROS write times in JSON, in ns.
fn json_stamp(value: &Value) -> Option<i64> {
    let fields = value.as_object().filter(|fields| fields.len() == 2)?;
    let seconds = fields.get("sec")?.as_i64()?;
    let nanoseconds = fields.get("nsec").or(fields.get("nanosec"))?.as_i64()?;
    seconds.checked_mul(1_000_000_000)?.checked_add(nanoseconds)
}

/// Columns from one message.
struct Lister<'a> {
    message: &'a Struct,
    /// Arrays of names passed so far, by the indices of their fields.
    names: Vec<(Vec<usize>, Vec<String>)>,
    /// Names for the elements of the current array.
    labels: Option<(Names, Vec<String>)>,
    found: Vec<(Column, Source)>,
}

impl Visitor for Lister<'_> {
    fn leaf(&mut self, path: &[Step], field: &Field, _parent: &Struct) {
        let mut path = path.to_vec();
        if let (Some(Step::Element(place)), Some((names, labels))) =
            (path.last().cloned(), &self.labels)
        {
            path.pop();
            path.push(Step::Named(labels[place].clone(), names.clone()));
        }
        let (mut name, mut unit) = spell(self.message, &path);
        let is_time = matches!(field.kind, Kind::Stamp | Kind::Span);
        if is_time {
            name.push_str("_s");
            unit = Some("s".into());
        }
        let is_numeric = is_time || matches!(field.kind, Kind::Number(_));
        let source = if is_numeric { Source::Ros(path) } else { Source::Unreadable };
        self.found.push((Column { name, unit, is_numeric }, source));
    }

    fn array(&mut self, path: &[Step], _field: &Field, count: usize) -> bool {
        self.labels = fields_only(path).and_then(|path| self.labels_for(&path, count));
        let fits = count <= LONGEST_ARRAY && self.found.len() + count <= MOST_COLUMNS;
        if !fits {
            let name = format!("{}[]", spell(self.message, path).0);
            self.found.push((Column { name, unit: None, is_numeric: false }, Source::Unreadable));
        }
        fits
    }

    fn names(&mut self, path: &[Step], field: &Field, names: Vec<String>) {
        let (name, _) = spell(self.message, path);
        self.found.push((
            Column { name: format!("{name}[]"), unit: None, is_numeric: false },
            Source::Unreadable,
        ));
        let mut distinct: Vec<&String> = names.iter().filter(|name| !name.is_empty()).collect();
        distinct.sort_unstable();
        distinct.dedup();
        if distinct.len() == names.len() && field.name.contains("name") {
            self.names.extend(fields_only(path).map(|path| (path, names)));
        }
    }
}

impl Lister<'_> {
    /// The nearest array of `count` names at the level of the array at `path` or further out.
    fn labels_for(&self, path: &[usize], count: usize) -> Option<(Names, Vec<String>)> {
        let names = self.names.iter().filter(|(_, names)| names.len() == count);
        let fitting = names.filter(|(of, _)| path.starts_with(&of[..of.len() - 1]));
        fitting.max_by_key(|(of, _)| of.len()).map(|(of, names)| (Names(of.clone()), names.clone()))
    }
}

fn fields_only(path: &[Step]) -> Option<Vec<usize>> {
    path.iter()
        .map(|step| match step {
            Step::Field(place) => Some(*place),
            _ => None,
        })
        .collect()
}

/// The path as text, and the unit defined by its types.
fn spell(message: &Struct, path: &[Step]) -> (String, Option<String>) {
    let mut at = Some(message);
    let mut name = String::new();
    let mut unit = None;
    for step in path {
        match step {
            Step::Element(place) => name.push_str(&format!("[{place}]")),
            Step::Named(label, _) => name.push_str(&format!("[{label}]")),
            Step::Field(place) => {
                let Some((parent, field)) =
                    at.and_then(|parent| Some((parent, parent.fields.get(*place)?)))
                else {
                    break;
                };
                if !name.is_empty() {
                    name.push('.');
                }
                name.push_str(&field.name);
                unit = UNITS
                    .iter()
                    .find(|(kind, of, _)| *kind == parent.name && [&*field.name, ""].contains(of))
                    .map(|(_, _, unit)| (*unit).to_owned())
                    .or(unit);
                at = match &field.kind {
                    Kind::Struct(inner) => Some(inner),
                    _ => None,
                };
            }
        }
    }
    (name, unit)
}

/// Units that the definitions of types give their fields (key REP103 in SOURCES.md); an empty field
/// stands for all fields of the type. A joint's position is m or rad, which its message does not
/// state.
const UNITS: &[(&str, &str, &str)] = &[
    ("geometry_msgs/Point", "", "m"),
    ("geometry_msgs/Wrench", "force", "N"),
    ("geometry_msgs/Wrench", "torque", "N m"),
    ("geometry_msgs/Transform", "translation", "m"),
    ("geometry_msgs/Twist", "linear", "m/s"),
    ("geometry_msgs/Twist", "angular", "rad/s"),
    ("geometry_msgs/Accel", "linear", "m/s^2"),
    ("geometry_msgs/Accel", "angular", "rad/s^2"),
    ("sensor_msgs/Imu", "linear_acceleration", "m/s^2"),
    ("sensor_msgs/Imu", "angular_velocity", "rad/s"),
    ("sensor_msgs/Range", "range", "m"),
    ("sensor_msgs/FluidPressure", "fluid_pressure", "Pa"),
];
