//! What files hold before anything is chosen from it: tables of named columns.
//!
//! A Parquet file, an Arrow stream or a text file is one table. A MATLAB or HDF5 file has one table for each group of vectors of one length,
//! a robot log one for each topic. Which columns are time, position, velocity and force is decided elsewhere
//! ([`super::columns`]), by their names and units; here they are numbers as they stand in the file.

use std::path::Path;

use super::RecordingError;
use super::text::TextTable;

/// Most rows handed on at a time: what bounds the memory of everything that streams.
pub(crate) const BATCH_ROWS: usize = 1 << 16;

/// A column of a table.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Name as in the file; for a message the path to the field, such as `position[insertion]` or `wrench.force.z`.
    pub name: String,
    /// Unit as the file declares it beside the name (an attribute, a field's metadata, a message's definition).
    pub unit: Option<String>,
    /// Whether it holds numbers; other columns are listed and cannot be read.
    pub is_numeric: bool,
}

/// Columns of one length.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// Topic, group or variable; empty where a file is one table.
    pub name: String,
    /// What it is in the terms of its format, such as `sensor_msgs/msg/JointState`; empty where there is no more to say.
    pub kind: String,
    /// Rows, where the file says so without being read.
    pub rows: Option<u64>,
    /// Its columns, in the file's order.
    pub columns: Vec<Column>,
}

/// A file that has been opened and understood as far as its tables.
pub(crate) trait Container {
    /// Name of the format, such as `Parquet`.
    fn format(&self) -> &'static str;

    /// What it holds.
    fn tables(&self) -> &[Table];

    /// Starts to read some columns of one table, by their places, from the first row on.
    ///
    /// # Errors
    /// [`RecordingError`] when the file cannot be read any more, or a column is not numeric.
    fn open(&self, table: usize, columns: &[usize]) -> Result<Box<dyn Batches>, RecordingError>;
}

/// Rows of some columns, many at a time.
pub(crate) trait Batches: Send {
    /// Replaces what `columns` hold by the next rows, at most [`BATCH_ROWS`] of them, all columns of one length; NaN where a cell is
    /// missing. `false` at the end, with `columns` empty.
    ///
    /// # Errors
    /// [`RecordingError`], with the row where the file is damaged; everything in front of it has been handed on before.
    fn next(&mut self, columns: &mut [Vec<f64>]) -> Result<bool, RecordingError>;
}

/// A file of any format; text is one table.
pub(crate) fn any(path: &Path) -> Result<Box<dyn Container>, RecordingError> {
    match open(path)? {
        Some(container) => Ok(container),
        None => Ok(Box::new(TextTable::open(path)?)),
    }
}

/// What the first bytes of a file say that it is, if it is one of the formats that are not text.
pub(crate) fn open(_path: &Path) -> Result<Option<Box<dyn Container>>, RecordingError> {
    Ok(None)
}
