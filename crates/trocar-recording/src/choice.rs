//! What to read from a file: which columns, from which of its tables, between which times.

use std::io::Read;

use serde::{Deserialize, Serialize};

use super::columns::{Given, Layout};
use super::container::{Container, Table};
use super::header::{Header, Text};
use super::text::TextReader;
use super::units::Quantity;
use super::{RecordingError, columns};

/// Most columns of a table that are read to guess a unit.
const MOST_GUESSED: usize = 64;

/// What to read from a file. The default finds time, position and force by their names, from the
/// first row to the last.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Choice {
    /// Names of the columns: in order, `time_s,position_mm,-,force_n`, or by name,
    /// `position_mm=x,force_n=-fz`. A minus reverses the sign, and a name that contains commas is
    /// enclosed in double quotes. A file without a header needs the first form.
    pub columns: Option<String>,
    /// Topics, groups or other tables to search; all of them when empty.
    pub topics: Vec<String>,
    /// Rows before this time, s, counted from the first row, are omitted.
    #[serde(rename = "from_s")]
    pub from: Option<f64>,
    /// Rows from this time on, s, counted from the first row, are omitted.
    #[serde(rename = "to_s")]
    pub to: Option<f64>,
    /// Reverse the sign of the force, for a sensor mounted in the opposite direction.
    pub flip_force: bool,
    /// Lines to skip at the beginning of a text or of a sheet, before its header.
    pub skip_rows: u64,
    /// Rows per second of a file without a column of times.
    pub rate_hz: Option<f64>,
    /// Whether columns, topics, skipped lines and rate are those of another file of the same
    /// origin: a file that cannot be read with them is read by its own header.
    #[serde(skip)]
    pub from_another_file: bool,
}

impl Choice {
    /// These columns, and defaults for the rest.
    pub fn columns(names: &str) -> Self {
        Self { columns: Some(names.to_owned()), ..Self::default() }
    }

    /// The same, but by the file's own header; `None` if it is so already.
    pub(super) fn by_own_header(&self) -> Option<Self> {
        let flip_force = self.reverses_force();
        let own = Self { from: self.from, to: self.to, flip_force, ..Self::default() };
        self.from_another_file.then_some(own)
    }

    /// Whether the sign of the force is reversed: by `flip_force`, or by a minus before its column.
    pub fn reverses_force(&self) -> bool {
        let has_minus = match self.in_order() {
            None => self.given().is_ok_and(|given| {
                given.iter().any(|own| own.quantity == Quantity::Force && own.reversed)
            }),
            Some(mapping) => Layout::from_mapping(mapping, &[]).is_ok_and(|layout| {
                layout.slots.iter().flatten().any(|own| own.is(Quantity::Force) && own.per_si < 0.0)
            }),
        };
        self.flip_force != has_minus
    }

    /// The names of the columns, if they are in order.
    pub(super) fn in_order(&self) -> Option<&str> {
        self.columns.as_deref().filter(|mapping| !mapping.contains('='))
    }

    /// The columns that are given by name.
    pub(super) fn given(&self) -> Result<Vec<Given>, RecordingError> {
        self.columns.as_deref().map_or(Ok(Vec::new()), Given::parse)
    }

    /// The layout of the columns of `header`, in order or by their names.
    fn layout(&self, header: &Header, needed: &[Quantity]) -> Result<Layout, RecordingError> {
        let needed = self.needed_columns(needed);
        let layout = match self.in_order() {
            Some(mapping) => Layout::from_mapping(mapping, &needed)?,
            None => header.layout(&self.given()?, &needed)?,
        };
        Ok(layout.at_rate(self.rate_hz))
    }

    /// The same of a table, which has no other columns.
    fn layout_of_table(
        &self,
        header: &Header,
        needed: &[Quantity],
    ) -> Result<Layout, RecordingError> {
        let layout = self.layout(header, needed)?;
        let Header { file, place, names, .. } = header;
        if layout.slots.len() != names.len() {
            let mapping = self.columns.as_deref().unwrap_or_default();
            let problem = format!(
                "for {} columns, but {file}{place} has {}",
                layout.slots.len(),
                names.len()
            );
            return Err(RecordingError::bad_columns(mapping, problem));
        }
        Ok(Layout { names: names.to_vec(), ..layout })
    }

    /// The same of a text: without a header the last comment may have the names.
    pub(super) fn layout_of_text<R: Read>(
        &self,
        reader: &TextReader<R>,
        needed: &[Quantity],
    ) -> Result<Layout, RecordingError> {
        let (line, names) = reader.names().unwrap_or_default();
        let header = Header {
            file: reader.file(),
            place: &format!(" line {line}"),
            names,
            units: reader.units(),
            timestamps: &reader.timestamps(),
            first_rows: &|| reader.first_rows(names.len()),
            first_text: &|k| reader.first_text(k),
        };
        let layout = self.layout(&header, needed);
        if reader.has_header() || self.in_order().is_some() {
            return layout;
        }
        layout.ok().filter(|_| !names.is_empty()).ok_or_else(|| reader.no_header())
    }

    /// Says of too few samples that they are those of a part.
    pub(super) fn of_the_part(&self, mut error: RecordingError) -> RecordingError {
        if let RecordingError::TooFewSamples { lost, .. } = &mut error
            && self.from.or(self.to).is_some()
        {
            lost.insert_str(0, " from ‹from_s› to ‹to_s›, which count from the first row");
        }
        error
    }

    /// Rejects a rate that is none, or one beside a column of times.
    pub(super) fn check_rate(&self, file: &str) -> Result<(), RecordingError> {
        let Some(rate) = self.rate_hz else { return Ok(()) };
        let problem = if !(rate.is_finite() && rate > 0.0) {
            format!("‹rate_hz› is {rate}, expected a number above 0")
        } else if self.names_the_time()? {
            "‹rate_hz› is given although ‹columns› names the time, expected one of them".to_owned()
        } else {
            return Ok(());
        };
        Err(RecordingError::unusable(file, problem))
    }

    fn names_the_time(&self) -> Result<bool, RecordingError> {
        Ok(match self.in_order() {
            Some(mapping) => Layout::from_mapping(mapping, &[])?.has(Quantity::Time),
            None => self.given()?.iter().any(|own| own.quantity == Quantity::Time),
        })
    }

    /// Of the quantities `needed`, those that columns must have.
    pub(super) fn needed_columns(&self, needed: &[Quantity]) -> Vec<Quantity> {
        needed
            .iter()
            .copied()
            .filter(|quantity| *quantity != Quantity::Time || self.rate_hz.is_none())
            .collect()
    }
}

/// Columns of one table, by their indices, and their layout once read.
pub(super) struct Picked {
    pub(super) table: usize,
    pub(super) columns: Vec<usize>,
    pub(super) layout: Layout,
}

/// Selects the one table that contains the required columns.
pub(super) fn pick(
    file: &str,
    container: &Container,
    choice: &Choice,
    needed: &[Quantity],
) -> Result<Picked, RecordingError> {
    let tables = &container.tables;
    let allowed = allowed(file, tables, &choice.topics)?;
    let mut found = Vec::new();
    let mut refused = None;
    let mut only_missing = true;
    for &table in &allowed {
        match layout_of(file, container, table, choice, needed) {
            Ok(layout) => found.push((table, layout)),
            // The table with the most numeric columns gives the most informative error.
            Err(error) => {
                only_missing &=
                    matches!(error, RecordingError::UnclearColumns { only_missing: true, .. });
                let rank = tables[table].columns.iter().filter(|column| column.is_numeric).count();
                if refused.as_ref().is_none_or(|(best, _)| rank > *best) {
                    refused = Some((rank, error));
                }
            }
        }
    }
    let mut found = preferred(tables, found);
    if found.len() > 1 {
        let tables: Vec<String> =
            found.iter().map(|(table, _)| tables[*table].name.clone()).collect();
        let (found, example) = (columns::listed(&tables), &tables[0]);
        let problem = format!(
            "time, position and force could come from {found}, expected one\n\nhint: say which, for example ‹topic='{example}'›; `trocar inspect` shows them"
        );
        return Err(RecordingError::unusable(file, problem));
    }
    let Some((table, layout)) = found.pop() else {
        // Columns of which one could not be chosen are named first.
        if only_missing && let Some(found) = in_several(file, container, &allowed, choice, needed) {
            let problem = format!(
                "{found}, expected all as columns of one table\n\nhint: save them together: arrays of equal length in one group, at common times; `trocar inspect` lists all tables"
            );
            return Err(RecordingError::unusable(file, problem));
        }
        return Err(refused
            .map_or_else(|| RecordingError::Empty { file: file.to_owned() }, |(_, error)| error));
    };
    let read = layout.slots.iter().enumerate().filter(|(_, slot)| slot.is_some());
    let columns = read.map(|(k, _)| k).collect();
    Ok(Picked { table, columns, layout })
}

/// Of the tables that could be read, those that say most clearly that they should be.
fn preferred(tables: &[Table], mut found: Vec<(usize, Layout)>) -> Vec<(usize, Layout)> {
    // A name says more than a unit.
    if found.iter().any(|(_, layout)| !layout.by_unit) {
        found.retain(|(_, layout)| !layout.by_unit);
    }
    // Columns of the file itself take precedence over those of its groups.
    let own = found.iter().position(|(table, _)| tables[*table].name.is_empty());
    let Some(own) = own.filter(|_| found.len() > 1) else { return found };
    let (table, mut layout) = found.swap_remove(own);
    let others: Vec<String> = found.iter().map(|(table, _)| tables[*table].name.clone()).collect();
    layout.notes.push(format!("taken from the file itself, not from {}", columns::listed(&others)));
    vec![(table, layout)]
}

/// Where each quantity is, if they are in several of the tables: as a column, or by the table's name.
fn in_several(
    file: &str,
    container: &Container,
    tables: &[usize],
    choice: &Choice,
    needed: &[Quantity],
) -> Option<String> {
    let mut places = Vec::new();
    for quantity in choice.needed_columns(needed) {
        let mut all = tables.iter().copied();
        let with_column =
            all.find(|table| layout_of(file, container, *table, choice, &[quantity]).is_ok());
        places.push((
            quantity,
            with_column.or_else(|| {
                tables.iter().copied().find(|table| {
                    let name = &container.tables[*table].name;
                    let leaf = name.rsplit(['/', '.']).next().unwrap_or_default();
                    columns::quantity_named(leaf) == Some(quantity)
                })
            })?,
        ));
    }
    let is_apart = places.windows(2).any(|pair| pair[0].1 != pair[1].1);
    let words = places.iter().map(|(quantity, table)| {
        let table = match &*container.tables[*table].name {
            "" => "the file itself".to_owned(),
            name => format!("'{name}'"),
        };
        format!("{} in {table}", quantity.name())
    });
    is_apart.then(|| words.collect::<Vec<_>>().join(", "))
}

/// The tables named by `topics`: by full name, or by the part after a slash.
pub(super) fn allowed(
    file: &str,
    tables: &[Table],
    topics: &[String],
) -> Result<Vec<usize>, RecordingError> {
    if topics.is_empty() {
        return Ok((0..tables.len()).collect());
    }
    let mut found = Vec::new();
    for topic in topics {
        let exact = (0..tables.len()).filter(|k| tables[*k].name == *topic);
        let matching = (0..tables.len()).filter(|k| {
            let front = tables[*k].name.strip_suffix(topic.as_str());
            front.is_some_and(|front| front.ends_with('/') || topic.starts_with('/'))
        });
        let mut own: Vec<usize> = exact.collect();
        if own.is_empty() {
            own = matching.collect();
        }
        if own.len() != 1 {
            let names: Vec<String> = tables.iter().map(|table| table.name.clone()).collect();
            let nameless = names.iter().all(String::is_empty);
            let expected = if nameless {
                "one table without a name".to_owned()
            } else {
                columns::listed(&names)
            };
            let problem = format!(
                "{} topics or tables are named '{topic}', expected one\n\nhint: the file holds {expected}",
                own.len()
            );
            return Err(RecordingError::unusable(file, problem));
        }
        found.extend(own);
    }
    found.sort_unstable();
    found.dedup();
    Ok(found)
}

/// Rejects topics if there is only one unnamed table: text, or rows of a table.
///
/// # Errors
/// [`RecordingError::Unusable`] if there are some.
pub(crate) fn check_topics(file: &str, choice: &Choice) -> Result<(), RecordingError> {
    allowed(file, &[Table::without_a_name(Vec::new())], &choice.topics).map(drop)
}

/// Numbers of the first rows of a table, by column.
fn first_rows(container: &Container, table: usize) -> Vec<Vec<f64>> {
    let columns = &container.tables[table].columns;
    let numeric: Vec<usize> =
        (0..columns.len()).filter(|k| columns[*k].is_numeric).take(MOST_GUESSED).collect();
    let mut rows = vec![Vec::new(); numeric.len()];
    let read = container.open(table, &numeric).and_then(|mut batches| batches.next(&mut rows));
    let mut all = vec![Vec::new(); columns.len()];
    if read.is_ok() {
        for (k, mut numbers) in numeric.into_iter().zip(rows) {
            numbers.retain(|number| number.is_finite());
            all[k] = numbers;
        }
    }
    all
}

fn layout_of(
    file: &str,
    container: &Container,
    table: usize,
    choice: &Choice,
    needed: &[Quantity],
) -> Result<Layout, RecordingError> {
    let Table { name, columns, .. } = &container.tables[table];
    let header = Header {
        file,
        place: &if name.is_empty() { String::new() } else { format!(" {name}") },
        names: &columns.iter().map(|column| column.name.clone()).collect::<Vec<_>>(),
        units: &columns.iter().map(|c| c.unit.clone().unwrap_or_default()).collect::<Vec<_>>(),
        timestamps: &container.content.dates(table),
        first_rows: &|| first_rows(container, table),
        first_text: &|k| {
            let text =
                (!columns[k].is_numeric).then(|| container.content.number_with_unit(table, k))?;
            Some(text.map_or(Text::Other, |text| Text::WithUnit(text.to_owned())))
        },
    };
    let layout = choice.layout_of_table(&header, needed)?;
    let mut read = columns.iter().zip(&layout.slots).filter(|(_, slot)| slot.is_some());
    match read.find(|(column, _)| !column.is_numeric) {
        Some((column, _)) => {
            let problem = "a column without numbers".to_owned();
            Err(RecordingError::bad_columns(&*column.name, problem))
        }
        None => Ok(layout),
    }
}

/// A column of a table that is not a file: its index, from 0, and the number of its units per SI
/// unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TableColumn {
    /// Index among the names.
    pub index: usize,
    /// Divisor for conversion to SI.
    pub per_si: f64,
}

/// Which columns of a table are which quantity.
#[derive(Debug, Clone, PartialEq)]
pub struct TableColumns {
    /// By index of the [`Quantity`]; time, position and force are there.
    pub columns: [Option<TableColumn>; Quantity::ALL.len()],
    /// Assumptions made.
    pub notes: Vec<String>,
}

impl TableColumns {
    /// Finds the columns of `table` by their `names`, with the same rules as for the header of a
    /// file, or by `mapping` (`time_s,position_mm,-,force_n`) in their order.
    ///
    /// # Errors
    /// [`RecordingError`] if a column or its unit is missing or ambiguous.
    pub fn find(
        table: &str,
        names: &[String],
        mapping: Option<&str>,
    ) -> Result<Self, RecordingError> {
        Self::find_with_units(table, names, &[], &[], mapping)
    }

    /// The same with the units declared for the names, empty if there are none, and the indices of
    /// the columns that hold timestamps, which count in s.
    ///
    /// # Errors
    /// As for [`TableColumns::find`].
    pub fn find_with_units(
        table: &str,
        names: &[String],
        units: &[String],
        timestamps: &[usize],
        mapping: Option<&str>,
    ) -> Result<Self, RecordingError> {
        let header = Header {
            file: table,
            place: "",
            names,
            units,
            timestamps,
            first_rows: &Vec::new,
            first_text: &|_| None,
        };
        let choice = Choice { columns: mapping.map(str::to_owned), ..Choice::default() };
        let layout = choice.layout_of_table(&header, &Quantity::NEEDED)?;
        let columns = Quantity::ALL.map(|quantity| {
            let index = layout.column(quantity)?;
            layout.slots[index].map(|slot| TableColumn { index, per_si: slot.per_si })
        });
        Ok(Self { columns, notes: layout.notes })
    }
}
