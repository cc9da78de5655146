//! Many trocars over one motion: each gives exactly its separate result, whatever its kind, its
//! initial state and the number of threads.

use std::path::Path;
use std::time::Duration;

use trocar::cancel::{Cancel, Stopped};
use trocar::many::ensemble::{Ensemble, Motion, Refusal, Start, Tuned, forces, squared_errors};
use trocar::model_file::ModelFile;
use trocar_model::{ParamError, PositionProfile, Trocar};

/// Models of every kind, and a motion with rests, jumps and repeated rows, used to compare all
/// interfaces.
fn conformance() -> (Vec<ModelFile>, Vec<f64>, Vec<f64>) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../conformance");
    let mut paths: Vec<_> = std::fs::read_dir(folder.join("models"))
        .unwrap()
        .map(|file| file.unwrap().path())
        .collect();
    paths.sort();
    let models = paths.iter().map(|path| ModelFile::read(path).unwrap()).collect();
    let rows = std::fs::read_to_string(folder.join("motion.csv")).unwrap();
    let number = |row: &str, k: usize| row.split(',').nth(k).unwrap().parse::<f64>().unwrap();
    let column = |k: usize| rows.lines().skip(1).map(|row| number(row, k)).collect();
    (models, column(0), column(1))
}

/// Files as an ensemble.
struct Files<'a>(Vec<&'a ModelFile>);

impl Ensemble for Files<'_> {
    fn count(&self) -> usize {
        self.0.len()
    }

    fn trocar(&self, index: usize) -> Result<Trocar<&[f64]>, ParamError> {
        Ok(self.0[index].trocar.borrowed())
    }
}

fn alone(trocar: &Trocar<&[f64]>, start: Start, time: &[f64], position: &[f64]) -> Vec<f64> {
    let mut state = start.state(trocar, position[0]).unwrap();
    let mut before = time[0];
    let step = |(&t, &x): (&f64, &f64)| {
        trocar.step_to(&mut state, x, t - before);
        before = t;
        state.force()
    };
    time.iter().zip(position).map(step).collect()
}

fn assert_same(found: &[f64], expected: &[f64], what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let differ = found.iter().zip(expected).position(|(a, b)| a.to_bits() != b.to_bits());
    assert_eq!(differ, None, "{what}");
}

/// On three threads.
fn run(ensemble: &impl Ensemble, start: Start, motion: &Motion) -> Vec<f64> {
    let mut found = vec![f64::NAN; ensemble.count() * motion.samples()];
    Cancel::default().run(3, || forces(ensemble, start, motion, &mut found)).unwrap().unwrap();
    found
}

#[test]
fn models_of_all_kinds_go_together() {
    let (models, time, position) = conformance();
    // Blocks of models without, with equal and with different position profiles.
    let mut moved = models.clone();
    for (k, model) in moved.iter_mut().enumerate() {
        let gains = vec![0.9 - 0.01 * k as f64, 1.0, 1.1 + 0.01 * k as f64];
        let profile = PositionProfile::new(-0.02, 0.05, vec![0.0, 0.1, -0.1], gains).unwrap();
        model.trocar = Trocar::new(*model.trocar.seal(), Some(profile));
    }
    let files: Vec<&ModelFile> =
        (0..120).map(|k| if k % 3 == 0 { &moved[k % 14] } else { &models[k % 14] }).collect();
    let motion = Motion::new(&time, &position);
    for start in [Start::Undeformed, Start::Force(-1.0)] {
        let expected: Vec<f64> = files
            .iter()
            .flat_map(|file| alone(&file.trocar.borrowed(), start, &time, &position))
            .collect();
        assert_same(&run(&Files(files.clone()), start, &motion), &expected, &format!("{start:?}"));
    }
}

#[test]
fn turned_parameters_are_those_of_each() {
    let (models, time, position) = conformance();
    let motion = Motion::new(&time, &position);
    let factors: Vec<f64> = (0..50).map(|k| 0.8 + 0.01 * f64::from(k)).collect();
    for (number, file) in models.iter().enumerate() {
        let base = file.trocar.borrowed();
        let first = base.seal().tunables().next().unwrap();
        let values: Vec<f64> = factors.iter().map(|factor| factor * first.value).collect();
        let seal = |value: &f64| base.with_seal(base.seal().tuned(&[*value]).unwrap());
        let expected: Vec<f64> = values
            .iter()
            .flat_map(|value| alone(&seal(value), Start::Undeformed, &time, &position))
            .collect();
        let tuned = Tuned::new(base, vec![(0, &values)]).unwrap();
        assert_same(
            &run(&tuned, Start::Undeformed, &motion),
            &expected,
            &format!("model {number}"),
        );
        let measured: Vec<f64> =
            (0..time.len()).map(|k| if k % 5 == 0 { f64::NAN } else { k as f64 % 3.0 }).collect();
        let mut sums = vec![f64::NAN; values.len()];
        squared_errors(&tuned, Start::Undeformed, &motion, &measured, &mut sums).unwrap();
        let square = |(reading, force): (&f64, &f64)| {
            if reading.is_nan() { 0.0 } else { (reading - force) * (reading - force) }
        };
        let sum = |forces: &[f64]| measured.iter().zip(forces).map(square).sum();
        let squares: Vec<f64> = expected.chunks(time.len()).map(sum).collect();
        assert_same(&sums, &squares, &format!("squares of model {number}"));
    }
}

#[test]
fn a_motion_that_cannot_be_followed_is_held() {
    let (time, position) =
        ([0.0, 1.0, 1.0, 2.0, f64::NAN, 4.0, 5.0], [0.0, 0.01, 0.02, f64::NAN, 0.01, 0.03, 0.0]);
    let model = ModelFile::plausible_10_5_mm().unwrap();
    let trocar = model.trocar.borrowed();
    let expected = alone(&trocar, Start::Undeformed, &time, &position);
    let found = run(
        &Tuned::new(trocar, Vec::new()).unwrap(),
        Start::Undeformed,
        &Motion::new(&time, &position),
    );
    assert_same(&found, &expected, "held");
    assert!(
        run(&Tuned::new(trocar, Vec::new()).unwrap(), Start::Undeformed, &Motion::new(&[], &[]))
            .is_empty()
    );
}

#[test]
fn the_first_that_cannot_be_run_is_told() {
    let (models, time, position) = conformance();
    let motion = Motion::new(&time, &position);
    let plausible = ModelFile::plausible_10_5_mm().unwrap();
    let widths: Vec<f64> =
        (0..200).map(|k| if k == 77 || k == 150 { -1e-3 } else { 5e-3 }).collect();
    let tuned = Tuned::new(plausible.trocar.borrowed(), vec![(0, &widths)]).unwrap();
    assert!(Tuned::new(plausible.trocar.borrowed(), vec![(99, &widths)]).is_none());
    let mut out = vec![0.0; 200];
    let refusal = squared_errors(&tuned, Start::Undeformed, &motion, &time, &mut out).unwrap_err();
    assert!(matches!(refusal, Refusal::Parameter { index: 77, .. }));
    assert_eq!(
        refusal.to_string(),
        "model 77: half_width_m must be finite and above 0 m, got -0.001 m"
    );
    let classical = models.iter().position(|model| model.stages().is_err()).unwrap();
    let files = Files(models.iter().collect());
    let mut out = vec![0.0; files.count() * motion.samples()];
    let refusal = forces(&files, Start::Deflection(1e-3), &motion, &mut out).unwrap_err();
    assert_eq!(refusal, Refusal::NoDeflection { index: classical });
}

#[test]
fn work_that_is_cancelled_ends() {
    let model = ModelFile::plausible_10_5_mm().unwrap();
    let time: Vec<f64> = (0..100_000).map(|k| f64::from(k) * 1e-3).collect();
    let position: Vec<f64> = time.iter().map(|t| 0.02 * t.sin()).collect();
    let widths = vec![5e-3; 100_000];
    let tuned = Tuned::new(model.trocar.borrowed(), vec![(0, &widths)]).unwrap();
    let (motion, cancel, mut sums) =
        (Motion::new(&time, &position), Cancel::default(), vec![0.0; widths.len()]);
    let outcome = std::thread::scope(|scope| {
        let flag = cancel.clone();
        let (tuned, motion, time, sums) = (&tuned, &motion, &time, &mut sums);
        let work = move || {
            flag.run(2, || squared_errors(tuned, Start::Undeformed, motion, time, sums)).map(drop)
        };
        let worker = scope.spawn(work);
        std::thread::sleep(Duration::from_millis(200));
        cancel.cancel();
        worker.join().unwrap()
    });
    // The whole computation would take a quarter of a minute.
    assert!(matches!(outcome, Err(Stopped::Cancelled)));
}
