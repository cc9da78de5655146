//! The live model, or the live loop, of the page: its module and its numbers as text in the page.

use std::io::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::GzEncoder;
use serde::Serialize;

use super::chart::{Codes, inert};
use super::document::{Excerpt, Knob, LiveLoop, LiveModel};

/// `crates/trocar-web`, built by its script; a test there compares its forces with those of the
/// library.
const MODEL: &[u8] = include_bytes!("assets/model.wasm");
/// `crates/trocar-web-teleop`, the same of the loop.
const LOOP: &[u8] = include_bytes!("assets/teleop.wasm");

const HANDLE_SCRIPT: &str = include_str!("assets/handle.js");
const RUNNER_SCRIPT: &str = include_str!("assets/model.js");
const MODEL_SCRIPT: &str = include_str!("assets/live.js");
const LOOP_SCRIPT: &str = include_str!("assets/teleop.js");

/// What moves a model in a page, before the script that draws it.
const MODEL_SCRIPTS: [&str; 2] = [HANDLE_SCRIPT, RUNNER_SCRIPT];

/// Data of a live model or loop in a page.
pub(super) struct Embedded {
    /// What runs there, in words.
    pub(super) what: &'static str,
    /// What is added to the script of the page.
    pub(super) scripts: Vec<&'static str>,
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
    let page = Page {
        row: encoded(&model.row),
        way: model.way,
        knobs: model.knobs.iter().map(PageKnob::from).collect(),
        excerpt: model.excerpt.as_ref().map(PageExcerpt::from),
    };
    Ok(Embedded {
        what: "the identified model",
        scripts: [&MODEL_SCRIPTS[..], &[MODEL_SCRIPT]].concat(),
        module: module()?,
        json: inert(&serde_json::to_string(&page)?),
    })
}

/// The texts of `live`.
///
/// # Errors
/// A configuration that is no JSON.
pub(super) fn embed_loop(live: &LiveLoop) -> Result<Embedded, serde_json::Error> {
    let [trocar, compensator] = live.models.each_ref().map(|row| encoded(row));
    let config = serde_json::from_str(&live.config)?;
    let page = LoopPage { config, trocar, compensator, start: live.start, way: live.way };
    Ok(Embedded {
        what: "the loop",
        scripts: vec![HANDLE_SCRIPT, LOOP_SCRIPT],
        module: compressed(LOOP)?,
        json: inert(&serde_json::to_string(&page)?),
    })
}

/// The module of models, compressed, base64.
///
/// # Errors
/// None in practice, as above.
fn module() -> Result<String, serde_json::Error> {
    compressed(MODEL)
}

fn compressed(module: &[u8]) -> Result<String, serde_json::Error> {
    let mut compressed = GzEncoder::new(Vec::new(), Compression::best());
    compressed.write_all(module).map_err(serde_json::Error::io)?;
    Ok(STANDARD.encode(compressed.finish().map_err(serde_json::Error::io)?))
}

/// 64-bit numbers, little endian, base64: exact, including infinite ones.
fn encoded(row: &[f64]) -> String {
    let bytes: Vec<u8> = row.iter().flat_map(|number| number.to_le_bytes()).collect();
    STANDARD.encode(bytes)
}

#[derive(Serialize)]
struct LoopPage {
    config: serde_json::Value,
    trocar: String,
    compensator: String,
    start: f64,
    way: [f64; 2],
}

#[derive(Serialize)]
struct Page<'a> {
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
