//! Statistics in the report of a fleet: quartiles, trends and outliers.

use trocar_identify::t_quantile;

/// Modified z score beyond which a value is an outlier (IGLEWICZ-HOAGLIN).
pub const OUTLYING: f64 = 3.5;
/// Fewest values for which an outlier is defined.
const FEWEST: usize = 5;

/// Value below which the fraction `part` of the `sorted` values lies, interpolated linearly.
pub fn quantile(sorted: &[f64], part: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    let at = part * last as f64;
    let below = at.floor() as usize;
    sorted[below] + (at - below as f64) * (sorted[(below + 1).min(last)] - sorted[below])
}

/// Modified z scores 0.6745·(x − median)/MAD; `None` for fewer than five values, or if half of them
/// are equal.
pub fn modified_scores(values: &[f64]) -> Option<Vec<f64>> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let median = quantile(&sorted, 0.5);
    let mut away: Vec<f64> = values.iter().map(|value| (value - median).abs()).collect();
    away.sort_by(f64::total_cmp);
    let deviation = quantile(&away, 0.5);
    (values.len() >= FEWEST && deviation > 0.0)
        .then(|| values.iter().map(|value| 0.6745 * (value - median) / deviation).collect())
}

/// A straight line through values of several specimens, each with its own offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trend {
    /// Change per unit of x.
    pub slope: f64,
    /// Half of its 95 % interval.
    pub half_width: f64,
    /// Mean of x and of y, through which the line passes.
    pub centre: [f64; 2],
    /// Number of values.
    pub count: usize,
    /// Half of the 95 % interval of the mean at the centre.
    half_at_centre: f64,
}

impl Trend {
    /// Least squares of (x, y, specimen); `None` with too few values or no spread in x within the
    /// specimens.
    pub fn of(points: &[(f64, f64, usize)]) -> Option<Self> {
        let specimens = points.iter().map(|p| p.2).max()? + 1;
        let mut sums = vec![[0.0; 3]; specimens];
        for (x, y, specimen) in points {
            let sum = &mut sums[*specimen];
            (sum[0], sum[1], sum[2]) = (sum[0] + 1.0, sum[1] + x, sum[2] + y);
        }
        let within = points.iter().map(|p| {
            let [n, x, y] = sums[p.2];
            (p.0 - x / n, p.1 - y / n)
        });
        let (xx, xy) = within.clone().fold((0.0, 0.0), |(xx, xy), (x, y)| (xx + x * x, xy + x * y));
        let levels = sums.iter().filter(|sum| sum[0] > 0.0).count();
        let degrees = points.len() as f64 - levels as f64 - 1.0;
        if degrees < 1.0 || xx <= 0.0 {
            return None;
        }
        let slope = xy / xx;
        let squares: f64 = within.map(|(x, y)| (y - slope * x).powi(2)).sum();
        let variance = squares / degrees;
        let n = points.len() as f64;
        let mean = |of: fn(&(f64, f64, usize)) -> f64| points.iter().map(of).sum::<f64>() / n;
        let t = t_quantile(degrees);
        Some(Self {
            slope,
            half_width: t * (variance / xx).sqrt(),
            centre: [mean(|p| p.0), mean(|p| p.1)],
            count: points.len(),
            half_at_centre: t * (variance / n).sqrt(),
        })
    }

    /// The line at `x`, and half of its 95 % interval there.
    pub fn at(&self, x: f64) -> [f64; 2] {
        let away = x - self.centre[0];
        [self.centre[1] + self.slope * away, self.half_at_centre.hypot(self.half_width * away)]
    }
}
