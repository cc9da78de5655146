//! The pictures of the book, and their page, are those that their command makes.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use trocar::bench::config::TissueKind;
use trocar_model::{Element, ElementParams, Trocar};

#[path = "../examples/gallery/main.rs"]
#[allow(dead_code)] // its main
mod example;

#[path = "../examples/compensation.rs"]
#[allow(dead_code)] // its main
mod compensation;
#[path = "../examples/literal_reading/main.rs"]
#[allow(dead_code)] // its main
mod literal_reading;

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

#[test]
fn drawings_of_other_commands_are_those_they_make() {
    let made = [
        ("compensation", compensation::document().unwrap()),
        ("literal_reading", literal_reading::document().unwrap()),
    ];
    for (command, document) in made {
        for (id, svg) in trocar::report::vectors(&document).unwrap() {
            let same = std::fs::read_to_string(kept(&format!("{id}.svg"))).unwrap() == svg;
            assert!(
                same,
                "docs/figures/{id}.svg: run cargo run --release -p trocar --example {command} -- docs"
            );
        }
    }
}

#[test]
fn the_errors_of_compensation_in_the_docs_are_those_of_the_command() {
    let page = include_str!("../../../docs/explanation/compensation.md");
    let scores = compensation::scores(TissueKind::HuntCrossley).unwrap();
    let (table, coverage) = (scores.table(), scores.coverage());
    assert!(page.contains(&table), "docs/explanation/compensation.md has not\n{table}");
    // Again beside published errors, and in the gallery.
    let row: Vec<&str> = table.lines().last().unwrap().split('|').map(str::trim).collect();
    let [dry, wet] = [row[2], row[4]];
    assert!(page.contains(&format!("{dry} N rms dry, {wet} N wet")), "{row:?}");
    assert!(PAGE.contains(&format!("{dry} N rms of error dry, {wet} N wet")), "{row:?}");
    let words = page.split_whitespace().collect::<Vec<_>>().join(" ");
    let adaptation = compensation::adaptation(&compensation::adaptation_times().unwrap());
    for sentence in [coverage, adaptation] {
        assert!(words.contains(&sentence), "docs/explanation/compensation.md has not {sentence}");
    }
}

/// A picture that no command makes would go stale unnoticed.
#[test]
fn every_picture_of_the_docs_has_its_command() {
    let mut made: BTreeSet<String> =
        example::schematics(&[]).unwrap().into_iter().map(|(name, _)| name.to_owned()).collect();
    // Compared above, in `teleop_figures`, in `posterior` and in `published`.
    let compared = [
        "compensation",
        "literal-reading",
        "stability-map",
        "displayed-stiffness",
        "sbc",
        "one-reversal",
        "error-by-parameters",
    ];
    made.extend(compared.map(str::to_owned));
    // Made and compared by docs/check, which runs the tutorials.
    for page in std::fs::read_dir(kept("../tutorials")).unwrap() {
        let text = std::fs::read_to_string(page.unwrap().path()).unwrap();
        let names = text.split("](../figures/").skip(1).filter_map(|rest| rest.split_once(".svg)"));
        made.extend(names.map(|(name, _)| name.to_owned()));
    }
    let all = std::fs::read_dir(kept("")).unwrap().map(|entry| entry.unwrap().path());
    let svg = all.filter(|path| path.extension().is_some_and(|own| own == "svg"));
    let all: BTreeSet<String> =
        svg.map(|path| path.file_stem().unwrap().to_string_lossy().into_owned()).collect();
    assert_eq!(all, made, "drawn, and made by a command that a test compares");
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
    let artefact =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../trocar-report/src/assets/model.wasm");
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
