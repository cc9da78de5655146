//! Motion from one turning point to the next, with smooth turns.

use std::f64::consts::{PI, TAU};

use super::config::Rig;

/// From one position to another at a speed, then a rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Move {
    pub(super) from_m: f64,
    pub(super) to_m: f64,
    pub(super) speed_m_s: f64,
    pub(super) rest_s: f64,
}

impl Move {
    /// Speed that it reaches, m/s, and the time of a ramp, s.
    ///
    /// ```text
    /// v(t) = v·(t/T − sin(2πt/T)/2π),  a ≤ 2v/T      over a ramp: the jerk is bounded
    /// ```
    fn speed(&self, rig: &Rig) -> (f64, f64) {
        let length = (self.to_m - self.from_m).abs();
        let acceleration = rig.acceleration_m_s2;
        let speed = self.speed_m_s.min((0.5 * length * acceleration).sqrt());
        (speed, 2.0 * speed / acceleration)
    }

    pub(super) fn duration(&self, rig: &Rig) -> f64 {
        self.rest_s + self.moving(rig)
    }

    fn moving(&self, rig: &Rig) -> f64 {
        let length = (self.to_m - self.from_m).abs();
        if length == 0.0 {
            return 0.0;
        }
        let (speed, ramp) = self.speed(rig);
        length / speed + ramp
    }

    /// Position at `time` (s) after its start, m.
    pub(super) fn position(&self, rig: &Rig, time: f64) -> f64 {
        let (length, moving) = (self.to_m - self.from_m, self.moving(rig));
        if time >= moving {
            return self.to_m;
        }
        let (speed, ramp) = self.speed(rig);
        // The end is the beginning, backwards.
        let ends = time > moving - ramp;
        let t = if ends { moving - time } else { time };
        let begun = if t >= ramp {
            speed * (t - 0.5 * ramp)
        } else {
            let phase = TAU * t / ramp;
            speed * (t * t / (2.0 * ramp) - ramp * (1.0 - phase.cos()) / (4.0 * PI * PI))
        };
        let way = if ends { length.abs() - begun } else { begun };
        self.from_m + way.copysign(length)
    }
}
