//! Errors of a position sensor: single outliers, and a delay of all readings.

use super::screen::MIN_SAMPLES;
use super::{Choice, Recording, RecordingError};

/// A glitch deviates from the line through its neighbours by this many times noise and resolution,
/// at least by [`FLOOR`] ...
const OVER_NOISE: f64 = 10.0;
/// ... and by this many times the median deviation of the neighbours.
const OVER_NEIGHBOURS: f64 = 4.0;
/// Least size of a glitch, m.
const FLOOR: f64 = 1e-6;
/// Neighbours on either side.
const NEIGHBOURS: usize = 3;

fn median<const N: usize>(mut values: [f64; N]) -> f64 {
    values.sort_by(f64::total_cmp);
    0.5 * (values[(N - 1) / 2] + values[N / 2])
}

/// Deviation of `x[i]` from the line through its neighbours, and their own median deviation, m. The
/// line has the median slope (THEIL), so another glitch among the neighbours does not affect it.
fn off_line(t: &[f64], x: &[f64], i: usize) -> (f64, f64) {
    let near: [usize; 2 * NEIGHBOURS] = std::array::from_fn(|k| {
        if k < NEIGHBOURS { i - NEIGHBOURS + k } else { i + 1 + k - NEIGHBOURS }
    });
    let mut slopes = [0.0; NEIGHBOURS * (2 * NEIGHBOURS - 1)];
    let pairs = (0..near.len()).flat_map(|b| (0..b).map(move |a| (near[a], near[b])));
    slopes.iter_mut().zip(pairs).for_each(|(slope, (a, b))| *slope = (x[b] - x[a]) / (t[b] - t[a]));
    let slope = median(slopes);
    let level = median(near.map(|k| x[k] - slope * (t[k] - t[i])));
    let off = |k: usize| (x[k] - level - slope * (t[k] - t[i])).abs();
    (off(i), median(near.map(off)))
}

impl Recording {
    /// The recording with single positions that jump away and immediately return replaced by
    /// interpolation, and a note with their number. A model that integrates the motion would snap
    /// through at each of them.
    #[must_use]
    pub fn without_glitches(mut self) -> Self {
        let least = (OVER_NOISE
            * self.quality.position_noise.max(self.quality.position_resolution))
        .max(FLOOR);
        let (t, x) = (&self.time, &self.position);
        let glitches: Vec<usize> = self
            .unbroken()
            .flat_map(|range| {
                (range.start + NEIGHBOURS..range.end.saturating_sub(NEIGHBOURS)).filter(|i| {
                    let (off, neighbours) = off_line(t, x, *i);
                    off > least.max(OVER_NEIGHBOURS * neighbours)
                })
            })
            .collect();
        for run in glitches.clone().chunk_by(|a, b| b - a == 1) {
            let (a, b) = (run[0] - 1, run[run.len() - 1] + 1);
            let slope = (self.position[b] - self.position[a]) / (self.time[b] - self.time[a]);
            for i in run {
                self.position[*i] = self.position[a] + slope * (self.time[*i] - self.time[a]);
            }
        }
        if let (count @ 1.., Some(first)) = (glitches.len(), glitches.first()) {
            let (what, at) =
                (if count == 1 { "position jumps" } else { "positions jump" }, self.time[*first]);
            let note = format!(
                "{count} single {what} off and straight back, first at {at:.3} s: interpolated between the neighbours"
            );
            self.quality.notes.push(note);
        }
        self
    }

    /// The recording with each force paired with the position that was read `lag` seconds later,
    /// which compensates that delay of the position sensor. The last `lag` seconds before an end or
    /// a gap are lost.
    ///
    /// # Errors
    /// [`RecordingError::TooFewSamples`] when too little is left, and for a lag that is not a
    /// number ≥ 0.
    pub fn with_position_delay(&self, lag: f64) -> Result<Self, RecordingError> {
        if lag == 0.0 {
            return Ok(self.clone());
        }
        let mut all = Self {
            quality: self.quality.clone(),
            name: self.name.clone(),
            expected_acceleration: self.expected_acceleration.as_ref().map(|_| Vec::new()),
            angle: self.angle.as_ref().map(|_| Vec::new()),
            torque: self.torque.as_ref().map(|_| Vec::new()),
            loads: self.loads.each_ref().map(|load| load.as_ref().map(|_| Vec::new())),
            ..Self::empty(&self.sha256, &self.choice)
        };
        let quality = &mut all.quality;
        quality.breaks.clear();
        for range in self.unbroken() {
            let (t, x) = (&self.time[range.clone()], &self.position[range.clone()]);
            let from = all.time.len();
            quality
                .gaps
                .iter_mut()
                .filter(|gap| gap.index == range.start)
                .for_each(|gap| gap.index = from);
            quality
                .resets
                .iter_mut()
                .filter(|reset| reset.index == range.start)
                .for_each(|reset| reset.index = from);
            let mut k = 0;
            for i in 0..t.len() {
                let later = t[i] + lag;
                while k + 1 < t.len() && t[k + 1] < later {
                    k += 1;
                }
                if !(lag >= 0.0 && later <= t[t.len() - 1]) || k + 1 == t.len() {
                    break;
                }
                let part = (later - t[k]) / (t[k + 1] - t[k]);
                all.time.push(t[i]);
                all.position.push(x[k] + part * (x[k + 1] - x[k]));
                let expected = (&mut all.expected_acceleration, &self.expected_acceleration);
                for (all, own) in [(&mut all.angle, &self.angle), expected] {
                    if let (Some(all), Some(own)) = (all, own) {
                        let [from, to] = [0, 1].map(|next| own[range.start + k + next]);
                        all.push(from + part * (to - from));
                    }
                }
                all.force.push(self.force[range.start + i]);
                let beside = all.loads.iter_mut().zip(&self.loads);
                for (all, own) in beside.chain([(&mut all.torque, &self.torque)]) {
                    all.iter_mut().zip(own).for_each(|(all, own)| all.push(own[range.start + i]));
                }
            }
            if from > 0 && all.time.len() > from {
                quality.breaks.push(from);
            }
        }
        if all.time.len() < MIN_SAMPLES {
            let (file, found) = (self.name.clone(), all.time.len());
            let (needed, lost) = (MIN_SAMPLES, String::new());
            return Err(RecordingError::TooFewSamples { file, found, needed, lost });
        }
        quality.notes.push(format!("position delay of {:.0} ms compensated", 1e3 * lag));
        Ok(all)
    }

    fn empty(sha256: &str, choice: &Choice) -> Self {
        Self {
            name: String::new(),
            sha256: sha256.to_owned(),
            time: Vec::new(),
            position: Vec::new(),
            force: Vec::new(),
            velocity: None,
            expected_acceleration: None,
            angle: None,
            torque: None,
            loads: Default::default(),
            quality: super::Quality::default(),
            choice: choice.clone(),
        }
    }
}
