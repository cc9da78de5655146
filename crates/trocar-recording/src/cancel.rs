//! Cancellation of long computations.
//!
//! [`Cancel::run`] works on its own threads, which check the flag after each piece of a recording
//! that is smoothed and each simulation of a model over some readings. Cancelled work unwinds from
//! there: its data are dropped and nothing remains.
//! With its own threads a process created by `fork` also finds none missing.

use std::any::Any;
use std::cell::OnceCell;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

thread_local! {
    /// The flag of the work of this thread.
    static FLAG: OnceCell<Arc<AtomicBool>> = const { OnceCell::new() };
}

/// A flag that cancels the work run with it; clones share the flag.
#[derive(Debug, Clone, Default)]
pub struct Cancel(Arc<AtomicBool>);

/// Why work did not finish.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Stopped {
    /// It was cancelled.
    #[error("cancelled")]
    Cancelled,
    /// No threads can be started.
    #[error("cannot start threads: {0}")]
    NoThreads(#[from] rayon::ThreadPoolBuildError),
}

/// Payload of the unwinding.
struct Unwinding;

impl Cancel {
    /// Cancels the work; it ends within milliseconds.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Does `work` on `threads` threads (0: one per processor; at most [`most_threads`]) and waits
    /// for it.
    ///
    /// # Errors
    /// [`Stopped`] when the work was cancelled or could not begin.
    ///
    /// # Panics
    /// As `work` does.
    pub fn run<T: Send>(
        &self,
        threads: usize,
        work: impl FnOnce() -> T + Send,
    ) -> Result<T, Stopped> {
        let flag = self.0.clone();
        let threads = threads.min(most_threads());
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .start_handler(move |_| FLAG.with(|own| drop(own.set(flag.clone()))))
            .build()?;
        catch_unwind(AssertUnwindSafe(|| pool.install(work))).map_err(|why| {
            match why.downcast::<Unwinding>() {
                Ok(_) => Stopped::Cancelled,
                Err(panic) => resume_unwind(panic),
            }
        })
    }
}

/// The number of threads for a number that was asked for, 0: one per processor.
pub fn threads(wanted: usize) -> usize {
    if wanted == 0 { processors() } else { wanted.min(most_threads()) }
}

/// Maximum number of threads, whatever was requested: four per processor, or 64 if that is more.
/// More threads are not faster, and thousands take longer to start than most work takes.
pub fn most_threads() -> usize {
    (4 * processors()).max(64)
}

/// Processors available to this process.
fn processors() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Whether the payload is a cancellation and not a panic.
pub fn is_cancelled(unwinding: &(dyn Any + Send)) -> bool {
    unwinding.is::<Unwinding>()
}

/// Whether the work of this thread was cancelled: for many short pieces, which take longer to unwind
/// than to skip.
pub fn is_requested() -> bool {
    FLAG.with(|own| own.get().is_some_and(|flag| flag.load(Ordering::Relaxed)))
}

/// Unwinds if the work of this thread was cancelled.
pub fn check() {
    if is_requested() {
        // Not a panic, so no message is printed.
        resume_unwind(Box::new(Unwinding));
    }
}
