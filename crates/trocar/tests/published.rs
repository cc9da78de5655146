//! Numbers in the documentation for recordings that are not part of this repository: published
//! values, and estimates of this program. A change of one of them fails here.

use std::path::PathBuf;
use std::process::Command;

use crate::benches::benches;
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
        ("coulomb_force_n", [20.50, 20.03, 20.98], 0.01),
        ("viscous_damping_n_s_m", [202.6, 197.3, 208.0], 0.1),
        ("insertion_viscous_damping_n_s_m", [166.3, 162.9, 169.6], 0.1),
        ("withdrawal_viscous_damping_n_s_m", [239.3, 234.8, 243.7], 0.1),
        ("offset_n", [-3.215, -3.415, -3.016], 0.001),
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

/// Runs a script of `reference/` that needs Python alone.
fn python(script: &str, arguments: &[&std::path::Path]) -> Option<String> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../reference").join(script);
    let Ok(ran) = Command::new("python3").arg("-B").arg(path).args(arguments).output() else {
        skipped(&format!("reference/{script}: no python3"));
        return None;
    };
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    Some(String::from_utf8(ran.stdout).unwrap())
}

#[test]
fn emps_in_open_loop_leaves_the_error_on_the_page() {
    let Some(folder) = shared("emps") else { return };
    let recording = folder.join("identification.csv");
    let Some(printed) = python("emps_open_loop.py", &[&recording]) else { return };
    let page = include_str!("../../../docs/explanation/validation.md").replace('\n', " ");
    for (line, words) in printed.lines().zip(["published", "fitted by simulation"]) {
        let error = line.rsplit(": ").next().unwrap();
        let name = if words == "published" { "as published" } else { words };
        assert!(page.contains(&format!("{error} {name}")), "the page has not {line}");
    }
    assert_eq!(printed.lines().count(), 2, "{printed}");
}

#[test]
fn answers_to_the_recovery_of_seals_are_scored_by_the_truth() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    };
    let force = |error: f64| {
        let row = |i: i32| {
            let time = f64::from(i);
            // What is not scored is far off.
            format!("{time},{}\n", if time < 2.0 { 100.0 * error } else { 1.0 + error })
        };
        format!("time_s,force_n\n{}", (0..5).map(row).collect::<String>())
    };
    for seal in ["seal_01", "seal_02"] {
        write(&format!("truth/{seal}/parameters.json"), r#"{"coulomb_force_n": 2.0}"#);
        write(&format!("truth/{seal}/force.csv"), &force(0.0));
    }
    let answer = r#"{"parameters": {"coulomb_force_n": {"value": 2.1, "ci95": [2.05, null]}}}"#;
    write("answers/seal_01/summary.json", answer);
    write("answers/seal_01/force.csv", &force(0.25));
    let [answers, truth] = ["answers", "truth"].map(|name| folder.path().join(name));
    let Some(printed) = python("recovery_score.py", &[&answers, &truth]) else { return };
    for expected in [
        "median 5 %, largest 5 %; 0 of 1 intervals hold the truth; no answer for seal_02",
        "median 0.25 N rms, largest 0.25 N rms; no answer for seal_02",
    ] {
        assert!(printed.contains(expected), "{printed}");
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
    for (name, printed) in [("validation.csv", 0.030), ("surgeon.csv", 0.046)] {
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

/// Rows of the table in docs/explanation/comparison.md, and of results/comparison.md.
const ROWS: [[&str; 2]; 12] = [
    ["EMS, fitted by the criterion of the others", "ems-output-error"],
    ["**EMS** as identified", "ems"],
    ["Leuven, 4", "leuven 4"],
    ["Maxwell-Slip, 2 elements", "maxwell-slip 2"],
    ["Maxwell-Slip, 10", "maxwell-slip 10"],
    ["GMS, 4", "gms 4"],
    ["GMS, 10", "gms 10"],
    ["LuGre", "lugre"],
    ["Dahl", "dahl"],
    ["Bouc–Wen", "bouc-wen"],
    ["Stribeck", "stribeck"],
    ["Coulomb", "coulomb"],
];

/// Cells of the rows of all tables.
fn rows(text: &str) -> impl Iterator<Item = Vec<&str>> {
    let lines = text.lines().filter(|line| line.starts_with("| "));
    lines.map(|line| {
        let cells = line.split('|').map(|cell| cell.trim().trim_matches('*'));
        cells.filter(|cell| !cell.is_empty()).collect()
    })
}

/// Those of the first row with this name.
fn cells<'a>(text: &'a str, name: &str) -> Vec<&'a str> {
    let row = rows(text).find(|row| row[0] == name.trim_matches('*'));
    row.unwrap_or_else(|| panic!("no row {name}"))
}

/// Text of a file of the repository.
fn kept(name: &str) -> String {
    let file = format!("{}/../../{name}", env!("CARGO_MANIFEST_DIR"));
    std::fs::read_to_string(file).unwrap()
}

#[test]
fn the_table_of_a_rubber_seal_is_that_of_its_command() {
    let Some(seal) = shared("seal_a") else { return };
    let folder = seal.parent().expect("a folder of recordings");
    // Each takes seconds.
    let count = benches(1, comparison::SEALS.len() as u64) as usize;
    for own in comparison::SEALS.into_iter().rev().take(count) {
        let section = comparison::of_rubber_seal(folder, own).unwrap();
        assert!(kept("results/comparison.md").contains(&section), "{own:?}:\n{section}");
    }
}

#[test]
fn rubber_seals_are_predicted_as_much_better_as_the_page_says() {
    let results = kept("results/comparison.md");
    let seals: Vec<&str> = results.split("\n### ").skip(2).collect();
    let better = |column: usize| {
        let error = |row: Vec<&str>| row[column].parse::<f64>().unwrap();
        let of = |seal: &&str| {
            let others = rows(seal).skip(1).filter(|row| !row[0].starts_with("ems")).map(error);
            100.0 * (1.0 - error(cells(seal, "ems")) / others.fold(f64::INFINITY, f64::min))
        };
        let mut all: Vec<f64> = seals.iter().map(of).collect();
        all.sort_by(f64::total_cmp);
        all.iter().map(|percent| format!("{percent:.0}")).collect::<Vec<_>>()
    };
    let page = kept("docs/explanation/comparison.md");
    let page = page.split_whitespace().collect::<Vec<_>>().join(" ");
    for (column, where_better) in
        [(3, "better than the best other model on five of six real seals"), (7, "better on five")]
    {
        let found = better(column);
        let [worst, least, most] = [0, 1, 5].map(|k| found[k].trim_start_matches('-'));
        let said = format!("is {least} to {most} % {where_better} and {worst} % worse on one");
        assert!(found[0].starts_with('-') && page.contains(&said), "{said}: {found:?}");
    }
}

#[test]
fn the_drawings_and_the_tables_of_the_comparison_are_those_of_its_command() {
    let Some(seal) = shared("seal_a") else { return };
    let folder = seal.parent().expect("a folder of recordings");
    let (section, drawn) = comparison::drawings(folder).unwrap();
    assert_eq!(drawn.len(), 2);
    let command = "cargo run --release -p trocar --example published_comparison -- FOLDER";
    for (name, svg) in drawn {
        let name = format!("docs/figures/{name}.svg");
        assert!(kept(&name) == svg, "{name}: run {command} docs");
    }
    let results = kept("results/comparison.md");
    assert!(results.contains(&section), "results/comparison.md: run {command}\n{section}");
    let page = kept("docs/explanation/comparison.md");
    for [of_page, of_results] in ROWS {
        let (shown, made) = (cells(&page, of_page), cells(&results, of_results));
        let made = [1, 4, 5, 9].map(|column| made[column]);
        for (shown, made) in shown[1..].iter().zip(made) {
            let [shown, made]: [f64; 2] = [shown, made].map(|text| text.parse().unwrap());
            assert!((shown - made).abs() < 6e-4, "{of_page}: {shown}, the command makes {made}");
        }
    }
}
