//! Delay of the position readings relative to the forces.
//!
//! A position delay shifts the whole simulated force in time: F(t) becomes F(t + T). Thus
//! ∂F/∂T = dF/dt is one more column of the normal equations. The delay is tested together with an
//! unmodelled mass and the damping of the deformation, which it could be mistaken for, and so only
//! where the sampling resolves these. A delay of the *force* is not estimated: it may belong to the
//! seal.

use super::element::{self, Begun, ElementFit, Input};
use super::findings::{IdentifyError, Progress};
use super::options::IdentifyOptions;
use super::terms::SUSPECTED;
use super::two_steps::{self, TwoSteps};
use super::unexplained::PositionDelay;
use rayon::prelude::*;
use trocar_recording::Recording;
use trocar_recording::loads::Recorded;
use trocar_simulate::segment::{Segments, segment};
use trocar_simulate::stick_slip::{LeftOut, StickSlip};

/// Recordings with the position delay compensated, the delay, and the estimate made from them.
pub(super) struct InTime {
    pub(super) recordings: Vec<Recording>,
    pub(super) lag: Option<PositionDelay>,
    pub(super) segments: Vec<Segments>,
    /// Accelerations of each recording, m/s².
    accelerations: Vec<Vec<f64>>,
    effects: Vec<Recorded>,
    /// Of each recording.
    left_out: Vec<LeftOut>,
    stick_slip: Option<StickSlip>,
    pub(super) two: TwoSteps,
}

/// Recordings in time with the fit begun to them, and with the terms it has grown.
type Start = (InTime, Option<Begun>);
type Grown = (InTime, Option<element::Grown>);

/// The error that a delay must leave, relative to that without one.
const BETTER: f64 = 0.995;

/// Compensates the position delay and fits the element, again if the optional terms change the
/// delay. There is no fit where none was requested or possible.
///
/// # Errors
/// As for the two steps.
pub(super) fn fitted(
    recordings: &[Recording],
    options: &IdentifyOptions,
    progress: Progress,
) -> Result<(InTime, Option<ElementFit>), IdentifyError> {
    let interval = recordings.iter().map(|r| r.quality.median_interval).fold(0.0, f64::max);
    let later = |lag: Option<PositionDelay>, more: Option<PositionDelay>| {
        let more =
            more.filter(|more| more.delay_s.abs() >= PositionDelay::NEGLIGIBLE * interval)?;
        let lag = (more.is_clear() || lag.is_some() && more.p_value < PositionDelay::CORRECTED)
            .then(|| more.added_to(lag))?;
        (lag.delay_s > -PositionDelay::NEGLIGIBLE * interval
            && lag.delay_s < PositionDelay::LONGEST)
            .then_some(lag)
    };
    let of = |recordings, lag| InTime::of(recordings, lag, options, progress);
    let grow = |(found, begun): Start| {
        let grown = begun.and_then(|begun| element::grow(&found.input(options), begun, progress));
        (found, grown)
    };
    let error = |(found, grown): &Grown| {
        grown.as_ref().map_or(f64::INFINITY, |grown| grown.error(&found.input(options)))
    };
    let left = |(found, grown): &Grown| Some(grown.as_ref()?.left(&found.recordings));
    let (found, begun) = of(recordings.to_vec(), None)?;
    let first = begun.as_ref().and_then(|begun| begun.position_delay(&found.recordings));
    let mut best = grow((found, begun));
    // Without the terms, a delay imitates some of them: only one that they leave is tried.
    let mut rest = left(&best);
    let is_left = |lag: &PositionDelay| lag.delay_s > 0.0 && lag.p_value < SUSPECTED;
    let mut next = later(None, first)
        .filter(|_| rest.as_ref().and_then(|rest| rest.lag.as_ref()).is_some_and(is_left));
    let mut delayed: Option<Start> = None;
    for _ in 0..PositionDelay::MOST {
        let Some(lag) = next else { break };
        let Ok(shifted) = shifted(recordings, lag) else { break };
        let (found, begun) = delayed.insert(of(shifted, Some(lag))?);
        let more = begun.as_ref().and_then(|begun| begun.position_delay(&found.recordings));
        next = later(found.lag, more);
    }
    if let Some(delayed) = delayed.map(grow)
        && error(&delayed) < BETTER * error(&best)
    {
        (rest, best) = (left(&delayed), delayed);
    }
    for _ in 0..PositionDelay::MOST_AFTER {
        let more =
            rest.and_then(|rest| if best.0.lag.is_some() { rest.lag_left } else { rest.lag });
        let Some(lag) = later(best.0.lag, more) else { break };
        let Ok(shifted) = shifted(recordings, lag) else { break };
        let other = grow(of(shifted, Some(lag))?);
        if error(&other) >= error(&best) {
            break;
        }
        (rest, best) = (left(&other), other);
    }
    let (mut found, grown) = best;
    let fit = grown.and_then(|grown| element::finish(&found.input(options), grown, progress));
    found.lag = found.lag.filter(|lag| lag.delay_s >= PositionDelay::NEGLIGIBLE * interval);
    Ok((found, fit))
}

fn shifted(
    recordings: &[Recording],
    lag: PositionDelay,
) -> Result<Vec<Recording>, trocar_recording::RecordingError> {
    recordings.iter().map(|r| r.with_position_delay(lag.delay_s.max(0.0))).collect()
}

impl InTime {
    fn of(
        recordings: Vec<Recording>,
        lag: Option<PositionDelay>,
        options: &IdentifyOptions,
        progress: Progress,
    ) -> Result<(Self, Option<Begun>), IdentifyError> {
        let segments: Vec<Segments> =
            recordings.iter().map(|r| segment(r, &options.segment)).collect();
        let (two, accelerations) = rayon::join(
            || two_steps::two_steps(&recordings, &segments, options),
            || recordings.par_iter().map(Recording::acceleration).collect(),
        );
        let mut two = two?;
        let (left_out, stick_slip) = LeftOut::of(&recordings, &segments, two.candidate.offset);
        if !options.paper && stick_slip.is_some() {
            // The mean of a force that swings is no sliding force.
            let smooth: Vec<Segments> =
                segments.iter().zip(&left_out).map(|(s, out)| out.smooth(s)).collect();
            two = two_steps::two_steps(&recordings, &smooth, options)?;
        }
        let effects = recordings.iter().map(Recording::effects).collect();
        let found =
            Self { recordings, lag, segments, accelerations, effects, left_out, stick_slip, two };
        let begun =
            if options.paper { None } else { element::begin(&found.input(options), progress) };
        Ok((found, begun))
    }

    pub(super) fn input<'a>(&'a self, options: &'a IdentifyOptions) -> Input<'a> {
        let Self { recordings, segments, accelerations, effects, left_out, two, .. } = self;
        let stick_slip = self.stick_slip.as_ref();
        Input { recordings, segments, accelerations, effects, left_out, stick_slip, two, options }
    }
}
