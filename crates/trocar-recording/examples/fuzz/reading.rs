//! All ways to read a file, with the time and memory they take.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Mutex;
use std::time::Duration;

use cpu_time::ProcessTime;

use trocar_recording::{
    Choice, Pieces, ReadOptions, Recording, RecordingError, Table, digest_of, position_resolution,
    read, read_columns, tables,
};

use crate::MEMORY;
use crate::mutate::Random;

/// How reading an input went.
pub(crate) struct Finding {
    /// Message and place of a panic.
    pub(crate) panic: Option<String>,
    pub(crate) time: Duration,
    /// Most memory held at a time, in bytes.
    pub(crate) memory: usize,
    /// Whether it gave a recording.
    pub(crate) is_read: bool,
}

/// The last panic. One inside another library is turned into an error, and is none of the findings.
static PANIC: Mutex<String> = Mutex::new(String::new());

/// Keeps the message of a panic instead of printing it.
pub(crate) fn silence_panics() {
    std::panic::set_hook(Box::new(|panic| {
        if let Ok(mut last) = PANIC.lock() {
            *last = panic.to_string();
        }
    }));
}

/// Reads the file or folder at `path` in all ways, with choices drawn from `random`.
pub(crate) fn examine(path: &Path, random: &mut Random) -> Finding {
    MEMORY.reset_peak_usage();
    let before = MEMORY.current_usage();
    let start = ProcessTime::now();
    let outcome = catch_unwind(AssertUnwindSafe(|| all_ways(path, random)));
    Finding {
        time: start.elapsed(),
        memory: MEMORY.peak_usage().saturating_sub(before),
        is_read: matches!(outcome, Ok(true)),
        panic: outcome
            .is_err()
            .then(|| PANIC.lock().map_or_else(|_| "unknown".to_owned(), |last| last.clone())),
    }
}

/// Whether the file gives a recording by default.
fn all_ways(path: &Path, random: &mut Random) -> bool {
    let tables = tables(path).unwrap_or_default();
    for table in tables.iter().take(8) {
        let names = table
            .columns
            .iter()
            .filter(|column| column.is_numeric)
            .map(|column| column.name.as_str());
        _ = read_columns(path, &table.name, &names.collect::<Vec<_>>());
    }
    _ = digest_of(path);
    let recording = read(path, &ReadOptions::default());
    let is_read = recording.is_ok();
    if let Ok(recording) = recording {
        corrected(recording, random);
    }
    let options = options(&tables, random);
    _ = read(path, &options);
    _ = position_resolution(path, &options.choice);
    _ = pieces(path, &options, 8 + random.below(200));
    is_read
}

/// What is done to a recording before it is used.
fn corrected(recording: Recording, random: &mut Random) {
    let recording = recording.without_glitches();
    _ = recording.with_position_delay(1e-3 * random.below(50) as f64);
    _ = recording.part(0..random.below(recording.len() + 1), "a part");
    _ = recording.without_moving_mass(0.1, 9.81);
}

fn options(tables: &[Table], random: &mut Random) -> ReadOptions {
    let odd = |random: &mut Random| {
        let value = [0.0, 0.5, -1.0, 1e300, f64::NAN, f64::INFINITY][random.below(6)];
        (random.below(3) == 0).then_some(value)
    };
    ReadOptions {
        choice: Choice {
            columns: columns(tables, random),
            topics: tables
                .get(random.below(4))
                .map(|table| table.name.clone())
                .into_iter()
                .collect(),
            from: odd(random),
            to: odd(random),
            flip_force: random.below(2) == 0,
            skip_rows: [0, 0, 0, 1, 5, u64::MAX][random.below(6)],
            rate_hz: odd(random),
            from_another_file: random.below(4) == 0,
        },
        sensor_limit: odd(random),
        most_samples: [None, Some(0), Some(8), Some(100)][random.below(4)],
        memory_limit: [None, Some(0), Some(10_000)][random.below(3)],
    }
}

/// Columns in order, by name, or none.
fn columns(tables: &[Table], random: &mut Random) -> Option<String> {
    let by_name = |tables: &[Table], random: &mut Random| {
        let table = tables.get(random.below(tables.len().max(1)))?;
        let mut name = || {
            table
                .columns
                .get(random.below(table.columns.len().max(1)))
                .map(|column| column.name.as_str())
        };
        Some(format!("time_s={},position_mm={},force_n=-{}", name()?, name()?, name()?))
    };
    match random.below(4) {
        0 => by_name(tables, random),
        1 => Some("time_s,position_mm,force_n".to_owned()),
        2 => Some("-,time_ms,position_m,velocity_mm_s,force_mn".to_owned()),
        _ => None,
    }
}

fn pieces(path: &Path, options: &ReadOptions, samples: usize) -> Result<(), RecordingError> {
    let mut pieces = Pieces::open(path, options, samples)?;
    while pieces.next_piece()?.is_some() {}
    Ok(())
}
