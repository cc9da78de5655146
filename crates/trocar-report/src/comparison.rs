//! Creates a report from a comparison of friction models: section II-C of EMS with the user's own
//! data.
//!
//! This module estimates nothing. It simulates the models over one cycle again, because the results
//! contain scores but no time series.

use super::document::{Document, Section, Tile, origin};
use super::figures::comparison as figures;
use super::figures::{PAPER, hashes, names, sampling};
use super::number::significant;
use super::{ReportError, stage_document};
use trocar_lab::compare::{Choice, Comparison, Entry, Outcome, ReversalMatch};
use trocar_lab::summary::PROGRAM;
use trocar_recording::Recording;
use trocar_tables::output::StagedFolder;

/// The claim of EMS on the number of elements that a model needs.
const CLAIM: &str = "The paper argues in section II-C that a GMS model needs about ten elements to draw the reversal of the seal: four for each \
                     of the two transients, one between them and one for a change of slope, that is thirty parameters and the \
                     function s(v). Here a family of banks matches the EMS element when its error after the reversals of the \
                     validation is no larger.";

/// The report: summary, one reversal and one cycle by every model, errors, criteria, parameters,
/// warnings.
///
/// Equal input gives equal documents, except for times. Figures are numbered in order of
/// appearance. If its data are missing, a figure is replaced by a sentence with the reason.
pub fn document(outcome: &Outcome, title: &str) -> Document {
    let comparison = &outcome.comparison;
    Document {
        title: title.to_owned(),
        subtitle: subtitle(outcome),
        card: Vec::new(),
        tiles: tiles(comparison),
        warnings: warnings(outcome),
        notes: notes(outcome),
        sections: sections(outcome),
        provenance: provenance(outcome),
    }
    .numbered()
}

/// Title of the report of a comparison.
pub const TITLE: &str = "Friction models compared";

/// Stages compare.json, the models, report.html and figures.
///
/// # Errors
/// Something cannot be written.
pub fn write(outcome: &Outcome, staged: &StagedFolder) -> Result<(), ReportError> {
    staged.write("compare.json", outcome.summary().to_json().as_bytes())?;
    for (path, model) in outcome.model_files() {
        staged.write(&path, model.to_json().as_bytes())?;
    }
    stage_document(staged, &document(outcome, TITLE))
}

fn subtitle(outcome: &Outcome) -> String {
    let Comparison { entries, training, validation, .. } = &outcome.comparison;
    let models =
        if entries.len() == 1 { "1 model".to_owned() } else { format!("{} models", entries.len()) };
    format!("{models} fitted to {}; scored on {}", names(training), names(validation))
}

fn tiles(comparison: &Comparison) -> Vec<Tile> {
    let newtons = |value: f64| format!("{} N", significant(value, 3));
    let mut tiles = Vec::new();
    if let Some(best) = comparison.entries.first() {
        tiles.push(Tile::new("Least validation error", best.title(), parameters_in_words(best)));
        let fit = format!("fit {} %", significant(best.scores.fit_percent, 3));
        tiles.push(Tile::new("Its error (rms)", newtons(best.scores.validate_rms_n), fit));
    }
    let rank = comparison.entries.iter().position(|entry| entry.choice == Choice::Ems);
    if let Some((rank, ems)) = rank.map(|rank| (rank, &comparison.entries[rank])) {
        let place = format!("{} of {}", rank + 1, comparison.entries.len());
        let error = newtons(ems.scores.validate_rms_n);
        let note = format!("{error} rms, {}", parameters_in_words(ems));
        tiles.push(Tile::new("Rank of EMS", place, note));
    }
    let worth = format!("worth {} independent ones", significant(comparison.effective_samples, 2));
    tiles.push(Tile::new("Training samples", comparison.samples.to_string(), worth));
    tiles
}

fn parameters_in_words(entry: &Entry) -> String {
    if entry.parameters == 1 {
        "1 parameter".to_owned()
    } else {
        format!("{} parameters", entry.parameters)
    }
}

fn least_by(comparison: &Comparison, of: impl Fn(&Entry) -> f64) -> Option<&Entry> {
    comparison.entries.iter().min_by(|a, b| of(a).total_cmp(&of(b)))
}

/// Limits of the whole comparison; a table lists the warnings of each fit.
fn warnings(outcome: &Outcome) -> Vec<String> {
    let comparison = &outcome.comparison;
    let mut lines = Vec::new();
    for recording in comparison.training.iter().chain(&comparison.validation) {
        let warnings = recording.quality.warnings.iter();
        lines.extend(warnings.map(|warning| format!("{}: {warning}", recording.name)));
    }
    lines.extend(outcome.unknown_states());
    lines
}

/// On what the scores rest.
fn notes(outcome: &Outcome) -> Vec<String> {
    let note = "No recordings were given to score on. The last third of each recording was held out from the fits and \
                scored on: the same seal in the same session, so the errors on other recordings may be larger.";
    if outcome.held_out { vec![note.to_owned()] } else { Vec::new() }
}

fn sections(outcome: &Outcome) -> Vec<Section> {
    let comparison = &outcome.comparison;
    let shown = figures::shown(comparison);
    let mut errors = Section::new("Errors")
        .paragraph(
            "The phases are those of the EMS element: the seal deforms, the instrument slides, or the instrument is held (slower \
             than 1 mm/s).",
        )
        .table(figures::errors_by_phase(comparison));
    errors.tables.extend(figures::by_recording(comparison));
    let mut all = vec![
        Section::new("Summary")
            .paragraph(verdict(comparison))
            .paragraph(method(comparison))
            .table(figures::best_of_each(comparison)),
        Section::new("One reversal").drawn(figures::one_reversal(comparison, shown.as_ref())),
        Section::new("One cycle").drawn(figures::one_cycle(shown.as_ref())),
        claim(comparison).figure(figures::error_by_parameters(comparison)),
        errors,
        criteria(comparison),
        parameters(comparison),
    ];
    if let Some(table) = figures::warnings_by_model(comparison) {
        all.push(Section::new("Warnings of the fits").table(table));
    }
    all.push(Section::new("Recordings").table(sampling(recordings(comparison))));
    all
}

/// Which model is best, as a sentence.
fn verdict(comparison: &Comparison) -> String {
    let mut letters = comparison.verdict();
    letters.get_mut(..1).into_iter().for_each(str::make_ascii_uppercase);
    if letters.is_empty() { letters } else { letters + "." }
}

/// What is equal for all models, and what differs.
fn method(comparison: &Comparison) -> String {
    let refitted = if comparison.entries.iter().any(|entry| entry.name == "ems-output-error") {
        " \"EMS, output error\" is the EMS element refitted with the criterion of the classical models."
    } else {
        ""
    };
    format!(
        "Every model is run along the measured positions alone, at rest with the first reading at the start, and scored on the same \
         samples: those at which the state of the EMS element no longer depends on its unknown start. The classical models minimise \
         the squared error of that run over the training recordings. The EMS element is what the identification gives: one fit to all \
         motion, with the optional terms that it accepts.{refitted} Each model has its own sensor offset, which is not counted among its parameters."
    )
}

fn claim(comparison: &Comparison) -> Section {
    let section = Section::new("Error against number of parameters").paragraph(CLAIM);
    let claims = comparison.claims();
    if claims.is_empty() {
        return section.paragraph(
            "The EMS element or the banks were not compared, so the claim is not tested.",
        );
    }
    claims.iter().map(ReversalMatch::sentence).fold(section, Section::paragraph)
}

fn criteria(comparison: &Comparison) -> Section {
    let [aic, bic]: [fn(&Entry) -> f64; 2] = [|e| e.scores.aic, |e| e.scores.bic];
    let [aic, bic] =
        [aic, bic].map(|of| least_by(comparison, of).map_or_else(String::new, Entry::title));
    let section = Section::new("Criteria and cost")
        .paragraph(format!(
            "AIC = n·ln(mean squared error) + 2·k and BIC = n·ln(mean squared error) + k·ln n, on the training recordings; k counts the \
             parameters, the sensor offset and the variance of the error. Neighbouring errors are alike, so the {} samples are worth \
             n = {:.0} independent ones by the autocorrelation of the residuals of the EMS element as identified; n is one number \
             for all models. Less is better: {aic} has the least AIC, {bic} the least BIC.",
            comparison.samples, comparison.effective_samples
        ))
        .paragraph(
            "The criteria weigh how well a model fits against how many numbers it takes. They ignore how it does on other recordings, \
             that the error is structure which every model leaves rather than noise, whether the data determine the numbers counted, and \
             the cost of a step.",
        );
    let timed = comparison.entries.iter().any(|entry| entry.ns_per_sample.is_some());
    let times = if timed {
        "The time of a step is the median of seven runs over the first validation recording, on the machine that wrote this report, \
         like the time of the fit: the only numbers here that differ between two runs."
    } else {
        "No times were measured."
    };
    section.paragraph(times).table(figures::criteria(comparison))
}

fn parameters(comparison: &Comparison) -> Section {
    let section = Section::new("Parameters").paragraph(
        "With 95 % intervals from the jackknife over strokes. Of Leuven, Maxwell-Slip and GMS the models with up to four elements are \
         listed; the others, and the coefficients of the branches of the EMS element, are in compare.json.",
    );
    figures::parameters_by_family(comparison).into_iter().fold(section, Section::table)
}

fn recordings(comparison: &Comparison) -> impl Iterator<Item = (&Recording, &'static str)> {
    let training = comparison.training.iter().map(|r| (r, "training"));
    training.chain(comparison.validation.iter().map(|r| (r, "validation")))
}

fn provenance(outcome: &Outcome) -> Vec<(String, String)> {
    let mut all = vec![
        origin("Program", PROGRAM),
        origin("Seed", outcome.seed.to_string()),
        origin("EMS", PAPER),
    ];
    all.extend(hashes(recordings(&outcome.comparison)));
    all
}
