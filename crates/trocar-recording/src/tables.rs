//! Columns of files of any format, by name, as stored in the file.

use std::collections::HashMap;
use std::path::Path;

use rayon::prelude::*;

use super::RecordingError;
use super::container::{Container, Table};
use super::registry;
use super::rows::justified;

/// Content of a file: its tables and their columns.
///
/// # Errors
/// [`RecordingError`] when the file cannot be opened, is damaged, or has an unsupported format.
pub fn tables(path: impl AsRef<Path>) -> Result<Vec<Table>, RecordingError> {
    Ok(registry::any(path.as_ref())?.tables)
}

/// Columns of the table named `table` of a file, in the requested order; NaN for a missing cell.
///
/// The numbers are those of the file, in its units, except timestamps and durations, which are in
/// seconds: timestamps since the column's first.
///
/// # Errors
/// As for [`tables`], and when the table or a column is missing or not numeric.
pub fn read_columns(
    path: impl AsRef<Path>,
    table: &str,
    columns: &[&str],
) -> Result<Vec<Vec<f64>>, RecordingError> {
    let path = path.as_ref();
    let container = registry::any(path)?;
    let (table, places) = find(path, &container, table, columns)?;
    if let Some(all) = container.read_whole(table, &places)? {
        return Ok(all);
    }
    let rows = container.tables[table].rows.unwrap_or(0);
    let mut batches = container.open(table, &places)?;
    let start = rows.min(justified(path) / places.len().max(1) as u64) as usize;
    let mut all: Vec<Vec<f64>> = places.iter().map(|_| Vec::with_capacity(start)).collect();
    let mut batch = vec![Vec::new(); places.len()];
    while batches.next(&mut batch)? {
        // Allocating new memory dominates the time here.
        all.par_iter_mut().zip(&batch).for_each(|(all, batch)| all.extend_from_slice(batch));
    }
    Ok(all)
}

/// Indices of a table and of some of its columns.
fn find(
    path: &Path,
    container: &Container,
    table: &str,
    columns: &[&str],
) -> Result<(usize, Vec<usize>), RecordingError> {
    let tables = &container.tables;
    let at = tables
        .iter()
        .position(|known| known.name == table)
        .ok_or_else(|| missing(path, ["table", table], tables.iter().map(|table| &*table.name)))?;

    // The first of several columns of the same name.
    let names = tables[at].columns.iter().map(|column| &*column.name);
    let known: HashMap<&str, usize> =
        names.clone().enumerate().rev().map(|(place, name)| (name, place)).collect();
    let places = columns.iter().map(|name| {
        let found = known.get(name).copied();
        found.ok_or_else(|| missing(path, ["column", name], names.clone()))
    });
    Ok((at, places.collect::<Result<_, _>>()?))
}

fn missing<'a>(
    path: &Path,
    [what, name]: [&str; 2],
    found: impl Iterator<Item = &'a str>,
) -> RecordingError {
    let found = found.collect::<Vec<_>>().join(", ");
    RecordingError::unusable(path.display(), format!("no {what} called '{name}', found {found}"))
}
