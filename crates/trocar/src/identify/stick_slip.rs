//! A force that swings by itself at constant speed: stick-slip.
//!
//! A model with the right forces is soon out of phase with such readings, so the squared error tells nothing of them. What does not
//! depend on the phase is a result of its own: at which speeds, how often, and between which forces.

use serde::Serialize;

use super::Segments;
use crate::recording::{Recording, range};
use crate::segment::Stretch;

/// Fewest swings, and least swing as a part of the force and of the sensor noise, that count as stick-slip.
const FEWEST_SWINGS: usize = 8;
const LEAST_SWING: f64 = 0.06;
const OVER_NOISE: f64 = 6.0;
/// Fewest plateaus that swing.
const FEWEST_PLATEAUS: usize = 2;

/// Where and how the force swings by itself: least and greatest over the plateaus of the velocity that do.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StickSlip {
    /// Plateaus of the velocity that swing.
    pub plateaus: usize,
    /// Speed of the instrument, m/s.
    pub speed_m_s: [f64; 2],
    /// Cycles a second.
    pub frequency_hz: [f64; 2],
    /// Amount of the force, N, without the sensor's offset: the mean of the lower ends of the swings, at which a slip ends, and of the
    /// upper ones, at which it begins: the static force F_s.
    pub force_n: [f64; 2],
}

/// One plateau that swings.
struct Oscillation {
    frequency: f64,
    force: [f64; 2],
    speed: f64,
}

impl StickSlip {
    /// `None` where the force does not swing by itself on two plateaus or more.
    pub(super) fn of(recordings: &[Recording], segments: &[Segments], offset: f64) -> Option<Self> {
        let all: Vec<Oscillation> =
            recordings.iter().zip(segments).flat_map(|(r, s)| oscillations(r, s, offset)).collect();
        let over = |of: fn(&Oscillation) -> f64| {
            let (low, high) = range(&all.iter().map(of).collect::<Vec<f64>>());
            [low, high]
        };
        let mean = |k: usize| all.iter().map(|o| o.force[k]).sum::<f64>() / all.len() as f64;
        (all.len() >= FEWEST_PLATEAUS).then(|| Self {
            plateaus: all.len(),
            speed_m_s: over(|o| o.speed),
            frequency_hz: over(|o| o.frequency),
            force_n: [mean(0), mean(1)],
        })
    }

    /// What a reader should know.
    pub(super) fn in_words(&self) -> String {
        let [slow, fast] = self.speed_m_s.map(|v| format!("{:.0}", 1e3 * v));
        let speeds = if slow == fast { slow } else { format!("{slow} to {fast}") };
        let [low, high] = self.force_n;
        format!(
            "at {speeds} mm/s the force swings between {low:.2} and {high:.2} N, {:.1} to {:.1} times a second: the seal sticks and \
             slips. The static force F_s is the upper of the two, whatever the fit says: it cannot follow when each slip comes, so its \
             sliding forces, Stribeck velocity and c may be off; record faster strokes, too",
            self.frequency_hz[0], self.frequency_hz[1]
        )
    }
}

/// Swings of the force about its mean on each plateau of the velocity, behind its first third, counted with a hysteresis of a quarter of
/// the swing. A plateau is taken whole: the slips of a seal shake the drive, too.
fn oscillations(recording: &Recording, segments: &Segments, offset: f64) -> Vec<Oscillation> {
    let of = |plateau: &[Stretch]| {
        let (start, end) = (plateau.first()?.start, plateau.last()?.end);
        let (from, last) = (start + (end - start) / 3, end - 1);
        let force = &recording.force[from..end];
        let mut sorted = force.to_vec();
        sorted.sort_by(f64::total_cmp);
        let quantile = |part: f64| sorted[(part * (sorted.len() - 1) as f64) as usize];
        let (low, middle, high) = (quantile(0.02), quantile(0.5), quantile(0.98));
        let swing = high - low;
        if swing < LEAST_SWING * (middle - offset).abs() + OVER_NOISE * recording.quality.force_noise {
            return None;
        }
        let (mut above, mut swings) = (force[0] > middle, 0);
        for f in force {
            let crossed = if above { *f < middle - 0.25 * swing } else { *f > middle + 0.25 * swing };
            if crossed {
                above = !above;
                swings += 1;
            }
        }
        let passed = |of: &[f64]| of[last] - of[from];
        let time = passed(&recording.time);
        let (frequency, speed) = (0.5 * f64::from(swings) / time, (passed(&recording.position) / time).abs());
        let [one, other] = [low, high].map(|level| (level - offset).abs());
        let force = [one.min(other), one.max(other)];
        (swings as usize >= FEWEST_SWINGS).then_some(Oscillation { frequency, force, speed })
    };
    segments.stretches.chunk_by(|a, b| a.plateau == b.plateau).filter_map(of).collect()
}
