//! Identifies all recordings of a data set on all cores into one table; finished ones are reused
//! from the journal.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::LazyLock;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{self, Receiver, Sender};

use trocar_model::{Direction, ParameterId, Quantity};

use super::dataset::{Dataset, Metadata};
use super::journal::Entry;
use super::one::Config;
use super::row::{ENDS, FleetCell};
use trocar_recording::cancel::{self, Cancel, Stopped};
use trocar_tables::error::OutputError;
use trocar_tables::table::{Column, Field, Kind};

use elsewhere::Order;
pub use elsewhere::{Collector, identify_source};

mod elsewhere;

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
    /// Recordings of the data set.
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

impl Fleet {
    /// Recordings with this status: `ok`, `doubtful` or `failed`.
    pub fn count(&self, status: &str) -> usize {
        self.records.iter().filter(|record| record.text("status") == Some(status)).count()
    }
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
    let parameters =
        KEPT_PARAMETERS.into_iter().flat_map(|id| ENDS.map(|(end, _)| format!("{id}{end}")));
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
    let mut collector = Collector::open(dataset, config, table)?;
    let orders = collector.unfinished();
    let next = AtomicUsize::new(0);
    let threads = cancel::threads(threads);
    std::thread::scope(|scope| {
        let (sender, receiver) = mpsc::channel();
        let workers: Vec<_> = (0..threads)
            .map(|_| {
                let (orders, next, sender) = (&orders, &next, sender.clone());
                scope.spawn(move || cancel.run(1, || work(orders, next, config, &sender)))
            })
            .collect();
        // The receiver ends when the last sender is gone: this one never sends.
        drop(sender);
        let gathered = gather(receiver, &mut collector, progress);
        let stopped: Vec<Result<(), Stopped>> = workers
            .into_iter()
            .map(|worker| worker.join().unwrap_or(Err(Stopped::Cancelled)))
            .collect();
        gathered?;
        stopped.into_iter().collect::<Result<(), Stopped>>().map_err(FleetError::from)
    })?;
    collector.write()
}

/// Index of a source, and its row unless the journal has it.
type Finished = (usize, Option<Entry>);

/// Identifies one source after the other until none is left, or nobody receives the results.
fn work(orders: &[Order], next: &AtomicUsize, config: &Config, sender: &Sender<Finished>) {
    while let index = next.fetch_add(1, Ordering::Relaxed)
        && let Some(order) = orders.get(index)
    {
        cancel::check();
        if sender.send((index, order.identify(config))).is_err() {
            return;
        }
    }
}

fn gather(
    receiver: Receiver<Finished>,
    collector: &mut Collector,
    progress: &mut dyn FnMut(&Tally),
) -> Result<(), FleetError> {
    progress(&collector.tally());
    for (source, entry) in receiver {
        progress(&collector.take(source, entry)?);
    }
    Ok(())
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
