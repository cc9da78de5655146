//! Position-dependent force: how a seal's friction depends on where on the shaft, or in the bore,
//! it slides.

use core::fmt;

/// Position profile of the force between evenly spaced knots.
///
/// ```text
/// F = F_0(x) + gain(x)·F_seal        x position, m
/// ```
/// F_0 (N) and gain (1) are straight between the knots. The profile says nothing about positions
/// where it was not measured: outside, F_0 fades linearly to 0 and the gain to 1 over [`FADE`] of
/// the range on either side, and beyond that the force is the seal's alone.
///
/// `K` stores the values at the knots: `&[f64]` borrows them, `Vec<f64>` or `Arc<[f64]>` owns them.
///
/// - **Invariants**: two knots or more, as many offsets as gains, all finite, gains above 0.
/// - **Errors**: [`ProfileError`] from [`PositionProfile::new`]; never later. A position that is not a number counts as the
///   first knot's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionProfile<K = &'static [f64]> {
    from: f64,
    to: f64,
    offset: K,
    gain: K,
}

/// Distance on either side of the range over which a profile fades to none, as a fraction of the
/// range.
pub const FADE: f64 = 0.25;

/// Why values are no profile.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ProfileError {
    /// The interval is empty or not finite.
    Interval {
        /// Lower end, m.
        from: f64,
        /// Upper end, m.
        to: f64,
    },
    /// Fewer than two knots, or unequally many values.
    Knots {
        /// Values of the offset.
        offset: usize,
        /// Values of the gain.
        gain: usize,
    },
    /// A value that is not finite, or a gain that is not above 0: the seal would push the
    /// instrument along.
    Value {
        /// Which: `offset` or `gain`.
        name: &'static str,
        /// Number of the knot, from 0.
        knot: usize,
        /// The value.
        value: f64,
    },
}

impl fmt::Display for ProfileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Interval { from, to } => {
                write!(
                    f,
                    "from {from} m to {to} m is no interval: both must be finite, the first below the second"
                )
            }
            Self::Knots { offset, gain } => {
                write!(
                    f,
                    "{offset} values of the offset and {gain} of the gain, expected as many, 2 or more"
                )
            }
            Self::Value { name: "gain", knot, value } => write!(
                f,
                "gain {knot} is {value}, expected a finite number above 0: otherwise the seal would push the instrument along"
            ),
            Self::Value { name, knot, value } => {
                write!(f, "{name} {knot} is {value}, expected a finite number")
            }
        }
    }
}

impl core::error::Error for ProfileError {}

/// Knot below `x` and the part of the way to the next, 0 to 1, for `knots` >= 2 of them, evenly
/// spaced.
pub fn place(from: f64, to: f64, knots: usize, x: f64) -> (usize, f64) {
    let intervals = knots.saturating_sub(1);
    let along = ((x - from) / (to - from) * intervals as f64).max(0.0).min(intervals as f64);
    let knot = (along as usize).min(intervals.saturating_sub(1));
    (knot, along - knot as f64)
}

impl<K: AsRef<[f64]>> PositionProfile<K> {
    /// A profile with `offset` (N) and `gain` at as many evenly spaced knots from `from` to `to`
    /// (m).
    ///
    /// # Errors
    /// [`ProfileError`] for values out of their range.
    pub fn new(from: f64, to: f64, offset: K, gain: K) -> Result<Self, ProfileError> {
        let is_interval =
            from.is_finite() && to.is_finite() && to > from && (to - from).is_finite();
        if !is_interval {
            return Err(ProfileError::Interval { from, to });
        }
        let (offsets, gains) = (offset.as_ref(), gain.as_ref());
        if offsets.len() != gains.len() || gains.len() < 2 {
            return Err(ProfileError::Knots { offset: offsets.len(), gain: gains.len() });
        }
        let wrong = |name, values: &[f64], least: f64| {
            let mut values = values.iter().enumerate();
            let found = values.find(|(_, value)| !(value.is_finite() && **value > least));
            found.map(|(knot, &value)| ProfileError::Value { name, knot, value })
        };
        match wrong("offset", offsets, f64::NEG_INFINITY).or_else(|| wrong("gain", gains, 0.0)) {
            Some(error) => Err(error),
            None => Ok(Self { from, to, offset, gain }),
        }
    }

    /// The same profile, stored as `store` does it.
    pub fn stored_as<'a, L>(&'a self, store: impl Fn(&'a [f64]) -> L) -> PositionProfile<L> {
        PositionProfile {
            from: self.from,
            to: self.to,
            offset: store(self.offsets()),
            gain: store(self.gains()),
        }
    }

    /// Position of the first knot, m.
    pub fn from(&self) -> f64 {
        self.from
    }

    /// Position of the last knot, m.
    pub fn to(&self) -> f64 {
        self.to
    }

    /// F_0 at the knots, N.
    pub fn offsets(&self) -> &[f64] {
        self.offset.as_ref()
    }

    /// Gain at the knots.
    pub fn gains(&self) -> &[f64] {
        self.gain.as_ref()
    }

    /// Gain at position `x`, m.
    pub fn gain(&self, x: f64) -> f64 {
        self.at(self.gains(), 1.0, x)
    }

    /// F_0 at position `x` (m), N.
    pub fn offset(&self, x: f64) -> f64 {
        self.at(self.offsets(), 0.0, x)
    }

    /// Force, N, at position `x` (m) where the seal alone has `seal_force` (N).
    pub fn apply(&self, x: f64, seal_force: f64) -> f64 {
        self.offset(x) + self.gain(x) * seal_force
    }

    /// Force of the seal alone, N, where the force at position `x` (m) is `force` (N).
    pub fn without(&self, x: f64, force: f64) -> f64 {
        (force - self.offset(x)) / self.gain(x)
    }

    /// Straight between `values` at the knots, and from those at the ends to `none`.
    fn at(&self, values: &[f64], none: f64, x: f64) -> f64 {
        let (knot, part) = place(self.from, self.to, values.len(), x);
        let value = |k: usize| values.get(k).copied().unwrap_or(none);
        let inside = value(knot) + part * (value(knot + 1) - value(knot));
        let faded = self.outside(x) / (FADE * (self.to - self.from));
        if faded >= 1.0 {
            none
        } else if faded > 0.0 {
            inside + faded * (none - inside)
        } else {
            inside
        }
    }

    /// Distance of `x` from the range, m; 0 inside it and where `x` is not a number.
    pub fn outside(&self, x: f64) -> f64 {
        if x < self.from {
            self.from - x
        } else if x > self.to {
            x - self.to
        } else {
            0.0
        }
    }

    /// Steepest relative change of the gain, 1/m: largest |dgain/dx| over the least gain, fades
    /// outside the range included.
    pub fn steepness(&self) -> f64 {
        let gains = self.gains();
        let least = gains.iter().copied().fold(1.0, f64::min);
        let step = gains.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
        let ends = [gains.first(), gains.last()]
            .map(|end| end.map_or(0.0, |end| (1.0 - end).abs() / FADE));
        let fade = ends.into_iter().fold(0.0, f64::max);
        (step * (gains.len() - 1) as f64).max(fade) / (self.to - self.from) / least
    }
}
