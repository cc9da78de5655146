//! The live loop in the report of `trocar teleop` in a browser, as a reader uses it, against the library.
//!
//! Needs what `live.rs` needs, and is skipped in the same way.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

use serde::Deserialize;
use trocar::model_file::ModelFile;
use trocar::teleop::config::Architecture;
use trocar::teleop::{Config, Loop};

use crate::common::{Place, Ran};
use crate::live::{skip, tools};

const CONFIG: &str =
    "[channel]\ndelay_s = 0.01\n[compensation]\nfraction = 0.9\n[tissue]\nstiffness_n_m = 400.0\n";
/// Largest report of a loop, bytes.
const LARGEST: u64 = 900_000;

#[derive(Debug, Deserialize)]
struct Seen {
    text: BTreeMap<String, String>,
    value: BTreeMap<String, String>,
    message: String,
}

impl Seen {
    fn number(&self, name: &str) -> f64 {
        self.value[name].parse().unwrap()
    }
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Desktop {
    start: Seen,
    turned: Seen,
    unstable: Seen,
    refused: Seen,
    wave: Seen,
    reset: Seen,
    dragged: Seen,
    before_keys: f64,
    after_keys: f64,
}

#[derive(Debug, Deserialize)]
struct Telephone {
    before: f64,
    after: f64,
    overflow: f64,
}

#[derive(Debug, Deserialize)]
struct Paper {
    notice: bool,
    live: bool,
    overflow: f64,
}

#[derive(Debug, Deserialize)]
struct Without {
    absent: bool,
    figures: usize,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Result {
    desktop: Desktop,
    telephone: Telephone,
    paper: Paper,
    complaints: Vec<String>,
    asked: Vec<String>,
    no_script: Without,
}

/// A course that was downloaded from the page: its columns by name.
fn course(path: &Path) -> BTreeMap<String, Vec<f64>> {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let names: Vec<String> = lines.next().unwrap().split(',').map(str::to_owned).collect();
    let rows: Vec<Vec<f64>> =
        lines.map(|line| line.split(',').map(|value| value.parse().unwrap()).collect()).collect();
    let column = |k: usize| rows.iter().map(|row| row[k]).collect();
    names.into_iter().enumerate().map(|(k, name)| (name, column(k))).collect()
}

/// The library's loop along the hand's positions of a course gives the course, to the last bit.
fn assert_course(path: &Path, what: &str, change: impl FnOnce(&mut Config)) -> usize {
    let page = course(path);
    let mut config = Config::from_toml(CONFIG).unwrap();
    change(&mut config);
    let trocar = ModelFile::plausible_10_5_mm().unwrap().trocar;
    let (hand, duration) = (&page["hand_position_m"], config.sample_time_s);
    let mut own = Loop::new(&config, trocar.clone(), trocar, hand[0]).unwrap();
    // What the hand does after the last sample is not in the course.
    for k in 0..hand.len() - 1 {
        let (from, begin) = (hand[k], k as f64 * duration);
        let velocity = (hand[k + 1] - from) / duration;
        let sample = own.step(|time| (from + velocity * (time - begin), velocity)).unwrap();
        let pairs = [
            ("leader_position_m", sample.leader_position),
            ("follower_position_m", sample.follower_position),
            ("felt_force_n", config.felt(&sample)),
            ("trocar_force_n", sample.trocar_force),
            ("tissue_force_n", sample.tissue_force),
            ("estimate_n", sample.estimate),
        ];
        for (name, value) in pairs {
            let found = page[name][k];
            assert_eq!(found.to_bits(), value.to_bits(), "{what}, {name}, {k}: {found} {value}");
        }
    }
    hand.len()
}

#[test]
fn a_reader_turns_and_drags_and_sees_the_loop_of_the_library() {
    let [browser, modules] = match tools() {
        Ok(tools) => tools,
        Err(why) => return skip(&why),
    };
    let place = Place::new();
    fs::write(place.path("loop.toml"), CONFIG).unwrap();
    let printed = place.run("teleop loop.toml --model plausible --advise --map --json --out found");
    let printed = printed.ends_with(0);
    let size = fs::metadata(place.path("found/report.html")).unwrap().len();
    assert!(size < LARGEST, "{size} bytes");
    let mut drive = Command::new("node");
    drive.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/live/drive_loop.mjs"));
    drive.arg(modules).arg(browser).arg(place.path("found/report.html")).arg(place.path("."));
    let ran = Ran::from(drive.output().unwrap()).ends_with(0);
    let seen: Result = serde_json::from_str(&ran.stdout).unwrap();
    assert!(seen.complaints.is_empty() && seen.asked.is_empty(), "{seen:?}");
    check_desktop(&seen.desktop, &place, &printed.stdout);
    let Telephone { before, after, overflow } = seen.telephone;
    assert!(after > before + 2.0, "a finger moved it from {before} to {after} mm");
    assert!(overflow <= 0.0, "{overflow} px wider than the screen");
    assert!(
        seen.paper.notice && !seen.paper.live && seen.paper.overflow <= 0.0,
        "{:?}",
        seen.paper
    );
    assert!(seen.no_script.absent && seen.no_script.figures > 3, "{:?}", seen.no_script);
}

fn check_desktop(seen: &Desktop, place: &Place, printed: &str) {
    let printed: serde_json::Value = serde_json::from_str(printed).unwrap();
    let figure = |name: &str| printed["figures"][name].as_f64().unwrap();
    // The hand's velocity between samples is even in the page, and a sine's in the program.
    for (shown, name) in [("displayed", "displayed_stiffness_n_m"), ("error", "force_error_rms_n")]
    {
        let (page, program) = (seen.start.number(shown), figure(name));
        assert!((page / program - 1.0).abs() < 2e-3, "{name}: {page} in the page, {program}");
    }
    assert_eq!(seen.start.text["loop"], "stable");
    let count = assert_course(&place.path("motion.csv"), "motion", |_| ());
    assert_eq!(count, 4000);
    assert_course(&place.path("turned.csv"), "turned", |config| {
        (config.compensation.fraction, config.channel.delay_s) = (0.0, 0.0);
    });
    assert!(seen.turned.number("error") > 5.0 * seen.start.number("error"), "{:?}", seen.turned);
    assert!(seen.unstable.text["loop"].starts_with("unstable"), "{:?}", seen.unstable);
    assert_eq!(seen.unstable.text["displayed"], "–", "no figures of an unstable loop");
    assert_eq!(seen.refused.text["loop"], "refused");
    assert!(seen.refused.message.contains("channel.delay_s"), "{}", seen.refused.message);
    assert_eq!(seen.wave.text["loop"], "stable");
    assert_course(&place.path("wave.csv"), "wave", |config| {
        config.control.architecture = Architecture::Wave;
    });
    assert_eq!((&seen.reset.value, &seen.reset.text), (&seen.start.value, &seen.start.text));
    let dragged = course(&place.path("dragged.csv"));
    let hand = &dragged["hand_position_m"];
    let travel: f64 = hand.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum();
    assert!(hand.len() > 500 && travel > 0.02, "{} samples, {travel} m", hand.len());
    assert_course(&place.path("dragged.csv"), "dragged", |_| ());
    let felt = dragged["felt_force_n"].last().unwrap();
    assert_eq!(seen.dragged.number("felt").to_bits(), felt.to_bits());
    assert!((seen.after_keys - seen.before_keys - 5.0).abs() < 0.06, "five presses, 1 mm each");
}
