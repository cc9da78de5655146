//! The tables of docs/explanation/comparison.md: all friction models on recordings that are not part of this
//! repository.
//!
//! ```text
//! cargo run --release -p trocar --example published_comparison -- FOLDER > results/comparison.md
//! cargo run --release -p trocar --example published_comparison -- FOLDER docs
//! ```
//! The second writes the drawings `docs/figures/one-reversal.svg` and `error-by-parameters.svg` alone. FOLDER holds `seal_a` (steady, dynamic, validation, surgeon) and `elastomer_seals` (one
//! recording a seal, ZILLEN).

use std::error::Error;
use std::path::Path;

use trocar::compare::{
    Choice, CompareOptions, Comparison, Entry, Outcome, compare, reversal_match, split,
};
use trocar::identify::IdentifyOptions;
use trocar::identify::classical::Kind;
use trocar::recording::{ReadOptions, Recording, RecordingError, read};
use trocar::report::comparison::document;
use trocar::report::vectors;
use trocar::workflow::MovingMass;

/// Numbers of elements that get a row; all from 1 to 12 are fitted.
const SHOWN: [usize; 4] = [1, 2, 4, 10];
/// Drawings of docs/figures.
const DRAWN: [&str; 2] = ["one-reversal", "error-by-parameters"];

fn load(folder: &Path, names: &[&str]) -> Result<Vec<Recording>, RecordingError> {
    names
        .iter()
        .map(|name| read(&folder.join(format!("{name}.csv")), &ReadOptions::default()))
        .collect()
}

fn compared(
    training: &[Recording],
    validation: &[Recording],
) -> Result<Comparison, Box<dyn Error>> {
    let options = CompareOptions {
        models: Choice::all(),
        identify: IdentifyOptions::default(),
        timing: false,
    };
    Ok(compare(training, validation, &options, &|_, _| {})?)
}

fn is_shown(entry: &Entry) -> bool {
    match entry.choice {
        Choice::Classical(Kind::MaxwellSlip(n) | Kind::Gms(n)) => SHOWN.contains(&n),
        _ => true,
    }
}

fn print_table(title: &str, comparison: &Comparison) {
    println!("\n### {title}\n");
    let names: Vec<&str> = comparison.validation.iter().map(|r| r.name.as_str()).collect();
    let by_recording = names.len() > 1;
    print!("| model | parameters | training, N | validation, N |");
    if by_recording {
        names.iter().for_each(|name| print!(" {name}, N |"));
    }
    println!(" fit, % | AIC | BIC | after reversals, N | worst reversal, N | not determined |");
    println!("|{}", "---|".repeat(10 + if by_recording { names.len() } else { 0 }));
    for entry in comparison.entries.iter().filter(|e| is_shown(e)) {
        let s = &entry.scores;
        let name = if entry.choice.is_bank() {
            format!("{} {}", entry.name, entry.elements)
        } else {
            entry.name.to_owned()
        };
        print!(
            "| {name} | {} | {:.4} | {:.4} |",
            entry.parameters, s.train_rms_n, s.validate_rms_n
        );
        if by_recording {
            s.by_recording_n.iter().for_each(|rms| print!(" {rms:.4} |"));
        }
        let loose = entry
            .estimates
            .iter()
            .filter(|p| !p.estimate.determined && !p.is_coefficient())
            .count();
        let criteria = format!("{:.0} | {:.0}", s.aic, s.bic);
        println!(
            " {:.1} | {criteria} | {:.4} | {:.4} | {loose} |",
            s.fit_percent, s.reversal_rms_n, s.worst_reversal_n
        );
    }
    let (samples, worth) = (comparison.samples, comparison.effective_samples);
    println!("\n{samples} training samples, worth {worth:.0} independent ones.");
    if let Err(why) = &comparison.ems.deformation {
        println!("\nThe deformation is not resolved ({why}): `ems` is a stiff spring here.");
    }
    for family in ["maxwell-slip", "gms"] {
        if let Some(claim) = reversal_match(comparison, family) {
            println!("\n{}", claim.sentence());
        }
    }
}

/// The simulated lip seal.
fn of_lip_seal(folder: &Path) -> Result<Comparison, Box<dyn Error>> {
    let seal = folder.join("seal_a");
    compared(&load(&seal, &["steady", "dynamic"])?, &load(&seal, &["validation", "surgeon"])?)
}

/// Names and SVG of the drawings of docs/explanation/comparison.md.
pub(crate) fn drawings(folder: &Path) -> Result<Vec<(String, String)>, Box<dyn Error>> {
    let comparison = of_lip_seal(folder)?;
    let moving_mass = MovingMass::default();
    let outcome = Outcome { comparison, seed: 0, held_out: false, moving_mass };
    let mut drawings = vectors(&document(&outcome, ""))?;
    drawings.retain(|(name, _)| DRAWN.contains(&name.as_str()));
    Ok(drawings)
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).ok_or("the folder of the recordings is missing")?;
    let folder = Path::new(&folder);
    if let Some(docs) = std::env::args().nth(2) {
        for (name, svg) in drawings(folder)? {
            let figures = Path::new(&docs).join("figures");
            std::fs::write(figures.join(name).with_extension("svg"), svg)?;
        }
        return Ok(());
    }
    let elastomers = folder.join("elastomer_seals");
    println!(
        "<!-- made by: cargo run --release -p trocar --example published_comparison -- FOLDER -->"
    );
    print_table("A simulated lip seal that is no EMS element", &of_lip_seal(folder)?);
    let rerun = load(&elastomers, &["o_ring257_1bar_rerun"])?;
    let comparison = compared(&load(&elastomers, &["o_ring257_1bar"])?, &rerun)?;
    print_table("O-ring, 25.7 mm bore, validated on its rerun", &comparison);
    for (name, title) in [
        ("o_ring_1bar", "O-ring, 25 mm bore"),
        ("x_ring257_1bar", "X-ring, 25.7 mm bore"),
        ("kdn_1bar", "Lip profile KDN"),
        ("napn_1bar", "Lip profile NAPN"),
        ("pk_1bar", "Lip profile PK"),
    ] {
        let (training, validation) = split(&load(&elastomers, &[name])?)?;
        print_table(
            &format!("{title}, validated on its last third"),
            &compared(&training, &validation)?,
        );
    }
    Ok(())
}
