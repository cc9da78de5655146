//! Content of files before any selection: tables of named columns.
//!
//! A Parquet file, an Arrow stream or a text file is one table. A MATLAB or HDF5 file has one table
//! for each group of vectors of equal length, a robot log one for each topic. [`super::columns`]
//! identifies the columns of time, position, velocity and force by their names and units. Here they
//! are numbers as stored in the file.

pub use trocar_tables::content::{Column, Table};

use super::RecordingError;
use super::formats::Source;

/// Most rows per batch: bounds the memory of all streaming readers.
pub(crate) const BATCH_ROWS: usize = 1 << 16;

/// An opened file whose tables are known.
pub struct Container {
    pub(crate) file: String,
    /// Name of the format, such as `Parquet`.
    pub format: &'static str,
    /// Its tables.
    pub tables: Vec<Table>,
    /// Notes, such as the time origin of its stamps.
    pub notes: Vec<String>,
    /// Damaged or unreadable content.
    pub warnings: Vec<String>,
    pub(crate) content: Box<dyn Content>,
}

impl Container {
    pub(crate) fn new(
        Source { file, format }: Source,
        tables: Vec<Table>,
        content: impl Content + 'static,
    ) -> Self {
        let (notes, warnings) = (Vec::new(), Vec::new());
        Self { file, format, tables, notes, warnings, content: Box::new(content) }
    }

    /// Starts to read some columns of one table, by their indices, from the first row.
    ///
    /// # Errors
    /// [`RecordingError`] when the file can no longer be read, or a column is not numeric.
    pub fn open(
        &self,
        table: usize,
        columns: &[usize],
    ) -> Result<Box<dyn Batches>, RecordingError> {
        self.check_numeric(table, columns)?;
        self.content.open(table, &self.tables[table], columns)
    }

    /// The complete columns, for a format that can read them without batches; `None` defers to
    /// [`Container::open`].
    pub(crate) fn read_whole(
        &self,
        table: usize,
        columns: &[usize],
    ) -> Result<Option<Vec<Vec<f64>>>, RecordingError> {
        self.check_numeric(table, columns)?;
        self.content.read_whole(&self.tables[table], columns)
    }

    fn check_numeric(&self, table: usize, columns: &[usize]) -> Result<(), RecordingError> {
        let Table { name: table, columns: all, .. } = &self.tables[table];
        let Some(other) = columns.iter().map(|k| &all[*k]).find(|own| !own.is_numeric) else {
            return Ok(());
        };
        let column = match &**table {
            "" => other.name.clone(),
            table => format!("{} of {table}", other.name),
        };
        let problem = format!(
            "column '{column}' of this {} file holds no numbers that are read\n\nhint: trocar inspect lists the columns",
            self.format
        );
        Err(RecordingError::unusable(&self.file, problem))
    }
}

/// Rows of some columns, from the first one on.
pub(crate) type Opened = Result<Box<dyn Batches>, RecordingError>;

/// What an opened file holds besides its description.
pub(crate) trait Content {
    /// Clock of a column of times: the times of two columns may be compared only if their clocks
    /// are equal.
    fn clock(&self, _at: usize, _table: &Table, _column: usize) -> usize {
        0
    }

    /// Columns of a table that are dates or durations in the file: their numbers are seconds,
    /// whatever their names say.
    fn dates(&self, _table: usize) -> Vec<usize> {
        Vec::new()
    }

    /// The first text in a column without numbers, if it is a number with its unit, such as `1.2 N`.
    fn number_with_unit(&self, _table: usize, _column: usize) -> Option<&str> {
        None
    }

    /// Starts to read columns of numbers of the table at a place.
    fn open(&self, at: usize, table: &Table, columns: &[usize]) -> Opened;

    /// As [`Container::read_whole`].
    fn read_whole(
        &self,
        _table: &Table,
        _columns: &[usize],
    ) -> Result<Option<Vec<Vec<f64>>>, RecordingError> {
        Ok(None)
    }
}

/// Whole columns of equal length, passed on in batches; then what went wrong behind them.
#[derive(Default)]
pub(crate) struct Held {
    pub(crate) columns: Vec<Vec<f64>>,
    pub(crate) warnings: Vec<String>,
    /// Why the rows end before the table does.
    pub(crate) problem: Option<RecordingError>,
    /// Rows passed on.
    at: usize,
}

impl Held {
    pub(crate) fn of(columns: Vec<Vec<f64>>) -> Self {
        Self { columns, ..Self::default() }
    }
}

impl Batches for Held {
    fn next(&mut self, columns: &mut [Vec<f64>]) -> Result<bool, RecordingError> {
        columns.iter_mut().for_each(Vec::clear);
        let to = self.columns.first().map_or(0, Vec::len).min(self.at + BATCH_ROWS);
        if self.at == to {
            return self.problem.take().map_or(Ok(false), Err);
        }
        for (column, own) in columns.iter_mut().zip(&self.columns) {
            column.extend_from_slice(&own[self.at..to]);
        }
        self.at = to;
        Ok(true)
    }

    fn warnings(&self) -> Vec<String> {
        self.warnings.clone()
    }
}

/// Batches of rows of some columns.
pub trait Batches: Send {
    /// Replaces the content of `columns` by the next rows, at most 65 536, all columns of
    /// equal length; NaN for a missing cell. `false` at the end, with `columns` empty.
    ///
    /// # Errors
    /// [`RecordingError`], with the row at which the file is damaged; all rows before it were
    /// returned earlier.
    fn next(&mut self, columns: &mut [Vec<f64>]) -> Result<bool, RecordingError>;

    /// First rows of the last batch and their lines, wherever lines are not consecutive; `None` where rows are
    /// counted.
    fn lines(&mut self) -> Option<Vec<(usize, u64)>> {
        None
    }

    /// Approximate number of rows, if the table does not state it.
    fn expected(&self) -> Option<u64> {
        None
    }

    /// SHA-256 of what was read, in hexadecimal, if it cannot be read again; empty if it was not asked for.
    fn digest(&mut self) -> String {
        String::new()
    }

    /// How the rows were computed, if not simply read; complete at the end.
    fn notes(&self) -> Vec<String> {
        Vec::new()
    }

    /// Losses so far; complete at the end.
    fn warnings(&self) -> Vec<String> {
        Vec::new()
    }
}
