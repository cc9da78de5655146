//! Positions between the counts of a coarse encoder.
//!
//! ```text
//! x = e + 4·h·u·(1 − u)        h = s·d²/(D² − d²)
//! ```
//! Where the readings before and after one are equal, the motion turns within it. Half way to them,
//! at e, the reading changes. A constant acceleration makes x a parabola of height h above e: s is
//! the distance of the readings, d the time that this one lasts, D that time with the readings
//! beside it, u the fraction of d. A height beyond s means a rest, and counts as s/2. The readings
//! themselves err by the same distance at all reversals of one speed, since rigs turn at the same
//! places, and so bias the half width by it. Where a reading repeats in slow motion, the positions
//! are linear from edge to edge: speeds of no or one step would bias the viscous damping towards
//! zero (errors in variables).

use std::borrow::Cow;
use std::ops::Range;

use super::Recording;

/// Step of the positions, m, from which it matters: 0.2 % of the smallest half widths in use.
pub const COARSE: f64 = 2e-5;

/// The readings of an unbroken part.
struct Readings<'a> {
    recording: &'a Recording,
    /// The samples of each.
    samples: Vec<Range<usize>>,
    /// Times, s, at which they begin and end.
    edges: Vec<f64>,
}

impl Recording {
    /// Step of the positions, m; 0 where it does not matter.
    #[must_use]
    pub fn coarse_step(&self) -> f64 {
        Some(self.quality.position_resolution).filter(|step| *step >= COARSE).unwrap_or(0.0)
    }

    /// The recording, with positions between the counts where these are coarse.
    #[must_use]
    pub fn between_counts(&self) -> Cow<'_, Self> {
        if self.coarse_step() == 0.0 {
            return Cow::Borrowed(self);
        }
        let parts = self.unbroken().map(|part| Readings::new(self, part));
        let position = parts.flat_map(|part| part.positions()).collect();
        Cow::Owned(Self { position, ..self.clone() })
    }
}

impl<'a> Readings<'a> {
    fn new(recording: &'a Recording, part: Range<usize>) -> Self {
        let (time, position) = (&recording.time, &recording.position);
        let mut samples: Vec<Range<usize>> = Vec::new();
        for i in part.clone() {
            match samples.last_mut() {
                Some(last) if position[last.start] == position[i] => last.end = i + 1,
                _ => samples.push(i..i + 1),
            }
        }
        let changes = samples.iter().skip(1).map(|s| 0.5 * (time[s.start - 1] + time[s.start]));
        let ends = [part.start, part.end - 1].map(|i| time[i]);
        let edges = std::iter::once(ends[0]).chain(changes).chain([ends[1]]).collect();
        Self { recording, samples, edges }
    }

    fn reading(&self, k: usize) -> f64 {
        self.recording.position[self.samples[k].start]
    }

    fn duration(&self, k: usize) -> f64 {
        self.edges[k + 1] - self.edges[k]
    }

    /// Positions of all samples, m.
    fn positions(&self) -> Vec<f64> {
        let positions = (0..self.samples.len()).flat_map(|k| {
            let (turning, passes) = (self.turning(k), self.passes(k));
            self.samples[k].clone().map(move |i| match turning {
                Some([edge, height]) => {
                    let part = (self.recording.time[i] - self.edges[k]) / self.duration(k);
                    edge + 4.0 * height * part * (1.0 - part)
                }
                None if passes => self.passing(k, self.recording.time[i]),
                None => self.reading(k),
            })
        });
        positions.collect()
    }

    /// Whether the motion passes reading `k`, in one direction, and slowly enough to repeat it.
    fn passes(&self, k: usize) -> bool {
        let is_inside = k > 0 && k + 1 < self.samples.len();
        let on = |k: usize| self.reading(k + 1) > self.reading(k);
        is_inside && self.samples[k].len() > 1 && on(k - 1) == on(k)
    }

    /// The position within such a reading, m: from the edge half way to the last reading, to the edge
    /// half way to the next. A reading that lasts more than twice as long as its neighbour is a rest.
    fn passing(&self, k: usize, time: f64) -> f64 {
        let neighbours = [(k - 1, time - self.edges[k]), (k + 1, self.edges[k + 1] - time)];
        let [before, after] = neighbours.map(|(other, since)| {
            let on_the_way = (0.5 * self.duration(k)).min(self.duration(other));
            let left = (1.0 - since / on_the_way).max(0.0);
            0.5 * left * (self.reading(other) - self.reading(k))
        });
        self.reading(k) + before + after
    }

    /// e and the height above it, where reading `k` is a turning point.
    fn turning(&self, k: usize) -> Option<[f64; 2]> {
        let is_turning =
            k > 0 && k + 1 < self.samples.len() && self.reading(k - 1) == self.reading(k + 1);
        is_turning.then(|| {
            let step = self.reading(k) - self.reading(k - 1);
            let own = self.duration(k).powi(2);
            let height = own / ((self.edges[k + 2] - self.edges[k - 1]).powi(2) - own);
            [self.reading(k) - 0.5 * step, step * if height > 1.0 { 0.5 } else { height }]
        })
    }
}
