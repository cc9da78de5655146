//! The two steps of the paper: steady state, then deformation (EMS section IV).
//!
//! They need constant-speed strokes that slide fully. Their element is the start of the likelihood
//! fit, and a result of its own (`--paper`).

use rayon::prelude::*;
use trocar_model::{ParameterId, Quantity, Relaxation, SlidingFriction};

use super::candidate::Candidate;
use super::deformation::{
    self, DampingTest, DeformationFit, Limits, Sensors, curves_of, mean_points,
};
use super::estimate::Estimate;
use super::findings::{IdentifyError, Parameter};
use super::numbers::branch_ids;
use super::options::IdentifyOptions;
use super::shape::BranchShape;
use super::steady::{self, DirectionLine, SteadyFit, StrokeMean};
use super::stribeck;
use trocar_recording::Recording;
use trocar_recording::cancel;
use trocar_recording::loads::Loads;
use trocar_simulate::segment::{Direction, Segments, SteadySegment, after_start, latter_half};

/// Result of the two steps.
pub(super) struct TwoSteps {
    pub(super) steady: SteadyFit,
    pub(super) deformation: Result<DeformationFit, String>,
    pub(super) candidate: Candidate,
    /// The deformation was not resolved: that of the candidate is assumed.
    pub(super) is_assumed: bool,
}

/// Both steps.
///
/// # Errors
/// [`IdentifyError::ForceSign`].
pub(super) fn two_steps(
    recordings: &[Recording],
    segments: &[Segments],
    options: &IdentifyOptions,
) -> Result<TwoSteps, IdentifyError> {
    let (steady, deformation) = alternately(recordings, segments, options)?;
    let (candidate, is_assumed) = candidate_of(&steady, &deformation, recordings);
    Ok(TwoSteps { steady, deformation, candidate, is_assumed })
}

/// Steady state and deformation, each with the result of the other: the point at which sliding has
/// settled depends on the deformation, and the switching force (12) on the sliding force.
fn alternately(
    recordings: &[Recording],
    segments: &[Segments],
    options: &IdentifyOptions,
) -> Result<(SteadyFit, Result<DeformationFit, String>), IdentifyError> {
    let means = |settled: &dyn Fn(f64) -> f64, second_half: bool| -> Vec<StrokeMean> {
        let of = |(i, (r, s)): (usize, (&Recording, &Segments))| {
            let whole = s.steady_segments.iter();
            let parts: Vec<SteadySegment> =
                whole.map(|own| if second_half { latter_half(r, own) } else { *own }).collect();
            steady::stroke_means(i, r, &s.strokes, &parts, settled)
        };
        recordings.iter().zip(segments).enumerate().flat_map(of).collect()
    };
    let deform = |steady: &SteadyFit| {
        let sensors = sensors(recordings);
        let between = |limits: Limits| {
            let found = recordings.iter().zip(segments).enumerate();
            let of = |(i, (r, s)): (usize, (&Recording, &Segments))| {
                let levels = stroke_levels(i, s, steady);
                deformation::full_reversals(i, r, &s.strokes, &limits, |stroke| levels[stroke])
            };
            deformation::fit(found.flat_map(of).collect(), &limits, options.degrees, sensors)
        };
        let limits = limits(steady, sensors.force_noise);
        // Where the friction falls with speed, the sliding force never returns to that at rest.
        between(limits).or_else(|why| between(limits.reached_by(steady)).map_err(|_| why))
    };
    let mut steady = steady::fit(steady::imposed(means(&|_| 0.0, true)));
    let mut deformation = deform(&steady);
    for _ in 0..2 {
        let Ok(found) = &deformation else { break };
        let settled = steady::imposed(means(&|v| settled_travel(&steady, found, v), false));
        if settled.len() < 2 {
            break;
        }
        steady = steady::fit(settled);
        deformation = deform(&steady);
    }
    let longest = recordings.iter().map(|r| r.quality.stroke).fold(0.0, f64::max);
    let negligible =
        deformation.as_ref().map_or(true, |found| 2.0 * found.half_width.value < 0.01 * longest);
    if negligible && options.inertia_removed {
        steady = steady::fit(with_transients(steady.means, recordings, segments));
    } else if deformation.is_err() {
        steady = steady::fit(without_trend(means(&|_| 0.0, false), recordings, segments));
    }
    if steady.means.is_empty() {
        let why = "nothing slides steadily after a reversal".to_owned();
        return Ok((steady::from_levels(recordings)?, Err(why)));
    }
    if steady.coulomb_force_n.ci95[1] <= 0.0 {
        return Err(IdentifyError::force_sign(steady.coulomb_force_n.value, recordings));
    }
    stribeck::test(&mut steady, options.seed);
    if steady.stribeck.is_some() && deformation.is_ok() {
        deformation = deform(&steady);
    }
    Ok((steady, deformation))
}

/// Friction scale of each stroke: sliding force relative to the fitted line; 1 for a stroke without
/// a mean of its own.
fn stroke_levels(index: usize, segments: &Segments, steady: &SteadyFit) -> Vec<f64> {
    let mut levels = vec![1.0; segments.strokes.len()];
    for mean in steady.means.iter().filter(|m| m.recording == index) {
        let fitted = steady.line(mean.velocity_m_s) - steady.offset_n.value;
        let level = (mean.force_n - steady.offset_n.value) / fitted;
        let stroke = segments.strokes.partition_point(|p| p.end <= mean.sample);
        // A mean far from the line is not a small variation of the friction scale.
        if stroke < levels.len() && (level - 1.0).abs() < 0.2 {
            levels[stroke] = level;
        }
    }
    levels
}

/// The coarsest sensors among the recordings'.
fn sensors(recordings: &[Recording]) -> Sensors {
    let coarsest = |of: fn(&Recording) -> f64| recordings.iter().map(of).fold(0.0, f64::max);
    Sensors {
        position_step: coarsest(|r| r.quality.position_resolution),
        force_noise: coarsest(|r| r.quality.force_noise),
    }
}

/// Travel, m, after a reversal beyond which sliding at `speed`, m/s, has settled: the deformation
/// and five time constants β/K.
fn settled_travel(steady: &SteadyFit, found: &DeformationFit, speed: f64) -> f64 {
    let stiffness = deformation::end_stiffness(
        &found.insertion_branch,
        &found.withdrawal_branch,
        found.half_width.value,
    );
    let time_constant = steady.viscous_damping_n_s_m.value.max(0.0) / stiffness;
    2.2 * found.half_width.value + 5.0 * time_constant * speed
}

/// The part of each segment in which the sliding has settled.
pub(super) fn settled_segments(
    recording: &Recording,
    segments: &Segments,
    steady: &SteadyFit,
    found: &DeformationFit,
) -> Vec<SteadySegment> {
    after_start(recording, &segments.strokes, &segments.steady_segments, |speed| {
        settled_travel(steady, found, speed)
    })
}

/// Blocks of all motion instead of the plateau means, down to a fiftieth of the fastest plateau.
fn with_transients(
    plateaus: Vec<StrokeMean>,
    recordings: &[Recording],
    segments: &[Segments],
) -> Vec<StrokeMean> {
    const BLOCK: f64 = 0.1;
    let fastest = plateaus.iter().map(|m| m.velocity_m_s.abs()).fold(0.0, f64::max);
    if fastest == 0.0 {
        return plateaus;
    }
    let found = recordings.iter().zip(segments).enumerate();
    found
        .flat_map(|(i, (r, s))| steady::moving_means(i, r, &s.strokes, 0.02 * fastest, BLOCK))
        .collect()
}

/// Drops means of segments over which the force still rises from one limit to the other, which is
/// not sliding.
fn without_trend(
    means: Vec<StrokeMean>,
    recordings: &[Recording],
    segments: &[Segments],
) -> Vec<StrokeMean> {
    let steady = |mean: &StrokeMean| {
        let recording = &recordings[mean.recording];
        let mut sorted = recording.force.clone();
        sorted.sort_by(f64::total_cmp);
        let swing = sorted[sorted.len() * 19 / 20] - sorted[sorted.len() / 20];
        let own =
            segments[mean.recording].steady_segments.iter().filter(|s| s.plateau == mean.plateau);
        let quarter = |s: &SteadySegment| ((s.end - s.start) / 4).max(1);
        let level = |from: usize, to: usize| {
            recording.force[from..to].iter().sum::<f64>() / (to - from) as f64
        };
        own.map(|s| (level(s.end - quarter(s), s.end) - level(s.start, s.start + quarter(s))).abs())
            .all(|trend| trend < 0.4 * swing)
    };
    let keep: Vec<bool> = means.iter().map(steady).collect();
    means.into_iter().zip(keep).filter_map(|(m, k)| k.then_some(m)).collect()
}

/// Sliding friction of both directions and the sensor offset, from the steady state.
///
/// With different slopes the offset is chosen so that both Coulomb forces are equal: the data
/// cannot separate the two.
fn sliding(steady: &SteadyFit) -> (f64, SlidingFriction, SlidingFriction) {
    let least = 1e-6;
    let own_slopes = steady.is_asymmetric() && steady.stribeck.is_none();
    if let (true, Some(plus), Some(minus)) = (own_slopes, &steady.insertion, &steady.withdrawal) {
        let coulomb = 0.5 * (plus.coulomb_force_n.value + minus.coulomb_force_n.value);
        let offset = 0.5 * (plus.coulomb_force_n.value - minus.coulomb_force_n.value);
        let friction = |line: &DirectionLine| {
            SlidingFriction::coulomb(coulomb.max(least), line.viscous_damping_n_s_m.value.max(0.0))
        };
        return (offset, friction(plus), friction(minus));
    }
    let mut friction = SlidingFriction::coulomb(
        steady.coulomb_force_n.value.max(least),
        steady.viscous_damping_n_s_m.value.max(0.0),
    );
    if let Some(stribeck) = &steady.stribeck {
        friction.static_force = stribeck.static_force_n.value.max(friction.coulomb_force);
        friction.stribeck_velocity = stribeck.stribeck_velocity_m_s.value;
        friction.stribeck_exponent = stribeck.stribeck_exponent;
    }
    (steady.offset_n.value, friction, friction)
}

/// Forces at which the seal switches (12).
///
/// Where a single speed leaves the force at rest undetermined, the lower edge of the sliding force
/// is used: its mean less twice the ripple (scatter within and between strokes beyond the sensor
/// noise).
fn limits(steady: &SteadyFit, noise: f64) -> Limits {
    let (offset, insertion, withdrawal) = sliding(steady);
    let scatters = steady.means.iter().map(|m| (m.scatter_n.powi(2) - noise * noise).max(0.0));
    let ripple = (scatters.sum::<f64>() / steady.means.len().max(1) as f64).sqrt();
    let fluctuation = 2.0 * ripple.hypot(steady.stroke_mean_scatter_n);
    Limits {
        offset,
        insertion: insertion.static_force,
        withdrawal: withdrawal.static_force,
        margin: if steady.viscous_damping_n_s_m.determined { 0.0 } else { fluctuation },
        fluctuation,
    }
}

/// Two-step candidate; if the deformation is not resolved, a stiff straight spring replaces it
/// (second value true).
fn candidate_of(
    steady: &SteadyFit,
    deformation: &Result<DeformationFit, String>,
    recordings: &[Recording],
) -> (Candidate, bool) {
    let (offset, insertion, withdrawal) = sliding(steady);
    let (half_width, [insertion_branch, withdrawal_branch], seal_damping) = match deformation {
        Ok(found) => {
            let branches = [&found.insertion_branch, &found.withdrawal_branch];
            let kept = found.damping.as_ref().filter(|d| d.kept);
            let damping = kept.map_or(0.0, |d| d.seal_damping_n_s_m.value);
            (found.half_width.value, branches.map(|own| own.shape.clone()), damping)
        }
        Err(_) => {
            let join_force = 0.5 * (insertion.static_force - withdrawal.static_force);
            let straight = BranchShape { join_force, ..BranchShape::straight([2, 2]) };
            let half_width = (20.0 * sensors(recordings).position_step).max(5e-5);
            (half_width, [straight.clone(), straight], 0.0)
        }
    };
    let candidate = Candidate {
        offset,
        loads: Loads::default(),
        insertion,
        withdrawal,
        half_width,
        insertion_branch,
        withdrawal_branch,
        seal_damping,
        yield_ratio: Candidate::DEFAULT_YIELD_RATIO,
        creep_velocity: 0.0,
        friction_lag: 0.0,
        dwell_force: 0.0,
        relaxation: Relaxation::NONE,
        second: None,
    };
    (candidate, deformation.is_err())
}

pub(super) fn parameters(two: &TwoSteps, options: &IdentifyOptions) -> Vec<Parameter> {
    let steady = &two.steady;
    let mut all = vec![
        Parameter::new(Quantity::CoulombForce, steady.coulomb_force_n.clone()),
        Parameter::new(Quantity::ViscousDamping, steady.viscous_damping_n_s_m.clone()),
        Parameter::new(Quantity::Offset, steady.offset_n.clone()),
    ];
    // Lines of both directions, through the readings including the offset.
    for (direction, line) in
        Direction::BOTH.into_iter().zip([&steady.insertion, &steady.withdrawal])
    {
        let Some(DirectionLine { coulomb_force_n, viscous_damping_n_s_m }) = line else { continue };
        let level = Quantity::CoulombForceWithOffset.of(direction);
        all.push(Parameter::new(level, coulomb_force_n.clone()));
        let slope = Quantity::ViscousDamping.of(direction);
        all.push(Parameter::new(slope, viscous_damping_n_s_m.clone()));
    }
    if let Some(s) = &steady.stribeck {
        all.push(Parameter::new(Quantity::StaticForce, s.static_force_n.clone()));
        all.push(Parameter::new(Quantity::StribeckVelocity, s.stribeck_velocity_m_s.clone()));
    }
    match &two.deformation {
        Ok(found) => {
            all.push(Parameter::new(Quantity::HalfWidth, found.half_width.clone()));
            if let Some(test) = &found.damping {
                all.push(Parameter::new(Quantity::SealDamping, tested_damping(test)));
            }
            let left_out = strokes_left_out(&two.candidate, found, options.degrees);
            all.extend(branch_parameters(&two.candidate, &left_out));
        }
        Err(why) => {
            let none = Estimate::undetermined(two.candidate.half_width, "m", why.clone());
            all.push(Parameter::new(Quantity::HalfWidth, none));
        }
    }
    all
}

/// The candidate with branches refitted without one full reversal of each direction at a time.
fn strokes_left_out(
    best: &Candidate,
    found: &DeformationFit,
    degrees: [usize; 2],
) -> Vec<Candidate> {
    let end_forces = best.end_forces();
    let [insertion, withdrawal] = Direction::BOTH.map(|d| curves_of(&found.full_reversals, d));
    let refit = |branch: &BranchShape, curves: &[&[f64]], left_out: usize| {
        let points = mean_points(&without(curves, left_out));
        BranchShape::fit(degrees, end_forces, &points)
            .map_or_else(|| branch.clone(), |(branch, _)| branch)
    };
    let left_out = |k: usize| {
        cancel::check();
        Candidate {
            insertion_branch: refit(&best.insertion_branch, &insertion, k),
            withdrawal_branch: refit(&best.withdrawal_branch, &withdrawal, k),
            ..best.clone()
        }
    };
    (0..insertion.len().min(withdrawal.len())).into_par_iter().map(left_out).collect()
}

/// The curves but one; a single one stays.
fn without<'a>(curves: &[&'a [f64]], left_out: usize) -> Vec<&'a [f64]> {
    let mut kept = curves.to_vec();
    if kept.len() > 1 {
        kept.remove(left_out);
    }
    kept
}

/// A parameter of the best fit with the interval of the jackknife over fits with strokes left out.
fn jackknife(best: &Candidate, left_out: &[Candidate], id: ParameterId) -> Estimate {
    let (value, unit) = (best.value(id), id.unit().si);
    let values: Vec<f64> = left_out.iter().map(|candidate| candidate.value(id)).collect();
    if values.iter().all(|other| *other == value) {
        return Estimate::undetermined(value, unit, "the readings do not depend on it");
    }
    let g = values.len() as f64;
    let mean = values.iter().sum::<f64>() / g;
    let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    let error = ((g - 1.0) / g * squares).sqrt();
    Estimate::from_standard_error(value, error, g - 1.0, unit)
}

/// σ of the model: the value found by the test, or zero with the bound that the test could not
/// exclude.
pub(super) fn tested_damping(test: &DampingTest) -> Estimate {
    let found = &test.seal_damping_n_s_m;
    if test.kept || !found.determined {
        return found.clone();
    }
    let why = match test.p_value < 0.01 && found.value > 0.0 {
        true => format!(
            "its force of {:.2} N at most is no influence in practice",
            test.largest_force_n
        ),
        false => format!("p = {:.2}", test.p_value),
    };
    Estimate::from_bounds(0.0, 0.0, found.ci95[1], found.unit)
        .with_note(format!("set to zero by the test: {:.3} N s/m found, {why}", found.value))
}

/// Join and coefficients of both branches; a join at the end of its range is not determined,
/// whatever the strokes left out give.
fn branch_parameters(best: &Candidate, left_out: &[Candidate]) -> Vec<Parameter> {
    let parameter = |id: ParameterId| {
        let (value, unit) = (best.value(id), id.unit().si);
        let is_at_bound = |direction| best.branch(direction).join_at_bound();
        let estimate = match id.quantity == Quantity::Join && id.direction.is_some_and(is_at_bound)
        {
            true => Estimate::undetermined(value, unit, "no best join inside the range searched"),
            false => jackknife(best, left_out, id),
        };
        Parameter::new(id, estimate)
    };
    branch_ids(best).into_iter().map(parameter).collect()
}
