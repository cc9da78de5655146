//! Properties of static friction, Dahl and LuGre over random parameters and motions; numbers of
//! independent scripts.

use proptest::prelude::*;
use proptest::test_runner::TestCaseError;
use trocar_model::{
    BoucWen, BoucWenParams, Dahl, DahlParams, Friction, LuGre, LuGreParams, ParamError, Passivity,
    SlidingFriction, StaticFriction, StribeckCurve,
};

/// Rounding of a few hundred steps, as a fraction of the forces at work.
const ROUNDING: f64 = 1e-12;

/// A motion at constant velocity.
#[derive(Clone, Copy, Debug)]
struct Movement {
    displacement: f64,
    duration: f64,
}

/// Evenly distributed logarithm.
fn scales(low: f64, high: f64) -> impl Strategy<Value = f64> {
    (low.ln()..high.ln()).prop_map(f64::exp)
}

/// Motions of 1e-4 to 100 times a length to be given, at 1e-5 to 100 m/s.
fn motions() -> impl Strategy<Value = Vec<Movement>> {
    let movement = (scales(1e-4, 100.0), scales(1e-5, 100.0), any::<bool>()).prop_map(
        |(length, speed, back)| Movement {
            displacement: if back { -length } else { length },
            duration: length / speed,
        },
    );
    prop::collection::vec(movement, 1..80)
}

/// `motion` in units of `length`, m, at the same speeds.
fn scaled(motion: &[Movement], length: f64) -> Vec<Movement> {
    let scale = |s: &Movement| Movement {
        displacement: s.displacement * length,
        duration: s.duration * length,
    };
    motion.iter().map(scale).collect()
}

pub(crate) fn slidings() -> impl Strategy<Value = SlidingFriction> {
    let ratio = prop_oneof![1 => Just(1.0), 4 => 1.0..2.0_f64];
    let shape = prop_oneof![Just(1.0), Just(2.0), 0.5..3.0_f64];
    (0.25..8.0_f64, ratio, scales(1e-3, 0.1), shape, 0.0..20.0_f64).prop_map(
        |(coulomb_force, ratio, stribeck_velocity, stribeck_exponent, viscous_damping)| {
            SlidingFriction {
                coulomb_force,
                static_force: ratio * coulomb_force,
                stribeck_velocity,
                stribeck_exponent,
                viscous_damping,
            }
        },
    )
}

pub(crate) fn dahls() -> impl Strategy<Value = DahlParams> {
    let exponent = prop_oneof![Just(0.5), Just(1.0), Just(1.5), Just(2.0), 0.2..3.0_f64];
    (scales(100.0, 1e6), 0.25..8.0_f64, exponent, 0.0..20.0_f64).prop_map(
        |(stiffness, coulomb_force, exponent, viscous_damping)| DahlParams {
            stiffness,
            coulomb_force,
            exponent,
            viscous_damping,
        },
    )
}

pub(crate) fn bouc_wens() -> impl Strategy<Value = BoucWenParams> {
    let exponent = prop_oneof![Just(1.0), Just(2.0), 0.5..8.0_f64];
    let shape = prop_oneof![Just(0.5), Just(1.0), 0.5..4.0_f64];
    (scales(100.0, 1e6), 0.25..8.0_f64, exponent, shape, 0.0..20.0_f64).prop_map(
        |(stiffness, coulomb_force, exponent, unloading_shape, viscous_damping)| BoucWenParams {
            stiffness,
            coulomb_force,
            exponent,
            unloading_shape,
            viscous_damping,
        },
    )
}

pub(crate) fn lugres() -> impl Strategy<Value = LuGreParams> {
    let damping_velocity = prop_oneof![Just(f64::INFINITY), scales(1e-3, 1.0)];
    let curve = prop_oneof![Just(StribeckCurve::Exponential), Just(StribeckCurve::Rational)];
    (scales(100.0, 1e6), 0.0..300.0_f64, damping_velocity, slidings(), curve).prop_map(
        |(stiffness, micro_damping, damping_velocity, sliding, curve)| LuGreParams {
            stiffness,
            micro_damping,
            damping_velocity,
            sliding,
            curve,
        },
    )
}

fn dahl(params: DahlParams) -> Dahl {
    Dahl::new(params).unwrap()
}

fn bouc_wen(params: BoucWenParams) -> BoucWen {
    BoucWen::new(params).unwrap()
}

/// F_c/k, m.
fn bouc_wen_length(params: &BoucWenParams) -> f64 {
    params.coulomb_force / params.stiffness
}

fn lugre(params: LuGreParams) -> LuGre {
    LuGre::new(params).unwrap()
}

fn static_friction(sliding: SlidingFriction) -> StaticFriction {
    StaticFriction::new(sliding).unwrap()
}

/// F_c/σ, m: over which the force of a Dahl model rises.
fn dahl_length(params: &DahlParams) -> f64 {
    params.coulomb_force / params.stiffness
}

/// F_c/σ_0, m.
fn lugre_length(params: &LuGreParams) -> f64 {
    params.sliding.coulomb_force / params.stiffness
}

fn run<M: Friction>(model: &M, state: &mut M::State, motion: &[Movement]) -> f64 {
    motion.iter().fold(M::force(state), |_, s| model.step(state, s.displacement, s.duration))
}

/// The force after the mirrored motion is the mirrored force, bit by bit.
fn is_odd<M: Friction>(model: &M, motion: &[Movement]) -> Result<(), TestCaseError> {
    let (mut one, mut other) = (model.rest_at_force(0.0), model.rest_at_force(0.0));
    for s in motion {
        let force = model.step(&mut one, s.displacement, s.duration);
        prop_assert_eq!(model.step(&mut other, -s.displacement, s.duration), -force);
    }
    Ok(())
}

/// `whole` in one step and in `count` parts at the same velocity; returns the difference of the
/// forces, N.
fn cut<M: Friction>(model: &M, state: M::State, whole: Movement, count: u32) -> f64 {
    let (mut one, mut many) = (state, state);
    let part = Movement {
        displacement: whole.displacement / f64::from(count),
        duration: whole.duration / f64::from(count),
    };
    run(model, &mut many, &vec![part; count as usize]);
    (model.step(&mut one, whole.displacement, whole.duration) - M::force(&many)).abs()
}

/// Whatever is not finite, not positive in time or too fast for a number leaves everything as it
/// was.
fn ignores_bad_input<M: Friction>(model: &M) -> Result<(), TestCaseError>
where
    M::State: PartialEq,
{
    let mut state = model.rest_at_force(0.1);
    model.step(&mut state, 1e-5, 1e-3);
    let before = state;
    let displacements = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY].map(|x| (x, 1e-3));
    let durations =
        [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -0.0, -1e-3].map(|t| (1e-5, t));
    let both = [(0.0, 0.0), (0.0, f64::NAN), (f64::INFINITY, f64::INFINITY), (1e300, 1e-300)];
    for (displacement, duration) in displacements.into_iter().chain(durations).chain(both) {
        prop_assert_eq!(model.step(&mut state, displacement, duration), M::force(&before));
        prop_assert_eq!(state, before);
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 128, failure_persistence: None, ..ProptestConfig::default() })]

    /// A long slide settles at g(|v|)·sgn(v) + β·v from any past.
    #[test]
    fn static_and_lugre_settle(params in lugres(), motion in motions(), speed in scales(1e-4, 1.0), back: bool) {
        let velocity = if back { -speed } else { speed };
        let model = lugre(params);
        let settled = model.level(speed) * velocity.signum() + params.sliding.viscous_damping * velocity;
        let mut state = model.rest_state();
        run(&model, &mut state, &scaled(&motion, lugre_length(&params)));
        for _ in 0..100 {
            // e^-50 in all, over the longest length F_s/σ_0.
            model.step_velocity(&mut state, velocity, params.sliding.static_force / params.stiffness / 2.0 / speed);
        }
        prop_assert!((state.force() - settled).abs() < ROUNDING * settled.abs());

        let model = static_friction(params.sliding);
        let settled = params.sliding.force(speed) * velocity.signum();
        prop_assert!((model.step_velocity(&mut model.rest_state(), velocity, 1e-3) - settled).abs() < ROUNDING);
    }

    /// A long slide settles at F_c·sgn(v) + β·v; above exponent 1 the approach is algebraic and
    /// needs a very long one.
    #[test]
    fn dahl_settles(params in dahls(), motion in motions(), speed in scales(1e-4, 1.0), back: bool) {
        let sign = if back { -1.0 } else { 1.0 };
        let length = dahl_length(&params);
        let model = dahl(params);
        let mut state = model.rest_state();
        run(&model, &mut state, &scaled(&motion, length));
        let travel = if params.exponent <= 1.0 { 50.0 } else { 1e26 };
        model.step(&mut state, sign * travel * length, travel * length / speed);
        let settled = sign * (params.coulomb_force + params.viscous_damping * speed);
        prop_assert!((state.force() - settled).abs() < ROUNDING * settled.abs(), "{} {settled}", state.force());
    }

    #[test]
    fn bouc_wen_settles_within_its_bounds(
        params in bouc_wens(), motion in motions(), stiffness in scales(1e-3, 1e12), start in -20.0..20.0_f64, back: bool,
    ) {
        let params = BoucWenParams { stiffness, ..params };
        let model = bouc_wen(params);
        let mut state = model.rest_at_force(start);
        for s in scaled(&motion, 1e-3) {
            model.step(&mut state, s.displacement, s.duration);
            prop_assert!(state.hysteresis_force().abs() <= params.coulomb_force);
        }
        let sign = if back { -1.0 } else { 1.0 };
        // e^-50 for n = 0.5, whose last part is the slowest.
        let travel = 100.0 * bouc_wen_length(&params);
        model.step(&mut state, sign * travel, 1e3 * travel);
        let settled = sign * (params.coulomb_force + 1e-3 * params.viscous_damping);
        prop_assert!((state.force() - settled).abs() < ROUNDING * settled.abs(), "{} {settled}", state.force());
    }

    #[test]
    fn bouc_wen_is_odd_and_ignores_bad_input(params in bouc_wens(), motion in motions()) {
        is_odd(&bouc_wen(params), &scaled(&motion, bouc_wen_length(&params)))?;
        ignores_bad_input(&bouc_wen(params))?;
    }

    /// No step gives less work than the storage f²/(2·k) gains, whatever its size.
    #[test]
    fn bouc_wen_is_passive_step_by_step(params in bouc_wens(), motion in motions()) {
        let model = bouc_wen(params);
        let mut state = model.rest_state();
        let storage = |f: f64| 0.5 * f * f / params.stiffness;
        for s in scaled(&motion, bouc_wen_length(&params)) {
            let before = storage(state.hysteresis_force());
            let work = model.step(&mut state, s.displacement, s.duration) * s.displacement;
            let gain = storage(state.hysteresis_force()) - before;
            prop_assert!(work >= gain - ROUNDING * storage(params.coulomb_force), "{work} {gain}");
        }
    }

    /// Without viscous damping only the path counts, not its speed.
    #[test]
    fn bouc_wen_is_rate_independent(params in bouc_wens(), motion in motions(), slowness in scales(1e-3, 1e3)) {
        let model = bouc_wen(BoucWenParams { viscous_damping: 0.0, ..params });
        let (mut fast, mut slow) = (model.rest_state(), model.rest_state());
        for s in scaled(&motion, bouc_wen_length(&params)) {
            let force = model.step(&mut fast, s.displacement, s.duration);
            prop_assert_eq!(model.step(&mut slow, s.displacement, slowness * s.duration), force);
        }
    }

    /// With n = 1 and β_W alone it is Dahl with exponent 1.
    #[test]
    fn bouc_wen_contains_dahl(params in bouc_wens(), motion in motions()) {
        let BoucWenParams { stiffness, coulomb_force, viscous_damping, .. } = params;
        let model = bouc_wen(BoucWenParams { exponent: 1.0, unloading_shape: 1.0, ..params });
        let other = dahl(DahlParams { stiffness, coulomb_force, exponent: 1.0, viscous_damping });
        let (mut own, mut theirs) = (model.rest_state(), other.rest_state());
        for s in scaled(&motion, bouc_wen_length(&params)) {
            let apart = model.step(&mut own, s.displacement, s.duration)
                - other.step(&mut theirs, s.displacement, s.duration);
            prop_assert!(apart.abs() < ROUNDING * (coulomb_force + theirs.force().abs()), "{apart}");
        }
    }

    #[test]
    fn states_stay_within_bounds(
        one in dahls(), two in lugres(), motion in motions(), stiffness in scales(1e-3, 1e12), start in -20.0..20.0_f64,
    ) {
        // Motions of any length against that of the model, up to far beyond it.
        let one = DahlParams { stiffness, ..one };
        let two = LuGreParams { stiffness, ..two };
        let (dahl, lugre, fixed) = (dahl(one), lugre(two), static_friction(two.sliding));
        let (mut a, mut b, mut c) =
            (dahl.rest_at_force(start), lugre.rest_at_force(start), fixed.rest_at_force(start));
        for s in scaled(&motion, 1e-3) {
            dahl.step(&mut a, s.displacement, s.duration);
            lugre.step(&mut b, s.displacement, s.duration);
            fixed.step(&mut c, s.displacement, s.duration);
            prop_assert!(a.hysteresis_force().abs() <= one.coulomb_force);
            prop_assert!(b.deflection().abs() <= two.sliding.static_force / stiffness);
            prop_assert!(c.held_force().abs() <= two.sliding.static_force);
        }
    }

    #[test]
    fn forces_are_odd(one in dahls(), two in lugres(), motion in motions()) {
        is_odd(&dahl(one), &scaled(&motion, dahl_length(&one)))?;
        is_odd(&lugre(two), &scaled(&motion, lugre_length(&two)))?;
        is_odd(&static_friction(two.sliding), &motion)?;
    }

    /// At constant velocity a step may be cut into any number of parts, also where the force
    /// changes sign in it.
    #[test]
    fn step_over_a_reversal_may_be_cut(
        one in dahls(), two in lugres(), past in motions(), travel in scales(0.01, 20.0), speed in scales(1e-5, 10.0),
        count in 2..300_u32,
    ) {
        let movement = |length: f64, sign: f64| Movement {
            displacement: sign * travel * length,
            duration: travel * length / speed,
        };
        let length = dahl_length(&one);
        let model = dahl(one);
        let mut state = model.rest_state();
        run(&model, &mut state, &scaled(&past, length));
        let apart = cut(&model, state, movement(length, -state.force().signum()), count);
        prop_assert!(apart < ROUNDING * (one.coulomb_force + one.viscous_damping * speed), "{apart}");

        let length = lugre_length(&two);
        let model = lugre(two);
        let mut state = model.rest_state();
        run(&model, &mut state, &scaled(&past, length));
        let apart = cut(&model, state, movement(length, -state.deflection().signum()), count);
        let dampers = two.micro_damping + two.sliding.viscous_damping;
        prop_assert!(apart < ROUNDING * (two.sliding.static_force + dampers * speed), "{apart}");
    }

    /// Dahl and Coulomb friction know no time: other speeds and other cuts of the same motion give
    /// the same force.
    #[test]
    fn dahl_and_coulomb_are_rate_independent(
        params in dahls(), motion in motions(), slowness in prop::collection::vec(scales(1e-3, 1e3), 80),
        count in 1..20_u32,
    ) {
        let params = DahlParams { viscous_damping: 0.0, ..params };
        let (dahl, coulomb) = (dahl(params), static_friction(SlidingFriction::coulomb(params.coulomb_force, 0.0)));
        let motion = scaled(&motion, dahl_length(&params));
        let mut resampled = Vec::new();
        for (s, slowness) in motion.iter().zip(slowness) {
            let n = f64::from(count);
            let part = Movement { displacement: s.displacement / n, duration: slowness * s.duration / n };
            resampled.extend(std::iter::repeat_n(part, count as usize));
        }
        let (mut a, mut b) = (dahl.rest_state(), dahl.rest_state());
        let apart = run(&dahl, &mut a, &motion) - run(&dahl, &mut b, &resampled);
        prop_assert!(apart.abs() < ROUNDING * params.coulomb_force, "{apart}");
        let (mut a, mut b) = (coulomb.rest_state(), coulomb.rest_state());
        prop_assert_eq!(run(&coulomb, &mut a, &motion), run(&coulomb, &mut b, &resampled));
    }

    /// LuGre with F_s = F_c and no dampers is Dahl with exponent 1.
    #[test]
    fn lugre_contains_dahl(one in dahls(), curve: bool, motion in motions()) {
        let one = DahlParams { exponent: 1.0, viscous_damping: 0.0, ..one };
        let (dahl, lugre) = (dahl(one), lugre(LuGreParams {
            stiffness: one.stiffness,
            micro_damping: 0.0,
            damping_velocity: f64::INFINITY,
            sliding: SlidingFriction::coulomb(one.coulomb_force, 0.0),
            curve: if curve { StribeckCurve::Exponential } else { StribeckCurve::Rational },
        }));
        let (mut a, mut b) = (dahl.rest_state(), lugre.rest_state());
        for s in scaled(&motion, dahl_length(&one)) {
            let apart = dahl.step(&mut a, s.displacement, s.duration) - lugre.step(&mut b, s.displacement, s.duration);
            prop_assert!(apart.abs() < 1e-12, "{apart}");
        }
    }

    /// No step gives less work than the storage f²/(2·σ) gains, whatever its size.
    #[test]
    fn dahl_is_passive_step_by_step(params in dahls(), motion in motions()) {
        let model = dahl(params);
        let mut state = model.rest_state();
        let storage = |f: f64| 0.5 * f * f / params.stiffness;
        for s in scaled(&motion, dahl_length(&params)) {
            let before = storage(state.hysteresis_force());
            let work = model.step(&mut state, s.displacement, s.duration) * s.displacement;
            let gain = storage(state.hysteresis_force()) - before;
            prop_assert!(work >= gain - ROUNDING * storage(params.coulomb_force), "{work} {gain}");
        }
    }

    /// Settled closed loops take work, large or small, at any bias within reach.
    #[test]
    fn dahl_loops_dissipate(params in dahls(), half_width in scales(0.2, 10.0), settle in 1..30_u32) {
        const PARTS: u32 = 2000;
        let params = DahlParams { viscous_damping: 0.0, ..params };
        let model = dahl(params);
        let mut state = model.rest_state();
        let step = 2.0 * half_width * dahl_length(&params) / f64::from(PARTS);
        let mut loop_work = || {
            let mut work = 0.0;
            for k in 0..2 * PARTS {
                let displacement = if k < PARTS { step } else { -step };
                let before = state.force();
                work += 0.5 * (before + model.step(&mut state, displacement, 1e-3)) * displacement;
            }
            work
        };
        for _ in 0..settle {
            loop_work();
        }
        prop_assert!(loop_work() > 1e-3 * params.coulomb_force * dahl_length(&params));
    }

    /// Dahl has no memory of turning points: out of an inner loop it comes back with less force
    /// than it left.
    #[test]
    fn dahl_minor_loops_do_not_close(params in dahls(), left in 0.1..0.6_f64, inner in 0.05..0.3_f64) {
        let params = DahlParams { viscous_damping: 0.0, ..params };
        let model = dahl(params);
        let turning_force = (1.0 - left) * params.coulomb_force;
        let mut state = model.rest_at_force(turning_force);
        let displacement = inner * dahl_length(&params);
        model.step(&mut state, -displacement, 1e-3);
        model.step(&mut state, displacement, 1e-3);
        prop_assert!(state.force() < turning_force - 1e-3 * params.coulomb_force);
    }

    /// A step of no length changes nothing but the parts of the force that come from velocity.
    #[test]
    fn rest_keeps_the_state(one in dahls(), two in lugres(), motion in motions(), negative: bool) {
        let zero = if negative { -0.0 } else { 0.0 };
        let still = DahlParams { viscous_damping: 0.0, ..one };
        let model = dahl(still);
        let mut state = model.rest_state();
        let force = run(&model, &mut state, &scaled(&motion, dahl_length(&one)));
        prop_assert_eq!(model.step(&mut state, zero, 1e-3), force);

        let model = lugre(two);
        let mut state = model.rest_state();
        run(&model, &mut state, &scaled(&motion, lugre_length(&two)));
        let z = state.deflection();
        prop_assert_eq!(model.step_velocity(&mut state, zero, 1e-3), two.stiffness * z);
        prop_assert_eq!(state.deflection(), z);
        prop_assert_eq!(model.output(&state, zero), state.force());

        let model = static_friction(two.sliding);
        let mut state = model.rest_state();
        run(&model, &mut state, &motion);
        let last = motion[motion.len() - 1];
        let viscous = two.sliding.viscous_damping * last.displacement / last.duration;
        let held = state.force() - viscous;
        prop_assert!((model.step(&mut state, zero, 1e-3) - held).abs() <= ROUNDING * (held.abs() + viscous.abs()));
    }

    /// A state made for a force at rest holds that force.
    #[test]
    fn rest_at_force_holds_it(one in dahls(), two in lugres(), share in -1.0..1.0_f64) {
        let force = share * one.coulomb_force.min(two.sliding.static_force);
        let (dahl, lugre, fixed) = (dahl(one), lugre(two), static_friction(two.sliding));
        let (mut a, mut b, mut c) =
            (dahl.rest_at_force(force), lugre.rest_at_force(force), fixed.rest_at_force(force));
        for held in [a.force(), b.force(), c.force(), dahl.step(&mut a, 0.0, 1.0), lugre.step(&mut b, 0.0, 1.0),
            fixed.step(&mut c, 0.0, 1.0)] {
            prop_assert!((held - force).abs() <= 4.0 * f64::EPSILON * force.abs());
        }
    }

    /// `output` is the limit of a short step.
    #[test]
    fn output_is_the_start_of_a_step(one in dahls(), two in lugres(), past in motions(), velocity in -1.0..1.0_f64) {
        const SHORT: f64 = 1e-13;
        let model = dahl(one);
        let mut state = model.rest_state();
        run(&model, &mut state, &scaled(&past, dahl_length(&one)));
        let start = model.output(&state, velocity);
        let force = model.step(&mut state, velocity * SHORT, SHORT);
        let scale = one.coulomb_force + one.viscous_damping + one.stiffness * SHORT * 1e12;
        prop_assert!((force - start).abs() < ROUNDING * 10.0 * scale);

        let model = lugre(two);
        let mut state = model.rest_state();
        run(&model, &mut state, &scaled(&past, lugre_length(&two)));
        let start = model.output(&state, velocity);
        let force = model.step(&mut state, velocity * SHORT, SHORT);
        let dampers = two.micro_damping + two.sliding.viscous_damping;
        let scale = two.sliding.static_force + dampers + (1.0 + dampers) * two.stiffness * SHORT * 1e12;
        prop_assert!((force - start).abs() < ROUNDING * 10.0 * scale, "{force} {start}");
    }

    #[test]
    fn bad_input_is_ignored(one in dahls(), two in lugres()) {
        ignores_bad_input(&dahl(one))?;
        ignores_bad_input(&lugre(two))?;
        ignores_bad_input(&static_friction(two.sliding))?;
    }

    /// A passive LuGre model gives no step less work than its bristles store, whatever the motion.
    #[test]
    fn passive_lugre_never_gives_energy(
        params in lugres(), reserve in 1.0..3.0_f64, fading: bool, start in -1.0..1.0_f64, motion in motions(),
    ) {
        let model = lugre(made_passive(params, reserve, fading));
        prop_assert_eq!(model.passivity(), Passivity::Passive);
        let limit = params.sliding.static_force;
        let storage = |z: f64| 0.5 * params.stiffness * z * z;
        for start in [start * limit, limit, -limit] {
            let mut state = model.rest_at_force(start);
            for s in scaled(&motion, lugre_length(&params)) {
                let before = storage(state.deflection());
                let work = model.step(&mut state, s.displacement, s.duration) * s.displacement;
                let gain = storage(state.deflection()) - before;
                prop_assert!(work >= gain - ROUNDING * (work.abs() + before), "{work} {gain}");
            }
        }
    }

    /// With constant damping the condition is also necessary: a fast enough jerk after a creep
    /// gives energy.
    #[test]
    fn lugre_that_misses_the_condition_gives_energy(params in lugres(), ratio in 1.1..2.0_f64, share in 0.0..0.9_f64) {
        prop_assume!(params.micro_damping > 1.0);
        let sliding = SlidingFriction {
            static_force: ratio * params.sliding.coulomb_force,
            viscous_damping: share * params.micro_damping * (ratio - 1.0),
            ..params.sliding
        };
        let model = lugre(LuGreParams { damping_velocity: f64::INFINITY, sliding, ..params });
        let is_doubtful = matches!(model.passivity(), Passivity::NotGuaranteed { .. });
        prop_assert!(is_doubtful);
        let fastest = 1e9 * sliding.static_force / params.micro_damping;
        prop_assert!(least_work(&model, 1e-9 * sliding.stribeck_velocity, &[fastest]) < 0.0);
    }

    /// At equal velocity the force of LuGre is higher on the way up than on the way down; a static
    /// law has no such lag.
    #[test]
    fn lugre_lags(params in lugres(), ratio in 1.2..2.0_f64, slowness in 5.0..50.0_f64) {
        const PARTS: usize = 2000;
        let static_force = ratio * params.sliding.coulomb_force;
        let mean = params.sliding.stribeck_velocity;
        let sliding = SlidingFriction { static_force, viscous_damping: 0.0, ..params.sliding };
        // σ_1·v < g: the damper, which takes from the lag, stays the lesser part.
        let micro_damping = params.micro_damping.min(0.2 * sliding.coulomb_force / mean);
        let model = lugre(LuGreParams { micro_damping, sliding, ..params });
        let angle = |k: usize| std::f64::consts::TAU * (k as f64 + 0.5) / PARTS as f64;
        let velocity = |k: usize| mean * (1.0 + 0.6 * angle(k).sin());
        let period = 1.0 / PARTS as f64 * std::f64::consts::TAU * slowness * lugre_length(&params) / mean;
        let (mut state, fixed) = (model.rest_state(), static_friction(sliding));
        let steps = 0..3 * PARTS;
        let forces: Vec<f64> = steps.map(|k| model.step_velocity(&mut state, velocity(k), period)).collect();
        for k in 0..PARTS / 12 {
            let (up, down) = (2 * PARTS + k, 2 * PARTS + PARTS / 2 - 1 - k);
            prop_assert!(forces[up] > forces[down], "{} {}", forces[up], forces[down]);
            let rest = fixed.rest_state();
            let apart = fixed.output(&rest, velocity(up)) - fixed.output(&rest, velocity(down));
            prop_assert!(apart.abs() < 1e-9);
        }
    }

    /// 1e9 N/m or far more at steps of 1 ms, where an explicit step grows without bounds, here
    /// settles within a step.
    #[test]
    fn stiffness_has_no_limit(
        one in dahls(), two in lugres(), stiffness in scales(1e9, 1e100),
        speeds in prop::collection::vec(scales(1e-3, 1.0), 50),
    ) {
        // Above exponent 1 the approach is algebraic, within a step too.
        let one = DahlParams { stiffness, exponent: one.exponent.min(1.0), ..one };
        let two = LuGreParams { stiffness, ..two };
        let (dahl, lugre) = (dahl(one), lugre(two));
        let (mut a, mut b) = (dahl.rest_state(), lugre.rest_state());
        for (k, speed) in speeds.into_iter().enumerate() {
            let velocity = if k % 3 == 0 { -speed } else { speed };
            let settled = one.coulomb_force * velocity.signum() + one.viscous_damping * velocity;
            prop_assert!((dahl.step_velocity(&mut a, velocity, 1e-3) - settled).abs() < ROUNDING * settled.abs());
            let settled = lugre.level(velocity) * velocity.signum() + two.sliding.viscous_damping * velocity;
            prop_assert!((lugre.step_velocity(&mut b, velocity, 1e-3) - settled).abs() < ROUNDING * settled.abs());
        }
    }
}

/// `params` with as much viscous damping, or as quickly fading a micro-damping, as passivity asks
/// for, times `reserve`.
fn made_passive(params: LuGreParams, reserve: f64, fading: bool) -> LuGreParams {
    let bare = SlidingFriction { viscous_damping: 0.0, ..params.sliding };
    let constant = LuGreParams { damping_velocity: f64::INFINITY, sliding: bare, ..params };
    let Passivity::NotGuaranteed { viscous_damping_needed, damping_velocity_needed } =
        lugre(constant).passivity()
    else {
        return constant;
    };
    if fading {
        LuGreParams { damping_velocity: damping_velocity_needed / reserve, ..constant }
    } else {
        let sliding = SlidingFriction { viscous_damping: reserve * viscous_damping_needed, ..bare };
        LuGreParams { sliding, ..constant }
    }
}

/// Least work, J, given by the time any of the jerks ends: from rest a creep until F_s, then a jerk
/// at one of `speeds`.
fn least_work(model: &LuGre, creep: f64, speeds: &[f64]) -> f64 {
    let length = model.params().sliding.static_force / model.params().stiffness;
    let mut least = f64::INFINITY;
    for &speed in speeds {
        let (mut state, mut work) = (model.rest_state(), 0.0);
        for _ in 0..4000 {
            work += model.step_velocity(&mut state, creep, 8.0 * length / creep / 4000.0)
                * 8.0
                * length
                / 4000.0;
        }
        for _ in 0..2000 {
            work += model.step_velocity(&mut state, speed, length / speed / 400.0) * length / 400.0;
            least = least.min(work);
        }
    }
    least
}

/// The values of LUGRE.
fn published() -> LuGreParams {
    LuGreParams {
        stiffness: 1e5,
        micro_damping: 316.0,
        damping_velocity: f64::INFINITY,
        sliding: SlidingFriction {
            coulomb_force: 1.0,
            static_force: 1.5,
            stribeck_velocity: 1e-3,
            stribeck_exponent: 2.0,
            viscous_damping: 0.4,
        },
        curve: StribeckCurve::Exponential,
    }
}

/// Work that an independent script finds for the same creep and jerks, printed to 1e-7 J.
#[test]
fn energy_from_rest_agrees_with_an_independent_script() {
    const PRINTED: f64 = 6e-8;
    let speeds = [0.005, 0.01, 0.02, 0.05, 0.2, 1.0, 5.0];
    // (σ_2, v_d, least work)
    let cases = [
        (0.4, f64::INFINITY, -7.5168e-3),
        (161.16, f64::INFINITY, 0.1578e-3),
        (0.4, 9.3 / 316.0, 0.1567e-3),
        (0.4, 0.001, 0.1576e-3),
    ];
    for (viscous_damping, damping_velocity, expected) in cases {
        let sliding = SlidingFriction { viscous_damping, ..published().sliding };
        let model = lugre(LuGreParams { damping_velocity, sliding, ..published() });
        let work = least_work(&model, 1e-5, &speeds);
        assert!(
            (work - expected).abs() < PRINTED,
            "{viscous_damping} {damping_velocity}: {work} J"
        );
        assert_eq!(expected > 0.0, model.passivity() == Passivity::Passive);
    }
}

/// Positions, m, every 0.2 s of 1 kg on which a force rises to 0.9 N within 1 s and then swings by
/// `swing` at 5 Hz.
fn driven<M: Friction>(model: &M, swing: f64, period: f64, lagged: bool) -> Vec<f64> {
    let mut state = model.rest_at_force(0.0);
    let (mut x, mut v, mut friction) = (0.0, 0.0, 0.0);
    let mut positions = Vec::new();
    let every = (0.2 / period).round() as usize;
    for n in 0..30 * every {
        let t = n as f64 * period;
        let swinging = if t > 1.0 { swing * (10.0 * std::f64::consts::PI * t).sin() } else { 0.0 };
        let applied = 0.9 * t.min(1.0) + swinging;
        if !lagged {
            friction = model.step(&mut state, v * period, period);
        }
        v += period * (applied - friction);
        x += v * period;
        if lagged {
            friction = model.step(&mut state, v * period, period);
        }
        if n % every == 0 {
            positions.push(x);
        }
    }
    positions
}

fn drifting_lugre() -> LuGre {
    lugre(LuGreParams { sliding: SlidingFriction::coulomb(1.5, 0.4), ..published() })
}

/// A force that never reaches F_s moves LuGre on and on: 135 µm/s, at the places an independent
/// script finds.
#[test]
fn lugre_drifts_under_a_swinging_force() {
    const PRINTED: f64 = 1e-9;
    let positions = driven(&drifting_lugre(), 0.45, 2e-5, false);
    for (index, micrometres) in
        [(10, 147.280), (15, 282.296), (20, 417.311), (25, 552.326), (28, 633.335)]
    {
        assert!(
            (positions[index] - 1e-6 * micrometres).abs() < PRINTED,
            "{} at {index}",
            positions[index]
        );
    }
}

/// The same force without the swing holds.
#[test]
fn lugre_holds_under_a_steady_force() {
    let positions = driven(&drifting_lugre(), 0.0, 2e-5, false);
    assert!((positions[29] - positions[15]).abs() < 1e-9, "{:?}", &positions[15..]);
}

/// Dahl drifts too: 100.83 µm/s in an independent script with a damper of 316 N s/m.
#[test]
fn dahl_drifts_under_a_swinging_force() {
    let params =
        DahlParams { stiffness: 1e5, coulomb_force: 1.5, exponent: 1.0, viscous_damping: 316.0 };
    let positions = driven(&dahl(params), 0.45, 5e-5, true);
    let drift = (positions[29] - positions[15]) / (14.0 * 0.2);
    assert!((drift - 100.8298e-6).abs() < 1e-9, "{drift}");
}

/// Forces after 3 mm, back 5 mm, forth 3 mm from a fine Runge-Kutta integration elsewhere, to 1e-8
/// N.
#[test]
fn dahl_agrees_with_a_fine_integration() {
    for (exponent, expected) in [(0.5, 2.48528137), (1.0, 2.21499582), (1.5, 2.00831790)] {
        let model = dahl(DahlParams {
            stiffness: 2000.0,
            coulomb_force: 3.0,
            exponent,
            viscous_damping: 0.0,
        });
        let mut state = model.rest_state();
        let force =
            [3e-3, -5e-3, 3e-3].map(|displacement| model.step(&mut state, displacement, 1.0))[2];
        assert!((force - expected).abs() < 2e-8, "{exponent}: {force}");
    }
}

/// F_c + (F_s - F_c) may round to more than F_s when F_s > 2·F_c; the bounds hold nevertheless.
#[test]
fn bounds_hold_where_sums_round_up() {
    let mut rounded_up = 0;
    for k in 1..300 {
        let coulomb_force = 0.01 * f64::from(k);
        let static_force = 3.7 * coulomb_force;
        rounded_up += u32::from(coulomb_force + (static_force - coulomb_force) > static_force);
        let sliding = SlidingFriction {
            coulomb_force,
            static_force,
            viscous_damping: 0.0,
            ..published().sliding
        };
        for curve in [StribeckCurve::Exponential, StribeckCurve::Rational] {
            let params = LuGreParams { sliding, curve, ..published() };
            let model = lugre(params);
            let mut state = model.rest_state();
            model.step_velocity(&mut state, -1e-12, 1e12);
            assert!(-state.deflection() <= static_force / params.stiffness, "{coulomb_force}");
        }
        let model = static_friction(sliding);
        let mut state = model.rest_state();
        assert!(model.step_velocity(&mut state, 1e-12, 1.0) <= static_force, "{coulomb_force}");
    }
    assert!(rounded_up > 0);
}

/// Numbers beyond all bounds leave the state alone too.
#[test]
fn overflow_is_not_committed() {
    let sliding = SlidingFriction { viscous_damping: 1e300, ..published().sliding };
    let model = lugre(LuGreParams { sliding, ..published() });
    let mut state = model.rest_at_force(1.0);
    let before = state;
    assert_eq!(model.step(&mut state, 1e9, 1e-3), 1.0);
    assert_eq!(state, before);
    let fixed = static_friction(sliding);
    let mut state = fixed.rest_at_force(1.0);
    assert_eq!(fixed.step(&mut state, 1e9, 1e-3), 1.0);
    let params =
        DahlParams { stiffness: 1e3, coulomb_force: 3.0, exponent: 1.0, viscous_damping: 1e300 };
    let model = dahl(params);
    let mut state = model.rest_at_force(1.0);
    assert_eq!(model.step(&mut state, 1e9, 1e-3), 1.0);
}

#[test]
fn bad_parameters_are_refused_by_name() {
    let good =
        DahlParams { stiffness: 1e3, coulomb_force: 3.0, exponent: 1.0, viscous_damping: 0.0 };
    let paper = published();
    let withdrawal = SlidingFriction { static_force: 0.5, ..paper.sliding };
    let refusals: [(Option<ParamError>, &str); 9] = [
        (
            Dahl::new(DahlParams { stiffness: 0.0, ..good }).err(),
            "stiffness_n_m must be finite and above 0 N/m, got 0 N/m",
        ),
        (
            Dahl::new(DahlParams { coulomb_force: -3.0, ..good }).err(),
            "coulomb_force_n must be finite and above 0 N, got -3 N",
        ),
        (
            Dahl::new(DahlParams { exponent: 0.0, ..good }).err(),
            "exponent must be finite and above 0, got 0",
        ),
        (
            Dahl::new(DahlParams { viscous_damping: f64::INFINITY, ..good }).err(),
            "viscous_damping_n_s_m must be finite and at least 0 N s/m, got inf N s/m",
        ),
        (
            LuGre::new(LuGreParams { stiffness: f64::NAN, ..paper }).err(),
            "stiffness_n_m must be finite and above 0 N/m, got NaN N/m",
        ),
        (
            LuGre::new(LuGreParams { micro_damping: -1.0, ..paper }).err(),
            "micro_damping_n_s_m must be finite and at least 0 N s/m, got -1 N s/m",
        ),
        (
            LuGre::new(LuGreParams { damping_velocity: 0.0, ..paper }).err(),
            "damping_velocity_m_s must be above 0 m/s, got 0 m/s",
        ),
        (
            LuGre::new(LuGreParams { sliding: withdrawal, ..paper }).err(),
            "static_force_n must be at least coulomb_force_n = 1 N, got 0.5 N",
        ),
        (
            StaticFriction::new(withdrawal).err(),
            "static_force_n must be at least coulomb_force_n = 1 N, got 0.5 N",
        ),
    ];
    for (refusal, message) in refusals {
        assert_eq!(refusal.map(|error| error.to_string()).as_deref(), Some(message));
    }
}
