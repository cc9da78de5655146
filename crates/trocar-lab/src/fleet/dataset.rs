//! The input of a fleet run: a folder of recordings, or a manifest that lists them.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::row::{FleetCell, columns};
use trocar_recording::{self, registry};
use trocar_tables::error::TableError;
use trocar_tables::table::{self, Column, Table};

/// Extensions of a manifest that is not text.
const PARQUET: [&str; 2] = ["parquet", "pq"];

/// Name that Hive gives to a missing value.
const HIVE_NONE: &str = "__HIVE_DEFAULT_PARTITION__";

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
    /// A folder without recordings, or a manifest that cannot be used.
    #[error("{place}: {problem}")]
    Unusable {
        /// The folder or file, and the row of it.
        place: String,
        /// The problem, and the remedy.
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

/// The unit of work: a file, or a bag folder, with one recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Source {
    /// Name in the table: the path relative to the data set.
    pub name: String,
    /// Path of the file.
    pub path: PathBuf,
    /// Metadata from the names of the folders, or from the manifest.
    pub metadata: Metadata,
}

impl Dataset {
    /// Opens the folder or manifest at `path`. The files in `without` are ignored, if they are what
    /// an earlier run has written.
    ///
    /// # Errors
    /// [`DatasetError`] when there is nothing to identify, or a manifest is invalid.
    pub fn open(path: &Path, without: &[PathBuf]) -> Result<Self, DatasetError> {
        if std::fs::metadata(path).map_err(unread(path))?.is_dir() {
            return Self::folder(path, without);
        }
        let is_parquet = ends_in(path, PARQUET);
        let names = if is_parquet { table::names(path)? } else { header(path)? };
        if !names.iter().any(|name| name == "path") {
            let found = names.join(", ");
            let problem = format!(
                "no manifest: no column 'path' among {found}\n\nhint: one recording by itself is identified with `trocar identify`; recordings that \
                 are rows of one table are identified group by group, as docs/how-to/rows-of-tables.md shows"
            );
            return Err(DatasetError::Unusable { place: path.display().to_string(), problem });
        }
        let rows = if is_parquet { table::read(path)? } else { text_table(path)? };
        Self::manifest(path, &rows)
    }

    fn folder(root: &Path, without: &[PathBuf]) -> Result<Self, DatasetError> {
        let without: Vec<PathBuf> =
            without.iter().filter_map(|path| path.canonicalize().ok()).collect();
        let mut files = Vec::new();
        walk(root, &mut files, &mut BTreeSet::new())?;
        files.retain(|file| {
            !file.canonicalize().is_ok_and(|path| without.contains(&path)) || !is_written(file)
        });
        files.sort_by_key(|path| name(path, root));
        let (taken, left_out): (Vec<_>, Vec<_>) = files
            .into_iter()
            .partition(|path| ends_in(path, registry::endings()) || registry::is_folder(path));
        if taken.is_empty() {
            return Err(empty(root));
        }
        let mut sources = Vec::with_capacity(taken.len());
        for path in taken {
            let name = name(&path, root);
            sources.push(Source { metadata: hive(&name), name, path });
        }
        settle_kinds(&mut sources);
        Ok(Self { sources, left_out: left_out.iter().map(|path| name(path, root)).collect() })
    }

    /// All files with recordings.
    pub fn files(&self) -> Vec<PathBuf> {
        self.sources.iter().map(|source| source.path.clone()).collect()
    }

    fn manifest(path: &Path, table: &Table) -> Result<Self, DatasetError> {
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut seen = BTreeMap::new();
        let mut sources = Vec::with_capacity(table.rows());
        for row in 0..table.rows() {
            let wrong = |problem| in_row(path, row, problem);
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
            sources.push(Source { name, path, metadata });
        }
        if sources.is_empty() {
            return Err(empty(path));
        }
        settle_kinds(&mut sources);
        Ok(Self { sources, left_out: Vec::new() })
    }
}

/// Of a data set without recordings.
fn empty(path: &Path) -> DatasetError {
    let endings = registry::endings().collect::<Vec<_>>().join(", ");
    let problem = format!(
        "no recordings, expected files that end in {endings}\n\nhint: a manifest, a CSV or Parquet file with a column 'path', names files \
         with other extensions"
    );
    DatasetError::Unusable { place: path.display().to_string(), problem }
}

/// Of a row of a manifest, which counts from 1 without the header.
fn in_row(path: &Path, row: usize, problem: String) -> DatasetError {
    DatasetError::Unusable { place: format!("{} row {}", path.display(), row + 1), problem }
}

fn unread(path: &Path) -> impl Fn(std::io::Error) -> DatasetError {
    |source| DatasetError::Read { path: path.to_owned(), source }
}

/// Whether a file was written by an earlier run: its journal, or a table with the columns of one.
fn is_written(file: &Path) -> bool {
    ends_in(file, ["journal"])
        || trocar_recording::tables(file).is_ok_and(|tables| {
            tables.iter().any(|table| {
                columns()
                    .iter()
                    .all(|own| table.columns.iter().any(|column| column.name == own.name))
            })
        })
}

/// The path of a file below `root`, with slashes.
fn name(path: &Path, root: &Path) -> String {
    let parts = path.strip_prefix(root).unwrap_or(path).components();
    let parts = parts.map(|part| part.as_os_str().to_string_lossy().into_owned());
    parts.collect::<Vec<_>>().join("/")
}

fn ends_in(path: &Path, extensions: impl IntoIterator<Item = &'static str>) -> bool {
    let own = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    extensions.into_iter().any(|extension| own.eq_ignore_ascii_case(extension))
}

fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

/// All files below `folder` except hidden ones; a bag folder counts as one. A folder that is
/// reached twice, through a link, counts once.
fn walk(
    folder: &Path,
    files: &mut Vec<PathBuf>,
    seen: &mut BTreeSet<PathBuf>,
) -> Result<(), DatasetError> {
    // A link may lead back to a folder above.
    if !seen.insert(folder.canonicalize().map_err(unread(folder))?) {
        return Ok(());
    }
    for entry in std::fs::read_dir(folder).map_err(unread(folder))? {
        let path = entry.map_err(unread(folder))?.path();
        if file_name(&path).starts_with(['.', '_']) {
            continue;
        }
        match path.is_dir() && !registry::is_folder(&path) {
            true => walk(&path, files, seen)?,
            false => files.push(path),
        }
    }
    Ok(())
}

/// Metadata from folders named `key=value`; inner folders take precedence.
fn hive(name: &str) -> Metadata {
    name.split('/').rev().skip(1).filter_map(key_value).collect()
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
fn settle_kinds(sources: &mut [Source]) {
    let mut names: Vec<String> =
        sources.iter().flat_map(|source| source.metadata.keys().cloned()).collect();
    names.sort_unstable();
    names.dedup();
    for name in names {
        let cells = sources.iter().filter_map(|source| source.metadata.get(&name));
        let texts: Vec<&str> = cells.filter_map(FleetCell::as_text).collect();
        let whole = texts.iter().all(|text| text.parse::<i64>().is_ok());
        let number = texts.iter().all(|text| text.parse::<f64>().is_ok_and(f64::is_finite));
        if !number {
            continue;
        }
        for cell in sources.iter_mut().filter_map(|source| source.metadata.get_mut(&name)) {
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
    let mut start = Vec::new();
    File::open(path)
        .and_then(|file| file.take(LONGEST).read_to_end(&mut start))
        .map_err(unread(path))?;
    let line = start.split(|byte| *byte == b'\n').next().unwrap_or_default();
    Ok(fields(line).into_iter().next().unwrap_or_default())
}

/// A CSV file of strings; empty cells are missing values. It may be a table of results.
fn text_table(path: &Path) -> Result<Table, DatasetError> {
    let bytes = std::fs::read(path).map_err(unread(path))?;
    let mut lines = fields(&bytes).into_iter();
    let names = lines.next().unwrap_or_default();
    let mut columns: Vec<Vec<Option<std::borrow::Cow<'static, str>>>> =
        vec![Vec::new(); names.len()];
    for (row, line) in lines.enumerate() {
        if line.len() != names.len() {
            let problem =
                format!("{} cells, expected {} as in the header", line.len(), names.len());
            return Err(in_row(path, row, problem));
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
