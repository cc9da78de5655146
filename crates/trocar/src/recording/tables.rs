//! Columns of files of any format, by name, as they stand in the file.

use std::path::Path;

use rayon::prelude::*;

use super::RecordingError;
use super::container::{self, Container, Table};

/// What a file holds: its tables and their columns.
///
/// # Errors
/// [`RecordingError`] when the file cannot be opened, is damaged, or is of a format that is not read.
pub fn tables(path: impl AsRef<Path>) -> Result<Vec<Table>, RecordingError> {
    Ok(container::any(path.as_ref())?.tables().to_vec())
}

/// Columns of the table called `table` of a file, in the order asked for; NaN where a cell is missing.
///
/// The numbers are as in the file, in its units, but for moments and durations, which are seconds: moments since the column's
/// first.
///
/// # Errors
/// As for [`tables`], and when the table or a column is missing or holds no numbers.
pub fn read_columns(path: impl AsRef<Path>, table: &str, columns: &[&str]) -> Result<Vec<Vec<f64>>, RecordingError> {
    let path = path.as_ref();
    let container = container::any(path)?;
    let (table, places) = find(path, container.as_ref(), table, columns)?;
    if let Some(all) = container.read_whole(table, &places)? {
        return Ok(all);
    }
    let rows = container.tables()[table].rows.unwrap_or(0);
    let mut batches = container.open(table, &places)?;
    // What the file says of its rows is not trusted with more than a start.
    let start = rows.min(1 << 24) as usize;
    let mut all: Vec<Vec<f64>> = places.iter().map(|_| Vec::with_capacity(start)).collect();
    let mut batch = vec![Vec::new(); places.len()];
    while batches.next(&mut batch)? {
        // Fresh memory is what takes time here.
        all.par_iter_mut().zip(&batch).for_each(|(all, batch)| all.extend_from_slice(batch));
    }
    Ok(all)
}

/// Places of a table and of some of its columns.
fn find(
    path: &Path,
    container: &dyn Container,
    table: &str,
    columns: &[&str],
) -> Result<(usize, Vec<usize>), RecordingError> {
    let missing = |what: &str, name: &str, found: Vec<&str>| RecordingError::NoSuchColumn {
        file: path.display().to_string(),
        what: what.to_owned(),
        name: name.to_owned(),
        found: found.join(", "),
    };
    let tables = container.tables();
    let names = || tables.iter().map(|table| table.name.as_str()).collect();
    let at = tables.iter().position(|known| known.name == table).ok_or_else(|| missing("table", table, names()))?;
    let place = |name: &&str| {
        let found = tables[at].columns.iter().position(|column| column.name == **name);
        let names = || tables[at].columns.iter().map(|column| column.name.as_str()).collect();
        found.ok_or_else(|| missing("column", name, names()))
    };
    Ok((at, columns.iter().map(place).collect::<Result<_, _>>()?))
}
