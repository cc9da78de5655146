//! Composes a figure from kuva's primitives; kuva's own writers convert the scene to SVG and PNG.
//!
//! The axes are composed here and not by kuva's plots. The figures need legends in rows above the
//! axes (kuva offers columns beside or over the data), labelled intervals that avoid the data, axes
//! aligned across stacked panels, and dashes in the bitmap that do not restart at every point of a
//! line.

mod labels;

use std::fmt::Write as _;

use kuva::backend::png::PngBackend;
use kuva::render::color::Color;
use kuva::render::render::{PathData, Primitive, Scene, TextAnchor, TextSpan};

use super::decimate;
use super::document::{Axis, Figure, Kind, Mark, Panel, Series};
use super::number::{Ticks, log_ticks, text_width, ticks};
use super::style::{self, BAND_OPACITY, Marker, Style};
use super::view::{self, Entry, Limits};

/// Scene pixels per millimetre on paper.
pub(super) const PIXELS_PER_MILLIMETRE: f64 = 4.0;

/// The fallbacks have the metrics of the first font or are narrower, so the layout causes no
/// overlaps.
const FONT_FAMILY: &str = "'DejaVu Sans', Verdana, Arial, Helvetica, sans-serif";
const TICK_SIZE: u32 = 11;
const LABEL_SIZE: u32 = 12;
/// Text inside a cell of a map.
const CELL_SIZE: u32 = 8;
/// As long as the label of a cell may be.
const WIDEST_LABEL: &str = "8.8k";
const LEGEND_ROW: f64 = 17.0;
const TITLE_ROW: f64 = 19.0;
/// Room for the letter of a panel before its title.
const LETTER_ROOM: f64 = 30.0;
const SWATCH: f64 = 24.0;
const LETTER: f64 = 24.0;
/// Radius of a marker with a text.
const LABELLED_RADIUS: f64 = 3.6;
const TICK_LENGTH: f64 = 4.0;
const INK: &str = "#1a1a1a";
const GRID: &str = "#e4e4e4";
const RANGE: &str = "#9aa4ad";
const MARK: &str = "#5c6670";

/// Points per line in a printed figure; more cannot be distinguished at 0.25 mm per pixel.
const PRINTED_POINTS: usize = 2_400;

/// Output format of the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Medium {
    /// SVG: dashes are an attribute of the line.
    Vector,
    /// PNG: kuva's rasteriser restarts a dash at every point, so lines are cut into dashes here.
    Bitmap,
}

/// The whole figure as a scene with [`PIXELS_PER_MILLIMETRE`].
pub(super) fn scene(figure: &Figure, medium: Medium) -> Scene {
    let layout = Layout::new(figure);
    let mut scene = Scene::new(layout.width, layout.height);
    scene.font_family = Some(FONT_FAMILY.to_owned());
    scene.text_color = Some(INK.to_owned());
    let mut sheet = Sheet { scene, medium };
    for (at, row) in layout.legend.iter().enumerate() {
        sheet.legend_row(
            row,
            layout.frames.first().map_or(0.0, |frame| frame.left),
            at as f64 * LEGEND_ROW,
        );
    }
    for (index, frame) in layout.frames.iter().enumerate() {
        sheet.panel(
            &figure.panels[index],
            frame,
            (figure.panels.len() > 1).then(|| view::letter(index)),
        );
    }
    sheet.scene
}

/// Makes kuva unpack its fonts, which takes as long as drawing several figures and can run in
/// parallel with other work.
pub(super) fn load_fonts() {
    let mut scene = Scene::new(1.0, 1.0);
    let spans = vec![bold("a".to_owned())];
    scene.add(Primitive::RichText {
        x: 0.0,
        y: 0.0,
        spans,
        size: 1,
        anchor: TextAnchor::Start,
        color: None,
    });
    // Drawn for its side effect; an error would occur again, with a message, in the first figure.
    let _ = PngBackend::new().render_scene(&scene);
}

/// Rows of legend entries with their distance from the left edge of the axes.
type LegendRow<'a> = Vec<(f64, Entry<'a>)>;

/// Layout of all parts, in scene pixels.
struct Layout<'a> {
    width: f64,
    height: f64,
    /// Common legend of all panels, at the top of the sheet.
    legend: Vec<LegendRow<'a>>,
    frames: Vec<Frame<'a>>,
}

/// One panel's axes.
struct Frame<'a> {
    left: f64,
    top: f64,
    width: f64,
    height: f64,
    limits: Limits,
    /// Whether x and y are logarithmic.
    logarithmic: [bool; 2],
    x_ticks: Ticks,
    y_ticks: Ticks,
    /// Height of title row above the legend, 0 without.
    title: f64,
    legend: Vec<LegendRow<'a>>,
    /// Space for the letter before the legend, 0 if the letter is in the title row.
    legend_indent: f64,
    /// Whether tick numbers and axis name are drawn below this panel.
    names_x: bool,
    /// Row of each mark's label inside the upper edge.
    label_rows: Vec<usize>,
    /// Distance of the y axis label from the axis.
    label_distance: f64,
}

impl Frame<'_> {
    fn x(&self, value: f64) -> f64 {
        self.left + part(self.limits.x, self.logarithmic[0], value) * self.width
    }

    fn y(&self, value: f64) -> f64 {
        self.top + (1.0 - part(self.limits.y, self.logarithmic[1], value)) * self.height
    }
}

/// Position between the lower and the upper limit, 0 to 1; not finite if a logarithmic axis cannot
/// show the value.
fn part([low, high]: [f64; 2], logarithmic: bool, value: f64) -> f64 {
    if logarithmic { (value / low).ln() / (high / low).ln() } else { (value - low) / (high - low) }
}

fn axis_ticks([low, high]: [f64; 2], axis: &Axis, target: usize) -> Ticks {
    if !axis.names.is_empty() {
        return Ticks {
            at: (0..axis.names.len()).map(|k| k as f64).collect(),
            labels: axis.names.clone(),
        };
    }
    if axis.logarithmic { log_ticks(low, high, target) } else { ticks(low, high, target) }
}

impl<'a> Layout<'a> {
    fn new(figure: &'a Figure) -> Self {
        let width = figure.width.millimetres() * PIXELS_PER_MILLIMETRE;
        let columns = figure.columns.clamp(1, figure.panels.len().max(1));
        let cell = (width - 14.0 * (columns as f64 - 1.0)) / columns as f64;
        let limits = view::limits(figure);
        let left_of = |(limits, panel): (&Limits, &Panel)| left_margin(limits.y, &panel.y);
        let left = limits.iter().zip(&figure.panels).map(left_of).fold(0.0, f64::max);
        let right = figure.panels.iter().map(right_margin).fold(0.0, f64::max);
        let inner = cell - left - right;
        let mut layout = Self { width, height: 0.0, legend: Vec::new(), frames: Vec::new() };
        let common = common_legend(figure);
        if common {
            layout.legend = figure
                .panels
                .first()
                .map_or_else(Vec::new, |panel| legend_rows(panel, width - left - right));
        }
        let mut top = layout.legend.len() as f64 * LEGEND_ROW + if common { 2.0 } else { 0.0 };
        for (row, panels) in figure.panels.chunks(columns).enumerate() {
            // A letter alone needs no row of its own: it is placed before the legend.
            let titled = panels.iter().any(|panel| !panel.title.is_empty());
            let indent = if figure.panels.len() > 1 && !titled { LETTER } else { 0.0 };
            let legend = |panel| {
                if common { Vec::new() } else { legend_rows(panel, inner - indent) }
            };
            let legends: Vec<_> = panels.iter().map(legend).collect();
            let legend_height = legends.iter().map(Vec::len).max().unwrap_or(0) as f64 * LEGEND_ROW;
            let rows = panels.iter().map(|panel| title_rows(&panel.title, inner).len()).max();
            let letter_alone = indent > 0.0 && legend_height == 0.0;
            let title = rows.unwrap_or(0).max(usize::from(letter_alone)) as f64 * TITLE_ROW;
            let axes_top = top + title + legend_height + 5.0;
            let height = panels.iter().map(|panel| panel.aspect * inner).fold(60.0, f64::max);
            let names_x = !(figure.linked_x && columns == 1) || row + 1 == figure.panels.len();
            for (column, (panel, legend)) in panels.iter().zip(legends).enumerate() {
                let place = [column as f64 * (cell + 14.0) + left, axes_top, inner, height];
                let mut frame = Frame::new(panel, place, limits[row * columns + column]);
                (frame.title, frame.legend, frame.legend_indent) = (title, legend, indent);
                (frame.names_x, frame.label_distance) = (names_x, left - 13.0);
                layout.frames.push(frame);
            }
            top = axes_top + height + if names_x { 42.0 } else { 10.0 };
        }
        layout.height = top.ceil();
        layout
    }
}

impl<'a> Frame<'a> {
    fn new(panel: &Panel, [left, top, width, height]: [f64; 4], limits: Limits) -> Self {
        let mut frame = Self {
            left,
            top,
            width,
            height,
            limits,
            logarithmic: [panel.x.logarithmic, panel.y.logarithmic],
            x_ticks: axis_ticks(limits.x, &panel.x, ((width / 50.0) as usize).max(4)),
            y_ticks: Ticks { at: Vec::new(), labels: Vec::new() },
            title: 0.0,
            legend: Vec::new(),
            legend_indent: 0.0,
            names_x: true,
            label_rows: Vec::new(),
            label_distance: 0.0,
        };
        frame.label_rows = label_rows(panel, &frame);
        let rows = frame.label_rows.iter().max().map_or(0, |row| row + 1);
        let headroom = rows as f64 * LEGEND_ROW;
        let [low, high] = limits.y;
        let more = headroom / (height - headroom).max(20.0);
        frame.limits.y[1] = if panel.y.logarithmic {
            high * (high / low).powf(more)
        } else {
            high + (high - low) * more
        };
        frame.y_ticks = axis_ticks(frame.limits.y, &panel.y, ((height / 34.0) as usize).max(3));
        frame
    }
}

fn left_margin(y: [f64; 2], axis: &Axis) -> f64 {
    let labels = axis_ticks(y, axis, 8).labels;
    let widest =
        labels.iter().map(|label| text_width(label, f64::from(TICK_SIZE))).fold(12.0, f64::max);
    widest + 30.0
}

/// Space for the labels of horizontal marks, which are outside the axes at the right.
fn right_margin(panel: &Panel) -> f64 {
    let labels = panel.marks.iter().filter_map(|mark| match mark {
        Mark::Y { label, .. } | Mark::YRange { label, .. } => {
            Some(text_width(label, f64::from(TICK_SIZE)) + 10.0)
        }
        Mark::X { .. } | Mark::XRange { .. } => None,
    });
    labels.fold(14.0, f64::max)
}

/// Whether all panels have the same legend, which is then drawn once.
fn common_legend(figure: &Figure) -> bool {
    figure.panels.len() > 1
        && figure.panels.windows(2).all(|pair| view::legend(&pair[0]) == view::legend(&pair[1]))
        && figure.panels.first().is_some_and(|panel| !view::legend(panel).is_empty())
}

fn legend_rows(panel: &Panel, width: f64) -> Vec<LegendRow<'_>> {
    let mut rows: Vec<LegendRow<'_>> = Vec::new();
    let mut x = f64::INFINITY;
    for entry in view::legend(panel) {
        let wide = SWATCH + 6.0 + text_width(entry.name, f64::from(TICK_SIZE));
        if x + wide > width {
            rows.push(Vec::new());
            x = 0.0;
        }
        if let Some(row) = rows.last_mut() {
            row.push((x, entry));
        }
        x += wide + 16.0;
    }
    rows
}

/// The row below the upper edge in which the label of each vertical mark fits, in the order of the
/// labelled marks.
fn label_rows(panel: &Panel, frame: &Frame<'_>) -> Vec<usize> {
    let mut ends: Vec<f64> = Vec::new();
    let labelled = panel.marks.iter().filter_map(|mark| x_label(mark, frame));
    labelled
        .map(|(label, centre)| {
            let half = text_width(label, f64::from(TICK_SIZE)) / 2.0 + 3.0;
            let row = ends.iter().position(|&end| end <= centre - half).unwrap_or(ends.len());
            if row == ends.len() {
                ends.push(0.0);
            }
            ends[row] = centre + half;
            row
        })
        .collect()
}

/// Label of a vertical mark and its centre, kept inside the axes.
fn x_label<'m>(mark: &'m Mark, frame: &Frame<'_>) -> Option<(&'m str, f64)> {
    let (label, at) = match mark {
        Mark::X { at, label } => (label, *at),
        Mark::XRange { from, to, label } => (label, (from + to) / 2.0),
        Mark::Y { .. } | Mark::YRange { .. } => return None,
    };
    let half = text_width(label, f64::from(TICK_SIZE)) / 2.0 + 4.0;
    let centre = frame.x(at).min(frame.left + frame.width - half).max(frame.left + half);
    (!label.is_empty() && at.is_finite()).then_some((label, centre))
}

struct Sheet {
    scene: Scene,
    medium: Medium,
}

impl Sheet {
    fn panel(&mut self, panel: &Panel, frame: &Frame<'_>, letter: Option<String>) {
        self.head(panel, frame, letter);
        self.ranges(panel, frame);
        self.grid(frame);
        let is_area =
            |series: &&Series| matches!(series.kind, Kind::Band { .. } | Kind::Cells { .. });
        for series in panel.series.iter().filter(is_area) {
            self.series(series, frame);
        }
        self.mark_lines(panel, frame);
        // Measured curves lie over those of models, which are wider.
        let is_measured = |series: &&Series| {
            series.role == super::document::Role::Measured && matches!(series.kind, Kind::Line)
        };
        let curves = || panel.series.iter().filter(|series| !is_area(series));
        for series in
            curves().filter(|series| !is_measured(series)).chain(curves().filter(is_measured))
        {
            self.series(series, frame);
        }
        self.axes(panel, frame);
        self.mark_labels(panel, frame);
        self.point_labels(panel, frame);
    }

    fn head(&mut self, panel: &Panel, frame: &Frame<'_>, letter: Option<String>) {
        let top = frame.top - 5.0 - frame.legend.len() as f64 * LEGEND_ROW;
        let baseline = if frame.title > 0.0 { top - 6.0 } else { top + LEGEND_ROW / 2.0 + 4.0 };
        let mut letter = letter.map(|letter| bold(letter + " "));
        let mut rows = title_rows(&panel.title, frame.width);
        if rows.is_empty() {
            rows.push(String::new());
        }
        for (above, row) in (0..rows.len()).rev().zip(rows) {
            self.rich_text(
                [frame.left, baseline - above as f64 * TITLE_ROW],
                letter.take().into_iter().chain([TextSpan::plain(row)]),
                LABEL_SIZE,
                TextAnchor::Start,
            );
        }
        for (at, row) in frame.legend.iter().enumerate() {
            self.legend_row(row, frame.left + frame.legend_indent, top + at as f64 * LEGEND_ROW);
        }
    }

    fn legend_row(&mut self, row: &LegendRow<'_>, left: f64, top: f64) {
        let middle = top + LEGEND_ROW / 2.0;
        for (offset, entry) in row {
            let (style, x) = (style::of(entry.role), left + offset);
            if entry.band {
                self.rectangle([x, middle - 5.0, SWATCH, 10.0], style.light, BAND_OPACITY * 1.6);
            }
            if entry.cell {
                self.rectangle([x, middle - 5.0, SWATCH, 10.0], style.light, 1.0);
            }
            if entry.line {
                self.polyline(
                    &[(x, middle), (x + SWATCH, middle)],
                    style.light,
                    style.width,
                    style.dash,
                );
            }
            if entry.marker {
                self.markers(&[(x + SWATCH / 2.0, middle)], style, 2.8);
            }
            let room = self.scene.width - x - SWATCH - 6.0;
            let name = fitted(entry.name, f64::from(TICK_SIZE), room);
            self.text([x + SWATCH + 6.0, middle + 4.0], &name, TICK_SIZE, TextAnchor::Start);
        }
    }

    fn ranges(&mut self, panel: &Panel, frame: &Frame<'_>) {
        for mark in &panel.marks {
            match *mark {
                Mark::XRange { from, to, .. } if from.is_finite() && to.is_finite() => {
                    let (a, b) = (frame.x(from.min(to)), frame.x(from.max(to)));
                    self.rectangle([a, frame.top, b - a, frame.height], RANGE, 0.2);
                }
                Mark::YRange { from, to, .. } if from.is_finite() && to.is_finite() => {
                    let (a, b) = (frame.y(from.max(to)), frame.y(from.min(to)));
                    self.rectangle([frame.left, a, frame.width, b - a], RANGE, 0.2);
                }
                _ => {}
            }
        }
    }

    fn grid(&mut self, frame: &Frame<'_>) {
        let (right, bottom) = (frame.left + frame.width, frame.top + frame.height);
        for &at in &frame.x_ticks.at {
            self.line([frame.x(at), frame.top, frame.x(at), bottom], GRID, 0.6);
        }
        for &at in &frame.y_ticks.at {
            self.line([frame.left, frame.y(at), right, frame.y(at)], GRID, 0.6);
        }
    }

    fn mark_lines(&mut self, panel: &Panel, frame: &Frame<'_>) {
        for mark in &panel.marks {
            let ends = match *mark {
                Mark::X { at, .. } if frame.x(at).is_finite() => {
                    [(frame.x(at), frame.top), (frame.x(at), frame.top + frame.height)]
                }
                Mark::Y { at, .. } if frame.y(at).is_finite() => {
                    [(frame.left, frame.y(at)), (frame.left + frame.width, frame.y(at))]
                }
                _ => continue,
            };
            self.polyline(&ends, MARK, 1.0, &[4.0, 3.0]);
        }
    }

    fn mark_labels(&mut self, panel: &Panel, frame: &Frame<'_>) {
        let labelled = panel.marks.iter().filter_map(|mark| x_label(mark, frame));
        for ((label, centre), row) in labelled.zip(&frame.label_rows) {
            let y = frame.top + 13.0 + *row as f64 * LEGEND_ROW;
            let half = text_width(label, f64::from(TICK_SIZE)) / 2.0 + 2.0;
            self.rectangle([centre - half, y - 10.0, 2.0 * half, 13.0], "#ffffff", 0.75);
            self.text([centre, y], label, TICK_SIZE, TextAnchor::Middle);
        }
        let mut sides: Vec<(f64, &str)> =
            panel.marks.iter().filter_map(|mark| y_label(mark, frame)).collect();
        sides.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut next = f64::NEG_INFINITY;
        for (y, label) in sides {
            let y = y.max(next);
            self.text(
                [frame.left + frame.width + 5.0, y + 4.0],
                label,
                TICK_SIZE,
                TextAnchor::Start,
            );
            next = y + 12.0;
        }
    }

    fn point_labels(&mut self, panel: &Panel, frame: &Frame<'_>) {
        for ([x, y], label, colour) in labels::placed(panel, frame) {
            let half = text_width(label, f64::from(TICK_SIZE)) / 2.0;
            self.rectangle([x - half - 1.0, y - 6.0, 2.0 * half + 2.0, 12.0], "#ffffff", 0.75);
            let content = literal(&view::printable(label));
            let (size, anchor, color) = (TICK_SIZE, TextAnchor::Middle, Some(Color::from(colour)));
            self.scene.add(Primitive::Text {
                x,
                y: y + 4.0,
                content,
                size,
                anchor,
                rotate: None,
                bold: false,
                color,
            });
        }
    }

    fn axes(&mut self, panel: &Panel, frame: &Frame<'_>) {
        let (right, bottom) = (frame.left + frame.width, frame.top + frame.height);
        for (at, label) in frame.x_ticks.at.iter().zip(&frame.x_ticks.labels) {
            let x = frame.x(*at);
            self.line([x, bottom, x, bottom - TICK_LENGTH], INK, 0.8);
            if frame.names_x {
                self.text([x, bottom + 15.0], label, TICK_SIZE, TextAnchor::Middle);
            }
        }
        for (at, label) in frame.y_ticks.at.iter().zip(&frame.y_ticks.labels) {
            let y = frame.y(*at);
            self.line([frame.left, y, frame.left + TICK_LENGTH, y], INK, 0.8);
            self.text([frame.left - 6.0, y + 4.0], label, TICK_SIZE, TextAnchor::End);
        }
        let corners =
            [(frame.left, frame.top), (right, frame.top), (right, bottom), (frame.left, bottom)];
        for (from, to) in corners.into_iter().zip(corners.into_iter().cycle().skip(1)) {
            self.line([from.0, from.1, to.0, to.1], INK, 0.8);
        }
        if frame.names_x {
            let (label, size) = axis_title(&panel.x, frame.width + 70.0);
            let middle = [frame.left + frame.width / 2.0, bottom + 33.0];
            self.rich_text(middle, [bold(label)], size, TextAnchor::Middle);
        }
        let (label, size) = axis_title(&panel.y, frame.height + 70.0);
        self.scene.add(Primitive::Text {
            x: frame.left - frame.label_distance,
            y: frame.top + frame.height / 2.0,
            content: literal(&label),
            size,
            anchor: TextAnchor::Middle,
            rotate: Some(-90.0),
            bold: true,
            color: None,
        });
    }

    fn series(&mut self, series: &Series, frame: &Frame<'_>) {
        let style = style::of(series.role);
        let place = |i: usize, y: &[f64]| (frame.x(series.x[i]), frame.y(y[i]));
        let columns = frame.width as usize;
        let [low, high] = frame.limits.x;
        match &series.kind {
            Kind::Line => {
                let kept = decimate::path(&series.x, &series.y, low, high, columns, PRINTED_POINTS);
                for run in runs(kept.iter().map(|&i| place(i, &series.y))) {
                    self.polyline(&run, style.light, style.width, style.dash);
                }
            }
            Kind::Band { low: lower, high: upper } => {
                let kept = band_points(series, lower, upper, [low, high], columns);
                let edges = kept.iter().map(|&i| (place(i, lower), place(i, upper)));
                for run in runs(edges.map(|(lower, upper)| (lower.0, lower.1, upper.1))) {
                    self.area(&run, style.light);
                }
            }
            Kind::Labelled { .. } => {
                let finite =
                    (0..series.x.len()).map(|i| place(i, &series.y)).filter(Drawable::is_drawable);
                self.markers(&finite.collect::<Vec<_>>(), style, LABELLED_RADIUS);
            }
            Kind::Points => {
                let cells = [columns, frame.height as usize];
                let kept = decimate::markers(
                    &series.x,
                    &series.y,
                    frame.limits.flat(),
                    cells,
                    PRINTED_POINTS,
                );
                let places: Vec<_> = kept
                    .iter()
                    .map(|&i| place(i, &series.y))
                    .filter(Drawable::is_drawable)
                    .collect();
                self.markers(&places, style, style::marker_radius(places.len()));
            }
            Kind::Cells { size, labels } => self.cells(series, *size, labels, frame),
            Kind::ErrorBars { low, high } => self.error_bars(series, low, high, frame),
        }
    }

    fn cells(&mut self, series: &Series, size: [f64; 2], labels: &[String], frame: &Frame<'_>) {
        let (fill, ink) = (style::of(series.role).light, style::ink_upon(series.role));
        let widest = text_width(WIDEST_LABEL, f64::from(CELL_SIZE));
        for ((x, y), label) in series.x.iter().zip(&series.y).zip(labels) {
            let corner = |part: f64| (frame.x(x + part * size[0]), frame.y(y + part * size[1]));
            let ((left, bottom), (right, top)) = (corner(-0.5), corner(0.5));
            // Half a pixel more, so that no line of light stands between two cells.
            self.rectangle([left, top, right - left + 0.5, bottom - top + 0.5], fill, 1.0);
            // All labels of a map or none.
            if widest < right - left - 1.0 && f64::from(CELL_SIZE) < bottom - top {
                self.scene.add(Primitive::Text {
                    x: 0.5 * (left + right),
                    y: 0.5 * (top + bottom) + 0.36 * f64::from(CELL_SIZE),
                    content: literal(&view::printable(label)),
                    size: CELL_SIZE,
                    anchor: TextAnchor::Middle,
                    rotate: None,
                    bold: false,
                    color: Some(Color::from(ink)),
                });
            }
        }
    }

    fn error_bars(&mut self, series: &Series, low: &[f64], high: &[f64], frame: &Frame<'_>) {
        let style = style::of(series.role);
        let length =
            [series.x.len(), series.y.len(), low.len(), high.len()].into_iter().min().unwrap_or(0);
        let visible =
            |&i: &usize| frame.x(series.x[i]).is_finite() && frame.y(series.y[i]).is_finite();
        let shown: Vec<usize> = (0..length).filter(visible).collect();
        for &i in
            shown.iter().filter(|&&i| frame.y(low[i]).is_finite() && frame.y(high[i]).is_finite())
        {
            let (x, bottom, top) = (frame.x(series.x[i]), frame.y(low[i]), frame.y(high[i]));
            self.line([x, bottom, x, top], style.light, 1.0);
            for y in [bottom, top] {
                self.line([x - 3.0, y, x + 3.0, y], style.light, 1.0);
            }
        }
        let places: Vec<_> =
            shown.iter().map(|&i| (frame.x(series.x[i]), frame.y(series.y[i]))).collect();
        self.markers(&places, style, style::marker_radius(places.len()));
    }

    fn markers(&mut self, places: &[(f64, f64)], style: Style, radius: f64) {
        if style.marker == Marker::Circle {
            self.scene.add(Primitive::CircleBatch {
                cx: places.iter().map(|place| place.0).collect(),
                cy: places.iter().map(|place| place.1).collect(),
                r: radius,
                fill: Color::from(style.light),
                fill_opacity: None,
                stroke: None,
                stroke_width: None,
            });
            return;
        }
        let mut outline = String::new();
        for &(x, y) in places {
            let corners = corners(style.marker, radius);
            for (at, (dx, dy)) in corners.iter().enumerate() {
                let command = if at == 0 { 'M' } else { 'L' };
                write_point(&mut outline, command, (x + dx, y + dy));
            }
            outline.push('Z');
        }
        self.fill(outline, style.light, 1.0);
    }

    fn area(&mut self, run: &[(f64, f64, f64)], colour: &str) {
        let lower = run.iter().map(|&(x, lower, _)| (x, lower));
        let upper = run.iter().rev().map(|&(x, _, upper)| (x, upper));
        let mut outline = String::new();
        for (at, point) in lower.chain(upper).enumerate() {
            write_point(&mut outline, if at == 0 { 'M' } else { 'L' }, point);
        }
        outline.push('Z');
        self.fill(outline, colour, BAND_OPACITY);
    }

    fn fill(&mut self, outline: String, colour: &str, opacity: f64) {
        self.scene.add(Primitive::Path(Box::new(PathData {
            d: outline,
            fill: Some(Color::from(colour)),
            stroke: Color::None,
            stroke_width: 0.0,
            opacity: (opacity < 1.0).then_some(opacity),
            stroke_dasharray: None,
        })));
    }

    fn polyline(&mut self, points: &[(f64, f64)], colour: &str, width: f64, dash: &[f64]) {
        if dash.is_empty() || self.medium == Medium::Vector {
            let lengths: Vec<String> = dash.iter().map(f64::to_string).collect();
            self.stroke(
                points.to_vec(),
                colour,
                width,
                (!dash.is_empty()).then(|| lengths.join(" ")),
            );
        } else {
            for piece in dashes(points, dash) {
                self.stroke(piece, colour, width, None);
            }
        }
    }

    fn stroke(&mut self, points: Vec<(f64, f64)>, colour: &str, width: f64, dash: Option<String>) {
        let stroke = Color::from(colour);
        self.scene.add(Primitive::PolyLine {
            points,
            stroke,
            stroke_width: width,
            stroke_dasharray: dash,
        });
    }

    fn line(&mut self, [x1, y1, x2, y2]: [f64; 4], colour: &str, width: f64) {
        let stroke = Color::from(colour);
        self.scene.add(Primitive::Line {
            x1,
            y1,
            x2,
            y2,
            stroke,
            stroke_width: width,
            stroke_dasharray: None,
        });
    }

    fn rectangle(&mut self, [x, y, width, height]: [f64; 4], colour: &str, opacity: f64) {
        let (fill, opacity) = (Color::from(colour), Some(opacity));
        self.scene.add(Primitive::Rect {
            x,
            y,
            width,
            height,
            fill,
            stroke: None,
            stroke_width: None,
            opacity,
        });
    }

    fn rich_text(
        &mut self,
        [x, y]: [f64; 2],
        spans: impl IntoIterator<Item = TextSpan>,
        size: u32,
        anchor: TextAnchor,
    ) {
        let spans = spans.into_iter().collect();
        self.scene.add(Primitive::RichText { x, y, spans, size, anchor, color: None });
    }

    fn text(&mut self, [x, y]: [f64; 2], text: &str, size: u32, anchor: TextAnchor) {
        let content = literal(&view::printable(text));
        self.scene.add(Primitive::Text {
            x,
            y,
            content,
            size,
            anchor,
            rotate: None,
            bold: false,
            color: None,
        });
    }
}

/// Label of an axis and the font size at which it fits into `room`; at the smallest size the name
/// is shortened, never the unit.
///
/// Axis labels are bold because kuva's rasteriser always draws rotated text in bold.
fn axis_title(axis: &Axis, room: f64) -> (String, u32) {
    const BOLD: f64 = 1.12;
    let label = view::printable(&view::axis_label(&axis.label, &axis.unit));
    let fits = |size: &u32| text_width(&label, f64::from(*size) * BOLD) <= room;
    if let Some(size) = (9..=LABEL_SIZE).rev().find(fits) {
        return (label, size);
    }
    let unit = view::printable(&view::axis_label("", &axis.unit));
    let name = fitted(&axis.label, 9.0 * BOLD, room - text_width(&unit, 9.0 * BOLD));
    (name + &unit, 9)
}

fn bold(text: String) -> TextSpan {
    TextSpan { bold: true, ..TextSpan::plain(text) }
}

/// Label of a horizontal mark and its height.
fn y_label<'m>(mark: &'m Mark, frame: &Frame<'_>) -> Option<(f64, &'m str)> {
    let (label, at) = match mark {
        Mark::Y { at, label } => (label, *at),
        Mark::YRange { from, to, label } => (label, (from + to) / 2.0),
        Mark::X { .. } | Mark::XRange { .. } => return None,
    };
    (!label.is_empty() && frame.y(at).is_finite()).then(|| (frame.y(at), label.as_str()))
}

fn band_points(
    series: &Series,
    lower: &[f64],
    upper: &[f64],
    x: [f64; 2],
    columns: usize,
) -> Vec<usize> {
    let edge = |edge| decimate::path(&series.x, edge, x[0], x[1], columns, PRINTED_POINTS / 2);
    let mut kept = edge(lower);
    kept.extend(edge(upper));
    kept.sort_unstable();
    kept.dedup();
    kept.retain(|&i| i < lower.len() && i < upper.len());
    kept
}

/// A point of a line or of a band's edges; drawn only where every coordinate is finite.
trait Drawable {
    fn is_drawable(&self) -> bool;
}

impl Drawable for (f64, f64) {
    fn is_drawable(&self) -> bool {
        self.0.is_finite() && self.1.is_finite()
    }
}

impl Drawable for (f64, f64, f64) {
    fn is_drawable(&self) -> bool {
        self.0.is_finite() && self.1.is_finite() && self.2.is_finite()
    }
}

/// The runs between gaps, at least two points long.
fn runs<P: Drawable>(points: impl Iterator<Item = P>) -> Vec<Vec<P>> {
    let mut runs = vec![Vec::new()];
    for point in points {
        if !point.is_drawable() {
            runs.push(Vec::new());
        } else if let Some(run) = runs.last_mut() {
            run.push(point);
        }
    }
    runs.retain(|run| run.len() > 1);
    runs
}

/// The drawn pieces of a dashed polyline; the pattern continues through its corners.
fn dashes(points: &[(f64, f64)], pattern: &[f64]) -> Vec<Vec<(f64, f64)>> {
    let (mut pieces, mut index, mut left) = (Vec::new(), 0, pattern[0]);
    let mut piece: Vec<(f64, f64)> = points.first().copied().into_iter().collect();
    for pair in points.windows(2) {
        let (from, to) = (pair[0], pair[1]);
        let length = (to.0 - from.0).hypot(to.1 - from.1);
        let mut done = 0.0;
        while length - done > left {
            done += left;
            let at = (
                from.0 + (to.0 - from.0) * done / length,
                from.1 + (to.1 - from.1) * done / length,
            );
            piece.push(at);
            if index % 2 == 0 {
                pieces.push(std::mem::take(&mut piece));
            }
            piece = vec![at];
            index += 1;
            left = pattern[index % pattern.len()];
        }
        left -= length - done;
        piece.push(to);
    }
    if index % 2 == 0 {
        pieces.push(piece);
    }
    pieces
}

/// Corners of a filled marker around the origin, with about the area of a circle of `radius`.
fn corners(marker: Marker, radius: f64) -> Vec<(f64, f64)> {
    let r = radius;
    match marker {
        Marker::Circle => Vec::new(),
        Marker::Square => {
            vec![(-0.9 * r, -0.9 * r), (0.9 * r, -0.9 * r), (0.9 * r, 0.9 * r), (-0.9 * r, 0.9 * r)]
        }
        Marker::Triangle => vec![(0.0, -1.3 * r), (1.2 * r, 0.9 * r), (-1.2 * r, 0.9 * r)],
        Marker::Diamond => vec![(0.0, -1.4 * r), (1.2 * r, 0.0), (0.0, 1.4 * r), (-1.2 * r, 0.0)],
    }
}

fn write_point(outline: &mut String, command: char, (x, y): (f64, f64)) {
    // Writing to a String cannot fail.
    let _ = write!(outline, "{command}{x:.2} {y:.2}");
}

/// The title of a panel in rows as wide as the panel; only a word wider than that is shortened.
fn title_rows(title: &str, width: f64) -> Vec<String> {
    let (size, room) = (f64::from(LABEL_SIZE), width - LETTER_ROOM);
    let mut rows: Vec<String> = Vec::new();
    for word in title.split_whitespace() {
        let fits = |row: &str| text_width(&view::printable(row), size) <= room;
        match rows.last_mut() {
            Some(row) if fits(&format!("{row} {word}")) => {
                row.push(' ');
                row.push_str(word);
            }
            _ => rows.push(word.to_owned()),
        }
    }
    rows.iter().map(|row| fitted(row, size, room)).collect()
}

/// `text`, shortened with an ellipsis until it is at most `room` pixels wide.
fn fitted(text: &str, size: f64, room: f64) -> String {
    let text = view::printable(text);
    if text_width(&text, size) <= room {
        return text;
    }
    let mut short: String = text;
    while !short.is_empty() && text_width(&short, size) + size > room {
        short.pop();
    }
    short + "…"
}

/// kuva interprets `$...$` as mathematics; a file name may contain ordinary dollar signs.
fn literal(text: &str) -> String {
    text.replace('$', "\\$")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dashes_run_on_through_corners() {
        // A straight line given by many points must be dashed like the same line given by its ends.
        let dense: Vec<(f64, f64)> = (0..=1_000).map(|i| (f64::from(i) * 0.1, 0.0)).collect();
        let ends = dashes(&[(0.0, 0.0), (100.0, 0.0)], &[6.0, 3.0]);
        let fine = dashes(&dense, &[6.0, 3.0]);
        assert_eq!(ends.len(), fine.len());
        for (a, b) in ends.iter().zip(&fine) {
            assert!((a[0].0 - b[0].0).abs() < 1e-9);
        }
        let drawn: f64 = ends.iter().map(|piece| piece[piece.len() - 1].0 - piece[0].0).sum();
        assert!((drawn - 67.0).abs() < 1e-9, "11 dashes of 6 and a last one of 1, got {drawn}");
    }

    #[test]
    fn a_long_title_takes_more_rows_and_loses_nothing() {
        let title = "strokes at 15 mm/s, with partial reversals and a rest between them";
        let rows = title_rows(title, 180.0);
        assert!(rows.len() > 1, "{rows:?}");
        assert_eq!(rows.join(" "), title);
        let is_inside = |row: &String| text_width(row, f64::from(LABEL_SIZE)) <= 150.0;
        assert!(rows.iter().all(is_inside), "{rows:?}");
    }

    #[test]
    fn gaps_split_a_line() {
        let nan = f64::NAN;
        let split = runs(
            [(0.0, 1.0), (1.0, 1.0), (nan, nan), (2.0, 0.0), (3.0, f64::INFINITY)].into_iter(),
        );
        assert_eq!(split, [vec![(0.0, 1.0), (1.0, 1.0)]]);
    }
}
