//! Error at 1 kHz against the converged solution on the motions of the paper, and against an
//! integrator of another kind.

use crate::common::{self, brute_force, trapezoid};
use trocar_model::{Element, ElementParams, SealDamping, SlidingFriction};

const PERIOD: f64 = 1e-3;

/// Demanded with constant friction and no damping, N.
const CONSTANT_FRICTION_TOLERANCE: f64 = 0.3e-3;

/// Demanded with Stribeck friction or damping, N: a twentieth of what a first-order step would
/// give.
const GENERAL_TOLERANCE: f64 = 2e-3;

/// Demanded where the seal snaps, N: the instant of snapping is not located within the step.
const SNAPPING_TOLERANCE: f64 = 40e-3;

/// Trapezoids of 15 to 100 mm/s over 40 mm and a sine of 20 mm at 0.5 Hz, as displacements per
/// sample.
fn motions() -> Vec<(String, Vec<f64>)> {
    let sampled = |position: &dyn Fn(f64) -> f64, time: f64| -> Vec<f64> {
        let count = (time / PERIOD) as usize;
        (1..count)
            .map(|k| position(k as f64 * PERIOD) - position((k - 1) as f64 * PERIOD))
            .collect()
    };
    let mut motions: Vec<_> = [0.015, 0.08, 0.1]
        .into_iter()
        .map(|speed| {
            let time = 3.0 * (0.04 / speed + speed / 2.0);
            (
                format!("trapezoid {} mm/s", speed * 1e3),
                sampled(&|t| trapezoid(speed, 2.0, 0.04, t), time),
            )
        })
        .collect();
    let sine = |t: f64| 0.02 * (std::f64::consts::PI * t).sin();
    motions.push(("sine".into(), sampled(&sine, 4.0)));
    motions
}

fn forces(element: &Element, displacements: &[f64], parts: u32) -> Vec<f64> {
    let mut state = element.rest_state(0.0);
    displacements
        .iter()
        .map(|displacement| {
            let part = displacement / f64::from(parts);
            (0..parts).fold(0.0, |_, _| element.step(&mut state, part, PERIOD / f64::from(parts)))
        })
        .collect()
}

fn worst(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max)
}

/// Largest error over all motions of the step at 1 kHz and at a 64th of it, against the brute-force
/// integrator.
fn check(name: &str, params: ElementParams, tolerance: f64, parts: usize) {
    let element = Element::new(params).unwrap();
    for (motion, displacements) in motions() {
        let coarse = forces(&element, &displacements, 1);
        let fine = forces(&element, &displacements, 64);
        if motion.contains("15") || motion.contains("100") {
            // The brute force is slow, and says nothing new there.
            assert!(worst(&coarse, &fine) < tolerance, "{name}, {motion}");
            continue;
        }
        let truth = brute_force(&params, &displacements, PERIOD, parts);
        let (converged, independent) = (worst(&coarse, &fine), worst(&fine, &truth));
        println!(
            "{name:42} {motion:20} 1 kHz {:8.4} mN, dt/64 against brute force {:8.4} mN",
            converged * 1e3,
            independent * 1e3
        );
        assert!(converged < tolerance, "{name}, {motion}: {converged} N");
        assert!(independent < 0.2 * tolerance + 5e-4, "{name}, {motion}: {independent} N");
    }
}

fn plausible() -> ElementParams {
    ElementParams::plausible_10_5_mm().unwrap()
}

fn with_friction(sliding: SlidingFriction) -> ElementParams {
    ElementParams { insertion: sliding, withdrawal: sliding, ..plausible() }
}

#[test]
fn constant_friction() {
    for beta in [20.0, 5.0, 1.0] {
        let params = with_friction(SlidingFriction::coulomb(3.0, beta));
        check(&format!("constant friction, beta {beta}"), params, CONSTANT_FRICTION_TOLERANCE, 400);
    }
}

#[test]
fn stiff_constant_friction_is_exact() {
    // Too stiff for the brute-force integrator: here the step must not depend on its length at all.
    for beta in [0.1, 1e-3, 1e-9, 0.0] {
        let element = Element::new(with_friction(SlidingFriction::coulomb(3.0, beta))).unwrap();
        for (motion, displacements) in motions() {
            let difference =
                worst(&forces(&element, &displacements, 1), &forces(&element, &displacements, 64));
            assert!(difference < 1e-10, "beta {beta}, {motion}: {difference} N");
        }
    }
}

#[test]
fn branches_that_pass_the_sliding_force() {
    // The same seal with its hump above F_c: held at F_s at the ends, but with a softer contact it
    // would slide early.
    for beta in [20.0, 5.0] {
        let params = common::humped(beta);
        check(&format!("hump above F_c, beta {beta}"), params, SNAPPING_TOLERANCE, 400);
    }
}

/// Largest error against a fine reference of the step at each of `periods`, s: velocities that
/// change every 16 ms.
fn errors(element: &Element, periods: &[f64]) -> Vec<f64> {
    const INTERVAL: f64 = 16e-3;
    const INTERVALS: usize = 200;
    let at_interval_ends = |steps: usize| -> Vec<f64> {
        let mut state = element.rest_state(0.0);
        let velocity = |k: usize| 0.02 * (3.0 * k as f64 * INTERVAL).sin() + 0.025;
        let interval = |k: usize| {
            (0..steps).fold(0.0, |_, _| {
                element.step_velocity(&mut state, velocity(k), INTERVAL / steps as f64)
            })
        };
        (0..INTERVALS).map(interval).collect()
    };
    let truth = at_interval_ends(4096);
    periods
        .iter()
        .map(|period| worst(&at_interval_ends((INTERVAL / period).round() as usize), &truth))
        .collect()
}

#[test]
fn friction_lag_is_of_second_order() {
    let stribeck = SlidingFriction {
        coulomb_force: 2.4,
        static_force: 3.0,
        stribeck_velocity: 0.03,
        stribeck_exponent: 2.0,
        viscous_damping: 20.0,
    };
    for (lag, sigma) in [(0.05, 0.0), (0.05, 2.0), (0.2, 0.0)] {
        let damping = SealDamping::constant(sigma);
        let params = ElementParams {
            damping,
            creep_velocity: 5e-3,
            friction_lag: lag,
            ..with_friction(stribeck)
        };
        let element = Element::new(params).unwrap();
        let errors = errors(&element, &[4e-3, 2e-3, 1e-3, 0.5e-3]);
        println!("lag {lag} s, sigma {sigma}: errors {errors:?} N");
        for pair in errors.windows(2) {
            assert!(pair[0] / pair[1] > 3.0, "lag {lag} s, sigma {sigma}: {errors:?} N");
        }
    }
}

#[test]
fn friction_lag_is_stable_at_any_step() {
    for (lag, duration) in
        [(1e-6, 1e-3), (1e-300, 1.0), (1e6, 1e-9), (0.05, 1e6), (1e300, 1e-300), (1e-3, 1e-3)]
    {
        let sliding = SlidingFriction {
            coulomb_force: 2.0,
            static_force: 3.0,
            stribeck_velocity: 0.01,
            stribeck_exponent: 0.8,
            viscous_damping: 1.0,
        };
        let params =
            ElementParams { creep_velocity: 1e-4, friction_lag: lag, ..with_friction(sliding) };
        let element = Element::new(params).unwrap();
        let mut state = element.rest_state(0.0);
        for k in 0..2000 {
            let sign = if k / 300 % 2 == 0 { 1.0 } else { -1.0 };
            let force = element.step(&mut state, sign * 1e-4, duration);
            let bound = 3.2 + 1e-4 / duration;
            assert!(force.abs() <= bound, "lag {lag} s, step {duration} s: {force} N");
        }
    }
}

#[test]
fn stribeck_and_damping() {
    let stribeck = |stribeck_velocity| SlidingFriction {
        coulomb_force: 2.4,
        static_force: 3.0,
        stribeck_velocity,
        stribeck_exponent: 2.0,
        viscous_damping: 5.0,
    };
    for sigma in [0.0, 1.0, 5.0] {
        let damping = SealDamping::constant(sigma);
        if sigma > 0.0 {
            check(
                &format!("constant friction, sigma {sigma}"),
                ElementParams { damping, ..plausible() },
                GENERAL_TOLERANCE,
                100,
            );
        }
        // Above a Stribeck speed of 103 mm/s there is no velocity weakening at β = 5 N·s/m.
        for speed in [0.11, 0.15] {
            let params = ElementParams { damping, ..with_friction(stribeck(speed)) };
            check(&format!("Stribeck {speed} m/s, sigma {sigma}"), params, GENERAL_TOLERANCE, 100);
        }
    }
}
