//! One line of the table: plain columns, the same for every recording, so that any engine can put them together.

use serde::{Deserialize, Serialize};

/// What a cell of a column holds when it is not empty.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// A number.
    Float,
    /// A whole number.
    Integer,
    /// Yes or no.
    Flag,
    /// Text in UTF-8.
    Text,
}

/// A column of the table.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct Column {
    /// Name with unit.
    pub name: String,
    /// What its cells hold.
    pub kind: Kind,
}

impl std::hash::Hash for Kind {
    fn hash<H: std::hash::Hasher>(&self, state: &mut H) {
        (*self as u8).hash(state);
    }
}

/// A cell; empty where there is nothing to say.
///
/// Numbers are finite: an unbounded end of an interval is empty.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Cell {
    /// Nothing.
    #[default]
    Empty,
    /// Yes or no.
    Flag(bool),
    /// A whole number.
    Integer(i64),
    /// A number.
    Float(f64),
    /// Text.
    Text(String),
}

impl Cell {
    /// A number; empty unless it is finite.
    pub fn number(value: f64) -> Self {
        if value.is_finite() { Self::Float(value) } else { Self::Empty }
    }

    /// A number of things.
    pub fn count(value: usize) -> Self {
        Self::Integer(value as i64)
    }

    /// Text.
    pub fn text(value: impl Into<String>) -> Self {
        Self::Text(value.into())
    }

    /// The number in it, if it holds one.
    pub fn as_number(&self) -> Option<f64> {
        match self {
            Self::Float(value) => Some(*value),
            Self::Integer(value) => Some(*value as f64),
            _ => None,
        }
    }

    /// The text in it, if it holds one.
    pub fn as_text(&self) -> Option<&str> {
        if let Self::Text(text) = self { Some(text) } else { None }
    }

    /// What it holds; `None` for an empty one.
    pub fn kind(&self) -> Option<Kind> {
        match self {
            Self::Empty => None,
            Self::Flag(_) => Some(Kind::Flag),
            Self::Integer(_) => Some(Kind::Integer),
            Self::Float(_) => Some(Kind::Float),
            Self::Text(_) => Some(Kind::Text),
        }
    }
}

impl From<Option<f64>> for Cell {
    fn from(value: Option<f64>) -> Self {
        value.map_or(Self::Empty, Self::number)
    }
}

/// Names, without the ends `_lower`, `_upper` and `_pinned`, of all parameters that an element can have.
const PARAMETERS: [&str; 25] = [
    "offset_n",
    "coulomb_force_n",
    "coulomb_force_n_positive",
    "coulomb_force_n_negative",
    "viscous_damping_n_s_m",
    "viscous_damping_n_s_m_positive",
    "viscous_damping_n_s_m_negative",
    "static_force_n",
    "stribeck_velocity_m_s",
    "half_width_m",
    "seal_damping_n_s_m",
    "hidden_mass_kg",
    "yield_stiffness_n_m",
    "creep_velocity_m_s",
    "friction_lag_s",
    "relaxation_stiffness_n_m",
    "relaxation_time_s",
    "second_relaxation_stiffness_n_m",
    "second_relaxation_time_s",
    "second_coulomb_force_n",
    "second_half_width_m",
    "rising_join_m",
    "rising_join_force_n",
    "falling_join_m",
    "falling_join_force_n",
];

/// Degrees of the polynomials of both branches, EMS (25); a table has one set of columns.
pub(super) const DEGREES: [usize; 2] = [4, 4];

/// What is said of a recording before its parameters.
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
    ("duration_s", Kind::Float),
];

/// What is said of the data and of the fit, behind the parameters.
const BEHIND: [(&str, Kind); 36] = [
    ("method", Kind::Text),
    ("residual_rms_n", Kind::Float),
    ("force_rms_n", Kind::Float),
    ("free_parameters", Kind::Integer),
    ("deformation_missing", Kind::Text),
    ("pass_scatter_n", Kind::Float),
    ("refinement_accepted", Kind::Flag),
    ("held_out_two_step_rms_n", Kind::Float),
    ("held_out_refined_rms_n", Kind::Float),
    ("free_motion_held_out_rms_n", Kind::Float),
    ("ingredients", Kind::Text),
    ("position_lag_s", Kind::Float),
    ("travel_knots", Kind::Integer),
    ("travel_held_out_rms_n", Kind::Float),
    ("travel_constant_held_out_rms_n", Kind::Float),
    ("slowest_steady_m_s", Kind::Float),
    ("fastest_steady_m_s", Kind::Float),
    ("steady_passes", Kind::Integer),
    ("traverses", Kind::Integer),
    ("reversals", Kind::Integer),
    ("partial_reversals", Kind::Integer),
    ("held_s", Kind::Float),
    ("stroke_m", Kind::Float),
    ("median_interval_s", Kind::Float),
    ("jitter_s", Kind::Float),
    ("longest_interval_s", Kind::Float),
    ("gaps", Kind::Integer),
    ("resets", Kind::Integer),
    ("saturated_samples", Kind::Integer),
    ("dropped_rows", Kind::Integer),
    ("held_rows", Kind::Integer),
    ("position_resolution_m", Kind::Float),
    ("position_noise_m", Kind::Float),
    ("force_resolution_n", Kind::Float),
    ("force_noise_n", Kind::Float),
    ("moving_mass_kg", Kind::Float),
];

/// The paper's θ (25) of both branches, and with all other parameters.
pub(super) fn parameter_names() -> Vec<String> {
    const UNITS: [&str; 8] = ["n", "n_m1", "n_m2", "n_m3", "n_m4", "n_m5", "n_m6", "n_m7"];
    let mut all: Vec<String> = PARAMETERS.map(str::to_owned).into();
    for side in ["rising", "falling"] {
        for (piece, degree) in DEGREES.into_iter().enumerate() {
            let theta = |(power, unit): (usize, &&str)| format!("{side}_theta{}_{power}_{unit}", piece + 1);
            all.extend(UNITS.iter().enumerate().take(degree + 1).map(theta));
        }
    }
    all
}

/// The columns of every [`Row`], in order.
pub fn columns() -> Vec<Column> {
    let fixed = |(name, kind): &(&str, Kind)| Column { name: (*name).to_owned(), kind: *kind };
    let mut all: Vec<Column> = BEFORE.iter().map(fixed).collect();
    for name in parameter_names() {
        let end = |(end, kind)| Column { name: format!("{name}{end}"), kind };
        let ends = [("", Kind::Float), ("_lower", Kind::Float), ("_upper", Kind::Float), ("_pinned", Kind::Flag)];
        all.extend(ends.map(end));
    }
    all.extend(BEHIND.iter().map(fixed));
    all
}

/// What one recording gave, in the order of [`columns`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// The cells.
    pub cells: Vec<Cell>,
}

thread_local! {
    /// Place of each column.
    static PLACES: std::collections::HashMap<String, usize> =
        columns().into_iter().map(|column| column.name).zip(0..).collect();
}

/// Place of a column in every row.
pub fn place(name: &str) -> Option<usize> {
    PLACES.with(|places| places.get(name).copied())
}

impl Row {
    /// A row without anything in it.
    pub(super) fn empty() -> Self {
        Self { cells: vec![Cell::Empty; PLACES.with(std::collections::HashMap::len)] }
    }

    /// The cell in the column of that name; `None` where there is no such column.
    pub fn get(&self, name: &str) -> Option<&Cell> {
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

    /// Fills a cell; a name that is no column is a mistake of this module and is passed over.
    pub(super) fn set(&mut self, name: &str, cell: Cell) {
        debug_assert!(place(name).is_some(), "no column {name}");
        if let Some(at) = place(name) {
            self.cells[at] = cell;
        }
    }
}
