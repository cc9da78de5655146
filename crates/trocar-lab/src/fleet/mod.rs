//! Identification of many recordings, each on its own, into one table.
//!
//! ```text
//! (recording, configuration) -> one row of plain columns        identify_one, pure: any engine may call it
//! data set -> rows on all cores -> journal -> table             run: resumable, reproducible to the byte
//! data set -> rows from elsewhere -> journal -> table           Collector and identify_source: the same bytes
//! ```

pub use dataset::{Dataset, DatasetError, Metadata, Source};
pub use journal::journal_path;
pub use one::{Config, Depth, Input, identify_one};
pub use row::{FleetCell, FleetRow, columns, place};
pub use run::{Collector, Fleet, FleetError, KEPT, Record, Tally, identify_source, run};

mod dataset;
mod journal;
mod one;
mod row;
mod run;
pub mod summary;
