//! Motion of any kind: minor loops, holds, tremor, slow sliding. All numbers of the element at once against the whole
//! force, with the ingredients that the recordings ask for.
//!
//! The paper's two steps need full strokes at constant speed. What a hand does tells more: how the force decays when the
//! instrument rests, what a partial reversal costs, how friction rises near rest. Each *ingredient* beyond (or within) the
//! paper's element is kept only if readings that the fit has not seen are predicted better with it:
//!
//! ```text
//! all ingredients -> free-run fit -> without each in turn -> held-out error -> those that earn their keep -> fit, intervals
//! ```
//!
//! The held-out error is that of every fourth cluster of cycles, predicted from the others to first order about the fit
//! (four times, so that each is held out once).

use serde::Serialize;
use trocar_model::{RelaxationArm, SlidingFriction};

use super::candidate::{Candidate, EmsTrial, Layout};
use super::classical::plain_training;
use super::conclude::branch_quantities;
use super::output_error::{self, Fitted, Stop};
use super::spread::{Reported, Spread};
use super::stage::SecondStage;
use super::training::Training;
use super::{Identification, IdentifyOptions, Parameter, Progress, Segments, Warning, acceleration};
use crate::recording::Recording;
use crate::segment::Pass;

/// Parts in which clusters are held out.
const FOLDS: usize = 4;
/// An ingredient is kept if the squares held out grow without it by this part at least...
const LEAST_GAIN: f64 = 0.01;
/// ...and by this many standard errors of the growth over clusters (one-sided, 5 %).
const LEAST_SURETY: f64 = 1.645;

/// Held-out squares over fitted ones beyond which the first order is not believed, and the fold is fitted in full.
const FAR_OFF: f64 = 2.0;

/// The first fit, and those that start next to it.
const FIRST: Stop = Stop { iterations: 40, fall: 1e-4 };
const SHORT: Stop = Stop { iterations: 4, fall: 1e-2 };
const NEXT: Stop = Stop { iterations: 12, fall: 1e-3 };
const LAST: Stop = Stop { iterations: 40, fall: 1e-5 };

/// Where the slow numbers start: creep velocity, m/s, stiffness of an arm as a part of F_c/c, relaxation times, s.
const FIRST_CREEP: f64 = 2e-4;
const FIRST_ARM: f64 = 0.1;
const FIRST_TIMES: [f64; 2] = [0.2, 3.0];
/// Half widths of the second stage, as parts of the first's, and its part of the sliding force.
const FIRST_WIDTHS: [f64; 2] = [0.3, 0.6];
const FIRST_PART: f64 = 0.3;
/// F_s over F_c and v_s, m/s, to start from; seal damping, N·s/m.
const FIRST_RISE: f64 = 1.08;
const FIRST_STRIBECK_VELOCITY: f64 = 0.01;
const FIRST_DAMPING: f64 = 1.0;
/// Lag of the Stribeck curve, s.
const FIRST_LAG: f64 = 0.01;

/// What an element may have besides constant and viscous friction and its branches.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Ingredient {
    /// Friction that rises towards rest, EMS (11).
    Stribeck,
    /// Damping of the deformation, EMS (9).
    SealDamping,
    /// Stiffness of partial reversals, other than the least one that follows both branches.
    MinorLoops,
    /// Slip below the static force.
    Creep,
    /// Relaxation of the rubber.
    Relaxation,
    /// A second relaxation time.
    SecondRelaxation,
    /// Sliding forces of their own for insertion and withdrawal.
    Asymmetry,
    /// A second element in parallel: a seal of its own, or the part of a lip that slides while the rest still holds.
    SecondStage,
}

impl Ingredient {
    /// All, in the order of the tables.
    pub const ALL: [Self; 8] = [
        Self::Stribeck,
        Self::SealDamping,
        Self::MinorLoops,
        Self::Creep,
        Self::Relaxation,
        Self::SecondRelaxation,
        Self::Asymmetry,
        Self::SecondStage,
    ];

    /// Those that are only tried on top of the others.
    const LARGER: [Self; 3] = [Self::SecondRelaxation, Self::Asymmetry, Self::SecondStage];

    /// Name on the command line and in `summary.json`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stribeck => "stribeck",
            Self::SealDamping => "seal_damping",
            Self::MinorLoops => "minor_loops",
            Self::Creep => "creep",
            Self::Relaxation => "relaxation",
            Self::SecondRelaxation => "second_relaxation",
            Self::Asymmetry => "asymmetry",
            Self::SecondStage => "second_stage",
        }
    }

    /// Words for tables.
    pub fn words(self) -> &'static str {
        match self {
            Self::Stribeck => "Stribeck friction",
            Self::SealDamping => "seal damping",
            Self::MinorLoops => "minor-loop stiffness",
            Self::Creep => "creep of the contact",
            Self::Relaxation => "relaxation",
            Self::SecondRelaxation => "second relaxation time",
            Self::Asymmetry => "asymmetric sliding",
            Self::SecondStage => "second stage",
        }
    }

    fn is_in(self, layout: &Layout) -> bool {
        match self {
            Self::Stribeck => layout.stribeck,
            Self::SealDamping => layout.damping,
            Self::MinorLoops => layout.yielding,
            Self::Creep => layout.creep,
            Self::Relaxation => layout.arms > 0,
            Self::SecondRelaxation => layout.arms > 1,
            Self::Asymmetry => !layout.symmetric,
            Self::SecondStage => layout.second,
        }
    }

    /// Trials with the ingredient to start from.
    fn starts(self, from: &EmsTrial) -> Vec<EmsTrial> {
        let EmsTrial { mut candidate, mut layout } = from.clone();
        match self {
            Self::Stribeck => {
                layout.stribeck = true;
                for sliding in [&mut candidate.insertion, &mut candidate.withdrawal] {
                    sliding.static_force = sliding.static_force.max(FIRST_RISE * sliding.coulomb_force);
                    sliding.stribeck_velocity = FIRST_STRIBECK_VELOCITY;
                    sliding.stribeck_exponent = 2.0;
                }
            }
            Self::SealDamping => {
                layout.damping = true;
                candidate.seal_damping = candidate.seal_damping.max(FIRST_DAMPING);
            }
            Self::MinorLoops => {
                layout.yielding = true;
                candidate.yield_ratio = candidate.yield_ratio.max(1.1 * Candidate::DEFAULT_YIELD_RATIO);
            }
            Self::Creep => {
                layout.creep = true;
                candidate.creep_velocity = FIRST_CREEP;
                layout.lag = layout.stribeck;
                candidate.friction_lag = if layout.lag { FIRST_LAG } else { 0.0 };
            }
            Self::Relaxation | Self::SecondRelaxation => {
                let stiffness = FIRST_ARM * candidate.insertion.coulomb_force / candidate.half_width;
                candidate.relaxation.arms[layout.arms] = RelaxationArm { stiffness, time: FIRST_TIMES[layout.arms] };
                layout.arms += 1;
            }
            Self::Asymmetry => layout.symmetric = false,
            Self::SecondStage => {
                layout.second = true;
                let divided = FIRST_WIDTHS.iter().filter_map(|width| candidate.divided(*width, FIRST_PART));
                return divided.map(|candidate| EmsTrial { candidate, layout }).collect();
            }
        }
        vec![EmsTrial { candidate, layout }]
    }

    /// Whether the ingredient can be tried on top.
    fn can_join(self, layout: &Layout) -> bool {
        !self.is_in(layout) && (self != Self::SecondRelaxation || layout.arms == 1)
    }

    /// The trial without the ingredient; `None` for stages that make no single element.
    fn remove(self, from: &EmsTrial) -> Option<EmsTrial> {
        let EmsTrial { mut candidate, mut layout } = from.clone();
        match self {
            Self::Stribeck => {
                (layout.stribeck, layout.lag) = (false, false);
                candidate.friction_lag = 0.0;
            }
            Self::SealDamping => {
                layout.damping = false;
                candidate.seal_damping = 0.0;
            }
            Self::MinorLoops => {
                layout.yielding = false;
                candidate.yield_ratio = Candidate::DEFAULT_YIELD_RATIO;
            }
            Self::Creep => {
                (layout.creep, layout.lag) = (false, false);
                (candidate.creep_velocity, candidate.friction_lag) = (0.0, 0.0);
            }
            Self::Relaxation | Self::SecondRelaxation => {
                let kept = usize::from(self == Self::SecondRelaxation);
                layout.arms = kept;
                candidate.relaxation.arms[kept..].fill(RelaxationArm::NONE);
            }
            Self::Asymmetry => {
                layout.symmetric = true;
                candidate.insertion.coulomb_force =
                    0.5 * (candidate.insertion.coulomb_force + candidate.withdrawal.coulomb_force);
            }
            Self::SecondStage => {
                layout.second = false;
                candidate = candidate.joined()?;
            }
        }
        // Numbers that hang on others, such as F_s = F_c without Stribeck friction, follow.
        let values: Vec<f64> = layout.free(&candidate).iter().map(|free| free.value).collect();
        Some(EmsTrial { candidate: layout.with(&candidate, &values), layout })
    }
}

/// An ingredient on trial.
#[derive(Debug, Clone, Serialize)]
pub struct IngredientTrial {
    /// Which.
    pub ingredient: Ingredient,
    /// Whether the model has it.
    pub kept: bool,
    /// Root mean square error, N, on held-out cycles with it...
    pub held_out_with_n: f64,
    /// ...and without it: all that the table has above it, for those tried on top of the others, else all others.
    pub held_out_without_n: f64,
    /// Growth of the held-out squares without it, in standard errors over the cycles.
    pub surety: f64,
    /// Numbers it adds.
    pub parameters: usize,
}

/// How the fit to all motion came out.
#[derive(Debug, Clone, Serialize)]
pub struct MotionFit {
    /// Each ingredient.
    pub ingredients: Vec<IngredientTrial>,
    /// Root mean square error, N, on held-out cycles with all ingredients.
    pub held_out_all_n: f64,
    /// The same of the model chosen.
    pub held_out_chosen_n: f64,
    /// The same of the paper's element alone, fitted to the same readings.
    pub held_out_paper_n: f64,
    /// Root mean square error, N, of the model chosen over the readings it was fitted to.
    pub fitted_rms_n: f64,
    /// Damped steps of the last fit.
    pub iterations: usize,
    /// Whether it came to rest.
    pub converged: bool,
}

/// A fit with its held-out squares by cluster.
struct Scored {
    fitted: Fitted<EmsTrial>,
    held_out: Vec<f64>,
}

impl Scored {
    fn new(training: &Training, from: &EmsTrial, stop: Stop) -> Option<Self> {
        let fitted = output_error::fit(training, from, stop)?;
        let mut held_out = vec![0.0; training.clusters()];
        let own = output_error::costs(training, &fitted.best)?;
        for fold in 0..FOLDS {
            let out = |g: &usize| g % FOLDS == fold;
            let sum = |costs: &[f64]| (0..costs.len()).filter(out).map(|g| costs[g]).sum::<f64>();
            let first_order = fitted.without(&fitted.best, |g| out(&g));
            let mut costs = first_order.and_then(|part| output_error::costs(training, &part));
            if costs.as_ref().is_none_or(|costs| !(sum(costs) < FAR_OFF * sum(&own))) {
                let part = output_error::fit(&training.without(|g| out(&g)), &fitted.best, NEXT)?;
                costs = output_error::costs(training, &part.best);
            }
            let costs = costs?;
            (0..held_out.len()).filter(out).for_each(|g| held_out[g] = costs[g]);
        }
        Some(Self { fitted, held_out })
    }

    fn total(&self) -> f64 {
        self.held_out.iter().sum()
    }

    fn rms(&self) -> f64 {
        (self.total() / self.fitted.weight()).sqrt()
    }

    /// Growth of the held-out squares from `other` to this, as a part of the other's, and in its standard errors.
    fn growth(&self, other: &Self) -> (f64, f64) {
        let differences: Vec<f64> = self.held_out.iter().zip(&other.held_out).map(|(a, b)| a - b).collect();
        let sum: f64 = differences.iter().sum();
        let n = differences.len() as f64;
        let variance = differences.iter().map(|d| (d - sum / n).powi(2)).sum::<f64>() * n / (n - 1.0).max(1.0);
        (sum / other.total(), sum / variance.sqrt().max(f64::MIN_POSITIVE))
    }
}

/// What the fit to all motion gives.
pub(super) struct Chosen {
    pub(super) fitted: Fitted<EmsTrial>,
    pub(super) summary: MotionFit,
}

/// Fits the element with all ingredients, drops those that do not earn their keep, and fits what is left.
///
/// `starts` are elements of the paper; the best of them after a short fit is taken. `None` when no start gives a model
/// that runs.
pub(super) fn choose(training: &Training, starts: &[EmsTrial], excluded: &[Ingredient]) -> Option<Chosen> {
    let allowed = |i: &Ingredient| !excluded.contains(i);
    let paper = Scored::new(training, &best_of(training, starts)?, NEXT)?;
    let base = Ingredient::ALL.into_iter().filter(|i| allowed(i) && !Ingredient::LARGER.contains(i));
    let start = base.fold(paper.fitted.best.clone(), |trial, i| i.starts(&trial).pop().unwrap_or(trial));
    let mut all = Scored::new(training, &start, FIRST)?;
    let mut ingredients = Vec::new();
    for more in Ingredient::LARGER.into_iter().filter(allowed) {
        if !more.can_join(&all.fitted.best.layout) {
            continue;
        }
        let larger = best_of(training, &more.starts(&all.fitted.best)).and_then(|t| Scored::new(training, &t, NEXT));
        let Some(larger) = larger else { continue };
        let growth = all.growth(&larger);
        let kept = earns_its_keep(growth);
        ingredients.push(IngredientTrial {
            ingredient: more,
            kept,
            held_out_with_n: larger.rms(),
            held_out_without_n: all.rms(),
            surety: growth.1,
            parameters: larger.fitted.best.free_numbers() - all.fitted.best.free_numbers(),
        });
        if kept {
            all = larger;
        }
    }
    let mut chosen = all.fitted.best.clone();
    let present = |i: &Ingredient| i.is_in(&all.fitted.best.layout) && !Ingredient::LARGER.contains(i);
    for ingredient in Ingredient::ALL.into_iter().filter(present) {
        let smaller = Scored::new(training, &ingredient.remove(&all.fitted.best)?, NEXT)?;
        let growth = smaller.growth(&all);
        let kept = earns_its_keep(growth);
        if !kept && ingredient.is_in(&chosen.layout) {
            chosen = ingredient.remove(&chosen)?;
        }
        ingredients.push(IngredientTrial {
            ingredient,
            kept,
            held_out_with_n: all.rms(),
            held_out_without_n: smaller.rms(),
            surety: growth.1,
            parameters: all.fitted.best.free_numbers() - smaller.fitted.best.free_numbers(),
        });
    }
    let last = Scored::new(training, &chosen, LAST)?;
    let summary = MotionFit {
        ingredients,
        held_out_all_n: all.rms(),
        held_out_chosen_n: last.rms(),
        held_out_paper_n: paper.rms(),
        fitted_rms_n: last.fitted.rms[1],
        iterations: last.fitted.iterations,
        converged: last.fitted.converged,
    };
    Some(Chosen { fitted: last.fitted, summary })
}

/// The start that a short fit carries farthest.
fn best_of(training: &Training, starts: &[EmsTrial]) -> Option<EmsTrial> {
    if let [only] = starts {
        return Some(only.clone());
    }
    let short = starts.iter().filter_map(|start| output_error::fit(training, start, SHORT));
    short.min_by(|a, b| a.rms[1].total_cmp(&b.rms[1])).map(|fitted| fitted.best)
}

fn earns_its_keep((growth, surety): (f64, f64)) -> bool {
    growth > LEAST_GAIN && surety > LEAST_SURETY
}

/// The identification with its element fitted to all motion, if that predicts better.
///
/// `found` is what the two steps and their refinement gave; it stays where no fit comes to a model, or where held-out
/// readings are predicted no better.
pub(super) fn extend(
    mut found: Identification,
    recordings: &[Recording],
    segments: &[Segments],
    options: &IdentifyOptions,
    progress: Progress,
) -> Identification {
    let motion = FreeMotion::of(recordings, segments, found.model.half_width);
    found.free_motion = Some(motion);
    if !(options.free_motion && motion.is_enough()) {
        return found;
    }
    progress("fitting all motion", 0.5);
    let hidden_mass = found.model.hidden_mass > 0.0;
    let inertia = |r: &Recording| if hidden_mass { acceleration(r) } else { vec![0.0; r.len()] };
    let training = plain_training(recordings, &found, options, found.model.half_width, inertia);
    let layout = Layout {
        symmetric: found.model.insertion == found.model.withdrawal,
        viscous: true,
        stribeck: found.steady.stribeck.is_some(),
        damping: found.model.seal_damping > 0.0,
        hidden_mass,
        yielding: false,
        creep: false,
        lag: false,
        arms: 0,
        second: false,
    };
    let start = EmsTrial { candidate: found.model.clone(), layout };
    let Some(Chosen { fitted, summary }) = choose(&training, &[start], &options.without) else { return found };
    let Ok(stages) = fitted.best.candidate.stages() else { return found };
    let steady_lines =
        found.parameters.iter().filter(|p| p.name.ends_with("_positive") || p.name.ends_with("_negative"));
    let mut parameters = parameters(&fitted);
    let known: Vec<Parameter> =
        steady_lines.filter(|p| !parameters.iter().any(|q| q.name == p.name)).cloned().collect();
    parameters.extend(known);
    found.warnings.retain(|w| w.subject != "yield_stiffness_n_m" && w.subject != "refinement");
    found.warnings.extend(warnings(&fitted, &parameters, &summary));
    found.free_parameters = fitted.best.free_numbers() - 1 - usize::from(hidden_mass);
    found.residual_rms = super::conclude::residual_rms(recordings, &fitted.best.candidate, &stages);
    found.model = fitted.best.candidate;
    found.stages = stages;
    found.parameters = parameters;
    found.motion = Some(summary);
    found
}

fn warnings(fitted: &Fitted<EmsTrial>, parameters: &[Parameter], summary: &MotionFit) -> Vec<Warning> {
    let main: Vec<Parameter> = parameters.iter().filter(|p| !p.name.contains("theta")).cloned().collect();
    let mut all = super::classical::doubts(fitted, &main);
    for left_out in summary.ingredients.iter().filter(|i| !i.kept) {
        let message = format!(
            "left out: held-out cycles are predicted no better with it ({:.4} N with it, {:.4} N without)",
            left_out.held_out_with_n, left_out.held_out_without_n
        );
        all.push(Warning { subject: left_out.ingredient.words().to_owned(), message, doubtful: false });
    }
    all
}

/// Holds and partial reversals in the recordings: what the fit to all motion lives on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FreeMotion {
    /// Passes that end before the seal has turned over: shorter than 2c.
    pub partial_reversals: usize,
    /// Time at rest or trembling, s: a tenth of a second or more within a tenth of c.
    pub held_s: f64,
}

/// Fewest partial reversals, and shortest rest, s, that ask for the fit to all motion.
const FEWEST_PARTIAL: usize = 8;
const SHORTEST_REST: f64 = 1.0;

impl FreeMotion {
    pub(super) fn of(recordings: &[Recording], segments: &[Segments], half_width: f64) -> Self {
        let mut all = Self { partial_reversals: 0, held_s: 0.0 };
        for (recording, segments) in recordings.iter().zip(segments) {
            let x = &recording.position;
            let partial = |p: &&Pass| (x[p.end - 1] - x[p.start]).abs() < 2.0 * half_width;
            let inner = segments.passes.len().saturating_sub(2);
            all.partial_reversals += segments.passes.iter().skip(1).take(inner).filter(partial).count();
            all.held_s += held(recording, 0.1 * half_width);
        }
        all
    }

    /// Whether there is enough to learn minor loops, creep and relaxation from.
    pub fn is_enough(&self) -> bool {
        self.partial_reversals >= FEWEST_PARTIAL && self.held_s >= SHORTEST_REST
    }
}

/// Time, s, that `recording` spends in rests: a tenth of a second or more within `reach`, m.
fn held(recording: &Recording, reach: f64) -> f64 {
    const SHORTEST: f64 = 0.1;
    let (x, t) = (&recording.position, &recording.time);
    let mut total = 0.0;
    for range in recording.unbroken() {
        let mut from = range.start;
        while from + 1 < range.end {
            let until = (from + 1..range.end).find(|i| (x[*i] - x[from]).abs() > reach).unwrap_or(range.end) - 1;
            let rest = t[until] - t[from];
            total += if rest >= SHORTEST { rest } else { 0.0 };
            from = if rest >= SHORTEST { until + 1 } else { from + 1 };
        }
    }
    total
}

/// Name, unit, least sensible value, whether on the logarithm, and how it follows from a candidate.
type Quantity = (&'static str, &'static str, f64, bool, fn(&Candidate) -> f64);

/// A number of the sliding force of all stages, in the mean of both directions.
fn whole(candidate: &Candidate, of: fn(&SlidingFriction) -> f64) -> f64 {
    0.5 * candidate.stage_factor() * (of(&candidate.insertion) + of(&candidate.withdrawal))
}

fn second(candidate: &Candidate, of: fn(&SecondStage) -> f64) -> f64 {
    candidate.second.as_ref().map_or(f64::NAN, of)
}

fn quantities(layout: Layout) -> Vec<Quantity> {
    const ANY: f64 = f64::NEG_INFINITY;
    let mut all: Vec<Quantity> = vec![
        ("offset_n", "N", ANY, false, |c| c.offset),
        ("coulomb_force_n", "N", 0.0, true, |c| whole(c, |s| s.coulomb_force)),
        ("viscous_damping_n_s_m", "N s/m", 0.0, false, |c| whole(c, |s| s.viscous_damping)),
        ("half_width_m", "m", 0.0, true, |c| c.half_width),
    ];
    if !layout.symmetric {
        all.push(("coulomb_force_n_positive", "N", 0.0, true, |c| c.stage_factor() * c.insertion.coulomb_force));
        all.push(("coulomb_force_n_negative", "N", 0.0, true, |c| c.stage_factor() * c.withdrawal.coulomb_force));
        all.push(("viscous_damping_n_s_m_positive", "N s/m", 0.0, false, |c| c.stage_factor() * c.insertion.viscous_damping));
        all.push(("viscous_damping_n_s_m_negative", "N s/m", 0.0, false, |c| c.stage_factor() * c.withdrawal.viscous_damping));
    }
    if layout.stribeck {
        all.push(("static_force_n", "N", 0.0, true, |c| whole(c, |s| s.static_force)));
        all.push(("stribeck_velocity_m_s", "m/s", 0.0, true, |c| c.insertion.stribeck_velocity));
    }
    if layout.damping {
        all.push(("seal_damping_n_s_m", "N s/m", 0.0, false, |c| c.stage_factor() * c.seal_damping));
    }
    if layout.hidden_mass {
        all.push(("hidden_mass_kg", "kg", ANY, false, |c| c.hidden_mass));
    }
    if layout.yielding {
        all.push(("yield_stiffness_n_m", "N/m", 0.0, true, |c| {
            c.params().map_or(f64::NAN, |p| p.deformation.yield_stiffness())
        }));
    }
    if layout.creep {
        all.push(("creep_velocity_m_s", "m/s", 0.0, true, |c| c.creep_velocity));
    }
    if layout.lag {
        all.push(("friction_lag_s", "s", 0.0, true, |c| c.friction_lag));
    }
    let arms: [[Quantity; 2]; 2] = [
        [
            ("relaxation_stiffness_n_m", "N/m", 0.0, true, |c| c.relaxation.arms[0].stiffness),
            ("relaxation_time_s", "s", 0.0, true, |c| c.relaxation.arms[0].time),
        ],
        [
            ("second_relaxation_stiffness_n_m", "N/m", 0.0, true, |c| c.relaxation.arms[1].stiffness),
            ("second_relaxation_time_s", "s", 0.0, true, |c| c.relaxation.arms[1].time),
        ],
    ];
    all.extend(arms.into_iter().take(layout.arms).flatten());
    if layout.second {
        all.push(("second_coulomb_force_n", "N", 0.0, true, |c| {
            whole(c, |s| s.coulomb_force) * second(c, |s| s.share) / c.stage_factor()
        }));
        all.push(("second_half_width_m", "m", 0.0, true, |c| second(c, |s| s.half_width)));
    }
    all
}

/// Main parameters of the fit with intervals: jackknife over clusters, to first order ([`Spread`]).
pub(super) fn parameters(fitted: &Fitted<EmsTrial>) -> Vec<Parameter> {
    let EmsTrial { candidate: best, layout } = &fitted.best;
    let spread = Spread::new(fitted);
    let scale = |unit| match unit {
        "N" => best.insertion.coulomb_force,
        "m" => best.half_width,
        _ => best.insertion.viscous_damping.max(1.0),
    };
    let parameter = |(name, unit, least, log, of): Quantity| {
        let how = Reported { unit, log, scale: scale(unit), least };
        Parameter { name: name.to_owned(), estimate: spread.estimate(how, &|t| of(&t.candidate)) }
    };
    let mut all: Vec<Parameter> = quantities(*layout).into_iter().map(parameter).collect();
    for quantity in branch_quantities(best) {
        let how = Reported { unit: quantity.unit, log: false, scale: f64::INFINITY, least: f64::NEG_INFINITY };
        let estimate = spread.estimate(how, &|t| (quantity.of)(&t.candidate));
        all.push(Parameter { name: quantity.name, estimate });
    }
    all
}
