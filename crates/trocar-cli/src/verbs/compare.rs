//! `trocar compare`

use std::path::PathBuf;

use trocar::compare::{CompareOptions, Comparison, Divided, Entry, best_of};
use trocar::identify::classical::Kind;
use trocar::identify::{IdentifyOptions, Warning};
use trocar::output::StagedFolder;
use trocar::report;

use super::identify::print_survey;
use crate::Completion;
use crate::console::{self, Console};
use crate::input::{OUTPUT, Reading, Rod, STATISTICS, files, say_how_read};
use crate::models::{Models, models};
use crate::output::Output;
use crate::progress::Progress;
use crate::table::{Table, number};

/// Most undetermined parameters that are named.
const MOST_NAMES: usize = 8;

/// Compare friction models: fit them all to the same recordings, score them on the same others
///
/// The EMS element and the classical models that --models lists. Fits each to the training
/// recordings and simulates it along the validation recordings. Prints the best model of each family, least error first, and by
/// how many standard errors over the strokes it wins; --all prints everything, and --out writes
/// every model to a file. All models are scored on the samples at which the state of the EMS
/// element is known. Exit code 3: a recording lost data, or the seal never slides in a validation
/// recording. Parameters that the recordings do not determine are reported as such.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[arg(required = true, value_name = "RECORDING", help = files("Recordings to fit to"))]
    recordings: Vec<PathBuf>,
    /// Recordings to score on [default: the last third of each recording, which is then not fitted]
    #[arg(long, value_name = "RECORDING", num_args = 1..)]
    validate: Vec<PathBuf>,
    #[arg(long, default_value = "all", value_name = "LIST", value_parser = models, help = "Models, separated by commas, such as ems,lugre,gms:4-10; --help lists them", long_help = models_help())]
    models: Models,
    /// Folder for compare.json, models (one file each, for simulate and validate),
    /// report.html and figures; it need not exist
    #[arg(long, value_name = "DIR", value_parser = Output::folder(&["compare.json", "models/*.json", "report.html", "figures/*"]), help_heading = OUTPUT)]
    out: Option<Output>,
    /// Print every model, criteria, times and warnings after the best of each family
    #[arg(long, help_heading = OUTPUT)]
    all: bool,
    /// Do not measure times: equal recordings then give equal bytes
    #[arg(long, help_heading = OUTPUT, hide_short_help = true)]
    no_timing: bool,
    /// Seed of everything random
    #[arg(long, default_value_t = 1, value_name = "N", help_heading = STATISTICS, hide_short_help = true)]
    seed: u64,
    #[command(flatten)]
    rod: Rod,
    /// Print compare.json instead of the table
    #[arg(long, help_heading = OUTPUT)]
    json: bool,
    #[command(flatten)]
    reading: Reading,
}

fn models_help() -> String {
    let families = Kind::FAMILIES.iter().map(|kind| match kind.is_bank() {
        true => format!("{}[:N]", kind.family()),
        false => kind.family().to_owned(),
    });
    format!(
        "Models, separated by commas: ems, ems-output-error (EMS fitted by the criterion of the others), {}. [:N] is a number or a \
         range of elements, as in leuven:4 or maxwell-slip:4-10 [default: 4 for leuven, 1 to 12 for the others]",
        families.collect::<Vec<_>>().join(", ")
    )
}

pub(crate) fn run(console: &Console, args: &Args) -> anyhow::Result<Completion> {
    let moving_mass = args.rod.moving_mass()?;
    let paths: Vec<PathBuf> = args.recordings.iter().chain(&args.validate).cloned().collect();
    let mut recordings = args.reading.recordings(console, &paths)?;
    let lost = recordings.iter().any(|r| !r.quality.warnings.is_empty());
    let validation = recordings.split_off(args.recordings.len());
    let divided = Divided::of(recordings, validation, moving_mass)?;
    if divided.held_out {
        console.remark("no recordings to score on: the last third of each is held out from the fits and scored on");
    }
    // Fails before the computation if nothing can be written there.
    let staged = args.out.as_ref().map(StagedFolder::create).transpose()?;
    let identify = IdentifyOptions { seed: args.seed, ..Default::default() };
    print_survey(console, &divided.training, &identify.segment);
    let scored = if divided.held_out { &[][..] } else { &divided.validation };
    say_how_read(console, divided.training.iter().chain(scored));
    let options =
        CompareOptions { models: args.models.0.clone(), identify, timing: !args.no_timing };
    let progress = Progress::new(console);
    let outcome = divided.compared(options, &|stage, part| progress.report(stage, part))?;
    drop(progress);
    let comparison = &outcome.comparison;
    if let Some(staged) = staged {
        report::comparison::write(&outcome, &staged)?;
        staged.commit()?;
    }
    let unknown = outcome.unknown_states();
    unknown.iter().for_each(|warning| console.warn(warning));
    console::print(&match args {
        Args { json: true, .. } => outcome.summary().to_json(),
        Args { all: true, .. } => format!("{}\n{}", answer(comparison), text(comparison)),
        _ => answer(comparison),
    })?;
    match &args.out {
        Some(folder) => {
            console.remark(&format!("report: {}", folder.join("report.html").display()))
        }
        None if !args.all => console
            .remark("every model, criteria and warnings: --all; report and model files: --out DIR"),
        None => {}
    }
    Ok(Completion::doubtful_if(lost || !unknown.is_empty()))
}

/// The best of each family, and who wins by how much.
fn answer(comparison: &Comparison) -> String {
    let columns = [
        "model",
        "parameters",
        "validate N",
        "fit %",
        "worst reversal N",
        "standard errors behind",
    ];
    let mut table = Table::headed(columns);
    for family in comparison.families() {
        let entry = best_of(&family);
        let behind = comparison.margin(entry).map(|m| format!("{:.1}", m.standard_errors));
        table.row([
            entry.title(),
            entry.parameters.to_string(),
            number(entry.scores.validate_rms_n),
            format!("{:.2}", entry.scores.fit_percent),
            number(entry.scores.worst_reversal_n),
            behind.unwrap_or_else(|| "-".to_owned()),
        ]);
    }
    format!("{}\n{}\n", table.to_text(), comparison.verdict())
}

/// Every model, the test of the paper's claim, and the warnings.
fn text(comparison: &Comparison) -> String {
    let mut text = table(&comparison.entries).to_text();
    text.push('\n');
    for claim in comparison.claims() {
        text.push_str(&format!("{}\n", claim.sentence()));
    }
    text.push_str(&format!(
        "AIC and BIC: on the training recordings, {} samples worth {:.0} independent ones; errors in N rms\n",
        comparison.samples, comparison.effective_samples
    ));
    for entry in &comparison.entries {
        for warning in in_brief(entry) {
            text.push_str(&format!("{}: {warning}\n", entry.title()));
        }
    }
    text
}

fn table(entries: &[Entry]) -> Table {
    let mut table = Table::headed([
        "model",
        "elements",
        "parameters",
        "train N",
        "validate N",
        "fit %",
        "AIC",
        "BIC",
        "worst reversal N",
        "ns/sample",
        "fit s",
        "warnings",
    ]);
    let time = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), number);
    for entry in entries {
        let scores = &entry.scores;
        table.row([
            entry.name.to_owned(),
            entry.elements.to_string(),
            entry.parameters.to_string(),
            number(scores.train_rms_n),
            number(scores.validate_rms_n),
            format!("{:.2}", scores.fit_percent),
            format!("{:.1}", scores.aic),
            format!("{:.1}", scores.bic),
            number(scores.worst_reversal_n),
            time(entry.ns_per_sample),
            time(entry.fit_s),
            entry.warnings.len().to_string(),
        ]);
    }
    table
}

/// The warnings of a model; those about undetermined parameters are combined, and the JSON contains
/// the reason of each.
fn in_brief(entry: &Entry) -> Vec<String> {
    let (undetermined, others): (Vec<&Warning>, Vec<&Warning>) =
        entry.warnings.iter().partition(|w| w.undetermined);
    let mut lines: Vec<String> =
        others.iter().map(|w| format!("{}: {}", w.subject, w.message)).collect();
    let names: Vec<String> = undetermined.iter().map(|w| w.subject.to_string()).collect();
    match names.len() {
        0 => {}
        1..=MOST_NAMES => lines.push(format!("not determined: {}", names.join(", "))),
        count => lines.push(format!("not determined: {count} numbers, named in the JSON")),
    }
    lines
}
