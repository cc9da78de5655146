//! docs/reference/model-file.md: the fields of `model.json`, from its schema.
//!
//! `TROCAR_WRITE_DOCS=1 cargo test -p trocar-cli --test all model_file_page` writes the page.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

const SCHEMA: &str = include_str!("../../../schema/model.schema.json");

const HEAD: &str = "# The model file

`model.json` holds one model, and every interface reads it: the command line, Python, C, the FMU export and the exported C source.
`trocar identify` writes it, `trocar compare` writes one for each model, and it can be written by hand. It is JSON in UTF-8. All numbers
are in SI units, and the name of a field carries its unit. Position and force are positive on insertion; the force is that of the
instrument on the seal.

The tables are made from the [JSON Schema](../../schema/model.schema.json), with which any validator checks a file. A program that
reads a file checks more: that the branches of a deformation meet their ends, for example. Its messages are listed in
[troubleshooting](../troubleshooting.md#model-files-and-parameters). A field in **bold** is required, and a field that is not listed is refused.
";

fn path() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/reference/model-file.md")
}

fn page() -> String {
    let schema: Value = serde_json::from_str(SCHEMA).expect("the schema is JSON");
    let mut text = HEAD.to_owned();
    section(&mut text, "The file", &schema);
    for (name, definition) in schema["$defs"].as_object().expect("definitions") {
        section(&mut text, name, definition);
    }
    text
}

/// An object, or the elements of an array of objects, as a table of its fields.
fn section(text: &mut String, title: &str, of: &Value) {
    let object = if of["items"].is_object() { &of["items"] } else { of };
    let Some(fields) = object["properties"].as_object() else { panic!("{title} has no fields") };
    // Writing to a String cannot fail, so the results are dropped.
    let _ = writeln!(text, "\n## {title}\n");
    if let Some(description) = of["description"].as_str() {
        let _ = writeln!(text, "{}\n", escaped(description));
    }
    text.push_str("| field | unit | meaning | values |\n|---|---|---|---|\n");
    rows(text, "", object, fields);
}

/// The fields, with those of objects inside below them.
fn rows(text: &mut String, prefix: &str, object: &Value, fields: &Map<String, Value>) {
    let required = object["required"].as_array();
    for (name, field) in fields.iter().filter(|(_, field)| field.is_object()) {
        let is_required = required.is_some_and(|all| all.iter().any(|one| one == name));
        let bold = if is_required { "**" } else { "" };
        let meaning = field["description"].as_str().map_or_else(|| reference(field), escaped);
        assert!(
            !meaning.is_empty() || field["const"].is_string(),
            "{prefix}{name} has no description"
        );
        let (unit, values) = (unit(name), values(field));
        let _ = writeln!(text, "| {bold}`{prefix}{name}`{bold} | {unit} | {meaning} | {values} |");
        let is_list = field["items"].is_object();
        let inner = if is_list { &field["items"] } else { field };
        if let Some(fields) = inner["properties"].as_object().filter(|_| field["oneOf"].is_null()) {
            let dots = if is_list { "[]." } else { "." };
            rows(text, &format!("{prefix}{name}{dots}"), inner, fields);
        }
    }
}

fn escaped(text: &str) -> String {
    text.replace('|', "\\|").replace('*', "\\*").replace('_', "\\_")
}

/// Where a field is described that has the form of something else.
fn reference(field: &Value) -> String {
    let link = |one: &Value| {
        let name = one["$ref"].as_str()?.rsplit('/').next()?;
        Some(format!("[{name}](#{})", name.replace('_', "-")))
    };
    link(field).map(|link| format!("see {link}")).unwrap_or_default()
}

/// The unit at the end of a name.
fn unit(name: &str) -> &'static str {
    const UNITS: [(&str, &str); 12] = [
        ("_n_s3_m3", "N s³/m³"),
        ("_n_s2_m2", "N s²/m²"),
        ("_n_s_m", "N s/m"),
        ("_n_m", "N/m"),
        ("_m_s", "m/s"),
        ("_hz", "Hz"),
        ("_per_pa", "1/Pa"),
        ("_kg", "kg"),
        ("_n", "N"),
        ("_m", "m"),
        ("_s", "s"),
        ("_percent", "%"),
    ];
    UNITS.iter().find(|(ending, _)| name.ends_with(ending)).map_or("", |(_, unit)| unit)
}

/// The type and range of a field.
fn values(field: &Value) -> String {
    let code =
        |value: &Value| format!("`{}`", value.as_str().map_or(value.to_string(), str::to_owned));
    if !field["const"].is_null() {
        return code(&field["const"]);
    }
    if let Some(all) = field["enum"].as_array() {
        return all.iter().map(code).collect::<Vec<_>>().join(", ");
    }
    if let Some(forms) = field["oneOf"].as_array() {
        return forms
            .iter()
            .map(|one| reference(one).replace("see ", ""))
            .collect::<Vec<_>>()
            .join(", ");
    }
    if field["items"].is_object() {
        let of = match field["items"]["$ref"].as_str() {
            Some(_) => reference(&field["items"]).replace("see ", ""),
            None => values(&field["items"]),
        };
        let count = match (field["minItems"].as_u64(), field["maxItems"].as_u64()) {
            (Some(least), Some(most)) if least == most => format!("{least} × "),
            (Some(least), Some(most)) => format!("{least} to {most} × "),
            (None, Some(most)) => format!("up to {most} × "),
            _ => "list of ".to_owned(),
        };
        return format!("{count}{of}");
    }
    let types = match &field["type"] {
        Value::Array(all) => all.iter().filter_map(Value::as_str).collect::<Vec<_>>().join(" or "),
        one => one.as_str().unwrap_or_default().to_owned(),
    };
    let bounds = [("minimum", "≥"), ("exclusiveMinimum", ">"), ("maximum", "≤")];
    let bounds = bounds.iter().filter(|(key, _)| field[*key].is_number());
    let bounds = bounds.map(|(key, sign)| format!(" {sign} {}", field[*key])).collect::<String>();
    format!("{types}{bounds}")
}

#[test]
fn the_page_is_the_schema() {
    let written = page();
    if std::env::var_os("TROCAR_WRITE_DOCS").is_some() {
        std::fs::write(path(), &written).expect("the page");
    }
    let kept = std::fs::read_to_string(path()).unwrap_or_default();
    let differs = written.lines().zip(kept.lines()).find(|(own, kept)| own != kept);
    assert!(
        written == kept,
        "docs/reference/model-file.md is not the schema, first {differs:#?}\n\
         run TROCAR_WRITE_DOCS=1 cargo test -p trocar-cli --test all model_file_page"
    );
}
