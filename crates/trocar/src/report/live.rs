//! The live model of the page: its module, its numbers and its recorded motion as text in the page.

use std::io::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::GzEncoder;
use serde::Serialize;

use super::chart::{Codes, inert};
use super::document::{Excerpt, Knob, LiveModel};

/// `crates/trocar-web`, built by its script; a test there compares its forces with those of the
/// library.
const MODULE: &[u8] = include_bytes!("assets/model.wasm");

/// Data of a live model in a page.
pub(super) struct Embedded {
    /// The module, compressed, base64.
    pub(super) module: String,
    /// Numbers, safe inside a script element.
    pub(super) json: String,
}

/// The texts of `model`.
///
/// # Errors
/// None in practice: the data are only written to memory.
pub(super) fn embed(model: &LiveModel) -> Result<Embedded, serde_json::Error> {
    let mut compressed = GzEncoder::new(Vec::new(), Compression::best());
    compressed.write_all(MODULE).map_err(serde_json::Error::io)?;
    let module = STANDARD.encode(compressed.finish().map_err(serde_json::Error::io)?);
    let bytes: Vec<u8> = model.row.iter().flat_map(|number| number.to_le_bytes()).collect();
    let page = Page {
        row: STANDARD.encode(bytes),
        way: model.way,
        knobs: model.knobs.iter().map(PageKnob::from).collect(),
        excerpt: model.excerpt.as_ref().map(PageExcerpt::from),
    };
    Ok(Embedded { module, json: inert(&serde_json::to_string(&page)?) })
}

#[derive(Serialize)]
struct Page<'a> {
    /// 64-bit numbers, little endian, base64: exact, including infinite ones.
    row: String,
    way: [f64; 2],
    knobs: Vec<PageKnob<'a>>,
    excerpt: Option<PageExcerpt<'a>>,
}

#[derive(Serialize)]
struct PageKnob<'a> {
    name: &'a str,
    symbol: &'a str,
    unit: &'a str,
    scale: f64,
    value: f64,
    range: Option<[f64; 2]>,
    interval: Option<[f64; 2]>,
    follows: Option<usize>,
    main: bool,
}

impl<'a> From<&'a Knob> for PageKnob<'a> {
    fn from(knob: &'a Knob) -> Self {
        let Knob { name, symbol, unit, scale, value, range, interval, follows, is_main } = knob;
        Self {
            name,
            symbol,
            unit,
            scale: *scale,
            value: *value,
            range: *range,
            interval: *interval,
            follows: *follows,
            main: *is_main,
        }
    }
}

#[derive(Serialize)]
struct PageExcerpt<'a> {
    name: &'a str,
    interval: f64,
    position: Codes,
    force: Codes,
    known: usize,
}

impl<'a> From<&'a Excerpt> for PageExcerpt<'a> {
    fn from(excerpt: &'a Excerpt) -> Self {
        Self {
            name: &excerpt.name,
            interval: excerpt.interval,
            position: Codes::new(excerpt.position.iter().copied()),
            force: Codes::new(excerpt.force.iter().copied()),
            known: excerpt.known_from,
        }
    }
}
