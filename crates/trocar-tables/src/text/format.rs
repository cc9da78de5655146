//! Cell separator and decimal mark of a text file, detected from its first lines.

/// Separator between two cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Separator {
    /// This sign.
    Byte(u8),
    /// Any run of spaces and tabs.
    Whitespace,
}

/// How the cells of a text are separated, and its numbers written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Format {
    /// Between two cells.
    pub separator: Separator,
    /// Whether the decimal mark is a comma.
    pub decimal_comma: bool,
    /// Whether the mark that is not the decimal one groups thousands.
    pub grouped: bool,
}

impl Default for Format {
    fn default() -> Self {
        Separator::Byte(b',').with(false)
    }
}

impl Separator {
    const fn with(self, decimal_comma: bool) -> Format {
        Format { separator: self, decimal_comma, grouped: false }
    }
}

/// Words that other programs write for a missing number.
const MISSING: [&[u8]; 8] = [b"NA", b"N/A", b"#N/A", b"<NA>", b"null", b"None", b"-", b"--"];

/// Whether a line is a comment: the signs of Python, of MATLAB and of C.
pub fn is_comment(line: &[u8]) -> bool {
    let line = line.trim_ascii_start();
    COMMENT_SIGNS.iter().any(|sign| line.starts_with(sign))
}

/// The text of a comment line. A single slash is a part of it, such as that of a topic's name.
pub fn comment_text(line: &[u8]) -> &[u8] {
    let mut text = line.trim_ascii();
    while let Some(rest) = COMMENT_SIGNS.iter().find_map(|sign| text.strip_prefix(*sign)) {
        text = rest;
    }
    text.trim_ascii()
}

const COMMENT_SIGNS: [&[u8]; 3] = [b"#", b"%", b"//"];

/// In order of preference if several fit the lines equally well.
const CANDIDATES: [Format; 9] = [
    Separator::Byte(b';').with(false),
    Separator::Byte(b';').with(true),
    Separator::Byte(b'\t').with(false),
    Separator::Byte(b'\t').with(true),
    Separator::Byte(b'|').with(false),
    Separator::Byte(b'|').with(true),
    Separator::Byte(b',').with(false),
    Separator::Whitespace.with(false),
    Separator::Whitespace.with(true),
];

impl Format {
    /// The format under which most cells of `lines` are numbers. The first line may be a header.
    pub fn sniff(lines: &[&[u8]]) -> Self {
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
            .unwrap_or_default()
    }

    /// Splits without regard to quotes; sufficient to evaluate a format.
    fn cells(self, line: &[u8]) -> Vec<&[u8]> {
        match self.separator {
            Separator::Byte(byte) => line.split(|&b| b == byte).collect(),
            Separator::Whitespace => whitespace_cells(line).collect(),
        }
    }

    /// A number, or NaN for a missing one; `None` for text.
    #[inline]
    pub fn number(self, cell: &[u8]) -> Option<f64> {
        let cell = cell.trim_ascii();
        if cell.is_empty() || MISSING.iter().any(|word| cell.eq_ignore_ascii_case(word)) {
            return Some(f64::NAN);
        }
        let group_mark = if self.decimal_comma { b'.' } else { b',' };
        if self.grouped && cell.contains(&group_mark) {
            let plain: Vec<u8> = cell.iter().copied().filter(|b| *b != group_mark).collect();
            let ungrouped = Self { grouped: false, ..self };
            return is_grouped(cell, group_mark).then(|| ungrouped.number(&plain)).flatten();
        }
        if self.decimal_comma && cell.contains(&b',') {
            return comma_number(cell);
        }
        fast_float2::parse(cell).ok()
    }
}

/// What points and commas mean in many cells: a decimal mark, or thousands.
#[derive(Default)]
pub struct Marks {
    /// Evidence on the point and on the comma.
    of: [Mark; 2],
    /// By column, on the point and on the comma.
    columns: Vec<[Mark; 2]>,
}

/// Evidence on one mark.
#[derive(Debug, Default, Clone, Copy)]
struct Mark {
    /// A number in which it can only be the decimal mark.
    is_decimal: bool,
    /// A number in which it can only group thousands, and one in which it can.
    is_group: bool,
    may_group: bool,
    /// Three digits behind it of which the last is 0, and a whole number below a thousand without
    /// it: decimals of fixed length would show in the second, others not in the first.
    ends_in_zero: bool,
    has_small: bool,
}

const MARKS: [u8; 2] = [b'.', b','];

impl Marks {
    /// Takes in a cell; text does not count.
    pub fn add(&mut self, column: usize, cell: &[u8]) {
        let cell = cell.trim_ascii();
        if !cell.first().is_some_and(|b| b.is_ascii_digit() || b"+-.,".contains(b))
            || !cell.iter().all(|b| b.is_ascii_digit() || b"+-.,eE".contains(b))
        {
            return;
        }
        self.columns.resize(self.columns.len().max(column + 1), Default::default());
        for (k, mark) in MARKS.into_iter().enumerate() {
            let (own, all) = (&mut self.columns[column][k], &mut self.of[k]);
            let count = cell.iter().filter(|b| **b == mark).count();
            if count == 0 {
                own.has_small |= cell.len() <= 4 && cell.iter().all(|b| !MARKS.contains(b));
            } else if is_grouped(cell, mark) {
                all.is_group |= count > 1 || cell.contains(&MARKS[1 - k]);
                all.may_group = true;
                own.ends_in_zero |= cell.ends_with(b"0");
            } else if count == 1 {
                // Several that group nothing are those of a date or of a version.
                all.is_decimal = true;
            }
        }
    }

    /// Whether a number was seen in which `mark` may group thousands.
    pub fn may_group(&self, mark: char) -> bool {
        MARKS.iter().zip(self.of).any(|(own, seen)| char::from(*own) == mark && seen.may_group)
    }

    /// The format with the decimal mark that the cells prove.
    pub fn settle(&self, format: Format) -> Format {
        let are_groups = [0, 1].map(|k| {
            !self.of[k].is_decimal
                && (self.of[k].is_group
                    || self.columns.iter().any(|own| own[k].ends_in_zero && own[k].has_small))
        });
        match are_groups {
            [true, false] => Format { decimal_comma: true, grouped: true, ..format },
            [false, true] => Format { decimal_comma: false, grouped: true, ..format },
            _ => {
                // Where commas are certainly decimal, points are not, unless one of them is.
                let [points, commas] = self.of;
                let grouped = format.decimal_comma && commas.is_decimal && !points.is_decimal;
                Format { grouped, ..format }
            }
        }
    }
}

/// Whether `mark` can group the digits of a number by thousands: `-1.234.567,8` and not `0.123`.
fn is_grouped(cell: &[u8], mark: u8) -> bool {
    let digits = cell.strip_prefix(b"-").or(cell.strip_prefix(b"+")).unwrap_or(cell);
    let whole = digits.iter().position(|b| MARKS.contains(b) && *b != mark);
    let (whole, rest) = digits.split_at(whole.unwrap_or(digits.len()));
    let mut groups = whole.split(|b| *b == mark);
    let first = groups.next().unwrap_or_default();
    let is_number = |digits: &[u8]| digits.iter().all(u8::is_ascii_digit);
    let starts = matches!(first.len(), 1..=3) && is_number(first) && first[0] != b'0';
    let decimals = rest.get(1..).is_none_or(is_number);
    starts && decimals && groups.all(|group| group.len() == 3 && is_number(group))
}

pub(super) fn whitespace_cells(line: &[u8]) -> impl Iterator<Item = &[u8]> {
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
    fn thousands_are_told_from_decimals() {
        let settled = |separator: Separator, decimal_comma: bool, cells: &[&str]| {
            let mut marks = Marks::default();
            cells.iter().for_each(|cell| marks.add(0, cell.as_bytes()));
            let format = marks.settle(separator.with(decimal_comma));
            cells.iter().map(|cell| format.number(cell.as_bytes())).collect::<Vec<_>>()
        };
        let semicolon = Separator::Byte(b';');
        for (decimal_comma, cells, numbers) in [
            (false, &["987", "1.230", "-12.345"][..], &[987.0, 1230.0, -12345.0][..]),
            (true, &["1.234,5", "0,5"], &[1234.5, 0.5]),
            (true, &["0,5", "1.234"], &[0.5, 1234.0]),
            (false, &["1.234.567", "1.000"], &[1_234_567.0, 1000.0]),
            (true, &["987", "1,230", "12,345"], &[987.0, 1230.0, 12345.0]),
            (false, &["1,234.5", "7.25"], &[1234.5, 7.25]),
            // Decimals, as far as can be known.
            (false, &["0.987", "1.230", "12.345"], &[0.987, 1.23, 12.345]),
            (false, &["1.234", "12.345"], &[1.234, 12.345]),
            (true, &["1,234", "12,345"], &[1.234, 12.345]),
            (false, &["987", "1.23", "12.345"], &[987.0, 1.23, 12.345]),
            (true, &["0,5", "0.25", "1.234"], &[0.5, 0.25, 1.234]),
        ] {
            let expected: Vec<Option<f64>> = numbers.iter().map(|number| Some(*number)).collect();
            assert_eq!(settled(semicolon, decimal_comma, cells), expected, "{cells:?}");
        }
        let odd = settled(semicolon, true, &["0,5", "1.234", "1.234,5"]);
        assert_eq!(odd, [Some(0.5), Some(1234.0), Some(1234.5)]);
        // A date or a version is no number, and says nothing about points.
        let dated = settled(semicolon, true, &["22.11.2026", "0,5", "1.234,5"]);
        assert_eq!(dated[1..], [Some(0.5), Some(1234.5)]);
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
            assert_eq!(sniff(text), separator.with(decimal_comma), "{text}");
        }
    }
}
