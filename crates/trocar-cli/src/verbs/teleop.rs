//! `trocar teleop`

use std::path::{Path, PathBuf};

use anyhow::Context;
use trocar::output::StagedFolder;
use trocar::report::teleop::{self as report, COURSE, Source, Sources};
use trocar::teleop::advise::{Advice, MOST, Map, NoticeableStep};
use trocar::teleop::config::{Architecture, shipped};
use trocar::teleop::merit::Merit;
use trocar::teleop::stability::ZWidth;
use trocar::teleop::{Config, Options, Study};

use crate::Completion;
use crate::console::{self, BadArgument, Console};
use crate::input::toml;
use crate::models;
use crate::output::Output;
use crate::page::{self, model_source};
use crate::progress::Progress;
use crate::table::{Table, number};

/// What the folder of results holds.
const FILES: [&str; 5] =
    ["summary.json", "course.parquet", "hybrid.parquet", "report.html", "figures/*"];

/// Run a teleoperation loop through a trocar: what the operator feels, and whether it is stable
///
/// Operator, leader, channel, follower, trocar, tissue and sensor along the axis of the instrument. Prints
/// what is felt of the tissue with the fraction of the trocar's force that is compensated, and the ranges of
/// the tissue's stiffness with which the loop is stable. --advise finds the best fraction over the model's
/// 95 % intervals, --map the ranges of stiffness over delay and fraction. Writes summary.json,
/// course.parquet, hybrid.parquet, report.html and figures into the folder given with --out. Exit code 3:
/// the loop is unstable, the tip does not reach the tissue, or the steps of the plant are too long.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The loop: TOML (see --print-config), or a device, dvrk or phantom; without it, the defaults
    #[arg(value_name = "CONFIG.toml")]
    config: Option<PathBuf>,
    /// Model of the trocar: model.json, the folder of a result, or the made-up seal 'plausible'
    #[arg(long, value_name = "MODEL", default_value = models::PLAUSIBLE)]
    model: PathBuf,
    /// Model in the compensator; without it, the same
    #[arg(long, value_name = "MODEL")]
    compensator: Option<PathBuf>,
    /// Find the fraction of the trocar's force to compensate
    #[arg(long)]
    advise: bool,
    /// With --advise: besides the model and both ends of its intervals, try N trocars drawn from them (seed of
    /// the loop)
    #[arg(long, value_name = "N")]
    draws: Option<usize>,
    /// With --advise: in place of the ends of the intervals and of draws from them, try draws of the
    /// model's parameters that `identify --posterior` wrote: --draws of them, or 20
    #[arg(long, value_name = "FILE")]
    posterior: Option<PathBuf>,
    /// With --advise: also try both ends of the intervals of the compensator's model and N models drawn from
    /// them, with the trocar as its model describes it
    #[arg(long, value_name = "N")]
    compensator_draws: Option<usize>,
    /// With --advise: include trocars whose friction is down to this multiple of the model's, as that of a
    /// wetted seal, which loses 15 to 45 %
    #[arg(long, value_name = "SCALE")]
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
    let model = &args.model;
    let (config, source) = match args.config.as_deref().map(loop_of).transpose()? {
        Some((config, source)) => (config, Some(source)),
        None => (Config::default(), None),
    };
    needs_a_folder(args.out.as_deref())?;
    if args.model == Path::new(models::PLAUSIBLE) {
        console.remark("seal: a plausible, made-up 10.5 mm trocar; give another with --model");
    }
    let file = models::read_model(model, &[])?;
    let compensator = args.compensator.as_deref().map(|path| models::read_model(path, &[]));
    let compensator = compensator.transpose()?;
    let files = [compensator.as_ref().unwrap_or(&file), &file];
    let draws = args.posterior.as_deref();
    let draws = draws.map(|path| models::read_draws(path, (&file, model))).transpose()?;
    let has_draws = draws.is_some();
    let questions = options(args, &config).questions(&config, files, draws);
    let questions = questions.map_err(|error| BadArgument(error.to_string()))?;
    remark_on_certainty(console, args, !has_draws && file.intervals.is_empty());
    // Fails before the computation if nothing can be written there.
    let staged = args.out.as_ref().map(StagedFolder::create).transpose()?;
    let progress = Progress::new(console);
    let study = Study::new(config, files, &questions, &|stage, part| progress.report(stage, part))?;
    drop(progress);
    if let Some(staged) = staged {
        let sources = Sources {
            config: source,
            trocar: model_source(model, &file)?,
            compensator: match (&args.compensator, &compensator) {
                (Some(path), Some(other)) => Some(model_source(path, other)?),
                _ => None,
            },
        };
        report::write(&study, &sources, &staged)?;
        staged.commit()?;
    }
    let answer = match args.json {
        true => study.summary().to_json(),
        false => format!("{}{}{}", which(args, &study.config), text(&study), meaning(&study)),
    };
    console::print(&answer)?;
    if let Some(folder) = &args.out {
        console.remark(&format!("report: {}", folder.join("report.html").display()));
    }
    warn(console, args, &study);
    Ok(Completion::doubtful_if(study.is_doubtful()))
}

fn options(args: &Args, config: &Config) -> Options {
    Options {
        advise: args.advise,
        draws: args.draws,
        compensator_draws: args.compensator_draws,
        least_friction: args.least_friction,
        map: args.map.is_some(),
        longest_delay_s: args.map.flatten(),
        hybrid: args.out.is_some() && config.has_strokes(),
        ..Options::default()
    }
}

/// Prints what makes the result doubtful.
fn warn(console: &Console, args: &Args, study: &Study) {
    let course = args.out.as_ref().map(|folder| folder.join(COURSE));
    if let (Some(course), true) = (course, study.unstable_after_s().is_some())
        && course.exists()
    {
        let course = course.display();
        console.warn(&format!("{course} is that of an earlier run: a loop that diverged has none"));
    }
    study.warnings().iter().for_each(|warning| console.warn(warning));
}

fn needs_a_folder(out: Option<&Path>) -> Result<(), BadArgument> {
    match out == Some(Path::new("-")) {
        true => Err(BadArgument(
            "--out - : the results are a folder\n\nhint: --json prints summary.json".to_owned(),
        )),
        false => Ok(()),
    }
}

/// The loop of a file, or of a device by its name.
fn loop_of(path: &Path) -> anyhow::Result<(Config, Source)> {
    let name = path.to_string_lossy();
    match shipped(&name).filter(|_| !path.exists()) {
        Some(text) => Ok((Config::from_toml(text)?, Source::new(name, text.as_bytes()))),
        None if !path.exists() => Err(BadArgument(format!(
            "{name}: no such loop, expected a file, dvrk or phantom\n\nhint: --print-config prints one to change"
        ))
        .into()),
        None => Ok((toml(path, "loop", Config::from_toml)?, page::source(path)?)),
    }
}

/// Prints what the advice does not cover.
fn remark_on_certainty(console: &Console, args: &Args, is_certain: bool) {
    if !args.advise || args.least_friction.is_some() {
        return;
    }
    if is_certain {
        console.remark(
            "the model has no 95 % intervals: the advice is for a trocar that equals the model",
        );
    }
    console.remark(
        "the advice covers the model's uncertainty only: --least-friction 0.55 adds wetted seals",
    );
}

/// Which loop it is.
fn which(args: &Args, config: &Config) -> String {
    let architecture = match config.control.architecture {
        Architecture::PositionPosition => "position-position",
        Architecture::PositionForce => "position-force",
        Architecture::FourChannel => "four channels",
        Architecture::Wave => "wave variables",
    };
    let from = match &args.config {
        Some(path) => path.display().to_string(),
        None => "the default (--print-config shows it)".to_owned(),
    };
    let turning = match config.motion.turning_rad_s {
        0.0 => String::new(),
        rate => format!(", turning at {} rad/s", number(rate)),
    };
    format!(
        "loop: {from}, {architecture}, {} Hz, delay {} ms each way, {} % of the trocar's force compensated{turning}\n",
        number(1.0 / config.sample_time_s),
        number(1e3 * config.channel.delay_s),
        number(100.0 * config.compensation.fraction)
    )
}

/// What the figures mean for the operator; nothing of a loop that is unstable.
fn meaning(study: &Study) -> String {
    let (Some(figures), None) = (&study.outcome.figures, study.outcome.unsettled_by) else {
        return String::new();
    };
    let mut said = Vec::new();
    if let (Some(felt), Some(tissue)) =
        (figures.displayed_stiffness_n_m, figures.true_stiffness_n_m)
    {
        said.push(format!("tissue of {tissue:.0} N/m feels like {felt:.0} N/m"));
    }
    said.push(format!("forces below about {:.1} N are masked", figures.force_error_rms_n));
    said.push(match figures.energy_j < 0.0 {
        true => {
            format!("the loop is active: it gives {:.0} mJ to its ends", -1e3 * figures.energy_j)
        }
        false => "the loop is passive along this motion".to_owned(),
    });
    format!("\nin words: {}\n", said.join("; "))
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
        text += "\nwith a percentage of the trocar's force compensated:\n";
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
    match width.ranges_n_m.as_slice() {
        [] => "unstable with every tissue that is tried, from 0 to 20 000 N/m\n".to_owned(),
        ranges => {
            let all: Vec<String> = ranges
                .iter()
                .map(|[least, greatest]| format!("{} to {}", number(*least), number(*greatest)))
                .collect();
            format!("stable with tissue of {} N/m\n", all.join(" and of "))
        }
    }
}

/// Figures side by side, each with the fraction of the trocar's force that is compensated.
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
        "\ncompensate {} % of the trocar's force: the least error of the force felt among the fractions that are stable \
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
    let partly = advice.tried.iter().filter(|tried| tried.stable_share > 0.0 && !tried.stable);
    let partly = partly.map(|tried| {
        let count = (tried.stable_share * advice.pairs as f64).round();
        format!("{} % ({count})", number(100.0 * tried.fraction))
    });
    let partly: Vec<String> = partly.collect();
    if partly.is_empty() {
        return String::new();
    }
    format!("stable with some of the {} (how many): {}\n", self::tried(advice), partly.join(", "))
}

/// Rows and columns of a map that are printed; all are in the report.
const PRINTED: usize = 8;

/// Up to [`PRINTED`] of `count` places, evenly from the first to the last.
fn spread(count: usize) -> Vec<usize> {
    let most = PRINTED.min(count);
    (0..most).map(|k| k * (count - 1) / (most - 1).max(1)).collect()
}

fn map_text(map: &Map) -> String {
    let mut text = "\nstiffest tissue with which the loop is stable (N/m; from 0 to 20 000 are tried; -: with none; *: not from 0 on, or \
                    in several ranges; summary.json has more), delay of one direction in ms down, percentage compensated across\n"
        .to_owned();
    text += &" ".repeat(6);
    let across = spread(map.fractions.len());
    across.iter().for_each(|k| text += &format!("{:6.1} ", 100.0 * map.fractions[*k]));
    for down in spread(map.z_width_n_m.len()) {
        text = text.trim_end().to_owned() + &format!("\n{:6.1}", 1e3 * map.delays_s[down]);
        for k in &across {
            text += &match map.z_width_n_m[down][*k].ranges_n_m.as_slice() {
                [] => format!("{:>6} ", "-"),
                [[0.0, greatest]] => format!("{greatest:6.0} "),
                [[_, greatest], ..] => format!("{greatest:6.0}*"),
            };
        }
    }
    text.trim_end().to_owned() + "\n"
}
