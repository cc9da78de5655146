//! From recordings of an instrument in a trocar to a validated model of the force between them.
//!
//! The book in the folder `docs` of the repository has tutorials and recipes (`docs/start/test-bench.md` to
//! begin with), the equations of all models, and how far the results can be trusted.

pub mod analyze;
pub mod compensate;
pub mod export;
pub mod inspect;
pub mod survey;

pub use trocar_identify as identify;
pub use trocar_lab::{compare, draws, fleet, margin, motion, summary, validate, workflow};
#[cfg(feature = "bench")]
pub use trocar_lab::{plan, teleop};
/// Reading of recordings.
pub use trocar_recording as recording;
pub use trocar_recording::cancel;
#[cfg(feature = "report")]
pub use trocar_report as report;
pub use trocar_runtime::model_file;
#[cfg(feature = "bench")]
pub use trocar_simulate::bench;
pub use trocar_simulate::profile;
pub use trocar_simulate::{many, replay, scatter, segment, simulate};
pub use trocar_tables::{option, output, table};

/// Errors of all code that reads or writes files: what failed, where, what was found, what was
/// expected, and a remedy on a `hint:` line.
pub mod error {
    pub use trocar_recording::{Location, RecordingError};
    pub use trocar_tables::error::{OutputError, TableError};
}

/// Compiles and runs the Rust code of the README and of the book.
#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
#[doc = include_str!("../../../docs/how-to/compensation.md")]
#[doc = include_str!("../../../docs/reference/rust.md")]
pub(crate) struct Readme;
