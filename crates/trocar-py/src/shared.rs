//! What several functions take or give.

use std::io::Write as _;
use std::path::PathBuf;

use pyo3::prelude::*;
use trocar::output::AtomicFile;
use trocar::report::{self, Document};
use trocar::workflow::MovingMass;

use crate::errors::number;
use crate::errors::{ParameterError, Raise};
use crate::work::{How, run};

/// A declared moving mass.
pub(crate) fn moving_mass(mass: f64, gravity: f64) -> PyResult<MovingMass> {
    not_negative("moving_mass_kg", mass, "kg")?;
    finite("gravity_m_s2", gravity, "m/s^2")?;
    MovingMass::new(mass, gravity).map_err(|error| ParameterError::new_err(error.to_string()))
}

pub(crate) fn finite(name: &str, value: f64, unit: &str) -> PyResult<()> {
    let wrong =
        || ParameterError::new_err(format!("{name} must be finite, got {} {unit}", number(value)));
    value.is_finite().then_some(()).ok_or_else(wrong)
}

pub(crate) fn not_negative(name: &str, value: f64, unit: &str) -> PyResult<()> {
    let wrong = || {
        ParameterError::new_err(format!(
            "{name} must be finite and not negative, got {} {unit}",
            number(value)
        ))
    };
    (value.is_finite() && value >= 0.0).then_some(()).ok_or_else(wrong)
}

/// A figure: name, title, caption, SVG.
pub(crate) type Picture = (String, String, String, String);

/// The figures of a document, drawn off the lock.
pub(crate) fn figures(
    py: Python<'_>,
    document: impl FnOnce() -> Document + Send + 'static,
) -> PyResult<Vec<Picture>> {
    let draw = move || {
        let document = document();
        let svgs = report::vectors(&document)?;
        let figures = document.sections.into_iter().flat_map(|section| section.figures);
        Ok(figures
            .zip(svgs)
            .map(|(figure, (id, svg))| (id, figure.title, figure.caption, svg))
            .collect())
    };
    run(py, How::default(), move |_| draw())?.map_err(|error: report::ReportError| error.raise())
}

/// Writes the page of a document to `path`, made off the lock; the file appears whole or not at
/// all.
pub(crate) fn write_page(
    py: Python<'_>,
    path: PathBuf,
    document: impl FnOnce() -> Document + Send + 'static,
) -> PyResult<()> {
    let write = move || {
        let page = report::page(&document())?;
        let mut file = AtomicFile::create(&path)?;
        let outcome = file.write_all(page.as_bytes());
        outcome.map_err(|source| file.write_error(source))?;
        Ok(file.commit()?)
    };
    run(py, How::default(), move |_| write())?.map_err(|error: report::ReportError| error.raise())
}
