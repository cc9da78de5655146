//! A second stage: its parameters relative to the first.

use trocar_model::{DeformationForce, ElementParams, ParamError, SealDamping, SlidingFriction};

use super::shape::{BranchShape, EndForces};
use trocar_simulate::segment::Direction;

/// A second seal in parallel with the first, or the part of a lip that snaps through separately.
///
/// Its whole sliding curve and damping are a fixed share of the first's, since in steady sliding
/// only the sum is identifiable.
#[derive(Debug, Clone, PartialEq)]
pub struct SecondStage {
    /// Its sliding force relative to the first's.
    pub share: f64,
    /// c of the second stage, m.
    pub half_width: f64,
    /// Branch of the insertion.
    pub insertion_branch: BranchShape,
    /// Branch of the withdrawal.
    pub withdrawal_branch: BranchShape,
}

impl SecondStage {
    /// Initial degrees of the joined polynomials.
    pub const DEGREES: [usize; 2] = [2, 2];

    fn sliding(&self, first: &SlidingFriction) -> SlidingFriction {
        SlidingFriction {
            coulomb_force: self.share * first.coulomb_force,
            static_force: self.share * first.static_force,
            viscous_damping: self.share * first.viscous_damping,
            ..*first
        }
    }

    /// Forces at the ends of its branches beside a first stage that slides so.
    pub(super) fn end_forces(
        &self,
        insertion: &SlidingFriction,
        withdrawal: &SlidingFriction,
    ) -> EndForces {
        let force = |own: &SlidingFriction| self.sliding(own).static_force;
        EndForces { low: -force(withdrawal), high: force(insertion) }
    }

    /// Branch in `direction`.
    pub(super) fn branch(&self, direction: Direction) -> &BranchShape {
        direction.pick([&self.insertion_branch, &self.withdrawal_branch])
    }

    /// Its parameters beside the first element.
    pub(super) fn params(&self, first: &ElementParams) -> Result<ElementParams, ParamError> {
        let end_forces = self.end_forces(&first.insertion, &first.withdrawal);
        let [insertion_branch, withdrawal_branch] = Direction::BOTH
            .map(|direction| self.branch(direction).branch(self.half_width, end_forces));
        let softest = DeformationForce::new(insertion_branch?, withdrawal_branch?, None)?;
        let deformation = yielding(softest, 1.0)?;
        let [insertion, withdrawal] =
            [&first.insertion, &first.withdrawal].map(|own| self.sliding(own));
        let damping = self.share * first.damping.coefficients[0];
        Ok(ElementParams {
            damping: SealDamping { coefficients: [damping, 0.0, 0.0] },
            creep_velocity: first.creep_velocity,
            friction_lag: first.friction_lag,
            dwell_force: self.share * first.dwell_force,
            ..ElementParams::new(deformation, insertion, withdrawal)
        })
    }
}

/// The deformation force with κ at `factor` of its default, by the smooth form of it: a fit to
/// partial reversals presses on the steepest slope of the half gap until several deflections share
/// it, and from there no step to first order leads on.
pub(super) fn yielding(
    softest: DeformationForce,
    factor: f64,
) -> Result<DeformationForce, ParamError> {
    let stiffness = softest.smooth_yield_stiffness() * factor.max(1.0);
    DeformationForce::new(*softest.insertion(), *softest.withdrawal(), Some(stiffness))
}
