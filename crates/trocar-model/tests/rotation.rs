//! The element along the axis and around it.

use crate::common::{self, general_elements, seals};
use proptest::prelude::*;
use trocar_model::{
    Branch, Classical, Dahl, DahlParams, DeformationForce, Element, ElementParams, Mode,
    ParamError, Piece, PositionProfile, Relaxation, Rotation, SealDamping, SlidingFriction, Stages,
    Trocar, TrocarState,
};

/// Demanded of the step at 1 kHz, N, with the numbers of the default seal; of a softer contact, or
/// with further terms, twice as much.
const TOLERANCE: f64 = 1e-3;

/// What a search for the slip velocity may leave, N.
const RESIDUAL: f64 = 1e-7;

const PERIOD: f64 = 1e-3;

/// Shaft of 10 mm; the arc of an angle is then 5 mm times it.
const ROTATION: Rotation =
    Rotation { shaft_radius: 5e-3, circumferential_stiffness: 425.0, circumferential_ratio: 1.0 };

fn turning(params: ElementParams, rotation: Rotation) -> Trocar {
    Trocar::of_seal(Element::new(params).unwrap()).with_rotation(Some(rotation)).unwrap()
}

/// A straight seal of 425 N/m that slides at 3 N.
fn straight(beta: f64) -> ElementParams {
    let sliding = SlidingFriction::coulomb(3.0, beta);
    let deformation = DeformationForce::linear(425.0, 3.0 / 425.0).unwrap();
    ElementParams::new(deformation, sliding, sliding)
}

/// Force and circumferential force, N.
fn forces(state: &TrocarState) -> [f64; 2] {
    [state.force(), state.torque() / ROTATION.shaft_radius]
}

/// Along positions (m) and arcs (m) at times k·`period`, each interval in `parts`.
fn run(
    trocar: &Trocar,
    path: &dyn Fn(f64) -> [f64; 2],
    count: usize,
    period: f64,
    parts: usize,
) -> Vec<[f64; 2]> {
    let [x, s] = path(0.0);
    let mut state = trocar.rest(x).with_angle(s / ROTATION.shaft_radius);
    let mut last = [x, s];
    (1..=count)
        .map(|k| {
            let next = path(k as f64 * period);
            for part in 1..=parts {
                let w = part as f64 / parts as f64;
                let at = |i: usize| last[i] + w * (next[i] - last[i]);
                trocar.turn_to(
                    &mut state,
                    at(0),
                    at(1) / ROTATION.shaft_radius,
                    period / parts as f64,
                );
            }
            last = next;
            forces(&state)
        })
        .collect()
}

fn worst(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
    a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

type Path = fn(f64) -> [f64; 2];

/// Motions like those of hands and benches: m along and around.
const PATHS: [(&str, Path); 5] = [
    ("strokes while turning", |t| [common::trapezoid(0.05, 2.0, 0.04, t), 0.0314 * t]),
    ("hold and turn", |t| [0.02 * t.min(1.0), 0.01 * (t - 1.2).max(0.0)]),
    ("turn to and fro, slow stroke", |t| [0.015 * t, 0.01 * (5.0 * t).sin()]),
    ("surgeon", |t| [0.02 * (2.0 * t).sin() + 0.01 * (7.0 * t).sin(), 0.015 * (3.3 * t).sin()]),
    ("turn alone", |t| [0.0, 0.012 * (4.0 * t).sin()]),
];

#[test]
fn error_at_1_khz() {
    let plausible = ElementParams::plausible_10_5_mm().unwrap();
    let with = |beta| {
        let sliding = SlidingFriction::coulomb(3.0, beta);
        ElementParams { insertion: sliding, withdrawal: sliding, ..plausible }
    };
    let stribeck = SlidingFriction {
        coulomb_force: 2.4,
        stribeck_velocity: 0.15,
        ..SlidingFriction::coulomb(3.0, 5.0)
    };
    for (name, params, tolerance) in [
        ("default seal", plausible, TOLERANCE),
        ("beta 20", with(20.0), TOLERANCE),
        ("beta 0.1", with(0.1), 2.0 * TOLERANCE),
        ("beta 0", with(0.0), 2.0 * TOLERANCE),
        ("straight", straight(5.0), TOLERANCE),
        (
            "sigma 2",
            ElementParams { damping: SealDamping::constant(2.0), ..plausible },
            2.0 * TOLERANCE,
        ),
        ("creep", ElementParams { creep_velocity: 2e-4, ..plausible }, 2.0 * TOLERANCE),
        (
            "Stribeck",
            ElementParams { insertion: stribeck, withdrawal: stribeck, ..plausible },
            2.0 * TOLERANCE,
        ),
        (
            "relaxation",
            ElementParams { relaxation: Relaxation::single(120.0, 0.2), ..plausible },
            2.0 * TOLERANCE,
        ),
    ] {
        let trocar = turning(params, ROTATION);
        for (motion, path) in PATHS {
            let fine = run(&trocar, &path, 4000, PERIOD, 64);
            let error = worst(&run(&trocar, &path, 4000, PERIOD, 1), &fine);
            println!("{name:12} {motion:28} 1 kHz against 64 kHz {:8.4} mN", error * 1e3);
            assert!(error < tolerance, "{name}, {motion}: {error} N");
        }
    }
}

/// The law by another integrator: explicit, in small steps, with a contact of β alone.
#[test]
fn explicit_integration_agrees() {
    const PARTS: u32 = 200;
    let params = ElementParams::plausible_10_5_mm().unwrap();
    let (seal, kappa) = (params.deformation, params.deformation.yield_stiffness());
    let trocar = turning(params, ROTATION);
    for (motion, path) in PATHS {
        let step = run(&trocar, &path, 3000, PERIOD, 8);
        let (mut z, mut q) = ([0.0_f64; 2], 0.0_f64);
        let mut other = Vec::new();
        for k in 0..3000 {
            let (from, to) = (path(k as f64 * PERIOD), path((k + 1) as f64 * PERIOD));
            for _ in 0..PARTS {
                let force = [seal.mid(z[0]) + q, ROTATION.circumferential_stiffness * z[1]];
                let size = force[0].hypot(force[1]);
                let slip = (size - 3.0).max(0.0) / 5.0 * PERIOD / f64::from(PARTS);
                let moved = |i: usize| {
                    (to[i] - from[i]) / f64::from(PARTS) - slip * force[i] / size.max(1e-12)
                };
                let [dx, ds] = [moved(0), moved(1)];
                z = [z[0] + dx, z[1] + ds];
                let gap = seal.half_gap(z[0]);
                q = (q + kappa * dx).clamp(-gap, gap);
            }
            other.push([seal.mid(z[0]) + q, ROTATION.circumferential_stiffness * z[1]]);
        }
        let difference = worst(&step, &other);
        println!("{motion:28} against explicit integration {:.3} mN", difference * 1e3);
        assert!(difference < 2e-3, "{motion}: {difference} N"); // first order, 5 µs
    }
}

#[test]
fn steady_sliding_follows_the_slip() {
    for ratio in [1.0, 0.6, 2.5] {
        let trocar = turning(
            ElementParams::plausible_10_5_mm().unwrap(),
            Rotation { circumferential_ratio: ratio, ..ROTATION },
        );
        for degrees in (0..360).step_by(15) {
            let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
            let (v, w) = (0.04 * cos, 0.04 * sin);
            let end = *run(&trocar, &|t| [v * t, w * t], 4000, 20.0 * PERIOD, 1).last().unwrap();
            let size = v.hypot(ratio * w);
            let closed = [3.0 * v / size + 5.0 * v, 3.0 * ratio * ratio * w / size + 5.0 * w];
            let difference = worst(&[end], &[closed]);
            assert!(difference < RESIDUAL, "{ratio}, {degrees}: {end:?} N, {closed:?} N");
        }
    }
}

#[test]
fn turning_by_hand_takes_the_axial_force_away() {
    let length = 3.0 / 425.0;
    let trocar = turning(straight(0.0), ROTATION);
    let mut state = trocar.rest_at_force(0.0, 3.0);
    for k in 1..=3000 {
        let s = 1e-5 * f64::from(k);
        trocar.turn_to(&mut state, 0.0, s / ROTATION.shaft_radius, PERIOD);
        let closed = [3.0 / (s / length).cosh(), 3.0 * (s / length).tanh()];
        assert!(
            worst(&[forces(&state)], &[closed]) < 1e-5,
            "{s} m: {:?} N, {closed:?} N",
            forces(&state)
        );
    }
    // A quarter turn leaves 1.78 N of 3 N.
    let mut state = trocar.rest_at_force(0.0, 3.0);
    trocar.turn_to(&mut state, 0.0, core::f64::consts::FRAC_PI_2, 1.0);
    assert!(
        (state.force() - 1.78).abs() < 0.03 && (state.torque() - 12e-3).abs() < 0.3e-3,
        "{state:?}"
    );
}

#[test]
fn an_element_that_turns_is_symmetric() {
    let trocar = turning(
        ElementParams::plausible_10_5_mm().unwrap(),
        Rotation { circumferential_ratio: 0.7, ..ROTATION },
    );
    for (motion, path) in PATHS {
        let forces = run(&trocar, &path, 4000, PERIOD, 1);
        let around = run(&trocar, &|t| [path(t)[0], -path(t)[1]], 4000, PERIOD, 1);
        let along = run(&trocar, &|t| [-path(t)[0], path(t)[1]], 4000, PERIOD, 1);
        for ((a, b), c) in forces.iter().zip(&around).zip(&along) {
            assert_eq!([a[0], -a[1]], *b, "{motion}");
            assert!(worst(&[[-a[0], a[1]]], &[*c]) < RESIDUAL, "{motion}: {a:?} {c:?}");
        }
    }
}

#[test]
fn an_isotropic_element_does_not_know_the_axis() {
    let trocar = turning(straight(5.0), ROTATION);
    let (sin, cos) = 0.7_f64.sin_cos();
    let turn = move |[a, b]: [f64; 2]| [cos * a - sin * b, sin * a + cos * b];
    for (motion, path) in PATHS {
        let plain = run(&trocar, &path, 4000, PERIOD, 1);
        let turned = run(&trocar, &|t| turn(path(t)), 4000, PERIOD, 1);
        let expected: Vec<_> = plain.into_iter().map(turn).collect();
        let difference = worst(&turned, &expected);
        assert!(difference < RESIDUAL, "{motion}: {difference} N");
    }
}

/// Two halves of a seal in parallel are the seal.
#[test]
fn elements_in_parallel_turn_alike() {
    let whole = straight(5.0);
    let half = SlidingFriction::coulomb(1.5, 2.5);
    let deformation = DeformationForce::linear(212.5, 3.0 / 425.0).unwrap();
    let half = Element::new(ElementParams::new(deformation, half, half)).unwrap();
    let halves =
        Trocar::of_seal(Stages::new(&[half; 2]).unwrap()).with_rotation(Some(ROTATION)).unwrap();
    for (motion, path) in PATHS {
        let difference = worst(
            &run(&halves, &path, 4000, PERIOD, 1),
            &run(&turning(whole, ROTATION), &path, 4000, PERIOD, 1),
        );
        assert!(difference < RESIDUAL, "{motion}: {difference} N");
    }
}

#[test]
fn a_position_profile_scales_the_torque_too() {
    let seal = Element::new(straight(5.0)).unwrap();
    let profile = PositionProfile::new(-1.0, 1.0, &[0.5, 0.5][..], &[2.0, 2.0][..]).unwrap();
    let plain = Trocar::of_seal(seal).with_rotation(Some(ROTATION)).unwrap();
    let scaled = Trocar::new(seal, Some(profile)).with_rotation(Some(ROTATION)).unwrap();
    let (mut a, mut b) = (plain.rest(0.0), scaled.rest(0.0));
    plain.turn_to(&mut a, 0.01, 2.0, 1.0);
    scaled.turn_to(&mut b, 0.01, 2.0, 1.0);
    assert_eq!(b.torque(), 2.0 * a.torque());
    assert_eq!(b.force(), 0.5 + 2.0 * a.force());
}

#[test]
fn input_that_is_not_finite_leaves_the_state_untouched() {
    let trocar = turning(ElementParams::plausible_10_5_mm().unwrap(), ROTATION);
    let mut state = trocar.rest(0.01).with_angle(0.3);
    trocar.turn_to(&mut state, 0.03, 4.0, 0.5);
    let before = state;
    assert!(before.torque() > 0.0);
    let bad = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
    for bad in bad {
        trocar.turn_to(&mut state, bad, 1.0, PERIOD);
        trocar.turn_to(&mut state, 0.02, bad, PERIOD);
        trocar.turn_to(&mut state, 0.02, 1.0, bad);
    }
    for (position, angle, duration) in
        [(0.02, 1.0, 0.0), (0.02, 1.0, -1.0), (1e300, 1.0, 1e-300), (0.02, 1e300, 1e-300)]
    {
        trocar.turn_to(&mut state, position, angle, duration);
    }
    assert_eq!(state, before);
}

#[test]
fn models_that_cannot_turn_are_refused() {
    let params =
        DahlParams { stiffness: 1500.0, coulomb_force: 3.0, exponent: 1.0, viscous_damping: 5.0 };
    let dahl = Trocar::of_seal(Classical::Dahl(Dahl::new(params).unwrap()));
    assert_eq!(dahl.with_rotation(Some(ROTATION)), Err(ParamError::RotationOfClassical));
    let seal = Trocar::of_seal(Element::new(straight(5.0)).unwrap());
    for bad in [
        Rotation { shaft_radius: 0.0, ..ROTATION },
        Rotation { circumferential_stiffness: f64::NAN, ..ROTATION },
        Rotation { circumferential_ratio: -1.0, ..ROTATION },
    ] {
        assert!(matches!(seal.with_rotation(Some(bad)), Err(ParamError::OutOfRange { .. })));
    }
}

#[test]
fn a_row_gives_the_model_and_its_state_back() {
    let trocar = turning(ElementParams::plausible_10_5_mm().unwrap(), ROTATION);
    let mut row = [0.0; 400];
    let count = trocar.write_numbers(&mut row).unwrap();
    assert_eq!(count, trocar.count_numbers());
    let read = Trocar::from_numbers(&row[..count]).unwrap();
    assert_eq!(read.rotation(), Some(&ROTATION));
    let mut state = trocar.rest(0.0);
    trocar.turn_to(&mut state, 0.02, 3.0, 0.4);
    assert_eq!(read.state_from_numbers(&state.to_numbers()).unwrap(), state);
}

/// f + β·v of the only element and its slip velocity.
fn contact(trocar: &Trocar, state: &TrocarState) -> ([f64; 2], [f64; 2]) {
    let trocar_model::SealState::Ems(own) = state.seal() else { unreachable!("an EMS model") };
    let own = &own.states()[0];
    let around = state.turning().unwrap();
    let tangential = trocar.rotation().unwrap().circumferential_stiffness * around.deflections()[0];
    ([own.force(), tangential], [own.slip_velocity(), around.slip_velocities()[0]])
}

/// How much of the yield set the force without β·v takes up.
fn utilisation(element: &Element, ratio: f64, force: [f64; 2], slip: [f64; 2]) -> f64 {
    let params = element.params();
    let own = if force[0] < 0.0 { &params.withdrawal } else { &params.insertion };
    let beta = 0.5 * (params.insertion.viscous_damping + params.withdrawal.viscous_damping);
    let speed = slip[0].hypot(slip[1]);
    let around = SlidingFriction {
        coulomb_force: 0.5 * (params.insertion.coulomb_force + params.withdrawal.coulomb_force),
        static_force: 0.5 * (params.insertion.static_force + params.withdrawal.static_force),
        ..*own
    };
    let f = [force[0] - own.viscous_damping * slip[0], force[1] - beta * slip[1]];
    (f[0] / own.level(speed)).hypot(f[1] / (ratio * around.level(speed)))
}

proptest! {
    #[test]
    fn an_instrument_that_never_turned_runs_the_axial_step(
        element in general_elements(),
        confined in seals(),
        creep in prop_oneof![Just(0.0), 1e-5..1e-2_f64],
        angle in -10.0..10.0_f64,
        steps in prop::collection::vec((-5e-3..5e-3_f64, 1e-4..0.1_f64), 50),
    ) {
        let creeping = ElementParams { creep_velocity: creep, ..*element.params() };
        for element in [Element::new(creeping).unwrap(), confined.element()] {
            let plain = Trocar::of_seal(element);
            let trocar = plain.with_rotation(Some(ROTATION)).unwrap();
            let (mut a, mut b) = (plain.rest(0.0), trocar.rest(0.0).with_angle(angle));
            for (displacement, duration) in &steps {
                let position = a.position() + displacement;
                let force = plain.step_to(&mut a, position, *duration);
                prop_assert_eq!(force.to_bits(), trocar.turn_to(&mut b, position, angle, *duration).to_bits());
            }
            prop_assert_eq!(a.seal(), b.seal());
        }
    }

    /// Whatever the seal, its stiffness and the step: the force stays in the yield set.
    #[test]
    fn the_force_stays_in_the_yield_set(
        element in general_elements(),
        confined in seals(),
        ratio in 0.2..5.0_f64,
        stiffness in -2.0..10.0_f64,
        scale in -9.0..1.0_f64,
        period in -6.0..4.0_f64,
        steps in prop::collection::vec((-1.0..1.0_f64, -1.0..1.0_f64, 0.0..1.0_f64), 60),
    ) {
        let rotation = Rotation {
            circumferential_stiffness: 10.0_f64.powf(stiffness),
            circumferential_ratio: ratio,
            ..ROTATION
        };
        for element in [element, confined.element()] {
            let trocar = Trocar::of_seal(element).with_rotation(Some(rotation)).unwrap();
            let mut state = trocar.rest(0.0);
            let (mut x, mut s) = (0.0, 0.0);
            for (dx, ds, time) in &steps {
                let size = 10.0_f64.powf(scale);
                (x, s) = (x + size * dx, s + size * ds);
                let duration = 10.0_f64.powf(period) * (0.1 + time);
                let force = trocar.turn_to(&mut state, x, s / rotation.shaft_radius, duration);
                prop_assert!(force.is_finite() && state.torque().is_finite());
                let (elastic, slip) = contact(&trocar, &state);
                let part = utilisation(&element, ratio, elastic, slip);
                let excess = (part - 1.0) * element.params().insertion.static_force;
                prop_assert!(
                    excess <= 1e-5,
                    "{part}: {elastic:?} N at {slip:?} m/s"
                );
            }
        }
    }

    /// Work put into a seal over a repeated closed motion, to the first harmonics of a hand.
    #[test]
    fn no_closed_motion_yields_work(
        seal in seals(),
        ratio in 0.3..3.0_f64,
        stiffness in 50.0..5e3_f64,
        amplitudes in prop::array::uniform4(-1.0..1.0_f64),
        phases in prop::array::uniform4(0.0..6.2_f64),
        size in 1e-4..3e-2_f64,
    ) {
        let rotation = Rotation { circumferential_stiffness: stiffness, circumferential_ratio: ratio, ..ROTATION };
        let trocar = Trocar::of_seal(seal.element()).with_rotation(Some(rotation)).unwrap();
        let path = |k: u32| {
            let t = std::f64::consts::TAU * f64::from(k) / 1000.0;
            let wave = |i: usize| amplitudes[i] * ((1 + i / 2) as f64 * t + phases[i]).sin();
            [size * (wave(0) + wave(2)), size * (wave(1) + wave(3))]
        };
        let [x, s] = path(0);
        let mut state = trocar.rest(x).with_angle(s / rotation.shaft_radius);
        let mut work = 0.0;
        let mut moved = 0.0;
        for k in 1..=6000 {
            let before = forces(&state);
            let ([x, s], [x0, s0]) = (path(k), path(k - 1));
            trocar.turn_to(&mut state, x, s / rotation.shaft_radius, PERIOD);
            let after = forces(&state);
            if k > 5000 {
                let [a, b] = [0.5 * (before[0] + after[0]) * (x - x0), 0.5 * (before[1] + after[1]) * (s - s0)];
                work += a + b;
                moved += a.abs() + b.abs();
            }
        }
        prop_assert!(work >= -1e-4 * moved, "{work} J of {moved} J");
    }
}

#[test]
fn a_seal_without_torque_slides_again_along_the_axis() {
    let trocar = turning(ElementParams::plausible_10_5_mm().unwrap(), ROTATION);
    let mut state = trocar.rest(0.0);
    trocar.turn_to(&mut state, 0.02, 6.0, 0.4);
    assert!(state.torque() > 0.01);
    for k in 1..=5000 {
        trocar.step_to(&mut state, 0.02 + 2e-5 * f64::from(k), PERIOD);
    }
    assert!(state.torque() < 1e-3 * 0.015, "{} N m", state.torque());
    assert!((state.force() - (3.0 + 5.0 * 0.02)).abs() < 1e-3);
    assert_eq!(state.deformation().unwrap().mode, Mode::Sliding);
}

/// Times, positions, arcs and both forces of a set of `reference/`, and its parameters.
fn reference(name: &str) -> (Vec<[f64; 5]>, serde_json::Value) {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../reference/vectors");
    let text = std::fs::read_to_string(format!("{folder}/{name}.csv")).unwrap();
    let numbers = |line: &str| -> [f64; 5] {
        let numbers: Vec<f64> = line.split(',').map(|word| word.parse().unwrap()).collect();
        numbers.try_into().unwrap()
    };
    let rows = text.lines().skip(1).map(numbers).collect();
    let text = std::fs::read_to_string(format!("{folder}/parameters.json")).unwrap();
    (rows, serde_json::from_str::<serde_json::Value>(&text).unwrap()[name].clone())
}

/// Forces at the rows, each interval in `parts`.
fn along(trocar: &Trocar, rows: &[[f64; 5]], parts: usize) -> Vec<[f64; 2]> {
    let period = rows[1][0] - rows[0][0];
    let path = |t: f64| {
        let row = rows[(t / period).round() as usize];
        [row[1], row[2]]
    };
    let mut forces = vec![[0.0; 2]];
    forces.extend(run(trocar, &path, rows.len() - 1, period, parts));
    forces
}

fn expected(rows: &[[f64; 5]]) -> Vec<[f64; 2]> {
    rows.iter().map(|row| [row[3], row[4]]).collect()
}

/// Maxwell-slip elements in two directions, by OpenSees; without β the step knows no time, so equal
/// ones will do.
#[test]
fn opensees_agrees() {
    for name in ["turning_one", "turning_four"] {
        let (mut rows, set) = reference(name);
        rows.iter_mut().enumerate().for_each(|(k, row)| row[0] = k as f64);
        for (parts, tolerance) in [(1, 5e-3), (512, 5e-6)] {
            let mut sum = vec![[0.0; 2]; rows.len()];
            for element in set["elements"].as_array().unwrap() {
                let number = |key: &str| element[key].as_f64().unwrap();
                let (stiffness, limit) = (number("stiffness_n_m"), number("limit_force_n"));
                let sliding = SlidingFriction::coulomb(limit, 0.0);
                let seal = DeformationForce::linear(stiffness, limit / stiffness).unwrap();
                let rotation = Rotation { circumferential_stiffness: stiffness, ..ROTATION };
                let own = turning(ElementParams::new(seal, sliding, sliding), rotation);
                for (sum, force) in sum.iter_mut().zip(along(&own, &rows, parts)) {
                    *sum = [sum[0] + force[0], sum[1] + force[1]];
                }
            }
            let difference = worst(&sum, &expected(&rows));
            println!("{name}: {difference:.1e} N in {parts} parts");
            assert!(difference < tolerance, "{name} in {parts} parts: {difference} N");
        }
    }
}

/// A seal that snaps through while it turns, by SciPy.
#[test]
fn scipy_agrees_where_the_seal_snaps() {
    let (rows, set) = reference("turning_snap");
    let number = |key: &str| set[key].as_f64().unwrap();
    let width = number("half_width_m");
    let monomial: Vec<f64> =
        set["monomial"].as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect();
    let piece = |from, to| Piece::from_monomial(from, to, &monomial).unwrap();
    let branch = Branch::new(piece(-width, 0.0), piece(0.0, width)).unwrap();
    let sliding =
        SlidingFriction::coulomb(number("coulomb_force_n"), number("viscous_damping_n_s_m"));
    let seal = DeformationForce::new(branch, branch, None).unwrap();
    let circumferential_stiffness = number("circumferential_stiffness_n_m");
    let trocar = turning(
        ElementParams::new(seal, sliding, sliding),
        Rotation { circumferential_stiffness, ..ROTATION },
    );
    // The samples are 10 ms apart.
    for (parts, tolerance) in [(10, 5e-3), (1000, 2e-6)] {
        let difference = worst(&along(&trocar, &rows, parts), &expected(&rows));
        println!("turning_snap: {difference:.1e} N in {parts} parts");
        assert!(difference < tolerance, "in {parts} parts: {difference} N");
    }
}
