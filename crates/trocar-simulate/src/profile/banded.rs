//! Banded symmetric matrices, which result from hat functions and second differences when offset
//! and gain of a knot are adjacent.

/// Entries beside the diagonal: coupling over two knots with two values each.
const BAND: usize = 4;

/// A symmetric matrix, zero more than four places from the diagonal.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Banded {
    /// The entries of row i at column i − d.
    rows: Vec<[f64; BAND + 1]>,
}

impl Banded {
    pub(super) fn zero(size: usize) -> Self {
        Self { rows: vec![[0.0; BAND + 1]; size] }
    }

    /// Adds to the entry at (`i`, `j`), and thus at (`j`, `i`); for i ≥ j ≥ i − 4.
    pub(super) fn add(&mut self, i: usize, j: usize, value: f64) {
        self.rows[i][i - j] += value;
    }

    /// This matrix plus `sign` times `other`.
    pub(super) fn plus(&self, other: &Self, sign: f64) -> Self {
        let row = |(a, b): (&[f64; BAND + 1], &[f64; BAND + 1])| {
            std::array::from_fn(|d| a[d] + sign * b[d])
        };
        Self { rows: self.rows.iter().zip(&other.rows).map(row).collect() }
    }

    /// The matrix times `x`.
    pub(super) fn times(&self, x: &[f64]) -> Vec<f64> {
        let mut product = vec![0.0; x.len()];
        for (i, row) in self.rows.iter().enumerate() {
            product[i] += row[0] * x[i];
            for (d, entry) in row.iter().enumerate().skip(1).take(i) {
                product[i] += entry * x[i - d];
                product[i - d] += entry * x[i];
            }
        }
        product
    }

    /// The trace of the product of this matrix and `other`, where one of the two is zero outside
    /// the band.
    pub(super) fn trace_of_product(&self, other: &Self) -> f64 {
        self.rows
            .iter()
            .zip(&other.rows)
            .map(|(a, b)| a[0] * b[0] + 2.0 * (1..=BAND).map(|d| a[d] * b[d]).sum::<f64>())
            .sum()
    }

    /// The factor L of L·Lᵀ; `None` for a matrix that is not positive definite.
    pub(super) fn factor(&self) -> Option<Factor> {
        let mut rows: Vec<[f64; BAND + 1]> = Vec::with_capacity(self.rows.len());
        for (i, own) in self.rows.iter().enumerate() {
            let mut row = [0.0; BAND + 1];
            for d in (0..=BAND.min(i)).rev() {
                let j = i - d;
                let above = if d == 0 { row } else { rows[j] };
                // Columns common to both rows.
                let shared: f64 = (1..=BAND - d).map(|e| row[d + e] * above[e]).sum();
                let left = own[d] - shared;
                row[d] = if d > 0 { left / rows[j][0] } else { left.sqrt() };
            }
            if !(row[0] > 0.0 && row[0].is_finite()) {
                return None;
            }
            rows.push(row);
        }
        Some(Factor { rows })
    }
}

/// A Cholesky factor of a [`Banded`] matrix.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Factor {
    rows: Vec<[f64; BAND + 1]>,
}

impl Factor {
    /// Solves matrix·x = `right`.
    pub(super) fn solve(&self, right: &[f64]) -> Vec<f64> {
        let mut x = right.to_vec();
        for (i, row) in self.rows.iter().enumerate() {
            let known: f64 = (1..=BAND.min(i)).map(|d| row[d] * x[i - d]).sum();
            x[i] = (x[i] - known) / row[0];
        }
        for (i, row) in self.rows.iter().enumerate().rev() {
            x[i] /= row[0];
            (1..=BAND.min(i)).for_each(|d| x[i - d] -= row[d] * x[i]);
        }
        x
    }

    /// The entries of the inverse of L·Lᵀ = A within the band of A; the others count as zero.
    ///
    /// Row i of Lᵀ·A⁻¹ = L⁻¹, which is zero above the diagonal, gives them from those of the rows
    /// below (Takahashi's equations).
    pub(super) fn inverse_in_band(&self) -> Banded {
        let size = self.rows.len();
        let mut inverse = Banded::zero(size);
        for i in (0..size).rev() {
            let last = (i + BAND).min(size - 1);
            for j in (i..=last).rev() {
                let entry = |k: usize| inverse.rows[k.max(j)][k.abs_diff(j)];
                let below: f64 = (i + 1..=last).map(|k| self.rows[k][k - i] * entry(k)).sum();
                let unit = if i == j { 1.0 / self.rows[i][0] } else { 0.0 };
                inverse.rows[j][j - i] = (unit - below) / self.rows[i][0];
            }
        }
        inverse
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Far from diagonal.
    fn matrix(size: usize) -> Banded {
        let mut matrix = Banded::zero(size);
        for i in 0..size {
            (0..=BAND.min(i)).for_each(|d| {
                matrix.add(i, i - d, if d == 0 { 9.0 } else { ((i * d) as f64).sin() })
            });
        }
        matrix
    }

    #[test]
    fn solving_undoes_multiplying() {
        let matrix = matrix(23);
        let x: Vec<f64> = (0..23).map(|i| f64::from(i).cos()).collect();
        let found = matrix.factor().expect("diagonally dominant").solve(&matrix.times(&x));
        assert!(found.iter().zip(&x).all(|(a, b)| (a - b).abs() < 1e-13));
        assert!(Banded::zero(3).factor().is_none());
    }

    /// Checked column by column, and as the product of a matrix and its inverse.
    #[test]
    fn the_inverse_is_what_solving_finds() {
        for size in [1, 3, 23] {
            let matrix = matrix(size);
            let factor = matrix.factor().expect("diagonally dominant");
            let inverse = factor.inverse_in_band();
            for j in 0..size {
                let mut unit = vec![0.0; size];
                unit[j] = 1.0;
                let column = factor.solve(&unit);
                assert!(
                    (j..size.min(j + BAND + 1))
                        .all(|i| (inverse.rows[i][i - j] - column[i]).abs() < 1e-15)
                );
            }
            assert!((matrix.trace_of_product(&inverse) - size as f64).abs() < 1e-12);
        }
    }
}
