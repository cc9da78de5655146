//! A data set for `trocar fleet` whose truth is known, and how near its table comes.
//!
//! ```text
//! cargo run --release -p trocar --features parquet --example fleet_dataset -- make FOLDER [RECORDINGS]
//! trocar fleet FOLDER --out TABLE.parquet --moving-mass-kg 0.04
//! cargo run --release -p trocar --features parquet --example fleet_dataset -- check FOLDER TABLE.parquet
//! ```
//! Three made-up types of trocar, ten recordings a specimen, 40,000 samples each at 1 kHz on the
//! virtual bench. The Coulomb force of a specimen is that of its type times a factor of its own
//! (standard deviation 8 %) and falls by a thousandth with every insertion. The same count gives
//! the same bytes.

use std::collections::HashMap;
use std::error::Error;
use std::fs;
use std::path::Path;

use rayon::prelude::*;
use trocar::bench::BenchConfig;
use trocar::table::{self, Column};

mod types;

use types::{Specimen, TYPES};

const SAMPLES: usize = 40_000;
/// Recordings of a specimen, and insertions from one to the next.
const REPEATS: u64 = 10;
const INSERTIONS: u64 = 20;
/// Standard deviation of the specimens' factor.
const SPECIMENS: f64 = 0.08;
/// Under a name that is no part of the data set.
const TRUTH: &str = "_truth.csv";

type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

/// Parameters that are checked: column, and unit.
const CHECKED: [(&str, &str); 3] =
    [("coulomb_force_n", "N"), ("viscous_damping_n_s_m", "N s/m"), ("half_width_m", "m")];

struct Made {
    path: String,
    truth: [f64; 3],
}

/// Normal deviate of a specimen: twelve golden-ratio steps.
fn deviate(specimen: u64) -> f64 {
    (1..=12)
        .map(|k| {
            ((specimen + 1) as f64 * 0.618_034 * k as f64 + 0.754_878 * (k * k) as f64).fract()
        })
        .sum::<f64>()
        - 6.0
}

fn make(folder: &Path, number: u64) -> Outcome<Made> {
    let (specimen, repeat) = (number / REPEATS, number % REPEATS);
    let specimen = Specimen {
        kind: specimen as usize % TYPES.len(),
        name: format!("{specimen:03}"),
        factor: 1.0 + SPECIMENS * deviate(specimen),
        branches_seed: specimen,
        insertions: repeat * INSERTIONS,
    };
    let mut config = BenchConfig::default();
    config.protocol.validation.stroke_m = 0.046;
    let (path, truth) = types::record(folder, &specimen, &config, (number, SAMPLES))?;
    Ok(Made { path, truth })
}

fn make_all(folder: &Path, count: u64) -> Outcome<()> {
    let made = (0..count)
        .into_par_iter()
        .map(|number| make(folder, number))
        .collect::<Outcome<Vec<Made>>>()?;
    let line = |m: &Made| format!("{},{},{},{}\n", m.path, m.truth[0], m.truth[1], m.truth[2]);
    let lines: String = made.iter().map(line).collect();
    fs::write(
        folder.join(TRUTH),
        format!("path,coulomb_force_n,viscous_damping_n_s_m,half_width_m\n{lines}"),
    )?;
    println!("{count} recordings of {SAMPLES} samples in {}", folder.display());
    Ok(())
}

fn truths(folder: &Path) -> Outcome<HashMap<String, [f64; 3]>> {
    let text = fs::read_to_string(folder.join(TRUTH))?;
    let line = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |k: usize| cells.get(k).and_then(|cell| cell.parse().ok()).unwrap_or(f64::NAN);
        (cells[0].to_owned(), [number(1), number(2), number(3)])
    };
    Ok(text.lines().skip(1).map(line).collect())
}

fn check(folder: &Path, table: &Path) -> Outcome<()> {
    let truths = truths(folder)?;
    let table = table::read(table)?;
    let Some(Column::Text(paths)) = table.column("path") else {
        return Err("no column path".into());
    };
    let number = |name: &str| match table.column(name) {
        Some(Column::Number(cells)) => Ok(cells),
        _ => Err(format!("no column {name}")),
    };
    println!(
        "| parameter | found | interval holds the truth | median error | largest error |\n| --- | --- | --- | --- | --- |"
    );
    for (k, (name, _)) in CHECKED.iter().enumerate() {
        let (values, lower, upper) =
            (number(name)?, number(&format!("{name}_lower"))?, number(&format!("{name}_upper"))?);
        let mut errors = Vec::new();
        let mut held = 0;
        for (row, path) in paths.iter().enumerate() {
            let truth = path
                .as_ref()
                .and_then(|path| truths.get(path.as_ref()))
                .ok_or("a recording without truth")?[k];
            if values[row].is_finite() {
                errors.push((values[row] / truth - 1.0).abs());
                held += usize::from(lower[row] <= truth && truth <= upper[row]);
            }
        }
        errors.sort_by(f64::total_cmp);
        let part = 100.0 * held as f64 / errors.len().max(1) as f64;
        let error =
            |at: usize| errors.get(at).map_or("–".to_owned(), |e| format!("{:.2} %", 100.0 * e));
        let (middle, last) = (error(errors.len() / 2), error(errors.len().wrapping_sub(1)));
        println!(
            "| {name} | {} of {} | {part:.1} % | {middle} | {last} |",
            errors.len(),
            paths.len()
        );
    }
    Ok(())
}

fn main() -> Outcome<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words.as_slice() {
        ["make", folder] => make_all(Path::new(folder), 1000),
        ["make", folder, count] => make_all(Path::new(folder), count.parse()?),
        ["check", folder, table] => check(Path::new(folder), Path::new(table)),
        _ => Err("expected: make FOLDER [RECORDINGS], or check FOLDER TABLE.parquet".into()),
    }
}
