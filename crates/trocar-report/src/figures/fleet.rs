//! Figures and tables of many recordings: distributions, drift, outliers, failures.

use std::collections::BTreeMap;

use super::super::document::{Axis, Cell, Figure, Panel, Role, Series, Table};
use super::super::number::significant;
use super::tables::name_of;
use trocar_lab::fleet::summary::{OUTLYING, Trend, modified_scores, quantile};
use trocar_lab::fleet::{Fleet, FleetCell, Record};
use trocar_model::{Direction, ParameterId, Quantity, Unit};

/// Most points of one type drawn in a panel.
const MOST_POINTS: usize = 400;
/// Most rows of a table of outliers.
const MOST_OUTLIERS: usize = 40;
/// Most types distinguished.
const MOST_TYPES: usize = 12;

/// A quantity of the report.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Shown {
    Parameter(ParameterId),
    /// Root mean square residual, N.
    Residual,
}

/// Quantities with a figure.
pub(crate) const SHOWN: [Shown; 6] = [
    Shown::Parameter(Quantity::CoulombForceWithOffset.of(Direction::Insertion)),
    Shown::Parameter(Quantity::CoulombForceWithOffset.of(Direction::Withdrawal)),
    Shown::Parameter(Quantity::ViscousDamping.id()),
    Shown::Parameter(Quantity::HalfWidth.id()),
    Shown::Parameter(Quantity::Offset.id()),
    Shown::Residual,
];

/// Quantities analysed over use.
const FOLLOWED: [Shown; 4] = [
    Shown::Parameter(Quantity::CoulombForce.id()),
    Shown::Parameter(Quantity::ViscousDamping.id()),
    Shown::Parameter(Quantity::HalfWidth.id()),
    Shown::Residual,
];

impl Shown {
    /// Its column in the table.
    fn column(self) -> String {
        match self {
            Self::Parameter(id) => id.to_string(),
            Self::Residual => "residual_rms_n".to_owned(),
        }
    }

    /// In words, capitalised.
    pub(crate) fn name(self) -> String {
        match self {
            Self::Parameter(id) => name_of(id),
            Self::Residual => "Residual (rms)".to_owned(),
        }
    }

    /// In words; axes set no subscripts.
    fn words(self) -> String {
        match self {
            Self::Parameter(id) => id.words().to_string(),
            Self::Residual => "residual (rms)".to_owned(),
        }
    }

    pub(crate) fn unit(self) -> Unit {
        match self {
            Self::Parameter(id) => id.unit(),
            Self::Residual => Unit::NEWTON,
        }
    }

    /// The value in the displayed unit, if the recording determines it.
    fn value(self, record: &Record) -> Option<f64> {
        let known = record.cell(&format!("{}_determined", self.column()));
        let is_determined = known.is_none_or(|cell| *cell == FleetCell::Boolean(true));
        record
            .number(&self.column())
            .filter(|_| is_determined)
            .map(|value| self.unit().scale * value)
    }

    fn axis(self) -> Axis {
        Axis::new(self.words(), self.unit().shown)
    }
}

/// A fleet divided by type.
pub(crate) struct ByType<'a> {
    pub(crate) fleet: &'a Fleet,
    pub(crate) names: Vec<String>,
    /// Type of each record; `None` for one that failed.
    kinds: Vec<Option<usize>>,
}

impl<'a> ByType<'a> {
    /// By the metadata column `by`; one type without it.
    pub(crate) fn new(fleet: &'a Fleet, by: Option<&str>) -> Self {
        let own = fleet.records.iter().map(|record| {
            let cell = by.map(|by| record.metadata.get(by));
            let name = cell.map(|cell| cell.map_or_else(String::new, FleetCell::in_words));
            (record.text("status") != Some("failed"))
                .then(|| name.unwrap_or_else(|| "all".to_owned()))
        });
        let own: Vec<Option<String>> = own.collect();
        let mut names: Vec<String> = own.iter().flatten().cloned().collect();
        names.sort_unstable();
        names.dedup();
        if names.len() > MOST_TYPES {
            names.truncate(MOST_TYPES - 1);
            names.push("others".to_owned());
        }
        let last = names.len().saturating_sub(1);
        let kinds = own.iter().map(|own| {
            let own = own.as_ref()?;
            Some(names.iter().position(|name| name == own).unwrap_or(last))
        });
        let kinds = kinds.collect();
        for name in names.iter_mut().filter(|name| name.is_empty()) {
            "(none)".clone_into(name);
        }
        Self { fleet, names, kinds }
    }

    /// Values of one type with their records.
    fn values(&self, kind: usize, shown: Shown) -> Vec<(f64, &'a Record)> {
        let own = self.fleet.records.iter().zip(&self.kinds).filter(|(_, own)| **own == Some(kind));
        own.filter_map(|(record, _)| Some((shown.value(record)?, record))).collect()
    }
}

/// Every value, median and quartiles, by type.
pub(crate) fn distributions(types: &ByType) -> Figure {
    let figure = SHOWN
        .iter()
        .map(|shown| distribution(types, shown))
        .fold(Figure::new("distributions", 0, "Parameters by type"), Figure::panel);
    figure.columns(2).caption(
        "Each point is a recording whose data determine the parameter; below them the quartiles as a line and the median as a point. The \
         forces of insertion and withdrawal are the lines of steady sliding at rest, with the sensor's offset in them; their mean is F_c.",
    )
}

fn distribution(types: &ByType, shown: &Shown) -> Panel {
    let mut panel = Panel::new(shown.axis(), Axis::named(types.names.clone()));
    panel.aspect = 0.18 + 0.11 * types.names.len() as f64;
    for kind in 0..types.names.len() {
        let mut values: Vec<f64> =
            types.values(kind, *shown).into_iter().map(|(value, _)| value).collect();
        if values.is_empty() {
            continue;
        }
        let step = values.len().div_ceil(MOST_POINTS);
        let drawn: Vec<f64> = values.iter().copied().step_by(step).collect();
        // Golden-ratio steps separate points that would coincide.
        let rows = (0..drawn.len())
            .map(|k| kind as f64 + 0.34 * (((k as f64 * 0.618_034).fract()) - 0.5) + 0.12)
            .collect();
        values.sort_by(f64::total_cmp);
        let [low, middle, high] = [0.25, 0.5, 0.75].map(|part| quantile(&values, part));
        let at = kind as f64 - 0.27;
        panel = panel
            .series(Series::points("recording", Role::Measured, drawn, rows))
            .series(Series::line("quartiles and median", Role::Model, vec![low, high], vec![at; 2]))
            .series(Series::points("quartiles and median", Role::Model, vec![middle], vec![at]));
    }
    panel
}

/// Numbers of the specimens: one per text in the column `specimen`, or one for all.
fn specimens(records: &[&Record], specimen: Option<&str>) -> Vec<usize> {
    let mut seen: BTreeMap<String, usize> = BTreeMap::new();
    let numbers = records.iter().enumerate().map(|(k, record)| {
        let next = seen.len();
        // A record without a specimen counts as a specimen of its own.
        let name = specimen.map(|by| known(record, by).unwrap_or_else(|| format!("\0{k}")));
        *seen.entry(name.unwrap_or_default()).or_insert(next)
    });
    numbers.collect()
}

/// Parameters against use, and the table of slopes.
pub(crate) fn drift(types: &ByType, by: &str, specimen: Option<&str>) -> Option<(Figure, Table)> {
    let mut table = Table::new(
        format!("Change per unit of {by}"),
        ["Parameter", "Type", "Change", "95 % interval", "Unit", "Recordings"],
    );
    let mut figure =
        Figure::new("drift", 0, format!("Drift with {}", by.replace('_', " "))).columns(2);
    let mut any = false;
    for shown in FOLLOWED {
        let mut panel = Panel::new(Axis::new(by.replace('_', " "), ""), shown.axis()).aspect(0.62);
        for (kind, name) in types.names.iter().enumerate() {
            let own = types.values(kind, shown).into_iter();
            let own: Vec<(f64, f64, &Record)> = own
                .filter_map(|(y, record)| Some((record.metadata.get(by)?.as_number()?, y, record)))
                .collect();
            let records: Vec<&Record> = own.iter().map(|(_, _, record)| *record).collect();
            let numbers = specimens(&records, specimen);
            let points: Vec<(f64, f64, usize)> =
                own.iter().zip(numbers).map(|((x, y, _), specimen)| (*x, *y, specimen)).collect();
            let role = Role::Category((kind % 6) as u8);
            let drawn = points.iter().step_by(points.len().div_ceil(MOST_POINTS).max(1));
            let (x, y) = drawn.map(|p| (p.0, p.1)).unzip();
            panel = panel.series(Series::points(name.clone(), role, x, y));
            let Some(trend) = Trend::of(&points) else { continue };
            any = true;
            panel = with_line(panel, name, role, &trend, &points);
            let interval = [trend.slope - trend.half_width, trend.slope + trend.half_width];
            table = table.row([
                shown.words().into(),
                name.as_str().into(),
                Cell::Estimate { value: trend.slope, interval },
                Cell::Interval { low: interval[0], high: interval[1] },
                shown.unit().shown.into(),
                Cell::Text(trend.count.to_string()),
            ]);
        }
        figure = figure.panel(panel);
    }
    let within = if specimen.is_some() {
        ", the change within a specimen, each with a level of its own"
    } else {
        ""
    };
    let caption = format!(
        "Each point is a recording; straight lines by least squares by type{within}, with the 95 % interval of the line as a band. Recordings \
         count alike, whatever their own interval."
    );
    any.then(|| (figure.caption(caption), table))
}

fn with_line(
    panel: Panel,
    name: &str,
    role: Role,
    trend: &Trend,
    points: &[(f64, f64, usize)],
) -> Panel {
    const STEPS: usize = 24;
    let (low, high) =
        points.iter().fold((f64::MAX, f64::MIN), |(low, high), p| (low.min(p.0), high.max(p.0)));
    let x: Vec<f64> = (0..=STEPS).map(|k| low + (high - low) * k as f64 / STEPS as f64).collect();
    let at: Vec<[f64; 2]> = x.iter().map(|x| trend.at(*x)).collect();
    let [under, line, over] =
        [-1.0, 0.0, 1.0].map(|side| at.iter().map(|[y, half]| y + side * half).collect::<Vec<_>>());
    let band = Series::band(name, role, x.clone(), under, over);
    panel.series(band).series(Series::line(name, role, x, line))
}

/// Recordings far from the others of their type.
pub(crate) fn outliers(types: &ByType) -> (usize, Table) {
    let mut found = Vec::new();
    for shown in SHOWN {
        for (kind, name) in types.names.iter().enumerate() {
            let values = types.values(kind, shown);
            let numbers: Vec<f64> = values.iter().map(|(value, _)| *value).collect();
            let scores = modified_scores(&numbers).unwrap_or_default();
            for ((value, record), score) in
                values.iter().zip(scores).filter(|(_, score)| score.abs() > OUTLYING)
            {
                found.push((score, *value, shown, name.as_str(), *record));
            }
        }
    }
    found.sort_by(|a, b| b.0.abs().total_cmp(&a.0.abs()));
    let table = Table::new(
        "Farthest from the median of their type",
        ["Recording", "Type", "Parameter", "Value", "Unit", "Score"],
    );
    (found.len(), found.iter().take(MOST_OUTLIERS).fold(table, with_outlier))
}

/// Score, value, parameter, type and recording.
type Outlier<'a> = (f64, f64, Shown, &'a str, &'a Record);

fn with_outlier(table: Table, (score, value, shown, name, record): &Outlier) -> Table {
    table.row([
        Cell::Code(record.text("path").unwrap_or_default().to_owned()),
        (*name).into(),
        shown.words().into(),
        Cell::number(*value, 3),
        shown.unit().shown.into(),
        Cell::number(*score, 3),
    ])
}

/// Failures by reason, most frequent first.
pub(crate) fn failures(fleet: &Fleet) -> Option<Table> {
    let mut reasons: BTreeMap<&str, Vec<&Record>> = BTreeMap::new();
    for record in fleet.records.iter().filter(|record| record.text("status") == Some("failed")) {
        reasons.entry(record.text("reason_kind").unwrap_or_default()).or_default().push(record);
    }
    let mut reasons: Vec<(&str, Vec<&Record>)> = reasons.into_iter().collect();
    reasons.sort_by_key(|(_, records)| std::cmp::Reverse(records.len()));
    let table = Table::new("Failed recordings", ["Reason", "Recordings", "First", "Message"]);
    (!reasons.is_empty()).then(|| {
        reasons.iter().fold(table, |table, (kind, records)| {
            let text = |name| records[0].text(name).unwrap_or_default().to_owned();
            let said = text("reason");
            let said = said.split("\n\nhint: ").next().unwrap_or_default().to_owned();
            table.row([
                kind.replace('_', " ").into(),
                records.len().to_string().into(),
                Cell::Code(text("path")),
                said.into(),
            ])
        })
    })
}

/// The name of a record's specimen, if it has one.
fn known(record: &Record, specimen: &str) -> Option<String> {
    record.metadata.get(specimen).filter(|cell| **cell != FleetCell::Empty).map(FleetCell::in_words)
}

/// Median with the quartiles, in words.
pub(crate) fn median_in_words(fleet: &Fleet, shown: Shown) -> Option<[String; 3]> {
    let ok = fleet.records.iter().filter(|record| record.text("status") != Some("failed"));
    let (column, scale) = (shown.column(), shown.unit().scale);
    let mut values: Vec<f64> =
        ok.filter_map(|record| record.number(&column)).map(|value| scale * value).collect();
    values.sort_by(f64::total_cmp);
    (!values.is_empty())
        .then(|| [0.5, 0.25, 0.75].map(|part| significant(quantile(&values, part), 3)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use trocar_lab::fleet::KEPT;

    #[test]
    fn what_is_shown_is_kept_in_memory() {
        for shown in SHOWN.iter().chain(&FOLLOWED) {
            assert!(KEPT.contains(&shown.column()), "{}", shown.column());
        }
    }
}
