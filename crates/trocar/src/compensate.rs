//! [`trocar_runtime::compensate`], and a recording or a live stream through its observer: row by
//! row and in constant memory.

use std::path::Path;

pub use trocar_runtime::compensate::*;

use trocar_recording::RecordingError;
use trocar_recording::columns::Quantity;
use trocar_recording::rows::Rows;
use trocar_recording::{Choice, Location};
use trocar_simulate::profile::Departure;
use trocar_simulate::simulate::SimulateError;
use trocar_tables::output::refuse_inputs;
use trocar_tables::table::{Field, Kind, TableCell, TableWriter};

/// Rows between two reports of progress.
const REPORT_EVERY: u64 = 1 << 16;

/// Number of rows with one fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FaultCount {
    /// The fault.
    pub fault: Fault,
    /// Line of its first occurrence.
    pub first_line: u64,
    /// Number of rows.
    pub rows: u64,
}

/// Result of a stream.
#[derive(Debug, Clone, PartialEq)]
pub struct Compensation {
    /// Rows read and written.
    pub rows: u64,
    /// Rows in which friction scale and viscosity were adapted.
    pub adapting_rows: u64,
    /// Faults found, in the order of [`Fault::ALL`].
    pub faults: Vec<FaultCount>,
    /// Final friction scale and viscosity.
    pub drift: Drift,
    /// By how far the motion left the range of the position profile.
    pub departure: Option<Departure>,
    /// Whether the columns of the model's recordings were missing.
    pub is_by_own_header: bool,
    /// Whether the model resists rotation and the first row has no angle: the instrument then does not turn.
    pub angle_missing: bool,
}

/// Options for reading and writing a stream.
#[derive(Debug, Clone, Copy)]
pub struct StreamOptions<'a> {
    /// Quantities to read.
    pub choice: &'a Choice,
    /// Write each row immediately: for a stream that is used in real time.
    pub live: bool,
}

/// Runs `observer` along the file at `path` and writes `output`; `-` is standard input or output.
///
/// The sign of the readings is that of `options.choice`: the observer does not reverse it again, but
/// reverses live readings afterwards as it did before.
///
/// Cells without a number (empty, `nan`) in position and force are faults, not errors. `progress`
/// regularly receives the fraction of the file read, 0 to 1 (0 for a stream), and the number of
/// rows; `on_fault` the first line of each kind of fault when it occurs.
///
/// # Errors
/// [`SimulateError::Motion`] for a file that cannot be read, or a time that is not finite or
/// decreases; [`SimulateError::Output`] when the result cannot be written, or would replace the
/// recording. Neither leaves an output file.
pub fn compensate_file(
    path: &Path,
    options: StreamOptions,
    observer: &mut Compensator,
    output: &Path,
    progress: impl FnMut(f64, u64),
    on_fault: impl FnMut(Fault, u64),
) -> Result<Compensation, SimulateError> {
    let live = observer.set_flip_force(false);
    let done = run_along(path, options, observer, output, progress, on_fault);
    observer.set_flip_force(live);
    done
}

fn run_along(
    path: &Path,
    options: StreamOptions,
    observer: &mut Compensator,
    output: &Path,
    mut progress: impl FnMut(f64, u64),
    mut on_fault: impl FnMut(Fault, u64),
) -> Result<Compensation, SimulateError> {
    refuse_inputs([output], &[path.to_owned()])?;
    let file = &path.display().to_string();
    let mut result = TableWriter::create(output, &fields(observer.turns()))?.with_missing("nan");
    let needed = [Quantity::Time, Quantity::Position, Quantity::Force];
    let mut rows = Rows::open(path, options.choice, &needed, false)?;
    let mut count = Counter::default();
    let mut before = None;
    let mut has_angle = None;
    while let Some(row) = rows.next_row()? {
        let [time, position, force, ..] = row.values;
        // A live stream cannot be corrected: an invalid time is a fault there, and the model is not
        // stepped.
        let duration = match duration(file, rows.place(row), before, time) {
            Err(_) if options.live => f64::NAN,
            other => other?,
        };
        before = if time.is_finite() { Some(time) } else { before };
        let angle = row.get(Quantity::Angle);
        let estimate = match *has_angle.get_or_insert(angle.is_finite()) {
            true => observer.turn(position, angle, force, duration),
            false => observer.step(position, force, duration),
        };
        if let Some(fault) = estimate.fault.filter(|fault| count.is_new(*fault)) {
            on_fault(fault, row.line);
        }
        count.take(row.line, position, &estimate);
        let numbers =
            [time, position, force, estimate.trocar_force, estimate.tissue_force, estimate.std];
        let [a, b, c, d, e, f] = numbers
            .map(|number| TableCell::Number(if number.is_finite() { number } else { f64::NAN }));
        let adapting = TableCell::Integer(i64::from(estimate.adapting));
        let torque = TableCell::Number(estimate.trocar_torque);
        let cells = [a, b, c, d, e, f, adapting, torque];
        result.row(&cells[..7 + usize::from(observer.turns())])?;
        if options.live {
            result.flush()?;
        }
        if count.rows % REPORT_EVERY == 0 {
            progress(rows.part(), count.rows);
        }
    }
    result.commit()?;
    Ok(Compensation {
        is_by_own_header: rows.is_by_own_header(),
        angle_missing: observer.turns() && has_angle == Some(false),
        ..count.summary(observer)
    })
}

/// Time since the row before, s; 0 for the first and for a repeated time.
fn duration(
    file: &str,
    place: Location,
    before: Option<f64>,
    time: f64,
) -> Result<f64, RecordingError> {
    if !time.is_finite() {
        return Err(RecordingError::non_finite(file, place, "time", time));
    }
    match before {
        Some(from) if time < from => Err(RecordingError::time_goes_back(file, place, from, time)),
        Some(from) => Ok(time - from),
        None => Ok(0.0),
    }
}

/// The columns written; of a model that `turns` the torque, too.
fn fields(turns: bool) -> Vec<Field> {
    let numbers = [
        "time_s",
        "position_m",
        "force_n",
        "trocar_force_n",
        "tissue_force_n",
        "tissue_force_std_n",
    ];
    let adapting = Field::new("adapting", Kind::Integer);
    let torque = turns.then(|| Field::number("torque_n_m"));
    numbers.into_iter().map(Field::number).chain([adapting]).chain(torque).collect()
}

struct Counter {
    rows: u64,
    lowest: f64,
    highest: f64,
    adapting_rows: u64,
    /// First line and rows, by fault.
    faults: [Option<(u64, u64)>; Fault::ALL.len()],
}

impl Default for Counter {
    fn default() -> Self {
        let (lowest, highest) = (f64::INFINITY, f64::NEG_INFINITY);
        Self { rows: 0, lowest, highest, adapting_rows: 0, faults: [None; Fault::ALL.len()] }
    }
}

impl Counter {
    fn is_new(&self, fault: Fault) -> bool {
        self.faults[fault as usize].is_none()
    }

    fn take(&mut self, line: u64, position: f64, estimate: &Estimate) {
        self.rows += 1;
        if position.is_finite() && !matches!(estimate.fault, Some(Fault::Jump)) {
            (self.lowest, self.highest) = (self.lowest.min(position), self.highest.max(position));
        }
        self.adapting_rows += u64::from(estimate.adapting);
        if let Some(fault) = estimate.fault {
            let (first, rows) = self.faults[fault as usize].unwrap_or((line, 0));
            self.faults[fault as usize] = Some((first, rows + 1));
        }
    }

    fn summary(self, observer: &Compensator) -> Compensation {
        let faults = Fault::ALL
            .into_iter()
            .filter_map(|fault| {
                let (first_line, rows) = self.faults[fault as usize]?;
                Some(FaultCount { fault, first_line, rows })
            })
            .collect();
        let (drift, departure) = (observer.drift(), observer.departure(self.lowest, self.highest));
        Compensation {
            rows: self.rows,
            adapting_rows: self.adapting_rows,
            faults,
            drift,
            departure,
            is_by_own_header: false,
            angle_missing: false,
        }
    }
}
