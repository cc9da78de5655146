//! `trocar`: from recordings of an instrument in a trocar to a validated model of the force, on the
//! command line.
//!
//! The library does the computation; this crate parses arguments, prints and exits. Data are
//! written to standard output, everything else to standard error. Exit codes: 0 success, 1 failure,
//! 2 invalid arguments, 3 success with lost or doubtful data.

mod console;
mod examples;
mod input;
mod models;
mod output;
mod page;
mod progress;
#[cfg(test)]
mod reference;
mod table;
mod verbs;

use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::{FromArgMatches, Parser, Subcommand};

use console::Console;

/// Identifies, validates and simulates the force between a surgical instrument and the seal of its
/// trocar.
///
/// The model is the Extended Maxwell-Slip (EMS) element: a seal that first deforms with the
/// instrument, then lets it slide. Position and force are positive on insertion. Not a medical
/// device.
#[derive(Parser)]
#[command(name = "trocar", version, after_help = AFTER_HELP, max_term_width = 200)]
struct Cli {
    /// No progress and no remarks; warnings and errors stay
    #[arg(long, global = true)]
    quiet: bool,
    #[command(subcommand)]
    verb: Verb,
}

const AFTER_HELP: &str = "Exit codes: 0 done, 1 failed, 2 bad arguments, 3 done with lost or doubtful data, \
                          130 interrupted.

Start with: trocar demo
\
                          Read on: trocar man index; messages and their ways out: trocar man troubleshooting";

#[derive(Subcommand)]
enum Verb {
    Inspect(verbs::inspect::Args),
    Plan(verbs::plan::Args),
    Bench(verbs::bench::Args),
    Identify(verbs::identify::Args),
    Fleet(verbs::fleet::Args),
    Validate(verbs::validate::Args),
    Compare(verbs::compare::Args),
    Simulate(verbs::simulate::Args),
    Compensate(verbs::compensate::Args),
    Ranges(verbs::ranges::Args),
    Teleop(verbs::teleop::Args),
    Analyze(verbs::analyze::Args),
    Export(verbs::export::Args),
    Demo(verbs::demo::Args),
    Completions(verbs::completions::Args),
    Man(verbs::man::Args),
}

/// Result of a verb that did not fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Completion {
    /// No warnings.
    Clean,
    /// Data were lost or the result is doubtful; the warnings give the details.
    Doubtful,
}

impl Completion {
    fn doubtful_if(doubtful: bool) -> Self {
        if doubtful { Self::Doubtful } else { Self::Clean }
    }
}

/// Set once an interruption ends the process; later failures and results are then consequences of
/// it.
static INTERRUPTED: AtomicBool = AtomicBool::new(false);

fn main() -> ExitCode {
    let matches = examples::command().get_matches();
    let cli = Cli::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
    let console = Console::new(cli.quiet);
    let interruptible = ctrlc::set_handler(|| {
        INTERRUPTED.store(true, Ordering::SeqCst);
        trocar::output::remove_unfinished();
        console::say_farewell();
        std::process::exit(130);
    });
    if let Err(error) = interruptible {
        console.warn(&format!("an interruption may leave hidden temporary files: {error}"));
    }
    let outcome = output::check(&matches).and_then(|()| run(&console, cli.verb));
    while INTERRUPTED.load(Ordering::SeqCst) {
        // The handler's thread ends the process with its own exit code.
        std::thread::park();
    }
    match outcome {
        Ok(Completion::Clean) => ExitCode::SUCCESS,
        Ok(Completion::Doubtful) => ExitCode::from(3),
        Err(error) => console::fail(&error),
    }
}

fn run(console: &Console, verb: Verb) -> anyhow::Result<Completion> {
    match verb {
        Verb::Inspect(args) => verbs::inspect::run(console, &args),
        Verb::Plan(args) => verbs::plan::run(console, &args),
        Verb::Bench(args) => verbs::bench::run(console, &args),
        Verb::Identify(args) => verbs::identify::run(console, &args),
        Verb::Fleet(args) => verbs::fleet::run(console, &args),
        Verb::Validate(args) => verbs::validate::run(console, &args),
        Verb::Compare(args) => verbs::compare::run(console, &args),
        Verb::Simulate(args) => verbs::simulate::run(console, &args),
        Verb::Compensate(args) => verbs::compensate::run(console, &args),
        Verb::Ranges(args) => verbs::ranges::run(&args),
        Verb::Teleop(args) => verbs::teleop::run(console, &args),
        Verb::Analyze(args) => verbs::analyze::run(console, &args),
        Verb::Export(args) => verbs::export::run(console, &args),
        Verb::Demo(args) => verbs::demo::run(console, &args),
        Verb::Completions(args) => verbs::completions::run(&args),
        Verb::Man(args) => verbs::man::run(&args),
    }
}
