//! What the counts of a coarse encoder cost.

use super::findings::{Parameter, Warning};
use trocar_model::Quantity;
use trocar_recording::{COARSE, Recording};

/// Error, in steps, that coarse readings leave in lengths of the deformation: 0.2 rms over 40 random
/// seals (`tests/recover.rs`), 95 % within this. Turning points alone have 0.12.
const TURNING: f64 = 0.4;

/// Step of the coarsest encoder, m; 0 where none matters.
fn coarsest(recordings: &[Recording]) -> f64 {
    recordings.iter().map(Recording::coarse_step).fold(0.0, f64::max)
}

/// Adds the error of coarse readings to the half width and the joins: all turning points may err
/// alike, which the scatter of the strokes does not show.
pub(super) fn add_error(parameters: &mut [Parameter], recordings: &[Recording]) {
    let error = TURNING * coarsest(recordings);
    let is_length =
        |p: &&mut Parameter| matches!(p.id.quantity, Quantity::HalfWidth | Quantity::Join);
    for p in parameters.iter_mut().filter(is_length) {
        p.estimate = p.estimate.with_further(error);
    }
}

/// Names a coarse encoder, and what it costs.
pub(super) fn named(recordings: &[Recording]) -> Option<Warning> {
    let step = coarsest(recordings);
    let message = format!(
        "{:.0} µm is coarse: half width and joins err by up to {:.3} mm more, which their intervals include; \
         steps below {:.0} µm cost nothing",
        1e6 * step,
        1e3 * TURNING * step,
        1e6 * COARSE
    );
    (step > 0.0).then(|| Warning::advice("position step", message))
}
