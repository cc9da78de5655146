//! Rig and protocols as a TOML document. `data/bench.toml` is the default and describes every
//! value.

use serde::{Deserialize, Serialize};
use thiserror::Error;
use trocar_model::Rotation;

use super::Protocol;

/// The default document with every key, its default and its meaning.
pub const DEFAULT_TOML: &str = include_str!("../../data/bench.toml");

/// Rig and protocols. Field names are the keys of the document; they carry their units and are
/// described in [`DEFAULT_TOML`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BenchConfig {
    /// Travel, start and sampling.
    pub rig: Rig,
    /// Linear motor with its guide.
    pub motor: Motor,
    /// PI speed control.
    pub controller: Controller,
    /// Position encoder and the drive's speed signal.
    pub encoder: Encoder,
    /// Force sensor between motor and rod.
    pub force_sensor: ForceSensor,
    /// Torque sensor beside it.
    pub torque_sensor: TorqueSensor,
    /// Instrument shaft between sensor and seal.
    pub rod: Rod,
    /// Slow changes of the seal's force.
    pub fluctuation: Fluctuation,
    /// Wetting of the seal during the run.
    pub lubrication: Lubrication,
    /// Loads beside the force of the seal.
    pub loads: Loading,
    /// Contact of the tip beyond the seal.
    pub tissue: Tissue,
    /// One section per protocol.
    pub protocol: Protocols,
    /// How the seal under test resists rotation; from its model, not from the document.
    #[serde(skip)]
    pub rotation: Option<Rotation>,
}

/// Travel, start and sampling of the rig.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rig {
    /// Travel of the motor in m, positive.
    pub stroke_m: f64,
    /// Travel between the safety stops in m, positive, at most `stroke_m`.
    pub stroke_limit_m: f64,
    /// Position at which protocols begin in m, 0 to `stroke_limit_m`.
    pub start_m: f64,
    /// Length of the withdrawal before the recording in m, ≥ 0.
    pub homing_m: f64,
    /// Speed of that withdrawal in m/s, positive.
    pub homing_speed_m_s: f64,
    /// Rest before the first sample in s, ≥ 0.
    pub homing_hold_s: f64,
    /// Samples per second, positive.
    pub sample_rate_hz: f64,
    /// Integration steps per sample, at least 1.
    pub substeps: u32,
}

impl Rig {
    /// Duration of the withdrawal and the rest before the first sample, s.
    pub(super) fn homing_s(&self) -> f64 {
        // The ramps take as long again as half of the way at full speed.
        1.5 * self.homing_m / self.homing_speed_m_s + self.homing_hold_s
    }
}

/// Linear motor with its guide.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motor {
    /// Mass of slider and carriage in kg, positive.
    pub slider_mass_kg: f64,
    /// Force limit at standstill in N, positive.
    pub peak_force_n: f64,
    /// Speed at which the available force is zero in m/s, positive.
    pub no_load_speed_m_s: f64,
    /// Time constant from commanded to actual force in s, positive.
    pub force_time_constant_s: f64,
    /// Viscous drag in N s/m, ≥ 0.
    pub drag_n_s_m: f64,
    /// Dry friction of the guide in N, ≥ 0.
    pub guide_friction_n: f64,
    /// Velocity scale of the guide's dry friction near zero velocity in m/s, positive.
    pub guide_creep_m_s: f64,
    /// Amplitude of the cogging force in N, ≥ 0.
    pub cogging_n: f64,
    /// Period of the cogging force in m, positive.
    pub cogging_pitch_m: f64,
    /// Fraction of the moving weight carried by the counterbalance, 0 to 1.
    pub balanced_fraction: f64,
}

/// PI speed control.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Controller {
    /// Force per speed error in N s/m, positive.
    pub proportional_n_s_m: f64,
    /// Force per integrated speed error in N/m, ≥ 0.
    pub integral_n_m: f64,
}

/// Conversion of a position to a whole number of encoder counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Rounding {
    /// To the nearest count.
    Nearest,
    /// To the count below.
    Down,
}

/// Position encoder and the drive's speed signal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Encoder {
    /// Length of one count in m, positive.
    pub resolution_m: f64,
    /// Rounding of a position to counts.
    pub(crate) rounding: Rounding,
    /// Noise before rounding in m rms, ≥ 0.
    pub noise_m: f64,
    /// Noise of the drive's speed signal in m/s rms, ≥ 0.
    pub speed_noise_m_s: f64,
    /// One count of the roll axis in rad, positive.
    pub angle_resolution_rad: f64,
}

/// Force sensor between motor and rod.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ForceSensor {
    /// Reading at which the sensor saturates in N, positive.
    pub range_n: f64,
    /// Resolution of a reading in N, ≥ 0.
    pub resolution_n: f64,
    /// Noise in N rms, ≥ 0.
    pub noise_n: f64,
    /// Bandwidth of the noise in Hz, positive.
    pub noise_bandwidth_hz: f64,
    /// Reading of the unloaded sensor in N.
    pub tare_n: f64,
}

/// Torque sensor between motor and rod.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TorqueSensor {
    /// Reading at which the sensor saturates in N m, positive.
    pub range_n_m: f64,
    /// Resolution of a reading in N m, ≥ 0.
    pub resolution_n_m: f64,
    /// Noise in N m rms, ≥ 0.
    pub noise_n_m: f64,
    /// Bandwidth of the noise in Hz, positive.
    pub noise_bandwidth_hz: f64,
    /// Reading of the unloaded sensor in N m.
    pub tare_n_m: f64,
}

impl TorqueSensor {
    /// The sensor that reads N m as the other reads N.
    pub(super) fn in_si(&self) -> ForceSensor {
        ForceSensor {
            range_n: self.range_n_m,
            resolution_n: self.resolution_n_m,
            noise_n: self.noise_n_m,
            noise_bandwidth_hz: self.noise_bandwidth_hz,
            tare_n: self.tare_n_m,
        }
    }
}

/// Instrument shaft between sensor and seal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rod {
    /// Diameter in m, positive.
    pub diameter_m: f64,
    /// Mass between sensor and seal in kg, ≥ 0.
    pub mass_kg: f64,
    /// Component of gravity in the direction of insertion in m/s².
    pub gravity_m_s2: f64,
    /// Gas pressure on the rod's cross-section in Pa, ≥ 0; it pushes the rod out.
    pub gas_pressure_pa: f64,
}

impl Rod {
    /// Force with which the gas pushes the rod out, N.
    pub(super) fn gas_force(&self) -> f64 {
        0.25 * core::f64::consts::PI * self.diameter_m * self.diameter_m * self.gas_pressure_pa
    }
}

/// Slow changes of the seal's force, relative to that force.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fluctuation {
    /// Deviation of a stroke, rms, 0 to 0.2.
    pub stroke_fraction: f64,
    /// Travel over which the deviation of a new stroke develops, in m, positive.
    pub stroke_travel_m: f64,
    /// Ripple over the travelled distance, rms, 0 to 0.2.
    pub ripple_fraction: f64,
    /// Correlation length of the ripple in m, positive.
    pub ripple_length_m: f64,
    /// Change of the force over `drift_time_s`, -0.5 to 0.5; 0 for none.
    pub drift_fraction: f64,
    /// Duration of the drift in s after the first sample, positive.
    pub drift_time_s: f64,
}

/// Wetting of the seal during the run: its friction falls, the stiffness of its rubber does not.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lubrication {
    /// Friction of the wet seal relative to the dry one, 0.05 to 2; 1 for no change.
    pub level: f64,
    /// Viscous part of the wet seal relative to the dry one, 0 to 5; 1 for no change.
    pub viscosity: f64,
    /// Start of the change in s after the first sample, ≥ 0.
    pub onset_s: f64,
    /// Duration of the change in s, ≥ 0.
    pub spread_s: f64,
}

/// Loads beside the force of the seal, each from 0 to its largest value and back again and again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Loading {
    /// Largest force on the wall of the cannula in N, ≥ 0; 0 for none.
    pub side_force_n: f64,
    /// Friction of the cannula for each N of that force, ≥ 0.
    pub side_friction: f64,
    /// Largest tilt in rad, ≥ 0; 0 for none.
    pub tilt_rad: f64,
    /// Largest pressure of the gas in Pa, ≥ 0; 0 for none.
    pub pressure_pa: f64,
    /// Gain of the seal's force with that pressure in 1/Pa, ≥ 0.
    pub pressure_gain_per_pa: f64,
    /// Period of the side force in s, positive.
    pub period_s: f64,
}

/// Force law of the tissue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TissueKind {
    /// No tissue.
    None,
    /// Hunt-Crossley: damping grows with the depth.
    HuntCrossley,
    /// Kelvin-Voigt: spring and damper in parallel.
    KelvinVoigt,
}

/// Contact of the tip beyond the seal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tissue {
    /// Law of the contact.
    pub kind: TissueKind,
    /// Position at which the tip touches the tissue in m.
    pub surface_m: f64,
    /// Static force at a depth of 10 mm in N, positive.
    pub force_at_10_mm_n: f64,
    /// Exponent of the depth for Hunt-Crossley, 1 to 3; Kelvin-Voigt has 1.
    pub exponent: f64,
    /// Damping divided by stiffness for Hunt-Crossley in s/m, ≥ 0.
    pub dissipation_s_m: f64,
    /// Damping for Kelvin-Voigt in N s/m, ≥ 0.
    pub damping_n_s_m: f64,
    /// Constant load on the tip in N, positive against the insertion.
    pub load_n: f64,
    /// Start of that load in s after the first sample.
    pub load_from_s: f64,
    /// End of that load in s.
    pub load_until_s: f64,
}

/// One section per protocol.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Protocols {
    /// Steady-state experiment.
    pub steady: SpeedCycles,
    /// Cross-validation.
    pub validation: SpeedCycles,
    /// Cycles under constant motor force.
    pub dynamic: PushCycles,
    /// Velocity step.
    pub step: VelocityStep,
    /// Hand-like motion.
    pub surgeon: Surgeon,
    /// Strokes between rests.
    pub rest: Rest,
    /// Strokes while turning, and turning alone.
    pub roll: Roll,
    /// Strokes, holds and turns.
    #[serde(rename = "hold-and-turn")]
    pub hold_and_turn: HoldAndTurn,
}

impl Protocols {
    /// Longest duration of a recording, s: under constant force, of strokes that just do not stall.
    pub fn duration_s(&self, protocol: Protocol) -> f64 {
        match protocol {
            Protocol::Steady => self.steady.duration_s(),
            Protocol::Validation => self.validation.duration_s(),
            Protocol::Dynamic => {
                2.0 * f64::from(self.dynamic.cycles) * self.dynamic.stroke_timeout_s
            }
            Protocol::Step => {
                let speeds = [self.step.insertion_speed_m_s, self.step.withdrawal_speed_m_s];
                speeds
                    .map(|v| stroke_s(v, self.step.stroke_m, self.step.acceleration_m_s2))
                    .iter()
                    .sum()
            }
            Protocol::Surgeon => self.surgeon.duration_s,
            Protocol::Rest => self.rest.duration_s(),
            Protocol::Roll => {
                let Roll { speed_m_s, stroke_m, acceleration_m_s2, .. } = self.roll;
                let strokes = 2.0 * stroke_s(speed_m_s, stroke_m, acceleration_m_s2);
                let reversal = self.roll.reversal_rad / self.roll.reversal_rad_s;
                f64::from(self.roll.rates) * strokes + f64::from(self.roll.reversals) * reversal
            }
            Protocol::HoldAndTurn => {
                let own = &self.hold_and_turn;
                let stroke = stroke_s(own.speed_m_s, own.stroke_m, own.acceleration_m_s2);
                let turn = own.hold_s + own.turn_rad / own.turn_rad_s;
                2.0 * f64::from(own.cycles) * (stroke + 2.0 * turn)
            }
        }
    }
}

/// Duration of a stroke at `speed` from rest to rest, s.
fn stroke_s(speed: f64, stroke: f64, acceleration: f64) -> f64 {
    stroke / speed + speed / acceleration
}

/// Strokes between rests of several lengths.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rest {
    /// Cycles through all rests, at least 1.
    pub cycles: u32,
    /// Length of a stroke in m.
    pub stroke_m: f64,
    /// Speed of the strokes in m/s, positive.
    pub speed_m_s: f64,
    /// Acceleration limit in m/s², positive.
    pub acceleration_m_s2: f64,
    /// Shortest rest in s, positive.
    pub shortest_s: f64,
    /// Longest rest in s, at least `shortest_s`.
    pub longest_s: f64,
    /// A rest relative to the one before, 1.1 to 1000; the last is `longest_s`.
    pub factor: f64,
}

impl Rest {
    /// The rests in s, each after an insertion and after a withdrawal.
    pub fn lengths(&self) -> Vec<f64> {
        let shorter =
            core::iter::successors(Some(self.shortest_s), |length| Some(length * self.factor))
                .take_while(|length| *length < self.longest_s);
        shorter.chain([self.longest_s]).collect()
    }

    fn duration_s(&self) -> f64 {
        let stroke = stroke_s(self.speed_m_s, self.stroke_m, self.acceleration_m_s2);
        let cycle: f64 = self.lengths().iter().map(|length| 2.0 * (stroke + length)).sum();
        f64::from(self.cycles) * cycle + stroke
    }
}

/// Strokes while turning, and turning alone.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Roll {
    /// Speed of the strokes in m/s, positive.
    pub speed_m_s: f64,
    /// Length of a stroke in m.
    pub stroke_m: f64,
    /// Acceleration limit in m/s², positive.
    pub acceleration_m_s2: f64,
    /// Slowest turning of a cycle in rad/s, positive.
    pub slowest_rad_s: f64,
    /// Fastest turning in rad/s, at least `slowest_rad_s`.
    pub fastest_rad_s: f64,
    /// Cycles, one at each rate of turning, evenly spaced by ratio; at least 1.
    pub rates: u32,
    /// Turns without a stroke, to and fro.
    pub reversals: u32,
    /// Angle of such a turn in rad, positive.
    pub reversal_rad: f64,
    /// Its rate in rad/s, positive.
    pub reversal_rad_s: f64,
}

impl Roll {
    /// Rates of turning during the strokes, rad/s.
    pub(super) fn rates(&self) -> impl Iterator<Item = f64> {
        let last = f64::from(self.rates.max(2) - 1);
        let (slowest, ratio) = (self.slowest_rad_s, self.fastest_rad_s / self.slowest_rad_s);
        (0..self.rates).map(move |k| slowest * libm::pow(ratio, f64::from(k) / last))
    }
}

/// Strokes, each followed by a hold and a turn to and fro.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HoldAndTurn {
    /// Cycles of two strokes, at least 1.
    pub cycles: u32,
    /// Length of a stroke in m.
    pub stroke_m: f64,
    /// Speed of the strokes in m/s, positive.
    pub speed_m_s: f64,
    /// Acceleration limit in m/s², positive.
    pub acceleration_m_s2: f64,
    /// Rest before each turn in s, ≥ 0.
    pub hold_s: f64,
    /// Angle of a turn in rad, positive.
    pub turn_rad: f64,
    /// Its rate in rad/s, positive.
    pub turn_rad_s: f64,
}

/// Order of the speeds of the cycles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SpeedOrder {
    /// From the slowest to the fastest: a drift over time looks like viscous friction.
    Ascending,
    /// Random order of the cycles.
    Shuffled,
    /// From the slowest to the fastest and back, so twice as many cycles: a linear drift cancels.
    UpAndDown,
}

/// Cycles at constant speed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpeedCycles {
    /// Lowest speed in m/s, positive.
    pub slowest_m_s: f64,
    /// Highest speed in m/s, at least `slowest_m_s`.
    pub fastest_m_s: f64,
    /// Difference between adjacent speeds in m/s, positive.
    pub increment_m_s: f64,
    /// Cycles at each speed, at least 1.
    pub cycles_per_speed: u32,
    /// Order of the speeds.
    pub order: SpeedOrder,
    /// Length of a stroke in m; long enough to reach `fastest_m_s`.
    pub stroke_m: f64,
    /// Acceleration limit in m/s², positive.
    pub acceleration_m_s2: f64,
    /// Largest distance of a reversal from its nominal position in m, ≥ 0.
    pub turning_scatter_m: f64,
    /// Rest at each reversal in s, ≥ 0.
    pub dwell_s: f64,
}

impl SpeedCycles {
    /// The speeds in m/s, each once, from the slowest to the fastest.
    pub fn speeds(&self) -> Vec<f64> {
        // A thousandth of an increment keeps the last speed when the quotient is just below a whole
        // number.
        let increments = (self.fastest_m_s - self.slowest_m_s) / self.increment_m_s + 1e-3;
        (0..=increments as u32)
            .map(|i| self.slowest_m_s + f64::from(i) * self.increment_m_s)
            .collect()
    }

    /// Longest duration of all cycles, s.
    fn duration_s(&self) -> f64 {
        let stroke = self.stroke_m + 2.0 * self.turning_scatter_m;
        let each = self.speeds().into_iter();
        let each: f64 = each
            .map(|speed| 2.0 * (stroke_s(speed, stroke, self.acceleration_m_s2) + self.dwell_s))
            .sum();
        let there_and_back = if self.order == SpeedOrder::UpAndDown { 2.0 } else { 1.0 };
        there_and_back * f64::from(self.cycles_per_speed) * each
    }
}

/// Cycles under constant motor force.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PushCycles {
    /// Cycles of insertion and withdrawal, at least 1.
    pub cycles: u32,
    /// Stroke after which the force is reversed in m, positive.
    pub stroke_m: f64,
    /// Speed at which the constant force keeps the seal sliding in m/s, positive.
    pub sliding_speed_m_s: f64,
    /// Duration after which a stroke counts as stalled in s, positive.
    pub stroke_timeout_s: f64,
}

/// Velocity step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VelocityStep {
    /// Speed before the step in m/s, positive.
    pub insertion_speed_m_s: f64,
    /// Speed after the step in m/s, positive.
    pub withdrawal_speed_m_s: f64,
    /// Length of each stroke in m; long enough to reach the speeds.
    pub stroke_m: f64,
    /// Acceleration limit in m/s², positive.
    pub acceleration_m_s2: f64,
}

/// Hand-like motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Surgeon {
    /// Length of the recording in s, positive.
    pub duration_s: f64,
    /// Range of the motion in m, positive.
    pub range_m: f64,
    /// Shortest sub-movement in m, positive.
    pub shortest_m: f64,
    /// Longest sub-movement in m, at most half the range.
    pub longest_m: f64,
    /// Lowest mean speed in m/s, positive.
    pub slowest_m_s: f64,
    /// Highest mean speed in m/s, at least `slowest_m_s`.
    pub fastest_m_s: f64,
    /// Shortest duration of a sub-movement in s, positive.
    pub quickest_s: f64,
    /// Fraction of holds, 0 to 1.
    pub hold_probability: f64,
    /// Shortest hold in s, ≥ 0.
    pub hold_shortest_s: f64,
    /// Longest hold in s, at least `hold_shortest_s`.
    pub hold_longest_s: f64,
    /// Fraction of small reversals, 0 to 1; with the holds less than 1.
    pub reversal_probability: f64,
    /// Shortest small reversal in m, positive.
    pub reversal_shortest_m: f64,
    /// Longest small reversal in m, at most half the range.
    pub reversal_longest_m: f64,
    /// Tremor amplitude in m rms, ≥ 0.
    pub tremor_rms_m: f64,
    /// Lower end of the tremor band in Hz, positive.
    pub tremor_low_hz: f64,
    /// Upper end of the tremor band in Hz, at least `tremor_low_hz`.
    pub tremor_high_hz: f64,
}

/// Why a document is not a valid bench.
#[non_exhaustive]
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ConfigError {
    /// The text is not TOML; the message shows the line.
    #[error("not a TOML document: {0}")]
    Syntax(String),
    /// An unknown key.
    #[error("line {line}: unknown key {key}, expected one of {expected}")]
    UnknownKey {
        /// Line in the document, from 1.
        line: usize,
        /// Key with its sections.
        key: String,
        /// Keys of that section.
        expected: String,
    },
    /// A value of another type.
    #[error("line {line}: {key} must be {expected}, got {found}")]
    WrongType {
        /// Line in the document, from 1.
        line: usize,
        /// Key with its sections.
        key: String,
        /// Type of the default.
        expected: &'static str,
        /// Type found.
        found: &'static str,
    },
    /// A string that is not allowed for its key; the message lists the allowed ones.
    #[error("line {line}: {message}")]
    Word {
        /// Line in the document, from 1.
        line: usize,
        /// What was expected.
        message: String,
    },
    /// A number out of range, or inconsistent with another one.
    #[error("{}{key} must be {allowed}, got {found}", line_prefix(*line))]
    OutOfRange {
        /// Line in the document, from 1; `None` if the key has its default or the values did not
        /// come from a document.
        line: Option<usize>,
        /// Key with its sections.
        key: String,
        /// What is allowed.
        allowed: String,
        /// Number found.
        found: f64,
    },
}

/// Rejects `word` unless it is allowed for its key.
type CheckWord = fn(toml::Value) -> Result<(), toml::de::Error>;

/// Keys whose values are strings from a fixed set.
const WORDS: [(&str, CheckWord); 4] = [
    ("encoder.rounding", |word| word.try_into::<Rounding>().map(drop)),
    ("tissue.kind", |word| word.try_into::<TissueKind>().map(drop)),
    ("protocol.steady.order", |word| word.try_into::<SpeedOrder>().map(drop)),
    ("protocol.validation.order", |word| word.try_into::<SpeedOrder>().map(drop)),
];

/// The value of a key with its sections.
fn value_of(document: &toml::Table, key: &str) -> Option<toml::Value> {
    let (sections, name) = key.rsplit_once('.')?;
    let section =
        sections.split('.').try_fold(document, |table, section| table.get(section)?.as_table())?;
    section.get(name).cloned()
}

fn line_prefix(line: Option<usize>) -> String {
    line.map_or_else(String::new, |line| format!("line {line}: "))
}

impl Default for BenchConfig {
    /// The default document.
    fn default() -> Self {
        toml::from_str(DEFAULT_TOML).expect("the shipped document holds every key")
    }
}

impl BenchConfig {
    /// Reads a document; omitted keys keep their defaults.
    ///
    /// # Errors
    /// [`ConfigError`] with the line: invalid TOML, an unknown key, another type than that of the
    /// default, a number out of range.
    pub fn from_toml(text: &str) -> Result<Self, ConfigError> {
        let syntax = |error: toml::de::Error| ConfigError::Syntax(error.to_string());
        // Once for where the keys stand, once for their values: `toml` gives no table of both.
        let spans = toml::de::DeTable::parse(text).map_err(syntax)?;
        let given: toml::Table = text.parse().map_err(syntax)?;
        let mut merged: toml::Table = DEFAULT_TOML.parse().expect("the shipped document is TOML");
        let lines = Lines { text, root: spans.get_ref() };
        overlay(&mut merged, given, &lines, &mut Vec::new())?;
        for (key, check) in WORDS {
            value_of(&merged, key).map_or(Ok(()), check).map_err(|error| ConfigError::Word {
                line: lines.of(key).unwrap_or(1),
                message: format!("{key}: {}", error.message()),
            })?;
        }
        // Keys and types are those of the default document and the strings are checked, so this
        // cannot fail.
        let config: Self = merged.try_into().map_err(syntax)?;
        config.validate().map_err(|error| match error {
            ConfigError::OutOfRange { key, allowed, found, .. } => {
                ConfigError::OutOfRange { line: lines.of(&key), key, allowed, found }
            }
            other => other,
        })?;
        Ok(config)
    }

    /// The document that describes this bench completely, without comments.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("numbers and words always have a TOML form")
    }

    /// Checks every number and that the strokes fit between the safety stops.
    ///
    /// # Errors
    /// [`ConfigError::OutOfRange`] with the key, the allowed range and the number.
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.validate_without_protocols()?;
        self.validate_speeds("protocol.steady", &self.protocol.steady)?;
        self.validate_speeds("protocol.validation", &self.protocol.validation)?;
        self.validate_dynamic()?;
        self.validate_step()?;
        self.validate_surgeon()?;
        self.validate_strokes()?;
        self.validate_turning()
    }

    /// The same without the protocols, which another motion does not use.
    pub(super) fn validate_without_protocols(&self) -> Result<(), ConfigError> {
        self.validate_rig()?;
        self.validate_drive()?;
        self.validate_instruments()
    }

    fn validate_rig(&self) -> Result<(), ConfigError> {
        let rig = &self.rig;
        positive("rig.stroke_m", rig.stroke_m)?;
        within("rig.stroke_limit_m", rig.stroke_limit_m, 1e-3, rig.stroke_m)?;
        within("rig.start_m", rig.start_m, 0.0, rig.stroke_limit_m)?;
        let room = rig.stroke_limit_m - rig.start_m;
        within("rig.homing_m", rig.homing_m, 0.0, room)?;
        positive("rig.homing_speed_m_s", rig.homing_speed_m_s)?;
        not_negative("rig.homing_hold_s", rig.homing_hold_s)?;
        within("rig.sample_rate_hz", rig.sample_rate_hz, 10.0, 1e6)?;
        within("rig.substeps", f64::from(rig.substeps), 1.0, 10_000.0)
    }

    fn validate_drive(&self) -> Result<(), ConfigError> {
        let motor = &self.motor;
        positive("motor.slider_mass_kg", motor.slider_mass_kg)?;
        positive("motor.peak_force_n", motor.peak_force_n)?;
        positive("motor.no_load_speed_m_s", motor.no_load_speed_m_s)?;
        positive("motor.force_time_constant_s", motor.force_time_constant_s)?;
        not_negative("motor.drag_n_s_m", motor.drag_n_s_m)?;
        not_negative("motor.guide_friction_n", motor.guide_friction_n)?;
        positive("motor.guide_creep_m_s", motor.guide_creep_m_s)?;
        not_negative("motor.cogging_n", motor.cogging_n)?;
        positive("motor.cogging_pitch_m", motor.cogging_pitch_m)?;
        within("motor.balanced_fraction", motor.balanced_fraction, 0.0, 1.0)?;
        let control = &self.controller;
        positive("controller.proportional_n_s_m", control.proportional_n_s_m)?;
        not_negative("controller.integral_n_m", control.integral_n_m)
    }

    fn validate_instruments(&self) -> Result<(), ConfigError> {
        let encoder = &self.encoder;
        positive("encoder.resolution_m", encoder.resolution_m)?;
        not_negative("encoder.noise_m", encoder.noise_m)?;
        not_negative("encoder.speed_noise_m_s", encoder.speed_noise_m_s)?;
        positive("encoder.angle_resolution_rad", encoder.angle_resolution_rad)?;
        let torque = &self.torque_sensor;
        positive("torque_sensor.range_n_m", torque.range_n_m)?;
        not_negative("torque_sensor.resolution_n_m", torque.resolution_n_m)?;
        not_negative("torque_sensor.noise_n_m", torque.noise_n_m)?;
        positive("torque_sensor.noise_bandwidth_hz", torque.noise_bandwidth_hz)?;
        finite("torque_sensor.tare_n_m", torque.tare_n_m)?;
        let sensor = &self.force_sensor;
        positive("force_sensor.range_n", sensor.range_n)?;
        not_negative("force_sensor.resolution_n", sensor.resolution_n)?;
        not_negative("force_sensor.noise_n", sensor.noise_n)?;
        positive("force_sensor.noise_bandwidth_hz", sensor.noise_bandwidth_hz)?;
        finite("force_sensor.tare_n", sensor.tare_n)?;
        let rod = &self.rod;
        positive("rod.diameter_m", rod.diameter_m)?;
        not_negative("rod.mass_kg", rod.mass_kg)?;
        finite("rod.gravity_m_s2", rod.gravity_m_s2)?;
        not_negative("rod.gas_pressure_pa", rod.gas_pressure_pa)?;
        let slow = &self.fluctuation;
        // Above 0.2 a rare draw could reverse the sign of the force, and the seal would drive the
        // motion.
        within("fluctuation.stroke_fraction", slow.stroke_fraction, 0.0, 0.2)?;
        positive("fluctuation.stroke_travel_m", slow.stroke_travel_m)?;
        within("fluctuation.ripple_fraction", slow.ripple_fraction, 0.0, 0.2)?;
        positive("fluctuation.ripple_length_m", slow.ripple_length_m)?;
        within("fluctuation.drift_fraction", slow.drift_fraction, -0.5, 0.5)?;
        positive("fluctuation.drift_time_s", slow.drift_time_s)?;
        self.validate_surroundings()
    }

    fn validate_surroundings(&self) -> Result<(), ConfigError> {
        let wet = &self.lubrication;
        within("lubrication.level", wet.level, 0.05, 2.0)?;
        within("lubrication.viscosity", wet.viscosity, 0.0, 5.0)?;
        not_negative("lubrication.onset_s", wet.onset_s)?;
        not_negative("lubrication.spread_s", wet.spread_s)?;
        let loads = &self.loads;
        not_negative("loads.side_force_n", loads.side_force_n)?;
        not_negative("loads.side_friction", loads.side_friction)?;
        not_negative("loads.tilt_rad", loads.tilt_rad)?;
        not_negative("loads.pressure_pa", loads.pressure_pa)?;
        not_negative("loads.pressure_gain_per_pa", loads.pressure_gain_per_pa)?;
        positive("loads.period_s", loads.period_s)?;
        let tissue = &self.tissue;
        finite("tissue.surface_m", tissue.surface_m)?;
        positive("tissue.force_at_10_mm_n", tissue.force_at_10_mm_n)?;
        within("tissue.exponent", tissue.exponent, 1.0, 3.0)?;
        not_negative("tissue.dissipation_s_m", tissue.dissipation_s_m)?;
        not_negative("tissue.damping_n_s_m", tissue.damping_n_s_m)?;
        finite("tissue.load_n", tissue.load_n)?;
        finite("tissue.load_from_s", tissue.load_from_s)?;
        finite("tissue.load_until_s", tissue.load_until_s)
    }

    fn validate_speeds(&self, section: &str, cycles: &SpeedCycles) -> Result<(), ConfigError> {
        let key = |name: &str| format!("{section}.{name}");
        positive(&key("slowest_m_s"), cycles.slowest_m_s)?;
        let fastest = cycles.fastest_m_s;
        within(&key("fastest_m_s"), fastest, cycles.slowest_m_s, 10.0)?;
        within(&key("increment_m_s"), cycles.increment_m_s, 1e-4, 10.0)?;
        at_least_one(&key("cycles_per_speed"), cycles.cycles_per_speed)?;
        within(&key("acceleration_m_s2"), cycles.acceleration_m_s2, 1e-3, 1e3)?;
        not_negative(&key("dwell_s"), cycles.dwell_s)?;
        self.stroke(&key("stroke_m"), cycles.stroke_m, fastest, cycles.acceleration_m_s2)?;
        // Reversals stay between the safety stops, and the shortest stroke still reaches the
        // highest speed.
        let behind = self.rig.stroke_limit_m - self.rig.start_m - cycles.stroke_m;
        let spare = 0.5 * (cycles.stroke_m - fastest * fastest / cycles.acceleration_m_s2);
        let most = self.rig.start_m.min(behind).min(spare);
        within(&key("turning_scatter_m"), cycles.turning_scatter_m, 0.0, most.max(0.0))
    }

    fn validate_dynamic(&self) -> Result<(), ConfigError> {
        let push = &self.protocol.dynamic;
        at_least_one("protocol.dynamic.cycles", push.cycles)?;
        positive("protocol.dynamic.sliding_speed_m_s", push.sliding_speed_m_s)?;
        positive("protocol.dynamic.stroke_timeout_s", push.stroke_timeout_s)?;
        let room = self.rig.stroke_limit_m - self.rig.start_m;
        within("protocol.dynamic.stroke_m", push.stroke_m, 1e-3, room)
    }

    fn validate_step(&self) -> Result<(), ConfigError> {
        let step = &self.protocol.step;
        positive("protocol.step.insertion_speed_m_s", step.insertion_speed_m_s)?;
        positive("protocol.step.withdrawal_speed_m_s", step.withdrawal_speed_m_s)?;
        within("protocol.step.acceleration_m_s2", step.acceleration_m_s2, 1e-3, 1e3)?;
        let fastest = step.insertion_speed_m_s.max(step.withdrawal_speed_m_s);
        self.stroke("protocol.step.stroke_m", step.stroke_m, fastest, step.acceleration_m_s2)
    }

    fn validate_surgeon(&self) -> Result<(), ConfigError> {
        let key = |name: &str| format!("protocol.surgeon.{name}");
        let hand = &self.protocol.surgeon;
        positive(&key("duration_s"), hand.duration_s)?;
        let room = self.rig.stroke_limit_m - self.rig.start_m;
        within(&key("range_m"), hand.range_m, 1e-3, room)?;
        positive(&key("shortest_m"), hand.shortest_m)?;
        let half = 0.5 * hand.range_m;
        within(&key("longest_m"), hand.longest_m, hand.shortest_m, half)?;
        positive(&key("slowest_m_s"), hand.slowest_m_s)?;
        within(&key("fastest_m_s"), hand.fastest_m_s, hand.slowest_m_s, 10.0)?;
        // None is shorter than a sample, so there are no more of them than samples.
        positive(&key("quickest_s"), hand.quickest_s)?;
        let sample = 1.0 / self.rig.sample_rate_hz;
        if hand.quickest_s < sample {
            let allowed = format!("at least a sample, {sample}");
            return out_of_range(&key("quickest_s"), allowed, hand.quickest_s);
        }
        within(&key("hold_probability"), hand.hold_probability, 0.0, 0.9)?;
        not_negative(&key("hold_shortest_s"), hand.hold_shortest_s)?;
        let longest_hold = hand.hold_longest_s;
        within(&key("hold_longest_s"), longest_hold, hand.hold_shortest_s, 1e6)?;
        // Rounded, so that 0.9 and 0.1 add up to 1.
        let left = ((1.0 - hand.hold_probability) * 1e9).round() * 1e-9;
        within(&key("reversal_probability"), hand.reversal_probability, 0.0, left)?;
        positive(&key("reversal_shortest_m"), hand.reversal_shortest_m)?;
        let longest = hand.reversal_longest_m;
        within(&key("reversal_longest_m"), longest, hand.reversal_shortest_m, half)?;
        within(&key("tremor_rms_m"), hand.tremor_rms_m, 0.0, 0.005)?;
        positive(&key("tremor_low_hz"), hand.tremor_low_hz)?;
        let nyquist = 0.5 * self.rig.sample_rate_hz;
        within(&key("tremor_high_hz"), hand.tremor_high_hz, hand.tremor_low_hz, nyquist)
    }

    fn validate_strokes(&self) -> Result<(), ConfigError> {
        let Protocols { rest, roll, hold_and_turn: turn, .. } = &self.protocol;
        let strokes = [
            ("rest", rest.speed_m_s, rest.acceleration_m_s2, rest.stroke_m),
            ("roll", roll.speed_m_s, roll.acceleration_m_s2, roll.stroke_m),
            ("hold-and-turn", turn.speed_m_s, turn.acceleration_m_s2, turn.stroke_m),
        ];
        for (section, speed, acceleration, stroke) in strokes {
            let key = |name: &str| format!("protocol.{section}.{name}");
            positive(&key("speed_m_s"), speed)?;
            within(&key("acceleration_m_s2"), acceleration, 1e-3, 1e3)?;
            self.stroke(&key("stroke_m"), stroke, speed, acceleration)?;
        }
        at_least_one("protocol.rest.cycles", rest.cycles)?;
        within("protocol.rest.shortest_s", rest.shortest_s, 1e-3, 1e6)?;
        within("protocol.rest.longest_s", rest.longest_s, rest.shortest_s, 1e6)?;
        within("protocol.rest.factor", rest.factor, 1.1, 1e3)
    }

    fn validate_turning(&self) -> Result<(), ConfigError> {
        let Protocols { roll, hold_and_turn: turn, .. } = &self.protocol;
        positive("protocol.roll.slowest_rad_s", roll.slowest_rad_s)?;
        within("protocol.roll.fastest_rad_s", roll.fastest_rad_s, roll.slowest_rad_s, 1e3)?;
        at_least_one("protocol.roll.rates", roll.rates)?;
        positive("protocol.roll.reversal_rad", roll.reversal_rad)?;
        positive("protocol.roll.reversal_rad_s", roll.reversal_rad_s)?;
        at_least_one("protocol.hold-and-turn.cycles", turn.cycles)?;
        not_negative("protocol.hold-and-turn.hold_s", turn.hold_s)?;
        positive("protocol.hold-and-turn.turn_rad", turn.turn_rad)?;
        positive("protocol.hold-and-turn.turn_rad_s", turn.turn_rad_s)
    }

    /// A stroke must reach its speed and end before the safety stop.
    fn stroke(
        &self,
        key: &str,
        stroke: f64,
        fastest: f64,
        acceleration: f64,
    ) -> Result<(), ConfigError> {
        let room = self.rig.stroke_limit_m - self.rig.start_m;
        within(key, stroke, fastest * fastest / acceleration, room)
    }
}

fn out_of_range(key: &str, allowed: String, found: f64) -> Result<(), ConfigError> {
    Err(ConfigError::OutOfRange { line: None, key: key.to_owned(), allowed, found })
}

fn finite(key: &str, value: f64) -> Result<(), ConfigError> {
    if value.is_finite() {
        return Ok(());
    }
    out_of_range(key, "finite".into(), value)
}

fn positive(key: &str, value: f64) -> Result<(), ConfigError> {
    if value > 0.0 && value.is_finite() {
        return Ok(());
    }
    out_of_range(key, "positive".into(), value)
}

fn not_negative(key: &str, value: f64) -> Result<(), ConfigError> {
    if value >= 0.0 && value.is_finite() {
        return Ok(());
    }
    out_of_range(key, "zero or positive".into(), value)
}

fn within(key: &str, value: f64, low: f64, high: f64) -> Result<(), ConfigError> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    out_of_range(key, format!("between {low} and {high}"), value)
}

fn at_least_one(key: &str, value: u32) -> Result<(), ConfigError> {
    within(key, f64::from(value), 1.0, 1e6)
}

/// Finds the line of a key in the source document.
struct Lines<'t> {
    text: &'t str,
    root: &'t toml::de::DeTable<'t>,
}

impl Lines<'_> {
    fn of(&self, path: &str) -> Option<usize> {
        let mut table = self.root;
        let mut offset = None;
        for name in path.split('.') {
            let (key, value) = table.iter().find(|(key, _)| key.get_ref() == name)?;
            offset = Some(key.span().start);
            if let Some(inner) = value.get_ref().as_table() {
                table = inner;
            }
        }
        offset.map(|offset| 1 + self.text[..offset].matches('\n').count())
    }
}

/// Replaces defaults by the given values; `path` holds the enclosing sections.
fn overlay(
    defaults: &mut toml::Table,
    given: toml::Table,
    lines: &Lines<'_>,
    path: &mut Vec<String>,
) -> Result<(), ConfigError> {
    for (name, value) in given {
        path.push(name.clone());
        let key = path.join(".");
        let line = lines.of(&key).unwrap_or(1);
        if !defaults.contains_key(&name) {
            let expected = defaults.keys().cloned().collect::<Vec<_>>().join(", ");
            return Err(ConfigError::UnknownKey { line, key, expected });
        }
        let default = &mut defaults[&name];
        match (default, value) {
            (toml::Value::Table(inner), toml::Value::Table(value)) => {
                overlay(inner, value, lines, path)?;
            }
            // `stroke_m = 1` means 1.0.
            (default @ toml::Value::Float(_), toml::Value::Integer(value)) => {
                *default = toml::Value::Float(value as f64);
            }
            // All integers of a bench are counts.
            (toml::Value::Integer(_), toml::Value::Integer(value))
                if u32::try_from(value).is_err() =>
            {
                return Err(ConfigError::OutOfRange {
                    line: Some(line),
                    key,
                    allowed: format!("between 0 and {}", u32::MAX),
                    found: value as f64,
                });
            }
            (default, value) if default.same_type(&value) => *default = value,
            (default, value) => {
                return Err(ConfigError::WrongType {
                    line,
                    key,
                    expected: type_name(default),
                    found: type_name(&value),
                });
            }
        }
        path.pop();
    }
    Ok(())
}

fn type_name(value: &toml::Value) -> &'static str {
    match value {
        toml::Value::String(_) => "a text",
        toml::Value::Integer(_) => "a whole number",
        toml::Value::Float(_) => "a number",
        toml::Value::Boolean(_) => "true or false",
        toml::Value::Datetime(_) => "a date",
        toml::Value::Array(_) => "an array",
        toml::Value::Table(_) => "a section",
    }
}
