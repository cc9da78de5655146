//! The Bouc–Wen model: a hysteresis loop whose unloading has a shape of its own.

use crate::error::{ParamError, check_fields};
use crate::exponential::power;
use crate::friction::{classical, held, sign, velocity, within};
use crate::law::{Law, Visit, made_of_params};
use crate::parameter::{Blank, parameters};
use crate::row::row;

use super::chord::{chord_travel, filled};

/// Largest change of u = f·sgn(v)/F_c in one part of a step.
const STRIDE: f64 = 1.0 / 16.0;

/// Parts of a step so limited: from u = -1 to 1 a common exponent needs 40. Two longer ones follow.
const STRIDES: usize = 48;

/// Parameters of the Bouc–Wen model, keys BOUC and WEN. Checked by [`BoucWen::new`].
///
/// WEN has with A = 1, and β_W and γ_W for its β and γ, since β is the viscous damping here:
/// ```text
/// dz/dx = 1 - (β_W·sgn(z·v) + γ_W)·|z|^n       F = k·z
/// ```
/// The size of z is free there. The form of ISMAIL is without that freedom, with f = k·z:
/// ```text
/// df/dx = k·(1 - |f/F_c|^n·(1 - σ + σ·sgn(f·v)))    F_c = k·(β_W + γ_W)^(-1/n)
/// F     = f + β·v                                   σ   = β_W/(β_W + γ_W)
/// ```
/// A linear part beside it, of a spring that never yields, is left out: a seal slides on.
///
/// | symbol | field             | unit  | range                                  |
/// |--------|-------------------|-------|----------------------------------------|
/// | k      | `stiffness`       | N/m   | > 0                                    |
/// | F_c    | `coulomb_force`   | N     | > 0                                    |
/// | n      | `exponent`        | 1     | > 0; mostly 1 to 3                     |
/// | σ      | `unloading_shape` | 1     | >= 0.5, where WEN has β_W >= γ_W       |
/// | β      | `viscous_damping` | N·s/m | >= 0; 0 is the model of BOUC and WEN   |
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoucWenParams {
    /// k, N/m, > 0: slope of the force where it is zero.
    pub stiffness: f64,
    /// F_c, N, > 0: force that a long slide settles at.
    pub coulomb_force: f64,
    /// n, > 0: how sharply the force bends into F_c.
    pub exponent: f64,
    /// σ, >= 0.5: after a reversal at F_c the force falls by 2·σ·k a metre. At 0.5 it falls in a
    /// straight line.
    pub unloading_shape: f64,
    /// β, N·s/m, >= 0.
    pub viscous_damping: f64,
}

/// The Bouc–Wen model: validated, immutable; many states may share it.
///
/// - **Step**: along the travel df/d|x| is a function of f alone. For n = 1 the step is the exact solution; otherwise it
///   is cut into parts of at most 1/16 of F_c, each with the exponential of the chord: second order, never past F_c,
///   stable for any stiffness and length, and at most 50 parts.
/// - **Invariants**: |f| <= F_c, to the last bit; F(-x) = -F(x); for β = 0 independent of rate; passive with the storage
///   f²/(2·k), for which σ >= 0.5 is needed.
/// - **Special cases**: n = 1 with σ = 1 is [`Dahl`](crate::Dahl) with exponent 1. Large n with σ = 0.5 is a
///   Maxwell-Slip element.
/// - **Limits**: no memory of turning points: small loops do not close, and a small oscillation upon a bias drifts. No
///   force to break away beyond F_c.
/// - **Errors**: [`ParamError`] from [`BoucWen::new`]; never later.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoucWen {
    params: BoucWenParams,
    /// 2·σ - 1: growth of the slope over k at u = -1.
    unloading: f64,
}

/// Everything that changes while a Bouc–Wen model runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoucWenState {
    hysteresis_force: f64,
    force: f64,
}

impl BoucWenState {
    /// f, N: force without its viscous part, |f| <= F_c.
    pub fn hysteresis_force(&self) -> f64 {
        self.hysteresis_force
    }
}

parameters!(BoucWenParams {
    stiffness: Stiffness,
    coulomb_force: CoulombForce,
    exponent: Exponent,
    unloading_shape: UnloadingShape,
    viscous_damping: ViscousDamping,
});

impl BoucWen {
    /// Checks the parameters.
    ///
    /// # Errors
    /// A value out of its range.
    pub fn new(params: BoucWenParams) -> Result<Self, ParamError> {
        check_fields(&params)?;
        let unloading = (2.0 * params.unloading_shape - 1.0).min(f64::MAX);
        Ok(Self { params, unloading })
    }

    /// The parameters.
    pub fn params(&self) -> &BoucWenParams {
        &self.params
    }

    /// 2·σ - 1.
    pub fn unloading(&self) -> f64 {
        self.unloading
    }

    /// State at rest that holds `force`, N, clamped to ±F_c; a force that is not finite counts as
    /// 0.
    pub fn rest_at_force(&self, force: f64) -> BoucWenState {
        let force = held(force, self.params.coulomb_force);
        BoucWenState { hysteresis_force: force, force }
    }

    /// Advances `state` by `displacement` (m) within `duration` (s) at constant velocity; returns
    /// the force (N) at the end.
    pub fn step(&self, state: &mut BoucWenState, displacement: f64, duration: f64) -> f64 {
        let BoucWenParams { stiffness, coulomb_force, viscous_damping, .. } = self.params;
        let Some(velocity) = velocity(displacement, duration) else { return state.force };
        let s = sign(displacement);
        let mut hysteresis_force = state.hysteresis_force;
        if s != 0.0 {
            let travel = stiffness * displacement.abs() / coulomb_force;
            // A state of a model with a greater F_c, such as before a change of it.
            let part = within(s * hysteresis_force / coulomb_force, 1.0);
            hysteresis_force = s * coulomb_force * self.load(part, travel);
        }
        let force = hysteresis_force + viscous_damping * velocity;
        if force.abs() <= f64::MAX {
            *state = BoucWenState { hysteresis_force, force };
        }
        state.force
    }

    /// Force at the very start of motion at `velocity` (m/s) from `state`, N; the last force for a
    /// velocity that is not finite.
    pub fn output(&self, state: &BoucWenState, velocity: f64) -> f64 {
        let force = state.hysteresis_force + self.params.viscous_damping * velocity;
        if velocity.is_finite() && force.is_finite() { force } else { state.force }
    }

    /// u = f·sgn(v)/F_c after `travel` = k·|Δx|/F_c. It only rises, first to 0, then towards 1.
    fn load(&self, mut u: f64, mut travel: f64) -> f64 {
        let mut gain = self.gain(u);
        for part in 0..STRIDES + 2 {
            if travel <= 0.0 || gain <= 0.0 {
                break;
            }
            let end = if u < 0.0 { 0.0 } else { 1.0 };
            let stride = if part < STRIDES { self.stride(u) } else { f64::INFINITY };
            let far = (end - u).min(stride).min(gain * travel);
            let there = if far < end - u { u + far } else { end };
            let gain_there = self.gain(there);
            let needed = if far < gain * travel {
                chord_travel(far, gain, gain_there)
            } else {
                f64::INFINITY
            };
            if needed < travel {
                (u, gain) = (there, gain_there);
                travel -= needed;
            } else {
                return u + (gain * travel * filled((gain - gain_there) / far * travel)).min(far);
            }
        }
        u
    }

    /// du/dtravel, ISMAIL: 1 - |u|^n while loading, 1 + (2·σ - 1)·|u|^n while unloading.
    fn gain(&self, u: f64) -> f64 {
        let n = self.params.exponent;
        let power = if n == 1.0 {
            u.abs()
        } else if n == 2.0 {
            u * u
        } else {
            power(u.abs(), n)
        };
        let slope = if u < 0.0 { self.unloading } else { -1.0 };
        1.0 + slope * power
    }

    /// Change of u over which the gain is taken as a straight line.
    fn stride(&self, u: f64) -> f64 {
        let n = self.params.exponent;
        if n == 1.0 {
            return f64::INFINITY;
        }
        // A large n bends the line within 1/n of |u| = 1.
        STRIDE.min((0.5 * (1.0 - u.abs())).max(0.25 / n.max(1.0)))
    }
}

row!(BoucWenState { hysteresis_force, force });

impl Law for BoucWen {
    made_of_params!(BoucWenParams);

    fn visit<V: Visit>(params: &mut BoucWenParams, visitor: &mut V) -> Result<(), V::Error> {
        visitor.numbers(params)
    }

    fn viscous_damping(&self) -> f64 {
        self.params.viscous_damping
    }
}

classical!(BoucWen, BoucWenState);

#[cfg(test)]
mod tests {
    use super::*;

    fn bouc_wen(exponent: f64, unloading_shape: f64) -> BoucWen {
        BoucWen::new(BoucWenParams {
            stiffness: 2000.0,
            coulomb_force: 3.0,
            exponent,
            unloading_shape,
            viscous_damping: 0.0,
        })
        .unwrap()
    }

    /// From zero force with n = 1 the force rises exponentially; with σ = 0.5 it falls in a straight
    /// line.
    #[test]
    fn exact_where_the_solution_is_a_plain_number() {
        let model = bouc_wen(1.0, 0.5);
        let mut state = model.rest_state();
        let force = model.step(&mut state, core::f64::consts::LN_2 * 3.0 / 2000.0, 1.0);
        assert!((force - 1.5).abs() < 1e-14, "{force}");
        for exponent in [1.0, 1.7, 2.0, 30.0] {
            let model = bouc_wen(exponent, 0.5);
            let mut state = model.rest_at_force(-3.0);
            let force = model.step(&mut state, 1e-3, 1.0);
            assert!((force + 1.0).abs() < 1e-14, "{exponent}: {force}");
        }
    }

    /// As where F_c is turned down while the model runs.
    #[test]
    fn a_state_beyond_the_coulomb_force_comes_back_to_it() {
        for exponent in [0.7, 1.0, 2.5] {
            let model = bouc_wen(exponent, 0.8);
            for force in [-4.0, 4.0] {
                let mut state = BoucWenState { hysteresis_force: force, force };
                model.step(&mut state, 1e-6, 1e-3);
                assert!(state.force().abs() <= 3.0, "{exponent}: {state:?}");
            }
        }
    }

    /// Virgin curve for n = 2: F_c·tanh(k·x/F_c), with steps of any length.
    #[test]
    fn virgin_curve_of_exponent_two_is_the_hyperbolic_tangent() {
        let model = bouc_wen(2.0, 0.8);
        for (parts, tolerance) in [(1, 3e-3), (1000, 1e-6)] {
            let mut state = model.rest_state();
            for _ in 0..parts {
                model.step(&mut state, 3e-3 / f64::from(parts), 1.0);
            }
            let truth = 3.0 * libm::tanh(2.0);
            assert!((state.force - truth).abs() < tolerance, "{parts}: {}", state.force);
        }
    }

    #[test]
    fn extreme_parameters_stay_within_bounds() {
        for exponent in [1e-300, 1e-3, 1.0, 1.0 + 3e-16, 300.0, 1e300] {
            for shape in [0.5, 1.0, 1e3, 1e300, f64::MAX] {
                let model = bouc_wen(exponent, shape);
                let mut state = model.rest_at_force(-3.0);
                for travel in [1e-300, 1e-9, 1e-3, 1.0, 1e9, 1e300] {
                    for displacement in [travel, -travel] {
                        let before = state.force();
                        let force = model.step(&mut state, displacement, 1.0);
                        assert!(force.abs() <= 3.0, "{exponent} {shape} {displacement} {force}");
                        let gained = sign(displacement) * (force - before);
                        assert!(gained >= -2e-15, "{exponent} {shape} {displacement} {force}");
                    }
                }
            }
        }
    }
}
