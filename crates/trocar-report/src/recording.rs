//! Creates the figure of a recording.

use super::document::{Axis, Document, Figure, Panel, Role, Section, Series};
use super::figures::thinned;
use trocar_recording::Recording;

/// Force and position of a recording over time.
pub fn document(recording: &Recording) -> Document {
    let panel = |axis: Axis, name: &str, role: Role, values: &[f64]| {
        let (x, y) = thinned(&recording.time, values);
        Panel::new(Axis::new("time", "s"), axis).series(Series::line(name, role, x, y)).aspect(0.25)
    };
    let force =
        panel(Axis::new("force", "N").with_zero(), "force", Role::Measured, &recording.force);
    let millimetres: Vec<f64> = recording.position.iter().map(|position| 1e3 * position).collect();
    let position = panel(Axis::new("position", "mm"), "position", Role::Deflection, &millimetres);
    let caption = format!("{} samples over {:.1} s.", recording.len(), recording.duration());
    let mut figure = Figure::new("recording", 1, recording.name.as_str());
    figure.linked_x = true;
    let section =
        Section::new("Recording").figure(figure.caption(caption).panel(force).panel(position));
    Document { title: recording.name.clone(), sections: vec![section], ..Document::default() }
}
