//! What a study is asked for, as the interfaces take it.

use serde::{Deserialize, Serialize};
use thiserror::Error;
use trocar_model::Stages;
use trocar_runtime::model_file::ModelFile;

use super::advise::{map_delays, map_fractions};
use super::config::{Config, TissueKind};
use super::hybrid::frequencies;
use super::model::Candidates;
use super::study::Questions;

/// Most draws of trocars, or of models in the compensator.
const MOST_DRAWS: usize = 1000;
/// Posterior draws that are tried where their number is not given.
const POSTERIOR_DRAWS: usize = 20;
/// Least friction scale of a trocar.
const LEAST_FRICTION: f64 = 0.01;
/// Longest delay of a map, in samples.
const LONGEST_MAPPED: f64 = 1e4;

/// What to compute besides the course, its figures and the stiffnesses with which the loop is stable.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Options {
    /// Find the fraction of the trocar's force to compensate.
    pub advise: bool,
    /// Trocars drawn from the model's 95 % intervals, up to 1000; of posterior draws, how many of them (20 without).
    pub draws: Option<usize>,
    /// Models drawn from the intervals of the compensator's, up to 1000.
    pub compensator_draws: Option<usize>,
    /// Include trocars whose friction is down to this multiple of the model's, 0.01 to 1.
    pub least_friction: Option<f64>,
    /// Find the stiffnesses of the tissue with which the loop is stable, over delay and fraction.
    pub map: bool,
    /// Longest delay of the map, of one direction, s; without it, 19 samples.
    pub longest_delay_s: Option<f64>,
    /// All delays of the map, s, in place of those up to the longest.
    pub delays_s: Option<Vec<f64>>,
    /// Fractions of the map; without them, 0 to 1.425.
    pub fractions: Option<Vec<f64>>,
    /// Compute the hybrid matrix over frequency.
    pub hybrid: bool,
    /// Its frequencies, Hz; without them, 0.1 to 100.
    pub frequencies_hz: Option<Vec<f64>>,
}

/// Options that cannot have a result.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum OptionError {
    /// A value out of its range, or an option of something that is not asked for.
    #[error("{0}")]
    Value(String),
    /// What is asked for cannot be found with this loop and these models.
    #[error("{0}")]
    Nothing(String),
}

impl Options {
    /// The questions about the loop of `config`; of `files` the first is the compensator's model, the second the
    /// trocar, of which there may be `posterior` draws.
    ///
    /// # Errors
    /// Options that are out of range or cannot have a result.
    pub fn questions(
        &self,
        config: &Config,
        files: [&ModelFile; 2],
        posterior: Option<Vec<Stages>>,
    ) -> Result<Questions, OptionError> {
        self.check(posterior.is_some())?;
        self.check_loop(config)?;
        self.check_intervals(files, posterior.is_some())?;
        Ok(Questions {
            advice: self.advise.then(|| self.candidates(config.seed, posterior)),
            map: self.map.then(|| self.axes(config)),
            hybrid_hz: self.hybrid.then(|| self.frequencies_hz.clone().unwrap_or_else(frequencies)),
        })
    }

    /// Ranges, and options without those that they belong to.
    fn check(&self, has_posterior: bool) -> Result<(), OptionError> {
        for (name, draws) in [("draws", self.draws), ("compensator_draws", self.compensator_draws)]
        {
            if let Some(draws) = draws.filter(|draws| !(1..=MOST_DRAWS).contains(draws)) {
                return Err(OptionError::Value(format!(
                    "‹{name}› must be from 1 to {MOST_DRAWS}, got {draws}"
                )));
            }
        }
        if let Some(found) =
            self.least_friction.filter(|scale| !(LEAST_FRICTION..=1.0).contains(scale))
        {
            return Err(OptionError::Value(format!(
                "‹least_friction› must be from {LEAST_FRICTION} to 1, got {found}"
            )));
        }
        for (name, numbers) in [
            ("delays_s", &self.delays_s),
            ("fractions", &self.fractions),
            ("frequencies_hz", &self.frequencies_hz),
        ] {
            if numbers.as_ref().is_some_and(Vec::is_empty) {
                return Err(OptionError::Value(format!("‹{name}› must hold at least one number")));
            }
        }
        let belonging = [
            ("draws", self.draws.is_some(), "advise", self.advise),
            ("posterior", has_posterior, "advise", self.advise),
            ("compensator_draws", self.compensator_draws.is_some(), "advise", self.advise),
            ("least_friction", self.least_friction.is_some(), "advise", self.advise),
            ("delays_s", self.delays_s.is_some(), "map", self.map),
            ("fractions", self.fractions.is_some(), "map", self.map),
            ("frequencies_hz", self.frequencies_hz.is_some(), "hybrid", self.hybrid),
        ];
        match belonging.into_iter().find(|(_, is_given, _, is_asked)| *is_given && !is_asked) {
            Some((name, _, to, _)) => {
                Err(OptionError::Value(format!("‹{name}› changes nothing without ‹{to}=True›")))
            }
            None => Ok(()),
        }
    }

    /// Whether there is anything to find in the loop.
    fn check_loop(&self, config: &Config) -> Result<(), OptionError> {
        let sample_time_s = config.sample_time_s;
        let allowed = sample_time_s..=LONGEST_MAPPED * sample_time_s;
        if let Some(found) = self.longest_delay_s.filter(|longest| !allowed.contains(longest)) {
            return Err(OptionError::Nothing(format!(
                "‹map›: the longest delay must be from the sample time, {sample_time_s} s, to 10 000 times that, got {found} s"
            )));
        }
        let why = if self.map && config.tissue.kind == TissueKind::None {
            "‹map›: there is no tissue whose stiffness could be found\n\nhint: give tissue.kind"
        } else if self.advise && !config.has_tissue() {
            "‹advise›: there is no tissue that could be felt\n\nhint: give tissue.kind and tissue.stiffness_n_m"
        } else if (self.advise || self.map) && !config.uses_compensation() {
            "the fraction of the trocar's force changes nothing in this loop: position_position and wave send no force, and a \
             sensor at the tip reads none of it\n\nhint: leave out ‹advise› and ‹map›"
        } else {
            return Ok(());
        };
        Err(OptionError::Nothing(why.to_owned()))
    }

    fn check_intervals(
        &self,
        [compensator, plant]: [&ModelFile; 2],
        has_posterior: bool,
    ) -> Result<(), OptionError> {
        let name = if self.draws.is_some() && !has_posterior && plant.intervals.is_empty() {
            "draws"
        } else if self.compensator_draws.is_some() && compensator.intervals.is_empty() {
            "compensator_draws"
        } else {
            return Ok(());
        };
        Err(OptionError::Nothing(format!(
            "‹{name}› needs a model with 95 % intervals, as identify writes it"
        )))
    }

    fn candidates(&self, seed: u64, posterior: Option<Vec<Stages>>) -> Candidates {
        let usual = if posterior.is_some() { POSTERIOR_DRAWS } else { 0 };
        Candidates {
            draws: self.draws.unwrap_or(usual),
            posterior,
            compensator_draws: self.compensator_draws.unwrap_or(0),
            seed,
            least_friction_scale: self.least_friction.unwrap_or(1.0),
        }
    }

    /// Delays, s, and fractions of the map.
    fn axes(&self, config: &Config) -> [Vec<f64>; 2] {
        let delays = self.delays_s.clone();
        let fractions = self.fractions.clone();
        [
            delays.unwrap_or_else(|| map_delays(config, self.longest_delay_s)),
            fractions.unwrap_or_else(map_fractions),
        ]
    }
}
