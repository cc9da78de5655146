//! Time of one communication step through the exported functions: set the position, step, get the
//! force.
//!
//! ```text
//! cargo run --release -p trocar-fmu --example step_speed
//! ```
#![allow(unsafe_code)]

use std::error::Error;
use std::ffi::{CString, c_void};
use std::fs;
use std::hint::black_box;
use std::ptr::{null, null_mut};
use std::time::Instant;

use trocar_fmu::fmi::*;
use trocar_fmu::fmi3::*;
use trocar_fmu::{Input, token};
use trocar_model::{Element, ElementParams, Trocar};

const STEPS: u32 = 2_000_000;

fn main() -> Result<(), Box<dyn Error>> {
    let trocar = Trocar::of_seal(Element::new(ElementParams::plausible_10_5_mm()?)?);
    let mut row = vec![0.0; trocar.count_numbers()];
    trocar.write_numbers(&mut row)?;
    let folder = std::env::temp_dir().join(format!("trocar-fmu-{}", std::process::id()));
    fs::create_dir_all(&folder)?;
    fs::write(
        folder.join("model.f64"),
        row.iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<u8>>(),
    )?;
    let path = CString::new(folder.to_string_lossy().as_bytes())?;
    let token = CString::new(token(&row, Input::Position))?;
    let (name, no) = (c"seal".as_ptr(), null_mut());
    // SAFETY: valid strings; neither environment nor callbacks.
    let seal = unsafe {
        fmi3InstantiateCoSimulation(
            name,
            token.as_ptr(),
            path.as_ptr(),
            0,
            0,
            0,
            0,
            null(),
            0,
            no,
            None,
            null(),
        )
    };
    fs::remove_dir_all(&folder)?;
    let mut best = f64::INFINITY;
    for _ in 0..5 {
        // SAFETY: a live handle.
        best = best.min(unsafe { run(seal) });
    }
    println!("set, step and get: {best:.1} ns, best of 5 times {STEPS} steps");
    // SAFETY: a live handle.
    unsafe { fmi3FreeInstance(seal) };
    Ok(())
}

/// Time of a step, ns.
unsafe fn run(seal: *mut c_void) -> f64 {
    let (input, force, mut value, mut flag, mut time) = (1, 2, 0.0, false, 0.0);
    // SAFETY: a live handle and valid pointers.
    unsafe {
        fmi3Reset(seal);
        fmi3EnterInitializationMode(seal, 0, 0.0, 0.0, 0, 0.0);
        fmi3ExitInitializationMode(seal);
        let begin = Instant::now();
        for k in 0..STEPS {
            // To and fro by 20 mm at 100 mm/s.
            let position = 1e-4 * f64::from((k % 400).abs_diff(200));
            fmi3SetFloat64(seal, &input, 1, &position, 1);
            fmi3DoStep(
                seal,
                time,
                1e-3,
                1,
                &mut flag,
                &mut flag.clone(),
                &mut flag.clone(),
                &mut time,
            );
            fmi3GetFloat64(seal, &force, 1, &mut value, 1);
            black_box(value);
        }
        begin.elapsed().as_secs_f64() * 1e9 / f64::from(STEPS)
    }
}
