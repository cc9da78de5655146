//! `trocar sweep` from outside: what it prints, what it writes, how it ends.

use std::path::Path;
use std::process::{Command, Output};

fn trocar(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_trocar")).current_dir(folder).args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn the_printed_example_runs_and_gives_the_same_table_again() {
    let folder = tempfile::tempdir().unwrap();
    let example = trocar(folder.path(), &["sweep", "--print-config"]);
    assert_eq!(example.status.code(), Some(0));
    let document = text(&example.stdout).replace("runs = 1000", "runs = 70");
    std::fs::write(folder.path().join("sweep.toml"), document).unwrap();
    let table = trocar(folder.path(), &["sweep", "sweep.toml", "--out", "-", "--quiet"]);
    assert_eq!((table.status.code(), text(&table.stderr).as_str()), (Some(0), ""));
    assert_eq!(text(&table.stdout).lines().count(), 71);
    for name in ["a.parquet", "b.parquet"] {
        let out = trocar(folder.path(), &["sweep", "sweep.toml", "--out", name]);
        assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
        assert!(text(&out.stderr).contains("70 runs in"));
    }
    let bytes = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert_eq!(bytes("a.parquet"), bytes("b.parquet"));
}

#[test]
fn failed_runs_are_told_and_stop_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let document = "runs = 20\n[motion]\nprotocol = \"step\"\n[seal]\nhalf_width_m = { uniform = [-0.005, 0.005] }\n";
    std::fs::write(folder.path().join("sweep.toml"), document).unwrap();
    let out = trocar(folder.path(), &["sweep", "sweep.toml", "--out", "table.csv"]);
    assert_eq!(out.status.code(), Some(3));
    assert!(
        text(&out.stderr)
            .contains("of 20 runs failed, the first: half_width_m must be finite and above 0 m")
    );
    let table = std::fs::read_to_string(folder.path().join("table.csv")).unwrap();
    assert_eq!(table.lines().count(), 21);
}

#[test]
fn faults_leave_no_table() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(
        folder.path().join("sweep.toml"),
        "[motion]\nprotocol = \"step\"\n[seal]\nwidth = 3\n",
    )
    .unwrap();
    let fault = |arguments: &[&str]| {
        let out = trocar(folder.path(), arguments);
        (out.status.code(), text(&out.stderr))
    };
    let (code, message) = fault(&["sweep", "sweep.toml", "--out", "table.parquet"]);
    assert_eq!(code, Some(1));
    assert!(message.contains("sweep.toml: line 4: [seal] has no \"width\""), "{message}");
    let (code, message) = fault(&["sweep", "nowhere.toml", "--out", "table.parquet"]);
    assert_eq!(code, Some(1));
    assert!(message.contains("nowhere.toml: cannot read the sweep"), "{message}");
    assert_eq!(fault(&["sweep", "sweep.toml"]).0, Some(2));
    assert!(!folder.path().join("table.parquet").exists());
}

#[test]
fn the_names_of_the_parameters_are_listed() {
    let out = trocar(Path::new("."), &["sweep", "--list", "plausible"]);
    assert_eq!(out.status.code(), Some(0));
    assert!(text(&out.stdout).lines().any(|line| line.starts_with("half_width_m ")));
}
