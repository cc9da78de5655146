//! `teleop`: a teleoperation loop through a trocar; `trocar._teleop` wraps it.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use trocar::model_file::ModelFile;
use trocar::report::teleop::{self as report, Source, Sources};
use trocar::teleop::config::{EXAMPLE_TOML, PRESETS};
use trocar::teleop::{Config, ConfigError, Options, Study, course_columns, response_columns};

use crate::errors::{Raise, TeleopError, in_python};
use crate::keys::{changed, document, given};
use crate::model::{Model, given_model};
use crate::posterior::Draws;
use crate::shared::{write_folder, write_page};
use crate::work::{How, attempt};

/// A loop that was studied.
#[pyclass(module = "trocar._core", frozen)]
pub(crate) struct Studied(Arc<(Study, Sources)>);

/// The loop with every key at its default, as a documented TOML text.
#[pyfunction]
pub(crate) fn teleop_example() -> &'static str {
    EXAMPLE_TOML
}

/// Names and texts of the loops of devices.
#[pyfunction]
pub(crate) fn teleop_presets() -> Vec<(&'static str, &'static str)> {
    PRESETS.to_vec()
}

/// Columns by their names.
type Columns = Vec<(&'static str, Vec<f64>)>;
type Arrays<'py> = Vec<(&'static str, Bound<'py, PyArray1<f64>>)>;

/// Runs the loop of the document `text` (without it, the defaults) with the keys in `changes`, JSON, and finds out what `options`
/// ask for.
#[pyfunction]
#[pyo3(signature = (model, *, compensator, text, name, changes, posterior, threads, progress, **options))]
#[allow(clippy::too_many_arguments)] // keywords in Python
pub(crate) fn teleop(
    py: Python<'_>,
    #[pyo3(from_py_with = given_model)] model: Bound<'_, Model>,
    compensator: Option<&Bound<'_, Model>>,
    text: Option<&str>,
    name: Option<&str>,
    changes: &str,
    posterior: Option<&Bound<'_, PyAny>>,
    threads: usize,
    progress: Option<Py<PyAny>>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<Studied> {
    let plant = model.get().file().clone();
    let other = compensator.map(|own| own.get().file().clone());
    let config = text.map(|text| document(text, name, Config::from_toml, TeleopError::new_err));
    let config = config.transpose()?.unwrap_or_default();
    let config = changed(config, changes, ConfigError::Syntax).map_err(Raise::raise)?;
    config.check().map_err(Raise::raise)?;
    let own = other.as_ref().unwrap_or(&plant).clone();
    let posterior = posterior.map(Draws::of).transpose()?.map(|draws| draws.models);
    if posterior.is_some() {
        plant.stages().map_err(Raise::raise)?;
    }
    let options: Options = options.map(given).transpose()?.unwrap_or_default();
    let questions = options.questions(&config, [&own, &plant], posterior).map_err(Raise::raise)?;
    let of = |file: &ModelFile| Source::new("model", file.to_json().as_bytes());
    let sources = Sources {
        config: text.map(|text| Source::new(name.unwrap_or("text"), text.as_bytes())),
        trocar: of(&plant),
        compensator: other.as_deref().map(of),
    };
    let study = attempt(py, How { progress, threads }, move |progress| {
        Study::new(config, [&own, &plant], &questions, progress)
    })?;
    Ok(Studied(Arc::new((study, sources))))
}

fn arrays(py: Python<'_>, columns: Columns) -> Arrays<'_> {
    columns.into_iter().map(|(name, cells)| (name, PyArray1::from_vec(py, cells))).collect()
}

#[pymethods]
impl Studied {
    /// The text of summary.json.
    fn summary_json(&self) -> String {
        self.0.0.summary().to_json()
    }

    /// What makes the result doubtful, with what may help.
    fn warnings(&self) -> Vec<String> {
        self.0.0.warnings().iter().map(in_python).collect()
    }

    /// The course; None if the loop diverged.
    fn course<'py>(&self, py: Python<'py>) -> Option<Arrays<'py>> {
        let samples = self.0.0.outcome.course.as_ref().ok()?;
        Some(arrays(py, course_columns(samples)))
    }

    /// The hybrid matrix, if it was asked for.
    fn hybrid<'py>(&self, py: Python<'py>) -> Option<Arrays<'py>> {
        let rows = self.0.0.hybrid.as_ref()?;
        Some(arrays(py, response_columns(rows)))
    }

    /// Writes the page of the report, one file with everything inside.
    fn report(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let job = self.0.clone();
        write_page(py, path, move || report::document(&job.0, &job.1))
    }

    /// Writes summary.json, course.parquet, hybrid.parquet, report.html and figures.
    fn save(&self, py: Python<'_>, folder: PathBuf) -> PyResult<()> {
        let job = self.0.clone();
        write_folder(py, folder, move |staged| report::write(&job.0, &job.1, staged))
    }
}
