//! Checks whether the statements of an identification about a parameter are true.

use std::time::Instant;

use serde::Serialize;
use trocar::identify::{Estimate, IdentifyOptions, Term, identify};

use super::kinds::{AnyError, Bench, Range};

/// Verdict on an estimate, given the true value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Verdict {
    /// Determined by the data, and the interval contains the true value.
    Right,
    /// Determined by the data, the interval misses the true value, and no warning declares the
    /// result doubtful.
    ConfidentlyWrong,
    /// The interval misses the true value, but a warning declares the result doubtful.
    WrongButDoubtful,
    /// Stated not to be determined by the data.
    Undetermined,
    /// Not listed, although the seal has it.
    Absent,
}

impl Verdict {
    pub(crate) const ALL: [Self; 5] = [
        Self::Right,
        Self::ConfidentlyWrong,
        Self::WrongButDoubtful,
        Self::Undetermined,
        Self::Absent,
    ];

    /// The verdict on a listed estimate. The interval is right if it overlaps the range of the true
    /// value.
    pub(crate) fn of(estimate: &Estimate, truth: Range, doubtful: bool) -> Self {
        let [low, high] = estimate.ci95;
        match estimate {
            e if !e.determined || !e.half_width().is_finite() => Self::Undetermined,
            _ if low <= truth[1] && truth[0] <= high => Self::Right,
            _ if doubtful => Self::WrongButDoubtful,
            _ => Self::ConfidentlyWrong,
        }
    }
}

/// A parameter of one identification.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Judged {
    pub(crate) parameter: String,
    pub(crate) truth: Range,
    /// `None` if the parameter is not listed.
    pub(crate) value: Option<f64>,
    pub(crate) ci95: Option<[f64; 2]>,
    pub(crate) verdict: Verdict,
}

/// One identification.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Outcome {
    pub(crate) kind: &'static str,
    pub(crate) seed: u64,
    pub(crate) seconds: f64,
    /// The reason if there is no result.
    pub(crate) refused: Option<String>,
    /// Compensated position delay, s; 0 for none.
    pub(crate) delay_s: f64,
    /// Optional model terms of the seal or the rig, and those that the fit selected.
    pub(crate) true_terms: Vec<Term>,
    pub(crate) found_terms: Vec<Term>,
    /// Subjects and messages of the doubtful warnings.
    pub(crate) doubts: Vec<String>,
    pub(crate) judged: Vec<Judged>,
}

impl Outcome {
    pub(crate) fn count(&self, verdict: Verdict) -> usize {
        self.judged.iter().filter(|j| j.verdict == verdict).count()
    }
}

/// Identifies from the recordings of `bench` and judges every parameter with a known true value.
///
/// # Errors
/// The bench cannot be run. A rejected identification is a valid outcome.
pub(crate) fn judge(kind: &'static str, bench: &Bench, seed: u64) -> Result<Outcome, AnyError> {
    // Each kind has its own noise; otherwise one unusual draw would affect all of them.
    let noise = kind.bytes().fold(seed, |sum, byte| 31 * (sum % 1_000_000_007) + u64::from(byte));
    let recordings = bench.recordings(noise)?;
    let truths = bench.truths();
    let options = IdentifyOptions {
        inertia_removed: bench.mass_declared,
        shaft_radius: bench.shaft_radius(),
        ..IdentifyOptions::default()
    };
    let begin = Instant::now();
    let found = identify(&recordings, &options, &|_, _| {});
    let mut outcome = Outcome {
        kind,
        seed,
        seconds: begin.elapsed().as_secs_f64(),
        refused: None,
        delay_s: 0.0,
        true_terms: bench.terms(),
        found_terms: Vec::new(),
        doubts: Vec::new(),
        judged: Vec::new(),
    };
    let found = match found {
        Ok(found) => found,
        Err(error) => {
            outcome.refused = Some(error.to_string());
            return Ok(outcome);
        }
    };
    let kept = found.fit.iter().flat_map(|fit| &fit.terms).filter(|t| t.kept);
    outcome.found_terms = kept.map(|t| t.term).collect();
    outcome.delay_s = found.position_delay.map_or(0.0, |lag| lag.delay_s);
    let doubts = found.warnings.iter().filter(|w| w.doubtful);
    outcome.doubts = doubts.map(|w| format!("{}: {}", w.subject, w.message)).collect();
    let listed = found.parameters.iter().filter_map(|p| {
        let truth = *truths.get(p.id.to_string().as_str())?;
        let verdict = Verdict::of(&p.estimate, truth, found.is_doubtful());
        let (value, ci95) = (Some(p.estimate.value), Some(p.estimate.ci95));
        Some(Judged { parameter: p.id.to_string(), truth, value, ci95, verdict })
    });
    let absent = truths.iter().filter(|(name, _)| found.parameter(name).is_none()).filter_map(
        |(name, truth)| {
            let verdict = unlisted(name, *truth, &truths)?;
            Some(Judged {
                parameter: (*name).to_owned(),
                truth: *truth,
                value: None,
                ci95: None,
                verdict,
            })
        },
    );
    outcome.judged = listed.chain(absent).collect();
    Ok(outcome)
}

/// A parameter that is not listed. This is right for a mass that does not exist; `None` for other
/// model terms that the seal does not have either, and for parameters that are listed only if the
/// fit uses them.
fn unlisted(
    name: &str,
    truth: Range,
    truths: &std::collections::BTreeMap<&str, Range>,
) -> Option<Verdict> {
    let by_need = name.starts_with("insertion_")
        || name.starts_with("withdrawal_")
        || name == "yield_stiffness_n_m";
    match name {
        "unmodelled_mass_kg" if truth == [0.0; 2] => Some(Verdict::Right),
        "static_force_n" if truth == truths["coulomb_force_n"] => None,
        _ if by_need || name.contains("join") || truth == [0.0; 2] => None,
        _ => Some(Verdict::Absent),
    }
}
