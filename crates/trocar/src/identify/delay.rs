//! Positions that were read later than the forces.
//!
//! A late position shifts the whole simulated force in time: F(t) becomes F(t + T), so ∂F/∂T = dF/dt is one more column of the normal
//! equations. It is tested beside an unmodelled mass and the damping of the deformation, for which it could be mistaken, and so only
//! where the sampling resolves those; a force that comes *late* is not looked for: it may be the seal's own.

use serde::Serialize;

use super::element::{self, Begun, Input};
use super::two_steps::{self, TwoSteps};
use super::{IdentifyError, IdentifyOptions, Progress, Segments, segment};
use crate::recording::Recording;

/// A delay of the position readings.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PositionLag {
    /// Time, s, by which the positions were read late.
    pub lag_s: f64,
    /// Standard error, s.
    pub standard_error_s: f64,
    /// p value of no delay.
    pub p_value: f64,
}

impl PositionLag {
    /// p value below which a delay is believed, and least part of the squared error that it takes away.
    pub(super) const LEVEL: f64 = 1e-3;
    pub(super) const LEAST_GAIN: f64 = 0.01;
    /// Most corrections: each is to first order about the last.
    const MOST: usize = 4;
    /// Longest delay, s.
    const LONGEST: f64 = 0.15;

    /// What is left of `earlier` and this one together.
    fn added_to(self, earlier: Option<Self>) -> Self {
        Self { lag_s: self.lag_s + earlier.map_or(0.0, |e| e.lag_s), ..self }
    }
}

/// Recordings with their positions in time, how late these were, and what was found of them.
pub(super) struct InTime {
    pub(super) recordings: Vec<Recording>,
    pub(super) lag: Option<PositionLag>,
    pub(super) segments: Vec<Segments>,
    pub(super) two: TwoSteps,
    /// The paper's element; `None` where none was asked for or could be fitted.
    pub(super) begun: Option<Begun>,
}

impl InTime {
    /// Takes the delay out of the positions, correction by correction.
    pub(super) fn new(
        recordings: &[Recording],
        options: &IdentifyOptions,
        progress: Progress,
    ) -> Result<Self, IdentifyError> {
        let mut found = Self::of(recordings.to_vec(), None, options, progress)?;
        let interval = recordings.iter().map(|r| r.quality.median_interval).fold(0.0, f64::max);
        for _ in 0..PositionLag::MOST {
            let Some(more) = found.begun.as_ref().and_then(|begun| begun.position_lag(&found.recordings)) else {
                break;
            };
            if more.lag_s < 0.1 * interval {
                break;
            }
            let lag = more.added_to(found.lag);
            let shifted = recordings.iter().map(|r| r.with_position_lag(lag.lag_s)).collect::<Result<Vec<_>, _>>();
            let Some(shifted) = shifted.ok().filter(|_| lag.lag_s < PositionLag::LONGEST) else { break };
            found = Self::of(shifted, Some(lag), options, progress)?;
        }
        Ok(found)
    }

    fn of(
        recordings: Vec<Recording>,
        lag: Option<PositionLag>,
        options: &IdentifyOptions,
        progress: Progress,
    ) -> Result<Self, IdentifyError> {
        let segments: Vec<Segments> = recordings.iter().map(|r| segment(r, &options.segment)).collect();
        let two = two_steps::two_steps(&recordings, &segments, options)?;
        let input = Input { recordings: &recordings, segments: &segments, two: &two, options };
        let begun = if options.paper { None } else { element::begin(&input, progress) };
        Ok(Self { recordings, lag, segments, two, begun })
    }
}
