//! `trocar export values`

use std::path::PathBuf;

use clap::builder::PossibleValuesParser;
use trocar::export::values::{TARGETS, text};

use crate::Completion;
use crate::console::{self, Console};
use crate::input::Reading;
use crate::models::read_model;

/// Print the numbers of a model in the names, units and conventions of another program, to paste
///
/// Comments state where they belong, and what the other program cannot express of the model; with
/// --validate also how large the error becomes by that. json holds the numbers for all programs.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Model: model.json, one of those that compare writes, or the folder of a result
    model: PathBuf,
    /// The program or format that takes the numbers
    #[arg(long = "for", value_name = "PROGRAM", value_parser = PossibleValuesParser::new(TARGETS))]
    target: String,
    /// Recordings on which the error of the numbers is measured
    #[arg(long, value_name = "RECORDING", num_args = 1..)]
    validate: Vec<PathBuf>,
    #[command(flatten)]
    reading: Reading,
}

pub(crate) fn run(console: &Console, args: &Args) -> anyhow::Result<Completion> {
    let model = read_model(&args.model, &args.validate)?;
    let (mut recordings, mut lost) = (Vec::new(), false);
    if !args.validate.is_empty() {
        let choice = args.reading.choosing.choice_for(console, &model);
        for path in &args.validate {
            args.reading.pieces(console, path, &choice, |piece| {
                lost |= !piece.quality.warnings.is_empty();
                recordings.push(piece);
                Ok(())
            })?;
        }
    }
    console::print(&text(&model, &args.target, recordings)?)?;
    Ok(Completion::doubtful_if(lost))
}
