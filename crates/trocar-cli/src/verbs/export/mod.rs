//! `trocar export`: one file per format.

mod c;
pub(crate) mod fmu;
mod values;

use clap::Subcommand;

use crate::Completion;
use crate::console::Console;

/// Export a model to C, as an FMU, or as numbers for another program
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    format: Format,
}

#[derive(Subcommand)]
enum Format {
    C(c::Args),
    Fmu(fmu::Args),
    Values(values::Args),
}

pub(crate) fn run(console: &Console, args: &Args) -> anyhow::Result<Completion> {
    match &args.format {
        Format::C(args) => c::run(console, args),
        Format::Fmu(args) => fmu::run(console, args),
        Format::Values(args) => values::run(console, args),
    }
}
