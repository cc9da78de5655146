//! How the joins are drawn, and how the curvature of a branch follows its join.
//!
//! ```text
//! a = Q(Φ((x_a − a_0)/s))                     x_a, s: join of the normal draw, its standard deviation; Q quantiles of the likelihood along the join
//! x(a) = x + p(a) − p(a_0) − g·(x_a − a_0)    p(a): polynomials with join a that fit best
//! ```
//! Nearly the same branch has many joins, each with its own coefficients x, on a curve over a. The
//! covariance has the linear part g of that curve; it is replaced by p(a). The likelihood along the
//! join may have several minima (identify/joins.rs); its quantiles replace the normal ones. For the
//! joins of a second stage, along which no likelihood is computed, a = x_a, and p(a) are the
//! polynomials nearest to those of the maximum. The map shifts x by a function of a alone.

use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ContinuousCDF, Normal};
use trocar_model::Direction;

use super::super::candidate::EmsTrial;
use super::super::joins::{Along, Joins};
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
    along: Option<(Along, Vec<(f64, f64)>)>,
}

impl FollowedJoin {
    /// Those of all branches that are free.
    pub(super) fn all(best: &EmsTrial, free: &[Free], joins: &Joins) -> Vec<Self> {
        let candidate = &best.candidate;
        let first = candidate.end_forces();
        let mut shapes: Vec<(BranchShape, EndForces, Option<Along>)> = Direction::BOTH
            .map(|d| (candidate.branch(d).clone(), first, joins.along(d).cloned()))
            .to_vec();
        if let Some(stage) = &candidate.second {
            let ends = stage.end_forces(&candidate.insertion, &candidate.withdrawal);
            shapes.push((stage.insertion_branch.clone(), ends, None));
            shapes.push((stage.withdrawal_branch.clone(), ends, None));
        }
        let joins = (0..free.len()).filter(|j| free[*j].kind == Some(Kind::Join));
        joins
            .zip(shapes)
            .map(|(join, (shape, end_forces, along))| {
                let along =
                    along.map(|along| (along.distribution(), along)).map(|(q, along)| (along, q));
                Self { join, shape, end_forces, along }
            })
            .collect()
    }

    /// The join at `deviates` standard deviations of a normal draw, and the branch with it.
    fn drawn(&self, join: f64, deviates: f64) -> Option<BranchShape> {
        let Some((along, distribution)) = &self.along else {
            let a = join.clamp(-BranchShape::JOIN_RANGE, BranchShape::JOIN_RANGE);
            return self.shape.with_join(a, self.end_forces);
        };
        let below = Normal::standard().cdf(deviates);
        let k = distribution.partition_point(|(_, part)| *part < below).max(1);
        let [from, to] = [k - 1, k].map(|k| distribution[k.min(distribution.len() - 1)]);
        let share = ((below - from.1) / (to.1 - from.1).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        along.branch_at(from.0 + share * (to.0 - from.0))
    }

    /// Draws the join of `values`, and adds the curved part to the other numbers of the branch;
    /// `factor` is that of their covariance.
    pub(super) fn follow(&self, factor: &DMatrix<f64>, values: &mut DVector<f64>) {
        let off = values[self.join] - self.shape.join;
        let row = factor.row(self.join);
        let variance = row.norm_squared();
        let Some(moved) = self.drawn(values[self.join], off / variance.sqrt()) else { return };
        let both = moved.numbers().into_iter().zip(self.shape.numbers());
        for (k, (there, here)) in both.enumerate() {
            let j = self.join + 1 + k;
            values[j] += there - here - factor.row(j).dot(&row) / variance * off;
        }
        if self.along.is_some() {
            values[self.join] = moved.join;
        }
    }
}
