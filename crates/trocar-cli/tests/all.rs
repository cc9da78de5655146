//! All tests of the program as one test program; each file here is a module.
//!
//! `cargo test -p trocar-cli --test all fmu::` runs the tests of one file.

mod cli;
mod compare;
mod compensate;
mod export_c;
mod files_page;
mod fleet;
mod fmu;
mod hints;
mod live;
mod live_loop;
mod live_seal;
mod live_turning;
mod messages;
mod model_file_page;
mod model_pages;
mod outputs;
mod plan;
mod ranges;
mod readme;
mod teleop;

mod common;
#[path = "../../trocar-model/tests/common/skipped.rs"]
mod skipped;
