//! A plausible seal for demonstrations and tests. **Not measured**: EMS prints none of its
//! identified values.

use crate::elastic::{Branch, DeformationForce, Piece};
use crate::ems::ElementParams;
use crate::error::ParamError;
use crate::sliding::SlidingFriction;

/// c, m. EMS discusses its figure 8 at 6 mm, and speaks of deformations of about 1 cm.
const HALF_WIDTH: f64 = 8e-3;

/// Join of the insertion branch, m: just past the hump, where the seal snaps through. The
/// withdrawal branch is its mirror image.
const JOIN: f64 = -2.2e-3;

/// Legendre coefficients of the insertion branch on [-c, join], N: from -3 N up to the hump. The
/// alternating sum is -3 N.
const INSERTION_LEFT: [f64; 5] = [0.0599, 1.988, -1.0966, 0.07, 0.0947];

/// Legendre coefficients of the insertion branch on [join, c], N: through the dip, then up again.
/// The sum is 3 N.
const INSERTION_RIGHT: [f64; 5] = [1.3073, 1.0433, 0.825, -0.1013, -0.0743];

/// F_c = F_s, N: within the 0.25 to 3 N reported for 5 to 12 mm trocars.
const COULOMB_FORCE: f64 = 3.0;

/// β, N·s/m.
const VISCOUS_DAMPING: f64 = 5.0;

impl ElementParams {
    /// A plausible one-stage 10.5 mm trocar: **made up**, with the shape of EMS figures 3 and 8 and
    /// forces of the usual size, since the paper prints no parameter values.
    ///
    /// F_c = F_s = 3 N and β = 5 N·s/m in both directions, c = 8 mm, no seal damping; a steep first
    /// rise to a hump of 1.15 N, a dip to 0.64 N (the seal snaps through, stiffness down to -0.25
    /// N/mm), a second rise to 3 N. The withdrawal branch is that of insertion turned about the
    /// origin, so the element is symmetric.
    ///
    /// # Errors
    /// None in practice: the values are constants, and a test builds them.
    pub fn plausible_10_5_mm() -> Result<Self, ParamError> {
        let insertion = Branch::new(
            Piece::new(-HALF_WIDTH, JOIN, &INSERTION_LEFT)?,
            Piece::new(JOIN, HALF_WIDTH, &INSERTION_RIGHT)?,
        )?;
        let withdrawal = Branch::new(
            Piece::new(-HALF_WIDTH, -JOIN, &turned(INSERTION_RIGHT))?,
            Piece::new(-JOIN, HALF_WIDTH, &turned(INSERTION_LEFT))?,
        )?;
        let sliding = SlidingFriction::coulomb(COULOMB_FORCE, VISCOUS_DAMPING);
        Ok(Self::new(DeformationForce::new(insertion, withdrawal, None)?, sliding, sliding))
    }
}

/// Legendre coefficients of -F(-z): the even ones change sign.
fn turned(mut legendre: [f64; 5]) -> [f64; 5] {
    for even in legendre.iter_mut().step_by(2) {
        *even = -*even;
    }
    legendre
}
