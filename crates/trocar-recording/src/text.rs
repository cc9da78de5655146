//! Rows of numbers from a text stream, in constant memory.
//!
//! The input is split at line ends into pieces that are parsed in parallel, while its hash is
//! computed. Plain numeric lines use a fast path (`fast_line`). Quotes, comments, blank lines,
//! decimal commas and all faults use the general one. A piece ends before an invalid line; the
//! reader formulates the error once all earlier rows have been returned.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;
use sha2::{Digest, Sha256};
use trocar_tables::text::{
    Format, Marks, Separator, Splitter, TextInput, comment_text, is_comment, text_of, timestamp,
};

use super::block::Block;
use super::columns::{Layout, Slot, UNIT_IN_CELL, has_unit, is_unit_row};
use super::container::{Batches, Column, Container, Content, Opened, Table};
use super::formats::Source;
use super::header::{Text, in_order};
use super::quality::{LONGEST_FOOTER, RowList, warn_of_footer, warn_of_repeated};
use super::units::Quantity;
use super::{RecordingError, columns};

/// Bytes read at a time from a file, and from a real-time stream; the second is also the longest
/// line accepted.
const CHUNK: usize = 4 << 20;
const LONGEST_LINE: usize = 256 * 1024;

/// Least size of a piece in bytes.
const PIECE: usize = 128 * 1024;

/// Lines examined to detect the format.
const SNIFFED_LINES: usize = 16;

/// Most lines in which a header is sought, and fewest rows below it that show what is a row.
const LONGEST_PREAMBLE: usize = 256;
const ROWS_AFTER_PREAMBLE: usize = 3;

/// Most rows read to guess a unit.
const GUESSED_ROWS: usize = 20_000;

/// Characters of a file quoted in a message.
const QUOTED: usize = 60;

/// Reads rows from any byte stream.
pub(crate) struct TextReader<R> {
    file: String,
    input: R,
    /// Whether to wait for a full buffer; false for rows that are used in real time.
    greedy: bool,
    buffer: Vec<u8>,
    /// Next byte to parse.
    start: usize,
    /// End of the last complete line in the buffer.
    complete: usize,
    /// End of the bytes read.
    filled: usize,
    /// First byte not yet included in the hash.
    unhashed: usize,
    finished: bool,
    bytes_read: u64,
    /// Line number of `start`.
    line: u64,
    hash: Option<Sha256>,
    format: Format,
    layout: Layout,
    /// Line of the first row.
    first_row: u64,
    /// Cells of the header, and of the line of units below it; none without a header.
    header: Vec<Vec<String>>,
    /// Line of the header.
    header_line: u64,
    /// The last comment before the numbers and its line, if it has as many cells as they.
    comment: Option<(u64, Vec<String>)>,
    /// What was skipped before it.
    notes_of_text: Vec<String>,
    /// Lines that repeat them.
    repeated: RowList,
    /// Lines of text at the end.
    footer: RowList,
    /// Bytes and lines of the first buffer, for an estimate.
    bytes_per_line: f64,
}

impl<R: Read> TextReader<R> {
    /// Reads up to the first row of numbers, from behind `skip_rows` lines. What the columns are is told to
    /// [`TextReader::start`].
    pub(crate) fn open(
        file: &str,
        input: R,
        skip_rows: u64,
        greedy: bool,
        hash: bool,
    ) -> Result<Self, RecordingError> {
        let mut reader = Self {
            file: file.to_owned(),
            input,
            greedy,
            buffer: vec![0; if greedy { CHUNK } else { LONGEST_LINE }],
            start: 0,
            complete: 0,
            filled: 0,
            unhashed: 0,
            finished: false,
            bytes_read: 0,
            line: 1,
            hash: hash.then(Sha256::new),
            format: Format::default(),
            layout: Layout::default(),
            first_row: 0,
            header: Vec::new(),
            header_line: 0,
            comment: None,
            notes_of_text: Vec::new(),
            repeated: RowList::default(),
            footer: RowList::default(),
            bytes_per_line: 1.0,
        };
        reader.refill()?;
        reader.check_text()?;
        reader.skip_rows(skip_rows)?;
        reader.find_header()?;
        let bytes = &reader.buffer[reader.start..reader.complete];
        let lines = bytes.iter().filter(|&&b| b == b'\n').count().max(1);
        reader.bytes_per_line = bytes.len() as f64 / lines as f64;
        Ok(reader)
    }

    /// Reads the columns of `layout` from now on.
    pub(crate) fn start(mut self, layout: Layout) -> Result<Self, RecordingError> {
        if self.has_header() && self.peek_line(0).is_none() {
            return Err(RecordingError::HeaderOnly { file: self.file, line: self.header_line });
        }
        self.layout = layout;
        self.find_origin();
        self.first_row = self.line;
        self.layout.notes.append(&mut self.notes_of_text);
        Ok(self)
    }

    /// Reads all columns, unchanged.
    fn start_all(self) -> Result<Self, RecordingError> {
        let layout = self.all_columns();
        self.start(layout)
    }

    pub(crate) fn file(&self) -> &str {
        &self.file
    }

    /// Whether the names of the columns are a line of the text.
    pub(crate) fn has_header(&self) -> bool {
        !self.header.is_empty()
    }

    /// The names of the columns and their line: the header, or else a comment that may be one.
    pub(crate) fn names(&self) -> Option<(u64, &[String])> {
        let commented = self.comment.as_ref().map(|(line, names)| (*line, &names[..]));
        self.header.first().map(|names| (self.header_line, &names[..])).or(commented)
    }

    /// The units below the names, one each; none without such a line.
    pub(crate) fn units(&self) -> &[String] {
        self.header.get(1).map_or(&[], Vec::as_slice)
    }

    /// SHA-256 of all bytes of the text, decompressed, in hexadecimal; valid after the last row.
    pub(crate) fn digest(&mut self) -> String {
        self.take_hash();
        self.hash.take().map(|hash| hex(&hash.finalize())).unwrap_or_default()
    }

    /// Replaces the content of `block` by the next rows; `false` at the end.
    pub(crate) fn fill(&mut self, block: &mut Block) -> Result<bool, RecordingError> {
        block.clear();
        while block.is_empty() {
            if self.start == self.complete && !self.refill()? {
                return Ok(false);
            }
            let wrong = self.parse_buffer(block);
            if let Some(fault) = wrong.filter(|_| block.is_empty()) {
                if self.skip_footer()? {
                    return Ok(false);
                }
                return Err(self.word(fault)?);
            }
        }
        Ok(true)
    }

    /// Parses the complete lines up to the first invalid one, and computes their hash meanwhile.
    fn parse_buffer(&mut self, block: &mut Block) -> Option<Fault> {
        let bytes = &self.buffer[self.start..self.complete];
        let (format, layout, header) = (self.format, &self.layout, &self.header[..]);
        let threads = rayon::current_num_threads();
        let pieces = cut(bytes, (bytes.len() / PIECE).min(4 * threads));
        let parse =
            |piece: &&[u8]| Piece::parse(piece, format, layout, header, block.columns.len());
        let parsed: Vec<Piece> = if pieces.len() < 2 {
            pieces.iter().map(parse).collect()
        } else {
            let fresh = &self.buffer[self.unhashed..self.filled];
            let hash = &mut self.hash;
            self.unhashed = self.filled;
            // A hash cannot be taken in pieces: it goes on beside them.
            rayon::join(
                move || hash.iter_mut().for_each(|hash| hash.update(fresh)),
                || pieces.par_iter().map(parse).collect(),
            )
            .1
        };
        for piece in parsed {
            block.append(&piece.rows, self.line);
            piece.headers.iter().for_each(|line| self.repeated.add(self.line + line));
            self.start += piece.used;
            self.line += piece.lines;
            if piece.fault.is_some() {
                return piece.fault;
            }
        }
        None
    }

    fn take_hash(&mut self) {
        if let Some(hash) = &mut self.hash {
            hash.update(&self.buffer[self.unhashed..self.filled]);
        }
        self.unhashed = self.filled;
    }

    /// Moves the unfinished line to the front and continues reading until at least one line is
    /// complete.
    fn refill(&mut self) -> Result<bool, RecordingError> {
        self.take_hash();
        self.buffer.copy_within(self.complete..self.filled, 0);
        self.filled -= self.complete;
        (self.start, self.complete, self.unhashed) = (0, 0, self.filled);
        while !self.finished {
            if self.complete == 0 && self.filled >= LONGEST_LINE - 1 {
                return Err(self.fault_in_line(format!(
                    "longer than {LONGEST_LINE} bytes, expected one row of numbers per line"
                )));
            }
            // One byte is reserved for the newline that the last line may lack.
            let space = self.buffer.len() - 1;
            let read = match self.input.read(&mut self.buffer[self.filled..space]) {
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => continue,
                Err(source) => {
                    return Err(RecordingError::Read {
                        file: self.file.clone(),
                        line: self.line,
                        source,
                    });
                }
                Ok(read) => read,
            };
            self.take_in(read);
            if self.complete > 0 && (!self.greedy || self.filled == self.buffer.len() - 1) {
                return Ok(true);
            }
        }
        Ok(self.complete > 0)
    }

    /// Counts `read` new bytes; zero means the end of the stream.
    fn take_in(&mut self, read: usize) {
        let fresh = &self.buffer[self.filled..self.filled + read];
        if let Some(at) = fresh.iter().rposition(|&b| b == b'\n') {
            self.complete = self.filled + at + 1;
        }
        self.filled += read;
        self.bytes_read += read as u64;
        if read > 0 {
            return;
        }
        self.finished = true;
        self.take_hash();
        if self.filled > self.complete {
            self.buffer[self.filled] = b'\n';
            self.filled += 1;
            (self.complete, self.unhashed) = (self.filled, self.filled);
        }
    }

    /// Skips a byte order mark; rejects anything that is not text.
    fn check_text(&mut self) -> Result<(), RecordingError> {
        let bytes = &self.buffer[..self.complete.max(self.filled)];
        let found = if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
            Some("text in UTF-16")
        } else if bytes.contains(&0) {
            Some("binary data")
        } else if is_json(bytes) {
            Some("JSON")
        } else {
            None
        };
        if let Some(found) = found {
            let problem = format!(
                "looks like {found}, expected text separated by commas, semicolons, tabs or spaces\n\nhint: export the recording as CSV in UTF-8"
            );
            return Err(RecordingError::unusable(&self.file, problem));
        }
        if bytes.starts_with(&[0xef, 0xbb, 0xbf]) {
            self.start = 3;
        }
        Ok(())
    }

    /// Finds format and header and leaves `start` at the first row of numbers.
    fn find_header(&mut self) -> Result<(), RecordingError> {
        let mut comment = self.skip_blank()?;
        if let Some(lines) = preamble(&self.buffer[self.start..self.complete]) {
            (0..lines).for_each(|_| self.skip_line());
            comment = self.skip_blank()?;
            self.notes_of_text.push(format!(
                "{lines} {} before the header skipped",
                if lines == 1 { "line" } else { "lines" }
            ));
        }
        let Some(first) = self.peek_line(0).map(<[u8]>::to_vec) else {
            return Err(RecordingError::Empty { file: self.file.clone() });
        };
        let lines: Vec<&[u8]> =
            (0..).map_while(|k| self.peek_line(k)).take(SNIFFED_LINES).collect();
        self.format = Format::sniff(&lines);
        self.settle_marks();
        let names = self.cells(&first);
        if self.is_header(&names) {
            return self.take_header(names);
        }
        // Some tools write the names as the last comment before the numbers.
        self.comment = comment
            .map(|(line, text)| (line, self.cells(&text)))
            .filter(|(_, cells)| cells.len() == names.len());
        Ok(())
    }

    /// The error of a text without names of its columns.
    pub(crate) fn no_header(&self) -> RecordingError {
        let first = self.peek_line(0).unwrap_or_default();
        RecordingError::NoHeader {
            file: self.file.clone(),
            line: self.line,
            found: quoted(first),
            hint: in_order(&self.first_rows(self.cells(first).len())).map_or_else(
                || "a recording needs columns of position and force".to_owned(),
                |option| {
                    format!(
                        "name the columns in order, with units and '-' for those to skip, for example {option}"
                    )
                },
            ),
        }
    }

    /// Finds what points and commas mean in the rows of the buffer.
    fn settle_marks(&mut self) {
        if !self.greedy {
            // Of a live stream only what has arrived is known, and that must decide nothing.
            return;
        }
        let mut marks = Marks::default();
        let mut splitter = Splitter::new(self.format.separator);
        let lines = self.buffer[self.start..self.complete].split(|&b| b == b'\n');
        for line in lines.take(GUESSED_ROWS).filter(|line| !is_comment(line)) {
            let cells = splitter.split(line.strip_suffix(b"\r").unwrap_or(line));
            (0..cells).for_each(|k| marks.add(k, splitter.cell(k)));
        }
        self.format = marks.settle(self.format);
        let (mark, word, decimal) = match self.format.decimal_comma {
            true => ('.', "point", "comma"),
            false => (',', "comma", "point"),
        };
        if self.format.grouped && marks.may_group(mark) {
            self.notes_of_text.push(format!(
                "the {word} groups thousands, as in 1{mark}234, and the decimal mark is the {decimal}"
            ));
        }
    }

    /// Names need not be recognised (`--columns` may define them), but they are not numbers.
    fn is_header(&self, cells: &[String]) -> bool {
        cells.iter().any(|cell| columns::is_recognised(cell))
            || cells
                .iter()
                .all(|cell| cell.is_empty() || self.format.number(cell.as_bytes()).is_none())
    }

    fn take_header(&mut self, mut names: Vec<String>) -> Result<(), RecordingError> {
        self.header_line = self.line;
        self.skip_line();
        self.skip_blank()?;
        let second = self.peek_line(0).map(<[u8]>::to_vec);
        let units = second.map(|text| self.cells(&text)).filter(|cells| is_unit_row(cells));
        let units = units.filter(|units| units.len() == names.len()).unwrap_or_default();
        if !units.is_empty() {
            self.skip_line();
            self.skip_blank()?;
        }
        // A last column of comments is often empty in the rows, together with its separator.
        let first = self.peek_line(0).map_or(0, |line| self.cells(line).len());
        if first + 1 == names.len()
            && names.last().is_some_and(|name| name.eq_ignore_ascii_case("comment"))
        {
            names.pop();
        }
        self.header = [names, units].into_iter().filter(|cells| !cells.is_empty()).collect();
        Ok(())
    }

    /// The layout of all columns but those whose next cell is text.
    fn all_columns(&self) -> Layout {
        let cells = self.peek_line(0).map(|line| self.cells(line)).unwrap_or_default();
        let mut layout = Layout::all(match self.names() {
            Some((_, names)) => names.to_vec(),
            None => (1..=cells.len()).map(|k| format!("column {k}")).collect(),
        });
        for (name, unit) in layout.names.iter_mut().zip(self.units()) {
            name.push_str(&format!(" {unit}"));
        }
        for (slot, cell) in layout.slots.iter_mut().zip(&cells) {
            slot.take_if(|_| self.format.number(cell.as_bytes()).is_none());
        }
        layout
    }

    /// Skips the lines that the caller wants to be skipped.
    fn skip_rows(&mut self, rows: u64) -> Result<(), RecordingError> {
        for _ in 0..rows {
            if self.start == self.complete && !self.refill()? {
                let problem = format!("‹skip_rows› {rows} leaves no line of {}", self.line - 1);
                return Err(RecordingError::unusable(&self.file, problem));
            }
            self.skip_line();
        }
        Ok(())
    }

    /// Columns of dates in the current line.
    pub(crate) fn timestamps(&self) -> Vec<usize> {
        let cells = self.peek_line(0).map(|line| self.cells(line)).unwrap_or_default();
        (0..cells.len()).filter(|k| timestamp::parse(cells[*k].as_bytes()).is_some()).collect()
    }

    /// If times are dates, they count from the first in the buffer.
    fn find_origin(&mut self) {
        let column = self.layout.column(Quantity::Time).filter(|_| !self.layout.tolerates_text());
        let Some(column) = column else { return };
        let mut lines = (0..SNIFFED_LINES).map_while(|k| self.peek_line(k));
        let first =
            lines.find_map(|line| timestamp::parse(self.cells(line).get(column)?.as_bytes()));
        if first.is_some() {
            self.layout.origin = first;
            self.layout.slots[column] = Some(Slot::of(Quantity::Time, 1.0));
        }
    }

    /// Losses so far.
    pub(crate) fn warnings(&self) -> Vec<String> {
        let footer = warn_of_footer(&self.footer, "line");
        warn_of_repeated(&self.repeated, "line").into_iter().chain(footer).collect()
    }

    /// Leaves out the rest of a file if it is a few lines without a time, such as mean and range;
    /// `false` if it is not, with the current line as it was.
    fn skip_footer(&mut self) -> Result<bool, RecordingError> {
        if !self.greedy || self.line == self.first_row || !self.may_be_footer() {
            return Ok(false);
        }
        if !self.finished {
            // The end may not have been read yet: nothing of the buffer is used up.
            self.complete = self.start;
            self.refill()?;
        }
        let is_footer = self.finished && self.may_be_footer();
        if is_footer {
            let rest = &self.buffer[self.start..self.complete];
            let lines = rest.split_inclusive(|&b| b == b'\n').map(<[u8]>::trim_ascii);
            for line in lines {
                if !is_nothing(line) {
                    self.footer.add(self.line);
                }
                self.line += 1;
            }
            self.start = self.complete;
        }
        Ok(is_footer)
    }

    /// Whether all lines of the buffer, a few, are without a time.
    fn may_be_footer(&self) -> bool {
        let rest = &self.buffer[self.start..self.complete];
        // Without a column of times, any that is used.
        let time = self.layout.column(Quantity::Time);
        let time = time.or_else(|| self.layout.slots.iter().position(Option::is_some));
        let mut lines = rest.split_inclusive(|&b| b == b'\n').map(<[u8]>::trim_ascii);
        let few = rest.len() < LONGEST_LINE / 2 && lines.clone().count() <= LONGEST_FOOTER;
        few && lines.all(|line| is_nothing(line) || self.has_no_value(line, time.unwrap_or(0)))
    }

    /// Whether neither a number nor a date is in a column of a line.
    fn has_no_value(&self, line: &[u8], column: usize) -> bool {
        let cells = self.cells(line);
        let cell = cells.get(column).or(cells.first()).map_or(&b""[..], String::as_bytes);
        self.format.number(cell).is_none_or(f64::is_nan) && timestamp::parse(cell).is_none()
    }

    /// Numbers of the rows in the buffer, by column; none for a column with text.
    pub(crate) fn first_rows(&self, columns: usize) -> Vec<Vec<f64>> {
        let mut rows = vec![Vec::new(); columns];
        let mut is_text = vec![false; columns];
        let mut splitter = Splitter::new(self.format.separator);
        for line in self.buffer[self.start..self.complete].split(|&b| b == b'\n').take(GUESSED_ROWS)
        {
            if splitter.split(line) != columns || is_comment(line) {
                continue;
            }
            for k in 0..columns {
                match self.format.number(splitter.cell(k)) {
                    Some(number) if number.is_finite() => rows[k].push(number),
                    Some(_) => {}
                    None => is_text[k] = true,
                }
            }
        }
        rows.iter_mut()
            .zip(is_text)
            .filter(|(_, is_text)| *is_text)
            .for_each(|(column, _)| column.clear());
        rows
    }

    /// The first cell with text in a column of the rows in the buffer.
    pub(crate) fn first_text(&self, column: usize) -> Option<Text> {
        let lines = self.buffer[self.start..self.complete].split(|&b| b == b'\n');
        let mut splitter = Splitter::new(self.format.separator);
        lines.take(GUESSED_ROWS).filter(|line| !is_nothing(line)).find_map(|line| {
            let cell = (splitter.split(line) > column).then(|| splitter.cell(column))?;
            if self.format.number(cell).is_some() {
                return None;
            }
            let text = quoted(cell.trim_ascii());
            let has_unit = has_unit(&text, self.format);
            Some(if has_unit { Text::WithUnit(text) } else { Text::Other })
        })
    }

    /// Skips blank and comment lines; returns the last comment with its line.
    fn skip_blank(&mut self) -> Result<Option<(u64, Vec<u8>)>, RecordingError> {
        let mut comment = None;
        loop {
            if self.start == self.complete && !self.refill()? {
                return Ok(comment);
            }
            let line = self.peek_line(0).unwrap_or_default().trim_ascii();
            if is_comment(line) {
                comment = Some((self.line, comment_text(line).to_vec()));
            } else if !line.is_empty() {
                return Ok(comment);
            }
            self.skip_line();
        }
    }

    /// The `k`-th complete line in the buffer from the current position, without its end.
    fn peek_line(&self, k: usize) -> Option<&[u8]> {
        let bytes = &self.buffer[self.start..self.complete];
        let line = bytes.split_inclusive(|&b| b == b'\n').nth(k)?;
        let line = line.strip_suffix(b"\n").unwrap_or(line);
        Some(line.strip_suffix(b"\r").unwrap_or(line))
    }

    fn skip_line(&mut self) {
        let bytes = &self.buffer[self.start..self.complete];
        let length = bytes.iter().position(|&b| b == b'\n').map_or(bytes.len(), |at| at + 1);
        self.start += length;
        self.line += 1;
    }

    /// The cells of a header line.
    fn cells(&self, line: &[u8]) -> Vec<String> {
        cells_of(&mut Splitter::new(self.format.separator), line)
    }

    /// Formulates the error of the current line; fails if it cannot be read whether this is the
    /// last line.
    fn word(&mut self, fault: Fault) -> Result<RecordingError, RecordingError> {
        match fault {
            Fault::FieldCount(found) => self.field_count(self.line, found),
            Fault::NotANumber(column, found) => {
                let hint = if found.contains(',') {
                    "\n\nhint: decimal commas must be used throughout, without thousands separators"
                        .to_owned()
                } else if has_unit(&found, self.format) {
                    format!("\n\nhint: {UNIT_IN_CELL}")
                } else if self.line == self.first_row {
                    self.header_below()
                } else {
                    String::new()
                };
                let column = &self.layout.names[column];
                Ok(self.fault_in_line(format!(
                    "found '{found}' in column {column}, expected a number{hint}"
                )))
            }
        }
    }

    fn fault_in_line(&self, problem: String) -> RecordingError {
        RecordingError::unusable(format_args!("{} line {}", self.file, self.line), problem)
    }

    /// Remedy if nothing can be read below what looks like the header: the lines before the next
    /// one that names columns, or those so far.
    fn header_below(&self) -> String {
        let mut lines = (0..LONGEST_PREAMBLE).map_while(|k| self.peek_line(k));
        let header = lines.position(|line| {
            self.cells(line).iter().filter(|cell| columns::is_recognised(cell)).count() > 1
        });
        let before = header.unwrap_or(1) as u64 + self.line - 1;
        format!(
            "\n\nhint: if the header is further below, skip the lines before it, for example ‹skip_rows={before}›"
        )
    }

    fn field_count(&mut self, line: u64, found: usize) -> Result<RecordingError, RecordingError> {
        let below = self.header_below();
        self.skip_line();
        let last = self.start == self.complete && !self.refill()?;
        let hint = match self.layout.source {
            _ if last => {
                "\n\nhint: this is the last line; was the recording cut off while it was written?"
                    .to_owned()
            }
            "the header" if line == self.first_row => below,
            "‹columns›" => "\n\nhint: name every column in order, '-' skips one".to_owned(),
            _ => String::new(),
        };
        let (file, expected) = (&self.file, self.layout.slots.len());
        let reference = self.layout.source;
        let problem = format!("found {found} fields, expected {expected} as in {reference}{hint}");
        Ok(RecordingError::unusable(format_args!("{file} line {line}"), problem))
    }
}

/// What precedes the rows of a table, and how its numbers are written.
#[cfg(feature = "xlsx")]
pub(super) struct Head {
    pub(super) names: Vec<String>,
    /// One each, or none at all.
    pub(super) units: Vec<String>,
    /// Lines before the first row.
    pub(super) lines: usize,
    pub(super) format: Format,
    pub(super) notes: Vec<String>,
}

/// The head of a table whose first lines are given as text.
#[cfg(feature = "xlsx")]
pub(super) fn head_of(file: &str, text: &[u8]) -> Result<Head, RecordingError> {
    let reader = TextReader::open(file, text, 0, true, false)?.start_all()?;
    let mut header = reader.header.into_iter();
    let names = header.next().unwrap_or(reader.layout.names);
    let (units, lines) = (header.next().unwrap_or_default(), (reader.first_row - 1) as usize);
    Ok(Head { names, units, lines, format: reader.format, notes: reader.layout.notes })
}

/// A text file as a table of all its columns.
pub(super) struct TextTable {
    path: PathBuf,
    skip_rows: u64,
}

impl TextTable {
    /// Opens the text after `skip_rows` lines.
    pub(super) fn open(path: &Path, skip_rows: u64) -> Result<Container, RecordingError> {
        let input = TextInput::open(path).map_err(RecordingError::cannot_open(path))?;
        let file = path.display().to_string();
        let reader = TextReader::open(&file, input.text, skip_rows, false, false)?.start_all()?;
        let described = reader.layout.names.iter().zip(&reader.layout.slots);
        let columns = described
            .map(|(name, slot)| Column {
                name: name.clone(),
                unit: None,
                is_numeric: slot.is_some(),
            })
            .collect();
        let format = match reader.format.separator {
            Separator::Byte(b',') => "text, separated by commas",
            Separator::Byte(b';') => "text, separated by semicolons",
            Separator::Byte(b'\t') => "text, separated by tabs",
            Separator::Byte(_) => "text, separated by bars",
            Separator::Whitespace => "text, separated by spaces",
        };
        let table = Table::without_a_name(columns);
        let text = Self { path: path.to_owned(), skip_rows };
        Ok(Container::new(Source { file, format }, vec![table], text))
    }
}

impl Content for TextTable {
    fn open(&self, _at: usize, _table: &Table, columns: &[usize]) -> Opened {
        let input = TextInput::open(&self.path).map_err(RecordingError::cannot_open(&self.path))?;
        let file = self.path.display().to_string();
        let is_file = input.file.is_some();
        let reader = TextReader::open(&file, input.text, self.skip_rows, is_file, false)?;
        let mut layout = reader.all_columns();
        layout.slots.fill(None);
        for (output, column) in columns.iter().enumerate().rev() {
            if let Some(slot) = layout.slots.get_mut(*column) {
                *slot = Some(Slot { output, per_si: 1.0 });
            }
        }
        Ok(Box::new(TextBatches {
            reader: reader.start(layout)?,
            block: Block::new(columns.len()),
            outputs: (0..columns.len()).collect(),
            input: input.file,
        }))
    }
}

/// Rows of a text, as they stand there.
pub(super) struct TextBatches<R> {
    reader: TextReader<R>,
    block: Block,
    /// Place in the block of each column that is asked for.
    outputs: Vec<usize>,
    /// Size of the file, compressed or not, and number of bytes read.
    input: Option<(u64, Arc<AtomicU64>)>,
}

impl<R: Read + Send> TextBatches<R> {
    /// The columns of `layout`, and what became of it: units are left to the caller.
    pub(super) fn start(
        reader: TextReader<R>,
        layout: Layout,
        input: Option<(u64, Arc<AtomicU64>)>,
    ) -> Result<(Self, Layout), RecordingError> {
        let mut reader = reader.start(layout)?;
        let layout = reader.layout.clone();
        reader.layout.slots.iter_mut().flatten().for_each(|slot| slot.per_si = 1.0);
        let outputs = layout.slots.iter().flatten().map(|slot| slot.output).collect();
        Ok((Self { reader, block: Block::new(Quantity::ALL.len()), outputs, input }, layout))
    }
}

impl<R: Read + Send> Batches for TextBatches<R> {
    fn next(&mut self, columns: &mut [Vec<f64>]) -> Result<bool, RecordingError> {
        let more = self.reader.fill(&mut self.block)?;
        for (own, output) in columns.iter_mut().zip(&self.outputs) {
            std::mem::swap(own, &mut self.block.columns[*output]);
        }
        Ok(more)
    }

    fn lines(&mut self) -> Option<Vec<(usize, u64)>> {
        Some(std::mem::take(&mut self.block.lines))
    }

    fn expected(&self) -> Option<u64> {
        let (size, read) = self.input.as_ref()?;
        let read = read.load(Ordering::Relaxed).max(1) as f64;
        let decompressed = self.reader.bytes_read as f64 / read;
        Some((*size as f64 * decompressed / self.reader.bytes_per_line) as u64)
    }

    fn digest(&mut self) -> String {
        self.reader.digest()
    }

    fn warnings(&self) -> Vec<String> {
        self.reader.warnings()
    }
}

/// Fault of a line.
#[derive(Debug)]
enum Fault {
    /// Number of cells.
    FieldCount(usize),
    /// The cell of this column is not a number.
    NotANumber(usize, String),
}

/// Splits `bytes`, which end with a line end, into about `count` pieces that do, too.
fn cut(bytes: &[u8], count: usize) -> Vec<&[u8]> {
    let mut pieces = Vec::with_capacity(count.max(1));
    let mut rest = bytes;
    for left in (2..=count).rev() {
        let about = rest.len() / left;
        let Some(end) = rest[about..].iter().position(|&b| b == b'\n') else { break };
        let (piece, others) = rest.split_at(about + end + 1);
        pieces.push(piece);
        rest = others;
    }
    if !rest.is_empty() {
        pieces.push(rest);
    }
    pieces
}

/// Some lines as rows; lines are counted from 0.
struct Piece {
    rows: Block,
    /// Lines that repeat the header.
    headers: Vec<u64>,
    used: usize,
    lines: u64,
    fault: Option<Fault>,
}

impl Piece {
    /// Parses up to the end of `bytes` or the first invalid line.
    fn parse(
        bytes: &[u8],
        format: Format,
        layout: &Layout,
        header: &[Vec<String>],
        columns: usize,
    ) -> Self {
        let mut piece =
            Self { rows: Block::new(columns), headers: Vec::new(), used: 0, lines: 0, fault: None };
        let mut splitter = Splitter::new(format.separator);
        let mut count = 0;
        while piece.used < bytes.len() {
            let rest = &bytes[piece.used..];
            if let Some(used) = fast_line(rest, format, layout, &mut piece.rows.columns) {
                piece.rows.count_from(count, piece.lines);
                piece.used += used;
                count += 1;
            } else {
                piece.rows.truncate(count);
                let length = rest.iter().position(|&b| b == b'\n').map_or(rest.len(), |at| at + 1);
                match general_line(
                    &rest[..length],
                    format,
                    layout,
                    &mut splitter,
                    &mut piece.rows.columns,
                ) {
                    Ok(true) => {
                        piece.rows.count_from(count, piece.lines);
                        count += 1;
                    }
                    Ok(false) => {}
                    Err(_) if is_again(header, &splitter) => {
                        piece.rows.truncate(count);
                        piece.headers.push(piece.lines);
                    }
                    Err(fault) => {
                        piece.fault = Some(fault);
                        piece.rows.truncate(count);
                        return piece;
                    }
                }
                piece.used += length;
            }
            piece.lines += 1;
        }
        piece
    }
}

/// Whether the line just split is one of those of the header.
fn is_again(header: &[Vec<String>], splitter: &Splitter) -> bool {
    let mut same = header.iter().filter(|cells| cells.len() == splitter.count());
    same.any(|cells| {
        let mut cells = cells.iter().enumerate();
        cells.all(|(k, cell)| text_of(splitter.cell(k)).trim() == cell.as_str())
    })
}

/// Whether a line holds no cells.
fn is_nothing(line: &[u8]) -> bool {
    line.trim_ascii().is_empty() || is_comment(line)
}

/// Whether a text begins as an object or an array of JSON does.
fn is_json(bytes: &[u8]) -> bool {
    let mut signs = bytes.iter().filter(|byte| !byte.is_ascii_whitespace());
    match (signs.next(), signs.next()) {
        (Some(b'{'), Some(next)) => b"\"}".contains(next),
        (Some(b'['), Some(next)) => b"{[".contains(next),
        _ => false,
    }
}

/// Lines before a header that are no comments, as some programs write them: `key<TAB>value`. `None`
/// if the first line can be the header, or the first row.
fn preamble(bytes: &[u8]) -> Option<usize> {
    let whole = bytes
        .split_inclusive(|&b| b == b'\n')
        .take(LONGEST_PREAMBLE)
        .map(|line| line.strip_suffix(b"\n").unwrap_or(line));
    let lines: Vec<&[u8]> = whole.map(|line| line.strip_suffix(b"\r").unwrap_or(line)).collect();
    lines.first()?;
    let format = Format::sniff(&lines[lines.len().saturating_sub(SNIFFED_LINES)..]);
    let mut splitter = Splitter::new(format.separator);
    // None of a comment, and of a blank line.
    let cells: Vec<Option<Vec<String>>> = lines
        .iter()
        .map(|line| (!is_nothing(line)).then(|| cells_of(&mut splitter, line)))
        .collect();
    let columns = cells.iter().flatten().next_back()?.len();
    let are_rows: Vec<bool> = cells
        .iter()
        .map(|own| own.as_ref().is_some_and(|own| is_row(own, columns, format)))
        .collect();
    let last_other = (0..cells.len()).rfind(|k| cells[*k].is_some() && !are_rows[*k]);
    let first_row = last_other.map_or(0, |last| last + 1);
    if cells[first_row..].iter().flatten().count() < ROWS_AFTER_PREAMBLE
        || are_rows[..first_row].contains(&true)
    {
        return None;
    }
    // From the first row up: units, names, and what is above them.
    let mut above = (0..first_row).rev().filter_map(|k| Some((k, cells[k].as_ref()?)));
    let (mut header, mut names) = above.next()?;
    if is_unit_row(names)
        && let Some(next) = above.next()
    {
        (header, names) = next;
    }
    let fits = names.len() == columns || names.len() == columns + 1;
    let first = cells[0].as_deref().unwrap_or_default();
    // Keys and values are two; as many names as columns are a header.
    let is_header = first.len() == columns
        && (first.iter().any(|name| columns::is_recognised(name))
            || (columns > 2
                && first
                    .iter()
                    .all(|name| !name.is_empty() && format.number(name.as_bytes()).is_none())));
    if header == 0 || is_header {
        return None;
    }
    Some(if fits { header } else { first_row })
}

/// The cells of a line of a header, or of one that may be.
fn cells_of(splitter: &mut Splitter, line: &[u8]) -> Vec<String> {
    let count = splitter.split(line);
    (0..count).map(|k| text_of(splitter.cell(k)).trim().to_owned()).collect()
}

/// Whether cells are a row: a value comes first, and not alone. A key is text.
fn is_row(cells: &[String], columns: usize, format: Format) -> bool {
    let values = cells.iter().map(|cell| {
        !cell.is_empty()
            && (format.number(cell.as_bytes()).is_some()
                || timestamp::parse(cell.as_bytes()).is_some())
    });
    cells.len() == columns
        && values.clone().next() == Some(true)
        && values.filter(|is_value| *is_value).count() > 1
}

/// Parses one plain line into `columns`: numbers, single separators, no quotes. `None` leaves the
/// line to the general path; a part of it may already have been appended.
fn fast_line(
    bytes: &[u8],
    format: Format,
    layout: &Layout,
    columns: &mut [Vec<f64>],
) -> Option<usize> {
    let Separator::Byte(separator) = format.separator else {
        return None;
    };
    if layout.origin.is_some() || format.grouped {
        return None;
    }
    let mut at = 0;
    let last = layout.slots.len().checked_sub(1)?;
    for (k, slot) in layout.slots.iter().enumerate() {
        if let Some(Slot { output, per_si }) = slot {
            // Stops at what is no part of a number: a plain line has its separator there.
            let (number, used) = fast_float2::parse_partial::<f64, _>(&bytes[at..]).ok()?;
            columns[*output].push(number / per_si);
            at += used;
        } else {
            at += bytes[at..]
                .iter()
                .position(|&b| b == separator || b == b'\n' || b == b'\r' || b == b'"')?;
        }
        match *bytes.get(at)? {
            b'\n' if k == last => {}
            b'\r' if k == last && bytes.get(at + 1) == Some(&b'\n') => at += 1,
            byte if byte == separator && k < last => {}
            _ => return None,
        }
        at += 1;
    }
    Some(at)
}

/// Parses any line into `columns`; `false` for blank and comment lines.
fn general_line(
    line: &[u8],
    format: Format,
    layout: &Layout,
    splitter: &mut Splitter,
    columns: &mut [Vec<f64>],
) -> Result<bool, Fault> {
    if is_nothing(line) {
        return Ok(false);
    }
    let line = line.strip_suffix(b"\n").unwrap_or(line);
    let found = splitter.split(line.strip_suffix(b"\r").unwrap_or(line));
    if found != layout.slots.len() {
        return Err(Fault::FieldCount(found));
    }
    for (k, slot) in layout.slots.iter().enumerate() {
        let Some(Slot { output, per_si }) = slot else { continue };
        let cell = splitter.cell(k);
        let number = match layout.origin.filter(|_| *output == Quantity::Time as usize) {
            Some(_) if cell.trim_ascii().is_empty() => Some(f64::NAN),
            Some(origin) => timestamp::parse(cell).map(|at| at.saturating_sub(origin) as f64 / 1e9),
            None => format.number(cell),
        };
        let number = number.or(layout.tolerates_text().then_some(f64::NAN));
        let number = number.ok_or_else(|| Fault::NotANumber(k, quoted(cell)))?;
        columns[*output].push(number / per_si);
    }
    Ok(true)
}

/// A part of a file in a form suitable for messages.
pub(crate) fn quoted(bytes: &[u8]) -> String {
    let text = text_of(bytes);
    let short: String = text.chars().take(QUOTED).flat_map(char::escape_debug).collect();
    if text.chars().count() > QUOTED { short + "..." } else { short }
}

/// SHA-256 of `bytes` in hexadecimal digits.
pub fn sha256(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

/// Lower-case hexadecimal.
pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
