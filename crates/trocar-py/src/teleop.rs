//! `teleop`: a teleoperation loop through a trocar; `trocar._teleop` wraps it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use numpy::PyArray1;
use pyo3::prelude::*;
use trocar::model_file::ModelFile;
use trocar::output::StagedFolder;
use trocar::report::teleop::{Source, Sources, TeleopReport, document as report_document};
use trocar::report::{Document, ReportError};
use trocar::teleop::advise::{map_delays, map_fractions};
use trocar::teleop::config::{EXAMPLE_TOML, PRESETS};
use trocar::teleop::hybrid::frequencies;
use trocar::teleop::{
    Candidates, Config, ConfigError, Questions, Study, course_columns, response_columns,
};

use crate::errors::{Raise, TeleopError, in_python};
use crate::keys::changed;
use crate::model::Model;
use crate::posterior::Draws;
use crate::shared::write_page;
use crate::work::{How, run};

/// A loop that was studied.
#[pyclass(module = "trocar._core", frozen)]
pub(crate) struct Studied(Arc<Job>);

struct Job {
    study: Study,
    sources: Sources,
}

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

/// Runs the loop of the document `text` (without it, the defaults) with the keys in `changes`, JSON, and finds out what is asked
/// for. Delays (s), fractions and frequencies (Hz) that are not given are those of the command line.
#[pyfunction]
#[pyo3(signature = (model, *, compensator, text, name, changes, advise, draws, posterior, compensator_draws, least_friction, map,
    delays_s, fractions, hybrid, frequencies_hz, threads, progress))]
#[allow(clippy::too_many_arguments)] // keywords in Python
pub(crate) fn teleop(
    py: Python<'_>,
    model: &Bound<'_, Model>,
    compensator: Option<&Bound<'_, Model>>,
    text: Option<&str>,
    name: Option<&str>,
    changes: &str,
    advise: bool,
    draws: usize,
    posterior: Option<&Bound<'_, PyAny>>,
    compensator_draws: usize,
    least_friction: f64,
    map: bool,
    delays_s: Option<Vec<f64>>,
    fractions: Option<Vec<f64>>,
    hybrid: bool,
    frequencies_hz: Option<Vec<f64>>,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Studied> {
    let plant = model.get().file().clone();
    let other = compensator.map(|own| own.get().file().clone());
    let config =
        changed(document(text, name)?, changes, ConfigError::Syntax).map_err(Raise::raise)?;
    config.check().map_err(Raise::raise)?;
    if (advise || map) && !config.uses_compensation() {
        return Err(TeleopError::new_err(IN_VAIN));
    }
    let own = other.as_ref().unwrap_or(&plant).clone();
    let posterior = posterior.map(Draws::of).transpose()?.map(|draws| draws.models);
    match &posterior {
        Some(_) => drop(plant.stages().map_err(Raise::raise)?),
        None => need_intervals("draws", draws, &plant)?,
    }
    need_intervals("compensator_draws", compensator_draws, &own)?;
    let seed = config.seed;
    let least_friction_scale = least_friction;
    let candidates = Candidates { draws, posterior, compensator_draws, seed, least_friction_scale };
    let axes = |config: &Config| {
        let delays = delays_s.unwrap_or_else(|| map_delays(config, None));
        [delays, fractions.unwrap_or_else(map_fractions)]
    };
    let questions = Questions {
        advice: advise.then_some(candidates),
        map: map.then(|| axes(&config)),
        hybrid_hz: hybrid.then(|| frequencies_hz.unwrap_or_else(frequencies)),
    };
    let of = |file: &ModelFile| Source::new("model", file.to_json().as_bytes());
    let sources = Sources {
        config: text.map(|text| Source::new(name.unwrap_or("text"), text.as_bytes())),
        trocar: of(&plant),
        compensator: other.as_deref().map(of),
    };
    let task = move |report: &crate::work::Report| {
        let tell = |stage: &str, part: f64| report.tell(stage, part);
        Study::new(config, [&own, &plant], &questions, &tell)
    };
    let study = run(py, How { progress, threads }, task)?.map_err(Raise::raise)?;
    Ok(Studied(Arc::new(Job { study, sources })))
}

const IN_VAIN: &str = "the fraction of the trocar's force changes nothing in this loop: position_position and wave \
     send no force, and a sensor at the tip reads none of it\n\nhint: leave out advise and map";

fn need_intervals(name: &str, draws: usize, file: &ModelFile) -> PyResult<()> {
    if draws > 0 && file.intervals.is_empty() {
        let text = format!("{name} needs a model with 95 % intervals, as identify gives it");
        return Err(TeleopError::new_err(text));
    }
    Ok(())
}

fn document(text: Option<&str>, name: Option<&str>) -> PyResult<Config> {
    let read = text.map(Config::from_toml).transpose();
    let in_file = |error: ConfigError| match name {
        Some(name) => TeleopError::new_err(in_python(&format!("{name}: {error}"))),
        None => error.raise(),
    };
    Ok(read.map_err(in_file)?.unwrap_or_default())
}

impl Job {
    fn report(&self) -> TeleopReport<'_> {
        TeleopReport { study: &self.study, sources: self.sources.clone() }
    }

    fn page(&self) -> Document {
        report_document(&self.report())
    }

    fn save(&self, folder: &Path) -> Result<(), ReportError> {
        let staged = StagedFolder::create(folder)?;
        self.report().write(&staged)?;
        Ok(staged.commit()?)
    }
}

fn arrays(py: Python<'_>, columns: Columns) -> Arrays<'_> {
    columns.into_iter().map(|(name, cells)| (name, PyArray1::from_vec(py, cells))).collect()
}

#[pymethods]
impl Studied {
    /// The text of summary.json.
    fn summary_json(&self) -> String {
        self.0.study.summary().to_json()
    }

    /// The course; None if the loop diverged.
    fn course<'py>(&self, py: Python<'py>) -> Option<Arrays<'py>> {
        let samples = self.0.study.outcome.course.as_ref().ok()?;
        Some(arrays(py, course_columns(samples)))
    }

    /// The hybrid matrix, if it was asked for.
    fn hybrid<'py>(&self, py: Python<'py>) -> Option<Arrays<'py>> {
        let rows = self.0.study.hybrid.as_ref()?;
        Some(arrays(py, response_columns(rows)))
    }

    /// Writes the page of the report, one file with everything inside.
    fn report(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let job = self.0.clone();
        write_page(py, path, move || job.page())
    }

    /// Writes summary.json, course.parquet, hybrid.parquet, report.html and figures.
    fn save(&self, py: Python<'_>, folder: PathBuf) -> PyResult<()> {
        let job = self.0.clone();
        run(py, How::default(), move |_| job.save(&folder))?.map_err(Raise::raise)
    }
}
