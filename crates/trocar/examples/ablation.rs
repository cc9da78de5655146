//! The tables of docs/explanation/ablation.md: what each optional term of the fit is worth on recordings it has
//! not seen.
//!
//! ```text
//! cargo run --release -p trocar --example ablation -- FOLDER > results/optional-terms.md
//! ```
//! FOLDER holds `seal_a` (steady, dynamic, validation, surgeon). Identified from steady, dynamic
//! and the first half of surgeon; scored on the second half of surgeon and on validation. Takes
//! about half an hour.

use std::error::Error;
use std::path::Path;

use trocar::identify::{Candidate, Identification, IdentifyOptions, Term, identify};
use trocar::recording::loads::Load;
use trocar::recording::{ReadOptions, Recording, RecordingError, read};
use trocar::replay::replay;
use trocar::segment::{reversal_threshold, strokes};
use trocar::validate::{PhaseError, RecordingValidation, Validation, validate};

/// What is fitted, and what is scored.
struct Data {
    training: Vec<Recording>,
    validation: Vec<Recording>,
}

/// A model with its scores.
struct Row {
    what: String,
    found: Identification,
    scores: Validation,
}

impl Row {
    fn new(data: &Data, what: &str, options: &IdentifyOptions) -> Result<Self, Box<dyn Error>> {
        let found = identify(&data.training, options, &|_, _| {})?;
        let seen = as_scored(&found, &data.validation)?;
        let scores = validate(&found.trocar(), &seen, found.model.offset);
        let row = Self { what: what.to_owned(), found, scores };
        eprintln!("{}", row.text());
        Ok(row)
    }

    fn text(&self) -> String {
        let [surgeon, strokes] = [0, 1].map(|i| self.scores.recordings[i].rms_n);
        let scaled =
            self.found.fit.as_ref().map_or("–".to_owned(), |fit| format!("{:.4}", fit.rms_n));
        format!(
            "| {} | {} | {} | {:.4} | {scaled} | {surgeon:.4} | {strokes:.4} |",
            self.what,
            has(&self.found.model),
            self.found.free_parameters,
            self.found.residual_rms
        )
    }
}

/// Without the unmodelled mass and the delay of the positions that the identification found.
fn as_scored(
    found: &Identification,
    recordings: &[Recording],
) -> Result<Vec<Recording>, RecordingError> {
    let mass = found.model.loads[Load::Mass].max(0.0);
    let lighter: Result<_, _> =
        recordings.iter().map(|r| r.clone().without_moving_mass(mass, 0.0)).collect();
    found.without_delay(lighter?)
}

/// Optional terms of the model, in words.
fn has(model: &Candidate) -> String {
    let present = |term: &Term| match term {
        Term::Stribeck => model.insertion.static_force > model.insertion.coulomb_force,
        Term::StribeckExponent => model.insertion.stribeck_exponent != 2.0,
        Term::SealDamping => model.seal_damping > 0.0,
        Term::MinorLoops => model.yield_ratio > Candidate::DEFAULT_YIELD_RATIO,
        Term::Creep => model.creep_velocity > 0.0,
        Term::Dwell => model.dwell_force > 0.0,
        Term::Relaxation => model.relaxation.arms[0].stiffness > 0.0,
        Term::SecondRelaxation => model.relaxation.arms[1].stiffness > 0.0,
        Term::Load(load) => model.loads[*load] != 0.0,
        Term::Asymmetry => model.insertion != model.withdrawal,
        Term::SecondStage => model.second.is_some(),
    };
    let words: Vec<&str> = Term::ALL.into_iter().filter(present).map(Term::words).collect();
    if words.is_empty() { "–".to_owned() } else { words.join(", ") }
}

fn without(terms: Vec<Term>) -> IdentifyOptions {
    IdentifyOptions { without: terms, ..IdentifyOptions::default() }
}

fn halves(recording: &Recording) -> Result<[Recording; 2], RecordingError> {
    let middle = recording.time[0] + 0.5 * recording.duration();
    let at = recording.time.partition_point(|t| *t < middle);
    Ok([recording.part(0..at, "first half")?, recording.part(at..recording.len(), "second half")?])
}

fn load(folder: &Path) -> Result<Data, RecordingError> {
    let load = |name: &str| read(&folder.join(format!("{name}.csv")), &ReadOptions::default());
    let [first, second] = halves(&load("surgeon")?)?;
    Ok(Data {
        training: vec![load("steady")?, load("dynamic")?, first],
        validation: vec![second, load("validation")?],
    })
}

fn heading(title: &str) {
    println!("\n### {title}\n");
    println!(
        "| fit | optional terms | parameters | own data, N | friction scales removed, N | surgeon, N | full strokes, N |"
    );
    println!("|---|---|---|---|---|---|---|");
}

/// All terms but one, each in turn.
fn print_left_out(data: &Data, all: &Row) -> Result<(), Box<dyn Error>> {
    heading("All terms but one");
    let trials = all.found.fit.iter().flat_map(|fit| &fit.terms);
    let kept: Vec<Term> = trials.filter(|trial| trial.kept).map(|trial| trial.term).collect();
    for term in Term::ALL {
        let what = format!("without {}", term.words());
        if kept.contains(&term) {
            println!("{}", Row::new(data, &what, &without(vec![term]))?.text());
        } else {
            println!("| {what} | the same model: the term was not accepted | | | | | |");
        }
    }
    Ok(())
}

/// The paper's element with each term alone.
fn print_alone(data: &Data) -> Result<(), Box<dyn Error>> {
    heading("The paper's element and one term");
    for term in Term::ALL {
        // A second relaxation time needs a first.
        let both = [Term::Relaxation, Term::SecondRelaxation];
        let wanted = if term == Term::SecondRelaxation { &both[..] } else { &[term][..] };
        let others = Term::ALL.into_iter().filter(|other| !wanted.contains(other)).collect();
        println!("{}", Row::new(data, &format!("with {}", term.words()), &without(others))?.text());
    }
    Ok(())
}

/// What the error of one recording is made of: root mean squares, N.
struct Makeup {
    /// Changes from sample to sample: noise of the sensor.
    white: f64,
    /// Mean error of each stroke.
    level: f64,
    /// What is left within the strokes.
    within: f64,
}

fn makeup(row: &Row, recording: &Recording) -> Makeup {
    let offset = row.found.model.offset;
    let run = replay(&row.found.trocar(), recording, offset);
    let error: Vec<f64> =
        recording.force.iter().zip(&run.force).map(|(y, f)| y - offset - f).collect();
    let from = run.known.first().map_or(0, |known| known.start);
    let mean_square = |values: &mut dyn Iterator<Item = f64>| {
        let (sum, n) = values.fold((0.0, 0.0), |(sum, n), v| (sum + v * v, n + 1.0));
        sum / n
    };
    let white = 0.5 * mean_square(&mut error[from..].windows(2).map(|pair| pair[1] - pair[0]));
    let mut levels = vec![f64::NAN; error.len()];
    for stroke in strokes(recording, reversal_threshold(recording)) {
        let part = stroke.start.max(from)..stroke.end.max(from);
        let mean = error[part.clone()].iter().sum::<f64>() / part.len() as f64;
        levels[part].fill(mean);
    }
    let known = || (from..error.len()).filter(|i| levels[*i].is_finite());
    let level = mean_square(&mut known().map(|i| levels[i]));
    let about_level = mean_square(&mut known().map(|i| error[i] - levels[i]));
    Makeup {
        white: white.sqrt(),
        level: level.sqrt(),
        within: (about_level - white).max(0.0).sqrt(),
    }
}

/// By phase of the motion, and by what the error is made of.
fn print_rest(data: &Data, rows: &[&Row]) -> Result<(), Box<dyn Error>> {
    println!("\n### What is left\n");
    println!(
        "| fit | recording | rms, N | deforming, N | sliding, N | held, N | worst, N | noise, N | mean error of a stroke, N | within a stroke, N |"
    );
    println!("|{}", "---|".repeat(10));
    for row in rows {
        let seen = as_scored(&row.found, &data.validation)?;
        for (recording, scores) in seen.iter().zip(&row.scores.recordings) {
            println!("{}", rest(row, recording, scores));
        }
    }
    Ok(())
}

fn rest(row: &Row, recording: &Recording, scores: &RecordingValidation) -> String {
    let part = |part: &PhaseError| {
        if part.samples == 0 { "–".to_owned() } else { format!("{:.4}", part.rms_n) }
    };
    let phases = [&scores.by_phase.deformation, &scores.by_phase.sliding, &scores.by_phase.hold]
        .map(part)
        .join(" | ");
    let Makeup { white, level, within } = makeup(row, recording);
    format!(
        "| {} | {} | {:.4} | {phases} | {:.3} | {white:.4} | {level:.4} | {within:.4} |",
        row.what, scores.path, scores.rms_n, scores.worst_n
    )
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).ok_or("the folder of the recordings is missing")?;
    let data = load(&Path::new(&folder).join("seal_a"))?;
    println!("<!-- made by: cargo run --release -p trocar --example ablation -- FOLDER -->");
    let two_steps = IdentifyOptions { paper: true, ..without(Vec::new()) };
    let paper = Row::new(&data, "the paper's two steps", &two_steps)?;
    let bare =
        Row::new(&data, "the same element, fitted to all motion", &without(Term::ALL.to_vec()))?;
    let all = Row::new(&data, "all terms on trial", &without(Vec::new()))?;
    heading("From the paper's element to all terms");
    [&paper, &bare, &all].iter().for_each(|row| println!("{}", row.text()));
    println!(
        "\nFriction scales removed: error of the fit beside the friction scale that it gives each stroke; a dash: no fit, the paper's \
         two steps alone."
    );
    print_rest(&data, &[&paper, &bare, &all])?;
    print_alone(&data)?;
    print_left_out(&data, &all)
}
