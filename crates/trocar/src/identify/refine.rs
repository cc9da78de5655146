//! Last refinement, against simulated force (output-error least squares), with intervals from
//! leaving out one cluster of passes at a time.
//!
//! The free-run simulation of a candidate is compared with the readings; Gauss-Newton steps with Levenberg-Marquardt
//! damping lower the weighted squares. Only the normal equations are kept, one set per cluster, so memory does not
//! grow with the recording and every interval costs small solves: with one cluster g left out, the estimate moves to
//! first order by −(H − H_g)⁻¹·s_g; its variance over clusters is the jackknife's, which does not mistake the samples
//! of one pass for independent ones.

use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use trocar_model::{Element, State};

use super::candidate::{Candidate, Layout};
use super::random::normal;
use super::training::{Run, Step, Training};

/// Most damped steps.
const MOST_ITERATIONS: usize = 15;
/// Relative fall of the cost below which the refinement has converged.
const CONVERGED: f64 = 1e-3;
/// Factor on the precision of the steady state's estimates that holds them through the refinement.
pub(super) const HELD: f64 = 1e4;
/// Steps simulated at a time.
const BLOCK: usize = 2048;

/// How the refinement ended.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Refined {
    pub(super) candidate: Candidate,
    /// Weighted root mean square error, N, before and after.
    pub(super) rms: [f64; 2],
    pub(super) iterations: usize,
    pub(super) converged: bool,
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
fn reading(candidate: &Candidate, element: &Element, state: &mut State, step: &Step) -> f64 {
    let before = state.force();
    let after = element.step(state, step.displacement, step.duration);
    let seal_force = before + step.centre * (after - before);
    seal_force + candidate.offset + candidate.hidden_mass * step.acceleration
}

/// State in which a run starts: at rest where the mid curve gives its first reading.
pub(super) fn start(element: &Element, candidate: &Candidate, run: &Run) -> State {
    element.rest_at_force(run.first_force - candidate.offset)
}

/// Weighted squares of `candidate` on the clusters in `use_cluster`; infinite where it is no model.
pub(super) fn cost(training: &Training, candidate: &Candidate, use_cluster: impl Fn(usize) -> bool + Sync) -> f64 {
    let Ok(element) = candidate.element() else { return f64::INFINITY };
    let of_run = |run: &Run| {
        let mut state = start(&element, candidate, run);
        let squares = run.steps.iter().map(|step| {
            let error = step.force - reading(candidate, &element, &mut state, step);
            if use_cluster(step.cluster) { training.weights[step.cluster] * step.samples * error * error } else { 0.0 }
        });
        squares.sum::<f64>()
    };
    training.runs.par_iter().map(of_run).collect::<Vec<f64>>().iter().sum()
}

/// Candidates with one free number moved each; the difference quotient's steps.
fn moved(candidate: &Candidate, layout: Layout) -> Option<(Vec<Candidate>, Vec<f64>)> {
    let free = layout.free(candidate);
    let values: Vec<f64> = free.iter().map(|f| f.value).collect();
    let mut candidates = vec![candidate.clone()];
    let mut steps = Vec::new();
    for (j, f) in free.iter().enumerate() {
        // Away from a bound that lies within the step.
        let step = if f.value + f.step > f.high { -f.step } else { f.step };
        let mut changed = values.clone();
        changed[j] += step;
        candidates.push(layout.with(candidate, &changed));
        steps.push(step);
    }
    candidates.iter().all(|c| c.element().is_ok()).then_some((candidates, steps))
}

fn prior_cost(training: &Training, candidate: &Candidate, layout: Layout) -> f64 {
    departures(training, candidate, layout).iter().map(|(off, precision)| precision * off * off).sum()
}

/// Departure of each free number from its prior, and the prior's precision.
fn departures(training: &Training, candidate: &Candidate, layout: Layout) -> Vec<(f64, f64)> {
    let free = layout.free(candidate);
    free.iter().zip(&training.prior).map(|(f, (expected, precision))| (f.value - expected, *precision)).collect()
}

fn normal_equations(training: &Training, candidate: &Candidate, layout: Layout) -> Option<Normal> {
    let (candidates, steps) = moved(candidate, layout)?;
    let p = steps.len();
    let g = training.clusters();
    let mut normal = Normal {
        hessians: vec![DMatrix::zeros(p, p); g],
        scores: vec![DVector::zeros(p); g],
        costs: vec![0.0; g],
        prior: departures(training, candidate, layout),
        weight: 0.0,
    };
    let elements: Vec<Element> = candidates.iter().map(|c| c.element()).collect::<Result<_, _>>().ok()?;
    for run in &training.runs {
        let mut lanes: Vec<(State, Vec<f64>)> =
            elements.iter().zip(&candidates).map(|(e, c)| (start(e, c, run), Vec::with_capacity(BLOCK))).collect();
        for block in run.steps.chunks(BLOCK) {
            lanes.par_iter_mut().zip(&elements).zip(&candidates).for_each(|(((state, forces), element), c)| {
                forces.clear();
                forces.extend(block.iter().map(|s| reading(c, element, state, s)));
            });
            accumulate(training, block, &lanes, &steps, &mut normal);
        }
    }
    normal.hessians.iter_mut().for_each(|h| h.fill_upper_triangle_with_lower_triangle());
    Some(normal)
}

fn accumulate(training: &Training, block: &[Step], lanes: &[(State, Vec<f64>)], steps: &[f64], normal: &mut Normal) {
    let p = steps.len();
    let mut row = vec![0.0; p];
    for (i, step) in block.iter().enumerate().filter(|(_, s)| s.samples > 0.0) {
        let weight = training.weights[step.cluster] * step.samples;
        let predicted = lanes[0].1[i];
        let error = step.force - predicted;
        for j in 0..p {
            row[j] = (lanes[j + 1].1[i] - predicted) / steps[j];
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

/// Solves (H + λ·diag H)·δ = s with columns to unit diagonal; a number without influence stays put.
fn damped_step(hessian: &DMatrix<f64>, score: &DVector<f64>, lambda: f64) -> Option<DVector<f64>> {
    let p = score.len();
    let scale = DVector::from_fn(p, |j, _| if hessian[(j, j)] > 0.0 { hessian[(j, j)].sqrt() } else { f64::INFINITY });
    let scaled = DMatrix::from_fn(p, p, |i, j| {
        let own = if i == j { 1.0 + lambda } else { 0.0 };
        if i == j { own } else { hessian[(i, j)] / (scale[i] * scale[j]) }
    });
    let solution = scaled.cholesky()?.solve(&score.component_div(&scale));
    Some(solution.component_div(&scale))
}

/// Lowers the weighted squares from `from`; `None` when `from` is no model.
pub(super) fn refine(training: &Training, from: &Candidate, layout: Layout) -> Option<Refined> {
    let mut candidate = from.clone();
    let mut normal = normal_equations(training, &candidate, layout)?;
    let first = normal.data_cost();
    let (mut lambda, mut iterations, mut converged) = (1e-4, 0, false);
    while iterations < MOST_ITERATIONS && !converged {
        iterations += 1;
        let (hessian, score) = normal.sums();
        let before = normal.cost();
        let values: Vec<f64> = layout.free(&candidate).iter().map(|f| f.value).collect();
        let mut accepted = None;
        while accepted.is_none() && lambda < 1e8 {
            let tried = damped_step(&hessian, &score, lambda).map(|delta| {
                let moved: Vec<f64> = values.iter().zip(delta.iter()).map(|(v, d)| v + d).collect();
                layout.with(&candidate, &moved)
            });
            accepted = tried.filter(|c| cost(training, c, |_| true) + prior_cost(training, c, layout) < before);
            lambda *= if accepted.is_some() { 0.2 } else { 10.0 };
        }
        let Some(better) = accepted else {
            converged = true;
            break;
        };
        candidate = better;
        normal = normal_equations(training, &candidate, layout)?;
        lambda = lambda.max(1e-9);
        converged = normal.cost() > (1.0 - CONVERGED) * before;
    }
    let rms = [first, normal.data_cost()].map(|c| (c / normal.weight.max(f64::MIN_POSITIVE)).sqrt());
    Some(Refined { candidate, rms, iterations, converged, normal })
}

impl Refined {
    /// Sum of the weights of all samples used.
    pub(super) fn weight(&self) -> f64 {
        self.normal.weight.max(f64::MIN_POSITIVE)
    }

    /// Candidates with one cluster left out each, to first order (jackknife replicates).
    pub(super) fn jackknife(&self, layout: Layout) -> Vec<Candidate> {
        let (hessian, score) = self.normal.sums();
        let used = self.normal.hessians.iter().zip(&self.normal.scores).filter(|(h, _)| h.diagonal().sum() > 0.0);
        used.filter_map(|(h, s)| self.shifted(layout, &(&hessian - h), &(&score - s))).collect()
    }

    /// Candidates that follow when one number's prior is off by its standard deviation, to first order.
    pub(super) fn prior_off(&self, layout: Layout) -> Vec<Candidate> {
        let (hessian, score) = self.normal.sums();
        let known = self.normal.prior.iter().enumerate().filter(|(_, (_, precision))| *precision > 0.0);
        let pulled = |(j, (_, precision)): (usize, &(f64, f64))| {
            let mut score = score.clone();
            score[j] += precision * (HELD / precision).sqrt();
            self.shifted(layout, &hessian, &score)
        };
        known.filter_map(pulled).collect()
    }

    /// Effective number of clusters: that of equal ones with the same spread of leverage h = tr(H⁻¹·H_g).
    ///
    /// Slow cycles hold most of the samples; counting every cycle as one would make Student's t too narrow.
    pub(super) fn effective_clusters(&self) -> f64 {
        let (hessian, _) = self.normal.sums();
        let p = hessian.nrows();
        let unit = |j: usize| DVector::from_fn(p, |i, _| if i == j { 1.0 } else { 0.0 });
        let columns: Option<Vec<_>> = (0..p).map(|j| damped_step(&hessian, &unit(j), 1e-12)).collect();
        let Some(inverse) = columns else { return 1.0 };
        let leverage = |h: &DMatrix<f64>| (0..p).map(|j| h.row(j).transpose().dot(&inverse[j])).sum::<f64>();
        let all: Vec<f64> = self.normal.hessians.iter().map(leverage).collect();
        all.iter().sum::<f64>().powi(2) / all.iter().map(|h| h * h).sum::<f64>().max(f64::MIN_POSITIVE)
    }

    /// The candidate refitted without the clusters in `left_out`, to first order, with the steady state of `two_step`
    /// held instead of its own.
    pub(super) fn without(
        &self,
        layout: Layout,
        two_step: &Candidate,
        left_out: impl Fn(usize) -> bool,
    ) -> Option<Candidate> {
        let (mut hessian, mut score) = self.normal.sums();
        let known = layout.free(two_step).into_iter().zip(layout.free(&self.candidate)).zip(&self.normal.prior);
        for (j, ((part, own), (off, precision))) in known.enumerate() {
            score[j] += precision * (part.value - (own.value - off));
        }
        for (g, (h, s)) in self.normal.hessians.iter().zip(&self.normal.scores).enumerate() {
            if left_out(g) {
                hessian -= h;
                score -= s;
            }
        }
        self.shifted(layout, &hessian, &score)
    }

    /// Candidates refitted to resampled clusters, to first order (bootstrap replicates).
    pub(super) fn bootstrap(&self, layout: Layout, count: usize, seed: u64) -> Vec<Candidate> {
        let used: Vec<usize> =
            (0..self.normal.hessians.len()).filter(|g| self.normal.hessians[*g].diagonal().sum() > 0.0).collect();
        let replicate = |index: usize| {
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
            self.shifted(layout, &hessian, &score)
        };
        (0..count).into_par_iter().filter_map(replicate).collect()
    }

    fn shifted(&self, layout: Layout, hessian: &DMatrix<f64>, score: &DVector<f64>) -> Option<Candidate> {
        let delta = damped_step(hessian, score, 1e-12)?;
        let free = layout.free(&self.candidate);
        let values: Vec<f64> = free.iter().zip(delta.iter()).map(|(f, d)| f.value + d).collect();
        Some(layout.with_any(&self.candidate, &values))
    }
}

/// Refines on the clusters that `left_out` spares, with the steady state of `two_step` held, and scores the others:
/// weighted squares there.
pub(super) fn trial(
    training: &Training,
    two_step: &Candidate,
    from: &Candidate,
    layout: Layout,
    left_out: impl Fn(usize) -> bool + Sync,
) -> Option<f64> {
    let held = layout.free(two_step).into_iter().zip(&training.prior).map(|(f, (_, precision))| (f.value, *precision));
    let mut part = training.without(&left_out);
    part.prior = held.collect();
    Some(cost(training, &refine(&part, from, layout)?.candidate, left_out))
}
