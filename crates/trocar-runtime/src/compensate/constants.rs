//! What the observer knows beforehand, for whoever writes it in another language.

use trocar_model::{Seal, Trocar};

use super::{Compensator, LEAST_ERROR, Phase};

/// Numbers from which an observer in another language starts. Those that are the same for every
/// model stand in the code.
#[derive(Debug, Clone, Copy)]
pub struct CompensatorConstants<'a> {
    /// The model.
    pub trocar: &'a Trocar<Vec<f64>>,
    /// The same seal with the stiffest law between its branches, run in parallel; `None` where
    /// recordings contain partial reversals, and for a seal without branches that differ.
    pub stiff: Option<&'a Seal>,
    /// Whether readings have the other sign than the model.
    pub flips: bool,
    /// Distance of a slide, m, from which it counts for the sign of the readings.
    pub sign_travel: f64,
    /// Reading without any force, N, with the sign of the model.
    pub offset: f64,
    /// Mass between sensor and seal, kg.
    pub moving_mass: f64,
    /// Gravity on the reading of that mass, m/s².
    pub gravity: f64,
    /// Largest force that the sensor can read, N; infinite if it is unknown.
    pub sensor_limit: f64,
    /// Change of the model's force above which a constant reading is frozen, N.
    pub least_change: f64,
    /// Standard deviation of the model's force, N: deforming, deforming after a partial reversal,
    /// sliding, held, held after a partial reversal.
    pub phase_error: [f64; 5],
    /// Variances of λ and ν at the start.
    pub prior: [f64; 2],
    /// Whether λ and ν are adapted.
    pub adaptation: bool,
}

impl Compensator {
    /// What the observer knows beforehand.
    pub fn constants(&self) -> CompensatorConstants<'_> {
        let phases =
            [Phase::Deforming, Phase::Partial, Phase::Sliding, Phase::Held, Phase::PartialHeld];
        CompensatorConstants {
            trocar: &self.setup.trocar,
            stiff: self.minor.as_ref().map(|minor| minor.model.seal()),
            flips: self.setup.flips,
            sign_travel: self.sign.settled(),
            offset: self.setup.offset,
            moving_mass: self.inertia.mass(),
            gravity: self.inertia.gravity(),
            sensor_limit: self.watch.limit(),
            least_change: self.watch.least_change(),
            phase_error: phases.map(|phase| self.setup.error.in_phase(phase).max(LEAST_ERROR)),
            prior: self.adapter.prior(),
            adaptation: self.setup.adaptation,
        }
    }
}
