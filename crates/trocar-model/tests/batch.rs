//! A batch gives what each of its models gives alone, to the last bit.

use crate::common;
use proptest::prelude::*;
use trocar_model::batch::{Batch, Forces, LANES, Lanes, Many, Squares, blocks};
use trocar_model::{
    Classical, Dahl, DahlParams, Element, ElementParams, Gms, GmsElement, Leuven, LeuvenParams,
    LuGre, LuGreParams, MaxwellSlip, Relaxation, Seal, SealDamping, SlidingFriction, SlipElement,
    SlipRate, Stages, StaticFriction, StribeckCurve,
};

/// Displacement (m) and duration (s) of a step: creeping, tremor, strides over the whole seal,
/// jumps, holds, no time, and what is no number.
fn steps() -> impl Strategy<Value = Vec<(f64, f64)>> {
    let step = prop_oneof![
        12 => (-2e-4..2e-4, 1e-4..2e-3),
        6 => (-2e-2..2e-2, 1e-4..2e-3),
        2 => (-1.0..1.0, 1e-6..1e2),
        2 => (Just(0.0), 1e-3..1e-2),
        1 => (-1e-3..1e-3, Just(0.0)),
        1 => prop_oneof![
            Just((f64::NAN, 1e-3)),
            Just((1e-3, f64::NAN)),
            Just((f64::INFINITY, 1e-3)),
            Just((1e-3, f64::INFINITY)),
            Just((1e-3, -1e-3)),
            Just((1e300, 1e-300)),
            Just((1e305, 1.0)),
            Just((-1e305, 1.0)),
            Just((-0.0, 1e-3)),
            Just((1e-320, 1e-3)),
        ],
    ];
    // Runs of the same step: so that lanes slide for a while, then turn back.
    prop::collection::vec((step, 1_usize..30), 1..30).prop_map(|runs| {
        runs.into_iter().flat_map(|(step, count)| std::iter::repeat_n(step, count)).collect()
    })
}

/// What an element is made of beside its seal: 0 to 3 without viscous damping, or with a law that
/// no lane can run.
fn element(seal: &common::Seal, kind: u8) -> Element {
    let params = seal.params();
    let [insertion, withdrawal] = [params.insertion, params.withdrawal];
    let dry = |sliding: SlidingFriction| SlidingFriction { viscous_damping: 0.0, ..sliding };
    let params = match kind {
        0..=3 => ElementParams { insertion: dry(insertion), withdrawal: dry(withdrawal), ..params },
        4 => ElementParams { insertion: dry(insertion), ..params },
        5 => ElementParams { damping: SealDamping::constant(1.5), ..params },
        6 => ElementParams { creep_velocity: 1e-4, ..params },
        7 => ElementParams { relaxation: Relaxation::single(60.0, 0.3), ..params },
        8 => {
            let fall = |s: SlidingFriction| SlidingFriction {
                coulomb_force: 0.8 * s.static_force,
                stribeck_exponent: 1.4,
                viscous_damping: s.viscous_damping + 0.1,
                ..s
            };
            let (creep_velocity, friction_lag) = (2e-4, 0.02);
            let relaxation = Relaxation::single(60.0, 0.3);
            let (insertion, withdrawal) = (fall(insertion), fall(withdrawal));
            ElementParams {
                insertion,
                withdrawal,
                creep_velocity,
                friction_lag,
                relaxation,
                ..params
            }
        }
        _ => params,
    };
    Element::new(params).unwrap()
}

fn same(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())
}

/// Runs `models` alone and as a batch, step by step and in one go, and compares forces bit by bit,
/// and states.
fn compare<M: Many>(models: &[M], states: &[M::State], steps: &[(f64, f64)])
where
    M::State: PartialEq,
{
    let mut alone = states.to_vec();
    let (mut one, mut other) = (states.to_vec(), states.to_vec());
    let mut places = vec![Lanes::EMPTY; blocks(models.len())];
    let mut more_places = places.clone();
    let mut batch = Batch::new(models, &mut one, &mut places).unwrap();
    let mut expected = Vec::new();
    for (k, (displacement, duration)) in steps.iter().enumerate() {
        batch.step(*displacement, *duration);
        for (i, (model, state)) in models.iter().zip(&mut alone).enumerate() {
            let force = model.step(state, *displacement, *duration);
            assert!(
                same(batch.force(i), force),
                "step {k}, model {i}: {} for {force}",
                batch.force(i)
            );
            assert_eq!(batch.state(i), Some(*state), "step {k}, model {i}");
            expected.push(force);
        }
    }
    batch.finish();
    assert_eq!(one, alone);
    let mut forces = vec![0.0; expected.len()];
    let mut run = Batch::new(models, &mut other, &mut more_places).unwrap();
    run.run(steps.iter().copied(), &mut Forces::new(models.len(), &mut forces));
    run.finish();
    assert!(forces.iter().zip(&expected).all(|(a, b)| same(*a, *b)));
    assert_eq!(other, alone);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn elements_side_by_side_have_the_bits_of_each_alone(
        seals in prop::collection::vec((common::seals(), 0_u8..12), 1..40),
        deflections in prop::collection::vec((-2e-2_f64..2e-2, -3.0_f64..3.0), 40),
        steps in steps(),
    ) {
        let elements: Vec<Element> = seals.iter().map(|(seal, kind)| element(seal, *kind)).collect();
        let states: Vec<_> = elements.iter().zip(&deflections).map(|(e, (z, q))| e.state(*z, *q)).collect();
        compare(&elements, &states, &steps);
    }

    #[test]
    fn seals_of_all_kinds_go_together(
        seals in prop::collection::vec((common::seals(), 0_u8..18), 6..40),
        steps in steps(),
    ) {
        let seals: Vec<Seal> = seals.iter().map(|(seal, kind)| any_seal(element(seal, *kind), *kind)).collect();
        let states: Vec<_> = seals.iter().map(Seal::rest).collect();
        compare(&seals, &states, &steps);
    }
}

/// One element, two in parallel, or a classical model of each kind.
fn any_seal(element: Element, kind: u8) -> Seal {
    let sliding = SlidingFriction::coulomb(2.0, 3.0);
    let lugre = LuGreParams {
        stiffness: 900.0,
        micro_damping: 3.0,
        damping_velocity: f64::INFINITY,
        sliding,
        curve: StribeckCurve::Exponential,
    };
    let bank = [3.0, 1.0, 2.0].map(|k| SlipElement { stiffness: 300.0 * k, limit_force: 0.8 * k });
    let part = |share| GmsElement { stiffness: 200.0, share, attraction: 0.1, damping: 0.5 };
    let classical = match kind {
        12 => Classical::Static(StaticFriction::new(sliding).unwrap()),
        13 => {
            let params = DahlParams {
                stiffness: 500.0,
                coulomb_force: 2.0,
                exponent: 1.3,
                viscous_damping: 1.0,
            };
            Classical::Dahl(Dahl::new(params).unwrap())
        }
        14 => {
            let params = LeuvenParams { sliding, exponent: 0.9, micro_damping: 1.0 };
            Classical::Leuven(Leuven::new(&bank, params).unwrap())
        }
        15 => Classical::MaxwellSlip(MaxwellSlip::new(&bank, 2.0).unwrap()),
        16 => {
            Classical::Gms(Gms::new(&[part(0.4), part(0.6)], sliding, SlipRate::Limited).unwrap())
        }
        _ => Classical::LuGre(LuGre::new(lugre).unwrap()),
    };
    match kind {
        9 => Seal::Ems(Stages::new(&[element, element]).unwrap()),
        10 | 12..=16 => Seal::Classical(classical),
        _ => element.into(),
    }
}

fn plausible(viscous_damping: f64, static_ratio: f64) -> Element {
    let params = ElementParams::plausible_10_5_mm().unwrap();
    let sliding = |old: SlidingFriction| SlidingFriction {
        viscous_damping,
        coulomb_force: old.static_force / static_ratio,
        ..old
    };
    Element::new(ElementParams {
        insertion: sliding(params.insertion),
        withdrawal: sliding(params.withdrawal),
        ..params
    })
    .unwrap()
}

fn vectorised(elements: &[Element]) -> usize {
    let mut states: Vec<_> = elements.iter().map(|e| e.rest_state(0.0)).collect();
    let mut places = vec![Lanes::EMPTY; blocks(elements.len())];
    Batch::new(elements, &mut states, &mut places).unwrap().vectorised()
}

#[test]
fn constant_friction_runs_as_vectors_and_the_stribeck_curve_does_not() {
    let (dry, wet, stribeck) = (plausible(0.0, 1.0), plausible(5.0, 1.0), plausible(5.0, 1.3));
    assert_eq!(vectorised(&[dry; 104]), 104);
    assert_eq!(vectorised(&[wet; 104]), 104);
    assert_eq!(vectorised(&[stribeck; 104]), 0);
    assert_eq!(vectorised(&[dry, wet, stribeck].repeat(LANES)), 2 * LANES);
    assert_eq!(vectorised(&[dry]), 0, "one alone is faster alone");
}

#[test]
fn squares_are_those_of_the_forces() {
    let elements: Vec<Element> = (0..37).map(|k| plausible(0.3 * f64::from(k), 1.0)).collect();
    let states: Vec<_> = elements.iter().map(|e| e.rest_state(0.0)).collect();
    let motion = (0..4000).map(|k| (3e-4 * f64::sin(f64::from(k) * 0.01), 1e-3));
    let measured: Vec<f64> = (0..3999).map(|k| 2.0 * f64::cos(f64::from(k) * 0.01)).collect();
    let mut expected = [0.0; 37];
    for ((element, state), sum) in elements.iter().zip(&states).zip(&mut expected) {
        let mut state = *state;
        let forces = motion
            .clone()
            .map(|(displacement, duration)| element.step(&mut state, displacement, duration));
        *sum = measured.iter().zip(forces).fold(0.0, |sum, (m, f)| sum + (m - f) * (m - f));
    }
    let (mut own, mut places, mut sums) =
        (states.clone(), vec![Lanes::EMPTY; blocks(37)], vec![0.0; 37]);
    let mut batch = Batch::new(&elements, &mut own, &mut places).unwrap();
    batch.run(motion, &mut Squares::new(&measured, &mut sums));
    assert_eq!(sums, expected);
}

#[test]
fn numbers_that_do_not_match_are_refused() {
    let elements = [plausible(0.0, 1.0); 20];
    let mut states = elements.map(|e| e.rest_state(0.0));
    assert!(Batch::new(&elements, &mut states[..19], &mut [Lanes::EMPTY; 2]).is_none());
    assert!(Batch::new(&elements, &mut states, &mut [Lanes::EMPTY; 1]).is_none());
    let batch = Batch::new(&elements, &mut states, &mut [Lanes::EMPTY; 2])
        .map(|batch| (batch.len(), batch.force(20)));
    assert!(batch.is_some_and(|(count, outside)| count == 20 && outside.is_nan()));
    assert!(Batch::<Element>::new(&[], &mut [], &mut []).is_some_and(|batch| batch.is_empty()));
}
