//! `trocar bench`

use std::path::{Path, PathBuf};

use anyhow::Context;
use trocar::bench::config::DEFAULT_TOML;
use trocar::bench::{self, BenchConfig, Course, Experiment, Protocol};
use trocar::model_file::ModelFile;
use trocar::recording::Choice;
use trocar::simulate::Positions;
use trocar_model::{Element, ElementParams, Rotation};

use crate::Completion;
use crate::console::{self, BadArgument, Console};
use crate::input::{Choosing, toml};
use crate::output::Output;
use crate::progress::Progress;
use crate::table::number;
use crate::verbs::ranges::seals_like;

/// Columns of the recording and of its true values.
const BYTES_OF_A_SAMPLE: usize = 16 * size_of::<f64>();

/// Record an experiment on the virtual test bench
///
/// A linear motor moves a rod through a seal; position and force are recorded through an encoder
/// and a force sensor, as on a rig. Writes the columns time_s, position_m, velocity_m_s and
/// force_n; angle_rad and torque_n_m where the rod turns. Exit code 3: a sensor was saturated, or
/// the carriage ran into a safety stop.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Experiment: steady (cycles from 15 to 100 mm/s), dynamic (cycles under constant force),
    /// validation (40 mm strokes), step (one reversal), surgeon (hand-like motion), rest (strokes
    /// between rests of 0.1 to 60 s), roll (strokes while turning), hold-and-turn (by 90 degrees)
    #[arg(required_unless_present_any = ["print_config", "motion"])]
    protocol: Option<Protocol>,
    /// Motion to make in place of an experiment: a table with time, position and, if the rod turns, an
    /// angle, such as `trocar plan` writes
    #[arg(long, value_name = "FILE", conflicts_with = "protocol")]
    motion: Option<PathBuf>,
    /// Recording to write, '-' for standard output; the extension selects CSV, .parquet, .arrow,
    /// .csv.gz or .csv.zst
    #[arg(long, value_name = "FILE", required_unless_present = "print_config")]
    out: Option<Output>,
    /// Rig and protocol, TOML; keys left out keep their defaults (see --print-config)
    #[arg(long, value_name = "FILE")]
    rig: Option<PathBuf>,
    /// Seal to test, model.json [default: a plausible, made-up one-stage 10.5 mm trocar]
    #[arg(long, value_name = "MODEL")]
    seal: Option<PathBuf>,
    /// Draw the seal, by the seed, from published friction forces: a key of `trocar ranges`
    #[arg(long, value_name = "KEY", conflicts_with = "seal")]
    like: Option<String>,
    /// Seed of noise, fluctuation, hand-like motion and the seal of --like
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Also write what only a simulation knows (true motion, forces and deflections)
    #[arg(long, value_name = "FILE")]
    truth_out: Option<Output>,
    /// Print the rig and protocol as a documented TOML file and stop
    #[arg(long)]
    print_config: bool,
    #[command(flatten)]
    choosing: Choosing,
}

pub(crate) fn run(console: &Console, args: &Args) -> anyhow::Result<Completion> {
    let choice = args.choosing.choice();
    if args.motion.is_none() && choice != Choice::default() {
        let text = "options for reading recordings need --motion: an experiment reads no recording";
        return Err(BadArgument(text.to_owned()).into());
    }
    let config =
        args.rig.as_deref().map(|path| toml(path, "rig", BenchConfig::from_toml)).transpose()?;
    let (false, Some(out)) = (args.print_config, &args.out) else {
        console::print(&config.map_or(DEFAULT_TOML.to_owned(), |config| config.to_toml()))?;
        return Ok(Completion::Clean);
    };
    let (elements, rotation) = match &args.like {
        Some(key) => (vec![seal_like(console, key, args.seed)?], None),
        None => seal(console, args.seal.as_deref())?,
    };
    let mut config = config.unwrap_or_default();
    config.rotation = rotation;
    let progress = Progress::new(console);
    let motion = args.motion.as_deref().map(|path| read_motion(path, &choice)).transpose()?;
    let experiment = Experiment::of(args.protocol, motion)?;
    if let Experiment::Protocol(protocol) = experiment {
        say_if_long(console, bench::length(&config, protocol)?);
    }
    if experiment.turns() && config.rotation.is_none() {
        config = bench::turning(&config, &elements);
        let stiffness = config.rotation.map_or(0.0, |own| own.circumferential_stiffness);
        console.remark(&format!(
            "rotation: as along the shaft, k_t {} N/m and F_t/F_c 1; the seal's model has none",
            number(stiffness)
        ));
    }
    progress.report(experiment.name(), 0.0);
    let run = experiment.run(&config, &elements, args.seed);
    let run = match &args.motion {
        Some(path) => run.with_context(|| path.display().to_string())?,
        None => run?,
    };
    drop(progress);
    run.write(out)?;
    if let Some(path) = &args.truth_out {
        run.write_truth(path)?;
    }
    console.remark(&format!("{} samples -> {}", run.time.len(), out.display()));
    let warnings = run.events.warnings();
    warnings.iter().for_each(|warning| console.warn(warning));
    if let Some(note) = run.events.note() {
        console.remark(&format!("note: {note}"));
    }
    Ok(Completion::doubtful_if(!warnings.is_empty()))
}

/// Says what a long recording will take, before it is made.
fn say_if_long(console: &Console, samples: usize) {
    const LONG: usize = 1_000_000;
    if samples > LONG {
        console.remark(&format!(
            "note: up to {samples} samples, {} MB in memory",
            samples * BYTES_OF_A_SAMPLE / 1_000_000
        ));
    }
}

fn read_motion(path: &Path, choice: &Choice) -> anyhow::Result<Course> {
    let mut rows = Positions::open(path, choice)?;
    let mut course = Course::default();
    while let Some(step) = rows.advance()? {
        if course.time.is_empty() || step.duration > 0.0 {
            course.time.push(step.time);
            course.position.push(step.position);
            if let Some(angle) = step.angle {
                course.angle.get_or_insert_default().push(angle);
            }
        }
    }
    Ok(course)
}

/// The seal of the file at `path`, and how it resists rotation.
fn seal(
    console: &Console,
    path: Option<&Path>,
) -> anyhow::Result<(Vec<Element>, Option<Rotation>)> {
    let Some(path) = path else {
        console.remark("seal: a plausible, made-up 10.5 mm trocar; give another with --seal");
        return Ok((ModelFile::plausible_10_5_mm()?.stages()?.elements().to_vec(), None));
    };
    let model = ModelFile::read(path)?;
    let stages = model.stages().map_err(|error| error.in_file(path))?;
    Ok((stages.elements().to_vec(), model.trocar.rotation().copied()))
}

/// A seal drawn from the published ranges of `key`.
fn seal_like(console: &Console, key: &str, seed: u64) -> anyhow::Result<Element> {
    let params = bench::random_seal(&seals_like(key)?, seed);
    let ElementParams { deformation, insertion, withdrawal, .. } = &params;
    console.remark(&format!(
        "seal: drawn from {key}: F_c {} N in, {} N out; made up: β {} N s/m in, {} N s/m out, c {} mm",
        number(insertion.coulomb_force),
        number(withdrawal.coulomb_force),
        number(insertion.viscous_damping),
        number(withdrawal.viscous_damping),
        number(1e3 * deformation.half_width())
    ));
    Ok(Element::new(params)?)
}
