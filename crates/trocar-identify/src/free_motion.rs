//! Content of recordings beyond full strokes: rests and partial reversals.

use serde::Serialize;

use super::segments::Segments;
use trocar_recording::Recording;
use trocar_simulate::segment::Stroke;

/// Holds and partial reversals in the recordings.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FreeMotion {
    /// Reversals of the motion, full or not.
    pub reversals: usize,
    /// Strokes that end before the seal has snapped through: shorter than 2c.
    pub partial_reversals: usize,
    /// Time at rest or with small vibration, s: a tenth of a second or more within a tenth of c.
    pub held_s: f64,
}

impl FreeMotion {
    pub(super) fn of(recordings: &[Recording], segments: &[Segments], half_width: f64) -> Self {
        let mut all = Self { reversals: 0, partial_reversals: 0, held_s: 0.0 };
        for (recording, segments) in recordings.iter().zip(segments) {
            let x = &recording.position;
            // From one reversal to the next, without a gap.
            let partial = |pair: &&[Stroke]| {
                let (stroke, next) = (&pair[0], &pair[1]);
                let whole = stroke.starts_at_reversal
                    && next.starts_at_reversal
                    && next.start == stroke.end;
                whole && (x[stroke.end] - x[stroke.start]).abs() < 2.0 * half_width
            };
            all.partial_reversals += segments.strokes.windows(2).filter(partial).count();
            all.reversals += segments.strokes.iter().filter(|p| p.starts_at_reversal).count();
            all.held_s += held(recording, 0.1 * half_width);
        }
        all
    }
}

/// Time, s, that `recording` is at rest: a tenth of a second or more within `reach`, m.
fn held(recording: &Recording, reach: f64) -> f64 {
    const SHORTEST: f64 = 0.1;
    let (x, t) = (&recording.position, &recording.time);
    let mut total = 0.0;
    for range in recording.unbroken() {
        let mut from = range.start;
        while from + 1 < range.end {
            let until = (from + 1..range.end)
                .find(|i| (x[*i] - x[from]).abs() > reach)
                .unwrap_or(range.end)
                - 1;
            let rest = t[until] - t[from];
            total += if rest >= SHORTEST { rest } else { 0.0 };
            from = if rest >= SHORTEST { until + 1 } else { from + 1 };
        }
    }
    total
}
