//! Tables of a comparison.

use crate::document::{Cell, Column, Table};
use crate::figures::tables::{cells_of, name_of, subject_in_words};
use trocar_identify::{Subject, Warning};
use trocar_lab::compare::{Comparison, Entry, best_of};
use trocar_lab::validate::PhaseError;

/// The parameters of banks with more elements than this are only in the JSON.
const MOST_ELEMENTS: usize = 4;

/// A number without decimals.
fn whole(value: f64) -> Cell {
    let value = value.round();
    Cell::number(value, format!("{}", value.abs()).len())
}

/// The best model of each family.
pub(crate) fn best_of_each(comparison: &Comparison) -> Table {
    let caption = "Each family's fewest elements within 1 % of its least validation error (root mean squares)";
    let best = comparison.families().into_iter().map(|own| best_of(&own));
    Table::of(
        caption,
        best,
        &[
            ("Model", &|entry| entry.title().into()),
            ("Parameters", &|entry| whole(entry.parameters as f64)),
            ("Validation (N)", &|entry| Cell::number(entry.scores.validate_rms_n, 3)),
            ("Fit (%)", &|entry| Cell::number(entry.scores.fit_percent, 3)),
            ("After reversals (N)", &|entry| Cell::number(entry.scores.reversal_rms_n, 3)),
            ("Worst reversal (N)", &|entry| Cell::number(entry.scores.worst_reversal_n, 3)),
        ],
    )
}

/// The best model of each family on each validation recording; `None` where there is only one
/// recording.
pub(crate) fn by_recording(comparison: &Comparison) -> Option<Table> {
    let names: Vec<&str> = comparison.validation.iter().map(|r| r.name.as_str()).collect();
    let columns = std::iter::once("Model").chain(names.iter().copied());
    let empty = Table::new("The models of the summary by validation recording (rms in N)", columns);
    (names.len() > 1).then(|| {
        comparison.families().into_iter().fold(empty, |table, own| {
            let best = best_of(&own);
            let errors = best.scores.by_recording_n.iter().map(|rms| Cell::number(*rms, 3));
            table.row(std::iter::once(best.title().into()).chain(errors))
        })
    })
}

/// Every model: errors over the whole validation and by phase.
pub(crate) fn errors_by_phase(comparison: &Comparison) -> Table {
    let caption = "Root mean square errors in N: training, validation, and the validation by phase of the motion";
    Table::of(
        caption,
        &comparison.entries,
        &[
            ("Model", &|entry| entry.title().into()),
            ("Parameters", &|entry| whole(entry.parameters as f64)),
            ("Training", &|entry| Cell::number(entry.scores.train_rms_n, 3)),
            ("Validation", &|entry| Cell::number(entry.scores.validate_rms_n, 3)),
            ("Fit (%)", &|entry| Cell::number(entry.scores.fit_percent, 3)),
            ("Deformation", &|entry| error_in(&entry.scores.by_phase.deformation)),
            ("Sliding", &|entry| error_in(&entry.scores.by_phase.sliding)),
            ("Hold", &|entry| error_in(&entry.scores.by_phase.hold)),
        ],
    )
}

fn error_in(phase: &PhaseError) -> Cell {
    Cell::number(if phase.samples > 0 { phase.rms_n } else { f64::NAN }, 3)
}

/// Every model: reversals, criteria and cost.
pub(crate) fn criteria(comparison: &Comparison) -> Table {
    Table::of(
        "Errors after reversals, criteria and cost",
        &comparison.entries,
        &[
            ("Model", &|entry| entry.title().into()),
            ("Reversals (N)", &|entry| Cell::number(entry.scores.reversal_rms_n, 3)),
            ("Worst (N)", &|entry| Cell::number(entry.scores.worst_reversal_n, 3)),
            ("AIC", &|entry| whole(entry.scores.aic)),
            ("BIC", &|entry| whole(entry.scores.bic)),
            ("Step (ns)", &|entry| Cell::number(entry.ns_per_sample.unwrap_or(f64::NAN), 3)),
            ("Fit (s)", &|entry| Cell::number(entry.fit_s.unwrap_or(f64::NAN), 3)),
            ("Warnings", &|entry| whole(entry.warnings.len() as f64)),
        ],
    )
}

/// Parameters with intervals, one table per family; of banks those with up to four elements.
pub(crate) fn parameters_by_family(comparison: &Comparison) -> Vec<Table> {
    comparison.families().into_iter().filter_map(of_family).collect()
}

fn of_family(mut own: Vec<&Entry>) -> Option<Table> {
    own.sort_by_key(|entry| entry.elements);
    own.retain(|entry| !entry.choice.is_bank() || entry.elements <= MOST_ELEMENTS);
    let caption = own.first()?.choice.title();
    let main = own.iter().flat_map(|entry| {
        let estimates = entry.estimates.iter().filter(|p| !p.is_coefficient());
        estimates.map(|p| (entry.title(), p.id, cells_of(&p.estimate, p.id.unit().scale)))
    });
    Some(Table::of(
        caption,
        main,
        &[
            ("Model", &|(title, ..)| title.as_str().into()),
            ("Parameter", &|(_, id, _)| name_of(*id).into()),
            ("Symbol", &|(_, id, _)| id.symbol().to_string().into()),
            ("Value", &|(_, _, [value, _])| value.clone()),
            ("95 % interval", &|(_, _, [_, interval])| interval.clone()),
            ("Unit", &|(_, id, _)| id.unit().shown.into()),
        ],
    ))
}

/// Warnings about each fit; undetermined parameters are given by their symbols. `None` without
/// warnings.
pub(crate) fn warnings_by_model(comparison: &Comparison) -> Option<Table> {
    let doubted: Vec<&Entry> =
        comparison.entries.iter().filter(|entry| !entry.warnings.is_empty()).collect();
    let columns: [Column<'_, &Entry>; 2] =
        [("Model", &|entry| entry.title().into()), ("Warnings", &|entry| warnings(entry).into())];
    (!doubted.is_empty()).then(|| Table::of("Warnings by model", doubted, &columns))
}

fn warnings(entry: &Entry) -> String {
    let (undetermined, others): (Vec<&Warning>, Vec<&Warning>) =
        entry.warnings.iter().partition(|w| w.undetermined);
    let mut words: Vec<String> =
        others.iter().map(|w| format!("{}: {}", subject_in_words(&w.subject), w.message)).collect();
    let symbols: Vec<String> = undetermined.iter().map(|w| symbol_or_words(&w.subject)).collect();
    if !symbols.is_empty() {
        words.push(format!("not determined: {}", symbols.join(", ")));
    }
    words.join("; ")
}

fn symbol_or_words(subject: &Subject) -> String {
    match subject {
        Subject::Parameter(id) => id.symbol().to_string(),
        other => subject_in_words(other),
    }
}
