//! Figures and tables of a comparison of friction models.

mod errors;
mod runs;
mod tables;

use super::Drawn;
use crate::compare::{Choice, Comparison, Entry};
use crate::identify::classical::Kind;
use crate::report::document::{Family, Role};

pub(in super::super) use errors::error_by_parameters;
pub(in super::super) use runs::{one_cycle, one_reversal, shown};
pub(in super::super) use tables::{
    best_of_each, by_recording, criteria, errors_by_phase, parameters_by_family, warnings_by_model,
};

/// Sizes of banks drawn in addition to the best one: EMS section II-C discusses four and ten
/// elements.
const SPOKEN_OF: [usize; 2] = [4, 10];

/// Relative difference below which two errors count as equal.
const NO_ODDS: f64 = 0.01;

/// Displayed name of a family; an unknown name is returned unchanged.
pub(in super::super) fn family_name(name: &str) -> &str {
    match name {
        "ems" => "EMS",
        "ems-output-error" => "EMS, output error",
        "coulomb" => "Coulomb",
        "coulomb-viscous" => "Coulomb and viscous",
        "stribeck" => "Stribeck",
        "dahl" => "Dahl",
        "lugre" => "LuGre",
        "lugre-rational" => "LuGre, rational",
        "leuven" => "Leuven",
        "maxwell-slip" => "Maxwell-Slip",
        "gms" => "GMS",
        other => other,
    }
}

/// Displayed name of a model, with its number of elements if the family has several.
pub(in super::super) fn model_name(entry: &Entry) -> String {
    let name = family_name(entry.name);
    if entry.choice.is_bank() { format!("{name} {}", entry.elements) } else { name.to_owned() }
}

fn family(entry: &Entry) -> Family {
    let Choice::Classical(kind) = entry.choice else { return Family::Ems };
    match kind {
        Kind::Coulomb | Kind::CoulombViscous | Kind::Stribeck => Family::Static,
        Kind::Dahl => Family::Dahl,
        Kind::LuGre | Kind::LuGreRational => Family::LuGre,
        Kind::Leuven(_) => Family::Leuven,
        Kind::MaxwellSlip(_) => Family::MaxwellSlip,
        Kind::Gms(_) => Family::Gms,
    }
}

/// Colour by family, dashes by variant.
fn role(entry: &Entry, place: usize) -> Role {
    Role::Friction(family(entry), variant(entry, place))
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

/// The entries by name, each name at the position of its best model.
fn by_name(comparison: &Comparison) -> Vec<Vec<&Entry>> {
    let mut names: Vec<Vec<&Entry>> = Vec::new();
    for entry in &comparison.entries {
        match names.iter_mut().find(|own| own[0].name == entry.name) {
            Some(own) => own.push(entry),
            None => names.push(vec![entry]),
        }
    }
    names
}

/// The best model of one family: the fewest elements whose validation error equals the least one
/// within the tolerance.
fn best<'a>(own: &[&'a Entry]) -> &'a Entry {
    let least = own[0].scores.validate_rms_n;
    let as_good = own.iter().filter(|entry| entry.scores.validate_rms_n <= (1.0 + NO_ODDS) * least);
    as_good.min_by_key(|entry| entry.elements).unwrap_or(&own[0])
}

/// The best of a bank's sizes, and those that EMS discusses.
fn of_interest<'a>(own: &[&'a Entry]) -> Vec<&'a Entry> {
    let best = best(own);
    let mut others: Vec<&Entry> = own.iter().copied().filter(|entry| SPOKEN_OF.contains(&entry.elements)).collect();
    others.retain(|entry| entry.elements != best.elements);
    others.sort_by_key(|entry| entry.elements);
    std::iter::once(best).chain(others).collect()
}
