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

/// Number of benches of the calibration: 20 with `./test --statistics`, or as many as
/// `TROCAR_STATISTICS` says where it is above 1.
fn benches() -> u64 {
    let Ok(text) = std::env::var("TROCAR_STATISTICS") else { return 4 };
    text.parse().ok().filter(|count| *count > 1).unwrap_or(20)
}

fn seal(seed: u64) -> ElementParams {
    random_seal(&PlausibleSeals { friction_asymmetry: 0.0, ..PlausibleSeals::default() }, seed)
}

fn recordings(truth: ElementParams, seed: u64) -> Vec<Recording> {
    let element = [Element::new(truth).expect("a plausible seal is a model")];
    let record = |p: Protocol| {
        let done = run(&BenchConfig::default(), p, &element, seed).expect("the rig runs");
        done.to_recording(p.name()).expect("finite columns")
    };
    [Protocol::Steady, Protocol::Dynamic].map(record).into()
}

fn found(recordings: &[Recording], draws: usize, seed: u64) -> Identification {
    let options = IdentifyOptions {
        bootstrap: 0,
        seed,
        free_motion: false,
        posterior: Some(Draws::new(draws).expect("a multiple of 4")),
        ..IdentifyOptions::default()
    };
    identify(recordings, &options, &|_, _| {}).expect("there is steady sliding")
}

fn posterior(found: &Identification) -> &Posterior {
    found.posterior.as_ref().expect("there is a fit")
}

/// The draws of a parameter, SI.
fn column(posterior: &Posterior, name: &str) -> Vec<f64> {
    let at = posterior.parameters.iter().position(|p| p.id.to_string() == name);
    let at = at.unwrap_or_else(|| panic!("{name} is a column"));
    posterior.draws.iter().map(|draw| draw.values[at]).collect()
}

/// Fraction of the draws below the true value.
fn rank(draws: &[f64], truth: f64) -> f64 {
    draws.iter().filter(|draw| **draw < truth).count() as f64 / draws.len() as f64
}

const RANKED: [&str; 4] =
    ["coulomb_force_n", "viscous_damping_n_s_m", "half_width_m", "force at 60 mm/s"];

/// Ranks of the true values among the draws (SBC).
fn ranks(seed: u64) -> [f64; 4] {
    let truth = seal(seed);
    let found = found(&recordings(truth, seed), 400, seed);
    let posterior = posterior(&found);
    let [force, damping, width] =
        [RANKED[0], RANKED[1], RANKED[2]].map(|name| column(posterior, name));
    let sliding: Vec<f64> = force.iter().zip(&damping).map(|(f, b)| f + 0.06 * b).collect();
    let sliding_truth = truth.insertion.coulomb_force + 0.06 * truth.insertion.viscous_damping;
    [
        rank(&force, truth.insertion.coulomb_force),
        rank(&damping, truth.insertion.viscous_damping),
        rank(&width, truth.deformation.half_width()),
        rank(&sliding, sliding_truth),
    ]
}

#[test]
fn draws_hold_the_truth_as_often_as_they_say() {
    let all: Vec<[f64; 4]> = (1..=benches()).into_par_iter().map(ranks).collect();
    let n = all.len() as f64;
    for (k, name) in RANKED.into_iter().enumerate() {
        let mut counts = [0usize; 10];
        for rank in all.iter().map(|ranks| ranks[k]) {
            counts[((10.0 * rank) as usize).min(9)] += 1;
        }
        let chi2: f64 =
            counts.iter().map(|count| (*count as f64 - n / 10.0).powi(2) / (n / 10.0)).sum();
        let within = |outside: f64| {
            all.iter().filter(|r| r[k] >= outside && r[k] <= 1.0 - outside).count() as f64 / n
        };
        println!(
            "{name:24} ranks in tenths {counts:?}, chi2 {chi2:.1}; in the central 95 % {:.3}, 50 % {:.3}",
            within(0.025),
            within(0.25)
        );
        // What fewer benches show with certainty.
        let least = match n {
            100.0.. => 0.92,
            20.0.. => 0.8,
            _ => 0.5,
        };
        assert!(within(0.025) >= least, "{name}: {counts:?}");
    }
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
