//! One recording to one row, and data sets whose recordings are identified elsewhere;
//! `trocar.fleet` wraps it.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

use pyo3::IntoPyObjectExt;
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use trocar::fleet::{
    Collector, Config, Dataset, DatasetError, FleetCell, FleetError, Input, Tally, columns,
    identify_one, identify_source, journal_path,
};
use trocar::table::Kind;

use crate::errors::{InternalError, ParameterError, Raise};
use crate::keys::given;
use crate::recording::readings_of_frame;
use crate::work::{How, run};

/// How to identify each recording.
#[pyclass(module = "trocar._core", frozen)]
pub(crate) struct FleetConfig(Config);

#[pymethods]
impl FleetConfig {
    #[new]
    #[pyo3(signature = (**options))]
    fn new(options: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let config: Config = options.map(given).transpose()?.unwrap_or_default();
        config.check().map_err(Raise::raise)?;
        Ok(Self(config))
    }

    /// What a row depends on beside the recording, in short.
    fn hash_text(&self) -> String {
        self.0.hash()
    }
}

/// Names and kinds of the columns of every row.
#[pyfunction]
pub(crate) fn fleet_columns() -> Vec<(String, &'static str)> {
    columns().into_iter().map(|column| (column.name, word(column.kind))).collect()
}

fn word(kind: Kind) -> &'static str {
    match kind {
        Kind::Number => "number",
        Kind::Integer => "integer",
        Kind::Boolean => "boolean",
        Kind::Text => "text",
    }
}

/// The row of a file.
#[pyfunction]
pub(crate) fn fleet_file(
    py: Python<'_>,
    path: PathBuf,
    config: &FleetConfig,
) -> PyResult<Vec<Py<PyAny>>> {
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
    let (readings, _) =
        readings_of_frame(frame, &name, config.0.reading.choice.columns.as_deref())?;
    row(py, Input::Columns { name, readings: Box::new(readings) }, config)
}

fn row(py: Python<'_>, input: Input, config: &FleetConfig) -> PyResult<Vec<Py<PyAny>>> {
    let config = config.0.clone();
    let row = run(py, How { progress: None, threads: 1 }, move |_| identify_one(&input, &config))?;
    row.cells
        .into_iter()
        .map(|cell| match cell {
            FleetCell::Empty => Ok(py.None()),
            FleetCell::Boolean(value) => value.into_py_any(py),
            FleetCell::Integer(value) => value.into_py_any(py),
            FleetCell::Float(value) => value.into_py_any(py),
            FleetCell::Text(value) => value.into_py_any(py),
        })
        .collect()
}

/// The row of one source of a data set, as text for [`FleetTable::add`].
#[pyfunction]
pub(crate) fn fleet_source(
    py: Python<'_>,
    order: String,
    config: &FleetConfig,
) -> PyResult<String> {
    let config = config.0.clone();
    let row =
        run(py, How { progress: None, threads: 1 }, move |_| identify_source(&order, &config))?;
    row.map_err(|error| ParameterError::new_err(format!("no order of a data set: {error}")))
}

/// A table whose rows come from elsewhere.
#[pyclass(module = "trocar._core", frozen)]
pub(crate) struct FleetTable {
    collector: Mutex<Option<Collector>>,
    names: Vec<String>,
    left_out: Vec<String>,
}

#[pymethods]
impl FleetTable {
    #[new]
    fn new(dataset: PathBuf, out: PathBuf, config: &FleetConfig) -> PyResult<Self> {
        let found =
            Dataset::open(&dataset, &[out.clone(), journal_path(&out)]).map_err(of_dataset)?;
        let names = found.sources.iter().map(|source| source.name.clone()).collect();
        let collector =
            Collector::open(&found, &config.0, &out).map_err(|error| of_fleet(error.into()))?;
        let left_out = found.left_out;
        Ok(Self { collector: Mutex::new(Some(collector)), names, left_out })
    }

    /// The recordings, by their names in the table.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.names.clone()
    }

    /// Files left out for their extension.
    #[getter]
    fn left_out(&self) -> Vec<String> {
        self.left_out.clone()
    }

    /// One for each recording, for `fleet_source`.
    fn orders(&self) -> PyResult<Vec<String>> {
        let orders = self.open().as_ref().map(Collector::orders).transpose();
        let orders = orders.map_err(|error| {
            ParameterError::new_err(format!("a path of the data set is not Unicode text: {error}"))
        });
        Ok(orders?.unwrap_or_default())
    }

    /// Takes the row of a file; recordings done, reused from before, and failed.
    fn add(&self, source: usize, row: &str) -> PyResult<(usize, usize, usize)> {
        self.with(|collector| collector.add(source, row))
    }

    /// A file that no worker could finish.
    fn lose(&self, source: usize, kind: &str, reason: &str) -> PyResult<(usize, usize, usize)> {
        self.with(|collector| collector.lose(source, kind, reason))
    }

    /// Writes the table; name, status and reason of every recording.
    fn write(&self, py: Python<'_>) -> PyResult<Vec<(String, String, Option<String>)>> {
        let collector = self.open().take().ok_or_else(written)?;
        let fleet = py.detach(|| collector.write()).map_err(of_fleet)?;
        let said = fleet.records.iter().map(|record| {
            let [path, status, reason] =
                ["path", "status", "reason"].map(|name| record.text(name).map(str::to_owned));
            (path.unwrap_or_default(), status.unwrap_or_default(), reason)
        });
        Ok(said.collect())
    }

    /// Gives the journal free for another call.
    fn close(&self) {
        self.open().take();
    }
}

impl FleetTable {
    fn open(&self) -> MutexGuard<'_, Option<Collector>> {
        self.collector.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn with(
        &self,
        take: impl FnOnce(&mut Collector) -> Result<Tally, FleetError>,
    ) -> PyResult<(usize, usize, usize)> {
        let tally = take(self.open().as_mut().ok_or_else(written)?).map_err(of_fleet)?;
        Ok((tally.done, tally.reused, tally.failed))
    }
}

fn written() -> PyErr {
    ParameterError::new_err("the table has already been written or closed")
}

fn of_dataset(error: DatasetError) -> PyErr {
    match error {
        DatasetError::Read { path, source } => {
            PyOSError::new_err((source.raw_os_error(), source.to_string(), path))
        }
        other => ParameterError::new_err(other.to_string()),
    }
}

fn of_fleet(error: FleetError) -> PyErr {
    match error {
        FleetError::Output(error) => PyOSError::new_err(error.to_string()),
        other => InternalError::new_err(other.to_string()),
    }
}
