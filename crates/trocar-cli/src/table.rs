//! Plain-text tables: columns aligned, numbers right-aligned.

use std::fmt::Write as _;
use std::ops::Range;

use terminal_size::{Width, terminal_size_of};

/// Blanks before a column.
const GAP: usize = 2;

/// Rows with equal numbers of cells; the first column is text.
#[derive(Default)]
pub(crate) struct Table {
    rows: Vec<Vec<String>>,
}

impl Table {
    pub(crate) fn headed<'a>(cells: impl IntoIterator<Item = &'a str>) -> Self {
        Self { rows: vec![cells.into_iter().map(str::to_owned).collect()] }
    }

    pub(crate) fn row(&mut self, cells: impl IntoIterator<Item = String>) {
        self.rows.push(cells.into_iter().collect());
    }

    /// The table as text. On a terminal, columns that do not fit beside the others follow below,
    /// with the first column again.
    pub(crate) fn to_text(&self) -> String {
        let width = terminal_size_of(std::io::stdout())
            .map(|(Width(width), _)| usize::from(width).clamp(80, 200));
        self.in_width(width.unwrap_or(usize::MAX))
    }

    fn in_width(&self, most: usize) -> String {
        let columns = self.rows.iter().map(Vec::len).max().unwrap_or(0);
        let widths: Vec<usize> = (0..columns)
            .map(|column| {
                let cells = self.rows.iter().filter_map(|row| row.get(column));
                cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
            })
            .collect();
        let mut parts: Vec<String> = Vec::new();
        let mut from = 1;
        while from < columns || parts.is_empty() {
            let mut used = GAP + widths.first().copied().unwrap_or(0);
            let fitting = widths.iter().skip(from).take_while(|width| {
                used += GAP + **width;
                used <= most
            });
            let count = fitting.count().max(1);
            parts.push(self.part(&widths, from..(from + count).min(columns)));
            from += count;
        }
        parts.join("\n")
    }

    /// The first column and those of `range`.
    fn part(&self, widths: &[usize], range: Range<usize>) -> String {
        let mut text = String::new();
        for row in &self.rows {
            let mut line = String::new();
            if let (Some(cell), Some(width)) = (row.first(), widths.first()) {
                let _ = write!(line, "  {cell:<width$}");
            }
            for (cell, width) in row.iter().zip(widths).take(range.end).skip(range.start) {
                let _ = write!(line, "  {cell:>width$}");
            }
            text.push_str(line.trim_end());
            text.push('\n');
        }
        text
    }
}

/// A number with about four significant digits, without an exponent if it is readable without one.
pub(crate) fn number(value: f64) -> String {
    let size = value.abs();
    if !value.is_finite() {
        if value.is_nan() { "-".to_owned() } else { format!("{value}") }
    } else if size == 0.0 {
        "0".to_owned()
    } else if !(1e-4..1e5).contains(&size) {
        format!("{value:.2e}")
    } else {
        let decimals = (3 - size.log10().floor() as i32).clamp(0, 5) as usize;
        format!("{value:.decimals$}")
    }
}

/// An interval, `[low, high]`, "not determined" if both bounds are infinite, or "given" if both are
/// the same.
pub(crate) fn interval([low, high]: [f64; 2]) -> String {
    if low == f64::NEG_INFINITY && high == f64::INFINITY {
        return "not determined".to_owned();
    }
    if low == high {
        return "given".to_owned();
    }
    format!("[{}, {}]", number(low), number(high))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_that_do_not_fit_follow_below_with_the_first_again() {
        let mut table = Table::headed(["model", "error", "parameters", "fit"]);
        table.row(["EMS", "0.1", "12", "98"].map(str::to_owned));
        let wide = "  model  error  parameters  fit\n  EMS      0.1          12   98\n";
        assert_eq!(table.in_width(usize::MAX), wide);
        assert_eq!(table.in_width(31), wide);
        let narrow = "  model  error  parameters\n  EMS      0.1          12\n\n  model  fit\n  EMS     98\n";
        assert_eq!(table.in_width(30), narrow);
        assert_eq!(table.in_width(1).matches("model").count(), 3, "never without a column");
    }
}
