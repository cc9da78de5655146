//! Insertion and withdrawal.

/// Direction of motion, slip or force.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Direction {
    /// Position increases, v > 0.
    Insertion,
    /// Position decreases, v < 0.
    Withdrawal,
}

impl Direction {
    /// Both, insertion first.
    pub const BOTH: [Self; 2] = [Self::Insertion, Self::Withdrawal];

    /// Direction of a signed `value`; insertion for ±0, whose sign `f64::signum` would tell apart.
    pub(crate) fn of(value: f64) -> Self {
        if value < 0.0 { Self::Withdrawal } else { Self::Insertion }
    }

    /// +1 for insertion, -1 for withdrawal.
    pub fn sign(self) -> f64 {
        match self {
            Self::Insertion => 1.0,
            Self::Withdrawal => -1.0,
        }
    }

    /// The other one.
    #[must_use]
    pub fn opposite(self) -> Self {
        self.pick([Self::Withdrawal, Self::Insertion])
    }

    /// The one of two that is its own, that of insertion first.
    #[inline]
    pub fn pick<T>(self, [insertion, withdrawal]: [T; 2]) -> T {
        match self {
            Self::Insertion => insertion,
            Self::Withdrawal => withdrawal,
        }
    }

    /// In a word.
    pub fn name(self) -> &'static str {
        self.pick(["insertion", "withdrawal"])
    }

    /// Beginning of the names of its parameters.
    pub(crate) fn prefix(self) -> &'static str {
        self.pick(["insertion_", "withdrawal_"])
    }
}
