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
use trocar::teleop::{
    Candidates, Config, Outcome, candidates, posterior_candidates, write_course, write_response,
};
use trocar_model::Trocar;

use crate::Completion;
use crate::console::{self, BadArgument, Console};
use crate::models;
use crate::page::{self, model_source, source};
use crate::progress::Progress;
use crate::table::{Table, number};

/// Least amplitude of the strokes of a hybrid matrix, m.
const SMALLEST_AMPLITUDE_M: f64 = 1e-9;
/// Posterior draws that are tried without --draws.
const POSTERIOR_DRAWS: usize = 20;
/// Longest delay of a map, in samples.
const LONGEST_MAPPED: f64 = 1e4;

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
    /// With --advise: in place of the ends of the intervals and of draws from them, try draws of the
    /// model's parameters that `identify --posterior` wrote: --draws of them, or 20
    #[arg(long, value_name = "FILE", requires = "advise")]
    posterior: Option<PathBuf>,
    /// With --advise: include trocars whose friction is down to this multiple of the model's, as that of a
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
    #[serde(skip)]
    has_tissue: bool,
    /// Of the tissue, N/m.
    #[serde(skip)]
    stiffness_n_m: f64,
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
        has_tissue: config.tissue.kind != TissueKind::None,
        stiffness_n_m: config.tissue.stiffness_n_m,
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
        console
            .warn(&format!("{}: not written; what was there before is still there", out.display()));
    }
    if let Some(why) = &unstable {
        console.warn(&format!("{why}\n\nhint: try {}", remedies(&config, args).join(", ")));
    }
    let out_of_reach = warn_of_no_contact(console, &config, &answer);
    Ok(Completion::doubtful_if(unstable.is_some() || !advised || out_of_reach))
}

/// What may make an unstable loop stable.
fn remedies(config: &Config, args: &Args) -> Vec<&'static str> {
    let control = &config.control;
    let four_channels = control.architecture == Architecture::FourChannel;
    let reflects = control.architecture == Architecture::PositionForce;
    let all = [
        (
            config.uses_compensation() && !args.advise,
            "--advise, which finds the fractions of the trocar's force with which it is stable",
        ),
        (reflects && control.force_gain > 0.0, "a lower control.force_gain"),
        (config.channel.delay_s > 0.0, "a shorter channel.delay_s"),
        (!control.passivity, "control.passivity = true"),
        (
            four_channels && config.operator.mass_kg == 0.0,
            "operator.mass_kg above 0, without which sampled four channels are unstable",
        ),
        (true, "a lower control.stiffness_n_m or another control.damping_n_s_m"),
    ];
    all.into_iter().filter(|(helps, _)| *helps).map(|(_, what)| what).collect()
}

/// Whether there is tissue that the tip does not reach: the figures then say nothing about it.
fn warn_of_no_contact(console: &Console, config: &Config, answer: &Answer) -> bool {
    let tissue = &config.tissue;
    let is_there = tissue.kind != TissueKind::None && tissue.stiffness_n_m > 0.0;
    if is_there && config.begins_in_the_tissue() {
        console.warn(
            "the motion begins in the tissue: no stiffness displayed\n\nhint: begin before tissue.surface_m, see [motion]",
        );
        return true;
    }
    let out_of_reach = is_there && answer.figures.is_some_and(|f| f.true_stiffness_n_m.is_none());
    if out_of_reach {
        console.warn(
            "the tip does not reach the tissue: the figures are those of free motion\n\nhint: let the hand go further, \
             or longer than the channel delays, see [motion]; hand and control need a stiffness; with passivity = true give the \
             control a passivity_reserve_j",
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
        && !(config.sample_time_s..=LONGEST_MAPPED * config.sample_time_s).contains(&longest)
    {
        let text = format!(
            "--map: the longest delay must be from the sample time, {} s, to 10 000 times that, got {longest} s",
            config.sample_time_s
        );
        return Err(BadArgument(text).into());
    }
    if args.map.is_some() && config.tissue.kind == TissueKind::None {
        let text =
            "--map: there is no tissue whose stiffness could be found\n\nhint: give tissue.kind";
        return Err(BadArgument(text.to_owned()).into());
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
    let least_friction_scale = args.least_friction.unwrap_or(1.0);
    let plants = match (&args.posterior, &args.model) {
        (Some(path), Some(of)) => {
            let draws = models::read_draws(path, (file, of))?;
            let most = args.draws.map_or(POSTERIOR_DRAWS, usize::from);
            posterior_candidates(file, &draws, most, least_friction_scale)
                .context("posterior draws of the model")?
        }
        _ => within_intervals(console, args, config, file, least_friction_scale)?,
    };
    if args.least_friction.is_none() {
        console.remark(
            "the advice includes the model's uncertainty alone: --least-friction 0.55 adds seals that are wetted",
        );
    }
    Ok(advise(config, model, &plants)?)
}

/// The trocars within the intervals of the model.
fn within_intervals(
    console: &Console,
    args: &Args,
    config: &Config,
    file: &ModelFile,
    least_friction_scale: f64,
) -> anyhow::Result<Vec<Trocar<Vec<f64>>>> {
    if args.draws.is_some() && file.intervals.is_empty() {
        let text = "--draws needs a model with 95 % intervals, as identify writes it";
        return Err(BadArgument(text.to_owned()).into());
    }
    let wanted = Candidates {
        draws: args.draws.map_or(0, usize::from),
        seed: config.seed,
        least_friction_scale,
    };
    let plants = candidates(file, &wanted).context("the model within its 95 % intervals")?;
    if plants.len() == 1 {
        console.remark(
            "the model has no 95 % intervals: the advice is for a trocar that equals the model",
        );
    }
    Ok(plants)
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
        _ if !answer.has_tissue => String::new(),
        Some(ZWidth { least_n_m, greatest_n_m }) => format!(
            "stable with tissue of {} to {} N/m\n",
            number(*least_n_m),
            number(*greatest_n_m)
        ),
        None => "unstable with every tissue that is tried, from 0 to 20 000 N/m\n".to_owned(),
    };
    let beyond = |z: &ZWidth| !(z.least_n_m..=z.greatest_n_m).contains(&answer.stiffness_n_m);
    if answer.figures.is_some() && answer.z_width.as_ref().is_some_and(beyond) {
        text += &format!(
            "and beyond that range with its own tissue of {} N/m: the stiffnesses are not one range\n",
            number(answer.stiffness_n_m)
        );
    }
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
        let values = columns.iter().map(|rows| rows[k].1.map_or("none".to_owned(), number));
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
        let most = if *high >= MOST { ", the upper limit of the search" } else { "" };
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
    let step = |step: Option<f64>| {
        let none = "none before ten times the stiffness, or before the loop is unstable";
        step.map_or(none.to_owned(), |s| number(s) + " N/m")
    };
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
        text += "\nsoftest tissue with which the loop is stable (N/m)\n";
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
