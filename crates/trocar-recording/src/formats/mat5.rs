//! MATLAB files of versions 5 to 7, read as streams: only the current batch of values is held in
//! memory.
//!
//! Numeric arrays of every class and storage type, in structs, arrays of structs and cells, in
//! either byte order, compressed or not. Text is listed as non-numeric. Sparse and complex arrays,
//! function handles and objects are listed with a workaround. N x k arrays are k columns `name[0]`,
//! `name[1]`..., the longer dimension being rows.
//!
//! Layout after "MAT-File Format" (key MATFILE in SOURCES.md).

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::sync::Arc;

use trocar_tables::content::Storage;

use super::lengths::{self, Group, Shape};
use super::{Source, read_at};
use crate::RecordingError;
use crate::container::{BATCH_ROWS, Batches, Column, Container, Content, Opened, Table};

pub(crate) const SAVE_AGAIN: &str = "save it again with -v7 or -v7.3";

/// Workaround for a time series, a timetable and other objects.
const OBJECT: &str =
    "an object; save its vectors, as in t = x.Time; y = x.Data; save('run.mat', 't', 'y')";

/// Text, an offset, the version and the byte order.
const HEADER: u64 = 128;

/// Deepest nesting of structs and cells.
const DEEPEST: usize = 16;

/// Most arrays and columns listed from one file.
const MOST: usize = 1 << 16;

/// Types of data elements.
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;

/// Whether the first bytes are those of a file of MATLAB 4: type, rows, columns, complex or not,
/// length of the name.
pub(crate) fn is_version_4(head: &[u8]) -> bool {
    [false, true].into_iter().any(|big| is_version_4_in_order(head, big) == Some(true))
}

/// `None` where `head` is too short.
fn is_version_4_in_order(head: &[u8], big: bool) -> Option<bool> {
    let (fields, _) = head.get(..20)?.as_chunks::<4>();
    let fields = fields.iter().map(|bytes| match big {
        true => u32::from_be_bytes(*bytes),
        false => u32::from_le_bytes(*bytes),
    });
    let [kind, rows, columns, imaginary, name] = fields.collect::<Vec<_>>()[..] else {
        return None;
    };
    let order = kind / 1000 == u32::from(big)
        && kind / 100 % 10 == 0
        && kind / 10 % 10 <= 5
        && kind % 10 <= 2;
    let name = name as usize;
    let text = head.get(20..20 + name.checked_sub(1)?)?;
    let is_name = name > 1 && head.get(19 + name) == Some(&0);
    let word = text.iter().all(|byte| byte.is_ascii_alphanumeric() || *byte == b'_');
    Some(order && imaginary <= 1 && rows > 0 && columns > 0 && is_name && word)
}

/// Storage types of numbers.
fn storage(kind: u32) -> Option<Storage> {
    Some(match kind {
        1 => Storage::I8,
        2 => Storage::U8,
        3 => Storage::I16,
        4 => Storage::U16,
        5 => Storage::I32,
        6 => Storage::U32,
        7 => Storage::F32,
        9 => Storage::F64,
        12 => Storage::I64,
        13 => Storage::U64,
        _ => return None,
    })
}

/// Position of the numbers of one column.
#[derive(Debug, Clone, PartialEq)]
enum ColumnData {
    /// In the data element at `element`, starting `skip` bytes into its stream, every `stride`-th
    /// number.
    Stream { element: Element, skip: u64, storage: Storage, stride: u64, rows: u64 },
    /// One number for each struct of an array, read when the file was opened.
    Held(Vec<f64>),
}

/// A top-level data element of the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Element {
    at: u64,
    bytes: u64,
    compressed: bool,
}

/// An open file.
#[derive(Debug)]
struct Mat5 {
    source: Source,
    file: Arc<File>,
    big: bool,
    places: Vec<Vec<ColumnData>>,
}

pub(crate) fn open(file: File, length: u64, source: Source) -> Result<Container, RecordingError> {
    let file = Arc::new(file);
    let mut order = [0; 2];
    super::read_exact_at(&file, &mut order, 126)
        .map_err(|error| source.damaged("the header", error))?;
    let big = &order == b"MI";
    let mut listing = Listing { source: &source, big, groups: vec![Group::named("")], arrays: 0 };
    let mut at = HEADER;
    while at < length {
        let mut tag = [0; 8];
        let place = format!("byte {at}");
        super::read_exact_at(&file, &mut tag, at).map_err(|error| source.damaged(&place, error))?;
        let (kind, bytes) = (word(&tag[..4], big), u64::from(word(&tag[4..], big)));
        if at + 8 + bytes > length {
            let found =
                format!("a data element of {bytes} bytes, the file has {} more", length - at - 8);
            return Err(source.damaged(place, found));
        }
        if cfg!(not(feature = "gzip")) && kind == COMPRESSED {
            return Err(source.no_feature("gzip"));
        }
        let element = Element { at: at + 8, bytes, compressed: kind == COMPRESSED };
        match kind {
            MATRIX | COMPRESSED => listing.element(&file, element)?,
            _ => {
                return Err(source
                    .damaged(place, format!("a data element of type {kind}, expected 14 or 15")));
            }
        }
        // Elements are padded to 8 bytes; compressed ones are not.
        at += 8 + if kind == COMPRESSED { bytes } else { bytes.next_multiple_of(8) };
    }
    let groups = listing.groups;
    let (tables, places) = lengths::tables(groups);
    Ok(Container::new(source.clone(), tables, Mat5 { source, file, big, places }))
}

impl Content for Mat5 {
    fn open(&self, at: usize, table: &Table, columns: &[usize]) -> Opened {
        let cells = columns.iter().map(|&column| {
            let name = &table.columns[column].name;
            let cells = match &self.places[at][column] {
                ColumnData::Held(numbers) => Cells::Held(numbers.clone()),
                ColumnData::Stream { element, skip, storage, stride, rows } => {
                    let mut bytes = stream(&self.file, *element);
                    pass(&mut bytes, *skip)
                        .map_err(|error| self.source.damaged(format!("variable {name}"), error))?;
                    Cells::Stream { bytes, storage: *storage, stride: *stride, left: *rows }
                }
            };
            Ok((name.clone(), cells))
        });
        let cells = cells.collect::<Result<Vec<_>, RecordingError>>()?;
        Ok(Box::new(Rows {
            source: self.source.clone(),
            big: self.big,
            cells,
            row: 0,
            piece: Vec::new(),
        }))
    }
}

fn word(bytes: &[u8], big: bool) -> u32 {
    let bytes = bytes.first_chunk::<4>().copied().unwrap_or_default();
    if big { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) }
}

/// The bytes of a data element, decompressed.
fn stream(file: &Arc<File>, element: Element) -> Box<dyn Read + Send> {
    let part = BufReader::with_capacity(
        1 << 16,
        FileSection { file: file.clone(), at: element.at, left: element.bytes },
    );
    #[cfg(feature = "gzip")]
    if element.compressed {
        return Box::new(BufReader::new(flate2::bufread::ZlibDecoder::new(part)));
    }
    Box::new(part)
}

/// A part of the file.
struct FileSection {
    file: Arc<File>,
    at: u64,
    left: u64,
}

impl Read for FileSection {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let most = bytes.len().min(usize::try_from(self.left).unwrap_or(usize::MAX));
        let read = read_at(&self.file, &mut bytes[..most], self.at)?;
        self.at += read as u64;
        self.left -= read as u64;
        Ok(read)
    }
}

/// Skips `count` bytes.
fn pass(bytes: &mut impl Read, count: u64) -> io::Result<()> {
    match io::copy(&mut bytes.by_ref().take(count), &mut io::sink())? == count {
        true => Ok(()),
        false => Err(io::ErrorKind::UnexpectedEof.into()),
    }
}

/// Content listed while the file is traversed.
struct Listing<'a> {
    source: &'a Source,
    big: bool,
    groups: Vec<Group<ColumnData>>,
    arrays: usize,
}

/// The stream of an element and the current position in it.
struct Walk {
    bytes: Box<dyn Read + Send>,
    at: u64,
    element: Element,
}

impl Walk {
    fn take<const N: usize>(&mut self) -> io::Result<[u8; N]> {
        let mut bytes = [0; N];
        self.bytes.read_exact(&mut bytes)?;
        self.at += N as u64;
        Ok(bytes)
    }

    fn pass(&mut self, count: u64) -> io::Result<()> {
        pass(&mut self.bytes, count)?;
        self.at += count;
        Ok(())
    }

    fn pass_to(&mut self, end: u64) -> io::Result<()> {
        match end.checked_sub(self.at) {
            Some(count) => self.pass(count),
            None => Err(invalid("parts longer than the whole")),
        }
    }
}

fn invalid(found: &'static str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, found)
}

/// The tag of a data element: small elements have their data in the tag.
#[derive(Debug, Clone, Copy)]
struct Tag {
    kind: u32,
    /// Start and end of its data, and start of the next element.
    from: u64,
    bytes: u64,
    next: u64,
}

/// Common header of every array.
struct Head {
    class: u8,
    complex: bool,
    dimensions: Vec<u64>,
    name: String,
    /// End of the array.
    end: u64,
}

impl Head {
    fn count(&self) -> Option<u64> {
        self.dimensions.iter().try_fold(1_u64, |all, &side| all.checked_mul(side))
    }
}

/// Position of an array: group, path above its own name, and depth.
struct Position<'a> {
    group: usize,
    name: &'a str,
    depth: usize,
}

impl Listing<'_> {
    /// Lists one variable.
    fn element(&mut self, file: &Arc<File>, element: Element) -> Result<(), RecordingError> {
        let mut walk = Walk { bytes: stream(file, element), at: 0, element };
        let outcome = self.variable(&mut walk);
        let place = format_args!("byte {} of the variable at byte {}", walk.at, element.at);
        outcome.map_err(|error| match error.kind() {
            io::ErrorKind::UnexpectedEof => self.source.damaged(place, "it ends early"),
            _ => self.source.damaged(place, error),
        })
    }

    fn variable(&mut self, walk: &mut Walk) -> io::Result<()> {
        let end = match walk.element.compressed {
            true => {
                let tag = self.tag(walk)?;
                if tag.kind != MATRIX {
                    return Err(invalid("a compressed element that is no array"));
                }
                tag.from + tag.bytes
            }
            false => walk.element.bytes,
        };
        self.array(walk, end, &Position { group: 0, name: "", depth: 0 })
    }

    fn tag(&self, walk: &mut Walk) -> io::Result<Tag> {
        let first = word(&walk.take::<4>()?, self.big);
        let small = first >> 16;
        if small > 0 {
            if small > 4 {
                return Err(invalid("a small data element of more than 4 bytes"));
            }
            let from = walk.at;
            return Ok(Tag { kind: first & 0xffff, from, bytes: u64::from(small), next: from + 4 });
        }
        let bytes = u64::from(word(&walk.take::<4>()?, self.big));
        let from = walk.at;
        Ok(Tag { kind: first, from, bytes, next: from + bytes.next_multiple_of(8) })
    }

    /// The data of a short element, at most `most` bytes.
    fn data(&self, walk: &mut Walk, most: u64) -> io::Result<Vec<u8>> {
        let tag = self.tag(walk)?;
        if tag.bytes > most {
            return Err(invalid("a longer part than its kind has"));
        }
        let mut data = vec![0; tag.bytes as usize];
        walk.bytes.read_exact(&mut data)?;
        walk.at += tag.bytes;
        walk.pass_to(tag.next)?;
        Ok(data)
    }

    fn head(&self, walk: &mut Walk, end: u64) -> io::Result<Head> {
        let flags = self.data(walk, 8)?;
        let flags = if flags.len() >= 4 {
            word(&flags, self.big)
        } else {
            return Err(invalid("no array flags"));
        };
        let (class, complex) = ((flags & 0xff) as u8, flags & 0x800 != 0);
        let mut head = Head { class, complex, dimensions: Vec::new(), name: String::new(), end };
        if class != OPAQUE {
            let sides = self.data(walk, 4 * 32)?;
            head.dimensions =
                sides.chunks_exact(4).map(|side| u64::from(word(side, self.big))).collect();
        }
        head.name = String::from_utf8_lossy(&self.data(walk, 1 << 10)?).into_owned();
        Ok(head)
    }

    /// Lists one array, which ends at `end`, and skips to its end.
    fn array(&mut self, walk: &mut Walk, end: u64, position: &Position<'_>) -> io::Result<()> {
        self.arrays += 1;
        if self.arrays > MOST {
            return Err(invalid("more arrays than are listed"));
        }
        if walk.at == end {
            return Ok(());
        }
        let head = self.head(walk, end)?;
        let name = if position.depth == 0 { head.name.clone() } else { position.name.to_owned() };
        // Objects store their contents in an unnamed array of bytes.
        if position.depth > 0 || !head.name.is_empty() {
            let position = Position { name: &name, ..*position };
            match head.class {
                CELL => self.cells(walk, &head, &position)?,
                STRUCT => self.structs(walk, &head, &position)?,
                DOUBLE..=UINT64 => self.numbers(walk, &head, &position)?,
                CHAR => self.not_numeric(&head, &position),
                SPARSE => self.refuse(&position, "sparse; save full(x)"),
                FUNCTION => self.refuse(&position, "a function handle"),
                OBJECT_CLASS | OPAQUE => self.refuse(&position, OBJECT),
                _ => return Err(invalid("an array of no known class")),
            }
        }
        walk.pass_to(end)
    }

    fn not_numeric(&mut self, head: &Head, position: &Position<'_>) {
        let column = Column { name: self.leaf(position), unit: None, is_numeric: false };
        // The number of rows is that of the strings, not of the characters.
        let rows = head.dimensions.first().copied().unwrap_or(0);
        self.groups[position.group].columns.push((column, rows, ColumnData::Held(Vec::new())));
    }

    fn refuse(&mut self, position: &Position<'_>, reason: &str) {
        let name = self.leaf(position);
        self.groups[position.group].refuse(&name, reason);
    }

    /// The name without that of its group.
    fn leaf(&self, position: &Position<'_>) -> String {
        let group = &self.groups[position.group].name;
        let rest = position.name.strip_prefix(group.as_str()).unwrap_or(position.name);
        rest.strip_prefix('.').unwrap_or(rest).to_owned()
    }

    fn numbers(&mut self, walk: &mut Walk, head: &Head, position: &Position<'_>) -> io::Result<()> {
        if head.complex {
            self.refuse(position, "complex; save real(x) and imag(x)");
            return Ok(());
        }
        let tag = self.tag(walk)?;
        let storage =
            self::storage(tag.kind).ok_or_else(|| invalid("numbers of no known storage type"))?;
        let count = head.count().ok_or_else(|| invalid("more numbers than there can be"))?;
        if tag.bytes != count.saturating_mul(storage.size() as u64)
            || tag.from + tag.bytes > head.end
        {
            return Err(invalid("another number of values than the dimensions say"));
        }
        let size = storage.size() as u64;
        let shape = match Shape::of(&head.dimensions, true, size, tag.bytes) {
            Ok(shape) => shape,
            Err(reason) => {
                self.refuse(position, &reason);
                return Ok(());
            }
        };
        let (name, element, rows) = (self.leaf(position), walk.element, shape.rows);
        for k in 0..shape.width {
            let [before, stride] = shape.place(k);
            let skip = tag.from + before * size;
            let place = ColumnData::Stream { element, skip, storage, stride, rows };
            let column = Column { name: shape.name(&name, k), unit: None, is_numeric: true };
            self.groups[position.group].columns.push((column, rows, place));
        }
        Ok(())
    }

    fn cells(&mut self, walk: &mut Walk, head: &Head, position: &Position<'_>) -> io::Result<()> {
        let group = self.inner(position)?;
        for k in 1..=head.count().ok_or_else(|| invalid("more cells than there can be"))? {
            let name = format!("{}{{{k}}}", position.name);
            self.inside(walk, &Position { group, name: &name, depth: position.depth + 1 })?;
        }
        Ok(())
    }

    /// A new group for the content of `position`.
    fn inner(&mut self, position: &Position<'_>) -> io::Result<usize> {
        if position.depth >= DEEPEST {
            return Err(invalid("structs and cells more than 16 deep"));
        }
        self.groups.push(Group::named(position.name));
        Ok(self.groups.len() - 1)
    }

    /// Lists the array that starts here.
    fn inside(&mut self, walk: &mut Walk, position: &Position<'_>) -> io::Result<()> {
        let tag = self.tag(walk)?;
        if tag.kind != MATRIX {
            return Err(invalid("something other than an array inside a struct or cell"));
        }
        self.array(walk, tag.from + tag.bytes, position)
    }

    fn structs(&mut self, walk: &mut Walk, head: &Head, position: &Position<'_>) -> io::Result<()> {
        let width = self.data(walk, 4)?;
        let width = if width.len() == 4 { word(&width, self.big) as usize } else { 0 };
        let text = self.data(walk, 1 << 20)?;
        if width == 0 || width > 64 {
            return Err(invalid("no length of field names"));
        }
        let names: Vec<String> = text
            .chunks(width)
            .map(|name| {
                let end = name.iter().position(|&byte| byte == 0).unwrap_or(name.len());
                String::from_utf8_lossy(&name[..end]).into_owned()
            })
            .collect();
        let count = head.count().ok_or_else(|| invalid("more structs than there can be"))?;
        if count > 1 {
            return self.struct_array(walk, &names, count, position);
        }
        let group = self.inner(position)?;
        for name in names.iter().filter(|_| count == 1) {
            let name = format!("{}.{name}", position.name);
            self.inside(walk, &Position { group, name: &name, depth: position.depth + 1 })?;
        }
        Ok(())
    }

    /// An array of structs: fields with one number in each struct are columns, others are groups of
    /// each struct.
    fn struct_array(
        &mut self,
        walk: &mut Walk,
        names: &[String],
        count: u64,
        position: &Position<'_>,
    ) -> io::Result<()> {
        let group = self.inner(position)?;
        let mut held: Vec<Vec<f64>> = vec![Vec::new(); names.len()];
        for k in 1..=count {
            let path = format!("{}({k})", position.name);
            let own = self.inner(&Position { name: &path, ..*position })?;
            for (field, numbers) in names.iter().zip(&mut held) {
                let name = format!("{path}.{field}");
                let before = self.groups[own].columns.len();
                let single = self.single(
                    walk,
                    &Position { group: own, name: &name, depth: position.depth + 1 },
                )?;
                if single.is_some() {
                    self.groups[own].columns.truncate(before);
                }
                numbers.extend(single);
            }
        }
        for (name, numbers) in
            names.iter().zip(held).filter(|(_, numbers)| numbers.len() as u64 == count)
        {
            let column = Column { name: name.clone(), unit: None, is_numeric: true };
            self.groups[group].columns.push((column, count, ColumnData::Held(numbers)));
        }
        Ok(())
    }

    /// Lists the array that starts here, unless it is one real number, which is returned.
    fn single(&mut self, walk: &mut Walk, position: &Position<'_>) -> io::Result<Option<f64>> {
        let tag = self.tag(walk)?;
        let end = tag.from + tag.bytes;
        // One number with its header takes 48 to 72 bytes.
        if tag.kind != MATRIX || !(40..=96).contains(&tag.bytes) {
            if tag.kind != MATRIX {
                return Err(invalid("something other than an array inside a struct"));
            }
            self.array(walk, end, position)?;
            return Ok(None);
        }
        let mut data = vec![0; tag.bytes as usize];
        walk.bytes.read_exact(&mut data)?;
        walk.at = end;
        let mut inner =
            Walk { bytes: Box::new(io::Cursor::new(data)), at: tag.from, element: walk.element };
        let head = self.head(&mut inner, end)?;
        if head.count() == Some(1) && (DOUBLE..=UINT64).contains(&head.class) && !head.complex {
            let storage = self.tag(&mut inner)?;
            let kind =
                self::storage(storage.kind).filter(|kind| kind.size() as u64 == storage.bytes);
            let mut bytes = [0; 8];
            let kind = kind.ok_or_else(|| invalid("a number of no known storage type"))?;
            inner.bytes.read_exact(&mut bytes[..kind.size()])?;
            return Ok(Some(kind.number(&bytes, self.big)));
        }
        self.short(inner, &head, position)
    }

    /// A short array that is not a single number, from the end of its header on.
    fn short(
        &mut self,
        mut walk: Walk,
        head: &Head,
        position: &Position<'_>,
    ) -> io::Result<Option<f64>> {
        match head.class {
            CELL => self.cells(&mut walk, head, position)?,
            STRUCT => self.structs(&mut walk, head, position)?,
            DOUBLE..=UINT64 => self.numbers(&mut walk, head, position)?,
            CHAR => self.not_numeric(head, position),
            _ => self.refuse(position, "neither numbers nor text"),
        }
        Ok(None)
    }
}

/// Classes of arrays.
const CELL: u8 = 1;
const STRUCT: u8 = 2;
const OBJECT_CLASS: u8 = 3;
const CHAR: u8 = 4;
const SPARSE: u8 = 5;
const DOUBLE: u8 = 6;
const UINT64: u8 = 15;
const FUNCTION: u8 = 16;
const OPAQUE: u8 = 17;

/// Remainder of one column.
enum Cells {
    Stream { bytes: Box<dyn Read + Send>, storage: Storage, stride: u64, left: u64 },
    Held(Vec<f64>),
}

/// Rows of some columns, each from its own stream.
struct Rows {
    source: Source,
    big: bool,
    cells: Vec<(String, Cells)>,
    row: u64,
    piece: Vec<u8>,
}

impl Batches for Rows {
    fn next(&mut self, columns: &mut [Vec<f64>]) -> Result<bool, RecordingError> {
        columns.iter_mut().for_each(Vec::clear);
        for ((name, cells), column) in self.cells.iter_mut().zip(columns.iter_mut()) {
            let outcome = next_of(cells, column, &mut self.piece, self.big);
            let place = format_args!("variable {name}, row {}", self.row + column.len() as u64);
            outcome.map_err(|error| self.source.damaged(place, error))?;
        }
        let rows = columns.first().map_or(0, Vec::len);
        self.row += rows as u64;
        Ok(rows > 0)
    }
}

/// Reads up to a batch of numbers of one column.
fn next_of(
    cells: &mut Cells,
    column: &mut Vec<f64>,
    piece: &mut Vec<u8>,
    big: bool,
) -> io::Result<()> {
    match cells {
        Cells::Held(numbers) => {
            let rest = numbers.split_off(numbers.len().min(BATCH_ROWS));
            *column = std::mem::replace(numbers, rest);
        }
        Cells::Stream { bytes, storage, stride, left } => {
            let rows = (*left).min(BATCH_ROWS as u64);
            let size = storage.size();
            let step = size * *stride as usize;
            // After the last number of this column, those of the other columns end the element.
            let needed = (rows as usize).saturating_sub(1) * step + size;
            piece.resize(if rows == 0 { 0 } else { needed }, 0);
            bytes.read_exact(piece)?;
            column.extend(piece.chunks(step).map(|number| storage.number(number, big)));
            *left -= rows;
            if *left > 0 {
                pass(bytes, (step - size) as u64)?;
            }
        }
    }
    Ok(())
}
