//! Creates the figure of a recording.

use super::document::{Axis, Document, Figure, Role, Section};
use super::figures::{MM, line, over_time};
use trocar_recording::Recording;

/// Force and position of a recording over time.
pub fn document(recording: &Recording) -> Document {
    let panel = |axis: Axis, series| over_time(axis).series(series).aspect(0.25);
    let (time, values) = (&recording.time, recording.force.iter().copied());
    let force =
        panel(Axis::new("force", "N").with_zero(), line("force", Role::Measured, time, values));
    let millimetres = recording.position.iter().map(|position| MM * position);
    let position =
        panel(Axis::new("position", "mm"), line("position", Role::Deflection, time, millimetres));
    let caption = format!("{} samples over {:.1} s.", recording.len(), recording.duration());
    let figure = Figure::new("recording", 1, recording.name.as_str())
        .caption(caption)
        .panel(force)
        .panel(position)
        .linked_x();
    let sections = vec![Section::new("Recording").figure(figure)];
    Document { title: recording.name.clone(), sections, ..Document::default() }
}
