//! The seal of the book's first page in a browser, as a reader uses it, against the library.
//!
//! Needs what `live.rs` needs, and is skipped as it is.

use std::fs;
use std::path::Path;
use std::process::Command;

use serde::Deserialize;
use trocar_model::{Element, ElementParams, Trocar};

use crate::common::Ran;
use crate::live::{Motion, skip, tools};

#[derive(Debug, Deserialize)]
struct Seen {
    lip: String,
    force: f64,
    position: f64,
    overflow: f64,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Desktop {
    start: Seen,
    after: Seen,
    by_keys: Seen,
    playing: [f64; 2],
}

#[derive(Debug, Deserialize)]
struct Telephone {
    before: Seen,
    after: Seen,
}

#[derive(Debug, Deserialize)]
struct Without {
    lip: String,
    force: String,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Browser {
    without_script: Without,
    desktop: Desktop,
    telephone: Telephone,
    /// As a reader wants motion, and as one who wants less of it.
    plays: [bool; 2],
    complaints: Vec<String>,
    asked: Vec<String>,
}

#[test]
fn a_reader_drags_the_seal_of_the_book_and_sees_the_forces_of_the_library() {
    let [browser, modules] = match tools() {
        Ok(tools) => tools,
        Err(why) => return skip(&why),
    };
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let fragment =
        folder.join("../../docs/figures/gallery/moving-seal.html").canonicalize().unwrap();
    let place = tempfile::tempdir().unwrap();
    let [played, motion] = ["played.html", "motion.csv"].map(|name| place.path().join(name));
    let text = fs::read_to_string(&fragment).unwrap();
    fs::write(&played, format!("<div data-mode=\"play\">\n{text}</div>\n")).unwrap();
    let mut drive = Command::new("node");
    drive.arg(folder.join("tests/live/drive_seal.mjs")).arg(modules).arg(browser);
    drive.arg(&fragment).arg(&played).arg(&motion);
    let ran = Ran::from(drive.output().unwrap()).ends_with(0);
    let seen: Browser = serde_json::from_str(&ran.stdout).unwrap();
    assert!(seen.complaints.is_empty() && seen.asked.is_empty(), "{seen:?}");

    let desktop = &seen.desktop;
    let seal = Element::new(ElementParams::plausible_10_5_mm().unwrap()).unwrap();
    let trocar: Trocar = Trocar::of_seal(seal);
    let dragged = Motion::read(&motion);
    assert!(dragged.travel() > 0.1 && dragged.time.len() > 8_000, "{} m", dragged.travel());
    dragged.assert_forces("dragged", &trocar.borrowed(), trocar.rest(dragged.position[0]));
    let last = dragged.force.len() - 1;
    assert_eq!(desktop.after.force.to_bits(), dragged.force[last].to_bits());
    assert_eq!(desktop.after.position.to_bits(), dragged.position[last].to_bits());
    let by_keys = desktop.by_keys.position - desktop.after.position;
    assert!((by_keys - 5e-3).abs() < 1e-9, "five presses, a millimetre each: {by_keys} m");
    assert!(desktop.playing[0] != desktop.playing[1], "{:?}", desktop.playing);
    assert!(seen.plays[0] && !seen.plays[1], "{:?}", seen.plays);

    let telephone = &seen.telephone;
    assert!(telephone.after.position < telephone.before.position - 2e-3, "{telephone:?}");
    assert!(telephone.after.overflow <= 0.0, "{} px wider", telephone.after.overflow);

    // Without script the picture is that of the first state, drawn by the library.
    assert_eq!(seen.without_script.lip, desktop.start.lip);
    assert_eq!(seen.without_script.force, format!("{:.2} N", desktop.start.force));
}
