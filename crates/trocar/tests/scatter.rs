//! Scatter between strokes, tested with artificial strokes of known scatter.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use trocar::recording::Recording;
use trocar::scatter::StrokeScatter;

/// Standard deviation of the noise, N: uniform within ±√3 of it.
const NOISE: f64 = 0.1;
/// Allowed error of a scatter from 20 strokes of 1000 readings: three standard deviations of an
/// estimate from 20000 readings (0.5 % each), and the interpolation of the others (1/(6·9) of it).
const TOLERANCE: f64 = 0.03;
const STEPS: usize = 1000;

/// Ten strokes of 40 mm. Their ends vary by `ends` (m), and the force has bumps (N) over the
/// position, snaps through within half a millimetre of travel, and drifts by `drift` N per stroke.
fn recording(ends: f64, bumps: f64, drift: f64, speeds: &[f64]) -> Recording {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let (mut t, mut x, mut f) = (Vec::new(), Vec::new(), Vec::new());
    let (mut time, mut from) = (0.0, 0.0);
    for stroke in 0..20 {
        let side = if stroke % 2 == 0 { 1.0 } else { -1.0 };
        let to = (if stroke % 2 == 0 { 0.04 } else { 0.0 }) + ends * rng.random::<f64>();
        let step = (to - from) / STEPS as f64;
        for k in 0..STEPS {
            let (place, travel) = (from + step * k as f64, (step * k as f64).abs());
            let noise = NOISE * 3f64.sqrt() * (2.0 * rng.random::<f64>() - 1.0);
            let turned = 1.0 - 2.0 * (-travel / 0.5e-3).exp();
            t.push(time);
            x.push(place);
            f.push(
                side * 4.0 * turned
                    + bumps * (300.0 * place).sin()
                    + drift * f64::from(stroke / 2)
                    + noise,
            );
            time += step.abs() / speeds[stroke as usize % speeds.len()];
        }
        from = to;
    }
    Recording::from_columns("made", t, x, f).expect("finite columns")
}

fn is_near(value: f64, truth: f64) {
    assert!((value / truth - 1.0).abs() < TOLERANCE, "{value} N, truth {truth} N");
}

#[test]
fn noise_is_found_whatever_the_profile() {
    let scatter = StrokeScatter::of(&recording(0.0, 1.0, 0.0, &[0.02])).expect("repeats");
    is_near(scatter.scatter_n, NOISE);
    assert_eq!((scatter.groups, scatter.strokes, scatter.degrees_of_freedom), (2, 20, 18));
    scatter.by_direction.iter().for_each(|d| is_near(d.scatter_n, NOISE));
    assert_eq!(scatter.by_direction.len(), 2);
    is_near(scatter.without_drift_n.expect("ten repeats"), NOISE);
}

#[test]
fn strokes_that_turn_at_other_places_are_compared_by_travel() {
    let scatter = StrokeScatter::of(&recording(2e-3, 0.0, 0.0, &[0.02])).expect("repeats");
    assert!(scatter.after_reversals_m > 0.5e-3, "{} m", scatter.after_reversals_m);
    is_near(scatter.scatter_n, NOISE);
    assert!(scatter.over(|i| scatter.covers(i)).is_some());
    assert_eq!(scatter.over(|_| false), None);
}

#[test]
fn a_drift_is_scatter_and_is_shown() {
    let scatter = StrokeScatter::of(&recording(0.0, 1.0, 0.1, &[0.02])).expect("repeats");
    // Standard deviation of 0 to 9 times 0.1 N: 0.303 N.
    is_near(scatter.scatter_n, NOISE.hypot(0.303));
    is_near(scatter.without_drift_n.expect("ten repeats"), NOISE);
}

#[test]
fn other_speeds_are_no_repeats() {
    let scatter =
        StrokeScatter::of(&recording(0.0, 1.0, 0.0, &[0.02, 0.02, 0.04, 0.04])).expect("repeats");
    assert_eq!((scatter.groups, scatter.strokes), (4, 20));
    let speeds: Vec<f64> = (0..20).map(|k| 0.001 * 1.3f64.powi(k)).collect();
    assert_eq!(StrokeScatter::of(&recording(0.0, 1.0, 0.0, &speeds)), None);
}
