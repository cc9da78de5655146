//! `trocar compensate`

use std::path::PathBuf;

use trocar::compensate::{
    CompensateOptions, Compensation, Compensator, Fault, FaultCount, MOST_DRAWS, StreamOptions,
    compensate_file,
};
use trocar::many::evenly;
use trocar::model_file::{ErrorSource, ForceError, ModelFile};

use crate::Completion;
use crate::console::Console;
use crate::input::{Choosing, Observing, files, say_own_header};
use crate::models::{read_draws, read_model};
use crate::output::Output;
use crate::progress::Progress;
use crate::table::number;

/// Estimate the tissue force: subtract the trocar force from the readings of a sensor outside the
/// body
///
/// Simulates an identified model along the measured motion and writes time_s, position_m, force_n,
/// trocar_force_n, tissue_force_n, tissue_force_std_n, adapting and, with rotation, torque_n_m. Causal:
/// with '-' as recording and output, each row is answered at once. Adapts to friction that has
/// changed since the identification (wetting lowers it by 15 to 45 %) from strokes in both
/// directions, never while tissue is touched. Where a reading gives no tissue force (missing,
/// saturated, frozen), the value is nan and the exit code 3.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Model: model.json, or the folder of a result
    model: PathBuf,
    #[arg(help = files("Recording"))]
    recording: PathBuf,
    /// Result: CSV, or Parquet, Arrow or compressed CSV by its extension (.parquet, .arrow,
    /// .csv.gz, .csv.zst); '-' for CSV to standard output
    #[arg(long, value_name = "FILE")]
    out: Output,
    /// Draws of the element's parameters that `identify --posterior` wrote: tissue_force_std_n has
    /// the error of the parameters from their forces, in place of the intervals of the model
    #[arg(long, value_name = "FILE")]
    posterior: Option<PathBuf>,
    #[command(flatten)]
    observing: Observing,
    #[command(flatten)]
    choosing: Choosing,
}

pub(crate) fn run(console: &Console, args: &Args) -> anyhow::Result<Completion> {
    let model = read_model(&args.model, std::slice::from_ref(&args.recording))?;
    let mut choice = args.choosing.choice_for(console, &model);
    match model.flips_force() {
        Some(true) if !choice.reverses_force() => {
            choice.flip_force = !choice.flip_force;
            console.remark(
                "note: the force is reversed, as in the recordings of the model (--flip-force)",
            );
        }
        None if !choice.reverses_force() => console.warn(
            "some recordings of the model were read with the force reversed and some without: \
             give --flip-force if the force of this one must be reversed",
        ),
        _ => {}
    }
    // The reader reverses the sign.
    let options = CompensateOptions { flip_force: Some(false), ..args.observing.options() };
    let mut observer = Compensator::new(&model, &options)?;
    if let Some(path) = &args.posterior {
        let draws = read_draws(path, (&model, &args.model))?;
        observer = observer.with_draws(&evenly(&draws, MOST_DRAWS))?;
    }
    say_what_it_rests_on(console, args, &model);
    let is_file = std::fs::metadata(&args.recording).is_ok_and(|data| data.is_file());
    let is_stream = args.recording.as_os_str() == "-" || (args.recording.exists() && !is_file);
    let stream = StreamOptions { choice: &choice, live: is_stream };
    let progress = Progress::new(console);
    let done = compensate_file(
        &args.recording,
        stream,
        &mut observer,
        &args.out,
        |part, rows| progress.report_rows("compensating", part, rows),
        |fault, line| {
            if is_stream {
                console.warn(&format!("line {line}: {}", fault.words()));
            }
        },
    )?;
    drop(progress);
    say_outcome(console, args, &done);
    let spoilt =
        done.faults.iter().any(|count| count.fault.spoils_reading() || count.fault == Fault::Gap);
    Ok(Completion::doubtful_if(spoilt))
}

fn say_what_it_rests_on(console: &Console, args: &Args, model: &ModelFile) {
    if let (None, Some(ForceError { source: ErrorSource::Identification, .. })) =
        (args.observing.force_error_n, model.force_error)
    {
        console.remark(
            "note: the band is based on the recordings used for identification, none of them held out: it may be too narrow; identify \
             again with --validate",
        );
    }
    if model.sensor.is_some_and(|sensor| sensor.loads() != [0.0; 3]) {
        console.warn(
            "the readings behind the model held side load, weight by tilt or the effect of gas pressure, which the observer does not \
             know: it takes them for tissue",
        );
    }
    if let Some(sensor) = model.sensor.filter(|sensor| sensor.position_delay_s > 0.0) {
        console.warn(&format!(
            "the positions of the model's recordings came {:.0} ms late, and the observer does not wait for them: if these are late too, expect \
             errors after reversals that the band does not include",
            1e3 * sensor.position_delay_s
        ));
    }
}

fn say_outcome(console: &Console, args: &Args, done: &Compensation) {
    if done.is_by_own_header {
        say_own_header(console, &args.recording);
    }
    for FaultCount { fault, first_line, rows } in &done.faults {
        let file = args.recording.display();
        let words = fault.words();
        console.warn(&format!("{file}: {rows} rows, from line {first_line} on: {words}"));
    }
    if done.angle_missing {
        console.warn(&format!(
            "{}: no angle in the first row, and the model has 'rotation': the instrument is taken not to turn\n\n\
             hint: name the column angle_rad, angle_deg or angle_turns",
            args.recording.display()
        ));
    }
    if let Some(departure) = done.departure {
        console.warn(&departure.to_string());
    }
    console.remark(&format!("{} rows -> {}", done.rows, args.out.display()));
    if args.observing.no_adaptation {
        return;
    }
    let drift = done.drift;
    console.remark(&format!(
        "friction at the end: {} ± {} of the model's, viscous part {} ± {} (one standard deviation); followed in {:.0} % of the rows",
        number(drift.level),
        number(drift.level_std),
        number(drift.viscosity),
        number(drift.viscosity_std),
        100.0 * done.adapting_rows as f64 / done.rows.max(1) as f64
    ));
}
