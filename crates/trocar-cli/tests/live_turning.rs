//! The live model of a trocar with rotation in a browser: moved, then turned.
//!
//! Needs what `live.rs` needs, and is skipped as it is.

use std::fs;
use std::path::Path;
use std::process::Command;

use serde::Deserialize;
use trocar::report::{Document, LiveModel, Section, page};
use trocar_model::{Element, ElementParams, Rotation, Trocar};

use crate::common::Ran;
use crate::live::{rows, skip, tools};

const ROTATION: Rotation =
    Rotation { shaft_radius: 5e-3, circumferential_stiffness: 400.0, circumferential_ratio: 1.0 };

#[derive(Debug, Deserialize)]
struct Seen {
    force: f64,
    torque: f64,
    /// Half axes of the ellipse that is drawn, N: around the shaft, along it.
    ellipse: [f64; 2],
    overflow: f64,
}

#[derive(Debug, Deserialize)]
struct Browser {
    moved: Seen,
    turned: Seen,
    telephone: Seen,
    complaints: Vec<String>,
    asked: Vec<String>,
}

#[test]
fn a_reader_turns_the_instrument_and_sees_force_and_torque_of_the_library() {
    let [browser, modules] = match tools() {
        Ok(tools) => tools,
        Err(why) => return skip(&why),
    };
    let element = Element::new(ElementParams::plausible_10_5_mm().unwrap()).unwrap();
    let coulomb = element.params().insertion.coulomb_force;
    let trocar: Trocar = Trocar::of_seal(element).with_rotation(Some(ROTATION)).unwrap();
    let live = LiveModel::of(&trocar, [0.0, 0.06]).unwrap();
    let sections = vec![Section::new("The model, live").live(live)];
    let document = Document { title: "Turning".to_owned(), sections, ..Document::default() };
    let place = tempfile::tempdir().unwrap();
    let [file, motion] = ["turning.html", "motion.csv"].map(|name| place.path().join(name));
    fs::write(&file, page(&document).unwrap()).unwrap();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut drive = Command::new("node");
    drive.arg(folder.join("tests/live/drive_turning.mjs")).arg(modules).arg(browser);
    let ran = Ran::from(drive.arg(&file).arg(&motion).output().unwrap()).ends_with(0);
    let seen: Browser = serde_json::from_str(&ran.stdout).unwrap();
    assert!(seen.complaints.is_empty() && seen.asked.is_empty(), "{seen:?}");

    let rows = rows(&motion, ["time_s", "position_m", "force_n", "angle_rad", "torque_n_m"]);
    let mut state = trocar.rest(rows[0][1]);
    for pair in rows.windows(2) {
        let [[before, ..], [time, position, force, angle, torque]] = [pair[0], pair[1]];
        let ours = trocar.turn_to(&mut state, position, angle, time - before);
        assert_eq!([ours, state.torque()], [force, torque], "{time} s");
    }
    assert_eq!([state.force(), state.torque()], [seen.turned.force, seen.turned.torque]);

    // The seal held with F_c; a quarter turn leaves a part of it, and the rest is around the shaft.
    assert!((seen.moved.force / coulomb - 1.0).abs() < 0.02, "{seen:?}");
    assert_eq!(seen.moved.torque, 0.0);
    let around = seen.turned.torque / ROTATION.shaft_radius;
    assert!(seen.turned.force < 0.8 * coulomb, "{seen:?}");
    assert!((seen.turned.force.hypot(around) / coulomb - 1.0).abs() < 0.02, "{seen:?}");
    for half_axis in seen.turned.ellipse {
        assert!((half_axis / coulomb - 1.0).abs() < 1e-2, "{seen:?}");
    }
    assert!(seen.telephone.overflow <= 0.0, "{} px wider", seen.telephone.overflow);
}
