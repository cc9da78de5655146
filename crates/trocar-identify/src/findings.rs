//! What the stages report: errors, warnings, parameters, progress.

use std::fmt;

use serde::{Serialize, Serializer};
use trocar_model::{ParameterId, Quantity};

use super::estimate::Estimate;
use trocar_recording::{OPPOSED, Recording, WarningKind};
use trocar_simulate::motion_found::MotionFound;

/// Why the identification failed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum IdentifyError {
    /// No recording was given.
    #[error("no recording to identify from")]
    NoRecording,
    /// No steady sliding anywhere.
    #[error(
        "no steady sliding found: {strokes} strokes, {steady_segments} constant-velocity segments, none of them \
         after the deformation and free of clipped readings; and no model could be fitted to the motion as a whole, {motion}\n\nhint: record strokes \
         at constant velocity (within 2 %, longer than 50 ms) that are longer than the seal's deformation, in both directions and at \
         several speeds, or half a minute of motion with many reversals in which the tip touches nothing; a part of a recording is taken by, \
         for example, ‹from_s=10› ‹to_s=60›"
    )]
    NoSteadySliding {
        /// Strokes found.
        strokes: usize,
        /// Constant-velocity segments found.
        steady_segments: usize,
        /// How much motion there was.
        motion: MotionFound,
    },
    /// The force opposes the motion.
    #[error(
        "the sliding force opposes the motion: F_c = {coulomb_force:.3} N, expected above 0 N\n\nhint: the force is what the device \
         exerts on the seal, and the position increases on insertion; the data do not show which of the two is reversed: {way_out}"
    )]
    ForceSign {
        /// Coulomb force found, N.
        coulomb_force: f64,
        /// How to reverse either, with the names of the file if they are known.
        way_out: String,
    },
    /// The force is constant, or exceeds the range of any sensor.
    #[error(
        "{name}: the force {what}, from which no friction can be identified\n\nhint: is the sensor connected, and is force_n the right \
         column, in newtons?"
    )]
    NoForce {
        /// Name of the recording.
        name: String,
        /// Description of the force.
        what: String,
    },
    /// The same recording was given twice.
    #[error(
        "{first} and {second} hold the same bytes: counted twice, they would make every interval too narrow"
    )]
    SameRecording {
        /// Name of the first.
        first: String,
        /// Name of the second.
        second: String,
    },
    /// The identified parameters do not form a valid model.
    #[error("the identified parameters form no valid model: {0}")]
    NotAModel(#[from] trocar_model::ParamError),
    /// Parameters are kept where other options leave no place for them.
    #[error(
        "parameters are kept ({0}), which is possible neither in the paper's procedure, nor with a prior or posterior draws, nor \
         without the term that they belong to"
    )]
    Kept(String),
    /// Polynomial degree outside 2 to 7.
    #[error("polynomial degree must be between 2 and 7, got {0}")]
    Degree(usize),
}

/// What a warning concerns; displayed and serialised as its name.
#[derive(Debug, Clone, PartialEq)]
pub enum Subject {
    /// A parameter (`viscous_damping_n_s_m`).
    Parameter(ParameterId),
    /// A recording, by its name (`steady.csv`).
    Recording(String),
    /// A part of the fit or of the readings (`fit`, `ripple`).
    Topic(&'static str),
}

impl fmt::Display for Subject {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Parameter(id) => id.fmt(f),
            Self::Recording(name) => name.fmt(f),
            Self::Topic(name) => name.fmt(f),
        }
    }
}

impl Serialize for Subject {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl From<Quantity> for Subject {
    fn from(quantity: Quantity) -> Self {
        Self::Parameter(quantity.id())
    }
}

impl From<ParameterId> for Subject {
    fn from(id: ParameterId) -> Self {
        Self::Parameter(id)
    }
}

impl From<&Recording> for Subject {
    fn from(recording: &Recording) -> Self {
        Self::Recording(recording.name.clone())
    }
}

impl From<&'static str> for Subject {
    fn from(topic: &'static str) -> Self {
        Self::Topic(topic)
    }
}

impl IdentifyError {
    /// The force of `recordings` opposes their motion.
    pub(super) fn force_sign(coulomb_force: f64, recordings: &[Recording]) -> Self {
        let warnings = recordings.iter().flat_map(|recording| &recording.quality.warnings);
        let mut own = warnings.filter(|warning| warning.kind == WarningKind::ForceSign);
        let way_out =
            own.find_map(|warning| warning.hint.clone()).unwrap_or_else(|| OPPOSED.to_owned());
        Self::ForceSign { coulomb_force, way_out }
    }
}

/// A warning about the result.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Warning {
    /// What it concerns.
    pub subject: Subject,
    /// The problem and its remedy.
    pub message: String,
    /// Whether the result is doubtful or incomplete because of it (exit code 3).
    pub doubtful: bool,
    /// Whether it reports that the data do not determine a parameter.
    #[serde(skip)]
    pub undetermined: bool,
    /// Whether a person can do something about it: what else is not doubtful is for the report.
    #[serde(skip)]
    pub is_advice: bool,
}

impl Warning {
    /// A reason to doubt the result.
    pub fn doubt(subject: impl Into<Subject>, message: String) -> Self {
        Self { doubtful: true, ..Self::remark(subject, message) }
    }

    /// What to do for a better result.
    pub(crate) fn advice(subject: impl Into<Subject>, message: String) -> Self {
        Self { is_advice: true, ..Self::remark(subject, message) }
    }

    /// A remark.
    pub(crate) fn remark(subject: impl Into<Subject>, message: String) -> Self {
        let (doubtful, undetermined, is_advice) = (false, false, false);
        Self { subject: subject.into(), message, doubtful, undetermined, is_advice }
    }

    /// The data do not determine `parameter`.
    pub(crate) fn undetermined(parameter: &Parameter) -> Self {
        use Quantity as Q;
        let why = parameter.estimate.note.as_deref().unwrap_or("not identifiable from these data");
        let message = format!("not determined: {why}");
        // Branches are known without their joins, which are never asked for.
        let is_join = matches!(parameter.id.quantity, Q::Join | Q::JoinForce);
        // The forces in the recorded motion are known without the speeds and times of such effects.
        let is_advice = matches!(
            parameter.id.quantity,
            Q::Offset
                | Q::StribeckVelocity
                | Q::StribeckExponent
                | Q::CreepVelocity
                | Q::FrictionLag
                | Q::RelaxationTime
                | Q::SecondRelaxationTime
        );
        let doubtful = !is_join && !is_advice;
        Self { doubtful, undetermined: true, is_advice, ..Self::remark(parameter.id, message) }
    }
}

/// An estimated parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Which; its name in `summary.json` is that of the id.
    pub id: ParameterId,
    /// Value and interval.
    pub estimate: Estimate,
}

impl Parameter {
    /// A parameter with its estimate.
    pub(crate) fn new(id: impl Into<ParameterId>, estimate: Estimate) -> Self {
        Self { id: id.into(), estimate }
    }

    /// Whether it is a coefficient of a branch (EMS (25)): determined together with the others
    /// only.
    pub fn is_coefficient(&self) -> bool {
        matches!(self.id.quantity, Quantity::Coefficient { .. })
    }
}

/// Covariance of the parameters of a fit that have a standard error.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Covariance {
    /// Their names, in the order of rows and columns.
    pub parameters: Vec<String>,
    /// The matrix, row by row; the unit of an entry is the product of the units of its parameters.
    pub rows: Vec<Vec<f64>>,
}

/// Callback for a progress display: name of the stage and fraction done, 0 to 1.
pub type Progress<'a> = &'a (dyn Fn(&str, f64) + Sync);
