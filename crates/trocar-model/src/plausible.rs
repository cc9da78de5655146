//! A plausible seal for demonstrations and tests. **Not measured**: EMS prints none of its identified values.

use crate::damping::SealDamping;
use crate::elastic::{Branch, DeformationForce, Piece};
use crate::ems::ElementParams;
use crate::error::ParamError;
use crate::relaxation::Relaxation;
use crate::sliding::SlidingFriction;

/// c, m. EMS discusses its figure 8 at 6 mm, and speaks of deformations of about 1 cm.
const HALF_WIDTH: f64 = 8e-3;

/// Join of the rising branch, m: just past the hump, where the seal snaps through. The falling branch is its mirror image.
const JOIN: f64 = -2.2e-3;

/// Legendre coefficients of the rising branch on [-c, join], N: from -3 N up to the hump. The alternating sum is -3 N.
const RISING_LEFT: [f64; 5] = [0.0599, 1.988, -1.0966, 0.07, 0.0947];

/// Legendre coefficients of the rising branch on [join, c], N: through the dip, then up again. The sum is 3 N.
const RISING_RIGHT: [f64; 5] = [1.3073, 1.0433, 0.825, -0.1013, -0.0743];

/// F_c = F_s, N: within the 0.25 to 3 N reported for 5 to 12 mm trocars.
const COULOMB_FORCE: f64 = 3.0;

/// β, N·s/m.
const VISCOUS_DAMPING: f64 = 5.0;

impl ElementParams {
    /// A plausible one-stage 10.5 mm trocar: **made up**, with the shape of EMS figures 3 and 8 and forces of the usual
    /// size, since the paper prints no parameter values.
    ///
    /// F_c = F_s = 3 N and β = 5 N·s/m in both directions, c = 8 mm, no seal damping; a steep first rise to a hump of
    /// 1.15 N, a dip to 0.64 N (the seal snaps through, stiffness down to -0.25 N/mm), a second rise to 3 N. The falling
    /// branch is the rising one turned about the origin, so the element is symmetric.
    ///
    /// # Errors
    /// None in practice: the values are constants, and a test builds them.
    pub fn plausible_10_5_mm() -> Result<Self, ParamError> {
        let rising =
            Branch::new(Piece::new(-HALF_WIDTH, JOIN, &RISING_LEFT)?, Piece::new(JOIN, HALF_WIDTH, &RISING_RIGHT)?)?;
        let falling = Branch::new(
            Piece::new(-HALF_WIDTH, -JOIN, &turned(RISING_RIGHT))?,
            Piece::new(-JOIN, HALF_WIDTH, &turned(RISING_LEFT))?,
        )?;
        let sliding = SlidingFriction::coulomb(COULOMB_FORCE, VISCOUS_DAMPING);
        Ok(Self {
            deformation: DeformationForce::new(rising, falling, None)?,
            damping: SealDamping::ZERO,
            insertion: sliding,
            withdrawal: sliding,
            creep_velocity: 0.0,
            friction_lag: 0.0,
            relaxation: Relaxation::NONE,
        })
    }
}

/// Legendre coefficients of -F(-z): the even ones change sign.
fn turned(mut legendre: [f64; 5]) -> [f64; 5] {
    for even in legendre.iter_mut().step_by(2) {
        *even = -*even;
    }
    legendre
}
