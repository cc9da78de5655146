//! `identify`, and `Found`: what it leaves behind.

use std::path::PathBuf;
use std::sync::Arc;

use pyo3::prelude::*;
use trocar::identify::{Identification, IdentifyError, IdentifyOptions, Progress, Term};
use trocar::output::StagedFolder;
use trocar::recording::{Recording as Record, RecordingError};
use trocar::report::identification::{FigureChoice, IdentificationReport, document};
use trocar::report::{self, Document, ReportError};
use trocar::summary::{MovingMass, Outcome, validated};
use trocar::validate::Validation;

use crate::errors::{ParameterError, Raise};
use crate::model::Model;
use crate::recording::Recording;
use crate::shared::{Picture, figures, moving_mass, records, without, write_page};
use crate::validate::Validated;
use crate::work::{How, run};

/// A finished identification.
#[pyclass(module = "trocar._core", frozen)]
pub(crate) struct Found(Arc<Job>);

struct Job {
    identification: Identification,
    options: IdentifyOptions,
    recordings: Vec<Record>,
    held_out: Vec<Record>,
    validation: Option<Validation>,
    moving_mass: MovingMass,
}

/// Why there is none.
enum Failure {
    Identify(IdentifyError),
    Recording(RecordingError),
}

impl From<IdentifyError> for Failure {
    fn from(error: IdentifyError) -> Self {
        Self::Identify(error)
    }
}

impl From<RecordingError> for Failure {
    fn from(error: RecordingError) -> Self {
        Self::Recording(error)
    }
}

impl Raise for Failure {
    fn raise(self) -> PyErr {
        match self {
            Self::Identify(error) => error.raise(),
            Self::Recording(error) => error.raise(),
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
) -> PyResult<Found> {
    let moving_mass = moving_mass(moving_mass_kg, gravity_m_s2)?;
    if let Some(offset) = offset_n.filter(|offset| !offset.is_finite()) {
        return Err(ParameterError::new_err(format!("offset_n must be a finite number, got {offset}")));
    }
    let options = IdentifyOptions {
        bootstrap,
        seed,
        degrees,
        inertia_removed: moving_mass.mass > 0.0,
        free_motion,
        without: without.iter().map(|name| term(name)).collect::<PyResult<_>>()?,
        offset: offset_n,
        paper,
        ..IdentifyOptions::default()
    };
    let (recordings, held_out) = (records(&recordings), records(&held_out));
    let task = move |report: &crate::work::Report| {
        Job::run(recordings, held_out, moving_mass, options, &|stage, part| report.tell(stage, part))
    };
    let job = run(py, How { progress, threads }, task)?.map_err(Raise::raise)?;
    Ok(Found(Arc::new(job)))
}

fn term(name: &str) -> PyResult<Term> {
    let names = || Term::ALL.map(Term::name).join(", ");
    let found = Term::ALL.into_iter().find(|term| term.name() == name);
    found.ok_or_else(|| ParameterError::new_err(format!("without {name:?}: expected one of {}", names())))
}

impl Job {
    fn run(
        recordings: Vec<Record>,
        held_out: Vec<Record>,
        moving_mass: MovingMass,
        options: IdentifyOptions,
        progress: Progress,
    ) -> Result<Self, Failure> {
        let corrected = |recordings: Vec<Record>, hidden: f64| {
            recordings
                .into_iter()
                .map(|recording| without(recording, moving_mass, hidden))
                .collect::<Result<Vec<_>, _>>()
        };
        let recordings = corrected(recordings, 0.0)?;
        let identification = trocar::identify::identify(&recordings, &options, progress)?;
        let recordings = identification.without_delay(recordings)?;
        let held_out = identification.without_delay(corrected(held_out, identification.model.unmodelled_mass)?)?;
        let validation = validated(&identification, &held_out);
        Ok(Self { identification, options, recordings, held_out, validation, moving_mass })
    }

    fn outcome(&self) -> Outcome<'_> {
        Outcome {
            identification: &self.identification,
            options: &self.options,
            recordings: &self.recordings,
            held_out: &self.held_out,
            validation: self.validation.as_ref(),
            moving_mass: self.moving_mass,
        }
    }

    fn document(&self) -> Document {
        document(&IdentificationReport {
            identification: &self.identification,
            training: &self.recordings,
            validation: self.validation.as_ref().map(|validation| (self.held_out.as_slice(), validation)),
            truth: None,
            seed: self.options.seed,
            bootstrap: self.options.bootstrap,
            title: "Force between instrument and trocar",
            choice: FigureChoice::default(),
        })
    }

    fn save(&self, folder: &std::path::Path) -> Result<(), ReportError> {
        let staged = StagedFolder::create(folder)?;
        let outcome = self.outcome();
        staged.write("model.json", outcome.model_file().to_json().as_bytes())?;
        staged.write("summary.json", outcome.summary().to_json().as_bytes())?;
        report::stage_document(&staged, &self.document())?;
        Ok(staged.commit()?)
    }
}

#[pymethods]
impl Found {
    /// The identified model.
    fn model(&self) -> Model {
        self.0.outcome().model_file().into()
    }

    /// The text of summary.json.
    fn summary_json(&self) -> String {
        self.0.outcome().summary().to_json()
    }

    /// Names of the parameters, in the order of their importance.
    fn names(&self) -> Vec<&str> {
        self.0.identification.parameters.iter().map(|parameter| parameter.name.as_str()).collect()
    }

    /// The validation on the recordings held out, if there were any.
    fn validated(&self, py: Python<'_>) -> PyResult<Option<Validated>> {
        let job = self.0.clone();
        run(py, How::default(), move |_| {
            let Job { identification, held_out, validation, moving_mass, .. } = &*job;
            let offset = identification.model.offset;
            let mass = moving_mass.mass + identification.model.unmodelled_mass;
            let validation = validation.clone()?;
            Some(Validated::new(&identification.trocar(), held_out.clone(), validation, offset, mass))
        })
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

    /// Writes model.json, summary.json, report.html and figures.
    fn save(&self, py: Python<'_>, folder: PathBuf) -> PyResult<()> {
        let job = self.0.clone();
        run(py, How::default(), move |_| job.save(&folder))?.map_err(Raise::raise)
    }
}
