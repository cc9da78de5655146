//! Rows of a recording in SI units, in blocks, from any kind of file.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::thread::JoinHandle;

use sha2::{Digest, Sha256};
use trocar_tables::text::{Head, TextInput};

use super::block::{Block, SampleRow};
use super::choice::{Choice, Picked, check_topics, pick};
use super::columns::Layout;
use super::container::{Batches, Container};
use super::registry;
use super::samples::Count;
use super::text::{TextBatches, TextReader, hex};
use super::units::Quantity;
use super::{Location, RecordingError, log};

/// Note on a file for which [`Rows::is_by_own_header`].
pub const BY_OWN_HEADER: &str =
    "the columns of the model's recordings are not in this file: read by its own header";

/// Bytes hashed at a time.
const HASHED: usize = 1 << 20;

/// Reads rows of a file or stream.
pub struct Rows<'a> {
    batches: Box<dyn Batches + 'a>,
    layout: Layout,
    /// The last batch, by the columns of the layout.
    raw: Vec<Vec<f64>>,
    /// Number of rows, if the file states it.
    rows: Option<u64>,
    read: u64,
    count: Count,
    warnings: Vec<String>,
    /// Of a file that is no text.
    hash: Option<JoinHandle<Result<String, RecordingError>>>,
    crop: Crop,
    /// Whether the columns of a choice from another file were missing.
    is_by_own_header: bool,
    /// Rows numbered so far, if times follow from a rate.
    numbered: u64,
    block: Block,
    /// Next row of the block.
    next: usize,
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
        let opened = Self::of_text(&name, text.clone(), None, choice, needed, hash).or_else(|_| {
            head.rewind();
            Self::of_text(&name, text, None, &own, needed, hash).map(Self::by_own_header)
        });
        head.forget();
        opened
    }

    fn by_own_header(mut self) -> Self {
        self.layout.notes.push(BY_OWN_HEADER.to_owned());
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
            let mut rows = Self::of_table(&file, &container, choice, needed)?;
            rows.hash = hash.then(|| hash_of(path));
            return Ok(rows);
        }
        let input = TextInput::open(path).map_err(RecordingError::cannot_open(path))?;
        Self::of_text(&file, input.text, input.file, choice, needed, hash)
    }

    fn of_table(
        file: &str,
        container: &Container,
        choice: &Choice,
        needed: &[Quantity],
    ) -> Result<Self, RecordingError> {
        let mut warnings = container.warnings.clone();
        let (mut layout, batches, rows) = if log::is_log(&container.tables) {
            let chosen = log::choose(file, container, choice, needed)?;
            warnings.extend(chosen.warnings);
            (chosen.layout, chosen.batches, None)
        } else {
            let Picked { table, columns, layout } = pick(file, container, choice, needed)?;
            (layout, container.open(table, &columns)?, container.tables[table].rows)
        };
        layout.notes.extend_from_slice(&container.notes);
        Ok(Self { rows, warnings, ..Self::new(batches, layout, Count::Rows, choice) })
    }
}

impl<'a> Rows<'a> {
    /// Rows of a text stream that is used in real time; `file` names it in messages.
    ///
    /// # Errors
    /// As for [`Rows::open`].
    pub fn from_text(
        file: &str,
        text: Box<dyn Read + Send + 'a>,
        choice: &Choice,
        needed: &[Quantity],
    ) -> Result<Self, RecordingError> {
        Self::of_text(file, text, None, choice, needed, false)
    }

    /// `input`: size of the file and bytes read, as in [`TextInput`].
    fn of_text(
        file: &str,
        text: Box<dyn Read + Send + 'a>,
        input: Option<(u64, Arc<AtomicU64>)>,
        choice: &Choice,
        needed: &[Quantity],
        hash: bool,
    ) -> Result<Self, RecordingError> {
        choice.check_rate(file)?;
        let reader = TextReader::open(file, text, choice.skip_rows, input.is_some(), hash)?;
        let layout = choice.layout_of_text(&reader, needed)?;
        let (batches, layout) = TextBatches::start(reader, layout, input)?;
        check_topics(file, choice)?;
        Ok(Self::new(Box::new(batches), layout, Count::Lines, choice))
    }

    fn new(
        batches: Box<dyn Batches + 'a>,
        mut layout: Layout,
        count: Count,
        choice: &Choice,
    ) -> Self {
        if choice.flip_force {
            layout.flip_force();
        }
        Self {
            raw: vec![Vec::new(); layout.slots.iter().flatten().count()],
            batches,
            layout,
            rows: None,
            read: 0,
            count,
            warnings: Vec::new(),
            hash: None,
            crop: Crop::new(choice),
            is_by_own_header: false,
            numbered: 0,
            block: Block::new(Quantity::ALL.len()),
            next: 0,
        }
    }

    /// Whether the file lacks the columns of a choice that is [from another
    /// file](Choice::from_another_file), so that its own header was used.
    pub fn is_by_own_header(&self) -> bool {
        self.is_by_own_header
    }

    pub(crate) fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Unit in which positions are counted.
    pub(crate) fn count(&self) -> Count {
        self.count
    }

    /// Position of a row.
    pub fn place(&self, row: SampleRow) -> Location {
        self.count.place(row.line)
    }

    /// Approximate number of rows, if known in advance.
    pub(crate) fn expected(&self) -> Option<u64> {
        self.rows.or_else(|| self.batches.expected())
    }

    /// Approximate fraction of the rows read so far, 0 to 1; 0 if their number is unknown.
    pub fn part(&self) -> f64 {
        let all = self.expected().filter(|all| *all > 0);
        all.map_or(0.0, |all| (self.read as f64 / all as f64).min(1.0))
    }

    /// SHA-256 of the file, in hexadecimal; valid after the last row, if requested.
    pub(crate) fn digest(&mut self) -> Result<String, RecordingError> {
        match self.hash.take() {
            Some(hash) => hash.join().expect("hashing does not panic"),
            None => Ok(self.batches.digest()),
        }
    }

    /// How columns were chosen and rows computed; complete after the last row.
    pub(crate) fn notes(&self) -> Vec<String> {
        self.layout.notes.iter().cloned().chain(self.batches.notes()).collect()
    }

    /// Losses and doubts about the file itself; complete after the last row.
    pub(crate) fn warnings(&self) -> Vec<String> {
        self.warnings.iter().cloned().chain(self.batches.warnings()).collect()
    }

    /// The next rows, or `None` at the end.
    pub(crate) fn next_block(&mut self) -> Result<Option<&Block>, RecordingError> {
        loop {
            self.next = 0;
            if !self.fill()? {
                return Ok(None);
            }
            if let Some(rate) = self.layout.rate_hz {
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

    /// Replaces the content of the block by the next batch, in SI units; `false` at the end.
    fn fill(&mut self) -> Result<bool, RecordingError> {
        self.block.clear();
        if !self.batches.next(&mut self.raw)? {
            return Ok(false);
        }
        for (slot, raw) in self.layout.slots.iter().flatten().zip(&mut self.raw) {
            let column = &mut self.block.columns[slot.output];
            std::mem::swap(column, raw);
            if slot.per_si != 1.0 {
                column.iter_mut().for_each(|x| *x /= slot.per_si);
            }
        }
        // Rows are counted from 1, like lines.
        self.block.lines = self.batches.lines().unwrap_or_else(|| vec![(0, self.read + 1)]);
        self.read += self.block.len() as u64;
        Ok(true)
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
    let files = match std::fs::read_dir(path) {
        Ok(entries) => entries.flatten().map(|entry| entry.path()).collect(),
        Err(_) => vec![path.to_owned()],
    };
    files.iter().map(|file| std::fs::metadata(file).map_or(0, |metadata| metadata.len())).sum()
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
