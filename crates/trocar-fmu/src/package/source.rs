//! The sources inside an FMU: the exported model, and the functions of FMI around it.

use std::fmt::Write as _;

use super::Version;
use crate::variables::{Input, Role, Variable};

/// Files that are compiled.
pub(super) fn compiled(version: Version) -> [&'static str; 2] {
    match version {
        Version::V2 => ["fmi2.c", "seal.c"],
        Version::V3 => ["fmi3.c", "seal.c"],
    }
}

/// The functions of FMI, with the headers that are the same for every model.
pub(super) fn interface(version: Version) -> [(&'static str, &'static str); 2] {
    let functions = match version {
        Version::V2 => ("fmi2.c", include_str!("sources/fmi2.c")),
        Version::V3 => ("fmi3.c", include_str!("sources/fmi3.c")),
    };
    [functions, ("fmu.h", include_str!("sources/fmu.h"))]
}

/// `variables.h`: what the functions of FMI know of the model of `elements` elements.
pub(super) fn header(token: &str, input: Input, elements: usize, variables: &[Variable]) -> String {
    let mut text = format!(
        "/* The variables of this FMU. */\n\n#define FMU_TOKEN \"{token}\"\n#define FMU_DRIVEN_BY_VELOCITY {}\n\
         #define FMU_ELEMENTS {elements} /* of an EMS model; 0 for another */\n\n\
         static const struct {{\n    unsigned reference;\n    double value;\n}} fmu_constants[] = {{\n",
        u8::from(input == Input::Velocity),
    );
    for variable in variables {
        if let (Role::Tunable(_), Some(value)) = (variable.role, variable.start) {
            let name = &variable.name;
            let _ =
                writeln!(text, "    {{ {}u, {value:?} }}, /* {name} */", variable.role.reference());
        }
    }
    text.push_str("};\n");
    text
}
