//! Many recordings, each identified by itself, to one table.
//!
//! ```text
//! (recording, configuration) -> one row of plain columns        identify_one, pure: any engine may call it
//! ```

pub use one::{Config, Depth, Input, identify_one};
pub use row::{Cell, Column, Kind, Row, columns, place};

mod one;
mod row;
