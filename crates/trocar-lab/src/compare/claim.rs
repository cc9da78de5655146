//! Test of the claim of EMS section II-C: about ten GMS elements with some thirty parameters
//! reproduce the reversal of one seal.

use serde::Serialize;

use super::Comparison;

/// Comparison of a family of banks with the EMS element at reversals.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ReversalMatch {
    /// The family.
    pub name: &'static str,
    /// Its name in texts.
    #[serde(skip)]
    pub title: &'static str,
    /// Error of the EMS element after reversals, N.
    pub ems_reversal_rms_n: f64,
    /// Parameters of the EMS element.
    pub ems_parameters: usize,
    /// Fewest elements that reach that error; `None` if none of the tested numbers does.
    pub elements: Option<usize>,
    /// Their number of parameters.
    pub parameters: Option<usize>,
    /// Whether a larger number of elements fails to reach that error again.
    pub lost_again: bool,
    /// Largest number of elements tried.
    pub most_elements: usize,
    /// Least error over the tested numbers of elements, N.
    pub best_reversal_rms_n: f64,
    /// The number of elements with this error.
    pub best_elements: usize,
}

/// Tests the claim for one family. `None` if the family or the EMS element was not compared, or the
/// validation contains no reversal.
///
/// The EMS element is that of [`Comparison::ems_entry`].
pub fn reversal_match(comparison: &Comparison, family: &'static str) -> Option<ReversalMatch> {
    let entries = &comparison.entries;
    let ems = comparison.ems_entry()?;
    let mut own: Vec<_> = entries.iter().filter(|e| e.name == family).collect();
    own.sort_by_key(|e| e.elements);
    let level = ems.scores.reversal_rms_n;
    if !level.is_finite() {
        return None;
    }
    let matched = own.iter().find(|e| e.scores.reversal_rms_n <= level);
    let lost_again = matched.is_some_and(|m| {
        own.iter().any(|e| e.elements > m.elements && e.scores.reversal_rms_n > level)
    });
    let best =
        own.iter().min_by(|a, b| a.scores.reversal_rms_n.total_cmp(&b.scores.reversal_rms_n))?;
    Some(ReversalMatch {
        name: family,
        title: own.last()?.choice.title(),
        ems_reversal_rms_n: level,
        ems_parameters: ems.parameters,
        elements: matched.map(|e| e.elements),
        parameters: matched.map(|e| e.parameters),
        lost_again,
        most_elements: own.last()?.elements,
        best_reversal_rms_n: best.scores.reversal_rms_n,
        best_elements: best.elements,
    })
}

impl ReversalMatch {
    /// The result as a sentence.
    pub fn sentence(&self) -> String {
        let ems = format!(
            "the EMS element ({:.3} N rms after reversals, {} parameters)",
            self.ems_reversal_rms_n, self.ems_parameters
        );
        match (self.elements, self.parameters) {
            (Some(elements), Some(parameters)) => {
                let again =
                    if self.lost_again { "; some larger numbers of elements do not" } else { "" };
                let plural = if elements == 1 { "" } else { "s" };
                format!(
                    "{} matches {ems} with {elements} element{plural} and {parameters} parameters{again}.",
                    self.title
                )
            }
            _ => format!(
                "{} does not match {ems} with up to {} elements; its best is {:.3} N with {}.",
                self.title, self.most_elements, self.best_reversal_rms_n, self.best_elements
            ),
        }
    }
}
