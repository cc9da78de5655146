//! `trocar identify`

use std::path::{Path, PathBuf};

use trocar::identify::posterior::{CHAINS, Draws};
use trocar::identify::{
    Identification, IdentifyOptions, Kept, KeptParameter, Parameter, SealPrior, Subject, Term,
    Warning,
};
use trocar::output::StagedFolder;
use trocar::recording::Recording;
use trocar::report::identification::FigureChoice;
use trocar::report::{prepare, write_workflow};
use trocar::segment::SegmentOptions;
use trocar::survey::{RecordingSurvey, Survey};
use trocar::workflow::{MovingMass, Workflow};
use trocar_model::{MAX_DEGREE, ParameterId, Quantity, Unit};

use crate::Completion;
use crate::console::{self, Console};
use crate::input::{
    OUTPUT, Reading, Rod, STATISTICS, files, finite, positive, said_once, say_how_read,
};
use crate::models::read_model;
use crate::output::Output;
use crate::progress::Progress;
use crate::table::{Table, interval, number};

/// What the folder of results holds.
const FILES: [&str; 8] = [
    "model.json",
    "card.md",
    "summary.json",
    "report.html",
    "table.*",
    "citation.bib",
    "posterior.parquet",
    "figures/*",
];

/// Identify a model from recordings, validate it on others, and write a report
///
/// Takes recordings of any motion; the two experiments of the paper are the best start. Writes
/// model.json, card.md, summary.json, report.html and figures into the folder given with --out, and
/// posterior.parquet with --posterior. Exit code 3:
/// the recordings lost data or do not determine every parameter, a validation error is far above
/// the identification error, or posterior draws did not converge.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[arg(required = true, value_name = "RECORDING", help = files("Recordings to identify from"))]
    recordings: Vec<PathBuf>,
    /// Recordings to validate on, held out of the identification
    #[arg(long, value_name = "RECORDING", num_args = 1..)]
    validate: Vec<PathBuf>,
    /// Folder for the results; it need not exist
    #[arg(long, value_name = "DIR", value_parser = Output::folder(&FILES), help_heading = OUTPUT)]
    out: Output,
    /// Seed of everything random
    #[arg(long, default_value_t = 1, value_name = "N", help_heading = STATISTICS, hide_short_help = true)]
    seed: u64,
    /// Degrees of the two joined polynomials of each branch, 2 to 7
    #[arg(long, default_value = "4,4", value_name = "N,N", value_parser = degrees, help_heading = STATISTICS, hide_short_help = true)]
    degrees: Degrees,
    /// Do not try the optional terms that rests and partial reversals determine: creep, dwell,
    /// relaxation, second_relaxation, minor_loops, second_stage
    #[arg(long, help_heading = STATISTICS, hide_short_help = true)]
    no_free_motion: bool,
    /// Optional terms not to try: stribeck, stribeck_exponent, seal_damping, minor_loops, creep, dwell,
    /// relaxation, second_relaxation, unmodelled_mass, side_load, tilt, gas_pressure, asymmetry,
    /// second_stage
    #[arg(long, value_name = "NAME", value_delimiter = ',', help_heading = STATISTICS, hide_short_help = true)]
    without: Vec<Term>,
    /// Known reading of the sensor without load, N (its tare) [default: estimated]
    #[arg(long, value_name = "VALUE", allow_negative_numbers = true, value_parser = finite, help_heading = STATISTICS, hide_short_help = true)]
    offset_n: Option<f64>,
    /// Parameter that keeps a value, or a range (NAME=LOW..HIGH), in the unit of its name, such as
    /// half_width_m=0.006; its term is in the model
    #[arg(long, value_name = "NAME=VALUE", value_delimiter = ',', conflicts_with_all = ["paper", "prior", "posterior"], help_heading = STATISTICS, hide_short_help = true)]
    fix: Vec<KeptParameter>,
    /// Diameter of the shaft, mm: also identifies how the seal resists rotation, from recordings with an
    /// angle in addition to strokes without turning
    #[arg(long, value_name = "MM", value_parser = positive, help_heading = STATISTICS, hide_short_help = true)]
    shaft_diameter_mm: Option<f64>,
    /// Model of a trocar of the same type, from which the recordings depart: a few strokes then give
    /// its parameters for the trocar in use
    #[arg(long, value_name = "MODEL", conflicts_with = "paper", help_heading = STATISTICS)]
    prior: Option<PathBuf>,
    /// Spread of friction between trocars of that type, relative
    #[arg(long, value_name = "FRACTION", default_value_t = SealPrior::SPREAD, value_parser = positive, requires = "prior", help_heading = STATISTICS, hide_short_help = true)]
    prior_spread: f64,
    /// Also take N draws of the parameters from their posterior, a multiple of 4 from 400, and write
    /// them into posterior.parquet
    #[arg(long, value_name = "N", value_parser = draws, conflicts_with = "paper", help_heading = STATISTICS)]
    posterior: Option<Draws>,
    /// Identify by the two steps of the paper only: steady state, then deformation
    #[arg(long, help_heading = STATISTICS, hide_short_help = true)]
    paper: bool,
    /// Deflection at which figure 7 shows the influence of the deformation velocity; up to 6 times
    #[arg(long, value_name = "MM", allow_negative_numbers = true, value_parser = finite, help_heading = OUTPUT, hide_short_help = true)]
    figure_7_deflection_mm: Vec<f64>,
    /// Speed of a stroke that figure 9 shows (the nearest recorded one within 10 %); up to 6 times
    #[arg(long, value_name = "SPEED", value_parser = positive, help_heading = OUTPUT, hide_short_help = true)]
    figure_9_speed_mm_s: Vec<f64>,
    #[command(flatten)]
    rod: Rod,
    /// Print summary.json instead of the table
    #[arg(long, help_heading = OUTPUT)]
    json: bool,
    #[command(flatten)]
    reading: Reading,
}

/// Degrees of the left and the right polynomial.
#[derive(Debug, Clone, Copy)]
struct Degrees([usize; 2]);

fn degrees(text: &str) -> Result<Degrees, String> {
    let degrees = text.split(',').map(|text| text.trim().parse().ok());
    match degrees.collect::<Option<Vec<_>>>().as_deref() {
        Some([left, right]) if [left, right].iter().all(|own| (2..=MAX_DEGREE).contains(*own)) => {
            Ok(Degrees([*left, *right]))
        }
        _ => Err(format!("expected two degrees between 2 and {MAX_DEGREE}, such as 4,4")),
    }
}

/// Number of posterior draws.
fn draws(text: &str) -> Result<Draws, String> {
    text.trim().parse().ok().and_then(Draws::new).ok_or_else(|| {
        format!("expected a multiple of {CHAINS} from {}, such as 2000", Draws::FEWEST)
    })
}

pub(crate) fn run(console: &Console, args: &Args) -> anyhow::Result<Completion> {
    prepare();
    let moving_mass = args.rod.moving_mass()?;
    let paths: Vec<PathBuf> = args.recordings.iter().chain(&args.validate).cloned().collect();
    let mut recordings = args.reading.recordings(console, &paths)?;
    let held_out = recordings.split_off(args.recordings.len());
    let seen = held_out.iter().filter(|own| recordings.iter().any(|r| r.sha256 == own.sha256));
    let overlap: Vec<&str> = seen.map(|r| r.name.as_str()).collect();
    if !overlap.is_empty() {
        console.warn(&format!(
            "{}: validated on what it was identified from: no validation",
            overlap.join(", ")
        ));
    }
    let overlaps = !overlap.is_empty();
    let prior = args.prior.as_deref().map(|path| seal_prior(path, args)).transpose()?;
    let options = IdentifyOptions {
        prior,
        seed: args.seed,
        degrees: args.degrees.0,
        free_motion: !args.no_free_motion,
        without: args.without.clone(),
        offset: args.offset_n,
        kept: Kept::try_from(&*args.fix)?,
        shaft_radius: args.shaft_diameter_mm.map(|diameter| 0.5e-3 * diameter),
        paper: args.paper,
        posterior: args.posterior,
        ..IdentifyOptions::default()
    };
    // Fails before the computation if nothing can be written there.
    let staged = StagedFolder::create(&args.out)?;
    let mut done = run_workflow(console, recordings, held_out, moving_mass, options)?;
    done.command = Some(command_line(args));
    let [deflections, speeds] = [&args.figure_7_deflection_mm, &args.figure_9_speed_mm_s]
        .map(|values| values.iter().map(|value| 1e-3 * value).collect::<Vec<f64>>());
    write_workflow(
        &done,
        &staged,
        None,
        FigureChoice { deflections: &deflections, speeds: &speeds },
    )?;
    staged.commit()?;
    let text = if args.json { done.summary().to_json() } else { in_brief(&done) };
    console::print(&text)?;
    console.remark(&format!("report: {}", args.out.join("report.html").display()));
    Ok(Completion::doubtful_if(overlaps || done.is_doubtful()))
}

/// The prior of the file at `path`.
fn seal_prior(path: &Path, args: &Args) -> anyhow::Result<SealPrior> {
    let model = read_model(path, &[])?;
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
    SealPrior::new(&model, &name, args.prior_spread).map_err(|error| error.in_file(path).into())
}

/// The command line with the names of files instead of their paths, and without the folder of the
/// results: the same inputs and options give the same line.
fn command_line(args: &Args) -> String {
    let inputs: Vec<&PathBuf> =
        args.recordings.iter().chain(&args.validate).chain(&args.prior).collect();
    let mut words = std::env::args_os().skip(1);
    let mut line = "trocar".to_owned();
    while let Some(word) = words.next() {
        let word = word.to_string_lossy();
        if word == "--out" {
            words.next();
            continue;
        }
        let (option, value) = match word.split_once('=') {
            Some((option, value)) if option.starts_with("--") => (format!("{option}="), value),
            _ => (String::new(), &*word),
        };
        if option != "--out=" {
            let path = inputs.iter().find(|path| path.to_string_lossy() == value);
            let name = path.and_then(|path| path.file_name()).map(|name| name.to_string_lossy());
            line.push(' ');
            line.push_str(&quoted(&format!("{option}{}", name.as_deref().unwrap_or(value))));
        }
    }
    line
}

/// A word as a shell takes it.
fn quoted(word: &str) -> String {
    match !word.is_empty() && word.chars().all(|c| c.is_alphanumeric() || "-_=./,:%@+^".contains(c))
    {
        true => word.to_owned(),
        false => format!("'{}'", word.replace('\'', r"'\''")),
    }
}

/// Runs the workflow; prints first what the recordings can determine, and finally what is doubtful.
pub(crate) fn run_workflow(
    console: &Console,
    recordings: Vec<Recording>,
    held_out: Vec<Recording>,
    moving_mass: MovingMass,
    options: IdentifyOptions,
) -> anyhow::Result<Workflow> {
    let warnings = recordings.iter().flat_map(|r| &r.quality.warnings);
    let printed: Vec<String> = warnings.map(|w| w.message.clone()).collect();
    let limits = print_survey(console, &recordings, &options.segment);
    say_how_read(console, recordings.iter().chain(&held_out));
    let progress = Progress::new(console);
    let done = Workflow::run(recordings, held_out, moving_mass, options, &|stage, part| {
        progress.report(stage, part)
    })?;
    drop(progress);
    print_warnings(console, &done, &printed);
    advise(console, &done, MOST_NOTES.saturating_sub(limits));
    Ok(done)
}

/// Most notes about a result: what to record, and what to do about it. The rest is in the report.
const MOST_NOTES: usize = 3;

/// What was recorded, one line a file, and what that cannot determine; returns the number of these
/// notes.
pub(crate) fn print_survey(
    console: &Console,
    recordings: &[Recording],
    options: &SegmentOptions,
) -> usize {
    let survey = Survey::new(recordings, options);
    for own in &survey.recordings {
        let RecordingSurvey { name, samples, duration, stroke, .. } = own;
        let strokes = counted(own.strokes, "stroke", "strokes");
        let reversals = counted(own.reversals, "reversal", "reversals");
        console.remark(&format!(
            "{name}: {samples} samples, {duration:.1} s, position range {:.1} mm, {strokes}, {reversals}; \
             constant velocity {}",
            1e3 * stroke,
            speeds(&own.insertion_speeds, &own.withdrawal_speeds)
        ));
    }
    survey.limits.iter().for_each(|limit| console.remark(&format!("note: {limit}")));
    survey.limits.len()
}

/// "1 stroke", "2 strokes".
pub(crate) fn counted(count: usize, one: &str, many: &str) -> String {
    if count == 1 { format!("1 {one}") } else { format!("{count} {many}") }
}

pub(crate) fn speeds(insertion: &[f64], withdrawal: &[f64]) -> String {
    if insertion.is_empty() && withdrawal.is_empty() {
        return "nowhere".to_owned();
    }
    let [insertion, withdrawal] = [insertion, withdrawal].map(|speeds| match speeds {
        [] => "none".to_owned(),
        [one] => format!("{:.1} mm/s", 1e3 * one),
        [slowest, .., fastest] => {
            format!("{} speeds of {:.1} to {:.1} mm/s", speeds.len(), 1e3 * slowest, 1e3 * fastest)
        }
    });
    format!("in insertion {insertion}, in withdrawal {withdrawal}")
}

/// The messages with what they concern, in the words of the table.
fn in_lines<'a>(warnings: impl Iterator<Item = &'a Warning>) -> Vec<String> {
    said_once(warnings.map(|Warning { subject, message, .. }| {
        let subject = match subject {
            Subject::Parameter(id) => in_words(*id),
            other => other.to_string(),
        };
        (subject, message)
    }))
}

/// What a person can do for a better result, at most so many notes.
fn advise(console: &Console, done: &Workflow, most: usize) {
    let advice = done.identification.warnings.iter().filter(|w| w.is_advice && !w.doubtful);
    in_lines(advice).iter().take(most).for_each(|line| console.remark(&format!("note: {line}")));
}

/// What is doubtful about the result, but for what was `printed` when the files were read.
fn print_warnings(console: &Console, done: &Workflow, printed: &[String]) {
    let all = done.identification.warnings.iter();
    let doubts = all.filter(|w| w.doubtful && !printed.contains(&w.message));
    in_lines(doubts).iter().for_each(|line| console.warn(line));
    let results = done.validation().into_iter().flat_map(|validation| &validation.recordings);
    for result in results {
        for warning in &result.warnings {
            console.warn(&format!("{}: {warning}", result.path));
        }
    }
}

/// The main parameters and the errors as text.
fn in_brief(done: &Workflow) -> String {
    let mut table = Table::headed(["parameter", "value", "95 % interval", "unit"]);
    for Parameter { id, estimate } in main_parameters(&done.identification) {
        let Unit { scale, shown, .. } = id.unit();
        let bounds = estimate.ci95.map(|bound| scale * bound);
        table.row([
            in_words(*id),
            number(scale * estimate.value),
            interval(bounds),
            shown.to_owned(),
        ]);
    }
    let mut text = table.to_text();
    text.push_str(&format!(
        "\nerror over the recordings identified from: {} N rms\n",
        number(done.identification.residual_rms)
    ));
    let names: Vec<&str> =
        done.recordings.iter().map(|recording| recording.name.as_str()).collect();
    if let Some(words) = done.identification.friction_scale.in_words(&names) {
        text.push_str(&format!("{words}\n"));
    }
    if let Some(prior) = &done.identification.prior {
        text.push_str(&format!("prior: {}\n", prior.in_words()));
    }
    if let Some(posterior) = &done.identification.posterior {
        text.push_str(&format!("{}\n", posterior.in_words()));
    }
    text.push_str(&along_in_words(&done.identification));
    for r in done.validation().into_iter().flat_map(|validation| &validation.recordings) {
        text.push_str(&format!(
            "validation on {}: {} N rms, fit {:.2} %\n",
            r.path,
            number(r.rms_n),
            r.fit_percent
        ));
        if let Some(strokes) = &r.strokes {
            text.push_str(&format!("  {}\n", strokes.words()));
        }
    }
    text
}

/// Position delay and position profile, if there are any.
fn along_in_words(found: &Identification) -> String {
    let lag = found
        .position_delay
        .map(|lag| format!("position delay of {:.0} ms compensated\n", 1e3 * lag.delay_s));
    let along = found.position_profile.as_ref().map(|fit| {
        format!(
            "the force depends on the position: {} N rms on held-out cycles with a profile of {} knots, {} N without\n",
            number(fit.held_out_rms_n),
            fit.profile.gains().len(),
            number(fit.constant_held_out_rms_n)
        )
    });
    lag.into_iter().chain(along).collect()
}

/// Words and symbol of a parameter.
pub(crate) fn in_words(id: ParameterId) -> String {
    format!("{} {}", id.words(), id.symbol())
}

/// The parameters of the table: all but forces at the joins and the coefficients of the branches.
pub(crate) fn main_parameters(found: &Identification) -> impl Iterator<Item = &Parameter> {
    found.parameters.iter().filter(|p| !p.is_coefficient() && p.id.quantity != Quantity::JoinForce)
}
