//! The element by its output error, where the samples are too far apart for the paper's dynamic step.

use super::classical::ClassicalData;
use super::conclude::residual_rms;
use super::{Estimate, Identification, IdentifyOptions, Parameter, along, refit as by_output_error};
use crate::recording::Recording;

/// Least part by which the error falls.
const LEAST_GAIN: f64 = 0.05;

/// The identification with its element fitted by output error, where strokes repeat, the refinement was not possible and
/// the error falls.
pub(super) fn refit(mut found: Identification, recordings: &[Recording], options: &IdentifyOptions) -> Identification {
    if !options.refine || found.refinement.is_some() || !along::repeats(recordings) {
        return found;
    }
    let data = ClassicalData::new(recordings, &found, options);
    let Ok(fit) = by_output_error(&data, &found, options.degrees) else { return found };
    let rms = residual_rms(recordings, &fit.model, &fit.stages);
    if rms > (1.0 - LEAST_GAIN) * found.residual_rms {
        return found;
    }
    let steady_lines =
        found.parameters.iter().filter(|p| p.name.ends_with("_positive") || p.name.ends_with("_negative"));
    let known: Vec<_> = steady_lines.filter(|p| !fit.parameters.iter().any(|q| q.name == p.name)).cloned().collect();
    let fitted = fit.parameters.into_iter().map(|p| as_steady_state_has_it(p, &found.parameters));
    found.parameters = fitted.chain(known).collect();
    found.warnings.retain(|w| w.subject != "half_width_m");
    found.warnings.extend(fit.warnings);
    (found.model, found.stages, found.free_parameters) = (fit.model, fit.stages, fit.free_parameters);
    found.residual_rms = rms;
    found
}

/// What steady sliding leaves open, such as a slope from one speed, a fit to the same strokes does not pin.
fn as_steady_state_has_it(fitted: Parameter, before: &[Parameter]) -> Parameter {
    let open = before.iter().find(|p| p.name == fitted.name && !p.estimate.pinned && p.name != "half_width_m");
    let Some(note) = open.and_then(|p| p.estimate.note.clone()) else { return fitted };
    let Estimate { value, unit, .. } = fitted.estimate;
    Parameter { name: fitted.name, estimate: Estimate::not_pinned(value, unit, note) }
}
