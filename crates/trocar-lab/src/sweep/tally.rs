//! Summary results of a run.

use trocar_model::PositionProfile;
use trocar_model::batch::{LANES, Lanes, Observe};

use trocar_simulate::cancel;

/// Samples between two checks for cancellation.
const LOOK: usize = 2048;

/// Names of the results, in the order of [`Outcome::numbers`].
pub(crate) const RESULTS: [&str; 7] = [
    "peak_force_n",
    "rms_force_n",
    "work_j",
    "work_per_metre_n",
    "break_away_force_n",
    "deforming_share",
    "rms_error_n",
];

/// Results of one run; NaN for a missing one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outcome {
    /// Largest absolute force, N.
    pub peak_force: f64,
    /// Root of the mean square of the force over time, N.
    pub rms_force: f64,
    /// ∫F dx, J: the area of the loop where the motion ends where it began.
    pub work: f64,
    /// `work` divided by the path length, N.
    pub work_per_metre: f64,
    /// Absolute force when the instrument first slides, N.
    pub break_away_force: f64,
    /// Fraction of the time in which the seal deforms and the instrument moves with it.
    pub deforming_share: f64,
    /// Root mean square difference to the measured force, N.
    pub rms_error: f64,
}

impl Outcome {
    /// Outcome of a failed run.
    pub(crate) const NONE: Self = Self {
        peak_force: f64::NAN,
        rms_force: f64::NAN,
        work: f64::NAN,
        work_per_metre: f64::NAN,
        break_away_force: f64::NAN,
        deforming_share: f64::NAN,
        rms_error: f64::NAN,
    };

    pub(crate) fn numbers(&self) -> [f64; RESULTS.len()] {
        [
            self.peak_force,
            self.rms_force,
            self.work,
            self.work_per_metre,
            self.break_away_force,
            self.deforming_share,
            self.rms_error,
        ]
    }
}

/// A motion: the displacement from sample to sample, and the readings.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Path {
    pub(crate) time: Vec<f64>,
    pub(crate) position: Vec<f64>,
    /// Readings, N, if any; NaN for a missing one.
    pub(crate) reading: Vec<f64>,
    /// Displacement (m) and duration (s) to each sample except the first.
    pub(crate) steps: Vec<(f64, f64)>,
}

impl Path {
    pub(crate) fn new(time: Vec<f64>, position: Vec<f64>, reading: Vec<f64>) -> Self {
        let step = |k: usize| (position[k] - position[k - 1], time[k] - time[k - 1]);
        let steps = (1..time.len().min(position.len())).map(step).collect();
        Self { time, position, reading, steps }
    }

    /// The same motion without readings.
    pub(crate) fn without_readings(self) -> Self {
        Self { reading: Vec::new(), ..self }
    }

    pub(crate) fn start(&self) -> f64 {
        self.position.first().copied().unwrap_or(0.0)
    }
}

/// Running sums of one block of models.
#[derive(Debug, Clone, Copy)]
struct Sums {
    last: [f64; LANES],
    peak: [f64; LANES],
    square: [f64; LANES],
    work: [f64; LANES],
    /// NaN until the instrument slides.
    break_away: [f64; LANES],
    deforming: [f64; LANES],
    error: [f64; LANES],
}

/// Sums over all models of a batch along a path.
pub(crate) struct Tally<'a> {
    path: &'a Path,
    profile: Option<PositionProfile<&'a [f64]>>,
    outcomes: Vec<Outcome>,
    /// Force of each model before the first step, N.
    at_start: &'a [f64],
    /// All forces, model after model; empty if not requested.
    traces: &'a mut [f64],
    sums: Sums,
    first: usize,
    count: usize,
    /// Time, displacement and reading, shared by all models.
    shared: [f64; 3],
}

impl<'a> Tally<'a> {
    pub(crate) fn new(
        path: &'a Path,
        profile: Option<PositionProfile<&'a [f64]>>,
        at_start: &'a [f64],
        traces: &'a mut [f64],
    ) -> Self {
        let zero = [0.0; LANES];
        let sums = Sums {
            last: zero,
            peak: zero,
            square: zero,
            work: zero,
            break_away: zero,
            deforming: zero,
            error: zero,
        };
        let time = path.steps.iter().map(|(_, duration)| duration).sum();
        let way = path.steps.iter().map(|(displacement, _)| displacement.abs()).sum();
        let readings = path.reading.iter().filter(|reading| reading.is_finite()).count() as f64;
        let shared = [time, way, readings];
        Self {
            path,
            profile,
            outcomes: Vec::new(),
            at_start,
            traces,
            sums,
            first: 0,
            count: 0,
            shared,
        }
    }

    pub(crate) fn outcomes(self) -> Vec<Outcome> {
        self.outcomes
    }

    fn error_at(&self, sample: usize) -> Option<f64> {
        self.path.reading.get(sample).copied().filter(|reading| reading.is_finite())
    }

    fn trace(&mut self, sample: usize, forces: &[f64; LANES]) {
        let samples = self.path.position.len();
        let own = self.traces.chunks_exact_mut(samples.max(1)).skip(self.first).take(self.count);
        for (trace, force) in own.zip(forces) {
            trace[sample] = *force;
        }
    }

    fn outcome(&self, lane: usize) -> Outcome {
        let [time, way, readings] = self.shared;
        let sums = &self.sums;
        let share = |value: f64, of: f64| if of > 0.0 { value / of } else { f64::NAN };
        Outcome {
            peak_force: sums.peak[lane],
            rms_force: share(sums.square[lane], time).sqrt(),
            work: sums.work[lane],
            work_per_metre: share(sums.work[lane], way),
            break_away_force: sums.break_away[lane],
            deforming_share: share(sums.deforming[lane], time),
            rms_error: share(sums.error[lane], readings).sqrt(),
        }
    }
}

impl Observe for Tally<'_> {
    fn begin(&mut self, first: usize, count: usize) {
        (self.first, self.count) = (first, count);
        let zero = [0.0; LANES];
        let mut at_start = zero;
        at_start
            .iter_mut()
            .zip(self.at_start.iter().skip(first))
            .for_each(|(own, force)| *own = *force);
        let mut sums = Sums {
            last: at_start,
            peak: at_start.map(f64::abs),
            square: zero,
            work: zero,
            break_away: [f64::NAN; LANES],
            deforming: zero,
            error: zero,
        };
        if let Some(reading) = self.error_at(0) {
            sums.error = at_start.map(|force| (reading - force) * (reading - force));
        }
        self.sums = sums;
        if !self.traces.is_empty() {
            self.trace(0, &at_start);
        }
    }

    #[inline(always)]
    fn see(&mut self, step: usize, lanes: &Lanes) {
        let sample = step + 1;
        if sample.is_multiple_of(LOOK) {
            cancel::check();
        }
        let (displacement, duration) = self.path.steps[step];
        let mut forces = *lanes.forces();
        if let Some(profile) = self.profile {
            forces = forces.map(|force| profile.apply(self.path.position[sample], force));
        }
        let sliding = lanes.sliding();
        let sums = &mut self.sums;
        for i in 0..LANES {
            let (force, last) = (forces[i], sums.last[i]);
            sums.peak[i] = if force.abs() > sums.peak[i] { force.abs() } else { sums.peak[i] };
            sums.square[i] += force * force * duration;
            sums.work[i] += 0.5 * (force + last) * displacement;
            let breaks = sums.break_away[i].is_nan() & (sliding[i] > 0.0);
            sums.break_away[i] = if breaks { force.abs() } else { sums.break_away[i] };
            sums.deforming[i] += (1.0 - sliding[i]) * duration;
            sums.last[i] = force;
        }
        if let Some(reading) = self.error_at(sample) {
            for (sum, force) in self.sums.error.iter_mut().zip(&forces) {
                *sum += (reading - force) * (reading - force);
            }
        }
        if !self.traces.is_empty() {
            self.trace(sample, &forces);
        }
    }

    fn end(&mut self, _: usize, count: usize) {
        let outcomes: Vec<Outcome> = (0..count).map(|lane| self.outcome(lane)).collect();
        self.outcomes.extend(outcomes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use trocar_model::{Element, ElementParams};
    use trocar_simulate::cancel::{Cancel, Stopped};

    #[test]
    fn a_long_motion_is_left_where_it_is_cancelled() {
        let params = ElementParams::plausible_10_5_mm().expect("made for it");
        let element = Element::new(params).expect("in range");
        let numbers = |step: f64| (0..3 * LOOK).map(|k| step * k as f64).collect();
        let path = Path::new(numbers(1e-3), numbers(1e-6), Vec::new());
        let cancel = Cancel::default();
        let work = || {
            cancel.cancel();
            let mut tally = Tally::new(&path, None, &[0.0], &mut []);
            trocar_simulate::many::alone(
                &[element],
                &[element.rest_state(0.0)],
                &path.steps,
                &mut tally,
            );
        };
        assert!(matches!(cancel.run(1, work), Err(Stopped::Cancelled)));
    }
}
