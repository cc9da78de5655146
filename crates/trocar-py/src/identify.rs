//! `identify`, and its result `Identified`.

use std::path::PathBuf;
use std::sync::Arc;

use pyo3::prelude::*;
use trocar::identify::{IdentifyOptions, Term};
use trocar::output::StagedFolder;
use trocar::report::identification::FigureChoice;
use trocar::report::{Document, ReportError};
use trocar::workflow::{Workflow, WorkflowError};

use crate::errors::{InternalError, ParameterError, Raise};
use crate::model::Model;
use crate::recording::Recording;
use crate::shared::{Picture, figures, moving_mass, records, write_page};
use crate::work::{How, run};

/// A finished identification.
#[pyclass(module = "trocar._core", frozen)]
pub(crate) struct Identified(Arc<Workflow>);

impl Raise for WorkflowError {
    fn raise(self) -> PyErr {
        match self {
            Self::Identify(error) => error.raise(),
            Self::Recording(error) => error.raise(),
            other => InternalError::new_err(other.to_string()),
        }
    }
}

/// Identifies a model; `trocar.identify` wraps it.
#[pyfunction]
#[pyo3(signature = (recordings, held_out, *, bootstrap, seed, degrees, free_motion, without, offset_n, paper,
    moving_mass_kg, gravity_m_s2, threads, progress))]
#[allow(clippy::too_many_arguments)] // keywords in Python
pub(crate) fn identify(
    py: Python<'_>,
    recordings: Vec<PyRef<'_, Recording>>,
    held_out: Vec<PyRef<'_, Recording>>,
    bootstrap: usize,
    seed: u64,
    degrees: [usize; 2],
    free_motion: bool,
    without: Vec<String>,
    offset_n: Option<f64>,
    paper: bool,
    moving_mass_kg: f64,
    gravity_m_s2: f64,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Identified> {
    let moving_mass = moving_mass(moving_mass_kg, gravity_m_s2)?;
    if let Some(offset) = offset_n.filter(|offset| !offset.is_finite()) {
        return Err(ParameterError::new_err(format!(
            "offset_n must be a finite number, got {offset}"
        )));
    }
    let options = IdentifyOptions {
        bootstrap,
        seed,
        degrees,
        free_motion,
        without: without.iter().map(|name| term(name)).collect::<PyResult<_>>()?,
        offset: offset_n,
        paper,
        ..IdentifyOptions::default()
    };
    let (recordings, held_out) = (records(&recordings), records(&held_out));
    let task = move |report: &crate::work::Report| {
        Workflow::run(recordings, held_out, moving_mass, options, &|stage, part| {
            report.tell(stage, part)
        })
    };
    let job = run(py, How { progress, threads }, task)?.map_err(Raise::raise)?;
    Ok(Identified(Arc::new(job)))
}

fn term(name: &str) -> PyResult<Term> {
    let names = || Term::ALL.map(Term::name).join(", ");
    let found = Term::ALL.into_iter().find(|term| term.name() == name);
    found.ok_or_else(|| {
        ParameterError::new_err(format!("without {name:?}: expected one of {}", names()))
    })
}

fn page(done: &Workflow) -> Document {
    done.document(None, FigureChoice::default()).expect("the default choice is possible")
}

fn save(done: &Workflow, folder: &std::path::Path) -> Result<(), ReportError> {
    let staged = StagedFolder::create(folder)?;
    done.write(&staged, None, FigureChoice::default())?;
    Ok(staged.commit()?)
}

#[pymethods]
impl Identified {
    /// The identified model.
    fn model(&self) -> Model {
        self.0.model_file().into()
    }

    /// The text of summary.json.
    fn summary_json(&self) -> String {
        self.0.summary().to_json()
    }

    /// Names of the parameters, in the order of their importance.
    fn names(&self) -> Vec<String> {
        self.0.identification.parameters.iter().map(|parameter| parameter.id.to_string()).collect()
    }

    /// The figures of the report.
    fn figures(&self, py: Python<'_>) -> PyResult<Vec<Picture>> {
        let job = self.0.clone();
        figures(py, move || page(&job))
    }

    /// Writes the page of the report, one file with everything inside.
    fn report(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let job = self.0.clone();
        write_page(py, path, move || page(&job))
    }

    /// Writes model.json, summary.json, report.html and figures.
    fn save(&self, py: Python<'_>, folder: PathBuf) -> PyResult<()> {
        let job = self.0.clone();
        run(py, How::default(), move |_| save(&job, &folder))?.map_err(Raise::raise)
    }
}
