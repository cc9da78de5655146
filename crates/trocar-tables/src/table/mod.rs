//! Tables of results: named columns of numbers, integers, Booleans and text, written in blocks to
//! CSV (plain, gzip, zstd), Parquet or Arrow, and read back from Parquet.
//!
//! The file extension selects the format; the same columns give the same bytes. A cell may be
//! missing: NaN for numbers, `None` otherwise. It becomes null in Parquet and Arrow and an empty
//! cell in CSV. A text in CSV that a spreadsheet would execute (it begins with =, +, -, @, a tab or a
//! line break, and is no number) has an apostrophe before it. The unit at the end of a name, as in
//! `force_n`, is also stored in Parquet and Arrow as the field's metadata `unit`.

use std::borrow::Cow;
use std::io;
use std::path::{Path, PathBuf};

pub use crate::error::{OutputError, TableError};
use crate::output::AtomicFile;

#[cfg(feature = "arrow")]
mod arrow;
pub mod csv;
#[cfg(feature = "parquet")]
mod parquet;

/// Type of the cells of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// 64-bit numbers.
    Number,
    /// Integers.
    Integer,
    /// True or false.
    Boolean,
    /// Text.
    Text,
}

/// The description of a column.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Field {
    /// Its name, with the unit at its end.
    pub name: String,
    /// Type of its cells.
    pub kind: Kind,
}

impl Field {
    /// A field called `name`.
    pub fn new(name: impl Into<String>, kind: Kind) -> Self {
        Self { name: name.into(), kind }
    }

    /// A field of numbers called `name`.
    pub fn number(name: impl Into<String>) -> Self {
        Self::new(name, Kind::Number)
    }

    /// The unit at the end of its name.
    #[must_use]
    pub fn unit(&self) -> Option<&'static str> {
        unit_in(&self.name)
    }
}

/// The cells of a column; NaN and `None` mark missing cells.
#[derive(Debug, Clone, PartialEq)]
pub enum Column {
    /// Numbers.
    Number(Vec<f64>),
    /// Integers.
    Integer(Vec<Option<i64>>),
    /// True or false.
    Boolean(Vec<Option<bool>>),
    /// Text.
    Text(Vec<Option<Cow<'static, str>>>),
}

impl Column {
    /// A column without cells.
    #[must_use]
    pub fn new(kind: Kind) -> Self {
        match kind {
            Kind::Number => Self::Number(Vec::new()),
            Kind::Integer => Self::Integer(Vec::new()),
            Kind::Boolean => Self::Boolean(Vec::new()),
            Kind::Text => Self::Text(Vec::new()),
        }
    }

    /// Type of the cells.
    #[must_use]
    pub fn kind(&self) -> Kind {
        match self {
            Self::Number(_) => Kind::Number,
            Self::Integer(_) => Kind::Integer,
            Self::Boolean(_) => Kind::Boolean,
            Self::Text(_) => Kind::Text,
        }
    }

    /// Number of cells.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::Number(cells) => cells.len(),
            Self::Integer(cells) => cells.len(),
            Self::Boolean(cells) => cells.len(),
            Self::Text(cells) => cells.len(),
        }
    }

    /// Whether there are no cells.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Removes all cells but keeps the allocated memory.
    pub fn clear(&mut self) {
        match self {
            Self::Number(cells) => cells.clear(),
            Self::Integer(cells) => cells.clear(),
            Self::Boolean(cells) => cells.clear(),
            Self::Text(cells) => cells.clear(),
        }
    }
}

/// Columns of equal length with their names.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// Names, in the order of `columns`.
    pub fields: Vec<String>,
    /// Cells, one entry for each name.
    pub columns: Vec<Column>,
}

impl Table {
    /// The column called `name`.
    #[must_use]
    pub fn column(&self, name: &str) -> Option<&Column> {
        let at = self.fields.iter().position(|field| field == name)?;
        self.columns.get(at)
    }

    /// Number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, Column::len)
    }
}

/// Reads a whole table from a Parquet file.
///
/// Integers and Booleans keep their type; all other numbers become [`Column::Number`].
///
/// # Errors
/// [`TableError`] when the file cannot be read, is damaged, or has columns other than flat numbers,
/// Booleans and text.
pub fn read(path: impl AsRef<Path>) -> Result<Table, TableError> {
    let path = path.as_ref();
    #[cfg(feature = "parquet")]
    return parquet::read(path);
    #[cfg(not(feature = "parquet"))]
    Err(TableError::no_parquet(path))
}

/// Names of the columns of a Parquet file; reads no data.
///
/// # Errors
/// [`TableError`] when the file cannot be opened or is damaged.
pub fn names(path: impl AsRef<Path>) -> Result<Vec<String>, TableError> {
    let path = path.as_ref();
    #[cfg(feature = "parquet")]
    return parquet::names(path);
    #[cfg(not(feature = "parquet"))]
    Err(TableError::no_parquet(path))
}

/// Format of a file by its extension.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Comma-separated text: `.csv`, `.txt`, `.dat`, `.log` or no extension.
    Csv,
    /// `.gz`.
    CsvGzip,
    /// `.zst`.
    CsvZstd,
    /// `.parquet` and `.pq`.
    Parquet,
    /// `.arrow`, `.feather` and `.ipc`.
    Arrow,
}

impl Format {
    /// The format for a file called `path`.
    ///
    /// # Errors
    /// [`OutputError::Extension`].
    pub fn of(path: &Path) -> Result<Self, OutputError> {
        let extension = path
            .extension()
            .and_then(|extension| extension.to_str())
            .unwrap_or_default()
            .to_lowercase();
        Ok(match extension.as_str() {
            "" | "csv" | "txt" | "dat" | "log" => Self::Csv,
            "gz" | "gzip" => Self::CsvGzip,
            "zst" | "zstd" => Self::CsvZstd,
            "parquet" | "pq" => Self::Parquet,
            "arrow" | "feather" | "ipc" => Self::Arrow,
            _ => return Err(OutputError::Extension { path: path.to_owned() }),
        })
    }
}

/// Writes a table block by block; the file appears when it is complete ([`TableWriter::commit`]),
/// or not at all.
///
/// Memory is bounded: Parquet buffers at most 131,072 rows for a row group, the other formats one
/// block.
pub struct TableWriter {
    path: PathBuf,
    fields: Vec<Field>,
    sink: Sink,
    /// Rows that were appended one by one.
    waiting: Vec<Column>,
}

/// Number of single rows that form a block.
const PIECE: usize = 1 << 12;

/// One cell of a row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TableCell {
    /// A number; NaN where it is missing.
    Number(f64),
    /// An integer.
    Integer(i64),
    /// Text.
    Text(&'static str),
}

enum Sink {
    Csv(Box<csv::Writer>),
    #[cfg(feature = "parquet")]
    Parquet(Box<parquet::Writer>),
    #[cfg(feature = "arrow")]
    Arrow(Box<arrow::Writer>),
}

impl TableWriter {
    /// Creates the file `path`, whose extension selects the format ([`Format::of`]); `-` is CSV to
    /// standard output.
    ///
    /// # Errors
    /// [`OutputError`] when the file cannot be created or the format is not part of this build.
    pub fn create(path: impl AsRef<Path>, fields: &[Field]) -> Result<Self, OutputError> {
        let path = path.as_ref();
        Self::with_format(path, Format::of(path)?, fields)
    }

    /// The same with an explicit format.
    ///
    /// # Errors
    /// As for [`TableWriter::create`].
    pub(crate) fn with_format(
        path: impl AsRef<Path>,
        format: Format,
        fields: &[Field],
    ) -> Result<Self, OutputError> {
        let path = path.as_ref();
        let refused = |feature| OutputError::NoFeature { path: path.to_owned(), feature };
        let failed = |source| OutputError::Write { path: path.to_owned(), source };
        let sink = match format {
            Format::Csv | Format::CsvGzip | Format::CsvZstd => {
                if format == Format::CsvGzip && !cfg!(feature = "gzip") {
                    return Err(refused("gzip"));
                }
                if format == Format::CsvZstd && !cfg!(feature = "zstd") {
                    return Err(refused("zstd"));
                }
                Sink::Csv(Box::new(
                    csv::Writer::new(AtomicFile::create(path)?, format, fields).map_err(failed)?,
                ))
            }
            #[cfg(feature = "parquet")]
            Format::Parquet => Sink::Parquet(Box::new(
                parquet::Writer::new(AtomicFile::create(path)?, fields).map_err(failed)?,
            )),
            #[cfg(not(feature = "parquet"))]
            Format::Parquet => return Err(refused("parquet")),
            #[cfg(feature = "arrow")]
            Format::Arrow => Sink::Arrow(Box::new(
                arrow::Writer::new(AtomicFile::create(path)?, fields).map_err(failed)?,
            )),
            #[cfg(not(feature = "arrow"))]
            Format::Arrow => return Err(refused("arrow")),
        };
        let waiting = fields.iter().map(|field| Column::new(field.kind)).collect();
        Ok(Self { path: path.to_owned(), fields: fields.to_vec(), sink, waiting })
    }

    /// The same, but CSV contains `text` for missing numbers and not empty cells.
    #[must_use]
    pub fn with_missing(mut self, text: &'static str) -> Self {
        #[allow(irrefutable_let_patterns)] // the only one without formats
        if let Sink::Csv(writer) = &mut self.sink {
            writer.missing = text;
        }
        self
    }

    /// Appends one row: a cell for each field, of its type. It is written together with others, or
    /// by [`TableWriter::flush`].
    ///
    /// # Errors
    /// As for [`TableWriter::write`].
    pub fn row(&mut self, cells: &[TableCell]) -> Result<(), OutputError> {
        for (column, cell) in self.waiting.iter_mut().zip(cells) {
            match (column, *cell) {
                (Column::Number(cells), TableCell::Number(number)) => cells.push(number),
                (Column::Integer(cells), TableCell::Integer(number)) => cells.push(Some(number)),
                (Column::Text(cells), TableCell::Text(word)) => cells.push(Some(word.into())),
                // Columns of unequal length are rejected when they are written.
                _ => {}
            }
        }
        match self.waiting.iter().any(|column| column.len() >= PIECE) {
            true => self.write_waiting(),
            false => Ok(()),
        }
    }

    /// Writes the rows appended one by one. On a pipe they are then sent, unless the format buffers
    /// rows for a group.
    ///
    /// # Errors
    /// As for [`TableWriter::write`].
    pub fn flush(&mut self) -> Result<(), OutputError> {
        self.write_waiting()?;
        let outcome = match &mut self.sink {
            Sink::Csv(writer) => writer.flush(),
            #[cfg(feature = "arrow")]
            _ => Ok(()),
        };
        outcome.map_err(|source| OutputError::Write { path: self.path.clone(), source })
    }

    fn write_waiting(&mut self) -> Result<(), OutputError> {
        if self.waiting.iter().all(Column::is_empty) {
            return Ok(());
        }
        let mut waiting = std::mem::take(&mut self.waiting);
        let outcome = self.write_columns(&waiting);
        waiting.iter_mut().for_each(Column::clear);
        self.waiting = waiting;
        outcome
    }

    /// Appends rows: one column for each field, of its type and all of equal length.
    ///
    /// # Errors
    /// [`OutputError::Write`], for example on a full disk, or when the columns do not match the
    /// fields.
    pub fn write(&mut self, columns: &[Column]) -> Result<(), OutputError> {
        self.write_waiting()?;
        self.write_columns(columns)
    }

    fn write_columns(&mut self, columns: &[Column]) -> Result<(), OutputError> {
        let outcome = self.check(columns).and_then(|()| match &mut self.sink {
            Sink::Csv(writer) => writer.write(columns),
            #[cfg(feature = "parquet")]
            Sink::Parquet(writer) => writer.write(columns),
            #[cfg(feature = "arrow")]
            Sink::Arrow(writer) => writer.write(columns),
        });
        outcome.map_err(|source| OutputError::Write { path: self.path.clone(), source })
    }

    /// Completes the file and gives it its name.
    ///
    /// # Errors
    /// [`OutputError::Write`]; an earlier file of that name then stays untouched.
    pub fn commit(mut self) -> Result<(), OutputError> {
        self.write_waiting()?;
        let file = match self.sink {
            Sink::Csv(writer) => writer.finish(),
            #[cfg(feature = "parquet")]
            Sink::Parquet(writer) => writer.finish(),
            #[cfg(feature = "arrow")]
            Sink::Arrow(writer) => writer.finish(),
        };
        file.map_err(|source| OutputError::Write { path: self.path, source })?.commit()
    }

    fn check(&self, columns: &[Column]) -> io::Result<()> {
        let rows = columns.first().map_or(0, Column::len);
        let fits = columns.len() == self.fields.len()
            && self.fields.iter().zip(columns).all(|(field, column)| field.kind == column.kind())
            && columns.iter().all(|column| column.len() == rows);
        match fits {
            true => Ok(()),
            false => Err(io::Error::new(
                io::ErrorKind::InvalidInput,
                "columns other than the table's fields",
            )),
        }
    }
}

/// Suffixes of names and their units, longer ones first.
const UNITS: [(&str, &str); 22] = [
    ("_n_s_m", "N s/m"),
    ("_mm_s2", "mm/s^2"),
    ("_m_s2", "m/s^2"),
    ("_um_s", "um/s"),
    ("_mm_s", "mm/s"),
    ("_n_m", "N/m"),
    ("_m_s", "m/s"),
    ("_n_s", "N/s"),
    ("_1_s", "1/s"),
    ("_um", "um"),
    ("_mm", "mm"),
    ("_ms", "ms"),
    ("_us", "us"),
    ("_ns", "ns"),
    ("_mn", "mN"),
    ("_mj", "mJ"),
    ("_hz", "Hz"),
    ("_kg", "kg"),
    ("_m", "m"),
    ("_s", "s"),
    ("_n", "N"),
    ("_j", "J"),
];

fn unit_in(name: &str) -> Option<&'static str> {
    let lower = name.to_ascii_lowercase();
    UNITS.iter().find(|(extension, _)| lower.ends_with(extension)).map(|(_, unit)| *unit)
}
