//! Known true parameters: accuracy and interval coverage of identify over many seeded benches with
//! random plausible seals, and its messages when the recordings do not determine a parameter.

use crate::benches::benches;
use rayon::prelude::*;
use trocar::bench::config::Fluctuation;
use trocar::bench::{BenchConfig, PlausibleSeals, Protocol, random_seal, run};
use trocar::compare::{Choice, CompareOptions, compare};
use trocar::identify::{
    Estimate, Identification, IdentifyError, IdentifyOptions, Kept, KeptParameter, Parameter, Term,
    identify,
};
use trocar::recording::Recording;
use trocar_model::{
    Direction, Element, ElementParams, Friction, ParameterId, Quantity, Seal, Tunable,
};

/// Benches, and the coverage that two standard errors of as many allow; one more above, since
/// intervals span terms that are left out.
fn benches_and_coverage() -> (u64, std::ops::RangeInclusive<f64>) {
    let count = benches(40, 100);
    (count, if count > 40 { 0.92..=0.99 } else { 0.87..=1.0 })
}

/// Name, true value and estimate of the parameters known to a bench.
type Known = [(&'static str, f64, Estimate); 7];

/// Seals with equal friction in both directions, so that F_c and β each have one true value.
fn seal(seed: u64) -> ElementParams {
    random_seal(&PlausibleSeals { friction_asymmetry: 0.0, ..PlausibleSeals::default() }, seed)
}

fn recordings(truth: ElementParams, protocols: &[Protocol], seed: u64) -> Vec<Recording> {
    recordings_of(&BenchConfig::default(), truth, protocols, seed)
}

fn recordings_of(
    config: &BenchConfig,
    truth: ElementParams,
    protocols: &[Protocol],
    seed: u64,
) -> Vec<Recording> {
    let element = [Element::new(truth).expect("a plausible seal is a model")];
    let record = |p: &Protocol| {
        run(config, *p, &element, seed).expect("the rig runs").to_recording(p.name())
    };
    protocols.iter().map(|p| record(p).expect("finite columns")).collect()
}

/// The seal of `seed`, and what is found from the paper's experiments with it.
fn found_on(config: &BenchConfig, seed: u64) -> (ElementParams, Identification) {
    let truth = seal(seed);
    (
        truth,
        found(&recordings_of(config, truth, &[Protocol::Steady, Protocol::Dynamic], seed), seed),
    )
}

fn found(recordings: &[Recording], seed: u64) -> Identification {
    let options = IdentifyOptions { seed, free_motion: false, ..IdentifyOptions::default() };
    identify(recordings, &options, &|_, _| {}).expect("there is steady sliding")
}

fn known(truth: &ElementParams, found: &Identification) -> Known {
    let estimate = |name: &str| {
        found.parameter(name).unwrap_or_else(|| panic!("{name} is a parameter")).clone()
    };
    let joint = |name: &'static str| {
        let id = ParameterId::named(name).expect("a parameter");
        let value = truth.value(id.direction, id.quantity).expect("every branch has it");
        (name, value, estimate(name))
    };
    [
        ("coulomb_force_n", truth.insertion.coulomb_force, estimate("coulomb_force_n")),
        (
            "viscous_damping_n_s_m",
            truth.insertion.viscous_damping,
            estimate("viscous_damping_n_s_m"),
        ),
        ("half_width_m", truth.deformation.half_width(), estimate("half_width_m")),
        joint("insertion_join_m"),
        joint("withdrawal_join_m"),
        joint("insertion_join_force_n"),
        joint("withdrawal_join_force_n"),
    ]
}

/// Error of the sliding force at 60 mm/s, in the standard errors that the covariance gives it.
fn error_of_sliding_force(truth: &ElementParams, found: &Identification) -> f64 {
    let covariance = found.covariance.as_ref().expect("there is a fit");
    let weight = |name: &String| match name.as_str() {
        "coulomb_force_n" => 1.0,
        "viscous_damping_n_s_m" => 0.06,
        _ => 0.0,
    };
    let weights: Vec<f64> = covariance.parameters.iter().map(weight).collect();
    let dot = |row: &Vec<f64>| {
        row.iter().zip(&weights).map(|(entry, weight)| entry * weight).sum::<f64>()
    };
    let variance: f64 =
        covariance.rows.iter().zip(&weights).map(|(row, weight)| weight * dot(row)).sum();
    let [force, damping, ..] =
        known(truth, found).map(|(_, truth, estimate)| estimate.value - truth);
    (force + 0.06 * damping) / variance.sqrt()
}

#[test]
fn intervals_cover_the_truth_as_often_as_they_say() {
    let outcome = |seed: u64| {
        let truth = seal(seed);
        let found = found(&recordings(truth, &[Protocol::Steady, Protocol::Dynamic], seed), seed);
        (known(&truth, &found), error_of_sliding_force(&truth, &found).abs())
    };
    let (benches, band) = benches_and_coverage();
    let (outcomes, errors): (Vec<Known>, Vec<f64>) =
        (1..=benches).into_par_iter().map(outcome).unzip();
    // Of a sum only the covariance tells the error: within 2.2 standard errors in 19 of 20 benches.
    let within =
        |limit: f64| errors.iter().filter(|error| **error < limit).count() as f64 / benches as f64;
    println!(
        "sliding force: {:.3} within 2.2 standard errors, {:.3} within 0.3",
        within(2.2),
        within(0.3)
    );
    assert!(within(2.2) >= *band.start() && within(0.3) < 0.5, "{errors:?}");
    let mut outside = Vec::new();
    for k in 0..outcomes[0].len() {
        let name = outcomes[0][k].0;
        let covered =
            outcomes.iter().filter(|o| o[k].2.covers(o[k].1)).count() as f64 / benches as f64;
        let mut errors: Vec<f64> =
            outcomes.iter().map(|o| (o[k].2.value / o[k].1 - 1.0).abs()).collect();
        errors.sort_by(f64::total_cmp);
        let (median, most) = (errors[errors.len() / 2], errors[errors.len() * 19 / 20]);
        println!(
            "{name:24} coverage {covered:.3} of {benches}, error {:.2} % (median), below {:.2} % in 19 of 20",
            1e2 * median,
            1e2 * most
        );
        // The interval of a join spans all minima of the likelihood along it: it is never too narrow.
        let spans_minima = name.contains("join") && covered > *band.end();
        if !band.contains(&covered) && !spans_minima {
            outside.push((name, covered));
        }
    }
    assert!(outside.is_empty(), "coverage outside {band:?}: {outside:?}");
}

/// A bench without scatter, and with little noise.
fn quiet() -> BenchConfig {
    let mut config = BenchConfig::default();
    config.fluctuation =
        Fluctuation { stroke_fraction: 0.0, ripple_fraction: 0.0, ..config.fluctuation };
    config.force_sensor.noise_n = 1e-3;
    config
}

/// Small accelerations where a seal begins to slide repeat with every stroke. Lost in the noise of
/// the positions, they biased the Coulomb force of weak seals by 1 mN and their half width by 3 µm,
/// a third of a standard deviation of usual strokes.
#[test]
fn an_unmodelled_mass_does_not_bias_friction_and_half_width() {
    let config = quiet();
    let errors = |seed: u64| {
        let (truth, found) = found_on(&config, seed);
        let found = found.model;
        [
            found.insertion.coulomb_force - truth.insertion.coulomb_force,
            found.half_width - truth.deformation.half_width(),
        ]
    };
    let weak = [12, 18, 20, 24];
    let all: Vec<[f64; 2]> = weak.into_par_iter().map(errors).collect();
    let mean = |k: usize| all.iter().map(|error| error[k]).sum::<f64>() / all.len() as f64;
    println!("mean error: F_c {:.2} mN, c {:.2} µm", 1e3 * mean(0), 1e6 * mean(1));
    assert!(mean(0).abs() < 3e-4 && mean(1).abs() < 1e-6, "{all:?}");
}

/// The same from too few strokes for scales of their own: it was 0.13 mN.
#[test]
fn an_unmodelled_mass_does_not_bias_the_friction_of_few_strokes() {
    let mut config = quiet();
    let steady = &mut config.protocol.steady;
    (steady.slowest_m_s, steady.fastest_m_s, steady.increment_m_s) = (0.03, 0.15, 0.03);
    steady.cycles_per_speed = 1;
    let error = |seed: u64| {
        let truth = seal(seed);
        let found = found(&recordings_of(&config, truth, &[Protocol::Steady], seed), seed);
        found.model.insertion.coulomb_force - truth.insertion.coulomb_force
    };
    let all: Vec<f64> = [12, 18, 20].into_par_iter().map(error).collect();
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    println!("mean error: {:.3} mN", 1e3 * mean);
    assert!(mean.abs() < 8e-5, "{all:?}");
}

/// A mass whose inertia is comparable to the friction is subtracted well enough for the intervals
/// to hold; beyond that the result is doubtful. Blurred accelerations made F_c of the third seal
/// 2.7 standard errors too large.
#[test]
fn a_heavy_unmodelled_mass_is_subtracted_or_named() {
    let with = |mass: f64, seed: u64| {
        let mut config = BenchConfig::default();
        config.rod.mass_kg = mass;
        let (truth, found) = found_on(&config, seed);
        let doubted = found.warnings.iter().any(|w| w.doubtful && w.message.contains("inertia of"));
        let main = known(&truth, &found).into_iter().take(3);
        let held = main.filter(|(_, value, estimate)| estimate.covers(*value)).count();
        let mass = found.parameter("unmodelled_mass_kg").expect("it moves").value;
        (doubted, held, mass)
    };
    assert!(with(1.0, 12).0);
    let benches = benches(12, 48);
    let one = |seed: u64| {
        let found = with(0.3, seed);
        if [9, 12, 21].contains(&seed) {
            assert!(!found.0 && found.1 == 3, "{seed}: {found:?}");
        }
        found
    };
    one(21);
    let all: Vec<_> = (1..=benches).into_par_iter().map(one).collect();
    let held = all.iter().map(|one| one.1).sum::<usize>() as f64 / (3.0 * benches as f64);
    let mean = all.iter().map(|one| one.2).sum::<f64>() / benches as f64;
    println!("0.3 kg: {held:.3} of F_c, beta and c held, {mean:.4} kg found");
    assert!(held > 0.9 && (mean / 0.3 - 1.0).abs() < 0.01, "{held} {mean}");
}

/// Rigs turn at the same places, so that the readings of a coarse encoder err alike at all
/// reversals of a speed. Between them, speeds of no or one step in a short time made the damping too
/// small by 10 standard errors.
#[test]
fn a_coarse_encoder_does_not_bias_half_width_and_damping() {
    const STEP: f64 = 1e-4;
    let benches = benches(8, 60);
    let mut config = BenchConfig::default();
    config.encoder.resolution_m = STEP;
    let outcome = |seed: u64| {
        let (truth, found) = found_on(&config, seed);
        let [_, damping, half_width, ..] = known(&truth, &found);
        [damping, half_width].map(|(_, value, found)| (found.value - value, found.covers(value)))
    };
    let all: Vec<[(f64, bool); 2]> = (1..=benches).into_par_iter().map(outcome).collect();
    let n = benches as f64;
    for (k, name, most) in [(0, "viscous damping", 0.1), (1, "half width", 0.1 * STEP)] {
        let mean = all.iter().map(|both| both[k].0).sum::<f64>() / n;
        let covered = all.iter().filter(|both| both[k].1).count();
        println!("{name}: mean error {mean:.2e}, {covered} of {benches} intervals hold it");
        assert!(mean.abs() < most && covered as f64 >= 0.87 * n, "{name} {mean} {covered}");
    }
}

#[test]
fn the_branches_are_recovered_between_their_ends() {
    let truth = seal(3);
    let found = found(&recordings(truth, &[Protocol::Steady, Protocol::Dynamic], 3), 3);
    let c = truth.deformation.half_width();
    for k in -18..=18 {
        let z = c * f64::from(k) / 20.0;
        let (want, got) = (&truth.deformation, &found.element().params().deformation);
        for (name, want, got) in [
            ("insertion", want.insertion().force(z), got.insertion().force(z)),
            ("withdrawal", want.withdrawal().force(z), got.withdrawal().force(z)),
        ] {
            // The force of the bench's seal varies by 1 % from stroke to stroke.
            let tolerance = 0.03 * truth.insertion.coulomb_force;
            assert!(
                (want - got).abs() < tolerance,
                "{name} at {:.2} mm: {want:.3} against {got:.3} N",
                1e3 * z
            );
        }
    }
}

/// The plausible seal with other numbers, whose instrument moves at once, stops at once and rests.
fn resting(half_width_m: f64, rest_s: f64) -> Recording {
    const INTERVAL_S: f64 = 1e-3;
    let plausible = Seal::from(Element::new(ElementParams::plausible_10_5_mm().unwrap()).unwrap());
    let number = |t: Tunable| match t.id.quantity {
        Quantity::HalfWidth => half_width_m,
        Quantity::CoulombForce => 4.0,
        Quantity::ViscousDamping => 40.0,
        _ => t.value,
    };
    let seal = plausible.tuned(&plausible.tunables().map(number).collect::<Vec<_>>()).unwrap();
    let (mut position, mut force) = (vec![0.0], vec![0.0]);
    let mut state = seal.rest_at_force(0.0);
    let mut go = |displacement: f64, samples: usize| {
        for _ in 0..samples {
            position.push(position.last().unwrap() + displacement);
            force.push(seal.step(&mut state, displacement, INTERVAL_S));
        }
    };
    for speed in [0.02, 0.005, 0.04, 0.01].repeat(2) {
        for way in [1.0, -1.0] {
            go(way * speed * INTERVAL_S, (0.04 / speed / INTERVAL_S).round() as usize);
            go(0.0, (rest_s / INTERVAL_S).round() as usize);
        }
    }
    let time = (0..force.len()).map(|k| k as f64 * INTERVAL_S).collect();
    Recording::from_columns("rests", time, position, force).unwrap()
}

/// The force of a viscous seal settles with a time of its own, some milliseconds, after a sudden
/// change of the velocity: with forces averaged across it, β came out a quarter too small.
#[test]
fn a_motion_that_stops_at_once_does_not_bias_a_viscous_seal() {
    for (half_width_m, rest_s) in [(6e-4, 0.01), (6e-4, 0.1), (6e-4, 0.3), (3e-3, 1.0)] {
        let found = found(&[resting(half_width_m, rest_s)], 1);
        let expected = [
            ("coulomb_force_n", 4.0),
            ("viscous_damping_n_s_m", 40.0),
            ("half_width_m", half_width_m),
        ];
        for (name, truth) in expected {
            let ratio = found.parameter(name).unwrap().value / truth;
            assert!((ratio - 1.0).abs() < 1e-3, "{name} with rests of {rest_s} s: {ratio}");
        }
    }
}

/// Slow strokes stick and slip, whose mean force is no sliding force, and at every reversal the seal
/// lets go at a force that a fit from below never sees.
#[test]
fn strokes_that_stick_and_slip_do_not_hide_the_static_force() {
    let benches = 48;
    let errors = |seed: u64| {
        let mut truth = seal(seed);
        for sliding in [&mut truth.insertion, &mut truth.withdrawal] {
            sliding.coulomb_force /= 1.2;
            sliding.stribeck_velocity = 9e-3;
        }
        let found = found(&recordings(truth, &[Protocol::Steady, Protocol::Dynamic], seed), seed);
        if seed <= 4 {
            let swings = found.stick_slip.as_ref().expect("slow strokes swing");
            assert!(swings.speed_m_s[1] < 0.06, "{swings:?}");
        }
        let off = |name: &str, truth: f64| found.parameter(name).unwrap().value / truth - 1.0;
        [
            off("static_force_n", truth.insertion.static_force),
            off("coulomb_force_n", truth.insertion.coulomb_force),
            off("half_width_m", truth.deformation.half_width()),
        ]
    };
    let all: Vec<[f64; 3]> = (1..=benches).into_par_iter().map(errors).collect();
    for (k, name, most) in [(0, "F_s", 0.05), (1, "F_c", 0.03), (2, "c", 0.06)] {
        let within = all.iter().filter(|one| one[k].abs() < most).count() as f64;
        let rms = (all.iter().map(|one| one[k].powi(2)).sum::<f64>() / benches as f64).sqrt();
        println!("{name}: {within} of {benches} within {most}, {rms:.4} rms");
        assert!(all.iter().take(4).all(|one| one[k].abs() < most), "{name} {all:?}");
        assert!(within >= 0.93 * benches as f64 && rms < 0.5 * most, "{name} {within} {rms}");
    }
}

#[test]
fn the_rod_nobody_declared_is_found() {
    let truth = seal(1);
    let found = found(&recordings(truth, &[Protocol::Steady, Protocol::Dynamic], 1), 1);
    let mass = found.parameter("unmodelled_mass_kg").expect("its inertia is in the readings");
    let declared = BenchConfig::default().rod.mass_kg;
    assert!(
        (mass.value / declared - 1.0).abs() < 0.15,
        "{} kg instead of {declared} kg",
        mass.value
    );
}

#[test]
fn one_speed_leaves_the_viscous_part_open() {
    let truth = seal(2);
    let all = recordings(truth, &[Protocol::Steady], 2).remove(0);
    // The first cycle: one speed in each direction.
    let until = all.time.partition_point(|t| *t < 17.0);
    let part = |column: &[f64]| column[..until].to_vec();
    let one = Recording::from_columns(
        "one_speed",
        part(&all.time),
        part(&all.position),
        part(&all.force),
    )
    .unwrap();
    let found = found(&[one], 2);
    for name in ["viscous_damping_n_s_m", "coulomb_force_n"] {
        let estimate = found.parameter(name).expect("listed all the same");
        assert!(
            !estimate.determined && estimate.half_width().is_infinite(),
            "{name}: {estimate:?}"
        );
    }
    assert!(found.is_doubtful());
}

#[test]
fn one_direction_leaves_offset_and_deformation_open() {
    let truth = seal(4);
    let all = recordings(truth, &[Protocol::Steady], 4).remove(0);
    let until = all.position.iter().position(|x| *x > 0.12).expect("the stroke is longer");
    let part = |column: &[f64]| column[..until].to_vec();
    let one =
        Recording::from_columns("one_way", part(&all.time), part(&all.position), part(&all.force))
            .unwrap();
    let found = found(&[one], 4);
    assert!(found.deformation.is_err());
    for name in ["offset_n", "coulomb_force_n", "half_width_m"] {
        assert!(!found.parameter(name).expect("listed all the same").determined, "{name}");
    }
}

#[test]
fn uneven_sampling_changes_little() {
    let truth = seal(5);
    let full = recordings(truth, &[Protocol::Steady, Protocol::Dynamic], 5);
    let thinned: Vec<Recording> = full
        .iter()
        .map(|r| {
            // Every third and every seventh sample removed: intervals of 1 to 3 ms.
            let keep = |i: &usize| !(i.is_multiple_of(3) || i.is_multiple_of(7));
            let part = |column: &[f64]| {
                (0..column.len()).filter(keep).map(|i| column[i]).collect::<Vec<f64>>()
            };
            Recording::from_columns(
                r.name.clone(),
                part(&r.time),
                part(&r.position),
                part(&r.force),
            )
            .unwrap()
        })
        .collect();
    let found = found(&thinned, 5);
    for (name, truth, estimate) in known(&truth, &found) {
        let error = (estimate.value - truth).abs();
        assert!(
            error < 2.0 * estimate.half_width(),
            "{name}: {} instead of {truth}",
            estimate.value
        );
    }
}

/// The true value of what a fit may report; `offset` (N) is that of the sensor.
fn true_value(id: ParameterId, truth: &ElementParams, offset: f64) -> Option<f64> {
    match (id.quantity, id.direction) {
        (Quantity::Offset, _) => Some(offset),
        (Quantity::CoulombForceWithOffset, Some(direction)) => {
            Some(truth.sliding(direction).coulomb_force + direction.sign() * offset)
        }
        _ => truth.value(id.direction, id.quantity),
    }
}

/// Friction that differs by direction, in few samples and coarse forces: under one name, the fit,
/// the paper's two steps and the plain least squares of `compare` report the same quantity, the
/// true one.
#[test]
fn a_name_means_the_same_in_every_fit() {
    // Its joins are plain to see.
    let mut truth = ElementParams::plausible_10_5_mm().unwrap();
    truth.insertion.viscous_damping *= 1.5;
    let mut config = BenchConfig::default();
    (config.rig.sample_rate_hz, config.force_sensor.resolution_n) = (200.0, 0.02);
    config.force_sensor.tare_n = 0.7;
    config.rod.mass_kg = 0.0;
    for speeds in [&mut config.protocol.steady, &mut config.protocol.validation] {
        (speeds.slowest_m_s, speeds.fastest_m_s, speeds.increment_m_s, speeds.stroke_m) =
            (0.01, 0.07, 0.02, 0.06);
    }
    let element = [Element::new(truth).unwrap()];
    let record = |protocol: Protocol| {
        run(&config, protocol, &element, 5)
            .unwrap()
            .to_recording(format!("{protocol}.csv"))
            .unwrap()
    };
    let offset = config.force_sensor.tare_n
        + std::f64::consts::PI * (0.5 * config.rod.diameter_m).powi(2) * config.rod.gas_pressure_pa;
    let options = CompareOptions {
        models: vec![Choice::Ems, Choice::EmsOutputError],
        identify: IdentifyOptions::default(),
        timing: false,
    };
    let training = [record(Protocol::Steady), record(Protocol::Dynamic)];
    let compared =
        compare(&training, &[record(Protocol::Validation)], &options, &|_, _| {}).unwrap();
    let fitted = compared.entries.iter().map(|entry| (entry.name, entry.estimates.as_slice()));
    let fits: Vec<(&str, &[Parameter])> =
        fitted.chain([("two steps", compared.ems.two_step_parameters.as_slice())]).collect();
    let truth_width = truth.deformation.half_width();
    let scale = |id: ParameterId, truth: f64| match id.quantity {
        // Joins are the least certain; of the two branches they lie on either side of 0.
        Quantity::Join => 2.0 * truth_width,
        Quantity::JoinForce | Quantity::Offset => element[0].params().insertion.coulomb_force,
        _ => truth.abs(),
    };
    let mut seen = std::collections::BTreeMap::<ParameterId, usize>::new();
    let all = fits.iter().flat_map(|(name, fit)| fit.iter().map(move |p| (*name, p)));
    for (name, p) in all.filter(|(_, p)| p.estimate.determined && !p.is_coefficient()) {
        let Some(value) = true_value(p.id, &truth, offset) else { continue };
        // So few samples of the deformation show the two steps other joins.
        if name == "two steps" && matches!(p.id.quantity, Quantity::Join | Quantity::JoinForce) {
            continue;
        }
        *seen.entry(p.id).or_default() += 1;
        let error = (p.estimate.value - value).abs() / scale(p.id, value).max(1e-9);
        assert!(
            error < 0.12 || p.estimate.covers(value),
            "{name}: {}: {:?}, true {value}",
            p.id,
            p.estimate
        );
    }
    let everywhere = [Quantity::CoulombForce.id(), Quantity::HalfWidth.id()];
    assert!(everywhere.iter().all(|id| seen.get(id) == Some(&3)), "{seen:?}");
    let by_direction = |quantity: Quantity| Direction::BOTH.map(|direction| quantity.of(direction));
    let mut by_direction =
        [Quantity::ViscousDamping, Quantity::Join].into_iter().flat_map(by_direction);
    assert!(by_direction.all(|id| seen.get(&id).is_some_and(|count| *count > 1)), "{seen:?}");
}

/// Options that keep parameters, each as NAME=VALUE or NAME=LOW..HIGH.
fn keeping(all: &[&str]) -> IdentifyOptions {
    let each = all.iter().map(|text| text.parse()).collect::<Result<Vec<KeptParameter>, _>>();
    let kept = Kept::try_from(&*each.expect("of that form")).expect("each once");
    IdentifyOptions { kept, free_motion: false, ..IdentifyOptions::default() }
}

#[test]
fn a_parameter_that_is_kept_is_given_and_the_others_follow_it() {
    let truth = seal(3);
    let recordings = recordings(truth, &[Protocol::Steady, Protocol::Dynamic], 3);
    let with = |kept: &[&str]| {
        identify(&recordings, &keeping(kept), &|_, _| {}).expect("there is steady sliding")
    };
    let half_width = truth.deformation.half_width();
    let of = |found: &Identification, name: &str| found.parameter(name).expect("it has it").clone();
    let right = with(&[&format!("half_width_m={half_width}")]);
    let given = of(&right, "half_width_m");
    assert_eq!((given.value, given.ci95), (half_width, [half_width; 2]));
    assert_eq!(right.model.half_width, half_width);
    assert!(of(&right, "coulomb_force_n").covers(truth.insertion.coulomb_force));
    let most = 0.95 * truth.insertion.coulomb_force;
    let bounded = of(&with(&[&format!("coulomb_force_n=0.1..{most}")]), "coulomb_force_n");
    assert!((0.1..=most).contains(&bounded.value), "{bounded:?}");
    let damped = with(&["seal_damping_n_s_m=2"]);
    assert_eq!(of(&damped, "seal_damping_n_s_m").value, 2.0);
}

#[test]
fn what_cannot_be_kept_is_refused() {
    let why =
        |text: &str| text.parse::<KeptParameter>().expect_err("no such parameter").to_string();
    for (text, part) in [
        ("half_width_m", "such as half_width_m=0.006"),
        ("half_width=0.006", "expected one of coulomb_force_n"),
        ("half_width_m=0.007..0.006", "the lower one first"),
        ("half_width_m=0", "above 0"),
    ] {
        assert!(why(text).contains(part), "{}", why(text));
    }
    let twice: Vec<KeptParameter> =
        ["half_width_m=1", "half_width_m=2"].map(|text| text.parse().expect("a range")).to_vec();
    assert!(Kept::try_from(&*twice).is_err());
    let recordings = recordings(seal(3), &[Protocol::Dynamic], 3);
    let options =
        IdentifyOptions { without: vec![Term::SealDamping], ..keeping(&["seal_damping_n_s_m=2"]) };
    let refused = identify(&recordings, &options, &|_, _| {});
    assert!(matches!(refused, Err(IdentifyError::Kept(_))), "{refused:?}");
}
