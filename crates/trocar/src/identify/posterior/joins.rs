//! How the curvature of a branch follows its join.
//!
//! ```text
//! x(a) = x + p(a) − p(a_0) − g·(a − a_0)      p(a): joined polynomials with join a nearest to those of the maximum
//! ```
//! Nearly the same branch has many joins, each with its own coefficients x, on a curve over a. The
//! covariance has the linear part g of that curve; it is replaced by p(a). The map shifts x by a
//! function of a alone, so volumes stay the same.

use nalgebra::{DMatrix, DVector};

use super::super::candidate::EmsTrial;
use super::super::likelihood::Free;
use super::super::prior::Kind;
use super::super::shape::{BranchShape, EndForces};

/// The numbers of one branch among the free parameters: the join, and after it the force there and
/// the coefficients.
#[derive(Clone)]
pub(super) struct FollowedJoin {
    join: usize,
    shape: BranchShape,
    end_forces: EndForces,
}

impl FollowedJoin {
    /// Those of all branches that are free.
    pub(super) fn all(best: &EmsTrial, free: &[Free]) -> Vec<Self> {
        let candidate = &best.candidate;
        let first = candidate.end_forces();
        let mut shapes = vec![
            (candidate.insertion_branch.clone(), first),
            (candidate.withdrawal_branch.clone(), first),
        ];
        if let Some(stage) = &candidate.second {
            let ends = stage.end_forces(&candidate.insertion, &candidate.withdrawal);
            shapes.push((stage.insertion_branch.clone(), ends));
            shapes.push((stage.withdrawal_branch.clone(), ends));
        }
        let joins = (0..free.len()).filter(|j| free[*j].kind == Some(Kind::Join));
        let of = |(join, (shape, end_forces))| Self { join, shape, end_forces };
        joins.zip(shapes).map(of).collect()
    }

    /// Adds the curved part to `values`; `factor` is that of their covariance.
    pub(super) fn follow(&self, factor: &DMatrix<f64>, values: &mut DVector<f64>) {
        let a = values[self.join].clamp(-BranchShape::JOIN_RANGE, BranchShape::JOIN_RANGE);
        let off = a - self.shape.join;
        let Some(moved) = self.shape.with_join(a, self.end_forces) else { return };
        let row = factor.row(self.join);
        let variance = row.norm_squared();
        let numbers = |shape: &BranchShape| {
            let all = std::iter::once(shape.join_force).chain(shape.left.iter().copied());
            all.chain(shape.right.iter().copied()).collect::<Vec<_>>()
        };
        let both = numbers(&moved).into_iter().zip(numbers(&self.shape));
        for (k, (there, here)) in both.enumerate() {
            let j = self.join + 1 + k;
            values[j] += there - here - factor.row(j).dot(&row) / variance * off;
        }
    }
}
