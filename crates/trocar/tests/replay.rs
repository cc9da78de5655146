//! Classical models simulated over recordings: when the unknown initial state is forgotten, and
//! which samples are scored.

use trocar::recording::Recording;
use trocar::replay::{forgotten_after, replay};
use trocar::validate::validate;
use trocar_model::Classical;
use trocar_model::{
    Dahl, DahlParams, Element, ElementParams, Friction, Gms, GmsElement, Leuven, LeuvenParams,
    LuGre, LuGreParams, MaxwellSlip, SlidingFriction, SlipElement, SlipRate, StaticFriction,
    StribeckCurve, Trocar,
};

/// Tolerance for forces from forgotten initial states, N: twice that of the replay, since it tests
/// only some initial states.
const FORGOTTEN: f64 = 2e-3;

const SLIDING: SlidingFriction = SlidingFriction {
    coulomb_force: 2.0,
    static_force: 2.4,
    stribeck_velocity: 0.02,
    stribeck_exponent: 2.0,
    viscous_damping: 5.0,
};

fn lugre(micro_damping: f64) -> Classical {
    Classical::LuGre(
        LuGre::new(LuGreParams {
            stiffness: 2000.0,
            micro_damping,
            damping_velocity: f64::INFINITY,
            sliding: SLIDING,
            curve: StribeckCurve::Exponential,
        })
        .unwrap(),
    )
}

/// Elements that yield after 1, 2 and 4 mm.
fn bank() -> [SlipElement; 3] {
    [1e-3, 2e-3, 4e-3].map(|travel| SlipElement { stiffness: 0.9 / travel, limit_force: 0.9 })
}

/// The bank of a Leuven model determines its memory.
fn leuven(bank: &[SlipElement]) -> Classical {
    let params = LeuvenParams { sliding: SLIDING, exponent: 1.2, micro_damping: 1.0 };
    Classical::Leuven(Leuven::new(bank, params).unwrap())
}

/// Two elements that yield early, and one that carries the remaining sliding force and never
/// yields.
fn forgetful_bank() -> [SlipElement; 3] {
    let early = |travel: f64| SlipElement { stiffness: 0.3 / travel, limit_force: 0.3 };
    [early(2e-4), early(5e-4), SlipElement { stiffness: 800.0, limit_force: 2.4 }]
}

fn models() -> Vec<Classical> {
    let gms = |stiffness| GmsElement { stiffness, share: 0.5, attraction: 0.05, damping: 1.0 };
    let dahl =
        DahlParams { stiffness: 2000.0, coulomb_force: 2.0, exponent: 1.0, viscous_damping: 1.0 };
    vec![
        Classical::Static(StaticFriction::new(SLIDING).unwrap()),
        Classical::Dahl(Dahl::new(dahl).unwrap()),
        lugre(3.0),
        leuven(&forgetful_bank()),
        Classical::MaxwellSlip(MaxwellSlip::new(&bank(), 3.0).unwrap()),
        Classical::Gms(Gms::new(&[gms(500.0), gms(2000.0)], SLIDING, SlipRate::Free).unwrap()),
    ]
}

/// Sinusoidal strokes of 40 mm, 1 kHz for 8 s, with a force that starts at `first`, N.
fn strokes(first: f64) -> Recording {
    let time: Vec<f64> = (0..8000).map(|k| 1e-3 * f64::from(k)).collect();
    let position = time.iter().map(|t| 0.02 * (3.0 * t).sin()).collect();
    let mut force: Vec<f64> = time.iter().map(|t| 2.2 * (3.0 * t).cos()).collect();
    force[0] = first;
    Recording::from_columns("strokes", time, position, force).unwrap()
}

#[test]
fn known_forces_do_not_depend_on_the_start() {
    for model in models() {
        let runs =
            [-9.0, 0.3, 9.0].map(|first| replay(&Trocar::of_seal(model), &strokes(first), 0.0));
        let [known] = &runs[0].known[..] else { panic!("{} never forgets", model.kind()) };
        assert!(known.start < 6000 && known.end == 8000, "{} {known:?}", model.kind());
        for run in &runs {
            assert_eq!(run.known, runs[0].known);
            assert!(run.deflection.is_empty() && run.sliding.is_empty());
            let apart =
                known.clone().map(|i| (run.force[i] - runs[0].force[i]).abs()).fold(0.0, f64::max);
            assert!(apart < FORGOTTEN, "{}: {apart} N", model.kind());
        }
    }
}

#[test]
fn a_bank_forgets_once_its_longest_element_has_run_from_limit_to_limit() {
    let model = Classical::MaxwellSlip(MaxwellSlip::new(&bank(), 3.0).unwrap());
    // From -4 mm to +4 mm in steps of 30 µm; 1 mN is 4 µm of the last element, less than a step.
    let steps = std::iter::repeat_n((30e-6, 1e-3), 400);
    assert_eq!(forgotten_after(&model.into(), steps), Some((8e-3_f64 / 30e-6) as usize));
    let short = std::iter::repeat_n((30e-6, 1e-3), 260);
    assert_eq!(forgotten_after(&model.into(), short), None, "the motion is too short");
}

#[test]
fn static_friction_forgets_with_the_first_motion() {
    let model = Classical::Static(StaticFriction::new(SLIDING).unwrap());
    let steps = [(0.0, 1e-3), (0.0, 1e-3), (1e-6, 1e-3), (0.0, 1e-3)];
    assert_eq!(forgotten_after(&model.into(), steps.into_iter()), Some(2));
}

/// At σ_1·|v| = g the force of a LuGre model is g + σ_2·v whatever its state: agreement there does
/// not show convergence.
#[test]
fn a_force_that_hides_the_state_does_not_count_as_forgotten() {
    let model = lugre(40.0);
    let mut speed = SLIDING.coulomb_force / 40.0;
    for _ in 0..50 {
        speed = SLIDING.level(speed) / 40.0;
    }
    let hiding = std::iter::repeat_n((speed * 1e-4, 1e-4), 20);
    assert_eq!(
        forgotten_after(&model.into(), hiding.clone()),
        Some(0),
        "all that this motion shows"
    );
    let slower = std::iter::repeat_n((0.01 * 1e-3, 1e-3), 2000);
    let after = forgotten_after(&model.into(), hiding.chain(slower)).unwrap();
    assert!(after > 100, "{after}");
    let mut low = model.rest_at_force(-9.0);
    let mut high = model.rest_at_force(9.0);
    for _ in 0..20 {
        model.step(&mut low, speed * 1e-4, 1e-4);
        model.step(&mut high, speed * 1e-4, 1e-4);
    }
    let apart = model.step(&mut high, 0.0, 1e-3) - model.step(&mut low, 0.0, 1e-3);
    assert!(apart > 1.0, "the states are still {apart} N apart at rest");
}

#[test]
fn classical_models_are_scored_by_motion_and_hold_only() {
    let recording = strokes(0.0);
    for model in models() {
        let found = validate(&Trocar::of_seal(model), std::slice::from_ref(&recording), 0.0);
        let part = &found.recordings[0];
        let moving = part.by_phase.moving.unwrap();
        assert_eq!((part.by_phase.deformation.samples, part.by_phase.sliding.samples), (0, 0));
        assert_eq!(moving.samples + part.by_phase.hold.samples, part.samples);
        assert!(
            moving.share_of_squares > 0.5 && !found.is_doubtful(),
            "{}: {part:?}",
            model.kind()
        );
    }
    let element = Element::new(ElementParams::plausible_10_5_mm().unwrap()).unwrap();
    let found =
        serde_json::to_value(validate(&Trocar::of_seal(element), &[recording], 0.0)).unwrap();
    let phases = found["recordings"][0]["by_phase"].as_object().unwrap();
    assert_eq!(phases.keys().collect::<Vec<_>>(), ["deformation", "hold", "sliding"], "as ever");
}

/// A spring that the strokes never stretch to its limit. In a Leuven bank with g < F_s only some
/// elements yield, and the initial state determines which.
#[test]
fn models_that_never_forget_are_scored_throughout_and_say_so() {
    let long = SlipElement { stiffness: 10.0, limit_force: 1.0 };
    let spring = Classical::MaxwellSlip(MaxwellSlip::new(&[long], 0.0).unwrap());
    for model in [spring, leuven(&bank())] {
        let found = validate(&Trocar::of_seal(model), &[strokes(0.0)], 0.0);
        assert!(found.is_doubtful(), "{}", model.kind());
        assert_eq!(
            (found.recordings[0].samples, found.recordings[0].samples_before_known),
            (8000, 0)
        );
        assert!(
            found.recordings[0].warnings[0].contains("unknown initial state"),
            "{:?}",
            found.recordings[0].warnings
        );
    }
}
