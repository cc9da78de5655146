//! Tables of parameters and of data quality.

use trocar_model::{Branch, Element};

use super::MM;
use crate::identify::{Estimate, Identification, Parameter};
use crate::recording::{Quality, Recording};
use crate::report::document::{Cell, Table};

/// Factor from SI, and the displayed unit.
pub(in super::super) fn display(unit: &str) -> (f64, String) {
    match unit {
        "m" => (MM, "mm".to_owned()),
        "m/s" => (MM, "mm/s".to_owned()),
        "N s/m" => (1.0, "N·s/m".to_owned()),
        other => {
            let raised = ["²", "³", "⁴", "⁵", "⁶", "⁷"].iter().zip(2..);
            (1.0, raised.fold(other.to_owned(), |text, (sign, power)| text.replace(&format!("^{power}"), sign)))
        }
    }
}

/// Name and symbol of a parameter of `summary.json`; an unknown name is returned unchanged.
pub(in super::super) fn name_of(parameter: &str) -> (String, String) {
    let (words, symbol) = match parameter {
        "coulomb_force_n" => ("Coulomb force", "F_c"),
        "insertion_coulomb_force_with_offset_n" => ("Coulomb force with offset, insertion", "F_c⁺ + F_0"),
        "withdrawal_coulomb_force_with_offset_n" => ("Coulomb force with offset, withdrawal", "F_c⁻ − F_0"),
        "viscous_damping_n_s_m" => ("Viscous damping", "β"),
        "insertion_viscous_damping_n_s_m" => ("Viscous damping, insertion", "β⁺"),
        "withdrawal_viscous_damping_n_s_m" => ("Viscous damping, withdrawal", "β⁻"),
        "offset_n" => ("Sensor offset", "F_0"),
        "static_force_n" => ("Static force", "F_s"),
        "stribeck_velocity_m_s" => ("Stribeck velocity", "v_s"),
        "half_width_m" => ("Half width of the deformation", "c"),
        "seal_damping_n_s_m" => ("Seal damping", "σ"),
        "yield_stiffness_n_m" => ("Minor-loop stiffness", "κ"),
        "creep_velocity_m_s" => ("Creep velocity of the contact", "v_c"),
        "friction_lag_s" => ("Lag of the Stribeck curve", "T"),
        "relaxation_stiffness_n_m" => ("Stiffness of the relaxation", "E"),
        "relaxation_time_s" => ("Relaxation time", "τ"),
        "second_relaxation_stiffness_n_m" => ("Stiffness of the second relaxation", "E_2"),
        "second_relaxation_time_s" => ("Second relaxation time", "τ_2"),
        "second_coulomb_force_n" => ("Coulomb force of the second stage, part of F_c", "F_c2"),
        "second_half_width_m" => ("Half width of the second stage", "c_2"),
        "sliding friction" => ("Sliding friction", "F_sl"),
        "fit" => ("Fit", ""),
        "unmodelled_mass_kg" => ("Unmodelled mass before the seal", "m"),
        "rising_join_m" => ("Join, insertion", "a⁺"),
        "falling_join_m" => ("Join, withdrawal", "a⁻"),
        "rising_join_force_n" => ("Force at the join, insertion", "F(a⁺)"),
        "falling_join_force_n" => ("Force at the join, withdrawal", "F(a⁻)"),
        "stribeck_exponent" => ("Stribeck exponent", "δ"),
        "exponent" => ("Exponent of the transition", "n"),
        "stiffness_n_m" => ("Stiffness", "k"),
        "micro_damping_n_s_m" => ("Micro-damping", "σ"),
        "attraction_n_s" => ("Attraction", "C"),
        other => {
            let found = coefficient(other).or_else(|| of_element(other));
            return found.unwrap_or_else(|| (other.to_owned(), String::new()));
        }
    };
    (words.to_owned(), symbol.to_owned())
}

/// `rising_theta1_3_n_m3`: coefficient 3 of the polynomial left of the join.
fn coefficient(parameter: &str) -> Option<(String, String)> {
    let (side, rest) = parameter.split_once("_theta")?;
    let motion = if side == "rising" { "insertion" } else { "withdrawal" };
    let mut parts = rest.split('_');
    let (piece, power) = (parts.next()?, parts.next()?);
    let place = if piece == "1" { "left of the join" } else { "right of the join" };
    Some((format!("Coefficient of z^{power}, {motion}, {place}"), format!("θ{piece}_{power}")))
}

/// `limit_force_n_3`: a parameter of element 3 of a bank.
fn of_element(parameter: &str) -> Option<(String, String)> {
    let (name, element) = parameter.rsplit_once('_')?;
    let element: usize = element.parse().ok()?;
    let (words, symbol) = match name {
        "stiffness_n_m" => ("Stiffness", "k"),
        "limit_force_n" => ("Limit force", "F"),
        "damping_n_s_m" => ("Damping", "σ"),
        _ => return None,
    };
    Some((format!("{words}, element {element}"), format!("{symbol}_{element}")))
}

/// The main parameters: refined beside two-step, and beside the truth if that is known.
pub(in super::super) fn parameters(found: &Identification, truth: Option<&[Element]>) -> Table {
    let main = |p: &&Parameter| !p.is_coefficient();
    table("Parameters with 95 % intervals", found, found.parameters.iter().filter(main), truth)
}

/// The coefficients of the branches, EMS (25), about z = 0.
pub(in super::super) fn branch_coefficients(found: &Identification) -> Option<Table> {
    let mut all = found.parameters.iter().filter(|p| p.is_coefficient()).peekable();
    all.peek()?;
    let caption = "Polynomial coefficients θ of the branches, EMS (25), with z in m";
    Some(table(caption, found, all, None))
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
    if refined {
        columns.extend(["Two-step value", "Two-step 95 % interval"]);
    }
    if truth.is_some() {
        columns.push("Truth");
    }
    parameters.fold(Table::new(caption, columns), |table, p| {
        let (words, symbol) = name_of(&p.name);
        let (scale, unit) = display(p.estimate.unit);
        let mut cells = vec![Cell::Text(words), Cell::Text(symbol), Cell::Text(unit)];
        cells.extend(cells_of(&p.estimate, scale));
        if refined {
            let earlier = found.two_step_parameters.iter().find(|q| q.name == p.name);
            cells.extend(earlier.map_or_else(|| ["–", "–"].map(Cell::from), |q| cells_of(&q.estimate, scale)));
        }
        if let Some(elements) = truth {
            let value = true_value(&p.name, elements).map_or(f64::NAN, |value| scale * value);
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
fn true_value(name: &str, elements: &[Element]) -> Option<f64> {
    let sum = |of: &dyn Fn(&Element) -> f64| elements.iter().map(of).sum::<f64>();
    let mean = |a: f64, b: f64| 0.5 * (a + b);
    let single = match elements {
        [element] => Some(element.params()),
        _ => None,
    };
    let join = |branch: &Branch| branch.join();
    match name {
        "coulomb_force_n" => {
            Some(sum(&|e| mean(e.params().insertion.coulomb_force, e.params().withdrawal.coulomb_force)))
        }
        "viscous_damping_n_s_m" => {
            Some(sum(&|e| mean(e.params().insertion.viscous_damping, e.params().withdrawal.viscous_damping)))
        }
        "insertion_viscous_damping_n_s_m" => Some(sum(&|e| e.params().insertion.viscous_damping)),
        "withdrawal_viscous_damping_n_s_m" => Some(sum(&|e| e.params().withdrawal.viscous_damping)),
        "static_force_n" => Some(sum(&|e| mean(e.params().insertion.static_force, e.params().withdrawal.static_force))),
        "stribeck_velocity_m_s" => single.map(|p| p.insertion.stribeck_velocity),
        "seal_damping_n_s_m" => single.map(|p| p.damping.coefficients[0]),
        "creep_velocity_m_s" => single.map(|p| p.creep_velocity),
        "friction_lag_s" => single.map(|p| p.friction_lag),
        "relaxation_stiffness_n_m" => single.map(|p| p.relaxation.arms[0].stiffness),
        "relaxation_time_s" => single.map(|p| p.relaxation.arms[0].time),
        "yield_stiffness_n_m" => single.map(|p| p.deformation.yield_stiffness()),
        "half_width_m" => single.map(|p| p.deformation.half_width()),
        "rising_join_m" => single.map(|p| join(p.deformation.rising())),
        "falling_join_m" => single.map(|p| join(p.deformation.falling())),
        "rising_join_force_n" => single.map(|p| at_join(p.deformation.rising())),
        "falling_join_force_n" => single.map(|p| at_join(p.deformation.falling())),
        _ => None,
    }
}

fn at_join(branch: &Branch) -> f64 {
    branch.force(branch.join())
}

/// Properties of the recordings, one row each.
pub(in super::super) fn sampling<'a>(recordings: impl Iterator<Item = (&'a Recording, &'static str)>) -> Table {
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
pub(in super::super) fn resolution<'a>(recordings: impl Iterator<Item = (&'a Recording, &'static str)>) -> Table {
    let columns = ["Recording", "Position step (µm)", "Position noise (µm)", "Force step (mN)", "Force noise (mN)"];
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
    let found: Vec<String> =
        counted.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}")).collect();
    match (found.is_empty(), quality.warnings.is_empty()) {
        (true, true) => Cell::from("nothing"),
        (true, false) => Cell::Warning(format!("{} warnings", quality.warnings.len())),
        (false, true) => Cell::Text(found.join(", ")),
        (false, false) => Cell::Warning(found.join(", ")),
    }
}
