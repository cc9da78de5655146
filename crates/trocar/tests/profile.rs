//! Position-dependent force: estimates for a known profile, rejected profiles, and passivity in all
//! motions.

use crate::benches::benches;
use crate::skipped::skipped;
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use trocar::identify::{IdentifyOptions, identify};
use trocar::profile::{
    Departure, NoProfile, ProfileSample, cycles, fit, is_passive, longest_storage, storage_length,
};
use trocar::recording::{ReadOptions, Recording, read};
use trocar::segment::{reversal_threshold, strokes};
use trocar::validate::{Validation, validate, validate_one};
use trocar_model::{
    Branch, DeformationForce, Element, ElementParams, Piece, PositionProfile, ProfileError, Trocar,
};

/// Half width of the uniform noise of the simulated readings, N: standard deviation 0.058 N.
const NOISE: f64 = 0.1;
/// Ends of the simulated strokes, m.
const ENDS: [f64; 2] = [0.01, 0.09];
/// Strokes, steps each way and their duration, s.
const CYCLES: usize = 8;
const STEPS: usize = 1500;
const STEP: f64 = 2e-3;
/// Allowed error of the estimated gain and offset (N) where the seal slides in both directions: a
/// third of the noise of one reading, relative to 4 N of force for the gain.
const LEVEL_TOLERANCE: f64 = 0.015;
const OFFSET_TOLERANCE: f64 = 0.04;
/// Error of the trapezoidal rule in one step, J: 1e-9 of the energy stored in the seal.
const ENERGY_TOLERANCE: f64 = 1e-12;

fn element() -> Element {
    Element::new(ElementParams::plausible_10_5_mm().expect("plausible")).expect("plausible")
}

/// Readings of strokes with this offset (N) and gain, and the force of the element alone.
fn samples(
    offset: impl Fn(f64) -> f64,
    level: impl Fn(f64) -> f64,
    seed: u64,
) -> Vec<ProfileSample> {
    let (element, mut rng) = (element(), ChaCha8Rng::seed_from_u64(seed));
    let mut state = element.rest_state(0.0);
    let (mut samples, mut position) = (Vec::new(), ENDS[0]);
    for cycle in 0..CYCLES {
        for side in [1.0, -1.0] {
            for _ in 0..STEPS {
                let step = side * (ENDS[1] - ENDS[0]) / STEPS as f64;
                position += step;
                let seal_force = element.step(&mut state, step, STEP);
                let noise = NOISE * (2.0 * rng.random::<f64>() - 1.0);
                let reading = offset(position) + level(position) * seal_force + noise;
                samples.push(ProfileSample { position, seal_force, reading, cycle });
            }
        }
    }
    samples
}

fn wave(x: f64) -> f64 {
    (x * std::f64::consts::TAU / 0.02).sin()
}

/// Positions at which the seal slides in both directions: away from the ends by the deformation.
fn inside() -> impl Iterator<Item = f64> {
    (0..=100).map(|k| ENDS[0] + 0.018 + 0.44e-3 * f64::from(k))
}

#[test]
fn a_known_profile_is_found() {
    let samples = samples(|x| 0.7 + 0.2 * wave(x + 0.004), |x| 1.0 + 0.1 * wave(x), 1);
    let found = fit(&samples, storage_length(&element())).expect("a clear profile");
    let scale = inside().map(|x| found.profile.gain(x)).sum::<f64>()
        / inside().map(|x| 1.0 + 0.1 * wave(x)).sum::<f64>();
    for x in inside() {
        let level = found.profile.gain(x) / scale - (1.0 + 0.1 * wave(x));
        assert!(level.abs() < LEVEL_TOLERANCE, "level at {x} m off by {level}");
        let offset = found.offset_n + found.profile.offset(x) - (0.7 + 0.2 * wave(x + 0.004));
        assert!(offset.abs() < OFFSET_TOLERANCE, "offset at {x} m off by {offset} N");
    }
    // Uniform noise of ±a has the standard deviation a/√3; the error of an estimate from seven
    // cycles adds little.
    let floor = NOISE / 3f64.sqrt();
    assert!(
        found.held_out_rms_n < 1.05 * floor,
        "{} N over a floor of {floor} N",
        found.held_out_rms_n
    );
    assert!(found.constant_held_out_rms_n > 3.0 * floor);
    assert_eq!(found.better_folds, found.folds);
    assert!(found.effective_parameters <= (found.free_parameters() + 1) as f64);
}

#[test]
fn no_profile_is_seen_where_there_is_none() {
    for seed in 0..20 {
        let refused = fit(&samples(|_| 0.7, |_| 1.0, seed), storage_length(&element()));
        assert!(matches!(refused, Err(NoProfile::NotBetter { .. })), "seed {seed}: {refused:?}");
    }
}

/// The reason is not that the force does not depend on the position, where it does.
#[test]
fn a_profile_that_the_seal_does_not_permit_is_distinguished_from_none() {
    let samples = samples(|_| 0.7, |x| 1.0 + 0.4 * wave(x), 3);
    let free = fit(&samples, 0.0).expect("a clear profile");
    for length in [10.0, f64::INFINITY] {
        let Err(NoProfile::NotDissipative { any, storage_length }) = fit(&samples, length) else {
            panic!("refused for {length} m");
        };
        assert_eq!((*any, storage_length), (free.clone(), length));
        assert!(free.held_out_rms_n < 0.5 * free.constant_held_out_rms_n, "{free:?}");
    }
}

#[test]
fn a_profile_of_one_cycle_is_not_accepted() {
    // Each cycle has its own bumps: they can be fitted but do not repeat.
    let mut samples = samples(|_| 0.7, |_| 1.0, 1);
    for s in &mut samples {
        s.reading += 0.3 * wave(s.position + 0.0025 * s.cycle as f64);
    }
    let refused = fit(&samples, storage_length(&element()));
    assert!(matches!(refused, Err(NoProfile::NotBetter { .. })), "{refused:?}");
    samples.retain(|s| s.cycle < 2);
    assert_eq!(fit(&samples, 0.0).unwrap_err(), NoProfile::TooFewCycles { cycles: 2 });
}

#[test]
fn the_gauge_is_kept() {
    let profile = fit(&samples(|x| 0.7 + 3.0 * x, |x| 1.2 + x, 2), 0.01).expect("a slope").profile;
    let n = 20_000;
    let along = |k: i32| {
        profile.from() + (profile.to() - profile.from()) * (f64::from(k) + 0.5) / f64::from(n)
    };
    let mean = |of: &dyn Fn(f64) -> f64| (0..n).map(|k| of(along(k))).sum::<f64>() / f64::from(n);
    assert!((mean(&|x| profile.gain(x)) - 1.0).abs() < 1e-6);
    assert!(mean(&|x| profile.offset(x)).abs() < 1e-6);
    assert_eq!(profile.gain(profile.from() - 1.0), 1.0);
    assert_eq!(profile.offset(profile.to() + 1.0), 0.0);
}

#[test]
fn a_level_too_steep_for_the_seal_is_refused() {
    let samples = samples(|_| 0.7, |x| 1.0 + 0.2 * wave(x), 3);
    // 0.2·2π/0.02 = 63 per metre at its steepest, divided by a gain of 0.8.
    assert!(fit(&samples, 0.01).is_ok());
    let refused = fit(&samples, 1.0);
    assert!(!matches!(&refused, Ok(found) if !is_passive(&found.profile, 1.0)));
    assert!(refused.is_err(), "{refused:?}");
}

#[test]
fn values_are_checked() {
    use ProfileError::{Interval, Knots, Value};
    let make = |from, offset: &[f64], gain: &[f64]| {
        PositionProfile::new(from, 0.1, offset.to_vec(), gain.to_vec()).err()
    };
    assert_eq!(make(0.0, &[0.5, 0.6, 0.5], &[1.1, 0.9, 1.1]), None);
    assert_eq!(make(0.1, &[0.0; 2], &[1.0; 2]), Some(Interval { from: 0.1, to: 0.1 }));
    assert_eq!(make(0.0, &[0.0; 2], &[1.0; 3]), Some(Knots { offset: 2, gain: 3 }));
    assert_eq!(make(0.0, &[0.0], &[1.0]), Some(Knots { offset: 1, gain: 1 }));
    assert_eq!(
        make(0.0, &[0.0; 2], &[1.0, -0.9]),
        Some(Value { name: "gain", knot: 1, value: -0.9 })
    );
    let nan = make(0.0, &[0.0, f64::NAN], &[1.0; 2]);
    assert!(matches!(nan, Some(Value { name: "offset", knot: 1, .. })), "{nan:?}");
}

/// Smallest work of a driver at any time of a motion of `moves` (end position in m, speed in m/s)
/// from rest, J. The offset is omitted, since its work is that of a potential.
fn least_work(profile: &PositionProfile<Vec<f64>>, element: &Element, moves: &[(f64, f64)]) -> f64 {
    const FINE: f64 = 2e-5;
    let mut state = element.rest_at_force(0.0);
    let (mut x, mut force, mut work, mut least) = (moves[0].0, 0.0, 0.0, 0.0_f64);
    for (end, speed) in moves {
        let steps = ((end - x).abs() / FINE).ceil().max(1.0);
        let step = (end - x) / steps;
        for _ in 0..steps as usize {
            let seal_force = element.step(&mut state, step, step.abs().max(1e-12) / speed);
            x += step;
            let next = profile.gain(x) * seal_force;
            work += 0.5 * (force + next) * step;
            force = next;
            least = least.min(work);
        }
    }
    least
}

/// Gains with the steepest slope that the bound allows.
fn steepest(seed: u64, storage_length: f64) -> PositionProfile<Vec<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let raw: Vec<f64> = (0..21).map(|_| rng.random::<f64>() - 0.5).collect();
    let mean = raw.windows(2).map(|p| 0.5 * (p[0] + p[1])).sum::<f64>() / 20.0;
    let with = |size: f64| {
        let level = raw.iter().map(|r| 1.0 + size * (r - mean)).collect();
        PositionProfile::new(0.0, 0.1, vec![0.0; 21], level).expect("positive")
    };
    let (mut low, mut high) = (0.0, 1.5);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if is_passive(&with(middle), storage_length) { low = middle } else { high = middle }
    }
    with(low)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_motion_yields_work(
        seed in 0..1000u64,
        moves in prop::collection::vec((-0.04..0.14f64, 0.001..0.1f64), 2..30),
        near in prop::collection::vec((-0.02..0.02f64, 0.001..0.1f64), 2..30),
    ) {
        let element = element();
        let profile = steepest(seed, storage_length(&element));
        let about: Vec<(f64, f64)> = near.iter().map(|(d, v)| (moves[0].0 + d, *v)).collect();
        let all: Vec<(f64, f64)> = moves.iter().chain(&about).chain(&moves).copied().collect();
        let least = least_work(&profile, &element, &all);
        prop_assert!(least > -ENERGY_TOLERANCE, "{} J given off", -least);
    }
}

/// A seal that snaps through: the force rises to 1.2 times the sliding force at -c/2, falls to -0.4
/// of it at c/2, and rises.
fn snaps_through() -> Element {
    let plausible = *element().params();
    let (c, f) = (8e-3, plausible.insertion.static_force);
    let bend = |from: f64, to: f64, low: f64, high: f64, curvature: f64| {
        Piece::new(from, to, &[0.5 * (low + high) - curvature, 0.5 * (high - low), curvature])
            .expect("a piece")
    };
    let branch =
        Branch::new(bend(-c, 0.0, -f, 0.4 * f, -0.6 * f), bend(0.0, c, 0.4 * f, f, 0.6 * f))
            .expect("joined");
    let deformation = DeformationForce::new(branch, branch, None).expect("a seal");
    Element::new(ElementParams { deformation, ..plausible }).expect("a seal")
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 32, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_motion_yields_work_from_a_seal_that_snaps_through(
        seed in 0..1000u64,
        moves in prop::collection::vec((0.0..0.1f64, 0.001..0.1f64), 2..20),
    ) {
        let element = snaps_through();
        let length = storage_length(&element);
        prop_assert!(length > 1e-3, "a falling curve: {length} m");
        let all: Vec<(f64, f64)> = moves.iter().chain(&moves).copied().collect();
        let least = least_work(&steepest(seed, length), &element, &all);
        prop_assert!(least > -2.0 * element.params().insertion.static_force * 8e-3, "{} J given off", -least);
    }
}

#[test]
fn a_curve_that_rises_takes_any_level() {
    let c = 8e-3;
    let plausible = *element().params();
    let deformation =
        DeformationForce::linear(plausible.insertion.static_force / c, c).expect("a spring");
    let element = Element::new(ElementParams { deformation, ..plausible }).expect("a spring");
    assert_eq!(storage_length(&element), 0.0);
    // Deform where the gain is low, slide by a tenth of c to where it is a hundred times higher,
    // then release.
    let profile =
        PositionProfile::new(0.0, 0.1 * c, vec![0.0; 2], vec![0.02, 1.98]).expect("positive");
    assert!(is_passive(&profile, 0.0));
    let least = least_work(&profile, &element, &[(0.0, 0.01), (1.2 * c, 0.01), (0.2 * c, 0.01)]);
    assert!(least > -ENERGY_TOLERANCE, "{least} J");
}

#[test]
fn the_fade_outside_the_range_counts_for_passivity() {
    let profile =
        PositionProfile::new(0.0, 0.1, vec![0.0; 3], vec![1.1, 0.95, 1.0]).expect("mean 1");
    // Inside 0.15 over 50 mm, outside 0.1 over 25 mm, divided by the smallest gain of 0.95.
    assert!((profile.steepness() - 0.1 / 0.025 / 0.95).abs() < 1e-12);
    assert!(is_passive(&profile, 0.2) && !is_passive(&profile, 0.25));
}

#[test]
fn motion_outside_the_range_is_reported_once() {
    let profile =
        PositionProfile::new(0.02, 0.1, vec![0.0, 0.3, 0.1], vec![1.1, 0.9, 1.1]).expect("mean 1");
    assert_eq!(Departure::of(&profile, 0.0195, 0.1005), None);
    let found = Departure::of(&profile, 0.01, 0.1353).expect("35.3 mm outside");
    assert_eq!(
        found.to_string(),
        "the motion goes up to 35.3 mm outside the range from 20 mm to 100 mm in which the position profile was measured; \
         there the profile fades to none within 20 mm"
    );
    // Two pieces of one recording, one of them further outside: one warning with the larger
    // distance.
    let element = element();
    let piece = |to: f64| {
        let time: Vec<f64> = (0..4000).map(|k| 1e-3 * f64::from(k)).collect();
        let position: Vec<f64> =
            time.iter().map(|t| 0.06 + (to - 0.06) * (3.0 * t).sin()).collect();
        let force = vec![0.0; time.len()];
        let recording =
            Recording::from_columns("piece", time, position, force).expect("a recording");
        validate_one(&Trocar::new(element, Some(profile.clone())), &recording, 0.0)
    };
    let both = Validation::of(vec![piece(0.12).plus(piece(0.13)).plus(piece(0.09))]);
    let warnings: Vec<&String> =
        both.recordings[0].warnings.iter().filter(|warning| warning.contains("profile")).collect();
    assert!(warnings.len() == 1 && warnings[0].contains("30 mm outside"), "{warnings:?}");
    assert!(both.is_doubtful());
}

/// Largest error on strokes not used for identification, in units of their scatter.
const MOST: f64 = 1.5;

/// The cycles of `recording` with these numbers, as a separate recording.
fn part(recording: &Recording, chosen: impl Fn(usize) -> bool) -> Recording {
    let cycle = cycles(recording, &strokes(recording, reversal_threshold(recording)));
    let kept = (0..recording.len()).filter(|i| chosen(cycle[*i]));
    let column = |values: &[f64]| kept.clone().map(|i| values[i]).collect();
    let columns =
        [&recording.time, &recording.position, &recording.force].map(|values| column(values));
    let [time, position, force] = columns;
    Recording::from_columns(recording.name.clone(), time, position, force)
        .expect("columns of a recording")
}

/// Recordings of real seals (ZILLEN); `None`, with the reason printed, where they are missing.
fn real_seals<const N: usize>(names: [&str; N]) -> Option<[Recording; N]> {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../../shared/recordings/elastomer_seals");
    if !folder.is_dir() {
        assert!(
            std::env::var("TROCAR_REQUIRE_SHARED").is_err(),
            "no recordings in {}",
            folder.display()
        );
        skipped(&format!("no recordings in {}", folder.display()));
        return None;
    }
    Some(names.map(|name| {
        let recording = read(&folder.join(format!("{name}.csv")), &ReadOptions::default());
        recording.expect("a recording").without_glitches()
    }))
}

/// A seal that creeps and whose deformation force falls gets no gain that varies, and one that is refitted beside its
/// profile does not begin to fall.
#[test]
fn a_real_seal_with_its_profile_yields_no_energy() {
    let names = ["x_ring257_1bar", "kdn_1bar", "napn_1bar", "o_ring_1bar"];
    let Some(recordings) = real_seals(names) else { return };
    let mut with = Vec::new();
    for (name, recording) in names.into_iter().zip(recordings) {
        let found =
            identify(&[recording], &IdentifyOptions::default(), &|_, _| {}).expect("it slides");
        let trocar = found.trocar();
        let Some(profile) = trocar.profile() else { continue };
        with.push(name);
        let length = longest_storage(trocar.seal().stages().expect("an EMS model"));
        assert!(is_passive(profile, length), "{name}: {length} m");
    }
    assert!(with.starts_with(&names[..2]) && with.len() >= 3, "{with:?} have a profile");
}

/// Positions that differ by half a micrometre are the same recording: most copies of it get the profile, and of none is said
/// that its force does not depend on the position.
#[test]
fn a_profile_of_a_real_seal_does_not_depend_on_half_a_micrometre() {
    let Some([recording]) = real_seals(["x_ring257_1bar"]) else { return };
    let copy = |seed: u64| {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let moved = recording.position.iter().map(|x| x + 1e-6 * (rng.random::<f64>() - 0.5));
        let (time, force) = (recording.time.clone(), recording.force.clone());
        let copy = Recording::from_columns("copy", time, moved.collect(), force).expect("a copy");
        identify(&[copy], &IdentifyOptions::default(), &|_, _| {}).expect("it slides")
    };
    let all: Vec<_> = (1..=benches(8, 24)).into_par_iter().map(copy).collect();
    let with = all.iter().filter(|found| found.trocar().profile().is_some()).count();
    println!("{with} of {} copies have a profile", all.len());
    for found in &all {
        let why = found.no_position_profile.as_deref().unwrap_or_default();
        assert!(!why.contains("no repeatable"), "{why}");
    }
    assert!(5 * with >= 3 * all.len(), "{with} of {}", all.len());
}

#[test]
fn held_out_strokes_of_real_seals_come_near_their_scatter() {
    let names = ["pk_1bar", "o_ring_1bar"];
    let Some(recordings) = real_seals(names) else { return };
    for (name, recording) in names.into_iter().zip(recordings) {
        let [odd, even] = [1, 0].map(|rest| part(&recording, |stroke| stroke % 2 == rest));
        let options = IdentifyOptions::default();
        let found = identify(&[even], &options, &|_, _| {}).expect("strokes at constant speed");
        let held_out = found.without_delay(vec![odd]).expect("long enough");
        let scores = validate(&found.trocar(), &held_out, found.model.offset);
        let strokes = scores.recordings[0].strokes.expect("five strokes that repeat");
        println!("{name}: {}", strokes.words());
        assert!(strokes.rms_over_scatter < MOST, "{name}: {}", strokes.words());
        // Sampled too coarsely to distinguish a delay from the rate dependence of the rubber.
        assert_eq!(found.position_delay, None);
    }
}
