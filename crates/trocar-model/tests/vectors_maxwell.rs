//! Maxwell-Slip, GMS and modified Leuven against trajectories of other programs.

use crate::shared::shared_vector;
use trocar_model::{
    Gms, GmsElement, Leuven, LeuvenParams, MaxwellSlip, SlidingFriction, SlipElement, SlipRate,
};

/// N. Between three finite-element programs the spread is 1e-14 N.
const MAXWELL_SLIP_TOLERANCE: f64 = 1e-10;

/// N. A second reading of GMS, exact as well; positions are printed to 1 nm, stiffness is 6350 N/m.
const GMS_TOLERANCE: f64 = 1e-8;

/// N. The trajectory agrees with a closed form to 5e-14 N.
const LEUVEN_TOLERANCE: f64 = 1e-10;

const PERIOD: f64 = 1e-3;

/// s: long enough to begin a motion, too short to change anything by it.
const MOMENT: f64 = 1e-15;

/// m: an element this close to its limit may slip in one program and stick in the other.
const ROUNDING: f64 = 1e-15;

const STIFFNESS: [f64; 4] = [4000.0, 1500.0, 600.0, 250.0];

/// Rows of numbers of a shared trajectory, or `None` with the reason printed when the folder is not
/// there.
fn rows(name: &str) -> Option<Vec<Vec<f64>>> {
    let text = shared_vector(name)?;
    let row = |line: &str| line.split(',').map(|word| word.parse().unwrap()).collect();
    Some(text.lines().skip(1).map(row).collect())
}

fn maxwell_slip_matches(name: &str) {
    let Some(rows) = rows(name) else { return };
    let limits = [0.6, 0.5, 0.45, 0.4];
    let elements: Vec<SlipElement> = STIFFNESS
        .iter()
        .zip(limits)
        .map(|(&stiffness, limit_force)| SlipElement { stiffness, limit_force })
        .collect();
    let model = MaxwellSlip::new(&elements, 0.0).unwrap();
    let mut state = model.rest_state();
    let mut worst = 0.0_f64;
    for pair in rows.windows(2) {
        worst = worst.max((state.force() - pair[0][2]).abs());
        model.step(&mut state, pair[1][1] - pair[0][1], PERIOD);
    }
    println!("{name}: worst {worst:e} N over {} rows", rows.len());
    assert!(worst < MAXWELL_SLIP_TOLERANCE, "{worst}");
}

#[test]
fn maxwell_slip_matches_parallel_elastic_plastic_springs_on_the_rich_motion() {
    maxwell_slip_matches("opensees_ms4_rich.csv");
}

#[test]
fn maxwell_slip_matches_parallel_elastic_plastic_springs_on_the_triangle() {
    maxwell_slip_matches("opensees_ms4_tri.csv");
}

/// Row k holds the state at the start of interval k, its force and its slipping elements with the
/// velocity of the interval: a reversal shows one row before it moves anything.
///
/// The counts of slipping elements are the same but for three rows of the triangle, where the last
/// element is at its limit to the last bit.
fn gms_matches(name: &str) {
    let Some(rows) = rows(name) else { return };
    let attraction = 50.0; // N/s, C of GMS
    let elements: Vec<GmsElement> = STIFFNESS
        .iter()
        .zip([0.3, 0.27, 0.23, 0.2])
        .map(|(&stiffness, share)| GmsElement {
            stiffness,
            share,
            attraction: attraction * share / stiffness,
            damping: 0.0,
        })
        .collect();
    let sliding = SlidingFriction {
        coulomb_force: 1.5,
        static_force: 2.2,
        stribeck_velocity: 0.01,
        stribeck_exponent: 2.0,
        viscous_damping: 2.0,
    };
    let model = Gms::new(&elements, sliding, SlipRate::Free).unwrap();
    let mut state = model.rest_state();
    let (mut worst, mut counts_apart) = (0.0_f64, 0);
    for pair in rows.windows(2) {
        let velocity = (pair[1][1] - pair[0][1]) / PERIOD;
        worst = worst.max((model.output(&state, velocity) - pair[0][3]).abs());
        let mut begun = state;
        model.step_velocity(&mut begun, velocity, MOMENT);
        let (count, expected) =
            (begun.slipping().iter().filter(|slips| **slips).count(), pair[0][2] as usize);
        if count != expected {
            counts_apart += 1;
            // They begin to slip in their order: this is the one in question.
            let next = count.min(expected);
            let limit = elements[next].share / elements[next].stiffness * sliding.level(velocity);
            let reserve = (limit - begun.deflections()[next].abs()).abs();
            assert!(reserve < ROUNDING, "{reserve} m at {} s", pair[0][0]);
        }
        model.step_velocity(&mut state, velocity, PERIOD);
    }
    println!(
        "{name}: worst {worst:e} N over {} rows, {counts_apart} with another count of slipping elements",
        rows.len()
    );
    assert!(worst < GMS_TOLERANCE, "{worst}");
}

#[test]
fn gms_matches_the_force_form_on_the_rich_motion() {
    gms_matches("gms_oracle_rich.csv");
}

#[test]
fn gms_matches_the_force_form_on_the_triangle() {
    gms_matches("gms_oracle_tri.csv");
}

/// Over a single spring that never yields, with n = 1, the modified Leuven model is LuGre; with F_s
/// = F_c and no damping it is Dahl.
fn leuven_matches(name: &str, static_force: f64, micro_damping: f64, viscous_damping: f64) {
    let Some(rows) = rows(name) else { return };
    let sliding = SlidingFriction {
        coulomb_force: 1.5,
        static_force,
        stribeck_velocity: 0.01,
        stribeck_exponent: 2.0,
        viscous_damping,
    };
    let spring = SlipElement { stiffness: 2000.0, limit_force: 1e3 };
    let model =
        Leuven::new(&[spring], LeuvenParams { sliding, exponent: 1.0, micro_damping }).unwrap();
    let mut state = model.rest_state();
    let (mut worst, mut worst_deflection) = (0.0_f64, 0.0_f64);
    for pair in rows.windows(2) {
        let velocity = (pair[1][1] - pair[0][1]) / PERIOD;
        worst = worst.max((model.output(&state, velocity) - pair[0][3]).abs());
        worst_deflection = worst_deflection.max((state.deflection() - pair[0][2]).abs());
        model.step_velocity(&mut state, velocity, PERIOD);
    }
    println!("{name}: worst {worst:e} N, {worst_deflection:e} m over {} rows", rows.len());
    assert!(worst < LEUVEN_TOLERANCE, "{worst}");
    assert!(worst_deflection < LEUVEN_TOLERANCE / spring.stiffness, "{worst_deflection}");
}

#[test]
fn leuven_over_one_spring_matches_lugre_on_the_rich_motion() {
    leuven_matches("mujoco_lugre_gauss_rich.csv", 2.2, 5.0, 2.0);
}

#[test]
fn leuven_over_one_spring_matches_lugre_on_the_triangle() {
    leuven_matches("mujoco_lugre_gauss_tri.csv", 2.2, 5.0, 2.0);
}

#[test]
fn leuven_over_one_spring_matches_dahl_on_the_rich_motion() {
    leuven_matches("mujoco_dahl_rich.csv", 1.5, 0.0, 0.0);
}

#[test]
fn leuven_over_one_spring_matches_dahl_on_the_triangle() {
    leuven_matches("mujoco_dahl_tri.csv", 1.5, 0.0, 0.0);
}
