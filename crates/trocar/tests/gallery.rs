//! The pictures of the book, and their page, are those that their command makes.

use std::path::{Path, PathBuf};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use trocar_model::{Element, ElementParams, Trocar};

#[path = "../examples/gallery/main.rs"]
#[allow(dead_code)] // its main
mod example;

const PAGE: &str = include_str!("../../../docs/gallery/index.md");

const AGAIN: &str = "run cargo run --release -p trocar --example gallery -- docs";

fn kept(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/figures").join(name)
}

fn assert_kept(name: &str, made: &str) {
    let is_same = std::fs::read_to_string(kept(name)).is_ok_and(|kept| kept == made);
    assert!(is_same, "docs/figures/{name}: {AGAIN}");
}

#[test]
fn pictures_and_page_are_those_of_the_command() {
    let figures = example::figures(&[]).unwrap();
    assert!(figures.len() >= 25, "{}", figures.len());
    for (name, svg) in example::drawn(&figures).unwrap() {
        assert_kept(&format!("gallery/{name}.svg"), &svg);
    }
    for (name, svg) in example::schematics(&[]).unwrap() {
        assert_kept(&format!("{name}.svg"), &svg);
    }
    assert!(PAGE == example::page(&figures), "docs/gallery/index.md: {AGAIN}");
}

/// Drawn texts of all pictures below a folder.
fn texts(folder: &Path) -> Vec<(PathBuf, String)> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let of = |path: PathBuf| match path.extension() {
        _ if path.is_dir() => texts(&path),
        Some(extension) if extension == "svg" => {
            let svg = std::fs::read_to_string(&path).unwrap();
            svg.split("<text").skip(1).map(|text| (path.clone(), text.to_owned())).collect()
        }
        _ => vec![],
    };
    entries.flat_map(of).collect()
}

#[test]
fn no_text_of_a_picture_is_cut() {
    let all = texts(&kept(""));
    assert!(all.len() > 1000, "{}", all.len());
    for (path, text) in all {
        assert!(!text.contains('…'), "{}: {text}", path.display());
    }
}

fn between<'a>(text: &'a str, begin: &str, end: &str) -> &'a str {
    text.split_once(begin).unwrap_or_else(|| panic!("no {begin}")).1.split_once(end).unwrap().0
}

/// The module in the page is the one whose forces `trocar-web` compares with the library, bit by bit; and the model is the plausible seal.
#[test]
fn the_seal_of_the_first_page_is_that_of_the_command_and_of_the_library() {
    let made = example::moving().unwrap();
    assert_kept("gallery/moving-seal.html", &made);
    let module = STANDARD.decode(between(&made, "<script type=\"application/gzip\">", "</script>"));
    let mut plain = Vec::new();
    std::io::Read::read_to_end(&mut flate2::read::GzDecoder::new(&module.unwrap()[..]), &mut plain)
        .unwrap();
    let artefact = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/report/assets/model.wasm");
    assert_eq!(plain, std::fs::read(artefact).unwrap());
    let json = between(&made, "<script type=\"application/json\">", "</script>");
    let json: serde_json::Value = serde_json::from_str(json).unwrap();
    let bytes = STANDARD.decode(json["row"].as_str().unwrap()).unwrap();
    let numbers = |b: &[u8]| f64::from_le_bytes(b.try_into().unwrap());
    let row: Vec<f64> = bytes.chunks_exact(8).map(numbers).collect();
    let inside = Trocar::from_numbers(&row).unwrap();
    let own = Trocar::of_seal(Element::new(ElementParams::plausible_10_5_mm().unwrap()).unwrap());
    let (mut a, mut b) = (inside.rest(0.0), own.rest(0.0));
    for k in 0..3000 {
        let x = 0.018 * (1.0 - (f64::from(k) / 400.0).cos());
        let (a, b) = (inside.step_to(&mut a, x, 1e-3), own.step_to(&mut b, x, 1e-3));
        assert_eq!(a.to_bits(), b.to_bits(), "step {k}");
    }
    for call in ["fetch(", "XMLHttpRequest", "import(", "http://", "https://"] {
        assert!(!made.contains(call), "{call}");
    }
}
