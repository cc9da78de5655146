//! Work that lasts, on threads of its own: the interpreter stays free for others, and Ctrl-C
//! arrives.

use std::any::Any;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::Builder;
use std::time::Duration;

use pyo3::prelude::*;
use trocar::cancel::{Cancel, Stopped};
use trocar::identify::Progress;

use crate::errors::{InternalError, Raise};

/// Time between two looks at the signals.
const POLL: Duration = Duration::from_millis(50);

/// The stages since somebody was told, with the part done in each.
type News = Arc<Mutex<Vec<(String, f64)>>>;

/// Somebody in Python to tell how far the work is, and how many threads it may take (0: one for
/// each processor).
#[derive(Default)]
pub(crate) struct How {
    pub(crate) progress: Option<Py<PyAny>>,
    pub(crate) threads: usize,
}

/// Does `work` without the interpreter's lock; it reports how far it is.
///
/// An exception of a signal handler (`KeyboardInterrupt`) or of `progress` ends the wait at once;
/// the work itself is cancelled and ends soon after, by itself.
pub(crate) fn run<T: Send + 'static>(
    py: Python<'_>,
    how: How,
    work: impl FnOnce(Progress<'_>) -> T + Send + 'static,
) -> PyResult<T> {
    let news = News::default();
    let (cancel, latest) = (Cancel::default(), news.clone());
    let report = move |stage: &str, part: f64| {
        let mut stages = latest.lock().unwrap_or_else(PoisonError::into_inner);
        stages.pop_if(|(last, _)| last == stage);
        stages.push((stage.to_owned(), part));
    };
    let (sender, receiver) = mpsc::channel();
    let (flag, threads) = (cancel.clone(), how.threads);
    thread().spawn(move || {
        let outcome = catch_unwind(AssertUnwindSafe(|| flag.run(threads, || work(&report))));
        // Nobody listens any more to work that was cancelled.
        let _ = sender.send(outcome);
    })?;
    outcome(py, receiver, &cancel, how.progress.as_ref(), &news)
}

/// The same for work that may fail.
pub(crate) fn attempt<T: Send + 'static, E: Raise + Send + 'static>(
    py: Python<'_>,
    how: How,
    work: impl FnOnce(Progress<'_>) -> Result<T, E> + Send + 'static,
) -> PyResult<T> {
    run(py, how, work)?.map_err(Raise::raise)
}

/// Does short work on `count` samples without the interpreter's lock, and looks at the signals after
/// each `chunk` of them.
pub(crate) fn in_chunks(
    py: Python<'_>,
    count: usize,
    chunk: usize,
    mut work: impl FnMut(Range<usize>) + Send,
) -> PyResult<()> {
    for first in (0..count).step_by(chunk) {
        let range = first..count.min(first + chunk);
        py.detach(|| work(range));
        py.check_signals()?;
    }
    Ok(())
}

/// The same as [`run`] for work on memory of the caller, such as arrays of Python: an exception ends the wait
/// once the work has ended, some ten milliseconds later.
pub(crate) fn run_borrowing<T: Send>(
    py: Python<'_>,
    threads: usize,
    work: impl FnOnce() -> T + Send,
) -> PyResult<T> {
    let cancel = Cancel::default();
    let (sender, receiver) = mpsc::channel();
    let flag = cancel.clone();
    let task = move || {
        let outcome = catch_unwind(AssertUnwindSafe(|| flag.run(threads, work)));
        // As above.
        let _ = sender.send(outcome);
    };
    std::thread::scope(|scope| {
        let worker = thread().spawn_scoped(scope, task)?;
        let done = outcome(py, receiver, &cancel, None, &News::default());
        // Its panics were caught; other threads of Python run until it has ended.
        let _ = py.detach(|| worker.join());
        done
    })
}

fn thread() -> Builder {
    Builder::new().name("trocar".to_owned())
}

/// What the work sends when it has ended.
type Ended<T> = Result<Result<T, Stopped>, Box<dyn Any + Send>>;

/// Waits for the work, and calls it off where somebody interrupts.
fn outcome<T: Send>(
    py: Python<'_>,
    mut receiver: Receiver<Ended<T>>,
    cancel: &Cancel,
    progress: Option<&Py<PyAny>>,
    news: &News,
) -> PyResult<T> {
    loop {
        let outcome;
        (receiver, outcome) = py.detach(move || wait(receiver));
        match outcome {
            Ok(Ok(Ok(done))) => return tell(py, progress, news).map(|()| done),
            Ok(Ok(Err(stopped))) => return Err(InternalError::new_err(stopped_in_words(&stopped))),
            Ok(Err(panic)) => return Err(InternalError::new_err(panic_in_words(panic.as_ref()))),
            Err(RecvTimeoutError::Disconnected) => {
                return Err(InternalError::new_err("the result of the computation was lost"));
            }
            Err(RecvTimeoutError::Timeout) => {
                let reported = py.check_signals().and_then(|()| tell(py, progress, news));
                reported.inspect_err(|_| cancel.cancel())?;
            }
        }
    }
}

fn wait<T: Send>(receiver: Receiver<T>) -> (Receiver<T>, Result<T, RecvTimeoutError>) {
    let outcome = receiver.recv_timeout(POLL);
    (receiver, outcome)
}

fn tell(py: Python<'_>, progress: Option<&Py<PyAny>>, news: &News) -> PyResult<()> {
    let stages = std::mem::take(&mut *news.lock().unwrap_or_else(PoisonError::into_inner));
    let Some(progress) = progress else { return Ok(()) };
    stages.into_iter().try_for_each(|stage| progress.call1(py, stage).map(drop))
}

fn stopped_in_words(stopped: &Stopped) -> String {
    format!("the computation did not finish: {stopped}")
}

fn panic_in_words(panic: &(dyn Any + Send)) -> String {
    let text = panic
        .downcast_ref::<&str>()
        .copied()
        .or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    format!("a defect of trocar, please report it: {}", text.unwrap_or("without a message"))
}
