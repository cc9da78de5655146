//! Optional terms of the model: what each is, and which of them the data ask for.
//!
//! # Test
//! Each term enters as one or more columns x of the normal equations (a secant of the simulated force for shapes such as v_s or a
//! relaxation time that have no meaning without the term). All other numbers eliminated, its amplitude
//!
//! ```text
//! δ = one step of the joint equations      t = δ/s(δ)      s: jackknife over clusters, Student's t with effective degrees
//! ```
//! has a p value without any fit. Of the terms with p < [`LEVEL`] over the number of columns tried (BONFERRONI; the columns of one
//! term are much alike, and each behind the first counts as half) the one that takes most of the squared error away is fitted, and the
//! others are tested again beside it. So of recordings without any term at most one in a hundred gets one. Where no clear one is left, a
//! term with p < [`SUSPECTED`] that promises much ([`LARGE_GAIN`]) is fitted and judged by the F test of what the fit gains.

use rayon::prelude::*;
use serde::Serialize;
use trocar_model::RelaxationArm;

use super::candidate::{Candidate, EmsTrial, Layout};
use super::element::variance;
use super::estimate::{f_p_value, t_p_value};
use super::likelihood::{self, Extra, Fitted, Normal, Stop};
use super::numbers;
use super::training::Training;

/// Error rate of the choice over all columns of a run.
pub(super) const LEVEL: f64 = 0.01;

/// An optional term: what an element may have besides constant and viscous friction and its branches.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Term {
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
    /// Inertia of an unmodelled mass between sensor and seal: not the seal's, but in its readings.
    HiddenMass,
    /// Viscous damping by direction; sliding forces too where the sensor offset is known.
    Asymmetry,
    /// A second element in parallel: a seal of its own, or the part of a lip that slides while the rest still holds.
    SecondStage,
}

impl Term {
    /// All, in the order of the tables.
    pub const ALL: [Self; 9] = [
        Self::Stribeck,
        Self::SealDamping,
        Self::MinorLoops,
        Self::Creep,
        Self::Relaxation,
        Self::SecondRelaxation,
        Self::HiddenMass,
        Self::Asymmetry,
        Self::SecondStage,
    ];

    /// Those of which full strokes say nothing.
    pub(super) const OF_FREE_MOTION: [Self; 3] = [Self::MinorLoops, Self::SecondRelaxation, Self::SecondStage];

    /// Name on the command line and in `summary.json`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stribeck => "stribeck",
            Self::SealDamping => "seal_damping",
            Self::MinorLoops => "minor_loops",
            Self::Creep => "creep",
            Self::Relaxation => "relaxation",
            Self::SecondRelaxation => "second_relaxation",
            Self::HiddenMass => "hidden_mass",
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
            Self::HiddenMass => "unmodelled mass",
            Self::Asymmetry => "asymmetric sliding",
            Self::SecondStage => "second stage",
        }
    }

    /// The number that says how large the term is.
    pub(super) fn parameter(self) -> &'static str {
        match self {
            Self::Stribeck => "static_force_n",
            Self::SealDamping => "seal_damping_n_s_m",
            Self::MinorLoops => "yield_stiffness_n_m",
            Self::Creep => "creep_velocity_m_s",
            Self::Relaxation => "relaxation_stiffness_n_m",
            Self::SecondRelaxation => "second_relaxation_stiffness_n_m",
            Self::HiddenMass => "hidden_mass_kg",
            Self::Asymmetry => "viscous_damping_n_s_m_positive",
            Self::SecondStage => "second_coulomb_force_n",
        }
    }

    pub(super) fn is_in(self, layout: &Layout) -> bool {
        match self {
            Self::Stribeck => layout.stribeck,
            Self::SealDamping => layout.damping,
            Self::MinorLoops => layout.yielding,
            Self::Creep => layout.creep,
            Self::Relaxation => layout.arms > 0,
            Self::SecondRelaxation => layout.arms > 1,
            Self::HiddenMass => layout.hidden_mass,
            Self::Asymmetry => layout.own_slopes || layout.own_levels,
            Self::SecondStage => layout.second,
        }
    }

    /// Trials that have the term, at each shape that it is tried with; the first number says how far it is switched on.
    fn variants(self, from: &EmsTrial, speeds: [f64; 2]) -> Vec<EmsTrial> {
        let EmsTrial { candidate, mut layout, drift } = from.clone();
        let force = candidate.insertion.coulomb_force;
        let mut all = Vec::new();
        let mut add =
            |candidate: Candidate, layout: Layout| all.push(EmsTrial { candidate, layout, drift: drift.clone() });
        match self {
            Self::Stribeck => {
                layout.stribeck = true;
                let [slow, fast] = speeds;
                for v_s in [0.3 * slow, slow, (slow * fast).sqrt()] {
                    let mut candidate = candidate.clone();
                    for sliding in [&mut candidate.insertion, &mut candidate.withdrawal] {
                        sliding.static_force = 1.05 * sliding.coulomb_force;
                        sliding.stribeck_velocity = v_s.clamp(1e-3, 0.5);
                        sliding.stribeck_exponent = 2.0;
                    }
                    add(candidate, layout);
                }
            }
            Self::SealDamping => {
                layout.damping = true;
                let seal_damping = candidate.seal_damping + 0.02 * force / speeds[1];
                add(Candidate { seal_damping, ..candidate }, layout);
            }
            Self::MinorLoops => {
                layout.yielding = true;
                add(Candidate { yield_ratio: 1.5 * Candidate::DEFAULT_YIELD_RATIO, ..candidate }, layout);
            }
            Self::Creep => {
                layout.creep = true;
                layout.lag = layout.stribeck;
                let friction_lag = if layout.lag { 0.01 } else { 0.0 };
                for creep_velocity in [5e-5, 3e-4, 2e-3].into_iter().filter(|v| *v > layout.slowest_creep) {
                    add(Candidate { creep_velocity, friction_lag, ..candidate.clone() }, layout);
                }
            }
            Self::Relaxation | Self::SecondRelaxation => {
                let arm = layout.arms;
                layout.arms += 1;
                for time in [0.05, 0.3, 2.0] {
                    let mut candidate = candidate.clone();
                    let stiffness = 0.1 * force / candidate.half_width;
                    candidate.relaxation.arms[arm] = RelaxationArm { stiffness, time };
                    add(candidate, layout);
                }
            }
            Self::HiddenMass => {
                layout.hidden_mass = true;
                add(candidate, layout);
            }
            Self::Asymmetry => {
                layout.own_slopes = true;
                layout.own_levels = !layout.offset;
                let mut candidate = candidate;
                candidate.withdrawal.viscous_damping += 0.05 * force / speeds[1];
                add(candidate, layout);
            }
            Self::SecondStage => {
                layout.second = true;
                for width in [0.3, 0.6] {
                    if let Some(divided) = candidate.divided(width, 0.3) {
                        add(divided, layout);
                    }
                }
            }
        }
        all
    }

    /// Whether only one sign of the amplitude makes sense.
    fn is_one_sided(self) -> bool {
        self != Self::Asymmetry
    }

    /// Whether the term can be added.
    fn can_join(self, layout: &Layout) -> bool {
        let has_place = match self {
            Self::SecondRelaxation => layout.arms == 1,
            Self::MinorLoops | Self::SecondStage | Self::SealDamping | Self::Relaxation | Self::Creep => layout.shape,
            Self::Asymmetry => layout.viscous,
            _ => true,
        };
        has_place && !self.is_in(layout)
    }
}

/// An optional term on trial.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TermTrial {
    /// Which.
    pub term: Term,
    /// Whether the model has it.
    pub kept: bool,
    /// p value of the term beside those that were accepted before it.
    pub p_value: f64,
    /// Part of the squared error that it takes away, to first order.
    pub gain: f64,
}

/// A fit with the terms that the data ask for.
pub(super) struct Chosen {
    pub(super) fitted: Fitted<EmsTrial>,
    pub(super) trials: Vec<TermTrial>,
}

/// Stops of the fits with one term more.
const NEXT: Stop = Stop { iterations: 15, fall: 1e-4, promise: 10.0 * 1e-4 };
/// Part of the squared error from which a term that is only suspected is fitted, and judged by what the fit gains: of a shape far from
/// the one tried the step tells little.
const LARGE_GAIN: f64 = 0.05;
const SUSPECTED: f64 = 0.05;
/// Least part of the squared error that a term must take away beside being significant: less is none that a force shows.
const LEAST_GAIN: f64 = 1e-3;

/// The most promising column of a term.
struct Score {
    term: Term,
    p_value: f64,
    gain: f64,
    start: EmsTrial,
}

/// Adds terms but those `excluded` as long as the data ask for one.
///
/// `speeds` are the slowest and fastest of the sliding, m/s.
pub(super) fn choose(training: &Training, mut fitted: Fitted<EmsTrial>, excluded: &[Term], speeds: [f64; 2]) -> Chosen {
    let from_start: Vec<Term> = Term::ALL.into_iter().filter(|t| t.is_in(&fitted.best.layout)).collect();
    let mut trials: Vec<TermTrial> = Vec::new();
    for term in from_start {
        let (smaller, trial) = spared(training, fitted, term);
        fitted = smaller;
        trials.push(trial);
    }
    let mut failed: Vec<Term> = Vec::new();
    while let Some((mut scores, columns)) = scores(training, &fitted, excluded, speeds) {
        scores.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        trials.retain(|t| t.kept);
        let left_out = |s: &Score| TermTrial { term: s.term, kept: false, p_value: s.p_value, gain: s.gain };
        trials.extend(scores.iter().map(left_out));
        let level = LEVEL / columns;
        let is_clear = |s: &Score| s.p_value < level && s.gain > LEAST_GAIN;
        let is_large = |s: &Score| s.p_value < SUSPECTED && s.gain > LARGE_GAIN;
        let open = |s: &&Score| !failed.contains(&s.term);
        let Some(best) =
            scores.iter().filter(open).find(|s| is_clear(s)).or(scores.iter().filter(open).find(|s| is_large(s)))
        else {
            break;
        };
        let larger = likelihood::fit(training, &best.start, NEXT);
        // What a Stribeck curve rises to is often told by the terms that come after it.
        let is_better = |l: &Fitted<EmsTrial>| {
            let is_determined = best.term == Term::Stribeck || numbers::is_determined(l, best.term);
            let is_sure = is_clear(best) || growth_p_value(training, &fitted, l) < level;
            is_determined && is_sure && l.cost() < (1.0 - 0.3 * LEAST_GAIN) * fitted.cost()
        };
        match larger.filter(is_better) {
            Some(larger) => {
                fitted = larger;
                trials.iter_mut().filter(|t| t.term == best.term).for_each(|t| t.kept = true);
            }
            None => failed.push(best.term),
        }
    }
    Chosen { fitted, trials }
}

/// The fit without a term that it began with, where the squared error grows by no more than chance.
fn spared(training: &Training, with: Fitted<EmsTrial>, term: Term) -> (Fitted<EmsTrial>, TermTrial) {
    let mut smaller = with.best.clone();
    match term {
        Term::Stribeck => smaller.layout.stribeck = false,
        Term::Creep => (smaller.layout.creep, smaller.candidate.creep_velocity) = (false, 0.0),
        _ => (smaller.layout.own_slopes, smaller.layout.own_levels) = (false, false),
    }
    let values: Vec<f64> = smaller.layout.free(&smaller.candidate).iter().map(|f| f.value).collect();
    smaller.candidate = smaller.layout.with(&smaller.candidate, &values);
    let Some(without) = likelihood::fit(training, &smaller, NEXT) else {
        return (with, TermTrial { term, kept: true, p_value: 0.0, gain: 1.0 });
    };
    let p_value = growth_p_value(training, &without, &with);
    let gain = 1.0 - with.cost() / without.cost();
    let trial = TermTrial { term, kept: p_value < LEVEL, p_value, gain };
    if trial.kept { (with, trial) } else { (without, trial) }
}

/// p value of the growth of the squared error from the larger model to the smaller, over the strokes.
fn growth_p_value(training: &Training, smaller: &Fitted<EmsTrial>, larger: &Fitted<EmsTrial>) -> f64 {
    let added = (larger.best.free_numbers() - smaller.best.free_numbers()) as f64;
    let growth = smaller.cost() - larger.cost();
    f_p_value(growth / variance(larger) / added, added, training.strokes.len() as f64)
}

/// The best column of each term that can be added, and how many columns were tried.
fn scores(
    training: &Training,
    fitted: &Fitted<EmsTrial>,
    excluded: &[Term],
    speeds: [f64; 2],
) -> Option<(Vec<Score>, f64)> {
    let best = &fitted.best;
    let open = Term::ALL.into_iter().filter(|t| t.can_join(&best.layout) && !excluded.contains(t));
    let mut columns: Vec<(Term, EmsTrial)> = Vec::new();
    for term in open {
        let runs = |t: &EmsTrial| likelihood::Trial::model(t).is_some();
        columns.extend(term.variants(best, speeds).into_iter().filter(runs).map(|start| (term, start)));
    }
    if columns.is_empty() {
        return None;
    }
    // A delay is no term of the model, but may pass for a mass; and a mass that is not tried for friction that falls with speed.
    let mut extra: Vec<Extra<EmsTrial>> = vec![Extra::Delay, Extra::Acceleration];
    let own = fitted.held.len();
    let [delay, acceleration] = [own, own + 1];
    let place = |(term, start): &(Term, EmsTrial)| match term {
        Term::HiddenMass => acceleration,
        _ => {
            extra.push(Extra::Secant(start.clone()));
            own + extra.len() - 1
        }
    };
    let places: Vec<usize> = columns.iter().map(place).collect();
    let normal = fitted.with_columns(training, &extra)?;
    let damping = columns.iter().position(|(term, _)| *term == Term::SealDamping).map(|k| places[k]);
    let terms = columns.chunk_by(|a, b| a.0 == b.0).count();
    let count = 0.5 * (terms + columns.len()) as f64;
    let sigma2 = variance(fitted);
    let tested: Vec<Option<Score>> = columns
        .into_par_iter()
        .zip(places)
        .map(|((term, start), place)| {
            let beside: Vec<usize> = match term {
                Term::HiddenMass => [Some(delay), damping].into_iter().flatten().collect(),
                Term::Stribeck if !best.layout.hidden_mass => vec![acceleration],
                _ => Vec::new(),
            };
            score(&normal, &fitted.held, &beside, place, sigma2, (term, start))
        })
        .collect();
    let mut scores: Vec<Score> = Vec::new();
    for score in tested.into_iter().flatten() {
        match scores.iter_mut().find(|s| s.term == score.term) {
            Some(known) if known.p_value <= score.p_value => {}
            Some(known) => *known = score,
            None => scores.push(score),
        }
    }
    Some((scores, count))
}

fn score(
    normal: &Normal,
    held: &[bool],
    beside: &[usize],
    column: usize,
    sigma2: f64,
    (term, mut start): (Term, EmsTrial),
) -> Option<Score> {
    let step = normal.one_step(held, beside, column, sigma2)?;
    if !step.standard_error.is_finite() || step.standard_error <= 0.0 {
        return None;
    }
    let t = step.amplitude / step.standard_error;
    let two_sided = t_p_value(t, step.degrees);
    let p_value = match term.is_one_sided() {
        true if t > 0.0 => 0.5 * two_sided,
        true => 1.0 - 0.5 * two_sided,
        false => two_sided,
    };
    if term == Term::HiddenMass {
        start.candidate.hidden_mass = step.amplitude.max(0.0);
    }
    Some(Score { term, p_value, gain: step.gain, start })
}
