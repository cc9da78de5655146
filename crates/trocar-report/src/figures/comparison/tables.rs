//! Tables of a comparison.

use crate::document::{Cell, Table};
use crate::figures::tables::{cells_of, name_of, subject_in_words};
use trocar_identify::validate::PhaseError;
use trocar_identify::{Subject, Warning};
use trocar_lab::compare::{Comparison, Entry, best_of};
use trocar_model::Unit;

/// The parameters of banks with more elements than this are only in the JSON.
const MOST_ELEMENTS: usize = 4;

fn number(value: f64, digits: usize) -> Cell {
    Cell::Number { value, digits }
}

/// A number without decimals.
fn whole(value: f64) -> Cell {
    let value = value.round();
    number(value, format!("{}", value.abs()).len())
}

fn head(entry: &Entry) -> [Cell; 2] {
    [Cell::Text(entry.title()), whole(entry.parameters as f64)]
}

fn table(caption: &str, columns: &[&str], rows: impl Iterator<Item = Vec<Cell>>) -> Table {
    rows.fold(Table::new(caption, columns.iter().copied()), Table::row)
}

/// The best model of each family.
pub(in super::super::super) fn best_of_each(comparison: &Comparison) -> Table {
    let columns = [
        "Model",
        "Parameters",
        "Validation (N)",
        "Fit (%)",
        "After reversals (N)",
        "Worst reversal (N)",
    ];
    let row = |own: Vec<&Entry>| {
        let s = &best_of(&own).scores;
        let scores = [s.validate_rms_n, s.fit_percent, s.reversal_rms_n, s.worst_reversal_n];
        head(best_of(&own)).into_iter().chain(scores.map(|value| number(value, 3))).collect()
    };
    let caption = "Each family's fewest elements within 1 % of its least validation error (root mean squares)";
    table(caption, &columns, comparison.families().into_iter().map(row))
}

/// The best model of each family on each validation recording; `None` where there is only one
/// recording.
pub(in super::super::super) fn by_recording(comparison: &Comparison) -> Option<Table> {
    let names: Vec<&str> = comparison.validation.iter().map(|r| r.name.as_str()).collect();
    let columns: Vec<&str> = std::iter::once("Model").chain(names.iter().copied()).collect();
    let row = |own: Vec<&Entry>| {
        let errors = best_of(&own).scores.by_recording_n.iter().map(|rms| number(*rms, 3));
        std::iter::once(Cell::Text(best_of(&own).title())).chain(errors).collect()
    };
    let rows = comparison.families().into_iter().map(row);
    (names.len() > 1).then(|| {
        table("The models of the summary by validation recording (rms in N)", &columns, rows)
    })
}

/// Every model: errors over the whole validation and by phase.
pub(in super::super::super) fn errors_by_phase(comparison: &Comparison) -> Table {
    let columns = [
        "Model",
        "Parameters",
        "Training",
        "Validation",
        "Fit (%)",
        "Deformation",
        "Sliding",
        "Hold",
    ];
    let phase = |part: &PhaseError| number(if part.samples > 0 { part.rms_n } else { f64::NAN }, 3);
    let row = |entry: &Entry| {
        let s = &entry.scores;
        let over_all =
            [s.train_rms_n, s.validate_rms_n, s.fit_percent].map(|value| number(value, 3));
        let by_phase = [&s.by_phase.deformation, &s.by_phase.sliding, &s.by_phase.hold].map(phase);
        head(entry).into_iter().chain(over_all).chain(by_phase).collect()
    };
    let caption = "Root mean square errors in N: training, validation, and the validation by phase of the motion";
    table(caption, &columns, comparison.entries.iter().map(row))
}

/// Every model: reversals, criteria and cost.
pub(in super::super::super) fn criteria(comparison: &Comparison) -> Table {
    let columns =
        ["Model", "Reversals (N)", "Worst (N)", "AIC", "BIC", "Step (ns)", "Fit (s)", "Warnings"];
    let row = |entry: &Entry| {
        let s = &entry.scores;
        let time = |value: Option<f64>| number(value.unwrap_or(f64::NAN), 3);
        let cells = [
            number(s.reversal_rms_n, 3),
            number(s.worst_reversal_n, 3),
            whole(s.aic),
            whole(s.bic),
            time(entry.ns_per_sample),
            time(entry.fit_s),
            whole(entry.warnings.len() as f64),
        ];
        std::iter::once(Cell::Text(entry.title())).chain(cells).collect()
    };
    table("Errors after reversals, criteria and cost", &columns, comparison.entries.iter().map(row))
}

/// Parameters with intervals, one table per family; of banks those with up to four elements.
pub(in super::super::super) fn parameters_by_family(comparison: &Comparison) -> Vec<Table> {
    let columns = ["Model", "Parameter", "Symbol", "Value", "95 % interval", "Unit"];
    let family = |mut own: Vec<&Entry>| {
        own.sort_by_key(|entry| entry.elements);
        own.retain(|entry| !entry.choice.is_bank() || entry.elements <= MOST_ELEMENTS);
        let caption = own.first()?.choice.title();
        Some(table(caption, &columns, own.into_iter().flat_map(parameters)))
    };
    comparison.families().into_iter().filter_map(family).collect()
}

fn parameters(entry: &Entry) -> impl Iterator<Item = Vec<Cell>> {
    entry.estimates.iter().filter(|p| !p.is_coefficient()).map(|p| {
        let Unit { scale, shown, .. } = p.id.unit();
        let [value, interval] = cells_of(&p.estimate, scale);
        let [words, symbol] = [name_of(p.id), p.id.symbol().to_string()].map(Cell::Text);
        vec![Cell::Text(entry.title()), words, symbol, value, interval, Cell::from(shown)]
    })
}

/// Warnings about each fit; undetermined parameters are given by their symbols. `None` without
/// warnings.
pub(in super::super::super) fn warnings_by_model(comparison: &Comparison) -> Option<Table> {
    let row = |entry: &Entry| {
        let (undetermined, others): (Vec<&Warning>, Vec<&Warning>) =
            entry.warnings.iter().partition(|w| w.undetermined);
        let symbols: Vec<String> =
            undetermined.iter().map(|w| symbol_or_words(&w.subject)).collect();
        let undetermined =
            (!symbols.is_empty()).then(|| format!("not determined: {}", symbols.join(", ")));
        let others =
            others.iter().map(|w| format!("{}: {}", subject_in_words(&w.subject), w.message));
        vec![
            Cell::Text(entry.title()),
            Cell::Text(others.chain(undetermined).collect::<Vec<_>>().join("; ")),
        ]
    };
    let mut doubted =
        comparison.entries.iter().filter(|entry| !entry.warnings.is_empty()).peekable();
    doubted.peek()?;
    Some(table("Warnings by model", &["Model", "Warnings"], doubted.map(row)))
}

fn symbol_or_words(subject: &Subject) -> String {
    match subject {
        Subject::Parameter(id) => id.symbol().to_string(),
        other => subject_in_words(other),
    }
}
