//! ROS 2 bags: SQLite files (`.db3`), and folders with a `metadata.yaml` that split a recording
//! into several `.db3` or `.mcap` files.
//!
//! Messages of a SQLite file are read in the order in which they were written, a page at a time,
//! and sorted by [`super::ordered`]. The parts of a folder are read in the order of their first
//! times; a part that `metadata.yaml` does not list does not belong to the bag.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rusqlite::{Connection, OpenFlags, params};
use trocar_tables::ros::{self, Block, Description, Epochs, Extractor, Topic};

use super::Source;
use super::bag::{Log, Messages};
use super::ordered::{Blocks, Ordered};
use crate::container::{Container, Content, Opened};
use crate::{RecordingError, Table};

/// Messages read from the database at a time.
const PAGE: u32 = 4096;

/// First bytes of a SQLite file.
const MAGIC: &[u8; 16] = b"SQLite format 3\0";

/// First bytes of a zstd frame: an individually compressed message. No ROS message begins in this
/// way.
const ZSTD: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// Largest message decompressed, in bytes.
const LARGEST: usize = 1 << 28;

/// The file that identifies a folder as a bag.
const METADATA: &str = "metadata.yaml";

/// Opens a `.db3` file, or the folder of a bag.
///
/// # Errors
/// [`RecordingError`] when it cannot be opened, is not a bag, or contains no messages.
pub(crate) fn open(path: &Path) -> Result<Container, RecordingError> {
    if path.is_dir() {
        return Folder::open(path);
    }
    Ok(open_db3(path)?.into())
}

/// A row of `topics`.
struct Listed {
    id: i64,
    name: String,
    kind: String,
    encoding: String,
}

fn problem(path: &Path, what: impl std::fmt::Display) -> RecordingError {
    RecordingError::unusable(path.display(), what.to_string())
}

/// Opens for reading; if that fails, for example because nothing may be written next to the file,
/// opens the file as immutable.
fn connect(path: &Path) -> rusqlite::Result<Connection> {
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let connection = Connection::open_with_flags(path, flags)?;
    match probe(&connection) {
        Ok(_) => Ok(connection),
        Err(_) => {
            let escaped = path
                .display()
                .to_string()
                .replace('%', "%25")
                .replace('?', "%3f")
                .replace('#', "%23");
            let address = format!("file:{escaped}?immutable=1");
            let connection =
                Connection::open_with_flags(address, flags | OpenFlags::SQLITE_OPEN_URI)?;
            probe(&connection).map(|_| connection)
        }
    }
}

fn probe(connection: &Connection) -> rusqlite::Result<i64> {
    connection.query_row("SELECT count(*) FROM sqlite_master", [], |row| row.get(0))
}

fn open_db3(path: &Path) -> Result<Log, RecordingError> {
    use std::io::Read;
    let mut magic = [0; MAGIC.len()];
    let mut input = std::fs::File::open(path).map_err(RecordingError::cannot_open(path))?;
    if input.read_exact(&mut magic).is_err() || magic != *MAGIC {
        return Err(problem(path, "does not begin as a SQLite file does"));
    }
    let (listed, connection) = connect(path)
        .and_then(|connection| Ok((list(&connection)?, connection)))
        .map_err(|error| problem(path, format!("is no ROS 2 bag, or damaged: {error}")))?;
    let definitions = definitions(&connection).unwrap_or_default();
    let start = connection
        .query_row("SELECT min(timestamp) FROM messages", [], |row| row.get::<_, Option<i64>>(0));
    let mut warnings = Vec::new();
    let start = start.unwrap_or_else(|error| {
        warnings.push(format!("the file is damaged: {error}"));
        None
    });
    let counts = counts(&connection).ok();
    let (mut topics, mut ids) = (Vec::new(), Vec::new());
    for Listed { id, name, kind, encoding } in &listed {
        let Some(first) = first(&connection, *id) else { continue };
        let (schema_encoding, definition) = definitions.get(kind).cloned().unwrap_or_default();
        let description = Description {
            name,
            kind,
            encoding,
            schema_encoding: &schema_encoding,
            definition: &definition,
            rows: counts.as_ref().map(|counts| counts.get(id).copied().unwrap_or(0)),
            has_publish_time: false,
        };
        let (topic, problem) = Topic::new(&description, Some(&first));
        topics.push(topic);
        ids.push(*id);
        warnings.extend(problem);
    }
    if topics.is_empty() {
        return Err(problem(path, warnings.first().map_or("holds no messages", |warning| warning)));
    }
    let start = start.map(|start| start as u64);
    let messages = Box::new(Db3 { path: path.to_owned(), ids });
    Ok(Log::new(path, "ROS 2 bag (SQLite)", start, topics, warnings, messages))
}

/// A SQLite file, and the number of each topic in it.
struct Db3 {
    path: PathBuf,
    ids: Vec<i64>,
}

impl Messages for Db3 {
    fn blocks(
        &self,
        topic: usize,
        extractor: Extractor,
    ) -> Result<Box<dyn Blocks>, RecordingError> {
        let connection = connect(&self.path).map_err(|error| problem(&self.path, error))?;
        Ok(Box::new(Pages {
            connection,
            topic: self.ids[topic],
            after: i64::MIN,
            extractor,
            lost: None,
        }))
    }
}

fn list(connection: &Connection) -> rusqlite::Result<Vec<Listed>> {
    let mut query = connection
        .prepare("SELECT id, name, type, serialization_format FROM topics ORDER BY id")?;
    let rows = query.query_map([], |row| {
        Ok(Listed { id: row.get(0)?, name: row.get(1)?, kind: row.get(2)?, encoding: row.get(3)? })
    })?;
    rows.collect()
}

/// Encoding and text of the definition of each type; bags before version 4 of their schema have
/// none.
fn definitions(connection: &Connection) -> rusqlite::Result<BTreeMap<String, (String, String)>> {
    let query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions";
    let mut query = connection.prepare(query)?;
    let rows = query.query_map([], |row| Ok((row.get(0)?, (row.get(1)?, row.get(2)?))))?;
    rows.collect()
}

fn counts(connection: &Connection) -> rusqlite::Result<BTreeMap<i64, u64>> {
    let mut query =
        connection.prepare("SELECT topic_id, count(*) FROM messages GROUP BY topic_id")?;
    let rows = query.query_map([], |row| Ok((row.get(0)?, row.get::<_, i64>(1)? as u64)))?;
    rows.collect()
}

fn first(connection: &Connection, topic: i64) -> Option<Vec<u8>> {
    let query = "SELECT data FROM messages WHERE topic_id = ?1 ORDER BY id LIMIT 1";
    let data: Vec<u8> = connection.query_row(query, [topic], |row| row.get(0)).ok()?;
    Some(decompressed(&data).unwrap_or(data))
}

/// The message in a zstd frame, if there is one.
fn decompressed(data: &[u8]) -> Option<Vec<u8>> {
    if !data.starts_with(&ZSTD) {
        return None;
    }
    let size =
        zstd::zstd_safe::get_frame_content_size(data).ok().flatten().unwrap_or(LARGEST as u64);
    let size = usize::try_from(size).ok().filter(|size| *size <= LARGEST)?;
    let mut message = Vec::new();
    super::decompress_zstd(data, size, &mut message).ok().map(|()| message)
}

/// The messages of one topic, a page at a time.
struct Pages {
    connection: Connection,
    topic: i64,
    /// Last row read.
    after: i64,
    extractor: Extractor,
    lost: Option<String>,
}

impl Pages {
    fn page(&mut self, block: &mut Block) -> rusqlite::Result<()> {
        let query = "SELECT id, timestamp, data FROM messages WHERE id > ?1 AND topic_id = ?2 ORDER BY id LIMIT ?3";
        let mut query = self.connection.prepare(query)?;
        let mut rows = query.query(params![self.after, self.topic, PAGE])?;
        while let Some(row) = rows.next()? {
            let id = row.get(0)?;
            // A damaged tree may lead back, and the pages would never end.
            if id <= self.after {
                self.lost =
                    Some(format!("the file is damaged after message {}: {id} is next", self.after));
                break;
            }
            self.after = id;
            let time: i64 = row.get(1)?;
            let data = row.get_ref(2)?.as_blob().unwrap_or_default();
            let decompressed = decompressed(data);
            let time = time as u64;
            self.extractor.add(time, time, decompressed.as_deref().unwrap_or(data), block);
        }
        Ok(())
    }
}

impl Blocks for Pages {
    fn next(&mut self) -> Result<Option<Block>, RecordingError> {
        if self.lost.is_some() {
            return Ok(None);
        }
        let mut block = Block::new(self.extractor.width());
        if let Err(error) = self.page(&mut block) {
            self.lost = Some(format!("the file is damaged after message {}: {error}", self.after));
        }
        Ok((!block.log.is_empty()).then_some(block))
    }

    fn warnings(&self) -> Vec<String> {
        self.lost.iter().cloned().collect()
    }
}

/// Opens one file of a bag.
fn open_part(path: &Path) -> Result<Log, RecordingError> {
    match path.extension().and_then(|extension| extension.to_str()) {
        #[cfg(feature = "mcap")]
        Some("mcap") => super::mcap::open(path),
        #[cfg(not(feature = "mcap"))]
        Some("mcap") => {
            Err(problem(path, "MCAP files are read with the feature mcap, which this build lacks"))
        }
        _ => open_db3(path),
    }
}

/// A folder with the parts of a bag.
struct Folder {
    path: PathBuf,
    /// In the order of the first time.
    parts: Vec<Log>,
    epochs: Epochs,
}

impl Folder {
    fn open(path: &Path) -> Result<Container, RecordingError> {
        let metadata = match std::fs::read_to_string(path.join(METADATA)) {
            Ok(metadata) => Some(metadata),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => None,
            Err(source) => return Err(RecordingError::cannot_open(path)(source)),
        };
        let entries = std::fs::read_dir(path).map_err(RecordingError::cannot_open(path))?;
        let mut paths: Vec<PathBuf> =
            entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
        paths.retain(|path| {
            path.extension().is_some_and(|extension| extension == "db3" || extension == "mcap")
        });
        paths.sort();
        let (mut parts, mut notes, mut warnings) = (Vec::new(), Vec::new(), Vec::new());
        let mut failed = None;
        for path in &paths {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            if metadata.as_ref().is_some_and(|text| !text.contains(&*name)) {
                notes.push(format!("{name} is not named in {METADATA} and left out"));
                continue;
            }
            match open_part(path) {
                Ok(part) => parts.push(part),
                Err(error) => {
                    warnings.push(error.to_string());
                    failed = Some(error);
                }
            }
        }
        if parts.is_empty() {
            return Err(failed.unwrap_or_else(|| {
                problem(path, format!("holds no bag: expected {METADATA} and .db3 or .mcap files"))
            }));
        }
        Ok(Self::joined(path, parts, notes, warnings))
    }

    /// Sorts the parts and merges their topics.
    fn joined(
        path: &Path,
        mut parts: Vec<Log>,
        mut notes: Vec<String>,
        mut warnings: Vec<String>,
    ) -> Container {
        parts.sort_by_key(|part| part.start);
        let start = parts.iter().filter_map(|part| part.start).min().unwrap_or(0);
        let topics = parts.iter().flat_map(|part| &part.topics);
        let epochs = ros::epochs(topics.clone(), start as i64);
        let mut tables: Vec<Table> = Vec::new();
        for table in topics.clone().map(|topic| &topic.table) {
            match tables
                .iter_mut()
                .find(|known| known.name == table.name && known.kind == table.kind)
            {
                Some(known) => {
                    known.rows = known.rows.zip(table.rows).map(|(rows, more)| rows + more);
                    let more =
                        table.columns.iter().filter(|column| !known.columns.contains(column));
                    let more: Vec<_> = more.cloned().collect();
                    known.columns.extend(more);
                }
                None => tables.push(table.clone()),
            }
        }
        notes.extend(ros::epoch_notes(topics, epochs));
        notes.push(format!("{} files in the order of their first times", parts.len()));
        for part in &parts {
            let name = part.path.file_name().unwrap_or_default().to_string_lossy();
            warnings.extend(part.warnings.iter().map(|warning| format!("{name}: {warning}")));
        }
        let source = Source { file: path.display().to_string(), format: "ROS 2 bag (folder)" };
        let folder = Self { path: path.to_owned(), parts, epochs };
        Container { notes, warnings, ..Container::new(source, tables, folder) }
    }
}

impl Content for Folder {
    fn clock(&self, _at: usize, table: &Table, column: usize) -> usize {
        let mut topics = self.parts.iter().flat_map(|part| &part.topics);
        topics
            .find(|topic| topic.table.name == table.name && topic.table.kind == table.kind)
            .map_or(0, |topic| topic.clock(column, self.epochs))
    }

    fn open(&self, _at: usize, table: &Table, columns: &[usize]) -> Opened {
        let mut blocks = Vec::new();
        for part in &self.parts {
            let mut own = part.topics.iter().map(|topic| &topic.table);
            let place = own.position(|own| own.name == table.name && own.kind == table.kind);
            let Some(place) = place else { continue };
            let topic = &part.topics[place];
            let places: Vec<Option<usize>> = columns
                .iter()
                .map(|&column| topic.table.columns.iter().position(|c| *c == table.columns[column]))
                .collect();
            blocks.push(part.messages.blocks(place, topic.extractor_of(&places, self.epochs))?);
        }
        let chain = Chain { blocks, at: 0 };
        let file = self.path.display().to_string();
        Ok(Box::new(Ordered::new(&file, &table.name, chain, columns.len(), table.rows)))
    }
}

/// The blocks of one part after those of another.
struct Chain {
    blocks: Vec<Box<dyn Blocks>>,
    at: usize,
}

impl Blocks for Chain {
    fn next(&mut self) -> Result<Option<Block>, RecordingError> {
        while let Some(part) = self.blocks.get_mut(self.at) {
            if let Some(mut block) = part.next()? {
                // A later part may start before the end of this one; only the window accounts for
                // that.
                block.settled = None;
                return Ok(Some(block));
            }
            self.at += 1;
        }
        Ok(None)
    }

    fn warnings(&self) -> Vec<String> {
        self.blocks.iter().flat_map(|part| part.warnings()).collect()
    }
}
