//! NumPy arrays, `.npy` and `.npz`: a vector is a column, the fields of a structured array are
//! columns by their names, and an N x k array is k columns `name[0]`, `name[1]`...
//!
//! Columns of equal length are a table. Memory: the columns asked for. Layout after "NumPy
//! Enhancement Proposal 1" (key NPY in SOURCES.md).

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};

use trocar_tables::content::Storage;

use super::Source;
use super::lengths::{self, Group, Shape};
#[cfg(feature = "npz")]
use super::zipped;
use crate::RecordingError;
use crate::container::{Column, Container, Content, Held, Opened, Table};

pub(crate) const MAGIC: &[u8] = b"\x93NUMPY";

/// Longest header, bytes: names of fields.
const HEADER: u64 = 1 << 16;

/// Name of the format of archives.
pub(crate) const NPZ: &str = "NumPy archive";

const SAVE_AGAIN: &str =
    "save vectors of numbers, as in np.savez('run.npz', time_s=t, position_m=x, force_n=f)";

/// Numbers at equal distances in an array.
#[derive(Debug, Clone)]
struct ColumnData {
    /// Name of the array in the archive.
    array: Option<String>,
    storage: Storage,
    big: bool,
    /// Place of the first number, and distance to the next, bytes.
    from: u64,
    stride: u64,
    rows: u64,
}

/// An open file.
struct Numpy {
    source: Source,
    path: PathBuf,
    places: Vec<Vec<ColumnData>>,
}

pub(crate) fn open(path: &Path, length: u64, source: Source) -> Result<Container, RecordingError> {
    let mut group = Group::named("");
    for (array, length) in arrays(path, length, &source)? {
        let mut head = Vec::new();
        with_array(path, array.as_deref(), |from| from.take(HEADER).read_to_end(&mut head))
            .map_err(|error| source.damaged(place(array.as_deref()), error))?;
        list(&mut group, array.as_deref(), &head, length, &source)?;
    }
    let (tables, places) = lengths::tables(vec![group]);
    let content = Numpy { source: source.clone(), path: path.to_owned(), places };
    Ok(Container::new(source, tables, content))
}

/// Where an array is, in words.
fn place(array: Option<&str>) -> String {
    array.map_or_else(|| "its array".to_owned(), |name| format!("array {name}"))
}

/// The arrays in a file of `length` bytes, by name in an archive, with their bytes.
#[cfg_attr(not(feature = "npz"), allow(unused_variables, reason = "archives are not opened"))]
fn arrays(
    path: &Path,
    length: u64,
    source: &Source,
) -> Result<Vec<(Option<String>, u64)>, RecordingError> {
    if source.format != NPZ {
        return Ok(vec![(None, length)]);
    }
    #[cfg(feature = "npz")]
    {
        let damaged = |error: zip::result::ZipError| source.damaged("its structure", error);
        let mut archive =
            zipped::open(path).map_err(|error| source.damaged("its structure", error))?;
        let mut arrays = Vec::new();
        for k in 0..archive.len() {
            let entry = archive.by_index(k).map_err(damaged)?;
            let name = entry.name().map_err(damaged)?;
            let Some(name) = name.strip_suffix(".npy") else { continue };
            arrays.push((Some(name.to_owned()), entry.size()));
        }
        let unpacked = arrays.iter().fold(0_u64, |sum, (_, bytes)| sum.saturating_add(*bytes));
        zipped::check(unpacked, length, source)?;
        Ok(arrays)
    }
    #[cfg(not(feature = "npz"))]
    Ok(Vec::new())
}

/// What `read` finds in an array.
fn with_array<T>(
    path: &Path,
    array: Option<&str>,
    read: impl FnOnce(&mut dyn Read) -> io::Result<T>,
) -> io::Result<T> {
    let Some(array) = array else { return read(&mut BufReader::new(File::open(path)?)) };
    #[cfg(feature = "npz")]
    return read(&mut zipped::open(path)?.by_name(&format!("{array}.npy"))?);
    #[cfg(not(feature = "npz"))]
    Err(io::Error::other(array.to_owned()))
}

/// Adds the columns of an array of `length` bytes that begins with `head`.
fn list(
    group: &mut Group<ColumnData>,
    array: Option<&str>,
    head: &[u8],
    length: u64,
    source: &Source,
) -> Result<(), RecordingError> {
    let header =
        Header::of(head).ok_or_else(|| source.damaged(place(array), "no header of an array"))?;
    let shown = array.unwrap_or("value");
    let Some(fields) = header.fields() else {
        group.refuse(shown, format_args!("of type {}; {SAVE_AGAIN}", header.kind));
        return Ok(());
    };
    let item: u64 = fields.iter().map(|field| field.size).sum();
    let most = length.saturating_sub(header.end);
    let shape = match Shape::of(&header.shape, header.fortran_order, item, most) {
        Ok(shape) => shape,
        Err(reason) => {
            group.refuse(shown, reason);
            return Ok(());
        }
    };
    for column in 0..shape.width {
        let [before, stride] = shape.place(column);
        let mut from = header.end + item * before;
        for field in &fields {
            let name = shape.name(field.name.as_deref().unwrap_or(shown), column);
            let is_numeric = field.storage.is_some();
            let data = ColumnData {
                array: array.map(str::to_owned),
                storage: field.storage.unwrap_or(Storage::U8),
                big: field.big,
                from,
                stride: item * stride,
                rows: shape.rows,
            };
            group.columns.push((Column { name, unit: None, is_numeric }, shape.rows, data));
            from += field.size;
        }
    }
    Ok(())
}

/// The header of an array.
struct Header {
    /// Type of an element, as Python writes it.
    kind: String,
    fortran_order: bool,
    shape: Vec<u64>,
    /// Where the numbers begin.
    end: u64,
}

/// A number, or another element, in an element of an array.
struct Field {
    name: Option<String>,
    /// `None` for other than numbers.
    storage: Option<Storage>,
    big: bool,
    size: u64,
}

impl Header {
    fn of(bytes: &[u8]) -> Option<Self> {
        let rest = bytes.strip_prefix(MAGIC)?;
        let (begin, length) = match rest {
            [1, _, a, b, ..] => (10, usize::from(u16::from_le_bytes([*a, *b]))),
            [2 | 3, _, a, b, c, d, ..] => (12, u32::from_le_bytes([*a, *b, *c, *d]) as usize),
            _ => return None,
        };
        let end = begin + length;
        let text = std::str::from_utf8(bytes.get(begin..end)?).ok()?;
        let value = |key: &str| text.split_once(&format!("'{key}':")).map(|(_, rest)| rest.trim());
        let shape = value("shape")?.strip_prefix('(')?.split_once(')')?.0;
        let numbers = shape.split(',').map(str::trim).filter(|number| !number.is_empty());
        let kind = value("descr")?;
        let kind = match kind.strip_prefix('[') {
            Some(rest) => &kind[..rest.rfind("],").or_else(|| rest.rfind(']'))? + 2],
            None => &kind[..kind.get(1..)?.find('\'')? + 2],
        };
        Some(Self {
            kind: kind.to_owned(),
            fortran_order: value("fortran_order")?.starts_with("True"),
            shape: numbers.map(|number| number.parse().ok()).collect::<Option<_>>()?,
            end: end as u64,
        })
    }

    /// The parts of an element; `None` if they are none that are known.
    fn fields(&self) -> Option<Vec<Field>> {
        if !self.kind.starts_with('[') {
            return Field::of(None, &self.kind)
                .filter(|field| field.storage.is_some())
                .map(|f| vec![f]);
        }
        let fields = self.kind.trim_matches(['[', ']']).split_terminator(')');
        fields
            .map(|text| {
                let (name, kind) = text.trim_start_matches([',', ' ', '(']).split_once("',")?;
                Field::of(Some(name.trim_start_matches('\'').to_owned()), kind.trim())
            })
            .collect()
    }
}

impl Field {
    /// Of a type such as `'<f8'`.
    fn of(name: Option<String>, kind: &str) -> Option<Self> {
        let kind = kind.strip_prefix('\'')?.strip_suffix('\'')?;
        let (order, letter) = (kind.chars().next()?, kind.chars().nth(1)?);
        let count: u64 = kind.get(2..)?.parse().ok()?;
        let storage = match (letter, count) {
            ('f', 4) => Some(Storage::F32),
            ('f', 8) => Some(Storage::F64),
            ('i', 1) => Some(Storage::I8),
            ('i', 2) => Some(Storage::I16),
            ('i', 4) => Some(Storage::I32),
            ('i', 8) => Some(Storage::I64),
            ('u' | 'b', 1) => Some(Storage::U8),
            ('u', 2) => Some(Storage::U16),
            ('u', 4) => Some(Storage::U32),
            ('u', 8) => Some(Storage::U64),
            ('S' | 'V' | 'U' | 'f' | 'c', _) => None,
            _ => return None,
        };
        let size = if letter == 'U' { count.checked_mul(4)? } else { count };
        Some(Self { name, storage, big: order == '>', size })
    }
}

impl Content for Numpy {
    fn open(&self, at: usize, _table: &Table, columns: &[usize]) -> Opened {
        let mut all = Vec::with_capacity(columns.len());
        for &column in columns {
            let place = &self.places[at][column];
            let array = place.array.as_deref();
            let column = with_array(&self.path, array, |from| place.read(from));
            all.push(column.map_err(|error| self.source.damaged(self::place(array), error))?);
        }
        Ok(Box::new(Held::of(all)))
    }
}

impl ColumnData {
    fn read(&self, from: &mut dyn Read) -> io::Result<Vec<f64>> {
        let skip =
            |from: &mut dyn Read, bytes: u64| io::copy(&mut from.take(bytes), &mut io::sink());
        skip(from, self.from)?;
        let size = self.storage.size();
        let mut number = [0; 8];
        let mut column = Vec::new();
        for row in 0..self.rows {
            if row > 0 {
                skip(from, self.stride - size as u64)?;
            }
            from.read_exact(&mut number[..size])?;
            column.push(self.storage.number(&number[..size], self.big));
        }
        Ok(column)
    }
}
