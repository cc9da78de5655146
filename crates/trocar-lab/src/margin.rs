//! By how much one model predicts recordings better than another, stroke by stroke.

use serde::Serialize;

use trocar_recording::Recording;
use trocar_simulate::segment::{reversal_threshold, strokes};

/// Fewest strokes for a standard error.
const FEWEST_STROKES: usize = 4;

/// Comparison of the errors of two models over the same strokes.
///
/// With d_k the difference of the mean squared errors over stroke k of K strokes, the standard
/// error of their mean is s(d)/√K: strokes count as independent, samples within a stroke do not.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Margin {
    /// Strokes compared.
    pub strokes: usize,
    /// Mean difference of the mean squared errors over its standard error; positive if the first
    /// model has the smaller error.
    pub standard_errors: f64,
}

impl Margin {
    /// From the mean squared errors of both models, N², by stroke. `None` for fewer than four
    /// strokes.
    pub fn of(first: &[f64], second: &[f64]) -> Option<Self> {
        let strokes = first.len().min(second.len());
        if strokes < FEWEST_STROKES {
            return None;
        }
        let differences = second.iter().zip(first).map(|(second, first)| second - first);
        let mean = differences.clone().sum::<f64>() / strokes as f64;
        let squares: f64 = differences.map(|d| (d - mean) * (d - mean)).sum();
        let standard_error = (squares / ((strokes - 1) * strokes) as f64).sqrt();
        let standard_errors = if mean == 0.0 { 0.0 } else { mean / standard_error };
        Some(Self { strokes, standard_errors })
    }
}

/// Mean squared error, N², of each stroke of `recording`; `errors` are those of the samples
/// `scored`, in ascending order. Strokes without such samples are left out.
pub(crate) fn by_stroke(recording: &Recording, scored: &[usize], errors: &[f64]) -> Vec<f64> {
    let strokes = strokes(recording, reversal_threshold(recording)).into_iter();
    let mean_squares = strokes.filter_map(|stroke| {
        let from = scored.partition_point(|i| *i < stroke.start);
        let own = &errors[from..scored.partition_point(|i| *i < stroke.end)];
        (!own.is_empty()).then(|| own.iter().map(|e| e * e).sum::<f64>() / own.len() as f64)
    });
    mean_squares.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_models_have_no_margin_and_a_constant_one_is_certain() {
        let errors = [1.0, 2.0, 3.0, 4.0];
        assert_eq!(Margin::of(&errors, &errors).unwrap().standard_errors, 0.0);
        assert_eq!(
            Margin::of(&errors, &errors.map(|e| e + 1.0)).unwrap().standard_errors,
            f64::INFINITY
        );
        assert_eq!(Margin::of(&errors[..3], &errors[..3]), None);
    }

    #[test]
    fn exchanged_models_change_the_sign() {
        let (first, second) = ([1.0, 2.0, 3.0, 5.0, 1.0], [2.0, 2.5, 3.0, 9.0, 0.5]);
        let (there, back) =
            (Margin::of(&first, &second).unwrap(), Margin::of(&second, &first).unwrap());
        assert!(there.standard_errors > 0.0);
        assert_eq!(there.standard_errors, -back.standard_errors);
        // Five strokes more of the same kind make the margin √(9/4) times as large.
        let twice = |all: &[f64]| all.repeat(2);
        let double = Margin::of(&twice(&first), &twice(&second)).unwrap();
        assert!((double.standard_errors / there.standard_errors - 1.5).abs() < 1e-12);
    }
}
