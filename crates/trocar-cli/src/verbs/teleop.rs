//! `trocar teleop`

use std::path::{Path, PathBuf};

use anyhow::Context;
use trocar::model_file::ModelFile;
use trocar::output::StagedFolder;
use trocar::report::teleop::{COURSE, Sources, TeleopReport};
use trocar::teleop::advise::{Advice, MOST, Map, NoticeableStep, Tried, map_delays, map_fractions};
use trocar::teleop::config::{Architecture, TissueKind, shipped};
use trocar::teleop::hybrid::frequencies;
use trocar::teleop::merit::Merit;
use trocar::teleop::stability::ZWidth;
use trocar::teleop::{Candidates, Config, Questions, Study};

use crate::Completion;
use crate::console::{self, BadArgument, Console};
use crate::models;
use crate::output::Output;
use crate::page::{model_source, source};
use crate::progress::Progress;
use crate::table::{Table, number};

/// Least amplitude of the strokes of a hybrid matrix, m.
const SMALLEST_AMPLITUDE_M: f64 = 1e-9;
/// Posterior draws that are tried without --draws.
const POSTERIOR_DRAWS: usize = 20;
/// Longest delay of a map, in samples.
const LONGEST_MAPPED: f64 = 1e4;

/// What the folder of results holds.
const FILES: [&str; 5] =
    ["summary.json", "course.parquet", "hybrid.parquet", "report.html", "figures/*"];

/// Run a teleoperation loop through a trocar: what the operator feels, and whether it is stable
///
/// Operator, master, channel, slave, trocar, tissue and sensor along the axis of the instrument. Prints
/// what is felt of the tissue with the fraction of the trocar's force that is taken out, and the ranges of
/// the tissue's stiffness with which the loop is stable. --advise finds the best fraction over the model's
/// 95 % intervals, --map the ranges of stiffness over delay and fraction. Writes summary.json,
/// course.parquet, hybrid.parquet, report.html and figures into the folder given with --out. Exit code 3:
/// the loop is unstable, the tip does not reach the tissue, or the steps of the plant are too long.
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
    /// With --advise: besides the model and both ends of its intervals, try N trocars drawn from them (seed of
    /// the loop)
    #[arg(long, value_name = "N", requires = "advise", value_parser = clap::value_parser!(u16).range(1..=1000))]
    draws: Option<u16>,
    /// With --advise: in place of the ends of the intervals and of draws from them, try draws of the
    /// model's parameters that `identify --posterior` wrote: --draws of them, or 20
    #[arg(long, value_name = "FILE", requires = "advise")]
    posterior: Option<PathBuf>,
    /// With --advise: also try both ends of the intervals of the compensator's model and N models drawn from
    /// them, with the trocar as its model describes it
    #[arg(long, value_name = "N", requires = "advise", value_parser = clap::value_parser!(u16).range(1..=1000))]
    compensator_draws: Option<u16>,
    /// With --advise: include trocars whose friction is down to this multiple of the model's, as that of a
    /// wetted seal, which loses 15 to 45 %
    #[arg(long, value_name = "SCALE", requires = "advise", value_parser = friction_scale)]
    least_friction: Option<f64>,
    /// Find the ranges of the tissue's stiffness with which the loop is stable, over fractions up to 1.425 and
    /// delays of one direction up to this one, s (without it, 19 samples)
    #[arg(long, value_name = "DELAY_S", num_args = 0..=1)]
    map: Option<Option<f64>>,
    /// Folder for the results; it need not exist: the report with the loop to try by hand, its course, and the
    /// hybrid matrix with the trocar as its describing function at the amplitude of the motion
    #[arg(long, value_name = "DIR", value_parser = Output::folder(&FILES))]
    out: Option<Output>,
    /// Print summary.json instead of text
    #[arg(long)]
    json: bool,
    /// Print a documented loop and stop: all defaults, or a device
    #[arg(long, value_name = "DEVICE", num_args = 0..=1, default_missing_value = "default",
          value_parser = ["default", "dvrk", "phantom"])]
    print_config: Option<String>,
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
    let files = [compensator.as_ref().unwrap_or(&file), &file];
    check_intervals(console, args, files)?;
    // Fails before the computation if nothing can be written there.
    let staged = args.out.as_ref().map(StagedFolder::create).transpose()?;
    let questions = questions(args, &config, (&file, model))?;
    let progress = Progress::new(console);
    let report = |stage: &str, part: f64| progress.report(stage, part);
    let study = Study::new(config, files, &questions, &report)?;
    drop(progress);
    if let Some(staged) = staged {
        let sources = Sources {
            config: args.config.as_deref().map(source).transpose()?,
            trocar: model_source(model, &file)?,
            compensator: match (&args.compensator, &compensator) {
                (Some(path), Some(other)) => Some(model_source(path, other)?),
                _ => None,
            },
        };
        TeleopReport { study: &study, sources }.write(&staged)?;
        staged.commit()?;
    }
    let json = || study.summary().to_json();
    console::print(&if args.json { json() } else { text(&study) })?;
    if let Some(folder) = &args.out {
        console.remark(&format!("report: {}", folder.join("report.html").display()));
    }
    Ok(Completion::doubtful_if(warn(console, args, &study)))
}

/// What the options ask for.
fn questions(args: &Args, config: &Config, of: (&ModelFile, &Path)) -> anyhow::Result<Questions> {
    let count = |draws: Option<u16>| draws.map_or(0, usize::from);
    let posterior =
        args.posterior.as_deref().map(|path| models::read_draws(path, of)).transpose()?;
    let wanted = Candidates {
        draws: match &posterior {
            Some(_) => args.draws.map_or(POSTERIOR_DRAWS, usize::from),
            None => count(args.draws),
        },
        posterior,
        compensator_draws: count(args.compensator_draws),
        seed: config.seed,
        least_friction_scale: args.least_friction.unwrap_or(1.0),
    };
    let has_strokes = config.motion.amplitude_m.abs() >= SMALLEST_AMPLITUDE_M;
    Ok(Questions {
        advice: args.advise.then_some(wanted),
        map: args.map.map(|longest| [map_delays(config, longest), map_fractions()]),
        hybrid_hz: (args.out.is_some() && has_strokes).then(frequencies),
    })
}

/// Prints what makes the result doubtful; whether anything does.
fn warn(console: &Console, args: &Args, study: &Study) -> bool {
    let unstable = match &study.outcome.course {
        Err(diverged) => Some(diverged.to_string()),
        Ok(_) => study.outcome.unsettled_by.map(|by| {
            format!("the loop is unstable: it does not come to rest after {}", by.in_words())
        }),
    };
    let course = args.out.as_ref().map(|folder| folder.join(COURSE));
    if let (Some(course), true) = (course, study.unstable_after_s().is_some())
        && course.exists()
    {
        let course = course.display();
        console.warn(&format!("{course} is that of an earlier run: a loop that diverged has none"));
    }
    if let Some(why) = &unstable {
        console.warn(&format!("{why}\n\nhint: try {}", remedies(&study.config, args).join(", ")));
    }
    if let Some(error) = study.step_error {
        let more = 4 * study.config.substeps;
        console.warn(&format!(
            "{error}\n\nhint: try substeps = {more}; where passivity control, losses or an encoder keep switching a force, more steps \
             may not help"
        ));
    }
    let advised = study.advice.as_ref().is_none_or(|advice| advice.fraction.is_some());
    let no_contact = warn_of_no_contact(console, study);
    unstable.is_some() || !advised || no_contact || study.step_error.is_some()
}

/// Changes that may make an unstable loop stable.
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

/// Whether the figures tell nothing about the tissue.
fn warn_of_no_contact(console: &Console, study: &Study) -> bool {
    let begins_inside = study.config.has_tissue() && study.config.begins_in_the_tissue();
    if begins_inside {
        console.warn(
            "the motion begins in the tissue: no stiffness displayed\n\nhint: begin before tissue.surface_m, see [motion]",
        );
    }
    if study.is_out_of_reach() {
        console.warn(
            "the tip does not reach the tissue: the figures are those of free motion\n\nhint: let the hand go further, \
             or longer than the channel delays, see [motion]; hand and control need a stiffness; with passivity = true give the \
             control a passivity_reserve_j",
        );
    }
    begins_inside || study.is_out_of_reach()
}

fn friction_scale(text: &str) -> Result<f64, String> {
    let scale = text.parse().map_err(|_| "not a number".to_owned())?;
    if (0.01..=1.0).contains(&scale) { Ok(scale) } else { Err("must be from 0.01 to 1".into()) }
}

/// Refuses options that cannot have a result.
fn check(args: &Args, config: &Config) -> anyhow::Result<()> {
    if args.out.as_deref() == Some(Path::new("-")) {
        let text = "--out - : the results are a folder\n\nhint: --json prints summary.json";
        return Err(BadArgument(text.to_owned()).into());
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
    if args.advise && !config.has_tissue() {
        let text = "--advise: there is no tissue that could be felt\n\nhint: give tissue.kind and tissue.stiffness_n_m";
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

/// Refuses draws from a model without intervals.
fn check_intervals(
    console: &Console,
    args: &Args,
    [compensator, plant]: [&ModelFile; 2],
) -> anyhow::Result<()> {
    for (option, is_given, file) in [
        ("--draws", args.draws.is_some() && args.posterior.is_none(), plant),
        ("--compensator-draws", args.compensator_draws.is_some(), compensator),
    ] {
        if is_given && file.intervals.is_empty() {
            let text = format!("{option} needs a model with 95 % intervals, as identify writes it");
            return Err(BadArgument(text).into());
        }
    }
    let is_certain = plant.intervals.is_empty() && args.posterior.is_none();
    if args.advise && is_certain && args.least_friction.is_none() {
        console.remark(
            "the model has no 95 % intervals: the advice is for a trocar that equals the model",
        );
    }
    if args.advise && args.least_friction.is_none() {
        console.remark(
            "the advice covers the model's uncertainty only: --least-friction 0.55 adds wetted seals",
        );
    }
    Ok(())
}

fn text(study: &Study) -> String {
    let (fraction, figures) = (study.config.compensation.fraction, &study.outcome.figures);
    let mut text = String::new();
    match (study.unstable_after_s(), study.outcome.unsettled_by) {
        (Some(time), _) => text += &format!("unstable: diverged after {} s\n", number(time)),
        (None, Some(by)) => {
            text += &format!("unstable: it does not come to rest after {}\n", by.in_words());
        }
        (None, None) => {}
    }
    text += &study.z_width.as_ref().map_or(String::new(), z_width_text);
    let advised = study.advice.as_ref().and_then(|a| Some((a.fraction?, a.with.as_ref()?)));
    let cases: Vec<(f64, &Merit)> =
        figures.iter().map(|figures| (fraction, figures)).chain(advised).collect();
    if !cases.is_empty() {
        text += "\nwith a percentage of the trocar's force taken out:\n";
        text += &figures_table(&cases);
    }
    if let Some(advice) = &study.advice {
        text += &advice_text(advice);
    }
    if let Some(map) = &study.map {
        text += &map_text(map);
    }
    text
}

fn z_width_text(width: &ZWidth) -> String {
    let range =
        |[least, greatest]: &[f64; 2]| format!("{} to {}", number(*least), number(*greatest));
    match width.ranges_n_m.as_slice() {
        [] => "unstable with every tissue that is tried, from 0 to 20 000 N/m\n".to_owned(),
        ranges => {
            let all: Vec<String> = ranges.iter().map(range).collect();
            format!("stable with tissue of {} N/m\n", all.join(" and of "))
        }
    }
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
        return format!("\n{}\n{}", advice.refusal(), partly_stable(advice));
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
    if let (Some(best), true) = (&advice.best, advice.pairs > 1) {
        text += &format!("best for each of the {} by itself: {}\n", tried(advice), range(best));
    }
    text += &format!(
        "least step of the tissue's stiffness that is noticed: {}\n",
        step_text(advice.noticeable_with)
    );
    text + &match advice.without {
        Some(_) => format!("without compensation: {}\n", step_text(advice.noticeable_without)),
        None => "without compensation the loop is unstable\n".to_owned(),
    }
}

fn step_text(step: Option<NoticeableStep>) -> String {
    match step {
        None => "none, since the tip does not touch the tissue".to_owned(),
        Some(NoticeableStep::Noticed { step_n_m }) => format!("{} N/m", number(step_n_m)),
        Some(NoticeableStep::NotNoticed { step_n_m }) => {
            format!("none up to {} N/m, the largest that is tried", number(step_n_m))
        }
        Some(NoticeableStep::Unstable { step_n_m }) => {
            format!(
                "none before the loop becomes unstable, with tissue stiffer by {} N/m",
                number(step_n_m)
            )
        }
    }
}

/// What a fraction is tried with.
fn tried(advice: &Advice) -> String {
    format!("{} pairs of compensator and trocar", advice.pairs)
}

/// Fractions with which the loop is stable with some of the trocars, and with how many.
fn partly_stable(advice: &Advice) -> String {
    let is_partly = |tried: &&Tried| tried.stable_share > 0.0 && !tried.stable;
    let held = |tried: &Tried| {
        let count = (tried.stable_share * advice.pairs as f64).round();
        format!("{} % ({count})", number(100.0 * tried.fraction))
    };
    let partly: Vec<String> = advice.tried.iter().filter(is_partly).map(held).collect();
    if partly.is_empty() {
        return String::new();
    }
    format!("stable with some of the {} (how many): {}\n", self::tried(advice), partly.join(", "))
}

fn map_text(map: &Map) -> String {
    let mut text = "\nstiffest tissue with which the loop is stable (N/m; from 0 to 20 000 are tried; -: with none; *: not from 0 on, or \
                    in several ranges, see summary.json), delay of one direction in ms down, percentage taken out across\n"
        .to_owned();
    text += &" ".repeat(6);
    map.fractions.iter().for_each(|fraction| text += &format!("{:6.1} ", 100.0 * fraction));
    for (delay, row) in map.delays_s.iter().zip(&map.z_width_n_m) {
        text = text.trim_end().to_owned() + &format!("\n{:6.1}", 1e3 * delay);
        for width in row {
            text += &match width.ranges_n_m.as_slice() {
                [] => format!("{:>6} ", "-"),
                [[0.0, greatest]] => format!("{greatest:6.0} "),
                [[_, greatest], ..] => format!("{greatest:6.0}*"),
            };
        }
    }
    text.trim_end().to_owned() + "\n"
}
