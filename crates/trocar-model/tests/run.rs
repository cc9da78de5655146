//! Whole arrays give the bits of the step, sample by sample, for every model and every motion.

use proptest::prelude::*;
use trocar_model::{
    BoucWen, BoucWenParams, Classical, Dahl, DahlParams, Element, ElementParams, Gms, GmsElement,
    Leuven, LeuvenParams, LuGre, LuGreParams, MaxwellSlip, PositionProfile, Relaxation,
    RelaxationArm, Seal, SlidingFriction, SlipElement, SlipRate, Stages, StaticFriction,
    StribeckCurve, Trocar, TrocarState,
};

const OFFSET: [f64; 3] = [0.1, -0.2, 0.05];
const GAIN: [f64; 3] = [0.9, 1.05, 1.0];

fn sliding(stribeck_exponent: f64) -> SlidingFriction {
    SlidingFriction { static_force: 3.0, stribeck_exponent, ..SlidingFriction::coulomb(2.0, 4.0) }
}

fn lugre(sliding: SlidingFriction, damping_velocity: f64, curve: StribeckCurve) -> Seal {
    let params =
        LuGreParams { stiffness: 900.0, micro_damping: 3.0, damping_velocity, sliding, curve };
    Classical::LuGre(LuGre::new(params).unwrap()).into()
}

fn bank(count: u32) -> Vec<SlipElement> {
    let element = |k: u32| SlipElement {
        stiffness: 4000.0 / f64::from(k),
        limit_force: 0.1 + 0.05 * f64::from(k),
    };
    (1..=count).map(element).collect()
}

fn maxwell_slip(count: u32, viscous_damping: f64) -> Seal {
    Classical::MaxwellSlip(MaxwellSlip::new(&bank(count), viscous_damping).unwrap()).into()
}

/// Models with a loop of their own in every shape, and all others.
fn seals() -> Vec<Seal> {
    let (constant, exponential, rational) =
        (f64::INFINITY, StribeckCurve::Exponential, StribeckCurve::Rational);
    let plausible = ElementParams::plausible_10_5_mm().unwrap();
    let relaxation =
        Relaxation { arms: [RelaxationArm { stiffness: 50.0, time: 0.3 }, RelaxationArm::NONE] };
    let slow = ElementParams { creep_velocity: 1e-4, friction_lag: 0.02, relaxation, ..plausible };
    let elements = [plausible, slow].map(|params| Element::new(params).unwrap());
    let gms = GmsElement { stiffness: 200.0, share: 0.5, attraction: 0.1, damping: 0.5 };
    let dahl =
        DahlParams { stiffness: 500.0, coulomb_force: 2.0, exponent: 1.3, viscous_damping: 1.0 };
    let bouc_wen = BoucWenParams {
        stiffness: 500.0,
        coulomb_force: 2.0,
        exponent: 1.3,
        unloading_shape: 0.8,
        viscous_damping: 1.0,
    };
    let leuven = LeuvenParams { sliding: sliding(2.0), exponent: 0.9, micro_damping: 1.0 };
    let others = [
        Classical::Static(StaticFriction::new(sliding(2.0)).unwrap()),
        Classical::Dahl(Dahl::new(dahl).unwrap()),
        Classical::BoucWen(BoucWen::new(bouc_wen).unwrap()),
        Classical::Leuven(Leuven::new(&bank(16), leuven).unwrap()),
        Classical::Gms(Gms::new(&[gms, gms], sliding(1.0), SlipRate::Limited).unwrap()),
    ];
    let own = [
        lugre(sliding(2.0), constant, exponential),
        lugre(sliding(2.0), 0.02, exponential),
        lugre(sliding(1.3), constant, exponential),
        lugre(sliding(2.0), 0.05, rational),
        // The deflection reaches its bound in every slide.
        lugre(SlidingFriction::coulomb(2.0, 1.0), constant, exponential),
        lugre(SlidingFriction::coulomb(2.0, 1e306), constant, exponential),
        maxwell_slip(1, 0.0),
        maxwell_slip(4, 2.0),
        maxwell_slip(5, 2.0),
        maxwell_slip(8, 0.0),
        maxwell_slip(16, 1e306),
    ];
    let ems = [elements[0].into(), Seal::Ems(Stages::new(&elements).unwrap())];
    own.into_iter().chain(others.map(Seal::from)).chain(ems).collect()
}

/// Ways and durations: slow and fast, holds, reversals, and now and then what a step refuses.
fn motions() -> impl Strategy<Value = Vec<(f64, f64)>> {
    let sign = prop_oneof![Just(-1.0), Just(1.0)];
    let way = prop_oneof![
        30 => (sign, -9.0..-2.0_f64).prop_map(|(sign, decade)| sign * 10_f64.powf(decade)),
        4 => prop_oneof![Just(0.0), Just(-0.0)],
    ];
    let refused = prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(1e300), Just(f64::MAX)];
    let duration = prop_oneof![10 => Just(1e-3), 3 => 1e-6..1.0_f64];
    let no_duration = prop_oneof![Just(0.0), Just(-1.0), Just(f64::NAN), Just(f64::INFINITY)];
    let steady = (way.clone(), duration.clone(), 1..80_usize)
        .prop_map(|(way, duration, n)| vec![(way, duration); n]);
    let varied = prop::collection::vec((way.clone(), duration.clone()), 1..80);
    let odd = prop_oneof![
        (refused, duration).prop_map(|step| vec![step]),
        (way, no_duration).prop_map(|s| vec![s])
    ];
    prop::collection::vec(prop_oneof![6 => steady, 6 => varied, 1 => odd], 1..12)
        .prop_map(|parts| parts.concat())
}

fn positions(start: f64, motion: &[(f64, f64)]) -> (Vec<f64>, Vec<f64>) {
    let mut x = start;
    motion
        .iter()
        .map(|(way, duration)| {
            // What is refused does not move on.
            let to = x + way;
            x = if way.abs() < 1.0 { to } else { x };
            (to, *duration)
        })
        .unzip()
}

fn bits(state: &TrocarState) -> Vec<u64> {
    state.to_numbers().iter().map(|number| number.to_bits()).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn an_array_has_the_bits_of_the_step(motion in motions(), with_profile: bool, force in -4.0..4.0_f64) {
        let profile = PositionProfile::new(-0.02, 0.03, OFFSET.as_slice(), GAIN.as_slice()).ok();
        let (positions, durations) = positions(0.01, &motion);
        for (index, seal) in seals().into_iter().enumerate() {
            let trocar = Trocar::new(seal, profile.filter(|_| with_profile));
            let (mut one, mut all) = (trocar.rest_at_force(0.01, force), trocar.rest_at_force(0.01, force));
            let mut forces = vec![f64::NAN; positions.len()];
            trocar.run(&mut all, &positions, &durations, &mut forces);
            for (sample, ((x, t), found)) in positions.iter().zip(&durations).zip(&forces).enumerate() {
                let expected = trocar.step_to(&mut one, *x, *t);
                prop_assert_eq!(expected.to_bits(), found.to_bits(), "model {}, sample {}", index, sample);
            }
            prop_assert_eq!(bits(&one), bits(&all), "model {}", index);
        }
    }
}

#[test]
fn the_shortest_slice_counts() {
    let trocar = Trocar::of_seal(maxwell_slip(4, 2.0));
    let (positions, durations): (Vec<f64>, Vec<f64>) =
        (0..100).map(|k| (1e-5 * f64::from(k), 1e-3)).unzip();
    let mut forces = [f64::NAN; 70];
    let mut state = trocar.rest(0.0);
    trocar.run(&mut state, &positions, &durations[..65], &mut forces);
    assert_eq!(state.position(), positions[64]);
    assert!(forces[64] == state.force() && forces[65..].iter().all(|force| force.is_nan()));
    trocar.run(&mut state, &[], &[], &mut []);
    assert_eq!(state.position(), positions[64]);
}
