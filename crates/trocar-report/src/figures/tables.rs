//! Tables of parameters and of data quality.

use trocar_model::{Element, ParameterId, Quantity, Unit};

use super::MM;
use crate::document::{Cell, Table};
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
pub(in super::super) fn name_of(id: ParameterId) -> String {
    capitalised(&id.words().to_string())
}

fn capitalised(words: &str) -> String {
    let mut letters = words.chars();
    letters.next().into_iter().flat_map(char::to_uppercase).chain(letters).collect()
}

/// The subject of a warning in words; the name of a recording unchanged.
pub(in super::super) fn subject_in_words(subject: &Subject) -> String {
    match subject {
        Subject::Parameter(id) => name_of(*id),
        Subject::Recording(name) => name.clone(),
        Subject::Topic(topic) => capitalised(topic),
    }
}

/// The main parameters: refined beside two-step, and beside the truth if that is known.
pub(in super::super) fn parameters(found: &Identification, truth: Option<&[Element]>) -> Table {
    let main = |p: &&Parameter| !p.is_coefficient();
    table("Parameters with 95 % intervals", found, found.parameters.iter().filter(main), truth)
}

/// The coefficients of the branches, EMS (25), times the power of c: forces at z = c.
pub(in super::super) fn branch_coefficients(found: &Identification) -> Option<Table> {
    let all: Vec<&Parameter> = found.parameters.iter().filter(|p| p.is_coefficient()).collect();
    all.first()?;
    let c = found.model.half_width;
    let caption = "Coefficients θ of the branches, EMS (25), as forces θ c^k at z = c (θ itself in SI units: summary.json)";
    let table = Table::new(caption, ["Branch", "Symbol", "k", "θ c^k (N)", "95 % interval (N)"]);
    let row = |table: Table, p: &Parameter| {
        let Quantity::Coefficient { power, .. } = p.id.quantity else { return table };
        let [value, interval] = cells_of(&p.estimate, c.powi(power.into()));
        let branch = p.id.direction.map_or("", |direction| direction.name());
        table.row([
            branch.into(),
            Cell::Text(p.id.symbol().to_string()),
            power.to_string().as_str().into(),
            value,
            interval,
        ])
    };
    Some(Table { collapsed: true, ..all.into_iter().fold(table, row) })
}

fn table<'a>(
    caption: &str,
    found: &'a Identification,
    parameters: impl Iterator<Item = &'a Parameter>,
    truth: Option<&[Element]>,
) -> Table {
    let two_steps_made = !found.steady.means.is_empty();
    let refined = found.fit.is_some() && two_steps_made;
    let mut columns = vec!["Parameter", "Symbol", "Unit", "Value", "95 % interval"];
    let optional =
        refined.then(|| (columns.len()..columns.len() + 2, "values of the paper's two steps, too"));
    if refined {
        columns.extend(["Two-step value", "Two-step 95 % interval"]);
    }
    if truth.is_some() {
        columns.push("Truth");
    }
    let empty = Table { optional, ..Table::new(caption, columns) };
    parameters.fold(empty, |table, p| {
        let Unit { scale, shown, .. } = p.id.unit();
        let mut cells = vec![
            Cell::Text(name_of(p.id)),
            Cell::Text(p.id.symbol().to_string()),
            Cell::from(shown),
        ];
        cells.extend(cells_of(&p.estimate, scale));
        if refined {
            let earlier = found.two_step_parameters.iter().find(|q| q.id == p.id);
            cells.extend(
                earlier
                    .map_or_else(|| ["–", "–"].map(Cell::from), |q| cells_of(&q.estimate, scale)),
            );
        }
        if let Some(elements) = truth {
            let value = true_value(p.id, elements).map_or(f64::NAN, |value| scale * value);
            cells.push(Cell::Number { value, digits: 4 });
        }
        table.row(cells)
    })
}

pub(super) fn cells_of(estimate: &Estimate, scale: f64) -> [Cell; 2] {
    let [low, high] = estimate.ci95.map(|end| scale * end);
    let value = scale * estimate.value;
    if estimate.determined && low.is_finite() && high.is_finite() {
        [Cell::Estimate { value, interval: [low, high] }, Cell::Interval { low, high }]
    } else {
        [Cell::Number { value, digits: 3 }, Cell::Undetermined]
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
pub(in super::super) fn sampling<'a>(
    recordings: impl Iterator<Item = (&'a Recording, &'static str)>,
) -> Table {
    let columns = [
        "Recording",
        "Used for",
        "Samples",
        "Duration (s)",
        "Rate (Hz)",
        "Jitter (ms)",
        "Stroke (mm)",
        "Lost or doubtful",
    ];
    recordings.fold(Table::new("What was recorded", columns), |table, (recording, used_for)| {
        let q = &recording.quality;
        table.row([
            Cell::Text(recording.name.clone()),
            Cell::from(used_for),
            Cell::Text(recording.len().to_string()),
            Cell::Number { value: recording.duration(), digits: 3 },
            Cell::Number { value: 1.0 / q.median_interval, digits: 3 },
            Cell::Number { value: (1e6 * q.jitter).round() / 1e3, digits: 2 },
            Cell::Number { value: MM * q.stroke, digits: 4 },
            losses(q),
        ])
    })
}

/// Resolution of the sensors, one row per recording.
pub(in super::super) fn resolution<'a>(
    recordings: impl Iterator<Item = (&'a Recording, &'static str)>,
) -> Table {
    let columns = [
        "Recording",
        "Position step (µm)",
        "Position noise (µm)",
        "Force step (mN)",
        "Force noise (mN)",
    ];
    let empty = Table::new("Resolution and noise (1 sd) of the sensors, seen in the data", columns);
    recordings.fold(empty, |table, (recording, _)| {
        let q = &recording.quality;
        table.row([
            Cell::Text(recording.name.clone()),
            step(1e6 * q.position_resolution),
            Cell::Number { value: 1e6 * q.position_noise, digits: 2 },
            step(1e3 * q.force_resolution),
            Cell::Number { value: 1e3 * q.force_noise, digits: 2 },
        ])
    })
}

/// The resolution of a signal; zero means that none was found.
fn step(value: f64) -> Cell {
    if value > 0.0 { Cell::Number { value, digits: 2 } } else { Cell::from("none found") }
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
