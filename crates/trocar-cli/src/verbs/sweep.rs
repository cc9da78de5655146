//! `trocar sweep`

use std::path::{Path, PathBuf};
use std::time::Instant;
use trocar_model::Tunable;

use anyhow::Context;
use trocar::model_file::ModelFile;
use trocar::sweep::Sweep;
use trocar::sweep::config::EXAMPLE_TOML;

use crate::Completion;
use crate::console::{self, Console};
use crate::output::Output;
use crate::progress::Progress;
use crate::table::number;

/// Run a model many times with drawn parameters: Monte Carlo and grids over seals, rigs and motions
///
/// Writes one row per run: number, seed, parameters, peak force, RMS force, work, break-away force,
/// fraction of time in which the seal deforms and, along a recording, the RMS error; of a
/// teleoperation loop whether it is stable, and what is felt. The same document gives the same table
/// on any number of cores. A run with invalid parameters is a row with its reason in the column
/// failure (exit code 3).
#[derive(clap::Args)]
pub(crate) struct Args {
    /// What to vary, TOML (see --print-config)
    #[arg(value_name = "SWEEP.toml", required_unless_present_any = ["print_config", "list"])]
    sweep: Option<PathBuf>,
    /// Table to write: .parquet, .arrow, .csv, .csv.gz or .csv.zst, '-' for CSV to standard output
    #[arg(long, value_name = "TABLE", required_unless_present_any = ["print_config", "list"])]
    out: Option<Output>,
    /// Also write time, position and force of each run into this folder, one Parquet file each
    #[arg(long, value_name = "DIR", value_parser = Output::folder(&["run_*.parquet"]))]
    traces: Option<Output>,
    /// Print a documented example of what to vary and stop
    #[arg(long)]
    print_config: bool,
    /// Print the parameters of a model with their values and stop; 'plausible' is the default model
    #[arg(long, value_name = "MODEL")]
    list: Option<PathBuf>,
}

pub(crate) fn run(console: &Console, args: &Args) -> anyhow::Result<Completion> {
    if args.print_config {
        console::print(EXAMPLE_TOML)?;
        return Ok(Completion::Clean);
    }
    if let Some(model) = &args.list {
        console::print(&parameters(model)?)?;
        return Ok(Completion::Clean);
    }
    let (Some(document), Some(out)) = (&args.sweep, &args.out) else {
        return Ok(Completion::Clean);
    };
    let sweep = read(document)?;
    if let Some(folder) = &args.traces {
        let failed = || format!("{}: cannot make the folder for the traces", folder.display());
        std::fs::create_dir_all(folder).with_context(failed)?;
    }
    let progress = Progress::new(console);
    let (start, rows) = (Instant::now(), sweep.rows());
    let report = |done: u64| {
        let rate = done as f64 / start.elapsed().as_secs_f64().max(1e-3);
        progress.report(&format!("{} runs a second", number(rate)), done as f64 / rows as f64);
    };
    let summary = sweep.run(out, args.traces.as_deref(), report)?;
    drop(progress);
    let seconds = start.elapsed().as_secs_f64();
    let rate = number(rows as f64 / seconds.max(1e-3));
    console.remark(&format!(
        "{rows} runs in {} s, {rate} a second -> {}",
        number(seconds),
        out.display()
    ));
    if let Some(why) = &summary.first_failure {
        console.warn(&format!("{} of {rows} runs failed, the first: {why}", summary.failed));
    }
    Ok(Completion::doubtful_if(summary.failed > 0))
}

fn read(document: &Path) -> anyhow::Result<Sweep> {
    let name = || document.display().to_string();
    let text = std::fs::read_to_string(document)
        .with_context(|| format!("{}: cannot read the sweep", name()))?;
    let folder = document.parent().unwrap_or(Path::new(""));
    Sweep::new(&text, folder).with_context(name)
}

/// One line per parameter.
fn parameters(model: &Path) -> anyhow::Result<String> {
    let file = match model.to_str() {
        Some("plausible") => ModelFile::plausible_10_5_mm()?,
        _ => ModelFile::read(model)?,
    };
    let seal = *file.trocar.seal();
    let line = |Tunable { id, value }: Tunable| {
        format!("{:44} {:>12}  {}: {}\n", id.to_string(), number(value), id.symbol(), id.words())
    };
    Ok(seal.tunables().map(line).collect())
}
