//! The Rust side of `python/benchmarks/simulate.py`: a model along arrays in memory, as often as it
//! is asked.
//!
//! ```text
//! simulate_arrays MODEL TIME POSITION
//! ```
//! TIME and POSITION are files of 64-bit floats in the order of this machine. For every line on
//! standard input it simulates once and prints the seconds that took and the last force, N.

use std::error::Error;
use std::io::{Write, stdin, stdout};
use std::path::Path;
use std::time::Instant;

use trocar::model_file::ModelFile;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [model, time, position] = arguments.as_slice() else {
        return Err("give MODEL TIME POSITION".into());
    };
    let (time, position) = (numbers(time)?, numbers(position)?);
    let file = ModelFile::read(Path::new(model))?;
    let trocar = file.trocar.borrowed();
    for line in stdin().lines() {
        line?;
        let clock = Instant::now();
        let mut state = trocar.rest(position[0]);
        let mut forces = Vec::with_capacity(time.len());
        forces.push(state.force());
        for (t, x) in time.windows(2).zip(&position[1..]) {
            forces.push(trocar.step_to(&mut state, *x, t[1] - t[0]));
        }
        let seconds = clock.elapsed().as_secs_f64();
        println!("{seconds} {}", forces[forces.len() - 1]);
        stdout().flush()?;
    }
    Ok(())
}

fn numbers(path: &str) -> Result<Vec<f64>, std::io::Error> {
    let bytes = std::fs::read(path)?;
    let (numbers, _) = bytes.as_chunks::<8>();
    Ok(numbers.iter().map(|number| f64::from_ne_bytes(*number)).collect())
}
