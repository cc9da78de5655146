//! Excel workbooks (`.xlsx`, `.xlsm`): each sheet is a table.
//!
//! The first rows of a sheet become lines of text with tabs, in which the reader of text files
//! finds lines before the header, the names and the units. The rows below are read cell by cell:
//! numbers, Booleans, texts that are numbers, and dates, which become seconds since the column's
//! first. Of a formula the stored value counts. An empty cell and `#N/A` are missing numbers. A
//! header that is repeated, and rows of text at the end, are left out with a warning.
//!
//! Memory: the texts of the workbook and the columns asked for; a sheet has at most 1,048,576 rows.
//! What the parts of a workbook unpack to is checked before the library reads them, since it holds
//! all shared texts, and the text of a cell, in memory.

use std::fs::File;
use std::io::{BufReader, Read as _};
use std::path::{Path, PathBuf};

use calamine::{CellErrorType, DataRef, Reader as _, SheetType, XlsxError, open_workbook};
use trocar_tables::text::{Format, timestamp};

use super::{Source, zipped};
use crate::RecordingError;
use crate::columns::{UNIT_IN_CELL, has_unit, is_recognised, time_unit};
use crate::container::{Column, Container, Content, Held, Opened, Table};
use crate::quality::{Footer, RowList, warn_of_repeated};
use crate::text::{Head, head_of, quoted};

/// Rows in which the header is sought.
const FIRST_ROWS: usize = 300;

/// Size of a sheet, by the definition of the format.
const MOST_ROWS: u32 = 1 << 20;
const MOST_COLUMNS: u32 = 1 << 14;

/// Longest text or tag, bytes: a cell has at most 32,767 characters. A picture has no tags, and is not
/// packed as densely as this.
const LONGEST: u64 = 1 << 18;
const DENSEST_TEXT: u64 = 4;
/// Most bytes of text in a row, and in the rows in which the header is sought: a shared text may be
/// in any number of cells.
const MOST_TEXT: usize = 1 << 22;
/// Fewest bytes of a shared text with its tags.
const SHORTEST_TEXT: u64 = 5;

/// Days from the first day of Excel's calendar to 1970.
const DAYS_TO_1970: f64 = 25_569.0;
/// Dates are numbers of days, which resolve 0.6 µs.
const MICROSECONDS_PER_DAY: f64 = 86_400e6;

type Workbook = calamine::Xlsx<BufReader<File>>;

/// Content of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Number,
    Date,
    Text,
}

/// Where the rows of a sheet are.
#[derive(Debug, Clone)]
struct Sheet {
    name: String,
    /// First row of numbers, counted from 0.
    first_row: u32,
    /// Column of the sheet and content for each column of the table.
    columns: Vec<(u32, Kind)>,
    /// First cell of each column of texts.
    texts: Vec<Option<String>>,
    /// Texts of the names, and of the units below them, with their columns of the sheet.
    header: Vec<Vec<(u32, String)>>,
    format: Format,
}

/// A workbook.
struct Xlsx {
    source: Source,
    path: PathBuf,
    /// Rows of each sheet that are not read.
    skip_rows: u32,
    sheets: Vec<Sheet>,
    tables: Vec<Table>,
    notes: Vec<String>,
}

/// A cell, independent of the library.
#[derive(Debug, Clone, PartialEq)]
enum Cell {
    Number(f64),
    /// ns since 1970.
    Date(i64),
    Text(String),
    Missing,
}

impl Cell {
    fn of(value: &DataRef) -> Option<Self> {
        Some(match value {
            DataRef::Empty => return None,
            DataRef::Int(number) => Self::Number(*number as f64),
            DataRef::Float(number) => Self::Number(*number),
            DataRef::Bool(truth) => Self::Number(f64::from(u8::from(*truth))),
            DataRef::DateTime(date) => {
                let days = date.as_f64() - DAYS_TO_1970;
                Self::Date(((days * MICROSECONDS_PER_DAY).round() as i64).saturating_mul(1000))
            }
            DataRef::DateTimeIso(text) => Self::of_text(text),
            DataRef::String(text) => Self::of_text(text),
            DataRef::SharedString(text) => Self::of_text(text),
            DataRef::Error(CellErrorType::NA) => Self::Missing,
            DataRef::DurationIso(text) => Self::Text(text.clone()),
            DataRef::Error(error) => Self::Text(error.to_string()),
        })
    }

    fn of_text(text: &str) -> Self {
        match timestamp::parse(text.as_bytes()) {
            Some(date) => Self::Date(date),
            None if text.trim().is_empty() => Self::Missing,
            None => Self::Text(text.to_owned()),
        }
    }

    /// Bytes in memory.
    fn bytes(&self) -> usize {
        size_of::<(u32, Self)>() + if let Self::Text(text) = self { text.len() } else { 0 }
    }

    fn kind(&self, format: Format) -> Option<Kind> {
        match self {
            Self::Number(_) => Some(Kind::Number),
            Self::Date(_) => Some(Kind::Date),
            Self::Text(text) if format.number(text.as_bytes()).is_some() => Some(Kind::Number),
            Self::Text(_) => Some(Kind::Text),
            Self::Missing => None,
        }
    }

    /// A text as a name: control characters are blanks.
    fn plain(text: &str) -> String {
        text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
    }

    /// As in a text file: a date is a date in any notation.
    fn write(&self, line: &mut String) {
        match self {
            Self::Number(number) => line.push_str(&number.to_string()),
            Self::Date(_) => line.push_str("2000-01-01T00:00:00"),
            Self::Text(text) => {
                line.push('"');
                Self::plain(text).chars().for_each(|c| {
                    line.extend(std::iter::repeat_n(c, if c == '"' { 2 } else { 1 }))
                });
                line.push('"');
            }
            Self::Missing => {}
        }
    }
}

/// `B17` of a row and a column counted from 0.
fn cell_name(row: u32, column: u32) -> String {
    let (mut letters, mut rest) = (Vec::new(), column + 1);
    while rest > 0 {
        letters.push(char::from(b'A' + ((rest - 1) % 26) as u8));
        rest = (rest - 1) / 26;
    }
    letters.iter().rev().collect::<String>() + &(row + 1).to_string()
}

pub(crate) fn open(
    path: &Path,
    source: Source,
    skip_rows: u64,
) -> Result<Container, RecordingError> {
    let mut found = Xlsx {
        source: source.clone(),
        path: path.to_owned(),
        skip_rows: u32::try_from(skip_rows).unwrap_or(MOST_ROWS),
        sheets: Vec::new(),
        tables: Vec::new(),
        notes: Vec::new(),
    };
    source.guard("its structure", || {
        check_parts(path, &source)?;
        let mut workbook = open_book(path, &source)?;
        let sheets =
            workbook.sheets_metadata().iter().filter(|sheet| sheet.typ == SheetType::WorkSheet);
        let names: Vec<String> = sheets.map(|sheet| sheet.name.clone()).collect();
        names.into_iter().try_for_each(|name| found.list(&mut workbook, name))
    })?;
    if found.tables.is_empty() && skip_rows > 0 {
        let problem = format!("‹skip_rows› {skip_rows} leaves no rows of numbers in any sheet");
        return Err(RecordingError::unusable(source.file, problem));
    }
    if found.tables.is_empty() {
        return Err(RecordingError::Empty { file: source.file });
    }
    let (tables, notes) = (std::mem::take(&mut found.tables), std::mem::take(&mut found.notes));
    Ok(Container { notes, ..Container::new(source, tables, found) })
}

impl Xlsx {
    /// Adds a sheet, if it holds rows.
    fn list(&mut self, workbook: &mut Workbook, name: String) -> Result<(), RecordingError> {
        let mut rows: Vec<(u32, Vec<(u32, Cell)>)> = Vec::new();
        let mut bytes = 0;
        each_row(workbook, &self.source, &name, self.skip_rows, |row, cells| {
            let own = cells.iter().filter(|(_, cell)| *cell != Cell::Missing);
            if own.clone().next().is_some() {
                rows.push((row, own.cloned().collect()));
            }
            bytes += cells.iter().map(|(_, cell)| cell.bytes()).sum::<usize>();
            rows.len() < FIRST_ROWS && bytes < MOST_TEXT
        })?;
        let columns = rows.iter().flat_map(|(_, cells)| cells.iter().map(|(column, _)| *column));
        let Some((left, right)) = columns.clone().min().zip(columns.max()) else { return Ok(()) };
        let text = as_text(&rows, left, right);
        let head = match head_of(&self.source.file, text.as_bytes()) {
            Ok(head) => head,
            Err(RecordingError::Empty { .. } | RecordingError::HeaderOnly { .. }) => return Ok(()),
            Err(error) => return Err(error),
        };
        // Rows that begin with a number sign are comments in both.
        let Some(&(first_row, _)) = rows.get(head.lines) else { return Ok(()) };
        let header = [&head.names, &head.units].map(|texts| {
            let with_columns = (left..=right).zip(texts.iter().cloned());
            with_columns.filter(|(_, text)| !text.is_empty()).collect::<Vec<_>>()
        });
        let header = header.into_iter().filter(|texts| !texts.is_empty()).collect();
        let mut sheet = Sheet {
            name,
            first_row,
            columns: Vec::new(),
            texts: Vec::new(),
            header,
            format: head.format,
        };
        let mut table = Table { name: sheet.name.clone(), ..Table::default() };
        for column in left..=right {
            let cells = rows[head.lines..].iter().flat_map(|(_, cells)| cells);
            let cells: Vec<&Cell> =
                cells.filter(|(own, _)| *own == column).map(|(_, cell)| cell).collect();
            let at = (column - left) as usize;
            let Some((own, kind, text)) = described(&head, at, &cells) else { continue };
            table.columns.push(own);
            sheet.columns.push((column, kind));
            sheet.texts.push(text);
        }
        self.notes.extend(head.notes.iter().map(|note| format!("sheet '{}': {note}", sheet.name)));
        self.tables.push(table);
        self.sheets.push(sheet);
        Ok(())
    }
}

/// A column by its first cells, what it holds, and its first text if that is all; `None` if it is empty and
/// has no name.
fn described(head: &Head, at: usize, cells: &[&Cell]) -> Option<(Column, Kind, Option<String>)> {
    let name = head.names.get(at).cloned().unwrap_or_default();
    let kinds: Vec<Kind> = cells.iter().filter_map(|cell| cell.kind(head.format)).collect();
    let kind = match () {
        () if kinds.is_empty() && name.is_empty() => return None,
        () if kinds.contains(&Kind::Number) => Kind::Number,
        () => kinds.first().copied().unwrap_or(Kind::Number),
    };
    let is_other = kind == Kind::Date && is_recognised(&name) && time_unit(&name, None).is_none();
    let is_numeric = kind != Kind::Text && !is_other;
    let unit = match kind {
        Kind::Date => Some("s".to_owned()),
        _ => head.units.get(at).filter(|unit| !unit.is_empty()).cloned(),
    };
    let text = cells.iter().find_map(|cell| match cell {
        Cell::Text(text) if kind == Kind::Text => Some(quoted(text.as_bytes())),
        _ => None,
    });
    Some((Column { name, unit, is_numeric }, kind, text))
}

/// The rows as lines of text. Keys with their values, above a header, end where their cells do; all
/// other rows are as wide as the sheet.
fn as_text(rows: &[(u32, Vec<(u32, Cell)>)], left: u32, right: u32) -> String {
    let mut text = String::new();
    for (_, cells) in rows {
        let is_key = cells.len() <= 2 && right - left > 1 && matches!(cells[0].1, Cell::Text(_));
        let last = cells.last().map_or(left, |(column, _)| *column);
        let mut cells = cells.iter().peekable();
        for column in left..=(if is_key { last } else { right }) {
            if column > left {
                text.push('\t');
            }
            while let Some((_, cell)) = cells.next_if(|(own, _)| *own <= column) {
                cell.write(&mut text);
            }
        }
        text.push('\n');
    }
    text
}

/// Refuses a workbook whose parts would take more memory than its length justifies.
fn check_parts(path: &Path, source: &Source) -> Result<(), RecordingError> {
    // The library finds what is wrong with the archive.
    let Ok(mut archive) = zipped::open(path) else { return Ok(()) };
    let length = std::fs::metadata(path).map_or(0, |metadata| metadata.len());
    let mut total = 0;
    for k in 0..archive.len() {
        let Ok(mut part) = archive.by_index(k) else { continue };
        let most = length.saturating_mul(DENSEST_TEXT).max(LONGEST);
        let mut found = Part::default();
        let mut buffer = vec![0; 1 << 16];
        while let Ok(read @ 1..) = part.read(&mut buffer) {
            found.take(&buffer[..read]);
            zipped::check(total + found.bytes, length, source)?;
        }
        total += found.bytes;
        let problem = match found.shared_texts() {
            _ if found.longest > most => format!("a text or tag of {} bytes", found.longest),
            Some(count) if count > found.bytes / SHORTEST_TEXT => {
                format!("{count} shared texts stated in {} bytes", found.bytes)
            }
            _ => continue,
        };
        return Err(source.damaged(format!("part {}", k + 1), problem));
    }
    Ok(())
}

/// What is known of a part before it is read.
#[derive(Default)]
struct Part {
    bytes: u64,
    /// Longest text or tag, and bytes since the last tag began.
    longest: u64,
    since: u64,
    head: Vec<u8>,
}

impl Part {
    fn take(&mut self, bytes: &[u8]) {
        self.bytes += bytes.len() as u64;
        if (self.head.len() as u64) < LONGEST {
            self.head.extend_from_slice(bytes);
        }
        for (k, run) in bytes.split(|byte| *byte == b'<').enumerate() {
            self.since = run.len() as u64 + if k == 0 { self.since } else { 0 };
            self.longest = self.longest.max(self.since);
        }
    }

    /// The number of shared texts that it states, for which the library reserves memory.
    fn shared_texts(&self) -> Option<u64> {
        const COUNT: &[u8] = b"uniqueCount";
        let at = self.head.windows(COUNT.len()).position(|bytes| bytes == COUNT)? + COUNT.len();
        let digits = self.head[at..].iter().skip_while(|byte| !byte.is_ascii_digit());
        let digits: Vec<u8> = digits.copied().take_while(u8::is_ascii_digit).collect();
        Some(std::str::from_utf8(&digits).ok()?.parse().unwrap_or(u64::MAX))
    }
}

fn open_book(path: &Path, source: &Source) -> Result<Workbook, RecordingError> {
    open_workbook(path).map_err(|error: XlsxError| match error {
        XlsxError::Io(error) => RecordingError::Open { file: source.file.clone(), source: error },
        XlsxError::FileNotFound(what) => source.unsupported(
            format!("a ZIP archive without {what}"),
            "save a spreadsheet as .xlsx, or unpack the archive and give the recording in it",
        ),
        XlsxError::Password => source.unsupported("a password", "save it without one"),
        error => source.damaged("its structure", error),
    })
}

/// Passes the cells of each row from `first` on to `take`, until it returns `false`.
fn each_row(
    workbook: &mut Workbook,
    source: &Source,
    name: &str,
    first: u32,
    mut take: impl FnMut(u32, &[(u32, Cell)]) -> bool,
) -> Result<(), RecordingError> {
    let place = |row: u32| format!("sheet '{name}' row {}", row + 1);
    let mut reader = workbook
        .worksheet_cells_reader(name)
        .map_err(|error| source.damaged(format!("sheet '{name}'"), error))?;
    let mut row: (u32, Vec<(u32, Cell)>) = (0, Vec::new());
    let mut bytes = 0;
    loop {
        let next = reader.next_cell().map_err(|error| source.damaged(place(row.0), error))?;
        let at = next.as_ref().map(calamine::Cell::get_position);
        if at.is_none_or(|(at, _)| at != row.0) {
            if !row.1.is_empty() && row.0 >= first && !take(row.0, &row.1) {
                return Ok(());
            }
            row.1.clear();
            bytes = 0;
        }
        let Some((cell, (at, column))) = next.zip(at) else { return Ok(()) };
        // Cells of a row are found by a binary search.
        let is_in_order = at >= row.0 && row.1.last().is_none_or(|(last, _)| *last < column);
        if !is_in_order || at >= MOST_ROWS || column >= MOST_COLUMNS {
            let found = format!(
                "cell {}, which is out of order or outside of the sheet",
                cell_name(at, column)
            );
            return Err(source.damaged(place(row.0), found));
        }
        row.0 = at;
        row.1.extend(Cell::of(cell.get_value()).map(|cell| (column, cell)));
        bytes += row.1.last().map_or(0, |(_, cell)| cell.bytes());
        if bytes > MOST_TEXT {
            return Err(source
                .damaged(place(at), format!("a row with more than {MOST_TEXT} bytes of text")));
        }
    }
}

impl Content for Xlsx {
    fn dates(&self, table: usize) -> Vec<usize> {
        let columns = self.sheets[table].columns.iter().enumerate();
        columns.filter(|(_, (_, kind))| *kind == Kind::Date).map(|(k, _)| k).collect()
    }

    fn number_with_unit(&self, table: usize, column: usize) -> Option<&str> {
        let sheet = &self.sheets[table];
        sheet.texts[column].as_deref().filter(|text| has_unit(text, sheet.format))
    }

    fn open(&self, at: usize, table: &Table, columns: &[usize]) -> Opened {
        let sheet = &self.sheets[at];
        let wanted: Vec<(u32, Kind, &str)> = columns
            .iter()
            .map(|&k| (sheet.columns[k].0, sheet.columns[k].1, &*table.columns[k].name))
            .collect();
        let mut rows = Held::of(vec![Vec::new(); columns.len()]);
        let mut origins = vec![None; columns.len()];
        let (mut headers, mut footer) = (RowList::default(), Footer::default());
        let footers = FooterColumn::of(sheet, table);
        let read = self.source.guard(format!("sheet '{}'", sheet.name), || {
            let mut problem = None;
            let mut workbook = open_book(&self.path, &self.source)?;
            each_row(&mut workbook, &self.source, &sheet.name, sheet.first_row, |row, cells| {
                if cells.iter().all(|(_, cell)| *cell == Cell::Missing) {
                    return true;
                }
                if sheet.is_header(cells) {
                    headers.add(u64::from(row) + 1);
                    return true;
                }
                if let Some((column, cell)) =
                    footers.as_ref().and_then(|column| sheet.footer_text(cells, column))
                {
                    let name = sheet.columns.iter().position(|(own, _)| own == column);
                    let name = name.map_or("", |k| &table.columns[k].name);
                    let error = self.not_a_number(sheet, (row, *column), name, cell);
                    problem = footer.add(u64::from(row) + 1, error);
                    return problem.is_none();
                }
                problem = footer.end();
                if problem.is_some() {
                    return false;
                }
                for (k, (column, kind, name)) in wanted.iter().enumerate() {
                    let place = cells.binary_search_by_key(column, |(own, _)| *own);
                    let cell = place.map_or(&Cell::Missing, |place| &cells[place].1);
                    let Some(number) = number(cell, *kind, sheet.format, &mut origins[k]) else {
                        problem = Some(self.not_a_number(sheet, (row, *column), name, cell));
                        return false;
                    };
                    rows.columns[k].push(number);
                }
                true
            })?;
            problem.map_or(Ok(()), Err)
        });
        // The last row may have ended at a cell that is no number.
        let whole = rows.columns.iter().map(Vec::len).min().unwrap_or(0);
        rows.columns.iter_mut().for_each(|column| column.truncate(whole));
        rows.problem = read.err();
        rows.warnings = warn_of_repeated(&headers, "row").into_iter().collect();
        rows.warnings.extend(footer.warning());
        Ok(Box::new(rows))
    }
}

/// The number of a cell; `None` if it is not of the column's kind. Dates count from the first.
fn number(cell: &Cell, kind: Kind, format: Format, origin: &mut Option<i64>) -> Option<f64> {
    match (cell, kind) {
        (Cell::Missing, _) => Some(f64::NAN),
        (Cell::Number(number), Kind::Number) => Some(*number),
        (Cell::Text(text), Kind::Number) => format.number(text.as_bytes()),
        (Cell::Date(date), Kind::Date) => {
            Some(date.saturating_sub(*origin.get_or_insert(*date)) as f64 / 1e9)
        }
        _ => None,
    }
}

impl Xlsx {
    fn not_a_number(
        &self,
        sheet: &Sheet,
        (row, column): (u32, u32),
        name: &str,
        cell: &Cell,
    ) -> RecordingError {
        let found = match cell {
            Cell::Number(number) => number.to_string(),
            Cell::Date(_) => "a date".to_owned(),
            Cell::Text(text) => quoted(text.as_bytes()),
            Cell::Missing => String::new(),
        };
        let hint = match has_unit(&found, sheet.format) {
            true => UNIT_IN_CELL,
            false => "correct the cell, or clear it: an empty cell is a missing number",
        };
        let (file, cell) = (&self.source.file, cell_name(row, column));
        RecordingError::unusable(
            format_args!("{file} sheet '{}' cell {cell}", sheet.name),
            format!("found '{found}' in column {name}, expected a number\n\nhint: {hint}"),
        )
    }
}

impl Sheet {
    /// Whether a row repeats the names or the units.
    fn is_header(&self, cells: &[(u32, Cell)]) -> bool {
        let texts: Vec<(u32, String)> = cells
            .iter()
            .filter_map(|(column, cell)| match cell {
                Cell::Text(text) => Some((*column, Cell::plain(text).trim().to_owned())),
                _ => None,
            })
            .collect();
        let present = cells.iter().filter(|(_, cell)| *cell != Cell::Missing).count();
        present == texts.len() && self.header.contains(&texts)
    }

    /// The first text of a row that has no number in the column by which that is decided.
    fn footer_text<'a>(
        &self,
        cells: &'a [(u32, Cell)],
        of: &FooterColumn,
    ) -> Option<&'a (u32, Cell)> {
        let FooterColumn { column, kind, is_time } = *of;
        let own = cells.iter().find(|(own, _)| *own == column).map_or(&Cell::Missing, |(_, c)| c);
        let has_number = number(own, kind, self.format, &mut None).is_some_and(f64::is_finite);
        cells
            .iter()
            .find(|(own, cell)| {
                (is_time || *own <= column)
                    && cell.kind(self.format) == Some(Kind::Text)
                    && !self.columns.contains(&(*own, Kind::Text))
            })
            .filter(|_| !has_number)
    }
}

/// The column that has a number in every row of readings: the times, or where there are none, the
/// first column of numbers.
struct FooterColumn {
    column: u32,
    kind: Kind,
    is_time: bool,
}

impl FooterColumn {
    fn of(sheet: &Sheet, table: &Table) -> Option<Self> {
        let columns = sheet.columns.iter().zip(&table.columns);
        let mut numeric = columns.filter(|(_, own)| own.is_numeric);
        let time = numeric.clone().find(|((_, kind), own)| {
            *kind == Kind::Date || time_unit(&own.name, own.unit.as_deref()).is_some()
        });
        let is_time = time.is_some();
        time.or_else(|| numeric.next()).map(|((column, kind), _)| Self {
            column: *column,
            kind: *kind,
            is_time,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_named_as_in_a_spreadsheet() {
        for (row, column, name) in
            [(0, 0, "A1"), (16, 1, "B17"), (0, 25, "Z1"), (9, 26, "AA10"), (0, 16_383, "XFD1")]
        {
            assert_eq!(cell_name(row, column), name);
        }
    }
}
