//! Groups the vectors of a group into tables by their length.

use std::collections::HashMap;
use std::fmt::Display;

use crate::container::{Column, Table};

/// Most columns into which a matrix is split; a wider one is an image rather than readings.
pub(super) const WIDEST: u64 = 64;

/// Vectors and matrices of one group, in the file's order.
#[derive(Debug)]
pub(super) struct Group<L> {
    /// Path of the group; empty at the top of the file.
    pub(super) name: String,
    /// Each column with its number of rows and its position.
    pub(super) columns: Vec<(Column, u64, L)>,
    /// Content that cannot be read, each with its reason.
    pub(super) refused: Vec<String>,
}

impl<L> Group<L> {
    pub(super) fn named(name: &str) -> Self {
        Self { name: name.to_owned(), columns: Vec::new(), refused: Vec::new() }
    }

    pub(super) fn refuse(&mut self, name: &str, reason: impl Display) {
        self.refused.push(format!("{name} ({reason})"));
    }
}

/// An array as columns, the longer dimension being rows.
pub(super) struct Shape {
    pub(super) rows: u64,
    pub(super) width: u64,
    /// Whether columns stand one after another in the file, not rows.
    pub(super) across: bool,
}

impl Shape {
    /// The array with `sides`, the first of which changes fastest if `fortran`, in items of so many bytes; why it cannot be
    /// read, as where they are more than `most`.
    pub(super) fn of(sides: &[u64], fortran: bool, item: u64, most: u64) -> Result<Self, String> {
        let (rows, width, across) = match *sides {
            [] => (1, 1, false),
            [rows] => (rows, 1, false),
            [rows, width] if rows >= width => (rows, width, fortran),
            [width, rows] => (rows, width, !fortran),
            _ => return Err("of more than two dimensions".to_owned()),
        };
        let bytes = rows.checked_mul(width).and_then(|count| count.checked_mul(item));
        let what = match bytes {
            _ if width > WIDEST => format!("wider than {WIDEST} columns"),
            Some(bytes) if bytes <= most => return Ok(Self { rows, width, across }),
            _ => "more than the file has bytes for".to_owned(),
        };
        Err(format!("{rows} x {width} numbers, {what}"))
    }

    /// Name of a column of the array `name`.
    pub(super) fn name(&self, name: &str, column: u64) -> String {
        if self.width == 1 { name.to_owned() } else { format!("{name}[{column}]") }
    }

    /// Items before a column, and from each of its rows to the next.
    pub(super) fn place(&self, column: u64) -> [u64; 2] {
        if self.across { [column * self.rows, 1] } else { [column, self.width] }
    }
}

/// Tables of a file, and the positions of their columns.
pub(super) type Placed<L> = (Vec<Table>, Vec<Vec<L>>);

/// One table for each group and length. The one with the most rows has the name of the group,
/// others have the length appended, as in `run[1]`. The first of them reports the content that
/// cannot be read.
pub(super) fn tables<L>(groups: Vec<Group<L>>) -> Placed<L> {
    let mut placed: Placed<L> = (Vec::new(), Vec::new());
    for group in groups {
        let first = placed.0.len();
        let longest = group
            .columns
            .iter()
            .filter(|(column, ..)| column.is_numeric)
            .map(|&(_, rows, _)| rows)
            .max();
        let mut of_length: HashMap<u64, usize> = HashMap::new();
        for (column, rows, place) in group.columns {
            let at = *of_length.entry(rows).or_insert(placed.0.len());
            if at == placed.0.len() {
                let name = if Some(rows) == longest {
                    group.name.clone()
                } else {
                    format!("{}[{rows}]", group.name)
                };
                placed.0.push(Table { name, rows: Some(rows), ..Table::default() });
                placed.1.push(Vec::new());
            }
            placed.1[at].push(place);
            placed.0[at].columns.push(column);
        }
        if group.refused.is_empty() {
            continue;
        }
        if placed.0.len() == first {
            placed.0.push(Table { name: group.name.clone(), ..Table::default() });
            placed.1.push(Vec::new());
        }
        placed.0[first].kind = format!("not read: {}", group.refused.join("; "));
    }
    placed
}
