//! `trocar ranges`

use std::fmt::Write as _;

use serde::Serialize;
use trocar::bench::PlausibleSeals;
use trocar::bench::published::{self, Printed, PublishedError, Quantity, Study};

use crate::Completion;
use crate::console::{self, BadArgument};
use crate::table::Table;

/// List what the literature prints about trocar friction
///
/// Each study has a key; `trocar bench --like KEY` draws seals whose friction lies within its range. With a key, prints all its numbers, how they were read, and
/// what is drawn.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Study to print [default: a table of all]
    key: Option<String>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// A study with what is drawn from it.
#[derive(Serialize)]
struct Listed {
    #[serde(flatten)]
    study: &'static Study,
    drawn: Option<Drawn>,
}

/// Ranges of drawn seals; only the Coulomb force is from the study.
#[derive(Serialize)]
struct Drawn {
    coulomb_force_n: [f64; 2],
    viscous_damping_n_s_m: [f64; 2],
    half_width_m: [f64; 2],
}

impl Listed {
    fn new(study: &'static Study) -> Self {
        Self {
            study,
            drawn: study.seals().ok().map(|seals| Drawn {
                coulomb_force_n: study.friction_force().unwrap_or(seals.coulomb_force.into()),
                viscous_damping_n_s_m: seals.viscous_damping.into(),
                half_width_m: seals.half_width.into(),
            }),
        }
    }
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Completion> {
    match (&args.key, args.json) {
        (None, false) => console::print(&table(published::studies()))?,
        (None, true) => {
            let all: Vec<Listed> = published::studies().iter().map(Listed::new).collect();
            console::print_json(&all)?;
        }
        (Some(key), false) => console::print(&details(study(key)?))?,
        (Some(key), true) => console::print_json(&Listed::new(study(key)?))?,
    }
    Ok(Completion::Clean)
}

fn study(key: &str) -> Result<&'static Study, BadArgument> {
    published::study(key).map_err(bad)
}

/// Ranges of the seals of `key`, for verbs that draw one.
pub(crate) fn seals_like(key: &str) -> Result<PlausibleSeals, BadArgument> {
    study(key)?.seals().map_err(bad)
}

fn bad(error: PublishedError) -> BadArgument {
    BadArgument(error.to_string())
}

fn table(studies: &[Study]) -> String {
    let mut table = Table::headed(["key", "trocar", "force N", "conditions", "read", "source"]);
    for study in studies {
        let conditions = study
            .numbers
            .iter()
            .filter(|number| number.quantity == Quantity::FrictionForceN)
            .map(|number| number.conditions.as_str());
        table.row([
            study.key.clone(),
            study.trocar.clone(),
            study.friction_force().map_or("not printed".to_owned(), span),
            conditions.collect::<Vec<_>>().join("; "),
            study.read().to_owned(),
            study.source.clone(),
        ]);
    }
    table.to_text()
}

fn span([from, to]: [f64; 2]) -> String {
    if from == to { format!("{from}") } else { format!("{from} to {to}") }
}

fn details(study: &Study) -> String {
    let mut text = String::new();
    let mut line = |name: &str, words: &str| {
        let _ = writeln!(text, "  {name:<25} {words}");
    };
    line("trocar", &study.trocar);
    if let Some(seal) = &study.seal {
        line("seal", seal);
    }
    line("instrument", &study.instrument);
    line("source", &format!("{} in SOURCES.md, read: {}", study.source, study.read()));
    for number in &study.numbers {
        let (name, unit) = number.quantity.words();
        let about = if number.about { "about " } else { "" };
        let Printed { range, conditions, .. } = number;
        line(name, &format!("{about}{} {unit}: {conditions}", span(*range)));
    }
    study.notes.iter().for_each(|note| line("note", note));
    match study.seals() {
        Ok(seals) => drawn(&mut line, study, &seals),
        Err(_) => line("drawn seals", "none, as no friction force is printed"),
    }
    text
}

fn drawn(line: &mut impl FnMut(&str, &str), study: &Study, seals: &PlausibleSeals) {
    let force = study.friction_force().map(span).unwrap_or_default();
    line("drawn seals", &format!("F_c {force} N in both directions, without the viscous part"));
    let (beta, c) = (seals.viscous_damping, seals.half_width);
    line(
        "not from the source",
        &format!(
            "β {} N s/m, c {} mm, shape of the branches: made up",
            span(beta.into()),
            span([1e3 * c.0, 1e3 * c.1])
        ),
    );
}
