//! Rows of a recording in SI units, in blocks, from any kind of file.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::JoinHandle;

use sha2::{Digest, Sha256};
use trocar_tables::text::{Head, TextInput};

use super::block::{Block, SampleRow};
use super::choice::{Choice, Picked, check_topics, pick};
use super::columns::Layout;
use super::container::{Batches, Container};
use super::registry;
use super::samples::Count;
use super::text::{TextReader, hex};
use super::units::Quantity;
use super::{Location, RecordingError, log};

/// Note on a file for which [`Rows::is_by_own_header`].
pub const BY_OWN_HEADER: &str =
    "the columns of the model's recordings are not in this file: read by its own header";

/// Bytes hashed at a time.
const HASHED: usize = 1 << 20;

/// Reads rows of a file or stream.
pub struct Rows<'a> {
    source: Source<'a>,
    /// Size of a text file, and number of bytes read; compressed or not.
    text_file: Option<(u64, Arc<AtomicU64>)>,
    crop: Crop,
    /// Whether the columns of a choice from another file were missing.
    is_by_own_header: bool,
    /// Rows numbered so far, if times follow from a rate.
    numbered: u64,
    block: Block,
    /// Next row of the block.
    next: usize,
}

enum Source<'a> {
    Text(Box<TextReader<Box<dyn Read + Send + 'a>>>),
    Table(Box<TableRows>),
}

impl Rows<'static> {
    /// Opens the file at `path`, or standard input for `-`, up to its first row.
    ///
    /// # Errors
    /// As for [`read`](crate::read), as far as they are detected before the first row.
    pub fn open(
        path: &Path,
        choice: &Choice,
        needed: &[Quantity],
        hash: bool,
    ) -> Result<Self, RecordingError> {
        let Some(own) = choice.by_own_header() else {
            return Self::open_with(path, choice, needed, hash);
        };
        if path.is_file() {
            return Self::open_with(path, choice, needed, hash)
                .or_else(|_| Self::open_with(path, &own, needed, hash).map(Self::by_own_header));
        }
        let input = TextInput::open(path).map_err(RecordingError::cannot_open(path))?;
        let (name, head) = (path.display().to_string(), Head::new(input.text));
        let text = Box::new(head.clone());
        let opened =
            Self::from_text(&name, text.clone(), false, choice, needed, hash).or_else(|_| {
                head.rewind();
                Self::from_text(&name, text, false, &own, needed, hash).map(Self::by_own_header)
            });
        head.forget();
        opened
    }

    fn by_own_header(mut self) -> Self {
        self.layout_mut().notes.push(BY_OWN_HEADER.to_owned());
        self.is_by_own_header = true;
        self
    }

    /// The same; if `--columns` does not fit, the error proposes what does.
    fn open_with(
        path: &Path,
        choice: &Choice,
        needed: &[Quantity],
        hash: bool,
    ) -> Result<Self, RecordingError> {
        let opened = Self::open_as_chosen(path, choice, needed, hash);
        let Err(RecordingError::BadColumns { entry, problem, hint }) = opened else {
            return opened;
        };
        let plain = Choice { columns: None, ..choice.clone() };
        let hint = match Self::open_as_chosen(path, &plain, needed, false) {
            _ if !(path.is_file() || path.is_dir()) => hint,
            Ok(rows) => {
                let own = rows.layout().words().join(",");
                format!("by its own header the file is read as ‹columns='{own}'›").into()
            }
            Err(RecordingError::UnclearColumns { hint, .. }) => hint,
            Err(RecordingError::NoHeader { hint, .. }) => hint.into(),
            Err(RecordingError::UnclearTopic { option, .. }) if !option.is_empty() => option.into(),
            Err(_) => hint,
        };
        Err(RecordingError::BadColumns { entry, problem, hint })
    }

    fn open_as_chosen(
        path: &Path,
        choice: &Choice,
        needed: &[Quantity],
        hash: bool,
    ) -> Result<Self, RecordingError> {
        let file = path.display().to_string();
        if file != "-"
            && let Some(container) = registry::open(path, choice.skip_rows)?
        {
            choice.check_rate(&file)?;
            let mut table = TableRows::open(&file, container.as_ref(), choice, needed)?;
            table.hash = hash.then(|| hash_of(path));
            return Ok(Self::new(Source::Table(Box::new(table)), None, choice));
        }
        let input = TextInput::open(path).map_err(RecordingError::cannot_open(path))?;
        let mut rows =
            Self::from_text(&file, input.text, input.file.is_some(), choice, needed, hash)?;
        rows.text_file = input.file;
        Ok(rows)
    }
}

impl<'a> Rows<'a> {
    /// Rows of a text stream; `file` names it in messages; `is_file` if it is not used in real
    /// time.
    ///
    /// # Errors
    /// As for [`Rows::open`].
    pub fn from_text(
        file: &str,
        input: Box<dyn Read + Send + 'a>,
        is_file: bool,
        choice: &Choice,
        needed: &[Quantity],
        hash: bool,
    ) -> Result<Self, RecordingError> {
        choice.check_rate(file)?;
        let reader = TextReader::open(file, input, choice.skip_rows, is_file, hash)?;
        let layout = choice.layout_of_text(&reader, needed)?;
        let reader = reader.start(layout)?;
        check_topics(file, choice)?;
        Ok(Self::new(Source::Text(Box::new(reader)), None, choice))
    }

    fn new(source: Source<'a>, text_file: Option<(u64, Arc<AtomicU64>)>, choice: &Choice) -> Self {
        let crop = Crop::new(choice);
        let mut rows = Self {
            source,
            text_file,
            crop,
            is_by_own_header: false,
            numbered: 0,
            block: Block::new(Quantity::ALL.len()),
            next: 0,
        };
        if choice.flip_force {
            rows.layout_mut().flip_force();
        }
        rows
    }

    /// Whether the file lacks the columns of a choice that is [from another
    /// file](Choice::from_another_file), so that its own header was used.
    pub fn is_by_own_header(&self) -> bool {
        self.is_by_own_header
    }

    pub(crate) fn layout(&self) -> &Layout {
        match &self.source {
            Source::Text(reader) => reader.layout(),
            Source::Table(table) => &table.layout,
        }
    }

    fn layout_mut(&mut self) -> &mut Layout {
        match &mut self.source {
            Source::Text(reader) => reader.layout_mut(),
            Source::Table(table) => &mut table.layout,
        }
    }

    /// Unit in which positions are counted.
    pub(crate) fn count(&self) -> Count {
        match self.source {
            Source::Text(_) => Count::Lines,
            Source::Table(_) => Count::Rows,
        }
    }

    /// Position of a row.
    pub fn place(&self, row: SampleRow) -> Location {
        self.count().place(row.line)
    }

    /// Approximate number of rows, if known in advance.
    pub(crate) fn expected(&self) -> Option<u64> {
        match &self.source {
            Source::Text(reader) => self.text_file.as_ref().map(|(size, read)| {
                let decompressed =
                    reader.bytes_read() as f64 / read.load(Ordering::Relaxed).max(1) as f64;
                (*size as f64 * decompressed / reader.bytes_per_line()) as u64
            }),
            Source::Table(table) => table.rows,
        }
    }

    /// Fraction of the rows read so far, 0 to 1; 0 if their number is unknown.
    pub fn part(&self) -> f64 {
        let (done, all) = match &self.source {
            Source::Text(_) => {
                let file = self.text_file.as_ref();
                file.map_or((0, None), |(size, read)| (read.load(Ordering::Relaxed), Some(*size)))
            }
            Source::Table(table) => (table.read, table.rows),
        };
        all.filter(|all| *all > 0).map_or(0.0, |all| done as f64 / all as f64)
    }

    /// SHA-256 of the file, in hexadecimal; valid after the last row, if requested.
    pub(crate) fn digest(&mut self) -> Result<String, RecordingError> {
        match &mut self.source {
            Source::Text(reader) => Ok(reader.digest()),
            Source::Table(table) => match table.hash.take() {
                Some(hash) => hash.join().expect("hashing does not panic"),
                None => Ok(String::new()),
            },
        }
    }

    /// How columns were chosen and rows computed; complete after the last row.
    pub(crate) fn notes(&self) -> Vec<String> {
        let mut notes = self.layout().notes.clone();
        if let Source::Table(table) = &self.source {
            notes.extend(table.batches.notes());
        }
        notes
    }

    /// Losses and doubts about the file itself; complete after the last row.
    pub(crate) fn warnings(&self) -> Vec<String> {
        match &self.source {
            Source::Text(reader) => reader.warnings(),
            Source::Table(table) => {
                table.warnings.iter().cloned().chain(table.batches.warnings()).collect()
            }
        }
    }

    /// The next rows, or `None` at the end.
    pub(crate) fn next_block(&mut self) -> Result<Option<&Block>, RecordingError> {
        loop {
            let more = match &mut self.source {
                Source::Text(reader) => reader.fill(&mut self.block)?,
                Source::Table(table) => table.fill(&mut self.block)?,
            };
            self.next = 0;
            if !more {
                return Ok(None);
            }
            if let Some(rate) = self.layout().rate_hz {
                let first = self.numbered;
                self.numbered += self.block.len() as u64;
                self.block.columns[Quantity::Time as usize] =
                    (first..self.numbered).map(|row| row as f64 / rate).collect();
            }
            self.crop.cut(&mut self.block);
            if !self.block.is_empty() {
                return Ok(Some(&self.block));
            }
        }
    }

    /// The next row, or `None` at the end.
    ///
    /// # Errors
    /// [`RecordingError`], with the line or row at fault.
    pub fn next_row(&mut self) -> Result<Option<SampleRow>, RecordingError> {
        if self.next == self.block.len() && self.next_block()?.is_none() {
            return Ok(None);
        }
        self.next += 1;
        Ok(Some(self.block.row(self.next - 1)))
    }
}

/// Rows of one table of a container.
struct TableRows {
    batches: Box<dyn Batches>,
    layout: Layout,
    raw: Vec<Vec<f64>>,
    rows: Option<u64>,
    read: u64,
    warnings: Vec<String>,
    hash: Option<JoinHandle<Result<String, RecordingError>>>,
}

impl TableRows {
    fn open(
        file: &str,
        container: &dyn Container,
        choice: &Choice,
        needed: &[Quantity],
    ) -> Result<Self, RecordingError> {
        let mut warnings = container.warnings().to_vec();
        let (layout, batches, rows) = if log::is_log(container.tables()) {
            let chosen = log::choose(file, container, choice, needed)?;
            warnings.extend(chosen.warnings);
            (chosen.layout, chosen.batches, None)
        } else {
            let Picked { table, columns, layout } = pick(file, container, choice, needed)?;
            (layout, container.open(table, &columns)?, container.tables()[table].rows)
        };
        let raw = vec![Vec::new(); layout.slots.iter().flatten().count()];
        let mut own = Self { batches, layout, raw, rows, read: 0, warnings, hash: None };
        own.layout.notes.extend_from_slice(container.notes());
        Ok(own)
    }

    fn fill(&mut self, block: &mut Block) -> Result<bool, RecordingError> {
        block.clear();
        if !self.batches.next(&mut self.raw)? {
            return Ok(false);
        }
        for (slot, raw) in self.layout.slots.iter().flatten().zip(&mut self.raw) {
            let column = &mut block.columns[slot.output];
            std::mem::swap(column, raw);
            if slot.per_si != 1.0 {
                column.iter_mut().for_each(|x| *x /= slot.per_si);
            }
        }
        // Rows are counted from 1, like lines.
        block.count_from(0, self.read + 1);
        self.read += block.len() as u64;
        Ok(true)
    }
}

/// Hashes a file on a separate thread while it is read; for a folder, all files in it, by their
/// names.
fn hash_of(path: &Path) -> JoinHandle<Result<String, RecordingError>> {
    let path: PathBuf = path.to_owned();
    std::thread::spawn(move || {
        let mut hash = Sha256::new();
        let all = hash_files(&path, &mut hash);
        all.map_err(RecordingError::cannot_open(&path))?;
        Ok(hex(&hash.finalize()))
    })
}

/// The hash that a recording read from `path` will have: of the decompressed text, of all files of
/// a folder, or of the file.
///
/// # Errors
/// [`RecordingError`] when the file cannot be opened or read.
pub fn digest_of(path: &Path) -> Result<String, RecordingError> {
    let mut hash = Sha256::new();
    let hashed = match registry::open(path, 0)? {
        Some(_) => hash_files(path, &mut hash),
        None => TextInput::open(path).and_then(|input| hash_stream(input.text, &mut hash)),
    };
    hashed.map_err(RecordingError::cannot_open(path))?;
    Ok(hex(&hash.finalize()))
}

fn hash_files(path: &Path, hash: &mut Sha256) -> std::io::Result<()> {
    let mut files = vec![path.to_owned()];
    if path.is_dir() {
        files = std::fs::read_dir(path)?
            .map(|entry| Ok(entry?.path()))
            .collect::<std::io::Result<_>>()?;
        files.retain(|file| file.is_file());
        files.sort();
    }
    files.into_iter().try_for_each(|file| hash_stream(File::open(file)?, hash))
}

/// Numbers for which memory may be reserved before they are read: as many as the file at `path`, or
/// the files in that folder, have bytes. A number of rows stated in a file proves nothing.
pub(crate) fn justified(path: &Path) -> u64 {
    let length = |path: &Path| std::fs::metadata(path).map_or(0, |metadata| metadata.len());
    match std::fs::read_dir(path) {
        Ok(entries) => entries.flatten().map(|entry| length(&entry.path())).sum(),
        Err(_) => length(path),
    }
}

fn hash_stream(mut stream: impl Read, hash: &mut Sha256) -> std::io::Result<()> {
    let mut bytes = vec![0; HASHED];
    loop {
        match stream.read(&mut bytes)? {
            0 => return Ok(()),
            read => hash.update(&bytes[..read]),
        }
    }
}

/// Selects the rows to keep, by their time after the first.
pub struct Crop {
    from: Option<f64>,
    to: Option<f64>,
    first: Option<f64>,
}

impl Crop {
    /// What `choice` keeps.
    pub fn new(choice: &Choice) -> Self {
        Self { from: choice.from, to: choice.to, first: None }
    }

    /// Indices of the next rows to keep; `None` for all.
    pub fn kept(&mut self, time: &[f64]) -> Option<Vec<usize>> {
        if self.from.is_none() && self.to.is_none() {
            return None;
        }
        self.first = self.first.or_else(|| time.iter().copied().find(|t| t.is_finite()));
        let first = self.first.unwrap_or(0.0);
        let (from, to) = (self.from.unwrap_or(f64::NEG_INFINITY), self.to.unwrap_or(f64::INFINITY));
        let kept: Vec<usize> =
            (0..time.len()).filter(|k| (from..to).contains(&(time[*k] - first))).collect();
        (kept.len() < time.len()).then_some(kept)
    }

    pub(super) fn cut(&mut self, block: &mut Block) {
        let Some(kept) = self.kept(&block.columns[Quantity::Time as usize]) else { return };
        let mut cut = Block::new(block.columns.len());
        for (k, row) in kept.iter().enumerate() {
            cut.count_from(k, block.line(*row));
        }
        for (own, all) in cut.columns.iter_mut().zip(&block.columns) {
            own.extend(kept.iter().filter_map(|row| all.get(*row)));
        }
        *block = cut;
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;
    use crate::{ReadOptions, read};

    /// A journal of recordings uses this hash for look-up, without reading them.
    #[test]
    fn the_hash_of_a_file_is_that_of_its_recording() {
        let folder = tempfile::tempdir().unwrap();
        let text: String =
            (0..100).map(|k| format!("{},{},{}\n", f64::from(k) * 1e-3, k % 30, k % 7)).collect();
        let (plain, compressed) = (folder.path().join("a.csv"), folder.path().join("a.csv.gz"));
        std::fs::write(&plain, &text).unwrap();
        let file = File::create(&compressed).unwrap();
        let mut gzip = flate2::write::GzEncoder::new(file, flate2::Compression::fast());
        gzip.write_all(text.as_bytes()).unwrap();
        gzip.finish().unwrap();
        let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests");
        let raw = Choice::columns("time_s,position_mm,force_n");
        let effort = Choice::columns("position_m=position[insertion],force_n=effort[insertion]");
        let effort = Choice { topics: vec!["measured_js".into()], ..effort };
        for (path, choice) in [
            (plain, raw.clone()),
            (compressed, raw),
            (fixtures.join("formats/polars.parquet"), Choice::default()),
            (fixtures.join("bags/split"), effort),
        ] {
            let recording = read(&path, &ReadOptions { choice, ..ReadOptions::default() }).unwrap();
            assert_eq!(digest_of(&path).unwrap(), recording.sha256, "{}", path.display());
        }
    }
}
