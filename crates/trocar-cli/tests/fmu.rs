//! `trocar export fmu`: what it refuses, that the same model gives the same bytes, and FMUs run by
//! FMPy and by C.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;

use crate::common::{Ran, names_in};
use crate::skipped::skipped;

const TROCAR: &str = env!("CARGO_BIN_EXE_trocar");

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap()
}

fn model() -> PathBuf {
    repository().join("conformance/models/ems.json")
}

fn export(folder: &Path, arguments: &[&str]) -> Ran {
    let mut command = Command::new(TROCAR);
    command.current_dir(folder).args(["export", "fmu"]).args(arguments);
    Ran::from(command.output().unwrap())
}

#[test]
fn the_same_model_gives_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let model = model();
    let model = model.to_str().unwrap();
    let make = |name: &str, more: &[&str]| {
        export(folder.path(), &[&[model, "--out", name], more].concat()).ends_with(0);
        fs::read(folder.path().join(name)).unwrap()
    };
    let plain = make("a.fmu", &[]);
    assert!(plain.starts_with(b"PK\x03\x04"));
    assert_eq!(plain, make("b.fmu", &["--fmi", "2", "--input", "velocity", "--name", "ems"]));
    for other in [["--fmi", "3"], ["--input", "position"], ["--name", "a < b & \"c\""]] {
        assert_ne!(plain, make("c.fmu", &other));
    }
    // Nothing of this machine is inside, neither of the library nor of the rest.
    for folder in [repository(), std::env::home_dir().unwrap_or_default()] {
        let folder = folder.as_os_str().as_encoded_bytes();
        assert!(folder.len() < 4 || !plain.windows(folder.len()).any(|part| part == folder));
    }
}

#[test]
fn refusals() {
    let folder = tempfile::tempdir().unwrap();
    let model = model();
    let model = model.to_str().unwrap();
    fs::write(folder.path().join("text.dll"), "no library").unwrap();
    fs::write(folder.path().join("tiny.dll"), "MZ").unwrap();
    for (arguments, code, words) in [
        (&["missing.json", "--out", "a.fmu"][..], 1, "missing.json: cannot read the model"),
        (&[model, "--out", "a.fmu", "--fmi", "1"], 2, "invalid value '1' for '--fmi"),
        (&[model, "--out", "a.fmu", "--library", "win64"], 2, "must be PLATFORM=FILE"),
        (&[model, "--out", "a.fmu", "--library", "beos=tiny.dll"], 2, "no platform \"beos\""),
        (
            &[model, "--out", "a.fmu", "--library", "win64=text.dll"],
            2,
            "text.dll is not a shared library for x86_64-windows",
        ),
        (&[model, "--out", "a.fmu", "--library", "win64=none.dll"], 1, "cannot read none.dll"),
        (
            &[
                model,
                "--out",
                "a.fmu",
                "--library",
                "win64=tiny.dll",
                "--library",
                "x86_64-windows=tiny.dll",
            ],
            2,
            "names x86_64-windows twice",
        ),
        (&[model, "--out", "a.fmu", "--platform", "beos"], 2, "no platform \"beos\""),
        (
            &[model, "--out", "a.fmu", "--platform", "x86-windows"],
            2,
            "contains no FMU library for x86-windows, only for ",
        ),
        (&[model, "--out", "no/folder/a.fmu"], 1, "cannot create"),
    ] {
        let ran = export(folder.path(), arguments);
        assert_eq!(ran.code, Some(code), "{arguments:?}: {}", ran.stderr);
        assert!(
            ran.stderr.contains(words) && ran.stdout.is_empty(),
            "{words} expected in {}",
            ran.stderr
        );
    }
    assert_eq!(names_in(folder.path()), ["text.dll", "tiny.dll"]);
}

/// Folders are named by the standard: other names in FMI 2.0 than in 3.0.
#[test]
fn an_fmu_has_a_folder_for_each_platform() {
    let folder = tempfile::tempdir().unwrap();
    let model = model();
    let model = model.to_str().unwrap();
    fs::write(folder.path().join("a.dll"), "MZ").unwrap();
    fs::write(folder.path().join("a.dylib"), [0xcf, 0xfa, 0xed, 0xfe]).unwrap();
    let libraries = ["win64=a.dll", "darwin64=a.dylib", "aarch64-darwin=a.dylib"];
    let named = libraries.map(|library| ["--library", library]).concat();
    for (fmi, names) in [
        ("2", ["win64/trocar.dll", "darwin64/trocar.dylib", "aarch64-darwin/trocar.dylib"]),
        (
            "3",
            [
                "x86_64-windows/trocar.dll",
                "x86_64-darwin/trocar.dylib",
                "aarch64-darwin/trocar.dylib",
            ],
        ),
    ] {
        let ran =
            export(folder.path(), &[&[model, "--out", "a.fmu", "--fmi", fmi], &named[..]].concat());
        ran.ends_with(0).says(&["x86_64-windows, x86_64-darwin, aarch64-darwin"]);
        let bytes = fs::read(folder.path().join("a.fmu")).unwrap();
        let contains = |name: &str| bytes.windows(name.len()).any(|part| part == name.as_bytes());
        for name in names {
            assert!(contains(&format!("binaries/{name}")), "{name} in FMI {fmi}");
        }
        assert_eq!(contains("binaries/x86_64-windows"), fmi == "3");
    }
}

/// Reports why nothing is tested; in CI it fails.
fn skip(why: &str) {
    skipped(why);
    assert!(std::env::var("CI").as_deref() != Ok("true"), "{why}");
}

fn run(program: impl AsRef<OsStr>, arguments: &[&str]) -> Result<(), String> {
    let name = program.as_ref().to_string_lossy().into_owned();
    let ran = Command::new(program).args(arguments).stdin(Stdio::null()).output();
    let output = ran.map_err(|error| format!("{name}: {error}"))?;
    let said = String::from_utf8_lossy(&output.stderr);
    if output.status.success() { Ok(()) } else { Err(format!("{name}: {}", said.trim())) }
}

/// A Python with FMPy, in a folder of the build.
fn python() -> Result<PathBuf, String> {
    // Two tests ask for it at once.
    static PYTHON: OnceLock<Result<PathBuf, String>> = OnceLock::new();
    PYTHON.get_or_init(make_python).clone()
}

/// Makes it, unless an earlier run has.
fn make_python() -> Result<PathBuf, String> {
    let requirements = repository().join("crates/trocar-fmu/tests/requirements.txt");
    let wanted = fs::read(&requirements).map_err(|error| error.to_string())?;
    let place = Path::new(env!("CARGO_TARGET_TMPDIR")).join("fmpy");
    let (python, made) = (place.join("bin/python"), place.join("made-of.txt"));
    if fs::read(&made).is_ok_and(|text| text == wanted) {
        return Ok(python);
    }
    run("python3", &["-m", "venv", "--clear", &place.to_string_lossy()])?;
    let pip = [
        "-m",
        "pip",
        "install",
        "--quiet",
        "--disable-pip-version-check",
        "--no-deps",
        "--requirement",
    ];
    run(&python, &[&pip[..], &[&requirements.to_string_lossy()]].concat())?;
    fs::write(made, wanted).map_err(|error| error.to_string())?;
    Ok(python)
}

/// All models, both versions of FMI, both inputs: see check.py.
#[test]
fn fmpy_finds_what_simulate_finds() {
    if !cfg!(all(target_os = "linux", target_arch = "x86_64")) {
        return skip("the importer in C is for Linux on x86-64");
    }
    let python = match python() {
        Ok(python) => python,
        Err(why) => return skip(&format!("no Python with FMPy: {why}")),
    };
    let folder = tempfile::tempdir().unwrap();
    let tests = repository().join("crates/trocar-fmu/tests");
    let conformance = repository().join("conformance");
    let output = Command::new(python)
        .arg(tests.join("check.py"))
        .args([
            Path::new(TROCAR),
            &conformance.join("models"),
            &conformance.join("motion.csv"),
            folder.path(),
        ])
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .output()
        .unwrap();
    let (printed, errors) =
        (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    println!("{printed}");
    assert!(output.status.success(), "{printed}\n{errors}");
    let models = names_in(&conformance.join("models")).len();
    let turning = names_in(&conformance.join("turning/models")).len();
    // One line more for two source FMUs in one program.
    assert_eq!(printed.matches("rows bit-identical").count(), models + turning + 1);
}

/// A platform whose library is built and run by emulation.
struct Foreign {
    platform: &'static str,
    target: &'static str,
    linker: &'static str,
    emulator: &'static str,
    library: &'static str,
}

impl Foreign {
    /// What its test needs and not every machine can fetch; the first that is missing, if any.
    fn missing(&self) -> Option<String> {
        let rustc = ["--print", "target-libdir", "--target", self.target];
        let libraries = Command::new("rustc").args(rustc).output();
        let has_target = libraries
            .is_ok_and(|output| Path::new(String::from_utf8_lossy(&output.stdout).trim()).is_dir());
        if !has_target {
            return Some(format!("rustup target add {}", self.target));
        }
        [self.linker, self.emulator].iter().find_map(|tool| run(tool, &["--version"]).err())
    }

    /// The library, built in a folder of its own.
    fn build(&self) -> PathBuf {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("fmu-libraries");
        let arguments = "rustc --quiet --locked -p trocar-fmu --lib --crate-type cdylib";
        let linker = self.target.to_uppercase().replace('-', "_");
        let made = Command::new(env!("CARGO"))
            .current_dir(repository())
            .args(arguments.split(' '))
            .args(["--profile", "fmu", "--target", self.target, "--target-dir"])
            .arg(&folder)
            .env(format!("CARGO_TARGET_{linker}_LINKER"), self.linker)
            .output()
            .unwrap();
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
        folder.join(self.target).join("fmu").join(self.library)
    }

    /// All models, both versions of FMI: see foreign.py.
    fn check(&self) {
        let Self { platform, .. } = self;
        if !cfg!(all(target_os = "linux", target_arch = "x86_64")) {
            return skip("other platforms are emulated on Linux on x86-64");
        }
        if let Some(why) = self.missing() {
            // Not a failure in CI.
            return skipped(&format!("the FMU library for {platform}: {why}"));
        }
        let python = match python() {
            Ok(python) => python,
            Err(why) => return skip(&format!("no Python with FMPy: {why}")),
        };
        let folder = tempfile::tempdir().unwrap();
        let conformance = repository().join("conformance");
        let output = Command::new(python)
            .arg(repository().join("crates/trocar-fmu/tests/foreign.py"))
            .args([Path::new(TROCAR), &conformance.join("models"), &conformance.join("motion.csv")])
            .arg(folder.path())
            .arg(platform)
            .arg(self.build())
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .env("WINEPREFIX", Path::new(env!("CARGO_TARGET_TMPDIR")).join("wine"))
            .env("WINEDEBUG", "-all")
            .output()
            .unwrap();
        let (printed, errors) =
            (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
        assert!(output.status.success(), "{printed}\n{errors}");
        assert!(printed.contains(&format!("largest difference on {platform}: 0.0 N")), "{printed}");
    }
}

#[test]
fn the_library_for_windows_finds_what_simulate_finds() {
    Foreign {
        platform: "x86_64-windows",
        target: "x86_64-pc-windows-gnu",
        linker: "x86_64-w64-mingw32-gcc",
        emulator: "wine",
        library: "trocar_fmu.dll",
    }
    .check();
}

#[test]
fn the_library_for_aarch64_finds_what_simulate_finds() {
    Foreign {
        platform: "aarch64-linux",
        target: "aarch64-unknown-linux-gnu",
        linker: "aarch64-linux-gnu-gcc",
        emulator: "qemu-aarch64",
        library: "libtrocar_fmu.so",
    }
    .check();
}
