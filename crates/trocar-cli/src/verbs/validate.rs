//! `trocar validate`

use std::path::PathBuf;

use trocar::model_file::{ModelFile, SensorInfo};
use trocar::recording::Recording;
use trocar::summary::MovingMass;
use trocar::validate::{Validation, validate};

use crate::Done;
use crate::console::{self, Console};
use crate::input::{Reading, finite, not_negative, without};
use crate::table::{Table, number};

/// Compare a model with recordings it has not seen
///
/// Runs the model along each recording's positions and prints the error of its force: root mean square in N, and the
/// fit 100 (1 - rms(error) / rms(force - mean force)) in percent. Scored are the samples at which the state of the seal
/// is known, that is after it has slid once in each recording.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Model file (model.json)
    model: PathBuf,
    /// Recordings: CSV with time, position and force columns, '-' for standard input
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// Mass between sensor and seal, in kg: its inertia is taken out of the readings [default: the model's sensor, or 0]
    #[arg(long, value_name = "KG", value_parser = not_negative, allow_negative_numbers = true)]
    moving_mass_kg: Option<f64>,
    /// Reading at rest without any force of the seal, in N [default: the model's sensor, or 0]
    #[arg(long, value_name = "N", value_parser = finite, allow_negative_numbers = true)]
    offset_n: Option<f64>,
    /// Print JSON instead of the table
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    reading: Reading,
}

pub(crate) fn run(console: &Console, args: &Args) -> anyhow::Result<Done> {
    let model = ModelFile::read(&args.model)?;
    let sensor = model.sensor.unwrap_or(SensorInfo { offset_n: 0.0, moving_mass_kg: 0.0 });
    let mass = args.moving_mass_kg.unwrap_or(sensor.moving_mass_kg);
    let offset = args.offset_n.unwrap_or(sensor.offset_n);
    let recordings = args.reading.recordings(console, &args.recordings)?;
    let lost = recordings.iter().any(|recording| !recording.quality.warnings.is_empty());
    console.remark(&format!(
        "offset {} N and moving mass {} kg taken out of the readings",
        number(offset),
        number(mass)
    ));
    // The weight of the mass is part of the offset.
    let recordings: Result<Vec<Recording>, _> =
        recordings.into_iter().map(|recording| without(recording, MovingMass { mass, gravity: 0.0 }, 0.0)).collect();
    let mut validation = validate(&model.elements, &recordings?, offset);
    for (result, path) in validation.recordings.iter_mut().zip(&args.recordings) {
        result.path = path.display().to_string();
        for warning in &result.warnings {
            console.warn(&format!("{}: {warning}", result.path));
        }
    }
    let text = if args.json { serde_json::to_string_pretty(&validation)? + "\n" } else { table(&validation) };
    console::print(&text)?;
    Ok(Done::doubtful_if(lost || validation.is_doubtful()))
}

/// One line a recording, and one for all.
pub(crate) fn table(validation: &Validation) -> String {
    let mut table = Table::headed([
        "recording",
        "rms N",
        "fit %",
        "bias N",
        "worst N",
        "deforming N",
        "sliding N",
        "hold N",
        "samples",
    ]);
    for r in &validation.recordings {
        let phase = |part: trocar::validate::Part| if part.samples > 0 { number(part.rms_n) } else { "-".to_owned() };
        table.row([
            r.path.clone(),
            number(r.rms_n),
            format!("{:.2}", r.fit_percent),
            number(r.bias_n),
            number(r.worst_n),
            phase(r.by_phase.deformation),
            phase(r.by_phase.sliding),
            phase(r.by_phase.hold),
            r.samples.to_string(),
        ]);
    }
    table.row(["all".to_owned(), number(validation.rms_n), format!("{:.2}", validation.fit_percent)]);
    table.to_text()
}
