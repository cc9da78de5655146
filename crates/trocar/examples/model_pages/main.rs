//! The figure and the live model of each page of docs/reference/models.
//!
//! ```text
//! cargo run --release -p trocar --example model_pages -- docs/figures/models
//! ```
//! writes `MODEL.svg`, with a force-deflection loop and the response to one reversal, `MODEL.json`, the model that a reader
//! moves, and `live.html`, the page in which the book puts each of them. All seals are made up.

use std::error::Error;
use std::path::Path;

use trocar::report::{Document, LiveModel, Section, page, vectors};

mod draw;
#[path = "../literal_reading/paper_literal.rs"]
mod paper_literal;
mod shown;

use shown::Shown;

/// Range of the instrument that a reader moves, m.
const WAY: [f64; 2] = [0.0, 0.06];

/// Between these stands the model of a page.
const MODEL: [&str; 2] = ["<script type=\"application/json\">", "</script>"];

#[allow(dead_code)] // the test takes what it calls
fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).ok_or("the folder for the files is missing")?;
    let folder = Path::new(&folder);
    std::fs::create_dir_all(folder)?;
    for (name, text) in files()? {
        std::fs::write(folder.join(name), text)?;
    }
    Ok(())
}

/// All files: name and text.
pub(crate) fn files() -> Result<Vec<(String, String)>, Box<dyn Error>> {
    let all = shown::all()?;
    let section = |shown: &Shown| Ok(Section::new(shown.title).figure(draw::figure(shown)?));
    let sections = all.iter().map(section).collect::<Result<_, Box<dyn Error>>>()?;
    let drawn = vectors(&Document { sections, ..Document::default() })?;
    let mut files: Vec<_> = drawn.into_iter().map(|(id, svg)| (format!("{id}.svg"), svg)).collect();
    for shown in &all {
        if let Some(trocar) = shown.live() {
            let page = live_page(LiveModel::of(trocar, WAY)?)?;
            let model = between(&page)?;
            files.push((format!("{}.json", shown.id), format!("{model}\n")));
            if shown.id == "ems" {
                files.push(("live.html".to_owned(), page.clone()));
            }
        }
    }
    Ok(files)
}

/// A page that holds nothing but a model.
fn live_page(model: LiveModel) -> Result<String, Box<dyn Error>> {
    let section = Section::new("The model, live").live(model);
    let title = "The model, live".to_owned();
    Ok(page(&Document { title, sections: vec![section], ..Document::default() })?)
}

/// The model of a page as JSON.
fn between(page: &str) -> Result<&str, Box<dyn Error>> {
    let live = page.split_once("id=\"live\"").ok_or("no live model")?.1;
    let from = live.split_once(MODEL[0]).ok_or("no model")?.1;
    Ok(from.split_once(MODEL[1]).ok_or("a model without an end")?.0)
}
