//! The friction models of EMS section II as one type, for whoever has to run any of them.

use crate::friction::Friction;
use crate::{Dahl, Gms, Leuven, LuGre, MaxwellSlip, StaticFriction};

/// Any of the models that EMS compares itself with.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(clippy::large_enum_variant)] // few, and never moved in a loop
pub enum Classical {
    /// Coulomb, Coulomb and viscous, or Stribeck.
    Static(StaticFriction),
    /// Dahl.
    Dahl(Dahl),
    /// LuGre.
    LuGre(LuGre),
    /// Modified Leuven.
    Leuven(Leuven),
    /// Maxwell-Slip, EMS (1)-(4).
    MaxwellSlip(MaxwellSlip),
    /// Generalized Maxwell-Slip, EMS (5)-(7).
    Gms(Gms),
}

impl Classical {
    /// Kind of Coulomb's, viscous and Stribeck's friction.
    pub const STATIC: &str = "static";
    /// Kind of Dahl's model.
    pub const DAHL: &str = "dahl";
    /// Kind of the LuGre model.
    pub const LUGRE: &str = "lugre";
    /// Kind of the modified Leuven model.
    pub const LEUVEN: &str = "leuven";
    /// Kind of the Maxwell-Slip model.
    pub const MAXWELL_SLIP: &str = "maxwell-slip";
    /// Kind of the Generalized Maxwell-Slip model.
    pub const GMS: &str = "gms";
    /// All kinds.
    pub const KINDS: [&str; 6] =
        [Self::STATIC, Self::DAHL, Self::LUGRE, Self::LEUVEN, Self::MAXWELL_SLIP, Self::GMS];

    /// β, N·s/m: force that grows with the velocity, over the velocity.
    pub fn viscous_damping(&self) -> f64 {
        match self {
            Self::Static(model) => model.params().viscous_damping,
            Self::Dahl(model) => model.params().viscous_damping,
            Self::LuGre(model) => model.params().sliding.viscous_damping,
            Self::Leuven(model) => model.params().sliding.viscous_damping,
            Self::MaxwellSlip(model) => model.viscous_damping(),
            Self::Gms(model) => model.sliding().viscous_damping,
        }
    }

    /// Kind of the model, as in a model file.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Static(_) => Self::STATIC,
            Self::Dahl(_) => Self::DAHL,
            Self::LuGre(_) => Self::LUGRE,
            Self::Leuven(_) => Self::LEUVEN,
            Self::MaxwellSlip(_) => Self::MAXWELL_SLIP,
            Self::Gms(_) => Self::GMS,
        }
    }
}

/// State of a [`Classical`] model.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(clippy::large_enum_variant)] // changed in place, step by step
pub enum ClassicalState {
    /// Of a static model.
    Static(<StaticFriction as Friction>::State),
    /// Of a Dahl model.
    Dahl(<Dahl as Friction>::State),
    /// Of a LuGre model.
    LuGre(<LuGre as Friction>::State),
    /// Of a Leuven model.
    Leuven(<Leuven as Friction>::State),
    /// Of a Maxwell-Slip model.
    MaxwellSlip(<MaxwellSlip as Friction>::State),
    /// Of a Generalized Maxwell-Slip model.
    Gms(<Gms as Friction>::State),
}

impl Friction for Classical {
    type State = ClassicalState;

    fn rest_at_force(&self, force: f64) -> ClassicalState {
        match self {
            Self::Static(model) => ClassicalState::Static(model.rest_at_force(force)),
            Self::Dahl(model) => ClassicalState::Dahl(model.rest_at_force(force)),
            Self::LuGre(model) => ClassicalState::LuGre(model.rest_at_force(force)),
            Self::Leuven(model) => ClassicalState::Leuven(model.rest_at_force(force)),
            Self::MaxwellSlip(model) => ClassicalState::MaxwellSlip(model.rest_at_force(force)),
            Self::Gms(model) => ClassicalState::Gms(model.rest_at_force(force)),
        }
    }

    /// As for each model; the state of another model is left untouched.
    fn step(&self, state: &mut ClassicalState, displacement: f64, duration: f64) -> f64 {
        match (self, state) {
            (Self::Static(model), ClassicalState::Static(state)) => {
                model.step(state, displacement, duration)
            }
            (Self::Dahl(model), ClassicalState::Dahl(state)) => {
                model.step(state, displacement, duration)
            }
            (Self::LuGre(model), ClassicalState::LuGre(state)) => {
                model.step(state, displacement, duration)
            }
            (Self::Leuven(model), ClassicalState::Leuven(state)) => {
                model.step(state, displacement, duration)
            }
            (Self::MaxwellSlip(model), ClassicalState::MaxwellSlip(state)) => {
                model.step(state, displacement, duration)
            }
            (Self::Gms(model), ClassicalState::Gms(state)) => {
                model.step(state, displacement, duration)
            }
            (_, foreign) => Self::force(foreign),
        }
    }

    fn force(state: &ClassicalState) -> f64 {
        match state {
            ClassicalState::Static(state) => StaticFriction::force(state),
            ClassicalState::Dahl(state) => <Dahl as Friction>::force(state),
            ClassicalState::LuGre(state) => <LuGre as Friction>::force(state),
            ClassicalState::Leuven(state) => <Leuven as Friction>::force(state),
            ClassicalState::MaxwellSlip(state) => <MaxwellSlip as Friction>::force(state),
            ClassicalState::Gms(state) => <Gms as Friction>::force(state),
        }
    }
}
