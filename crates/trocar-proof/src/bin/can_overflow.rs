//! A sum of whole numbers that may overflow: must not link, since the profile checks for that.

use trocar_model::{ParamError, Trocar, TrocarState};
use trocar_proof::{run, without_panic};

#[inline(never)]
fn refuted(trocar: &Trocar<&[f64]>, state: &mut TrocarState, motion: f64, duration: f64) -> f64 {
    without_panic(|| f64::from(trocar.step(state, motion, duration) as u32 + 1))
}

fn main() -> Result<(), ParamError> {
    run(refuted)
}
