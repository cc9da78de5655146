//! `trocar demo`

use std::path::Path;

use rayon::prelude::*;
use trocar::bench::{self, BenchConfig, Protocol};
use trocar::identify::IdentifyOptions;
use trocar::identify::Parameter;
use trocar::model_file::ModelFile;
use trocar::output::StagedFolder;
use trocar::recording::{ReadOptions, Recording, read};
use trocar::report::identification::FigureChoice;
use trocar::report::{prepare, write_workflow};
use trocar::workflow::{MovingMass, Workflow};
use trocar_model::{ElementParams, ParameterId, Quantity, Unit};

use crate::Completion;
use crate::console::{self, Console};
use crate::output::Output;
use crate::progress::Progress;
use crate::table::{Table, interval, number};

use super::identify;

/// Experiments used for identification; the others are used for validation.
const TRAINING: [Protocol; 2] = [Protocol::Steady, Protocol::Dynamic];
const HELD_OUT: [Protocol; 3] = [Protocol::Validation, Protocol::Step, Protocol::Surgeon];

/// What the folder of results holds.
const FILES: [&str; 9] = [
    "truth.json",
    "model.json",
    "card.md",
    "summary.json",
    "report.html",
    "table.*",
    "citation.bib",
    "figures/*",
    "recordings/*",
];

/// Demonstrate the whole workflow on the virtual bench: record, identify, validate, report
///
/// Records all five experiments with a plausible, made-up seal, identifies a model from two of
/// them, validates it on the other three and compares it with the truth. The folder keeps the
/// recordings and the true model. Exit code 3: as for `identify`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Folder for the results; it need not exist
    #[arg(long, value_name = "DIR", default_value = "trocar-demo", value_parser = Output::folder(&FILES))]
    out: Output,
    /// Seed of noise, fluctuation, hand-like motion and identification
    #[arg(long, default_value_t = 1, value_name = "N")]
    seed: u64,
}

pub(crate) fn run(console: &Console, args: &Args) -> anyhow::Result<Completion> {
    prepare();
    let staged = StagedFolder::create(&args.out)?;
    let config = BenchConfig::default();
    let truth = ModelFile::plausible_10_5_mm()?;
    staged.write("truth.json", truth.to_json().as_bytes())?;
    let mut recordings = record_all(console, staged.path(), &config, &truth, args.seed)?;
    let held_out = recordings.split_off(TRAINING.len());
    // As on a rig whose rod was weighed; its weight may stay in the offset.
    let moving_mass = MovingMass { mass: config.rod.mass_kg, gravity: 0.0 };
    let options = IdentifyOptions { seed: args.seed, ..IdentifyOptions::default() };
    let done = identify::run_workflow(console, recordings, held_out, moving_mass, options)?;
    write_workflow(&done, &staged, Some(truth.stages()?.elements()), FigureChoice::default())?;
    staged.commit()?;
    console::print(&in_brief(&done, truth.stages()?.first().params(), &config))?;
    console::print(&format!("\nreport: {}\n", args.out.join("report.html").display()))?;
    Ok(Completion::doubtful_if(done.is_doubtful()))
}

/// Runs the experiments and reads their recordings from the files, as for recordings of a rig.
fn record_all(
    console: &Console,
    folder: &Path,
    config: &BenchConfig,
    seal: &ModelFile,
    seed: u64,
) -> anyhow::Result<Vec<Recording>> {
    let progress = Progress::new(console);
    progress.report("recording", 0.0);
    let folder = folder.join("recordings");
    std::fs::create_dir_all(&folder)?;
    let stages = seal.stages()?;
    let all: Vec<Protocol> = TRAINING.into_iter().chain(HELD_OUT).collect();
    let recordings = all.par_iter().map(|protocol| {
        let run = bench::run(config, *protocol, stages.elements(), seed)?;
        let path = folder.join(format!("{protocol}.csv"));
        run.write(&path)?;
        Ok(read(&path, &ReadOptions::default())?)
    });
    recordings.collect()
}

/// Ten lines: the estimates next to the true values.
fn in_brief(found: &Workflow, truth: &ElementParams, config: &BenchConfig) -> String {
    let mut table = Table::headed(["parameter", "truth", "found", "95 % interval", "unit"]);
    for Parameter { id, estimate } in identify::main_parameters(&found.identification) {
        let Some(true_value) = true_value(*id, truth, config) else { continue };
        let Unit { scale, shown, .. } = id.unit();
        let bounds = estimate.ci95.map(|bound| scale * bound);
        table.row([
            identify::in_words(*id),
            number(scale * true_value),
            number(scale * estimate.value),
            interval(bounds),
            shown.to_owned(),
        ]);
    }
    let mut text = table.to_text();
    for r in found.validation().into_iter().flat_map(|validation| &validation.recordings) {
        text.push_str(&format!(
            "  error on {}: {} N rms, fit {:.2} %\n",
            r.path,
            number(r.rms_n),
            r.fit_percent
        ));
    }
    text
}

/// The true value of the recordings, SI.
fn true_value(id: ParameterId, truth: &ElementParams, config: &BenchConfig) -> Option<f64> {
    if id.quantity != Quantity::Offset {
        return truth.value(id.direction, id.quantity).filter(|_| id.element.is_none());
    }
    // Reading at rest without the seal: gas, weight of the rod, tare.
    let rod = &config.rod;
    let area = std::f64::consts::PI * (0.5 * rod.diameter_m).powi(2);
    Some(config.force_sensor.tare_n + area * rod.gas_pressure_pa - rod.mass_kg * rod.gravity_m_s2)
}
