//! Optional terms of the model, and the selection of those that the data support.
//!
//! # Test
//! Each term enters as one or more columns x of the normal equations (a secant of the simulated
//! force for shapes such as v_s or a relaxation time that have no meaning without the term). With
//! all other parameters eliminated, its amplitude
//!
//! ```text
//! δ = one step of the joint equations      t = δ/s(δ)      s: jackknife over clusters, Student's t with effective degrees
//! ```
//! has a p value without any fit. Of the terms with p < [`LEVEL`] over the number of columns tried
//! (BONFERRONI; the columns of one term are much alike, and each after the first counts as half),
//! the one that removes most of the squared error is fitted, and the others are tested again
//! together with it. Thus at most one in a hundred recordings without any term gets one, but where a
//! coarse encoder hides how a mass turns: errors alike at all reversals are no chance. When no
//! significant term remains, a term with p < [`SUSPECTED`] that predicts a large improvement
//! ([`LARGE_GAIN`]) is fitted and judged by the F test of the improvement. Finally, a term is
//! removed again if the fit without it is not significantly worse (the same F test), or by less than a
//! term must remove. Most are needed so clearly that the secant to the model without the term, the
//! others following in one step, shows it for all terms in one pass. Of terms that imitate each other
//! ([`ALIKE`]) the one taken first may hold what is another's: each is tried in the place of the others.

use std::cmp::Ordering;
use std::str::FromStr;

use rayon::prelude::*;
use serde::Serialize;
use trocar_model::{Direction, ParameterId, Quantity, RelaxationArm, SlidingFriction};

use super::candidate::{Candidate, EmsTrial, GAUSSIAN, Layout};
use super::estimate::{f_p_value, t_p_value};
use super::findings::Progress;
use super::kept::Kept;
use super::likelihood::{self, Extra, Fitted, Free, Normal, Stop, Trial};
use super::load::{OfLoad, of_load};
use super::numbers;
use super::spread::variance;
use super::training::Training;
use trocar_recording::loads::Load;

/// Error rate of the selection over all columns of a run.
pub(super) const LEVEL: f64 = 0.01;

/// An optional term of an element besides constant and viscous friction and its branches.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(into = "&'static str")]
pub enum Term {
    /// Friction that rises towards rest, EMS (11).
    Stribeck,
    /// Another exponent of that rise than the paper's.
    StribeckExponent,
    /// Damping of the deformation, EMS (9).
    SealDamping,
    /// Stiffness of partial reversals, other than the least one that follows both branches.
    MinorLoops,
    /// Slip below the static force.
    Creep,
    /// Friction after rest.
    Dwell,
    /// Relaxation of the rubber.
    Relaxation,
    /// A second relaxation time.
    SecondRelaxation,
    /// A load beside the force of the seal, such as the inertia of an unmodelled mass: not part of the
    /// seal, but in its readings.
    Load(Load),
    /// Viscous damping by direction; sliding forces too where the sensor offset is known.
    Asymmetry,
    /// A second element in parallel: a separate seal, or the part of a lip that slides while the
    /// rest still sticks.
    SecondStage,
}

impl From<Term> for &'static str {
    fn from(term: Term) -> Self {
        term.name()
    }
}

/// A text that names no term.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("expected one of {}", Term::ALL.map(Term::name).join(", "))]
pub struct UnknownTerm;

impl FromStr for Term {
    type Err = UnknownTerm;

    fn from_str(name: &str) -> Result<Self, UnknownTerm> {
        Self::ALL.into_iter().find(|term| term.name() == name.trim()).ok_or(UnknownTerm)
    }
}

impl Term {
    /// All, in the order of the tables.
    pub const ALL: [Self; 14] = [
        Self::Stribeck,
        Self::StribeckExponent,
        Self::SealDamping,
        Self::MinorLoops,
        Self::Creep,
        Self::Dwell,
        Self::Relaxation,
        Self::SecondRelaxation,
        Self::Load(Load::Mass),
        Self::Load(Load::Side),
        Self::Load(Load::Weight),
        Self::Load(Load::Pressure),
        Self::Asymmetry,
        Self::SecondStage,
    ];

    /// Terms that full strokes cannot reveal.
    pub(super) const OF_FREE_MOTION: [Self; 3] =
        [Self::MinorLoops, Self::SecondRelaxation, Self::SecondStage];

    /// Its name, its words, and the parameters without which it is not determined.
    fn declared(self) -> (&'static str, &'static str, &'static [ParameterId]) {
        use Quantity as Q;
        const SLOPE: ParameterId = Q::ViscousDamping.of(Direction::Insertion);
        const ARM: [ParameterId; 2] = [Q::RelaxationStiffness.id(), Q::RelaxationTime.id()];
        const ARM_2: [ParameterId; 2] =
            [Q::SecondRelaxationStiffness.id(), Q::SecondRelaxationTime.id()];
        const STAGE_2: ParameterId = Q::CoulombForce.id().of_element(1);
        match self {
            Self::Stribeck => ("stribeck", "Stribeck friction", const { &[Q::StaticForce.id()] }),
            Self::StribeckExponent => {
                ("stribeck_exponent", "Stribeck exponent", const { &[Q::StribeckExponent.id()] })
            }
            Self::SealDamping => ("seal_damping", "seal damping", const { &[Q::SealDamping.id()] }),
            Self::MinorLoops => {
                ("minor_loops", "minor-loop stiffness", const { &[Q::YieldStiffness.id()] })
            }
            Self::Creep => ("creep", "creep of the contact", const { &[Q::CreepVelocity.id()] }),
            Self::Dwell => ("dwell", "friction after rest", const { &[Q::DwellForce.id()] }),
            Self::Relaxation => ("relaxation", "relaxation", &ARM),
            Self::SecondRelaxation => ("second_relaxation", "second relaxation time", &ARM_2),
            Self::Load(load) => {
                let OfLoad { name, words, id, .. } = of_load(load);
                (name, words, id)
            }
            Self::Asymmetry => ("asymmetry", "asymmetric sliding", const { &[SLOPE] }),
            Self::SecondStage => ("second_stage", "second stage", const { &[STAGE_2] }),
        }
    }

    /// Name on the command line and in `summary.json`.
    pub fn name(self) -> &'static str {
        self.declared().0
    }

    /// Words for tables.
    pub fn words(self) -> &'static str {
        self.declared().1
    }

    /// The parameters without which the term is not determined; the first gives its magnitude.
    pub(super) fn parameters(self) -> &'static [ParameterId] {
        self.declared().2
    }

    /// Whether the model has the term whatever the recordings say, since a parameter of it is kept.
    pub(super) fn is_kept(self, kept: &Kept) -> bool {
        let velocity = Quantity::StribeckVelocity.id();
        let more = (self == Self::Stribeck).then_some(&velocity);
        let mut own = self.parameters().iter().chain(more);
        own.any(|id| *id == id.quantity.id() && kept.range(id.quantity).is_some())
    }

    /// Whether the model cannot have the term beside what is kept.
    pub(super) fn is_ruled_out(self, kept: &Kept) -> bool {
        let is_kept = |quantity| kept.range(quantity).is_some();
        match self {
            Self::SecondStage => !kept.is_empty(),
            Self::Asymmetry => is_kept(Quantity::CoulombForce) || is_kept(Quantity::ViscousDamping),
            _ => false,
        }
    }

    pub(super) fn is_in(self, layout: &Layout) -> bool {
        match self {
            Self::Stribeck => layout.stribeck,
            Self::StribeckExponent => layout.exponent,
            Self::SealDamping => layout.damping,
            Self::MinorLoops => layout.yielding,
            Self::Creep => layout.creep,
            Self::Dwell => layout.dwell,
            Self::Relaxation => layout.arms > 0,
            Self::SecondRelaxation => layout.arms > 1,
            Self::Load(load) => layout.loads[load as usize],
            Self::Asymmetry => layout.own_slopes || layout.own_levels,
            Self::SecondStage => layout.second,
        }
    }

    /// Trials with the term, at each shape that is tried; the first number is the degree to which
    /// it is active.
    pub(super) fn variants(self, from: &EmsTrial, speeds: [f64; 2]) -> Vec<EmsTrial> {
        let EmsTrial { candidate, mut layout, drift } = from.clone();
        let force = candidate.insertion.coulomb_force;
        let mut all = Vec::new();
        let mut add = |candidate: Candidate, layout: Layout| {
            all.push(EmsTrial { candidate, layout, drift: drift.clone() })
        };
        match self {
            Self::Stribeck => {
                layout.stribeck = true;
                with_stribeck(&candidate, speeds).for_each(|candidate| add(candidate, layout));
            }
            Self::StribeckExponent => {
                layout.exponent = true;
                add(candidate.with_exponent(1.5), layout);
            }
            Self::SealDamping => {
                layout.damping = true;
                let seal_damping = candidate.seal_damping + 0.02 * force / speeds[1];
                add(Candidate { seal_damping, ..candidate }, layout);
            }
            Self::MinorLoops => {
                layout.yielding = true;
                add(
                    Candidate { yield_ratio: 1.5 * Candidate::DEFAULT_YIELD_RATIO, ..candidate },
                    layout,
                );
            }
            Self::Creep => {
                layout.creep = true;
                layout.lag = layout.stribeck && layout.shows_lag;
                let friction_lag = if layout.lag { 0.01 } else { 0.0 };
                for creep_velocity in
                    [5e-5, 3e-4, 2e-3].into_iter().filter(|v| *v > layout.slowest_creep)
                {
                    add(Candidate { creep_velocity, friction_lag, ..candidate.clone() }, layout);
                }
            }
            Self::Dwell => {
                layout.dwell = true;
                add(Candidate { dwell_force: 0.02 * force, ..candidate }, layout);
            }
            Self::Relaxation | Self::SecondRelaxation => {
                layout.arms += 1;
                with_arm(&candidate, layout.arms - 1).for_each(|more| add(more, layout));
            }
            Self::Load(load) => {
                layout.loads[load as usize] = true;
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

    /// The trial without the term; `None` for a second stage, since the first would have to carry
    /// its part of the force, and for a term next to one that needs it, which has to be removed
    /// first.
    pub(super) fn left_out_of(self, with: &EmsTrial) -> Option<EmsTrial> {
        if self.is_kept(&with.layout.kept) {
            return None;
        }
        let mut smaller = with.clone();
        let EmsTrial { layout, candidate, .. } = &mut smaller;
        match self {
            Self::Stribeck if layout.exponent => return None,
            Self::Stribeck => layout.stribeck = false,
            Self::StribeckExponent => {
                layout.exponent = false;
                *candidate = candidate.clone().with_exponent(GAUSSIAN);
            }
            Self::SealDamping => (layout.damping, candidate.seal_damping) = (false, 0.0),
            Self::MinorLoops => {
                (layout.yielding, candidate.yield_ratio) = (false, Candidate::DEFAULT_YIELD_RATIO)
            }
            Self::Creep => {
                // The lag of the Stribeck curve was added with it.
                (layout.creep, layout.lag) = (false, false);
                (candidate.creep_velocity, candidate.friction_lag) = (0.0, 0.0);
            }
            Self::Dwell => (layout.dwell, candidate.dwell_force) = (false, 0.0),
            Self::Relaxation if layout.arms > 1 => return None,
            Self::Relaxation | Self::SecondRelaxation => {
                // The fit may have left the force to the arm that was added last.
                layout.arms -= 1;
                let arms = &mut candidate.relaxation.arms;
                if arms[0].stiffness < arms[layout.arms].stiffness {
                    arms.swap(0, layout.arms);
                }
                arms[layout.arms].stiffness = 0.0;
            }
            Self::Load(load) => (layout.loads[load as usize], candidate.loads[load]) = (false, 0.0),
            Self::Asymmetry => (layout.own_slopes, layout.own_levels) = (false, false),
            Self::SecondStage => return None,
        }
        Some(smaller.clamped())
    }

    /// Least gain of the term in the model `with` it; `slowest` is the slowest sliding, m/s.
    fn least_gain(self, with: &EmsTrial, slowest: f64) -> f64 {
        let is_seen_sliding = with.candidate.insertion.stribeck_velocity >= slowest;
        match self {
            Self::Stribeck if is_seen_sliding => LEAST_GAIN,
            // Another law than the paper's must be visible.
            Self::StribeckExponent => LARGE_GAIN,
            _ if !ALIKE.contains(&self) => LEAST_GAIN,
            _ if with.layout.has_coarse_steps => LEAST_GAIN_BEHIND_STEPS,
            Self::SealDamping => LEAST_GAIN,
            _ => LEAST_GAIN_AT_YIELD,
        }
    }

    /// Whether only one sign of the amplitude makes sense.
    fn is_one_sided(self) -> bool {
        !matches!(self, Self::Asymmetry | Self::StribeckExponent | Self::Load(Load::Weight))
    }

    /// Whether the term can be added.
    fn can_join(self, layout: &Layout) -> bool {
        let has_place = match self {
            Self::SecondRelaxation => layout.arms == 1,
            Self::StribeckExponent => layout.stribeck,
            Self::MinorLoops
            | Self::SecondStage
            | Self::SealDamping
            | Self::Relaxation
            | Self::Dwell
            | Self::Creep => layout.shape,
            Self::Asymmetry => layout.viscous,
            _ => true,
        };
        has_place && !self.is_in(layout) && !self.is_ruled_out(&layout.kept)
    }
}

/// With a small rise of the friction below three speeds, from below the slowest to between it and the fastest.
fn with_stribeck(
    candidate: &Candidate,
    [slow, fast]: [f64; 2],
) -> impl Iterator<Item = Candidate> + '_ {
    [0.3 * slow, slow, (slow * fast).sqrt()].into_iter().map(move |velocity| {
        let mut candidate = candidate.clone();
        for sliding in [&mut candidate.insertion, &mut candidate.withdrawal] {
            sliding.static_force = 1.05 * sliding.coulomb_force;
            sliding.stribeck_velocity = velocity.clamp(1e-3, 0.5);
            sliding.stribeck_exponent = GAUSSIAN;
            damp(sliding, fast);
        }
        candidate
    })
}

/// Friction that falls with speed for a start, up to the speed `fast`, m/s: a fall that nothing damps ends
/// in no speed, so where β is held at zero it begins above.
pub(super) fn damp(sliding: &mut SlidingFriction, fast: f64) {
    let least = 0.01 * sliding.coulomb_force / fast;
    sliding.viscous_damping = sliding.viscous_damping.max(least);
}

/// With a soft relaxing arm of three relaxation times.
fn with_arm(candidate: &Candidate, arm: usize) -> impl Iterator<Item = Candidate> + '_ {
    let stiffness = 0.1 * candidate.insertion.coulomb_force / candidate.half_width;
    [0.05, 0.3, 2.0].into_iter().map(move |time| {
        let mut candidate = candidate.clone();
        candidate.relaxation.arms[arm] = RelaxationArm { stiffness, time };
        candidate
    })
}

/// Trial of an optional term.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TermTrial {
    /// Which.
    pub term: Term,
    /// Whether the model has it.
    pub kept: bool,
    /// p value of the term together with the others of the model.
    pub p_value: f64,
    /// Fraction of the squared error that it removes: by a fit without it where it is kept and that
    /// is not clear without one, else to first order.
    pub gain: f64,
    /// Why it was left out despite a significant p value.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub why_not: Option<&'static str>,
    /// Change of the free parameters in a fit with it, where it is significant but too small to be
    /// taken: the intervals span it.
    #[serde(skip)]
    pub shift: Vec<f64>,
}

/// A fit with the terms that the data support.
pub(super) struct Chosen {
    pub(super) fitted: Fitted<EmsTrial>,
    pub(super) trials: Vec<TermTrial>,
    /// Terms that are significant but too small to be taken, beside that fit.
    rivals: Vec<Score>,
}

/// Stopping criteria of the fits with one more term.
const NEXT: Stop = Stop { iterations: 15, fall: 1e-4, promise: 10.0 * 1e-4 };
/// The same while further terms may follow: a term that is needed shows before its fit has
/// converged, and the fit goes on with the next one.
const BEGIN: Stop = Stop { iterations: 6, fall: 3e-3, promise: 10.0 * 3e-3 };
/// Most that a fit that was begun may still fall, in units of what a step to first order promises.
const HOPE: f64 = 3.0;
/// Stopping criteria of the first step of a fit without a term, and the p value below which that
/// step shows that the term is needed, whatever further ones may still gain.
const FIRST: Stop = Stop { iterations: 2, fall: 0.0, promise: f64::INFINITY };
/// Times that these are taken before the fit goes on to its end.
const FIRSTS: usize = 2;
const CLEARLY_NEEDED: f64 = 1e-6;
/// The same for what it removes, in units of the least that it must.
const CLEAR_GAIN: f64 = 3.0;
/// Predicted decrease of the squared error above which a term that is only suspected is fitted and
/// judged by the fit. For a shape far from the one tried, the first-order step is unreliable.
const LARGE_GAIN: f64 = 0.05;
pub(super) const SUSPECTED: f64 = 0.05;
/// Least fraction of the squared error that a term must remove in addition to being significant; a
/// smaller effect is not visible in the force. Where a seal begins to slide, coarse sampling and
/// encoders look like creep and a static force. Of 90 drawn seals (`drawn_strokes` 11 to 100 of
/// `tests/trust`) those without either lost up to 0.6 % to them with finer encoders, and up to 4.1 %
/// where the steps are [`trocar_recording::COARSE`] or more; a static force that was there removed 1.4 %
/// or more, and 5.6 % or more behind such steps, creep up to 3.8 %. Relaxation imitates them and is
/// held to the same, seal damping behind such steps alone: a real lip seal needs it for less.
const LEAST_GAIN: f64 = 1e-3;
const LEAST_GAIN_AT_YIELD: f64 = 1e-2;
const LEAST_GAIN_BEHIND_STEPS: f64 = 5e-2;

/// Terms that imitate each other where a seal begins to slide, and that the inertia of an unmodelled mass
/// imitates.
const ALIKE: [Term; 4] = [Term::Creep, Term::Relaxation, Term::Stribeck, Term::SealDamping];
/// Most of them that are exchanged.
const EXCHANGES: usize = 3;

/// A term that was fitted and not kept, and why.
type Failed = (Term, &'static str);

/// Why a term with a significant p value is left out.
const NO_BETTER: &str = "the fit with it is no better";
const UNDETERMINED: &str = "the fit with it does not determine it";
const TOO_SMALL: &str =
    "too little to tell it from what sampling and encoder leave; the intervals span it";

/// The most promising column of a term.
struct Score {
    term: Term,
    p_value: f64,
    gain: f64,
    /// Least gain at which it is taken.
    least_gain: f64,
    start: EmsTrial,
}

impl Score {
    fn is_clear(&self, level: f64) -> bool {
        self.p_value < level && self.gain > self.least_gain
    }

    fn is_large(&self) -> bool {
        self.p_value < SUSPECTED && self.gain > LARGE_GAIN
    }

    /// Left out, at `level`; `known` is why a fit with it was not kept.
    fn left_out(&self, level: f64, known: Option<&'static str>) -> TermTrial {
        let Self { term, p_value, gain, .. } = *self;
        let is_rival = match known {
            None => self.is_rival(level),
            Some(why) => why == TOO_SMALL && p_value < level,
        };
        let why_not =
            if is_rival { Some(TOO_SMALL) } else { known.filter(|why| *why != TOO_SMALL) };
        TermTrial { term, kept: false, p_value, gain, why_not, shift: Vec::new() }
    }

    /// Whether it is significant, but too small for a term that sampling and encoder may imitate.
    fn is_rival(&self, level: f64) -> bool {
        self.p_value < level && self.gain > LEAST_GAIN && self.gain <= self.least_gain
    }
}

/// Parts of the work of an identification after which the terms are tried, and after which they
/// have been: between those of a few full strokes and those of recordings with every kind of motion.
pub(super) const TERMS_FROM: f64 = 0.1;
pub(super) const TERMS_TO: f64 = 0.6;

/// Adds terms except those `excluded` as long as the data support one, removes those that others make
/// unnecessary, and exchanges those that imitate others.
///
/// `speeds` are the slowest and fastest of the sliding, m/s.
pub(super) fn choose(
    training: &Training,
    fitted: Fitted<EmsTrial>,
    excluded: &[Term],
    speeds: [f64; 2],
    progress: Progress,
) -> Chosen {
    let mut chosen = grown(training, fitted, excluded, speeds, progress);
    for _ in 0..EXCHANGES {
        let Some(other) = chosen.exchanged(training, excluded, speeds) else { break };
        chosen = grown(training, other, excluded, speeds, progress);
    }
    chosen
}

/// The same without exchanges.
fn grown(
    training: &Training,
    fitted: Fitted<EmsTrial>,
    excluded: &[Term],
    speeds: [f64; 2],
    progress: Progress,
) -> Chosen {
    let mut chosen = Chosen::of(fitted);
    chosen.take_out_needless(training, speeds[0]);
    let (mut closed, mut twice) = (Vec::new(), Vec::new());
    while chosen.add_needed(training, (excluded, &closed), speeds, progress) {
        let before = chosen.fitted.cost();
        let needless = chosen.take_out_needless(training, speeds[0]);
        if needless.is_empty() {
            break;
        }
        // A fit that is better without a term had not found the least cost with it.
        let may_return = chosen.fitted.cost() < before;
        let for_good = |(term, _): &Failed| !may_return || twice.contains(term);
        closed.extend(needless.iter().copied().filter(for_good));
        twice.extend(needless.into_iter().map(|(term, _)| term));
    }
    chosen
}

impl Chosen {
    /// A fit whose terms are not tried.
    pub(super) fn untried(fitted: Fitted<EmsTrial>) -> Self {
        Self { fitted, trials: Vec::new(), rivals: Vec::new() }
    }

    /// A fit with its terms.
    fn of(fitted: Fitted<EmsTrial>) -> Self {
        let from_start = Term::ALL.into_iter().filter(|t| t.is_in(&fitted.best.layout));
        let kept = |term| TermTrial {
            term,
            kept: true,
            p_value: 0.0,
            gain: 1.0,
            why_not: None,
            shift: Vec::new(),
        };
        Self { trials: from_start.map(kept).collect(), ..Self::untried(fitted) }
    }

    /// Adds each term that the data support, but none of those `excluded` nor of those `closed`,
    /// which were found needless; whether there was one.
    fn add_needed(
        &mut self,
        training: &Training,
        (excluded, closed): (&[Term], &[Failed]),
        speeds: [f64; 2],
        progress: Progress,
    ) -> bool {
        let mut failed = closed.to_vec();
        let (mut is_rough, mut has_grown) = (false, false);
        while let Some((mut scores, columns)) = scores(training, &self.fitted, excluded, speeds) {
            scores.sort_by(|a, b| b.gain.total_cmp(&a.gain));
            self.trials.retain(|t| t.kept);
            let why_not = |term: Term| failed.iter().find(|f| f.0 == term).map(|f| f.1);
            let level = LEVEL / columns;
            let left_out = |s: &Score| s.left_out(level, why_not(s.term));
            self.trials.extend(scores.iter().map(left_out));
            let open = || scores.iter().filter(|s| why_not(s.term).is_none());
            let best = open().find(|s| s.is_clear(level)).or(open().find(|s| s.is_large()));
            // A term may only show beside converged others, and what these would gain by
            // converging is not its own.
            if is_rough && best.is_none_or(|best| best.gain < self.fitted.promised_fall()) {
                if let Some(converged) = likelihood::fit(training, &self.fitted.best, NEXT) {
                    self.fitted = converged;
                }
                is_rough = false;
                continue;
            }
            let Some(best) = best else {
                let is_rival = |s: &Score| left_out(s).why_not == Some(TOO_SMALL);
                self.rivals = scores.into_iter().filter(is_rival).collect();
                break;
            };
            let decided = failed.len() + self.trials.iter().filter(|t| t.kept).count();
            let part = decided as f64 / Term::ALL.len() as f64;
            progress(best.term.words(), TERMS_FROM + (TERMS_TO - TERMS_FROM) * part);
            match self.with_term(training, best, level) {
                Ok((larger, has_begun)) => {
                    is_rough = has_begun;
                    has_grown = true;
                    self.fitted = larger;
                    let own = self.trials.iter_mut().filter(|t| t.term == best.term);
                    own.for_each(|t| (t.kept, t.shift) = (true, Vec::new()));
                    // Together with the new term they may fit better.
                    failed = closed.to_vec();
                }
                Err(why) => failed.push((best.term, why)),
            }
        }
        has_grown
    }

    /// A better fit with one of two terms that imitate each other in the place of the other: the one that
    /// was taken first may hold what is the other's.
    fn exchanged(
        &self,
        training: &Training,
        excluded: &[Term],
        speeds: [f64; 2],
    ) -> Option<Fitted<EmsTrial>> {
        let pairs = ALIKE.iter().flat_map(|taken| ALIKE.iter().map(move |other| (*taken, *other)));
        let may_be = |(taken, other): &(Term, Term)| taken != other && !excluded.contains(other);
        pairs.filter(may_be).find_map(|pair| self.with_exchanged(training, pair, speeds))
    }

    /// The fit with `other`, from its starts, in the place of the term `taken`, if it is better: of more
    /// numbers significantly, of as many it errs less, of fewer it is not significantly worse.
    fn with_exchanged(
        &self,
        training: &Training,
        (taken, other): (Term, Term),
        speeds: [f64; 2],
    ) -> Option<Fitted<EmsTrial>> {
        let best = &self.fitted.best;
        let without = |term: Term, trial: EmsTrial| match term.is_in(&trial.layout) {
            true => term.left_out_of(&trial),
            false => Some(trial),
        };
        let bare = without(other, taken.is_in(&best.layout).then(|| taken.left_out_of(best))??)?;
        if !other.can_join(&bare.layout) {
            return None;
        }
        let cost = |start: EmsTrial| (likelihood::cost(training, &start), start);
        let starts = other.variants(&bare, speeds).into_iter().map(cost);
        let (_, start) = starts.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let may_be_better =
            |fit: &Fitted<EmsTrial>| fit.hoped_cost(HOPE) < (1.0 + LEAST_GAIN) * self.fitted.cost();
        let first = likelihood::fit(training, &start, FIRST).filter(may_be_better)?;
        let begun = likelihood::fit(training, &first.best, BEGIN).filter(may_be_better)?;
        let fitted = likelihood::fit(training, &begun.best, NEXT)?;
        let [own, its] = [&self.fitted, &fitted].map(|fit| fit.best.free_numbers());
        let is_better = match its.cmp(&own) {
            Ordering::Greater => improvement_p_value(training, &self.fitted, &fitted) < LEVEL,
            Ordering::Equal => fitted.cost() < (1.0 - NEXT.fall) * self.fitted.cost(),
            Ordering::Less => improvement_p_value(training, &fitted, &self.fitted) >= LEVEL,
        };
        let is_known =
            other == Term::Stribeck || numbers::are_determined(&fitted, other.parameters());
        (is_better && is_known).then_some(fitted)
    }

    /// The fit with a term that the data support at `level`, and whether it has only begun; or why
    /// they do not.
    fn with_term(
        &self,
        training: &Training,
        best: &Score,
        level: f64,
    ) -> Result<(Fitted<EmsTrial>, bool), &'static str> {
        let begun = likelihood::fit(training, &best.start, BEGIN).ok_or(NO_BETTER)?;
        let Err(why) = self.judge(training, best, level, &begun) else { return Ok((begun, true)) };
        let hoped = begun.hoped_cost(HOPE);
        let growth = self.fitted.cost() - hoped;
        if hoped >= self.cost_to_beat(best)
            || growth_p_value(training, &self.fitted.best, &begun, growth) >= LEVEL
        {
            return Err(why);
        }
        let further = likelihood::fit(training, &begun.best, NEXT).ok_or(NO_BETTER)?;
        self.judge(training, best, level, &further)?;
        Ok((further, false))
    }

    /// Fits each term that is significant but too small to be taken, so that the intervals can contain what
    /// the other parameters are with it: to first order they may be far from that.
    pub(super) fn fit_rivals(&mut self, training: &Training) {
        let Self { fitted, trials, rivals } = self;
        let own = Trial::free(&fitted.best);
        for rival in rivals {
            let trial = trials.iter_mut().find(|t| t.term == rival.term).expect("it was tried");
            let fit = likelihood::fit(training, &rival.start, NEXT);
            match fit.filter(|fit| fit.cost() < fitted.cost()) {
                Some(fit) => {
                    let free = Trial::free(&fit.best);
                    let new = lacking(&free, &own);
                    let with = free.iter().zip(new).filter(|(_, is_new)| !is_new);
                    trial.shift =
                        with.zip(&own).map(|((with, _), own)| with.value - own.value).collect();
                }
                None => trial.why_not = Some(NO_BETTER),
            }
        }
    }

    fn cost_to_beat(&self, best: &Score) -> f64 {
        (1.0 - 0.3 * best.least_gain) * self.fitted.cost()
    }

    /// Why the fit `larger` with a term is not taken.
    fn judge(
        &self,
        training: &Training,
        best: &Score,
        level: f64,
        larger: &Fitted<EmsTrial>,
    ) -> Result<(), &'static str> {
        let is_sure =
            best.is_clear(level) || improvement_p_value(training, &self.fitted, larger) < level;
        if !is_sure || larger.cost() >= self.cost_to_beat(best) {
            return Err(NO_BETTER);
        }
        // The static force of a Stribeck curve is often determined only by later terms; creep too
        // slow to be measured may be present.
        let may_be_open = match best.term {
            Term::Stribeck => true,
            Term::Creep => larger.cost() < (1.0 - LARGE_GAIN) * self.fitted.cost(),
            _ => false,
        };
        match may_be_open || numbers::are_determined(larger, best.term.parameters()) {
            true => Ok(()),
            false => Err(UNDETERMINED),
        }
    }

    /// Removes each term without which the squared error is not significantly larger, or larger by less
    /// than the term must remove, the last one added first; returns them, and why.
    fn take_out_needless(&mut self, training: &Training, slowest: f64) -> Vec<Failed> {
        let mut needless = Vec::new();
        loop {
            let least_gain = |term: Term| term.least_gain(&self.fitted.best, slowest);
            let open: Vec<(Term, EmsTrial)> = (self.trials.iter().rev())
                .filter(|t| t.kept)
                .filter_map(|t| Some((t.term, t.term.left_out_of(&self.fitted.best)?)))
                .collect();
            let at_first =
                Without::clear_to_first_order(training, &self.fitted, &open, &least_gain);
            let judged = |((term, from), clear): ((Term, EmsTrial), Option<Without>)| {
                let fitted = || Without::fitted(training, &self.fitted, from, least_gain(term));
                Some((term, clear.or_else(fitted)?))
            };
            let all: Vec<(Term, Without)> =
                open.into_par_iter().zip(at_first).filter_map(judged).collect();
            let mut taken = None;
            for (term, without) in all {
                let is_needless = without.is_needless(least_gain(term)) && taken.is_none();
                let own = self.trials.iter_mut().find(|t| t.term == term).expect("it was tried");
                (own.p_value, own.gain, own.kept) = (without.p_value, without.gain, !is_needless);
                if is_needless {
                    needless
                        .push((term, if without.p_value < LEVEL { TOO_SMALL } else { NO_BETTER }));
                    taken = without.fitted;
                }
            }
            let Some(fit) = taken else { return needless };
            self.fitted = fit;
        }
    }
}

/// What leaving out one of the terms of a fit does.
struct Without {
    /// The fit without it; `None` where the first order was enough.
    fitted: Option<Fitted<EmsTrial>>,
    /// p value of the increase of the squared error, and the fraction of it that the term removes.
    p_value: f64,
    gain: f64,
}

impl Without {
    /// Leaving out each of the `terms`, with the trial that lacks it, to first order: the secant to
    /// that trial, and the other parameters in one step. `None` where it might be needless if the
    /// fall to come were several times as large as that step's.
    fn clear_to_first_order(
        training: &Training,
        with: &Fitted<EmsTrial>,
        terms: &[(Term, EmsTrial)],
        least_gain: &impl Fn(Term) -> f64,
    ) -> Vec<Option<Self>> {
        let secants: Vec<Extra<EmsTrial>> =
            terms.iter().map(|(_, without)| Extra::Secant(without.clone())).collect();
        let Some(normal) = with.with_columns(training, &secants) else {
            return terms.iter().map(|_| None).collect();
        };
        let free = Trial::free(&with.best);
        let of = |(k, (term, without)): (usize, &(Term, EmsTrial))| {
            let lacking = lacking(&free, &Trial::free(without));
            let growth = normal.growth_along(&free, &lacking, free.len() + k)?;
            let judged = |growth| Self::judged(training, None, (without, with), growth);
            judged(growth / HOPE).is_clear(least_gain(*term)).then(|| judged(growth))
        };
        terms.iter().enumerate().map(of).collect()
    }

    /// The fit `from` a trial without the term, which is only begun where no further step can make
    /// the term needless; `None` where there is none.
    fn fitted(
        training: &Training,
        with: &Fitted<EmsTrial>,
        mut from: EmsTrial,
        least_gain: f64,
    ) -> Option<Self> {
        let judged = |fitted: Fitted<EmsTrial>, hope: f64| {
            let cost = fitted.hoped_cost(hope);
            let trial = fitted.best.clone();
            Self::judged(training, Some(fitted), (&trial, with), cost - with.cost())
        };
        for _ in 0..FIRSTS {
            let begun = judged(likelihood::fit(training, &from, FIRST)?, HOPE);
            if begun.is_clear(least_gain) {
                return Some(begun);
            }
            from = begun.fitted?.best;
        }
        Some(judged(likelihood::fit(training, &from, NEXT)?, 0.0))
    }

    fn judged(
        training: &Training,
        fitted: Option<Fitted<EmsTrial>>,
        (smaller, with): (&EmsTrial, &Fitted<EmsTrial>),
        growth: f64,
    ) -> Self {
        let p_value = growth_p_value(training, smaller, with, growth);
        Self { fitted, p_value, gain: growth / (with.cost() + growth) }
    }

    /// Whether the term is needed, whatever further steps may still gain.
    fn is_clear(&self, least_gain: f64) -> bool {
        self.p_value < CLEARLY_NEEDED && self.gain > CLEAR_GAIN * least_gain
    }

    fn is_needless(&self, least_gain: f64) -> bool {
        self.p_value >= LEVEL || self.gain < least_gain
    }
}

/// Those of the parameters `larger` that `smaller` lacks; both are in one order.
fn lacking(larger: &[Free], smaller: &[Free]) -> Vec<bool> {
    let mut rest = smaller.iter().peekable();
    larger.iter().map(|free| rest.next_if(|own| own.kind == free.kind).is_none()).collect()
}

/// p value of the increase of the squared error from the larger model to the smaller, over the
/// clusters of strokes.
pub(super) fn improvement_p_value(
    training: &Training,
    smaller: &Fitted<EmsTrial>,
    larger: &Fitted<EmsTrial>,
) -> f64 {
    growth_p_value(training, &smaller.best, larger, smaller.cost() - larger.cost())
}

/// The same if the increase were `growth`.
fn growth_p_value(
    training: &Training,
    smaller: &EmsTrial,
    larger: &Fitted<EmsTrial>,
    growth: f64,
) -> f64 {
    let added = (larger.best.free_numbers() - smaller.free_numbers()) as f64;
    f_p_value(growth / variance(larger) / added, added, training.clusters() as f64 - 1.0)
}

/// The best column of each term that can be added, and the number of columns tried.
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
        let runs = |t: &EmsTrial| Trial::model(t).is_some();
        columns.extend(
            term.variants(best, speeds).into_iter().filter(runs).map(|start| (term, start)),
        );
    }
    if columns.is_empty() {
        return None;
    }
    // A delay is no term of the model, but may be mistaken for a mass; and a mass that is not
    // tried, for friction that falls with speed.
    let mut extra: Vec<Extra<EmsTrial>> = vec![Extra::Delay, Extra::Load(Load::Mass)];
    let own = fitted.held.len();
    let [delay, acceleration] = [own, own + 1];
    let place = |(term, start): &(Term, EmsTrial)| match term {
        Term::Load(Load::Mass) => acceleration,
        _ => {
            extra.push(match term {
                Term::Load(load) => Extra::Load(*load),
                _ => Extra::Secant(start.clone()),
            });
            own + extra.len() - 1
        }
    };
    let places: Vec<usize> = columns.iter().map(place).collect();
    let normal = fitted.with_columns(training, &extra)?;
    let damping =
        columns.iter().position(|(term, _)| *term == Term::SealDamping).map(|k| places[k]);
    let terms = columns.chunk_by(|a, b| a.0 == b.0).count();
    let count = 0.5 * (terms + columns.len()) as f64;
    let (free, sigma2) = (Trial::free(best), variance(fitted));
    let tested: Vec<Option<Score>> = columns
        .into_par_iter()
        .zip(places)
        .map(|((term, start), place)| {
            let beside: Vec<usize> = match term {
                Term::Load(Load::Mass) => [Some(delay), damping].into_iter().flatten().collect(),
                term if ALIKE.contains(&term) && !best.layout.loads[Load::Mass as usize] => {
                    vec![acceleration]
                }
                _ => Vec::new(),
            };
            score(&normal, (&free, &fitted.held), &beside, place, sigma2, (term, start), speeds[0])
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
    own: (&[Free], &[bool]),
    beside: &[usize],
    column: usize,
    sigma2: f64,
    (term, mut start): (Term, EmsTrial),
    slowest: f64,
) -> Option<Score> {
    let step = normal.one_step(own, beside, column, sigma2)?;
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
    match term {
        Term::Load(load) => {
            start.candidate.loads[load] = step.amplitude.max(of_load(load).least);
        }
        // From a far too high creep velocity the fit does not find its way back.
        Term::Creep => start.candidate.creep_velocity *= step.amplitude.clamp(0.0, 1.0),
        _ => {}
    }
    let least_gain = term.least_gain(&start, slowest);
    Some(Score { term, p_value, gain: step.gain, least_gain, start })
}
