//! Reports: figures as data, drawn as SVG, PNG and interactive charts, in one self-contained HTML file.
//!
//! ```text
//! Document -> report.html            one file, no external request, works without JavaScript and on paper
//!          -> figures/<id>.svg .png  the same figures for a paper (305 dpi at 160 mm)
//! ```
//! **Invariant:** this module draws what it is given; it estimates, simulates and converts nothing.

mod document;

pub use document::{
    Axis, Cell, DEFAULT_ASPECT, Document, Figure, Kind, Mark, Panel, Parameter, Role, Section,
    Series, Table, Tile, Width,
};
