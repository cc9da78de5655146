//! Rows in SI units, many at a time: what readers of files hand on.

use super::columns::Quantity;

/// Consecutive rows, column by column. All columns that the file has are of one length, the others empty.
#[derive(Debug, Default)]
pub(crate) struct Block {
    /// Numbers by place of the column: a [`Quantity`], or the reader's own order. NaN where a cell is empty.
    pub(crate) columns: Vec<Vec<f64>>,
    /// First row and its line, wherever lines do not simply count on.
    pub(crate) lines: Vec<(usize, u64)>,
}

/// One row in SI units, indexed by [`Quantity`]; NaN for columns the file lacks.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row {
    pub(crate) line: u64,
    pub(crate) values: [f64; Quantity::ALL.len()],
}

impl Row {
    pub(crate) fn get(&self, quantity: Quantity) -> f64 {
        self.values[quantity as usize]
    }
}

impl Block {
    /// Room for `columns` columns.
    pub(crate) fn new(columns: usize) -> Self {
        Self { columns: vec![Vec::new(); columns], lines: Vec::new() }
    }

    /// Number of rows.
    pub(crate) fn len(&self) -> usize {
        self.columns.iter().map(Vec::len).max().unwrap_or(0)
    }

    pub(crate) fn clear(&mut self) {
        self.columns.iter_mut().for_each(Vec::clear);
        self.lines.clear();
    }

    /// Puts down that row `row` and those behind it count on from `line`.
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
    pub(crate) fn row(&self, row: usize) -> Row {
        let value = |quantity: Quantity| self.columns[quantity as usize].get(row).copied().unwrap_or(f64::NAN);
        Row { line: self.line(row), values: Quantity::ALL.map(value) }
    }

    /// Appends the rows of `other`, whose lines are counted from `line`.
    pub(crate) fn append(&mut self, other: &Block, line: u64) {
        let rows = self.len();
        for &(first, at) in &other.lines {
            self.count_from(rows + first, line + at);
        }
        self.columns.iter_mut().zip(&other.columns).for_each(|(own, others)| own.extend_from_slice(others));
    }

    /// Cuts off what does not belong to whole rows.
    pub(crate) fn truncate(&mut self, rows: usize) {
        self.columns.iter_mut().for_each(|column| column.truncate(rows));
    }
}
