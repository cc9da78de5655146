//! Reports as one HTML page, and the inputs that they name.

use std::path::Path;

use anyhow::Context;
use trocar::model_file::ModelFile;
use trocar::output::write_whole;
use trocar::report::teleop::Source;
use trocar::report::{self, Document};

use crate::console::BadArgument;
use crate::models::PLAUSIBLE;

/// Refuses standard output for a page.
pub(crate) fn needs_a_file(report: Option<&Path>) -> anyhow::Result<()> {
    if report == Some(Path::new("-")) {
        let text = "--report - : the report is a page and needs a file";
        return Err(BadArgument(text.to_owned()).into());
    }
    Ok(())
}

/// Writes `document` as a page that needs nothing else.
pub(crate) fn write(document: &Document, path: &Path) -> anyhow::Result<()> {
    Ok(write_whole(path, report::page(document)?.as_bytes())?)
}

/// The file at `path`, by its name without its folder.
pub(crate) fn source(path: &Path) -> anyhow::Result<Source> {
    let bytes = std::fs::read(path).with_context(|| path.display().to_string())?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    Ok(Source::new(name, &bytes))
}

/// The model at `path`: a file, the folder of a result, or 'plausible'.
pub(crate) fn model_source(path: &Path, file: &ModelFile) -> anyhow::Result<Source> {
    match path.to_str() {
        Some(PLAUSIBLE) if !path.exists() => Ok(Source::new(PLAUSIBLE, file.to_json().as_bytes())),
        _ if path.is_dir() => source(&path.join("model.json")),
        _ => source(path),
    }
}
