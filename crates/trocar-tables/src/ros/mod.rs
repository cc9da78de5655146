//! Messages of ROS 2 and ROS 1, and of JSON, as tables: each number of a message is a column.
//!
//! Everything is decoded by the definition of its type that the log carries; which column is meant by what
//! is not known here.

mod cdr;
mod definition;
mod topic;

pub use topic::{Description, Epochs, Extractor, Topic, epoch_notes, epochs};

/// Rows of one topic, as stored in a part of a file.
#[derive(Debug, Default)]
pub struct Block {
    /// Log time of each, ns.
    pub log: Vec<u64>,
    /// The requested columns.
    pub columns: Vec<Vec<f64>>,
    /// Messages that ended before the requested fields.
    pub undecoded: u64,
    /// No row of a later block has a log time before this, if that is known.
    pub settled: Option<u64>,
}

impl Block {
    /// No rows of `width` columns.
    pub fn new(width: usize) -> Self {
        Self { columns: vec![Vec::new(); width], ..Self::default() }
    }
}
