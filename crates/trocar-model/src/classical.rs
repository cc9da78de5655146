//! The friction models of EMS section II as one type, for whoever has to run any of them.

use crate::error::ParamError;
use crate::friction::Friction;
use crate::law::{self, Law, Visit};
use crate::row::{FlatError, Numbers, Reader, Row};

mod bouc_wen;
mod chord;
mod dahl;
mod gms;
mod leuven;
mod lugre;
mod maxwell_slip;
mod stribeck;

/// Declares the models, each with its kind in files. The order is that of the numbers of the kinds
/// in rows: a new model is added at the end.
macro_rules! models {
    ($($(#[$doc:meta])* $name:ident($module:ident::$law:ident) = $kind:literal;)*) => {
        $(pub use self::$module::*;)*

        /// Any of the models that EMS compares itself with.
        #[derive(Debug, Clone, Copy, PartialEq)]
        #[allow(clippy::large_enum_variant)] // few, and never moved in a loop
        pub enum Classical {
            $($(#[$doc])* $name($law),)*
        }

        /// State of a [`Classical`] model.
        #[derive(Debug, Clone, Copy, PartialEq)]
        #[allow(clippy::large_enum_variant)] // changed in place, step by step
        pub enum ClassicalState {
            $(#[doc = concat!("Of [`Classical::", stringify!($name), "`].")]
            $name(<$law as Friction>::State),)*
        }

        /// Numbers of the kinds in rows.
        #[repr(u8)]
        enum Tag {
            #[allow(dead_code)] // 0: EMS elements
            Ems,
            $($name,)*
        }

        impl Classical {
            /// All kinds.
            pub const KINDS: &[&str] = &[$($kind),*];

            /// Kind of the model, as in a model file.
            pub fn kind(&self) -> &'static str {
                match self {
                    $(Self::$name(_) => $kind,)*
                }
            }

            /// Number of its kind in rows: its place in [`Classical::KINDS`], from 1.
            pub(crate) fn tag(&self) -> f64 {
                match self {
                    $(Self::$name(_) => f64::from(Tag::$name as u8),)*
                }
            }

            /// β, N·s/m: force that grows with the velocity, over the velocity.
            pub fn viscous_damping(&self) -> f64 {
                match self {
                    $(Self::$name(model) => Law::viscous_damping(model),)*
                }
            }

            /// Shows the visitor every member of the model.
            ///
            /// # Errors
            /// Of the visitor.
            pub fn visit<V: Visit>(&self, visitor: &mut V) -> Result<(), V::Error> {
                match self {
                    $(Self::$name(model) => law::visit(model, visitor),)*
                }
            }

            /// The model of this kind whose members the visitor gives; `None` for another kind than
            /// those of [`Classical::KINDS`].
            ///
            /// # Errors
            /// Of the visitor, and for a value out of its range.
            pub fn build<V: Visit>(kind: &str, visitor: &mut V) -> Option<Result<Self, V::Error>>
            where
                V::Error: From<ParamError>,
            {
                match kind {
                    $($kind => Some(law::build(visitor).map(Self::$name)),)*
                    _ => None,
                }
            }

            /// The model with the members that the visitor changes.
            pub(crate) fn change<V: Visit>(&self, visitor: &mut V) -> Result<Self, V::Error>
            where
                V::Error: From<ParamError>,
            {
                Ok(match self {
                    $(Self::$name(model) => Self::$name(law::change(model, visitor)?),)*
                })
            }
        }

        impl Friction for Classical {
            type State = ClassicalState;

            fn rest_at_force(&self, force: f64) -> ClassicalState {
                match self {
                    $(Self::$name(model) => ClassicalState::$name(model.rest_at_force(force)),)*
                }
            }

            /// As for each model; the state of another model is left untouched.
            fn step(&self, state: &mut ClassicalState, displacement: f64, duration: f64) -> f64 {
                match (self, state) {
                    $((Self::$name(model), ClassicalState::$name(state)) => {
                        model.step(state, displacement, duration)
                    })*
                    (_, foreign) => Self::force(foreign),
                }
            }

            fn force(state: &ClassicalState) -> f64 {
                match state {
                    $(ClassicalState::$name(state) => <$law as Friction>::force(state),)*
                }
            }
        }

        impl Row for ClassicalState {
            fn see(&self, see: &mut impl FnMut(f64)) {
                match self {
                    $(Self::$name(state) => {
                        see(f64::from(Tag::$name as u8));
                        state.see(see);
                    })*
                }
            }

            fn set(&mut self, from: &mut Reader<impl Numbers>) -> Result<(), FlatError> {
                match self {
                    $(Self::$name(state) => {
                        from.expect(f64::from(Tag::$name as u8))?;
                        state.set(from)
                    })*
                }
            }
        }
    };
}

models! {
    /// Coulomb, Coulomb and viscous, or Stribeck.
    Static(stribeck::StaticFriction) = "static";
    /// Dahl.
    Dahl(dahl::Dahl) = "dahl";
    /// LuGre.
    LuGre(lugre::LuGre) = "lugre";
    /// Modified Leuven.
    Leuven(leuven::Leuven) = "leuven";
    /// Maxwell-Slip, EMS (1)-(4).
    MaxwellSlip(maxwell_slip::MaxwellSlip) = "maxwell-slip";
    /// Generalized Maxwell-Slip, EMS (5)-(7).
    Gms(gms::Gms) = "gms";
    /// Bouc–Wen.
    BoucWen(bouc_wen::BoucWen) = "bouc-wen";
}
