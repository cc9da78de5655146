//! The Dahl model: friction as a spring that yields the more, the nearer its force comes to the
//! Coulomb force.

use crate::error::{ParamError, check_fields};
use crate::exponential::{decay, logarithm_of_one_plus, power};
use crate::friction::{classical, held, sign, velocity};
use crate::law::{Law, Visit, made_of_params};
use crate::parameter::{Blank, parameters};
use crate::row::row;

/// Parameters of the Dahl model, key DAHL. Checked by [`Dahl::new`].
///
/// ```text
/// df/dx = σ·|y|^i·sgn(y)         y = 1 - (f/F_c)·sgn(v)
/// F     = f + β·v
/// ```
///
/// | symbol | field             | unit  | range                        |
/// |--------|-------------------|-------|------------------------------|
/// | σ      | `stiffness`       | N/m   | > 0                          |
/// | F_c    | `coulomb_force`   | N     | > 0                          |
/// | i      | `exponent`        | 1     | > 0; mostly 0.5 to 1.5       |
/// | β      | `viscous_damping` | N·s/m | >= 0; 0 is the model of DAHL |
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DahlParams {
    /// σ, N/m, > 0: slope of the force where it is zero.
    pub stiffness: f64,
    /// F_c, N, > 0: force that a long slide settles at.
    pub coulomb_force: f64,
    /// i, pure number > 0: shape of the approach to F_c. Below 1 it ends within a finite travel, at
    /// 1 it is exponential, above 1 it is algebraic.
    pub exponent: f64,
    /// β, N·s/m, >= 0.
    pub viscous_damping: f64,
}

/// The Dahl model: validated, immutable; many states may share it.
///
/// - **Step**: the exact solution at constant velocity for any stiffness, speed and length. |y| is y, since y
///   stays within [0, 2].
/// - **Invariants**: |f| <= F_c, to the last bit; F(-x) = -F(x); for β = 0 independent of rate, and of the sampling of
///   a monotone motion; passive with the storage f²/(2·σ), also in steps: F·Δx is never less than what that gains.
/// - **Limits**: no memory of turning points: small loops do not close, and a small oscillation upon a bias drifts. No
///   force to break away beyond F_c.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dahl {
    params: DahlParams,
}

/// Everything that changes while a Dahl model runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DahlState {
    pub(crate) hysteresis_force: f64,
    pub(crate) force: f64,
    /// Of the last motion; 0 before any.
    pub(crate) direction: f64,
    pub(crate) remainder: Remainder,
}

impl DahlState {
    /// f, N: force without its viscous part, |f| <= F_c.
    pub fn hysteresis_force(&self) -> f64 {
        self.hysteresis_force
    }
}

parameters!(DahlParams {
    stiffness: Stiffness,
    coulomb_force: CoulombForce,
    exponent: Exponent,
    viscous_damping: ViscousDamping,
});

impl Dahl {
    /// Checks the parameters.
    ///
    /// # Errors
    /// A value out of its range.
    pub fn new(params: DahlParams) -> Result<Self, ParamError> {
        check_fields(&params)?;
        Ok(Self { params })
    }

    /// The parameters.
    pub fn params(&self) -> &DahlParams {
        &self.params
    }

    /// State at rest that holds `force`, N, clamped to ±F_c; a force that is not finite counts as
    /// 0.
    pub fn rest_at_force(&self, force: f64) -> DahlState {
        let hysteresis_force = held(force, self.params.coulomb_force);
        DahlState {
            hysteresis_force,
            force: hysteresis_force,
            direction: 0.0,
            remainder: Remainder::UNKNOWN,
        }
    }

    /// Advances `state` by `displacement` (m) within `duration` (s) at constant velocity; returns
    /// the force (N) at the end.
    pub fn step(&self, state: &mut DahlState, displacement: f64, duration: f64) -> f64 {
        if let Some(velocity) = velocity(displacement, duration) {
            let mut next = *state;
            self.load(&mut next, displacement);
            next.force = next.hysteresis_force + self.params.viscous_damping * velocity;
            if next.force.abs() <= f64::MAX {
                *state = next;
            }
        }
        state.force
    }

    /// Force at the very start of motion at `velocity` (m/s) from `state`, N; the last force for a
    /// velocity that is not finite.
    pub fn output(&self, state: &DahlState, velocity: f64) -> f64 {
        let force = state.hysteresis_force + self.params.viscous_damping * velocity;
        if velocity.is_finite() && force.is_finite() { force } else { state.force }
    }

    /// Moves f by `displacement`.
    fn load(&self, state: &mut DahlState, displacement: f64) {
        let DahlParams { stiffness, coulomb_force, exponent, .. } = self.params;
        let (s, m) = (sign(displacement), exponent - 1.0);
        if s == 0.0 {
            return;
        }
        if s != state.direction {
            let y = 1.0 - s * state.hysteresis_force / coulomb_force;
            state.remainder = Remainder { y, inverse_power: power(y, -m).min(f64::MAX) };
            state.direction = s;
        }
        state.remainder.advance(stiffness * displacement.abs() / coulomb_force, m);
        state.hysteresis_force = s * coulomb_force * (1.0 - state.remainder.y);
    }
}

/// y = 1 - s·f/F_c, what is left to the Coulomb force in the direction s of motion, in [0, 2].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Remainder {
    pub(crate) y: f64,
    /// y^-m with m = i - 1: it changes in proportion to the travel, so that the power is taken at
    /// reversals only. The largest number where it would be infinite, as for y = 0: a state is
    /// finite.
    pub(crate) inverse_power: f64,
}

impl Remainder {
    const UNKNOWN: Self = Self { y: 1.0, inverse_power: 1.0 };

    /// The solution of dy/dtravel = -y^i after `travel` = σ·|Δx|/F_c.
    ///
    /// With m = i - 1 it is (y^-m + m·travel)^(-1/m), 0 once the bracket is no longer positive.
    /// Written relative to y it neither overflows for large m nor loses digits for small m.
    fn advance(&mut self, travel: f64, m: f64) {
        if m == 0.0 {
            self.y *= decay(travel);
            return;
        }
        let growth = m * travel / self.inverse_power;
        if growth <= -1.0 || self.y == 0.0 {
            *self = Self { y: 0.0, inverse_power: if m < 0.0 { 0.0 } else { f64::MAX } };
            return;
        }
        let logarithm = if growth < f64::INFINITY {
            logarithm_of_one_plus(growth)
        } else {
            libm::log(m * travel) + m * libm::log(self.y)
        };
        self.y *= decay(logarithm / m);
        self.inverse_power = (self.inverse_power + m * travel).min(f64::MAX);
    }
}

row!(DahlState { hysteresis_force, force, direction, remainder });
row!(Remainder { y, inverse_power });

impl Law for Dahl {
    made_of_params!(DahlParams);

    fn visit<V: Visit>(params: &mut DahlParams, visitor: &mut V) -> Result<(), V::Error> {
        visitor.numbers(params)
    }

    fn viscous_damping(&self) -> f64 {
        self.params.viscous_damping
    }
}

classical!(Dahl, DahlState);

#[cfg(test)]
mod tests {
    use super::*;

    fn dahl(exponent: f64) -> Dahl {
        Dahl::new(DahlParams {
            stiffness: 2000.0,
            coulomb_force: 3.0,
            exponent,
            viscous_damping: 0.0,
        })
        .unwrap()
    }

    #[test]
    fn a_state_is_finite_also_at_the_coulomb_force() {
        let extreme = DahlParams {
            stiffness: 700.0,
            coulomb_force: 1e-200,
            exponent: 1e308,
            viscous_damping: 0.0,
        };
        for model in [dahl(1.4), dahl(0.5), Dahl::new(extreme).unwrap()] {
            for force in [0.0, 10.0] {
                let mut state = model.rest_at_force(force);
                for displacement in [1e-3, 1e-3, -1e-3, -1e-3, 1e-3] {
                    model.step(&mut state, displacement, 1e-3);
                    assert!(
                        state.remainder.y.is_finite() && state.remainder.inverse_power.is_finite(),
                        "{model:?}"
                    );
                }
            }
        }
    }

    /// From zero force, y = 1: where the solution is a plain number.
    #[test]
    fn virgin_curves_pass_known_points() {
        // (exponent, travel σx/F_c, y there)
        let points = [
            (0.5, 1.0, 0.25),
            (1.0, core::f64::consts::LN_2, 0.5),
            (1.5, 2.0, 0.25),
            (2.0, 3.0, 0.25),
        ];
        for (exponent, travel, y) in points {
            let model = dahl(exponent);
            let mut state = model.rest_state();
            let force = model.step(&mut state, -travel * 3.0 / 2000.0, 1.0);
            assert!((force + 3.0 * (1.0 - y)).abs() < 1e-14, "{exponent}: {force}");
        }
    }

    #[test]
    fn below_one_the_coulomb_force_is_reached() {
        let model = dahl(0.5);
        // From y = 2 the travel to y = 0 is 2·√2.
        let full = 2.0 * core::f64::consts::SQRT_2 * 3.0 / 2000.0;
        let mut state = model.rest_at_force(-3.0);
        assert!(model.step(&mut state, 0.999 * full, 1.0) < 3.0);
        assert_eq!(model.step(&mut state, 0.002 * full, 1.0), 3.0);
        assert_eq!(model.step(&mut state, full, 1.0), 3.0);
    }

    #[test]
    fn extreme_exponents_stay_within_bounds() {
        for exponent in [1e-300, 1e-3, 1.0 - 1e-16, 1.0 + 3e-16, 300.0, 5e3, 1e300] {
            let model = dahl(exponent);
            let mut state = model.rest_at_force(-3.0);
            for travel in [1e-300, 1e-9, 1e-3, 1.0, 1e9, 1e300] {
                for displacement in [travel, -travel] {
                    let before = state.force();
                    let force = model.step(&mut state, displacement, 1.0);
                    assert!(force.abs() <= 3.0, "{exponent} {displacement} {force}");
                    // A rounding of y is 4e-16 of F_c.
                    assert!(
                        sign(displacement) * (force - before) >= -2e-15,
                        "{exponent} {displacement} {force}"
                    );
                }
            }
        }
    }

    /// Where y^i is beyond all numbers, y falls from 2 to 1 at once and then hardly further.
    #[test]
    fn great_exponents_fall_to_one() {
        for exponent in [2e3, 5e3, 1e5] {
            let model = dahl(exponent);
            let force = model.step(&mut model.rest_at_force(-3.0), 3.0 / 2000.0, 1.0);
            assert!(force > 0.0 && force < 3.0 * 4e-3, "{exponent}: {force}");
        }
    }

    /// Near 1 the power law goes over into the exponential without a loss of digits.
    #[test]
    fn exponent_one_is_a_limit() {
        for step in [3e-16, 1e-12, 1e-9] {
            let (one, near) = (dahl(1.0), dahl(1.0 + step));
            let (mut a, mut b) = (one.rest_at_force(-2.0), near.rest_at_force(-2.0));
            let apart = one.step(&mut a, 1e-3, 1.0) - near.step(&mut b, 1e-3, 1.0);
            assert!(apart.abs() < 1e-14 + 3.0 * step, "{step} {apart}");
        }
    }
}
