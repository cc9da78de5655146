//! What a step promises holds for the C code, too, in both precisions: no force beyond its bound, no
//! jump that the model's stiffness does not explain.
//!
//! `TROCAR_PROMISE_STEPS` sets the number of steps of all models together.

use super::*;
use crate::common::promise::{Limits, Motion, Past};

/// Rounding of forces, as a fraction of the largest: 2e-16 and 1e-7 a number, some hundred of them.
const ROUNDING: [(Precision, f64); 2] = [(Precision::Double, 1e-13), (Precision::Single, 2e-5)];

/// Forces of `model`, beginning with that at rest, against its bounds.
fn check(name: &str, model: &ModelFile, calls: &[Call], outcomes: &[Outcome], rounding: f64) {
    let trocar = model.trocar.borrowed();
    let limits = Limits::of(trocar.seal());
    let mut past = Past::default();
    for (k, (call, pair)) in calls.iter().zip(outcomes.windows(2)).enumerate() {
        past = past.after((call.way, call.duration));
        let bounds = limits.whole(&trocar, (pair[0].position, pair[1].position), &past);
        let (from, to) = (pair[0].force, pair[1].force);
        assert!(
            bounds.hold(from, to, rounding),
            "{name}, step {k}, {} m in {} s: {from} N to {to} N, {bounds:?}",
            call.way,
            call.duration
        );
    }
}

#[test]
fn no_force_of_the_c_code_jumps() {
    if !has_gcc() {
        return;
    }
    let models = [conformance_models(), random_models(), classical_models()].concat();
    let wanted = std::env::var("TROCAR_PROMISE_STEPS").map_or(4e5, |n| n.parse().unwrap());
    let names: Vec<String> = models.iter().map(|(name, _)| name.clone()).collect();
    for (precision, rounding) in ROUNDING {
        let folder = tempfile::tempdir().unwrap();
        for (name, model) in &models {
            store_as(model, folder.path(), COptions { precision, ..options(name) });
        }
        let number = if precision == Precision::Double { "double" } else { "float" };
        fs::write(folder.path().join("driver.c"), driver(&names, number)).unwrap();
        gcc(folder.path(), &["-O2", "driver.c", "-o", "driver", "-lm"]);
        let runs = (wanted / (STEPS * models.len()) as f64).ceil() as u64;
        for seed in 0..runs {
            let steps = Motion::new(seed).steps(STEPS);
            let call = |&(way, duration): &(f64, f64)| Call { to: false, way, duration };
            let calls: Vec<Call> = steps.iter().map(call).collect();
            let rows = run_c(&folder.path().join("driver"), 0.05, &calls, models.len());
            for ((name, model), outcomes) in models.iter().zip(&rows) {
                check(name, model, &calls, outcomes, rounding);
            }
        }
    }
}
