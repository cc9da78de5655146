//! The force along the way: how a seal's friction depends on where on the shaft, or in the bore, it slides.
//!
//! ```text
//! F_reading = F_0(x) + level(x)·F_seal        x position, m
//! ```
//! F_0 (N) and level (1) are straight between evenly spaced knots. A shaft that is rougher at one place raises the level
//! there; a slope, a cable or a bore that is not round shifts F_0. Outside the range in which a profile was measured, F_0
//! fades linearly to 0 and the level to 1 over [`FADE`] of the range; beyond that the force is the seal's alone.
//!
//! # Gauge
//!
//! A factor could move from the level into the seal's own force, and a constant from F_0 into the sensor's offset. The
//! mean of the level along the way is 1, so that the seal's parameters keep their meaning; a fitted F_0 has the mean 0
//! along the way, and the sensor's offset stands beside it ([`TravelFit::offset_n`]).
//!
//! # No energy out of nothing
//!
//! F_0(x) is the slope of a potential: over a closed motion it does no work. For the rest let z count from a deflection
//! at which the mid curve M is zero, u = x − z be the place where the seal grips, q its yield force, q = κ·(x − w) (see
//! `trocar_model::elastic`), and
//!
//! ```text
//! Φ = ∫_u^x level(s)·M(s − u) ds + ∫_w^x level(s)·κ·(s − w) ds
//! ```
//! the energy stored at varied level. Driving the seal by dx takes the work level·F·dx, of which
//!
//! ```text
//! level·F·dx − dΦ = level·σ·dz²/dt + [level(x)·(F − M − q)]·du
//!                 + [∫_u^x level(s)·M'(s − u) ds]·du + [∫_w^x level(s)·κ ds]·dw
//! ```
//! is not stored. While the seal sticks, du = 0, and dw has the sign of q: nothing is given off. While it slides, du has
//! the sign of F. So **where the mid curve rises, every positive level is dissipative**; relaxing arms are springs of the
//! same kind, whose end follows their force. Where the mid curve falls by D on its way to z (a seal that turns over) and
//! rises by R, R − D + |q| ≥ F_min while the seal slides, the smallest sliding force; with the least and the most level
//! over the way, the fades outside the range included, nothing is given off if least·(R + |q|) ≥ most·D, and so if most/least ≤ 1 + F_min/D:
//!
//! ```text
//! max|dlevel/dx|·ℓ <= min level        ℓ = D·max(|z| at the end of the curve/F_min, 1/K)      K stiffness beyond the end
//! ```
//! ([`storage_length`], [`TravelProfile::is_passive`]): sufficient, not necessary.

use std::fmt;

use serde::{Deserialize, Serialize};
use trocar_model::{Element, SlidingFriction, Travel};

pub use trocar_model::travel::FADE;

pub use fit::{NoProfile, TravelFit, TravelSample, fit, strokes};

mod banded;
mod fit;

/// Largest difference from 1 of the mean level of a profile that is read: files round.
pub const MEAN_TOLERANCE: f64 = 1e-3;
/// Motion outside the range by no more than this fraction of it is no [`Departure`]: identification leaves out as much at the
/// ends of the strokes.
pub const LEAST_DEPARTURE: f64 = 0.01;
/// Most knots.
pub const MOST_KNOTS: usize = 10_000;

/// Why values are no profile.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ProfileError {
    /// The interval is empty or not finite.
    #[error("from_m = {from} m to to_m = {to} m is no interval: both finite, from_m below to_m")]
    Interval {
        /// Lower end, m.
        from: f64,
        /// Upper end, m.
        to: f64,
    },
    /// Unequal, too few or too many knots.
    #[error("offset_n has {offset} values and level {level}, expected as many, 2 to {MOST_KNOTS}")]
    Knots {
        /// Values of the offset.
        offset: usize,
        /// Values of the level.
        level: usize,
    },
    /// A value that is no number.
    #[error("{name}[{knot}] is {value}, expected a finite number")]
    NotFinite {
        /// Key.
        name: &'static str,
        /// Number of the value, from 0.
        knot: usize,
        /// The value.
        value: f64,
    },
    /// A level that is not positive.
    #[error("level[{knot}] is {value}, expected above 0: the seal would push the instrument along")]
    Level {
        /// Number of the value, from 0.
        knot: usize,
        /// The value.
        value: f64,
    },
    /// The gauge is not kept.
    #[error(
        "the mean of level along the way is {mean}, expected 1 (within {MEAN_TOLERANCE})\n\nhint: divide level by it and multiply \
         the forces of the element by it"
    )]
    Mean {
        /// The mean.
        mean: f64,
    },
}

/// How the force depends on the position.
///
/// Invariants: at least two knots, all values finite, level above 0, its mean along the way 1 within
/// [`MEAN_TOLERANCE`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ProfileText")]
pub struct TravelProfile {
    from_m: f64,
    to_m: f64,
    offset_n: Vec<f64>,
    level: Vec<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ProfileText {
    from_m: f64,
    to_m: f64,
    offset_n: Vec<f64>,
    level: Vec<f64>,
}

impl TryFrom<ProfileText> for TravelProfile {
    type Error = ProfileError;

    fn try_from(text: ProfileText) -> Result<Self, ProfileError> {
        Self::new(text.from_m, text.to_m, text.offset_n, text.level)
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

impl fmt::Display for Departure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [from, to, outside] = [self.from, self.to, self.outside].map(|m| (1e4 * m).round() / 10.0);
        let fade = (1e4 * FADE * (self.to - self.from)).round() / 10.0;
        write!(
            f,
            "the motion goes up to {outside} mm outside the range from {from} mm to {to} mm in which the position profile was \
             measured; there the profile fades to none within {fade} mm"
        )
    }
}

/// Mean along the way of what is straight between evenly spaced knots.
fn mean_along(values: &[f64]) -> f64 {
    values.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).sum::<f64>() / (values.len() - 1) as f64
}

impl TravelProfile {
    /// A profile with `offset` (N) and `level` at as many evenly spaced knots from `from` to `to` (m).
    ///
    /// # Errors
    /// [`ProfileError`] for values out of their range.
    pub fn new(from: f64, to: f64, offset: Vec<f64>, level: Vec<f64>) -> Result<Self, ProfileError> {
        let empty = !from.is_finite() || !to.is_finite() || to <= from || !(to - from).is_finite();
        if empty {
            return Err(ProfileError::Interval { from, to });
        }
        if offset.len() != level.len() || !(2..=MOST_KNOTS).contains(&level.len()) {
            return Err(ProfileError::Knots { offset: offset.len(), level: level.len() });
        }
        for (name, values) in [("offset_n", &offset), ("level", &level)] {
            if let Some((knot, &value)) = values.iter().enumerate().find(|(_, v)| !v.is_finite()) {
                return Err(ProfileError::NotFinite { name, knot, value });
            }
        }
        if let Some((knot, &value)) = level.iter().enumerate().find(|(_, v)| **v <= 0.0) {
            return Err(ProfileError::Level { knot, value });
        }
        let mean = mean_along(&level);
        if (mean - 1.0).abs() > MEAN_TOLERANCE {
            return Err(ProfileError::Mean { mean });
        }
        Ok(Self { from_m: from, to_m: to, offset_n: offset, level })
    }

    /// Position of the first knot, m.
    pub fn from(&self) -> f64 {
        self.from_m
    }

    /// Position of the last knot, m.
    pub fn to(&self) -> f64 {
        self.to_m
    }

    /// F_0 at the knots, N.
    pub fn offsets(&self) -> &[f64] {
        &self.offset_n
    }

    /// Level at the knots.
    pub fn levels(&self) -> &[f64] {
        &self.level
    }

    /// The profile as the models run along it.
    pub fn view(&self) -> Travel<'_> {
        let view = Travel::new(self.from_m, self.to_m, &self.offset_n, &self.level);
        view.expect("checked when the profile was made")
    }

    /// Level at position `x`, m. A position that is not a number counts as the first knot's.
    pub fn level(&self, x: f64) -> f64 {
        self.view().level(x)
    }

    /// F_0 at position `x` (m), N.
    pub fn offset(&self, x: f64) -> f64 {
        self.view().offset(x)
    }

    /// Force, N, at position `x` (m) where the seal alone has `seal_force` (N).
    pub fn apply(&self, x: f64, seal_force: f64) -> f64 {
        self.view().apply(x, seal_force)
    }

    /// Free numbers: one offset and one level a knot, less the mean level and the sensor's offset, which is counted
    /// elsewhere.
    pub fn free_parameters(&self) -> usize {
        2 * self.level.len() - 2
    }

    /// Steepest relative change of the level, 1/m: largest |dlevel/dx| over the least level, fades outside the range
    /// included.
    pub fn steepness(&self) -> f64 {
        let least = self.level.iter().copied().fold(1.0, f64::min);
        let step = self.level.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
        let ends = [self.level[0], self.level[self.level.len() - 1]];
        let fade = ends.map(|end| (1.0 - end).abs() / FADE).into_iter().fold(0.0, f64::max);
        (step * (self.level.len() - 1) as f64).max(fade) / (self.to_m - self.from_m) / least
    }

    /// How far a motion that covers `lowest` to `highest` (m) leaves the range; `None` up to [`LEAST_DEPARTURE`] of it.
    pub fn departure(&self, lowest: f64, highest: f64) -> Option<Departure> {
        let outside = (self.from_m - lowest).max(highest - self.to_m);
        let departs = outside > LEAST_DEPARTURE * (self.to_m - self.from_m);
        departs.then_some(Departure { from: self.from_m, to: self.to_m, outside })
    }

    /// Whether the level varies so slowly that no closed motion of a seal with this [`storage_length`] (m) yields work.
    pub fn is_passive(&self, storage_length: f64) -> bool {
        let steepness = self.steepness();
        steepness == 0.0 || steepness * storage_length <= 1.0
    }

    /// The seal's own force, N, behind `force` (N) at position `x` (m).
    pub fn without(&self, x: f64, force: f64) -> f64 {
        self.view().without(x, force)
    }
}

/// ℓ, m: how far the seal's mid curve falls, over the least force with which it slides, times its half width; 0 for a
/// curve that rises throughout.
///
/// ```text
/// ℓ = max over both sides of D·max(|z|/min(F_c, F_s), 1/K)
/// ```
/// with D the sum of all falls between the deflection without force and the end at z, or where the seal slides for
/// certain before it, and K the stiffness beyond it.
pub fn storage_length(element: &Element) -> f64 {
    const CELLS: usize = 2000;
    let params = element.params();
    let deformation = &params.deformation;
    let least = |s: &SlidingFriction| s.coulomb_force.min(s.static_force);
    let least_force = least(&params.insertion).min(least(&params.withdrawal));
    let c = deformation.half_width();
    let points: Vec<(f64, f64)> =
        (0..=CELLS).map(|k| c * (2.0 * k as f64 / CELLS as f64 - 1.0)).map(|z| (z, deformation.mid(z))).collect();
    let most_force = params.insertion.static_force.max(params.withdrawal.static_force);
    let is_reached = |z: f64, mid: f64| mid.abs() <= most_force + deformation.half_gap(z);
    let rest = points.partition_point(|(_, mid)| *mid <= 0.0).clamp(1, CELLS);
    let reached = |&&(z, mid): &&(f64, f64)| is_reached(z, mid);
    let last = rest + points[rest..].iter().take_while(reached).count().saturating_sub(1);
    let first = rest - points[..rest].iter().rev().take_while(reached).count();
    let fall = |part: &[(f64, f64)]| part.windows(2).map(|pair| (pair[0].1 - pair[1].1).max(0.0)).sum::<f64>();
    let (low, high) = deformation.end_stiffness();
    let side = |part: &[(f64, f64)], end: f64, stiffness: f64| {
        let fall = fall(part);
        // What the samples of a rising curve round.
        let fall = if fall > 1e-9 * least_force { fall } else { 0.0 };
        let reach =
            ((end - points[rest].0).abs() / least_force).max(if stiffness > 0.0 { 1.0 / stiffness } else { 0.0 });
        fall * reach
    };
    let length = side(&points[first..=rest], -c, low).max(side(&points[rest..=last], c, high));
    // A contact that creeps slips at any force: no bound holds for a curve that falls.
    if length > 0.0 && params.creep_velocity > 0.0 { f64::INFINITY } else { length }
}
