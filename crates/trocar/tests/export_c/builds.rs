//! The files in other languages' standards and with other compilers.

use std::ffi::OsStr;

use super::*;

/// A compiler with the flags that both of them know.
fn compile(folder: &Path, compiler: &str, arguments: &[&str]) {
    let flags = FLAGS.iter().filter(|flag| **flag != "-Wmissing-prototypes");
    let mut command = Command::new(compiler);
    command.current_dir(folder).args(flags).arg("-Werror").args(arguments);
    let output = command.output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{compiler} {arguments:?}\n{errors}");
}

/// Compiler for ARM Cortex-M.
pub(super) const ARM: &str = "arm-none-eabi-gcc";

/// NAME.c in `folder` as NAME.o for a Cortex-M4F, whose unit computes in single precision; returns
/// the size of code and constants, bytes.
pub(super) fn for_cortex_m4f(folder: &Path, name: &str) -> u32 {
    let (source, object) = (format!("{name}.c"), format!("{name}.o"));
    let target = ["-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"];
    compile(
        folder,
        ARM,
        &[&target[..], &["-std=c99", "-Os", "-c", &source, "-o", &object]].concat(),
    );
    size(folder, "arm-none-eabi-size", &object)
}

/// Size of code and constants of `object`, bytes.
pub(super) fn size(folder: &Path, program: &str, object: &str) -> u32 {
    let output = Command::new(program).current_dir(folder).arg(object).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines().last().unwrap().split_whitespace().next().unwrap().parse().unwrap()
}

/// Whether `compiler` is installed; a machine of the project need not have it.
pub(super) fn has(compiler: &str) -> bool {
    let found = Command::new(compiler).arg("--version").output().is_ok_and(|o| o.status.success());
    if !found {
        skipped(&format!("no {compiler}"));
    }
    found
}

#[test]
fn the_source_is_clean_in_each_standard_of_c() {
    if !has_gcc() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for (name, model) in conformance_models() {
        store(&model, folder.path(), &name);
    }
    let sources: Vec<String> =
        conformance_models().iter().map(|(name, _)| format!("{name}.c")).collect();
    let sources: Vec<&str> = sources.iter().map(String::as_str).collect();
    for compiler in ["gcc", "clang"].into_iter().filter(|compiler| has(compiler)) {
        for standard in ["-std=c99", "-std=c11", "-std=c17"] {
            compile(
                folder.path(),
                compiler,
                &[&[standard, "-fsyntax-only"], &sources[..]].concat(),
            );
        }
    }
}

/// A sketch in C++ as the Arduino tools build it: the model by the C compiler, the rest by that of
/// C++ without exceptions and type information, sections without use left out.
const SKETCH: &str = r#"
#include <stdio.h>
#include "seal.h"
static seal_state state;
static double position_m = 0.05;
static void setup() { seal_rest(&state, position_m); }
static double loop() {
    position_m += 20e-6;
    return seal_step_to(&state, position_m, 1e-3);
}
int main() {
    setup();
    for (int k = 0; k < 500; ++k) {
        printf("%.17g\n", loop());
    }
    return 0;
}
"#;

/// Its forces, from the library.
fn sketch_forces(model: &ModelFile) -> Vec<f64> {
    let trocar = model.trocar.borrowed();
    let mut position = 0.05;
    let mut state = trocar.rest(position);
    let mut step = |_| {
        position += 20e-6;
        trocar.step_to(&mut state, position, 1e-3)
    };
    (0..500).map(&mut step).collect()
}

#[test]
fn c_plus_plus_links_the_model_and_gets_its_forces() {
    if !has_gcc() || !has("g++") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let sections = ["-Os", "-ffunction-sections", "-fdata-sections"];
    fs::write(folder.path().join("sketch.cpp"), SKETCH).unwrap();
    for (name, model) in conformance_models() {
        store(&model, folder.path(), "seal");
        compile(folder.path(), "gcc", &[&sections[..], &["-std=gnu11", "-c", "seal.c"]].concat());
        for standard in ["-std=gnu++11", "-std=c++11", "-std=c++17"] {
            let sketch = [standard, "-fno-exceptions", "-fno-rtti", "-fno-threadsafe-statics"];
            let link = ["-Wl,--gc-sections", "sketch.cpp", "seal.o", "-o", "sketch", "-lm"];
            compile(folder.path(), "g++", &[&sections[..], &sketch, &link].concat());
            let output = Command::new(folder.path().join("sketch")).output().unwrap();
            let text = String::from_utf8(output.stdout).unwrap();
            let forces: Vec<f64> = text.lines().map(|line| line.parse().unwrap()).collect();
            assert_eq!(forces, sketch_forces(&model), "{name} {standard}");
        }
    }
}

/// The blocks of C in a page of the documentation.
fn code_of(page: &str) -> Vec<String> {
    let text = fs::read_to_string(repository().join("docs").join(page)).unwrap();
    let blocks = text.split("```c\n").skip(1);
    blocks.map(|block| block.split("```").next().unwrap().to_owned()).collect()
}

/// Calls the function of docs/how-to/simulink.md as the block does, in two simulations; then that of
/// docs/how-to/microcontroller.md.
const SIMULATIONS: &str = r#"
#include <stdio.h>
#include "seal_block.h"
void on_start(double position_m);
double every_millisecond(double position_m);
int main(void)
{
    int run, k;
    for (run = 0; run < 2; ++run) {
        double position_m = 0.05;
        seal_block(1.0, position_m, 1e-3);
        for (k = 0; k < 500; ++k) {
            position_m += 20e-6;
            printf("%.17g\n", seal_block(0.0, position_m, 1e-3));
        }
    }
    {
        double position_m = 0.05;
        on_start(position_m);
        for (k = 0; k < 500; ++k) {
            position_m += 20e-6;
            printf("%.17g\n", every_millisecond(position_m));
        }
    }
    return 0;
}
"#;

#[test]
fn the_code_of_the_documentation_gives_the_forces() {
    if !has_gcc() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let simulink = code_of("how-to/simulink.md");
    let [header, wrapper] = &simulink[..] else { panic!("{} blocks", simulink.len()) };
    let use_of_it = code_of("how-to/microcontroller.md").remove(0);
    let prototypes =
        "void on_start(double position_m);\ndouble every_millisecond(double position_m);\n";
    for (name, text) in [
        ("seal_block.h", header.as_str()),
        ("seal_block.c", wrapper),
        ("use.c", &format!("{prototypes}{use_of_it}")),
        ("main.c", SIMULATIONS),
    ] {
        fs::write(folder.path().join(name), text).unwrap();
    }
    for (name, model) in conformance_models() {
        store(&model, folder.path(), "seal");
        let sources = ["main.c", "seal_block.c", "use.c", "seal.c", "-o", "main", "-lm"];
        gcc(folder.path(), &[&["-O2", "-Werror"][..], &sources].concat());
        let output = Command::new(folder.path().join("main")).output().unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        let forces: Vec<f64> = text.lines().map(|line| line.parse().unwrap()).collect();
        assert_eq!(
            forces,
            [sketch_forces(&model), sketch_forces(&model), sketch_forces(&model)].concat(),
            "{name}"
        );
    }
}

/// Largest difference of the force over `conformance/motion.csv` where operations are fused, N. A
/// fused multiply-add rounds once in place of twice; measured: 2.4e-14 N.
const FUSED_N: f64 = 1e-13;

/// A compiler whose processor fuses multiplication and addition, and a program that runs its code.
struct Fusing {
    compiler: &'static str,
    flag: &'static str,
    emulator: Option<&'static str>,
}

impl Fusing {
    /// By what can be had here.
    fn all() -> Vec<Self> {
        let native =
            |flag| ["gcc", "clang"].map(|compiler| Self { compiler, flag, emulator: None });
        let mut all = Vec::new();
        #[cfg(target_arch = "x86_64")]
        if std::is_x86_feature_detected!("fma") {
            all.extend(native("-mfma"));
        } else {
            skipped("this processor has no FMA");
        }
        // Every processor of this kind fuses.
        if cfg!(target_arch = "aarch64") {
            all.extend(native("-static"));
        } else {
            let emulator = Some("qemu-aarch64");
            all.push(Self { compiler: "aarch64-linux-gnu-gcc", flag: "-static", emulator });
        }
        all.retain(|by| has(by.compiler) && by.emulator.is_none_or(has));
        all
    }

    /// Runs driver.c in `folder`, compiled with `flags`, over the motion of `conformance/`.
    fn run(&self, folder: &Path, flags: &[&str], models: usize) -> Vec<Vec<Outcome>> {
        let mut command = Command::new(self.compiler);
        let fixed = ["-std=gnu99", "-O2", "-Wall", "-Werror", self.flag, "driver.c", "-o", "fused"];
        command.current_dir(folder).args(fixed).args(flags).arg("-lm");
        let output = command.output().unwrap();
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{} {flags:?}\n{errors}", self.compiler);
        let program = folder.join("fused");
        let mut command = Command::new(self.emulator.map_or(program.as_os_str(), OsStr::new));
        if self.emulator.is_some() {
            command.arg(&program);
        }
        let (start, calls) = conformance_motion();
        run_by(command, &program, start, &calls, models)
    }
}

/// The file itself switches fused operations off, whatever the options of the compiler; without its
/// pragmas they move last digits. Prints by how much.
#[test]
fn operations_are_not_fused() {
    let folder = tempfile::tempdir().unwrap();
    let models = conformance_models();
    let names: Vec<String> = models.iter().map(|(name, _)| name.clone()).collect();
    fs::write(folder.path().join("driver.c"), driver(&names, "double")).unwrap();
    let (start, calls) = conformance_motion();
    let largest = |rows: Vec<Vec<Outcome>>| {
        let of = |((_, model), outcomes): (&(String, ModelFile), &Vec<Outcome>)| {
            single::differences(model, start, &calls, outcomes)[0]
        };
        models.iter().zip(&rows).map(of).fold(0.0, f64::max)
    };
    for by in Fusing::all() {
        models.iter().for_each(|(name, model)| drop(store(model, folder.path(), name)));
        let as_written = largest(by.run(folder.path(), &[], models.len()));
        for name in &names {
            let path = folder.path().join(format!("{name}.c"));
            let text = fs::read_to_string(&path).unwrap();
            let open: Vec<&str> =
                text.lines().filter(|line| !line.starts_with("#pragma")).collect();
            fs::write(path, open.join("\n") + "\n").unwrap();
        }
        let fused = largest(by.run(folder.path(), &["-ffp-contract=fast"], models.len()));
        println!("{}: {as_written} N, fused {fused:.1e} N", by.compiler);
        assert_eq!(as_written, 0.0, "{}", by.compiler);
        assert!(fused > 0.0 && fused <= FUSED_N, "{}: {fused:e} N", by.compiler);
    }
}
