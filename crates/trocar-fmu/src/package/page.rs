//! `documentation/index.html`: readable description of the variables.

use super::Form;
use super::description::{causality, escaped, variability};
use crate::variables::{Input, Variable};

/// The page of an FMU called `name`.
pub(super) fn page(name: &str, variables: &[Variable], input: Input, form: Form) -> String {
    let name = escaped(name);
    let step = match input {
        Input::Position => {
            "Before each step, set where the instrument is at its end. The position set before the first step is where it \
             stands."
        }
        Input::Velocity => "Before each step, set the velocity during it.",
    };
    let rows: String = variables.iter().map(|variable| row(variable, form)).collect();
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head><meta charset=\"utf-8\"><title>{name}</title></head>\n<body>\n\
         <h1>{name}</h1>\n<p>Force between a surgical instrument and the seal of its trocar, for co-simulation. {step} \
         SI units; positive is insertion. Made by trocar {}. Not a medical device.</p>\n<table>\n\
         <tr><th>variable</th><th>unit</th><th>causality</th><th>start</th><th>meaning</th></tr>\n{rows}</table>\n\
         </body>\n</html>\n",
        env!("CARGO_PKG_VERSION"),
    )
}

fn row(variable: &Variable, form: Form) -> String {
    let Variable { role, name, unit, description, start, .. } = variable;
    let causality = match variability(*role, form) {
        "tunable" => "tunable parameter",
        "constant" => "constant",
        _ => causality(*role, form),
    };
    let start = start.map(|start| format!("{start:?}")).unwrap_or_default();
    let cells = [name.as_str(), unit, causality, &start, description]
        .map(|text| format!("<td>{}</td>", escaped(text)));
    format!("<tr>{}</tr>\n", cells.concat())
}
