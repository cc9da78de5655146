//! Lists of friction models as arguments: `ems,lugre,gms:4-10`.

use trocar::compare::Choice;

/// Models named on the command line, none twice.
#[derive(Debug, Clone)]
pub(crate) struct Models(pub(crate) Vec<Choice>);

/// Reads a list; what is named twice counts once.
pub(crate) fn models(text: &str) -> Result<Models, String> {
    Choice::list(text).map(Models)
}
