//! Figures of an identification, each as in the paper's section IV, drawn from the user's own data.
//!
//! If its data are missing, a figure is replaced by a sentence with the reason.

pub(super) mod comparison;
mod deformation;
pub(super) mod fleet;
mod half_width;
mod live;
mod motion;
#[cfg(feature = "bench")]
pub(super) mod plan;
mod reversal;
mod sliding;
mod speeds;
mod tables;
#[cfg(feature = "bench")]
pub(super) mod teleop;
mod validation;

use trocar_model::Unit;

use super::decimate;
use super::document::{Axis, Figure, Panel, Role, Series};
use super::number::{decimals_for, fixed, significant};
use trocar_identify::{DeformationFit, Estimate, Identification};
use trocar_recording::Recording;

pub(super) use deformation::{deformation_force, deformation_velocity};
pub(super) use half_width::half_width;
pub(super) use live::{live_model, row_of};
pub(super) use motion::{friction_scale, in_words as fit_in_words, small_motion, terms};
pub(super) use reversal::velocity_step;
pub(super) use sliding::static_friction;
pub(super) use speeds::{error_by_phase, error_by_recording, error_by_speed};
pub(super) use tables::{
    PAPER, branch_coefficients, hashes, name_of, names, parameters, resolution, sampling,
    subject_in_words,
};
pub(super) use validation::{
    Scored, cross_validation, cycle_speeds, residual_statistics, residuals, scored,
};

/// Most deflections or speeds of one figure.
pub(crate) const MOST_CHOSEN: usize = 6;

/// A figure, or the reason why there is none.
pub(super) type Drawn = Result<Figure, String>;

/// Most points per line.
const MOST_POINTS: usize = 1_500;

/// Millimetres in a metre; also mm/s in m/s.
pub(super) const MM: f64 = 1e3;

/// Name of the model's curves next to those of the two steps; `None` if the model is the result of
/// the two steps.
fn model_name(found: &Identification) -> Option<&'static str> {
    found.fit.as_ref().map(|_| "model")
}

/// Whether the model has elements in parallel.
fn has_stages(found: &Identification) -> bool {
    found.stages.elements().len() > 1
}

/// Label of the readings, which says whether inertia is subtracted from them besides the sensor
/// offset.
pub(crate) fn measured(recording: &Recording) -> &'static str {
    match recording.quality.subtracted_mass > 0.0 {
        true => "measured, inertia subtracted",
        false => "measured",
    }
}

/// Points that draw the same line as all of them.
fn thinned(x: &[f64], y: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let (low, high) = limits(x);
    let kept = decimate::path(x, y, low, high, MOST_POINTS / 4, MOST_POINTS);
    (kept.iter().map(|&i| x[i]).collect(), kept.iter().map(|&i| y[i]).collect())
}

/// A line of no more points than can be told apart.
pub(super) fn line(name: &str, role: Role, x: &[f64], y: impl IntoIterator<Item = f64>) -> Series {
    let (x, y) = thinned(x, &y.into_iter().collect::<Vec<f64>>());
    Series::line(name, role, x, y)
}

/// Axes over time: what is drawn, and its unit.
pub(super) fn over_time(y: Axis) -> Panel {
    Panel::new(Axis::new("time", "s"), y)
}

/// The lowest and the highest of some values.
fn limits<'v>(values: impl IntoIterator<Item = &'v f64>) -> (f64, f64) {
    values
        .into_iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(*v), high.max(*v)))
}

/// The deformation of the paper's dynamic step, or why there is no figure of `what`.
fn deformation<'f>(found: &'f Identification, what: &str) -> Result<&'f DeformationFit, String> {
    found.deformation.as_ref().map_err(|why| {
        format!("There is no figure of {what}, because the paper's dynamic step resolves no deformation: {why}.")
    })
}

/// Starts of excerpts of `length` s between the times `begin` and `end`, `step` apart: the first one
/// in any case, and at most [`MOST_STARTS`], whatever the clock counts.
fn excerpt_starts([begin, end]: [f64; 2], length: f64, step: f64) -> impl Iterator<Item = f64> {
    let step = step.max((end - begin) / MOST_STARTS);
    let count = ((end - begin - length) / step).clamp(0.0, MOST_STARTS) as u32;
    (0..=count).map(move |k| begin + step * f64::from(k))
}

/// Most excerpts of a recording that are weighed against each other.
const MOST_STARTS: f64 = 5000.0;

/// `count` points from `low` to `high`, both included.
fn spaced(low: f64, high: f64, count: usize) -> impl Iterator<Item = f64> + Clone {
    (0..count).map(move |k| low + (high - low) * k as f64 / (count - 1) as f64)
}

/// "2.98 N, 95 % interval [2.95, 3.01]", in the displayed unit.
pub(super) fn in_words(estimate: &Estimate) -> String {
    let (value, interval) = value_and_interval(estimate);
    format!("{value}, {interval}")
}

/// Value with its unit, and the interval as a phrase.
pub(super) fn value_and_interval(estimate: &Estimate) -> (String, String) {
    let Unit { scale, shown: unit, .. } = tables::unit_of(estimate);
    let [low, high] = estimate.ci95.map(|end| scale * end);
    if low == high {
        return (format!("{} {unit}", significant(low, 4)), "given".to_owned());
    }
    match decimals_for(low, high) {
        Some(decimals) if estimate.determined => {
            let [value, low, high] =
                [scale * estimate.value, low, high].map(|number| fixed(number, decimals));
            (format!("{value} {unit}"), format!("95 % interval [{low}, {high}]"))
        }
        _ => (
            format!("{} {unit}", significant(scale * estimate.value, 3)),
            "not determined by the data".to_owned(),
        ),
    }
}

/// A p value in words: "p = 0.03", "p < 0.0001".
fn p_in_words(p: f64) -> String {
    if p < 1e-4 { "p < 0.0001".to_owned() } else { format!("p = {}", significant(p, 2)) }
}
