//! What is known about the data themselves: sampling, noise, and everything lost or doubtful.

use serde::{Deserialize, Serialize};

/// Rows with a fault in common.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct RowList {
    /// How many.
    pub count: usize,
    /// Lines of the first ones (samples, counted from 0, when there is no file).
    pub lines: Vec<u64>,
}

/// Lines listed of dropped rows.
const LISTED: usize = 20;

impl RowList {
    pub(super) fn add(&mut self, line: u64) {
        self.count += 1;
        if self.lines.len() < LISTED {
            self.lines.push(line);
        }
    }

    /// The places in words, `lines 3, 7, 9, ...`.
    pub(super) fn places(&self, unit: &str) -> String {
        let shown: Vec<String> = self.lines.iter().take(5).map(u64::to_string).collect();
        let plural = if self.count == 1 { "" } else { "s" };
        let more = if self.count > shown.len() { ", ..." } else { "" };
        format!("{unit}{plural} {}{more}", shown.join(", "))
    }
}

/// Time without samples.
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

/// A jump of the position that no motion explains.
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

/// Force readings stuck at the end of the sensor's range.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Saturation {
    /// Samples concerned.
    pub count: usize,
    /// The reading they are stuck at.
    #[serde(rename = "level_n")]
    pub level: f64,
    /// Line of the first.
    pub first_line: u64,
}

/// Which kind of loss or doubt a warning is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum WarningKind {
    /// Time without samples.
    Gaps,
    /// Intervals scatter widely.
    Jitter,
    /// Rows that repeat the one before, or its time.
    RepeatedRows,
    /// Rows out of order by less than a sampling interval.
    UnorderedRows,
    /// Rows with an empty, NaN or infinite cell.
    NonFiniteRows,
    /// Rows that hold an old position in the middle of motion.
    HeldRows,
    /// Force stuck at the end of the sensor's range.
    Saturation,
    /// Position jumps.
    Resets,
    /// The stroke is so short that the unit is doubtful.
    Stroke,
    /// The force opposes the motion.
    ForceSign,
    /// The file itself is damaged, or its topics contradict each other.
    Source,
}

/// One loss or doubt, for people to read.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Warning {
    /// What it is about.
    pub kind: WarningKind,
    /// What was found and where.
    pub message: String,
    /// The way out, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hint: Option<String>,
}

/// What was found about a recording. Numbers are SI; keys in JSON carry the unit.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Quality {
    /// Median interval between samples.
    #[serde(rename = "median_interval_s")]
    pub median_interval: f64,
    /// Root mean square deviation of the intervals from their median, gaps left out.
    #[serde(rename = "jitter_s")]
    pub jitter: f64,
    /// Longest interval.
    #[serde(rename = "longest_interval_s")]
    pub longest_interval: f64,
    /// Range of the position.
    #[serde(rename = "stroke_m")]
    pub stroke: f64,
    /// Times without samples.
    pub gaps: Vec<Gap>,
    /// Rows equal to the one before, or with the same time; left out.
    pub repeated_rows: RowList,
    /// Rows whose time lies less than one interval before the row above; left out.
    pub unordered_rows: RowList,
    /// Rows with an empty, NaN or infinite cell; left out.
    pub non_finite_rows: RowList,
    /// Rows that hold an old position in the middle of motion, as when the logger stalled; left as they are.
    pub held_rows: RowList,
    /// Force stuck at the end of the sensor's range, at most one entry per end.
    pub saturated: Vec<Saturation>,
    /// Position jumps.
    pub resets: Vec<Reset>,
    /// Samples at which a new stretch begins: after gaps and resets, in order.
    pub breaks: Vec<usize>,
    /// Step of which all positions are whole multiples (encoder or printed digits); 0 if none was found.
    #[serde(rename = "position_resolution_m")]
    pub position_resolution: f64,
    /// Robust standard deviation of the position about its neighbours.
    #[serde(rename = "position_noise_m")]
    pub position_noise: f64,
    /// Step of which all forces are whole multiples; 0 if none was found.
    #[serde(rename = "force_resolution_n")]
    pub force_resolution: f64,
    /// Robust standard deviation of the force about its neighbours.
    #[serde(rename = "force_noise_n")]
    pub force_noise: f64,
    /// Whether the force opposes the motion throughout, as with a sensor mounted the other way round.
    pub force_opposes_motion: bool,
    /// Everything lost or doubtful; not empty means exit code 3.
    pub warnings: Vec<Warning>,
    /// What was assumed, such as which columns were taken.
    pub notes: Vec<String>,
}

impl std::fmt::Display for Warning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.message)?;
        self.hint.iter().try_for_each(|hint| write!(f, "\n\nhint: {hint}"))
    }
}
