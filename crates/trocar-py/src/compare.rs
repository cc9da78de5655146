//! `compare`, and `Compared`: what it leaves behind.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use pyo3::prelude::*;
use trocar::compare::{Choice, CompareOptions, Comparison, Divided, Outcome};
use trocar::identify::IdentifyOptions;
use trocar::output::StagedFolder;
use trocar::report::comparison::{TITLE, document, write};
use trocar::report::{Document, ReportError};
use trocar::workflow::MovingMass;

use crate::errors::{ParameterError, Raise};
use crate::model::Model;
use crate::recording::{Recording, records};
use crate::shared::{Picture, figures, moving_mass, write_page};
use crate::work::{How, run};

/// A finished comparison.
#[pyclass(module = "trocar._core", frozen)]
pub(crate) struct Compared(Arc<Job>);

struct Job {
    comparison: Comparison,
    seed: u64,
    held_out: bool,
    moving_mass: MovingMass,
}

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
    let identify =
        IdentifyOptions { seed, inertia_removed: moving_mass.mass > 0.0, ..Default::default() };
    let options = CompareOptions { models, identify, timing };
    let task = move |report: &crate::work::Report| {
        let Divided { training, validation, held_out } =
            Divided::of(training, validation, moving_mass)?;
        let progress = |stage: &str, part: f64| report.tell(stage, part);
        let comparison = trocar::compare::compare(&training, &validation, &options, &progress)?;
        Ok(Job { comparison, seed, held_out, moving_mass })
    };
    let job = run(py, How { progress, threads }, task)?
        .map_err(|error: trocar::compare::CompareError| error.raise())?;
    Ok(Compared(Arc::new(job)))
}

impl Job {
    fn outcome(&self) -> Outcome<'_> {
        let Self { comparison, seed, held_out, moving_mass } = self;
        Outcome { comparison, seed: *seed, held_out: *held_out, moving_mass: *moving_mass }
    }

    fn document(&self) -> Document {
        document(&self.outcome(), TITLE)
    }

    fn save(&self, folder: &Path) -> Result<(), ReportError> {
        let staged = StagedFolder::create(folder)?;
        write(&self.outcome(), &staged)?;
        Ok(staged.commit()?)
    }
}

#[pymethods]
impl Compared {
    /// The text of compare.json.
    fn summary_json(&self) -> String {
        self.0.outcome().summary().to_json()
    }

    /// The models, in the order of the summary.
    fn models(&self) -> Vec<Model> {
        self.0.outcome().model_files().into_iter().map(|(_, file)| file.into()).collect()
    }

    /// Recordings on which the seal never slides all round, in words.
    fn unknown_states(&self) -> Vec<String> {
        self.0.outcome().unknown_states()
    }

    /// The figures of the report.
    fn figures(&self, py: Python<'_>) -> PyResult<Vec<Picture>> {
        let job = self.0.clone();
        figures(py, move || job.document())
    }

    /// Writes the page of the report, one file with everything inside.
    fn report(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let job = self.0.clone();
        write_page(py, path, move || job.document())
    }

    /// Writes compare.json, models, report.html and figures.
    fn save(&self, py: Python<'_>, folder: PathBuf) -> PyResult<()> {
        let job = self.0.clone();
        run(py, How::default(), move |_| job.save(&folder))?.map_err(Raise::raise)
    }
}
