//! `trocar simulate`

use std::path::PathBuf;

use trocar::profile::Departure;
use trocar::recording::{Choice, position_resolution};
use trocar::simulate::{Beginning, SimulateOptions, simulate_file, simulate_file_with_band};
use trocar_model::BacklashFilter;

use crate::Completion;
use crate::console::{BadArgument, Console};
use crate::input::{Choosing, finite, not_negative, say_own_header};
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
    /// Model: model.json, one of those that compare writes, or the folder of a result
    model: PathBuf,
    /// Motion: CSV with time and position columns, '-' for standard input
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
    #[arg(long, default_value = "0", value_name = "WIDTH", value_parser = backlash_width, allow_negative_numbers = true)]
    backlash_m: BacklashWidth,
    /// Draws of the element's parameters that `identify --posterior` wrote: adds the columns
    /// force_low_n and force_high_n, which hold 95 % of their forces
    #[arg(long, value_name = "FILE")]
    posterior: Option<PathBuf>,
    #[command(flatten)]
    choosing: Choosing,
}

/// Width of the backlash filter.
#[derive(Debug, Clone, Copy, PartialEq)]
enum BacklashWidth {
    /// As given, m; 0 for none.
    Given(f64),
    /// From the resolution of the positions.
    Auto,
}

fn backlash_width(text: &str) -> Result<BacklashWidth, String> {
    if text == "auto" {
        return Ok(BacklashWidth::Auto);
    }
    not_negative(text)
        .map(BacklashWidth::Given)
        .map_err(|error| format!("{error}, in metres, or 'auto'"))
}

pub(crate) fn run(console: &Console, args: &Args) -> anyhow::Result<Completion> {
    let model = read_model(&args.model, std::slice::from_ref(&args.motion))?;
    let choice = args.choosing.choice_for(console, &model);
    let kind = model.trocar.seal().kind();
    if args.initial_deflection_mm.is_some() && model.stages().is_err() {
        let file = args.model.display();
        let text =
            format!("--initial-deflection-mm is for EMS elements, but {file} holds a {kind} model");
        return Err(BadArgument(text).into());
    }
    let options = SimulateOptions {
        initial_deflection: args.initial_deflection_mm.map(|mm| 1e-3 * mm),
        offset: model.offset(),
        filter: filter(console, args, &choice)?,
    };
    let progress = Progress::new(console);
    let report = |part, rows| progress.report_rows("simulating", part, rows);
    let done = match &args.posterior {
        None => simulate_file(&args.motion, &choice, &model.trocar, &options, &args.out, report)?,
        Some(path) => {
            let draws = read_draws(path, (&model, &args.model))?;
            let both = (&model.trocar, draws.as_slice());
            simulate_file_with_band(&args.motion, &choice, both, &options, &args.out, report)?
        }
    };
    drop(progress);
    if done.is_by_own_header {
        say_own_header(console, &args.motion);
    }
    if let Some(beginning) = done.beginning.filter(|_| options.initial_deflection.is_none()) {
        console.remark(&start_in_words(&beginning, options.offset));
    }
    console.remark(&format!("{} rows -> {}", done.rows, args.out.display()));
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

/// The requested backlash filter, if any.
fn filter(
    console: &Console,
    args: &Args,
    choice: &Choice,
) -> anyhow::Result<Option<BacklashFilter>> {
    match args.backlash_m {
        BacklashWidth::Given(width) => {
            Ok(if width > 0.0 { Some(BacklashFilter::new(width)?) } else { None })
        }
        BacklashWidth::Auto => Ok(Some(filter_for_resolution(console, args, choice)?)),
    }
}

/// The filter for the resolution of the first rows: possible only for a file that can be read
/// twice.
fn filter_for_resolution(
    console: &Console,
    args: &Args,
    choice: &Choice,
) -> anyhow::Result<BacklashFilter> {
    let refuse = |why: &str| {
        let motion = args.motion.display();
        let hint =
            "give the width in metres, 1.5 resolutions of the encoder: --backlash-m 6e-6 for 4 um";
        BadArgument(format!(
            "--backlash-m auto needs the resolution of the positions, {why}: {motion}\n\nhint: {hint}"
        ))
    };
    if args.motion.as_os_str() == "-"
        || std::fs::metadata(&args.motion).is_ok_and(|data| !data.is_file())
    {
        return Err(refuse("which is not known beforehand for a stream").into());
    }
    let resolution = position_resolution(&args.motion, choice)?;
    if resolution == 0.0 {
        return Err(refuse("but they are whole multiples of no step").into());
    }
    let filter = BacklashFilter::for_resolution(resolution)?;
    let (width, resolution) = (number(1e6 * filter.width()), number(1e6 * resolution));
    console.remark(&format!(
        "backlash filter: {width} um to either side, 1.5 times the resolution of {resolution} um"
    ));
    Ok(filter)
}
