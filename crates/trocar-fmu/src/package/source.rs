//! The sources inside an FMU: the exported model, and the functions of FMI around it.

use std::fmt::Write as _;

use super::Version;
use super::description::{Description, compiled, without_prefix};
use crate::variables::{Input, Role};

/// What the code must know of the model beside its variables.
#[derive(Clone, Copy)]
pub(super) struct Model {
    pub(super) input: Input,
    /// Elements of an EMS model; 0 for another.
    pub(super) elements: usize,
}

/// The functions of FMI, with the headers that are the same for every model.
pub(super) fn interface(version: Version) -> [(&'static str, &'static str); 2] {
    let functions = match version {
        Version::V2 => include_str!("sources/fmi2.c"),
        Version::V3 => include_str!("sources/fmi3.c"),
    };
    [(compiled(version), functions), ("fmu.h", include_str!("sources/fmu.h"))]
}

/// Beginning of the names of FMI's functions in C where FMUs are linked statically.
fn prefix(version: Version) -> &'static str {
    match version {
        Version::V2 => "FMI2_FUNCTION_PREFIX",
        Version::V3 => "FMI3_FUNCTION_PREFIX",
    }
}

/// The model identifier of an FMU with source code, which C names begin with: `name` with `_` for
/// each character that they cannot contain.
pub(super) fn identifier(name: &str) -> String {
    let plain = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' });
    "trocar_".chars().chain(plain).collect()
}

/// `variables.h`: what the functions of FMI know of the model.
pub(super) fn header(description: &Description, version: Version, model: Model) -> String {
    let Description { identifier, token, variables, .. } = description;
    let Model { input, elements } = model;
    let (prefix, without) = (prefix(version), without_prefix(version));
    let mut text = format!(
        "/* The variables of this FMU, and the prefix of its functions, different for each FMU in a program. For a shared\n \
         * library {without} is defined. */\n\n\
         #ifndef {prefix}\n#define {prefix} {identifier}_\n#endif\n\
         #define FMU_TOKEN \"{token}\"\n#define FMU_DRIVEN_BY_VELOCITY {}\n\
         #define FMU_ELEMENTS {elements} /* of an EMS model; 0 for another */\n\
         #define FMU_TURNS {}\n\n\
         static const struct {{\n    unsigned reference;\n    double value;\n}} fmu_constants[] = {{\n",
        u8::from(input == Input::Velocity),
        u8::from(variables.iter().any(|variable| variable.role == Role::Turn)),
    );
    for variable in *variables {
        if let (Role::Tunable(_), Some(value)) = (variable.role, variable.start) {
            let name = &variable.name;
            let _ =
                writeln!(text, "    {{ {}u, {value:?} }}, /* {name} */", variable.role.reference());
        }
    }
    text.push_str("};\n");
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identifiers_are_names_in_c() {
        assert_eq!(identifier("left_2"), "trocar_left_2");
        assert_eq!(identifier("5 mm, \"ä\""), "trocar_5_mm_____");
        assert_eq!(identifier(""), "trocar_");
    }
}
