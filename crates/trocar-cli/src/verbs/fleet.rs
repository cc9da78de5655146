//! `trocar fleet`

use std::path::{Path, PathBuf};

use trocar::cancel::{self, Cancel};
use trocar::fleet::{Config, Dataset, Depth, Fleet, Tally, journal_path, run as run_fleet};
use trocar::output::refuse_inputs;
use trocar::report::fleet::{self as fleet_report, Roles};
use trocar::table::Format;

use crate::Completion;
use crate::console::{self, BadArgument, Console};
use crate::input::{OUTPUT, Reading, Rod, STATISTICS};
use crate::output::Output;
use crate::page;
use crate::progress::Progress;

/// Identify every recording of a data set separately, on all cores, and write one table
///
/// DATASET is a folder of recordings (folders called key=value become columns) or a manifest (CSV
/// or Parquet with a column 'path' and further columns). A recording that fails is a row with its
/// reason. After an interruption the same command continues. Exit code 3: some recordings failed.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Folder of recordings, of any format that `trocar inspect` reads, or manifest
    #[arg(value_name = "DATASET")]
    dataset: PathBuf,
    /// Table to write: .parquet, .csv, .csv.gz, .csv.zst or .arrow
    #[arg(long, value_name = "TABLE", value_parser = Output::with(|table| vec![journal_path(table), report_beside(table)]), help_heading = OUTPUT)]
    out: Output,
    /// Depth of the identification
    #[arg(long, value_enum, default_value_t = Far::Quick, help_heading = STATISTICS)]
    depth: Far,
    /// Seed of everything random
    #[arg(long, default_value_t = 1, value_name = "N", help_heading = STATISTICS, hide_short_help = true)]
    seed: u64,
    /// Recordings at a time; 0: one per processor; at most four per processor, or 64
    #[arg(long, default_value_t = 0, value_name = "N", help_heading = OUTPUT, hide_short_help = true)]
    threads: usize,
    /// Report to write [default: the table's name with .html]
    #[arg(long, value_name = "FILE", help_heading = OUTPUT)]
    report: Option<Output>,
    /// Metadata column with the type of the trocar [default: trocar_type or similar]
    #[arg(long = "type", value_name = "COLUMN")]
    kind: Option<String>,
    /// Metadata column that counts uses [default: insertion_count or similar]
    #[arg(long = "use", value_name = "COLUMN")]
    usage: Option<String>,
    /// Metadata column that names specimens, or centres [default: specimen or similar]
    #[arg(long, value_name = "COLUMN")]
    specimen: Option<String>,
    #[command(flatten)]
    rod: Rod,
    #[command(flatten)]
    reading: Reading,
}

/// How far to go.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Far {
    /// The fit without the optional terms that rests and partial reversals determine
    Quick,
    /// All that `trocar identify` does, with all optional terms: slower
    Full,
}

pub(crate) fn run(console: &Console, args: &Args) -> anyhow::Result<Completion> {
    if *args.out == *Path::new("-") {
        return Err(BadArgument(
            "--out - : the table needs a file, beside which its journal stands".into(),
        )
        .into());
    }
    Format::of(&args.out)?;
    let journal = journal_path(&args.out);
    let dataset = Dataset::open(&args.dataset, &[args.out.to_path_buf(), journal.clone()])?;
    let report = args.report.as_deref().map_or_else(|| report_beside(&args.out), Path::to_path_buf);
    refuse_inputs([&report], &dataset.files())?;
    if let [first, ..] = dataset.left_out.as_slice() {
        console.remark(&format!(
            "note: {} left out for their extension, such as {first}",
            files(dataset.left_out.len())
        ));
    }
    let threads = cancel::threads(args.threads);
    let config = Config {
        reading: args.reading.for_each_of(threads),
        depth: match args.depth {
            Far::Quick => Depth::Quick,
            Far::Full => Depth::Full,
        },
        seed: args.seed,
        moving_mass: args.rod.moving_mass()?,
    };
    console::farewell(format!(
        "the same command continues where this one was stopped: {} is kept",
        journal.display()
    ));
    // A panic becomes a row with its message.
    std::panic::set_hook(Box::new(|_| ()));
    let progress = Progress::new(console);
    let started = std::time::Instant::now();
    let fleet =
        run_fleet(&dataset, &config, &args.out, threads, &Cancel::default(), &mut |tally| {
            let seconds = started.elapsed().as_secs_f64();
            progress
                .report(&in_words(tally, seconds), tally.done as f64 / tally.total.max(1) as f64);
        });
    drop(progress);
    let _ = std::panic::take_hook();
    let fleet = fleet?;
    console::farewell(String::new());
    let roles = Roles {
        kind: args.kind.clone(),
        usage: args.usage.clone(),
        specimen: args.specimen.clone(),
    };
    page::write(&fleet_report::document(&fleet, &config, &roles), &report)?;
    say(console, &fleet, started.elapsed().as_secs_f64());
    console.remark(&format!("table: {}\nreport: {}", args.out.display(), report.display()));
    Ok(Completion::doubtful_if(fleet.tally.failed > 0))
}

fn report_beside(table: &Path) -> PathBuf {
    let name =
        table.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let stem = name.split('.').next().unwrap_or("fleet");
    table.with_file_name(format!("{stem}.html"))
}

fn files(count: usize) -> String {
    if count == 1 { "1 file".to_owned() } else { format!("{count} files") }
}

fn in_words(tally: &Tally, seconds: f64) -> String {
    let rate = (tally.done - tally.reused) as f64 / seconds.max(1e-3);
    let failed =
        if tally.failed > 0 { format!(", {} failed", tally.failed) } else { String::new() };
    format!("{} of {} recordings, {rate:.1}/s{failed}", tally.done, tally.total)
}

/// Times are printed only to standard error.
fn say(console: &Console, fleet: &Fleet, seconds: f64) {
    let Tally { done, reused, failed, samples, .. } = fleet.tally;
    console.remark(&format!(
        "{done} recordings, {samples} samples in {seconds:.1} s: {} ok, {} doubtful, {failed} failed; {reused} reused from the journal",
        fleet.count("ok"),
        fleet.count("doubtful"),
    ));
    let mut reasons: Vec<(&str, usize)> = Vec::new();
    for record in fleet.records.iter().filter(|r| r.text("status") == Some("failed")) {
        let kind = record.text("reason_kind").unwrap_or_default();
        match reasons.iter_mut().find(|(own, _)| *own == kind) {
            Some((_, count)) => *count += 1,
            None => reasons.push((kind, 1)),
        }
        if reasons.iter().any(|(own, count)| *own == kind && *count == 1) {
            let (path, reason) = (record.text("path"), record.text("reason").unwrap_or_default());
            let path =
                path.filter(|path| !reason.starts_with(*path)).map(|path| format!("{path}: "));
            console.warn(&format!("{}{reason}", path.unwrap_or_default()));
        }
    }
    for (kind, count) in reasons.into_iter().filter(|(_, count)| *count > 1) {
        let kind = kind.replace('_', " ");
        console.warn(&format!("{} more failed ({kind}): the table has their reasons", count - 1));
    }
}
