//! Creates a report from the results of an identification and its validation: the paper's section
//! IV with the user's own data.
//!
//! This module estimates nothing.

use rayon::prelude::*;
use trocar_model::Element;

use super::document::{Document, Section, origin};
use super::figures::{self, MOST_CHOSEN, Scored};
use super::number::{recorded_in_words, thousandths};
use super::{ReportError, card};
use trocar_identify::{Identification, IdentifyOptions, Warning};
use trocar_lab::motion::MotionRange;
use trocar_lab::validate::Validated;
use trocar_lab::workflow::MovingMass;
use trocar_recording::Recording;

/// Inputs of an identification report.
#[derive(Debug, Clone, Copy)]
pub struct IdentificationReport<'a> {
    /// The result.
    pub identification: &'a Identification,
    /// The model beside the recordings used for identification.
    pub own: &'a Validated,
    /// Their motion and forces.
    pub range: MotionRange,
    /// The model beside the validation recordings.
    pub held_out: Option<&'a Validated>,
    /// The elements of the virtual bench, if the data come from one.
    pub truth: Option<&'a [Element]>,
    /// Options of the identification.
    pub options: &'a IdentifyOptions,
    /// Mass that was subtracted from the readings.
    pub moving_mass: MovingMass,
    /// The command line, if there was one.
    pub command: Option<&'a str>,
    /// Title of the report.
    pub title: &'a str,
    /// Contents of two of the figures.
    pub choice: FigureChoice<'a>,
}

/// Contents of figures 7 and 9 of EMS; empty lists select the default.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct FigureChoice<'a> {
    /// Deflections, m, at which the force is drawn against the deformation velocity (EMS figure 7);
    /// by default ∓c/2 and 0.
    pub deflections: &'a [f64],
    /// Speeds, m/s, of the cycles drawn in the cross-validation (EMS figure 9); by default the
    /// lowest and the highest.
    pub speeds: &'a [f64],
}

/// Largest relative difference between a stroke's speed and the requested one.
pub const LIKE_SPEED: f64 = 0.1;

/// Checks whether the figures can show the selection.
///
/// # Errors
/// [`ReportError`]: too many values, a deflection outside ±c, a speed that was not recorded. A
/// figure that cannot be drawn at all accepts any selection; the report gives the reason why it is
/// missing.
pub fn check_choice(input: &IdentificationReport) -> Result<(), ReportError> {
    let FigureChoice { deflections, speeds } = input.choice;
    for (figure, what, count) in
        [(7, "deflections", deflections.len()), (9, "speeds", speeds.len())]
    {
        if count > MOST_CHOSEN {
            return Err(ReportError::Choice(format!(
                "{figure} shows at most {MOST_CHOSEN} {what}, got {count}"
            )));
        }
    }
    if let Ok(deformation) = &input.identification.deformation {
        let half_width = deformation.half_width.value;
        if let Some(&deflection) = deflections.iter().find(|z| z.is_nan() || z.abs() > half_width) {
            return Err(ReportError::Choice(format!(
                "7: the deflection {} mm lies outside ±c = ±{} mm",
                thousandths(deflection),
                thousandths(half_width)
            )));
        }
    }
    if speeds.is_empty() {
        return Ok(());
    }
    let recorded =
        figures::cycle_speeds(&figures::scored(input.identification, input.own, input.held_out));
    let other = speeds
        .iter()
        .find(|speed| !recorded.iter().any(|own| (own - **speed).abs() <= LIKE_SPEED * **speed));
    match other {
        Some(&speed) => Err(ReportError::Choice(format!(
            "9: no recorded stroke has a speed within 10 % of {} mm/s{}",
            thousandths(speed),
            recorded_in_words(&recorded)
        ))),
        None => Ok(()),
    }
}

/// Heading of the section on the fit to all motion.
const FIT: &str = "Fit to all motion";

/// Explanation in the section of the live model.
const LIVE: &str = "The identified model itself runs here, the same steps as in every other program of this project. Turn its parameters (the \
                    stroke above a slider is the value identified, the bar below it the 95 % interval), run it along a recorded motion, drag the \
                    instrument, or draw a motion: force and loop follow at once. The measured force is shown less the sensor offset \
                    and the inertia of any mass between sensor and seal.";

/// The report: model card, warnings, parameters, recordings, and the figures of EMS section IV.
///
/// Equal input gives equal documents. Figures are numbered in order of appearance. If its data are
/// missing, a figure is replaced by a sentence with the reason.
pub fn document(input: &IdentificationReport) -> Document {
    let found = input.identification;
    let scored = figures::scored(found, input.own, input.held_out);
    Document {
        title: input.title.to_owned(),
        subtitle: subtitle(input),
        card: card::rows(
            found,
            (&input.own.recordings, &input.range),
            input.moving_mass.mass,
            &scored,
        ),
        tiles: Vec::new(),
        warnings: warnings(found, &scored),
        notes: lines(found.warnings.iter().filter(|w| !w.doubtful)),
        sections: sections(input, &scored),
        provenance: provenance(input),
    }
    .numbered()
}

fn subtitle(input: &IdentificationReport) -> String {
    let validated = input.held_out.map_or_else(
        || "not validated on other recordings".to_owned(),
        |held_out| format!("validated on {}", figures::names(&held_out.recordings)),
    );
    format!(
        "Extended Maxwell-Slip model identified from {}; {validated}",
        figures::names(&input.own.recordings)
    )
}

/// Reasons to doubt the identification or its validation.
fn warnings(found: &Identification, scored: &Scored) -> Vec<String> {
    let mut all = lines(found.warnings.iter().filter(|w| w.doubtful));
    if scored.held_out {
        let results = &scored.validation.recordings;
        all.extend(
            results.iter().flat_map(|r| r.warnings.iter().map(move |w| format!("{}: {w}", r.path))),
        );
    }
    all
}

/// One line per message, beginning with its subjects.
fn lines<'a>(warnings: impl Iterator<Item = &'a Warning>) -> Vec<String> {
    let mut lines: Vec<(Vec<String>, &str)> = Vec::new();
    for Warning { subject, message, .. } in warnings {
        let subject = figures::subject_in_words(subject);
        match lines.iter_mut().find(|(_, said)| said == message) {
            Some((subjects, _)) => subjects.push(subject),
            None => lines.push((vec![subject], message)),
        }
    }
    lines
        .into_iter()
        .map(|(subjects, message)| format!("{}: {message}", subjects.join("; ")))
        .collect()
}

fn sections(input: &IdentificationReport, scored: &Scored) -> Vec<Section> {
    let (found, own) = (input.identification, input.own);
    let parts: [&(dyn Fn() -> Option<Section> + Sync); 10] = [
        &|| Some(live(input, scored)),
        &|| Some(parameters(input)),
        &|| {
            let section = Section::new("Recordings").table(figures::sampling(recordings(input)));
            Some(section.table(figures::resolution(recordings(input))))
        },
        &|| fit(input, scored),
        &|| Some(Section::new("Velocity reversal").drawn(figures::velocity_step(found, own))),
        &|| Some(Section::new("Static friction").drawn(figures::static_friction(found))),
        &|| {
            let section = Section::new("Deformation")
                .drawn(figures::deformation_velocity(found, input.choice.deflections))
                .drawn(figures::deformation_force(found, input.truth));
            Some(section.drawn(figures::half_width(found)))
        },
        &|| {
            let cycles = figures::cross_validation(scored, input.choice.speeds);
            Some(Section::new("Cross-validation").drawn(cycles))
        },
        &|| Some(residuals(scored)),
        &|| {
            let table = figures::branch_coefficients(found)?;
            Some(Section::new("Coefficients of the branches").table(table))
        },
    ];
    parts.par_iter().filter_map(|section| section()).collect()
}

fn residuals(scored: &Scored) -> Section {
    Section::new("Residuals")
        .table(figures::error_by_recording(scored))
        .table(figures::error_by_phase(scored))
        .figure(figures::residuals(scored))
        .drawn(figures::residual_statistics(scored))
        .drawn(figures::error_by_speed(scored))
}

/// The interactive model.
fn live(input: &IdentificationReport, scored: &Scored) -> Section {
    let section = Section::new("The model, live");
    match figures::live_model(input.identification, scored) {
        Ok(model) => section.paragraph(LIVE).live(model),
        Err(why) => section.paragraph(why),
    }
}

/// The section on the fit; `None` without a fit.
fn fit(input: &IdentificationReport, scored: &Scored) -> Option<Section> {
    let found = input.identification;
    let fit = found.fit.as_ref()?;
    let mut section =
        Section { paragraphs: figures::fit_in_words(found, fit), ..Section::new(FIT) };
    if !fit.terms.is_empty() {
        section = section.table(figures::terms(fit));
    }
    let section = section.drawn(figures::friction_scale(found, &input.own.recordings));
    let small = found.free_motion.partial_reversals > 0 && found.free_motion.held_s > 1.0;
    Some(if small {
        section.drawn(figures::small_motion(found, input.own, scored))
    } else {
        section
    })
}

fn parameters(input: &IdentificationReport) -> Section {
    let found = input.identification;
    let truth = match input.truth {
        Some(_) => {
            " The truth is what the virtual bench was run with; a dash marks what has no single true value."
        }
        None => "",
    };
    let (values, intervals) =
        if found.fit.is_some() { of_all_motion(found) } else { of_two_steps() };
    Section::new("Parameters")
        .paragraph(format!("{values}{truth}"))
        .paragraph(format!(
            "{intervals} Velocity and force are positive on insertion; the force is what the instrument exerts on the seal."
        ))
        .table(figures::parameters(found, input.truth))
}

/// Origin of values and intervals when the element was fitted to all motion.
fn of_all_motion(found: &Identification) -> (String, String) {
    let beside = if found.steady.means.is_empty() {
        "Nothing slides steadily here, so the paper's two steps give nothing to compare it with."
    } else {
        "The paper's two steps are shown for comparison."
    };
    let values = format!(
        "The value is that of the fit to all motion (section “{FIT}”), in which F_0, F_c and β are free as well. {beside}"
    );
    (
        values,
        "Intervals come from the jackknife over clusters of cycles, to first order.".to_owned(),
    )
}

/// The same for the paper's two steps.
fn of_two_steps() -> (String, String) {
    let intervals = "Intervals of the sliding force come from the scatter between strokes, those of the joins and of the coefficients of the \
                     branches by the jackknife over strokes.";
    ("The value is that of the paper's two steps.".to_owned(), intervals.to_owned())
}

fn recordings<'a>(
    input: &IdentificationReport<'a>,
) -> impl Iterator<Item = (&'a Recording, &'static str)> {
    let held_out = input.held_out.into_iter().flat_map(|held_out| &held_out.recordings);
    let training = input.own.recordings.iter().map(|r| (r, "identification"));
    training.chain(held_out.map(|r| (r, "validation")))
}

fn provenance(input: &IdentificationReport) -> Vec<(String, String)> {
    let mut all: Vec<_> =
        input.command.map(|command| origin("Command", command)).into_iter().collect();
    let MovingMass { mass, gravity } = input.moving_mass;
    let options = input.options.in_words();
    all.push(origin(
        "Options",
        format!("moving mass {mass} kg, gravity {gravity} m/s², {options}"),
    ));
    all
}
