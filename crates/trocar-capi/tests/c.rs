//! Programs in C and C++ against the installed library: they compile without a warning, and give
//! the numbers of Rust.
#![cfg(unix)]

use std::collections::BTreeSet;
use std::fs;
use std::mem::offset_of;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use skipped::skipped;
use trocar::compensate::{CompensateOptions, Compensator};
use trocar::model_file::{ModelFile, VERSION};
use trocar_c::{CompensatorOptions, Drift, Estimate, Fault, State, Status, Tunable};
use trocar_model::Rotation;

#[path = "../../trocar-model/tests/common/skipped.rs"]
mod skipped;

/// Where the library was installed, and a folder for programs.
struct Installed {
    prefix: PathBuf,
    programs: PathBuf,
    _folder: tempfile::TempDir,
}

#[derive(Clone, Copy, PartialEq)]
enum Link {
    Shared,
    Static,
}

fn here(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

fn conformance(path: &str) -> PathBuf {
    here("../../conformance").join(path)
}

/// Whether `tool` is there; where not, the test is skipped, or fails if it is `needed` by the
/// continuous integration.
fn has(tool: &str, needed: bool) -> bool {
    let found = Command::new(tool).arg("--version").output().is_ok_and(|ran| ran.status.success());
    if !found {
        skipped(&format!("no {tool}"));
        assert!(!needed || std::env::var("CI").as_deref() != Ok("true"), "CI has no {tool}");
    }
    found
}

/// The library that cargo built for this test, installed by the script that users run.
fn installed() -> &'static Installed {
    static INSTALLED: OnceLock<Installed> = OnceLock::new();
    INSTALLED.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let test = std::env::current_exe().unwrap();
        let (prefix, programs) = (folder.path().join("prefix"), folder.path().join("programs"));
        fs::create_dir(&programs).unwrap();
        done(Command::new(here("install")).arg(&prefix).arg("--from").arg(test.parent().unwrap()));
        Installed { prefix, programs, _folder: folder }
    })
}

fn done(command: &mut Command) -> Output {
    let ran = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let (out, err) = (String::from_utf8_lossy(&ran.stdout), String::from_utf8_lossy(&ran.stderr));
    assert!(ran.status.success(), "{command:?}\n{}\n{out}{err}", ran.status);
    ran
}

fn words_of(output: &[u8]) -> Vec<String> {
    String::from_utf8_lossy(output).split_whitespace().map(ToOwned::to_owned).collect()
}

/// What the installed pkg-config file says about linking the static library.
fn static_libraries(prefix: &Path) -> Vec<String> {
    let text = fs::read_to_string(prefix.join("lib/pkgconfig/trocar-static.pc")).unwrap();
    let line =
        text.lines().find_map(|line| line.strip_prefix("Libs: ${libdir}/libtrocar_c.a")).unwrap();
    words_of(line.as_bytes())
}

/// Compiles a program of this crate; a warning is an error.
fn compiled(source: &str, link: Link, more: &[&str]) -> PathBuf {
    let Installed { prefix, programs, .. } = installed();
    let is_c = source.ends_with(".c");
    let name = format!(
        "{}{}{}",
        source.replace(['/', '.'], "_"),
        link as u8,
        more.concat().replace(['/', ' '], "_")
    );
    let program = programs.join(name);
    let mut command = Command::new(if is_c { "gcc" } else { "g++" });
    command.args([
        if is_c { "-std=c99" } else { "-std=c++17" },
        "-O1",
        "-Wall",
        "-Wextra",
        "-Wpedantic",
        "-Werror",
    ]);
    // A joined absolute path is that path.
    command
        .args(more)
        .arg("-I")
        .arg(prefix.join("include"))
        .arg(here(source))
        .arg("-o")
        .arg(&program);
    let lib = prefix.join("lib");
    match link {
        Link::Shared => {
            command
                .arg("-L")
                .arg(&lib)
                .arg("-ltrocar_c")
                .arg(format!("-Wl,-rpath,{}", lib.display()));
        }
        Link::Static => {
            command.arg(lib.join("libtrocar_c.a")).args(static_libraries(prefix));
        }
    }
    done(command.args(["-lpthread", "-lm"]));
    program
}

fn compilers() -> bool {
    has("gcc", true) && has("g++", true)
}

fn models() -> Vec<PathBuf> {
    let mut files: Vec<_> =
        fs::read_dir(conformance("models")).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    assert!(files.len() >= 14, "{} models", files.len());
    files
}

/// Forces of the Rust core along the motion for all programs.
fn reference(model: &Path) -> Vec<u64> {
    let file = ModelFile::read(model).unwrap();
    let trocar = file.trocar.borrowed();
    let motion = fs::read_to_string(conformance("motion.csv")).unwrap();
    let row = |line: &str| {
        let (time, position) = line.split_once(',').unwrap();
        (time.parse::<f64>().unwrap(), position.parse::<f64>().unwrap())
    };
    let rows: Vec<_> = motion.lines().skip(1).map(row).collect();
    let mut state = trocar.rest(rows[0].1);
    let first = [state.force().to_bits()];
    let steps = rows
        .windows(2)
        .map(|pair| trocar.step_to(&mut state, pair[1].1, pair[1].0 - pair[0].0).to_bits());
    first.into_iter().chain(steps).collect()
}

#[test]
fn every_model_gives_the_forces_of_rust_to_the_last_bit() {
    if !compilers() {
        return;
    }
    let (c, cpp) = ("examples/c/drive.c", "examples/cpp/drive.cpp");
    let drivers = [
        (compiled(c, Link::Shared, &[]), "steps"),
        (compiled(c, Link::Static, &[]), "array"),
        (compiled(cpp, Link::Shared, &[]), ""),
        (compiled(cpp, Link::Static, &[]), ""),
    ];
    for model in models() {
        let expected = reference(&model);
        for (driver, mode) in &drivers {
            let mut command = Command::new(driver);
            command
                .arg(&model)
                .arg(conformance("motion.csv"))
                .args((!mode.is_empty()).then_some(mode));
            let forces: Vec<u64> = words_of(&done(&mut command).stdout)
                .iter()
                .map(|word| word.parse::<f64>().unwrap().to_bits())
                .collect();
            assert_eq!(forces.len(), expected.len());
            let apart = forces.iter().zip(&expected).position(|(a, b)| a != b);
            assert_eq!(apart, None, "{command:?}: first row apart");
        }
    }
}

/// Error of the model's force, moving mass and limit of the sensor that the observers are given.
const OBSERVER: [&str; 3] = ["0.05", "0.04", "12"];

/// Readings along the motion for all programs, with what goes wrong with sensors: time_s,
/// position_m, force_n.
///
/// A sensor of 20 mN noise behind a seal whose friction falls to 0.6 of the model's, a tissue below
/// half depth, dropouts of either quantity, a frozen and a saturated reading, an encoder that
/// jumps.
fn readings(model: &Path) -> Vec<[f64; 3]> {
    let forces: Vec<f64> = reference(model).into_iter().map(f64::from_bits).collect();
    let motion = fs::read_to_string(conformance("motion.csv")).unwrap();
    let mut seed = 7_u64;
    let mut held = 0.0;
    let row = |(k, line): (usize, &str)| {
        let (time, position) = line.split_once(',').unwrap();
        let (time, position): (f64, f64) = (time.parse().unwrap(), position.parse().unwrap());
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let noise = 0.02 * ((seed >> 33) as f64 / f64::from(1_u32 << 31) - 0.5);
        let wet = if k < 2000 { 1.0 } else { 0.6 };
        let tissue = if (500..700).contains(&(k % 1000)) { 1.5 } else { 0.0 };
        let force = wet * forces[k] + tissue + noise;
        held = if k % 1000 == 300 { force } else { held };
        match k {
            k if (300..400).contains(&(k % 1000)) => [time, position, held],
            k if k % 271 < 3 => [time, position, f64::NAN],
            k if k % 431 == 5 => [time, f64::NAN, force],
            k if k % 1499 == 9 => [time, position + 0.5, force],
            k if k % 613 == 5 => [time, position, 12.5],
            _ => [time, position, force],
        }
    };
    motion.lines().skip(1).enumerate().map(row).collect()
}

/// What the Rust observer says to them: numbers bit by bit, adapting, fault.
fn observed(model: &Path, readings: &[[f64; 3]]) -> Vec<([u64; 3], bool, i32)> {
    let [error, mass, limit] = OBSERVER.map(|number| Some(number.parse().unwrap()));
    let options = CompensateOptions {
        force_error_n: error,
        moving_mass_kg: mass,
        sensor_limit_n: limit,
        ..CompensateOptions::default()
    };
    let mut observer = Compensator::new(&ModelFile::read(model).unwrap(), &options).unwrap();
    let mut before = readings[0][0];
    let answer = |[time, position, force]: &[f64; 3]| {
        let said = observer.step(*position, *force, time - before);
        before = *time;
        let numbers = [said.trocar_force, said.tissue_force, said.std].map(bits);
        (numbers, said.adapting, Fault::from(said.fault) as i32)
    };
    readings.iter().map(answer).collect()
}

/// Of a number; all NaN are one, for text does not tell them apart.
fn bits(number: f64) -> u64 {
    if number.is_nan() { f64::NAN.to_bits() } else { number.to_bits() }
}

#[test]
fn the_observer_says_what_that_of_rust_says_to_the_last_bit() {
    if !compilers() {
        return;
    }
    let drivers =
        [("examples/c/compensate.c", Link::Shared), ("examples/cpp/compensate.cpp", Link::Static)]
            .map(|(source, link)| compiled(source, link, &[]));
    let mut faults = BTreeSet::new();
    for model in models() {
        let readings = readings(&model);
        let expected = observed(&model, &readings);
        faults.extend(expected.iter().map(|(_, _, fault)| *fault));
        let rows: Vec<String> = readings.iter().map(|[t, x, y]| format!("{t},{x},{y}")).collect();
        let file = installed().programs.join("readings.csv");
        fs::write(&file, format!("time_s,position_m,force_n\n{}\n", rows.join("\n"))).unwrap();
        for driver in &drivers {
            let said = done(Command::new(driver).args([&model, &file]).args(OBSERVER)).stdout;
            let row = |line: String| {
                let cells: Vec<&str> = line.split(',').collect();
                let number = |k: usize| bits(cells[k].parse().unwrap());
                ([number(0), number(1), number(2)], cells[3] == "1", cells[4].parse().unwrap())
            };
            let said: Vec<_> = words_of(&said).into_iter().map(row).collect();
            assert_eq!(said.len(), expected.len());
            let apart = said.iter().zip(&expected).position(|(a, b)| a != b);
            assert_eq!(apart, None, "{} {}: first row apart", driver.display(), model.display());
        }
    }
    assert_eq!(faults.len(), 8, "the readings have only the faults {faults:?}");
}

#[test]
fn the_observer_refuses_and_goes_on() {
    if !compilers() {
        return;
    }
    let model = conformance("models/ems.json");
    for link in [Link::Shared, Link::Static] {
        done(Command::new(compiled("tests/c/compensator.c", link, &[])).arg(&model));
    }
    if has("valgrind", false) {
        let program = compiled("tests/c/compensator.c", Link::Shared, &["-g"]);
        let mut command = Command::new("valgrind");
        command
            .args(["--quiet", "--error-exitcode=9", "--leak-check=full"])
            .arg(program)
            .arg(&model);
        done(&mut command);
    }
}

#[test]
fn the_loops_run_and_agree() {
    if !compilers() {
        return;
    }
    let (c, cpp) = ("examples/c/loop.c", "examples/cpp/loop.cpp");
    let programs = [(c, Link::Shared), (c, Link::Static), (cpp, Link::Shared), (cpp, Link::Static)];
    let outputs: Vec<String> = programs
        .iter()
        .map(|(source, link)| {
            String::from_utf8(done(&mut Command::new(compiled(source, *link, &[]))).stdout).unwrap()
        })
        .collect();
    // F_c + beta·v of the made-up trocar at 40 mm/s, then F_c held.
    assert!(
        outputs[0].contains("1000 ms   140.0 mm    3.200 N")
            && outputs[0].contains("2000 ms   140.0 mm    3.000 N")
    );
    assert!(outputs.iter().all(|output| *output == outputs[0]), "{outputs:?}");

    let mut wrong = Command::new(compiled(c, Link::Shared, &[]));
    let refused = wrong.arg(here("Cargo.toml")).output().unwrap();
    let errors = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(
        refused.status.code() == Some(1) && errors.contains("Cargo.toml: line 1 column"),
        "{errors}"
    );
}

#[test]
fn the_code_of_the_documentation_compiles_and_runs() {
    if !compilers() {
        return;
    }
    let text = fs::read_to_string(here("../../docs/reference/c-and-cpp.md")).unwrap();
    let folder = &installed().programs;
    fs::copy(conformance("models/ems.json"), folder.join("model.json")).unwrap();
    let mut run = 0;
    for language in ["c", "cpp"] {
        for part in text.split(&format!("```{language}\n")).skip(1) {
            let source = folder.join(format!("documentation{run}.{language}"));
            fs::write(&source, part.split_once("```").unwrap().0).unwrap();
            let program = compiled(source.to_str().unwrap(), Link::Shared, &[]);
            let ran = done(Command::new(program).current_dir(folder));
            // The third is the observer: 4.2 N read, 3.2 N taken by the trocar.
            assert_eq!(words_of(&ran.stdout), [if run < 2 { "3.200" } else { "1.000" }, "N"]);
            run += 1;
        }
    }
    assert_eq!(run, 3);
}

/// A model file of a version that does not exist yet.
fn newer_model() -> PathBuf {
    let text = fs::read_to_string(conformance("models/ems.json")).unwrap();
    let path = installed().programs.join("newer.json");
    fs::write(&path, text.replacen(&format!("\"version\": {VERSION}"), "\"version\": 99", 1))
        .unwrap();
    path
}

#[test]
fn faults_of_the_caller_are_reported_and_harm_nothing() {
    if !compilers() {
        return;
    }
    for link in [Link::Shared, Link::Static] {
        done(Command::new(compiled("tests/c/faults.c", link, &[])).arg(newer_model()));
    }
    if has("valgrind", false) {
        let program = compiled("tests/c/faults.c", Link::Shared, &["-g"]);
        let mut command = Command::new("valgrind");
        command
            .args(["--quiet", "--error-exitcode=9", "--leak-check=full"])
            .arg(program)
            .arg(newer_model());
        done(&mut command);
    }
}

#[test]
fn an_instrument_turns_as_in_rust() {
    if !compilers() {
        return;
    }
    let path = conformance("models/ems_stages.json");
    let rotation = Rotation {
        shaft_radius: 5e-3,
        circumferential_stiffness: 425.0,
        circumferential_ratio: 0.8,
    };
    let mut model = ModelFile::read(&path).unwrap();
    model.trocar = model.trocar.with_rotation(Some(rotation)).unwrap();
    let turning = installed().programs.join("turning.json");
    fs::write(&turning, model.to_json()).unwrap();
    let program = compiled("tests/c/turning.c", Link::Static, &[]);
    let output = done(Command::new(program).args([&turning, &path]));
    let mut state = model.trocar.rest(0.0);
    let mut lines = 0;
    for (k, line) in (1..).zip(String::from_utf8_lossy(&output.stdout).lines()) {
        let k = f64::from(k);
        let force = model.trocar.turn_to(&mut state, 2e-5 * k, 6.25e-3 * k, 1e-3);
        let numbers: Vec<f64> = line.split(' ').map(|word| word.parse().unwrap()).collect();
        assert_eq!(numbers, [force, state.torque()], "step {k}");
        lines += 1;
    }
    assert_eq!(lines, 1000);
}

#[test]
fn threads_share_a_model_and_a_shared_state_is_refused() {
    if !compilers() {
        return;
    }
    let program = compiled("tests/c/threads.c", Link::Shared, &[]);
    for model in ["ems", "ems_stages", "ems_profile", "gms"] {
        done(Command::new(&program).arg(conformance(&format!("models/{model}.json"))));
    }
}

#[test]
#[cfg(target_os = "linux")]
fn nothing_allocates_after_loading() {
    if !compilers() {
        return;
    }
    let wrap = ["malloc", "calloc", "realloc", "posix_memalign", "free"]
        .map(|name| format!("-Wl,--wrap={name}"));
    let program =
        compiled("tests/c/allocation.c", Link::Static, &wrap.each_ref().map(String::as_str));
    done(Command::new(program).args(models()));
}

#[test]
fn the_cpp_wrapper_owns_refuses_tunes_and_saves() {
    if !compilers() {
        return;
    }
    for (link, more) in
        [(Link::Shared, vec![]), (Link::Static, vec!["-fno-exceptions", "-fno-rtti"])]
    {
        let program = compiled("tests/cpp/wrapper.cpp", link, &more);
        done(Command::new(program).arg(conformance("models/ems_stribeck.json")));
    }
}

#[test]
fn c_and_rust_lay_out_alike() {
    if !compilers() {
        return;
    }
    let program = compiled("tests/c/layout.c", Link::Shared, &["-std=c11"]);
    let expected = [
        size_of::<State>(),
        size_of::<Status>(),
        size_of::<Tunable>(),
        offset_of!(Tunable, description),
        offset_of!(Tunable, value),
        offset_of!(Tunable, least),
        offset_of!(Tunable, above_least),
        offset_of!(Tunable, element),
        size_of::<CompensatorOptions>(),
        offset_of!(CompensatorOptions, adaptation),
        offset_of!(CompensatorOptions, flip_force),
        size_of::<Estimate>(),
        offset_of!(Estimate, adapting),
        offset_of!(Estimate, fault),
        size_of::<Drift>(),
    ];
    let found: Vec<usize> = words_of(&done(&mut Command::new(program)).stdout)
        .iter()
        .map(|word| word.parse().unwrap())
        .collect();
    assert_eq!(found, expected);
}

#[test]
#[cfg(target_os = "linux")]
fn the_library_exports_the_functions_of_the_header_and_no_other() {
    if !has("nm", true) || !has("readelf", true) {
        return;
    }
    let library = installed().prefix.join("lib/libtrocar_c.so");
    let listed = done(Command::new("nm").args(["-D", "--defined-only"]).arg(&library));
    let exported: BTreeSet<String> = String::from_utf8_lossy(&listed.stdout)
        .lines()
        .filter_map(|line| line.split(' ').nth(2).map(str::to_owned))
        .collect();
    let header = fs::read_to_string(here("include/trocar.h")).unwrap();
    let declared: BTreeSet<String> = header
        .lines()
        .filter(|line| !line.starts_with([' ', '#', '/']))
        .filter_map(|line| {
            line.split_once('(').and_then(|(start, _)| start.rsplit([' ', '*']).next())
        })
        .filter(|name| name.starts_with("trocar_"))
        .map(str::to_owned)
        .collect();
    assert!(declared.len() > 20);
    assert_eq!(exported, declared);
    let dynamic = done(Command::new("readelf").arg("-d").arg(&library));
    let soname = format!("[libtrocar_c.so.{}]", trocar_c::ABI_VERSION);
    assert!(String::from_utf8_lossy(&dynamic.stdout).contains(&soname), "no {soname}");
}

/// Nothing is installed if `strip` fails, and the message says so.
#[test]
fn a_failed_strip_stops_the_installation() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = tempfile::tempdir().unwrap();
    let (strip, prefix) = (folder.path().join("strip"), folder.path().join("prefix"));
    fs::write(&strip, "#!/bin/sh\nexit 1\n").unwrap();
    fs::set_permissions(&strip, fs::Permissions::from_mode(0o755)).unwrap();
    let mut path = folder.path().as_os_str().to_owned();
    path.push(":");
    path.push(std::env::var_os("PATH").unwrap_or_default());
    let test = std::env::current_exe().unwrap();
    let mut install = Command::new(here("install"));
    install.arg(&prefix).arg("--from").arg(test.parent().unwrap()).env("PATH", path);
    let ran = install.output().unwrap();
    let message = String::from_utf8_lossy(&ran.stderr);
    assert!(!ran.status.success() && message.contains("install: strip failed on"), "{message}");
    assert!(!prefix.exists());
}

#[test]
fn pkg_config_knows_both_libraries() {
    if !compilers() || !has("pkg-config", false) {
        return;
    }
    let Installed { prefix, programs, .. } = installed();
    for (package, run_path) in [("trocar", true), ("trocar-static", false)] {
        let mut ask = Command::new("pkg-config");
        ask.env("PKG_CONFIG_PATH", prefix.join("lib/pkgconfig"))
            .args(["--cflags", "--libs", package]);
        let flags = words_of(&done(&mut ask).stdout);
        let program = programs.join(format!("by_{package}"));
        let mut build = Command::new("gcc");
        build.arg("-std=c99").arg(here("examples/c/loop.c")).arg("-o").arg(&program).args(flags);
        if run_path {
            build.arg(format!("-Wl,-rpath,{}", prefix.join("lib").display()));
        }
        done(&mut build);
        done(&mut Command::new(program));
    }
}

/// CMake as installed, or one of our own in the target folder.
fn cmake() -> Option<PathBuf> {
    if Command::new("cmake").arg("--version").output().is_ok_and(|ran| ran.status.success()) {
        return Some("cmake".into());
    }
    // <target>/<profile>/deps/<this test>
    let test = std::env::current_exe().unwrap();
    let folder = test.ancestors().nth(3)?.join("cmake-venv");
    let program = folder.join("bin/cmake");
    if !program.exists() {
        let made = Command::new("python3").args(["-m", "venv"]).arg(&folder).output();
        let mut pip = Command::new(folder.join("bin/python"));
        pip.args([
            "-m",
            "pip",
            "install",
            "--quiet",
            "--disable-pip-version-check",
            "cmake==3.31.6",
        ]);
        let ready = made.is_ok_and(|ran| ran.status.success())
            && pip.output().is_ok_and(|ran| ran.status.success());
        if !ready {
            skipped("no cmake, and no way to install it by python3 -m venv and pip");
            return None;
        }
    }
    Some(program)
}

#[test]
fn cmake_finds_both_libraries() {
    if !compilers() || !has("make", true) {
        return;
    }
    let Some(cmake) = cmake() else { return };
    let Installed { prefix, programs, .. } = installed();
    let build = programs.join("cmake");
    let mut configure = Command::new(&cmake);
    configure.args(["-G", "Unix Makefiles", "-S"]).arg(here("examples")).arg("-B").arg(&build);
    done(configure.arg(format!("-DCMAKE_PREFIX_PATH={}", prefix.display())));
    done(Command::new(&cmake).arg("--build").arg(&build));
    let run = |name: &str| done(&mut Command::new(build.join(name))).stdout;
    let first = run("loop_c_shared");
    assert!(
        ["loop_c_static", "loop_cpp_shared", "loop_cpp_static"]
            .iter()
            .all(|name| run(name) == first)
    );

    // A version that is not this one is refused.
    let config = prefix.join("lib/cmake/trocar/trocarConfigVersion.cmake");
    let text = format!(
        "set(PACKAGE_FIND_VERSION 0.2)\nset(PACKAGE_FIND_VERSION_MAJOR 0)\nset(PACKAGE_FIND_VERSION_MINOR 2)\n\
         include({})\nmessage(\"compatible: ${{PACKAGE_VERSION_COMPATIBLE}}\")\n",
        config.display()
    );
    let script = programs.join("version.cmake");
    fs::write(&script, text).unwrap();
    let printed = done(Command::new(&cmake).arg("-P").arg(script)).stderr;
    assert!(String::from_utf8_lossy(&printed).contains("compatible: FALSE"));
}
