//! The rig for which a motion is planned.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use thiserror::Error;
use trocar_model::{Element, ElementParams, ParamError, Trocar};

use crate::teleop::scaled;
use trocar_identify::Noise;
use trocar_recording::{Recording, local_acceleration, local_velocity, range};
use trocar_simulate::bench::published::{self, PublishedError};
use trocar_simulate::bench::{PlausibleSeals, random_seal};
use trocar_simulate::segment::{
    SegmentOptions, Stroke, reversal_threshold, steady_segments, strokes,
};

/// The rig with every key at its default, described.
pub const EXAMPLE_TOML: &str = include_str!("../../data/plan.toml");

/// Rig, noise and prior.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlanConfig {
    /// Time that the experiment may take, s, above 0.
    pub duration_s: f64,
    /// Seed of order, turning points and draws.
    pub seed: u64,
    /// Seals drawn from the prior, 1 to 1000.
    pub draws: u32,
    /// Limits of the rig.
    pub rig: Rig,
    /// What disturbs the readings.
    pub noise: Noise,
    /// Seals that are expected.
    pub prior: Prior,
}

/// Limits of the rig.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Rig {
    /// Lowest position, m.
    pub lowest_m: f64,
    /// Highest position, m, above the lowest.
    pub highest_m: f64,
    /// Slowest speed of a stroke, m/s, above 0.
    pub slowest_m_s: f64,
    /// Fastest speed, m/s, above the slowest.
    pub fastest_m_s: f64,
    /// Largest acceleration, m/s², above 0.
    pub acceleration_m_s2: f64,
    /// Rate of the motion and of the recording, Hz.
    pub sample_rate_hz: f64,
    /// Resolution of the position, m, ≥ 0.
    pub encoder_step_m: f64,
    /// Rate at which the rig can turn the instrument about its axis, rad/s; 0 where it cannot. The motion
    /// then ends with what is needed to identify rotation.
    pub turning_rad_s: f64,
    /// Diameter of the shaft, m, above 0; used where the rig turns.
    pub shaft_diameter_m: f64,
}

/// Ranges of seals, lowest and highest.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Prior {
    /// Key of a study whose published friction force is the range of F_c, in place of the default of
    /// the next.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub like: Option<String>,
    /// Whether their friction is that of dry seals, or lowered as published for wet ones.
    pub state: State,
    /// F_c, N.
    pub coulomb_force_n: [f64; 2],
    /// β, N s/m.
    pub viscous_damping_n_s_m: [f64; 2],
    /// c, m.
    pub half_width_m: [f64; 2],
}

/// State of the expected seals.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum State {
    /// As the ranges of the prior.
    #[default]
    Dry,
    /// Wetted: each seal at a friction scale drawn from the published range
    /// ([`published::wet_friction`]), F_wet(x) = λ·F(x/λ).
    Wet,
}

impl Default for PlanConfig {
    fn default() -> Self {
        Self {
            duration_s: 60.0,
            seed: 1,
            draws: 8,
            rig: Rig::default(),
            noise: Noise::default(),
            prior: Prior::default(),
        }
    }
}

impl Default for Rig {
    /// The virtual bench, which is that of the paper.
    fn default() -> Self {
        Self {
            lowest_m: 0.02,
            highest_m: 0.14,
            slowest_m_s: 0.005,
            fastest_m_s: 0.1,
            acceleration_m_s2: 1.0,
            sample_rate_hz: 1000.0,
            encoder_step_m: 4e-6,
            turning_rad_s: 0.0,
            shaft_diameter_m: 0.01,
        }
    }
}

impl Default for Prior {
    fn default() -> Self {
        Self {
            like: None,
            state: State::Dry,
            coulomb_force_n: [0.5, 6.0],
            viscous_damping_n_s_m: [0.5, 15.0],
            half_width_m: [2e-3, 9e-3],
        }
    }
}

impl Prior {
    /// The ranges from which seals are drawn.
    ///
    /// # Errors
    /// A key of no study, or of one that prints no friction force.
    pub fn seals(&self) -> Result<PlausibleSeals, PublishedError> {
        let rest = match &self.like {
            Some(key) => published::study(key)?.seals()?,
            None => PlausibleSeals {
                coulomb_force: self.coulomb_force_n.into(),
                ..PlausibleSeals::default()
            },
        };
        Ok(PlausibleSeals {
            viscous_damping: self.viscous_damping_n_s_m.into(),
            half_width: self.half_width_m.into(),
            ..rest
        })
    }
}

impl Rig {
    /// Its travel, m.
    pub fn travel_m(&self) -> f64 {
        self.highest_m - self.lowest_m
    }

    /// Where a motion begins, m.
    pub(super) fn begin_m(&self) -> f64 {
        self.lowest_m + 0.02 * self.travel_m()
    }

    /// Fastest speed around the shaft at its surface, m/s; 0 where the rig does not turn.
    pub(super) fn turning_m_s(&self) -> f64 {
        0.5 * self.shaft_diameter_m * self.turning_rad_s
    }
}

/// Why a configuration cannot be planned for.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum ConfigError {
    /// The document is not valid TOML, or has unknown keys or wrong types of values.
    #[error("{0}\n\nhint: `‹plan_config()›` prints a rig with every key")]
    Syntax(String),
    /// Text that is no goal, or values that do not go together.
    #[error("{0}")]
    Unfit(String),
    /// No seals for the key of a study.
    #[error("prior.like: {0}")]
    Like(#[from] PublishedError),
    /// A seal of the prior that makes no model once it is wetted.
    #[error("prior.state: {0}")]
    Wetted(#[from] ParamError),
    /// A value out of its range.
    #[error("{name} must be {allowed}, got {found}")]
    OutOfRange {
        /// Name with its section and unit.
        name: &'static str,
        /// What is allowed.
        allowed: &'static str,
        /// What was found.
        found: f64,
    },
}

/// Longest experiment, in samples.
const MOST_SAMPLES: f64 = 1e6;
/// Stream of the random numbers from which seals are drawn.
const SEALS: u64 = 1;
/// Window of the velocity of a pilot without constant-velocity segments, and of its accelerations, s.
const WINDOW: f64 = 0.05;

impl PlanConfig {
    /// The rig that a TOML document describes; keys that are missing have their default.
    ///
    /// # Errors
    /// What is no such document, or a value out of its range.
    pub fn from_toml(text: &str) -> Result<Self, ConfigError> {
        let config: Self = toml::from_str(text)
            .map_err(|error| ConfigError::Syntax(error.to_string().trim_end().to_owned()))?;
        config.check()?;
        Ok(config)
    }

    /// The seals of the prior for which a motion is planned. Other seeds draw other seals.
    pub(super) fn expected_seals(&self) -> Result<Vec<ElementParams>, ConfigError> {
        let ranges = self.prior.seals()?;
        let mut seeds = ChaCha8Rng::seed_from_u64(self.seed);
        seeds.set_stream(SEALS);
        let dry: Vec<ElementParams> =
            (0..self.draws).map(|_| random_seal(&ranges, seeds.random())).collect();
        if self.prior.state == State::Dry {
            return Ok(dry);
        }
        let [low, high] = published::wet_friction();
        dry.into_iter()
            .map(|seal| Ok(wetted(seal, low + (high - low) * seeds.random::<f64>())?))
            .collect()
    }

    /// The same on the rig that made `pilot`: its travel, its fastest constant velocity (fastest
    /// velocity where none is constant), the largest acceleration of the median stroke, its rate,
    /// encoder and noise.
    ///
    /// # Errors
    /// A value of the recording that is out of its range.
    pub fn on_the_rig_of(mut self, pilot: &Recording) -> Result<Self, ConfigError> {
        let (lowest_m, highest_m) = range(&pilot.position);
        let strokes = strokes(pilot, reversal_threshold(pilot));
        let fastest_m_s = fastest(pilot, &strokes);
        let acceleration = local_acceleration(pilot, WINDOW);
        let parts = strokes.iter().map(|stroke| &acceleration[stroke.start..=stroke.end]);
        let mut largest: Vec<f64> =
            parts.map(|part| part.iter().fold(0.0, |most: f64, a| most.max(a.abs()))).collect();
        largest.sort_by(f64::total_cmp);
        let quality = &pilot.quality;
        self.rig = Rig {
            lowest_m,
            highest_m,
            slowest_m_s: self.rig.slowest_m_s.min(0.2 * fastest_m_s),
            fastest_m_s,
            acceleration_m_s2: largest.get(largest.len() / 2).copied().unwrap_or(0.0),
            sample_rate_hz: 1.0 / quality.median_interval,
            encoder_step_m: quality.position_resolution,
            ..self.rig
        };
        self.noise.force_n = quality.force_noise.max(quality.force_resolution / 12f64.sqrt());
        self.check()?;
        Ok(self)
    }

    /// Checks all values.
    ///
    /// # Errors
    /// The first value out of its range.
    pub fn check(&self) -> Result<(), ConfigError> {
        within("draws", "from 1 to 1000", f64::from(self.draws), [1.0, 1000.0])?;
        self.rig.check()?;
        let longest = MOST_SAMPLES / self.rig.sample_rate_hz;
        within("duration_s", "from 1 s to a million samples", self.duration_s, [1.0, longest])?;
        let noise = &self.noise;
        within("noise.force_n", "from 1e-6 to 100", noise.force_n, [1e-6, 100.0])?;
        within("noise.scatter", "from 1e-4 to 0.5", noise.scatter, [1e-4, 0.5])?;
        let travel = noise.scatter_travel_m;
        within("noise.scatter_travel_m", "from 1e-5 to 1", travel, [1e-5, 1.0])?;
        within("noise.drift", "from 0 to 0.5", noise.drift, [0.0, 0.5])?;
        within("noise.ripple", "from 0 to 0.5", noise.ripple, [0.0, 0.5])?;
        within("noise.ripple_length_m", "from 1e-5 to 1", noise.ripple_length_m, [1e-5, 1.0])?;
        self.prior.check()
    }
}

impl Rig {
    fn check(&self) -> Result<(), ConfigError> {
        let Self { lowest_m, slowest_m_s, .. } = *self;
        within("rig.lowest_m", "from -10 to 10", lowest_m, [-10.0, 10.0])?;
        let above = [lowest_m + 1e-3, lowest_m + 10.0];
        within("rig.highest_m", "above rig.lowest_m by 1e-3 to 10", self.highest_m, above)?;
        within("rig.slowest_m_s", "from 1e-5 to 10", slowest_m_s, [1e-5, 10.0])?;
        let faster = "at least 1.5 rig.slowest_m_s, at most 10";
        within("rig.fastest_m_s", faster, self.fastest_m_s, [1.5 * slowest_m_s, 10.0])?;
        let acceleration = self.acceleration_m_s2;
        within("rig.acceleration_m_s2", "from 1e-3 to 1e3", acceleration, [1e-3, 1e3])?;
        within("rig.sample_rate_hz", "from 10 to 1e5", self.sample_rate_hz, [10.0, 1e5])?;
        within("rig.encoder_step_m", "from 0 to 0.01", self.encoder_step_m, [0.0, 0.01])?;
        within("rig.turning_rad_s", "from 0 to 1000", self.turning_rad_s, [0.0, 1e3])?;
        within("rig.shaft_diameter_m", "from 1e-4 to 0.1", self.shaft_diameter_m, [1e-4, 0.1])
    }
}

impl Prior {
    fn check(&self) -> Result<(), ConfigError> {
        self.seals()?;
        if self.like.is_some() && self.coulomb_force_n != Self::default().coulomb_force_n {
            let why =
                "prior.like and prior.coulomb_force_n both give F_c\n\nhint: leave out one of them";
            return Err(ConfigError::Unfit(why.to_owned()));
        }
        let (force, damping, width) =
            (self.coulomb_force_n, self.viscous_damping_n_s_m, self.half_width_m);
        let allowed = "two values, increasing, from 1e-3 to 100";
        increasing("prior.coulomb_force_n", allowed, force, [1e-3, 100.0])?;
        let allowed = "two values, increasing, from 1e-3 to 1e3";
        increasing("prior.viscous_damping_n_s_m", allowed, damping, [1e-3, 1e3])?;
        let allowed = "two values, increasing, from 1e-5 to 0.05";
        increasing("prior.half_width_m", allowed, width, [1e-5, 0.05])
    }
}

/// The seal with the friction scale `scale`.
fn wetted(seal: ElementParams, scale: f64) -> Result<ElementParams, ParamError> {
    let dry = Trocar::<Vec<f64>>::new(Element::new(seal)?, None);
    let wet = scaled(&dry, scale)?;
    Ok(wet.seal().stages().map_or(seal, |stages| *stages.first().params()))
}

fn increasing(
    name: &'static str,
    allowed: &'static str,
    [first, second]: [f64; 2],
    [low, high]: [f64; 2],
) -> Result<(), ConfigError> {
    within(name, allowed, first, [low, high])?;
    within(name, allowed, second, [first, high])
}

fn within(
    name: &'static str,
    allowed: &'static str,
    found: f64,
    [low, high]: [f64; 2],
) -> Result<(), ConfigError> {
    // NaN is in no range.
    if (low..=high).contains(&found) {
        return Ok(());
    }
    Err(ConfigError::OutOfRange { name, allowed, found })
}

/// Fastest constant velocity of a recording, m/s; fastest velocity where none is constant.
fn fastest(pilot: &Recording, strokes: &[Stroke]) -> f64 {
    let constant = steady_segments(pilot, strokes, &SegmentOptions::default());
    let fastest = constant.iter().map(|segment| segment.velocity.abs()).fold(0.0, f64::max);
    if fastest > 0.0 {
        return fastest;
    }
    local_velocity(pilot, WINDOW).iter().fold(0.0, |most, v| most.max(v.abs()))
}
