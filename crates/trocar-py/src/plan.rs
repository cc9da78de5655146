//! `plan`: what motion to record; `trocar._plan` wraps it.

use numpy::PyArray1;
use pyo3::prelude::*;
use serde_json::{Value, json};
use trocar::identify::Progress;
use trocar::plan::config::EXAMPLE_TOML;
use trocar::plan::{ConfigError, Goal, Plan, PlanConfig};

use crate::errors::{PlanError, Raise};
use crate::keys::{changed, document};
use crate::model::Model;
use crate::posterior::Draws;
use crate::recording::Recording;
use crate::work::{How, attempt};

/// The rig with every key at its default, as a documented TOML text.
#[pyfunction]
pub(crate) fn plan_example() -> &'static str {
    EXAMPLE_TOML
}

type Arrays<'py> = Vec<Bound<'py, PyArray1<f64>>>;

/// Plans a motion on the rig of the document `text` (without it, the defaults, or the limits of the first recording of
/// `after`) with the keys in `changes`, JSON: the summary as JSON, times, positions, and angles where the rig turns.
#[pyfunction]
#[pyo3(signature = (*, text, name, changes, goal, model, posterior, after, threads, progress))]
#[allow(clippy::too_many_arguments)] // keywords in Python
pub(crate) fn plan<'py>(
    py: Python<'py>,
    text: Option<&str>,
    name: Option<&str>,
    changes: &str,
    goal: &str,
    model: Option<&Bound<'py, Model>>,
    posterior: Option<&Bound<'py, PyAny>>,
    after: Vec<PyRef<'py, Recording>>,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<(String, Arrays<'py>)> {
    let goal: Goal = goal.parse().map_err(|error| PlanError::new_err(format!("{error}")))?;
    let after: Vec<_> = after.iter().map(|recording| recording.record().clone()).collect();
    let config = match (text, after.first()) {
        (Some(text), _) => document(text, name, PlanConfig::from_toml, PlanError::new_err)?,
        (None, Some(pilot)) => PlanConfig::default().on_the_rig_of(pilot).map_err(Raise::raise)?,
        (None, None) => PlanConfig::default(),
    };
    let config = changed(config, changes, ConfigError::Syntax).map_err(Raise::raise)?;
    let draws = match (posterior, model) {
        (Some(posterior), _) => Draws::of(posterior)?.models,
        (None, Some(model)) => vec![*model.get().file().stages().map_err(Raise::raise)?],
        (None, None) => Vec::new(),
    };
    let seals = config.seals_of(&draws).map_err(Raise::raise)?;
    let planning = move |progress: Progress<'_>| -> Result<_, trocar::plan::PlanError> {
        let planned = trocar::plan::plan(&config, &goal, &seals, &after, progress)?;
        Ok((summary(&config, &goal, &planned), planned.course))
    };
    let (summary, course) = attempt(py, How { progress, threads }, planning)?;
    let columns = [Some(course.time), Some(course.position), course.angle].into_iter().flatten();
    let columns = columns.map(|column| PyArray1::from_vec(py, column)).collect();
    Ok((summary.to_string(), columns))
}

/// What `trocar plan --json` prints, with the order of the cycles and the rig.
fn summary(config: &PlanConfig, goal: &Goal, plan: &Plan) -> Value {
    let mut summary = json!(plan.summary(goal));
    summary["segments"] = json!(plan.segments);
    summary["config"] = json!(config);
    summary
}
