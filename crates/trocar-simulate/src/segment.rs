//! Segmentation of a recording: strokes between reversals and constant-velocity segments.
//!
//! A *stroke* is the motion from one reversal of the instrument to the next (EMS section IV: one
//! insertion or one withdrawal). A *constant-velocity segment* is a part of a stroke with constant
//! velocity; its mean force is one datum of the steady-state identification. The segmentation does
//! not depend on the experiment: the two experiments of the paper are recordings like any other,
//! and free motion is segmented in the same way.

pub use trocar_model::Direction;

use trocar_recording::{Recording, local_velocity};

/// Writes a direction as a word.
pub fn direction_as_word<S: serde::Serializer>(
    direction: &Direction,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(direction.name())
}

/// Motion between two reversals: samples `start..=end` of a recording.
///
/// Invariant: `start < end`, no gap, clock reset or encoder reset lies inside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stroke {
    /// First sample: the extreme position at which the motion reversed.
    pub start: usize,
    /// Last sample: the extreme position at the other end.
    pub end: usize,
    /// Sense of the motion.
    pub direction: Direction,
    /// Whether the stroke starts at a reversal within the recording (not at its start or after a
    /// gap).
    pub starts_at_reversal: bool,
    /// Number of the motion to which it belongs: a gap or a reset of the encoder splits a stroke,
    /// not the motion.
    pub motion: usize,
}

/// A constant-velocity segment: samples `start..end` of a recording.
///
/// Segments of one motion at one speed share a `plateau`: together they are one datum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SteadySegment {
    /// First sample.
    pub start: usize,
    /// One past the last sample.
    pub end: usize,
    /// Index of the stroke it lies in.
    pub stroke: usize,
    /// Number of the velocity plateau to which it belongs.
    pub plateau: usize,
    /// Fraction of the motion's time spent on the plateau, 0 to 1.
    pub dwell: f64,
    /// Mean velocity, m/s: displacement over duration.
    pub velocity: f64,
}

/// Tolerances of the segmentation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SegmentOptions {
    /// Largest relative deviation of the local velocity from the segment's median (0.02).
    pub velocity_tolerance: f64,
    /// Shortest segment, s (0.05).
    pub minimum_duration: f64,
    /// Least fraction of a motion's time spent on a plateau (0.15).
    ///
    /// A smooth stroke (half a sine) spends 0.128 of its time within 2 % of its top speed, a
    /// minimum-jerk stroke 0.10: neither is a plateau.
    pub minimum_dwell: f64,
}

impl Default for SegmentOptions {
    fn default() -> Self {
        Self { velocity_tolerance: 0.02, minimum_duration: 0.05, minimum_dwell: 0.15 }
    }
}

/// Smallest retreat of the position, m, that counts as a reversal: larger than the encoder's steps,
/// its noise and the vibration of a drive (a hundredth of the stroke).
pub fn reversal_threshold(recording: &Recording) -> f64 {
    let q = &recording.quality;
    let noise = recording.position_noise();
    (8.0 * q.position_resolution).max(8.0 * noise).max(0.01 * q.stroke)
}

/// Splits a recording into strokes; `threshold` is the smallest retreat, m, that counts as a
/// reversal.
///
/// The sample of the extreme position ends one stroke and starts the next. Gaps and resets end a
/// stroke too.
pub fn strokes(recording: &Recording, threshold: f64) -> Vec<Stroke> {
    let mut found: Vec<Stroke> = Vec::new();
    for range in recording.unbroken() {
        strokes_of_range(&recording.position, range.start, range.end, threshold, &mut found);
    }
    for i in 1..found.len() {
        let goes_on = !found[i].starts_at_reversal && found[i].direction == found[i - 1].direction;
        found[i].motion = found[i - 1].motion + usize::from(!goes_on);
    }
    found
}

fn strokes_of_range(
    position: &[f64],
    from: usize,
    to: usize,
    threshold: f64,
    found: &mut Vec<Stroke>,
) {
    let (mut low, mut high, mut start) = (from, from, from);
    let mut heading = None;
    let mut push = |start: usize, end: usize, direction| {
        if end > start {
            found.push(Stroke {
                start,
                end,
                direction,
                starts_at_reversal: start > from,
                motion: 0,
            });
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
                heading = Some(if rose { Direction::Insertion } else { Direction::Withdrawal });
                (low, high) = (i, i);
            }
            Some(Direction::Insertion) if fell => {
                push(start, high, Direction::Insertion);
                (start, heading) = (high, Some(Direction::Withdrawal));
                (low, high) = (i, i);
            }
            Some(Direction::Withdrawal) if rose => {
                push(start, low, Direction::Withdrawal);
                (start, heading) = (low, Some(Direction::Insertion));
                (low, high) = (i, i);
            }
            _ => {}
        }
    }
    if let Some(direction) = heading {
        push(start, direction.pick([high, low]), direction);
    }
}

/// Window, s, over which a local velocity is accurate to a quarter of the tolerance at `speed`.
///
/// The slope of n positions with error e over the time T has the standard deviation e·√(12/n)/T;
/// the encoder's rounding counts as an error of resolution/√12.
fn velocity_window(
    recording: &Recording,
    speed: f64,
    stroke_duration: f64,
    options: &SegmentOptions,
) -> f64 {
    let q = &recording.quality;
    let error = recording.position_noise().hypot(q.position_resolution / 12f64.sqrt());
    let wanted = 0.25 * options.velocity_tolerance * speed;
    let window = (error * (12.0 * q.median_interval).sqrt() / wanted).powf(2.0 / 3.0);
    window.max(options.minimum_duration).max(5.0 * q.median_interval).min(stroke_duration / 6.0)
}

/// Finds the constant-velocity segments in `strokes`, in the order of their start.
///
/// The local velocity is the slope of the positions over a window determined by the position noise.
/// It is searched for the speeds at which a motion dwells: a plateau contains at least
/// `minimum_dwell` of the motion's time within `velocity_tolerance`. A motion may have several
/// plateaus; each gives one or more segments of at least `minimum_duration`.
pub fn steady_segments(
    recording: &Recording,
    strokes: &[Stroke],
    options: &SegmentOptions,
) -> Vec<SteadySegment> {
    let mut found = Vec::new();
    let mut cached: Option<(f64, Vec<f64>)> = None;
    let mut plateau = 0;
    for motion in strokes.chunk_by(|a, b| a.motion == b.motion) {
        let first = strokes.partition_point(|p| p.motion < motion[0].motion);
        let duration: f64 =
            motion.iter().map(|p| recording.time[p.end] - recording.time[p.start]).sum();
        let travel: f64 = motion.iter().map(|p| travel(recording, p, p.end)).sum();
        if duration < 2.0 * options.minimum_duration || travel <= 0.0 {
            continue;
        }
        let wanted = velocity_window(recording, travel / duration, duration, options);
        // Windows in steps of a factor of 1.5, so that motions of similar speed share one
        // differentiation.
        let window = 1.5f64.powf(wanted.log(1.5).round());
        if cached.as_ref().is_none_or(|(w, _)| *w != window) {
            cached = Some((window, local_velocity(recording, window)));
        }
        let velocity = &cached.as_ref().expect("filled above").1;
        for (speed, dwell) in plateau_speeds(velocity, motion, options) {
            for (k, stroke) in motion.iter().enumerate() {
                runs(recording, velocity, stroke, speed, options, |start, end| {
                    let (x, t) = (&recording.position, &recording.time);
                    let mean = (x[end - 1] - x[start]) / (t[end - 1] - t[start]);
                    found.push(SteadySegment {
                        start,
                        end,
                        stroke: first + k,
                        plateau,
                        dwell,
                        velocity: mean,
                    });
                });
            }
            plateau += 1;
        }
    }
    found.sort_by_key(|s| s.start);
    found
}

/// Relative difference above which two speeds of one motion are distinct.
const DISTINCT: f64 = 0.25;

/// Speeds, m/s, at which a motion dwells, with the fraction of its time, in descending order of
/// time.
fn plateau_speeds(
    velocity: &[f64],
    motion: &[Stroke],
    options: &SegmentOptions,
) -> Vec<(f64, f64)> {
    const MOST_SAMPLES: usize = 4000;
    let sign = motion[0].direction.sign();
    let samples: usize = motion.iter().map(|p| p.end - p.start).sum();
    let every = samples.div_ceil(MOST_SAMPLES);
    let along =
        motion.iter().flat_map(|p| (p.start..p.end).step_by(every)).map(|i| sign * velocity[i]);
    let mut speeds: Vec<f64> = along.collect();
    let all = speeds.len() as f64;
    speeds.retain(|v| *v > 0.0);
    speeds.sort_by(f64::total_cmp);
    let wide = (1.0 + options.velocity_tolerance) / (1.0 - options.velocity_tolerance);
    let mut plateaus = Vec::new();
    while !speeds.is_empty() {
        let mut best = (0, 0.0);
        let mut to = 0;
        for from in 0..speeds.len() {
            while to < speeds.len() && speeds[to] <= wide * speeds[from] {
                to += 1;
            }
            if to - from > best.0 {
                best = (to - from, speeds[(from + to) / 2]);
            }
        }
        let (count, speed) = best;
        if (count as f64) < options.minimum_dwell * all {
            break;
        }
        plateaus.push((speed, count as f64 / all));
        // Ripple about a plateau is not a separate plateau.
        speeds.retain(|v| (v / speed - 1.0).abs() > DISTINCT);
    }
    plateaus
}

/// Runs of at least the minimum duration within the tolerance of `speed`.
///
/// A run continues across samples outside the tolerance when the mean speed over them is the
/// plateau's: vibration, or a position briefly held by a logger.
fn runs(
    recording: &Recording,
    velocity: &[f64],
    stroke: &Stroke,
    speed: f64,
    options: &SegmentOptions,
    mut on: impl FnMut(usize, usize),
) {
    let sign = stroke.direction.sign();
    let (x, t) = (&recording.position, &recording.time);
    let tolerance = options.velocity_tolerance;
    let keeps_speed = |from: usize, to: usize| {
        (sign * (x[to] - x[from]) / (t[to] - t[from]) / speed - 1.0).abs() <= 2.0 * tolerance
    };
    let within = (stroke.start..stroke.end)
        .filter(|i| (sign * velocity[*i] / speed - 1.0).abs() <= tolerance);
    let mut run: Option<(usize, usize)> = None;
    let mut close = |run: Option<(usize, usize)>| {
        if let Some((start, last)) = run
            && last > start + 4
            && t[last] - t[start] >= options.minimum_duration
        {
            on(start, last + 1);
        }
    };
    for i in within {
        run = match run {
            Some((start, last)) if i == last + 1 || keeps_speed(last, i) => Some((start, i)),
            broken => {
                close(broken);
                Some((i, i))
            }
        };
    }
    close(run);
}

/// Travel, m, of sample `i` since the start of its stroke; increases along the motion.
pub fn travel(recording: &Recording, stroke: &Stroke, i: usize) -> f64 {
    stroke.direction.sign() * (recording.position[i] - recording.position[stroke.start])
}

/// The part of each segment that lies at least `needed(|v|)` metres after the start of its stroke;
/// segments without such a part are omitted.
pub fn after_start(
    recording: &Recording,
    strokes: &[Stroke],
    steady_segments: &[SteadySegment],
    needed: impl Fn(f64) -> f64,
) -> Vec<SteadySegment> {
    steady_segments
        .iter()
        .filter_map(|segment| {
            let needed = needed(segment.velocity.abs());
            let stroke = &strokes[segment.stroke];
            let start =
                (segment.start..segment.end).find(|i| travel(recording, stroke, *i) >= needed)?;
            Some(SteadySegment { start, ..*segment })
        })
        .collect()
}

/// The second half of the travel of a segment.
pub fn latter_half(recording: &Recording, segment: &SteadySegment) -> SteadySegment {
    let x = &recording.position;
    let middle = 0.5 * (x[segment.start] + x[segment.end - 1]);
    let inserting = x[segment.end - 1] > x[segment.start];
    let start = (segment.start..segment.end)
        .find(|i| if inserting { x[*i] >= middle } else { x[*i] <= middle })
        .unwrap_or(segment.start);
    SteadySegment { start, ..*segment }
}

/// Strokes and constant-velocity segments of one recording.
#[derive(Debug, Clone)]
pub struct Segments {
    /// Strokes, in time.
    pub strokes: Vec<Stroke>,
    /// Constant-velocity segments, in time.
    pub steady_segments: Vec<SteadySegment>,
}

impl Segments {
    /// The constant-velocity segments of each velocity plateau.
    pub fn plateaus(&self) -> impl Iterator<Item = &[SteadySegment]> {
        self.steady_segments.chunk_by(|a, b| a.plateau == b.plateau)
    }
}

/// Divides a recording.
#[must_use]
pub fn segment(recording: &Recording, options: &SegmentOptions) -> Segments {
    let strokes = strokes(recording, reversal_threshold(recording));
    let steady_segments = steady_segments(recording, &strokes, options);
    Segments { strokes, steady_segments }
}
