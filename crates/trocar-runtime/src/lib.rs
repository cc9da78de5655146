//! Identified trocar models in a program that runs them: [`model_file`] reads and writes
//! `model.json`, [`compensate`] takes the trocar's force out of a force sensor's readings in real
//! time.
//!
//! Few dependencies on purpose: what identifies, records and draws is in the crate `trocar`, which
//! exports these modules again. Recipes: `docs/how-to/compensation.md`, `docs/how-to/wet-seal.md`.

pub mod compensate;
pub mod model_file;
pub mod profile;
