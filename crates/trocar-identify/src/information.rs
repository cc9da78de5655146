//! What a motion will tell about an element, before it is recorded: the information that the
//! likelihood of [`identify`](super::identify) has about the parameters, at assumed values of them.
//!
//! ```text
//! y_i = F_i(θ)·(1 + e_h + d(t)) + ε_i + ρ·r(path_i)·F_i         ρ·r a ripple along the path
//! θ̂ − θ = M⁻¹·A'W·(ε + F·(e_h + d + ρ·r))/σ²        A = [∂F/∂θ, F·φ_k, Z], W the weights of the steps
//! Cov(θ̂) = M⁻¹·A'WCWA·M⁻¹/σ⁴                         M = A'WA/σ² + Λ
//! ```
//! Λ holds the precisions of drift and scatter as the likelihood has them, C the covariance of all
//! disturbances. The estimator treats residuals as white and gives short strokes that follow each
//! other one friction scale; a ripple, and friction that changes with every reversal h, make its
//! errors larger than M⁻¹ says. C accounts for that.

use nalgebra::{DMatrix, DVector, DVectorView};
use trocar_model::{ElementParams, ParamError, ParameterId, Quantity, Stages};

use super::candidate::{Candidate, EmsTrial, Layout};
use super::element::{MOST_CLUSTERS, drift_basis};
use super::estimate::t_quantile;
use super::likelihood::{self, Column, Row, Trial};
use super::numbers::{branch_ids, factor_of, models_off, quantities};
use super::spread::{Dependent, PRIOR_WIDTH, WORST_FACTOR, axes_of};
use super::training::{Coarseness, INDEPENDENT, Scale, Segmented, Training};
use trocar_recording::cancel;
use trocar_recording::loads::UNLOADED;
use trocar_recording::{Recording, RecordingError, local_acceleration};
use trocar_simulate::segment::{Stroke, reversal_threshold, strokes};
use trocar_simulate::stick_slip::LeftOut;

/// Way back that is a reversal, in half widths.
const REVERSAL: f64 = 0.02;

/// What disturbs the readings of a rig and its seal.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Noise {
    /// Noise of the force sensor, N rms, above 0.
    pub force_n: f64,
    /// τ: scatter of the friction between strokes, relative, above 0.
    pub scatter: f64,
    /// Travel over which the level of a new stroke develops, m, above 0.
    pub scatter_travel_m: f64,
    /// ω: slow drift of the friction, relative, ≥ 0.
    pub drift: f64,
    /// ρ: ripple of the friction along the path, relative, rms, ≥ 0.
    pub ripple: f64,
    /// Correlation length of the ripple, m, above 0.
    pub ripple_length_m: f64,
}

impl Noise {
    /// Standard deviation of independent errors along `motion`, N, that are as uncertain as those of the
    /// sensor with the ripple, which is alike over its length.
    pub(super) fn independent(&self, motion: &Recording) -> f64 {
        let travel: f64 = motion.position.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum();
        let (count, length) = (motion.len() as f64, self.ripple_length_m);
        let squares: f64 = motion.force.iter().map(|force| force * force).sum();
        let ripple = self.ripple * self.ripple * squares / count;
        let alike = 1.0 + 2.0 * length * count / travel.max(length);
        (self.force_n * self.force_n + ripple * alike).sqrt()
    }
}

impl Default for Noise {
    /// The virtual bench, and a drift of 1 %.
    fn default() -> Self {
        Self {
            force_n: 0.025,
            scatter: 0.01,
            scatter_travel_m: 0.005,
            drift: 0.01,
            ripple: 0.003,
            ripple_length_m: 0.01,
        }
    }
}

/// The error to expect of one parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Expected {
    /// Which.
    pub id: ParameterId,
    /// Its assumed value, SI.
    pub value: f64,
    /// Standard deviation of its estimate over repetitions, SI: to first order, but for β and c
    /// with the factors of `identify`, which estimates the weights of the strokes, too. Over 200
    /// seals the errors are that much larger (`tests/plan.rs`).
    pub deviation: f64,
    /// Half width of its 95 % interval, SI: with the factors and degrees of freedom of `identify`.
    pub half_width: f64,
    /// Whether its interval is taken on the logarithm.
    pub on_log: bool,
    /// Half width, over the scale of the parameter, from which on it is not determined.
    pub widest: f64,
}

/// The factor of β and of c. That of F_c and of joins is for what the scatter of strokes does not
/// show, which is in the covariance here.
fn beyond_first_order(id: ParameterId) -> f64 {
    match id.quantity {
        Quantity::ViscousDamping | Quantity::HalfWidth => factor_of(id),
        _ => 1.0,
    }
}

/// Weight of the force along a motion for the criterion of prediction.
#[derive(Debug, Clone)]
pub struct Force(DMatrix<f64>);

impl Force {
    /// The mean over motions.
    pub fn mean(all: impl ExactSizeIterator<Item = Self>) -> Self {
        let count = all.len().max(1) as f64;
        let sum = all.map(|force| force.0).reduce(|a, b| a + b);
        Self(sum.unwrap_or_else(|| DMatrix::zeros(0, 0)) / count)
    }
}

/// A motion as the likelihood divides it, which does not depend on the element.
#[derive(Debug, Clone)]
pub struct Motion {
    recording: Recording,
    acceleration: Vec<f64>,
    strokes: Vec<Stroke>,
}

impl Motion {
    /// The motion of a recording.
    pub fn of(recording: &Recording) -> Self {
        let recording = recording.smoothed().into_owned();
        let acceleration = recording.acceleration();
        Self::along(recording, acceleration)
    }

    fn along(recording: Recording, acceleration: Vec<f64>) -> Self {
        let strokes = strokes(&recording, reversal_threshold(&recording));
        Self { recording, acceleration, strokes }
    }

    /// A motion that nobody has recorded: it begins without force.
    ///
    /// # Errors
    /// Columns that form no recording.
    pub fn planned(time: &[f64], position: &[f64]) -> Result<Self, RecordingError> {
        let (time, position, force) = (time.to_vec(), position.to_vec(), vec![0.0; time.len()]);
        let recording = Recording::from_columns("plan", time, position, force)?;
        let acceleration = local_acceleration(&recording, 0.0);
        Ok(Self::along(recording, acceleration))
    }

    /// Its duration, s.
    pub fn duration(&self) -> f64 {
        self.recording.duration()
    }

    fn segmented(&self) -> Segmented<'_> {
        let Self { recording, acceleration, strokes } = self;
        let (settled, recorded, left_out) = (Vec::new(), &UNLOADED, LeftOut::NONE);
        Segmented { recording, strokes, settled, acceleration, recorded, left_out }
    }
}

/// The steps of a motion at an assumed element, with their derivatives.
#[derive(Debug, Clone)]
pub struct Rows {
    trial: EmsTrial,
    rows: Vec<Row>,
    /// Drift column and its variance over ω².
    drifts: Vec<f64>,
    strokes: usize,
}

impl Rows {
    /// The steps of `motions`, one after the other, with `element` in them; `None` where the
    /// likelihood cannot step it. Of the readings only the first of each motion matters.
    ///
    /// # Errors
    /// An element with which the likelihood cannot work.
    pub fn new(
        motions: &[&Motion],
        element: &ElementParams,
        noise: &Noise,
    ) -> Result<Option<Self>, ParamError> {
        let candidate = Candidate::of(element)?;
        let stages = candidate.stages()?;
        let data: Vec<Segmented> = motions.iter().copied().map(Motion::segmented).collect();
        let mut training = Training::new(
            &data,
            candidate.half_width,
            MOST_CLUSTERS,
            INDEPENDENT,
            Coarseness::NONE,
        );
        training.forget_unknown_starts(stages);
        training.blend_over(noise.scatter_travel_m);
        training.scale = Scale { is_free: true, lambda: 1.0, ..Scale::default() };
        let drift = if noise.drift > 0.0 { drift_basis(&training) } else { Vec::new() };
        let (basis, drifts): (Vec<_>, Vec<f64>) = drift.into_iter().unzip();
        training.scale.expected = vec![f64::INFINITY; basis.len()];
        training.scale.basis = basis;
        let layout = Layout::used_by(&candidate);
        let trial = EmsTrial { drift: vec![0.0; drifts.len()], ..EmsTrial::new(candidate, layout) };
        let strokes = training.strokes.len();
        let rows = likelihood::rows(&training, &trial);
        Ok(rows.map(|rows| Self { trial, rows, drifts, strokes }))
    }

    /// Number of free parameters of the element and sensor.
    fn own(&self) -> usize {
        self.trial.free_numbers()
    }

    /// Squares of the force's change with the parameters, per second of motion: the criterion of
    /// prediction is the error of the force along it.
    pub fn force(&self) -> Force {
        let own = self.own();
        let mut sum = DMatrix::zeros(own, own);
        let mut duration = 0.0;
        let is_offset: Vec<bool> =
            self.trial.free().iter().map(|f| f.column == Column::Offset).collect();
        for row in &self.rows {
            let x =
                DVector::from_fn(own, |j, _| if is_offset[j] { 0.0 } else { row.derivatives[j] });
            sum.ger(row.duration, &x, &x, 1.0);
            duration += row.duration;
        }
        Force(sum / duration.max(f64::MIN_POSITIVE))
    }

    /// What the steps between `from` and `to` (s) tell about the free parameters, with a scale of
    /// its own for each stroke and the ripple as noise that grows with its length over a step's.
    pub fn information(&self, noise: &Noise, [from, to]: [f64; 2]) -> Information {
        let own = self.own();
        let mut sum = DMatrix::zeros(own, own);
        let mut strokes = vec![(DVector::zeros(own), 0.0); self.strokes];
        for row in &self.rows {
            if row.time <= from || row.time > to {
                continue;
            }
            let x = DVector::from_column_slice(&row.derivatives[..own]);
            let travel = row.displacement.abs().max(5e-3 * noise.ripple_length_m);
            let ripple = noise.ripple * row.force;
            let correlated = 1.0 + 2.0 * noise.ripple_length_m / travel;
            let precision =
                1.0 / (noise.force_n.powi(2) / row.samples() + ripple * ripple * correlated);
            sum.ger(precision, &x, &x, 1.0);
            let (moment, square) = &mut strokes[row.stroke];
            let z = row.scale[0] + row.scale[1];
            moment.axpy(precision * z, &x, 1.0);
            *square += precision * z * z;
        }
        let loose = noise.scatter.powi(-2);
        for (moment, square) in strokes {
            sum.ger(-1.0 / (square + loose), &moment, &moment, 1.0);
        }
        Information(sum)
    }

    /// The element, as the likelihood has it.
    pub(super) fn stages(&self) -> Option<Stages> {
        self.trial.model()
    }

    /// [`models_off`] for a `covariance` of the own parameters.
    pub(super) fn deviations(&self, covariance: &DMatrix<f64>) -> Vec<(Stages, f64)> {
        models_off(&self.trial, &axes_of(covariance.clone()))
    }

    /// Covariance of the errors to expect of the free parameters from the whole motion.
    ///
    /// Returns `None` where the information has no inverse in numbers.
    pub fn covariance_expected(&self, noise: &Noise) -> Option<DMatrix<f64>> {
        let own = self.own();
        let (normal, prior) = (self.normal(), self.prior(noise));
        let squares: f64 = self.rows.iter().map(|row| row.force * row.force).sum();
        let force2 = squares / self.rows.len().max(1) as f64;
        let plain = noise.force_n.powi(2) + noise.ripple.powi(2) * force2;
        let mut inflation = 1.0;
        let mut covariance = DMatrix::zeros(own, own);
        // The estimator takes its σ² from the residuals, with their correlation.
        for _ in 0..3 {
            let sigma2 = inflation * plain;
            let gain = gain(&normal, &prior, sigma2, own)?;
            covariance = self.covariance(noise, &prior, &gain, sigma2);
            let mut ratios: Vec<f64> = (0..own)
                .map(|j| covariance[(j, j)] / gain[(j, j)].max(f64::MIN_POSITIVE))
                .collect();
            ratios.sort_by(f64::total_cmp);
            inflation = (inflation * ratios[own / 2]).clamp(1.0, 100.0);
        }
        Some(covariance)
    }

    /// The error to expect of every parameter with that `covariance` of the free ones.
    pub fn expected(&self, covariance: &DMatrix<f64>) -> Vec<Expected> {
        let shares = self.shares(covariance);
        self.quantities().into_iter().map(|of| self.one(of, covariance, &shares)).collect()
    }

    /// A'WA. A step has an entry in the columns of its own stroke and of the one before only.
    fn normal(&self) -> DMatrix<f64> {
        let common = self.own() + self.drifts.len();
        let columns = common + self.strokes;
        let mut sum = DMatrix::zeros(columns, columns);
        for row in &self.rows {
            let entries = || row.derivatives.iter().copied().enumerate().chain(row.scales(common));
            for (j, a) in entries() {
                let mut column = sum.column_mut(j);
                entries().for_each(|(i, b)| column[i] += row.weight * a * b);
            }
        }
        sum
    }

    /// Precisions Λ of the columns: weak priors of the parameters, drift, scatter.
    fn prior(&self, noise: &Noise) -> DVector<f64> {
        let free = self.trial.free();
        let own =
            free[..self.own()].iter().map(|f| (PRIOR_WIDTH * f.step).min(f.expected).powi(-2));
        let drifts = self.drifts.iter().map(|b| 1.0 / (noise.drift * noise.drift * b));
        let scatter = (0..self.strokes).map(|_| noise.scatter.powi(-2));
        DVector::from_vec(own.chain(drifts).chain(scatter).collect())
    }

    /// Cov(θ̂) of the own parameters: M⁻¹·A'WCWA·M⁻¹/σ⁴, step by step along the motion.
    fn covariance(
        &self,
        noise: &Noise,
        prior: &DVector<f64>,
        gain: &DMatrix<f64>,
        sigma2: f64,
    ) -> DMatrix<f64> {
        let (own, common) = (self.own(), self.own() + self.drifts.len());
        let mut sum = DMatrix::zeros(own, own);
        for k in own..common {
            sum.ger(prior[k], &gain.column(k), &gain.column(k), 1.0);
        }
        let width = self.trial.candidate.half_width;
        for run in self.rows.chunk_by(|a, b| a.run == b.run) {
            let mut friction = Reversals::new(width, noise.scatter_travel_m, own);
            let mut ripple = DVector::zeros(own);
            for block in run.chunks(BLOCK) {
                cancel::check();
                let moved = moved(block, gain, common, sigma2);
                let scaled = |factor: &dyn Fn(&Row) -> f64| {
                    let mut scaled = moved.clone();
                    let columns = scaled.column_iter_mut().zip(block);
                    columns.for_each(|(mut column, row)| column *= factor(row));
                    scaled
                };
                let white = scaled(&|row| noise.force_n / row.samples().sqrt());
                let rippled = scaled(&|row| noise.ripple * row.force);
                // Σ_ik b_i·b_k·exp(−|s_i − s_k|/ℓ) by a sum that fades along the path.
                let mut faded = DMatrix::zeros(own, block.len());
                for (i, row) in block.iter().enumerate() {
                    ripple *= (-row.displacement.abs() / noise.ripple_length_m).exp();
                    faded.set_column(i, &ripple);
                    ripple += rippled.column(i);
                    let step = (row.displacement, row.force);
                    friction.step(step, &moved.column(i), &mut sum, noise.scatter.powi(2));
                }
                let crossed = &rippled * faded.transpose();
                sum += &white * white.transpose() + &rippled * rippled.transpose();
                sum += crossed.transpose() + crossed;
            }
            friction.end(&mut sum, noise.scatter.powi(2));
        }
        sum
    }

    /// Per stroke and free parameter, for the degrees of freedom: the stroke's share of what is
    /// known about it.
    fn shares(&self, covariance: &DMatrix<f64>) -> Vec<DMatrix<f64>> {
        let own = self.own();
        let mut strokes = vec![(DMatrix::zeros(own, own), DVector::zeros(own), 0.0); self.strokes];
        for row in &self.rows {
            let x = DVector::from_column_slice(&row.derivatives[..own]);
            let (sum, moment, square) = &mut strokes[row.stroke];
            let z = row.scale[0] + row.scale[1];
            sum.ger(row.weight, &x, &x, 1.0);
            moment.axpy(row.weight * z, &x, 1.0);
            *square += row.weight * z * z;
        }
        let known = covariance.view((0, 0), (own, own)).into_owned();
        let of = |(mut sum, moment, square): (DMatrix<f64>, DVector<f64>, f64)| {
            if square > 0.0 {
                sum.ger(-1.0 / square, &moment, &moment, 1.0);
            }
            &known * sum * &known
        };
        strokes.into_iter().map(of).collect()
    }

    fn quantities(&self) -> Vec<(ParameterId, bool)> {
        let ids = branch_ids(&self.trial.candidate);
        quantities(self.trial.layout)
            .into_iter()
            .chain(ids.into_iter().map(|id| (id, false)))
            .collect()
    }

    fn one(
        &self,
        (id, on_log): (ParameterId, bool),
        covariance: &DMatrix<f64>,
        shares: &[DMatrix<f64>],
    ) -> Expected {
        let gradient = self.gradient(id, on_log);
        let own = self.own();
        let variance = gradient.dot(&(covariance.view((0, 0), (own, own)) * &gradient));
        let of_strokes = shares.iter().map(|share| gradient.dot(&(share * &gradient)).max(0.0));
        let (sum, squares) = of_strokes.fold((0.0, 0.0), |(s, q), v| (s + v, q + v * v));
        // Two strokes to a cluster.
        let degrees = (0.5 * sum * sum / f64::max(squares, f64::MIN_POSITIVE) - 1.0).max(1.0);
        let value = self.trial.candidate.value(id);
        let unit = if on_log { value } else { 1.0 };
        let error = variance.max(0.0).sqrt();
        let half = t_quantile(degrees) * factor_of(id) * error;
        let deviation = unit * beyond_first_order(id) * error;
        let widest = if on_log { WORST_FACTOR.ln() } else { 1.0 };
        Expected { id, value, deviation, half_width: unit * half, on_log, widest }
    }

    fn gradient(&self, id: ParameterId, on_log: bool) -> DVector<f64> {
        let whole = Dependent::on(&self.trial, on_log, &|t| t.candidate.value(id)).gradient;
        whole.rows(0, self.own()).into_owned()
    }

    /// Gradients of the parameters `ids` (those of tables if empty), each relative to its scale:
    /// the value where its interval is taken on the logarithm or is positive.
    pub fn directions(&self, ids: &[ParameterId]) -> Vec<(ParameterId, DVector<f64>)> {
        self.quantities()
            .into_iter()
            .filter(|(id, _)| {
                if ids.is_empty() {
                    !matches!(id.quantity, Quantity::Coefficient { .. })
                } else {
                    ids.contains(id)
                }
            })
            .map(|(id, on_log)| (id, self.gradient(id, on_log)))
            .collect()
    }

    /// The weak prior alone, to which the information of motions is added.
    pub fn nothing_known(&self, noise: &Noise) -> Information {
        Information(DMatrix::from_diagonal(&self.prior(noise).rows(0, self.own()).into_owned()))
    }
}

/// Steps taken at a time.
const BLOCK: usize = 1024;

/// M⁻¹·A'W/σ² of steps: how far an error of each moves the estimate.
fn moved(block: &[Row], gain: &DMatrix<f64>, common: usize, sigma2: f64) -> DMatrix<f64> {
    let derivatives = DMatrix::from_fn(common, block.len(), |j, i| block[i].derivatives[j]);
    let mut moved = gain.columns(0, common) * derivatives;
    for (mut column, row) in moved.column_iter_mut().zip(block) {
        row.scales(common).for_each(|(k, z)| column.axpy(z, &gain.column(k), 1.0));
        column *= row.weight / sigma2;
    }
    moved
}

/// Rows of M⁻¹ that belong to the first `own` columns; `None` where M has no inverse in numbers.
fn gain(
    normal: &DMatrix<f64>,
    prior: &DVector<f64>,
    sigma2: f64,
    own: usize,
) -> Option<DMatrix<f64>> {
    let mut m = normal / sigma2;
    (0..prior.len()).for_each(|j| m[(j, j)] += prior[j]);
    // Columns scaled to unit diagonal.
    let scale = m.diagonal().map(|d| 1.0 / d.max(f64::MIN_POSITIVE).sqrt());
    let scaled = DMatrix::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)] * scale[i] * scale[j]);
    let unit = DMatrix::from_fn(m.nrows(), own, |i, j| if i == j { scale[j] } else { 0.0 });
    let solved = scaled.cholesky()?.solve(&unit);
    Some(DMatrix::from_fn(own, m.nrows(), |j, i| solved[(i, j)] * scale[i]))
}

impl Row {
    /// Its columns of friction scales, after `common` others, with their entries.
    fn scales(&self, common: usize) -> impl Iterator<Item = (usize, f64)> {
        let [own, before] = self.scale;
        let column = common + self.stroke;
        let before = (before != 0.0).then(|| (column - 1, before));
        std::iter::once((column, own)).chain(before)
    }
}

/// How the friction of each reversal, which replaces that before it over a travel, moves the
/// estimate: sums over the steps since it.
pub(super) struct Reversals {
    /// Way back that is a reversal, and travel over which the friction is replaced, m.
    back: f64,
    travel: f64,
    /// Of the friction at present and of the one before.
    moved: [DVector<f64>; 2],
    /// Path since the reversal, position, farthest position, m, and direction.
    path: f64,
    at: f64,
    farthest: f64,
    direction: f64,
}

impl Reversals {
    /// Of a seal of `half_width`, m, and estimates of `own` numbers.
    pub(super) fn new(half_width: f64, travel: f64, own: usize) -> Self {
        let back = REVERSAL * half_width;
        let moved = [DVector::zeros(own), DVector::zeros(own)];
        let (at, farthest, direction) = (0.0, 0.0, 0.0);
        Self { back, travel, moved, path: f64::INFINITY, at, farthest, direction }
    }

    /// Adds a step to a `force`, N, an error of which moves the estimate by `moved`; at a reversal adds
    /// `variance` times what is complete to `sum`.
    pub(super) fn step(
        &mut self,
        (displacement, force): (f64, f64),
        moved: &DVectorView<f64>,
        sum: &mut DMatrix<f64>,
        variance: f64,
    ) {
        self.at += displacement;
        if self.direction == 0.0 && displacement != 0.0 {
            self.direction = displacement.signum();
        }
        if (self.at - self.farthest) * self.direction > 0.0 {
            self.farthest = self.at;
        }
        if (self.farthest - self.at) * self.direction > self.back {
            (self.direction, self.path) = (-self.direction, (self.farthest - self.at).abs());
            self.farthest = self.at;
            let [now, before] = &mut self.moved;
            sum.ger(variance, before, before, 1.0);
            std::mem::swap(now, before);
            now.fill(0.0);
        } else {
            self.path += displacement.abs();
        }
        let share = 1.0 - (-self.path / self.travel).exp();
        self.moved[0].axpy(share * force, moved, 1.0);
        self.moved[1].axpy((1.0 - share) * force, moved, 1.0);
    }

    pub(super) fn end(self, sum: &mut DMatrix<f64>, variance: f64) {
        self.moved.iter().for_each(|moved| sum.ger(variance, moved, moved, 1.0));
    }
}

/// What is known about the free parameters, in the inverse of their units squared.
#[derive(Debug, Clone)]
pub struct Information(DMatrix<f64>);

impl Information {
    /// This and `times` that much more.
    pub fn with(&self, more: &Self, times: f64) -> Self {
        Self(&self.0 + &more.0 * times)
    }

    /// The matrix, in the order of the free parameters: sensor offset, F_c, β, what else the element
    /// uses of its sliding, c, and for each branch its join as a fraction of c, the force there and
    /// the coefficients of its pieces.
    pub fn matrix(&self) -> &DMatrix<f64> {
        &self.0
    }

    fn inverse(&self) -> Option<DMatrix<f64>> {
        let scale = self.0.diagonal().map(|d| 1.0 / d.max(f64::MIN_POSITIVE).sqrt());
        let n = scale.len();
        let scaled = DMatrix::from_fn(n, n, |i, j| self.0[(i, j)] * scale[i] * scale[j]);
        let inverse = scaled.cholesky()?.inverse();
        Some(DMatrix::from_fn(n, n, |i, j| inverse[(i, j)] * scale[i] * scale[j]))
    }

    /// Variances along `directions`, and the logarithm of the determinant of their covariance per
    /// direction.
    pub fn variances(&self, directions: &[DVector<f64>]) -> Option<(Vec<f64>, f64)> {
        let inverse = self.inverse()?;
        let n = directions.len();
        let covariance =
            DMatrix::from_fn(n, n, |i, j| directions[i].dot(&(&inverse * &directions[j])));
        let determinant = covariance.clone().cholesky()?.determinant();
        Some((covariance.diagonal().iter().copied().collect(), determinant.ln() / n as f64))
    }

    /// Variance of the force along a motion, N².
    pub fn force_variance(&self, force: &Force) -> Option<f64> {
        Some((self.inverse()? * &force.0).trace())
    }
}
