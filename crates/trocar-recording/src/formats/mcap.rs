//! MCAP files (key MCAP in SOURCES.md): chunks of messages, uncompressed or compressed by zstd or
//! lz4, or messages without chunks.
//!
//! The index at the end lists the chunks that hold a topic; the others are not read. Chunks are
//! read and decoded on all cores, a few at a time. Memory is thus bounded by a few chunks per core
//! ([`MOST_AT_ONCE`]) and the rows that wait for overlapping ones ([`super::ordered`]).
//!
//! A file without an index (after a crash of the recorder), with a damaged one, or without chunks
//! is read once from its start. Intact parts are used, and the others are reported.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use mcap::records::{self, Record, op};
use rayon::prelude::*;

use super::message::{self, Description, Epochs, Extractor, Topic};
use super::ordered::{Block, Blocks, Ordered};
use crate::container::{Batches, Container};
use crate::{RecordingError, Table};

const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";

/// Op code and length before each record; the footer with both; the fixed part of a message.
const RECORD_HEAD: usize = 9;
const FOOTER: usize = RECORD_HEAD + 20;
const MESSAGE_HEAD: usize = 22;

/// Largest chunk and largest index accepted, in bytes: a damaged length must not ask for all
/// memory.
const LARGEST: u64 = 1 << 30;

/// Bytes of messages without chunks that are decoded at a time.
const RUN: u64 = 1 << 20;

/// Chunks per core, and total number of bytes, that are decoded at the same time.
const PER_CORE: usize = 4;
const MOST_AT_ONCE: u64 = 1 << 28;

/// A part of the file that holds messages.
#[derive(Debug, Clone)]
struct Piece {
    at: u64,
    length: u64,
    /// Bytes of its records.
    decompressed: u64,
    /// First and last log time.
    start: u64,
    end: u64,
    /// Its channels, in ascending order; `None` if unknown.
    channels: Option<Vec<u16>>,
    is_chunk: bool,
}

impl Piece {
    fn may_hold(&self, channels: &[u16]) -> bool {
        self.channels
            .as_ref()
            .is_none_or(|held| channels.iter().any(|channel| held.binary_search(channel).is_ok()))
    }
}

/// Content of the index, or result of a scan of the file.
#[derive(Debug, Default)]
struct Index {
    schemas: BTreeMap<u16, Schema>,
    channels: BTreeMap<u16, records::Channel>,
    counts: BTreeMap<u16, u64>,
    /// In the order of the first log time.
    pieces: Vec<Piece>,
    /// First message of each channel.
    first: BTreeMap<u16, Vec<u8>>,
    start: Option<u64>,
    warnings: Vec<String>,
}

#[derive(Debug)]
struct Schema {
    name: String,
    encoding: String,
    data: Vec<u8>,
}

/// An MCAP file.
#[derive(Debug)]
pub(crate) struct McapFile {
    path: PathBuf,
    topics: Vec<Topic>,
    /// Channels of each topic.
    channels: Vec<Vec<u16>>,
    tables: Vec<Table>,
    pieces: Vec<Piece>,
    epochs: Epochs,
    start: Option<u64>,
    notes: Vec<String>,
    warnings: Vec<String>,
}

/// Opens an MCAP file.
///
/// # Errors
/// [`RecordingError`] when it cannot be opened, is not an MCAP file, or does not contain a complete
/// message.
pub(crate) fn open(path: &Path) -> Result<Box<dyn Container>, RecordingError> {
    Ok(Box::new(McapFile::open(path)?))
}

impl McapFile {
    pub(crate) fn open(path: &Path) -> Result<Self, RecordingError> {
        let file = path.display().to_string();
        let failed = |source| RecordingError::Open { file: file.clone(), source };
        let mut input = File::open(path).map_err(failed)?;
        let size = input.metadata().map_err(failed)?.len();
        let mut magic = [0; MAGIC.len()];
        if input.read_exact(&mut magic).is_err() || magic != MAGIC {
            let problem = "does not begin as an MCAP file does".into();
            return Err(RecordingError::Log { file, problem });
        }
        let mut index = match read_index(&mut input, size).map_err(failed)? {
            Some(index) => index,
            None => walk(path, size).map_err(failed)?,
        };
        index.pieces.sort_by_key(|piece| (piece.start, piece.at));
        find_first(path, &mut index);
        if index.first.is_empty() {
            let problem = match index.warnings.first() {
                Some(warning) => format!("holds no whole message: {warning}"),
                None => "holds no messages".into(),
            };
            return Err(RecordingError::Log { file, problem });
        }
        Ok(Self::from_index(path, index))
    }

    fn from_index(path: &Path, index: Index) -> Self {
        let mut warnings = index.warnings;
        let mut groups: Vec<Vec<u16>> = Vec::new();
        for (&id, channel) in index.channels.iter().filter(|(id, _)| index.first.contains_key(id)) {
            let same = |group: &&mut Vec<u16>| {
                let other = &index.channels[&group[0]];
                (&other.topic, other.schema_id, &other.message_encoding)
                    == (&channel.topic, channel.schema_id, &channel.message_encoding)
            };
            match groups.iter_mut().find(same) {
                Some(group) => group.push(id),
                None => groups.push(vec![id]),
            }
        }
        let mut topics = Vec::new();
        for group in &groups {
            let channel = &index.channels[&group[0]];
            let schema = index.schemas.get(&channel.schema_id);
            let definition = schema.map(|schema| String::from_utf8_lossy(&schema.data));
            let counted = group.iter().map(|id| index.counts.get(id).copied()).sum();
            let description = Description {
                name: &channel.topic,
                kind: schema.map_or("", |schema| &schema.name),
                encoding: &channel.message_encoding,
                schema_encoding: schema.map_or("", |schema| &schema.encoding),
                definition: definition.as_deref().unwrap_or(""),
                rows: counted,
                has_publish_time: true,
            };
            let (topic, problem) =
                Topic::new(&description, index.first.get(&group[0]).map(|first| &first[..]));
            topics.push(topic);
            warnings.extend(problem);
        }
        let log = index.start.unwrap_or(0) as i64;
        let mut file = Self {
            path: path.to_owned(),
            topics,
            channels: groups,
            tables: Vec::new(),
            pieces: index.pieces,
            epochs: Epochs::default(),
            start: index.start,
            notes: Vec::new(),
            warnings,
        };
        file.epochs = message::epochs(file.topics.iter(), log);
        file.tables = file.topics.iter().map(|topic| topic.table.clone()).collect();
        file.notes = message::epoch_notes(file.topics.iter(), file.epochs);
        file
    }

    pub(crate) fn topics(&self) -> &[Topic] {
        &self.topics
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    pub(crate) fn epochs(&self) -> Epochs {
        self.epochs
    }

    /// First log time, ns.
    pub(crate) fn start(&self) -> Option<u64> {
        self.start
    }

    /// The chunks that contain a topic, in sequence.
    pub(crate) fn blocks(&self, table: usize, extractor: Extractor) -> Box<dyn Blocks> {
        let channels = self.channels[table].clone();
        let pieces =
            self.pieces.iter().filter(|piece| piece.may_hold(&channels)).cloned().collect();
        Box::new(Chunks {
            path: self.path.clone(),
            channels,
            extractor,
            pieces,
            at: 0,
            decoded: Vec::new().into_iter(),
            damaged: 0,
            lost: 0,
        })
    }
}

impl Container for McapFile {
    fn format(&self) -> &'static str {
        "MCAP"
    }

    fn tables(&self) -> &[Table] {
        &self.tables
    }

    fn notes(&self) -> &[String] {
        &self.notes
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }

    fn clock(&self, table: usize, column: usize) -> usize {
        self.topics[table].clock(column, self.epochs)
    }

    fn open(&self, table: usize, columns: &[usize]) -> Result<Box<dyn Batches>, RecordingError> {
        message::check(&self.path, self.format(), &self.tables[table], columns)?;
        let extractor = self.topics[table].extractor(columns, self.epochs);
        let name = &self.tables[table].name;
        let blocks = self.blocks(table, extractor);
        let file = self.path.display().to_string();
        Ok(Box::new(Ordered::new(&file, name, blocks, columns.len(), self.tables[table].rows)))
    }
}

/// The index at the end of the file; `None` if there is no reliable one, or it does not state where
/// messages are.
fn read_index(input: &mut File, size: u64) -> std::io::Result<Option<Index>> {
    let tail = (FOOTER + MAGIC.len()) as u64;
    if size < 2 * MAGIC.len() as u64 + FOOTER as u64 {
        return Ok(None);
    }
    input.seek(SeekFrom::Start(size - tail))?;
    let mut footer = vec![0; tail as usize];
    input.read_exact(&mut footer)?;
    let (record, magic) = footer.split_at(FOOTER);
    let Some(Record::Footer(footer)) = parse(record[0], &record[RECORD_HEAD..]) else {
        return Ok(None);
    };
    let from = footer.summary_start;
    if magic != MAGIC
        || from < MAGIC.len() as u64
        || from > size - tail
        || size - tail - from > LARGEST
    {
        return Ok(None);
    }
    input.seek(SeekFrom::Start(from))?;
    let mut summary = vec![0; (size - tail - from) as usize];
    input.read_exact(&mut summary)?;
    if footer.summary_crc != 0 {
        let mut sum = crc32fast::Hasher::new();
        sum.update(&summary);
        sum.update(&record[..FOOTER - 4]);
        if sum.finalize() != footer.summary_crc {
            return Ok(None);
        }
    }
    Ok(parse_index(&summary, from))
}

fn parse_index(summary: &[u8], data_end: u64) -> Option<Index> {
    let mut index = Index::default();
    let mut statistics = None;
    let mut rest = summary;
    while let Some((code, body, after)) = split_record(rest) {
        rest = after;
        match code {
            op::SCHEMA | op::CHANNEL => index.learn(code, body)?,
            op::STATISTICS => match parse(code, body)? {
                Record::Statistics(found) => statistics = Some(found),
                _ => return None,
            },
            op::CHUNK_INDEX => match parse(code, body)? {
                Record::ChunkIndex(chunk) => index.pieces.push(piece(&chunk, data_end)?),
                _ => return None,
            },
            _ => {}
        }
    }
    let statistics = statistics.filter(|found| found.chunk_count > 0 && found.message_count > 0)?;
    let is_complete =
        index.pieces.len() == statistics.chunk_count as usize && !index.channels.is_empty();
    let knows_schemas = index
        .channels
        .values()
        .all(|c| c.schema_id == 0 || index.schemas.contains_key(&c.schema_id));
    index.counts = statistics.channel_message_counts;
    index.start = Some(statistics.message_start_time);
    (rest.is_empty() && is_complete && knows_schemas).then_some(index)
}

fn piece(chunk: &records::ChunkIndex, data_end: u64) -> Option<Piece> {
    let ends = chunk.chunk_start_offset.checked_add(chunk.chunk_length)?;
    let channels: Vec<u16> = chunk.message_index_offsets.keys().copied().collect();
    (ends <= data_end && chunk.chunk_length >= RECORD_HEAD as u64).then_some(Piece {
        at: chunk.chunk_start_offset,
        length: chunk.chunk_length,
        decompressed: chunk.uncompressed_size,
        start: chunk.message_start_time,
        end: chunk.message_end_time,
        channels: (!channels.is_empty()).then_some(channels),
        is_chunk: true,
    })
}

/// Op code and body of the first record, and the bytes after it.
fn split_record(bytes: &[u8]) -> Option<(u8, &[u8], &[u8])> {
    let (head, rest) = bytes.split_at_checked(RECORD_HEAD)?;
    let length = u64::from_le_bytes(head[1..].first_chunk().copied()?);
    let (body, after) = rest.split_at_checked(usize::try_from(length).ok()?)?;
    Some((head[0], body, after))
}

/// Channel, log and publish time, and payload of the body of a message.
fn split_message(body: &[u8]) -> Option<(u16, u64, u64, &[u8])> {
    let (head, payload) = body.split_first_chunk::<MESSAGE_HEAD>()?;
    let time = |from: usize| head[from..].first_chunk().map(|bytes| u64::from_le_bytes(*bytes));
    Some((u16::from_le_bytes([head[0], head[1]]), time(6)?, time(14)?, payload))
}

/// Parses a record. Its texts have to end within it: the parser reserves memory for the lengths
/// that they state.
fn parse(code: u8, body: &[u8]) -> Option<Record<'_>> {
    match code {
        op::SCHEMA => after_text(after_text(body.get(2..)?)?).map(drop)?,
        op::CHANNEL => {
            let map = after_text(after_text(body.get(4..)?)?)?;
            let mut entries = map.get(4..map.len() - after_text(map)?.len())?;
            while !entries.is_empty() {
                entries = after_text(entries)?;
            }
        }
        op::CHUNK => after_text(body.get(28..)?).map(drop)?,
        op::CHUNK_INDEX => after_text(after_text(body.get(32..)?)?.get(8..)?).map(drop)?,
        op::STATISTICS | op::FOOTER => {}
        _ => return None,
    }
    mcap::parse_record(code, body).ok()
}

/// The bytes after a length and as many bytes.
fn after_text(bytes: &[u8]) -> Option<&[u8]> {
    let (length, rest) = bytes.split_first_chunk()?;
    rest.get(usize::try_from(u32::from_le_bytes(*length)).ok()?..)
}

impl Index {
    /// Adds a schema or a channel; the first definition is kept.
    fn learn(&mut self, code: u8, body: &[u8]) -> Option<()> {
        match parse(code, body)? {
            Record::Schema { header, data } => {
                let schema = Schema {
                    name: header.name,
                    encoding: header.encoding,
                    data: data.into_owned(),
                };
                self.schemas.entry(header.id).or_insert(schema);
            }
            Record::Channel(channel) => {
                self.channels.entry(channel.id).or_insert(channel);
            }
            _ => return None,
        }
        Some(())
    }

    /// Counts a message found without the help of an index.
    fn count(&mut self, (channel, log, _, payload): (u16, u64, u64, &[u8])) {
        *self.counts.entry(channel).or_default() += 1;
        self.first.entry(channel).or_insert_with(|| payload.to_vec());
        self.start = Some(self.start.map_or(log, |start| start.min(log)));
    }
}

/// Scans the whole file, record by record.
fn walk(path: &Path, size: u64) -> std::io::Result<Index> {
    let mut walker = Walker { index: Index::default(), run: None, damaged: 0, lost: 0 };
    let mut input = BufReader::with_capacity(1 << 20, File::open(path)?);
    let mut at = MAGIC.len() as u64;
    input.seek(SeekFrom::Start(at))?;
    let mut body = Vec::new();
    let has_footer = loop {
        let mut head = [0; RECORD_HEAD];
        if size - at < RECORD_HEAD as u64 {
            break false;
        }
        input.read_exact(&mut head)?;
        let length = u64::from_le_bytes(*head[1..].first_chunk().expect("eight of nine bytes"));
        if head[0] == op::FOOTER {
            break true;
        }
        let rest = size - at - RECORD_HEAD as u64;
        if length > rest || head[0] == 0 {
            break false;
        }
        let is_wanted = matches!(head[0], op::SCHEMA | op::CHANNEL | op::MESSAGE | op::CHUNK)
            && length <= LARGEST;
        if is_wanted {
            body.resize(length as usize, 0);
            input.read_exact(&mut body)?;
            walker.record(head[0], &body, at);
        } else {
            input.seek_relative(length as i64)?;
        }
        at += RECORD_HEAD as u64 + length;
    };
    Ok(walker.finish(if has_footer { 0 } else { size - at }, has_footer))
}

struct Walker {
    index: Index,
    /// Consecutive messages without chunks.
    run: Option<Piece>,
    damaged: u64,
    lost: u64,
}

impl Walker {
    fn record(&mut self, code: u8, body: &[u8], at: u64) {
        let length = (RECORD_HEAD + body.len()) as u64;
        let whole = match code {
            op::MESSAGE => self.message(body, at, length),
            op::CHUNK => self.chunk(body, at, length),
            _ => self.index.learn(code, body),
        };
        if whole.is_none() {
            self.damaged += 1;
            self.lost += length;
        }
    }

    fn message(&mut self, body: &[u8], at: u64, length: u64) -> Option<()> {
        let message = split_message(body)?;
        self.index.count(message);
        let run = self.run.get_or_insert(Piece {
            at,
            length: 0,
            decompressed: 0,
            start: u64::MAX,
            end: 0,
            channels: Some(Vec::new()),
            is_chunk: false,
        });
        run.add(message);
        run.length = at + length - run.at;
        run.decompressed = run.length;
        if run.length >= RUN {
            self.index.pieces.extend(self.run.take());
        }
        Some(())
    }

    fn chunk(&mut self, body: &[u8], at: u64, length: u64) -> Option<()> {
        self.index.pieces.extend(self.run.take());
        let mut records = Vec::new();
        decompress(body, LARGEST, &mut records)?;
        let (start, end, decompressed) = (u64::MAX, 0, records.len() as u64);
        let mut piece = Piece {
            at,
            length,
            decompressed,
            start,
            end,
            channels: Some(Vec::new()),
            is_chunk: true,
        };
        let mut rest = &records[..];
        while let Some((code, body, after)) = split_record(rest) {
            rest = after;
            match code {
                op::MESSAGE => {
                    let message = split_message(body)?;
                    self.index.count(message);
                    piece.add(message);
                }
                op::SCHEMA | op::CHANNEL => self.index.learn(code, body)?,
                _ => {}
            }
        }
        self.index.pieces.push(piece);
        rest.is_empty().then_some(())
    }

    fn finish(mut self, unread: u64, has_footer: bool) -> Index {
        self.index.pieces.extend(self.run.take());
        let warnings = &mut self.index.warnings;
        if !has_footer {
            let megabytes = unread as f64 / 1e6;
            warnings.push(format!(
                "the file ends without an index, as after a crash of the recorder, or is damaged: its last {megabytes:.3} MB are not whole records and are left out"
            ));
        }
        warnings.extend(damage(self.damaged, self.lost));
        self.index
    }
}

impl Piece {
    fn add(&mut self, (channel, log, ..): (u16, u64, u64, &[u8])) {
        self.start = self.start.min(log);
        self.end = self.end.max(log);
        if let Some(Err(place)) =
            self.channels.as_ref().map(|channels| channels.binary_search(&channel))
        {
            self.channels.get_or_insert_default().insert(place, channel);
        }
    }
}

fn damage(pieces: u64, bytes: u64) -> Option<String> {
    let megabytes = bytes as f64 / 1e6;
    let plural = if pieces == 1 { "" } else { "s" };
    (pieces > 0).then(|| {
        format!("{pieces} damaged chunk{plural} or record{plural} of {megabytes:.3} MB left out")
    })
}

/// Finds the first message of each channel for which it is unknown, in the first readable chunk.
fn find_first(path: &Path, index: &mut Index) {
    let Ok(mut input) = File::open(path) else { return };
    let mut buffers = Buffers::default();
    let wanted: Vec<u16> =
        index.channels.keys().copied().filter(|id| index.counts.get(id) != Some(&0)).collect();
    for id in wanted {
        for piece in index.pieces.iter().filter(|piece| piece.may_hold(&[id])) {
            if index.first.contains_key(&id) {
                break;
            }
            let Ok(Some(records)) = buffers.load(&mut input, piece) else { continue };
            let mut rest = records;
            while let Some((code, body, after)) = split_record(rest) {
                rest = after;
                if let Some((channel, _, _, payload)) =
                    split_message(body).filter(|_| code == op::MESSAGE)
                {
                    index.first.entry(channel).or_insert_with(|| payload.to_vec());
                }
            }
        }
    }
}

/// The records in the body of a chunk, of at most `most` bytes; `None` when they cannot be
/// decompressed or their checksum differs.
fn decompress(body: &[u8], most: u64, records: &mut Vec<u8>) -> Option<()> {
    let Some(Record::Chunk { header, data }) = parse(op::CHUNK, body) else { return None };
    let size =
        usize::try_from(header.uncompressed_size).ok().filter(|&size| size as u64 <= most)?;
    records.clear();
    match &*header.compression {
        "" => records.extend_from_slice(&data),
        "zstd" => super::decompress_zstd(&data, size, records).ok()?,
        "lz4" => {
            let mut input = lz4_flex::frame::FrameDecoder::new(&data[..]).take(most);
            input.read_to_end(records).ok()?;
        }
        _ => return None,
    }
    let is_right =
        header.uncompressed_crc == 0 || crc32fast::hash(records) == header.uncompressed_crc;
    (records.len() == size && is_right).then_some(())
}

/// Memory for one piece, reused for the next.
#[derive(Default)]
struct Buffers {
    compressed: Vec<u8>,
    decompressed: Vec<u8>,
}

impl Buffers {
    /// The records of a piece; `None` when it is damaged.
    fn load(&mut self, input: &mut File, piece: &Piece) -> std::io::Result<Option<&[u8]>> {
        if piece.length > LARGEST {
            return Ok(None);
        }
        self.compressed.resize(piece.length as usize, 0);
        input.seek(SeekFrom::Start(piece.at))?;
        input.read_exact(&mut self.compressed)?;
        if !piece.is_chunk {
            return Ok(Some(&self.compressed));
        }
        let Some((op::CHUNK, body, [])) = split_record(&self.compressed) else { return Ok(None) };
        Ok(decompress(body, piece.decompressed.min(LARGEST), &mut self.decompressed)
            .map(|()| &self.decompressed[..]))
    }
}

/// The chunks that contain a topic, decoded a few at a time.
struct Chunks {
    path: PathBuf,
    channels: Vec<u16>,
    extractor: Extractor,
    pieces: Vec<Piece>,
    at: usize,
    decoded: std::vec::IntoIter<Option<Block>>,
    damaged: u64,
    lost: u64,
}

impl Chunks {
    /// Decodes the next few pieces.
    fn decode(&mut self) -> Result<(), RecordingError> {
        let most = PER_CORE * rayon::current_num_threads();
        let mut bytes = 0;
        let few = self.pieces[self.at..].iter().take(most).take_while(|piece| {
            let with = piece.decompressed.saturating_add(bytes);
            let fits = bytes == 0 || with <= MOST_AT_ONCE;
            bytes = with;
            fits
        });
        let to = self.at + few.count();
        let (path, extractor, channels) = (&self.path, &self.extractor, &self.channels);
        let start = || (File::open(path), Buffers::default(), extractor.clone());
        let decoded = self.pieces[self.at..to]
            .par_iter()
            .map_init(start, |(input, buffers, extractor), piece| {
                let input = input.as_mut().map_err(|error| std::io::Error::from(error.kind()))?;
                Ok(buffers.load(input, piece)?.map(|records| block(records, channels, extractor)))
            })
            .collect::<std::io::Result<Vec<_>>>()
            .map_err(|source| RecordingError::Open { file: path.display().to_string(), source })?;
        self.decoded = decoded.into_iter();
        Ok(())
    }
}

/// The rows of some channels in the records of a piece.
fn block(records: &[u8], channels: &[u16], extractor: &mut Extractor) -> Block {
    let mut block = Block::new(extractor.width());
    let mut rest = records;
    while let Some((code, body, after)) = split_record(rest) {
        rest = after;
        let message = split_message(body)
            .filter(|(channel, ..)| code == op::MESSAGE && channels.contains(channel));
        if let Some((_, log, publish, payload)) = message {
            extractor.add(log, publish, payload, &mut block);
        }
    }
    block
}

impl Blocks for Chunks {
    fn next(&mut self) -> Result<Option<Block>, RecordingError> {
        loop {
            if self.at == self.pieces.len() {
                return Ok(None);
            }
            let decoded = match self.decoded.next() {
                Some(decoded) => decoded,
                None => {
                    self.decode()?;
                    continue;
                }
            };
            self.at += 1;
            match decoded {
                None => {
                    self.damaged += 1;
                    self.lost += self.pieces[self.at - 1].length;
                }
                Some(mut block) => {
                    block.settled = self.pieces.get(self.at).map(|piece| piece.start);
                    return Ok(Some(block));
                }
            }
        }
    }

    fn warnings(&self) -> Vec<String> {
        damage(self.damaged, self.lost).into_iter().collect()
    }
}
