//! Friction after rest.

use proptest::prelude::*;
use trocar_model::{
    DeformationForce, Element, ElementParams, Relaxation, Rotation, Seal, SealDamping,
    SlidingFriction, Stages, State, Trocar,
};

const MILLISECOND: f64 = 1e-3;
/// ΔF, N.
const DWELL: f64 = 0.2;
/// t_0, s, as the documentation says.
const AGEING_TIME: f64 = 1.0;

/// A straight spring of 1 kN/m up to 3 N, β = 5 N·s/m: c = 3 mm, so D = 0.375 mm.
fn spring(dwell_force: f64) -> ElementParams {
    let deformation = DeformationForce::linear(1000.0, 3e-3).unwrap();
    let sliding = SlidingFriction::coulomb(3.0, 5.0);
    ElementParams { dwell_force, ..ElementParams::new(deformation, sliding, sliding) }
}

/// Slides by 10 mm, rests, and goes on; gives the largest force after the rest, and the last.
fn break_away(element: &Element, rest: f64, step: f64) -> [f64; 2] {
    let (mut state, velocity) = (element.rest_state(0.0), 5e-3);
    let stroke = |state: &mut State| {
        let steps = (10e-3 / (velocity * step)).round() as u32;
        let forces = (0..steps).map(|_| element.step_velocity(state, velocity, step));
        forces.fold([0.0_f64; 2], |[most, _], force| [most.max(force), force])
    };
    stroke(&mut state);
    for _ in 0..100 {
        element.step(&mut state, 0.0, rest / 100.0);
    }
    stroke(&mut state)
}

#[test]
fn break_away_follows_the_logarithm_of_the_rest() {
    let element = Element::new(spring(DWELL)).unwrap();
    let [least, settled] = break_away(&element, 0.0, MILLISECOND);
    for rest in [0.1, 1.0, 10.0, 60.0] {
        let [most, last] = break_away(&element, rest, MILLISECOND);
        // The contact begins with the age of sliding, and ages until it slips: 0.1 s here.
        let expected = 3.0 + DWELL * (1.0 + rest / AGEING_TIME).ln();
        assert!((most - expected).abs() < 0.2 * DWELL, "{most} N after {rest} s, not {expected} N");
        assert!(most > least, "{most} N after {rest} s, {least} N without");
        assert!((last - settled).abs() < 1e-4 * DWELL, "{last} N is not forgotten: {settled} N");
    }
}

#[test]
fn steady_sliding_has_the_age_of_its_speed() {
    let element = Element::new(spring(DWELL)).unwrap();
    for velocity in [-0.1, -0.005, 0.001, 0.02] {
        let mut state = element.rest_state(0.0);
        let force = (0..20_000)
            .map(|_| element.step_velocity(&mut state, velocity, MILLISECOND))
            .last()
            .unwrap();
        let age = 3e-3 / 8.0 / f64::abs(velocity);
        let more = DWELL * (1.0 + age / AGEING_TIME).ln();
        let expected = f64::copysign(3.0 + more, velocity) + 5.0 * velocity;
        assert!((state.contact_age() - age).abs() < 1e-6 * age, "{} s", state.contact_age());
        assert!((force - expected).abs() < 1e-5, "{force} N at {velocity} m/s");
    }
}

#[test]
fn a_rest_is_as_long_in_one_step_as_in_many() {
    let element = Element::new(spring(DWELL)).unwrap();
    let mut state = element.rest_state(0.0);
    for _ in 0..1000 {
        element.step_velocity(&mut state, 0.02, MILLISECOND);
    }
    let (mut one, mut many) = (state, state);
    element.step(&mut one, 0.0, 60.0);
    for _ in 0..60_000 {
        element.step(&mut many, 0.0, MILLISECOND);
    }
    let [one, many] = [one, many].map(|state| state.contact_age());
    // What the seal slips until it rests is a part of D.
    assert!((one - many).abs() < 0.2 * many, "{one} s and {many} s");
    assert!(many > 55.0 && many <= 60.1, "{many} s");
}

/// Strokes of 20 mm and 4 mm with rests, at steps of `step`, s.
fn strokes(element: &Element, step: f64) -> Vec<f64> {
    let mut state = element.rest_state(0.0);
    let per_tick = (0.01 / step).round() as usize;
    (0..1200)
        .map(|tick| {
            let t = 0.01 * f64::from(tick);
            let velocity = if t % 4.0 < 2.0 { 0.0 } else { 0.03 * (3.0 * t).sin() };
            for _ in 0..per_tick {
                element.step_velocity(&mut state, velocity, step);
            }
            state.force()
        })
        .collect()
}

#[test]
fn finer_steps_converge() {
    let plausible = ElementParams::plausible_10_5_mm().unwrap();
    for params in [
        spring(DWELL),
        ElementParams { dwell_force: DWELL, creep_velocity: 2e-4, ..spring(0.0) },
        ElementParams { dwell_force: 0.05, damping: SealDamping::constant(2.0), ..plausible },
    ] {
        let element = Element::new(params).unwrap();
        let finest = strokes(&element, 1e-5);
        let error = |step: f64| {
            let squares =
                strokes(&element, step).into_iter().zip(&finest).map(|(a, b)| (a - b).powi(2));
            (squares.sum::<f64>() / finest.len() as f64).sqrt()
        };
        let [coarse, fine] = [1e-3, 2e-4].map(error);
        assert!(fine < 0.4 * coarse, "{coarse} N, then {fine} N");
        assert!(coarse < 0.05 * params.dwell_force, "{coarse} N rms at 1 ms");
    }
}

#[test]
fn what_is_not_finite_leaves_the_state_untouched() {
    let element = Element::new(spring(DWELL)).unwrap();
    let mut state = element.rest_state(0.0);
    element.step(&mut state, 1e-3, 0.1);
    let before = state;
    for (displacement, duration) in [
        (f64::NAN, 1e-3),
        (1e-3, f64::NAN),
        (f64::INFINITY, 1e-3),
        (1e-3, 0.0),
        (0.0, f64::INFINITY),
    ] {
        element.step(&mut state, displacement, duration);
        assert_eq!(state, before);
    }
    for _ in 0..3 {
        element.step(&mut state, 0.0, f64::MAX);
    }
    assert!(state.contact_age().is_finite() && state.force().is_finite());
}

/// A vanishing ΔF goes through the step with age: the same bits as without.
#[test]
fn a_vanishing_force_changes_no_bit() {
    let general = ElementParams {
        damping: SealDamping::constant(2.0),
        relaxation: Relaxation::single(200.0, 0.3),
        ..ElementParams::plausible_10_5_mm().unwrap()
    };
    for params in [general, ElementParams { creep_velocity: 2e-4, ..general }] {
        let forces = |dwell_force: f64| {
            strokes(&Element::new(ElementParams { dwell_force, ..params }).unwrap(), MILLISECOND)
        };
        assert_eq!(forces(0.0), forces(1e-300));
        assert_ne!(forces(0.0), forces(1e-3));
    }
}

/// Largest torque, N·m, of a turn by 4 rad after `rest`, s, and the last.
fn torques(trocar: &Trocar, rest: f64) -> [f64; 2] {
    let mut state = trocar.rest(0.0);
    for _ in 0..100 {
        trocar.turn_to(&mut state, 0.0, 0.0, rest / 100.0);
    }
    let mut found = [0.0_f64; 2];
    for k in 1..=4000 {
        trocar.turn_to(&mut state, 0.0, MILLISECOND * f64::from(k), MILLISECOND);
        let torque = state.torque();
        found = [found[0].max(torque), torque];
    }
    found
}

#[test]
fn the_contact_ages_around_the_shaft_too() {
    let (radius, ratio) = (5e-3, 0.5);
    let rotation = Rotation {
        shaft_radius: radius,
        circumferential_stiffness: 1000.0,
        circumferential_ratio: ratio,
    };
    let seal = Seal::Ems(Stages::from(Element::new(spring(DWELL)).unwrap()));
    let trocar = Trocar::of_seal(seal).with_rotation(Some(rotation)).unwrap();
    for rest in [1.0, 60.0] {
        let [most, last] = torques(&trocar, rest);
        // The seal deforms for 0.3 s before it slips; then D is passed in 75 ms.
        let raised = radius * ratio * DWELL * (1.0 + rest / AGEING_TIME).ln();
        let [_, settled] = torques(&trocar, 1e-3);
        let more = most - settled;
        assert!((more - raised).abs() < 0.2 * radius * ratio * DWELL, "{more} N·m, not {raised}");
        assert!((last - settled).abs() < 1e-4 * raised, "{last} N·m is not forgotten: {settled}");
    }
}

fn seals() -> impl Strategy<Value = ElementParams> {
    let some = |most: f64| prop_oneof![Just(0.0), 0.0..most];
    (crate::common::seals(), 0.0..0.5_f64, some(5.0), some(1e-3)).prop_map(
        |(seal, dwell_force, sigma, creep_velocity)| ElementParams {
            dwell_force,
            damping: SealDamping::constant(sigma),
            creep_velocity,
            ..seal.params()
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    /// The age stays between 0 and the time that has passed, the force within the friction of that age.
    #[test]
    fn age_and_force_stay_within_their_bounds(
        params in seals(),
        moves in prop::collection::vec((-4e-3..4e-3_f64, 1e-4..20.0_f64), 1..60),
    ) {
        let element = Element::new(params).unwrap();
        let (mut state, mut passed, mut fastest): (State, f64, f64) =
            (element.rest_state(0.0), 0.0, 0.0);
        for (displacement, duration) in moves {
            element.step(&mut state, displacement, duration);
            passed += duration;
            fastest = fastest.max(displacement.abs() / duration).max(state.slip_velocity().abs());
            prop_assert!((0.0..=passed * (1.0 + 1e-9)).contains(&state.contact_age()));
            let most = |s: &SlidingFriction| s.static_force + s.viscous_damping * fastest;
            let friction = most(&params.insertion).max(most(&params.withdrawal));
            let limit = friction + params.dwell_force * (passed / AGEING_TIME).ln_1p();
            let force = state.force().abs();
            prop_assert!(force <= limit * (1.0 + 1e-4), "{force} N of {limit} N");
        }
    }
}
