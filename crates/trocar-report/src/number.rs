//! Formatting of numbers: ticks, significant digits, widths of printed text.

/// Ticks of one axis.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Ticks {
    /// Positions in the unit of the axis, increasing.
    pub(super) at: Vec<f64>,
    /// Printed numbers, one per position.
    pub(super) labels: Vec<String>,
}

impl Ticks {
    /// Where `place` puts each tick, and its number.
    pub(super) fn placed(&self, place: impl Fn(f64) -> f64) -> Vec<(f64, &str)> {
        self.at.iter().zip(&self.labels).map(|(at, label)| (place(*at), label.as_str())).collect()
    }
}

/// Round ticks (1, 2, 2.5 or 5 times a power of ten apart), about `target` of them, inside `[low,
/// high]`.
pub(super) fn ticks(low: f64, high: f64, target: usize) -> Ticks {
    let raw = (high - low) / target.max(1) as f64;
    let magnitude = 10f64.powf(raw.log10().floor());
    let factor = [1.0, 2.0, 2.5, 5.0, 10.0]
        .into_iter()
        .find(|factor| factor * magnitude >= raw * 0.999)
        .unwrap_or(10.0);
    let step = factor * magnitude;
    // A quarter needs one decimal more than its power of ten.
    let exponent = step.log10().floor() as i32 - i32::from(factor == 2.5);
    let at: Vec<f64> = ((low / step).ceil() as i64..=(high / step).floor() as i64)
        .map(|i| i as f64 * step)
        .collect();
    let largest = low.abs().max(high.abs());
    let labels = at.iter().map(|&value| tick_label(value, exponent, largest)).collect();
    Ticks { at, labels }
}

/// With fewer logarithmic ticks than this within the axis, linear ticks are used.
const FEWEST_RATIOS: usize = 4;

/// Ticks of a logarithmic axis inside `[low, high]`, both above zero. Multiples of powers of ten
/// are added or omitted to obtain at most about `target` ticks; linear ticks where the range is too
/// small.
pub(super) fn log_ticks(low: f64, high: f64, target: usize) -> Ticks {
    let exponents = low.log10().floor() as i32..=high.log10().ceil() as i32;
    let places = |factors: &[f64]| -> Vec<f64> {
        let all = exponents
            .clone()
            .flat_map(|e| factors.iter().map(move |factor| factor * 10f64.powi(e)));
        all.filter(|at| (low..=high).contains(at)).collect()
    };
    let fineness: [&[f64]; 2] = [&[1.0, 2.0, 3.0, 5.0, 7.0], &[1.0, 2.0, 5.0]];
    let fitting = fineness.into_iter().map(places).find(|at| at.len() <= target);
    let at = fitting.unwrap_or_else(|| places(&[1.0]));
    if at.len() < FEWEST_RATIOS && high < 10.0 * low {
        return ticks(low, high, target);
    }
    let labels = at.iter().map(|value| significant(*value, 1)).collect();
    Ticks { at, labels }
}

fn tick_label(value: f64, step_exponent: i32, largest: f64) -> String {
    if !(1e-3..1e6).contains(&largest) {
        return if value == 0.0 { "0".into() } else { typographic(&format!("{value:.1e}")) };
    }
    fixed(value, (-step_exponent).max(0) as usize)
}

/// `value` with `decimals` decimals and a true minus sign; never "−0".
pub(super) fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let is_zero = text.bytes().all(|byte| matches!(byte, b'-' | b'0' | b'.'));
    typographic(if is_zero { text.trim_start_matches('-') } else { &text })
}

/// `value` with `digits` significant digits; a dash where it is not finite.
pub(super) fn significant(value: f64, digits: usize) -> String {
    if !value.is_finite() {
        return "–".into();
    }
    if value == 0.0 {
        return "0".into();
    }
    let exponent = value.abs().log10().floor() as i32;
    if !(-5..7).contains(&exponent) {
        return typographic(&format!("{value:.*e}", digits.saturating_sub(1)));
    }
    fixed(value, (digits as i32 - 1 - exponent).max(0) as usize)
}

/// Number of decimals that show half of the interval with two significant digits; `None` for an
/// interval without width.
pub(super) fn decimals_for(low: f64, high: f64) -> Option<usize> {
    let half = (high - low).abs() / 2.0;
    (half.is_finite() && half > 0.0).then(|| (1.0 - half.log10().floor()).clamp(0.0, 12.0) as usize)
}

fn typographic(text: &str) -> String {
    text.replace('-', "\u{2212}")
}

/// In millimetres (per second), to three decimals.
pub(crate) fn thousandths(metres: f64) -> f64 {
    (1e6 * metres).round() / 1e3
}

/// Ends the message that no stroke has the selected speed: the speeds there are.
pub(crate) fn recorded_in_words(speeds: &[f64]) -> String {
    let mut shown: Vec<String> = speeds.iter().map(|speed| format!("{:.0}", 1e3 * speed)).collect();
    shown.dedup();
    match shown.as_slice() {
        [] => {
            "; the recordings hold no full cycle of two strokes whose initial deflection is known"
                .to_owned()
        }
        speeds => format!("; recorded are {} mm/s", speeds.join(", ")),
    }
}

/// Advance widths of DejaVu Sans from space to tilde, in thousandths of the font size. kuva draws
/// bitmaps with this font, and the fallbacks named in the SVG are as wide (Verdana) or narrower.
#[rustfmt::skip]
const ADVANCE: [u16; 95] = [
    318, 401, 460, 838, 636, 950, 780, 275, 390, 390, 500, 838, 318, 361, 318, 337, 636, 636, 636, 636, 636, 636, 636,
    636, 636, 636, 337, 337, 838, 838, 838, 531, 1000, 684, 686, 698, 770, 632, 575, 775, 752, 295, 295, 656, 557, 863,
    748, 787, 603, 787, 695, 635, 611, 732, 684, 989, 685, 611, 685, 390, 337, 390, 838, 500, 500, 613, 635, 550, 635,
    615, 352, 635, 634, 278, 278, 579, 278, 974, 634, 612, 635, 635, 411, 521, 392, 634, 592, 818, 592, 592, 525, 636,
    337, 636, 838,
];

/// Width of `text` at font size `size` in pixels. Characters outside ASCII count as wide letters,
/// so that the result is never too small.
pub(super) fn text_width(text: &str, size: impl Into<f64>) -> f64 {
    text.chars().map(advance).sum::<f64>() * size.into() / 1000.0
}

/// Width of a character, thousandths of the font size.
fn advance(c: char) -> f64 {
    const WIDE: u16 = 838;
    // The table begins with the blank.
    (c as usize).checked_sub(32).and_then(|i| ADVANCE.get(i)).copied().unwrap_or(WIDE).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_inside_the_range_and_printed_without_noise() {
        let marks = ticks(-0.31, 0.29, 6);
        assert_eq!(
            marks.labels,
            ["\u{2212}0.3", "\u{2212}0.2", "\u{2212}0.1", "0.0", "0.1", "0.2"]
        );
        assert!(marks.at.iter().all(|at| (-0.31..=0.29).contains(at)));
    }

    #[test]
    fn ticks_of_ratios_are_round() {
        let marks = log_ticks(0.04, 1.7, 6);
        assert_eq!(marks.labels, ["0.05", "0.1", "0.2", "0.5", "1"]);
        assert_eq!(
            log_ticks(1e-4, 2e3, 8).labels,
            ["0.0001", "0.001", "0.01", "0.1", "1", "10", "100", "1000"]
        );
        assert_eq!(log_ticks(0.15, 1.7, 6).labels, ["0.2", "0.3", "0.5", "0.7", "1"]);
        assert_eq!(log_ticks(1.65, 3.3, 4).labels, ["2.0", "2.5", "3.0"]);
        assert!(log_ticks(0.31, 0.38, 5).at.len() > 2);
    }

    #[test]
    fn significant_digits_survive_any_magnitude() {
        assert_eq!(significant(203.456, 4), "203.5");
        assert_eq!(significant(-0.002_345_6, 3), "\u{2212}0.00235");
        assert_eq!(significant(1.5e-9, 2), "1.5e\u{2212}9");
        assert_eq!(significant(f64::NAN, 3), "–");
        assert_eq!(fixed(-0.0004, 2), "0.00");
    }

    #[test]
    fn an_interval_decides_the_decimals() {
        assert_eq!(decimals_for(2.31, 2.37), Some(3));
        assert_eq!(decimals_for(190.0, 216.0), Some(0));
        assert_eq!(decimals_for(1.0, 1.0), None);
        assert_eq!(decimals_for(f64::NEG_INFINITY, 1.0), None);
    }
}
