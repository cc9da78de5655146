//! What a replay spends its time on: `cargo run --release -p trocar --example simulate_speed`.
//!
//! One core, two million rows of text in memory, output to the null device. Time is what the
//! processor spent on it where the system tells (Linux), so other work on the machine does not
//! count.

use std::fmt::Write as _;
use std::hint::black_box;
use std::time::Instant;

use trocar::recording::{Choice, ReadOptions, read};

use trocar::simulate::{Positions, SimulateOptions, fields, simulate};
use trocar::table::TableWriter;
use trocar_model::{Classical, Element, ElementParams, SlidingFriction, StaticFriction, Trocar};

const ROWS: u32 = 2_000_000;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let text = motion();
    let trocar = Trocar::of_seal(Element::new(ElementParams::plausible_10_5_mm()?)?);
    // The least work a model can make, so that reading and printing remain.
    let coulomb = Trocar::of_seal(Classical::Static(StaticFriction::new(
        SlidingFriction::coulomb(3.0, 5.0),
    )?));
    let parse = rate(|| {
        let mut positions = Positions::from_text("made", text.as_bytes(), &Choice::default())?;
        while let Some(step) = positions.advance()? {
            black_box(step);
        }
        Ok(())
    })?;
    let mut steps = Vec::new();
    let mut positions = Positions::from_text("made", text.as_bytes(), &Choice::default())?;
    while let Some(step) = positions.advance()? {
        steps.push(step);
    }
    let model = rate(|| {
        let mut state = trocar.rest(steps[0].position);
        for step in &steps[1..] {
            black_box(trocar.step_to(&mut state, step.position, step.duration));
        }
        Ok(())
    })?;
    let text_only = rate(|| replay(&text, &coulomb))?;
    let all = rate(|| replay(&text, &trocar))?;
    println!("parsing alone           {parse:6.2} million rows/s");
    println!("model alone             {model:6.2} million rows/s");
    println!("parsing and printing    {text_only:6.2} million rows/s");
    println!("everything              {all:6.2} million rows/s");
    whole_recording(&text)
}

/// Reading into memory with hash and quality, as `identify` does it, from a file with three
/// columns.
fn whole_recording(text: &str) -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("motion.csv");
    let mut columns = String::from("time_s,position_m,force_n\n");
    for (k, line) in text.lines().skip(1).enumerate() {
        writeln!(columns, "{line},{:.4}", (k as f64 * 0.37).sin())?;
    }
    std::fs::write(&path, columns)?;
    let read = rate(|| {
        black_box(read(&path, &ReadOptions::default())?);
        Ok(())
    })?;
    println!("reading a recording     {read:6.2} million rows/s");
    Ok(())
}

fn replay(text: &str, trocar: &Trocar) -> Result<(), Box<dyn std::error::Error>> {
    let mut output = TableWriter::create("/dev/null", &fields(trocar))?;
    let motion = Positions::from_text("made", text.as_bytes(), &Choice::default())?;
    simulate(motion, trocar, &SimulateOptions::default(), &mut output, |_, _| ())?;
    Ok(())
}

/// Millions of rows per second, the best of three.
fn rate(
    mut run: impl FnMut() -> Result<(), Box<dyn std::error::Error>>,
) -> Result<f64, Box<dyn std::error::Error>> {
    let mut best: f64 = 0.0;
    for _ in 0..3 {
        let start = Instant::now();
        let before = processor_seconds();
        run()?;
        let spent = processor_seconds().zip(before).map(|(after, before)| after - before);
        best = best
            .max(f64::from(ROWS) / spent.unwrap_or_else(|| start.elapsed().as_secs_f64()) / 1e6);
    }
    Ok(best)
}

/// Processor time of the main thread so far.
fn processor_seconds() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/self/schedstat").ok()?;
    text.split_whitespace().next()?.parse::<f64>().ok().map(|nanoseconds| nanoseconds * 1e-9)
}

/// Strokes of 40 mm at 1 kHz through a 4 um encoder.
fn motion() -> String {
    let mut text = String::from("time_s,position_m\n");
    for k in 0..ROWS {
        let t = f64::from(k) * 1e-3;
        let position = 0.02 * (1.0 - (3.0 * t).cos());
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{t:.3},{:.6}", (position / 4e-6).round() * 4e-6);
    }
    text
}
