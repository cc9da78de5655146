//! Replays a model along a recorded motion, row by row and in constant memory.
//!
//! The motion is any file that [`crate::recording`] understands with time and position; of a force column only the
//! first reading counts, and only for a drive that starts from it. Every row gives one row
//! `time_s,position_m,force_n,deflection_m,mode`, or `time_s,position_m,force_n` for a model without a deformation of
//! its own. The force is the seal's alone, positive on insertion.

use std::io::Read;
use std::path::Path;

use trocar_model::{Deformation, Friction, GuardState, Mode, Parallel, PlayGuard};

use crate::error::{OutputError, RecordingError};
use crate::recording::block::Row;
use crate::recording::columns::Quantity;
use crate::recording::rows::Rows;
use crate::recording::{Choice, LONGEST_STROKE};
use crate::table::{Cell, Field, Kind, TableWriter};

/// Rows between two reports of progress.
const REPORT_EVERY: u64 = 1 << 16;

/// What turns motion into force, with everything it remembers inside.
pub trait Drive {
    /// Told once, before the first step: the force reading (N) of the first row, where the motion has one.
    fn start(&mut self, _reading: Option<f64>) {}
    /// The same with the position (m) of the first row, for a drive whose force depends on it.
    fn start_at(&mut self, _position: f64, reading: Option<f64>) {
        self.start(reading);
    }
    /// Advances by `displacement` (m) within `duration` (s, positive); returns the force (N) at the end.
    fn step(&mut self, displacement: f64, duration: f64) -> f64;
    /// The same for a step that ends at `position`, m.
    fn step_to(&mut self, _position: f64, displacement: f64, duration: f64) -> f64 {
        self.step(displacement, duration)
    }
    /// Force after the last step, N.
    fn force(&self) -> f64;
    /// Deformation of the seal after the last step; `None` throughout for a model that knows none.
    fn deformation(&self) -> Option<Deformation>;
}

/// A friction model and its state under one motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Single<M: Friction> {
    model: M,
    /// Sensor offset in the first reading, N.
    offset: f64,
    state: M::State,
}

impl<M: Friction> Single<M> {
    /// Starts at rest with the first force reading less the sensor's offset `offset`, N, or without force where the
    /// motion has none.
    pub fn new(model: M, offset: f64) -> Self {
        let state = model.rest_at_force(0.0);
        Self { model, offset, state }
    }
}

/// Writes the force alone: what a friction model calls a deflection is no deflection of a seal.
impl<M: Friction> Drive for Single<M> {
    fn start(&mut self, reading: Option<f64>) {
        self.state = self.model.rest_at_force(reading.map_or(0.0, |reading| reading - self.offset));
    }

    fn step(&mut self, displacement: f64, duration: f64) -> f64 {
        self.model.step(&mut self.state, displacement, duration)
    }

    fn force(&self) -> f64 {
        M::force(&self.state)
    }

    fn deformation(&self) -> Option<Deformation> {
        None
    }
}

/// Several elements count as one seal: the deflection is their mean, and the seal slides once all of them do.
impl Drive for Parallel<'_> {
    fn step(&mut self, displacement: f64, duration: f64) -> f64 {
        Parallel::step(self, displacement, duration)
    }

    fn force(&self) -> f64 {
        Parallel::force(self)
    }

    fn deformation(&self) -> Option<Deformation> {
        Some(Deformation::of(self.states()))
    }
}

/// A drive behind a play guard: flicker of a resting position no longer reaches it.
///
/// The positions written stay those of the motion; only what the drive is moved by goes through the guard.
#[derive(Debug)]
pub struct Guarded<'a, D> {
    drive: &'a mut D,
    guard: PlayGuard,
    state: GuardState,
    /// Position from the first row on, m.
    travelled: f64,
}

impl<'a, D: Drive> Guarded<'a, D> {
    /// Puts `guard` in front of `drive`.
    pub fn new(drive: &'a mut D, guard: PlayGuard) -> Self {
        let mut state = GuardState::default();
        guard.displacement(&mut state, 0.0);
        Self { drive, guard, state, travelled: 0.0 }
    }
}

impl<D: Drive> Drive for Guarded<'_, D> {
    fn start(&mut self, reading: Option<f64>) {
        self.drive.start(reading);
    }

    fn start_at(&mut self, position: f64, reading: Option<f64>) {
        self.drive.start_at(position, reading);
    }

    fn step(&mut self, displacement: f64, duration: f64) -> f64 {
        self.travelled += displacement;
        let displacement = self.guard.displacement(&mut self.state, self.travelled);
        self.drive.step(displacement, duration)
    }

    fn force(&self) -> f64 {
        self.drive.force()
    }

    fn deformation(&self) -> Option<Deformation> {
        self.drive.deformation()
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

/// What a replay covered.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Simulated {
    /// Rows read and written.
    pub rows: u64,
    /// Lowest position, m; infinite without any row.
    pub lowest: f64,
    /// Highest position, m; negative infinite without any row.
    pub highest: f64,
}

/// Replays `drive` along the file `motion` and writes `output`; `-` is standard input or output.
///
/// `choice` says what to take from the motion. The first row is where the drive stands: it carries the drive's present force.
/// `progress` is told now and then which part of the motion has been read, 0 to 1 (0 for a stream), and how many rows. Returns
/// the number of rows and the range of the positions.
///
/// # Errors
/// [`SimulateError::Motion`] names the line of the first row that cannot be replayed: no number, not finite, time going
/// back, position changing within no time, more than two metres of stroke. [`SimulateError::Output`] when the result
/// cannot be written. Neither leaves an output file.
pub fn simulate_file(
    motion: &Path,
    choice: &Choice,
    drive: &mut impl Drive,
    output: &Path,
    progress: impl FnMut(f64, u64),
) -> Result<Simulated, SimulateError> {
    let mut result = TableWriter::create(output, &fields(drive))?;
    let simulated = simulate(Positions::open(motion, choice)?, drive, &mut result, progress)?;
    result.commit()?;
    Ok(simulated)
}

/// The columns of a replay: time, position and force, and the deformation where `drive` knows one.
pub fn fields(drive: &impl Drive) -> Vec<Field> {
    let mut fields: Vec<Field> = ["time_s", "position_m", "force_n"].map(Field::number).into();
    if drive.deformation().is_some() {
        fields.extend([Field::number("deflection_m"), Field::new("mode", Kind::Text)]);
    }
    fields
}

/// The same into a table of these [`fields`], which stays uncommitted.
///
/// # Errors
/// As for [`simulate_file`].
pub fn simulate(
    mut rows: Positions,
    drive: &mut impl Drive,
    output: &mut TableWriter,
    mut progress: impl FnMut(f64, u64),
) -> Result<Simulated, SimulateError> {
    let mut count = 0;
    while let Some(step) = rows.advance()? {
        if count == 0 {
            drive.start_at(step.position, step.reading);
        }
        let force = match step.duration > 0.0 {
            true => drive.step_to(step.position, step.displacement, step.duration),
            false => drive.force(),
        };
        let numbers = [step.time, step.position, force].map(Cell::Number);
        match drive.deformation() {
            Some(Deformation { deflection, mode }) => {
                let [time, position, force] = numbers;
                output.row(&[time, position, force, Cell::Number(deflection), Cell::Word(word(mode))])?;
            }
            None => output.row(&numbers)?,
        }
        count += 1;
        if count % REPORT_EVERY == 0 {
            progress(rows.rows.part(), count);
        }
    }
    Ok(Simulated { rows: count, lowest: rows.lowest, highest: rows.highest })
}

fn word(mode: Mode) -> &'static str {
    match mode {
        Mode::Deforming => "deforming",
        Mode::Sliding => "sliding",
    }
}

/// One row of a motion and the way to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// Time, s.
    pub time: f64,
    /// Position, m.
    pub position: f64,
    /// Displacement since the row above, m; 0 on the first row.
    pub displacement: f64,
    /// Time since the row above, s; 0 on the first row and where a row is repeated.
    pub duration: f64,
    /// Force reading, N, where the motion has one.
    pub reading: Option<f64>,
}

/// Reads a motion row by row and refuses a row that cannot follow the one above.
pub struct Positions<'a> {
    file: String,
    rows: Rows<'a>,
    started: bool,
    time: f64,
    position: f64,
    lowest: f64,
    highest: f64,
}

/// What a motion has to hold.
const NEEDED: [Quantity; 2] = [Quantity::Time, Quantity::Position];

impl Positions<'static> {
    /// Opens the file at `path`, or standard input for `-`, up to the first row.
    ///
    /// # Errors
    /// [`RecordingError`] when there is no such row or the columns are unclear.
    pub fn open(path: &Path, choice: &Choice) -> Result<Self, RecordingError> {
        Ok(Self::new(path.display().to_string(), Rows::open(path, choice, &NEEDED, false)?))
    }
}

impl<'a> Positions<'a> {
    /// The same from a stream of text, which `file` names in messages.
    ///
    /// # Errors
    /// As for [`Positions::open`].
    pub fn from_text(file: &str, input: impl Read + Send + 'a, choice: &Choice) -> Result<Self, RecordingError> {
        let rows = Rows::from_text(file, Box::new(input), false, choice, &NEEDED, false)?;
        Ok(Self::new(file.to_owned(), rows))
    }

    fn new(file: String, rows: Rows<'a>) -> Self {
        let (lowest, highest) = (f64::INFINITY, f64::NEG_INFINITY);
        Self { file, rows, started: false, time: 0.0, position: 0.0, lowest, highest }
    }

    /// The next row, or `None` at the end.
    ///
    /// # Errors
    /// [`RecordingError`] with the line of a row that cannot be followed.
    pub fn advance(&mut self) -> Result<Option<Step>, RecordingError> {
        let Some(row) = self.rows.next_row()? else { return Ok(None) };
        let (time, position) = (row.get(Quantity::Time), row.get(Quantity::Position));
        let (mut duration, mut displacement) = (time - self.time, position - self.position);
        if !std::mem::replace(&mut self.started, true) {
            (duration, displacement) = (0.0, 0.0);
        }
        self.lowest = self.lowest.min(position);
        self.highest = self.highest.max(position);
        let finite = time.is_finite() && position.is_finite();
        let follows = duration > 0.0 || (duration == 0.0 && displacement == 0.0);
        if !(finite && follows && self.highest - self.lowest <= LONGEST_STROKE) {
            return Err(self.unfit(row));
        }
        (self.time, self.position) = (time, position);
        let reading = Some(row.get(Quantity::Force)).filter(|force| force.is_finite());
        Ok(Some(Step { time, position, displacement, duration, reading }))
    }

    #[cold]
    fn unfit(&self, row: Row) -> RecordingError {
        let (file, place) = (self.file.clone(), self.rows.place(row));
        let (time, position) = (row.get(Quantity::Time), row.get(Quantity::Position));
        for (quantity, value) in [("time", time), ("position", position)] {
            if !value.is_finite() {
                let found = if value.is_nan() { "empty or nan" } else { "infinite" };
                return RecordingError::NonFinite { file, place, quantity, found };
            }
        }
        if time < self.time {
            return RecordingError::TimeGoesBack { file, place, from: self.time, to: time };
        }
        if time == self.time {
            return RecordingError::NoDuration { file, place, time, from: self.position, to: position };
        }
        let stroke = self.highest - self.lowest;
        RecordingError::StrokeTooLong { file, stroke, limit: LONGEST_STROKE }
    }
}
