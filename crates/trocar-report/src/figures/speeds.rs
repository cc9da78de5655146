//! Error of the model by speed of the stroke and by phase of the motion.

use std::collections::BTreeMap;

use super::{Drawn, MM, Scored};
use crate::document::{Axis, Cell, Figure, Panel, Role, Series, Table};
use trocar_identify::validate::Validation;

/// Samples and sum of squared errors, N², for each speed in mm/s.
fn by_speed(validation: &Validation) -> BTreeMap<u64, (f64, f64)> {
    let mut groups: BTreeMap<u64, (f64, f64)> = BTreeMap::new();
    for part in validation.recordings.iter().flat_map(|r| &r.by_speed) {
        let group = groups.entry((MM * part.speed_m_s).round() as u64).or_default();
        group.0 += part.samples as f64;
        group.1 += part.samples as f64 * part.rms_n.powi(2);
    }
    groups
}

/// Root mean square error against speed, over all recordings.
pub(in super::super) fn error_by_speed(scored: &Scored) -> Drawn {
    let groups = by_speed(&scored.validation);
    if groups.len() < 2 {
        return Err(
            "The error is not drawn against speed: all strokes have about one speed.".to_owned()
        );
    }
    let x: Vec<f64> = groups.keys().map(|speed| *speed as f64).collect();
    let y: Vec<f64> = groups.values().map(|(n, squares)| (squares / n).sqrt()).collect();
    let noise = scored.recordings.iter().map(|r| r.quality.force_noise).fold(0.0, f64::max);
    let ends = vec![x[0], x[x.len() - 1]];
    let mut panel = Panel::new(
        Axis::new("speed of the stroke", "mm/s"),
        Axis::new("rms error", "N").with_zero(),
    )
    .series(Series::line("rms error", Role::Model, x.clone(), y.clone()))
    .series(Series::points("rms error", Role::Model, x, y));
    if noise > 0.0 {
        panel =
            panel.series(Series::line("noise of the sensor", Role::Neutral, ends, vec![noise; 2]));
    }
    Ok(Figure::new("error-by-speed", 0, "Error by speed").panel(panel.aspect(0.4)).caption(format!(
        "Root mean square of measured minus computed force over the strokes of each speed (to the next 5 mm/s), on {}. No model can go \
         below the noise of the sensor.",
        scored.kind()
    )))
}

/// Scores of each recording.
pub(in super::super) fn error_by_recording(scored: &Scored) -> Table {
    let columns = [
        "Recording",
        "rms (N)",
        "Fit (%)",
        "Mean (N)",
        "Largest (N)",
        "Samples scored",
        "Left out at the start",
    ];
    let number = |value, digits| Cell::Number { value, digits };
    let empty = Table::new(format!("Measured minus computed force on {}", scored.kind()), columns);
    scored.validation.recordings.iter().fold(empty, |table, r| {
        table.row([
            Cell::Text(r.path.clone()),
            number(r.rms_n, 3),
            number(r.fit_percent, 3),
            number(r.bias_n, 2),
            number(r.worst_n, 2),
            Cell::Text(r.samples.to_string()),
            Cell::Text(r.samples_before_known.to_string()),
        ])
    })
}

/// Error of each recording by phase of the motion.
pub(in super::super) fn error_by_phase(scored: &Scored) -> Table {
    let columns = ["Recording", "Phase", "rms (N)", "Share of the squared error (%)", "Samples"];
    let mut table = Table::new("Error by phase of the motion (held: slower than 1 mm/s)", columns);
    for r in &scored.validation.recordings {
        let phases = [
            ("deformation", &r.by_phase.deformation),
            ("sliding", &r.by_phase.sliding),
            ("hold", &r.by_phase.hold),
        ];
        for (name, part) in phases.into_iter().filter(|(_, part)| part.samples > 0) {
            table = table.row([
                Cell::Text(r.path.clone()),
                Cell::from(name),
                Cell::Number { value: part.rms_n, digits: 3 },
                Cell::Number { value: 100.0 * part.share_of_squares, digits: 2 },
                Cell::Text(part.samples.to_string()),
            ]);
        }
    }
    table
}
