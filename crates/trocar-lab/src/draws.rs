//! Draws of a posterior as a table, and the models of a table of draws.

use std::path::{Path, PathBuf};

use trocar_model::flat::FlatError;
use trocar_model::{Stages, Trocar};

use trocar_identify::posterior::{Draw, Posterior};
use trocar_tables::error::{OutputError, TableError};
use trocar_tables::table::{self as tables, Column, Field, Table, TableWriter};

/// Name of the file of draws in the folder of a result.
pub const FILE_NAME: &str = "posterior.parquet";

/// Columns before those of the parameters.
const HEAD: [&str; 3] = ["chain", "draw", "structure"];

/// Columns after those of the parameters, numbered from 0: the model of the draw as the row of
/// [`Trocar::write_numbers`]; missing where that row is shorter.
const MODEL: &str = "model_";

/// Whether a column of draws holds a number of their models.
#[must_use]
pub fn is_of_model(column: &str) -> bool {
    column.strip_prefix(MODEL).is_some_and(|place| place.parse::<usize>().is_ok())
}

/// Why a table holds no draws.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DrawsError {
    /// The table cannot be read.
    #[error(transparent)]
    Table(#[from] TableError),
    /// Other columns, or no rows.
    #[error("{}: {found}, expected draws\n\nhint: ‹identify(posterior=N)› writes them into its folder, as {FILE_NAME}", path.display())]
    NoDraws {
        /// The file.
        path: PathBuf,
        /// What was found.
        found: String,
    },
    /// A row that holds no model.
    #[error("draws, row {row}: {source}")]
    Row {
        /// Row, from 1.
        row: usize,
        /// What is wrong.
        source: FlatError,
    },
}

/// The draws as a table: `chain`, `draw`, `structure`, the parameters by name with unit, and the
/// numbers of each model.
#[must_use]
pub fn table(posterior: &Posterior) -> Table {
    let Posterior { structures, parameters, draws } = posterior;
    let whole = |of: fn(&Draw) -> usize| {
        Column::Integer(draws.iter().map(|d| i64::try_from(of(d)).ok()).collect())
    };
    let structure = draws.iter().map(|d| Some(structures[d.structure].name.clone().into()));
    let head = [whole(|d| d.chain), whole(|d| d.draw), Column::Text(structure.collect())];
    let names = parameters.iter().map(|p| p.id.to_string());
    let models = model_columns(draws);
    let places = (0..models.len()).map(|place| format!("{MODEL}{place}"));
    let parameters =
        (0..parameters.len()).map(|j| Column::Number(draws.iter().map(|d| d.values[j]).collect()));
    Table {
        fields: HEAD.into_iter().map(str::to_owned).chain(names).chain(places).collect(),
        columns: head.into_iter().chain(parameters).chain(models).collect(),
    }
}

/// The models of draws, number by number.
fn model_columns(draws: &[Draw]) -> Vec<Column> {
    let trocars = draws.iter().map(|draw| Trocar::of_seal(draw.model));
    let rows: Vec<Vec<f64>> = trocars
        .map(|trocar| {
            let mut row = vec![0.0; trocar.count_numbers()];
            trocar.write_numbers(&mut row).expect("the row has the length it takes");
            row
        })
        .collect();
    let width = rows.iter().map(Vec::len).max().unwrap_or_default();
    (0..width)
        .map(|place| {
            let cells = rows.iter().map(|row| row.get(place).copied().unwrap_or(f64::NAN));
            Column::Number(cells.collect())
        })
        .collect()
}

/// Writes a table of draws; the extension of `path` selects the format.
///
/// # Errors
/// [`OutputError`] when the file cannot be written; nothing is left of it then.
pub fn write(table: &Table, path: &Path) -> Result<(), OutputError> {
    let fields = table.fields.iter().zip(&table.columns);
    let fields = fields.map(|(name, column)| Field::new(name.clone(), column.kind()));
    let mut writer = TableWriter::create(path, &fields.collect::<Vec<_>>())?;
    writer.write(&table.columns)?;
    writer.commit()
}

/// The table of draws in a Parquet file that [`write()`] wrote.
///
/// # Errors
/// [`DrawsError`] when the file is no table of draws.
pub fn read(path: &Path) -> Result<Table, DrawsError> {
    let table = tables::read(path)?;
    let first = format!("{MODEL}0");
    let needed = HEAD.into_iter().chain([first.as_str()]);
    let missing = needed.into_iter().find(|name| table.column(name).is_none());
    let found = match missing {
        Some(name) => format!("no column {name}"),
        None if table.rows() == 0 => "no rows".to_owned(),
        None => return Ok(table),
    };
    Err(DrawsError::NoDraws { path: path.to_owned(), found })
}

/// The elements of all draws of a table.
///
/// # Errors
/// [`DrawsError::Row`] for numbers that form no elements.
pub fn models(table: &Table) -> Result<Vec<Stages>, DrawsError> {
    let columns: Vec<&[f64]> = table
        .fields
        .iter()
        .zip(&table.columns)
        .filter_map(|(name, column)| match column {
            Column::Number(cells) if is_of_model(name) => Some(cells.as_slice()),
            _ => None,
        })
        .collect();
    (0..table.rows())
        .map(|row| {
            let numbers =
                columns.iter().map(|cells| cells[row]).take_while(|number| number.is_finite());
            elements(&numbers.collect::<Vec<f64>>())
                .map_err(|source| DrawsError::Row { row: row + 1, source })
        })
        .collect()
}

fn elements(numbers: &[f64]) -> Result<Stages, FlatError> {
    let trocar = Trocar::from_numbers(numbers)?;
    let stages = trocar.seal().stages().copied();
    stages.ok_or(FlatError::Tag { place: 1, found: numbers[1] })
}

/// The elements of the draws in a file that [`write()`] wrote, in the order of its rows.
///
/// # Errors
/// As for [`read`] and [`models`].
pub fn read_models(path: &Path) -> Result<Vec<Stages>, DrawsError> {
    models(&read(path)?)
}
