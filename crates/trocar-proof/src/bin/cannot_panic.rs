//! All that runs a trocar, of any model, with any numbers: links only if none of it can panic.

use trocar_model::{ParamError, Trocar, TrocarState};
use trocar_proof::{run, without_panic};

#[inline(never)]
fn step(trocar: &Trocar<&[f64]>, state: &mut TrocarState, displacement: f64, duration: f64) -> f64 {
    without_panic(|| trocar.step(state, displacement, duration))
}

#[inline(never)]
fn step_to(trocar: &Trocar<&[f64]>, state: &mut TrocarState, position: f64, duration: f64) -> f64 {
    without_panic(|| trocar.step_to(state, position, duration))
}

#[inline(never)]
fn turn_to(trocar: &Trocar<&[f64]>, state: &mut TrocarState, position: f64, angle: f64) -> f64 {
    without_panic(|| trocar.turn_to(state, position, angle, 1e-3) + state.torque())
}

#[inline(never)]
fn step_velocity(
    trocar: &Trocar<&[f64]>,
    state: &mut TrocarState,
    velocity: f64,
    duration: f64,
) -> f64 {
    without_panic(|| trocar.step_velocity(state, velocity, duration))
}

#[inline(never)]
fn rest(trocar: &Trocar<&[f64]>, state: &mut TrocarState, position: f64, value: f64) -> f64 {
    without_panic(|| {
        *state = trocar.rest(position);
        *state = trocar.rest_at_force(position, value + state.force());
        trocar.rest_at_deflection(position, value).map_or(state.force(), |state| state.force())
    })
}

fn main() -> Result<(), ParamError> {
    run(step)?;
    run(step_to)?;
    run(turn_to)?;
    run(step_velocity)?;
    run(rest)
}
