//! From recordings to an EMS element.
//!
//! ```text
//! recordings -> passes, stretches -> F_0, F_c, β (23), Stribeck (11)            steady.rs, stribeck.rs
//!            -> traverses, c, branches (12), (24)-(26), σ (figure 7)            deformation.rs, shape.rs       the paper's two steps
//!            -> all motion against simulated force: one likelihood              likelihood.rs, training.rs
//!               friction scale of each stroke, optional terms                   element.rs, scale.rs, terms.rs
//!            -> the force along the position, where strokes repeat it           along.rs
//!            -> intervals                                                       numbers.rs, spread.rs
//!            -> what the data determine, and whether the model is adequate      adequacy.rs, stick_slip.rs
//!            -> the result                                                      conclude.rs
//! ```
//!
//! Each stage takes data and options and returns its own result; they are put together once, in conclude.rs. What the data do not
//! determine is part of the result: an infinite interval, the reason, and a warning.

use serde::Serialize;
use trocar_model::{Element, Stages, Trocar};

use crate::profile::ProfileFit;
use crate::recording::{Recording, RecordingError, range};
use crate::segment::{Pass, SegmentOptions, Stretch, passes, reversal_threshold, stretches};

pub use adequacy::Phase;
pub use candidate::Candidate;
pub use deformation::{BINS, BranchFit, DampingTest, DeformationFit, Limits, Traverse, bin_centres, legendre};
pub use delay::PositionDelay;
pub use estimate::Estimate;
pub(crate) use estimate::t_quantile;
pub use free_motion::FreeMotion;
pub use refit::EmsRefit;
pub(crate) use refit::refit;
pub use scale::{FrictionScale, Jump, StrokeFriction};
pub use shape::{BranchShape, Pins};
pub use stage::SecondStage;
pub use steady::{DirectionLine, LackOfFit, PassMean, SteadyFit, StribeckFit};
pub use stick_slip::StickSlip;
pub use terms::{Term, TermTrial};

mod adequacy;
mod along;
mod candidate;
pub mod classical;
mod conclude;
mod deformation;
mod delay;
mod element;
mod estimate;
mod free_motion;
mod likelihood;
mod nnls;
mod numbers;
mod random;
mod refit;
mod replicates;
mod scale;
mod shape;
mod spread;
mod stage;
mod steady;
mod stick_slip;
mod stribeck;
mod terms;
mod training;
mod two_steps;
mod unexplained;

/// How to identify.
#[derive(Debug, Clone)]
pub struct IdentifyOptions {
    /// Resamples of the bootstrap over cycles; 0 takes the jackknife for all intervals.
    pub bootstrap: usize,
    /// Seed of everything random.
    pub seed: u64,
    /// Degrees of the two joined polynomials, 2 to 7 (EMS (25): 4 and 4).
    pub degrees: [usize; 2],
    /// Whether the terms are tried of which rests and partial reversals tell: creep, relaxation, minor loops, a second stage.
    pub free_motion: bool,
    /// Optional terms that are not tried.
    pub without: Vec<Term>,
    /// Whether to fit how the force depends on the position, where strokes repeat.
    pub along: bool,
    /// Whether to estimate a mass between sensor and seal that was not declared.
    pub estimate_unmodelled_mass: bool,
    /// Whether the inertia of the moving mass was taken out of the readings: transients then count as sliding too,
    /// where the deformation is less than a hundredth of the stroke.
    pub inertia_removed: bool,
    /// Reading of the sensor without load, N, where it is known (a tare); `None` estimates it.
    pub offset: Option<f64>,
    /// Whether to identify by the procedure of the paper alone.
    pub paper: bool,
    /// Tolerances of the segmentation.
    pub segment: SegmentOptions,
}

impl Default for IdentifyOptions {
    fn default() -> Self {
        Self {
            bootstrap: 200,
            seed: 1,
            degrees: [4, 4],
            free_motion: true,
            without: Vec::new(),
            along: true,
            estimate_unmodelled_mass: true,
            inertia_removed: false,
            offset: None,
            paper: false,
            segment: SegmentOptions::default(),
        }
    }
}

/// Why nothing could be identified.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum IdentifyError {
    /// No recording was given.
    #[error("no recording to identify from")]
    NoRecording,
    /// Nothing slides steadily anywhere.
    #[error(
        "no steady sliding found: {passes} passes between reversals, {stretches} stretches of constant velocity, none of them \
         after the deformation and free of clipped readings; and too little free motion to fit a model to\n\nhint: record strokes \
         at constant velocity (within 2 %, longer than 50 ms) that are longer than the seal's deformation, in both directions and at \
         several speeds, or half a minute of motion with many reversals"
    )]
    NoSteadySliding {
        /// Passes found.
        passes: usize,
        /// Stretches found.
        stretches: usize,
    },
    /// The force opposes the motion.
    #[error(
        "the sliding force opposes the motion: F_c = {coulomb_force:.3} N, expected above 0 N\n\nhint: the force is what the device \
         exerts on the seal; if the sensor is mounted the other way round, use --flip-force"
    )]
    ForceSign {
        /// Coulomb force found, N.
        coulomb_force: f64,
    },
    /// The force does not change, or by more than any sensor reads.
    #[error(
        "{name}: the force {what}, from which no friction can be identified\n\nhint: is the sensor connected, and is force_n the right \
         column, in newtons?"
    )]
    NoForce {
        /// Name of the recording.
        name: String,
        /// What it does instead.
        what: String,
    },
    /// A recording is given twice.
    #[error("{first} and {second} hold the same bytes: counted twice, they would make every interval too narrow")]
    SameRecording {
        /// Name of the first.
        first: String,
        /// Name of the second.
        second: String,
    },
    /// The numbers found do not make a model.
    #[error("the identified numbers do not make a model: {0}")]
    NotAModel(#[from] trocar_model::ParamError),
    /// Polynomial degree outside 2 to 7.
    #[error("polynomial degree must be between 2 and 7, got {0}")]
    Degree(usize),
}

/// Something that the user should know about the result.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Warning {
    /// What concerns it (`viscous_damping_n_s_m`, `steady.csv`).
    pub subject: String,
    /// What it is and what to do.
    pub message: String,
    /// Whether the result is doubtful or incomplete because of it (exit code 3).
    pub doubtful: bool,
}

impl Warning {
    /// How the message of a number begins that the data do not determine.
    const UNDETERMINED: &str = "not determined: ";

    /// That the data do not determine the number `subject`.
    pub(crate) fn undetermined(subject: &str, estimate: &Estimate, doubtful: bool) -> Self {
        let why = estimate.note.as_deref().unwrap_or("not identifiable from these data");
        Self { subject: subject.to_owned(), message: format!("{}{why}", Self::UNDETERMINED), doubtful }
    }

    /// Whether it says that the data do not determine a number.
    pub fn is_undetermined(&self) -> bool {
        self.message.starts_with(Self::UNDETERMINED)
    }
}

/// How the fit of the likelihood came out.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FitSummary {
    /// Optional terms on trial.
    pub terms: Vec<TermTrial>,
    /// Root mean square error, N, of the paper's element fitted to all motion, each stroke's friction scale taken out.
    pub paper_rms_n: f64,
    /// The same of the model.
    pub rms_n: f64,
    /// Iterations of the last fit.
    pub iterations: usize,
    /// Whether it converged.
    pub converged: bool,
}

/// A named parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Name with unit, as in `summary.json`.
    pub name: String,
    /// Value and interval.
    pub estimate: Estimate,
}

/// What the recordings gave.
#[derive(Debug, Clone)]
pub struct Identification {
    /// The model's numbers.
    pub model: Candidate,
    /// The model, ready to run.
    pub stages: Stages,
    /// The two-step result.
    pub two_step: Candidate,
    /// All parameters with intervals.
    pub parameters: Vec<Parameter>,
    /// The same parameters by the paper's two steps alone.
    pub two_step_parameters: Vec<Parameter>,
    /// Steady-state step.
    pub steady: SteadyFit,
    /// Dynamic step, or why there is none.
    pub deformation: Result<DeformationFit, String>,
    /// The fit of the likelihood, which then is the model; `None` when it was not asked for or not possible.
    pub fit: Option<FitSummary>,
    /// How friction changed from stroke to stroke.
    pub friction_scale: FrictionScale,
    /// What the recordings hold beyond full strokes.
    pub free_motion: FreeMotion,
    /// Error of the model by phase of the motion.
    pub phases: Vec<Phase>,
    /// Where the force swings by itself; `None` where it does not.
    pub stick_slip: Option<StickSlip>,
    /// The delay of the positions that was found and compensated; `None` when none shows.
    pub position_delay: Option<PositionDelay>,
    /// How the force depends on the position beside the element; `None` where strokes left out are predicted no better.
    pub position_profile: Option<ProfileFit>,
    /// Why strokes that repeat gave no `travel`.
    pub no_position_profile: Option<String>,
    /// Numbers of the model that the recordings gave, without the sensor's offset and an unmodelled mass.
    pub free_parameters: usize,
    /// Root mean square error, N, of the model over the recordings it was identified from.
    pub residual_rms: f64,
    /// What to know about the result.
    pub warnings: Vec<Warning>,
}

impl Identification {
    /// The element, or the first of several stages.
    pub fn element(&self) -> &Element {
        self.stages.first()
    }

    /// The named parameter.
    pub fn parameter(&self, name: &str) -> Option<&Estimate> {
        self.parameters.iter().find(|p| p.name == name).map(|p| &p.estimate)
    }

    /// The model, with its position profile.
    pub fn trocar(&self) -> Trocar<&[f64]> {
        let profile = self.position_profile.as_ref().map(|fit| fit.profile.stored_as(|knots| knots));
        Trocar::new(self.stages, profile)
    }

    /// The recordings as the model is to be compared with them: without the delay of the positions.
    ///
    /// # Errors
    /// As for [`Recording::with_position_delay`].
    pub fn without_delay(&self, recordings: Vec<Recording>) -> Result<Vec<Recording>, RecordingError> {
        let Some(PositionDelay { delay_s, .. }) = self.position_delay else { return Ok(recordings) };
        recordings.iter().map(|recording| recording.with_position_delay(delay_s)).collect()
    }

    /// A remark for the model file where the deformation was not identified.
    pub(crate) fn deformation_note(&self) -> Option<String> {
        let fitted = self.fit.is_some();
        let assumed = self.deformation.as_ref().err().filter(|_| !fitted);
        assumed.map(|why| format!("deformation assumed, not identified: {why}"))
    }

    /// Whether data were lost or parameters are not determined (exit code 3).
    pub fn is_doubtful(&self) -> bool {
        self.warnings.iter().any(|w| w.doubtful)
    }
}

/// Stage of the work, for a progress display: words and part done, 0 to 1.
pub type Progress<'a> = &'a (dyn Fn(&str, f64) + Sync);

/// Passes and stretches of one recording.
struct Segments {
    passes: Vec<Pass>,
    stretches: Vec<Stretch>,
}

/// Identifies an EMS element from recordings of any motion.
///
/// Forces are expected without the inertia of a known moving mass
/// ([`Recording::without_moving_mass`](crate::recording::Recording)).
///
/// # Errors
/// [`IdentifyError`] when there is nothing to identify from; what is merely not determined is part of the result.
pub fn identify(
    recordings: &[Recording],
    options: &IdentifyOptions,
    progress: Progress,
) -> Result<Identification, IdentifyError> {
    if recordings.is_empty() {
        return Err(IdentifyError::NoRecording);
    }
    if let Some(degree) = options.degrees.into_iter().find(|d| !(2..=trocar_model::MAX_DEGREE).contains(d)) {
        return Err(IdentifyError::Degree(degree));
    }
    for (i, second) in recordings.iter().enumerate() {
        if let Some(first) = recordings[..i].iter().find(|r| r.sha256 == second.sha256) {
            return Err(IdentifyError::SameRecording { first: first.name.clone(), second: second.name.clone() });
        }
    }
    recordings.iter().try_for_each(shows_force)?;
    progress("steady state", 0.1);
    let (in_time, fit) = delay::fitted(recordings, options, progress)?;
    let (input, lag) = (in_time.input(options), in_time.lag);
    if fit.is_none() && input.two.steady.means.is_empty() {
        return Err(IdentifyError::NoSteadySliding {
            passes: input.segments.iter().map(|s| s.passes.len()).sum(),
            stretches: input.segments.iter().map(|s| s.stretches.len()).sum(),
        });
    }
    progress("position profile", 0.8);
    let (fit, profile) = along::profiled(&input, fit);
    progress("intervals", 0.9);
    conclude::conclude(&input, fit, profile, lag)
}

/// Swing of the force, in its noise, that noise alone hardly has.
const BEYOND_NOISE: f64 = 10.0;
/// Force, N, beyond those of instruments and of robots' axes.
const LARGEST_FORCE: f64 = 1e6;

/// Refuses a recording whose force holds no friction.
fn shows_force(recording: &Recording) -> Result<(), IdentifyError> {
    let no_force = |what: String| Err(IdentifyError::NoForce { name: recording.name.clone(), what });
    let (low, high) = range(&recording.force);
    let noise = recording.quality.force_noise;
    let largest = low.abs().max(high.abs());
    if largest > LARGEST_FORCE {
        return no_force(format!("reaches {largest:.1e} N, which no instrument exerts"));
    }
    // One stroke at constant speed has a constant force.
    if passes(recording, reversal_threshold(recording)).len() < 2 {
        return Ok(());
    }
    if low == high {
        return no_force(format!("is {low} N throughout"));
    }
    if high - low < BEYOND_NOISE * noise {
        return no_force(format!(
            "changes by {:.3} N, no more than its noise of {noise:.3} N rms makes it",
            high - low
        ));
    }
    Ok(())
}

fn segment(recording: &Recording, options: &SegmentOptions) -> Segments {
    let passes = passes(recording, reversal_threshold(recording));
    let stretches = stretches(recording, &passes, options);
    Segments { passes, stretches }
}
