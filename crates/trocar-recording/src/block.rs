//! Blocks of rows in SI units: the output of file readers.

use super::units::Quantity;

/// Consecutive rows, column by column. All columns that the file has are of equal length, the
/// others are empty.
#[derive(Debug, Default)]
pub struct Block {
    /// Numbers by index of the column: a [`Quantity`], or the reader's own order. NaN for an empty
    /// cell.
    pub columns: Vec<Vec<f64>>,
    /// First row and its line, wherever the line numbers are not consecutive.
    pub(crate) lines: Vec<(usize, u64)>,
}

/// One row in SI units, indexed by [`Quantity`]; NaN for columns that the file does not have.
#[derive(Debug, Clone, Copy)]
pub struct SampleRow {
    /// Line of a text, or row of a table.
    pub line: u64,
    /// The values, in SI units.
    pub values: [f64; Quantity::ALL.len()],
}

impl SampleRow {
    /// The value of one quantity.
    pub fn get(&self, quantity: Quantity) -> f64 {
        self.values[quantity as usize]
    }
}

impl Block {
    /// An empty block with `columns` columns.
    pub fn new(columns: usize) -> Self {
        Self { columns: vec![Vec::new(); columns], lines: Vec::new() }
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.columns.iter().map(Vec::len).max().unwrap_or(0)
    }

    /// Removes all rows.
    pub fn clear(&mut self) {
        self.columns.iter_mut().for_each(Vec::clear);
        self.lines.clear();
    }

    /// Records that the lines from row `row` onwards are numbered consecutively from `line`.
    pub(crate) fn count_from(&mut self, row: usize, line: u64) {
        if self.lines.last().is_none_or(|&(first, at)| at + (row - first) as u64 != line) {
            self.lines.push((row, line));
        }
    }

    /// Line of a row, or its number in a table.
    pub(crate) fn line(&self, row: usize) -> u64 {
        let at = self.lines.partition_point(|&(first, _)| first <= row);
        at.checked_sub(1).map_or(0, |at| self.lines[at].1 + (row - self.lines[at].0) as u64)
    }

    /// A row of quantities.
    pub(crate) fn row(&self, row: usize) -> SampleRow {
        SampleRow {
            line: self.line(row),
            values: Quantity::ALL.map(|quantity| {
                self.columns[quantity as usize].get(row).copied().unwrap_or(f64::NAN)
            }),
        }
    }

    /// Appends the rows of `other`, whose lines are counted from `line`.
    pub(crate) fn append(&mut self, other: &Block, line: u64) {
        let rows = self.len();
        for &(first, at) in &other.lines {
            self.count_from(rows + first, line + at);
        }
        self.columns
            .iter_mut()
            .zip(&other.columns)
            .for_each(|(own, others)| own.extend_from_slice(others));
    }

    /// Removes incomplete rows.
    pub(crate) fn truncate(&mut self, rows: usize) {
        self.columns.iter_mut().for_each(|column| column.truncate(rows));
    }
}
