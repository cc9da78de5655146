//! Dynamics: switching instants, deflection, the two branches and the influence of the deformation
//! velocity (EMS section IV-B).
//!
//! # Equations (key EMS in SOURCES.md)
//! ```text
//! F = F_s·sgn(v_d)                       ends the deformation                 (12)
//! z(t_i) = x(t_i) − x(t_0) + z(t_0)      from positions, not from velocities  (24)
//! F_def(z) = two joined polynomials per direction, least squares              (25), (26)
//! ```
//! A full reversal runs from the crossing of −F_s after a reversal to the first crossing of +F_s:
//! the seal has snapped through from −c to +c. Its travel is 2c. The spread of c over full
//! reversals is the error of the reconstructed deflection. EMS (24) sums velocities; the encoder
//! positions give the same result without accumulated error.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use super::estimate::{Estimate, LinearFit, t_p_value, t_quantile};
use super::shape::{BranchShape, EndForces};
use super::steady::SteadyFit;
use trocar_recording::Recording;
use trocar_simulate::segment::{Direction, Stroke};

/// Points per full reversal at which the deformation force is stored.
pub const BINS: usize = 100;
/// Samples over which the force is averaged when a switching instant is sought.
const SMOOTHING: usize = 5;
/// Fewest samples of a full reversal that define its curve.
const FEWEST_SAMPLES: usize = 5;
/// Fewest full reversals from which a half width is estimated.
const FEWEST_REVERSALS: usize = 3;
/// Largest relative spread of c over full reversals at which the deformation counts as resolved.
const LARGEST_SPREAD: f64 = 0.45;
/// Largest scatter of the force between full reversals, as a fraction of the range between the
/// limits.
const LARGEST_SCATTER: f64 = 0.15;
/// Fewest samples per half width of a full reversal that determine the half width.
pub(super) const COARSEST: f64 = 5.0;
/// Deflections, as z/c, at which the influence of the velocity is tested (figure 7 uses one).
const LEVELS: [f64; 7] = [-0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75];
/// Damping force at the fastest deformation, N, below which the influence is negligible
/// (equivalence bound).
const NEGLIGIBLE_DAMPING_FORCE: f64 = 0.1;

/// Sliding limits, N, acting on the seal (sensor offset removed): F_s of either direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Sensor offset F_0, N.
    pub offset: f64,
    /// Limit in insertion, N, positive.
    pub insertion: f64,
    /// Limit in withdrawal, N, positive.
    pub withdrawal: f64,
    /// Fluctuation of the sliding force below the limit, N: the switching instant is taken at the
    /// limit less this margin.
    pub margin: f64,
    /// Twice the fluctuation of the sliding force, N rms.
    pub(super) fluctuation: f64,
}

impl Limits {
    /// The same with the margin at which the force of every steady stroke reaches them.
    pub(super) fn reached_by(self, steady: &SteadyFit) -> Self {
        let forces = steady.means.iter().map(|m| (m.force_n - self.offset).abs());
        let least = forces.fold(f64::INFINITY, f64::min) - self.fluctuation;
        let margin = self.insertion.max(self.withdrawal) - least;
        let largest = 0.5 * self.insertion.min(self.withdrawal);
        Self { margin: margin.min(largest).max(self.margin), ..self }
    }

    fn of(&self, direction: Direction) -> f64 {
        direction.pick([self.insertion, self.withdrawal]) - self.margin
    }

    /// The end points of both branches: (−c, −F_s) and (+c, +F_s).
    pub fn end_forces(&self) -> EndForces {
        EndForces { low: -self.withdrawal, high: self.insertion }
    }
}

/// Median of numbers; 0 of none.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Half the travels, m, of one direction.
fn half_travels(all: &[FullReversal], direction: Direction) -> impl Iterator<Item = f64> + '_ {
    all.iter().filter(move |t| t.direction == direction).map(|t| t.half_travel)
}

/// Drops full reversals whose travel is an outlier of their direction: a switching instant caused
/// by a disturbance.
fn without_outliers(mut full_reversals: Vec<FullReversal>) -> Vec<FullReversal> {
    for direction in Direction::BOTH {
        let own: Vec<f64> = half_travels(&full_reversals, direction).collect();
        let middle = median(own.clone());
        let spread = 1.4826 * median(own.iter().map(|c| (c - middle).abs()).collect());
        let limit = (5.0 * spread).max(0.05 * middle);
        full_reversals
            .retain(|t| t.direction != direction || (t.half_travel - middle).abs() <= limit);
    }
    full_reversals
}

/// Standard deviation, m, of the half travel about its direction's mean.
fn spread_of(full_reversals: &[FullReversal]) -> f64 {
    let mut squares = 0.0;
    for direction in Direction::BOTH {
        let own: Vec<f64> = half_travels(full_reversals, direction).collect();
        let mean = own.iter().sum::<f64>() / own.len().max(1) as f64;
        squares += own.iter().map(|c| (c - mean).powi(2)).sum::<f64>();
    }
    (squares / (full_reversals.len() as f64 - 2.0).max(1.0)).sqrt()
}

/// A full reversal: after a reversal of the motion the seal deforms from one sliding limit to the
/// other.
#[derive(Debug, Clone, PartialEq)]
pub struct FullReversal {
    /// Index of the recording.
    pub recording: usize,
    /// Sense of the motion.
    pub direction: Direction,
    /// First sample: the force leaves the other direction's limit (12).
    pub from: usize,
    /// First sample at the limit of this direction.
    pub to: usize,
    /// Half the travel, m.
    pub half_travel: f64,
    /// Mean speed, m/s.
    pub speed: f64,
    /// Force, N, at the bin centres of z/c from -1 to 1 (sensor offset removed).
    pub curve: Vec<f64>,
    /// Velocity, m/s, at the same points.
    pub velocity: Vec<f64>,
}

/// Test of the influence of the deformation velocity (figure 7).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DampingTest {
    /// σ, N s/m, from all deflections and full reversals jointly.
    pub seal_damping_n_s_m: Estimate,
    /// p value of σ = 0.
    pub p_value: f64,
    /// Largest damping force in the data, N: |σ| times the fastest deformation.
    pub largest_force_n: f64,
    /// Largest damping force, N, within the 95 % interval.
    pub largest_force_not_excluded_n: f64,
    /// Whether an influence above the practical bound can be excluded at 95 %.
    pub equivalent_to_zero: bool,
    /// Whether σ is kept in the model.
    pub kept: bool,
    /// Error used for the reconstructed deflection, m (1 sd).
    pub deflection_error_m: f64,
}

/// The branch fitted to one direction.
#[derive(Debug, Clone, PartialEq)]
pub struct BranchFit {
    /// The joined polynomials (25).
    pub shape: BranchShape,
    /// Root mean square residual, N, to the mean curve.
    pub rms: f64,
    /// Single polynomial of degree 7 for comparison: Legendre coefficients over [-c, c], N (figure
    /// 8).
    pub single_polynomial: Vec<f64>,
    /// Root mean square residual, N, of the single polynomial.
    pub single_polynomial_rms: f64,
    /// Mean curve at the bin centres, N.
    pub mean_curve: Vec<f64>,
    /// Standard deviation over full reversals at the bin centres, N.
    pub scatter: Vec<f64>,
}

/// Result of the dynamic step.
#[derive(Debug, Clone, PartialEq)]
pub struct DeformationFit {
    /// c, m.
    pub half_width: Estimate,
    /// Standard deviation of c over full reversals, m: the error of the reconstructed deflection.
    pub deflection_error: f64,
    /// p value of c being independent of speed; `None` with too few speeds.
    pub speed_dependence_p_value: Option<f64>,
    /// Branch of the insertion (z rising).
    pub insertion_branch: BranchFit,
    /// Branch of the withdrawal (z falling).
    pub withdrawal_branch: BranchFit,
    /// Influence of the deformation velocity; `None` when all full reversals have one speed.
    pub damping: Option<DampingTest>,
    /// The full reversals found in the measured force.
    pub full_reversals: Vec<FullReversal>,
}

impl DeformationFit {
    /// Branch in `direction`.
    pub fn branch(&self, direction: Direction) -> &BranchFit {
        direction.pick([&self.insertion_branch, &self.withdrawal_branch])
    }
}

/// Bin centres as z/c, from -1 to 1.
pub fn bin_centres() -> impl Iterator<Item = f64> {
    (0..BINS).map(|k| (2 * k + 1) as f64 / BINS as f64 - 1.0)
}

/// Finds the full reversals of one recording; `level` gives the ratio of the sliding force of a
/// stroke to the common limits.
///
/// The friction scale of a seal varies by about a percent from stroke to stroke. Switching instants
/// are therefore taken at the limits of each stroke, and its curve is scaled to the common ones.
/// With common limits, a weak stroke would switch late or never while a strong one would switch
/// hardly earlier, which would overestimate c.
pub(super) fn full_reversals(
    index: usize,
    recording: &Recording,
    strokes: &[Stroke],
    limits: &Limits,
    level: impl Fn(usize) -> f64,
) -> Vec<FullReversal> {
    let mut found = Vec::new();
    let mut slid_before: Option<(Direction, f64)> = None;
    for (number, stroke) in strokes.iter().enumerate() {
        let own = level(number);
        let before =
            slid_before.filter(|(d, _)| *d != stroke.direction && stroke.starts_at_reversal);
        let start = before.map_or(own, |(_, level)| level) * limits.of(stroke.direction.opposite());
        let crossing =
            crossings(recording, stroke, limits.offset, start, own * limits.of(stroke.direction));
        if let (Some((from, to)), Some((_, level_before))) = (crossing, before) {
            let levels = stroke.direction.pick([[level_before, own], [own, level_before]]);
            let samples = [from, to];
            let direction = stroke.direction;
            found.extend(full_reversal(
                index,
                recording,
                direction,
                samples,
                limits.offset,
                levels,
            ));
        }
        // A stroke that never reaches its limit leaves the seal part way: the next one is no full
        // snap-through.
        slid_before = crossing.map(|_| (stroke.direction, own));
    }
    found
}

/// Mean of the force over a few samples around `i`, to reduce noise.
fn smoothed(recording: &Recording, i: usize, from: usize, to: usize) -> f64 {
    let window =
        &recording.force[i.saturating_sub(SMOOTHING / 2).max(from)..=(i + SMOOTHING / 2).min(to)];
    window.iter().sum::<f64>() / window.len() as f64
}

/// First sample inside the limits after the reversal, and first sample at this direction's limit.
fn crossings(
    recording: &Recording,
    stroke: &Stroke,
    offset: f64,
    start: f64,
    limit: f64,
) -> Option<(usize, usize)> {
    let s = stroke.direction.sign();
    let along = |i: usize| s * (smoothed(recording, i, stroke.start, stroke.end) - offset);
    let from = (stroke.start..stroke.end).find(|i| along(*i) > -start)?;
    let to = (from + 1..=stroke.end).find(|i| along(*i) >= limit)?;
    Some((from, to))
}

fn full_reversal(
    index: usize,
    recording: &Recording,
    direction: Direction,
    [from, to]: [usize; 2],
    offset: f64,
    levels: [f64; 2],
) -> Option<FullReversal> {
    let s = direction.sign();
    let x = &recording.position;
    let total = s * (x[to] - x[from]);
    if to - from < FEWEST_SAMPLES || total <= 0.0 {
        return None;
    }
    let force: Vec<f64> = (from..=to).map(|i| recording.force[i] - offset).collect();
    let u: Vec<f64> = (from..=to).map(|i| 2.0 * s * (x[i] - x[from]) / total - 1.0).collect();
    let t: Vec<f64> = (from..=to).map(|i| recording.time[i]).collect();
    let mut curve = resampled(&u, &force);
    let when = resampled(&u, &t);
    let step = 2.0 * (0.5 * total) / BINS as f64;
    let mut velocity: Vec<f64> = (0..BINS)
        .map(|k| {
            let (a, b) = (k.saturating_sub(3), (k + 3).min(BINS - 1));
            s * step * (b - a) as f64 / (when[b] - when[a]).max(f64::MIN_POSITIVE)
        })
        .collect();
    if direction == Direction::Withdrawal {
        // Bins run along z: a withdrawal passes them in reverse order.
        curve.reverse();
        velocity.reverse();
    }
    for (k, force) in curve.iter_mut().enumerate() {
        let part = k as f64 / (BINS - 1) as f64;
        *force /= levels[0] + (levels[1] - levels[0]) * part;
    }
    let speed = total / (t[t.len() - 1] - t[0]).max(f64::MIN_POSITIVE);
    Some(FullReversal {
        recording: index,
        direction,
        from,
        to,
        half_travel: 0.5 * total,
        speed,
        curve,
        velocity,
    })
}

/// Values at the bin centres along the motion: the mean of the samples in a bin, or interpolated
/// between neighbours.
fn resampled(u: &[f64], values: &[f64]) -> Vec<f64> {
    let mut sums = vec![(0.0, 0.0); BINS];
    for (u, value) in u.iter().zip(values) {
        let bin = ((0.5 * (u + 1.0) * BINS as f64) as usize).min(BINS - 1);
        sums[bin] = (sums[bin].0 + value, sums[bin].1 + 1.0);
    }
    let known: Vec<(usize, f64)> = sums
        .iter()
        .enumerate()
        .filter(|(_, (_, n))| *n > 0.0)
        .map(|(k, (sum, n))| (k, sum / n))
        .collect();
    let between = |k: usize| {
        let after = known.partition_point(|(j, _)| *j < k);
        match (after.checked_sub(1).map(|i| known[i]), known.get(after)) {
            (_, Some(&(j, value))) if j == k => value,
            (Some((i, a)), Some(&(j, b))) => a + (b - a) * (k - i) as f64 / (j - i) as f64,
            (Some((_, only)), None) | (None, Some(&(_, only))) => only,
            (None, None) => 0.0,
        }
    };
    (0..BINS).map(between).collect()
}

/// Resolution of the sensors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sensors {
    /// Step of the position, m.
    pub(super) position_step: f64,
    /// Standard deviation of the force noise, N.
    pub(super) force_noise: f64,
}

/// Least slope, N/m, at which the deformation force meets the sliding limits.
pub(super) fn end_stiffness(
    insertion_branch: &BranchFit,
    withdrawal_branch: &BranchFit,
    half_width: f64,
) -> f64 {
    let end = |curve: &[f64], high: bool| {
        let (a, b) = if high { (BINS - 11, BINS - 1) } else { (0, 10) };
        (curve[b] - curve[a]) / (10.0 * 2.0 * half_width / BINS as f64)
    };
    let least =
        end(&insertion_branch.mean_curve, true).min(end(&withdrawal_branch.mean_curve, false));
    // A flat end is as uncertain as its slope: never less than a twentieth of the slope at the
    // other end.
    least.max(0.05 * end(&insertion_branch.mean_curve, false).abs()).max(1.0)
}

/// Fits half width, branches and damping to the full reversals.
///
/// # Errors
/// A message that states why the recordings do not resolve a deformation.
pub(super) fn fit(
    full_reversals: Vec<FullReversal>,
    limits: &Limits,
    degrees: [usize; 2],
    sensors: Sensors,
) -> Result<DeformationFit, String> {
    let lsb = sensors.position_step;
    let full_reversals = without_outliers(full_reversals);
    let count = |d| full_reversals.iter().filter(|t| t.direction == d).count();
    let (insertions, withdrawals) = (count(Direction::Insertion), count(Direction::Withdrawal));
    if insertions + withdrawals < FEWEST_REVERSALS || insertions == 0 || withdrawals == 0 {
        return Err(format!(
            "reversals that deform the seal from one sliding limit to the other: {insertions} on insertion, {withdrawals} on withdrawal; at least \
             {FEWEST_REVERSALS} in all and one in each direction are needed (longer strokes, or more of them)"
        ));
    }
    let n = full_reversals.len() as f64;
    let mean = full_reversals.iter().map(|t| t.half_travel).sum::<f64>() / n;
    let spread = spread_of(&full_reversals);
    if spread > LARGEST_SPREAD * mean || mean < 5.0 * lsb {
        return Err(format!(
            "no repeatable deformation: half width {:.4} mm with a spread of {:.4} mm over {n} full reversals, position steps of {:.4} mm",
            1e3 * mean,
            1e3 * spread,
            1e3 * lsb
        ));
    }
    let branch = |d| branch_fit(&curves_of(&full_reversals, d), limits.end_forces(), degrees);
    let (Some(insertion_branch), Some(withdrawal_branch)) =
        (branch(Direction::Insertion), branch(Direction::Withdrawal))
    else {
        return Err("the deformation force could not be fitted by joined polynomials".to_owned());
    };
    // A switch is detected when the smoothed noise first reaches the limit: an error common to all
    // full reversals.
    let switching = sensors.force_noise
        / (SMOOTHING as f64).sqrt()
        / end_stiffness(&insertion_branch, &withdrawal_branch, mean);
    let scatter =
        mean_square(&insertion_branch.scatter).max(mean_square(&withdrawal_branch.scatter)).sqrt();
    let swing = limits.insertion + limits.withdrawal;
    if scatter > LARGEST_SCATTER * swing {
        return Err(format!(
            "no repeatable deformation: between full reversals the force scatters by {scatter:.2} N at equal deflection, of {swing:.2} N from \
             one sliding limit to the other"
        ));
    }
    let damping = damping_test(&full_reversals, spread, mean);
    let samples = median(full_reversals.iter().map(|t| 0.5 * (t.to - t.from) as f64).collect());
    let half_width = if samples < COARSEST {
        let why = format!(
            "sampled too coarsely: {samples:.1} samples per half width, at least {COARSEST} are needed"
        );
        Estimate::undetermined(mean, "m", why)
    } else {
        Estimate::from_standard_error(mean, (spread / n.sqrt()).hypot(switching), n - 2.0, "m")
    };
    Ok(DeformationFit {
        half_width,
        deflection_error: spread,
        speed_dependence_p_value: speed_dependence(&full_reversals),
        insertion_branch,
        withdrawal_branch,
        damping,
        full_reversals,
    })
}

/// Curves of one direction.
pub(super) fn curves_of(full_reversals: &[FullReversal], direction: Direction) -> Vec<&[f64]> {
    full_reversals.iter().filter(|t| t.direction == direction).map(|t| t.curve.as_slice()).collect()
}

/// Points (z/c, mean force over curves).
pub(super) fn mean_points(curves: &[&[f64]]) -> Vec<(f64, f64)> {
    let n = curves.len() as f64;
    bin_centres()
        .enumerate()
        .map(|(k, u)| (u, curves.iter().map(|c| c[k]).sum::<f64>() / n))
        .collect()
}

fn mean_square(values: &[f64]) -> f64 {
    values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64
}

fn branch_fit(curves: &[&[f64]], end_forces: EndForces, degrees: [usize; 2]) -> Option<BranchFit> {
    let points = mean_points(curves);
    let (shape, rms) = BranchShape::fit(degrees, end_forces, &points)?;
    let (single_polynomial, single_polynomial_rms) = single_polynomial(&points)?;
    let spread = |k: usize| {
        let squares: f64 = curves.iter().map(|c| (c[k] - points[k].1).powi(2)).sum();
        (squares / (curves.len().max(2) - 1) as f64).sqrt()
    };
    let scatter = (0..BINS).map(spread).collect();
    let mean_curve = points.iter().map(|p| p.1).collect();
    Some(BranchFit { shape, rms, single_polynomial, single_polynomial_rms, mean_curve, scatter })
}

/// The single 7th-degree polynomial of figure 8, in Legendre polynomials of z/c.
fn single_polynomial(points: &[(f64, f64)]) -> Option<(Vec<f64>, f64)> {
    let design = DMatrix::from_fn(points.len(), 8, |i, j| legendre(j, points[i].0));
    let data = DVector::from_fn(points.len(), |i, _| points[i].1);
    let fit = LinearFit::new(&design, &data, &DVector::from_element(points.len(), 1.0))?;
    Some((fit.coefficients.as_slice().to_vec(), (fit.weighted_rss / points.len() as f64).sqrt()))
}

/// Legendre polynomial P_order(t).
pub fn legendre(order: usize, t: f64) -> f64 {
    let (mut before, mut now) = (1.0, t);
    if order == 0 {
        return before;
    }
    for i in 1..order {
        (before, now) = (now, ((2 * i + 1) as f64 * t * now - i as f64 * before) / (i + 1) as f64);
    }
    now
}

/// p value of the slope of c against speed.
fn speed_dependence(full_reversals: &[FullReversal]) -> Option<f64> {
    let n = full_reversals.len();
    let design = DMatrix::from_fn(n, 2, |i, j| if j == 0 { 1.0 } else { full_reversals[i].speed });
    let data = DVector::from_fn(n, |i, _| full_reversals[i].half_travel);
    let fit = LinearFit::new(&design, &data, &DVector::from_element(n, 1.0))
        .filter(|f| f.degrees >= 3.0)?;
    Some(t_p_value(fit.coefficients[1] / fit.covariance[(1, 1)].sqrt(), fit.degrees))
}

/// Generalised least squares of F_jp = f_j + σ·v_jp + K_j·δ_p + e_jp over deflections j and
/// full reversals p.
///
/// δ_p is the error of the reconstructed deflection of the full reversal (sd from the spread of c),
/// common to its deflections. It represents the gray rectangles of figure 7 as a covariance.
fn damping_test(
    full_reversals: &[FullReversal],
    deflection_error: f64,
    half_width: f64,
) -> Option<DampingTest> {
    let speeds = full_reversals.iter().map(|t| t.speed);
    let (slow, fast) = speeds.fold((f64::INFINITY, 0.0f64), |(l, h), v| (l.min(v), h.max(v)));
    if fast < 1.2 * slow {
        return None;
    }
    let bins: Vec<usize> =
        LEVELS.iter().map(|u| (0.5 * (u + 1.0) * BINS as f64) as usize).collect();
    let levels = LEVELS.len();
    let columns = 2 * levels + 1;
    let mut design = DMatrix::zeros(levels * full_reversals.len(), columns);
    let mut data = DVector::zeros(levels * full_reversals.len());
    for direction in Direction::BOTH {
        let curves = curves_of(full_reversals, direction);
        let mean = mean_points(&curves);
        let stiffness: Vec<f64> = bins.iter().map(|b| slope(&mean, *b, half_width)).collect();
        let noise = level_noise(&curves, &mean, &bins);
        let whitening = whitening(&stiffness, deflection_error, noise)?;
        let block = if direction == Direction::Insertion { 0 } else { levels };
        for (p, t) in full_reversals.iter().enumerate().filter(|(_, t)| t.direction == direction) {
            let mut rows = DMatrix::zeros(levels, columns);
            let mut force = DVector::zeros(levels);
            for (j, b) in bins.iter().enumerate() {
                rows[(j, block + j)] = 1.0;
                rows[(j, columns - 1)] = t.velocity[*b];
                force[j] = t.curve[*b];
            }
            design.view_mut((p * levels, 0), (levels, columns)).copy_from(&(&whitening * rows));
            data.rows_mut(p * levels, levels).copy_from(&(&whitening * force));
        }
    }
    let rows = data.len();
    let fit = LinearFit::new(&design, &data, &DVector::from_element(rows, 1.0))?;
    // The full reversal is the independent unit: its deflections share one reconstruction error.
    let degrees = full_reversals.len() as f64 - 2.0;
    let sigma = fit.coefficients[columns - 1];
    let error = fit.covariance[(columns - 1, columns - 1)].sqrt();
    let p_value = t_p_value(sigma / error, degrees);
    let bound = (sigma.abs() + t_quantile(degrees) * error) * fast;
    let kept = p_value < 0.01 && sigma > 0.0 && sigma * fast > NEGLIGIBLE_DAMPING_FORCE;
    Some(DampingTest {
        seal_damping_n_s_m: Estimate::from_standard_error(sigma, error, degrees, "N s/m"),
        p_value,
        largest_force_n: sigma.abs() * fast,
        largest_force_not_excluded_n: bound,
        equivalent_to_zero: bound < NEGLIGIBLE_DAMPING_FORCE,
        kept,
        deflection_error_m: deflection_error,
    })
}

/// dF/dz, N/m, of a mean curve around bin `b`.
fn slope(mean: &[(f64, f64)], b: usize, half_width: f64) -> f64 {
    let (low, high) = (b.saturating_sub(4), (b + 4).min(BINS - 1));
    (mean[high].1 - mean[low].1) / ((mean[high].0 - mean[low].0) * half_width)
}

/// Force noise, N, at single deflections: scatter of neighbouring-bin differences, which a
/// deflection error does not affect.
fn level_noise(curves: &[&[f64]], mean: &[(f64, f64)], bins: &[usize]) -> f64 {
    let mut squares = 0.0;
    let mut n = 0.0;
    for curve in curves {
        for b in bins {
            let difference = (curve[b + 1] - curve[*b]) - (mean[b + 1].1 - mean[*b].1);
            (squares, n) = (squares + 0.5 * difference * difference, n + 1.0);
        }
    }
    (squares / f64::max(n, 1.0)).sqrt().max(1e-6)
}

/// Inverse Cholesky factor of σ_z²·K·Kᵀ + σ_e²·I.
fn whitening(stiffness: &[f64], deflection_error: f64, noise: f64) -> Option<DMatrix<f64>> {
    let n = stiffness.len();
    let covariance = DMatrix::from_fn(n, n, |i, j| {
        let own = if i == j { noise * noise } else { 0.0 };
        own + deflection_error * deflection_error * stiffness[i] * stiffness[j]
    });
    covariance.cholesky()?.l().try_inverse()
}
