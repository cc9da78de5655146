//! Output-error least squares: the free-run simulation of a model under trial is compared with the readings, and
//! Gauss-Newton steps with Levenberg-Marquardt damping lower the weighted squares (MARQUARDT).
//!
//! Only the normal equations are kept, one set per cluster, so memory does not
//! grow with the recording and every interval costs small solves: with one cluster g left out, the estimate moves to
//! first order by −(H − H_g)⁻¹·s_g; its variance over clusters is the jackknife's, which does not mistake the samples
//! of one pass for independent ones. A number that the data push against an end of its range is held there.

use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use trocar_model::Friction;

use crate::cancel;

use super::random::normal;
use super::training::{Run, Step, Training};

/// When to stop.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stop {
    /// Most damped steps.
    pub(crate) iterations: usize,
    /// Relative fall of the cost below which the fit has converged.
    pub(crate) fall: f64,
}

/// One free number: its value, the step of its difference quotient and its range.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Free {
    pub(crate) value: f64,
    pub(crate) step: f64,
    pub(crate) low: f64,
    pub(crate) high: f64,
}

/// A model under trial: free numbers, and the model that they make.
pub(crate) trait Trial: Clone + Send + Sync {
    /// The model, ready to run.
    type Model: Friction<State: Send + Sync> + Send + Sync;

    /// The model; `None` where the numbers make none.
    fn model(&self) -> Option<Self::Model>;
    /// The free numbers.
    fn free(&self) -> Vec<Free>;
    /// The trial with its free numbers replaced, each held within its range.
    fn with(&self, values: &[f64]) -> Self;
    /// The trial with its free numbers replaced, wherever they fall: for the spread of an estimate, not for a model.
    fn with_any(&self, values: &[f64]) -> Self;
    /// Sensor offset F_0, N.
    fn offset(&self) -> f64;
    /// Mass whose inertia is in the readings, kg.
    fn hidden_mass(&self) -> f64 {
        0.0
    }
}
/// Factor on the precision of the steady state's estimates that holds them through the refinement.
pub(super) const HELD: f64 = 1e4;
/// Steps simulated at a time.
const BLOCK: usize = 2048;

/// How a fit ended.
#[derive(Debug, Clone)]
pub(crate) struct Fitted<T> {
    pub(crate) best: T,
    /// Weighted root mean square error, N, before and after.
    pub(crate) rms: [f64; 2],
    pub(crate) iterations: usize,
    pub(crate) converged: bool,
    /// Free numbers held at an end of their range.
    pub(crate) held: Vec<bool>,
    normal: Normal,
}

/// Normal equations by cluster at one parameter vector.
#[derive(Debug, Clone, PartialEq)]
struct Normal {
    /// JᵀWJ of each cluster.
    hessians: Vec<DMatrix<f64>>,
    /// JᵀWe of each cluster.
    scores: Vec<DVector<f64>>,
    /// Weighted squares of each cluster.
    costs: Vec<f64>,
    /// Value less expectation, and precision, of each free number beforehand.
    prior: Vec<(f64, f64)>,
    weight: f64,
}

impl Normal {
    /// Weighted squares of the readings and of the departures from what was known before.
    fn cost(&self) -> f64 {
        self.data_cost() + self.prior.iter().map(|(off, precision)| precision * off * off).sum::<f64>()
    }

    fn data_cost(&self) -> f64 {
        self.costs.iter().sum()
    }

    fn sums(&self) -> (DMatrix<f64>, DVector<f64>) {
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

/// Prediction of a step's mean reading: seal force, sensor offset, inertia of a mass nobody told us of.
fn reading<T: Trial>(trial: &T, model: &T::Model, state: &mut <T::Model as Friction>::State, step: &Step) -> f64 {
    let before = T::Model::force(state);
    let after = model.step(state, step.displacement, step.duration);
    let seal_force = before + step.centre * (after - before);
    seal_force + trial.offset() + trial.hidden_mass() * step.acceleration
}

/// State in which a run starts: at rest with its first reading.
fn start<T: Trial>(trial: &T, model: &T::Model, run: &Run) -> <T::Model as Friction>::State {
    model.rest_at_force(run.first_force - trial.offset())
}

/// Weighted squares of a trial on each cluster; `None` where it is no model.
pub(crate) fn costs<T: Trial>(training: &Training, trial: &T) -> Option<Vec<f64>> {
    let model = trial.model()?;
    let of_run = |run: &Run| {
        cancel::check();
        let mut state = start(trial, &model, run);
        let mut squares = vec![0.0; training.clusters()];
        for step in &run.steps {
            let error = step.force - reading(trial, &model, &mut state, step);
            squares[step.cluster] += training.weights[step.cluster] * step.samples * error * error;
        }
        squares
    };
    let by_run: Vec<Vec<f64>> = training.runs.par_iter().map(of_run).collect();
    Some((0..training.clusters()).map(|g| by_run.iter().map(|squares| squares[g]).sum()).collect())
}

/// Weighted squares of a trial on the clusters in `use_cluster`; infinite where it is no model.
pub(crate) fn cost<T: Trial>(training: &Training, trial: &T, use_cluster: impl Fn(usize) -> bool) -> f64 {
    let Some(costs) = costs(training, trial) else { return f64::INFINITY };
    costs.iter().enumerate().filter(|(g, _)| use_cluster(*g)).map(|(_, cost)| cost).sum()
}

/// A trial and those with one free number moved each, their models, and the difference quotient's steps.
struct Moved<T: Trial> {
    trials: Vec<T>,
    models: Vec<T::Model>,
    steps: Vec<f64>,
}

impl<T: Trial> Moved<T> {
    /// `None` where one of them is no model.
    fn new(trial: &T) -> Option<Self> {
        let free = trial.free();
        let values: Vec<f64> = free.iter().map(|f| f.value).collect();
        let mut trials = vec![trial.clone()];
        let mut steps = Vec::new();
        for (j, f) in free.iter().enumerate() {
            // Away from a bound that lies within the step.
            let step = if f.value + f.step > f.high { -f.step } else { f.step };
            let mut changed = values.clone();
            changed[j] += step;
            trials.push(trial.with(&changed));
            steps.push(step);
        }
        let models = trials.iter().map(T::model).collect::<Option<Vec<_>>>()?;
        Some(Self { trials, models, steps })
    }
}

fn prior_cost<T: Trial>(training: &Training, trial: &T) -> f64 {
    departures(training, trial).iter().map(|(off, precision)| precision * off * off).sum()
}

/// Departure of each free number from its prior, and the prior's precision; empty without a prior.
fn departures<T: Trial>(training: &Training, trial: &T) -> Vec<(f64, f64)> {
    let free = trial.free();
    free.iter().zip(&training.prior).map(|(f, (expected, precision))| (f.value - expected, *precision)).collect()
}

fn normal_equations<T: Trial>(training: &Training, trial: &T) -> Option<Normal> {
    let Moved { trials, models, steps } = Moved::new(trial)?;
    let p = steps.len();
    let g = training.clusters();
    let mut normal = Normal {
        hessians: vec![DMatrix::zeros(p, p); g],
        scores: vec![DVector::zeros(p); g],
        costs: vec![0.0; g],
        prior: departures(training, trial),
        weight: 0.0,
    };
    for run in &training.runs {
        let mut lanes: Vec<_> =
            models.iter().zip(&trials).map(|(m, t)| (start(t, m, run), Vec::with_capacity(BLOCK))).collect();
        for block in run.steps.chunks(BLOCK) {
            lanes.par_iter_mut().zip(&models).zip(&trials).for_each(|(((state, forces), model), t)| {
                cancel::check();
                forces.clear();
                forces.extend(block.iter().map(|s| reading(t, model, state, s)));
            });
            let forces: Vec<&[f64]> = lanes.iter().map(|(_, forces)| forces.as_slice()).collect();
            accumulate(training, block, &forces, &steps, &mut normal);
        }
    }
    normal.hessians.iter_mut().for_each(|h| h.fill_upper_triangle_with_lower_triangle());
    Some(normal)
}

fn accumulate(training: &Training, block: &[Step], lanes: &[&[f64]], steps: &[f64], normal: &mut Normal) {
    let p = steps.len();
    let mut row = vec![0.0; p];
    for (i, step) in block.iter().enumerate().filter(|(_, s)| s.samples > 0.0) {
        let weight = training.weights[step.cluster] * step.samples;
        let predicted = lanes[0][i];
        let error = step.force - predicted;
        for j in 0..p {
            row[j] = (lanes[j + 1][i] - predicted) / steps[j];
        }
        normal.weight += weight;
        normal.costs[step.cluster] += weight * error * error;
        let score = &mut normal.scores[step.cluster];
        let hessian = normal.hessians[step.cluster].as_mut_slice();
        for (j, a) in row.iter().enumerate() {
            let scaled = weight * a;
            score[j] += scaled * error;
            // Lower triangle, column by column.
            let column = &mut hessian[j * p + j..(j + 1) * p];
            column.iter_mut().zip(&row[j..]).for_each(|(h, b)| *h += scaled * b);
        }
    }
}

/// Solves (H + λ·diag H)·δ = s with columns to unit diagonal; a number without influence, or held, stays put.
fn damped_step(hessian: &DMatrix<f64>, score: &DVector<f64>, lambda: f64, held: &[bool]) -> Option<DVector<f64>> {
    let p = score.len();
    let moves = |j: usize| hessian[(j, j)] > 0.0 && !held[j];
    let scale = DVector::from_fn(p, |j, _| if moves(j) { hessian[(j, j)].sqrt() } else { f64::INFINITY });
    let scaled = DMatrix::from_fn(p, p, |i, j| {
        let own = if i == j { 1.0 + lambda } else { 0.0 };
        if i == j { own } else { hessian[(i, j)] / (scale[i] * scale[j]) }
    });
    let solution = scaled.cholesky()?.solve(&score.component_div(&scale));
    Some(solution.component_div(&scale))
}

/// The damped step within the ranges: numbers at an end that would leave it are held, and the others solved again.
fn step_within(
    normal: &(DMatrix<f64>, DVector<f64>),
    free: &[Free],
    lambda: f64,
    held: &mut Vec<bool>,
) -> Option<DVector<f64>> {
    *held = vec![false; free.len()];
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

/// Lowers the weighted squares from `from`; `None` when `from` is no model.
pub(crate) fn fit<T: Trial>(training: &Training, from: &T, stop: Stop) -> Option<Fitted<T>> {
    let mut best = from.clone();
    let mut normal = normal_equations(training, &best)?;
    let first = normal.data_cost();
    let (mut lambda, mut iterations, mut converged) = (1e-4, 0, false);
    let mut held = vec![false; best.free().len()];
    while iterations < stop.iterations && !converged {
        iterations += 1;
        let sums = normal.sums();
        let before = normal.cost();
        let free = best.free();
        let mut accepted = None;
        while accepted.is_none() && lambda < 1e8 {
            let tried = step_within(&sums, &free, lambda, &mut held).map(|delta| {
                let moved: Vec<f64> = free.iter().zip(delta.iter()).map(|(f, d)| f.value + d).collect();
                best.with(&moved)
            });
            accepted = tried.filter(|t| cost(training, t, |_| true) + prior_cost(training, t) < before);
            lambda *= if accepted.is_some() { 0.2 } else { 10.0 };
        }
        let Some(better) = accepted else {
            converged = true;
            break;
        };
        best = better;
        normal = normal_equations(training, &best)?;
        lambda = lambda.max(1e-9);
        converged = normal.cost() > (1.0 - stop.fall) * before;
    }
    step_within(&normal.sums(), &best.free(), 1e-12, &mut held);
    let rms = [first, normal.data_cost()].map(|c| (c / normal.weight.max(f64::MIN_POSITIVE)).sqrt());
    Some(Fitted { best, rms, iterations, converged, held, normal })
}

impl<T: Trial> Fitted<T> {
    /// Sum of the weights of all samples used.
    pub(crate) fn weight(&self) -> f64 {
        self.normal.weight.max(f64::MIN_POSITIVE)
    }

    /// Sums of the normal equations; what holds a number at an end of its range does not count.
    fn sums(&self) -> (DMatrix<f64>, DVector<f64>) {
        let (hessian, mut score) = self.normal.sums();
        self.held.iter().zip(score.iter_mut()).filter(|(held, _)| **held).for_each(|(_, s)| *s = 0.0);
        (hessian, score)
    }

    /// Part of the cost that an undamped step would take away if the model were linear.
    pub(crate) fn promised_fall(&self) -> f64 {
        let (hessian, score) = self.sums();
        let step = damped_step(&hessian, &score, 1e-6, &self.held);
        step.map_or(0.0, |delta| delta.dot(&score) / self.normal.cost().max(f64::MIN_POSITIVE))
    }

    /// Trials with one cluster left out each, to first order (jackknife replicates).
    pub(crate) fn jackknife(&self) -> Vec<T> {
        let (hessian, score) = self.sums();
        let used = self.normal.hessians.iter().zip(&self.normal.scores).filter(|(h, _)| h.diagonal().sum() > 0.0);
        used.filter_map(|(h, s)| self.shifted(&(&hessian - h), &(&score - s))).collect()
    }

    /// Trials that follow when one number's prior is off by its standard deviation, to first order.
    pub(crate) fn prior_off(&self) -> Vec<T> {
        let (hessian, score) = self.sums();
        let known = self.normal.prior.iter().enumerate().filter(|(_, (_, precision))| *precision > 0.0);
        let pulled = |(j, (_, precision)): (usize, &(f64, f64))| {
            let mut score = score.clone();
            score[j] += precision * (HELD / precision).sqrt();
            self.shifted(&hessian, &score)
        };
        known.filter_map(pulled).collect()
    }

    /// Effective number of clusters: that of equal ones with the same spread of leverage h = tr(H⁻¹·H_g).
    ///
    /// Slow cycles hold most of the samples; counting every cycle as one would make Student's t too narrow.
    pub(crate) fn effective_clusters(&self) -> f64 {
        let (hessian, _) = self.normal.sums();
        let p = hessian.nrows();
        let unit = |j: usize| DVector::from_fn(p, |i, _| if i == j { 1.0 } else { 0.0 });
        let columns: Option<Vec<_>> = (0..p).map(|j| damped_step(&hessian, &unit(j), 1e-12, &vec![false; p])).collect();
        let Some(inverse) = columns else { return 1.0 };
        let leverage = |h: &DMatrix<f64>| (0..p).map(|j| h.row(j).transpose().dot(&inverse[j])).sum::<f64>();
        let all: Vec<f64> = self.normal.hessians.iter().map(leverage).collect();
        all.iter().sum::<f64>().powi(2) / all.iter().map(|h| h * h).sum::<f64>().max(f64::MIN_POSITIVE)
    }

    /// The trial refitted without the clusters in `left_out`, to first order, with the prior's values those of
    /// `expected` instead of its own.
    pub(crate) fn without(&self, expected: &T, left_out: impl Fn(usize) -> bool) -> Option<T> {
        let (mut hessian, mut score) = self.normal.sums();
        let known = expected.free().into_iter().zip(self.best.free()).zip(&self.normal.prior);
        for (j, ((part, own), (off, precision))) in known.enumerate() {
            score[j] += precision * (part.value - (own.value - off));
        }
        for (g, (h, s)) in self.normal.hessians.iter().zip(&self.normal.scores).enumerate() {
            if left_out(g) {
                hessian -= h;
                score -= s;
            }
        }
        self.shifted(&hessian, &score)
    }

    /// Trials refitted to resampled clusters, to first order (bootstrap replicates).
    pub(crate) fn bootstrap(&self, count: usize, seed: u64) -> Vec<T> {
        let used: Vec<usize> =
            (0..self.normal.hessians.len()).filter(|g| self.normal.hessians[*g].diagonal().sum() > 0.0).collect();
        let replicate = |index: usize| {
            cancel::check();
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(index as u64);
            let p = self.normal.scores[0].len();
            let (mut hessian, mut score) = (DMatrix::zeros(p, p), DVector::zeros(p));
            for (j, (off, precision)) in self.normal.prior.iter().enumerate().filter(|(_, (_, k))| *k > 0.0) {
                // What was known beforehand is drawn anew too, with its error.
                hessian[(j, j)] += precision;
                score[j] += precision * ((HELD / precision).sqrt() * normal(&mut rng) - off);
            }
            for _ in &used {
                let g = used[rng.random_range(0..used.len())];
                hessian += &self.normal.hessians[g];
                score += &self.normal.scores[g];
            }
            self.shifted(&hessian, &score)
        };
        (0..count).into_par_iter().filter_map(replicate).collect()
    }

    /// Departures of the free numbers with one cluster left out each, and their covariance if all samples were
    /// independent. Both with a weak prior of `widths` (standard deviations), so that what the data do not pin stays
    /// finite; a number held at an end of its range does not depart.
    pub(crate) fn departures(&self, widths: &[f64]) -> (Vec<DVector<f64>>, DMatrix<f64>) {
        let (mut hessian, score) = self.sums();
        let p = score.len();
        let variance = self.normal.data_cost() / self.weight();
        widths.iter().enumerate().for_each(|(j, width)| hessian[(j, j)] += variance / (width * width));
        let used = self.normal.hessians.iter().zip(&self.normal.scores).filter(|(h, _)| h.diagonal().sum() > 0.0);
        let left_out = used.filter_map(|(h, s)| damped_step(&(&hessian - h), &(&score - s), 1e-12, &self.held));
        let unit = |j: usize| DVector::from_fn(p, |i, _| if i == j { variance } else { 0.0 });
        let column = |j: usize| damped_step(&hessian, &unit(j), 1e-12, &self.held).unwrap_or_else(|| DVector::zeros(p));
        (left_out.collect(), DMatrix::from_columns(&(0..p).map(column).collect::<Vec<_>>()))
    }

    /// Information of each cluster along `direction`, relative to the others: dᵀ·H_g·d.
    pub(crate) fn information(&self, direction: &DVector<f64>) -> Vec<f64> {
        self.normal.hessians.iter().map(|h| direction.dot(&(h * direction)).max(0.0)).collect()
    }

    fn shifted(&self, hessian: &DMatrix<f64>, score: &DVector<f64>) -> Option<T> {
        let delta = damped_step(hessian, score, 1e-12, &vec![false; score.len()])?;
        let values: Vec<f64> = self.best.free().iter().zip(delta.iter()).map(|(f, d)| f.value + d).collect();
        Some(self.best.with_any(&values))
    }
}

/// Fits on the clusters that `left_out` spares, with the prior's values those of `expected`, and scores the others:
/// weighted squares there.
pub(crate) fn held_out_cost<T: Trial>(
    training: &Training,
    expected: &T,
    from: &T,
    stop: Stop,
    left_out: impl Fn(usize) -> bool + Sync,
) -> Option<f64> {
    let prior = expected.free().into_iter().zip(&training.prior).map(|(f, (_, precision))| (f.value, *precision));
    let mut part = training.without(&left_out);
    part.prior = prior.collect();
    Some(cost(training, &fit(&part, from, stop)?.best, left_out))
}
