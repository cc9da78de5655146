//! Friction models of trocar seals.
#![no_std]
#![forbid(unsafe_code)]

pub mod damping;
pub mod elastic;
pub mod ems;
pub mod error;
mod exponential;
pub mod paper_literal;
pub mod parallel;
pub mod plausible;
pub mod sliding;
mod slip;

pub use damping::SealDamping;
pub use elastic::{Branch, DeformationForce, MAX_DEGREE, Piece};
pub use ems::{Element, ElementParams, Folding, Mode, State};
pub use error::ParamError;
pub use paper_literal::{LiteralState, PaperLiteral};
pub use parallel::{Parallel, step_parallel};
pub use sliding::SlidingFriction;
