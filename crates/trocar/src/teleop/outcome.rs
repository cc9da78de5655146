//! One run of a loop: its course, whether it is stable, and its figures.

use trocar_model::Trocar;

use super::config::{Config, ConfigError, TissueKind};
use super::merit::Merit;
use super::simulation::{Diverged, Loop, Sample};
use super::stability::Trial;

/// Result of a loop.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// The samples along the motion of the configuration, or when the loop diverged.
    pub course: Result<Vec<Sample>, Diverged>,
    /// Whether it comes to rest in its tissue after a push, and without tissue if the motion leaves it
    /// ([`Trial`]).
    pub settles: bool,
    /// Figures of merit; none where the loop does not settle, or diverges.
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
        let surface = config.tissue.surface_m;
        let settles_in =
            |config: &Config| Trial::default().is_stable(config, plant, model, surface);
        let mut settles = settles_in(config)?;
        if settles && config.leaves_the_tissue() {
            let mut free = config.clone();
            free.tissue.kind = TissueKind::None;
            settles = settles_in(&free)?;
        }
        let start = config.motion.start_m();
        let mut tried = Loop::new(config, plant.clone(), model.clone(), start)?;
        let course = tried.run(config.samples(), |time| config.motion.at(time));
        let stable = course.as_ref().ok().filter(|_| settles);
        let figures = stable.map(|samples| Merit::of(config, samples));
        Ok(Self { course, settles, figures })
    }
}
