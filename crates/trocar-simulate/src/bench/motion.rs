//! Speed references: trapezoids, the velocity step, and hand-like motion.

use super::Course;
use super::config::{
    BenchConfig, HoldAndTurn, Rest, Roll, SpeedCycles, SpeedOrder, Surgeon, VelocityStep,
};
use super::noise::{Noise, Source};

/// Number of sinusoids in the tremor: enough for its amplitude to vary as in a hand.
const TREMOR_LINES: usize = 8;
/// Time over which the tremor fades in, s: a recording starts from rest.
const TREMOR_FADE: f64 = 0.5;

/// One piece of a speed reference.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Piece {
    /// Speed changes linearly; constant speed and rest are the cases of equal ends.
    Ramp { from: f64, to: f64 },
    /// Minimum-jerk sub-movement over `distance`: the position follows 10 s³ − 15 s⁴ + 6 s⁵.
    MinimumJerk { distance: f64 },
}

/// Tremor as a sum of sinusoids in its band: (angular frequency, speed amplitude, phase).
#[derive(Debug, Clone)]
struct Tremor([(f64, f64, f64); TREMOR_LINES]);

impl Tremor {
    fn new(surgeon: &Surgeon, noise: &mut Noise) -> Self {
        let amplitude = surgeon.tremor_rms_m * libm::sqrt(2.0 / TREMOR_LINES as f64);
        Self(core::array::from_fn(|_| {
            let rate = core::f64::consts::TAU
                * noise.uniform(surgeon.tremor_low_hz, surgeon.tremor_high_hz);
            let phase = noise.uniform(0.0, core::f64::consts::TAU);
            (rate, amplitude * rate, phase)
        }))
    }

    fn velocity(&self, time: f64) -> f64 {
        let fade = (time / TREMOR_FADE).min(1.0);
        let lines = self.0.iter();
        fade * lines
            .map(|(rate, amplitude, phase)| amplitude * libm::cos(rate * time + phase))
            .sum::<f64>()
    }
}

/// Reference speed as a function of time. Queried in the order of time.
#[derive(Debug, Clone)]
pub(super) struct Reference {
    /// Pieces with their start times.
    pieces: Vec<(f64, f64, Piece)>,
    duration: f64,
    tremor: Option<Tremor>,
    current: usize,
}

impl Reference {
    fn empty() -> Self {
        Self { pieces: Vec::new(), duration: 0.0, tremor: None, current: 0 }
    }

    fn push(&mut self, duration: f64, piece: Piece) {
        if duration > 0.0 {
            self.pieces.push((self.duration, duration, piece));
            self.duration += duration;
        }
    }

    fn hold(&mut self, duration: f64) {
        self.push(duration, Piece::Ramp { from: 0.0, to: 0.0 });
    }

    /// From rest to rest over `length` (m, positive) in the direction of `velocity`.
    fn stroke(&mut self, velocity: f64, length: f64, acceleration: f64) {
        let ramp = velocity.abs() / acceleration;
        let constant = length / velocity.abs() - ramp;
        self.push(ramp, Piece::Ramp { from: 0.0, to: velocity });
        self.push(constant, Piece::Ramp { from: velocity, to: velocity });
        self.push(ramp, Piece::Ramp { from: velocity, to: 0.0 });
    }

    /// Cycles at one speed each.
    pub(super) fn speed_cycles(cycles: &SpeedCycles, seed: u64) -> Self {
        let mut noise = Noise::new(seed, Source::TurningPoint);
        let mut reference = Self::empty();
        // Displacement of the last reversal in the direction of insertion.
        let mut begin = 0.0;
        for speed in speeds_of_cycles(cycles, seed) {
            for direction in [1.0, -1.0] {
                let end = cycles.turning_scatter_m * noise.uniform(-1.0, 1.0);
                let length = cycles.stroke_m + direction * (end - begin);
                reference.stroke(direction * speed, length, cycles.acceleration_m_s2);
                reference.hold(cycles.dwell_s);
                begin = end;
            }
        }
        reference
    }

    /// A given motion, at rest at both ends: between two samples the speed changes linearly.
    pub(super) fn through(time: &[f64], position: &[f64]) -> Self {
        let last = time.len() - 1;
        let mut reference = Self::empty();
        let mut from = 0.0;
        for i in 1..=last {
            let to = match i == last {
                true => 0.0,
                false => (position[i + 1] - position[i - 1]) / (time[i + 1] - time[i - 1]),
            };
            reference.push(time[i] - time[i - 1], Piece::Ramp { from, to });
            from = to;
        }
        reference
    }

    /// One speed on insertion, another on withdrawal.
    pub(super) fn step(step: &VelocityStep) -> Self {
        let mut reference = Self::empty();
        for velocity in [step.insertion_speed_m_s, -step.withdrawal_speed_m_s] {
            reference.stroke(velocity, step.stroke_m, step.acceleration_m_s2);
        }
        reference
    }

    /// Withdrawal to the start position, then rest.
    pub(super) fn homing(config: &BenchConfig) -> Self {
        let rig = &config.rig;
        let mut reference = Self::empty();
        if rig.homing_m > 0.0 {
            // At most half of the distance is spent on ramps, so the constant part exists for any
            // length.
            let acceleration = rig.homing_speed_m_s * rig.homing_speed_m_s / (0.5 * rig.homing_m);
            reference.stroke(-rig.homing_speed_m_s, rig.homing_m, acceleration);
        }
        reference.hold(rig.homing_hold_s);
        reference
    }

    /// Sub-movements, holds and small reversals in random order, with tremor.
    pub(super) fn surgeon(surgeon: &Surgeon, seed: u64) -> Self {
        let mut noise = Noise::new(seed, Source::Movement);
        let mut reference = Self::empty();
        let mut place = 0.0;
        let mut direction = 1.0;
        while reference.duration < surgeon.duration_s {
            let choice = noise.unit();
            if choice < surgeon.hold_probability {
                reference.hold(noise.uniform(surgeon.hold_shortest_s, surgeon.hold_longest_s));
                continue;
            }
            let distance;
            if choice < surgeon.hold_probability + surgeon.reversal_probability {
                distance = noise.uniform(surgeon.reversal_shortest_m, surgeon.reversal_longest_m);
                direction = -direction;
            } else {
                distance = noise.log_uniform(surgeon.shortest_m, surgeon.longest_m);
                direction = noise.sign();
            }
            if !(0.0..=surgeon.range_m).contains(&(place + direction * distance)) {
                direction = -direction;
            }
            let mean_speed = noise.uniform(surgeon.slowest_m_s, surgeon.fastest_m_s);
            let duration = (distance / mean_speed).max(surgeon.quickest_s);
            place += direction * distance;
            reference.push(duration, Piece::MinimumJerk { distance: direction * distance });
        }
        reference.duration = surgeon.duration_s;
        reference.tremor = Some(Tremor::new(surgeon, &mut Noise::new(seed, Source::Tremor)));
        reference
    }

    /// Strokes, each followed by a rest.
    pub(super) fn rest(rest: &Rest) -> Self {
        let mut reference = Self::empty();
        for length in rest.lengths().repeat(rest.cycles as usize) {
            for direction in [1.0, -1.0] {
                let velocity = direction * rest.speed_m_s;
                reference.stroke(velocity, rest.stroke_m, rest.acceleration_m_s2);
                reference.hold(length);
            }
        }
        // The way on after the last rest.
        reference.stroke(rest.speed_m_s, rest.stroke_m, rest.acceleration_m_s2);
        reference
    }

    /// Strokes at one speed while turning at several, then reversals by turning alone.
    pub(super) fn roll(roll: &Roll) -> (Self, Course) {
        let (mut reference, mut angles) = (Self::empty(), Angles::begin());
        for rate in roll.rates() {
            for direction in [1.0, -1.0] {
                let velocity = direction * roll.speed_m_s;
                reference.stroke(velocity, roll.stroke_m, roll.acceleration_m_s2);
            }
            angles.turn_until(reference.duration, rate);
        }
        for reversal in 0..roll.reversals {
            reference.hold(roll.reversal_rad / roll.reversal_rad_s);
            let direction = if reversal % 2 == 0 { 1.0 } else { -1.0 };
            angles.turn_until(reference.duration, direction * roll.reversal_rad_s);
        }
        (reference, angles.0)
    }

    /// Strokes, each followed by a hold and a turn to and fro.
    pub(super) fn hold_and_turn(turn: &HoldAndTurn) -> (Self, Course) {
        let (mut reference, mut angles) = (Self::empty(), Angles::begin());
        for direction in [1.0, -1.0].repeat(turn.cycles as usize) {
            let velocity = direction * turn.speed_m_s;
            reference.stroke(velocity, turn.stroke_m, turn.acceleration_m_s2);
            for rate in [direction, -direction].map(|sign| sign * turn.turn_rad_s) {
                reference.hold(turn.hold_s);
                angles.turn_until(reference.duration, 0.0);
                reference.hold(turn.turn_rad / turn.turn_rad_s);
                angles.turn_until(reference.duration, rate);
            }
        }
        (reference, angles.0)
    }

    /// Length of the reference in s.
    pub(super) fn duration(&self) -> f64 {
        self.duration
    }

    /// Reference speed at `time`, in m/s. `time` must not be before the last query.
    pub(super) fn velocity(&mut self, time: f64) -> f64 {
        while self.current < self.pieces.len() {
            let (begin, duration, piece) = self.pieces[self.current];
            if time < begin + duration {
                let s = (time - begin) / duration;
                let movement = match piece {
                    Piece::Ramp { from, to } => from + (to - from) * s,
                    Piece::MinimumJerk { distance } => {
                        30.0 * distance / duration * s * s * (1.0 - s) * (1.0 - s)
                    }
                };
                return movement + self.tremor.as_ref().map_or(0.0, |t| t.velocity(time));
            }
            self.current += 1;
        }
        0.0
    }
}

/// The course of the angle beside a reference; it has no positions.
struct Angles(Course);

impl Angles {
    fn begin() -> Self {
        Self(Course { time: vec![0.0], position: Vec::new(), angle: Some(vec![0.0]) })
    }

    /// Turns at `rate`, rad/s, from the last time to `time`, s.
    fn turn_until(&mut self, time: f64, rate: f64) {
        let Course { time: times, angle: Some(angles), .. } = &mut self.0 else { return };
        if let (Some(from), Some(angle)) = (times.last(), angles.last()) {
            angles.push(angle + rate * (time - from));
            times.push(time);
        }
    }
}

/// The speed of every cycle, m/s.
fn speeds_of_cycles(cycles: &SpeedCycles, seed: u64) -> Vec<f64> {
    let each = cycles.speeds().into_iter();
    let mut speeds: Vec<f64> =
        each.flat_map(|speed| (0..cycles.cycles_per_speed).map(move |_| speed)).collect();
    match cycles.order {
        SpeedOrder::Ascending => {}
        SpeedOrder::Shuffled => Noise::new(seed, Source::SpeedOrder).shuffle(&mut speeds),
        SpeedOrder::UpAndDown => {
            let down: Vec<f64> = speeds.iter().rev().copied().collect();
            speeds.extend(down);
        }
    }
    speeds
}
