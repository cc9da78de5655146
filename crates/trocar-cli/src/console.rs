//! What goes to standard output and standard error, and how errors look and end the process.

use std::fmt::Write as _;
use std::io::{self, Write};
use std::process::ExitCode;
use std::sync::{Mutex, PoisonError};

use trocar::identify::IdentifyError;
use trocar::output::OutputError;
use trocar::recording::RecordingError;
use trocar::simulate::SimulateError;

/// Way out, as the library's messages carry it.
const HINT: &str = "\n\nhint: ";

/// An argument that clap lets through and the verb does not.
#[derive(Debug)]
pub(crate) struct BadArgument(pub(crate) String);

impl std::fmt::Display for BadArgument {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for BadArgument {}

/// Standard error, loud or quiet.
pub(crate) struct Console {
    pub(crate) quiet: bool,
}

impl Console {
    pub(crate) fn new(quiet: bool) -> Self {
        Self { quiet }
    }

    /// A remark that `--quiet` drops.
    pub(crate) fn remark(&self, text: &str) {
        if !self.quiet {
            to_stderr(text);
        }
    }

    /// A loss or doubt; stays with `--quiet`.
    pub(crate) fn warn(&self, text: &str) {
        to_stderr(&labelled("warning", text));
    }
}

/// Text and its hint, each on a line of its own.
fn labelled(label: &str, text: &str) -> String {
    let (what, hint) = text.split_once(HINT).map_or((text, None), |(what, hint)| (what, Some(hint)));
    let mut lines = format!("{label}: {what}");
    if let Some(hint) = hint {
        let _ = write!(lines, "\nhint: {hint}");
    }
    lines
}

/// What is said when an interruption ends the process; nothing while empty.
static FAREWELL: Mutex<String> = Mutex::new(String::new());

/// Sets what is said when an interruption ends the process.
pub(crate) fn farewell(text: String) {
    *FAREWELL.lock().unwrap_or_else(PoisonError::into_inner) = text;
}

/// The last words of an interrupted process.
pub(crate) fn say_farewell() {
    let text = FAREWELL.lock().unwrap_or_else(PoisonError::into_inner);
    if !text.is_empty() {
        to_stderr(&text);
    }
}

/// Nobody is left to tell when standard error is closed.
fn to_stderr(text: &str) {
    let _ = writeln!(io::stderr().lock(), "{text}");
}

/// Prints to standard output: data, nothing else.
pub(crate) fn print(text: &str) -> io::Result<()> {
    let mut stdout = io::stdout().lock();
    stdout.write_all(text.as_bytes())?;
    stdout.flush()
}

/// Says what went wrong and how the process ends.
pub(crate) fn fail(error: &anyhow::Error) -> ExitCode {
    if is_closed_pipe(error) {
        // The reader of our output has seen enough.
        return ExitCode::SUCCESS;
    }
    to_stderr(&labelled("error", &whole_message(error)));
    ExitCode::from(if is_bad_argument(error) { 2 } else { 1 })
}

/// The message with those of its causes that it does not hold already, in front of the hint.
fn whole_message(error: &anyhow::Error) -> String {
    let own = error.to_string();
    let (what, hint) = own.split_once(HINT).map_or((own.as_str(), None), |(what, hint)| (what, Some(hint)));
    let mut message = what.to_owned();
    let mut way_out = hint.map(str::to_owned);
    for cause in error.chain().skip(1).map(ToString::to_string) {
        let (cause, hint) = cause.split_once(HINT).map_or((cause.as_str(), None), |(what, hint)| (what, Some(hint)));
        if !message.contains(cause) {
            let _ = write!(message, ": {cause}");
        }
        way_out = way_out.or(hint.map(str::to_owned));
    }
    way_out.iter().for_each(|hint| message.extend([HINT, hint]));
    message
}

fn is_closed_pipe(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        let own = cause.downcast_ref::<io::Error>().map(io::Error::kind);
        let inner = cause.downcast_ref::<OutputError>().and_then(|error| match error {
            OutputError::Write { source, .. } => Some(source.kind()),
            _ => None,
        });
        own.or(inner) == Some(io::ErrorKind::BrokenPipe)
    })
}

fn is_bad_argument(error: &anyhow::Error) -> bool {
    let reading =
        |error: &RecordingError| matches!(error, RecordingError::BadColumns { .. } | RecordingError::MovingMass { .. });
    error.chain().any(|cause| {
        cause.is::<BadArgument>()
            || cause.downcast_ref::<RecordingError>().is_some_and(reading)
            || matches!(cause.downcast_ref(), Some(SimulateError::Motion(error)) if reading(error))
            || matches!(cause.downcast_ref(), Some(IdentifyError::Degree(_)))
    })
}
