//! `trocar teleop`

use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Context;
use serde::Serialize;
use trocar::model_file::ModelFile;
use trocar::output::AtomicFile;
use trocar::report::teleop::{Source, SourcedModel, TeleopReport};
use trocar::report::{self, teleop as teleop_report};
use trocar::teleop::advise::{Advice, Map, advise, map};
use trocar::teleop::config::EXAMPLE_TOML;
use trocar::teleop::merit::Merit;
use trocar::teleop::stability::Trial;
use trocar::teleop::{Config, Loop, plants, write_course};
use trocar_model::Trocar;

use crate::Completion;
use crate::console::{self, BadArgument, Console};
use crate::models;
use crate::progress::Progress;
use crate::table::{Table, number};

/// Delays, in samples, and fractions of a map.
const DELAYS: u32 = 20;
const FRACTIONS: u32 = 20;

/// Run a teleoperation loop through a trocar: what the operator feels, and whether it is stable
///
/// Operator, master, channel, slave, trocar, tissue and sensor along the axis of the instrument. Prints
/// what is felt of the tissue with the fraction of the trocar's force that is taken out. --advise finds the
/// best fraction over the model's 95 % intervals, --map the stiffest tissue held over delay and fraction. A
/// loop that is unstable gives exit code 3.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The loop, TOML (see --print-config); without it, the defaults
    #[arg(value_name = "CONFIG.toml")]
    config: Option<PathBuf>,
    /// Model of the trocar (model.json, or the folder of a result); 'plausible' is the default model
    #[arg(long, value_name = "MODEL", required_unless_present = "print_config")]
    model: Option<PathBuf>,
    /// Model in the compensator; without it, the same
    #[arg(long, value_name = "MODEL")]
    compensator: Option<PathBuf>,
    /// Find the fraction of the trocar's force to take out
    #[arg(long)]
    advise: bool,
    /// Find the stiffest tissue with which the loop is stable, over delays up to 19 samples and fractions up
    /// to 1.425
    #[arg(long)]
    map: bool,
    /// Write the course of the loop: .parquet, .arrow, .csv, .csv.gz or .csv.zst, '-' for CSV to standard
    /// output
    #[arg(long, value_name = "TABLE")]
    out: Option<PathBuf>,
    /// Write a report, one HTML page that needs nothing else, with what --advise and --map find, and the loop
    /// itself to try by hand
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
    /// Print a documented loop with all defaults and stop
    #[arg(long)]
    print_config: bool,
}

/// Everything that was asked for.
#[derive(Serialize)]
struct Answer {
    fraction: f64,
    /// Whether it comes to rest in the tissue after a push.
    settles: bool,
    /// None where it does not, or diverges.
    figures: Option<Merit>,
    /// When it diverged, s.
    unstable_after_s: Option<f64>,
    advice: Option<Advice>,
    map: Option<Map>,
}

pub(crate) fn run(console: &Console, args: &Args) -> anyhow::Result<Completion> {
    let (Some(model), false) = (&args.model, args.print_config) else {
        console::print(EXAMPLE_TOML)?;
        return Ok(Completion::Clean);
    };
    let config = args.config.as_deref().map(read).transpose()?.unwrap_or_default();
    check(args, &config)?;
    let file = model_of(model)?;
    let compensator = args.compensator.as_deref().map(model_of).transpose()?;
    let in_compensator = compensator.as_ref().map_or(&file.trocar, |other| &other.trocar);
    let start = config.motion.start_m();
    let mut tried = Loop::new(&config, file.trocar.clone(), in_compensator.clone(), start)?;
    let samples = tried.run(config.samples(), |time| config.motion.at(time));
    if let (Some(out), Ok(samples)) = (&args.out, &samples) {
        write_course(samples, out)?;
    }
    let surface = config.tissue.surface_m;
    let settles = Trial::default().is_stable(&config, &file.trocar, in_compensator, surface)?;
    let stable = samples.as_ref().ok().filter(|_| settles);
    let answer = Answer {
        fraction: config.compensation.fraction,
        settles,
        figures: stable.map(|samples| Merit::of(&config, samples)),
        unstable_after_s: samples.as_ref().err().map(|diverged| diverged.time_s),
        advice: args.advise.then(|| advice(console, &config, in_compensator, &file)).transpose()?,
        map: args
            .map
            .then(|| stability_map(console, &config, in_compensator, &file))
            .transpose()?,
    };
    let text =
        if args.json { serde_json::to_string_pretty(&answer)? + "\n" } else { text(&answer) };
    if args.out.as_deref() != Some(Path::new("-")) {
        console::print(&text)?;
    }
    if let Some(path) = &args.report {
        let named = |trocar, path: &Path, file| {
            Ok::<_, anyhow::Error>(SourcedModel { trocar, source: model_source(path, file)? })
        };
        let compensator = match (&args.compensator, &compensator) {
            (Some(path), Some(other)) => Some(named(&other.trocar, path, other)?),
            _ => None,
        };
        let input = TeleopReport {
            config: &config,
            config_source: args.config.as_deref().map(source).transpose()?,
            trocar: named(&file.trocar, model, &file)?,
            compensator,
            course: samples.as_deref().map_err(|diverged| *diverged),
            settles,
            figures: answer.figures.as_ref(),
            advice: answer.advice.as_ref(),
            map: answer.map.as_ref(),
        };
        write_report(&input, path)?;
        console.remark(&format!("report: {}", path.display()));
    }
    let advised = answer.advice.as_ref().is_none_or(|advice| advice.fraction.is_some());
    let unstable = match samples {
        Err(diverged) => Some(diverged.to_string()),
        Ok(_) if !settles => Some(
            "the loop is unstable: after a push into the tissue it does not come to rest"
                .to_owned(),
        ),
        Ok(_) => None,
    };
    if let (Some(out), true) = (&args.out, answer.unstable_after_s.is_some()) {
        console.warn(&format!("{}: not written", out.display()));
    }
    if let Some(why) = &unstable {
        console.warn(&format!(
            "{why}\n\nhint: --advise finds the fractions of the trocar's force with which it is stable; a lower force_gain, a \
             shorter delay or passivity = true in [control] help, too"
        ));
    }
    Ok(Completion::doubtful_if(unstable.is_some() || !advised))
}

/// Refuses what would be computed in vain.
fn check(args: &Args, config: &Config) -> anyhow::Result<()> {
    let to_stdout = args.out.as_deref() == Some(Path::new("-"));
    if to_stdout && (args.json || args.advise || args.map) {
        let text = "--out - prints the course alone\n\nhint: write it to a file, or leave out --json, --advise and --map";
        return Err(BadArgument(text.to_owned()).into());
    }
    if args.report.as_deref() == Some(Path::new("-")) {
        let text = "--report - : the report is a page and needs a file";
        return Err(BadArgument(text.to_owned()).into());
    }
    if (args.advise || args.map) && !config.uses_compensation() {
        let text = "the fraction of the trocar's force changes nothing in this loop: position_position and wave send no force, and a \
                    sensor at the tip reads none of it\n\nhint: leave out --advise and --map";
        return Err(BadArgument(text.to_owned()).into());
    }
    Ok(())
}

fn read(path: &Path) -> anyhow::Result<Config> {
    let name = || path.display().to_string();
    let text = std::fs::read_to_string(path)
        .with_context(|| format!("{}: cannot read the loop", name()))?;
    Config::from_toml(&text).with_context(name)
}

fn write_report(input: &TeleopReport, path: &Path) -> anyhow::Result<()> {
    let page = report::page(&teleop_report::document(input))?;
    let mut file = AtomicFile::create(path)?;
    file.write_all(page.as_bytes()).map_err(|source| file.write_error(source))?;
    Ok(file.commit()?)
}

/// The file at `path`, by its name without its folder.
fn source(path: &Path) -> anyhow::Result<Source> {
    let bytes = std::fs::read(path).with_context(|| path.display().to_string())?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    Ok(Source::new(name, &bytes))
}

fn model_source(path: &Path, file: &ModelFile) -> anyhow::Result<Source> {
    match path.to_str() {
        Some("plausible") => Ok(Source::new("plausible", file.to_json().as_bytes())),
        _ if path.is_dir() => source(&path.join("model.json")),
        _ => source(path),
    }
}

fn model_of(path: &Path) -> anyhow::Result<ModelFile> {
    match path.to_str() {
        Some("plausible") => Ok(ModelFile::plausible_10_5_mm()?),
        _ => models::read_model(path, &[]),
    }
}

fn advice(
    console: &Console,
    config: &Config,
    compensator: &Trocar<Vec<f64>>,
    file: &ModelFile,
) -> anyhow::Result<Advice> {
    let plants = plants(file).context("the model at an end of its 95 % intervals")?;
    if plants.len() == 1 {
        console.remark(
            "the model has no 95 % intervals: the advice is for a trocar that equals the model",
        );
    }
    Ok(advise(config, compensator, &plants)?)
}

fn stability_map(
    console: &Console,
    config: &Config,
    compensator: &Trocar<Vec<f64>>,
    file: &ModelFile,
) -> anyhow::Result<Map> {
    let delays: Vec<f64> = (0..DELAYS).map(|k| f64::from(k) * config.sample_time_s).collect();
    let fractions: Vec<f64> = (0..FRACTIONS).map(|k| 0.075 * f64::from(k)).collect();
    let progress = Progress::new(console);
    let (done, cells) = (std::sync::atomic::AtomicU32::new(0), DELAYS * FRACTIONS);
    let report = || {
        let done = 1 + done.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        progress.report("stability map", f64::from(done) / f64::from(cells));
    };
    Ok(map(config, [compensator, &file.trocar], &delays, &fractions, report)?)
}

fn text(answer: &Answer) -> String {
    let mut text = String::new();
    match (&answer.figures, answer.unstable_after_s) {
        (Some(figures), _) => {
            let share = number(100.0 * answer.fraction);
            text += &format!("with {share} % of the trocar's force taken out:\n");
            text += &figures_table(figures);
        }
        (None, Some(time)) => text += &format!("unstable: diverged after {} s\n", number(time)),
        (None, None) => text += "unstable: it does not come to rest after a push into the tissue\n",
    }
    if let Some(advice) = &answer.advice {
        text += &advice_text(advice);
    }
    if let Some(map) = &answer.map {
        text += &map_text(map);
    }
    text
}

fn figures_table(figures: &Merit) -> String {
    let mut table = Table::headed(["figure", "value", "unit"]);
    for (what, value, unit) in figures.rows() {
        let value = value.map_or("no contact".to_owned(), number);
        table.row([what.to_owned(), value, unit.to_owned()]);
    }
    table.to_text()
}

fn advice_text(advice: &Advice) -> String {
    let Some(fraction) = advice.fraction else {
        return "\nno fraction from 0 to 150 % makes the loop stable\n".to_owned();
    };
    let share = |fraction: f64| number(100.0 * fraction);
    let ranges: Vec<String> = advice
        .stable
        .iter()
        .map(|[low, high]| format!("{} to {} %", share(*low), share(*high)))
        .collect();
    let mut text = format!(
        "\ntake out {} % of the trocar's force: the least error of the force felt among the fractions that are stable \
         ({})\n",
        share(fraction),
        ranges.join(", ")
    );
    if let Some(figures) = &advice.with {
        text += &figures_table(figures);
    }
    text + match advice.without {
        Some(_) => "",
        None => "without compensation the loop is unstable\n",
    }
}

fn map_text(map: &Map) -> String {
    let mut text =
        "\nstiffest tissue up to which the loop is stable (N/m, from 1 to 20 000; 0: none), delay of one direction in ms down, \
         percentage taken out across\n"
            .to_owned();
    text += "      ";
    map.fractions.iter().for_each(|fraction| text += &format!("{:6.0}", 100.0 * fraction));
    text.push('\n');
    for (delay, row) in map.delays_s.iter().zip(&map.stiffness_n_m) {
        text += &format!("{:6.1}", 1e3 * delay);
        row.iter().for_each(|stiffness| text += &format!("{stiffness:6.0}"));
        text.push('\n');
    }
    text
}
