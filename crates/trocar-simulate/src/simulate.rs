//! Simulates a trocar along a recorded motion, row by row and in constant memory.
//!
//! The motion is any file that [`trocar_recording`] can read with time and position. Of a force
//! column only the first reading is used. Every row gives one row
//! `time_s,position_m,force_n,deflection_m,mode`, or `time_s,position_m,force_n` for a model
//! without a deflection; `torque_n_m` follows where the model has rotation, for which the motion may
//! have an angle. The force is that of the trocar without the sensor offset, positive on insertion.
//!
//! With posterior draws of the element, each row also has the band `force_low_n`, `force_high_n` that
//! holds 95 % of their forces. It is the error of the parameters: neither the scatter of the
//! friction from stroke to stroke nor what the model does not have is in it.

use std::io::Read;
use std::path::Path;
use std::str::FromStr;

use rayon::prelude::*;
use trocar_model::{
    BacklashFilter, BacklashState, Deformation, Mode, ParamError, Stages, Trocar, TrocarState,
};

use crate::many::evenly;
use trocar_recording::block::SampleRow;
use trocar_recording::columns::Quantity;
use trocar_recording::rows::Rows;
use trocar_recording::{Choice, LONGEST_STROKE, RecordingError, position_resolution};
use trocar_tables::error::OutputError;
use trocar_tables::output::refuse_inputs;
use trocar_tables::table::{Field, Kind, TableCell, TableWriter};

/// Rows between two progress reports.
const REPORT_EVERY: u64 = 1 << 16;

/// Width of the backlash filter of the positions, as the interfaces take it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Backlash {
    /// As given, m; 0 for none.
    Width(f64),
    /// From the resolution of the positions.
    Auto,
}

impl FromStr for Backlash {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let width = text.parse().ok().filter(|width: &f64| width.is_finite() && *width >= 0.0);
        match (text, width) {
            ("auto", _) => Ok(Self::Auto),
            (_, Some(width)) => Ok(Self::Width(width)),
            _ => Err("expected 0 or more, in metres, or 'auto'".to_owned()),
        }
    }
}

impl Backlash {
    /// The filter for the file `motion`, and the resolution of its positions, m, if it follows from that.
    ///
    /// # Errors
    /// [`SimulateError::NoResolution`] for a file that cannot be read twice, or has no resolution.
    pub fn filter(
        self,
        motion: &Path,
        choice: &Choice,
    ) -> Result<Option<(BacklashFilter, Option<f64>)>, SimulateError> {
        let refuse =
            |why| Err(SimulateError::NoResolution { why, motion: motion.display().to_string() });
        if let Self::Width(width) = self {
            return Ok((width > 0.0)
                .then(|| BacklashFilter::new(width))
                .transpose()?
                .zip(Some(None)));
        }
        let is_stream = std::fs::metadata(motion).is_ok_and(|data| !data.is_file());
        if motion == Path::new("-") || is_stream {
            return refuse("which is not known beforehand for a stream");
        }
        match position_resolution(motion, choice)? {
            0.0 => refuse("but they are whole multiples of no step"),
            step => Ok(Some((BacklashFilter::for_resolution(step)?, Some(step)))),
        }
    }
}

/// Initial state of a simulation and filter of its positions.
#[derive(Debug, Clone, Copy, Default)]
pub struct SimulateOptions {
    /// Deflection of the seal at rest at the first row, m. `None`: from the first force reading if
    /// the motion has one, else undeformed.
    pub initial_deflection: Option<f64>,
    /// Sensor offset in that reading, N.
    pub offset: f64,
    /// Suppresses the effect of encoder flicker at rest on the force. The positions written stay
    /// those of the motion.
    pub filter: Option<BacklashFilter>,
}

/// The initial state that was used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beginning {
    /// The first force reading, N, if the motion has one and the state was computed from it.
    pub reading: Option<f64>,
    /// At rest at the first row.
    pub state: TrocarState,
}

/// A trocar during a simulation.
struct Run<'a> {
    trocar: &'a Trocar<&'a [f64]>,
    state: TrocarState,
    /// With its state and the position relative to the first row, m.
    filter: Option<(BacklashFilter, BacklashState, f64)>,
}

impl<'a> Run<'a> {
    fn begin(
        trocar: &'a Trocar<&'a [f64]>,
        options: &SimulateOptions,
        first: &Step,
    ) -> Result<(Self, Beginning), SimulateError> {
        let (state, reading) = match (options.initial_deflection, first.reading) {
            (Some(deflection), _) => (trocar.rest_at_deflection(first.position, deflection), None),
            (None, Some(reading)) => (
                Some(trocar.rest_at_force(first.position, reading - options.offset)),
                Some(reading),
            ),
            (None, None) => (Some(trocar.rest(first.position)), None),
        };
        let state =
            state.ok_or_else(|| SimulateError::NoDeflection { kind: trocar.seal().kind() })?;
        let state = state.with_angle(first.angle.unwrap_or(0.0));
        let filter = options.filter.map(|filter| {
            let mut state = BacklashState::default();
            filter.displacement(&mut state, 0.0);
            (filter, state, 0.0)
        });
        Ok((Self { trocar, state, filter }, Beginning { reading, state }))
    }

    /// The force, N, after the step to a row.
    fn advance(&mut self, to: &Step) -> f64 {
        // A row that a logger has written twice takes no time.
        if to.duration > 0.0 {
            self.step(to);
        }
        self.state.force()
    }

    fn step(&mut self, to: &Step) {
        match &mut self.filter {
            None => turn(self.trocar, &mut self.state, to.position, to.angle, to.duration),
            Some((filter, state, travelled)) => {
                *travelled += to.displacement;
                let displacement = filter.displacement(state, *travelled);
                let position = self.state.position() + displacement;
                match to.angle {
                    Some(angle) => {
                        self.trocar.turn_to(&mut self.state, position, angle, to.duration)
                    }
                    None => self.trocar.step(&mut self.state, displacement, to.duration),
                }
            }
        };
    }
}

/// Advances to `position` (m) and, where one is given, to `angle` (rad).
pub(crate) fn turn<K: AsRef<[f64]>>(
    trocar: &Trocar<K>,
    state: &mut TrocarState,
    position: f64,
    angle: Option<f64>,
    duration: f64,
) -> f64 {
    match angle {
        Some(angle) => trocar.turn_to(state, position, angle, duration),
        None => trocar.step_to(state, position, duration),
    }
}

/// Why a simulation stopped; it leaves no output.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SimulateError {
    /// The motion cannot be used.
    #[error(transparent)]
    Motion(#[from] RecordingError),
    /// The result cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// An initial deflection for a model without one.
    #[error("‹initial_deflection_mm› is for EMS elements; a {kind} model has no deflection")]
    NoDeflection {
        /// Kind of the model.
        kind: &'static str,
    },
    /// No resolution of the positions to make a filter for.
    #[error(
        "‹backlash_m=auto› needs the resolution of the positions, {why}: {motion}\n\nhint: give the width in metres, 1.5 \
         resolutions of the encoder: ‹backlash_m=6e-6› for 4 um"
    )]
    NoResolution {
        /// Why.
        why: &'static str,
        /// Name of the file.
        motion: String,
    },
    /// A filter that cannot be.
    #[error(transparent)]
    Filter(#[from] ParamError),
}

/// Extent of a simulation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Simulated {
    /// Rows read and written.
    pub rows: u64,
    /// Lowest position, m; infinite without rows.
    pub lowest: f64,
    /// Highest position, m; negative infinite without rows.
    pub highest: f64,
    /// The initial state; `None` without rows.
    pub beginning: Option<Beginning>,
    /// Whether the motion turns a model that knows the axis only.
    pub turns_unheeded: bool,
    /// Whether the columns of the model's recordings were missing.
    pub is_by_own_header: bool,
}

/// Simulates `trocar` along the file `motion` and writes `output`; `-` is standard input or output.
///
/// `choice` selects the columns of the motion. With `draws` of the element the table has their band: of more
/// than [`MOST_DRAWS`], that of so many evenly spaced ones; all have the position profile of `trocar`. The first row is the initial position of the
/// instrument and gets the force at rest there. `progress` is called from time to time with the
/// fraction of the motion read so far, 0 to 1 (0 for a stream), and the number of rows.
///
/// # Errors
/// [`SimulateError::Motion`] names the line of the first row that cannot be simulated: not a
/// number, not finite, decreasing time, a change of position without a change of time, more than
/// two metres of stroke. [`SimulateError::Output`] when the result cannot be written, or would
/// replace the motion. No error leaves an output file.
pub fn simulate_file<K: AsRef<[f64]>>(
    motion: &Path,
    choice: &Choice,
    trocar: &Trocar<K>,
    draws: Option<&[Stages]>,
    options: &SimulateOptions,
    output: &Path,
    progress: impl FnMut(f64, u64),
) -> Result<Simulated, SimulateError> {
    refuse_inputs([output], &[motion.to_owned()])?;
    let trocar = trocar.borrowed();
    let mut columns = fields(&trocar);
    let drawn: Option<Vec<Trocar<&[f64]>>> = draws.map(|draws| {
        columns.extend(BAND.map(Field::number));
        let draws = evenly(draws, MOST_DRAWS);
        draws.into_iter().map(|draw| trocar.with_seal(draw.into())).collect()
    });
    let mut result = TableWriter::create(output, &columns)?;
    let band = drawn.as_deref().map(Band::new);
    let rows = Positions::open(motion, choice)?;
    let simulated = run(rows, &trocar, options, band, &mut result, progress)?;
    result.commit()?;
    Ok(simulated)
}

/// Most draws of a band: its ends are then the forces of the 10th draw from either side.
pub const MOST_DRAWS: usize = 400;
/// Columns of the band.
const BAND: [&str; 2] = ["force_low_n", "force_high_n"];
/// Fraction of the draws below and above the band.
const OUTSIDE: f64 = 0.025;
/// Rows whose band is computed together.
const BLOCK: usize = 512;

/// Simulations of draws beside that of the model, and the rows that wait for their band.
struct Band<'a> {
    drawn: &'a [Trocar<&'a [f64]>],
    runs: Vec<Run<'a>>,
    steps: Vec<Step>,
    rows: Vec<Vec<TableCell>>,
}

impl<'a> Band<'a> {
    fn new(drawn: &'a [Trocar<&'a [f64]>]) -> Self {
        Self { drawn, runs: Vec::new(), steps: Vec::new(), rows: Vec::new() }
    }

    fn begin(&mut self, options: &SimulateOptions, first: &Step) -> Result<(), SimulateError> {
        let runs = self.drawn.iter().map(|trocar| Run::begin(trocar, options, first));
        self.runs = runs.map(|begun| Ok(begun?.0)).collect::<Result<_, SimulateError>>()?;
        Ok(())
    }

    /// Keeps a row, and writes all that wait when a block is full.
    fn add(
        &mut self,
        step: Step,
        row: Vec<TableCell>,
        output: &mut TableWriter,
    ) -> Result<(), OutputError> {
        self.steps.push(step);
        self.rows.push(row);
        if self.rows.len() < BLOCK { Ok(()) } else { self.write(output) }
    }

    fn write(&mut self, output: &mut TableWriter) -> Result<(), OutputError> {
        let steps = &self.steps;
        let forces = self.runs.par_iter_mut();
        let forces: Vec<Vec<f64>> =
            forces.map(|run| steps.iter().map(|step| run.advance(step)).collect()).collect();
        for (i, row) in self.rows.iter_mut().enumerate() {
            let mut own: Vec<f64> = forces.iter().map(|of_draw| of_draw[i]).collect();
            own.sort_by(f64::total_cmp);
            let outside = (OUTSIDE * own.len() as f64) as usize;
            let ends = [own[outside], own[own.len() - 1 - outside]];
            row.extend(ends.map(TableCell::Number));
            output.row(row)?;
        }
        self.steps.clear();
        self.rows.clear();
        Ok(())
    }
}

/// The columns of a simulation: time, position and force, and the deformation and the torque if the
/// model has them.
pub fn fields<K: AsRef<[f64]>>(trocar: &Trocar<K>) -> Vec<Field> {
    let mut fields: Vec<Field> = ["time_s", "position_m", "force_n"].map(Field::number).into();
    if trocar.seal().stages().is_some() {
        fields.extend([Field::number("deflection_m"), Field::new("mode", Kind::Text)]);
    }
    fields.extend(trocar.rotation().map(|_| Field::number("torque_n_m")));
    fields
}

/// The same into a table with these [`fields`], which is not committed.
///
/// # Errors
/// As for [`simulate_file`].
pub fn simulate<K: AsRef<[f64]>>(
    rows: Positions,
    trocar: &Trocar<K>,
    options: &SimulateOptions,
    output: &mut TableWriter,
    progress: impl FnMut(f64, u64),
) -> Result<Simulated, SimulateError> {
    run(rows, &trocar.borrowed(), options, None, output, progress)
}

fn run(
    mut rows: Positions,
    trocar: &Trocar<&[f64]>,
    options: &SimulateOptions,
    mut band: Option<Band>,
    output: &mut TableWriter,
    mut progress: impl FnMut(f64, u64),
) -> Result<Simulated, SimulateError> {
    let mut count = 0;
    let mut under_way: Option<(Run, Beginning)> = None;
    let (mut row, mut first, mut turns) = (Vec::new(), None, false);
    while let Some(step) = rows.advance()? {
        let run = match &mut under_way {
            Some((run, _)) => run,
            None => {
                if let Some(band) = &mut band {
                    band.begin(options, &step)?;
                }
                &mut under_way.insert(Run::begin(trocar, options, &step)?).0
            }
        };
        let numbers = [step.time, step.position, run.advance(&step)].map(TableCell::Number);
        row.clear();
        row.extend(numbers);
        row.extend(run.state.deformation().into_iter().flat_map(cells));
        row.extend(run.state.turning().map(|_| TableCell::Number(run.state.torque())));
        match &mut band {
            Some(band) => band.add(step, row.clone(), output)?,
            None => output.row(&row)?,
        }
        let from = *first.get_or_insert(step.angle);
        turns |= step.angle != from;
        count += 1;
        if count % REPORT_EVERY == 0 {
            progress(rows.rows.part(), count);
        }
    }
    if let Some(band) = &mut band {
        band.write(output)?;
    }
    let beginning = under_way.map(|(_, beginning)| beginning);
    Ok(Simulated {
        rows: count,
        lowest: rows.lowest,
        highest: rows.highest,
        beginning,
        turns_unheeded: turns && trocar.rotation().is_none(),
        is_by_own_header: rows.rows.is_by_own_header(),
    })
}

fn cells(Deformation { deflection, mode }: Deformation) -> [TableCell; 2] {
    [TableCell::Number(deflection), TableCell::Text(word(mode))]
}

fn word(mode: Mode) -> &'static str {
    match mode {
        Mode::Deforming => "deforming",
        Mode::Sliding => "sliding",
    }
}

/// One row of a motion and the step to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// Time, s.
    pub time: f64,
    /// Position, m.
    pub position: f64,
    /// Displacement since the previous row, m; 0 on the first row.
    pub displacement: f64,
    /// Time since the previous row, s; 0 on the first row and where a row is repeated.
    pub duration: f64,
    /// Force reading, N, if the motion has one.
    pub reading: Option<f64>,
    /// Angle, rad, if the motion has one.
    pub angle: Option<f64>,
}

/// Reads a motion row by row and rejects a row that cannot follow the previous one.
pub struct Positions<'a> {
    file: String,
    rows: Rows<'a>,
    started: bool,
    time: f64,
    position: f64,
    lowest: f64,
    highest: f64,
}

/// Required quantities of a motion.
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
    /// The same from a text stream, which messages call `file`.
    ///
    /// # Errors
    /// As for [`Positions::open`].
    pub fn from_text(
        file: &str,
        input: impl Read + Send + 'a,
        choice: &Choice,
    ) -> Result<Self, RecordingError> {
        let rows = Rows::from_text(file, Box::new(input), choice, &NEEDED)?;
        Ok(Self::new(file.to_owned(), rows))
    }

    fn new(file: String, rows: Rows<'a>) -> Self {
        let (lowest, highest) = (f64::INFINITY, f64::NEG_INFINITY);
        Self { file, rows, started: false, time: 0.0, position: 0.0, lowest, highest }
    }

    /// The next row, or `None` at the end.
    ///
    /// # Errors
    /// [`RecordingError`] with the line of an invalid row.
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
        let [reading, angle] = [Quantity::Force, Quantity::Angle]
            .map(|quantity| Some(row.get(quantity)).filter(|value: &f64| value.is_finite()));
        Ok(Some(Step { time, position, displacement, duration, reading, angle }))
    }

    #[cold]
    fn unfit(&self, row: SampleRow) -> RecordingError {
        let (file, place) = (&self.file, self.rows.place(row));
        let (time, position) = (row.get(Quantity::Time), row.get(Quantity::Position));
        for (quantity, value) in [("time", time), ("position", position)] {
            if !value.is_finite() {
                return RecordingError::non_finite(file, place, quantity, value);
            }
        }
        if time < self.time {
            return RecordingError::time_goes_back(file, place, self.time, time);
        }
        if time == self.time {
            let problem = format!(
                "position goes from {} m to {position} m while time stays at {time} s, expected time to advance\n\nhint: the clock is coarser than the sampling; record time with more digits",
                self.position
            );
            return RecordingError::unusable(format_args!("{file} {place}"), problem);
        }
        let stroke = self.highest - self.lowest;
        RecordingError::StrokeTooLong { file: file.clone(), stroke, limit: LONGEST_STROKE }
    }
}
