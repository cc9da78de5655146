//! A progress bar for long computations: on a terminal, after a second, and not with `--quiet`.

use std::io::IsTerminal;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Arc, Mutex, PoisonError};
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
        let style =
            ProgressStyle::with_template("{spinner} {msg:22} {wide_bar} {percent:>3} %  {time}");
        let end = Arc::new(Mutex::new(End::default()));
        let time = move |state: &ProgressState, out: &mut dyn std::fmt::Write| {
            let elapsed = state.elapsed();
            let mut end = end.lock().unwrap_or_else(PoisonError::into_inner);
            let _ = out.write_str(&minutes(elapsed));
            if let Some(left) = end.left(elapsed, f64::from(state.fraction())) {
                let _ = write!(out, ", about {} left", minutes(left));
            }
        };
        bar.set_style(style.expect("the template is well formed").with_key("time", time));
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

/// When the work will have ended, by what was done when it last advanced.
#[derive(Default)]
struct End {
    part: f64,
    at: Duration,
}

impl End {
    /// Time left. `None` before a twentieth of the work, and in a stage that takes longer than all before
    /// it let expect: the time left would grow while one looks at it.
    fn left(&mut self, elapsed: Duration, part: f64) -> Option<Duration> {
        if part > self.part {
            (self.part, self.at) = (part, elapsed.div_f64(part));
        }
        let left = self.at.saturating_sub(elapsed);
        (part >= 0.05 && !left.is_zero()).then_some(left)
    }
}

/// A duration in minutes and seconds.
fn minutes(duration: Duration) -> String {
    match duration.as_secs_f64().ceil() as u64 {
        seconds @ 0..60 => format!("{seconds} s"),
        seconds => format!("{} min {:02} s", seconds / 60, seconds % 60),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_left_never_grows_while_a_stage_goes_on() {
        let (mut end, seconds) = (End::default(), Duration::from_secs);
        assert_eq!(end.left(seconds(1), 0.01), None);
        assert_eq!(end.left(seconds(10), 0.5), Some(seconds(10)));
        assert_eq!(end.left(seconds(15), 0.5), Some(seconds(5)));
        assert_eq!(end.left(seconds(40), 0.5), None);
        assert_eq!(end.left(seconds(40), 0.8), Some(seconds(10)));
        assert_eq!(minutes(seconds(125)), "2 min 05 s");
        assert_eq!(minutes(Duration::from_millis(3200)), "4 s");
    }
}
