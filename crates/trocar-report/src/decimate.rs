//! Decimation: dense series are reduced to the printed resolution before they are drawn.

use std::collections::HashSet;

/// Indices of points that draw the same polyline as all points, at most about `limit` of them,
/// increasing.
///
/// Consecutive points within one of `columns` columns of `[low, high]` are replaced by the first,
/// the lowest, the highest and the last of them. So every peak is kept, and x need not be sorted
/// (loops). Columns are widened until the limit is met. A non-finite point is kept once per gap.
pub(super) fn path(
    x: &[f64],
    y: &[f64],
    low: f64,
    high: f64,
    columns: usize,
    limit: usize,
) -> Vec<usize> {
    let length = x.len().min(y.len());
    if length <= limit {
        return (0..length).collect();
    }
    let mut columns = columns.max(1);
    loop {
        let kept = one_pass(&x[..length], &y[..length], low, columns as f64 / (high - low));
        if kept.len() <= limit || columns <= 16 {
            return kept;
        }
        columns = columns * 3 / 4;
    }
}

fn one_pass(x: &[f64], y: &[f64], low: f64, columns_per_unit: f64) -> Vec<usize> {
    let column = |i: usize| {
        (x[i].is_finite() && y[i].is_finite()).then(|| ((x[i] - low) * columns_per_unit) as i64)
    };
    let mut kept = Vec::new();
    let mut start = 0;
    while start < x.len() {
        let here = column(start);
        let end = (start + 1..x.len()).find(|&i| column(i) != here).unwrap_or(x.len());
        if here.is_none() {
            kept.push(start);
        } else {
            let by_height = |a: &usize, b: &usize| y[*a].total_cmp(&y[*b]);
            let lowest = (start..end).min_by(by_height).unwrap_or(start);
            let highest = (start..end).max_by(by_height).unwrap_or(start);
            let mut four = [start, lowest, highest, end - 1];
            four.sort_unstable();
            kept.extend(four);
            kept.dedup();
        }
        start = end;
    }
    kept
}

/// Indices of points that draw the same area between two `edges`, at most about `limit` of each, as of [`path`].
pub(super) fn band(
    x: &[f64],
    edges: [&[f64]; 2],
    [low, high]: [f64; 2],
    columns: usize,
    limit: usize,
) -> Vec<usize> {
    let [mut kept, upper] = edges.map(|edge| path(x, edge, low, high, columns, limit));
    kept.extend(upper);
    kept.sort_unstable();
    kept.dedup();
    kept
}

/// Indices of the points that are visible as separate markers on a grid of `columns` by `rows`
/// cells, at most about `limit`.
pub(super) fn markers(
    x: &[f64],
    y: &[f64],
    limits: [f64; 4],
    cells: [usize; 2],
    limit: usize,
) -> Vec<usize> {
    let finite = (0..x.len().min(y.len())).filter(|&i| x[i].is_finite() && y[i].is_finite());
    let all: Vec<usize> = finite.collect();
    let [x_low, x_high, y_low, y_high] = limits;
    let mut cells = cells;
    let mut kept = all.clone();
    while kept.len() > limit && cells[0] > 16 {
        let mut seen = HashSet::new();
        kept = all
            .iter()
            .copied()
            .filter(|&i| {
                let column = ((x[i] - x_low) / (x_high - x_low) * cells[0] as f64) as i64;
                let row = ((y[i] - y_low) / (y_high - y_low) * cells[1] as f64) as i64;
                seen.insert((column, row))
            })
            .collect();
        cells = [cells[0] * 3 / 4, cells[1] * 3 / 4];
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_single_sample_spike_stays() {
        let x: Vec<f64> = (0..200_000).map(f64::from).collect();
        let mut y = vec![0.0; x.len()];
        y[77_777] = 9.0;
        y[133_333] = -4.0;
        let kept = path(&x, &y, 0.0, 200_000.0, 600, 2_500);
        assert!(kept.len() <= 2_500);
        assert!(kept.contains(&77_777) && kept.contains(&133_333));
        assert!(kept.windows(2).all(|pair| pair[0] < pair[1]));
    }

    #[test]
    fn a_loop_keeps_both_its_branches_and_the_limit() {
        let n = 100_000;
        let angle = |i: usize| i as f64 / n as f64 * std::f64::consts::TAU * 5.0;
        let x: Vec<f64> = (0..n).map(|i| angle(i).cos()).collect();
        let y: Vec<f64> = (0..n).map(|i| angle(i).sin()).collect();
        let kept = path(&x, &y, -1.0, 1.0, 600, 3_000);
        assert!(kept.len() <= 3_000, "{}", kept.len());
        let upper = kept.iter().filter(|&&i| y[i] > 0.0).count();
        assert!(upper > kept.len() / 3 && upper < kept.len() * 2 / 3);
    }

    #[test]
    fn a_gap_stays_a_gap() {
        let x: Vec<f64> = (0..10_000).map(f64::from).collect();
        let y: Vec<f64> =
            x.iter().map(|&x| if (4_000.0..6_000.0).contains(&x) { f64::NAN } else { x }).collect();
        let kept = path(&x, &y, 0.0, 10_000.0, 100, 1_000);
        assert_eq!(kept.iter().filter(|&&i| y[i].is_nan()).count(), 1);
    }

    #[test]
    fn overlapping_markers_are_drawn_once() {
        let x: Vec<f64> = (0..50_000).map(|i| f64::from(i % 10)).collect();
        let kept = markers(&x, &x, [0.0, 9.0, 0.0, 9.0], [600, 400], 1_000);
        assert_eq!(kept.len(), 10);
    }
}
