//! Writes a recording of any length: `cargo run --release -p trocar --example long_recording --
//! SAMPLES FILE.csv`.
//!
//! Strokes of 80 mm at 1 kHz, each at a constant speed from 15 to 100 mm/s, there and back through
//! the plausible 10.5 mm seal, with encoder counts of 4 um, a sensor offset of 50 mN and force
//! noise of 25 mN rms. What `./benchmark --long` reads.

use std::fs::File;
use std::io::{BufWriter, Write};

use trocar_model::{Element, ElementParams};

/// Length of a stroke, m.
const STROKE: f64 = 0.08;
/// Sampling interval, s.
const INTERVAL: f64 = 1e-3;
/// One count of the encoder, m.
const COUNT: f64 = 4e-6;
/// Offset of the force sensor and rms of its noise, N.
const OFFSET: f64 = 0.05;
const NOISE: f64 = 0.025;

/// Speed of a stroke there and back, m/s: 18 of them, in an order that jumps about.
fn speed(stroke: u64) -> f64 {
    0.015 + 0.005 * ((stroke / 2 * 7) % 18) as f64
}

/// Uniform numbers with the spread of the noise, from a linear congruential generator: no more is
/// needed here.
fn noise(seed: &mut u64) -> f64 {
    *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    NOISE * 12_f64.sqrt() * ((*seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let samples: u64 = arguments.next().ok_or("expected SAMPLES FILE")?.parse()?;
    let path = arguments.next().ok_or("expected SAMPLES FILE")?;
    let element = Element::new(ElementParams::plausible_10_5_mm()?)?;
    let mut state = element.rest_state(0.0);
    let mut out = BufWriter::with_capacity(1 << 20, File::create(path)?);
    writeln!(out, "time_s,position_m,force_n")?;
    let (mut stroke, mut position, mut seed) = (0_u64, 0.0, 1_u64);
    for k in 0..samples {
        let inserting = stroke % 2 == 0;
        let step = speed(stroke) * INTERVAL * if inserting { 1.0 } else { -1.0 };
        let force = element.step(&mut state, step, INTERVAL) + OFFSET + noise(&mut seed);
        position += step;
        let counted = (position / COUNT).round() * COUNT;
        writeln!(out, "{:.3},{counted:.6},{force:.3}", k as f64 * INTERVAL)?;
        let ends = if inserting { position >= STROKE } else { position <= 0.0 };
        stroke += u64::from(ends);
    }
    out.into_inner()?.sync_all()?;
    Ok(())
}
