//! Time per sample of each friction model on a surgeon-like 1 kHz motion: `cargo bench -p
//! trocar-model`.
//!
//! Slides, holds, reversals small and large, tremor. Prints the median and the fastest of the
//! repetitions: the fastest is what the machine does when nothing else runs on it.

use std::hint::black_box;
use std::time::Instant;

use trocar_model::{
    Dahl, DahlParams, Element, ElementParams, Friction, Gms, GmsElement, Leuven, LeuvenParams,
    LuGre, LuGreParams, MaxwellSlip, ParamError, Relaxation, RelaxationArm, Rotation, SealDamping,
    SlidingFriction, SlipElement, SlipRate, StaticFriction, StribeckCurve, Trocar,
};

const SAMPLES: usize = 40_000;
const REPETITIONS: usize = 101;
const PERIOD: f64 = 1e-3;

/// Displacements per sample, m: 40 mm strokes with constant speed and holds at the ends, then 10 mm
/// sub-movements with a 9 Hz tremor of 0.2 mm.
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

const STRIBECK: SlidingFriction = SlidingFriction {
    coulomb_force: 2.4,
    static_force: 3.0,
    stribeck_velocity: 0.01,
    stribeck_exponent: 2.0,
    viscous_damping: 5.0,
};

/// Measures `model` on `displacements` and prints its row.
fn report<M: Friction>(name: &str, model: &M, displacements: &[f64]) {
    let mut times = Vec::with_capacity(REPETITIONS);
    for _ in 0..REPETITIONS {
        let mut state = model.rest_at_force(0.0);
        let start = Instant::now();
        for &displacement in displacements {
            black_box(model.step(&mut state, black_box(displacement), PERIOD));
        }
        times.push(start.elapsed().as_secs_f64() * 1e9 / displacements.len() as f64);
    }
    times.sort_by(f64::total_cmp);
    println!("{name:32} {:7.1} ns per sample, fastest {:7.1}", times[REPETITIONS / 2], times[0]);
}

fn report_elements(displacements: &[f64]) -> Result<(), ParamError> {
    let constant = ElementParams::plausible_10_5_mm()?;
    let weakening = ElementParams { insertion: STRIBECK, withdrawal: STRIBECK, ..constant };
    let gentle = SlidingFriction { stribeck_velocity: 0.15, ..STRIBECK };
    let unique = ElementParams { insertion: gentle, withdrawal: gentle, ..constant };
    let damping = SealDamping::constant(1.0);
    let arm = |stiffness, time| RelaxationArm { stiffness, time };
    let relaxation = Relaxation { arms: [arm(120.0, 0.2), arm(60.0, 3.0)] };
    let cases = [
        ("constant friction, sigma = 0", constant),
        ("constant friction, sigma > 0", ElementParams { damping, ..constant }),
        ("Stribeck, unique, sigma = 0", unique),
        ("Stribeck, unique, sigma > 0", ElementParams { damping, ..unique }),
        ("Stribeck, velocity weakening, sigma = 0", weakening),
        ("Stribeck, velocity weakening, sigma > 0", ElementParams { damping, ..weakening }),
        ("creep", ElementParams { creep_velocity: 2e-4, ..constant }),
        ("relaxation, two arms", ElementParams { relaxation, ..constant }),
        (
            "everything, unique",
            ElementParams { damping, relaxation, creep_velocity: 2e-4, ..unique },
        ),
        (
            "everything, velocity weakening",
            ElementParams { damping, relaxation, creep_velocity: 2e-4, ..weakening },
        ),
    ];
    for (name, params) in cases {
        report(name, &Element::new(params)?, displacements);
    }
    Ok(())
}

/// The default seal in a model that knows of rotation, at rest around the shaft and while the
/// instrument turns once a second; and one that turns to and fro without sliding around it.
fn report_rotation(displacements: &[f64]) -> Result<(), ParamError> {
    let rotation = Rotation {
        shaft_radius: 5e-3,
        circumferential_stiffness: 425.0,
        circumferential_ratio: 1.0,
    };
    let seal = Element::new(ElementParams::plausible_10_5_mm()?)?;
    let trocar = Trocar::of_seal(seal).with_rotation(Some(rotation))?;
    type AngleAt = fn(f64) -> f64;
    let turning: AngleAt = |time| core::f64::consts::TAU * time;
    let cases: [(&str, AngleAt); 3] = [
        ("with rotation, not turning", |_| 0.0),
        ("turning once a second", turning),
        ("turning to and fro", |time| 0.5 * (9.0 * time).sin()),
    ];
    for (name, angle) in cases {
        let angles: Vec<f64> = (1..SAMPLES).map(|k| angle(k as f64 * PERIOD)).collect();
        let mut times = Vec::with_capacity(REPETITIONS);
        for _ in 0..REPETITIONS {
            let mut state = trocar.rest(0.0);
            let start = Instant::now();
            for (displacement, angle) in displacements.iter().zip(&angles) {
                let position = state.position() + black_box(displacement);
                black_box(trocar.turn_to(&mut state, position, *angle, PERIOD));
            }
            times.push(start.elapsed().as_secs_f64() * 1e9 / displacements.len() as f64);
        }
        times.sort_by(f64::total_cmp);
        println!(
            "{name:32} {:7.1} ns per sample, fastest {:7.1}",
            times[REPETITIONS / 2],
            times[0]
        );
    }
    Ok(())
}

fn report_classical(displacements: &[f64]) -> Result<(), ParamError> {
    report(
        "static, Coulomb",
        &StaticFriction::new(SlidingFriction::coulomb(3.0, 5.0))?,
        displacements,
    );
    report("static, Stribeck", &StaticFriction::new(STRIBECK)?, displacements);
    for (name, exponent) in
        [("Dahl, exponent 1", 1.0), ("Dahl, exponent 1.5", 1.5), ("Dahl, exponent 0.5", 0.5)]
    {
        let params =
            DahlParams { stiffness: 1500.0, coulomb_force: 3.0, exponent, viscous_damping: 5.0 };
        report(name, &Dahl::new(params)?, displacements);
    }
    let gaussian = LuGreParams {
        stiffness: 1500.0,
        micro_damping: 5.0,
        damping_velocity: f64::INFINITY,
        sliding: STRIBECK,
        curve: StribeckCurve::Exponential,
    };
    let cases = [
        ("LuGre, Gaussian", gaussian),
        ("LuGre, Gaussian, fading damping", LuGreParams { damping_velocity: 0.05, ..gaussian }),
        ("LuGre, rational", LuGreParams { curve: StribeckCurve::Rational, ..gaussian }),
        (
            "LuGre, exponent 1.3",
            LuGreParams {
                sliding: SlidingFriction { stribeck_exponent: 1.3, ..STRIBECK },
                ..gaussian
            },
        ),
    ];
    for (name, params) in cases {
        report(name, &LuGre::new(params)?, displacements);
    }
    Ok(())
}

/// Four elements each; the shares are those of the Coulomb force.
fn report_banks(displacements: &[f64]) -> Result<(), ParamError> {
    const BANK: [(f64, f64); 4] = [(4000.0, 0.3), (1500.0, 0.27), (600.0, 0.23), (250.0, 0.2)];
    let slip = BANK.map(|(stiffness, share)| SlipElement { stiffness, limit_force: 3.0 * share });
    report("Maxwell-Slip, 4 elements", &MaxwellSlip::new(&slip, 5.0)?, displacements);
    for (name, uneven) in [("GMS, 4 elements", 0.0), ("GMS, 4, an attraction each", 0.1)] {
        let element = |i: usize| {
            let (stiffness, share) = BANK[i];
            let attraction = 50.0 * share / stiffness * (1.0 + uneven * i as f64);
            GmsElement { stiffness, share, attraction, damping: 0.0 }
        };
        let elements: [GmsElement; 4] = std::array::from_fn(element);
        report(name, &Gms::new(&elements, STRIBECK, SlipRate::Free)?, displacements);
    }
    for (name, exponent) in
        [("Leuven, 4 elements, n = 1", 1.0), ("Leuven, 4, n = 2", 2.0), ("Leuven, 4, n = 1.5", 1.5)]
    {
        let params = LeuvenParams { sliding: STRIBECK, exponent, micro_damping: 1.0 };
        report(name, &Leuven::new(&slip, params)?, displacements);
    }
    Ok(())
}

fn main() -> Result<(), ParamError> {
    let displacements = motion();
    report_elements(&displacements)?;
    report_rotation(&displacements)?;
    report_classical(&displacements)?;
    report_banks(&displacements)
}
