//! Trajectories of the comparison models from solvers of other authors.
//!
//! A row holds the state at the start of its interval, and the force there with the velocity of the
//! interval.

use crate::shared::shared_vector;
use trocar_model::{Dahl, DahlParams, LuGre, LuGreParams, SlidingFriction, StribeckCurve};

const PERIOD: f64 = 1e-3;

/// The motions each model was driven with.
const MOTIONS: [&str; 2] = ["rich", "tri"];

/// One row and the motion that follows it.
struct Interval<const N: usize> {
    /// The columns asked for.
    row: [f64; N],
    /// m.
    displacement: f64,
    /// m/s; 0 in the last row.
    velocity: f64,
}

/// The named columns of a shared trajectory with the motion of each interval, or `None` with the
/// reason printed when the folder is not there.
fn intervals<const N: usize>(file: &str, columns: [&str; N]) -> Option<Vec<Interval<N>>> {
    let text = shared_vector(file)?;
    let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let header = lines.next().unwrap();
    let index = |name: &str| header.iter().position(|word| *word == name).unwrap();
    let (at, places) = (index("x"), columns.map(index));
    let rows: Vec<Vec<f64>> =
        lines.map(|line| line.iter().map(|word| word.parse().unwrap()).collect()).collect();
    let interval = |(k, row): (usize, &Vec<f64>)| {
        let displacement = rows.get(k + 1).map_or(0.0, |next| next[at] - row[at]);
        Interval {
            row: places.map(|place| row[place]),
            displacement,
            velocity: displacement / PERIOD,
        }
    };
    Some(rows.iter().enumerate().map(interval).collect())
}

/// The friction of the LuGre and Dahl trajectories, N, m/s, N·s/m.
const SLIDING: SlidingFriction = SlidingFriction {
    coulomb_force: 1.5,
    static_force: 2.2,
    stribeck_velocity: 0.01,
    stribeck_exponent: 2.0,
    viscous_damping: 2.0,
};

/// N/m.
const STIFFNESS: f64 = 2000.0;

/// Demands agreement with a LuGre trajectory to `tolerance`, N, in force and, times the stiffness,
/// in deflection.
fn lugre_matches(family: &str, curve: StribeckCurve, tolerance: f64) {
    let params = LuGreParams {
        stiffness: STIFFNESS,
        micro_damping: 5.0,
        damping_velocity: f64::INFINITY,
        sliding: SLIDING,
        curve,
    };
    let model = LuGre::new(params).unwrap();
    for motion in MOTIONS {
        let Some(intervals) = intervals(&format!("{family}_{motion}.csv"), ["z", "F"]) else {
            return;
        };
        let mut state = model.rest_state();
        let (mut force_apart, mut deflection_apart) = (0.0_f64, 0.0_f64);
        for Interval { row: [z, force], displacement, velocity } in &intervals {
            force_apart = force_apart.max((model.output(&state, *velocity) - force).abs());
            deflection_apart = deflection_apart.max(STIFFNESS * (state.deflection() - z).abs());
            model.step(&mut state, *displacement, PERIOD);
        }
        let rows = intervals.len();
        println!(
            "{family}_{motion}: F {force_apart:e} N, sigma0 z {deflection_apart:e} N over {rows} rows"
        );
        assert!(rows > 5000);
        assert!(
            force_apart < tolerance && deflection_apart < tolerance,
            "{force_apart} {deflection_apart}"
        );
    }
}

/// MuJoCo integrates the bristles exactly over each interval and prints 15 digits: 1e-10 N leaves
/// room for the rounding of the velocities (1e-16 m in 1 ms, times the dampers) to add up.
#[test]
fn lugre_matches_mujoco() {
    lugre_matches("mujoco_lugre_gauss", StribeckCurve::Exponential, 1e-10);
}

/// Runge-Kutta with 20 parts per interval: 1e-9 N covers its error.
#[test]
fn rational_lugre_matches_the_friction_library() {
    lugre_matches("jchristopherson_lugre_rational", StribeckCurve::Rational, 1e-9);
}

/// 1e-10 N as for LuGre.
#[test]
fn dahl_matches_mujoco() {
    const TOLERANCE: f64 = 1e-10;
    let params = DahlParams {
        stiffness: STIFFNESS,
        coulomb_force: 1.5,
        exponent: 1.0,
        viscous_damping: 0.0,
    };
    let model = Dahl::new(params).unwrap();
    for motion in MOTIONS {
        let Some(intervals) = intervals(&format!("mujoco_dahl_{motion}.csv"), ["z", "F"]) else {
            return;
        };
        let mut state = model.rest_state();
        let mut apart = 0.0_f64;
        for Interval { row: [z, force], displacement, velocity } in &intervals {
            apart = apart.max((model.output(&state, *velocity) - force).abs());
            apart = apart.max((state.hysteresis_force() - STIFFNESS * z).abs());
            model.step(&mut state, *displacement, PERIOD);
        }
        println!("mujoco_dahl_{motion}: {apart:e} N over {} rows", intervals.len());
        assert!(intervals.len() > 5000);
        assert!(apart < TOLERANCE, "{apart}");
    }
}
