//! A model of one seal as prior for a few strokes of another one of its type: whether the intervals
//! hold the truth, and how wide they are beside those without the prior.
//!
//! ```text
//! cargo run --release -p trocar --example prior_in_use -- rows FIRST LAST >> ROWS.csv
//! cargo run --release -p trocar --example prior_in_use -- table ROWS.csv
//! ```
//! `rows` identifies the benches FIRST to LAST of each state, with the prior and without it, a row for
//! each parameter; `table` prints the table of the documentation.
//!
//! The priors are models of four seals in turn, each from the paper's steady and dynamic experiments.
//! In use the first 20 s of the steady experiment are recorded: two strokes and a half.

use std::error::Error;
use std::io::Write as _;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use trocar::identify::{Identification, IdentifyOptions, Parameter, SealPrior, identify};
use trocar::model_file::{Interval, ModelFile, Origin, OriginKind};
use trocar::recording::Recording;
use trocar_model::{Branch, DeformationForce, ElementParams, Piece};

#[path = "calibration.rs"]
pub(crate) mod calibration;

/// Seals of which a model is the prior.
const TYPES: u64 = 4;
/// Time that is recorded in use, s.
const RECORDED: f64 = 20.0;

/// In use the seal is the one of the model, is another one of its type, is tighter, is wetted as
/// published (forces and deflections at 0.55 to 0.85, the rubber is as stiff as before), or is worn:
/// looser and less stiff.
pub(crate) const STATES: [&str; 5] = ["same", "another", "tight", "wetted", "worn"];

/// What is compared with the truth.
pub(crate) const COMPARED: [&str; 5] = [
    "coulomb_force_n",
    "viscous_damping_n_s_m",
    "half_width_m",
    "insertion_join_force_n",
    "withdrawal_join_force_n",
];

/// Another seal: its forces, half width and viscous damping are multiples.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Other {
    pub(crate) force: f64,
    pub(crate) width: f64,
    pub(crate) damping: f64,
}

impl Other {
    pub(crate) fn draw(state: &str, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut between = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
        match state {
            "same" => Self { force: 1.0, width: 1.0, damping: 1.0 },
            "another" => Self {
                force: between(0.8, 1.25),
                width: between(0.85, 1.15),
                damping: between(0.7, 1.4),
            },
            "tight" => Self {
                force: between(1.1, 1.35),
                width: between(0.8, 1.0),
                damping: between(0.9, 1.4),
            },
            "wetted" => {
                let scale = between(0.55, 0.85);
                Self { force: scale, width: scale, damping: 1.0 }
            }
            _ => Self {
                force: between(0.65, 0.9),
                width: between(1.05, 1.25),
                damping: between(0.8, 1.3),
            },
        }
    }

    /// This seal of the type of `seal`.
    pub(crate) fn of(self, mut seal: ElementParams) -> ElementParams {
        for sliding in [&mut seal.insertion, &mut seal.withdrawal] {
            sliding.coulomb_force *= self.force;
            sliding.static_force *= self.force;
            sliding.viscous_damping *= self.damping;
        }
        let scaled = |branch: &Branch| {
            let piece = |p: &Piece| {
                let legendre: Vec<f64> = p.legendre().iter().map(|v| self.force * v).collect();
                Piece::new(self.width * p.from(), self.width * p.to(), &legendre).unwrap()
            };
            Branch::new(piece(branch.left()), piece(branch.right())).unwrap()
        };
        let branches = [seal.deformation.insertion(), seal.deformation.withdrawal()].map(scaled);
        seal.deformation = DeformationForce::new(branches[0], branches[1], None).unwrap();
        seal
    }
}

/// The model of a seal with its intervals.
pub(crate) fn model_of(seal: u64) -> ModelFile {
    let truth = calibration::seal(seal);
    let options = IdentifyOptions::default();
    let first = identify(&calibration::recordings(truth, seal), &options, &|_, _| {}).unwrap();
    let mut model = ModelFile::new(first.stages, Origin::new(OriginKind::Identified));
    let interval = |p: &Parameter| {
        let ci95 = p.estimate.ci95.map(|end| end.is_finite().then_some(end));
        (p.id.to_string(), Interval { value: p.estimate.value, ci95 })
    };
    model.intervals = first.parameters.iter().map(interval).collect();
    model
}

/// The first seconds of the paper's steady experiment.
pub(crate) fn few_strokes(truth: ElementParams, seed: u64) -> Recording {
    let all = calibration::recordings(truth, seed).remove(0);
    let until = all.time.partition_point(|t| *t < RECORDED);
    let part = |column: &[f64]| column[..until].to_vec();
    Recording::from_columns("few", part(&all.time), part(&all.position), part(&all.force)).unwrap()
}

/// The identification of few strokes of a seal.
pub(crate) fn updated(
    prior: Option<&SealPrior>,
    truth: ElementParams,
    seed: u64,
) -> Identification {
    let options = IdentifyOptions { prior: prior.cloned(), ..IdentifyOptions::default() };
    identify(&[few_strokes(truth, seed)], &options, &|_, _| {}).unwrap()
}

pub(crate) fn truths(seal: &ElementParams) -> [f64; 5] {
    let branches = [seal.deformation.insertion(), seal.deformation.withdrawal()];
    let [insertion, withdrawal] = branches.map(|branch| branch.force(branch.join()));
    let sliding = &seal.insertion;
    let c = seal.deformation.half_width();
    [sliding.coulomb_force, sliding.viscous_damping, c, insertion, withdrawal]
}

/// One parameter of one bench.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Row {
    pub(crate) state: &'static str,
    pub(crate) bench: u64,
    pub(crate) parameter: &'static str,
    pub(crate) truth: f64,
    pub(crate) value: f64,
    pub(crate) ci95: [f64; 2],
    /// Half width of the interval without the prior; infinite where there is none.
    pub(crate) without: f64,
}

impl Row {
    pub(crate) fn holds(&self) -> bool {
        self.ci95[0] <= self.truth && self.truth <= self.ci95[1]
    }

    pub(crate) fn half_width(&self) -> f64 {
        0.5 * (self.ci95[1] - self.ci95[0])
    }
}

/// The priors of all types.
pub(crate) fn priors() -> Vec<SealPrior> {
    let of = |seal: u64| SealPrior::new(&model_of(seal), "model.json", SealPrior::SPREAD).unwrap();
    (1..=TYPES).into_par_iter().map(of).collect()
}

/// The seal of a bench, with the prior of its type.
pub(crate) fn bench(priors: &[SealPrior], other: Other, bench: u64) -> (ElementParams, &SealPrior) {
    let of_type = bench % TYPES;
    (other.of(calibration::seal(of_type + 1)), &priors[of_type as usize])
}

/// The rows of one bench, and what its identification says about the prior.
pub(crate) fn rows_of(
    priors: &[SealPrior],
    state: &'static str,
    seed: u64,
) -> (Vec<Row>, Identification) {
    let (seal, prior) = bench(priors, Other::draw(state, seed), seed);
    let found = updated(Some(prior), seal, 40 + seed);
    let plain = updated(None, seal, 40 + seed);
    let row = |(parameter, truth): (&&'static str, f64)| {
        let own = &found.parameter(parameter).expect("it is listed");
        let without = plain.parameter(parameter).map_or(f64::INFINITY, |p| p.half_width());
        let (value, ci95) = (own.value, own.ci95);
        Row { state, bench: seed, parameter, truth, value, ci95, without }
    };
    (COMPARED.iter().zip(truths(&seal)).map(row).collect(), found)
}

#[allow(dead_code)] // the test takes what it calls
fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments.as_slice() {
        ["rows", first, last] => write_rows(first.parse()?, last.parse()?),
        ["table", rows] => {
            print!("{}", table(&read(&std::fs::read_to_string(rows)?)?));
            Ok(())
        }
        _ => Err("expected: rows FIRST LAST, or: table ROWS.csv".into()),
    }
}

fn write_rows(first: u64, last: u64) -> Result<(), Box<dyn Error>> {
    let priors = priors();
    let mut out = std::io::stdout().lock();
    if first == 1 {
        writeln!(out, "state,bench,parameter,truth,value,low,high,half_width_without")?;
    }
    for state in STATES {
        let of = |seed: u64| rows_of(&priors, state, seed).0;
        let all: Vec<Vec<Row>> = (first..=last).into_par_iter().map(of).collect();
        for row in all.iter().flatten() {
            let Row { state, bench, parameter, truth, value, ci95: [low, high], without } = row;
            writeln!(
                out,
                "{state},{bench},{parameter},{truth:.5e},{value:.5e},{low:.5e},{high:.5e},{without:.5e}"
            )?;
        }
        out.flush()?;
    }
    Ok(())
}

/// The rows that `rows` wrote.
///
/// # Errors
/// A row of another form.
pub(crate) fn read(text: &str) -> Result<Vec<Row>, Box<dyn Error>> {
    let row = |line: &str| -> Result<Row, Box<dyn Error>> {
        let wrong = || format!("a row of another form: {line}");
        let cells: Vec<&str> = line.split(',').collect();
        let [state, bench, parameter, numbers @ ..] = cells.as_slice() else {
            return Err(wrong().into());
        };
        let numbers: Vec<f64> = numbers.iter().map(|v| v.parse()).collect::<Result<_, _>>()?;
        let [truth, value, low, high, without] = numbers[..] else { return Err(wrong().into()) };
        let one_of =
            |all: &[&'static str], name: &str| all.iter().copied().find(|own| *own == name);
        Ok(Row {
            state: one_of(&STATES, state).ok_or_else(wrong)?,
            bench: bench.parse()?,
            parameter: one_of(&COMPARED, parameter).ok_or_else(wrong)?,
            truth,
            value,
            ci95: [low, high],
            without,
        })
    };
    text.lines().skip(1).map(row).collect()
}

/// The rows of one parameter in one state.
pub(crate) fn group<'a>(all: &'a [Row], state: &str, parameter: &str) -> Vec<&'a Row> {
    all.iter().filter(|row| row.state == state && row.parameter == parameter).collect()
}

/// Fraction of rows whose interval holds the truth.
pub(crate) fn held(rows: &[&Row]) -> f64 {
    rows.iter().filter(|row| row.holds()).count() as f64 / rows.len() as f64
}

/// Median half width relative to the truth.
fn median(rows: &[&Row], half_width: impl Fn(&Row) -> f64) -> f64 {
    let mut all: Vec<f64> = rows.iter().map(|row| half_width(row) / row.truth.abs()).collect();
    all.sort_by(f64::total_cmp);
    all[all.len() / 2]
}

/// Coverage and median half widths as a table of Markdown.
pub(crate) fn table(all: &[Row]) -> String {
    let head = "| seal in use | F_c | β | c | F(a) inserting | F(a) withdrawing |\n|---|---|---|---|---|---|\n";
    let cell = |state: &str, parameter: &str| {
        let rows = group(all, state, parameter);
        let own = 1e2 * median(&rows, Row::half_width);
        format!(" {:.0} %: ±{own:.1} % |", 1e2 * held(&rows))
    };
    let row = |state: &&str| {
        let cells: String = COMPARED.iter().map(|parameter| cell(state, parameter)).collect();
        format!("| {state} |{cells}\n")
    };
    STATES.iter().map(row).fold(head.to_owned(), |text, row| text + &row)
}
