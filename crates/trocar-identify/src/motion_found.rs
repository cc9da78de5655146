//! How much motion recordings hold, for the message that no model could be identified from them.

use std::fmt;

use super::segments::Segments;
use trocar_recording::{Recording, median};

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
    pub(super) fn of(recordings: &[Recording], segments: &[Segments]) -> Self {
        let mut found = Self { duration: 0.0, in_contact: 0.0, reversals: 0, longest_stroke: 0.0 };
        for (recording, segments) in recordings.iter().zip(segments) {
            let centre = median(recording.force.clone()).unwrap_or(0.0);
            let sizes: Vec<f64> = recording.force.iter().map(|f| (f - centre).abs()).collect();
            let limit = CONTACT * median(sizes.clone()).unwrap_or(0.0);
            let part = |count: usize| count as f64 / recording.len() as f64 * recording.duration();
            found.duration += recording.duration();
            found.in_contact += part(sizes.iter().filter(|size| **size > limit).count());
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
