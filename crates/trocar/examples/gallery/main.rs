//! The pictures of the book: docs/figures/gallery, and the seal that moves on its first page.
//!
//! ```text
//! cargo run --release -p trocar --example gallery -- FOLDER [PICTURE ...]
//! ```
//! writes `FOLDER/PICTURE.svg` for each picture named, or all of them. The seal is `moving-seal`, an HTML fragment. Everything
//! is made anew from seeds, the same bytes every time.

use std::error::Error;
use std::path::Path;

use trocar::report::{Document, Figure, Section, moving_seal, vectors};
use trocar_model::ElementParams;

mod bench;
mod loops;
mod many;
mod seal;

pub(crate) type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

/// The fragment with the seal that moves.
pub(crate) const MOVING: &str = "moving-seal";

/// Pictures that are made together, and what makes them.
type Group = (&'static [&'static str], fn() -> Outcome<Vec<Figure>>);

/// All groups, in the order of the page.
const GROUPS: [Group; 7] = [
    (&seal::PICTURES, seal::figures),
    (&bench::IDENTIFIED, bench::identified),
    (&bench::COMPARED, bench::compared),
    (&bench::DRAWN, bench::drawn),
    (&many::PICTURES, many::figures),
    (&many::FLEET, many::fleet),
    (&loops::PICTURES, loops::figures),
];

/// Names of all pictures.
#[allow(dead_code)] // the test asks
pub(crate) fn names() -> impl Iterator<Item = &'static str> {
    GROUPS.iter().flat_map(|(names, _)| *names).copied()
}

/// The pictures of `wanted`, or all: name and SVG.
pub(crate) fn pictures(wanted: &[String]) -> Outcome<Vec<(String, String)>> {
    let is_wanted = |name: &str| wanted.is_empty() || wanted.iter().any(|own| own == name);
    let mut figures = Vec::new();
    for (names, make) in GROUPS {
        if names.iter().any(|name| is_wanted(name)) {
            let made = make()?;
            let made_names: Vec<&str> = made.iter().map(|figure| figure.id.as_str()).collect();
            if made_names != *names {
                return Err(format!("{made_names:?} were made, not {names:?}").into());
            }
            figures.extend(made.into_iter().filter(|figure| is_wanted(&figure.id)));
        }
    }
    let sections = figures.into_iter().map(|figure| Section::new("").figure(figure)).collect();
    Ok(vectors(&Document { sections, ..Document::default() })?)
}

/// The seal of the first page.
pub(crate) fn moving() -> Outcome<String> {
    Ok(moving_seal(&ElementParams::plausible_10_5_mm()?)?)
}

#[allow(dead_code)] // the test takes what it calls
fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().ok_or("the folder for the pictures is missing")?;
    let wanted: Vec<String> = arguments.collect();
    if let Some(name) = wanted.iter().find(|name| **name != MOVING && !names().any(|n| n == **name)) {
        let all: Vec<&str> = names().collect();
        return Err(format!("there is no picture {name}, only {MOVING}, {}", all.join(", ")).into());
    }
    let folder = Path::new(&folder);
    std::fs::create_dir_all(folder)?;
    if wanted.is_empty() || wanted.iter().any(|name| name == MOVING) {
        std::fs::write(folder.join(MOVING).with_extension("html"), moving().map_err(plain)?)?;
    }
    if wanted.iter().any(|name| name != MOVING) || wanted.is_empty() {
        for (name, svg) in pictures(&wanted).map_err(plain)? {
            std::fs::write(folder.join(name).with_extension("svg"), svg)?;
        }
    }
    Ok(())
}

fn plain(error: Box<dyn Error + Send + Sync>) -> Box<dyn Error> {
    error
}

/// Named columns over a common abscissa, with every `step`th value.
pub(crate) fn thinned(values: &[f64], step: usize, scale: f64) -> Vec<f64> {
    values.iter().step_by(step).map(|value| scale * value).collect()
}

/// The figures of a document by their ids, with the names they have here.
pub(crate) fn chosen(document: Document, ids: &[(&str, &str)]) -> Outcome<Vec<Figure>> {
    let mut figures: Vec<Figure> =
        document.sections.into_iter().flat_map(|section| section.figures).collect();
    ids.iter()
        .map(|(id, name)| {
            let at = figures.iter().position(|figure| figure.id == *id);
            let mut figure = figures.swap_remove(at.ok_or_else(|| format!("no figure {id}"))?);
            figure.id = (*name).to_owned();
            Ok(figure)
        })
        .collect()
}
