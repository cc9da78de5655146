//! From recordings of an instrument in a trocar to a validated model of the force between them.
//!
//! The book in the folder `docs` of the repository has tutorials and recipes (`docs/start/test-bench.md` to
//! begin with), the equations of all models, and how far the results can be trusted.

pub mod analyze;
#[cfg(feature = "bench")]
pub mod bench;
pub mod cancel;
pub mod compare;
pub mod compensate;
pub mod error;
pub mod export;
pub mod fleet;
pub mod identify;
pub mod inspect;
pub mod many;
pub mod margin;
pub mod output;
#[cfg(feature = "bench")]
pub mod plan;
pub mod profile;
pub mod replay;
#[cfg(feature = "report")]
pub mod report;
pub mod scatter;
pub mod segment;
mod simpler;
pub mod simulate;
pub mod summary;
pub mod survey;
pub mod table;
#[cfg(feature = "bench")]
pub mod teleop;
pub mod validate;
pub mod workflow;

/// Reading of recordings.
pub use trocar_recording as recording;
pub use trocar_runtime::model_file;

/// Compiles and runs the Rust code of the README and of the book.
#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
#[doc = include_str!("../../../docs/how-to/compensation.md")]
#[doc = include_str!("../../../docs/reference/rust.md")]
pub struct Readme;
