//! Parquet files, one table each: column chunks decoded on all cores, straight into numbers.
//!
//! Timestamps become seconds since the column's first, durations and times of day become seconds,
//! nulls become NaN. Memory: at most `AHEAD` numbers decoded ahead, and one page of each chunk
//! being read.

use std::collections::{HashMap, VecDeque};
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::sync::{Arc, Mutex, PoisonError};

use arrow_schema::{DataType, Schema};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use parquet::basic::{
    Compression, ConvertedType, LogicalType, TimeUnit as Parts, Type as Physical,
};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl, get_column_reader};
use parquet::errors::{ParquetError, Result as Decoded};
use parquet::file::metadata::{ParquetMetaData, ParquetMetaDataReader};
use parquet::file::reader::{ChunkReader, Length};
use parquet::file::serialized_reader::SerializedPageReader;
use parquet::schema::types::ColumnDescriptor;
use rayon::prelude::*;

use super::arrow::{parts_of, unit_of};
use super::scale::Scale;
use super::{Source, read_at, read_exact_at};
use crate::RecordingError;
use crate::container::{BATCH_ROWS, Batches, Column, Container, Table};

mod thrift;

/// Numbers decoded ahead of the rows returned, over all columns: 32 MB. Several row groups at once
/// keep all cores busy if there are fewer columns than cores, or one more.
const AHEAD: usize = 1 << 22;

/// Rows decoded at a time when a column is read as a whole.
const PIECE_ROWS: usize = 1 << 14;

const WRITE_AGAIN: &str = "write it again with snappy, gzip, zstd or no compression";

/// Bytes of a page header that are checked; longer ones hold long texts.
const HEADER: usize = 1 << 13;

/// Key of the schema that Arrow's writers add.
const ARROW_SCHEMA: &str = "ARROW:schema";

/// The file's bytes for several concurrent readers.
#[derive(Debug)]
struct Input {
    file: Arc<File>,
    length: u64,
}

impl Length for Input {
    fn len(&self) -> u64 {
        self.length
    }
}

impl ChunkReader for Input {
    type T = PageReader;

    /// For a page header, or for the page behind a header that was read before.
    fn get_read(&self, start: u64) -> Decoded<Self::T> {
        let mut header = [0; HEADER];
        let read = read_at(&self.file, &mut header, start)?;
        let is_header = thrift::is_page_header(&header[..read]);
        if is_header {
            self.check(&header[..read])?;
        }
        let bytes = BufReader::new(At { file: self.file.clone(), at: start });
        Ok(PageReader { bytes, is_header, has_begun: false })
    }

    fn get_bytes(&self, start: u64, length: usize) -> Decoded<bytes::Bytes> {
        // Before the allocation, since lengths come from the file.
        if start.checked_add(length as u64).is_none_or(|end| end > self.length) {
            return Err(ParquetError::EOF(format!(
                "{length} bytes at {start}, the file has {}",
                self.length
            )));
        }
        let mut bytes = vec![0; length];
        read_exact_at(&self.file, &mut bytes, start)?;
        Ok(bytes.into())
    }
}

impl Input {
    /// Refuses a footer or page header with lists longer than the file.
    fn check(&self, header: &[u8]) -> Decoded<()> {
        let fits = thrift::lists_fit(header, self.length);
        fits.then_some(())
            .ok_or_else(|| ParquetError::General("a list longer than the file".to_owned()))
    }

    fn check_footer(&self) -> Decoded<()> {
        let Some(end) = self.length.checked_sub(8) else { return Ok(()) };
        let mut length = [0; 4];
        read_exact_at(&self.file, &mut length, end)?;
        let length = u32::from_le_bytes(length);
        let Some(start) = end.checked_sub(length.into()) else { return Ok(()) };
        self.check(&self.get_bytes(start, length as usize)?)
    }
}

/// The bytes of a page header, or of a page.
struct PageReader {
    bytes: BufReader<At>,
    is_header: bool,
    /// Whether a single byte was read.
    has_begun: bool,
}

impl Read for PageReader {
    /// Headers are parsed byte by byte, pages are read as a whole: what is parsed has to begin as a
    /// header does, since its lists are not checked otherwise.
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        if !self.is_header && bytes.len() == 1 && std::mem::replace(&mut self.has_begun, true) {
            return Err(io::Error::new(
                io::ErrorKind::InvalidData,
                "no page header where one should begin",
            ));
        }
        self.bytes.read(bytes)
    }
}

/// A position in the file that advances.
struct At {
    file: Arc<File>,
    at: u64,
}

impl Read for At {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let read = read_at(&self.file, bytes, self.at)?;
        // The reader skips what is not there without noticing, once for each of a stated number of
        // elements.
        if read == 0 && !bytes.is_empty() {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        self.at += read as u64;
        Ok(read)
    }
}

/// An open file.
pub(crate) struct Parquet {
    source: Source,
    input: Arc<Input>,
    metadata: Arc<ParquetMetaData>,
    tables: [Table; 1],
    /// The unit of each column; timestamps still without their origin. `None` if it is not numeric.
    scales: Vec<Option<Scale>>,
    /// Columns of timestamps, durations and times of day.
    times: Vec<usize>,
}

impl Parquet {
    pub(crate) fn open(file: File, length: u64, source: Source) -> Result<Self, RecordingError> {
        let input = Arc::new(Input { file: Arc::new(file), length });
        let metadata = source.guard("the footer", || {
            let metadata = input
                .check_footer()
                .and_then(|()| ParquetMetaDataReader::new().parse_and_finish(&*input));
            metadata.map_err(|error| refused(&source, "the footer", error))
        })?;
        let metadata = Arc::new(metadata);
        let arrow = arrow_schema(&metadata);
        let schema = metadata.file_metadata().schema_descr();
        let mut scales = Vec::with_capacity(schema.num_columns());
        let mut columns = Vec::with_capacity(schema.num_columns());
        let mut times = Vec::new();
        for column in schema.columns() {
            let name = column.path().string();
            let field = arrow.get(&name);
            let scale = scale(column, field.map(|(kind, _)| kind));
            let is_time = matches!(scale, Some(Scale::Since { .. }))
                || is_duration(column, field.map(|(kind, _)| kind));
            times.extend(is_time.then_some(columns.len()));
            let unit = field.and_then(|(_, unit)| unit.clone());
            columns.push(Column {
                name,
                unit: if is_time { Some("s".into()) } else { unit },
                is_numeric: scale.is_some(),
            });
            scales.push(scale);
        }
        let rows = u64::try_from(metadata.file_metadata().num_rows());
        let rows = rows.map_err(|_| source.damaged("the footer", "a negative number of rows"))?;
        let table = Table { name: String::new(), kind: String::new(), rows: Some(rows), columns };
        Ok(Self { source, input, metadata, tables: [table], scales, times })
    }

    /// The scale with its origin, which is the first timestamp of the column.
    fn anchored(&self, column: usize) -> Result<Scale, RecordingError> {
        let name = &self.tables[0].columns[column].name;
        let scale = self.scales[column].ok_or_else(|| self.source.not_numeric(name))?;
        let Scale::Since { per_second, .. } = scale else { return Ok(scale) };
        for group in 0..self.metadata.num_row_groups() {
            let first = self.cursor(group, column).and_then(|mut cursor| cursor.first_whole());
            let first =
                first.map_err(|error| refused(&self.source, format!("column {name}"), error))?;
            if let Some(origin) = first {
                return Ok(Scale::Since { origin, per_second });
            }
        }
        Ok(scale)
    }

    fn check_packing(&self, column: usize) -> Result<(), RecordingError> {
        let chunks =
            self.metadata.row_groups().iter().filter_map(|group| group.columns().get(column));
        let mut unread = chunks
            .map(|chunk| chunk.compression())
            .filter(|packing| matches!(packing, Compression::BROTLI(_) | Compression::LZO));
        match unread.next() {
            Some(packing) => {
                Err(self.source.unsupported(format!("{packing} compression"), WRITE_AGAIN))
            }
            None => Ok(()),
        }
    }

    fn cursor(&self, group: usize, column: usize) -> Decoded<Cursor> {
        cursor(&self.input, &self.metadata, group, column)
    }
}

/// A part of a column that is read as a whole: the numbers of one row group.
struct RowGroupColumn<'a> {
    group: usize,
    column: usize,
    scale: Scale,
    numbers: &'a mut [f64],
}

impl RowGroupColumn<'_> {
    /// Decodes in pieces that fit into the processor's caches.
    fn read(self, input: &Arc<Input>, metadata: &ParquetMetaData) -> Decoded<()> {
        let mut cursor = cursor(input, metadata, self.group, self.column)?;
        let mut piece = Vec::new();
        for numbers in self.numbers.chunks_mut(PIECE_ROWS) {
            cursor.read(numbers.len(), self.scale, &mut piece)?;
            numbers.copy_from_slice(&piece);
        }
        Ok(())
    }
}

impl Parquet {
    /// Rows of each row group, if the file is large enough for them: at most 64 per byte.
    fn group_rows(&self) -> Option<Vec<usize>> {
        let rows =
            self.metadata.row_groups().iter().map(|group| usize::try_from(group.num_rows()).ok());
        let rows: Vec<usize> = rows.collect::<Option<_>>()?;
        let all = rows.iter().try_fold(0_usize, |all, rows| all.checked_add(*rows))?;
        (all as u64 <= self.input.length.saturating_mul(64)).then_some(rows)
    }

    fn scaled(&self, columns: &[usize]) -> Result<Vec<(usize, Scale)>, RecordingError> {
        let scale = |&column: &usize| {
            let name = &self.tables[0].columns[column].name;
            self.check_packing(column)?;
            Ok((column, self.source.guard(format!("column {name}"), || self.anchored(column))?))
        };
        columns.iter().map(scale).collect()
    }
}

impl Container for Parquet {
    fn format(&self) -> &'static str {
        self.source.format
    }

    fn tables(&self) -> &[Table] {
        &self.tables
    }

    fn dates(&self, _table: usize) -> Vec<usize> {
        self.times.clone()
    }

    fn open(&self, _table: usize, columns: &[usize]) -> Result<Box<dyn Batches>, RecordingError> {
        Ok(Box::new(Groups {
            source: self.source.clone(),
            input: self.input.clone(),
            metadata: self.metadata.clone(),
            columns: self.scaled(columns)?,
            next_group: 0,
            unfinished: None,
            ready: VecDeque::new(),
            spare: Mutex::default(),
            failed: None,
            rows: 0,
        }))
    }

    fn read_whole(
        &self,
        _table: usize,
        columns: &[usize],
    ) -> Result<Option<Vec<Vec<f64>>>, RecordingError> {
        let Some(groups) = self.group_rows() else { return Ok(None) };
        let columns = self.scaled(columns)?;
        let rows = groups.iter().sum();
        let mut all: Vec<Vec<f64>> = columns.iter().map(|_| vec![0.0; rows]).collect();
        let mut parts = Vec::new();
        for (&(column, scale), numbers) in columns.iter().zip(&mut all) {
            let mut rest = numbers.as_mut_slice();
            for (group, &rows) in groups.iter().enumerate() {
                let (numbers, others) = rest.split_at_mut(rows);
                parts.push(RowGroupColumn { group, column, scale, numbers });
                rest = others;
            }
        }
        parts.into_par_iter().try_for_each(|part| {
            let name = &self.tables[0].columns[part.column].name;
            let place = format!("row group {}, column {name}", part.group);
            // The decoders may panic on damaged files.
            self.source.guard(place.clone(), || {
                part.read(&self.input, &self.metadata)
                    .map_err(|error| refused(&self.source, place, error))
            })
        })?;
        Ok(Some(all))
    }
}

/// Kind and unit of each field, by its path, as recorded by Arrow's writers.
fn arrow_schema(metadata: &ParquetMetaData) -> HashMap<String, (DataType, Option<String>)> {
    let pairs = metadata.file_metadata().key_value_metadata();
    let text =
        pairs.and_then(|pairs| pairs.iter().find(|pair| pair.key == ARROW_SCHEMA)?.value.clone());
    let schema =
        text.and_then(|text| STANDARD.decode(text).ok()).and_then(|bytes| schema_of(&bytes));
    let mut fields = HashMap::new();
    for field in schema.iter().flat_map(Schema::fields) {
        fields.insert(field.name().clone(), (field.data_type().clone(), unit_of(field.metadata())));
    }
    fields
}

/// The schema is optional: the file can be read without it, so a damaged one is ignored.
fn schema_of(framed: &[u8]) -> Option<Schema> {
    let message = match framed.get(..4)? == [0xff; 4] {
        true => framed.get(8..)?,
        false => framed.get(4..)?,
    };
    super::arrow::schema(message)
}

fn is_duration(column: &ColumnDescriptor, arrow: Option<&DataType>) -> bool {
    matches!(column.logical_type_ref(), Some(LogicalType::Time(_)))
        || (column.logical_type_ref().is_none() && matches!(arrow, Some(DataType::Duration(_))))
}

/// The unit of a column; `None` for a non-numeric one.
fn scale(column: &ColumnDescriptor, arrow: Option<&DataType>) -> Option<Scale> {
    if column.max_rep_level() > 0 {
        return None;
    }
    let parts = |unit: &Parts| match unit {
        Parts::MILLIS => 1e3,
        Parts::MICROS => 1e6,
        Parts::NANOS => 1e9,
    };
    match (column.physical_type(), column.logical_type_ref()) {
        (Physical::BOOLEAN | Physical::FLOAT | Physical::DOUBLE, _) => Some(Scale::One),
        (Physical::INT96, _) => Some(Scale::Since { origin: 0, per_second: 1e9 }),
        (Physical::FIXED_LEN_BYTE_ARRAY, Some(LogicalType::Float16)) => Some(Scale::Half),
        (
            Physical::BYTE_ARRAY | Physical::FIXED_LEN_BYTE_ARRAY,
            Some(LogicalType::Decimal(decimal)),
        ) => Some(Scale::Decimal(10_f64.powi(decimal.scale))),
        (Physical::BYTE_ARRAY | Physical::FIXED_LEN_BYTE_ARRAY, None)
            if column.converted_type() == ConvertedType::DECIMAL =>
        {
            Some(Scale::Decimal(10_f64.powi(column.type_scale())))
        }
        (Physical::BYTE_ARRAY | Physical::FIXED_LEN_BYTE_ARRAY, _) => None,
        (_, Some(LogicalType::Timestamp(time))) => {
            Some(Scale::Since { origin: 0, per_second: parts(&time.unit) })
        }
        (_, Some(LogicalType::Time(time))) => Some(Scale::Part(parts(&time.unit))),
        (_, Some(LogicalType::Decimal(decimal))) => Some(Scale::Part(10_f64.powi(decimal.scale))),
        (_, Some(LogicalType::Integer(whole))) if !whole.is_signed => Some(Scale::Unsigned),
        (_, Some(LogicalType::Integer(_))) => Some(Scale::One),
        (_, Some(_)) => None,
        (_, None) => match (column.converted_type(), arrow) {
            (ConvertedType::TIMESTAMP_MILLIS, _) => {
                Some(Scale::Since { origin: 0, per_second: 1e3 })
            }
            (ConvertedType::TIMESTAMP_MICROS, _) => {
                Some(Scale::Since { origin: 0, per_second: 1e6 })
            }
            (ConvertedType::TIME_MILLIS, _) => Some(Scale::Part(1e3)),
            (ConvertedType::TIME_MICROS, _) => Some(Scale::Part(1e6)),
            (ConvertedType::DECIMAL, _) => Some(Scale::Part(10_f64.powi(column.type_scale()))),
            (ConvertedType::UINT_8 | ConvertedType::UINT_16, _) => Some(Scale::Unsigned),
            (ConvertedType::UINT_32 | ConvertedType::UINT_64, _) => Some(Scale::Unsigned),
            (ConvertedType::DATE, _) => None,
            (_, Some(DataType::Duration(unit))) => Some(Scale::Part(parts_of(*unit))),
            _ => Some(Scale::One),
        },
    }
}

fn refused(source: &Source, place: impl std::fmt::Display, error: ParquetError) -> RecordingError {
    match error {
        ParquetError::NYI(found) => source.unsupported(found, WRITE_AGAIN),
        ParquetError::General(found) | ParquetError::EOF(found) => source.damaged(place, found),
        other => source.damaged(place, other),
    }
}

/// Position of a column within a row group.
struct Cursor {
    reader: ColumnReader,
    /// Rows of the group not decoded yet.
    left: usize,
    /// Definition level of a value that is present.
    present: i16,
    levels: Vec<i16>,
}

fn cursor(
    input: &Arc<Input>,
    metadata: &ParquetMetaData,
    group: usize,
    column: usize,
) -> Decoded<Cursor> {
    let group = metadata.row_group(group);
    let rows = usize::try_from(group.num_rows())
        .map_err(|_| ParquetError::General("a negative number of rows".into()))?;
    let chunk = group
        .columns()
        .get(column)
        .ok_or_else(|| ParquetError::General("a missing column chunk".into()))?;
    let descriptor = metadata.file_metadata().schema_descr().column(column);
    let present = descriptor.max_def_level();
    let pages = SerializedPageReader::new(input.clone(), chunk, rows, None)?;
    let reader = get_column_reader(descriptor, Box::new(pages));
    Ok(Cursor { reader, left: rows, present, levels: Vec::new() })
}

impl Cursor {
    /// Replaces the content of `numbers` by the next `rows` rows, all of which must exist.
    fn read(&mut self, rows: usize, scale: Scale, numbers: &mut Vec<f64>) -> Decoded<()> {
        let (present, levels) = (self.present, &mut self.levels);
        numbers.clear();
        match &mut self.reader {
            ColumnReader::DoubleColumnReader(reader) => {
                fill(reader, rows, present, levels, numbers)?
            }
            ColumnReader::FloatColumnReader(reader) => {
                convert(reader, rows, present, levels, numbers, f64::from)?
            }
            ColumnReader::BoolColumnReader(reader) => {
                convert(reader, rows, present, levels, numbers, |value| {
                    f64::from(u8::from(value))
                })?;
            }
            ColumnReader::Int32ColumnReader(reader) if scale == Scale::Unsigned => {
                convert(reader, rows, present, levels, numbers, |value| f64::from(value as u32))?;
            }
            ColumnReader::Int32ColumnReader(reader) => {
                convert(reader, rows, present, levels, numbers, |value| {
                    scale.number(i64::from(value))
                })?;
            }
            ColumnReader::Int64ColumnReader(reader) => {
                convert(reader, rows, present, levels, numbers, |value| scale.number(value))?;
            }
            ColumnReader::Int96ColumnReader(reader) => {
                convert(reader, rows, present, levels, numbers, |value| {
                    scale.number(value.to_nanos())
                })?;
            }
            ColumnReader::ByteArrayColumnReader(reader) if matches!(scale, Scale::Decimal(_)) => {
                convert(reader, rows, present, levels, numbers, |value| {
                    scale.number_of(value.data())
                })?;
            }
            ColumnReader::FixedLenByteArrayColumnReader(reader)
                if matches!(scale, Scale::Decimal(_) | Scale::Half) =>
            {
                convert(reader, rows, present, levels, numbers, |value| {
                    scale.number_of(value.data())
                })?;
            }
            _ => return Err(ParquetError::General("bytes where numbers should be".into())),
        }
        if numbers.len() < rows && present > 0 {
            spread(numbers, &self.levels, present);
        }
        if numbers.len() != rows {
            return Err(ParquetError::General(format!("{} of {rows} rows", numbers.len())));
        }
        self.left -= rows;
        Ok(())
    }

    /// The first integer that is not null.
    fn first_whole(&mut self) -> Decoded<Option<i64>> {
        while self.left > 0 {
            let rows = self.left.min(BATCH_ROWS);
            let (present, levels) = (self.present, &mut self.levels);
            let mut found = Vec::new();
            match &mut self.reader {
                ColumnReader::Int64ColumnReader(reader) => {
                    fill(reader, rows, present, levels, &mut found)?
                }
                ColumnReader::Int32ColumnReader(reader) => {
                    let mut values = Vec::new();
                    fill(reader, rows, present, levels, &mut values)?;
                    found.extend(values.first().map(|&value| i64::from(value)));
                }
                ColumnReader::Int96ColumnReader(reader) => {
                    let mut values = Vec::new();
                    fill(reader, rows, present, levels, &mut values)?;
                    found.extend(values.first().map(parquet::data_type::Int96::to_nanos));
                }
                _ => {}
            }
            let found = found.first().copied();
            if found.is_some() {
                return Ok(found);
            }
            self.left -= rows;
        }
        Ok(None)
    }
}

/// Decodes `rows` rows of another type into numbers.
fn convert<T: parquet::data_type::DataType>(
    reader: &mut ColumnReaderImpl<T>,
    rows: usize,
    present: i16,
    levels: &mut Vec<i16>,
    numbers: &mut Vec<f64>,
    number: impl Fn(T::T) -> f64,
) -> Decoded<()> {
    let mut values = Vec::with_capacity(rows);
    fill(reader, rows, present, levels, &mut values)?;
    numbers.extend(values.into_iter().map(number));
    Ok(())
}

/// Decodes `rows` rows; null values are omitted and have a level below `present` in `levels`.
fn fill<T: parquet::data_type::DataType>(
    reader: &mut ColumnReaderImpl<T>,
    rows: usize,
    present: i16,
    levels: &mut Vec<i16>,
    values: &mut Vec<T::T>,
) -> Decoded<()> {
    values.reserve_exact(rows);
    levels.clear();
    let mut done = 0;
    while done < rows {
        let definition = (present > 0).then_some(&mut *levels);
        let (records, _, _) = reader.read_records(rows - done, definition, None, values)?;
        if records == 0 {
            return Err(ParquetError::General(format!("{done} of {rows} rows")));
        }
        done += records;
    }
    Ok(())
}

/// Moves values to their rows, starting with the last, and inserts NaN between them.
fn spread(numbers: &mut Vec<f64>, levels: &[i16], present: i16) {
    let mut from = numbers.len();
    numbers.resize(levels.len(), f64::NAN);
    for (to, &level) in levels.iter().enumerate().rev() {
        if level < present {
            numbers[to] = f64::NAN;
        } else if let Some(at) = from.checked_sub(1) {
            numbers[to] = numbers[at];
            from = at;
        }
    }
}

/// A row group being read: one cursor for each column.
type Group = (usize, Vec<Cursor>);

/// Batches of one column of one row group, and the fault that ended them.
type Pieces = (Vec<Vec<f64>>, Option<ParquetError>);

/// Rows of some columns, one row group after the other.
struct Groups {
    source: Source,
    input: Arc<Input>,
    metadata: Arc<ParquetMetaData>,
    columns: Vec<(usize, Scale)>,
    next_group: usize,
    unfinished: Option<Group>,
    /// Decoded batches: one vector for each column.
    ready: VecDeque<Vec<Vec<f64>>>,
    /// Memory of returned batches for reuse: new memory costs more than decoding into it.
    spare: Mutex<Vec<Vec<f64>>>,
    /// The error that ends the rows, once `ready` has been returned.
    failed: Option<RecordingError>,
    /// Rows decoded so far.
    rows: u64,
}

impl Groups {
    /// Decodes the next row groups, or the next part of one that exceeds the limit for decoding
    /// ahead.
    fn decode(&mut self) -> Result<(), RecordingError> {
        let ahead = (AHEAD / self.columns.len().max(1)).max(BATCH_ROWS);
        let mut groups = self.begin(ahead)?;
        let scales: Vec<Scale> = self.columns.iter().map(|&(_, scale)| scale).collect();
        let tasks: Vec<(&mut Cursor, Scale)> = groups
            .iter_mut()
            .flat_map(|(_, cursors)| cursors.iter_mut().zip(scales.iter().copied()))
            .collect();
        let spare = &self.spare;
        let decode = |(cursor, scale)| pieces(cursor, scale, ahead, spare);
        let pieces: Vec<Pieces> = tasks.into_par_iter().map(decode).collect();
        let mut pieces = pieces.into_iter();
        for (group, cursors) in groups {
            let columns: Vec<Pieces> = pieces.by_ref().take(cursors.len()).collect();
            if !self.queue(group, columns) {
                return Ok(());
            }
            if cursors.iter().any(|cursor| cursor.left > 0) {
                self.unfinished = Some((group, cursors));
            }
        }
        Ok(())
    }

    /// Row groups to decode together; at least one, if any is left.
    fn begin(&mut self, ahead: usize) -> Result<Vec<Group>, RecordingError> {
        if let Some(group) = self.unfinished.take() {
            return Ok(vec![group]);
        }
        let mut groups = Vec::new();
        let mut rows = 0;
        while self.next_group < self.metadata.num_row_groups() {
            let index = self.next_group;
            let size =
                usize::try_from(self.metadata.row_group(index).num_rows()).unwrap_or(usize::MAX);
            if !groups.is_empty() && size > ahead.saturating_sub(rows) {
                break;
            }
            let cursor =
                |&(column, _): &(usize, Scale)| cursor(&self.input, &self.metadata, index, column);
            let cursors: Decoded<Vec<Cursor>> = self.columns.iter().map(cursor).collect();
            groups.push((index, cursors.map_err(|error| self.fault(index, None, error))?));
            self.next_group += 1;
            rows += size.min(ahead);
        }
        Ok(groups)
    }

    /// Queues decoded rows as far as all columns have them; `false` if an error ends them.
    fn queue(&mut self, group: usize, columns: Vec<Pieces>) -> bool {
        let whole = columns.iter().map(|(batches, _)| batches.len()).min().unwrap_or(0);
        let mut faults = Vec::new();
        let mut columns: Vec<_> = columns
            .into_iter()
            .enumerate()
            .map(|(k, (batches, fault))| {
                faults.extend(fault.map(|fault| (k, fault)));
                batches.into_iter()
            })
            .collect();
        for _ in 0..whole {
            let batch: Vec<Vec<f64>> = columns.iter_mut().filter_map(Iterator::next).collect();
            self.rows += batch.first().map_or(0, Vec::len) as u64;
            self.ready.push_back(batch);
        }
        let Some((k, fault)) = faults.into_iter().next() else { return true };
        self.failed = Some(self.fault(group, Some(self.columns[k].0), fault));
        false
    }

    fn fault(&self, group: usize, column: Option<usize>, error: ParquetError) -> RecordingError {
        let schema = self.metadata.file_metadata().schema_descr();
        let name =
            column.map(|column| format!(", column {}", schema.column(column).path().string()));
        refused(
            &self.source,
            format!("row group {group}{}, rows from {}", name.unwrap_or_default(), self.rows),
            error,
        )
    }
}

impl Batches for Groups {
    fn next(&mut self, columns: &mut [Vec<f64>]) -> Result<bool, RecordingError> {
        columns.iter_mut().for_each(Vec::clear);
        while self.ready.is_empty() {
            if let Some(error) = self.failed.take() {
                self.next_group = self.metadata.num_row_groups();
                self.unfinished = None;
                return Err(error);
            }
            if self.unfinished.is_none() && self.next_group >= self.metadata.num_row_groups() {
                return Ok(false);
            }
            self.decode()?;
        }
        for (column, batch) in columns.iter_mut().zip(self.ready.pop_front().unwrap_or_default()) {
            let handed_back = std::mem::replace(column, batch);
            if handed_back.capacity() > 0 {
                self.spare.get_mut().unwrap_or_else(PoisonError::into_inner).push(handed_back);
            }
        }
        Ok(true)
    }
}

/// Decodes up to `ahead` rows in batches; also returns the error that ended them early. Memory
/// comes from `spare` first.
fn pieces(cursor: &mut Cursor, scale: Scale, ahead: usize, spare: &Mutex<Vec<Vec<f64>>>) -> Pieces {
    let mut batches = Vec::new();
    let mut rows = 0;
    while cursor.left > 0 && rows < ahead {
        let batch = cursor.left.min(BATCH_ROWS);
        let mut numbers =
            spare.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default();
        // The decoders may panic on damaged files.
        let read = || cursor.read(batch, scale, &mut numbers);
        let read = std::panic::catch_unwind(std::panic::AssertUnwindSafe(read));
        let panicked = |_| Err(ParquetError::General("a page that cannot be decoded".into()));
        if let Err(error) = read.unwrap_or_else(panicked) {
            cursor.left = 0;
            return (batches, Some(error));
        }
        batches.push(numbers);
        rows += batch;
    }
    (batches, None)
}
