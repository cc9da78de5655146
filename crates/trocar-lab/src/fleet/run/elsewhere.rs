//! The rows of a data set from workers, in whatever process they run, to the journal and the table.
//!
//! ```text
//! Collector: sources, what the journal has ──▶ anywhere: identify_source, pure ──▶ text ──▶ Collector: journal ──▶ table
//! ```

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::{Fleet, FleetError, KEPT, Record, Tally, common, push};
use crate::fleet::dataset::{Dataset, Source};
use crate::fleet::journal::{Entry, EntryLocation, Journal};
use crate::fleet::one::{Config, Input, identify_one, is_passing, lost, sha256_of};
use crate::fleet::row::{FleetCell, FleetRow, columns};
use trocar_tables::error::OutputError;
use trocar_tables::table::{Column, Field, Kind, TableWriter};

/// Rows of the table held in memory at a time.
const PIECE: usize = 1024;

/// A unit of work for a worker.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Order {
    source: Source,
    /// Hash of the recording whose row the journal has.
    known: Option<String>,
}

impl Order {
    /// The row of the recording; `None` if it equals the one in the journal.
    pub(super) fn identify(&self, config: &Config) -> Option<Entry> {
        let Source { name, path, .. } = &self.source;
        if self.known.is_some() && self.known == sha256_of(path) {
            return None;
        }
        let mut row = identify_one(&Input::File(path.clone()), config);
        row.set("path", FleetCell::text(name));
        if let Some(reason) = row.text("reason") {
            // Without paths of this machine.
            let reason = reason.replace(&path.display().to_string(), name);
            row.set("reason", FleetCell::text(reason));
        }
        Some(entry(name, row, config))
    }
}

/// The line of the journal for a row. A failure that may be temporary has no hash, so that the
/// recording is identified again next time.
fn entry(name: &str, row: FleetRow, config: &Config) -> Entry {
    let hash = row.text("sha256").filter(|_| !is_passing(&row));
    let sha256 = hash.unwrap_or_default().to_owned();
    Entry { name: name.to_owned(), sha256, config: config.hash(), row }
}

/// Identifies the recording of one source: `order` is one of [`Collector::orders`], the result is
/// for [`Collector::add`]. A pure function of the file and `config`; a recording that fails is a
/// row.
///
/// # Errors
/// Text that is not an order.
pub fn identify_source(order: &str, config: &Config) -> Result<String, serde_json::Error> {
    let order: Order = serde_json::from_str(order)?;
    serde_json::to_string(&order.identify(config))
}

/// Collects the rows of a data set, in any order, and writes the table.
pub struct Collector {
    sources: Vec<Source>,
    config: Config,
    table: PathBuf,
    before: HashMap<String, EntryLocation>,
    journal: Journal,
    /// Where the row of each finished source is in the journal.
    rows: Vec<Option<EntryLocation>>,
    tally: Tally,
}

impl Collector {
    /// Opens the journal of `table`.
    ///
    /// # Errors
    /// [`OutputError`] when it cannot be written, another process is writing it, or a recording would
    /// be replaced.
    pub fn open(dataset: &Dataset, config: &Config, table: &Path) -> Result<Self, OutputError> {
        let (journal, before) = Journal::open(dataset, table, config)?;
        let total = dataset.sources.len();
        Ok(Self {
            sources: dataset.sources.clone(),
            config: config.clone(),
            table: table.to_owned(),
            before,
            journal,
            rows: vec![None; total],
            tally: Tally { total, ..Tally::default() },
        })
    }

    pub(super) fn tally(&self) -> Tally {
        self.tally
    }

    pub(super) fn unfinished(&self) -> Vec<Order> {
        self.sources
            .iter()
            .map(|source| Order {
                source: source.clone(),
                known: self.before.get(&source.name).map(|place| place.sha256.clone()),
            })
            .collect()
    }

    /// One order per source, in the order of the table.
    ///
    /// # Errors
    /// A path that is not valid text.
    pub fn orders(&self) -> Result<Vec<String>, serde_json::Error> {
        self.unfinished().iter().map(serde_json::to_string).collect()
    }

    /// Adds the result of [`identify_source`] for the order at `source`; adding it twice has no
    /// effect.
    ///
    /// # Errors
    /// [`FleetError::Output`] when the journal cannot be written; [`FleetError::WorkerResult`] for
    /// text from another origin.
    pub fn add(&mut self, source: usize, result: &str) -> Result<Tally, FleetError> {
        let entry: Option<Entry> = serde_json::from_str(result)
            .map_err(|error| FleetError::WorkerResult(error.to_string()))?;
        self.take(source, entry)
    }

    /// Records a source that could not be finished, with the reason: a failed row, which is tried
    /// again when the work is resumed.
    ///
    /// # Errors
    /// As for [`Collector::add`].
    pub fn lose(&mut self, source: usize, kind: &str, reason: &str) -> Result<Tally, FleetError> {
        let name = &self.source(source)?.name;
        let row = lost(name, &self.config, kind, reason);
        let entry = entry(name, row, &self.config);
        self.take(source, Some(entry))
    }

    fn source(&self, index: usize) -> Result<&Source, FleetError> {
        let source = self.sources.get(index);
        source.ok_or_else(|| FleetError::WorkerResult(format!("source {index}")))
    }

    pub(super) fn take(
        &mut self,
        source: usize,
        entry: Option<Entry>,
    ) -> Result<Tally, FleetError> {
        let name = &self.source(source)?.name;
        if self.rows[source].is_some() {
            return Ok(self.tally);
        }
        let (place, row) = match entry {
            Some(entry) => (self.journal.append(&entry)?, entry.row),
            None => {
                let place = self.before.get(name).cloned();
                let place = place.ok_or_else(|| FleetError::WorkerResult(name.clone()))?;
                self.tally.reused += 1;
                let row = self.journal.row(&place)?;
                (place, row)
            }
        };
        self.rows[source] = Some(place);
        self.tally.done += 1;
        self.tally.failed += usize::from(row.text("status") == Some("failed"));
        self.tally.samples += row.number("samples").unwrap_or(0.0) as u64;
        Ok(self.tally)
    }

    /// Fields of the metadata: names that the table already uses get the prefix `dataset_`.
    fn metadata(&self) -> Vec<(String, Field)> {
        let mut kinds: BTreeMap<&String, Option<Kind>> = BTreeMap::new();
        for (name, cell) in self.sources.iter().flat_map(|source| &source.metadata) {
            let kind = kinds.entry(name).or_insert(None);
            *kind = common(*kind, cell.kind());
        }
        let own: Vec<String> = columns().into_iter().map(|field| field.name).collect();
        let fields = kinds.into_iter().map(|(name, kind)| {
            let called = if own.contains(name) { format!("dataset_{name}") } else { name.clone() };
            (name.clone(), Field::new(called, kind.unwrap_or(Kind::Text)))
        });
        fields.collect()
    }

    /// Writes the table and removes the journal.
    ///
    /// # Errors
    /// [`FleetError::Output`]; [`FleetError::WorkerResult`] if a source is missing.
    pub fn write(mut self) -> Result<Fleet, FleetError> {
        let metadata = self.metadata();
        let mut fields = columns();
        // After the path.
        fields.splice(1..1, metadata.iter().map(|(_, field)| field.clone()));
        let mut writer = TableWriter::create(&self.table, &fields)?;
        let mut records = Vec::with_capacity(self.rows.len());
        let mut piece: Vec<Column> = fields.iter().map(|field| Column::new(field.kind)).collect();
        for (Source { name, metadata: own, .. }, place) in self.sources.into_iter().zip(&self.rows)
        {
            let place = place
                .as_ref()
                .ok_or_else(|| FleetError::WorkerResult(format!("{name} is missing")))?;
            let row = self.journal.row(place)?;
            let empty = FleetCell::Empty;
            let cells = metadata.iter().map(|(name, _)| own.get(name).unwrap_or(&empty));
            let (first, rest) = row.cells.split_at(1);
            let cells = first.iter().chain(cells).chain(rest);
            cells.zip(&mut piece).for_each(|(cell, column)| push(column, cell));
            let kept = KEPT.iter().filter_map(|name| Some((name.as_str(), row.get(name)?.clone())));
            records.push(Record {
                cells: kept.filter(|(_, cell)| *cell != FleetCell::Empty).collect(),
                metadata: own,
            });
            if piece[0].len() == PIECE {
                writer.write(&piece)?;
                piece.iter_mut().for_each(Column::clear);
            }
        }
        writer.write(&piece)?;
        writer.commit()?;
        self.journal.remove()?;
        let metadata = metadata.into_iter().map(|(_, field)| field).collect();
        Ok(Fleet { tally: self.tally, metadata, records })
    }
}
