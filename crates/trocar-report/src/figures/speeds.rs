//! Error of the model by speed of the stroke and by phase of the motion.

use std::collections::BTreeMap;

use super::{Drawn, MM, Scored};
use crate::document::{Axis, Cell, Figure, Panel, Role, Series, Table};
use trocar_lab::validate::{SpeedPart, Validation};

/// Samples and sum of squared errors, N², for each speed in mm/s.
fn by_speed(validation: &Validation) -> BTreeMap<u64, (f64, f64)> {
    let mut groups: BTreeMap<u64, (f64, f64)> = BTreeMap::new();
    let parts = validation.recordings.iter().flat_map(|r| &r.by_speed);
    for SpeedPart { speed_m_s, rms_n, samples } in parts {
        let (n, squares) = groups.entry((MM * speed_m_s).round() as u64).or_default();
        *n += *samples as f64;
        *squares += *samples as f64 * rms_n.powi(2);
    }
    groups
}

/// Root mean square error against speed, over all recordings.
pub(crate) fn error_by_speed(scored: &Scored) -> Drawn {
    let groups = by_speed(scored.validation);
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
    .curve("rms error", Role::Model, &x, &y);
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
pub(crate) fn error_by_recording(scored: &Scored) -> Table {
    let caption = format!("Measured minus computed force on {}", scored.kind());
    Table::of(
        caption,
        &scored.validation.recordings,
        &[
            ("Recording", &|r| r.path.as_str().into()),
            ("rms (N)", &|r| Cell::number(r.rms_n, 3)),
            ("Fit (%)", &|r| Cell::number(r.fit_percent, 3)),
            ("Mean (N)", &|r| Cell::number(r.bias_n, 2)),
            ("Largest (N)", &|r| Cell::number(r.worst_n, 2)),
            ("Samples scored", &|r| Cell::count(r.samples)),
            ("Left out at the start", &|r| Cell::count(r.samples_before_known)),
        ],
    )
}

/// Error of each recording by phase of the motion.
pub(crate) fn error_by_phase(scored: &Scored) -> Table {
    let phases = scored.validation.recordings.iter().flat_map(|r| {
        [
            (r, "deformation", &r.by_phase.deformation),
            (r, "sliding", &r.by_phase.sliding),
            (r, "hold", &r.by_phase.hold),
        ]
    });
    let seen = phases.filter(|(_, _, part)| part.samples > 0);
    Table::of(
        "Error by phase of the motion (held: slower than 1 mm/s)",
        seen,
        &[
            ("Recording", &|(r, _, _)| r.path.as_str().into()),
            ("Phase", &|(_, name, _)| (*name).into()),
            ("rms (N)", &|(_, _, part)| Cell::number(part.rms_n, 3)),
            ("Share of the squared error (%)", &|(_, _, part)| {
                Cell::number(100.0 * part.share_of_squares, 2)
            }),
            ("Samples", &|(_, _, part)| Cell::count(part.samples)),
        ],
    )
}
