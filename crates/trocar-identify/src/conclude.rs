//! Assembly of the result from the results of the stages.

use trocar_model::{Quantity, Trocar};

use super::adequacy::{self, Adequacy, Group, Model};
use super::along::{self, Profile};
use super::candidate::Candidate;
use super::counts;
use super::element::{self, ElementFit, Input};
use super::load::{is_of_rig, of_load};
use super::unexplained::PositionDelay;

use super::estimate::Estimate;
use super::findings::{IdentifyError, Parameter, Warning};
use super::likelihood::Trial;
use super::numbers;
use super::posterior::{Density, Posterior};
use super::result::{FitSummary, Identification};
use super::rotation;
use super::scale::{FrictionScale, TOO_FAR};
use super::seal_prior::PriorUse;
use super::terms::Term;
use super::two_steps;
use trocar_recording::loads::Load;
use trocar_recording::{HEAVIEST_UNMODELLED_MASS, Recording};
use trocar_simulate::motion_found::FreeMotion;

/// Largest remaining undamped step of a converged fit, in standard errors (root mean square over
/// the parameters), and the largest that is known to first order. The intervals cover it.
const UNFINISHED: f64 = 1.0;
const FAR: f64 = 3.0;

fn summary(fit: ElementFit) -> FitSummary {
    FitSummary {
        terms: fit.trials,
        paper_rms_n: fit.paper_rms,
        rms_n: fit.fitted.rms[1],
        iterations: fit.fitted.iterations,
        converged: element::remaining(&fit.fitted) < UNFINISHED,
    }
}

/// Assembles the result.
pub(super) fn conclude(
    input: &Input,
    fit: Option<ElementFit>,
    profile: Profile,
    position_delay: Option<PositionDelay>,
) -> Result<Identification, IdentifyError> {
    let Input { recordings, segments, two, options, .. } = input;
    let no_position_profile = profile.as_ref().err().cloned();
    let position_profile = profile.unwrap_or_default();
    let mut model =
        fit.as_ref().map_or_else(|| two.candidate.clone(), |f| f.fitted.best.candidate.clone());
    if let Some(fit) = &position_profile {
        model.offset = fit.offset_n;
    }
    let stages = model.stages()?;
    let scale = fit.as_ref().map_or_else(FrictionScale::default, |f| f.scale.clone());
    let has_shape = fit.as_ref().map_or(!two.is_assumed, |f| f.fitted.best.layout.shape);
    let along = position_profile.as_ref().map(|t| t.profile.stored_as(|knots| knots));
    let trocar = Trocar::new(stages, along);
    let shown = Model { candidate: &model, trocar, scale: &scale, has_shape };
    let judge = || adequacy::judge(input, &shown);
    let (judged, two_step_parameters) = rayon::join(judge, || two_steps::parameters(two, options));
    let prior = prior_use(input, fit.as_ref());
    let mut parameters = match &fit {
        Some(fit) => fitted_parameters(fit, &judged, &scale, prior.as_ref()),
        None => two_step_parameters.clone(),
    };
    counts::add_error(&mut parameters, input.recordings);
    parameters.sort_by_key(|p| numbers::rank(p.id));
    let covariance = fit.as_ref().map(|fit| numbers::covariance(&fit.fitted, &parameters));
    // Only who goes on from the fit asks for them.
    let goes_on = fit.as_ref().filter(|_| input.options.shaft_radius.is_some());
    let deviations = goes_on.map_or_else(Vec::new, |fit| numbers::deviations(&fit.fitted));
    let mut warnings = warnings(input, &model, fit.as_ref(), &judged, &scale, &parameters);
    warnings.extend(counts::named(recordings));
    warnings.extend(rotation::unmodelled(recordings));
    warnings.extend(of_prior(input, prior.as_ref()));
    let (posterior, density) = posterior(input, fit.as_ref(), &mut warnings).unzip();
    if posterior.is_some() && input.options.prior.is_none() {
        warnings.extend(drawn_all_the_same(&parameters));
    }
    let of_seal = fit.as_ref().map_or(3, ElementFit::seal_numbers);
    let of_profile = position_profile.as_ref().map_or(0, |t| t.free_parameters());
    Ok(Identification {
        free_motion: FreeMotion::of(recordings, segments, model.half_width),
        model,
        stages,
        two_step: two.candidate.clone(),
        parameters,
        two_step_parameters,
        steady: two.steady.clone(),
        deformation: two.deformation.clone(),
        fit: fit.map(summary),
        covariance,
        deviations,
        prior,
        posterior,
        density,
        friction_scale: scale,
        phases: judged.phases,
        stick_slip: judged.stick_slip,
        position_delay,
        position_profile,
        no_position_profile,
        rotation: None,
        free_parameters: of_seal + of_profile,
        residual_rms: judged.residual_rms,
        warnings,
    })
}

/// What the recordings added to the prior; `None` without a prior or a fit.
fn prior_use(input: &Input, fit: Option<&ElementFit>) -> Option<PriorUse> {
    let (prior, fit) = (input.options.prior.as_ref()?, fit?);
    Some(prior.used(&fit.fitted, &fit.training.prior))
}

/// What the recordings did not add to the prior, and where they contradict it.
fn of_prior(input: &Input, used: Option<&PriorUse>) -> Vec<Warning> {
    if input.options.prior.is_none() {
        return Vec::new();
    }
    let words = match used {
        Some(used) => Warning::remark("prior", used.in_words()),
        None => {
            let message = "the prior was not used: fewer than 2 strokes, or its element does not run along them";
            Warning::doubt("prior", message.to_owned())
        }
    };
    let contradiction = used.and_then(|used| used.contradiction.as_ref());
    let doubt = contradiction.map(|c| Warning::doubt(c.parameter, c.in_words()));
    std::iter::once(words).chain(doubt).collect()
}

/// The draws that were asked for; adds what they say to `warnings`.
fn posterior(
    input: &Input,
    fit: Option<&ElementFit>,
    warnings: &mut Vec<Warning>,
) -> Option<(Posterior, Density)> {
    let count = input.options.posterior?;
    let speeds = element::speeds(input);
    let found = fit.and_then(|fit| Posterior::of(fit, speeds, count, input.options.seed));
    match &found {
        Some((posterior, _)) => warnings.extend(posterior.warnings()),
        None => {
            let message =
                "no draws: they need the fit of the element to all motion, and there is none";
            warnings.push(Warning::doubt("posterior", message.to_owned()));
        }
    }
    found
}

/// Parameters that the recordings do not determine although their draws are narrow: what the
/// structure of the model says about them is in the likelihood, too.
fn drawn_all_the_same(parameters: &[Parameter]) -> Option<Warning> {
    let open = parameters.iter().filter(|p| !p.estimate.determined && !p.is_coefficient());
    let names: Vec<String> = open.map(|p| p.id.to_string()).collect();
    let message = format!(
        "the draws of {} follow from the priors and from the structure of the model, since the recordings do not determine them",
        names.join(", ")
    );
    (!names.is_empty()).then(|| Warning::remark("posterior", message))
}

/// The parameters of the fit; those that the data do not determine have no interval.
fn fitted_parameters(
    fit: &ElementFit,
    judged: &Adequacy,
    scale: &FrictionScale,
    prior: Option<&PriorUse>,
) -> Vec<Parameter> {
    let mut all = numbers::parameters(&fit.fitted, &fit.joins);
    let (layout, rivals) = (fit.fitted.best.layout, rivals(fit));
    all.extend(fit.left.damping.clone().map(|most| Parameter::new(Quantity::SealDamping, most)));
    for p in &mut all {
        let why =
            judged.undetermined.iter().find(|(group, _)| group.holds(p.id)).map(|(_, why)| why);
        let uninformed = prior.map(PriorUse::uninformed).unwrap_or_default();
        if uninformed.contains(&p.id.to_string().as_str()) {
            let note = "as in the prior: the recordings contain almost no information about it";
            p.estimate = p.estimate.clone().with_note(note);
        }
        if let (Some(_), false) =
            (prior.and_then(|p| p.contradiction.as_ref()), is_of_rig(p.id.quantity))
        {
            let why = "the strokes contradict the prior";
            p.estimate = Estimate::undetermined(p.estimate.value, p.estimate.unit, why);
        }
        // What a prior knows is determined.
        if let (Some(why), true, None) = (why, p.estimate.determined, prior) {
            p.estimate = Estimate::undetermined(p.estimate.value, p.estimate.unit, why.clone());
        }
        widen(p, scale);
        span_rivals(p, &fit.fitted.best.candidate, &rivals);
    }
    conditional(&mut all, layout.offset, layout.own_slopes);
    all
}

/// After a large change of friction its forces have no single value: the interval covers all of
/// them.
fn widen(p: &mut Parameter, scale: &FrictionScale) {
    if scale.jumps.is_empty() && scale.drift < TOO_FAR {
        return;
    }
    let counted = || scale.strokes.iter().filter(|s| s.counted).map(|s| s.scale);
    let (low, high) = counted().fold((1.0f64, 1.0f64), |(l, h), u| (l.min(u), h.max(u)));
    let is_sum = p.id.quantity == Quantity::CoulombForceWithOffset;
    if Group::Sliding.holds(p.id) && !is_sum && p.estimate.determined {
        let value = p.estimate.value;
        p.estimate.ci95 = [
            p.estimate.ci95[0] + (low - 1.0) * value.abs(),
            p.estimate.ci95[1] + (high - 1.0) * value.abs(),
        ];
        p.estimate.standard_error = None;
        p.estimate.note = Some(
            "friction changed during the recordings: the interval holds all values that it had"
                .to_owned(),
        );
    }
}

/// The candidate with each term that is significant but too small to be taken.
fn rivals(fit: &ElementFit) -> Vec<Candidate> {
    let best = &fit.fitted.best;
    let moved = |shift: &Vec<f64>| {
        let mut values: Vec<f64> = best.free().iter().map(|free| free.value).collect();
        // The numbers of the drift come last, and are no longer the same.
        let own = shift.iter().take(values.len() - best.drift.len());
        values.iter_mut().zip(own).for_each(|(value, more)| *value += more);
        best.with_any(&values).candidate
    };
    fit.trials
        .iter()
        .map(|trial| &trial.shift)
        .filter(|shift| !shift.is_empty())
        .map(moved)
        .collect()
}

/// One of the `rivals` may be true: the interval holds their values, too.
fn span_rivals(p: &mut Parameter, best: &Candidate, rivals: &[Candidate]) {
    for apart in rivals.iter().map(|rival| rival.value(p.id) - best.value(p.id)) {
        if p.estimate.determined && apart.is_finite() {
            let [low, high] = p.estimate.ci95;
            let least = p.id.declaration().range.least().min(low);
            p.estimate.ci95 = [(low + apart.min(0.0)).max(least), high + apart.max(0.0)];
        }
    }
}

/// The sensor offset cannot be separated from a difference of the sliding forces.
fn conditional(all: &mut [Parameter], is_free: bool, own_slopes: bool) {
    for p in all.iter_mut().filter(|p| p.id == Quantity::Offset.id() && is_free) {
        p.estimate = match own_slopes {
            true => Estimate::undetermined(
                p.estimate.value,
                "N",
                "the directions slide differently, so an offset cannot be distinguished from a difference of their Coulomb forces: give the \
                 sensor's reading without load (‹offset_n›)",
            ),
            false => p.estimate.clone().with_note("if both directions have the same Coulomb force"),
        };
    }
}

fn warnings(
    input: &Input,
    model: &Candidate,
    fit: Option<&ElementFit>,
    judged: &Adequacy,
    scale: &FrictionScale,
    parameters: &[Parameter],
) -> Vec<Warning> {
    let mut all = Vec::new();
    for recording in input.recordings {
        let lost = recording.quality.warnings.iter();
        all.extend(lost.map(|w| Warning::doubt(recording, w.message.clone())));
    }
    // One line for all coefficients of a polynomial.
    let undetermined = parameters.iter().filter(|p| !p.estimate.determined && !p.is_coefficient());
    all.extend(undetermined.map(Warning::undetermined));
    all.extend(judged.doubts.iter().cloned());
    if let Some(message) = scale.in_words(&adequacy::names(input.recordings)) {
        let changed = !scale.jumps.is_empty() || scale.drift > TOO_FAR;
        all.push(Warning { doubtful: changed, ..Warning::remark("friction", message) });
    }
    match fit {
        None => all.extend(fallback(input, model)),
        Some(fit) => {
            if !fit.fitted.best.layout.shape {
                all.push(unresolved(model));
            }
            all.extend(not_tried(input, model));
            all.extend(left_unexplained(input, fit));
            all.extend(of_fit(fit));
        }
    }
    for (recording, segments) in input.recordings.iter().zip(input.segments) {
        if along::turn_at_same_places(segments, recording)
            && fit.is_some_and(|_| input.options.along)
        {
            let message = "all strokes turn at the same places: a dependence on the position cannot be distinguished \
                           from one on the deflection within 2c of the turning points";
            all.push(Warning::remark(recording, message.to_owned()));
        }
    }
    if model.loads[Load::Mass] > 0.0 {
        all.push(of_mass(input, model));
    }
    let beside = Load::RECORDED.into_iter().filter(|load| model.loads[*load] != 0.0);
    all.extend(beside.map(|load| {
        let words = of_load(load).words;
        let message = format!(
            "{words} is in the readings: validation takes it out where it was recorded, too; the model is the seal alone"
        );
        Warning::remark(of_load(load).id[0].quantity, message)
    }));
    all
}

/// The mass found in the readings. Where its inertia exceeds the friction, errors of the
/// acceleration that are too small to be seen are large for the seal.
fn of_mass(input: &Input, model: &Candidate) -> Warning {
    let mass = model.loads[Load::Mass];
    let friction = model.insertion.coulomb_force.min(model.withdrawal.coulomb_force);
    if mass > HEAVIEST_UNMODELLED_MASS {
        let message = format!(
            "the readings follow the acceleration, as from an unmodelled mass of {mass:.0} kg, expected at most {HEAVIEST_UNMODELLED_MASS} kg: \
             times, positions or forces are probably in another unit"
        );
        return Warning::doubt(Quantity::UnmodelledMass, message);
    }
    let inertia = mass * input.accelerations.iter().map(|a| reached(a)).fold(0.0, f64::max);
    if inertia > friction {
        let message = format!(
            "the readings follow the acceleration, as from an unmodelled mass of {mass:.3} kg between sensor and seal, \
             whose inertia of {inertia:.2} N exceeds the Coulomb force of {friction:.2} N: all numbers may be off; \
             declare the mass with ‹moving_mass_kg›, or reverse with less acceleration"
        );
        return Warning::doubt(Quantity::UnmodelledMass, message);
    }
    let message = format!(
        "the readings follow the acceleration, as from an unmodelled mass of {mass:.3} kg between sensor and seal; if \
         there is one, declare it with ‹moving_mass_kg›"
    );
    Warning::advice(Quantity::UnmodelledMass, message)
}

/// Magnitude that one of a hundred values reaches.
fn reached(values: &[f64]) -> f64 {
    let mut all: Vec<f64> = values.iter().map(|value| value.abs()).collect();
    let at = all.len().saturating_sub(1) * 99 / 100;
    *all.select_nth_unstable_by(at, f64::total_cmp).1
}

/// Optional terms that the recordings cannot show.
fn not_tried(input: &Input, model: &Candidate) -> Vec<Warning> {
    let mut all = Vec::new();
    if input.options.free_motion && !element::has_partial_reversals(input, model.half_width) {
        all.push(
            "not tried (fewer than 4 partial reversals): minor-loop stiffness, second relaxation time, second stage",
        );
    }
    if !input.recordings.iter().all(Recording::resolves_reversals) {
        all.push(
            "not tried (the sampling is too coarse to resolve the acceleration at a reversal): unmodelled mass, delay \
             of the positions",
        );
    }
    all.into_iter().map(|message| Warning::remark("optional terms", message.to_owned())).collect()
}

/// Without a fit the model is the result of the two steps.
fn fallback(input: &Input, model: &Candidate) -> Vec<Warning> {
    let mut all = Vec::new();
    if input.two.is_assumed {
        all.push(unresolved(model));
    }
    if !input.options.paper {
        let message = "fewer than 4 cycles, or an axis without a seal: the numbers are those of the paper's two steps; record more strokes";
        all.push(Warning::advice("fit", message.to_owned()));
    }
    all
}

fn unresolved(model: &Candidate) -> Warning {
    let message = format!(
        "the deformation of the seal is not resolved; the model holds a straight spring of half width {:.3} mm in its place",
        1e3 * model.half_width
    );
    Warning::doubt(Quantity::HalfWidth, message)
}

/// Least remaining delay that counts, as a fraction of the sampling interval, and largest step of
/// the readings that does not count, as a fraction of the sliding force.
const LATE: f64 = 0.5;
const FINE: f64 = 0.05;

/// Effects in the readings that the model does not include.
fn left_unexplained(input: &Input, fit: &ElementFit) -> Vec<Warning> {
    let Input { recordings, options, .. } = input;
    let mut all = Vec::new();
    let interval = recordings.iter().map(|r| r.quality.median_interval).fold(0.0, f64::max);
    if let Some(lag) = fit.left.lag.filter(|lag| lag.is_clear() && lag.delay_s > LATE * interval) {
        let message = format!(
            "a position delay of {:.1} ms (standard error {:.1} ms) remains after the correction: all numbers may be off; \
              read positions and forces on one clock, or shift the positions before identifying",
            1e3 * lag.delay_s,
            1e3 * lag.standard_error_s
        );
        all.push(Warning::doubt("delay", message));
    }
    let is_coarse =
        !options.inertia_removed && !recordings.iter().all(Recording::resolves_reversals);
    if let Some(mass) = fit.left.mass.filter(|_| is_coarse) {
        let message = format!(
            "the readings follow the acceleration, as from an unmodelled mass of some {mass:.2} kg, and the sampling is too coarse to subtract \
             it: declare it with ‹moving_mass_kg›, or record at 200 Hz or faster"
        );
        all.push(Warning::doubt(Quantity::UnmodelledMass, message));
    }
    let force = fit.fitted.best.candidate.insertion.coulomb_force;
    for recording in *recordings {
        let step = recording.quality.force_resolution;
        if step > FINE * force && step > recording.quality.force_noise {
            let message = format!(
                "the force comes in steps of {step} N, {:.0} % of the sliding force: rounding that repeats with the motion is not in the \
                 intervals; use a finer range of the sensor",
                1e2 * step / force
            );
            all.push(Warning::doubt(recording, message));
        }
    }
    all
}

fn of_fit(fit: &ElementFit) -> Vec<Warning> {
    let mut all = Vec::new();
    let remaining = element::remaining(&fit.fitted);
    if remaining > FAR {
        let message = format!(
            "the fit did not converge in {} iterations: its numbers are some {remaining:.1} standard errors from the least squares; look \
             for what the model does not have in the residuals of the report",
            fit.fitted.iterations,
        );
        all.push(Warning::doubt("fit", message));
    }
    for trial in fit.trials.iter().filter(|t| !t.kept && t.p_value < 0.05) {
        let why = trial.why_not.unwrap_or("needed: 1 % over all terms tried");
        let message = format!(
            "left out: the squared error would fall by {:.2} %, p = {:.1e} ({why})",
            1e2 * trial.gain,
            trial.p_value
        );
        all.push(Warning::remark(trial.term.words(), message));
    }
    if !fit.trials.iter().any(|t| t.term == Term::MinorLoops && t.kept) {
        let message = "the minor-loop stiffness is the default (1.01 times the steepest change of the gap between the branches)";
        all.push(Warning::remark(Quantity::YieldStiffness, message.to_owned()));
    }
    all
}
