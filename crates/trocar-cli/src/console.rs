//! Output to standard output and standard error, and the reporting of errors at the end of the
//! process.

use std::fmt::Write as _;
use std::io::{self, Write};
use std::process::ExitCode;
use std::sync::{Mutex, PoisonError};

use clap::builder::styling::AnsiColor;
use serde::Serialize;
use terminal_size::{Width, terminal_size_of};
use trocar::compare::CompareError;
use trocar::compensate::CompensateError;
use trocar::identify::IdentifyError;
use trocar::option::{Interface, spelt};
use trocar::output::OutputError;
use trocar::recording::RecordingError;
use trocar::simulate::SimulateError;
use trocar::workflow::WorkflowError;

/// Marks the remedy in the messages of the library.
const HINT: &str = "\n\nhint: ";

/// An argument that clap accepts but the verb does not.
#[derive(Debug)]
pub(crate) struct BadArgument(pub(crate) String);

impl std::fmt::Display for BadArgument {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for BadArgument {}

/// Standard error, normal or quiet.
pub(crate) struct Console {
    pub(crate) quiet: bool,
}

impl Console {
    pub(crate) fn new(quiet: bool) -> Self {
        Self { quiet }
    }

    /// Prints a remark, but not with `--quiet`.
    pub(crate) fn remark(&self, text: &str) {
        if !self.quiet {
            to_stderr(text);
        }
    }

    /// Prints a warning about a loss or doubt, even with `--quiet`.
    pub(crate) fn warn(&self, text: &str) {
        print_labelled(WARNING, text);
    }
}

/// A label with its colour, as those of clap.
type Label = (&'static str, AnsiColor);

const ERROR: Label = ("error", AnsiColor::Red);
const WARNING: Label = ("warning", AnsiColor::Yellow);
const WAY_OUT: Label = ("hint", AnsiColor::Green);

/// Prints text and its hint, each on lines of its own, with coloured labels on a terminal.
fn print_labelled(label: Label, text: &str) {
    let text = spelt(text, Interface::CommandLine);
    let (what, hint) =
        text.split_once(HINT).map_or((&*text, None), |(what, hint)| (what, Some(hint)));
    let hint = hint.map(|hint| (WAY_OUT, hint));
    for ((label, colour), text) in std::iter::once((label, what)).chain(hint) {
        let style = colour.on_default().bold();
        let lines = wrapped(&format!("{label}: {text}"));
        let rest = lines.strip_prefix(label).unwrap_or(&lines);
        let _ = writeln!(anstream::stderr().lock(), "{style}{label}{style:#}{rest}");
    }
}

/// The text in lines of the terminal's width, 80 to 200 columns; unchanged if standard error is no
/// terminal.
fn wrapped(text: &str) -> String {
    let Some((Width(width), _)) = terminal_size_of(io::stderr()) else { return text.to_owned() };
    let options = textwrap::Options::new(usize::from(width.clamp(80, 200))).break_words(false);
    textwrap::fill(text, options.word_splitter(textwrap::WordSplitter::NoHyphenation))
}

/// Message printed when an interruption ends the process; none if empty.
static FAREWELL: Mutex<String> = Mutex::new(String::new());

/// Sets the message for an interruption.
pub(crate) fn farewell(text: String) {
    *FAREWELL.lock().unwrap_or_else(PoisonError::into_inner) = text;
}

/// Prints the message of an interrupted process.
pub(crate) fn say_farewell() {
    let text = FAREWELL.lock().unwrap_or_else(PoisonError::into_inner);
    if !text.is_empty() {
        to_stderr(&text);
    }
}

/// Ignores errors: they cannot be reported if standard error is closed.
fn to_stderr(text: &str) {
    let _ = writeln!(io::stderr().lock(), "{}", wrapped(&spelt(text, Interface::CommandLine)));
}

/// Prints data to standard output, nothing else.
pub(crate) fn print(text: &str) -> io::Result<()> {
    let mut stdout = io::stdout().lock();
    stdout.write_all(spelt(text, Interface::CommandLine).as_bytes())?;
    stdout.flush()
}

/// Prints data as JSON.
pub(crate) fn print_json(data: &impl Serialize) -> anyhow::Result<()> {
    let text = serde_json::to_string_pretty(data)? + "\n";
    Ok(print(&spelt(&text, Interface::Json))?)
}

/// Reports the error and returns the exit code.
pub(crate) fn fail(error: &anyhow::Error) -> ExitCode {
    if is_closed_pipe(error) {
        // The reader of the output has closed it.
        return ExitCode::SUCCESS;
    }
    print_labelled(ERROR, &whole_message(error));
    ExitCode::from(if is_bad_argument(error) { 2 } else { 1 })
}

/// The message with those of its causes that it does not already contain, before the hint.
fn whole_message(error: &anyhow::Error) -> String {
    let own = error.to_string();
    let (what, hint) =
        own.split_once(HINT).map_or((own.as_str(), None), |(what, hint)| (what, Some(hint)));
    let mut message = what.to_owned();
    let mut way_out = hint.map(str::to_owned);
    for cause in error.chain().skip(1).map(ToString::to_string) {
        let (cause, hint) = cause
            .split_once(HINT)
            .map_or((cause.as_str(), None), |(what, hint)| (what, Some(hint)));
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
    error.chain().any(|cause| {
        cause.is::<BadArgument>()
            || cause.downcast_ref::<RecordingError>().is_some_and(is_bad_reading)
            || cause.downcast_ref::<SimulateError>().is_some_and(|error| match error {
                SimulateError::Motion(error) => is_bad_reading(error),
                SimulateError::NoDeflection { .. }
                | SimulateError::NoResolution { .. }
                | SimulateError::Output(OutputError::Extension { .. }) => true,
                _ => false,
            })
            || cause.downcast_ref::<WorkflowError>().is_some_and(|error| match error {
                WorkflowError::Recording(error) => is_bad_reading(error),
                WorkflowError::Identify(error) => matches!(error, IdentifyError::Degree(_)),
                _ => false,
            })
            || matches!(cause.downcast_ref(), Some(IdentifyError::Degree(_)))
            || cause.downcast_ref::<CompareError>().is_some_and(|error| match error {
                CompareError::Recording(error) => is_bad_reading(error),
                CompareError::Twice { .. } => true,
                _ => false,
            })
            || matches!(cause.downcast_ref(), Some(CompensateError::OutOfRange { .. }))
            || matches!(
                cause.downcast_ref(),
                Some(OutputError::IsInput { .. } | OutputError::Extension { .. })
            )
    })
}

fn is_bad_reading(error: &RecordingError) -> bool {
    matches!(
        error,
        RecordingError::BadColumns { .. }
            | RecordingError::OutOfRange { .. }
            | RecordingError::HeavyMass { .. }
            | RecordingError::GravityWithoutMass { .. }
    )
}
