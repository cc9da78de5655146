//! Sliding friction between seal and instrument: Coulomb, viscous and Stribeck, EMS (11).

use crate::error::{ParamError, check_fields};
use crate::exponential::{decay, power};
use crate::parameter::parameters;

/// Friction of the sliding contact in one direction of slip.
///
/// ```text
/// g(u)    = F_c + (F_s - F_c)·exp(-(u/v_s)^δ)        u = |v_sl|      (11)
/// F_sl(u) = g(u) + β·u                                              (11), (23) when F_s = F_c
/// ```
///
/// | symbol | field               | unit  | range            |
/// |--------|---------------------|-------|------------------|
/// | F_c    | `coulomb_force`     | N     | > 0              |
/// | F_s    | `static_force`      | N     | >= F_c           |
/// | v_s    | `stribeck_velocity` | m/s   | > 0              |
/// | δ      | `stribeck_exponent` | 1     | > 0; 2 in (11)   |
/// | β      | `viscous_damping`   | N·s/m | >= 0             |
///
/// At rest the force is set-valued, [-F_s, F_s]; the [`crate::Element`] resolves it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlidingFriction {
    /// F_c, N: sliding force at high speed without the viscous part, > 0.
    pub coulomb_force: f64,
    /// F_s, N: force at which slip begins, >= F_c. Called Stribeck force in EMS.
    pub static_force: f64,
    /// v_s, m/s, > 0: speed over which the force falls from F_s to F_c. Without effect when F_s =
    /// F_c.
    pub stribeck_velocity: f64,
    /// δ, pure number > 0: shape of the fall; 2 is the Gaussian of EMS (11). Without effect when
    /// F_s = F_c.
    pub stribeck_exponent: f64,
    /// β, N·s/m, >= 0.
    pub viscous_damping: f64,
}

parameters!(SlidingFriction {
    coulomb_force: CoulombForce,
    static_force: StaticForce,
    stribeck_velocity: StribeckVelocity,
    stribeck_exponent: StribeckExponent,
    viscous_damping: ViscousDamping,
});

impl SlidingFriction {
    /// Coulomb and viscous friction, EMS (23): F_s = F_c.
    pub const fn coulomb(coulomb_force: f64, viscous_damping: f64) -> Self {
        Self {
            coulomb_force,
            static_force: coulomb_force,
            // Without effect at F_s = F_c; 10 mm/s is the middle of the range met in seals.
            stribeck_velocity: 0.01,
            stribeck_exponent: 2.0,
            viscous_damping,
        }
    }

    /// g(u) of EMS (11), N, at slip speed `speed` = |v_sl| >= 0, m/s. The sign of `speed` is
    /// ignored.
    pub fn level(&self, speed: f64) -> f64 {
        if self.is_constant() {
            return self.coulomb_force;
        }
        self.coulomb_force
            + (self.static_force - self.coulomb_force) * decay(self.exponent(speed.abs())) // EMS (11)
    }

    /// g(u) + β·u, N: the sliding force at slip speed `speed` = |v_sl| >= 0, m/s. The sign of
    /// `speed` is ignored.
    pub fn force(&self, speed: f64) -> f64 {
        self.level(speed) + self.viscous_damping * speed.abs()
    }

    /// Whether g does not depend on speed: F_s = F_c.
    pub fn is_constant(&self) -> bool {
        self.static_force == self.coulomb_force
    }

    /// g(u) and dg/du for u >= 0. At u = 0 the slope is the limit from the right, minus infinity
    /// for δ < 1.
    pub(crate) fn level_and_slope(&self, u: f64) -> (f64, f64) {
        if self.is_constant() {
            return (self.coulomb_force, 0.0);
        }
        let power = self.exponent(u);
        let fall = (self.static_force - self.coulomb_force) * decay(power);
        (self.coulomb_force + fall, slope_of(fall, self.growth(u, power))) // EMS (11)
    }

    /// exp(-(u/v_s)^δ) where g(u) = `level` is known: the part of the static force's surplus that
    /// is there.
    #[inline(always)]
    pub(crate) fn rise(&self, level: f64) -> f64 {
        let surplus = self.static_force - self.coulomb_force;
        if surplus > 0.0 { (level - self.coulomb_force) / surplus } else { 1.0 }
    }

    /// dg/du at u >= 0 where g(u) = `level` is already known: saves the exponential.
    pub(crate) fn slope_at_level(&self, u: f64, level: f64) -> f64 {
        if self.is_constant() {
            0.0
        } else {
            slope_of(level - self.coulomb_force, self.growth(u, self.exponent(u)))
        }
    }

    /// (u/v_s)^δ; the two usual shapes avoid a power.
    #[inline]
    pub(crate) fn exponent(&self, u: f64) -> f64 {
        // The reciprocal does not wait for u: a division here would lengthen every step.
        let x = u * (1.0 / self.stribeck_velocity);
        if self.stribeck_exponent == 2.0 {
            x * x
        } else if self.stribeck_exponent == 1.0 {
            x
        } else {
            power(x, self.stribeck_exponent)
        }
    }

    /// Derivative by u of (u/v_s)^δ = `exponent`.
    #[inline]
    fn growth(&self, u: f64, exponent: f64) -> f64 {
        let (delta, inverse) = (self.stribeck_exponent, 1.0 / self.stribeck_velocity);
        if delta == 2.0 {
            2.0 * u * inverse * inverse
        } else if delta == 1.0 {
            inverse
        } else if u > 0.0 {
            delta * exponent / u
        } else if delta > 1.0 {
            0.0
        } else {
            f64::INFINITY
        }
    }

    /// Speed at which g falls fastest; 0 for δ <= 1.
    pub(crate) fn steepest_speed(&self) -> f64 {
        let delta = self.stribeck_exponent;
        if delta <= 1.0 {
            return 0.0;
        }
        self.stribeck_velocity * libm::pow((delta - 1.0) / delta, 1.0 / delta)
    }

    /// max |g'|, N·s/m; infinite for δ < 1.
    pub(crate) fn steepest_fall(&self) -> f64 {
        if self.is_constant() { 0.0 } else { -self.level_and_slope(self.steepest_speed()).1 }
    }

    pub(crate) fn check(&self) -> Result<(), ParamError> {
        check_fields(self)?;
        if self.static_force < self.coulomb_force {
            return Err(ParamError::StaticBelowCoulomb {
                static_force: self.static_force,
                coulomb_force: self.coulomb_force,
            });
        }
        Ok(())
    }
}

/// d/du of fall = (F_s - F_c)·exp(-p(u)) with dp/du = `growth`.
fn slope_of(fall: f64, growth: f64) -> f64 {
    if fall > 0.0 { -fall * growth } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameter::Quantity;

    #[test]
    fn stribeck_curve_runs_from_static_to_coulomb() {
        let sliding = SlidingFriction {
            coulomb_force: 2.0,
            static_force: 3.0,
            stribeck_velocity: 0.02,
            stribeck_exponent: 2.0,
            viscous_damping: 5.0,
        };
        assert_eq!(sliding.level(0.0), 3.0);
        assert!((sliding.level(0.02) - (2.0 + 1.0 / core::f64::consts::E)).abs() < 1e-15);
        assert_eq!(sliding.force(10.0), 52.0);
    }

    #[test]
    fn steepest_fall_is_the_known_constant_of_each_shape() {
        // δ((δ-1)/δ)^((δ-1)/δ)·e^(-(δ-1)/δ), found by numerical minimisation elsewhere.
        for (exponent, constant) in
            [(1.0, 1.0), (1.5, 0.745_223), (2.0, 0.857_764), (3.0, 1.175_432)]
        {
            let sliding = SlidingFriction {
                coulomb_force: 2.0,
                static_force: 3.0,
                stribeck_velocity: 0.02,
                stribeck_exponent: exponent,
                viscous_damping: 0.0,
            };
            assert!((sliding.steepest_fall() * 0.02 - constant).abs() < 1e-6, "{exponent}");
        }
    }

    #[test]
    fn bad_values_are_named() {
        let bad = SlidingFriction::coulomb(-0.3, 5.0).check();
        assert_eq!(
            bad,
            Err(ParamError::OutOfRange { id: Quantity::CoulombForce.id(), value: -0.3 })
        );
        let nan = SlidingFriction::coulomb(1.0, f64::NAN).check();
        assert!(
            matches!(nan, Err(ParamError::OutOfRange { id, .. }) if id == Quantity::ViscousDamping.id())
        );
    }
}
