//! Data sets as data engines write them: one recording in one file, in several files, or in its own
//! folders; the resulting row is always the same.
//!
//! The files of third-party libraries are those of `partitioned/make.py`.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use tempfile::TempDir;
use trocar::cancel::Cancel;
use trocar::fleet::{
    self, Collector, Config, Dataset, Fleet, FleetError, Input, identify_one, identify_source,
};
use trocar::recording::{Choice, ReadOptions};
use trocar::table::{self, Column, Field, Kind, Table, TableWriter};

/// Columns that describe the storage of a recording and may differ.
const OF_STORAGE: [&str; 2] = ["path", "recording"];

/// A memory limit of one byte: every recording is a row with its name, and none is identified.
fn names_alone() -> Config {
    Config {
        reading: ReadOptions { memory_limit: Some(1), ..ReadOptions::default() },
        ..Config::default()
    }
}

/// Coulomb forces of `partitioned/make.py`, N, and the accuracy of the paper's two steps at 100 Hz.
const TRUTH: [f64; 3] = [2.0, 2.5, 3.0];
const NEAR: f64 = 0.2;

fn fixture(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/partitioned").join(name)
}

fn fleet_of(dataset: &Path, config: &Config) -> (Fleet, Table) {
    let place = TempDir::new().unwrap();
    let path = place.path().join("t.parquet");
    let dataset = Dataset::open(dataset, None, &[]).unwrap();
    let fleet = fleet::run(&dataset, config, &path, 2, &Cancel::default(), &mut |_| ()).unwrap();
    (fleet, table::read(&path).unwrap())
}

fn texts(table: &Table, name: &str) -> Vec<String> {
    let Some(Column::Text(cells)) = table.column(name) else { panic!("no text column {name}") };
    cells.iter().map(|cell| cell.as_deref().unwrap_or("").to_owned()).collect()
}

fn numbers(table: &Table, name: &str) -> Vec<f64> {
    match table.column(name) {
        Some(Column::Number(cells)) => cells.clone(),
        Some(Column::Integer(cells)) => {
            cells.iter().map(|cell| cell.map_or(f64::NAN, |cell| cell as f64)).collect()
        }
        other => panic!("{name}: {other:?}"),
    }
}

/// Contents of the rows in order, without their storage; `also` names further columns that may
/// differ.
fn said(table: &Table, also: &[&str]) -> BTreeMap<String, String> {
    let named = table.fields.iter().zip(&table.columns);
    let kept = named
        .filter(|(name, _)| !OF_STORAGE.contains(&name.as_str()) && !also.contains(&name.as_str()));
    kept.map(|(name, column)| (name.clone(), format!("{column:?}"))).collect()
}

/// The rows of `one/part-0.parquet`.
fn rows() -> Table {
    table::read(fixture("one/part-0.parquet")).unwrap()
}

/// Some rows of a table, as a file.
fn write(path: &Path, from: &Table, range: std::ops::Range<usize>, names: &[&str]) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    let fields: Vec<Field> =
        names.iter().map(|n| Field::new(*n, from.column(n).unwrap().kind())).collect();
    let cut = |name: &&str| match from.column(name).unwrap() {
        Column::Number(cells) => Column::Number(cells[range.clone()].to_vec()),
        Column::Integer(cells) => Column::Integer(cells[range.clone()].to_vec()),
        Column::Boolean(cells) => Column::Boolean(cells[range.clone()].to_vec()),
        Column::Text(cells) => Column::Text(cells[range.clone()].to_vec()),
    };
    let mut writer = TableWriter::create(path, &fields).unwrap();
    writer.write(&names.iter().map(cut).collect::<Vec<_>>()).unwrap();
    writer.commit().unwrap();
}

const ALL: [&str; 5] = ["recording", "lubricant", "time_s", "position_m", "force_n"];

/// Five files that divide recordings, named `part-0` to `part-4` in the order of `order`.
fn shards(
    folder: &Path,
    table: &Table,
    order: [usize; 5],
    names: impl Fn(usize) -> Vec<&'static str>,
) {
    let size = table.rows().div_ceil(5);
    for (k, file) in order.into_iter().enumerate() {
        let range = k * size..((k + 1) * size).min(table.rows());
        write(&folder.join(format!("part-{file}.parquet")), table, range, &names(k));
    }
}

/// One file, files that divide recordings, and folders of several files, by pyarrow and polars: the
/// same rows.
#[test]
fn every_layout_gives_the_same_rows() {
    let (_, one) = fleet_of(&fixture("one"), &Config::default());
    assert_eq!(
        texts(&one, "path"),
        ["part-0.parquet#16", "part-0.parquet#17", "part-0.parquet#18"]
    );
    let near =
        |found: &[f64]| found.iter().zip(TRUTH).all(|(found, truth)| (found - truth).abs() < NEAR);
    assert!(near(&numbers(&one, "coulomb_force_n")), "{:?}", numbers(&one, "coulomb_force_n"));
    assert_eq!(numbers(&one, "dataset_recording"), [16.0, 17.0, 18.0]);
    assert_eq!(texts(&one, "lubricant"), ["dry", "gel", "dry"]);
    let folders = ["recording=16", "recording=17", "recording=18"];
    let begins = ["part-0.parquet#16", "part-1.parquet#17", "part-2.parquet#18"];
    for (layout, names) in
        [("blocks", begins), ("hive", folders), ("polars", folders), ("moments", begins)]
    {
        let (fleet, table) = fleet_of(&fixture(layout), &Config::default());
        assert_eq!(texts(&table, "path"), names, "{layout}");
        // This includes the hash, which is that of the columns.
        assert_eq!(said(&table, &[]), said(&one, &[]), "{layout}");
        assert_eq!(
            (fleet.tally.total, fleet.tally.done, fleet.tally.failed),
            (3, 3, 0),
            "{layout}"
        );
    }
}

/// A unit of work is a file with the recordings that begin in it, and the files that continue them.
#[test]
fn a_recording_belongs_to_the_first_file_with_rows_of_it() {
    let dataset = Dataset::open(&fixture("blocks"), None, &[]).unwrap();
    let units = dataset.sources.iter().map(|source| {
        let parts: Vec<&str> = source.parts.iter().map(|part| part.name.as_str()).collect();
        (source.name.as_str(), parts, source.elsewhere.clone())
    });
    let [p0, p1, p2, p3, p4] =
        ["part-0.parquet", "part-1.parquet", "part-2.parquet", "part-3.parquet", "part-4.parquet"];
    let expected = vec![
        (p0, vec![p0, p1], vec![]),
        (p1, vec![p1, p2], vec!["16".to_owned()]),
        (p2, vec![p2, p3, p4], vec!["17".to_owned()]),
    ];
    assert_eq!(units.collect::<Vec<_>>(), expected);
    let alone = Dataset::open(&fixture("one"), None, &[]).unwrap();
    assert!(
        alone.sources.iter().all(|source| source.parts.is_empty() && source.elsewhere.is_empty())
    );
}

/// Files are sorted by their times and columns are identified by their names, whatever the order of
/// either.
#[test]
fn neither_names_of_files_nor_places_of_columns_matter() {
    let place = TempDir::new().unwrap();
    let (_, one) = fleet_of(&fixture("one"), &Config::default());
    let turned = |k: usize| {
        let mut names = ALL.to_vec();
        names.rotate_left(k);
        names
    };
    shards(&place.path().join("a"), &rows(), [4, 3, 1, 2, 0], turned);
    let (_, table) = fleet_of(&place.path().join("a"), &Config::default());
    // The first file by name is the last in time.
    assert_eq!(
        texts(&table, "path"),
        ["part-0.parquet#18", "part-1.parquet#17", "part-3.parquet#16"]
    );
    assert_eq!(numbers(&table, "dataset_recording"), [18.0, 17.0, 16.0]);
    let turned_back: Vec<f64> = numbers(&table, "coulomb_force_n").into_iter().rev().collect();
    assert_eq!(turned_back, numbers(&one, "coulomb_force_n"));
    let mut hashes = texts(&table, "sha256");
    hashes.reverse();
    assert_eq!(hashes, texts(&one, "sha256"));
    // Without a metadata column in one file: that column is empty for the recordings with rows in
    // this file.
    shards(&place.path().join("b"), &rows(), [0, 1, 2, 3, 4], |k| match k {
        4 => vec!["force_n", "position_m", "time_s", "recording"],
        _ => ALL.to_vec(),
    });
    let (_, table) = fleet_of(&place.path().join("b"), &Config::default());
    assert_eq!(texts(&table, "lubricant"), ["dry", "gel", ""]);
    assert_eq!(said(&table, &["lubricant"]), said(&one, &["lubricant"]));
}

/// A damaged file is a row of its own, or fails the recording of its folder; text in a number
/// column is reported.
#[test]
fn faults_are_rows() {
    let place = TempDir::new().unwrap();
    let copy = |from: &str, to: &str| {
        let to = place.path().join(to);
        fs::create_dir_all(to.parent().unwrap()).unwrap();
        fs::copy(fixture(from), &to).unwrap();
        to
    };
    let cut = |path: &Path| fs::write(path, &fs::read(path).unwrap()[..2000]).unwrap();
    (0..5).for_each(|k| {
        drop(copy(&format!("blocks/part-{k}.parquet"), &format!("a/part-{k}.parquet")))
    });
    cut(&place.path().join("a/part-4.parquet"));
    let (fleet, table) = fleet_of(&place.path().join("a"), &Config::default());
    assert_eq!(texts(&table, "path")[3], "part-4.parquet");
    assert_eq!(texts(&table, "reason_kind"), ["", "", "", "cannot_read"]);
    assert_eq!(fleet.tally.failed, 1);
    for recording in [16, 17] {
        for part in 0..3 {
            let name = format!("recording={recording}/part-{part}.parquet");
            copy(&format!("hive/{name}"), &format!("b/{name}"));
        }
    }
    cut(&place.path().join("b/recording=16/part-1.parquet"));
    let (_, table) = fleet_of(&place.path().join("b"), &Config::default());
    assert_eq!(texts(&table, "path"), ["recording=16", "recording=17"]);
    assert_eq!(texts(&table, "reason_kind"), ["cannot_read", ""]);
    assert!(
        texts(&table, "reason")[0].starts_with("recording=16/part-1.parquet: "),
        "{:?}",
        texts(&table, "reason")
    );
    // Forces as text in the file shared by recordings 16 and 17.
    let mut words = rows();
    let force = words.fields.iter().position(|name| name == "force_n").unwrap();
    words.columns[force] = Column::Text(vec![Some("3 N".into()); words.rows()]);
    shards(&place.path().join("c"), &rows(), [0, 1, 2, 3, 4], |_| ALL.to_vec());
    let size = words.rows().div_ceil(5);
    write(&place.path().join("c/part-1.parquet"), &words, size..2 * size, &ALL);
    let (_, table) = fleet_of(&place.path().join("c"), &Config::default());
    assert_eq!(texts(&table, "reason_kind"), ["cannot_read", "cannot_read", ""]);
    let reason = &texts(&table, "reason")[0];
    assert!(
        reason.contains("'force_n' holds numbers in part-0.parquet and text in part-1.parquet"),
        "{reason}"
    );
}

/// Subfolders of a recording may differ: their keys are then not metadata of it. A parallel folder
/// is another recording.
#[test]
fn recordings_that_cross_folders() {
    let place = TempDir::new().unwrap();
    let all = rows();
    // Midnight; `%3A` is a colon.
    for (day, range) in [("day=mon%3A1", 0..700), ("day=tue", 700..1029)] {
        write(
            &place.path().join("a/recording=1").join(day).join("part.parquet"),
            &all,
            range,
            &ALL[2..],
        );
    }
    let (_, table) = fleet_of(&place.path().join("a"), &Config::default());
    assert_eq!(texts(&table, "path"), ["recording=1"]);
    assert!(table.column("day").is_none_or(|_| texts(&table, "day") == [""]));
    let (_, one) = fleet_of(&fixture("one"), &Config::default());
    assert_eq!(texts(&table, "sha256")[0], texts(&one, "sha256")[0]);
    // The recordings of both sites are numbered from 1.
    for site in ["a", "b"] {
        write(&place.path().join(format!("b/site={site}/part.parquet")), &all, 0..1029, &ALL);
    }
    let (fleet, table) = fleet_of(&place.path().join("b"), &Config::default());
    assert_eq!(
        (texts(&table, "site"), fleet.tally.failed),
        (vec!["a".to_owned(), "b".to_owned()], 0)
    );
    assert_eq!(
        texts(&table, "sha256"),
        [texts(&one, "sha256")[0].clone(), texts(&one, "sha256")[0].clone()]
    );
    // Twice in one place: two recordings of the same name are detected.
    for part in 0..2 {
        write(&place.path().join(format!("d/part-{part}.parquet")), &all, 0..1029, &ALL);
    }
    let (_, table) = fleet_of(&place.path().join("d"), &Config::default());
    let reason = &texts(&table, "reason")[0];
    assert!(
        reason.contains("rows in part-1.parquet begin at 0 s, before those in part-0.parquet end"),
        "{reason}"
    );
    // A key above that of the recording is part of its name.
    for site in ["a", "b"] {
        for (part, range) in [(0, 0..500), (1, 500..1029)] {
            let path = format!("c/site={site}/recording=1/part-{part}.parquet");
            write(&place.path().join(path), &all, range, &ALL[2..]);
        }
    }
    let (fleet, table) = fleet_of(&place.path().join("c"), &Config::default());
    assert_eq!(texts(&table, "path"), ["site=a/recording=1", "site=b/recording=1"]);
    assert_eq!(
        (texts(&table, "site"), fleet.tally.failed),
        (vec!["a".to_owned(), "b".to_owned()], 0)
    );
    assert_eq!(texts(&table, "sha256")[0], texts(&one, "sha256")[0]);
}

/// Rows without a recording do not belong to those of another file; a single file in its folder
/// keeps its name.
#[test]
fn what_has_no_name_is_not_joined() {
    let place = TempDir::new().unwrap();
    let mut all = rows();
    let Column::Integer(cells) = &mut all.columns[0] else { panic!("numbers of recordings") };
    cells[..1500].fill(None);
    write(&place.path().join("a/x.parquet"), &all, 0..1029, &ALL);
    write(&place.path().join("a/y.parquet"), &all, 1029..1500, &ALL);
    write(&place.path().join("a/recording=7/z.parquet"), &all, 0..1029, &ALL[2..]);
    let (_, table) = fleet_of(&place.path().join("a"), &names_alone());
    assert_eq!(texts(&table, "path"), ["recording=7/z.parquet", "x.parquet#", "y.parquet#"]);
}

/// Columns, crop and sign act as for a recording in its own file.
#[test]
fn options_mean_what_they_mean_for_files() {
    let place = TempDir::new().unwrap();
    let first = place.path().join("first.parquet");
    write(&first, &rows(), 0..1029, &ALL[2..]);
    let by_name = "time_s=time_s,position_m=position_m,force_n=-force_n";
    for choice in [
        Choice { from: Some(2.0), to: Some(9.0), ..Choice::default() },
        Choice { columns: Some(by_name.to_owned()), flip_force: true, ..Choice::default() },
        Choice { flip_force: true, ..Choice::default() },
    ] {
        let config = Config {
            reading: ReadOptions { choice, ..ReadOptions::default() },
            ..Config::default()
        };
        let alone = identify_one(&Input::File(first.clone()), &config);
        let layouts = if config.reading.choice.from.is_some() {
            &["blocks", "hive"][..]
        } else {
            &["blocks"]
        };
        for layout in layouts.iter().copied() {
            let (_, table) = fleet_of(&fixture(layout), &config);
            for name in
                ["samples", "coulomb_force_n", "half_width_m", "residual_rms_n", "duration_s"]
            {
                let expected = alone.number(name).unwrap_or(f64::NAN);
                let found = numbers(&table, name)[0];
                assert_eq!(
                    found.to_bits(),
                    expected.to_bits(),
                    "{layout}, {name}, {:?}",
                    config.reading.choice
                );
            }
            assert_eq!(
                texts(&table, "reason_kind")[0],
                alone.text("reason_kind").unwrap_or_default()
            );
        }
    }
    // A table of rows has no topics, and neither has a file with one recording.
    let choice = Choice { topics: vec!["/force".to_owned()], ..Choice::default() };
    let config =
        Config { reading: ReadOptions { choice, ..ReadOptions::default() }, ..Config::default() };
    let (_, table) = fleet_of(&fixture("blocks"), &config);
    assert!(
        texts(&table, "reason").iter().all(|reason| reason.contains("one table without a name"))
    );
    // In order, without the column that distinguishes recordings.
    let columns = Some("-,time_s,position_m,force_n".to_owned());
    let choice = Choice { columns, ..Choice::default() };
    let config =
        Config { reading: ReadOptions { choice, ..ReadOptions::default() }, ..Config::default() };
    let (_, one) = fleet_of(&fixture("one"), &Config::default());
    for layout in ["one", "blocks"] {
        let (_, table) = fleet_of(&fixture(layout), &config);
        assert_eq!(
            numbers(&table, "coulomb_force_n"),
            numbers(&one, "coulomb_force_n"),
            "{layout}"
        );
    }
}

/// A long recording, here one at rest, is reduced to the same excerpts as in its own file, and the
/// memory limit applies to the data in memory.
#[test]
fn long_recordings_are_thinned_and_bounded() {
    const ROWS: usize = 150_000;
    let place = TempDir::new().unwrap();
    let column = |value: &dyn Fn(usize) -> f64| Column::Number((0..ROWS).map(value).collect());
    let all = Table {
        fields: ALL[2..].iter().chain(&["recording"]).map(|name| (*name).to_owned()).collect(),
        columns: vec![
            column(&|k| k as f64 * 1e-3),
            column(&|k| (k % 2) as f64 * 1e-6),
            // All pieces differ.
            column(&|k| (k as f64 * 1e-4).sin()),
            Column::Text(vec![Some("long".into()); ROWS]),
        ],
    };
    let alone = place.path().join("alone.parquet");
    write(&alone, &all, 0..all.rows(), &ALL[2..]);
    let names = ["time_s", "position_m", "force_n", "recording"];
    shards(&place.path().join("set"), &all, [0, 1, 2, 3, 4], |_| names.to_vec());
    let reading = ReadOptions { most_samples: Some(1), ..ReadOptions::default() };
    let config = Config { reading, ..Config::default() };
    let alone = identify_one(&Input::File(alone), &config);
    let (_, table) = fleet_of(&place.path().join("set"), &config);
    assert!(alone.number("samples").unwrap() < ROWS as f64, "{alone:?}");
    for name in ["samples", "force_rms_n", "duration_s", "force_noise_n"] {
        assert_eq!(numbers(&table, name)[0], alone.number(name).unwrap(), "{name}");
    }
    // 1 MB for columns of 3.6 MB, or of 3.1 MB after decimation.
    for most_samples in [None, Some(1)] {
        let reading =
            ReadOptions { most_samples, memory_limit: Some(6_000_000), ..ReadOptions::default() };
        let (_, table) =
            fleet_of(&place.path().join("set"), &Config { reading, ..Config::default() });
        assert_eq!(texts(&table, "reason_kind"), ["too_large_for_memory"]);
    }
    let reading = ReadOptions { memory_limit: Some(6_000_000), ..ReadOptions::default() };
    let (fleet, _) = fleet_of(&fixture("blocks"), &Config { reading, ..Config::default() });
    assert_eq!(fleet.tally.failed, 0);
}

/// Runs that are cancelled after each recording until none remains; returns their number, and how
/// many rows the last run reused.
fn stopped_again_and_again(dataset: &Dataset, table: &Path) -> (usize, usize) {
    let mut stopped = 0;
    loop {
        let cancel = Cancel::default();
        let outcome = fleet::run(dataset, &Config::default(), table, 1, &cancel, &mut |tally| {
            if tally.done > tally.reused {
                cancel.cancel();
            }
        });
        match outcome {
            Ok(fleet) => return (stopped, fleet.tally.reused),
            Err(FleetError::Stopped(_)) => stopped += 1,
            Err(other) => panic!("{other}"),
        }
    }
}

/// Cancelled after each recording and continued elsewhere: the same bytes, and no recording is
/// processed twice.
#[test]
fn interrupted_and_elsewhere_the_table_is_the_same() {
    let place = TempDir::new().unwrap();
    for layout in ["blocks", "hive"] {
        let dataset = Dataset::open(&fixture(layout), None, &[]).unwrap();
        let path = |name: &str| place.path().join(format!("{layout}-{name}.parquet"));
        let config = Config::default();
        fleet::run(&dataset, &config, &path("whole"), 1, &Cancel::default(), &mut |_| ()).unwrap();
        let whole = fs::read(path("whole")).unwrap();
        if layout == "blocks" {
            let (times, reused) = stopped_again_and_again(&dataset, &path("again"));
            assert!(times > 0 && reused > 0, "stopped {times} times, {reused} reused");
            assert_eq!(fs::read(path("again")).unwrap(), whole);
        }
        // Elsewhere, with the results of the first of two.
        let first = Collector::open(dataset.clone(), &config, &path("elsewhere")).unwrap();
        let orders = first.orders().unwrap();
        let mut first = first;
        first.add(1, &identify_source(&orders[1], &config).unwrap()).unwrap();
        drop(first);
        let mut second = Collector::open(dataset.clone(), &config, &path("elsewhere")).unwrap();
        for (k, order) in second.orders().unwrap().iter().enumerate().rev() {
            let tally = second.add(k, &identify_source(order, &config).unwrap()).unwrap();
            assert_eq!(tally.reused, usize::from(k <= 1), "{layout}, {k}");
        }
        second.write().unwrap();
        assert_eq!(fs::read(path("elsewhere")).unwrap(), whole, "{layout}");
    }
}

/// Any type of column may distinguish recordings.
#[test]
fn numbers_and_words_tell_recordings_apart() {
    let place = TempDir::new().unwrap();
    let kinds = [Kind::Number, Kind::Text, Kind::Integer];
    for (k, kind) in kinds.into_iter().enumerate() {
        let mut all = rows();
        let Column::Integer(cells) = &all.columns[0] else { panic!("numbers of recordings") };
        let values: Vec<i64> = cells.iter().flatten().copied().collect();
        all.columns[0] = match kind {
            Kind::Number => {
                Column::Number(values.iter().map(|value| *value as f64 + 0.5).collect())
            }
            Kind::Text => Column::Text(
                values.iter().map(|value| Some(format!("trial {value}").into())).collect(),
            ),
            _ => Column::Integer(values.into_iter().map(Some).collect()),
        };
        shards(&place.path().join(k.to_string()), &all, [0, 1, 2, 3, 4], |_| ALL.to_vec());
    }
    let names =
        |k: usize| texts(&fleet_of(&place.path().join(k.to_string()), &names_alone()).1, "path");
    assert_eq!(names(0), ["part-0.parquet#16.5", "part-1.parquet#17.5", "part-3.parquet#18.5"]);
    assert_eq!(
        names(1),
        ["part-0.parquet#trial 16", "part-1.parquet#trial 17", "part-3.parquet#trial 18"]
    );
    assert_eq!(names(2), ["part-0.parquet#16", "part-1.parquet#17", "part-3.parquet#18"]);
}
