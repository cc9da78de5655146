//! Draws from the posterior of an identification: calibration over benches with known truth, the
//! intervals beside those of identify, what the data leave open, and the file.

use std::collections::BTreeMap;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use trocar::identify::posterior::{Convergence, Posterior, models, read, weak_priors};
use trocar::identify::{Identification, IdentifyOptions, SealPrior, identify};
use trocar::model_file::{Interval, ModelFile, Origin, OriginKind};
use trocar::recording::Recording;
use trocar_model::{Branch, DeformationForce, Element, ElementParams, Friction, Piece, Quantity};

#[path = "../examples/calibration.rs"]
pub(crate) mod calibration;

use calibration::{Distribution, RANKED, Ranks, column, found, ranks, recordings, seal};

/// What is documented.
const DOCS: &str = include_str!("../../../docs/explanation/posterior.md");
/// Ranks of the benches of that page, as their command wrote them.
const KEPT: &str = include_str!("data/sbc_ranks.csv");
/// Where the ranks of the docs come from.
const COMMAND: &str = "cargo run --release -p trocar --example calibration";

/// Number of benches that are identified again: 20 with `./test --statistics`, or as many as
/// `TROCAR_STATISTICS` says where it is above 1.
fn benches() -> u64 {
    let Ok(text) = std::env::var("TROCAR_STATISTICS") else { return 4 };
    text.parse().ok().filter(|count| *count > 1).unwrap_or(20)
}

fn posterior(found: &Identification) -> &Posterior {
    found.posterior.as_ref().expect("there is a fit")
}

/// The ranks in the docs are those of the present program, on as many benches as time allows.
#[test]
fn ranks_of_the_truth_are_those_of_the_docs() {
    let kept = calibration::read(KEPT).unwrap();
    let all: Vec<Ranks> = (1..=benches()).into_par_iter().map(ranks).collect();
    for (k, name) in RANKED.into_iter().enumerate() {
        let Distribution { chi2, p, within } = Distribution::of(&all, k);
        println!("{name:24} chi2 {chi2:.1}, p {p:.4}; in the central 95 and 50 %: {within:.3?}");
        let off = |(now, kept): (&Ranks, &Ranks)| (now[k] - kept[k]).abs();
        let mean = all.iter().zip(&kept).map(off).sum::<f64>() / all.len() as f64;
        assert!(mean < 0.05, "{name}: ranks have moved by {mean:.3} on average: {COMMAND}");
    }
}

#[test]
fn draws_hold_the_truth_as_often_as_they_say() {
    let kept = calibration::read(KEPT).unwrap();
    assert!(DOCS.contains(&format!("of {} virtual benches", kept.len())), "{} benches", kept.len());
    let table = calibration::table(&kept);
    assert!(DOCS.contains(&table), "docs/explanation/posterior.md has not\n{table}");
    for (k, name) in RANKED.into_iter().enumerate() {
        let [most, _] = Distribution::of(&kept, k).within;
        // Two standard errors of a fraction of 0.95 below it.
        let least = 0.95 - 2.0 * (0.95 * 0.05 / kept.len() as f64).sqrt();
        assert!(most >= least, "{name}: {most}");
    }
    let drawings = trocar::report::vectors(&calibration::document(&kept)).unwrap();
    let [(id, drawn)] = &drawings[..] else { panic!("one figure") };
    let file = format!("../../docs/figures/{id}.svg");
    let shown =
        std::fs::read_to_string(std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(file));
    assert!(shown.is_ok_and(|shown| shown == *drawn), "docs/figures/{id}.svg: {COMMAND} -- draw");
}

#[test]
fn draws_agree_with_the_intervals_of_identify_and_with_their_file() {
    let found = found(&recordings(seal(1), 1), 2000, 1);
    let posterior = posterior(&found);
    println!("{}", posterior.in_words());
    for p in &posterior.parameters {
        let Some(own) = found.estimate(p.id) else { continue };
        let ratio = (p.ci95[1] - p.ci95[0]) / (own.ci95[1] - own.ci95[0]);
        println!("{:32} {:?} identify {:?} ratio {ratio:.2}", p.id.to_string(), p.ci95, own.ci95);
        if RANKED.contains(&p.id.to_string().as_str()) {
            // The end of the draws of a join may lie in another minimum.
            let is_join = matches!(p.id.quantity, Quantity::Join | Quantity::JoinForce);
            let most = if is_join { 2.0 } else { 1.6 };
            assert!((0.6..most).contains(&ratio), "{}: {:?} {:?}", p.id, p.ci95, own.ci95);
            assert!(p.ci95[0] < own.value && own.value < p.ci95[1], "{}", p.id);
        }
    }
    assert!(posterior.r_hat() <= 1.01 && posterior.ess() >= 400.0, "{}", posterior.in_words());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("posterior.parquet");
    posterior.write(&path).unwrap();
    let table = read(&path).unwrap();
    assert_eq!(table.rows(), 2000);
    let width = column(posterior, "half_width_m");
    let force = column(posterior, "coulomb_force_n");
    let damping = column(posterior, "viscous_damping_n_s_m");
    for (k, model) in models(&table).unwrap().iter().enumerate() {
        let [own] = model.elements() else { panic!("one element") };
        let params = own.params();
        assert!((params.deformation.half_width() / width[k] - 1.0).abs() < 1e-12);
        // In steady sliding at 60 mm/s the model has the force of its draw.
        let mut state = model.rest_at_force(0.0);
        let mut last = 0.0;
        for _ in 0..2000 {
            last = model.step(&mut state, 60e-6, 1e-3);
        }
        assert!((last - force[k] - 0.06 * damping[k]).abs() < 1e-6, "draw {k}");
    }
}

#[test]
fn the_same_seed_gives_the_same_draws_on_any_number_of_threads() {
    let recordings = recordings(seal(2), 2);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| found(&recordings, 400, 7).posterior.expect("there is a fit"))
    };
    let bits = |posterior: &Posterior| -> Vec<u64> {
        posterior.draws.iter().flat_map(|d| d.values.iter().map(|v| v.to_bits())).collect()
    };
    assert_eq!(bits(&with(1)), bits(&with(3)));
}

/// Full strokes at one speed, with noise.
fn strokes_at_one_speed(truth: ElementParams) -> Recording {
    const SPEED: f64 = 0.03;
    let element = Element::new(truth).expect("a plausible seal is a model");
    let mut state = element.rest_at_force(0.0);
    let (mut time, mut position, mut force) = (Vec::new(), Vec::new(), Vec::new());
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let (mut x, mut stroke_scale) = (0.0, 1.0);
    for i in 0..18_000 {
        if i % 1500 == 0 {
            stroke_scale = 1.0 + 0.02 * (rng.random::<f64>() - 0.5);
        }
        let step = if (i / 1500) % 2 == 0 { SPEED } else { -SPEED } * 2e-3;
        x += step;
        let seal = element.step(&mut state, step, 2e-3);
        time.push(2e-3 * f64::from(i));
        position.push(x);
        force.push(stroke_scale * seal + 0.05 * (rng.random::<f64>() - 0.5));
    }
    Recording::from_columns("one_speed", time, position, force).unwrap()
}

#[test]
fn draws_of_what_one_speed_leaves_open_are_named() {
    let found = found(&[strokes_at_one_speed(seal(2))], 400, 1);
    let damping = found.parameter("viscous_damping_n_s_m").expect("listed all the same");
    assert!(!damping.determined);
    let is_named = |w: &trocar::identify::Warning| {
        w.subject.to_string() == "posterior"
            && w.message.contains("viscous_damping_n_s_m")
            && w.message.contains("do not determine")
    };
    assert!(found.warnings.iter().any(is_named), "{:?}", found.warnings);
}

#[test]
fn priors_are_documented_as_they_are() {
    for [words, symbol, prior] in weak_priors() {
        let row = format!("| {words} | {symbol} | {prior} |");
        assert!(DOCS.contains(&row), "docs/explanation/posterior.md has no row\n{row}");
    }
}

#[test]
fn a_file_that_holds_no_draws_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("other.parquet");
    let field = trocar::table::Field::number("force_n");
    let mut writer = trocar::table::TableWriter::create(&path, &[field]).unwrap();
    writer.write(&[trocar::table::Column::Number(vec![1.0])]).unwrap();
    writer.commit().unwrap();
    let error = read(&path).unwrap_err().to_string();
    assert!(error.contains("no column chain") && error.contains("--posterior"), "{error}");
    assert!(read(&folder.path().join("none.parquet")).is_err());
}

/// Another seal of the type of `seal(3)`: its forces, half width and viscous damping are multiples.
#[derive(Debug, Clone, Copy)]
struct Other {
    force: f64,
    width: f64,
    damping: f64,
}

/// In use the seal is another one of its type, is wetted as published (forces and deflections at
/// 0.55 to 0.85, the rubber is as stiff as before), or is worn: looser and less stiff.
const STATES: [&str; 3] = ["another", "wetted", "worn"];

impl Other {
    fn draw(state: &str, rng: &mut ChaCha8Rng) -> Self {
        let mut between = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
        match state {
            "another" => Self {
                force: between(0.8, 1.25),
                width: between(0.85, 1.15),
                damping: between(0.7, 1.4),
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

    fn seal(self) -> ElementParams {
        let mut seal = seal(3);
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

/// The model of `seal(3)` with its intervals.
fn model_of_the_type() -> ModelFile {
    let first = found(&recordings(seal(3), 3), 400, 3);
    let mut model = ModelFile::new(first.stages, Origin::new(OriginKind::Identified));
    let interval = |p: &trocar::identify::Parameter| {
        let ci95 = p.estimate.ci95.map(|end| end.is_finite().then_some(end));
        (p.id.to_string(), Interval { value: p.estimate.value, ci95 })
    };
    model.intervals = first.parameters.iter().map(interval).collect();
    model
}

/// The first 20 s of the paper's steady experiment: strokes at one speed.
fn few_strokes(truth: ElementParams, seed: u64) -> Recording {
    let all = recordings(truth, seed).remove(0);
    let until = all.time.partition_point(|t| *t < 20.0);
    let part = |column: &[f64]| column[..until].to_vec();
    Recording::from_columns("few", part(&all.time), part(&all.position), part(&all.force)).unwrap()
}

/// Whether the intervals of F_c, β, c and the forces at the joins hold the truth, and the parameters
/// that the strokes did not inform.
fn updated(prior: &SealPrior, truth: ElementParams, seed: u64) -> ([bool; 5], Vec<String>) {
    let prior = Some(prior.clone());
    let options = IdentifyOptions { bootstrap: 0, prior, ..IdentifyOptions::default() };
    let found = identify(&[few_strokes(truth, seed)], &options, &|_, _| {}).unwrap();
    let branches = [truth.deformation.insertion(), truth.deformation.withdrawal()];
    let [insertion, withdrawal] = branches.map(|branch| branch.force(branch.join()));
    let holds = [
        ("coulomb_force_n", truth.insertion.coulomb_force),
        ("viscous_damping_n_s_m", truth.insertion.viscous_damping),
        ("half_width_m", truth.deformation.half_width()),
        ("insertion_join_force_n", insertion),
        ("withdrawal_join_force_n", withdrawal),
    ]
    .map(|(name, truth)| found.parameter(name).expect("it is listed").covers(truth));
    let used = found.prior.as_ref().expect("the prior was used");
    for name in used.uninformed() {
        let note = &found.parameter(name).expect("it is listed").note;
        assert!(note.as_ref().is_some_and(|note| note.contains("prior")), "{name}: {note:?}");
    }
    (holds, used.uninformed().into_iter().map(str::to_owned).collect())
}

/// A model as prior for a few strokes of another seal of its type, of a wetted and of a worn one: the
/// intervals hold the truth, and the viscous part, which strokes at one speed hardly show, is named on
/// some benches; the Coulomb force on none.
#[test]
fn a_few_strokes_update_a_model_for_another_a_wetted_and_a_worn_seal() {
    let prior = SealPrior::new(&model_of_the_type(), "model.json", SealPrior::SPREAD).unwrap();
    for state in STATES {
        let one = |seed: u64| {
            let other = Other::draw(state, &mut ChaCha8Rng::seed_from_u64(seed));
            updated(&prior, other.seal(), 40 + seed)
        };
        let all: Vec<_> = (1..=benches()).into_par_iter().map(one).collect();
        let share =
            |k: usize| all.iter().filter(|(holds, _)| holds[k]).count() as f64 / all.len() as f64;
        let shares: Vec<f64> = (0..5).map(share).collect();
        println!("{state}: F_c, beta, c, F(a+), F(a-) within their intervals: {shares:.2?}");
        let least = if all.len() < 20 { 0.5 } else { 0.8 };
        // F_c and c are too narrow after few strokes: the limits of docs/explanation/posterior.md.
        let least = [0.75, 1.0, 0.75, 1.0, 1.0].map(|part| part * least);
        assert!(shares.iter().zip(least).all(|(s, least)| *s >= least), "{state}: {shares:?}");
        let names = |name: &str| {
            all.iter().filter(|(_, open)| open.iter().any(|own| own == name)).count() as f64
        };
        let [damping, force] = ["viscous_damping_n_s_m", "coulomb_force_n"].map(names);
        println!("{state}: named as open: beta {damping}, F_c {force} of {}", all.len());
        assert!(damping >= 0.1 * all.len() as f64 && force == 0.0, "{state}: {damping} {force}");
    }
}

#[path = "../examples/posterior_density.rs"]
mod small;

/// Draws of one parameter by emcee (`reference/posterior_emcee.py`).
#[derive(serde::Deserialize)]
struct Sampled {
    mean: f64,
    standard_deviation: f64,
    quantiles: Vec<f64>,
    effective: f64,
}

#[derive(serde::Deserialize)]
struct Point {
    z: Vec<f64>,
    log_density: f64,
}

#[derive(serde::Deserialize)]
struct Emcee {
    parts: Vec<f64>,
    points: Vec<Point>,
    working: BTreeMap<String, Sampled>,
    adjusted: BTreeMap<String, Sampled>,
}

/// Standard errors that two samplers of one density may differ by: for 48 comparisons.
const FAR: f64 = 4.0;

/// Mean, standard deviation and quantiles of our draws, chain by chain, are those of emcee within the
/// error of both.
fn agrees(what: &str, chains: &[Vec<f64>], theirs: &Sampled, parts: &[f64]) {
    let ours = Convergence::of(chains).expect("it changes");
    let mut draws: Vec<f64> = chains.iter().flatten().copied().collect();
    draws.sort_by(f64::total_cmp);
    let n = draws.len() as f64;
    let mean = draws.iter().sum::<f64>() / n;
    let deviation = (draws.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
    let error = |effective: f64| (1.0 / effective + 1.0 / theirs.effective).sqrt();
    let sd = theirs.standard_deviation;
    println!(
        "{what}: mean off by {:.3} sd, sd ratio {:.3}, effective {:.0} and {:.0}",
        (mean - theirs.mean) / sd,
        deviation / sd,
        ours.ess_bulk,
        theirs.effective
    );
    assert!((mean - theirs.mean).abs() < FAR * sd * error(ours.ess_bulk), "{what}: {mean}");
    // Of a normal distribution the standard deviation has the relative error 1/sqrt(2·n).
    let of_sd = FAR * error(ours.ess_tail) / 2f64.sqrt();
    assert!((deviation / sd - 1.0).abs() < of_sd, "{what}: {deviation} {sd}");
    for (part, theirs_there) in parts.iter().zip(&theirs.quantiles) {
        let own = draws[(part * (n - 1.0)).round() as usize];
        // Error of a quantile: that of its probability over the density there.
        let there = ((own - mean) / sd).clamp(-2.0, 2.0);
        let height = (-0.5 * there * there).exp() / std::f64::consts::TAU.sqrt();
        let of_part = (part * (1.0 - part)).sqrt() / height * sd * error(ours.ess_tail);
        assert!((own - theirs_there).abs() < FAR * of_part, "{what}, {part}: {own} {theirs_there}");
    }
}

fn reference(name: &str) -> String {
    let path = format!("{}/../../reference/posterior/{name}", env!("CARGO_MANIFEST_DIR"));
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// The density, computed by another implementation at points, is ours; and so are the draws of another
/// sampler, before and after they get the covariance of the jackknife.
#[test]
fn draws_are_those_of_another_sampler_on_the_same_density() {
    let found = small::found(&small::recording(), 4000);
    let density = found.density.as_ref().expect("there is a fit");
    let kept: serde_json::Value = serde_json::from_str(&reference("density.json")).unwrap();
    let now: serde_json::Value = serde_json::to_value(density.data()).unwrap();
    let off = |(a, b): (&serde_json::Value, &serde_json::Value)| {
        let [a, b] = [a, b].map(|v| v["maximum"].as_f64().unwrap());
        (a - b).abs() / (a.abs() + 1e-6)
    };
    let of = |value: &serde_json::Value| value["parameters"].as_array().unwrap().clone();
    let moved = of(&kept).iter().zip(&of(&now)).map(off).fold(0.0, f64::max);
    assert!(moved < 1e-4, "the fit has moved by {moved}: ./reference/posterior_emcee --density");
    let theirs: Emcee = serde_json::from_str(&reference("emcee.json")).unwrap();
    for Point { z, log_density } in &theirs.points {
        let own = density.log_density(z);
        assert!((own - log_density).abs() < 0.05 + 2e-3 * own.abs(), "{own} {log_density}");
    }
    let sampled = density.sample(1000, (1, 0)).expect("it is finite at its maximum");
    assert_eq!(sampled.stuck, 0);
    let posterior = posterior(&found);
    assert_eq!(posterior.structures.len(), 1, "{:?}", posterior.structures);
    for quantity in small::COMPARED {
        let (id, name) = (quantity.id(), quantity.id().to_string());
        let of = |chain: &Vec<Vec<f64>>| -> Vec<f64> {
            chain.iter().map(|z| density.working_parameter(z, id)).collect()
        };
        let chains: Vec<Vec<f64>> = sampled.chains.iter().map(of).collect();
        agrees(&format!("{name}, working"), &chains, &theirs.working[&name], &theirs.parts);
        let draws = column(posterior, &name);
        let chains: Vec<Vec<f64>> = draws.chunks(draws.len() / 4).map(<[f64]>::to_vec).collect();
        agrees(&format!("{name}, adjusted"), &chains, &theirs.adjusted[&name], &theirs.parts);
    }
}
