//! Lines of CSV on their way out.

use std::io::Write;

/// Lines of CSV, formatted into a reusable buffer that is handed on in large pieces.
#[derive(Default)]
pub(crate) struct Line {
    bytes: Vec<u8>,
    digits: zmij::Buffer,
}

impl Line {
    /// Bytes collected before they are handed on.
    const PIECE: usize = 1 << 16;

    /// Appends a number and a comma.
    pub(crate) fn number(&mut self, value: f64) -> &mut Self {
        self.bytes.extend_from_slice(self.digits.format(value).as_bytes());
        self.bytes.push(b',');
        self
    }

    /// Appends a word and a comma.
    pub(crate) fn word(&mut self, word: &str) -> &mut Self {
        self.bytes.extend_from_slice(word.as_bytes());
        self.bytes.push(b',');
        self
    }

    /// Ends the line in place of the last comma.
    pub(crate) fn finish(&mut self, output: &mut impl Write) -> std::io::Result<()> {
        if let Some(last) = self.bytes.last_mut() {
            *last = b'\n';
        }
        if self.bytes.len() >= Self::PIECE { self.flush(output) } else { Ok(()) }
    }

    /// Hands on what is left.
    pub(crate) fn flush(&mut self, output: &mut impl Write) -> std::io::Result<()> {
        output.write_all(&self.bytes)?;
        self.bytes.clear();
        Ok(())
    }
}
