//! Force after a velocity reversal: the two transients T1 and T2 (EMS figure 3).

use std::ops::Range;

use trocar_model::Branch;

use super::{Drawn, MM, line, spaced};
use crate::document::{Axis, Figure, Mark, Panel, Role};
use trocar_identify::{DeformationFit, FullReversal, Identification};
use trocar_lab::validate::Validated;
use trocar_recording::{Recording, local_velocity};

/// Shown durations of sliding before the reversal and after the transients, in durations of the
/// deformation.
const MARGINS: [f64; 2] = [0.5, 0.8];
/// If the slope softens beyond this z/c, no rise outside can be determined.
const OUTERMOST: f64 = 0.9;

/// The force after one measured reversal against time.
pub(crate) fn velocity_step(found: &Identification, own: &Validated) -> Drawn {
    let deformation = found.deformation.as_ref().map_err(|why| {
        format!(
            "There is no figure of the force upon a velocity reversal (figure 3 of the paper), because the recordings hold no full reversal: {why}."
        )
    })?;
    let shown = clearest(deformation)
        .ok_or("No full reversal was found that could show a velocity reversal.")?;
    let recording = &own.recordings[shown.recording];
    let window = window(recording, shown);
    let origin = recording.time[turning_point(recording, shown, &window)];
    let time: Vec<f64> = recording.time[window.clone()].iter().map(|t| t - origin).collect();
    let part = |values: &[f64]| values[window.clone()].to_vec();
    let measured = recording.force[window.clone()].iter().map(|force| force - found.model.offset);
    let model = part(&own.runs[shown.recording].force);
    let velocity = local_velocity(recording, (20.0 * recording.quality.median_interval).max(0.02));
    let velocity = part(&velocity).into_iter().map(|v| MM * v);
    let label = super::measured(recording);
    let since = || Axis::new("time since the reversal", "s");
    let forces = Panel::new(since(), Axis::new("force", "N").with_zero())
        .series(line(label, Role::Measured, &time, measured))
        .series(line("model", Role::Model, &time, model));
    let transients = Transients::of(found.element().params().deformation.branch(shown.direction));
    let marked = transients.marks(recording, shown, origin).into_iter().fold(forces, Panel::mark);
    let speed = Panel::new(since(), Axis::new("velocity", "mm/s").with_zero())
        .series(line("velocity", Role::Measured, &time, velocity))
        .aspect(0.25);
    Ok(Figure::new("velocity-step", 0, "Force upon a velocity reversal")
        .panel(speed)
        .panel(marked)
        .linked_x()
        .caption(caption(found, &recording.name, shown, &transients)))
}

fn caption(
    found: &Identification,
    name: &str,
    shown: &FullReversal,
    transients: &Transients,
) -> String {
    let stages = if super::has_stages(found) {
        " The branch is that of the first of the model's elements."
    } else {
        ""
    };
    let motion =
        shown.direction.pick(["from withdrawal to insertion", "from insertion to withdrawal"]);
    format!(
        "(a) Velocity and (b) force upon one reversal {motion} in {name}, at {:.0} mm/s, as in figure 3 of the paper. {}{stages} Sensor offset \
         and inertia of any mass between sensor and seal are subtracted from the measured force; the model's force is the seal's alone.",
        MM * shown.speed,
        transients.in_words()
    )
}

/// Of the deformations in the middle half of the speeds, the one with the smallest deviation from
/// its direction's mean curve at the most constant velocity.
fn clearest(deformation: &DeformationFit) -> Option<&FullReversal> {
    let mut by_speed: Vec<&FullReversal> = deformation.full_reversals.iter().collect();
    by_speed.sort_by(|a, b| a.speed.total_cmp(&b.speed));
    let quarter = by_speed.len() / 4;
    let middle = &by_speed[quarter..by_speed.len() - quarter];
    let unsteadiness = middle.iter().map(|t| {
        let mean = &deformation.branch(t.direction).mean_curve;
        let swing = mean.iter().fold(0.0f64, |most, f| most.max(f.abs())).max(f64::MIN_POSITIVE);
        let force =
            t.curve.iter().zip(mean).map(|(f, m)| (f - m).powi(2)).sum::<f64>().sqrt() / swing;
        let velocity =
            t.velocity.iter().map(|v| (v.abs() - t.speed).powi(2)).sum::<f64>().sqrt() / t.speed;
        (*t, force + velocity)
    });
    unsteadiness.min_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(t, _)| t)
}

/// Samples around the deformation within the same contiguous part of the recording.
fn window(recording: &Recording, shown: &FullReversal) -> Range<usize> {
    let part =
        recording.unbroken().find(|part| part.contains(&shown.from)).unwrap_or(0..recording.len());
    let [from, to] = [recording.time[shown.from], recording.time[shown.to]];
    let [before, after] = MARGINS.map(|margin| margin * (to - from));
    let start = recording.time.partition_point(|t| *t < from - before);
    let end = recording.time.partition_point(|t| *t <= to + after);
    start.max(part.start)..end.min(part.end)
}

/// The sample of the extreme position, at which the velocity changes sign.
fn turning_point(recording: &Recording, shown: &FullReversal, window: &Range<usize>) -> usize {
    let s = shown.direction.sign();
    let before = window.start..=shown.from;
    before
        .min_by(|a, b| (s * recording.position[*a]).total_cmp(&(s * recording.position[*b])))
        .unwrap_or(shown.from)
}

/// Where the first rise ends and the second begins, as z/c in the direction of motion.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Transients {
    /// The branch softens in between: its slope is not positive.
    Softening { from: f64, to: f64 },
    /// The slope has a distinct minimum but stays positive.
    Flattening { at: f64 },
    /// A single rise.
    Single,
}

impl Transients {
    fn of(branch: &Branch) -> Self {
        let c = branch.half_width();
        let slopes: Vec<(f64, f64)> =
            spaced(-0.98, 0.98, 400).map(|u| (u, branch.stiffness(u * c))).collect();
        let softens: Vec<f64> = slopes.iter().filter(|(_, k)| *k <= 0.0).map(|(u, _)| *u).collect();
        if let (Some(from), Some(to)) = (softens.first(), softens.last()) {
            let rises_on_both_sides = *from > -OUTERMOST && *to < OUTERMOST;
            return if rises_on_both_sides {
                Self::Softening { from: *from, to: *to }
            } else {
                Self::Single
            };
        }
        let inner = slopes.iter().enumerate().filter(|(_, (u, _))| u.abs() < 0.8);
        let Some((k, (at, least))) = inner.min_by(|a, b| a.1.1.total_cmp(&b.1.1)) else {
            return Self::Single;
        };
        let [before, after] = [&slopes[..k], &slopes[k..]]
            .map(|part| part.iter().map(|(_, k)| *k).fold(0.0, f64::max));
        let marked = *least < 0.5 * before.min(after);
        if marked { Self::Flattening { at: *at } } else { Self::Single }
    }

    fn marks(&self, recording: &Recording, shown: &FullReversal, origin: f64) -> Vec<Mark> {
        let [start, end] = [shown.from, shown.to].map(|i| recording.time[i] - origin);
        let (first, second) = match *self {
            Self::Softening { from, to } => (from, to),
            Self::Flattening { at } => (at, at),
            Self::Single => return vec![Mark::x_range(start, end, "transient")],
        };
        // A withdrawal follows its branch from +c to -c.
        let [first, second] = shown.direction.pick([[first, second], [second, first]]);
        let [first, second] = [first, second].map(|u| time_at(recording, shown, u) - origin);
        let mut marks = vec![Mark::x_range(start, first, "T1"), Mark::x_range(second, end, "T2")];
        if first == second {
            marks.push(Mark::x(first, ""));
        }
        marks
    }

    fn in_words(&self) -> String {
        match self {
            Self::Softening { .. } => {
                "T1 is the first rise, up to where the seal begins to snap through; T2 is the second one, from where it has snapped through \
                 to sliding. Between them the slope of the branch identified is not positive: equation (15) of the paper."
                    .to_owned()
            }
            Self::Flattening { .. } => "T1 is the first rise, up to the least slope of the branch identified; T2 is the second \
                                        one, from there to sliding. The slope stays positive, so the interval of equation (15) is empty."
                .to_owned(),
            Self::Single => "The branch identified has no marked minimum of its slope between two rises, so the transients T1 and T2 of a \
                             seal that snaps through are not distinguished: one transient is marked, from the reversal to sliding."
                .to_owned(),
        }
    }
}

/// Time at which the deformation reaches z = `u`·c, s.
fn time_at(recording: &Recording, shown: &FullReversal, u: f64) -> f64 {
    let s = shown.direction.sign();
    let start = recording.position[shown.from];
    let wanted = (u * s + 1.0) * shown.half_travel;
    let inside = shown.from..=shown.to;
    let at =
        inside.clone().find(|i| s * (recording.position[*i] - start) >= wanted).unwrap_or(shown.to);
    recording.time[at]
}
