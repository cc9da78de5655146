//! Draws from the posterior of an identification: calibration over benches with known truth, the
//! intervals beside those of identify, what the data leave open, and the file.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use trocar::bench::{BenchConfig, PlausibleSeals, Protocol, random_seal, run};
use trocar::identify::posterior::{Draws, Posterior, models, read, weak_priors};
use trocar::identify::{Identification, IdentifyOptions, SealPrior, identify};
use trocar::model_file::{Interval, ModelFile, Origin, OriginKind};
use trocar::recording::Recording;
use trocar_model::{Branch, DeformationForce, Element, ElementParams, Friction, Piece};

#[path = "../examples/calibration.rs"]
mod calibration;

use calibration::{Distribution, RANKED, Ranks, column, found, ranks, recordings, seal};

/// Ranks of the benches of docs/posterior.md, as their command wrote them.
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
    assert!(kept.len() >= 500, "{} benches", kept.len());
    let table = calibration::table(&kept);
    assert!(DOCS.contains(&table), "docs/posterior.md has not\n{table}");
    for (k, name) in RANKED.into_iter().enumerate() {
        let [most, _] = Distribution::of(&kept, k).within;
        assert!(most >= 0.93, "{name}: {most}");
    }
    let [(id, drawn)] =
        trocar::report::vectors(&calibration::document(&kept)).unwrap()[..].to_owned()
    else {
        panic!("one figure")
    };
    let file = format!("../../docs/figures/{id}.svg");
    let shown =
        std::fs::read_to_string(std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(file));
    assert!(shown.is_ok_and(|shown| shown == drawn), "docs/figures/{id}.svg: {COMMAND} -- draw");
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
            assert!((0.6..1.6).contains(&ratio), "{}: {:?} {:?}", p.id, p.ci95, own.ci95);
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
    let docs = include_str!("../../../docs/explanation/posterior.md");
    for [words, symbol, prior] in weak_priors() {
        let row = format!("| {words} | {symbol} | {prior} |");
        assert!(docs.contains(&row), "docs/explanation/posterior.md has no row\n{row}");
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

/// A model of the type, and a few strokes of another seal of it: drier, wider.
fn in_use(strokes_s: f64) -> (ModelFile, ElementParams, Recording) {
    let first = found(&recordings(seal(3), 3), 400, 3);
    let mut model = ModelFile::new(first.stages, Origin::new(OriginKind::Identified));
    let interval = |p: &trocar::identify::Parameter| {
        let ci95 = p.estimate.ci95.map(|end| end.is_finite().then_some(end));
        (p.id.to_string(), Interval { value: p.estimate.value, ci95 })
    };
    model.intervals = first.parameters.iter().map(interval).collect();
    let mut truth = seal(3);
    for sliding in [&mut truth.insertion, &mut truth.withdrawal] {
        sliding.coulomb_force *= 0.75;
        sliding.static_force *= 0.75;
        sliding.viscous_damping *= 0.75;
    }
    let scaled = |branch: &Branch| {
        let piece = |p: &Piece| {
            let legendre: Vec<f64> = p.legendre().iter().map(|value| 0.75 * value).collect();
            Piece::new(p.from(), p.to(), &legendre)
        };
        Branch::new(piece(branch.left()).unwrap(), piece(branch.right()).unwrap()).unwrap()
    };
    let deformation = &truth.deformation;
    truth.deformation = DeformationForce::new(
        scaled(deformation.insertion()),
        scaled(deformation.withdrawal()),
        None,
    )
    .unwrap();
    let all = recordings(truth, 4).remove(0);
    let until = all.time.partition_point(|t| *t < strokes_s);
    let part = |column: &[f64]| column[..until].to_vec();
    let few =
        Recording::from_columns("few", part(&all.time), part(&all.position), part(&all.force));
    (model, truth, few.unwrap())
}

#[test]
fn a_few_strokes_update_the_model_of_another_seal_of_the_type() {
    let (model, truth, few) = in_use(20.0);
    let prior = SealPrior::new(&model, "model.json", SealPrior::SPREAD).unwrap();
    let options =
        IdentifyOptions { bootstrap: 0, prior: Some(prior), ..IdentifyOptions::default() };
    let found = identify(&[few], &options, &|_, _| {}).unwrap();
    let used = found.prior.as_ref().expect("the prior was used");
    println!("{}", used.in_words());
    for (name, ratio) in &used.ratios {
        println!("{name:32} {ratio:.3} {:?}", found.parameter(name).map(|e| (e.value, e.ci95)));
    }
    let force = found.parameter("coulomb_force_n").unwrap();
    assert!(force.covers(truth.insertion.coulomb_force), "{force:?}");
    // 20 s hold one speed: the viscous part stays that of the prior, and is named.
    assert_eq!(used.uninformed(), ["viscous_damping_n_s_m"]);
    let damping = found.parameter("viscous_damping_n_s_m").unwrap();
    assert!(damping.determined && damping.covers(truth.insertion.viscous_damping), "{damping:?}");
    assert!(damping.note.as_ref().is_some_and(|note| note.contains("prior")), "{damping:?}");
    let width = found.parameter("half_width_m").unwrap();
    assert!(width.covers(truth.deformation.half_width()), "{width:?}");
}
