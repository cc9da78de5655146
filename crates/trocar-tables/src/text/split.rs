//! Lines of text as cells.

use std::borrow::Cow;

use super::format::{Separator, whitespace_cells};
use super::timestamp;

/// Splits a line into cells and removes quotes.
pub struct Splitter {
    separator: Separator,
    reader: csv_core::Reader,
    text: Vec<u8>,
    ends: Vec<usize>,
    /// Cells of the last line.
    count: usize,
}

impl Splitter {
    /// For cells with this separator.
    pub fn new(separator: Separator) -> Self {
        let delimiter = match separator {
            Separator::Byte(byte) => byte,
            Separator::Whitespace => b' ',
        };
        let reader = csv_core::ReaderBuilder::new()
            .delimiter(delimiter)
            .terminator(csv_core::Terminator::Any(b'\n'))
            .build();
        Self { separator, reader, text: Vec::new(), ends: Vec::new(), count: 0 }
    }

    /// Splits a line; returns the number of its cells.
    #[inline]
    pub fn split(&mut self, line: &[u8]) -> usize {
        self.count = self.cut(line);
        self.count
    }

    fn cut(&mut self, line: &[u8]) -> usize {
        self.ends.clear();
        self.text.clear();
        if self.separator == Separator::Whitespace {
            let mut before: &[u8] = &[];
            for cell in whitespace_cells(line) {
                if timestamp::belong_together(before, cell) {
                    self.text.push(b' ');
                    self.ends.pop();
                }
                self.text.extend_from_slice(cell);
                self.ends.push(self.text.len());
                before = cell;
            }
            return self.ends.len();
        }
        self.reader.reset();
        self.text.resize(line.len() + 1, 0);
        self.ends.resize(line.len() + 2, 0);
        let (_, read, written, ends) =
            self.reader.read_record(line, &mut self.text, &mut self.ends);
        // The end of input closes the last cell, even one with an unclosed quote.
        let rest = self.reader.read_record(
            &line[read..],
            &mut self.text[written..],
            &mut self.ends[ends..],
        );
        rest.3 + ends
    }

    /// Number of cells of the last line.
    pub fn count(&self) -> usize {
        self.count
    }

    /// A cell of the last line.
    #[inline]
    pub fn cell(&self, k: usize) -> &[u8] {
        let from = if k == 0 { 0 } else { self.ends[k - 1] };
        &self.text[from..self.ends[k]]
    }
}

/// Text in UTF-8, or else in Latin-1, in which older programs write the unit µm.
pub fn text_of(bytes: &[u8]) -> Cow<'_, str> {
    std::str::from_utf8(bytes)
        .map_or_else(|_| bytes.iter().map(|byte| char::from(*byte)).collect(), Cow::Borrowed)
}
