//! The modified Leuven model: a LuGre-like sliding law over a hysteresis bank with nonlocal memory.

use crate::error::{ParamError, check_fields, finite};
use crate::exponential::power;
use crate::friction::{classical, sign, velocity};
use crate::law::{Elements, Law, MAX_ELEMENTS, Visit};
use crate::parameter::{Blank, parameters};
use crate::row::row;
use crate::sliding::SlidingFriction;

use super::chord::{chord_travel, filled};
use super::maxwell_slip::{Bank, SlipElement};

/// ΣF_i may miss F_s by this fraction: rounding of a bank made from shares of F_s.
const LIMIT_TOLERANCE: f64 = 1e-9;

/// Largest change of r = F_h/g in one part of a step for n other than 1; for |r| > 1 as a fraction
/// of |r|.
const STRIDE: f64 = 0.125;

/// Parts of a step so limited: a full reversal from r = -1.5 to 1 needs 20. Later parts end at a
/// yielding element only.
const STRIDES: usize = 24;

/// Closer to its limit than this fraction an element has yielded; absorbs the rounding of its
/// event.
const SNAP: f64 = 1e-14;

/// Parameters beside the bank. Checked by [`Leuven::new`].
///
/// | symbol      | field           | unit  | range |
/// |-------------|-----------------|-------|-------|
/// | g, σ2       | `sliding`, its β is σ2 |       |       |
/// | n           | `exponent`      | 1     | > 0   |
/// | σ1          | `micro_damping` | N·s/m | >= 0  |
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeuvenParams {
    /// g and σ2 = β.
    pub sliding: SlidingFriction,
    /// n, > 0: how sharply presliding turns into sliding; about 1 in LEUVEN.
    pub exponent: f64,
    /// σ1, N·s/m, >= 0.
    pub micro_damping: f64,
}

/// Everything that changes while a [`Leuven`] runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeuvenState {
    pub(crate) deflection: f64,
    pub(crate) forces: [f64; MAX_ELEMENTS],
    pub(crate) count: usize,
    pub(crate) force: f64,
}

impl LeuvenState {
    /// z, m: deflection of the bank.
    pub fn deflection(&self) -> f64 {
        self.deflection
    }

    /// f_i, N: force of each element of the bank, |f_i| <= F_i.
    pub fn element_forces(&self) -> &[f64] {
        &self.forces[..self.count.min(MAX_ELEMENTS)]
    }

    /// F_h = Σf_i, N: hysteresis force.
    pub fn hysteresis_force(&self) -> f64 {
        self.element_forces().iter().sum()
    }
}

/// Modified Leuven model.
///
/// # Equations (key LAMPAERT in SOURCES.md; the original is LEUVEN)
/// ```text
/// dz/dt = v·(1 - sgn(r)·|r|^n)         r = F_h/s(v), s(v) = g(|v|)·sgn(v)
/// F_h   = Σ f_i,  df_i = k_i·dz until |f_i| = F_i       Maxwell-Slip bank driven by z
/// F     = F_h + σ1·dz/dt + σ2·v
/// ```
/// g as in [`SlidingFriction`], the rest as in [`LeuvenParams`] and [`SlipElement`]; ΣF_i >= F_s,
/// or z would run away.
///
/// - **Memory**: the bank is the whole memory of turning points, and it cannot overflow. A stack holds one entry for each
///   open loop and is full some day; here a loop leaves its mark in the forces of the elements that did not yield in it.
///   N elements tell as many nested loops apart as their limits resolve. A loop too small for any element to yield is a
///   straight line there and back: nothing to remember, nothing lost, no jump. Closing a loop wipes it out by itself, and
///   the force stays continuous, where the original jumps.
/// - **Limits**: a single element that never yields, with n = 1, is LuGre with σ0 = k_1. Far below g, or for large n, F_h
///   is Maxwell-Slip.
/// - **Step**: along the travel dz/d|x| is a function of F_h alone, and F_h is a straight line of z until the next element
///   yields. For n = 1 each such part is solved exactly; otherwise it is cut into parts of at most 1/8 of g, each with
///   the exponential of the chord: second order (1.5 for n < 1), never past F_h = s(v), stable for any stiffness, 1 % of
///   g where one step holds a whole reversal. σ1·dz/dt is that at the end of the step.
/// - **Invariants**: |f_i| <= F_i; |F_h| <= F_s; |z| <= max F_i/k_i; at constant v the force settles at s(v) + σ2·v. When g
///   falls below |F_h| the bank unloads against the motion. At v = 0 it holds. Passivity is not claimed.
/// - **Errors**: [`ParamError`] from [`Leuven::new`]; never later.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leuven {
    bank: Bank,
    params: LeuvenParams,
    /// Bound of the force that grows with the velocity, over the velocity, N·s/m.
    damping: f64,
}

/// The bank as it lies ahead of z in one direction.
struct Ahead {
    /// Σk_i of the elements that have not yielded, N/m.
    stiffness: f64,
    /// Way of z to the next one that does, m.
    room: f64,
}

parameters!(LeuvenParams { exponent: Exponent, micro_damping: MicroDamping } with { sliding: SlidingFriction::BLANK });

impl Leuven {
    /// Checks the parameters; `bank` holds the hysteresis.
    ///
    /// # Errors
    /// No element or more than [`MAX_ELEMENTS`], a value that is not finite or out of its range, or
    /// ΣF_i < F_s.
    pub fn new(bank: &[SlipElement], params: LeuvenParams) -> Result<Self, ParamError> {
        params.sliding.check()?;
        check_fields(&params)?;
        let bank = Bank::new(bank)?;
        let (limit_force, static_force) = (bank.limit(), params.sliding.static_force);
        if limit_force < (1.0 - LIMIT_TOLERANCE) * static_force {
            return Err(ParamError::BankTooWeak { limit_force, static_force });
        }
        // |F_h| <= F_s and g >= F_c.
        let most = power(static_force / params.sliding.coulomb_force, params.exponent);
        let damping = params.sliding.viscous_damping + params.micro_damping * (1.0 + most);
        let damping =
            if params.micro_damping > 0.0 { damping } else { params.sliding.viscous_damping };
        Ok(Self { bank, params, damping: finite("bound of the damping", damping)? })
    }

    /// The parameters beside the bank.
    pub fn params(&self) -> &LeuvenParams {
        &self.params
    }

    /// The elements of the bank.
    pub fn elements(&self) -> &[SlipElement] {
        self.bank.elements()
    }

    /// ΣF_i, N.
    pub fn limit_force(&self) -> f64 {
        self.bank.limit()
    }

    /// Bound of the force that grows with the velocity, over the velocity, N·s/m.
    pub fn damping(&self) -> f64 {
        self.damping
    }

    /// State at rest that holds `force` (N), clamped to ±F_s, shared in proportion to F_i. A force
    /// that is not finite counts as 0.
    pub fn rest_at_force(&self, force: f64) -> LeuvenState {
        let forces = self.bank.share(force, self.params.sliding.static_force);
        let count = self.elements().len();
        let deflections =
            self.elements().iter().zip(&forces).map(|(element, force)| force / element.stiffness);
        // z is that of the longest element, the one that never yields.
        let deflection = deflections
            .fold(0.0, |longest: f64, z| if z.abs() > longest.abs() { z } else { longest });
        LeuvenState { deflection, forces, count, force: forces[..count].iter().sum() }
    }

    /// Advances `state` by `displacement` (m) within `duration` (s) at constant velocity; returns
    /// the force (N) at the end.
    ///
    /// Any size of step is allowed. A duration that is not positive, or a displacement, duration or
    /// velocity that is not finite, leaves the state untouched and returns the last force.
    #[inline]
    pub fn step(&self, state: &mut LeuvenState, displacement: f64, duration: f64) -> f64 {
        if let Some(velocity) = velocity(displacement, duration)
            && self.bank.limit() + self.damping * velocity.abs() <= f64::MAX
        {
            self.advance(state, velocity, displacement.abs());
        }
        state.force
    }

    /// Force (N) at the very start of motion at `velocity` (m/s); the last force for a velocity
    /// that is not finite.
    pub fn output(&self, state: &LeuvenState, velocity: f64) -> f64 {
        let mut state = *state;
        if self.bank.limit() + self.damping * velocity.abs() <= f64::MAX {
            self.advance(&mut state, velocity, 0.0);
        }
        state.force
    }

    #[inline(always)]
    fn advance(&self, state: &mut LeuvenState, velocity: f64, travel: f64) {
        let s = sign(velocity);
        if s == 0.0 {
            state.force = self.bank.force(&state.forces);
            return;
        }
        let level = self.params.sliding.level(velocity.abs());
        let hysteresis = self.load(state, s, level, travel);
        let mut force = hysteresis + self.params.sliding.viscous_damping * velocity;
        if self.params.micro_damping > 0.0 {
            force += self.params.micro_damping * velocity * self.gain(s * hysteresis / level);
        }
        state.force = force;
    }

    /// Moves the bank while the instrument travels by `travel` (m) towards `s`; returns F_h, N.
    ///
    /// z moves in one direction only, towards F_h = s·g: no element yields twice, so the parts are
    /// bounded.
    #[inline(always)]
    fn load(&self, state: &mut LeuvenState, s: f64, level: f64, travel: f64) -> f64 {
        let mut hysteresis = self.bank.force(&state.forces);
        let mut left = travel;
        let mut reached = None;
        let mut strides_left = STRIDES;
        for _ in 0..STRIDES + 2 * MAX_ELEMENTS + 1 {
            if left <= 0.0 {
                break;
            }
            let ratio = s * hysteresis / level;
            let gain = reached.unwrap_or_else(|| self.gain(ratio));
            let heading = s * sign(gain);
            let Ahead { stiffness, room } = self.bank.ahead(&state.forces, heading);
            // At equilibrium, or with all elements yielded, nothing moves.
            if heading == 0.0 || stiffness == 0.0 {
                break;
            }
            let start = gain.abs();
            let settled = (level - s * hysteresis).abs() / stiffness;
            let stride = if strides_left > 0 {
                self.stride(ratio) * level / stiffness
            } else {
                f64::INFINITY
            };
            strides_left = strides_left.saturating_sub(usize::from(stride < room));
            let far = room.min(settled).min(stride).min(start * left);
            let gain_there = if far < settled {
                self.gain(ratio + s * heading * stiffness * far / level)
            } else {
                0.0
            };
            let end = gain_there.abs();
            let needed =
                if far < start * left { chord_travel(far, start, end) } else { f64::INFINITY };
            let moved = if needed < left {
                left -= needed;
                reached = Some(gain_there);
                far
            } else {
                let moved = start * left * filled((start - end) / far * left);
                left = 0.0;
                moved.min(far)
            };
            state.deflection += heading * moved;
            hysteresis = self.bank.advance(&mut state.forces, heading, moved);
        }
        hysteresis
    }

    /// dz/dx = 1 - sgn(r)·|r|^n, LAMPAERT.
    #[inline(always)]
    fn gain(&self, ratio: f64) -> f64 {
        let n = self.params.exponent;
        if n == 1.0 {
            1.0 - ratio
        } else if n == 2.0 {
            1.0 - ratio * ratio.abs()
        } else {
            let power = power(ratio.abs(), n).min(f64::MAX);
            1.0 - if ratio < 0.0 { -power } else { power }
        }
    }

    /// Change of r over which the gain is taken as a straight line.
    fn stride(&self, ratio: f64) -> f64 {
        let n = self.params.exponent;
        if n == 1.0 {
            return f64::INFINITY;
        }
        // A large n bends the line within 1/n of r = 1.
        let bend = (0.5 * (1.0 - ratio).abs()).max(0.25 / n.max(1.0));
        (STRIDE * ratio.abs().max(1.0)).min(bend)
    }
}

impl Bank {
    /// Σf_i, N.
    #[inline(always)]
    fn force(&self, forces: &[f64; MAX_ELEMENTS]) -> f64 {
        forces.iter().zip(self.elements()).map(|(force, _)| force).sum()
    }

    #[inline(always)]
    fn ahead(&self, forces: &[f64; MAX_ELEMENTS], heading: f64) -> Ahead {
        let mut ahead = Ahead { stiffness: 0.0, room: f64::INFINITY };
        for (force, element) in forces.iter().zip(self.elements()) {
            let reserve = element.limit_force - heading * force;
            if reserve > 0.0 {
                ahead.stiffness += element.stiffness;
                ahead.room = ahead.room.min(reserve / element.stiffness);
            }
        }
        ahead
    }

    /// Moves z by `way` (m) towards `heading`; returns Σf_i, N.
    #[inline(always)]
    fn advance(&self, forces: &mut [f64; MAX_ELEMENTS], heading: f64, way: f64) -> f64 {
        let mut sum = 0.0;
        for (force, element) in forces.iter_mut().zip(self.elements()) {
            let loaded = heading * *force + element.stiffness * way;
            let yields = loaded >= (1.0 - SNAP) * element.limit_force;
            *force = heading * if yields { element.limit_force } else { loaded };
            sum += *force;
        }
        sum
    }
}

row!(LeuvenState { count, deflection, force, forces });

impl Law for Leuven {
    type Parts = (LeuvenParams, Elements<SlipElement>);
    const BLANK: Self::Parts = (LeuvenParams::BLANK, Elements::NONE);

    fn parts(&self) -> Self::Parts {
        (self.params, Elements::of(self.elements()))
    }

    fn of_parts((params, bank): &Self::Parts) -> Result<Self, ParamError> {
        Self::new(bank.as_slice(), *params)
    }

    fn visit<V: Visit>((params, bank): &mut Self::Parts, visitor: &mut V) -> Result<(), V::Error> {
        visitor.numbers(params)?;
        visitor.sliding(&mut params.sliding)?;
        visitor.elements(bank)
    }

    fn viscous_damping(&self) -> f64 {
        self.params.sliding.viscous_damping
    }
}

classical!(Leuven, LeuvenState);

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::ToString;

    use super::*;
    use crate::parameter::ParameterId;

    const STRIBECK: SlidingFriction = SlidingFriction {
        coulomb_force: 2.0,
        static_force: 3.0,
        stribeck_velocity: 0.01,
        stribeck_exponent: 2.0,
        viscous_damping: 1.0,
    };

    fn bank() -> [SlipElement; 2] {
        [
            SlipElement { stiffness: 1000.0, limit_force: 1.0 },
            SlipElement { stiffness: 500.0, limit_force: 2.0 },
        ]
    }

    fn leuven(exponent: f64) -> Leuven {
        Leuven::new(&bank(), LeuvenParams { sliding: STRIBECK, exponent, micro_damping: 0.0 })
            .unwrap()
    }

    #[test]
    fn the_factor_is_one_minus_the_signed_power() {
        // (1 - sgn r)·|r|^n, as one public program has it, is 0 for every positive r and 2 at r =
        // -1.
        for n in [0.5, 1.0, 2.0, 3.7] {
            let model = leuven(n);
            assert_eq!(model.gain(0.0), 1.0);
            assert_eq!(model.gain(1.0), 0.0);
            assert_eq!(model.gain(-1.0), 2.0);
            assert!(model.gain(0.5) > 0.0 && model.gain(0.5) < 1.0);
            assert!(model.gain(1.5) < 0.0);
        }
    }

    #[test]
    fn presliding_starts_with_the_stiffness_of_the_whole_bank() {
        let model = leuven(1.0);
        let mut state = model.rest_state();
        let force = model.step(&mut state, 1e-9, 1e-3);
        assert!((force - 1e-6 - 1.5e-6).abs() < 1e-12);
    }

    #[test]
    fn a_fall_of_the_sliding_force_unloads_the_bank_against_the_motion() {
        let model = leuven(1.0);
        let mut state = model.rest_at_force(3.0);
        let z = state.deflection();
        model.step_velocity(&mut state, 0.1, 1e-3);
        assert!(state.deflection() < z);
        model.step_velocity(&mut state, 0.1, 10.0);
        assert!((state.force() - 2.1).abs() < 1e-12);
    }

    #[test]
    fn at_rest_everything_is_kept() {
        for zero in [0.0, -0.0] {
            let model = leuven(2.0);
            let mut state = model.rest_state();
            model.step_velocity(&mut state, -0.1, 0.05);
            let before = state;
            assert_eq!(model.step(&mut state, zero, 1.0), before.hysteresis_force());
            assert_eq!(state.element_forces(), before.element_forces());
            assert_eq!(state.deflection(), before.deflection());
            assert_eq!(model.output(&state, zero), before.hysteresis_force());
        }
    }

    #[test]
    fn bad_parameters_are_named() {
        let params = LeuvenParams { sliding: STRIBECK, exponent: 1.0, micro_damping: 0.0 };
        let bad = Leuven::new(&bank()[..1], params).unwrap_err();
        assert_eq!(
            bad.to_string(),
            "the limit forces of the elements must add up to at least static_force_n = 3 N, got 1 N"
        );
        for bad in [
            LeuvenParams { exponent: 0.0, ..params },
            LeuvenParams { micro_damping: -1.0, ..params },
        ] {
            assert!(Leuven::new(&bank(), bad).is_err());
        }
        let unsure = SlipElement { stiffness: f64::NAN, limit_force: 5.0 };
        assert!(matches!(
            Leuven::new(&[unsure], params),
            Err(ParamError::OutOfRange { id: ParameterId { element: Some(1), .. }, .. })
        ));
    }

    #[test]
    fn a_bank_made_from_shares_of_the_static_force_may_be_short_by_rounding() {
        let short = [0.1, 0.2, 0.7].map(|share| SlipElement {
            stiffness: 100.0,
            limit_force: 3.0 * share * (1.0 - 1e-12),
        });
        let params = LeuvenParams { sliding: STRIBECK, exponent: 1.0, micro_damping: 1.0 };
        let model = Leuven::new(&short, params).unwrap();
        let mut state = model.rest_state();
        let force = model.step_velocity(&mut state, 1e-9, 1e9);
        assert!((force - 3.0).abs() < 1e-8);
        assert!(state.deflection() < 0.0211, "{}", state.deflection());
    }
}
