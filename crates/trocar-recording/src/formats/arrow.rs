//! Arrow files (Feather version 2) and streams, one table each: numbers are read unchanged from
//! record batches, which may be compressed by LZ4 or zstd (key ARROWIPC in SOURCES.md).
//!
//! Only the requested columns are read and decompressed. Timestamps become seconds since the
//! column's first, durations and times of day become seconds, nulls become NaN. Memory: the buffers
//! of one record batch, limited by its number of rows.

use std::collections::VecDeque;
use std::fs::File;
use std::io::Read;

use arrow_ipc::convert::try_fb_to_schema;
use arrow_ipc::{
    CompressionType, Endianness, MessageHeader, RecordBatch, root_as_footer, root_as_message,
};
use arrow_schema::{DataType, Metadata, Schema, TimeUnit, UnionMode};

use super::scale::Scale;
use super::{Source, read_exact_at};
use crate::RecordingError;
use crate::container::{BATCH_ROWS, Batches, Column, Container, Table};

/// Marker before a message's length, since version 0.15.
const CONTINUED: [u8; 4] = [0xff; 4];

/// Bytes of the marker at both ends of a file, and of the length before the last one.
const MARK: u64 = 6;

/// Longest description of a record batch.
const LONGEST_MESSAGE: u64 = 1 << 26;

/// Most rows of a record batch: more would not fit into any memory.
const MOST_ROWS: usize = 1 << 40;

/// A record batch: positions of its message and its buffers.
#[derive(Debug, Clone, Copy)]
struct Block {
    at: u64,
    message: u64,
    body: u64,
}

/// An open file or stream.
#[derive(Debug)]
pub(crate) struct Arrow {
    source: Source,
    file: std::sync::Arc<File>,
    blocks: Vec<Block>,
    tables: [Table; 1],
    fields: Vec<Field>,
}

/// Layout of a column in a record batch.
#[derive(Debug, Clone)]
struct Field {
    /// Whether its numbers are times, in s.
    is_time: bool,
    /// Its position among the nodes and buffers of all columns.
    start: Extent,
    /// `None` if it is not numeric.
    kind: Option<(Width, Scale)>,
}

/// Space of columns in a record batch: nodes, buffers, and views, for which each batch states a
/// number of additional buffers.
#[derive(Debug, Clone, Copy, Default)]
struct Extent {
    nodes: usize,
    buffers: usize,
    views: usize,
}

impl Extent {
    const fn new(nodes: usize, buffers: usize, views: usize) -> Self {
        Self { nodes, buffers, views }
    }

    fn and(self, other: Self) -> Self {
        Self::new(self.nodes + other.nodes, self.buffers + other.buffers, self.views + other.views)
    }
}

/// Storage type of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Width {
    Bool,
    I8,
    I16,
    I32,
    I64,
    U8,
    U16,
    U32,
    U64,
    F32,
    F64,
}

impl Width {
    /// Size of `rows` of them in bytes.
    fn bytes(self, rows: usize) -> usize {
        match self {
            Self::Bool => rows.div_ceil(8),
            Self::I8 | Self::U8 => rows,
            Self::I16 | Self::U16 => 2 * rows,
            Self::I32 | Self::U32 | Self::F32 => 4 * rows,
            Self::I64 | Self::U64 | Self::F64 => 8 * rows,
        }
    }
}

impl Arrow {
    pub(crate) fn open(file: File, length: u64, source: Source) -> Result<Self, RecordingError> {
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
        read_exact_at(&file, &mut bytes, from)
            .map_err(|error| source.damaged("the footer", error))?;
        let footer = root_as_footer(&bytes).map_err(|error| source.damaged("the footer", error))?;
        let schema = footer.schema().ok_or_else(|| source.damaged("the footer", "no schema"))?;
        check_byte_order(schema.endianness(), &source)?;
        let schema =
            try_fb_to_schema(schema).map_err(|error| source.damaged("the footer", error))?;
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
        Self::of(file, blocks, &schema, source)
    }

    /// A stream stored in a file: consecutive messages, the schema first.
    pub(crate) fn stream(file: File, length: u64, source: Source) -> Result<Self, RecordingError> {
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
                break;
            }
            let block = Block { at, message: 8 + size, body: 0 };
            let bytes =
                message(&file, block, length).map_err(|found| source.damaged(&place, found))?;
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
        Self::of(file, blocks, &schema, source)
    }

    fn of(
        file: File,
        blocks: Vec<Block>,
        schema: &Schema,
        source: Source,
    ) -> Result<Self, RecordingError> {
        let mut start = Extent::default();
        let mut fields = Vec::new();
        let mut columns = Vec::new();
        for field in schema.fields() {
            let (kind, is_time) = (kind(field.data_type()), is_time(field.data_type()));
            columns.push(Column {
                name: field.name().clone(),
                unit: if is_time { Some("s".into()) } else { unit_of(field.metadata()) },
                is_numeric: kind.is_some(),
            });
            fields.push(Field { is_time, start, kind });
            start = start.and(extent(field.data_type()));
        }
        let table = Table { name: String::new(), kind: String::new(), rows: None, columns };
        let mut arrow = Self { source, file: file.into(), blocks, tables: [table], fields };
        arrow.tables[0].rows = Some(arrow.rows()?);
        Ok(arrow)
    }

    fn rows(&self) -> Result<u64, RecordingError> {
        let mut rows = 0_u64;
        for (k, block) in self.blocks.iter().enumerate() {
            let bytes = self.message(k, *block)?;
            rows = rows.saturating_add(self.batch(k, &bytes)?.length().unsigned_abs());
        }
        Ok(rows)
    }

    fn message(&self, k: usize, block: Block) -> Result<Vec<u8>, RecordingError> {
        let bytes = message(&self.file, block, block.at + block.message);
        bytes.map_err(|found| self.source.damaged(format!("record batch {k}"), found))
    }

    fn batch<'a>(&self, k: usize, bytes: &'a [u8]) -> Result<RecordBatch<'a>, RecordingError> {
        let damaged =
            |found: &dyn std::fmt::Display| self.source.damaged(format!("record batch {k}"), found);
        let message = root_as_message(bytes).map_err(|error| damaged(&error))?;
        message.header_as_record_batch().ok_or_else(|| damaged(&"another message in its place"))
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

impl Container for Arrow {
    fn format(&self) -> &'static str {
        self.source.format
    }

    fn tables(&self) -> &[Table] {
        &self.tables
    }

    fn dates(&self, _table: usize) -> Vec<usize> {
        (0..self.fields.len()).filter(|k| self.fields[*k].is_time).collect()
    }

    fn open(&self, _table: usize, columns: &[usize]) -> Result<Box<dyn Batches>, RecordingError> {
        let field = |&column: &usize| {
            let Column { name, .. } = &self.tables[0].columns[column];
            let field = &self.fields[column];
            let (width, scale) = field.kind.ok_or_else(|| self.source.not_numeric(name))?;
            Ok(Wanted { name: name.clone(), start: field.start, width, scale, anchored: false })
        };
        let arrow = Self {
            source: self.source.clone(),
            file: self.file.clone(),
            blocks: self.blocks.clone(),
            tables: self.tables.clone(),
            fields: Vec::new(),
        };
        let wanted = columns.iter().map(field).collect::<Result<_, RecordingError>>()?;
        Ok(Box::new(Rows { arrow, wanted, next: 0, ready: VecDeque::new(), row: 0 }))
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

/// The schema in a message.
#[cfg(feature = "parquet")]
pub(super) fn schema(message: &[u8]) -> Option<Schema> {
    try_fb_to_schema(root_as_message(message).ok()?.header_as_schema()?).ok()
}

/// The unit named in a field's metadata.
pub(super) fn unit_of(metadata: &Metadata) -> Option<String> {
    let named = |key: &str| matches!(key.to_lowercase().as_str(), "unit" | "units");
    metadata.iter().find(|(key, _)| named(key)).map(|(_, unit)| unit.clone())
}

/// Number of units per second.
pub(super) fn parts_of(unit: TimeUnit) -> f64 {
    match unit {
        TimeUnit::Second => 1.0,
        TimeUnit::Millisecond => 1e3,
        TimeUnit::Microsecond => 1e6,
        TimeUnit::Nanosecond => 1e9,
    }
}

fn is_time(kind: &DataType) -> bool {
    matches!(
        kind,
        DataType::Timestamp(..) | DataType::Duration(_) | DataType::Time32(_) | DataType::Time64(_)
    )
}

fn kind(kind: &DataType) -> Option<(Width, Scale)> {
    Some(match kind {
        DataType::Boolean => (Width::Bool, Scale::One),
        DataType::Int8 => (Width::I8, Scale::One),
        DataType::Int16 => (Width::I16, Scale::One),
        DataType::Int32 => (Width::I32, Scale::One),
        DataType::Int64 => (Width::I64, Scale::One),
        DataType::UInt8 => (Width::U8, Scale::One),
        DataType::UInt16 => (Width::U16, Scale::One),
        DataType::UInt32 => (Width::U32, Scale::One),
        DataType::UInt64 => (Width::U64, Scale::Unsigned),
        DataType::Float32 => (Width::F32, Scale::One),
        DataType::Float64 => (Width::F64, Scale::One),
        DataType::Timestamp(unit, _) => {
            (Width::I64, Scale::Since { origin: 0, per_second: parts_of(*unit) })
        }
        DataType::Duration(unit) | DataType::Time64(unit) => {
            (Width::I64, Scale::Part(parts_of(*unit)))
        }
        DataType::Time32(unit) => (Width::I32, Scale::Part(parts_of(*unit))),
        _ => return None,
    })
}

/// Space of a column, including all nested ones.
fn extent(kind: &DataType) -> Extent {
    let all = |fields: &mut dyn Iterator<Item = &DataType>| {
        fields.map(extent).fold(Extent::default(), Extent::and)
    };
    let own = |buffers| Extent::new(1, buffers, 0);
    match kind {
        DataType::Null => own(0),
        DataType::Utf8 | DataType::LargeUtf8 | DataType::Binary | DataType::LargeBinary => own(3),
        DataType::Utf8View | DataType::BinaryView => Extent::new(1, 2, 1),
        DataType::List(item) | DataType::LargeList(item) | DataType::Map(item, _) => {
            own(2).and(extent(item.data_type()))
        }
        DataType::ListView(item) | DataType::LargeListView(item) => {
            own(3).and(extent(item.data_type()))
        }
        DataType::FixedSizeList(item, _) => own(1).and(extent(item.data_type())),
        DataType::Struct(fields) => {
            own(1).and(all(&mut fields.iter().map(|field| field.data_type())))
        }
        DataType::Union(fields, mode) => {
            let kinds = if *mode == UnionMode::Dense { 2 } else { 1 };
            own(kinds).and(all(&mut fields.iter().map(|(_, field)| field.data_type())))
        }
        DataType::RunEndEncoded(ends, values) => {
            own(0).and(all(&mut [ends.data_type(), values.data_type()].into_iter()))
        }
        _ => own(2),
    }
}

/// A requested column.
struct Wanted {
    name: String,
    start: Extent,
    width: Width,
    scale: Scale,
    /// Whether the first timestamp is known.
    anchored: bool,
}

/// Rows of some columns, one record batch after the other.
struct Rows {
    arrow: Arrow,
    wanted: Vec<Wanted>,
    next: usize,
    ready: VecDeque<Vec<Vec<f64>>>,
    row: u64,
}

impl Batches for Rows {
    fn next(&mut self, columns: &mut [Vec<f64>]) -> Result<bool, RecordingError> {
        columns.iter_mut().for_each(Vec::clear);
        while self.ready.is_empty() {
            let Some(block) = self.arrow.blocks.get(self.next).copied() else { return Ok(false) };
            self.decode(self.next, block)?;
            self.next += 1;
        }
        for (column, batch) in columns.iter_mut().zip(self.ready.pop_front().unwrap_or_default()) {
            *column = batch;
        }
        Ok(true)
    }
}

impl Rows {
    fn decode(&mut self, k: usize, block: Block) -> Result<(), RecordingError> {
        let bytes = self.arrow.message(k, block)?;
        let batch = self.arrow.batch(k, &bytes)?;
        let place = |name: &str| format!("record batch {k}, column {name}, rows from {}", self.row);
        let mut columns = Vec::with_capacity(self.wanted.len());
        for wanted in &mut self.wanted {
            let numbers = numbers(&self.arrow.file, block, &batch, wanted);
            columns.push(
                numbers.map_err(|found| self.arrow.source.damaged(place(&wanted.name), found))?,
            );
        }
        let rows = columns.iter().map(Vec::len).min().unwrap_or(0);
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
}

/// One column of a record batch.
fn numbers(
    file: &File,
    block: Block,
    batch: &RecordBatch<'_>,
    wanted: &mut Wanted,
) -> Result<Vec<f64>, String> {
    let nodes = batch.nodes().ok_or("no nodes")?;
    if wanted.start.nodes >= nodes.len() {
        return Err("fewer nodes than columns".into());
    }
    let node = nodes.get(wanted.start.nodes);
    let rows = usize::try_from(node.length()).ok().filter(|&rows| rows <= MOST_ROWS);
    let rows = rows.ok_or_else(|| format!("{} rows", node.length()))?;
    let views = batch.variadicBufferCounts().into_iter().flatten().take(wanted.start.views);
    let views = views.fold(0_usize, |all, count| {
        all.saturating_add(usize::try_from(count).unwrap_or(usize::MAX))
    });
    let first = wanted.start.buffers.saturating_add(views);
    if node.length() != batch.length() {
        return Err(format!("{rows} rows, the batch has {}", batch.length()));
    }
    let valid = match node.null_count() {
        0 => Vec::new(),
        _ => buffer(file, block, batch, first, rows.div_ceil(8))?,
    };
    let is_valid = |row: usize| valid.get(row / 8).is_none_or(|byte| byte >> (row % 8) & 1 == 1);
    let bytes = buffer(file, block, batch, first.saturating_add(1), wanted.width.bytes(rows))?;
    if bytes.len() < wanted.width.bytes(rows) {
        return Err(format!(
            "{} bytes, {rows} rows need {}",
            bytes.len(),
            wanted.width.bytes(rows)
        ));
    }
    if let (Scale::Since { per_second, .. }, false) = (wanted.scale, wanted.anchored)
        && let Some((_, first)) = bytes
            .as_chunks::<8>()
            .0
            .iter()
            .enumerate()
            .find(|&(row, _)| row < rows && is_valid(row))
    {
        wanted.scale = Scale::Since { origin: i64::from_le_bytes(*first), per_second };
        wanted.anchored = true;
    }
    let mut column = decoded(&bytes, wanted.width, wanted.scale, rows);
    if !valid.is_empty() {
        column
            .iter_mut()
            .enumerate()
            .filter(|(row, _)| !is_valid(*row))
            .for_each(|(_, number)| *number = f64::NAN);
    }
    Ok(column)
}

fn decoded(bytes: &[u8], width: Width, scale: Scale, rows: usize) -> Vec<f64> {
    fn each<const N: usize>(
        bytes: &[u8],
        rows: usize,
        number: impl Fn([u8; N]) -> f64,
    ) -> Vec<f64> {
        bytes.as_chunks::<N>().0.iter().take(rows).map(|bytes| number(*bytes)).collect()
    }
    match width {
        Width::Bool => (0..rows).map(|row| f64::from(bytes[row / 8] >> (row % 8) & 1)).collect(),
        Width::I8 => each(bytes, rows, |b| f64::from(i8::from_le_bytes(b))),
        Width::U8 => each(bytes, rows, |b| f64::from(u8::from_le_bytes(b))),
        Width::I16 => each(bytes, rows, |b| f64::from(i16::from_le_bytes(b))),
        Width::U16 => each(bytes, rows, |b| f64::from(u16::from_le_bytes(b))),
        Width::I32 => each(bytes, rows, |b| scale.number(i64::from(i32::from_le_bytes(b)))),
        Width::U32 => each(bytes, rows, |b| f64::from(u32::from_le_bytes(b))),
        Width::I64 | Width::U64 => each(bytes, rows, |b| scale.number(i64::from_le_bytes(b))),
        Width::F32 => each(bytes, rows, |b| f64::from(f32::from_le_bytes(b))),
        Width::F64 => each(bytes, rows, f64::from_le_bytes),
    }
}

/// Buffer `index` of a record batch, decompressed; `most` bytes of it are needed.
fn buffer(
    file: &File,
    block: Block,
    batch: &RecordBatch<'_>,
    index: usize,
    most: usize,
) -> Result<Vec<u8>, String> {
    let buffers = batch.buffers().ok_or("no buffers")?;
    if index >= buffers.len() {
        return Err("fewer buffers than columns need".into());
    }
    let (from, length) = (buffers.get(index).offset(), buffers.get(index).length());
    let (from, length) =
        (u64::try_from(from).unwrap_or(u64::MAX), u64::try_from(length).unwrap_or(u64::MAX));
    if from.checked_add(length).is_none_or(|end| end > block.body) {
        return Err("a buffer beyond its record batch".into());
    }
    let compression = batch.compression().map(|compression| compression.codec());
    let stored = if compression.is_some() { length } else { length.min(most as u64) };
    let mut bytes = vec![0; stored as usize];
    read_exact_at(file, &mut bytes, block.at + block.message + from)
        .map_err(|error| error.to_string())?;
    match (compression, bytes.split_first_chunk::<8>()) {
        (Some(codec), Some((size, compressed))) => {
            decompressed(codec, i64::from_le_bytes(*size), compressed, most)
        }
        _ => Ok(bytes),
    }
}

/// A length of -1 means that the bytes are not compressed.
fn decompressed(
    codec: CompressionType,
    size: i64,
    compressed: &[u8],
    most: usize,
) -> Result<Vec<u8>, String> {
    if size == -1 {
        return Ok(compressed.to_vec());
    }
    let mut bytes = Vec::new();
    let most = most as u64;
    let outcome = match codec {
        CompressionType::LZ4_FRAME => {
            lz4_flex::frame::FrameDecoder::new(compressed).take(most).read_to_end(&mut bytes)
        }
        CompressionType::ZSTD => zstd::Decoder::with_buffer(compressed)
            .and_then(|decoder| decoder.take(most).read_to_end(&mut bytes)),
        _ => return Err("compressed in no known way".into()),
    };
    outcome.map_err(|error| error.to_string())?;
    Ok(bytes)
}
