//! `trocar completions`

use clap_complete::Shell;

use crate::{Completion, console, examples};

/// Print completions for a shell
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Shell to print completions for
    shell: Shell,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Completion> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut examples::command(), "trocar", &mut script);
    console::print(&String::from_utf8_lossy(&script))?;
    Ok(Completion::Clean)
}
