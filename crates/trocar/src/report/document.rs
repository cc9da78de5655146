//! What a report is made of: plain data, filled by whoever has the results.
//!
//! Numbers in these types are in the unit written on their axis or in their row; the drawing code converts nothing.

/// One panel's worth of space per row, relative to the width of the panel.
pub const DEFAULT_ASPECT: f64 = 0.56;

/// A numbered figure: one or more panels on a common sheet, drawn as SVG, as PNG and as interactive charts.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// File stem and HTML anchor, for example `velocity-step`: lower-case letters, digits and hyphens, unique in a document.
    pub id: String,
    /// Number printed before the title ("Figure 3").
    pub number: u32,
    /// Short title, one line.
    pub title: String,
    /// Explanation under the figure, in whole sentences. Also the description read out by a screen reader.
    pub caption: String,
    /// Panels in reading order, lettered (a), (b), ... when there is more than one.
    pub panels: Vec<Panel>,
    /// Panels beside each other: 1 stacks them, 2 fills rows of two.
    pub columns: usize,
    /// Panels share one x axis: zoom and cursor move together.
    pub linked_x: bool,
    /// Width on paper.
    pub width: Width,
}

impl Figure {
    /// A figure without panels yet, stacked, at full text width.
    pub fn new(id: impl Into<String>, number: u32, title: impl Into<String>) -> Self {
        Self {
            id: id.into(),
            number,
            title: title.into(),
            caption: String::new(),
            panels: Vec::new(),
            columns: 1,
            linked_x: false,
            width: Width::Text,
        }
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

    /// Puts `columns` panels beside each other.
    pub fn columns(mut self, columns: usize) -> Self {
        self.columns = columns;
        self
    }

    /// Couples zoom and cursor of all panels along x.
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

/// One pair of axes with what is drawn in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    /// What tells this panel from its neighbours ("15 mm/s"); may be empty.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Data, drawn in this order: the last one is on top (bands are always behind everything else).
    pub series: Vec<Series>,
    /// Lines and ranges with labels, such as the two transients T1 and T2.
    pub marks: Vec<Mark>,
    /// Height of the axes over their width, see [`DEFAULT_ASPECT`].
    pub aspect: f64,
}

impl Panel {
    /// An empty panel.
    pub fn new(x: Axis, y: Axis) -> Self {
        Self { title: String::new(), x, y, series: Vec::new(), marks: Vec::new(), aspect: DEFAULT_ASPECT }
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

    /// Appends a mark.
    pub fn mark(mut self, mark: Mark) -> Self {
        self.marks.push(mark);
        self
    }

    /// Sets height over width of the axes.
    pub fn aspect(mut self, aspect: f64) -> Self {
        self.aspect = aspect;
        self
    }
}

/// Name and unit of an axis, printed as "name (unit)".
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Axis {
    /// Quantity with its symbol, for example "deflection z".
    pub label: String,
    /// Unit, for example "mm"; empty for a number without unit.
    pub unit: String,
    /// The axis reaches down (or up) to zero even where the data do not.
    pub include_zero: bool,
    /// Equal ratios take equal lengths; what is not above zero is not drawn.
    pub logarithmic: bool,
    /// Texts at 0, 1, 2, … in place of numbers; for vertical axes.
    pub names: Vec<String>,
}

impl Axis {
    /// An axis that spans its data.
    pub fn new(label: impl Into<String>, unit: impl Into<String>) -> Self {
        Self { label: label.into(), unit: unit.into(), include_zero: false, logarithmic: false, names: Vec::new() }
    }

    /// An axis that always shows zero.
    pub fn with_zero(mut self) -> Self {
        self.include_zero = true;
        self
    }

    /// A vertical axis of named places, the first of them at 0.
    pub fn named(names: Vec<String>) -> Self {
        Self { names, ..Self::new("", "") }
    }

    /// An axis on which equal ratios take equal lengths.
    pub fn logarithmic(mut self) -> Self {
        self.logarithmic = true;
        self
    }
}

/// A named set of points with its role and its way of being drawn.
///
/// `x` and `y` are as long as each other (and as the texts of labelled points, and the `low`, `high` of a band or of error bars; a band's `y` may be empty).
/// A value that is not finite is a gap. `x` need not be sorted: loops are drawn as they are.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Name in the legend; series of equal name and role in one figure share a legend entry.
    pub name: String,
    /// What the series stands for; decides colour, line width and dash.
    pub role: Role,
    /// How it is drawn.
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

    /// A marker on each point.
    pub fn points(name: impl Into<String>, role: Role, x: Vec<f64>, y: Vec<f64>) -> Self {
        Self { name: name.into(), role, kind: Kind::Points, x, y }
    }

    /// A marker on each point and a text beside it.
    pub fn labelled(name: impl Into<String>, role: Role, x: Vec<f64>, y: Vec<f64>, labels: Vec<String>) -> Self {
        Self { name: name.into(), role, kind: Kind::Labelled { labels }, x, y }
    }

    /// The area between two curves.
    pub fn band(name: impl Into<String>, role: Role, x: Vec<f64>, low: Vec<f64>, high: Vec<f64>) -> Self {
        Self { name: name.into(), role, kind: Kind::Band { low, high }, x, y: Vec::new() }
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

/// What a series stands for. The same role looks the same in every figure of a document.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// What the sensor read.
    Measured,
    /// The same behind several models: broad and pale.
    Backdrop,
    /// What the identified model computes.
    Model,
    /// A curve fitted to the points beside it.
    Fit,
    /// The fit that was not chosen.
    Alternative,
    /// Lower confidence limit.
    Lower,
    /// Upper confidence limit.
    Upper,
    /// Computed deflection of the seal.
    Deflection,
    /// Measured minus computed.
    Residual,
    /// The truth a virtual bench was run with, or a published value.
    Reference,
    /// A helper line without a claim of its own.
    Neutral,
    /// One of several equals (recordings, speeds); colours and markers repeat after six.
    Category(u8),
    /// A friction model under comparison: colour and marker by family, dashes by variant (three of them).
    Friction(Family, u8),
}

/// Families of friction models, a colour each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Family {
    /// Extended Maxwell-Slip.
    Ems,
    /// Coulomb, viscous, Stribeck.
    Static,
    /// Dahl.
    Dahl,
    /// LuGre.
    LuGre,
    /// Leuven.
    Leuven,
    /// Maxwell-Slip.
    MaxwellSlip,
    /// Generalized Maxwell-Slip.
    Gms,
    /// Any other.
    Other,
}

/// How a series is drawn.
#[derive(Debug, Clone, PartialEq)]
pub enum Kind {
    /// Straight segments between consecutive points.
    Line,
    /// One marker per point.
    Points,
    /// One marker per point with a text beside it, placed where it covers nothing.
    Labelled {
        /// The texts, as many as there are points.
        labels: Vec<String>,
    },
    /// Filled area between `low` and `high`.
    Band {
        /// Lower edge, unit of the y axis.
        low: Vec<f64>,
        /// Upper edge, unit of the y axis.
        high: Vec<f64>,
    },
    /// Marker with a vertical bar.
    ErrorBars {
        /// Lower end of each bar, unit of the y axis.
        low: Vec<f64>,
        /// Upper end of each bar, unit of the y axis.
        high: Vec<f64>,
    },
}

/// A labelled place on an axis. An empty label draws the line or range alone.
#[derive(Debug, Clone, PartialEq)]
pub enum Mark {
    /// Vertical line.
    X {
        /// Position, unit of the x axis.
        at: f64,
        /// Text at its upper end.
        label: String,
    },
    /// Horizontal line.
    Y {
        /// Position, unit of the y axis.
        at: f64,
        /// Text at its right end.
        label: String,
    },
    /// Shaded interval of x.
    XRange {
        /// Left end, unit of the x axis.
        from: f64,
        /// Right end, unit of the x axis.
        to: f64,
        /// Text above it.
        label: String,
    },
    /// Shaded interval of y.
    YRange {
        /// Lower end, unit of the y axis.
        from: f64,
        /// Upper end, unit of the y axis.
        to: f64,
        /// Text at its right end.
        label: String,
    },
}

impl Mark {
    /// Vertical line at `at`.
    pub fn x(at: f64, label: impl Into<String>) -> Self {
        Self::X { at, label: label.into() }
    }

    /// Horizontal line at `at`.
    pub fn y(at: f64, label: impl Into<String>) -> Self {
        Self::Y { at, label: label.into() }
    }

    /// Shaded interval of x.
    pub fn x_range(from: f64, to: f64, label: impl Into<String>) -> Self {
        Self::XRange { from, to, label: label.into() }
    }

    /// Shaded interval of y.
    pub fn y_range(from: f64, to: f64, label: impl Into<String>) -> Self {
        Self::YRange { from, to, label: label.into() }
    }
}

/// A table with a caption; numeric cells align right.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// Title above the table.
    pub caption: String,
    /// Column headings.
    pub columns: Vec<String>,
    /// Rows, each as long as `columns`.
    pub rows: Vec<Vec<Cell>>,
}

impl Table {
    /// A table without rows yet.
    pub fn new<S: Into<String>>(caption: impl Into<String>, columns: impl IntoIterator<Item = S>) -> Self {
        Self { caption: caption.into(), columns: columns.into_iter().map(Into::into).collect(), rows: Vec::new() }
    }

    /// Appends a row.
    pub fn row(mut self, cells: impl IntoIterator<Item = Cell>) -> Self {
        self.rows.push(cells.into_iter().collect());
        self
    }

    /// The parameter table: name, symbol, value, 95 % interval, unit; what the data do not pin is marked as such.
    pub fn parameters(caption: impl Into<String>, parameters: impl IntoIterator<Item = Parameter>) -> Self {
        let empty = Self::new(caption, ["Parameter", "Symbol", "Value", "95 % interval", "Unit"]);
        parameters.into_iter().fold(empty, |table, parameter| table.row(parameter.into_cells()))
    }
}

/// One cell of a table.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// Text as it is.
    Text(String),
    /// Identifier set in a fixed-width face: file name, hash, key.
    Code(String),
    /// Number printed with the given significant digits; not finite prints as a dash.
    Number {
        /// The number, in the unit its column or row names.
        value: f64,
        /// Significant digits, at least 1.
        digits: usize,
    },
    /// Number with as many decimals as its interval supports (two significant digits of half the interval).
    Estimate {
        /// The value.
        value: f64,
        /// Interval that decides the rounding.
        interval: [f64; 2],
    },
    /// Interval, rounded like [`Cell::Estimate`].
    Interval {
        /// Lower end.
        low: f64,
        /// Upper end.
        high: f64,
    },
    /// Marker: the data do not pin this value.
    Undetermined,
    /// Doubtful: the text, with a warning marker.
    Warning(String),
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

/// An estimated parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Name in words, for example "Coulomb force".
    pub name: String,
    /// Symbol, Unicode, for example "F_c" written as "Fₙ".
    pub symbol: String,
    /// Value in `unit`.
    pub value: f64,
    /// 95 % interval in `unit`; an infinite or undefined end means that the data do not pin the parameter.
    pub interval: [f64; 2],
    /// Unit, for example "N·s/m".
    pub unit: String,
}

impl Parameter {
    fn into_cells(self) -> [Cell; 5] {
        let [low, high] = self.interval;
        let (value, interval) = if low.is_finite() && high.is_finite() {
            (Cell::Estimate { value: self.value, interval: self.interval }, Cell::Interval { low, high })
        } else {
            (Cell::Number { value: self.value, digits: 3 }, Cell::Undetermined)
        };
        [Cell::Text(self.name), Cell::Text(self.symbol), value, interval, Cell::Text(self.unit)]
    }
}

/// A number at the head of the report.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tile {
    /// What it is.
    pub label: String,
    /// The number with its unit, ready to print.
    pub value: String,
    /// A remark in small print, for example the interval or the limit; may be empty.
    pub note: String,
}

impl Tile {
    /// A tile.
    pub fn new(label: impl Into<String>, value: impl Into<String>, note: impl Into<String>) -> Self {
        Self { label: label.into(), value: value.into(), note: note.into() }
    }
}

/// A model that runs in the page: its parameters can be turned, and it can be moved by hand.
///
/// Unlike everything else in a document its numbers are in SI: the page runs the model with them.
#[derive(Debug, Clone, PartialEq)]
pub struct LiveModel {
    /// The model, as [`trocar_model::Trocar::write_numbers`] writes it.
    pub row: Vec<f64>,
    /// All of [`trocar_model::Seal::tunables`], in that order.
    pub knobs: Vec<Knob>,
    /// Where a hand can move it, m.
    pub way: [f64; 2],
    /// A recorded motion to run it along.
    pub stretch: Option<Stretch>,
}

/// A parameter that can be turned.
#[derive(Debug, Clone, PartialEq)]
pub struct Knob {
    /// Name in words.
    pub name: String,
    /// Symbol, Unicode; may be empty.
    pub symbol: String,
    /// Unit for people, for example "mm"; empty for a number without unit.
    pub unit: String,
    /// What a value in SI is multiplied by for people.
    pub scale: f64,
    /// Value of the model, SI.
    pub value: f64,
    /// Ends of the slider, SI; none where the model has no use for the parameter or no finite value of it.
    pub range: Option<[f64; 2]>,
    /// 95 % interval, SI.
    pub interval: Option<[f64; 2]>,
    /// The same parameter of the other direction, by its place, where both directions have one value.
    pub follows: Option<usize>,
    /// Whether it is shown at once, not only on demand.
    pub is_main: bool,
}

/// A recorded motion at even times, with the force that was measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretch {
    /// What it is, in words: "surgeon.csv from 12.5 s on".
    pub name: String,
    /// Time between two samples, s.
    pub interval: f64,
    /// Position of the instrument, m.
    pub position: Vec<f64>,
    /// Readings without the sensor's offset, N; as many.
    pub force: Vec<f64>,
    /// Sample from which the force of the model no longer depends on the unknown start.
    pub known_from: usize,
}

/// A chapter of the report: paragraphs, then tables, then figures, then a model to play with.
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
    /// A model that runs in the page; at most one in a document.
    pub live: Option<LiveModel>,
}

impl Section {
    /// An empty section.
    pub fn new(heading: impl Into<String>) -> Self {
        Self { heading: heading.into(), ..Self::default() }
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

    /// Appends a figure.
    pub fn figure(mut self, figure: Figure) -> Self {
        self.figures.push(figure);
        self
    }
}

/// A whole report. Nothing in it may depend on the clock or on the machine, so that equal results give equal bytes.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Document {
    /// Title of page and window.
    pub title: String,
    /// One line under the title.
    pub subtitle: String,
    /// Key numbers.
    pub tiles: Vec<Tile>,
    /// What the reader must know before believing the numbers.
    pub warnings: Vec<String>,
    /// Chapters.
    pub sections: Vec<Section>,
    /// Origin: label and value, such as the program's version and the hashes of the inputs.
    pub provenance: Vec<(String, String)>,
}
