//! `trocar teleop`

use std::path::{Path, PathBuf};

use anyhow::Context;
use serde::Serialize;
use trocar::model_file::ModelFile;
use trocar::report::teleop::{self as teleop_report, SourcedModel, TeleopReport};
use trocar::teleop::advise::{Advice, Map, Tried, advise, map};
use trocar::teleop::config::{EXAMPLE_TOML, PRESETS, TissueKind};
use trocar::teleop::hybrid::response;
use trocar::teleop::merit::Merit;
use trocar::teleop::stability::{Trial, ZWidth};
use trocar::teleop::{Config, Loop, draws, plants, write_course, write_response};
use trocar_model::Trocar;

use crate::Completion;
use crate::console::{self, BadArgument, Console};
use crate::models;
use crate::page::{self, model_source, source};
use crate::progress::Progress;
use crate::table::{Table, number};

/// Delays, in samples, and fractions of a map.
const DELAYS: u32 = 20;
const FRACTIONS: u32 = 20;
/// Frequencies of the hybrid matrix, evenly in their logarithm: how many, the lowest and the highest, Hz.
const FREQUENCIES: u32 = 61;
const LOWEST_HZ: f64 = 0.1;
const HIGHEST_HZ: f64 = 100.0;

/// Run a teleoperation loop through a trocar: what the operator feels, and whether it is stable
///
/// Operator, master, channel, slave, trocar, tissue and sensor along the axis of the instrument. Prints
/// what is felt of the tissue with the fraction of the trocar's force that is taken out, and the range of
/// the tissue's stiffness that the loop holds stably. --advise finds the best fraction over the model's
/// 95 % intervals, --map the range of stiffness over delay and fraction. A loop that is unstable, or a tip
/// that does not reach the tissue, gives exit code 3.
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
    /// With --advise: besides the model and both ends of its intervals, try this many draws from them (seed of
    /// the loop)
    #[arg(long, value_name = "N", requires = "advise", value_parser = clap::value_parser!(u16).range(1..=1000))]
    draws: Option<u16>,
    /// Find the stiffest and the softest tissue with which the loop is stable, over delays up to 19 samples and
    /// fractions up to 1.425
    #[arg(long)]
    map: bool,
    /// Write the hybrid matrix over frequency, with the trocar as its describing function at the amplitude of
    /// the motion: .parquet, .arrow, .csv, .csv.gz or .csv.zst
    #[arg(long, value_name = "TABLE")]
    hybrid: Option<PathBuf>,
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
    /// Print a documented loop and stop: all defaults, or a device
    #[arg(long, value_name = "DEVICE", num_args = 0..=1, default_missing_value = "default",
          value_parser = ["default", "dvrk", "phantom"])]
    print_config: Option<String>,
}

/// Everything that was asked for.
#[derive(Serialize)]
struct Answer {
    fraction: f64,
    /// Whether it comes to rest in the tissue after a push.
    settles: bool,
    /// None where it does not, or diverges.
    figures: Option<Merit>,
    /// Stiffnesses of the tissue with which the loop is stable; none where it is with none that is tried.
    z_width: Option<ZWidth>,
    /// When it diverged, s.
    unstable_after_s: Option<f64>,
    advice: Option<Advice>,
    map: Option<Map>,
}

pub(crate) fn run(console: &Console, args: &Args) -> anyhow::Result<Completion> {
    if let Some(device) = &args.print_config {
        let preset = PRESETS.iter().find(|(name, _)| name == device);
        console::print(preset.map_or(EXAMPLE_TOML, |(_, text)| text))?;
        return Ok(Completion::Clean);
    }
    let Some(model) = &args.model else { return Ok(Completion::Clean) };
    let config = args.config.as_deref().map(read).transpose()?.unwrap_or_default();
    check(args, &config)?;
    let file = model_of(model)?;
    let compensator = args.compensator.as_deref().map(model_of).transpose()?;
    let config = config.with_force_error(compensator.as_ref().unwrap_or(&file));
    let in_compensator = compensator.as_ref().map_or(&file.trocar, |other| &other.trocar);
    let models = [in_compensator, &file.trocar];
    let start = config.motion.start_m();
    let mut tried = Loop::new(&config, file.trocar.clone(), in_compensator.clone(), start)?;
    let samples = tried.run(config.samples(), |time| config.motion.at(time));
    if let (Some(out), Ok(samples)) = (&args.out, &samples) {
        write_course(samples, out)?;
    }
    if let Some(out) = &args.hybrid {
        let amplitude = config.motion.amplitude_m.abs();
        write_response(&response(&config, models, amplitude, &frequencies())?, out)?;
    }
    let surface = config.tissue.surface_m;
    let settles = Trial::default().is_stable(&config, &file.trocar, in_compensator, surface)?;
    let stable = samples.as_ref().ok().filter(|_| settles);
    let answer = Answer {
        fraction: config.compensation.fraction,
        settles,
        figures: stable.map(|samples| Merit::of(&config, samples)),
        z_width: ZWidth::of(&config, models)?,
        unstable_after_s: samples.as_ref().err().map(|diverged| diverged.time_s),
        advice: args.advise.then(|| advice(console, args, &config, models, &file)).transpose()?,
        map: args.map.then(|| stability_map(console, &config, models)).transpose()?,
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
            z_width: answer.z_width.as_ref(),
            advice: answer.advice.as_ref(),
            map: answer.map.as_ref(),
        };
        page::write(&teleop_report::document(&input), path)?;
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
    let out_of_reach = warn_of_no_contact(console, &config, &answer);
    Ok(Completion::doubtful_if(unstable.is_some() || !advised || out_of_reach))
}

/// Whether there is tissue that the tip does not reach: the figures then say nothing about it.
fn warn_of_no_contact(console: &Console, config: &Config, answer: &Answer) -> bool {
    let touches = |figures: &Merit| figures.true_stiffness_n_m.is_some();
    let out_of_reach =
        config.tissue.kind != TissueKind::None && answer.figures.is_some_and(|f| !touches(&f));
    if out_of_reach {
        console.warn(
            "the tip does not reach the tissue: the figures are those of free motion\n\nhint: let the hand go further, see \
             [motion]; with passivity = true give the control a passivity_reserve_j",
        );
    }
    out_of_reach
}

fn frequencies() -> Vec<f64> {
    let ratio = (HIGHEST_HZ / LOWEST_HZ).ln() / f64::from(FREQUENCIES - 1);
    (0..FREQUENCIES).map(|k| LOWEST_HZ * (ratio * f64::from(k)).exp()).collect()
}

/// Refuses what would be computed in vain.
fn check(args: &Args, config: &Config) -> anyhow::Result<()> {
    let to_stdout = args.out.as_deref() == Some(Path::new("-"));
    if to_stdout && (args.json || args.advise || args.map) {
        let text = "--out - prints the course alone\n\nhint: write it to a file, or leave out --json, --advise and --map";
        return Err(BadArgument(text.to_owned()).into());
    }
    page::needs_a_file(args.report.as_deref())?;
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

fn model_of(path: &Path) -> anyhow::Result<ModelFile> {
    match path.to_str() {
        Some("plausible") => Ok(ModelFile::plausible_10_5_mm()?),
        _ => models::read_model(path, &[]),
    }
}

fn advice(
    console: &Console,
    args: &Args,
    config: &Config,
    [model, _]: [&Trocar<Vec<f64>>; 2],
    file: &ModelFile,
) -> anyhow::Result<Advice> {
    let mut plants = plants(file).context("the model at an end of its 95 % intervals")?;
    if plants.len() == 1 {
        console.remark(
            "the model has no 95 % intervals: the advice is for a trocar that equals the model",
        );
    }
    if let Some(count) = args.draws {
        if plants.len() == 1 {
            let text = "--draws needs a model with 95 % intervals, as identify writes it";
            return Err(BadArgument(text.to_owned()).into());
        }
        let drawn = draws(file, usize::from(count), config.seed);
        plants.extend(drawn.context("draws from the model's 95 % intervals")?);
    }
    Ok(advise(config, model, &plants)?)
}

fn stability_map(
    console: &Console,
    config: &Config,
    models: [&Trocar<Vec<f64>>; 2],
) -> anyhow::Result<Map> {
    let delays: Vec<f64> = (0..DELAYS).map(|k| f64::from(k) * config.sample_time_s).collect();
    let fractions: Vec<f64> = (0..FRACTIONS).map(|k| 0.075 * f64::from(k)).collect();
    let progress = Progress::new(console);
    let (done, cells) = (std::sync::atomic::AtomicU32::new(0), DELAYS * FRACTIONS);
    let report = || {
        let done = 1 + done.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        progress.report("stability map", f64::from(done) / f64::from(cells));
    };
    Ok(map(config, models, &delays, &fractions, report)?)
}

fn text(answer: &Answer) -> String {
    let mut text = String::new();
    match (&answer.figures, answer.unstable_after_s) {
        (Some(_), _) => {}
        (None, Some(time)) => text += &format!("unstable: diverged after {} s\n", number(time)),
        (None, None) => text += "unstable: it does not come to rest after a push into the tissue\n",
    }
    text += &match &answer.z_width {
        Some(ZWidth { least_n_m, greatest_n_m }) => format!(
            "stable with tissue of {} to {} N/m\n",
            number(*least_n_m),
            number(*greatest_n_m)
        ),
        None => "stable with no tissue from 0 to 20 000 N/m\n".to_owned(),
    };
    let advised = answer.advice.as_ref().and_then(|a| Some((a.fraction?, a.with.as_ref()?)));
    let cases: Vec<(f64, &Merit)> =
        answer.figures.iter().map(|figures| (answer.fraction, figures)).chain(advised).collect();
    if !cases.is_empty() {
        text += "\nwith a percentage of the trocar's force taken out:\n";
        text += &figures_table(&cases);
    }
    if let Some(advice) = &answer.advice {
        text += &advice_text(advice);
    }
    if let Some(map) = &answer.map {
        text += &map_text(map);
    }
    text
}

/// Figures side by side, each with the fraction of the trocar's force that is taken out.
fn figures_table(cases: &[(f64, &Merit)]) -> String {
    let percentages: Vec<String> =
        cases.iter().map(|(fraction, _)| format!("{} %", number(100.0 * fraction))).collect();
    let own = percentages.iter().map(String::as_str);
    let mut table = Table::headed(std::iter::once("figure").chain(own).chain(["unit"]));
    let columns: Vec<_> = cases.iter().map(|(_, figures)| figures.rows()).collect();
    for (k, (what, _, unit)) in columns.first().into_iter().flatten().enumerate() {
        let values = columns.iter().map(|rows| rows[k].1.map_or("no contact".to_owned(), number));
        let row = std::iter::once((*what).to_owned()).chain(values);
        table.row(row.chain([(*unit).to_owned()]));
    }
    table.to_text()
}

fn advice_text(advice: &Advice) -> String {
    let Some(fraction) = advice.fraction else {
        return "\nno fraction from 0 to 150 % makes the loop stable\n".to_owned()
            + &partly_stable(advice);
    };
    let share = |fraction: f64| number(100.0 * fraction);
    let range = |[low, high]: &[f64; 2]| format!("{} to {} %", share(*low), share(*high));
    let ranges: Vec<String> = advice.stable.iter().map(range).collect();
    let mut text = format!(
        "\ntake out {} % of the trocar's force: the least error of the force felt among the fractions that are stable \
         ({})\n",
        share(fraction),
        ranges.join(", ")
    );
    text += &partly_stable(advice);
    if let (Some(best), true) = (&advice.best, advice.plants > 1) {
        text +=
            &format!("best for each of the {} trocars by itself: {}\n", advice.plants, range(best));
    }
    let step =
        |step: Option<f64>| step.map_or("none up to 10 times".to_owned(), |s| number(s) + " N/m");
    text += &format!(
        "least step of the tissue's stiffness that is noticed: {}",
        step(advice.noticeable_with_n_m)
    );
    text + &match advice.without {
        Some(_) => {
            format!("; without compensation: {}\n", step(advice.noticeable_without_n_m))
        }
        None => "\nwithout compensation the loop is unstable\n".to_owned(),
    }
}

/// Fractions with which the loop is stable with some of the trocars, and with how many.
fn partly_stable(advice: &Advice) -> String {
    let is_partly = |tried: &&Tried| tried.stable_share > 0.0 && !tried.stable;
    let held = |tried: &Tried| {
        let count = (tried.stable_share * advice.plants as f64).round();
        format!("{} % ({count})", number(100.0 * tried.fraction))
    };
    let partly: Vec<String> = advice.tried.iter().filter(is_partly).map(held).collect();
    if partly.is_empty() {
        return String::new();
    }
    format!("stable with some of the {} trocars: {}\n", advice.plants, partly.join(", "))
}

fn map_text(map: &Map) -> String {
    let mut text = "\nstiffest tissue with which the loop is stable (N/m; from 0 to 20 000 are tried; -: with none), delay of one \
                    direction in ms down, percentage taken out across\n"
        .to_owned();
    text += &grid(map, |delay, fraction| {
        map.least_stiffness_n_m[delay][fraction].map(|_| map.stiffness_n_m[delay][fraction])
    });
    if map.least_stiffness_n_m.iter().flatten().any(|least| least.is_some_and(|least| least > 0.0))
    {
        text += "\nsoftest tissue with which it is (N/m)\n";
        text += &grid(map, |delay, fraction| map.least_stiffness_n_m[delay][fraction]);
    }
    text
}

/// A number for each delay, down, and fraction, across.
fn grid(map: &Map, of: impl Fn(usize, usize) -> Option<f64>) -> String {
    let mut text = " ".repeat(6);
    map.fractions.iter().for_each(|fraction| text += &format!("{:6.0}", 100.0 * fraction));
    text.push('\n');
    for (row, delay) in map.delays_s.iter().enumerate() {
        text += &format!("{:6.1}", 1e3 * delay);
        for column in 0..map.fractions.len() {
            text += &of(row, column).map_or(format!("{:>6}", "-"), |value| format!("{value:6.0}"));
        }
        text.push('\n');
    }
    text
}
