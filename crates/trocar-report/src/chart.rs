//! The data of the interactive charts, as compact JSON inside the page.

use std::collections::BTreeMap;

use serde::Serialize;

use super::codes::Codes;
use super::decimate;
use super::document::{Figure, Kind, Mark, Panel, Series};
use super::style::{self, Style};
use super::view::{self, Limits};

/// Points per series on the screen: enough for a four-fold zoom before single samples become
/// visible.
const SHOWN_POINTS: usize = 3_000;

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
    let styles = style::all().iter().map(|&Style { class, width, dash, marker, .. }| {
        (class, ChartStyle { width, dash, marker: marker.name() })
    });
    serde_json::to_string(&styles.collect::<BTreeMap<_, _>>()).map(|json| inert(&json))
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
    marks: Vec<&'a Mark>,
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
struct ChartStyle {
    width: f64,
    dash: &'static [f64],
    marker: &'static str,
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
        marks: panel.marks.iter().filter(|mark| mark.is_finite()).collect(),
    }
}

fn chart_series(series: &Series, limits: Limits) -> ChartSeries<'_> {
    let columns = SHOWN_POINTS / 3;
    let [low, high] = limits.x;
    let all = || (0..series.x.len()).collect();
    let (kind, kept, edges) = match &series.kind {
        Kind::Line => {
            let kept = decimate::path(&series.x, &series.y, low, high, columns, SHOWN_POINTS);
            ("line", kept, None)
        }
        Kind::Points => {
            let (limits, cells) = (limits.flat(), [2 * columns; 2]);
            let kept = decimate::markers(&series.x, &series.y, limits, cells, SHOWN_POINTS);
            ("points", kept, None)
        }
        Kind::Labelled { .. } => ("labels", all(), None),
        Kind::Cells { .. } => ("cells", all(), None),
        Kind::ErrorBars { low, high } => ("bars", all(), Some((low, high))),
        Kind::Band { low, high } => {
            let kept = decimate::band(&series.x, [low, high], limits.x, columns, SHOWN_POINTS);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_cannot_end_its_script_element() {
        let json = inert(r#"{"name":"</script><script>alert(1)//&<!--"}"#);
        assert!(!json.contains(['<', '>', '&']));
        let back: serde_json::Value = serde_json::from_str(&json).expect("still JSON");
        assert_eq!(back["name"], "</script><script>alert(1)//&<!--");
    }
}
