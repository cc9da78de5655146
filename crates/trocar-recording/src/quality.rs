//! Properties of the data: sampling, noise, and everything lost or doubtful.

use serde::{Deserialize, Serialize};

/// Rows with the same fault.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct RowList {
    /// Number of rows.
    pub count: usize,
    /// Lines of the first ones (samples, counted from 0, when there is no file).
    pub lines: Vec<u64>,
}

/// Largest number of lines listed.
const LISTED: usize = 20;

impl RowList {
    pub(super) fn add(&mut self, line: u64) {
        self.count += 1;
        if self.lines.len() < LISTED {
            self.lines.push(line);
        }
    }

    /// The lines as text, `lines 3, 7, 9, ...`.
    pub(super) fn places(&self, unit: &str) -> String {
        let shown: Vec<String> = self.lines.iter().take(5).map(u64::to_string).collect();
        let plural = if self.count == 1 { "" } else { "s" };
        let more = if self.count > shown.len() { ", ..." } else { "" };
        format!("{unit}{plural} {}{more}", shown.join(", "))
    }
}

/// Most rows without a time at the end of a table that are left out: mean, range and the like.
pub(crate) const LONGEST_FOOTER: usize = 64;

/// The warning about rows that repeat the header.
pub(crate) fn warn_of_repeated(rows: &RowList, unit: &str) -> Option<String> {
    let what = if rows.count == 1 {
        format!("{unit} that repeats")
    } else {
        format!("{unit}s that repeat")
    };
    (rows.count > 0)
        .then(|| format!("{} {what} the header left out: {}", rows.count, rows.places(unit)))
}

/// The warning about rows of text at the end.
pub(crate) fn warn_of_footer(rows: &RowList, unit: &str) -> Option<String> {
    let plural = if rows.count == 1 { "" } else { "s" };
    (rows.count > 0).then(|| {
        format!(
            "{} {unit}{plural} of text at the end of the table left out: {}",
            rows.count,
            rows.places(unit)
        )
    })
}

/// Rows of text of which it is not yet known whether they are the end of a sheet.
#[cfg(feature = "xlsx")]
#[derive(Default)]
pub(crate) struct Footer {
    rows: RowList,
    first: Option<super::RecordingError>,
}

#[cfg(feature = "xlsx")]
impl Footer {
    /// Adds a row; `error` is returned if there are too many of them.
    pub(crate) fn add(
        &mut self,
        row: u64,
        error: super::RecordingError,
    ) -> Option<super::RecordingError> {
        self.rows.add(row);
        self.first.get_or_insert(error);
        self.first.take_if(|_| self.rows.count > LONGEST_FOOTER)
    }

    /// Numbers follow: the error of the first row, if there is one.
    pub(crate) fn end(&mut self) -> Option<super::RecordingError> {
        self.first.take()
    }

    /// The warning, if these rows were the end.
    pub(crate) fn warning(&self) -> Option<String> {
        self.first.as_ref().and_then(|_| warn_of_footer(&self.rows, "row"))
    }
}

/// An interval without samples.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Gap {
    /// First sample after the gap.
    pub index: usize,
    /// Its line in the file.
    pub line: u64,
    /// Last time before the gap.
    #[serde(rename = "from_s")]
    pub from: f64,
    /// First time after the gap.
    #[serde(rename = "to_s")]
    pub to: f64,
}

/// A jump of the position that is no motion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Reset {
    /// First sample after the jump.
    pub index: usize,
    /// Its line in the file.
    pub line: u64,
    /// Size of the jump.
    #[serde(rename = "jump_m")]
    pub jump: f64,
}

/// Force readings constant at the limit of the sensor's range.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Saturation {
    /// Number of samples.
    pub count: usize,
    /// The limit, N.
    #[serde(rename = "level_n")]
    pub level: f64,
    /// Line of the first.
    pub first_line: u64,
}

/// Kind of loss or doubt.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum WarningKind {
    /// Intervals without samples.
    Gaps,
    /// Intervals scatter widely.
    Jitter,
    /// Rows that repeat the previous one, or its time.
    RepeatedRows,
    /// Rows out of order by less than a sampling interval.
    UnorderedRows,
    /// Rows with an empty, NaN or infinite cell.
    NonFiniteRows,
    /// Rows that repeat an old position during motion.
    HeldRows,
    /// Force constant at the limit of the sensor's range.
    Saturation,
    /// Position jumps.
    Resets,
    /// The stroke is so short that the unit is doubtful.
    Stroke,
    /// Intervals, forces or a moving mass of a size that makes their unit doubtful.
    Units,
    /// The force opposes the motion.
    ForceSign,
    /// The file itself is damaged, or its topics contradict each other.
    Source,
}

/// One loss or doubt, for the user.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Warning {
    /// Its kind.
    pub kind: WarningKind,
    /// The finding and its location.
    pub message: String,
    /// The remedy, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hint: Option<String>,
}

impl Warning {
    /// A finding without a remedy.
    pub(crate) fn new(kind: WarningKind, message: String) -> Self {
        Self { kind, message, hint: None }
    }
}

/// Quality of a recording. Values are in SI units; keys in JSON include the unit.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Quality {
    /// Median interval between samples.
    #[serde(rename = "median_interval_s")]
    pub median_interval: f64,
    /// Root mean square deviation of the intervals from their median, without gaps.
    #[serde(rename = "jitter_s")]
    pub jitter: f64,
    /// Longest interval.
    #[serde(rename = "longest_interval_s")]
    pub longest_interval: f64,
    /// Range of the position.
    #[serde(rename = "stroke_m")]
    pub stroke: f64,
    /// Intervals without samples.
    pub gaps: Vec<Gap>,
    /// Rows equal to the previous one, or with the same time; omitted.
    pub repeated_rows: RowList,
    /// Rows whose time is less than one interval before the previous row's; omitted.
    pub unordered_rows: RowList,
    /// Rows with an empty, NaN or infinite cell; omitted.
    pub non_finite_rows: RowList,
    /// Rows that repeat an old position during motion, as after a stall of the logger; left
    /// unchanged.
    pub held_rows: RowList,
    /// Force constant at the limit of the sensor's range, at most one entry per limit.
    pub saturated: Vec<Saturation>,
    /// Position jumps.
    pub resets: Vec<Reset>,
    /// Samples at which a new unbroken part begins: after gaps and resets, in order.
    pub breaks: Vec<usize>,
    /// Mass whose inertia has been subtracted from the force, kg; the notes say so, too.
    #[serde(skip)]
    pub subtracted_mass: f64,
    /// Step of which all positions are integer multiples (encoder or printed digits); 0 if none was
    /// found.
    #[serde(rename = "position_resolution_m")]
    pub position_resolution: f64,
    /// Robust standard deviation of the position about its neighbours.
    #[serde(rename = "position_noise_m")]
    pub position_noise: f64,
    /// Step of which all forces are integer multiples; 0 if none was found.
    #[serde(rename = "force_resolution_n")]
    pub force_resolution: f64,
    /// Robust standard deviation of the force about its neighbours.
    #[serde(rename = "force_noise_n")]
    pub force_noise: f64,
    /// Whether the force opposes the motion throughout, as with a sensor mounted in the opposite
    /// direction.
    pub force_opposes_motion: bool,
    /// Everything lost or doubtful; if not empty, the exit code is 3.
    pub warnings: Vec<Warning>,
    /// Assumptions made, such as the columns used.
    pub notes: Vec<String>,
}

impl std::fmt::Display for Warning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.message)?;
        self.hint.iter().try_for_each(|hint| write!(f, "\n\nhint: {hint}"))
    }
}
