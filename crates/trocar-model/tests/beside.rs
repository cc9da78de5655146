//! Models stepped beside one that differs little from them go where their own steps take them: their forces differ from its by the
//! derivative of the force.

use trocar_model::{
    Element, ElementParams, Friction, ParamError, Relaxation, SealDamping, SlidingFriction, Stages, StagesState,
};

type Params = Result<ElementParams, ParamError>;

fn with_stribeck(params: ElementParams, viscous_damping: f64) -> ElementParams {
    let fall = |sliding: SlidingFriction| SlidingFriction {
        coulomb_force: 0.9 * sliding.static_force,
        stribeck_exponent: 1.4,
        stribeck_velocity: 0.01,
        viscous_damping,
        ..sliding
    };
    ElementParams { insertion: fall(params.insertion), withdrawal: fall(params.withdrawal), ..params }
}

fn creeping() -> Params {
    Ok(ElementParams { creep_velocity: 2e-4, ..ElementParams::plausible_10_5_mm()? })
}

fn damped() -> Params {
    Ok(ElementParams { damping: SealDamping::constant(2.0), ..ElementParams::plausible_10_5_mm()? })
}

/// Friction that falls with speed faster than damping makes up for.
fn folded() -> Params {
    Ok(with_stribeck(ElementParams::plausible_10_5_mm()?, 6.0))
}

fn all_terms() -> Params {
    let damping = SealDamping::constant(1.0);
    let relaxation = Relaxation::single(60.0, 0.3);
    let plausible = with_stribeck(ElementParams::plausible_10_5_mm()?, 6.0);
    Ok(ElementParams { damping, creep_velocity: 3e-4, friction_lag: 0.02, relaxation, ..plausible })
}

/// The element with its `k`th number times `factor`.
fn changed(mut params: ElementParams, k: usize, factor: f64) -> Stages {
    let [insertion, withdrawal] = [&mut params.insertion, &mut params.withdrawal];
    match k {
        0 => [insertion, withdrawal].map(|s| s.viscous_damping *= factor),
        1 => [insertion, withdrawal].map(|s| s.stribeck_velocity *= factor),
        2 => [params.creep_velocity *= factor, ()],
        3 => [params.friction_lag *= factor, ()],
        4 => [params.damping.coefficients[0] *= factor, ()],
        5 => [params.relaxation.arms[0].stiffness *= factor, ()],
        _ => [params.relaxation.arms[0].time *= factor, ()],
    };
    Element::new(params).unwrap().into()
}

const NUMBERS: usize = 7;
/// Factors for the derivative by steps alone, and beside.
const ALONE: f64 = 0.03;
const BESIDE: f64 = 1e-4;

/// Strokes, small reversals and tremor as of a coarse encoder: displacement (m) and duration (s).
fn motion() -> impl Iterator<Item = (f64, f64)> {
    let mut seed = 1_u64;
    let mut tremor = move || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (seed >> 40) as f64 / (1 << 24) as f64 - 0.5
    };
    (0..20_000).map(move |i| {
        let t = 2e-3 * f64::from(i);
        let velocity = 0.06 * (2.0 * t).sin() + 0.03 * (13.0 * t).sin() + 2e-3 * tremor();
        (2e-3 * velocity, 2e-3)
    })
}

fn alone(model: &Stages) -> Vec<f64> {
    let mut state = model.rest_state(0.0);
    motion().map(|(displacement, duration)| model.step(&mut state, displacement, duration)).collect()
}

fn beside(model: &Stages, other: &Stages) -> (Vec<f64>, StagesState) {
    let mut state = model.rest_state(0.0);
    let mut beside = [model.beside(&state, other, other.rest_state(0.0))];
    let forces = motion().map(|(displacement, duration)| {
        model.step_beside(&mut state, &mut beside, displacement, duration);
        beside[0].force()
    });
    (forces.collect(), state)
}

fn rms(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    (values.map(|v| v * v).sum::<f64>() / count).sqrt()
}

#[test]
fn differences_are_derivatives() {
    for (name, params) in [("creep", creeping()), ("damping", damped()), ("all terms", all_terms())] {
        let params = params.unwrap();
        let model = changed(params, 0, 1.0);
        let force = alone(&model);
        for k in 0..NUMBERS {
            let [more, less] = [1.0 + ALONE, 1.0 - ALONE].map(|factor| alone(&changed(params, k, factor)));
            let true_rate = |i: usize| (more[i] - less[i]) / (2.0 * ALONE);
            let own = beside(&model, &changed(params, k, 1.0 + BESIDE)).0;
            let error = |i: usize| (own[i] - force[i]) / BESIDE - true_rate(i);
            let [error, rate] = [rms((0..force.len()).map(error)), rms((0..force.len()).map(true_rate))];
            assert!(error < 0.002 + 0.2 * rate, "{name}, number {k}: {error} N of {rate} N");
        }
    }
}

/// Where one force has several slip speeds, and the seal sticks and slips by itself, what a search leaves would grow: a model that
/// differs in nothing that counts stays beside the other.
#[test]
fn nothing_grows_on_a_folded_law() {
    let params = folded().unwrap();
    let [model, other] = [1.0, 2.0].map(|factor| changed(params, 6, factor));
    let (forces, state) = beside(&model, &other);
    let apart = forces.iter().zip(alone(&model)).map(|(beside, alone)| (beside - alone).abs()).fold(0.0, f64::max);
    assert!(apart < 1e-9, "{apart} N apart");
    assert_eq!(Stages::force(&state), *alone(&model).last().unwrap(), "the leader takes its own steps");
}

#[test]
fn what_is_shared_is_stepped_once() {
    let element = Element::new(all_terms().unwrap()).unwrap();
    let faster = Element::new(creeping().unwrap()).unwrap();
    let slower = Element::new(ElementParams { creep_velocity: 2.001e-4, ..creeping().unwrap() }).unwrap();
    let [model, other] = [faster, slower].map(|second| Stages::new(&[element, second]).unwrap());
    let (mut state, own) = (model.rest_state(0.0), other.rest_state(0.0));
    let mut beside = [model.beside(&state, &other, own), model.beside(&state, &model, own)];
    for (displacement, duration) in motion() {
        model.step_beside(&mut state, &mut beside, displacement, duration);
        assert_eq!(beside[0].state().states()[0], state.states()[0]);
        assert_eq!(beside[1].state(), &state);
    }
    assert_ne!(beside[0].state().states()[1], state.states()[1]);
}

/// A model with more or fewer elements than the one that leads takes its own steps where there is none to follow.
#[test]
fn numbers_of_elements_may_differ() {
    let element = Element::new(creeping().unwrap()).unwrap();
    let one = Stages::from(element);
    let two = Stages::new(&[element, element]).unwrap();
    assert_eq!(beside(&one, &two).0, alone(&two));
    assert_eq!(beside(&two, &one).0, alone(&one));
}
