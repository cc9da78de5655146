//! The same table from work done elsewhere: in other processes, on other machines, distributed by
//! any engine.
//!
//! ```text
//! Collector: sources, what the journal has ──▶ anywhere: identify_source, pure ──▶ text ──▶ Collector: journal ──▶ table
//! ```

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::sync::mpsc;

use serde::{Deserialize, Serialize};

use super::{Finished, Fleet, FleetError, Gathered, RowSource, Tally, finish};
use crate::fleet::dataset::{Dataset, Metadata, Source};
use crate::fleet::journal::{Entry, EntryLocation, Journal};
use crate::fleet::one::{Config, refused};
use crate::fleet::row::FleetCell;
use trocar_tables::error::OutputError;

/// A unit of work for a worker, with the results already known.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Order {
    source: Source,
    /// Hashes of recordings finished before, by name.
    known: BTreeMap<String, String>,
}

/// A finished recording returned by a worker; without an entry if the journal has it.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct WorkerResult {
    name: String,
    metadata: Metadata,
    entry: Option<Entry>,
}

/// Identifies all recordings of one source: `order` is one of [`Collector::orders`], the result is
/// for [`Collector::add`]. A pure function of the files and `config`; recordings that fail are
/// rows.
///
/// # Errors
/// Text that is not an order.
pub fn identify_source(order: &str, config: &Config) -> Result<String, serde_json::Error> {
    let Order { source, known } = serde_json::from_str(order)?;
    let place =
        |(name, sha256): (String, String)| (name, EntryLocation { at: 0, length: 0, sha256 });
    let before: HashMap<String, EntryLocation> = known.into_iter().map(place).collect();
    let parts: Vec<WorkerResult> = match source.jobs() {
        Ok(jobs) => jobs
            .into_iter()
            .map(|job| part(job.name.clone(), finish((0, 0), job, config, &before)))
            .collect(),
        Err(error) => {
            let whole = source.whole();
            let row = refused(&whole.name, config, error);
            vec![part(
                whole.name.clone(),
                Finished::now((0, 0), whole.metadata, whole.name, row, config),
            )]
        }
    };
    serde_json::to_string(&parts)
}

fn part(name: String, Finished { metadata, done, .. }: Finished) -> WorkerResult {
    let entry = match done {
        RowSource::New(entry) => Some(*entry),
        RowSource::Journal(_) => None,
    };
    WorkerResult { name, metadata, entry }
}

/// Collects the results from elsewhere, in any order, and writes the same table as
/// [`run`](super::run).
pub struct Collector {
    sources: Vec<Source>,
    config: Config,
    table: PathBuf,
    before: HashMap<String, EntryLocation>,
    journal: Journal,
    gathered: Gathered,
    added: BTreeSet<usize>,
}

impl Collector {
    /// Opens the journal of `table`.
    ///
    /// # Errors
    /// [`OutputError`] when it cannot be written, another process is writing it, or a recording would
    /// be replaced.
    pub fn open(dataset: Dataset, config: &Config, table: &Path) -> Result<Self, OutputError> {
        let (journal, before) = Journal::open(&dataset, table, config)?;
        let gathered = Gathered::new(dataset.sources.len());
        let (sources, table) = (dataset.sources, table.to_owned());
        Ok(Self {
            sources,
            config: config.clone(),
            table,
            before,
            journal,
            gathered,
            added: BTreeSet::new(),
        })
    }

    /// One order per source, in the order of the table.
    ///
    /// # Errors
    /// A path that is not valid text.
    pub fn orders(&self) -> Result<Vec<String>, serde_json::Error> {
        let mut known: HashMap<&str, BTreeMap<String, String>> = HashMap::new();
        for (name, place) in &self.before {
            // `file#recording`, or the file itself.
            for of in [Some(name.as_str()), name.rsplit_once('#').map(|(file, _)| file)]
                .into_iter()
                .flatten()
            {
                known.entry(of).or_default().insert(name.clone(), place.sha256.clone());
            }
        }
        let order = |source: &Source| {
            let known = known.remove(source.name.as_str()).unwrap_or_default();
            serde_json::to_string(&Order { source: source.clone(), known })
        };
        self.sources.iter().map(order).collect()
    }

    /// Adds the result of [`identify_source`] for the order at `source`; adding it twice has no
    /// effect.
    ///
    /// # Errors
    /// [`FleetError::Output`] when the journal cannot be written; [`FleetError::WorkerResult`] for
    /// text from another origin.
    pub fn add(&mut self, source: usize, parts: &str) -> Result<Tally, FleetError> {
        let parts: Vec<WorkerResult> = serde_json::from_str(parts)
            .map_err(|error| FleetError::WorkerResult(error.to_string()))?;
        let mut all = Vec::with_capacity(parts.len());
        for (k, WorkerResult { name, metadata, entry }) in parts.into_iter().enumerate() {
            let done = match entry {
                Some(entry) => RowSource::New(Box::new(entry)),
                None => RowSource::Journal(
                    self.before
                        .get(&name)
                        .cloned()
                        .ok_or_else(|| FleetError::WorkerResult(name.clone()))?,
                ),
            };
            all.push(Finished { order: (source, k), metadata, done });
        }
        self.take(source, all)
    }

    /// Records a source that could not be finished, with the reason: a failed row, which is tried
    /// again when the work is resumed.
    ///
    /// # Errors
    /// As for [`Collector::add`].
    pub fn lose(&mut self, source: usize, kind: &str, reason: &str) -> Result<Tally, FleetError> {
        let Some(lost) = self.sources.get(source) else {
            return Err(FleetError::WorkerResult(format!("source {source}")));
        };
        let mut row = refused(&lost.name, &self.config, reason.to_owned());
        row.set("reason_kind", FleetCell::text(kind));
        let whole = lost.whole();
        let finished = Finished::now((source, 0), whole.metadata, whole.name, row, &self.config);
        self.take(source, vec![finished])
    }

    fn take(&mut self, source: usize, all: Vec<Finished>) -> Result<Tally, FleetError> {
        if source >= self.sources.len() {
            return Err(FleetError::WorkerResult(format!("source {source}")));
        }
        if self.added.insert(source) {
            let (sender, receiver) = mpsc::channel();
            for finished in all {
                // The receiver is used below.
                let _ = sender.send(finished);
            }
            drop(sender);
            self.gathered.gather(&receiver, &mut self.journal, &mut |_| ())?;
        }
        Ok(self.gathered.tally)
    }

    /// Writes the table and removes the journal.
    ///
    /// # Errors
    /// [`FleetError::Output`]; [`FleetError::WorkerResult`] if a source is missing.
    pub fn write(mut self) -> Result<Fleet, FleetError> {
        if let Some(missing) = (0..self.sources.len()).find(|source| !self.added.contains(source)) {
            return Err(FleetError::WorkerResult(format!(
                "{} is missing",
                self.sources[missing].name
            )));
        }
        let fleet = self.gathered.write(&mut self.journal, &self.table)?;
        self.journal.remove()?;
        Ok(fleet)
    }
}
