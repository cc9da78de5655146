//! The exported C code of models, compiled and compared with the library. Requires gcc.

mod builds;
mod compensator;
mod promise;
mod single;
mod turning;

use std::fmt::Write as _;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::common;
use crate::skipped::skipped;
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::TestRunner;
use trocar::export::c::{
    CError, CFiles, COptions, Precision, check_prefix, from_file, stem, write,
};
use trocar::model_file::{ModelFile, Origin, OriginKind};
use trocar_model::{
    BoucWen, BoucWenParams, Classical, Dahl, DahlParams, DeformationForce, Element, Gms,
    GmsElement, Leuven, LeuvenParams, LuGre, LuGreParams, Relaxation, RelaxationArm,
    SlidingFriction, SlipElement, SlipRate, Stages, StaticFriction, StribeckCurve,
};

/// Largest difference from the library, relative to the force or to 1 N, whichever is greater.
/// Rounding of a double is 1.1e-16, and `log1p` of two C libraries may differ by that.
const TOLERANCE: f64 = 1e-12;

/// The strictest checks of gcc.
const FLAGS: [&str; 8] = [
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Wconversion",
    "-Wdouble-promotion",
    "-Wshadow",
    "-Wmissing-prototypes",
    "-ffp-contract=off",
];

/// EMS models of random elements.
const RANDOM_MODELS: usize = 12;

/// Steps of the adversarial motion.
const STEPS: usize = 20_000;

/// One call of the model: `step_to` or `step`, its target, and its duration.
#[derive(Clone, Copy)]
struct Call {
    to: bool,
    way: f64,
    duration: f64,
}

/// Its result: force, position, and whether any byte of the state changed.
#[derive(Clone, Copy)]
struct Outcome {
    force: f64,
    position: f64,
    touched: bool,
}

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Whether gcc is available; without it the test is skipped, but fails in CI.
fn has_gcc() -> bool {
    let found =
        Command::new("gcc").arg("--version").output().is_ok_and(|output| output.status.success());
    if !found {
        skipped("no gcc");
        assert!(std::env::var("CI").as_deref() != Ok("true"), "CI needs gcc");
    }
    found
}

fn gcc(folder: &Path, arguments: &[&str]) {
    let mut command = Command::new("gcc");
    command.current_dir(folder).arg("-std=c99").args(FLAGS).args(arguments);
    let output = command.output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "gcc {arguments:?}\n{errors}");
}

fn options(prefix: &str) -> COptions<'_> {
    COptions {
        prefix,
        stem: prefix,
        precision: Precision::Double,
        compensator: None,
        internal: false,
    }
}

/// The C code of `model` in `folder` as NAME.c and NAME.h, with the prefix NAME.
fn store(model: &ModelFile, folder: &Path, name: &str) -> CFiles {
    store_as(model, folder, options(name))
}

fn store_as(model: &ModelFile, folder: &Path, options: COptions) -> CFiles {
    let files = write(model, "a test", options).unwrap();
    let name = options.stem;
    files.store(&folder.join(format!("{name}.c"))).unwrap();
    files
}

/// The models in the order in which they came to be: options, motion and rotation follow
/// from the place.
fn in_order(mut models: Vec<(String, ModelFile)>) -> Vec<(String, ModelFile)> {
    models.sort_by_key(|(name, model)| {
        (name == "ems_dwell", model.trocar.seal().kind() == "bouc-wen")
    });
    models
}

fn conformance_models() -> Vec<(String, ModelFile)> {
    let mut paths: Vec<PathBuf> = fs::read_dir(repository().join("conformance/models"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    paths.sort();
    let name = |path: &Path| path.file_stem().unwrap().to_str().unwrap().to_owned();
    paths.iter().map(|path| (name(path), ModelFile::read(path).unwrap())).collect()
}

fn conformance_motion() -> (f64, Vec<Call>) {
    let text = fs::read_to_string(repository().join("conformance/motion.csv")).unwrap();
    let rows: Vec<(f64, f64)> = text
        .lines()
        .skip(1)
        .map(|line| line.split_once(',').unwrap())
        .map(|(time, position)| (time.parse().unwrap(), position.parse().unwrap()))
        .collect();
    let call =
        |pair: &[(f64, f64)]| Call { to: true, way: pair[1].1, duration: pair[1].0 - pair[0].0 };
    (rows[0].1, rows.windows(2).map(call).collect())
}

/// Any optional model terms alone or together.
fn elements() -> impl Strategy<Value = Element> {
    let some = |values: std::ops::Range<f64>| prop_oneof![Just(0.0), values];
    let arm = (some(10.0..2000.0), 0.01..10.0_f64)
        .prop_map(|(stiffness, time)| RelaxationArm { stiffness, time });
    let curve = prop_oneof![Just(None), Just(Some(1.0)), Just(Some(2.0))];
    let slow = (some(1e-6..1e-3), some(1e-3..0.1), [arm.clone(), arm], some(0.01..1.0));
    let general = (common::general_elements(), 1.0..4.0_f64, slow, curve, -1.0..1.0_f64).prop_map(
        |(element, kappa, (creep, lag, arms, dwell_force), curve, bend)| {
            let mut params = *element.params();
            let deformation = &params.deformation;
            let kappa = Some(kappa * deformation.yield_stiffness());
            params.deformation =
                DeformationForce::new(*deformation.insertion(), *deformation.withdrawal(), kappa)
                    .unwrap();
            params.creep_velocity = creep;
            params.friction_lag = if creep > 0.0 { lag } else { 0.0 };
            params.relaxation = Relaxation { arms };
            params.dwell_force = dwell_force;
            params.damping.coefficients[1] = bend.max(0.0);
            params.damping.coefficients[2] = 1.0 + bend;
            if let Some(exponent) = curve {
                params.insertion.stribeck_exponent = exponent;
            }
            Element::new(params).unwrap()
        },
    );
    prop_oneof![1 => common::seals().prop_map(|seal| seal.element()), 3 => general]
}

/// One to four random elements each, every third model with a position profile; and a hump above
/// the sliding force, with and without a term that determines the slip speed.
fn random_models() -> Vec<(String, ModelFile)> {
    let mut runner = TestRunner::deterministic();
    let mut draw =
        || prop::collection::vec(elements(), 1..=4).new_tree(&mut runner).unwrap().current();
    let along =
        ModelFile::read(&repository().join("conformance/models/ems_profile.json")).unwrap().trocar;
    let file = |elements: Vec<Element>| {
        ModelFile::new(Stages::new(&elements).unwrap(), Origin::new(OriginKind::HandMade))
    };
    let random = (0..RANDOM_MODELS).map(|k| {
        let mut model = file(draw());
        if k % 3 == 0 {
            model.trocar = along.with_seal(*model.trocar.seal());
        }
        (format!("random{k}"), model)
    });
    let humped = [0.0, 5.0].into_iter().enumerate().map(|(k, beta)| {
        let element = Element::new(common::humped(beta)).unwrap();
        (format!("humped{k}"), file(vec![element]))
    });
    random.chain(humped).collect()
}

/// The forms of the classical models that are not among the conformance models.
fn classical_models() -> Vec<(String, ModelFile)> {
    let curve = |stribeck_exponent| SlidingFriction {
        coulomb_force: 2.0,
        static_force: 3.0,
        stribeck_velocity: 0.01,
        stribeck_exponent,
        viscous_damping: 4.0,
    };
    let level = SlidingFriction::coulomb(2.5, 0.0);
    let dahl = |exponent| {
        let params =
            DahlParams { stiffness: 2000.0, coulomb_force: 3.0, exponent, viscous_damping: 1.0 };
        Classical::Dahl(Dahl::new(params).unwrap())
    };
    let lugre = |sliding, damping_velocity, curve| {
        let params =
            LuGreParams { stiffness: 1500.0, micro_damping: 5.0, damping_velocity, sliding, curve };
        Classical::LuGre(LuGre::new(params).unwrap())
    };
    let bank: Vec<SlipElement> =
        (1..5).map(|k| SlipElement { stiffness: 500.0 * f64::from(k), limit_force: 1.0 }).collect();
    let leuven = |sliding, exponent, micro_damping| {
        Classical::Leuven(
            Leuven::new(&bank, LeuvenParams { sliding, exponent, micro_damping }).unwrap(),
        )
    };
    let gms = |sliding, slip_rate, damping| {
        let element = |k: u32| GmsElement {
            stiffness: 400.0 * f64::from(k),
            share: 0.25,
            attraction: 0.01 * f64::from(k),
            damping,
        };
        let elements: Vec<GmsElement> = (1..5).map(element).collect();
        Classical::Gms(Gms::new(&elements, sliding, slip_rate).unwrap())
    };
    let bouc_wen = |exponent, unloading_shape| {
        Classical::BoucWen(
            BoucWen::new(BoucWenParams {
                stiffness: 2000.0,
                coulomb_force: 3.0,
                exponent,
                unloading_shape,
                viscous_damping: 1.0,
            })
            .unwrap(),
        )
    };
    let models = [
        Classical::Static(StaticFriction::new(level).unwrap()),
        Classical::Static(StaticFriction::new(curve(1.0)).unwrap()),
        dahl(1.0),
        dahl(0.5),
        dahl(1.5),
        dahl(300.0),
        bouc_wen(1.0, 0.5),
        bouc_wen(2.0, 1.2),
        bouc_wen(1.6, 0.8),
        bouc_wen(300.0, 2.0),
        lugre(level, f64::INFINITY, StribeckCurve::Exponential),
        lugre(curve(1.3), 0.05, StribeckCurve::Exponential),
        lugre(curve(0.7), 0.05, StribeckCurve::Rational),
        leuven(curve(2.0), 1.0, 1.0),
        leuven(level, 2.0, 0.0),
        leuven(curve(1.0), 1.7, 1.0),
        leuven(curve(0.5), 0.6, 0.5),
        gms(curve(2.0), SlipRate::Free, 0.0),
        gms(curve(1.5), SlipRate::Limited, 0.7),
        gms(level, SlipRate::Limited, 0.0),
    ];
    let file = |(k, model)| {
        (format!("classical{k}"), ModelFile::new(model, Origin::new(OriginKind::HandMade)))
    };
    models.into_iter().enumerate().map(file).collect()
}

/// Reversals, creep, jumps, rests, durations from 1 ns to 1 s, and invalid inputs.
fn adversarial_motion() -> Vec<Call> {
    let mut state = 0x2545_f491_4f6c_dd1d_u64;
    let mut uniform = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let mut decade = |from: f64, to: f64| 10_f64.powf(from + (to - from) * uniform());
    let mut sign = 1.0;
    let mut call = |k: usize| {
        sign = if k % 97 < 40 { -sign } else { sign };
        let (way, duration) = match k % 1000 {
            7 => (f64::NAN, 1e-3),
            107 => (1e-3, f64::NAN),
            207 => (f64::INFINITY, 1e-3),
            307 => (1e-3, f64::INFINITY),
            407 => (1e-3, 0.0),
            507 => (1e-3, -1e-3),
            607 => (f64::MAX, 1e-3),
            707 => (1e300, 1.0),
            807 => (0.0, decade(-9.0, 0.0)),
            _ if k.is_multiple_of(5) => (sign * decade(-9.0, -5.0), decade(-4.0, 0.0)),
            _ if k.is_multiple_of(7) => (sign * decade(-4.0, -1.0), decade(-9.0, 0.0)),
            _ => (sign * decade(-6.0, -2.5), 1e-3),
        };
        Call { to: false, way, duration }
    };
    (0..STEPS).map(&mut call).collect()
}

/// Whether a step must leave the state unchanged.
fn is_refused(call: Call, position: f64) -> bool {
    let displacement = if call.to { call.way - position } else { call.way };
    let velocity = displacement / call.duration;
    !(call.duration > 0.0
        && call.duration.is_finite()
        && velocity.is_finite()
        && (position + displacement).is_finite())
}

/// A program that runs every model of `names` through the calls in the file of its first argument;
/// the models take their numbers as `number`.
fn driver(names: &[String], number: &str) -> String {
    let mut text = String::from("#include <stdio.h>\n#include <string.h>\n");
    for name in names {
        let _ = writeln!(text, "#include \"{name}.c\"");
    }
    text.push_str("static double call[3];\nstatic double outcome[3];\nstatic double start;\n");
    text.push_str("static char before[4096];\n");
    for name in names {
        text.push_str(&RUN.replace("NAME", name).replace("NUMBER", number));
    }
    text.push_str("int main(int count, char **names)\n{\n    FILE *calls = fopen(names[count - 1], \"rb\");\n");
    for name in names {
        let _ = writeln!(
            text,
            "    rewind(calls);\n    if (fread(&start, 8, 1, calls) == 1) {{\n        run_{name}(calls);\n    }}"
        );
    }
    text.push_str("    return 0;\n}\n");
    text
}

const RUN: &str = r"
static void run_NAME(FILE *calls)
{
    NAME_state state;
    memset(&state, 0, sizeof state);
    NAME_rest(&state, (NUMBER)start);
    outcome[0] = (double)state.force_n;
    fwrite(outcome, 8, 3, stdout);
    while (fread(call, 8, 3, calls) == 3) {
        NUMBER force;
        memcpy(before, &state, sizeof state);
        force = call[0] != 0.0 ? NAME_step_to(&state, (NUMBER)call[1], (NUMBER)call[2])
                               : NAME_step(&state, (NUMBER)call[1], (NUMBER)call[2]);
        outcome[0] = (double)force;
        outcome[1] = (double)state.position_m;
        outcome[2] = memcmp(before, &state, sizeof state) != 0 || outcome[0] != (double)state.force_n ? 1.0 : 0.0;
        fwrite(outcome, 8, 3, stdout);
    }
}
";

/// Runs `program` over `calls`; returns one row of results for each of `models` models, beginning
/// with the initial state.
fn run_c(program: &Path, start: f64, calls: &[Call], models: usize) -> Vec<Vec<Outcome>> {
    run_by(Command::new(program), program, start, calls, models)
}

/// The same by `command`, which runs `program`.
fn run_by(
    mut command: Command,
    program: &Path,
    start: f64,
    calls: &[Call],
    models: usize,
) -> Vec<Vec<Outcome>> {
    let path = program.with_extension("calls");
    let mut file = fs::File::create(&path).unwrap();
    let numbers =
        calls.iter().flat_map(|call| [f64::from(u8::from(call.to)), call.way, call.duration]);
    let bytes: Vec<u8> = [start].into_iter().chain(numbers).flat_map(f64::to_ne_bytes).collect();
    file.write_all(&bytes).unwrap();
    let output = command.arg(&path).stderr(Stdio::piped()).output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && errors.is_empty(), "{errors}");
    let number = |bytes: &[u8]| f64::from_ne_bytes(bytes.try_into().unwrap());
    let outcome = |bytes: &[u8]| Outcome {
        force: number(&bytes[..8]),
        position: number(&bytes[8..16]),
        touched: number(&bytes[16..]) != 0.0,
    };
    let outcomes: Vec<Outcome> = output.stdout.chunks_exact(24).map(outcome).collect();
    let rows: Vec<Vec<Outcome>> =
        outcomes.chunks(calls.len() + 1).map(<[Outcome]>::to_vec).collect();
    assert_eq!(rows.len(), models);
    rows
}

/// Compares one model with the library; returns the largest difference as in [`TOLERANCE`] and the
/// number of steps with different bits.
fn compare(
    name: &str,
    model: &ModelFile,
    start: f64,
    calls: &[Call],
    outcomes: &[Outcome],
) -> (f64, usize) {
    let trocar = model.trocar.borrowed();
    let mut state = trocar.rest(start);
    let (mut largest, mut unequal) = (0.0_f64, 0);
    let mut see = |force: f64, outcome: &Outcome, k: usize| {
        let difference = (force - outcome.force).abs() / force.abs().max(1.0);
        assert!(
            difference <= TOLERANCE,
            "{name}, step {k}: library {force:e}, C {:e}",
            outcome.force
        );
        largest = largest.max(difference);
        unequal += usize::from(force != outcome.force);
    };
    see(state.force(), &outcomes[0], 0);
    for (k, (call, outcome)) in calls.iter().zip(&outcomes[1..]).enumerate() {
        let refused = is_refused(*call, state.position());
        let force = match call.to {
            true => trocar.step_to(&mut state, call.way, call.duration),
            false => trocar.step(&mut state, call.way, call.duration),
        };
        see(force, outcome, k + 1);
        assert!(outcome.position == state.position(), "{name}, step {}: position", k + 1);
        assert!(!(refused && outcome.touched), "{name}, step {}: the state changed", k + 1);
    }
    (largest, unequal)
}

#[test]
fn c_gives_the_forces_of_the_library() {
    if !has_gcc() {
        return;
    }
    let models = [conformance_models(), random_models(), classical_models()].concat();
    let folder = tempfile::tempdir().unwrap();
    for (name, model) in &models {
        store(model, folder.path(), name);
    }
    let names: Vec<String> = models.iter().map(|(name, _)| name.clone()).collect();
    fs::write(folder.path().join("driver.c"), driver(&names, "double")).unwrap();
    gcc(folder.path(), &["-O2", "-Werror", "driver.c", "-o", "fast", "-lm"]);
    gcc(
        folder.path(),
        &[
            "-O1",
            "-fsanitize=undefined",
            "-fno-sanitize-recover",
            "driver.c",
            "-o",
            "checked",
            "-lm",
        ],
    );
    let (start, recorded) = conformance_motion();
    let adversarial = adversarial_motion();
    assert!(adversarial.iter().filter(|call| is_refused(**call, 0.0)).count() > STEPS / 200);
    for (motion, start, calls) in
        [("conformance", start, &recorded), ("adversarial", 0.05, &adversarial)]
    {
        for program in ["fast", "checked"] {
            let rows = run_c(&folder.path().join(program), start, calls, models.len());
            for ((name, model), outcomes) in models.iter().zip(&rows) {
                let (largest, unequal) = compare(name, model, start, calls, outcomes);
                println!(
                    "{motion:12} {program:8} {name:15} largest {largest:.1e}, not the same {unequal} of {}",
                    calls.len()
                );
            }
        }
    }
}

/// Also for an initial value that is not a number, which counts as 0.
#[test]
fn each_file_stands_alone_without_a_hosted_compiler() {
    if !has_gcc() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for (name, model) in conformance_models() {
        store(&model, folder.path(), "seal_2");
        let object = format!("{name}.o");
        gcc(folder.path(), &["-O2", "-Werror", "-ffreestanding", "-c", "seal_2.c", "-o", &object]);
    }
    let user = "#include \"seal_2.h\"\n#include \"seal_2.h\"\nint main(void)\n{\n    \
                seal_2_state state;\n    seal_2_rest(&state, 0.0 / 0.0);\n    return state.position_m != 0.0;\n}\n";
    fs::write(folder.path().join("user.c"), user).unwrap();
    gcc(folder.path(), &["-Werror", "user.c", "static.o", "-o", "user", "-lm"]);
    assert!(Command::new(folder.path().join("user")).status().unwrap().success());
}

/// Arithmetic without IEEE rules would silently give wrong forces; only the header may be included
/// with it.
#[test]
fn fast_math_does_not_compile() {
    if !has_gcc() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for (name, model) in conformance_models() {
        store(&model, folder.path(), "p");
        for flag in ["-ffast-math", "-Ofast", "-ffinite-math-only", "-funsafe-math-optimizations"] {
            let mut command = Command::new("gcc");
            command.current_dir(folder.path()).args([flag, "-fsyntax-only", "p.c"]);
            let output = command.output().unwrap();
            let errors = String::from_utf8_lossy(&output.stderr);
            assert!(
                !output.status.success() && errors.contains("without -ffast-math"),
                "{name} {flag}: {errors}"
            );
        }
        gcc(folder.path(), &["-Werror", "-ffast-math", "-fsyntax-only", "p.h"]);
    }
}

#[test]
fn only_what_a_model_needs_is_written() {
    let files = |name: &str| {
        let path = repository().join(format!("conformance/models/{name}.json"));
        from_file(&path, COptions { stem: "seal", ..options("p") }).unwrap()
    };
    let text = |name: &str| files(name).source;
    let plain = text("ems");
    for part in ["find_root", "creep", "arm", "stribeck", "travel", "knots", "seal_damping", "sqrt"]
    {
        assert!(!plain.contains(part), "{part}");
    }
    assert!(!text("maxwell_slip").contains("decay") && !text("ems_stribeck").contains("log1p"));
    assert!(text("ems_slow").contains("find_root") && text("ems_profile").contains("p_knots"));
    for (name, _) in conformance_models() {
        let CFiles { header, source } = files(&name);
        for text in [&header, &source] {
            assert!(!text.contains('@') && !text.contains("trocar_"), "{name}");
            assert!(
                text.contains("Not a medical device")
                    && text.contains(&format!("{name}.json, SHA-256 ")),
                "{name}"
            );
            assert!(text.lines().all(|line| line.len() <= 120), "{name}");
        }
        let includes = |text: &str| -> Vec<String> {
            text.lines()
                .filter_map(|line| line.strip_prefix("#include ").map(str::to_owned))
                .collect()
        };
        assert!(includes(&header).is_empty(), "{name}");
        let needs_bits = source.contains("uint64_t");
        let own = ["\"seal.h\"", "<math.h>", "<stdint.h>"];
        assert_eq!(includes(&source), own[..2 + usize::from(needs_bits)], "{name}");
        // Nothing but the step functions is visible to the linker.
        let is_open = |line: &&str| line.starts_with("void p_") || line.starts_with("double p_");
        let open: Vec<&str> = source.lines().filter(is_open).collect();
        assert_eq!(open.len(), 3, "{name}: {open:?}");
    }
}

#[test]
fn what_makes_no_names_is_refused() {
    for prefix in ["", "9a", "_a", "a-b", "a b", "ä", "abcdefghijklmnopqrstu"] {
        assert!(matches!(check_prefix(prefix), Err(CError::Prefix { .. })), "{prefix}");
    }
    for prefix in ["t", "int", "Trocar_2", "abcdefghijklmnopqrst"] {
        assert!(check_prefix(prefix).is_ok(), "{prefix}");
    }
    let missing = from_file(Path::new("missing.json"), options("p")).unwrap_err().to_string();
    assert!(missing.starts_with("missing.json: cannot read the model"), "{missing}");
    for path in ["seal", "seal.h", "-", ".c", "a\"b.c", "a\\b.c", "a\nb.c", "folder/"] {
        let refused = stem(Path::new(path)).unwrap_err().to_string();
        assert!(refused.contains("must be named NAME.c"), "{path:?}: {refused}");
    }
    assert_eq!(stem(Path::new("folder/my-seal 2.v1.c")).unwrap(), "my-seal 2.v1");
}

/// Any names and notes of a model are safe inside a comment.
#[test]
fn a_note_cannot_become_code() {
    let mut model = ModelFile::plausible_10_5_mm().unwrap();
    model.origin.note = Some("*/ #error /* \\\n@TITLE@ trocar_x \u{202e}".to_owned());
    let files = write(&model, "*/", options("p")).unwrap();
    for text in [&files.header, &files.source] {
        assert_eq!(text.matches("/*").count(), text.matches("*/").count());
    }
    if has_gcc() {
        let folder = tempfile::tempdir().unwrap();
        files.store(&folder.path().join("p.c")).unwrap();
        gcc(folder.path(), &["-Werror", "-c", "p.c"]);
    }
}

/// Sizes and speed for the documentation: `cargo test --release -p trocar --test all export_c:: --
/// --ignored --nocapture`
#[test]
#[ignore = "prints figures, checks nothing"]
fn sizes_and_speed() {
    if !has_gcc() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (start, calls) = conformance_motion();
    let plausible = ("plausible".to_owned(), ModelFile::plausible_10_5_mm().unwrap());
    println!(
        "| model | lines | code and constants, -Os, B | state, B | step, -O2, ns | library, ns |"
    );
    for (name, model) in [plausible].into_iter().chain(conformance_models()) {
        let text = store(&model, folder.path(), "p").source;
        fs::write(folder.path().join("speed.c"), SPEED).unwrap();
        gcc(folder.path(), &["-Os", "-c", "p.c", "-o", "p.o"]);
        gcc(folder.path(), &["-O2", "speed.c", "-o", "speed", "-lm"]);
        let bytes = builds::size(folder.path(), "size", "p.o");
        let numbers = calls.iter().flat_map(|call| [call.way, call.duration]);
        let input: Vec<u8> =
            [start].into_iter().chain(numbers).flat_map(f64::to_ne_bytes).collect();
        fs::write(folder.path().join("calls"), input).unwrap();
        let run =
            Command::new(folder.path().join("speed")).current_dir(folder.path()).output().unwrap();
        let seen = String::from_utf8(run.stdout).unwrap();
        let (state, nanoseconds) = seen.trim().split_once(' ').unwrap();
        let own = library_speed(&model, start, &calls);
        let lines = text.lines().count();
        println!("| {name} | {lines} | {bytes} | {state} | {nanoseconds} | {own:.1} |");
    }
    if !builds::has(builds::ARM) {
        return;
    }
    println!("| model | Cortex-M4F, single precision, B | double precision in software, B |");
    for (name, model) in conformance_models() {
        let size = |precision| {
            store_as(&model, folder.path(), COptions { precision, ..options("p") });
            builds::for_cortex_m4f(folder.path(), "p")
        };
        let (single, double) = (size(Precision::Single), size(Precision::Double));
        println!("| {name} | {single} | {double} |");
    }
}

/// Nanoseconds of one step of the library, the minimum of a hundred runs.
fn library_speed(model: &ModelFile, start: f64, calls: &[Call]) -> f64 {
    let trocar = model.trocar.borrowed();
    let run = || {
        let begin = std::time::Instant::now();
        let mut state = trocar.rest(start);
        for call in calls {
            std::hint::black_box(trocar.step_to(&mut state, call.way, call.duration));
        }
        begin.elapsed().as_secs_f64()
    };
    1e9 * (0..100).map(|_| run()).fold(f64::INFINITY, f64::min) / calls.len() as f64
}

/// Prints the size of the state and the nanoseconds of one step, the minimum of a hundred runs.
const SPEED: &str = r#"
#include <stdio.h>
#include <time.h>
#include "p.c"
static double calls[10000];
int main(void)
{
    FILE *file = fopen("calls", "rb");
    const int count = (int)fread(calls, 8, 10000, file) / 2;
    volatile double force;
    double least = 1e9;
    int run, k;
    for (run = 0; run < 100; ++run) {
        p_state state;
        clock_t begin = clock();
        double seconds;
        int again;
        for (again = 0; again < 20; ++again) {
            p_rest(&state, calls[0]);
            for (k = 0; k < count; ++k) {
                force = p_step_to(&state, calls[1 + 2 * k], calls[2 + 2 * k]);
            }
        }
        seconds = (double)(clock() - begin) / CLOCKS_PER_SEC / 20.0;
        least = seconds < least ? seconds : least;
    }
    (void)force;
    printf("%d %.1f\n", (int)sizeof(p_state), least / count * 1e9);
    return 0;
}
"#;

/// The C code is a port: each template and the Rust code that it follows, with the checksum of that
/// code when the two were last compared. After a change of the Rust code compare the template with
/// it, run `conformance/check`, and set the new checksum.
const PORTS: [(&str, &[&str], u64); 12] = [
    (
        "ems*.c",
        &[
            "ems.rs",
            "slip.rs",
            "exponential.rs",
            "elastic.rs",
            "creep.rs",
            "dwell.rs",
            "relaxation.rs",
            "damping.rs",
            "parallel.rs",
            "rotation.rs",
            "slip/turn.rs",
        ],
        0x06ec_3f88_2772_2fe7,
    ),
    ("sliding.c", &["sliding.rs"], 0xa79efc217549c50d),
    ("static.c", &["classical/stribeck.rs"], 0xdd51_7100_d98d_f7d2),
    ("dahl.c", &["classical/dahl.rs"], 0x39a6_2927_6206_593e),
    ("bouc_wen.c", &["classical/bouc_wen.rs", "classical/chord.rs"], 0x8367_90c5_235b_e086),
    ("lugre.c", &["classical/lugre.rs"], 0x187b_1f11_2a94_23c3),
    ("leuven.c", &["classical/leuven.rs", "classical/chord.rs"], 0xd658_005b_8b34_5e81),
    ("maxwell_slip.c", &["classical/maxwell_slip.rs"], 0xa3a6_bfdf_bd75_cc1e),
    ("gms.c", &["classical/gms.rs"], 0xd306_cdeb_b106_11f5),
    ("public.c", &["seal.rs", "profile.rs"], 0x12ca_5afb_a012_f433),
    ("arithmetic.c", &["friction.rs"], 0xdb70_bcb8_6e32_b9a8),
    (
        "compensator.c",
        &[
            "partial.rs",
            "../../trocar-runtime/src/compensate.rs",
            "../../trocar-runtime/src/compensate/adapt.rs",
            "../../trocar-runtime/src/compensate/bank.rs",
            "../../trocar-runtime/src/compensate/faults.rs",
            "../../trocar-runtime/src/compensate/inertia.rs",
            "../../trocar-runtime/src/compensate/sign.rs",
        ],
        0x63b2_a36b_b5c5_76b7,
    ),
];

/// FNV-1a over the code without comments, blanks and unit tests.
fn checksum(files: &[&str]) -> u64 {
    let folder = repository().join("crates/trocar-model/src");
    let text: String = files
        .iter()
        .map(|file| fs::read_to_string(folder.join(file)).unwrap())
        .map(|text| {
            let own = text.split("#[cfg(test)]\nmod tests {").next().unwrap().to_owned();
            own.lines().map(|line| line.split("//").next().unwrap_or_default()).collect::<String>()
        })
        .collect();
    let bytes = text.bytes().filter(|byte| !byte.is_ascii_whitespace());
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

#[test]
fn the_c_code_was_compared_with_the_rust_code_that_it_follows() {
    let changed = PORTS.iter().filter(|(_, files, known)| checksum(files) != *known);
    let changed: Vec<String> = changed
        .map(|(template, files, _)| format!("{template} follows {files:?}: {:#x}", checksum(files)))
        .collect();
    assert!(changed.is_empty(), "changed since the comparison:\n{}", changed.join("\n"));
}
