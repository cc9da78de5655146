//! Every message in docs/troubleshooting.md is one that the program has, and the links of the documentation lead somewhere.
//!
//! On the page `…` stands for what the program puts in; an entry is a part of a message that its reader can search for.

mod find;

use std::path::{Path, PathBuf};
use std::process::Command;

use find::{of_python, of_rust};

const PAGE: &str = "docs/troubleshooting.md";

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// All files below `folder` with this extension, in order.
fn files(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            found.extend(files(&path, extension));
        } else if path.extension().is_some_and(|own| own == extension) {
            found.push(path);
        }
    }
    found.sort();
    found
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The texts in the sources of all crates and of the Python package.
fn messages() -> Vec<String> {
    let crates = std::fs::read_dir(root().join("crates")).expect("crates");
    let folders =
        crates.map(|one| one.expect("a crate").path().join("src")).filter(|src| src.is_dir());
    let rust = folders.flat_map(|src| files(&src, "rs")).flat_map(|path| of_rust(&read(&path)));
    let python = files(&root().join("python/trocar"), "py");
    let python = python.into_iter().flat_map(|path| of_python(&read(&path)));
    rust.chain(python).collect()
}

/// The messages that the page explains.
fn entries() -> Vec<String> {
    let page = read(&root().join(PAGE));
    let entries = page.lines().filter_map(|line| line.strip_prefix("- `")?.strip_suffix('`'));
    entries.map(str::to_owned).collect()
}

/// Whether the parts of `entry` between its `…` stand in `text`, in their order.
fn is_of(text: &str, entry: &str) -> bool {
    let mut rest = Some(text);
    for part in entry.split('…') {
        rest = rest.and_then(|rest| rest.split_once(part)).map(|(_, after)| after);
    }
    rest.is_some()
}

#[test]
fn the_program_has_every_message_on_the_page() {
    let (entries, messages) = (entries(), messages());
    assert!(entries.len() >= 50, "{PAGE}: {} messages", entries.len());
    let is_old = |entry: &&String| !messages.iter().any(|message| message.contains(*entry));
    let old: Vec<_> = entries.iter().filter(is_old).collect();
    assert!(old.is_empty(), "{PAGE} has, unlike the program, {old:#?}");
}

#[test]
fn what_the_program_prints_is_on_the_page() {
    let entries = entries();
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("numbers.csv", "0,0,1\n0.001,0.00001,1\n0.002,0.00002,1\n");
    write("words.csv", "time_s,position_m,force_n\n0,0,1\n1,off,1\n");
    write("model.json", "{\"format\": \"other\"}");
    write("rig.toml", "[motor]\nspeed = 3\n");
    std::fs::create_dir(folder.path().join("empty")).unwrap();
    let cases = [
        ("inspect missing.csv", "cannot open:"),
        ("identify numbers.csv --out a", "no header"),
        ("identify words.csv --out a", "in column …"),
        ("simulate missing.json words.csv --out b.csv", "cannot read the model:"),
        ("simulate model.json words.csv --out b.csv", "not a model:"),
        ("simulate empty words.csv --out b.csv", "a folder without model.json"),
        ("bench steady --out missing/steady.csv", "cannot create:"),
        ("bench steady --rig rig.toml --out steady.csv", "unknown key …"),
        ("fleet empty --out table.csv", "no recordings"),
    ];
    for (case, begin) in cases {
        let mut program = Command::new(env!("CARGO_BIN_EXE_trocar"));
        let output = program.current_dir(folder.path()).args(case.split(' ')).output().unwrap();
        assert!(!output.status.success(), "{case} has no error");
        let printed = String::from_utf8(output.stderr).unwrap();
        let printed = printed.split_whitespace().collect::<Vec<_>>().join(" ");
        let found = entries.iter().any(|entry| entry.starts_with(begin) && is_of(&printed, entry));
        assert!(found, "trocar {case}: not on the page: {printed}");
    }
}

/// The targets of the links of a page, outside of its blocks of code.
fn links(page: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut in_code = false;
    for line in page.lines() {
        let is_fence = line.trim_start().starts_with("```");
        in_code ^= is_fence;
        if !in_code && !is_fence {
            let targets = line.split("](").skip(1).filter_map(|rest| rest.split_once(')'));
            found.extend(targets.map(|(target, _)| target.to_owned()));
        }
    }
    found
}

/// The anchor of each heading of a page; the book writes `-` for `_`.
fn anchors(page: &str) -> Vec<String> {
    let headings = page.lines().filter(|line| line.starts_with('#'));
    let text = headings.map(|line| line.trim_start_matches('#').trim().to_lowercase());
    let kept = |letter: &char| letter.is_alphanumeric() || " -_".contains(*letter);
    text.map(|text| text.chars().filter(kept).collect::<String>().replace([' ', '_'], "-"))
        .collect()
}

#[test]
fn links_between_pages_lead_somewhere() {
    let mut pages = files(&root().join("docs"), "md");
    pages.push(root().join("README.md"));
    let mut broken = Vec::new();
    for path in pages {
        let page = read(&path);
        for link in links(&page).into_iter().filter(|link| !link.contains("://")) {
            let (name, anchor) = link.split_once('#').unwrap_or((&link, ""));
            let target = if name.is_empty() { path.clone() } else { path.with_file_name(name) };
            let is_page = target.extension().is_some_and(|extension| extension == "md");
            let leads = target.exists()
                && (anchor.is_empty()
                    || !is_page
                    || anchors(&read(&target)).iter().any(|own| *own == anchor.replace('_', "-")));
            if !leads {
                broken.push(format!("{}: {link}", path.display()));
            }
        }
    }
    assert!(broken.is_empty(), "{broken:#?}");
}
