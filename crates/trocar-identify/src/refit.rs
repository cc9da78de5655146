//! The EMS element fitted by the criterion of the classical models: plain least squares of its
//! free-run simulation.
//!
//! [`identify`](super::identify) gives each stroke a friction scale, in order to obtain valid
//! intervals. A comparison by squared error asks for the best fit of a single element, which this
//! module computes.

use trocar_model::{Direction, Quantity, Stages};

use super::candidate::{Candidate, EmsTrial, Layout};
use super::classical::{ClassicalData, LONG, SHORT, doubts};
use super::element::straight;
use super::findings::{Parameter, Warning};
use super::likelihood::{self, Fitted};
use super::numbers::{parameter_or_held, quantities};
use super::result::Identification;
use super::spread::Spread;
use trocar_recording::loads::Loads;

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
pub fn refit(
    data: &ClassicalData,
    found: &Identification,
    degrees: [usize; 2],
) -> Result<EmsRefit, String> {
    let layout = Layout {
        own_slopes: found.model.insertion != found.model.withdrawal,
        stribeck: found.model.insertion.static_force > found.model.insertion.coulomb_force,
        damping: true,
        ..Layout::paper()
    };
    let candidate = Candidate { loads: Loads::default(), ..found.model.clone() };
    let candidates = match &found.deformation {
        Ok(_) => vec![candidate],
        Err(_) => {
            WIDTHS.map(|part| straight(&candidate, part * data.scales.half_width, degrees)).to_vec()
        }
    };
    let trials = candidates.into_iter().map(|candidate| EmsTrial::new(candidate, layout));
    let short = trials.filter_map(|trial| likelihood::fit(&data.training, &trial, SHORT));
    let best = short
        .min_by(|a, b| a.rms[1].total_cmp(&b.rms[1]))
        .ok_or("no initial values gave a model that runs")?;
    let fitted = likelihood::fit(&data.training, &best.best, LONG)
        .ok_or("the best initial values gave no valid model")?;
    let model = fitted.best.candidate.clone();
    let stages = model.stages().map_err(|error| error.to_string())?;
    let parameters = parameters(&fitted);
    let free_parameters = fitted.best.free_numbers() - 1;
    let warnings = doubts(&fitted, &parameters);
    Ok(EmsRefit { model, stages, parameters, free_parameters, warnings })
}

fn parameters(fitted: &Fitted<EmsTrial>) -> Vec<Parameter> {
    let spread = Spread::new(fitted);
    let joins = Direction::BOTH.map(|direction| (Quantity::Join.of(direction), false));
    let all = quantities(fitted.best.layout).into_iter().chain(joins);
    all.map(|q| parameter_or_held(fitted, &spread, q, 1.0)).collect()
}
