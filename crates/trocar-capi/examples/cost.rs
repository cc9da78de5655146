//! What the C interface costs: `cargo run --release -p trocar-capi --example cost`.
//!
//! Nanoseconds a step of the Rust core, of `trocar_step_to`, and of `trocar_simulate`, then of the
//! observer in Rust and of `trocar_compensator_step` with adaptation, on the same strokes at 1 kHz
//! in turn; the fastest of the repetitions. Last, the longest steps: the slowest on the way (each
//! step the fastest of the repetitions), and that of an encoder that jumps, upon which the observer
//! forgets all crossings.

use std::error::Error;
use std::ffi::{CString, c_char};
use std::fs;
use std::hint::black_box;
use std::path::Path;
use std::ptr::{from_mut, null_mut};
use std::time::Instant;

use trocar::compensate::{CompensateOptions, Compensator};
use trocar::model_file::ModelFile;
use trocar_c::{
    Compensator as CCompensator, CompensatorOptions, Estimate, Fault, Model, State, Status,
    trocar_compensator_free, trocar_compensator_new, trocar_compensator_options_init,
    trocar_compensator_reset, trocar_compensator_step, trocar_model_load, trocar_simulate,
    trocar_state_init, trocar_step_to,
};

const STEPS: usize = 20_000;
const REPETITIONS: usize = 25;
/// Jumps of the encoder in each.
const JUMPS: usize = 100;
const START: f64 = 0.1;
const PERIOD: f64 = 1e-3;

/// As C calls it: through a pointer that the compiler cannot look behind.
type StepTo = unsafe extern "C" fn(*const Model, *mut State, f64, f64, *mut f64) -> Status;

type Observe = unsafe extern "C" fn(*mut CCompensator, f64, f64, f64, *mut Estimate) -> Status;

/// Strokes of 40 mm at 50 mm/s with a triangular tremor of 0.2 mm at 8 Hz, as in
/// `examples/c/bench.c`.
fn motion() -> Vec<f64> {
    let stroke = |k: usize| if k % 1600 < 800 { k % 1600 } else { 1600 - k % 1600 } as f64;
    let tremor = |k: usize| {
        if k % 125 < 62 { (k % 125) as f64 / 62.0 } else { (125 - k % 125) as f64 / 63.0 }
    };
    (0..STEPS).map(|k| START + 50e-6 * stroke(k) + 2e-4 * tremor(k)).collect()
}

fn loaded(path: &Path) -> Result<*mut Model, Box<dyn Error>> {
    let (text, mut model) = (CString::new(path.to_string_lossy().into_owned())?, null_mut());
    let mut message: [c_char; 512] = [0; 512];
    // SAFETY: a text with its NUL, a place for the model, and one for a message.
    let status = unsafe {
        trocar_model_load(text.as_ptr(), from_mut(&mut model), message.as_mut_ptr(), message.len())
    };
    if status == Status::Ok {
        Ok(model)
    } else {
        Err(format!("{}: {status:?}", path.display()).into())
    }
}

fn fastest(best: &mut f64, run: impl FnOnce()) {
    let start = Instant::now();
    run();
    *best = best.min(start.elapsed().as_secs_f64() * 1e9 / STEPS as f64);
}

/// Standard deviation of the model's force for the observers, N.
const FORCE_ERROR: f64 = 0.05;

fn observer_of(model: *mut Model) -> Result<*mut CCompensator, Box<dyn Error>> {
    let nothing = f64::NAN;
    let mut options = CompensatorOptions {
        struct_size: 0,
        offset_n: nothing,
        moving_mass_kg: nothing,
        gravity_m_s2: nothing,
        sensor_limit_n: nothing,
        force_error_n: nothing,
        adaptation: 0,
        flip_force: -1,
    };
    let mut observer = null_mut();
    // SAFETY: a place for the options, of their size.
    unsafe { trocar_compensator_options_init(&raw mut options, size_of::<CompensatorOptions>()) };
    (options.force_error_n, options.moving_mass_kg) = (FORCE_ERROR, 0.04);
    // SAFETY: a loaded model, options, a place for the observer, no message.
    let status = unsafe {
        trocar_compensator_new(model, &raw const options, &raw mut observer, null_mut(), 0)
    };
    if status == Status::Ok { Ok(observer) } else { Err(format!("{status:?}").into()) }
}

/// The observer on the forces of the model and some noise: in Rust, through C, slowest, and where
/// the encoder jumps, ns.
fn observe(
    file: &ModelFile,
    model: *mut Model,
    forces: &[f64],
) -> Result<[f64; 4], Box<dyn Error>> {
    let positions = motion();
    let readings: Vec<f64> =
        forces.iter().enumerate().map(|(k, f)| f + 0.01 * (k % 7) as f64).collect();
    let options = CompensateOptions {
        force_error_n: Some(FORCE_ERROR),
        moving_mass_kg: Some(0.04),
        ..CompensateOptions::default()
    };
    let (mut own, observer) = (Compensator::new(file, &options)?, observer_of(model)?);
    let step: Observe = black_box(trocar_compensator_step);
    let mut said = Estimate {
        trocar_force_n: 0.0,
        tissue_force_n: 0.0,
        tissue_force_std_n: 0.0,
        adapting: 0,
        fault: Fault::None,
    };
    let (mut best, mut single) = ([f64::INFINITY; 2], vec![f64::INFINITY; STEPS + JUMPS]);
    for _ in 0..REPETITIONS {
        own.reset();
        // SAFETY: a live observer.
        unsafe { trocar_compensator_reset(observer) };
        fastest(&mut best[0], || {
            for (position, reading) in positions.iter().zip(&readings) {
                black_box(own.step(*position, *reading, PERIOD));
            }
        });
        fastest(&mut best[1], || {
            for (position, reading) in positions.iter().zip(&readings) {
                // SAFETY: a live observer and a place for what it says.
                unsafe { step(observer, *position, *reading, PERIOD, &raw mut said) };
            }
        });
        // SAFETY: a live observer.
        unsafe { trocar_compensator_reset(observer) };
        let jumps = (0..JUMPS).map(|k| (k % 2) as f64);
        for ((position, reading), least) in
            positions.iter().copied().chain(jumps).zip(readings.iter().cycle()).zip(&mut single)
        {
            let start = Instant::now();
            // SAFETY: a live observer and a place for what it says.
            unsafe { step(observer, position, *reading, PERIOD, &raw mut said) };
            *least = least.min(start.elapsed().as_secs_f64() * 1e9);
        }
    }
    // SAFETY: nobody uses it any more.
    unsafe { trocar_compensator_free(observer) };
    let slowest = |steps: &[f64]| steps.iter().copied().fold(0.0, f64::max);
    Ok([best[0], best[1], slowest(&single[..STEPS]), slowest(&single[STEPS..])])
}

fn report(path: &Path) -> Result<(), Box<dyn Error>> {
    let (positions, times) =
        (motion(), (1..=STEPS).map(|k| PERIOD * k as f64).collect::<Vec<f64>>());
    let file = ModelFile::read(path)?;
    let (trocar, model) = (file.trocar.borrowed(), loaded(path)?);
    let step_to: StepTo = black_box(trocar_step_to);
    let (mut state, mut forces) = (State { words: [0; 60] }, vec![0.0; STEPS]);
    let mut best = [f64::INFINITY; 3];
    for _ in 0..REPETITIONS {
        let mut own = trocar.rest(START);
        fastest(&mut best[0], || {
            for (position, force) in positions.iter().zip(&mut forces) {
                *force = trocar.step_to(&mut own, *position, PERIOD);
            }
        });
        // SAFETY: a loaded model and a state.
        unsafe { trocar_state_init(model, &raw mut state, START) };
        fastest(&mut best[1], || {
            for (position, force) in positions.iter().zip(&mut forces) {
                // SAFETY: a loaded model, a state, a place for a number.
                unsafe { step_to(model, &raw mut state, *position, PERIOD, from_mut(force)) };
            }
        });
        // SAFETY: a loaded model and a state.
        unsafe { trocar_state_init(model, &raw mut state, START) };
        fastest(&mut best[2], || {
            let (time, position, force) = (times.as_ptr(), positions.as_ptr(), forces.as_mut_ptr());
            // SAFETY: a loaded model, a state, arrays of STEPS numbers each.
            unsafe {
                trocar_simulate(
                    model,
                    &raw mut state,
                    0.0,
                    STEPS,
                    time,
                    position,
                    force,
                    null_mut(),
                )
            };
        });
        black_box(&forces);
    }
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let [rust, c, slowest, jump] = observe(&file, model, &forces)?;
    print!("{name:16} {:8.1} {:8.1} {:8.1}", best[0], best[1], best[2]);
    println!(" {rust:11.0} {c:8.0} {slowest:8.0} {jump:8.0}");
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../conformance/models");
    let mut paths: Vec<_> = fs::read_dir(folder)?
        .map(|entry| Ok(entry?.path()))
        .collect::<Result<_, std::io::Error>>()?;
    paths.sort();
    println!("ns per step          Rust        C  C array    observer        C  slowest     jump");
    paths.iter().try_for_each(|path| report(path))
}
