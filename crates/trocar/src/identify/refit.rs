//! The EMS element fitted by the criterion of the classical models: plain least squares of its
//! free-run simulation.
//!
//! [`identify`](super::identify) gives each stroke a friction scale, in order to obtain valid
//! intervals. A comparison by squared error asks for the best fit of a single element, which this
//! module computes.

use trocar_model::Stages;

use super::candidate::{Candidate, EmsTrial, Layout};
use super::classical::{ClassicalData, LONG, SHORT, doubts};
use super::element::straight;
use super::likelihood::{self, Fitted};
use super::numbers::{Quantity, parameter_or_held};
use super::spread::Spread;
use super::{Identification, Parameter, Warning};

/// Half widths to start from where no deformation was resolved, in units of the one assumed for the
/// scales.
const WIDTHS: [f64; 3] = [0.2, 0.5, 1.0];

/// An EMS element by plain least squares.
#[derive(Debug, Clone)]
pub struct EmsRefit {
    /// The parameters.
    pub model: Candidate,
    /// The model, ready to run.
    pub stages: Stages,
    /// Main parameters with intervals.
    pub parameters: Vec<Parameter>,
    /// Number of fitted parameters, without the sensor offset.
    pub free_parameters: usize,
    /// Warnings about the fit.
    pub warnings: Vec<Warning>,
}

/// Refits the element of an identification; uses polynomials of `degrees` where it has none to
/// start from.
///
/// # Errors
/// A message when no start gives a model that runs.
pub(crate) fn refit(data: &ClassicalData, found: &Identification, degrees: [usize; 2]) -> Result<EmsRefit, String> {
    let layout = Layout {
        own_slopes: found.model.insertion != found.model.withdrawal,
        stribeck: found.model.insertion.static_force > found.model.insertion.coulomb_force,
        damping: true,
        ..Layout::PAPER
    };
    let candidate = Candidate { unmodelled_mass: 0.0, ..found.model.clone() };
    let candidates = match &found.deformation {
        Ok(_) => vec![candidate],
        Err(_) => WIDTHS.map(|part| straight(&candidate, part * data.scales.half_width, degrees)).to_vec(),
    };
    let trials = candidates.into_iter().map(|candidate| EmsTrial::new(candidate, layout));
    let short = trials.filter_map(|trial| likelihood::fit(&data.training, &trial, SHORT));
    let best = short.min_by(|a, b| a.rms[1].total_cmp(&b.rms[1])).ok_or("no start gave a model that runs")?;
    let fitted = likelihood::fit(&data.training, &best.best, LONG).ok_or("the best start gave no model")?;
    let model = fitted.best.candidate.clone();
    let stages = model.stages().map_err(|error| error.to_string())?;
    let parameters = parameters(&fitted);
    let free_parameters = fitted.best.free_numbers() - 1;
    let warnings = doubts(&fitted, &parameters);
    Ok(EmsRefit { model, stages, parameters, free_parameters, warnings })
}

fn quantities(layout: Layout) -> Vec<Quantity> {
    const ANY: f64 = f64::NEG_INFINITY;
    let mut all: Vec<Quantity> = vec![
        ("offset_n", "N", ANY, false, |c| c.offset),
        ("coulomb_force_n", "N", 0.0, true, |c| c.insertion.coulomb_force),
        ("viscous_damping_n_s_m", "N s/m", 0.0, false, |c| c.insertion.viscous_damping),
        ("half_width_m", "m", 0.0, true, |c| c.half_width),
        ("seal_damping_n_s_m", "N s/m", 0.0, false, |c| c.seal_damping),
        ("rising_join_m", "m", ANY, false, |c| c.rising.join * c.half_width),
        ("falling_join_m", "m", ANY, false, |c| c.falling.join * c.half_width),
    ];
    if layout.stribeck {
        all.push(("static_force_n", "N", 0.0, true, |c| c.insertion.static_force));
        all.push(("stribeck_velocity_m_s", "m/s", 0.0, true, |c| c.insertion.stribeck_velocity));
    }
    if layout.own_slopes {
        all[2].0 = "insertion_viscous_damping_n_s_m";
        all.push(("withdrawal_viscous_damping_n_s_m", "N s/m", 0.0, false, |c| c.withdrawal.viscous_damping));
    }
    all
}

fn parameters(fitted: &Fitted<EmsTrial>) -> Vec<Parameter> {
    let spread = Spread::new(fitted);
    quantities(fitted.best.layout).into_iter().map(|q| parameter_or_held(fitted, &spread, q, 1.0)).collect()
}
