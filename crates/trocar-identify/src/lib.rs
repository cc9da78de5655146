//! Identification of an EMS element from recordings.
//!
//! ```text
//! recordings -> positions between the counts of the encoder                       trocar-recording
//!            -> strokes, constant velocity -> F_0, F_c, β (23), Stribeck (11)    steady.rs, stribeck.rs
//!            -> full reversals, c, branches (12), (24)-(26), σ (figure 7)        deformation.rs, shape.rs       the paper's two steps
//!            -> all motion against simulated force: one likelihood              likelihood.rs, training.rs
//!               friction scale of each stroke, optional terms                   element.rs, scale.rs, terms.rs
//!            -> the force along the position, where strokes repeat it           along.rs
//!            -> intervals; joins by the likelihood along them                   numbers.rs, spread.rs, joins.rs
//!            -> what the data determine, and whether the model is adequate      adequacy.rs
//!            -> the result                                                      conclude.rs
//! ```
//!
//! Each stage takes data and options and returns its own result; conclude.rs assembles them. A
//! parameter that the data do not determine is reported with an infinite interval, the reason, and
//! a warning.

use std::borrow::Cow;
use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;
use trocar_recording::{Recording, range};
use trocar_simulate::segment::{reversal_threshold, strokes};

pub use trocar_simulate::motion_found::{FreeMotion, MotionFound};
pub use trocar_simulate::stick_slip::StickSlip;

pub use adequacy::Phase;
pub use candidate::Candidate;
pub use deformation::{
    BINS, BranchFit, DampingTest, DeformationFit, FullReversal, Limits, bin_centres, legendre,
};
pub use estimate::Estimate;
pub use estimate::t_quantile;
pub use findings::{Covariance, IdentifyError, Parameter, Progress, Subject, Warning};
pub use information::{Expected, Force, Information, Motion, Noise, Rows};
pub use kept::{Kept, KeptError, KeptParameter};
pub use numbers::reported;
pub use options::{Draws, IdentifyOptions};
pub use posterior::Posterior;
pub use refit::EmsRefit;
pub use refit::refit;
pub use result::{FitSummary, Identification};
pub use scale::{FrictionScale, Jump, StrokeFriction};
pub use seal_prior::{PriorUse, SealPrior};
pub use shape::{BranchShape, EndForces};
pub use stage::SecondStage;
pub use steady::{DirectionLine, LackOfFit, SteadyFit, StribeckFit, StrokeMean};
pub use terms::{Term, TermTrial};
pub use unexplained::PositionDelay;

mod adequacy;
mod along;
mod candidate;
pub mod classical;
mod conclude;
mod counts;
mod deformation;
mod delay;
mod divide;
mod element;
mod estimate;
mod findings;
mod information;
mod joins;
mod kept;
mod likelihood;
mod load;
mod numbers;
mod options;
pub mod posterior;
mod prior;
mod random;
mod refit;
mod result;
mod ripple;
mod rotation;
mod scale;
mod seal_prior;
mod shape;
mod spread;
mod stage;
mod steady;
mod stribeck;
mod terms;
mod training;
mod two_steps;
mod unexplained;

/// Identifies an EMS element from recordings of any motion.
///
/// Forces are expected without the inertia of a known moving mass
/// ([`Recording::without_moving_mass`](trocar_recording::Recording)).
///
/// # Errors
/// [`IdentifyError`] when there is nothing to identify from. Parameters that are merely not
/// determined are part of the result.
pub fn identify(
    recordings: &[Recording],
    options: &IdentifyOptions,
    progress: Progress,
) -> Result<Identification, IdentifyError> {
    if recordings.is_empty() {
        return Err(IdentifyError::NoRecording);
    }
    options.check()?;
    if let Some(degree) =
        options.degrees.into_iter().find(|d| !(2..=trocar_model::MAX_DEGREE).contains(d))
    {
        return Err(IdentifyError::Degree(degree));
    }
    for (i, second) in recordings.iter().enumerate() {
        if let Some(first) = recordings[..i].iter().find(|r| r.sha256 == second.sha256) {
            return Err(IdentifyError::SameRecording {
                first: first.name.clone(),
                second: second.name.clone(),
            });
        }
    }
    recordings.iter().try_for_each(shows_force)?;
    // Long recordings are not copied where nothing changes.
    let smooth: Cow<[Recording]> = match recordings.iter().all(Recording::is_smooth) {
        true => recordings.into(),
        false => {
            recordings.par_iter().map(|own| own.smoothed().into_owned()).collect::<Vec<_>>().into()
        }
    };
    rotation::identified(&smooth, options, |own| along_the_axis(own, options, progress))
}

fn along_the_axis(
    recordings: &[Recording],
    options: &IdentifyOptions,
    progress: Progress,
) -> Result<Identification, IdentifyError> {
    // Draws take about as long as all before them.
    let (last, share) = match options.posterior {
        Some(_) => ("posterior draws", 0.5),
        None => ("intervals", 1.0),
    };
    // Fits side by side, and stages that are repeated, do not take it back.
    let furthest = AtomicU64::new(0);
    let progress = &|stage: &str, part: f64| {
        let before = furthest.fetch_max(part.to_bits(), Ordering::Relaxed);
        progress(stage, share * part.max(f64::from_bits(before)));
    };
    progress("steady state", 0.0);
    let (in_time, fit) = delay::fitted(recordings, options, progress)?;
    let (input, lag) = (in_time.input(options), in_time.lag);
    if fit.is_none() && input.two.steady.means.is_empty() {
        return Err(IdentifyError::NoSteadySliding {
            strokes: input.segments.iter().map(|s| s.strokes.len()).sum(),
            steady_segments: input.segments.iter().map(|s| s.steady_segments.len()).sum(),
            motion: MotionFound::of(recordings, input.segments),
        });
    }
    progress("position profile", 0.75);
    let (fit, profile) = along::profiled(&input, fit);
    progress(last, 0.8);
    conclude::conclude(&input, fit, profile, lag)
}

/// Range of the force, in units of its noise, that noise alone rarely reaches.
const BEYOND_NOISE: f64 = 10.0;
/// Change of the force, N and as a fraction of the largest, that is rounding.
const LEAST_CHANGE: f64 = 1e-9;
const ROUNDING: f64 = 1e-9;
/// Force, N, beyond that of instruments and of robot axes.
const LARGEST_FORCE: f64 = 1e6;

/// Rejects a recording whose force contains no friction.
fn shows_force(recording: &Recording) -> Result<(), IdentifyError> {
    let no_force =
        |what: String| Err(IdentifyError::NoForce { name: recording.name.clone(), what });
    let (low, high) = range(&recording.force);
    let noise = recording.quality.force_noise;
    let largest = low.abs().max(high.abs());
    if largest > LARGEST_FORCE {
        return no_force(format!("reaches {largest:.1e} N, which no instrument exerts"));
    }
    // One stroke at constant speed has a constant force.
    if strokes(recording, reversal_threshold(recording)).len() < 2 {
        return Ok(());
    }
    // Interpolation between equal readings rounds.
    if high - low <= LEAST_CHANGE.max(ROUNDING * largest) {
        return no_force(format!("is {} N throughout", 0.5 * (low + high) + 0.0));
    }
    if high - low < BEYOND_NOISE * noise {
        return no_force(format!(
            "changes by {:.3} N, no more than its noise of {noise:.3} N rms makes it",
            high - low
        ));
    }
    Ok(())
}
