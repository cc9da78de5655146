//! ROS 1 bags (`.bag`, format 2.0, key ROSBAG in SOURCES.md): chunks of messages, uncompressed or
//! compressed by bz2 or lz4, and an index at the end.
//!
//! A record is a header of fields `name=value` and data, both preceded by their lengths in little
//! endian. The index lists the connections, of which each names a topic and defines its messages,
//! and the chunks.
//!
//! A bag without an index (after a crash of the recorder: `.bag.active`) or with a damaged one is
//! read once from its start. Intact parts are used, and the others are reported.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Read;
use std::path::Path;

use trocar_tables::ros::Description;

use super::bag::Log;
use super::chunks::{Buffers, Chunked, Contents, Input, Message, Piece, RUN};
use super::read_exact_at;
use crate::RecordingError;

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

/// Opens a bag.
///
/// # Errors
/// [`RecordingError`] when it cannot be opened, is of another version, or holds no whole message.
pub(crate) fn open(path: &Path) -> Result<Log, RecordingError> {
    let input = Input::open(path)?;
    let mut magic = [0; MAGIC.len()];
    if read_exact_at(&input.file, &mut magic, 0).is_err() || magic != *MAGIC {
        let found = String::from_utf8_lossy(&magic).trim_end().to_owned();
        let problem = format!(
            "begins with '{found}', expected '#ROSBAG V2.0'\n\nhint: bring a bag of an older version up to date with rosbag fix OLD.bag NEW.bag"
        );
        return Err(RecordingError::unusable(path.display(), problem));
    }
    let Index { connections, mut contents } = match read_index(&input) {
        Some(index) => index,
        None => walk(&input),
    };
    contents.complete::<Ros1>(path, &input, connections.keys().copied())?;
    let groups = contents.groups(connections.iter().map(|(id, connection)| (*id, connection)));
    let described = groups.into_iter().map(|(connection, group)| {
        let description = Description {
            name: &connection.topic,
            kind: &connection.kind,
            encoding: "ros1",
            schema_encoding: "ros1msg",
            definition: &connection.definition,
            rows: None,
            has_publish_time: false,
        };
        (description, group)
    });
    Ok(contents.log::<Ros1>(path, described.collect()))
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
fn record_at(input: &Input, at: u64) -> Option<(Vec<u8>, u64, u64)> {
    let Input { file, size } = input;
    let mut length = [0; 4];
    read_exact_at(file, &mut length, at).ok()?;
    let header_length = u32::from_le_bytes(length);
    let data = at + 8 + u64::from(header_length);
    if header_length > LARGEST_HEADER || data > *size {
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

/// Content of the index, or result of a scan of the file.
#[derive(Debug, Default)]
struct Index {
    connections: BTreeMap<u32, Connection>,
    contents: Contents,
}

impl Index {
    fn learn(&mut self, fields: Fields, data: &[u8]) -> Option<()> {
        let (id, connection) = Connection::read(fields, data)?;
        if self.connections.len() < MOST_CONNECTIONS {
            self.connections.entry(id).or_insert(connection);
        }
        Some(())
    }
}

/// The chunks of the format.
struct Ros1;

impl Chunked for Ros1 {
    const NAME: &'static str = "ROS 1 bag";

    fn size(input: &Input, piece: &Piece) -> u64 {
        // The decompressed size is not known.
        record_at(input, piece.at).map_or(0, |(_, data, end)| end.saturating_sub(data).min(LARGEST))
    }

    fn load<'a>(input: &Input, piece: &Piece, buffers: &'a mut Buffers) -> Option<&'a [u8]> {
        let Buffers { stored, decompressed } = buffers;
        if let Some(length) = piece.length.filter(|length| piece.at + length <= input.size) {
            stored.resize(length as usize, 0);
            read_exact_at(&input.file, stored, piece.at).ok()?;
            return Some(stored);
        }
        let (header, data, end) = record_at(input, piece.at)?;
        let header = Fields(&header);
        if header.op() != Some(CHUNK) || end > input.size || end - data > LARGEST {
            return None;
        }
        stored.resize((end - data) as usize, 0);
        read_exact_at(&input.file, stored, data).ok()?;
        let mut reader: Box<dyn Read> = match header.get("compression")? {
            b"none" => return Some(stored),
            b"bz2" => Box::new(bzip2::read::BzDecoder::new(&stored[..])),
            b"lz4" => Box::new(lz4_flex::frame::FrameDecoder::new(&stored[..])),
            _ => return None,
        };
        let size = u64::from(header.u32("size")?);
        decompressed.clear();
        let read = reader.by_ref().take(size.min(LARGEST)).read_to_end(decompressed).ok()?;
        (read as u64 == size).then_some(decompressed)
    }

    fn messages(records: &[u8], take: &mut dyn FnMut(Message)) {
        let mut rest = records;
        while let Some((fields, data, after)) = split_record(rest) {
            rest = after;
            if fields.op() == Some(MESSAGE)
                && let Some(message) = message(fields, data)
            {
                take(message);
            }
        }
    }

    fn damage(pieces: u64, _bytes: u64) -> Option<String> {
        let plural = if pieces == 1 { "" } else { "s" };
        (pieces > 0).then(|| format!("{pieces} damaged chunk{plural} or record{plural} left out"))
    }
}

fn message<'a>(fields: Fields, payload: &'a [u8]) -> Option<Message<'a>> {
    let log = fields.time("time")?;
    Some(Message { channel: fields.u32("conn")?, log, publish: log, payload })
}

/// The index at the end of the bag; `None` if there is no reliable one.
fn read_index(input: &Input) -> Option<Index> {
    let size = input.size;
    let (header, _, data_end) = record_at(input, MAGIC.len() as u64)?;
    let header = Fields(&header);
    let from = header.u64("index_pos").filter(|from| (data_end..size).contains(from))?;
    if header.op() != Some(BAG) || size - from > LARGEST_INDEX {
        return None;
    }
    let mut bytes = vec![0; (size - from) as usize];
    read_exact_at(&input.file, &mut bytes, from).ok()?;
    let mut index = Index::default();
    let mut rest = &bytes[..];
    while let Some((fields, data, after)) = split_record(rest) {
        rest = after;
        match fields.op()? {
            CONNECTION => index.learn(fields, data)?,
            CHUNK_INFO => {
                let at = fields.u64("chunk_pos").filter(|at| *at < from)?;
                let mut channels = BTreeSet::new();
                for pair in data.as_chunks::<8>().0 {
                    let [id, count] = [pair.first_chunk()?, pair.last_chunk()?]
                        .map(|bytes| u32::from_le_bytes(*bytes));
                    channels.insert(id);
                    *index.contents.counts.entry(id).or_default() += u64::from(count);
                }
                let start = fields.time("start_time")?;
                let piece = Piece::empty(at, None, true);
                index.contents.pieces.push(Piece { start, channels: Some(channels), ..piece });
            }
            _ => return None,
        }
    }
    let is_whole = rest.is_empty()
        && Some(index.contents.pieces.len() as u64) == header.u32("chunk_count").map(u64::from)
        && Some(index.connections.len() as u64) == header.u32("conn_count").map(u64::from)
        && index.contents.counts.keys().all(|id| index.connections.contains_key(id));
    (is_whole && !index.contents.pieces.is_empty()).then_some(index)
}

/// Scans the whole file, record by record.
fn walk(input: &Input) -> Index {
    let size = input.size;
    let mut walker = Walker { index: Index::default(), run: None, damaged: 0 };
    let mut at = MAGIC.len() as u64;
    let mut buffers = Buffers::default();
    while let Some((header, data, end)) = record_at(input, at) {
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
                let piece = Piece::empty(at, None, true);
                match Ros1::load(input, &piece, &mut buffers) {
                    Some(records) => walker.chunk(records, piece),
                    None => walker.damaged += 1,
                }
            }
            Some(op @ (MESSAGE | CONNECTION)) => {
                let mut bytes = vec![0; (end - data).min(LARGEST) as usize];
                let read = read_exact_at(&input.file, &mut bytes, data).is_ok();
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
    let mut index = walker.index;
    let megabytes = (size - at.min(size)) as f64 / 1e6;
    index.contents.warnings.push(format!(
        "the bag has no whole index, as after a crash of the recorder or when it was cut off: its messages were sought from the start, and the last {megabytes:.3} MB, which are not whole records, are left out"
    ));
    index.contents.warnings.extend(Ros1::damage(walker.damaged, 0));
    index
}

struct Walker {
    index: Index,
    /// Consecutive records outside of chunks.
    run: Option<Piece>,
    damaged: u64,
}

impl Walker {
    fn end_run(&mut self) {
        let run = self.run.take();
        self.add(run);
    }

    /// Adds a part, if it holds messages.
    fn add(&mut self, piece: Option<Piece>) {
        self.index.contents.pieces.extend(
            piece.filter(|piece| piece.channels.as_ref().is_some_and(|held| !held.is_empty())),
        );
    }

    /// A message or connection outside of chunks, from `at` to `end`.
    fn record(&mut self, op: u8, fields: Fields, data: &[u8], at: u64, end: u64) -> Option<()> {
        if op == CONNECTION {
            self.end_run();
            return self.index.learn(fields, data);
        }
        let mut run = match self.run.take() {
            Some(run) if run.at + run.length.unwrap_or(0) == at => run,
            other => {
                self.add(other);
                Piece::empty(at, Some(0), false)
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
        let message = message(fields, data)?;
        let counts = &self.index.contents.counts;
        if counts.len() >= MOST_CONNECTIONS && !counts.contains_key(&message.channel) {
            return None;
        }
        piece.add(message);
        self.index.contents.count(message);
        Some(())
    }

    fn chunk(&mut self, records: &[u8], mut piece: Piece) {
        let mut rest = records;
        let mut whole = true;
        while let Some((fields, data, after)) = split_record(rest) {
            rest = after;
            whole &= match fields.op() {
                Some(MESSAGE) => self.message(fields, data, &mut piece).is_some(),
                Some(CONNECTION) => self.index.learn(fields, data).is_some(),
                _ => true,
            };
        }
        self.damaged += u64::from(!whole || !rest.is_empty());
        self.add(Some(piece));
    }
}
