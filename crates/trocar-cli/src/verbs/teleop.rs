//! `trocar teleop`

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::Context;
use serde::Serialize;
use trocar::model_file::ModelFile;
use trocar::report::teleop::{self as teleop_report, SourcedModel, TeleopReport};
use trocar::teleop::advise::{self, Advice, MOST, Map, Tried, advise, map_delays, map_fractions};
use trocar::teleop::config::{Architecture, TissueKind, shipped};
use trocar::teleop::hybrid::{frequencies, response};
use trocar::teleop::merit::Merit;
use trocar::teleop::stability::ZWidth;
use trocar::teleop::{Candidates, Config, Outcome, candidates, write_course, write_response};
use trocar_model::Trocar;

use crate::Completion;
use crate::console::{self, BadArgument, Console};
use crate::models;
use crate::page::{self, model_source, source};
use crate::progress::Progress;
use crate::table::{Table, number};

/// Least amplitude of the strokes of a hybrid matrix, m.
const SMALLEST_AMPLITUDE_M: f64 = 1e-9;
/// Longest delay of a map, s.
const LONGEST_MAPPED_S: f64 = 10.0;

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
    /// With --advise: reckon with trocars whose friction is down to this multiple of the model's, as that of a
    /// wetted seal, which loses 15 to 45 %
    #[arg(long, value_name = "SCALE", requires = "advise", value_parser = friction_scale)]
    least_friction: Option<f64>,
    /// Find the stiffest and the softest tissue with which the loop is stable, over fractions up to 1.425 and
    /// delays of one direction up to this one, s (without it, 19 samples)
    #[arg(long, value_name = "DELAY_S", num_args = 0..=1)]
    map: Option<Option<f64>>,
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
        console::print(shipped(device).context("no loop of this name")?)?;
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
    let Outcome { course: samples, settles, figures } = Outcome::of(&config, models)?;
    let map = |longest| stability_map(console, &config, models, longest);
    let answer = Answer {
        fraction: config.compensation.fraction,
        settles,
        figures,
        z_width: ZWidth::of(&config, models)?,
        unstable_after_s: samples.as_ref().err().map(|diverged| diverged.time_s),
        advice: args.advise.then(|| advice(console, args, &config, models, &file)).transpose()?,
        map: args.map.map(map).transpose()?,
    };
    if let Some(out) = &args.hybrid {
        let amplitude = config.motion.amplitude_m.abs();
        write_response(&response(&config, models, amplitude, &frequencies())?, out)?;
    }
    if let (Some(out), Ok(samples)) = (&args.out, &samples) {
        write_course(samples, out)?;
    }
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
        let of_the_hand = match config.control.architecture {
            Architecture::FourChannel if config.operator.mass_kg == 0.0 => {
                "; sampled four channels are unstable with a hand without mass: give operator.mass_kg"
            }
            _ => "",
        };
        console.warn(&format!(
            "{why}\n\nhint: --advise finds the fractions of the trocar's force with which it is stable; a lower force_gain, a \
             shorter delay or passivity = true in [control] help, too{of_the_hand}"
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

fn friction_scale(text: &str) -> Result<f64, String> {
    let scale = text.parse().map_err(|_| "not a number".to_owned())?;
    if (0.01..=1.0).contains(&scale) { Ok(scale) } else { Err("must be from 0.01 to 1".into()) }
}

/// Refuses what would be computed in vain.
fn check(args: &Args, config: &Config) -> anyhow::Result<()> {
    let to_stdout = args.out.as_deref() == Some(Path::new("-"));
    if to_stdout && (args.json || args.advise || args.map.is_some()) {
        let text = "--out - prints the course alone\n\nhint: write it to a file, or leave out --json, --advise and --map";
        return Err(BadArgument(text.to_owned()).into());
    }
    page::needs_a_file(args.report.as_deref())?;
    if args.hybrid.is_some() && config.motion.amplitude_m.abs() < SMALLEST_AMPLITUDE_M {
        let text = format!(
            "--hybrid: the hybrid matrix is that of strokes of motion.amplitude_m, which must be {SMALLEST_AMPLITUDE_M} m or more, got {} m",
            config.motion.amplitude_m
        );
        return Err(BadArgument(text).into());
    }
    if let Some(Some(longest)) = args.map
        && !(longest >= config.sample_time_s && longest <= LONGEST_MAPPED_S)
    {
        let text = format!(
            "--map: the longest delay must be from the sample time, {} s, to {LONGEST_MAPPED_S} s, got {longest} s",
            config.sample_time_s
        );
        return Err(BadArgument(text).into());
    }
    if (args.advise || args.map.is_some()) && !config.uses_compensation() {
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
    if args.draws.is_some() && file.intervals.is_empty() {
        let text = "--draws needs a model with 95 % intervals, as identify writes it";
        return Err(BadArgument(text.to_owned()).into());
    }
    let wanted = Candidates {
        draws: args.draws.map_or(0, usize::from),
        seed: config.seed,
        least_friction_scale: args.least_friction.unwrap_or(1.0),
    };
    let plants = candidates(file, &wanted).context("the model within its 95 % intervals")?;
    if plants.len() == 1 {
        console.remark(
            "the model has no 95 % intervals: the advice is for a trocar that equals the model",
        );
    }
    if args.least_friction.is_none() {
        console.remark(
            "the advice reckons with the model's intervals alone: --least-friction 0.55 adds seals that are wetted",
        );
    }
    Ok(advise(config, model, &plants)?)
}

fn stability_map(
    console: &Console,
    config: &Config,
    models: [&Trocar<Vec<f64>>; 2],
    longest: Option<f64>,
) -> anyhow::Result<Map> {
    let (delays, fractions) = (map_delays(config, longest), map_fractions());
    let progress = Progress::new(console);
    let (done, cells) = (AtomicUsize::new(0), delays.len() * fractions.len());
    let report = || {
        let done = 1 + done.fetch_add(1, Ordering::Relaxed);
        progress.report("stability map", done as f64 / cells as f64);
    };
    Ok(advise::map(config, models, &delays, &fractions, report)?)
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
    let range = |[low, high]: &[f64; 2]| {
        let most = if *high >= MOST { ", the most that is tried" } else { "" };
        match low == high {
            true => format!("{} %{most}", share(*low)),
            false => format!("{} to {} %{most}", share(*low), share(*high)),
        }
    };
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
    map.fractions.iter().for_each(|fraction| text += &format!("{:6.1}", 100.0 * fraction));
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
