//! The element by its output error, where the samples are too far apart for the paper's dynamic step.

use super::classical::ClassicalData;
use super::conclude::residual_rms;
use super::{Identification, IdentifyOptions, along, motion, refit as by_output_error};
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
    found.parameters = fit.parameters.into_iter().chain(known).collect();
    found.warnings.retain(|w| !motion::fitted_anew(&w.subject, &found.parameters));
    found.warnings.extend(fit.warnings);
    (found.model, found.stages, found.free_parameters) = (fit.model, fit.stages, fit.free_parameters);
    found.residual_rms = rms;
    found
}
