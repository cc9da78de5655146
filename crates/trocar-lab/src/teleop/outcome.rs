//! One run of a loop: its course, whether it is stable, and its figures.

use trocar_model::Trocar;

use super::config::{Config, ConfigError};
use super::merit::Merit;
use super::simulation::{Diverged, Loop, Sample};
use super::stability::Disturbance;

/// Result of a loop.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// The samples along the motion of the configuration, or when the loop diverged.
    pub course: Result<Vec<Sample>, Diverged>,
    /// What the loop does not come to rest after; none where it is stable ([`Disturbance::unsettling`]).
    pub unsettled_by: Option<Disturbance>,
    /// Figures of merit; none where the loop does not come to rest, or diverges.
    pub figures: Option<Merit>,
}

impl Outcome {
    /// Runs the loop of `config` with `model` in the compensator and `plant` as the trocar.
    ///
    /// # Errors
    /// A value of `config` out of its range, or a model that cannot be made with it.
    pub fn of<K: AsRef<[f64]> + Clone>(
        config: &Config,
        [model, plant]: [&Trocar<K>; 2],
    ) -> Result<Self, ConfigError> {
        let unsettled_by = Disturbance::unsettling(config, [model, plant])?;
        let start = config.motion.start_m();
        let mut tried = Loop::new(config, plant.clone(), model.clone(), start)?;
        let course = tried.run(config.samples(), |time| config.motion.at(time));
        let figures = match &course {
            Ok(samples) if unsettled_by.is_none() => {
                Some(Merit::of(config, samples).with_contacts(config, [model, plant])?)
            }
            _ => None,
        };
        Ok(Self { course, unsettled_by, figures })
    }

    /// Whether it comes to rest after every disturbance.
    pub fn settles(&self) -> bool {
        self.unsettled_by.is_none()
    }
}
