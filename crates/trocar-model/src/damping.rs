//! Damping of the seal while it deforms, sigma(zdot) of EMS (9).

use crate::error::{ParamError, check_fields};
use crate::parameter::{Blank, Field, Parameters, Quantity};

/// Seal damping, a polynomial of the deformation speed.
///
/// ```text
/// σ(ż) = s_0 + s_1·|ż| + s_2·ż²        D(ż) = σ(ż)·ż        (9)
/// ```
///
/// | symbol | field               | unit             | range                        |
/// |--------|---------------------|------------------|------------------------------|
/// | s_0    | `coefficients[0]`   | N·s/m            | >= 0                         |
/// | s_1    | `coefficients[1]`   | N·s²/m²          | >= -sqrt(3·s_0·s_2)          |
/// | s_2    | `coefficients[2]`   | N·s³/m³          | >= 0                         |
///
/// The ranges say that D never falls: then slip speed and force stay related one to one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SealDamping {
    /// s_0, s_1, s_2.
    pub coefficients: [f64; 3],
}

impl Parameters for SealDamping {
    const FIELDS: &'static [Field<Self>] = &[
        Field::new(
            Quantity::SealDamping,
            |own: &Self| own.coefficients[0],
            |own: &mut Self, value| own.coefficients[0] = value,
        )
        .with_key("constant_n_s_m"),
        Field::new(
            Quantity::SealDampingLinear,
            |own: &Self| own.coefficients[1],
            |own: &mut Self, value| own.coefficients[1] = value,
        )
        .with_key("linear_n_s2_m2"),
        Field::new(
            Quantity::SealDampingQuadratic,
            |own: &Self| own.coefficients[2],
            |own: &mut Self, value| own.coefficients[2] = value,
        )
        .with_key("quadratic_n_s3_m3"),
    ];
}

impl Blank for SealDamping {
    const BLANK: Self = Self { coefficients: [f64::NAN; 3] };
}

impl SealDamping {
    /// No damping, as EMS section IV finds for its trocar.
    pub const ZERO: Self = Self { coefficients: [0.0; 3] };

    /// Constant damping `seal_damping` = σ, N·s/m.
    pub const fn constant(seal_damping: f64) -> Self {
        Self { coefficients: [seal_damping, 0.0, 0.0] }
    }

    /// Whether there is no damping at all.
    pub fn is_zero(&self) -> bool {
        self.coefficients == [0.0; 3]
    }

    /// σ(ż), N·s/m, at deformation velocity ż, m/s.
    pub fn coefficient(&self, deformation_velocity: f64) -> f64 {
        let [s0, s1, s2] = self.coefficients;
        let speed = deformation_velocity.abs();
        s0 + speed * (s1 + speed * s2)
    }

    /// D(ż) = σ(ż)·ż, N, at deformation velocity ż, m/s.
    pub fn force(&self, deformation_velocity: f64) -> f64 {
        self.coefficient(deformation_velocity) * deformation_velocity // EMS (9)
    }

    /// dD/dż, N·s/m.
    pub(crate) fn slope(&self, deformation_velocity: f64) -> f64 {
        let [s0, s1, s2] = self.coefficients;
        let speed = deformation_velocity.abs();
        s0 + speed * (2.0 * s1 + speed * 3.0 * s2)
    }

    /// Smallest dD/dż over all speeds.
    pub(crate) fn least_slope(&self) -> f64 {
        let [s0, s1, s2] = self.coefficients;
        if s1 >= 0.0 && s2 >= 0.0 {
            s0
        } else if s2 > 0.0 {
            s0 - s1 * s1 / (3.0 * s2)
        } else {
            f64::NEG_INFINITY
        }
    }

    pub(crate) fn check(&self) -> Result<(), ParamError> {
        check_fields(self)?;
        let slope = self.least_slope();
        if slope < 0.0 { Err(ParamError::DampingForceFalls { slope }) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn force_is_odd() {
        let damping = SealDamping { coefficients: [1.0, 2.0, 3.0] };
        assert_eq!(damping.force(-0.2), -damping.force(0.2));
    }

    #[test]
    fn withdrawal_damping_force_is_refused() {
        assert!(SealDamping { coefficients: [1.0, -1.0, 0.0] }.check().is_err());
        assert!(SealDamping { coefficients: [1.0, -2.0, 1.0] }.check().is_err());
        assert!(SealDamping { coefficients: [1.0, -1.7, 1.0] }.check().is_ok());
        assert!(SealDamping { coefficients: [-1.0, 0.0, 0.0] }.check().is_err());
    }
}
