//! Whether Markov chains have converged (RHAT): rank-normalised split R-hat, and effective sample
//! sizes of the bulk and of the tails.

use statrs::distribution::{ContinuousCDF, Normal};
use trocar_recording::range;

/// Convergence of one parameter over several chains of equal length.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Convergence {
    /// R-hat: standard deviation of all draws over that within chains; 1 where they agree.
    pub r_hat: f64,
    /// Number of independent draws with the same error of the mean.
    pub ess_bulk: f64,
    /// The same for the 5 % and 95 % quantiles, the smaller of both.
    pub ess_tail: f64,
}

impl Convergence {
    /// Of `chains`, each split in two; `None` where the parameter does not change.
    #[must_use]
    pub fn of(chains: &[Vec<f64>]) -> Option<Self> {
        let halves: Vec<&[f64]> = chains
            .iter()
            .flat_map(|chain| {
                let half = chain.len() / 2;
                [&chain[..half], &chain[chain.len() - half..]]
            })
            .collect();
        let all: Vec<f64> = halves.iter().flat_map(|half| half.iter().copied()).collect();
        let (low, high) = range(&all);
        if low >= high || all.iter().any(|v| v.is_nan()) {
            return None;
        }
        let length = halves.first().map_or(0, |half| half.len());
        let ranks = rank_normalised(&all);
        let middle = quantile(&sorted(&all), 0.5);
        let folded: Vec<f64> = all.iter().map(|v| (v - middle).abs()).collect();
        let of = |values: &[f64]| split_r_hat(values, length);
        let tail = |part: f64| {
            let limit = quantile(&sorted(&all), part);
            let below: Vec<f64> = all.iter().map(|v| f64::from(u8::from(*v <= limit))).collect();
            effective(&below, length)
        };
        Some(Self {
            r_hat: of(&ranks).max(of(&rank_normalised(&folded))),
            ess_bulk: effective(&ranks, length),
            ess_tail: tail(0.05).min(tail(0.95)),
        })
    }
}

fn sorted(values: &[f64]) -> Vec<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted
}

/// Quantile of sorted values, interpolated between neighbours.
pub(super) fn quantile(sorted: &[f64], part: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    let place = part * last as f64;
    let (low, high) = (sorted[place.floor() as usize], sorted[place.ceil() as usize]);
    low + (high - low) * place.fract()
}

/// Normal quantiles of the ranks; equal values share their mean rank.
fn rank_normalised(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    let (normal, n) = (Normal::standard(), values.len() as f64);
    let mut scores = vec![0.0; values.len()];
    let mut from = 0;
    for equal in order.chunk_by(|a, b| values[*a] == values[*b]) {
        let rank = from as f64 + 0.5 * (equal.len() as f64 + 1.0);
        let score = normal.inverse_cdf((rank - 0.375) / (n + 0.25));
        equal.iter().for_each(|i| scores[*i] = score);
        from += equal.len();
    }
    scores
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn variance(values: &[f64]) -> f64 {
    let mean = mean(values);
    values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (values.len() as f64 - 1.0)
}

/// Mean variance within chains of `length`, and that of all draws.
fn variances(values: &[f64], length: usize) -> [f64; 2] {
    let chains = || values.chunks(length);
    let within = mean(&chains().map(variance).collect::<Vec<_>>());
    let between = variance(&chains().map(mean).collect::<Vec<_>>());
    let n = length as f64;
    [within, (n - 1.0) / n * within + between]
}

fn split_r_hat(values: &[f64], length: usize) -> f64 {
    let [within, all] = variances(values, length);
    (all / within).sqrt()
}

/// Effective sample size by the initial monotone sequence of autocorrelations.
fn effective(values: &[f64], length: usize) -> f64 {
    let [within, all] = variances(values, length);
    let total = values.len() as f64;
    if within <= 0.0 {
        return f64::NAN;
    }
    let centred: Vec<Vec<f64>> = values
        .chunks(length)
        .map(|chain| {
            let mean = mean(chain);
            chain.iter().map(|v| v - mean).collect()
        })
        .collect();
    let correlation = |lag: usize| {
        let of = |chain: &Vec<f64>| {
            chain[lag..].iter().zip(chain).map(|(a, b)| a * b).sum::<f64>() / length as f64
        };
        let covariance = centred.iter().map(of).sum::<f64>() / centred.len() as f64;
        1.0 - (within * (length as f64 - 1.0) / length as f64 - covariance) / all
    };
    let (mut sum, mut least, mut lag) = (0.0, f64::INFINITY, 0);
    while lag + 1 < length {
        let pair = correlation(lag) + correlation(lag + 1);
        if pair <= 0.0 {
            break;
        }
        least = least.min(pair);
        sum += least;
        lag += 2;
    }
    let time = (2.0 * sum - 1.0).max(1.0 / total.log10());
    total / time
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use crate::random::normal;

    /// Chains with x' = r·x + noise of unit variance.
    fn autoregressive(r: f64, shift: f64) -> Vec<Vec<f64>> {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut chain = |k: usize| {
            let mut x = 0.0;
            (0..4000)
                .map(|_| {
                    x = r * x + (1.0 - r * r).sqrt() * normal(&mut rng);
                    x + shift * k as f64
                })
                .collect()
        };
        (0..4).map(&mut chain).collect()
    }

    #[test]
    fn correlated_draws_count_less() {
        let independent = Convergence::of(&autoregressive(0.0, 0.0)).unwrap();
        assert!((independent.ess_bulk / 16_000.0 - 1.0).abs() < 0.1, "{independent:?}");
        assert!(independent.r_hat < 1.005);
        // (1 − r)/(1 + r) of them.
        let slow = Convergence::of(&autoregressive(0.9, 0.0)).unwrap();
        assert!((slow.ess_bulk / (16_000.0 / 19.0) - 1.0).abs() < 0.3, "{slow:?}");
    }

    #[test]
    fn chains_that_differ_are_seen() {
        let apart = Convergence::of(&autoregressive(0.0, 0.3)).unwrap();
        assert!(apart.r_hat > 1.02, "{apart:?}");
        assert_eq!(Convergence::of(&[vec![2.0; 100], vec![2.0; 100]]), None);
    }
}
