//! Position profiles in files, and motion outside their range.

use std::fmt;

use serde::{Deserialize, Serialize};
use thiserror::Error;
use trocar_model::profile::FADE;
use trocar_model::{PositionProfile, ProfileError};

/// Largest deviation of the mean gain of a profile from 1 when it is read, since values in files
/// are rounded.
pub const MEAN_TOLERANCE: f64 = 1e-3;
/// Motion outside the range by up to this fraction of it is not a [`Departure`]: identification
/// omits as much at the ends of the strokes.
pub const LEAST_DEPARTURE: f64 = 0.01;
/// Most knots of a profile in a file.
pub const MOST_KNOTS: usize = 10_000;

/// A profile in the form used in files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ProfileText {
    from_m: f64,
    to_m: f64,
    offset_n: Vec<f64>,
    gain: Vec<f64>,
}

/// Why a profile of a file cannot be used.
#[derive(Debug, Clone, PartialEq, Error)]
pub(crate) enum BadProfile {
    /// The values are not a valid profile.
    #[error(transparent)]
    Values(#[from] ProfileError),
    /// Too many knots.
    #[error("{0} knots, expected at most {MOST_KNOTS}")]
    Knots(usize),
    /// The mean gain is not 1, so the forces of the seal have another meaning.
    #[error(
        "the mean gain over the range is {0}, expected 1 (within {MEAN_TOLERANCE})\n\nhint: divide gain by it and multiply the \
         forces of the element by it"
    )]
    Mean(f64),
}

impl<K: AsRef<[f64]>> From<&PositionProfile<K>> for ProfileText {
    fn from(profile: &PositionProfile<K>) -> Self {
        let (offset_n, gain) = (profile.offsets().to_vec(), profile.gains().to_vec());
        Self { from_m: profile.from(), to_m: profile.to(), offset_n, gain }
    }
}

/// Writes a profile in the form used in files.
///
/// # Errors
/// Those of `serializer`.
pub fn serialize<S: serde::Serializer>(
    profile: &PositionProfile<Vec<f64>>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    ProfileText::from(profile).serialize(serializer)
}

impl TryFrom<ProfileText> for PositionProfile<Vec<f64>> {
    type Error = BadProfile;

    fn try_from(text: ProfileText) -> Result<Self, BadProfile> {
        if text.gain.len() > MOST_KNOTS {
            return Err(BadProfile::Knots(text.gain.len()));
        }
        let profile = Self::new(text.from_m, text.to_m, text.offset_n, text.gain)?;
        let mean = mean_between_knots(profile.gains());
        if (mean - 1.0).abs() > MEAN_TOLERANCE { Err(BadProfile::Mean(mean)) } else { Ok(profile) }
    }
}

/// A motion that leaves the range of positions in which a profile was measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Departure {
    /// Lower end of the range, m.
    pub from: f64,
    /// Upper end of the range, m.
    pub to: f64,
    /// Largest distance of the motion from the range, m.
    pub outside: f64,
}

impl Departure {
    /// Distance by which a motion from `lowest` to `highest` (m) leaves the range of `profile`;
    /// `None` up to [`LEAST_DEPARTURE`] of it.
    pub fn of<K: AsRef<[f64]>>(
        profile: &PositionProfile<K>,
        lowest: f64,
        highest: f64,
    ) -> Option<Self> {
        let (from, to) = (profile.from(), profile.to());
        let outside = (from - lowest).max(highest - to);
        (outside > LEAST_DEPARTURE * (to - from)).then_some(Self { from, to, outside })
    }
}

impl fmt::Display for Departure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [from, to, outside] =
            [self.from, self.to, self.outside].map(|m| (1e4 * m).round() / 10.0);
        let fade = (1e4 * FADE * (self.to - self.from)).round() / 10.0;
        write!(
            f,
            "the motion goes up to {outside} mm outside the range from {from} mm to {to} mm in which the position profile was \
             measured; there the profile fades to none within {fade} mm"
        )
    }
}

/// Mean over the range of a piecewise linear function with equally spaced knots.
pub fn mean_between_knots(values: &[f64]) -> f64 {
    values.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).sum::<f64>() / (values.len() - 1) as f64
}
