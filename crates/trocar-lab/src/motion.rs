//! What a model has seen: the motion and the forces of the recordings that it was identified from.

use serde::Serialize;
use trocar_recording::{Recording, range};
use trocar_simulate::segment::{reversal_threshold, strokes};

use crate::validate::{is_held, typical_speed};

/// Motion and force of recordings.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MotionRange {
    /// Slowest and fastest stroke, m/s; 0 without strokes.
    pub speed_m_s: [f64; 2],
    /// Shortest and longest stroke, m; 0 without strokes.
    pub stroke_m: [f64; 2],
    /// Lowest and highest force on the seal, N.
    pub force_n: [f64; 2],
    /// Longest rest, s.
    pub longest_rest_s: f64,
}

impl MotionRange {
    /// Of `recordings`, whose readings include the sensor offset `offset`, N.
    pub fn of(recordings: &[Recording], offset: f64) -> Self {
        let (mut speeds, mut lengths, mut forces) = (Vec::new(), Vec::new(), Vec::new());
        let mut longest_rest_s = 0.0_f64;
        for recording in recordings {
            for stroke in strokes(recording, reversal_threshold(recording)) {
                let [from, to] = [stroke.start, stroke.end].map(|i| recording.position[i]);
                lengths.push((to - from).abs());
                speeds.push(typical_speed(recording, stroke.start, stroke.end));
            }
            let (low, high) = range(&recording.force);
            forces.extend([low - offset, high - offset]);
            let (held, time) = (is_held(recording), &recording.time);
            for part in recording.unbroken() {
                let mut from = part.start;
                for i in part {
                    from = if held[i] { from } else { i };
                    longest_rest_s = longest_rest_s.max(time[i] - time[from]);
                }
            }
        }
        let [speed_m_s, stroke_m, force_n] = [speeds, lengths, forces]
            .map(|values| if values.is_empty() { [0.0; 2] } else { range(&values).into() });
        Self { speed_m_s, stroke_m, force_n, longest_rest_s }
    }
}
