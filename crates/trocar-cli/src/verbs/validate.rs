//! `trocar validate`

use std::path::PathBuf;

use trocar::recording::OPPOSED;
use trocar::validate::{PhaseError, Phases, Scored, Validation, validate_one};
use trocar::workflow::Correction;

use crate::Completion;
use crate::console::{self, Console};
use crate::input::{Reading, files};
use crate::models::read_model;
use crate::table::{Table, number};

/// Compare a model with recordings it has not seen
///
/// Runs the model along each recording's positions and prints the error of its force: root mean
/// square in N, and the fit 100 (1 - rms(error) / rms(force - mean force)) in percent. Only samples
/// are scored at which the state of the seal is known, that is after it has slid once in each
/// recording. Classical models do not distinguish deforming from sliding: their table has one
/// column for the motion. Where strokes repeat, their scatter is the repeatability of the
/// recording: no model of the motion can be more accurate. Exit code 3: a recording lost data, or
/// contradicts the model.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Model: model.json, one of those that compare writes, or the folder of a result
    model: PathBuf,
    #[arg(required = true, value_name = "RECORDING", help = files("Recordings to validate on"))]
    recordings: Vec<PathBuf>,
    /// Mass between sensor and seal, in kg: its inertia is subtracted from the readings [default:
    /// the model's sensor, or 0]
    #[arg(long, value_name = "KG", allow_negative_numbers = true)]
    moving_mass_kg: Option<f64>,
    /// Reading at rest without any force of the seal, in N [default: the model's sensor, or 0]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    offset_n: Option<f64>,
    /// Print JSON instead of the table
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    reading: Reading,
}

pub(crate) fn run(console: &Console, args: &Args) -> anyhow::Result<Completion> {
    let model = read_model(&args.model, &args.recordings)?;
    let choice = args.reading.choosing.choice_for(console, &model);
    let correction = Correction::of(&model, args.offset_n, args.moving_mass_kg)?;
    console.remark(&format!(
        "offset {} N and moving mass {} kg subtracted from the readings",
        number(correction.offset_n),
        number(correction.moving_mass_kg)
    ));
    let mut lost = false;
    let mut scored = Vec::with_capacity(args.recordings.len());
    let mut qualities = Vec::with_capacity(args.recordings.len());
    for path in &args.recordings {
        let mut all: Option<Scored> = None;
        args.reading.pieces(console, path, &choice, |piece| {
            lost |= !piece.quality.warnings.is_empty();
            let piece = correction.taken_out_of(piece)?;
            let one = validate_one(&model.trocar, &piece, correction.offset_n);
            all = Some(match all.take() {
                Some(before) => before.plus(one),
                None => {
                    qualities.push(piece.quality);
                    one
                }
            });
            Ok(())
        })?;
        scored.extend(all);
    }
    let mut validation = Validation::of(scored).beside_model(&model, &qualities);
    for (result, path) in validation.recordings.iter_mut().zip(&args.recordings) {
        result.path = path.display().to_string();
        // A force of the opposite sign was a warning when the file was read.
        for warning in result.warnings.iter().filter(|warning| !warning.contains(OPPOSED)) {
            console.warn(&format!("{}: {warning}", result.path));
        }
    }
    for result in &validation.recordings {
        if let Some(strokes) = &result.strokes {
            console.remark(&format!("{}: {}", result.path, strokes.words()));
        }
    }
    if args.json {
        console::print_json(&validation)?;
    } else {
        console::print(&table(&validation))?;
    }
    Ok(Completion::doubtful_if(lost || validation.is_doubtful()))
}

/// One line per recording, and one for all.
pub(crate) fn table(validation: &Validation) -> String {
    let classical = validation.recordings.iter().any(|r| r.by_phase.moving.is_some());
    let phases = if classical {
        vec!["moving N", "hold N"]
    } else {
        vec!["deforming N", "sliding N", "hold N"]
    };
    let common = ["recording", "rms N", "fit %", "bias N", "worst N"];
    let repeats = validation.recordings.iter().any(|r| r.strokes.is_some());
    let floor = if repeats { vec!["repeatability N", "rms/repeatability"] } else { Vec::new() };
    let torque = validation.recordings.iter().any(|r| r.torque_rms_n_m.is_some());
    let torque = torque.then_some("torque rms N m");
    let headers = common.into_iter().chain(phases).chain(["samples"]).chain(torque).chain(floor);
    let mut table = Table::headed(headers);
    for r in &validation.recordings {
        let Phases { deformation, sliding, moving, hold, .. } = r.by_phase;
        let parts = if classical {
            vec![moving, Some(hold)]
        } else {
            [deformation, sliding, hold].map(Some).to_vec()
        };
        let numbers =
            [number(r.rms_n), format!("{:.2}", r.fit_percent), number(r.bias_n), number(r.worst_n)];
        let strokes =
            r.strokes.map(|s| [number(s.stroke_scatter_n), format!("{:.2}", s.rms_over_scatter)]);
        let strokes = strokes.into_iter().flatten();
        let common = [r.path.clone()].into_iter().chain(numbers);
        table.row(
            common
                .chain(parts.into_iter().map(phase))
                .chain([r.samples.to_string()])
                .chain(torque.map(|_| r.torque_rms_n_m.map_or("-".to_owned(), number)))
                .chain(strokes),
        );
    }
    table.row([
        "all".to_owned(),
        number(validation.rms_n),
        format!("{:.2}", validation.fit_percent),
    ]);
    table.to_text()
}

/// Error in a phase, if the phase occurred.
fn phase(part: Option<PhaseError>) -> String {
    part.filter(|part| part.samples > 0).map_or_else(|| "-".to_owned(), |part| number(part.rms_n))
}
