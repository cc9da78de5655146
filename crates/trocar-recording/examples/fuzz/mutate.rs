//! Changes of a sample, drawn from a seed.

use std::ops::Range;

use crate::samples::{Kind, Sample};

/// Longest input: changes that repeat parts of it stop here.
const LONGEST: usize = 1 << 20;

/// Whole numbers that overwrite lengths, counts and types.
const WHOLE: [u64; 14] = [
    0,
    1,
    2,
    7,
    0x7f,
    0x80,
    0xff,
    0x7fff,
    0xffff,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    0x7fff_ffff_ffff_ffff,
    0xffff_ffff_ffff_ffff,
];

/// Cells that replace numbers in text.
const CELLS: [&str; 24] = [
    "",
    "0",
    "-0",
    "1e308",
    "-1e308",
    "1e309",
    "5e-324",
    "1e-400",
    "nan",
    "inf",
    "-Infinity",
    "99999999999999999999999999",
    "9007199254740993",
    "0.1e1000000",
    "1,5",
    "1;5",
    "\"",
    "\"\"",
    "0x10",
    "1_000",
    "+1",
    "1e",
    "-",
    "\u{fffd}\u{1f600}",
];

/// Bytes that mean something in text.
const MARKS: &[u8] = b",;\t \r\n\"'#\0\xff\xef\xbb\xbf-+.eE%=[]";

/// Random numbers: the same on every machine.
pub(crate) struct Random(u64);

impl Random {
    /// The numbers of one `purpose` for one input.
    pub(crate) fn new(seed: u64, number: u64, purpose: u64) -> Self {
        let mut random = Self(
            seed.wrapping_mul(0x9e37_79b9_7f4a_7c15)
                ^ number.rotate_left(24)
                ^ purpose.rotate_left(56),
        );
        random.next();
        random
    }

    /// The generator splitmix64.
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let a = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let b = (a ^ (a >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        b ^ (b >> 31)
    }

    /// A number below `end`; 0 if that is 0.
    pub(crate) fn below(&mut self, end: usize) -> usize {
        (self.next() % (end as u64).max(1)) as usize
    }

    fn one<T: Copy>(&mut self, of: &[T]) -> T {
        of[self.below(of.len())]
    }
}

/// Changes one file of `sample` in one to six places; `other` lends bytes.
pub(crate) fn mutate(sample: &mut Sample, other: &Sample, random: &mut Random) {
    // Compressed text is damaged before or after.
    if random.below(2) == 0 {
        sample.compress();
    }
    let is_text = sample.kind != Kind::Bytes;
    let at = random.below(sample.files.len());
    let bytes = &mut sample.files[at].1;
    let most = 1 + random.below(6);
    for _ in 0..1 + random.below(most) {
        if is_text && random.below(4) > 0 {
            change_text(bytes, random);
        } else {
            change_bytes(bytes, &other.files[0].1, random);
        }
    }
    bytes.truncate(LONGEST);
    sample.compress();
}

/// A place: near the start, near the end, or anywhere, since headers are at the ends.
fn place(length: usize, random: &mut Random) -> usize {
    let near = random.below(length.min(600));
    match random.below(3) {
        0 => near,
        1 => length.saturating_sub(1 + near),
        _ => random.below(length),
    }
}

/// A part of up to `most` bytes.
fn part(length: usize, most: usize, random: &mut Random) -> Range<usize> {
    let from = place(length, random);
    let size = 1 << random.below(20);
    from..from + random.below(most.min(size).min(length - from) + 1)
}

fn change_bytes(bytes: &mut Vec<u8>, other: &[u8], random: &mut Random) {
    if bytes.is_empty() {
        bytes.extend_from_slice(&other[..other.len().min(100)]);
        return;
    }
    let at = place(bytes.len(), random);
    match random.below(9) {
        0 => bytes[at] ^= 1 << random.below(8),
        1 => bytes[at] = random.below(256) as u8,
        2 | 3 => overwrite(bytes, at, random),
        4 => bytes.truncate(at),
        5 => drop(bytes.drain(part(bytes.len(), usize::MAX, random))),
        6 => {
            let block = bytes[part(bytes.len(), 4096, random)].to_vec();
            let times = 1 + random.below(64);
            bytes.splice(at..at, block.repeat(times));
        }
        7 => {
            let block = bytes[part(bytes.len(), usize::MAX, random)].to_vec();
            let end = bytes.len().min(at + block.len());
            bytes.splice(at..end, block);
        }
        _ => {
            let from = random.below(other.len() + 1);
            bytes.truncate(at);
            bytes.extend_from_slice(&other[from..]);
        }
    }
}

/// Overwrites a whole number of 1 to 8 bytes by an extreme one, by one near the length of the file,
/// or by one near its own.
fn overwrite(bytes: &mut [u8], at: usize, random: &mut Random) {
    let size = random.one(&[1, 2, 4, 4, 8, 8]);
    let at = if random.below(2) == 0 { at } else { at / size * size };
    let length = bytes.len() as u64;
    let Some(place) = bytes.get_mut(at..at + size) else { return };
    let mut old = [0; 8];
    old[..size].copy_from_slice(place);
    let old = u64::from_le_bytes(old);
    let new = match random.below(4) {
        0 | 1 => random.one(&WHOLE),
        2 => length.wrapping_add(random.below(9) as u64).wrapping_sub(4),
        _ => old.wrapping_add(random.below(9) as u64).wrapping_sub(4),
    };
    let mut new = new.to_le_bytes();
    if random.below(4) == 0 {
        new[..size].reverse();
    }
    place.copy_from_slice(&new[..size]);
}

fn change_text(bytes: &mut Vec<u8>, random: &mut Random) {
    let at = place(bytes.len(), random);
    match random.below(6) {
        0..3 => {
            let cell = cell(bytes, at);
            bytes.splice(cell, random.one(&CELLS).bytes());
        }
        3 => {
            let mark = random.one(MARKS);
            let most = random.one(&[1, 4, 20]);
            bytes.splice(at..at, std::iter::repeat_n(mark, 1 << random.below(most)));
        }
        4 => drop(bytes.drain(line(bytes, at))),
        _ => {
            let (from, to) = (line(bytes, at), line(bytes, place(bytes.len(), random)));
            let copied = bytes[from].to_vec();
            bytes.splice(to.start..to.start, copied);
        }
    }
}

/// The number at a place, or an empty range.
fn cell(bytes: &[u8], at: usize) -> Range<usize> {
    let inside = |byte: &&u8| byte.is_ascii_alphanumeric() || b"+-._".contains(byte);
    let before = bytes[..at].iter().rev().take_while(inside).count();
    let after = bytes[at..].iter().take_while(inside).count();
    at - before..at + after
}

/// The line at a place, with its end.
fn line(bytes: &[u8], at: usize) -> Range<usize> {
    let start = bytes[..at].iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1);
    let length =
        bytes[at..].iter().position(|&byte| byte == b'\n').map_or(bytes.len() - at, |end| end + 1);
    start..at + length
}
