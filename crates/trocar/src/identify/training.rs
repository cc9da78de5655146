//! Recordings as steps for the simulation: position increments, durations, readings, weights and clusters.
//!
//! Inside a settled constant-velocity stretch nothing happens that a longer step would miss, so its samples are
//! taken together; elsewhere samples are taken together while the motion is a few thousandths of the half width or less, and
//! their mean reading is compared with the force at the mean of their places. A *cluster* is a cycle of two passes (or several short ones):
//! the unit that is resampled for intervals. Its weight is that of readings that share a level scattering by τ between passes:
//! 1/(s² + n·τ²).

use std::ops::Range;

use trocar_model::Element;

use crate::recording::Recording;
use crate::replay::forgotten_after;
use crate::segment::{Pass, Stretch};

/// Most samples taken together.
const THINNING: usize = 20;
/// Longest travel, as a part of the half width, over which samples are taken together.
const FINEST: f64 = 0.003;
/// The same where the sliding has settled and is scored, in units of that: models may take longer to settle than the
/// EMS element.
const SETTLED: f64 = 50.0;

/// One step of the simulation.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Step {
    pub(crate) displacement: f64,
    pub(crate) duration: f64,
    /// Mean reading over the step's samples, N.
    pub(crate) force: f64,
    /// Mean acceleration over the step's samples, m/s².
    pub(crate) acceleration: f64,
    /// Samples in the step; 0 where the state is not yet known.
    pub(crate) samples: f64,
    /// Where in the step the mean over its samples lies: (n + 1)/(2n) of the way for n samples.
    pub(crate) centre: f64,
    pub(crate) cluster: usize,
}

/// Steps of one unbroken part of a recording, from an unknown start.
#[derive(Debug, Clone)]
pub(crate) struct Run {
    pub(crate) steps: Vec<Step>,
    /// Reading before the first step, N.
    pub(crate) first_force: f64,
}

/// All that the refinement simulates.
#[derive(Debug, Clone)]
pub(crate) struct Training {
    pub(crate) runs: Vec<Run>,
    /// Weight of a sample of each cluster, 1/N².
    pub(crate) weights: Vec<f64>,
    /// What is known of the free numbers beforehand, in their order: value and precision (1/variance).
    pub(crate) prior: Vec<(f64, f64)>,
    /// Recording and sample at which each cluster starts, in order.
    starts: Vec<(usize, usize)>,
}

/// A recording with what the segmentation found in it.
pub(crate) struct Segmented<'a> {
    pub(crate) recording: &'a Recording,
    pub(crate) passes: &'a [Pass],
    /// Stretches of constant velocity from where the sliding has settled.
    pub(crate) settled: Vec<Stretch>,
    /// Whether these are scored. Not where their means are data already, those of the steady state.
    pub(crate) settled_scored: bool,
    pub(crate) acceleration: Vec<f64>,
}

impl Training {
    /// Shorter cycles are put together until there are at most `most_clusters`.
    pub(crate) fn new(data: &[Segmented], noise: f64, scatter: f64, half_width: f64, most_clusters: usize) -> Self {
        let shortest: f64 = data.iter().map(|d| d.recording.duration()).sum::<f64>() / most_clusters as f64;
        let mut runs = Vec::new();
        let mut sizes: Vec<f64> = Vec::new();
        let mut starts = Vec::new();
        for (index, part) in data.iter().enumerate() {
            for Range { start: from, end: to } in part.recording.unbroken() {
                if to > from + 1 {
                    runs.push(run(part, from, to, [shortest, FINEST * half_width], &mut sizes, |sample| {
                        starts.push((index, sample))
                    }));
                }
            }
        }
        let weights = sizes.iter().map(|n| 1.0 / (noise * noise + n * scatter * scatter)).collect();
        Self { runs, weights, prior: Vec::new(), starts }
    }

    /// Takes the weight from all steps before the state is known: until unknown starts give one force.
    pub(crate) fn forget_unknown_starts(&mut self, elements: &[Element]) {
        for run in &mut self.runs {
            let steps = run.steps.iter().map(|s| (s.displacement, s.duration));
            let known = forgotten_after(elements, steps).map_or(run.steps.len(), |i| i + 1);
            run.steps[..known].iter_mut().for_each(|s| s.samples = 0.0);
        }
    }

    /// Cluster that holds a sample of a recording.
    pub(crate) fn cluster_of(&self, recording: usize, sample: usize) -> usize {
        self.starts.partition_point(|start| *start <= (recording, sample)).saturating_sub(1)
    }

    /// The same training with the weight taken from some clusters.
    pub(crate) fn without(&self, left_out: impl Fn(usize) -> bool) -> Self {
        let mut part = self.clone();
        part.weights.iter_mut().enumerate().filter(|(g, _)| left_out(*g)).for_each(|(_, w)| *w = 0.0);
        part
    }

    /// Root mean square acceleration, m/s².
    pub(crate) fn rms_acceleration(&self) -> f64 {
        let steps = || self.runs.iter().flat_map(|r| &r.steps);
        let samples: f64 = steps().map(|s| s.samples).sum();
        (steps().map(|s| s.samples * s.acceleration.powi(2)).sum::<f64>() / samples.max(1.0)).sqrt()
    }

    pub(crate) fn clusters(&self) -> usize {
        self.weights.len()
    }
}

fn run(
    part: &Segmented,
    from: usize,
    to: usize,
    [shortest, finest]: [f64; 2],
    sizes: &mut Vec<f64>,
    mut on_cluster: impl FnMut(usize),
) -> Run {
    let recording = part.recording;
    let mut steps = Vec::new();
    let mut pass = part.passes.partition_point(|p| p.end <= from);
    let mut stretch = part.settled.partition_point(|s| s.end <= from);
    sizes.push(0.0);
    on_cluster(from);
    let mut cluster_start = recording.time[from];
    let mut passes_inside = 0;
    let mut at = from;
    while at + 1 < to {
        while part.settled.get(stretch).is_some_and(|s| s.end <= at + 1) {
            stretch += 1;
        }
        let inside = part.settled.get(stretch).filter(|s| s.start <= at);
        let next = match inside {
            Some(s) if part.settled_scored => together(recording, at, s.end, SETTLED * finest),
            Some(s) => (at + THINNING).min(s.end - 1).max(at + 1),
            None => together(recording, at, to, finest),
        };
        if part.passes.get(pass).is_some_and(|p| p.end <= at) {
            pass += 1;
            passes_inside += 1;
            if passes_inside >= 2 && recording.time[at] - cluster_start >= shortest {
                passes_inside = 0;
                cluster_start = recording.time[at];
                sizes.push(0.0);
                on_cluster(at);
            }
        }
        let samples = (next - at) as f64;
        let mean = |values: &[f64]| values[at + 1..=next].iter().sum::<f64>() / samples;
        let cluster = sizes.len() - 1;
        let unscored = (inside.is_some() && !part.settled_scored) || (at + 1..=next).any(|i| recording.is_clipped(i));
        let scored = if unscored { 0.0 } else { samples };
        sizes[cluster] += scored;
        steps.push(Step {
            displacement: recording.position[next] - recording.position[at],
            duration: recording.time[next] - recording.time[at],
            force: mean(&recording.force),
            acceleration: mean(&part.acceleration),
            samples: scored,
            centre: 0.5 * (samples + 1.0) / samples,
            cluster,
        });
        at = next;
    }
    Run { steps, first_force: recording.force[from] }
}

/// Last of the samples behind `at` that are taken together: few, close in position and time, moving one way.
fn together(recording: &Recording, at: usize, to: usize, finest: f64) -> usize {
    const LONGEST: f64 = 0.02;
    let (x, t) = (&recording.position, &recording.time);
    let first = x[at + 1] - x[at];
    let close = |i: &usize| {
        let one_way = (x[*i] - x[*i - 1]) * first >= 0.0 && (first != 0.0 || x[*i] == x[at]);
        one_way && (x[*i] - x[at]).abs() <= finest && t[*i] - t[at] <= LONGEST
    };
    (at + 2..to.min(at + THINNING + 1)).take_while(close).last().unwrap_or(at + 1)
}
