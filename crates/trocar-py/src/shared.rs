//! What several functions take or give.

use std::path::PathBuf;

use pyo3::prelude::*;
use trocar::output::write_whole;
use trocar::report::{self, Document};
use trocar::workflow::MovingMass;

use crate::errors::number;
use crate::errors::{ParameterError, Raise};
use crate::work::{How, run};

/// A declared moving mass.
pub(crate) fn moving_mass(mass: f64, gravity: f64) -> PyResult<MovingMass> {
    MovingMass::new(mass, gravity).map_err(Raise::raise)
}

pub(crate) fn finite(name: &str, value: f64, unit: &str) -> PyResult<()> {
    value.is_finite().then_some(()).ok_or_else(|| {
        ParameterError::new_err(format!("{name} must be finite, got {} {unit}", number(value)))
    })
}

/// A figure: name, title, caption, SVG.
pub(crate) type Picture = (String, String, String, String);

/// The figures of a document, drawn off the lock.
pub(crate) fn figures(
    py: Python<'_>,
    document: impl FnOnce() -> Document + Send + 'static,
) -> PyResult<Vec<Picture>> {
    let drawn = run(py, How::default(), move |_| {
        let document = document();
        let svgs = report::vectors(&document)?;
        let figures = document.sections.into_iter().flat_map(|section| section.figures);
        Ok(figures
            .zip(svgs)
            .map(|(figure, (id, svg))| (id, figure.title, figure.caption, svg))
            .collect())
    });
    drawn?.map_err(|error: report::ReportError| error.raise())
}

/// Writes the page of a document to `path`, made off the lock; the file appears whole or not at
/// all.
pub(crate) fn write_page(
    py: Python<'_>,
    path: PathBuf,
    document: impl FnOnce() -> Document + Send + 'static,
) -> PyResult<()> {
    let written = run(py, How::default(), move |_| {
        Ok(write_whole(&path, report::page(&document())?.as_bytes())?)
    });
    written?.map_err(|error: report::ReportError| error.raise())
}
