//! A model along arrays: the step of [`Trocar`], [`BLOCK`] samples at a time where that is faster.
//!
//! What a step needs of the motion alone (velocity, Stribeck curve, exponentials) does not wait for
//! the state: it is computed for a block of samples as vectors, and the state then follows in a
//! short loop. **Every operation is that of the scalar step, in its order, so every force and every
//! state has its bits.** A block that holds a sample the step refuses, and every model without a
//! loop of its own, runs the scalar step.

use crate::block::{BLOCK, Motion, Samples};
use crate::classical::{Classical, ClassicalState};
use crate::seal::{Seal, SealState, Trocar, TrocarState};

impl<K: AsRef<[f64]>> Trocar<K> {
    /// Advances through `positions` (m), each reached within its duration (s) at constant velocity,
    /// and writes the force (N) at the end of each to `forces`: as [`Trocar::step_to`] for one
    /// after the other, to the last bit, and as far as the shortest of the three slices goes.
    ///
    /// A program that is compiled for, or chooses at run time, wider vectors gets them: all of it
    /// is `#[inline(always)]`.
    ///
    /// ```
    /// use trocar_model::{Classical, LuGre, LuGreParams, SlidingFriction, StribeckCurve, Trocar};
    ///
    /// # fn main() -> Result<(), trocar_model::ParamError> {
    /// let sliding = SlidingFriction { static_force: 3.0, ..SlidingFriction::coulomb(2.0, 5.0) };
    /// let (damping_velocity, curve) = (f64::INFINITY, StribeckCurve::Exponential);
    /// let lugre = LuGre::new(LuGreParams { stiffness: 800.0, micro_damping: 5.0, damping_velocity, sliding, curve })?;
    /// let trocar = Trocar::of_seal(Classical::LuGre(lugre));
    /// let mut state = trocar.rest(0.0);
    /// let positions: [f64; 500] = core::array::from_fn(|k| 50e-6 * k as f64);
    /// let mut forces = [0.0; 500];
    /// trocar.run(&mut state, &positions, &[1e-3; 500], &mut forces);
    /// assert_eq!(state.force(), forces[499]);
    /// # Ok(())
    /// # }
    /// ```
    #[inline(always)]
    pub fn run(
        &self,
        state: &mut TrocarState,
        positions: &[f64],
        durations: &[f64],
        forces: &mut [f64],
    ) {
        let count = positions.len().min(durations.len()).min(forces.len());
        let (positions, last_positions) = positions.get(..count).unwrap_or(&[]).as_chunks();
        let (durations, last_durations) = durations.get(..count).unwrap_or(&[]).as_chunks();
        let (forces, last_forces) = forces.get_mut(..count).unwrap_or(&mut []).as_chunks_mut();
        for ((positions, durations), forces) in positions.iter().zip(durations).zip(forces) {
            if !self.run_block(state, positions, durations, forces) {
                self.run_steps(state, positions, durations, forces);
            }
        }
        self.run_steps(state, last_positions, last_durations, last_forces);
    }

    /// The scalar step, sample by sample.
    #[inline(never)]
    fn run_steps(
        &self,
        state: &mut TrocarState,
        positions: &[f64],
        durations: &[f64],
        forces: &mut [f64],
    ) {
        for ((position, duration), force) in positions.iter().zip(durations).zip(forces) {
            *force = self.step_to(state, *position, *duration);
        }
    }

    /// One block by a loop of the model's own; false, with all but `forces` untouched, where only
    /// the scalar step will do.
    #[inline(always)]
    fn run_block(
        &self,
        state: &mut TrocarState,
        positions: &Samples,
        durations: &Samples,
        forces: &mut Samples,
    ) -> bool {
        let (Seal::Classical(model), SealState::Classical(own)) = (self.seal(), &mut state.seal)
        else {
            return false;
        };
        let start = state.position;
        let moved = match (model, own) {
            (Classical::MaxwellSlip(model), ClassicalState::MaxwellSlip(own)) => {
                Motion::new(start, positions, durations)
                    .is_some_and(|motion| model.run_block(own, &motion, forces))
            }
            (Classical::LuGre(model), ClassicalState::LuGre(own)) => {
                Motion::new(start, positions, durations)
                    .is_some_and(|motion| model.run_block(own, &motion, forces))
            }
            _ => false,
        };
        if moved {
            if let Some(profile) = self.profile() {
                forces
                    .iter_mut()
                    .zip(positions)
                    .for_each(|(force, x)| *force = profile.apply(*x, *force));
            }
            (state.position, state.force) = (positions[BLOCK - 1], forces[BLOCK - 1]);
        }
        moved
    }
}
