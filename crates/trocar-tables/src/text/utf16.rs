//! Text in UTF-16 as text in UTF-8.

use std::io::{self, Read};

/// Bytes decoded at a time.
const PIECE: usize = 1 << 15;

/// Byte order marks.
pub(crate) const LITTLE_ENDIAN: [u8; 2] = [0xff, 0xfe];
pub(crate) const BIG_ENDIAN: [u8; 2] = [0xfe, 0xff];

/// Decodes a stream that begins with a byte order mark, which is left out; units that are no
/// characters become replacement characters.
pub(crate) struct Decoder<R> {
    input: R,
    from_bytes: fn([u8; 2]) -> u16,
    raw: Vec<u8>,
    /// Bytes of `raw` that are not decoded yet: less than a character.
    held: usize,
    text: Vec<u8>,
    given: usize,
    begun: bool,
}

impl<R: Read> Decoder<R> {
    pub(crate) fn new(input: R, is_little_endian: bool) -> Self {
        let from_bytes = if is_little_endian { u16::from_le_bytes } else { u16::from_be_bytes };
        Self {
            input,
            from_bytes,
            raw: vec![0; PIECE],
            held: 0,
            text: Vec::new(),
            given: 0,
            begun: false,
        }
    }

    /// Decodes the first `filled` bytes of `raw`; half a character is held for the next turn unless
    /// this is the end.
    fn decode(&mut self, filled: usize, at_end: bool) {
        (self.given, self.held) = (0, 0);
        self.text.clear();
        let units: Vec<u16> = self.raw[..filled]
            .chunks_exact(2)
            .map(|pair| (self.from_bytes)([pair[0], pair[1]]))
            .collect();
        let is_half = units.last().is_some_and(|unit| (0xd800..0xdc00).contains(unit)) && !at_end;
        let whole = units.len() - usize::from(is_half);
        for character in char::decode_utf16(units[..whole].iter().copied()) {
            let character = character.unwrap_or(char::REPLACEMENT_CHARACTER);
            if self.begun || character != '\u{feff}' {
                self.text.extend_from_slice(character.encode_utf8(&mut [0; 4]).as_bytes());
            }
            self.begun = true;
        }
        if at_end {
            if filled % 2 == 1 {
                self.text.extend_from_slice("\u{fffd}".as_bytes());
            }
            return;
        }
        self.held = filled - 2 * whole;
        self.raw.copy_within(2 * whole..filled, 0);
    }
}

impl<R: Read> Read for Decoder<R> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        while self.given == self.text.len() {
            let read = self.input.read(&mut self.raw[self.held..])?;
            if read == 0 && self.held == 0 {
                return Ok(0);
            }
            self.decode(self.held + read, read == 0);
        }
        let count = bytes.len().min(self.text.len() - self.given);
        bytes[..count].copy_from_slice(&self.text[self.given..self.given + count]);
        self.given += count;
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gives a few bytes at a time.
    struct Drip<'a>(&'a [u8], usize);

    impl Read for Drip<'_> {
        fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
            let count = self.1.min(bytes.len());
            self.0.read(&mut bytes[..count])
        }
    }

    fn decoded(bytes: &[u8], drip: usize) -> String {
        let mut text = String::new();
        Decoder::new(Drip(bytes, drip), bytes[0] == 0xff).read_to_string(&mut text).unwrap();
        text
    }

    #[test]
    fn text_is_the_same_in_both_orders_however_it_arrives() {
        let text = "time_s,Größe 𝄞\n0.1,2\n".repeat(3000);
        let units: Vec<u16> = std::iter::once(0xfeff).chain(text.encode_utf16()).collect();
        let little: Vec<u8> = units.iter().flat_map(|unit| unit.to_le_bytes()).collect();
        let big: Vec<u8> = units.iter().flat_map(|unit| unit.to_be_bytes()).collect();
        for drip in [1, 3, 1000, PIECE] {
            assert_eq!(decoded(&little, drip), text);
            assert_eq!(decoded(&big, drip), text);
        }
    }

    #[test]
    fn what_is_no_character_is_replaced() {
        assert_eq!(decoded(&[0xff, 0xfe, b'a', 0, b'b'], 2), "a\u{fffd}");
        assert_eq!(decoded(&[0xff, 0xfe, 0x00, 0xd8, b'a', 0], 2), "\u{fffd}a");
        assert_eq!(decoded(&[0xff, 0xfe, 0x00, 0xd8], 1), "\u{fffd}");
    }
}
