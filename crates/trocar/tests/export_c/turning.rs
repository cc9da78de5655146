//! Exported models that turn: force and torque of the library.

use trocar_model::{Rotation, Seal};

use super::*;

/// Mean difference in single precision along the smooth motion, as a part of the largest force or
/// torque of the model. A slip that begins a step earlier or later is off by as much as it changes.
const SINGLE: f64 = 5e-3;

/// One call of `turn_to`, or of `step` where there is no angle.
#[derive(Clone, Copy)]
struct Turn {
    position: f64,
    angle: Option<f64>,
    duration: f64,
}

const RUN: &str = r"
static void run_NAME(FILE *calls)
{
    NAME_state state;
    memset(&state, 0, sizeof state);
    NAME_rest(&state, (NUMBER)0.0);
    while (fread(call, 8, 3, calls) == 3) {
        const NUMBER force = isnan(call[1]) ? NAME_step(&state, (NUMBER)call[0], (NUMBER)call[2])
                                            : NAME_turn_to(&state, (NUMBER)call[0], (NUMBER)call[1], (NUMBER)call[2]);
        outcome[0] = (double)force;
        outcome[1] = (double)state.torque_n_m;
        fwrite(outcome, 8, 2, stdout);
    }
}
";

/// EMS models of the other tests, with an isotropic seal, a soft and slippery and a stiff one.
fn models() -> Vec<(String, ModelFile)> {
    let rotations = [(425.0, 1.0), (60.0, 0.4), (3000.0, 1.7)];
    let random = random_models().into_iter().skip(2).step_by(3);
    let all = in_order(conformance_models().into_iter().chain(random).collect());
    let ems = all.into_iter().filter(|(_, model)| matches!(model.trocar.seal(), Seal::Ems(_)));
    ems.zip(rotations.into_iter().cycle())
        .map(|((name, mut model), (circumferential_stiffness, circumferential_ratio))| {
            let rotation =
                Rotation { shaft_radius: 5e-3, circumferential_stiffness, circumferential_ratio };
            model.trocar = model.trocar.with_rotation(Some(rotation)).unwrap();
            (name, model)
        })
        .collect()
}

/// Strokes while turning to and fro, with holds of each.
fn smooth() -> Vec<Turn> {
    let at = |k: u32| {
        let time = 1e-3 * f64::from(k);
        let position = 0.02 * (3.0 * time).sin().clamp(-0.7, 0.9);
        let angle = Some(2.0 * (1.7 * time).sin().clamp(-0.5, 0.8));
        Turn { position, angle, duration: 1e-3 }
    };
    (1..5000).map(at).collect()
}

/// The adversarial motion of the other tests, turned by as much at the surface, now and then not,
/// now and then by something that is no angle.
fn adversarial() -> Vec<Turn> {
    let mut angle = 0.0;
    let mut turned = |(k, Call { way, duration, .. }): (usize, Call)| {
        let arc = [0.0, way, -0.3 * way, 3.0 * way][k / 50 % 4];
        if arc.is_finite() {
            angle = (angle + arc / 5e-3) % 1e3;
        }
        let given = match k % 1000 {
            33 => Some(f64::INFINITY),
            433 => Some(f64::MAX),
            _ if k % 11 == 0 => None,
            _ => Some(angle),
        };
        let position = if given.is_some() { way.abs() % 0.1 } else { way };
        Turn { position, angle: given, duration }
    };
    adversarial_motion().into_iter().take(5000).enumerate().map(&mut turned).collect()
}

fn program(folder: &Path, names: &[String], number: &str, flags: &[&str], out: &str) -> PathBuf {
    let mut text = String::from("#include <math.h>\n#include <stdio.h>\n#include <string.h>\n");
    text.push_str("static double call[3];\nstatic double outcome[2];\n");
    for name in names {
        let _ = writeln!(text, "#include \"{name}.c\"");
        text.push_str(&RUN.replace("NAME", name).replace("NUMBER", number));
    }
    text.push_str(
        "int main(int count, char **names)\n{\n    FILE *calls = fopen(names[count - 1], \"rb\");\n",
    );
    for name in names {
        let _ = writeln!(text, "    rewind(calls);\n    run_{name}(calls);");
    }
    text.push_str("    return 0;\n}\n");
    fs::write(folder.join(format!("{out}.c")), text).unwrap();
    gcc(folder, &[flags, &[&format!("{out}.c"), "-o", out, "-lm"]].concat());
    folder.join(out)
}

fn run(program: &Path, calls: &[Turn]) -> Vec<Vec<[f64; 2]>> {
    let path = program.with_extension("calls");
    let numbers = calls
        .iter()
        .flat_map(|call| [call.position, call.angle.unwrap_or(f64::NAN), call.duration]);
    fs::write(&path, numbers.flat_map(f64::to_ne_bytes).collect::<Vec<u8>>()).unwrap();
    let output = Command::new(program).arg(&path).output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && errors.is_empty(), "{errors}");
    let (numbers, _) = output.stdout.as_chunks::<8>();
    let numbers: Vec<f64> = numbers.iter().map(|number| f64::from_ne_bytes(*number)).collect();
    let (pairs, _) = numbers.as_chunks::<2>();
    pairs.chunks(calls.len()).map(<[_]>::to_vec).collect()
}

fn library(model: &ModelFile, calls: &[Turn]) -> Vec<[f64; 2]> {
    let trocar = &model.trocar;
    let mut state = trocar.rest(0.0);
    let step = |call: &Turn| {
        let force = match call.angle {
            Some(angle) => trocar.turn_to(&mut state, call.position, angle, call.duration),
            None => trocar.step(&mut state, call.position, call.duration),
        };
        [force, state.torque()]
    };
    calls.iter().map(step).collect()
}

#[test]
fn force_and_torque_are_those_of_the_library() {
    if !has_gcc() {
        return;
    }
    let models = models();
    let folder = tempfile::tempdir().unwrap();
    for (name, model) in &models {
        store(model, folder.path(), name);
    }
    let names: Vec<String> = models.iter().map(|(name, _)| name.clone()).collect();
    let checked = ["-O1", "-fsanitize=undefined", "-fno-sanitize-recover"];
    let mut turns = 0;
    for (out, flags) in [("fast", &["-O2", "-Werror"][..]), ("checked", &checked)] {
        let program = program(folder.path(), &names, "double", flags, out);
        for calls in [smooth(), adversarial()] {
            let rows = run(&program, &calls);
            assert_eq!(rows.len(), models.len());
            for ((name, model), found) in models.iter().zip(&rows) {
                let mut unequal = 0;
                for (k, (a, b)) in library(model, &calls).iter().zip(found).enumerate() {
                    let near =
                        |k: usize, scale| (a[k] - b[k]).abs() <= TOLERANCE * a[k].abs().max(scale);
                    assert!(near(0, 1.0) && near(1, 5e-3), "{name}, step {k}: {a:?}, in C {b:?}");
                    unequal += usize::from(a != b);
                    turns += usize::from(a[1] != 0.0);
                }
                println!("{out:8} {name:15} not the same {unequal} of {}", calls.len());
            }
        }
    }
    assert!(turns > 50_000, "{turns} steps with a torque");
}

#[test]
fn single_precision_stays_near() {
    if !has_gcc() {
        return;
    }
    let models: Vec<_> = models().into_iter().filter(|(name, _)| name.starts_with("ems")).collect();
    let folder = tempfile::tempdir().unwrap();
    for (name, model) in &models {
        let single = COptions { precision: Precision::Single, ..options(name) };
        store_as(model, folder.path(), single);
    }
    let names: Vec<String> = models.iter().map(|(name, _)| name.clone()).collect();
    let program = program(folder.path(), &names, "float", &["-O2", "-Werror"], "single");
    let calls = smooth();
    for ((name, model), found) in models.iter().zip(run(&program, &calls)) {
        let exact = library(model, &calls);
        for (k, scale) in [(0, 1.0), (1, 5e-3)] {
            let largest = exact.iter().map(|pair| pair[k].abs()).fold(0.0, f64::max);
            let off: f64 = exact.iter().zip(&found).map(|(a, b)| (a[k] - b[k]).abs()).sum();
            let off = off / exact.len() as f64;
            println!("{name:15} {:.1e} of the largest", off / largest);
            assert!(largest > 0.1 * scale && off <= SINGLE * largest, "{name}: {off} of {largest}");
        }
    }
}

/// What is exported for a model that does not turn knows nothing of it.
#[test]
fn a_model_along_the_axis_has_no_angle() {
    for (name, model) in [conformance_models(), random_models()].concat() {
        let files = write(&model, "a test", options("seal")).unwrap();
        for text in [files.header, files.source] {
            assert!(
                !["angle", "turn_to", "around"].iter().any(|word| text.contains(word)),
                "{name}"
            );
        }
    }
}

#[test]
fn the_observer_of_a_model_that_turns_is_refused() {
    let options = COptions { compensator: Some(&Default::default()), ..options("seal") };
    let error = write(&models()[0].1, "a test", options).unwrap_err();
    assert!(matches!(error, CError::Rotation) && error.to_string().contains("hint: "), "{error}");
}
