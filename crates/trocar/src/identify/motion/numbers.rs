//! The numbers of a fit to all motion, with intervals.

use trocar_model::SlidingFriction;

use super::super::candidate::{Candidate, EmsTrial, Layout};
use super::super::conclude::branch_quantities;
use super::super::output_error::Fitted;
use super::super::spread::{Reported, Spread};
use super::super::stage::SecondStage;
use super::super::{Estimate, Parameter};

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
        // With the sensor's offset, as the lines of the steady state: only the sum shows.
        all.push(("coulomb_force_n_positive", "N", ANY, false, |c| {
            c.stage_factor() * c.insertion.coulomb_force + c.offset
        }));
        all.push(("coulomb_force_n_negative", "N", ANY, false, |c| {
            c.stage_factor() * c.withdrawal.coulomb_force - c.offset
        }));
        all.push(("viscous_damping_n_s_m_positive", "N s/m", 0.0, false, |c| {
            c.stage_factor() * c.insertion.viscous_damping
        }));
        all.push(("viscous_damping_n_s_m_negative", "N s/m", 0.0, false, |c| {
            c.stage_factor() * c.withdrawal.viscous_damping
        }));
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

/// A lag of a sample or two is none that the samples could tell.
fn shortest_lag(found: &Estimate) -> Estimate {
    const SHORTEST: f64 = 2e-3;
    if found.value > SHORTEST {
        return found.clone();
    }
    let longest = if found.pinned { found.ci95[1].max(SHORTEST) } else { SHORTEST };
    Estimate::from_bounds(found.value, 0.0, longest, found.unit).with_note("too short to tell from none")
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
    all.iter_mut().filter(|p| p.name == "friction_lag_s").for_each(|p| p.estimate = shortest_lag(&p.estimate));
    for quantity in branch_quantities(best) {
        let how = Reported { unit: quantity.unit, log: false, scale: f64::INFINITY, least: f64::NEG_INFINITY };
        let estimate = spread.estimate(how, &|t| (quantity.of)(&t.candidate));
        all.push(Parameter { name: quantity.name, estimate });
    }
    all
}
