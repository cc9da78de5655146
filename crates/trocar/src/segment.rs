//! Finds what a recording can give: passes between reversals and stretches of constant velocity.
//!
//! A *pass* is the motion from one reversal of the instrument to the next (EMS section IV: one insertion or one
//! withdrawal). A *stretch* is a part of a pass over which the velocity is constant; its mean force is one datum of
//! the steady-state identification. Nothing here needs to know which experiment was recorded: the paper's two
//! experiments are simply recordings, and a free motion gives whatever it holds.

use crate::recording::{Recording, local_velocity};

/// Sense of a motion along the instrument's axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Direction {
    /// Position grows: insertion, v > 0.
    Positive,
    /// Position falls: withdrawal, v < 0.
    Negative,
}

impl Direction {
    /// +1 for [`Direction::Positive`], -1 for [`Direction::Negative`].
    pub fn sign(self) -> f64 {
        match self {
            Self::Positive => 1.0,
            Self::Negative => -1.0,
        }
    }
}

/// Motion between two reversals: samples `start..=end` of a recording.
///
/// Invariant: `start < end`, no gap, clock reset or encoder reset lies inside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pass {
    /// First sample: the extreme position at which the motion turned.
    pub start: usize,
    /// Last sample: the extreme position at the other end.
    pub end: usize,
    /// Sense of the motion.
    pub direction: Direction,
    /// Whether the pass begins at a reversal that the recording shows (not at its start or behind a gap).
    pub starts_at_reversal: bool,
}

/// A stretch of constant velocity: samples `start..end` of a recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretch {
    /// First sample.
    pub start: usize,
    /// One past the last sample.
    pub end: usize,
    /// Index of the pass it lies in.
    pub pass: usize,
    /// Mean velocity, m/s: displacement over duration.
    pub velocity: f64,
}

/// Tolerances of the segmentation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SegmentOptions {
    /// Largest relative departure of the local velocity from the stretch's median (0.02).
    pub velocity_tolerance: f64,
    /// Shortest stretch, s (0.05).
    pub minimum_duration: f64,
}

impl Default for SegmentOptions {
    fn default() -> Self {
        Self { velocity_tolerance: 0.02, minimum_duration: 0.05 }
    }
}

/// Smallest retreat of the position, m, that counts as a reversal: above the encoder's steps and noise.
pub fn reversal_threshold(recording: &Recording) -> f64 {
    let q = &recording.quality;
    (8.0 * q.position_resolution).max(8.0 * q.position_noise).max(2e-5)
}

/// Cuts a recording into passes; `threshold` is the smallest retreat, m, that counts as a reversal.
///
/// The sample of the extreme position ends one pass and starts the next. Gaps and resets end a pass too.
pub fn passes(recording: &Recording, threshold: f64) -> Vec<Pass> {
    let mut found = Vec::new();
    for range in recording.stretches() {
        passes_of_range(&recording.position, range.start, range.end, threshold, &mut found);
    }
    found
}

fn passes_of_range(position: &[f64], from: usize, to: usize, threshold: f64, found: &mut Vec<Pass>) {
    let (mut low, mut high, mut start) = (from, from, from);
    let mut heading = None;
    let mut push = |start: usize, end: usize, direction| {
        if end > start {
            found.push(Pass { start, end, direction, starts_at_reversal: start > from });
        }
    };
    for i in from..to {
        if position[i] > position[high] {
            high = i;
        }
        if position[i] < position[low] {
            low = i;
        }
        let fell = position[high] - position[i] > threshold;
        let rose = position[i] - position[low] > threshold;
        match heading {
            None if fell || rose => {
                heading = Some(if rose { Direction::Positive } else { Direction::Negative });
                (low, high) = (i, i);
            }
            Some(Direction::Positive) if fell => {
                push(start, high, Direction::Positive);
                (start, heading) = (high, Some(Direction::Negative));
                (low, high) = (i, i);
            }
            Some(Direction::Negative) if rose => {
                push(start, low, Direction::Negative);
                (start, heading) = (low, Some(Direction::Positive));
                (low, high) = (i, i);
            }
            _ => {}
        }
    }
    if let Some(direction) = heading {
        let end = match direction {
            Direction::Positive => high,
            Direction::Negative => low,
        };
        push(start, end, direction);
    }
}

/// Window, s, over which a local velocity is good to a quarter of the tolerance at `speed`.
///
/// The slope of n positions with error e over the time T has the standard deviation e·√(12/n)/T; the encoder's
/// rounding counts as an error of resolution/√12.
fn velocity_window(recording: &Recording, speed: f64, pass_duration: f64, options: &SegmentOptions) -> f64 {
    let q = &recording.quality;
    let error = q.position_noise.hypot(q.position_resolution / 12f64.sqrt());
    let wanted = 0.25 * options.velocity_tolerance * speed;
    let window = (error * (12.0 * q.median_interval).sqrt() / wanted).powf(2.0 / 3.0);
    window.max(options.minimum_duration).max(5.0 * q.median_interval).min(pass_duration / 6.0)
}

/// Finds the stretches of constant velocity in `passes`.
///
/// The local velocity (slope of the positions over a window that the position noise asks for) stays within
/// `velocity_tolerance` of the stretch's median for at least `minimum_duration`. Several stretches of different
/// speed may lie in one pass.
pub fn stretches(recording: &Recording, passes: &[Pass], options: &SegmentOptions) -> Vec<Stretch> {
    let mut found = Vec::new();
    let mut cached: Option<(f64, Vec<f64>)> = None;
    for (index, pass) in passes.iter().enumerate() {
        let duration = recording.time[pass.end] - recording.time[pass.start];
        if duration < 2.0 * options.minimum_duration {
            continue;
        }
        let travel = (recording.position[pass.end] - recording.position[pass.start]).abs();
        let wanted = velocity_window(recording, travel / duration, duration, options);
        // Windows in steps of a factor 1.5, so that passes of like speed share one differentiation.
        let window = 1.5f64.powf(wanted.log(1.5).round());
        if cached.as_ref().is_none_or(|(w, _)| *w != window) {
            cached = Some((window, local_velocity(recording, window)));
        }
        let velocity = &cached.as_ref().expect("filled above").1;
        runs(recording, velocity, index, pass, options, &mut found);
    }
    found
}

fn runs(
    recording: &Recording,
    velocity: &[f64],
    index: usize,
    pass: &Pass,
    options: &SegmentOptions,
    found: &mut Vec<Stretch>,
) {
    let time = &recording.time;
    let sign = pass.direction.sign();
    let mut i = pass.start;
    while i < pass.end {
        let (mut sum, mut n, mut j) = (0.0, 0.0, i);
        while j <= pass.end {
            let v = sign * velocity[j];
            let mean = if n > 0.0 { sum / n } else { v };
            if v <= 0.0 || (v - mean).abs() > options.velocity_tolerance * mean {
                break;
            }
            (sum, n, j) = (sum + v, n + 1.0, j + 1);
        }
        if let Some(stretch) = trimmed(recording, velocity, index, i, j, options) {
            found.push(stretch);
            i = j;
        } else {
            // A run that starts on a ramp breaks off early: try again a little further on.
            let next = time[i] + 0.2 * options.minimum_duration;
            i += 1 + time[i + 1..=pass.end].partition_point(|t| *t < next);
        }
    }
}

/// Narrows a run to the samples within the tolerance of its median, and refuses what is then too short.
fn trimmed(
    recording: &Recording,
    velocity: &[f64],
    pass: usize,
    mut start: usize,
    mut end: usize,
    options: &SegmentOptions,
) -> Option<Stretch> {
    let time = &recording.time;
    let long_enough = |a: usize, b: usize| b > a + 4 && time[b - 1] - time[a] >= options.minimum_duration;
    if !long_enough(start, end) {
        return None;
    }
    let mut sorted: Vec<f64> = velocity[start..end].to_vec();
    sorted.sort_by(f64::total_cmp);
    let median = sorted[sorted.len() / 2];
    let off = |i: usize| (velocity[i] - median).abs() > options.velocity_tolerance * median.abs();
    while start < end && off(start) {
        start += 1;
    }
    while end > start && off(end - 1) {
        end -= 1;
    }
    if !long_enough(start, end) {
        return None;
    }
    let mean = (recording.position[end - 1] - recording.position[start]) / (time[end - 1] - time[start]);
    Some(Stretch { start, end, pass, velocity: mean })
}

/// Travel, m, of sample `i` since the start of its pass; grows along the motion.
pub fn travel(recording: &Recording, pass: &Pass, i: usize) -> f64 {
    pass.direction.sign() * (recording.position[i] - recording.position[pass.start])
}
