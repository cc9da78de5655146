//! One branch of the deformation force as free parameters: fixed at both ends, joined in between
//! (EMS (25)).
//!
//! On its own interval each polynomial is the chord between its end values plus Legendre
//! polynomials modified to vanish at both ends. The end-point constraints at ±c and the continuity
//! at the join then hold by construction. For a given join the fit is therefore an ordinary linear
//! least-squares problem (condition number about 3, against 1e9 for monomials in metres).

use nalgebra::{DMatrix, DVector};
use trocar_model::{Branch, ParamError, Piece};

use super::prior::Kind;

/// What a free parameter is, the step of its difference quotient, its range, and its prior.
#[derive(Debug, Clone, Copy)]
pub(super) struct Span {
    pub(super) kind: Kind,
    pub(super) step: f64,
    pub(super) low: f64,
    pub(super) high: f64,
    /// Standard deviation of the prior about 0; infinite without a prior.
    pub(super) expected: f64,
}

impl Span {
    pub(super) fn new(kind: Kind, step: f64, [low, high]: [f64; 2]) -> Self {
        Self { kind, step, low, high, expected: f64::INFINITY }
    }
}

/// Shape of one branch over z/c in [-1, 1].
#[derive(Debug, Clone, PartialEq)]
pub struct BranchShape {
    /// Join, as a fraction of the half width, in (-1, 1).
    pub join: f64,
    /// Force at the join, N.
    pub join_force: f64,
    /// Legendre coefficients of order 2 and up of the left piece, N.
    pub left: Vec<f64>,
    /// Legendre coefficients of order 2 and up of the right piece, N.
    pub right: Vec<f64>,
}

/// Forces, N, at -c and +c through which both branches pass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EndForces {
    /// Force at -c, negative.
    pub low: f64,
    /// Force at +c, positive.
    pub high: f64,
}

/// Legendre polynomials of order 2 and up at `t`, each minus the chord between its end values: 0 at
/// t = ±1.
fn bent_legendre(t: f64, values: &mut [f64]) {
    let (mut before, mut now) = (1.0, t);
    for (k, value) in values.iter_mut().enumerate() {
        let order = (k + 2) as f64;
        (before, now) = (now, ((2.0 * order - 1.0) * t * now - (order - 1.0) * before) / order);
        *value = now - if k.is_multiple_of(2) { 1.0 } else { t };
    }
}

fn legendre_coefficients(low: f64, high: f64, higher: &[f64]) -> Vec<f64> {
    let mut all = vec![0.5 * (low + high), 0.5 * (high - low)];
    for (k, value) in higher.iter().enumerate() {
        all[k % 2] -= value;
        all.push(*value);
    }
    all
}

impl BranchShape {
    /// Largest magnitude of the join: nearer to an end, the shorter polynomial would have no data.
    pub(crate) const JOIN_RANGE: f64 = 0.7;

    /// Whether the join is at an end of its range: no minimum was found inside.
    pub(crate) fn join_at_bound(&self) -> bool {
        self.join.abs() > 0.99 * Self::JOIN_RANGE
    }

    /// Straight from a join force of 0 N in the middle to both end points, with coefficients for
    /// polynomials of these degrees.
    pub(super) fn straight([left, right]: [usize; 2]) -> Self {
        Self { join: 0.0, join_force: 0.0, left: vec![0.0; left - 1], right: vec![0.0; right - 1] }
    }

    /// The shape of an existing branch: the inverse of [`BranchShape::branch`].
    pub(super) fn of(branch: &Branch) -> Self {
        let higher = |piece: &Piece| piece.legendre().get(2..).unwrap_or_default().to_vec();
        Self {
            join: branch.join() / branch.half_width(),
            join_force: branch.force(branch.join()),
            left: higher(branch.left()),
            right: higher(branch.right()),
        }
    }

    /// Degrees of the left and the right polynomial.
    pub fn degrees(&self) -> [usize; 2] {
        [self.left.len() + 1, self.right.len() + 1]
    }

    /// Visits every free parameter. `force` (N) is the step of forces, `sliding` (N) the sliding
    /// force, of which ten times bounds their range, and `bend` (N) the prior standard deviation of
    /// the curvature terms.
    pub(super) fn visit(
        &mut self,
        force: f64,
        [sliding, bend]: [f64; 2],
        on: &mut impl FnMut(&mut f64, Span),
    ) {
        on(&mut self.join, Span::new(Kind::Join, 1e-3, [-Self::JOIN_RANGE, Self::JOIN_RANGE]));
        let of_force = Span::new(Kind::JoinForce, force, [-10.0 * sliding, 10.0 * sliding]);
        on(&mut self.join_force, of_force);
        for value in self.left.iter_mut().chain(&mut self.right) {
            on(value, Span { kind: Kind::Bend, expected: bend, ..of_force });
        }
    }

    /// The branch over [-half_width, half_width], m, through `end_forces`.
    ///
    /// # Errors
    /// When the parameters do not form a valid branch (join outside the width, values not finite).
    pub fn branch(&self, half_width: f64, end_forces: EndForces) -> Result<Branch, ParamError> {
        let join = self.join * half_width;
        let left = legendre_coefficients(end_forces.low, self.join_force, &self.left);
        let right = legendre_coefficients(self.join_force, end_forces.high, &self.right);
        Branch::new(Piece::new(-half_width, join, &left)?, Piece::new(join, half_width, &right)?)
    }

    /// Writes the design row at `u` = z/c into `row`; returns the part of the force that the end
    /// points fix.
    fn row(join: f64, degrees: [usize; 2], end_forces: EndForces, u: f64, row: &mut [f64]) -> f64 {
        row.fill(0.0);
        let [left, right] = degrees.map(|d| d - 1);
        let (t, fixed, first, count) = if u < join {
            let t = (2.0 * u - (join - 1.0)) / (join + 1.0);
            row[0] = 0.5 * (1.0 + t);
            (t, 0.5 * (1.0 - t) * end_forces.low, 1, left)
        } else {
            let t = (2.0 * u - (1.0 + join)) / (1.0 - join);
            row[0] = 0.5 * (1.0 - t);
            (t, 0.5 * (1.0 + t) * end_forces.high, 1 + left, right)
        };
        bent_legendre(t, &mut row[first..first + count]);
        fixed
    }

    /// The numbers of the shape after its join, in the order of [`BranchShape::visit`].
    pub(super) fn numbers(&self) -> Vec<f64> {
        let higher = self.left.iter().chain(&self.right);
        std::iter::once(&self.join_force).chain(higher).copied().collect()
    }

    /// The shape with these `degrees` and numbers after its join.
    pub(super) fn from_numbers(join: f64, degrees: [usize; 2], numbers: &[f64]) -> Self {
        Self {
            join,
            join_force: numbers[0],
            left: numbers[1..degrees[0]].to_vec(),
            right: numbers[degrees[0]..].to_vec(),
        }
    }

    /// The forces at each of `at`, z/c, and after them the slope at the end `end` = ±1, N: a matrix
    /// times the numbers after the join, plus a vector.
    pub(super) fn ordinates(
        join: f64,
        degrees: [usize; 2],
        end_forces: EndForces,
        at: impl Iterator<Item = f64>,
        end: f64,
    ) -> (DMatrix<f64>, DVector<f64>) {
        // Difference quotient of a polynomial of low degree.
        const STEP: f64 = 1e-5;
        let columns = degrees[0] + degrees[1] - 1;
        let row = |u: f64| {
            let mut row = vec![0.0; columns];
            let fixed = Self::row(join, degrees, end_forces, u, &mut row);
            (DVector::from_vec(row), fixed)
        };
        let (at_end, inside) = (row(end), row(end - end * STEP));
        let slope = |a: f64, b: f64| (a - b) / (end * STEP);
        let of_slope = (at_end.0.zip_map(&inside.0, slope), slope(at_end.1, inside.1));
        let rows: Vec<(DVector<f64>, f64)> = at.map(row).chain([of_slope]).collect();
        let matrix = DMatrix::from_fn(rows.len(), columns, |i, j| rows[i].0[j]);
        (matrix, DVector::from_iterator(rows.len(), rows.iter().map(|row| row.1)))
    }

    /// Least squares for a given join (EMS (26)): the shape and the mean square residual, N².
    ///
    /// The basis is so well conditioned that the normal equations lose no accuracy.
    fn fit_at(
        join: f64,
        degrees: [usize; 2],
        end_forces: EndForces,
        points: &[(f64, f64)],
    ) -> Option<(Self, f64)> {
        let columns = degrees[0] + degrees[1] - 1;
        let mut normal = DMatrix::<f64>::zeros(columns, columns);
        let mut moment = DVector::<f64>::zeros(columns);
        let mut squares = 0.0f64;
        let mut row = vec![0.0; columns];
        for (u, force) in points {
            let rest = force - Self::row(join, degrees, end_forces, *u, &mut row);
            squares += rest * rest;
            for (j, a) in row.iter().enumerate().filter(|(_, a)| **a != 0.0) {
                moment[j] += a * rest;
                row[j..].iter().enumerate().for_each(|(k, b)| normal[(j + k, j)] += a * b);
            }
        }
        let theta = normal.cholesky()?.solve(&moment);
        let left_over: f64 = squares - theta.dot(&moment);
        let shape = Self::from_numbers(join, degrees, theta.as_slice());
        Some((shape, left_over.max(0.0) / points.len() as f64))
    }

    /// The shape with another join that comes nearest to this one.
    pub(super) fn with_join(&self, join: f64, end_forces: EndForces) -> Option<Self> {
        const POINTS: usize = 60;
        let branch = self.branch(1.0, end_forces).ok()?;
        let at = |k: usize| 2.0 * (k as f64 + 0.5) / POINTS as f64 - 1.0;
        let points: Vec<(f64, f64)> = (0..POINTS).map(|k| (at(k), branch.force(at(k)))).collect();
        Self::fit_at(join, self.degrees(), end_forces, &points).map(|found| found.0)
    }

    /// The shape `share` of the way to another one of the same degrees.
    pub(super) fn towards(&self, other: &Self, share: f64) -> Self {
        let mix = |from: f64, to: f64| from + share * (to - from);
        let all =
            |from: &[f64], to: &[f64]| from.iter().zip(to).map(|(a, b)| mix(*a, *b)).collect();
        Self {
            join: mix(self.join, other.join),
            join_force: mix(self.join_force, other.join_force),
            left: all(&self.left, &other.left),
            right: all(&self.right, &other.right),
        }
    }

    /// Least squares including the join: a grid over the inner 70 % of the width, then golden
    /// section in the best cell.
    ///
    /// `points` are (z/c, force in N). Returns the shape and its root mean square residual, N.
    pub fn fit(
        degrees: [usize; 2],
        end_forces: EndForces,
        points: &[(f64, f64)],
    ) -> Option<(Self, f64)> {
        const CELLS: usize = 56;
        let join_at = |k: usize| Self::JOIN_RANGE * (2.0 * k as f64 / CELLS as f64 - 1.0);
        let cost = |join: f64| {
            Self::fit_at(join, degrees, end_forces, points).map_or(f64::INFINITY, |f| f.1)
        };
        let costs: Vec<f64> = (0..=CELLS).map(|k| cost(join_at(k))).collect();
        let best = (0..=CELLS).min_by(|a, b| costs[*a].total_cmp(&costs[*b]))?;
        let (mut low, mut high) = (join_at(best.saturating_sub(1)), join_at((best + 1).min(CELLS)));
        let golden = 0.5 * (5f64.sqrt() - 1.0);
        for _ in 0..20 {
            let (a, b) = (high - golden * (high - low), low + golden * (high - low));
            if cost(a) < cost(b) { high = b } else { low = a }
        }
        let join = [0.5 * (low + high), join_at(best)]
            .into_iter()
            .min_by(|a, b| cost(*a).total_cmp(&cost(*b)))?;
        let (shape, mean_square) = Self::fit_at(join, degrees, end_forces, points)?;
        Some((shape, mean_square.sqrt()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_branch_meets_its_end_forces_and_is_continuous_for_any_numbers() {
        let shape = BranchShape {
            join: -0.3,
            join_force: 1.3,
            left: vec![0.7, -0.2, 0.4],
            right: vec![-0.5, 0.1, 0.9],
        };
        let end_forces = EndForces { low: -2.0, high: 2.5 };
        let branch = shape.branch(8e-3, end_forces).expect("finite numbers");
        assert!((branch.force(-8e-3) - -2.0).abs() < 1e-12);
        assert!((branch.force(8e-3) - 2.5).abs() < 1e-12);
        assert!((branch.force(-2.4e-3 - 1e-12) - branch.force(-2.4e-3 + 1e-12)).abs() < 1e-8);
        assert!((branch.force(-2.4e-3) - 1.3).abs() < 1e-8);
    }

    #[test]
    fn a_branch_of_its_own_kind_is_recovered_with_its_join() {
        let truth = BranchShape {
            join: -0.275,
            join_force: 1.0,
            left: vec![-1.2, 0.5, 0.2],
            right: vec![0.6, -0.3, 0.1],
        };
        let end_forces = EndForces { low: -3.0, high: 3.0 };
        let branch = truth.branch(1.0, end_forces).expect("finite numbers");
        let points: Vec<_> =
            (0..200).map(|k| -1.0 + 2.0 * k as f64 / 199.0).map(|u| (u, branch.force(u))).collect();
        let (found, rms) = BranchShape::fit([4, 4], end_forces, &points).expect("enough points");
        assert!(rms < 1e-4, "{rms}");
        assert!((found.join - truth.join).abs() < 1e-3, "{}", found.join);
        assert!((found.join_force - truth.join_force).abs() < 5e-3, "{}", found.join_force);
    }
}
