//! Whether posterior draws hold the truth as often as they say (simulation-based calibration, key
//! SBC in SOURCES.md): ranks of the true values of virtual benches among the draws.
//!
//! ```text
//! cargo run --release -p trocar --example calibration -- ranks FIRST LAST >> RANKS.csv
//! cargo run --release -p trocar --example calibration -- draw RANKS.csv [FOLDER]
//! ```
//! `ranks` identifies the benches FIRST to LAST, a row each; `draw` prints the table of the
//! documentation of the ranks in RANKS.csv, and writes the drawing to `FOLDER/figures/sbc.svg`.
//!
//! Each bench has a random seal, the paper's steady and dynamic experiments, and the default noise.
//! The rank of a true value is the fraction of the draws below it: uniform from 0 to 1 where the
//! draws are calibrated and the truths come from the prior. The joins of random seals do not: draws
//! whose joins no random seal has are left out, so that the rest come from a prior that agrees.

use std::error::Error;
use std::io::Write as _;
use std::ops::Range;
use std::path::Path;

use rayon::prelude::*;
use statrs::distribution::{ChiSquared, ContinuousCDF};
use trocar::bench::{BenchConfig, PlausibleSeals, Protocol, random_seal, run};
use trocar::identify::posterior::{Draws, Posterior};
use trocar::identify::{Identification, IdentifyOptions, identify};
use trocar::recording::Recording;
use trocar::report::{Axis, Document, Figure, Panel, Role, Section, Series, write_document};
use trocar_model::{Branch, Element, ElementParams};

/// What is ranked, in the order of the columns.
pub(crate) const RANKED: [&str; 8] = [
    "coulomb_force_n",
    "viscous_damping_n_s_m",
    "half_width_m",
    "force_at_60_mm_s_n",
    "insertion_join_m",
    "withdrawal_join_m",
    "insertion_join_force_n",
    "withdrawal_join_force_n",
];
/// Draws of each bench.
const DRAWS: usize = 400;
/// Ranks are counted in this many classes of equal width.
const CLASSES: usize = 10;
/// Benches that are identified before their rows are written.
const TOGETHER: usize = 8;
/// Distance of the joins of random seals from the middle of the branch, as a fraction of the half
/// width: before it on insertion, beyond it on withdrawal.
const JOINS: Range<f64> = 0.09..0.5;
/// Speed of the force in sliding, m/s.
const SPEED: f64 = 0.06;

/// Ranks of one bench in the order of [`RANKED`].
pub(crate) type Ranks = [f64; RANKED.len()];

#[allow(dead_code)] // the test takes what it calls
fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments.as_slice() {
        ["ranks", first, last] => write_ranks(first.parse()?, last.parse()?),
        ["draw", ranks, folder @ ..] => {
            let all = read(&std::fs::read_to_string(ranks)?)?;
            if let [folder] = folder {
                write_document(Path::new(folder), &document(&all))?;
            }
            print!("{}", table(&all));
            Ok(())
        }
        _ => Err("expected: ranks FIRST LAST, or: draw RANKS.csv [FOLDER]".into()),
    }
}

fn write_ranks(first: u64, last: u64) -> Result<(), Box<dyn Error>> {
    let seeds: Vec<u64> = (first..=last).collect();
    let mut out = std::io::stdout().lock();
    if first == 1 {
        writeln!(out, "bench,{}", RANKED.join(","))?;
    }
    for seeds in seeds.chunks(TOGETHER) {
        let all: Vec<Ranks> = seeds.par_iter().map(|seed| ranks(*seed)).collect();
        for (seed, ranks) in seeds.iter().zip(all) {
            let cells: Vec<String> = ranks.iter().map(|rank| format!("{rank:.4}")).collect();
            writeln!(out, "{seed},{}", cells.join(","))?;
        }
        out.flush()?;
    }
    Ok(())
}

/// The rows that `ranks` wrote: benches 1, 2, 3, ...
///
/// # Errors
/// A row of another form.
pub(crate) fn read(text: &str) -> Result<Vec<Ranks>, Box<dyn Error>> {
    let row = |(k, line): (usize, &str)| {
        let numbers: Vec<f64> = line.split(',').map(str::parse).collect::<Result<_, _>>()?;
        match numbers.split_first() {
            Some((bench, ranks)) if *bench == (k + 1) as f64 => {
                Ranks::try_from(ranks).map_err(|_| format!("row {}: columns", k + 1).into())
            }
            _ => Err(format!("row {}: expected bench {}, got {line}", k + 1, k + 1).into()),
        }
    };
    text.lines().skip(1).enumerate().map(row).collect()
}

/// A random seal, alike in both directions.
pub(crate) fn seal(seed: u64) -> ElementParams {
    random_seal(&PlausibleSeals { friction_asymmetry: 0.0, ..PlausibleSeals::default() }, seed)
}

/// The steady and the dynamic experiment with it.
pub(crate) fn recordings(truth: ElementParams, seed: u64) -> Vec<Recording> {
    let element = [Element::new(truth).expect("a plausible seal is a model")];
    let record = |p: Protocol| {
        let done = run(&BenchConfig::default(), p, &element, seed).expect("the rig runs");
        done.to_recording(p.name()).expect("finite columns")
    };
    [Protocol::Steady, Protocol::Dynamic].map(record).into()
}

pub(crate) fn found(recordings: &[Recording], draws: usize, seed: u64) -> Identification {
    let options = IdentifyOptions {
        seed,
        free_motion: false,
        posterior: Some(Draws::new(draws).expect("a multiple of 4")),
        ..IdentifyOptions::default()
    };
    identify(recordings, &options, &|_, _| {}).expect("there is steady sliding")
}

/// The draws of a parameter, SI.
pub(crate) fn column(posterior: &Posterior, name: &str) -> Vec<f64> {
    let at = posterior.parameters.iter().position(|p| p.id.to_string() == name);
    let at = at.unwrap_or_else(|| panic!("{name} is a column"));
    posterior.draws.iter().map(|draw| draw.values[at]).collect()
}

/// Ranks of the true values of bench `seed`.
pub(crate) fn ranks(seed: u64) -> Ranks {
    let truth = seal(seed);
    let found = found(&recordings(truth, seed), DRAWS, seed);
    let posterior = found.posterior.as_ref().expect("there is a fit");
    let truths = truths(&truth);
    let [force, damping, width, insertion, withdrawal] =
        [RANKED[0], RANKED[1], RANKED[2], RANKED[4], RANKED[5]].map(|name| column(posterior, name));
    let in_use = |k: &usize| {
        [-insertion[*k], withdrawal[*k]].iter().all(|join| JOINS.contains(&(join / width[*k])))
    };
    let kept: Vec<usize> = (0..width.len()).filter(in_use).collect();
    assert!(!kept.is_empty(), "bench {seed}: no draw has joins of a random seal");
    std::array::from_fn(|k| {
        let draws: Vec<f64> = match RANKED[k] {
            "force_at_60_mm_s_n" => {
                force.iter().zip(&damping).map(|(f, b)| f + SPEED * b).collect()
            }
            name => column(posterior, name),
        };
        kept.iter().filter(|draw| draws[**draw] < truths[k]).count() as f64 / kept.len() as f64
    })
}

fn truths(seal: &ElementParams) -> Ranks {
    let sliding = &seal.insertion;
    let deformation = &seal.deformation;
    let branches = [deformation.insertion(), deformation.withdrawal()];
    let joins = branches.map(Branch::join);
    let forces = branches.map(|branch| branch.force(branch.join()));
    [
        sliding.coulomb_force,
        sliding.viscous_damping,
        deformation.half_width(),
        sliding.coulomb_force + SPEED * sliding.viscous_damping,
        joins[0],
        joins[1],
        forces[0],
        forces[1],
    ]
}

/// How the ranks of one parameter are distributed.
pub(crate) struct Distribution {
    /// χ² of the counts in tenths, and the probability of as much with uniform ranks.
    pub(crate) chi2: f64,
    pub(crate) p: f64,
    /// Fraction of the benches whose truth is in the central 95 % and 50 % of the draws.
    pub(crate) within: [f64; 2],
}

impl Distribution {
    /// Of the parameter `k`.
    pub(crate) fn of(all: &[Ranks], k: usize) -> Self {
        let n = all.len() as f64;
        let mut counts = [0usize; CLASSES];
        for ranks in all {
            counts[((CLASSES as f64 * ranks[k]) as usize).min(CLASSES - 1)] += 1;
        }
        let expected = n / CLASSES as f64;
        let chi2 = counts.iter().map(|c| (*c as f64 - expected).powi(2) / expected).sum();
        let distribution = ChiSquared::new(CLASSES as f64 - 1.0).expect("degrees above 0");
        let within = |outside: f64| {
            all.iter().filter(|r| r[k] >= outside && r[k] <= 1.0 - outside).count() as f64 / n
        };
        Self { chi2, p: 1.0 - distribution.cdf(chi2), within: [within(0.025), within(0.25)] }
    }
}

/// The distributions as a table of Markdown.
pub(crate) fn table(all: &[Ranks]) -> String {
    let head = "| truth | χ² of the ranks in tenths | p | in the central 95 % | 50 % |\n|---|---|---|---|---|\n";
    let row = |(k, name): (usize, &&str)| {
        let Distribution { chi2, p, within: [most, half] } = Distribution::of(all, k);
        let p = if p < 1e-4 { "below 0.0001".to_owned() } else { format!("{p:.4}") };
        format!("| `{name}` | {chi2:.1} | {p} | {:.1} % | {:.1} % |\n", 1e2 * most, 1e2 * half)
    };
    RANKED.iter().enumerate().map(row).fold(head.to_owned(), |text, row| text + &row)
}

/// The drawing of the ranks.
pub(crate) fn document(all: &[Ranks]) -> Document {
    let caption = format!(
        "Distribution of the ranks of true values among the draws of {} benches, less the uniform one. Shaded: \
         where 95 % of calibrated draws stay everywhere (Kolmogorov and Smirnov). Falling through the middle: draws too wide.",
        all.len()
    );
    let figure = Figure::new("sbc", 1, "Ranks of the truth among the draws").caption(caption);
    let panels = [("sliding and half width", 0..4), ("branches", 4..8)];
    let panel = |(title, own): (&str, std::ops::Range<usize>)| {
        let limit = 1.358 / (all.len() as f64).sqrt();
        let x = Axis::new("fraction of the draws below the truth", "");
        let panel = Panel::new(x, Axis::new("excess of benches", "")).title(title).aspect(0.95);
        let ends = [vec![-limit; 2], vec![limit; 2]];
        let [low, high] = ends;
        let band = Series::band("calibrated", Role::Reference, vec![0.0, 1.0], low, high);
        (0..).zip(own).fold(panel.series(band), |panel, (colour, k)| {
            let (x, y) = excess(all, k);
            panel.series(Series::line(RANKED[k], Role::Category(colour), x, y))
        })
    };
    let figure = panels.into_iter().map(panel).fold(figure.columns(2), Figure::panel);
    let section = Section::new("Calibration").figure(figure);
    Document { title: "Calibration".into(), sections: vec![section], ..Document::default() }
}

/// Distribution function of the ranks of the parameter `k` less that of uniform ones.
fn excess(all: &[Ranks], k: usize) -> (Vec<f64>, Vec<f64>) {
    let mut own: Vec<f64> = all.iter().map(|ranks| ranks[k]).collect();
    own.sort_by(f64::total_cmp);
    let n = own.len() as f64;
    let (mut x, mut y) = (vec![0.0], vec![0.0]);
    for (below, rank) in own.iter().enumerate() {
        x.extend([*rank; 2]);
        y.extend([below as f64 / n - rank, (below + 1) as f64 / n - rank]);
    }
    x.push(1.0);
    y.push(0.0);
    (x, y)
}
