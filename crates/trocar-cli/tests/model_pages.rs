//! The pages of docs/reference/models: their figures and live models are what their command makes, and what they name exists.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::live::{skip, tools};

#[path = "../../trocar/examples/model_pages/main.rs"]
mod example;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Pages of models by their file's stem, with their text.
fn pages() -> Vec<(String, String)> {
    let folder = root().join("docs/reference/models");
    let entries =
        std::fs::read_dir(folder).expect("the pages").map(|one| one.expect("a page").path());
    let mut pages: Vec<(String, String)> = entries
        .map(|path| {
            let stem = path.file_stem().expect("a name").to_string_lossy().into_owned();
            (stem, std::fs::read_to_string(path).expect("a page"))
        })
        .filter(|(stem, _)| stem != "index")
        .collect();
    pages.sort();
    pages
}

#[test]
fn figures_and_live_models_are_those_of_the_command() {
    let folder = root().join("docs/figures/models");
    let files = example::files().unwrap();
    if std::env::var_os("TROCAR_WRITE_DOCS").is_some() {
        std::fs::create_dir_all(&folder).unwrap();
        for (name, text) in &files {
            std::fs::write(folder.join(name), text).unwrap();
        }
    }
    for (name, text) in &files {
        let kept = std::fs::read_to_string(folder.join(name)).unwrap_or_default();
        assert!(
            kept == *text,
            "docs/figures/models/{name}: run cargo run --release -p trocar --example model_pages -- docs/figures/models"
        );
    }
    let kept = std::fs::read_dir(folder).unwrap().map(|one| one.unwrap().file_name());
    let kept: BTreeSet<String> = kept.map(|name| name.to_string_lossy().into_owned()).collect();
    assert_eq!(kept, files.into_iter().map(|(name, _)| name).collect());
}

#[test]
fn every_model_has_a_page_with_all_its_parts() {
    let files = example::files().unwrap();
    let drawn: BTreeSet<&str> =
        files.iter().filter_map(|(name, _)| name.strip_suffix(".svg")).collect();
    let pages = pages();
    assert_eq!(drawn, pages.iter().map(|(stem, _)| stem.as_str()).collect());
    let parts = [
        "## Equations",
        "## Symbols",
        "## Limits",
        "## What it can and cannot reproduce",
        "## Source, tests, other programs",
    ];
    for (stem, text) in &pages {
        for part in parts {
            assert!(text.contains(&format!("\n{part}\n")), "{stem}.md has no {part:?}");
        }
        assert!(
            text.contains(&format!("](../../figures/models/{stem}.svg)")),
            "{stem}.md has no figure"
        );
        let has_live = files.iter().any(|(name, _)| *name == format!("{stem}.json"));
        assert_eq!(
            text.contains(&format!("\n<!-- live: {stem} -->\n")),
            has_live,
            "{stem}.md: its live model"
        );
    }
}

/// What a browser saw of a live model: forces, N, before and after it was moved.
#[derive(serde::Deserialize)]
struct Seen {
    before: f64,
    after: f64,
    message: String,
}

/// As the book makes them: the page that is kept, with the numbers of another model in it.
#[test]
fn every_live_model_moves_in_a_browser() {
    let [browser, modules] = match tools() {
        Ok(found) => found,
        Err(why) => return skip(&why),
    };
    let kept = root().join("docs/figures/models");
    let read = |name: &str| std::fs::read_to_string(kept.join(name)).unwrap();
    let (shell, ems) = (read("live.html"), read("ems.json"));
    assert_eq!(shell.matches(ems.trim()).count(), 1);
    let folder = tempfile::tempdir().unwrap();
    let files = example::files().unwrap();
    let models = files.iter().filter(|(name, _)| name.ends_with(".json"));
    let written = models.map(|(name, text)| {
        let page = folder.path().join(name).with_extension("html");
        std::fs::write(&page, shell.replace(ems.trim(), text.trim())).unwrap();
        page
    });
    let pages: Vec<PathBuf> = written.collect();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/live/drive_models.mjs");
    let mut program = Command::new("node");
    let output = program
        .arg(script)
        .arg(modules.join("node_modules/playwright-core"))
        .arg(browser)
        .args(&pages)
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    let seen: Vec<Seen> =
        serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}\n{errors}"));
    assert_eq!(seen.len(), 11);
    for (page, Seen { before, after, message }) in pages.iter().zip(seen) {
        assert!(message.is_empty(), "{}: {message}", page.display());
        // Pushed a little: the seal holds back with up to its sliding force.
        assert!(
            before == 0.0 && 0.0 < after && after < 6.0,
            "{}: {before} N, {after} N",
            page.display()
        );
    }
}

/// The texts in backticks of the lines that begin so.
fn named<'t>(text: &'t str, begin: &str) -> Vec<&'t str> {
    let paragraphs = text.split("\n- ").map(|one| one.split("\n\n").next().unwrap_or_default());
    let lines = paragraphs.filter(|one| one.starts_with(begin));
    lines.flat_map(|line| line.split('`').skip(1).step_by(2)).collect()
}

#[test]
fn sources_and_tests_that_pages_name_exist() {
    let sources = std::fs::read_to_string(root().join("SOURCES.md")).unwrap();
    for (stem, text) in pages() {
        let keys = named(&text, "**Source**");
        assert!(!keys.is_empty(), "{stem}.md names no source");
        for key in keys {
            let has = [
                format!("**{key}**"),
                format!("| {key} |"),
                format!("| {key},"),
                format!(", {key} |"),
                format!(", {key},"),
            ];
            assert!(
                has.iter().any(|form| sources.contains(form)),
                "{stem}.md: {key} is no key of SOURCES.md"
            );
        }
        let tests = named(&text, "**Tests**");
        assert!(!tests.is_empty(), "{stem}.md names no tests");
        for test in tests {
            // A file, or a function inside of one: `crates/…/file.rs::name`.
            let (file, function) = test.split_once("::").unwrap_or((test, ""));
            let source = std::fs::read_to_string(root().join(file));
            let source = source.unwrap_or_else(|error| panic!("{stem}.md: {file}: {error}"));
            assert!(
                source.contains("#[test]") || source.contains("proptest!"),
                "{stem}.md: {file} has no tests"
            );
            assert!(
                source.contains(&format!("fn {function}")),
                "{stem}.md: {file} has no {function}"
            );
        }
    }
}
