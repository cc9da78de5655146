//! What runs in the loop: no allocation, bounded work.

use trocar_model::{Trocar, TrocarState};

use crate::model::Model;
use crate::pointer::{Array, ArrayMut, OutPointer};
use crate::state::{State, Words};
use crate::status::{Status, guarded};

/// Where a step ends, by the state it begins from.
struct Motion {
    /// m
    position: f64,
    /// m
    displacement: f64,
    /// s
    duration: f64,
}

impl Motion {
    /// Reports what the model would ignore silently.
    fn check(&self) -> Result<(), Status> {
        let Self { position, displacement, duration } = self;
        if ![position, displacement, duration].iter().all(|number| number.is_finite()) {
            return Err(Status::NotFinite);
        }
        if *duration <= 0.0 {
            return Err(Status::DurationNotPositive);
        }
        if (displacement / duration).is_finite() { Ok(()) } else { Err(Status::NotFinite) }
    }
}

/// What a call asks for.
#[derive(Clone, Copy)]
enum Way {
    /// m
    By(f64),
    /// m
    To(f64),
    /// m, rad
    Turn(f64, f64),
}

/// One step for C.
///
/// # Safety
/// By the rule of the crate.
unsafe fn step(
    model: *const Model,
    state: *mut State,
    way: Way,
    duration: f64,
    force_n: *mut f64,
) -> Status {
    guarded(|| {
        // SAFETY: by the rule of the crate.
        let mut place = unsafe { OutPointer::new(force_n) }?;
        place.set(0.0);
        // SAFETY: by the rule of the crate.
        let words = unsafe { Words::new(state) }?;
        place.set(words.last_force());
        // SAFETY: by the rule of the crate.
        let model = unsafe { Model::borrowed(model) }?;
        let taken = words.taken(model)?;
        let mut state = model.rest;
        taken.read_into(&mut state)?;
        let (position, displacement) = match way {
            Way::By(displacement) => (state.position() + displacement, displacement),
            Way::To(position) | Way::Turn(position, _) => (position, position - state.position()),
        };
        Motion { position, displacement, duration }.check()?;
        if let Way::Turn(_, angle) = way {
            let turned = angle - state.turning().ok_or(Status::Unsupported)?.angle();
            Motion { position: angle, displacement: turned, duration }.check()?;
        }
        let force = match way {
            Way::By(displacement) => model.trocar.step(&mut state, displacement, duration),
            Way::To(position) => model.trocar.step_to(&mut state, position, duration),
            Way::Turn(position, angle) => {
                model.trocar.turn_to(&mut state, position, angle, duration)
            }
        };
        if !force.is_finite() {
            return Err(Status::NotAState);
        }
        taken.write(&state)?;
        place.set(force);
        Ok(())
    })
}

/// Advances by displacement_m (m, positive is insertion) within duration_s (s, above 0) at constant velocity, and gives
/// the force at the end to *force_n: N, that of the instrument on the seal, positive on insertion; the instrument feels
/// its negative. No allocation, bounded work. Where the call is refused the state stays as it was and *force_n is the
/// last force, or 0 where there is no state.
///
/// Refuses: TROCAR_STATUS_NOT_FINITE, TROCAR_STATUS_DURATION_NOT_POSITIVE, TROCAR_STATUS_NOT_A_STATE, TROCAR_STATUS_OTHER_MODEL, TROCAR_STATUS_STATE_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_step(
    model: *const Model,
    state: *mut State,
    displacement_m: f64,
    duration_s: f64,
    force_n: *mut f64,
) -> Status {
    // SAFETY: by the rule of the crate.
    unsafe { step(model, state, Way::By(displacement_m), duration_s, force_n) }
}

/// The same to position_m (m) instead of by a displacement: the one to use with an encoder, for its errors do not add up.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_step_to(
    model: *const Model,
    state: *mut State,
    position_m: f64,
    duration_s: f64,
    force_n: *mut f64,
) -> Status {
    // SAFETY: by the rule of the crate.
    unsafe { step(model, state, Way::To(position_m), duration_s, force_n) }
}

/// The same to position_m (m), while the instrument turns to angle_rad (rad, 0 where the state was initialised) at constant
/// velocity; the torque is then in trocar_state_torque(). The other steps leave the angle as it is.
///
/// Refuses: TROCAR_STATUS_UNSUPPORTED for a model without rotation.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_turn_to(
    model: *const Model,
    state: *mut State,
    position_m: f64,
    angle_rad: f64,
    duration_s: f64,
    force_n: *mut f64,
) -> Status {
    // SAFETY: by the rule of the crate.
    unsafe { step(model, state, Way::Turn(position_m, angle_rad), duration_s, force_n) }
}

/// The same at velocity_m_s (m/s, positive is insertion) for duration_s.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_step_velocity(
    model: *const Model,
    state: *mut State,
    velocity_m_s: f64,
    duration_s: f64,
    force_n: *mut f64,
) -> Status {
    let way = Way::By(velocity_m_s * duration_s);
    // SAFETY: by the rule of the crate.
    unsafe { step(model, state, way, duration_s, force_n) }
}

/// Many steps: from start_time_s (s), where state stands, to each of count positions position_m (m) at its time time_s
/// (s) in turn; force_n gets the force (N) there. The same forces as from trocar_step_to(), to the last bit. A row with
/// the time and position of the one before repeats the force. force_n may be the array position_m; no array may overlap
/// the state.
///
/// Stops at the first row that cannot be followed, with the status of that step; *done (may be NULL) is the number of
/// valid forces, and state is that after the last of them.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_simulate(
    model: *const Model,
    state: *mut State,
    start_time_s: f64,
    count: usize,
    time_s: *const f64,
    position_m: *const f64,
    force_n: *mut f64,
    done: *mut usize,
) -> Status {
    guarded(|| {
        // SAFETY: by the rule of the crate.
        let mut done = if done.is_null() { None } else { Some(unsafe { OutPointer::new(done) }?) };
        let mut report = |rows| done.iter_mut().for_each(|done| done.set(rows));
        report(0);
        // SAFETY: by the rule of the crate.
        let (model, words) = unsafe { (Model::borrowed(model)?, Words::new(state)?) };
        // SAFETY: by the rule of the crate.
        let (times, positions) =
            unsafe { (Array::new(time_s, count)?, Array::new(position_m, count)?) };
        // SAFETY: by the rule of the crate.
        let mut forces = unsafe { ArrayMut::new(force_n, count) }?;
        let taken = words.taken(model)?;
        let mut state = model.rest;
        taken.read_into(&mut state)?;
        let mut run = Run { trocar: &model.trocar, state: &mut state, time: start_time_s };
        let rows = times.iter().zip(positions.iter()).enumerate();
        let outcome = rows.into_iter().try_for_each(|(row, (time, position))| {
            forces.set(row, run.follow(time, position)?);
            report(row + 1);
            Ok(())
        });
        let written = if outcome == Err(Status::NotAState) { outcome } else { taken.write(&state) };
        if written.is_err() {
            report(0);
        }
        written.and(outcome)
    })
}

/// A state on its way along rows.
struct Run<'a> {
    trocar: &'a Trocar<Vec<f64>>,
    state: &'a mut TrocarState,
    /// Time of the row before, s.
    time: f64,
}

impl Run<'_> {
    /// Force at the next row, N.
    fn follow(&mut self, time: f64, position: f64) -> Result<f64, Status> {
        let displacement = position - self.state.position();
        let duration = time - self.time;
        if duration == 0.0 && displacement == 0.0 {
            return Ok(self.state.force());
        }
        Motion { position, displacement, duration }.check()?;
        let force = self.trocar.step_to(self.state, position, duration);
        self.time = time;
        if force.is_finite() { Ok(force) } else { Err(Status::NotAState) }
    }
}
