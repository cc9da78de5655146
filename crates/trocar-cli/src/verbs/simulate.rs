//! `trocar simulate`

use std::path::PathBuf;

use trocar::profile::Departure;
use trocar::simulate::{Backlash, Beginning, SimulateError, SimulateOptions, simulate_file};

use crate::Completion;
use crate::console::Console;
use crate::input::{Choosing, files, finite, say_own_header};
use crate::models::{read_draws, read_model};
use crate::output::Output;
use crate::progress::Progress;
use crate::table::number;

/// Simulate a model along a motion: force and deflection for every row
///
/// Writes the columns time_s, position_m, force_n, deflection_m and mode, one row per input row;
/// for a classical model (Coulomb to GMS) without the last two, since it has no deflection. The
/// force is the trocar's, without the sensor's offset, positive on insertion; with a position
/// profile in the model it depends on the position. Rows are streamed: a file may be of any size.
/// With several elements the deflection is their mean.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Model: model.json, one of those that compare writes, the folder of a result, or the made-up
    /// seal 'plausible'
    model: PathBuf,
    #[arg(help = files("Motion, with time and position"))]
    motion: PathBuf,
    /// Result: CSV, or Parquet, Arrow or compressed CSV by its extension (.parquet, .arrow,
    /// .csv.gz, .csv.zst); '-' for CSV to standard output
    #[arg(long, value_name = "FILE")]
    out: Output,
    /// Deflection of the seal before the first row, in mm, positive on insertion [default: from the
    /// first force reading where the motion has one, else 0]; for EMS elements only
    #[arg(long, value_name = "MM", value_parser = finite, allow_negative_numbers = true)]
    initial_deflection_mm: Option<f64>,
    /// Width of a backlash filter for the position, in m to either side: keeps the flicker of a
    /// resting encoder out of the force. 0: none; 'auto': 1.5 times the resolution found in the
    /// first rows of the file
    #[arg(long, default_value = "0", value_name = "WIDTH", allow_negative_numbers = true)]
    backlash_m: Backlash,
    /// Draws of the element's parameters that `identify --posterior` wrote: adds the columns
    /// force_low_n and force_high_n, which hold 95 % of their forces
    #[arg(long, value_name = "FILE")]
    posterior: Option<PathBuf>,
    #[command(flatten)]
    choosing: Choosing,
}

pub(crate) fn run(console: &Console, args: &Args) -> anyhow::Result<Completion> {
    let model = read_model(&args.model, std::slice::from_ref(&args.motion))?;
    let choice = args.choosing.choice_for(console, &model);
    let backlash = args.backlash_m.filter(&args.motion, &choice)?;
    if let Some((filter, Some(resolution))) = backlash {
        console.remark(&format!(
            "backlash filter: {} um to either side, 1.5 times the resolution of {} um",
            number(1e6 * filter.width()),
            number(1e6 * resolution)
        ));
    }
    let draws = args.posterior.as_deref().map(|path| read_draws(path, (&model, &args.model)));
    let draws = draws.transpose()?;
    let options = SimulateOptions {
        initial_deflection: args.initial_deflection_mm.map(|mm| 1e-3 * mm),
        offset: model.offset(),
        filter: backlash.map(|(filter, _)| filter),
    };
    let progress = Progress::new(console);
    let done = simulate_file(
        &args.motion,
        &choice,
        &model.trocar,
        draws.as_deref(),
        &options,
        &args.out,
        |part, rows| progress.report_rows("simulating", part, rows),
    );
    let done = done.map_err(|error| match error {
        SimulateError::NoDeflection { .. } => {
            anyhow::Error::from(error).context(args.model.display().to_string())
        }
        other => other.into(),
    })?;
    drop(progress);
    if done.is_by_own_header {
        say_own_header(console, &args.motion);
    }
    if let Some(beginning) = done.beginning.filter(|_| options.initial_deflection.is_none()) {
        console.remark(&start_in_words(&beginning, options.offset));
    }
    console.remark(&format!("{} rows -> {}", done.rows, args.out.display()));
    if done.turns_unheeded {
        console.warn(
            "the instrument turns in this motion, but the model knows the axis only: its force is too large while it turns\n\n\
             hint: a model with 'rotation' takes the angle into account",
        );
    }
    let profile = model.trocar.profile();
    if let Some(departure) =
        profile.and_then(|profile| Departure::of(profile, done.lowest, done.highest))
    {
        console.warn(&departure.to_string());
    }
    Ok(Completion::Clean)
}

/// Initial state of the seal, and its source.
fn start_in_words(beginning: &Beginning, offset: f64) -> String {
    let start = match beginning.state.deformation() {
        Some(deformation) => format!("deflection {:.3} mm", 1e3 * deformation.deflection),
        None => format!("at rest with {:.3} N", beginning.state.force()),
    };
    match beginning.reading {
        Some(reading) => {
            format!(
                "start: {start}, from the first reading of {reading} N less the offset of {offset:.3} N"
            )
        }
        None => format!("start: {start}, for the motion has no force"),
    }
}
