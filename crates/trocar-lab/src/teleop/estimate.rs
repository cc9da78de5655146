//! The force on the tissue, from the reading of the follower's sensor.

use trocar_model::{ParamError, Trocar, TrocarState};

use super::config::{Compensation, Config, ConfigError, Place, Sensor};
use super::control::Reading;
use super::model::scaled;
use super::plant::Follower;
use trocar_runtime::compensate::{CompensateError, CompensateOptions, Compensator};
use trocar_runtime::model_file::{ModelFile, Origin, OriginKind};
use trocar_simulate::bench::noise::{Noise, Source};

/// Sensor and compensator.
#[derive(Debug, Clone)]
pub(crate) struct Estimator<K> {
    sensor: Sensor,
    fraction: f64,
    duration: f64,
    noise: Noise,
    observer: Observer<K>,
}

/// Where the trocar's force comes from.
#[derive(Debug, Clone)]
enum Observer<K> {
    /// A sensor at the tip does not read it.
    None,
    /// A model, driven by the follower's encoder.
    Model(Box<(Trocar<K>, TrocarState)>),
    /// The same, adapted to the readings.
    Adaptive(Box<Compensator>),
}

impl<K: AsRef<[f64]> + Clone> Estimator<K> {
    /// With `model`, at its friction scale, in the compensator; at rest at `position`, m.
    pub(crate) fn new(
        config: &Config,
        model: &Trocar<K>,
        position: f64,
    ) -> Result<Self, ConfigError> {
        let Config { sensor, compensation, sample_time_s: duration, .. } = *config;
        let observer = match sensor.place {
            Place::Tip => Observer::None,
            Place::Outside => {
                let model = compensation.model(model)?;
                match compensation.adaptation {
                    true => Observer::Adaptive(Box::new(adaptive(&model, &compensation, &sensor)?)),
                    false => {
                        let state = model.rest(position);
                        Observer::Model(Box::new((model, state)))
                    }
                }
            }
        };
        let noise = Noise::new(config.seed, Source::RemoteSensor);
        Ok(Self { sensor, fraction: compensation.fraction, duration, noise, observer })
    }

    /// F̂_e, N: the reading less the fraction γ of the trocar's force as the compensator knows it.
    pub(crate) fn estimate(&mut self, follower: &Follower<K>, own: &Reading) -> f64 {
        let reading = self.reading(follower);
        let trocar_force = match &mut self.observer {
            Observer::None => return reading,
            Observer::Model(model) => {
                let (model, state) = &mut **model;
                model.turn_to(state, own.position, follower.angle, self.duration)
            }
            Observer::Adaptive(compensator) => {
                compensator.turn(own.position, follower.angle, reading, self.duration).trocar_force
            }
        };
        reading - self.fraction * trocar_force
    }

    fn reading(&mut self, follower: &Follower<K>) -> f64 {
        let Sensor { place, moving_mass_kg, noise_n, offset_n, resolution_n } = self.sensor;
        let true_force = match place {
            Place::Tip => follower.tissue_force,
            Place::Outside => {
                follower.tissue_force
                    + follower.trocar_force
                    + moving_mass_kg * follower.acceleration
            }
        };
        let noise = if noise_n > 0.0 { noise_n * self.noise.normal() } else { 0.0 };
        let reading = true_force + offset_n + noise;
        if resolution_n > 0.0 { (reading / resolution_n).round() * resolution_n } else { reading }
    }
}

impl Compensation {
    /// `model` at the compensator's friction scale.
    pub fn model<K: AsRef<[f64]> + Clone>(
        &self,
        model: &Trocar<K>,
    ) -> Result<Trocar<K>, ConfigError> {
        let scale = self.friction_scale;
        scaled(model, scale).map_err(|why| unscaled("compensation.friction_scale", scale, why))
    }
}

/// The compensator's model makes none with its friction scale.
pub(super) fn unscaled(name: &str, scale: f64, why: ParamError) -> ConfigError {
    ConfigError::Unfit(format!("the compensator's model with {name} = {scale}: {why}"))
}

/// The compensator of `model` that knows offset and moving mass of the sensor.
fn adaptive<K: AsRef<[f64]>>(
    model: &Trocar<K>,
    compensation: &Compensation,
    sensor: &Sensor,
) -> Result<Compensator, ConfigError> {
    let mut file = ModelFile::new(*model.seal(), Origin::new(OriginKind::HandMade));
    file.trocar = model.stored_as(<[f64]>::to_vec);
    let options = CompensateOptions {
        offset_n: Some(sensor.offset_n),
        flip_force: Some(false),
        moving_mass_kg: Some(sensor.moving_mass_kg),
        force_error_n: compensation.force_error_n,
        ..CompensateOptions::default()
    };
    Compensator::new(&file, &options).map_err(|error| match error {
        CompensateError::NoForceError => ConfigError::Unfit(
            "adaptation needs the error of the model's force, which the model does not state (force_error)\n\nhint: \
             state the standard deviation as compensation.force_error_n, or identify the model again with ‹validate=...›"
                .to_owned(),
        ),
        other => ConfigError::Unfit(format!("compensation: {other}")),
    })
}
