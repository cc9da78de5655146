//! Positions that were read later than the forces.
//!
//! A late position shifts the whole simulated force in time: F(t) becomes F(t + T), so ∂F/∂T = dF/dt is one more column of the normal
//! equations. It is tested beside an unmodelled mass and the damping of the deformation, for which it could be mistaken; a force that
//! comes *late* is not looked for: it may be the seal's own.

use serde::Serialize;

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

/// Recordings with their positions in time, and how late these were.
pub(super) struct InTime {
    pub(super) recordings: Vec<Recording>,
    pub(super) lag: Option<PositionLag>,
}

/// Takes the delay out of the positions: `lag_of` finds what is left of it.
pub(super) fn in_time(recordings: &[Recording], lag_of: impl Fn(&[Recording]) -> Option<PositionLag>) -> InTime {
    let mut found = InTime { recordings: recordings.to_vec(), lag: None };
    for _ in 0..PositionLag::MOST {
        let interval = recordings.iter().map(|r| r.quality.median_interval).fold(0.0, f64::max);
        let Some(more) = lag_of(&found.recordings).filter(|more| more.lag_s > 0.1 * interval) else { break };
        let lag = more.added_to(found.lag);
        let shifted = recordings.iter().map(|r| r.with_position_lag(lag.lag_s)).collect::<Result<Vec<_>, _>>();
        let Some(shifted) = shifted.ok().filter(|_| lag.lag_s < PositionLag::LONGEST) else { break };
        found = InTime { recordings: shifted, lag: Some(lag) };
    }
    found
}
