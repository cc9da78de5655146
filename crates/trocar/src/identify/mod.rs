//! From recordings to an EMS element: the paper's two steps (EMS section IV), then a refinement.
//!
//! ```text
//! recordings -> passes, stretches -> F_0, F_c, β (23), Stribeck (11)        steady.rs, stribeck.rs
//!            -> traverses, c, branches (12), (24)-(26), σ (figure 7)        deformation.rs, shape.rs
//!            -> all against simulated force, the steady state held, intervals  candidate.rs, training.rs, output_error.rs
//! ```
//! Before, late positions are put in step (timing.rs); after, the force along the way is fitted where strokes repeat
//! (along.rs).
//!
//! Every recording is searched for what it can give. What the data do not pin is part of the result: an infinite
//! interval, the reason, and a warning.

use serde::Serialize;
use trocar_model::{Element, Relaxation, SlidingFriction, Stages};

use crate::recording::{Recording, RecordingError, local_acceleration};
use crate::segment::{Pass, SegmentOptions, Stretch, behind_start, passes, reversal_threshold, stretches};
use crate::travel::{TravelFit, TravelProfile};

pub use candidate::Candidate;
use deformation::Sensors;
pub use deformation::{BINS, BranchFit, DampingTest, DeformationFit, Limits, Traverse, bin_centres, legendre};
pub use estimate::Estimate;
pub(crate) use estimate::t_quantile;
pub use motion::{FreeMotion, Ingredient, IngredientTrial, MotionFit};
pub use refit::EmsRefit;
pub(crate) use refit::refit;
pub use shape::{BranchShape, Pins};
pub use stage::SecondStage;
pub use steady::{DirectionLine, LackOfFit, PassMean, SteadyFit, StribeckFit};
pub use timing::{PositionLag, position_lag};

mod along;
mod candidate;
pub mod classical;
mod coarse;
mod conclude;
mod deformation;
mod estimate;
mod motion;
mod nnls;
mod output_error;
mod random;
mod refit;
mod replicates;
mod shape;
mod spread;
mod stage;
mod steady;
mod stribeck;
mod timing;
mod training;

/// How to identify.
#[derive(Debug, Clone)]
pub struct IdentifyOptions {
    /// Resamples of the bootstrap over cycles; 0 takes the jackknife for all intervals.
    pub bootstrap: usize,
    /// Seed of everything random.
    pub seed: u64,
    /// Degrees of the two joined polynomials, 2 to 7 (EMS (25): 4 and 4).
    pub degrees: [usize; 2],
    /// Whether to refine the result against simulated force.
    pub refine: bool,
    /// Whether to fit the element to all motion, with creep, relaxation and minor loops, where the recordings hold any.
    pub free_motion: bool,
    /// Ingredients that this fit does not try.
    pub without: Vec<Ingredient>,
    /// Whether to fit how the force depends on the position, where strokes repeat.
    pub along: bool,
    /// Whether to estimate a mass between sensor and seal that was not declared.
    pub estimate_hidden_mass: bool,
    /// Whether the inertia of the moving mass was taken out of the readings: transients then count as sliding too,
    /// where the deformation is less than a hundredth of the stroke.
    pub inertia_removed: bool,
    /// Tolerances of the segmentation.
    pub segment: SegmentOptions,
}

impl Default for IdentifyOptions {
    fn default() -> Self {
        Self {
            bootstrap: 200,
            seed: 1,
            degrees: [4, 4],
            refine: true,
            free_motion: true,
            without: Vec::new(),
            along: true,
            estimate_hidden_mass: true,
            inertia_removed: false,
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
         behind the deformation and free of clipped readings; and too little free motion to fit a model to\n\nhint: record strokes \
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

/// The refinement beside the two-step result.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Refinement {
    /// Weighted root mean square error, N, of the two-step result on all passes.
    pub two_step_rms_n: f64,
    /// The same after the refinement.
    pub refined_rms_n: f64,
    /// Error of the two steps on passes held out from them, N (each half of the passes from the other).
    pub held_out_two_step_rms_n: f64,
    /// Error there of the refinement, N.
    pub held_out_refined_rms_n: f64,
    /// Damped steps taken.
    pub iterations: usize,
    /// Whether it came to rest.
    pub converged: bool,
    /// Whether it was accepted: never when worse on the held-out passes.
    pub accepted: bool,
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
    /// The two-step result, before the refinement.
    pub two_step: Candidate,
    /// All parameters with intervals.
    pub parameters: Vec<Parameter>,
    /// The same parameters by the paper's two steps alone.
    pub two_step_parameters: Vec<Parameter>,
    /// Steady-state step.
    pub steady: SteadyFit,
    /// Dynamic step, or why there is none.
    pub deformation: Result<DeformationFit, String>,
    /// Refinement; `None` when it was not asked for or not possible.
    pub refinement: Option<Refinement>,
    /// What the recordings hold beyond full strokes.
    pub free_motion: Option<FreeMotion>,
    /// The fit to all motion, which then is the model; `None` when it was not asked for or there was nothing to fit.
    pub motion: Option<MotionFit>,
    /// The delay of the positions that was found and taken out; `None` when none shows.
    pub position_lag: Option<PositionLag>,
    /// How the force depends on the position beside the element; `None` where strokes left out are predicted no better.
    pub travel: Option<TravelFit>,
    /// Why strokes that repeat gave no `travel`.
    pub travel_missing: Option<String>,
    /// Numbers of the model that the recordings gave, without the sensor's offset and an undeclared mass.
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

    /// The profile along the way.
    pub fn profile(&self) -> Option<&TravelProfile> {
        self.travel.as_ref().map(|fit| &fit.profile)
    }

    /// The recordings as the model is to be compared with them: without the delay of the positions.
    ///
    /// # Errors
    /// As for [`Recording::with_position_lag`].
    pub fn in_step(&self, recordings: Vec<Recording>) -> Result<Vec<Recording>, RecordingError> {
        let Some(PositionLag { lag_s, .. }) = self.position_lag else { return Ok(recordings) };
        recordings.iter().map(|recording| recording.with_position_lag(lag_s)).collect()
    }

    /// A remark for the model file where the deformation was not identified.
    pub(crate) fn deformation_note(&self) -> Option<String> {
        let fitted = self.parameter("half_width_m").is_some_and(|width| width.pinned);
        let assumed = self.deformation.as_ref().err().filter(|_| !fitted);
        assumed.map(|why| format!("deformation assumed, not identified: {why}"))
    }

    /// Whether data were lost or parameters are not pinned (exit code 3).
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
/// [`IdentifyError`] when there is nothing to identify from; what is merely not pinned is part of the result.
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
    progress("timing", 0.0);
    let again = |recordings: &[Recording]| element(recordings, options, progress);
    let Some(lag) = position_lag(recordings).filter(|_| along::repeats(recordings)) else {
        return Ok(along::extend(again(recordings)?, recordings, options, again));
    };
    let in_step = |lag: f64| recordings.iter().map(|r| r.with_position_lag(lag)).collect::<Result<Vec<_>, _>>();
    // Intervals are not asked for.
    let quick = IdentifyOptions { bootstrap: 0, ..options.clone() };
    let error = |lag: f64| {
        let recordings = in_step(lag).ok()?;
        along::error(&element(&recordings, &quick, progress).ok()?, &recordings, lag)
    };
    let lag = timing::settle(lag, error);
    // Long enough for every delay tried.
    let recordings = in_step(lag.lag_s).unwrap_or_else(|_| recordings.to_vec());
    let found = along::extend(again(&recordings)?, &recordings, options, again);
    Ok(Identification { position_lag: Some(lag).filter(|lag| lag.lag_s > 0.0), ..found })
}

/// The element alone, from positions in step with the forces.
fn element(
    recordings: &[Recording],
    options: &IdentifyOptions,
    progress: Progress,
) -> Result<Identification, IdentifyError> {
    progress("segmenting", 0.02);
    let segments: Vec<Segments> = recordings.iter().map(|r| segment(r, &options.segment)).collect();
    progress("steady state", 0.1);
    let (steady, deformation) = two_steps(recordings, &segments, options)?;
    let no_steady_sliding = steady.means.is_empty();
    let (two_step, assumed) = candidate_of(&steady, &deformation, recordings);
    let found = conclude::conclude(
        conclude::TwoSteps { recordings, segments: &segments, steady, deformation, candidate: two_step, assumed },
        options,
        progress,
    )?;
    let found = coarse::refit(found, recordings, options);
    let found = motion::extend(found, recordings, &segments, options, progress);
    if no_steady_sliding && found.motion.is_none() {
        return Err(IdentifyError::NoSteadySliding {
            passes: segments.iter().map(|s| s.passes.len()).sum(),
            stretches: segments.iter().map(|s| s.stretches.len()).sum(),
        });
    }
    Ok(found)
}

fn segment(recording: &Recording, options: &SegmentOptions) -> Segments {
    let passes = passes(recording, reversal_threshold(recording));
    let stretches = stretches(recording, &passes, options);
    Segments { passes, stretches }
}

/// Steady state and deformation, each with what the other has found: where the sliding has settled depends on the
/// deformation, and the switching level (12) on the sliding force.
fn two_steps(
    recordings: &[Recording],
    segments: &[Segments],
    options: &IdentifyOptions,
) -> Result<(SteadyFit, Result<DeformationFit, String>), IdentifyError> {
    let means = |settled: &dyn Fn(f64) -> f64, second_half: bool| -> Vec<PassMean> {
        let of = |(i, (r, s)): (usize, (&Recording, &Segments))| {
            let halved: Vec<Stretch> = s.stretches.iter().map(|st| latter_half(r, st)).collect();
            steady::pass_means(i, r, &s.passes, if second_half { &halved } else { &s.stretches }, settled)
        };
        recordings.iter().zip(segments).enumerate().flat_map(of).collect()
    };
    let deform = |steady: &SteadyFit| {
        let limits = limits(steady, sensors(recordings).force_noise);
        let found = recordings.iter().zip(segments).enumerate();
        let of = |(i, (r, s)): (usize, (&Recording, &Segments))| {
            let levels = pass_levels(i, s, steady);
            deformation::traverses(i, r, &s.passes, &limits, |pass| levels[pass])
        };
        let traverses = found.flat_map(of).collect();
        deformation::fit(traverses, &limits, options.degrees, sensors(recordings))
    };
    let mut steady = steady::fit(steady::imposed(means(&|_| 0.0, true)));
    let mut deformation = deform(&steady);
    for _ in 0..2 {
        let Ok(found) = &deformation else { break };
        let settled = steady::imposed(means(&|v| settled_travel(&steady, found, v), false));
        if settled.len() < 2 {
            break;
        }
        steady = steady::fit(settled);
        deformation = deform(&steady);
    }
    let longest = recordings.iter().map(|r| r.quality.stroke).fold(0.0, f64::max);
    let negligible = deformation.as_ref().map_or(true, |found| 2.0 * found.half_width.value < 0.01 * longest);
    if negligible && options.inertia_removed {
        steady = steady::fit(with_transients(steady.means, recordings, segments));
    } else if deformation.is_err() {
        steady = steady::fit(without_trend(means(&|_| 0.0, false), recordings, segments));
    }
    if steady.means.is_empty() {
        let why = "nothing slides steadily behind a reversal".to_owned();
        return Ok((steady::from_levels(recordings)?, Err(why)));
    }
    if steady.coulomb_force_n.ci95[1] <= 0.0 {
        return Err(IdentifyError::ForceSign { coulomb_force: steady.coulomb_force_n.value });
    }
    stribeck::test(&mut steady, options.seed);
    if steady.stribeck.is_some() && deformation.is_ok() {
        deformation = deform(&steady);
    }
    Ok((steady, deformation))
}

/// The two steps once more, from the part of their data that `chosen` (recording, sample) lets through.
fn two_steps_of_part(
    steady: &SteadyFit,
    found: &DeformationFit,
    recordings: &[Recording],
    options: &IdentifyOptions,
    chosen: impl Fn(usize, usize) -> bool,
) -> Option<Candidate> {
    let means = steady.means.iter().filter(|m| chosen(m.recording, m.sample)).cloned().collect();
    let mut part = steady::fit(means);
    stribeck::test(&mut part, options.seed);
    let traverses = found.traverses.iter().filter(|t| chosen(t.recording, t.from)).cloned().collect();
    let sensors = sensors(recordings);
    let deformation = deformation::fit(traverses, &limits(&part, sensors.force_noise), options.degrees, sensors);
    deformation.is_ok().then(|| candidate_of(&part, &deformation, recordings).0)
}

/// Sliding force of each pass relative to the fitted line; 1 for a pass without a mean of its own.
fn pass_levels(index: usize, segments: &Segments, steady: &SteadyFit) -> Vec<f64> {
    let mut levels = vec![1.0; segments.passes.len()];
    for mean in steady.means.iter().filter(|m| m.recording == index) {
        let fitted = steady.line(mean.velocity_m_s) - steady.offset_n.value;
        let level = (mean.force_n - steady.offset_n.value) / fitted;
        let pass = segments.passes.partition_point(|p| p.end <= mean.sample);
        // A mean far off the line is no small variation of the whole force.
        if pass < levels.len() && (level - 1.0).abs() < 0.2 {
            levels[pass] = level;
        }
    }
    levels
}

/// The coarsest sensors among the recordings'.
fn sensors(recordings: &[Recording]) -> Sensors {
    let coarsest = |of: fn(&Recording) -> f64| recordings.iter().map(of).fold(0.0, f64::max);
    Sensors {
        position_step: coarsest(|r| r.quality.position_resolution),
        force_noise: coarsest(|r| r.quality.force_noise),
    }
}

/// Travel, m, behind a reversal after which the sliding at `speed`, m/s, has settled: the deformation and five time
/// constants β/K.
fn settled_travel(steady: &SteadyFit, found: &DeformationFit, speed: f64) -> f64 {
    let stiffness = deformation::end_stiffness(&found.rising, &found.falling, found.half_width.value);
    let time_constant = steady.viscous_damping_n_s_m.value.max(0.0) / stiffness;
    2.2 * found.half_width.value + 5.0 * time_constant * speed
}

/// The part of each stretch in which the sliding has settled.
fn settled_stretches(
    recording: &Recording,
    segments: &Segments,
    steady: &SteadyFit,
    found: &DeformationFit,
) -> Vec<Stretch> {
    behind_start(recording, &segments.passes, &segments.stretches, |speed| settled_travel(steady, found, speed))
}

/// Blocks of all motion instead of the plateaus' means, down to a fiftieth of the fastest plateau.
fn with_transients(plateaus: Vec<PassMean>, recordings: &[Recording], segments: &[Segments]) -> Vec<PassMean> {
    const BLOCK: f64 = 0.1;
    let fastest = plateaus.iter().map(|m| m.velocity_m_s.abs()).fold(0.0, f64::max);
    if fastest == 0.0 {
        return plateaus;
    }
    let found = recordings.iter().zip(segments).enumerate();
    found.flat_map(|(i, (r, s))| steady::moving_means(i, r, &s.passes, 0.02 * fastest, BLOCK)).collect()
}

fn latter_half(recording: &Recording, stretch: &Stretch) -> Stretch {
    let x = &recording.position;
    let middle = 0.5 * (x[stretch.start] + x[stretch.end - 1]);
    let rising = x[stretch.end - 1] > x[stretch.start];
    let behind = |i: &usize| if rising { x[*i] >= middle } else { x[*i] <= middle };
    let start = (stretch.start..stretch.end).find(behind).unwrap_or(stretch.start);
    Stretch { start, ..*stretch }
}

/// Drops means of stretches over which the force still climbs from one limit to the other: no sliding.
fn without_trend(means: Vec<PassMean>, recordings: &[Recording], segments: &[Segments]) -> Vec<PassMean> {
    let steady = |mean: &PassMean| {
        let recording = &recordings[mean.recording];
        let mut sorted = recording.force.clone();
        sorted.sort_by(f64::total_cmp);
        let swing = sorted[sorted.len() * 19 / 20] - sorted[sorted.len() / 20];
        let own = segments[mean.recording].stretches.iter().filter(|s| s.plateau == mean.plateau);
        let quarter = |s: &Stretch| ((s.end - s.start) / 4).max(1);
        let level = |from: usize, to: usize| recording.force[from..to].iter().sum::<f64>() / (to - from) as f64;
        own.map(|s| (level(s.end - quarter(s), s.end) - level(s.start, s.start + quarter(s))).abs())
            .all(|trend| trend < 0.4 * swing)
    };
    let keep: Vec<bool> = means.iter().map(steady).collect();
    means.into_iter().zip(keep).filter_map(|(m, k)| k.then_some(m)).collect()
}

/// Sliding friction of both directions and the sensor offset, from the steady state.
///
/// With different slopes the offset is taken so that both Coulomb forces are equal: the data cannot divide the two.
fn sliding(steady: &SteadyFit) -> (f64, SlidingFriction, SlidingFriction) {
    let least = 1e-6;
    let own_slopes = steady.is_asymmetric() && steady.stribeck.is_none();
    if let (true, Some(plus), Some(minus)) = (own_slopes, &steady.positive, &steady.negative) {
        let coulomb = 0.5 * (plus.coulomb_force_n.value + minus.coulomb_force_n.value);
        let offset = 0.5 * (plus.coulomb_force_n.value - minus.coulomb_force_n.value);
        let friction = |line: &DirectionLine| {
            SlidingFriction::coulomb(coulomb.max(least), line.viscous_damping_n_s_m.value.max(0.0))
        };
        return (offset, friction(plus), friction(minus));
    }
    let mut friction =
        SlidingFriction::coulomb(steady.coulomb_force_n.value.max(least), steady.viscous_damping_n_s_m.value.max(0.0));
    if let Some(stribeck) = &steady.stribeck {
        friction.static_force = stribeck.static_force_n.value.max(friction.coulomb_force);
        friction.stribeck_velocity = stribeck.stribeck_velocity_m_s.value;
        friction.stribeck_exponent = stribeck.stribeck_exponent;
    }
    (steady.offset_n.value, friction, friction)
}

/// Levels at which the seal switches (12).
///
/// Where one speed leaves the level at rest open, it is the lower edge of the sliding force: its mean less twice the
/// ripple (scatter within and between passes beyond the sensor's noise).
fn limits(steady: &SteadyFit, noise: f64) -> Limits {
    let (offset, insertion, withdrawal) = sliding(steady);
    let scatters = steady.means.iter().map(|m| (m.scatter_n.powi(2) - noise * noise).max(0.0));
    let ripple = (scatters.sum::<f64>() / steady.means.len().max(1) as f64).sqrt();
    let margin = if steady.viscous_damping_n_s_m.pinned { 0.0 } else { 2.0 * ripple.hypot(steady.pass_scatter_n) };
    Limits { offset, positive: insertion.static_force, negative: withdrawal.static_force, margin }
}

/// Two-step candidate; with the deformation not resolved a stiff straight spring stands in for it (second value true).
fn candidate_of(
    steady: &SteadyFit,
    deformation: &Result<DeformationFit, String>,
    recordings: &[Recording],
) -> (Candidate, bool) {
    let (offset, insertion, withdrawal) = sliding(steady);
    let straight = || BranchShape {
        join: 0.0,
        join_force: 0.5 * (insertion.static_force - withdrawal.static_force),
        left: vec![0.0],
        right: vec![0.0],
    };
    let step = sensors(recordings).position_step;
    let (half_width, rising, falling, seal_damping) = match deformation {
        Ok(found) => {
            let kept = found.damping.as_ref().filter(|d| d.kept).map_or(0.0, |d| d.seal_damping_n_s_m.value);
            (found.half_width.value, found.rising.shape.clone(), found.falling.shape.clone(), kept)
        }
        Err(_) => ((20.0 * step).max(5e-5), straight(), straight(), 0.0),
    };
    let candidate = Candidate {
        offset,
        hidden_mass: 0.0,
        insertion,
        withdrawal,
        half_width,
        rising,
        falling,
        seal_damping,
        yield_ratio: Candidate::DEFAULT_YIELD_RATIO,
        creep_velocity: 0.0,
        friction_lag: 0.0,
        relaxation: Relaxation::NONE,
        second: None,
    };
    (candidate, deformation.is_err())
}

/// Acceleration, m/s², over the window that the sampling and the encoder ask for.
fn acceleration(recording: &Recording) -> Vec<f64> {
    local_acceleration(recording, recording.acceleration_window())
}

/// Force, N, of the inertia of `mass`, kg, at every sample.
fn inertia(recording: &Recording, mass: f64) -> Vec<f64> {
    if mass == 0.0 {
        return vec![0.0; recording.len()];
    }
    acceleration(recording).into_iter().map(|a| mass * a).collect()
}
