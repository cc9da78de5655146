//! One row of the table: plain columns, the same for every recording, so that any engine can
//! combine them.

use serde::{Deserialize, Serialize};
use trocar_model::ParameterId;

use trocar_identify::Identification;
use trocar_recording::Recording;
use trocar_tables::option::{Interface, spelt};
use trocar_tables::table::Field;
use trocar_tables::table::Kind::{self, Integer, Number, Text};

use self::FleetCell as Cell;
use self::Origin::{Data, Fit, Fleet};

/// A cell; empty without a value.
///
/// Numbers are finite: an unbounded end of an interval is empty.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(untagged)]
pub enum FleetCell {
    /// Nothing.
    #[default]
    Empty,
    /// A Boolean.
    Boolean(bool),
    /// An integer.
    Integer(i64),
    /// A number.
    Float(f64),
    /// Text.
    Text(String),
}

impl FleetCell {
    /// A number; empty unless it is finite.
    pub fn number(value: f64) -> Self {
        if value.is_finite() { Self::Float(value) } else { Self::Empty }
    }

    /// A count.
    pub fn count(value: usize) -> Self {
        Self::Integer(value as i64)
    }

    /// Text.
    pub fn text(value: impl Into<String>) -> Self {
        Self::Text(value.into())
    }

    /// An error or warning; options that it names are written as on the command line.
    pub(super) fn message(text: &str) -> Self {
        Self::Text(spelt(text, Interface::CommandLine))
    }

    /// The number in the cell, if any.
    pub fn as_number(&self) -> Option<f64> {
        match self {
            Self::Float(value) => Some(*value),
            Self::Integer(value) => Some(*value as f64),
            _ => None,
        }
    }

    /// The text in the cell, if any.
    pub fn as_text(&self) -> Option<&str> {
        if let Self::Text(text) = self { Some(text) } else { None }
    }

    /// The content as text.
    pub fn in_words(&self) -> String {
        match self {
            Self::Empty => String::new(),
            Self::Boolean(value) => value.to_string(),
            Self::Integer(value) => value.to_string(),
            Self::Float(value) => value.to_string(),
            Self::Text(text) => text.clone(),
        }
    }

    /// Kind of the content; `None` for an empty cell.
    pub fn kind(&self) -> Option<Kind> {
        match self {
            Self::Empty => None,
            Self::Boolean(_) => Some(Kind::Boolean),
            Self::Integer(_) => Some(Kind::Integer),
            Self::Float(_) => Some(Kind::Number),
            Self::Text(_) => Some(Kind::Text),
        }
    }
}

impl From<Option<f64>> for FleetCell {
    fn from(value: Option<f64>) -> Self {
        value.map_or(Self::Empty, Self::number)
    }
}

/// Degrees of the polynomials of both branches, EMS (25); the table has a fixed set of columns.
pub(super) const DEGREES: [usize; 2] = [4, 4];

/// A column: its name, what its cells are, and where they come from.
type Column = (&'static str, Kind, Origin);

/// Where the cells of a column come from.
#[derive(Clone, Copy)]
enum Origin {
    /// What the fleet knows of the recording, or the outcome as a whole.
    Fleet,
    Data(fn(&Recording) -> FleetCell),
    Fit(fn(&Identification) -> FleetCell),
}

/// Columns of a recording before its parameters.
const BEFORE: [Column; 13] = [
    ("path", Text, Fleet),
    ("recording", Text, Data(|r| Cell::text(&r.name))),
    ("sha256", Text, Data(|r| Cell::text(&r.sha256))),
    ("program", Text, Fleet),
    ("config", Text, Fleet),
    ("depth", Text, Fleet),
    ("status", Text, Fleet),
    ("reason_kind", Text, Fleet),
    ("reason", Text, Fleet),
    ("warning_count", Integer, Fleet),
    ("warnings", Text, Fleet),
    ("samples", Integer, Data(|r| Cell::count(r.len()))),
    ("duration_s", Number, Data(|r| Cell::number(r.duration()))),
];

/// Columns of the data and of the fit, after the parameters.
const TRAILING: [Column; 36] = [
    ("method", Text, Fit(|f| Cell::text(if f.fit.is_some() { "fit" } else { "two_steps" }))),
    ("residual_rms_n", Number, Fit(|f| Cell::number(f.residual_rms))),
    ("force_rms_n", Number, Data(|r| Cell::number(rms(&r.force)))),
    ("free_parameters", Integer, Fit(|f| Cell::count(f.free_parameters))),
    (
        "deformation_missing",
        Text,
        Fit(|f| f.deformation.as_ref().err().map_or(Cell::Empty, |why| Cell::message(why))),
    ),
    ("stroke_mean_scatter_n", Number, Fit(|f| Cell::number(f.steady.stroke_mean_scatter_n))),
    ("friction_scatter", Number, Fit(|f| Cell::number(f.friction_scale.scatter))),
    ("friction_drift", Number, Fit(|f| Cell::number(f.friction_scale.drift))),
    (
        "friction_jump_ratio",
        Number,
        Fit(|f| f.friction_scale.jumps.first().map(|j| j.ratio).into()),
    ),
    ("friction_jump_s", Number, Fit(|f| f.friction_scale.jumps.first().map(|j| j.time_s).into())),
    ("terms", Text, Fit(terms)),
    ("position_delay_s", Number, Fit(|f| f.position_delay.map(|lag| lag.delay_s).into())),
    (
        "position_profile_knots",
        Integer,
        Fit(|f| {
            f.position_profile
                .as_ref()
                .map_or(Cell::Empty, |p| Cell::count(p.profile.gains().len()))
        }),
    ),
    (
        "position_profile_held_out_rms_n",
        Number,
        Fit(|f| f.position_profile.as_ref().map(|p| p.held_out_rms_n).into()),
    ),
    (
        "position_profile_constant_held_out_rms_n",
        Number,
        Fit(|f| f.position_profile.as_ref().map(|p| p.constant_held_out_rms_n).into()),
    ),
    ("slowest_steady_m_s", Number, Fit(|f| steady_speed(f, 0))),
    ("fastest_steady_m_s", Number, Fit(|f| steady_speed(f, 1))),
    ("steady_strokes", Integer, Fit(|f| Cell::count(f.steady.means.len()))),
    (
        "full_reversals",
        Integer,
        Fit(|f| {
            f.deformation.as_ref().map_or(Cell::Empty, |d| Cell::count(d.full_reversals.len()))
        }),
    ),
    ("reversals", Integer, Fit(|f| Cell::count(f.free_motion.reversals))),
    ("partial_reversals", Integer, Fit(|f| Cell::count(f.free_motion.partial_reversals))),
    ("held_s", Number, Fit(|f| Cell::number(f.free_motion.held_s))),
    ("stroke_m", Number, Data(|r| Cell::number(r.quality.stroke))),
    ("median_interval_s", Number, Data(|r| Cell::number(r.quality.median_interval))),
    ("jitter_s", Number, Data(|r| Cell::number(r.quality.jitter))),
    ("longest_interval_s", Number, Data(|r| Cell::number(r.quality.longest_interval))),
    ("gaps", Integer, Data(|r| Cell::count(r.quality.gaps.len()))),
    ("resets", Integer, Data(|r| Cell::count(r.quality.resets.len()))),
    (
        "saturated_samples",
        Integer,
        Data(|r| Cell::count(r.quality.saturated.iter().map(|s| s.count).sum())),
    ),
    ("dropped_rows", Integer, Data(dropped_rows)),
    ("held_rows", Integer, Data(|r| Cell::count(r.quality.held_rows.count))),
    ("position_resolution_m", Number, Data(|r| Cell::number(r.quality.position_resolution))),
    ("position_noise_m", Number, Data(|r| Cell::number(r.quality.position_noise))),
    ("force_resolution_n", Number, Data(|r| Cell::number(r.quality.force_resolution))),
    ("force_noise_n", Number, Data(|r| Cell::number(r.quality.force_noise))),
    ("moving_mass_kg", Number, Fleet),
];

/// Root mean square about the mean.
fn rms(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
}

fn dropped_rows(recording: &Recording) -> Cell {
    let q = &recording.quality;
    Cell::count(q.repeated_rows.count + q.unordered_rows.count + q.non_finite_rows.count)
}

fn terms(found: &Identification) -> Cell {
    let Some(fit) = &found.fit else { return Cell::Empty };
    let kept: Vec<&str> = fit.terms.iter().filter(|t| t.kept).map(|t| t.term.name()).collect();
    Cell::text(kept.join(" "))
}

/// The slowest or the fastest speed of steady sliding.
fn steady_speed(found: &Identification, end: usize) -> Cell {
    let steady = &found.steady;
    (!steady.means.is_empty()).then_some(steady.speed_range_m_s[end]).into()
}

/// All parameters that an identification may report.
pub(super) fn parameters() -> Vec<ParameterId> {
    trocar_identify::reported(DEGREES)
}

/// Columns of a parameter: the ends of their names after its own, and their kinds.
pub(super) const ENDS: [(&str, Kind); 4] = [
    ("", Kind::Number),
    ("_lower", Kind::Number),
    ("_upper", Kind::Number),
    ("_determined", Kind::Boolean),
];

/// The columns of every [`FleetRow`], in order.
pub fn columns() -> Vec<Field> {
    let fixed = |(name, kind, _): &Column| Field::new(*name, *kind);
    let mut all: Vec<Field> = BEFORE.iter().map(fixed).collect();
    for name in parameters() {
        all.extend(ENDS.map(|(end, kind)| Field::new(format!("{name}{end}"), kind)));
    }
    all.extend(TRAILING.iter().map(fixed));
    all
}

/// Result of one recording, in the order of [`columns`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FleetRow {
    /// The cells.
    pub cells: Vec<FleetCell>,
}

thread_local! {
    /// Index of each column.
    static PLACES: std::collections::HashMap<String, usize> =
        columns().into_iter().map(|column| column.name).zip(0..).collect();
}

/// Index of a column in every row.
pub fn place(name: &str) -> Option<usize> {
    PLACES.with(|places| places.get(name).copied())
}

impl FleetRow {
    /// An empty row.
    pub(super) fn empty() -> Self {
        Self { cells: vec![FleetCell::Empty; PLACES.with(std::collections::HashMap::len)] }
    }

    /// The cell in the column of that name; `None` if there is no such column.
    pub fn get(&self, name: &str) -> Option<&FleetCell> {
        place(name).and_then(|at| self.cells.get(at))
    }

    /// The number in the column of that name.
    pub fn number(&self, name: &str) -> Option<f64> {
        self.get(name)?.as_number()
    }

    /// The text in the column of that name.
    pub fn text(&self, name: &str) -> Option<&str> {
        self.get(name)?.as_text()
    }

    /// Fills the columns of the data.
    pub(super) fn set_data(&mut self, recording: &Recording) {
        for (name, _, origin) in BEFORE.iter().chain(&TRAILING) {
            if let Data(of) = origin {
                self.set(name, of(recording));
            }
        }
    }

    /// Fills the columns of the fit.
    pub(super) fn set_fit(&mut self, found: &Identification) {
        for (name, _, origin) in BEFORE.iter().chain(&TRAILING) {
            if let Fit(of) = origin {
                self.set(name, of(found));
            }
        }
    }

    /// Fills a cell. A name that is not a column is a bug of this module and is ignored.
    pub(super) fn set(&mut self, name: &str, cell: FleetCell) {
        debug_assert!(place(name).is_some(), "no column {name}");
        if let Some(at) = place(name) {
            self.cells[at] = cell;
        }
    }
}
