//! Every model over the same reversal and the same cycle, in one small panel per family (EMS
//! figures 3 and 9).

use std::ops::Range;

use rayon::prelude::*;

use super::{Drawn, kind, of_interest, role, variant};
use trocar_model::Trocar;

use crate::document::{Axis, Figure, Panel, Role};
use crate::figures::validation::{Cycle, cycles};
use crate::figures::{MM, line};
use crate::number::fixed;
use crate::style;
use trocar_lab::compare::{Choice, Comparison, Entry};
use trocar_recording::Recording;
use trocar_simulate::replay::{forces, replay};

/// Margins before and after the reversal, in units of the travel over which the error of a reversal
/// is evaluated.
const MARGINS: [f64; 2] = [0.35, 1.4];

/// The simulation of a model over the shown recording.
struct Run {
    name: String,
    role: Role,
    /// Reading, N, minus the common offset.
    force: Vec<f64>,
}

/// The models by panel, over one cycle.
pub(crate) struct Shown<'a> {
    recording: &'a Recording,
    cycle: Cycle,
    /// Offset subtracted from all curves, N.
    offset: f64,
    measured: Vec<f64>,
    panels: Vec<(&'static str, Vec<Run>)>,
}

/// Simulates the models over the recording that contains the cycle of the middle speed; `None`
/// without a suitable cycle.
pub(crate) fn shown(comparison: &Comparison) -> Option<Shown<'_>> {
    let cycle = representative(comparison)?;
    let recording = &comparison.validation[cycle.recording];
    let offset = comparison.ems.model.offset;
    let panels = titles(comparison).into_iter().map(|title| {
        let models = models(comparison, title);
        let runs = models.par_iter().map(|(entry, place)| Run {
            name: entry.title(),
            role: role(entry, *place),
            force: forces(&entry.trocar, recording, entry.offset)
                .into_iter()
                .map(|force| force + entry.offset - offset)
                .collect(),
        });
        (title, runs.collect())
    });
    let panels = panels.collect();
    let measured = recording.force.iter().map(|f| f - offset).collect();
    Some(Shown { recording, cycle, offset, measured, panels })
}

/// The panels: classical models in the order of their families, then EMS.
fn titles(comparison: &Comparison) -> Vec<&'static str> {
    let mut families: Vec<Choice> =
        comparison.families().iter().map(|family| family[0].choice).collect();
    families.sort_by_key(|choice| (!matches!(choice, Choice::Classical(_)), *choice));
    let mut titles: Vec<&str> = families.into_iter().map(Choice::panel).collect();
    titles.dedup();
    titles
}

/// The models of a panel with their places; of banks, the best and those that EMS discusses.
fn models<'a>(comparison: &'a Comparison, panel: &str) -> Vec<(&'a Entry, usize)> {
    let own = comparison.families().into_iter().filter(|own| own[0].choice.panel() == panel);
    let numbered = own.flat_map(|own| {
        let chosen = if own[0].choice.is_bank() { of_interest(&own) } else { own };
        chosen.into_iter().enumerate().map(|(place, entry)| (entry, place)).collect::<Vec<_>>()
    });
    let mut all: Vec<(&Entry, usize)> = numbered.collect();
    // Solid lines first, so that dashes are visible on them.
    all.sort_by_key(|(entry, place)| (style::place(kind(entry)), variant(entry, *place)));
    all
}

/// The cycle of the middle speed among those that reverse to insertion and whose deflection is
/// known.
fn representative(comparison: &Comparison) -> Option<Cycle> {
    let recordings = &comparison.validation;
    let ems = &comparison.ems;
    let mut own = cycles(recordings, |index| {
        replay(&Trocar::of_seal(ems.stages), &recordings[index], ems.model.offset).known
    });
    let to_insertion: Vec<Cycle> =
        own.iter().filter(|cycle| is_to_insertion(cycle, recordings)).cloned().collect();
    if !to_insertion.is_empty() {
        own = to_insertion;
    }
    own.sort_by(|a, b| a.speed.total_cmp(&b.speed));
    let middle = own.len() / 2;
    own.into_iter().nth(middle)
}

fn is_to_insertion(cycle: &Cycle, recordings: &[Recording]) -> bool {
    let x = &recordings[cycle.recording].position;
    x[cycle.samples.end - 1] > x[cycle.turn]
}

/// The force of every model after the same reversal, as in figure 3 of EMS.
pub(crate) fn one_reversal(comparison: &Comparison, shown: Option<&Shown>) -> Drawn {
    let shown = shown.ok_or_else(|| {
        "There is no figure of the models upon one reversal (figure 3 of the paper): the validation recordings hold no two full strokes \
         whose initial deflection is known."
            .to_owned()
    })?;
    let window = shown.window(comparison.reversal_travel);
    let turn = shown.recording.position[shown.cycle.turn];
    let travel = window.clone().map(|i| {
        let distance = MM * (shown.recording.position[i] - turn).abs();
        if i < shown.cycle.turn { -distance } else { distance }
    });
    let x: Vec<f64> = travel.collect();
    let figure = Figure::new("one-reversal", 0, "Every model upon the same reversal");
    let axis = Axis::new("travel after the reversal", "mm");
    Ok(shown.draw(figure, &axis, &x, &window).caption(format!(
        "The force upon one reversal to {} in {}, at {:.0} mm/s, as in figure 3 of the paper: measured, and as the models of each family \
         compute it from the measured positions in free run. Of banks of elements the fewest elements within 1 % of the \
         least validation error are shown, beside four and ten. What is drawn left of zero is the travel before the reversal; the \
         errors of reversals count {:.1} mm after it. Where lines coincide, the dashed ones lie on the solid one. {}",
        shown.sense(),
        shown.recording.name,
        MM * shown.cycle.speed,
        MM * comparison.reversal_travel,
        shown.offset_in_words()
    )))
}

/// Force against position of every model over the same cycle.
pub(crate) fn one_cycle(shown: Option<&Shown>) -> Drawn {
    let shown = shown.ok_or_else(|| {
        "There is no figure of the force against position over one cycle: the validation recordings hold no full cycle of two \
         strokes whose initial deflection is known."
            .to_owned()
    })?;
    let window = shown.cycle.samples.clone();
    let x: Vec<f64> = shown.recording.position[window.clone()].iter().map(|x| MM * x).collect();
    let figure = Figure::new("one-cycle", 0, "Force against position over one cycle");
    Ok(shown.draw(figure, &Axis::new("position", "mm"), &x, &window).caption(format!(
        "Both strokes of the cycle in {} that holds the reversal above, measured and computed. {}",
        shown.recording.name,
        shown.offset_in_words()
    )))
}

impl Shown<'_> {
    fn sense(&self) -> &'static str {
        let x = &self.recording.position;
        if x[self.cycle.samples.end - 1] > x[self.cycle.turn] { "insertion" } else { "withdrawal" }
    }

    fn offset_in_words(&self) -> String {
        format!(
            "The sensor offset of the EMS element, {} N, is subtracted from everything drawn; each model is drawn with its own \
             offset as a difference from it.",
            fixed(self.offset, 3)
        )
    }

    /// Samples around the reversal inside the cycle.
    fn window(&self, travel: f64) -> Range<usize> {
        let Cycle { samples, turn, .. } = &self.cycle;
        let x = &self.recording.position;
        let within = |i: &usize, margin: f64| (x[*i] - x[*turn]).abs() <= margin * travel;
        let start =
            (samples.start..*turn).rev().find(|i| !within(i, MARGINS[0])).unwrap_or(samples.start);
        let end = (*turn..samples.end).find(|i| !within(i, MARGINS[1])).unwrap_or(samples.end);
        start..end
    }

    fn draw(&self, figure: Figure, axis: &Axis, x: &[f64], window: &Range<usize>) -> Figure {
        let part = |force: &[f64]| force[window.clone()].to_vec();
        let label = crate::figures::measured(self.recording);
        let measured = line(label, Role::Backdrop, x, part(&self.measured));
        self.panels.iter().fold(figure.columns(2), |figure, (title, runs)| {
            let axes = Panel::new(axis.clone(), Axis::new("force", "N").with_zero());
            let empty = axes.title(*title).aspect(0.55).series(measured.clone());
            let lines = runs.iter().map(|run| line(&run.name, run.role, x, part(&run.force)));
            figure.panel(lines.fold(empty, Panel::series))
        })
    }
}
