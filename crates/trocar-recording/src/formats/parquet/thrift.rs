//! A check of the footer and of the page headers before they are parsed: the parser believes the
//! length of a list whose elements take no bytes, and would count to two thousand million.

/// Deepest nesting, as in the parser.
const DEEPEST: u8 = 64;

/// Whether no list of the struct that begins `bytes` (Thrift compact protocol) states more than
/// `most` elements; what follows after the end of `bytes` or after a fault is not checked.
pub(super) fn lists_fit(bytes: &[u8], most: u64) -> bool {
    const STRUCT: u8 = 12;
    !matches!(Walk { bytes, most }.value(STRUCT, DEEPEST), Err(Stop::TooMany))
}

/// Whether `bytes` begin as page headers do: with the type of the page, one of four, and its size,
/// each a 32-bit number.
pub(super) fn is_page_header(bytes: &[u8]) -> bool {
    const NUMBER: u8 = 0x15;
    matches!(bytes, [NUMBER, 0 | 2 | 4 | 6, NUMBER, ..])
}

enum Stop {
    /// The bytes end, or are no Thrift.
    End,
    TooMany,
}

struct Walk<'a> {
    bytes: &'a [u8],
    most: u64,
}

impl Walk<'_> {
    fn byte(&mut self) -> Result<u8, Stop> {
        let (byte, rest) = self.bytes.split_first().ok_or(Stop::End)?;
        self.bytes = rest;
        Ok(*byte)
    }

    fn number(&mut self) -> Result<u64, Stop> {
        let mut number = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            number |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return Ok(number);
            }
        }
        Err(Stop::End)
    }

    fn pass(&mut self, count: u64) -> Result<(), Stop> {
        let rest = usize::try_from(count).ok().and_then(|count| self.bytes.get(count..));
        self.bytes = rest.ok_or(Stop::End)?;
        Ok(())
    }

    /// Passes a value of a type.
    fn value(&mut self, kind: u8, depth: u8) -> Result<(), Stop> {
        let depth = depth.checked_sub(1).ok_or(Stop::End)?;
        match kind {
            1 | 2 => Ok(()),
            3 => self.pass(1),
            4..=6 => self.number().map(drop),
            7 => self.pass(8),
            8 => self.number().and_then(|length| self.pass(length)),
            9 | 10 => {
                let head = self.byte()?;
                let count = if head >> 4 == 15 { self.number()? } else { u64::from(head >> 4) };
                self.elements(count, &[head & 15], depth)
            }
            11 => match self.number()? {
                0 => Ok(()),
                count => self
                    .byte()
                    .and_then(|kinds| self.elements(count, &[kinds >> 4, kinds & 15], depth)),
            },
            12 => loop {
                let head = self.byte()?;
                if head & 15 == 0 {
                    return Ok(());
                }
                if head >> 4 == 0 {
                    self.number()?;
                }
                self.value(head & 15, depth)?;
            },
            13 => self.pass(16),
            _ => Err(Stop::End),
        }
    }

    fn elements(&mut self, count: u64, kinds: &[u8], depth: u8) -> Result<(), Stop> {
        if count > self.most {
            return Err(Stop::TooMany);
        }
        for _ in 0..count {
            kinds.iter().try_for_each(|kind| self.value(*kind, depth))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_are_no_page_header() {
        assert!(is_page_header(&[0x15, 0x00, 0x15, 0x80, 0x7d]));
        assert!(
            !is_page_header(&[0x15, 0x08, 0x15])
                && !is_page_header(&[0x02, 0x00, 0x00])
                && !is_page_header(&[0x15])
        );
    }

    #[test]
    fn a_list_longer_than_the_file_is_found() {
        // Field 1 is a list of fifteen Booleans or more, here of 2^31 - 1; field 2 of three.
        let endless = [0x19, 0xf1, 0xff, 0xff, 0xff, 0xff, 0x07, 0x00];
        assert!(!lists_fit(&endless, 1000));
        assert!(!lists_fit(&[&[0x19, 0x31][..], &endless].concat(), 1000));
        assert!(lists_fit(&[0x19, 0x31, 0x00], 1000));
        assert!(lists_fit(&endless[..3], 1000), "cut off: the parser will see");
    }
}
