//! What several functions take or give.

use std::path::PathBuf;

use pyo3::prelude::*;
use trocar::output::{StagedFolder, write_whole};
use trocar::report::{self, Document, ReportError};
use trocar::workflow::MovingMass;

use crate::errors::{MotionError, ParameterError, Raise, number};
use crate::work::{How, attempt};

/// A declared moving mass.
pub(crate) fn moving_mass(mass: f64, gravity: f64) -> PyResult<MovingMass> {
    MovingMass::new(mass, gravity).map_err(Raise::raise)
}

pub(crate) fn finite(name: &str, value: f64, unit: &str) -> PyResult<()> {
    value.is_finite().then_some(()).ok_or_else(|| {
        ParameterError::new_err(format!("{name} must be finite, got {} {unit}", number(value)))
    })
}

/// Refuses a column that has not a sample for each time.
pub(crate) fn beside_times(name: &str, found: usize, expected: usize) -> PyResult<()> {
    (found == expected).then_some(()).ok_or_else(|| {
        MotionError::new_err(format!(
            "{name} has {found} samples, expected {expected} as time_s has"
        ))
    })
}

/// A figure: name, title, caption, SVG.
pub(crate) type Picture = (String, String, String, String);

/// The figures of a document, drawn off the lock.
pub(crate) fn figures(
    py: Python<'_>,
    document: impl FnOnce() -> Document + Send + 'static,
) -> PyResult<Vec<Picture>> {
    attempt(py, How::default(), move |_| -> Result<_, ReportError> {
        let document = document();
        let svgs = report::vectors(&document)?;
        let figures = document.sections.into_iter().flat_map(|section| section.figures);
        Ok(figures
            .zip(svgs)
            .map(|(figure, (id, svg))| (id, figure.title, figure.caption, svg))
            .collect())
    })
}

/// Writes the page of a document to `path`, made off the lock; the file appears whole or not at
/// all.
pub(crate) fn write_page(
    py: Python<'_>,
    path: PathBuf,
    document: impl FnOnce() -> Document + Send + 'static,
) -> PyResult<()> {
    attempt(py, How::default(), move |_| -> Result<(), ReportError> {
        Ok(write_whole(&path, report::page(&document())?.as_bytes())?)
    })
}

/// Writes a folder, off the lock; its files appear together or not at all.
pub(crate) fn write_folder(
    py: Python<'_>,
    folder: PathBuf,
    write: impl FnOnce(&StagedFolder) -> Result<(), ReportError> + Send + 'static,
) -> PyResult<()> {
    attempt(py, How::default(), move |_| -> Result<(), ReportError> {
        let staged = StagedFolder::create(&folder)?;
        write(&staged)?;
        Ok(staged.commit()?)
    })
}
