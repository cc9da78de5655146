//! One row of the table: plain columns, the same for every recording, so that any engine can
//! combine them.

use serde::{Deserialize, Serialize};
use trocar_model::ParameterId;

use trocar_tables::option::{Interface, spelt};
use trocar_tables::table::{Field, Kind};

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

/// Columns of a recording before its parameters.
const BEFORE: [(&str, Kind); 13] = [
    ("path", Kind::Text),
    ("recording", Kind::Text),
    ("sha256", Kind::Text),
    ("program", Kind::Text),
    ("config", Kind::Text),
    ("depth", Kind::Text),
    ("status", Kind::Text),
    ("reason_kind", Kind::Text),
    ("reason", Kind::Text),
    ("warning_count", Kind::Integer),
    ("warnings", Kind::Text),
    ("samples", Kind::Integer),
    ("duration_s", Kind::Number),
];

/// Columns of the data and of the fit, after the parameters.
const TRAILING: [(&str, Kind); 36] = [
    ("method", Kind::Text),
    ("residual_rms_n", Kind::Number),
    ("force_rms_n", Kind::Number),
    ("free_parameters", Kind::Integer),
    ("deformation_missing", Kind::Text),
    ("stroke_mean_scatter_n", Kind::Number),
    ("friction_scatter", Kind::Number),
    ("friction_drift", Kind::Number),
    ("friction_jump_ratio", Kind::Number),
    ("friction_jump_s", Kind::Number),
    ("terms", Kind::Text),
    ("position_delay_s", Kind::Number),
    ("position_profile_knots", Kind::Integer),
    ("position_profile_held_out_rms_n", Kind::Number),
    ("position_profile_constant_held_out_rms_n", Kind::Number),
    ("slowest_steady_m_s", Kind::Number),
    ("fastest_steady_m_s", Kind::Number),
    ("steady_strokes", Kind::Integer),
    ("full_reversals", Kind::Integer),
    ("reversals", Kind::Integer),
    ("partial_reversals", Kind::Integer),
    ("held_s", Kind::Number),
    ("stroke_m", Kind::Number),
    ("median_interval_s", Kind::Number),
    ("jitter_s", Kind::Number),
    ("longest_interval_s", Kind::Number),
    ("gaps", Kind::Integer),
    ("resets", Kind::Integer),
    ("saturated_samples", Kind::Integer),
    ("dropped_rows", Kind::Integer),
    ("held_rows", Kind::Integer),
    ("position_resolution_m", Kind::Number),
    ("position_noise_m", Kind::Number),
    ("force_resolution_n", Kind::Number),
    ("force_noise_n", Kind::Number),
    ("moving_mass_kg", Kind::Number),
];

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
    let fixed = |(name, kind): &(&str, Kind)| Field::new(*name, *kind);
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

    /// Fills a cell. A name that is not a column is a bug of this module and is ignored.
    pub(super) fn set(&mut self, name: &str, cell: FleetCell) {
        debug_assert!(place(name).is_some(), "no column {name}");
        if let Some(at) = place(name) {
            self.cells[at] = cell;
        }
    }
}
