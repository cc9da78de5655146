//! `identify`, and its result `Identified`.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::{PyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;
use trocar::identify::posterior::{CHAINS, Density, Draws};
use trocar::identify::{IdentifyOptions, Kept, SealPrior, Term};
use trocar::report::identification::FigureChoice;
use trocar::report::{Document, workflow_document, write_workflow};
use trocar::workflow::{Workflow, WorkflowError};
use trocar_model::ParameterId;

use crate::errors::{InternalError, ParameterError, Raise};
use crate::model::Model;
use crate::posterior::PosteriorTable;
use crate::recording::{Recording, records};
use crate::shared::{Picture, figures, moving_mass, write_folder, write_page};
use crate::work::{How, attempt, run};

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
#[pyo3(signature = (recordings, held_out, *, seed, degrees, free_motion, without, offset_n, fix,
    shaft_diameter_m, paper,
    posterior, prior, prior_spread, moving_mass_kg, gravity_m_s2, threads, progress))]
#[allow(clippy::too_many_arguments)] // keywords in Python
pub(crate) fn identify(
    py: Python<'_>,
    recordings: Vec<PyRef<'_, Recording>>,
    held_out: Vec<PyRef<'_, Recording>>,
    seed: u64,
    degrees: [usize; 2],
    free_motion: bool,
    without: Vec<String>,
    offset_n: Option<f64>,
    fix: Vec<(String, [f64; 2])>,
    shaft_diameter_m: Option<f64>,
    paper: bool,
    posterior: Option<usize>,
    prior: Option<PyRef<'_, Model>>,
    prior_spread: f64,
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
    if let Some(diameter) = shaft_diameter_m.filter(|own| !(own.is_finite() && *own > 0.0)) {
        return Err(ParameterError::new_err(format!(
            "shaft_diameter_m must be finite and above 0, got {diameter} m"
        )));
    }
    let prior = prior.map(|model| seal_prior(&model, prior_spread)).transpose()?;
    let options = IdentifyOptions {
        prior,
        posterior: posterior.map(draws).transpose()?,
        seed,
        degrees,
        free_motion,
        without: without.iter().map(term).collect::<PyResult<_>>()?,
        offset: offset_n,
        kept: kept(&fix)?,
        shaft_radius: shaft_diameter_m.map(|diameter| 0.5 * diameter),
        paper,
        ..IdentifyOptions::default()
    };
    let (recordings, held_out) = (records(&recordings), records(&held_out));
    let job = attempt(py, How { progress, threads }, move |progress| {
        Workflow::run(recordings, held_out, moving_mass, options, progress)
    })?;
    Ok(Identified(Arc::new(job)))
}

fn unknown(name: &str) -> PyErr {
    ParameterError::new_err(format!("{name} is no name of a parameter"))
}

fn draws(count: usize) -> PyResult<Draws> {
    Draws::new(count).ok_or_else(|| {
        ParameterError::new_err(format!(
            "posterior must be a multiple of {CHAINS} from {}, got {count}",
            Draws::FEWEST
        ))
    })
}

fn seal_prior(model: &Model, spread: f64) -> PyResult<SealPrior> {
    if !(spread > 0.0 && spread.is_finite()) {
        return Err(ParameterError::new_err(format!("prior_spread must be above 0, got {spread}")));
    }
    SealPrior::new(model.file(), "model", spread).map_err(Raise::raise)
}

fn kept(all: &[(String, [f64; 2])]) -> PyResult<Kept> {
    let mut kept = Kept::default();
    for (name, range) in all {
        kept.keep(name, *range)
            .map_err(|error| ParameterError::new_err(format!("fix: {error}")))?;
    }
    Ok(kept)
}

fn term(name: &String) -> PyResult<Term> {
    name.parse().map_err(|error| ParameterError::new_err(format!("without {name:?}: {error}")))
}

fn page(done: &Workflow) -> Document {
    workflow_document(done, None, FigureChoice::default()).expect("the default choice is possible")
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

    /// The posterior draws; None where there are none.
    fn posterior(&self) -> PyResult<Option<PosteriorTable>> {
        let found = self.0.identification.posterior.as_ref();
        found.map(|posterior| PosteriorTable::new(trocar::draws::table(posterior))).transpose()
    }

    /// ln of the density of the draws' most probable structure at each row of `z`, and parameters there
    /// by name; None where there are no draws.
    #[allow(clippy::type_complexity)]
    fn log_density<'py>(
        &self,
        py: Python<'py>,
        z: PyReadonlyArray2<'py, f64>,
        names: Vec<String>,
    ) -> PyResult<Option<(Bound<'py, PyArray1<f64>>, Vec<Bound<'py, PyArray1<f64>>>)>> {
        let Some(density) = &self.0.identification.density else { return Ok(None) };
        let ids = names.iter().map(|name| ParameterId::named(name).ok_or_else(|| unknown(name)));
        let ids = ids.collect::<PyResult<Vec<_>>>()?;
        let rows: Vec<Vec<f64>> = z.as_array().rows().into_iter().map(|r| r.to_vec()).collect();
        if let Some(row) = rows.iter().find(|row| row.len() != density.dimension()) {
            return Err(ParameterError::new_err(format!(
                "z must have {} columns, got {}",
                density.dimension(),
                row.len()
            )));
        }
        let (density, job) = (density.clone(), rows.clone());
        let logs = run(py, How::default(), move |_| -> Vec<f64> {
            job.par_iter().map(|z| density.log_density(z)).collect()
        })?;
        let density = self.0.identification.density.as_ref();
        let value =
            |id: ParameterId, z: &Vec<f64>| density.map_or(f64::NAN, |d| d.parameter(z, id));
        let columns = ids
            .into_iter()
            .map(|id| PyArray1::from_iter(py, rows.iter().map(move |z| value(id, z))))
            .collect();
        Ok(Some((PyArray1::from_vec(py, logs), columns)))
    }

    /// Number of columns of `z`; None where there are no draws.
    fn dimension(&self) -> Option<usize> {
        self.0.identification.density.as_ref().map(Density::dimension)
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
        write_folder(py, folder, move |staged| {
            write_workflow(&job, staged, None, FigureChoice::default())
        })
    }
}
