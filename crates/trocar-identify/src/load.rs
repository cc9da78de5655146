//! The loads beside the force of the seal in a fit: what each of them is, in one table.

use trocar_model::{ParameterId, Quantity};
use trocar_recording::loads::{ByLoad, Load};

use super::prior::Kind;

/// One load in a fit.
pub(super) struct OfLoad {
    /// Its parameter.
    pub(super) id: [ParameterId; 1],
    pub(super) kind: Kind,
    /// Step of its value, in the unit of the load.
    pub(super) step: f64,
    /// Least value.
    pub(super) least: f64,
    /// Name of the term on the command line and in `summary.json`.
    pub(super) name: &'static str,
    /// In words.
    pub(super) words: &'static str,
}

/// In the order of [`Load::ALL`].
static OF_LOADS: ByLoad<OfLoad> = [
    OfLoad {
        id: [Quantity::UnmodelledMass.id()],
        kind: Kind::UnmodelledMass,
        step: 1e-4,
        least: 0.0,
        name: "unmodelled_mass",
        words: "unmodelled mass",
    },
    OfLoad {
        id: [Quantity::SideFriction.id()],
        kind: Kind::SideFriction,
        step: 1e-4,
        least: 0.0,
        name: "side_load",
        words: "side load",
    },
    OfLoad {
        id: [Quantity::TiltedWeight.id()],
        kind: Kind::TiltedWeight,
        step: 1e-4,
        least: f64::NEG_INFINITY,
        name: "tilt",
        words: "weight by tilt",
    },
    OfLoad {
        id: [Quantity::PressureGain.id()],
        kind: Kind::PressureGain,
        step: 1e-8,
        least: 0.0,
        name: "gas_pressure",
        words: "gas pressure",
    },
];

pub(super) fn of_load(load: Load) -> &'static OfLoad {
    &OF_LOADS[load as usize]
}

/// The load of which `quantity` is the size.
pub(super) fn load_of(quantity: Quantity) -> Option<Load> {
    Load::ALL.into_iter().find(|load| of_load(*load).id[0].quantity == quantity)
}

/// Whether a quantity belongs to the rig and not to the seal.
pub(super) fn is_of_rig(quantity: Quantity) -> bool {
    let is_offset = matches!(quantity, Quantity::Offset | Quantity::CoulombForceWithOffset);
    is_offset || load_of(quantity).is_some()
}
