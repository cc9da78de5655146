//! Motion of any kind: minor loops, holds, tremor, slow sliding. All numbers of the element at once against the whole
//! force, with the ingredients that the recordings ask for.
//!
//! The paper's two steps need full strokes at constant speed. What a hand does tells more: how the force decays when the
//! instrument rests, what a partial reversal costs, how friction rises near rest. Each *ingredient* beyond (or within) the
//! paper's element is kept only if readings that the fit has not seen are predicted better with it:
//!
//! ```text
//! all ingredients -> free-run fit -> without each in turn -> held-out error -> those that earn their keep -> fit, intervals
//! ```
//!
//! The held-out error is that of every fourth cluster of cycles, predicted from the others to first order about the fit
//! (four times, so that each is held out once).
use serde::Serialize;

use super::candidate::{Candidate, EmsTrial, Layout};
use super::classical::{ASSUMED_WIDTH, plain_training};
use super::conclude::acceleration_is_resolved;
use super::output_error::{self, Fitted};
use super::refit::straight;
use super::{Identification, IdentifyOptions, Parameter, Progress, Segments, Warning, acceleration, along};
use crate::recording::Recording;
use crate::segment::Pass;

pub use choose::{IngredientTrial, MotionFit};
pub use ingredient::Ingredient;

mod choose;
mod ingredient;
mod numbers;

/// Half widths to start from where the two steps resolved none, in units of that assumed.
const WIDTHS: [f64; 5] = [0.1, 0.25, 0.5, 1.0, 2.0];

/// The identification with its element fitted to all motion, if that predicts better.
///
/// `found` is what the two steps and their refinement gave; it stays where there is nothing to learn from, where no fit
/// comes to a model, or where held-out readings are predicted no better.
pub(super) fn extend(
    mut found: Identification,
    recordings: &[Recording],
    segments: &[Segments],
    options: &IdentifyOptions,
    progress: Progress,
) -> Identification {
    let motion = FreeMotion::of(recordings, segments, found.model.half_width);
    found.free_motion = Some(motion);
    // Strokes that repeat are left to the two steps: they tell of nothing else.
    let unresolved = found.refinement.is_none() && (!options.inertia_removed || found.steady.means.is_empty());
    let free = unresolved && motion.reversals >= FEWEST_REVERSALS && !along::repeats(recordings);
    let asked_for = motion.is_enough() || free;
    if !(options.free_motion && options.refine && asked_for) {
        return found;
    }
    progress("fitting all motion", 0.5);
    let Some((choose::Chosen { fitted, summary }, two_steps_n)) = fitted(&found, recordings, segments, options) else {
        return found;
    };
    let Ok(stages) = fitted.best.candidate.stages() else { return found };
    let residual_rms = super::conclude::residual_rms(recordings, &fitted.best.candidate, &stages);
    if summary.held_out_chosen_n >= two_steps_n {
        let message = format!(
            "refused: held-out cycles are predicted to {:.4} N, and the two steps leave {two_steps_n:.4} N of the same readings",
            summary.held_out_chosen_n
        );
        found.warnings.push(Warning { subject: "fit to all motion".to_owned(), message, doubtful: false });
        return found;
    }
    let mut parameters = numbers::parameters(&fitted);
    let of_steady_line = |p: &&Parameter| p.name.ends_with("_positive") || p.name.ends_with("_negative");
    let steady_lines = found.parameters.iter().filter(|p| of_steady_line(p) && p.estimate.pinned);
    let known: Vec<Parameter> =
        steady_lines.filter(|p| !parameters.iter().any(|q| q.name == p.name)).cloned().collect();
    parameters.extend(known);
    let replaced = |w: &Warning| w.subject == "refinement" || fitted_anew(&w.subject, &parameters);
    found.warnings.retain(|w| !replaced(w));
    if !fitted.best.layout.yielding {
        let message =
            "the minor-loop stiffness is the default (1.01 times the steepest change of the gap between the branches)";
        found.warnings.push(Warning {
            subject: "yield_stiffness_n_m".to_owned(),
            message: message.to_owned(),
            doubtful: false,
        });
    }
    found.warnings.extend(warnings(&fitted, &parameters, &summary));
    found.free_motion = Some(FreeMotion::of(recordings, segments, fitted.best.candidate.half_width));
    found.free_parameters = fitted.best.free_numbers() - 1 - usize::from(fitted.best.layout.hidden_mass);
    found.residual_rms = residual_rms;
    found.model = fitted.best.candidate;
    found.stages = stages;
    found.parameters = parameters;
    found.motion = Some(summary);
    found
}

/// The paper's element fitted from every start, and from the best of them on with the ingredients; and the error, N, that
/// the two steps leave of the same readings.
fn fitted(
    found: &Identification,
    recordings: &[Recording],
    segments: &[Segments],
    options: &IdentifyOptions,
) -> Option<(choose::Chosen, f64)> {
    let mut without = options.without.clone();
    if !(options.estimate_hidden_mass && acceleration_is_resolved(recordings)) {
        without.push(Ingredient::HiddenMass);
    }
    let training = |of: &Candidate| {
        let stages = of.stages().ok()?;
        Some(plain_training(recordings, found, options, (of.half_width, stages.elements()), acceleration))
    };
    let starts = starts(found, recordings, options);
    // The widest start forgets last.
    let widest = starts.iter().map(|t| &t.candidate).max_by(|a, b| a.half_width.total_cmp(&b.half_width))?;
    let best = choose::best_of(&training(widest)?, &starts)?;
    if !FreeMotion::of(recordings, segments, best.candidate.half_width).is_enough() {
        without.extend(Ingredient::OF_FREE_MOTION);
    }
    let training = training(&best.candidate)?;
    let chosen = choose::choose(&training, &best, &without)?;
    let two_steps = EmsTrial { candidate: found.model.clone(), layout: best.layout };
    let squares = output_error::cost(&training, &two_steps, |_| true);
    let two_steps_n = (squares / chosen.fitted.weight()).sqrt();
    Some((chosen, two_steps_n))
}

/// The element of the two steps; where they resolved no deformation, straight ones of several widths.
fn starts(found: &Identification, recordings: &[Recording], options: &IdentifyOptions) -> Vec<EmsTrial> {
    let layout = Layout {
        symmetric: found.model.insertion == found.model.withdrawal,
        viscous: true,
        stribeck: found.steady.stribeck.is_some(),
        damping: found.model.seal_damping > 0.0,
        hidden_mass: found.model.hidden_mass > 0.0,
        yielding: false,
        creep: false,
        lag: false,
        arms: 0,
        second: false,
    };
    let trial = |candidate| EmsTrial { candidate, layout };
    let mut all = Vec::new();
    if found.deformation.is_ok() {
        all.push(trial(found.model.clone()));
    }
    if found.deformation.is_err() {
        let stroke = recordings.iter().map(|r| r.quality.stroke).fold(0.0, f64::max);
        let width = |part: &f64| straight(&found.model, part * ASSUMED_WIDTH * stroke, options.degrees);
        all.extend(WIDTHS.iter().map(|part| trial(width(part))));
    }
    all
}

/// Whether what a warning is about was fitted anew, and judged anew.
fn fitted_anew(subject: &str, parameters: &[Parameter]) -> bool {
    let steady_line = subject.ends_with("_positive") || subject.ends_with("_negative");
    subject == "yield_stiffness_n_m" || steady_line || parameters.iter().any(|p| p.name == subject)
}

fn warnings(fitted: &Fitted<EmsTrial>, parameters: &[Parameter], summary: &MotionFit) -> Vec<Warning> {
    let main: Vec<Parameter> = parameters.iter().filter(|p| !p.name.contains("theta")).cloned().collect();
    let mut all = super::classical::doubts(fitted, &main);
    for left_out in summary.ingredients.iter().filter(|i| !i.kept) {
        let message = format!(
            "left out: held-out cycles are predicted no better with it ({:.4} N with it, {:.4} N without)",
            left_out.held_out_with_n, left_out.held_out_without_n
        );
        all.push(Warning { subject: left_out.ingredient.words().to_owned(), message, doubtful: false });
    }
    all
}

/// Holds and partial reversals in the recordings: what the fit to all motion lives on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FreeMotion {
    /// Reversals.
    pub reversals: usize,
    /// Passes that end before the seal has turned over: shorter than 2c.
    pub partial_reversals: usize,
    /// Time at rest or trembling, s: a tenth of a second or more within a tenth of c.
    pub held_s: f64,
}

/// Fewest partial reversals, and shortest rest, s, that ask for the fit to all motion.
const FEWEST_PARTIAL: usize = 8;
const SHORTEST_REST: f64 = 1.0;
/// Fewest reversals that ask for it where the two steps resolved no deformation.
const FEWEST_REVERSALS: usize = 8;

impl FreeMotion {
    pub(super) fn of(recordings: &[Recording], segments: &[Segments], half_width: f64) -> Self {
        let mut all = Self { reversals: 0, partial_reversals: 0, held_s: 0.0 };
        for (recording, segments) in recordings.iter().zip(segments) {
            let x = &recording.position;
            // From one reversal to the next, without a gap.
            let partial = |pair: &&[Pass]| {
                let (pass, next) = (&pair[0], &pair[1]);
                let whole = pass.starts_at_reversal && next.starts_at_reversal && next.start == pass.end;
                whole && (x[pass.end] - x[pass.start]).abs() < 2.0 * half_width
            };
            all.partial_reversals += segments.passes.windows(2).filter(partial).count();
            all.reversals += segments.passes.iter().filter(|p| p.starts_at_reversal).count();
            all.held_s += held(recording, 0.1 * half_width);
        }
        all
    }

    /// Whether there is enough to learn minor loops, creep and relaxation from.
    pub fn is_enough(&self) -> bool {
        self.partial_reversals >= FEWEST_PARTIAL && self.held_s >= SHORTEST_REST
    }
}

/// Time, s, that `recording` spends in rests: a tenth of a second or more within `reach`, m.
fn held(recording: &Recording, reach: f64) -> f64 {
    const SHORTEST: f64 = 0.1;
    let (x, t) = (&recording.position, &recording.time);
    let mut total = 0.0;
    for range in recording.unbroken() {
        let mut from = range.start;
        while from + 1 < range.end {
            let until = (from + 1..range.end).find(|i| (x[*i] - x[from]).abs() > reach).unwrap_or(range.end) - 1;
            let rest = t[until] - t[from];
            total += if rest >= SHORTEST { rest } else { 0.0 };
            from = if rest >= SHORTEST { until + 1 } else { from + 1 };
        }
    }
    total
}
