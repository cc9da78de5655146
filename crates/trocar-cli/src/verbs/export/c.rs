//! `trocar export c`

use std::io::Write;
use std::path::PathBuf;

use trocar::export::c::{CError, DEFAULT_PREFIX, check_prefix, from_file};
use trocar::output::AtomicFile;

use crate::Completion;
use crate::console::Console;

/// Write a model as one C99 file of constants and one step function, for a microcontroller
///
/// Works for any model. The file needs only <math.h> and a double of 64 bits, and holds only what
/// the model needs. Its first comment explains its use. As in the library, a step that is not
/// finite or takes no time changes nothing.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Model file (model.json, or one of those that compare writes)
    model: PathBuf,
    /// Result: a C file, '-' for standard output
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Beginning of all names in the file: PREFIX_state, PREFIX_rest, PREFIX_step
    #[arg(long, value_name = "PREFIX", default_value = DEFAULT_PREFIX, value_parser = prefix)]
    name: String,
}

fn prefix(text: &str) -> Result<String, CError> {
    check_prefix(text).map(|()| text.to_owned())
}

pub(crate) fn run(console: &Console, args: &Args) -> anyhow::Result<Completion> {
    let text = from_file(&args.model, &args.name)?;
    let mut file = AtomicFile::create(&args.out)?;
    file.write_all(text.as_bytes()).map_err(|source| file.write_error(source))?;
    file.commit()?;
    console.remark(&format!("{} lines of C -> {}", text.lines().count(), args.out.display()));
    Ok(Completion::Clean)
}
