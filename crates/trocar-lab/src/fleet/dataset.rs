//! The input of a fleet run: a folder, a manifest, or a Parquet data set in which recordings are
//! rows.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::one::Input;
use super::parts::{self, Group};
use super::row::{FleetCell, columns};
use trocar_recording::{self, ReadOptions, RecordingError, registry};
use trocar_tables::error::TableError;
use trocar_tables::table::{self, Column, Table};

/// Extensions of files that may hold rows of several recordings.
const ROWS: [&str; 2] = ["parquet", "pq"];

/// Name that Hive gives to a missing value.
const HIVE_NONE: &str = "__HIVE_DEFAULT_PARTITION__";

/// Column that distinguishes recordings if none is named.
const RECORDING: &str = "recording";

/// Metadata of a recording by column name.
pub type Metadata = BTreeMap<String, FleetCell>;

/// Why a data set cannot be opened.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DatasetError {
    /// A folder or file cannot be read.
    #[error("{}: cannot read: {source}", path.display())]
    Read {
        /// The folder or file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// A table cannot be read.
    #[error(transparent)]
    Table(#[from] TableError),
    /// The data set contains no recording.
    #[error(
        "{}: no recordings, expected files that end in {}\n\nhint: a manifest, a CSV or Parquet file with a column 'path', names files \
         with other extensions",
        path.display(), registry::endings().collect::<Vec<_>>().join(", ")
    )]
    Empty {
        /// The data set.
        path: PathBuf,
    },
    /// A file that is neither a manifest nor a data set.
    #[error(
        "{}: no manifest and no data set: neither a column 'path' nor a column '{group}' among {found}\n\nhint: one recording by itself is \
         identified with `trocar identify`; --group-by COLUMN separates recordings that are rows of one table",
        path.display()
    )]
    NoDataset {
        /// The file.
        path: PathBuf,
        /// Column that was expected.
        group: String,
        /// Columns found.
        found: String,
    },
    /// A row of the manifest that cannot be used.
    #[error("{} row {row}: {problem}", path.display())]
    Row {
        /// The manifest.
        path: PathBuf,
        /// Row number, from 1, without the header.
        row: usize,
        /// The problem.
        problem: String,
    },
}

/// The recordings to identify.
#[derive(Debug, Clone, PartialEq)]
pub struct Dataset {
    /// Files with recordings, in the order of their names or of the manifest.
    pub sources: Vec<Source>,
    /// Files of the folder that are omitted because of their extension.
    pub left_out: Vec<String>,
}

/// The unit of work: a file with one or several recordings, and the rows that these have in other
/// files.
///
/// A recording with rows in several files belongs to the source of the first of them by name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Source {
    /// Name in the table: the path relative to the data set.
    pub name: String,
    /// Path of the file.
    pub path: PathBuf,
    /// Metadata that come in addition to the content of the file.
    pub metadata: Metadata,
    /// The column that distinguishes several recordings.
    pub group_by: Option<String>,
    /// All files with rows of its recordings, in the order of their names; empty for a single file.
    pub parts: Vec<DataFile>,
    /// Recordings with rows in it that belong to another source.
    pub elsewhere: Vec<String>,
}

/// A file of a data set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DataFile {
    /// The path relative to the data set.
    pub name: String,
    /// Path of the file.
    pub path: PathBuf,
    /// Metadata from the names of the folders.
    pub metadata: Metadata,
}

/// One recording of a source.
pub(super) struct Job {
    pub(super) name: String,
    pub(super) path: PathBuf,
    pub(super) metadata: Metadata,
    /// Warning about how its rows were combined.
    pub(super) warning: Option<String>,
    /// `None` for a file that is one recording.
    pub(super) group: Option<Group>,
}

impl Dataset {
    /// Opens `path`. `group_by` names the column of Parquet files, or the key of folders, that
    /// distinguishes recordings (`recording` if that exists). The files in `without` are ignored, if
    /// they are what an earlier run has written.
    ///
    /// In Parquet files with that column, the column is read.
    ///
    /// # Errors
    /// [`DatasetError`] when there is nothing to identify, or a manifest is invalid.
    pub fn open(
        path: &Path,
        group_by: Option<&str>,
        without: &[PathBuf],
    ) -> Result<Self, DatasetError> {
        let failed = |source| DatasetError::Read { path: path.to_owned(), source };
        if std::fs::metadata(path).map_err(failed)?.is_dir() {
            return Self::folder(path, group_by, without);
        }
        let is_parquet = ends_in(path, ROWS);
        let names = if is_parquet { table::names(path)? } else { header(path)? };
        if names.iter().any(|name| name == "path") {
            let rows = if is_parquet { table::read(path)? } else { text_table(path)? };
            return Self::manifest(path, &rows);
        }
        let group = group_by.unwrap_or(RECORDING);
        if is_parquet && names.iter().any(|name| name == group) {
            let part = DataFile {
                name: file_name(path),
                path: path.to_owned(),
                metadata: Metadata::new(),
            };
            return Ok(Self { sources: vec![Source::of(part, Some(group))], left_out: Vec::new() });
        }
        let found = names.join(", ");
        Err(DatasetError::NoDataset { path: path.to_owned(), group: group.to_owned(), found })
    }

    fn folder(
        root: &Path,
        group_by: Option<&str>,
        without: &[PathBuf],
    ) -> Result<Self, DatasetError> {
        let without: Vec<PathBuf> =
            without.iter().filter_map(|path| path.canonicalize().ok()).collect();
        let mut files = Vec::new();
        walk(root, &mut files, &mut BTreeSet::new())?;
        files.retain(|file| {
            !file.canonicalize().is_ok_and(|path| without.contains(&path)) || !is_written(file)
        });
        let name = |path: &Path| {
            let parts = path.strip_prefix(root).unwrap_or(path).components();
            parts
                .map(|part| part.as_os_str().to_string_lossy().into_owned())
                .collect::<Vec<_>>()
                .join("/")
        };
        files.sort_by_key(|path| name(path));
        let (taken, left_out): (Vec<_>, Vec<_>) =
            files.into_iter().partition(|path| ends_in(path, registry::endings()) || is_bag(path));
        let file = |path: PathBuf| {
            let name = name(&path);
            DataFile { metadata: hive(&name), name, path }
        };
        let mut files: Vec<DataFile> = taken.into_iter().map(file).collect();
        settle_kinds(&mut files);
        let sources = sources(files, group_by.unwrap_or(RECORDING));
        if sources.is_empty() {
            return Err(DatasetError::Empty { path: root.to_owned() });
        }
        Ok(Self { sources, left_out: left_out.iter().map(|path| name(path)).collect() })
    }

    /// All files with recordings.
    pub fn files(&self) -> Vec<PathBuf> {
        let of = |source: &Source| {
            let parts = source.parts.iter().map(|part| part.path.clone());
            parts.chain([source.path.clone()]).collect::<Vec<_>>()
        };
        self.sources.iter().flat_map(of).collect()
    }

    fn manifest(path: &Path, table: &Table) -> Result<Self, DatasetError> {
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut seen = BTreeMap::new();
        let mut files = Vec::with_capacity(table.rows());
        for row in 0..table.rows() {
            let wrong =
                |problem| DatasetError::Row { path: path.to_owned(), row: row + 1, problem };
            let mut metadata: Metadata =
                table.fields.iter().cloned().zip(cells(table, row)).collect();
            let Some(FleetCell::Text(name)) =
                metadata.remove("path").filter(|c| c.as_text().is_some_and(|t| !t.is_empty()))
            else {
                return Err(wrong("no path".to_owned()));
            };
            if let Some(first) = seen.insert(name.clone(), row + 1) {
                return Err(wrong(format!("{name} is already in row {first}")));
            }
            let path = folder.join(&name);
            files.push(DataFile { name, path, metadata });
        }
        if files.is_empty() {
            return Err(DatasetError::Empty { path: path.to_owned() });
        }
        settle_kinds(&mut files);
        Ok(Self {
            sources: files.into_iter().map(|file| Source::of(file, None)).collect(),
            left_out: Vec::new(),
        })
    }
}

/// Whether a file was written by an earlier run: its journal, or a table with the columns of one.
fn is_written(file: &Path) -> bool {
    let names = |table: &trocar_recording::Table| -> BTreeSet<String> {
        table.columns.iter().map(|column| column.name.clone()).collect()
    };
    ends_in(file, ["journal"])
        || trocar_recording::tables(file).is_ok_and(|tables| {
            tables.iter().any(|table| columns().iter().all(|own| names(table).contains(&own.name)))
        })
}

fn ends_in(path: &Path, extensions: impl IntoIterator<Item = &'static str>) -> bool {
    let own = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    extensions.into_iter().any(|extension| own.eq_ignore_ascii_case(extension))
}

fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

/// Whether a folder is a ROS 2 bag.
fn is_bag(folder: &Path) -> bool {
    folder.join("metadata.yaml").is_file()
}

/// All files below `folder` except hidden ones; a bag folder counts as one. A folder that is
/// reached twice, through a link, counts once.
fn walk(
    folder: &Path,
    files: &mut Vec<PathBuf>,
    seen: &mut BTreeSet<PathBuf>,
) -> Result<(), DatasetError> {
    let failed = |source| DatasetError::Read { path: folder.to_owned(), source };
    if !seen.insert(folder.canonicalize().map_err(failed)?) {
        return Ok(());
    }
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if file_name(&path).starts_with(['.', '_']) {
            continue;
        }
        match path.is_dir() && !is_bag(&path) {
            true => walk(&path, files, seen)?,
            false => files.push(path),
        }
    }
    Ok(())
}

/// How the recordings of a file are distinguished.
enum Holds {
    /// The file is one recording, or does not specify any.
    One,
    /// The file is a part of the recording stored in this folder.
    PartOf(String),
    /// Values of a column, in order of appearance; `None` if they cannot be read.
    Several(Option<Vec<String>>),
}

/// Groups the files into units of work: each recording belongs to the first file with rows of it.
fn sources(files: Vec<DataFile>, by: &str) -> Vec<Source> {
    let holds: Vec<Holds> = files.par_iter().map(|file| holds(file, by)).collect();
    let mut folders: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    let mut begun: HashMap<(Vec<&str>, &str), usize> = HashMap::new();
    let mut goes_on: Vec<BTreeSet<usize>> = vec![BTreeSet::new(); files.len()];
    let mut elsewhere: Vec<Vec<String>> = vec![Vec::new(); files.len()];
    for (k, holds) in holds.iter().enumerate() {
        match holds {
            Holds::PartOf(folder) => folders.entry(folder).or_default().push(k),
            // Rows without a value in different files are not the same recording.
            Holds::Several(Some(values)) => {
                values.iter().filter(|value| !value.is_empty()).for_each(|value| {
                    let first = *begun.entry((keys(&files[k].name), value)).or_insert(k);
                    if first != k {
                        goes_on[first].extend([first, k]);
                        elsewhere[k].push(value.clone());
                    }
                })
            }
            Holds::One | Holds::Several(None) => {}
        }
    }
    let mut sources = Vec::with_capacity(files.len());
    for (k, holds) in holds.iter().enumerate() {
        let parts = |of: &mut dyn Iterator<Item = &usize>| {
            of.map(|part| files[*part].clone()).collect::<Vec<DataFile>>()
        };
        match holds {
            Holds::Several(Some(values)) if values.len() == elsewhere[k].len() => {}
            Holds::Several(_) => {
                let (parts, elsewhere) =
                    (parts(&mut goes_on[k].iter()), std::mem::take(&mut elsewhere[k]));
                sources.push(Source { parts, elsewhere, ..Source::of(files[k].clone(), Some(by)) });
            }
            Holds::PartOf(folder) if folders[folder.as_str()].len() > 1 => {
                let all = &folders[folder.as_str()];
                if all[0] == k {
                    sources.push(Source::folder(folder, parts(&mut all.iter())));
                }
            }
            Holds::One | Holds::PartOf(_) => sources.push(Source::of(files[k].clone(), None)),
        }
    }
    sources
}

/// Content of a file according to the column or folder key `by`.
fn holds(file: &DataFile, by: &str) -> Holds {
    if !ends_in(&file.path, ROWS) {
        return Holds::One;
    }
    // A file that cannot be read becomes a row with the reason.
    let names = table::names(&file.path).unwrap_or_default();
    if names.iter().any(|name| name == by) {
        return Holds::Several(parts::values(file, by).ok());
    }
    let folders: Vec<&str> = file.name.split('/').collect();
    let is_key = |folder: &&str| {
        key_value(folder).is_some_and(|(key, value)| key == by && value != FleetCell::Empty)
    };
    match folders[..folders.len() - 1].iter().position(is_key) {
        Some(at) => Holds::PartOf(folders[..=at].join("/")),
        None => Holds::One,
    }
}

/// Metadata from folders named `key=value`; inner folders take precedence.
fn hive(name: &str) -> Metadata {
    name.split('/').rev().skip(1).filter_map(key_value).collect()
}

/// The folders named `key=value` above a file: equal values elsewhere are other recordings.
fn keys(name: &str) -> Vec<&str> {
    name.split('/').rev().skip(1).filter(|folder| key_value(folder).is_some()).collect()
}

/// Key and value of a folder named `key=value`.
fn key_value(folder: &str) -> Option<(String, FleetCell)> {
    let (key, value) = folder.split_once('=')?;
    let cell = if value == HIVE_NONE || value.is_empty() {
        FleetCell::Empty
    } else {
        FleetCell::text(unescaped(value))
    };
    Some((unescaped(key), cell))
}

/// Decodes `%20` and similar escapes, which engines write for characters that a folder name must
/// not contain.
fn unescaped(text: &str) -> String {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let [first, others @ ..] = rest {
        let escaped = others
            .get(..2)
            .filter(|_| *first == b'%')
            .and_then(|code| std::str::from_utf8(code).ok());
        let byte = escaped.and_then(|code| u8::from_str_radix(code, 16).ok());
        bytes.push(byte.unwrap_or(*first));
        rest = if byte.is_some() { &others[2..] } else { others };
    }
    String::from_utf8(bytes).unwrap_or_else(|_| text.to_owned())
}

/// Converts text columns that contain only numbers to numbers.
fn settle_kinds(files: &mut [DataFile]) {
    let mut names: Vec<String> =
        files.iter().flat_map(|file| file.metadata.keys().cloned()).collect();
    names.sort_unstable();
    names.dedup();
    for name in names {
        let texts = || {
            files.iter().filter_map(|file| file.metadata.get(&name)).filter_map(FleetCell::as_text)
        };
        let whole = texts().all(|text| text.parse::<i64>().is_ok());
        let number = texts().all(|text| text.parse::<f64>().is_ok_and(f64::is_finite));
        if !number {
            continue;
        }
        for cell in files.iter_mut().filter_map(|file| file.metadata.get_mut(&name)) {
            if let FleetCell::Text(text) = cell {
                *cell = match (whole, text.parse::<i64>(), text.parse::<f64>()) {
                    (true, Ok(value), _) => FleetCell::Integer(value),
                    (_, _, Ok(value)) => FleetCell::Float(value),
                    _ => continue,
                };
            }
        }
    }
}

/// Cells of one row.
fn cells(table: &Table, row: usize) -> Vec<FleetCell> {
    table.columns.iter().map(|column| cell(column, row)).collect()
}

fn cell(column: &Column, row: usize) -> FleetCell {
    match column {
        Column::Number(cells) => FleetCell::number(cells[row]),
        Column::Integer(cells) => cells[row].map_or(FleetCell::Empty, FleetCell::Integer),
        Column::Boolean(cells) => cells[row].map_or(FleetCell::Empty, FleetCell::Boolean),
        Column::Text(cells) => {
            cells[row].as_ref().map_or(FleetCell::Empty, |text| FleetCell::text(text.clone()))
        }
    }
}

/// Names in the first line of a text file.
fn header(path: &Path) -> Result<Vec<String>, DatasetError> {
    const LONGEST: u64 = 1 << 16;
    let failed = |source| DatasetError::Read { path: path.to_owned(), source };
    let mut start = Vec::new();
    File::open(path).and_then(|file| file.take(LONGEST).read_to_end(&mut start)).map_err(failed)?;
    let line = start.split(|byte| *byte == b'\n').next().unwrap_or_default();
    Ok(fields(line).into_iter().next().unwrap_or_default())
}

/// A CSV file of strings; empty cells are missing values. It may be a table of results.
fn text_table(path: &Path) -> Result<Table, DatasetError> {
    let bytes = std::fs::read(path)
        .map_err(|source| DatasetError::Read { path: path.to_owned(), source })?;
    let mut lines = fields(&bytes).into_iter();
    let names = lines.next().unwrap_or_default();
    let mut columns: Vec<Vec<Option<std::borrow::Cow<'static, str>>>> =
        vec![Vec::new(); names.len()];
    for (row, line) in lines.enumerate() {
        if line.len() != names.len() {
            let problem =
                format!("{} cells, expected {} as in the header", line.len(), names.len());
            return Err(DatasetError::Row { path: path.to_owned(), row: row + 1, problem });
        }
        let cells = line
            .into_iter()
            .map(|cell| (!cell.is_empty()).then(|| table::csv::original(&cell).to_owned().into()));
        columns.iter_mut().zip(cells).for_each(|(column, cell)| column.push(cell));
    }
    Ok(Table { fields: names, columns: columns.into_iter().map(Column::Text).collect() })
}

/// Cells of all lines of a CSV file, without quotes; empty lines are omitted.
fn fields(bytes: &[u8]) -> Vec<Vec<String>> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let mut reader = csv_core::Reader::new();
    let (mut lines, mut line, mut cell) = (Vec::new(), Vec::new(), Vec::new());
    let (mut input, mut output) = (bytes, [0; 4096]);
    loop {
        let (outcome, read, written) = reader.read_field(input, &mut output);
        input = &input[read..];
        cell.extend_from_slice(&output[..written]);
        match outcome {
            csv_core::ReadFieldResult::InputEmpty | csv_core::ReadFieldResult::OutputFull => {}
            csv_core::ReadFieldResult::Field { record_end } => {
                line.push(String::from_utf8_lossy(&std::mem::take(&mut cell)).trim().to_owned());
                if record_end {
                    lines.push(std::mem::take(&mut line));
                }
            }
            csv_core::ReadFieldResult::End => return lines,
        }
    }
}

impl Source {
    fn of(DataFile { name, path, metadata }: DataFile, group_by: Option<&str>) -> Self {
        let group_by = group_by.map(str::to_owned);
        Self { name, path, metadata, group_by, parts: Vec::new(), elsewhere: Vec::new() }
    }

    /// A folder whose files form one recording.
    fn folder(name: &str, parts: Vec<DataFile>) -> Self {
        let depth = name.split('/').count();
        let first = &parts[0];
        let above = first.name.split('/').count() - depth;
        let path = first.path.ancestors().nth(above).unwrap_or(&first.path).to_owned();
        let (metadata, _) = in_common(parts.iter().map(|part| &part.metadata));
        Self { name: name.to_owned(), path, metadata, group_by: None, parts, elsewhere: Vec::new() }
    }

    /// The recordings in it.
    ///
    /// # Errors
    /// [`RecordingError`] where a file cannot be read.
    pub(super) fn jobs(&self) -> Result<Vec<Job>, RecordingError> {
        match self.group_by.is_none() && self.parts.is_empty() {
            true => Ok(vec![self.whole()]),
            false => parts::jobs(self),
        }
    }

    pub(super) fn whole(&self) -> Job {
        let (name, path, metadata) = (self.name.clone(), self.path.clone(), self.metadata.clone());
        Job { name, path, metadata, warning: None, group: None }
    }
}

/// The metadata common to all of them, and the names of those that differ.
pub(super) fn in_common<'a>(
    all: impl Iterator<Item = &'a Metadata>,
) -> (Metadata, BTreeSet<String>) {
    let mut all = all.peekable();
    let mut common = all.peek().map_or_else(Metadata::new, |first| (*first).clone());
    let mut differing = BTreeSet::new();
    for metadata in all {
        for name in common.keys().chain(metadata.keys()) {
            if common.get(name) != metadata.get(name) {
                differing.insert(name.clone());
            }
        }
    }
    common.retain(|name, _| !differing.contains(name));
    (common, differing)
}

impl Job {
    /// Whether the file is the recording.
    pub(super) fn is_file(&self) -> bool {
        self.group.is_none()
    }

    /// The input of the identification; the constant columns of a group become metadata.
    ///
    /// # Errors
    /// [`RecordingError`] if a group has no columns of time, position and force, or cannot be read.
    pub(super) fn input(&mut self, reading: &ReadOptions) -> Result<Input, RecordingError> {
        match &self.group {
            Some(group) => group.input(&self.name, reading, &mut self.metadata),
            None => Ok(Input::File(self.path.clone())),
        }
    }
}
