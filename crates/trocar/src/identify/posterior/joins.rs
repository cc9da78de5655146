//! How the joins of the branches are drawn, and how the other numbers of a branch follow them.
//!
//! ```text
//! ln p(a) = −½·q²·D(a)        D: likelihood along the join (identify/joins.rs); where D = 1 the 95 % interval ends, q = 1.96
//! a = P⁻¹(Φ(z))               P: distribution function of p
//! x(a) = x + x_a − x_â        x_a: numbers of the branch of the best fit with the join a
//! ```
//! Nearly the same branch has many joins, each with its own coefficients x, on a curve over a, and
//! the best join need not be the middle of those within reach. The covariance has the linear part of
//! that curve; it is replaced by x_a. For a branch without a likelihood along its join, p is normal,
//! and x_a are the polynomials nearest to those of the maximum.

use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ContinuousCDF, Normal};
use trocar_model::Direction;

use super::super::candidate::EmsTrial;
use super::super::joins::{Joins, Point};
use super::super::likelihood::{Free, Trial};
use super::super::prior::Kind;
use super::super::shape::{BranchShape, EndForces};

/// q.
const IN_95: f64 = 1.96;
/// Parts of a cell between two joins of the likelihood along it.
const PARTS: usize = 8;
/// Range and distance of the joins of a normal p, in standard deviations.
const NORMAL: (f64, f64) = (3.0, 0.25);

/// The join of one branch: its number among the free parameters, and after it the force there and
/// the coefficients.
#[derive(Clone)]
pub(super) struct DrawnJoin {
    join: usize,
    /// Joins from lowest to highest, P, and x_a − x_â.
    nodes: Vec<Node>,
}

#[derive(Clone)]
struct Node {
    join: f64,
    below: f64,
    change: Vec<f64>,
}

/// A join, its D, and the numbers of the branch.
struct Tried {
    join: f64,
    excess: f64,
    numbers: Vec<f64>,
}

fn numbers(shape: &BranchShape) -> Vec<f64> {
    let bends = shape.left.iter().chain(&shape.right).copied();
    std::iter::once(shape.join_force).chain(bends).collect()
}

impl DrawnJoin {
    /// Those of all branches that are free; `factor` is that of the covariance of the draws.
    pub(super) fn all(best: &EmsTrial, joins: &Joins, factor: &DMatrix<f64>) -> Vec<Self> {
        let free: Vec<Free> = best.free();
        let own = (0..free.len()).filter(|j| free[*j].kind == Some(Kind::Join));
        let shapes = shapes(best);
        own.zip(&shapes)
            .enumerate()
            .map(|(k, (join, (shape, ends)))| {
                let direction = Direction::BOTH.get(k);
                let along = direction.and_then(|direction| joins.along(*direction));
                let tried = match (along, direction) {
                    (Some(along), Some(direction)) => {
                        along.points.iter().map(|point| Tried::of(point, *direction)).collect()
                    }
                    _ => nearest(shape, *ends, factor.row(join).norm()),
                };
                Self { join, nodes: nodes(&tried) }
            })
            .collect()
    }

    /// Sets the join of coordinate `knot`, of the value `z`, and the numbers of its branch.
    pub(super) fn follow(
        &self,
        factor: &DMatrix<f64>,
        (knot, z): (usize, f64),
        values: &mut DVector<f64>,
    ) {
        let below = Normal::standard().cdf(z);
        let last = self.nodes.len() - 1;
        let right = self.nodes.partition_point(|node| node.below < below).clamp(1, last.max(1));
        let Some((low, high)) = self.nodes.get(right - 1).zip(self.nodes.get(right)) else {
            return;
        };
        let width = (high.below - low.below).max(f64::MIN_POSITIVE);
        let x = ((below - low.below) / width).clamp(0.0, 1.0);
        values[self.join] = low.join + x * (high.join - low.join);
        for (k, (from, to)) in low.change.iter().zip(&high.change).enumerate() {
            let j = self.join + 1 + k;
            values[j] += from + x * (to - from) - factor[(j, knot)] * z;
        }
    }
}

impl Tried {
    fn of(point: &Point, direction: Direction) -> Self {
        let shape = point.trial.candidate.branch(direction);
        Self { join: point.join, excess: point.excess, numbers: numbers(shape) }
    }
}

/// The branches in the order of their joins, each with the forces at its ends.
fn shapes(best: &EmsTrial) -> Vec<(BranchShape, EndForces)> {
    let candidate = &best.candidate;
    let ends = candidate.end_forces();
    let mut shapes = vec![
        (candidate.insertion_branch.clone(), ends),
        (candidate.withdrawal_branch.clone(), ends),
    ];
    if let Some(stage) = &candidate.second {
        let ends = stage.end_forces(&candidate.insertion, &candidate.withdrawal);
        shapes.push((stage.insertion_branch.clone(), ends));
        shapes.push((stage.withdrawal_branch.clone(), ends));
    }
    shapes
}

/// Joins with the standard deviation `sd` about that of `shape`.
fn nearest(shape: &BranchShape, ends: EndForces, sd: f64) -> Vec<Tried> {
    let (range, apart) = NORMAL;
    let count = (range / apart).round() as i32;
    let of = |k: i32| {
        let off = f64::from(k) * apart;
        let join = shape.join + off * sd;
        let moved = shape.with_join(join, ends)?;
        let is_within = join.abs() <= BranchShape::JOIN_RANGE;
        let excess = (off / IN_95).powi(2);
        is_within.then(|| Tried { join, excess, numbers: numbers(&moved) })
    };
    (-count..=count).filter_map(of).collect()
}

/// P over the joins that were tried.
fn nodes(tried: &[Tried]) -> Vec<Node> {
    let Some(best) = tried.iter().min_by(|a, b| a.excess.total_cmp(&b.excess)) else {
        return Vec::new();
    };
    let density = |excess: f64| (-0.5 * IN_95 * IN_95 * excess).exp();
    let change = |of: &Tried| -> Vec<f64> {
        of.numbers.iter().zip(&best.numbers).map(|(there, here)| there - here).collect()
    };
    let mut nodes = vec![Node { join: tried[0].join, below: 0.0, change: change(&tried[0]) }];
    let mut last = density(tried[0].excess);
    for pair in tried.windows(2) {
        let [from, to] = [change(&pair[0]), change(&pair[1])];
        for part in 1..=PARTS {
            let x = part as f64 / PARTS as f64;
            let here = density(between(pair[0].excess, pair[1].excess, x));
            let width = (pair[1].join - pair[0].join) / PARTS as f64;
            let below = nodes.last().map_or(0.0, |node| node.below) + 0.5 * (last + here) * width;
            nodes.push(Node {
                join: pair[0].join + x * (pair[1].join - pair[0].join),
                below,
                change: from.iter().zip(&to).map(|(a, b)| a + x * (b - a)).collect(),
            });
            last = here;
        }
    }
    let whole = nodes.last().map_or(1.0, |node| node.below).max(f64::MIN_POSITIVE);
    nodes.iter_mut().for_each(|node| node.below /= whole);
    nodes
}

/// D between two joins: a parabola about the lower one.
fn between(left: f64, right: f64, x: f64) -> f64 {
    if left <= right {
        left + (right - left) * x * x
    } else {
        right + (left - right) * (1.0 - x) * (1.0 - x)
    }
}
