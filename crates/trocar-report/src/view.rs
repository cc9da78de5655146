//! Common parts of the printed and the interactive panel: limits of the axes and the legend.

use trocar_tables::option::{Interface, spelt};

use super::document::{Axis, Dimension, Figure, Kind, Panel, Role, Series};

/// Limits of a panel's axes, finite and of positive width, with a margin around the data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Limits {
    /// Lower and upper end of x.
    pub(super) x: [f64; 2],
    /// Lower and upper end of y.
    pub(super) y: [f64; 2],
}

impl Limits {
    /// In the order x low, x high, y low, y high.
    pub(super) const fn flat(self) -> [f64; 4] {
        [self.x[0], self.x[1], self.y[0], self.y[1]]
    }
}

/// The limits of every panel of `figure`; with linked x axes, all have the same x.
pub(super) fn limits(figure: &Figure) -> Vec<Limits> {
    let mut x: Vec<Span> = figure.panels.iter().map(|panel| span(panel, Dimension::X)).collect();
    if figure.linked_x {
        let all = x.iter().fold(Span::EMPTY, |all, span| all.with(span.low).with(span.high));
        x.fill(all);
    }
    let y = figure.panels.iter().map(|panel| span(panel, Dimension::Y));
    let spans = x.iter().zip(y).zip(&figure.panels);
    spans
        .map(|((x, y), p)| {
            // A map fills its axes.
            let margin = if p.series.iter().any(is_map) { 0.0 } else { 1.0 };
            Limits { x: x.padded_for(&p.x, 0.02 * margin), y: y.padded_for(&p.y, 0.05 * margin) }
        })
        .collect()
}

fn is_map(series: &Series) -> bool {
    matches!(series.kind, Kind::Cells { .. })
}

/// All that a panel shows along one of its axes.
fn span(panel: &Panel, along: Dimension) -> Span {
    let axis = match along {
        Dimension::X => &panel.x,
        Dimension::Y => &panel.y,
    };
    if !axis.names.is_empty() {
        return Span { low: -0.5, high: axis.names.len() as f64 - 0.5 };
    }
    let data = panel.series.iter().flat_map(|series| extent(series, along));
    let marks = panel.marks.iter().filter(|mark| mark.axis == along);
    let zero = if axis.include_zero { 0.0 } else { f64::NAN };
    data.chain(marks.flat_map(|mark| [mark.from, mark.to]))
        .chain([zero])
        .filter(|value| !axis.logarithmic || *value > 0.0)
        .fold(Span::EMPTY, Span::with)
}

/// The points of a series along an axis, with what is drawn around them.
fn extent(series: &Series, along: Dimension) -> impl Iterator<Item = f64> {
    let values = match along {
        Dimension::X => &series.x,
        Dimension::Y => &series.y,
    };
    let half = match series.kind {
        Kind::Cells { size, .. } => 0.5 * size[along as usize],
        _ => 0.0,
    };
    let edges: [&[f64]; 2] = match &series.kind {
        Kind::Band { low, high } | Kind::ErrorBars { low, high } if along == Dimension::Y => {
            [low, high]
        }
        _ => [&[], &[]],
    };
    let around = values.iter().flat_map(move |value| [value - half, value + half]);
    around.chain(edges.into_iter().flatten().copied())
}

#[derive(Clone, Copy)]
struct Span {
    low: f64,
    high: f64,
}

impl Span {
    const EMPTY: Self = Self { low: f64::INFINITY, high: f64::NEG_INFINITY };

    fn with(self, value: f64) -> Self {
        if !value.is_finite() {
            return self;
        }
        Self { low: self.low.min(value), high: self.high.max(value) }
    }

    /// The span with `share` of its width added at both ends; a default span if there are no data
    /// or no width.
    fn padded(self, share: f64) -> [f64; 2] {
        if self.low > self.high {
            return [0.0, 1.0];
        }
        let width = self.high - self.low;
        if width <= 1e-12 * self.low.abs().max(self.high.abs()) || width == 0.0 {
            let half = if self.low == 0.0 { 0.5 } else { 0.1 * self.low.abs() };
            return [self.low - half, self.high + half];
        }
        [self.low - share * width, self.high + share * width]
    }

    fn padded_for(self, axis: &Axis, share: f64) -> [f64; 2] {
        if axis.logarithmic { self.padded_by_ratio(share) } else { self.padded(share) }
    }

    /// The same on a logarithmic axis; both ends are above zero.
    fn padded_by_ratio(self, share: f64) -> [f64; 2] {
        if self.low > self.high {
            return [0.1, 1.0];
        }
        let logarithm = Self { low: self.low.log10(), high: self.high.log10() };
        logarithm.padded(share).map(|exponent| 10f64.powf(exponent))
    }
}

/// One entry of a legend: all series of one name and role.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Entry<'a> {
    pub(super) name: &'a str,
    pub(super) role: Role,
    pub(super) line: bool,
    pub(super) marker: bool,
    pub(super) band: bool,
    pub(super) cell: bool,
}

impl<'a> Entry<'a> {
    const fn new(name: &'a str, role: Role) -> Self {
        Self { name, role, line: false, marker: false, band: false, cell: false }
    }
}

/// The legend of a panel, in order of appearance; series without a name have no entry.
pub(super) fn legend(panel: &Panel) -> Vec<Entry<'_>> {
    let mut entries: Vec<Entry<'_>> = Vec::new();
    for series in panel.series.iter().filter(|series| !series.name.is_empty()) {
        let at = entries
            .iter()
            .position(|entry| entry.name == series.name && entry.role == series.role)
            .unwrap_or_else(|| {
                entries.push(Entry::new(&series.name, series.role));
                entries.len() - 1
            });
        match series.kind {
            Kind::Line => entries[at].line = true,
            Kind::Points | Kind::Labelled { .. } | Kind::ErrorBars { .. } => {
                entries[at].marker = true
            }
            Kind::Band { .. } => entries[at].band = true,
            Kind::Cells { .. } => entries[at].cell = true,
        }
    }
    entries
}

/// The letter of panel `index`: (a), (b), ...
pub(super) fn letter(index: usize) -> String {
    let letter = char::from(b'a' + (index % 26) as u8);
    format!("({letter})")
}

/// "deflection z (mm)", or the label alone for a number without unit.
pub(super) fn axis_label(label: &str, unit: &str) -> String {
    if unit.is_empty() { label.to_owned() } else { format!("{label} ({unit})") }
}

/// `text` without characters that XML forbids (such as control characters in a file name).
pub(super) fn printable(text: &str) -> String {
    let text = spelt(text, Interface::CommandLine);
    let text = text.chars().map(|c| match c {
        '\u{fffe}' | '\u{ffff}' => '\u{fffd}',
        c if c.is_control() => '\u{fffd}',
        c => c,
    });
    text.collect()
}
