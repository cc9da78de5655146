//! Any model of this crate as one type, and with it the force of a trocar: what every program that
//! runs a model holds.

use crate::classical::{Classical, ClassicalState};
use crate::direction::Direction;
use crate::ems::{Element, Mode, State};
use crate::error::{ParamError, check_fields};
use crate::friction::{Friction, velocity};
use crate::parallel::{MAX_STAGES, Stages, StagesState};
use crate::profile::PositionProfile;
use crate::rotation::{Around, Prepared, Rotation, Turning};

/// A friction model: EMS elements in parallel, or a classical one.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(clippy::large_enum_variant)] // one a program, never moved in a loop
pub enum Seal {
    /// EMS elements in parallel.
    Ems(Stages),
    /// One of the models of EMS section II.
    Classical(Classical),
}

/// State of a [`Seal`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(clippy::large_enum_variant)] // changed in place, step by step
pub enum SealState {
    /// Of EMS elements.
    Ems(StagesState),
    /// Of a classical model.
    Classical(ClassicalState),
}

/// How a seal is deformed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deformation {
    /// Deflection, m, the mean of several elements.
    pub deflection: f64,
    /// Sliding once every element does.
    pub mode: Mode,
}

impl Seal {
    /// Kind of EMS elements; the others are in [`Classical::KINDS`].
    pub const EMS: &str = "ems";

    /// State of an undeformed seal at rest.
    pub fn rest(&self) -> SealState {
        match self {
            Self::Ems(stages) => SealState::Ems(stages.rest_state(0.0)),
            Self::Classical(model) => SealState::Classical(model.rest_at_force(0.0)),
        }
    }

    /// State at rest with every element at `deflection`, m; `None` for a classical model, which has
    /// no deflection.
    pub fn rest_at_deflection(&self, deflection: f64) -> Option<SealState> {
        self.stages().map(|stages| SealState::Ems(stages.rest_state(deflection)))
    }

    /// State at rest between the extremes, `part` from -1 to 1: every element at that part of its
    /// half width; a classical model with that part of the largest force it can hold.
    pub fn rest_between(&self, part: f64) -> SealState {
        match self {
            Self::Ems(stages) => {
                SealState::Ems(stages.rest_at(|e| part * e.params().deformation.half_width()))
            }
            Self::Classical(model) => SealState::Classical(model.rest_at_force(part * f64::MAX)),
        }
    }

    /// The EMS elements; `None` for a classical model.
    pub fn stages(&self) -> Option<&Stages> {
        match self {
            Self::Ems(stages) => Some(stages),
            Self::Classical(_) => None,
        }
    }

    /// Kind of the model, as in a model file.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Ems(_) => Self::EMS,
            Self::Classical(model) => model.kind(),
        }
    }
}

impl Seal {
    /// The part of the force that grows with the slip speed, β·v_sl, N; a classical model slips
    /// with `velocity`, m/s.
    pub fn viscous_force(&self, state: &SealState, velocity: f64) -> f64 {
        match (self, state) {
            (Self::Ems(stages), SealState::Ems(state)) => {
                let pairs = stages.elements().iter().zip(state.states());
                pairs.map(|(element, state)| element.viscous_force(state)).sum()
            }
            (Self::Classical(model), _) => model.viscous_damping() * velocity,
            _ => 0.0,
        }
    }

    /// c of the widest element, m; 0 for a classical model.
    pub fn half_width(&self) -> f64 {
        self.stages().map_or(0.0, Stages::half_width)
    }
}

impl SealState {
    /// How the seal is deformed; `None` for a classical model, which has no deflection.
    pub fn deformation(&self) -> Option<Deformation> {
        match self {
            Self::Ems(state) => Some(Deformation::of(state.states())),
            Self::Classical(_) => None,
        }
    }
}

impl Deformation {
    /// Of elements in parallel, at least one.
    pub fn of(states: &[State]) -> Self {
        let sum: f64 = states.iter().map(State::deflection).sum();
        let slides = states.iter().all(|state| state.mode() == Mode::Sliding);
        let mode = if slides { Mode::Sliding } else { Mode::Deforming };
        Self { deflection: sum / states.len() as f64, mode }
    }
}

impl From<Stages> for Seal {
    fn from(stages: Stages) -> Self {
        Self::Ems(stages)
    }
}

impl From<Element> for Seal {
    fn from(element: Element) -> Self {
        Self::Ems(element.into())
    }
}

impl From<Classical> for Seal {
    fn from(model: Classical) -> Self {
        Self::Classical(model)
    }
}

impl Friction for Seal {
    type State = SealState;

    fn rest_at_force(&self, force: f64) -> SealState {
        match self {
            Self::Ems(stages) => SealState::Ems(stages.rest_at_force(force)),
            Self::Classical(model) => SealState::Classical(model.rest_at_force(force)),
        }
    }

    fn rest_after(&self, direction: Direction, force: f64) -> SealState {
        match self {
            Self::Ems(stages) => SealState::Ems(stages.rest_after(direction, force)),
            Self::Classical(model) => SealState::Classical(model.rest_after(direction, force)),
        }
    }

    /// As for each model; the state of another model is left untouched.
    fn step(&self, state: &mut SealState, displacement: f64, duration: f64) -> f64 {
        match (self, state) {
            (Self::Ems(stages), SealState::Ems(state)) => {
                stages.step(state, displacement, duration)
            }
            (Self::Classical(model), SealState::Classical(state)) => {
                model.step(state, displacement, duration)
            }
            (_, foreign) => Self::force(foreign),
        }
    }

    fn force(state: &SealState) -> f64 {
        match state {
            SealState::Ems(state) => Stages::force(state),
            SealState::Classical(state) => Classical::force(state),
        }
    }
}

/// A trocar: its seal, and how the force depends on the position.
///
/// All programs that run a model run this step, so all give the same numbers. `K` stores the knots
/// of the profile, as in [`PositionProfile`].
///
/// ```
/// use trocar_model::{Element, ElementParams, Trocar};
///
/// # fn main() -> Result<(), trocar_model::ParamError> {
/// let trocar = Trocar::of_seal(Element::new(ElementParams::plausible_10_5_mm()?)?);
/// let mut state = trocar.rest(0.1);           // the instrument stands at 100 mm
/// let force = trocar.step(&mut state, 50e-6, 1e-3);
/// assert!(force > 0.0 && state.position() == 0.1 + 50e-6);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trocar<K = &'static [f64]> {
    seal: Seal,
    profile: Option<PositionProfile<K>>,
    rotation: Option<Prepared>,
}

/// State of a [`Trocar`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrocarState {
    pub(crate) position: f64,
    pub(crate) force: f64,
    pub(crate) seal: SealState,
    /// Where the model knows of rotation.
    pub(crate) turning: Option<Turning>,
}

impl Trocar {
    /// The trocar of `seal` alone, whose force does not depend on the position.
    pub fn of_seal(seal: impl Into<Seal>) -> Self {
        Self { seal: seal.into(), profile: None, rotation: None }
    }
}

impl<K: AsRef<[f64]>> Trocar<K> {
    /// The trocar of `seal`, with a force that depends on the position where there is a `profile`.
    pub fn new(seal: impl Into<Seal>, profile: Option<PositionProfile<K>>) -> Self {
        Self { seal: seal.into(), profile, rotation: None }
    }

    /// The same trocar, which also resists rotation of the instrument; `None` along the axis only.
    ///
    /// # Errors
    /// A number out of its range; a classical model, which knows the axis only.
    pub fn with_rotation(self, rotation: Option<Rotation>) -> Result<Self, ParamError> {
        if let Some(rotation) = rotation {
            check_fields(&rotation)?;
            if self.seal.stages().is_none() {
                return Err(ParamError::RotationOfClassical);
            }
        }
        let rotation = rotation.and_then(|own| prepared(own, &self.seal));
        Ok(Self { rotation, ..self })
    }

    /// How it resists rotation.
    pub fn rotation(&self) -> Option<&Rotation> {
        self.rotation.as_ref().map(|rotation| &rotation.own)
    }

    /// The elements around the shaft; none without rotation.
    pub fn around(&self) -> &[Around] {
        match (&self.rotation, &self.seal) {
            (Some(rotation), Seal::Ems(stages)) => {
                &rotation.around[..stages.elements().len().min(MAX_STAGES)]
            }
            _ => &[],
        }
    }

    /// The seal.
    pub fn seal(&self) -> &Seal {
        &self.seal
    }

    /// How the force depends on the position.
    pub fn profile(&self) -> Option<&PositionProfile<K>> {
        self.profile.as_ref()
    }

    /// Another seal with the same profile.
    pub fn with_seal(&self, seal: Seal) -> Self
    where
        K: Clone,
    {
        let rotation = self.rotation().and_then(|own| prepared(*own, &seal));
        Self { seal, profile: self.profile.clone(), rotation }
    }

    /// The seal with the same rotation, whose force does not depend on the position.
    pub fn without_profile(&self) -> Trocar {
        Trocar { seal: self.seal, profile: None, rotation: self.rotation }
    }

    /// The same trocar with a profile that borrows its knots from this one.
    pub fn borrowed(&self) -> Trocar<&[f64]> {
        self.stored_as(|knots| knots)
    }

    /// The same trocar, the knots of its profile stored as `store` does it.
    pub fn stored_as<'a, L>(&'a self, store: impl Fn(&'a [f64]) -> L) -> Trocar<L> {
        Trocar {
            seal: self.seal,
            profile: self.profile.as_ref().map(|profile| profile.stored_as(store)),
            rotation: self.rotation,
        }
    }

    /// An undeformed seal at rest on an instrument at `position`, m; one that is not finite counts
    /// as 0.
    pub fn rest(&self, position: f64) -> TrocarState {
        self.state(position, self.seal.rest())
    }

    /// At rest at `position` (m) with `force` (N), clamped to what the model can hold; what is not
    /// finite counts as 0.
    pub fn rest_at_force(&self, position: f64, force: f64) -> TrocarState {
        self.state(position, self.seal.rest_at_force(self.without_profile_at(position, force)))
    }

    /// At rest at `position` (m) with `force` (N) after a slide in `direction`, [`Friction::rest_after`].
    pub fn rest_after(&self, position: f64, direction: Direction, force: f64) -> TrocarState {
        let own = self.without_profile_at(position, force);
        self.state(position, self.seal.rest_after(direction, own))
    }

    fn without_profile_at(&self, position: f64, force: f64) -> f64 {
        let position = if position.is_finite() { position } else { 0.0 };
        self.profile.as_ref().map_or(force, |profile| profile.without(position, force))
    }

    /// At rest at `position` (m) with every element at `deflection`, m; `None` for a classical
    /// model.
    pub fn rest_at_deflection(&self, position: f64, deflection: f64) -> Option<TrocarState> {
        Some(self.state(position, self.seal.rest_at_deflection(deflection)?))
    }

    /// At rest at `position` (m) between the extreme states, `part` from -1 to 1; as
    /// [`Seal::rest_between`].
    pub fn rest_between(&self, position: f64, part: f64) -> TrocarState {
        self.state(position, self.seal.rest_between(part))
    }

    fn state(&self, position: f64, seal: SealState) -> TrocarState {
        let position = if position.is_finite() { position } else { 0.0 };
        let turning = self.rotation.map(|_| Turning::rest(0.0));
        TrocarState { position, force: self.force_at(position, &seal), seal, turning }
    }

    fn force_at(&self, position: f64, seal: &SealState) -> f64 {
        let own = Seal::force(seal);
        self.profile.as_ref().map_or(own, |profile| profile.apply(position, own))
    }

    /// Advances by `displacement` (m) within `duration` (s) at constant velocity; returns the force
    /// (N) at the end, that of the instrument on the seal.
    ///
    /// A duration that is not positive, or a displacement, duration or velocity that is not finite,
    /// leaves the state untouched and returns the last force.
    pub fn step(&self, state: &mut TrocarState, displacement: f64, duration: f64) -> f64 {
        self.advance(state, (state.position + displacement, displacement), None, duration)
    }

    /// Advances to `position` (m) within `duration` (s) at constant velocity; as [`Trocar::step`].
    pub fn step_to(&self, state: &mut TrocarState, position: f64, duration: f64) -> f64 {
        self.advance(state, (position, position - state.position), None, duration)
    }

    /// Advances to `position` (m) and turns to `angle` (rad) within `duration` (s), both at constant
    /// velocity; as [`Trocar::step_to`]. A model without rotation does not heed the angle.
    ///
    /// ```
    /// use trocar_model::{Element, ElementParams, Rotation, Trocar};
    ///
    /// # fn main() -> Result<(), trocar_model::ParamError> {
    /// let rotation = Rotation { shaft_radius: 5e-3, circumferential_stiffness: 425.0, circumferential_ratio: 1.0 };
    /// let seal = Element::new(ElementParams::plausible_10_5_mm()?)?;
    /// let trocar = Trocar::of_seal(seal).with_rotation(Some(rotation))?;
    /// let mut state = trocar.rest(0.0);
    /// for k in 1..=1000 {
    ///     let time = 1e-3 * f64::from(k);
    ///     trocar.turn_to(&mut state, 0.02 * time, core::f64::consts::TAU * time, 1e-3);
    /// }
    /// assert!(state.force() < 0.6 * 3.0); // at 20 mm/s and one turn a second
    /// assert!(state.torque() > 0.8 * 3.0 * 5e-3);
    /// # Ok(())
    /// # }
    /// ```
    pub fn turn_to(
        &self,
        state: &mut TrocarState,
        position: f64,
        angle: f64,
        duration: f64,
    ) -> f64 {
        self.advance(state, (position, position - state.position), Some(angle), duration)
    }

    /// As [`Trocar::step`], and turns to `angle` (rad); as [`Trocar::turn_to`].
    pub fn turn(
        &self,
        state: &mut TrocarState,
        displacement: f64,
        angle: f64,
        duration: f64,
    ) -> f64 {
        self.advance(state, (state.position + displacement, displacement), Some(angle), duration)
    }

    fn advance(
        &self,
        state: &mut TrocarState,
        (position, displacement): (f64, f64),
        angle: Option<f64>,
        duration: f64,
    ) -> f64 {
        if self.rotation.is_some() {
            return self.advance_turning(state, (position, displacement), angle, duration);
        }
        if position.is_finite() && velocity(displacement, duration).is_some() {
            self.seal.step(&mut state.seal, displacement, duration);
            state.position = position;
            state.force = self.force_at(position, &state.seal);
        }
        state.force
    }

    fn advance_turning(
        &self,
        state: &mut TrocarState,
        (position, displacement): (f64, f64),
        angle: Option<f64>,
        duration: f64,
    ) -> f64 {
        let (Some(rotation), Some(turning)) = (&self.rotation, &mut state.turning) else {
            return state.force;
        };
        let (Seal::Ems(stages), SealState::Ems(seal)) = (&self.seal, &mut state.seal) else {
            return state.force;
        };
        let angle = angle.unwrap_or(turning.angle);
        if !position.is_finite() {
            return state.force;
        }
        let (seal, around) = (seal, &mut *turning);
        if let Some(force) =
            stages.step_turning(rotation, (seal, around), displacement, angle, duration)
        {
            let gain = self.profile.as_ref().map_or(1.0, |profile| profile.gain(position));
            turning.torque = rotation.own.shaft_radius * gain * force;
            state.position = position;
            state.force = self.force_at(position, &state.seal);
        }
        state.force
    }

    /// Advances at constant `velocity` (m/s) for `duration` (s); as [`Trocar::step`].
    pub fn step_velocity(&self, state: &mut TrocarState, velocity: f64, duration: f64) -> f64 {
        self.step(state, velocity * duration, duration)
    }
}

/// `rotation` of `seal`, where that is one that turns.
fn prepared(own: Rotation, seal: &Seal) -> Option<Prepared> {
    Some(Prepared { own, around: own.around(seal.stages()?) })
}

impl TrocarState {
    /// Where the instrument is, m.
    pub fn position(&self) -> f64 {
        self.position
    }

    /// Force after the last step, N: that of the instrument on the seal.
    pub fn force(&self) -> f64 {
        self.force
    }

    /// Torque after the last step, N·m: that of the instrument on the seal, positive with the angle;
    /// 0 without rotation in the model.
    pub fn torque(&self) -> f64 {
        self.turning.map_or(0.0, |turning| turning.torque)
    }

    /// The same state where the instrument stands at `angle`, rad; one that is not finite counts as 0.
    #[must_use]
    pub fn with_angle(mut self, angle: f64) -> Self {
        if let Some(turning) = &mut self.turning {
            turning.angle = if angle.is_finite() { angle } else { 0.0 };
        }
        self
    }

    /// State around the shaft; `None` without rotation in the model.
    pub fn turning(&self) -> Option<&Turning> {
        self.turning.as_ref()
    }

    /// State of the seal.
    pub fn seal(&self) -> &SealState {
        &self.seal
    }

    /// How the seal is deformed; `None` for a classical model.
    pub fn deformation(&self) -> Option<Deformation> {
        self.seal.deformation()
    }
}
