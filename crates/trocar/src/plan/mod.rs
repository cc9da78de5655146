//! What motion to record, so that `identify` learns most from it.
//!
//! ```text
//! rig, prior ─▶ blocks: what a cycle at one speed, length, ... tells (information)     blocks.rs
//!            ─▶ how many of each within the time allowed, best on average over seals    choose.rs
//!            ─▶ one motion in random order, smooth at its turns                         course.rs
//!            ─▶ the intervals to expect from the whole of it                            here
//! ```
//! The information is that of the likelihood of [`identify`](crate::identify), with the scatter and
//! the drift of the friction between strokes; it is averaged over seals, so that the motion is not
//! made for one of them. A part of the time is kept for what the likelihood presupposes: a third
//! speed, repeated strokes, partial reversals and rests.

mod blocks;
mod choose;
pub mod config;
mod course;
mod goal;

use rayon::prelude::*;
use serde::Serialize;
use trocar_model::{Element, ElementParams, ParamError, ParameterId, Quantity, Trocar, Unit};

use crate::bench::{Course, PlausibleSeals, random_seal};
use crate::identify::{Expected, Rows};
use crate::recording::{Recording, RecordingError};

pub use blocks::{Block, Interruption};
pub use config::{ConfigError, PlanConfig};
pub use goal::{Goal, UnknownGoal};

use choose::{Known, choose};

/// Why there is no plan.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlanError {
    /// A value of the configuration out of its range.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The seal cannot be planned for.
    #[error("no motion can be planned for this seal: {0}")]
    Seal(#[from] ParamError),
    /// The time does not suffice for the strokes that an identification presupposes.
    #[error(
        "duration_s = {found} s is too short: the least that an identification needs (three speeds, repeated strokes{with}) takes \
         {least} s with this rig and seal\n\nhint: allow more time, or raise slowest_m_s or acceleration_m_s2"
    )]
    TooShort {
        /// Time allowed, s.
        found: f64,
        /// Least time, s.
        least: f64,
        /// What else is needed for the goal.
        with: &'static str,
    },
    /// The travel is less than the seal needs to slide.
    #[error(
        "the rig's travel of {travel_m} m is too short: a seal that deforms by {half_width_m} m to either side slides only after {least_m} m of travel"
    )]
    TooNarrow {
        /// Travel of the rig, m.
        travel_m: f64,
        /// Half width of the widest seal, m.
        half_width_m: f64,
        /// Least travel, m.
        least_m: f64,
    },
    /// The goal is no parameter of the model.
    #[error("{0} is no parameter that the model has: {1}")]
    NotThere(String, String),
    /// A motion that is no recording.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// Information that cannot be inverted in numbers.
    #[error("the information about the parameters cannot be computed for this seal")]
    Singular,
}

/// What to expect of one parameter.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Prediction {
    /// Which parameter; in JSON its name with its unit.
    #[serde(rename = "name", serialize_with = "by_name")]
    pub id: ParameterId,
    /// Its value, SI; the median over the seals of the prior.
    pub value: f64,
    /// Standard deviation of its estimate, SI; the median.
    pub standard_deviation: f64,
    /// Half width of its 95 % interval, SI; the median, and that of the worst seal.
    pub half_width: f64,
    /// The same for the seal for which it is largest.
    pub largest_half_width: f64,
    /// The half width relative to the value: the median; none where the value is 0.
    pub relative_half_width: Option<f64>,
    /// Whether it is determined: the interval is within a factor of 10, or narrower than the scale of the
    /// parameter (F_c, c or the value), and the encoder resolves it.
    pub determined: bool,
}

fn by_name<S: serde::Serializer>(id: &ParameterId, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(id)
}

/// How often a block is repeated, and its share.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Share {
    /// What is done.
    pub block: Block,
    /// How often.
    pub count: usize,
    /// Time of all repetitions, s.
    pub duration_s: f64,
    /// Part of the information about the goal that is lost without them, 0 to 1.
    pub information: f64,
}

/// A motion with what it will tell.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// The motion at the sample rate.
    pub course: Course,
    /// The blocks in their order.
    pub order: Vec<Block>,
    /// The same by kind.
    pub shares: Vec<Share>,
    /// What to expect after it.
    pub expected: Vec<Prediction>,
    /// What to expect of the paper's protocol (EMS IV-A) on this rig, with its duration, s; none where the
    /// rig cannot make it.
    pub paper: Option<(f64, Vec<Prediction>)>,
    /// Time after which the goal is expected to be reached, s, if intervals shrink with the root of the
    /// time, beside what was recorded before; none without a wanted precision.
    pub needed_s: Option<f64>,
}

/// Plans a motion for `goal`.
///
/// `seals` are those for which it is planned (those of the prior where there are none), `before` is
/// what has been recorded already.
///
/// # Errors
/// [`PlanError`]: values out of range, or time or travel that do not suffice.
pub fn plan(
    config: &PlanConfig,
    goal: &Goal,
    seals: &[ElementParams],
    before: &[Recording],
) -> Result<Plan, PlanError> {
    config.check()?;
    let drawn = if seals.is_empty() { from_prior(config) } else { seals.to_vec() };
    let blocks = blocks::candidates(config, goal, &drawn)?;
    let known = drawn
        .iter()
        .map(|seal| Known::new(config, goal, seal, &blocks, before))
        .collect::<Result<Vec<Known>, PlanError>>()?;
    let mut time = config.duration_s - 2.0 * course::AT_REST;
    let (chosen, (order, course)) = loop {
        let chosen = choose(config, goal, &blocks, &known, time)?;
        match course::ordered(config, &chosen.blocks) {
            Some(ordered) => break (chosen, ordered),
            None => time *= 0.98,
        }
    };
    let expected = predicted(config, &drawn, &course, before)?;
    let paper = match course::of_the_paper(config) {
        Some(paper) => {
            let duration = paper.time.last().copied().unwrap_or(0.0);
            Some((duration, predicted(config, &drawn, &paper, before)?))
        }
        None => None,
    };
    let needed_s = goal.wanted().and_then(|(id, wanted)| {
        let found = expected.iter().find(|p| p.id == id)?;
        let duration = course.time.last()?;
        let before: f64 = before.iter().map(Recording::duration).sum();
        Some((before + duration) * (found.relative_half_width? / wanted).powi(2) - before)
    });
    Ok(Plan { course, order, shares: chosen.shares, expected, paper, needed_s })
}

/// What to expect of `motion` together with recordings made `before`, for a seal, or for several:
/// medians over them.
///
/// # Errors
/// A motion that is no recording, or a seal for which nothing can be expected.
pub fn predicted(
    config: &PlanConfig,
    seals: &[ElementParams],
    motion: &Course,
    before: &[Recording],
) -> Result<Vec<Prediction>, PlanError> {
    let all = seals
        .par_iter()
        .map(|seal| {
            let recording = noiseless(seal, motion)?;
            let motions: Vec<&Recording> = before.iter().chain([&recording]).collect();
            let rows = Rows::new(&motions, seal, &config.noise)?.ok_or(PlanError::Singular)?;
            rows.expected(&config.noise).ok_or(PlanError::Singular)
        })
        .collect::<Result<Vec<Vec<Expected>>, PlanError>>()?;
    let Some(first) = all.first() else { return Ok(Vec::new()) };
    Ok((0..first.len()).map(|k| over_seals(config, &all, k)).collect())
}

fn over_seals(config: &PlanConfig, all: &[Vec<Expected>], k: usize) -> Prediction {
    let median = |of: &dyn Fn(&Expected) -> f64| {
        let mut values: Vec<f64> = all.iter().map(|expected| of(&expected[k])).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let largest = all.iter().map(|expected| expected[k].half_width).fold(0.0, f64::max);
    let one = &all[0][k];
    let relative = all
        .iter()
        .all(|expected| expected[k].value != 0.0)
        .then(|| median(&|e| e.half_width / e.value.abs()));
    // A join may lie anywhere within c, an offset anywhere within the friction.
    let scale = |expected: &Expected| {
        let of = |quantity: Quantity| {
            let own = all.iter().flatten().filter(|e| e.id == quantity.id());
            own.map(|e| e.value).fold(0.0, f64::max)
        };
        let scale = match expected.id.unit() {
            _ if expected.on_log => 0.0,
            Unit::NEWTON => of(Quantity::CoulombForce),
            Unit::METRE => of(Quantity::HalfWidth),
            _ => 0.0,
        };
        scale.max(expected.value.abs()).max(f64::MIN_POSITIVE)
    };
    let is_length = one.id.unit() == Unit::METRE && one.value != 0.0;
    let is_resolved = !is_length || median(&|e| e.value.abs()) > 2.0 * config.rig.encoder_step_m;
    Prediction {
        id: one.id,
        value: median(&|e| e.value),
        standard_deviation: median(&|e| e.deviation),
        half_width: median(&|e| e.half_width),
        largest_half_width: largest,
        relative_half_width: relative,
        determined: is_resolved
            && median(&|e| e.half_width / scale(e)) < if one.on_log { 10f64.ln() } else { 1.0 },
    }
}

/// The motion with the force of a seal, without noise: what the information is taken from.
pub(crate) fn noiseless(seal: &ElementParams, motion: &Course) -> Result<Recording, PlanError> {
    let trocar = Trocar::of_seal(Element::new(*seal)?);
    let mut state = trocar.rest(motion.position[0]);
    let mut last = motion.time[0];
    let force = motion.time.iter().zip(&motion.position).map(|(time, position)| {
        let duration = time - last;
        last = *time;
        trocar.step_to(&mut state, *position, duration)
    });
    let force: Vec<f64> = force.collect();
    let (time, position) = (motion.time.clone(), motion.position.clone());
    Ok(Recording::from_columns("plan", time, position, force)?)
}

fn from_prior(config: &PlanConfig) -> Vec<ElementParams> {
    let [coulomb_force, viscous_damping, half_width] = config.prior.ranges();
    let ranges =
        PlausibleSeals { coulomb_force, viscous_damping, half_width, ..PlausibleSeals::default() };
    (0..u64::from(config.draws)).map(|k| random_seal(&ranges, config.seed + k)).collect()
}
