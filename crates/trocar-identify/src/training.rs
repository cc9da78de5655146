//! Recordings as steps for the simulation: position increments, durations, readings, weights and
//! clusters.
//!
//! Within a settled constant-velocity segment a longer step loses nothing, so its samples are
//! averaged. Elsewhere samples are averaged while the motion is at most a few thousandths of the
//! half width. Their mean reading is compared with the force at their mean position. A *cluster* is
//! a cycle of two strokes (or several short ones): the unit that is left out for intervals. Short
//! strokes that follow each other share one friction scale: together they count as one stroke here.

use std::ops::Range;

use trocar_model::{Seal, Stages};

use super::prior::Prior;
use trocar_recording::Recording;
use trocar_recording::loads::{ByLoad, Load, Recorded};
use trocar_simulate::replay::forgotten_after;
use trocar_simulate::segment::{Direction, SteadySegment, Stroke};
use trocar_simulate::stick_slip::{LeftOut, Piece};

/// Most samples averaged, and longest time, s: stick-slip has a frequency of about 10 Hz or more.
const THINNING: usize = 50;
const LONGEST: f64 = 0.03;
/// Samples that may be averaged while the seal slides, whatever the sampling rate.
const COARSE: f64 = 8.0;
/// Change of the velocity, m/s, within which samples are averaged, since a step has one velocity.
const STEADY: f64 = 1e-3;
/// The same as a part of the velocity, where that is more.
const STEADY_PART: f64 = 0.05;
/// Standard errors of a position that a second difference of three does not exceed by chance.
const POSITION_ERRORS: f64 = 10.0;
/// Longest step after a sudden change of the velocity, as a part of the time since: the mean of a
/// force that settles exponentially is then within 0.1 % of the change.
const SETTLING: f64 = 0.125;
/// Longest travel, as a fraction of the half width, over which samples are averaged.
const FINEST: f64 = 0.01;
/// The same while the seal slides: this fraction of the half width, or of the longest stroke.
const SLIDING: f64 = 0.15;
const SLIDING_STROKE: f64 = 0.02;
/// Longest travel, as a fraction of the half width, of a step of the simulation while the seal
/// deforms, and most steps to a sample: where samples are further apart, longer steps blur the
/// breakaway, and c comes out some tenths of a percent too small.
const COARSEST: f64 = 0.02;
const MOST_PARTS: f64 = 20.0;
/// Path after a reversal beyond which the instrument slides, in half widths.
const SLIDES: f64 = 3.0;

/// Half width assumed where no deformation is resolved, as a fraction of the longest stroke.
pub(crate) const ASSUMED_WIDTH: f64 = 0.05;

/// One step of the simulation.
#[derive(Debug, Clone)]
pub(crate) struct Step {
    pub(crate) displacement: f64,
    pub(crate) duration: f64,
    /// Mean reading over the step's samples, N.
    pub(crate) force: f64,
    /// Mean over the step's samples of what one unit of each load does: of the mass the acceleration, m/s².
    pub(crate) effects: ByLoad<f64>,
    /// Number of samples in the step that count as independent; 0 where the state is not yet known.
    pub(crate) weight: f64,
    /// Mean position of the samples within the step, as a fraction of the displacement.
    pub(crate) centre: f64,
    /// Number of independent errors in the step: divisor of a residual variance.
    pub(crate) independent: f64,
    pub(crate) stroke: usize,
    /// Path since the stroke began, m.
    path: f64,
    /// The reading is that at which the seal lets go in this direction, of F_s in place of F.
    pub(crate) limit: Option<Direction>,
    /// w: degree to which the stroke's friction scale has replaced that of the stroke before.
    pub(crate) blend: f64,
}

impl Step {
    /// The step between two samples of a recording, `path` m after `stroke` began; at most
    /// `independent` of its samples count as such.
    fn over(
        part: &Segmented,
        (at, next): (usize, usize),
        independent: f64,
        (stroke, path): (usize, f64),
    ) -> Self {
        let recording = part.recording;
        let samples = (next - at) as f64;
        let mean = |values: &[f64]| mean(&values[at + 1..=next]);
        let displacement = recording.position[next] - recording.position[at];
        let is_clipped = (at + 1..=next).any(|i| recording.is_clipped(i));
        let first = part.left_out.releases.partition_point(|out| out.end <= at + 1);
        let has_no_weight = part.left_out.releases.get(first).is_some_and(|out| out.start <= next);
        let effects = part.effects().map(|effect| effect.map_or(0.0, mean));
        Self {
            displacement,
            duration: recording.time[next] - recording.time[at],
            force: mean(&recording.force),
            effects: effects.map(|own| if own.is_nan() { 0.0 } else { own }),
            weight: if is_clipped || has_no_weight || effects.iter().any(|own| own.is_nan()) {
                0.0
            } else {
                samples / (1.0 + samples / independent)
            },
            centre: if displacement == 0.0 {
                0.5 * (samples + 1.0) / samples
            } else {
                (mean(&recording.position) - recording.position[at]) / displacement
            },
            independent: if independent.is_finite() { 1.0 } else { samples },
            stroke,
            path,
            limit: None,
            blend: 1.0,
        }
    }

    /// The reading after this step at which the seal lets go, N.
    fn letting_go(&self, (direction, force): (Direction, f64)) -> Self {
        let (displacement, limit) = (0.0, Some(direction));
        Self { displacement, force, weight: LETS_GO, centre: 1.0, limit, ..self.clone() }
    }

    /// Force at the centre, interpolated between those before and after the step, N.
    #[inline]
    pub(crate) fn at_centre(&self, before: f64, after: f64) -> f64 {
        before + self.centre * (after - before)
    }

    /// The step of a single sample in parts of at most `travel`, m, of which the last one counts.
    fn divided(self, travel: f64) -> impl Iterator<Item = Self> {
        let count = (self.displacement.abs() / travel).ceil().clamp(1.0, MOST_PARTS);
        let Self { displacement, duration, weight, .. } = self;
        let part = Self { displacement: displacement / count, duration: duration / count, ..self };
        let last = count as usize - 1;
        (0..=last)
            .map(move |k| Self { weight: if k == last { weight } else { 0.0 }, ..part.clone() })
    }
}

/// A stroke with its own friction scale; several short strokes count as one.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ScaledStroke {
    pub(crate) cluster: usize,
    pub(crate) recording: usize,
    /// First sample.
    pub(crate) start: usize,
    /// Start time, s.
    pub(crate) time: f64,
    /// Direction of the motion at its start; `None` at rest.
    pub(crate) direction: Option<Direction>,
    /// Whether a run begins with it whose first state is known from a reading.
    pub(crate) begins: bool,
}

/// The friction scale of the strokes in the likelihood.
#[derive(Debug, Clone, Default)]
pub(crate) struct Scale {
    /// Whether each stroke has a scale of its own.
    pub(crate) is_free: bool,
    /// λ = σ²/τ², N²: infinity fixes all strokes to the drift.
    pub(crate) lambda: f64,
    /// Strokes whose size is no datum: their speed responds to the friction.
    pub(crate) unconstrained: Vec<bool>,
    /// φ_k(g): drift over the strokes.
    pub(crate) basis: Vec<Vec<f64>>,
    /// ω_k: prior standard deviation of each amplitude.
    pub(crate) expected: Vec<f64>,
}

impl Scale {
    pub(crate) fn is_unconstrained(&self, stroke: usize) -> bool {
        self.unconstrained.get(stroke).copied().unwrap_or(false)
    }
}

/// Steps of one piece of a recording.
#[derive(Debug, Clone)]
pub(crate) struct Run {
    pub(crate) steps: Vec<Step>,
    /// Reading before the first step, N, and what one unit of each load did then.
    pub(crate) first_force: f64,
    pub(crate) first_effects: ByLoad<f64>,
    /// Direction of the motion before, where the seal deforms from that reading on.
    pub(crate) after: Option<Direction>,
}

impl Run {
    /// The strokes of its steps.
    pub(crate) fn strokes(&self) -> Range<usize> {
        let [first, last] =
            [self.steps.first(), self.steps.last()].map(|step| step.map(|s| s.stroke));
        first.unwrap_or(0)..last.map_or(0, |last| last + 1)
    }
}

/// The error that is correlated along the travel, by the model of ripple.rs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Ripple {
    /// a, N².
    pub(super) white: f64,
    /// b.
    pub(super) variance: f64,
    /// L, m.
    pub(super) length: f64,
}

/// Travel over which samples are averaged while the seal deforms, in units of the finest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Coarseness(f64);

impl Coarseness {
    /// For what is reported.
    pub(crate) const NONE: Self = Self(1.0);
    /// For the search of starts, delay and terms. A force that is averaged over this travel differs
    /// from that at its middle by less than 0.1 % of the Coulomb force, but at the breakaway.
    pub(crate) const SEARCH: Self = Self(4.0);
}

/// All data that the fit simulates.
#[derive(Debug, Clone)]
pub(crate) struct Training {
    pub(crate) runs: Vec<Run>,
    clusters: usize,
    /// σ², N²: weight of the priors of the free parameters; 0 ignores them.
    pub(crate) variance: f64,
    /// Priors of the trial's own free parameters, in their order; empty for the weak ones about 0
    /// that the shape of branches has.
    pub(crate) prior: Vec<Prior>,
    /// In chronological order.
    pub(crate) strokes: Vec<ScaledStroke>,
    pub(crate) scale: Scale,
    /// The error that is correlated along the travel, where its model is used.
    pub(crate) ripple: Option<Ripple>,
}

/// A recording with its segmentation.
pub(crate) struct Segmented<'a> {
    pub(crate) recording: &'a Recording,
    pub(crate) strokes: &'a [Stroke],
    /// Constant-velocity segments from where the sliding has settled.
    pub(crate) settled: Vec<SteadySegment>,
    /// Acceleration, m/s².
    pub(crate) acceleration: &'a [f64],
    pub(crate) recorded: &'a Recorded,
    pub(crate) left_out: &'a LeftOut,
}

impl Segmented<'_> {
    /// What one unit of each load does, where it is known.
    fn effects(&self) -> ByLoad<Option<&[f64]>> {
        let [side, weight, pressure] = self.recorded.each_ref().map(Option::as_deref);
        [Some(self.acceleration), side, weight, pressure]
    }

    /// Mean reading over samples, N, and what one unit of each load did.
    fn mean_over(&self, samples: Range<usize>) -> (f64, ByLoad<f64>) {
        let of = |all: &[f64]| mean(&all[samples.clone()]);
        let effects = self.effects().map(|effect| effect.map_or(0.0, of));
        (of(&self.recording.force), effects.map(|own| if own.is_nan() { 0.0 } else { own }))
    }
}

/// Weight of a reading at which the seal lets go: of the samples by which it is found.
const LETS_GO: f64 = 4.0;
/// Most samples of a step that count as independent, since the unmodelled error changes little
/// within it.
pub(crate) const INDEPENDENT: f64 = 8.0;
/// Travel after which a stroke may end, in half widths.
const SHORTEST_STROKE: f64 = 4.0;
/// With fewer strokes than this, each is a cluster of its own.
const FEW_STROKES: usize = 30;
/// Most strokes.
const MOST_STROKES: f64 = 400.0;

impl Training {
    /// Shorter cycles are merged until there are at most `most_clusters`.
    pub(crate) fn new(
        data: &[Segmented],
        half_width: f64,
        most_clusters: usize,
        independent: f64,
        Coarseness(coarseness): Coarseness,
    ) -> Self {
        // At a steady acceleration the velocity changes with the root of the travel.
        let change = coarseness.sqrt();
        let duration: f64 = data.iter().map(|d| d.recording.duration()).sum();
        let longest = data.iter().map(|d| d.recording.quality.stroke).fold(0.0, f64::max);
        let interval = data.iter().map(|d| d.recording.quality.median_interval).fold(0.0, f64::max);
        let limits = Limits {
            cluster: duration / most_clusters as f64,
            stroke: duration / MOST_STROKES,
            finest: Together {
                change,
                travel: coarseness * FINEST * half_width,
                duration: LONGEST,
            },
            sliding: Together {
                change,
                travel: (SLIDING * half_width).max(SLIDING_STROKE * longest),
                duration: LONGEST.max(COARSE * interval),
            },
            half_width,
            divided: coarseness * COARSEST * half_width,
            independent,
            strokes_of_cluster: if data.iter().map(|d| d.strokes.len()).sum::<usize>() < FEW_STROKES
            {
                1
            } else {
                2
            },
        };
        let (mut runs, mut strokes) = (Vec::new(), Vec::new());
        for (index, part) in data.iter().enumerate() {
            for piece in part.left_out.pieces(part.recording) {
                runs.push(run(part, index, piece, limits, &mut strokes));
            }
        }
        let clusters = strokes.last().map_or(0, |s: &ScaledStroke| s.cluster + 1);
        Self {
            runs,
            clusters,
            variance: 0.0,
            prior: Vec::new(),
            strokes,
            scale: Scale::default(),
            ripple: None,
        }
    }

    /// Values over the strokes less their mean over the strokes whose size counts.
    pub(crate) fn centred(&self, value: impl Fn(usize) -> f64) -> Vec<f64> {
        let count = self.strokes.len();
        let counted: Vec<usize> = (0..count).filter(|g| !self.scale.is_unconstrained(*g)).collect();
        let mean = counted.iter().map(|g| value(*g)).sum::<f64>() / counted.len().max(1) as f64;
        (0..count).map(|g| value(g) - mean).collect()
    }

    /// Sets the weight of all steps to zero until the state is known, that is, until different
    /// initial states give the same force.
    pub(crate) fn forget_unknown_starts(&mut self, stages: Stages) {
        let seal = Seal::from(stages);
        for run in self.runs.iter_mut().filter(|run| run.after.is_none()) {
            let steps = run.steps.iter().map(|s| (s.displacement, s.duration));
            let known = forgotten_after(&seal, steps).map_or(run.steps.len(), |i| i + 1);
            run.steps[..known].iter_mut().for_each(|s| s.weight = 0.0);
        }
    }

    /// w = 1 − exp(−path/length), `length` in m.
    pub(crate) fn blend_over(&mut self, length: f64) {
        let steps = self.runs.iter_mut().flat_map(|run| &mut run.steps);
        steps.for_each(|step| step.blend = 1.0 - (-step.path / length).exp());
    }

    /// Strokes of each cluster.
    pub(crate) fn cluster_strokes(&self) -> impl Iterator<Item = Range<usize>> + '_ {
        let mut from = 0;
        self.strokes.chunk_by(|a, b| a.cluster == b.cluster).map(move |chunk| {
            from += chunk.len();
            from - chunk.len()..from
        })
    }

    pub(crate) fn clusters(&self) -> usize {
        self.clusters
    }
}

/// Longest travel, m, and time, s, over which samples are averaged.
#[derive(Clone, Copy)]
struct Together {
    /// Change of the velocity, in units of that which a step always may have.
    change: f64,
    travel: f64,
    duration: f64,
}

impl Together {
    /// Change of the velocity within which samples are averaged at `speed`, m/s.
    fn steady(self, speed: f64) -> f64 {
        self.change * STEADY.max(STEADY_PART * speed)
    }

    /// Whether the velocity changes by more than that from one sample to the next: by the
    /// acceleration, which is smoothed, or by the positions, where these err less.
    fn is_sudden(self, part: &Segmented, at: usize) -> bool {
        let (x, t) = (&part.recording.position, &part.recording.time);
        let duration = t[at + 1] - t[at];
        let steady = self.steady((x[at + 1] - x[at]).abs() / duration);
        let by_positions = || {
            let step = part.recording.quality.position_resolution;
            let error = (POSITION_ERRORS * part.recording.position_noise()).max(2.0 * step);
            let is_even = (t[at] - t[at - 1] - duration).abs() < 0.5 * STEADY_PART * duration;
            is_even && (x[at + 1] - 2.0 * x[at] + x[at - 1]).abs() > steady * duration + error
        };
        part.acceleration[at].abs() * duration > steady || at > 0 && by_positions()
    }
}

/// Shortest cluster and stroke, s; limits of averaging while the seal deforms and slides; half
/// width, m.
#[derive(Clone, Copy)]
struct Limits {
    cluster: f64,
    stroke: f64,
    finest: Together,
    sliding: Together,
    half_width: f64,
    /// Longest travel of a step of a single sample while the seal deforms, m.
    divided: f64,
    /// Most samples of a step that count as independent.
    independent: f64,
    strokes_of_cluster: usize,
}

/// Current strokes and clusters of a run.
struct Progress {
    /// Index of the current stroke of the recording.
    stroke: usize,
    strokes_inside: usize,
    cluster_time: f64,
    /// Path since the stroke began, m.
    path: f64,
    /// Path since the last reversal, m.
    since_reversal: f64,
    /// Time of the last sudden change of the velocity, s.
    sudden: f64,
    is_first: bool,
}

fn run(
    part: &Segmented,
    index: usize,
    Piece { samples: range, begins, lets_go }: Piece,
    limits: Limits,
    scaled: &mut Vec<ScaledStroke>,
) -> Run {
    let recording = part.recording;
    let mut steps = Vec::new();
    let mut segment = part.settled.partition_point(|s| s.end <= range.start);
    let cluster = scaled.last().map_or(0, |s| s.cluster + 1);
    let mut at = range.start;
    let direction = part.strokes.iter().find(|p| p.end > at).map(|p| p.direction);
    scaled.push(ScaledStroke {
        cluster,
        recording: index,
        start: at,
        time: recording.time[at],
        direction,
        begins: begins.is_some(),
    });
    let mut progress = Progress {
        stroke: part.strokes.partition_point(|p| p.end <= at),
        strokes_inside: 0,
        cluster_time: recording.time[at],
        path: 0.0,
        since_reversal: 0.0,
        sudden: f64::NEG_INFINITY,
        is_first: true,
    };
    while at + 1 < range.end {
        while part.settled.get(segment).is_some_and(|s| s.end <= at + 1) {
            segment += 1;
        }
        let inside = part.settled.get(segment).filter(|s| s.start <= at);
        progress.reverse(part, index, at, limits, scaled);
        if limits.finest.is_sudden(part, at) {
            progress.sudden = recording.time[at];
        }
        let settling = recording.time[at] - progress.sudden;
        let next = match inside {
            Some(s) => together(part, at, s.end.min(range.end), limits.sliding, settling),
            None if progress.since_reversal > SLIDES * limits.half_width => {
                together(part, at, range.end, limits.sliding, settling)
            }
            None => together(part, at, range.end, limits.finest, settling),
        };
        let travel = (recording.position[next] - recording.position[at]).abs();
        progress.path += travel;
        progress.since_reversal += travel;
        let path = if progress.is_first { f64::INFINITY } else { progress.path };
        let step = Step::over(part, (at, next), limits.independent, (scaled.len() - 1, path));
        let is_one = next == at + 1 && progress.since_reversal <= SLIDES * limits.half_width;
        steps.extend(step.divided(if is_one { limits.divided } else { f64::INFINITY }));
        at = next;
    }
    let seen = lets_go.filter(|_| !recording.is_clipped(range.end - 1));
    let at_end = seen.zip(steps.last()).map(|(seen, last)| last.letting_go(seen));
    steps.extend(at_end);
    let mut effects = steps.first().map_or_else(Default::default, |s: &Step| s.effects);
    effects[Load::Mass as usize] = 0.0;
    let at_start = (recording.force[range.start], effects);
    let after = begins.as_ref().map(|(direction, _)| *direction);
    let (first_force, first_effects) =
        begins.map_or(at_start, |(_, samples)| part.mean_over(samples));
    Run { steps, first_force, first_effects, after }
}

impl Progress {
    /// Begins a scaled stroke at a reversal, and a cluster with every other stroke.
    fn reverse(
        &mut self,
        part: &Segmented,
        index: usize,
        at: usize,
        limits: Limits,
        scaled: &mut Vec<ScaledStroke>,
    ) {
        if part.strokes.get(self.stroke).is_none_or(|p| p.end > at) {
            return;
        }
        self.stroke += 1;
        self.since_reversal = 0.0;
        let last = *scaled.last().expect("a run begins with a stroke");
        let time = part.recording.time[at];
        if self.path < SHORTEST_STROKE * limits.half_width || time - last.time < limits.stroke {
            return;
        }
        self.strokes_inside += 1;
        let mut cluster = last.cluster;
        if self.strokes_inside >= limits.strokes_of_cluster
            && time - self.cluster_time >= limits.cluster
        {
            (self.strokes_inside, self.cluster_time) = (0, time);
            cluster += 1;
        }
        (self.path, self.is_first) = (0.0, false);
        let direction = part.strokes.get(self.stroke).map(|p| p.direction);
        let start = at;
        scaled.push(ScaledStroke {
            cluster,
            recording: index,
            start,
            time,
            direction,
            begins: false,
        });
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Last of the samples after `at` that are averaged: few, close in position and time, moving in one
/// direction.
///
/// A seal settles with its own time after a sudden change of the velocity, `settling` s ago: the
/// mean of its force over a step that is short beside that lies between those before and after.
fn together(part: &Segmented, at: usize, to: usize, limit: Together, settling: f64) -> usize {
    let (x, t, a) = (&part.recording.position, &part.recording.time, part.acceleration);
    let first = x[at + 1] - x[at];
    let mut change = a[at + 1] * (t[at + 1] - t[at]);
    let close = |i: &usize| {
        let one_way = (x[*i] - x[*i - 1]) * first >= 0.0 && (first != 0.0 || x[*i] == x[at]);
        change += a[*i] * (t[*i] - t[*i - 1]);
        // At a low sampling rate single accelerations err most.
        let speed = (x[*i] - x[at]).abs() / (t[*i] - t[at]);
        let is_steady = limit.steady(speed)
            >= if limit.duration > LONGEST { change.abs() } else { (t[*i] - t[at]) * a[*i].abs() };
        one_way
            && is_steady
            && !limit.is_sudden(part, *i - 1)
            && (x[*i] - x[at]).abs() <= limit.travel
            && t[*i] - t[at] <= limit.duration.min(SETTLING * settling)
    };
    (at + 2..to.min(at + THINNING + 1)).take_while(close).last().unwrap_or(at + 1)
}
