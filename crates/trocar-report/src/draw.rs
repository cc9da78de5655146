//! Composes a figure from kuva's primitives; kuva's own writers convert the scene to SVG and PNG.
//!
//! The axes are composed here and not by kuva's plots (0.6). The figures need legends in rows above
//! the axes whose entries join line, marker and band (kuva offers a column, one shape each), axes
//! aligned across stacked panels, labels of marks and intervals that avoid each other, maps of
//! classes with a text in each cell (kuva: one continuous scale, bare numbers in black), gaps (kuva
//! writes NaN into its paths), and dashes in the bitmap that do not restart at every point of a line.

mod labels;

use std::fmt::Write as _;

use kuva::backend::png::PngBackend;
use kuva::render::color::Color;
use kuva::render::render::{PathData, Primitive, Scene, TextAnchor, TextSpan};

use super::decimate;
use super::document::{Axis, Dimension, Figure, Kind, Mark, Panel, Role, Series};
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
        sheet.panel(frame, (figure.panels.len() > 1).then(|| view::letter(index)));
    }
    sheet.scene
}

/// Makes kuva unpack its fonts, which takes as long as drawing several figures and can run in
/// parallel with other work.
pub(super) fn load_fonts() {
    let mut sheet = Sheet { scene: Scene::new(1.0, 1.0), medium: Medium::Bitmap };
    sheet.rich_text([0.0, 0.0], [bold("a".to_owned())], 1, TextAnchor::Start);
    // Drawn for its side effect; an error would occur again, with a message, in the first figure.
    let _ = PngBackend::new().render_scene(&sheet.scene);
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
    panel: &'a Panel,
    left: f64,
    top: f64,
    width: f64,
    height: f64,
    limits: Limits,
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
        self.left + part(self.limits.x, &self.panel.x, value) * self.width
    }

    fn y(&self, value: f64) -> f64 {
        self.top + (1.0 - part(self.limits.y, &self.panel.y, value)) * self.height
    }
}

/// Position between the lower and the upper limit, 0 to 1; not finite if a logarithmic axis cannot
/// show the value.
fn part([low, high]: [f64; 2], axis: &Axis, value: f64) -> f64 {
    if axis.logarithmic {
        (value / low).ln() / (high / low).ln()
    } else {
        (value - low) / (high - low)
    }
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
        let margins = limits.iter().zip(&figure.panels);
        let margins = margins.map(|(limits, panel)| left_margin(limits.y, &panel.y));
        let left = margins.fold(0.0, f64::max);
        let right = figure.panels.iter().map(right_margin).fold(0.0, f64::max);
        let inner = cell - left - right;
        let mut layout = Self { width, height: 0.0, legend: Vec::new(), frames: Vec::new() };
        let common = common_legend(figure);
        if let Some(first) = figure.panels.first().filter(|_| common) {
            layout.legend = legend_rows(first, width - left - right);
        }
        let mut top = layout.legend.len() as f64 * LEGEND_ROW + if common { 2.0 } else { 0.0 };
        for (row, panels) in figure.panels.chunks(columns).enumerate() {
            // A letter alone needs no row of its own: it is placed before the legend.
            let titled = panels.iter().any(|panel| !panel.title.is_empty());
            let indent = if figure.panels.len() > 1 && !titled { LETTER } else { 0.0 };
            let legends: Vec<_> = match common {
                true => panels.iter().map(|_| Vec::new()).collect(),
                false => panels.iter().map(|panel| legend_rows(panel, inner - indent)).collect(),
            };
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
    fn new(panel: &'a Panel, [left, top, width, height]: [f64; 4], limits: Limits) -> Self {
        let mut frame = Self {
            panel,
            left,
            top,
            width,
            height,
            limits,
            x_ticks: axis_ticks(limits.x, &panel.x, ((width / 50.0) as usize).max(4)),
            y_ticks: Ticks { at: Vec::new(), labels: Vec::new() },
            title: 0.0,
            legend: Vec::new(),
            legend_indent: 0.0,
            names_x: true,
            label_rows: Vec::new(),
            label_distance: 0.0,
        };
        frame.label_rows = label_rows(&frame);
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
    let widest = labels.iter().map(|label| text_width(label, TICK_SIZE)).fold(12.0, f64::max);
    widest + 30.0
}

/// Space for the labels of horizontal marks, which are outside the axes at the right.
fn right_margin(panel: &Panel) -> f64 {
    let at_the_right = panel.marks.iter().filter(|mark| mark.axis == Dimension::Y);
    at_the_right.map(|mark| text_width(&mark.label, TICK_SIZE) + 10.0).fold(14.0, f64::max)
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
        let wide = SWATCH + 6.0 + text_width(entry.name, TICK_SIZE);
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
fn label_rows(frame: &Frame<'_>) -> Vec<usize> {
    let mut ends: Vec<f64> = Vec::new();
    let labelled = frame.panel.marks.iter().filter_map(|mark| x_label(mark, frame));
    labelled
        .map(|(label, centre)| {
            let half = text_width(label, TICK_SIZE) / 2.0 + 3.0;
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
    let (label, at) = (&mark.label, mark.middle());
    if mark.axis != Dimension::X || label.is_empty() || !at.is_finite() {
        return None;
    }
    let half = text_width(label, TICK_SIZE) / 2.0 + 4.0;
    Some((label, frame.x(at).min(frame.left + frame.width - half).max(frame.left + half)))
}

struct Sheet {
    scene: Scene,
    medium: Medium,
}

impl Sheet {
    fn panel(&mut self, frame: &Frame<'_>, letter: Option<String>) {
        self.head(frame, letter);
        self.ranges(frame);
        self.grid(frame);
        let (areas, curves): (Vec<&Series>, Vec<&Series>) =
            frame.panel.series.iter().partition(is_area);
        for series in areas {
            self.series(series, frame);
        }
        self.mark_lines(frame);
        // Measured curves lie over those of models, which are wider.
        let (measured, others): (Vec<&Series>, Vec<&Series>) =
            curves.into_iter().partition(|s| s.role == Role::Measured && s.kind == Kind::Line);
        for series in others.into_iter().chain(measured) {
            self.series(series, frame);
        }
        self.axes(frame);
        self.mark_labels(frame);
        self.point_labels(frame);
    }

    fn head(&mut self, frame: &Frame<'_>, letter: Option<String>) {
        let top = frame.top - 5.0 - frame.legend.len() as f64 * LEGEND_ROW;
        let baseline = if frame.title > 0.0 { top - 6.0 } else { top + LEGEND_ROW / 2.0 + 4.0 };
        let mut letter = letter.map(|letter| bold(letter + " "));
        let mut rows = title_rows(&frame.panel.title, frame.width);
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
                let ends = [[x, middle], [x + SWATCH, middle]];
                self.polyline(&ends, style.light, style.width, style.dash);
            }
            if entry.marker {
                self.markers(&[[x + SWATCH / 2.0, middle]], style, 2.8);
            }
            let room = self.scene.width - x - SWATCH - 6.0;
            let name = fitted(entry.name, f64::from(TICK_SIZE), room);
            self.text([x + SWATCH + 6.0, middle + 4.0], &name, TICK_SIZE, TextAnchor::Start);
        }
    }

    fn ranges(&mut self, frame: &Frame<'_>) {
        for mark in frame.panel.marks.iter().filter(|mark| !mark.is_line() && mark.is_finite()) {
            let (low, high) = (mark.from.min(mark.to), mark.from.max(mark.to));
            let Frame { left, top, width, height, .. } = *frame;
            let area = match mark.axis {
                Dimension::X => [frame.x(low), top, frame.x(high) - frame.x(low), height],
                Dimension::Y => [left, frame.y(high), width, frame.y(low) - frame.y(high)],
            };
            self.rectangle(area, RANGE, 0.2);
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

    fn mark_lines(&mut self, frame: &Frame<'_>) {
        for mark in frame.panel.marks.iter().filter(|mark| mark.is_line()) {
            let (x, y) = (frame.x(mark.from), frame.y(mark.from));
            let ends = match mark.axis {
                Dimension::X => [[x, frame.top], [x, frame.top + frame.height]],
                Dimension::Y => [[frame.left, y], [frame.left + frame.width, y]],
            };
            if ends.iter().all(is_drawable) {
                self.polyline(&ends, MARK, 1.0, &[4.0, 3.0]);
            }
        }
    }

    fn mark_labels(&mut self, frame: &Frame<'_>) {
        let labelled = frame.panel.marks.iter().filter_map(|mark| x_label(mark, frame));
        for ((label, centre), row) in labelled.zip(&frame.label_rows) {
            let y = frame.top + 13.0 + *row as f64 * LEGEND_ROW;
            let half = text_width(label, TICK_SIZE) / 2.0 + 2.0;
            self.rectangle([centre - half, y - 10.0, 2.0 * half, 13.0], "#ffffff", 0.75);
            self.text([centre, y], label, TICK_SIZE, TextAnchor::Middle);
        }
        let mut sides: Vec<(f64, &str)> =
            frame.panel.marks.iter().filter_map(|mark| y_label(mark, frame)).collect();
        sides.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut next = f64::NEG_INFINITY;
        for (y, label) in sides {
            let y = y.max(next);
            let right = frame.left + frame.width;
            self.text([right + 5.0, y + 4.0], label, TICK_SIZE, TextAnchor::Start);
            next = y + 12.0;
        }
    }

    fn point_labels(&mut self, frame: &Frame<'_>) {
        for ([x, y], label, colour) in labels::placed(frame) {
            let half = text_width(label, TICK_SIZE) / 2.0;
            self.rectangle([x - half - 1.0, y - 6.0, 2.0 * half + 2.0, 12.0], "#ffffff", 0.75);
            self.centred([x, y + 4.0], label, TICK_SIZE, colour);
        }
    }

    fn axes(&mut self, frame: &Frame<'_>) {
        let (right, bottom) = (frame.left + frame.width, frame.top + frame.height);
        for (x, label) in frame.x_ticks.placed(|at| frame.x(at)) {
            self.line([x, bottom, x, bottom - TICK_LENGTH], INK, 0.8);
            if frame.names_x {
                self.text([x, bottom + 15.0], label, TICK_SIZE, TextAnchor::Middle);
            }
        }
        for (y, label) in frame.y_ticks.placed(|at| frame.y(at)) {
            self.line([frame.left, y, frame.left + TICK_LENGTH, y], INK, 0.8);
            self.text([frame.left - 6.0, y + 4.0], label, TICK_SIZE, TextAnchor::End);
        }
        let corners =
            [(frame.left, frame.top), (right, frame.top), (right, bottom), (frame.left, bottom)];
        for (from, to) in corners.into_iter().zip(corners.into_iter().cycle().skip(1)) {
            self.line([from.0, from.1, to.0, to.1], INK, 0.8);
        }
        if frame.names_x {
            let (label, size) = axis_title(&frame.panel.x, frame.width + 70.0);
            let middle = [frame.left + frame.width / 2.0, bottom + 33.0];
            self.rich_text(middle, [bold(label)], size, TextAnchor::Middle);
        }
        let (label, size) = axis_title(&frame.panel.y, frame.height + 70.0);
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
        let place = |i: usize| [frame.x(series.x[i]), frame.y(series.y[i])];
        let columns = frame.width as usize;
        match &series.kind {
            Kind::Line => {
                let [low, high] = frame.limits.x;
                let kept = decimate::path(&series.x, &series.y, low, high, columns, PRINTED_POINTS);
                for run in runs(kept.into_iter().map(place)) {
                    self.polyline(&run, style.light, style.width, style.dash);
                }
            }
            Kind::Band { low, high } => {
                let kept = decimate::band(
                    &series.x,
                    [low, high],
                    frame.limits.x,
                    columns,
                    PRINTED_POINTS / 2,
                );
                for run in runs(
                    kept.into_iter()
                        .map(|i| [frame.x(series.x[i]), frame.y(low[i]), frame.y(high[i])]),
                ) {
                    self.area(&run, style.light);
                }
            }
            Kind::Labelled { .. } => {
                let places = (0..series.x.len()).map(place).filter(is_drawable);
                self.markers(&places.collect::<Vec<_>>(), style, LABELLED_RADIUS);
            }
            Kind::Points => {
                let (limits, cells) = (frame.limits.flat(), [columns, frame.height as usize]);
                let kept = decimate::markers(&series.x, &series.y, limits, cells, PRINTED_POINTS);
                let places: Vec<_> = kept.into_iter().map(place).filter(is_drawable).collect();
                self.markers(&places, style, style::marker_radius(places.len()));
            }
            Kind::Cells { size, labels } => self.cells(series, *size, labels, frame),
            Kind::ErrorBars { low, high } => self.error_bars(series, [low, high], frame),
        }
    }

    fn cells(&mut self, series: &Series, size: [f64; 2], labels: &[String], frame: &Frame<'_>) {
        let (fill, ink) = (style::of(series.role).light, style::ink_upon(series.role));
        let widest = text_width(WIDEST_LABEL, CELL_SIZE);
        for ((x, y), label) in series.x.iter().zip(&series.y).zip(labels) {
            let [(left, bottom), (right, top)] =
                [-0.5, 0.5].map(|k| (frame.x(x + k * size[0]), frame.y(y + k * size[1])));
            // Half a pixel more, so that no line of light stands between two cells.
            self.rectangle([left, top, right - left + 0.5, bottom - top + 0.5], fill, 1.0);
            // All labels of a map or none.
            if widest < right - left - 1.0 && f64::from(CELL_SIZE) < bottom - top {
                let middle = 0.5 * (top + bottom) + 0.36 * f64::from(CELL_SIZE);
                self.centred([0.5 * (left + right), middle], label, CELL_SIZE, ink);
            }
        }
    }

    fn error_bars(&mut self, series: &Series, ends: [&[f64]; 2], frame: &Frame<'_>) {
        let style = style::of(series.role);
        let mut places = Vec::new();
        for (i, (x, y)) in series.x.iter().zip(&series.y).enumerate() {
            let (x, y) = (frame.x(*x), frame.y(*y));
            if !is_drawable(&[x, y]) {
                continue;
            }
            places.push([x, y]);
            let [bottom, top] = ends.map(|end| frame.y(end[i]));
            if is_drawable(&[bottom, top]) {
                self.line([x, bottom, x, top], style.light, 1.0);
                for y in [bottom, top] {
                    self.line([x - 3.0, y, x + 3.0, y], style.light, 1.0);
                }
            }
        }
        self.markers(&places, style, style::marker_radius(places.len()));
    }

    fn markers(&mut self, places: &[[f64; 2]], style: Style, radius: f64) {
        if style.marker == Marker::Circle {
            self.scene.add(Primitive::CircleBatch {
                cx: places.iter().map(|place| place[0]).collect(),
                cy: places.iter().map(|place| place[1]).collect(),
                r: radius,
                fill: Color::from(style.light),
                fill_opacity: None,
                stroke: None,
                stroke_width: None,
            });
            return;
        }
        let mut outline = String::new();
        for [x, y] in places {
            let corners = corners(style.marker, radius).into_iter();
            close(&mut outline, corners.map(|[dx, dy]| [x + dx, y + dy]));
        }
        self.fill(outline, style.light, 1.0);
    }

    fn area(&mut self, run: &[[f64; 3]], colour: &str) {
        let lower = run.iter().map(|&[x, lower, _]| [x, lower]);
        let upper = run.iter().rev().map(|&[x, _, upper]| [x, upper]);
        let mut outline = String::new();
        close(&mut outline, lower.chain(upper));
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

    fn polyline(&mut self, points: &[[f64; 2]], colour: &str, width: f64, dash: &[f64]) {
        if dash.is_empty() || self.medium == Medium::Vector {
            let lengths: Vec<String> = dash.iter().map(f64::to_string).collect();
            self.stroke(points, colour, width, (!dash.is_empty()).then(|| lengths.join(" ")));
        } else {
            for piece in dashes(points, dash) {
                self.stroke(&piece, colour, width, None);
            }
        }
    }

    fn stroke(&mut self, points: &[[f64; 2]], colour: &str, width: f64, dash: Option<String>) {
        self.scene.add(Primitive::PolyLine {
            points: points.iter().map(|&[x, y]| (x, y)).collect(),
            stroke: Color::from(colour),
            stroke_width: width,
            stroke_dasharray: dash,
        });
    }

    fn line(&mut self, [x1, y1, x2, y2]: [f64; 4], colour: &str, stroke_width: f64) {
        let (stroke, stroke_dasharray) = (Color::from(colour), None);
        self.scene.add(Primitive::Line { x1, y1, x2, y2, stroke, stroke_width, stroke_dasharray });
    }

    fn rectangle(&mut self, [x, y, width, height]: [f64; 4], colour: &str, opacity: f64) {
        self.scene.add(Primitive::Rect {
            x,
            y,
            width,
            height,
            fill: Color::from(colour),
            stroke: None,
            stroke_width: None,
            opacity: Some(opacity),
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

    fn text(&mut self, at: [f64; 2], text: &str, size: u32, anchor: TextAnchor) {
        self.words(at, text, size, anchor, None);
    }

    /// A text in a colour of its own, centred at `at`.
    fn centred(&mut self, at: [f64; 2], text: &str, size: u32, colour: &str) {
        self.words(at, text, size, TextAnchor::Middle, Some(Color::from(colour)));
    }

    fn words(
        &mut self,
        [x, y]: [f64; 2],
        text: &str,
        size: u32,
        anchor: TextAnchor,
        color: Option<Color>,
    ) {
        let content = literal(&view::printable(text));
        let (rotate, bold) = (None, false);
        self.scene.add(Primitive::Text { x, y, content, size, anchor, rotate, bold, color });
    }
}

/// Whether a series is drawn behind all curves.
fn is_area(series: &&Series) -> bool {
    matches!(series.kind, Kind::Band { .. } | Kind::Cells { .. })
}

/// Label of an axis and the font size at which it fits into `room`; at the smallest size the name
/// is shortened, never the unit.
///
/// Axis labels are bold because kuva's rasteriser always draws rotated text in bold.
fn axis_title(axis: &Axis, room: f64) -> (String, u32) {
    const BOLD: f64 = 1.12;
    let label = view::printable(&view::axis_label(&axis.label, &axis.unit));
    let mut sizes = (9..=LABEL_SIZE).rev();
    if let Some(size) = sizes.find(|size| text_width(&label, f64::from(*size) * BOLD) <= room) {
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
    let y = frame.y(mark.middle());
    let is_shown = mark.axis == Dimension::Y && !mark.label.is_empty() && y.is_finite();
    is_shown.then_some((y, mark.label.as_str()))
}

/// Whether a point, or a pair of points, can be drawn.
fn is_drawable<const N: usize>(point: &[f64; N]) -> bool {
    point.iter().all(|coordinate| coordinate.is_finite())
}

/// The runs between gaps, at least two points long.
fn runs<const N: usize>(points: impl Iterator<Item = [f64; N]>) -> Vec<Vec<[f64; N]>> {
    let mut runs = vec![Vec::new()];
    for point in points {
        if !is_drawable(&point) {
            runs.push(Vec::new());
        } else if let Some(run) = runs.last_mut() {
            run.push(point);
        }
    }
    runs.retain(|run| run.len() > 1);
    runs
}

/// The drawn pieces of a dashed polyline; the pattern continues through its corners.
fn dashes(points: &[[f64; 2]], pattern: &[f64]) -> Vec<Vec<[f64; 2]>> {
    let (mut pieces, mut index, mut left) = (Vec::new(), 0, pattern[0]);
    let mut piece: Vec<[f64; 2]> = points.first().copied().into_iter().collect();
    for pair in points.windows(2) {
        let (from, to) = (pair[0], pair[1]);
        let length = (to[0] - from[0]).hypot(to[1] - from[1]);
        let mut done = 0.0;
        while length - done > left {
            done += left;
            let at = [0, 1].map(|k| from[k] + (to[k] - from[k]) * done / length);
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

/// Corners of a filled marker around the origin, with about the area of a circle of radius `r`.
fn corners(marker: Marker, r: f64) -> Vec<[f64; 2]> {
    let a = 0.9 * r;
    match marker {
        Marker::Circle => Vec::new(),
        Marker::Square => vec![[-a, -a], [a, -a], [a, a], [-a, a]],
        Marker::Triangle => vec![[0.0, -1.3 * r], [1.2 * r, a], [-1.2 * r, a]],
        Marker::Diamond => vec![[0.0, -1.4 * r], [1.2 * r, 0.0], [0.0, 1.4 * r], [-1.2 * r, 0.0]],
    }
}

/// Appends a closed path through `points` to an outline.
fn close(outline: &mut String, points: impl Iterator<Item = [f64; 2]>) {
    for (at, [x, y]) in points.enumerate() {
        let command = if at == 0 { 'M' } else { 'L' };
        // Writing to a String cannot fail.
        let _ = write!(outline, "{command}{x:.2} {y:.2}");
    }
    outline.push('Z');
}

/// The title of a panel in rows as wide as the panel; only a word wider than that is shortened.
fn title_rows(title: &str, width: f64) -> Vec<String> {
    let (size, room) = (f64::from(LABEL_SIZE), width - LETTER_ROOM);
    let mut rows: Vec<String> = Vec::new();
    for word in title.split_whitespace() {
        let longer = rows.last().map(|row| format!("{row} {word}"));
        match (rows.last_mut(), longer) {
            (Some(row), Some(longer)) if text_width(&view::printable(&longer), size) <= room => {
                *row = longer;
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
        let dense: Vec<[f64; 2]> = (0..=1_000).map(|i| [f64::from(i) * 0.1, 0.0]).collect();
        let ends = dashes(&[[0.0, 0.0], [100.0, 0.0]], &[6.0, 3.0]);
        let fine = dashes(&dense, &[6.0, 3.0]);
        assert_eq!(ends.len(), fine.len());
        for (a, b) in ends.iter().zip(&fine) {
            assert!((a[0][0] - b[0][0]).abs() < 1e-9);
        }
        let drawn: f64 = ends.iter().map(|piece| piece[piece.len() - 1][0] - piece[0][0]).sum();
        assert!((drawn - 67.0).abs() < 1e-9, "11 dashes of 6 and a last one of 1, got {drawn}");
    }

    #[test]
    fn a_long_title_takes_more_rows_and_loses_nothing() {
        let title = "strokes at 15 mm/s, with partial reversals and a rest between them";
        let rows = title_rows(title, 180.0);
        assert!(rows.len() > 1, "{rows:?}");
        assert_eq!(rows.join(" "), title);
        assert!(rows.iter().all(|row| text_width(row, LABEL_SIZE) <= 150.0), "{rows:?}");
    }

    #[test]
    fn gaps_split_a_line() {
        let nan = f64::NAN;
        let split = runs(
            [[0.0, 1.0], [1.0, 1.0], [nan, nan], [2.0, 0.0], [3.0, f64::INFINITY]].into_iter(),
        );
        assert_eq!(split, [vec![[0.0, 1.0], [1.0, 1.0]]]);
    }
}
