//! What one step promises, over random models of every kind and random motions: the force obeys the
//! law of the contact, it is bounded, and it changes no faster than the seal's stiffness allows,
//! but for what one change between deforming and sliding can give.
//!
//! `TROCAR_PROMISE_STEPS` sets the number of steps (1e8 take a minute with `--release`).

use crate::classical::{bouc_wens, dahls, lugres, slidings};
use crate::common::promise::{Limits, Motion, Past};
use crate::common::seals;
use crate::maxwell::{banks, gms_elements, leuvens, slip_rates};
use proptest::prelude::*;
use proptest::strategy::ValueTree as _;
use proptest::test_runner::TestRunner;
use trocar_model::batch::{Batch, Forces, LANES, Lanes, blocks};
use trocar_model::{
    BoucWen, Classical, Dahl, Direction, Element, ElementParams, Friction, Gms, LuGre, MaxwellSlip,
    Relaxation, RelaxationArm, Seal, SealDamping, SealState, SlidingFriction, Stages, State,
    StaticFriction,
};

/// Steps that one model makes under one motion.
const RUN: usize = 2000;

/// Largest residual of the contact's law, as a fraction of the static force and the force: a search
/// stops at 1e-9 of the former; the rest is rounding.
const LAW: f64 = 2e-9;

/// Rounding of forces, as a fraction of the largest one at work.
const ROUNDING: f64 = 1e-7;

/// The element of a random shape with random further terms, each in half of them.
fn elements() -> impl Strategy<Value = Element> {
    let sliding = (slidings(), slidings(), any::<[bool; 6]>());
    let further = (1e-6..2e-3_f64, 1e-4..0.1_f64, 0.0..400.0_f64, 0.02..5.0_f64, 0.0..5.0_f64);
    (seals(), 0.0..0.8_f64, sliding, further).prop_map(
        |(mut shape, hump, (first, second, has), (creep, lag, stiffness, time, sigma))| {
            if has[0] {
                shape.bends = shape.bends.map(|bend| bend + hump);
            }
            let params = shape.params();
            let fall = |own: SlidingFriction, curve: SlidingFriction| SlidingFriction {
                coulomb_force: own.static_force * (curve.coulomb_force / curve.static_force),
                static_force: own.static_force,
                viscous_damping: own.viscous_damping + 0.01,
                ..curve
            };
            let mut params = ElementParams { ..params };
            if has[1] {
                params.insertion = fall(params.insertion, first);
                params.withdrawal = fall(params.withdrawal, second);
            }
            if has[2] {
                params.damping = SealDamping { coefficients: [sigma, 20.0 * sigma, 100.0 * sigma] };
            }
            if has[3] {
                params.relaxation =
                    Relaxation { arms: [RelaxationArm { stiffness, time }, RelaxationArm::NONE] };
            }
            if has[4] {
                params.creep_velocity = creep;
                params.friction_lag = if has[5] { lag } else { 0.0 };
            }
            Element::new(params).unwrap()
        },
    )
}

/// A model of any kind: up to three elements in parallel, or a classical one.
fn models() -> impl Strategy<Value = Seal> {
    let stages = prop::collection::vec(elements(), 1..=3)
        .prop_map(|elements| Seal::from(Stages::new(&elements).unwrap()));
    let gms = (gms_elements(true), slidings(), slip_rates());
    prop_oneof![
        12 => stages,
        1 => slidings().prop_map(|s| Classical::Static(StaticFriction::new(s).unwrap()).into()),
        1 => dahls().prop_map(|p| Classical::Dahl(Dahl::new(p).unwrap()).into()),
        1 => bouc_wens().prop_map(|p| Classical::BoucWen(BoucWen::new(p).unwrap()).into()),
        1 => lugres().prop_map(|p| Classical::LuGre(LuGre::new(p).unwrap()).into()),
        1 => leuvens().prop_map(|model| Classical::Leuven(model).into()),
        1 => (banks(), 0.0..20.0_f64)
            .prop_map(|(b, beta)| Classical::MaxwellSlip(MaxwellSlip::new(&b, beta).unwrap()).into()),
        1 => gms.prop_map(|(e, s, rate)| Classical::Gms(Gms::new(&e, s, rate).unwrap()).into()),
    ]
}

/// By how much the law of the contact is missed after a step, N.
fn missed(element: &Element, state: &State) -> f64 {
    let params = element.params();
    let (u, force) = (state.slip_velocity().abs(), state.force());
    let outside = |low: f64, high: f64, value: f64| (low - value).max(value - high).max(0.0);
    let direction =
        if state.slip_velocity() < 0.0 { Direction::Withdrawal } else { Direction::Insertion };
    let sliding = params.sliding(direction);
    if u == 0.0 {
        let (low, high) = (-params.withdrawal.static_force, params.insertion.static_force);
        return outside(low, high, force);
    }
    let built = if params.creep_velocity > 0.0 { u / u.hypot(params.creep_velocity) } else { 1.0 };
    let contact = direction.sign() * force - sliding.viscous_damping * u;
    if params.friction_lag > 0.0 {
        return outside(sliding.coulomb_force * built, sliding.static_force * built, contact);
    }
    (contact - sliding.level(u) * built).abs()
}

/// Runs `model` along `steps` and checks each; returns the forces.
fn check(model: &Seal, steps: &[(f64, f64)]) -> Vec<f64> {
    let (limits, mut state, mut past) = (Limits::of(model), model.rest(), Past::default());
    let mut forces = Vec::with_capacity(steps.len());
    for (k, step) in steps.iter().enumerate() {
        let before = state;
        forces.push(model.step(&mut state, step.0, step.1));
        past = past.after(*step);
        let bounds = limits.each(&past);
        let (from, to) = (forces_of(&before), forces_of(&state));
        for ((bounds, from), to) in bounds.iter().zip(&from).zip(&to) {
            assert!(
                bounds.hold(*from, *to, ROUNDING),
                "step {k}, {step:?}: {from} N to {to} N, {bounds:?}\n{before:?}\n{state:?}\n{model:?}"
            );
        }
        if let (Seal::Ems(stages), SealState::Ems(states)) = (model, &state) {
            for (element, own) in stages.elements().iter().zip(states.states()) {
                let allowed = LAW * (element.params().insertion.static_force + own.force().abs());
                let missed = missed(element, own);
                assert!(missed <= allowed, "step {k}, {step:?}: {missed} N\n{before:?}\n{model:?}");
            }
        }
    }
    forces
}

/// Of each element, or of the classical model, N.
fn forces_of(state: &SealState) -> Vec<f64> {
    match state {
        SealState::Ems(states) => states.states().iter().map(State::force).collect(),
        SealState::Classical(_) => vec![Seal::force(state)],
    }
}

#[test]
fn each_step_obeys_the_law_and_its_bounds_alone_and_in_a_batch() {
    let wanted = std::env::var("TROCAR_PROMISE_STEPS").map_or(3e5, |n| n.parse().unwrap());
    let mut runner = TestRunner::deterministic();
    let mut draw = || models().new_tree(&mut runner).unwrap().current();
    for seed in 0..(wanted / (RUN * LANES) as f64).ceil() as u64 {
        let models: Vec<Seal> = (0..LANES).map(|_| draw()).collect();
        let steps = Motion::new(seed).steps(RUN);
        let alone: Vec<Vec<f64>> = models.iter().map(|model| check(model, &steps)).collect();
        let mut states: Vec<SealState> = models.iter().map(Seal::rest).collect();
        let mut places = [Lanes::EMPTY; blocks(LANES)];
        let mut forces = vec![0.0; LANES * RUN];
        let mut batch = Batch::new(&models, &mut states, &mut places).unwrap();
        batch.run(steps.iter().copied(), &mut Forces::new(LANES, &mut forces));
        for (k, together) in forces.chunks(LANES).enumerate() {
            for (force, alone) in together.iter().zip(&alone) {
                assert_eq!(force.to_bits(), alone[k].to_bits(), "step {k} in a batch");
            }
        }
    }
}
