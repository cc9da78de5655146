//! Energy over full cycles, and the error of the step.

use serde::Serialize;
use trocar_model::{ElementParams, Friction, Stages, StagesState};

use super::is_exact;

/// Sampling interval of the motions, s: that of a typical recording or controller.
const SAMPLE: f64 = 1e-3;

/// Speeds of the full cycles, m/s.
const CYCLE_SPEEDS: [f64; 4] = [0.001, 0.015, 0.05, 0.1];

/// Substeps per sample of the reference solution.
const FINE_PARTS: u32 = 64;

/// Largest error allowed where the step is exact, N, and where it is not.
const EXACT_BOUND: f64 = 0.3e-3;
const GENERAL_BOUND: f64 = 40e-3;

/// Work of one full cycle at one speed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Cycle {
    /// Speed, m/s.
    pub speed_m_s: f64,
    /// Travel of each stroke, m.
    pub stroke_m: f64,
    /// Work dissipated in one cycle, J.
    pub work_j: f64,
    /// The work of steady Coulomb and viscous sliding over the whole stroke, (16) times the travel,
    /// J.
    pub sliding_work_j: f64,
}

/// Work dissipated over full cycles.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CycleWork {
    /// One entry per speed.
    pub cycles: Vec<Cycle>,
    /// Whether every cycle dissipates.
    pub holds: bool,
    /// The verdict in words.
    pub verdict: String,
}

/// Error of the step at 1 kHz on a 40 mm stroke at 80 mm/s with an acceleration of 2 m/s² at its
/// ends.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StepError {
    /// Largest difference from steps of 1/64 ms, N.
    pub largest_error_n: f64,
    /// Allowed error, N.
    pub bound_n: f64,
    /// Whether the error is within the bound.
    pub holds: bool,
    /// The verdict in words.
    pub verdict: String,
}

/// A seal in motion.
struct Run<'a> {
    stages: &'a Stages,
    state: StagesState,
}

impl<'a> Run<'a> {
    fn new(stages: &'a Stages) -> Self {
        Self { stages, state: stages.rest_state(0.0) }
    }

    fn force(&self) -> f64 {
        Stages::force(&self.state)
    }

    fn step(&mut self, displacement: f64, duration: f64) -> f64 {
        self.stages.step(&mut self.state, displacement, duration)
    }

    /// Work of the displacements, J, by the trapezoidal rule.
    fn work(&mut self, displacements: impl Iterator<Item = f64>) -> f64 {
        let mut work = 0.0;
        for displacement in displacements {
            let before = self.force();
            work += 0.5 * (before + self.step(displacement, SAMPLE)) * displacement;
        }
        work
    }
}

impl CycleWork {
    pub(super) fn of(stages: &Stages) -> Self {
        let cycles: Vec<Cycle> = CYCLE_SPEEDS.map(|speed| Cycle::of(stages, speed)).to_vec();
        let holds = cycles.iter().all(|cycle| cycle.work_j > 0.0);
        let verdict = if holds {
            "every full cycle dissipates work"
        } else {
            "a full cycle gives work: the seal is not passive"
        };
        Self { cycles, holds, verdict: verdict.to_owned() }
    }
}

impl Cycle {
    fn of(stages: &Stages, speed_m_s: f64) -> Self {
        let stroke_m = 5.0 * stages.half_width();
        let steps = (stroke_m / (speed_m_s * SAMPLE)).ceil() as usize;
        let [inward, outward] =
            [1.0, -1.0].map(|s| std::iter::repeat_n(s * stroke_m / steps as f64, steps));
        let cycle = inward.chain(outward);
        let mut run = Run::new(stages);
        run.work(cycle.clone());
        let work_j = run.work(cycle);
        let sliding = stages.elements().iter().map(|element| {
            let ElementParams { insertion, withdrawal, .. } = element.params();
            insertion.force(speed_m_s) + withdrawal.force(speed_m_s)
        });
        let sliding_work_j = stroke_m * sliding.sum::<f64>();
        Self { speed_m_s, stroke_m, work_j, sliding_work_j }
    }
}

impl StepError {
    pub(super) fn of(stages: &Stages) -> Self {
        let (mut coarse, mut fine) = (Run::new(stages), Run::new(stages));
        let mut largest = 0.0_f64;
        for displacement in trapezoids() {
            let part = f64::from(FINE_PARTS);
            let force = coarse.step(displacement, SAMPLE);
            for _ in 0..FINE_PARTS {
                fine.step(displacement / part, SAMPLE / part);
            }
            largest = largest.max((force - fine.force()).abs());
        }
        let bound_n =
            if stages.elements().iter().all(is_exact) { EXACT_BOUND } else { GENERAL_BOUND };
        let holds = largest <= bound_n;
        let verdict = format!(
            "at 1 kHz the force is within {:.3} mN of the converged solution (allowed: {:.1} mN)",
            1e3 * largest,
            1e3 * bound_n
        );
        Self { largest_error_n: largest, bound_n, holds, verdict }
    }
}

/// Displacements, m, of two cycles of 40 mm strokes at 80 mm/s with an acceleration of 2 m/s² at
/// their ends.
fn trapezoids() -> impl Iterator<Item = f64> {
    const SPEED: f64 = 0.08;
    const ACCELERATION: f64 = 2.0;
    const STROKE: f64 = 0.04;
    let ramp = SPEED / ACCELERATION;
    let duration = STROKE / SPEED + ramp;
    let steps = (duration / SAMPLE).round() as usize;
    let place = move |t: f64| {
        let (first, last) = (t.min(ramp), (t - (duration - ramp)).max(0.0));
        0.5 * ACCELERATION * first * first + SPEED * (t - first) - 0.5 * ACCELERATION * last * last
    };
    let moves = (0..steps).map(move |k| place((k + 1) as f64 * SAMPLE) - place(k as f64 * SAMPLE));
    let moves: Vec<f64> = moves.collect();
    [1.0, -1.0, 1.0, -1.0]
        .into_iter()
        .flat_map(move |s| moves.clone().into_iter().map(move |m| s * m))
}
