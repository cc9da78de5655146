//! All tests of the models as one program; each file here is a module.
//!
//! `cargo test -p trocar-model --test all slow::` runs the tests of one file.

mod accuracy;
mod backlash;
mod batch;
mod beside;
mod classical;
mod dwell;
mod energy;
mod maxwell;
mod promise;
mod propositions;
mod reference;
mod reference_vectors;
mod rotation;
mod run;
mod seal;
mod slow;
mod vectors;
mod vectors_maxwell;

mod common;
#[path = "common/shared.rs"]
mod shared;
#[path = "common/skipped.rs"]
mod skipped;
