//! Collects rows into the columns of a recording, or into excerpts of one with too many samples.

use std::ops::Range;

use super::RecordingError;
use super::block::{Block, SampleRow};
use super::quality::{Quality, RowList};
use super::samples::{Columns, Count, Lines, Readings};
use super::screen;
use super::units::Quantity;

/// Rows in an excerpt: a minute at 1 kHz, so several strokes of a slow protocol.
const EXCERPT: usize = 1 << 16;

/// Collects rows into columns.
pub(super) struct Collector {
    columns: Columns,
    non_finite: RowList,
    excerpts: Excerpts,
}

/// Rows kept once there are too many: one of every 2^level excerpts, chosen by a fixed rule from
/// their numbers alone. The choice thus depends neither on the block sizes nor on the total number
/// of rows.
struct Excerpts {
    most: usize,
    level: u32,
    /// Finite rows seen.
    seen: u64,
    /// Index of each excerpt held, in order; all but the last are complete.
    held: Vec<u64>,
}

impl Excerpts {
    /// Whether excerpt `number` represents its group: from the top down, each half of a group has
    /// the same probability.
    fn keeps(&self, number: u64) -> bool {
        let group = number >> self.level;
        let chosen =
            (1..=self.level).rev().fold(group, |group, level| 2 * group + coin(group, level));
        chosen == number
    }
}

/// 0 or 1, without a pattern that could coincide with a periodic protocol: the finaliser of
/// SplitMix64 [STEELE].
fn coin(group: u64, level: u32) -> u64 {
    let mut z =
        group.wrapping_mul(64).wrapping_add(u64::from(level)).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    (z ^ (z >> 31)) & 1
}

/// Most rows held for a limit of `most`: an excerpt is the smallest unit that can be dropped.
pub(super) fn held(most: Option<usize>) -> usize {
    most.map_or(usize::MAX, |most| most.max(2 * EXCERPT))
}

impl Collector {
    /// For about `capacity` rows; if there are more than `most`, excerpts.
    pub(super) fn new(
        capacity: usize,
        has: impl Fn(Quantity) -> bool,
        most: Option<usize>,
    ) -> Self {
        let columns = Quantity::ALL.map(|own| has(own).then(|| Vec::with_capacity(capacity)));
        let columns = Columns { readings: Readings::from(columns), lines: Lines::default() };
        let excerpts = Excerpts { most: held(most), level: 0, seen: 0, held: Vec::new() };
        Self { columns, non_finite: RowList::default(), excerpts }
    }

    /// Counts positions in messages in units of `count`.
    pub(super) fn counting(mut self, count: Count) -> Self {
        self.columns.lines = Lines::counting(count);
        self
    }

    /// Samples held.
    pub(super) fn len(&self) -> usize {
        self.columns.time.len()
    }

    pub(super) fn take(&mut self, block: &Block) {
        let columns: Vec<Quantity> = self.columns.all_mut().map(|(quantity, _)| quantity).collect();
        let fits = self.excerpts.level == 0 && self.len() + block.len() <= self.excerpts.most;
        if !fits
            || !columns
                .iter()
                .all(|quantity| block.columns[*quantity as usize].iter().all(|x| x.is_finite()))
        {
            return (0..block.len()).for_each(|row| self.add(block.row(row)));
        }
        let before = self.len();
        self.excerpts.seen += block.len() as u64;
        self.excerpts.held = (0..self.excerpts.seen.div_ceil(EXCERPT as u64)).collect();
        block.lines.iter().for_each(|&(first, line)| self.columns.lines.push(before + first, line));
        for (quantity, own) in self.columns.all_mut() {
            own.extend_from_slice(&block.columns[quantity as usize]);
        }
    }

    pub(super) fn add(&mut self, row: SampleRow) {
        if !self.columns.all_mut().all(|(quantity, _)| row.get(quantity).is_finite()) {
            self.non_finite.add(row.line);
            return;
        }
        if !self.is_in_an_excerpt() {
            return;
        }
        let columns = &mut self.columns;
        columns.lines.push(columns.time.len(), row.line);
        columns.all_mut().for_each(|(quantity, own)| own.push(row.get(quantity)));
    }

    /// Counts a row; returns whether it is kept.
    fn is_in_an_excerpt(&mut self) -> bool {
        let number = self.excerpts.seen / EXCERPT as u64;
        let begins = self.excerpts.seen.is_multiple_of(EXCERPT as u64);
        self.excerpts.seen += 1;
        if begins && self.excerpts.keeps(number) {
            self.excerpts.held.push(number);
        }
        // Only a row beyond the limit triggers thinning, regardless of the block sizes.
        if self.excerpts.held.last() == Some(&number) && self.len() == self.excerpts.most {
            self.thin();
        }
        self.excerpts.held.last() == Some(&number)
    }

    /// Drops half of the excerpts held.
    fn thin(&mut self) {
        self.excerpts.level += 1;
        let all = std::mem::take(&mut self.excerpts.held);
        let kept: Vec<usize> = (0..all.len()).filter(|k| self.excerpts.keeps(all[*k])).collect();
        let held = self.len();
        let ranges: Vec<Range<usize>> = kept
            .iter()
            .map(|k| k * EXCERPT..((k + 1) * EXCERPT).min(held))
            .filter(|range| !range.is_empty())
            .collect();
        self.excerpts.held = kept.iter().map(|k| all[*k]).collect();
        self.columns.lines.keep(&ranges);
        for (_, column) in self.columns.all_mut() {
            for (k, range) in ranges.iter().enumerate() {
                column.copy_within(range.clone(), k * EXCERPT);
            }
            column.truncate(ranges.iter().map(Range::len).sum());
        }
    }

    pub(super) fn finish(
        self,
        file: &str,
        sensor_limit: Option<f64>,
    ) -> Result<(Columns, Quality), RecordingError> {
        let starts: Vec<f64> = match self.excerpts.level {
            0 => Vec::new(),
            _ => self.columns.time.iter().copied().step_by(EXCERPT).skip(1).collect(),
        };
        let note = (self.excerpts.level > 0).then(|| {
            format!(
                "{} rows are more than are held at once: {} of them taken, in {} excerpts of {EXCERPT} rows spread over the file",
                self.excerpts.seen,
                self.columns.time.len(),
                self.excerpts.held.len()
            )
        });
        let (columns, mut quality) =
            screen::screen(file, self.columns, self.non_finite, sensor_limit, &starts)?;
        quality.notes.extend(note);
        Ok((columns, quality))
    }
}
