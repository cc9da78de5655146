//! The data of the interactive charts, as compact JSON inside the page.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

use super::decimate;
use super::document::{Figure, Kind, Mark, Panel, Series};
use super::style;
use super::view::{self, Limits};

/// Points per series on the screen: enough for a four-fold zoom before single samples become
/// visible.
const SHOWN_POINTS: usize = 3_000;

/// Largest code of a value; the next code marks a gap.
const LARGEST_CODE: f64 = 65_534.0;

/// JSON for one figure, safe inside a `script` element: no character in it can end the element.
pub(super) fn figure_json(figure: &Figure) -> Result<String, serde_json::Error> {
    let limits = view::limits(figure);
    let panels = figure.panels.iter().zip(&limits).enumerate();
    let chart = Chart {
        id: &figure.id,
        columns: figure.columns.clamp(1, 2),
        linked: figure.linked_x,
        panels: panels
            .map(|(index, (panel, limits))| chart_panel(figure, index, panel, *limits))
            .collect(),
    };
    serde_json::to_string(&chart).map(|json| inert(&json))
}

/// JSON of the line widths, dashes and markers by style name.
pub(super) fn styles_json() -> Result<String, serde_json::Error> {
    let styles: std::collections::BTreeMap<_, _> = style::all()
        .iter()
        .map(|style| {
            (
                style.class,
                ChartStyle { width: style.width, dash: style.dash, marker: style.marker.name() },
            )
        })
        .collect();
    serde_json::to_string(&styles).map(|json| inert(&json))
}

/// Replaces characters that HTML could interpret as markup; in JSON they occur only inside strings.
pub(super) fn inert(json: &str) -> String {
    let mut text = String::with_capacity(json.len());
    for c in json.chars() {
        match c {
            '<' => text.push_str("\\u003c"),
            '>' => text.push_str("\\u003e"),
            '&' => text.push_str("\\u0026"),
            '\u{2028}' => text.push_str("\\u2028"),
            '\u{2029}' => text.push_str("\\u2029"),
            other => text.push(other),
        }
    }
    text
}

#[derive(Serialize)]
struct Chart<'a> {
    id: &'a str,
    columns: usize,
    linked: bool,
    panels: Vec<ChartPanel<'a>>,
}

#[derive(Serialize)]
struct ChartPanel<'a> {
    title: String,
    x: [&'a str; 2],
    y: [&'a str; 2],
    limits: [f64; 4],
    logarithmic: [bool; 2],
    #[serde(skip_serializing_if = "<[String]>::is_empty")]
    names: &'a [String],
    aspect: f64,
    series: Vec<ChartSeries<'a>>,
    marks: Vec<ChartMark<'a>>,
}

#[derive(Serialize)]
struct ChartSeries<'a> {
    name: &'a str,
    style: &'static str,
    kind: &'static str,
    x: Codes,
    #[serde(skip_serializing_if = "Option::is_none")]
    y: Option<Codes>,
    #[serde(skip_serializing_if = "Option::is_none")]
    low: Option<Codes>,
    #[serde(skip_serializing_if = "Option::is_none")]
    high: Option<Codes>,
    #[serde(skip_serializing_if = "Option::is_none")]
    labels: Option<&'a [String]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    size: Option<[f64; 2]>,
}

#[derive(Serialize)]
struct ChartMark<'a> {
    axis: &'static str,
    from: f64,
    to: f64,
    label: &'a str,
}

#[derive(Serialize)]
struct ChartStyle {
    width: f64,
    dash: &'static [f64],
    marker: &'static str,
}

/// Values as 16-bit codes between `low` and `high`, in base64: a third of the size of decimal
/// numbers, and finer than a pixel at any zoom that the number of points allows.
#[derive(Serialize)]
pub(super) struct Codes {
    low: f64,
    high: f64,
    codes: String,
}

impl Codes {
    pub(super) fn new(values: impl Iterator<Item = f64> + Clone) -> Self {
        let finite = values.clone().filter(|value| value.is_finite());
        let (low, high) = finite
            .fold((f64::MAX, f64::MIN), |(low, high), value| (low.min(value), high.max(value)));
        let (low, high) = if low > high { (0.0, 0.0) } else { (low, high) };
        let step = if high > low { LARGEST_CODE / (high - low) } else { 0.0 };
        let code = |value: f64| {
            if value.is_finite() { ((value - low) * step).round() as u16 } else { u16::MAX }
        };
        let bytes: Vec<u8> = values.flat_map(|value| code(value).to_le_bytes()).collect();
        Self { low, high, codes: STANDARD.encode(bytes) }
    }
}

fn chart_panel<'a>(
    figure: &'a Figure,
    index: usize,
    panel: &'a Panel,
    limits: Limits,
) -> ChartPanel<'a> {
    let letter = if figure.panels.len() > 1 { view::letter(index) } else { String::new() };
    ChartPanel {
        title: format!("{letter} {}", panel.title).trim().to_owned(),
        x: [&panel.x.label, &panel.x.unit],
        y: [&panel.y.label, &panel.y.unit],
        limits: limits.flat(),
        logarithmic: [panel.x.logarithmic, panel.y.logarithmic],
        names: &panel.y.names,
        aspect: panel.aspect,
        series: panel.series.iter().map(|series| chart_series(series, limits)).collect(),
        marks: panel.marks.iter().filter_map(chart_mark).collect(),
    }
}

fn chart_series(series: &Series, limits: Limits) -> ChartSeries<'_> {
    let columns = SHOWN_POINTS / 3;
    let path =
        |y: &[f64]| decimate::path(&series.x, y, limits.x[0], limits.x[1], columns, SHOWN_POINTS);
    let (kind, kept, edges) = match &series.kind {
        Kind::Line => ("line", path(&series.y), None),
        Kind::Points => {
            let kept = decimate::markers(
                &series.x,
                &series.y,
                limits.flat(),
                [2 * columns; 2],
                SHOWN_POINTS,
            );
            ("points", kept, None)
        }
        Kind::Labelled { .. } => ("labels", (0..series.x.len()).collect(), None),
        Kind::Cells { .. } => ("cells", (0..series.x.len()).collect(), None),
        Kind::ErrorBars { low, high } => ("bars", (0..series.x.len()).collect(), Some((low, high))),
        Kind::Band { low, high } => {
            let mut kept = path(low);
            kept.extend(path(high));
            kept.sort_unstable();
            kept.dedup();
            ("band", kept, Some((low, high)))
        }
    };
    let pick = |values: &[f64]| {
        Codes::new(kept.iter().map(|&i| values.get(i).copied().unwrap_or(f64::NAN)))
    };
    ChartSeries {
        name: &series.name,
        style: style::of(series.role).class,
        kind,
        x: pick(&series.x),
        y: (kind != "band").then(|| pick(&series.y)),
        low: edges.map(|(low, _)| pick(low)),
        high: edges.map(|(_, high)| pick(high)),
        labels: match &series.kind {
            Kind::Labelled { labels } | Kind::Cells { labels, .. } => Some(labels),
            _ => None,
        },
        size: if let Kind::Cells { size, .. } = series.kind { Some(size) } else { None },
    }
}

fn chart_mark(mark: &Mark) -> Option<ChartMark<'_>> {
    let (axis, from, to, label) = match mark {
        Mark::X { at, label } => ("x", *at, *at, label),
        Mark::Y { at, label } => ("y", *at, *at, label),
        Mark::XRange { from, to, label } => ("x", *from, *to, label),
        Mark::YRange { from, to, label } => ("y", *from, *to, label),
    };
    (from.is_finite() && to.is_finite()).then_some(ChartMark { axis, from, to, label })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_return_the_values_and_the_gaps() {
        let values = [-3.25, 0.0, f64::NAN, 7.5, f64::INFINITY];
        let codes = Codes::new(values.iter().copied());
        let bytes = STANDARD.decode(&codes.codes).expect("base64");
        for (pair, value) in bytes.chunks(2).zip(values) {
            let code = u16::from_le_bytes([pair[0], pair[1]]);
            if value.is_finite() {
                let read = codes.low + f64::from(code) / LARGEST_CODE * (codes.high - codes.low);
                assert!((read - value).abs() < 1e-4, "{value} came back as {read}");
            } else {
                assert_eq!(code, u16::MAX);
            }
        }
    }

    #[test]
    fn json_cannot_end_its_script_element() {
        let json = inert(r#"{"name":"</script><script>alert(1)//&<!--"}"#);
        assert!(!json.contains(['<', '>', '&']));
        let back: serde_json::Value = serde_json::from_str(&json).expect("still JSON");
        assert_eq!(back["name"], "</script><script>alert(1)//&<!--");
    }
}
