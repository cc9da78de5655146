//! The turning instrument in files: models, motions and recordings.

use std::path::{Path, PathBuf};

use crate::benches::benches;
use trocar::bench::config::Fluctuation;
use trocar::bench::{self, BenchConfig, Course, Protocol};
use trocar::identify::{IdentifyOptions, identify};
use trocar::model_file::ModelFile;
use trocar::recording::{Choice, ReadOptions, Readings, Recording, read};
use trocar::simulate::{SimulateOptions, simulate_file};
use trocar::validate::{Validation, validate_one};
use trocar_model::{Rotation, Trocar};

const ROTATION: Rotation =
    Rotation { shaft_radius: 5e-3, circumferential_stiffness: 425.0, circumferential_ratio: 1.0 };

fn conformance(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../conformance").join(name)
}

fn plausible() -> ModelFile {
    let mut model = ModelFile::plausible_10_5_mm().unwrap();
    model.trocar = model.trocar.with_rotation(Some(ROTATION)).unwrap();
    model
}

#[test]
fn a_model_file_keeps_its_rotation() {
    let text = plausible().to_json();
    assert_eq!(ModelFile::from_json(&text).unwrap(), plausible());
    assert!(!ModelFile::plausible_10_5_mm().unwrap().to_json().contains("rotation"));
    let bad = text.replace("\"circumferential_ratio\": 1.0", "\"circumferential_ratio\": 0.0");
    let error = ModelFile::from_json(&bad).unwrap_err().to_string();
    assert!(
        error.contains("rotation: circumferential_ratio must be finite and above 0, got 0"),
        "{error}"
    );
}

#[test]
fn a_classical_model_is_no_model_of_rotation() {
    let text = std::fs::read_to_string(conformance("models/dahl.json")).unwrap();
    let rotation = "\"rotation\": {\"shaft_radius_m\": 5e-3, \"circumferential_stiffness_n_m\": 425, \"circumferential_ratio\": 1},";
    let text = text.replacen("\"friction\"", &format!("{rotation} \"friction\""), 1);
    let error = ModelFile::from_json(&text).unwrap_err().to_string();
    assert!(error.contains("the classical models know the axis only"), "{error}");
}

/// All models of the conformance check that can turn have their own bits as long as they do not.
#[test]
fn without_turning_every_model_has_its_bits() {
    let motion = read_motion();
    let mut turning = 0;
    for entry in std::fs::read_dir(conformance("models")).unwrap() {
        let plain = ModelFile::read(&entry.unwrap().path()).unwrap().trocar;
        let Ok(trocar) = plain.clone().with_rotation(Some(ROTATION)) else { continue };
        turning += 1;
        let (mut a, mut b) = (plain.rest(motion[0].1), trocar.rest(motion[0].1).with_angle(0.7));
        for pair in motion.windows(2) {
            let duration = pair[1].0 - pair[0].0;
            let force = plain.step_to(&mut a, pair[1].1, duration);
            let turned = trocar.turn_to(&mut b, pair[1].1, 0.7, duration);
            assert_eq!(force.to_bits(), turned.to_bits());
        }
        assert_eq!((a.seal(), b.torque()), (b.seal(), 0.0));
    }
    assert!(turning >= 6, "{turning} models");
}

fn read_motion() -> Vec<(f64, f64)> {
    let text = std::fs::read_to_string(conformance("motion.csv")).unwrap();
    let row = |line: &str| {
        let numbers: Vec<f64> = line.split(',').map(|word| word.parse().unwrap()).collect();
        (numbers[0], numbers[1])
    };
    text.lines().skip(1).map(row).collect()
}

/// A stroke at 20 mm/s during which the instrument turns once a second.
fn turning_stroke(unit: &str, per_turn: f64) -> String {
    let mut text = format!("time_s,position_m,angle_{unit}\n");
    for k in 0..=3000 {
        let t = 1e-3 * f64::from(k);
        text += &format!("{t},{},{}\n", 0.02 * t, per_turn * t);
    }
    text
}

fn simulated(trocar: &Trocar<Vec<f64>>, motion: &str) -> (String, bool) {
    let folder = tempfile::tempdir().unwrap();
    let (input, output) = (folder.path().join("motion.csv"), folder.path().join("out.csv"));
    std::fs::write(&input, motion).unwrap();
    let options = SimulateOptions::default();
    let choice = Choice::default();
    let done = simulate_file(&input, &choice, trocar, None, &options, &output, |_, _| ()).unwrap();
    (std::fs::read_to_string(output).unwrap(), done.turns_unheeded)
}

#[test]
fn a_simulation_takes_the_angle_and_gives_the_torque() {
    let model = plausible().trocar;
    let (text, unheeded) = simulated(&model, &turning_stroke("rad", std::f64::consts::TAU));
    assert!(text.starts_with("time_s,position_m,force_n,deflection_m,mode,torque_n_m\n"));
    let last: Vec<&str> = text.lines().last().unwrap().split(',').collect();
    let number = |k: usize| last[k].parse::<f64>().unwrap();
    // Steady sliding: F_c·ẋ/|v| + β·ẋ, and the torque of the rest.
    let around = 5e-3 * std::f64::consts::TAU;
    let speed = 0.02_f64.hypot(around);
    assert!((number(2) - (3.0 * 0.02 / speed + 5.0 * 0.02)).abs() < 2e-3, "{last:?}");
    assert!((number(5) - 5e-3 * (3.0 * around / speed + 5.0 * around)).abs() < 1e-5, "{last:?}");
    assert!(!unheeded);
    let (same, _) = simulated(&model, &turning_stroke("turns", 1.0));
    let last: Vec<&str> = same.lines().last().unwrap().split(',').collect();
    assert!((last[2].parse::<f64>().unwrap() - number(2)).abs() < 1e-9);
}

#[test]
fn a_model_of_the_axis_does_not_heed_the_angle() {
    let plain = ModelFile::plausible_10_5_mm().unwrap().trocar;
    let (text, unheeded) = simulated(&plain, &turning_stroke("deg", 360.0));
    assert!(unheeded && text.starts_with("time_s,position_m,force_n,deflection_m,mode\n"));
    let (_, unheeded) = simulated(&plain, &turning_stroke("deg", 0.0));
    assert!(!unheeded);
}

#[test]
fn a_recording_holds_its_angle() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.csv");
    for (name, per_rad) in [
        ("angle_rad", 1.0),
        ("roll [deg]", 180.0 / std::f64::consts::PI),
        ("angle (turns)", 0.5 / std::f64::consts::PI),
    ] {
        let mut text = format!("time_s,position_mm,force_n,{name}\n");
        for k in 0..20 {
            text += &format!(
                "{},{},{},{}\n",
                0.1 * f64::from(k),
                k,
                0.1 * f64::from(k),
                f64::from(k) * per_rad
            );
        }
        std::fs::write(&path, text).unwrap();
        let angle = read(&path, &ReadOptions::default()).unwrap().angle.expect("an angle");
        assert!((angle[19] - 19.0).abs() < 1e-9, "{name}: {}", angle[19]);
    }
    // Without a unit nothing is read.
    let mut text = "time_s,position_mm,force_n,angle\n".to_owned();
    for k in 0..20 {
        text += &format!("{},{},{},{k}\n", 0.1 * f64::from(k), k, 0.1 * f64::from(k));
    }
    std::fs::write(&path, text).unwrap();
    assert!(read(&path, &ReadOptions::default()).unwrap().angle.is_none());
}

/// Steady strokes of the bench, with an angle that turns at `rate`, rad/s.
fn strokes(rate: f64) -> Recording {
    let seal = ModelFile::plausible_10_5_mm().unwrap();
    let elements = seal.stages().unwrap().elements().to_vec();
    let run = bench::run(&BenchConfig::default(), Protocol::Steady, &elements, 1).unwrap();
    let plain = run.to_recording("steady").unwrap();
    let angle = plain.time.iter().map(|t| rate * t).collect();
    let readings = Readings {
        time: plain.time,
        position: plain.position,
        force: plain.force,
        angle: Some(angle),
        ..Readings::default()
    };
    Recording::from_readings("steady", &readings, None).unwrap()
}

#[test]
fn an_angle_is_compensated_with_the_positions() {
    let turned = strokes(2.0);
    let shifted = turned.with_position_delay(0.01).unwrap();
    let (angle, time) = (shifted.angle.expect("it still has one"), &shifted.time);
    assert_eq!(angle.len(), time.len());
    assert!(angle.iter().zip(time).all(|(angle, t)| (angle - 2.0 * (t + 0.01)).abs() < 1e-9));
}

#[test]
fn identification_names_a_recording_that_turned() {
    let warnings = |rate| {
        let recordings = [strokes(rate)];
        let options = IdentifyOptions { free_motion: false, along: false, ..Default::default() };
        let found = identify(&recordings, &options, &|_, _| {}).unwrap();
        found.warnings.iter().map(|warning| warning.message.clone()).collect::<Vec<_>>().join("\n")
    };
    let turned = warnings(std::f64::consts::TAU);
    assert!(turned.contains("turns by up to 360 deg/s while it slides"), "{turned}");
    assert!(turned.contains("leave out the part that turns"), "{turned}");
    assert!(!warnings(0.0).contains("turns"));
}

/// The plausible seal at its limit, held and turned.
fn left_at(circumferential_stiffness: f64, degrees: f64) -> f64 {
    let rotation = Rotation { circumferential_stiffness, ..ROTATION };
    let trocar = plausible().trocar.with_rotation(Some(rotation)).unwrap();
    let mut state = trocar.rest_at_deflection(0.0, 8e-3).unwrap();
    for k in 1..=1000 {
        trocar.turn_to(&mut state, 0.0, 1e-3 * f64::from(k) * degrees.to_radians(), 1e-3);
    }
    state.force()
}

#[test]
fn the_page_has_the_numbers_of_the_model() {
    let page = include_str!("../../../docs/explanation/rotation.md");
    let straight = 3.0 / (425.0 * 5e-3 * std::f64::consts::FRAC_PI_2 / 3.0).cosh();
    let numbers = [
        straight,
        left_at(425.0, 90.0),
        left_at(425.0, 180.0),
        left_at(212.5, 90.0),
        left_at(850.0, 90.0),
    ];
    for number in numbers {
        assert!(page.contains(&format!("{number:.2} N")), "{number} N");
    }
    let around = 5e-3 * std::f64::consts::TAU;
    assert!(
        page.contains(&format!("{:.0} % of $F_c$ is left", 1e2 * 0.02 / 0.02_f64.hypot(around)))
    );
}

/// A recording of the plausible seal along `path` (m, rad): 4 µm and 1 mrad of resolution, 20 mN of
/// slow and 20 mN of fast noise.
fn drawn(
    name: &str,
    seed: u64,
    truth: &Trocar<Vec<f64>>,
    seconds: f64,
    path: &dyn Fn(f64) -> [f64; 2],
) -> Recording {
    let mut random = trocar::bench::noise::Noise::new(seed, trocar::bench::noise::Source::Movement);
    let [x, angle] = path(0.0);
    let mut state = truth.rest(x).with_angle(angle);
    let (mut readings, mut slow) =
        (Readings { angle: Some(Vec::new()), ..Readings::default() }, 0.0);
    for k in 0..(1e3 * seconds) as usize {
        let t = 1e-3 * k as f64;
        let [x, angle] = path(t);
        let force = truth.turn_to(&mut state, x, angle, 1e-3);
        slow += -0.01 * slow + 0.02 * (2.0_f64 * 0.01).sqrt() * random.normal();
        readings.time.push(t);
        readings.position.push((x / 4e-6).round() * 4e-6);
        readings.angle.as_mut().unwrap().push((angle * 1e3).round() * 1e-3);
        readings.force.push(force + slow + 0.02 * random.normal());
    }
    Recording::from_readings(name, &readings, None).unwrap()
}

/// To and fro over 40 mm at `speed`, m/s.
fn to_and_fro(speed: f64, t: f64) -> f64 {
    let phase = (speed * t / 0.04) % 2.0;
    0.04 * if phase < 1.0 { phase } else { 2.0 - phase }
}

/// Strokes without turning; strokes at four ratios of the speeds, holds with a quarter turn to and
/// fro, and turning alone.
fn bench_of_rotation(truth: &Trocar<Vec<f64>>, seed: u64) -> Vec<Recording> {
    let still = |t: f64| {
        let speed = [0.015, 0.03, 0.06, 0.1][(t / 12.0) as usize % 4];
        [to_and_fro(speed, t % 12.0), 0.0]
    };
    let turned = |t: f64| {
        let (stage, own) = ((t / 8.0) as usize, t % 8.0);
        let quarter = std::f64::consts::FRAC_PI_2;
        let rate = [1.0, 4.0, 12.0, 25.0][stage.min(3)];
        let turned: f64 = [8.0, 32.0, 96.0, 200.0][..stage.min(4)].iter().sum();
        match stage {
            0..4 => [to_and_fro(0.02, own), turned + rate * own],
            4..7 => {
                let x = 0.02 * own.min(1.5);
                [x, turned + quarter * ((own - 2.0).max(0.0) * 0.8).sin()]
            }
            _ => [0.02 * own.min(0.5), turned + 1.5 * (2.0 * (own - 1.0).max(0.0)).sin()],
        }
    };
    vec![
        drawn("still", seed, truth, 48.0, &still),
        drawn("turned", seed + 1000, truth, 64.0, &turned),
    ]
}

/// Both numbers are within their intervals, and the Coulomb force, identified beside them, is as without rotation.
#[test]
fn rotation_is_recovered() {
    let count = benches(6, 6);
    let seal = ModelFile::plausible_10_5_mm().unwrap().trocar;
    let mut covered = [0; 3];
    for seed in 0..count {
        // Evenly over a factor of four in k_t and of two in the ratio.
        let part = |step: f64| (step * (seed as f64 + 0.5)).fract();
        let stiffness = 220.0 * 4.0_f64.powf(part(0.618_034));
        let ratio = 0.7 * 2.0_f64.powf(part(0.754_878));
        let rotation = Rotation {
            circumferential_stiffness: stiffness,
            circumferential_ratio: ratio,
            ..ROTATION
        };
        let truth = seal.clone().with_rotation(Some(rotation)).unwrap();
        let found = identify(&bench_of_rotation(&truth, seed), &of_rotation(), &|_, _| {}).unwrap();
        let truth = [
            ("circumferential_stiffness_n_m", stiffness, 0.25),
            ("circumferential_ratio", ratio, 0.15),
            ("coulomb_force_n", 3.0, 0.05),
        ];
        for ((name, value, tolerance), covered) in truth.into_iter().zip(&mut covered) {
            let estimate = found.parameter(name).unwrap();
            *covered += u64::from(estimate.covers(value));
            let off = estimate.value / value - 1.0;
            println!("{seed} {name} {value:.4} {:+.2} % {:?}", 1e2 * off, estimate.ci95);
            assert!(off.abs() < tolerance, "{seed}: {name} {} for {value}", estimate.value);
        }
        assert_eq!(found.trocar().rotation().unwrap().shaft_radius, 5e-3);
    }
    println!("covered of {count}: {covered:?}");
    let least = (0.8 * count as f64).floor() as u64 - 1;
    assert!(covered.iter().all(|covered| *covered >= least), "{covered:?} of {count}");
}

fn of_rotation() -> IdentifyOptions {
    IdentifyOptions {
        shaft_radius: Some(ROTATION.shaft_radius),
        free_motion: false,
        along: false,
        ..Default::default()
    }
}

#[test]
fn nothing_is_determined_without_rolling() {
    let truth = plausible().trocar;
    let options = of_rotation();
    let all = bench_of_rotation(&truth, 1);
    let identified = |own: &[Recording]| {
        let found = identify(own, &options, &|_, _| {}).unwrap();
        let words = found
            .warnings
            .iter()
            .map(|warning| warning.message.clone())
            .collect::<Vec<_>>()
            .join("\n");
        (found.rotation, words)
    };
    let (rotation, words) = identified(&all[..1]);
    assert!(rotation.is_none() && words.contains("nothing is known of rotation"), "{words}");
    // Nor does an angle that creeps by 0.7 mm around the shaft.
    let mut creeps = all[0].clone();
    let last = creeps.len() as f64 - 1.0;
    creeps.angle = Some((0..creeps.len()).map(|k| 0.14 * k as f64 / last).collect());
    let (rotation, words) = identified(&[creeps]);
    assert!(rotation.is_none() && words.contains("nothing is known of rotation"), "{words}");
    let (rotation, words) = identified(&all[1..]);
    assert!(rotation.is_none() && words.contains("add strokes without turning"), "{words}");
}

/// The rig with a rod that turns: the force of the seal is that of the model along the true motion.
#[test]
fn the_bench_turns_the_rod() {
    let seal = ModelFile::plausible_10_5_mm().unwrap();
    let elements = seal.stages().unwrap().elements().to_vec();
    let time: Vec<f64> = (0..4000).map(|k| 1e-3 * f64::from(k)).collect();
    let position = time.iter().map(|t| 0.02 + to_and_fro(0.02, *t)).collect();
    let angle = time.iter().map(|t| std::f64::consts::TAU * t).collect();
    let mut motion = Course { time, position, angle: Some(angle) };
    let mut config = BenchConfig { rotation: Some(ROTATION), ..BenchConfig::default() };
    config.fluctuation = Fluctuation {
        stroke_fraction: 0.0,
        ripple_fraction: 0.0,
        drift_fraction: 0.0,
        ..config.fluctuation
    };
    let run = bench::run_motion(&config, &motion, &elements, 1).unwrap();
    let middle = 1900; // near the end of the first stroke, at 20 mm/s
    let around = 5e-3 * std::f64::consts::TAU;
    let expected = 3.0 * 0.02 / 0.02_f64.hypot(around) + 5.0 * 0.02;
    assert!(
        (run.truth.seal_force[middle] / expected - 1.0).abs() < 0.05,
        "{} N",
        run.truth.seal_force[middle]
    );
    assert!((run.angle[middle] - std::f64::consts::TAU * 1.9).abs() < 0.02);
    assert!(run.truth.torque[middle] > 0.012);
    assert!(run.to_recording("turned").unwrap().angle.is_some());
    motion.angle = None;
    let axial = bench::run_motion(&config, &motion, &elements, 1).unwrap();
    let plain = bench::run_motion(&BenchConfig { rotation: None, ..config }, &motion, &elements, 1)
        .unwrap();
    assert!(axial.angle.is_empty() && axial.to_recording("still").unwrap().angle.is_none());
    let difference =
        axial.force.iter().zip(&plain.force).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(difference < 1e-2, "{difference} N");
}

/// What the protocols promise: strokes at four ratios of the speeds and turning alone; holds with a
/// quarter turn. A seal without rotation in its model resists it alike in both directions.
#[test]
fn protocols_turn_the_rod() {
    let seal = ModelFile::plausible_10_5_mm().unwrap();
    let elements = seal.stages().unwrap().elements().to_vec();
    let config = BenchConfig::default();
    let run = |protocol| bench::run(&config, protocol, &elements, 1).unwrap();
    let alike = bench::turning(&config, &elements).rotation.unwrap();
    assert_eq!((alike.shaft_radius, alike.circumferential_ratio), (5e-3, 1.0));
    assert!((alike.circumferential_stiffness - 3.0 / 8e-3).abs() < 1e-9);

    let turned = run(Protocol::HoldAndTurn);
    let range = |own: &[f64]| trocar::recording::range(own);
    let (low, high) = range(&turned.truth.angle);
    let angle = config.protocol.hold_and_turn.turn_rad;
    assert!((low + angle).abs() < 1e-9 && (high - angle).abs() < 1e-9, "{low} to {high} rad");
    let turns = |k: &usize| turned.truth.angle[*k] != turned.truth.angle[*k - 1];
    let moves = |k: &usize| turned.truth.reference_velocity[*k].abs() > 1e-9;
    let all = 1..turned.time.len();
    assert!(all.clone().filter(turns).filter(moves).count() <= 12, "it turns while it holds");
    // At the end of the first stroke nearly F_c; the quarter turn leaves a part, as the model does.
    let first = all.clone().find(turns).unwrap();
    let end = (first..).find(|k| turned.truth.angle[*k] == turned.truth.angle[*k + 1]).unwrap();
    let [before, after] = [first - 1, end].map(|k| turned.truth.seal_force[k]);
    assert!(before > 2.7 && after < 0.6 * before, "{before} N, then {after} N");
    assert!(turned.torque[end] > 5e-3 * 2.0, "{} N m", turned.torque[end]);

    let roll = run(Protocol::Roll);
    let rates: Vec<f64> = (0..4).map(|k| 25.0_f64.powf(f64::from(k) / 3.0)).collect();
    let rate_at = |time: f64| {
        let k = (time * config.rig.sample_rate_hz) as usize;
        (roll.truth.angle[k + 1] - roll.truth.angle[k]) * config.rig.sample_rate_hz
    };
    for (k, rate) in rates.iter().enumerate() {
        let found = rate_at(1.0 + 4.04 * k as f64);
        assert!((found / rate - 1.0).abs() < 1e-6, "{found} rad/s for {rate}");
    }
    // Its torque and its angle pass through sensors, and the reversals leave the position.
    let error = |k: usize| roll.torque[k] - roll.truth.torque[k];
    let squares = (0..roll.time.len()).map(|k| error(k).powi(2)).sum::<f64>();
    let noise = (squares / roll.time.len() as f64).sqrt();
    assert!((noise / config.torque_sensor.noise_n_m - 1.0).abs() < 0.05, "{noise} N m");
    assert!(roll.angle.iter().all(|own| (own / 1e-3 - (own / 1e-3).round()).abs() < 1e-9));
    let last = roll.time.len() - 15_000;
    let (low, high) = range(&roll.truth.position[last..]);
    assert!(high - low < 1e-4, "{} m while it turns alone", high - low);
    let again = run(Protocol::Roll);
    assert_eq!((again.force, again.torque), (roll.force, roll.torque));
}

/// Torque and force of one seal: the same numbers as by force alone, with intervals half as wide or
/// less.
#[test]
fn a_torque_makes_rotation_certain() {
    let seal = ModelFile::plausible_10_5_mm().unwrap();
    let elements = seal.stages().unwrap().elements().to_vec();
    let config = BenchConfig { rotation: Some(ROTATION), ..BenchConfig::default() };
    let record = |protocol: Protocol| {
        let run = bench::run(&config, protocol, &elements, 3).unwrap();
        run.to_recording(protocol.name()).unwrap().without_moving_mass(0.04, 0.0).unwrap()
    };
    let mut recordings: Vec<Recording> =
        [Protocol::Validation, Protocol::Roll, Protocol::HoldAndTurn].map(record).to_vec();
    let options = of_rotation();
    let with = identify(&recordings, &options, &|_, _| {}).unwrap();
    let axial = identify(&recordings[..1], &options, &|_, _| {}).unwrap();
    recordings.iter_mut().for_each(|own| own.torque = None);
    let without = identify(&recordings, &options, &|_, _| {}).unwrap();
    for (name, truth) in [("circumferential_stiffness_n_m", 425.0), ("circumferential_ratio", 1.0)]
    {
        let [with, without] = [&with, &without].map(|own| own.parameter(name).unwrap());
        println!("{name} {with:?} {without:?}");
        assert!(with.covers(truth) && without.covers(truth), "{name} {with:?} {without:?}");
        assert!(with.half_width() < 0.5 * without.half_width(), "{name} {with:?} {without:?}");
    }
    // Turning neither biases nor narrows what is known along the axis.
    for parameter in &axial.parameters {
        assert_eq!(with.estimate(parameter.id), Some(&parameter.estimate));
    }
}

#[test]
fn validation_has_the_error_of_the_torque() {
    let model = plausible();
    let elements = model.stages().unwrap().elements().to_vec();
    let config = BenchConfig { rotation: Some(ROTATION), ..BenchConfig::default() };
    let run = bench::run(&config, Protocol::Roll, &elements, 1).unwrap();
    let mut recording = run.to_recording("roll").unwrap();
    let rms = |trocar: &Trocar<Vec<f64>>, recording: &Recording| {
        Validation::of(vec![validate_one(trocar, recording, 0.0)]).recordings[0].torque_rms_n_m
    };
    let own = rms(&model.trocar, &recording).unwrap();
    // Noise of 0.2 mN m, and 1 % from stroke to stroke of 15 mN m.
    assert!((2e-4..6e-4).contains(&own), "{own} N m");
    let stiff = Rotation { circumferential_stiffness: 900.0, ..ROTATION };
    let other = model.trocar.clone().with_rotation(Some(stiff)).unwrap();
    assert!(rms(&other, &recording).unwrap() > 3.0 * own);
    assert_eq!(rms(&model.trocar.clone().with_rotation(None).unwrap(), &recording), None);
    // A tare is no error.
    recording.torque.iter_mut().flatten().for_each(|torque| *torque += 0.3);
    assert!((rms(&model.trocar, &recording).unwrap() / own - 1.0).abs() < 1e-6);
    recording.torque = None;
    assert_eq!(rms(&model.trocar, &recording), None);
}
