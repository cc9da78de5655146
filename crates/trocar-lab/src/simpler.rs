//! Whether a simpler model predicts the recordings better than the identified one: then the seal is
//! no EMS element, or the recordings do not show its deformation, and the intervals of its parameters
//! cannot be trusted.

use rayon::prelude::*;
use trocar_model::Trocar;

use crate::margin::{Margin, by_stroke};
use crate::validate::Validated;
use trocar_identify::classical::{self, ClassicalData, Kind, RelatedFits};
use trocar_identify::{Identification, IdentifyOptions, Warning};
use trocar_simulate::replay::forces;

/// Models with few parameters and a state that cover most seals.
const SIMPLER: [Kind; 2] = [Kind::LuGre, Kind::Dahl];

/// A model is clearly better with an error below this fraction of the other's ...
const CLEARLY: f64 = 0.9;
/// ... that is this many standard errors away.
const STANDARD_ERRORS: f64 = 2.0;
/// A model whose error after short fits is this many times that of the element is not fitted further:
/// longer fits take off some percent.
const HOPELESS: f64 = 1.5;

/// Error of one model over several recordings.
struct Errors {
    /// Mean squared error of each stroke, N².
    by_stroke: Vec<f64>,
    /// Root mean square error, N.
    rms: f64,
}

/// A doubt if LuGre or Dahl, fitted to the same recordings, predicts clearly better than the
/// identified model: on those held out, or over its own without any.
pub(crate) fn doubt(
    found: &Identification,
    options: &IdentifyOptions,
    own: &Validated,
    held_out: Option<&Validated>,
) -> Option<Warning> {
    // No model predicts when each slip begins, so none is better or worse for that.
    if found.stick_slip.is_some() {
        return None;
    }
    let is_alone = held_out.is_none();
    let scored = held_out.unwrap_or(own);
    let data = ClassicalData::new(&own.recordings, found, options);
    // An element that extrapolates badly loses to models with larger errors on its own recordings.
    let most = Some(HOPELESS * own.validation.rms_n.max(scored.validation.rms_n));
    let alone = RelatedFits { most, ..RelatedFits::default() };
    let fits: Vec<_> =
        SIMPLER.par_iter().filter_map(|kind| classical::fit(*kind, &data, alone).ok()).collect();
    let own = errors(scored, found.model.offset, scored.runs.iter().map(|run| &run.force));
    let better = fits.into_iter().filter_map(|fit| {
        let model = Trocar::of_seal(fit.model);
        let over = scored.recordings.iter().map(|own| forces(&model, own, fit.offset));
        let theirs = errors(scored, fit.offset, over);
        let margin = Margin::of(&theirs.by_stroke, &own.by_stroke)?;
        let clear = theirs.rms < CLEARLY * own.rms && margin.standard_errors > STANDARD_ERRORS;
        clear.then_some((fit.kind, theirs.rms, margin))
    });
    let best = better.min_by(|a, b| a.1.total_cmp(&b.1));
    best.map(|(kind, rms, margin)| {
        let which = if is_alone { "the recordings themselves" } else { "the held-out recordings" };
        let message = format!(
            "{} with {} parameters predicts {which} better: {rms:.3} against {:.3} N rms ({:.1} standard errors over \
             {} strokes): the seal is no EMS element, or its deformation is not seen in these recordings. Do not rely on \
             these parameters; trocar compare gives that model",
            kind.title(),
            kind.parameters(),
            own.rms,
            margin.standard_errors,
            margin.strokes
        );
        Warning::doubt("simpler model", message)
    })
}

/// Of the forces of a model with the sensor offset `offset`, N, over each recording, where the state
/// of the identified element is known.
fn errors<F: AsRef<[f64]>>(
    scored: &Validated,
    offset: f64,
    forces: impl Iterator<Item = F>,
) -> Errors {
    let (mut by_strokes, mut squares, mut count) = (Vec::new(), 0.0, 0);
    for ((recording, run), force) in scored.recordings.iter().zip(&scored.runs).zip(forces) {
        let samples: Vec<usize> = run.known.iter().cloned().flatten().collect();
        let force = force.as_ref();
        let errors: Vec<f64> =
            samples.iter().map(|i| recording.force[*i] - offset - force[*i]).collect();
        squares += errors.iter().map(|e| e * e).sum::<f64>();
        count += errors.len();
        by_strokes.extend(by_stroke(recording, &samples, &errors));
    }
    Errors { by_stroke: by_strokes, rms: (squares / count.max(1) as f64).sqrt() }
}
