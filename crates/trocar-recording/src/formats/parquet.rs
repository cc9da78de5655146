//! Parquet files, one table each: column chunks decoded on all cores, straight into numbers.
//!
//! Memory: [`BATCH_ROWS`] rows of each column, and one page of each chunk being read.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::sync::Arc;

use arrow_schema::{DataType, Field, Fields};
use parquet::arrow::ProjectionMask;
use parquet::arrow::arrow_reader::{
    ArrowReaderMetadata, ArrowReaderOptions, ParquetRecordBatchReader,
    ParquetRecordBatchReaderBuilder,
};
use parquet::basic::Compression;
use parquet::errors::{ParquetError, Result as Decoded};
use parquet::file::metadata::{ParquetMetaData, ParquetMetaDataReader};
use parquet::file::reader::{ChunkReader, Length};
use rayon::prelude::*;

use super::arrow::{append, first_timestamp, is_numeric, is_time, unit_of};
use super::{Source, read_at, read_exact_at};
use crate::RecordingError;
use crate::container::{BATCH_ROWS, Batches, Column, Container, Content, Opened, Table};

mod thrift;

/// Rows decoded at a time: they fit into the processor's caches.
const PIECE_ROWS: usize = 1 << 14;

const WRITE_AGAIN: &str = "write it again with snappy, gzip, zstd or no compression";

/// Bytes of a page header that are checked; longer ones hold long texts.
const HEADER: usize = 1 << 13;

/// The file's bytes for several concurrent readers.
#[derive(Debug, Clone)]
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
struct Parquet {
    source: Source,
    input: Input,
    metadata: ArrowReaderMetadata,
    /// Columns of timestamps, durations and times of day.
    times: Vec<usize>,
}

pub(crate) fn open(file: File, length: u64, source: Source) -> Result<Container, RecordingError> {
    let input = Input { file: Arc::new(file), length };
    let metadata = source.guard("the footer", || {
        read_metadata(&input).map_err(|error| refused(&source, "the footer", error))
    })?;
    let mut columns = Vec::new();
    let mut times = Vec::new();
    for column in metadata.parquet_schema().columns() {
        let field = leaf(metadata.schema().fields(), column.path().parts());
        times.extend(field.filter(|field| is_time(field.data_type())).map(|_| columns.len()));
        columns.push(Column {
            name: column.path().string(),
            unit: field.and_then(|field| unit_of(field.data_type(), field.metadata())),
            is_numeric: field.is_some_and(|field| is_numeric(field.data_type())),
        });
    }
    let rows = u64::try_from(metadata.metadata().file_metadata().num_rows());
    let rows = rows.map_err(|_| source.damaged("the footer", "a negative number of rows"))?;
    let table = Table { rows: Some(rows), ..Table::without_a_name(columns) };
    let content = Parquet { source: source.clone(), input, metadata, times };
    Ok(Container::new(source, vec![table], content))
}

impl Parquet {
    /// Rows of each row group, if the file is large enough for them: at most 64 per byte.
    fn group_rows(&self) -> Option<Vec<usize>> {
        let groups = self.metadata.metadata().row_groups();
        let rows = groups.iter().map(|group| usize::try_from(group.num_rows()).ok());
        let rows: Vec<usize> = rows.collect::<Option<_>>()?;
        let all = rows.iter().try_fold(0_usize, |all, rows| all.checked_add(*rows))?;
        (all as u64 <= self.input.length.saturating_mul(64)).then_some(rows)
    }

    /// What is read of each column.
    fn wanted(&self, table: &Table, columns: &[usize]) -> Result<Vec<Wanted>, RecordingError> {
        columns.iter().map(|&column| self.one_wanted(column, &table.columns[column].name)).collect()
    }

    fn one_wanted(&self, column: usize, name: &str) -> Result<Wanted, RecordingError> {
        let groups = self.metadata.metadata().row_groups();
        for chunk in groups.iter().filter_map(|group| group.columns().get(column)) {
            // Neither is compiled in: named here, not in the middle of the file.
            let packing = chunk.compression();
            if matches!(packing, Compression::BROTLI(_) | Compression::LZO) {
                let found = format!("{packing} compression");
                return Err(self.source.unsupported(found, WRITE_AGAIN));
            }
        }
        let mut wanted = Wanted {
            source: self.source.clone(),
            input: self.input.clone(),
            metadata: self.metadata.clone(),
            column,
            name: name.to_owned(),
            origin: None,
        };
        for group in 0..groups.len() {
            if wanted.origin.is_none() && self.times.contains(&column) {
                wanted.origin =
                    wanted.guard(wanted.place(group), || wanted.first_timestamp(group))?;
            }
        }
        Ok(wanted)
    }
}

impl Content for Parquet {
    fn dates(&self, _table: usize) -> Vec<usize> {
        self.times.clone()
    }

    fn open(&self, _at: usize, table: &Table, columns: &[usize]) -> Opened {
        let cursors =
            self.wanted(table, columns)?.into_iter().map(|wanted| Cursor { wanted, open: None });
        let groups = self.metadata.metadata().row_groups().iter();
        let rows = groups.map(|group| usize::try_from(group.num_rows()).unwrap_or(0)).collect();
        Ok(Box::new(Groups { cursors: cursors.collect(), rows, group: 0, read: 0, all_read: 0 }))
    }

    fn read_whole(
        &self,
        table: &Table,
        columns: &[usize],
    ) -> Result<Option<Vec<Vec<f64>>>, RecordingError> {
        let Some(groups) = self.group_rows() else { return Ok(None) };
        let wanted = self.wanted(table, columns)?;
        let rows = groups.iter().sum();
        let mut all: Vec<Vec<f64>> = columns.iter().map(|_| vec![0.0; rows]).collect();
        let mut parts = Vec::new();
        for (wanted, numbers) in wanted.iter().zip(&mut all) {
            let mut rest = numbers.as_mut_slice();
            for (group, &rows) in groups.iter().enumerate() {
                let (numbers, others) = rest.split_at_mut(rows);
                parts.push((wanted, group, numbers));
                rest = others;
            }
        }
        parts.into_par_iter().try_for_each(|(wanted, group, numbers)| {
            wanted.guard(wanted.place(group), || wanted.read_group(group, numbers))
        })?;
        Ok(Some(all))
    }
}

fn read_metadata(input: &Input) -> Decoded<ArrowReaderMetadata> {
    input.check_footer()?;
    let metadata: Arc<ParquetMetaData> =
        Arc::new(ParquetMetaDataReader::new().parse_and_finish(input)?);
    let plain = ArrowReaderOptions::new();
    // The schema of Arrow's writers is optional: the file can be read without it.
    ArrowReaderMetadata::try_new(metadata.clone(), plain.clone())
        .or_else(|_| ArrowReaderMetadata::try_new(metadata, plain.with_skip_arrow_metadata(true)))
}

/// The field at the end of a path of structures.
fn leaf<'a>(fields: &'a Fields, path: &[String]) -> Option<&'a Field> {
    let (name, rest) = path.split_first()?;
    let (_, field) = fields.find(name)?;
    match field.data_type() {
        DataType::Struct(fields) => leaf(fields, rest),
        _ => rest.is_empty().then_some(field.as_ref()),
    }
}

fn refused(source: &Source, place: impl std::fmt::Display, error: ParquetError) -> RecordingError {
    match error {
        ParquetError::NYI(found) => source.unsupported(found, WRITE_AGAIN),
        ParquetError::General(found) | ParquetError::EOF(found) => source.damaged(place, found),
        other => source.damaged(place, other),
    }
}

/// A column to be read.
struct Wanted {
    source: Source,
    input: Input,
    metadata: ArrowReaderMetadata,
    column: usize,
    name: String,
    /// The first timestamp of a column of timestamps.
    origin: Option<i64>,
}

impl Wanted {
    fn place(&self, group: usize) -> String {
        format!("row group {group}, column {}", self.name)
    }

    /// Locates errors; the decoders may panic on damaged files.
    fn guard<T>(
        &self,
        place: String,
        read: impl FnOnce() -> Decoded<T>,
    ) -> Result<T, RecordingError> {
        self.source.guard(&place, || read().map_err(|error| refused(&self.source, &place, error)))
    }

    fn reader(&self, group: usize) -> Decoded<ParquetRecordBatchReader> {
        let mask = ProjectionMask::leaves(self.metadata.parquet_schema(), [self.column]);
        ParquetRecordBatchReaderBuilder::new_with_metadata(
            self.input.clone(),
            self.metadata.clone(),
        )
        .with_row_groups(vec![group])
        .with_projection(mask)
        .with_batch_size(PIECE_ROWS)
        .build()
    }

    fn first_timestamp(&self, group: usize) -> Decoded<Option<i64>> {
        for batch in self.reader(group)? {
            let first = first_timestamp(batch?.column(0))?;
            if first.is_some() {
                return Ok(first);
            }
        }
        Ok(None)
    }

    /// Appends the next rows of a row group, at most `rows`, which must exist.
    fn read(
        &self,
        reader: &mut ParquetRecordBatchReader,
        rows: usize,
        numbers: &mut Vec<f64>,
    ) -> Decoded<()> {
        let end = numbers.len() + rows;
        while numbers.len() < end {
            let Some(batch) = reader.next() else { break };
            append(batch?.column(0), self.origin, numbers)?;
        }
        if numbers.len() != end {
            let found = numbers.len() + rows - end;
            return Err(ParquetError::General(format!("{found} of {rows} rows")));
        }
        Ok(())
    }

    /// The same with the reader that an earlier call has left in `open`, if it is of this row group.
    fn read_on(
        &self,
        open: &mut Option<(usize, ParquetRecordBatchReader)>,
        group: usize,
        rows: usize,
        numbers: &mut Vec<f64>,
    ) -> Decoded<()> {
        // A reader that has failed is not used again.
        let mut reader = match open.take() {
            Some((of, reader)) if of == group => reader,
            _ => self.reader(group)?,
        };
        self.read(&mut reader, rows, numbers)?;
        *open = Some((group, reader));
        Ok(())
    }

    fn read_group(&self, group: usize, numbers: &mut [f64]) -> Decoded<()> {
        let mut reader = self.reader(group)?;
        let mut piece = Vec::new();
        for numbers in numbers.chunks_mut(PIECE_ROWS) {
            piece.clear();
            self.read(&mut reader, numbers.len(), &mut piece)?;
            numbers.copy_from_slice(&piece);
        }
        Ok(())
    }
}

/// Position in a column.
struct Cursor {
    wanted: Wanted,
    /// The row group being read.
    open: Option<(usize, ParquetRecordBatchReader)>,
}

/// Rows of some columns, one row group after the other.
struct Groups {
    cursors: Vec<Cursor>,
    /// Rows of each group.
    rows: Vec<usize>,
    group: usize,
    /// Rows of the group, and of the file, that were read.
    read: usize,
    all_read: u64,
}

impl Batches for Groups {
    fn next(&mut self, columns: &mut [Vec<f64>]) -> Result<bool, RecordingError> {
        columns.iter_mut().for_each(Vec::clear);
        while self.rows.get(self.group) == Some(&self.read) {
            self.group += 1;
            self.read = 0;
        }
        let Some(rows) = self.rows.get(self.group) else { return Ok(false) };
        let (group, rows) = (self.group, (rows - self.read).min(BATCH_ROWS));
        let from = self.all_read;
        let read =
            self.cursors.par_iter_mut().zip(&mut *columns).try_for_each(|(cursor, numbers)| {
                let Cursor { wanted, open } = cursor;
                let place = format!("{}, rows from {from}", wanted.place(group));
                wanted.guard(place, || wanted.read_on(open, group, rows, numbers))
            });
        if read.is_err() {
            // Some columns may have gone on: rows after this would be put together wrongly.
            columns.iter_mut().for_each(Vec::clear);
            self.group = self.rows.len();
        }
        self.read += rows;
        self.all_read += rows as u64;
        read.map(|()| true)
    }
}
