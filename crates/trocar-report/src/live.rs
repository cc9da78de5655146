//! The live model, or the live loop, of the page: its module and its numbers as text in the page.

use std::io::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::GzEncoder;
use serde::Serialize;

use super::chart::inert;
use super::document::Section;

/// `crates/trocar-web`, built by its script; a test there compares its forces with those of the
/// library.
const MODEL: &[u8] = include_bytes!("assets/model.wasm");
/// `crates/trocar-web-teleop`, the same of the loop.
const LOOP: &[u8] = include_bytes!("assets/teleop.wasm");

const HANDLE_SCRIPT: &str = include_str!("assets/handle.js");
const RUNNER_SCRIPT: &str = include_str!("assets/model.js");
const MODEL_SCRIPT: &str = include_str!("assets/live.js");
/// For models with rotation alone.
const TURNING_SCRIPT: &str = include_str!("assets/turning.js");
const LOOP_SCRIPT: &str = include_str!("assets/teleop.js");

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

/// The texts of the live model or loop of a section, if it has one.
///
/// # Errors
/// None in practice: the data are only written to memory.
pub(super) fn embed(section: &Section) -> Option<Result<Embedded, serde_json::Error>> {
    let model = section.live.as_ref().map(|model| {
        let turning = model.turning.as_ref().map_or("", |_| TURNING_SCRIPT);
        let scripts = [HANDLE_SCRIPT, RUNNER_SCRIPT, turning, MODEL_SCRIPT];
        embedded("the identified model", &scripts, MODEL, model)
    });
    model.or_else(|| {
        let live = section.live_loop.as_ref()?;
        Some(embedded("the loop", &[HANDLE_SCRIPT, LOOP_SCRIPT], LOOP, live))
    })
}

fn embedded(
    what: &'static str,
    scripts: &[&'static str],
    module: &[u8],
    numbers: &impl Serialize,
) -> Result<Embedded, serde_json::Error> {
    let json = inert(&serde_json::to_string(numbers)?);
    Ok(Embedded { what, scripts: scripts.to_vec(), module: compressed(module)?, json })
}

fn compressed(module: &[u8]) -> Result<String, serde_json::Error> {
    let mut compressed = GzEncoder::new(Vec::new(), Compression::best());
    compressed.write_all(module).map_err(serde_json::Error::io)?;
    Ok(STANDARD.encode(compressed.finish().map_err(serde_json::Error::io)?))
}
