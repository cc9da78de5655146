//! Known true parameters in motion of any kind: the fit identifies seals with creep, relaxation,
//! stick-slip, differences between the directions or two stages, and omits terms that are absent.

use trocar::bench::config::Fluctuation;
use trocar::bench::{BenchConfig, PlausibleSeals, Protocol, random_seal, run};
use trocar::identify::{Identification, IdentifyError, IdentifyOptions, Term, Warning, identify};
use trocar::recording::{Recording, local_velocity};
use trocar::validate::validate;
use trocar_model::{
    DeformationForce, Element, ElementParams, Relaxation, SealDamping, SlidingFriction, Trocar,
};

/// Noise of the bench's force sensor, N rms.
const NOISE: f64 = 0.025;

/// Seals without fluctuation, so that the residual is the sensor noise.
fn config(seconds: f64) -> BenchConfig {
    let mut config = BenchConfig::default();
    config.protocol.surgeon.duration_s = seconds;
    config.fluctuation =
        Fluctuation { stroke_fraction: 0.0, ripple_fraction: 0.0, ..config.fluctuation };
    config.rod.mass_kg = 0.0;
    config
}

fn surgeon(seal: &[ElementParams], seconds: f64, seed: u64) -> Recording {
    let elements: Vec<Element> = seal.iter().map(|p| Element::new(*p).expect("a model")).collect();
    let done = run(&config(seconds), Protocol::Surgeon, &elements, seed).expect("the rig runs");
    done.to_recording(format!("surgeon-{seed}")).expect("finite columns")
}

fn found(recordings: &[Recording]) -> Identification {
    let options = IdentifyOptions::default();
    identify(recordings, &options, &|_, _| {}).expect("free motion is enough")
}

/// Error on motion not used for the fit, N.
fn error_elsewhere(found: &Identification, seal: &[ElementParams]) -> f64 {
    validate(&Trocar::of_seal(found.stages), &[surgeon(seal, 30.0, 99)], found.model.offset).rms_n
}

fn kept(found: &Identification, term: Term) -> bool {
    let fit = found.fit.as_ref().expect("a fit to all motion");
    fit.terms.iter().any(|trial| trial.term == term && trial.kept)
}

fn seals(half_width: f64) -> PlausibleSeals {
    let friction = PlausibleSeals {
        friction_asymmetry: 0.0,
        coulomb_force: (1.0, 3.0),
        ..PlausibleSeals::default()
    };
    PlausibleSeals { half_width: (half_width, half_width), ..friction }
}

/// Determined, and within the relative error `part` of the true value.
fn assert_near(found: &Identification, name: &str, truth: f64, part: f64) {
    let estimate = found.parameter(name).unwrap_or_else(|| panic!("{name} is a parameter"));
    assert!(estimate.determined, "{name}: {estimate:?}");
    assert!(
        (estimate.value / truth - 1.0).abs() < part,
        "{name}: {estimate:?} found, {truth} true"
    );
}

#[test]
fn creep_and_relaxation_are_recovered_from_free_motion_alone() {
    let mut seal = random_seal(&seals(4e-3), 1);
    seal.damping = SealDamping { coefficients: [2.0, 0.0, 0.0] };
    seal.creep_velocity = 2e-4;
    let stiffness = 0.2 * seal.insertion.coulomb_force / seal.deformation.half_width();
    seal.relaxation = Relaxation::single(stiffness, 0.3);
    let found = found(&[surgeon(&[seal], 40.0, 1)]);
    assert!(found.steady.means.len() < 4, "no protocol: {} means", found.steady.means.len());
    assert_near(&found, "coulomb_force_n", seal.insertion.coulomb_force, 0.01);
    assert_near(&found, "viscous_damping_n_s_m", seal.insertion.viscous_damping, 0.02);
    assert_near(&found, "half_width_m", seal.deformation.half_width(), 0.01);
    assert_near(&found, "seal_damping_n_s_m", 2.0, 0.05);
    assert_near(&found, "creep_velocity_m_s", seal.creep_velocity, 0.05);
    assert_near(&found, "relaxation_stiffness_n_m", stiffness, 0.05);
    assert_near(&found, "relaxation_time_s", 0.3, 0.05);
    for absent in [Term::SecondRelaxation, Term::Asymmetry, Term::SecondStage] {
        assert!(!kept(&found, absent), "{absent:?}");
    }
    let error = error_elsewhere(&found, &[seal]);
    assert!(error < 1.1 * NOISE, "{error} N");
}

#[test]
fn a_seal_that_neither_creeps_nor_relaxes_gets_neither() {
    let seal = random_seal(&seals(4e-3), 2);
    let found = found(&[surgeon(&[seal], 40.0, 2)]);
    for absent in [Term::Creep, Term::Relaxation, Term::SecondStage, Term::MinorLoops] {
        assert!(!kept(&found, absent), "{absent:?}");
    }
    assert!(found.parameter("creep_velocity_m_s").is_none());
    assert_near(&found, "half_width_m", seal.deformation.half_width(), 0.01);
    let error = error_elsewhere(&found, &[seal]);
    assert!(error < 1.1 * NOISE, "{error} N");
}

#[test]
fn two_stages_are_told_apart_where_they_differ_in_width() {
    let (wide, narrow) = (random_seal(&seals(5e-3), 3), random_seal(&seals(1.5e-3), 5));
    let found = found(&[surgeon(&[wide, narrow], 40.0, 1)]);
    assert!(kept(&found, Term::SecondStage), "{:?}", found.fit);
    assert_near(&found, "half_width_m", 5e-3, 0.05);
    assert_near(&found, "element_2_half_width_m", 1.5e-3, 0.05);
    let total = wide.insertion.coulomb_force + narrow.insertion.coulomb_force;
    assert_near(&found, "coulomb_force_n", total, 0.01);
    let fit = found.fit.as_ref().expect("a fit to all motion");
    let second = fit.terms.iter().find(|trial| trial.term == Term::SecondStage).expect("on trial");
    assert!(second.p_value < 0.01, "{second:?}");
    assert!(fit.rms_n < 0.5 * fit.paper_rms_n, "{fit:?}");
    assert_eq!(found.stages.elements().len(), 2);
}

#[test]
fn full_strokes_leave_the_terms_of_partial_reversals_untried() {
    let seal = [Element::new(random_seal(&seals(3e-3), 4)).expect("a model")];
    let done = run(&config(10.0), Protocol::Validation, &seal, 4).expect("the rig runs");
    let found = found(&[done.to_recording("strokes").expect("finite columns")]);
    assert_eq!(found.free_motion.partial_reversals, 0);
    let fit = found.fit.as_ref().expect("full strokes are fitted too");
    for term in [Term::MinorLoops, Term::SecondRelaxation, Term::SecondStage] {
        assert!(fit.terms.iter().all(|trial| trial.term != term), "{term:?}");
    }
    assert!(
        found
            .warnings
            .iter()
            .any(|w| w.subject.to_string() == "optional terms" && w.message.contains("partial")),
        "{:?}",
        found.warnings
    );
}

#[test]
fn motion_that_takes_work_from_the_seal_is_refused() {
    let seal = random_seal(&seals(4e-3), 2);
    let mut recording = surgeon(&[seal], 20.0, 3);
    recording.force.iter_mut().for_each(|f| *f = -*f);
    let outcome = identify(&[recording], &IdentifyOptions::default(), &|_, _| {});
    assert!(matches!(outcome, Err(IdentifyError::ForceSign { .. })), "{:?}", outcome.err());
}

/// Minimum and maximum force, N, and cycles per second in the last 3 s of 6 s at `velocity`, m/s,
/// from rest.
fn swing(element: &Element, velocity: f64) -> ([f64; 2], f64) {
    const PERIOD: f64 = 1e-3;
    let mut state = element.rest_state(0.0);
    let forces: Vec<f64> =
        (0..6000).map(|_| element.step(&mut state, velocity * PERIOD, PERIOD)).collect();
    let last = &forces[3000..];
    let low = last.iter().copied().fold(f64::INFINITY, f64::min);
    let high = last.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let slips = last
        .windows(2)
        .filter(|pair| pair[0] > 0.5 * (low + high) && pair[1] <= 0.5 * (low + high))
        .count();
    ([low, high], slips as f64 / 3.0)
}

#[test]
fn a_seal_that_sticks_and_slips_is_found_to_do_so_between_the_same_forces() {
    let sliding = SlidingFriction {
        coulomb_force: 1.8,
        static_force: 2.4,
        viscous_damping: 4.0,
        stribeck_velocity: 6e-3,
        stribeck_exponent: 2.0,
    };
    let mut seal = random_seal(&seals(3e-3), 6);
    seal.deformation =
        DeformationForce::linear(sliding.static_force / 3e-3, 3e-3).expect("a spring");
    (seal.insertion, seal.withdrawal) = (sliding, sliding);
    let truth = Element::new(seal).expect("a model");
    let mut config = config(30.0);
    let steady = &mut config.protocol.steady;
    (steady.slowest_m_s, steady.fastest_m_s, steady.increment_m_s, steady.stroke_m) =
        (0.003, 0.043, 0.01, 0.03);
    let record = |protocol: Protocol, seed: u64| {
        let done = run(&config, protocol, &[truth], seed).expect("the rig runs");
        done.to_recording(protocol.name()).expect("finite columns")
    };
    for seed in [5, 6] {
        let found = found(&[record(Protocol::Steady, seed), record(Protocol::Surgeon, seed)]);
        let seen = found.stick_slip.as_ref().expect("it sticks and slips");
        assert!(
            found.warnings.iter().any(|w| w.subject.to_string() == "stick-slip" && w.doubtful),
            "{:?}",
            found.warnings
        );
        let [slow, fast] = seen.speed_m_s;
        assert!(
            (slow - 3e-3).abs() < 3e-4 && fast < 1.4e-2,
            "{seen:?}: only the slowest speeds swing"
        );
        let (force, frequency) = swing(&truth, slow);
        for (seen, truth) in seen.force_n.into_iter().zip(force) {
            assert!((seen - truth).abs() < 0.04, "{seen} N seen, {truth} N true");
        }
        assert!(
            (seen.frequency_hz[0] / frequency - 1.0).abs() < 0.15,
            "{seen:?}, {frequency} Hz true"
        );
        assert!(
            (seen.force_n[1] - sliding.static_force).abs() < 0.02 * sliding.static_force,
            "{seen:?}"
        );
        for velocity in [2e-2, 4e-2] {
            let [found, true_swing] = [found.stages.elements(), &[truth]]
                .map(|e| e.iter().map(|e| swing(e, velocity).0).map(|[l, h]| h - l).sum::<f64>());
            assert!(
                true_swing < 1e-3 && found < 0.02,
                "{found} N found, {true_swing} N true at {velocity} m/s"
            );
        }
    }
}

#[test]
fn swings_of_the_rig_are_not_called_stick_slip() {
    let seal = [random_seal(&seals(4e-3), 3)].map(|params| Element::new(params).expect("a model"));
    let done = run(&config(1.0), Protocol::Steady, &seal, 7).expect("the rig runs");
    let plain = done.to_recording("steady").expect("finite columns");
    let amplitude = 0.15 * seal[0].params().insertion.coulomb_force;
    let cogging = |x: f64, _: f64| amplitude * (std::f64::consts::TAU * x / 3e-3).sin();
    let hum = |_: f64, t: f64| amplitude * (std::f64::consts::TAU * 50.0 * t).sin();
    // The fastest strokes alone shake the rig.
    let velocity = local_velocity(&plain, 0.05);
    let fastest = velocity.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
    let speed_at = |t: f64| velocity[plain.time.partition_point(|other| *other < t)].abs();
    let resonance = |x: f64, t: f64| if speed_at(t) > 0.9 * fastest { hum(x, t) } else { 0.0 };
    for (subject, words, is_doubt, disturbance) in [
        ("ripple", "3.0 mm", true, &cogging as &dyn Fn(f64, f64) -> f64),
        ("interference", "50 Hz", true, &hum),
        ("vibration", "at slower speeds it does not", false, &resonance),
    ] {
        let mut recording = plain.clone();
        for ((force, x), t) in recording.force.iter_mut().zip(&plain.position).zip(&plain.time) {
            *force += disturbance(*x, *t);
        }
        let found = found(&[recording]);
        assert!(found.stick_slip.is_none(), "{subject}: {:?}", found.stick_slip);
        let is_it = |w: &&Warning| w.subject.to_string() == subject && w.doubtful == is_doubt;
        let warning = found.warnings.iter().find(is_it);
        assert!(
            warning.is_some_and(|w| w.message.contains(words)),
            "{subject}: {:?}",
            found.warnings
        );
    }
}

/// A hand motion that pushes into something: the message states how much of it was free.
#[test]
fn what_too_little_motion_held_is_stated() {
    let time: Vec<f64> = (0..4000).map(|k| f64::from(k) * 1e-3).collect();
    let angle = |t: &f64| std::f64::consts::PI * t;
    // Half of each stroke of 1 s speeds up, half slows down: no speed lasts.
    let way = |u: f64| if u < 0.5 { 2.0 * u * u } else { 1.0 - 2.0 * (1.0 - u).powi(2) };
    let place = |t: &f64| if t % 2.0 < 1.0 { way(t % 1.0) } else { 1.0 - way(t % 1.0) };
    let position: Vec<f64> = time.iter().map(|t| 0.03 + 0.04 * place(t)).collect();
    let push = |t: f64| if (2.4..2.8).contains(&t) { 30.0 } else { 0.0 };
    let force: Vec<f64> = time.iter().map(|t| 2.0 * angle(t).sin() + push(*t)).collect();
    let recording = Recording::from_columns("hand", time, position, force).expect("a recording");
    let options = IdentifyOptions { paper: true, ..IdentifyOptions::default() };
    let error = identify(&[recording], &options, &|_, _| {}).map(|_| ()).unwrap_err();
    let IdentifyError::NoSteadySliding { motion, .. } = &error else { panic!("{error}") };
    assert!((motion.duration - 4.0).abs() < 0.01 && motion.reversals == 3, "{motion:?}");
    assert!((motion.in_contact - 0.4).abs() < 0.01, "{motion:?}");
    assert!((motion.longest_stroke - 0.04).abs() < 1e-4, "{motion:?}");
    let message = error.to_string();
    for essential in
        ["4.0 s of motion with 3 reversals", "0.4 s with a force", "40.0 mm", "‹from_s=10›"]
    {
        assert!(message.contains(essential), "{message}");
    }
}
