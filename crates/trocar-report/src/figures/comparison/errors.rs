//! Errors against the number of parameters.

use super::kind;
use crate::document::{Axis, Figure, Mark, Panel, Role, Series};
use trocar_lab::compare::{Comparison, Entry};

/// Models with the same number of parameters whose errors differ by less than this fraction are
/// drawn as one point with two names.
const COINCIDENT: f64 = 0.04;

/// Error of every model against its number of parameters, over the whole validation and after its
/// reversals.
pub(crate) fn error_by_parameters(comparison: &Comparison) -> Figure {
    let noise = comparison.validation.iter().map(|r| r.quality.force_noise).fold(0.0, f64::max);
    Figure::new("error-by-parameters", 0, "Error against number of parameters")
        .panel(panel(comparison, "all of the validation", |entry| entry.scores.validate_rms_n))
        .panel(panel(comparison, "after its reversals", |entry| entry.scores.reversal_rms_n))
        .caption(format!(
            "Root mean square of measured minus computed force on the validation recordings against the number of parameters (without \
             the sensor's offset, which all have): (a) over all samples whose state is known, (b) within {:.1} mm after each \
             reversal. Lines join the numbers of elements of one family. The dashed line is the error of the EMS element; the noise \
             of the sensor is {:.3} N. All axes are logarithmic.",
            1e3 * comparison.reversal_travel,
            noise
        ))
}

fn panel(comparison: &Comparison, title: &str, error: impl Fn(&Entry) -> f64) -> Panel {
    let axes = Panel::new(
        Axis::new("parameters", "").logarithmic(),
        Axis::new("rms error", "N").logarithmic(),
    );
    let mut panel = axes.title(title).aspect(0.45);
    let mut names = comparison.families();
    names.iter_mut().for_each(|own| own.sort_by_key(|entry| entry.elements));
    let (lines, singles): (Vec<_>, Vec<_>) =
        names.into_iter().partition(|own| own.len() > 1 && own[0].choice.is_bank());
    for own in lines {
        let x: Vec<f64> = own.iter().map(|entry| entry.parameters as f64).collect();
        let y: Vec<f64> = own.iter().map(|entry| error(entry)).collect();
        let (first, last) = (own[0].elements, own[own.len() - 1].elements);
        let name = format!("{}, {first} to {last} elements", own[0].choice.title());
        let role = Role::Friction(kind(own[0]), 0);
        panel = panel.curve(&name, role, &x, &y);
    }
    for same in coincident(singles.into_iter().flatten(), &error) {
        let label = joined(same.iter().map(|entry| entry.title()).collect());
        let role = Role::Friction(kind(same[0]), 0);
        let (x, y) = (vec![same[0].parameters as f64], vec![error(same[0])]);
        panel = panel.series(Series::labelled("", role, x, y, vec![label]));
    }
    match comparison.ems_entry() {
        Some(ems) => panel.mark(Mark::y(error(ems), "")),
        None => panel,
    }
}

/// Groups of entries that would be drawn on top of each other.
fn coincident<'a>(
    entries: impl Iterator<Item = &'a Entry>,
    error: impl Fn(&Entry) -> f64,
) -> Vec<Vec<&'a Entry>> {
    let mut groups: Vec<Vec<&Entry>> = Vec::new();
    for entry in entries {
        match groups.iter_mut().find(|own| {
            own[0].parameters == entry.parameters
                && (error(own[0]) / error(entry)).ln().abs() < COINCIDENT
        }) {
            Some(own) => own.push(entry),
            None => groups.push(vec![entry]),
        }
    }
    groups
}

/// "LuGre / rational": the common part of the names appears once.
fn joined(mut names: Vec<String>) -> String {
    names.sort_by_key(String::len);
    let first = names.first().map_or("", String::as_str);
    let rest = names.iter().skip(1).map(|name| {
        let own = name.strip_prefix(first).and_then(|own| own.strip_prefix(", "));
        format!(" / {}", own.unwrap_or(name))
    });
    first.to_owned() + &rest.collect::<String>()
}
