//! The contents of a report: plain data, filled from results.
//!
//! Numbers in these types have the unit of their axis or row; the drawing code converts nothing.
use std::ops::Range;

use serde::Serialize;

use super::codes::{codes, numbers};

/// Height of a panel's axes relative to their width, where nothing else is said.
const DEFAULT_ASPECT: f64 = 0.56;

/// A numbered figure: one or more panels on a common sheet, drawn as SVG, as PNG and as interactive
/// charts.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Figure {
    /// File stem and HTML anchor, for example `velocity-step`: lower-case letters, digits and
    /// hyphens, unique in a document.
    pub id: String,
    /// Number printed before the title ("Figure 3").
    pub number: u32,
    /// Short title, one line.
    pub title: String,
    /// Explanation below the figure, in whole sentences. Also the description for screen readers.
    pub caption: String,
    /// Panels in reading order, lettered (a), (b), ... when there is more than one.
    pub panels: Vec<Panel>,
    /// Panels per row: 1 stacks them, 2 fills rows of two.
    pub columns: usize,
    /// All panels share the x axis: zoom and cursor are linked.
    pub linked_x: bool,
    /// Width on paper.
    pub width: Width,
}

impl Figure {
    /// A figure without panels, stacked, at full text width.
    pub fn new(id: impl Into<String>, number: u32, title: impl Into<String>) -> Self {
        Self { id: id.into(), number, title: title.into(), columns: 1, ..Self::default() }
    }

    /// Sets the caption.
    pub fn caption(mut self, caption: impl Into<String>) -> Self {
        self.caption = caption.into();
        self
    }

    /// Appends a panel.
    pub fn panel(mut self, panel: Panel) -> Self {
        self.panels.push(panel);
        self
    }

    /// Places `columns` panels in a row.
    pub fn columns(mut self, columns: usize) -> Self {
        self.columns = columns;
        self
    }

    /// Links zoom and cursor of all panels along x.
    pub fn linked_x(mut self) -> Self {
        self.linked_x = true;
        self
    }

    /// Sets the width on paper.
    pub fn width(mut self, width: Width) -> Self {
        self.width = width;
        self
    }
}

/// Width of a figure on paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Width {
    /// 160 mm: the text width of an A4 page.
    #[default]
    Text,
    /// 110 mm: for a single small panel.
    Narrow,
}

impl Width {
    /// The width in millimetres.
    pub const fn millimetres(self) -> f64 {
        match self {
            Width::Text => 160.0,
            Width::Narrow => 110.0,
        }
    }
}

/// One pair of axes with its contents.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Panel {
    /// Title that distinguishes this panel from the others ("15 mm/s"); may be empty.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Data, drawn in this order: the last one is on top (bands are always behind all other
    /// series).
    pub series: Vec<Series>,
    /// Lines and ranges with labels, such as the two transients T1 and T2.
    pub marks: Vec<Mark>,
    /// Height of the axes divided by their width, 0.56 where nothing else is said.
    pub aspect: f64,
}

impl Panel {
    /// An empty panel.
    pub fn new(x: Axis, y: Axis) -> Self {
        Self { x, y, aspect: DEFAULT_ASPECT, ..Self::default() }
    }

    /// Sets the title.
    pub fn title(mut self, title: impl Into<String>) -> Self {
        self.title = title.into();
        self
    }

    /// Appends a series.
    pub fn series(mut self, series: Series) -> Self {
        self.series.push(series);
        self
    }

    /// Appends a line and a marker at each of its points.
    pub(crate) fn curve(self, name: &str, role: Role, x: &[f64], y: &[f64]) -> Self {
        self.series(Series::line(name, role, x.to_vec(), y.to_vec())).series(Series::points(
            name,
            role,
            x.to_vec(),
            y.to_vec(),
        ))
    }

    /// Whether its axes show anything.
    fn has_values(&self) -> bool {
        let mut points =
            self.series.iter().flat_map(|s| (0..s.x.len()).map(|i| (s.x[i], s.y.get(i))));
        points.any(|(x, y)| {
            let is_shown = y.is_none_or(|y| y.is_finite() && (!self.y.logarithmic || *y > 0.0));
            x.is_finite() && is_shown
        })
    }

    /// Appends a mark.
    pub fn mark(mut self, mark: Mark) -> Self {
        self.marks.push(mark);
        self
    }

    /// Sets the ratio of height to width of the axes.
    pub fn aspect(mut self, aspect: f64) -> Self {
        self.aspect = aspect;
        self
    }
}

/// Name and unit of an axis, printed as "name (unit)".
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Axis {
    /// Quantity with its symbol, for example "deflection z".
    pub label: String,
    /// Unit, for example "mm"; empty for a number without unit.
    pub unit: String,
    /// The axis includes zero even if the data do not.
    pub include_zero: bool,
    /// Logarithmic scale; values that are not positive are not drawn.
    pub logarithmic: bool,
    /// Texts at 0, 1, 2, … instead of numbers; for vertical axes.
    pub names: Vec<String>,
}

impl Axis {
    /// An axis that spans its data.
    pub fn new(label: impl Into<String>, unit: impl Into<String>) -> Self {
        Self { label: label.into(), unit: unit.into(), ..Self::default() }
    }

    /// An axis that always shows zero.
    pub fn with_zero(mut self) -> Self {
        self.include_zero = true;
        self
    }

    /// A vertical axis of named positions, the first of them at 0.
    pub fn named(names: Vec<String>) -> Self {
        Self { names, ..Self::new("", "") }
    }

    /// An axis with a logarithmic scale.
    pub fn logarithmic(mut self) -> Self {
        self.logarithmic = true;
        self
    }
}

/// A named set of points with its role and drawing style.
///
/// `x` and `y` have equal length, as do the texts of labelled points and the `low`, `high` of a
/// band or of error bars; a band's `y` may be empty. A non-finite value is a gap. `x` need not be
/// sorted: loops are drawn as they are.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Name in the legend; series of equal name and role in one figure share a legend entry.
    pub name: String,
    /// Meaning of the series; determines colour, line width and dash.
    pub role: Role,
    /// Drawing style.
    pub kind: Kind,
    /// Abscissae, in the unit of the panel's x axis.
    pub x: Vec<f64>,
    /// Ordinates, in the unit of the panel's y axis.
    pub y: Vec<f64>,
}

impl Series {
    /// A line through the points.
    pub fn line(name: impl Into<String>, role: Role, x: Vec<f64>, y: Vec<f64>) -> Self {
        Self { name: name.into(), role, kind: Kind::Line, x, y }
    }

    /// A marker at each point.
    pub fn points(name: impl Into<String>, role: Role, x: Vec<f64>, y: Vec<f64>) -> Self {
        Self { name: name.into(), role, kind: Kind::Points, x, y }
    }

    /// A marker at each point with a text beside it.
    pub fn labelled(
        name: impl Into<String>,
        role: Role,
        x: Vec<f64>,
        y: Vec<f64>,
        labels: Vec<String>,
    ) -> Self {
        Self { name: name.into(), role, kind: Kind::Labelled { labels }, x, y }
    }

    /// The area between two curves.
    pub fn band(
        name: impl Into<String>,
        role: Role,
        x: Vec<f64>,
        low: Vec<f64>,
        high: Vec<f64>,
    ) -> Self {
        Self { name: name.into(), role, kind: Kind::Band { low, high }, x, y: Vec::new() }
    }

    /// Cells of a map around the points, with a text each.
    pub fn cells(
        name: impl Into<String>,
        role: Role,
        size: [f64; 2],
        [x, y]: [Vec<f64>; 2],
        labels: Vec<String>,
    ) -> Self {
        Self { name: name.into(), role, kind: Kind::Cells { size, labels }, x, y }
    }

    /// Markers with a vertical bar from `low` to `high` (absolute values, not lengths).
    pub fn error_bars(
        name: impl Into<String>,
        role: Role,
        x: Vec<f64>,
        y: Vec<f64>,
        low: Vec<f64>,
        high: Vec<f64>,
    ) -> Self {
        Self { name: name.into(), role, kind: Kind::ErrorBars { low, high }, x, y }
    }
}

impl Series {
    /// Whether all its columns are of equal length.
    pub(crate) fn is_even(&self) -> bool {
        let (x, y) = (self.x.len(), self.y.len());
        match &self.kind {
            Kind::Line | Kind::Points => x == y,
            Kind::Labelled { labels } | Kind::Cells { labels, .. } => [y, labels.len()] == [x; 2],
            Kind::Band { low, high } => [low.len(), high.len()] == [x; 2],
            Kind::ErrorBars { low, high } => [y, low.len(), high.len()] == [x; 3],
        }
    }
}

/// Meaning of a series. Equal roles look the same in every figure of a document.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Readings of the sensor.
    Measured,
    /// The same behind several models: wide and pale.
    Backdrop,
    /// Computed by the identified model.
    Model,
    /// A curve fitted to the points in the same panel.
    Fit,
    /// The fit that was not chosen.
    Alternative,
    /// Lower confidence limit.
    Lower,
    /// Upper confidence limit.
    Upper,
    /// Computed deflection of the seal.
    Deflection,
    /// Measured minus computed values.
    Residual,
    /// True values of a virtual bench, or published values.
    Reference,
    /// An auxiliary line.
    Neutral,
    /// One of several equivalent series (recordings, speeds); colours and markers repeat after six.
    Category(u8),
    /// A class of a map's values, from the lowest, 0, to the highest, 6.
    Level(u8),
    /// A compared friction model: colour and marker by its kind, as in a model file, dashes by
    /// variant (three of them).
    Friction(&'static str, u8),
}

/// Drawing style of a series.
#[derive(Debug, Clone, PartialEq)]
pub enum Kind {
    /// Straight segments between consecutive points.
    Line,
    /// One marker per point.
    Points,
    /// One marker per point with a text beside it, placed to avoid overlaps.
    Labelled {
        /// The texts, one per point.
        labels: Vec<String>,
    },
    /// Filled area between `low` and `high`.
    Band {
        /// Lower edge, unit of the y axis.
        low: Vec<f64>,
        /// Upper edge, unit of the y axis.
        high: Vec<f64>,
    },
    /// A filled rectangle around each point with its text inside where that fits: cells of a map, one series for each class of their values.
    Cells {
        /// Width and height, units of the axes.
        size: [f64; 2],
        /// The texts, one per point.
        labels: Vec<String>,
    },
    /// Marker with a vertical bar.
    ErrorBars {
        /// Lower end of each bar, unit of the y axis.
        low: Vec<f64>,
        /// Upper end of each bar, unit of the y axis.
        high: Vec<f64>,
    },
}

/// A labelled line across an axis, or a shaded interval of it. With an empty label only the line or interval is drawn.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Mark {
    /// The axis that it marks.
    pub axis: Dimension,
    /// Lower end of the interval, or the line, unit of the axis.
    pub from: f64,
    /// Upper end; the same as `from` for a line.
    pub to: f64,
    /// Text at the upper end (x) or at the right (y).
    pub label: String,
}

/// One of the two axes of a panel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Dimension {
    /// The horizontal axis.
    X,
    /// The vertical axis.
    Y,
}

impl Mark {
    /// Vertical line at `at`.
    pub fn x(at: f64, label: impl Into<String>) -> Self {
        Self::x_range(at, at, label)
    }

    /// Horizontal line at `at`.
    pub fn y(at: f64, label: impl Into<String>) -> Self {
        Self::y_range(at, at, label)
    }

    /// Shaded interval of x.
    pub fn x_range(from: f64, to: f64, label: impl Into<String>) -> Self {
        Self { axis: Dimension::X, from, to, label: label.into() }
    }

    /// Shaded interval of y.
    pub fn y_range(from: f64, to: f64, label: impl Into<String>) -> Self {
        Self { axis: Dimension::Y, from, to, label: label.into() }
    }

    /// Whether it is a line, no interval.
    pub(crate) fn is_line(&self) -> bool {
        self.from == self.to
    }

    /// Whether both ends can be drawn.
    pub(crate) fn is_finite(&self) -> bool {
        self.from.is_finite() && self.to.is_finite()
    }

    /// Where its label belongs.
    pub(crate) fn middle(&self) -> f64 {
        (self.from + self.to) / 2.0
    }
}

/// A table with a caption; numeric cells are right-aligned.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// Title above the table.
    pub caption: String,
    /// Column headings.
    pub columns: Vec<String>,
    /// Rows, each as long as `columns`.
    pub rows: Vec<Vec<Cell>>,
    /// Whether the reader has to open it.
    pub collapsed: bool,
    /// Columns that the reader has to switch on, and the words beside the switch.
    pub optional: Option<(Range<usize>, &'static str)>,
}

impl Table {
    /// A table without rows.
    pub fn new<S: Into<String>>(
        caption: impl Into<String>,
        columns: impl IntoIterator<Item = S>,
    ) -> Self {
        Self {
            caption: caption.into(),
            columns: columns.into_iter().map(Into::into).collect(),
            ..Self::default()
        }
    }

    /// A table of `items`, one a row.
    pub(crate) fn of<T>(
        caption: impl Into<String>,
        items: impl IntoIterator<Item = T>,
        columns: &[Column<'_, T>],
    ) -> Self {
        Self {
            rows: items
                .into_iter()
                .map(|item| columns.iter().map(|(_, cell)| cell(&item)).collect())
                .collect(),
            ..Self::new(caption, columns.iter().map(|(heading, _)| *heading))
        }
    }

    /// The same table, to be opened by the reader.
    pub(crate) fn collapsed(self) -> Self {
        Self { collapsed: true, ..self }
    }

    /// Appends a row.
    pub fn row(mut self, cells: impl IntoIterator<Item = Cell>) -> Self {
        self.rows.push(cells.into_iter().collect());
        self
    }
}

/// Heading of a column, and its cell for an item.
pub(crate) type Column<'c, T> = (&'c str, &'c dyn Fn(&T) -> Cell);

/// One cell of a table.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// Plain text.
    Text(String),
    /// Identifier in a monospaced font: file name, hash, key.
    Code(String),
    /// Number with the given significant digits; a non-finite number is printed as a dash.
    Number {
        /// The number, in the unit of its column or row.
        value: f64,
        /// Significant digits, at least 1.
        digits: usize,
    },
    /// Number with as many decimals as its interval supports (two significant digits of half the
    /// interval).
    Estimate {
        /// The value.
        value: f64,
        /// Interval that determines the rounding.
        interval: [f64; 2],
    },
    /// Interval, rounded like [`Cell::Estimate`].
    Interval {
        /// Lower end.
        low: f64,
        /// Upper end.
        high: f64,
    },
    /// Marker: the data do not determine this value.
    Undetermined,
    /// Doubtful: the text with a warning marker.
    Warning(String),
}

impl Cell {
    /// `value` with `digits` significant digits.
    pub(crate) const fn number(value: f64, digits: usize) -> Self {
        Self::Number { value, digits }
    }

    /// A count of things.
    pub(crate) fn count(of: usize) -> Self {
        Self::Text(of.to_string())
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Cell::Text(text.to_owned())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Cell::Text(text)
    }
}

/// A number at the head of the report.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tile {
    /// Name of the number.
    pub label: String,
    /// The number with its unit, ready to print.
    pub value: String,
    /// A remark in small print, such as the interval or the limit; may be empty.
    pub note: String,
}

impl Tile {
    /// A tile.
    pub fn new(
        label: impl Into<String>,
        value: impl Into<String>,
        note: impl Into<String>,
    ) -> Self {
        Self { label: label.into(), value: value.into(), note: note.into() }
    }
}

/// An interactive model in the page: its parameters can be adjusted, and it can be moved by hand.
///
/// Unlike all other data of a document its numbers are in SI units: the page simulates the model
/// with them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LiveModel {
    /// The model in the form of [`trocar_model::Trocar::write_numbers`].
    #[serde(serialize_with = "numbers")]
    pub row: Vec<f64>,
    /// Range of motion by hand, m.
    pub way: [f64; 2],
    /// All of [`trocar_model::Seal::tunables`], in that order.
    pub knobs: Vec<Knob>,
    /// A recorded motion for the simulation.
    pub excerpt: Option<Excerpt>,
    /// How the instrument turns; `None` for a model without rotation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub turning: Option<LiveTurning>,
}

/// What a page needs in order to show the force in its ellipse: half axes along the shaft (F_c of each
/// direction) and around it (F_t/F_c of their mean).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LiveTurning {
    /// r, m.
    pub radius: f64,
    /// F_t/F_c.
    pub ratio: f64,
    /// Places of the Coulomb forces of all elements among the knobs: insertion, withdrawal.
    pub coulomb: [Vec<usize>; 2],
}

/// An adjustable parameter.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Knob {
    /// Name in words.
    pub name: String,
    /// Symbol, Unicode; may be empty.
    pub symbol: String,
    /// Displayed unit, for example "mm"; empty for a number without unit.
    pub unit: String,
    /// Factor from SI to the displayed unit.
    pub scale: f64,
    /// Value of the model, SI.
    pub value: f64,
    /// Ends of the slider, SI; `None` if the model does not use the parameter or has no finite
    /// value of it.
    pub range: Option<[f64; 2]>,
    /// 95 % interval, SI.
    pub interval: Option<[f64; 2]>,
    /// Index of the same parameter of the other direction, if both directions have one value.
    pub follows: Option<usize>,
    /// Whether it is shown by default.
    #[serde(rename = "main")]
    pub is_main: bool,
}

/// A recorded motion at equal time intervals, with the measured force.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Excerpt {
    /// Description, such as "surgeon.csv from 12.5 s on".
    pub name: String,
    /// Time between two samples, s.
    pub interval: f64,
    /// Position of the instrument, m.
    #[serde(serialize_with = "codes")]
    pub position: Vec<f64>,
    /// Readings without the sensor offset, N; one per position.
    #[serde(serialize_with = "codes")]
    pub force: Vec<f64>,
    /// Angle since the first sample, rad; one per position, or none where it was not recorded.
    #[serde(serialize_with = "codes", skip_serializing_if = "Vec::is_empty")]
    pub angle: Vec<f64>,
    /// Sample from which the force of the model does not depend on the unknown initial state.
    #[serde(rename = "known")]
    pub known_from: usize,
}

/// An interactive loop in the page: what `trocar teleop` runs, with a hand that the reader moves.
///
/// Its numbers are in SI units.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct LiveLoop {
    /// The configuration, with the keys of its file.
    pub config: serde_json::Value,
    /// The trocar in the form of [`trocar_model::Trocar::write_numbers`].
    #[serde(serialize_with = "numbers")]
    pub trocar: Vec<f64>,
    /// The compensator's model in the same form.
    #[serde(serialize_with = "numbers")]
    pub compensator: Vec<f64>,
    /// Where the hand begins, m.
    pub start: f64,
    /// Range of its motion, m.
    pub way: [f64; 2],
}

/// A section of the report: paragraphs, then tables, then figures, then an interactive model or loop.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Section {
    /// Heading.
    pub heading: String,
    /// Plain text.
    pub paragraphs: Vec<String>,
    /// Tables in order.
    pub tables: Vec<Table>,
    /// Figures in order.
    pub figures: Vec<Figure>,
    /// An interactive model; at most one in a document.
    pub live: Option<LiveModel>,
    /// An interactive loop in place of it.
    pub(crate) live_loop: Option<LiveLoop>,
}

impl Section {
    /// An empty section.
    pub fn new(heading: impl Into<String>) -> Self {
        Self { heading: heading.into(), ..Self::default() }
    }

    /// Sets the interactive model.
    pub fn live(mut self, model: LiveModel) -> Self {
        self.live = Some(model);
        self
    }

    /// Appends a paragraph.
    pub fn paragraph(mut self, text: impl Into<String>) -> Self {
        self.paragraphs.push(text.into());
        self
    }

    /// Appends a table.
    pub fn table(mut self, table: Table) -> Self {
        self.tables.push(table);
        self
    }

    /// Appends a figure without those of its panels that would be empty axes. A figure whose caption
    /// names its panels by their letters keeps them all, unless all are empty.
    pub fn figure(mut self, mut figure: Figure) -> Self {
        if !figure.panels.iter().any(Panel::has_values) {
            return self
                .paragraph(format!("There is no figure “{}”: it has no values.", figure.title));
        }
        if !figure.caption.contains("(b)") {
            figure.panels.retain(Panel::has_values);
        }
        self.figures.push(figure);
        self
    }

    /// Appends the figure, or the reason why there is none.
    pub(crate) fn drawn(self, drawn: Result<Figure, String>) -> Self {
        match drawn {
            Ok(figure) => self.figure(figure),
            Err(why) => self.paragraph(why),
        }
    }
}

/// A whole report. Nothing in it may depend on time or machine, so that equal results give equal
/// bytes.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Document {
    /// Title of page and window.
    pub title: String,
    /// One line under the title.
    pub subtitle: String,
    /// The model card: label and value.
    pub card: Vec<(String, String)>,
    /// Key numbers.
    pub tiles: Vec<Tile>,
    /// What the reader must know before relying on the numbers.
    pub warnings: Vec<String>,
    /// Remarks that leave the numbers as they are.
    pub notes: Vec<String>,
    /// Sections.
    pub sections: Vec<Section>,
    /// Origin: label and value, such as the program's version and the hashes of the inputs.
    pub provenance: Vec<(String, String)>,
}

impl Document {
    /// The document with its figures numbered in order.
    pub(crate) fn numbered(mut self) -> Self {
        let drawn = self.sections.iter_mut().flat_map(|section| &mut section.figures);
        drawn.zip(1..).for_each(|(figure, number)| figure.number = number);
        self
    }
}

/// A line of [`Document::provenance`].
pub(crate) fn origin(label: impl Into<String>, value: impl Into<String>) -> (String, String) {
    (label.into(), value.into())
}
