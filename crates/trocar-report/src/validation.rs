//! Creates figures from a model, recordings and its simulation over them: for any model, not only
//! for one just identified.

use super::document::{Axis, Document, Figure, Role, Section};
use super::figures::{self, line, over_time};
use trocar_lab::validate::Validated;

/// Most recordings that are drawn.
const MOST_RECORDINGS: usize = 4;

/// Measured and computed force over time and the residual, one figure for each of the first four
/// recordings.
///
/// The readings contain the sensor offset `offset`, N.
pub fn document(validated: &Validated, offset: f64, title: &str) -> Document {
    let mut section = Section::new("Model against measurement");
    let Validated { recordings, runs, validation } = validated;
    let scored = recordings.iter().zip(runs).zip(&validation.recordings);
    for (number, ((recording, run), scores)) in (1..).zip(scored.take(MOST_RECORDINGS)) {
        let time = &recording.time;
        let measured = recording.force.iter().map(|force| force - offset);
        let error = measured.clone().zip(&run.force).map(|(measured, model)| measured - model);
        let forces = over_time(Axis::new("force", "N").with_zero())
            .series(line(figures::measured(recording), Role::Measured, time, measured))
            .series(line("model", Role::Model, time, run.force.iter().copied()))
            .aspect(0.3);
        let errors = over_time(Axis::new("measured - model", "N").with_zero())
            .series(line("error", Role::Residual, time, error))
            .aspect(0.2);
        let caption = format!(
            "The force of the model from the measured positions of {} beside the readings less the sensor offset of {offset:.3} N. \
             Root mean square error {:.3} N, fit {:.2} %.",
            recording.name, scores.rms_n, scores.fit_percent
        );
        let id = format!("validation-{number}");
        let figure = Figure::new(id, number, recording.name.as_str()).caption(caption);
        section = section.figure(figure.panel(forces).panel(errors).linked_x());
    }
    Document { title: title.to_owned(), sections: vec![section], ..Document::default() }
}
