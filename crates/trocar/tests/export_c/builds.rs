//! The files in other languages' standards and with other compilers.

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
        let _ = writeln!(std::io::stderr(), "skipped: no {compiler}");
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
