//! Recordings that are rows of Parquet files: their rows in each file, and their columns, joined by
//! name.
//!
//! Only the rows of one recording are held at a time: its pages are located in each file, and all
//! others are skipped.

use std::borrow::Cow;
use std::collections::{HashMap, HashSet};
use std::ops::Range;
use std::sync::Arc;

use super::dataset::{DataFile, Job, Metadata, Source, in_common};
use super::one::Input;
use super::row::FleetCell;
use joined::{Joined, joined};
use trocar_recording::formats::parquet::Parquet;
use trocar_recording::formats::parquet::select::{Cells, Piece, Selected, Value};
use trocar_recording::{ReadOptions, RecordingError};

mod joined;
mod stream;

/// Files that a source keeps open; a source with more files opens them for each recording.
const HELD_OPEN: usize = 4;

/// A file with rows of recordings.
struct Opened {
    part: DataFile,
    held: Option<Arc<Parquet>>,
}

impl Opened {
    fn parquet(&self) -> Result<Arc<Parquet>, RecordingError> {
        match &self.held {
            Some(parquet) => Ok(parquet.clone()),
            None => open(&self.part),
        }
    }
}

fn open(part: &DataFile) -> Result<Arc<Parquet>, RecordingError> {
    Parquet::named(&part.path, &part.name).map(Arc::new)
}

/// The rows of one recording.
pub(super) struct Group {
    /// The column that distinguishes it from other recordings.
    by: Option<String>,
    /// Files with rows of it, in the order of their names.
    rows: Vec<Rows>,
}

struct Rows {
    file: Arc<Opened>,
    ranges: Vec<Range<u64>>,
}

/// A value, and the rows that contain it.
type ValueRows = (String, Vec<Range<u64>>);

/// The values of a column, in order of appearance.
///
/// # Errors
/// [`RecordingError`] where the file or the column cannot be read.
pub(super) fn values(file: &DataFile, by: &str) -> Result<Vec<String>, RecordingError> {
    Ok(ranges(&open(file)?, by)?.into_iter().map(|(value, _)| value).collect())
}

/// The values of a column in order of appearance, and the rows that contain each; the value is
/// empty for a missing one.
fn ranges(parquet: &Arc<Parquet>, by: &str) -> Result<Vec<ValueRows>, RecordingError> {
    let rows = 0..parquet.rows();
    let Some(place) = parquet.place(by) else {
        return Ok(if rows.is_empty() { Vec::new() } else { vec![(String::new(), vec![rows])] });
    };
    let mut found: Vec<ValueRows> = Vec::new();
    let mut places: HashMap<String, usize> = HashMap::new();
    let mut at = 0;
    Selected::new(parquet.clone(), place, parquet.plan(&[rows])).runs(&mut |value, rows| {
        let value = words(value);
        let place = places.get(&*value).copied().unwrap_or_else(|| {
            places.insert(value.clone().into_owned(), found.len());
            found.push((value.into_owned(), Vec::new()));
            found.len() - 1
        });
        let end = at + rows as u64;
        match found[place].1.last_mut() {
            Some(range) if range.end == at => range.end = end,
            _ => found[place].1.push(at..end),
        }
        at = end;
        true
    })?;
    Ok(found)
}

/// As [`FleetCell::in_words`].
fn words(value: Value<'_>) -> Cow<'_, str> {
    match value {
        Value::Missing => "".into(),
        Value::Text(text) => text.into(),
        Value::Number(value) => value.to_string().into(),
        Value::Integer(value) => value.to_string().into(),
        Value::Boolean(value) => value.to_string().into(),
    }
}

/// The recordings that belong to a source.
///
/// # Errors
/// [`RecordingError`] where a file cannot be read.
pub(super) fn jobs(source: &Source) -> Result<Vec<Job>, RecordingError> {
    let Source { name, path, metadata, group_by, parts, elsewhere } = source;
    let alone = [DataFile { name: name.clone(), path: path.clone(), metadata: metadata.clone() }];
    let parts = if parts.is_empty() { &alone } else { parts.as_slice() };
    let elsewhere: HashSet<&str> = elsewhere.iter().map(String::as_str).collect();
    let mut found: Vec<(String, Vec<Rows>)> = Vec::new();
    let mut places: HashMap<String, usize> = HashMap::new();
    if group_by.is_none() {
        places.insert(String::new(), 0);
        found.push((String::new(), Vec::new()));
    }
    for (k, part) in parts.iter().enumerate() {
        let parquet = open(part)?;
        let held = (parts.len() <= HELD_OPEN).then(|| parquet.clone());
        let file = Arc::new(Opened { part: part.clone(), held });
        let own = match group_by {
            Some(by) => ranges(&parquet, by)?,
            None => vec![(String::new(), std::iter::once(0..parquet.rows()).collect())],
        };
        for (value, ranges) in own {
            let begins = k == 0 && group_by.is_some() && !elsewhere.contains(value.as_str());
            let goes_on = !value.is_empty() || group_by.is_none();
            if begins {
                places.insert(value.clone(), found.len());
                found.push((value.clone(), Vec::new()));
            }
            if let Some(place) = places.get(&value).filter(|_| begins || goes_on) {
                found[*place].1.push(Rows { file: file.clone(), ranges });
            }
        }
    }
    let job = |(value, rows): (String, Vec<Rows>)| {
        let (metadata, differing) = in_common(rows.iter().map(|rows| &rows.file.part.metadata));
        let name = if group_by.is_some() { format!("{name}#{value}") } else { name.clone() };
        let group = Some(Group { by: group_by.clone(), rows });
        Job {
            name,
            path: path.clone(),
            metadata,
            warning: doubt(differing.into_iter().collect()),
            group,
        }
    };
    Ok(found.into_iter().map(job).collect())
}

/// Warning if the folders differ.
fn doubt(differing: Vec<String>) -> Option<String> {
    let names = differing.join(", ");
    (!differing.is_empty())
        .then(|| format!("its rows lie in folders that differ in {names}: left out of the table"))
}

/// A file of a recording, with the rows to read.
struct Taken<'a> {
    name: &'a str,
    parquet: Arc<Parquet>,
    pieces: Arc<[Piece]>,
    rows: u64,
}

impl Taken<'_> {
    fn select(&self, column: usize) -> Selected {
        Selected::new(self.parquet.clone(), column, self.pieces.clone())
    }
}

impl Group {
    /// The input of the identification; constant columns become metadata.
    ///
    /// # Errors
    /// [`RecordingError`] if the columns are missing, do not fit together, or cannot be read.
    pub(super) fn input(
        &self,
        name: &str,
        reading: &ReadOptions,
        metadata: &mut Metadata,
    ) -> Result<Input, RecordingError> {
        let mut parts = Vec::with_capacity(self.rows.len());
        for Rows { file, ranges } in &self.rows {
            let parquet = file.parquet()?;
            let (pieces, rows) =
                (parquet.plan(ranges), ranges.iter().map(|range| range.end - range.start).sum());
            parts.push(Taken { name: &file.part.name, parquet, pieces, rows });
        }
        parts.retain(|part| part.rows > 0);
        if parts.is_empty() {
            return Err(RecordingError::Empty { file: name.to_owned() });
        }
        let columns = joined(&parts);
        let by_order = reading.choice.columns.as_ref().is_some_and(|names| !names.contains('='));
        let mut offered: Vec<&Joined> = Vec::new();
        for column in &columns {
            let constant = column.constant(&parts)?;
            if (by_order || (constant.is_none() && column.is_numeric()))
                && self.by.as_ref() != Some(&column.name)
            {
                offered.push(column);
            }
            metadata.extend(constant.map(|cell| (column.name.clone(), cell)));
        }
        stream::input(name, &parts, &offered, reading)
    }
}

/// Converts a value to a cell.
fn cell(value: Value<'_>) -> FleetCell {
    match value {
        Value::Missing => FleetCell::Empty,
        Value::Number(value) => FleetCell::number(value),
        Value::Integer(value) => FleetCell::Integer(value),
        Value::Boolean(value) => FleetCell::Boolean(value),
        Value::Text(text) => FleetCell::text(text),
    }
}

/// Whether a value equals a cell; files may differ in the type of numbers.
fn is_in(value: Value<'_>, cell: &FleetCell) -> bool {
    match (value, cell) {
        (Value::Missing, FleetCell::Empty) => true,
        (Value::Boolean(value), FleetCell::Boolean(own)) => value == *own,
        (Value::Text(text), FleetCell::Text(own)) => text == own,
        (Value::Integer(value), FleetCell::Integer(own)) => value == *own,
        (Value::Integer(value), _) => cell.as_number() == Some(value as f64),
        (Value::Number(value), _) => cell.as_number() == Some(value),
        _ => false,
    }
}
