//! The fit: optional model terms, friction scale of each stroke, and a part with small reversals
//! and rests.

use std::ops::Range;

use super::tables::capitalised;
use super::{Drawn, MM, Scored, excerpt_starts, has_stages, line, over_time};
use trocar_model::Trocar;

use crate::document::{Axis, Cell, Figure, Mark, Panel, Role, Series, Table};
use crate::number::significant;
use trocar_identify::{FitSummary, Identification};
use trocar_lab::validate::Validated;
use trocar_recording::Recording;
use trocar_simulate::replay::{Replay, replay};
use trocar_simulate::segment::{reversal_threshold, strokes};

/// Length of the shown part of a recording, s.
const SHOWN: f64 = 5.0;
/// Step of the search for the part, s.
const STEP: f64 = 0.25;
/// A rest lasts at least this long, s, and stays within this fraction of c.
const SHORTEST_REST: f64 = 0.1;
const RESTING: f64 = 0.1;

/// Summary of the fit: terms, data and result.
pub(crate) fn in_words(found: &Identification, fit: &FitSummary) -> Vec<String> {
    let free = &found.free_motion;
    let rest = if fit.converged { "" } else { " The last fit did not converge." };
    let stages = if has_stages(found) {
        " The model has two elements in parallel: c, the joins and the minor-loop stiffness are those of the first; forces and \
         damping are those of both together."
    } else {
        ""
    };
    vec![
        format!(
            "The parameters were estimated jointly by free-run simulation from measured positions, over {} reversals, {} \
             of them partial (shorter than 2c), and {} s at rest. Each stroke has its own friction scale, so that scatter and drift between \
             strokes do not bias the viscosity or another parameter of the seal. An optional term is accepted \
             where its p value is below 1 % over all terms tried.",
            free.reversals,
            free.partial_reversals,
            significant(free.held_s, 3)
        ),
        format!(
            "The root mean square error, friction scales removed, is {} N for the paper's element and {} N for the model.{rest}{stages}",
            significant(fit.paper_rms_n, 3),
            significant(fit.rms_n, 3)
        ),
    ]
}

/// Each optional model term with its p value.
pub(crate) fn terms(fit: &FitSummary) -> Table {
    let caption = "Optional terms: p value of each beside the others, and the part of the squared error that it takes away (in the \
                   model: against a fit without it; not in the model: to first order)";
    Table::of(
        caption,
        &fit.terms,
        &[
            ("Term", &|trial| capitalised(trial.term.words()).into()),
            ("p value", &|trial| Cell::number(trial.p_value, 2)),
            ("Squared error less by (%)", &|trial| Cell::number(1e2 * trial.gain, 2)),
            ("In the model", &|trial| if trial.kept { "yes" } else { "no" }.into()),
        ],
    )
}

/// Friction of each stroke relative to that of the model, over the time of the consecutive
/// recordings.
pub(crate) fn friction_scale(found: &Identification, recordings: &[Recording]) -> Drawn {
    let scale = &found.friction_scale;
    if scale.strokes.len() < 2 {
        return Err("There is no figure of the friction scale: fewer than two strokes.".to_owned());
    }
    let mut panel = Panel::new(
        Axis::new("time, recordings one after the other", "s"),
        Axis::new("friction over the model's", "1"),
    );
    let mut from = 0.0;
    for (index, recording) in recordings.iter().enumerate() {
        let own = scale.strokes.iter().filter(|s| s.recording == index);
        let role = [Role::Measured, Role::Model, Role::Alternative][index % 3];
        let (x, y) = own.map(|s| (from + s.time_s, s.scale)).unzip();
        panel = panel.series(Series::points(recording.name.as_str(), role, x, y));
        from += recording.duration();
    }
    for jump in &scale.jumps {
        let before: f64 = recordings[..jump.recording].iter().map(Recording::duration).sum();
        panel = panel.mark(Mark::x(before + jump.time_s, "jump"));
    }
    let caption = format!(
        "Friction of each stroke over that of the model. Neighbouring strokes scatter by {} %; the slow drift spans {} %.",
        significant(1e2 * scale.scatter, 2),
        significant(1e2 * scale.drift, 2)
    );
    Ok(Figure::new("friction-scale", 0, "How friction changed")
        .panel(panel.aspect(0.35))
        .caption(&caption))
}

/// A part of a recording that the figure may show.
struct MotionWindow<'a> {
    recording: &'a Recording,
    run: &'a Replay,
    samples: Range<usize>,
    /// Number of partial reversals in it.
    partial: usize,
    /// Total rest in it, s.
    held: f64,
    seen: bool,
}

impl MotionWindow<'_> {
    fn density(&self) -> f64 {
        self.partial as f64 + self.held
    }
}

/// Measured force, force of the model and force of the paper's two steps in the part with the most
/// rests and small reversals.
pub(crate) fn small_motion(found: &Identification, own: &Validated, scored: &Scored) -> Drawn {
    let fresh = || densest(found, (scored.recordings, scored.runs), false);
    let shown = scored
        .held_out
        .then(fresh)
        .flatten()
        .or_else(|| densest(found, (&own.recordings, &own.runs), true))
        .ok_or("There is no figure of rests and small reversals: no recording holds both.")?;
    let MotionWindow { recording, run, ref samples, .. } = shown;
    let offset = found.model.offset;
    let measured: Vec<f64> = recording.force[samples.clone()].iter().map(|f| f - offset).collect();
    let model = run.force[samples.clone()].to_vec();
    let paper = paper_run(found, recording).map(|force| force[samples.clone()].to_vec());
    let origin = recording.time[samples.start];
    let time: Vec<f64> = recording.time[samples.clone()].iter().map(|t| t - origin).collect();
    let millimetres = recording.position[samples.clone()].iter().map(|x| MM * x);
    let position = over_time(Axis::new("position", "mm"))
        .series(line("position", Role::Measured, &time, millimetres))
        .aspect(0.16);
    let mut force = over_time(Axis::new("force", "N")).series(line(
        super::measured(recording),
        Role::Measured,
        &time,
        measured.iter().copied(),
    ));
    let mut error = over_time(Axis::new("error", "N"));
    let runs =
        [(TWO_STEPS, Role::Alternative, paper.as_ref()), ("model", Role::Model, Some(&model))];
    for (name, role, run) in runs {
        let Some(run) = run else { continue };
        force = force.series(line(name, role, &time, run.iter().copied()));
        error = error.series(line(name, role, &time, less(&measured, run)));
    }
    let rms = |run: &[f64]| {
        let squares: f64 = less(&measured, run).map(|error| error.powi(2)).sum();
        (squares / measured.len() as f64).sqrt()
    };
    Ok(Figure::new("small-motion", 0, "Rests and small reversals")
        .panel(position)
        .panel(force.aspect(0.45))
        .panel(error.aspect(0.26))
        .linked_x()
        .caption(caption(&shown, rms(&model), paper.as_deref().map(rms))))
}

fn less<'v>(measured: &'v [f64], run: &'v [f64]) -> impl Iterator<Item = f64> + 'v {
    measured.iter().zip(run).map(|(measured, model)| measured - model)
}

const TWO_STEPS: &str = "paper's two steps";

/// Force of the paper's element relative to the readings minus the model's offset, since both have
/// their own offset; `None` if the two steps resolved no deformation.
fn paper_run(found: &Identification, recording: &Recording) -> Option<Vec<f64>> {
    let two_steps = found.deformation.as_ref().ok().and_then(|_| found.two_step.stages().ok())?;
    let Replay { mut force, .. } =
        replay(&Trocar::of_seal(two_steps), recording, found.two_step.offset);
    force.iter_mut().for_each(|force| *force += found.two_step.offset - found.model.offset);
    Some(force)
}

fn caption(shown: &MotionWindow, model: f64, paper: Option<f64>) -> String {
    let seen = if shown.seen {
        "which the model was fitted to"
    } else {
        "which the identification has not seen"
    };
    let model = significant(model, 2);
    let errors = match paper {
        Some(paper) => format!(
            "Both are free-run simulations from measured positions; the element of the paper's two steps is what the same recordings give \
             without this fit. Root mean square errors here: {model} N and {} N.",
            significant(paper, 2)
        ),
        None => format!(
            "The model is a free-run simulation from measured positions; the paper's two steps resolve no deformation here, so there is no other \
             to compare it with. Root mean square error here: {model} N."
        ),
    };
    format!(
        "(a) Position, (b) force and (c) measured minus computed force over the {SHOWN:.0} s of {}, {seen}, in which rests and small \
         reversals are densest ({} partial reversals, {} s at rest or trembling), from {} s on. {errors}",
        shown.recording.name,
        shown.partial,
        significant(shown.held, 2),
        significant(shown.recording.time[shown.samples.start], 3)
    )
}

/// Samples in rests within `reach` (m), which includes tremor.
fn resting(recording: &Recording, reach: f64) -> Vec<bool> {
    let (x, t) = (&recording.position, &recording.time);
    let mut resting = vec![false; x.len()];
    for range in recording.unbroken() {
        let mut from = range.start;
        while from + 1 < range.end {
            let until = (from + 1..range.end)
                .find(|i| (x[*i] - x[from]).abs() > reach)
                .unwrap_or(range.end);
            let rests = t[until - 1] - t[from] >= SHORTEST_REST;
            if rests {
                resting[from..until].fill(true);
            }
            from = if rests { until } else { from + 1 };
        }
    }
    resting
}

/// The part with the most partial reversals and rests among samples with known state; `None` if no
/// part contains both.
fn densest<'a>(
    found: &Identification,
    (recordings, runs): (&'a [Recording], &'a [Replay]),
    seen: bool,
) -> Option<MotionWindow<'a>> {
    let all = recordings.iter().zip(runs);
    all.flat_map(|(recording, run)| windows(found, recording, run, seen))
        .filter(|s| s.partial > 0 && s.held > 0.0)
        .max_by(|a, b| a.density().total_cmp(&b.density()))
}

fn windows<'a>(
    found: &Identification,
    recording: &'a Recording,
    run: &'a Replay,
    seen: bool,
) -> Vec<MotionWindow<'a>> {
    let widest = 2.0 * found.model.half_width;
    let x = &recording.position;
    let strokes = strokes(recording, reversal_threshold(recording));
    let partial: Vec<usize> = strokes
        .iter()
        .filter(|p| (x[p.end.min(x.len() - 1)] - x[p.start]).abs() < widest)
        .map(|p| p.start)
        .collect();
    let resting = resting(recording, RESTING * found.model.half_width);
    let mut all = Vec::new();
    for range in &run.known {
        let ends = [range.start, range.end - 1].map(|i| recording.time[i]);
        let starts = excerpt_starts(ends, SHOWN, STEP);
        for from in starts.take_while(|from| from + SHOWN <= ends[1]) {
            let [first, last] =
                [from, from + SHOWN].map(|time| recording.time.partition_point(|t| *t < time));
            let samples = first..last;
            let held = samples.clone().filter(|i| resting[*i]).count() as f64
                * recording.quality.median_interval;
            let partial = partial.iter().filter(|i| samples.contains(i)).count();
            all.push(MotionWindow { recording, run, samples, partial, held, seen });
        }
    }
    all
}
