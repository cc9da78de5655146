//! From the results of an identification and its validation to a report: the paper's section IV with the user's own data.
//!
//! Nothing is estimated here. The identified model is run over the recordings once more, because the results keep scores, not
//! series.

use trocar_model::Element;

use super::document::{Document, Section, Tile};
use super::figures::{self, Scored};
use super::number::{fixed, significant};
use crate::identify::{Identification, Parameter, Warning};
use crate::recording::Recording;
use crate::validate::Validation;

/// What a report of an identification is made from.
#[derive(Debug, Clone, Copy)]
pub struct IdentificationReport<'a> {
    /// The result.
    pub identification: &'a Identification,
    /// The recordings it was identified from, as they were given to it: a declared moving mass taken out, an undeclared one
    /// ([`Candidate::hidden_mass`](crate::identify::Candidate)) still inside.
    pub training: &'a [Recording],
    /// Recordings that the identification has not seen, as they were scored (undeclared mass taken out), and the scores;
    /// an empty list counts as none.
    pub validation: Option<(&'a [Recording], &'a Validation)>,
    /// The elements a virtual bench was run with, where the data come from one.
    pub truth: Option<&'a [Element]>,
    /// Seed of the identification.
    pub seed: u64,
    /// Resamples of its bootstrap; 0 for the jackknife.
    pub bootstrap: usize,
    /// Title of the report.
    pub title: &'a str,
}

/// Heading of the section on the fit to all motion.
const MOTION: &str = "Motion of any kind";

/// What the section of the live model is.
const LIVE: &str = "The identified model itself runs here, the same steps as in every other program of this project. Turn its parameters (the \
                    stroke above a slider is the value identified, the bar below it the 95 % interval), run it along a recorded motion, drag the \
                    instrument, or draw a motion: force and loop follow at once. The measured force is shown less the sensor offset.";

/// Root mean square error, N, that EMS section IV-C reports on its own data.
const ERROR_OF_EMS: &str = "EMS reports 0.17 N on its own data";

/// The report: summary, warnings, parameters, recordings, and the figures of EMS section IV.
///
/// Equal input gives equal documents. Figures are numbered in order of appearance; one whose data are missing is replaced by a
/// sentence that says why.
pub fn document(input: &IdentificationReport) -> Document {
    let validation = input.validation.filter(|(recordings, _)| !recordings.is_empty());
    let input = &IdentificationReport { validation, ..*input };
    let found = input.identification;
    let scored = figures::scored(found, input.training, input.validation);
    let mut document = Document {
        title: input.title.to_owned(),
        subtitle: subtitle(input),
        tiles: tiles(found, &scored),
        warnings: warnings(found, &scored),
        sections: sections(input, &scored),
        provenance: provenance(input),
    };
    let drawn = document.sections.iter_mut().flat_map(|section| &mut section.figures);
    drawn.zip(1..).for_each(|(figure, number)| figure.number = number);
    document
}

fn subtitle(input: &IdentificationReport) -> String {
    let names = |recordings: &[Recording]| recordings.iter().map(|r| r.name.as_str()).collect::<Vec<_>>().join(", ");
    let validated = input.validation.map_or_else(
        || "not validated on other recordings".to_owned(),
        |(recordings, _)| format!("validated on {}", names(recordings)),
    );
    format!("Extended Maxwell-Slip model identified from {}; {validated}", names(input.training))
}

fn tiles(found: &Identification, scored: &Scored) -> Vec<Tile> {
    let (error, fit) = if scored.held_out {
        ("Validation error (rms)", "Validation fit")
    } else {
        ("Error on its own data (rms)", "Fit to its own data")
    };
    let mut tiles = vec![
        Tile::new(error, format!("{} N", significant(scored.validation.rms_n, 3)), error_note(scored)),
        Tile::new(fit, format!("{} %", fixed(scored.validation.fit_percent, 1)), "100·(1 − rms/sd of the readings)"),
    ];
    for name in ["coulomb_force_n", "viscous_damping_n_s_m", "half_width_m", "offset_n"] {
        if let Some(estimate) = found.parameter(name) {
            let (words, symbol) = figures::name_of(name);
            let (value, interval) = figures::value_and_interval(estimate);
            tiles.push(Tile::new(format!("{words} {symbol}"), value, interval));
        }
    }
    tiles
}

/// The error of each recording, where there are few, and that of EMS beside it.
fn error_note(scored: &Scored) -> String {
    let recordings = &scored.validation.recordings;
    if !(2..=3).contains(&recordings.len()) {
        return ERROR_OF_EMS.to_owned();
    }
    let each = recordings.iter().map(|r| format!("{} N on {}", significant(r.rms_n, 3), r.path));
    format!("{}; {ERROR_OF_EMS}", each.collect::<Vec<_>>().join(", "))
}

/// One line for each message, what it concerns in words before it; doubts come before remarks.
fn warnings(found: &Identification, scored: &Scored) -> Vec<String> {
    let mut lines: Vec<(Vec<String>, &str)> = Vec::new();
    let doubts = found.warnings.iter().filter(|w| w.doubtful);
    let remarks = found.warnings.iter().filter(|w| !w.doubtful);
    for Warning { subject, message, .. } in doubts.chain(remarks) {
        let subject = figures::name_of(subject).0;
        match lines.iter_mut().find(|(_, said)| said == message) {
            Some((subjects, _)) => subjects.push(subject),
            None => lines.push((vec![subject], message)),
        }
    }
    if scored.held_out {
        for recording in &scored.validation.recordings {
            lines.extend(recording.warnings.iter().map(|w| (vec![recording.path.clone()], w.as_str())));
        }
    }
    lines.into_iter().map(|(subjects, message)| format!("{}: {message}", subjects.join("; "))).collect()
}

fn sections(input: &IdentificationReport, scored: &Scored) -> Vec<Section> {
    let found = input.identification;
    let section = |heading: &str, drawn| figures::with(Section::new(heading), drawn);
    let deformation = section("Deformation", figures::deformation_velocity(found));
    let deformation = figures::with(deformation, figures::deformation_force(found, input.truth));
    let errors = Section::new("Residuals")
        .table(figures::error_by_recording(scored))
        .table(figures::error_by_phase(scored))
        .figure(figures::residuals(scored));
    let errors = figures::with(errors, figures::residual_statistics(scored));
    let mut all = vec![
        parameters(input),
        Section::new("Recordings")
            .table(figures::sampling(recordings(input)))
            .table(figures::resolution(recordings(input))),
    ];
    all.extend(motion(input, scored));
    all.extend([
        section("Velocity reversal", figures::velocity_step(found, input.training)),
        section("Static friction", figures::static_friction(found)),
        figures::with(deformation, figures::half_width(found)),
        section("Cross-validation", figures::cross_validation(scored)),
        figures::with(errors, figures::error_by_speed(scored)),
    ]);
    if let Some(table) = figures::branch_coefficients(found) {
        all.push(Section::new("Coefficients of the branches").table(table));
    }
    all.push(live(input, scored));
    all
}

/// The model to play with.
fn live(input: &IdentificationReport, scored: &Scored) -> Section {
    let section = Section::new("The model, live");
    match figures::live_model(input.identification, scored) {
        Ok(model) => Section { live: Some(model), ..section.paragraph(LIVE) },
        Err(why) => section.paragraph(why),
    }
}

/// The fit to all motion; `None` where there was none.
fn motion(input: &IdentificationReport, scored: &Scored) -> Option<Section> {
    let found = input.identification;
    let fit = found.motion.as_ref()?;
    let section = Section {
        paragraphs: figures::motion_in_words(found, fit),
        ..Section::new(MOTION).table(figures::ingredients(fit)).figure(figures::held_out_errors(fit))
    };
    Some(figures::with(section, figures::small_motion(found, input.training, scored)))
}

fn parameters(input: &IdentificationReport) -> Section {
    let found = input.identification;
    let truth = match input.truth {
        Some(_) => " The truth is what the virtual bench was run with; a dash marks what has no single true value.",
        None => "",
    };
    let (values, intervals) = if found.motion.is_some() { of_all_motion(found) } else { of_full_strokes(input) };
    Section::new("Parameters")
        .paragraph(format!("{values}{truth}"))
        .paragraph(format!(
            "{intervals} Velocity and force are positive on insertion; the force is what the instrument exerts on the seal."
        ))
        .table(figures::parameters(found, input.truth))
}

/// Where values and intervals come from when the element was fitted to all motion.
fn of_all_motion(found: &Identification) -> (String, String) {
    let beside = if found.steady.means.is_empty() {
        "Nothing slides steadily here, so the paper's two steps give nothing to put beside it."
    } else {
        "The paper's two steps stand beside it."
    };
    let values = format!(
        "The value is that of the fit to all motion (section “{MOTION}”), in which F_0, F_c and β are free as well. {beside}"
    );
    let symmetric = found.model.insertion == found.model.withdrawal;
    let of_direction = |p: &Parameter| p.name.ends_with("_positive") || p.name.ends_with("_negative");
    let lines = if symmetric && found.parameters.iter().any(of_direction) {
        " The lines of each direction are those of the steady state, with its intervals."
    } else {
        ""
    };
    let intervals = format!("Intervals come from the jackknife over clusters of cycles, to first order.{lines}");
    (values, intervals)
}

/// The same for the paper's two steps and their refinement.
fn of_full_strokes(input: &IdentificationReport) -> (String, String) {
    let found = input.identification;
    let branches = match input.bootstrap {
        0 => "by the jackknife over passes".to_owned(),
        n => format!("by a bootstrap of {n} resamples of whole cycles (seed {})", input.seed),
    };
    let refinement = match &found.refinement {
        Some(r) if r.accepted => format!(
            "The value is that of the refinement against the simulated force, which holds F_0, F_c and β at the steady state's. On passes held out of it the weighted \
             error is {:.4} N, against {:.4} N of the paper's two steps, which stand beside it.",
            r.held_out_refined_rms_n, r.held_out_two_step_rms_n
        ),
        Some(r) => format!(
            "The value is that of the paper's two steps. A refinement against the simulated force was not accepted: \
             on passes held out of it the weighted error is {:.4} N, against {:.4} N of the two steps.",
            r.held_out_refined_rms_n, r.held_out_two_step_rms_n
        ),
        None => "The value is that of the paper's two steps; no refinement was made.".to_owned(),
    };
    let intervals = format!(
        "Intervals of the sliding force come from the scatter between passes, those of the refinement from the jackknife over passes, \
         those of the joins and of the coefficients of the branches {branches}."
    );
    (refinement, intervals)
}

fn recordings<'a>(input: &IdentificationReport<'a>) -> impl Iterator<Item = (&'a Recording, &'static str)> {
    let validation = input.validation.map_or(&[] as &[Recording], |(recordings, _)| recordings);
    let training = input.training.iter().map(|r| (r, "identification"));
    training.chain(validation.iter().map(|r| (r, "validation")))
}

fn provenance(input: &IdentificationReport) -> Vec<(String, String)> {
    let mut all = vec![
        ("Program".to_owned(), concat!("trocar ", env!("CARGO_PKG_VERSION")).to_owned()),
        ("Seed".to_owned(), input.seed.to_string()),
        ("Bootstrap resamples".to_owned(), input.bootstrap.to_string()),
        ("EMS".to_owned(), "J. Verspecht et al., Modeling of the interaction force between the instrument and the trocar in minimally invasive surgery".to_owned()),
    ];
    all.extend(
        recordings(input).map(|(r, used_for)| (format!("{} ({used_for})", r.name), format!("SHA-256 {}", r.sha256))),
    );
    all
}
