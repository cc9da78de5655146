//! The observer of an instrument that turns.

use std::fs;

use trocar::compensate::{
    CompensateOptions, Compensator, Estimate, Fault, StreamOptions, compensate_file,
};
use trocar::model_file::{ForceError, ModelFile};
use trocar::recording::Choice;
use trocar_model::Rotation;

const ROTATION: Rotation =
    Rotation { shaft_radius: 5e-3, circumferential_stiffness: 425.0, circumferential_ratio: 0.9 };

/// The plausible seal with and without rotation.
fn models() -> [ModelFile; 2] {
    [Some(ROTATION), None].map(|rotation| {
        let mut file = ModelFile::plausible_10_5_mm().unwrap();
        file.trocar = file.trocar.with_rotation(rotation).unwrap();
        file.force_error = Some(ForceError::everywhere(0.05));
        file
    })
}

fn observer(file: &ModelFile, adaptation: bool) -> Compensator {
    Compensator::new(file, &CompensateOptions { adaptation, ..CompensateOptions::default() })
        .unwrap()
}

/// Samples of the motion while the instrument turns.
const TURNING: usize = 30_000;

/// Time, position and angle at 1 kHz: strokes of 60 mm, for 30 s while the instrument turns to and fro by 70 degrees with rests
/// of the angle, then for 20 s without turning.
fn motion() -> impl Iterator<Item = [f64; 3]> {
    (0..TURNING + 20_000).map(|k| {
        let time = 1e-3 * k as f64;
        let turning = 1e-3 * k.min(TURNING) as f64;
        let angle = 2.1 * (0.9 * turning).sin().clamp(-0.6, 0.6);
        [time, 0.05 + 0.03 * (1.3 * time).sin(), angle]
    })
}

/// One sample: the estimate, the true force and torque of the trocar, and the force on the tissue.
struct Observed {
    estimate: Estimate,
    truth: [f64; 2],
    tissue: f64,
}

/// The seal has `scale` of its friction; a tissue of `stiffness` pushes back beyond 70 mm. An observer that is `blind` is not
/// given the angle.
fn observe(observer: &mut Compensator, scale: f64, stiffness: f64, blind: bool) -> Vec<Observed> {
    let trocar = models()[0].trocar.clone();
    let mut state = trocar.rest(0.05 / scale);
    let sample = |[_, position, angle]: [f64; 3]| {
        let force = scale * trocar.turn_to(&mut state, position / scale, angle / scale, 1e-3);
        let tissue = stiffness * (position - 0.07).max(0.0);
        let reading = force + tissue + 1e-4 * (1e5 * position).sin();
        let estimate = match blind {
            true => observer.step(position, reading, 1e-3),
            false => observer.turn(position, angle, reading, 1e-3),
        };
        Observed { estimate, truth: [force, scale * state.torque()], tissue }
    };
    motion().map(sample).collect()
}

/// Of the tissue force while the instrument turns, after the first 5 s, N.
fn rms(found: &[Observed]) -> f64 {
    let found = &found[5000..TURNING];
    let square = |own: &Observed| (own.estimate.tissue_force - own.tissue).powi(2);
    (found.iter().map(square).sum::<f64>() / found.len() as f64).sqrt()
}

#[test]
fn the_angle_takes_part_of_the_force_away() {
    let [file, _] = models();
    let found = observe(&mut observer(&file, false), 1.0, 200.0, false);
    assert!(rms(&found) < 2e-3, "{} N", rms(&found));
    let off = |own: &Observed| (own.estimate.trocar_torque - own.truth[1]).abs();
    let (off, most) = (found[5000..].iter().map(off).fold(0.0, f64::max), 8e-3);
    assert!(off < 1e-5 && found.iter().any(|own| own.truth[1] > most), "{off} N m");
    // What the observer would take for tissue without the angle.
    let blind = observe(&mut observer(&file, false), 1.0, 200.0, true);
    assert!(rms(&blind) > 0.1, "{} N", rms(&blind));
    assert!(blind.iter().all(|own| own.estimate.trocar_torque == 0.0));
}

/// What turning takes away is not taken for a wet seal. A seal that is wet is followed as soon as the instrument rests around
/// its axis; until then the band contains the error.
#[test]
fn friction_is_followed_where_the_instrument_does_not_turn() {
    let [file, _] = models();
    for scale in [1.0, 0.7] {
        let mut own = observer(&file, true);
        let found = observe(&mut own, scale, 0.0, false);
        let level = own.drift().level;
        assert!((level - scale).abs() < 0.02, "{level} of {scale}");
        let inside = |own: &&Observed| {
            (own.estimate.trocar_force - own.truth[0]).abs() < 1.96 * own.estimate.std
        };
        let turning = &found[8000..TURNING];
        let coverage = turning.iter().filter(inside).count() as f64 / turning.len() as f64;
        assert!(coverage > 0.95, "{coverage} at {scale}");
        let last = found.last().unwrap();
        assert!((last.estimate.trocar_force - last.truth[0]).abs() < 0.1);
    }
}

/// To the last bit, whatever the angle at which it stands.
#[test]
fn an_instrument_that_does_not_turn_is_compensated_as_without_rotation() {
    let [mut turning, mut plain] = models().map(|file| observer(&file, true));
    let mut reading = models()[1].trocar.rest(0.05);
    for [time, position, _] in motion() {
        let force = models()[1].trocar.step_to(&mut reading, position, 1e-3) + 1e-3 * time.sin();
        let (a, b) = (turning.turn(position, 0.7, force, 1e-3), plain.step(position, force, 1e-3));
        let bits = |e: Estimate| [e.trocar_force, e.tissue_force, e.std].map(f64::to_bits);
        assert_eq!((bits(a), a.fault, a.trocar_torque), (bits(b), b.fault, 0.0), "{time} s");
    }
}

#[test]
fn a_saved_state_goes_on_turning() {
    let [file, _] = models();
    let mut own = observer(&file, true);
    observe(&mut own, 0.8, 0.0, false);
    let mut again = observer(&file, true);
    again.set_state(&own.state()).unwrap();
    for k in 0..500 {
        let angle = 1e-2 * f64::from(k);
        let sample = |observer: &mut Compensator| observer.turn(0.05, angle, 0.1 * angle, 1e-3);
        assert_eq!(sample(&mut own), sample(&mut again));
    }
}

#[test]
fn faults_of_the_angle() {
    let [file, plain] = models();
    let mut own = observer(&file, false);
    assert_eq!(own.turn(0.05, f64::NAN, 0.0, 1e-3).fault, Some(Fault::NoPosition));
    for k in 0..400 {
        assert_eq!(own.turn(0.05, 5e-3 * f64::from(k), 1e-3 * f64::from(k), 1e-3).fault, None);
    }
    let before = own.last();
    let missing = own.turn(0.05, f64::NAN, 1.0, 1e-3);
    assert_eq!(
        (missing.fault, missing.trocar_force),
        (Some(Fault::NoPosition), before.trocar_force)
    );
    // An encoder that goes on from 0 after a turn: no motion, and the state of the seal is open.
    let jump = own.turn(0.05, 2.0 - std::f64::consts::TAU, 1.1, 1e-3);
    assert_eq!((jump.fault, jump.trocar_torque), (Some(Fault::Jump), before.trocar_torque));
    assert!(jump.std > 2.0 * before.std, "{} N, before {} N", jump.std, before.std);
    // A model along the axis does not heed the angle.
    assert_eq!(observer(&plain, false).turn(0.05, f64::NAN, 0.0, 1e-3).fault, None);
}

#[test]
fn a_recording_gives_the_torque_or_says_that_the_angle_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let (input, output) = (folder.path().join("in.csv"), folder.path().join("out.csv"));
    let [file, plain] = models();
    let along = |file: &ModelFile, with_angle: bool| {
        let head = if with_angle {
            "time_s,position_m,force_n,angle_rad"
        } else {
            "time_s,position_m,force_n"
        };
        let row = |[time, position, angle]: [f64; 3]| {
            let plain = format!("\n{time:.3},{position:.6},{:.4}", 3.0 * (1.3 * time).cos());
            if with_angle { format!("{plain},{angle:.6}") } else { plain }
        };
        let rows: String = motion().take(4000).map(row).collect();
        fs::write(&input, format!("{head}{rows}\n")).unwrap();
        let choice = Choice::default();
        let options = StreamOptions { choice: &choice, live: false };
        let mut own = observer(file, false);
        let done =
            compensate_file(&input, options, &mut own, &output, |_, _| {}, |_, _| {}).unwrap();
        let text = fs::read_to_string(&output).unwrap();
        let torques: Option<Vec<f64>> = text.starts_with("time_s,position_m,force_n,trocar_force_n,tissue_force_n,tissue_force_std_n,adapting,torque_n_m\n").then(|| {
            text.lines().skip(1).map(|line| line.rsplit_once(',').unwrap().1.parse().unwrap()).collect()
        });
        (torques, done.angle_missing)
    };
    let (torques, missing) = along(&file, true);
    let torques = torques.unwrap();
    assert!(!missing && torques.len() == 4000 && torques.iter().any(|torque| *torque > 2e-3));
    let (torques, missing) = along(&file, false);
    assert!(missing && torques.unwrap().iter().all(|torque| *torque == 0.0));
    for with_angle in [true, false] {
        assert_eq!(along(&plain, with_angle), (None, false));
    }
}
