//! A progress bar for long computations: on a terminal, after a second, and not with `--quiet`.

use std::io::IsTerminal;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread::JoinHandle;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};

use crate::console::Console;

/// Shorter computations show no bar.
const PATIENCE: Duration = Duration::from_secs(1);

/// Steps of the bar: a tenth of a percent each.
const STEPS: f64 = 1000.0;

/// A bar that appears after a delay and disappears when it is dropped.
pub(crate) struct Progress {
    bar: ProgressBar,
    waiting: Option<(mpsc::Sender<()>, JoinHandle<()>)>,
}

impl Progress {
    /// A bar for a known amount of work.
    pub(crate) fn new(console: &Console) -> Self {
        let bar = ProgressBar::with_draw_target(Some(STEPS as u64), ProgressDrawTarget::hidden());
        let style = ProgressStyle::with_template(
            "{spinner} {msg:22} {wide_bar} {percent:>3} %  {elapsed}{left}",
        );
        bar.set_style(style.expect("the template is well formed").with_key("left", left));
        let visible = !console.quiet && std::io::stderr().is_terminal();
        Self { waiting: visible.then(|| appear_later(bar.clone())), bar }
    }

    /// The same with the number of rows so far and the rows per second.
    pub(crate) fn report_rows(&self, stage: &str, part: f64, rows: u64) {
        let seconds = self.bar.elapsed().as_secs_f64();
        let rate = if seconds > 0.0 { rows as f64 / seconds } else { 0.0 };
        self.report(
            &format!("{stage} {:.1} M rows, {:.2} M/s", 1e-6 * rows as f64, 1e-6 * rate),
            part,
        );
    }

    /// Sets the stage and the completed fraction, 0 to 1.
    pub(crate) fn report(&self, stage: &str, part: f64) {
        self.bar.set_message(stage.to_owned());
        self.bar.set_position((STEPS * part.clamp(0.0, 1.0)) as u64);
    }
}

/// Time left, from the work done so far and its time: a stage that takes long makes it grow, never
/// 0 s. Nothing before a twentieth of the work.
fn left(state: &ProgressState, out: &mut dyn std::fmt::Write) {
    let part = f64::from(state.fraction());
    if (0.05..1.0).contains(&part) {
        let seconds = (state.elapsed().as_secs_f64() * (1.0 - part) / part).ceil();
        let _ = write!(out, ", about {seconds} s left");
    }
}

/// Shows the bar if the sender still exists after the delay.
fn appear_later(bar: ProgressBar) -> (mpsc::Sender<()>, JoinHandle<()>) {
    let (sender, receiver) = mpsc::channel();
    (
        sender,
        std::thread::spawn(move || {
            if receiver.recv_timeout(PATIENCE) == Err(RecvTimeoutError::Timeout) {
                bar.set_draw_target(ProgressDrawTarget::stderr());
                bar.enable_steady_tick(Duration::from_millis(100));
            }
        }),
    )
}

impl Drop for Progress {
    fn drop(&mut self) {
        if let Some((sender, thread)) = self.waiting.take() {
            drop(sender);
            // The thread only waits; a panic there would have been printed.
            let _ = thread.join();
        }
        self.bar.finish_and_clear();
    }
}
