//! How often an identification states something wrong with confidence: hard benches with known
//! truth.
//!
//! ```text
//! cargo run --release -p trocar --example trust -- [--seeds N] [--first N] [--kind NAME,...] [--coverage yes] [--json FILE] [--most-percent P]
//! ```
//! N seeds (default 3), from --first (default 1) on, of the kinds NAME, or of every kind whose name
//! contains NAME; with --coverage only the table of how often intervals hold the truth, and the
//! optional terms that were found where they are and where they are not; fails where more than P per
//! cent of the parameters are confidently wrong. A parameter is right if it is determined by the data
//! and its 95 % interval holds the truth; confidently wrong if the interval misses the truth and no
//! warning calls the result doubtful; absent if the seal has it and the result does not list it.

#[path = "../tests/trust/mod.rs"]
mod trust;

use std::collections::BTreeMap;

use trocar::identify::Term;
use trust::judge::{Judged, Outcome, Verdict, judge};
use trust::kinds::{AnyError, kinds};

struct Arguments {
    seeds: u64,
    first: u64,
    kinds: Vec<String>,
    coverage: bool,
    json: Option<String>,
    most_percent: f64,
}

fn arguments() -> Result<Arguments, AnyError> {
    let mut all = Arguments {
        seeds: 3,
        first: 1,
        kinds: Vec::new(),
        coverage: false,
        json: None,
        most_percent: 100.0,
    };
    let mut given = std::env::args().skip(1);
    while let Some(key) = given.next() {
        let value = given.next().ok_or_else(|| format!("{key} needs a value"))?;
        match key.as_str() {
            "--seeds" => all.seeds = value.parse()?,
            "--first" => all.first = value.parse()?,
            "--kind" => all.kinds = value.split(',').map(str::to_owned).collect(),
            "--coverage" => all.coverage = value == "yes",
            "--json" => all.json = Some(value),
            "--most-percent" => all.most_percent = value.parse()?,
            _ => {
                return Err(format!(
                    "unknown argument {key}, expected --seeds, --first, --kind, --coverage, --json or --most-percent"
                )
                .into());
            }
        }
    }
    Ok(all)
}

/// Counts in the order of [`Verdict::ALL`].
fn counts<'a>(judged: impl Iterator<Item = &'a Judged>) -> [usize; Verdict::ALL.len()] {
    let mut counts = [0; Verdict::ALL.len()];
    for j in judged {
        counts[j.verdict as usize] += 1;
    }
    counts
}

fn cells(counts: [usize; Verdict::ALL.len()]) -> String {
    counts.iter().map(|n| format!("| {n:5} ")).collect()
}

/// Names of the parameters with `verdict`, each with its count.
fn names<'a>(judged: impl Iterator<Item = &'a Judged>, verdict: Verdict) -> String {
    let mut all: BTreeMap<&str, usize> = BTreeMap::new();
    for j in judged.filter(|j| j.verdict == verdict) {
        *all.entry(&j.parameter).or_default() += 1;
    }
    all.iter().map(|(name, n)| format!("{name} {n}")).collect::<Vec<_>>().join(", ")
}

fn print_kinds(outcomes: &[Outcome]) {
    println!(
        "| kind | runs | refused | doubtful | right | wrong, confident | wrong, doubtful | undetermined | absent | s | confidently wrong |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|");
    for own in outcomes.chunk_by(|a, b| a.kind == b.kind) {
        let judged = || own.iter().flat_map(|o| &o.judged);
        let refused = own.iter().filter(|o| o.refused.is_some()).count();
        let doubtful = own.iter().filter(|o| !o.doubts.is_empty()).count();
        let seconds = own.iter().map(|o| o.seconds).sum::<f64>() / own.len() as f64;
        println!(
            "| {:27} | {} | {refused} | {doubtful} {}| {seconds:5.1} | {} |",
            own[0].kind,
            own.len(),
            cells(counts(judged())),
            names(judged(), Verdict::ConfidentlyWrong)
        );
    }
}

fn print_parameters(outcomes: &[Outcome]) {
    let mut by_name: BTreeMap<&str, Vec<&Judged>> = BTreeMap::new();
    for judged in outcomes.iter().flat_map(|o| &o.judged) {
        by_name.entry(&judged.parameter).or_default().push(judged);
    }
    println!("| parameter | right | wrong, confident | wrong, doubtful | undetermined | absent |");
    println!("|---|---|---|---|---|---|");
    for (name, judged) in by_name {
        println!("| {name:31} {}|", cells(counts(judged.into_iter())));
    }
}

/// How often the intervals of determined parameters hold the truth, doubtful results included.
fn print_coverage(outcomes: &[Outcome]) {
    let mut by_name: BTreeMap<&str, [usize; 3]> = BTreeMap::new();
    for judged in outcomes.iter().flat_map(|o| &o.judged).filter(|j| j.ci95.is_some()) {
        let counts = by_name.entry(&judged.parameter).or_default();
        match judged.verdict {
            Verdict::Right => counts[0] += 1,
            Verdict::Undetermined => counts[2] += 1,
            _ => counts[1] += 1,
        }
    }
    println!("| parameter | intervals | hold the truth, % | undetermined |");
    println!("|---|---|---|---|");
    for (name, [right, wrong, undetermined]) in by_name {
        let percent = 1e2 * right as f64 / (right + wrong).max(1) as f64;
        println!("| {name} | {} | {percent:.1} | {undetermined} |", right + wrong);
    }
    println!();
}

/// How often the optional terms were found, where the benches have them and where not.
fn print_terms(outcomes: &[Outcome]) {
    println!("| term | benches with it | found, % | benches without it | found, % |");
    println!("|---|---|---|---|---|");
    for term in Term::ALL {
        let share = |has: bool| {
            let own: Vec<&Outcome> = outcomes
                .iter()
                .filter(|o| o.refused.is_none() && o.true_terms.contains(&term) == has)
                .collect();
            let found = own.iter().filter(|o| o.found_terms.contains(&term)).count();
            let percent = 1e2 * found as f64 / own.len() as f64;
            if own.is_empty() { "0 | ".to_owned() } else { format!("{} | {percent:.1}", own.len()) }
        };
        println!("| {} | {} | {} |", term.words(), share(true), share(false));
    }
    println!();
}

/// Prints all counts; returns the percentage of parameters that are confidently wrong.
fn print_total(outcomes: &[Outcome]) -> f64 {
    let [right, confident, doubtful, undetermined, absent] =
        counts(outcomes.iter().flat_map(|o| &o.judged));
    let share = |n: usize, of: usize| 100.0 * n as f64 / of.max(1) as f64;
    let listed = right + confident + doubtful + undetermined;
    println!("{} identifications, {listed} parameters judged, {absent} absent", outcomes.len());
    println!(
        "right {right} ({:.1} %), confidently wrong {confident} ({:.1} %), wrong but doubtful {doubtful} ({:.1} %), undetermined \
         {undetermined} ({:.1} %)",
        share(right, listed),
        share(confident, listed),
        share(doubtful, listed),
        share(undetermined, listed)
    );
    let seconds: Vec<f64> = outcomes.iter().map(|o| o.seconds).collect();
    let most = seconds.iter().fold(0.0, |a: f64, b| a.max(*b));
    println!("{:.1} s per identification on average, {most:.1} s at most", mean(&seconds));
    share(confident, listed)
}

fn mean(seconds: &[f64]) -> f64 {
    seconds.iter().sum::<f64>() / seconds.len().max(1) as f64
}

fn main() -> Result<(), AnyError> {
    let arguments = arguments()?;
    let mut outcomes: Vec<Outcome> = Vec::new();
    let kinds = kinds();
    let is_name = |asked: &str| kinds.iter().any(|kind| kind.name == asked);
    let is_meant =
        |name: &str, asked: &str| if is_name(asked) { name == asked } else { name.contains(asked) };
    let asked_for = |name: &str| {
        arguments.kinds.is_empty() || arguments.kinds.iter().any(|k| is_meant(name, k))
    };
    for kind in kinds.iter().filter(|kind| asked_for(kind.name)) {
        for seed in arguments.first..arguments.first.saturating_add(arguments.seeds) {
            let bench = (kind.make)(seed)?;
            let outcome = judge(kind.name, &bench, seed)
                .map_err(|error| format!("{}: {error}", kind.name))?;
            eprintln!(
                "{} {seed}: {:.1} s, {} confidently wrong{}",
                kind.name,
                outcome.seconds,
                outcome.count(Verdict::ConfidentlyWrong),
                outcome.refused.as_ref().map_or(String::new(), |why| format!(", refused: {why}"))
            );
            outcomes.push(outcome);
        }
    }
    if let Some(path) = &arguments.json {
        std::fs::write(path, serde_json::to_string_pretty(&outcomes)?)?;
    }
    if arguments.coverage {
        print_coverage(&outcomes);
        print_terms(&outcomes);
    } else {
        print_kinds(&outcomes);
        println!();
        print_parameters(&outcomes);
        println!();
    }
    let percent = print_total(&outcomes);
    if percent > arguments.most_percent {
        return Err(format!(
            "{percent:.1} % confidently wrong, at most {} % expected",
            arguments.most_percent
        )
        .into());
    }
    Ok(())
}
