//! The single likelihood of all parameters that `identify` estimates, and its maximisation.
//!
//! # Data model
//! ```text
//! y_i = o + m·a_i + u_i·F_i(θ) + ε_i          reading i, N; other loads as in `trocar_recording::loads`
//! u_i = 1 + w_i·v_g + (1 − w_i)·v_(g−1)       friction scale; w_i = 1 − exp(−path since the reversal/ℓ)
//! v_g = Σ_k d_k·φ_k(g) + e_g                  stroke g: slow drift, and scatter between strokes
//! d_k ~ N(0, ω_k²)      e_g ~ N(0, τ²)      ε_i ~ N(0, σ²)
//! ```
//! F_i(θ) is the free-running simulation on the measured motion. Given θ, the model is linear in
//! all other parameters. The e_g are eliminated in closed form. Each reading depends on two
//! neighbouring strokes, so the equations of the e_g are tridiagonal. Clusters of strokes are
//! treated as independent; the stroke before the first one of a cluster has an e of its own. o, m
//! and d_k are columns of the normal equations. The cost is −2σ² times the log likelihood, less
//! constants:
//!
//! ```text
//! C(θ, o, m, d) = r'r − r'Z·P⁻¹·Z'r + Σ_j p_j·(θ_j − μ_j)²      N²      P = Z'Z + λ·I      λ = σ²/τ²      p_j = σ²/(prior variance)
//! r_i = y_i − o − m·a_i − (u_i without the e_g)·F_i             Z_ig = w_i·F_i in stroke g, (1 − w_i)·F_i in the next
//! ```
//! Of a seal that sticks and slips, runs begin at a reversal with the force F_0 of a reading, whose error
//! f·F_s, f ~ N(0, [`BEGIN_ERROR`]²), takes the place of the stroke before: Z = F_s·∂F_i/∂F_0. Such a run
//! ends with the reading at which the seal lets go, whose prediction is F_s.
//!
//! A stroke whose speed responds to its friction (a constant push) determines the shape of the
//! force but not its size: λ_g is 1e-6 of the stroke's own information there.
//!
//! # Intervals
//! Normal equations are stored for each cluster of strokes and nothing for each sample, so memory
//! does not grow with the recording. With cluster g left out the estimate moves to first order by
//! −(H − H_g)⁻¹·s_g. Its variance over clusters (jackknife) does not treat the samples of one
//! stroke as independent. A parameter that the data push against a bound is held there.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use trocar_model::{Direction, Friction};

use super::prior::{Kind, Prior};
use super::training::{INDEPENDENT, Run, Step, Training};
use trocar_recording::cancel;
use trocar_recording::loads::{Load, Loads};

/// Stopping criteria.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stop {
    /// Largest number of damped steps.
    pub(crate) iterations: usize,
    /// Relative decrease of the cost below which the fit has converged.
    pub(crate) fall: f64,
    /// Largest relative decrease that an undamped step may still predict at convergence; infinite
    /// if not required.
    pub(crate) promise: f64,
}

/// How a free parameter enters the prediction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Column {
    /// Through the simulated force, by a difference quotient.
    Simulated,
    /// Through the simulated force; its derivative is followed beside the simulation, with this
    /// number.
    Followed(usize),
    /// Sensor offset o.
    Offset,
    /// A load that is in the readings.
    Load(Load),
    /// Drift d_k of the friction scale.
    Drift(usize),
}

/// One free parameter: its value, the step of its difference quotient, its range, and how it
/// enters.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Free {
    /// What it is; `None` where no prior is declared for it.
    pub(crate) kind: Option<Kind>,
    pub(crate) value: f64,
    pub(crate) step: f64,
    pub(crate) low: f64,
    pub(crate) high: f64,
    /// Standard deviation of the prior about 0; infinite without a prior.
    pub(crate) expected: f64,
    pub(crate) column: Column,
}

impl Free {
    /// Its least and greatest value.
    pub(crate) fn range(&self) -> [f64; 2] {
        [self.low, self.high]
    }
}

/// The weakly informative priors of the free parameters `free`, in their order and without those of
/// the drift.
pub(super) fn weak_priors_of(free: &[Free]) -> Vec<Prior> {
    free.iter()
        .filter_map(|free| {
            free.kind.map(|kind| kind.weak().unwrap_or_else(|| Prior::about_zero(free.expected)))
        })
        .collect()
}

/// A model under trial: free parameters, and the model that they define.
pub(crate) trait Trial: Clone + Send + Sync {
    /// The model, ready to run.
    type Model: Friction<State: Send + Sync> + Send + Sync;
    /// Derivatives of the force that follow a simulation.
    type Followers: Send + Sync;

    /// The model; `None` where the parameters do not form a valid one.
    fn model(&self) -> Option<Self::Model>;
    /// The free parameters.
    fn free(&self) -> Vec<Free>;
    /// The trial with its free parameters replaced, each clamped to its range.
    fn with(&self, values: &[f64]) -> Self;
    /// The trial with its free parameters replaced without clamping: for the spread of an estimate,
    /// not for a model.
    fn with_any(&self, values: &[f64]) -> Self;
    /// The trial with parameters that have to be kept where they have to be.
    fn within(&self) -> Self {
        self.clone()
    }
    /// Sensor offset o, N.
    fn offset(&self) -> f64;
    /// Loads that are in the readings beside the force of the seal.
    fn loads(&self) -> Loads {
        Loads::default()
    }
    /// Drift amplitudes d_k.
    fn drift(&self) -> &[f64] {
        &[]
    }
    /// Change of a force, N, above which that of a free parameter by its step is a leap from one
    /// motion to another, as where a seal sticks and slips, and no derivative.
    fn leap(&self) -> f64 {
        f64::INFINITY
    }
    /// Force at which the model lets go in a direction, N, where that is a number of its own.
    fn limit(_model: &Self::Model, _direction: Direction) -> f64 {
        f64::NAN
    }
    /// The derivatives that can follow its simulation, at the start of a run.
    fn followers(&self) -> Self::Followers;
    /// Their values at the centres of the steps, a row for each, from the model's state.
    fn follow(
        followers: &mut Self::Followers,
        model: &Self::Model,
        state: &mut StateOf<Self>,
        steps: &[Step],
    ) -> DMatrix<f64>;
    /// Forces at the centres of the steps, N, a row for each model, starting from its state. The
    /// first `close` models differ little.
    fn forces(
        models: &[Self::Model],
        states: &mut [StateOf<Self>],
        _close: usize,
        steps: &[Step],
    ) -> DMatrix<f64> {
        each_alone(models, states, steps)
    }
}

/// The forces of models, each stepped on its own.
pub(super) fn each_alone<M>(models: &[M], states: &mut [M::State], steps: &[Step]) -> DMatrix<f64>
where
    M: Friction<State: Send + Sync> + Send + Sync,
{
    let of = |(model, state): (&M, &mut M::State)| {
        steps.iter().map(|step| seal_force(model, state, step)).collect::<Vec<_>>()
    };
    let rows: Vec<Vec<f64>> = models.par_iter().zip(states).map(of).collect();
    DMatrix::from_fn(models.len(), steps.len(), |k, i| rows[k][i])
}

/// The rows of `all`, and below them those of `more`.
pub(super) fn with_rows(all: DMatrix<f64>, more: &DMatrix<f64>) -> DMatrix<f64> {
    let (own, count) = (all.nrows(), more.nrows());
    let mut both = all.insert_rows(own, count, 0.0);
    both.rows_mut(own, count).copy_from(more);
    both
}

/// State of a trial's model.
pub(crate) type StateOf<T> = <<T as Trial>::Model as Friction>::State;

/// Steps simulated at a time: their forces, and the parts of a model that leads, stay in the cache of
/// a core.
pub(super) const BLOCK: usize = 512;

/// Result of a fit.
#[derive(Debug, Clone)]
pub(crate) struct Fitted<T> {
    pub(crate) best: T,
    /// Root mean square error, N, before and after, with the friction scale of each stroke removed.
    pub(crate) rms: [f64; 2],
    pub(crate) iterations: usize,
    pub(crate) converged: bool,
    /// Free parameters held at a bound.
    pub(crate) held: Vec<bool>,
    /// Whether the fit had a prior of the seal's parameters.
    pub(crate) has_prior: bool,
    /// Variance of the score by the model of the residuals; `None` where there is none.
    pub(crate) score_variance: Option<DMatrix<f64>>,
    pub(crate) normal: Normal,
}

/// Sums of Z over one stroke: e_g, e_(g−1), their product, and with the residual.
#[derive(Debug, Clone, Copy, Default)]
struct ScaleSums {
    own: f64,
    before: f64,
    mixed: f64,
    moment: f64,
    moment_before: f64,
}

impl ScaleSums {
    #[inline]
    fn add(&mut self, weight: f64, residual: f64, [own, before]: [f64; 2]) {
        self.own += weight * own * own;
        self.before += weight * before * before;
        self.mixed += weight * own * before;
        self.moment += weight * own * residual;
        self.moment_before += weight * before * residual;
    }
}

/// Sums of one stroke that the scatter of the strokes needs.
#[derive(Debug, Clone)]
struct StrokeSums {
    /// Σ x·Z: with e_g, with e_(g−1).
    cross: [DVector<f64>; 2],
    scale: ScaleSums,
}

/// Sums of one cluster at one parameter vector, before the scatter of the strokes is eliminated.
#[derive(Debug, Clone)]
struct ClusterSums {
    hessian: DMatrix<f64>,
    score: DVector<f64>,
    cost: f64,
    steps: f64,
    /// Number of its first stroke.
    first: usize,
    strokes: Vec<StrokeSums>,
}

impl ClusterSums {
    fn new(strokes: Range<usize>, p: usize) -> Self {
        let zeros = || DVector::zeros(p);
        Self {
            hessian: DMatrix::zeros(p, p),
            score: zeros(),
            cost: 0.0,
            steps: 0.0,
            first: strokes.start,
            strokes: strokes
                .map(|_| StrokeSums { cross: [zeros(), zeros()], scale: ScaleSums::default() })
                .collect(),
        }
    }
}

/// P of the strokes of one cluster and of the stroke before them, factored as L·D·L'.
struct Scatter {
    pivots: Vec<f64>,
    below: Vec<f64>,
    /// ln|P/λ|.
    determinant: f64,
}

impl Scatter {
    /// `sums` start with the empty sums of the stroke before; `first` is the number of the first of
    /// the others.
    fn new(sums: &[ScaleSums], first: usize, training: &Training, lambda: f64) -> Self {
        let mut factored = Self {
            pivots: Vec::with_capacity(sums.len()),
            below: vec![0.0; sums.len()],
            determinant: 0.0,
        };
        for k in 0..sums.len() {
            let square = sums[k].own + sums.get(k + 1).map_or(0.0, |next| next.before);
            let held = training.held(first, k, lambda);
            let is_scatter = held.is_some() && !training.begins(first, k);
            let held = held.unwrap_or(UNCONSTRAINED * square);
            let mut pivot = if square + held > 0.0 { square + held } else { 1.0 };
            if k > 0 {
                factored.below[k] = sums[k].mixed / factored.pivots[k - 1];
                pivot -= factored.below[k] * sums[k].mixed;
            }
            factored.pivots.push(pivot);
            factored.determinant += if is_scatter { (pivot / lambda).ln() } else { 0.0 };
        }
        factored
    }

    /// P⁻¹ times a vector.
    fn solve(&self, mut values: Vec<f64>) -> Vec<f64> {
        for k in 1..values.len() {
            values[k] -= self.below[k] * values[k - 1];
        }
        values.iter_mut().zip(&self.pivots).for_each(|(v, pivot)| *v /= pivot);
        for k in (1..values.len()).rev() {
            values[k - 1] -= self.below[k] * values[k];
        }
        values
    }
}

/// Z' times a vector, from the contributions of each stroke to itself (`own`) and to the one before
/// (`before`); the first element belongs to the stroke before all.
fn gathered(count: usize, own: impl Fn(usize) -> f64, before: impl Fn(usize) -> f64) -> Vec<f64> {
    (0..=count)
        .map(|k| if k > 0 { own(k - 1) } else { 0.0 } + if k < count { before(k) } else { 0.0 })
        .collect()
}

/// The sums of the strokes of one cluster, preceded by the empty sums of the stroke before.
fn with_stroke_before(sums: impl Iterator<Item = ScaleSums>) -> Vec<ScaleSums> {
    std::iter::once(ScaleSums::default()).chain(sums).collect()
}

/// Regularisation of the scale of a stroke whose size is no datum, as a fraction of its own
/// information.
const UNCONSTRAINED: f64 = 1e-6;

/// Friction scale of one stroke: v_g from the data and the prior.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct StrokeScale {
    /// v_g, with e_g shrunk by its prior.
    pub(crate) value: f64,
    /// v_g from the stroke's own readings alone, and their information Σ Z², N².
    pub(crate) own: f64,
    pub(crate) information: f64,
    /// Where the stroke is the first of its cluster: e of the one before, or the error of the force at
    /// which it begins.
    before: f64,
}

/// Normal equations at one parameter vector, with the scatter of the strokes eliminated.
#[derive(Debug, Clone)]
pub(crate) struct Normal {
    /// H and s of each cluster.
    hessians: Vec<DMatrix<f64>>,
    scores: Vec<DVector<f64>>,
    /// C of each cluster, without the prior term.
    costs: Vec<f64>,
    /// Each free parameter less its prior mean, and the precision of its prior.
    prior: Vec<(f64, f64)>,
    /// Steps that count.
    steps: f64,
    /// Scale of each stroke.
    pub(crate) scales: Vec<StrokeScale>,
    clusters: Vec<ClusterSums>,
}

impl Normal {
    /// C(θ, o, m, d).
    fn cost(&self) -> f64 {
        self.data_cost()
            + self.prior.iter().map(|(off, precision)| precision * off * off).sum::<f64>()
    }

    fn data_cost(&self) -> f64 {
        self.costs.iter().sum()
    }

    /// H and s of all clusters, with the priors.
    pub(super) fn sums(&self) -> Sums {
        let p = self.scores[0].len();
        let mut hessian = self.hessians.iter().fold(DMatrix::zeros(p, p), |a, b| a + b);
        let mut score = self.scores.iter().fold(DVector::zeros(p), |a, b| a + b);
        for (j, (off, precision)) in self.prior.iter().enumerate() {
            hessian[(j, j)] += precision;
            score[j] -= precision * off;
        }
        (hessian, score)
    }
}

/// Force of the seal at the centre of a step, N.
fn seal_force<M: Friction>(model: &M, state: &mut M::State, step: &Step) -> f64 {
    let before = M::force(state);
    step.at_centre(before, model.step(state, step.displacement, step.duration))
}

/// Initial state of a run: at rest at its first reading, and `more` N.
fn start<T: Trial>(trial: &T, model: &T::Model, run: &Run, more: f64) -> StateOf<T> {
    let Loads([loads @ .., gain]) = trial.loads();
    let [effects @ .., pressure] = run.first_effects;
    let beside: f64 = loads.iter().zip(effects).map(|(load, effect)| load * effect).sum();
    let force = (run.first_force - trial.offset() - beside) / (1.0 + gain * pressure);
    match run.after {
        Some(direction) => model.rest_after(direction, force + more),
        None => model.rest_at_force(force),
    }
}

/// Scale of each stroke without its own scatter: the drift.
fn drifts<T: Trial>(training: &Training, trial: &T) -> Vec<f64> {
    let basis = &training.scale.basis;
    (0..training.strokes.len())
        .map(|g| trial.drift().iter().zip(basis).map(|(d, phi)| d * phi[g]).sum())
        .collect()
}

/// Error of the force at which a run begins that is known from a reading, as a part of the static force:
/// the scale of the stroke before and the inertia of what turns are in that reading.
const BEGIN_ERROR: f64 = 0.1;
/// Step of that force for its derivative, as a part of [`Trial::leap`], and that as a part of the static
/// force.
const BEGIN_STEP: f64 = 1e-2;
pub(super) const LEAP: f64 = 1e-2;

/// Quantities that do not depend on the scatter of the strokes.
struct Predictor<'a> {
    training: &'a Training,
    drift: Vec<f64>,
    offset: f64,
    loads: Loads,
    leap: f64,
}

impl<'a> Predictor<'a> {
    fn new<T: Trial>(training: &'a Training, trial: &T) -> Self {
        Self {
            training,
            drift: drifts(training, trial),
            offset: trial.offset(),
            loads: trial.loads(),
            leap: trial.leap(),
        }
    }

    /// w_i·x_g + (1 − w_i)·x_(g−1).
    #[inline]
    fn blended(step: &Step, of: impl Fn(usize) -> f64) -> f64 {
        let own = step.blend * of(step.stroke);
        if step.blend < 1.0 { own + (1.0 - step.blend) * of(step.stroke - 1) } else { own }
    }

    /// Gain of the seal's force by the pressure of the gas.
    fn gain(&self, step: &Step) -> f64 {
        1.0 + self.loads[Load::Pressure] * step.effects[Load::Pressure as usize]
    }

    /// (r_i, u_i without the e_g, Z_i) at the simulated force.
    #[inline]
    fn residual(&self, step: &Step, force: f64) -> (f64, f64, [f64; 2]) {
        let Loads([loads @ .., _]) = self.loads;
        let beside = loads.iter().zip(&step.effects).map(|(load, effect)| load * effect);
        let reading = beside.fold(step.force - self.offset, |reading, own| reading - own);
        let gain = self.gain(step);
        let force = gain * force;
        if !self.training.scale.is_free {
            return (reading - force, gain, [0.0; 2]);
        }
        let scale = 1.0 + Self::blended(step, |g| self.drift[g]);
        (reading - scale * force, gain * scale, [step.blend * force, (1.0 - step.blend) * force])
    }

    /// u_i·∂F_i/∂F_0·F_s, N: by the force F_0 at which the run begins, from the `other` force where it
    /// began higher.
    #[inline]
    fn of_begin(&self, step: &Step, scale: f64, force: f64, other: f64) -> f64 {
        let change = other - force;
        if self.training.strokes[step.stroke].begins && change.abs() <= self.leap {
            scale * change / (BEGIN_STEP * LEAP)
        } else {
            0.0
        }
    }

    /// (r_i, Z_i) of the step `i` of a block, and its row of the derivatives of the prediction.
    fn row(
        &self,
        Block { steps, lanes, columns: Columns { sources, begun }, before }: &Block,
        i: usize,
        row: &mut [f64],
    ) -> (f64, [f64; 2]) {
        let (step, force) = (&steps[i], lanes[(0, i)]);
        // The force at which the seal lets go is none of the deformation.
        let deforms = if step.limit.is_none() { 1.0 } else { 0.0 };
        let change = force - if i > 0 { lanes[(0, i - 1)] } else { *before };
        let rate = deforms * change / step.duration;
        let (residual, scale, mut z) = self.residual(step, force);
        let of_begin =
            begun.map_or(0.0, |lane| self.of_begin(step, scale, force, lanes[(lane, i)]));
        if self.training.scale.is_free {
            z[1] += of_begin;
        }
        let basis = &self.training.scale.basis;
        for (slot, source) in row.iter_mut().zip(sources) {
            *slot = match source {
                Source::Difference { lane, step } => {
                    let change = lanes[(*lane, i)] - force;
                    if change.abs() <= self.leap { scale * change / step } else { 0.0 }
                }
                Source::Secant(lane) => scale * (lanes[(*lane, i)] - force),
                // It is in the reading at which a run begins, too.
                Source::Offset => 1.0 - of_begin * LEAP / self.leap,
                Source::Load(Load::Pressure) => {
                    scale / self.gain(step) * force * step.effects[Load::Pressure as usize]
                }
                Source::Load(load) => step.effects[*load as usize],
                Source::Delay => scale * rate,
                Source::Drift(k) => self.gain(step) * force * Self::blended(step, |g| basis[*k][g]),
                Source::Followed(lane) => deforms * scale * lanes[(*lane, i)],
            };
        }
        (residual, z)
    }
}

/// C of a trial; infinite where it is not a valid model.
pub(crate) fn cost<T: Trial>(training: &Training, trial: &T) -> f64 {
    let alone = Simulations::alone(training, trial);
    alone.map_or(f64::INFINITY, |alone| alone.normal_equations(training, trial).cost())
}

/// A column that is no free parameter of the trial: the secant to another trial, or the rate of the
/// simulated force.
#[derive(Clone)]
pub(crate) enum Extra<T> {
    /// u·(F of the other trial − F).
    Secant(T),
    /// What one unit of a load does.
    Load(Load),
    /// u·dF/dt: position delay of 1 s.
    Delay,
    /// u times the derivative with this number that follows the simulation.
    Followed(usize),
}

/// Source of a column of the normal equations.
enum Source {
    /// Difference to simulation `lane`, divided by a step.
    Difference {
        lane: usize,
        step: f64,
    },
    /// Difference to simulation `lane`.
    Secant(usize),
    Offset,
    Load(Load),
    Delay,
    Drift(usize),
    /// Derivative of the simulated force in `lane`, after the simulations.
    Followed(usize),
}

/// Steps that are simulated at a time, and what is.
struct Block<'a> {
    steps: &'a [Step],
    lanes: &'a DMatrix<f64>,
    columns: &'a Columns,
    /// The force simulated before them, N.
    before: f64,
}

/// The simulations that the columns need (the trial's own first), and the columns.
struct Simulations<T: Trial> {
    trials: Vec<T>,
    models: Vec<T::Model>,
    /// Number of leading simulations that differ little.
    close: usize,
    columns: Columns,
}

/// What the rows of the normal equations are made of.
struct Columns {
    sources: Vec<Source>,
    /// The simulation that begins at another force where that is known from a reading.
    begun: Option<usize>,
}

impl<T: Trial> Simulations<T> {
    /// `None` where one of them is not a valid model.
    fn new(training: &Training, trial: &T, extra: &[Extra<T>]) -> Option<Self> {
        let free = trial.free();
        let values: Vec<f64> = free.iter().map(|f| f.value).collect();
        let mut trials = vec![trial.clone()];
        let mut sources = Vec::new();
        for (j, f) in free.iter().enumerate() {
            sources.push(match f.column {
                Column::Offset => Source::Offset,
                Column::Load(load) => Source::Load(load),
                Column::Drift(k) => Source::Drift(k),
                Column::Followed(k) => Source::Followed(k),
                Column::Simulated => {
                    // Step away from a bound that lies within the step.
                    let step = if f.value + f.step > f.high { -f.step } else { f.step };
                    let mut changed = values.clone();
                    changed[j] += step;
                    trials.push(trial.with(&changed));
                    Source::Difference { lane: trials.len() - 1, step }
                }
            });
        }
        let begun = Self::begun(training, &mut trials);
        let close = trials.len();
        for column in extra {
            sources.push(match column {
                Extra::Secant(other) => {
                    trials.push(other.clone());
                    Source::Secant(trials.len() - 1)
                }
                Extra::Load(load) => Source::Load(*load),
                Extra::Delay => Source::Delay,
                Extra::Followed(k) => Source::Followed(*k),
            });
        }
        for source in &mut sources {
            if let Source::Followed(lane) = source {
                *lane += trials.len();
            }
        }
        Self::of(trials, close, Columns { sources, begun })
    }

    /// Without columns.
    fn alone(training: &Training, trial: &T) -> Option<Self> {
        let mut trials = vec![trial.clone()];
        let begun = Self::begun(training, &mut trials);
        Self::of(trials, 0, Columns { sources: Vec::new(), begun })
    }

    /// The place of one more simulation, where a run begins at a force that is known from a reading.
    fn begun(training: &Training, trials: &mut Vec<T>) -> Option<usize> {
        let is_known = training.runs.iter().any(|run| run.after.is_some());
        trials.extend(is_known.then(|| trials[0].clone()));
        is_known.then(|| trials.len() - 1)
    }

    fn of(trials: Vec<T>, close: usize, columns: Columns) -> Option<Self> {
        let models = trials.iter().map(T::model).collect::<Option<Vec<_>>>()?;
        Some(Self { trials, models, close, columns })
    }

    /// The normal equations at a trial in these columns, of which those of its free parameters come first.
    fn normal_equations(&self, training: &Training, trial: &T) -> Normal {
        let p = self.columns.sources.len();
        let predictor = Predictor::new(training, trial);
        let mut clusters: Vec<ClusterSums> =
            training.cluster_strokes().map(|strokes| ClusterSums::new(strokes, p)).collect();
        let mut rest = clusters.as_mut_slice();
        let mut runs: Vec<(&Run, &mut [ClusterSums])> = Vec::with_capacity(training.runs.len());
        for run in &training.runs {
            let count = rest.iter().filter(|c| c.first < run.strokes().end).count();
            let (own, others) = rest.split_at_mut(count);
            runs.push((run, own));
            rest = others;
        }
        runs.into_par_iter().for_each(|(run, clusters)| sum_over(&predictor, self, run, clusters));
        training.eliminated(clusters, &predictor.drift, prior(training, trial))
    }
}

/// Simulations of a run, and the derivatives that follow the first of them.
struct Running<'a, T: Trial> {
    simulations: &'a Simulations<T>,
    states: Vec<StateOf<T>>,
    followed: Option<(T::Followers, StateOf<T>)>,
}

impl<'a, T: Trial> Running<'a, T> {
    fn new(simulations: &'a Simulations<T>, run: &Run) -> Self {
        let Simulations { trials, models, columns: Columns { sources, begun }, .. } = simulations;
        let of = |(k, (m, t)): (usize, (&T::Model, &T))| {
            start(t, m, run, if *begun == Some(k) { BEGIN_STEP * t.leap() } else { 0.0 })
        };
        let states: Vec<_> = models.iter().zip(trials).enumerate().map(of).collect();
        let is_asked = sources.iter().any(|source| matches!(source, Source::Followed(_)));
        let followed = is_asked.then(|| (trials[0].followers(), states[0]));
        Self { simulations, states, followed }
    }

    /// Forces of the simulations over the next steps, and below them the derivatives.
    fn over(&mut self, steps: &[Step]) -> DMatrix<f64> {
        cancel::check();
        let Self { simulations: Simulations { models, close, .. }, states, followed } = self;
        let mut forces = || {
            let mut all = T::forces(models, states, *close, steps);
            for (i, step) in steps.iter().enumerate() {
                let Some(direction) = step.limit else { continue };
                let own = |(force, model): (&mut f64, _)| *force = T::limit(model, direction);
                all.column_mut(i).iter_mut().zip(models).for_each(own);
            }
            all
        };
        let Some((followers, state)) = followed else { return forces() };
        let follow = || T::follow(followers, &models[0], state, steps);
        let (forces, derivatives) = rayon::join(forces, follow);
        with_rows(forces, &derivatives)
    }
}

/// Each free parameter less its prior mean, and p_j: the precision of its prior.
fn prior<T: Trial>(training: &Training, trial: &T) -> Vec<(f64, f64)> {
    let of = |(j, free): (usize, &Free)| {
        let Prior { mean, deviation } = match (free.column, training.prior.get(j)) {
            (Column::Drift(k), _) => Prior::about_zero(training.scale.expected[k]),
            (_, Some(prior)) => *prior,
            (_, None) => Prior::about_zero(free.expected),
        };
        (free.value - mean, training.variance / deviation.powi(2))
    };
    trial.free().iter().enumerate().map(of).collect()
}

/// The normal equations at a trial: columns for its free parameters, by difference quotients over
/// their steps or followed beside the simulation, and after them columns for `extra`.
fn normal_equations<T: Trial>(
    training: &Training,
    trial: &T,
    extra: &[Extra<T>],
) -> Option<Normal> {
    Some(Simulations::new(training, trial, extra)?.normal_equations(training, trial))
}

/// Adds the steps of a run to the sums of its clusters.
fn sum_over<T: Trial>(
    predictor: &Predictor,
    simulations: &Simulations<T>,
    run: &Run,
    clusters: &mut [ClusterSums],
) {
    let columns = &simulations.columns;
    let mut running = Running::new(simulations, run);
    let mut blocks = run.steps.chunks(BLOCK).peekable();
    let mut before = 0.0;
    let mut next = blocks.peek().map(|block| running.over(block));
    // While one block is added, the next is simulated.
    while let (Some(steps), Some(lanes)) = (blocks.next(), next) {
        let following = blocks.peek();
        let block = Block { steps, lanes: &lanes, columns, before };
        let add = || accumulate(predictor, &block, clusters);
        next = rayon::join(|| following.map(|block| running.over(block)), add).0;
        before = lanes[(0, steps.len() - 1)];
    }
}

/// One step as the likelihood sees it, at given parameters.
#[derive(Debug, Clone)]
pub(crate) struct Row {
    /// Derivatives of the prediction with respect to the free parameters.
    pub(crate) derivatives: Vec<f64>,
    /// r_i, N.
    pub(crate) residual: f64,
    /// Z_i, N: its own stroke, and the one before.
    pub(crate) scale: [f64; 2],
    pub(crate) force: f64,
    pub(crate) weight: f64,
    pub(crate) stroke: usize,
    /// Number of the piece of a recording.
    pub(crate) run: usize,
    /// Displacement, m, and duration, s, of the step.
    pub(crate) displacement: f64,
    pub(crate) duration: f64,
    /// Time of its end since the beginning of the run, s.
    pub(crate) time: f64,
}

impl Row {
    /// Samples of its step, from the weight that they have together.
    pub(super) fn samples(&self) -> f64 {
        self.weight / (1.0 - self.weight / INDEPENDENT).max(1e-3)
    }
}

/// The steps with a weight, in order, at the parameters of `trial`; `None` where it is not a valid
/// model.
pub(crate) fn rows<T: Trial>(training: &Training, trial: &T) -> Option<Vec<Row>> {
    let simulations = Simulations::new(training, trial, &[])?;
    let columns = &simulations.columns;
    let predictor = Predictor::new(training, trial);
    let of_run = |(number, run): (usize, &Run)| {
        let lanes = Running::new(&simulations, run).over(&run.steps);
        let mut ends = vec![0.0; run.steps.len()];
        let mut time = 0.0;
        for (end, step) in ends.iter_mut().zip(&run.steps) {
            time += step.duration;
            *end = time;
        }
        let block = Block { steps: &run.steps, lanes: &lanes, columns, before: lanes[(0, 0)] };
        let of_step = |i: usize| {
            let (step, mut derivatives) = (&run.steps[i], vec![0.0; columns.sources.len()]);
            let (residual, scale) = predictor.row(&block, i, &mut derivatives);
            Row {
                derivatives,
                residual,
                scale,
                force: lanes[(0, i)],
                weight: step.weight,
                stroke: step.stroke,
                run: number,
                displacement: step.displacement,
                duration: step.duration,
                time: ends[i],
            }
        };
        (0..run.steps.len()).filter(|i| run.steps[*i].weight > 0.0).map(of_step).collect::<Vec<_>>()
    };
    Some(training.runs.iter().enumerate().flat_map(of_run).collect())
}

/// Adds the steps of a block to the sums of its clusters, among those of a run.
fn accumulate(predictor: &Predictor, block: &Block, clusters: &mut [ClusterSums]) {
    let from_stroke = |stroke: usize| block.steps.partition_point(|step| step.stroke < stroke);
    clusters.par_iter_mut().for_each(|cluster| {
        let range = from_stroke(cluster.first)..from_stroke(cluster.first + cluster.strokes.len());
        if !range.is_empty() {
            accumulate_cluster(predictor, block, range, cluster);
        }
    });
}

/// Steps whose products are summed at a time: the sums are read and written once for all of them.
const AT_ONCE: usize = 4;

/// The steps `range` of a block, all within one cluster.
fn accumulate_cluster(
    predictor: &Predictor,
    block: &Block,
    range: Range<usize>,
    cluster: &mut ClusterSums,
) {
    let (p, steps) = (block.columns.sources.len(), block.steps);
    let mut rows = vec![0.0; AT_ONCE * p];
    let mut weights = [0.0; AT_ONCE];
    let counted: Vec<usize> = range.filter(|i| steps[*i].weight > 0.0).collect();
    for all in counted.chunks(AT_ONCE) {
        weights.fill(0.0);
        for (k, i) in all.iter().enumerate() {
            let (step, row) = (&steps[*i], &mut rows[k * p..(k + 1) * p]);
            let (residual, z) = predictor.row(block, *i, row);
            let weight = step.weight;
            weights[k] = weight;
            cluster.steps += step.independent;
            cluster.cost += weight * residual * residual;
            let stroke = &mut cluster.strokes[step.stroke - cluster.first];
            stroke.scale.add(weight, residual, z);
            let [with_own, with_before] = &mut stroke.cross;
            for (values, by) in
                [(&mut cluster.score, residual), (with_own, z[0]), (with_before, z[1])]
            {
                let scaled = weight * by;
                values.iter_mut().zip(&*row).for_each(|(sum, a)| *sum += scaled * a);
            }
        }
        add_products(cluster.hessian.as_mut_slice(), &rows, weights);
    }
}

/// Adds Σ w·x·x' of [`AT_ONCE`] rows x to the lower triangle, column by column.
fn add_products(hessian: &mut [f64], rows: &[f64], weights: [f64; AT_ONCE]) {
    let p = rows.len() / AT_ONCE;
    let [a, b, c, d]: [&[f64]; AT_ONCE] = std::array::from_fn(|k| &rows[k * p..(k + 1) * p]);
    for j in 0..p {
        let [wa, wb, wc, wd] =
            [weights[0] * a[j], weights[1] * b[j], weights[2] * c[j], weights[3] * d[j]];
        if [wa, wb, wc, wd] == [0.0; AT_ONCE] {
            continue;
        }
        let column = &mut hessian[j * p + j..(j + 1) * p];
        let others = a[j..].iter().zip(&b[j..]).zip(c[j..].iter().zip(&d[j..]));
        for (sum, ((a, b), (c, d))) in column.iter_mut().zip(others) {
            *sum += (wa * a + wb * b) + (wc * c + wd * d);
        }
    }
}

impl Training {
    /// Whether the scale `k` of those of a cluster with the first stroke `first`, after that of the stroke
    /// before, is the error of the reading at which a run begins.
    fn begins(&self, first: usize, k: usize) -> bool {
        k == 0 && self.strokes[first].begins
    }

    /// The precision of that scale times σ², N²; `None` where its size is no datum.
    fn held(&self, first: usize, k: usize, lambda: f64) -> Option<f64> {
        if self.begins(first, k) {
            return Some(self.variance / (BEGIN_ERROR * BEGIN_ERROR));
        }
        let stroke = (first + k).checked_sub(1);
        let is_unconstrained = stroke.is_some_and(|g| self.scale.is_unconstrained(g));
        (!is_unconstrained).then_some(lambda)
    }

    /// W·(x − Z·P⁻¹·Z'Wx) of the steps of a cluster with the first stroke `first`; adds the variance
    /// of the score that the scatter of their strokes makes to `sum`.
    pub(super) fn scattered(
        &self,
        rows: &[Row],
        first: usize,
        sum: &mut DMatrix<f64>,
    ) -> Vec<DVector<f64>> {
        let p = sum.nrows();
        let x = |row: &Row| DVector::from_column_slice(&row.derivatives[..p]);
        if !self.scale.is_free {
            return rows.iter().map(|row| row.weight * x(row)).collect();
        }
        let count = rows.last().map_or(0, |row| row.stroke - first + 1);
        let mut scales = vec![ScaleSums::default(); count];
        // Columns of Z'WX: the stroke before, and those of the cluster.
        let mut cross = DMatrix::zeros(p, count + 1);
        for row in rows {
            let k = row.stroke - first;
            scales[k].add(row.weight, 0.0, row.scale);
            for (column, z) in [(k + 1, row.scale[0]), (k, row.scale[1])] {
                cross.column_mut(column).axpy(row.weight * z, &x(row), 1.0);
            }
        }
        let with_before = with_stroke_before(scales.into_iter());
        let factored = Scatter::new(&with_before, first, self, self.scale.lambda);
        let mut solved = cross.clone();
        for j in 0..p {
            let row = factored.solve(cross.row(j).iter().copied().collect());
            row.into_iter().enumerate().for_each(|(k, value)| solved[(j, k)] = value);
        }
        let moved = |row: &Row| {
            let k = row.stroke - first;
            let all =
                x(row) - solved.column(k + 1) * row.scale[0] - solved.column(k) * row.scale[1];
            row.weight * all
        };
        // X̃'WZ is λ·X'WZ·P⁻¹, and τ² = σ²/λ.
        for (k, own) in solved.column_iter().enumerate() {
            if let Some(held) = self.held(first, k, self.scale.lambda) {
                sum.ger(self.variance * held, &own, &own, 1.0);
            }
        }
        rows.iter().map(moved).collect()
    }

    /// The normal equations with the scatter of the strokes eliminated, summed by cluster.
    fn eliminated(
        &self,
        mut clusters: Vec<ClusterSums>,
        drift: &[f64],
        prior: Vec<(f64, f64)>,
    ) -> Normal {
        clusters.iter_mut().for_each(|c| c.hessian.fill_upper_triangle_with_lower_triangle());
        let mut normal = Normal {
            hessians: Vec::with_capacity(clusters.len()),
            scores: Vec::with_capacity(clusters.len()),
            costs: Vec::with_capacity(clusters.len()),
            prior,
            steps: clusters.iter().map(|c| c.steps).sum(),
            scales: Vec::with_capacity(self.strokes.len()),
            clusters: Vec::new(),
        };
        for sums in &clusters {
            let cluster = Cluster::new(sums, self, self.scale.lambda);
            let scatters = sums.strokes.iter().zip(&cluster.scatter);
            for (drift, (stroke, scatter)) in drift[sums.first..].iter().zip(scatters) {
                let sums = stroke.scale;
                let own = if sums.own > 0.0 { sums.moment / sums.own } else { 0.0 };
                let value = if self.scale.is_free { drift + scatter } else { 0.0 };
                let (own, information) = (drift + own, sums.own);
                normal.scales.push(StrokeScale { value, own, information, before: 0.0 });
            }
            if self.scale.is_free {
                normal.scales[sums.first].before = cluster.before;
            }
            normal.hessians.push(cluster.hessian);
            normal.scores.push(cluster.score);
            normal.costs.push(cluster.cost);
        }
        normal.clusters = clusters;
        normal
    }
}

/// Normal equations of one cluster, with the scatter of its strokes eliminated.
struct Cluster {
    hessian: DMatrix<f64>,
    score: DVector<f64>,
    cost: f64,
    /// e_g of its strokes, and of the one before.
    scatter: Vec<f64>,
    before: f64,
    /// ln|P/λ|.
    determinant: f64,
}

impl Cluster {
    fn new(sums: &ClusterSums, training: &Training, lambda: f64) -> Self {
        let ClusterSums { strokes, first, .. } = sums;
        let (count, p) = (strokes.len(), sums.score.len());
        let mut cluster = Self {
            hessian: sums.hessian.clone(),
            score: sums.score.clone(),
            cost: sums.cost,
            scatter: vec![0.0; count],
            before: 0.0,
            determinant: 0.0,
        };
        if !training.scale.is_free {
            return cluster;
        }
        let with_before = with_stroke_before(strokes.iter().map(|s| s.scale));
        let factored = Scatter::new(&with_before, *first, training, lambda);
        let moments =
            gathered(count, |k| strokes[k].scale.moment, |k| strokes[k].scale.moment_before);
        let scatter = factored.solve(moments.clone());
        let cross: Vec<Vec<f64>> = (0..p)
            .map(|j| gathered(count, |k| strokes[k].cross[0][j], |k| strokes[k].cross[1][j]))
            .collect();
        let solved: Vec<Vec<f64>> = cross.iter().map(|c| factored.solve(c.clone())).collect();
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        for (i, own) in cross.iter().enumerate() {
            cluster.score[i] -= dot(own, &scatter);
            for (j, other) in solved.iter().enumerate().take(i + 1) {
                let product = dot(own, other);
                cluster.hessian[(i, j)] -= product;
                cluster.hessian[(j, i)] = cluster.hessian[(i, j)];
            }
        }
        cluster.cost -= dot(&moments, &scatter);
        (cluster.before, cluster.scatter) = (scatter[0], scatter[1..].to_vec());
        cluster.determinant = factored.determinant;
        cluster
    }
}

/// Solves (H + λ·diag H)·δ = s for each column s, scaled to a unit diagonal. A parameter that has no
/// influence or is held does not change.
pub(crate) fn damped_steps(
    hessian: &DMatrix<f64>,
    scores: &DMatrix<f64>,
    lambda: f64,
    held: &[bool],
) -> Option<DMatrix<f64>> {
    let p = hessian.nrows();
    let moves = |j: usize| hessian[(j, j)] > 0.0 && !held[j];
    let inverse =
        DVector::from_fn(p, |j, _| if moves(j) { 1.0 / hessian[(j, j)].sqrt() } else { 0.0 });
    let scaled = DMatrix::from_fn(p, p, |i, j| {
        if i == j { 1.0 + lambda } else { hessian[(i, j)] * (inverse[i] * inverse[j]) }
    });
    let scale = DMatrix::from_diagonal(&inverse);
    Some(&scale * scaled.cholesky()?.solve(&(&scale * scores)))
}

/// The same for one s.
pub(crate) fn damped_step(
    hessian: &DMatrix<f64>,
    score: &DVector<f64>,
    lambda: f64,
    held: &[bool],
) -> Option<DVector<f64>> {
    let scores = DMatrix::from_column_slice(score.len(), 1, score.as_slice());
    Some(damped_steps(hessian, &scores, lambda, held)?.column(0).into_owned())
}

/// H and s.
type Sums = (DMatrix<f64>, DVector<f64>);

/// The damped step within the ranges: parameters at a bound that would leave it are held, too, and
/// the others are solved again. The columns of the parameters come first.
fn step_within(
    normal: &Sums,
    free: &[Free],
    lambda: f64,
    held: &mut [bool],
) -> Option<DVector<f64>> {
    loop {
        let delta = damped_step(&normal.0, &normal.1, lambda, held)?;
        let leaves = |j: usize| {
            let Free { value, low, high, .. } = free[j];
            (value <= low && delta[j] < 0.0) || (value >= high && delta[j] > 0.0)
        };
        let leaving: Vec<usize> = (0..free.len()).filter(|j| !held[*j] && leaves(*j)).collect();
        if leaving.is_empty() {
            return Some(delta);
        }
        leaving.into_iter().for_each(|j| held[j] = true);
    }
}

/// Damping above which no step is tried.
const HIGHEST_DAMPING: f64 = 1e4;
/// Damping below which a step that fails would hardly change.
const LEAST_TRIED: f64 = 1e-3;
/// Damping at the start of a fit, and the least after steps that succeed: with more of it, fits of
/// two stages end in other minima.
const FIRST_DAMPING: f64 = 1e-5;
const LEAST_DAMPING: f64 = 1e-8;
/// Part of the fall at which a fit has converged that a step must promise to be tried.
const NEGLIGIBLE: f64 = 0.1;

/// Factor on the damping after a step whose cost fell by `part` of what the linear model promises.
fn relaxed(part: f64, is_first: bool) -> f64 {
    match part {
        part if part < 0.25 => 4.0,
        part if part < 0.75 => 1.0,
        _ if is_first => 0.05,
        _ => 0.5,
    }
}

/// Fall of C along the step `delta`, damped by `lambda`, if the model were linear.
fn fall_along((hessian, score): &Sums, delta: &DVector<f64>, lambda: f64) -> f64 {
    delta.dot(score)
        + lambda * delta.iter().enumerate().map(|(j, d)| hessian[(j, j)] * d * d).sum::<f64>()
}

/// A step that lowers C: its trial, C and the normal equations there, and the damping for the next.
struct Accepted<T> {
    trial: T,
    cost: f64,
    normal: Normal,
    lambda: f64,
}

/// The first step from `best` that lowers C below `before`, with the damping increased from
/// `lambda` until one does; `None` where none promises a fall above `least`.
fn step_down<T: Trial>(
    training: &Training,
    (best, before): (&T, f64),
    sums: &Sums,
    (mut lambda, least): (f64, f64),
    held: &mut [bool],
) -> Option<Accepted<T>> {
    let free = best.free();
    let mut is_first = true;
    while lambda < HIGHEST_DAMPING {
        held.fill(false);
        if let Some(delta) = step_within(sums, &free, lambda, held) {
            let promised = fall_along(sums, &delta, lambda);
            if promised < least {
                return None;
            }
            let moved: Vec<f64> = free.iter().zip(delta.iter()).map(|(f, d)| f.value + d).collect();
            let trial = best.with(&moved);
            // After steps that succeeded the next one mostly does, and its normal equations give C, too.
            let is_sure = is_first && lambda <= FIRST_DAMPING;
            let at_once = if is_sure { normal_equations(training, &trial, &[]) } else { None };
            let cost = match &at_once {
                Some(normal) => normal.cost(),
                None => cost(training, &trial),
            };
            if cost < before {
                let lambda = lambda * relaxed((before - cost) / promised, is_first);
                let normal = at_once.or_else(|| normal_equations(training, &trial, &[]))?;
                return Some(Accepted { trial, cost, normal, lambda });
            }
        }
        (lambda, is_first) = ((10.0 * lambda).max(LEAST_TRIED), false);
    }
    None
}

/// Steps in a row with a negligible fall after which a larger one that is promised is not waited for.
const UNKEPT: usize = 1;

/// Minimises C from `from`; `None` when `from` is not a valid model.
pub(crate) fn fit<T: Trial>(training: &Training, from: &T, stop: Stop) -> Option<Fitted<T>> {
    let mut best = from.within();
    let mut normal = normal_equations(training, &best, &[])?;
    let first = normal.data_cost();
    let (mut lambda, mut iterations, mut converged) = (FIRST_DAMPING, 0, false);
    let mut small = 0;
    let mut held = vec![false; best.free().len()];
    while iterations < stop.iterations && !converged {
        iterations += 1;
        let before = normal.cost();
        let limits = (lambda, NEGLIGIBLE * stop.fall * before);
        let down = step_down(training, (&best, before), &normal.sums(), limits, &mut held);
        let Some(Accepted { trial, cost, normal: there, lambda: next }) = down else {
            converged = true;
            break;
        };
        (best, normal, lambda) = (trial, there, next.max(LEAST_DAMPING));
        // With a scale for each stroke, the common force of all strokes is a flat direction: a
        // small decrease does not indicate convergence.
        // A promise that the next steps did not keep is none: there the model is not linear.
        small = if cost > (1.0 - stop.fall) * before { small + 1 } else { 0 };
        converged = small > UNKEPT
            || small > 0
                && !(stop.promise.is_finite() && promised(&normal, &best.free()) > stop.promise);
    }
    held.fill(false);
    step_within(&normal.sums(), &best.free(), LEAST_DAMPING, &mut held);
    let rms = [first, normal.data_cost()].map(|c| (c / normal.steps.max(f64::MIN_POSITIVE)).sqrt());
    let has_prior = !training.prior.is_empty();
    let ripple = training.ripple.as_ref().filter(|_| stop.iterations > 0);
    let score_variance = ripple.and_then(|ripple| ripple.score_variance(training, &best));
    Some(Fitted { best, rms, iterations, converged, held, has_prior, score_variance, normal })
}

/// Fraction of C that an undamped step would remove if the model were linear.
fn promised(normal: &Normal, free: &[Free]) -> f64 {
    let sums = normal.sums();
    let fall = step_within(&sums, free, LEAST_DAMPING, &mut vec![false; free.len()])
        .map_or(0.0, |delta| fall_along(&sums, &delta, 0.0));
    fall / normal.cost().max(f64::MIN_POSITIVE)
}

impl<T: Trial> Fitted<T> {
    /// The smallest C found.
    pub(crate) fn cost(&self) -> f64 {
        self.normal.cost()
    }

    /// Residuals of the steps with the friction scale of each stroke, N.
    pub(crate) fn residuals(&self, training: &Training, rows: &[Row]) -> Vec<f64> {
        let drift = drifts(training, &self.best);
        let scatter = |g: usize| self.normal.scales[g].value - drift[g];
        let residual = |row: &Row| {
            let [own, before] = row.scale;
            let of_before = match before {
                0.0 => 0.0,
                _ if training.strokes[row.stroke].begins => {
                    before * self.normal.scales[row.stroke].before
                }
                _ => before * scatter(row.stroke - 1),
            };
            row.residual - own * scatter(row.stroke) - of_before
        };
        match training.scale.is_free {
            true => rows.iter().map(residual).collect(),
            false => rows.iter().map(|row| row.residual).collect(),
        }
    }

    /// Sums of the normal equations, without the gradient of parameters held at a bound.
    pub(crate) fn sums(&self) -> Sums {
        let (hessian, mut score) = self.normal.sums();
        self.held
            .iter()
            .zip(score.iter_mut())
            .filter(|(held, _)| **held)
            .for_each(|(_, s)| *s = 0.0);
        (hessian, score)
    }

    /// The remaining undamped step: the distance to the minimum, to first order.
    pub(crate) fn remaining(&self) -> DVector<f64> {
        let (hessian, score) = self.sums();
        damped_step(&hessian, &score, 1e-6, &self.held)
            .unwrap_or_else(|| DVector::zeros(score.len()))
    }

    /// Fraction of C that this step would remove if the model were linear.
    pub(crate) fn promised_fall(&self) -> f64 {
        let (_, score) = self.sums();
        self.remaining().dot(&score) / self.normal.cost().max(f64::MIN_POSITIVE)
    }

    /// C if further steps remove `times` the fraction of it that an undamped one promises.
    pub(crate) fn hoped_cost(&self, times: f64) -> f64 {
        self.cost() * (1.0 - times * self.promised_fall()).max(0.0)
    }

    /// Changes of the free parameters with one cluster left out each, and their covariance if all
    /// samples were independent. Both use a weak prior of `widths` (standard deviations), so
    /// parameters that the data do not determine stay finite. A parameter held at a bound does not
    /// change.
    pub(crate) fn departures(&self, widths: &[f64]) -> (Vec<DVector<f64>>, DMatrix<f64>) {
        let (mut hessian, score) = self.sums();
        let p = score.len();
        let variance = self.normal.data_cost() / self.normal.steps.max(f64::MIN_POSITIVE);
        widths
            .iter()
            .enumerate()
            .for_each(|(j, width)| hessian[(j, j)] += variance / (width * width));
        let used = self
            .normal
            .hessians
            .iter()
            .zip(&self.normal.scores)
            .filter(|(h, _)| h.diagonal().sum() > 0.0);
        // What a prior knows may lie on both sides of a bound.
        let held: Vec<bool> = self.held.iter().map(|held| *held && !self.has_prior).collect();
        let left_out =
            used.filter_map(|(h, s)| damped_step(&(&hessian - h), &(&score - s), 1e-12, &held));
        let unit = |j: usize| DVector::from_fn(p, |i, _| if i == j { variance } else { 0.0 });
        let column = |j: usize| {
            damped_step(&hessian, &unit(j), 1e-12, &held).unwrap_or_else(|| DVector::zeros(p))
        };
        (left_out.collect(), DMatrix::from_columns(&(0..p).map(column).collect::<Vec<_>>()))
    }

    /// Precision of the prior of each free parameter, N² over its unit squared; empty without a
    /// prior.
    pub(crate) fn prior_precisions(&self) -> Vec<f64> {
        self.normal.prior.iter().map(|(_, precision)| *precision).collect()
    }

    /// Mean and precision of the prior of free parameter `j`, which has `value`.
    pub(super) fn prior(&self, j: usize, value: f64) -> [f64; 2] {
        let (off, precision) = self.normal.prior[j];
        [value - off, precision]
    }

    /// Information of each cluster along `direction`, relative to the others: dᵀ·H_g·d.
    pub(crate) fn information(&self, direction: &DVector<f64>) -> Vec<f64> {
        self.normal.hessians.iter().map(|h| direction.dot(&(h * direction)).max(0.0)).collect()
    }

    /// The same fit with columns for `extra` after its own: the effect of each to first order.
    pub(crate) fn with_columns(&self, training: &Training, extra: &[Extra<T>]) -> Option<Normal> {
        normal_equations(training, &self.best, extra)
    }
}

/// Variance of a number by its `values` with one cluster left out each.
pub(super) fn jackknifed(values: &[f64]) -> f64 {
    let g = values.len() as f64;
    let mean = values.iter().sum::<f64>() / g.max(1.0);
    (g - 1.0) / g * values.iter().map(|v| (v - mean).powi(2)).sum::<f64>()
}

/// Degrees of freedom of Student's t (CARTER): the equivalent number of equal clusters with these shares
/// of the information, less one. A parameter informed by few strokes, such as F_s by the slow ones, has few.
pub(super) fn degrees(shares: &[f64]) -> f64 {
    let (sum, squares) =
        shares.iter().fold((0.0, 0.0), |(sum, squares), s| (sum + s, squares + s * s));
    sum * sum / f64::max(squares, f64::MIN_POSITIVE) - 1.0
}

/// Degrees of freedom of the model's variance when combined with the jackknife's.
pub(super) const MODEL_DEGREES: f64 = 8.0;

/// Effect of one additional column, to first order.
pub(crate) struct OneStep {
    /// Amplitude of the column, its jackknife standard error and degrees of freedom.
    pub(crate) amplitude: f64,
    pub(crate) standard_error: f64,
    pub(crate) degrees: f64,
    /// Fraction of C that it removes.
    pub(crate) gain: f64,
}

impl Normal {
    /// Growth of C, to first order, where the prediction changes by the whole of `column` and the
    /// parameters `free`, which come first, follow, but for those that are `fixed`.
    pub(crate) fn growth_along(&self, free: &[Free], fixed: &[bool], column: usize) -> Option<f64> {
        let (hessian, score) = self.sums();
        let p = score.len();
        let mut held: Vec<bool> = (0..p).map(|j| fixed.get(j).copied().unwrap_or(true)).collect();
        let changed = &score - hessian.column(column);
        let sums = (hessian, changed);
        let step = step_within(&sums, free, 1e-9, &mut held)?;
        Some(sums.0[(column, column)] - 2.0 * score[column] - step.dot(&sums.1))
    }

    /// Adds the column `column` to those of the parameters `free`, which come first, and to `beside`;
    /// `sigma2` (N²) is σ². Parameters `held` at a bound may leave it with the column.
    ///
    /// The variance of the amplitude is that of the jackknife, which a few strokes may dominate,
    /// moderated by that of the model: (ν·s²_jackknife + ν_0·s²_model)/(ν + ν_0) with ν_0 =
    /// [`MODEL_DEGREES`] (as for the variances of many small samples, SMYTH).
    pub(crate) fn one_step(
        &self,
        (free, held): (&[Free], &[bool]),
        beside: &[usize],
        column: usize,
        sigma2: f64,
    ) -> Option<OneStep> {
        let sums = self.sums();
        let (hessian, score) = &sums;
        let own = held.len();
        let mut fixed: Vec<bool> = (0..score.len()).map(|j| j >= own && j != column).collect();
        beside.iter().for_each(|j| fixed[*j] = false);
        let mut without = fixed.clone();
        without[..own].copy_from_slice(held);
        without[column] = true;
        let with = step_within(&sums, free, 1e-9, &mut fixed)?;
        let before = damped_step(hessian, score, 1e-9, &without)?;
        let used =
            self.hessians.iter().zip(&self.scores).filter(|(h, _)| h[(column, column)] > 0.0);
        let all: Vec<f64> = used
            .filter_map(|(h, s)| {
                damped_step(&(hessian - h), &(score - s), 1e-9, &fixed).map(|d| d[column])
            })
            .collect();
        let variance = jackknifed(&all);
        let unit = DVector::from_fn(score.len(), |i, _| f64::from(i == column));
        let direction = damped_step(hessian, &unit, 1e-9, &fixed)?;
        let shares: Vec<f64> =
            self.hessians.iter().map(|h| direction.dot(&(h * &direction)).max(0.0)).collect();
        let degrees = degrees(&shares).max(0.0);
        let by_model = sigma2 * direction[column];
        let moderated = (degrees * variance + MODEL_DEGREES * by_model) / (degrees + MODEL_DEGREES);
        Some(OneStep {
            amplitude: with[column],
            standard_error: moderated.sqrt(),
            degrees: degrees + MODEL_DEGREES,
            gain: (with.dot(score) - before.dot(score)) / self.cost().max(f64::MIN_POSITIVE),
        })
    }
}

/// Variances of the friction scale: scatter τ² between strokes, drift ω².
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ScaleVariance {
    pub(crate) scatter: f64,
    pub(crate) drift: f64,
}

/// Number of standard deviations of the friction scale that are compared, from 1e-4 to a quarter.
const SCATTERS: usize = 24;
const SCATTER_RANGE: [f64; 2] = [1e-4, 0.3];
/// Mean of the exponential prior of τ and ω: seals scatter by one or a few percent. It matters only
/// with few strokes.
const USUAL_SCATTER: f64 = 0.03;
const DRIFTS: [f64; 10] = [0.0, 2.5e-3, 5e-3, 0.01, 0.015, 0.025, 0.04, 0.07, 0.12, 0.25];

impl Normal {
    /// τ² and ω² by restricted maximum likelihood at the present parameters, given σ² (N²); ω² is
    /// its mean over the likelihood.
    ///
    /// ```text
    /// −2 log L = C_min/σ² + Σ_g ln(1 + τ²·z'z/σ²) + ln|H/σ²| + Σ_k ln(ω²·b_k)      H with 1/(ω²·b_k) on the drift's diagonal
    /// ```
    /// `relative` holds b_k, the variance of each drift column over ω², and its column.
    pub(crate) fn scale_variance(
        &self,
        training: &Training,
        sigma2: f64,
        relative: &[(usize, f64)],
    ) -> ScaleVariance {
        let ratio: f64 = SCATTER_RANGE[1] / SCATTER_RANGE[0];
        let scatter = |k: usize| SCATTER_RANGE[0] * ratio.powf(k as f64 / (SCATTERS - 1) as f64);
        let drifts: &[f64] = if relative.is_empty() { &DRIFTS[..1] } else { &DRIFTS };
        let tried: Vec<(f64, f64, f64)> = (0..SCATTERS)
            .into_par_iter()
            .flat_map_iter(|k| {
                let tau2 = scatter(k).powi(2);
                let all = self.with_scatter(training, sigma2 / tau2);
                drifts.iter().map(move |d| {
                    let usual = 2.0 * (tau2.sqrt() + d) / USUAL_SCATTER;
                    (tau2, d * d, all.criterion(sigma2, d * d, relative) + usual)
                })
            })
            .collect();
        let least = tried.iter().map(|t| t.2).fold(f64::INFINITY, f64::min);
        let mut found = ScaleVariance { scatter: 0.0, drift: 0.0 };
        let mut total = 0.0;
        for (tau2, omega2, value) in tried {
            let weight = (-0.5 * (value - least)).exp();
            if weight.is_finite() {
                found.scatter += weight * tau2;
                found.drift += weight * omega2;
                total += weight;
            }
        }
        (found.scatter, found.drift) = (found.scatter / total, found.drift / total);
        found
    }

    /// The sums of all clusters with the scatter of the strokes eliminated for this λ.
    fn with_scatter(&self, training: &Training, lambda: f64) -> Cluster {
        let of = |sums| Cluster::new(sums, training, lambda);
        let mut all = of(&self.clusters[0]);
        for cluster in self.clusters[1..].iter().map(of) {
            all.hessian += cluster.hessian;
            all.score += cluster.score;
            all.cost += cluster.cost;
            all.determinant += cluster.determinant;
        }
        all
    }
}

impl Cluster {
    /// −2 log L of all clusters together, less constants.
    fn criterion(&self, sigma2: f64, omega2: f64, relative: &[(usize, f64)]) -> f64 {
        let Self { score, cost, .. } = self;
        let (mut hessian, mut determinants) = (self.hessian.clone(), self.determinant);
        let p = score.len();
        let mut fixed = vec![false; p];
        for (j, b) in relative {
            if omega2 > 0.0 {
                hessian[(*j, *j)] += sigma2 / (omega2 * b);
                determinants += (omega2 * b / sigma2).ln();
            } else {
                fixed[*j] = true;
            }
        }
        let free: Vec<usize> = (0..p).filter(|j| !fixed[*j] && hessian[(*j, *j)] > 0.0).collect();
        let scale: Vec<f64> = free.iter().map(|j| hessian[(*j, *j)].sqrt()).collect();
        let n = free.len();
        let scaled = DMatrix::from_fn(n, n, |i, j| {
            let ridge = if i == j { 1e-9 } else { 0.0 };
            hessian[(free[i], free[j])] / (scale[i] * scale[j]) + ridge
        });
        let Some(factor) = scaled.cholesky() else { return f64::INFINITY };
        let rhs = DVector::from_fn(n, |i, _| score[free[i]] / scale[i]);
        let fall = rhs.dot(&factor.solve(&rhs));
        let logs = scale.iter().map(|s| 2.0 * s.ln()).sum::<f64>()
            + 2.0 * factor.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>();
        (cost - fall) / sigma2 + determinants + logs
    }
}
