//! Work that lasts, on threads of its own: the interpreter stays free for others, and Ctrl-C arrives.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use pyo3::prelude::*;
use trocar::cancel::{Cancel, Stopped};

use crate::errors::InternalError;

/// Time between two looks at the signals.
const POLL: Duration = Duration::from_millis(50);

/// Stage and part done, if there is news.
type News = Arc<Mutex<Option<(String, f64)>>>;

/// Somebody in Python to tell how far the work is, and how many threads it may take (0: one for each processor).
#[derive(Default)]
pub(crate) struct How {
    pub(crate) progress: Option<Py<PyAny>>,
    pub(crate) threads: usize,
}

/// How far the work is: for the library's `progress`.
pub(crate) struct Report(News);

impl Report {
    pub(crate) fn tell(&self, stage: &str, part: f64) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some((stage.to_owned(), part));
    }
}

/// Does `work` without the interpreter's lock.
///
/// An exception of a signal handler (`KeyboardInterrupt`) or of `progress` ends the wait at once; the work itself is
/// called off and ends soon after, by itself.
pub(crate) fn run<T: Send + 'static>(
    py: Python<'_>,
    how: How,
    work: impl FnOnce(&Report) -> T + Send + 'static,
) -> PyResult<T> {
    let news = News::default();
    let (cancel, report) = (Cancel::default(), Report(news.clone()));
    let (sender, mut receiver) = mpsc::channel();
    let (flag, threads) = (cancel.clone(), how.threads);
    let task = move || {
        let outcome = catch_unwind(AssertUnwindSafe(|| flag.run(threads, || work(&report))));
        // Nobody listens any more to work that was called off.
        let _ = sender.send(outcome);
    };
    std::thread::Builder::new().name("trocar".to_owned()).spawn(task)?;
    loop {
        let outcome;
        (receiver, outcome) = py.detach(move || wait(receiver));
        match outcome {
            Ok(Ok(Ok(done))) => return Ok(done),
            Ok(Ok(Err(stopped))) => return Err(InternalError::new_err(stopped_in_words(&stopped))),
            Ok(Err(panic)) => return Err(InternalError::new_err(panic_in_words(panic.as_ref()))),
            Err(RecvTimeoutError::Disconnected) => return Err(InternalError::new_err("the work was lost")),
            Err(RecvTimeoutError::Timeout) => {
                let told = py.check_signals().and_then(|()| tell(py, how.progress.as_ref(), &news));
                told.inspect_err(|_| cancel.cancel())?;
            }
        }
    }
}

fn wait<T>(receiver: Receiver<T>) -> (Receiver<T>, Result<T, RecvTimeoutError>) {
    let outcome = receiver.recv_timeout(POLL);
    (receiver, outcome)
}

fn tell(py: Python<'_>, progress: Option<&Py<PyAny>>, news: &News) -> PyResult<()> {
    let latest = news.lock().unwrap_or_else(PoisonError::into_inner).take();
    match (progress, latest) {
        (Some(progress), Some(news)) => progress.call1(py, news).map(drop),
        _ => Ok(()),
    }
}

fn stopped_in_words(stopped: &Stopped) -> String {
    format!("the work did not come to its end: {stopped}")
}

fn panic_in_words(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().copied().or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    format!("a fault inside trocar, please report it: {}", text.unwrap_or("without a message"))
}
