//! Models stepped beside one that differs little from them go where their own steps take them:
//! their forces differ from its by the derivative of the force.

use trocar_model::{
    Beside, Branch, DeformationForce, Direction, Element, ElementParams, Friction, Ordinate,
    ParamError, Piece, Relaxation, SealDamping, SlidingFriction, Stages, StagesState,
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
    ElementParams {
        insertion: fall(params.insertion),
        withdrawal: fall(params.withdrawal),
        ..params
    }
}

fn creeping() -> Params {
    Ok(ElementParams { creep_velocity: 2e-4, ..ElementParams::plausible_10_5_mm()? })
}

fn damped() -> Params {
    Ok(ElementParams { damping: SealDamping::constant(2.0), ..ElementParams::plausible_10_5_mm()? })
}

/// Friction that falls with speed faster than damping makes up for.
fn weakening() -> Params {
    Ok(with_stribeck(ElementParams::plausible_10_5_mm()?, 6.0))
}

fn resting() -> Params {
    Ok(ElementParams { dwell_force: 0.3, ..all_terms()? })
}

fn all_terms() -> Params {
    let damping = SealDamping::constant(1.0);
    let relaxation = Relaxation::single(60.0, 0.3);
    let plausible = with_stribeck(ElementParams::plausible_10_5_mm()?, 6.0);
    Ok(ElementParams { damping, creep_velocity: 3e-4, friction_lag: 0.02, relaxation, ..plausible })
}

/// The element with its `k`th number times `factor`.
fn changed(mut params: ElementParams, k: usize, factor: f64) -> Stages {
    // Width, height, bend of a piece, place of a join.
    let mut shape = [1.0; 4];
    if k < shape.len() {
        shape[k] = factor;
        params.deformation = reshaped(&params, shape);
    }
    for sliding in [&mut params.insertion, &mut params.withdrawal] {
        match k {
            1 => {
                (sliding.coulomb_force, sliding.static_force) =
                    (factor * sliding.coulomb_force, factor * sliding.static_force)
            }
            4 => {
                sliding.coulomb_force =
                    sliding.static_force - factor * (sliding.static_force - sliding.coulomb_force)
            }
            5 => sliding.viscous_damping *= factor,
            6 => sliding.stribeck_velocity *= factor,
            7 => sliding.stribeck_exponent *= factor,
            _ => {}
        }
    }
    match k {
        8 => params.creep_velocity *= factor,
        9 => params.friction_lag *= factor,
        10 => params.damping.coefficients[0] *= factor,
        11 => params.relaxation.arms[0].stiffness *= factor,
        12 => params.relaxation.arms[0].time *= factor,
        13 => params.dwell_force *= factor,
        _ => {}
    }
    Element::new(params).unwrap().into()
}

/// The deformation with its width, its forces, the bend of a piece and the place of a join changed.
fn reshaped(params: &ElementParams, [width, force, bend, join]: [f64; 4]) -> DeformationForce {
    let (insertion, withdrawal) = (params.deformation.insertion(), params.deformation.withdrawal());
    let branch = |branch: &Branch, bend: f64, join: f64| {
        let piece = |piece: &Piece, from: f64, to: f64, bend: f64| {
            let mut legendre = [0.0; 8];
            legendre.iter_mut().zip(piece.legendre()).for_each(|(own, its)| *own = force * its);
            // P_0 - P_2 is 0 at both ends.
            let more = 0.3 * (bend - 1.0);
            legendre[0] += more;
            legendre[2] -= more;
            Piece::new(width * from, width * to, &legendre).unwrap()
        };
        let (left, right, at) = (branch.left(), branch.right(), join * branch.join());
        Branch::new(piece(left, left.from(), at, bend), piece(right, at, right.to(), 1.0)).unwrap()
    };
    DeformationForce::new(branch(insertion, bend, join), branch(withdrawal, 1.0, 1.0), None)
        .unwrap()
}

const NUMBERS: usize = 14;
/// Relative changes for the derivative by steps alone, and beside. Both upwards: the least yield
/// stiffness that follows both branches has a kink.
const ALONE: f64 = 3e-4;
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
    motion()
        .map(|(displacement, duration)| model.step(&mut state, displacement, duration))
        .collect()
}

fn beside(model: &Stages, other: &Stages) -> (Vec<f64>, StagesState) {
    let mut state = model.rest_state(0.0);
    let start = [(other, other.rest_state(0.0))];
    let mut beside = model.beside(&state, 0, &start).expect("both have one element");
    let forces = motion().map(|(displacement, duration)| {
        model.lead(&mut state, displacement, duration, |part| beside.follow(&part))
            + beside.forces()[0]
    });
    (forces.collect(), state)
}

fn rms(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    (values.map(|v| v * v).sum::<f64>() / count).sqrt()
}

#[test]
fn differences_are_derivatives() {
    for (name, params) in [
        ("plain", ElementParams::plausible_10_5_mm()),
        ("creep", creeping()),
        ("damping", damped()),
        ("all terms", all_terms()),
        ("friction after rest", resting()),
    ] {
        let params = params.unwrap();
        let model = changed(params, 0, 1.0);
        let force = alone(&model);
        for k in 0..NUMBERS {
            let more = alone(&changed(params, k, 1.0 + ALONE));
            let true_rate = |i: usize| (more[i] - force[i]) / ALONE;
            let own = beside(&model, &changed(params, k, 1.0 + BESIDE)).0;
            let error = |i: usize| (own[i] - force[i]) / BESIDE - true_rate(i);
            let [error, rate] =
                [rms((0..force.len()).map(error)), rms((0..force.len()).map(true_rate))];
            assert!(error < 0.005 + 0.03 * rate, "{name}, number {k}: {error} N of {rate} N");
        }
    }
}

/// Where one force has several slip speeds, and the seal sticks and slips by itself, what a search
/// leaves would grow: a model that differs in nothing that counts stays beside the other.
#[test]
fn nothing_grows_on_a_multivalued_law() {
    let params = weakening().unwrap();
    let [model, other] = [1.0, 2.0].map(|factor| changed(params, 12, factor));
    let (forces, state) = beside(&model, &other);
    let apart = forces
        .iter()
        .zip(alone(&model))
        .map(|(beside, alone)| (beside - alone).abs())
        .fold(0.0, f64::max);
    assert!(apart < 1e-9, "{apart} N apart");
    assert_eq!(
        Stages::force(&state),
        *alone(&model).last().unwrap(),
        "the leader takes its own steps"
    );
}

#[test]
fn what_is_shared_is_stepped_once() {
    let element = Element::new(all_terms().unwrap()).unwrap();
    let faster = Element::new(creeping().unwrap()).unwrap();
    let slower =
        Element::new(ElementParams { creep_velocity: 2.001e-4, ..creeping().unwrap() }).unwrap();
    let [model, other] = [faster, slower].map(|second| Stages::new(&[element, second]).unwrap());
    let (mut state, own) = (model.rest_state(0.0), other.rest_state(0.0));
    let others = [(&other, own), (&model, own)];
    let mut beside =
        [0, 1].map(|stage| model.beside(&state, stage, &others).expect("two elements"));
    let state_of = |i: usize, beside: &[Beside], state: &StagesState| {
        let mut own = *state;
        beside.iter().for_each(|beside| beside.put_state(i, state, &mut own));
        own
    };
    for (displacement, duration) in motion() {
        model.lead(&mut state, displacement, duration, |part| {
            beside.iter_mut().for_each(|own| own.follow(&part));
        });
        assert_eq!(state_of(0, &beside, &state).states()[0], state.states()[0]);
        assert_eq!(state_of(1, &beside, &state), state);
    }
    assert_ne!(state_of(0, &beside, &state).states()[1], state.states()[1]);
}

#[test]
fn what_the_leader_does_not_have_is_not_followed() {
    let element = Element::new(creeping().unwrap()).unwrap();
    let one = Stages::from(element);
    let two = Stages::new(&[element, element]).unwrap();
    let [of_one, of_two] = [&one, &two].map(|model| model.rest_state(0.0));
    assert!(two.beside(&of_two, 1, &[(&one, of_one)]).is_none());
    assert!(one.beside(&of_one, 1, &[(&two, of_two)]).is_none());
    assert!(one.beside(&of_one, 0, &[]).is_none());
}

/// The element with a yield stiffness that does not depend on the branches, and the same with a
/// piece of the insertion branch bent by a part of `more` of what the forces are.
fn stiff_and_bent(params: ElementParams, more: f64) -> [Stages; 2] {
    let stiffness = 1.5 * params.deformation.yield_stiffness();
    [1.0, 1.0 + more].map(|bend| {
        let shape = reshaped(&params, [1.0, 1.0, bend, 1.0]);
        let deformation =
            DeformationForce::new(*shape.insertion(), *shape.withdrawal(), Some(stiffness))
                .unwrap();
        Element::new(ElementParams { deformation, ..params }).unwrap().into()
    })
}

/// Derivatives of the force by the ordinates of the insertion branch and the slope beyond -c, put
/// together to the change of the branch that `bent` has.
fn by_ordinates(model: &Stages, bent: &Stages, size: f64) -> Vec<f64> {
    const CELLS: usize = 200;
    let [own, its] = [model, bent].map(|m| m.first().params().deformation);
    let c = own.half_width();
    let spacing = 2.0 * c / CELLS as f64;
    let nodes = (1..CELLS).map(|k| k as f64 * spacing - c);
    let change: Vec<f64> = nodes
        .clone()
        .map(|z| (its.insertion().force(z) - own.insertion().force(z)) / size)
        .chain([(its.end_stiffness().1 - own.end_stiffness().1) / size])
        .collect();
    let mut ordinates: Vec<Ordinate> = nodes
        .map(|z| Ordinate::node(Direction::Insertion, z, spacing))
        .chain([Ordinate::end_slope(c)])
        .collect();
    let mut state = model.rest_state(0.0);
    let step = |(displacement, duration)| {
        model.step_beside_ordinates(&mut state, &mut ordinates, displacement, duration);
        ordinates.iter().zip(&change).map(|(o, change)| o.derivative() * change).sum::<f64>()
    };
    motion().map(step).collect()
}

#[test]
fn ordinates_of_a_branch_tell_how_the_force_changes_with_the_branch() {
    for params in [ElementParams::plausible_10_5_mm(), creeping(), damped(), all_terms(), resting()]
    {
        let params = params.expect("valid numbers");
        let [model, bent] = stiff_and_bent(params, BESIDE);
        let (before, (after, _)) = (alone(&model), beside(&model, &bent));
        let expected: Vec<f64> = after.iter().zip(&before).map(|(a, b)| (a - b) / BESIDE).collect();
        let found = by_ordinates(&model, &bent, BESIDE);
        let error = rms(found.iter().zip(&expected).map(|(a, b)| a - b));
        let size = rms(expected.iter().copied());
        assert!(size > 0.01 && error < 0.03 * size, "{error} beside {size} for {params:?}");
    }
}
