//! `trocar inspect`

use std::fmt::Write as _;
use std::path::PathBuf;

use trocar::inspect::{Clock, ColumnView, Inspection, RecordingPreview, TableView, inspect};
use trocar::recording::registry;

use crate::Completion;
use crate::console::{self, Console};
use crate::input::Choosing;
use crate::table::{Table, number};
use crate::verbs::identify::{counted, speeds};

/// Characters of a sparkline.
const WIDTH: usize = 32;

/// Most columns shown of a large table.
const SHOWN: usize = 40;

/// Show what is in a file: tables, topics, columns, units, rates, gaps, and what could be
/// identified from it
#[derive(clap::Args)]
#[command(long_about = help())]
pub(crate) struct Args {
    /// File or bag folder
    file: PathBuf,
    /// Print JSON instead of the tables
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    choosing: Choosing,
}

fn help() -> String {
    format!(
        "Show what is in a file: tables, topics, columns, units, rates, gaps, and what could be identified from it\n\n\
         Reads {}. Prints which columns would be used as time, position, velocity and force, as options --columns and --topic. \
         Exit code 3: the file cannot be read as a recording without further options.",
        registry::in_words()
    )
}

pub(crate) fn run(console: &Console, args: &Args) -> anyhow::Result<Completion> {
    let found = inspect(&args.file, &args.choosing.choice())?;
    if let Err(reason) = &found.recording {
        console.warn(reason);
    }
    if args.json {
        console::print_json(&found)?;
    } else {
        console::print(&in_words(&found, &args.choosing))?;
    }
    Ok(Completion::doubtful_if(
        found.recording.is_err() || found.tables.iter().any(|table| table.damage.is_some()),
    ))
}

fn in_words(found: &Inspection, choosing: &Choosing) -> String {
    let mut text =
        format!("{}: {}, {:.3} MB\n", found.file, found.format, 1e-6 * found.bytes as f64);
    for table in &found.tables {
        text.push('\n');
        text.push_str(&table_in_words(table));
    }
    if let Ok(recording) = &found.recording {
        text.push('\n');
        text.push_str(&recording_in_words(recording, choosing));
    }
    text
}

fn table_in_words(table: &TableView) -> String {
    let parts = [table.name.clone(), table.kind.clone(), rows_in_words(table)];
    let mut text = parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(", ");
    text.push('\n');
    if let Some(damage) = &table.damage {
        let _ = writeln!(text, "  damaged: {}", damage.replace("\n\n", "; "));
    }
    let mut lines = Table::headed(["column", "unit", "from", "to", "not finite", "course"]);
    for column in table.columns.iter().take(SHOWN) {
        lines.row(column_in_words(column));
    }
    text.push_str(&lines.to_text());
    if table.columns.len() > SHOWN {
        let _ =
            writeln!(text, "  and {} more columns (--json shows all)", table.columns.len() - SHOWN);
    }
    text
}

fn rows_in_words(table: &TableView) -> String {
    let rows = format!("{} rows", table.rows);
    let Some(Clock { per_s, duration, median_interval, gaps, longest_interval, not_later, column }) =
        &table.clock
    else {
        return rows;
    };
    let Some(per_s) = per_s else {
        return format!("{rows}, {} in {column}, whose unit is not declared", number(*duration));
    };
    let rate = if *median_interval > 0.0 {
        format!(" at {} Hz", number(per_s / median_interval))
    } else {
        String::new()
    };
    let mut words = format!("{rows}{rate}, {} s", number(duration / per_s));
    if *gaps > 0 {
        let _ = write!(words, ", {gaps} gaps, the longest {} s", number(longest_interval / per_s));
    }
    if *not_later > 0 {
        let _ = write!(words, ", {not_later} rows not later than the one before");
    }
    words
}

fn column_in_words(column: &ColumnView) -> [String; 6] {
    let [lowest, highest] =
        [column.lowest, column.highest].map(|value| value.map_or("-".to_owned(), number));
    let not_finite =
        if column.not_finite > 0 { column.not_finite.to_string() } else { "-".to_owned() };
    let unit = column.unit.clone().unwrap_or_else(|| "-".to_owned());
    let course = if column.lowest.is_some() {
        sparkline(&column.course)
    } else {
        format!("{:<WIDTH$}", "no numbers")
    };
    [column.name.clone(), unit, lowest, highest, not_finite, course]
}

/// Eight bar heights, from the lowest mean to the highest.
fn sparkline(course: &[f64]) -> String {
    const BARS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    let lowest = course.iter().copied().fold(f64::INFINITY, f64::min);
    let highest = course.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let count = course.len().min(WIDTH);
    let line: String = (0..count)
        .map(|k| {
            let group = &course[k * course.len() / count..(k + 1) * course.len() / count];
            group.iter().sum::<f64>() / group.len() as f64
        })
        .map(|value| {
            let part = if highest > lowest { (value - lowest) / (highest - lowest) } else { 0.0 };
            BARS[((8.0 * part) as usize).min(7)]
        })
        .collect();
    format!("{line:<WIDTH$}")
}

fn recording_in_words(found: &RecordingPreview, choosing: &Choosing) -> String {
    let topics: String = choosing.topic.iter().map(|topic| format!(" --topic '{topic}'")).collect();
    let mut text = format!("would be read as\n  --columns '{}'{topics}\n", found.columns.join(","));
    for note in &found.notes {
        let _ = writeln!(text, "  note: {note}");
    }
    for warning in &found.warnings {
        let _ = writeln!(text, "  warning: {}", warning.replace("\n\n", "; "));
    }
    let _ = writeln!(
        text,
        "\ncould be identified from it\n  {} samples, {:.1} s, position range {:.1} mm, {}; constant velocity {}",
        found.samples,
        found.duration_s,
        1e3 * found.stroke_m,
        counted(found.strokes, "stroke", "strokes"),
        speeds(&found.insertion_speeds_m_s, &found.withdrawal_speeds_m_s)
    );
    for limit in &found.limits {
        let _ = writeln!(text, "  not: {limit}");
    }
    text
}
