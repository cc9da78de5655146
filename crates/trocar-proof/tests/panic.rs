//! That the program which cannot panic links, and those which can do not.

use std::path::Path;
use std::process::{Command, Output};

/// What the linker misses where a panic is possible.
const MISSING: &str = "a_panic_is_possible";

/// Builds one program of this crate with the profile that proves something, in a folder of its own.
fn build(program: &str) -> Output {
    let mut command = Command::new(env!("CARGO"));
    command.args([
        "build",
        "--locked",
        "--offline",
        "-p",
        "trocar-proof",
        "--profile",
        "proof",
        "--features",
        "link",
    ]);
    // Flags for other profiles would change what the optimiser sees.
    command.env_remove("RUSTFLAGS").env_remove("CARGO_ENCODED_RUSTFLAGS");
    command.arg("--target-dir").arg(Path::new(env!("CARGO_TARGET_TMPDIR")).join("proof"));
    command.current_dir(env!("CARGO_MANIFEST_DIR")).args(["--bin", program]).output().unwrap()
}

fn links(program: &str) -> bool {
    let output = build(program);
    let errors = String::from_utf8_lossy(&output.stderr);
    let misses = errors.contains(MISSING);
    assert!(
        output.status.success() != misses,
        "{program}: neither linked nor refused for a panic\n{errors}"
    );
    !misses
}

#[test]
fn a_step_cannot_panic() {
    assert!(
        links("cannot_panic"),
        "a panic is possible; its function is named by: {:?}",
        build("cannot_panic")
    );
}

/// The proof proves something: an index and a sum that may fail are found behind the same step.
#[test]
fn what_can_panic_is_found() {
    assert!(!links("can_panic"));
    assert!(!links("can_overflow"));
}
