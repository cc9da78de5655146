//! Functional mock-up units (FMUs): a trocar model for other simulation programs.
//!
//! One library serves every model and both versions of FMI (key FMI in SOURCES.md): it exports the functions of FMI 2.0
//! and 3.0 for co-simulation and reads the model from the resources of the FMU it lies in. [`package()`] makes the FMU.
//! What its variables are stands in [`mod@variables`] alone, from which the description is written and by which the library
//! answers.
//!
//! - A step of the FMU is one step of [`trocar_model::Trocar`]: the same numbers as every other program that runs it.
//! - A refused call changes nothing, returns an error and tells the importer's logger why. No call panics into the
//!   importer.
//! - Instances share nothing.

pub mod error;
#[allow(unsafe_code)]
mod ffi;
pub mod fmi2;
pub mod fmi3;
mod hash;
pub mod instance;
pub mod package;
mod resource;
pub mod snapshot;
pub mod variables;

pub use error::{FmuError, Phase};
pub use ffi::{Logger2, Logger3};
pub use instance::Instance;
pub use package::{Binary, Contents, Platform, Version, package};
pub use variables::{Input, Role, Variable, token, variables};
