//! Results of a validation: the error of a model by phase, and whether it contradicts the
//! identification.

use std::sync::LazyLock;

use trocar::bench::config::Lubrication;
use trocar::bench::{BenchConfig, Protocol, run};
use trocar::identify::{Identification, IdentifyOptions, identify};
use trocar::model_file::{ErrorSource, ForceError};
use trocar::recording::Recording;
use trocar::workflow::{MovingMass, Workflow};
use trocar_model::{Element, ElementParams};

fn record(protocol: Protocol, friction: f64, seed: u64) -> Recording {
    let seal = Element::new(ElementParams::plausible_10_5_mm().unwrap()).unwrap();
    let config = BenchConfig::default();
    // The branches of the seal end at its sliding force, so a change of the friction is modelled as
    // wetting from the first sample on.
    let mut wetted = config.clone();
    wetted.lubrication =
        Lubrication { level: friction, onset_s: 0.0, spread_s: 0.0, ..wetted.lubrication };
    let made = run(&wetted, protocol, &[seal], seed)
        .unwrap()
        .to_recording(format!("{protocol}.csv"))
        .unwrap();
    made.without_moving_mass(config.rod.mass_kg, 0.0).unwrap()
}

#[derive(Clone)]
struct Found {
    identification: Identification,
    options: IdentifyOptions,
    recordings: Vec<Recording>,
}

static FOUND: LazyLock<Found> = LazyLock::new(|| {
    let recordings = vec![record(Protocol::Steady, 1.0, 1), record(Protocol::Dynamic, 1.0, 1)];
    let options = IdentifyOptions { inertia_removed: true, ..IdentifyOptions::default() };
    let identification = identify(&recordings, &options, &|_, _| {}).unwrap();
    Found { identification, options, recordings }
});

/// The result of the identification, validated on `held_out`.
fn with_outcome<T>(held_out: &[Recording], of: impl FnOnce(&Workflow) -> T) -> T {
    let Found { identification, options, recordings } = FOUND.clone();
    let moving_mass = MovingMass { mass: BenchConfig::default().rod.mass_kg, gravity: 0.0 };
    of(&Workflow::of(identification, options, recordings, held_out.to_vec(), moving_mass))
}

fn error(held_out: &[Recording]) -> ForceError {
    with_outcome(held_out, |outcome| outcome.model_file().force_error.unwrap())
}

/// Full strokes contain neither rests nor partial reversals; hand-like motion contains both.
#[test]
fn phases_that_no_recording_shows_are_unknown() {
    let own = error(&[]);
    assert_eq!(own.source, ErrorSource::Identification);
    assert!(own.deforming_n.is_some() && own.sliding_n.is_some(), "{own:?}");
    assert!(own.partial_n.is_none() && own.held_n.is_none(), "{own:?}");
    let hand = error(&[record(Protocol::Surgeon, 1.0, 2)]);
    assert_eq!(hand.source, ErrorSource::Validation);
    assert!(hand.partial_n.is_some() && hand.held_n.is_some(), "{hand:?}");
}

/// With a validation on strokes only, or on a recording with less noise than those for
/// identification, no phase has a smaller error than from the identification.
#[test]
fn the_worse_of_identification_and_validation_counts() {
    let own = error(&[]);
    for held_out in [
        record(Protocol::Validation, 1.0, 3),
        record(Protocol::Surgeon, 1.0, 3),
        record(Protocol::Step, 1.0, 3),
    ] {
        let both = error(std::slice::from_ref(&held_out));
        for (worse, alone) in [(both.deforming_n, own.deforming_n), (both.sliding_n, own.sliding_n)]
        {
            assert!(worse >= alone, "{}: {both:?}, {own:?}", held_out.name);
        }
    }
    let wet = error(&[record(Protocol::Validation, 0.8, 3)]);
    assert!(wet.sliding_n > own.sliding_n.map(|own| 3.0 * own), "{wet:?}");
}

#[test]
fn by_phase_the_larger_error_is_the_worse() {
    let of = |deforming_n, partial_n, sliding_n, held_n| ForceError {
        source: ErrorSource::Identification,
        deforming_n,
        partial_n,
        sliding_n,
        held_n,
    };
    let one = of(Some(0.1), None, Some(0.4), None);
    let other = of(Some(0.2), Some(0.7), Some(0.3), None);
    let worse =
        ForceError { source: ErrorSource::Validation, ..of(Some(0.2), Some(0.7), Some(0.4), None) };
    assert_eq!(one.worse(&other, ErrorSource::Validation), worse);
    assert_eq!(other.worse(&one, ErrorSource::Validation), worse);
    assert_eq!(one.largest(), Some(0.4));
    assert_eq!(of(None, None, None, None).largest(), None);
}

/// The same seal in full strokes or hand-like motion: no contradiction.
#[test]
fn a_validation_that_agrees_is_not_doubtful() {
    for protocol in [Protocol::Validation, Protocol::Step, Protocol::Surgeon] {
        let held_out = [record(protocol, 1.0, 4)];
        with_outcome(&held_out, |outcome| {
            let times = outcome.validation().unwrap().rms_n / outcome.identification.residual_rms;
            assert!(
                times < 2.0 && !outcome.is_doubtful(),
                "{protocol}: {times}, {:?}",
                outcome.summary().warnings
            );
        });
    }
}

/// A sensor mounted the other way round is no other seal.
#[test]
fn a_force_of_the_opposite_sign_is_named() {
    let mut turned = record(Protocol::Validation, 1.0, 4);
    let force = turned.force.iter().map(|force| -force).collect();
    turned = Recording::from_columns("turned", turned.time, turned.position, force).unwrap();
    with_outcome(&[turned], |outcome| {
        let warnings = outcome.summary().warnings;
        let of_sign = |message: &str| message.contains("the force has the opposite sign");
        assert!(warnings.iter().any(|w| of_sign(&w.message)), "{warnings:?}");
        assert!(warnings.iter().all(|w| !w.message.contains("lubrication")), "{warnings:?}");
    });
}

/// A seal that was wetted in the meantime is different: the amount and a remedy are stated, also in
/// the summary.
#[test]
fn a_validation_that_contradicts_is_doubtful() {
    for friction in [0.8, 0.9] {
        let held_out = [record(Protocol::Validation, friction, 4)];
        with_outcome(&held_out, |outcome| {
            assert!(!outcome.identification.is_doubtful() && outcome.is_doubtful());
            let summary = outcome.summary();
            assert!(summary.doubtful);
            let warning = summary
                .warnings
                .iter()
                .find(|w| w.subject.to_string() == "validation.csv")
                .expect("a warning");
            assert!(warning.doubtful);
            let times = outcome.validation().unwrap().rms_n / outcome.identification.residual_rms;
            println!("friction {friction}: {times:.1} times: {}", warning.message);
            let said = format!(
                "is {} times the model's own error",
                if times < 10.0 { format!("{times:.1}") } else { format!("{times:.0}") }
            );
            for part in [
                "validation error 0.",
                said.as_str(),
                "the model does not describe this motion; record such motion",
            ] {
                assert!(warning.message.contains(part), "{part}: {}", warning.message);
            }
        });
    }
}

/// A different tare is detected as such.
#[test]
fn an_offset_is_named() {
    let mut moved = record(Protocol::Validation, 1.0, 4);
    moved.force.iter_mut().for_each(|force| *force += 1.0);
    with_outcome(&[moved], |outcome| {
        let warnings = outcome.summary().warnings;
        let message = &warnings
            .iter()
            .find(|w| w.subject.to_string() == "validation.csv")
            .expect("a warning")
            .message;
        assert!(message.contains("check the sensor offset"), "{message}");
        let named =
            message.split("is mostly an offset of ").nth(1).and_then(|rest| rest.split(' ').next());
        let named: f64 = named.expect("an offset is named").parse().expect("a number");
        // The force of 3 N of the bench's seal varies by 1 % from stroke to stroke, in both
        // recordings.
        assert!((named - 1.0).abs() < 0.04, "{message}");
    });
}
