//! Least squares with coefficients that may not be negative (LAWSON), on normal equations.

use nalgebra::{DMatrix, DVector};

/// Gradients below this part of the largest count as zero.
const TOLERANCE: f64 = 1e-10;

/// Minimises |A·x − b|² over x with x_j >= 0 where `free[j]` is false, given AᵀA and Aᵀb.
///
/// The minimum is global (the problem is convex). `None` when the free columns are not independent.
pub(super) fn non_negative(
    gram: &DMatrix<f64>,
    moment: &DVector<f64>,
    free: &[bool],
) -> Option<DVector<f64>> {
    let p = moment.len();
    let scale = DVector::from_fn(p, |j, _| gram[(j, j)].max(f64::MIN_POSITIVE).sqrt());
    let gram = DMatrix::from_fn(p, p, |i, j| gram[(i, j)] / (scale[i] * scale[j]));
    let moment = moment.component_div(&scale);
    let least = TOLERANCE * moment.amax();
    let mut active = free.to_vec();
    let mut x = solve(&gram, &moment, &active)?;
    // Every round lowers the squared error, so no set of active columns recurs.
    for _ in 0..10 * p {
        let gradient = &moment - &gram * &x;
        let best =
            (0..p).filter(|j| !active[*j]).max_by(|a, b| gradient[*a].total_cmp(&gradient[*b]));
        let Some(entering) = best.filter(|j| gradient[*j] > least) else { break };
        active[entering] = true;
        let Some(next) = step_back_inside(&gram, &moment, free, &mut active, &x) else {
            // A column that depends on the others does not help.
            active[entering] = false;
            break;
        };
        x = next;
    }
    Some(x.component_div(&scale))
}

/// The solution on the active columns; columns that become negative are dropped one by one on the
/// path from `x`.
fn step_back_inside(
    gram: &DMatrix<f64>,
    moment: &DVector<f64>,
    free: &[bool],
    active: &mut [bool],
    x: &DVector<f64>,
) -> Option<DVector<f64>> {
    let mut x = x.clone();
    loop {
        let target = solve(gram, moment, active)?;
        let negative = (0..x.len()).filter(|j| active[*j] && !free[*j] && target[*j] <= 0.0);
        let part = |j: usize| x[j] / (x[j] - target[j]);
        let Some(first) = negative.min_by(|a, b| part(*a).total_cmp(&part(*b))) else {
            return Some(target);
        };
        let part = part(first);
        x += part * (target - &x);
        x[first] = 0.0;
        active[first] = false;
    }
}

/// Solution on the active columns, zero elsewhere.
fn solve(gram: &DMatrix<f64>, moment: &DVector<f64>, active: &[bool]) -> Option<DVector<f64>> {
    let own: Vec<usize> = (0..moment.len()).filter(|j| active[*j]).collect();
    let part = DMatrix::from_fn(own.len(), own.len(), |i, j| {
        gram[(own[i], own[j])] + if i == j { 1e-13 } else { 0.0 }
    });
    let solution = part.cholesky()?.solve(&DVector::from_fn(own.len(), |i, _| moment[own[i]]));
    let mut x = DVector::zeros(moment.len());
    own.iter().zip(solution.iter()).for_each(|(j, value)| x[*j] = *value);
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// At the minimum the gradient vanishes where x > 0 and points outwards where x = 0 (Karush,
    /// Kuhn and Tucker): for a convex problem that is also sufficient.
    #[test]
    fn conditions_of_the_minimum_hold() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut held = 0;
        for _ in 0..200 {
            let a = DMatrix::from_fn(30, 8, |_, _| rng.random::<f64>() - 0.3);
            let b = DVector::from_fn(30, |_, _| rng.random::<f64>() - 0.5);
            let (gram, moment) = (a.transpose() * &a, a.transpose() * &b);
            let free: Vec<bool> = (0..8).map(|j| j == 2).collect();
            let x = non_negative(&gram, &moment, &free).expect("random columns are independent");
            let gradient = &moment - &gram * &x;
            for j in 0..8 {
                if free[j] || x[j] > 0.0 {
                    assert!(gradient[j].abs() < 1e-8, "column {j}: {}", gradient[j]);
                } else {
                    held += 1;
                    assert!(
                        x[j] == 0.0 && gradient[j] < 1e-8,
                        "column {j}: {} at {}",
                        gradient[j],
                        x[j]
                    );
                }
            }
        }
        assert!(held > 100, "too few bounds were active for the test to mean anything: {held}");
    }

    #[test]
    fn repeated_columns_do_no_harm() {
        let a = DMatrix::from_fn(20, 3, |i, j| if j < 2 { i as f64 } else { 1.0 });
        let b = DVector::from_fn(20, |i, _| 2.0 * i as f64 + 1.0);
        let x = non_negative(&(a.transpose() * &a), &(a.transpose() * &b), &[false; 3])
            .expect("no free column");
        assert!((&a * x - b).norm() < 1e-5);
    }
}
