//! Arrow files (Feather version 2) and streams, one table each, and the numbers of Arrow's columns.
//!
//! Timestamps become seconds since the column's first, durations and times of day become seconds,
//! nulls become NaN. Memory: one record batch, whose compressed buffers have to be as long as they
//! state (key ARROWIPC in SOURCES.md).

use std::collections::{HashMap, VecDeque};
use std::fs::File;
use std::io::{self, Read};
use std::sync::Arc;

use arrow_array::cast::AsArray;
use arrow_array::types::{Float64Type, Int64Type};
use arrow_array::{Array, RecordBatch};
use arrow_cast::cast;
use arrow_ipc::convert::try_fb_to_schema;
use arrow_ipc::reader::RecordBatchDecoder;
use arrow_ipc::{
    CompressionType, Endianness, MessageHeader, MetadataVersion, root_as_footer, root_as_message,
};
use arrow_schema::{ArrowError, DataType, Metadata, Schema, SchemaRef, TimeUnit};

use super::{Source, read_exact_at};
use crate::RecordingError;
use crate::container::{BATCH_ROWS, Batches, Column, Container, Content, Opened, Table};

/// Marker before a message's length, since version 0.15.
const CONTINUED: [u8; 4] = [0xff; 4];

/// Bytes of the marker at both ends of a file, and of the length before the last one.
const MARK: u64 = 6;

/// Longest description of a record batch.
const LONGEST_MESSAGE: u64 = 1 << 26;

/// Bytes that one compressed byte is likely to become at most; LZ4 cannot exceed it.
const LIKELY: u64 = 256;

/// A record batch: positions of its message and its buffers.
#[derive(Debug, Clone, Copy)]
struct Block {
    at: u64,
    message: u64,
    body: u64,
}

/// An open file or stream.
#[derive(Debug, Clone)]
struct Arrow {
    source: Source,
    file: Arc<File>,
    blocks: Vec<Block>,
    schema: SchemaRef,
}

pub(crate) fn open(file: File, length: u64, source: Source) -> Result<Container, RecordingError> {
    let short = || source.damaged("the end", "no footer; the file ends early");
    let mut end = [0; 10];
    let at = length.checked_sub(10).ok_or_else(short)?;
    read_exact_at(&file, &mut end, at).map_err(|error| source.damaged("the end", error))?;
    if &end[4..] != b"ARROW1" {
        return Err(short());
    }
    let size = u64::from(u32::from_le_bytes([end[0], end[1], end[2], end[3]]));
    let from = at.checked_sub(size).ok_or_else(short)?;
    let mut bytes = vec![0; size as usize];
    read_exact_at(&file, &mut bytes, from).map_err(|error| source.damaged("the footer", error))?;
    let footer = root_as_footer(&bytes).map_err(|error| source.damaged("the footer", error))?;
    let schema = footer.schema().ok_or_else(|| source.damaged("the footer", "no schema"))?;
    check_byte_order(schema.endianness(), &source)?;
    let schema = try_fb_to_schema(schema).map_err(|error| source.damaged("the footer", error))?;
    let mut blocks = Vec::new();
    for block in footer.recordBatches().iter().flatten() {
        let parts = [block.offset(), i64::from(block.metaDataLength()), block.bodyLength()]
            .map(u64::try_from);
        let [Ok(at), Ok(message), Ok(body)] = parts else {
            return Err(source.damaged("the footer", "a record batch of negative size"));
        };
        if at
            .checked_add(message)
            .and_then(|end| end.checked_add(body))
            .is_none_or(|end| end > length - MARK)
        {
            return Err(source.damaged(
                "the footer",
                format!("a record batch at byte {at} beyond the end of the file"),
            ));
        }
        blocks.push(Block { at, message, body });
    }
    Arrow::of(file, blocks, schema, source)
}

/// A stream stored in a file: consecutive messages, the schema first.
pub(crate) fn stream(file: File, length: u64, source: Source) -> Result<Container, RecordingError> {
    let mut at = 0;
    let mut schema = None;
    let mut blocks = Vec::new();
    while at + 8 <= length {
        let mut tag = [0; 8];
        let place = format!("the message at byte {at}");
        read_exact_at(&file, &mut tag, at).map_err(|error| source.damaged(&place, error))?;
        let size = u64::from(u32::from_le_bytes([tag[4], tag[5], tag[6], tag[7]]));
        if tag[..4] != CONTINUED {
            return Err(source.damaged(place, "no message where one should begin"));
        }
        if size == 0 {
            // The mark of the end of a stream; what follows is no message.
            break;
        }
        let block = Block { at, message: 8 + size, body: 0 };
        let bytes = message(&file, block, length).map_err(|found| source.damaged(&place, found))?;
        let message = root_as_message(&bytes).map_err(|error| source.damaged(&place, error))?;
        let body = u64::try_from(message.bodyLength()).unwrap_or(u64::MAX);
        let end = (at + block.message).saturating_add(body);
        if end > length {
            return Err(source.damaged(place, "it ends beyond the end of the file"));
        }
        match message.header_type() {
            MessageHeader::Schema => {
                let own = message.header_as_schema();
                own.map_or(Ok(()), |own| check_byte_order(own.endianness(), &source))?;
                schema = own.map(try_fb_to_schema);
            }
            MessageHeader::RecordBatch => blocks.push(Block { body, ..block }),
            _ => {}
        }
        at = end;
    }
    let schema = schema.ok_or_else(|| source.damaged("the beginning", "no schema"))?;
    let schema = schema.map_err(|error| source.damaged("the schema", error))?;
    Arrow::of(file, blocks, schema, source)
}

impl Arrow {
    fn of(
        file: File,
        blocks: Vec<Block>,
        schema: Schema,
        source: Source,
    ) -> Result<Container, RecordingError> {
        let columns = schema.fields().iter().map(|field| Column {
            name: field.name().clone(),
            unit: unit_of(field.data_type(), field.metadata()),
            is_numeric: is_numeric(field.data_type()),
        });
        let mut table = Table::without_a_name(columns.collect());
        let (file, schema) = (Arc::new(file), Arc::new(schema));
        let arrow = Self { source: source.clone(), file, blocks, schema };
        table.rows = Some(arrow.rows()?);
        Ok(Container::new(source, vec![table], arrow))
    }

    fn rows(&self) -> Result<u64, RecordingError> {
        // The footer does not state them: each batch does.
        let mut rows = 0_u64;
        for (k, block) in self.blocks.iter().enumerate() {
            let bytes = self.message(k, *block)?;
            let (batch, _) = self.batch(k, &bytes)?;
            rows = rows.saturating_add(batch.length().unsigned_abs());
        }
        Ok(rows)
    }

    fn message(&self, k: usize, block: Block) -> Result<Vec<u8>, RecordingError> {
        let bytes = message(&self.file, block, block.at + block.message);
        bytes.map_err(|found| self.source.damaged(format!("record batch {k}"), found))
    }

    fn batch<'a>(
        &self,
        k: usize,
        bytes: &'a [u8],
    ) -> Result<(arrow_ipc::RecordBatch<'a>, MetadataVersion), RecordingError> {
        let place = format_args!("record batch {k}");
        let message = root_as_message(bytes).map_err(|error| self.source.damaged(place, error))?;
        let batch = message.header_as_record_batch();
        let batch =
            batch.ok_or_else(|| self.source.damaged(place, "another message in its place"))?;
        Ok((batch, message.version()))
    }
}

/// The description of a record batch, without its prefix.
fn message(file: &File, block: Block, limit: u64) -> Result<Vec<u8>, String> {
    if block.message < 8 || block.message > LONGEST_MESSAGE || block.at + block.message > limit {
        return Err(format!("a description of {} bytes", block.message));
    }
    let mut bytes = vec![0; block.message as usize];
    read_exact_at(file, &mut bytes, block.at).map_err(|error| error.to_string())?;
    let front = if bytes[..4] == CONTINUED { 8 } else { 4 };
    bytes.drain(..front);
    Ok(bytes)
}

impl Content for Arrow {
    fn dates(&self, _table: usize) -> Vec<usize> {
        let fields = self.schema.fields();
        (0..fields.len()).filter(|k| is_time(fields[*k].data_type())).collect()
    }

    fn open(&self, _at: usize, _table: &Table, columns: &[usize]) -> Opened {
        Ok(Box::new(Rows {
            arrow: self.clone(),
            wanted: columns.to_vec(),
            origins: vec![None; columns.len()],
            next: 0,
            ready: VecDeque::new(),
            row: 0,
        }))
    }
}

/// Refuses numbers in the byte order of other processors: they would be read as other numbers.
fn check_byte_order(order: Endianness, source: &Source) -> Result<(), RecordingError> {
    if order == Endianness::Little {
        return Ok(());
    }
    let hint = "read it with pyarrow, which swaps the bytes, and write it again there or as Parquet or CSV";
    Err(source.unsupported("numbers in big-endian byte order", hint))
}

/// The unit of a column: seconds of a time, or else what the field's metadata name.
pub(super) fn unit_of(kind: &DataType, metadata: &Metadata) -> Option<String> {
    if is_time(kind) {
        return Some("s".to_owned());
    }
    let mut metadata = metadata.iter();
    metadata
        .find(|(key, _)| matches!(key.to_lowercase().as_str(), "unit" | "units"))
        .map(|(_, unit)| unit.clone())
}

/// Whether a column of this type is read.
pub(super) fn is_numeric(kind: &DataType) -> bool {
    kind.is_numeric() || *kind == DataType::Boolean || is_time(kind)
}

/// Whether a column of this type is read as seconds.
pub(super) fn is_time(kind: &DataType) -> bool {
    units_per_second(kind).is_some()
}

fn units_per_second(kind: &DataType) -> Option<f64> {
    let (DataType::Timestamp(unit, _)
    | DataType::Duration(unit)
    | DataType::Time32(unit)
    | DataType::Time64(unit)) = kind
    else {
        return None;
    };
    Some(match unit {
        TimeUnit::Second => 1.0,
        TimeUnit::Millisecond => 1e3,
        TimeUnit::Microsecond => 1e6,
        TimeUnit::Nanosecond => 1e9,
    })
}

/// The first timestamp of a column; `None` if it has no timestamps.
pub(super) fn first_timestamp(array: &dyn Array) -> Result<Option<i64>, ArrowError> {
    let inner = innermost(array);
    if !matches!(inner.data_type(), DataType::Timestamp(..)) {
        return Ok(None);
    }
    let units = cast(inner, &DataType::Int64)?;
    let first = (0..array.len()).find(|row| is_present(array, *row));
    Ok(first.map(|row| units.as_primitive::<Int64Type>().value(row)))
}

/// Appends the numbers of a column; timestamps are counted from `origin`.
pub(super) fn append(
    array: &dyn Array,
    origin: Option<i64>,
    numbers: &mut Vec<f64>,
) -> Result<(), ArrowError> {
    let first = numbers.len();
    let inner = innermost(array);
    match units_per_second(inner.data_type()) {
        None => {
            let cells = cast(inner, &DataType::Float64)?;
            numbers.extend_from_slice(cells.as_primitive::<Float64Type>().values());
        }
        Some(per_second) => {
            let units = cast(inner, &DataType::Int64)?;
            // The origin is subtracted before digits are lost: nanoseconds since 1970 need more
            // than the 53 bits of an f64.
            let origin = origin.unwrap_or(0);
            let units = units.as_primitive::<Int64Type>().values().iter();
            numbers.extend(units.map(|units| units.saturating_sub(origin) as f64 / per_second));
        }
    }
    blank(array, &mut numbers[first..]);
    Ok(())
}

/// The column inside structures of one member each, or the column itself.
fn innermost(mut array: &dyn Array) -> &dyn Array {
    while let Some(outer) = array.as_struct_opt() {
        array = outer.column(0);
    }
    array
}

/// Whether neither a cell nor a structure around it is null.
fn is_present(array: &dyn Array, row: usize) -> bool {
    array.is_valid(row)
        && array.as_struct_opt().is_none_or(|outer| is_present(outer.column(0), row))
}

/// Writes NaN in place of nulls.
fn blank(array: &dyn Array, numbers: &mut [f64]) {
    if array.null_count() > 0 {
        let cells = numbers.iter_mut().enumerate();
        cells.filter(|(row, _)| array.is_null(*row)).for_each(|(_, number)| *number = f64::NAN);
    }
    if let Some(outer) = array.as_struct_opt() {
        blank(outer.column(0), numbers);
    }
}

/// Rows of some columns, one record batch after the other.
struct Rows {
    arrow: Arrow,
    wanted: Vec<usize>,
    /// The first timestamp of each column, once it is known.
    origins: Vec<Option<i64>>,
    next: usize,
    ready: VecDeque<Vec<Vec<f64>>>,
    row: u64,
}

impl Batches for Rows {
    fn next(&mut self, columns: &mut [Vec<f64>]) -> Result<bool, RecordingError> {
        columns.iter_mut().for_each(Vec::clear);
        while self.ready.is_empty() {
            let Some(block) = self.arrow.blocks.get(self.next).copied() else { return Ok(false) };
            self.decode(block)?;
            self.next += 1;
        }
        for (column, batch) in columns.iter_mut().zip(self.ready.pop_front().unwrap_or_default()) {
            *column = batch;
        }
        Ok(true)
    }
}

impl Rows {
    fn decode(&mut self, block: Block) -> Result<(), RecordingError> {
        let place = format!("record batch {}, rows from {}", self.next, self.row);
        let source = self.arrow.source.clone();
        let batch = source.guard(&place, || self.read(block, &place))?;
        let mut columns = vec![Vec::with_capacity(batch.num_rows()); self.wanted.len()];
        for ((array, origin), numbers) in
            batch.columns().iter().zip(&mut self.origins).zip(&mut columns)
        {
            let known = match *origin {
                None => first_timestamp(array),
                known => Ok(known),
            };
            *origin = known.map_err(|error| source.damaged(&place, error))?;
            append(array, *origin, numbers).map_err(|error| source.damaged(&place, error))?;
        }
        let rows = batch.num_rows();
        for from in (0..rows).step_by(BATCH_ROWS) {
            let to = rows.min(from + BATCH_ROWS);
            let piece = match to - from == rows {
                true => std::mem::take(&mut columns),
                false => columns.iter().map(|column| column[from..to].to_vec()).collect(),
            };
            self.ready.push_back(piece);
        }
        self.row += rows as u64;
        Ok(())
    }

    fn read(&self, block: Block, place: &str) -> Result<RecordBatch, RecordingError> {
        let arrow = &self.arrow;
        let bytes = arrow.message(self.next, block)?;
        let (batch, version) = arrow.batch(self.next, &bytes)?;
        let mut body = vec![0; block.body as usize];
        read_exact_at(&arrow.file, &mut body, block.at + block.message)
            .map_err(|error| arrow.source.damaged(place, error))?;
        check_lengths(&batch, &body).map_err(|found| arrow.source.damaged(place, found))?;
        // Columns of dictionaries are not read.
        let (body, dictionaries) = (body.into(), HashMap::new());
        RecordBatchDecoder::try_new(&body, batch, arrow.schema.clone(), &dictionaries, &version)
            .and_then(|decoder| decoder.with_projection(Some(&self.wanted)).read_record_batch())
            .map_err(|error| arrow.source.damaged(place, error))
    }
}

/// Refuses a batch whose buffers, decompressed, are not of the length that they state: the decoder
/// reserves it.
fn check_lengths(batch: &arrow_ipc::RecordBatch<'_>, body: &[u8]) -> Result<(), String> {
    let Some(codec) = batch.compression().map(|compression| compression.codec()) else {
        return Ok(());
    };
    for buffer in batch.buffers().into_iter().flatten() {
        let from = usize::try_from(buffer.offset()).unwrap_or(usize::MAX);
        let length = usize::try_from(buffer.length()).unwrap_or(usize::MAX);
        let bytes = body.get(from..from.saturating_add(length));
        let bytes = bytes.ok_or("a buffer beyond its record batch")?;
        let Some((stated, compressed)) = bytes.split_first_chunk() else { continue };
        let stated = u64::try_from(i64::from_le_bytes(*stated)).unwrap_or(0);
        if stated > LIKELY * compressed.len() as u64
            && (codec != CompressionType::ZSTD || unpacked(compressed, stated) != stated)
        {
            return Err(format!("a buffer that is not of {stated} bytes when decompressed"));
        }
    }
    Ok(())
}

/// Number of bytes in zstd frames, up to `most`.
fn unpacked(compressed: &[u8], most: u64) -> u64 {
    zstd::Decoder::with_buffer(compressed)
        .and_then(|decoder| io::copy(&mut decoder.take(most), &mut io::sink()))
        .unwrap_or(0)
}
