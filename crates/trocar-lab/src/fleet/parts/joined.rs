//! Columns of the files of a recording, joined by name.

use std::collections::HashMap;

use super::{Cells, Taken, cell, is_in};
use crate::fleet::row::FleetCell;
use trocar_recording::RecordingError;

/// A column of several files.
pub(super) struct Joined {
    pub(super) name: String,
    /// The unit declared with the name in the first file that has the column.
    pub(super) unit: String,
    /// Its index in each file, and the type of its cells, if they are read; `None` if a file does
    /// not have it.
    pub(super) places: Vec<Option<(usize, Option<Cells>)>>,
}

/// All columns of the files, in the order of the first file.
pub(super) fn joined(parts: &[Taken<'_>]) -> Vec<Joined> {
    let mut columns: Vec<Joined> = Vec::new();
    let mut known: HashMap<String, usize> = HashMap::new();
    for (k, part) in parts.iter().enumerate() {
        for column in part.parquet.columns() {
            let at = *known.entry(column.name.clone()).or_insert_with(|| {
                let unit = column.unit.clone().unwrap_or_default();
                columns.push(Joined {
                    name: column.name.clone(),
                    unit,
                    places: vec![None; parts.len()],
                });
                columns.len() - 1
            });
            let place = part.parquet.place(&column.name);
            columns[at].places[k] = place.map(|place| (place, part.parquet.cells(place)));
        }
    }
    columns
}

impl Joined {
    /// Whether it holds numbers or timestamps in one of the files.
    pub(super) fn is_numeric(&self) -> bool {
        let is_numeric =
            |cells: Cells| matches!(cells, Cells::Number | Cells::Whole | Cells::Timestamp(_));
        self.places.iter().flatten().any(|(_, cells)| cells.is_some_and(is_numeric))
    }

    /// The value common to all its cells; `None` if they vary or are timestamps.
    pub(super) fn constant(
        &self,
        parts: &[Taken<'_>],
    ) -> Result<Option<FleetCell>, RecordingError> {
        let mut first: Option<FleetCell> = None;
        let is_usable =
            |cells: Option<Cells>| cells.is_some_and(|cells| !matches!(cells, Cells::Timestamp(_)));
        if !self.places.iter().all(|place| place.is_some_and(|(_, cells)| is_usable(cells))) {
            return Ok(None);
        }
        for (part, (place, _)) in parts.iter().zip(self.places.iter().flatten()) {
            let mut same = true;
            part.select(*place).runs(&mut |value, _| {
                match &first {
                    Some(first) => same = is_in(value, first),
                    None => first = Some(cell(value)),
                }
                same
            })?;
            if !same {
                return Ok(None);
            }
        }
        Ok(first)
    }

    /// Rejects a column whose cells are not numbers, or not of the same kind in all files.
    pub(super) fn check(&self, name: &str, parts: &[Taken<'_>]) -> Result<(), RecordingError> {
        let mut all =
            parts.iter().zip(&self.places).filter_map(|(part, place)| Some((part, (*place)?)));
        let Some((first, (place, cells))) = all.next() else { return Ok(()) };
        for (second, (_, other)) in all {
            if words(other) != words(cells) {
                return Err(RecordingError::PartsDiffer {
                    file: name.to_owned(),
                    column: self.name.as_str().into(),
                    first: first.name.into(),
                    of_first: words(cells),
                    second: second.name.into(),
                    of_second: words(other),
                });
            }
        }
        match cells {
            Some(Cells::Number | Cells::Whole | Cells::Timestamp(_)) => Ok(()),
            _ => Err(first.parquet.not_numeric(place)),
        }
    }
}

/// Content of a column, for messages.
fn words(cells: Option<Cells>) -> &'static str {
    match cells {
        Some(Cells::Number | Cells::Whole) => "numbers",
        Some(Cells::Truth) => "true and false",
        Some(Cells::Text) => "text",
        Some(Cells::Timestamp(1e3)) => "timestamps in ms",
        Some(Cells::Timestamp(1e6)) => "timestamps in us",
        Some(Cells::Timestamp(_)) => "timestamps in ns",
        None => "what is not read",
    }
}
