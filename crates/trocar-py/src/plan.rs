//! `plan`: what motion to record; `trocar._plan` wraps it.

use numpy::PyArray1;
use pyo3::prelude::*;
use serde_json::{Value, json};
use trocar::many::evenly;
use trocar::plan::config::EXAMPLE_TOML;
use trocar::plan::{ConfigError, Goal, Plan, PlanConfig};
use trocar_model::{ElementParams, Stages};

use crate::errors::{PlanError, Raise, in_python};
use crate::keys::changed;
use crate::model::Model;
use crate::posterior::Draws;
use crate::recording::Recording;
use crate::work::{How, run};

/// The rig with every key at its default, as a documented TOML text.
#[pyfunction]
pub(crate) fn plan_example() -> &'static str {
    EXAMPLE_TOML
}

type Arrays<'py> = [Bound<'py, PyArray1<f64>>; 2];

/// Plans a motion on the rig of the document `text` (without it, the defaults, or the limits of the first recording of
/// `after`) with the keys in `changes`, JSON: the summary as JSON, times and positions.
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
        (Some(text), _) => document(text, name)?,
        (None, Some(pilot)) => PlanConfig::default().on_the_rig_of(pilot).map_err(Raise::raise)?,
        (None, None) => PlanConfig::default(),
    };
    let config = changed(config, changes, ConfigError::Syntax).map_err(Raise::raise)?;
    let seals = match (posterior, model) {
        (Some(posterior), _) => {
            let draws = evenly(&Draws::of(posterior)?.models, config.draws as usize);
            draws.iter().map(element).collect::<PyResult<_>>()?
        }
        (None, Some(model)) => vec![element(model.get().file().stages().map_err(Raise::raise)?)?],
        (None, None) => Vec::new(),
    };
    let work = move |report: &crate::work::Report| {
        let tell = |stage: &str, part: f64| report.tell(stage, part);
        let planned = trocar::plan::plan(&config, &goal, &seals, &after, &tell)?;
        Ok((summary(&config, &goal, &planned), planned.course))
    };
    let done = run(py, How { progress, threads }, work)?;
    let (summary, course) = done.map_err(|error: trocar::plan::PlanError| error.raise())?;
    let columns = [course.time, course.position].map(|column| PyArray1::from_vec(py, column));
    Ok((summary.to_string(), columns))
}

fn document(text: &str, name: Option<&str>) -> PyResult<PlanConfig> {
    PlanConfig::from_toml(text).map_err(|error| match name {
        Some(name) => PlanError::new_err(in_python(&format!("{name}: {error}"))),
        None => error.raise(),
    })
}

/// The one element of a model.
fn element(stages: &Stages) -> PyResult<ElementParams> {
    match stages.elements() {
        [one] => Ok(*one.params()),
        several => Err(PlanError::new_err(format!(
            "a model of {} elements; a motion is planned for one element\n\nhint: identify the pilot with \
             without=[\"second_stage\"]",
            several.len()
        ))),
    }
}

/// With the keys of `trocar plan --json`, the order of the cycles and the rig.
fn summary(config: &PlanConfig, goal: &Goal, plan: &Plan) -> Value {
    json!({
        "goal": goal.to_string(),
        "duration_s": plan.duration_s(),
        "needed_s": plan.needed_s,
        "motion": plan.shares,
        "expected": plan.expected,
        "paper_duration_s": plan.paper.as_ref().map(|paper| paper.0),
        "paper_expected": plan.paper.as_ref().map(|paper| &paper.1),
        "segments": plan.segments,
        "config": config,
    })
}
