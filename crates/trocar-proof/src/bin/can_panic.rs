//! An index that may lie outside, hidden behind a step: must not link.

use trocar_model::{ParamError, Trocar, TrocarState};
use trocar_proof::{run, without_panic};

#[inline(never)]
fn refuted(trocar: &Trocar<&[f64]>, state: &mut TrocarState, motion: f64, duration: f64) -> f64 {
    without_panic(|| [1.0, 2.0, 3.0][trocar.step(state, motion, duration) as usize])
}

fn main() -> Result<(), ParamError> {
    run(refuted)
}
