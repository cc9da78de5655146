//! docs/reference/files.md and fleet.md: fields and columns are those of the files that the program writes.
//!
//! Fields of JSON files come from the types that are written, with their documentation; `TROCAR_WRITE_DOCS=1 cargo test -p trocar-cli --test
//! all files_page` writes them between the marks `<!-- fields: SOURCE TYPE -->` and `<!-- end of fields -->`. Columns are compared with
//! the header of a file that the program writes here.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use serde_json::Value;
use syn::{Attribute, Expr, Fields, Item, Lit, Meta};

use crate::common::Place;

const BEGIN: &str = "<!-- fields: ";
const END: &str = "<!-- end of fields -->";

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn page(name: &str) -> String {
    std::fs::read_to_string(root().join("docs/reference").join(name)).expect("the page")
}

/// The documentation of a field or a type, on one line, as the reader of a file knows it.
fn documentation(attributes: &[Attribute], missing: &str) -> String {
    let text = |attribute: &Attribute| match &attribute.meta {
        Meta::NameValue(pair) if pair.path.is_ident("doc") => match &pair.value {
            Expr::Lit(one) => match &one.lit {
                Lit::Str(text) => Some(text.value().trim().to_owned()),
                _ => None,
            },
            _ => None,
        },
        _ => None,
    };
    let lines: Vec<String> = attributes.iter().filter_map(text).collect();
    let text = lines.join(" ").replace("`None`", missing).replace('|', "\\|");
    // Of a link to other documentation the words stay.
    let mut plain = String::new();
    let mut rest = text.as_str();
    while let Some((before, after)) = rest.split_once("[`") {
        let (words, behind) = after.split_once("`]").unwrap_or((after, ""));
        let target = behind.strip_prefix('(').and_then(|inner| inner.split_once(')'));
        plain += &format!("{before}`{words}`");
        rest = target.map_or(behind, |(_, behind)| behind);
    }
    plain + rest
}

/// Fields of a type that is written as JSON: name, whether it may be left out, and what it is.
fn fields(source: &str, name: &str) -> Vec<(String, bool, String)> {
    let text = std::fs::read_to_string(root().join(source)).expect("a source");
    let file = syn::parse_file(&text).expect("a source of Rust");
    let found = file.items.iter().find_map(|item| match item {
        Item::Struct(one) if one.ident == name => Some(one),
        _ => None,
    });
    let Some(Fields::Named(named)) = found.map(|one| &one.fields) else {
        panic!("{source} has no {name} with named fields")
    };
    let serde = |attributes: &[Attribute]| -> String {
        let lists = attributes.iter().filter_map(|one| one.meta.require_list().ok());
        lists.filter(|list| list.path.is_ident("serde")).map(|l| l.tokens.to_string()).collect()
    };
    let field = |field: &syn::Field| {
        let said = serde(&field.attrs);
        assert!(!said.contains("flatten") && !said.contains("rename"), "{source} {name}: {said}");
        let optional = said.contains("skip_serializing_if");
        let missing = if optional { "left out" } else { "`null`" };
        let words = documentation(&field.attrs, missing);
        let own = field.ident.as_ref().expect("it is named").to_string();
        assert!(!words.is_empty(), "{source}: {name}.{own} has no documentation");
        (own, optional, words)
    };
    named.named.iter().map(field).collect()
}

fn table(source: &str, name: &str) -> String {
    let mut text = "\n| field | content |\n|---|---|\n".to_owned();
    for (field, optional, words) in fields(source, name) {
        let note = if optional && !words.contains("left out") { " May be left out." } else { "" };
        // Writing to a String cannot fail, so the result is dropped.
        let _ = writeln!(text, "| `{field}` | {words}{note} |");
    }
    text + "\n"
}

#[test]
fn fields_of_json_files_are_those_of_the_types_that_are_written() {
    let kept = page("files.md");
    let mut parts = kept.split(BEGIN);
    let mut written = parts.next().unwrap_or_default().to_owned();
    let mut count = 0;
    for part in parts {
        let (mark, rest) = part.split_once(" -->").expect("the end of a mark");
        let (source, name) = mark.split_once(' ').expect("a source and a type");
        let (_, after) = rest.split_once(END).expect("the end of the fields");
        written += &format!("{BEGIN}{mark} -->\n{}{END}{after}", table(source, name));
        count += 1;
    }
    assert!(count >= 6, "{count} tables");
    if std::env::var_os("TROCAR_WRITE_DOCS").is_some() {
        std::fs::write(root().join("docs/reference/files.md"), &written).expect("the page");
        return;
    }
    assert!(
        kept == written,
        "docs/reference/files.md: run TROCAR_WRITE_DOCS=1 cargo test -p trocar-cli --test all files_page"
    );
}

/// Names in the first column of the table that follows a line of the page.
fn names_after(text: &str, line: &str) -> BTreeSet<String> {
    let (_, after) = text.split_once(&format!("\n{line}\n")).unwrap_or_else(|| panic!("no {line}"));
    let rows = after.lines().skip_while(|line| !line.starts_with('|')).skip(2);
    let first =
        rows.take_while(|line| line.starts_with('|')).filter_map(|row| row.split('|').nth(1));
    first.flat_map(|cell| cell.split('`').skip(1).step_by(2).map(str::to_owned)).collect()
}

fn header(place: &Place, name: &str) -> BTreeSet<String> {
    let text = std::fs::read_to_string(place.path(name)).unwrap();
    text.lines().next().unwrap().split(',').map(str::to_owned).collect()
}

/// A recording of the bench and a model identified from it.
fn identified() -> Place {
    let place = Place::new();
    std::fs::create_dir_all(place.path("set/specimen=a")).unwrap();
    place.run("bench validation --out set/specimen=a/strokes.csv --seed 1").ends_with(0);
    place.run("identify set/specimen=a/strokes.csv --out found");
    place
}

#[test]
fn columns_of_tables_are_those_of_the_pages() {
    let place = identified();
    place.run("fleet set --out fleet.csv");
    let found = header(&place, "fleet.csv");
    // Each parameter has four columns, which the page describes once; metadata are those of the data set.
    let of_parameter = |name: &&String| {
        found.iter().any(|one| {
            name.strip_prefix(one.as_str())
                .is_some_and(|end| ["", "_lower", "_upper", "_determined"].contains(&end))
                && found.contains(&format!("{one}_determined"))
        })
    };
    let (parameters, mut columns): (BTreeSet<&String>, BTreeSet<&String>) =
        found.iter().partition(of_parameter);
    assert!(parameters.len() > 100 && parameters.len() % 4 == 0, "{}", parameters.len());
    assert!(columns.remove(&"specimen".to_owned()));
    let fleet = names_after(&page("fleet.md"), "## Columns");
    let described = ["<parameter>", "_lower", "_upper", "_determined"];
    assert!(described.iter().all(|name| fleet.contains(*name)));
    assert_eq!(
        fleet.iter().filter(|n| !described.contains(&n.as_str())).collect::<BTreeSet<_>>(),
        columns
    );
}

#[test]
fn fields_of_json_files_and_headers_are_those_that_the_program_writes() {
    let place = identified();
    place.run("simulate found/model.json set/specimen=a/strokes.csv --out simulated.csv");
    place.run("compensate found/model.json set/specimen=a/strokes.csv --out compensated.csv");
    let kept = page("files.md");
    for name in ["simulated.csv", "compensated.csv"] {
        let text = std::fs::read_to_string(place.path(name)).unwrap();
        let header = text.lines().next().unwrap();
        assert!(kept.contains(&format!("`{header}`")), "docs/reference/files.md has no {header}");
    }
    place.run("compare set/specimen=a/strokes.csv --models ems,coulomb --out compared");
    let loop_of = place.run("teleop --model plausible --json").stdout;
    let read = |name: &str| std::fs::read_to_string(place.path(name)).unwrap();
    for (text, source) in [
        (read("found/summary.json"), "crates/trocar-lab/src/summary.rs"),
        (read("compared/compare.json"), "crates/trocar-lab/src/compare/summary.rs"),
        (loop_of, "crates/trocar-lab/src/teleop/study.rs"),
    ] {
        let json: Value = serde_json::from_str(&text).unwrap();
        let keys: BTreeSet<&String> = json.as_object().unwrap().keys().collect();
        let fields = fields(source, "Summary");
        let all: BTreeSet<&String> = fields.iter().map(|(name, ..)| name).collect();
        let always: BTreeSet<&String> =
            fields.iter().filter(|(_, optional, _)| !optional).map(|(name, ..)| name).collect();
        assert!(keys.is_subset(&all) && always.is_subset(&keys), "{source}: {keys:?}");
    }
}
