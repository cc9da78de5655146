//! The invariants of ARCHITECTURE.md that can be checked in the sources.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// All sources of the crates, without tests, examples and build scripts.
fn sources() -> Vec<(String, String)> {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").canonicalize().unwrap();
    let mut folders: Vec<PathBuf> = fs::read_dir(&crates)
        .unwrap()
        .map(|entry| entry.unwrap().path().join("src"))
        .filter(|p| p.is_dir())
        .collect();
    let mut found = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let name = path.strip_prefix(&crates).unwrap().to_str().unwrap().replace('\\', "/");
                found.push((name, code(&fs::read_to_string(&path).unwrap())));
            }
        }
    }
    assert!(found.len() > 150, "{} sources", found.len());
    found
}

/// The text without comments and unit tests.
fn code(text: &str) -> String {
    let own = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
    own.lines()
        .filter(|line| !line.trim_start().starts_with("//"))
        .map(|line| format!("{line}\n"))
        .collect()
}

/// Files that contain one of `patterns` and whose names do not begin with an entry of `allowed`.
fn elsewhere(patterns: &[&str], allowed: &[&str]) -> BTreeSet<String> {
    let holds = |(name, text): (String, String)| {
        let is_allowed = allowed.iter().any(|start| name.starts_with(start));
        (!is_allowed && patterns.iter().any(|pattern| text.contains(pattern))).then_some(name)
    };
    sources().into_iter().filter_map(holds).collect()
}

#[track_caller]
fn only_in(patterns: &[&str], allowed: &[&str]) {
    assert_eq!(
        elsewhere(patterns, allowed),
        BTreeSet::new(),
        "{patterns:?} belongs to {allowed:?}"
    );
    assert!(
        !elsewhere(patterns, &[]).is_empty(),
        "{patterns:?} is nowhere: the test looks for the wrong thing"
    );
}

#[test]
fn only_the_command_line_prints_or_exits() {
    only_in(
        &["println!", "eprintln!", "print!(", "process::exit", "io::stdout"],
        // The last speaks to Cargo, in build scripts.
        &[
            "trocar-cli/",
            "trocar-proof/",
            "trocar-tables/src/output.rs",
            "trocar-fmu/src/library.rs",
        ],
    );
}

#[test]
fn libraries_name_no_flags() {
    // The program, Cargo at work, and how flags are written.
    let allowed = ["trocar-cli/", "trocar-fmu/src/library.rs", "trocar-tables/src/option.rs"];
    let with_flags = sources().into_iter().filter(|(_, text)| names_a_flag(text));
    let (own, others): (Vec<String>, Vec<String>) = with_flags
        .map(|(name, _)| name)
        .partition(|name| allowed.iter().any(|start| name.starts_with(start)));
    assert_eq!(others, Vec::<String>::new(), "mark options as in trocar-tables/src/option.rs");
    assert!(own.len() > 10, "the test looks for the wrong thing: {own:?}");
}

fn names_a_flag(text: &str) -> bool {
    // Flags of Cargo and of h5repack.
    let others = ["--features {", "--high=V110", "--filter=GZIP"];
    let own = others.iter().fold(text.to_owned(), |text, other| text.replace(other, ""));
    own.as_bytes().windows(3).any(|three| three.starts_with(b"--") && three[2].is_ascii_lowercase())
}

#[test]
fn only_the_reader_knows_formats() {
    only_in(&["formats::"], &["trocar-recording/"]);
}

/// All code that simulates an identified model uses `Trocar`; the exceptions here step its parts
/// for specific reasons.
#[test]
fn models_are_stepped_in_known_places() {
    let parts = [
        "stages.step(",
        "element.step",
        "seal.step(",
        "seal().step(",
        "step_parallel(",
        "model.lead(",
        "model.step(",
    ];
    let allowed = [
        "trocar-model/",
        "trocar/src/analyze", // propositions and energy of elements
        "trocar-simulate/src/bench/rig.rs", // a wetted seal under a motor
        "trocar-identify/src/", // derivatives of the force
        "trocar-report/src/figures/deformation", // branches of the deformation force
        "trocar-simulate/src/replay.rs", // extreme starts
        "trocar-runtime/src/compensate", // a seal whose friction has changed is driven by a scaled motion
    ];
    only_in(&parts, &allowed);
}

/// Nor can the bench know the identification, which depends on its crate.
#[test]
fn identification_does_not_know_the_bench() {
    only_in(&["trocar_simulate::bench"], &["trocar/", "trocar-lab/"]);
}

#[test]
fn no_clock_in_results() {
    let measured = [
        "trocar-lab/src/compare/mod.rs",
        "trocar-lab/src/fleet/journal.rs",
        "trocar-cli/src/verbs/",
    ];
    only_in(&["Instant::now", "SystemTime"], &measured);
}

/// Where tests are modules of one program, each file is one, or a program of its own: none is left
/// out.
#[test]
fn every_file_of_tests_is_run() {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut programs = 0;
    for entry in fs::read_dir(crates).unwrap() {
        let folder = entry.unwrap().path();
        let Ok(all) = fs::read_to_string(folder.join("tests/all.rs")) else { continue };
        let manifest = fs::read_to_string(folder.join("Cargo.toml")).unwrap();
        programs += 1;
        for file in fs::read_dir(folder.join("tests")).unwrap() {
            let path = file.unwrap().path();
            let name = path.file_stem().unwrap().to_str().unwrap();
            if path.extension().is_some_and(|extension| extension == "rs") {
                let is_module = all.lines().any(|line| line == format!("mod {name};"));
                let is_program = manifest.contains(&format!("[[test]]\nname = \"{name}\""));
                assert!(
                    is_module != is_program,
                    "{}: in tests/all.rs, or a [[test]]",
                    path.display()
                );
            }
        }
    }
    assert!(programs >= 3, "{programs} programs of tests");
}

#[test]
fn unsafe_code_stays_at_foreign_interfaces() {
    let edges = [
        "trocar-capi/",
        "trocar-fmu/src/ffi.rs",
        "trocar-fmu/src/fmi.rs",
        "trocar-fmu/src/fmi2.rs",
        "trocar-fmu/src/fmi3.rs",
        "trocar-web/src/exports.rs",
        "trocar-web-teleop/src/exports.rs",
        "trocar-proof/",
    ];
    only_in(&["unsafe {", "unsafe fn", "unsafe impl"], &edges);
}
