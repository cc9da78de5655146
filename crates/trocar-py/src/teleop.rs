//! `teleop`: a teleoperation loop through a trocar; `trocar._teleop` wraps it.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use numpy::PyArray1;
use pyo3::prelude::*;
use serde_json::{Value, json};
use trocar::model_file::ModelFile;
use trocar::teleop::advise::{self, Advice, Map};
use trocar::teleop::config::{EXAMPLE_TOML, PRESETS};
use trocar::teleop::hybrid::{self, response};
use trocar::teleop::stability::ZWidth;
use trocar::teleop::{
    Candidates, Config, ConfigError, Outcome, candidates, course_columns, posterior_candidates,
    response_columns,
};
use trocar_model::{Stages, Trocar};

use crate::errors::{Raise, TeleopError, in_python};
use crate::keys::changed;
use crate::model::Model;
use crate::posterior::Draws;
use crate::work::{How, Report, run};

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
/// Delays, s, and fractions of a map; those of the command line where they are not given.
type Axes = (Option<Vec<f64>>, Option<Vec<f64>>);
/// Frequencies of a hybrid matrix, Hz; those of the command line where they are not given.
type Frequencies = Option<Vec<f64>>;

/// Runs the loop of the document `text` (without it, the defaults) with the keys in `changes`, JSON: the
/// summary as JSON, the course (None if the loop diverged) and the hybrid matrix.
#[pyfunction]
#[pyo3(signature = (model, *, compensator, text, name, changes, advise, draws, posterior, least_friction, map, delays_s, fractions, hybrid,
    frequencies_hz, threads, progress))]
#[allow(clippy::too_many_arguments)] // keywords in Python
pub(crate) fn teleop<'py>(
    py: Python<'py>,
    model: &Bound<'py, Model>,
    compensator: Option<&Bound<'py, Model>>,
    text: Option<&str>,
    name: Option<&str>,
    changes: &str,
    advise: bool,
    draws: usize,
    posterior: Option<&Bound<'py, PyAny>>,
    least_friction: f64,
    map: bool,
    delays_s: Option<Vec<f64>>,
    fractions: Option<Vec<f64>>,
    hybrid: bool,
    frequencies_hz: Option<Vec<f64>>,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<(String, Option<Arrays<'py>>, Option<Arrays<'py>>)> {
    let plant = model.get().file().clone();
    let compensator = compensator.map_or_else(|| plant.clone(), |own| own.get().file().clone());
    let config =
        changed(document(text, name)?, changes, ConfigError::Syntax).map_err(Raise::raise)?;
    config.check().map_err(Raise::raise)?;
    if (advise || map) && !config.uses_compensation() {
        return Err(TeleopError::new_err(IN_VAIN));
    }
    let config = config.with_force_error(&compensator);
    let (map, hybrid) = (map.then_some((delays_s, fractions)), hybrid.then_some(frequencies_hz));
    let posterior = posterior.map(Draws::of).transpose()?.map(|draws| draws.models);
    let job =
        Job { config, plant, compensator, advise, draws, posterior, least_friction, map, hybrid };
    let done = run(py, How { progress, threads }, move |report| job.run(report))??;
    let arrays = |columns: Columns| {
        columns.into_iter().map(|(name, cells)| (name, PyArray1::from_vec(py, cells))).collect()
    };
    Ok((done.summary.to_string(), done.course.map(arrays), done.hybrid.map(arrays)))
}

const IN_VAIN: &str = "the fraction of the trocar's force changes nothing in this loop: position_position and wave \
     send no force, and a sensor at the tip reads none of it\n\nhint: leave out advise and map";

fn document(text: Option<&str>, name: Option<&str>) -> PyResult<Config> {
    let read = text.map(Config::from_toml).transpose();
    let in_file = |error: ConfigError| match name {
        Some(name) => TeleopError::new_err(in_python(&format!("{name}: {error}"))),
        None => error.raise(),
    };
    Ok(read.map_err(in_file)?.unwrap_or_default())
}

/// Everything that was asked for.
struct Job {
    config: Config,
    plant: Arc<ModelFile>,
    compensator: Arc<ModelFile>,
    advise: bool,
    draws: usize,
    posterior: Option<Vec<Stages>>,
    least_friction: f64,
    map: Option<Axes>,
    hybrid: Option<Frequencies>,
}

struct Done {
    /// With the keys of `trocar teleop --json`, and the loop.
    summary: Value,
    course: Option<Columns>,
    hybrid: Option<Columns>,
}

impl Job {
    fn run(&self, report: &Report) -> PyResult<Done> {
        let config = &self.config;
        let Outcome { course: samples, settles, figures } =
            Outcome::of(config, self.models()).map_err(Raise::raise)?;
        let summary = json!({
            "fraction": config.compensation.fraction,
            "settles": settles,
            "figures": figures,
            "z_width": ZWidth::of(config, self.models()).map_err(Raise::raise)?,
            "unstable_after_s": samples.as_ref().err().map(|diverged| diverged.time_s),
            "advice": self.advise.then(|| self.advice(report)).transpose()?,
            "map": self.map.as_ref().map(|axes| self.stability_map(axes, report)).transpose()?,
            "config": config,
        });
        let course = samples.ok().map(|samples| course_columns(&samples));
        let hybrid =
            self.hybrid.as_ref().map(|frequencies| self.hybrid(frequencies)).transpose()?;
        Ok(Done { summary, course, hybrid })
    }

    /// The model in the compensator, and the trocar.
    fn models(&self) -> [&Trocar<Vec<f64>>; 2] {
        [&self.compensator.trocar, &self.plant.trocar]
    }

    fn advice(&self, report: &Report) -> PyResult<Advice> {
        report.tell("advice", 0.0);
        let (file, [own, _]) = (&self.plant, self.models());
        let within = |error| format!("the model within its 95 % intervals: {error}");
        let refuse = |error| TeleopError::new_err(within(error));
        if let Some(draws) = &self.posterior {
            file.stages().map_err(Raise::raise)?;
            let trocars = posterior_candidates(file, draws, self.draws, self.least_friction);
            let trocars = trocars.map_err(refuse)?;
            return advise::advise(&self.config, own, &trocars).map_err(Raise::raise);
        }
        if self.draws > 0 && file.intervals.is_empty() {
            let text = "draws needs a model with 95 % intervals, as identify gives it";
            return Err(TeleopError::new_err(text));
        }
        let wanted = Candidates {
            draws: self.draws,
            seed: self.config.seed,
            least_friction_scale: self.least_friction,
        };
        let trocars = candidates(file, &wanted).map_err(refuse)?;
        advise::advise(&self.config, own, &trocars).map_err(Raise::raise)
    }

    fn stability_map(&self, (delays, fractions): &Axes, report: &Report) -> PyResult<Map> {
        let delays = delays.clone().unwrap_or_else(|| advise::map_delays(&self.config, None));
        let fractions = fractions.clone().unwrap_or_else(advise::map_fractions);
        let (done, cells) = (AtomicUsize::new(0), delays.len() * fractions.len());
        let tell = || {
            let done = 1 + done.fetch_add(1, Ordering::Relaxed);
            report.tell("stability map", done as f64 / cells as f64);
        };
        advise::map(&self.config, self.models(), &delays, &fractions, tell).map_err(Raise::raise)
    }

    /// For strokes of the motion's amplitude.
    fn hybrid(&self, frequencies: &Frequencies) -> PyResult<Columns> {
        let frequencies = frequencies.clone().unwrap_or_else(hybrid::frequencies);
        let amplitude = self.config.motion.amplitude_m.abs();
        let rows = response(&self.config, self.models(), amplitude, &frequencies);
        rows.map(|rows| response_columns(&rows)).map_err(Raise::raise)
    }
}
