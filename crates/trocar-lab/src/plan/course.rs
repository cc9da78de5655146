//! One motion from blocks: their order, their turning points.

use std::f64::consts::PI;

use rand::{RngExt, SeedableRng, seq::SliceRandom};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

use super::blocks::Block;
use super::config::{PlanConfig, Rig};
use super::moves::Move;
use trocar_simulate::bench::Course;

/// A block at its place in a motion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Segment {
    /// What is done.
    #[serde(flatten)]
    pub block: Block,
    /// When it begins, s.
    pub from_s: f64,
    /// When it ends, s.
    pub to_s: f64,
}

/// Orders that are drawn, of which the one is taken whose speeds follow the time least.
const ORDERS: usize = 200;
/// Slow changes that the speeds should not follow: cosines over the duration.
const COSINES: usize = 3;

/// The blocks in random order with their motion, such that a drift of the friction looks least like
/// viscous friction.
///
/// # Errors
/// Where no order takes at most the time allowed (a stroke also leads from one block to the next):
/// the least time of one, s.
pub(super) fn ordered(
    config: &PlanConfig,
    blocks: &[Block],
) -> Result<(Vec<Segment>, Course), f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
    let rig = &config.rig;
    let drawn: Vec<_> = (0..ORDERS)
        .map(|_| {
            let mut order = blocks.to_vec();
            order.shuffle(&mut rng);
            let segments = segments(rig, &order, &mut rng);
            let end = segments.last().map_or(0.0, |(segment, _)| segment.to_s);
            (follows_time(rig, &order), end + AT_REST, segments)
        })
        .collect();
    let shortest = drawn.iter().map(|drawn| drawn.1).fold(f64::INFINITY, f64::min);
    let in_time = drawn.into_iter().filter(|(_, duration, _)| *duration <= config.duration_s);
    let (.., segments) = in_time.min_by(|a, b| a.0.total_cmp(&b.0)).ok_or(shortest)?;
    let (segments, moves): (Vec<Segment>, Vec<Vec<Move>>) = segments.into_iter().unzip();
    Ok((segments, sampled(rig, &moves.concat())))
}

/// Sum of the squared correlations of the speed with slow changes.
fn follows_time(rig: &Rig, order: &[Block]) -> f64 {
    let durations: Vec<f64> = order.iter().map(|block| block.duration(rig)).collect();
    let whole: f64 = durations.iter().sum();
    let mean = order.iter().map(|block| block.speed_m_s).sum::<f64>() / order.len() as f64;
    (1..=COSINES)
        .map(|cosine| {
            let mut time = 0.0;
            let (mut product, mut squares) = (0.0, [0.0, 0.0]);
            for (block, duration) in order.iter().zip(&durations) {
                let faster = block.speed_m_s - mean;
                let slow = (PI * cosine as f64 * (time + 0.5 * duration) / whole).cos();
                time += duration;
                product += slow * faster;
                squares[0] += slow * slow;
                squares[1] += faster.powi(2);
            }
            product * product / (squares[0] * squares[1]).max(f64::MIN_POSITIVE)
        })
        .sum()
}

/// Part of its length by which a cycle may be moved at random, so that strokes do not all turn at
/// the same places.
const SCATTER: f64 = 0.1;

/// Blocks one after the other, with their moves.
fn segments(rig: &Rig, order: &[Block], rng: &mut ChaCha8Rng) -> Vec<(Segment, Vec<Move>)> {
    let (mut at, mut from_s) = (rig.begin_m(), AT_REST);
    let mut segments = Vec::with_capacity(order.len());
    for block in order {
        let room = rig.travel_m() - block.length_m;
        let most = (0.5 * room).min(SCATTER * block.length_m);
        let start = rig.lowest_m + 0.5 * room + most * (2.0 * rng.random::<f64>() - 1.0);
        let moves = block.moves(at, start);
        let to_s = from_s + moves.iter().map(|step| step.duration(rig)).sum::<f64>();
        at = moves.last().map_or(at, |last| last.to_m);
        segments.push((Segment { block: *block, from_s, to_s }, moves));
        from_s = to_s;
    }
    segments
}

/// Time, s, at rest before the first and after the last move.
pub(super) const AT_REST: f64 = 0.1;

/// A motion of `moves` at the rate of the rig, within its travel.
pub(super) fn sampled(rig: &Rig, moves: &[Move]) -> Course {
    let time = times(rig, moves);
    let mut position = places(rig, moves, &time);
    position.iter_mut().for_each(|place| *place = place.clamp(rig.lowest_m, rig.highest_m));
    Course { time, position, angle: None }
}

/// Times of the samples of `moves`, s, with a rest before and after them.
pub(super) fn times(rig: &Rig, moves: &[Move]) -> Vec<f64> {
    let end = moves.iter().fold(AT_REST, |at, step| at + step.duration(rig)) + AT_REST;
    let interval = 1.0 / rig.sample_rate_hz;
    (0u64..).map(|k| k as f64 * interval).take_while(|time| *time <= end).collect()
}

/// Places of `moves` at `times`, m.
pub(super) fn places(rig: &Rig, moves: &[Move], times: &[f64]) -> Vec<f64> {
    let mut place = moves.first().map_or(rig.lowest_m, |step| step.from_m);
    let mut moves = moves.iter().map(|step| (step, step.duration(rig))).peekable();
    let mut begin = AT_REST;
    let places = times.iter().map(|time| {
        while let Some((step, duration)) = moves.peek() {
            if *time < begin + duration {
                return step.position(rig, (time - begin).max(0.0));
            }
            (place, begin) = (step.to_m, begin + duration);
            moves.next();
        }
        place
    });
    places.collect()
}

/// Limits that are read from a recording are a little below those of its rig.
const ROUNDED: f64 = 0.95;

/// The protocol of EMS IV-A, 18 speeds from 15 to 100 mm/s in ascending order over 120 mm, on this
/// rig; `None` where the rig cannot make it.
pub(super) fn of_the_paper(config: &PlanConfig) -> Option<Course> {
    const STROKE: f64 = 0.120;
    let rig = &config.rig;
    let fits = rig.travel_m() >= ROUNDED * STROKE
        && rig.fastest_m_s >= ROUNDED * 0.1
        && ROUNDED * rig.slowest_m_s <= 0.015;
    fits.then(|| {
        let (low, high) = (rig.lowest_m, rig.lowest_m + STROKE.min(rig.travel_m()));
        let moves = (0..18).flat_map(|k| {
            let speed_m_s = 0.015 + 0.005 * f64::from(k);
            [(low, high), (high, low)].map(|(from_m, to_m)| Move {
                from_m,
                to_m,
                speed_m_s,
                rest_s: 0.0,
            })
        });
        sampled(rig, &moves.collect::<Vec<_>>())
    })
}
