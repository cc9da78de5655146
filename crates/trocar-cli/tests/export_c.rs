//! `trocar export c` as a process: where the file goes, what is refused, that nothing half-written
//! stays.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::{Ran, names_in};

fn model() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../conformance/models/ems.json")
}

fn export(folder: &Path, arguments: &[&str]) -> Ran {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trocar"));
    Ran::from(command.current_dir(folder).args(["export", "c"]).args(arguments).output().unwrap())
}

#[test]
fn a_file_and_the_standard_output_hold_the_same() {
    let folder = tempfile::tempdir().unwrap();
    fs::copy(model(), folder.path().join("seal.json")).unwrap();
    let printed =
        export(folder.path(), &["seal.json", "--out", "-", "--name", "seal"]).ends_with(0);
    assert!(
        printed.stdout.starts_with("/*") && printed.stdout.contains("double seal_step("),
        "{printed:?}"
    );
    assert!(printed.stdout.contains("seal.json, SHA-256"));
    let stored =
        export(folder.path(), &["seal.json", "--out", "seal.c", "--name", "seal"]).ends_with(0);
    assert!(
        stored.stdout.is_empty() && stored.stderr.contains("lines of C -> seal.c"),
        "{stored:?}"
    );
    assert_eq!(fs::read_to_string(folder.path().join("seal.c")).unwrap(), printed.stdout);
    let named = export(folder.path(), &["seal.json", "--out", "-"]).ends_with(0);
    assert!(named.stdout.contains("double trocar_step("));
}

#[test]
fn faults_are_told_and_leave_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let own = model();
    let own = own.to_str().unwrap();
    let prefix = export(folder.path(), &[own, "--out", "seal.c", "--name", "9 lives"]).ends_with(2);
    assert!(prefix.stderr.contains("beginning with a letter, got '9 lives'"), "{}", prefix.stderr);
    let missing = export(folder.path(), &["absent.json", "--out", "seal.c"]).ends_with(1);
    assert!(missing.stderr.contains("absent.json: cannot read the model"), "{}", missing.stderr);
    let nowhere = export(folder.path(), &[own, "--out", "absent/seal.c"]).ends_with(1);
    assert!(nowhere.stderr.contains("absent/seal.c"), "{}", nowhere.stderr);
    fs::write(folder.path().join("bad.json"), "{}").unwrap();
    let bad = export(folder.path(), &["bad.json", "--out", "seal.c"]).ends_with(1);
    assert!(bad.stderr.contains("bad.json: not a model"), "{}", bad.stderr);
    assert_eq!(names_in(folder.path()), ["bad.json"]);
}
