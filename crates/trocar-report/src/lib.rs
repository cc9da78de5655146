//! Reports: figures as data, drawn as SVG, PNG and interactive charts, in one self-contained HTML
//! file.
//!
//! ```text
//! Document -> report.html            one file, no external request, works without JavaScript and on paper
//!          -> figures/<id>.svg .pdf .png  the same figures for a paper (254 dpi)
//! ```
//! **Invariant:** drawing depends on [`Document`] only: it does not estimate, simulate or convert.
//! Only [`identification`], [`comparison`], [`fleet`], [`validation`], [`recording`], `plan` and `teleop` depend on
//! results; they fill documents from them.

mod card;
mod chart;
mod codes;
pub mod comparison;
mod decimate;
mod document;
mod draw;
mod figures;
pub mod fleet;
mod html;
pub mod identification;
mod live;
mod number;
mod pdf;
#[cfg(feature = "bench")]
pub mod plan;
mod publish;
pub mod recording;
mod style;
mod svg;
#[cfg(feature = "bench")]
pub mod teleop;
pub mod validation;
mod view;
mod workflow;

pub use workflow::{workflow_document, write_workflow};

use std::collections::HashSet;
use std::path::Path;

use kuva::backend::png::PngBackend;
use rayon::prelude::*;

use trocar_tables::output::{OutputError, StagedFolder};

pub use document::{
    Axis, Cell, Dimension, Document, Excerpt, Figure, Kind, Knob, LiveModel, LiveTurning, Mark,
    Panel, Role, Section, Series, Table, Tile, Width,
};

/// PNG pixels per scene pixel: 1600 pixels across 160 mm, 254 dpi.
const PNG_SCALE: f32 = 2.5;

/// Figures drawn in parallel; each holds a bitmap of about 6 MB while it is encoded.
const FIGURES_AT_A_TIME: usize = 4;

/// Why a report was not written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReportError {
    /// A figure cannot show what is selected for it.
    #[error("figure {0}")]
    Choice(String),
    /// A document whose parts do not belong together.
    #[error("malformed document: {0}")]
    Malformed(String),
    /// A figure could not be drawn.
    #[error("figure {figure:?} cannot be drawn: {reason}")]
    Drawing {
        /// Id of the figure.
        figure: String,
        /// Error of the drawing library.
        reason: String,
    },
    /// A file could not be written; files of an earlier run are unchanged.
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// Unpacks the fonts of the figures in the background: it takes as long as drawing several figures,
/// and whoever reads and computes first need not wait for it later.
pub fn prepare() {
    rayon::spawn(draw::load_fonts);
}

/// Writes `report.html` and `figures/<id>.svg`, `.pdf` and `.png` into `folder`, which is created if
/// necessary.
///
/// All files appear together or not at all. Equal documents give equal bytes.
///
/// # Errors
/// A malformed document is rejected before anything is written. Writing stops at a file that cannot
/// be written.
pub fn write_document(folder: &Path, document: &Document) -> Result<(), ReportError> {
    check(document)?;
    let staged = StagedFolder::create(folder)?;
    stage_document(&staged, document)?;
    Ok(staged.commit()?)
}

/// Writes the files of [`write_document`] into a folder that the caller commits together with its
/// own files.
///
/// # Errors
/// As for [`write_document`].
pub(crate) fn stage_document(
    folder: &StagedFolder,
    document: &Document,
) -> Result<(), ReportError> {
    check(document)?;
    let figures: Vec<&Figure> = figures(document).collect();
    let drawn = figures.par_iter().map(|figure| {
        let vector = draw_vector(figure)?;
        folder.write(format!("figures/{}.svg", figure.id), vector.file(figure).as_bytes())?;
        let page = pdf::file(&draw::scene(figure, draw::Medium::Vector));
        folder.write(format!("figures/{}.pdf", figure.id), &page)?;
        for_page(figure, &vector)
    });
    let (drawn, ()) =
        rayon::join(|| drawn.collect::<Result<Vec<_>, ReportError>>(), draw::load_fonts);
    let drawn = drawn?;
    // Where there are few cores, none waits for the others.
    let few = rayon::current_num_threads() <= FIGURES_AT_A_TIME;
    let at_a_time = if few { figures.len().max(1) } else { FIGURES_AT_A_TIME };
    let bitmaps = || {
        figures
            .chunks(at_a_time)
            .try_for_each(|some| some.par_iter().try_for_each(|figure| draw_bitmap(folder, figure)))
    };
    let (bitmaps, page) = rayon::join(bitmaps, || page_of(document, &drawn));
    bitmaps?;
    Ok(folder.write("report.html", page?.as_bytes())?)
}

/// Only the page of [`write_document`]: `report.html`, with everything inside.
///
/// # Errors
/// A malformed document, or a figure that cannot be drawn.
pub fn page(document: &Document) -> Result<String, ReportError> {
    check(document)?;
    let figures: Vec<&Figure> = figures(document).collect();
    let drawn = figures
        .par_iter()
        .map(|figure| for_page(figure, &draw_vector(figure)?))
        .collect::<Result<Vec<_>, ReportError>>()?;
    page_of(document, &drawn)
}

fn page_of(document: &Document, drawn: &[html::Drawn]) -> Result<String, ReportError> {
    let styles = chart::styles_json().map_err(|error| drawing_error("styles", error))?;
    let live = document.sections.iter().find_map(live::embed);
    let live = live.transpose().map_err(|error| drawing_error("live", error))?;
    Ok(html::page(document, drawn, &styles, live.as_ref()))
}

/// Only the figures of [`write_document`]: id and SVG of each, in order.
///
/// # Errors
/// As for [`page`].
pub fn vectors(document: &Document) -> Result<Vec<(String, String)>, ReportError> {
    check(document)?;
    let figures: Vec<&Figure> = figures(document).collect();
    figures
        .par_iter()
        .map(|figure| Ok((figure.id.clone(), draw_vector(figure)?.file(figure))))
        .collect()
}

fn figures(document: &Document) -> impl Iterator<Item = &Figure> {
    document.sections.iter().flat_map(|section| &section.figures)
}

fn draw_vector(figure: &Figure) -> Result<svg::Drawing, ReportError> {
    svg::Drawing::new(&draw::scene(figure, draw::Medium::Vector))
        .ok_or_else(|| drawing_error(&figure.id, "the SVG has no opening tag"))
}

fn for_page(figure: &Figure, vector: &svg::Drawing) -> Result<html::Drawn, ReportError> {
    let json = chart::figure_json(figure).map_err(|error| drawing_error(&figure.id, error))?;
    Ok(html::Drawn { svg: vector.inline(figure), json })
}

fn draw_bitmap(folder: &StagedFolder, figure: &Figure) -> Result<(), ReportError> {
    let bitmap = PngBackend::new()
        .with_scale(PNG_SCALE)
        .render_scene(&draw::scene(figure, draw::Medium::Bitmap))
        .map_err(|reason| drawing_error(&figure.id, reason))?;
    Ok(folder.write(format!("figures/{}.png", figure.id), &bitmap)?)
}

fn drawing_error(figure: &str, reason: impl ToString) -> ReportError {
    ReportError::Drawing { figure: figure.to_owned(), reason: reason.to_string() }
}

fn check(document: &Document) -> Result<(), ReportError> {
    fault(document).map_or(Ok(()), |fault| Err(ReportError::Malformed(fault)))
}

/// What is wrong with a document, if anything is.
fn fault(document: &Document) -> Option<String> {
    let mut ids = HashSet::new();
    for figure in figures(document) {
        let id = &figure.id;
        // Ids are names of files.
        let allowed = b"abcdefghijklmnopqrstuvwxyz0123456789-";
        if id.is_empty() || !id.bytes().all(|byte| allowed.contains(&byte)) {
            return Some(format!("figure id {id:?} must consist of a-z, 0-9 and hyphens"));
        }
        if !ids.insert(id) {
            return Some(format!("figure id {id:?} occurs twice"));
        }
        let mut all = figure.panels.iter().flat_map(|panel| &panel.series);
        if let Some(series) = all.find(|series| !series.is_even()) {
            let name = &series.name;
            return Some(format!("figure {id:?}, series {name:?}: columns of different lengths"));
        }
    }
    let mut tables = document.sections.iter().flat_map(|section| &section.tables);
    match tables.find(|table| table.rows.iter().any(|row| row.len() != table.columns.len())) {
        Some(table) => Some(format!("table {:?}: rows of different lengths", table.caption)),
        None => live_fault(document).map(|fault| format!("live model: {fault}")),
    }
}

fn live_fault(document: &Document) -> Option<&'static str> {
    let models: Vec<&LiveModel> =
        document.sections.iter().filter_map(|s| s.live.as_ref()).collect();
    let loops: Vec<_> = document.sections.iter().filter_map(|s| s.live_loop.as_ref()).collect();
    if models.len() + loops.len() > 1 {
        return Some("a document can carry one");
    }
    let mut rows = loops.iter().flat_map(|live| [&live.trocar, &live.compensator]);
    if rows.any(|row| trocar_model::Trocar::from_numbers(row).is_err()) {
        return Some("its row is no model");
    }
    let model = models.first()?;
    let Ok(trocar) = trocar_model::Trocar::from_numbers(&model.row) else {
        return Some("its row is no model");
    };
    let values = trocar.seal().tunables().map(|tunable| tunable.value);
    if !values.eq(model.knobs.iter().map(|knob| knob.value)) {
        return Some("its knobs are not the parameters of its row");
    }
    let Excerpt { position, force, .. } = model.excerpt.as_ref()?;
    let is_complete = position.len() == force.len() && position.len() >= 2;
    (!is_complete).then_some("its excerpt has not as many forces as positions, at least two")
}
