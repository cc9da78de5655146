//! `trocar export c` as a process: where the files go, what is refused, that nothing half-written
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
fn source_and_header_are_written_side_by_side() {
    let folder = tempfile::tempdir().unwrap();
    fs::copy(model(), folder.path().join("model.json")).unwrap();
    let read = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap();
    let stored =
        export(folder.path(), &["model.json", "--out", "seal.c", "--name", "seal"]).ends_with(0);
    assert!(
        stored.stdout.is_empty() && stored.stderr.contains("lines of C -> seal.c, seal.h"),
        "{stored:?}"
    );
    assert_eq!(names_in(folder.path()), ["model.json", "seal.c", "seal.h"]);
    for (name, text) in [("seal.c", read("seal.c")), ("seal.h", read("seal.h"))] {
        assert!(text.starts_with("/*") && text.contains("double seal_step("), "{name}");
        assert!(text.contains("model.json, SHA-256"), "{name}");
    }
    assert!(
        read("seal.c").contains("#include \"seal.h\"") && read("seal.h").contains("extern \"C\"")
    );
    export(folder.path(), &["model.json", "--out", "seal.c", "--precision", "single"]).ends_with(0);
    for text in [read("seal.c"), read("seal.h")] {
        assert!(text.contains("float trocar_step(") && !text.contains("seal_step("));
    }
}

#[test]
fn the_observer_is_written_on_request() {
    let folder = tempfile::tempdir().unwrap();
    let own = model();
    let own = own.to_str().unwrap();
    let unstated = export(folder.path(), &[own, "--out", "seal.c", "--compensator"]).ends_with(1);
    assert!(unstated.stderr.contains("state the standard deviation"), "{}", unstated.stderr);
    let without = export(folder.path(), &[own, "--out", "seal.c", "--offset-n", "1"]).ends_with(2);
    assert!(without.stderr.contains("need --compensator"), "{}", without.stderr);
    assert!(names_in(folder.path()).is_empty());
    let error = ["--compensator", "--force-error-n", "0.05"];
    export(folder.path(), &[&[own, "--out", "seal.c"], &error[..]].concat()).ends_with(0);
    let header = fs::read_to_string(folder.path().join("seal.h")).unwrap();
    assert!(header.contains("trocar_estimate trocar_compensate("), "{header}");
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
    let standard = export(folder.path(), &[own, "--out", "-"]).ends_with(2);
    assert!(standard.stderr.contains("must be named NAME.c"), "{}", standard.stderr);
    fs::write(folder.path().join("bad.json"), "{}").unwrap();
    let bad = export(folder.path(), &["bad.json", "--out", "seal.c"]).ends_with(1);
    assert!(bad.stderr.contains("bad.json: not a model"), "{}", bad.stderr);
    assert_eq!(names_in(folder.path()), ["bad.json"]);
    // The source has a place, its header has none.
    fs::create_dir(folder.path().join("seal.h")).unwrap();
    let half = export(folder.path(), &[own, "--out", "seal.c"]).ends_with(1);
    assert!(half.stderr.contains("seal.h: cannot create"), "{}", half.stderr);
    assert_eq!(names_in(folder.path()), ["bad.json", "seal.h"]);
}
