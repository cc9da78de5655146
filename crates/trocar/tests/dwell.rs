//! Friction after rest in recordings of the virtual bench.

use trocar::bench::{BenchConfig, PlausibleSeals, Protocol, random_seal, run};
use trocar::identify::{Identification, IdentifyOptions, Term, TermTrial, identify};
use trocar::recording::Recording;
use trocar_model::{Element, ElementParams};

/// ΔF over F_c.
const PART: f64 = 0.1;

fn seal(seed: u64, part: f64) -> ElementParams {
    let seal = random_seal(&PlausibleSeals::default(), seed);
    ElementParams { dwell_force: part * seal.insertion.coulomb_force, ..seal }
}

fn recordings(seal: ElementParams, protocols: &[Protocol], seed: u64) -> Vec<Recording> {
    let element = Element::new(seal).expect("a valid seal");
    let record = |(k, protocol): (usize, &Protocol)| {
        let seed = 100 * seed + k as u64;
        let run = run(&BenchConfig::default(), *protocol, &[element], seed).expect("it runs");
        run.to_recording(protocol.name()).expect("long enough")
    };
    protocols.iter().enumerate().map(record).collect()
}

const ALL: [Protocol; 3] = [Protocol::Steady, Protocol::Dynamic, Protocol::Rest];

fn found(recordings: &[Recording]) -> Identification {
    identify(recordings, &IdentifyOptions::default(), &|_, _| {}).expect("strokes are enough")
}

fn trial(found: &Identification) -> Option<&TermTrial> {
    let fit = found.fit.as_ref().expect("a fit to all motion");
    fit.terms.iter().find(|trial| trial.term == Term::Dwell)
}

fn is_kept(found: &Identification) -> Option<bool> {
    trial(found).map(|trial| trial.kept)
}

#[test]
fn friction_after_rest_is_recovered() {
    for seed in [1, 2, 3] {
        let seal = seal(seed, PART);
        let found = found(&recordings(seal, &ALL, seed));
        assert_eq!(is_kept(&found), Some(true), "seed {seed}: {:?}", found.fit);
        let estimate = found.parameter("dwell_force_n").expect("kept");
        let error = estimate.value / seal.dwell_force - 1.0;
        println!("seed {seed}: {error:+.3} {estimate:?}");
        assert!(estimate.determined && error.abs() < 0.1, "seed {seed}: {estimate:?}");
    }
}

#[test]
fn strokes_without_rests_do_not_tell_it() {
    let seal = seal(4, PART);
    let found = found(&recordings(seal, &ALL[..2], 4));
    assert_eq!(is_kept(&found), None);
    assert!(found.parameter("dwell_force_n").is_none());
}

/// Seals that do not stick after rest, of which `count` are drawn.
fn false_ones(count: u64) -> usize {
    let takes_it = |seed: u64| {
        let found = found(&recordings(seal(seed, 0.0), &ALL, seed));
        println!("seed {seed}: {:?}", trial(&found));
        is_kept(&found).expect("rests are long enough to try it")
    };
    (100..100 + count).filter(|seed| takes_it(*seed)).count()
}

#[test]
fn seals_without_it_do_not_get_it() {
    assert_eq!(false_ones(3), 0);
}

/// Some minutes.
#[test]
#[ignore = "statistics"]
fn twenty_seals_without_it_do_not_get_it() {
    assert_eq!(false_ones(20), 0);
}
