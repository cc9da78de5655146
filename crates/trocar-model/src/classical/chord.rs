//! Parts of a step over which the rate of a state changes with the state in a straight line.

use crate::exponential::{decay, logarithm_of_one_plus};

/// Travel of the instrument for `far` of the state while its rate goes from `start` to `end` <=
/// `start` in a straight line.
pub(super) fn chord_travel(far: f64, start: f64, end: f64) -> f64 {
    let fall = (start - end) / start;
    if fall > 0.0 { far / start * (-logarithm_of_one_plus(-fall) / fall) } else { far / start }
}

/// (1 - exp(-x))/x for x >= 0.
pub(super) fn filled(x: f64) -> f64 {
    if x < 1e-3 {
        1.0 - x / 2.0 * (1.0 - x / 3.0 * (1.0 - x / 4.0 * (1.0 - x / 5.0)))
    } else {
        (1.0 - decay(x)) / x
    }
}
