//! `trocar export c`

use std::path::PathBuf;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use trocar::compensate::CompensateOptions;
use trocar::export::c::{
    CError, COptions, DEFAULT_PREFIX, Precision, check_prefix, from_file, stem,
};

use crate::Completion;
use crate::console::{BadArgument, Console};
use crate::input::Observing;
use crate::output::Output;

/// Write a model in C99 for a microcontroller: a source file and its header, for C and C++
///
/// Works for any model. The files need only <math.h> and <stdint.h>, and hold only what the model
/// needs. The first comment of the header explains the use. As in the library,
/// a step that is not finite or takes no time changes nothing.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Model file (model.json, or one of those that compare writes)
    model: PathBuf,
    /// Result: the source file; the header is written beside it as FILE.h
    #[arg(long, value_name = "FILE.c", value_parser = source_file())]
    out: Output,
    /// Beginning of all names in the files: PREFIX_state, PREFIX_rest, PREFIX_step
    #[arg(long, value_name = "PREFIX", default_value = DEFAULT_PREFIX, value_parser = prefix)]
    name: String,
    /// Numbers of the code: double gives the forces of the library, single is for processors that
    /// compute in 32 bits only; docs/reference/exported-c.md lists its error
    #[arg(long, value_name = "PRECISION", default_value = "double",
          value_parser = PossibleValuesParser::new(["double", "single"]).try_map(|text| text.parse::<Precision>()))]
    precision: Precision,
    /// Also the observer of the tissue force, as 'trocar compensate' runs it, with the following
    /// options
    #[arg(long)]
    compensator: bool,
    /// Whether the observer reverses the sign of the readings, true or false [default: as the
    /// recordings of the model were read]
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true")]
    flip_force: Option<bool>,
    #[command(flatten)]
    observing: Observing,
}

fn prefix(text: &str) -> Result<String, CError> {
    check_prefix(text).map(|()| text.to_owned())
}

/// A source file with its header.
fn source_file() -> impl TypedValueParser<Value = Output> {
    Output::with(|source| vec![source.with_extension("h")])
        .try_map(|source| stem(&source).map(drop).map(|()| source))
}

pub(crate) fn run(console: &Console, args: &Args) -> anyhow::Result<Completion> {
    let observing = CompensateOptions { flip_force: args.flip_force, ..args.observing.options() };
    if !args.compensator && observing != CompensateOptions::default() {
        let text = "options of the observer need --compensator: offset, moving mass, sign of the force, gravity, sensor limit, force error, adaptation";
        return Err(BadArgument(text.to_owned()).into());
    }
    let options = COptions {
        prefix: &args.name,
        stem: stem(&args.out)?,
        precision: args.precision,
        compensator: args.compensator.then_some(&observing),
        internal: false,
    };
    let files = from_file(&args.model, options)?;
    files.store(&args.out)?;
    console.remark(&format!(
        "{} lines of C -> {}, {}",
        files.source.lines().count(),
        args.out.display(),
        args.out.with_extension("h").display()
    ));
    Ok(Completion::Clean)
}
