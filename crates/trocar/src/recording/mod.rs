//! Recordings of an instrument moving through a seal: time, position and force, read from and written to CSV.
//!
//! The only place that knows file columns and units. Everything behind it is SI: s, m, m/s, N; velocity and force
//! are positive on insertion. What a file lacks is reported in [`Quality`], never repaired.

use std::fmt;
use std::ops::Range;
use std::path::Path;

pub use crate::error::RecordingError;
pub use quality::{Dropped, Gap, Quality, Reset, Saturation, Warning, WarningKind};

mod quality;

/// Fewest samples that make a recording.
pub const MIN_SAMPLES: usize = 8;

/// Where in a recording something was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// Line of the file, counted from 1.
    Line(u64),
    /// Sample of a recording that was not read from a file, counted from 0.
    Sample(usize),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::Line(line) => write!(f, "line {line}"),
            Place::Sample(index) => write!(f, "sample {index}"),
        }
    }
}

/// One recording in SI units; all columns have the same length and time strictly increases.
#[derive(Debug, Clone)]
pub struct Recording {
    /// File name without its folder.
    pub name: String,
    /// SHA-256 of the file's bytes, or of the columns when there is no file; lower-case hexadecimal.
    pub sha256: String,
    /// Time in s.
    pub time: Vec<f64>,
    /// Position in m, growing on insertion.
    pub position: Vec<f64>,
    /// Force in N, the device on the seal.
    pub force: Vec<f64>,
    /// Velocity in m/s, if the file has it.
    pub velocity: Option<Vec<f64>>,
    /// What was found about the data.
    pub quality: Quality,
}

/// How to read a file.
#[derive(Debug, Clone, Default)]
pub struct ReadOptions {
    /// Names of the columns in order, `time_s,position_mm,-,force_n`; needed for files without a header.
    pub columns: Option<String>,
    /// Largest force the sensor can read, in N; readings there count as saturated.
    pub sensor_limit: Option<f64>,
    /// Reverse the sign of the force.
    pub flip_force: bool,
    /// Most memory the columns may take, in bytes.
    pub memory_limit: Option<u64>,
}

impl Recording {
    /// A recording from columns in SI units, looked over like one from a file.
    pub fn from_columns(
        _name: impl Into<String>,
        _time: Vec<f64>,
        _position: Vec<f64>,
        _force: Vec<f64>,
    ) -> Result<Self, RecordingError> {
        unimplemented!()
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// Whether there are no samples; never so for a recording that was read.
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// Time from the first to the last sample, in s.
    pub fn duration(&self) -> f64 {
        self.time.last().unwrap_or(&0.0) - self.time.first().unwrap_or(&0.0)
    }

    /// Ranges of samples without a gap or reset inside; nothing may be concluded across their ends.
    pub fn stretches(&self) -> impl Iterator<Item = Range<usize>> + '_ {
        let starts = std::iter::once(0).chain(self.quality.breaks.iter().copied());
        let ends = self.quality.breaks.iter().copied().chain(std::iter::once(self.len()));
        starts.zip(ends).map(|(from, to)| from..to)
    }

    /// The recording with the inertia and weight of a moving mass taken out of the force:
    /// `force - mass * (acceleration + gravity)`, with `gravity` in m/s^2 along the insertion axis.
    pub fn without_moving_mass(self, _mass: f64, _gravity: f64) -> Result<Self, RecordingError> {
        unimplemented!()
    }
}

/// Reads a recording.
pub fn read(_path: &Path, _options: &ReadOptions) -> Result<Recording, RecordingError> {
    unimplemented!()
}

/// Velocity in m/s from a local quadratic fit of the positions over `window` seconds.
pub fn local_velocity(_recording: &Recording, _window: f64) -> Vec<f64> {
    unimplemented!()
}

/// Acceleration in m/s^2 from a local quadratic fit of the positions over `window` seconds.
pub fn local_acceleration(_recording: &Recording, _window: f64) -> Vec<f64> {
    unimplemented!()
}
