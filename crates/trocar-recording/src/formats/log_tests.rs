//! Robot logs written by Python's mcap, mcap-ros2-support and rosbags (`tests/bags/make.py`): the
//! motion in them is known.

use std::f64::consts::PI;
use std::path::{Path, PathBuf};

use trocar_tables::content::{HEADER_STAMP, LOG_TIME};

use crate::container::Container;
use crate::join::{self, Joined, Pick};
use crate::{RecordingError, Table};

use super::{mcap, ros1, rosbag};

/// Difference allowed between a value read and the one written, in its own unit: the last bits of a
/// sine.
const EXACT: f64 = 1e-12;

/// As in `make.py`, ns.
const START: i64 = 1_700_000_000_123_456_789;
const LATENCY: i64 = 300_000;
const SAMPLES: usize = 100;

/// All logs with `/psm1/measured_js`, and whether each has all topics.
const LOGS: [(&str, bool); 16] = [
    ("ros1_none.bag", true),
    ("ros1_bz2.bag", true),
    ("ros1_lz4.bag", true),
    ("zstd.mcap", true),
    ("lz4.mcap", true),
    ("plain.mcap", true),
    ("unchunked.mcap", true),
    ("bare.mcap", true),
    ("disordered.mcap", true),
    ("sqlite", true),
    ("mcap", false),
    ("big_endian/big_endian.db3", false),
    ("compressed", false),
    ("split", false),
    ("old.db3", false),
    ("ros1.mcap", false),
];

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/bags").join(name)
}

pub(crate) fn open(path: &Path) -> Result<Container, RecordingError> {
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("mcap") => Ok(mcap::open(path)?.into()),
        Some("bag") => Ok(ros1::open(path)?.into()),
        _ => rosbag::open(path),
    }
}

fn table<'a>(log: &'a Container, topic: &str) -> (usize, &'a Table) {
    log.tables
        .iter()
        .enumerate()
        .find(|(_, table)| table.name == topic)
        .expect("a topic of the log")
}

/// Columns of a topic from its first row to its last, and the losses.
fn read(log: &Container, topic: &str, names: &[&str]) -> (Vec<Vec<f64>>, Vec<String>) {
    let (place, table) = table(log, topic);
    let find = |name: &&str| {
        table.columns.iter().position(|column| column.name == **name).expect("a column")
    };
    let columns: Vec<usize> = names.iter().map(find).collect();
    read_places(log, place, &columns).expect("a whole log")
}

type Columns = (Vec<Vec<f64>>, Vec<String>);

fn read_places(
    log: &Container,
    table: usize,
    columns: &[usize],
) -> Result<Columns, RecordingError> {
    let mut batches = log.open(table, columns)?;
    let mut all = vec![Vec::new(); columns.len()];
    let mut batch = vec![Vec::new(); columns.len()];
    while batches.next(&mut batch)? {
        for (all, batch) in all.iter_mut().zip(&mut batch) {
            all.append(batch);
        }
    }
    Ok((all, batches.warnings()))
}

/// Columns as numbered rows.
fn rows(columns: &[Vec<f64>]) -> impl Iterator<Item = (usize, Vec<f64>)> + '_ {
    (0..columns[0].len()).map(|row| (row, columns.iter().map(|column| column[row]).collect()))
}

fn position(ns: i64) -> f64 {
    0.12 + 0.05 * (PI * (ns as f64 * 1e-9)).sin()
}

fn latency(k: usize) -> i64 {
    LATENCY + (7919 * k as i64 % 97) * 1000
}

/// Seconds since the first message of the log.
fn since_first(ns: i64) -> f64 {
    (ns - LATENCY) as f64 / 1e9
}

fn assert_near(found: f64, expected: f64, what: &str) {
    assert!((found - expected).abs() <= EXACT, "{what}: {found} instead of {expected}");
}

#[test]
fn joints_are_what_python_wrote() {
    for (name, has_all) in LOGS {
        let log = open(&fixture(name)).unwrap();
        assert_eq!(log.warnings, [""; 0], "{name}");
        let names = [
            HEADER_STAMP,
            LOG_TIME,
            "position[insertion]",
            "effort[insertion]",
            "position[yaw]",
            "position[outer]",
        ];
        let (columns, warnings) = read(&log, "/psm1/measured_js", &names);
        assert_eq!(warnings, [""; 0], "{name}");
        let found = columns[0].len();
        assert!(if has_all { found == SAMPLES } else { found > 30 }, "{name}: {found} rows");
        for (k, row) in rows(&columns) {
            let t = k as i64 * 2_000_000;
            assert_near(row[0], since_first(t), name);
            assert_near(row[1], since_first(t + latency(k)), name);
            assert_near(row[2], position(t), name);
            assert_near(row[3], 1.0 + 10.0 * position(t), name);
            assert_near(row[4], k as f64, name);
            assert_near(row[5], -(k as f64), name);
        }
    }
}

#[test]
fn forces_keep_their_gap_and_arrays_their_places() {
    for (name, _) in LOGS.iter().filter(|(_, has_all)| *has_all) {
        let log = open(&fixture(name)).unwrap();
        let (force, _) =
            read(&log, "/psm1/measured_cf", &[HEADER_STAMP, "wrench.force.z", "wrench.force.x"]);
        let samples: Vec<i64> =
            (0..2 * SAMPLES as i64 / 5).filter(|k| !(20..28).contains(k)).collect();
        assert_eq!(force[0].len(), samples.len(), "{name}");
        for (row, k) in samples.iter().enumerate() {
            let t = k * 5_000_000 + 1_000_000;
            assert_near(force[0][row], since_first(t), name);
            assert_near(force[1][row], 20.0 * position(t) - 2.0, name);
            assert_near(force[2][row], 0.25, name);
        }
        let (levels, _) = read(&log, "/levels", &["data[0]", "data[1]"]);
        assert!(
            (0..SAMPLES / 10).all(|k| levels[0][k] == k as f64 && levels[1][k] == k as f64 + 0.5),
            "{name}"
        );
        let (load, _) = read(&log, "/load", &[LOG_TIME, "data"]);
        for (k, row) in rows(&load) {
            let log_time = k as i64 * 10_000_000 + latency(k);
            assert_near(row[0], since_first(log_time), name);
            assert_near(row[1], 20.0 * position(log_time) - 2.0, name);
        }
    }
}

#[test]
fn columns_have_the_units_of_their_types() {
    let log = open(&fixture("zstd.mcap")).unwrap();
    let unit = |topic: &str, name: &str| {
        let (_, table) = table(&log, topic);
        let column = table.columns.iter().find(|column| column.name == name);
        column.unwrap_or_else(|| panic!("{topic} {name} of {:?}", table.columns)).unit.clone()
    };
    assert_eq!(unit("/psm1/measured_js", LOG_TIME).as_deref(), Some("s"));
    assert_eq!(unit("/psm1/measured_js", "publish_time_s").as_deref(), Some("s"));
    assert_eq!(unit("/psm1/measured_cf", "wrench.force.z").as_deref(), Some("N"));
    assert_eq!(unit("/psm1/measured_cf", "wrench.torque.x").as_deref(), Some("N m"));
    assert_eq!(unit("/psm1/measured_cp", "pose.position.z").as_deref(), Some("m"));
    assert_eq!(unit("/psm1/measured_cp", "pose.orientation.w"), None);
    assert_eq!(unit("/sim/measured_cv", "twist.linear.z").as_deref(), Some("m/s"));
    assert_eq!(unit("/sim/measured_cv", "twist.angular.z").as_deref(), Some("rad/s"));
    assert_eq!(
        unit("/psm1/measured_js", "position[insertion]"),
        None,
        "m or rad: the message does not say"
    );
    let (_, joints) = table(&log, "/psm1/measured_js");
    assert_eq!((&*joints.kind, joints.rows), ("sensor_msgs/msg/JointState", Some(SAMPLES as u64)));
}

#[test]
fn text_is_listed_and_refused() {
    let log = open(&fixture("sqlite")).unwrap();
    let (place, state) = table(&log, "/state");
    let text = state.columns.iter().position(|column| column.name == "data").unwrap();
    assert!(!state.columns[text].is_numeric);
    let error = log.open(place, &[text]).err().expect("text is no number").to_string();
    assert!(
        error.contains("column 'data of /state' of this ROS 2 bag (folder) file holds no numbers"),
        "{error}"
    );
}

#[test]
fn one_column_alone_is_the_same_as_among_all() {
    for name in ["plain.mcap", "sqlite", "json.mcap"] {
        let log = open(&fixture(name)).unwrap();
        for (place, table) in log.tables.iter().enumerate() {
            let numeric: Vec<usize> =
                (0..table.columns.len()).filter(|&k| table.columns[k].is_numeric).collect();
            let (all, _) = read_places(&log, place, &numeric).unwrap();
            let backwards: Vec<usize> = numeric.iter().rev().copied().collect();
            let (turned, _) = read_places(&log, place, &backwards).unwrap();
            for (at, column) in numeric.iter().enumerate() {
                let (alone, _) = read_places(&log, place, &[*column]).unwrap();
                assert_eq!(
                    alone[0], all[at],
                    "{name} {} {}",
                    table.name, table.columns[*column].name
                );
                assert_eq!(alone[0], turned[numeric.len() - 1 - at], "{name} {}", table.name);
            }
        }
    }
}

#[test]
fn every_kind_of_field_is_found_behind_every_other_in_both_byte_orders() {
    let log = open(&fixture("odd.mcap")).unwrap();
    for topic in ["/little", "/big"] {
        let numbers = [
            "on",
            "small",
            "big",
            "bytes[2]",
            "ratio",
            "parts[1].size",
            "pair[1].flag",
            "span_s",
            "tip.y",
        ];
        let (columns, warnings) = read(&log, topic, &numbers);
        assert_eq!(warnings, [""; 0]);
        for row in 0..20 {
            let k = row as f64;
            let expected =
                [k % 2.0, -k, k * 1e10, k + 2.0, k / 4.0, k + 1.5, 20.0 + k, k + 0.5, -0.5 * k];
            let found: Vec<f64> = columns.iter().map(|column| column[row]).collect();
            assert_eq!(found, expected, "{topic} {row}");
        }
        let (columns, _) = read(&log, topic, &["angles[a]", "last", "angles[b]"]);
        let expected = |factor: f64| (0..20).map(|k| factor * f64::from(k)).collect::<Vec<_>>();
        assert_eq!(
            columns,
            [expected(1.0), expected(3.0), expected(-1.0)],
            "names change places from message to message"
        );
    }
}

#[test]
fn topics_of_a_log_are_joined_on_the_stamps_of_the_position() {
    for name in ["zstd.mcap", "disordered.mcap", "sqlite"] {
        let log = open(&fixture(name)).unwrap();
        let (columns, joined) = joined(
            &log,
            [("/psm1/measured_js", "position[insertion]"), ("/psm1/measured_cf", "wrench.force.z")],
        );
        assert_eq!(joined.clock, HEADER_STAMP);
        // The first and the last row are outside of the times of the force.
        assert_eq!(
            (joined.warnings.len(), columns[0].len()),
            (0, SAMPLES - 2),
            "{name}: {:?}",
            joined.warnings
        );
        for (k, row) in rows(&columns) {
            let t = (k as i64 + 1) * 2_000_000;
            assert_near(row[0], since_first(t), name);
            assert_near(row[1], position(t), name);
            // Samples are at 1 ms + 5 ms k, of which 20 to 27 are missing.
            let is_known =
                (1_000_000..=96_000_000).contains(&t) || (141_000_000..=196_000_000).contains(&t);
            assert_eq!(row[2].is_finite(), is_known, "{name}: {t} ns");
            assert!(
                !is_known || (row[2] - (20.0 * position(t) - 2.0)).abs() < BENT,
                "{name}: {t} ns"
            );
        }
        let notes = joined.batches.notes();
        assert!(
            notes[1].starts_with("2 rows before the first sample of /psm1/measured_cf"),
            "{name}: {notes:?}"
        );
        assert!(notes[2].contains("at 22 rows in gaps"), "{name}: {notes:?}");
    }
}

/// Half the sagitta of 20 N/m times the sine between samples 5 ms apart, N, with a margin:
/// 20 * 0.05 pi^2 (5e-3)^2 / 8 = 3.1e-5.
const BENT: f64 = 3.2e-5;

#[test]
fn topics_of_different_clocks_are_joined_on_the_logs_time() {
    let log = open(&fixture("zstd.mcap")).unwrap();
    let (columns, joined) = joined(
        &log,
        [("/psm1/measured_js", "position[insertion]"), ("/sim/measured_cv", "twist.linear.z")],
    );
    assert_eq!(joined.clock, LOG_TIME);
    assert!(joined.notes[0].contains("of different clocks"), "{:?}", joined.notes);
    assert_near(columns[0][1], since_first(2_000_000 + latency(1)), "log time");
    let (_, joined) =
        self::joined(&log, [("/psm1/measured_js", "position[insertion]"), ("/load", "data")]);
    assert!(joined.notes[0].contains("/load has no header.stamp_s"), "{:?}", joined.notes);
}

fn joined(log: &Container, wanted: [(&str, &str); 2]) -> (Vec<Vec<f64>>, Joined) {
    let picks = wanted.map(|(topic, name)| {
        let (place, table) = table(log, topic);
        let value = table.columns.iter().position(|column| column.name == name).unwrap();
        Pick { table: place, clock: None, values: vec![value] }
    });
    let mut joined = join::join(log, &picks, 0, &[]).unwrap();
    let mut all = vec![Vec::new(); 3];
    let mut batch = all.clone();
    while joined.batches.next(&mut batch).unwrap() {
        all.iter_mut().zip(&batch).for_each(|(all, batch)| all.extend_from_slice(batch));
    }
    (all, joined)
}

#[test]
fn json_is_read_and_other_encodings_are_named() {
    let log = open(&fixture("json.mcap")).unwrap();
    let (columns, _) = read(&log, "/rig", &["stamp_s", "position", "force.z", "ok"]);
    for (k, row) in rows(&columns) {
        let t = k as i64 * 2_000_000;
        assert_near(row[0], t as f64 / 1e9, "stamp");
        assert_near(row[1], position(t), "position");
        assert_eq!((row[2], row[3]), (k as f64, 1.0));
    }
    assert_eq!(log.warnings.len(), 1);
    assert!(
        log.warnings[0].contains("topic /other: its messages are written in protobuf"),
        "{:?}",
        log.warnings
    );
}

#[test]
fn stamps_of_another_clock_count_from_their_own_first() {
    for name in ["zstd.mcap", "sqlite"] {
        let log = open(&fixture(name)).unwrap();
        let (columns, _) = read(&log, "/sim/measured_cv", &[HEADER_STAMP, LOG_TIME]);
        assert_eq!(columns[0], (0..SAMPLES / 10).map(|k| k as f64 * 0.02).collect::<Vec<_>>());
        assert_near(columns[1][1], since_first(20_000_000 + latency(1)), name);
        let clock = |topic: &str| {
            let (place, table) = table(&log, topic);
            log.content.clock(
                place,
                table,
                table.columns.iter().position(|column| column.name == HEADER_STAMP).unwrap(),
            )
        };
        assert_ne!(clock("/sim/measured_cv"), clock("/psm1/measured_js"));
        let first = format!("times count from {} ns", START + LATENCY);
        assert!(log.notes.iter().any(|note| note.contains(&first)), "{:?}", log.notes);
        assert!(
            log.notes
                .iter()
                .any(|note| note.contains("/sim/measured_cv") && note.contains("5000000000 ns"))
        );
    }
}

#[test]
fn a_log_cut_off_gives_its_whole_messages_and_says_what_is_lost() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["zstd.mcap", "lz4.mcap", "plain.mcap", "unchunked.mcap"] {
        let bytes = std::fs::read(fixture(name)).unwrap();
        let whole = open(&fixture(name)).unwrap();
        let (all, _) = read(&whole, "/psm1/measured_js", &[LOG_TIME, "position[insertion]"]);
        let path = folder.path().join(name);
        std::fs::write(&path, &bytes[..bytes.len() * 6 / 10]).unwrap();
        let log = open(&path).unwrap();
        assert!(log.warnings[0].contains("without an index"), "{:?}", log.warnings);
        let (some, _) = read(&log, "/psm1/measured_js", &[LOG_TIME, "position[insertion]"]);
        let rows = some[0].len();
        assert!(rows > SAMPLES / 4 && rows < SAMPLES, "{name}: {rows} rows");
        assert_eq!((&some[0][..], &some[1][..]), (&all[0][..rows], &all[1][..rows]), "{name}");
    }
}

#[test]
fn a_damaged_chunk_is_left_out_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = std::fs::read(fixture("plain.mcap")).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    let path = folder.path().join("flipped.mcap");
    std::fs::write(&path, bytes).unwrap();
    let log = open(&path).unwrap();
    let (columns, warnings) = read(&log, "/psm1/measured_js", &["position[insertion]"]);
    assert!(columns[0].len() < SAMPLES && columns[0].len() > SAMPLES / 2);
    assert!(warnings[0].starts_with("1 damaged chunk"), "{warnings:?}");
    let counted = format!(
        "{} messages of /psm1/measured_js were found, and the file's index counts 100",
        columns[0].len()
    );
    assert!(warnings.contains(&counted), "{warnings:?}");
}

/// Files truncated and modified at positions spread over the file: errors, warnings or fewer rows,
/// and never a panic.
#[test]
fn no_damage_panics() {
    const VARIANTS: u64 = 200;
    let folder = tempfile::tempdir().unwrap();
    let files = [
        "zstd.mcap",
        "lz4.mcap",
        "plain.mcap",
        "unchunked.mcap",
        "bare.mcap",
        "disordered.mcap",
        "json.mcap",
    ];
    let bases =
        ["sqlite/sqlite.db3", "old.db3", "compressed/compressed.db3", "big_endian/big_endian.db3"];
    for name in files.into_iter().chain(bases).chain(["mcap/mcap.mcap"]) {
        let bytes = std::fs::read(fixture(name)).unwrap();
        let mut seed = 0x9e37_79b9_7f4a_7c15_u64;
        let mut random = |below: usize| {
            seed ^= seed << 13;
            seed ^= seed >> 7;
            seed ^= seed << 17;
            (seed % below as u64) as usize
        };
        let extension = if name.ends_with("mcap") { "mcap" } else { "db3" };
        for variant in 0..VARIANTS {
            let mut damaged = bytes.clone();
            if variant % 2 == 0 {
                damaged.truncate(random(bytes.len()));
            } else {
                for _ in 0..1 + variant % 5 {
                    let at = random(bytes.len());
                    damaged[at] ^= 1 << random(8);
                }
            }
            let path = folder.path().join(format!("{variant}.{extension}"));
            std::fs::write(&path, damaged).unwrap();
            look_at_everything(&path);
            std::fs::remove_file(&path).unwrap();
        }
    }
}

fn look_at_everything(path: &Path) {
    let Ok(log) = open(path) else { return };
    for (place, table) in log.tables.iter().enumerate() {
        let numeric: Vec<usize> =
            (0..table.columns.len()).filter(|&k| table.columns[k].is_numeric).collect();
        if let Ok((columns, _)) = read_places(&log, place, &numeric) {
            assert!(columns.iter().all(|column| column.len() == columns[0].len()));
        }
    }
}

#[test]
fn what_is_no_log_is_refused_in_words() {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes, expected) in [
        ("a.mcap", &b"time_s,force_n\n"[..], "does not begin as an MCAP file does"),
        ("b.mcap", b"\x89MCAP0\r\n", "holds no whole message"),
        ("c.db3", b"time_s,force_n\n", "does not begin as a SQLite file does"),
        ("d.db3", b"SQLite format 3\0 and nothing more", "is no ROS 2 bag, or damaged"),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let error = open(&path).err().expect("no log").to_string();
        assert!(error.contains(expected) && error.contains(name), "{error}");
    }
    let error = open(folder.path().join("empty").as_path()).err().expect("nothing there");
    assert!(matches!(error, RecordingError::Open { .. }), "{error}");
    let error = rosbag::open(&{
        let empty = folder.path().join("folder");
        std::fs::create_dir(&empty).unwrap();
        empty
    });
    assert!(error.err().expect("no bag").to_string().contains("holds no bag"));
}

#[test]
fn ros_1_bags_without_an_index_are_read_as_far_as_they_go() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.bag");
    let lost = |bytes: &[u8], least: usize| {
        std::fs::write(&path, bytes).unwrap();
        let log = open(&path).unwrap();
        assert!(log.warnings[0].contains("no whole index"), "{:?}", log.warnings);
        let (columns, warnings) =
            read(&log, "/psm1/measured_js", &[HEADER_STAMP, "position[insertion]"]);
        assert_eq!(warnings, [""; 0]);
        assert!(columns[0].len() >= least, "{} rows", columns[0].len());
        for (k, row) in rows(&columns) {
            assert_near(row[0], since_first(k as i64 * 2_000_000), "cut");
            assert_near(row[1], position(k as i64 * 2_000_000), "cut");
        }
        columns[0].len()
    };
    for name in ["ros1_none.bag", "ros1_bz2.bag", "ros1_lz4.bag"] {
        let whole = std::fs::read(fixture(name)).unwrap();
        // Without the end of the index; then cut in the middle of a chunk.
        assert_eq!(lost(&whole[..whole.len() - 9], SAMPLES), SAMPLES, "{name}");
        assert!(lost(&whole[..whole.len() / 2], 20) < SAMPLES, "{name}");
    }
    // A recorder that was killed has written neither the place of the index nor the length of its
    // last chunk, here its first.
    let mut active = std::fs::read(fixture("ros1_none.bag")).unwrap();
    let chunk = active.windows(16).position(|bytes| bytes == b"compression=none").unwrap();
    let end = active[chunk..].windows(5).position(|bytes| bytes == b"size=").unwrap() + chunk + 9;
    let head = active[..end].windows(4).rposition(|bytes| bytes == b"op=\x05").unwrap();
    let data = end.max(head + 4);
    let index = active.windows(10).position(|bytes| bytes == b"index_pos=").unwrap() + 10;
    active[index..index + 8].fill(0);
    active[end - 4..end].fill(0);
    active[data..data + 4].fill(0);
    lost(&active, SAMPLES);
}

#[test]
fn a_ros_1_bag_of_another_version_says_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("old.bag");
    std::fs::write(&path, b"#ROSBAG V1.2\n and more bytes").unwrap();
    let error = open(&path).err().unwrap().to_string();
    assert!(error.contains("begins with '#ROSBAG V1.2', expected '#ROSBAG V2.0'"), "{error}");
    assert!(
        error.contains("hint: bring a bag of an older version up to date with rosbag fix"),
        "{error}"
    );
}
