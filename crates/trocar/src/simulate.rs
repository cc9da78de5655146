//! Replays a model along a recorded motion, row by row and in constant memory.
//!
//! The motion is any CSV that [`crate::recording`] understands with time and position; a force column is ignored. Every
//! row gives one row `time_s,position_m,force_n,deflection_m,mode`. The force is the seal's alone, positive on
//! insertion.

use std::fs::File;
use std::io::{self, Read, Write};
use std::path::Path;

use trocar_model::{Mode, Parallel, State};

use crate::error::{OutputError, RecordingError};
use crate::output::AtomicFile;
use crate::recording::columns::Quantity;
use crate::recording::line::Line;
use crate::recording::rows::{Row, RowReader};
use crate::recording::{LONGEST_STROKE, Place};

/// Names of the columns written.
const HEADER: &[u8] = b"time_s,position_m,force_n,deflection_m,mode\n";

/// Rows between two reports of progress.
const REPORT_EVERY: u64 = 1 << 16;

/// What turns motion into force, with everything it remembers inside.
pub trait Drive {
    /// Advances by `displacement` (m) within `duration` (s, positive); returns the force (N) at the end.
    fn step(&mut self, displacement: f64, duration: f64) -> f64;
    /// Force after the last step, N.
    fn force(&self) -> f64;
    /// Deflection after the last step, m.
    fn deflection(&self) -> f64;
    /// Mode after the last step.
    fn mode(&self) -> Mode;
}

/// Several elements count as one seal: the deflection is their mean, and the seal slides once all of them do.
impl Drive for Parallel<'_> {
    fn step(&mut self, displacement: f64, duration: f64) -> f64 {
        Parallel::step(self, displacement, duration)
    }

    fn force(&self) -> f64 {
        Parallel::force(self)
    }

    fn deflection(&self) -> f64 {
        let sum: f64 = self.states().iter().map(State::deflection).sum();
        sum / self.states().len() as f64
    }

    fn mode(&self) -> Mode {
        let sliding = self.states().iter().all(|state| state.mode() == Mode::Sliding);
        if sliding { Mode::Sliding } else { Mode::Deforming }
    }
}

/// Why a replay stopped; no output is left then.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SimulateError {
    /// The motion cannot be used.
    #[error(transparent)]
    Motion(#[from] RecordingError),
    /// The result cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// Replays `drive` along the file `motion` and writes `output`; `-` is standard input or output.
///
/// `columns` names the columns of a motion without a header. The first row is where the drive stands: it carries the
/// drive's present force. `progress` is told the bytes read so far, now and then. Returns the number of rows.
///
/// # Errors
/// [`SimulateError::Motion`] names the line of the first row that cannot be replayed: no number, not finite, time going
/// back, position changing within no time, more than two metres of stroke. [`SimulateError::Output`] when the result
/// cannot be written. Neither leaves an output file.
pub fn simulate_file(
    motion: &Path,
    columns: Option<&str>,
    drive: &mut impl Drive,
    output: &Path,
    progress: impl FnMut(u64),
) -> Result<u64, SimulateError> {
    let file = motion.display().to_string();
    let mut result = AtomicFile::create(output)?;
    let rows = if file == "-" {
        simulate(&file, io::stdin().lock(), columns, drive, &mut result, progress)?
    } else {
        let input = File::open(motion).map_err(|source| RecordingError::Open { file: file.clone(), source })?;
        simulate(&file, input, columns, drive, &mut result, progress)?
    };
    result.commit()?;
    Ok(rows)
}

/// The same from any stream into an [`AtomicFile`], which stays uncommitted. `file` names the stream in messages.
///
/// # Errors
/// As for [`simulate_file`].
pub fn simulate(
    file: &str,
    input: impl Read,
    columns: Option<&str>,
    drive: &mut impl Drive,
    output: &mut AtomicFile,
    mut progress: impl FnMut(u64),
) -> Result<u64, SimulateError> {
    let mut rows = RowReader::open(file, input, columns, &[Quantity::Time, Quantity::Position], false)?;
    let mut line = Line::default();
    let outcome = output.write_all(HEADER);
    outcome.map_err(|source| output.write_error(source))?;
    let mut motion = Motion::new(file);
    let mut count = 0;
    while let Some(row) = rows.next_row()? {
        let force = match motion.advance(row)? {
            Some((displacement, duration)) => drive.step(displacement, duration),
            None => drive.force(),
        };
        line.number(motion.time).number(motion.position).number(force).number(drive.deflection());
        line.word(word(drive.mode()));
        let outcome = line.finish(output);
        outcome.map_err(|source| output.write_error(source))?;
        count += 1;
        if count % REPORT_EVERY == 0 {
            progress(rows.bytes_read());
        }
    }
    let outcome = line.flush(output);
    outcome.map_err(|source| output.write_error(source))?;
    Ok(count)
}

fn word(mode: Mode) -> &'static str {
    match mode {
        Mode::Deforming => "deforming",
        Mode::Sliding => "sliding",
    }
}

/// The motion so far, and what makes a row unfit to follow it.
struct Motion<'a> {
    file: &'a str,
    started: bool,
    time: f64,
    position: f64,
    lowest: f64,
    highest: f64,
}

impl<'a> Motion<'a> {
    fn new(file: &'a str) -> Self {
        let (lowest, highest) = (f64::INFINITY, f64::NEG_INFINITY);
        Self { file, started: false, time: 0.0, position: 0.0, lowest, highest }
    }

    /// Displacement and duration up to this row; `None` on the first row and where one is repeated.
    #[inline]
    fn advance(&mut self, row: Row) -> Result<Option<(f64, f64)>, RecordingError> {
        let (time, position) = (row.get(Quantity::Time), row.get(Quantity::Position));
        let (duration, displacement) = (time - self.time, position - self.position);
        let repeated = duration == 0.0 && displacement == 0.0;
        let usable = time.is_finite() && position.is_finite() && (duration > 0.0 || repeated);
        if !usable && (self.started || !(time.is_finite() && position.is_finite())) {
            return Err(self.unfit(row));
        }
        self.lowest = self.lowest.min(position);
        self.highest = self.highest.max(position);
        if self.highest - self.lowest > LONGEST_STROKE {
            return Err(self.unfit(row));
        }
        (self.time, self.position) = (time, position);
        let first = !std::mem::replace(&mut self.started, true);
        Ok((!first && !repeated).then_some((displacement, duration)))
    }

    #[cold]
    fn unfit(&self, row: Row) -> RecordingError {
        let (file, line) = (self.file.to_owned(), row.line);
        let (time, position) = (row.get(Quantity::Time), row.get(Quantity::Position));
        for (quantity, value) in [("time", time), ("position", position)] {
            if !value.is_finite() {
                let found = if value.is_nan() { "empty or nan" } else { "infinite" };
                return RecordingError::NonFinite { file, line, quantity, found };
            }
        }
        if time < self.time {
            return RecordingError::TimeGoesBack { file, place: Place::Line(line), from: self.time, to: time };
        }
        if time == self.time {
            return RecordingError::NoDuration { file, line, time, from: self.position, to: position };
        }
        let stroke = self.highest - self.lowest;
        RecordingError::StrokeTooLong { file, stroke, limit: LONGEST_STROKE }
    }
}
