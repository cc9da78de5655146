//! Figures and tables of a comparison of friction models.

mod errors;
mod runs;
mod tables;

use super::Drawn;
use crate::document::Role;
use trocar_lab::compare::{Entry, best_of};

pub(crate) use errors::error_by_parameters;
pub(crate) use runs::{one_cycle, one_reversal, shown};
pub(crate) use tables::{
    best_of_each, by_recording, criteria, errors_by_phase, parameters_by_family, warnings_by_model,
};

/// Sizes of banks drawn in addition to the best one: EMS section II-C discusses four and ten
/// elements.
const SPOKEN_OF: [usize; 2] = [4, 10];

/// Colour by kind, dashes by variant.
fn role(entry: &Entry, place: usize) -> Role {
    Role::Friction(kind(entry), variant(entry, place))
}

fn kind(entry: &Entry) -> &'static str {
    entry.trocar.seal().kind()
}

/// Distinguishes the models of a family: `place` in a list of banks.
fn variant(entry: &Entry, place: usize) -> u8 {
    match entry.name {
        "ems" | "stribeck" | "lugre" => 0,
        "ems-output-error" | "coulomb-viscous" | "lugre-rational" => 1,
        "coulomb" => 2,
        _ => place as u8,
    }
}

/// The best of a bank's sizes, and those that EMS discusses.
fn of_interest<'a>(own: &[&'a Entry]) -> Vec<&'a Entry> {
    let best = best_of(own);
    let mut others: Vec<&Entry> =
        own.iter().copied().filter(|entry| SPOKEN_OF.contains(&entry.elements)).collect();
    others.retain(|entry| entry.elements != best.elements);
    others.sort_by_key(|entry| entry.elements);
    std::iter::once(best).chain(others).collect()
}
