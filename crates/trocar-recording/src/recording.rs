//! A recording: samples of one motion in SI units, with their quality.

use std::io::Write;
use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::RecordingError;
use super::block::SampleRow;
use super::choice::Choice;
use super::collect::Collector;
use super::quality::{Quality, Saturation};
use super::samples::{self, ByQuantity, Count, Readings, Recorded, columns, cut};
use super::statistics::range;
use super::units::Quantity;

/// Range of a force, as a fraction of its largest value, that is rounding.
const CONSTANT_FORCE: f64 = 1e-9;

/// One recording in SI units; all columns have the same length and time is strictly increasing.
#[derive(Debug, Clone)]
pub struct Recording {
    /// File name without its folder.
    pub name: String,
    /// SHA-256 of the file's bytes (of its text in UTF-8 if it is compressed by gzip or zstd, or in
    /// UTF-16), or of the columns when there is no file; lower-case hexadecimal.
    pub sha256: String,
    /// Time in s.
    pub time: Vec<f64>,
    /// Position in m, increasing on insertion.
    pub position: Vec<f64>,
    /// Force in N, of the device on the seal.
    pub force: Vec<f64>,
    /// Velocity in m/s, if the file has it.
    pub velocity: Option<Vec<f64>>,
    /// Expected acceleration in m/s², where the positions are those of [`Recording::smoothed`].
    pub expected_acceleration: Option<Vec<f64>>,
    /// Angle of the instrument about its axis in rad, if the file has it.
    pub angle: Option<Vec<f64>>,
    /// Torque of the instrument on the seal in N·m, positive with the angle, if the file has it.
    pub torque: Option<Vec<f64>>,
    /// Loads beside the force of the seal, as [`crate::loads`] has them.
    pub loads: Recorded,
    /// Quality of the data.
    pub quality: Quality,
    /// How it was read from its file.
    pub choice: Choice,
}

/// Options for reading a file.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ReadOptions {
    /// What to read from the file.
    #[serde(flatten)]
    pub choice: Choice,
    /// Largest force the sensor can read, in N; readings there count as saturated.
    #[serde(rename = "sensor_limit_n")]
    pub sensor_limit: Option<f64>,
    /// Most samples to keep; of a longer recording, excerpts spread over its whole length are kept,
    /// and a note reports this.
    pub most_samples: Option<usize>,
    /// Most memory the columns may take, in bytes.
    #[serde(rename = "memory_limit_bytes")]
    pub memory_limit: Option<u64>,
}

/// Rejects a largest force, N, that no sensor has.
///
/// # Errors
/// [`RecordingError::OutOfRange`].
pub fn check_sensor_limit(limit: Option<f64>) -> Result<(), RecordingError> {
    let wrong = limit.filter(|limit| !(limit.is_finite() && *limit > 0.0));
    wrong.map_or(Ok(()), |found| {
        let (option, allowed, unit) = ("sensor_limit_n", "positive", "N");
        Err(RecordingError::OutOfRange { option, allowed, found, unit })
    })
}

/// Least and greatest force, N, that the recordings allow; infinite where a sensor saturated.
#[must_use]
pub fn force_range(recordings: &[Recording]) -> [f64; 2] {
    if recordings.iter().any(|r| !r.quality.saturated.is_empty()) {
        return [f64::NEG_INFINITY, f64::INFINITY];
    }
    let all = recordings.iter().map(|r| range(&r.force));
    all.fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], (low, high)| {
        [least.min(low), most.max(high)]
    })
}

impl Recording {
    pub(crate) fn of(name: String, sha256: String, collected: (samples::Columns, Quality)) -> Self {
        let (columns, quality) = collected;
        let Readings { time, position, force, velocity, angle, torque, loads } = columns.readings;
        let choice = Choice::default();
        Self {
            name,
            sha256,
            time,
            position,
            force,
            velocity,
            expected_acceleration: None,
            angle,
            torque,
            loads,
            quality,
            choice,
        }
    }

    /// A recording from columns in SI units, checked like one from a file.
    ///
    /// # Errors
    /// [`RecordingError`] when the columns differ in length or the data are invalid, as for
    /// [`read`](crate::read).
    pub fn from_columns(
        name: impl Into<String>,
        time: Vec<f64>,
        position: Vec<f64>,
        force: Vec<f64>,
    ) -> Result<Self, RecordingError> {
        let readings = Readings { time, position, force, ..Readings::default() };
        Self::from_readings(name, &readings, None)
    }

    /// The same with a velocity column, and with `sensor_limit`, N, as in [`ReadOptions`].
    ///
    /// # Errors
    /// As for [`Recording::from_columns`].
    pub fn from_readings(
        name: impl Into<String>,
        readings: &Readings,
        sensor_limit: Option<f64>,
    ) -> Result<Self, RecordingError> {
        check_sensor_limit(sensor_limit)?;
        let name = name.into();
        let (columns, samples) = (readings.columns(), readings.time.len());
        for (quantity, values) in Quantity::ALL.into_iter().zip(columns) {
            if let Some(found) = values.map(Vec::len).filter(|found| *found != samples) {
                let (file, column, expected) = (name, quantity.name(), samples);
                return Err(RecordingError::Lengths { file, column, found, expected });
            }
        }
        let mut collector =
            Collector::new(samples, |quantity| columns[quantity as usize].is_some(), None)
                .counting(Count::Samples);
        for k in 0..samples {
            let values = columns.map(|column| column.map_or(f64::NAN, |own| own[k]));
            collector.add(SampleRow { line: k as u64, values });
        }
        let collected = collector.finish(&name, sensor_limit)?;
        Ok(Self::of(name, readings.sha256(), collected))
    }

    fn columns(&self) -> ByQuantity<'_> {
        let Self { time, position, force, velocity, angle, torque, loads, .. } = self;
        columns([time, position, force], [velocity, angle, torque], loads)
    }

    /// Writes the columns, as [`Readings::write`].
    ///
    /// # Errors
    /// As for that.
    pub fn write(&self, output: impl Write) -> std::io::Result<()> {
        samples::write(self.columns(), output)
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// Whether there are no samples; never true for a recording that was read.
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// Time from the first to the last sample, in s.
    pub fn duration(&self) -> f64 {
        self.time.last().unwrap_or(&0.0) - self.time.first().unwrap_or(&0.0)
    }

    /// Whether sample `i` is at the limit of the sensor's range, as found in
    /// [`Quality::saturated`].
    pub fn is_clipped(&self, i: usize) -> bool {
        let force = self.force[i];
        self.quality
            .saturated
            .iter()
            .any(|s| if s.level < 0.0 { force <= s.level } else { force >= s.level })
    }

    /// Whether the samples are dense enough to resolve the acceleration of a reversal, which lasts some
    /// hundredths of a second and needs five positions.
    pub fn resolves_reversals(&self) -> bool {
        const REVERSAL: f64 = 0.03;
        5.0 * self.quality.median_interval <= REVERSAL
    }

    /// Ranges of samples without a gap or reset; no conclusion may be drawn across their ends.
    pub fn unbroken(&self) -> impl Iterator<Item = Range<usize>> + '_ {
        let starts = std::iter::once(0).chain(self.quality.breaks.iter().copied());
        let ends = self.quality.breaks.iter().copied().chain(std::iter::once(self.len()));
        starts.zip(ends).map(|(from, to)| from..to)
    }

    /// The samples in `range` as a separate recording, with `what` appended to its name. It keeps
    /// the notes, and the readings that are saturated in the whole recording are so in the part.
    ///
    /// # Errors
    /// As for [`Recording::from_columns`].
    pub fn part(&self, range: Range<usize>, what: &str) -> Result<Self, RecordingError> {
        let readings = cut(self.columns(), range.clone());
        let mut part = Self::from_readings(format!("{}, {what}", self.name), &readings, None)?;
        part.choice = self.choice.clone();
        if let Some(all) = &self.expected_acceleration {
            part.expected_acceleration = Some(all[range.start..range.end.min(all.len())].to_vec());
            let Quality { position_noise, position_resolution, .. } = self.quality;
            part.quality = Quality { position_noise, position_resolution, ..part.quality };
        }
        part.quality.notes.extend(self.quality.notes.iter().cloned());
        for Saturation { level, .. } in self.quality.saturated.iter().copied() {
            let mut stuck = (0..part.len()).filter(|k| match level < 0.0 {
                true => part.force[*k] <= level,
                false => part.force[*k] >= level,
            });
            let (first, others) = (stuck.next(), stuck.count());
            let is_known = part.quality.saturated.iter().any(|found| found.level == level);
            if let (Some(first), false) = (first, is_known) {
                let (count, first_line) = (1 + others, first as u64);
                part.quality.saturated.push(Saturation { count, level, first_line });
                part.quality.notes.push(format!(
                    "{count} readings at the limit of {level} N that the whole recording has"
                ));
            }
        }
        Ok(part)
    }

    /// The recording with the inertia and weight of a moving mass removed from the force:
    /// `force - mass * (acceleration + gravity)`.
    ///
    /// `mass` in kg sits between sensor and seal; `gravity` in m/s^2 is its component along the
    /// insertion axis (0 when the axis is horizontal; a constant weight may as well stay in the
    /// offset). The acceleration is [`Recording::acceleration`]. A force that never changes is
    /// not that of a sensor which feels the mass: it stays as it is.
    ///
    /// # Errors
    /// [`RecordingError::OutOfRange`] when the mass is negative or not finite;
    /// [`RecordingError::HeavyMass`] when its inertia has more than three times the range of the readings.
    pub fn without_moving_mass(mut self, mass: f64, gravity: f64) -> Result<Self, RecordingError> {
        if !(mass.is_finite() && mass >= 0.0 && gravity.is_finite()) {
            let (option, allowed) = ("moving_mass_kg", "finite and not negative");
            return Err(RecordingError::OutOfRange { option, allowed, found: mass, unit: "kg" });
        }
        let (low, high) = range(&self.force);
        if high - low <= CONSTANT_FORCE * low.abs().max(high.abs()) {
            self.quality
                .notes
                .push(format!("the force is constant: inertia of {mass} kg not subtracted"));
            return Ok(self);
        }
        let left = self.force_without_inertia(mass);
        let mut inertia: Vec<f64> =
            self.force.iter().zip(&left).map(|(force, left)| force - left).collect();
        inertia.sort_unstable_by(f64::total_cmp);
        // Without the outermost: where a recording ends the acceleration is uncertain.
        let outer = inertia.len() / 100;
        let inertia = inertia[inertia.len() - 1 - outer] - inertia[outer];
        let readings = high - low;
        if inertia > INERTIA * readings {
            let (name, found) = (self.name, mass);
            return Err(RecordingError::HeavyMass { name, found, inertia, readings });
        }
        self.force = left;
        self.force.iter_mut().for_each(|force| *force -= mass * gravity);
        self.quality.notes.push(format!("inertia of {mass} kg subtracted"));
        self.quality.subtracted_mass += mass;
        Ok(self)
    }
}

/// Range of a moving mass's inertia, in units of that of the readings, that these cannot contain:
/// what is not inertia, friction, has a range of its own below theirs, and positions are noisy.
const INERTIA: f64 = 3.0;
