//! What goes beyond EMS: creep of the contact and relaxation of the rubber.

use crate::common::seals;
use proptest::prelude::*;
use trocar_model::{
    DeformationForce, Element, ElementParams, Friction, Mode, ParamError, ParameterId, Quantity,
    Relaxation, RelaxationArm, SealDamping, SlidingFriction, State,
};

const MILLISECOND: f64 = 1e-3;

/// A straight spring of 1 kN/m up to 3 N, β = 5 N·s/m.
fn spring(creep_velocity: f64, relaxation: Relaxation) -> ElementParams {
    let sliding = SlidingFriction::coulomb(3.0, 5.0);
    ElementParams {
        deformation: DeformationForce::linear(1000.0, 3e-3).unwrap(),
        damping: SealDamping::ZERO,
        insertion: sliding,
        withdrawal: sliding,
        creep_velocity,
        friction_lag: 0.0,
        dwell_force: 0.0,
        relaxation,
    }
}

fn run(element: &Element, state: &mut State, displacements: &[f64], parts: u32) -> Vec<f64> {
    let part = |d: &f64| {
        (0..parts).for_each(|_| {
            element.step(state, d / f64::from(parts), MILLISECOND / f64::from(parts));
        });
        state.force()
    };
    displacements.iter().map(part).collect()
}

/// Strokes, partial reversals, holds and a tremor of 0.1 mm at 9 Hz, 1 kHz.
fn free_motion(samples: usize) -> Vec<f64> {
    let position = |k: usize| {
        let t = k as f64 * MILLISECOND;
        let reach = 12e-3 * (1.0 - (1.3 * t).cos()) + 4e-3 * (4.1 * t).sin();
        let tremor = if (t / 2.0).fract() < 0.5 { 1e-4 * (56.5 * t).sin() } else { 0.0 };
        let held = (t / 3.0).fract() < 0.2;
        (if held { 12e-3 } else { reach }) + tremor
    };
    // Jumps between hold and motion are smoothed by a first-order lag of 20 ms.
    let mut smooth = position(0);
    let mut last = smooth;
    (1..samples)
        .map(|k| {
            smooth += 0.05 * (position(k) - smooth);
            let displacement = smooth - last;
            last = smooth;
            displacement
        })
        .collect()
}

#[test]
fn a_held_force_follows_the_closed_solution_of_the_creep_law() {
    // F' = -K·v_c·r/√(1 - r²) with r = F/F_s (β·u is below 1 mN here): t(r) = (F_s/(K·v_c))·[G(r_0)
    // - G(r)] with G(r) = √(1 - r²) - atanh(√(1 - r²)) = ∫ √(1 - r²)/r dr.
    let (force, stiffness, creep) = (3.0, 1000.0, 2e-4);
    let element = Element::new(spring(creep, Relaxation::NONE)).unwrap();
    let mut state = element.rest_at_force(2.4);
    let primitive = |r: f64| (1.0 - r * r).sqrt() - (1.0 - r * r).sqrt().atanh();
    let start = primitive(2.4 / force);
    for _ in 0..5000 {
        element.step(&mut state, 0.0, MILLISECOND);
    }
    let time = (start - primitive(state.force() / force)) * force / (stiffness * creep);
    assert!((time.abs() - 5.0).abs() < 5e-3, "{time} s by the law, 5 s passed");
    assert!(state.force() < 1.8 && state.force() > 1.0, "{} N", state.force());
    assert_eq!(state.mode(), Mode::Deforming);
}

#[test]
fn creep_fades_out_with_its_velocity() {
    let displacements = free_motion(20_000);
    let forces = |creep| {
        let params =
            ElementParams { creep_velocity: creep, ..ElementParams::plausible_10_5_mm().unwrap() };
        let element = Element::new(params).unwrap();
        run(&element, &mut element.rest_state(0.0), &displacements, 1)
    };
    let paper = forces(0.0);
    let worst =
        |creep| forces(creep).iter().zip(&paper).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let (coarse, fine) = (worst(1e-5), worst(1e-7));
    assert!(coarse > 1e-2, "{coarse} N");
    assert!(fine < 5e-3, "{fine} N");
}

#[test]
fn steady_sliding_ignores_relaxation_and_shows_creep_to_second_order() {
    let relaxation = Relaxation::single(400.0, 0.2);
    for creep in [0.0, 1e-4] {
        let element = Element::new(spring(creep, relaxation)).unwrap();
        let mut state = element.rest_state(0.0);
        for _ in 0..10_000 {
            element.step(&mut state, 2e-5, MILLISECOND);
        }
        let expected = 3.0 + 5.0 * 0.02;
        let tolerance = 3.0 * creep * creep / (2.0 * 0.02 * 0.02) + 1e-6;
        assert!(
            (state.force() - expected).abs() < tolerance,
            "{} N at v_c = {creep}",
            state.force()
        );
        assert!(state.relaxing_force().abs() < 1e-6, "{} N", state.relaxing_force());
    }
}

#[test]
fn an_arm_takes_a_ramp_and_a_hold_exactly_in_steps_of_any_length() {
    let (stiffness, time, velocity) = (400.0, 0.2, 0.01);
    let element = Element::new(spring(0.0, Relaxation::single(stiffness, time))).unwrap();
    for parts in [1_u32, 7, 100] {
        let mut state = element.rest_state(0.0);
        for _ in 0..parts {
            element.step(&mut state, velocity * 0.1 / f64::from(parts), 0.1 / f64::from(parts));
        }
        let ramp = stiffness * time * velocity * (1.0 - f64::exp(-0.1 / time));
        assert!((state.relaxing_force() - ramp).abs() < 1e-12, "{parts} parts");
        assert!((state.force() - (1000.0 * 1e-3 + ramp)).abs() < 1e-12, "{parts} parts");
        for _ in 0..parts {
            element.step(&mut state, 0.0, 0.3 / f64::from(parts));
        }
        assert!(
            (state.relaxing_force() - ramp * f64::exp(-0.3 / time)).abs() < 1e-12,
            "{parts} parts"
        );
    }
}

/// All together, at 1 kHz against 64 parts of every sample.
#[test]
fn one_step_agrees_with_many_small_ones() {
    /// N: largest where the velocity jumps by 0.1 to 0.5 m/s within one sample, as at the ends of
    /// the holds here.
    const TOLERANCE: f64 = 8e-3;
    let plausible = ElementParams::plausible_10_5_mm().unwrap();
    let relaxation = Relaxation::single(120.0, 0.2);
    let cases = [
        ("creep", ElementParams { creep_velocity: 2e-4, ..plausible }),
        ("fast creep", ElementParams { creep_velocity: 5e-3, ..plausible }),
        ("relaxation", ElementParams { relaxation, ..plausible }),
        ("both", ElementParams { creep_velocity: 2e-4, relaxation, ..plausible }),
        (
            "both, with damping",
            ElementParams {
                creep_velocity: 2e-4,
                relaxation,
                damping: SealDamping::constant(2.5),
                ..plausible
            },
        ),
    ];
    let displacements = free_motion(20_000);
    for (name, params) in cases {
        let element = Element::new(params).unwrap();
        let coarse = run(&element, &mut element.rest_state(0.0), &displacements, 1);
        let fine = run(&element, &mut element.rest_state(0.0), &displacements, 64);
        let worst = coarse.iter().zip(&fine).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        println!("{name:24} {:8.4} mN", 1e3 * worst);
        assert!(worst < TOLERANCE, "{name}: {worst} N");
    }
}

#[test]
fn a_held_seal_loses_force_and_motion_brings_it_back() {
    let relaxation = Relaxation::single(120.0, 0.2);
    let params = ElementParams {
        creep_velocity: 2e-4,
        relaxation,
        ..ElementParams::plausible_10_5_mm().unwrap()
    };
    let element = Element::new(params).unwrap();
    let mut state = element.rest_state(0.0);
    for _ in 0..2000 {
        element.step(&mut state, 2e-5, MILLISECOND);
    }
    let sliding = state.force();
    let held: Vec<f64> = (0..3000).map(|_| element.step(&mut state, 0.0, MILLISECOND)).collect();
    assert!(held.windows(2).all(|w| w[1] <= w[0] + 1e-12), "the force of a held seal rises");
    assert!(state.force() < sliding - 0.3, "{} N after 3 s of rest", state.force());
    for _ in 0..500 {
        element.step(&mut state, 2e-5, MILLISECOND);
    }
    assert!((state.force() - sliding).abs() < 1e-3, "{} N, before {sliding} N", state.force());
}

#[test]
fn bad_values_are_named() {
    let refused = |params| Element::new(params).err();
    let creep = refused(spring(-1e-4, Relaxation::NONE));
    assert_eq!(
        creep,
        Some(ParamError::OutOfRange { id: Quantity::CreepVelocity.id(), value: -1e-4 })
    );
    let arm = refused(spring(0.0, Relaxation::single(100.0, 0.0)));
    assert_eq!(arm, Some(ParamError::OutOfRange { id: Quantity::RelaxationTime.id(), value: 0.0 }));
    let unknown = refused(spring(0.0, Relaxation::single(f64::NAN, 1.0)));
    let is_it = |id: ParameterId| id == Quantity::RelaxationStiffness.id();
    assert!(matches!(unknown, Some(ParamError::OutOfRange { id, .. }) if is_it(id)));
}

fn slow_seals() -> impl Strategy<Value = ElementParams> {
    let arm = || {
        (0.0..300.0_f64, 0.02..5.0_f64)
            .prop_map(|(stiffness, time)| RelaxationArm { stiffness, time })
    };
    (seals(), 1e-6..5e-3_f64, [arm(), arm()], 0.0..5.0_f64, 0.0..0.3_f64).prop_map(
        |(seal, creep_velocity, arms, sigma, rise)| {
            let mut params = seal.params();
            // A static force above the Coulomb force keeps the branches' ends: lower the latter.
            for sliding in [&mut params.insertion, &mut params.withdrawal] {
                sliding.coulomb_force *= 1.0 - rise;
                sliding.viscous_damping += 0.5;
            }
            let relaxation = Relaxation { arms };
            ElementParams {
                creep_velocity,
                relaxation,
                damping: SealDamping::constant(sigma),
                ..params
            }
        },
    )
}

/// Moves of up to 4 mm in 1 to 200 ms, and rests.
fn moves() -> impl Strategy<Value = Vec<(f64, u32)>> {
    prop::collection::vec(
        (prop_oneof![-4e-3..4e-3_f64, -5e-5..5e-5_f64, Just(0.0)], 1..200_u32),
        1..30,
    )
}

fn go(element: &Element, state: &mut State, moves: &[(f64, u32)]) -> f64 {
    let mut work = 0.0;
    for (distance, samples) in moves {
        let displacement = distance / f64::from(*samples);
        for _ in 0..*samples {
            // The implicit power F⁺·Δx: what a coupled simulation exchanges.
            work += element.step(state, displacement, MILLISECOND) * displacement;
        }
    }
    work
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    /// A motion repeated until the state repeats with it never yields work, whatever holds and
    /// reversals it has.
    #[test]
    fn no_closed_cycle_yields_energy(params in slow_seals(), start in moves(), cycle in moves()) {
        let element = Element::new(params).unwrap();
        let mut state = element.rest_state(0.0);
        go(&element, &mut state, &start);
        let mut cycle = cycle;
        let back: f64 = cycle.iter().map(|(distance, _)| distance).sum();
        cycle.push((-back, 1 + (back.abs() / 1e-4) as u32));
        // Short cycles are repeated more often, for creep and arms to settle.
        let samples: u32 = cycle.iter().map(|(_, samples)| samples).sum();
        let (mut work, mut before) = (0.0, state);
        for _ in 0..(18_000 / samples).max(12) {
            before = state;
            work = go(&element, &mut state, &cycle);
        }
        let most = params.insertion.static_force.max(params.withdrawal.static_force);
        // A state that has not quite closed gives back what it had stored.
        let change = |of: fn(&State) -> f64| (of(&state) - of(&before)).abs();
        let c = params.deformation.half_width();
        let stored = most * change(State::deflection)
            + 2.0 * c * (change(State::yield_force) + change(State::relaxing_force));
        prop_assert!(work + stored > -1e-6 * most * 1e-3, "{work} J, stored {stored} J");
    }

    /// Nothing that is not finite, and no rest, can put the state out of bounds.
    #[test]
    fn the_force_stays_within_friction(params in slow_seals(), moves in moves()) {
        let element = Element::new(params).unwrap();
        let mut state = element.rest_state(0.0);
        go(&element, &mut state, &moves);
        let before = state;
        for (displacement, duration) in [(f64::NAN, 1e-3), (f64::INFINITY, 1e-3), (1e-3, 0.0), (1e-3, -1.0), (1e-3, f64::NAN)] {
            element.step(&mut state, displacement, duration);
        }
        prop_assert_eq!(before, state);
        let limit = |s: &SlidingFriction| s.static_force + s.viscous_damping * state.slip_velocity().abs();
        let allowed = limit(&params.insertion).max(limit(&params.withdrawal));
        prop_assert!(state.force().abs() <= allowed * (1.0 + 1e-4), "{} N of {allowed} N", state.force());
    }

    /// After one long slide two unknown pasts give one force.
    #[test]
    fn a_long_slide_forgets(params in slow_seals(), one in moves(), other in moves()) {
        let element = Element::new(params).unwrap();
        let (mut a, mut b) = (element.rest_state(0.0), element.rest_state(0.0));
        go(&element, &mut a, &one);
        go(&element, &mut b, &other);
        // Twice the width by 50 µm steps, then on for ten relaxation times of the slowest arm at
        // the same speed.
        for _ in 0..60_000 {
            element.step(&mut a, 5e-5, MILLISECOND);
            element.step(&mut b, 5e-5, MILLISECOND);
        }
        prop_assert!((a.force() - b.force()).abs() < 1e-3, "{} and {} N", a.force(), b.force());
        prop_assert!(Element::force(&a) == a.force());
    }
}
