//! The worst step of each model: ten million adversarial steps, `cargo bench -p trocar-proof
//! --bench worst_case`.
//!
//! Each step is timed by itself with the cycle counter behind `Instant`, so the times hold the
//! clock's own cost, which is printed. The same steps are run several times, the slowest many
//! times, and each counts with its least time: what the machine interrupts, it interrupts at
//! another step the next time. A number asks for as many steps, names for these models of
//! `conformance/`.

use std::fs;
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

use trocar::model_file::ModelFile;
use trocar_model::{Trocar, TrocarState};

/// Steps of each model.
const STEPS: usize = 10_000_000;

/// Runs of the same steps; the least time of each step counts.
const RUNS: usize = 2;

/// One in so many steps, the slowest, is timed again from the same state: a long step is
/// interrupted often.
const AGAIN: usize = 10_000;

/// How often.
const REPETITIONS: usize = 20;

/// Displacement (m) and duration (s) of adversarial steps, from a seed: the same for every model
/// and every run.
struct Adversary {
    random: u64,
    sign: f64,
    step: usize,
}

impl Adversary {
    fn new() -> Self {
        Self { random: 0x9e37_79b9_7f4a_7c15, sign: 1.0, step: 0 }
    }

    fn uniform(&mut self) -> f64 {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        (self.random >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Even in its logarithm, from 2^`from` to 2^`to` within a part in a thousand or so: without a
    /// slow power.
    fn scale(&mut self, from: i32, to: i32) -> f64 {
        let exponent = from + (self.uniform() * f64::from(to - from)) as i32;
        f64::from_bits(((1023 + exponent) as u64) << 52) * (1.0 + self.uniform())
    }

    /// What is no motion, and motion at the edge of all numbers.
    fn fault(&mut self) -> (f64, f64) {
        match (self.uniform() * 8.0) as u32 {
            0 => (f64::NAN, 1e-3),
            1 => (1e-3, f64::NAN),
            2 => (f64::INFINITY, 1e-3),
            3 => (1e-3, 0.0),
            4 => (1e300, 1.0),
            5 => (f64::MIN_POSITIVE, f64::MAX),
            6 => (5e-324, 1e-3),
            _ => (0.0, 1.0),
        }
    }

    /// In turn, some hundred steps each: reversals at every step, creeping about one place, drives
    /// past the ends with a short way back, holds of a second after jumps, and anything at all.
    fn next(&mut self) -> (f64, f64) {
        self.step += 1;
        if self.step.is_multiple_of(509) {
            return self.fault();
        }
        let phase = (self.step / 256) % 6;
        self.sign = if matches!(phase, 0 | 1 | 5) || self.uniform() < 0.05 {
            -self.sign
        } else {
            self.sign
        };
        let (way, duration) = match phase {
            0 => (self.scale(-10, -6), 1e-3),
            1 => (self.scale(-30, -15), self.scale(-12, 0)),
            2 => (self.scale(-12, -5), self.scale(-30, 0)),
            3 if self.step.is_multiple_of(3) => (self.scale(-40, -20), 1.0),
            3 => (self.scale(-9, -2), self.scale(-30, -5)),
            4 => (self.scale(-14, -8), self.scale(-11, -6)),
            _ => (self.scale(-34, 1), self.scale(-30, 0)),
        };
        (self.sign * way, duration)
    }
}

/// Nanoseconds of one step.
fn time(trocar: &Trocar<&[f64]>, state: &mut TrocarState, (way, duration): (f64, f64)) -> u32 {
    let begin = Instant::now();
    black_box(trocar.step(black_box(state), black_box(way), black_box(duration)));
    u32::try_from(begin.elapsed().as_nanos()).unwrap_or(u32::MAX)
}

/// Least nanoseconds of each step.
fn least_times(trocar: &Trocar<&[f64]>, steps: usize) -> Vec<u32> {
    let mut least = vec![u32::MAX; steps];
    for _ in 0..RUNS {
        let (mut adversary, mut state) = (Adversary::new(), trocar.rest(0.1));
        for slot in &mut least {
            *slot = time(trocar, &mut state, adversary.next()).min(*slot);
        }
    }
    let mut sorted = least.clone();
    let (_, slow, _) = sorted.select_nth_unstable(steps - 1 - steps / AGAIN);
    let (mut adversary, mut state) = (Adversary::new(), trocar.rest(0.1));
    for slot in &mut least {
        let (motion, before) = (adversary.next(), state);
        let again = if *slot >= *slow { REPETITIONS } else { 1 };
        for _ in 0..again {
            state = before;
            *slot = time(trocar, &mut state, motion).min(*slot);
        }
    }
    least
}

/// Nanoseconds that the clock itself takes: median and 99.9th percentile.
fn clock() -> (u32, u32) {
    let mut times: Vec<u32> =
        (0..1_000_000).map(|_| Instant::now().elapsed().as_nanos() as u32).collect();
    times.sort_unstable();
    (times[times.len() / 2], times[times.len() / 1000 * 999])
}

/// Whether a controller could see such a step: up to 1 mm, 0.1 to 10 ms, no more than 2 m/s.
fn is_usual((way, duration): (f64, f64)) -> bool {
    way.abs() <= 1e-3 && (1e-4..=1e-2).contains(&duration) && way.abs() <= 2.0 * duration
}

/// Median, 99.9th percentile and the greatest.
fn percentiles(mut times: Vec<u32>) -> [u32; 3] {
    times.sort_unstable();
    [0.5, 0.999, 1.0].map(|part| times[((times.len() - 1) as f64 * part) as usize])
}

/// One row: all steps, the usual ones, and what the worst step was.
fn report(name: &str, trocar: &Trocar<&[f64]>, steps: usize) {
    let times = least_times(trocar, steps);
    let mut adversary = Adversary::new();
    let motions: Vec<(f64, f64)> = times.iter().map(|_| adversary.next()).collect();
    let usual = times
        .iter()
        .zip(&motions)
        .filter(|(_, motion)| is_usual(**motion))
        .map(|(time, _)| *time)
        .collect();
    let slowest =
        times.iter().enumerate().max_by_key(|(_, time)| **time).map_or(0, |(step, _)| step);
    let (way, duration) = motions[slowest];
    let [median, late, worst] = percentiles(times);
    let [_, usual_late, usual_worst] = percentiles(usual);
    print!("{name:16} {median:8} {late:8} {worst:8}  {usual_late:8} {usual_worst:8}");
    println!("   worst: step {slowest}, {way:.3e} m in {duration:.3e} s");
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> =
        std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    let steps =
        arguments.iter().find_map(|argument| argument.parse().ok()).unwrap_or(STEPS).max(100_000);
    let asked: Vec<&String> =
        arguments.iter().filter(|argument| argument.parse::<usize>().is_err()).collect();
    let (median, late) = clock();
    println!("{steps} adversarial steps a model, ns each, the least of {} runs", RUNS + 1);
    println!(
        "the clock's own {median} ns (99.9 %: {late} ns) is in; usual: up to 1 mm and 2 m/s in 0.1 to 10 ms"
    );
    println!(
        "{:16} {:>8} {:>8} {:>8}  {:>8} {:>8}",
        "", "median", "99.9 %", "worst", "usual 99.9 %", "worst"
    );
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../conformance/models");
    let mut paths = fs::read_dir(folder)?
        .map(|entry| Ok(entry?.path()))
        .collect::<std::io::Result<Vec<_>>>()?;
    paths.sort();
    for path in paths {
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        if asked.is_empty() || asked.iter().any(|asked| **asked == name) {
            report(&name, &ModelFile::read(&path)?.trocar.borrowed(), steps);
        }
    }
    Ok(())
}
