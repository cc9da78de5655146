//! One instance of an FMU, independent of the version of FMI: phases, variables, steps, states.

use std::path::Path;

use trocar_model::{Deformation, Mode, Trocar, TrocarState, Turning};

use crate::error::{FmuError, Phase};
use crate::resource::Resource;
use crate::snapshot::Snapshot;
use crate::variables::{Input, Role, Variable, identity, token, variables};

/// Largest difference between communication points that counts as rounding, relative to the time.
const TIME_TOLERANCE: f64 = 1e-9;
/// The same relative to a step.
const STEP_TOLERANCE: f64 = 1e-6;
/// Largest difference between the requested and the actual initial force or deflection, relative to
/// it.
const START_TOLERANCE: f64 = 1e-6;

/// An instance.
#[derive(Debug, Clone)]
pub(crate) struct Instance {
    table: Vec<Variable>,
    /// As exported.
    base: Trocar<Vec<f64>>,
    input: Input,
    identity: u128,
    /// With the parameters of `applied`.
    trocar: Trocar<Vec<f64>>,
    applied: Vec<f64>,
    live: Snapshot,
}

/// A remark for the importer after a successful call.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Remark {
    /// Name of the variable.
    pub(crate) name: &'static str,
    /// The requested value.
    pub(crate) asked: f64,
    /// The value that the seal can hold.
    pub(crate) given: f64,
}

impl std::fmt::Display for Remark {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { name, asked, given } = self;
        write!(f, "{name} = {asked} is more than the seal can hold, it begins with {given}")
    }
}

/// A type of variables in a version of FMI.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Type {
    /// In messages.
    pub(crate) name: &'static str,
    /// Whether the mode is of it; all other variables are numbers.
    pub(crate) is_mode: bool,
}

impl Instance {
    /// Reads the instance from the resources folder; `wanted` is the GUID or token in the
    /// description.
    ///
    /// # Errors
    /// [`FmuError`] for missing or corrupted resources or the token of another FMU.
    pub(crate) fn new(resources: &Path, wanted: &str) -> Result<Self, FmuError> {
        Self::from_resource(Resource::read(resources)?, wanted)
    }

    pub(crate) fn from_resource(resource: Resource, wanted: &str) -> Result<Self, FmuError> {
        let Resource { row, trocar } = resource;
        let input = Input::ALL.into_iter().find(|input| token(&row, *input) == wanted);
        let input = input.ok_or_else(|| {
            FmuError::refused(format!(
                "GUID or token {wanted} is not that of the model in the resources: description and resources belong to different FMUs"
            ))
        })?;
        let applied: Vec<f64> = trocar.seal().tunables().map(|tunable| tunable.value).collect();
        let live = Snapshot::new(identity(&row, input), applied.clone(), trocar.rest(0.0));
        Ok(Self {
            table: variables(&trocar, input),
            base: trocar.clone(),
            input,
            identity: live.identity,
            trocar,
            applied,
            live,
        })
    }

    /// Time of the simulation, s.
    pub(crate) fn time(&self) -> f64 {
        self.live.time
    }

    fn expect(&self, phase: Phase) -> Result<(), FmuError> {
        let now = self.live.phase;
        match now == phase {
            true => Ok(()),
            false => Err(FmuError::refused(format!("not allowed now: the FMU is {now}"))),
        }
    }

    /// Sets start and stop time, s.
    ///
    /// # Errors
    /// [`FmuError`] in another phase than [`Phase::Instantiated`], or for times that are not finite
    /// or not increasing.
    pub(crate) fn set_time(&mut self, start: f64, stop: Option<f64>) -> Result<(), FmuError> {
        self.expect(Phase::Instantiated)?;
        for (name, value) in [("start time", Some(start)), ("stop time", stop)] {
            if let Some(value) = value.filter(|value| !value.is_finite()) {
                return Err(FmuError::not_finite(name, value));
            }
        }
        if let Some(stop) = stop.filter(|stop| *stop <= start) {
            return Err(FmuError::refused(format!(
                "stop time must be above the start time {start} s, got {stop} s"
            )));
        }
        (self.live.time, self.live.stop) = (start, stop);
        Ok(())
    }

    /// Enters initialization mode.
    ///
    /// # Errors
    /// [`FmuError`] in another phase than [`Phase::Instantiated`].
    pub(crate) fn enter_initialization(&mut self) -> Result<(), FmuError> {
        self.expect(Phase::Instantiated)?;
        self.live.phase = Phase::Initialization;
        Ok(())
    }

    /// Leaves initialization mode: the seal is at rest with the values that were set.
    ///
    /// # Errors
    /// [`FmuError`] in another phase than [`Phase::Initialization`], for inconsistent parameters or
    /// two initial conditions at once.
    pub(crate) fn exit_initialization(&mut self) -> Result<Option<Remark>, FmuError> {
        self.expect(Phase::Initialization)?;
        self.settle()?;
        self.live.phase = Phase::Step;
        let Snapshot { initial_force, initial_deflection, .. } = self.live;
        let deflection =
            self.live.state.deformation().map_or(0.0, |deformation| deformation.deflection);
        let starts = [
            ("initial_force_n", initial_force, self.live.state.force()),
            ("initial_deflection_m", initial_deflection, deflection),
        ];
        let off = starts.into_iter().find(|(_, asked, given)| {
            *asked != 0.0 && (given - asked).abs() > START_TOLERANCE * asked.abs()
        });
        Ok(off.map(|(name, asked, given)| Remark { name, asked, given }))
    }

    /// Ends the simulation.
    ///
    /// # Errors
    /// [`FmuError`] in another phase than [`Phase::Step`].
    pub(crate) fn terminate(&mut self) -> Result<(), FmuError> {
        self.expect(Phase::Step)?;
        self.live.phase = Phase::Terminated;
        Ok(())
    }

    /// Returns to instantiation, with all values as exported.
    pub(crate) fn reset(&mut self) {
        let values: Vec<f64> = self.base.seal().tunables().map(|tunable| tunable.value).collect();
        self.trocar = self.base.clone();
        self.applied.clone_from(&values);
        self.live = Snapshot::new(self.identity, values, self.base.rest(0.0));
    }

    /// Applies new parameters and, before the first step, the state at rest.
    fn settle(&mut self) -> Result<(), FmuError> {
        if self.live.tunables != self.applied {
            match self.base.seal().tuned(&self.live.tunables) {
                Ok(seal) => self.trocar = self.base.with_seal(seal),
                Err(error) => {
                    self.live.tunables.clone_from(&self.applied);
                    return Err(error.into());
                }
            }
            self.applied.clone_from(&self.live.tunables);
        }
        if matches!(self.live.phase, Phase::Instantiated | Phase::Initialization) {
            self.live.state = self.rest()?;
        }
        Ok(())
    }

    fn rest(&self) -> Result<TrocarState, FmuError> {
        let Snapshot { initial_force: force, initial_deflection: deflection, .. } = self.live;
        let position = match self.input {
            Input::Position => self.live.input,
            Input::Velocity => self.live.initial_position,
        };
        let angle = if self.input == Input::Position { self.live.turn } else { 0.0 };
        if force != 0.0 && deflection != 0.0 {
            return Err(FmuError::refused(format!(
                "initial_force_n = {force} N and initial_deflection_m = {deflection} m: at most one may differ from 0"
            )));
        }
        if force != 0.0 {
            return Ok(self.trocar.rest_at_force(position, force).with_angle(angle));
        }
        let rest = self.trocar.rest_at_deflection(position, deflection);
        Ok(rest.unwrap_or_else(|| self.trocar.rest(position)).with_angle(angle))
    }

    /// Advances from `point` by `duration`, s.
    ///
    /// # Errors
    /// [`FmuError`] in another phase than [`Phase::Step`]; for a step without positive length, from
    /// another time than the present one or beyond the stop time; for a displacement or speed that
    /// is not finite; for inconsistent parameters. The state is then unchanged.
    pub(crate) fn step(&mut self, point: f64, duration: f64) -> Result<(), FmuError> {
        self.expect(Phase::Step)?;
        if !(duration > 0.0 && duration.is_finite()) {
            return Err(FmuError::refused(format!(
                "step size must be positive and finite, got {duration} s"
            )));
        }
        let (expected, tolerance) =
            (self.live.time, STEP_TOLERANCE * duration + TIME_TOLERANCE * point.abs());
        let is_here = (point - expected).abs() <= tolerance && point.is_finite();
        if !is_here {
            return Err(FmuError::refused(format!(
                "communication point must be {expected} s, where the last step ended, got {point} s"
            )));
        }
        let to = point + duration;
        if let Some(stop) = self.live.stop.filter(|stop| to > stop + tolerance) {
            return Err(FmuError::refused(format!(
                "step ends at {to} s, beyond the stop time {stop} s"
            )));
        }
        self.settle()?;
        let Snapshot { ref mut state, input, turn, .. } = self.live;
        let from = state.turning().map_or(0.0, Turning::angle);
        let (goal, angle) = match self.input {
            Input::Position => {
                self.trocar.turn_to(state, input, turn, duration);
                (input, turn)
            }
            Input::Velocity => {
                let goal = (state.position() + input * duration, from + turn * duration);
                self.trocar.turn(state, input * duration, goal.1, duration);
                goal
            }
        };
        // The model leaves its state unchanged if it cannot step.
        let is_turned = state.turning().is_none_or(|turning| turning.angle() == angle);
        let not_followed = [(state.position() == goal, input), (is_turned, turn)];
        if let Some((_, input)) = not_followed.iter().find(|(is_followed, _)| !is_followed) {
            return Err(FmuError::refused(format!(
                "input {input} within {duration} s gives a displacement or velocity that is not finite"
            )));
        }
        self.live.time = to;
        Ok(())
    }

    fn variable(&self, reference: u32, kind: Type) -> Result<&Variable, FmuError> {
        let place =
            self.table.binary_search_by_key(&reference, |variable| variable.role.reference());
        let found = place.ok().and_then(|place| self.table.get(place));
        let found = found.filter(|variable| (variable.role == Role::Mode) == kind.is_mode);
        found.ok_or_else(|| FmuError::unknown(reference, kind.name))
    }

    fn deformation(&self) -> Option<Deformation> {
        self.live.state.deformation()
    }

    fn value(&self, role: Role) -> f64 {
        match role {
            Role::Time => self.live.time,
            Role::Input(_) => self.live.input,
            Role::Force => self.live.state.force(),
            Role::Deflection => {
                self.deformation().map_or(0.0, |deformation| deformation.deflection)
            }
            Role::Mode => match self.deformation().map(|deformation| deformation.mode) {
                Some(Mode::Sliding) => 2.0,
                _ => 1.0,
            },
            Role::Position => self.live.state.position(),
            Role::InitialForce => self.live.initial_force,
            Role::InitialDeflection => self.live.initial_deflection,
            Role::InitialPosition => self.live.initial_position,
            Role::Turn => self.live.turn,
            Role::Torque => self.live.state.torque(),
            Role::Tunable(place) => self.live.tunables.get(place).copied().unwrap_or(0.0),
        }
    }

    /// Values of variables, passed to `put` one by one; the mode is 1 deforming, 2 sliding.
    ///
    /// # Errors
    /// [`FmuError`] for an unknown variable, or parameters that cannot take effect.
    pub(crate) fn get(
        &mut self,
        references: &[u32],
        kind: Type,
        mut put: impl FnMut(usize, f64),
    ) -> Result<(), FmuError> {
        references.iter().try_for_each(|reference| self.variable(*reference, kind).map(drop))?;
        self.settle()?;
        for (place, reference) in references.iter().enumerate() {
            put(place, self.value(self.variable(*reference, kind)?.role));
        }
        Ok(())
    }

    /// Sets all given variables or none. New parameters take effect together at the next step,
    /// read access or state access.
    ///
    /// # Errors
    /// [`FmuError`] for an unknown variable, one that cannot be set (at present), or a value out of
    /// its range.
    pub(crate) fn set(
        &mut self,
        references: &[u32],
        values: impl Iterator<Item = f64> + Clone,
        kind: Type,
    ) -> Result<(), FmuError> {
        for (reference, value) in references.iter().zip(values.clone()) {
            self.check(self.variable(*reference, kind)?, value)?;
        }
        for (reference, value) in references.iter().zip(values) {
            let role = self.variable(*reference, kind)?.role;
            self.put(role, value);
        }
        Ok(())
    }

    fn check(&self, variable: &Variable, value: f64) -> Result<(), FmuError> {
        let phase = self.live.phase;
        let name = &variable.name;
        let is_before = matches!(phase, Phase::Instantiated | Phase::Initialization);
        let is_open = match variable.role {
            Role::Input(_) | Role::Turn | Role::Tunable(_) => is_before || phase == Phase::Step,
            Role::InitialForce | Role::InitialDeflection | Role::InitialPosition => is_before,
            Role::Time
            | Role::Force
            | Role::Torque
            | Role::Deflection
            | Role::Mode
            | Role::Position => {
                return Err(FmuError::refused(format!("{name} cannot be set")));
            }
        };
        if !is_open {
            return Err(FmuError::refused(format!(
                "{name} cannot be set while the FMU is {phase}"
            )));
        }
        if !value.is_finite() {
            return Err(FmuError::not_finite(name, value));
        }
        match variable.least {
            Some((least, above)) if value < least || (above && value == least) => {
                let wanted = if above { "above" } else { "at least" };
                Err(FmuError::refused(format!(
                    "{name} must be {wanted} {least}, got {value}; the old value stays"
                )))
            }
            _ => Ok(()),
        }
    }

    fn put(&mut self, role: Role, value: f64) {
        let live = &mut self.live;
        match role {
            Role::Input(_) => live.input = value,
            Role::Turn => live.turn = value,
            Role::InitialForce => live.initial_force = value,
            Role::InitialDeflection => live.initial_deflection = value,
            Role::InitialPosition => live.initial_position = value,
            Role::Tunable(place) => {
                live.tunables.iter_mut().skip(place).take(1).for_each(|slot| *slot = value)
            }
            Role::Time
            | Role::Force
            | Role::Torque
            | Role::Deflection
            | Role::Mode
            | Role::Position => {}
        }
    }

    /// A snapshot of everything that [`Instance::set_state`] restores.
    ///
    /// # Errors
    /// [`FmuError`] if the parameters set before are inconsistent, or both starts are set.
    pub(crate) fn state(&mut self) -> Result<Snapshot, FmuError> {
        self.settle()?;
        Ok(self.live.clone())
    }

    /// Restores `snapshot`.
    ///
    /// # Errors
    /// [`FmuError`] for a state of another model, or for inconsistent parameters.
    pub(crate) fn set_state(&mut self, snapshot: &Snapshot) -> Result<(), FmuError> {
        if snapshot.identity != self.identity {
            return Err(FmuError::state_foreign());
        }
        self.trocar = self.base.with_seal(self.base.seal().tuned(&snapshot.tunables)?);
        self.applied.clone_from(&snapshot.tunables);
        self.live.clone_from(snapshot);
        Ok(())
    }

    /// Size of a serialized state in bytes.
    pub(crate) fn state_length(&self) -> usize {
        Snapshot::length(self.applied.len())
    }

    /// A state from its bytes.
    ///
    /// # Errors
    /// [`FmuError`] for a wrong length, another model or damaged bytes.
    pub(crate) fn read_state(&self, bytes: &[u8]) -> Result<Snapshot, FmuError> {
        Snapshot::from_bytes(bytes, self.identity, self.applied.len(), |values| {
            self.base.seal().tuned(values).map(|seal| self.base.with_seal(seal))
        })
    }
}
