//! `trocar completions`

use clap::builder::PossibleValuesParser;
use clap::{Arg, Command, ValueHint};
use clap_complete::Shell;
use trocar::compare::Choice;
use trocar::identify::Term;

use crate::{Completion, console, examples};

/// Print completions for a shell
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Shell to print completions for
    shell: Shell,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Completion> {
    let mut script = Vec::new();
    let mut command = completed(examples::command());
    clap_complete::generate(args.shell, &mut command, "trocar", &mut script);
    console::print(&String::from_utf8_lossy(&script))?;
    Ok(Completion::Clean)
}

/// The command line with what a shell may complete: files, folders and names, and nothing in place
/// of a number or of a column of the recording. This copy parses nothing.
fn completed(command: Command) -> Command {
    command.mut_args(with_values).mut_subcommands(completed)
}

fn with_values(arg: Arg) -> Arg {
    if !arg.get_action().takes_values() {
        return arg;
    }
    let named = arg.get_value_names().and_then(|names| names.first()).map(ToString::to_string);
    match (arg.get_id().to_string().as_str(), named.unwrap_or_default().as_str()) {
        ("models", _) => list(arg, models()),
        ("without", _) => list(arg, Term::ALL.map(Term::name).to_vec()),
        (_, "DIR") => arg.value_hint(ValueHint::DirPath),
        (_, "PLATFORM=FILE") => arg.value_hint(ValueHint::FilePath),
        _ if arg.get_possible_values().is_empty() && arg.get_value_hint() == ValueHint::Unknown => {
            arg.value_hint(ValueHint::Other)
        }
        _ => arg,
    }
}

/// Names that `--models` takes without a number of elements.
fn models() -> Vec<&'static str> {
    let families = Choice::all().into_iter().map(Choice::family);
    let mut names: Vec<&str> = std::iter::once("all").chain(families).collect();
    names.dedup();
    names
}

/// An option with a list of names. Shells complete the first one, some also those after a comma.
fn list(arg: Arg, names: Vec<&'static str>) -> Arg {
    arg.value_delimiter(',').value_parser(PossibleValuesParser::new(names))
}
