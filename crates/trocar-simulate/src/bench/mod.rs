//! Virtual test bench: the set-up of EMS section IV with any seal of this project.
//!
//! A linear motor under PI speed control (or under constant force) moves a carriage. A force sensor
//! connects the carriage to a rod, and the rod passes through the seal. Motor, guide, rod and seal
//! are integrated together, so the seal's force disturbs the motion as on a rig. The recorded
//! signals have passed through the models of encoder and force sensor.
//!
//! ```text
//! M dv/dt  = F_motor − d·v − F_guide − F_cogging(x) + (1 − balanced)·M·g − F_gas − F_seal − F_tissue   M = slider + rod
//! reading  = F_seal + F_tissue + F_gas + m·(dv/dt − g) + tare + noise                                m = rod
//! ```
//!
//! | symbol | meaning | unit |
//! |--------|---------|------|
//! | x, v | position and velocity, positive on insertion | m, m/s |
//! | F_seal | force of the rod on the seal, sign of the motion in steady sliding | N |
//! | F_tissue | force of the tip on the tissue beyond the seal, if there is any | N |
//! | F_gas | gas pressure on the rod's cross-section, pushes the rod out | N |
//! | d | drag of guide and eddy currents | N s/m |
//! | g | gravity component in the direction of insertion | m/s² |
//!
//! - **Integration**: semi-implicit Euler at `sample_rate_hz · substeps`; the seal is stepped by
//!   displacement.
//! - **Roll**: the rod's angle follows its course exactly, without inertia.
//! - **Reproducible**: the same configuration, seal and seed give the same bytes; every noise
//!   source has its own random stream.
//! - **Not modelled**: elasticity of rod and frame, heating of the motor, communication delays.

pub mod config;
mod experiment;
mod fluctuation;
mod motion;
pub mod noise;
pub mod published;
pub mod random;
mod rig;
mod sensors;
pub mod surroundings;

pub use config::{BenchConfig, ConfigError};
pub use experiment::Experiment;
pub use random::{PlausibleSeals, random_plausible_seal, random_seal};

use core::fmt;
use core::str::FromStr;

use thiserror::Error;
use trocar_model::{Element, ElementParams, Rotation};

use trocar_recording::loads::Recorded;
use trocar_recording::{Readings, Recording, RecordingError};

use config::Loading;
use motion::Reference;
use noise::{Noise, Source};
use rig::{Push, RigState};
use sensors::{PositionSensor, SensorReading};

/// Experiments of the bench.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Protocol {
    /// Cycles at constant speeds: steady-state identification, EMS section IV-A.
    Steady,
    /// Cycles under constant motor force: identification of the deformation force, EMS section
    /// IV-B.
    Dynamic,
    /// Short cycles at constant speed: cross-validation, EMS section IV-C.
    Validation,
    /// One reversal of speed, EMS figure 3.
    Step,
    /// Hand-like motion: sub-movements, holds, small reversals, tremor.
    Surgeon,
    /// Strokes between rests of several lengths: friction after rest.
    Rest,
    /// Strokes while turning, at several ratios of the speeds, and reversals by turning alone.
    Roll,
    /// Strokes, each followed by a hold and a turn to and fro.
    HoldAndTurn,
}

impl Protocol {
    /// All protocols, in the order in which an identification uses them.
    pub const ALL: [Self; 8] = [
        Self::Steady,
        Self::Dynamic,
        Self::Validation,
        Self::Step,
        Self::Surgeon,
        Self::Rest,
        Self::Roll,
        Self::HoldAndTurn,
    ];

    /// Whether the rod turns.
    pub fn turns(self) -> bool {
        matches!(self, Self::Roll | Self::HoldAndTurn)
    }

    /// Name in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Steady => "steady",
            Self::Dynamic => "dynamic",
            Self::Validation => "validation",
            Self::Step => "step",
            Self::Surgeon => "surgeon",
            Self::Rest => "rest",
            Self::Roll => "roll",
            Self::HoldAndTurn => "hold-and-turn",
        }
    }
}

impl fmt::Display for Protocol {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// A string that names no protocol.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("unknown protocol {0:?}, expected one of {all}", all = Protocol::ALL.map(Protocol::name).join(", "))]
pub struct UnknownProtocol(pub String);

impl FromStr for Protocol {
    type Err = UnknownProtocol;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::ALL
            .into_iter()
            .find(|protocol| protocol.name() == name)
            .ok_or_else(|| UnknownProtocol(name.to_owned()))
    }
}

/// What a rig records, one entry per sample and column, and the true values that only a simulation
/// provides.
#[derive(Debug, Clone, PartialEq)]
pub struct BenchRun {
    /// Time since the first sample, s.
    pub time: Vec<f64>,
    /// Encoder position, m: whole counts.
    pub position: Vec<f64>,
    /// Speed reported by the drive, m/s.
    pub velocity: Vec<f64>,
    /// Reading of the force sensor, N.
    pub force: Vec<f64>,
    /// Angle of the rod, rad: whole counts; empty where the motion has none.
    pub angle: Vec<f64>,
    /// Reading of the torque sensor, N·m; empty where the motion has no angle.
    pub torque: Vec<f64>,
    /// Those of the loads beside the seal's force that the rig has.
    pub loads: Recorded,
    /// The true values of the recorded signals.
    pub truth: Truth,
    /// Events that an experimenter should know about.
    pub events: RigEvents,
}

/// True values of a recording, one entry per sample and column.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Truth {
    /// Position, m.
    pub position: Vec<f64>,
    /// Velocity, m/s.
    pub velocity: Vec<f64>,
    /// Acceleration, m/s².
    pub acceleration: Vec<f64>,
    /// Reference speed of the controller, m/s; zero under constant force.
    pub reference_velocity: Vec<f64>,
    /// Force of the motor on the carriage, N.
    pub motor_force: Vec<f64>,
    /// Force of the rod on the seal, with its slow fluctuation, N.
    pub seal_force: Vec<f64>,
    /// Force of the tip on the tissue, N.
    pub tissue_force: Vec<f64>,
    /// Friction of the seal relative to the dry one.
    pub wetting: Vec<f64>,
    /// Angle of the rod, rad; empty where the motion has none.
    pub angle: Vec<f64>,
    /// Torque of the rod on the seal, N·m; empty where the motion has no angle.
    pub torque: Vec<f64>,
    /// Deflection of each element, m: `deflections[element][sample]`.
    pub deflections: Vec<Vec<f64>>,
}

impl BenchRun {
    /// The columns; angle and torque where the rod turns.
    pub fn readings(&self) -> Readings {
        let Self { time, position, velocity, force, angle, torque, loads, .. } = self.clone();
        let [angle, torque] =
            [angle, torque].map(|column| Some(column).filter(|column| !column.is_empty()));
        Readings { time, position, force, velocity: Some(velocity), angle, torque, loads }
    }

    /// The columns but the velocity as a recording called `name`: the data available to the
    /// identification.
    ///
    /// # Errors
    /// [`RecordingError`] when the run is too short for a recording.
    pub fn to_recording(&self, name: impl Into<String>) -> Result<Recording, RecordingError> {
        let readings = Readings { velocity: None, ..self.readings() };
        Recording::from_readings(name, &readings, None)
    }
}

/// Events during a run that an experimenter should know about.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct RigEvents {
    /// Samples at which the force sensor was saturated.
    pub saturated_samples: usize,
    /// The same of the torque sensor.
    pub saturated_torques: usize,
    /// Integration steps in which the motor force was below the command of the controller.
    pub motor_limited_steps: usize,
    /// Number of times the carriage hit a safety stop.
    pub stop_hits: usize,
    /// Motor force on insertion and on withdrawal of `dynamic`, N; both zero in the other
    /// protocols.
    pub push: (f64, f64),
}

/// Why a run was not completed.
#[non_exhaustive]
#[derive(Debug, Clone, PartialEq, Error)]
pub enum BenchError {
    /// The configuration is out of range.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// It would take more memory or time than a recording justifies.
    #[error(
        "{what} takes up to {duration_s:.3e} s, {samples:.3e} samples at {rate_hz} Hz of {substeps} steps each: a run has at most \
         {most:e} samples and {most_steps:e} steps\n\nhint: {hint}; or lower rig.sample_rate_hz",
        most = MOST_SAMPLES, most_steps = MOST_STEPS
    )]
    TooLong {
        /// Protocol or motion.
        what: String,
        /// Its duration, s.
        duration_s: f64,
        /// Its samples.
        samples: f64,
        /// Samples per second.
        rate_hz: f64,
        /// Steps per sample.
        substeps: u32,
        /// Keys that make it shorter.
        hint: &'static str,
    },
    /// No experiment, or two.
    #[error("give a protocol or a motion, and not both")]
    WhichExperiment,
    /// A motion that the rig cannot make.
    #[error("the motion cannot be run: {0}")]
    Motion(String),
    /// A stroke under constant force did not reach its end.
    #[error(
        "the instrument stalled at {position} m in stroke {stroke} of dynamic: {push} N did not move it to the end \
         within stroke_timeout_s\n\nhint: raise protocol.dynamic.sliding_speed_m_s, or motor.peak_force_n"
    )]
    Stalled {
        /// Stroke, from 1.
        stroke: u32,
        /// Position at the timeout, m.
        position: f64,
        /// Motor force, N.
        push: f64,
    },
}

/// Runs one protocol with `seal`, the parallel elements of a seal (empty: the rig alone).
///
/// Before the first sample the rig homes by a withdrawal (see `rig.homing_m`), so the seal starts
/// deformed in the direction of withdrawal. A closed cycle ends where it began only as accurately
/// as the controller tracks.
///
/// # Errors
/// [`BenchError::Config`] when a value is out of range, [`BenchError::TooLong`] for more than
/// 5 million samples or 10⁹ steps, [`BenchError::Stalled`] when the constant force does not move the
/// instrument.
pub fn run(
    config: &BenchConfig,
    protocol: Protocol,
    seal: &[Element],
    seed: u64,
) -> Result<BenchRun, BenchError> {
    config.validate()?;
    length(config, protocol)?;
    let protocols = &config.protocol;
    let reference = match protocol {
        Protocol::Steady => Reference::speed_cycles(&protocols.steady, seed),
        Protocol::Validation => Reference::speed_cycles(&protocols.validation, seed),
        Protocol::Step => Reference::step(&protocols.step),
        Protocol::Surgeon => Reference::surgeon(&protocols.surgeon, seed),
        Protocol::Rest => Reference::rest(&protocols.rest),
        Protocol::Roll | Protocol::HoldAndTurn => {
            let (reference, angles) = match protocol {
                Protocol::Roll => Reference::roll(&protocols.roll),
                _ => Reference::hold_and_turn(&protocols.hold_and_turn),
            };
            let config = turning(config, seal);
            return recorded(&config, seal, seed, |rig, log| {
                rig.turn_along(angles);
                rig.follow(reference, log)
            });
        }
        Protocol::Dynamic => {
            let push = Push::new(config, seal);
            return recorded(config, seal, seed, |rig, log| rig.push(push, log));
        }
    };
    recorded(config, seal, seed, |rig, log| rig.follow(reference, log))
}

/// The bench with a seal that resists rotation: as its model says, or alike around the shaft of the
/// rod and along it.
pub fn turning(config: &BenchConfig, seal: &[Element]) -> BenchConfig {
    let alike = alike(0.5 * config.rod.diameter_m, seal.iter().map(Element::params));
    BenchConfig { rotation: Some(config.rotation.unwrap_or(alike)), ..config.clone() }
}

/// Rotation of a seal of `elements` that is as stiff and rough around a shaft of `shaft_radius`, m, as along it.
pub fn alike<'a>(
    shaft_radius: f64,
    elements: impl IntoIterator<Item = &'a ElementParams>,
) -> Rotation {
    let stiffnesses = elements.into_iter().map(ElementParams::mean_stiffness);
    Rotation {
        shaft_radius,
        circumferential_stiffness: stiffnesses.sum(),
        circumferential_ratio: 1.0,
    }
}

/// Most samples of the recording that `protocol` gives, known before it is made.
///
/// # Errors
/// [`BenchError::TooLong`].
pub fn length(config: &BenchConfig, protocol: Protocol) -> Result<usize, BenchError> {
    let hint = match protocol {
        Protocol::Steady | Protocol::Validation => {
            "raise slowest_m_s or increment_m_s, or lower cycles_per_speed or dwell_s"
        }
        Protocol::Dynamic => "lower cycles or stroke_timeout_s",
        Protocol::Step => "raise the speeds or lower stroke_m",
        Protocol::Surgeon => "lower duration_s",
        Protocol::Rest => "raise speed_m_s, or lower stroke_m, cycles or longest_s",
        Protocol::Roll => "raise the speeds, or lower stroke_m, rates or reversals",
        Protocol::HoldAndTurn => "raise the speeds, or lower stroke_m, cycles or hold_s",
    };
    let homing = "raise rig.homing_speed_m_s, or lower rig.homing_m or rig.homing_hold_s";
    samples(config, "homing (section rig)", config.rig.homing_s(), homing)?;
    samples(config, &format!("protocol.{protocol}"), config.protocol.duration_s(protocol), hint)
}

fn samples(
    config: &BenchConfig,
    what: &str,
    duration_s: f64,
    hint: &'static str,
) -> Result<usize, BenchError> {
    let (rate_hz, substeps) = (config.rig.sample_rate_hz, config.rig.substeps);
    let samples = (duration_s * rate_hz).ceil();
    if samples <= MOST_SAMPLES && samples * f64::from(substeps) <= MOST_STEPS {
        return Ok(samples as usize);
    }
    let what = what.to_owned();
    Err(BenchError::TooLong { what, duration_s, samples, rate_hz, substeps, hint })
}

/// Runs a motion, given as positions at times, with `seal`: the drive follows its speed.
///
/// The rig starts at the first position, after homing as for [`run`]; `rig.start_m` is not used.
///
/// # Errors
/// [`BenchError::Config`] when a value is out of range, [`BenchError::TooLong`] as for [`run`],
/// [`BenchError::Motion`] when it is not a motion or leaves the rig's travel.
pub fn run_motion(
    config: &BenchConfig,
    motion: &Course,
    seal: &[Element],
    seed: u64,
) -> Result<BenchRun, BenchError> {
    motion.check(config.rig.stroke_limit_m)?;
    let mut config = match motion.angle {
        Some(_) => turning(config, seal),
        None => config.clone(),
    };
    config.rig.start_m = motion.position[0];
    // Homing comes from deeper inside.
    config.rig.homing_m = config.rig.homing_m.min(config.rig.stroke_limit_m - config.rig.start_m);
    config.validate_without_protocols()?;
    let duration = motion.time[motion.time.len() - 1] - motion.time[0];
    samples(&config, "the motion", duration, "take a part of it")?;
    let reference = Reference::through(&motion.time, &motion.position);
    recorded(&config, seal, seed, |rig, log| {
        rig.turn_along(motion.clone());
        rig.follow(reference, log)
    })
}

/// A motion: positions, and angles if the rod turns, at times.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Course {
    /// Time, s, increasing.
    pub time: Vec<f64>,
    /// Position, m, increasing on insertion.
    pub position: Vec<f64>,
    /// Angle of the rod, rad, if it turns.
    pub angle: Option<Vec<f64>>,
}

/// Longest recording, in samples: its columns take half a gigabyte.
const MOST_SAMPLES: f64 = 5e6;
/// Most integration steps: minutes.
const MOST_STEPS: f64 = 1e9;

impl Course {
    /// The angle `time` s after the first sample, rad, straight between samples; 0 without any.
    fn angle_at(&self, time: f64) -> f64 {
        let Some(angle) = &self.angle else { return 0.0 };
        let time = self.time[0] + time.max(0.0);
        let next = self.time.partition_point(|own| *own <= time).min(self.time.len() - 1).max(1);
        let (from, to) = (self.time[next - 1], self.time[next]);
        let part = ((time - from) / (to - from)).min(1.0);
        angle[next - 1] + part * (angle[next] - angle[next - 1])
    }

    fn check(&self, travel: f64) -> Result<(), BenchError> {
        let wrong = |what: String| Err(BenchError::Motion(what));
        if self.time.len() < 2 || self.time.len() != self.position.len() {
            let (times, positions) = (self.time.len(), self.position.len());
            return wrong(format!(
                "it has {times} times and {positions} positions; at least two of each are needed"
            ));
        }
        let angles = self.angle.as_deref().unwrap_or_default();
        if self.angle.is_some() && angles.len() != self.time.len() {
            let (times, angles) = (self.time.len(), angles.len());
            return wrong(format!("it has {times} times and {angles} angles, expected as many"));
        }
        let mut numbers = self.time.iter().chain(&self.position).chain(angles);
        if !numbers.all(|number| number.is_finite()) {
            return wrong("it holds a number that is not finite".to_owned());
        }
        if let Some(pair) = self.time.windows(2).find(|pair| pair[0] >= pair[1]) {
            return wrong(format!("time goes from {} s to {} s", pair[0], pair[1]));
        }
        match self.position.iter().find(|x| !(0.0..=travel).contains(*x)) {
            Some(x) => wrong(format!(
                "it reaches {x} m, outside of the travel of the rig, 0 to {travel} m (rig.stroke_limit_m)"
            )),
            None => Ok(()),
        }
    }
}

/// A recording of what `drive` makes the rig do after homing.
fn recorded<'a>(
    config: &'a BenchConfig,
    seal: &'a [Element],
    seed: u64,
    drive: impl FnOnce(&mut RigState<'a>, &mut Log) -> Result<(), BenchError>,
) -> Result<BenchRun, BenchError> {
    let mut rig = RigState::new(config, seal, seed);
    rig.home();
    let mut log = Log::new(config, seal.len(), seed);
    drive(&mut rig, &mut log)?;
    Ok(log.finish(rig.events()))
}

/// Collects samples through the sensors.
struct Log {
    sample_rate: f64,
    rod_mass: f64,
    gas_force: f64,
    position_sensor: PositionSensor,
    force_reading: SensorReading,
    torque_reading: SensorReading,
    run: BenchRun,
}

impl Log {
    fn new(config: &BenchConfig, elements: usize, seed: u64) -> Self {
        let sample_rate = config.rig.sample_rate_hz;
        let Loading { side_force_n, tilt_rad, pressure_pa, .. } = config.loads;
        let largest = [side_force_n, tilt_rad, pressure_pa];
        Self {
            sample_rate,
            rod_mass: config.rod.mass_kg,
            gas_force: config.rod.gas_force(),
            position_sensor: PositionSensor::new(&config.encoder, seed),
            force_reading: SensorReading::new(
                &config.force_sensor,
                sample_rate,
                Noise::new(seed, Source::ForceSensor),
            ),
            torque_reading: SensorReading::new(
                &config.torque_sensor.in_si(),
                sample_rate,
                Noise::new(seed, Source::TorqueSensor),
            ),
            run: BenchRun {
                time: Vec::new(),
                position: Vec::new(),
                velocity: Vec::new(),
                force: Vec::new(),
                angle: Vec::new(),
                torque: Vec::new(),
                loads: largest.map(|most| (most > 0.0).then(Vec::new)),
                truth: Truth { deflections: vec![Vec::new(); elements], ..Truth::default() },
                events: RigEvents::default(),
            },
        }
    }

    fn sample(&mut self, rig: &RigState<'_>) {
        let inertia = self.rod_mass * (rig.acceleration() - rig.gravity());
        let load = rig.seal_force() + rig.tissue_force() + self.gas_force + inertia;
        let load = load + rig.side_friction();
        let (reading, saturated) = self.force_reading.read(load);
        let run = &mut self.run;
        run.events.saturated_samples += usize::from(saturated);
        run.time.push(run.time.len() as f64 / self.sample_rate);
        run.position.push(self.position_sensor.position(rig.position()));
        run.velocity.push(self.position_sensor.speed(rig.velocity()));
        run.force.push(reading);
        let truth = &mut run.truth;
        truth.position.push(rig.position());
        truth.velocity.push(rig.velocity());
        truth.acceleration.push(rig.acceleration());
        truth.reference_velocity.push(rig.reference_velocity());
        truth.motor_force.push(rig.motor_force());
        truth.seal_force.push(rig.seal_force());
        truth.tissue_force.push(rig.tissue_force());
        truth.wetting.push(rig.wetting());
        if let Some((angle, torque)) = rig.roll() {
            let (reading, saturated) = self.torque_reading.read(torque);
            run.events.saturated_torques += usize::from(saturated);
            run.angle.push(self.position_sensor.angle(angle));
            run.torque.push(reading);
            truth.angle.push(angle);
            truth.torque.push(torque);
        }
        for (column, load) in run.loads.iter_mut().zip(rig.loads()) {
            column.iter_mut().for_each(|column| column.push(load));
        }
        for (column, deflection) in truth.deflections.iter_mut().zip(rig.deflections()) {
            column.push(deflection);
        }
    }

    fn finish(self, events: RigEvents) -> BenchRun {
        let mut run = self.run;
        let RigEvents { saturated_samples, saturated_torques, .. } = run.events;
        run.events = RigEvents { saturated_samples, saturated_torques, ..events };
        run
    }
}
