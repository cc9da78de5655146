//! Faults of samples: what cannot be right about them.

use super::saved::StateRow;

/// Fastest motion of an instrument, m/s. If it is exceeded over more than this distance, m, the
/// encoder has jumped.
const FASTEST: f64 = 1.0;
const JUMP: f64 = 1e-3;
/// Largest valid reading, N.
const LARGEST: f64 = 1e6;
/// Longest time between samples over which the motion is known, s.
const LONGEST_GAP: f64 = 0.2;
/// A force reading is frozen if it stays constant for this time, s, for ten times the usual time,
/// and for this many samples ...
const FROZEN_FOR: f64 = 0.04;
const FROZEN_USUAL: f64 = 10.0;
const FROZEN_SAMPLES: u32 = 20;
/// ... while the model's force changes by more than this, N, and by this many standard deviations.
const FROZEN_CHANGE: f64 = 0.2;
const FROZEN_SIGMAS: f64 = 5.0;
/// Usual time between changes of the reading, s, before the first is observed, and the weight of
/// each new one in the mean.
const USUAL: f64 = 0.02;
const NEWEST: f64 = 0.02;

/// Fault of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Fault {
    /// The reading is not a finite number.
    NoReading,
    /// The position, or the angle, is not a finite number: the model is not stepped.
    NoPosition,
    /// The time is constant or runs backwards: the model is not stepped.
    NoDuration,
    /// The reading is at the sensor's limit: the force is larger.
    Saturated,
    /// The reading has not changed although the force must have.
    Frozen,
    /// The position, or the surface of a turning shaft, moved faster than 1 m/s, and by more than
    /// 1 mm: treated as a new zero of the encoder, not as a motion.
    Jump,
    /// More than 0.2 s since the last sample: the state of the seal is unknown until it has slid.
    Gap,
    /// Over the last strokes the reading has reversed against the friction of the model: it has the
    /// opposite sign, or the position has.
    OppositeSign,
}

impl Fault {
    /// All faults.
    pub const ALL: [Self; 8] = [
        Self::NoReading,
        Self::NoPosition,
        Self::NoDuration,
        Self::Saturated,
        Self::Frozen,
        Self::Jump,
        Self::Gap,
        Self::OppositeSign,
    ];

    /// Whether the reading contains no information about the tissue.
    pub fn spoils_reading(self) -> bool {
        matches!(
            self,
            Self::NoReading
                | Self::NoPosition
                | Self::Saturated
                | Self::Frozen
                | Self::OppositeSign
        )
    }

    /// Writes or reads the fault of a sample: 0 for none, else its place in [`Self::ALL`] plus 1.
    pub(super) fn exchange(fault: &mut Option<Self>, row: &mut StateRow) {
        let mut place = fault.map_or(0, |fault| fault as usize + 1);
        row.count(&mut place, Self::ALL.len() as u64);
        *fault = place.checked_sub(1).map(|place| Self::ALL[place]);
    }

    /// Message.
    pub fn words(self) -> &'static str {
        match self {
            Self::NoReading => "no force reading: no tissue force",
            Self::NoPosition => "no position or angle: no tissue force, the model waits",
            Self::NoDuration => "time does not advance: the model waits",
            Self::Saturated => "the force reading is at the sensor's limit: no tissue force",
            Self::Frozen => {
                "the force reading is frozen while the force must have changed: no tissue force"
            }
            Self::Jump => {
                "the position jumps (over 1 m/s): a new zero of the encoder, not a motion; the seal's state is unknown until it has slid"
            }
            Self::Gap => {
                "more than 0.2 s without a sample: the seal's state is unknown until it has slid"
            }
            Self::OppositeSign => {
                "the force reading, or the position, has the opposite sign of the model's over several strokes: no tissue force"
            }
        }
    }
}

/// Monitors the samples.
#[derive(Debug, Clone)]
pub(super) struct Watch {
    limit: f64,
    least_change: f64,
    same: Option<Same>,
    /// Mean time between changes of the reading, s.
    usual: f64,
}

/// Faults of one sample.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct SampleFaults {
    /// Of position or time.
    pub(super) motion: Option<Fault>,
    /// Of the reading.
    pub(super) reading: Option<Fault>,
}

impl SampleFaults {
    /// The more severe one.
    pub(super) fn first(self) -> Option<Fault> {
        match self.motion {
            Some(Fault::NoPosition) => self.motion,
            other => self.reading.or(other),
        }
    }
}

/// A run of equal readings.
#[derive(Debug, Clone, Copy, Default)]
struct Same {
    reading: f64,
    time: f64,
    samples: u32,
    /// Range of the model's force, N.
    low: f64,
    high: f64,
}

impl Watch {
    pub(super) fn new(limit: Option<f64>, sigma: f64) -> Self {
        let least_change = FROZEN_CHANGE.max(FROZEN_SIGMAS * sigma);
        Self { limit: limit.unwrap_or(f64::INFINITY), least_change, same: None, usual: USUAL }
    }

    pub(super) fn limit(&self) -> f64 {
        self.limit
    }

    pub(super) fn least_change(&self) -> f64 {
        self.least_change
    }

    /// Resets the monitor.
    pub(super) fn reset(&mut self) {
        (self.same, self.usual) = (None, USUAL);
    }

    /// Writes or reads all that changes.
    pub(super) fn exchange(&mut self, row: &mut StateRow) {
        row.optional(&mut self.same, Same::default(), |own, row| {
            let numbers = [&mut own.reading, &mut own.time, &mut own.low, &mut own.high];
            numbers.into_iter().for_each(|number| row.number(number));
            row.count(&mut own.samples, u64::from(u32::MAX));
        });
        row.number(&mut self.usual);
    }

    /// Faults of a sample `duration`, s, after the last one, by position and arc, m; none are `before`
    /// the first sample.
    pub(super) fn look(
        &mut self,
        before: Option<[f64; 2]>,
        place: [f64; 2],
        force: f64,
        duration: f64,
    ) -> SampleFaults {
        SampleFaults {
            motion: motion(before, place, duration),
            reading: self.reading(force, duration),
        }
    }

    fn reading(&mut self, force: f64, duration: f64) -> Option<Fault> {
        if force.is_nan() || force.abs() > LARGEST {
            return Some(Fault::NoReading);
        }
        if force.abs() >= self.limit {
            return Some(Fault::Saturated);
        }
        self.is_frozen(force, duration).then_some(Fault::Frozen)
    }

    fn is_frozen(&mut self, force: f64, duration: f64) -> bool {
        let duration = if duration > 0.0 && duration.is_finite() { duration } else { 0.0 };
        let Some(same) = self.same.as_mut().filter(|same| same.reading == force) else {
            if let Some(ended) = self.same.take() {
                self.usual += NEWEST * (ended.time + duration - self.usual);
            }
            return false;
        };
        same.time += duration;
        same.samples += 1;
        let long = same.time >= FROZEN_FOR.max(FROZEN_USUAL * self.usual)
            && same.samples >= FROZEN_SAMPLES;
        long && same.high - same.low > self.least_change
    }

    /// Records the model's force, N, that corresponds to a reading.
    pub(super) fn follow(&mut self, model: f64, force: f64) {
        let same = self.same.get_or_insert(Same {
            reading: force,
            time: 0.0,
            samples: 1,
            low: model,
            high: model,
        });
        (same.low, same.high) = (same.low.min(model), same.high.max(model));
    }
}

fn motion(before: Option<[f64; 2]>, place: [f64; 2], duration: f64) -> Option<Fault> {
    if !place.iter().all(|part| part.is_finite()) {
        return Some(Fault::NoPosition);
    }
    let [x, arc] = before?;
    let way = (place[0] - x).abs().max((place[1] - arc).abs());
    if !(duration > 0.0 && duration.is_finite()) {
        return Some(Fault::NoDuration);
    }
    if way > JUMP && way > FASTEST * duration {
        return Some(Fault::Jump);
    }
    (duration > LONGEST_GAP).then_some(Fault::Gap)
}
