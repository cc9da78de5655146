//! All tests of the library that can share one process: one program carries it, not thirty. Each
//! file here is a module; `cancel.rs` is a program of its own, because its tests measure time.
//!
//! `cargo test -p trocar --test all recover::` runs the tests of one file.

mod any_format;
mod any_length;
mod architecture;
mod bench;
mod benches;
mod compensate;
mod compensate_turning;
mod drawn;
mod dwell;
mod ensemble;
mod export_c;
mod feed_forward;
mod fleet;
mod free_motion;
mod gallery;
mod loads;
mod model_file;
mod plan;
mod posterior;
mod profile;
mod published;
mod ranges;
mod recover;
mod recover_classical;
mod replay;
mod report;
mod report_comparison;
mod report_identification;
mod report_live;
mod rotation;
mod scatter;
mod simulate;
mod table;
mod teleop;
mod teleop_figures;
#[path = "trust.rs"] // beside a folder of that name
mod trust;
mod validate;
mod values;

#[path = "../../trocar-model/tests/common/mod.rs"]
mod common;
#[path = "../../trocar-model/tests/common/skipped.rs"]
mod skipped;
