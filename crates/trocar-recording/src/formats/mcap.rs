//! MCAP files (key MCAP in SOURCES.md): chunks of messages, uncompressed or compressed by zstd or
//! lz4, or messages without chunks.
//!
//! The index at the end lists the chunks that hold a topic; the others are not read. A file without
//! an index (after a crash of the recorder), with a damaged one, or without chunks is read once from
//! its start. Intact parts are used, and the others are reported.

use std::collections::BTreeMap;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use mcap::records::{self, Record, op};
use trocar_tables::ros::Description;

use super::bag::Log;
use super::chunks::{Buffers, Chunked, Contents, Input, Message, Piece, RUN};
use super::read_exact_at;
use crate::RecordingError;

const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";

/// Op code and length before each record; the footer with both; the fixed part of a message.
const RECORD_HEAD: usize = 9;
const FOOTER: usize = RECORD_HEAD + 20;
const MESSAGE_HEAD: usize = 22;

/// Largest chunk and largest index accepted, in bytes: a damaged length must not ask for all
/// memory.
const LARGEST: u64 = 1 << 30;

/// Content of the index, or result of a scan of the file.
#[derive(Debug, Default)]
struct Index {
    schemas: BTreeMap<u16, Schema>,
    channels: BTreeMap<u16, records::Channel>,
    contents: Contents,
}

#[derive(Debug)]
struct Schema {
    name: String,
    encoding: String,
    data: Vec<u8>,
}

/// Opens an MCAP file.
///
/// # Errors
/// [`RecordingError`] when it cannot be opened, is not an MCAP file, or does not contain a complete
/// message.
pub(crate) fn open(path: &Path) -> Result<Log, RecordingError> {
    let mut input = Input::open(path)?;
    let mut magic = [0; MAGIC.len()];
    if read_exact_at(&input.file, &mut magic, 0).is_err() || magic != MAGIC {
        let problem = "does not begin as an MCAP file does";
        return Err(RecordingError::unusable(path.display(), problem));
    }
    let index = match read_index(&input) {
        Ok(Some(index)) => Ok(index),
        Ok(None) => walk(&mut input),
        Err(error) => Err(error),
    };
    let Index { schemas, channels, mut contents } =
        index.map_err(RecordingError::cannot_open(path))?;
    let ids = channels.keys().map(|id| u32::from(*id));
    contents.complete::<Mcap>(path, &input, ids)?;
    let topics = channels.iter().map(|(&id, channel)| {
        (u32::from(id), (&channel.topic, channel.schema_id, &channel.message_encoding))
    });
    let groups = contents.groups(topics);
    let definitions: BTreeMap<u16, _> =
        schemas.iter().map(|(id, schema)| (*id, String::from_utf8_lossy(&schema.data))).collect();
    let described = groups.into_iter().map(|((name, schema_id, encoding), group)| {
        let schema = schemas.get(&schema_id);
        let description = Description {
            name,
            kind: schema.map_or("", |schema| &schema.name),
            encoding,
            schema_encoding: schema.map_or("", |schema| &schema.encoding),
            definition: definitions.get(&schema_id).map_or("", |text| text),
            rows: None,
            has_publish_time: true,
        };
        (description, group)
    });
    Ok(contents.log::<Mcap>(path, described.collect()))
}

/// The chunks of the format.
struct Mcap;

impl Chunked for Mcap {
    const NAME: &'static str = "MCAP";

    fn size(_: &Input, piece: &Piece) -> u64 {
        piece.decompressed
    }

    fn load<'a>(input: &Input, piece: &Piece, buffers: &'a mut Buffers) -> Option<&'a [u8]> {
        let length = piece.length.filter(|length| *length <= LARGEST)?;
        buffers.stored.resize(usize::try_from(length).ok()?, 0);
        read_exact_at(&input.file, &mut buffers.stored, piece.at).ok()?;
        if !piece.is_chunk {
            return Some(&buffers.stored);
        }
        let Some((op::CHUNK, body, [])) = split_record(&buffers.stored) else { return None };
        decompress(body, piece.decompressed.min(LARGEST), &mut buffers.decompressed)?;
        Some(&buffers.decompressed)
    }

    fn messages(records: &[u8], take: &mut dyn FnMut(Message)) {
        let mut rest = records;
        while let Some((code, body, after)) = split_record(rest) {
            rest = after;
            if let Some(message) = split_message(body).filter(|_| code == op::MESSAGE) {
                take(message);
            }
        }
    }

    fn damage(pieces: u64, bytes: u64) -> Option<String> {
        let megabytes = bytes as f64 / 1e6;
        let plural = if pieces == 1 { "" } else { "s" };
        (pieces > 0).then(|| {
            format!(
                "{pieces} damaged chunk{plural} or record{plural} of {megabytes:.3} MB left out"
            )
        })
    }
}

/// The index at the end of the file; `None` if there is no reliable one, or it does not state where
/// messages are.
fn read_index(input: &Input) -> std::io::Result<Option<Index>> {
    let tail = (FOOTER + MAGIC.len()) as u64;
    let size = input.size;
    if size < 2 * MAGIC.len() as u64 + FOOTER as u64 {
        return Ok(None);
    }
    let mut footer = vec![0; tail as usize];
    read_exact_at(&input.file, &mut footer, size - tail)?;
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
    let mut summary = vec![0; (size - tail - from) as usize];
    read_exact_at(&input.file, &mut summary, from)?;
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
                Record::ChunkIndex(chunk) => index.contents.pieces.push(piece(&chunk, data_end)?),
                _ => return None,
            },
            _ => {}
        }
    }
    let statistics = statistics.filter(|found| found.chunk_count > 0 && found.message_count > 0)?;
    let is_complete = index.contents.pieces.len() == statistics.chunk_count as usize
        && !index.channels.is_empty();
    let knows_schemas = index
        .channels
        .values()
        .all(|c| c.schema_id == 0 || index.schemas.contains_key(&c.schema_id));
    let counts = statistics.channel_message_counts;
    index.contents.counts = counts.into_iter().map(|(id, count)| (u32::from(id), count)).collect();
    index.contents.start = Some(statistics.message_start_time);
    (rest.is_empty() && is_complete && knows_schemas).then_some(index)
}

fn piece(chunk: &records::ChunkIndex, data_end: u64) -> Option<Piece> {
    let ends = chunk.chunk_start_offset.checked_add(chunk.chunk_length)?;
    let channels = &chunk.message_index_offsets;
    (ends <= data_end && chunk.chunk_length >= RECORD_HEAD as u64).then(|| Piece {
        at: chunk.chunk_start_offset,
        length: Some(chunk.chunk_length),
        decompressed: chunk.uncompressed_size,
        start: chunk.message_start_time,
        channels: (!channels.is_empty())
            .then(|| channels.keys().map(|id| u32::from(*id)).collect()),
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

/// The message in the body of a record.
fn split_message(body: &[u8]) -> Option<Message<'_>> {
    let (head, payload) = body.split_first_chunk::<MESSAGE_HEAD>()?;
    let time = |from: usize| head[from..].first_chunk().map(|bytes| u64::from_le_bytes(*bytes));
    let channel = u16::from_le_bytes([head[0], head[1]]).into();
    Some(Message { channel, log: time(6)?, publish: time(14)?, payload })
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
}

/// Scans the whole file, record by record.
fn walk(input: &mut Input) -> std::io::Result<Index> {
    let mut walker = Walker { index: Index::default(), run: None, damaged: 0, lost: 0 };
    let size = input.size;
    let mut input = BufReader::with_capacity(1 << 20, &mut input.file);
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
        self.index.contents.count(message);
        let run = self.run.get_or_insert_with(|| Piece::empty(at, None, false));
        run.add(message);
        let all = at + length - run.at;
        run.length = Some(all);
        run.decompressed = all;
        if all >= RUN {
            self.index.contents.pieces.extend(self.run.take());
        }
        Some(())
    }

    fn chunk(&mut self, body: &[u8], at: u64, length: u64) -> Option<()> {
        self.index.contents.pieces.extend(self.run.take());
        let mut records = Vec::new();
        decompress(body, LARGEST, &mut records)?;
        let mut piece = Piece::empty(at, Some(length), true);
        piece.decompressed = records.len() as u64;
        let mut rest = &records[..];
        while let Some((code, body, after)) = split_record(rest) {
            rest = after;
            match code {
                op::MESSAGE => {
                    let message = split_message(body)?;
                    self.index.contents.count(message);
                    piece.add(message);
                }
                op::SCHEMA | op::CHANNEL => self.index.learn(code, body)?,
                _ => {}
            }
        }
        self.index.contents.pieces.push(piece);
        rest.is_empty().then_some(())
    }

    fn finish(mut self, unread: u64, has_footer: bool) -> Index {
        self.index.contents.pieces.extend(self.run.take());
        let warnings = &mut self.index.contents.warnings;
        if !has_footer {
            let megabytes = unread as f64 / 1e6;
            warnings.push(format!(
                "the file ends without an index, as after a crash of the recorder, or is damaged: its last {megabytes:.3} MB are not whole records and are left out"
            ));
        }
        warnings.extend(Mcap::damage(self.damaged, self.lost));
        self.index
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
