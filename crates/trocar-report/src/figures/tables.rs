//! Tables of parameters and of data quality.

use trocar_model::{Element, ParameterId, Quantity, Unit};

use super::MM;
use crate::document::{Cell, Table, origin};
use trocar_identify::{Estimate, Identification, Parameter, Subject};
use trocar_recording::{Quality, Recording};

/// The unit of an estimate, as displayed.
pub(super) fn unit_of(estimate: &Estimate) -> Unit {
    const OTHERS: [Unit; 8] = [
        Unit::NEWTON,
        Unit::METRE,
        Unit::METRE_PER_SECOND,
        Unit::NEWTON_SECOND_PER_METRE,
        Unit::NEWTON_PER_METRE,
        Unit::SECOND,
        Unit::KILOGRAM,
        Unit::ONE,
    ];
    OTHERS.into_iter().find(|unit| unit.si == estimate.unit).unwrap_or(Unit::ONE)
}

/// A parameter in words, capitalised.
pub(crate) fn name_of(id: ParameterId) -> String {
    capitalised(&id.words().to_string())
}

pub(super) fn capitalised(words: &str) -> String {
    let mut letters = words.chars();
    letters.next().into_iter().flat_map(char::to_uppercase).chain(letters).collect()
}

/// The subject of a warning in words; the name of a recording unchanged.
pub(crate) fn subject_in_words(subject: &Subject) -> String {
    match subject {
        Subject::Parameter(id) => name_of(*id),
        Subject::Recording(name) => name.clone(),
        Subject::Topic(topic) => capitalised(topic),
    }
}

/// The main parameters: refined beside two-step, and beside the truth if that is known.
pub(crate) fn parameters(found: &Identification, truth: Option<&[Element]>) -> Table {
    let refined = found.fit.is_some() && !found.steady.means.is_empty();
    let mut columns = vec!["Parameter", "Symbol", "Unit", "Value", "95 % interval"];
    if refined {
        columns.extend(["Two-step value", "Two-step 95 % interval"]);
    }
    if truth.is_some() {
        columns.push("Truth");
    }
    let optional = refined.then_some((5..7, "values of the paper's two steps, too"));
    let empty = Table { optional, ..Table::new("Parameters with 95 % intervals", columns) };
    found.parameters.iter().filter(|p| !p.is_coefficient()).fold(empty, |table, p| {
        let Unit { scale, shown, .. } = p.id.unit();
        let mut cells = vec![name_of(p.id).into(), p.id.symbol().to_string().into(), shown.into()];
        cells.extend(cells_of(&p.estimate, scale));
        if refined {
            let earlier = found.two_step_parameters.iter().find(|q| q.id == p.id);
            cells.extend(
                earlier.map_or(["–", "–"].map(Cell::from), |q| cells_of(&q.estimate, scale)),
            );
        }
        if let Some(elements) = truth {
            let value = true_value(p.id, elements).map_or(f64::NAN, |value| scale * value);
            cells.push(Cell::number(value, 4));
        }
        table.row(cells)
    })
}

/// The coefficients of the branches, EMS (25), times the power of c: forces at z = c.
pub(crate) fn branch_coefficients(found: &Identification) -> Option<Table> {
    let all: Vec<&Parameter> = found.parameters.iter().filter(|p| p.is_coefficient()).collect();
    all.first()?;
    let c = found.model.half_width;
    let caption = "Coefficients θ of the branches, equation (25) of the paper, as forces θ c^k at z = c (θ itself in SI units: summary.json)";
    let coefficients = all.into_iter().filter_map(|p| match p.id.quantity {
        Quantity::Coefficient { power, .. } => {
            Some((p.id, power, cells_of(&p.estimate, c.powi(power.into()))))
        }
        _ => None,
    });
    let table = Table::of(
        caption,
        coefficients,
        &[
            ("Branch", &|(id, ..)| id.direction.map_or("", |direction| direction.name()).into()),
            ("Symbol", &|(id, ..)| id.symbol().to_string().into()),
            ("k", &|(_, power, _)| power.to_string().into()),
            ("θ c^k (N)", &|(_, _, [value, _])| value.clone()),
            ("95 % interval (N)", &|(_, _, [_, interval])| interval.clone()),
        ],
    );
    Some(table.collapsed())
}

pub(super) fn cells_of(estimate: &Estimate, scale: f64) -> [Cell; 2] {
    let [low, high] = estimate.ci95.map(|end| scale * end);
    let value = scale * estimate.value;
    if estimate.determined && low.is_finite() && high.is_finite() {
        [Cell::Estimate { value, interval: [low, high] }, Cell::Interval { low, high }]
    } else {
        [Cell::number(value, 3), Cell::Undetermined]
    }
}

/// The value used by the bench, SI; `None` if parallel elements or the rig have no such number.
fn true_value(id: ParameterId, elements: &[Element]) -> Option<f64> {
    let ParameterId { element, direction, quantity } = id;
    let of = |element: &Element| element.params().value(direction, quantity);
    match (quantity, element, elements) {
        (_, Some(number), _) => elements.get(usize::from(number) - 1).and_then(of),
        (Quantity::CoulombForce | Quantity::StaticForce | Quantity::ViscousDamping, None, _) => {
            elements.iter().map(of).sum()
        }
        (_, None, [only]) => of(only),
        _ => None,
    }
}

/// Properties of the recordings, one row each.
pub(crate) fn sampling<'a>(
    recordings: impl Iterator<Item = (&'a Recording, &'static str)>,
) -> Table {
    Table::of(
        "What was recorded",
        recordings,
        &[
            ("Recording", &|(r, _)| r.name.as_str().into()),
            ("Used for", &|(_, used_for)| (*used_for).into()),
            ("Samples", &|(r, _)| Cell::count(r.len())),
            ("Duration (s)", &|(r, _)| Cell::number(r.duration(), 3)),
            ("Rate (Hz)", &|(r, _)| Cell::number(1.0 / r.quality.median_interval, 3)),
            ("Jitter (ms)", &|(r, _)| Cell::number((1e6 * r.quality.jitter).round() / 1e3, 2)),
            ("Stroke (mm)", &|(r, _)| Cell::number(MM * r.quality.stroke, 4)),
            ("Lost or doubtful", &|(r, _)| losses(&r.quality)),
        ],
    )
}

/// Resolution of the sensors, one row per recording.
pub(crate) fn resolution<'a>(
    recordings: impl Iterator<Item = (&'a Recording, &'static str)>,
) -> Table {
    let caption = "Resolution and noise (1 sd) of the sensors, seen in the data";
    Table::of(
        caption,
        recordings,
        &[
            ("Recording", &|(r, _)| r.name.as_str().into()),
            ("Position step (µm)", &|(r, _)| step(1e6 * r.quality.position_resolution)),
            ("Position noise (µm)", &|(r, _)| Cell::number(1e6 * r.quality.position_noise, 2)),
            ("Force step (mN)", &|(r, _)| step(1e3 * r.quality.force_resolution)),
            ("Force noise (mN)", &|(r, _)| Cell::number(1e3 * r.quality.force_noise, 2)),
        ],
    )
}

/// The resolution of a signal; zero means that the readings do not show it.
fn step(value: f64) -> Cell {
    if value > 0.0 { Cell::number(value, 2) } else { Cell::from("not determined") }
}

fn losses(quality: &Quality) -> Cell {
    let counted = [
        (quality.gaps.len(), "gaps"),
        (quality.resets.len(), "position jumps"),
        (quality.repeated_rows.count, "repeated rows"),
        (quality.unordered_rows.count, "rows out of order"),
        (quality.non_finite_rows.count, "rows without a number"),
        (quality.held_rows.count, "held positions"),
        (quality.saturated.iter().map(|s| s.count).sum(), "saturated readings"),
    ];
    let found: Vec<String> = counted
        .iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| format!("{count} {what}"))
        .collect();
    match (found.is_empty(), quality.warnings.is_empty()) {
        (true, true) => Cell::from("nothing"),
        (true, false) => Cell::Warning(format!("{} warnings", quality.warnings.len())),
        (false, true) => Cell::Text(found.join(", ")),
        (false, false) => Cell::Warning(found.join(", ")),
    }
}

/// The paper, as an origin.
pub(crate) const PAPER: &str = "J. Verspecht et al., Modeling of the interaction force between the instrument and the trocar in minimally invasive surgery";

/// Recordings with their use and hash, as origins.
pub(crate) fn hashes<'a>(
    recordings: impl Iterator<Item = (&'a Recording, &'static str)>,
) -> impl Iterator<Item = (String, String)> {
    recordings.map(|(recording, used_for)| {
        let label = format!("{} ({used_for})", recording.name);
        origin(label, format!("SHA-256 {}", recording.sha256))
    })
}

/// The names of recordings, in a row.
pub(crate) fn names(recordings: &[Recording]) -> String {
    recordings.iter().map(|r| r.name.as_str()).collect::<Vec<_>>().join(", ")
}
