//! The observer in C beside that of the library, sample by sample.

use trocar::bench::config::TissueKind;
use trocar::bench::{BenchConfig, Protocol, run};
use trocar::compensate::{CompensateOptions, Compensator, Fault};
use trocar::model_file::{ErrorSource, ForceError};
use trocar_model::ElementParams;

use super::*;

/// What the observer gets: position, m; reading, N; duration, s.
type Sample = [f64; 3];

/// What it says: trocar force, tissue force, its standard deviation, adapting, fault, friction
/// scale, viscosity, their standard deviations, contact.
type Row = [f64; 10];

/// Reads samples, writes one row for each.
const OBSERVE: &str = r#"
#include <stdio.h>
#include "NAME.h"
static NAME_compensator compensator;
int main(int count, char **names)
{
    FILE *samples = fopen(names[count - 1], "rb");
    double sample[3], row[10];
    if (!samples) {
        return 1;
    }
    NAME_reset(&compensator);
    while (fread(sample, 8, 3, samples) == 3) {
        const NAME_estimate e =
            NAME_compensate(&compensator, (NUMBER)sample[0], (NUMBER)sample[1], (NUMBER)sample[2]);
        const NAME_drift_estimate d = NAME_drift(&compensator);
        row[0] = (double)e.trocar_force_n;
        row[1] = (double)e.tissue_force_n;
        row[2] = (double)e.tissue_force_std_n;
        row[3] = e.adapting;
        row[4] = e.fault;
        row[5] = (double)d.level;
        row[6] = (double)d.viscosity;
        row[7] = (double)d.level_std;
        row[8] = (double)d.viscosity_std;
        row[9] = d.in_contact;
        fwrite(row, 8, 10, stdout);
    }
    return 0;
}
"#;

/// A small generator of uniform numbers from 0 to 1.
struct Uniform(u64);

impl Uniform {
    fn next(&mut self) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// Strokes of changing length and speed with rests and partial reversals, sampled unevenly; the seal
/// is wetted after a third of the time and dries after two; from 0.13 m on there is elastic tissue.
/// With `faults`, some samples are spoilt in every way there is.
fn recording(model: &ModelFile, seed: u64, samples: usize, faults: bool) -> Vec<Sample> {
    let trocar = model.trocar.borrowed();
    let mut random = Uniform(seed);
    let (mut position, mut goal, mut speed, mut rest) = (0.08, 0.12, 0.03, 0);
    let mut state = trocar.rest(position);
    let mut levels = [1.0_f64; 2];
    let mut encoder = 0.0;
    let mut rows = Vec::with_capacity(samples);
    for k in 0..samples {
        let duration = 1e-3 * (0.8 + 0.4 * random.next());
        if rest > 0 {
            rest -= 1;
        } else if (goal - position).abs() <= speed * duration {
            goal = 0.06 + 0.08 * random.next();
            speed = 0.002 + 0.08 * random.next().powi(2);
            rest = if random.next() < 0.3 { 300 } else { 0 };
        } else {
            position += speed * duration * (goal - position).signum();
        }
        let wet = if (samples / 3..2 * samples / 3).contains(&k) { [0.6, 1.4] } else { [1.0; 2] };
        levels = [0, 1].map(|i| levels[i] + 1e-3 * (wet[i] - levels[i]));
        let friction = levels[0] * trocar.step_to(&mut state, position, duration);
        let tissue = 300.0 * (position - 0.13).max(0.0);
        let noise = 0.02 * (random.next() + random.next() - 1.0);
        let shown = 4e-6 * (position / 4e-6).round();
        let mut row = [shown + encoder, 0.2 + friction + tissue + noise, duration];
        if faults {
            spoil(&mut row, &mut encoder, &mut random);
        }
        rows.push(row);
    }
    if faults {
        // The sensor hangs for a second.
        let (from, to) = (samples / 2, (samples / 2 + 1000).min(samples));
        let frozen = rows[from][1];
        rows[from..to].iter_mut().for_each(|row| row[1] = frozen);
    }
    rows
}

/// Makes about every hundredth sample invalid; `encoder` is its zero, m.
fn spoil(row: &mut Sample, encoder: &mut f64, random: &mut Uniform) {
    let draw = (4000.0 * random.next()) as u32;
    match draw {
        0..10 => row[1] = [f64::NAN, f64::INFINITY, -2e6][draw as usize % 3],
        10..20 => row[0] = [f64::NAN, f64::INFINITY][draw as usize % 2],
        20..30 => row[2] = [0.0, -1e-3, f64::NAN, f64::INFINITY][draw as usize % 4],
        30..35 => row[1] = 50.0,
        35 => *encoder += 0.01,
        36 | 37 => row[2] = 0.3,
        38 => row[2] = 30.0,
        39..50 => row[2] = 3e-6,
        _ => (),
    }
}

/// Rows of the library's observer.
fn expected(model: &ModelFile, options: &CompensateOptions, samples: &[Sample]) -> Vec<Row> {
    let mut observer = Compensator::new(model, options).unwrap();
    let number = |fault: Fault| Fault::ALL.iter().position(|f| *f == fault).unwrap() as f64 + 1.0;
    let row = |[position, reading, duration]: &Sample| {
        let e = observer.step(*position, *reading, *duration);
        let d = observer.drift();
        [
            e.trocar_force,
            e.tissue_force,
            e.std,
            f64::from(u8::from(e.adapting)),
            e.fault.map_or(0.0, number),
            d.level,
            d.viscosity,
            d.level_std,
            d.viscosity_std,
            f64::from(u8::from(observer.is_in_contact())),
        ]
    };
    samples.iter().map(row).collect()
}

/// Rows of the observer in C.
fn observed(
    model: &ModelFile,
    options: COptions,
    folder: &Path,
    samples: &[Sample],
    flags: &[&str],
) -> Vec<Row> {
    let name = options.stem;
    store_as(model, folder, options);
    let number = if options.precision == Precision::Single { "float" } else { "double" };
    let program = OBSERVE.replace("NAME", name).replace("NUMBER", number);
    fs::write(folder.join("observe.c"), program).unwrap();
    let source = format!("{name}.c");
    let fixed = ["-Werror", "observe.c", &source, "-o", "observe", "-lm"];
    gcc(folder, &[flags, &fixed].concat());
    let bytes: Vec<u8> = samples.iter().flatten().flat_map(|value| value.to_ne_bytes()).collect();
    fs::write(folder.join("samples"), bytes).unwrap();
    let mut command = Command::new(folder.join("observe"));
    let output = command.current_dir(folder).arg("samples").output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && errors.is_empty(), "{errors}");
    let numbers: Vec<f64> = output
        .stdout
        .chunks_exact(8)
        .map(|bytes| f64::from_ne_bytes(bytes.try_into().unwrap()))
        .collect();
    assert_eq!(numbers.len(), 10 * samples.len());
    numbers.chunks_exact(10).map(|row| row.try_into().unwrap()).collect()
}

/// The model with errors by phase, with or without one of partial reversals; a sensor with or
/// without moving mass; with or without adaptation.
fn variant(model: &ModelFile, k: usize) -> (ModelFile, CompensateOptions) {
    let mut model = model.clone();
    model.force_error = Some(ForceError {
        deforming_n: Some(0.05),
        sliding_n: Some(0.03),
        held_n: (!k.is_multiple_of(5)).then_some(0.04),
        partial_n: k.is_multiple_of(3).then_some(0.08),
        source: ErrorSource::Validation,
    });
    let options = CompensateOptions {
        offset_n: Some(0.2),
        flip_force: Some(k % 3 == 2),
        moving_mass_kg: Some(if k.is_multiple_of(2) { 0.0 } else { 0.3 }),
        gravity_m_s2: if k % 4 == 1 { -9.81 } else { 0.0 },
        sensor_limit_n: k.is_multiple_of(2).then_some(40.0),
        force_error_n: None,
        adaptation: k % 7 != 6,
    };
    (model, options)
}

/// Whether two numbers are the same, NaN included.
fn same(a: f64, b: f64) -> bool {
    a == b || (a.is_nan() && b.is_nan())
}

#[test]
fn the_observer_in_c_is_that_of_the_library() {
    if !has_gcc() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let mut seen = [0; 9];
    let (mut adapting, mut contact, mut moved) = (0, 0, 0.0_f64);
    let models = in_order([conformance_models(), random_models(), classical_models()].concat());
    for (k, (name, model)) in models.iter().enumerate() {
        let (model, observing) = variant(model, k);
        let is_short = k >= 20;
        let mut samples =
            recording(&model, k as u64 + 1, if is_short { 6_000 } else { 60_000 }, k % 4 != 3);
        // Readings of the sign that the observer expects, and of the other one.
        if k % 6 == 2 {
            samples.iter_mut().for_each(|[_, reading, _]| *reading = -*reading);
        }
        let rows = expected(&model, &observing, &samples);
        let options = COptions { compensator: Some(&observing), ..options("seal") };
        let flags = if is_short { ["-O1", "-fsanitize=undefined"] } else { ["-O2", "-O2"] };
        let own = observed(&model, options, folder.path(), &samples, &flags);
        for (step, (row, own)) in rows.iter().zip(&own).enumerate() {
            let equal = row.iter().zip(own).all(|(a, b)| same(*a, *b));
            assert!(equal, "{name}, sample {step}: library {row:?}, C {own:?}");
            seen[row[4] as usize] += 1;
            adapting += usize::from(row[3] != 0.0);
            contact += usize::from(row[9] != 0.0);
            moved = moved.max((row[5] - 1.0).abs());
        }
    }
    // The recordings show all that the observer does.
    println!(
        "samples by fault {seen:?}, adapting in {adapting}, in contact {contact}, scale by {moved:.2}"
    );
    assert!(seen.iter().all(|count| *count > 20), "{seen:?}");
    assert!(adapting > 10_000 && contact > 10_000 && moved > 0.3);
}

/// Bound of the root-mean-square difference of the tissue force in single precision, N, and of the
/// difference of the friction scale, over a minute with wetting and tissue.
const SINGLE_FORCE: f64 = 0.005;
const SINGLE_LEVEL: f64 = 0.05;
/// The bound for models that stick and slip: rounding shifts single slips. They are those whose force
/// in the library moves by more than this, N, if its inputs are rounded to a float.
const SINGLE_FORCE_STICK_SLIP: f64 = 0.08;
const SHIFTED: f64 = 1e-3;

/// Prints the table of docs/reference/exported-c.md.
#[test]
fn the_observer_in_single_precision_is_near() {
    if !has_gcc() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    println!(
        "| model | mean square, mN | above 10 mN, % | largest, mN | friction scale, largest | library, inputs rounded, mN |"
    );
    for (k, (name, model)) in in_order(conformance_models()).iter().enumerate() {
        let (model, observing) = variant(model, 7 * k);
        let observing = CompensateOptions { flip_force: None, ..observing };
        let samples = recording(&model, k as u64 + 1, 60_000, false);
        let rows = expected(&model, &observing, &samples);
        let options = COptions {
            compensator: Some(&observing),
            precision: Precision::Single,
            ..options("seal")
        };
        let own = observed(&model, options, folder.path(), &samples, &["-O2"]);
        let pairs = || rows.iter().zip(&own);
        assert!(pairs().all(|(a, b)| a[1].is_nan() == b[1].is_nan()), "{name}");
        let errors = || pairs().map(|(a, b)| (a[1] - b[1]).abs());
        let largest = errors().fold(0.0, f64::max);
        let mean = (errors().map(|e| e * e).sum::<f64>() / rows.len() as f64).sqrt();
        let above = 100.0 * errors().filter(|e| *e > 0.01).count() as f64 / rows.len() as f64;
        let level = pairs().map(|(a, b)| (a[5] - b[5]).abs()).fold(0.0, f64::max);
        let rounded: Vec<Sample> =
            samples.iter().map(|sample| sample.map(|value| f64::from(value as f32))).collect();
        let beside = expected(&model, &observing, &rounded);
        let moves = rows.iter().zip(&beside).map(|(a, b)| (a[1] - b[1]).powi(2));
        let moved = (moves.sum::<f64>() / rows.len() as f64).sqrt();
        println!(
            "| {name} | {:.2} | {above:.2} | {:.1} | {level:.4} | {:.2} |",
            1e3 * mean,
            1e3 * largest,
            1e3 * moved
        );
        let bound = if moved > SHIFTED { SINGLE_FORCE_STICK_SLIP } else { SINGLE_FORCE };
        assert!(mean < bound && level < SINGLE_LEVEL, "{name}: {mean} N, {level}");
    }
}

#[test]
fn a_model_that_does_not_state_its_error_is_refused() {
    let mut model = conformance_models().remove(0).1;
    model.force_error = None;
    let observing = CompensateOptions::default();
    let options = COptions { compensator: Some(&observing), ..options("seal") };
    let refused = write(&model, "a test", options).unwrap_err();
    assert!(matches!(refused, CError::Compensate(_)), "{refused}");
    assert!(refused.to_string().contains("‹force_error_n›"), "{refused}");
}

/// Recordings of the virtual bench with a seal that is wetted, and tissue.
#[test]
fn recordings_of_the_virtual_bench_give_the_same_estimates() {
    if !has_gcc() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let seal = [Element::new(ElementParams::plausible_10_5_mm().unwrap()).unwrap()];
    let mut model = ModelFile::plausible_10_5_mm().unwrap();
    model.force_error = Some(ForceError::everywhere(0.05));
    let mut config = BenchConfig::default();
    config.tissue.kind = TissueKind::HuntCrossley;
    config.tissue.surface_m = 0.07;
    config.protocol.surgeon.duration_s = 30.0;
    let observing = CompensateOptions {
        moving_mass_kg: Some(config.rod.mass_kg),
        ..CompensateOptions::default()
    };
    for protocol in [Protocol::Steady, Protocol::Dynamic, Protocol::Surgeon] {
        let record = run(&config, protocol, &seal, 5).unwrap();
        let duration = |k: usize| if k == 0 { 0.0 } else { record.time[k] - record.time[k - 1] };
        let samples: Vec<Sample> = (0..record.time.len())
            .map(|k| [record.position[k], record.force[k], duration(k)])
            .collect();
        let rows = expected(&model, &observing, &samples);
        let options = COptions { compensator: Some(&observing), ..options("seal") };
        let own = observed(&model, options, folder.path(), &samples, &["-O2"]);
        for (step, (row, own)) in rows.iter().zip(&own).enumerate() {
            let equal = row.iter().zip(own).all(|(a, b)| same(*a, *b));
            assert!(equal, "{protocol:?}, sample {step}: library {row:?}, C {own:?}");
        }
    }
}
