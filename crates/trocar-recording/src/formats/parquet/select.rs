//! Some rows of some columns of any type: for recordings that are rows of files.

use std::fs::File;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use parquet::basic::{ConvertedType, LogicalType, Type as Physical};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::{ByteArray, DataType};
use parquet::errors::{ParquetError, Result as Decoded};

use super::{Cursor, Parquet, fill, refused};
use crate::RecordingError;
use crate::container::{BATCH_ROWS, Column};
use crate::formats::Source;
use crate::formats::scale::Scale;

/// Type of the cells of a column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Cells {
    /// Numbers with a fraction.
    Number,
    /// Integers.
    Whole,
    /// Booleans.
    Truth,
    /// Text.
    Text,
    /// Integers that are timestamps, with this many units per second.
    Timestamp(f64),
}

/// A cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Value<'a> {
    /// No value.
    Missing,
    /// A number with a fraction.
    Number(f64),
    /// An integer, or a timestamp.
    Integer(i64),
    /// A Boolean.
    Boolean(bool),
    /// Text.
    Text(&'a str),
}

impl Parquet {
    /// Opens the file at `path`, which is named `name` in messages.
    ///
    /// # Errors
    /// [`RecordingError`] when it cannot be opened, or its footer is damaged.
    pub fn named(path: &Path, name: &str) -> Result<Self, RecordingError> {
        let failed = |source| RecordingError::Open { file: name.to_owned(), source };
        let file = File::open(path).map_err(failed)?;
        let length = file.metadata().map_err(failed)?.len();
        Self::open(file, length, Source { file: name.to_owned(), format: "Parquet" })
    }

    /// Its columns; nested fields are named by their paths.
    pub fn columns(&self) -> &[Column] {
        &self.tables[0].columns
    }

    /// Number of rows.
    pub fn rows(&self) -> u64 {
        self.tables[0].rows.unwrap_or(0)
    }

    /// Index of a column by its name; `None` if there is none, or if all its cells are missing by
    /// type.
    pub fn place(&self, name: &str) -> Option<usize> {
        let place = self.columns().iter().position(|column| column.name == name)?;
        let descriptor = self.metadata.file_metadata().schema_descr().column(place);
        (!matches!(descriptor.logical_type_ref(), Some(LogicalType::Unknown))).then_some(place)
    }

    /// Type of the cells of a column; `None` for unsupported ones.
    pub fn cells(&self, column: usize) -> Option<Cells> {
        let descriptor = self.metadata.file_metadata().schema_descr().column(column);
        let is_text = descriptor.converted_type() == ConvertedType::UTF8
            || matches!(descriptor.logical_type_ref(), Some(LogicalType::String));
        match (descriptor.physical_type(), self.scales[column]) {
            (Physical::BYTE_ARRAY, _) if is_text && descriptor.max_rep_level() == 0 => {
                Some(Cells::Text)
            }
            (_, None) => None,
            (Physical::BOOLEAN, _) => Some(Cells::Truth),
            (_, Some(Scale::Since { per_second, .. })) => Some(Cells::Timestamp(per_second)),
            (Physical::INT32 | Physical::INT64, Some(Scale::One | Scale::Unsigned)) => {
                Some(Cells::Whole)
            }
            _ => Some(Cells::Number),
        }
    }

    /// The error for a non-numeric column.
    pub fn not_numeric(&self, column: usize) -> RecordingError {
        self.source.not_numeric(&self.columns()[column].name)
    }

    /// Position of ranges of rows, in order, in the row groups, in pieces of at most
    /// [`BATCH_ROWS`].
    pub fn plan(&self, ranges: &[Range<u64>]) -> Arc<[Piece]> {
        let mut pieces = Vec::new();
        let mut ranges = ranges.iter().filter(|range| !range.is_empty()).cloned().peekable();
        let mut first = 0;
        for (group, metadata) in self.metadata.row_groups().iter().enumerate() {
            let end = first + u64::try_from(metadata.num_rows()).unwrap_or(0);
            while let Some(range) = ranges.peek_mut().filter(|range| range.start < end) {
                let to = range.end.min(end).min(range.start + BATCH_ROWS as u64);
                pieces.push(Piece {
                    group,
                    rows: (range.start - first) as usize..(to - first) as usize,
                });
                range.start = to;
                if range.is_empty() {
                    ranges.next();
                }
            }
            first = end;
        }
        pieces.into()
    }
}

/// Rows of a row group.
#[derive(Debug, Clone)]
pub struct Piece {
    group: usize,
    /// Which of its rows.
    pub rows: Range<usize>,
}

/// Some rows of a column, piece by piece.
pub struct Selected {
    parquet: Arc<Parquet>,
    column: usize,
    pieces: Arc<[Piece]>,
    next: usize,
    /// Row group, the row before which the cursor is positioned, and the cursor.
    open: Option<(usize, usize, Cursor)>,
}

impl Selected {
    /// The rows in `pieces` of a column.
    pub fn new(parquet: Arc<Parquet>, column: usize, pieces: Arc<[Piece]>) -> Self {
        Self { parquet, column, pieces, next: 0, open: None }
    }

    /// Appends the numbers of the next piece; timestamps in seconds since `origin`. `false` at the
    /// end.
    ///
    /// # Errors
    /// [`RecordingError`] for a damaged piece, or a column that is not numeric.
    pub fn numbers(&mut self, origin: i64, numbers: &mut Vec<f64>) -> Result<bool, RecordingError> {
        let scale = match self.parquet.scales[self.column] {
            Some(Scale::Since { per_second, .. }) => Scale::Since { origin, per_second },
            Some(scale) => scale,
            None => return Err(self.parquet.not_numeric(self.column)),
        };
        let found = self.guarded(|own| {
            let Some((cursor, rows)) = own.advance()? else { return Ok(None) };
            let mut piece = Vec::new();
            cursor.read(rows, scale, &mut piece)?;
            Ok(Some(piece))
        })?;
        numbers.extend(found.iter().flatten());
        Ok(found.is_some())
    }

    /// Passes the cells to `take` until it returns `false`: each with the number of rows that
    /// contain it. Timestamps are integers.
    ///
    /// # Errors
    /// [`RecordingError`] for a damaged piece, or a column of an unsupported type.
    pub fn runs(
        &mut self,
        take: &mut dyn FnMut(Value<'_>, usize) -> bool,
    ) -> Result<(), RecordingError> {
        let cells =
            self.parquet.cells(self.column).ok_or_else(|| self.parquet.not_numeric(self.column))?;
        let scale =
            self.parquet.scales[self.column].filter(|_| cells != Cells::Text).unwrap_or(Scale::One);
        loop {
            let more = self.guarded(|own| match own.advance()? {
                Some((cursor, rows)) if cells == Cells::Number => {
                    cursor.runs_of_numbers(rows, scale, take).map(Some)
                }
                Some((cursor, rows)) => cursor.runs(rows, scale == Scale::Unsigned, take).map(Some),
                None => Ok(None),
            })?;
            if more != Some(true) {
                return Ok(());
            }
        }
    }

    /// Advances to the next piece: the cursor, positioned before it, and its number of rows.
    fn advance(&mut self) -> Decoded<Option<(&mut Cursor, usize)>> {
        let Some(Piece { group, rows }) = self.pieces.get(self.next) else { return Ok(None) };
        self.next += 1;
        if self.open.as_ref().is_none_or(|(open, _, _)| open != group) {
            self.open = Some((*group, 0, self.parquet.cursor(*group, self.column)?));
        }
        let Some((_, at, cursor)) = &mut self.open else { return Ok(None) };
        cursor.skip(rows.start - *at)?;
        *at = rows.end;
        Ok(Some((cursor, rows.len())))
    }

    /// Adds the column's name to errors; the third-party decoder may panic on a damaged file.
    fn guarded<T>(
        &mut self,
        read: impl FnOnce(&mut Self) -> Decoded<T>,
    ) -> Result<T, RecordingError> {
        let parquet = self.parquet.clone();
        if self.open.is_none() {
            parquet.check_packing(self.column)?;
        }
        let name = &parquet.columns()[self.column].name;
        let place = match self.pieces.get(self.next) {
            Some(piece) => format!("row group {}, column {name}", piece.group),
            None => format!("column {name}"),
        };
        let source = &parquet.source;
        source.guard(place.clone(), || read(self).map_err(|error| refused(source, place, error)))
    }
}

impl Cursor {
    /// Skips rows.
    fn skip(&mut self, rows: usize) -> Decoded<()> {
        if rows == 0 {
            return Ok(());
        }
        let skipped = match &mut self.reader {
            ColumnReader::BoolColumnReader(reader) => reader.skip_records(rows),
            ColumnReader::Int32ColumnReader(reader) => reader.skip_records(rows),
            ColumnReader::Int64ColumnReader(reader) => reader.skip_records(rows),
            ColumnReader::Int96ColumnReader(reader) => reader.skip_records(rows),
            ColumnReader::FloatColumnReader(reader) => reader.skip_records(rows),
            ColumnReader::DoubleColumnReader(reader) => reader.skip_records(rows),
            ColumnReader::ByteArrayColumnReader(reader) => reader.skip_records(rows),
            ColumnReader::FixedLenByteArrayColumnReader(reader) => reader.skip_records(rows),
        }?;
        if skipped != rows {
            return Err(ParquetError::General(format!("{skipped} of {rows} rows")));
        }
        self.left -= rows;
        Ok(())
    }

    /// Runs of equal numbers in the next `rows` rows; returns whether more are wanted.
    fn runs_of_numbers(
        &mut self,
        rows: usize,
        scale: Scale,
        take: &mut dyn FnMut(Value<'_>, usize) -> bool,
    ) -> Decoded<bool> {
        let mut numbers = Vec::new();
        self.read(rows, scale, &mut numbers)?;
        let value = |number: &f64| {
            Ok(if number.is_finite() { Value::Number(*number) } else { Value::Missing })
        };
        pass_runs(&numbers, value, take)
    }

    /// Runs of equal cells of any other type in the next `rows` rows; returns whether more are
    /// wanted.
    fn runs(
        &mut self,
        rows: usize,
        unsigned: bool,
        take: &mut dyn FnMut(Value<'_>, usize) -> bool,
    ) -> Decoded<bool> {
        let (present, levels) = (self.present, &mut self.levels);
        self.left -= rows;
        match &mut self.reader {
            ColumnReader::BoolColumnReader(reader) => pass_runs(
                &all(reader, rows, present, levels)?,
                |cell| Ok(cell.map_or(Value::Missing, Value::Boolean)),
                take,
            ),
            ColumnReader::Int32ColumnReader(reader) => {
                let whole =
                    |cell: i32| if unsigned { i64::from(cell as u32) } else { i64::from(cell) };
                let value = |cell: &Option<i32>| {
                    Ok(cell.map_or(Value::Missing, |cell| Value::Integer(whole(cell))))
                };
                pass_runs(&all(reader, rows, present, levels)?, value, take)
            }
            ColumnReader::Int64ColumnReader(reader) => {
                let value = |cell: &Option<i64>| match cell {
                    Some(cell) if unsigned && *cell < 0 => {
                        Err(ParquetError::General("a whole number of 2^63 or more".into()))
                    }
                    cell => Ok(cell.map_or(Value::Missing, Value::Integer)),
                };
                pass_runs(&all(reader, rows, present, levels)?, value, take)
            }
            ColumnReader::Int96ColumnReader(reader) => {
                let value = |cell: &Option<parquet::data_type::Int96>| {
                    Ok(cell.map_or(Value::Missing, |cell| Value::Integer(cell.to_nanos())))
                };
                pass_runs(&all(reader, rows, present, levels)?, value, take)
            }
            ColumnReader::ByteArrayColumnReader(reader) => {
                pass_runs(&all(reader, rows, present, levels)?, text, take)
            }
            _ => Err(ParquetError::General("bytes where cells should be".into())),
        }
    }
}

fn text(cell: &Option<ByteArray>) -> Decoded<Value<'_>> {
    let Some(bytes) = cell else { return Ok(Value::Missing) };
    let text = std::str::from_utf8(bytes.data());
    text.map(Value::Text).map_err(|_| ParquetError::General("text that is not UTF-8".into()))
}

/// The next `rows` cells; `None` for a missing one.
fn all<T: DataType>(
    reader: &mut ColumnReaderImpl<T>,
    rows: usize,
    present: i16,
    levels: &mut Vec<i16>,
) -> Decoded<Vec<Option<T::T>>> {
    let mut values = Vec::new();
    fill(reader, rows, present, levels, &mut values)?;
    if present == 0 || values.len() == rows {
        return Ok(values.into_iter().map(Some).collect());
    }
    let mut values = values.into_iter();
    Ok(levels.iter().map(|level| if *level < present { None } else { values.next() }).collect())
}

/// Passes on runs of equal cells; returns whether more are wanted.
fn pass_runs<'a, T: PartialEq>(
    cells: &'a [T],
    value: impl Fn(&'a T) -> Decoded<Value<'a>>,
    take: &mut dyn FnMut(Value<'_>, usize) -> bool,
) -> Decoded<bool> {
    for run in cells.chunk_by(|a, b| a == b) {
        if !take(value(&run[0])?, run.len()) {
            return Ok(false);
        }
    }
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::container::Container;

    fn fixture(name: &str) -> Arc<Parquet> {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/formats").join(name);
        Arc::new(Parquet::named(&path, name).unwrap())
    }

    /// Within pages and row groups and across them, with missing cells among the rows.
    #[test]
    fn some_rows_are_those_of_the_whole() {
        let ranges = [0..1, 3..8, 20..160, 160..161, 200..201, 233..240];
        for name in ["pyarrow_snappy.parquet", "pyarrow_v2.parquet", "pyarrow_zstd.parquet"] {
            let parquet = fixture(name);
            for column in ["force_n", "gappy"] {
                let place = parquet.place(column).unwrap();
                let whole = parquet.read_whole(0, &[place]).unwrap().unwrap().swap_remove(0);
                let mut selected = Selected::new(parquet.clone(), place, parquet.plan(&ranges));
                let mut found = Vec::new();
                while selected.numbers(0, &mut found).unwrap() {}
                let expected = ranges
                    .iter()
                    .flat_map(|range| &whole[range.start as usize..range.end as usize]);
                let bits = |x: &f64| x.to_bits();
                assert_eq!(
                    found.iter().map(bits).collect::<Vec<_>>(),
                    expected.map(bits).collect::<Vec<_>>(),
                    "{name}"
                );
            }
        }
    }

    fn value_of(value: Value<'_>) -> Option<i64> {
        if let Value::Integer(value) = value { Some(value) } else { None }
    }

    /// `tests/formats/make.py`: a note on every row except each fourth, words of a dictionary, a
    /// list that is not supported.
    #[test]
    fn cells_come_as_they_are() {
        let parquet = fixture("pyarrow_snappy.parquet");
        let cells = |name: &str| {
            let place = parquet.place(name).unwrap();
            let mut all = Vec::new();
            let mut selected =
                Selected::new(parquet.clone(), place, parquet.plan(&[6..9, 149..151]));
            let read = selected.runs(&mut |value, rows| {
                all.push(format!("{rows} {value:?}"));
                true
            });
            read.map(|()| all.join(", ")).map_err(|error| error.to_string())
        };
        let notes =
            r#"1 Text("row 6"), 1 Text("row 7"), 1 Missing, 1 Text("row 149"), 1 Text("row 150")"#;
        assert_eq!(cells("note").unwrap(), notes);
        assert_eq!(
            cells("is_in").unwrap(),
            "1 Boolean(true), 2 Boolean(false), 1 Boolean(false), 1 Boolean(true)"
        );
        assert_eq!(cells("small").unwrap().split(", ").next(), Some("1 Integer(-194)"));
        assert!(cells("kind").unwrap().starts_with(r#"1 Text("push"), 1 Text("pull")"#));
        // Out of range: an error, never another number.
        assert!(cells("unsigned").unwrap_err().contains("2^63"));
        let moments = parquet.place("stamp").unwrap();
        assert_eq!(parquet.cells(moments), Some(Cells::Timestamp(1e9)));
        let mut all = Vec::new();
        let mut selected = Selected::new(parquet.clone(), moments, parquet.plan(&[2..3, 5..6]));
        let read = selected.runs(&mut |value, _| {
            all.push(value_of(value));
            all.len() < 2
        });
        read.unwrap();
        let moment = |row: i64| Some(1_700_000_000_123_456_789 + row * 10_000_001);
        assert_eq!(all, [moment(2), moment(5)]);
    }
}
