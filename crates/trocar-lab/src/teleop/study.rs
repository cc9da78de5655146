//! The results of `trocar teleop` for one loop, for all interfaces.

use std::sync::atomic::{AtomicUsize, Ordering};

use serde::Serialize;
use thiserror::Error;
use trocar_model::{ParamError, Trocar};

use super::advise::{Advice, FRACTIONS, Map, advise, map};
use super::config::{Architecture, Config, ConfigError};
use super::hybrid::{Response, response};
use super::merit::Merit;
use super::model::{Candidates, candidates};
use super::outcome::Outcome;
use super::stability::{Disturbance, ZWidth};
use crate::summary::json_text;
use trocar_runtime::model_file::ModelFile;

/// What to compute besides the course, its figures and the stiffnesses with which the loop is stable.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Questions {
    /// Which fraction of the trocar's force to compensate.
    pub advice: Option<Candidates>,
    /// Where the loop is stable: delays of one direction, s, and fractions.
    pub map: Option<[Vec<f64>; 2]>,
    /// The hybrid matrix at these frequencies, Hz.
    pub hybrid_hz: Option<Vec<f64>>,
}

/// A loop with its results.
#[derive(Debug, Clone, PartialEq)]
pub struct Study {
    /// The loop.
    pub config: Config,
    /// The compensator's model, and the trocar.
    pub models: [Trocar<Vec<f64>>; 2],
    /// Its course and figures.
    pub outcome: Outcome,
    /// Stiffnesses of the tissue with which it is stable; none without tissue.
    pub z_width: Option<ZWidth>,
    /// How much of the trocar's force to compensate.
    pub advice: Option<Advice>,
    /// Where it is stable.
    pub map: Option<Map>,
    /// The hybrid matrix, for strokes of the amplitude of the motion.
    pub hybrid: Option<Vec<Response>>,
    /// What halving the step of the plant changes by more than 1 %.
    pub step_error: Option<StepError>,
}

/// Why a loop cannot be studied.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum StudyError {
    /// A configuration that cannot be run.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// Trocars or models that the intervals do not allow.
    #[error("the model within its 95 % intervals: {0}")]
    Intervals(#[from] ParamError),
}

/// `summary.json`, and what `--json` prints.
#[derive(Debug, Serialize)]
pub struct Summary<'a> {
    /// γ of the loop.
    pub fraction: f64,
    /// Whether it comes to rest after every disturbance that is tried.
    pub settles: bool,
    /// The one after which it does not come to rest.
    pub unsettled_by: Option<Disturbance>,
    /// None where it does not, or diverges.
    pub figures: Option<&'a Merit>,
    /// Ranges of stiffness with which it is stable, N/m; none without tissue.
    pub z_width_n_m: Option<&'a ZWidth>,
    /// When it diverged, s.
    pub unstable_after_s: Option<f64>,
    /// How much of the trocar's force to compensate, if requested.
    pub advice: Option<&'a Advice>,
    /// Where the loop is stable, if requested.
    pub map: Option<&'a Map>,
    /// None where the steps of the plant are short enough.
    pub step_error: Option<StepError>,
    /// The loop with all its keys.
    pub config: &'a Config,
}

impl Study {
    /// Studies the loop of `config`; of `files` the first is the compensator's model, the second the trocar. `progress` takes
    /// a stage and the part of it that is done, 0 to 1.
    ///
    /// # Errors
    /// [`StudyError`]. A loop that is unstable is a result.
    pub fn new(
        config: Config,
        files: [&ModelFile; 2],
        questions: &Questions,
        progress: &(dyn Fn(&str, f64) + Sync),
    ) -> Result<Self, StudyError> {
        let config = config.with_force_error(files[0]);
        let models = files.map(|file| &file.trocar);
        let outcome = Outcome::of(&config, models)?;
        let z_width = ZWidth::of(&config, models)?;
        let stage = |stage: &'static str, steps: usize| {
            let done = AtomicUsize::new(0);
            move || {
                let done = 1 + done.fetch_add(1, Ordering::Relaxed);
                progress(stage, done as f64 / steps as f64);
            }
        };
        let step_error = match config.substeps <= MOST_SUBSTEPS {
            true => StepError::of(&config, models, &outcome)?,
            false => None,
        };
        let advice = questions.advice.as_ref().map(|wanted| {
            let pairs = candidates(files, wanted)?;
            Ok::<_, StudyError>(advise(&config, &pairs, stage("advice", FRACTIONS as usize))?)
        });
        let advice = advice.transpose()?;
        let map = questions.map.as_ref().map(|[delays, fractions]| {
            let done = stage("stability map", delays.len() * fractions.len());
            map(&config, models, delays, fractions, done)
        });
        let map = map.transpose()?;
        let amplitude = config.motion.amplitude_m.abs();
        let hybrid = questions.hybrid_hz.as_ref();
        let hybrid = hybrid.map(|frequencies| response(&config, models, amplitude, frequencies));
        Ok(Self {
            step_error,
            advice,
            map,
            hybrid: hybrid.transpose()?,
            outcome,
            z_width,
            models: models.map(Clone::clone),
            config,
        })
    }

    /// When the loop diverged, s.
    pub fn unstable_after_s(&self) -> Option<f64> {
        self.outcome.course.as_ref().err().map(|diverged| diverged.time_s)
    }

    /// Whether there is tissue that the tip does not reach: the figures are then those of free motion.
    fn is_out_of_reach(&self) -> bool {
        self.config.has_tissue()
            && self.outcome.figures.as_ref().is_some_and(|merit| !merit.reaches(&self.config))
    }

    /// Whether the result is doubtful: there are [warnings](Self::warnings), or nothing can be advised.
    pub fn is_doubtful(&self) -> bool {
        let is_refused = self.advice.as_ref().is_some_and(|advice| advice.fraction.is_none());
        is_refused || !self.warnings().is_empty()
    }

    /// What makes the result doubtful, with what may help.
    pub fn warnings(&self) -> Vec<String> {
        let mut all = Vec::new();
        let unstable = match &self.outcome.course {
            Err(diverged) => Some(diverged.to_string()),
            Ok(_) => self.outcome.unsettled_by.map(|by| {
                format!("the loop is unstable: it does not come to rest after {}", by.in_words())
            }),
        };
        all.extend(
            unstable.map(|why| format!("{why}\n\nhint: try {}", self.remedies().join(", "))),
        );
        all.extend(self.step_error.map(|error| {
            let more = 4 * self.config.substeps;
            format!(
                "{error}\n\nhint: try substeps = {more}; where passivity control, losses or an encoder keep switching a force, more steps \
                 may not help"
            )
        }));
        if self.config.has_tissue() && self.config.begins_in_the_tissue() {
            all.push(
                "the motion begins in the tissue: no stiffness displayed\n\nhint: begin before tissue.surface_m, see [motion]".to_owned(),
            );
        }
        if self.is_out_of_reach() {
            all.push(
                "the tip does not reach the tissue: the figures are those of free motion\n\nhint: let the hand go further, \
                 or longer than the channel delays, see [motion]; hand and control need a stiffness; with passivity = true give the \
                 control a passivity_reserve_j".to_owned(),
            );
        }
        all
    }

    /// Changes that may make an unstable loop stable.
    fn remedies(&self) -> Vec<&'static str> {
        let Config { control, channel, operator, .. } = &self.config;
        let four_channels = control.architecture == Architecture::FourChannel;
        let reflects = control.architecture == Architecture::PositionForce;
        let all = [
            (
                self.config.uses_compensation() && self.advice.is_none(),
                "‹advise=True›, which finds the fractions of the trocar's force with which it is stable",
            ),
            (reflects && control.force_gain > 0.0, "a lower control.force_gain"),
            (channel.delay_s > 0.0, "a shorter channel.delay_s"),
            (!control.passivity, "control.passivity = true"),
            (
                four_channels && operator.mass_kg == 0.0,
                "operator.mass_kg above 0, without which sampled four channels are unstable",
            ),
            (true, "a lower control.stiffness_n_m or another control.damping_n_s_m"),
        ];
        all.into_iter().filter(|(helps, _)| *helps).map(|(_, what)| what).collect()
    }

    /// The contents of summary.json.
    pub fn summary(&self) -> Summary<'_> {
        Summary {
            fraction: self.config.compensation.fraction,
            settles: self.outcome.settles(),
            unsettled_by: self.outcome.unsettled_by,
            figures: self.outcome.figures.as_ref(),
            z_width_n_m: self.z_width.as_ref(),
            unstable_after_s: self.unstable_after_s(),
            advice: self.advice.as_ref(),
            map: self.map.as_ref(),
            step_error: self.step_error,
            config: &self.config,
        }
    }
}

/// Most steps of the plant within a sample that are halved for comparison.
const MOST_SUBSTEPS: u32 = 64;
/// Largest change of a figure when the step is halved, relative.
const STEP_TOLERANCE: f64 = 0.01;

/// What changes most when the step of the plant is halved: the steps are too long for the loop.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct StepError {
    /// The figure that changes most; none where the loop becomes stable or unstable.
    pub figure: Option<&'static str>,
    /// Its change relative to its new value.
    pub relative: Option<f64>,
}

impl StepError {
    /// Runs the loop with half the step. `None` where no figure changes by more than 1 %.
    fn of(
        config: &Config,
        models: [&Trocar<Vec<f64>>; 2],
        coarse: &Outcome,
    ) -> Result<Option<Self>, ConfigError> {
        let mut halved = config.clone();
        halved.substeps *= 2;
        if halved.check().is_err() {
            // More steps than an experiment may have.
            return Ok(None);
        }
        let fine = Outcome::of(&halved, models)?;
        let (Some(coarse), Some(fine)) = (&coarse.figures, &fine.figures) else {
            let differs = coarse.figures.is_some() != fine.figures.is_some();
            return Ok(differs.then_some(Self { figure: None, relative: None }));
        };
        let energy = 1e3 * fine.leader_energy_j.abs().max(fine.follower_energy_j.abs());
        let pairs = coarse.rows().into_iter().zip(fine.rows());
        let changes = pairs.filter_map(|((figure, before, unit), (_, after, _))| {
            let (before, after) = (before?, after?);
            let scale = if unit == "mJ" { energy } else { after.abs() };
            let relative = (before - after).abs() / scale;
            let counts = (before - after).abs() > least_change(unit) && relative > STEP_TOLERANCE;
            counts.then_some(Self { figure: Some(figure), relative: Some(relative) })
        });
        Ok(changes.max_by(|a, b| a.relative.partial_cmp(&b.relative).expect("finite")))
    }
}

/// Change below which a figure is the same, in its unit.
fn least_change(unit: &str) -> f64 {
    match unit {
        "N/m" => 0.1,
        "mJ" => 0.01,
        _ => 1e-3,
    }
}

impl std::fmt::Display for StepError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("halving the step of the plant changes ")?;
        match (self.figure, self.relative) {
            (Some(figure), Some(relative)) => {
                write!(f, "the {figure} by {:.0} %", 100.0 * relative)
            }
            _ => f.write_str("whether the loop is stable"),
        }
    }
}

impl Summary<'_> {
    /// As the text of a file.
    pub fn to_json(&self) -> String {
        json_text(self)
    }
}
