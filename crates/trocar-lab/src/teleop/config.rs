//! The loop and the experiment.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use trocar_runtime::model_file::ModelFile;
pub use trocar_simulate::bench::config::TissueKind;
use trocar_simulate::bench::surroundings::contact_force;

/// The loop with every key at its default, described.
pub const EXAMPLE_TOML: &str = include_str!("../../data/teleop.toml");

/// Loops of devices by name, described as [`EXAMPLE_TOML`] is, with the source of each value.
pub const PRESETS: [(&str, &str); 2] = [
    ("dvrk", include_str!("../../data/teleop_dvrk.toml")),
    ("phantom", include_str!("../../data/teleop_phantom.toml")),
];

/// The document of a loop that is shipped: `default`, or a name in [`PRESETS`].
pub fn shipped(name: &str) -> Option<&'static str> {
    let preset = PRESETS.iter().find(|(own, _)| *own == name).map(|(_, text)| *text);
    preset.or((name == "default").then_some(EXAMPLE_TOML))
}

/// A teleoperation loop and what the operator does with it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Sample time of the controllers, s, above 0.
    pub sample_time_s: f64,
    /// Steps of the plant within a sample, 1 to 1000.
    pub substeps: u32,
    /// Seed of noise, jitter and loss, at most 2^53.
    pub seed: u64,
    /// Hand on the leader.
    pub operator: Operator,
    /// Device that the operator moves.
    #[serde(alias = "master")]
    pub leader: Device,
    /// Device that moves the instrument.
    #[serde(alias = "slave")]
    pub follower: Device,
    /// Way of the samples from one side to the other.
    pub channel: Channel,
    /// Law of the controllers.
    pub control: Control,
    /// How much of the trocar's force is compensated.
    pub compensation: Compensation,
    /// Force sensor of the follower.
    pub sensor: Sensor,
    /// What the tip touches.
    pub tissue: Tissue,
    /// What the operator intends.
    pub motion: Press,
}

/// Intended motion of the hand: `middle − amplitude·cos(2π·frequency·t)`, which begins at rest.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Press {
    /// Middle, m.
    pub middle_m: f64,
    /// Amplitude, m.
    pub amplitude_m: f64,
    /// Frequency, Hz, ≥ 0.
    pub frequency_hz: f64,
    /// Duration of the experiment, s, above 0.
    pub duration_s: f64,
    /// Rate at which the follower turns the instrument about its axis, rad/s; 0 for one that does not
    /// turn. The trocar's model must have rotation.
    pub turning_rad_s: f64,
}

impl Press {
    /// Where it begins, m.
    pub fn start_m(&self) -> f64 {
        self.middle_m - self.amplitude_m
    }

    /// Largest speed, m/s.
    pub(super) fn peak_m_s(&self) -> f64 {
        std::f64::consts::TAU * self.frequency_hz * self.amplitude_m.abs()
    }

    /// Angle of the instrument at `time`, s; rad.
    pub(crate) fn angle(&self, time: f64) -> f64 {
        self.turning_rad_s * time
    }

    /// Position, m, and velocity, m/s, at `time`, s.
    pub fn at(&self, time: f64) -> (f64, f64) {
        let rate = std::f64::consts::TAU * self.frequency_hz;
        let (sin, cos) = (rate * time).sin_cos();
        (self.middle_m - self.amplitude_m * cos, self.amplitude_m * rate * sin)
    }
}

/// Impedance of the hand, Z_h = m_h·s + b_h + k_h/s, between its intended motion and the leader.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Operator {
    /// k_h, N/m, ≥ 0.
    pub stiffness_n_m: f64,
    /// b_h, N s/m, ≥ 0.
    pub damping_n_s_m: f64,
    /// m_h, kg, ≥ 0.
    pub mass_kg: f64,
}

/// A device with one degree of freedom.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Device {
    /// Mass, kg, above 0.
    pub mass_kg: f64,
    /// Damping, N s/m, ≥ 0.
    pub damping_n_s_m: f64,
    /// Resolution of the encoder, m, ≥ 0; 0 for one without steps.
    pub encoder_step_m: f64,
}

/// Delay, jitter and loss, the same in both directions.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Channel {
    /// Delay of one direction, s, a multiple of the sample time.
    pub delay_s: f64,
    /// Largest additional delay of a sample, s, a multiple of the sample time; drawn uniformly. A sample
    /// that is overtaken is dropped.
    pub jitter_s: f64,
    /// Probability that a sample is lost, 0 to below 1.
    pub loss: f64,
    /// What the receiver uses in place of a sample that is late or lost.
    pub on_loss: OnLoss,
}

/// What a receiver uses in place of a missing sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OnLoss {
    /// The last one that arrived.
    Hold,
    /// The last position, but no velocity, force or wave.
    Zero,
}

/// What each side sends, and how motor forces follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Architecture {
    /// Both sides follow each other's position.
    PositionPosition,
    /// The follower follows the leader's position, the leader reflects the sensor's force.
    PositionForce,
    /// LAWRENCE's transparent choice, with HASHTRUDI's local force feedback: both positions and both forces are sent, and the
    /// masses are compensated.
    FourChannel,
    /// NIEMEYER's wave variables. Nothing is reflected where the follower's damping equals the wave
    /// impedance.
    Wave,
}

/// The controllers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Control {
    /// What is sent.
    pub architecture: Architecture,
    /// K of the position controllers, N/m, ≥ 0.
    pub stiffness_n_m: f64,
    /// B of the position controllers, N s/m, ≥ 0.
    pub damping_n_s_m: f64,
    /// λ, the fraction of the sensor's force that the leader reflects, ≥ 0; position-force only.
    pub force_gain: f64,
    /// C_6, the fraction of the operator's force that the leader's motor adds to it, -1 to 100; four channels only. The force of
    /// the tissue is sent with C_2 = 1 + C_6, so that -1 leaves that channel out: three remain.
    #[serde(alias = "master_force_feedback")]
    pub leader_force_feedback: f64,
    /// C_5, the fraction of the sensor's force that the follower's motor adds to it, -1 to 100; four channels only. The force of the
    /// operator is sent with C_3 = 1 + C_5, so that -1 leaves that channel out. One of C_5 and C_6 must be above -1.
    #[serde(alias = "slave_force_feedback")]
    pub follower_force_feedback: f64,
    /// b of the wave variables, N s/m, above 0.
    pub wave_impedance_n_s_m: f64,
    /// Time-domain passivity control at both ports.
    pub passivity: bool,
    /// Energy that the passivity control is given back.
    pub passivity_credit: PassivityCredit,
    /// Least friction scale λ of the trocar that the credit assumes, 0.01 to 1: the credit is what a trocar between this scale
    /// and the model's has dissipated at least.
    pub credit_friction_scale: f64,
    /// Energy that the passivity control may give beyond what it has received, J, ≥ 0, half of it at each port. A follower
    /// whose force is compensated needs some to begin to move, before there is a credit.
    pub passivity_reserve_j: f64,
}

/// Energy that the passivity control is given back, FRANKEN.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PassivityCredit {
    /// None: both ports are passive by themselves.
    None,
    /// The least that a trocar with the compensator's law has dissipated, with any friction scale from
    /// [`Control::credit_friction_scale`] to that of the model: the ports are passive together with the trocar. It is no bound
    /// for a trocar with less friction or another law.
    Trocar,
}

/// Compensation of the trocar's force.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Compensation {
    /// γ, the fraction of the model's force that is subtracted from the sensor's reading, ≥ 0.
    pub fraction: f64,
    /// Friction scale λ of the compensator's model relative to the one it is given, above 0: that model's force
    /// is λ·F(x/λ). 1.25 is a model 25 % too strong, as that of a dry seal is once the seal is wetted to 0.8.
    pub friction_scale: f64,
    /// Whether the compensator adapts friction and viscosity to the readings
    /// ([`trocar_runtime::compensate::Compensator`]).
    pub adaptation: bool,
    /// Standard deviation of the model's force, N, above 0, by which the adaptation weighs the readings;
    /// without it, that of the model file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub force_error_n: Option<f64>,
}

/// Where a force sensor is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Place {
    /// At the tip: reads the force on the tissue.
    Tip,
    /// Outside the body: reads the forces on tissue and trocar.
    Outside,
}

/// A force sensor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Sensor {
    /// Where it is.
    pub place: Place,
    /// Mass between sensor and tip, kg, ≥ 0, whose inertia an outside sensor reads.
    pub moving_mass_kg: f64,
    /// Standard deviation of the noise, N, ≥ 0.
    pub noise_n: f64,
    /// Reading without force, N.
    pub offset_n: f64,
    /// Resolution, N, ≥ 0; 0 for one without steps.
    pub resolution_n: f64,
}

/// Tissue beyond the seal; it never pulls.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Tissue {
    /// Force law; the exponent of Hunt-Crossley is 1.
    pub kind: TissueKind,
    /// Position at which the tip touches the tissue, m.
    pub surface_m: f64,
    /// k, N/m, ≥ 0.
    pub stiffness_n_m: f64,
    /// b of Kelvin-Voigt, N s/m, ≥ 0.
    pub damping_n_s_m: f64,
    /// a of Hunt-Crossley, s/m, ≥ 0.
    pub dissipation_s_m: f64,
    /// Amplitude of the surface's motion, breathing, m, ≥ 0.
    pub breathing_m: f64,
    /// Frequency of breathing, Hz, ≥ 0.
    pub breathing_hz: f64,
}

impl Default for Config {
    /// Position-force at 1 kHz, a firm hand, 0.5 kg on both sides, an outside sensor, soft tissue at
    /// 0.12 m.
    fn default() -> Self {
        Self {
            sample_time_s: 1e-3,
            substeps: 2,
            seed: 1,
            operator: Operator::default(),
            leader: Device::default(),
            follower: Device::default(),
            channel: Channel::default(),
            control: Control::default(),
            compensation: Compensation::default(),
            sensor: Sensor::default(),
            tissue: Tissue::default(),
            motion: Press::default(),
        }
    }
}

impl Default for Press {
    /// From 20 mm before the surface of the default tissue to 20 mm beyond it, twice within 4 s.
    fn default() -> Self {
        let (middle_m, amplitude_m) = (0.12, 0.02);
        Self { middle_m, amplitude_m, frequency_hz: 0.5, duration_s: 4.0, turning_rad_s: 0.0 }
    }
}

impl Default for Operator {
    /// A firm grip.
    fn default() -> Self {
        Self { stiffness_n_m: 300.0, damping_n_s_m: 10.0, mass_kg: 0.0 }
    }
}

impl Default for Device {
    fn default() -> Self {
        Self { mass_kg: 0.5, damping_n_s_m: 1.0, encoder_step_m: 0.0 }
    }
}

impl Default for Channel {
    /// Neither delay nor loss.
    fn default() -> Self {
        Self { delay_s: 0.0, jitter_s: 0.0, loss: 0.0, on_loss: OnLoss::Hold }
    }
}

impl Default for Control {
    fn default() -> Self {
        Self {
            architecture: Architecture::PositionForce,
            stiffness_n_m: 2000.0,
            damping_n_s_m: 40.0,
            force_gain: 1.0,
            leader_force_feedback: 0.0,
            follower_force_feedback: 0.0,
            wave_impedance_n_s_m: 20.0,
            passivity: false,
            passivity_credit: PassivityCredit::None,
            credit_friction_scale: 0.5,
            passivity_reserve_j: 0.0,
        }
    }
}

impl Default for Compensation {
    /// None; the model as it is, without adaptation.
    fn default() -> Self {
        Self { fraction: 0.0, friction_scale: 1.0, adaptation: false, force_error_n: None }
    }
}

impl Default for Sensor {
    /// Outside the body, ideal.
    fn default() -> Self {
        Self {
            place: Place::Outside,
            moving_mass_kg: 0.0,
            noise_n: 0.0,
            offset_n: 0.0,
            resolution_n: 0.0,
        }
    }
}

impl Default for Tissue {
    /// Soft tissue at 0.12 m.
    fn default() -> Self {
        Self {
            kind: TissueKind::KelvinVoigt,
            surface_m: 0.12,
            stiffness_n_m: 200.0,
            damping_n_s_m: 1.0,
            dissipation_s_m: 0.0,
            breathing_m: 0.0,
            breathing_hz: 0.0,
        }
    }
}

/// Why a configuration cannot be run.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum ConfigError {
    /// The document is not valid TOML, or has unknown keys or wrong types of values.
    #[error("{0}\n\nhint: `‹teleop_config()›` prints a loop with every key")]
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
    /// Values that do not go together, or with a model.
    #[error("{0}")]
    Unfit(String),
}

/// Longest experiment, in samples: what is stored.
const MOST_SAMPLES: f64 = 1e6;
/// Most steps of the plant in an experiment.
const MOST_STEPS: f64 = 1e7;
/// Least amplitude of the strokes of a hybrid matrix, m.
const SMALLEST_AMPLITUDE_M: f64 = 1e-9;
/// Least duration of a trial of stability, s.
const TRIAL_S: f64 = 2.0;
/// Greatest seed, 2^53: whole numbers up to there are numbers of any program.
const GREATEST_SEED: u64 = 1 << 53;
/// Longest delay, in samples.
const LONGEST_DELAY: f64 = 1e4;

impl Config {
    /// Whether the fraction of the trocar's force that is compensated changes anything: an outside sensor,
    /// whose force is sent.
    pub(crate) fn uses_compensation(&self) -> bool {
        let sends = [Architecture::PositionForce, Architecture::FourChannel]
            .contains(&self.control.architecture);
        sends && self.sensor.place == Place::Outside
    }

    /// Whether there is tissue with a stiffness.
    pub fn has_tissue(&self) -> bool {
        self.tissue.kind != TissueKind::None && self.tissue.stiffness_n_m > 0.0
    }

    /// Whether the motion has strokes, with which a hybrid matrix can be computed.
    pub fn has_strokes(&self) -> bool {
        self.motion.amplitude_m.abs() >= SMALLEST_AMPLITUDE_M
    }

    /// Whether the intended motion begins in the tissue, by more than a micrometre.
    pub(crate) fn begins_in_the_tissue(&self) -> bool {
        self.motion.start_m() > self.tissue.surface_m + 1e-6
    }

    /// Whether the intended motion leaves the tissue.
    pub(crate) fn leaves_the_tissue(&self) -> bool {
        let Tissue { surface_m, breathing_m, .. } = self.tissue;
        self.motion.middle_m - self.motion.amplitude_m.abs() < surface_m + breathing_m
    }

    /// The same without breathing and the sensor's noise.
    pub(super) fn quiet(&self) -> Self {
        let mut quiet = self.clone();
        (quiet.tissue.breathing_m, quiet.sensor.noise_n) = (0.0, 0.0);
        quiet
    }

    /// Whether the passivity control is given energy back.
    pub(crate) fn has_credit(&self) -> bool {
        self.control.passivity && self.control.passivity_credit != PassivityCredit::None
    }

    /// The loop that a TOML document describes; keys that are missing have their default.
    ///
    /// # Errors
    /// A document that is not valid, or a value out of its range.
    pub fn from_toml(text: &str) -> Result<Self, ConfigError> {
        let config: Self = toml::from_str(text)
            .map_err(|error| ConfigError::Syntax(error.to_string().trim_end().to_owned()))?;
        config.check()?;
        Ok(config)
    }

    /// Checks all values.
    ///
    /// # Errors
    /// The first value out of its range.
    pub fn check(&self) -> Result<(), ConfigError> {
        for (name, found, (allowed, holds)) in self.numbers() {
            check(holds(found), name, allowed, found)?;
        }
        // JSON and a page would round a larger number.
        let seed = self.seed as f64;
        check(self.seed <= GREATEST_SEED, "seed", "at most 9007199254740992", seed)?;
        let [c6, c5] = [self.control.leader_force_feedback, self.control.follower_force_feedback];
        let name = "control.follower_force_feedback";
        check(c5.max(c6) > -1.0, name, "above -1 where leader_force_feedback is -1", c5)?;
        if let Some(error) = self.compensation.force_error_n {
            let (allowed, holds) = ABOVE_0;
            check(holds(error), "compensation.force_error_n", allowed, error)?;
        }
        self.check_length()?;
        let turning = self.motion.turning_rad_s;
        if turning != 0.0 && self.has_credit() {
            return Err(ConfigError::Unfit(format!(
                "control.passivity_credit = \"trocar\" is no bound where the instrument turns (motion.turning_rad_s = {turning}): \
                 friction along the axis is less then\n\nhint: take \"none\""
            )));
        }
        self.delay_samples()?;
        self.jitter_samples().map(|_| ())
    }

    /// The numbers that have a range of their own: name, value, range.
    fn numbers(&self) -> [(&'static str, f64, Range); 37] {
        let Self { operator, leader, follower, control, compensation, .. } = self;
        let Self { sensor, tissue, motion, .. } = self;
        [
            ("sample_time_s", self.sample_time_s, SAMPLE_TIME),
            ("substeps", f64::from(self.substeps), SUBSTEPS),
            ("operator.stiffness_n_m", operator.stiffness_n_m, NOT_BELOW_0),
            ("operator.damping_n_s_m", operator.damping_n_s_m, NOT_BELOW_0),
            ("operator.mass_kg", operator.mass_kg, NOT_BELOW_0),
            ("leader.mass_kg", leader.mass_kg, MASS),
            ("leader.damping_n_s_m", leader.damping_n_s_m, NOT_BELOW_0),
            ("leader.encoder_step_m", leader.encoder_step_m, RESOLUTION),
            ("follower.mass_kg", follower.mass_kg, MASS),
            ("follower.damping_n_s_m", follower.damping_n_s_m, NOT_BELOW_0),
            ("follower.encoder_step_m", follower.encoder_step_m, RESOLUTION),
            ("control.stiffness_n_m", control.stiffness_n_m, NOT_BELOW_0),
            ("control.damping_n_s_m", control.damping_n_s_m, NOT_BELOW_0),
            ("control.force_gain", control.force_gain, NOT_BELOW_0),
            ("control.leader_force_feedback", control.leader_force_feedback, FEEDBACK),
            ("control.follower_force_feedback", control.follower_force_feedback, FEEDBACK),
            ("control.wave_impedance_n_s_m", control.wave_impedance_n_s_m, ABOVE_0),
            ("control.credit_friction_scale", control.credit_friction_scale, CREDIT_SCALE),
            ("control.passivity_reserve_j", control.passivity_reserve_j, NOT_BELOW_0),
            ("compensation.fraction", compensation.fraction, NOT_BELOW_0),
            ("compensation.friction_scale", compensation.friction_scale, FRICTION_SCALE),
            ("sensor.moving_mass_kg", sensor.moving_mass_kg, NOT_BELOW_0),
            ("sensor.noise_n", sensor.noise_n, NOT_BELOW_0),
            ("sensor.offset_n", sensor.offset_n, FINITE),
            ("sensor.resolution_n", sensor.resolution_n, RESOLUTION),
            ("tissue.surface_m", tissue.surface_m, PLACE),
            ("tissue.stiffness_n_m", tissue.stiffness_n_m, NOT_BELOW_0),
            ("tissue.damping_n_s_m", tissue.damping_n_s_m, NOT_BELOW_0),
            ("tissue.dissipation_s_m", tissue.dissipation_s_m, NOT_BELOW_0),
            ("tissue.breathing_m", tissue.breathing_m, NOT_BELOW_0),
            ("tissue.breathing_hz", tissue.breathing_hz, NOT_BELOW_0),
            ("motion.middle_m", motion.middle_m, PLACE),
            ("motion.amplitude_m", motion.amplitude_m, PLACE),
            ("motion.frequency_hz", motion.frequency_hz, NOT_BELOW_0),
            ("motion.duration_s", motion.duration_s, ABOVE_0),
            ("motion.turning_rad_s", motion.turning_rad_s, TURNING),
            ("channel.loss", self.channel.loss, LOSS),
        ]
    }

    /// Checks that the experiment and a trial of stability have not too many steps.
    fn check_length(&self) -> Result<(), ConfigError> {
        let (duration, substeps) = (self.motion.duration_s, f64::from(self.substeps));
        let samples = duration / self.sample_time_s;
        check(samples <= MOST_SAMPLES, "motion.duration_s", "at most a million samples", duration)?;
        let allowed = "so few that the experiment has at most 1e7 steps";
        check(samples * substeps <= MOST_STEPS, "substeps", allowed, substeps)?;
        let steps = TRIAL_S / self.sample_time_s * substeps;
        check(steps <= MOST_STEPS, "substeps", "so few that 2 s have at most 1e7 steps", substeps)
    }

    /// The same with the error of the model's force from `file`, the compensator's, unless it is stated already.
    pub(crate) fn with_force_error(mut self, file: &ModelFile) -> Self {
        let error = file.force_error;
        let of_file = error.and_then(|error| error.sliding_n.or(error.largest()));
        self.compensation.force_error_n = self.compensation.force_error_n.or(of_file);
        self
    }

    /// Samples of the experiment.
    pub fn samples(&self) -> usize {
        (self.motion.duration_s / self.sample_time_s).ceil() as usize
    }

    /// Delay of one direction in samples.
    ///
    /// # Errors
    /// A delay that is negative or no multiple of the sample time.
    pub(crate) fn delay_samples(&self) -> Result<usize, ConfigError> {
        self.whole("channel.delay_s", self.channel.delay_s)
    }

    /// Largest additional delay in samples.
    ///
    /// # Errors
    /// As for [`Config::delay_samples`].
    pub(crate) fn jitter_samples(&self) -> Result<usize, ConfigError> {
        self.whole("channel.jitter_s", self.channel.jitter_s)
    }

    fn whole(&self, name: &'static str, found: f64) -> Result<usize, ConfigError> {
        let samples = found / self.sample_time_s;
        let is_allowed = (0.0..=LONGEST_DELAY).contains(&samples);
        check(is_allowed, name, "from 0 to 10 000 sample times", found)?;
        let whole = samples.round();
        if (samples - whole).abs() > 1e-6 * whole.clamp(1.0, 1e3) {
            let sample_time_s = self.sample_time_s;
            let nearest = (whole * sample_time_s * 1e9).round() / 1e9;
            return Err(ConfigError::Unfit(format!(
                "{name} must be a multiple of the sample time, {sample_time_s} s, got {found} s\n\nhint: the \
                 controllers see only whole samples; take {nearest} s"
            )));
        }
        Ok(whole as usize)
    }
}

/// What is allowed of a number: in words, and whether it is.
type Range = (&'static str, fn(f64) -> bool);

// No device is beyond these, and the arithmetic of the plant could overflow.
const MASS: Range = ("from 1e-6 to 1e15", |found| (1e-6..=1e15).contains(&found));
const ABOVE_0: Range = ("above 0, at most 1e9", |found| found > 0.0 && found <= 1e9);
const NOT_BELOW_0: Range = ("0 or above, at most 1e9", |found| (0.0..=1e9).contains(&found));
const RESOLUTION: Range =
    ("0, or from 1e-12 to 1", |found| found == 0.0 || (1e-12..=1.0).contains(&found));
const PLACE: Range = ("from -1 to 1", |found| found.abs() <= 1.0);
const TURNING: Range = ("from -1000 to 1000", |found| found.abs() <= 1e3);
const FINITE: Range = ("finite", f64::is_finite);
const SAMPLE_TIME: Range = ("from 1e-6 to 0.1", |found| (1e-6..=0.1).contains(&found));
const SUBSTEPS: Range = ("from 1 to 1000", |found| (1.0..=1000.0).contains(&found));
const LOSS: Range = ("from 0 to below 1", |found| (0.0..1.0).contains(&found));
const FEEDBACK: Range = ("from -1 to 100", |found| (-1.0..=100.0).contains(&found));
const CREDIT_SCALE: Range = ("from 0.01 to 1", |found| (0.01..=1.0).contains(&found));
const FRICTION_SCALE: Range = ("from 0.01 to 100", |found| (0.01..=100.0).contains(&found));

fn check(
    is_so: bool,
    name: &'static str,
    allowed: &'static str,
    found: f64,
) -> Result<(), ConfigError> {
    if is_so { Ok(()) } else { Err(ConfigError::OutOfRange { name, allowed, found }) }
}

impl Tissue {
    /// F_e, N, of the tip on the tissue at `time` (s), `position` (m) and `velocity` (m/s).
    pub fn force(&self, time: f64, position: f64, velocity: f64) -> f64 {
        let (surface, rate) = self.surface(time);
        let depth = position - surface;
        if depth <= 0.0 {
            return 0.0;
        }
        let losses = [self.damping_n_s_m, self.dissipation_s_m];
        contact_force(self.kind, self.stiffness_n_m * depth, losses, velocity - rate)
    }

    /// Where the surface is and how fast it moves, m and m/s.
    pub fn surface(&self, time: f64) -> (f64, f64) {
        if self.breathing_m == 0.0 {
            return (self.surface_m, 0.0);
        }
        let rate = std::f64::consts::TAU * self.breathing_hz;
        let (sin, cos) = (rate * time).sin_cos();
        (self.surface_m + self.breathing_m * sin, self.breathing_m * rate * cos)
    }
}
