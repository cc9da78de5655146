//! Numbers in the documentation for recordings that are not part of this repository: published
//! values, and estimates of this program. A change of one of them fails here.

use std::path::PathBuf;

use crate::skipped::skipped;
use trocar::identify::{Estimate, Identification, IdentifyOptions, identify};
use trocar::recording::{ReadOptions, Recording, read};
use trocar::validate::validate;

#[path = "../examples/published_comparison.rs"]
#[allow(dead_code)] // its main
mod comparison;

/// The folder of the recordings next to the project; `None` and a message if there is none.
fn shared(name: &str) -> Option<PathBuf> {
    let folder =
        PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/recordings").join(name);
    if folder.is_dir() {
        return Some(folder);
    }
    assert!(std::env::var_os("TROCAR_REQUIRE_SHARED").is_none(), "no recordings of {name}");
    skipped(&format!("no recordings of {name}"));
    None
}

fn recording(folder: &std::path::Path, name: &str, mass: f64) -> Recording {
    let recording =
        read(&folder.join(name), &ReadOptions::default()).expect("a readable recording");
    recording.without_glitches().without_moving_mass(mass, 0.0).expect("enough samples")
}

fn found(recordings: &[Recording], options: IdentifyOptions) -> Identification {
    identify(recordings, &options, &|_, _| {}).expect("enough to identify from")
}

fn parameter<'a>(found: &'a Identification, name: &str) -> &'a Estimate {
    found.parameter(name).unwrap_or_else(|| panic!("{name} is a parameter"))
}

/// Mass of the EMPS axis, kg (JANOT).
const MASS: f64 = 95.11;

#[test]
fn emps_by_the_two_steps_gives_the_readmes_numbers() {
    let Some(folder) = shared("emps") else { return };
    let axis = [recording(&folder, "identification.csv", MASS)];
    let found = found(
        &axis,
        IdentifyOptions { paper: true, inertia_removed: true, ..IdentifyOptions::default() },
    );
    // Value and interval as printed in docs/explanation/validation.md.
    for (name, [value, low, high], digit) in [
        ("coulomb_force_n", [20.53, 20.06, 21.01], 0.01),
        ("viscous_damping_n_s_m", [202.4, 197.0, 207.7], 0.1),
        ("insertion_viscous_damping_n_s_m", [166.0, 162.6, 169.4], 0.1),
        ("withdrawal_viscous_damping_n_s_m", [239.0, 234.5, 243.5], 0.1),
        ("offset_n", [-3.217, -3.418, -3.017], 0.001),
    ] {
        let estimate = parameter(&found, name);
        for (got, printed) in
            [(estimate.value, value), (estimate.ci95[0], low), (estimate.ci95[1], high)]
        {
            assert!(
                (got - printed).abs() <= 0.501 * digit,
                "{name}: {got}, docs/explanation/validation.md prints {printed}"
            );
        }
    }
}

#[test]
fn emps_without_options_agrees_with_the_published_values() {
    let Some(folder) = shared("emps") else { return };
    let axis = [recording(&folder, "identification.csv", MASS)];
    let found =
        found(&axis, IdentifyOptions { inertia_removed: true, ..IdentifyOptions::default() });
    // Published: 20.39 N and 203.5 N s/m common to both directions.
    assert!(
        parameter(&found, "coulomb_force_n").covers(20.39),
        "{:?}",
        parameter(&found, "coulomb_force_n")
    );
    assert!(
        parameter(&found, "viscous_damping_n_s_m").covers(203.5),
        "{:?}",
        parameter(&found, "viscous_damping_n_s_m")
    );
}

#[test]
fn a_seal_that_is_no_ems_element_is_predicted_on_motion_it_was_not_fitted_to() {
    let Some(folder) = shared("seal_a") else { return };
    let training = ["steady.csv", "dynamic.csv"].map(|name| recording(&folder, name, 0.04));
    let found =
        found(&training, IdentifyOptions { inertia_removed: true, ..IdentifyOptions::default() });
    // As printed in docs/explanation/validation.md.
    for (name, printed) in [("validation.csv", 0.035), ("surgeon.csv", 0.064)] {
        let held_out =
            found.without_delay(vec![recording(&folder, name, 0.04)]).expect("the same delay");
        let score = validate(&found.trocar(), &held_out, found.model.offset);
        assert!(
            (score.rms_n - printed).abs() < 6e-4,
            "{name}: {} N, docs/explanation/validation.md prints {printed}",
            score.rms_n
        );
    }
}

#[test]
fn the_drawings_of_the_comparison_are_those_of_its_command() {
    let Some(seal) = shared("seal_a") else { return };
    let folder = seal.parent().expect("a folder of recordings");
    let drawn = comparison::drawings(folder).unwrap();
    assert_eq!(drawn.len(), 2);
    for (name, svg) in drawn {
        let file = format!("{}/../../docs/figures/{name}.svg", env!("CARGO_MANIFEST_DIR"));
        assert!(
            std::fs::read_to_string(file).is_ok_and(|kept| kept == svg),
            "docs/figures/{name}.svg: run cargo run --release -p trocar --example published_comparison -- FOLDER docs"
        );
    }
}
