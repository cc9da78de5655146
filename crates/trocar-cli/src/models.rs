//! Lists of friction models as arguments: `ems,lugre,gms:4-10`.

use trocar::compare::Choice;

/// Models given on the command line, without duplicates.
#[derive(Debug, Clone)]
pub(crate) struct Models(pub(crate) Vec<Choice>);

/// Parses a list; duplicates count once.
pub(crate) fn models(text: &str) -> Result<Models, String> {
    Choice::list(text).map(Models)
}
