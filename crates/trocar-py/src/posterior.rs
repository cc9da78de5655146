//! Posterior draws as columns and models; `trocar.Posterior` wraps them.

use std::path::PathBuf;

use numpy::PyArray1;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::PyList;
use trocar::draws::{self, DrawsError};
use trocar::model_file::{ModelFile, Origin, OriginKind};
use trocar::table::{Column, Table, TableError};
use trocar_model::Stages;

use crate::errors::{ParameterError, Raise, in_python, os_error};
use crate::model::Model;
use crate::work::{How, attempt};

/// A table of draws with the element of each.
#[pyclass(module = "trocar._core", frozen)]
pub(crate) struct PosteriorTable {
    table: Table,
    models: Vec<Stages>,
}

impl Raise for DrawsError {
    fn raise(self) -> PyErr {
        let text = in_python(&self);
        match &self {
            Self::Table(TableError::Open { source, .. }) => os_error(source, text),
            _ => ParameterError::new_err(text),
        }
    }
}

impl PosteriorTable {
    pub(crate) fn new(table: Table) -> PyResult<Self> {
        let models = draws::models(&table).map_err(Raise::raise)?;
        Ok(Self { table, models })
    }
}

/// Draws given as an argument `posterior`: a `trocar.Posterior`, or the path of its file.
pub(crate) struct Draws {
    /// As a `trocar.Posterior`, which can be pickled.
    pub(crate) posterior: Py<PyAny>,
    pub(crate) models: Vec<Stages>,
}

impl Draws {
    pub(crate) fn of(given: &Bound<'_, PyAny>) -> PyResult<Self> {
        let (py, table) = (given.py(), intern!(given.py(), "_table"));
        let posterior = if given.hasattr(table)? {
            given.clone()
        } else {
            let class = py.import(intern!(py, "trocar.results"))?.getattr("Posterior")?;
            class.call_method1(intern!(py, "read"), (given,))?
        };
        let models = posterior.getattr(table)?.cast::<PosteriorTable>()?.get().models.clone();
        Ok(Self { posterior: posterior.unbind(), models })
    }
}

/// Reads the draws that `identify` wrote.
#[pyfunction]
pub(crate) fn read_posterior(path: PathBuf) -> PyResult<PosteriorTable> {
    PosteriorTable::new(draws::read(&path).map_err(Raise::raise)?)
}

#[pymethods]
impl PosteriorTable {
    /// The columns by name: chain, draw, structure, parameters.
    fn columns<'py>(&self, py: Python<'py>) -> PyResult<Vec<(String, Bound<'py, PyAny>)>> {
        let both = self.table.fields.iter().zip(&self.table.columns);
        both.filter(|(name, _)| !draws::is_of_model(name))
            .map(|(name, column)| Ok((name.clone(), cells_of(py, column)?)))
            .collect()
    }

    /// The model of each draw, without a position profile.
    fn models(&self) -> Vec<Model> {
        self.models
            .iter()
            .map(|stages| Model::from(ModelFile::new(*stages, Origin::new(OriginKind::Identified))))
            .collect()
    }

    /// Writes the draws.
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let table = self.table.clone();
        attempt(py, How::default(), move |_| draws::write(&table, &path))
    }
}

/// The cells of a column as an array, or as a list where they are no numbers.
fn cells_of<'py>(py: Python<'py>, column: &Column) -> PyResult<Bound<'py, PyAny>> {
    Ok(match column {
        Column::Number(cells) => PyArray1::from_slice(py, cells).into_any(),
        Column::Integer(cells) => {
            let whole = cells.iter().map(|cell| cell.unwrap_or_default());
            PyArray1::from_iter(py, whole).into_any()
        }
        Column::Boolean(cells) => PyList::new(py, cells)?.into_any(),
        Column::Text(cells) => PyList::new(py, cells.iter().map(|c| c.as_deref()))?.into_any(),
    })
}
