//! Cell separator and decimal mark of a text file, detected from its first lines.

/// Separator between two cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Separator {
    Byte(u8),
    /// Any run of spaces and tabs.
    Whitespace,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Format {
    pub(crate) separator: Separator,
    pub(crate) decimal_comma: bool,
}

/// Words that other programs write for a missing number.
const MISSING: [&[u8]; 8] = [b"NA", b"N/A", b"#N/A", b"<NA>", b"null", b"None", b"-", b"--"];

/// Whether a line is a comment: the signs of Python, of MATLAB and of C.
pub(crate) fn is_comment(line: &[u8]) -> bool {
    let line = line.trim_ascii_start();
    COMMENT_SIGNS.iter().any(|sign| line.starts_with(sign))
}

/// The text of a comment line. A single slash is a part of it, such as that of a topic's name.
pub(crate) fn comment_text(line: &[u8]) -> &[u8] {
    let mut text = line.trim_ascii();
    while let Some(rest) = COMMENT_SIGNS.iter().find_map(|sign| text.strip_prefix(*sign)) {
        text = rest;
    }
    text.trim_ascii()
}

const COMMENT_SIGNS: [&[u8]; 3] = [b"#", b"%", b"//"];

/// In order of preference if several fit the lines equally well.
const CANDIDATES: [Format; 9] = [
    Format { separator: Separator::Byte(b';'), decimal_comma: false },
    Format { separator: Separator::Byte(b';'), decimal_comma: true },
    Format { separator: Separator::Byte(b'\t'), decimal_comma: false },
    Format { separator: Separator::Byte(b'\t'), decimal_comma: true },
    Format { separator: Separator::Byte(b'|'), decimal_comma: false },
    Format { separator: Separator::Byte(b'|'), decimal_comma: true },
    Format { separator: Separator::Byte(b','), decimal_comma: false },
    Format { separator: Separator::Whitespace, decimal_comma: false },
    Format { separator: Separator::Whitespace, decimal_comma: true },
];

impl Format {
    /// The format under which most cells of `lines` are numbers. The first line may be a header.
    pub(crate) fn sniff(lines: &[&[u8]]) -> Self {
        let rows = if lines.len() > 1 { &lines[1..] } else { lines };
        let by_numbers = best(|format| score(format, rows));
        by_numbers
            .or_else(|| {
                best(|format| {
                    (
                        0,
                        format
                            .cells(lines.first().copied().unwrap_or_default())
                            .len()
                            .saturating_sub(1),
                    )
                })
            })
            .unwrap_or(Format { separator: Separator::Byte(b','), decimal_comma: false })
    }

    /// Splits without regard to quotes; sufficient to evaluate a format.
    fn cells(self, line: &[u8]) -> Vec<&[u8]> {
        match self.separator {
            Separator::Byte(byte) => line.split(|&b| b == byte).collect(),
            Separator::Whitespace => whitespace_cells(line).collect(),
        }
    }

    /// A number, or NaN for a missing one; `None` for text.
    pub(crate) fn number(self, cell: &[u8]) -> Option<f64> {
        let cell = cell.trim_ascii();
        if cell.is_empty() || MISSING.iter().any(|word| cell.eq_ignore_ascii_case(word)) {
            return Some(f64::NAN);
        }
        if self.decimal_comma && cell.contains(&b',') {
            return comma_number(cell);
        }
        fast_float2::parse(cell).ok()
    }
}

pub(crate) fn whitespace_cells(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(|&b| b == b' ' || b == b'\t').filter(|cell| !cell.is_empty())
}

/// `1,5` with digits on both sides of one comma: neither a list (`1,`) nor thousands (`1,000.5`).
fn comma_number(cell: &[u8]) -> Option<f64> {
    let mut digits = [0_u8; 64];
    let digits = digits.get_mut(..cell.len())?;
    digits.copy_from_slice(cell);
    let comma = cell.iter().position(|&b| b == b',')?;
    digits[comma] = b'.';
    let whole =
        comma > 0 && cell[comma - 1].is_ascii_digit() && cell.get(comma + 1)?.is_ascii_digit();
    whole.then(|| fast_float2::parse(&*digits).ok()).flatten()
}

/// Number of rows that consist only of numbers, and total number of numbers.
fn score(format: Format, rows: &[&[u8]]) -> (usize, usize) {
    let mut score = (0, 0);
    for row in rows {
        let cells = format.cells(row);
        if cells.len() < 2 {
            continue;
        }
        let unquoted = cells.iter().map(|cell| cell.trim_ascii()).map(|cell| {
            cell.strip_prefix(b"\"").and_then(|cell| cell.strip_suffix(b"\"")).unwrap_or(cell)
        });
        let numbers = unquoted.filter(|cell| format.number(cell).is_some()).count();
        score.0 += usize::from(numbers == cells.len());
        score.1 += numbers;
    }
    score
}

/// The first candidate with the largest score, if any is above zero.
fn best(score: impl Fn(Format) -> (usize, usize)) -> Option<Format> {
    let mut best = ((0, 0), None);
    for format in CANDIDATES {
        let score = score(format);
        if score > best.0 {
            best = (score, Some(format));
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sniff(text: &str) -> Format {
        Format::sniff(&text.lines().map(str::as_bytes).collect::<Vec<_>>())
    }

    #[test]
    fn blank_lines_have_some_format() {
        for text in ["", "  ", "\n", "\n  \n\t"] {
            assert!(!sniff(text).decimal_comma, "{text:?}");
        }
    }

    #[test]
    fn separator_and_decimals_are_told_from_the_numbers() {
        for (text, separator, decimal_comma) in [
            ("a,b\n1,2", Separator::Byte(b','), false),
            ("a, b, c\n1, 2, 3", Separator::Byte(b','), false),
            ("time [s];position, mm\n0,001;0,004", Separator::Byte(b';'), true),
            ("a\tb\n1.5\t2.5", Separator::Byte(b'\t'), false),
            ("a|b\n1.5|2.5", Separator::Byte(b'|'), false),
            ("a b\n  1.5   2.5", Separator::Whitespace, false),
            ("a b\n1,5 2,5", Separator::Whitespace, true),
            ("\"a\";\"b\"\n\"1,5\";\"2\"", Separator::Byte(b';'), true),
            ("a,b,status\n1.5,2.5,ok", Separator::Byte(b','), false),
        ] {
            assert_eq!(sniff(text), Format { separator, decimal_comma }, "{text}");
        }
    }
}
