//! Loads beside the force of the seal, and the readings without them.
//!
//! ```text
//! reading = F_0 + m·a + μ·|N|·d − W·cos(tilt) + (1 + κ·p)·F
//! ```
//! m is a mass between sensor and seal; N presses the instrument against the wall of its cannula; W is the weight that
//! hangs on the sensor while the instrument points down, where the tilt is 0; p is the pressure of the gas above that of
//! the room, which presses the lips of the seal to the shaft and so scales its force F and its stiffness alike. A model is
//! that of the seal at p = 0. d, from −1 to 1, is the direction of the motion, which it follows over a reach s of some counts of the encoder:
//!
//! ```text
//! d ← clamp(d + Δx/s, −1, 1)
//! ```

use std::ops::{Index, IndexMut};

use super::Recording;

pub use super::samples::Recorded;

/// A load beside the force of the seal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Load {
    /// A mass m between sensor and seal, kg.
    Mass,
    /// Friction of the cannula, μ, for each N of the recorded side force.
    Side,
    /// Weight W on the sensor, N, that the recorded tilt turns.
    Weight,
    /// Gain κ of the seal's force with the recorded pressure of the gas, 1/Pa.
    Pressure,
}

impl Load {
    /// All; the index of each is its number.
    pub const ALL: ByLoad<Self> = [Self::Mass, Self::Side, Self::Weight, Self::Pressure];
    /// Those that have a column of their own in a recording.
    pub const RECORDED: [Self; 3] = [Self::Side, Self::Weight, Self::Pressure];
}

/// A value for each [`Load`], in the order of [`Load::ALL`].
pub type ByLoad<T> = [T; 4];
/// How large each load is, in the unit of [`Load`]; 0 where there is none.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Loads(pub ByLoad<f64>);

impl Index<Load> for Loads {
    type Output = f64;

    fn index(&self, load: Load) -> &f64 {
        &self.0[load as usize]
    }
}

impl IndexMut<Load> for Loads {
    fn index_mut(&mut self, load: Load) -> &mut f64 {
        &mut self.0[load as usize]
    }
}

/// Counts of the encoder over which friction without deformation takes the direction of the motion, and its least travel, m.
const COUNTS: f64 = 20.0;
const LEAST_REACH: f64 = 1e-5;
/// Travel, m, and time, s, within which a motion must have one direction for that of the friction to be known: while a
/// seal deforms by millimetres, a contact of hard walls lets go within tens of micrometres that nobody has measured.
const KNOWN_TRAVEL: f64 = 1e-4;
const KNOWN_TIME: f64 = 0.1;

/// Of a recording without loads.
pub static UNLOADED: Recorded = [None, None, None];

impl Recording {
    /// What one unit of each of [`Load::RECORDED`] adds to a reading, N (of the pressure: to the gain), at every sample.
    /// NaN where a side force acts and the instrument has not moved in one direction by a tenth of a millimetre within a
    /// tenth of a second: the friction of the cannula is not known there.
    #[must_use]
    pub fn effects(&self) -> Recorded {
        let known = |d: f64| if d.abs() > 0.99 { d.signum() } else { f64::NAN };
        self.effects_with(self.direction(KNOWN_TRAVEL, KNOWN_TIME).map(known))
    }

    /// The same with the direction d of the friction at every sample.
    fn effects_with(&self, direction: impl Iterator<Item = f64>) -> Recorded {
        let [side, tilt, pressure] = &self.loads;
        let along = |(n, d): (&f64, f64)| if *n == 0.0 { 0.0 } else { n.abs() * d };
        let weight = |tilt: &Vec<f64>| tilt.iter().map(|tilt| -tilt.cos()).collect();
        let side = side.as_ref().map(|side| side.iter().zip(direction).map(along).collect());
        [side, tilt.as_ref().map(weight), pressure.clone()]
    }

    /// d at every sample: it follows the motion over `reach`, m, and forgets it within `memory`, s.
    fn direction(&self, reach: f64, memory: f64) -> impl Iterator<Item = f64> + '_ {
        let mut d: f64 = 0.0;
        let pairs = self.position.windows(2).zip(self.time.windows(2));
        std::iter::once(0.0).chain(pairs.map(move |(x, t)| {
            let kept = d * (-(t[1] - t[0]) / memory).exp();
            d = (kept + (x[1] - x[0]) / reach).clamp(-1.0, 1.0);
            d
        }))
    }

    /// The recording with what the sensor would read of the seal alone. `offset` is that of the sensor, N.
    #[must_use]
    pub fn without_loads(mut self, loads: &Loads, offset: f64) -> Self {
        self.force = self.force_without(loads, offset);
        self.quality.subtracted_mass += loads[Load::Mass];
        self.loads = Recorded::default();
        self
    }

    /// The readings in N without `loads`, but with the sensor offset `offset`, N: what the sensor would read of the seal
    /// alone.
    #[must_use]
    pub fn force_without(&self, loads: &Loads, offset: f64) -> Vec<f64> {
        let mut left = self.force_without_inertia(loads[Load::Mass]);
        let reach = (COUNTS * self.quality.position_resolution).max(LEAST_REACH);
        let effects = self.effects_with(self.direction(reach, f64::INFINITY));
        let effects = Load::RECORDED.into_iter().zip(effects);
        for (load, effect) in effects.filter(|(load, _)| loads[*load] != 0.0) {
            let own = loads[load];
            for (left, effect) in left.iter_mut().zip(effect.iter().flatten()) {
                match load {
                    Load::Pressure => *left = offset + (*left - offset) / (1.0 + own * effect),
                    _ => *left -= own * effect,
                }
            }
        }
        left
    }
}
