//! Contents of a file: its tables and columns, and how they would be read as a recording.
//!
//! Every table is read once from end to end in constant memory.

use std::path::Path;

use serde::Serialize;

use crate::survey::Survey;
use trocar_recording::RecordingError;
use trocar_recording::container::{Container, Table};
use trocar_recording::registry;
use trocar_recording::{self, Choice, ReadOptions, Recording};
use trocar_simulate::segment::SegmentOptions;

/// Most groups of rows of a sparkline; it has at least half of them once there are as many rows.
pub(crate) const SPARK: usize = 64;

/// Number of intervals between rows from which the typical interval is determined.
const INTERVALS: usize = 1 << 16;

/// An interval is a gap if it is this much longer than 95 % of the intervals, as in
/// [`trocar_recording::Quality`].
const GAP_FACTOR: f64 = 3.0;

/// Most samples used to determine what can be identified.
const SURVEYED: usize = 1 << 20;

/// Contents of one column.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ColumnView {
    /// Name in the file.
    pub name: String,
    /// Unit as declared in the file, or as part of the name.
    pub unit: Option<String>,
    /// Smallest finite number; `None` for a column without one.
    pub lowest: Option<f64>,
    /// Largest finite number.
    pub highest: Option<f64>,
    /// Cells that are empty, NaN or infinite.
    pub not_finite: u64,
    /// Means of consecutive groups of rows, at most 64; empty for a column without numbers.
    pub course: Vec<f64>,
    /// Whether the numbers never decrease: a clock, or a counter.
    pub rises: bool,
}

/// Contents of one table.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TableView {
    /// Topic, group or variable; empty if the file is one table.
    pub name: String,
    /// Message type of a topic, or class of a variable.
    pub kind: String,
    /// Rows.
    pub rows: u64,
    /// Its columns.
    pub columns: Vec<ColumnView>,
    /// Its clock, if it has one.
    pub clock: Option<Clock>,
    /// Why it could not be read to its end.
    pub damage: Option<String>,
}

/// Properties of a table's clock. In seconds if the column's unit is known, else in the unit of the
/// file.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Clock {
    /// The column.
    pub column: String,
    /// Number of its units per second; `None` if no unit is declared.
    pub per_s: Option<f64>,
    /// From the first row to the last.
    pub duration: f64,
    /// Median interval between rows.
    pub median_interval: f64,
    /// Intervals more than three times longer than 95 % of the first intervals.
    pub gaps: u64,
    /// The longest interval.
    pub longest_interval: f64,
    /// Rows whose time is not later than that of the previous row.
    pub not_later: u64,
}

/// Complete description of a file.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Inspection {
    /// File as the caller named it.
    pub file: String,
    /// Its format.
    pub format: String,
    /// Its size, bytes.
    pub bytes: u64,
    /// Its tables.
    pub tables: Vec<TableView>,
    /// The recording that would be read from it, or why none can be.
    pub recording: Result<RecordingPreview, String>,
}

/// A recording as it would be read.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RecordingPreview {
    /// Source of each quantity, in the syntax of `--columns`.
    pub columns: Vec<String>,
    /// Assumptions, and how topics were aligned in time.
    pub notes: Vec<String>,
    /// Data losses and doubts.
    pub warnings: Vec<String>,
    /// Samples examined.
    pub samples: usize,
    /// Their duration, s.
    pub duration_s: f64,
    /// Their range of positions, m.
    pub stroke_m: f64,
    /// Strokes between reversals.
    pub strokes: usize,
    /// Different speeds of insertion, m/s.
    pub insertion_speeds_m_s: Vec<f64>,
    /// Different speeds of withdrawal, m/s.
    pub withdrawal_speeds_m_s: Vec<f64>,
    /// Parameters that these samples cannot determine.
    pub limits: Vec<String>,
}

/// Inspects a file. Problems of its recording are part of the result.
///
/// # Errors
/// [`RecordingError`] when the file cannot be opened or its format is unknown.
pub fn inspect(path: &Path, choice: &Choice) -> Result<Inspection, RecordingError> {
    // A stream can be read only once.
    let is_there = std::fs::metadata(path).is_ok_and(|data| data.is_file() || data.is_dir());
    if path.as_os_str() == "-" || (path.exists() && !is_there) {
        let problem =
            "a stream, expected a file that can be read more than once\n\nhint: save it first";
        return Err(RecordingError::unusable(path.display(), problem));
    }
    let container = registry::any_after(path, choice.skip_rows)?;
    let tables = (0..container.tables.len()).map(|table| view(&container, table)).collect();
    let read = trocar_recording::read_in_words(
        path,
        &ReadOptions {
            choice: choice.clone(),
            most_samples: Some(SURVEYED),
            ..ReadOptions::default()
        },
    );
    Ok(Inspection {
        file: path.display().to_string(),
        format: container.format.to_owned(),
        bytes: std::fs::metadata(path).map_or(0, |data| data.len()),
        tables,
        recording: read
            .map_err(|error| error.to_string())
            .map(|(recording, columns)| RecordingPreview::of(&recording, columns)),
    })
}

impl RecordingPreview {
    fn of(recording: &Recording, columns: Vec<String>) -> Self {
        let survey = Survey::new(std::slice::from_ref(recording), &SegmentOptions::default());
        let own = &survey.recordings[0];
        Self {
            columns,
            notes: recording.quality.notes.clone(),
            warnings: recording.quality.warnings.iter().map(ToString::to_string).collect(),
            samples: own.samples,
            duration_s: own.duration,
            stroke_m: own.stroke,
            strokes: own.strokes,
            insertion_speeds_m_s: own.insertion_speeds.clone(),
            withdrawal_speeds_m_s: own.withdrawal_speeds.clone(),
            limits: survey.limits,
        }
    }
}

fn view(container: &Container, index: usize) -> TableView {
    let table = &container.tables[index];
    let numeric: Vec<usize> =
        (0..table.columns.len()).filter(|k| table.columns[*k].is_numeric).collect();
    let mut courses = vec![Course::default(); numeric.len()];
    let clock = clock_of(table, &numeric);
    let mut intervals = Intervals::default();
    let mut rows = 0;
    let mut look = || -> Result<(), RecordingError> {
        let mut batches = container.open(index, &numeric)?;
        let mut columns = vec![Vec::new(); numeric.len()];
        while batches.next(&mut columns)? {
            rows += columns.first().map_or(0, Vec::len) as u64;
            courses.iter_mut().zip(&columns).for_each(|(course, column)| course.take(column));
            if let Some((own, _)) = clock {
                intervals.take(&columns[own]);
            }
        }
        Ok(())
    };
    let damage =
        if numeric.is_empty() { None } else { look().err().map(|error| error.to_string()) };
    let mut columns: Vec<ColumnView> =
        table.columns.iter().map(|column| Course::default().view(column)).collect();
    for (course, k) in courses.into_iter().zip(&numeric) {
        columns[*k] = course.view(&table.columns[*k]);
    }
    TableView {
        name: table.name.clone(),
        kind: table.kind.clone(),
        rows: if numeric.is_empty() { table.rows.unwrap_or(0) } else { rows },
        clock: clock
            .filter(|_| rows > 1)
            .map(|(own, per_s)| intervals.clock(&columns[numeric[own]].name, per_s)),
        columns,
        damage,
    }
}

/// The first numeric column whose name is that of a time, with its unit; the index counts numeric
/// columns only.
fn clock_of(table: &Table, numeric: &[usize]) -> Option<(usize, Option<f64>)> {
    numeric.iter().enumerate().find_map(|(own, k)| {
        let column = &table.columns[*k];
        let per_s = trocar_recording::columns::time_unit(&column.name, column.unit.as_deref())?;
        Some((own, per_s))
    })
}

/// Incremental description of a column.
#[derive(Debug, Clone)]
struct Course {
    lowest: f64,
    highest: f64,
    not_finite: u64,
    last: f64,
    rises: bool,
    /// Sum and count of each group of rows.
    groups: Vec<(f64, u64)>,
    /// Rows in a full group.
    width: u64,
    /// Rows in the group being filled.
    filled: u64,
}

impl Default for Course {
    fn default() -> Self {
        let (lowest, highest, last) = (f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY);
        Self {
            lowest,
            highest,
            not_finite: 0,
            last,
            rises: true,
            groups: Vec::new(),
            width: 1,
            filled: 1,
        }
    }
}

impl Course {
    fn take(&mut self, values: &[f64]) {
        for &value in values {
            if self.filled == self.width {
                self.begin_group();
            }
            self.filled += 1;
            if !value.is_finite() {
                self.not_finite += 1;
                continue;
            }
            self.rises &= value >= self.last;
            self.last = value;
            self.lowest = self.lowest.min(value);
            self.highest = self.highest.max(value);
            if let Some((sum, count)) = self.groups.last_mut() {
                (*sum, *count) = (*sum + value, *count + 1);
            }
        }
    }

    /// Merges groups in pairs once there are too many.
    fn begin_group(&mut self) {
        if self.groups.len() == SPARK {
            self.groups = self
                .groups
                .chunks(2)
                .map(|pair| (pair[0].0 + pair[1].0, pair[0].1 + pair[1].1))
                .collect();
            self.width *= 2;
        }
        self.groups.push((0.0, 0));
        self.filled = 0;
    }

    fn view(self, column: &trocar_recording::Column) -> ColumnView {
        let seen = self.lowest <= self.highest;
        // Rounding makes no mean of equal values another value.
        let groups = self.groups.iter().filter(|(_, count)| *count > 0);
        let means =
            groups.map(|(sum, count)| (sum / *count as f64).clamp(self.lowest, self.highest));
        ColumnView {
            name: column.name.clone(),
            unit: column
                .unit
                .clone()
                .or_else(|| trocar_recording::columns::unit_in(&column.name).map(str::to_owned)),
            lowest: seen.then_some(self.lowest),
            highest: seen.then_some(self.highest),
            not_finite: self.not_finite,
            course: means.filter(|mean| mean.is_finite()).collect(),
            rises: seen && self.rises && self.lowest < self.highest,
        }
    }
}

/// Incremental description of a clock.
#[derive(Default)]
struct Intervals {
    first: Option<f64>,
    last: f64,
    /// The first intervals.
    kept: Vec<f64>,
    /// Three times the 95 % quantile of those, once there are enough.
    limit: Option<f64>,
    gaps: u64,
    longest: f64,
    not_later: u64,
}

impl Intervals {
    fn take(&mut self, times: &[f64]) {
        for &time in times.iter().filter(|time| time.is_finite()) {
            if self.first.replace(self.first.unwrap_or(time)).is_some() {
                self.interval(time - self.last);
            }
            self.last = time;
        }
    }

    fn interval(&mut self, interval: f64) {
        self.not_later += u64::from(interval <= 0.0);
        self.longest = self.longest.max(interval);
        if let Some(limit) = self.limit {
            self.gaps += u64::from(interval > limit);
            return;
        }
        self.kept.push(interval);
        if self.kept.len() == INTERVALS {
            self.settle();
        }
    }

    fn settle(&mut self) {
        self.kept.sort_by(f64::total_cmp);
        let usual = self.kept.get(self.kept.len() * 95 / 100).copied().unwrap_or(0.0);
        self.limit = Some(GAP_FACTOR * usual);
        self.gaps =
            self.kept.iter().filter(|interval| **interval > GAP_FACTOR * usual).count() as u64;
    }

    fn clock(mut self, column: &str, per_s: Option<f64>) -> Clock {
        if self.limit.is_none() {
            self.settle();
        }
        Clock {
            column: column.to_owned(),
            per_s,
            duration: self.last - self.first.unwrap_or(self.last),
            median_interval: self.kept.get(self.kept.len() / 2).copied().unwrap_or(0.0),
            gaps: self.gaps,
            longest_interval: self.longest,
            not_later: self.not_later,
        }
    }
}
