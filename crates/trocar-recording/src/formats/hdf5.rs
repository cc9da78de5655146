//! HDF5 files, and MATLAB 7.3 files, which are HDF5 with a leading block of text.
//!
//! Vectors of equal length in a group form a table. N x k arrays are k columns `name[0]`,
//! `name[1]`..., the longer dimension being rows, so MATLAB's transposed vectors are read
//! correctly. Attributes `units` or `unit` are the column's unit. Memory: a batch of rows, or the
//! whole array if its longer dimension is not the first one (as MATLAB writes vectors).

use std::collections::HashMap;
use std::path::Path;

use hdf5_pure::{AttrValue, DType, Dataset, File};

use super::Source;
use super::lengths::{self, Group, Shape};
use crate::RecordingError;
use crate::container::{BATCH_ROWS, Batches, Column, Container, Content, Opened, Table};

/// Deepest nesting of groups: links may form a cycle.
const DEEPEST: usize = 16;

/// Most groups and arrays listed from one file.
const MOST: usize = 1 << 16;

/// Largest compression ratio of deflate, with a margin.
const DENSEST: u64 = 2000;

/// Attributes that name a unit.
const UNITS: [&str; 4] = ["units", "unit", "Units", "Unit"];

/// Where one column is stored.
#[derive(Clone)]
struct ColumnLocation {
    path: String,
    /// Opened by its path again, it would be sought among all others.
    dataset: Dataset,
    /// Index among `width` columns.
    column: u64,
    width: u64,
    /// Whether rows are the second dimension.
    across: bool,
}

/// An open file.
struct Hdf5 {
    source: Source,
    length: u64,
    places: Vec<Vec<ColumnLocation>>,
}

pub(crate) fn open(path: &Path, length: u64, source: Source) -> Result<Container, RecordingError> {
    let groups = source.guard("its structure", || {
        let file = File::open_streaming(path)
            .map_err(|error| refused(&source, "the superblock", &error))?;
        let mut listing = Listing { source: &source, length, groups: Vec::new(), listed: 0 };
        listing.group(&file.root(), "", 0)?;
        Ok(listing.groups)
    })?;
    let (tables, places) = lengths::tables(groups);
    Ok(Container::new(source.clone(), tables, Hdf5 { source, length, places }))
}

impl Content for Hdf5 {
    fn open(&self, at: usize, table: &Table, columns: &[usize]) -> Opened {
        let mut arrays: Vec<Array> = Vec::new();
        let mut known: HashMap<&str, usize> = HashMap::new();
        let mut sources = Vec::with_capacity(columns.len());
        for &column in columns {
            let place = &self.places[at][column];
            let at = *known.entry(&place.path).or_insert(arrays.len());
            if at == arrays.len() {
                arrays.push(self.source.guard(&place.path, || self.array(place))?);
            }
            sources.push((at, place.column));
        }
        let rows = table.rows.unwrap_or(0);
        Ok(Box::new(Rows { source: self.source.clone(), arrays, sources, row: 0, rows }))
    }
}

impl Hdf5 {
    fn array(&self, place: &ColumnLocation) -> Result<Array, RecordingError> {
        let dataset = place.dataset.clone();
        // The reader reserves memory for the length that a chunk states.
        let chunks =
            if dataset.is_chunked() { dataset.chunks().unwrap_or_default() } else { Vec::new() };
        if chunks.iter().any(|chunk| chunk.address.saturating_add(chunk.storage_size) > self.length)
        {
            return Err(self.source.damaged(&place.path, "a chunk that ends after the file"));
        }
        Array::open(dataset, place).map_err(|error| refused(&self.source, &place.path, &error))
    }
}

/// Converts an error of the reader; for HDF5 2.0 files with the newest layout it includes a
/// workaround.
fn refused(
    source: &Source,
    place: impl std::fmt::Display,
    error: &hdf5_pure::Error,
) -> RecordingError {
    let text = error.to_string().replace("HDF5 format error: ", "");
    let newest = ["data layout version: 5", "superblock version: 4", "unsupported"];
    if newest[..2].iter().any(|what| text.contains(what)) {
        let hint = "write it with libver='v110' (h5py), or run h5repack --high=V110 OLD.h5 NEW.h5";
        return source.unsupported(
            format!("{text} at {place}, as libver='latest' of HDF5 2.0 writes it"),
            hint,
        );
    }
    match text.to_lowercase().contains(newest[2]) {
        true => source.unsupported(
            format!("{text} at {place}"),
            "run h5repack --filter=GZIP=4 OLD.h5 NEW.h5",
        ),
        false => source.damaged(place, text),
    }
}

struct Listing<'a> {
    source: &'a Source,
    length: u64,
    groups: Vec<Group<ColumnLocation>>,
    listed: usize,
}

impl Listing<'_> {
    fn group(
        &mut self,
        group: &hdf5_pure::Group,
        path: &str,
        depth: usize,
    ) -> Result<(), RecordingError> {
        let shown = if path.is_empty() { "/" } else { path };
        let failed = |error| refused(self.source, shown, &error);
        let mut listed = Group::named(path);
        for (name, dataset) in group.iter_datasets().map_err(failed)? {
            self.count(shown)?;
            let full = if path.is_empty() { name.clone() } else { format!("{path}/{name}") };
            match described(&dataset) {
                Ok(described) => self.dataset(&mut listed, &name, (full, dataset), described),
                // An array that cannot be read does not affect the others.
                Err(error) => listed.refuse(&name, refused(self.source, &full, &error)),
            }
        }
        self.groups.push(listed);
        for (name, inner) in group.iter_groups().map_err(failed)? {
            // Cells and objects of MATLAB store their parts there, without names.
            if depth == 0 && name.starts_with('#') {
                continue;
            }
            self.count(shown)?;
            if depth < DEEPEST {
                self.group(
                    &inner,
                    &if path.is_empty() { name } else { format!("{path}/{name}") },
                    depth + 1,
                )?;
            }
        }
        Ok(())
    }

    fn count(&mut self, place: &str) -> Result<(), RecordingError> {
        self.listed += 1;
        match self.listed > MOST {
            true => Err(self.source.damaged(place, "more groups and arrays than are listed")),
            false => Ok(()),
        }
    }

    fn dataset(
        &self,
        group: &mut Group<ColumnLocation>,
        name: &str,
        (path, dataset): (String, Dataset),
        described: Described,
    ) {
        let Described { shape, unit, is_numeric, size, compressed, reason } = described;
        let most = self.length.saturating_mul(compressed);
        let shape = match reason {
            Some(reason) => Err(reason.to_owned()),
            None => Shape::of(&shape, false, size, most),
        };
        let shape = match shape {
            Ok(shape) => shape,
            Err(reason) => return group.refuse(name, reason),
        };
        let Shape { rows, width, across } = shape;
        for column in 0..width {
            let name = shape.name(name, column);
            let (path, dataset) = (path.clone(), dataset.clone());
            let place = ColumnLocation { path, dataset, column, width, across };
            group.columns.push((Column { name, unit: unit.clone(), is_numeric }, rows, place));
        }
    }
}

/// Description of an array, obtained without reading it.
struct Described {
    shape: Vec<u64>,
    unit: Option<String>,
    is_numeric: bool,
    /// Bytes of a number, and the largest ratio of decompressed to stored bytes.
    size: u64,
    compressed: u64,
    /// Why it cannot be read, and the workaround.
    reason: Option<&'static str>,
}

fn described(dataset: &Dataset) -> Result<Described, hdf5_pure::Error> {
    let kind = dataset.dtype()?;
    let attributes = dataset.attrs().unwrap_or_default();
    let class = attributes.get("MATLAB_class").and_then(text);
    let is_object = attributes.contains_key("MATLAB_object_decode")
        || class.as_deref().is_some_and(is_object_class);
    let reason = match (&kind, class.as_deref()) {
        _ if is_object => Some("an object; save its vectors, as in t = x.Time; y = x.Data"),
        (DType::ObjectReference, Some("cell")) => Some("a cell; save its vectors as variables"),
        (DType::ObjectReference, _) => {
            Some("references to other arrays, as in an array of structs")
        }
        (DType::Compound(_), _) => Some("a compound; save each field as an array"),
        _ if attributes.contains_key("MATLAB_sparse") => Some("sparse; save full(x)"),
        _ => None,
    };
    let text_class = class.as_deref() == Some("char");
    Ok(Described {
        shape: if attributes.contains_key("MATLAB_empty") { vec![0] } else { dataset.shape()? },
        unit: UNITS.iter().find_map(|name| attributes.get(*name).and_then(text)),
        is_numeric: is_number(&kind) && !text_class,
        size: dataset.element_size()?,
        compressed: if dataset.is_chunked() { DENSEST } else { 1 },
        reason,
    })
}

fn is_object_class(class: &str) -> bool {
    matches!(
        class,
        "timeseries" | "timetable" | "table" | "datetime" | "duration" | "string" | "categorical"
    )
}

fn text(value: &AttrValue) -> Option<String> {
    use AttrValue as Value;
    let text = match value {
        Value::String(text) | Value::AsciiString(text) => text,
        Value::VarLenString(text) | Value::VarLenAsciiString(text) => text,
        Value::StringSized { value, .. } | Value::AsciiStringSized { value, .. } => value,
        Value::StringArray(all) | Value::AsciiStringArray(all) if all.len() == 1 => &all[0],
        Value::VarLenStringArray(all) | Value::VarLenAsciiStringArray(all) if all.len() == 1 => {
            &all[0]
        }
        _ => return None,
    };
    let text = text.trim_matches(['\0', ' ']);
    (!text.is_empty()).then(|| text.to_owned())
}

/// Whether its values are read as numbers; `bool` of h5py is an enumeration of FALSE and TRUE.
fn is_number(kind: &DType) -> bool {
    match kind {
        DType::F32 | DType::F64 => true,
        DType::I8 | DType::I16 | DType::I32 | DType::I64 => true,
        DType::U8 | DType::U16 | DType::U32 | DType::U64 => true,
        DType::Enum(names) => names.iter().all(|name| name == "FALSE" || name == "TRUE"),
        _ => false,
    }
}

/// An array from which columns are read.
struct Array {
    path: String,
    dataset: Dataset,
    kind: DType,
    width: u64,
    /// The complete array, if rows are the second dimension.
    whole: Option<Vec<f64>>,
    /// The rows of this batch.
    window: Vec<f64>,
}

impl Array {
    fn open(dataset: Dataset, place: &ColumnLocation) -> Result<Self, hdf5_pure::Error> {
        let kind = dataset.dtype()?;
        let whole = place.across.then(|| numbers(&dataset, &kind, 0, u64::MAX)).transpose()?;
        Ok(Self {
            path: place.path.clone(),
            dataset,
            kind,
            width: place.width,
            whole,
            window: Vec::new(),
        })
    }
}

/// Rows of an array as numbers.
fn numbers(
    dataset: &Dataset,
    kind: &DType,
    from: u64,
    rows: u64,
) -> Result<Vec<f64>, hdf5_pure::Error> {
    Ok(match kind {
        DType::Enum(_) => dataset.read_raw_rows(from, rows)?.into_iter().map(f64::from).collect(),
        _ => dataset.read_f64_rows(from, rows)?,
    })
}

/// Rows of some columns.
struct Rows {
    source: Source,
    arrays: Vec<Array>,
    sources: Vec<(usize, u64)>,
    row: u64,
    rows: u64,
}

impl Batches for Rows {
    fn next(&mut self, columns: &mut [Vec<f64>]) -> Result<bool, RecordingError> {
        columns.iter_mut().for_each(Vec::clear);
        let count = (self.rows - self.row).min(BATCH_ROWS as u64);
        if count == 0 {
            return Ok(false);
        }
        for array in self.arrays.iter_mut().filter(|array| array.whole.is_none()) {
            let place = format!("{}, rows from {}", array.path, self.row);
            array.window = self.source.guard(&place, || {
                let window = numbers(&array.dataset, &array.kind, self.row, count);
                window.map_err(|error| refused(&self.source, &place, &error))
            })?;
        }
        for (&(at, k), column) in self.sources.iter().zip(columns) {
            let array = &self.arrays[at];
            let (from, width) = (self.row as usize, array.width as usize);
            match &array.whole {
                Some(all) => column.extend(
                    all.iter().skip(k as usize * self.rows as usize + from).take(count as usize),
                ),
                None => column.extend(array.window.iter().skip(k as usize).step_by(width)),
            }
            if column.len() as u64 != count {
                let found = format!("{} rows, expected {}", from + column.len(), self.rows);
                return Err(self.source.damaged(&array.path, found));
            }
        }
        self.row += count;
        Ok(true)
    }
}
