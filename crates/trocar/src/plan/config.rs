//! The rig for which a motion is planned.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::identify::Noise;
use crate::recording::{Recording, range};
use crate::segment::{Stroke, reversal_threshold, strokes};

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
}

/// Ranges of seals, lowest and highest.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Prior {
    /// F_c, N.
    pub coulomb_force_n: [f64; 2],
    /// β, N s/m.
    pub viscous_damping_n_s_m: [f64; 2],
    /// c, m.
    pub half_width_m: [f64; 2],
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
        }
    }
}

impl Default for Prior {
    fn default() -> Self {
        Self {
            coulomb_force_n: [0.5, 6.0],
            viscous_damping_n_s_m: [0.5, 15.0],
            half_width_m: [2e-3, 9e-3],
        }
    }
}

impl Prior {
    /// F_c, β and c as pairs.
    pub(super) fn ranges(&self) -> [(f64, f64); 3] {
        [self.coulomb_force_n, self.viscous_damping_n_s_m, self.half_width_m].map(|[a, b]| (a, b))
    }
}

impl Rig {
    /// Its travel, m.
    pub fn travel_m(&self) -> f64 {
        self.highest_m - self.lowest_m
    }
}

/// Why a configuration cannot be planned for.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum ConfigError {
    /// The document is not valid TOML, or has unknown keys or wrong types of values.
    #[error("{0}\n\nhint: `trocar plan --print-config` prints a rig with every key")]
    Syntax(String),
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

    /// The same on the rig that made `pilot`: its travel, fastest speed, largest acceleration, rate,
    /// encoder and noise.
    ///
    /// # Errors
    /// A value of the recording that is out of its range.
    pub fn on_the_rig_of(mut self, pilot: &Recording) -> Result<Self, ConfigError> {
        let (lowest_m, highest_m) = range(&pilot.position);
        let strokes = strokes(pilot, reversal_threshold(pilot));
        let mean_speed = |stroke: &Stroke| {
            let (from, to) = (stroke.start, stroke.end.min(pilot.len()) - 1);
            (pilot.position[to] - pilot.position[from]).abs() / (pilot.time[to] - pilot.time[from])
        };
        let speeds = strokes.iter().map(mean_speed).filter(|speed| speed.is_finite());
        let fastest_m_s = speeds.fold(0.0, f64::max);
        // Largest but for a hundredth of the samples: differences of positions are noisy.
        let mut accelerations: Vec<f64> = pilot.acceleration().iter().map(|a| a.abs()).collect();
        accelerations.sort_by(f64::total_cmp);
        let quality = &pilot.quality;
        self.rig = Rig {
            lowest_m,
            highest_m,
            slowest_m_s: self.rig.slowest_m_s.min(0.2 * fastest_m_s),
            fastest_m_s,
            acceleration_m_s2: accelerations[accelerations.len() * 99 / 100],
            sample_rate_hz: 1.0 / quality.median_interval,
            encoder_step_m: quality.position_resolution,
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
        let within = |name, allowed, found: f64, [low, high]: [f64; 2]| {
            if (low..=high).contains(&found) {
                Ok(())
            } else {
                Err(ConfigError::OutOfRange { name, allowed, found })
            }
        };
        let Rig { lowest_m, highest_m, slowest_m_s, fastest_m_s, .. } = self.rig;
        within("draws", "from 1 to 1000", f64::from(self.draws), [1.0, 1000.0])?;
        within("rig.lowest_m", "from -10 to 10", lowest_m, [-10.0, 10.0])?;
        within(
            "rig.highest_m",
            "above rig.lowest_m by 1e-3 to 10",
            highest_m,
            [lowest_m + 1e-3, lowest_m + 10.0],
        )?;
        within("rig.slowest_m_s", "from 1e-5 to 10", slowest_m_s, [1e-5, 10.0])?;
        within(
            "rig.fastest_m_s",
            "at least 1.5 rig.slowest_m_s, at most 10",
            fastest_m_s,
            [1.5 * slowest_m_s, 10.0],
        )?;
        let acceleration = self.rig.acceleration_m_s2;
        within("rig.acceleration_m_s2", "from 1e-3 to 1e3", acceleration, [1e-3, 1e3])?;
        within("rig.sample_rate_hz", "from 10 to 1e5", self.rig.sample_rate_hz, [10.0, 1e5])?;
        within("rig.encoder_step_m", "from 0 to 0.01", self.rig.encoder_step_m, [0.0, 0.01])?;
        within(
            "duration_s",
            "from 1 s to a million samples",
            self.duration_s,
            [1.0, MOST_SAMPLES / self.rig.sample_rate_hz],
        )?;
        let noise = &self.noise;
        within("noise.force_n", "from 1e-6 to 100", noise.force_n, [1e-6, 100.0])?;
        within("noise.scatter", "from 1e-4 to 0.5", noise.scatter, [1e-4, 0.5])?;
        let travel = noise.scatter_travel_m;
        within("noise.scatter_travel_m", "from 1e-5 to 1", travel, [1e-5, 1.0])?;
        within("noise.drift", "from 0 to 0.5", noise.drift, [0.0, 0.5])?;
        within("noise.ripple", "from 0 to 0.5", noise.ripple, [0.0, 0.5])?;
        within("noise.ripple_length_m", "from 1e-5 to 1", noise.ripple_length_m, [1e-5, 1.0])?;
        let named = [
            ("prior.coulomb_force_n", "two values, increasing, from 1e-3 to 100", [1e-3, 100.0]),
            (
                "prior.viscous_damping_n_s_m",
                "two values, increasing, from 1e-3 to 1e3",
                [1e-3, 1e3],
            ),
            ("prior.half_width_m", "two values, increasing, from 1e-5 to 0.05", [1e-5, 0.05]),
        ];
        for ((name, allowed, range), (low, high)) in named.into_iter().zip(self.prior.ranges()) {
            within(name, allowed, low, range)?;
            within(name, allowed, high, [low, range[1]])?;
        }
        Ok(())
    }
}
