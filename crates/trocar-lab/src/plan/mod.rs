//! What motion to record, so that `identify` learns most from it.
//!
//! ```text
//! rig, prior ─▶ blocks: what a cycle at one speed, length, ... tells (information)     blocks.rs
//!            ─▶ how many of each within the time allowed, best on average over seals    choose.rs
//!            ─▶ one motion in random order, smooth at its turns                         course.rs
//!            ─▶ the intervals to expect from the whole of it                            here
//! ```
//! The information is that of the likelihood of [`identify`](trocar_identify), with the scatter and
//! the drift of the friction between strokes; it is averaged over seals, so that the motion is not
//! made for one of them. A part of the time is kept for what the likelihood presupposes: a third
//! speed, repeated strokes, partial reversals and rests.

mod blocks;
mod choose;
pub mod config;
mod course;
mod goal;
mod moves;
mod summary;
mod turning;

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;
use serde::Serialize;
use trocar_model::{ElementParams, ParamError, ParameterId, Quantity, Stages, Unit};

use trocar_identify::{Expected, Motion, Progress, Rows};
use trocar_recording::cancel;
use trocar_recording::{Recording, RecordingError};
use trocar_simulate::bench::{Course, alike};
use trocar_simulate::many::evenly;

pub use blocks::{Block, Interruption};
pub use config::{ConfigError, PlanConfig, State};
pub use course::Segment;
pub use goal::Goal;
pub use summary::Summary;

use choose::Search;

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
        "duration_s = {found} s is too short: the least that an identification needs (three speeds, repeated \
         strokes{with}) takes {least} s with this rig and seal\n\nhint: allow more time, or raise slowest_m_s or \
         acceleration_m_s2"
    )]
    TooShort {
        /// Time allowed, s.
        found: f64,
        /// Least time that suffices, s.
        least: f64,
        /// What else is needed for the goal.
        with: &'static str,
    },
    /// The travel is less than the seal needs to slide.
    #[error(
        "the rig's travel of {:.1} mm is too short: a seal that deforms by {:.1} mm to either side needs at least \
         {:.1} mm\n\nhint: widen rig.lowest_m to rig.highest_m, or lower prior.half_width_m if the seals are narrower",
        1e3 * travel_m,
        1e3 * half_width_m,
        1e3 * least_m
    )]
    TooNarrow {
        /// Travel of the rig, m.
        travel_m: f64,
        /// Half width of the widest seal, m.
        half_width_m: f64,
        /// Least travel, m.
        least_m: f64,
    },
    /// A seal of more than one element.
    #[error(
        "a model of {0} elements; a motion is planned for one element\n\nhint: identify the pilot with ‹without=second_stage›"
    )]
    SeveralElements(usize),
    /// The goal is no parameter of the model.
    #[error("{0} is no parameter that the model has: {1}")]
    NotThere(String, String),
    /// A motion that is no recording.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// Information that cannot be inverted in numbers.
    #[error(
        "the information about the parameters is no finite number for a seal: its values or those of rig and noise are \
         too far apart\n\nhint: check the units of rig, noise and seal (m, m/s, N)"
    )]
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
    /// Whether it is determined: the interval is within a factor of 10 (1.5 for rotation), or narrower than the scale of the
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
    /// The same without one of them.
    pub information_of_one: f64,
}

/// A motion with what it will tell.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// The motion at the sample rate.
    pub course: Course,
    /// The blocks in their order.
    pub segments: Vec<Segment>,
    /// The same by kind.
    pub shares: Vec<Share>,
    /// What to expect after it: along the axis from the motion before the instrument turns, around the shaft
    /// from the forces while it does, of a seal as stiff and rough around it as along it.
    pub expected: Vec<Prediction>,
    /// What to expect of the paper's protocol (EMS IV-A) on this rig, with its duration, s; none where the
    /// rig cannot make it.
    pub paper: Option<(f64, Vec<Prediction>)>,
    /// Time of the recordings that were there already, s.
    pub before_s: f64,
    /// Time after which the goal is expected to be reached, s; none without a wanted precision.
    pub needed_s: Option<f64>,
    /// When the instrument begins to turn, s; none on a rig that does not turn it.
    pub turning_from_s: Option<f64>,
}

impl Plan {
    /// Time of the motion, s.
    pub fn duration_s(&self) -> f64 {
        self.course.time.last().copied().unwrap_or(0.0)
    }

    /// Time of a motion like this one, s, after which the half width of a parameter is expected to be
    /// `wanted` times its value; negative where the recordings before it suffice. Half widths shrink
    /// with the root of the time, of those recordings and of the motion together without turning, which
    /// takes as long in any motion: none for a parameter of rotation.
    pub fn time_for(&self, prediction: &Prediction, wanted: f64) -> Option<f64> {
        if prediction.is_around() {
            return None;
        }
        let still = self.turning_from_s.unwrap_or(self.duration_s());
        let whole = self.before_s + still;
        let needed = whole * (prediction.relative_half_width? / wanted).powi(2) - self.before_s;
        Some(if needed > 0.0 { needed + self.duration_s() - still } else { needed })
    }
}

impl PlanConfig {
    /// The elements of the seals `draws`, as many of them as the configuration says.
    ///
    /// # Errors
    /// A seal of more than one element.
    pub fn seals_of(&self, draws: &[Stages]) -> Result<Vec<ElementParams>, PlanError> {
        evenly(draws, self.draws as usize)
            .iter()
            .map(|seal| match seal.elements() {
                [one] => Ok(*one.params()),
                several => Err(PlanError::SeveralElements(several.len())),
            })
            .collect()
    }
}

/// Plans a motion for `goal`.
///
/// `seals` are those for which it is planned (those of the prior where there are none), `before` is
/// what has been recorded already. `progress` is told the stage and the part that is done, 0 to 1.
///
/// # Errors
/// [`PlanError`]: values out of range, or time or travel that do not suffice.
pub fn plan(
    config: &PlanConfig,
    goal: &Goal,
    seals: &[ElementParams],
    before: &[Recording],
    progress: Progress,
) -> Result<Plan, PlanError> {
    config.check()?;
    if !seals.is_empty() && config.prior.state != State::Dry {
        let why = "prior.state is that of the seals of the prior, and a model is given\n\nhint: leave out prior.state; identify a \
                   wetted seal for its model";
        return Err(ConfigError::Unfit(why.to_owned()).into());
    }
    let drawn = if seals.is_empty() { config.expected_seals()? } else { seals.to_vec() };
    // What turns comes last, with the time that it takes from the highest position.
    let widest = drawn.iter().map(|seal| seal.deformation.half_width()).fold(0.0, f64::max);
    let reserved = turning::course(&config.rig, config.rig.highest_m, widest)
        .and_then(|course| course.time.last().copied());
    let reserved = reserved.unwrap_or(0.0);
    let whole = config;
    let config = &PlanConfig { duration_s: whole.duration_s - reserved, ..whole.clone() };
    let blocks = blocks::candidates(config, goal, &drawn)?;
    progress("what cycles tell", 0.0);
    let before: Vec<Motion> = before.par_iter().map(Motion::of).collect();
    let search = Search::new(config, goal, &drawn, &blocks, &before)?;
    let mut counts = search.best(config.duration_s - 2.0 * course::AT_REST, progress)?;
    let (segments, course) = loop {
        match course::ordered(config, &search.repeated(&counts)) {
            Ok(ordered) => break ordered,
            Err(least) => {
                let fewer = search.with_one_less(&counts)?;
                counts = fewer.ok_or_else(|| too_short(whole, goal, least + reserved))?;
            }
        }
    };
    let shares = search.shares(&counts)?;
    let paper = course::of_the_paper(config);
    let motions: Vec<&Course> = std::iter::once(&course).chain(&paper).collect();
    let end = course.position.last().copied().unwrap_or(config.rig.lowest_m);
    let turning = turning::course(&config.rig, end, widest);
    let mut expected =
        predictions(config, &drawn, &motions, (&before, turning.as_ref()), progress)?.into_iter();
    let mut plan = Plan {
        segments,
        shares,
        expected: expected.next().unwrap_or_default(),
        paper: paper.as_ref().and_then(|c| Some((*c.time.last()?, expected.next()?))),
        before_s: before.iter().map(Motion::duration).sum(),
        needed_s: None,
        turning_from_s: None,
        course,
    };
    if let Some(turning) = turning {
        plan.turning_from_s = Some(plan.duration_s());
        plan.course = turning::appended(&plan.course, turning);
    }
    plan.needed_s = goal
        .wanted()
        .and_then(|(id, wanted)| plan.time_for(plan.expected.iter().find(|p| p.id == id)?, wanted));
    Ok(plan)
}

fn too_short(config: &PlanConfig, goal: &Goal, least: f64) -> PlanError {
    PlanError::TooShort {
        found: config.duration_s,
        least: (1e3 * least).ceil() / 1e3,
        with: if goal.needs_free_motion() { ", partial reversals, a rest" } else { "" },
    }
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
    let before: Vec<Motion> = before.iter().map(Motion::of).collect();
    let all = predictions(config, seals, &[motion], (&before, None), &|_, _| {})?;
    Ok(all.into_iter().next().unwrap_or_default())
}

/// The same for each of `courses`; after the first the instrument turns as in `turning`.
fn predictions(
    config: &PlanConfig,
    seals: &[ElementParams],
    courses: &[&Course],
    (before, turning): (&[Motion], Option<&Course>),
    progress: Progress,
) -> Result<Vec<Vec<Prediction>>, PlanError> {
    progress("expected intervals", 0.5);
    let turning = turning.map(turning::recording).transpose()?;
    let motions: Vec<Motion> = courses
        .par_iter()
        .map(|course| Motion::planned(&course.time, &course.position))
        .collect::<Result<_, _>>()?;
    let done = AtomicUsize::new(0);
    let predictions = motions.iter().enumerate().map(|(k, motion)| {
        let turning = turning.as_ref().filter(|_| k == 0);
        let motions: Vec<&Motion> = before.iter().chain([motion]).collect();
        let all = seals.par_iter().map(|seal| {
            cancel::check();
            let rows = Rows::new(&motions, seal, &config.noise)?.ok_or(PlanError::Singular)?;
            let known = rows.covariance_expected(&config.noise).ok_or(PlanError::Singular)?;
            let mut expected = rows.expected(&known);
            if let Some(turning) = turning {
                let rotation = alike(0.5 * config.rig.shaft_diameter_m, [seal]);
                let around = rows.expected_around(&config.noise, &known, rotation, turning.clone());
                expected.extend(around.into_iter().flatten());
            }
            let done = 1 + done.fetch_add(1, Ordering::Relaxed);
            let part = done as f64 / (courses.len() * seals.len()) as f64;
            progress("expected intervals", 0.5 + 0.5 * part);
            Ok(expected)
        });
        let all: Vec<Vec<Expected>> = all.collect::<Result<_, PlanError>>()?;
        // Posterior draws may have different optional terms.
        let mut ids: Vec<ParameterId> = Vec::new();
        for expected in all.iter().flatten() {
            if !ids.contains(&expected.id) {
                ids.push(expected.id);
            }
        }
        Ok(ids.into_iter().map(|id| over_seals(config, &all, id)).collect())
    });
    predictions.collect()
}

/// What to expect of the parameter `id`, over the seals that have it.
fn over_seals(config: &PlanConfig, all: &[Vec<Expected>], id: ParameterId) -> Prediction {
    let own: Vec<&Expected> = all.iter().flatten().filter(|e| e.id == id).collect();
    let median = |of: &dyn Fn(&Expected) -> f64| {
        let mut values: Vec<f64> = own.iter().map(|expected| of(expected)).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let largest = own.iter().map(|expected| expected.half_width).fold(0.0, f64::max);
    let one = own[0];
    let relative = own
        .iter()
        .all(|expected| expected.value != 0.0)
        .then(|| median(&|e| e.half_width / e.value.abs()));
    let is_length = one.id.unit() == Unit::METRE && one.value != 0.0;
    let is_resolved = !is_length || median(&|e| e.value.abs()) > 2.0 * config.rig.encoder_step_m;
    Prediction {
        id: one.id,
        value: median(&|e| e.value),
        standard_deviation: median(&|e| e.deviation),
        half_width: median(&|e| e.half_width),
        largest_half_width: largest,
        relative_half_width: relative,
        determined: is_resolved && median(&|e| e.half_width / scale(e, all)) < one.widest,
    }
}

/// What the half-width of an interval is compared with: a join may lie anywhere within c, an offset
/// anywhere within the friction.
fn scale(expected: &Expected, all: &[Vec<Expected>]) -> f64 {
    let quantity = match expected.id.unit() {
        _ if expected.on_log => None,
        Unit::NEWTON => Some(Quantity::CoulombForce),
        Unit::METRE => Some(Quantity::HalfWidth),
        _ => None,
    };
    let own = all.iter().flatten().filter(|e| quantity.is_some_and(|q| e.id == q.id()));
    let scale = own.map(|e| e.value).fold(0.0, f64::max);
    scale.max(expected.value.abs()).max(f64::MIN_POSITIVE)
}
