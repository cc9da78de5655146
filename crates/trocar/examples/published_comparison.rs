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
use trocar::identify::classical::Kind;
use trocar::identify::{IdentifyOptions, Parameter};
use trocar::recording::{ReadOptions, Recording, RecordingError, read};
use trocar::report::comparison::document;
use trocar::report::vectors;
use trocar::workflow::MovingMass;

/// Numbers of elements that get a row; all from 1 to 12 are fitted.
const SHOWN: [usize; 4] = [1, 2, 4, 10];
/// Title of the section with the drawings.
const LIP_SEAL: &str = "A simulated lip seal that is no EMS element";
/// Drawings of docs/figures.
const DRAWN: [&str; 2] = ["one-reversal", "error-by-parameters"];

/// Without glitches, at the expected positions: as `trocar compare` takes them before it splits a recording.
fn load(folder: &Path, names: &[&str]) -> Result<Vec<Recording>, RecordingError> {
    let read = |name| read(&folder.join(format!("{name}.csv")), &ReadOptions::default());
    names.iter().map(|name| Ok(read(name)?.without_glitches().into_smoothed())).collect()
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

/// A section of results/comparison.md.
fn section(title: &str, comparison: &Comparison) -> String {
    let names: Vec<&str> = comparison.validation.iter().map(|r| r.name.as_str()).collect();
    let by_recording = if names.len() > 1 { names.as_slice() } else { &[] };
    let mut text = format!("\n### {title}\n\n| model | parameters | training, N | validation, N |");
    text.extend(by_recording.iter().map(|name| format!(" {name}, N |")));
    text += " fit, % | AIC | BIC | after reversals, N | worst reversal, N | not determined |\n";
    text += &format!("|{}\n", "---|".repeat(10 + by_recording.len()));
    for entry in comparison.entries.iter().filter(|e| is_shown(e)) {
        let s = &entry.scores;
        let name = if entry.choice.is_bank() {
            format!("{} {}", entry.name, entry.elements)
        } else {
            entry.name.to_owned()
        };
        text += &format!(
            "| {name} | {} | {:.4} | {:.4} |",
            entry.parameters, s.train_rms_n, s.validate_rms_n
        );
        let each = s.by_recording_n.iter().take(by_recording.len());
        text.extend(each.map(|rms| format!(" {rms:.4} |")));
        let is_loose = |p: &&Parameter| !p.estimate.determined && !p.is_coefficient();
        let loose = entry.estimates.iter().filter(is_loose).count();
        text += &format!(
            " {:.1} | {:.0} | {:.0} | {:.4} | {:.4} | {loose} |\n",
            s.fit_percent, s.aic, s.bic, s.reversal_rms_n, s.worst_reversal_n
        );
    }
    let (samples, worth) = (comparison.samples, comparison.effective_samples);
    text += &format!("\n{samples} training samples, worth {worth:.0} independent ones.\n");
    if let Err(why) = &comparison.ems.deformation {
        text +=
            &format!("\nThe deformation is not resolved ({why}): `ems` is a stiff spring here.\n");
    }
    let claims = ["maxwell-slip", "gms"].map(|family| reversal_match(comparison, family));
    text.extend(claims.iter().flatten().map(|claim| format!("\n{}\n", claim.sentence())));
    text
}

/// The simulated lip seal.
fn of_lip_seal(folder: &Path) -> Result<Comparison, Box<dyn Error>> {
    let seal = folder.join("seal_a");
    compared(&load(&seal, &["steady", "dynamic"])?, &load(&seal, &["validation", "surgeon"])?)
}

/// Name and title of the recordings of other rubber seals.
pub(crate) const SEALS: [[&str; 2]; 5] = [
    ["o_ring_1bar", "O-ring, 25 mm bore"],
    ["x_ring257_1bar", "X-ring, 25.7 mm bore"],
    ["kdn_1bar", "Lip profile KDN"],
    ["napn_1bar", "Lip profile NAPN"],
    ["pk_1bar", "Lip profile PK"],
];

/// The section of one of them.
pub(crate) fn of_rubber_seal(
    folder: &Path,
    [name, title]: [&str; 2],
) -> Result<String, Box<dyn Error>> {
    let (training, validation) = split(&load(&folder.join("elastomer_seals"), &[name])?)?;
    let title = format!("{title}, validated on its last third");
    Ok(section(&title, &compared(&training, &validation)?))
}

/// Name and SVG of each drawing.
type Drawings = Vec<(String, String)>;

/// The section of the simulated lip seal, and the drawings of
/// docs/explanation/comparison.md.
pub(crate) fn drawings(folder: &Path) -> Result<(String, Drawings), Box<dyn Error>> {
    let comparison = of_lip_seal(folder)?;
    let text = section(LIP_SEAL, &comparison);
    let moving_mass = MovingMass::default();
    let outcome = Outcome { comparison, seed: 0, held_out: false, moving_mass };
    let mut drawings = vectors(&document(&outcome, ""))?;
    drawings.retain(|(name, _)| DRAWN.contains(&name.as_str()));
    Ok((text, drawings))
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).ok_or("the folder of the recordings is missing")?;
    let folder = Path::new(&folder);
    if let Some(docs) = std::env::args().nth(2) {
        for (name, svg) in drawings(folder)?.1 {
            let figures = Path::new(&docs).join("figures");
            std::fs::write(figures.join(name).with_extension("svg"), svg)?;
        }
        return Ok(());
    }
    println!(
        "<!-- made by: cargo run --release -p trocar --example published_comparison -- FOLDER -->"
    );
    print!("{}", section(LIP_SEAL, &of_lip_seal(folder)?));
    let elastomers = folder.join("elastomer_seals");
    let rerun = load(&elastomers, &["o_ring257_1bar_rerun"])?;
    let comparison = compared(&load(&elastomers, &["o_ring257_1bar"])?, &rerun)?;
    print!("{}", section("O-ring, 25.7 mm bore, validated on its rerun", &comparison));
    for seal in SEALS {
        print!("{}", of_rubber_seal(folder, seal)?);
    }
    Ok(())
}
