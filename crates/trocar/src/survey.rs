//! Content of recordings, determined before any fit.
//!
//! Strokes and constant-velocity segments decide which parameters an identification can
//! determine. The survey shows what is still to be recorded, without waiting for the fit.

use rayon::prelude::*;

use trocar_recording::{Recording, range};
use trocar_simulate::segment::{
    Direction, SegmentOptions, reversal_threshold, steady_segments, strokes,
};

/// Speeds with a relative difference below this count as one.
const SAME_SPEED: f64 = 0.05;

/// Content of one recording.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordingSurvey {
    /// File name without its folder.
    pub name: String,
    /// Samples.
    pub samples: usize,
    /// Time from the first to the last sample, s.
    pub duration: f64,
    /// Range of the position, m.
    pub stroke: f64,
    /// Least and largest force, N.
    pub force: (f64, f64),
    /// Strokes between reversals.
    pub strokes: usize,
    /// Strokes that start at a reversal.
    pub reversals: usize,
    /// Constant-velocity segments.
    pub steady_segments: usize,
    /// Different speeds of insertion, m/s, in ascending order.
    pub insertion_speeds: Vec<f64>,
    /// Different speeds of withdrawal, m/s, in ascending order.
    pub withdrawal_speeds: Vec<f64>,
}

/// Content of all recordings together.
#[derive(Debug, Clone, PartialEq)]
pub struct Survey {
    /// One entry per recording.
    pub recordings: Vec<RecordingSurvey>,
    /// Parameters that they cannot determine, as messages.
    pub limits: Vec<String>,
}

impl Survey {
    /// Surveys `recordings`.
    pub fn new(recordings: &[Recording], options: &SegmentOptions) -> Self {
        let recordings: Vec<RecordingSurvey> =
            recordings.par_iter().map(|r| RecordingSurvey::new(r, options)).collect();
        let limits = limits(&recordings);
        Self { recordings, limits }
    }
}

impl RecordingSurvey {
    fn new(recording: &Recording, options: &SegmentOptions) -> Self {
        let strokes = strokes(recording, reversal_threshold(recording));
        let steady_segments = steady_segments(recording, &strokes, options);
        let [insertion_speeds, withdrawal_speeds] = Direction::BOTH.map(|direction| {
            let own = steady_segments.iter().filter(|s| strokes[s.stroke].direction == direction);
            different(own.map(|s| s.velocity.abs()).collect())
        });
        Self {
            name: recording.name.clone(),
            samples: recording.len(),
            duration: recording.duration(),
            stroke: recording.quality.stroke,
            force: range(&recording.force),
            reversals: strokes.iter().filter(|stroke| stroke.starts_at_reversal).count(),
            insertion_speeds,
            withdrawal_speeds,
            strokes: strokes.len(),
            steady_segments: steady_segments.len(),
        }
    }
}

/// Speeds in ascending order, one for each group of similar ones.
fn different(mut speeds: Vec<f64>) -> Vec<f64> {
    speeds.sort_by(f64::total_cmp);
    speeds.dedup_by(|next, kept| *next <= *kept * (1.0 + SAME_SPEED));
    speeds
}

fn limits(recordings: &[RecordingSurvey]) -> Vec<String> {
    let all = |of: fn(&RecordingSurvey) -> &Vec<f64>| {
        different(recordings.iter().flat_map(of).copied().collect())
    };
    let (insertion, withdrawal) = (all(|r| &r.insertion_speeds), all(|r| &r.withdrawal_speeds));
    let reversals: usize = recordings.iter().map(|r| r.reversals).sum();
    let dead = recordings.iter().filter(|r| r.force.0 == r.force.1).map(|r| {
        format!(
            "{}: the force is {} N throughout: is the sensor connected?",
            r.name,
            r.force.0 + 0.0
        )
    });
    let mut found: Vec<String> = dead.collect();
    if reversals == 0 {
        found.push(
            "no reversal: the deformation of the seal (its half width and its branches) cannot be seen".to_owned(),
        );
    }
    match (insertion.len(), withdrawal.len()) {
        (0, 0) => {}
        (0, _) | (_, 0) => found.push(
            "steady sliding in one direction only: the sensor offset cannot be distinguished from the Coulomb force"
                .to_owned(),
        ),
        (1, 1) if insertion[0].max(withdrawal[0]) <= insertion[0].min(withdrawal[0]) * (1.0 + SAME_SPEED) => {
            found.push("one speed: the viscous part cannot be distinguished from the Coulomb force".to_owned());
        }
        (1, _) | (_, 1) => found.push(
            "one speed in one direction: a difference of the viscous damping between the directions is not determined"
                .to_owned(),
        ),
        _ => {}
    }
    if let Some(slowest) = insertion.iter().chain(&withdrawal).copied().reduce(f64::min) {
        found.push(format!(
            "no constant velocity below {:.1} mm/s: a rise of the friction at lower speeds (Stribeck) cannot be seen; \
             if it matters, record slower strokes",
            1e3 * slowest
        ));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Saw tooth of `strokes` strokes over 50 mm, with the speeds in turn; the force is irrelevant.
    fn saw(strokes: usize, speeds: &[f64]) -> Recording {
        let (mut time, mut position) = (vec![0.0], vec![0.0]);
        for stroke in 0..strokes {
            let speed = speeds[stroke % speeds.len()] * if stroke % 2 == 0 { 1.0 } else { -1.0 };
            for _ in 0..(0.05 / speed.abs() / 1e-3) as usize {
                time.push(time[time.len() - 1] + 1e-3);
                position.push(position[position.len() - 1] + 1e-3 * speed);
            }
        }
        let force = position.iter().map(|x| x.sin()).collect();
        Recording::from_columns("saw.csv", time, position, force).unwrap()
    }

    fn limits_of(recording: Recording) -> String {
        Survey::new(&[recording], &SegmentOptions::default()).limits.join("\n")
    }

    #[test]
    fn what_is_missing_is_named() {
        assert!(limits_of(saw(1, &[0.03])).contains("no reversal"));
        assert!(limits_of(saw(1, &[0.03])).contains("in one direction only"));
        assert!(limits_of(saw(4, &[0.03])).contains("one speed:"));
        let mut dead = saw(4, &[0.03]);
        dead.force.fill(-0.0);
        assert!(limits_of(dead).contains("saw.csv: the force is 0 N throughout"));
        let enough = limits_of(saw(6, &[0.02, 0.02, 0.05, 0.05, 0.08, 0.08]));
        assert!(!enough.contains("no reversal") && !enough.contains("one speed"), "{enough}");
    }

    #[test]
    fn speeds_are_counted_once_for_each_direction() {
        let survey = Survey::new(
            &[saw(6, &[0.02, 0.02, 0.05, 0.05, 0.08, 0.08])],
            &SegmentOptions::default(),
        );
        let found = &survey.recordings[0];
        assert_eq!((found.strokes, found.reversals), (6, 5));
        assert_eq!((found.insertion_speeds.len(), found.withdrawal_speeds.len()), (3, 3));
        assert!((found.insertion_speeds[1] - 0.05).abs() < 1e-3, "{:?}", found.insertion_speeds);
    }
}
