//! Tables as text, compressed or not.

use std::borrow::Cow;
use std::io::{self, Write};

#[cfg(feature = "gzip")]
use flate2::{Compression, write::GzEncoder};

use super::{Column, Field, Format};
use crate::line::Line;
use crate::output::AtomicFile;

/// Takes half the time of the default 6 and a few percent more bytes.
#[cfg(feature = "gzip")]
const GZIP_LEVEL: u32 = 4;

#[cfg(feature = "zstd")]
const ZSTD_LEVEL: i32 = 3;

pub(super) struct Writer {
    sink: Box<dyn Sink>,
    line: Line,
    /// Text of a missing number.
    pub(super) missing: &'static str,
}

/// A file that may be compressed.
trait Sink: Write + Send {
    /// The file, with all that was written.
    fn finish(self: Box<Self>) -> io::Result<AtomicFile>;
}

impl Sink for AtomicFile {
    fn finish(self: Box<Self>) -> io::Result<AtomicFile> {
        Ok(*self)
    }
}

#[cfg(feature = "gzip")]
impl Sink for GzEncoder<AtomicFile> {
    fn finish(self: Box<Self>) -> io::Result<AtomicFile> {
        (*self).finish()
    }
}

#[cfg(feature = "zstd")]
impl Sink for zstd::Encoder<'static, AtomicFile> {
    fn finish(self: Box<Self>) -> io::Result<AtomicFile> {
        (*self).finish()
    }
}

impl Writer {
    pub(super) fn new(file: AtomicFile, format: Format, fields: &[Field]) -> io::Result<Self> {
        let sink: Box<dyn Sink> = match format {
            #[cfg(feature = "gzip")]
            Format::CsvGzip => Box::new(GzEncoder::new(file, Compression::new(GZIP_LEVEL))),
            #[cfg(feature = "zstd")]
            Format::CsvZstd => Box::new(zstd::Encoder::new(file, ZSTD_LEVEL)?),
            _ => Box::new(file),
        };
        let mut writer = Self { sink, line: Line::default(), missing: "" };
        for field in fields {
            writer.line.word(&quoted(&harmless(&field.name)));
        }
        writer.line.finish(&mut writer.sink)?;
        writer.line.flush(&mut writer.sink)?;
        Ok(writer)
    }

    pub(super) fn write(&mut self, columns: &[Column]) -> io::Result<()> {
        for row in 0..columns.first().map_or(0, Column::len) {
            columns.iter().for_each(|column| cell(&mut self.line, column, row, self.missing));
            self.line.finish(&mut self.sink)?;
        }
        self.line.flush(&mut self.sink)
    }

    pub(super) fn flush(&mut self) -> io::Result<()> {
        self.sink.flush()
    }

    pub(super) fn finish(self) -> io::Result<AtomicFile> {
        self.sink.finish()
    }
}

fn cell(line: &mut Line, column: &Column, row: usize, missing: &str) {
    match column {
        Column::Number(cells) if cells[row].is_nan() => line.word(missing),
        Column::Number(cells) => line.number(cells[row]),
        Column::Integer(cells) => {
            line.word(&cells[row].map(|cell| cell.to_string()).unwrap_or_default())
        }
        Column::Boolean(cells) => {
            line.word(cells[row].map_or("", |cell| if cell { "true" } else { "false" }))
        }
        Column::Text(cells) => {
            line.word(&quoted(&harmless(cells[row].as_deref().unwrap_or_default())))
        }
    };
}

/// Whether a spreadsheet executes a text as a formula, once the apostrophes before it are gone.
fn is_formula(text: &str) -> bool {
    text.trim_start_matches('\'').starts_with(['=', '+', '-', '@', '\t', '\r', '\n'])
        && text.parse::<f64>().is_err()
}

/// The text with an apostrophe before it if a spreadsheet would execute it as a formula.
fn harmless(text: &str) -> Cow<'_, str> {
    if is_formula(text) { format!("'{text}").into() } else { text.into() }
}

/// The text that became `cell` in a CSV table of results.
pub fn original(cell: &str) -> &str {
    cell.strip_prefix('\'').filter(|text| is_formula(text)).unwrap_or(cell)
}

fn quoted(text: &str) -> Cow<'_, str> {
    match text.contains([',', '"', '\n', '\r']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")).into(),
        false => text.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_spreadsheet_would_execute_is_harmless_and_can_be_read_back() {
        let starts = ["=", "+", "-", "@", "\t", "\r", "\n", "'", "''=", "'a", "a", ""];
        for text in starts.map(|start| format!("{start}cmd|' /C calc'!A0")) {
            let written = harmless(&text);
            assert!(!written.starts_with(['=', '+', '-', '@', '\t', '\r', '\n']), "{written:?}");
            assert_eq!(original(&written), text);
        }
        for number in ["-0.3", "+1e3", "-inf", "3"] {
            assert_eq!((harmless(number).as_ref(), original(number)), (number, number));
        }
    }
}
