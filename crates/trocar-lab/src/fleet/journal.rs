//! Journal of finished recordings: one line of JSON per recording, appended as they finish, next to
//! the table.
//!
//! A line counts only if it is complete; a truncated last line is removed. An entry is reused if
//! the name, the hash of the recording and the hash of the configuration are unchanged.

use std::collections::HashMap;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::dataset::Dataset;
use super::one::Config;
use super::row::{FleetRow, columns};
use trocar_tables::error::OutputError;
use trocar_tables::output::refuse_inputs;

/// Longest time until a finished recording is safe from a power failure.
const SYNC: Duration = Duration::from_secs(1);

/// One finished recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Entry {
    pub(super) name: String,
    /// Hash of the recording; empty if it could not be read.
    pub(super) sha256: String,
    pub(super) config: String,
    pub(super) row: FleetRow,
}

/// Position of an entry in the journal, and the hash of its recording.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct EntryLocation {
    pub(super) at: u64,
    pub(super) length: usize,
    pub(super) sha256: String,
}

/// The journal, opened exclusively by one process.
pub(super) struct Journal {
    path: PathBuf,
    file: File,
    end: u64,
    synced: Instant,
}

/// Path of the journal of a table.
pub fn journal_path(table: &Path) -> PathBuf {
    let mut name = table.as_os_str().to_owned();
    name.push(".journal");
    PathBuf::from(name)
}

impl Journal {
    /// Opens the journal of `table` and finds its entries for `config`, by name.
    ///
    /// # Errors
    /// [`OutputError`] when it cannot be written, another process is writing it, or table or journal
    /// would replace a recording of `dataset`.
    pub(super) fn open(
        dataset: &Dataset,
        table: &Path,
        config: &Config,
    ) -> Result<(Self, HashMap<String, EntryLocation>), OutputError> {
        let path = &journal_path(table);
        refuse_inputs([table, path], &dataset.files())?;
        let create = |source| OutputError::Create { path: path.to_owned(), source };
        let file = OpenOptions::new()
            .create(true)
            .truncate(false)
            .read(true)
            .write(true)
            .open(path)
            .map_err(create)?;
        lock(&file).map_err(create)?;
        let (places, end) = read(&file, &config.hash()).map_err(create)?;
        file.set_len(end).map_err(create)?;
        Ok((Self { path: path.to_owned(), file, end, synced: Instant::now() }, places))
    }

    /// Appends a finished recording. It survives the end of this process immediately, and a power
    /// failure after at most a second.
    ///
    /// # Errors
    /// [`OutputError::Write`], for example on a full disk.
    pub(super) fn append(&mut self, entry: &Entry) -> Result<EntryLocation, OutputError> {
        self.write(entry).map_err(|source| self.failed(source))
    }

    fn write(&mut self, entry: &Entry) -> io::Result<EntryLocation> {
        let mut line = serde_json::to_vec(entry)?;
        line.push(b'\n');
        self.file.seek(SeekFrom::Start(self.end))?;
        self.file.write_all(&line)?;
        let place =
            EntryLocation { at: self.end, length: line.len(), sha256: entry.sha256.clone() };
        self.end += line.len() as u64;
        if self.synced.elapsed() >= SYNC {
            self.file.sync_data()?;
            self.synced = Instant::now();
        }
        Ok(place)
    }

    /// The row stored at `place`.
    ///
    /// # Errors
    /// [`OutputError::Write`] when the file was modified externally.
    pub(super) fn row(&mut self, place: &EntryLocation) -> Result<FleetRow, OutputError> {
        let mut line = vec![0; place.length];
        let read =
            self.file.seek(SeekFrom::Start(place.at)).and_then(|_| self.file.read_exact(&mut line));
        let entry = read.and_then(|()| Ok(serde_json::from_slice::<Entry>(&line)?));
        entry.map(|entry| entry.row).map_err(|source| self.failed(source))
    }

    /// Removes the journal once the table is complete.
    ///
    /// # Errors
    /// [`OutputError::Write`] when it cannot be removed.
    pub(super) fn remove(self) -> Result<(), OutputError> {
        std::fs::remove_file(&self.path).map_err(|source| self.failed(source))
    }

    fn failed(&self, source: io::Error) -> OutputError {
        OutputError::Write { path: self.path.clone(), source }
    }
}

/// Locks the file. Waits a little, since the lock of a process that has just been killed may
/// persist for a short time.
fn lock(file: &File) -> io::Result<()> {
    const PATIENCE: Duration = Duration::from_secs(2);
    let begun = Instant::now();
    loop {
        match file.try_lock() {
            Ok(()) => return Ok(()),
            Err(TryLockError::Error(source)) => return Err(source),
            Err(TryLockError::WouldBlock) if begun.elapsed() < PATIENCE => {
                std::thread::sleep(Duration::from_millis(50));
            }
            Err(TryLockError::WouldBlock) => {
                return Err(io::Error::other("another trocar fleet is writing this table"));
            }
        }
    }
}

/// The entries for `config`, and the end of the last complete line.
fn read(file: &File, config: &str) -> io::Result<(HashMap<String, EntryLocation>, u64)> {
    let mut lines = BufReader::new(file);
    let (mut places, mut line, mut at) = (HashMap::new(), Vec::new(), 0);
    let cells = columns().len();
    loop {
        line.clear();
        let length = lines.read_until(b'\n', &mut line)?;
        if line.last() != Some(&b'\n') {
            return Ok((places, at));
        }
        // An invalid line is skipped: its recording is identified again.
        if let Ok(Entry { name, sha256, config: own, row }) = serde_json::from_slice(&line)
            && own == config
            && row.cells.len() == cells
        {
            places.insert(name, EntryLocation { at, length, sha256 });
        }
        at += length as u64;
    }
}
