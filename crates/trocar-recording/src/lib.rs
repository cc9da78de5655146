//! Recordings of an instrument moving through a seal: time, position and force, read from files of
//! many formats and written to CSV.
//!
//! The only crate that knows file columns and units. Everything after it is in SI: s, m, m/s, N;
//! velocity and force are positive on insertion. Missing data are reported in [`Quality`], never
//! repaired on reading. `docs/reference/formats.md` and `docs/reference/robot-logs.md` are the pages for users.

use std::path::Path;

use collect::Collector;
use rows::Rows;
pub use rows::digest_of;

pub use choice::{Choice, TableColumn, TableColumns};
pub use container::{Column, Table};
pub use error::{Location, RecordingError};
pub use motion::{local_acceleration, local_velocity, velocity_window};
pub use pieces::Pieces;
pub use plausible::{HEAVIEST_UNMODELLED_MASS, LONGEST_STROKE};
pub use quality::{Gap, Quality, Reset, RowList, Saturation, Warning, WarningKind};
pub use recording::{ReadOptions, Recording, check_sensor_limit, force_range};
pub use samples::Readings;
pub use screen::OPPOSED;
pub use smoothing::COARSE;
pub use statistics::{median, range};
pub use tables::{read_columns, tables};
pub use text::sha256;
pub use units::Quantity;

pub mod block;
pub mod cancel;
mod choice;
mod collect;
pub mod columns;
pub mod container;
mod crtk;
mod error;
pub mod formats;
mod header;
mod join;
pub mod loads;
mod log;
mod motion;
mod pieces;
mod plausible;
mod position;
mod quality;
mod recording;
pub mod registry;
pub mod rows;
mod samples;
mod screen;
mod smoothing;
mod statistics;
mod tables;
mod text;
mod units;

/// Reads a recording from a file; `-` reads text from standard input.
///
/// # Errors
/// [`RecordingError`], naming file and line, when a cell is not a number, a row has the wrong
/// number of cells, a column or its unit is missing or ambiguous, time is constant or decreases by
/// more than an interval, the stroke is longer than that of any instrument, or fewer than
/// 8 samples remain. Less severe findings are recorded in [`Recording::quality`].
pub fn read(path: &Path, options: &ReadOptions) -> Result<Recording, RecordingError> {
    read_in_words(path, options).map(|(recording, _)| recording)
}

/// The same, with the columns used, in the syntax of `--columns`.
///
/// # Errors
/// As for [`read`].
pub fn read_in_words(
    path: &Path,
    options: &ReadOptions,
) -> Result<(Recording, Vec<String>), RecordingError> {
    check_sensor_limit(options.sensor_limit)?;
    let file = path.display().to_string();
    let mut reader = Rows::open(path, &options.choice, &Quantity::NEEDED, true)?;
    let rows = reader.expected().unwrap_or(0);
    let kept = options.most_samples.map_or(rows, |most| rows.min(most as u64));
    let layout = reader.layout();
    let columns = Quantity::ALL.into_iter().filter(|own| layout.has(*own)).count() as u64;
    check_memory(&file, kept, columns, options.memory_limit)?;
    let kept = kept.min(rows::justified(path) / columns);
    // The estimate avoids copies of a growing column; a few percent allow for lines that become
    // shorter.
    let capacity = (kept + kept / 32) as usize;
    let mut collector = Collector::new(capacity, |own| layout.has(own), options.most_samples);
    collector = collector.counting(reader.count());
    while let Some(block) = reader.next_block()? {
        collector.take(block);
    }
    let name = path.file_name().map_or(file.clone(), |name| name.to_string_lossy().into_owned());
    let sha256 = reader.digest()?;
    let collected = collector
        .finish(&file, options.sensor_limit)
        .map_err(|error| options.choice.of_the_part(error))
        .map_err(|error| plausible::ask_stroke(&options.choice, reader.layout(), error))?;
    plausible::ask(&file, &options.choice, reader.layout(), &collected, true)?;
    let mut recording = Recording::of(name, sha256, collected);
    recording.choice = options.choice.clone();
    recording.quality.notes.extend(reader.notes());
    // The file's own names make an option that can be pasted.
    let given = options.choice.columns.as_deref();
    let flip = if options.choice.flip_force {
        "leave out ‹flip_force=True›"
    } else {
        "use ‹flip_force=True›"
    };
    let opposed = recording
        .quality
        .warnings
        .iter_mut()
        .find(|warning| warning.kind == WarningKind::ForceSign);
    if let Some((warning, turned)) = opposed.zip(reader.layout().reversed_position(given)) {
        warning.hint = Some(format!(
            "{flip} if the sensor is mounted the other way round, or use ‹columns='{turned}'› if the encoder counts the other way round"
        ));
    }
    for message in reader.warnings() {
        recording.quality.warnings.push(Warning::new(WarningKind::Source, message));
    }
    // Columns without names are identified by their order.
    let words = match options.choice.in_order() {
        Some(mapping) => vec![mapping.to_owned()],
        None => reader.layout().words(),
    };
    Ok((recording, words))
}

/// [`Quality::position_resolution`] from only the first rows of a file, in constant memory; 0 if
/// none was found.
///
/// A force column is not needed.
///
/// # Errors
/// [`RecordingError`] when the file cannot be opened, its columns are ambiguous or one of those
/// rows is not a row of numbers.
pub fn position_resolution(path: &Path, choice: &Choice) -> Result<f64, RecordingError> {
    let mut reader = Rows::open(path, choice, &[Quantity::Time, Quantity::Position], false)?;
    let mut positions = Vec::new();
    while positions.len() < screen::LOOKED_AT {
        let Some(row) = reader.next_row()? else { break };
        positions.extend(Some(row.get(Quantity::Position)).filter(|position| position.is_finite()));
    }
    Ok(screen::resolution(&positions))
}

/// Rejects data that would not fit into the memory.
///
/// # Errors
/// [`RecordingError::TooLarge`].
fn check_memory(
    file: &str,
    rows: u64,
    columns: u64,
    limit: Option<u64>,
) -> Result<(), RecordingError> {
    const MB: u64 = 1_000_000;
    let needed = rows.saturating_mul(columns * size_of::<f64>() as u64);
    match limit {
        Some(limit) if needed > limit => Err(RecordingError::TooLarge {
            file: file.to_owned(),
            rows,
            needed_mb: needed.div_ceil(MB),
            limit_mb: limit / MB,
        }),
        _ => Ok(()),
    }
}
