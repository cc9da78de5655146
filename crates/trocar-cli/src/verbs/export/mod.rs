//! `trocar export`: one file per format.

pub(crate) mod fmu;

use clap::Subcommand;

use crate::Done;
use crate::console::Console;

/// Export a model for other programs
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    format: Format,
}

#[derive(Subcommand)]
enum Format {
    Fmu(fmu::Args),
}

pub(crate) fn run(console: &Console, args: &Args) -> anyhow::Result<Done> {
    match &args.format {
        Format::Fmu(args) => fmu::run(console, args),
    }
}
