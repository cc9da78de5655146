//! What a file holds, before anything is selected from it: tables of named columns, described.

/// A column of a table.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Name as in the file; for a message, the path to the field, such as `position[insertion]` or
    /// `wrench.force.z`.
    pub name: String,
    /// Unit that the file declares for the name (an attribute, a field's metadata, a message's
    /// definition).
    pub unit: Option<String>,
    /// Whether it holds numbers; other columns are listed and cannot be read.
    pub is_numeric: bool,
}

/// Columns of equal length.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// Topic, group or variable; empty where a file is one table.
    pub name: String,
    /// Its type in the terms of its format, such as `sensor_msgs/msg/JointState`; empty if there is
    /// none.
    pub kind: String,
    /// Number of rows, if the file states it without being read.
    pub rows: Option<u64>,
    /// Its columns, in the file's order.
    pub columns: Vec<Column>,
}

/// Columns of the times of a log: when a message was logged and published, and the stamp that it carries.
pub const LOG_TIME: &str = "log_time_s";
/// See [`LOG_TIME`].
#[cfg(feature = "ros")]
pub(crate) const PUBLISH_TIME: &str = "publish_time_s";
/// See [`LOG_TIME`].
pub const HEADER_STAMP: &str = "header.stamp_s";

impl Table {
    /// The single table of a text file, of unknown length.
    pub fn without_a_name(columns: Vec<Column>) -> Self {
        Self { columns, ..Self::default() }
    }
}
