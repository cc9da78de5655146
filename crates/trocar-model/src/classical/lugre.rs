//! The LuGre model: friction as the deflection of bristles that give way at the sliding force.

use crate::block::{BLOCK, Motion, Samples};
use crate::error::{ParamError, check_fields};
use crate::exponential::{decay, decay_inlined};
use crate::friction::{classical, held, sign, velocity, within};
use crate::law::{Choice, Law, Visit, made_of_params};
use crate::parameter::{Blank, parameters};
use crate::row::row;
use crate::sliding::SlidingFriction;

/// 4·√(2·e): v_d·σ_1/F_c up to which the damping alone keeps the model passive.
///
/// σ_1(v)·|v| is greatest at |v| = v_d/√2, where it is σ_1·v_d/√(2·e); it must not exceed 4·F_c <=
/// 4·g(v).
const DAMPING_REACH: f64 = 9.326_575_926_388_497;

/// How the sliding force falls from F_s to F_c with speed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StribeckCurve {
    /// g = F_c + (F_s - F_c)·exp(-(|v|/v_s)^δ): ARMSTRONG; the Gaussian of EMS (11) for δ = 2.
    Exponential,
    /// g = F_c + (F_s - F_c)/(1 + (|v|/v_s)^δ): ARMSTRONG; a longer tail.
    Rational,
}

impl Choice for StribeckCurve {
    const KEY: &str = "curve";
    const ALL: &[(Self, &str)] =
        &[(Self::Exponential, "exponential"), (Self::Rational, "rational")];
}

/// Parameters of the LuGre model, key LUGRE; σ_1(v) from OLSSON. Checked by [`LuGre::new`].
///
/// ```text
/// dz/dt = v - σ_0·|v|·z/g(|v|)
/// F     = σ_0·z + σ_1(v)·dz/dt + σ_2·v        σ_1(v) = σ_1·exp(-(v/v_d)²)
/// ```
///
/// | symbol            | field                                       | unit  | range                          |
/// |-------------------|---------------------------------------------|-------|--------------------------------|
/// | σ_0               | `stiffness`                                 | N/m   | > 0                            |
/// | σ_1               | `micro_damping`                             | N·s/m | >= 0                           |
/// | v_d               | `damping_velocity`                          | m/s   | > 0, infinite for constant σ_1 |
/// | F_c, F_s, v_s, δ  | `sliding`, see [`SlidingFriction`]          |       |                                |
/// | σ_2               | `sliding.viscous_damping`                   | N·s/m | >= 0                           |
/// | g                 | `curve`                                     | N     |                                |
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LuGreParams {
    /// σ_0, N/m, > 0: stiffness of the bristles.
    pub stiffness: f64,
    /// σ_1, N·s/m, >= 0: damping of the bristles at low speed.
    pub micro_damping: f64,
    /// v_d, m/s, > 0: speed over which that damping dies out; `f64::INFINITY` keeps it constant.
    pub damping_velocity: f64,
    /// F_c, F_s, v_s, δ and, as its viscous damping, σ_2.
    pub sliding: SlidingFriction,
    /// Shape of g.
    pub curve: StribeckCurve,
}

/// What is known of the energy that a LuGre model can give back, see [`LuGre::passivity`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Passivity {
    /// From no deflection on, no motion extracts energy.
    Passive,
    /// Not shown to be passive. With constant σ_1 it is not: a creep followed by a fast jerk
    /// extracts energy.
    NotGuaranteed {
        /// σ_2 from which on it is passive, N·s/m.
        viscous_damping_needed: f64,
        /// v_d up to which it is passive whatever σ_2, m/s.
        damping_velocity_needed: f64,
    },
}

/// The LuGre model: validated, immutable; many states may share it.
///
/// - **Step**: the exact solution at constant velocity for any stiffness, speed and length; the force is that of the
///   deflection at the end.
/// - **Invariants**: |z| <= F_s/σ_0; F(-x) = -F(x); at constant v the force settles at g(|v|)·sgn(v) + σ_2·v. F_s = F_c
///   without σ_1 and σ_2 is [`crate::Dahl`] with exponent 1.
/// - **At rest** z stays and the force is σ_0·z.
/// - **Limits**: no memory of turning points; a small oscillation upon a bias drifts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LuGre {
    params: LuGreParams,
    /// F_s/σ_0, m.
    greatest_deflection: f64,
    /// 1/v_d, s/m; 0 for constant damping.
    inverse_damping_velocity: f64,
}

/// Everything that changes while a LuGre model runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LuGreState {
    pub(crate) deflection: f64,
    pub(crate) force: f64,
}

impl LuGreState {
    /// z, m: deflection of the bristles, |z| <= F_s/σ_0.
    pub fn deflection(&self) -> f64 {
        self.deflection
    }
}

parameters!(LuGreParams {
    stiffness: Stiffness,
    micro_damping: MicroDamping,
    damping_velocity: DampingVelocity,
} with { sliding: SlidingFriction::BLANK, curve: StribeckCurve::Exponential });

impl LuGre {
    /// Checks the parameters and prepares the step. Sets that are not passive are allowed.
    ///
    /// # Errors
    /// A value out of its range.
    pub fn new(params: LuGreParams) -> Result<Self, ParamError> {
        check_fields(&params)?;
        params.sliding.check()?;
        Ok(Self {
            params,
            greatest_deflection: params.sliding.static_force / params.stiffness,
            inverse_damping_velocity: 1.0 / params.damping_velocity,
        })
    }

    /// The parameters.
    pub fn params(&self) -> &LuGreParams {
        &self.params
    }

    /// Whether the model can give back more energy than it was given.
    ///
    /// Passive if σ_2 >= σ_1·(F_s/F_c - 1), or if v_d <= 4·√(2·e)·F_c/σ_1. For constant σ_1 the
    /// first is also necessary, key BARABANOV. Both follow from what is lost beside the storage
    /// σ_0·z²/2, with r = σ_0·z·sgn(v)/g <= F_s/g:
    ///
    /// ```text
    /// F·v - σ_0·z·dz/dt = |v|·[g·r² + σ_1(v)·|v|·(1 - r) + σ_2·|v|]
    /// ```
    ///
    /// The second condition keeps σ_1(v)·|v| <= 4·g, where g·r² + σ_1(v)·|v|·(1 - r) has no
    /// negative value. A passive set is passive in steps too: F·Δx is never less than what σ_0·z²/2
    /// gains.
    pub fn passivity(&self) -> Passivity {
        let LuGreParams { micro_damping, damping_velocity, sliding, .. } = self.params;
        let viscous_damping_needed =
            micro_damping * (sliding.static_force / sliding.coulomb_force - 1.0);
        let damping_velocity_needed = DAMPING_REACH * sliding.coulomb_force / micro_damping;
        if sliding.viscous_damping >= viscous_damping_needed
            || damping_velocity <= damping_velocity_needed
        {
            Passivity::Passive
        } else {
            Passivity::NotGuaranteed { viscous_damping_needed, damping_velocity_needed }
        }
    }

    /// g, N, at `speed` = |v|, m/s: the settled force without its viscous part. The sign of `speed`
    /// is ignored.
    pub fn level(&self, speed: f64) -> f64 {
        let sliding = &self.params.sliding;
        match self.params.curve {
            StribeckCurve::Exponential => sliding.level(speed),
            StribeckCurve::Rational => {
                let excess = sliding.static_force - sliding.coulomb_force;
                sliding.coulomb_force + excess / (1.0 + sliding.exponent(speed.abs()))
            }
        }
    }

    /// F_s/σ_0, m.
    pub fn greatest_deflection(&self) -> f64 {
        self.greatest_deflection
    }

    /// 1/v_d, s/m; 0 for constant damping.
    pub fn inverse_damping_velocity(&self) -> f64 {
        self.inverse_damping_velocity
    }

    /// State at rest that holds `force`, N, clamped to ±F_s; a force that is not finite counts as
    /// 0.
    pub fn rest_at_force(&self, force: f64) -> LuGreState {
        let deflection = held(force, self.params.sliding.static_force) / self.params.stiffness;
        LuGreState { deflection, force: self.params.stiffness * deflection }
    }

    /// Advances `state` by `displacement` (m) within `duration` (s) at constant velocity; returns
    /// the force (N) at the end.
    pub fn step(&self, state: &mut LuGreState, displacement: f64, duration: f64) -> f64 {
        if let Some(velocity) = velocity(displacement, duration) {
            let next = self.moved(state, velocity, displacement.abs());
            if next.force.abs() <= f64::MAX && next.deflection.abs() <= f64::MAX {
                *state = next;
            }
        }
        state.force
    }

    /// Force at the very start of motion at `velocity` (m/s) from `state`, N; the last force for a
    /// velocity that is not finite.
    pub fn output(&self, state: &LuGreState, velocity: f64) -> f64 {
        let force =
            if velocity.is_finite() { self.moved(state, velocity, 0.0).force } else { state.force };
        if force.is_finite() { force } else { state.force }
    }

    /// The state `distance` = |Δx| further on at constant `velocity`.
    fn moved(&self, state: &LuGreState, velocity: f64, distance: f64) -> LuGreState {
        let LuGreParams { stiffness, sliding, .. } = self.params;
        let z = state.deflection;
        let s = sign(velocity);
        if s == 0.0 {
            return LuGreState { deflection: z, force: stiffness * z };
        }
        let level = self.level(velocity);
        let settled = s * level / stiffness;
        let yielding = stiffness / level;
        let left = decay(distance * yielding);
        // The last bit of a sum may lie beyond the bound.
        let deflection = within(settled + (z - settled) * left, self.greatest_deflection);
        // 1 - s·σ_0·z/g decays like the distance from the settled z: dz/dt without a difference of
        // near equals.
        let rate = velocity * (1.0 - s * z * yielding) * left;
        let viscous = sliding.viscous_damping * velocity;
        LuGreState {
            deflection,
            force: stiffness * deflection + self.micro_damping(velocity) * rate + viscous,
        }
    }

    /// [`LuGre::step`] for a block of samples; false, with `state` untouched, where a step would
    /// leave it so.
    #[inline(always)]
    pub(crate) fn run_block(
        &self,
        state: &mut LuGreState,
        motion: &Motion,
        forces: &mut Samples,
    ) -> bool {
        let LuGreParams { stiffness, sliding, .. } = self.params;
        let (mut settled, mut yielding, mut left) = ([0.0; BLOCK], [0.0; BLOCK], [0.0; BLOCK]);
        let level = self.levels(motion);
        for i in 0..BLOCK {
            settled[i] = sign(motion.velocity[i]) * level[i] / stiffness;
            yielding[i] = stiffness / level[i];
            left[i] = decay_inlined(motion.displacement[i].abs() * yielding[i]);
        }
        // The bound hardly ever acts: it is looked at afterwards, and the loop done again with it
        // where it does.
        let mut deflections = follow(state.deflection, motion, &settled, &left, |z| z);
        let mut bounded = true;
        for z in deflections {
            bounded &= z.abs() <= self.greatest_deflection;
        }
        if !bounded {
            deflections = follow(state.deflection, motion, &settled, &left, |z| {
                within(z, self.greatest_deflection)
            });
        }
        let damping = self.micro_dampings(motion);
        let mut finite = true;
        for i in 0..BLOCK {
            let (velocity, z) = (motion.velocity[i], deflections[i]);
            let before = if i == 0 { state.deflection } else { deflections[i - 1] };
            let rate = velocity * (1.0 - sign(velocity) * before * yielding[i]) * left[i];
            let moving = stiffness * z + damping[i] * rate + sliding.viscous_damping * velocity;
            forces[i] = if velocity == 0.0 { stiffness * z } else { moving };
            finite &= (forces[i].abs() <= f64::MAX) & (z.abs() <= f64::MAX);
        }
        if finite {
            *state = LuGreState { deflection: deflections[BLOCK - 1], force: forces[BLOCK - 1] };
        }
        finite
    }

    /// [`LuGre::level`] for a block of samples.
    #[inline(always)]
    fn levels(&self, motion: &Motion) -> Samples {
        let sliding = &self.params.sliding;
        let mut levels = [sliding.coulomb_force; BLOCK];
        if sliding.is_constant() && self.params.curve == StribeckCurve::Exponential {
            return levels;
        }
        if sliding.stribeck_exponent == 2.0 && self.params.curve == StribeckCurve::Exponential {
            let (surplus, inverse) =
                (sliding.static_force - sliding.coulomb_force, 1.0 / sliding.stribeck_velocity);
            for (level, velocity) in levels.iter_mut().zip(motion.velocity) {
                let x = velocity.abs() * inverse;
                *level = sliding.coulomb_force + surplus * decay_inlined(x * x);
            }
        } else {
            levels
                .iter_mut()
                .zip(motion.velocity)
                .for_each(|(level, velocity)| *level = self.level(velocity));
        }
        levels
    }

    /// [`LuGre::micro_damping`] for a block of samples.
    #[inline(always)]
    fn micro_dampings(&self, motion: &Motion) -> Samples {
        let mut dampings = [self.params.micro_damping; BLOCK];
        if self.inverse_damping_velocity != 0.0 {
            for (damping, velocity) in dampings.iter_mut().zip(motion.velocity) {
                let ratio = velocity * self.inverse_damping_velocity;
                *damping = self.params.micro_damping * decay_inlined(ratio * ratio);
            }
        }
        dampings
    }

    /// σ_1(v), N·s/m.
    fn micro_damping(&self, velocity: f64) -> f64 {
        if self.inverse_damping_velocity == 0.0 {
            return self.params.micro_damping;
        }
        let ratio = velocity * self.inverse_damping_velocity;
        self.params.micro_damping * decay(ratio * ratio)
    }
}

/// Deflections after each sample, from z = `deflection` on; a held instrument keeps its own.
#[inline(always)]
fn follow(
    deflection: f64,
    motion: &Motion,
    settled: &Samples,
    left: &Samples,
    bound: impl Fn(f64) -> f64,
) -> Samples {
    let (mut z, mut deflections) = (deflection, [0.0; BLOCK]);
    for i in 0..BLOCK {
        if motion.velocity[i] != 0.0 {
            z = bound(settled[i] + (z - settled[i]) * left[i]);
        }
        deflections[i] = z;
    }
    deflections
}

row!(LuGreState { deflection, force });

impl Law for LuGre {
    made_of_params!(LuGreParams);

    fn visit<V: Visit>(params: &mut LuGreParams, visitor: &mut V) -> Result<(), V::Error> {
        visitor.numbers(params)?;
        visitor.choice(&mut params.curve)?;
        visitor.sliding(&mut params.sliding)
    }

    fn viscous_damping(&self) -> f64 {
        self.params.sliding.viscous_damping
    }
}

classical!(LuGre, LuGreState);

#[cfg(test)]
mod tests {
    use super::*;

    /// The values of LUGRE.
    const PAPER: LuGreParams = LuGreParams {
        stiffness: 1e5,
        micro_damping: 316.0,
        damping_velocity: f64::INFINITY,
        sliding: SlidingFriction {
            coulomb_force: 1.0,
            static_force: 1.5,
            stribeck_velocity: 1e-3,
            stribeck_exponent: 2.0,
            viscous_damping: 0.4,
        },
        curve: StribeckCurve::Exponential,
    };

    #[test]
    fn rational_curve_is_half_way_at_the_stribeck_velocity() {
        for stribeck_exponent in [0.5, 1.0, 2.0, 3.0] {
            let sliding = SlidingFriction { stribeck_exponent, ..PAPER.sliding };
            let model =
                LuGre::new(LuGreParams { sliding, curve: StribeckCurve::Rational, ..PAPER })
                    .unwrap();
            assert_eq!(
                (model.level(0.0), model.level(1e-3), model.level(-1e-3)),
                (1.5, 1.25, 1.25)
            );
            assert!((model.level(1e300) - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn motion_from_rest_starts_with_all_dampers() {
        let model = LuGre::new(PAPER).unwrap();
        let force = model.output(&model.rest_state(), 0.01);
        assert!((force - (316.0 + 0.4) * 0.01).abs() < 1e-15);
        let fading = LuGre::new(LuGreParams { damping_velocity: 0.01, ..PAPER }).unwrap();
        let force = fading.output(&fading.rest_state(), 0.01);
        assert!((force - (316.0 / core::f64::consts::E + 0.4) * 0.01).abs() < 1e-15);
    }

    #[test]
    fn passivity_of_the_published_values() {
        let Passivity::NotGuaranteed { viscous_damping_needed, damping_velocity_needed } =
            LuGre::new(PAPER).unwrap().passivity()
        else {
            panic!("passive")
        };
        assert_eq!(viscous_damping_needed, 158.0);
        // σ_1(v)·|v| then just reaches 4·F_c at its greatest, |v| = v_d/√2.
        let fastest = damping_velocity_needed * core::f64::consts::FRAC_1_SQRT_2;
        assert!((316.0 * libm::exp(-0.5) * fastest - 4.0).abs() < 1e-14);
        let sliding = SlidingFriction { viscous_damping: 158.0, ..PAPER.sliding };
        let quick = LuGreParams { damping_velocity: damping_velocity_needed, ..PAPER };
        let level = LuGreParams { sliding: SlidingFriction::coulomb(1.0, 0.0), ..PAPER };
        for params in [
            LuGreParams { sliding, ..PAPER },
            quick,
            level,
            LuGreParams { micro_damping: 0.0, ..PAPER },
        ] {
            assert_eq!(LuGre::new(params).unwrap().passivity(), Passivity::Passive, "{params:?}");
        }
        let slow = LuGreParams { damping_velocity: 1.01 * damping_velocity_needed, ..PAPER };
        assert_ne!(LuGre::new(slow).unwrap().passivity(), Passivity::Passive);
    }
}
