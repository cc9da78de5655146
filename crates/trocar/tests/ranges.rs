//! Published ranges: the document, and the seals drawn from it.

use std::fs;

use trocar::bench::published::{Printed, PublishedError, Quantity, studies, study};
use trocar::bench::{PlausibleSeals, random_seal};

/// Rounding of a product of two numbers.
const ROUNDING: f64 = 1e-12;

#[test]
fn every_study_has_a_citation() {
    let sources = fs::read_to_string("../../SOURCES.md").unwrap();
    assert!(studies().len() >= 3);
    for study in studies() {
        assert!(sources.contains(&format!("**{}** ", study.source)), "{}", study.source);
        assert!(!study.numbers.is_empty(), "{}", study.key);
    }
}

#[test]
fn every_number_is_possible_and_every_key_is_of_one_study() {
    for (k, study) in studies().iter().enumerate() {
        assert!(studies()[..k].iter().all(|other| other.key != study.key), "{}", study.key);
        for Printed { quantity, range: [low, high], .. } in &study.numbers {
            let is_change = matches!(
                quantity,
                Quantity::FrictionChangePercent | Quantity::PeakForceChangePercent
            );
            let least = if is_change { -100.0 } else { f64::MIN_POSITIVE };
            assert!(least <= *low && low <= high && high.is_finite(), "{}", study.key);
        }
    }
}

#[test]
fn all_ranges_of_a_study_count_and_a_narrow_one_is_kept() {
    let with = |ranges: &[[f64; 2]]| {
        let force = &study("dobbelsteen-2007").unwrap().numbers[0];
        let numbers = ranges.iter().map(|range| Printed { range: *range, ..force.clone() });
        let mut study = study("dobbelsteen-2007").unwrap().clone();
        study.numbers = numbers.collect();
        study
    };
    assert_eq!(with(&[[1.0, 3.0], [0.5, 2.0]]).friction_force(), Some([0.5, 3.0]));
    for [low, high] in [[2.0, 2.0], [2.0, 2.01]] {
        let seal = random_seal(&with(&[[low, high]]).seals().unwrap(), 1);
        for force in [seal.insertion.coulomb_force, seal.withdrawal.coulomb_force] {
            assert!((low - ROUNDING..=high + ROUNDING).contains(&force), "{low} {high}: {force}");
        }
    }
}

#[test]
fn drawn_seals_have_the_printed_friction_in_both_directions() {
    let printed = studies().iter().filter_map(|study| Some((study, study.friction_force()?)));
    let mut count = 0;
    for (study, [low, high]) in printed {
        let ranges = study.seals().unwrap();
        let mut forces = Vec::new();
        for seed in 0..200 {
            let seal = random_seal(&ranges, seed);
            forces.extend([seal.insertion.coulomb_force, seal.withdrawal.coulomb_force]);
        }
        let (least, most) = forces.iter().fold((f64::INFINITY, 0.0_f64), |(least, most), force| {
            (least.min(*force), most.max(*force))
        });
        assert!(least >= low * (1.0 - ROUNDING) && most <= high * (1.0 + ROUNDING));
        // 200 uniform draws fill all but a tenth of the range at either end.
        let tenth = 0.1 * (high - low);
        assert!(least < low + tenth && most > high - tenth, "{}: {least} to {most}", study.key);
        let rest = PlausibleSeals { coulomb_force: ranges.coulomb_force, ..Default::default() };
        assert_eq!(ranges, rest, "nothing but the force is from the source");
        count += 1;
    }
    assert!(count >= 2);
}

#[test]
fn a_study_without_force_and_an_unknown_one_are_refused() {
    let error = study("ems-2010").unwrap().seals().unwrap_err();
    assert!(matches!(error, PublishedError::NoForce { .. }));
    let message = study("ems").unwrap_err().to_string();
    for key in studies().iter().map(|study| &study.key) {
        assert!(message.contains(key.as_str()), "{message}");
    }
}
