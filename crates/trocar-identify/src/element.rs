//! The fit of the element: from the start given by the two steps to the minimum of the likelihood
//! cost, with the friction scale of each stroke and the optional terms that the data support.
//!
//! ```text
//! starts -> fit with one scale -> fit with a scale per stroke -> τ², ω² (restricted likelihood) -> terms -> τ², ω² -> terms again -> last fit, finer
//! ```

use std::f64::consts::PI;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use trocar_model::{Branch, ElementParams, Quantity, SlidingFriction, Trocar};

use super::candidate::{Candidate, EmsTrial, Layout, STRIBECK_RANGE};
use super::findings::Progress;
use super::joins::Joins;
use super::likelihood::{self, Fitted, ScaleVariance, Stop, Trial};
use super::options::IdentifyOptions;
use super::scale::{FrictionScale, Jump};
use super::seal_prior::SealPrior;
use super::shape::BranchShape;
use super::spread::variance;
use super::terms::{self, Chosen, Term, TermTrial, improvement_p_value};
use super::training::{ASSUMED_WIDTH, Coarseness, INDEPENDENT, Ripple, Scale, Segmented, Training};
use super::two_steps::{TwoSteps, settled_segments};
use super::unexplained::PositionDelay;
use super::unexplained::{Unexplained, UnexplainedEffects};
use trocar_recording::loads::{Load, Recorded};
use trocar_recording::{Recording, force_range, median};
use trocar_simulate::motion_found::{FreeMotion, longest_rest, slow_speed};
use trocar_simulate::replay::replay_rest;
use trocar_simulate::segment::{Direction, Segments, SteadySegment};
use trocar_simulate::stick_slip::{LeftOut, StickSlip};

/// Half widths to start from where the two steps resolved none, in units of the assumed one.
const WIDTHS: [f64; 6] = [0.05, 0.1, 0.2, 0.5, 1.0, 1.8];
/// Half widths tried again, relative to the best.
const OTHER_WIDTHS: [f64; 3] = [0.5, 0.7, 1.4];
/// The same for a fit from a prior: the seal may be another than the prior's, by a factor of √2 from
/// one start to the next.
const WIDTHS_OF_A_PRIOR: [f64; 6] = [0.25, 0.35, 0.5, 0.7, 1.4, 2.0];
/// Most clusters.
pub(super) const MOST_CLUSTERS: usize = 120;
/// Fewest strokes from which their scatter is estimated; with fewer, all have the same scale.
const FEWEST_STROKES: usize = 12;
/// Fewest clusters for a fit.
const FEWEST_CLUSTERS: usize = 4;

/// Starts whose shape is fitted.
const STARTS: usize = 5;

const SHORT: Stop = Stop { iterations: 4, fall: 1e-2, promise: 10.0 * 1e-2 };
const NEXT: Stop = Stop { iterations: 25, fall: 1e-3, promise: 10.0 * 1e-3 };
const LAST: Stop = Stop { iterations: 80, fall: 1e-5, promise: 10.0 * 1e-5 };

/// Input of the fit.
pub(super) struct Input<'a> {
    pub(super) recordings: &'a [Recording],
    pub(super) segments: &'a [Segments],
    /// Accelerations of each recording, m/s².
    pub(super) accelerations: &'a [Vec<f64>],
    /// Of the recorded loads.
    pub(super) effects: &'a [Recorded],
    /// Of each recording.
    pub(super) left_out: &'a [LeftOut],
    /// How the seal sticks and slips, where that is left out.
    pub(super) stick_slip: Option<&'a StickSlip>,
    pub(super) two: &'a TwoSteps,
    pub(super) options: &'a IdentifyOptions,
}

impl Input<'_> {
    /// Noise of the force readings, N: that of the noisiest recording.
    pub(super) fn noise(&self) -> f64 {
        self.recordings.iter().map(|r| r.quality.force_noise).fold(0.0, f64::max)
    }
}

/// The fitted element with its associated results.
pub(super) struct ElementFit {
    pub(super) training: Training,
    pub(super) fitted: Fitted<EmsTrial>,
    pub(super) joins: Joins,
    pub(super) trials: Vec<TermTrial>,
    pub(super) scale: FrictionScale,
    /// Root mean square error, N, of the paper's element fitted to the same readings.
    pub(super) paper_rms: f64,
    pub(super) left: UnexplainedEffects,
}

impl ElementFit {
    /// Number of free numbers of the seal, without those of the rig.
    pub(super) fn seal_numbers(&self) -> usize {
        let EmsTrial { layout, .. } = &self.fitted.best;
        let of_rig = usize::from(layout.offset) + layout.free_loads().count();
        self.fitted.best.free_numbers() - of_rig
    }
}

/// A fit with its training data and the variances of its friction scale.
struct Scaled {
    training: Training,
    fitted: Fitted<EmsTrial>,
    /// τ.
    scatter: f64,
}

/// The paper's element with a friction scale for each stroke.
pub(super) struct Begun {
    training: Training,
    pub(super) fitted: Fitted<EmsTrial>,
}

/// Fits the paper's element; `None` where no start gives a model that runs or there are too few
/// strokes.
pub(super) fn begin(input: &Input, progress: Progress) -> Option<Begun> {
    if let Some(prior) = &input.options.prior {
        return begin_from(input, prior, progress);
    }
    let starts = starts(input);
    let widest =
        starts.iter().max_by(|a, b| a.candidate.half_width.total_cmp(&b.candidate.half_width))?;
    let plain = training(input, &widest.candidate, Coarseness::SEARCH)?;
    progress("fitting the element", 0.02);
    let best = unresolved(best_of(&plain, &starts, is_assumed(input))?, input);
    let (mut training, mut fitted) = fitted_from(input, &best)?;
    // A wider element forgets its unknown initial state later and needs longer strokes.
    if fitted.best.candidate.half_width > 1.05 * best.candidate.half_width {
        (training, fitted) = fitted_from(input, &fitted.best)?;
    }
    fitted = restarted(input, &training, without_curve(&training, fitted));
    free_scales(input, &mut training, &fitted.best, variance(&fitted) / INITIAL_SCATTER.powi(2));
    progress("friction scale", 0.06);
    let Scaled { training, fitted, .. } = scaled(training, fitted.best, NEXT)?;
    let fitted = with_all_degrees(input, &training, fitted);
    Some(Begun { training, fitted })
}

/// The fit without a Stribeck curve that the two steps found, where that is better: the curve may have held
/// it far from the least squares.
fn without_curve(training: &Training, found: Fitted<EmsTrial>) -> Fitted<EmsTrial> {
    // Where the seal is seen to let go it has one.
    if !found.best.layout.stribeck || found.best.layout.lets_go.is_some() {
        return found;
    }
    let mut curved = found.best.clone();
    for sliding in [&mut curved.candidate.insertion, &mut curved.candidate.withdrawal] {
        sliding.coulomb_force = sliding.static_force;
    }
    let plain = Term::Stribeck.left_out_of(&curved);
    let fit = plain.and_then(|plain| likelihood::fit(training, &plain, NEXT));
    fit.filter(|fit| fit.cost() < found.cost()).unwrap_or(found)
}

/// Where a fit has parabolas for branches, that with the degrees that are wanted if the readings show
/// that they are no parabolas: over many strokes, positions that are far apart in each lie close
/// together.
fn with_all_degrees(
    input: &Input,
    training: &Training,
    found: Fitted<EmsTrial>,
) -> Fitted<EmsTrial> {
    let mut higher = found.best.clone();
    higher.candidate.extend_branches(input.options.degrees);
    if !higher.layout.shape || higher.candidate == found.best.candidate {
        return found;
    }
    likelihood::fit(training, &higher, NEXT)
        .filter(|higher| improvement_p_value(training, &found, higher) < terms::LEVEL)
        .unwrap_or(found)
}

/// Fewest clusters for a fit from a prior.
const FEWEST_WITH_PRIOR: usize = 2;

/// Fits the element of a prior, with its terms.
fn begin_from(input: &Input, prior: &SealPrior, progress: Progress) -> Option<Begun> {
    let from_readings = Layout {
        offset: input.options.offset.is_none(),
        loads: Load::ALL.map(|load| shows(input, load)),
        largest: largest(input),
        narrowest: 0.0,
        slowest_creep: SLOWEST_CREEP * slow_speed(input.recordings),
        ..Layout::paper()
    };
    let mut start = prior.trial(from_readings).ok()?;
    start.candidate.offset = input.options.offset.unwrap_or(start.candidate.offset);
    let mut training = training(input, &start.candidate, Coarseness::NONE)?;
    if training.clusters() < FEWEST_WITH_PRIOR {
        return None;
    }
    training.prior = prior.of(&start);
    progress("fitting the element", 0.02);
    let fitted = likelihood::fit(&training, &start, NEXT)?;
    weigh(input, &mut training, &fitted);
    // Scatter between few strokes looks like viscous friction where they have one scale, and the fit
    // may not get from there, or from the width of the prior, to the least cost.
    let widths = two_step_width(input).into_iter().filter_map(|width| of_width(&start, width));
    let starts: Vec<EmsTrial> = other_widths(&start, &WIDTHS_OF_A_PRIOR)
        .chain(widths)
        .chain([start.clone(), fitted.best])
        .collect();
    let fit = |training: &Training, from: &EmsTrial| likelihood::fit(training, from, NEXT);
    let mut fits: Vec<_> = starts.par_iter().filter_map(|from| fit(&training, from)).collect();
    // The variance of a fit in another minimum would give the prior too much weight.
    let least = fits.iter().min_by(|a, b| variance(a).total_cmp(&variance(b)))?;
    weigh(input, &mut training, least);
    fits = fits.par_iter().filter_map(|found| fit(&training, &found.best)).collect();
    let fitted = fits.into_iter().min_by(|a, b| a.cost().total_cmp(&b.cost()))?;
    progress("friction scale", 0.06);
    let Scaled { training, fitted, .. } = scaled(training, fitted.best, NEXT)?;
    Some(Begun { training, fitted })
}

/// Takes the weight of the prior, and of the friction scales, from the error of a fit.
fn weigh(input: &Input, training: &mut Training, fitted: &Fitted<EmsTrial>) {
    training.variance = variance(fitted);
    free_scales(input, training, &fitted.best, training.variance / INITIAL_SCATTER.powi(2));
}

/// Fraction of the squared error that another width must remove.
const TRUE_GAIN: f64 = 0.05;

/// The best of fits from other half widths, with all terms kept.
fn other_width(training: &Training, found: &Fitted<EmsTrial>) -> Option<Fitted<EmsTrial>> {
    let fits = other_widths(&found.best, &OTHER_WIDTHS)
        .filter_map(|start| likelihood::fit(training, &start, NEXT));
    fits.min_by(|a, b| a.cost().total_cmp(&b.cost()))
}

/// Excesses of the static over the Coulomb force, and Stribeck velocities, from which a fit begins again,
/// relative to those found; an excess of less than a part of F_c counts as that much.
const EXCESSES: [f64; 5] = [0.7, 0.85, 1.0, 1.2, 1.5];
const VELOCITIES: [f64; 4] = [0.5, 0.7, 1.0, 1.5];
const LEAST_EXCESS: f64 = 0.02;
/// The same where no Stribeck friction was found, relative to F_c and to the slowest speed.
const FIRST_EXCESS: f64 = 0.1;
const FIRST_VELOCITY: f64 = 0.5;
/// Cost, relative to the one found, up to which a start is promising: a better one costs more until the
/// other parameters follow it. Most starts that are fitted.
const PROMISING: f64 = 1.5;
const MOST_PROMISING: usize = 3;
/// Most rounds, each from the best fit of the one before.
const ROUNDS: usize = 6;

/// Whether the readings show that the seal lets go by a jump.
fn lets_go(input: &Input) -> bool {
    input.left_out.iter().any(|out| !out.releases.is_empty() || !out.strokes.is_empty())
}

/// A better fit with Stribeck friction from other static forces, Stribeck velocities and the half widths
/// that go with them; `None` where none is found. Where a seal lets go by a jump the cost has many
/// minima: it grows with the static force or the half width alone, and where a jump comes too early or
/// too late the readings beside it do not tell by how much.
fn holding_otherwise(
    input: &Input,
    training: &Training,
    found: &Fitted<EmsTrial>,
) -> Option<Fitted<EmsTrial>> {
    let [slow, _] = speeds(input);
    let mut best: Option<Fitted<EmsTrial>> = None;
    for _ in 0..ROUNDS {
        match held_otherwise(training, best.as_ref().unwrap_or(found), slow) {
            Some(better) => best = Some(better),
            None => break,
        }
    }
    best
}

/// One round: all starts by their cost alone, the most promising begun, the best of these fitted.
fn held_otherwise(
    training: &Training,
    found: &Fitted<EmsTrial>,
    slowest: f64,
) -> Option<Fitted<EmsTrial>> {
    let EmsTrial { candidate, layout, .. } = &found.best;
    let own = candidate.insertion;
    if !layout.shape {
        return None;
    }
    let with_curve = Layout { stribeck: true, ..*layout };
    let excess = |sliding: &SlidingFriction| match layout.stribeck {
        true => {
            (sliding.static_force - sliding.coulomb_force).max(LEAST_EXCESS * sliding.coulomb_force)
        }
        false => FIRST_EXCESS * sliding.coulomb_force,
    };
    let [low, high] = with_curve.range(Quantity::StribeckVelocity, STRIBECK_RANGE);
    let velocity = match layout.stribeck {
        true => own.stribeck_velocity,
        false => FIRST_VELOCITY * slowest,
    };
    let mut velocities = VELOCITIES.map(|part| (part * velocity).clamp(low, high)).to_vec();
    velocities.dedup();
    let is_kept = layout.kept.range(Quantity::StaticForce).is_some();
    let excesses = EXCESSES.into_iter().filter(|part| !is_kept || *part == 1.0);
    let all: Vec<(f64, f64)> =
        excesses.flat_map(|part| velocities.iter().map(move |v| (part, *v))).collect();
    let start = |(part, velocity): (f64, f64)| {
        let candidate = candidate.holding(|sliding| part * excess(sliding), velocity)?;
        let SlidingFriction { static_force, stribeck_velocity, .. } = candidate.insertion;
        let is_other = (static_force - own.static_force).abs() > 1e-9 * own.static_force
            || stribeck_velocity != own.stribeck_velocity;
        let is_possible = static_force <= layout.largest;
        let trial = EmsTrial { candidate, layout: with_curve, ..found.best.clone() }.within();
        (is_other && is_possible).then(|| (likelihood::cost(training, &trial), trial))
    };
    let mut starts: Vec<(f64, EmsTrial)> = all.into_par_iter().filter_map(start).collect();
    starts.retain(|(cost, _)| *cost < PROMISING * found.cost());
    starts.sort_by(|a, b| a.0.total_cmp(&b.0));
    starts.truncate(MOST_PROMISING);
    let begin = |(_, start): &(f64, EmsTrial)| likelihood::fit(training, start, SHORT);
    let begun: Vec<_> = starts.par_iter().filter_map(begin).collect();
    let hoped = |fit: &Fitted<EmsTrial>| fit.hoped_cost(1.0);
    let best = begun.into_iter().min_by(|a, b| hoped(a).total_cmp(&hoped(b)))?;
    let is_near = hoped(&best) < found.cost();
    let fitted = is_near.then(|| likelihood::fit(training, &best.best, NEXT))??;
    (fitted.cost() < (1.0 - NEXT.fall) * found.cost()).then_some(fitted)
}

/// The same full stroke with other half widths, `parts` of its own.
fn other_widths<'a>(trial: &'a EmsTrial, parts: &'a [f64]) -> impl Iterator<Item = EmsTrial> + 'a {
    parts.iter().filter_map(|part| of_width(trial, part * trial.candidate.half_width))
}

fn of_width(trial: &EmsTrial, half_width: f64) -> Option<EmsTrial> {
    let candidate = trial.candidate.with_half_width(half_width)?;
    Some(EmsTrial { candidate, ..trial.clone() })
}

/// The half width that the two steps resolved without a prior, m.
fn two_step_width(input: &Input) -> Option<f64> {
    (!is_assumed(input)).then_some(input.two.candidate.half_width)
}

/// Restarts from near the best, and the most steps of training data for which they are used. Where
/// few positions lie within the deformation, each of them makes the cost non-smooth, and a fit
/// easily stalls between two.
const RESTARTS: usize = 4;
const FEW_STEPS: usize = 5000;

/// The best of fits from near `found`. It must be better over the steps and over all single
/// samples, whose noise a step averages out.
fn restarted(input: &Input, training: &Training, mut found: Fitted<EmsTrial>) -> Fitted<EmsTrial> {
    if !found.best.layout.shape
        || training.runs.iter().map(|run| run.steps.len()).sum::<usize>() > FEW_STEPS
    {
        return found;
    }
    let mut rng = ChaCha8Rng::seed_from_u64(input.options.seed);
    let mut error = sampled_rms(input, &found.best.candidate);
    for _ in 0..RESTARTS {
        let start = found.best.shaken(&mut rng);
        let again =
            likelihood::fit(training, &start, NEXT).filter(|again| again.cost() < found.cost());
        let Some(again) = again else { continue };
        let error_again = sampled_rms(input, &again.best.candidate);
        if error_again < error {
            (found, error) = (again, error_again);
        }
    }
    found
}

/// Root mean square error, N, over all samples whose force does not depend on the unknown start.
pub(super) fn sampled_rms(input: &Input, candidate: &Candidate) -> f64 {
    let Ok(stages) = candidate.stages() else { return f64::INFINITY };
    let of = |(recording, left_out): (&Recording, &LeftOut)| {
        let reading = recording.force_without(&candidate.loads, candidate.offset);
        let seal = |i: usize| reading[i] - candidate.offset;
        let run = replay_rest(&Trocar::of_seal(stages), recording, seal, left_out);
        let error = |i: usize| seal(i) - run.force[i];
        let known = run.known.iter().cloned().flatten();
        known.fold((0.0, 0.0), |(sum, count), i| (sum + error(i).powi(2), count + 1.0))
    };
    let each: Vec<(f64, f64)> = input.recordings.par_iter().zip(input.left_out).map(of).collect();
    let sums = each.into_iter().fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
    (sums.0 / f64::max(sums.1, 1.0)).sqrt()
}

/// The training data for a trial, and the fit to them with one friction scale.
fn fitted_from(input: &Input, trial: &EmsTrial) -> Option<(Training, Fitted<EmsTrial>)> {
    let training = training(input, &trial.candidate, Coarseness::SEARCH)?;
    let fitted = likelihood::fit(&training, trial, NEXT)?;
    (training.clusters() >= FEWEST_CLUSTERS).then_some((training, fitted))
}

/// The element with the terms that the data support, not yet fitted to convergence.
pub(super) struct Grown {
    training: Training,
    chosen: Chosen,
    paper_rms: f64,
}

/// Adds the optional terms that the data support.
pub(super) fn grow(input: &Input, begun: Begun, progress: Progress) -> Option<Grown> {
    let Begun { training, fitted } = begun;
    let paper_rms = fitted.rms[1];
    if input.options.prior.is_some() {
        return Some(Grown { training, chosen: Chosen::untried(fitted), paper_rms });
    }
    progress("optional terms", terms::TERMS_FROM);
    let mut excluded = excluded(input, fitted.best.candidate.half_width);
    if !training.scale.is_free {
        // Differences between few strokes cannot be separated from their scatter.
        excluded.push(Term::Stribeck);
    }
    let mut chosen = terms::choose(&training, fitted, &excluded, speeds(input), progress);
    if is_assumed(input) && chosen.fitted.best.layout.shape {
        // The width was found without the terms: with them another may fit better.
        let other = other_width(&training, &chosen.fitted);
        if let Some(other) =
            other.filter(|other| other.cost() < (1.0 - TRUE_GAIN) * chosen.fitted.cost())
        {
            chosen = terms::choose(&training, other, &excluded, speeds(input), progress);
        }
    }
    let layout = &chosen.fitted.best.layout;
    let may_fall = layout.stribeck || !excluded.contains(&Term::Stribeck);
    if lets_go(input)
        && may_fall
        && let Some(other) = holding_otherwise(input, &training, &chosen.fitted)
    {
        chosen = terms::choose(&training, other, &excluded, speeds(input), progress);
    }
    // The terms explain much of what hid others, and of what looked like scatter.
    let Scaled { training, fitted, .. } = scaled(training, without_drift(chosen.fitted), NEXT)?;
    let chosen = terms::choose(&training, fitted, &excluded, speeds(input), progress);
    Some(Grown { training, chosen, paper_rms })
}

/// Fits to convergence, following the deformation as finely as it is sampled.
pub(super) fn finish(input: &Input, grown: Grown, progress: Progress) -> Option<ElementFit> {
    let Grown { mut training, mut chosen, paper_rms } = grown;
    progress("last fit", terms::TERMS_TO);
    chosen.fit_rivals(&training);
    let Chosen { fitted, trials, .. } = chosen;
    let from = without_drift(fitted);
    // A fit from a prior was as fine from the start.
    if input.options.prior.is_none() {
        let lambda = training.scale.lambda;
        training = self::training(input, &from.candidate, Coarseness::NONE)?;
        free_scales(input, &mut training, &from, lambda);
    }
    let mut last = scaled(training, from, LAST)?;
    // The longer steps of the search may favour another static force.
    if lets_go(input)
        && input.options.prior.is_none()
        && last.fitted.best.layout.stribeck
        && let Some(other) = holding_otherwise(input, &last.training, &last.fitted)
    {
        let again = scaled(last.training.clone(), without_drift(other), LAST);
        last = again.unwrap_or(last);
    }
    Some(last.with(input, trials, paper_rms))
}

fn without_drift(fitted: Fitted<EmsTrial>) -> EmsTrial {
    EmsTrial { drift: Vec::new(), ..fitted.best }
}

impl Grown {
    /// Effects that its terms leave unexplained.
    pub(super) fn left(&self, recordings: &[Recording]) -> UnexplainedEffects {
        UnexplainedEffects::by(recordings, &self.training, &self.chosen.fitted)
    }

    /// Root mean square error of the model over all samples, N: friction scales of strokes, which
    /// may imitate a part of the model, have no share in it.
    pub(super) fn error(&self, input: &Input) -> f64 {
        sampled_rms(input, &self.chosen.fitted.best.candidate)
    }
}

impl Scaled {
    /// Adds the trials of the terms and the error of the paper's element.
    fn with(self, input: &Input, trials: Vec<TermTrial>, paper_rms: f64) -> ElementFit {
        let Self { training, fitted, scatter } = self;
        let (fitted, joins) = Joins::searched(&training, fitted, LAST);
        let scale = FrictionScale::new(&training, &fitted, input.recordings, scatter);
        let left = UnexplainedEffects::by(input.recordings, &training, &fitted);
        ElementFit { training, fitted, joins, trials, scale, paper_rms, left }
    }
}

/// Gives each stroke its own friction scale where there are enough strokes to estimate their
/// scatter.
fn free_scales(input: &Input, training: &mut Training, trial: &EmsTrial, lambda: f64) {
    training.scale = Scale {
        is_free: input.options.prior.is_some() || training.strokes.len() >= FEWEST_STROKES,
        lambda,
        unconstrained: unconstrained(input, training),
        ..Scale::default()
    };
    training.blend_over(blend_length(training, trial));
}

impl Begun {
    /// The delay of the positions.
    pub(super) fn position_delay(&self, recordings: &[Recording]) -> Option<PositionDelay> {
        Unexplained::new(recordings, &self.training, &self.fitted)?.lag_left()
    }
}

/// ℓ in half widths.
const BLENDS: [f64; 5] = [0.1, 0.25, 0.5, 1.0, 2.0];

/// ℓ, m: the travel over which the scale of a stroke replaces that of the one before; minimises C.
fn blend_length(training: &Training, trial: &EmsTrial) -> f64 {
    let of = |part: &f64| {
        let (length, mut training) = (part * trial.candidate.half_width, training.clone());
        training.blend_over(length);
        (length, likelihood::cost(&training, trial))
    };
    let tried: Vec<(f64, f64)> = BLENDS.par_iter().map(of).collect();
    let best = tried.iter().min_by(|a, b| a.1.total_cmp(&b.1)).expect("several are tried");
    best.0
}

/// Initial value of the scatter between strokes.
const INITIAL_SCATTER: f64 = 0.01;

/// The remaining undamped step, in standard errors: root mean square over the free parameters.
pub(super) fn remaining(fitted: &Fitted<EmsTrial>) -> f64 {
    let moved = fitted.held.iter().filter(|held| !**held).count().max(1) as f64;
    (fitted.promised_fall() * fitted.cost() / variance(fitted) / moved).max(0.0).sqrt()
}

/// Sets the variances of the friction scale from a fit at `from`, and refits with them.
fn scaled(mut training: Training, from: EmsTrial, stop: Stop) -> Option<Scaled> {
    (training.scale.basis, training.scale.expected) = (Vec::new(), Vec::new());
    let mut first = likelihood::fit(&training, &from, SHORT)?;
    let sigma2 = variance(&first);
    if !training.scale.is_free {
        let fitted = likelihood::fit(&training, &first.best, stop)?;
        return Some(Scaled { training, fitted, scatter: 0.0 });
    }
    if first.has_prior {
        training.ripple = Ripple::of(&training, &first);
        first.score_variance =
            training.ripple.and_then(|ripple| ripple.score_variance(&training, &first.best));
    }
    training.variance = sigma2;
    let jumps = Jump::find(&training, &first);
    let drift = drift_basis(&training);
    let mut relative: Vec<f64> = drift.iter().map(|d| d.1).collect();
    training.scale.basis = drift.into_iter().map(|d| d.0).collect();
    let of_jumps: Vec<Vec<f64>> = jumps.iter().map(|jump| jump.basis(&training)).collect();
    training.scale.basis.extend(of_jumps);
    let columns = training.scale.basis.len();
    training.scale.expected = vec![f64::INFINITY; columns];
    let start = EmsTrial { drift: vec![0.0; columns], ..first.best.clone() };
    let own = start.free_numbers();
    let flat = Stop { iterations: 0, fall: 0.0, promise: 0.0 };
    let with_drift = likelihood::fit(&training, &start, flat)?;
    let of_drift: Vec<(usize, f64)> =
        relative.iter().enumerate().map(|(k, b)| (own + k, *b)).collect();
    let ScaleVariance { scatter, drift } =
        with_drift.normal.scale_variance(&training, sigma2, &of_drift);
    let scatter = scatter.min(within_directions(&training, &with_drift));
    training.scale.lambda = sigma2 / scatter.max(1e-12);
    // A drift below 1e-4 is neglected.
    if drift < 1e-8 {
        training.scale.basis.drain(..relative.len());
        relative.clear();
    }
    let of_drift = relative.iter().map(|b| (drift * b).sqrt());
    training.scale.expected = of_drift.chain(jumps.iter().map(|_| Jump::WIDTH)).collect();
    let start = EmsTrial { drift: vec![0.0; training.scale.basis.len()], ..first.best };
    let fitted = likelihood::fit(&training, &start, stop)?;
    Some(Scaled { training, fitted, scatter: scatter.sqrt() })
}

/// Variance of the strokes' own scales about the mean of their recording and direction; infinite
/// for few strokes. A difference between the directions is an offset or an asymmetry, not scatter.
fn within_directions(training: &Training, fitted: &Fitted<EmsTrial>) -> f64 {
    let strokes = &training.strokes;
    let (mut squares, mut degrees) = (0.0, 0.0);
    for recording in 0..=strokes.iter().map(|s| s.recording).max().unwrap_or(0) {
        for direction in [Direction::Insertion, Direction::Withdrawal] {
            let counts = |g: &usize| {
                (strokes[*g].recording, strokes[*g].direction) == (recording, Some(direction))
                    && fitted.normal.scales[*g].information > 0.0
                    && !training.scale.is_unconstrained(*g)
            };
            let own: Vec<f64> =
                (0..strokes.len()).filter(counts).map(|g| fitted.normal.scales[g].own).collect();
            let mean = own.iter().sum::<f64>() / own.len().max(1) as f64;
            squares += own.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
            degrees += own.len().saturating_sub(1) as f64;
        }
    }
    if degrees < FEWEST_STROKES as f64 / 2.0 { f64::INFINITY } else { squares / degrees }
}

/// Most cosines of the drift in a recording, and strokes required for each.
const COSINES: usize = 6;
const STROKES_PER_COSINE: usize = 4;

/// φ_k over the strokes, with the variance of their amplitude over ω²: cosines over each recording
/// (the expansion of a Brownian motion about its mean), and a step from the first recording to each
/// other one. Each has zero mean, so the parameters of the seal are those of the mean stroke.
pub(super) fn drift_basis(training: &Training) -> Vec<(Vec<f64>, f64)> {
    let strokes = &training.strokes;
    let recordings = strokes.iter().map(|s| s.recording).max().map_or(0, |last| last + 1);
    let mut all = Vec::new();
    for recording in 0..recordings {
        let own: Vec<usize> =
            (0..strokes.len()).filter(|g| strokes[*g].recording == recording).collect();
        let (Some(first), Some(last)) = (own.first(), own.last()) else { continue };
        let (from, to) = (strokes[*first].time, strokes[*last].time);
        for k in 1..=COSINES.min(own.len() / STROKES_PER_COSINE) {
            let phase = |g: usize| {
                PI * k as f64 * (strokes[g].time - from) / (to - from).max(f64::MIN_POSITIVE)
            };
            let value =
                |g: usize| if strokes[g].recording == recording { phase(g).cos() } else { 0.0 };
            all.push((training.centred(value), 2.0 / (PI * k as f64).powi(2)));
        }
        if recording > 0 && !own.iter().all(|g| training.scale.is_unconstrained(*g)) {
            all.push((training.centred(|g| f64::from(strokes[g].recording == recording)), 1.0));
        }
    }
    all
}

/// Slowest and fastest speed of sliding, m/s.
pub(super) fn speeds(input: &Input) -> [f64; 2] {
    let [slow, fast] = input.two.steady.speed_range_m_s;
    [slow.max(1e-3), fast.max(2e-3)]
}

/// Least fraction of a motion's time at one plateau for its speed to count as imposed.
const IMPOSED: f64 = 0.5;

/// Strokes whose speed was not imposed, where the others separate speeds in both directions. Under
/// a constant push the speed responds to the friction of the stroke, so its size is no datum.
fn unconstrained(input: &Input, training: &Training) -> Vec<bool> {
    let strokes = &training.strokes;
    let mut imposed = vec![false; strokes.len()];
    let mut speeds: [Vec<f64>; 2] = [Vec::new(), Vec::new()];
    for (recording, segments) in input.segments.iter().enumerate() {
        let is_fitted = |s: &&SteadySegment| !input.left_out[recording].swings_at(s.start);
        let plateaus = segments.steady_segments.iter().filter(|s| s.dwell >= IMPOSED);
        for segment in plateaus.filter(is_fitted) {
            let stroke =
                strokes.partition_point(|s| (s.recording, s.start) <= (recording, segment.start));
            imposed[stroke.saturating_sub(1)] = true;
            speeds[usize::from(segment.velocity > 0.0)].push(segment.velocity.abs());
        }
    }
    let separated = |own: &Vec<f64>| {
        let (low, high) =
            own.iter().fold((f64::INFINITY, 0.0f64), |(l, h), v| (l.min(*v), h.max(*v)));
        own.len() >= 3 && high > 1.5 * low
    };
    if speeds.iter().all(separated) {
        imposed.iter().map(|i| !i).collect()
    } else {
        vec![false; strokes.len()]
    }
}

/// Terms that are not tried.
fn excluded(input: &Input, half_width: f64) -> Vec<Term> {
    let Input { options, .. } = input;
    let mut excluded = options.without.clone();
    let unseen = Load::ALL.into_iter().filter(|load| !shows(input, *load));
    excluded.extend(unseen.map(Term::Load));
    if !options.free_motion {
        excluded.extend([Term::Creep, Term::Relaxation]);
    }
    let rests = input.recordings.iter().map(|r| longest_rest(r, AT_REST * half_width));
    if !options.free_motion || rests.fold(0.0, f64::max) < LONG_REST {
        excluded.push(Term::Dwell);
    }
    if !options.free_motion || !has_partial_reversals(input, half_width) {
        excluded.extend(Term::OF_FREE_MOTION);
    }
    excluded
}

/// Rest, s, that tells friction after rest from the static force, which every reversal shows: three times
/// the time after which it rises, [`trocar_model::dwell`]; and what the contact forgets, of the half width.
const LONG_REST: f64 = 3.0;
const AT_REST: f64 = 0.125;

/// Whether the readings can show a load: one that was recorded, or an unmodelled mass. With a declared
/// mass, a small remainder is its error.
fn shows(input: &Input, load: Load) -> bool {
    let Input { recordings, options, effects, .. } = input;
    let recorded = Load::RECORDED.iter().position(|own| *own == load);
    match recorded {
        Some(own) => effects.iter().any(|effects| effects[own].is_some()),
        None => {
            options.estimate_unmodelled_mass
                && !options.inertia_removed
                && recordings.iter().all(Recording::resolves_reversals)
        }
    }
}

/// Fewest partial reversals needed to identify minor loops and a second stage.
const FEWEST_PARTIAL: usize = 4;

/// Whether the recordings hold partial reversals, which full strokes do not replace.
pub(super) fn has_partial_reversals(input: &Input, half_width: f64) -> bool {
    let motion = FreeMotion::of(input.recordings, input.segments, half_width);
    motion.partial_reversals >= FEWEST_PARTIAL
}

/// Initial value of σ relative to the sliding force.
const INITIAL_ERROR: f64 = 0.03;

/// Least v_c that the motion can reveal, as a part of its slow speed: slower creep at most rounds the
/// instant of a reversal.
const SLOWEST_CREEP: f64 = 0.01;

/// All samples; those of settled sliding are averaged into longer steps.
fn training<'a>(input: &Input<'a>, of: &Candidate, coarseness: Coarseness) -> Option<Training> {
    let Input { recordings, segments, accelerations, effects, left_out, two, .. } = input;
    let segmented = |(k, recording): (usize, &'a Recording)| {
        let segments = &segments[k];
        let settled = match &two.deformation {
            Ok(found) => settled_segments(recording, segments, &two.steady, found),
            Err(_) => Vec::new(),
        };
        let (acceleration, recorded, left_out) = (&accelerations[k], &effects[k], &left_out[k]);
        let strokes = &segments.strokes;
        Segmented { recording, strokes, settled, acceleration, recorded, left_out }
    };
    let data: Vec<Segmented> = recordings.iter().enumerate().map(segmented).collect();
    let mut training = Training::new(&data, of.half_width, MOST_CLUSTERS, INDEPENDENT, coarseness);
    training.variance = (INITIAL_ERROR * of.insertion.coulomb_force).powi(2);
    let stages = of.stages().ok()?;
    training.forget_unknown_starts(stages);
    Some(training)
}

/// Fraction of the stroke below which the deformation of an axis with inertia removed is not that
/// of a seal.
const NEGLIGIBLE: f64 = 0.01;
/// p value of the two steps' symmetry test below which each direction starts with its own slope.
const SURE: f64 = 1e-3;

/// Greatest force of the seal, N, that the readings allow: where the offset is unknown, sliding in both
/// directions spans twice that.
fn largest(input: &Input) -> f64 {
    let [low, high] = force_range(input.recordings);
    if input.options.offset.is_some() { high - low } else { 0.5 * (high - low) }
}

/// None for an axis without a seal; otherwise the element of the two steps, or straight elements of
/// several widths where they resolved no deformation.
fn starts(input: &Input) -> Vec<EmsTrial> {
    let Input { recordings, two, options, .. } = input;
    let mut candidate = two.candidate.clone();
    let steady = &two.steady;
    let is_wanted = |term: Term| !options.without.contains(&term);
    let kept = options.kept;
    let own_slopes = !Term::Asymmetry.is_ruled_out(&kept)
        && is_wanted(Term::Asymmetry)
        && steady.symmetry_p_value.is_some_and(|p| p < SURE);
    let mut layout = Layout {
        offset: options.offset.is_none(),
        own_slopes,
        own_levels: own_slopes && options.offset.is_some(),
        stribeck: is_wanted(Term::Stribeck) && steady.stribeck.is_some(),
        largest: largest(input),
        narrowest: narrowest(input),
        slowest_creep: SLOWEST_CREEP * slow_speed(recordings),
        shows_lag: has_partial_reversals(input, candidate.half_width),
        is_coarse: is_coarse(input, candidate.half_width),
        has_coarse_steps: recordings.iter().any(|r| r.coarse_step() > 0.0),
        kept,
        ..Layout::paper()
    };
    if let Some(offset) = options.offset {
        candidate.offset = offset;
    }
    candidate.seal_damping = 0.0;
    if let Some(found) = input.stick_slip.filter(|_| is_wanted(Term::Stribeck)) {
        candidate = seen_to_let_go(input, found, candidate, &mut layout);
    }
    let candidate = EmsTrial::new(candidate, layout).clamped().candidate;
    let longest = recordings.iter().map(|r| r.quality.stroke).fold(0.0, f64::max);
    // The spring of a drive is no seal: only its friction is requested, and the two steps give that.
    let is_narrow = 2.0 * candidate.half_width < NEGLIGIBLE * longest;
    let is_axis = if two.is_assumed { !steady.means.is_empty() } else { is_narrow };
    if options.inertia_removed && is_axis {
        return Vec::new();
    }
    let with_kept = |start: EmsTrial| with_kept_terms(start, speeds(input));
    if !is_assumed(input) {
        return with_kept(EmsTrial::new(candidate, layout));
    }
    let mut widths =
        WIDTHS.map(|part| (part * ASSUMED_WIDTH * longest).max(layout.narrowest)).to_vec();
    widths.dedup();
    let both = |half_width: f64| {
        let degrees = degrees(input, half_width);
        let straight = straight(&candidate, half_width, degrees);
        [snapping(&straight, degrees), Some(straight)].into_iter().flatten().collect::<Vec<_>>()
    };
    let plain = widths.into_iter().flat_map(both).map(|candidate| EmsTrial::new(candidate, layout));
    // A creeping contact is as smooth as a wide element: a start from a wide element would not find
    // it.
    let creeping = |plain: EmsTrial| {
        let creep_velocity = layout.slowest_creep.max(0.1 * speeds(input)[0]);
        let candidate = Candidate { creep_velocity, ..plain.candidate.clone() };
        let layout = Layout { creep: true, ..layout };
        [plain, EmsTrial::new(candidate, layout)]
    };
    match options.free_motion && !options.without.contains(&Term::Creep) {
        true => plain.flat_map(creeping).flat_map(with_kept).collect(),
        false => plain.flat_map(with_kept).collect(),
    }
}

/// Standard deviations of the noise by which the greatest readings of a force that swings exceed the static
/// force, and part of that force by which they may err.
const IN_NOISE: f64 = 2.0;
const SEEN_TO: f64 = 0.05;

/// Half widths about the one that is seen.
const SEEN_WIDTH: [f64; 2] = [0.7, 1.4];

/// The start of a fit of a seal that sticks and slips as `found`, and in the layout what is seen of it.
fn seen_to_let_go(
    input: &Input,
    found: &StickSlip,
    candidate: Candidate,
    layout: &mut Layout,
) -> Candidate {
    let noise = input.noise();
    let seen = found.force_n[1] - IN_NOISE * noise;
    let margin = SEEN_TO * seen + noise;
    let candidate = holding_as_seen(candidate, seen, found.speed_m_s[1]);
    let travels = input.left_out.iter().flat_map(|out| out.to_release.clone()).collect();
    let width = median(travels).map_or(candidate.half_width, |travel| 0.5 * travel);
    let of_width = SEEN_WIDTH.map(|part| part * width);
    (layout.stribeck, layout.lets_go) = (true, Some([[seen - margin, seen + margin], of_width]));
    candidate.with_half_width(width).unwrap_or(candidate)
}

/// The candidate with the `static_force`, N, at which the seal is seen to let go, and a friction that
/// falls up to the `fastest` speed, m/s, at which it does.
fn holding_as_seen(candidate: Candidate, static_force: f64, fastest: f64) -> Candidate {
    let excess = |sliding: &SlidingFriction| {
        (static_force - sliding.coulomb_force).max(LEAST_EXCESS * sliding.coulomb_force)
    };
    let mut held = candidate.holding(excess, FIRST_VELOCITY * fastest).unwrap_or(candidate);
    for sliding in [&mut held.insertion, &mut held.withdrawal] {
        terms::damp(sliding, fastest);
    }
    held
}

/// The start with every term of which a parameter is kept, at each shape that is tried.
fn with_kept_terms(start: EmsTrial, speeds: [f64; 2]) -> Vec<EmsTrial> {
    let kept = start.layout.kept;
    let wanted = |term: &Term| term.is_kept(&kept);
    Term::ALL.into_iter().filter(wanted).fold(vec![start], |all, term| {
        let with_term = |start: EmsTrial| match term.is_in(&start.layout) {
            true => vec![start],
            false => term.variants(&start, speeds),
        };
        all.into_iter().flat_map(with_term).map(|start| start.within()).collect()
    })
}

/// Whether too few positions lie within this half width, m, to resolve the shape of the
/// deformation.
fn is_coarse(input: &Input, half_width: f64) -> bool {
    half_width < FINELY_RESOLVED * resolution(input)
}

/// Whether the two steps did not resolve the deformation or its shape.
fn is_assumed(input: &Input) -> bool {
    input.two.is_assumed || is_coarse(input, input.two.candidate.half_width)
}

/// The candidate with branches that snap through as those of the plausible seal, scaled to its own
/// forces.
fn snapping(candidate: &Candidate, degrees: [usize; 2]) -> Option<Candidate> {
    const POINTS: usize = 100;
    let seal = ElementParams::plausible_10_5_mm().ok()?.deformation;
    let (c, end) = (seal.half_width(), seal.insertion().force(seal.half_width()));
    let end_forces = candidate.end_forces();
    let force = end_forces.high.min(-end_forces.low) / end;
    let fitted = |branch: &Branch| {
        let at = |k: usize| 2.0 * (k as f64 + 0.5) / POINTS as f64 - 1.0;
        let points: Vec<(f64, f64)> =
            (0..POINTS).map(|k| (at(k), force * branch.force(c * at(k)))).collect();
        BranchShape::fit(degrees, end_forces, &points).map(|found| found.0)
    };
    Some(Candidate {
        insertion_branch: fitted(seal.insertion())?,
        withdrawal_branch: fitted(seal.withdrawal())?,
        ..candidate.clone()
    })
}

/// Positions within c that resolve it, and that resolve branches of any degree.
const RESOLVED: f64 = 3.0;
const FINELY_RESOLVED: f64 = 20.0;
/// A half width within this factor of the least one is not resolved.
const UNRESOLVED: f64 = 1.05;

/// Distance of positions, m, that encoder and sampling can distinguish.
fn resolution(input: &Input) -> f64 {
    let step = input.recordings.iter().map(|r| r.quality.position_resolution).fold(0.0, f64::max);
    let interval = input.recordings.iter().map(|r| r.quality.median_interval).fold(0.0, f64::max);
    let [slow, fast] = input.two.steady.speed_range_m_s;
    step.max(interval * (slow * fast).sqrt())
}

/// Least half width, m, that encoder and sampling resolve.
pub(super) fn narrowest(input: &Input) -> f64 {
    RESOLVED * resolution(input)
}

/// Degrees of branches of this half width, m: parabolas where few positions lie within it.
fn degrees(input: &Input, half_width: f64) -> [usize; 2] {
    if is_coarse(input, half_width) { [2, 2] } else { input.options.degrees }
}

/// The trial with a straight spring of the least width in place of an unresolved deformation.
fn unresolved(trial: EmsTrial, input: &Input) -> EmsTrial {
    let narrowest = narrowest(input);
    if trial.candidate.half_width > UNRESOLVED * narrowest
        || !trial.layout.shape
        || !is_assumed(input)
        || input.options.kept.range(Quantity::HalfWidth).is_some()
    {
        return trial;
    }
    let layout = Layout { shape: false, ..trial.layout };
    EmsTrial { candidate: straight(&trial.candidate, narrowest, [2, 2]), layout, ..trial }
}

/// The candidate with straight branches of polynomials of `degrees`.
pub(super) fn straight(candidate: &Candidate, half_width: f64, degrees: [usize; 2]) -> Candidate {
    let end_forces = candidate.end_forces();
    let branch = BranchShape {
        join_force: 0.5 * (end_forces.low + end_forces.high),
        ..BranchShape::straight(degrees)
    };
    Candidate {
        half_width,
        insertion_branch: branch.clone(),
        withdrawal_branch: branch,
        ..candidate.clone()
    }
}

/// The start with the best fit: a short fit of all, a longer one of the best two.
fn best_of(training: &Training, starts: &[EmsTrial], wide: bool) -> Option<EmsTrial> {
    if let ([only], false) = (starts, wide) {
        return Some(only.clone());
    }
    let carried = |trials: Vec<EmsTrial>, stop, count| {
        let fit = |trial: &EmsTrial| likelihood::fit(training, trial, stop);
        let mut fits: Vec<_> = trials.iter().filter_map(fit).collect();
        // Of two equally good fits, prefer the one with a resolved width.
        let rank = |f: &Fitted<EmsTrial>| {
            let is_resolved = f.best.candidate.half_width > UNRESOLVED * f.best.layout.narrowest;
            f.rms[1] * if is_resolved { 1.0 } else { 1.0 + TRUE_GAIN }
        };
        fits.sort_by(|a, b| rank(a).total_cmp(&rank(b)));
        fits.into_iter().map(|fitted| fitted.best).take(count).collect::<Vec<_>>()
    };
    let shaped =
        |shape: bool| move |t: EmsTrial| EmsTrial { layout: Layout { shape, ..t.layout }, ..t };
    // Forces and creep first, since a shape could mimic them.
    let level: Vec<EmsTrial> =
        carried(starts.iter().cloned().map(shaped(false)).collect(), SHORT, STARTS);
    let best_two =
        carried(carried(level.into_iter().map(shaped(true)).collect(), SHORT, 2), NEXT, 2);
    // A wide element may mimic a narrower one.
    let best = best_two.first()?;
    carried(
        carried(other_widths(best, &OTHER_WIDTHS).chain([best.clone()]).collect(), SHORT, 2),
        NEXT,
        1,
    )
    .into_iter()
    .next()
}

/// The same terms fitted to other readings of the same motion.
pub(super) fn again(input: &Input, found: &ElementFit) -> Option<ElementFit> {
    let mut training = training(input, &found.fitted.best.candidate, Coarseness::NONE)?;
    let start = EmsTrial { drift: Vec::new(), ..found.fitted.best.clone() };
    let lambda = found.fitted.rms[1].powi(2) / found.scale.scatter.max(1e-4).powi(2);
    free_scales(input, &mut training, &start, lambda);
    let last = scaled(training, start, LAST)?;
    Some(last.with(input, found.trials.clone(), found.paper_rms))
}
