//! What every program that runs a model relies on: rows of numbers, states that can be stored,
//! parameters that can be adjusted.

use proptest::prelude::*;
use trocar_model::flat::{FlatError, SEAL_NUMBERS, STATE_NUMBERS};
use trocar_model::{
    BoucWen, BoucWenParams, Classical, Dahl, DahlParams, Direction, Element, ElementParams,
    Friction, Gms, GmsElement, Leuven, LeuvenParams, LuGre, LuGreParams, MaxwellSlip, ParamError,
    PositionProfile, Quantity, Relaxation, RelaxationArm, Seal, SlidingFriction, SlipElement,
    SlipRate, Stages, StaticFriction, StribeckCurve, Trocar,
};

const OFFSET: [f64; 3] = [0.1, -0.2, 0.05];
const GAIN: [f64; 3] = [0.9, 1.05, 1.0];

fn seals() -> Result<Vec<Seal>, ParamError> {
    let plausible = ElementParams::plausible_10_5_mm()?;
    let arms = [
        RelaxationArm { stiffness: 50.0, time: 0.3 },
        RelaxationArm { stiffness: 20.0, time: 4.0 },
    ];
    let slow = ElementParams {
        creep_velocity: 1e-4,
        friction_lag: 0.02,
        relaxation: Relaxation { arms },
        ..plausible
    };
    let two = [Element::new(plausible)?, Element::new(slow)?];
    let sliding = SlidingFriction { static_force: 3.5, ..SlidingFriction::coulomb(3.0, 4.0) };
    let bank = [1.0, 2.0, 4.0].map(|k| SlipElement { stiffness: 300.0 * k, limit_force: 0.8 * k });
    let part = |share| GmsElement { stiffness: 200.0, share, attraction: 0.1, damping: 0.5 };
    let lugre = LuGreParams {
        stiffness: 900.0,
        micro_damping: 3.0,
        damping_velocity: f64::INFINITY,
        sliding,
        curve: StribeckCurve::Rational,
    };
    let dahl =
        DahlParams { stiffness: 500.0, coulomb_force: 2.0, exponent: 1.3, viscous_damping: 1.0 };
    let bouc_wen = BoucWenParams {
        stiffness: 500.0,
        coulomb_force: 2.0,
        exponent: 1.3,
        unloading_shape: 0.8,
        viscous_damping: 1.0,
    };
    Ok(vec![
        Element::new(plausible)?.into(),
        Seal::Ems(Stages::new(&two).expect("two")),
        Classical::Static(StaticFriction::new(sliding)?).into(),
        Classical::Dahl(Dahl::new(dahl)?).into(),
        Classical::BoucWen(BoucWen::new(bouc_wen)?).into(),
        Classical::LuGre(LuGre::new(lugre)?).into(),
        Classical::Leuven(Leuven::new(
            &bank,
            LeuvenParams { sliding, exponent: 0.9, micro_damping: 1.0 },
        )?)
        .into(),
        Classical::MaxwellSlip(MaxwellSlip::new(&bank, 2.0)?).into(),
        Classical::Gms(Gms::new(&[part(0.4), part(0.6)], sliding, SlipRate::Limited)?).into(),
    ])
}

fn profile() -> PositionProfile {
    PositionProfile::new(-0.02, 0.03, OFFSET.as_slice(), GAIN.as_slice())
        .expect("two knots or more")
}

/// A motion with reversals, from a few numbers.
fn motion(seed: u32) -> impl Iterator<Item = (f64, f64)> {
    (0..600_u32).map(move |k| {
        let sign = if ((k + seed) / (20 + seed % 50)).is_multiple_of(2) { 1.0 } else { -1.0 };
        (sign * 1e-5 * f64::from(1 + (k * 7 + seed) % 40), 1e-3)
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn a_row_of_numbers_is_the_same_trocar(seed in 0_u32..1000, with_profile: bool) {
        for seal in seals().unwrap() {
            let trocar = Trocar::new(seal, with_profile.then(profile));
            let mut row = [0.0; SEAL_NUMBERS + 16];
            let count = trocar.write_numbers(&mut row).unwrap();
            prop_assert_eq!(count, trocar.count_numbers());
            let again = Trocar::from_numbers(&row[..count]).unwrap();
            prop_assert_eq!(again, trocar);
            let (mut a, mut b) = (trocar.rest(0.0), again.rest(0.0));
            for (displacement, duration) in motion(seed) {
                let forces = (trocar.step(&mut a, displacement, duration), again.step(&mut b, displacement, duration));
                prop_assert_eq!(forces.0.to_bits(), forces.1.to_bits());
            }
        }
    }

    #[test]
    fn a_stored_state_goes_on_as_if_nothing_had_happened(seed in 0_u32..1000, at in 1_usize..599) {
        for seal in seals().unwrap() {
            let trocar = Trocar::new(seal, Some(profile()));
            let (mut whole, mut cut) = (trocar.rest(0.01), trocar.rest(0.01));
            for (k, (displacement, duration)) in motion(seed).enumerate() {
                if k == at {
                    cut = trocar.state_from_numbers(&cut.to_numbers()).unwrap();
                }
                trocar.step(&mut whole, displacement, duration);
                trocar.step(&mut cut, displacement, duration);
                prop_assert_eq!(whole, cut);
            }
        }
    }

    #[test]
    fn rubbish_makes_no_trocar_and_no_panic(row in prop::collection::vec(prop_oneof![-2.0..20.0, Just(1.0), Just(0.0), Just(f64::NAN)], 0..120)) {
        if let Ok(trocar) = Trocar::from_numbers(&row) {
            let mut state = trocar.rest(0.0);
            prop_assert!(trocar.step(&mut state, 1e-3, 1e-3).is_finite());
        }
        let trocar = Trocar::of_seal(seals().unwrap()[1]);
        if let Ok(mut state) = trocar.state_from_numbers(&row) {
            prop_assert!(trocar.step(&mut state, 1e-3, 1e-3).is_finite());
        }
    }
}

/// A Stribeck curve with an exponent below 1 falls at an infinite rate where the slip begins and
/// ends.
#[test]
fn a_contact_that_lets_go_at_once_is_stored_like_any_other() {
    let sharp = SlidingFriction {
        coulomb_force: 2.4,
        static_force: 3.0,
        stribeck_velocity: 0.01,
        stribeck_exponent: 0.8,
        viscous_damping: 5.0,
    };
    for creep_velocity in [0.0, 1e-4] {
        let plausible = ElementParams::plausible_10_5_mm().unwrap();
        let params =
            ElementParams { insertion: sharp, withdrawal: sharp, creep_velocity, ..plausible };
        let trocar = Trocar::of_seal(Element::new(params).unwrap());
        let (mut whole, mut cut) = (trocar.rest(0.0), trocar.rest(0.0));
        for (displacement, duration) in (0..40).flat_map(motion) {
            cut = trocar.state_from_numbers(&cut.to_numbers()).unwrap();
            trocar.step(&mut whole, 0.1 * displacement, duration);
            trocar.step(&mut cut, 0.1 * displacement, duration);
            assert_eq!(whole, cut);
        }
    }
}

#[test]
fn a_state_of_another_model_is_refused() {
    let seals = seals().unwrap();
    for (i, own) in seals.iter().enumerate() {
        for (k, other) in seals.iter().enumerate() {
            let row = Trocar::of_seal(*other).rest(0.0).to_numbers();
            let read = Trocar::of_seal(*own).state_from_numbers(&row);
            assert_eq!(read.is_ok(), i == k, "{i} {k}");
        }
    }
    let short = Trocar::of_seal(seals[0]).state_from_numbers(&[1.0; STATE_NUMBERS - 1]);
    assert_eq!(short, Err(FlatError::Length { found: STATE_NUMBERS - 1 }));
}

#[test]
fn unturned_parameters_are_the_same_model() {
    for seal in seals().unwrap() {
        let values: Vec<f64> = seal.tunables().map(|tunable| tunable.value).collect();
        assert_eq!(seal.tuned(&values), Ok(seal));
        assert_eq!(seal.tuned(&[]), Ok(seal));
    }
}

/// Every single number can be raised by a tenth; forces stay finite and the model stays a model.
#[test]
fn each_parameter_turns_by_itself() {
    for seal in seals().unwrap() {
        let before: Vec<f64> = seal.tunables().map(|tunable| tunable.value).collect();
        for (k, tunable) in seal.tunables().enumerate() {
            let mut values = before.clone();
            values[k] = if values[k].is_finite() { 1.1 * values[k] } else { 0.1 };
            // A lag without creep, and a bank below the static force, are no models.
            let allowed = seal.tuned(&values);
            assert!(
                allowed.is_ok()
                    || matches!(
                        tunable.id.quantity,
                        Quantity::StaticRatio | Quantity::CoulombForce
                    ),
                "{tunable:?}: {allowed:?}"
            );
        }
    }
}

/// Steady sliding follows the parameters that were turned, EMS (16).
#[test]
fn a_turned_seal_slides_with_its_new_force() {
    let seal = seals().unwrap()[0];
    let index = |name: &str| {
        seal.tunables().position(|tunable| tunable.id.to_string() == name).expect("there is one")
    };
    let mut values: Vec<f64> = seal.tunables().map(|tunable| tunable.value).collect();
    values[index("insertion_coulomb_force_n")] = 4.0;
    values[index("insertion_viscous_damping_n_s_m")] = 10.0;
    values[index("withdrawal_coulomb_force_n")] = 1.5;
    values[index("half_width_m")] = 4e-3;
    let turned = seal.tuned(&values).unwrap();
    let mut state = turned.rest();
    let mut slide =
        |velocity: f64| (0..1000).map(|_| turned.step(&mut state, 1e-3 * velocity, 1e-3)).last();
    assert!((slide(0.05).unwrap() - (4.0 + 10.0 * 0.05)).abs() < 1e-9);
    assert!((slide(-0.05).unwrap() - (-1.5 - 5.0 * 0.05)).abs() < 1e-9);
}

/// What is listed is what is used, whatever else is turned.
#[test]
fn a_value_set_is_the_value_listed() {
    let seal = seals().unwrap()[1];
    let mut values: Vec<f64> = seal.tunables().map(|tunable| tunable.value).collect();
    for tunable in seal.tunables().zip(values.iter_mut()) {
        let of_insertion = Quantity::CoulombForce.of(Direction::Insertion);
        if tunable.0.id == Quantity::HalfWidth.id() || tunable.0.id == of_insertion {
            *tunable.1 *= 0.5;
        }
    }
    let turned: Vec<f64> =
        seal.tuned(&values).unwrap().tunables().map(|tunable| tunable.value).collect();
    for ((asked, found), tunable) in values.iter().zip(&turned).zip(seal.tunables()) {
        assert!((asked - found).abs() <= 1e-12 * asked.abs(), "{tunable:?}: {found}");
    }
}

/// Outside its range a profile fades to none over a quarter of it: 12.5 mm here.
#[test]
fn a_profile_fades_outside_its_range() {
    let profile = profile();
    let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-15, "{a}, expected {b}");
    for (end, side, offset, level) in
        [(-0.02, -1.0, OFFSET[0], GAIN[0]), (0.03, 1.0, OFFSET[2], GAIN[2])]
    {
        for part in [0.0, 0.2, 0.5, 0.9, 1.0, 1.1, 1e3, 1e300] {
            let x = end + side * part * 0.0125;
            let left = (1.0_f64 - part).max(0.0);
            close(profile.offset(x), left * offset);
            close(profile.gain(x), 1.0 + left * (level - 1.0));
            assert!((profile.without(x, profile.apply(x, 2.5)) - 2.5).abs() < 1e-14);
        }
        for far in [side * f64::INFINITY, side * f64::MAX] {
            assert_eq!((profile.offset(far), profile.gain(far)), (0.0, 1.0));
            assert_eq!(profile.apply(far, 2.5), 2.5);
        }
    }
    assert_eq!((profile.offset(f64::NAN), profile.gain(f64::NAN)), (OFFSET[0], GAIN[0]));
    let outside = [-0.03, -0.02, 0.0, 0.03, 0.05].map(|x| profile.outside(x));
    assert!((outside[0] - 0.01).abs() < 1e-15 && (outside[4] - 0.02).abs() < 1e-15);
    assert_eq!(outside[1..4], [0.0; 3]);
}

#[test]
fn inputs_that_are_no_motion_leave_all_as_it_was() {
    for seal in seals().unwrap() {
        let trocar = Trocar::new(seal, Some(profile()));
        let mut state = trocar.rest(0.01);
        trocar.step(&mut state, 1e-3, 1e-3);
        let before = state;
        for (displacement, duration) in [
            (f64::NAN, 1e-3),
            (1e-3, f64::NAN),
            (f64::INFINITY, 1e-3),
            (1e-3, 0.0),
            (1e-3, -1.0),
            (1e-3, f64::INFINITY),
            (1e308, 1e-308),
        ] {
            assert_eq!(
                trocar.step(&mut state, displacement, duration).to_bits(),
                before.force().to_bits()
            );
            trocar.step_to(&mut state, displacement * f64::NAN, duration);
            assert_eq!(state, before);
        }
    }
}

/// The seal let go at its static force and moved back to that of sliding, however fast it slid: its
/// force at rest tells its state, and with that all that follows.
#[test]
fn a_seal_that_slid_and_rests_is_known_from_its_force() -> Result<(), ParamError> {
    let plausible = ElementParams::plausible_10_5_mm()?;
    let static_force = plausible.insertion.static_force;
    let sliding = SlidingFriction {
        static_force,
        stribeck_velocity: 0.02,
        ..SlidingFriction::coulomb(0.85 * static_force, 1.0)
    };
    let params = ElementParams { insertion: sliding, withdrawal: sliding, ..plausible };
    let seal = Stages::from(Element::new(params)?);
    for (direction, velocity) in
        [(Direction::Insertion, 0.06), (Direction::Insertion, 0.3), (Direction::Withdrawal, -0.1)]
    {
        let mut state = seal.rest_at_force(0.0);
        for _ in 0..4000 {
            seal.step(&mut state, velocity * 2e-4, 2e-4);
        }
        let force = seal.step(&mut state, 0.0, 0.1);
        let mut known = seal.rest_after(direction, force);
        assert!((Stages::force(&known) - force).abs() < 1e-6 * static_force);
        for _ in 0..400 {
            let after = seal.step(&mut state, -velocity * 5e-4, 1e-3);
            let from_force = seal.step(&mut known, -velocity * 5e-4, 1e-3);
            assert!((after - from_force).abs() < 1e-3 * static_force, "{after} {from_force}");
        }
    }
    Ok(())
}
