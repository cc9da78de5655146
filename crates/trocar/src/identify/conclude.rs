//! Refinement, intervals and warnings: from the two steps to the result.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use trocar_model::Stages;

use super::candidate::{Candidate, EmsTrial, Layout, SteadyPrecisions};
use super::deformation::{COARSEST, DampingTest, DeformationFit, Traverse, curves_of, mean_points};
use super::estimate::{Estimate, t_quantile};
use super::output_error::{self, Fitted, Stop};
use super::replicates::Replicates;
use super::shape::BranchShape;
use super::steady::{DirectionLine, SteadyFit};
use super::training::{Segmented, Training};
use super::{
    Identification, IdentifyError, IdentifyOptions, Parameter, Progress, Refinement, Segments, Warning, acceleration,
    inertia, sensors, settled_stretches, two_steps_of_part,
};
use crate::cancel;
use crate::recording::Recording;
use crate::segment::Direction;

/// A hidden mass is kept when it differs from zero by this many standard errors.
const HIDDEN_MASS_LEVEL: f64 = 2.0;

/// Most clusters of cycles.
const MOST_CLUSTERS: usize = 120;

/// What the two steps left.
pub(super) struct TwoSteps<'a> {
    pub(super) recordings: &'a [Recording],
    pub(super) segments: &'a [Segments],
    pub(super) steady: SteadyFit,
    pub(super) deformation: Result<DeformationFit, String>,
    pub(super) candidate: Candidate,
    /// The deformation was not resolved: the candidate's is assumed.
    pub(super) assumed: bool,
}

/// The last refinement.
type Refined = Fitted<EmsTrial>;

/// When the refinement stops.
const STOP: Stop = Stop { iterations: 15, fall: 1e-3 };

fn jackknife(found: &Refined) -> Replicates<Candidate> {
    let candidates = |trials: Vec<EmsTrial>| trials.into_iter().map(|t| t.candidate).collect();
    Replicates::Jackknife(candidates(found.jackknife()), found.effective_clusters(), candidates(found.prior_off()))
}

/// Refines, sets the intervals, and says what is to be said.
pub(super) fn conclude(
    two: TwoSteps,
    options: &IdentifyOptions,
    progress: Progress,
) -> Result<Identification, IdentifyError> {
    two.candidate.stages()?;
    let mut layout = Layout {
        symmetric: !two.steady.is_asymmetric() || two.steady.stribeck.is_some(),
        viscous: two.steady.viscous_damping_n_s_m.pinned,
        stribeck: two.steady.stribeck.is_some(),
        damping: two.candidate.seal_damping > 0.0,
        hidden_mass: options.estimate_hidden_mass && acceleration_is_resolved(two.recordings),
        yielding: false,
        creep: false,
        lag: false,
        arms: 0,
        second: false,
    };
    progress("refining", 0.3);
    let outcome = match (&two.deformation, options.refine) {
        (Ok(found), true) if sampling_resolves(&two) => refined(&two, found, options, &mut layout)?,
        _ => None,
    };
    progress("intervals", 0.7);
    let two_step_parameters = two_step_parameters(&two, options);
    let accepted = outcome.as_ref().filter(|o| o.summary.accepted);
    let (model, parameters) = match accepted {
        Some(o) => (o.refined.best.candidate.clone(), refined_parameters(&two, &o.refined, options)),
        None => (two.candidate.clone(), two_step_parameters.clone()),
    };
    let stages = model.stages()?;
    let refinement = outcome.map(|o| o.summary);
    let warnings = warnings(&two, &model, refinement.as_ref(), &parameters);
    progress("residuals", 0.9);
    let residual_rms = residual_rms(two.recordings, &model, &stages);
    let free_parameters = free_parameters(&model, layout, two.assumed);
    Ok(Identification {
        model,
        stages,
        two_step: two.candidate,
        parameters,
        two_step_parameters,
        steady: two.steady,
        deformation: two.deformation,
        refinement,
        free_motion: None,
        motion: None,
        position_lag: None,
        travel: None,
        travel_missing: None,
        free_parameters,
        residual_rms,
        warnings,
    })
}

/// Whether all recordings are sampled finely enough to see the acceleration of a reversal, which lasts some hundredths
/// of a second: it takes five positions.
pub(super) fn acceleration_is_resolved(recordings: &[Recording]) -> bool {
    const REVERSAL: f64 = 0.03;
    recordings.iter().all(|r| 5.0 * r.quality.median_interval <= REVERSAL)
}

/// Whether a sample at the fastest speed moves less than a fifth of the half width: else there is nothing to simulate.
fn sampling_resolves(two: &TwoSteps) -> bool {
    let interval = two.recordings.iter().map(|r| r.quality.median_interval).fold(0.0, f64::max);
    two.candidate.half_width > COARSEST * interval * two.steady.speed_range_m_s[1]
}

struct Outcome {
    refined: Refined,
    summary: Refinement,
}

/// The refinement, with the hidden mass dropped where it is not significant, and its trial on held-out passes.
fn refined(
    two: &TwoSteps,
    deformation: &DeformationFit,
    options: &IdentifyOptions,
    layout: &mut Layout,
) -> Result<Option<Outcome>, IdentifyError> {
    let mut training = training(two, deformation)?;
    if training.clusters() < 4 {
        return Ok(None);
    }
    training.prior = prior(two, *layout);
    let from = EmsTrial { candidate: two.candidate.clone(), layout: *layout };
    let Some(mut found) = output_error::fit(&training, &from, STOP) else { return Ok(None) };
    if layout.hidden_mass && !hidden_mass_is_plausible(&found, &training) {
        layout.hidden_mass = false;
        training.prior = prior(two, *layout);
        let candidate = Candidate { hidden_mass: 0.0, ..found.best.candidate };
        let without = EmsTrial { candidate, layout: *layout };
        let Some(again) = output_error::fit(&training, &without, STOP) else { return Ok(None) };
        found = again;
    }
    let Some([held_out_two_step, held_out_refined]) = held_out_rms(two, deformation, &training, &found, options) else {
        return Ok(None);
    };
    let before = (output_error::cost(&training, &from, |_| true) / found.weight()).sqrt();
    let summary = Refinement {
        two_step_rms_n: before,
        refined_rms_n: found.rms[1],
        held_out_two_step_rms_n: held_out_two_step,
        held_out_refined_rms_n: held_out_refined,
        iterations: found.iterations,
        converged: found.converged,
        accepted: held_out_refined <= held_out_two_step,
    };
    Ok(Some(Outcome { refined: found, summary }))
}

/// What the steady state knows of the numbers it shares with the refinement: value and precision.
///
/// Its pass means are their data. The readings that remain, before the sliding settles and under a constant push, share
/// the level of their pass and would pull F_c, β and F_0 off (the intervals of F_c then held in 176 of 200 benches), so
/// the precision is raised until they are held; what their errors do to the other numbers is added to the intervals.
fn prior(two: &TwoSteps, layout: Layout) -> Vec<(f64, f64)> {
    let precision = |e: &Estimate| match e.half_width() {
        half if half.is_finite() && half > 0.0 => (t_quantile(1e6) / half).powi(2),
        _ => 0.0,
    };
    let steady = &two.steady;
    let common = [precision(&steady.coulomb_force_n), precision(&steady.viscous_damping_n_s_m)];
    let own = |line: &Option<DirectionLine>| match line {
        Some(l) if !layout.symmetric => [precision(&l.coulomb_force_n), precision(&l.viscous_damping_n_s_m)],
        _ => common,
    };
    let known = SteadyPrecisions {
        offset: precision(&steady.offset_n),
        lines: [own(&steady.positive), own(&steady.negative)],
        stribeck: steady
            .stribeck
            .as_ref()
            .map_or([0.0; 2], |s| [precision(&s.static_force_n), precision(&s.stribeck_velocity_m_s)]),
    };
    let free = layout.free(&two.candidate);
    let precisions = layout.precisions(&known, free.len());
    free.iter().zip(precisions).map(|(f, p)| (f.value, output_error::HELD * p)).collect()
}

/// Errors, N, of the two steps and of the refinement on cycles that neither has seen: each half of the cycles (every
/// other one) is predicted from the other half.
///
/// The refinement of a half is first taken to first order about the result, which costs next to nothing; only if that
/// does not predict better than the two steps is it done in full.
fn held_out_rms(
    two: &TwoSteps,
    deformation: &DeformationFit,
    training: &Training,
    found: &Refined,
    options: &IdentifyOptions,
) -> Option<[f64; 2]> {
    let layout = found.best.layout;
    let mut halves = Vec::new();
    let (mut two_step_cost, mut first_order_cost) = (0.0, 0.0);
    for half in 0..2 {
        let held_out = move |g: usize| g % 2 == half;
        let chosen = |recording, sample| !held_out(training.cluster_of(recording, sample));
        let candidate = two_steps_of_part(&two.steady, deformation, two.recordings, options, chosen)?;
        let two_step = EmsTrial { candidate, layout };
        let first_order = found.without(&two_step, held_out)?;
        two_step_cost += output_error::cost(training, &two_step, held_out);
        first_order_cost += output_error::cost(training, &first_order, held_out);
        halves.push((two_step, held_out));
    }
    let refined_cost = if first_order_cost <= two_step_cost {
        first_order_cost
    } else {
        let of = |(two_step, held_out): &(EmsTrial, _)| {
            output_error::held_out_cost(training, two_step, &found.best, STOP, held_out)
        };
        halves.iter().map(of).sum::<Option<f64>>()?
    };
    Some([two_step_cost, refined_cost].map(|cost| (cost / found.weight()).sqrt()))
}

fn training<'a>(two: &TwoSteps<'a>, found: &DeformationFit) -> Result<Training, IdentifyError> {
    let segmented = |(recording, segments): (&'a Recording, &'a Segments)| Segmented {
        recording,
        passes: &segments.passes,
        settled: settled_stretches(recording, segments, &two.steady, found),
        settled_scored: false,
        acceleration: acceleration(recording),
    };
    let data: Vec<Segmented> = two.recordings.iter().zip(two.segments).map(segmented).collect();
    let mut training = Training::new(
        &data,
        sensors(two.recordings).force_noise.max(1e-6),
        two.steady.pass_scatter_n,
        two.candidate.half_width,
        MOST_CLUSTERS,
    );
    training.forget_unknown_starts(two.candidate.stages()?.elements());
    Ok(training)
}

/// Free numbers of the model itself; those of a deformation that is assumed do not count.
fn free_parameters(model: &Candidate, layout: Layout, assumed: bool) -> usize {
    let of_sensor = 1 + usize::from(layout.hidden_mass);
    let branches = [&model.rising, &model.falling].map(|shape| 2 + shape.left.len() + shape.right.len());
    let of_deformation = if assumed { 1 + branches.iter().sum::<usize>() } else { 0 };
    layout.free(model).len() - of_sensor - of_deformation
}

/// Significant, and a small part of the reading: what moves the force more than the seal does is no forgotten rod.
fn hidden_mass_is_plausible(found: &Refined, training: &Training) -> bool {
    let best = &found.best.candidate;
    let estimate = jackknife(found).estimate(best, "kg", &|c| c.hidden_mass);
    let error = estimate.half_width() / t_quantile(1e6);
    let small = estimate.value * training.rms_acceleration() < 0.1 * best.insertion.coulomb_force;
    estimate.value > HIDDEN_MASS_LEVEL * error && small
}

pub(super) fn residual_rms(recordings: &[Recording], model: &Candidate, stages: &Stages) -> f64 {
    let (mut squares, mut samples) = (0.0, 0.0);
    for recording in recordings {
        let run = crate::replay::replay(stages.elements(), recording, model.offset);
        let inertia = inertia(recording, model.hidden_mass);
        for i in run.known.into_iter().flatten() {
            let error = recording.force[i] - model.offset - inertia[i] - run.force[i];
            squares += error * error;
            samples += 1.0;
        }
    }
    f64::sqrt(squares / f64::max(samples, 1.0))
}

/// A number that follows from a candidate: name, unit, and how.
pub(super) struct Quantity {
    pub(super) name: String,
    pub(super) unit: &'static str,
    pub(super) of: Box<dyn Fn(&Candidate) -> f64>,
}

impl Quantity {
    fn new(name: String, unit: &'static str, of: impl Fn(&Candidate) -> f64 + 'static) -> Self {
        Self { name, unit, of: Box::new(of) }
    }
}

/// What comes from the branches: join, force there, and the paper's θ (25).
pub(super) fn branch_quantities(candidate: &Candidate) -> Vec<Quantity> {
    type Side = fn(&Candidate) -> &BranchShape;
    const POWERS: [&str; 8] = ["N", "N/m", "N/m^2", "N/m^3", "N/m^4", "N/m^5", "N/m^6", "N/m^7"];
    let sides: [(&str, Side); 2] = [("rising", |c| &c.rising), ("falling", |c| &c.falling)];
    let mut all = Vec::new();
    for (name, side) in sides {
        all.push(Quantity::new(format!("{name}_join_m"), "m", move |c| side(c).join * c.half_width));
        all.push(Quantity::new(format!("{name}_join_force_n"), "N", move |c| side(c).join_force));
        for (piece, degree) in side(candidate).degrees().into_iter().enumerate() {
            for (power, unit) in POWERS.into_iter().enumerate().take(degree + 1) {
                let monomial = move |c: &Candidate| {
                    let Ok(branch) = side(c).branch(c.half_width, c.pins()) else { return f64::NAN };
                    if piece == 0 { branch.left().monomial()[power] } else { branch.right().monomial()[power] }
                };
                let suffix = if power == 0 { "n".to_owned() } else { format!("n_m{power}") };
                all.push(Quantity::new(format!("{name}_theta{}_{power}_{suffix}", piece + 1), unit, monomial));
            }
        }
    }
    all
}

fn named(name: impl Into<String>, estimate: Estimate) -> Parameter {
    Parameter { name: name.into(), estimate }
}

/// Lines of both directions: always the steady state's own, through the readings as they are.
fn direction_parameters(steady: &SteadyFit) -> Vec<Parameter> {
    let lines = [("positive", &steady.positive), ("negative", &steady.negative)];
    let found = lines.into_iter().filter_map(|(name, line)| Some((name, line.as_ref()?)));
    found
        .flat_map(|(name, line)| {
            [
                named(format!("coulomb_force_n_{name}"), line.coulomb_force_n.clone()),
                named(format!("viscous_damping_n_s_m_{name}"), line.viscous_damping_n_s_m.clone()),
            ]
        })
        .collect()
}

fn two_step_parameters(two: &TwoSteps, options: &IdentifyOptions) -> Vec<Parameter> {
    let steady = &two.steady;
    let mut all = vec![
        named("coulomb_force_n", steady.coulomb_force_n.clone()),
        named("viscous_damping_n_s_m", steady.viscous_damping_n_s_m.clone()),
        named("offset_n", steady.offset_n.clone()),
    ];
    all.extend(direction_parameters(steady));
    if let Some(s) = &steady.stribeck {
        all.push(named("static_force_n", s.static_force_n.clone()));
        all.push(named("stribeck_velocity_m_s", s.stribeck_velocity_m_s.clone()));
    }
    match &two.deformation {
        Ok(found) => {
            all.push(named("half_width_m", found.half_width.clone()));
            if let Some(test) = &found.damping {
                all.push(named("seal_damping_n_s_m", tested_damping(test)));
            }
            let replicates = two_step_replicates(two, found, options);
            all.extend(branch_parameters(&two.candidate, &replicates));
        }
        Err(why) => {
            all.push(named("half_width_m", Estimate::not_pinned(two.candidate.half_width, "m", why.clone())));
        }
    }
    all
}

/// Branches refitted to traverses resampled by cycle (or left out one at a time).
fn two_step_replicates(two: &TwoSteps, found: &DeformationFit, options: &IdentifyOptions) -> Replicates<Candidate> {
    let pins = two.candidate.pins();
    let refit = |direction: Direction, shape: &BranchShape, chosen: &dyn Fn(usize) -> usize, count: usize| {
        let own: Vec<&Traverse> = found.traverses.iter().filter(|t| t.direction == direction).collect();
        let curves: Vec<&[f64]> =
            (0..count.min(own.len())).map(|k| own[chosen(k) % own.len()].curve.as_slice()).collect();
        BranchShape::fit(options.degrees, pins, &mean_points(&curves)).map_or_else(|| shape.clone(), |f| f.0)
    };
    let [up, down] = [Direction::Positive, Direction::Negative].map(|d| curves_of(&found.traverses, d).len());
    let with = |rising, falling| Candidate { rising, falling, ..two.candidate.clone() };
    if options.bootstrap == 0 {
        let n = up.min(down);
        let left_out = |g: usize| {
            cancel::check();
            let skip = |k: usize| if k < g { k } else { k + 1 };
            with(
                refit(Direction::Positive, &two.candidate.rising, &skip, up.max(2) - 1),
                refit(Direction::Negative, &two.candidate.falling, &skip, down.max(2) - 1),
            )
        };
        return Replicates::Jackknife((0..n).into_par_iter().map(left_out).collect(), n as f64, Vec::new());
    }
    let resampled = |index: usize| {
        cancel::check();
        let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
        rng.set_stream(index as u64);
        let drawn: Vec<usize> = (0..up.max(down)).map(|_| rng.random_range(0..up.max(down))).collect();
        let chosen = |k: usize| drawn[k];
        with(
            refit(Direction::Positive, &two.candidate.rising, &chosen, up),
            refit(Direction::Negative, &two.candidate.falling, &chosen, down),
        )
    };
    Replicates::Bootstrap((0..options.bootstrap).into_par_iter().map(resampled).collect())
}

/// σ as the model has it: what the test found, or zero with what the test could not exclude.
fn tested_damping(test: &DampingTest) -> Estimate {
    let found = &test.seal_damping_n_s_m;
    if test.kept || !found.pinned {
        return found.clone();
    }
    Estimate::from_bounds(0.0, found.ci95[0], found.ci95[1], found.unit)
        .with_note(format!("set to zero by the test: {:.3} N s/m found, p = {:.2}", found.value, test.p_value))
}

fn refined_parameters(two: &TwoSteps, refined: &Refined, options: &IdentifyOptions) -> Vec<Parameter> {
    let EmsTrial { candidate: best, layout } = &refined.best;
    let jackknife = jackknife(refined);
    let estimate = |name: &str, unit, of: &dyn Fn(&Candidate) -> f64| named(name, jackknife.estimate(best, unit, of));
    let steady = &two.steady;
    let mut all = Vec::new();
    if layout.symmetric && layout.viscous {
        all.push(estimate("coulomb_force_n", "N", &|c| c.insertion.coulomb_force));
        all.push(estimate("viscous_damping_n_s_m", "N s/m", &|c| c.insertion.viscous_damping));
        all.push(estimate("offset_n", "N", &|c| c.offset));
    } else {
        // One speed, or directions of different slope: the common line stays the steady state's.
        all.push(named("coulomb_force_n", steady.coulomb_force_n.clone()));
        all.push(named("viscous_damping_n_s_m", steady.viscous_damping_n_s_m.clone()));
        all.push(named("offset_n", steady.offset_n.clone()));
    }
    all.extend(direction_parameters(steady));
    if layout.stribeck {
        all.push(estimate("static_force_n", "N", &|c| c.insertion.static_force));
        all.push(estimate("stribeck_velocity_m_s", "m/s", &|c| c.insertion.stribeck_velocity));
    }
    all.push(estimate("half_width_m", "m", &|c| c.half_width));
    if layout.damping {
        all.push(estimate("seal_damping_n_s_m", "N s/m", &|c| c.seal_damping));
    } else if let Some(test) = two.deformation.as_ref().ok().and_then(|d| d.damping.as_ref()) {
        all.push(named("seal_damping_n_s_m", tested_damping(test)));
    }
    if layout.hidden_mass {
        all.push(estimate("hidden_mass_kg", "kg", &|c| c.hidden_mass));
    }
    let replicates = match options.bootstrap {
        0 => jackknife,
        n => {
            let all = refined.bootstrap(n, options.seed);
            Replicates::Bootstrap(all.into_iter().map(|t| t.candidate).collect())
        }
    };
    all.extend(branch_parameters(best, &replicates));
    all
}

/// Join and coefficients of both branches; a join at the end of its range is not pinned, whatever its replicates say.
fn branch_parameters(best: &Candidate, replicates: &Replicates<Candidate>) -> Vec<Parameter> {
    let parameter = |quantity: Quantity| {
        let shape = if quantity.name.starts_with("rising") { &best.rising } else { &best.falling };
        let estimate = if quantity.name.ends_with("join_m") && shape.join_at_bound() {
            Estimate::not_pinned((quantity.of)(best), quantity.unit, "no best join inside the range searched")
        } else {
            replicates.estimate(best, quantity.unit, &quantity.of)
        };
        named(quantity.name, estimate)
    };
    branch_quantities(best).into_iter().map(parameter).collect()
}

fn warnings(
    two: &TwoSteps,
    model: &Candidate,
    refinement: Option<&Refinement>,
    parameters: &[Parameter],
) -> Vec<Warning> {
    let mut all = Vec::new();
    let mut say = |subject: &str, message: String, doubtful: bool| {
        all.push(Warning { subject: subject.to_owned(), message, doubtful });
    };
    for recording in two.recordings {
        for warning in &recording.quality.warnings {
            say(&recording.name, warning.message.clone(), true);
        }
    }
    // One line for the coefficients of a polynomial, not one each.
    let worth_a_line = |p: &&Parameter| !p.estimate.pinned && !p.name.contains("theta");
    for p in parameters.iter().filter(worth_a_line) {
        let why = p.estimate.note.as_deref().unwrap_or("the data do not pin it");
        say(&p.name, format!("not pinned: {why}"), true);
    }
    if two.assumed {
        let message = format!(
            "the deformation of the seal is not resolved; the model holds a straight spring of half width {:.3} mm in its place",
            1e3 * model.half_width
        );
        say("half_width_m", message, true);
    }
    steady_warnings(&two.steady, &mut say);
    if let Ok(found) = &two.deformation {
        deformation_warnings(found, &mut say);
    }
    if model.hidden_mass > 0.0 {
        let message = format!(
            "the readings follow the acceleration, as from an inertia of {:.3} kg that was not declared; if there is such a mass \
             between sensor and seal, declare it with --moving-mass-kg",
            model.hidden_mass
        );
        say("hidden_mass_kg", message, false);
    }
    if let Some(r) = refinement {
        if !r.accepted {
            let message = format!(
                "not accepted: {:.4} N on held-out passes against {:.4} N of the two-step result",
                r.held_out_refined_rms_n, r.held_out_two_step_rms_n
            );
            say("refinement", message, false);
        } else if !r.converged {
            say("refinement", format!("did not come to rest in {} steps", r.iterations), true);
        }
    }
    all
}

fn steady_warnings(steady: &SteadyFit, say: &mut impl FnMut(&str, String, bool)) {
    if let Some(test) = steady.lack_of_fit.as_ref().filter(|t| t.p_value < 0.01) {
        let message = format!(
            "the straight line does not fit (p = {:.3}, {:+.3} N at the slowest speed): {}",
            test.p_value, test.excess_at_slowest_n, test.verdict
        );
        say("sliding friction", message, false);
    }
    if let (true, Some(_)) = (steady.is_asymmetric(), &steady.stribeck) {
        let message = "insertion and withdrawal differ, and the friction asks for a Stribeck curve: the model has one curve for both";
        say("viscous_damping_n_s_m", message.to_owned(), true);
    } else if let (true, Some(p)) = (steady.is_asymmetric(), steady.symmetry_p_value) {
        let message = format!("insertion and withdrawal differ in slope (p = {p:.2e}): each direction has its own");
        say("viscous_damping_n_s_m", message, false);
    }
}

fn deformation_warnings(found: &DeformationFit, say: &mut impl FnMut(&str, String, bool)) {
    if let Some(p) = found.speed_dependence_p_value.filter(|p| *p < 0.01) {
        let message = format!(
            "the half width changes with speed (p = {p:.1e}), within a spread of {:.1} µm",
            1e6 * found.deflection_error
        );
        say("half_width_m", message, false);
    }
    if let Some(test) = found.damping.as_ref().filter(|t| !t.kept && !t.equivalent_to_zero) {
        let message = format!(
            "set to zero, but these data cannot exclude a damping force of up to {:.2} N at the fastest deformation",
            test.largest_force_not_excluded_n
        );
        say("seal_damping_n_s_m", message, false);
    }
    let partial = "the minor-loop stiffness is the default (1.01 times the steepest change of the gap between the branches): \
                   it rules partial reversals, and is not identified from them";
    say("yield_stiffness_n_m", partial.to_owned(), false);
}
