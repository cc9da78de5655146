//! One recording in every format, written by third-party libraries, and one robot log in every kind
//! of bag.
//!
//! The files are those of `formats/make.py` and `bags/make.py`.

use std::f64::consts::{PI, TAU};
use std::path::PathBuf;

use trocar::identify::IdentifyOptions;
use trocar::inspect::inspect;
use trocar::recording::{Choice, ReadOptions, Recording, WarningKind, read};
use trocar::workflow::{MovingMass, Workflow};

/// Rows of the signal in `formats/`.
const ROWS: usize = 240;

/// A number in mm is rounded once more than one in m.
const ROUNDING: f64 = 1e-15;

fn path(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../trocar-recording/tests").join(name)
}

fn choice(columns: &str, topics: &[&str]) -> Choice {
    Choice {
        columns: Some(columns.to_owned()).filter(|columns| !columns.is_empty()),
        topics: topics.iter().map(|topic| (*topic).to_owned()).collect(),
        ..Choice::default()
    }
}

fn read_with(name: &str, choice: Choice) -> Result<Recording, String> {
    read(&path(name), &ReadOptions { choice, ..ReadOptions::default() })
        .map_err(|error| error.to_string())
}

/// `formats/make.py`.
fn signal(k: usize) -> (f64, f64, f64) {
    let phase = TAU * k as f64 / 200.0;
    (k as f64 / 100.0, 0.03 * (1.0 - phase.cos()), 1.5 * phase.sin() + 0.01 * (k % 7) as f64)
}

#[test]
fn every_format_gives_the_same_recording() {
    for (name, columns, topics) in [
        ("formats/pyarrow_snappy.parquet", "time_s=time_s,force_n=force_n", &[][..]),
        ("formats/pyarrow_none.parquet", "", &[]),
        ("formats/pyarrow_zstd.parquet", "", &[]),
        ("formats/pyarrow_gzip.parquet", "", &[]),
        ("formats/pyarrow_lz4.parquet", "", &[]),
        ("formats/pyarrow_v2.parquet", "", &[]),
        ("formats/pyarrow_split.parquet", "", &[]),
        ("formats/pandas_index.parquet", "", &[]),
        ("formats/polars.parquet", "", &[]),
        ("formats/pyarrow_uncompressed.feather", "", &[]),
        ("formats/pyarrow_zstd.feather", "", &[]),
        ("formats/pyarrow_lz4.feather", "time_s=time_s,force_n=force_n", &[]),
        ("formats/pyarrow.arrows", "", &[]),
        ("formats/polars.arrow", "", &[]),
        ("formats/h5py.h5", "force_n=force_n", &["runs/first"]),
        ("formats/mat73.mat", "", &[]),
        ("formats/scipy_plain.mat", "", &[]),
        ("formats/scipy_compressed.mat", "", &[]),
        ("formats/scipy_column.mat", "", &[]),
        ("formats/openpyxl.xlsx", "force_n=Force", &["Data"]),
    ] {
        let found = read_with(name, choice(columns, topics))
            .unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(found.len(), ROWS, "{name}");
        for k in 0..ROWS {
            let (t, x, f) = signal(k);
            assert_eq!(found.time[k], t, "{name} row {k}");
            assert!((found.position[k] - x).abs() <= 40.0 * ROUNDING, "{name} row {k}");
            assert!((found.force[k] - f).abs() <= 10.0 * ROUNDING, "{name} row {k}");
        }
        assert_eq!(found.sha256.len(), 64, "{name}");
    }
}

#[test]
fn crop_and_sign_work_in_every_format() {
    let cropped = Choice { from: Some(0.5), to: Some(1.0), flip_force: true, ..Choice::default() };
    let found = read_with("formats/polars.parquet", cropped).unwrap();
    assert_eq!((found.time[0], found.len()), (0.5, 50));
    assert!((found.force[0] + signal(50).2).abs() < 10.0 * ROUNDING);
    assert_eq!(found.quality.notes, ["sign of the force reversed"]);
}

/// A column that does not separate recordings, and a topic in a file without topics.
#[test]
fn text_is_chosen_from_as_any_table() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("quoted.csv");
    let rows: String =
        (0..50).map(|k| format!("{},{},{}\n", f64::from(k) * 1e-3, k % 30, k % 7)).collect();
    std::fs::write(&file, format!("time_s,\"stage, filtered\",\"load (N), raw\"\n{rows}")).unwrap();
    let columns = "position_mm=\"stage, filtered\",force_n=-\"load (N), raw\"";
    let found = inspect(&file, &choice(columns, &[])).unwrap().recording.unwrap();
    assert_eq!(
        found.columns[1..],
        columns.split_inclusive("\",").map(|c| c.trim_end_matches(',')).collect::<Vec<_>>()
    );
    let file = file.to_str().unwrap();
    assert_eq!(read_with(file, choice(columns, &[])).unwrap().force[3], -3.0);
    let refused = read_with(file, choice(columns, &["/load"])).unwrap_err();
    assert!(
        refused.contains("named '/load'") && refused.contains("one table without a name"),
        "{refused}"
    );
}

/// The columns printed by `inspect` are accepted: names with commas, quotes, blanks and a minus.
#[test]
fn odd_names_are_said_and_understood() {
    let folder = tempfile::tempdir().unwrap();
    for (name, given) in [
        ("travel (\")", "travel (\")"),
        ("-fz", "\"-fz\""),
        ("\"raw\"", "\"\"raw\"\""),
        ("load, \"raw\" N", "\"load, \"raw\" N\""),
    ] {
        let file = folder.path().join("odd.csv");
        let rows: String =
            (0..50).map(|k| format!("{},{},{}\n", f64::from(k) * 1e-3, k % 30, k % 7)).collect();
        let cell = name.replace('"', "\"\"");
        std::fs::write(&file, format!("time_s,x_mm,\"{cell}\"\n{rows}")).unwrap();
        let columns = format!("position_mm=x_mm,force_n={given}");
        let found = inspect(&file, &choice(&columns, &[])).unwrap().recording;
        let found = found.unwrap_or_else(|error| panic!("{given}: {error}"));
        let said = found.columns.join(",");
        let again = read_with(file.to_str().unwrap(), choice(&said, &[]))
            .unwrap_or_else(|e| panic!("{said}: {e}"));
        assert_eq!(again.force[3], 3.0, "{said}");
    }
    let open = read_with("formats/polars.parquet", choice("force_n=\"load, raw", &[])).unwrap_err();
    assert!(open.contains("without the double quote that ends its name"), "{open}");
}

#[test]
fn places_in_tables_are_rows() {
    // The position is missing in the rows of `gappy`.
    let found =
        read_with("formats/pyarrow_none.parquet", choice("position_mm=gappy", &[])).unwrap();
    assert_eq!(found.quality.non_finite_rows.lines[..3], [3, 8, 13]);
    assert!(found.quality.warnings.iter().any(|warning| warning.message.contains("rows 3, 8, 13")));
}

#[test]
fn what_cannot_be_chosen_is_explained() {
    for (name, choice, essentials) in [
        (
            "formats/pyarrow_delta.parquet",
            choice("", &[]),
            &["pyarrow_delta.parquet: no time, position or force column among 'count'"][..],
        ),
        (
            "formats/pyarrow_none.parquet",
            choice("force_n=note", &[]),
            &["'note'", "without numbers"],
        ),
        (
            "formats/h5py.h5",
            choice("", &["runs/second"]),
            &["0 topics or tables are named 'runs/second'", "runs/first"],
        ),
        (
            "formats/polars.parquet",
            choice("", &["/load"]),
            &["named '/load'", "one table without a name"],
        ),
        (
            "bags/plain.mcap",
            choice("time_s,position_m,force_n", &[]),
            &["in order", "name each column by its topic and field"],
        ),
        (
            "bags/plain.mcap",
            choice("", &["/load"]),
            &["no topic is clearly the position", "trocar inspect"],
        ),
        (
            "bags/plain.mcap",
            choice("force_n=/psm1/measured_cf.wrench.force.w", &[]),
            &["wrench.force.w", "no column has", "expected one of"],
        ),
    ] {
        let message = read_with(name, choice).unwrap_err();
        assert!(
            essentials.iter().all(|essential| message.contains(essential)),
            "{name}: {message}"
        );
    }
}

/// `bags/make.py`: position at `t` seconds after the start, m.
fn position(t: f64) -> f64 {
    0.12 + 0.05 * (PI * t).sin()
}

/// Linear interpolation between samples 5 ms apart has an error of at most h²/8 of the second
/// derivative.
const STRAIGHT: f64 = 20.0 * 0.05 * PI * PI * 0.005 * 0.005 / 8.0;

/// Names and units of CRTK are sufficient; the wrench takes precedence over the motor effort.
#[test]
fn a_robot_log_is_a_recording_in_every_kind_of_bag() {
    for name in [
        "bags/plain.mcap",
        "bags/zstd.mcap",
        "bags/lz4.mcap",
        "bags/unchunked.mcap",
        "bags/bare.mcap",
        "bags/mcap",
        "bags/sqlite",
        "bags/sqlite/sqlite.db3",
        "bags/split",
        "bags/compressed",
        "bags/big_endian",
        "bags/ros1_none.bag",
        "bags/ros1_bz2.bag",
        "bags/ros1_lz4.bag",
    ] {
        let columns = "force_n=/psm1/measured_cf.wrench.force.z,velocity_m_s=/psm1/measured_js.velocity[insertion]";
        let columns = format!("position_m=/psm1/measured_js.position[insertion],{columns}");
        let log = "time_s=/psm1/measured_js.log_time_s";
        // The times are those of the stamps unless others are requested.
        for columns in [columns.clone(), format!("{columns},{log}")] {
            let found = read_with(name, choice(&columns, &[]))
                .unwrap_or_else(|error| panic!("{name}: {error}"));
            assert!(found.len() > 20, "{name}: {} rows", found.len());
            let notes = found.quality.notes.join("\n");
            assert!(
                notes.contains("interpolated linearly") && notes.contains("measured_cf"),
                "{name}: {notes}"
            );
        }
    }
}

/// The side force of the fixtures is 0.25 N in every message.
#[test]
fn a_log_with_a_constant_force_is_refused_before_any_fit() {
    let columns =
        "position_m=/psm1/measured_js.position[insertion],force_n=/psm1/measured_cf.wrench.force.x";
    for name in ["bags/plain.mcap", "bags/sqlite"] {
        let found =
            read_with(name, choice(columns, &[])).unwrap_or_else(|error| panic!("{name}: {error}"));
        for mass in [0.0, 0.5] {
            let moving_mass = MovingMass { mass, gravity: 0.0 };
            let no_stage = |stage: &str, _: f64| panic!("{name}: {stage}");
            let refused = Workflow::run(
                vec![found.clone()],
                vec![],
                moving_mass,
                IdentifyOptions::default(),
                &no_stage,
            );
            let message = refused.map(|_| ()).unwrap_err().to_string();
            assert!(message.contains("the force is 0.25 N throughout"), "{name}: {message}");
        }
    }
}

#[test]
fn names_alone_choose_the_insertion_joint_and_the_wrench() {
    let found =
        read_with("bags/plain.mcap", choice("", &["/psm1/measured_js", "/psm1/measured_cf"]))
            .unwrap();
    assert!(found.velocity.is_some(), "the joint's own velocity");
    let notes = found.quality.notes.join("\n");
    for essential in [
        "/psm1/measured_js.position[insertion] taken as position",
        "/psm1/measured_cf.wrench.force.z taken as force",
        "times are header.stamp_s",
        "/psm1/measured_cf has no value at 22 rows in gaps",
        "rows before the first sample of /psm1/measured_cf or after its last are left out",
        "preferred to /psm1/measured_js.effort[insertion], which ‹columns='force_n=/psm1/measured_js.effort[insertion]'› would take",
    ] {
        assert!(notes.contains(essential), "'{essential}' not in {notes}");
    }
    // Times are relative to the first of the log, which is LATENCY after the first stamp.
    for k in 0..found.len() {
        assert!((found.position[k] - position(found.time[k] + 3e-4)).abs() < 1e-12, "row {k}");
        assert!(
            (found.force[k] - (20.0 * found.position[k] - 2.0)).abs() < STRAIGHT,
            "row {k}: {}",
            found.force[k]
        );
    }
    // Without the first and the last row, and those in the gap of eight wrenches.
    assert!((60..90).contains(&found.len()), "{}", found.len());
}

#[test]
fn one_topic_needs_no_joining() {
    let columns = "position_m=position[insertion],force_n=effort[insertion]";
    let found = read_with("bags/plain.mcap", choice(columns, &["measured_js"])).unwrap();
    assert_eq!(found.len(), 100);
    for k in 0..100 {
        let t = k as f64 * 2e-3;
        assert!((found.time[k] - found.time[0] - t).abs() < 1e-9, "header stamps are exact");
        assert!((found.position[k] - position(t)).abs() < 1e-12);
        assert!((found.force[k] - 1.0 - 10.0 * position(t)).abs() < 1e-12);
    }
}

#[test]
fn an_unfinished_log_is_read_with_a_warning() {
    let whole = std::fs::read(path("bags/plain.mcap")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let cut = folder.path().join("cut.mcap");
    std::fs::write(&cut, &whole[..whole.len() * 3 / 4]).unwrap();
    let choice =
        choice("position_m=position[insertion],force_n=effort[insertion]", &["measured_js"]);
    let found = read(&cut, &ReadOptions { choice, ..ReadOptions::default() }).unwrap();
    assert!(found.len() > 8 && found.len() <= 100);
    assert!(
        found.quality.warnings.iter().any(|warning| warning.kind == WarningKind::Source),
        "{:?}",
        found.quality
    );
}

#[test]
fn inspect_tells_tables_clocks_and_words() {
    let found =
        inspect(&path("bags/plain.mcap"), &choice("", &["/psm1/measured_js", "/psm1/measured_cf"]))
            .unwrap();
    let joints = found.tables.iter().find(|table| table.name == "/psm1/measured_js").unwrap();
    assert_eq!((joints.rows, joints.kind.as_str()), (100, "sensor_msgs/msg/JointState"));
    let insertion =
        joints.columns.iter().find(|column| column.name == "position[insertion]").unwrap();
    assert!((insertion.lowest.unwrap() - 0.12).abs() < 1e-12 && insertion.not_finite == 0);
    let words = found.recording.unwrap().columns;
    let again = read_with("bags/plain.mcap", choice(&words.join(","), &[])).unwrap();
    let first =
        read_with("bags/plain.mcap", choice("", &["/psm1/measured_js", "/psm1/measured_cf"]))
            .unwrap();
    assert_eq!(again.force, first.force, "the words give the same recording: {words:?}");
    assert_eq!(again.time, first.time);

    let table = inspect(&path("formats/pyarrow_none.parquet"), &Choice::default()).unwrap();
    let clock = table.tables[0].clock.as_ref().unwrap();
    assert_eq!((clock.column.as_str(), clock.gaps, clock.not_later), ("time_s", 0, 0));
    assert!((clock.median_interval - 0.01).abs() < 1e-9);
    let found = table.recording.unwrap();
    assert_eq!(found.columns, ["time_s=time_s", "position_mm=position", "force_n=force_n"]);
    assert_eq!(table.tables[0].columns.iter().find(|c| c.name == "gappy").unwrap().not_finite, 48);
}

#[test]
fn words_for_columns_without_names_are_in_order() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("raw.txt");
    let rows: Vec<String> =
        (0..100).map(|k| format!("{},{},{}", f64::from(k) * 1e-3, k % 30, k % 7)).collect();
    std::fs::write(&path, rows.join("\n")).unwrap();
    let words = inspect(&path, &choice("time_s,position_mm,force_n", &[]))
        .unwrap()
        .recording
        .unwrap()
        .columns;
    assert_eq!(words, ["time_s,position_mm,force_n"]);
    assert!(
        inspect(std::path::Path::new("-"), &Choice::default())
            .unwrap_err()
            .to_string()
            .contains("stream")
    );
}

#[test]
fn inspect_says_why_no_recording_can_be_read() {
    let found = inspect(&path("bags/plain.mcap"), &choice("", &["/load"])).unwrap();
    assert!(found.recording.unwrap_err().contains("no topic is clearly the position"));
    assert!(found.tables.len() > 5, "all topics are shown whatever is chosen");
}
