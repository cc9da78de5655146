//! Long work that somebody may call off.
//!
//! [`Cancel::run`] does work on threads of its own, and those look at the flag wherever a model has been run along some
//! readings. Work that is called off unwinds from there: what it held is dropped, nothing of it is left behind. Threads
//! of its own also mean that a process which was split off (`fork`) finds none missing.

use std::any::Any;
use std::cell::OnceCell;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

thread_local! {
    /// The flag of the work that this thread belongs to.
    static FLAG: OnceCell<Arc<AtomicBool>> = const { OnceCell::new() };
}

/// A flag that calls off the work run under it; clones are the same flag.
#[derive(Debug, Clone, Default)]
pub struct Cancel(Arc<AtomicBool>);

/// Why work did not come to its end.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Stopped {
    /// It was called off.
    #[error("called off")]
    Cancelled,
    /// There are no threads to do it on.
    #[error("cannot start threads: {0}")]
    NoThreads(#[from] rayon::ThreadPoolBuildError),
}

/// What unwinds.
struct CalledOff;

impl Cancel {
    /// Calls off the work; it ends within milliseconds.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Does `work` on `threads` threads (0: one for each processor; [`most_threads`] at the most) and waits for it.
    ///
    /// # Errors
    /// [`Stopped`] when it was called off, or could not begin.
    ///
    /// # Panics
    /// As `work` does.
    pub fn run<T: Send>(&self, threads: usize, work: impl FnOnce() -> T + Send) -> Result<T, Stopped> {
        let flag = self.0.clone();
        let take_flag = move |_| FLAG.with(|own| drop(own.set(flag.clone())));
        let threads = threads.min(most_threads());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).start_handler(take_flag).build()?;
        let called_off_or_panic = |why: Box<dyn Any + Send>| match why.downcast::<CalledOff>() {
            Ok(_) => Stopped::Cancelled,
            Err(panic) => resume_unwind(panic),
        };
        catch_unwind(AssertUnwindSafe(|| pool.install(work))).map_err(called_off_or_panic)
    }
}

/// Threads that work is done on at the most, however many are asked for: four for each processor, or 64 where that is more.
/// More make nothing faster, and thousands take longer to start than most work.
pub fn most_threads() -> usize {
    (4 * processors()).max(64)
}

/// Processors that this process may use.
pub(crate) fn processors() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Whether what unwinds is work that was called off, and no panic.
pub(crate) fn is_called_off(unwinding: &(dyn Any + Send)) -> bool {
    unwinding.is::<CalledOff>()
}

/// Unwinds where the work that this thread belongs to was called off.
pub(crate) fn check() {
    let is_called_off = FLAG.with(|own| own.get().is_some_and(|flag| flag.load(Ordering::Relaxed)));
    if is_called_off {
        // No panic: no message is printed.
        resume_unwind(Box::new(CalledOff));
    }
}
