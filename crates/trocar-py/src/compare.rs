//! `compare`, and `Compared`: what it leaves behind.

use std::path::PathBuf;
use std::sync::Arc;

use pyo3::prelude::*;
use trocar::compare::{Choice, CompareOptions, Divided, Outcome};
use trocar::identify::IdentifyOptions;
use trocar::report::comparison::{TITLE, document, write};

use crate::errors::ParameterError;
use crate::model::Model;
use crate::recording::{Recording, records};
use crate::shared::{Picture, figures, moving_mass, write_folder, write_page};
use crate::work::{How, attempt};

/// A finished comparison.
#[pyclass(module = "trocar._core", frozen)]
pub(crate) struct Compared(Arc<Outcome>);

/// Fits and scores friction models; `trocar.compare` wraps it.
#[pyfunction]
#[pyo3(signature = (recordings, held_out, *, models, seed, timing, moving_mass_kg, gravity_m_s2, threads, progress))]
#[allow(clippy::too_many_arguments)] // keywords in Python
pub(crate) fn compare(
    py: Python<'_>,
    recordings: Vec<PyRef<'_, Recording>>,
    held_out: Vec<PyRef<'_, Recording>>,
    models: &str,
    seed: u64,
    timing: bool,
    moving_mass_kg: f64,
    gravity_m_s2: f64,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Compared> {
    let moving_mass = moving_mass(moving_mass_kg, gravity_m_s2)?;
    let models =
        Choice::list(models).map_err(|why| ParameterError::new_err(format!("models: {why}")))?;
    let (training, validation) = (records(&recordings), records(&held_out));
    let identify = IdentifyOptions { seed, ..Default::default() };
    let options = CompareOptions { models, identify, timing };
    let outcome = attempt(py, How { progress, threads }, move |progress| {
        Divided::of(training, validation, moving_mass)?.compared(options, progress)
    })?;
    Ok(Compared(Arc::new(outcome)))
}

#[pymethods]
impl Compared {
    /// The text of compare.json.
    fn summary_json(&self) -> String {
        self.0.summary().to_json()
    }

    /// The models, in the order of the summary.
    fn models(&self) -> Vec<Model> {
        self.0.model_files().into_iter().map(|(_, file)| file.into()).collect()
    }

    /// Recordings on which the seal never slides all round, in words.
    fn unknown_states(&self) -> Vec<String> {
        self.0.unknown_states()
    }

    /// The figures of the report.
    fn figures(&self, py: Python<'_>) -> PyResult<Vec<Picture>> {
        let outcome = self.0.clone();
        figures(py, move || document(&outcome, TITLE))
    }

    /// Writes the page of the report, one file with everything inside.
    fn report(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let outcome = self.0.clone();
        write_page(py, path, move || document(&outcome, TITLE))
    }

    /// Writes compare.json, models, report.html and figures.
    fn save(&self, py: Python<'_>, folder: PathBuf) -> PyResult<()> {
        let outcome = self.0.clone();
        write_folder(py, folder, move |staged| write(&outcome, staged))
    }
}
