//! `trocar compensate` as a process: columns, live pipes, faults and exit codes.

use std::fs;
use std::io::{BufRead as _, BufReader, Write as _};
use std::process::Stdio;
use std::time::{Duration, Instant};

use trocar::model_file::{ModelFile, SensorInfo};
use trocar_model::Rotation;

use crate::common::{Place, names_in};

/// A folder with a made-up model and a hand-like recording into tissue.
fn place() -> Place {
    let place = Place::new();
    let rig = "[protocol.surgeon]\nduration_s = 20.0\n[tissue]\nkind = \"kelvin_voigt\"\nsurface_m = 0.06\n";
    fs::write(place.path("rig.toml"), rig).unwrap();
    place.run("bench surgeon --rig rig.toml --out hand.csv").ends_with(0);
    fs::copy(
        concat!(env!("CARGO_MANIFEST_DIR"), "/../../conformance/models/ems.json"),
        place.path("model.json"),
    )
    .unwrap();
    place
}

const OPTIONS: &str = "--force-error-n 0.05 --offset-n -0.34 --moving-mass-kg 0.04";

/// One row per row, the reading split into trocar, tissue and inertia, and the truth of the bench
/// within the noise.
#[test]
fn a_recording_becomes_a_table() {
    let place = place();
    let ran =
        place.run(&format!("compensate model.json hand.csv --out out.csv {OPTIONS}")).ends_with(0);
    assert_eq!(ran.stdout, "", "data went into the file");
    let text = fs::read_to_string(place.path("out.csv")).unwrap();
    let mut lines = text.lines();
    assert_eq!(
        lines.next(),
        Some("time_s,position_m,force_n,trocar_force_n,tissue_force_n,tissue_force_std_n,adapting")
    );
    let rows: Vec<Vec<f64>> =
        lines.map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect()).collect();
    assert_eq!(rows.len(), fs::read_to_string(place.path("hand.csv")).unwrap().lines().count() - 1);
    assert!(rows.iter().all(|row| row.len() == 7 && (row[6] == 0.0 || row[6] == 1.0)));
    let largest = rows.iter().map(|row| row[4]).fold(0.0, f64::max);
    assert!(largest > 1.0, "the tissue was met: {largest} N");
}

/// A controller at the other end of a pipe gets each answer before it sends the next row.
#[test]
fn each_row_is_answered_at_once() {
    let place = place();
    let mut command = place.command(&format!("--quiet compensate model.json - --out - {OPTIONS}"));
    let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    let mut rows = child.stdin.take().unwrap();
    let mut answers = BufReader::new(child.stdout.take().unwrap()).lines();
    writeln!(rows, "time_s,position_m,force_n\n0.000,0.05,-0.3").unwrap();
    assert!(answers.next().unwrap().unwrap().starts_with("time_s,"));
    assert!(answers.next().unwrap().unwrap().starts_with("0.0"));
    let began = Instant::now();
    for k in 1..200 {
        // A reading that never changes would be a fault of its own.
        let force = 0.1 + 1e-3 * f64::from(k % 2);
        writeln!(rows, "{:.3},{:.6},{force:.3}", 1e-3 * f64::from(k), 0.05 + 1e-5 * f64::from(k))
            .unwrap();
        let answer = answers.next().unwrap().unwrap();
        assert_eq!(answer.split(',').count(), 7, "{answer}");
    }
    assert!(began.elapsed() < Duration::from_secs(20), "nobody waits for a full buffer");
    drop(rows);
    assert!(child.wait().unwrap().success());
}

/// Rows without a reading, and readings at the limit, tell no tissue force: said, marked, and exit
/// code 3.
#[test]
fn faults_are_told() {
    let place = place();
    let text = fs::read_to_string(place.path("hand.csv")).unwrap();
    let broken: String = text
        .lines()
        .enumerate()
        .map(|(k, line)| match k {
            101..=150 => format!("{},nan,nan\n", line.rsplitn(3, ',').nth(2).unwrap()),
            _ => format!("{line}\n"),
        })
        .collect();
    fs::write(place.path("broken.csv"), broken).unwrap();
    let ran = place
        .run(&format!(
            "compensate model.json broken.csv --out out.csv --sensor-limit-n 3.0 {OPTIONS}"
        ))
        .ends_with(3);
    ran.says(&[
        "broken.csv: 50 rows, from line 102 on: no force reading: no tissue force",
        "at the sensor's limit",
    ]);
    let out = fs::read_to_string(place.path("out.csv")).unwrap();
    assert!(out.lines().nth(120).unwrap().contains(",nan,"), "{}", out.lines().nth(120).unwrap());
}

/// The offset in a model file includes the weight: gravity needs an offset without it and a mass.
#[test]
fn the_weight_is_subtracted_once() {
    let place = place();
    let mut model = ModelFile::read(&place.path("model.json")).unwrap();
    let weight = 0.04 * -9.81;
    model.sensor = Some(SensorInfo {
        offset_n: -0.34 + weight,
        moving_mass_kg: 0.04,
        ..SensorInfo::default()
    });
    fs::write(place.path("vertical.json"), model.to_json()).unwrap();
    let run = |rest: &str| {
        place.run(&format!(
            "compensate vertical.json hand.csv --force-error-n 0.05 --out out.csv {rest}"
        ))
    };
    run("--gravity-m-s2 -9.81 --moving-mass-kg 0.04").ends_with(1).says(&[
        "gravity_m_s2 is -9.81 m/s²",
        "the offset of the model includes the weight",
        "leave gravity_m_s2 out, or give offset_n without the weight",
    ]);
    assert!(!place.path("out.csv").exists(), "nothing half-written");
    run("--gravity-m-s2 -9.81 --moving-mass-kg 0 --offset-n -0.34")
        .ends_with(1)
        .says(&["without a moving mass on which it acts"]);
    let tissue = || -> Vec<f64> {
        let text = fs::read_to_string(place.path("out.csv")).unwrap();
        text.lines().skip(1).map(|row| row.split(',').nth(4).unwrap().parse().unwrap()).collect()
    };
    run("").ends_with(0);
    let with_weight = tissue();
    run("--gravity-m-s2 -9.81 --offset-n -0.34").ends_with(0);
    let both_ways = tissue();
    assert!(with_weight.iter().any(|force| force.abs() > 1.0), "the tissue was met");
    let apart = with_weight.iter().zip(&both_ways).map(|(a, b)| (a - b).abs());
    assert!(apart.fold(0.0, f64::max) < 1e-3, "the same weight, in the offset or beside it");
}

#[test]
fn what_cannot_be_run_leaves_nothing() {
    let place = place();
    let before = names_in(place.0.path());
    let ran = place.run("compensate model.json hand.csv --out out.csv").ends_with(1);
    ran.says(&["force_error", "--force-error-n"]);
    fs::write(place.path("back.csv"), "time_s,position_m,force_n\n0,0,0\n0.002,0,0\n0.001,0,0\n")
        .unwrap();
    let ran =
        place.run(&format!("compensate model.json back.csv --out out.csv {OPTIONS}")).ends_with(1);
    ran.says(&["back.csv line 4: time goes back from 0.002 s to 0.001 s"]);
    fs::write(place.path("two.csv"), "time_s,position_m\n0,0\n0.002,0\n").unwrap();
    place
        .run(&format!("compensate model.json two.csv --out out.csv {OPTIONS}"))
        .ends_with(1)
        .says(&["force"]);
    place.run("compensate model.json hand.csv --out out.csv --force-error-n -1").ends_with(2);
    fs::remove_file(place.path("back.csv")).unwrap();
    fs::remove_file(place.path("two.csv")).unwrap();
    assert_eq!(names_in(place.0.path()), before);
}

/// A model with rotation and a recording without an angle: said, with the way out.
#[test]
fn a_missing_angle_is_said() {
    let place = place();
    let mut model = ModelFile::read(&place.path("model.json")).unwrap();
    let rotation = Rotation {
        shaft_radius: 5e-3,
        circumferential_stiffness: 425.0,
        circumferential_ratio: 1.0,
    };
    model.trocar = model.trocar.with_rotation(Some(rotation)).unwrap();
    fs::write(place.path("turning.json"), model.to_json()).unwrap();
    place
        .run(&format!("compensate turning.json hand.csv --out out.csv {OPTIONS}"))
        .ends_with(0)
        .says(&["hand.csv: no angle in the first row", "hint: name the column angle_rad"]);
    let text = fs::read_to_string(place.path("out.csv")).unwrap();
    assert!(text.lines().next().unwrap().ends_with(",adapting,torque_n_m"));
    let text = fs::read_to_string(place.path("hand.csv")).unwrap();
    let with_angle = text.lines().enumerate().map(|(k, line)| match k {
        0 => format!("{line},angle_deg\n"),
        _ => format!("{line},{:.4}\n", 0.05 * k as f64),
    });
    fs::write(place.path("turned.csv"), with_angle.collect::<String>()).unwrap();
    let ran = place.run(&format!("compensate turning.json turned.csv --out out.csv {OPTIONS}"));
    ran.ends_with(0);
    let text = fs::read_to_string(place.path("out.csv")).unwrap();
    let torque: f64 = text.trim_end().rsplit_once(',').unwrap().1.parse().unwrap();
    assert!(torque > 5e-3, "{torque} N m");
}
