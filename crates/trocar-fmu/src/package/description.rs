//! `modelDescription.xml`, for both versions of FMI from the same table.

use super::{Form, Version};
use crate::ffi::{ERRORS, WARNINGS};
use crate::variables::{Role, Variable};

/// Default step for importers, s: that of a typical control loop.
const STEP: f64 = 1e-3;

/// Options of the compiler in the description: no fused multiply-add. The pragmas of the code say
/// the same to every compiler; gcc and clang are also given the option.
pub(super) const COMPILER_OPTIONS: &str = "-ffp-contract=off";

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

/// Units: name, and exponents of kg, m and s.
const UNITS: [(&str, [i32; 3]); 7] = [
    ("1", [0, 0, 0]),
    ("s", [0, 0, 1]),
    ("m", [0, 1, 0]),
    ("m/s", [0, 1, -1]),
    ("N", [1, 1, -2]),
    ("N/m", [1, 0, -2]),
    ("N s/m", [1, 0, -1]),
];

/// Lines of XML with indentation.
#[derive(Default)]
struct Lines {
    text: String,
    depth: usize,
}

impl Lines {
    fn put(&mut self, line: &str) {
        self.text.extend(std::iter::repeat_n("  ", self.depth));
        self.text.push_str(line);
        self.text.push('\n');
    }

    fn within(&mut self, name: &str, attributes: &str, body: impl FnOnce(&mut Self)) {
        self.put(&format!("<{name}{attributes}>"));
        self.depth += 1;
        body(self);
        self.depth -= 1;
        self.put(&format!("</{name}>"));
    }
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
        let mut lines = Lines::default();
        lines.put("<?xml version=\"1.0\" encoding=\"UTF-8\"?>");
        let (number, token) = match version {
            Version::V2 => ("2.0", "guid"),
            Version::V3 => ("3.0", "instantiationToken"),
        };
        let head = attributes(&[
            ("fmiVersion", number),
            ("modelName", self.name),
            (token, self.token),
            (
                "description",
                "Force between a surgical instrument and the seal of its trocar. Not a medical device.",
            ),
            ("license", "MIT OR Apache-2.0"),
            ("generationTool", concat!("trocar ", env!("CARGO_PKG_VERSION"))),
            ("variableNamingConvention", "structured"),
        ]);
        lines.within("fmiModelDescription", &head, |lines| {
            self.interface(lines, version);
            lines.within("UnitDefinitions", "", units);
            if self.has_mode {
                lines.within("TypeDefinitions", "", |lines| mode_type(lines, version));
            }
            lines.within("LogCategories", "", categories);
            let experiment = [("startTime", 0.0), ("stopTime", 1.0), ("stepSize", STEP)];
            let experiment: String = experiment
                .iter()
                .map(|(name, value)| attribute(name, &format!("{value}")))
                .collect();
            lines.put(&format!("<DefaultExperiment{experiment}/>"));
            lines.within("ModelVariables", "", |lines| {
                self.variables.iter().for_each(|v| variable(lines, v, version, self.form))
            });
            lines.within("ModelStructure", "", |lines| self.structure(lines, version));
        });
        lines.text
    }

    /// FMI 2.0 lists the sources here, FMI 3.0 in a file of its own.
    fn interface(&self, lines: &mut Lines, version: Version) {
        let abilities = self.abilities(version);
        if self.form == Form::Library || version == Version::V3 {
            return lines.put(&format!("<CoSimulation{abilities}/>"));
        }
        lines.within("CoSimulation", &abilities, |lines| {
            lines.within("SourceFiles", "", |lines| {
                lines.put(&format!("<File{}/>", attribute("name", compiled(version))));
            });
        });
    }

    fn abilities(&self, version: Version) -> String {
        let common = [
            ("modelIdentifier", self.identifier),
            ("canHandleVariableCommunicationStepSize", "true"),
        ];
        let own: &[(&str, &str)] = match version {
            Version::V2 => &[
                ("canInterpolateInputs", "false"),
                ("maxOutputDerivativeOrder", "0"),
                ("canRunAsynchronuously", "false"),
                ("canNotUseMemoryManagementFunctions", "true"),
                ("canGetAndSetFMUstate", "true"),
                ("canSerializeFMUstate", "true"),
                ("providesDirectionalDerivative", "false"),
            ],
            Version::V3 => &[
                ("canGetAndSetFMUState", "true"),
                ("canSerializeFMUState", "true"),
                ("providesDirectionalDerivatives", "false"),
                ("providesAdjointDerivatives", "false"),
                ("maxOutputDerivativeOrder", "0"),
                ("providesIntermediateUpdate", "false"),
                ("mightReturnEarlyFromDoStep", "false"),
                ("canReturnEarlyAfterIntermediateUpdate", "false"),
                ("hasEventMode", "false"),
            ],
        };
        attributes(&common) + &attributes(own)
    }

    /// Outputs depend on the state only: between steps no input affects them. Initially they depend
    /// on all values that were set.
    fn structure(&self, lines: &mut Lines, version: Version) {
        // FMI 2.0 counts variables from 1 in the order of the description, FMI 3.0 names value
        // references.
        let outputs: Vec<String> = self
            .variables
            .iter()
            .zip(1..)
            .filter(|(variable, _)| causality(variable.role, self.form) == "output")
            .map(|(variable, place)| match version {
                Version::V2 => attribute("index", &place.to_string()),
                Version::V3 => attribute("valueReference", &variable.role.reference().to_string()),
            })
            .collect();
        match version {
            Version::V2 => {
                for (name, rest) in [("Outputs", " dependencies=\"\""), ("InitialUnknowns", "")] {
                    lines.within(name, "", |lines| {
                        outputs
                            .iter()
                            .for_each(|output| lines.put(&format!("<Unknown{output}{rest}/>")));
                    });
                }
            }
            Version::V3 => {
                outputs
                    .iter()
                    .for_each(|output| lines.put(&format!("<Output{output} dependencies=\"\"/>")));
                outputs.iter().for_each(|output| lines.put(&format!("<InitialUnknown{output}/>")));
            }
        }
    }
}

/// `sources/buildDescription.xml` of FMI 3.0.
pub(super) fn build_description(identifier: &str) -> String {
    let mut lines = Lines::default();
    lines.put("<?xml version=\"1.0\" encoding=\"UTF-8\"?>");
    lines.within("fmiBuildDescription", &attribute("fmiVersion", "3.0"), |lines| {
        let configuration = attribute("modelIdentifier", identifier);
        lines.within("BuildConfiguration", &configuration, |lines| {
            let set = attributes(&[("language", "C99"), ("compilerOptions", COMPILER_OPTIONS)]);
            lines.within("SourceFileSet", &set, |lines| {
                let file = attribute("name", compiled(Version::V3));
                let definition = attributes(&[
                    ("name", without_prefix(Version::V3)),
                    ("value", ""),
                    ("optional", "true"),
                    ("description", "for a shared library; not where FMUs are linked statically"),
                ]);
                lines.put(&format!("<SourceFile{file}/>"));
                lines.put(&format!("<PreprocessorDefinition{definition}/>"));
            });
        });
    });
    lines.text
}

fn units(lines: &mut Lines) {
    for (name, exponents) in UNITS {
        let parts =
            ["kg", "m", "s"].into_iter().zip(exponents).filter(|(_, exponent)| *exponent != 0);
        let base: String =
            parts.map(|(base, exponent)| attribute(base, &exponent.to_string())).collect();
        lines.within("Unit", &attribute("name", name), |lines| {
            lines.put(&format!("<BaseUnit{base}/>"))
        });
    }
}

fn mode_type(lines: &mut Lines, version: Version) {
    let name = attribute("name", "Mode");
    match version {
        Version::V2 => {
            lines.within("SimpleType", &name, |lines| lines.within("Enumeration", "", modes))
        }
        Version::V3 => lines.within("EnumerationType", &name, modes),
    }
}

fn modes(lines: &mut Lines) {
    for (name, value, is) in [
        ("Deforming", "1", "the seal deforms with the instrument"),
        ("Sliding", "2", "the instrument slides through the seal"),
    ] {
        let item = attributes(&[("name", name), ("value", value), ("description", is)]);
        lines.put(&format!("<Item{item}/>"));
    }
}

fn categories(lines: &mut Lines) {
    for (name, is) in [
        (ERRORS, "Calls that were refused"),
        (WARNINGS, "Calls that were done differently than asked"),
    ] {
        let name = name.to_string_lossy();
        lines.put(&format!("<Category{}/>", attributes(&[("name", &name), ("description", is)])));
    }
}

pub(super) fn causality(role: Role, form: Form) -> &'static str {
    match role {
        Role::Time => "independent",
        Role::Input(_) => "input",
        Role::Force | Role::Deflection | Role::Mode | Role::Position => "output",
        Role::Tunable(_) if form == Form::Source => "local",
        Role::InitialForce | Role::InitialDeflection | Role::InitialPosition | Role::Tunable(_) => {
            "parameter"
        }
    }
}

pub(super) fn variability(role: Role, form: Form) -> &'static str {
    match role {
        Role::Time | Role::Input(_) | Role::Force | Role::Deflection | Role::Position => {
            "continuous"
        }
        Role::Mode => "discrete",
        Role::InitialForce | Role::InitialDeflection | Role::InitialPosition => "fixed",
        Role::Tunable(_) if form == Form::Source => "constant",
        Role::Tunable(_) => "tunable",
    }
}

fn variable(lines: &mut Lines, variable: &Variable, version: Version, form: Form) {
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
    let mut typed = if *role == Role::Mode {
        attribute("declaredType", "Mode")
    } else {
        attribute("unit", unit)
    };
    if let Some((least, _)) = least {
        typed += &attribute("min", &number(*least));
    }
    if let Some(start) = start {
        typed += &attribute("start", &number(*start));
    }
    match (version, *role == Role::Mode) {
        (Version::V2, false) => {
            lines.within("ScalarVariable", &common, |l| l.put(&format!("<Real{typed}/>")))
        }
        (Version::V2, true) => {
            lines.within("ScalarVariable", &common, |l| l.put(&format!("<Enumeration{typed}/>")))
        }
        (Version::V3, false) => lines.put(&format!("<Float64{common}{typed}/>")),
        (Version::V3, true) => lines.put(&format!("<Enumeration{common}{typed}/>")),
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
                let is_defined = UNITS.iter().any(|(name, _)| *name == variable.unit);
                assert!(is_defined || variable.role == Role::Mode, "{variable:?}");
            }
        }
    }
}
