//! One timed pass of a model over a motion; `reference/speed.py` runs it in turn with other
//! programs.
//!
//! ```text
//! speed PARAMETERS SET POSITIONS FORCES
//! ```
//! PARAMETERS: `reference/vectors/parameters.json`, SET: a name in it. POSITIONS: 1 kHz, m, 8-byte
//! numbers, lowest byte first. Writes to FORCES those at the end of every step and then those at
//! its start, N; prints nanoseconds per step, first of the step called sample by sample, then of
//! the whole array at once.

use std::error::Error;
use std::time::Instant;

use serde_json::Value;
use trocar_model::{
    Classical, Friction, LuGre, LuGreParams, MaxwellSlip, SlidingFriction, SlipElement,
    StribeckCurve, Trocar,
};

const PERIOD: f64 = 1e-3;

fn number(object: &Value, key: &str) -> Result<f64, String> {
    object[key].as_f64().ok_or_else(|| format!("{key} is missing"))
}

fn maxwell_slip(set: &Value) -> Result<MaxwellSlip, Box<dyn Error>> {
    let mut elements = Vec::new();
    for element in set["elements"].as_array().ok_or("elements are missing")? {
        let (stiffness, limit_force) =
            (number(element, "stiffness_n_m")?, number(element, "limit_force_n")?);
        elements.push(SlipElement { stiffness, limit_force });
    }
    Ok(MaxwellSlip::new(&elements, 0.0)?)
}

fn lugre(set: &Value) -> Result<LuGre, Box<dyn Error>> {
    let curve = &set["sliding"];
    Ok(LuGre::new(LuGreParams {
        stiffness: number(set, "stiffness_n_m")?,
        micro_damping: number(set, "micro_damping_n_s_m")?,
        damping_velocity: f64::INFINITY,
        sliding: SlidingFriction {
            coulomb_force: number(curve, "coulomb_force_n")?,
            static_force: number(curve, "static_force_n")?,
            stribeck_velocity: number(curve, "stribeck_velocity_m_s")?,
            stribeck_exponent: number(curve, "stribeck_exponent")?,
            viscous_damping: number(curve, "viscous_damping_n_s_m")?,
        },
        curve: StribeckCurve::Exponential,
    })?)
}

/// Nanoseconds per step, and the forces: at the ends, then at the starts. Timed is a second pass
/// over memory already touched, steps only.
fn pass<M: Friction>(
    model: &M,
    rest: M::State,
    output: fn(&M, &M::State, f64) -> f64,
    positions: &[f64],
    classical: Classical,
) -> ([f64; 2], Vec<f64>) {
    let displacements: &Vec<f64> = &positions.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let mut forces = vec![f64::NAN; displacements.len()];
    let mut state = rest;
    for &displacement in displacements {
        forces.push(output(model, &state, displacement / PERIOD));
        model.step(&mut state, displacement, PERIOD);
    }
    let mut state = rest;
    let start = Instant::now();
    for (force, &displacement) in forces.iter_mut().zip(displacements) {
        *force = model.step(&mut state, displacement, PERIOD);
    }
    let stepped = start.elapsed();
    let (trocar, durations) = (Trocar::of_seal(classical), vec![PERIOD; displacements.len()]);
    let mut array = vec![f64::NAN; displacements.len()];
    let mut state = trocar.rest(positions[0]);
    let start = Instant::now();
    trocar.run(&mut state, &positions[1..], &durations, &mut array);
    let times = [stepped, start.elapsed()]
        .map(|time| time.as_secs_f64() * 1e9 / displacements.len() as f64);
    let ends = &forces[..displacements.len()];
    assert!(
        array.iter().zip(ends).all(|(a, b)| a.to_bits() == b.to_bits()),
        "other forces of the whole array"
    );
    (times, forces)
}

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [parameters, name, positions, forces_file] = words.as_slice() else {
        return Err("usage: speed PARAMETERS SET POSITIONS FORCES".into());
    };
    let sets: Value = serde_json::from_str(&std::fs::read_to_string(parameters)?)?;
    let set = &sets[name];
    let bytes = std::fs::read(positions)?;
    let positions: Vec<f64> = bytes.as_chunks().0.iter().copied().map(f64::from_le_bytes).collect();
    let (nanoseconds, forces) = match set["model"].as_str() {
        Some("maxwell_slip") => {
            let model = maxwell_slip(set)?;
            pass(
                &model,
                model.rest_state(),
                MaxwellSlip::output,
                &positions,
                Classical::MaxwellSlip(model),
            )
        }
        Some("lugre") => {
            let model = lugre(set)?;
            pass(&model, model.rest_state(), LuGre::output, &positions, Classical::LuGre(model))
        }
        other => return Err(format!("no pass for {name}, model {other:?}").into()),
    };
    std::fs::write(
        forces_file,
        forces.iter().flat_map(|force| force.to_le_bytes()).collect::<Vec<u8>>(),
    )?;
    println!("{} {}", nanoseconds[0], nanoseconds[1]);
    Ok(())
}
