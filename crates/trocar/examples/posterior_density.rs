//! The density of a small recording for another sampler, and the time that ours takes.
//!
//! ```text
//! cargo run --release -p trocar --example posterior_density -- write DENSITY.json
//! cargo run --release -p trocar --example posterior_density -- time
//! ```
//! `write` writes what `reference/posterior_emcee.py` samples by an implementation of its own; `time`
//! prints how many effective draws a second one thread takes from it.
//!
//! The recording has full strokes at three speeds through a made-up seal, with noise and a friction
//! scale of its own for each stroke; the fit has no optional terms.

use std::error::Error;
use std::time::Instant;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use trocar::bench::{PlausibleSeals, random_seal};
use trocar::identify::posterior::{Convergence, Draws};
use trocar::identify::{Identification, IdentifyOptions, Term, identify};
use trocar::recording::Recording;
use trocar_model::{Element, ElementParams, ParameterId, Quantity};

/// Speeds of the cycles, m/s, length of a stroke, m, and sample time, s.
const SPEEDS: [f64; 6] = [0.05, 0.02, 0.1, 0.05, 0.1, 0.02];
const STROKE: f64 = 0.06;
const SAMPLE: f64 = 4e-3;
/// Parameters that are compared.
pub(crate) const COMPARED: [Quantity; 4] =
    [Quantity::Offset, Quantity::CoulombForce, Quantity::ViscousDamping, Quantity::HalfWidth];
/// Draws of each chain that are timed.
const TIMED: usize = 1000;

#[allow(dead_code)] // the test takes what it calls
fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let found = found(&recording(), 400);
    let density = found.density.as_ref().ok_or("there is no fit")?;
    match arguments.iter().map(String::as_str).collect::<Vec<_>>().as_slice() {
        ["write", path] => {
            let data = density.data().ok_or("the seal sticks and slips")?;
            std::fs::write(path, serde_json::to_string(&data)? + "\n")?;
        }
        ["time"] => {
            let one = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
            let begin = Instant::now();
            let sampled = one.install(|| density.sample(TIMED, (1, 0))).ok_or("no density")?;
            let seconds = begin.elapsed().as_secs_f64();
            let ess = |quantity: &Quantity| {
                let id: ParameterId = quantity.id();
                let of = |z: &Vec<f64>| density.working_parameter(z, id);
                let chains: Vec<Vec<f64>> =
                    sampled.chains.iter().map(|chain| chain.iter().map(of).collect()).collect();
                Convergence::of(&chains).map_or(0.0, |c| c.ess_bulk)
            };
            let least = COMPARED.iter().map(ess).fold(f64::INFINITY, f64::min);
            println!(
                "{{\"effective_per_s\": {:.4}, \"seconds\": {seconds:.4}, \"evaluations\": {}}}",
                least / seconds,
                sampled.evaluations
            );
        }
        _ => return Err("expected: write DENSITY.json, or: time".into()),
    }
    Ok(())
}

/// The same friction in both directions.
fn seal() -> ElementParams {
    random_seal(&PlausibleSeals { friction_asymmetry: 0.0, ..PlausibleSeals::default() }, 2)
}

/// Full strokes, with noise.
pub(crate) fn recording() -> Recording {
    let element = Element::new(seal()).expect("a seal is a model");
    let mut state = element.rest_at_force(0.0);
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let (mut time, mut position, mut force) = (Vec::new(), Vec::new(), Vec::new());
    let mut x = 0.0;
    for speed in SPEEDS {
        for direction in [1.0, -1.0] {
            let scale = 1.0 + 0.02 * (rng.random::<f64>() - 0.5);
            for _ in 0..(STROKE / speed / SAMPLE).round() as usize {
                let step = direction * speed * SAMPLE;
                x += step;
                let seal = element.step(&mut state, step, SAMPLE);
                time.push(SAMPLE * time.len() as f64);
                position.push(x);
                force.push(scale * seal + 0.1 * (rng.random::<f64>() - 0.5));
            }
        }
    }
    Recording::from_columns("strokes", time, position, force).expect("finite columns")
}

/// The element without optional terms.
pub(crate) fn found(recording: &Recording, draws: usize) -> Identification {
    let options = IdentifyOptions {
        degrees: [2, 2],
        free_motion: false,
        along: false,
        estimate_unmodelled_mass: false,
        without: Term::ALL.to_vec(),
        posterior: Draws::new(draws),
        ..IdentifyOptions::default()
    };
    identify(std::slice::from_ref(recording), &options, &|_, _| {}).expect("it slides")
}
