//! The force on the tissue, from a force sensor outside the body: the sensor reading less the
//! trocar force.
//!
//! ```text
//! F_tissue = reading − F_offset − m·(a + g) − F_trocar           force of the instrument on the tissue, N
//! F_trocar = F_0(x) + gain(x)·λ·[F − F_β + ν·F_β]     model driven by x/λ and φ/λ, F_β its viscous part
//! M_trocar = gain(x)·λ·M
//! ```
//!
//! | symbol | meaning | unit |
//! |--------|---------|------|
//! | λ | friction of the seal relative to that of the model; wetting lowers it | 1 |
//! | ν | viscous part relative to that of the model | 1 |
//! | m, a, g | mass between sensor and seal, its acceleration, gravity on the reading | kg, m/s² |
//!
//! λ scales forces and deflections alike, since wetting changes the friction but not the stiffness
//! of the rubber: F_wet(x) = λ·F(x/λ). λ and ν are estimated online ([`adapt`]) and are 1 without
//! adaptation. While the instrument turns, the two directions of a stroke hardly ever agree about λ: a
//! change then waits for strokes without turning.
//!
//! # Uncertainty
//!
//! ```text
//! std² = σ_phase² + gain(x)²·[f²·var λ + b²·var ν + 2·f·b·cov(λ, ν) + drawn² + spread² + minor² + doubt²]
//! f = F − F_β      b = λ·F_β
//! ```
//! σ_phase is the error of the model's force on recordings, by phase ([`ForceError`]). var λ and
//! var ν are those of the estimates; without validation recordings they come from the intervals of
//! the parameters. drawn is the error of the parameters that draws of them show (`drawn.rs`); where
//! there are draws, it replaces var λ and var ν from the intervals. spread is half the range of the forces of extreme initial states until the seal
//! has slid. minor is half the difference between the softest and the stiffest law between the
//! branches, as long as no recording contains partial reversals. doubt is the amount by which the
//! last two strokes, one each way, contradict the present λ ([`bank`]). After a change of the
//! friction, std does not cover it until a position is crossed in the direction opposite to its
//! last crossing.
//!
//! # Sign
//!
//! Readings are passed with the sign that the sensor gives them. Where the recordings of the model
//! were read with the sign reversed, the observer reverses the readings too
//! ([`CompensateOptions::flip_force`]); otherwise a positive reading is a force of the instrument
//! in the direction of insertion.
//!
//! # Faults
//!
//! A step never fails. A [`Fault`] names an invalid sample, and the tissue force is NaN where the
//! reading cannot determine it. The model continues with the motion as long as there is one.
//!
//! - **Real time**: after [`Compensator::new`] nothing is allocated, and the work of a step is
//!   bounded. An observer owns all that it needs of the model file.
//! - **Limits**: a tissue force that reverses with the motion and has the same magnitude in both
//!   directions cannot be distinguished from friction by a sensor outside the body.

use serde::{Deserialize, Serialize};
use trocar_model::{
    Deformation, DeformationForce, Element, Mode, ParameterId, PartialReversals, PositionProfile,
    Quantity, Seal, Stages, Trocar, TrocarState, Turning,
};

pub use adapt::Drift;
pub use constants::CompensatorConstants;
pub use faults::Fault;

use adapt::{Adapter, Sliding};
use bank::Bank;
use drawn::Drawn;
use faults::Watch;
use inertia::Inertia;
use saved::StateRow;
use sign::{SignWatch, Slid};

use crate::model_file::{ErrorSource, ForceError, Interval, ModelFile, ModelFileError};
use crate::profile::Departure;

pub mod adapt;
pub mod bank;
mod constants;
mod drawn;
mod faults;
mod inertia;
mod saved;
mod sign;

/// Speed below which the instrument counts as held, m/s, and the averaging time of that speed, s:
/// as in validation, from which the error of the phase comes.
const HOLD_SPEED: f64 = 1e-3;
const SPEED_TIME: f64 = 0.025;
/// Error in a phase that no recording contains, relative to the largest of the other phases. The
/// uncertainty of full strokes between the branches is included separately (`MinorLoops`). Any
/// further contribution of a rest or a partial reversal is unknown, and a factor of 2 makes its
/// variance three times that of all the rest. On random seals of the virtual bench, validated on
/// full strokes, the band then contains the true force in 95 % of the held samples.
const UNKNOWN: f64 = 2.0;
/// Times between samples shorter than this, s, are added to the next one.
const SHORTEST: f64 = 1e-5;
/// Least standard deviation of a model, N.
const LEAST_ERROR: f64 = 1e-3;
/// Extreme initial states count as one when their forces agree within this, N.
const FORGOTTEN: f64 = 1e-3;
/// Draws of the parameters after which more hardly change the standard deviation: its own error is
/// then 7 %.
pub const MOST_DRAWS: usize = 100;
/// First number of a saved state: the version of its form.
const STATE_FORMAT: f64 = 3.0;
/// 95 % quantile of a normal distribution, two-sided.
const NORMAL_95: f64 = 1.96;

/// Options of a compensator; all that are `None` come from the model file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CompensateOptions {
    /// Reading without any force, N, with the sign of the readings.
    pub offset_n: Option<f64>,
    /// Whether readings are reversed, because the sensor counts the other way round than the model;
    /// from the model file: as its recordings were.
    pub flip_force: Option<bool>,
    /// Mass between sensor and seal, kg, ≥ 0.
    pub moving_mass_kg: Option<f64>,
    /// Gravity as it acts on the reading of the moving mass, m/s²; 0 where the weight is part of
    /// the offset, as it is of the offset in a model file.
    pub gravity_m_s2: f64,
    /// Largest force the sensor can read, N.
    pub sensor_limit_n: Option<f64>,
    /// Standard deviation of the model's force in all phases, N.
    pub force_error_n: Option<f64>,
    /// Whether λ and ν are adapted to the readings.
    pub adaptation: bool,
}

impl Default for CompensateOptions {
    /// All values from the model file, with adaptation.
    fn default() -> Self {
        Self {
            offset_n: None,
            flip_force: None,
            moving_mass_kg: None,
            gravity_m_s2: 0.0,
            sensor_limit_n: None,
            force_error_n: None,
            adaptation: true,
        }
    }
}

/// Why a model cannot compensate.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum CompensateError {
    /// The model cannot be run.
    #[error(transparent)]
    Model(#[from] ModelFileError),
    /// The error of the model's force is not stated.
    #[error(
        "the model does not state the error of its force (force_error)\n\nhint: identify it again with ‹validate=...›, or state the \
         standard deviation with ‹force_error_n›"
    )]
    NoForceError,
    /// The model does not tell which sign the readings have.
    #[error(
        "some recordings of the model were read with the sign of the force reversed and some without: the sign of a reading is \
         unknown\n\nhint: state whether readings are reversed with ‹flip_force›"
    )]
    SignUnknown,
    /// Draws for a model that is no EMS element.
    #[error("posterior draws are of EMS elements, but the model is of kind {kind}")]
    NoElements {
        /// Kind of the model.
        kind: &'static str,
    },
    /// Gravity with the offset of the model file, of which the weight is a part.
    #[error(
        "gravity_m_s2 is {gravity} m/s², but the offset of the model includes the weight, which would be subtracted twice\n\nhint: \
         leave gravity_m_s2 out, or give offset_n without the weight"
    )]
    WeightTwice {
        /// The given value, m/s².
        gravity: f64,
    },
    /// Gravity without a moving mass on which it acts.
    #[error(
        "gravity_m_s2 is {gravity} m/s² without a moving mass on which it acts: give moving_mass_kg above 0, or leave \
         gravity_m_s2 out"
    )]
    GravityWithoutMass {
        /// The given value, m/s².
        gravity: f64,
    },
    /// A value out of its range.
    #[error("{name} must be {allowed}, got {found}")]
    OutOfRange {
        /// Name with its unit.
        name: &'static str,
        /// What is allowed.
        allowed: &'static str,
        /// What was found.
        found: f64,
    },
    /// Numbers that are not the saved state of this observer.
    #[error(
        "these {found} numbers are not the state of a compensator with this model and these options"
    )]
    NotAState {
        /// Numbers there are.
        found: usize,
    },
}

/// Output of a compensator for each sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Force of the instrument on seal and trocar, N.
    pub trocar_force: f64,
    /// Torque of the instrument on the seal, N·m; 0 for a model without rotation.
    pub trocar_torque: f64,
    /// Force of the instrument on the tissue, N; NaN where the reading cannot determine it.
    pub tissue_force: f64,
    /// Standard deviation of both, N.
    pub std: f64,
    /// Whether λ and ν are being adapted: frozen during tissue contact or when the motion contains
    /// no information about them.
    pub adapting: bool,
    /// The fault of this sample, if any.
    pub fault: Option<Fault>,
}

impl Estimate {
    /// Before the first sample.
    const NONE: Self = Self {
        trocar_force: 0.0,
        trocar_torque: 0.0,
        tissue_force: f64::NAN,
        std: f64::NAN,
        adapting: false,
        fault: None,
    };

    fn exchange(&mut self, row: &mut StateRow) {
        let numbers = [
            &mut self.trocar_force,
            &mut self.trocar_torque,
            &mut self.tissue_force,
            &mut self.std,
        ];
        numbers.into_iter().for_each(|number| row.number(number));
        row.flag(&mut self.adapting);
        Fault::exchange(&mut self.fault, row);
    }
}

/// Constants of the observer.
#[derive(Debug, Clone)]
struct Setup {
    trocar: Trocar<Vec<f64>>,
    /// The same without the position-dependent force.
    bare: Trocar,
    /// Whether readings have the other sign than the model.
    flips: bool,
    /// With the sign of the model.
    offset: f64,
    error: ForceError,
    adaptation: bool,
}

impl Setup {
    fn seal(&self) -> &Seal {
        self.trocar.seal()
    }

    fn profile(&self) -> Option<&PositionProfile<Vec<f64>>> {
        self.trocar.profile()
    }
}

/// An observer of the tissue force; see the module's documentation.
#[derive(Debug, Clone)]
pub struct Compensator {
    setup: Setup,
    /// State of the model driven by x/λ and φ/λ.
    state: TrocarState,
    /// The same from extreme initial states, as long as they differ.
    extremes: Option<[TrocarState; 2]>,
    position: Option<f64>,
    /// Of the instrument, rad.
    angle: f64,
    speed: f64,
    /// Mean over about [`SPEED_TIME`].
    mean_speed: f64,
    turns: PartialReversals,
    has_turned: bool,
    minor: Option<MinorLoops>,
    draws: Vec<Drawn>,
    inertia: Inertia,
    adapter: Adapter,
    bank: Bank,
    watch: Watch,
    sign: SignWatch,
    time: f64,
    /// Time since the model last moved, s, where samples could not move it.
    waited: f64,
    last: Estimate,
}

impl Compensator {
    /// An observer with the model of `file`; it starts with the first sample.
    ///
    /// # Errors
    /// [`CompensateError`]: a model with too many elements or without a stated error, an option out
    /// of its range.
    pub fn new(file: &ModelFile, options: &CompensateOptions) -> Result<Self, CompensateError> {
        Self::with_seal(file, *file.trocar.seal(), options)
    }

    /// The same with `seal`, such as an adjusted one, in place of that of `file`.
    ///
    /// # Errors
    /// As for [`Compensator::new`], except for the elements of the file.
    pub fn with_seal(
        file: &ModelFile,
        seal: Seal,
        options: &CompensateOptions,
    ) -> Result<Self, CompensateError> {
        let sensor = file.sensor;
        let flips = options
            .flip_force
            .or_else(|| file.flips_force())
            .ok_or(CompensateError::SignUnknown)?;
        let given = options.offset_n.map(|offset| if flips { -offset } else { offset });
        let offset = finite("offset_n", given.or(sensor.map(|s| s.offset_n)).unwrap_or(0.0))?;
        let mass = options.moving_mass_kg.or(sensor.map(|s| s.moving_mass_kg)).unwrap_or(0.0);
        let mass = not_negative("moving_mass_kg", mass)?;
        let gravity = finite("gravity_m_s2", options.gravity_m_s2)?;
        if gravity != 0.0 && mass == 0.0 {
            return Err(CompensateError::GravityWithoutMass { gravity });
        }
        if gravity != 0.0 && options.offset_n.is_none() && sensor.is_some() {
            return Err(CompensateError::WeightTwice { gravity });
        }
        let limit =
            options.sensor_limit_n.map(|limit| positive("sensor_limit_n", limit)).transpose()?;
        let error = match options.force_error_n {
            Some(std) => ForceError::everywhere(positive("force_error_n", std)?),
            None => {
                let known = file.force_error.filter(|error| error.largest().is_some());
                known.ok_or(CompensateError::NoForceError)?
            }
        };
        let sigma = error.in_phase(Phase::Sliding).max(LEAST_ERROR);
        // Validation recordings also contain the error of the parameters; those used for
        // identification do not.
        let shown = options.force_error_n.is_some() || error.source != ErrorSource::Identification;
        let of = |quantity: Quantity| if shown { 0.0 } else { relative_std(file, quantity) };
        let spread = [of(Quantity::CoulombForce), of(Quantity::ViscousDamping)];
        let watch = Watch::new(limit, sigma);
        let trocar = file.trocar.with_seal(seal);
        let bare = trocar.without_profile();
        Ok(Self {
            setup: Setup { trocar, bare, flips, offset, error, adaptation: options.adaptation },
            state: bare.rest_at_force(0.0, 0.0),
            extremes: None,
            position: None,
            angle: 0.0,
            speed: 0.0,
            mean_speed: 0.0,
            turns: PartialReversals::default(),
            has_turned: false,
            minor: if error.partial_n.is_some() { None } else { MinorLoops::new(&bare) },
            draws: Vec::new(),
            inertia: Inertia::new(mass, gravity),
            bank: Bank::new(&bare, sigma),
            adapter: Adapter::new(options.adaptation, spread, sigma),
            sign: SignWatch::new(&seal, watch.least_change()),
            watch,
            time: 0.0,
            waited: 0.0,
            last: Estimate::NONE,
        })
    }

    /// The same with draws of the parameters of its model, such as those of a posterior: the
    /// standard deviation then has the error of the parameters from their forces, in place of that
    /// from the intervals. Each draw is stepped with the model; [`MOST_DRAWS`] of them suffice.
    ///
    /// # Errors
    /// [`CompensateError::NoElements`] for a classical model.
    pub fn with_draws(mut self, draws: &[Stages]) -> Result<Self, CompensateError> {
        let seal = self.setup.seal();
        let model = seal.stages().ok_or(CompensateError::NoElements { kind: seal.kind() })?;
        self.draws = Drawn::all(draws, &self.setup.bare, model, self.setup.adaptation);
        if !self.setup.adaptation {
            let sigma = self.setup.error.in_phase(Phase::Sliding).max(LEAST_ERROR);
            self.adapter = Adapter::new(false, [0.0; 2], sigma);
        }
        Ok(self)
    }

    /// Resets the observer; it starts again with the next sample. Allocates nothing.
    pub fn reset(&mut self) {
        self.state = self.setup.bare.rest_at_force(0.0, 0.0);
        (self.extremes, self.position, self.angle) = (None, None, 0.0);
        (self.speed, self.mean_speed, self.time, self.waited) = (0.0, 0.0, 0.0, 0.0);
        (self.turns, self.has_turned) = (PartialReversals::default(), false);
        self.draws.iter_mut().for_each(|draw| draw.rest(0.0));
        self.inertia.restart(0.0, 0.0);
        self.adapter.reset();
        self.bank.reset(&self.setup.bare);
        self.watch.reset();
        self.sign.reset();
        self.last = Estimate::NONE;
    }

    /// Whether readings are reversed from now on, whatever the options and the model say: for
    /// readings whose sign the reader of a recording has reversed already. Returns whether they
    /// were before.
    pub fn set_flip_force(&mut self, flips: bool) -> bool {
        std::mem::replace(&mut self.setup.flips, flips)
    }

    /// All that changes with the samples, as numbers, for [`Compensator::set_state`]; some may be
    /// NaN or infinite.
    pub fn state(&self) -> Vec<f64> {
        let mut numbers = Vec::new();
        self.clone().exchange(&mut StateRow::Written(&mut numbers));
        numbers
    }

    /// Goes back to a state that [`Compensator::state`] gave, of this observer or another one with
    /// the same model and options: it then goes on with the same estimates, to the last bit.
    ///
    /// # Errors
    /// [`CompensateError::NotAState`]; the observer is then left as it was.
    pub fn set_state(&mut self, numbers: &[f64]) -> Result<(), CompensateError> {
        let (mut row, mut read) = (StateRow::of(numbers), self.clone());
        read.exchange(&mut row);
        if !row.is_whole() {
            return Err(CompensateError::NotAState { found: numbers.len() });
        }
        *self = read;
        Ok(())
    }

    /// Writes or reads all that changes.
    fn exchange(&mut self, row: &mut StateRow) {
        let model = self.setup.bare;
        row.expect(STATE_FORMAT);
        row.state(&model, &mut self.state);
        let either = [self.state; 2];
        row.optional(&mut self.extremes, either, |own, row| {
            own.iter_mut().for_each(|state| row.state(&model, state));
        });
        row.optional(&mut self.position, 0.0, |own, row| row.number(own));
        row.number(&mut self.angle);
        let numbers = [&mut self.speed, &mut self.mean_speed, &mut self.time, &mut self.waited];
        numbers.into_iter().for_each(|number| row.number(number));
        let mut turns = self.turns.to_numbers();
        row.numbers(&mut turns);
        self.turns = PartialReversals::from_numbers(turns);
        row.flag(&mut self.has_turned);
        if let Some(minor) = &mut self.minor {
            row.state(&minor.model, &mut minor.state);
        }
        self.draws.iter_mut().for_each(|draw| draw.exchange(row));
        self.inertia.exchange(row);
        self.adapter.exchange(row);
        self.bank.exchange(&model, row);
        self.watch.exchange(row);
        self.sign.exchange(row);
        self.last.exchange(row);
    }

    /// By how far the positions from `lowest` to `highest` (m) leave the range of the model's
    /// position profile.
    pub fn departure(&self, lowest: f64, highest: f64) -> Option<Departure> {
        Departure::of(self.setup.profile()?, lowest, highest)
    }

    /// Whether the model resists rotation: [`Compensator::turn`] then takes the angle.
    pub fn turns(&self) -> bool {
        self.setup.bare.rotation().is_some()
    }

    /// Current estimates of λ and ν.
    pub fn drift(&self) -> Drift {
        self.adapter.drift()
    }

    /// Whether the last pair of crossings indicated tissue contact.
    pub fn is_in_contact(&self) -> bool {
        self.adapter.is_in_contact()
    }

    /// The last output.
    pub fn last(&self) -> Estimate {
        self.last
    }

    /// Processes the next sample: `position` (m, positive is insertion) and reading `force` (N, with
    /// the sign that the sensor gives it), `duration` (s) after the last one.
    ///
    /// The first sample starts the observer, whatever its duration. The model is not stepped if the
    /// duration is not positive and finite or the position is not finite. The instrument does not
    /// turn.
    pub fn step(&mut self, position: f64, force: f64, duration: f64) -> Estimate {
        self.turn(position, self.angle, force, duration)
    }

    /// The same where the instrument is at `angle`, rad; a model without rotation does not heed it.
    pub fn turn(&mut self, position: f64, angle: f64, force: f64, duration: f64) -> Estimate {
        let force = if self.setup.flips { -force } else { force };
        let goes_on = duration > 0.0 && duration.is_finite();
        self.waited += if goes_on { duration } else { 0.0 };
        let elapsed = if goes_on { self.waited } else { duration };
        let radius = self.setup.bare.rotation().map_or(0.0, |rotation| rotation.shaft_radius);
        let angle = if radius > 0.0 { angle } else { 0.0 };
        let before = self.position.map(|position| [position, radius * self.angle]);
        let found = self.watch.look(before, [position, radius * angle], force, elapsed);
        match (self.position, found.motion) {
            (None, None) => self.start(position, angle, force),
            // A sample too soon after the last one is stepped together with the next.
            (Some(_), None) if self.waited < SHORTEST => {}
            (Some(before), None) => self.move_to(before, position, angle),
            (Some(before), Some(Fault::Gap)) => {
                self.move_to(before, position, angle);
                self.forget();
            }
            (Some(_), Some(Fault::Jump)) => self.rebase(position, angle),
            _ => {}
        }
        self.last = self.estimate(force, found.first());
        self.last
    }

    /// At rest with the first reading; extreme initial states in parallel bound the remaining
    /// uncertainty.
    fn start(&mut self, position: f64, angle: f64, force: f64) {
        let weight = self.inertia.weight();
        let reading = if force.is_finite() { force - self.setup.offset - weight } else { 0.0 };
        let own =
            self.setup.profile().map_or(reading, |profile| profile.without(position, reading));
        self.state = self.setup.bare.rest_at_force(0.0, own);
        self.follow();
        self.bank.start(&self.setup.bare, own);
        (self.position, self.angle) = (Some(position), angle);
        self.waited = 0.0;
        self.inertia.restart(self.time, position);
        self.forget();
    }

    /// The position was redefined; the motion in between is unknown.
    fn rebase(&mut self, position: f64, angle: f64) {
        (self.position, self.angle) = (Some(position), angle);
        self.time += std::mem::take(&mut self.waited);
        self.inertia.restart(self.time, position);
        self.forget();
    }

    /// The state is unknown until the seal has slid.
    fn forget(&mut self) {
        self.extremes = Some([-1.0, 1.0].map(|part| self.setup.bare.rest_between(0.0, part)));
        self.adapter.break_off();
        self.bank.break_off();
        self.sign.break_off();
    }

    /// Moves the model from the position `before` and the last angle within the time since it last
    /// moved.
    fn move_to(&mut self, before: f64, position: f64, angle: f64) {
        let motion = [position - before, angle - self.angle];
        let duration = std::mem::take(&mut self.waited);
        let level = self.adapter.drift().level;
        let own = motion.map(|part| part / level);
        move_by(&self.setup.bare, &mut self.state, own, duration);
        if let Some(deformation) = self.state.deformation() {
            self.has_turned = self.turns.take(deformation, self.setup.seal().half_width());
        }
        if let Some(minor) = &mut self.minor {
            move_by(&minor.model, &mut minor.state, own, duration);
        }
        self.draws.iter_mut().for_each(|draw| draw.step(own, duration));
        if let Some(extremes) = &mut self.extremes {
            extremes.iter_mut().for_each(|state| move_by(&self.setup.bare, state, own, duration));
            if spread(extremes, &self.state) * level < FORGOTTEN {
                self.extremes = None;
            }
        }
        (self.position, self.angle) = (Some(position), angle);
        self.speed = motion[0] / duration;
        self.mean_speed +=
            (1.0 - libm::exp(-duration / SPEED_TIME)) * (self.speed - self.mean_speed);
        self.time += duration;
        self.inertia.advance(self.time, position);
        self.adapter.pass(duration);
        if self.setup.adaptation {
            self.bank.advance(&self.setup.bare, motion, duration);
        }
    }

    fn estimate(&mut self, force: f64, fault: Option<Fault>) -> Estimate {
        let Some(position) = self.position else { return Estimate { fault, ..self.last } };
        let Drift { level, viscosity, level_std, viscosity_std } = self.adapter.drift();
        let along =
            |seal: f64| self.setup.profile().map_or(seal, |profile| profile.apply(position, seal));
        let slope = self.setup.profile().map_or(1.0, |profile| profile.gain(position));
        let viscous =
            level * self.setup.seal().viscous_force(self.state.seal(), self.speed / level);
        let dry = level * self.state.force() - viscous;
        let trocar_force = along(dry + viscosity * viscous);
        let trocar_torque = slope * level * self.state.torque();
        let own = force - self.setup.offset - self.inertia.force();
        let fault = self.with_sign(position, own, fault);
        let reading = if fault.is_some_and(Fault::spoils_reading) { f64::NAN } else { own };
        let spread =
            level * self.extremes.as_ref().map_or(0.0, |starts| spread(starts, &self.state));
        let sigma = self.setup.error.in_phase(self.phase()).max(LEAST_ERROR);
        let own_dry = dry / level;
        let parameters = (own_dry * level_std).powi(2)
            + (viscous * viscosity_std).powi(2)
            + 2.0 * own_dry * viscous * self.adapter.covariance();
        let doubt = self.bank.doubt(level);
        let minor = level * self.minor.as_ref().map_or(0.0, |minor| minor.std(&self.state));
        let of_model = own_dry + viscosity * viscous / level;
        let drawn = level
            * level
            * drawn::mean_square(&self.draws, of_model, viscosity, self.speed / level);
        let of_seal = parameters.max(0.0) + drawn + spread * spread + minor * minor + doubt;
        let std = (sigma * sigma + slope * slope * of_seal).sqrt();
        if self.setup.adaptation && reading.is_finite() {
            let seal =
                self.setup.profile().map_or(reading, |profile| profile.without(position, reading));
            let variance = (sigma / slope).powi(2) + minor * minor;
            self.learn(position, Sliding { reading: seal, dry: own_dry, viscous }, variance);
        }
        let tissue_force = reading - trocar_force;
        self.watch.follow(trocar_force, force);
        let adapting = self.adapter.is_adapting();
        Estimate { trocar_force, trocar_torque, tissue_force, std, adapting, fault }
    }

    /// The fault of a sample whose reading is `own`, N, when its sign is compared with the model's.
    fn with_sign(&mut self, position: f64, own: f64, fault: Option<Fault>) -> Option<Fault> {
        if fault.is_some_and(Fault::spoils_reading) || !own.is_finite() {
            return fault;
        }
        let slides = self.extremes.is_none() && self.slides();
        if slides && self.speed * self.mean_speed > 0.0 {
            let reading =
                self.setup.profile().map_or(own, |profile| profile.without(position, own));
            let now = Slid { reading, model: self.state.force() };
            self.sign.take(position, self.speed > 0.0, now);
        }
        if self.sign.is_opposite() { Some(Fault::OppositeSign) } else { fault }
    }

    fn learn(&mut self, position: f64, now: Sliding, variance: f64) {
        if let Some(inserts) = self.settled() {
            self.adapter.take(position, inserts, now);
        }
        let Drift { level: present, viscosity, .. } = self.adapter.drift();
        if self.extremes.is_none() && self.speed != 0.0 {
            self.bank.take(
                position,
                self.speed > 0.0,
                now.reading - (viscosity - 1.0) * now.viscous,
                variance,
            );
        }
        if let Some((level, state)) = self.bank.better_than(present) {
            self.state = state;
            self.follow();
            self.adapter.restart_at(level);
        }
    }

    /// Restarts the stiff law and the draws from the state of the model.
    fn follow(&mut self) {
        if let Some(minor) = &mut self.minor {
            minor.state = self.state;
        }
        let force = self.state.force();
        self.draws.iter_mut().for_each(|draw| draw.rest(force));
    }

    fn phase(&self) -> Phase {
        match (self.mean_speed.abs() < HOLD_SPEED, self.slides()) {
            (true, _) if self.has_turned => Phase::PartialHeld,
            (true, _) => Phase::Held,
            (false, false) if self.has_turned => Phase::Partial,
            (false, false) => Phase::Deforming,
            (false, true) => Phase::Sliding,
        }
    }

    /// Whether the seal slides; all motion for a model without deflection.
    fn slides(&self) -> bool {
        !matches!(self.state.deformation(), Some(Deformation { mode: Mode::Deforming, .. }))
    }

    /// Direction of a slide once it is certain.
    fn settled(&mut self) -> Option<bool> {
        let slides = self.extremes.is_none() && self.speed.abs() >= HOLD_SPEED && self.slides();
        self.adapter.settle(
            slides,
            self.speed > 0.0,
            self.position.unwrap_or(0.0),
            2.0 * self.setup.seal().half_width(),
        )
    }
}

/// The seal with the stiffest law between its branches, run in parallel with the model, whose law
/// is the softest that follows both branches exactly. After a partial reversal the force of a seal
/// may lie anywhere between the two, and full strokes do not determine where.
#[derive(Debug, Clone)]
struct MinorLoops {
    model: Trocar,
    state: TrocarState,
}

impl MinorLoops {
    /// Fraction of the half width over which the stiffest law crosses from one branch to the other:
    /// some ten encoder counts, so that their flicker does not reverse it.
    const CROSSING: f64 = 0.02;
    /// Deflections at which the gap is measured.
    const POINTS: u32 = 64;

    /// None for a seal without branches that differ.
    fn new(bare: &Trocar) -> Option<Self> {
        let stages = bare.seal().stages()?;
        let elements: Option<Vec<Element>> = stages.elements().iter().map(Self::stiff).collect();
        let elements = elements?;
        let model = bare.with_seal(Seal::Ems(Stages::new(&elements)?));
        Some(Self { model, state: model.rest_at_force(0.0, 0.0) })
    }

    /// The element with branches that are crossed within [`Self::CROSSING`].
    fn stiff(element: &Element) -> Option<Element> {
        let mut params = *element.params();
        let force = params.deformation;
        let c = force.half_width();
        let at = |k: u32| force.half_gap(c * (2.0 * f64::from(k) / f64::from(Self::POINTS) - 1.0));
        let gap = 2.0 * (0..=Self::POINTS).map(at).fold(0.0, f64::max);
        let stiffness = force.yield_stiffness().max(gap / (Self::CROSSING * c));
        params.deformation =
            DeformationForce::new(*force.insertion(), *force.withdrawal(), Some(stiffness)).ok()?;
        Element::new(params).ok()
    }

    /// Half the difference between the two laws, N: the 95 % band then reaches from one to the
    /// other.
    fn std(&self, model: &TrocarState) -> f64 {
        0.5 * (self.state.force() - model.force()).abs()
    }
}

/// State of the motion on which the error of a model depends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// The seal deforms after a full reversal.
    Deforming,
    /// The seal deforms after a partial reversal.
    Partial,
    /// The instrument slides; all motion for a model without deflection.
    Sliding,
    /// The instrument is held.
    Held,
    /// The instrument is held after a partial reversal.
    PartialHeld,
}

impl ForceError {
    /// The error in `phase`, N; if it is unknown, [`UNKNOWN`] times the largest of the others.
    fn in_phase(&self, phase: Phase) -> f64 {
        let known = match phase {
            Phase::Deforming => self.deforming_n,
            Phase::Partial => self.partial_n,
            Phase::Sliding => self.sliding_n,
            Phase::Held => self.held_n,
            // The rests of full strokes do not represent those after partial reversals.
            Phase::PartialHeld => self.partial_n.and(self.held_n),
        };
        known.unwrap_or_else(|| UNKNOWN * self.largest().unwrap_or(0.0))
    }
}

/// Moves the state of `model` by a displacement, m, and an angle, rad, within `duration`, s.
fn move_by(model: &Trocar, state: &mut TrocarState, [displacement, turn]: [f64; 2], duration: f64) {
    let angle = state.turning().map_or(0.0, Turning::angle) + turn;
    model.turn(state, displacement, angle, duration);
}

/// Half the range of the forces, N: an upper bound of the standard deviation of any force in
/// between.
fn spread(extremes: &[TrocarState; 2], state: &TrocarState) -> f64 {
    let forces = [extremes[0].force(), extremes[1].force(), state.force()];
    let (low, high) =
        forces.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), f| (l.min(*f), h.max(*f)));
    0.5 * (high - low)
}

/// Relative standard deviation from the 95 % intervals of a parameter, the larger of both
/// directions; 0 without bounds.
fn relative_std(file: &ModelFile, quantity: Quantity) -> f64 {
    let is_own = |id: ParameterId| id.quantity == quantity && id.element.is_none();
    file.intervals
        .iter()
        .filter(|(key, _)| ParameterId::named(key).is_some_and(is_own))
        .map(|(_, interval)| relative_to_value(interval))
        .fold(0.0, f64::max)
}

/// Standard deviation over the value; 0 without bounds, and for a value of 0.
fn relative_to_value(interval: &Interval) -> f64 {
    match interval.ci95 {
        [Some(low), Some(high)] if interval.value != 0.0 => {
            ((high - low) / (2.0 * NORMAL_95 * interval.value)).abs()
        }
        _ => 0.0,
    }
}

fn finite(name: &'static str, value: f64) -> Result<f64, CompensateError> {
    check(name, value, value.is_finite(), "a finite number")
}

fn not_negative(name: &'static str, value: f64) -> Result<f64, CompensateError> {
    check(name, value, value.is_finite() && value >= 0.0, "0 or more")
}

fn positive(name: &'static str, value: f64) -> Result<f64, CompensateError> {
    check(name, value, value.is_finite() && value > 0.0, "above 0")
}

fn check(
    name: &'static str,
    value: f64,
    allowed: bool,
    range: &'static str,
) -> Result<f64, CompensateError> {
    if allowed {
        Ok(value)
    } else {
        Err(CompensateError::OutOfRange { name, allowed: range, found: value })
    }
}
