//! Rows of numbers out of a text stream, one at a time and in constant memory.
//!
//! Plain numeric lines take a path of their own (`fast_row`); quotes, comments, blank lines, decimal commas and
//! everything wrong take the general one, which also words the errors.

use std::io::Read;

use sha2::{Digest, Sha256};

use super::columns::{Layout, Quantity, example_mapping, is_unit_row};
use super::format::{Format, Separator, whitespace_cells};
use super::{RecordingError, columns};

/// Bytes read at a time, and the longest line accepted.
const BUFFER: usize = 256 * 1024;

/// Lines looked at to find the format.
const SNIFFED_LINES: usize = 16;

/// Characters of a file quoted in a message.
const QUOTED: usize = 60;

/// One row in SI units, indexed by [`Quantity`]; NaN for columns the file lacks.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row {
    pub(crate) line: u64,
    pub(crate) values: [f64; 4],
}

impl Row {
    pub(crate) fn get(&self, quantity: Quantity) -> f64 {
        self.values[quantity as usize]
    }
}

/// Reads rows from any byte stream.
pub(crate) struct RowReader<R> {
    file: String,
    input: R,
    buffer: Vec<u8>,
    /// Next byte to parse.
    start: usize,
    /// End of the last complete line in the buffer.
    complete: usize,
    /// End of the bytes read.
    filled: usize,
    finished: bool,
    bytes_read: u64,
    /// Line number of `start`.
    line: u64,
    hash: Option<Sha256>,
    format: Format,
    layout: Layout,
    splitter: Splitter,
}

impl<R: Read> RowReader<R> {
    /// Reads up to the first row of numbers. `mapping` is the value of `--columns`.
    pub(crate) fn open(
        file: &str,
        input: R,
        mapping: Option<&str>,
        needed: &[Quantity],
        hash: bool,
    ) -> Result<Self, RecordingError> {
        let empty = Layout { names: Vec::new(), slots: Vec::new(), source: "", notes: Vec::new() };
        let layout = mapping.map_or(Ok(empty), |mapping| Layout::from_mapping(mapping, needed))?;
        let format = Format { separator: Separator::Byte(b','), decimal_comma: false };
        let mut reader = Self {
            file: file.to_owned(),
            input,
            buffer: vec![0; BUFFER],
            start: 0,
            complete: 0,
            filled: 0,
            finished: false,
            bytes_read: 0,
            line: 1,
            hash: hash.then(Sha256::new),
            format,
            layout,
            splitter: Splitter::new(format.separator),
        };
        reader.refill()?;
        reader.check_text()?;
        reader.find_columns(mapping.is_some(), needed)?;
        Ok(reader)
    }

    pub(crate) fn layout(&self) -> &Layout {
        &self.layout
    }

    /// SHA-256 of all bytes read, in hexadecimal; meaningful after the last row.
    pub(crate) fn digest(&mut self) -> String {
        self.hash.take().map(|hash| hex(&hash.finalize())).unwrap_or_default()
    }

    pub(crate) fn bytes_read(&self) -> u64 {
        self.bytes_read
    }

    /// Average bytes per line of what is in the buffer.
    pub(crate) fn bytes_per_line(&self) -> f64 {
        let bytes = &self.buffer[self.start..self.complete];
        let lines = bytes.iter().filter(|&&b| b == b'\n').count().max(1);
        bytes.len() as f64 / lines as f64
    }

    /// The next row, or `None` at the end.
    pub(crate) fn next_row(&mut self) -> Result<Option<Row>, RecordingError> {
        loop {
            if self.start == self.complete && !self.refill()? {
                return Ok(None);
            }
            let bytes = &self.buffer[self.start..self.complete];
            if let Some((values, used)) = fast_row(bytes, self.format, &self.layout) {
                let line = self.line;
                self.start += used;
                self.line += 1;
                return Ok(Some(Row { line, values }));
            }
            if let Some(row) = self.general_row()? {
                return Ok(Some(row));
            }
        }
    }

    /// Moves the unfinished line to the front and reads on until at least one line is complete.
    fn refill(&mut self) -> Result<bool, RecordingError> {
        self.buffer.copy_within(self.complete..self.filled, 0);
        self.filled -= self.complete;
        (self.start, self.complete) = (0, 0);
        while !self.finished {
            // One byte is kept for the newline that the last line may lack.
            if self.filled + 1 >= self.buffer.len() {
                return Err(RecordingError::LineTooLong { file: self.file.clone(), line: self.line, limit: BUFFER });
            }
            let space = self.buffer.len() - 1;
            let read = match self.input.read(&mut self.buffer[self.filled..space]) {
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => continue,
                Err(source) => {
                    return Err(RecordingError::Read { file: self.file.clone(), line: self.line, source });
                }
                Ok(read) => read,
            };
            let fresh = &self.buffer[self.filled..self.filled + read];
            if let Some(hash) = &mut self.hash {
                hash.update(fresh);
            }
            let newline = fresh.iter().rposition(|&b| b == b'\n').map(|at| self.filled + at + 1);
            self.filled += read;
            self.bytes_read += read as u64;
            if read == 0 {
                self.finished = true;
                if self.filled > 0 {
                    self.buffer[self.filled] = b'\n';
                    self.filled += 1;
                    self.complete = self.filled;
                }
            } else if let Some(end) = newline {
                self.complete = end;
            }
            if self.complete > 0 {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Skips a byte order mark; refuses what is not text.
    fn check_text(&mut self) -> Result<(), RecordingError> {
        let bytes = &self.buffer[..self.complete.max(self.filled)];
        let found = if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
            Some("text in UTF-16")
        } else if bytes.contains(&0) {
            Some("binary data")
        } else {
            None
        };
        if let Some(found) = found {
            return Err(RecordingError::NotText { file: self.file.clone(), found });
        }
        if bytes.starts_with(&[0xef, 0xbb, 0xbf]) {
            self.start = 3;
        }
        Ok(())
    }

    /// Finds format and columns and leaves `start` at the first row of numbers.
    fn find_columns(&mut self, mapped: bool, needed: &[Quantity]) -> Result<(), RecordingError> {
        let comment = self.skip_blank()?;
        let Some(first) = self.peek_line(0).map(<[u8]>::to_vec) else {
            return Err(RecordingError::Empty { file: self.file.clone() });
        };
        let lines: Vec<&[u8]> = (0..).map_while(|k| self.peek_line(k)).take(SNIFFED_LINES).collect();
        self.format = Format::sniff(&lines);
        self.splitter = Splitter::new(self.format.separator);
        let names = self.cells(&first);
        if self.is_header(&names) {
            return self.take_header(names, mapped, needed);
        }
        if mapped {
            return Ok(());
        }
        // Some tools write the names as the last comment above the numbers.
        let commented = comment.map(|(line, text)| (line, self.cells(&text)));
        if let Some((line, names)) = commented.filter(|(_, cells)| cells.len() == names.len())
            && let Ok(layout) = Layout::from_header(&self.file, line, names, needed)
        {
            self.layout = layout;
            return Ok(());
        }
        Err(RecordingError::NoHeader {
            file: self.file.clone(),
            line: self.line,
            found: quoted(&first),
            example: example_mapping(names.len()),
        })
    }

    /// Names need not be understood (`--columns` may say what they are), but they are not numbers.
    fn is_header(&self, cells: &[String]) -> bool {
        let numeric = |cell: &&String| !cell.is_empty() && self.format.number(cell.as_bytes()).is_some();
        cells.iter().any(|cell| columns::is_recognised(cell)) || cells.iter().filter(numeric).count() == 0
    }

    fn take_header(&mut self, mut names: Vec<String>, mapped: bool, needed: &[Quantity]) -> Result<(), RecordingError> {
        let line = self.line;
        self.skip_line();
        self.skip_blank()?;
        let second = self.peek_line(0).map(<[u8]>::to_vec);
        let units = second.map(|text| self.cells(&text)).filter(|cells| is_unit_row(cells));
        if let Some(units) = units.filter(|units| units.len() == names.len()) {
            for (name, unit) in names.iter_mut().zip(&units) {
                *name = format!("{name} {unit}");
            }
            self.skip_line();
            self.skip_blank()?;
        }
        if !mapped {
            self.layout = Layout::from_header(&self.file, line, names, needed)?;
        }
        if self.peek_line(0).is_none() {
            return Err(RecordingError::HeaderOnly { file: self.file.clone(), line });
        }
        Ok(())
    }

    /// Skips blank and comment lines; returns the last comment with its line.
    fn skip_blank(&mut self) -> Result<Option<(u64, Vec<u8>)>, RecordingError> {
        let mut comment = None;
        loop {
            if self.start == self.complete && !self.refill()? {
                return Ok(comment);
            }
            let line = self.peek_line(0).unwrap_or_default().trim_ascii();
            match line.first() {
                None => {}
                Some(b'#') => comment = Some((self.line, line[1..].trim_ascii().to_vec())),
                Some(_) => return Ok(comment),
            }
            self.skip_line();
        }
    }

    /// The `k`-th complete line in the buffer from here on, without its end.
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
    fn cells(&mut self, line: &[u8]) -> Vec<String> {
        let cells = self.splitter.split(line);
        (0..cells).map(|k| String::from_utf8_lossy(self.splitter.cell(k)).trim().to_owned()).collect()
    }

    /// One line in full generality; `None` for blank and comment lines.
    fn general_row(&mut self) -> Result<Option<Row>, RecordingError> {
        let line = self.line;
        let text = self.peek_line(0).unwrap_or_default().trim_ascii();
        if text.is_empty() || text[0] == b'#' {
            self.skip_line();
            return Ok(None);
        }
        let start = self.start;
        let end = start + self.peek_line(0).unwrap_or_default().len();
        let found = self.splitter.split(&self.buffer[start..end]);
        let expected = self.layout.slots.len();
        if found != expected {
            return Err(self.field_count(line, found)?);
        }
        let mut values = [f64::NAN; 4];
        for (k, slot) in self.layout.slots.iter().enumerate() {
            let Some(slot) = slot else { continue };
            let cell = self.splitter.cell(k);
            let number = self.format.number(cell).ok_or_else(|| self.not_a_number(line, k, cell))?;
            values[slot.quantity as usize] = number / slot.per_si;
        }
        self.skip_line();
        Ok(Some(Row { line, values }))
    }

    fn field_count(&mut self, line: u64, found: usize) -> Result<RecordingError, RecordingError> {
        self.skip_line();
        let last = self.start == self.complete && !self.refill()?;
        let hint = match self.layout.source {
            _ if last => "\n\nhint: this is the last line; was the recording cut off while it was written?",
            "--columns" => "\n\nhint: --columns names every column in order, '-' skips one",
            _ => "",
        };
        let (file, expected) = (self.file.clone(), self.layout.slots.len());
        Ok(RecordingError::FieldCount { file, line, found, expected, reference: self.layout.source, hint })
    }

    fn not_a_number(&self, line: u64, column: usize, cell: &[u8]) -> RecordingError {
        let comma = cell.contains(&b',');
        RecordingError::NotANumber {
            file: self.file.clone(),
            line,
            column: self.layout.names[column].clone(),
            found: quoted(cell),
            hint: if comma {
                "\n\nhint: decimal commas must be used throughout, without thousands separators"
            } else {
                ""
            },
        }
    }
}

/// Parses one plain line: numbers, single separators, no quotes. `None` leaves the line to the general path.
fn fast_row(bytes: &[u8], format: Format, layout: &Layout) -> Option<([f64; 4], usize)> {
    let Separator::Byte(separator) = format.separator else {
        return None;
    };
    let mut values = [f64::NAN; 4];
    let mut at = 0;
    let last = layout.slots.len().checked_sub(1)?;
    for (k, slot) in layout.slots.iter().enumerate() {
        if let Some(slot) = slot {
            let (number, used) = fast_float2::parse_partial::<f64, _>(&bytes[at..]).ok()?;
            values[slot.quantity as usize] = number / slot.per_si;
            at += used;
        } else {
            at += bytes[at..].iter().position(|&b| b == separator || b == b'\n' || b == b'\r' || b == b'"')?;
        }
        match *bytes.get(at)? {
            b'\n' if k == last => {}
            b'\r' if k == last && bytes.get(at + 1) == Some(&b'\n') => at += 1,
            byte if byte == separator && k < last => {}
            _ => return None,
        }
        at += 1;
    }
    Some((values, at))
}

/// Splits a line into cells, quotes removed.
struct Splitter {
    separator: Separator,
    reader: csv_core::Reader,
    text: Vec<u8>,
    ends: Vec<usize>,
}

impl Splitter {
    fn new(separator: Separator) -> Self {
        let delimiter = match separator {
            Separator::Byte(byte) => byte,
            Separator::Whitespace => b' ',
        };
        let reader =
            csv_core::ReaderBuilder::new().delimiter(delimiter).terminator(csv_core::Terminator::Any(b'\n')).build();
        Self { separator, reader, text: Vec::new(), ends: Vec::new() }
    }

    /// Returns the number of cells.
    fn split(&mut self, line: &[u8]) -> usize {
        self.ends.clear();
        self.text.clear();
        if self.separator == Separator::Whitespace {
            for cell in whitespace_cells(line) {
                self.text.extend_from_slice(cell);
                self.ends.push(self.text.len());
            }
            return self.ends.len();
        }
        self.reader.reset();
        self.text.resize(line.len() + 1, 0);
        self.ends.resize(line.len() + 2, 0);
        let (_, read, written, ends) = self.reader.read_record(line, &mut self.text, &mut self.ends);
        // The end of input closes the last cell, and a quote left open with it.
        let rest = self.reader.read_record(&line[read..], &mut self.text[written..], &mut self.ends[ends..]);
        rest.3 + ends
    }

    fn cell(&self, k: usize) -> &[u8] {
        let from = if k == 0 { 0 } else { self.ends[k - 1] };
        &self.text[from..self.ends[k]]
    }
}

/// A piece of a file as a message may show it.
pub(crate) fn quoted(bytes: &[u8]) -> String {
    let text = String::from_utf8_lossy(bytes);
    let short: String = text.chars().take(QUOTED).flat_map(char::escape_debug).collect();
    if text.chars().count() > QUOTED { short + "..." } else { short }
}

/// Lower-case hexadecimal.
pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
