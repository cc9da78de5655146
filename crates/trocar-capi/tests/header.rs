//! The committed header is the one that the source makes: every function, constant, type, field and
//! status with its words.
//!
//! cbindgen makes the header; where it is installed, it also checks it to the last byte. This test
//! needs nothing installed.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

use skipped::skipped;

#[path = "../../trocar-model/tests/common/skipped.rs"]
mod skipped;

/// A declaration in the tokens of C, and what is said about it.
type Item = (String, String);

const TYPES: [(&str, &str); 16] = [
    ("Model", "trocar_model"),
    ("State", "trocar_state"),
    ("Tunable", "trocar_tunable"),
    ("Status", "trocar_status"),
    ("Compensator", "trocar_compensator"),
    ("CompensatorOptions", "trocar_compensator_options"),
    ("Fault", "trocar_fault"),
    ("Estimate", "trocar_estimate"),
    ("Drift", "trocar_drift"),
    ("c_char", "char"),
    ("f64", "double"),
    ("usize", "size_t"),
    ("i32", "int32_t"),
    ("u32", "uint32_t"),
    ("u64", "uint64_t"),
    ("i64", "int64_t"),
];

fn read(path: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(path)).unwrap()
}

/// Words and signs, one space apart.
fn tokens(text: &str) -> String {
    let spaced: String =
        text.chars()
            .map(|c| {
                if c.is_alphanumeric() || "_.".contains(c) {
                    c.to_string()
                } else {
                    format!(" {c} ")
                }
            })
            .collect();
    spaced.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn c_type(rust: &str) -> String {
    let rust = rust.trim();
    if let Some(inner) = rust.strip_prefix("*mut ") {
        return format!("{} *", c_type(inner));
    }
    if let Some(inner) = rust.strip_prefix("*const ") {
        return format!("const {} *", c_type(inner));
    }
    let known = TYPES.iter().find(|(from, _)| *from == rust);
    known.unwrap_or_else(|| panic!("the test does not know the type {rust}")).1.to_owned()
}

/// `name: type` in C, arrays too.
fn c_variable(rust: &str) -> String {
    let (name, kind) = rust.trim().split_once(": ").unwrap();
    match kind.strip_prefix('[').and_then(|array| array.strip_suffix(']')) {
        Some(array) => {
            let (kind, count) = array.split_once("; ").unwrap();
            format!("{} {name}[{count}]", c_type(kind))
        }
        None => format!("{} {name}", c_type(kind)),
    }
}

fn c_function(signature: &str) -> String {
    let (name, rest) = signature.split_once('(').unwrap();
    let (arguments, result) = rest.rsplit_once(')').unwrap();
    let arguments: Vec<String> =
        arguments.split(',').filter(|part| !part.trim().is_empty()).map(c_variable).collect();
    let arguments = if arguments.is_empty() { "void".to_owned() } else { arguments.join(", ") };
    let result = c_type(result.trim().trim_start_matches("->"));
    format!("{result} {name}({arguments})")
}

/// `name` of the enum called `of`.
fn c_variant(of: &str, name: &str) -> String {
    let parts =
        name.chars().map(|c| if c.is_uppercase() { format!("_{c}") } else { c.to_string() });
    format!("TROCAR_{of}{}", parts.collect::<String>()).to_uppercase()
}

fn from_source(text: &str) -> BTreeSet<Item> {
    let mut items = BTreeSet::new();
    let (mut doc, mut kind) = (Vec::new(), "");
    let mut lines = text.lines().map(str::trim).take_while(|line| *line != "#[cfg(test)]");
    while let Some(line) = lines.next() {
        if let Some(words) = line.strip_prefix("///") {
            doc.push(words.trim());
            continue;
        }
        if line.starts_with("#[") {
            continue;
        }
        let said = std::mem::take(&mut doc).join("\n");
        // The variants of an enum are as public as the enum.
        let is_variant = line.contains(" = ") && line.ends_with(',');
        let line = line.strip_prefix("pub ").unwrap_or(if is_variant { line } else { "" });
        if let Some((_, mut signature)) =
            line.split_once("extern \"C\" fn ").map(|(a, b)| (a, b.to_owned()))
        {
            while !signature.ends_with('{') {
                signature += lines.next().unwrap();
            }
            items.insert((tokens(&c_function(signature.trim_end_matches('{'))), said));
        } else if let Some((name, value)) =
            line.strip_prefix("const ").and_then(|line| line.split_once(": "))
        {
            let value = value.split_once("= ").unwrap().1.trim_end_matches(';');
            items.insert((tokens(&format!("#define TROCAR_{name} {value}")), said));
        } else if line.starts_with("enum ") || line.starts_with("struct ") {
            kind = line.split(' ').nth(1).unwrap();
            items.insert(("type".to_owned(), said));
        } else if let Some((name, number)) =
            line.strip_suffix(',').and_then(|line| line.split_once(" = "))
        {
            items.insert((tokens(&format!("{} = {number}", c_variant(kind, name))), said));
        } else if let Some(field) = line.strip_suffix(',') {
            items.insert((tokens(&c_variable(field)), said));
        }
    }
    items.retain(|(_, said)| !said.is_empty());
    items
}

fn from_header(text: &str) -> BTreeSet<Item> {
    let mut items = BTreeSet::new();
    for part in text.split("/**\n").skip(1) {
        let (said, code) = part.split_once("*/").unwrap();
        let said: Vec<&str> =
            said.lines().map(|line| line.trim().trim_start_matches('*').trim()).collect();
        let said = said.join("\n").trim().to_owned();
        let code = code.trim_start();
        if code.starts_with("enum") || code.starts_with("typedef") {
            items.insert(("type".to_owned(), said));
            continue;
        }
        let first = code.find([',', ';', '(', '\n']).unwrap();
        let end = if code[first..].starts_with('(') { code.find(';').unwrap() } else { first };
        items.insert((tokens(&code[..end]), said));
    }
    items
}

#[test]
fn the_header_says_what_the_source_says() {
    let files = ["lib", "status", "model", "state", "step", "compensator"];
    let source: BTreeSet<Item> =
        files.iter().flat_map(|name| from_source(&read(&format!("src/{name}.rs")))).collect();
    let header = from_header(&read("include/trocar.h"));
    let missing: Vec<_> = source.difference(&header).collect();
    let stale: Vec<_> = header.difference(&source).collect();
    assert!(
        missing.is_empty() && stale.is_empty(),
        "run crates/trocar-capi/header\nnot in the header: {missing:#?}\nonly there: {stale:#?}"
    );
    let functions = header.iter().filter(|(code, _)| code.contains('(')).count();
    assert!(
        functions > 20 && header.len() > 50,
        "read {functions} functions, {} items",
        header.len()
    );
}

#[test]
fn cbindgen_makes_the_same_header() {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("header");
    let ran = match Command::new(&script).arg("--check").output() {
        Ok(ran) if ran.status.code() != Some(2) => ran,
        Ok(ran) => return skipped(&String::from_utf8_lossy(&ran.stderr)),
        Err(error) => return skipped(&error.to_string()),
    };
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stdout));
}
