//! `trocar plan`

use std::path::{Path, PathBuf};

use anyhow::Context;
use trocar::model_file::ModelFile;
use trocar::plan::config::EXAMPLE_TOML;
use trocar::plan::{Goal, Plan, PlanConfig, Prediction, Summary, plan};
use trocar::recording::{ReadOptions, Recording, read};
use trocar::report::plan::{self as plan_report, PRECISION, PlanReport};
use trocar_model::{ElementParams, Unit};

use crate::Completion;
use crate::console::{self, BadArgument, Console};
use crate::input::{Choosing, OUTPUT, toml};
use crate::models::{read_draws, read_model};
use crate::output::Output;
use crate::page::{self, model_source, source};
use crate::progress::Progress;
use crate::table::{Table, number};
use crate::verbs::identify::{counted, in_words};
use crate::verbs::ranges::seals_like;

/// Plan what motion to record, so that the parameters are known best after it
///
/// Writes a motion for the rig (time_s, position_m) and prints the 95 % intervals to expect from
/// `identify`, beside those of the paper's protocol. The motion is chosen by the information that
/// the likelihood of `identify` has about the goal, averaged over the seals that are expected. Try
/// it with `trocar bench --motion`. Exit code 3: the motion will not determine every parameter.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Rig, noise and expected seals, TOML (see --print-config); without it, the defaults, or those
    /// of the first recording of --after
    #[arg(value_name = "RIG.toml")]
    config: Option<PathBuf>,
    /// What for: all (parameters), compensation (the force along a hand's motion), or a parameter,
    /// with a precision or without (viscous_damping_n_s_m, half_width_m:5%)
    #[arg(long = "for", value_name = "GOAL", default_value = "all")]
    goal: Goal,
    /// Model of the seal, from a pilot; without it, seals drawn from the prior of RIG.toml
    #[arg(long, value_name = "MODEL")]
    model: Option<PathBuf>,
    /// Plan for draws of its parameters that `identify --posterior` wrote, as many as the key draws of
    /// RIG.toml says, in place of the model itself. With --model
    #[arg(long, value_name = "FILE", requires = "model", hide_short_help = true)]
    posterior: Option<PathBuf>,
    /// Expect seals with the published friction forces of a study, a key of `trocar ranges`, as
    /// prior.like in RIG.toml
    #[arg(long, value_name = "KEY", conflicts_with = "model", hide_short_help = true)]
    like: Option<String>,
    /// Recording that is there already; may be repeated. With --model
    #[arg(long, value_name = "RECORDING", requires = "model")]
    after: Vec<PathBuf>,
    /// Time that the experiment may take, s [default: that of RIG.toml]
    #[arg(long, value_name = "S", value_parser = crate::input::not_negative)]
    duration_s: Option<f64>,
    /// The motion: .csv, .parquet, .arrow, .csv.gz or .csv.zst, '-' for CSV to standard output
    #[arg(long, value_name = "FILE", required_unless_present = "print_config", help_heading = OUTPUT)]
    out: Option<Output>,
    /// Write a report, one HTML page that needs nothing else: the motion, what its parts tell, and the
    /// intervals to expect
    #[arg(long, value_name = "FILE", help_heading = OUTPUT)]
    report: Option<Output>,
    /// Print JSON instead of text
    #[arg(long, help_heading = OUTPUT)]
    json: bool,
    /// Print a documented rig with all defaults and stop
    #[arg(long)]
    print_config: bool,
    #[command(flatten)]
    choosing: Choosing,
}

pub(crate) fn run(console: &Console, args: &Args) -> anyhow::Result<Completion> {
    let (Some(out), false) = (&args.out, args.print_config) else {
        console::print(EXAMPLE_TOML)?;
        return Ok(Completion::Clean);
    };
    let to_stdout = **out == *Path::new("-");
    if to_stdout && args.json {
        let text =
            "--out - prints the motion alone\n\nhint: write it to a file, or leave out --json";
        return Err(BadArgument(text.to_owned()).into());
    }
    page::needs_a_file(args.report.as_deref())?;
    let model = args.model.as_deref().map(|path| read_model(path, &args.after)).transpose()?;
    let before = recordings(console, args, model.as_ref())?;
    let config = config(args, before.first())?;
    let seals = match (&model, &args.model) {
        (Some(model), Some(path)) => seals(args, &config, (model, path))?,
        _ => Vec::new(),
    };
    let progress = Progress::new(console);
    let planned =
        plan(&config, &args.goal, &seals, &before, &|stage, part| progress.report(stage, part))?;
    drop(progress);
    planned.course.write(out)?;
    let summary = planned.summary(&args.goal);
    if args.json {
        console::print_json(&summary)?;
    } else if !to_stdout {
        console::print(&text(&summary, &planned, out))?;
    }
    if let Some(path) = &args.report {
        write_report(args, &config, &planned, model.as_ref(), path)?;
        console.remark(&format!("report: {}", path.display()));
    }
    Ok(Completion::doubtful_if(warn_of_the_undetermined(console, &planned)))
}

fn write_report(
    args: &Args,
    config: &PlanConfig,
    plan: &Plan,
    model: Option<&ModelFile>,
    path: &Path,
) -> anyhow::Result<()> {
    let model = args.model.as_deref().zip(model);
    let input = PlanReport {
        config,
        config_source: args.config.as_deref().map(source).transpose()?,
        goal: &args.goal,
        plan,
        model: model.map(|(path, file)| model_source(path, file)).transpose()?,
        posterior: args.posterior.as_deref().map(source).transpose()?,
        before: args.after.iter().map(|path| source(path)).collect::<Result<_, _>>()?,
    };
    page::write(&plan_report::document(&input), path)
}

/// Whether there is a parameter that the motion will not determine.
fn warn_of_the_undetermined(console: &Console, planned: &Plan) -> bool {
    let lost: Vec<String> = planned.undetermined().map(|p| in_words(p.id)).collect();
    if !lost.is_empty() {
        console.warn(&format!(
            "this motion will not determine {}\n\nhint: allow more time (--duration-s), a longer travel, or a finer \
             encoder",
            lost.join(", ")
        ));
    }
    !lost.is_empty()
}

/// The rig: that of the file, of the pilot, or the default.
fn config(args: &Args, pilot: Option<&Recording>) -> anyhow::Result<PlanConfig> {
    let mut config = match (&args.config, pilot) {
        (Some(path), _) => toml(path, "rig", PlanConfig::from_toml)?,
        (None, Some(pilot)) => PlanConfig::default()
            .on_the_rig_of(pilot)
            .with_context(|| format!("{}: the rig that made it", pilot.name))?,
        (None, None) => PlanConfig::default(),
    };
    if let Some(key) = &args.like {
        seals_like(key)?;
        config.prior.like = Some(key.clone());
    }
    config.duration_s = args.duration_s.unwrap_or(config.duration_s);
    Ok(config)
}

fn recordings(
    console: &Console,
    args: &Args,
    model: Option<&ModelFile>,
) -> anyhow::Result<Vec<Recording>> {
    let Some(model) = model else { return Ok(Vec::new()) };
    let choice = args.choosing.choice_for(console, model);
    let options = ReadOptions { choice, ..ReadOptions::default() };
    args.after.iter().map(|path| Ok(read(path, &options)?)).collect()
}

/// The seal of a model, or posterior draws of it.
fn seals(
    args: &Args,
    config: &PlanConfig,
    (model, path): (&ModelFile, &Path),
) -> anyhow::Result<Vec<ElementParams>> {
    let (from, draws) = match &args.posterior {
        None => (path, vec![*model.stages().map_err(|error| error.in_file(path))?]),
        Some(file) => (&**file, read_draws(file, (model, path))?),
    };
    let seals = config.seals_of(&draws);
    seals.map_err(|error| BadArgument(format!("{}: {error}", from.display())).into())
}

fn text(answer: &Summary, planned: &Plan, out: &Path) -> String {
    let mut text = format!(
        "for {}: {} s, {} -> {}\n",
        answer.goal,
        number(answer.duration_s),
        counted(planned.segments.len(), "cycle", "cycles"),
        out.display()
    );
    let mut table =
        Table::headed(["cycles", "speed mm/s", "stroke mm", "number", "time s", "information %"]);
    for share in answer.motion {
        table.row([
            share.block.interruption.to_string(),
            number(1e3 * share.block.speed_m_s),
            number(1e3 * share.block.length_m),
            share.count.to_string(),
            number(share.duration_s),
            format!("{:.0}", 1e2 * share.information.max(0.0)),
        ]);
    }
    text += &table.to_text();
    if let Some(from) = answer.turning_from_s {
        text += &format!("\n{}\n", plan_report::turning(from));
    }
    text += "\nhalf widths of the 95 % intervals to expect\n";
    let paper = answer.paper_duration_s.map(|s| format!("paper's protocol, {s:.0} s"));
    let heads = ["parameter", "value", "this motion", "of the value"];
    let mut table = Table::headed(heads.into_iter().chain(paper.as_deref()).chain(["unit"]));
    for p in answer.expected.iter().filter(|p| !p.is_coefficient()) {
        let Unit { scale, shown, .. } = p.id.unit();
        let value = |value: f64| number(scale * value);
        let mut row = vec![in_words(p.id), value(p.value), value(p.half_width)];
        row.push(p.relative_half_width.map_or("-".to_owned(), |r| number(1e2 * r) + " %"));
        let of_paper = |paper: &[Prediction]| {
            p.among(paper).map_or("-".to_owned(), |own| value(own.half_width))
        };
        row.extend(answer.paper_expected.map(of_paper));
        row.push(shown.to_owned());
        table.row(row);
    }
    text += &table.to_text();
    if answer.paper_expected.is_none() {
        text += &format!("\n{}\n", plan_report::PAPER);
    }
    text += &more_time(planned);
    if let Some(needed) = answer.needed_s {
        let more = needed - answer.duration_s;
        text += &if needed <= 0.0 {
            "\nthe recordings that are there reach the precision asked for\n".to_owned()
        } else if more > 0.0 {
            format!("\nthe precision asked for needs some {} s more\n", number(more.ceil()))
        } else {
            format!("\nthe precision asked for is reached after some {} s\n", number(needed.ceil()))
        };
    }
    text
}

/// How much more of a motion like this takes the half widths to 5 % of the values.
fn more_time(planned: &Plan) -> String {
    let main = planned.expected.iter().filter(|p| !p.is_coefficient());
    match main
        .filter_map(|p| {
            let more = planned.time_for(p, PRECISION)? - planned.duration_s();
            (more > 0.0).then(|| format!("{} {} s", p.id.symbol(), number(more.ceil())))
        })
        .collect::<Vec<_>>()
    {
        none if none.is_empty() => String::new(),
        all => {
            format!("\nmore seconds like these for ±{} %: {}\n", 1e2 * PRECISION, all.join(", "))
        }
    }
}
