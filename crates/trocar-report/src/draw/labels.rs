//! Texts beside points, placed so that they cover no other text, no marker and as little of a line
//! as possible.

use super::{Frame, LABELLED_RADIUS, TICK_SIZE, is_drawable, view};
use crate::document::{Dimension, Kind, Series};
use crate::number::text_width;
use crate::style;

/// Half of the height of a text.
const HALF_HEIGHT: f64 = 6.5;
/// Distance between marker and text.
const GAP: f64 = 4.0;
/// A text this close to another marker could be attributed to that marker.
const NEAR: f64 = 7.0;
/// Spacing of the points of a line that count as obstacles.
const LINE_STEP: f64 = 6.0;
/// Directions in the order in which they are tried: beside, below, above, then the corners, then
/// between those.
const DIRECTIONS: [[f64; 2]; 12] = [
    [1.0, 0.0],
    [-1.0, 0.0],
    [0.0, 1.0],
    [0.0, -1.0],
    [0.9, 0.9],
    [0.9, -0.9],
    [-0.9, 0.9],
    [-0.9, -0.9],
    [0.5, 1.0],
    [0.5, -1.0],
    [-0.5, 1.0],
    [-0.5, -1.0],
];
/// Radii of the candidate positions around a point, nearest first.
const RINGS: [f64; 4] = [0.0, 9.0, 18.0, 30.0];

/// A rectangle by its centre and half its size.
#[derive(Clone, Copy)]
struct Area {
    centre: [f64; 2],
    half: [f64; 2],
}

impl Area {
    fn overlaps(&self, other: &Self) -> bool {
        (0..2).all(|k| (self.centre[k] - other.centre[k]).abs() < self.half[k] + other.half[k])
    }

    fn is_inside(&self, frame: &Frame<'_>) -> bool {
        let [x, y] = self.centre;
        let [w, h] = self.half;
        x - w > frame.left
            && x + w < frame.left + frame.width
            && y - h > frame.top
            && y + h < frame.top + frame.height
    }
}

/// Centre, text and colour of every label of a panel.
pub(super) fn placed<'p>(frame: &Frame<'p>) -> Vec<([f64; 2], &'p str, &'static str)> {
    let (markers, lines) = obstacles(frame);
    let mut texts: Vec<Area> = Vec::new();
    let mut placed = Vec::new();
    for series in &frame.panel.series {
        let Kind::Labelled { labels } = &series.kind else { continue };
        let colour = style::of(series.role).light;
        for (at, label) in points(series, frame).zip(labels) {
            if !is_drawable(&at) || label.is_empty() {
                continue;
            }
            let half = [text_width(&view::printable(label), TICK_SIZE) / 2.0, HALF_HEIGHT];
            let best = candidates(at, half)
                .min_by_key(|area| {
                    let count =
                        |all: &[Area]| all.iter().filter(|other| area.overlaps(other)).count();
                    let outside = usize::from(!area.is_inside(frame));
                    let near = Area { half: area.half.map(|half| half + NEAR), ..*area };
                    let strangers =
                        markers.iter().filter(|m| m.centre != at && near.overlaps(m)).count();
                    1000 * outside
                        + 100 * count(&texts)
                        + 20 * count(&markers)
                        + 4 * strangers
                        + count(&lines)
                })
                .unwrap_or(Area { centre: at, half });
            texts.push(best);
            placed.push((best.centre, label.as_str(), colour));
        }
    }
    placed
}

fn points<'a>(series: &'a Series, frame: &'a Frame<'_>) -> impl Iterator<Item = [f64; 2]> + 'a {
    series.x.iter().zip(&series.y).map(|(x, y)| [frame.x(*x), frame.y(*y)])
}

/// Candidate positions around a point, best first.
fn candidates(at: [f64; 2], half: [f64; 2]) -> impl Iterator<Item = Area> {
    let clear = LABELLED_RADIUS + GAP;
    RINGS.into_iter().flat_map(move |ring| {
        let [x, y] = half.map(|half| half + clear + ring);
        DIRECTIONS
            .into_iter()
            .map(move |[dx, dy]| Area { centre: [at[0] + dx * x, at[1] + dy * y], half })
    })
}

/// Markers, and points along lines and horizontal marks.
fn obstacles(frame: &Frame<'_>) -> (Vec<Area>, Vec<Area>) {
    let (mut markers, mut lines) = (Vec::new(), Vec::new());
    for series in &frame.panel.series {
        let at: Vec<[f64; 2]> = points(series, frame).filter(is_drawable).collect();
        match series.kind {
            Kind::Points | Kind::Labelled { .. } | Kind::ErrorBars { .. } => {
                markers.extend(
                    at.into_iter().map(|centre| Area { centre, half: [LABELLED_RADIUS; 2] }),
                );
            }
            Kind::Line => lines.extend(at.windows(2).flat_map(|pair| along(pair[0], pair[1]))),
            Kind::Band { .. } | Kind::Cells { .. } => {}
        }
    }
    let levels = frame.panel.marks.iter().filter(|mark| mark.axis == Dimension::Y);
    for mark in levels.filter(|mark| mark.is_line()) {
        let y = frame.y(mark.from);
        lines.extend(along([frame.left, y], [frame.left + frame.width, y]));
    }
    (markers, lines)
}

fn along(from: [f64; 2], to: [f64; 2]) -> impl Iterator<Item = Area> {
    let length = (to[0] - from[0]).hypot(to[1] - from[1]);
    let steps = (length / LINE_STEP).ceil().clamp(1.0, 500.0) as usize;
    (0..=steps).map(move |k| {
        let part = k as f64 / steps as f64;
        Area { centre: [0, 1].map(|i| from[i] + part * (to[i] - from[i])), half: [1.0; 2] }
    })
}

#[cfg(test)]
mod tests {
    use super::super::Layout;
    use super::*;
    use crate::document::{Axis, Figure, Panel, Role};

    #[test]
    fn texts_of_a_cluster_lie_apart_inside_the_axes_and_off_the_markers() {
        let x = [1.0, 1.1, 1.25, 1.05, 2.0, 9.0];
        let y = [0.2, 0.22, 0.2, 0.18, 0.1, 1.0];
        let names = ["Coulomb and viscous", "Stribeck", "Dahl", "LuGre", "Leuven 4", "EMS"];
        let axes = || {
            Panel::new(
                Axis::new("parameters", "").logarithmic(),
                Axis::new("error", "N").logarithmic(),
            )
        };
        let figure = Figure::new("cluster", 1, "Cluster").panel((0..names.len()).fold(
            axes(),
            |panel, k| {
                panel.series(Series::labelled(
                    "",
                    Role::Model,
                    vec![x[k]],
                    vec![y[k]],
                    vec![names[k].to_owned()],
                ))
            },
        ));
        let layout = Layout::new(&figure);
        let frame = &layout.frames[0];
        let texts: Vec<Area> = placed(frame)
            .into_iter()
            .map(|(centre, text, _)| Area {
                centre,
                half: [text_width(text, TICK_SIZE) / 2.0, HALF_HEIGHT],
            })
            .collect();
        assert_eq!(texts.len(), names.len());
        let (markers, _) = obstacles(frame);
        for (k, text) in texts.iter().enumerate() {
            assert!(text.is_inside(frame), "{}", names[k]);
            assert!(texts[..k].iter().all(|other| !text.overlaps(other)), "{}", names[k]);
            assert!(markers.iter().all(|marker| !text.overlaps(marker)), "{}", names[k]);
        }
    }
}
