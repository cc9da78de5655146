//! Partial reversals: motion that turns before the seal has slid.

use crate::ems::Mode;
use crate::friction::sign;
use crate::seal::Deformation;

/// Travel of the deflection back, as a part of the half width, that is a partial reversal: some ten
/// counts of an encoder.
const TURN: f64 = 0.02;

/// Follows a deformation: whether the deflection has turned since the seal last slid. Full strokes
/// never turn so, and tell nothing of the force after it.
#[derive(Debug, Clone, Copy, Default)]
pub struct PartialReversals {
    /// Deflection farthest along `direction`, m.
    extreme: f64,
    direction: f64,
    has_turned: bool,
}

impl PartialReversals {
    /// Takes the next deformation of a seal with half width `half_width`, m; whether it is one
    /// after a partial reversal.
    pub fn take(&mut self, now: Deformation, half_width: f64) -> bool {
        let way = now.deflection - self.extreme;
        if now.mode == Mode::Sliding {
            *self = Self { extreme: now.deflection, ..Self::default() };
        } else if way * self.direction > 0.0 {
            self.extreme = now.deflection;
        } else if way.abs() > TURN * half_width {
            self.has_turned |= self.direction != 0.0;
            (self.extreme, self.direction) = (now.deflection, sign(way));
        }
        self.has_turned
    }

    /// As numbers, for a saved state.
    pub fn to_numbers(&self) -> [f64; 3] {
        [self.extreme, self.direction, f64::from(u8::from(self.has_turned))]
    }

    /// What [`PartialReversals::to_numbers`] wrote.
    pub fn from_numbers([extreme, direction, has_turned]: [f64; 3]) -> Self {
        Self { extreme, direction, has_turned: has_turned != 0.0 }
    }
}
