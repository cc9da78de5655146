//! What README prints of the bench comes out of its own commands.

use std::path::Path;
use std::process::Command;

const README: &str = include_str!("../../../README.md");
const FIRST: &str = "$ trocar bench steady --out steady.csv";

/// Runs a line of the example and returns what it prints.
fn run(folder: &Path, line: &str) -> String {
    let words = line.split('#').next().expect("a command").split_whitespace();
    let arguments = words.skip_while(|word| *word != "trocar").skip(1);
    let output = Command::new(env!("CARGO_BIN_EXE_trocar"))
        .current_dir(folder)
        .args(arguments)
        .output()
        .unwrap();
    assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

/// Words of a line with its numbers apart.
fn words(line: &str) -> (Vec<&str>, Vec<f64>) {
    let parts = line.split([' ', '[', ']', '(', ')', ',']).filter(|part| !part.is_empty());
    let (numbers, words): (Vec<&str>, Vec<&str>) =
        parts.partition(|part| part.parse::<f64>().is_ok());
    (words, numbers.iter().map(|n| n.parse().expect("a number")).collect())
}

/// `cargo run` takes the one program that a member of the workspace names as its own.
#[test]
fn cargo_run_finds_the_program() {
    let said = Command::new(env!("CARGO"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["metadata", "--no-deps", "--format-version", "1", "--locked", "--offline"])
        .output()
        .unwrap();
    let said: serde_json::Value = serde_json::from_slice(&said.stdout).expect("JSON");
    let members = said["workspace_default_members"].as_array().expect("members");
    let packages = said["packages"].as_array().expect("packages").iter();
    let named: Vec<(&str, &str)> = packages
        .filter(|package| members.contains(&package["id"]))
        .filter_map(|package| Some((package["name"].as_str()?, package["default_run"].as_str()?)))
        .collect();
    assert_eq!(named, [("trocar-cli", "trocar")]);
}

#[test]
fn the_example_of_the_bench_prints_what_readme_says() {
    let folder = tempfile::tempdir().unwrap();
    let block = &README[README.find(FIRST).expect("the example")..];
    let mut printed = String::new();
    let mut compared = 0;
    for line in block.lines().take_while(|line| !line.starts_with("$ trocar validate")) {
        if line.starts_with('$') {
            printed = run(folder.path(), line);
        } else if !line.is_empty() {
            let (expected, numbers) = words(line);
            let is_same = |other: &&str| {
                let (words, found) = words(other);
                words == expected && found.len() == numbers.len()
            };
            let own = printed
                .lines()
                .find(is_same)
                .unwrap_or_else(|| panic!("no line like {line:?} in\n{printed}"));
            // Other processors round elsewhere: half a per cent of the number, or a few of the last
            // digits of a small one.
            let near = |(a, b): (&f64, &f64)| (a - b).abs() <= 5e-3 * a.abs() + 1e-4;
            assert!(numbers.iter().zip(&words(own).1).all(near), "README: {line}\nfound:  {own}");
            compared += 1;
        }
    }
    assert!(compared >= 10, "{compared} lines");
}
