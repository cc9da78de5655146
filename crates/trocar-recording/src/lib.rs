//! Recordings of an instrument moving through a seal: time, position and force, read from files of
//! many formats and written to CSV.
//!
//! The only crate that knows file columns and units. Everything after it is in SI: s, m, m/s, N;
//! velocity and force are positive on insertion. Missing data are reported in [`Quality`], never
//! repaired on reading. `docs/reference/formats.md` and `docs/reference/robot-logs.md` are the pages for users.

use std::io::Write;
use std::ops::Range;
use std::path::Path;

use sha2::{Digest, Sha256};

use block::SampleRow;
use collect::Collector;
use columns::Quantity;
use rows::Rows;
pub use rows::digest_of;
use screen::Count;
use trocar_tables::line::Line;

pub use choice::Choice;
pub use columns::{TableColumn, TableColumns};
pub use container::{Column, Table};
pub use error::{Location, RecordingError};
pub use motion::{local_acceleration, local_velocity};
pub use pieces::Pieces;
pub use plausible::{HEAVIEST_UNMODELLED_MASS, LONGEST_STROKE};
pub use quality::{Gap, Quality, Reset, RowList, Saturation, Warning, WarningKind};
pub use screen::{OPPOSED, median, range};
pub use tables::{read_columns, tables};

pub mod block;
mod choice;
mod collect;
pub mod columns;
pub mod container;
mod crtk;
mod decompress;
mod error;
mod format;
pub mod formats;
mod header;
mod join;
mod log;
mod motion;
mod pieces;
mod plausible;
mod position;
mod quality;
pub mod registry;
pub mod rows;
mod screen;
mod tables;
mod text;
mod timestamp;
mod units;
mod utf16;

/// Fewest samples of a recording.
pub const MIN_SAMPLES: usize = 8;

/// Moving mass, kg, above which its unit is doubtful.
const PLAUSIBLE_MASS: f64 = 5.0;

/// Range of a force, as a fraction of its largest value, that is rounding.
const CONSTANT_FORCE: f64 = 1e-9;

/// One recording in SI units; all columns have the same length and time is strictly increasing.
#[derive(Debug, Clone)]
pub struct Recording {
    /// File name without its folder.
    pub name: String,
    /// SHA-256 of the file's bytes (of its text in UTF-8 if it is compressed by gzip or zstd, or in
    /// UTF-16), or of the columns when there is no file; lower-case hexadecimal.
    pub sha256: String,
    /// Time in s.
    pub time: Vec<f64>,
    /// Position in m, increasing on insertion.
    pub position: Vec<f64>,
    /// Force in N, of the device on the seal.
    pub force: Vec<f64>,
    /// Velocity in m/s, if the file has it.
    pub velocity: Option<Vec<f64>>,
    /// Quality of the data.
    pub quality: Quality,
    /// How it was read from its file.
    pub choice: Choice,
}

/// Columns that do not come from a file, in SI units.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Readings {
    /// Time in s.
    pub time: Vec<f64>,
    /// Position in m, increasing on insertion.
    pub position: Vec<f64>,
    /// Force in N, of the device on the seal.
    pub force: Vec<f64>,
    /// Velocity in m/s, if there is one.
    pub velocity: Option<Vec<f64>>,
}

impl Readings {
    /// SHA-256 of the columns; lower-case hexadecimal.
    pub fn sha256(&self) -> String {
        let Self { time, position, force, velocity } = self;
        let mut hash = Sha256::new();
        for column in
            [Some(time), Some(position), Some(force), velocity.as_ref()].into_iter().flatten()
        {
            column.iter().for_each(|value| hash.update(value.to_le_bytes()));
        }
        text::hex(&hash.finalize())
    }
}

/// Options for reading a file.
#[derive(Debug, Clone, Default)]
pub struct ReadOptions {
    /// What to read from the file.
    pub choice: Choice,
    /// Largest force the sensor can read, in N; readings there count as saturated.
    pub sensor_limit: Option<f64>,
    /// Most samples to keep; of a longer recording, excerpts spread over its whole length are kept,
    /// and a note reports this.
    pub most_samples: Option<usize>,
    /// Most memory the columns may take, in bytes.
    pub memory_limit: Option<u64>,
}

impl Recording {
    /// A recording from columns in SI units, checked like one from a file.
    ///
    /// # Errors
    /// [`RecordingError`] when the columns differ in length or the data are invalid, as for
    /// [`read`].
    pub fn from_columns(
        name: impl Into<String>,
        time: Vec<f64>,
        position: Vec<f64>,
        force: Vec<f64>,
    ) -> Result<Self, RecordingError> {
        Self::from_readings(name, &Readings { time, position, force, velocity: None }, None)
    }

    /// The same with a velocity column, and with `sensor_limit`, N, as in [`ReadOptions`].
    ///
    /// # Errors
    /// As for [`Recording::from_columns`].
    pub fn from_readings(
        name: impl Into<String>,
        readings: &Readings,
        sensor_limit: Option<f64>,
    ) -> Result<Self, RecordingError> {
        let name = name.into();
        let Readings { time, position, force, velocity } = readings;
        let given =
            [("position", Some(position)), ("force", Some(force)), ("velocity", velocity.as_ref())];
        for (column, values) in
            given.into_iter().filter_map(|(column, values)| Some((column, values?)))
        {
            if values.len() != time.len() {
                let (file, found, expected) = (name, values.len(), time.len());
                return Err(RecordingError::Lengths { file, column, found, expected });
            }
        }
        let mut collector =
            Collector::new(time.len(), velocity.is_some(), None).counting(Count::Samples);
        for k in 0..time.len() {
            let values =
                [time[k], position[k], force[k], velocity.as_ref().map_or(f64::NAN, |v| v[k])];
            collector.add(SampleRow { line: k as u64, values });
        }
        collector.finish(&name, name.clone(), readings.sha256(), sensor_limit)
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// Whether there are no samples; never true for a recording that was read.
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// Time from the first to the last sample, in s.
    pub fn duration(&self) -> f64 {
        self.time.last().unwrap_or(&0.0) - self.time.first().unwrap_or(&0.0)
    }

    /// Whether sample `i` is at the limit of the sensor's range, as found in
    /// [`Quality::saturated`].
    pub fn is_clipped(&self, i: usize) -> bool {
        let force = self.force[i];
        self.quality
            .saturated
            .iter()
            .any(|s| if s.level < 0.0 { force <= s.level } else { force >= s.level })
    }

    /// Ranges of samples without a gap or reset; no conclusion may be drawn across their ends.
    pub fn unbroken(&self) -> impl Iterator<Item = Range<usize>> + '_ {
        let starts = std::iter::once(0).chain(self.quality.breaks.iter().copied());
        let ends = self.quality.breaks.iter().copied().chain(std::iter::once(self.len()));
        starts.zip(ends).map(|(from, to)| from..to)
    }

    /// The samples in `range` as a separate recording, with `what` appended to its name. It keeps
    /// the notes, and the readings that are saturated in the whole recording are so in the part.
    ///
    /// # Errors
    /// As for [`Recording::from_columns`].
    pub fn part(&self, range: Range<usize>, what: &str) -> Result<Self, RecordingError> {
        let cut = |column: &Vec<f64>| column[range.clone()].to_vec();
        let (time, position, force) = (cut(&self.time), cut(&self.position), cut(&self.force));
        let readings =
            Readings { time, position, force, velocity: self.velocity.as_ref().map(cut) };
        let mut part = Self::from_readings(format!("{}, {what}", self.name), &readings, None)?;
        part.choice = self.choice.clone();
        part.quality.notes.extend(self.quality.notes.iter().cloned());
        for Saturation { level, .. } in self.quality.saturated.iter().copied() {
            let is_stuck =
                |force: &&f64| if level < 0.0 { **force <= level } else { **force >= level };
            let count = part.force.iter().filter(is_stuck).count();
            let is_known = part.quality.saturated.iter().any(|found| found.level == level);
            if let (Some(first), false) =
                (part.force.iter().position(|force| is_stuck(&force)), is_known)
            {
                part.quality.saturated.push(Saturation { count, level, first_line: first as u64 });
                part.quality.notes.push(format!(
                    "{count} readings at the limit of {level} N that the whole recording has"
                ));
            }
        }
        Ok(part)
    }

    /// The recording with the inertia and weight of a moving mass removed from the force:
    /// `force - mass * (acceleration + gravity)`.
    ///
    /// `mass` in kg sits between sensor and seal; `gravity` in m/s^2 is its component along the
    /// insertion axis (0 when the axis is horizontal; a constant weight may as well stay in the
    /// offset). The acceleration is [`Recording::acceleration_of`]. A force that never changes is
    /// not that of a sensor which feels the mass: it stays as it is.
    ///
    /// # Errors
    /// [`RecordingError::MovingMass`] when the mass is negative or not finite.
    pub fn without_moving_mass(mut self, mass: f64, gravity: f64) -> Result<Self, RecordingError> {
        if !(mass.is_finite() && mass >= 0.0 && gravity.is_finite()) {
            return Err(RecordingError::MovingMass { found: mass });
        }
        if mass > PLAUSIBLE_MASS {
            let message = format!(
                "a moving mass of {mass} kg is heavier than an instrument: in grams it would be {} kg",
                1e-3 * mass
            );
            self.quality.warnings.push(Warning { kind: WarningKind::Units, message, hint: None });
        }
        let (low, high) = range(&self.force);
        if high - low <= CONSTANT_FORCE * low.abs().max(high.abs()) {
            self.quality
                .notes
                .push(format!("the force is constant: inertia of {mass} kg not taken out"));
            return Ok(self);
        }
        self.force = self.force_without_inertia(mass);
        self.force.iter_mut().for_each(|force| *force -= mass * gravity);
        self.quality.notes.push(format!("inertia of {mass} kg subtracted"));
        Ok(self)
    }
}

/// Reads a recording from a file; `-` reads text from standard input.
///
/// # Errors
/// [`RecordingError`], naming file and line, when a cell is not a number, a row has the wrong
/// number of cells, a column or its unit is missing or ambiguous, time is constant or decreases by
/// more than an interval, the stroke is longer than that of any instrument, or fewer than
/// [`MIN_SAMPLES`] samples remain. Less severe findings are recorded in [`Recording::quality`].
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
    let file = path.display().to_string();
    let needed = [Quantity::Time, Quantity::Position, Quantity::Force];
    let mut reader = Rows::open(path, &options.choice, &needed, true)?;
    let has_velocity = reader.layout().has(Quantity::Velocity);
    let rows = reader.expected().unwrap_or(0);
    let kept = options.most_samples.map_or(rows, |most| rows.min(most as u64));
    let columns = if has_velocity { 4 } else { 3 };
    check_memory(&file, kept, columns, options.memory_limit)?;
    let kept = kept.min(rows::justified(path) / columns);
    // The estimate avoids copies of a growing column; a few percent allow for lines that become
    // shorter.
    let mut collector =
        Collector::new((kept + kept / 32) as usize, has_velocity, options.most_samples);
    collector = collector.counting(reader.count());
    while let Some(block) = reader.next_block()? {
        collector.take(block);
    }
    let name = path.file_name().map_or(file.clone(), |name| name.to_string_lossy().into_owned());
    let collected = collector.finish(&file, name, reader.digest()?, options.sensor_limit);
    let mut recording = collected
        .map_err(|error| plausible::ask_stroke(&options.choice, reader.layout(), error))?;
    plausible::ask(&file, &options.choice, reader.layout(), &recording, true)?;
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
    let of_the_file = |message| Warning { kind: WarningKind::Source, message, hint: None };
    recording.quality.warnings.extend(reader.warnings().into_iter().map(of_the_file));
    // Columns without names are identified by their order.
    let in_order = options.choice.columns.clone().filter(|columns| !columns.contains('='));
    let words = in_order.map_or_else(|| reader.layout().words(), |columns| vec![columns]);
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

/// Writes columns in SI units as `time_s,position_m,velocity_m_s,force_n`, the velocity only if it
/// is given.
///
/// Every number is the shortest that reads back as the same value.
///
/// # Errors
/// The error of the operating system when the output cannot be written.
pub fn write(
    mut output: impl Write,
    time: &[f64],
    position: &[f64],
    velocity: Option<&[f64]>,
    force: &[f64],
) -> std::io::Result<()> {
    let header = if velocity.is_some() {
        "time_s,position_m,velocity_m_s,force_n"
    } else {
        "time_s,position_m,force_n"
    };
    writeln!(output, "{header}")?;
    let mut line = Line::default();
    for k in 0..time.len() {
        line.number(time[k]).number(position[k]);
        if let Some(velocity) = velocity {
            line.number(velocity[k]);
        }
        line.number(force[k]);
        line.finish(&mut output)?;
    }
    line.flush(&mut output)?;
    output.flush()
}
