//! The force along the way: how a seal's friction depends on where on the shaft, or in the bore, it slides.

/// A profile along the way, over knots that somebody else owns.
///
/// ```text
/// F = F_0(x) + level(x)·F_seal        x position, m
/// ```
/// F_0 (N) and level (1) are straight between evenly spaced knots. The profile says nothing about positions where it was
/// not measured: outside, F_0 fades linearly to 0 and the level to 1 over [`FADE`] of the range on either side, and beyond
/// that the force is the seal's alone.
///
/// - **Invariants**: at least two knots, as many offsets as levels. That the values are finite and the levels above 0
///   is up to whoever owns them; [`Travel::is_sound`] tells.
/// - **Errors**: `None` from [`Travel::new`]; never later. A position that is not a number counts as the first knot's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Travel<'a> {
    from: f64,
    to: f64,
    offset: &'a [f64],
    level: &'a [f64],
}

/// Distance on either side of the range over which a profile fades to none, as a fraction of the range.
pub const FADE: f64 = 0.25;

/// Knot below `x` and the part of the way to the next, 0 to 1, for `knots` >= 2 of them, evenly spaced.
pub fn place(from: f64, to: f64, knots: usize, x: f64) -> (usize, f64) {
    let intervals = knots.saturating_sub(1);
    let along = ((x - from) / (to - from) * intervals as f64).max(0.0).min(intervals as f64);
    let knot = (along as usize).min(intervals.saturating_sub(1));
    (knot, along - knot as f64)
}

impl<'a> Travel<'a> {
    /// A profile with `offset` (N) and `level` at as many evenly spaced knots from `from` to `to` (m); `None` for an
    /// empty interval, or fewer than two or unequally many knots.
    pub fn new(from: f64, to: f64, offset: &'a [f64], level: &'a [f64]) -> Option<Self> {
        let spans = from.is_finite() && to.is_finite() && to > from && (to - from).is_finite();
        let paired = offset.len() == level.len() && level.len() >= 2;
        (spans && paired).then_some(Self { from, to, offset, level })
    }

    /// Whether all values are finite and all levels above 0.
    pub fn is_sound(&self) -> bool {
        let finite = self.offset.iter().chain(self.level).all(|value| value.is_finite());
        finite && self.level.iter().all(|level| *level > 0.0)
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
    pub fn offsets(&self) -> &'a [f64] {
        self.offset
    }

    /// Level at the knots.
    pub fn levels(&self) -> &'a [f64] {
        self.level
    }

    /// Level at position `x`, m.
    pub fn level(&self, x: f64) -> f64 {
        self.at(self.level, 1.0, x)
    }

    /// F_0 at position `x` (m), N.
    pub fn offset(&self, x: f64) -> f64 {
        self.at(self.offset, 0.0, x)
    }

    /// Force, N, at position `x` (m) where the seal alone has `seal_force` (N).
    pub fn apply(&self, x: f64, seal_force: f64) -> f64 {
        self.offset(x) + self.level(x) * seal_force
    }

    /// The seal's own force, N, behind `force` (N) at position `x` (m).
    pub fn without(&self, x: f64, force: f64) -> f64 {
        (force - self.offset(x)) / self.level(x)
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
}
