//! Functional mock-up units (FMUs): a trocar model for other simulation programs.
//!
//! One library works for every model and both versions of FMI (key FMI in SOURCES.md). It exports
//! the functions of FMI 2.0 and 3.0 for co-simulation and reads the model from the resources of its
//! FMU. [`package()`] creates the FMU. Only `variables.rs` defines its variables, both for the
//! description and for the functions of the library.
//!
//! - A step of the FMU is one step of [`trocar_model::Trocar`], with the same numbers as in all
//!   other interfaces.
//! - A rejected call changes nothing, returns an error and sends the reason to the importer's
//!   logger. No panic reaches the importer.
//! - Instances share nothing.
//!
//! For users: `docs/reference/fmu.md`.

mod embedded;
mod error;
#[allow(unsafe_code)]
mod ffi;
pub mod fmi;
pub mod fmi2;
pub mod fmi3;
mod hash;
mod instance;
pub mod library;
pub mod package;
mod resource;
mod snapshot;
mod variables;

pub use embedded::Embedded;
pub use ffi::Logger2;
pub use package::{Binary, Contents, PackageError, Platform, Source, Version, package};
pub use variables::{Input, token};
