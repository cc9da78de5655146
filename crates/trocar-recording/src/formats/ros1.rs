//! ROS 1 bags (`.bag`, format 2.0, key ROSBAG in SOURCES.md): chunks of messages, uncompressed or
//! compressed by bz2 or lz4, and an index at the end.
//!
//! A record is a header of fields `name=value` and data, both preceded by their lengths in little
//! endian. The index lists the connections, of which each names a topic and defines its messages,
//! and the chunks. Chunks are decoded on all cores, a few at a time, as those of an MCAP file.
//!
//! A bag without an index (after a crash of the recorder: `.bag.active`) or with a damaged one is
//! read once from its start. Intact parts are used, and the others are reported.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{Read, Take};
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::message::{self, Description, Epochs, Extractor, Topic};
use super::ordered::{Block, Blocks, Ordered};
use super::read_exact_at;
use crate::container::{Batches, Container};
use crate::{RecordingError, Table};

/// First line of a bag.
const MAGIC: &[u8] = b"#ROSBAG V2.0\n";

/// Kinds of records, the value of their field `op`.
const MESSAGE: u8 = 2;
const BAG: u8 = 3;
const INDEX: u8 = 4;
const CHUNK: u8 = 5;
const CHUNK_INFO: u8 = 6;
const CONNECTION: u8 = 7;

/// Largest header of a record, and largest chunk, in bytes: a damaged length must not ask for all
/// memory. Recorders write chunks of some 0.8 MB.
const LARGEST_HEADER: u32 = 1 << 20;
const LARGEST: u64 = 1 << 28;

/// Largest index, and most connections: damage may repeat records.
const LARGEST_INDEX: u64 = 1 << 28;
const MOST_CONNECTIONS: usize = 1 << 14;

/// Bytes of messages outside of chunks that are decoded at a time.
const RUN: u64 = 1 << 20;

/// Chunks per core that are decoded at the same time, and their bytes in all.
const PER_CORE: usize = 4;
const MOST_AT_ONCE: u64 = 1 << 28;

/// Opens a bag.
///
/// # Errors
/// [`RecordingError`] when it cannot be opened, is of another version, or holds no whole message.
pub(crate) fn open(path: &Path) -> Result<Box<dyn Container>, RecordingError> {
    Ok(Box::new(Bag::open(path)?))
}

/// The fields of a record's header.
#[derive(Clone, Copy)]
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn get(&self, name: &str) -> Option<&'a [u8]> {
        let mut rest = self.0;
        while let Some((field, after)) = prefixed(rest) {
            rest = after;
            let value =
                field.strip_prefix(name.as_bytes()).and_then(|field| field.strip_prefix(b"="));
            if value.is_some() {
                return value;
            }
        }
        None
    }

    fn op(&self) -> Option<u8> {
        self.get("op")?.first().copied()
    }

    fn u32(&self, name: &str) -> Option<u32> {
        self.get(name)?.first_chunk().map(|bytes| u32::from_le_bytes(*bytes))
    }

    fn u64(&self, name: &str) -> Option<u64> {
        self.get(name)?.first_chunk().map(|bytes| u64::from_le_bytes(*bytes))
    }

    /// Seconds and nanoseconds as nanoseconds.
    fn time(&self, name: &str) -> Option<u64> {
        let both = self.u64(name)?;
        Some((both & 0xffff_ffff) * 1_000_000_000 + (both >> 32))
    }

    fn text(&self, name: &str) -> Option<String> {
        self.get(name).map(|bytes| String::from_utf8_lossy(bytes).into_owned())
    }
}

/// The bytes whose length precedes them, and those after them.
fn prefixed(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk()?;
    rest.split_at_checked(usize::try_from(u32::from_le_bytes(*length)).ok()?)
}

/// Header and data of the first record, and the bytes after it.
fn split_record(bytes: &[u8]) -> Option<(Fields<'_>, &[u8], &[u8])> {
    let (fields, rest) = prefixed(bytes)?;
    let (data, after) = prefixed(rest)?;
    Some((Fields(fields), data, after))
}

/// Header of the record at `at`, and where its data begin and end; `None` if the file ends before
/// the header does. The end may be after that of the file.
fn record_at(file: &File, size: u64, at: u64) -> Option<(Vec<u8>, u64, u64)> {
    let mut length = [0; 4];
    read_exact_at(file, &mut length, at).ok()?;
    let header_length = u32::from_le_bytes(length);
    let data = at + 8 + u64::from(header_length);
    if header_length > LARGEST_HEADER || data > size {
        return None;
    }
    let mut header = vec![0; header_length as usize];
    read_exact_at(file, &mut header, at + 4).ok()?;
    read_exact_at(file, &mut length, data - 4).ok()?;
    Some((header, data, data + u64::from(u32::from_le_bytes(length))))
}

/// Publisher of one topic.
#[derive(Debug, Clone, PartialEq)]
struct Connection {
    topic: String,
    kind: String,
    definition: String,
}

impl Connection {
    fn read(fields: Fields, data: &[u8]) -> Option<(u32, Self)> {
        let own = Fields(data);
        let topic = fields.text("topic").or_else(|| own.text("topic"))?;
        let connection = Self {
            topic,
            kind: own.text("type")?,
            definition: own.text("message_definition").unwrap_or_default(),
        };
        Some((fields.u32("conn")?, connection))
    }
}

/// A part of the file that holds messages.
#[derive(Debug, Clone)]
struct Piece {
    at: u64,
    /// Its bytes, if it is not one record.
    length: Option<u64>,
    /// First log time.
    start: u64,
    /// Connections with messages in it.
    connections: BTreeSet<u32>,
}

/// Content of the index, or result of a scan of the file.
#[derive(Debug, Default)]
struct Contents {
    connections: BTreeMap<u32, Connection>,
    counts: BTreeMap<u32, u64>,
    /// First message of each connection.
    first: BTreeMap<u32, Vec<u8>>,
    pieces: Vec<Piece>,
    warnings: Vec<String>,
}

impl Contents {
    fn learn(&mut self, fields: Fields, data: &[u8]) -> Option<()> {
        let (id, connection) = Connection::read(fields, data)?;
        if self.connections.len() < MOST_CONNECTIONS {
            self.connections.entry(id).or_insert(connection);
        }
        Some(())
    }
}

/// A bag.
#[derive(Debug)]
struct Bag {
    path: PathBuf,
    topics: Vec<Topic>,
    /// Connections of each topic.
    connections: Vec<Vec<u32>>,
    tables: Vec<Table>,
    pieces: Vec<Piece>,
    epochs: Epochs,
    notes: Vec<String>,
    warnings: Vec<String>,
}

impl Bag {
    fn open(path: &Path) -> Result<Self, RecordingError> {
        let name = path.display().to_string();
        let failed = |source| RecordingError::Open { file: name.clone(), source };
        let file = File::open(path).map_err(failed)?;
        let size = file.metadata().map_err(failed)?.len();
        let mut magic = [0; MAGIC.len()];
        if read_exact_at(&file, &mut magic, 0).is_err() || magic != *MAGIC {
            let found = String::from_utf8_lossy(&magic).trim_end().to_owned();
            let problem = format!(
                "begins with '{found}', expected '#ROSBAG V2.0'\n\nhint: bring a bag of an older version up to date with rosbag fix OLD.bag NEW.bag"
            );
            return Err(RecordingError::Log { file: name, problem });
        }
        let mut contents = match read_index(&file, size) {
            Some(contents) => contents,
            None => walk(&file, size),
        };
        contents.pieces.sort_by_key(|piece| (piece.start, piece.at));
        find_first(&file, size, &mut contents);
        if contents.first.is_empty() {
            let problem = match contents.warnings.first() {
                Some(warning) => format!("holds no whole message: {warning}"),
                None => "holds no messages".into(),
            };
            return Err(RecordingError::Log { file: name, problem });
        }
        Ok(Self::from_contents(path, contents))
    }

    fn from_contents(path: &Path, contents: Contents) -> Self {
        let mut warnings = contents.warnings;
        let mut groups: Vec<(&Connection, Vec<u32>)> = Vec::new();
        for (&id, connection) in
            contents.connections.iter().filter(|(id, _)| contents.first.contains_key(id))
        {
            match groups.iter_mut().find(|(known, _)| *known == connection) {
                Some((_, group)) => group.push(id),
                None => groups.push((connection, vec![id])),
            }
        }
        let mut topics = Vec::new();
        for (connection, group) in &groups {
            let description = Description {
                name: &connection.topic,
                kind: &connection.kind,
                encoding: "ros1",
                schema_encoding: "ros1msg",
                definition: &connection.definition,
                rows: Some(group.iter().filter_map(|id| contents.counts.get(id)).sum()),
                has_publish_time: false,
            };
            let (topic, problem) =
                Topic::new(&description, contents.first.get(&group[0]).map(|first| &first[..]));
            topics.push(topic);
            warnings.extend(problem);
        }
        let log = contents.pieces.first().map_or(0, |piece| piece.start) as i64;
        let epochs = message::epochs(topics.iter(), log);
        Self {
            path: path.to_owned(),
            connections: groups.into_iter().map(|(_, group)| group).collect(),
            tables: topics.iter().map(|topic| topic.table.clone()).collect(),
            notes: message::epoch_notes(topics.iter(), epochs),
            pieces: contents.pieces,
            topics,
            epochs,
            warnings,
        }
    }
}

impl Container for Bag {
    fn format(&self) -> &'static str {
        "ROS 1 bag"
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
        let connections = self.connections[table].clone();
        let holds = |piece: &&Piece| connections.iter().any(|id| piece.connections.contains(id));
        let pieces = self.pieces.iter().filter(holds).cloned().collect();
        let chunks = Chunks {
            path: self.path.clone(),
            extractor: self.topics[table].extractor(columns, self.epochs),
            connections,
            pieces,
            at: 0,
            decoded: Vec::new().into_iter(),
            damaged: 0,
        };
        let file = self.path.display().to_string();
        let table = &self.tables[table];
        Ok(Box::new(Ordered::new(&file, &table.name, chunks, columns.len(), table.rows)))
    }
}

/// The index at the end of the bag; `None` if there is no reliable one.
fn read_index(file: &File, size: u64) -> Option<Contents> {
    let (header, _, data_end) = record_at(file, size, MAGIC.len() as u64)?;
    let header = Fields(&header);
    let from = header.u64("index_pos").filter(|from| (data_end..size).contains(from))?;
    if header.op() != Some(BAG) || size - from > LARGEST_INDEX {
        return None;
    }
    let mut bytes = vec![0; (size - from) as usize];
    read_exact_at(file, &mut bytes, from).ok()?;
    let mut contents = Contents::default();
    let mut rest = &bytes[..];
    while let Some((fields, data, after)) = split_record(rest) {
        rest = after;
        match fields.op()? {
            CONNECTION => contents.learn(fields, data)?,
            CHUNK_INFO => {
                let at = fields.u64("chunk_pos").filter(|at| *at < from)?;
                let mut piece = Piece {
                    at,
                    length: None,
                    start: fields.time("start_time")?,
                    connections: BTreeSet::new(),
                };
                for pair in data.as_chunks::<8>().0 {
                    let word = |at: usize| {
                        pair[at..].first_chunk().map(|bytes| u32::from_le_bytes(*bytes))
                    };
                    let (id, count) = (word(0)?, word(4)?);
                    piece.connections.insert(id);
                    *contents.counts.entry(id).or_default() += u64::from(count);
                }
                contents.pieces.push(piece);
            }
            _ => return None,
        }
    }
    let is_whole = rest.is_empty()
        && Some(contents.pieces.len() as u64) == header.u32("chunk_count").map(u64::from)
        && Some(contents.connections.len() as u64) == header.u32("conn_count").map(u64::from)
        && contents.counts.keys().all(|id| contents.connections.contains_key(id));
    (is_whole && !contents.pieces.is_empty()).then_some(contents)
}

/// Scans the whole file, record by record.
fn walk(file: &File, size: u64) -> Contents {
    let mut walker = Walker { contents: Contents::default(), run: None, damaged: 0 };
    let mut at = MAGIC.len() as u64;
    let mut buffers = Buffers::default();
    while let Some((header, data, end)) = record_at(file, size, at) {
        let fields = Fields(&header);
        let op = fields.op();
        // A recorder that writes a chunk does not know its length yet: the messages follow.
        if op == Some(CHUNK)
            && fields.get("compression") == Some(b"none")
            && (end > size || end == data)
        {
            at = data;
            continue;
        }
        if end > size
            || !matches!(op, Some(MESSAGE | BAG | INDEX | CHUNK | CHUNK_INFO | CONNECTION))
        {
            break;
        }
        match op {
            Some(CHUNK) => {
                walker.end_run();
                let piece =
                    Piece { at, length: None, start: u64::MAX, connections: BTreeSet::new() };
                match buffers.load(file, size, &piece) {
                    Some(records) => walker.chunk(records, piece),
                    None => walker.damaged += 1,
                }
            }
            Some(op @ (MESSAGE | CONNECTION)) => {
                let mut bytes = vec![0; (end - data).min(LARGEST) as usize];
                let read = read_exact_at(file, &mut bytes, data).is_ok();
                if !read
                    || end - data > LARGEST
                    || walker.record(op, fields, &bytes, at, end).is_none()
                {
                    walker.damaged += 1;
                }
            }
            _ => {}
        }
        at = end;
    }
    walker.end_run();
    let mut contents = walker.contents;
    let megabytes = (size - at.min(size)) as f64 / 1e6;
    contents.warnings.push(format!(
        "the bag has no whole index, as after a crash of the recorder or when it was cut off: its messages were sought from the start, and the last {megabytes:.3} MB, which are not whole records, are left out"
    ));
    contents.warnings.extend(damage(walker.damaged));
    contents
}

struct Walker {
    contents: Contents,
    /// Consecutive records outside of chunks.
    run: Option<Piece>,
    damaged: u64,
}

impl Walker {
    fn end_run(&mut self) {
        let run = self.run.take().filter(|run| !run.connections.is_empty());
        self.contents.pieces.extend(run);
    }

    /// A message or connection outside of chunks, from `at` to `end`.
    fn record(&mut self, op: u8, fields: Fields, data: &[u8], at: u64, end: u64) -> Option<()> {
        if op == CONNECTION {
            self.end_run();
            return self.contents.learn(fields, data);
        }
        let mut run = match self.run.take() {
            Some(run) if run.at + run.length.unwrap_or(0) == at => run,
            other => {
                self.contents.pieces.extend(other);
                Piece { at, length: Some(0), start: u64::MAX, connections: BTreeSet::new() }
            }
        };
        let added = self.message(fields, data, &mut run);
        run.length = Some(end - run.at);
        let is_full = end - run.at >= RUN;
        self.run = Some(run);
        if is_full {
            self.end_run();
        }
        added
    }

    fn message(&mut self, fields: Fields, data: &[u8], piece: &mut Piece) -> Option<()> {
        let (id, time) = (fields.u32("conn")?, fields.time("time")?);
        if !piece.connections.contains(&id) {
            if piece.connections.len() >= MOST_CONNECTIONS {
                return None;
            }
            piece.connections.insert(id);
        }
        piece.start = piece.start.min(time);
        let contents = &mut self.contents;
        if !contents.first.contains_key(&id) && contents.first.len() < MOST_CONNECTIONS {
            contents.first.insert(id, data.to_vec());
        }
        *contents.counts.entry(id).or_default() += 1;
        Some(())
    }

    fn chunk(&mut self, records: &[u8], mut piece: Piece) {
        let mut rest = records;
        let mut whole = true;
        while let Some((fields, data, after)) = split_record(rest) {
            rest = after;
            whole &= match fields.op() {
                Some(MESSAGE) => self.message(fields, data, &mut piece).is_some(),
                Some(CONNECTION) => self.contents.learn(fields, data).is_some(),
                _ => true,
            };
        }
        self.damaged += u64::from(!whole || !rest.is_empty());
        if !piece.connections.is_empty() {
            self.contents.pieces.push(piece);
        }
    }
}

fn damage(chunks: u64) -> Option<String> {
    let plural = if chunks == 1 { "" } else { "s" };
    (chunks > 0).then(|| format!("{chunks} damaged chunk{plural} or record{plural} left out"))
}

/// Finds the first message of each connection for which it is unknown.
fn find_first(file: &File, size: u64, contents: &mut Contents) {
    let mut buffers = Buffers::default();
    let mut missing: BTreeSet<u32> = contents
        .connections
        .keys()
        .copied()
        .filter(|id| !contents.first.contains_key(id))
        .collect();
    for piece in &contents.pieces {
        if missing.is_disjoint(&piece.connections) {
            continue;
        }
        let Some(mut rest) = buffers.load(file, size, piece) else { continue };
        while let Some((fields, data, after)) = split_record(rest) {
            rest = after;
            let id = fields
                .u32("conn")
                .filter(|id| fields.op() == Some(MESSAGE) && missing.contains(id));
            if let Some(id) = id {
                missing.remove(&id);
                contents.first.insert(id, data.to_vec());
            }
        }
    }
}

/// Memory for one piece, reused for the next.
#[derive(Default)]
struct Buffers {
    stored: Vec<u8>,
    decompressed: Vec<u8>,
}

impl Buffers {
    /// The records of a piece; `None` when it is damaged.
    fn load(&mut self, file: &File, size: u64, piece: &Piece) -> Option<&[u8]> {
        if let Some(length) = piece.length.filter(|length| piece.at + length <= size) {
            self.stored.resize(length as usize, 0);
            read_exact_at(file, &mut self.stored, piece.at).ok()?;
            return Some(&self.stored);
        }
        let (header, data, end) = record_at(file, size, piece.at)?;
        let header = Fields(&header);
        if header.op() != Some(CHUNK) || end > size || end - data > LARGEST {
            return None;
        }
        let decompressed = u64::from(header.u32("size")?);
        self.stored.resize((end - data) as usize, 0);
        read_exact_at(file, &mut self.stored, data).ok()?;
        self.decompressed.clear();
        let read = |input: Take<&mut dyn Read>, output: &mut Vec<u8>| {
            let mut input = input;
            input.read_to_end(output).ok().filter(|read| *read as u64 == decompressed).map(drop)
        };
        let most = decompressed.min(LARGEST);
        match header.get("compression")? {
            b"none" => return Some(&self.stored),
            b"bz2" => {
                let mut input = bzip2::read::BzDecoder::new(&self.stored[..]);
                read(Read::take(&mut input as &mut dyn Read, most), &mut self.decompressed)?;
            }
            b"lz4" => {
                let mut input = lz4_flex::frame::FrameDecoder::new(&self.stored[..]);
                read(Read::take(&mut input as &mut dyn Read, most), &mut self.decompressed)?;
            }
            _ => return None,
        }
        Some(&self.decompressed)
    }
}

/// The pieces that contain a topic, decoded a few at a time.
struct Chunks {
    path: PathBuf,
    connections: Vec<u32>,
    extractor: Extractor,
    pieces: Vec<Piece>,
    at: usize,
    decoded: std::vec::IntoIter<Option<Block>>,
    damaged: u64,
}

impl Chunks {
    /// Decodes the next few pieces.
    fn decode(&mut self) -> Result<(), RecordingError> {
        let failed =
            |source| RecordingError::Open { file: self.path.display().to_string(), source };
        let file = File::open(&self.path).map_err(failed)?;
        let size = file.metadata().map_err(failed)?.len();
        // Where the next piece begins bounds the length of one; its decompressed size is not known.
        let most = PER_CORE * rayon::current_num_threads();
        let mut bytes = 0;
        let few = self.pieces[self.at..].iter().take(most).take_while(|piece| {
            let end = record_at(&file, size, piece.at)
                .map_or(0, |(_, data, end)| end.saturating_sub(data));
            let fits = bytes == 0 || bytes + end <= MOST_AT_ONCE;
            bytes += end.min(LARGEST);
            fits
        });
        let to = self.at + few.count();
        let (extractor, connections) = (&self.extractor, &self.connections);
        let decoded: Vec<Option<Block>> = self.pieces[self.at..to]
            .par_iter()
            .map_init(
                || (Buffers::default(), extractor.clone()),
                |(buffers, extractor), piece| {
                    buffers
                        .load(&file, size, piece)
                        .map(|records| block(records, connections, extractor))
                },
            )
            .collect();
        self.decoded = decoded.into_iter();
        Ok(())
    }
}

/// The rows of some connections in the records of a piece.
fn block(records: &[u8], connections: &[u32], extractor: &mut Extractor) -> Block {
    let mut block = Block::new(extractor.width());
    let mut rest = records;
    while let Some((fields, data, after)) = split_record(rest) {
        rest = after;
        if fields.op() != Some(MESSAGE)
            || fields.u32("conn").is_none_or(|id| !connections.contains(&id))
        {
            continue;
        }
        if let Some(time) = fields.time("time") {
            extractor.add(time, time, data, &mut block);
        }
    }
    block
}

impl Blocks for Chunks {
    fn next(&mut self) -> Result<Option<Block>, RecordingError> {
        while self.at < self.pieces.len() {
            let Some(decoded) = self.decoded.next() else {
                self.decode()?;
                continue;
            };
            self.at += 1;
            match decoded {
                None => self.damaged += 1,
                Some(mut block) => {
                    block.settled = self.pieces.get(self.at).map(|piece| piece.start);
                    return Ok(Some(block));
                }
            }
        }
        Ok(None)
    }

    fn warnings(&self) -> Vec<String> {
        damage(self.damaged).into_iter().collect()
    }
}
