//! The observer of the tissue force: accuracy, conditions under which it must not adapt, and sensor
//! faults.

use std::path::Path;
use std::sync::LazyLock;

use crate::skipped::skipped;
use proptest::prelude::*;
use trocar::bench::config::{Lubrication, TissueKind};
use trocar::bench::random::random_plausible_seal;
use trocar::bench::{BenchConfig, BenchRun, Protocol, run};
use trocar::compensate::{CompensateError, CompensateOptions, Compensator, Drift, Estimate, Fault};
use trocar::identify::{IdentifyOptions, identify};
use trocar::model_file::{
    ErrorSource, ForceError, ModelFile, Origin, OriginKind, ReadWith, RecordingInfo, SensorInfo,
};
use trocar::recording::{Choice, ReadOptions, Recording, read};
use trocar::validate::validate;
use trocar::workflow::{MovingMass, Workflow};
use trocar_model::{
    Classical, DeformationForce, Element, ElementParams, Seal, SlidingFriction, StaticFriction,
    Trocar,
};

/// Normal quantile of a band of 95 %.
const BAND: f64 = 1.96;

fn seal() -> [Element; 1] {
    [Element::new(ElementParams::plausible_10_5_mm().unwrap()).unwrap()]
}

fn surgeon(duration_s: f64, change: impl FnOnce(&mut BenchConfig)) -> BenchConfig {
    let mut config = BenchConfig::default();
    config.protocol.surgeon.duration_s = duration_s;
    change(&mut config);
    config
}

/// Identified on the bench from steady and dynamic, validated on validation and surgeon: the
/// typical model of a user.
static MODEL: LazyLock<ModelFile> = LazyLock::new(|| {
    let config = BenchConfig::default();
    let record = |protocol| {
        let recording = run(&config, protocol, &seal(), 1).unwrap().to_recording("bench").unwrap();
        recording.without_moving_mass(config.rod.mass_kg, 0.0).unwrap()
    };
    let options = IdentifyOptions::default();
    let found =
        identify(&[record(Protocol::Steady), record(Protocol::Dynamic)], &options, &|_, _| {})
            .unwrap();
    let held_out = [record(Protocol::Validation), record(Protocol::Surgeon)];
    let validation = validate(&Trocar::of_seal(found.stages), &held_out, found.model.offset);
    let mut file = ModelFile::new(found.stages, Origin::new(OriginKind::Identified));
    file.sensor = Some(SensorInfo {
        offset_n: found.model.offset,
        moving_mass_kg: config.rod.mass_kg,
        ..SensorInfo::default()
    });
    file.force_error = Some(validation.force_error(ErrorSource::Validation));
    file
});

fn observe(observer: &mut Compensator, run: &BenchRun) -> Vec<Estimate> {
    let duration = |k: usize| if k == 0 { 0.0 } else { run.time[k] - run.time[k - 1] };
    (0..run.time.len()).map(|k| observer.step(run.position[k], run.force[k], duration(k))).collect()
}

fn observer(adaptation: bool) -> Compensator {
    Compensator::new(&MODEL, &CompensateOptions { adaptation, ..CompensateOptions::default() })
        .unwrap()
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (squares, count) = values.fold((0.0, 0.0), |(s, n), v| (s + v * v, n + 1.0));
    (squares / f64::max(count, 1.0)).sqrt()
}

/// The tissue force counts as correct within this of the true value: about twice the noise of the
/// bench's sensor, N.
const FOUND: f64 = 0.06;

/// In tissue of either law the error stays that of the model, although the tissue force is many
/// times the friction.
#[test]
fn the_tissue_force_is_found() {
    for kind in [TissueKind::HuntCrossley, TissueKind::KelvinVoigt] {
        let config = surgeon(60.0, |config| {
            config.tissue.kind = kind;
            config.tissue.surface_m = 0.07;
        });
        let record = run(&config, Protocol::Surgeon, &seal(), 21).unwrap();
        let truth = &record.truth.tissue_force;
        assert!(rms(truth.iter().copied()) > 1.0, "there is tissue to be found");
        for adaptation in [false, true] {
            let said = observe(&mut observer(adaptation), &record);
            let known = (0..said.len()).filter(|k| record.time[*k] > 8.0);
            let error = rms(known.clone().map(|k| said[k].tissue_force - truth[k]));
            assert!(error < FOUND, "{kind:?} {adaptation}: {error}");
            let covered = known
                .clone()
                .filter(|k| (said[*k].tissue_force - truth[*k]).abs() < BAND * said[*k].std);
            let coverage = covered.count() as f64 / known.count() as f64;
            assert!((0.92..=0.999).contains(&coverage), "{kind:?} {adaptation}: {coverage}");
        }
    }
}

/// A random seal with a random law between its branches, identified from and validated on full
/// strokes only.
fn stranger(seed: u64) -> ([Element; 1], ModelFile) {
    let mut params = random_plausible_seal(1000 + seed);
    let force = params.deformation;
    let stiffness = force.yield_stiffness() * 10f64.powf((seed as f64 * 0.618).fract());
    params.deformation =
        DeformationForce::new(*force.insertion(), *force.withdrawal(), Some(stiffness)).unwrap();
    let seal = [Element::new(params).unwrap()];
    let config = BenchConfig::default();
    let record = |protocol, number| {
        let recording = run(&config, protocol, &seal, 100 * seed + number)
            .unwrap()
            .to_recording("bench")
            .unwrap();
        recording.without_moving_mass(config.rod.mass_kg, 0.0).unwrap()
    };
    let options = IdentifyOptions { inertia_removed: true, ..IdentifyOptions::default() };
    let recordings = [record(Protocol::Steady, 1), record(Protocol::Dynamic, 2)];
    let found = identify(&recordings, &options, &|_, _| {}).unwrap();
    let held_out = [record(Protocol::Validation, 3)];
    let moving_mass = MovingMass { mass: config.rod.mass_kg, gravity: 0.0 };
    (
        seal,
        Workflow::of(found, options, recordings.to_vec(), held_out.to_vec(), moving_mass)
            .model_file(),
    )
}

/// Seals of other seeds, dry and wetted during the run, in full strokes and in hand-like motion
/// without validation: the 95 % band contains the true force in 90 to 98 % of the samples.
#[test]
fn the_band_holds_on_independent_seals() {
    let strangers: Vec<_> = (1..=6).map(stranger).collect();
    for protocol in [Protocol::Steady, Protocol::Surgeon] {
        for level in [1.0, 0.7] {
            let (mut inside, mut all) = (0.0, 0.0);
            for (seed, (seal, model)) in (1..).zip(&strangers) {
                let mut config = surgeon(50.0, |_| {});
                (config.protocol.steady.stroke_m, config.protocol.steady.slowest_m_s) =
                    (0.045, 0.02);
                config.lubrication =
                    Lubrication { level, onset_s: 12.0, spread_s: 5.0, ..config.lubrication };
                let record = run(&config, protocol, seal, 7000 + seed).unwrap();
                let mut observer = Compensator::new(model, &CompensateOptions::default()).unwrap();
                let said = observe(&mut observer, &record);
                for (k, estimate) in said.iter().enumerate().filter(|(k, _)| record.time[*k] > 5.0)
                {
                    let error = estimate.tissue_force - record.truth.tissue_force[k];
                    inside += f64::from(u8::from(error.abs() <= BAND * estimate.std));
                    all += 1.0;
                }
            }
            let coverage = inside / all;
            println!("{protocol}, friction {level}: {:.1} %", 100.0 * coverage);
            assert!((0.90..=0.98).contains(&coverage), "{protocol}, friction {level}: {coverage}");
        }
    }
}

/// In a phase that no recording contains, the band is wider than in any other, and between the
/// branches it reaches from one law to the other.
#[test]
fn what_was_never_validated_has_a_wider_band() {
    let mut file = MODEL.clone();
    let known = file.force_error.unwrap();
    assert!(known.partial_n.is_some() && known.held_n.is_some(), "{known:?}");
    file.force_error = Some(ForceError { partial_n: None, held_n: None, ..known });
    let options = CompensateOptions { adaptation: false, ..CompensateOptions::default() };
    let (mut informed, mut ignorant) =
        (Compensator::new(&MODEL, &options).unwrap(), Compensator::new(&file, &options).unwrap());
    // Beyond the deformation, back by half of it, forward a little, and a rest there.
    let mut path = vec![];
    for (speed, samples) in [(0.03, 1500), (-0.03, 300), (0.03, 60), (0.0, 1000)] {
        path.extend(std::iter::repeat_n(speed, samples));
    }
    let mut position = 0.0;
    let mut said = Vec::new();
    for speed in path {
        position += 1e-3 * speed;
        said.push(
            [&mut informed, &mut ignorant].map(|observer| observer.step(position, 0.0, 1e-3).std),
        );
    }
    let [known_sliding, sliding] = said[1400];
    assert_eq!(sliding, known_sliding);
    let largest = known.deforming_n.into_iter().chain(known.sliding_n).fold(0.0, f64::max);
    for (k, what) in [(1859, "partial reversal"), (2859, "rest")] {
        let [known, unknown] = said[k];
        assert!(
            unknown >= 2.0 * largest && unknown > 1.5 * known,
            "{what}: {unknown} N, {known} N"
        );
    }
    let rest = said[2859][1];
    let gap = file.stages().unwrap().first().params().deformation.half_gap(2e-3);
    assert!(rest > 0.2 * gap && rest < 2.0 * gap, "{rest} N beside a half gap of {gap} N");
}

/// A constant load held for a minute of any motion is a tissue force: λ and ν stay unchanged, and
/// the load stays visible.
#[test]
fn a_constant_load_for_a_minute_is_never_learnt() {
    for (load, seed) in [(2.0, 31), (-1.0, 32), (0.5, 33), (0.2, 34)] {
        let config = surgeon(100.0, |config| {
            (config.tissue.load_n, config.tissue.load_from_s, config.tissue.load_until_s) =
                (load, 30.0, 90.0);
        });
        let record = run(&config, Protocol::Surgeon, &seal(), seed).unwrap();
        let mut observer = observer(true);
        let said = observe(&mut observer, &record);
        let drift = observer.drift();
        assert!((drift.level - 1.0).abs() < 0.03, "{load} N: {drift:?}");
        assert!((drift.viscosity - 1.0).abs() < 0.35, "{load} N: {drift:?}");
        let held = (0..said.len()).filter(|k| (35.0..88.0).contains(&record.time[*k]));
        let mean =
            held.clone().map(|k| said[k].tissue_force).sum::<f64>() / held.clone().count() as f64;
        assert!((mean - load).abs() < FOUND, "{load} N: {mean}");
        if load.abs() > 1.0 {
            let followed =
                held.clone().filter(|k| said[*k].adapting).count() as f64 / held.count() as f64;
            assert!(followed < 0.1, "frozen while touched: {followed}");
        }
    }
}

/// The same for a load during one long slide, in which friction and tissue cannot be distinguished:
/// no adaptation takes place.
#[test]
fn one_way_tells_nothing() {
    let file = &*MODEL;
    let mut observer = observer(true);
    let element = seal()[0];
    let mut state = element.rest_state(0.0);
    let offset = file.sensor.unwrap().offset_n;
    for k in 0..60_000 {
        let load = if k > 2000 { 1.5 } else { 0.0 };
        let force = element.step(&mut state, 2e-6, 1e-3) + load + offset;
        observer.step(2e-6 * f64::from(k), force, 1e-3);
    }
    let drift = observer.drift();
    assert_eq!((drift.level, drift.viscosity), (1.0, 1.0));
    assert!(!observer.last().adapting, "poor excitation");
    assert!(observer.last().tissue_force > 1.3);
}

/// The adaptation follows wetting or oiling of a seal within a few strokes, whatever the tissue
/// force.
#[test]
fn a_change_of_the_friction_is_followed() {
    for (wet, seed) in [(0.85, 41), (0.55, 42), (0.25, 43), (1.4, 44)] {
        let config = surgeon(110.0, |config| {
            config.lubrication =
                Lubrication { level: wet, onset_s: 20.0, spread_s: 3.0, ..config.lubrication };
            config.tissue.kind = TissueKind::KelvinVoigt;
            config.tissue.surface_m = 0.1;
        });
        let record = run(&config, Protocol::Surgeon, &seal(), seed).unwrap();
        let mut observer = observer(true);
        let said = observe(&mut observer, &record);
        let drift = observer.drift();
        assert!((drift.level - wet).abs() < 0.03 + 3.0 * drift.level_std, "{wet}: {drift:?}");
        let truth = &record.truth.tissue_force;
        let late = (0..said.len()).filter(|k| record.time[*k] > 60.0);
        let error = rms(late.clone().map(|k| said[k].tissue_force - truth[k]));
        let fixed = observe(&mut self::observer(false), &record);
        let without = rms(late.map(|k| fixed[k].tissue_force - truth[k]));
        assert!(
            error < 2.0 * FOUND && error < 0.5 * without,
            "{wet}: {error} N, {without} N without adaptation"
        );
    }
}

/// Adds `tissue(t)`, N, to a run of the bench, and returns errors of the observer from 30 s on, its
/// coverage and its drift.
fn under_load(seed: u64, tissue: impl Fn(f64, f64) -> f64) -> (f64, f64, Drift) {
    let mut record = run(&surgeon(90.0, |_| {}), Protocol::Surgeon, &seal(), seed).unwrap();
    let truth: Vec<f64> = (0..record.time.len())
        .map(|k| {
            if record.time[k] > 20.0 {
                tissue(record.time[k], record.truth.velocity[k])
            } else {
                0.0
            }
        })
        .collect();
    record.force.iter_mut().zip(&truth).for_each(|(reading, load)| *reading += load);
    let mut observer = observer(true);
    let said = observe(&mut observer, &record);
    assert!(said.iter().all(|e| e.fault.is_none()), "seed {seed}");
    let late: Vec<usize> = (0..said.len()).filter(|k| record.time[*k] > 30.0).collect();
    let error = rms(late.iter().map(|k| said[*k].tissue_force - truth[*k]));
    let covered = late
        .iter()
        .filter(|k| (said[**k].tissue_force - truth[**k]).abs() < BAND * said[**k].std)
        .count();
    (error, covered as f64 / late.len() as f64, observer.drift())
}

/// The adaptation ignores tissue forces: constant loads of any size and onset, breathing, loads in
/// one direction only.
#[test]
fn no_tissue_is_learnt_as_friction() {
    let turn = core::f64::consts::TAU;
    for seed in [5, 71, 72] {
        for load in [0.1, 0.3, 0.6, -0.4, 2.0] {
            let (error, coverage, drift) = under_load(seed, |_, _| load);
            assert!(
                error < FOUND && coverage > 0.9,
                "{load} N, seed {seed}: {error:.3} N, {coverage:.3}, {drift:?}"
            );
        }
        for (size, rate) in [(1.0, 0.25), (2.0, 0.25), (4.0, 0.25), (1.0, 0.1), (0.5, 1.0)] {
            let (error, coverage, drift) =
                under_load(seed, |t, _| size * libm::sin(turn * rate * t));
            let what = format!(
                "{size} N at {rate} Hz, seed {seed}: {error:.3} N, {coverage:.3}, {drift:?}"
            );
            assert!((drift.level - 1.0).abs() < 0.06 && error < 0.15, "{what}");
        }
        for (out, back) in [(0.0, -1.5), (0.0, -2.5), (-1.0, 0.0), (-2.5, 0.0), (2.0, 0.0)] {
            let (error, coverage, drift) =
                under_load(seed, |_, v| if v > 0.0 { out } else { back });
            let what =
                format!("{out} and {back} N, seed {seed}: {error:.3} N, {coverage:.3}, {drift:?}");
            assert!((drift.level - 1.0).abs() < 0.06 && error < 0.15, "{what}");
        }
        let (error, coverage, drift) =
            under_load(seed, |t, _| if ((t / 3.0) as u32).is_multiple_of(2) { 3.0 } else { 0.0 });
        assert!(
            (drift.level - 1.0).abs() < 0.06 && error < 0.15,
            "on and off: {error:.3} N, {coverage:.3}, {drift:?}"
        );
    }
}

/// The adaptation follows increasing viscosity, if slowly: the error is smaller than without it.
#[test]
fn viscosity_is_followed() {
    let config = surgeon(120.0, |config| {
        config.lubrication =
            Lubrication { viscosity: 2.0, onset_s: 15.0, spread_s: 5.0, ..config.lubrication };
        config.protocol.surgeon.fastest_m_s = 0.15;
    });
    let record = run(&config, Protocol::Surgeon, &seal(), 81).unwrap();
    let error = |observer: &mut Compensator| {
        let said = observe(observer, &record);
        rms((60_000..said.len()).map(|k| said[k].tissue_force))
    };
    let (mut fixed, mut following) = (observer(false), observer(true));
    let (without, with) = (error(&mut fixed), error(&mut following));
    let drift = following.drift();
    assert!((drift.viscosity - 2.0).abs() < 0.3 && (drift.level - 1.0).abs() < 0.06, "{drift:?}");
    assert!(with < 0.6 * without, "{with} N with, {without} N without");
}

/// The adaptation also follows a seal with more friction on insertion than on withdrawal.
#[test]
fn an_asymmetric_seal_is_followed() {
    let asymmetric = |level: f64| {
        let mut params = ElementParams::plausible_10_5_mm().unwrap();
        let seal = Seal::from(Element::new(params).unwrap());
        let mut values: Vec<f64> = seal.tunables().map(|tunable| tunable.value).collect();
        (values[1], values[5]) = (4.0 * level, 2.0 * level);
        values[0] *= level;
        let Seal::Ems(stages) = seal.tuned(&values).unwrap() else { unreachable!("stays EMS") };
        params = *stages.first().params();
        Element::new(params).unwrap()
    };
    let mut file = ModelFile::new(asymmetric(1.0), Origin::new(OriginKind::HandMade));
    file.force_error = Some(ForceError::everywhere(0.03));
    let mut observer = Compensator::new(&file, &CompensateOptions::default()).unwrap();
    let wet = asymmetric(0.85);
    let record = run(&surgeon(90.0, |_| {}), Protocol::Surgeon, &seal(), 91).unwrap();
    let mut state = wet.rest_state(0.0);
    for k in 1..record.time.len() {
        let force = wet.step(&mut state, record.position[k] - record.position[k - 1], 1e-3);
        observer.step(record.position[k], force + 0.02 * f64::from(k as u32 % 3) - 0.02, 1e-3);
    }
    assert!((observer.drift().level - 0.85).abs() < 0.02, "{:?}", observer.drift());
}

/// Until the seal has slid its force is unknown, and the band is accordingly wide.
#[test]
fn the_band_is_wide_until_the_seal_has_slid() {
    let record = run(&surgeon(20.0, |_| {}), Protocol::Surgeon, &seal(), 51).unwrap();
    let said = observe(&mut observer(true), &record);
    assert!(said[0].std > 1.0, "{}", said[0].std);
    assert!(said.last().unwrap().std < 0.6);
}

/// Sequences of samples in which position, reading and duration may each be wrong at any time.
fn samples() -> impl Strategy<Value = Vec<(f64, f64, f64)>> {
    let number = |usual: std::ops::Range<f64>| prop_oneof![8 => usual, 1 => Just(f64::NAN), 1 => Just(f64::INFINITY), 1 => Just(f64::NEG_INFINITY), 1 => Just(0.0), 1 => Just(1e300), 1 => Just(-1e300), 1 => Just(f64::MIN_POSITIVE)];
    prop::collection::vec((number(-0.05..0.05), number(-10.0..10.0), number(0.0..0.01)), 0..200)
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(200) })]

    /// The observer recovers from any input: afterwards it finds the tissue force in a clean stroke
    /// as usual.
    #[test]
    fn no_sample_spoils_the_observer(samples in samples()) {
        let mut observer = observer(true);
        for (position, force, duration) in samples {
            let said = observer.step(position, force, duration);
            prop_assert!(said.trocar_force.is_finite());
            prop_assert!(said.tissue_force.is_finite() || said.fault.is_some(), "{said:?}");
        }
        let drift = observer.drift();
        prop_assert!((0.1..=2.0).contains(&drift.level) && (0.0..=4.0).contains(&drift.viscosity));
        prop_assert!(drift.level_std.is_finite() && drift.viscosity_std.is_finite());
        let offset = MODEL.sensor.unwrap().offset_n;
        for k in 0..800 {
            // A reading that never changes would be another fault.
            observer.step(1e-4 * f64::from(k), offset + 1e-3 * f64::from(k % 2), 1e-3);
        }
        let last = observer.last();
        prop_assert!(last.fault.is_none() && last.tissue_force.is_finite() && last.std < 2.0, "{last:?}");
    }
}

/// Runs over a clean recording with one fault from 20 s on, and returns the estimates.
fn with_fault(change: impl Fn(usize, &mut f64, &mut f64, &mut f64)) -> (BenchRun, Vec<Estimate>) {
    let record = run(&surgeon(40.0, |_| {}), Protocol::Surgeon, &seal(), 61).unwrap();
    let options = CompensateOptions {
        sensor_limit_n: Some(15.0),
        adaptation: false,
        ..CompensateOptions::default()
    };
    let mut observer = Compensator::new(&MODEL, &options).unwrap();
    let mut said = Vec::new();
    for k in 0..record.time.len() {
        let mut duration = if k == 0 { 0.0 } else { 1e-3 };
        let (mut x, mut y) = (record.position[k], record.force[k]);
        change(k, &mut x, &mut y, &mut duration);
        said.push(observer.step(x, y, duration));
    }
    (record, said)
}

/// Error of the samples without fault, N, after the first 8 s.
fn clean_error(said: &[Estimate]) -> f64 {
    rms(said.iter().skip(8000).filter(|e| e.fault.is_none()).map(|e| e.tissue_force))
}

#[test]
fn a_dropout_of_50_ms_is_bridged() {
    let (_, said) = with_fault(|k, x, y, _| {
        if (20_000..20_050).contains(&k) {
            (*x, *y) = (f64::NAN, f64::NAN);
        }
    });
    let faults = said.iter().filter(|e| e.fault == Some(Fault::NoPosition)).count();
    assert_eq!(faults, 50);
    assert!(said[20_020].tissue_force.is_nan() && said[20_020].trocar_force.is_finite());
    assert!(clean_error(&said) < FOUND, "{}", clean_error(&said));
}

#[test]
fn a_frozen_force_is_noticed_once_the_motion_goes_on() {
    let held = std::cell::Cell::new(0.0);
    let (_, said) = with_fault(|k, _, y, _| {
        if k == 20_000 {
            held.set(*y);
        } else if (20_000..30_000).contains(&k) {
            *y = held.get();
        }
    });
    let frozen = said[20_000..30_000].iter().filter(|e| e.fault == Some(Fault::Frozen)).count();
    assert!(frozen > 5_000, "{frozen}");
    assert!(said[31_000..].iter().all(|e| e.fault.is_none()), "over when the reading changes");
}

#[test]
fn saturation_tells_no_tissue_force() {
    let (_, said) = with_fault(|k, _, y, _| {
        if (20_000..20_100).contains(&k) {
            *y = 15.0;
        }
    });
    assert!(
        said[20_000..20_100]
            .iter()
            .all(|e| e.fault == Some(Fault::Saturated) && e.tissue_force.is_nan())
    );
    assert!(clean_error(&said) < FOUND);
}

/// A new zero of the encoder is not a motion of 50 mm, and a single outlier is not a motion there
/// and back.
#[test]
fn an_encoder_jump_moves_nothing() {
    let (_, said) = with_fault(|k, x, _, _| {
        if k >= 20_000 {
            *x += 0.05;
        }
        if k == 25_000 {
            *x = -3.0;
        }
    });
    let jumps: Vec<usize> =
        (0..said.len()).filter(|k| said[*k].fault == Some(Fault::Jump)).collect();
    assert_eq!(jumps, [20_000, 25_000, 25_001]);
    assert!(clean_error(&said) < FOUND, "{}", clean_error(&said));
}

/// Positions missing during the fastest motion: the displacement is added later over its whole
/// time, as one motion.
#[test]
fn a_dropout_at_full_speed_is_bridged() {
    let record = run(&surgeon(40.0, |_| {}), Protocol::Surgeon, &seal(), 61).unwrap();
    let speed = |k: &usize| (record.position[k + 25] - record.position[k - 25]).abs();
    let fastest = (20_000..30_000).max_by(|a, b| speed(a).total_cmp(&speed(b))).unwrap() - 25;
    assert!(speed(&(fastest + 25)) > 3e-3, "fast enough to look like a jump");
    let (_, said) = with_fault(|k, x, _, _| {
        if (fastest..fastest + 50).contains(&k) {
            *x = f64::NAN;
        }
    });
    assert_eq!(said[fastest + 50].fault, None);
    assert!(clean_error(&said) < FOUND, "{}", clean_error(&said));
}

/// Frozen from the first sample on, and frozen with a sensor that is read only at every tenth
/// sample.
#[test]
fn a_frozen_sensor_is_noticed_whatever_its_rate() {
    for (hold, from) in [(1, 0), (10, 20_000)] {
        let held = std::cell::Cell::new(0.0);
        let (_, said) = with_fault(|k, _, y, _| {
            if k % hold == 0 && (k < from || k == 0) {
                held.set(*y);
            }
            *y = held.get();
        });
        let frozen =
            said[from + 10_000..].iter().filter(|e| e.fault == Some(Fault::Frozen)).count();
        assert!(frozen > 9_000, "every {hold}th sample: {frozen}");
        let early = said[..from].iter().filter(|e| e.fault == Some(Fault::Frozen)).count();
        assert_eq!(early, 0, "every {hold}th sample");
    }
}

/// A saturated reading is reported even if time does not advance, and no displacement of samples in
/// bursts is lost.
#[test]
fn one_fault_does_not_hide_another() {
    let (_, said) = with_fault(|k, _, y, duration| {
        if (20_000..20_010).contains(&k) {
            (*y, *duration) = (15.0, 0.0);
        }
    });
    assert!(
        said[20_000..20_010]
            .iter()
            .all(|e| e.fault == Some(Fault::Saturated) && e.tissue_force.is_nan())
    );
    let (_, said) = with_fault(|k, _, _, duration| match k % 8 {
        0 if k > 0 => *duration = 1e-6,
        1 => *duration = 2e-3 - 1e-6,
        _ => {}
    });
    assert!(said.iter().all(|e| e.fault.is_none()));
    assert!(clean_error(&said) < FOUND, "{}", clean_error(&said));
}

/// A jump of 2.5 mm within a millisecond is not a hand's motion, and the band widens after it.
#[test]
fn a_small_jump_opens_the_band() {
    let (_, said) = with_fault(|k, x, _, _| {
        if k >= 20_000 {
            *x += 2.5e-3;
        }
    });
    assert_eq!(said[20_000].fault, Some(Fault::Jump));
    assert!(said[20_001].std > 0.5 && said.last().unwrap().std < FOUND);
}

/// After the adaptation to a change the band is as narrow as before it.
#[test]
fn the_band_is_narrow_again_after_wetting() {
    let config = surgeon(110.0, |config| {
        (config.lubrication.level, config.lubrication.onset_s, config.lubrication.spread_s) =
            (0.85, 20.0, 3.0);
    });
    let record = run(&config, Protocol::Surgeon, &seal(), 41).unwrap();
    let said = observe(&mut observer(true), &record);
    let (early, late) = (
        rms(said[15_000..20_000].iter().map(|e| e.std)),
        rms(said[90_000..].iter().map(|e| e.std)),
    );
    assert!(late < 0.15 && late < 2.0 * early.max(0.05), "{early} N before, {late} N after");
}

/// Jitter of the times by half an interval has no effect, since the model uses displacements.
#[test]
fn clock_jitter_costs_nothing() {
    let (_, said) = with_fault(|k, _, _, duration| {
        if k > 0 {
            *duration = 1e-3 * (1.0 + 0.5 * f64::from((k as u32 * 7919) % 11) / 10.0 - 0.25);
        }
    });
    assert!(clean_error(&said) < FOUND, "{}", clean_error(&said));
}

/// A random seal with its exact model, in a random motion with random tissue, loads of several N and
/// breathing. In full strokes there is no tissue, which would saturate the sensor.
fn random_drive(seed: u64) -> (ModelFile, BenchRun) {
    let params = random_plausible_seal(500 + seed);
    let seal = [Element::new(params).unwrap()];
    let mut file = ModelFile::new(seal[0], Origin::new(OriginKind::HandMade));
    file.force_error = Some(ForceError::everywhere(0.05));
    let part = |k: u64| ((seed * (2 * k + 3)) as f64 * 0.618_034).fract();
    let config = surgeon(60.0, |config| {
        config.tissue.kind =
            if seed.is_multiple_of(2) { TissueKind::HuntCrossley } else { TissueKind::KelvinVoigt };
        config.tissue.surface_m = if seed.is_multiple_of(3) { 1.0 } else { 0.04 + 0.08 * part(1) };
        config.tissue.force_at_10_mm_n = 0.5 + 3.0 * part(2);
        config.tissue.load_n = 10.0 * part(3) - 5.0;
        config.tissue.load_from_s = 5.0 + 10.0 * part(4);
        config.tissue.load_until_s = 20.0 + 30.0 * part(5);
        (config.lubrication.level, config.lubrication.onset_s) = (0.4 + 0.8 * part(6), 20.0);
        config.rod.mass_kg = 0.0;
    });
    let protocol = if seed.is_multiple_of(3) { Protocol::Steady } else { Protocol::Surgeon };
    let mut record = run(&config, protocol, &seal, 900 + seed).unwrap();
    for (reading, time) in record.force.iter_mut().zip(&record.time) {
        *reading += 1.5 * libm::sin(core::f64::consts::TAU * 0.25 * time);
    }
    (file, record)
}

/// Samples at which the motion has reversed, after a stroke of more than `least`, m.
fn reversals(position: &[f64], least: f64) -> Vec<usize> {
    let (mut found, mut extreme, mut inserts) = (Vec::new(), position[0], None);
    for (k, &x) in position.iter().enumerate() {
        let way = x - extreme;
        if inserts.is_some_and(|inserts| (way > 0.0) == inserts) {
            extreme = x;
        } else if way.abs() > least {
            (extreme, inserts) = (x, Some(way > 0.0));
            found.push(k);
        }
    }
    found
}

/// Full strokes after which every reading of the opposite sign is a fault.
const STROKES: usize = 6;

/// Readings of the opposite sign are a fault within the first strokes, whatever touches the tip, and
/// readings of the right sign never are; the same where the position counts the other way round.
#[test]
fn the_sign_of_the_readings_is_watched() {
    for seed in 0..40 {
        let (file, record) = random_drive(seed);
        let strokes = reversals(&record.position, 4.0 * file.trocar.seal().half_width() + 5e-3);
        for (adaptation, flips) in [(false, false), (true, true)] {
            let options = CompensateOptions {
                adaptation,
                flip_force: Some(flips),
                ..CompensateOptions::default()
            };
            // With these signs of position and reading.
            let opposite = |x: f64, y: f64| {
                let mut observer = Compensator::new(&file, &options).unwrap();
                let y = if flips { -y } else { y };
                (0..record.time.len()).position(|k| {
                    let duration = record.time[k] - record.time[k.saturating_sub(1)];
                    let said = observer.step(x * record.position[k], y * record.force[k], duration);
                    let found = said.fault == Some(Fault::OppositeSign);
                    assert!(!found || said.tissue_force.is_nan());
                    found
                })
            };
            assert_eq!(opposite(1.0, 1.0), None, "seed {seed}, adaptation {adaptation}");
            for (x, y) in [(1.0, -1.0), (-1.0, 1.0)] {
                let from = opposite(x, y).unwrap_or_else(|| panic!("seed {seed}: not noticed"));
                let strokes = strokes.iter().filter(|end| **end < from).count();
                assert!(strokes <= STROKES, "seed {seed}, {x} {y}: after {strokes} strokes");
            }
        }
    }
}

/// The fault ends when the readings have the sign of the model again, and nothing was learnt from
/// those of the other sign.
#[test]
fn a_sign_that_was_mended_is_no_fault() {
    let mut record = run(&surgeon(100.0, |_| {}), Protocol::Surgeon, &seal(), 61).unwrap();
    record.force[10_000..50_000].iter_mut().for_each(|reading| *reading = -*reading);
    let said = observe(&mut observer(true), &record);
    let faults: Vec<usize> =
        (0..said.len()).filter(|k| said[*k].fault == Some(Fault::OppositeSign)).collect();
    let (first, last) = (faults[0], *faults.last().unwrap());
    let count = faults.len();
    assert!(first > 10_000 && first < 50_000, "{first}");
    assert!(last > 50_000 && last < record.time.len() - 5_000, "{last}");
    assert_eq!(count, last - first + 1, "without a break");
    let late = rms(said[last + 1..].iter().map(|e| e.tissue_force));
    assert!(late < FOUND, "{late} N");
}

/// The sign comes from how the recordings of the model were read, and each form of reversing it
/// counts; where they contradict each other, it must be stated.
#[test]
fn the_sign_of_the_recordings_is_that_of_the_readings() {
    let choice = |columns: Option<&str>, flip_force: bool| Choice {
        columns: columns.map(str::to_owned),
        flip_force,
        ..Choice::default()
    };
    let recording = |columns: Option<&str>, flip_force: bool| RecordingInfo {
        name: "log.csv".into(),
        sha256: "0".repeat(64),
        read_with: Some(ReadWith {
            columns: columns.map(str::to_owned),
            flip_force,
            force_reversed: choice(columns, flip_force).reverses_force(),
            ..ReadWith::default()
        }),
    };
    let with = |recordings: Vec<RecordingInfo>| {
        let mut file = MODEL.clone();
        file.origin.recordings = recordings;
        file
    };
    let record = run(&surgeon(20.0, |_| {}), Protocol::Surgeon, &seal(), 5).unwrap();
    let tissue = |file: &ModelFile, flip_force: Option<bool>, sign: f64| {
        let options = CompensateOptions { flip_force, ..CompensateOptions::default() };
        let mut observer = Compensator::new(file, &options).unwrap();
        let mut own = record.clone();
        own.force.iter_mut().for_each(|reading| *reading *= sign);
        bits(&observe(&mut observer, &own))
    };
    let expected = tissue(&MODEL, None, 1.0);
    for (columns, flip_force, flips) in [
        (None, false, false),
        (None, true, true),
        (Some("time_s=t,position_mm=x,force_n=-fz"), false, true),
        (Some("time_s=t,position_mm=-x,force_n=fz"), false, false),
        (Some("force_n=-fz"), true, false),
        (Some("time_s,-,position_mm,-force_n"), false, true),
        (Some("time_s,-position_mm,force_n"), false, false),
        (Some("load_n= -\"load, raw\",position_m=x"), false, true),
    ] {
        let file = with(vec![recording(columns, flip_force); 2]);
        assert_eq!(file.flips_force(), Some(flips), "{columns:?}, {flip_force}");
        let sign = if flips { -1.0 } else { 1.0 };
        assert!(tissue(&file, None, sign) == expected, "{columns:?}, {flip_force}");
        assert!(tissue(&file, Some(false), 1.0) == expected, "readings in the sign of the model");
    }
    let both = with(vec![recording(None, true), recording(None, false)]);
    let refused = Compensator::new(&both, &CompensateOptions::default()).unwrap_err();
    assert!(matches!(refused, CompensateError::SignUnknown), "{refused}");
    assert!(tissue(&both, Some(true), -1.0) == expected);
}

#[test]
fn time_that_stands_still_moves_nothing() {
    let (_, said) = with_fault(|k, _, _, duration| {
        if k == 20_000 {
            *duration = 0.0;
        }
        if k == 20_001 {
            *duration = -1.0;
        }
    });
    assert!(said[20_000..20_002].iter().all(|e| e.fault == Some(Fault::NoDuration)));
    assert!(clean_error(&said) < FOUND);
}

/// After a gap the state of the seal is unknown, and the band stays wide until it has slid.
#[test]
fn a_gap_opens_the_band() {
    let record = run(&surgeon(40.0, |_| {}), Protocol::Surgeon, &seal(), 62).unwrap();
    let mut observer = observer(false);
    let mut said = Vec::new();
    for k in (0..record.time.len()).filter(|k| !(20_000..22_000).contains(k)) {
        let duration = match k {
            0 => 0.0,
            22_000 => 2.001,
            _ => 1e-3,
        };
        said.push(observer.step(record.position[k], record.force[k], duration));
    }
    assert_eq!(said[20_000].fault, Some(Fault::Gap));
    assert!(said[20_001].std > 0.5 && said.last().unwrap().std < FOUND);
}

#[test]
fn what_cannot_compensate_is_refused() {
    let mut plausible = ModelFile::plausible_10_5_mm().unwrap();
    let error = |file: &ModelFile, options: CompensateOptions| {
        Compensator::new(file, &options).unwrap_err().to_string()
    };
    let none = Compensator::new(&plausible, &CompensateOptions::default()).unwrap_err();
    assert!(
        matches!(none, CompensateError::NoForceError)
            && none.to_string().contains("‹force_error_n›")
    );
    plausible.force_error = Some(ForceError::everywhere(0.1));
    for (options, expected) in [
        (
            CompensateOptions { offset_n: Some(f64::NAN), ..CompensateOptions::default() },
            "offset_n must be a finite number, got NaN",
        ),
        (
            CompensateOptions { moving_mass_kg: Some(-1.0), ..CompensateOptions::default() },
            "moving_mass_kg must be 0 or more, got -1",
        ),
        (
            CompensateOptions { sensor_limit_n: Some(0.0), ..CompensateOptions::default() },
            "sensor_limit_n must be above 0, got 0",
        ),
        (
            CompensateOptions { force_error_n: Some(-0.1), ..CompensateOptions::default() },
            "force_error_n must be above 0, got -0.1",
        ),
    ] {
        assert_eq!(error(&plausible, options), expected);
    }
}

/// After a reset the same samples give exactly the same estimates, whatever preceded it.
#[test]
fn a_reset_observer_is_as_new() {
    let record = run(&surgeon(30.0, |_| {}), Protocol::Surgeon, &seal(), 5).unwrap();
    let bits = |said: Vec<Estimate>| -> Vec<_> {
        let numbers = |e: &Estimate| [e.trocar_force, e.tissue_force, e.std].map(f64::to_bits);
        said.iter().map(|e| (numbers(e), e.adapting, e.fault)).collect()
    };
    let mut used = observer(true);
    let expected = bits(observe(&mut used, &record));
    let learnt = used.drift();
    used.step(f64::NAN, 3.0, 1e-3);
    used.step(0.3, f64::NAN, 1.0);
    used.reset();
    let fresh = observer(true);
    assert_eq!(used.drift(), fresh.drift());
    assert!(used.last().tissue_force.is_nan() && learnt != fresh.drift());
    assert!(bits(observe(&mut used, &record)) == expected);
    assert_eq!(used.drift(), learnt);
}

/// A classical model also compensates, within its accuracy.
#[test]
fn a_classical_model_runs() {
    let sliding = SlidingFriction::coulomb(3.0, 5.0);
    let mut file = ModelFile::new(
        Classical::Static(StaticFriction::new(sliding).unwrap()),
        Origin::new(OriginKind::HandMade),
    );
    file.force_error = Some(ForceError::everywhere(0.05));
    let mut observer = Compensator::new(&file, &CompensateOptions::default()).unwrap();
    let (mut position, mut force) = (0.0, 0.0);
    for k in 0..6000 {
        observer.step(position, force, 1e-3);
        let turn = if (k / 500) % 2 == 0 { 1.0 } else { -1.0 };
        position += 1e-4 * turn;
        force = turn * (2.0 * 3.0 + 5.0 * 0.1) + 1e-3 * f64::from(k % 2);
    }
    assert!((observer.drift().level - 2.0).abs() < 0.1, "{:?}", observer.drift());
}

/// On recordings of a seal that is not an EMS element, without tissue: the residual is within the
/// band, and the friction estimates stay unchanged.
#[test]
fn an_alien_seal_without_tissue() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/recordings/seal_a");
    if !folder.exists() {
        assert!(std::env::var_os("TROCAR_REQUIRE_SHARED").is_none(), "the recordings are missing");
        skipped("no recordings beside the checkout");
        return;
    }
    let record =
        |name: &str| -> Recording { read(&folder.join(name), &ReadOptions::default()).unwrap() };
    let lighter = |r: Recording| r.without_moving_mass(0.04, 0.0).unwrap();
    let training = [lighter(record("steady.csv")), lighter(record("dynamic.csv"))];
    let options = IdentifyOptions::default();
    let found = identify(&training, &options, &|_, _| {}).unwrap();
    let surgeon = record("surgeon.csv");
    let half = surgeon.len() / 2;
    let held_out = lighter(surgeon.part(0..half, "first half").unwrap());
    let validation = validate(&Trocar::of_seal(found.stages), &[held_out], found.model.offset);
    let mut file = ModelFile::new(found.stages, Origin::new(OriginKind::Identified));
    file.sensor = Some(SensorInfo {
        offset_n: found.model.offset,
        moving_mass_kg: 0.04,
        ..SensorInfo::default()
    });
    file.force_error = Some(validation.force_error(ErrorSource::Validation));
    for adaptation in [false, true] {
        let options = CompensateOptions { adaptation, ..CompensateOptions::default() };
        let mut observer = Compensator::new(&file, &options).unwrap();
        let (mut errors, mut covered) = (Vec::new(), 0);
        for k in half..surgeon.len() {
            let duration = if k == half { 0.0 } else { surgeon.time[k] - surgeon.time[k - 1] };
            let said = observer.step(surgeon.position[k], surgeon.force[k], duration);
            if surgeon.time[k] > surgeon.time[half] + 8.0 {
                errors.push(said.tissue_force);
                covered += usize::from(said.tissue_force.abs() < BAND * said.std);
            }
        }
        let (error, coverage) = (rms(errors.iter().copied()), covered as f64 / errors.len() as f64);
        let drift = observer.drift();
        println!(
            "adaptation {adaptation}: {error:.3} N rms, 95 % band holds {:.1} %, {drift:?}",
            100.0 * coverage
        );
        // The two steps of the paper leave 0.2 N on this seal in hand-like motion, more in this
        // half than in the other. So the band from the other half cannot contain all errors.
        assert!(error < 0.25, "{error}");
        assert!(coverage > 0.75, "{coverage}");
        assert!((drift.level - 1.0).abs() < 0.1, "{drift:?}");
    }
}

/// Bits of an estimate, so that NaN equals itself.
fn bits(estimates: &[Estimate]) -> Vec<([u64; 3], bool, Option<Fault>)> {
    let of = |e: &Estimate| {
        let numbers = [e.trocar_force, e.tissue_force, e.std].map(f64::to_bits);
        (numbers, e.adapting, e.fault)
    };
    estimates.iter().map(of).collect()
}

/// A saved state goes on with the same estimates, wherever the samples were interrupted: before the
/// first one, at the start, during contact and faults.
#[test]
fn a_saved_state_goes_on_with_the_same_estimates() {
    let config = surgeon(20.0, |config| {
        config.tissue.kind = TissueKind::HuntCrossley;
        config.tissue.surface_m = 0.07;
    });
    let mut record = run(&config, Protocol::Surgeon, &seal(), 5).unwrap();
    record.force[12_000..12_100].fill(f64::NAN);
    let options = CompensateOptions { sensor_limit_n: Some(30.0), ..CompensateOptions::default() };
    let fresh = || Compensator::new(&MODEL, &options).unwrap();
    let (mut straight, mut resumed) = (fresh(), fresh());
    let pieces = [0, 1, 700, 6_000, 12_050, 17_500, record.time.len()];
    for pair in pieces.windows(2) {
        let mut again = fresh();
        again.set_state(&resumed.state()).unwrap();
        assert_eq!(again.state().len(), resumed.state().len());
        assert_eq!(
            (again.drift(), again.is_in_contact()),
            (resumed.drift(), resumed.is_in_contact())
        );
        resumed = again;
        let go_on = |observer: &mut Compensator| -> Vec<Estimate> {
            (pair[0]..pair[1])
                .map(|k| {
                    let before = record.time[k.saturating_sub(1)];
                    observer.step(record.position[k], record.force[k], record.time[k] - before)
                })
                .collect()
        };
        let (expected, found) = (go_on(&mut straight), go_on(&mut resumed));
        assert!(bits(&expected) == bits(&found), "from sample {}", pair[0]);
    }
    assert!(straight.drift() != fresh().drift(), "the record adapts the observer");
}

/// Numbers that are no state are refused, leave the observer as it was, and never end in a panic.
#[test]
fn what_is_no_state_is_refused() {
    let config = surgeon(5.0, |_| {});
    let record = run(&config, Protocol::Surgeon, &seal(), 5).unwrap();
    let mut observer = observer(true);
    observe(&mut observer, &record);
    let state = observer.state();
    let refused = |observer: &mut Compensator, row: &[f64]| {
        let error = observer.set_state(row).unwrap_err();
        assert!(matches!(error, CompensateError::NotAState { found } if found == row.len()));
    };
    for length in [0, 1, 30, state.len() - 1] {
        refused(&mut observer, &state[..length]);
    }
    refused(&mut observer, &[&state[..], &[0.0]].concat());
    refused(&mut observer, &vec![f64::NAN; state.len()]);
    let coulomb = StaticFriction::new(SlidingFriction::coulomb(3.0, 5.0)).unwrap();
    let mut foreign = ModelFile::new(Classical::Static(coulomb), Origin::new(OriginKind::HandMade));
    foreign.force_error = MODEL.force_error;
    let foreign = Compensator::new(&foreign, &CompensateOptions::default()).unwrap();
    refused(&mut observer, &foreign.state());
    let numbers = |row: &[f64]| row.iter().map(|number| number.to_bits()).collect::<Vec<_>>();
    assert!(numbers(&observer.state()) == numbers(&state));
    // Any number may stand for a reading, so some damaged rows are accepted.
    for place in 0..state.len() {
        let mut row = state.clone();
        row[place] = [-1.0, 0.5, 1e300, f64::NAN][place % 4];
        let mut damaged = observer.clone();
        if damaged.set_state(&row).is_ok() {
            (0..20).for_each(|k| {
                damaged.step(record.position[k], record.force[k], 1e-3);
            });
        }
    }
}
