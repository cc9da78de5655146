//! `validate`, and `Validated`: what it leaves behind.

use std::sync::Arc;

use numpy::PyArray1;
use pyo3::prelude::*;
use trocar::option::{Interface, spelt};
use trocar::recording::{Recording as Record, RecordingError};
use trocar::report::validation::document;
use trocar::workflow::Correction;

use crate::errors::{InternalError, ParameterError, Raise};
use crate::model::{Model, given_model};
use crate::recording::{Recording, records};
use crate::shared::{Picture, figures};
use crate::work::{How, attempt};

/// A finished validation.
#[pyclass(module = "trocar._core", frozen)]
pub(crate) struct Validated(Arc<Job>);

struct Job {
    all: trocar::validate::Validated,
    offset: f64,
    mass: f64,
}

type Forces<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<bool>>,
);

/// Compares a model with recordings; `trocar.validate` wraps it.
#[pyfunction]
#[pyo3(signature = (model, recordings, *, moving_mass_kg, offset_n, threads))]
pub(crate) fn validate(
    py: Python<'_>,
    #[pyo3(from_py_with = given_model)] model: Bound<'_, Model>,
    recordings: Vec<PyRef<'_, Recording>>,
    moving_mass_kg: Option<f64>,
    offset_n: Option<f64>,
    threads: usize,
) -> PyResult<Validated> {
    if recordings.is_empty() {
        return Err(ParameterError::new_err("no recording to validate on"));
    }
    let file = model.get().file().clone();
    let correction = Correction::of(&file, offset_n, moving_mass_kg).map_err(Raise::raise)?;
    let Correction { offset_n: offset, moving_mass_kg: mass, .. } = correction;
    let recordings = records(&recordings);
    attempt(py, How { progress: None, threads }, move |_| -> Result<_, RecordingError> {
        let prepared = recordings.into_iter().map(|recording| correction.taken_out_of(recording));
        let recordings: Vec<Record> = prepared.collect::<Result<_, _>>()?;
        let mut all = trocar::validate::Validated::of(&file.trocar, recordings, offset);
        let qualities = all.recordings.iter().map(|recording| &recording.quality);
        all.validation = all.validation.beside_model(&file, qualities);
        Ok(Validated(Arc::new(Job { all, offset, mass })))
    })
}

#[pymethods]
impl Validated {
    /// The text that `trocar validate --json` prints.
    fn summary_json(&self) -> PyResult<String> {
        let text = serde_json::to_string(&self.0.all.validation)
            .map_err(|error| InternalError::new_err(error.to_string()))?;
        Ok(spelt(&text, Interface::Json))
    }

    /// Sensor offset and moving mass that were subtracted.
    fn taken_out(&self) -> (f64, f64) {
        (self.0.offset, self.0.mass)
    }

    /// Time, measured force less the offset, and the model's force along one recording; and whether
    /// the latter is independent of the unknown state at the start.
    fn forces<'py>(&self, py: Python<'py>, index: usize) -> Forces<'py> {
        let (recording, run) = (&self.0.all.recordings[index], &self.0.all.runs[index]);
        let measured = recording.force.iter().map(|force| force - self.0.offset);
        let mut known = vec![false; recording.len()];
        run.known.iter().cloned().for_each(|range| known[range].fill(true));
        (
            PyArray1::from_slice(py, &recording.time),
            PyArray1::from_iter(py, measured),
            PyArray1::from_slice(py, &run.force),
            PyArray1::from_vec(py, known),
        )
    }

    /// Measured and computed force of the first recordings.
    fn figures(&self, py: Python<'_>) -> PyResult<Vec<Picture>> {
        let job = self.0.clone();
        figures(py, move || document(&job.all, job.offset, "Validation"))
    }
}
