//! Time per sample of one element on a surgeon-like 1 kHz motion: `cargo bench -p trocar-model`.
//!
//! Slides, holds, reversals small and large, tremor. Prints the median and the fastest of the repetitions: the fastest is
//! what the machine does when nothing else runs on it.

use std::hint::black_box;
use std::time::Instant;

use trocar_model::{Element, ElementParams, ParamError, SealDamping, SlidingFriction};

const SAMPLES: usize = 40_000;
const REPETITIONS: usize = 101;
const PERIOD: f64 = 1e-3;

/// Displacements per sample, m: 40 mm strokes with constant speed and holds at the ends, then 10 mm sub-movements with a
/// 9 Hz tremor of 0.2 mm.
fn motion() -> Vec<f64> {
    let position = |k: usize| {
        let t = k as f64 * PERIOD;
        let phase = (t / 4.0).fract();
        let stroke = if phase < 0.4 {
            0.04 * phase / 0.4
        } else if phase < 0.5 {
            0.04
        } else if phase < 0.9 {
            0.04 * (0.9 - phase) / 0.4
        } else {
            0.0
        };
        let sub_movement = if t > 20.0 { 5e-3 * (1.0 - (5.0 * t).cos()) } else { 0.0 };
        let tremor = if t > 20.0 { 2e-4 * (56.5 * t).sin() } else { 0.0 };
        stroke + sub_movement + tremor
    };
    (1..SAMPLES).map(|k| position(k) - position(k - 1)).collect()
}

fn nanoseconds_per_sample(element: &Element, displacements: &[f64]) -> (f64, f64) {
    let mut times = Vec::with_capacity(REPETITIONS);
    for _ in 0..REPETITIONS {
        let mut state = element.rest_state(0.0);
        let start = Instant::now();
        for &displacement in displacements {
            black_box(element.step(&mut state, black_box(displacement), PERIOD));
        }
        times.push(start.elapsed().as_secs_f64() * 1e9 / displacements.len() as f64);
    }
    times.sort_by(f64::total_cmp);
    (times[REPETITIONS / 2], times[0])
}

fn main() -> Result<(), ParamError> {
    let displacements = motion();
    let constant = ElementParams::plausible_10_5_mm()?;
    let stribeck = SlidingFriction {
        coulomb_force: 2.4,
        static_force: 3.0,
        stribeck_velocity: 0.01,
        stribeck_exponent: 2.0,
        viscous_damping: 5.0,
    };
    let folded = ElementParams { insertion: stribeck, withdrawal: stribeck, ..constant };
    let gentle = SlidingFriction { stribeck_velocity: 0.15, ..stribeck };
    let unique = ElementParams { insertion: gentle, withdrawal: gentle, ..constant };
    let damping = SealDamping::constant(1.0);
    let cases = [
        ("constant friction, sigma = 0", constant),
        ("constant friction, sigma > 0", ElementParams { damping, ..constant }),
        ("Stribeck, unique, sigma = 0", unique),
        ("Stribeck, unique, sigma > 0", ElementParams { damping, ..unique }),
        ("Stribeck, folded, sigma = 0", folded),
        ("Stribeck, folded, sigma > 0", ElementParams { damping, ..folded }),
    ];
    for (name, params) in cases {
        let element = Element::new(params)?;
        let (median, fastest) = nanoseconds_per_sample(&element, &displacements);
        println!("{name:32} {median:7.1} ns per sample, fastest {fastest:7.1}");
    }
    Ok(())
}
