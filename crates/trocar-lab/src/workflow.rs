//! From recordings to a folder of results: what `trocar identify` does, for all interfaces.
//!
//! ```text
//! recordings ─▶ expected positions, without the moving mass ─▶ identify ─▶ without the delay ─▶ validate ─▶ model.json, summary.json, report.html, figures
//! ```

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::motion::MotionRange;
use crate::simpler;
use crate::validate::{Validated, Validation};
use trocar_identify::{
    Candidate, Identification, IdentifyError, IdentifyOptions, Progress, identify,
};
use trocar_recording::loads::{Load, Loads};
use trocar_recording::{Recording, RecordingError};
use trocar_runtime::model_file::ModelFile;

/// Mass between sensor and seal whose inertia and weight are subtracted from the readings.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct MovingMass {
    /// Mass, kg, ≥ 0.
    #[serde(rename = "mass_kg")]
    pub mass: f64,
    /// Component of gravity along the insertion, m/s², as in [`Recording::without_moving_mass`].
    #[serde(rename = "gravity_m_s2")]
    pub gravity: f64,
}

impl MovingMass {
    /// A mass in kg under `gravity` in m/s².
    ///
    /// # Errors
    /// [`RecordingError::OutOfRange`] for a mass that is negative, or a number that is not finite;
    /// [`RecordingError::GravityWithoutMass`] for gravity where the mass is 0.
    pub fn new(mass: f64, gravity: f64) -> Result<Self, RecordingError> {
        finite("gravity_m_s2", gravity, "m/s^2")?;
        if !(mass.is_finite() && mass >= 0.0) {
            let (option, allowed) = ("moving_mass_kg", "finite and not negative");
            return Err(RecordingError::OutOfRange { option, allowed, found: mass, unit: "kg" });
        }
        if mass == 0.0 && gravity != 0.0 {
            return Err(RecordingError::GravityWithoutMass { gravity });
        }
        Ok(Self { mass, gravity })
    }

    /// `recording` at the expected positions, without the inertia and weight of this mass and without the
    /// loads `beside` it; the weight of their mass is part of the sensor offset `offset`, N. The device has
    /// not moved as the steps of its encoder: they would count as errors of a model.
    ///
    /// # Errors
    /// As for [`Recording::without_moving_mass`].
    pub fn subtracted_from(
        self,
        recording: Recording,
        beside: &Loads,
        offset: f64,
    ) -> Result<Recording, RecordingError> {
        let recording = recording.into_smoothed();
        let mass = self.mass + beside[Load::Mass];
        let mut recorded = *beside;
        recorded[Load::Mass] = 0.0;
        let recording = match mass == 0.0 {
            true => recording,
            // Gravity by the share of the declared mass, so that the weight subtracted is its alone.
            false => recording.without_moving_mass(mass, self.gravity * self.mass / mass)?,
        };
        Ok(match recorded == Loads::default() {
            true => recording,
            false => recording.without_loads(&recorded, offset),
        })
    }

    /// The same for several recordings.
    ///
    /// # Errors
    /// The first error of a recording.
    pub(crate) fn subtracted_from_all(
        self,
        all: Vec<Recording>,
        beside: &Loads,
        offset: f64,
    ) -> Result<Vec<Recording>, RecordingError> {
        let all = all.into_par_iter();
        all.map(|recording| self.subtracted_from(recording, beside, offset)).collect()
    }
}

fn finite(option: &'static str, found: f64, unit: &'static str) -> Result<(), RecordingError> {
    let wrong = RecordingError::OutOfRange { option, allowed: "finite", found, unit };
    if found.is_finite() { Ok(()) } else { Err(wrong) }
}

/// What is subtracted from recordings before a model is validated on them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correction {
    /// Reading at rest without any force of the seal, N.
    pub offset_n: f64,
    /// Mass between sensor and seal whose inertia is subtracted, kg. Its weight is part of the offset.
    pub moving_mass_kg: f64,
    /// The other loads beside the force of the seal.
    loads: Loads,
    /// Delay of the positions, s.
    position_delay_s: f64,
}

impl Correction {
    /// As given, or else that of the sensor of `model`.
    ///
    /// # Errors
    /// [`RecordingError::OutOfRange`].
    pub fn of(
        model: &ModelFile,
        offset_n: Option<f64>,
        moving_mass_kg: Option<f64>,
    ) -> Result<Self, RecordingError> {
        let sensor = model.sensor.unwrap_or_default();
        let offset_n = offset_n.unwrap_or(sensor.offset_n);
        finite("offset_n", offset_n, "N")?;
        let mass = moving_mass_kg.unwrap_or(sensor.moving_mass_kg);
        let [side_friction, tilted_weight, pressure_gain] = sensor.loads();
        Ok(Self {
            offset_n,
            moving_mass_kg: MovingMass::new(mass, 0.0)?.mass,
            loads: Loads([0.0, side_friction, tilted_weight, pressure_gain]),
            position_delay_s: sensor.position_delay_s,
        })
    }

    /// `recording` without the inertia of the mass and the delay.
    ///
    /// # Errors
    /// As for [`Recording::without_moving_mass`], and a delay longer than the recording.
    pub fn taken_out_of(self, recording: Recording) -> Result<Recording, RecordingError> {
        let mass = MovingMass { mass: self.moving_mass_kg, gravity: 0.0 };
        let seal = mass.subtracted_from(recording, &self.loads, self.offset_n)?;
        seal.with_position_delay(self.position_delay_s)
    }
}

/// The inputs and results of a finished identification.
#[derive(Debug, Clone)]
pub struct Workflow {
    /// The result.
    pub identification: Identification,
    /// Options of the identification.
    pub options: IdentifyOptions,
    /// The recordings used for identification, without the moving mass and the position delay.
    pub recordings: Vec<Recording>,
    /// The model beside them.
    pub own: Validated,
    /// Their motion and forces: where the model holds.
    pub range: MotionRange,
    /// The model beside the validation recordings; `None` without any.
    pub held_out: Option<Validated>,
    /// Mass that was subtracted.
    pub moving_mass: MovingMass,
    /// The command line, for the report.
    pub command: Option<String>,
}

/// Why there is no result.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WorkflowError {
    /// Nothing can be identified.
    #[error(transparent)]
    Identify(#[from] IdentifyError),
    /// A recording cannot be corrected for mass or delay.
    #[error(transparent)]
    Recording(#[from] RecordingError),
}

impl Workflow {
    /// Identifies from `recordings` and validates on `held_out`, both as read.
    ///
    /// # Errors
    /// [`WorkflowError`]; a doubtful result is not an error.
    pub fn run(
        recordings: Vec<Recording>,
        held_out: Vec<Recording>,
        moving_mass: MovingMass,
        options: IdentifyOptions,
        progress: Progress,
    ) -> Result<Self, WorkflowError> {
        let options = IdentifyOptions { inertia_removed: moving_mass.mass > 0.0, ..options };
        let recordings = moving_mass.subtracted_from_all(recordings, &Loads::default(), 0.0)?;
        let identification = identify(&recordings, &options, progress)?;
        let recordings = identification.without_delay(recordings)?;
        let Candidate { loads, offset, .. } = &identification.model;
        let held_out = moving_mass.subtracted_from_all(held_out, loads, *offset)?;
        let held_out = identification.without_delay(held_out)?;
        progress("simpler models", 0.84);
        let mut done = Self::of(identification, options, recordings, held_out, moving_mass);
        let held_out = done.held_out.as_ref();
        let doubt = simpler::doubt(&done.identification, &done.options, &done.own, held_out);
        done.identification.warnings.extend(doubt);
        Ok(done)
    }

    /// The same for an existing identification and corrected recordings: only validates.
    pub fn of(
        identification: Identification,
        options: IdentifyOptions,
        recordings: Vec<Recording>,
        held_out: Vec<Recording>,
        moving_mass: MovingMass,
    ) -> Self {
        let (own, held_out) = rayon::join(
            || Validated::own(&identification, &recordings),
            || (!held_out.is_empty()).then(|| Validated::held_out(&identification, held_out)),
        );
        Self {
            range: MotionRange::of(&recordings, identification.model.offset),
            identification,
            options,
            recordings,
            own,
            held_out,
            moving_mass,
            command: None,
        }
    }

    /// The validation on recordings that were held out; `None` without any.
    pub fn validation(&self) -> Option<&Validation> {
        self.held_out.as_ref().map(|held_out| &held_out.validation)
    }
}
