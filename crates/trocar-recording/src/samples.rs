//! The samples of a recording while it is read, with the line of each.

use std::ops::{Deref, Range};

use super::Location;
use super::recording::Readings;
use super::units::Quantity;

/// The columns of a recording with the line of every sample.
#[derive(Debug, Default)]
pub(super) struct Columns {
    pub(super) readings: Readings,
    pub(super) lines: Lines,
}

impl Deref for Columns {
    type Target = Readings;

    fn deref(&self) -> &Readings {
        &self.readings
    }
}

impl Columns {
    /// All that there are, with their quantities.
    pub(super) fn all_mut(&mut self) -> impl Iterator<Item = (Quantity, &mut Vec<f64>)> {
        let all = Quantity::ALL.into_iter().zip(self.readings.columns_mut());
        all.filter_map(|(quantity, own)| Some((quantity, own?)))
    }
}

/// Unit in which positions are counted.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Count {
    /// Lines of a text, from 1.
    #[default]
    Lines,
    /// Rows of a table, from 1.
    Rows,
    /// Samples without a file, from 0.
    Samples,
}

impl Count {
    pub(crate) fn place(self, number: u64) -> Location {
        match self {
            Self::Lines => Location::Line(number),
            Self::Rows => Location::Row(number),
            Self::Samples => Location::Sample(number as usize),
        }
    }

    pub(super) fn unit(self) -> &'static str {
        match self {
            Self::Lines => "line",
            Self::Rows => "row",
            Self::Samples => "sample",
        }
    }
}

/// Line numbers, stored only where they are not consecutive.
#[derive(Debug, Default)]
pub(super) struct Lines {
    pub(super) count: Count,
    /// Sample and its line, wherever lines were omitted before it.
    jumps: Vec<(usize, u64)>,
}

impl Lines {
    pub(super) fn counting(count: Count) -> Self {
        Self { count, jumps: Vec::new() }
    }

    pub(super) fn push(&mut self, index: usize, line: u64) {
        if self.of(index) != line {
            self.jumps.push((index, line));
        }
    }

    pub(super) fn of(&self, index: usize) -> u64 {
        let at = self.jumps.partition_point(|&(first, _)| first <= index);
        let (first, line) = at.checked_sub(1).map_or((0, 0), |at| self.jumps[at]);
        line + (index - first) as u64
    }

    /// The line numbers of the samples in `kept`, which become contiguous.
    pub(super) fn keep(&mut self, kept: &[Range<usize>]) {
        let old = std::mem::take(&mut self.jumps);
        let old = Self { count: self.count, jumps: old };
        let mut next = 0;
        for range in kept {
            let inside = old.jumps.iter().filter(|(first, _)| range.contains(first));
            let starts = std::iter::once(range.start).chain(inside.map(|(first, _)| *first));
            starts.for_each(|sample| self.push(next + sample - range.start, old.of(sample)));
            next += range.len();
        }
    }

    pub(super) fn place(&self, index: usize) -> Location {
        self.count.place(self.of(index))
    }
}
