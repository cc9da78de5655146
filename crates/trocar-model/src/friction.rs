//! What all models have in common: motion in, force out, everything that changes in a small state.

use crate::direction::Direction;

/// A friction model driven by displacement: parameters immutable and checked once, state small and
/// `Copy`.
///
/// Invariants of every implementation: a step never fails, allocates or panics and its work is
/// bounded; an input that is not finite, or a duration that is not positive, leaves the state
/// untouched and returns the last force.
pub trait Friction {
    /// Everything that changes while the model runs.
    type State: Copy + core::fmt::Debug;

    /// State at rest that holds `force`, N, clamped to what the model can hold; a force that is not
    /// finite counts as 0.
    ///
    /// The history behind that force is unknown: one of the states that give it.
    fn rest_at_force(&self, force: f64) -> Self::State;

    /// State at rest after a slide in `direction` that holds `force`, N; [`Self::rest_at_force`] where
    /// a model does not tell them apart.
    fn rest_after(&self, _direction: Direction, force: f64) -> Self::State {
        self.rest_at_force(force)
    }

    /// Advances `state` by `displacement` (m) within `duration` (s) at constant velocity; returns
    /// the force (N) at the end.
    fn step(&self, state: &mut Self::State, displacement: f64, duration: f64) -> f64;

    /// Force after the last step, N: that of the instrument on the seal.
    fn force(state: &Self::State) -> f64;
}

/// [`Friction`] by the functions of the same names that the model has itself, so that they need no
/// trait; and the force of its state.
macro_rules! friction {
    ($model:ty, $state:ty $(, $more:item)*) => {
        impl $state {
            /// F, N: force after the last step, that of the instrument on the seal.
            pub fn force(&self) -> f64 {
                self.force
            }
        }

        impl $crate::friction::Friction for $model {
            type State = $state;

            fn rest_at_force(&self, force: f64) -> $state {
                <$model>::rest_at_force(self, force)
            }

            fn step(&self, state: &mut $state, displacement: f64, duration: f64) -> f64 {
                <$model>::step(self, state, displacement, duration)
            }

            fn force(state: &$state) -> f64 {
                state.force
            }

            $($more)*
        }
    };
}
pub(crate) use friction;

/// [`friction!`] of a classical model, and what follows from its `rest_at_force` and its `step`.
macro_rules! classical {
    ($model:ty, $state:ty) => {
        impl $model {
            /// State at rest without force.
            pub fn rest_state(&self) -> $state {
                self.rest_at_force(0.0)
            }

            /// Advances `state` at constant `velocity` (m/s) for `duration` (s); returns the force
            /// (N) at the end.
            pub fn step_velocity(&self, state: &mut $state, velocity: f64, duration: f64) -> f64 {
                self.step(state, velocity * duration, duration)
            }
        }

        $crate::friction::friction!($model, $state);
    };
}
pub(crate) use classical;

/// Velocity of a step, m/s, or `None` where the step must leave the state untouched.
#[inline(always)]
pub(crate) fn velocity(displacement: f64, duration: f64) -> Option<f64> {
    let velocity = displacement / duration;
    // NaN is not at most anything, so these also refuse it.
    (duration > 0.0 && duration <= f64::MAX && velocity.abs() <= f64::MAX).then_some(velocity)
}

/// -1, 0 or 1. An own function, since `f64::signum` gives 1 and -1 at the two zeros.
#[inline(always)]
pub(crate) fn sign(value: f64) -> f64 {
    if value > 0.0 {
        1.0
    } else if value < 0.0 {
        -1.0
    } else {
        0.0
    }
}

/// A force that a model can hold at rest, N: clamped to ±`limit`; what is not finite counts as 0.
pub(crate) fn held(force: f64, limit: f64) -> f64 {
    if force.is_finite() { force.max(-limit).min(limit) } else { 0.0 }
}

/// `value` clamped to ±`limit`; neither may be NaN, which `f64::clamp` would have to look after.
#[inline(always)]
pub(crate) fn within(value: f64, limit: f64) -> f64 {
    let below = if value < limit { value } else { limit };
    if below > -limit { below } else { -limit }
}
