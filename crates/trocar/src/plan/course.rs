//! One motion from blocks: their order, their turning points, smooth turns.

use std::f64::consts::{PI, TAU};

use rand::{RngExt, SeedableRng, seq::SliceRandom};
use rand_chacha::ChaCha8Rng;

use super::blocks::Block;
use super::config::{PlanConfig, Rig};
use crate::bench::Course;

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
    fn position(&self, rig: &Rig, time: f64) -> f64 {
        let (length, moving) = (self.to_m - self.from_m, self.moving(rig));
        if time >= moving {
            return self.to_m;
        }
        let (speed, ramp) = self.speed(rig);
        let begun = |t: f64| {
            if t >= ramp {
                return speed * (t - 0.5 * ramp);
            }
            let phase = TAU * t / ramp;
            speed * (t * t / (2.0 * ramp) - ramp * (1.0 - phase.cos()) / (4.0 * PI * PI))
        };
        let way =
            if time > moving - ramp { length.abs() - begun(moving - time) } else { begun(time) };
        self.from_m + way.copysign(length)
    }
}

/// Orders that are drawn, of which the one is taken whose speeds follow the time least.
const ORDERS: usize = 200;
/// Slow changes that the speeds should not follow: cosines over the duration.
const COSINES: usize = 3;

/// The blocks in random order with their motion, such that a drift of the friction looks least like
/// viscous friction; `None` where no order takes at most the time allowed, for a stroke also leads
/// from one block to the next.
pub(super) fn ordered(config: &PlanConfig, blocks: &[Block]) -> Option<(Vec<Block>, Course)> {
    let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
    let rig = &config.rig;
    let drawn = (0..ORDERS).map(|_| {
        let mut order = blocks.to_vec();
        order.shuffle(&mut rng);
        let moves = moves(rig, &order, &mut rng);
        let duration: f64 = moves.iter().map(|step| step.duration(rig)).sum();
        (follows_time(rig, &order), duration + 2.0 * AT_REST, order, moves)
    });
    let in_time = drawn.filter(|(_, duration, ..)| *duration <= config.duration_s);
    let (.., order, moves) = in_time.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let course = sampled(rig, &moves);
    Some((order, course))
}

/// Sum of the squared correlations of the speed with slow changes.
fn follows_time(rig: &Rig, order: &[Block]) -> f64 {
    let durations: Vec<f64> = order.iter().map(|block| block.duration(rig)).collect();
    let whole: f64 = durations.iter().sum();
    let speed = |k: usize| order[k].speed_m_s;
    let mean = (0..order.len()).map(speed).sum::<f64>() / order.len() as f64;
    let correlation = |cosine: usize| {
        let mut time = 0.0;
        let (mut product, mut squares) = (0.0, [0.0, 0.0]);
        for (k, duration) in durations.iter().enumerate() {
            let slow = (PI * cosine as f64 * (time + 0.5 * duration) / whole).cos();
            time += duration;
            product += slow * (speed(k) - mean);
            squares[0] += slow * slow;
            squares[1] += (speed(k) - mean).powi(2);
        }
        product * product / (squares[0] * squares[1]).max(f64::MIN_POSITIVE)
    };
    (1..=COSINES).map(correlation).sum()
}

/// Part of its length by which a cycle may be moved at random, so that strokes do not all turn at
/// the same places.
const SCATTER: f64 = 0.1;

/// The moves of blocks one after the other.
fn moves(rig: &Rig, order: &[Block], rng: &mut ChaCha8Rng) -> Vec<Move> {
    let mut at = rig.lowest_m + 0.02 * rig.travel_m();
    let mut moves = Vec::new();
    for block in order {
        let room = rig.travel_m() - block.length_m;
        let most = (0.5 * room).min(SCATTER * block.length_m);
        let start = rig.lowest_m + 0.5 * room + most * (2.0 * rng.random::<f64>() - 1.0);
        let of_block = block.moves(at, start);
        at = of_block.last().map_or(at, |last| last.to_m);
        moves.extend(of_block);
    }
    moves
}

/// Time, s, at rest before the first and after the last move.
pub(super) const AT_REST: f64 = 0.1;

/// A motion of `moves` at the rate of the rig.
pub(super) fn sampled(rig: &Rig, moves: &[Move]) -> Course {
    let interval = 1.0 / rig.sample_rate_hz;
    let mut course = Course::default();
    let mut add = |time: f64, position: f64| {
        course.time.push(time);
        course.position.push(position.clamp(rig.lowest_m, rig.highest_m));
    };
    let mut sample = 0u64;
    let mut begin = AT_REST;
    for step in moves {
        let end = begin + step.duration(rig);
        while (sample as f64) * interval < end {
            let time = sample as f64 * interval;
            add(time, step.position(rig, (time - begin).max(0.0)));
            sample += 1;
        }
        begin = end;
    }
    while (sample as f64) * interval <= begin + AT_REST {
        let last = moves.last().map_or(rig.lowest_m, |step| step.to_m);
        add(sample as f64 * interval, last);
        sample += 1;
    }
    course
}

/// The protocol of EMS IV-A, 18 speeds from 15 to 100 mm/s in ascending order over 120 mm, on this
/// rig; `None` where the rig cannot make it.
pub(super) fn of_the_paper(config: &PlanConfig) -> Option<Course> {
    const STROKE: f64 = 0.120;
    let rig = &config.rig;
    // Travel that is written in decimals.
    let fits =
        rig.travel_m() >= STROKE - 1e-9 && rig.fastest_m_s >= 0.1 && rig.slowest_m_s <= 0.015;
    fits.then(|| {
        let (low, high) = (rig.lowest_m, rig.lowest_m + STROKE);
        let cycle = |k: u32| {
            let speed_m_s = 0.015 + 0.005 * f64::from(k);
            [(low, high), (high, low)].map(|(from_m, to_m)| Move {
                from_m,
                to_m,
                speed_m_s,
                rest_s: 0.0,
            })
        };
        sampled(rig, &(0..18).flat_map(cycle).collect::<Vec<_>>())
    })
}
