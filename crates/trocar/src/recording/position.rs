//! What a position sensor may do to its readings: single ones that are off, and all of them late.

use super::{MIN_SAMPLES, Recording, RecordingError};

/// A glitch is off the line between its neighbours by this many times noise and resolution ...
const OVER_NOISE: f64 = 10.0;
/// ... and by this many times what the neighbours are off theirs.
const OVER_NEIGHBOURS: f64 = 3.0;

impl Recording {
    /// The recording with each single position that jumps off and comes straight back put between its neighbours, and a
    /// note on how many those were. A model that integrates the motion would turn over at each of them.
    #[must_use]
    pub fn without_glitches(mut self) -> Self {
        let least = OVER_NOISE * self.quality.position_noise.max(self.quality.position_resolution);
        let (t, x) = (&self.time, &self.position);
        let between = |i: usize, a: usize, b: usize| x[a] + (x[b] - x[a]) * (t[i] - t[a]) / (t[b] - t[a]);
        let mut glitches = Vec::new();
        for range in self.unbroken().filter(|range| range.len() > 4) {
            for i in range.start + 2..range.end - 2 {
                let value = between(i, i - 1, i + 1);
                let off = (x[i] - value).abs();
                let before = (x[i - 1] - between(i - 1, i - 2, i + 1)).abs();
                let behind = (x[i + 1] - between(i + 1, i - 1, i + 2)).abs();
                if off > least && off > OVER_NEIGHBOURS * before.max(behind) {
                    glitches.push((i, value));
                }
            }
        }
        for (i, value) in &glitches {
            self.position[*i] = *value;
        }
        if let (count @ 1.., Some((first, _))) = (glitches.len(), glitches.first()) {
            let (what, at) = (if count == 1 { "position jumps" } else { "positions jump" }, self.time[*first]);
            let note =
                format!("{count} single {what} off and straight back, first at {at:.3} s: put between neighbours");
            self.quality.notes.push(note);
        }
        self
    }

    /// The recording with every force beside the position that was read `lag` seconds later: what a position sensor with
    /// that delay would have read in time. The last `lag` seconds before an end or a gap are lost.
    ///
    /// # Errors
    /// [`RecordingError::TooFewSamples`] when too little is left, and for a lag that is no number ≥ 0.
    pub fn with_position_lag(&self, lag: f64) -> Result<Self, RecordingError> {
        if lag == 0.0 {
            return Ok(self.clone());
        }
        let mut all = Self { quality: self.quality.clone(), name: self.name.clone(), ..Self::empty(&self.sha256) };
        let quality = &mut all.quality;
        quality.breaks.clear();
        for range in self.unbroken() {
            let (t, x) = (&self.time[range.clone()], &self.position[range.clone()]);
            let from = all.time.len();
            quality.gaps.iter_mut().filter(|gap| gap.index == range.start).for_each(|gap| gap.index = from);
            quality.resets.iter_mut().filter(|reset| reset.index == range.start).for_each(|reset| reset.index = from);
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
                all.force.push(self.force[range.start + i]);
            }
            if from > 0 && all.time.len() > from {
                quality.breaks.push(from);
            }
        }
        if all.time.len() < MIN_SAMPLES {
            let (file, found) = (self.name.clone(), all.time.len());
            return Err(RecordingError::TooFewSamples { file, found, needed: MIN_SAMPLES });
        }
        quality.notes.push(format!("positions taken {:.0} ms later", 1e3 * lag));
        Ok(all)
    }

    fn empty(sha256: &str) -> Self {
        Self {
            name: String::new(),
            sha256: sha256.to_owned(),
            time: Vec::new(),
            position: Vec::new(),
            force: Vec::new(),
            velocity: None,
            quality: super::Quality::default(),
        }
    }
}
