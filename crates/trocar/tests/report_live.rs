//! The model that runs in the page: its data in the document, and rejected models.

use std::io::Read as _;
use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use flate2::read::GzDecoder;
use trocar::report::{Document, Excerpt, Knob, LiveModel, ReportError, Section, write_document};
use trocar_model::{Element, ElementParams, Trocar};

const HOSTILE: &str = "</script><script>alert(1)</script>";

/// The plausible seal with a recorded motion of two samples.
fn model() -> LiveModel {
    let trocar =
        Trocar::of_seal(Element::new(ElementParams::plausible_10_5_mm().unwrap()).unwrap());
    let mut row = vec![0.0; trocar.count_numbers()];
    trocar.write_numbers(&mut row).unwrap();
    let knob = |tunable: trocar_model::Tunable| Knob {
        name: HOSTILE.to_owned(),
        symbol: String::new(),
        unit: tunable.id.unit().si.to_owned(),
        scale: 1.0,
        value: tunable.value,
        range: None,
        interval: None,
        follows: None,
        is_main: true,
    };
    let excerpt = Excerpt {
        name: HOSTILE.to_owned(),
        interval: 1e-3,
        position: vec![0.0, 1e-3],
        force: vec![0.0, 0.25],
        angle: Vec::new(),
        known_from: 0,
    };
    LiveModel {
        row,
        knobs: trocar.seal().tunables().map(knob).collect(),
        way: [0.0, 0.05],
        excerpt: Some(excerpt),
        turning: None,
    }
}

fn document(models: impl IntoIterator<Item = LiveModel>) -> Document {
    let section = |live| Section::new("live").live(live);
    Document {
        title: "A seal".to_owned(),
        sections: models.into_iter().map(section).collect(),
        ..Document::default()
    }
}

fn page(document: &Document) -> Result<String, ReportError> {
    let folder = tempfile::tempdir().unwrap();
    write_document(folder.path(), document)?;
    Ok(std::fs::read_to_string(folder.path().join("report.html")).unwrap())
}

fn between<'a>(text: &'a str, begin: &str, end: &str) -> &'a str {
    text.split_once(begin).unwrap_or_else(|| panic!("no {begin}")).1.split_once(end).unwrap().0
}

#[test]
fn the_page_holds_the_module_and_the_row_to_the_bit() {
    let model = model();
    let page = page(&document([model.clone()])).unwrap();
    let live = &page[page.find("<div id=\"live\"").unwrap()..];
    let compressed =
        STANDARD.decode(between(live, "<script type=\"application/gzip\">", "</script>")).unwrap();
    let mut module = Vec::new();
    GzDecoder::new(&compressed[..]).read_to_end(&mut module).unwrap();
    let artefact =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../trocar-report/src/assets/model.wasm");
    assert_eq!(module, std::fs::read(artefact).unwrap());
    let json: serde_json::Value =
        serde_json::from_str(between(live, "<script type=\"application/json\">", "</script>"))
            .unwrap();
    let row: Vec<u8> = STANDARD.decode(json["row"].as_str().unwrap()).unwrap();
    assert_eq!(row, model.row.iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<u8>>());
    assert_eq!(json["knobs"][0]["name"], HOSTILE);
    assert_eq!(page.matches("alert(1)").count(), 16, "names inside strings alone");
    assert!(!page.contains("<script>alert"));
}

#[test]
fn only_a_page_with_a_model_may_run_a_module_and_none_asks_the_network() {
    let (with, without) = (page(&document([model()])).unwrap(), page(&document([])).unwrap());
    for (page, has_model) in [(&with, true), (&without, false)] {
        assert_eq!(page.contains("'wasm-unsafe-eval'"), has_model);
        assert_eq!(page.contains("WebAssembly.instantiate"), has_model);
        assert!(page.contains("default-src 'none'"));
        for call in ["fetch(", "XMLHttpRequest", "import(", "localStorage", "eval("] {
            assert!(!page.contains(call), "{call}");
        }
    }
    assert!(without.len() + 90_000 > with.len(), "{} bytes more", with.len() - without.len());
}

#[test]
fn equal_documents_give_equal_bytes() {
    assert_eq!(page(&document([model()])).unwrap(), page(&document([model()])).unwrap());
}

#[test]
fn without_script_a_sentence_stands_in_its_place() {
    let page = page(&document([model()])).unwrap();
    assert!(
        between(&page, "<p class=\"live-absent\">", "</p>").contains("JavaScript and WebAssembly")
    );
}

#[test]
fn numbers_that_do_not_belong_together_are_refused() {
    let refused = |change: &dyn Fn(&mut LiveModel)| {
        let mut wrong = model();
        change(&mut wrong);
        let error = page(&document([wrong])).unwrap_err().to_string();
        error.trim_start_matches("malformed document: ").to_owned()
    };
    assert_eq!(refused(&|model| model.row[0] = 7.0), "live model: its row is no model");
    let knobs = "live model: its knobs are not the parameters of its row";
    assert_eq!(refused(&|model| model.knobs[1].value *= 2.0), knobs);
    assert_eq!(refused(&|model| model.knobs.truncate(3)), knobs);
    let excerpt = "live model: its excerpt has not as many forces as positions, at least two";
    assert_eq!(refused(&|model| model.excerpt.as_mut().unwrap().force.push(1.0)), excerpt);
    assert_eq!(
        page(&document([model(), model()])).unwrap_err().to_string(),
        "malformed document: live model: a document can carry one"
    );
}
