//! One recording to one row of the fleet's table; `trocar.fleet` wraps it.

use std::path::PathBuf;

use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use trocar::fleet::{Cell, Config, Depth, Input, Kind, identify_one};
use trocar::recording::ReadOptions;

use crate::errors::ParameterError;
use crate::recording::{check_limit, readings_of_frame};
use crate::shared::moving_mass;
use crate::work::{How, run};

/// How to identify each recording.
#[pyclass(module = "trocar._core", frozen)]
pub(crate) struct FleetConfig(Config);

#[pymethods]
impl FleetConfig {
    #[new]
    #[pyo3(signature = (*, depth, bootstrap, seed, moving_mass_kg, gravity_m_s2, columns, flip_force, sensor_limit_n,
        memory_limit_bytes))]
    #[allow(clippy::too_many_arguments)] // keywords in Python
    fn new(
        depth: &str,
        bootstrap: usize,
        seed: u64,
        moving_mass_kg: f64,
        gravity_m_s2: f64,
        columns: Option<String>,
        flip_force: bool,
        sensor_limit_n: Option<f64>,
        memory_limit_bytes: Option<u64>,
    ) -> PyResult<Self> {
        let all = [Depth::Quick, Depth::Full];
        let depth = all.into_iter().find(|known| known.name() == depth).ok_or_else(|| {
            let names = all.map(Depth::name).join(", ");
            ParameterError::new_err(format!("depth {depth:?}: expected one of {names}"))
        })?;
        check_limit(sensor_limit_n)?;
        let reading = ReadOptions {
            columns,
            flip_force,
            sensor_limit: sensor_limit_n,
            memory_limit: memory_limit_bytes,
            ..ReadOptions::default()
        };
        let moving_mass = moving_mass(moving_mass_kg, gravity_m_s2)?;
        Ok(Self(Config { reading, depth, seed, bootstrap, moving_mass, ..Config::default() }))
    }

    /// What a row depends on beside the recording, in short.
    fn hash_text(&self) -> String {
        self.0.hash()
    }
}

/// Names and kinds of the columns of every row.
#[pyfunction]
pub(crate) fn fleet_columns() -> Vec<(String, &'static str)> {
    let kind = |kind| match kind {
        Kind::Float => "float",
        Kind::Integer => "integer",
        Kind::Flag => "flag",
        Kind::Text => "text",
    };
    trocar::fleet::columns().into_iter().map(|column| (column.name, kind(column.kind))).collect()
}

/// The row of a file.
#[pyfunction]
pub(crate) fn fleet_file(py: Python<'_>, path: PathBuf, config: &FleetConfig) -> PyResult<Vec<Py<PyAny>>> {
    row(py, Input::File(path), config)
}

/// The row of a data frame; raises where its columns cannot be made out.
#[pyfunction]
pub(crate) fn fleet_frame(
    py: Python<'_>,
    frame: &Bound<'_, PyAny>,
    name: String,
    config: &FleetConfig,
) -> PyResult<Vec<Py<PyAny>>> {
    let (readings, _) = readings_of_frame(frame, &name, config.0.reading.columns.as_deref())?;
    row(py, Input::Columns { name, readings }, config)
}

fn row(py: Python<'_>, input: Input, config: &FleetConfig) -> PyResult<Vec<Py<PyAny>>> {
    let config = config.0.clone();
    let row = run(py, How { progress: None, threads: 1 }, move |_| identify_one(&input, &config))?;
    let value = |cell: Cell| match cell {
        Cell::Empty => Ok(py.None()),
        Cell::Flag(value) => value.into_py_any(py),
        Cell::Integer(value) => value.into_py_any(py),
        Cell::Float(value) => value.into_py_any(py),
        Cell::Text(value) => value.into_py_any(py),
    };
    row.cells.into_iter().map(value).collect()
}
