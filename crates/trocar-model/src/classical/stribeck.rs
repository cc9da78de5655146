//! Static friction laws: the force follows from the velocity alone. Coulomb, viscous, Stribeck; EMS
//! (4), (11), (23).

use crate::error::ParamError;
use crate::friction::{classical, held, sign, velocity};
use crate::law::{Law, Visit, made_of_params};
use crate::parameter::Blank;
use crate::row::row;
use crate::sliding::SlidingFriction;

/// Friction without a deformation of its own; by its parameters Coulomb, Coulomb and viscous, or
/// Stribeck.
///
/// ```text
/// F = g(|v|)·sgn(v) + β·v        v != 0                             EMS (11); (23) when F_s = F_c
/// F ∈ [-F_s, F_s]                v = 0
/// ```
///
/// | law                | parameters                                           |
/// |--------------------|------------------------------------------------------|
/// | Coulomb            | [`SlidingFriction::coulomb`] with β = 0              |
/// | Coulomb, viscous   | [`SlidingFriction::coulomb`]                         |
/// | Stribeck           | [`SlidingFriction`] with F_s > F_c                   |
///
/// Symbols, units and ranges are those of [`SlidingFriction`].
///
/// - **At rest** the law leaves the force open. A motion given as displacement cannot decide it, so the model holds the
///   force of the last motion without its viscous part.
/// - **Invariants**: |F - β·v| <= F_s; F(-v) = -F(v); F·v >= 0; independent of rate and sampling when F_s = F_c and
///   β = 0.
/// - **Limits**: the force jumps at each reversal; no presliding, no frictional lag.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StaticFriction {
    sliding: SlidingFriction,
}

/// Everything that changes while static friction runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StaticState {
    pub(crate) held_force: f64,
    pub(crate) force: f64,
}

impl StaticState {
    /// Force without its viscous part, N, within ±F_s: what a rest from here on holds.
    pub fn held_force(&self) -> f64 {
        self.held_force
    }
}

impl StaticFriction {
    /// Checks the parameters.
    ///
    /// # Errors
    /// A value out of its range.
    pub fn new(sliding: SlidingFriction) -> Result<Self, ParamError> {
        sliding.check()?;
        Ok(Self { sliding })
    }

    /// The parameters.
    pub fn params(&self) -> &SlidingFriction {
        &self.sliding
    }

    /// State at rest that holds `force`, N, clamped to ±F_s; a force that is not finite counts as
    /// 0.
    pub fn rest_at_force(&self, force: f64) -> StaticState {
        let held_force = held(force, self.sliding.static_force);
        StaticState { held_force, force: held_force }
    }

    /// Advances `state` by `displacement` (m) within `duration` (s) at constant velocity; returns
    /// the force (N) at the end. Exact for any step.
    pub fn step(&self, state: &mut StaticState, displacement: f64, duration: f64) -> f64 {
        if let Some(velocity) = velocity(displacement, duration) {
            let next = self.moved(state, velocity);
            if next.force.abs() <= f64::MAX {
                *state = next;
            }
        }
        state.force
    }

    /// Force at the very start of motion at `velocity` (m/s) from `state`, N; the last force for a
    /// velocity that is not finite.
    pub fn output(&self, state: &StaticState, velocity: f64) -> f64 {
        let force =
            if velocity.is_finite() { self.moved(state, velocity).force } else { state.force };
        if force.is_finite() { force } else { state.force }
    }

    fn moved(&self, state: &StaticState, velocity: f64) -> StaticState {
        let s = sign(velocity);
        if s == 0.0 {
            return StaticState { force: state.held_force, ..*state };
        }
        // The last bit of g may lie beyond the bound.
        let held_force = s * self.sliding.level(velocity).min(self.sliding.static_force);
        StaticState { held_force, force: held_force + self.sliding.viscous_damping * velocity } // EMS (11)
    }
}

row!(StaticState { held_force, force });

impl Law for StaticFriction {
    made_of_params!(SlidingFriction);

    fn visit<V: Visit>(sliding: &mut SlidingFriction, visitor: &mut V) -> Result<(), V::Error> {
        visitor.sliding(sliding)
    }

    fn viscous_damping(&self) -> f64 {
        self.sliding.viscous_damping
    }
}

classical!(StaticFriction, StaticState);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coulomb_and_viscous_parts_add_up() {
        let friction = StaticFriction::new(SlidingFriction::coulomb(3.0, 5.0)).unwrap();
        let mut state = friction.rest_state();
        assert_eq!(friction.step(&mut state, 0.125, 0.5), 4.25);
        assert_eq!(friction.step(&mut state, -0.125, 0.5), -4.25);
        assert_eq!(friction.output(&state, 0.25), 4.25);
    }

    #[test]
    fn rest_holds_the_force_without_its_viscous_part() {
        let friction = StaticFriction::new(SlidingFriction::coulomb(3.0, 5.0)).unwrap();
        let mut state = friction.rest_state();
        assert_eq!(friction.step(&mut state, 0.0, 1e-3), 0.0);
        friction.step(&mut state, -0.125, 0.5);
        for zero in [0.0, -0.0] {
            assert_eq!(friction.step(&mut state, zero, 1e-3), -3.0);
        }
        assert_eq!(friction.rest_at_force(-9.0).force(), -3.0);
        assert_eq!(friction.rest_at_force(f64::NAN).force(), 0.0);
    }
}
