//! Identifies all recordings of a data set on all cores into one table; finished ones are reused
//! from the journal.

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::path::Path;
use std::sync::LazyLock;
use std::sync::mpsc::{self, Receiver, Sender};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use trocar_model::{Direction, ParameterId, Quantity};

use super::dataset::{Dataset, Job, Metadata};
use super::journal::{Entry, EntryLocation, Journal};
use super::one::{Config, hash_of, identify_one, is_passing, refused, warn};
use super::row::{ENDS, FleetCell, FleetRow, columns};
use trocar_simulate::cancel::{self, Cancel, Stopped};
use trocar_tables::error::OutputError;
use trocar_tables::table::{Column, Field, Kind, TableWriter};

pub use elsewhere::{Collector, identify_source};

mod elsewhere;

/// Rows of the table held in memory at a time.
const PIECE: usize = 1024;

/// Why there is no table.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FleetError {
    /// Table or journal cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The result of a worker does not match its order.
    #[error("the result of a worker does not match its order: {0}")]
    WorkerResult(String),
    /// Cancelled; the journal is kept.
    #[error(transparent)]
    Stopped(#[from] Stopped),
}

/// Progress of the work.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Tally {
    /// Known recordings: files, until they are found to hold several.
    pub total: usize,
    /// Recordings with a row.
    pub done: usize,
    /// Number of these reused from the journal.
    pub reused: usize,
    /// Number of these that failed.
    pub failed: usize,
    /// Samples of all recordings with a row.
    pub samples: u64,
}

/// Result for a data set.
#[derive(Debug, Clone, PartialEq)]
pub struct Fleet {
    /// Counts.
    pub tally: Tally,
    /// Metadata columns of the recordings, as named in the table.
    pub metadata: Vec<Field>,
    /// Data of the report: one record per recording, in the order of the table.
    pub records: Vec<Record>,
}

/// The part of a row that is kept in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// Metadata of the recording.
    pub metadata: Metadata,
    /// Cells of the columns that are kept, by name.
    pub cells: BTreeMap<&'static str, FleetCell>,
}

impl Record {
    /// The cell in a column.
    pub fn cell(&self, name: &str) -> Option<&FleetCell> {
        self.cells.get(name)
    }

    /// The number in a column.
    pub fn number(&self, name: &str) -> Option<f64> {
        self.cell(name)?.as_number()
    }

    /// The text in a column.
    pub fn text(&self, name: &str) -> Option<&str> {
        self.cells.get(name)?.as_text()
    }
}

/// Columns kept in records.
pub static KEPT: LazyLock<Vec<String>> = LazyLock::new(|| {
    let plain = [
        "path",
        "status",
        "reason_kind",
        "reason",
        "method",
        "warning_count",
        "samples",
        "residual_rms_n",
        "force_rms_n",
        "depth",
        "duration_s",
    ];
    let with_ends = |id: ParameterId| ENDS.map(|(end, _)| format!("{id}{end}"));
    let parameters = KEPT_PARAMETERS.into_iter().flat_map(with_ends);
    plain.into_iter().map(str::to_owned).chain(parameters).collect()
});

/// Parameters kept in records.
const KEPT_PARAMETERS: [ParameterId; 6] = [
    Quantity::Offset.id(),
    Quantity::CoulombForce.id(),
    Quantity::CoulombForceWithOffset.of(Direction::Insertion),
    Quantity::CoulombForceWithOffset.of(Direction::Withdrawal),
    Quantity::ViscousDamping.id(),
    Quantity::HalfWidth.id(),
];

/// Position in the table: index of the source, and of the recording in it.
type Order = (usize, usize);

/// A finished recording for the journal.
struct Finished {
    order: Order,
    metadata: Metadata,
    done: RowSource,
}

enum RowSource {
    New(Box<Entry>),
    Journal(EntryLocation),
}

/// Identifies every recording of `dataset` on its own, on `threads` threads (0: one per processor;
/// at most [`cancel::most_threads`]), and writes the table at `table`.
///
/// The same recordings, configuration and program give the same bytes, regardless of the number of
/// threads and of interruptions. Memory: for each thread a recording and its identification, a few
/// hundred bytes for each finished recording, and 1024 rows.
///
/// # Errors
/// [`FleetError`] when table or journal cannot be written, would replace a recording, or the work was
/// cancelled. Recordings
/// that fail are rows.
pub fn run(
    dataset: &Dataset,
    config: &Config,
    table: &Path,
    threads: usize,
    cancel: &Cancel,
    progress: &mut dyn FnMut(&Tally),
) -> Result<Fleet, FleetError> {
    let (mut journal, before) = Journal::open(dataset, table, config)?;
    let threads =
        if threads == 0 { cancel::processors() } else { threads.min(cancel::most_threads()) };
    let queue = Queue::new(dataset);
    let mut gathered = Gathered::new(dataset.sources.len());
    let worker = |sender: Sender<Finished>| cancel.run(1, || queue.work(config, &before, &sender));
    let outcome = std::thread::scope(|scope| {
        let (sender, receiver) = mpsc::channel();
        let workers: Vec<_> = (0..threads)
            .map(|_| {
                let (worker, sender) = (&worker, sender.clone());
                scope.spawn(move || worker(sender))
            })
            .collect();
        drop(sender);
        let outcome = gathered.gather(&receiver, &mut journal, progress);
        if outcome.is_err() {
            queue.stop();
        }
        drop(receiver);
        let stopped =
            workers.into_iter().map(|worker| worker.join().unwrap_or(Err(Stopped::Cancelled)));
        let stopped: Vec<Result<(), Stopped>> = stopped.collect();
        outcome?;
        stopped.into_iter().collect::<Result<Vec<()>, Stopped>>().map_err(FleetError::from)
    });
    outcome?;
    let fleet = gathered.write(&mut journal, table)?;
    journal.remove()?;
    Ok(fleet)
}

/// The remaining work.
struct Queue<'a> {
    dataset: &'a Dataset,
    left: Mutex<RemainingWork>,
    changed: Condvar,
}

struct RemainingWork {
    next_source: usize,
    jobs: VecDeque<(Order, Job)>,
    /// Sources that are being opened: more jobs may follow.
    opening: usize,
}

impl<'a> Queue<'a> {
    fn new(dataset: &'a Dataset) -> Self {
        let left = RemainingWork { next_source: 0, jobs: VecDeque::new(), opening: 0 };
        Self { dataset, left: Mutex::new(left), changed: Condvar::new() }
    }

    fn lock(&self) -> MutexGuard<'_, RemainingWork> {
        self.left.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn stop(&self) {
        let mut left = self.lock();
        left.next_source = self.dataset.sources.len();
        left.jobs.clear();
    }

    /// Works until the queue is empty.
    fn work(
        &self,
        config: &Config,
        before: &HashMap<String, EntryLocation>,
        sender: &Sender<Finished>,
    ) {
        while let Some((order, job)) = self.next(config, sender) {
            cancel::check();
            let finished = finish(order, job, config, before);
            if sender.send(finished).is_err() {
                return;
            }
        }
    }

    /// The next recording; opens the next source if none is waiting.
    fn next(&self, config: &Config, sender: &Sender<Finished>) -> Option<(Order, Job)> {
        let mut left = self.lock();
        loop {
            if let Some(job) = left.jobs.pop_front() {
                return Some(job);
            }
            let source = left.next_source;
            if let Some(opened) = self.dataset.sources.get(source) {
                left.next_source += 1;
                left.opening += 1;
                drop(left);
                let jobs = opened.jobs();
                left = self.lock();
                left.opening -= 1;
                match jobs {
                    Ok(jobs) => left
                        .jobs
                        .extend(jobs.into_iter().enumerate().map(|(k, job)| ((source, k), job))),
                    Err(error) => {
                        let job = opened.whole();
                        let row = refused(&opened.name, config, error);
                        // A closed receiver is noticed at the next recording.
                        let _ = sender.send(Finished::now(
                            (source, 0),
                            job.metadata,
                            job.name,
                            row,
                            config,
                        ));
                    }
                }
                self.changed.notify_all();
            } else if left.opening > 0 {
                left = self.changed.wait(left).unwrap_or_else(PoisonError::into_inner);
            } else {
                return None;
            }
        }
    }
}

impl Finished {
    fn now(order: Order, metadata: Metadata, name: String, row: FleetRow, config: &Config) -> Self {
        let sha256 = row.text("sha256").unwrap_or_default().to_owned();
        let entry = Entry { name, sha256, config: config.hash(), row };
        Self { order, metadata, done: RowSource::New(Box::new(entry)) }
    }
}

/// One recording: reused if it equals the one in the journal, otherwise identified.
fn finish(
    order: Order,
    mut job: Job,
    config: &Config,
    before: &HashMap<String, EntryLocation>,
) -> Finished {
    let input = match job.input(&config.reading_ahead()) {
        Ok(input) => input,
        Err(error) => {
            let row = refused(&job.name, config, error);
            return Finished::now(order, job.metadata, job.name, row, config);
        }
    };
    if let Some(place) = before.get(&job.name)
        && hash_of(&input, config).is_some_and(|hash| hash == place.sha256)
    {
        return Finished { order, metadata: job.metadata, done: RowSource::Journal(place.clone()) };
    }
    let mut row = identify_one(&input, config);
    row.set("path", FleetCell::text(&job.name));
    if job.is_file()
        && let Some(reason) = row.text("reason")
    {
        // Without paths of this machine.
        let reason = reason.replace(&job.path.display().to_string(), &job.name);
        row.set("reason", FleetCell::text(reason));
    }
    if let Some(warning) = &job.warning {
        warn(&mut row, warning);
    }
    Finished::now(order, job.metadata, job.name, row, config)
}

/// Results received from the workers.
struct Gathered {
    rows: BTreeMap<Order, (Metadata, EntryLocation)>,
    tally: Tally,
    kinds: BTreeMap<String, Option<Kind>>,
    /// Sources with at least one finished recording.
    begun: Vec<bool>,
}

impl Gathered {
    fn new(sources: usize) -> Self {
        let tally = Tally { total: sources, ..Tally::default() };
        Self { rows: BTreeMap::new(), tally, kinds: BTreeMap::new(), begun: vec![false; sources] }
    }

    fn gather(
        &mut self,
        receiver: &Receiver<Finished>,
        journal: &mut Journal,
        progress: &mut dyn FnMut(&Tally),
    ) -> Result<(), FleetError> {
        progress(&self.tally);
        for Finished { order, metadata, done } in receiver {
            let (place, row) = match done {
                RowSource::New(entry) => (self.note(&entry, journal)?, entry.row),
                RowSource::Journal(place) => {
                    self.tally.reused += 1;
                    let row = journal.row(&place)?;
                    (place, row)
                }
            };
            self.count(order, &row);
            for (name, cell) in &metadata {
                let kind = self.kinds.entry(name.clone()).or_insert(None);
                *kind = common(*kind, cell.kind());
            }
            self.rows.insert(order, (metadata, place));
            progress(&self.tally);
        }
        Ok(())
    }

    /// Writes an entry to the journal. A failure that may be temporary is written without its hash,
    /// so that the recording is identified again next time.
    fn note(&self, entry: &Entry, journal: &mut Journal) -> Result<EntryLocation, OutputError> {
        if !is_passing(&entry.row) {
            return journal.append(entry);
        }
        journal.append(&Entry { sha256: String::new(), ..entry.clone() })
    }

    fn count(&mut self, (source, _): Order, row: &FleetRow) {
        if std::mem::replace(&mut self.begun[source], true) {
            self.tally.total += 1;
        }
        self.tally.done += 1;
        self.tally.failed += usize::from(row.text("status") == Some("failed"));
        self.tally.samples += row.number("samples").unwrap_or(0.0) as u64;
    }

    /// Fields of the metadata: names that the table already uses get the prefix `dataset_`.
    fn metadata(&self) -> Vec<(String, Field)> {
        let own: Vec<String> = columns().into_iter().map(|field| field.name).collect();
        let field = |(name, kind): (&String, &Option<Kind>)| {
            let called = if own.contains(name) { format!("dataset_{name}") } else { name.clone() };
            (name.clone(), Field::new(called, kind.unwrap_or(Kind::Text)))
        };
        self.kinds.iter().map(field).collect()
    }

    fn write(self, journal: &mut Journal, table: &Path) -> Result<Fleet, FleetError> {
        let metadata = self.metadata();
        let mut fields = columns();
        // After the path.
        fields.splice(1..1, metadata.iter().map(|(_, field)| field.clone()));
        let mut writer = TableWriter::create(table, &fields)?;
        let mut records = Vec::with_capacity(self.rows.len());
        let mut piece: Vec<Column> = fields.iter().map(|field| Column::new(field.kind)).collect();
        for (own, place) in self.rows.into_values() {
            let row = journal.row(&place)?;
            let empty = FleetCell::Empty;
            let cells = metadata.iter().map(|(name, _)| own.get(name).unwrap_or(&empty));
            let (first, rest) = row.cells.split_at(1);
            first
                .iter()
                .chain(cells)
                .chain(rest)
                .zip(&mut piece)
                .for_each(|(cell, column)| push(column, cell));
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
        let metadata = metadata.into_iter().map(|(_, field)| field).collect();
        Ok(Fleet { tally: self.tally, metadata, records })
    }
}

/// The kind that can represent both.
fn common(one: Option<Kind>, other: Option<Kind>) -> Option<Kind> {
    match (one, other) {
        (None, kind) | (kind, None) => kind,
        (Some(one), Some(other)) if one == other => Some(one),
        (Some(Kind::Integer | Kind::Number), Some(Kind::Integer | Kind::Number)) => {
            Some(Kind::Number)
        }
        _ => Some(Kind::Text),
    }
}

fn push(column: &mut Column, cell: &FleetCell) {
    match column {
        Column::Number(cells) => cells.push(cell.as_number().unwrap_or(f64::NAN)),
        Column::Integer(cells) => {
            cells.push(if let FleetCell::Integer(value) = cell { Some(*value) } else { None })
        }
        Column::Boolean(cells) => {
            cells.push(if let FleetCell::Boolean(value) = cell { Some(*value) } else { None })
        }
        Column::Text(cells) => {
            cells.push((*cell != FleetCell::Empty).then(|| cell.in_words().into()))
        }
    }
}
