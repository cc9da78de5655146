//! What there is to identify: a folder, a manifest, or a Parquet data set in which recordings are rows.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::one::Input;
use super::row::Cell;
use crate::error::TableError;
use crate::recording::{Choice, Readings, RecordingError, TableColumn, TableColumns};
use crate::table::{self, Column, Table};

/// Endings of files that may be recordings.
const ENDINGS: [&str; 18] = [
    "csv", "tsv", "txt", "dat", "gz", "zst", "parquet", "pq", "arrow", "feather", "ipc", "mat", "h5", "hdf5", "mcap",
    "db3", "bag", "log",
];

/// Name that Hive gives to a missing value.
const HIVE_NONE: &str = "__HIVE_DEFAULT_PARTITION__";

/// Column that tells recordings apart where none is named.
const RECORDING: &str = "recording";

/// Columns that come with a recording, by name.
pub type Metadata = BTreeMap<String, Cell>;

/// Why there is nothing to identify.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DatasetError {
    /// A folder or file cannot be read.
    #[error("{}: cannot read: {source}", path.display())]
    Read {
        /// Which.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A table cannot be read.
    #[error(transparent)]
    Table(#[from] TableError),
    /// No recording in it.
    #[error(
        "{}: no recordings, expected files that end in {}\n\nhint: a manifest, a CSV or Parquet file with a column 'path', names files \
         with other endings",
        path.display(), ENDINGS.join(", ")
    )]
    Empty {
        /// The data set.
        path: PathBuf,
    },
    /// A file that is neither manifest nor data set.
    #[error(
        "{}: no manifest and no data set: neither a column 'path' nor a column '{group}' among {found}\n\nhint: one recording by itself is \
         identified with `trocar identify`; recordings that are rows of one table are told apart with --group-by COLUMN",
        path.display()
    )]
    NoDataset {
        /// The file.
        path: PathBuf,
        /// Column looked for.
        group: String,
        /// Columns found.
        found: String,
    },
    /// A manifest's row that cannot be used.
    #[error("{} row {row}: {problem}", path.display())]
    Row {
        /// The manifest.
        path: PathBuf,
        /// Its row, from 1, without the header.
        row: usize,
        /// What is wrong.
        problem: String,
    },
}

/// What is to be identified.
#[derive(Debug, Clone, PartialEq)]
pub struct Dataset {
    /// Files with recordings, in the order of their names or of the manifest.
    pub sources: Vec<Source>,
    /// Files of the folder that are left out for their ending.
    pub left_out: Vec<String>,
}

/// A file with one recording, or with several.
#[derive(Debug, Clone, PartialEq)]
pub struct Source {
    /// Name in the table: the path as seen from the data set.
    pub name: String,
    /// Where it is.
    pub path: PathBuf,
    /// What is known about it beside what it holds.
    pub metadata: Metadata,
    /// The column that tells several recordings apart.
    pub group_by: Option<String>,
}

/// One recording of a source.
pub(super) struct Job {
    pub(super) name: String,
    pub(super) path: PathBuf,
    pub(super) metadata: Metadata,
    /// `None` for a file that is one recording.
    group: Option<Group>,
}

/// Rows of a table.
struct Group {
    table: Arc<Table>,
    rows: Vec<usize>,
    by: String,
}

impl Dataset {
    /// What there is at `path`; `group_by` names the column of Parquet files that tells recordings apart (`recording`
    /// where a file has that), and `without` are files that are no part of it.
    ///
    /// # Errors
    /// [`DatasetError`] when there is nothing to identify, or a manifest is wrong.
    pub fn open(path: &Path, group_by: Option<&str>, without: &[PathBuf]) -> Result<Self, DatasetError> {
        let failed = |source| DatasetError::Read { path: path.to_owned(), source };
        if std::fs::metadata(path).map_err(failed)?.is_dir() {
            return Self::folder(path, group_by, without);
        }
        let is_parquet = ends_in(path, &["parquet", "pq"]);
        let names = if is_parquet { table::names(path)? } else { header(path)? };
        if names.iter().any(|name| name == "path") {
            let rows = if is_parquet { table::read(path)? } else { text_table(path)? };
            return Self::manifest(path, &rows);
        }
        let group = group_by.unwrap_or(RECORDING);
        if is_parquet && names.iter().any(|name| name == group) {
            let name = file_name(path);
            let source =
                Source { name, path: path.to_owned(), metadata: Metadata::new(), group_by: Some(group.to_owned()) };
            return Ok(Self { sources: vec![source], left_out: Vec::new() });
        }
        let found = names.join(", ");
        Err(DatasetError::NoDataset { path: path.to_owned(), group: group.to_owned(), found })
    }

    fn folder(root: &Path, group_by: Option<&str>, without: &[PathBuf]) -> Result<Self, DatasetError> {
        let without: Vec<PathBuf> = without.iter().filter_map(|path| path.canonicalize().ok()).collect();
        let mut files = Vec::new();
        walk(root, &mut files, &mut BTreeSet::new())?;
        files.retain(|file| file.canonicalize().map_or(true, |path| !without.contains(&path)));
        let name = |path: &Path| {
            let parts = path.strip_prefix(root).unwrap_or(path).components();
            parts.map(|part| part.as_os_str().to_string_lossy().into_owned()).collect::<Vec<_>>().join("/")
        };
        files.sort_by_key(|path| name(path));
        let (taken, left_out): (Vec<_>, Vec<_>) =
            files.into_iter().partition(|path| ends_in(path, &ENDINGS) || is_bag(path));
        let mut sources = Vec::with_capacity(taken.len());
        for path in taken {
            let group_by = grouping(&path, group_by);
            let name = name(&path);
            sources.push(Source { metadata: hive(&name), name, path, group_by });
        }
        if sources.is_empty() {
            return Err(DatasetError::Empty { path: root.to_owned() });
        }
        settle_kinds(&mut sources);
        Ok(Self { sources, left_out: left_out.iter().map(|path| name(path)).collect() })
    }

    fn manifest(path: &Path, table: &Table) -> Result<Self, DatasetError> {
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut seen = BTreeMap::new();
        let mut sources = Vec::with_capacity(table.rows());
        for row in 0..table.rows() {
            let wrong = |problem| DatasetError::Row { path: path.to_owned(), row: row + 1, problem };
            let mut metadata: Metadata = table.fields.iter().cloned().zip(cells(table, row)).collect();
            let Some(Cell::Text(name)) = metadata.remove("path").filter(|c| c.as_text().is_some_and(|t| !t.is_empty()))
            else {
                return Err(wrong("no path".to_owned()));
            };
            if let Some(first) = seen.insert(name.clone(), row + 1) {
                return Err(wrong(format!("{name} stands in row {first} already")));
            }
            let path = folder.join(&name);
            sources.push(Source { name, path, metadata, group_by: None });
        }
        if sources.is_empty() {
            return Err(DatasetError::Empty { path: path.to_owned() });
        }
        settle_kinds(&mut sources);
        Ok(Self { sources, left_out: Vec::new() })
    }
}

fn ends_in(path: &Path, endings: &[&str]) -> bool {
    let own = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
    endings.iter().any(|ending| own.eq_ignore_ascii_case(ending))
}

fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

/// Whether a folder is a ROS 2 bag.
fn is_bag(folder: &Path) -> bool {
    folder.join("metadata.yaml").is_file()
}

/// All files below `folder`, hidden ones left out; a bag folder counts as one. A folder that is reached twice, through a link, counts
/// once.
fn walk(folder: &Path, files: &mut Vec<PathBuf>, seen: &mut BTreeSet<PathBuf>) -> Result<(), DatasetError> {
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

/// The column by which the recordings of a Parquet file are told apart, if it holds several.
fn grouping(path: &Path, group_by: Option<&str>) -> Option<String> {
    if !ends_in(path, &["parquet", "pq"]) {
        return None;
    }
    let group = group_by.unwrap_or(RECORDING);
    // A file that cannot be read becomes a row that says so.
    let names = table::names(path).ok()?;
    names.iter().any(|name| name == group).then(|| group.to_owned())
}

/// What folders called `key=value` say.
fn hive(name: &str) -> Metadata {
    let pairs = name.split('/').rev().skip(1).filter_map(|folder| folder.split_once('='));
    let cell = |value: &str| if value == HIVE_NONE || value.is_empty() { Cell::Empty } else { Cell::text(value) };
    pairs.map(|(key, value)| (key.to_owned(), cell(value))).collect()
}

/// Text columns that hold numbers throughout become numbers.
fn settle_kinds(sources: &mut [Source]) {
    let mut names: Vec<String> = sources.iter().flat_map(|source| source.metadata.keys().cloned()).collect();
    names.sort_unstable();
    names.dedup();
    for name in names {
        let texts = || sources.iter().filter_map(|source| source.metadata.get(&name)).filter_map(Cell::as_text);
        let whole = texts().all(|text| text.parse::<i64>().is_ok());
        let number = texts().all(|text| text.parse::<f64>().is_ok_and(f64::is_finite));
        if !number {
            continue;
        }
        for cell in sources.iter_mut().filter_map(|source| source.metadata.get_mut(&name)) {
            if let Cell::Text(text) = cell {
                *cell = match (whole, text.parse::<i64>(), text.parse::<f64>()) {
                    (true, Ok(value), _) => Cell::Integer(value),
                    (_, _, Ok(value)) => Cell::Float(value),
                    _ => continue,
                };
            }
        }
    }
}

/// Cells of one row.
fn cells(table: &Table, row: usize) -> Vec<Cell> {
    table.columns.iter().map(|column| cell(column, row)).collect()
}

fn cell(column: &Column, row: usize) -> Cell {
    match column {
        Column::Number(cells) => Cell::number(cells[row]),
        Column::Whole(cells) => cells[row].map_or(Cell::Empty, Cell::Integer),
        Column::Truth(cells) => cells[row].map_or(Cell::Empty, Cell::Flag),
        Column::Text(cells) => cells[row].as_ref().map_or(Cell::Empty, |text| Cell::text(text.clone())),
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

/// A CSV file of words; empty cells are missing ones.
fn text_table(path: &Path) -> Result<Table, DatasetError> {
    let bytes = std::fs::read(path).map_err(|source| DatasetError::Read { path: path.to_owned(), source })?;
    let mut lines = fields(&bytes).into_iter();
    let names = lines.next().unwrap_or_default();
    let mut columns: Vec<Vec<Option<std::borrow::Cow<'static, str>>>> = vec![Vec::new(); names.len()];
    for (row, line) in lines.enumerate() {
        if line.len() != names.len() {
            let problem = format!("{} cells, expected {} as in the header", line.len(), names.len());
            return Err(DatasetError::Row { path: path.to_owned(), row: row + 1, problem });
        }
        let cells = line.into_iter().map(|cell| (!cell.is_empty()).then(|| cell.into()));
        columns.iter_mut().zip(cells).for_each(|(column, cell)| column.push(cell));
    }
    Ok(Table { fields: names, columns: columns.into_iter().map(Column::Text).collect() })
}

/// Cells of all lines of a CSV file, quotes taken off; lines without anything are left out.
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
    /// The recordings in it.
    ///
    /// # Errors
    /// In words, where the file cannot be read.
    pub(super) fn jobs(&self) -> Result<Vec<Job>, String> {
        let Some(by) = &self.group_by else { return Ok(vec![self.whole()]) };
        let table = Arc::new(table::read(&self.path).map_err(|error| error.to_string())?);
        let Some(column) = table.column(by) else { return Ok(vec![self.whole()]) };
        let mut order: Vec<String> = Vec::new();
        let mut rows: BTreeMap<String, Vec<usize>> = BTreeMap::new();
        for row in 0..table.rows() {
            let value = cell(column, row).in_words();
            let own = rows.entry(value.clone()).or_default();
            if own.is_empty() {
                order.push(value);
            }
            own.push(row);
        }
        let job = |value: String| Job {
            name: format!("{}#{value}", self.name),
            path: self.path.clone(),
            metadata: self.metadata.clone(),
            group: rows.remove(&value).map(|rows| Group { table: Arc::clone(&table), rows, by: by.clone() }),
        };
        Ok(order.into_iter().map(job).collect())
    }

    pub(super) fn whole(&self) -> Job {
        Job { name: self.name.clone(), path: self.path.clone(), metadata: self.metadata.clone(), group: None }
    }
}

impl Job {
    /// Whether the file is the recording.
    pub(super) fn is_file(&self) -> bool {
        self.group.is_none()
    }

    /// What is handed to the identification; the constant columns of a group become metadata.
    ///
    /// # Errors
    /// [`RecordingError`] where a group has no columns of time, position and force.
    pub(super) fn input(&mut self, choice: &Choice) -> Result<Input, RecordingError> {
        let Some(group) = self.group.take() else { return Ok(Input::File(self.path.clone())) };
        let varies = |column: &Column| group.rows.iter().any(|row| cell(column, *row) != cell(column, group.rows[0]));
        let mut names = Vec::new();
        let mut columns = Vec::new();
        let by_order = choice.columns.as_ref().is_some_and(|names| !names.contains('='));
        for (name, column) in group.table.fields.iter().zip(&group.table.columns) {
            let (varies, is_text) = (varies(column), matches!(column, Column::Text(_) | Column::Truth(_)));
            if !varies {
                self.metadata.insert(name.clone(), cell(column, group.rows[0]));
            }
            if *name != group.by && (by_order || (varies && !is_text)) {
                names.push(name.clone());
                columns.push(column);
            }
        }
        let found = TableColumns::find(&self.name, &names, choice.columns.as_deref())?;
        let take = |column: TableColumn| {
            let number = |row: &usize| cell(columns[column.index], *row).as_number().unwrap_or(f64::NAN);
            group.rows.iter().map(|row| number(row) / column.per_si).collect()
        };
        let [time, position, force] = found.needed.map(take);
        let readings = Readings { time, position, force, velocity: found.velocity.map(take) };
        Ok(Input::Columns { name: self.name.clone(), readings })
    }
}
