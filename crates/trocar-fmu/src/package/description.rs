//! `modelDescription.xml`, for both versions of FMI from the same table.

use super::{Form, Version};
use crate::variables::{Role, Variable};

/// The file that is compiled. It includes all others, so that everything but the functions of FMI
/// is internal to it.
pub(super) fn compiled(version: Version) -> &'static str {
    match version {
        Version::V2 => "fmi2.c",
        Version::V3 => "fmi3.c",
    }
}

/// Macro that leaves the prefix out, for a shared library.
pub(super) fn without_prefix(version: Version) -> &'static str {
    match version {
        Version::V2 => "FMI2_OVERRIDE_FUNCTION_PREFIX",
        Version::V3 => "FMI3_OVERRIDE_FUNCTION_PREFIX",
    }
}

/// Contents of the description.
pub(super) struct Description<'a> {
    pub(super) name: &'a str,
    pub(super) identifier: &'a str,
    pub(super) token: &'a str,
    pub(super) variables: &'a [Variable],
    pub(super) form: Form,
    /// Whether the model reports if it deforms or slides.
    pub(super) has_mode: bool,
}

/// Escapes text for XML and HTML. Characters not allowed in XML become U+FFFD, line breaks become
/// blanks.
pub(super) fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\t' | '\n' | '\r' => escaped.push(' '),
            '\0'..='\x1f' | '\u{fffe}' | '\u{ffff}' => escaped.push('\u{fffd}'),
            letter => escaped.push(letter),
        }
    }
    escaped
}

/// ` name="value"`.
fn attribute(name: &str, value: &str) -> String {
    format!(" {name}=\"{}\"", escaped(value))
}

fn attributes(pairs: &[(&str, &str)]) -> String {
    pairs.iter().map(|(name, value)| attribute(name, value)).collect()
}

/// Shortest text from which the number can be recovered exactly.
fn number(value: f64) -> String {
    format!("{value:?}")
}

impl Description<'_> {
    pub(super) fn to_xml(&self, version: Version) -> String {
        let variables: String =
            self.variables.iter().map(|variable| line(variable, version, self.form)).collect();
        let types = match version {
            _ if !self.has_mode => "",
            Version::V2 => include_str!("description/mode2.xml"),
            Version::V3 => include_str!("description/mode3.xml"),
        };
        let (name, program) = (escaped(self.name), env!("CARGO_PKG_VERSION"));
        let Self { identifier, token, .. } = self;
        match version {
            Version::V2 => format!(
                include_str!("description/fmi2.xml"),
                name = name,
                token = token,
                version = program,
                identifier = identifier,
                sources = self.sources(),
                types = types,
                variables = variables,
                outputs = self.outputs(version, "  <Unknown index", " dependencies=\"\""),
                unknowns = self.outputs(version, "  <Unknown index", ""),
            ),
            Version::V3 => format!(
                include_str!("description/fmi3.xml"),
                name = name,
                token = token,
                version = program,
                identifier = identifier,
                types = types,
                variables = variables,
                outputs = self.outputs(version, "<Output valueReference", " dependencies=\"\""),
                unknowns = self.outputs(version, "<InitialUnknown valueReference", ""),
            ),
        }
    }

    /// The end of the element on co-simulation: of FMI 2.0 it lists the sources.
    fn sources(&self) -> &'static str {
        match self.form {
            Form::Library => "/>",
            Form::Source => include_str!("description/sources2.xml").trim_end(),
        }
    }

    /// A line for each output.
    fn outputs(&self, version: Version, begin: &str, end: &str) -> String {
        let all = self.variables.iter().zip(1..);
        let outputs = all.filter(|(variable, _)| causality(variable.role, self.form) == "output");
        // FMI 2.0 counts variables from 1 in the order of the description, FMI 3.0 names value
        // references.
        let numbers = outputs.map(|(variable, place)| match version {
            Version::V2 => place,
            Version::V3 => variable.role.reference(),
        });
        numbers.map(|number| format!("    {begin}=\"{number}\"{end}/>\n")).collect()
    }
}

/// `buildDescription.xml` of FMI 3.0: how the sources are compiled. Without fused multiply-add: the pragmas of the
/// code say the same to every compiler; gcc and clang are also given the option.
pub(super) fn build_description(identifier: &str) -> String {
    format!(include_str!("description/build.xml"), identifier = identifier)
}

pub(super) fn causality(role: Role, form: Form) -> &'static str {
    match role {
        Role::Time => "independent",
        Role::Input(_) | Role::Turn => "input",
        Role::Force | Role::Torque | Role::Deflection | Role::Mode | Role::Position => "output",
        Role::Tunable(_) if form == Form::Source => "local",
        Role::InitialForce | Role::InitialDeflection | Role::InitialPosition | Role::Tunable(_) => {
            "parameter"
        }
    }
}

pub(super) fn variability(role: Role, form: Form) -> &'static str {
    match role {
        Role::Time
        | Role::Input(_)
        | Role::Turn
        | Role::Force
        | Role::Torque
        | Role::Deflection
        | Role::Position => "continuous",
        Role::Mode => "discrete",
        Role::InitialForce | Role::InitialDeflection | Role::InitialPosition => "fixed",
        Role::Tunable(_) if form == Form::Source => "constant",
        Role::Tunable(_) => "tunable",
    }
}

/// The line of a variable.
fn line(variable: &Variable, version: Version, form: Form) -> String {
    let Variable { role, name, unit, description, start, least } = variable;
    let mut common = attributes(&[
        ("name", name),
        ("valueReference", &role.reference().to_string()),
        ("description", description),
        ("causality", causality(*role, form)),
        ("variability", variability(*role, form)),
    ]);
    match causality(*role, form) {
        "output" => common += &attribute("initial", "calculated"),
        "parameter" | "local" => common += &attribute("initial", "exact"),
        _ => {}
    }
    let (mut kind, mut typed) = match version {
        Version::V2 => ("Real", attribute("unit", unit)),
        Version::V3 => ("Float64", attribute("unit", unit)),
    };
    if *role == Role::Mode {
        (kind, typed) = ("Enumeration", attribute("declaredType", "Mode"));
    }
    if let Some((least, _)) = least {
        typed += &attribute("min", &number(*least));
    }
    if let Some(start) = start {
        typed += &attribute("start", &number(*start));
    }
    match version {
        Version::V2 => {
            format!("    <ScalarVariable{common}>\n      <{kind}{typed}/>\n    </ScalarVariable>\n")
        }
        Version::V3 => format!("    <{kind}{common}{typed}/>\n"),
    }
}

#[cfg(test)]
mod tests {
    use trocar_model::{Element, ElementParams, Trocar};

    use super::*;
    use crate::variables::{Input, variables};

    #[test]
    fn names_of_people_are_escaped() {
        assert_eq!(escaped("a<b>&\"c\"\n\u{1}ä"), "a&lt;b&gt;&amp;&quot;c&quot; \u{fffd}ä");
    }

    #[test]
    fn sources_are_compiled_without_fused_operations() {
        let text = build_description("trocar_left");
        let expected = [
            "<BuildConfiguration modelIdentifier=\"trocar_left\">",
            "<SourceFileSet language=\"C99\" compilerOptions=\"-ffp-contract=off\">",
            "<SourceFile name=\"fmi3.c\"/>",
            "<PreprocessorDefinition name=\"FMI3_OVERRIDE_FUNCTION_PREFIX\" value=\"\" optional=\"true\"",
        ];
        assert!(expected.iter().all(|part| text.contains(part)), "{text}");
    }

    #[test]
    fn every_unit_is_defined() {
        let element = Element::new(ElementParams::plausible_10_5_mm().unwrap()).unwrap();
        for input in Input::ALL {
            for variable in variables(&Trocar::of_seal(element), input) {
                let unit = format!("<Unit name=\"{}\">", variable.unit);
                let of =
                    [include_str!("description/fmi2.xml"), include_str!("description/fmi3.xml")];
                let is_defined = of.iter().all(|text| text.contains(&unit));
                assert!(is_defined || variable.role == Role::Mode, "{variable:?}");
            }
        }
    }
}
