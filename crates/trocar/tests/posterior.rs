//! Draws from the posterior of an identification: calibration over benches with known truth, the
//! intervals beside those of identify, what the data leave open, and the file.

use std::collections::BTreeMap;

use crate::benches::benches;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use trocar::draws::{models, read, table, write};
use trocar::identify::Identification;
use trocar::identify::posterior::{Convergence, Posterior, weak_priors};
use trocar::recording::Recording;
use trocar_model::{Element, ElementParams, Friction, Quantity};

pub(crate) use self::in_use::calibration;
use calibration::{Distribution, RANKED, Ranks, column, found, ranks, recordings, seal};

/// What is documented.
const DOCS: &str = include_str!("../../../docs/explanation/posterior.md");
/// Ranks of the benches of that page, as their command wrote them.
const KEPT: &str = include_str!("data/sbc_ranks.csv");
/// Where the ranks of the docs come from.
const COMMAND: &str = "cargo run --release -p trocar --example calibration";

fn posterior(found: &Identification) -> &Posterior {
    found.posterior.as_ref().expect("there is a fit")
}

/// The ranks in the docs are those of the present program, on as many benches as time allows.
#[test]
fn ranks_of_the_truth_are_those_of_the_docs() {
    let kept = calibration::read(KEPT).unwrap();
    let all: Vec<Ranks> = (1..=benches(4, 8)).into_par_iter().map(ranks).collect();
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
        let Distribution { p, within: [most, _], .. } = Distribution::of(&kept, k);
        // 95 %, less two standard errors of as many benches.
        let least = 0.95 - 2.0 * (0.95 * 0.05 / kept.len() as f64).sqrt();
        assert!(most >= least, "{name}: {most}");
        let is_of_prior = name.contains("join_m");
        assert!(is_of_prior || p > 0.001, "{name}: p {p}");
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
    let found = found(&recordings(seal(1), 1), 3000, 1);
    let posterior = posterior(&found);
    println!("{}", posterior.in_words());
    for p in &posterior.parameters {
        let Some(own) = found.estimate(p.id) else { continue };
        let ratio = (p.ci95[1] - p.ci95[0]) / (own.ci95[1] - own.ci95[0]);
        println!("{:32} {:?} identify {:?} ratio {ratio:.2}", p.id.to_string(), p.ci95, own.ci95);
        if RANKED.contains(&p.id.to_string().as_str()) {
            // The end of the draws of a join, or of its interval, may lie in another minimum.
            let is_join = matches!(p.id.quantity, Quantity::Join | Quantity::JoinForce);
            let near = if is_join { 0.4..2.0 } else { 0.6..1.6 };
            assert!(near.contains(&ratio), "{}: {:?} {:?}", p.id, p.ci95, own.ci95);
            assert!(p.ci95[0] < own.value && own.value < p.ci95[1], "{}", p.id);
        }
    }
    assert!(posterior.r_hat() <= 1.01 && posterior.ess() >= 400.0, "{}", posterior.in_words());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("posterior.parquet");
    write(&table(posterior), &path).unwrap();
    let table = read(&path).unwrap();
    assert_eq!(table.rows(), 3000);
    let width = column(posterior, "half_width_m");
    let force = column(posterior, "coulomb_force_n");
    let damping = column(posterior, "viscous_damping_n_s_m");
    for (k, model) in models(&table).unwrap().iter().enumerate() {
        assert_eq!(*model, posterior.draws[k].model);
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
    assert!(
        error.contains("no column chain") && error.contains("‹identify(posterior=N)›"),
        "{error}"
    );
    assert!(read(&folder.path().join("none.parquet")).is_err());
}

#[path = "../examples/prior_in_use.rs"]
mod in_use;

use in_use::{COMPARED, Other, Row, STATES};

/// Rows of the docs, as their command wrote them.
const IN_USE: &str = include_str!("data/prior_in_use.csv");

/// Intervals of a few strokes with a model as prior hold the truth as often as they say, and without
/// the prior there are none: the table in the docs.
#[test]
fn a_few_strokes_with_a_prior_hold_the_truth_as_often_as_they_say() {
    let kept = in_use::read(IN_USE).unwrap();
    let table = in_use::table(&kept);
    assert!(DOCS.contains(&table), "docs/explanation/posterior.md has not\n{table}");
    for state in STATES {
        for parameter in COMPARED {
            let rows = in_use::group(&kept, state, parameter);
            assert_eq!(rows.len(), 20, "{state}, {parameter}");
            let held = in_use::held(&rows);
            assert!(held >= 0.85, "{state}, {parameter}: {held}");
        }
    }
    assert!(kept.iter().all(|row| row.without.is_infinite()));
    // Over all states, within two standard errors of the promise: the benches share their noise.
    for parameter in ["coulomb_force_n", "viscous_damping_n_s_m", "half_width_m"] {
        let rows: Vec<&Row> = kept.iter().filter(|row| row.parameter == parameter).collect();
        assert!(in_use::held(&rows) >= 0.95 - 2.0 * (0.95 * 0.05 / 20.0f64).sqrt(), "{parameter}");
    }
}

/// The rows in the docs are those of the present program, on as many benches as time allows.
#[test]
fn a_few_strokes_update_a_model_for_another_a_wetted_and_a_worn_seal() {
    let (kept, priors) = (in_use::read(IN_USE).unwrap(), in_use::priors());
    let again = |state: &'static str| {
        let all = (1..=benches(4, 8).min(20)).into_par_iter();
        all.flat_map_iter(|bench| {
            let (rows, found) = in_use::rows_of(&priors, state, bench);
            let used = found.prior.as_ref().expect("the prior was used");
            assert_eq!(used.contradiction, None, "{state}, {bench}");
            assert!(!used.uninformed().contains(&"coulomb_force_n"), "{state}, {bench}");
            for name in used.uninformed() {
                let note = &found.parameter(name).expect("it is listed").note;
                assert!(
                    note.as_ref().is_some_and(|note| note.contains("prior")),
                    "{name}: {note:?}"
                );
            }
            rows
        })
        .collect::<Vec<Row>>()
    };
    let all: Vec<Row> = STATES.into_iter().flat_map(again).collect();
    let moved = |row: &Row| {
        let same =
            |k: &&Row| (k.state, k.bench, k.parameter) == (row.state, row.bench, row.parameter);
        let kept = kept.iter().find(same).expect("it is kept");
        (row.value - kept.value).abs() / kept.half_width()
    };
    let mean = all.iter().map(moved).sum::<f64>() / all.len() as f64;
    println!("{} rows have moved by {mean:.4} half widths on average", all.len());
    let command = "cargo run --release -p trocar --example prior_in_use -- rows 1 20";
    assert!(mean < 0.05, "rows have moved by {mean:.3} half widths: {command}");
}

/// A seal far from the prior is named with its parameter and has no interval, or a wide one that
/// holds the truth.
#[test]
fn a_seal_that_contradicts_the_prior_is_named_and_has_no_narrow_interval() {
    let priors = in_use::priors();
    let far = [(3.0, 1.0), (0.2, 1.0), (1.0, 3.0), (2.5, 0.3), (1.0, 0.3)];
    for (bench, (force, width)) in (1..).zip(far) {
        let other = Other { force, width, damping: 1.0 };
        let (seal, prior) = in_use::bench(&priors, other, bench);
        let found = in_use::updated(Some(prior), seal, bench);
        let used = found.prior.as_ref().expect("the prior was used");
        let truths = COMPARED.into_iter().zip(in_use::truths(&seal));
        let Some(contradiction) = &used.contradiction else {
            let holds = |(name, truth): (&str, f64)| found.parameter(name).unwrap().covers(truth);
            assert!(truths.into_iter().all(holds), "{force} {width}: {:?}", found.parameters);
            continue;
        };
        println!("{force} {width}: {}: {}", contradiction.parameter, contradiction.in_words());
        let [low, high] = contradiction.prior_range;
        assert!(contradiction.estimate < low || contradiction.estimate > high);
        let expected = if force == 1.0 { Quantity::HalfWidth } else { Quantity::CoulombForce };
        assert_eq!(contradiction.parameter, expected.id(), "{force} {width}");
        let is_named = |w: &trocar::identify::Warning| {
            w.doubtful && w.message.contains("contradict") && w.message.contains("‹prior_spread›")
        };
        assert!(found.warnings.iter().any(is_named), "{:?}", found.warnings);
        for (name, _) in truths {
            assert!(!found.parameter(name).expect("it is listed").determined, "{name}");
        }
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
