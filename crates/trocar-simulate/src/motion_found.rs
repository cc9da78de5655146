//! What motion recordings hold: rests and partial reversals beyond full strokes, and how much of it there is.

use std::fmt;

use serde::Serialize;
use trocar_recording::{Recording, median};

use super::segment::Segments;

/// Force above which something else than the seal is touched, in medians of the force: friction of a
/// seal varies by a factor of two or three between its branches.
const CONTACT: f64 = 4.0;

/// The motion of some recordings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionFound {
    /// Time of all samples, s.
    pub duration: f64,
    /// Time in which the force is above four times its median, s: the tip probably touches something.
    pub in_contact: f64,
    /// Reversals between two strokes.
    pub reversals: usize,
    /// Longest stroke without such forces, m; 0 if there is none.
    pub longest_stroke: f64,
}

impl MotionFound {
    /// That of recordings with their segmentations, in one order.
    #[must_use]
    pub fn of(recordings: &[Recording], segments: &[Segments]) -> Self {
        let mut found = Self { duration: 0.0, in_contact: 0.0, reversals: 0, longest_stroke: 0.0 };
        for (recording, segments) in recordings.iter().zip(segments) {
            let centre = median(recording.force.clone()).unwrap_or(0.0);
            let sizes: Vec<f64> = recording.force.iter().map(|f| (f - centre).abs()).collect();
            let limit = CONTACT * median(sizes.clone()).unwrap_or(0.0);
            let in_contact = sizes.iter().filter(|size| **size > limit).count();
            found.duration += recording.duration();
            found.in_contact += in_contact as f64 / recording.len() as f64 * recording.duration();
            found.reversals +=
                segments.strokes.iter().filter(|stroke| stroke.starts_at_reversal).count();
            let free = segments.strokes.iter().filter(|stroke| {
                sizes[stroke.start..=stroke.end].iter().all(|size| *size <= limit)
            });
            let lengths = free.map(|stroke| {
                (recording.position[stroke.end] - recording.position[stroke.start]).abs()
            });
            found.longest_stroke = lengths.fold(found.longest_stroke, f64::max);
        }
        found
    }
}

impl fmt::Display for MotionFound {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Self { duration, in_contact, reversals, longest_stroke } = self;
        let longest = 1e3 * longest_stroke;
        write!(f, "{duration:.1} s of motion with {reversals} reversals")?;
        if *in_contact > 0.0 {
            write!(
                f,
                ", of which {in_contact:.1} s with a force above {CONTACT} times its median (contact?)"
            )?;
        }
        write!(f, "; the longest stroke without such a force is {longest:.1} mm")
    }
}

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
    /// That of recordings with their segmentations, in one order, of a seal of this half width, m.
    #[must_use]
    pub fn of(recordings: &[Recording], segments: &[Segments], half_width: f64) -> Self {
        let mut all = Self { reversals: 0, partial_reversals: 0, held_s: 0.0 };
        for (recording, segments) in recordings.iter().zip(segments) {
            let x = &recording.position;
            // From one reversal to the next, without a gap.
            let partial = segments.strokes.windows(2).filter(|pair| {
                let (stroke, next) = (&pair[0], &pair[1]);
                let whole = stroke.starts_at_reversal
                    && next.starts_at_reversal
                    && next.start == stroke.end;
                whole && (x[stroke.end] - x[stroke.start]).abs() < 2.0 * half_width
            });
            all.partial_reversals += partial.count();
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

/// Longest rest between two motions of `recording`, s: within `reach`, m, of where it came to rest. How
/// long it rests before the first motion and after the last is not known to the end.
#[must_use]
pub fn longest_rest(recording: &Recording, reach: f64) -> f64 {
    let (t, x) = (&recording.time, &recording.position);
    let (mut from, mut longest) = (0, 0.0f64);
    for i in 0..t.len() {
        if (x[i] - x[from]).abs() >= reach {
            longest = longest.max(if from > 0 { t[i] - t[from] } else { 0.0 });
            from = i;
        }
    }
    longest
}

/// Speed, m/s, below which the motion of the recordings spends a twentieth of its time; 0 without motion.
#[must_use]
pub fn slow_speed(recordings: &[Recording]) -> f64 {
    const BLOCK: f64 = 0.05;
    let mut speeds = Vec::new();
    for recording in recordings {
        let (t, x) = (&recording.time, &recording.position);
        let mut from = 0;
        for i in 0..t.len() {
            if t[i] - t[from] >= BLOCK {
                speeds.push((x[i] - x[from]).abs() / (t[i] - t[from]));
                from = i;
            }
        }
    }
    speeds.sort_by(f64::total_cmp);
    speeds.get(speeds.len() / 20).copied().unwrap_or(0.0)
}
