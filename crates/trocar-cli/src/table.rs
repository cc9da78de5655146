//! Plain-text tables: columns aligned, numbers right-aligned.

use std::fmt::Write as _;

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

    pub(crate) fn to_text(&self) -> String {
        let columns = self.rows.iter().map(Vec::len).max().unwrap_or(0);
        let cell_width = |column: usize| {
            let cells = self.rows.iter().filter_map(|row| row.get(column));
            cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
        };
        let widths: Vec<usize> = (0..columns).map(cell_width).collect();
        let mut text = String::new();
        for row in &self.rows {
            let mut line = String::new();
            for (k, (cell, width)) in row.iter().zip(&widths).enumerate() {
                let _ = if k == 0 { write!(line, "  {cell:<width$}") } else { write!(line, "  {cell:>width$}") };
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

/// An interval, `[low, high]`, or "not determined" if both bounds are infinite.
pub(crate) fn interval([low, high]: [f64; 2]) -> String {
    if low == f64::NEG_INFINITY && high == f64::INFINITY {
        return "not determined".to_owned();
    }
    format!("[{}, {}]", number(low), number(high))
}
