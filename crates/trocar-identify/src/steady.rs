//! Steady state: sliding force as a function of velocity, from one mean per stroke (EMS section
//! IV-A).
//!
//! # Equations (key EMS in SOURCES.md)
//! ```text
//! F = F_0 + F_c·sgn(v) + β·v                                        (23) with a sensor offset F_0
//! F = F_0 + (F_c + (F_s − F_c)·exp(−(|v|/v_s)^δ))·sgn(v) + β·v      (11)
//! ```
//! The samples of one stroke are not independent: differences between strokes (lubrication,
//! position along the stroke) do not average out within a stroke. So one stroke gives one datum,
//! weighted by 1/(τ² + s²/n_eff) with the scatter between strokes τ estimated from the data.
//! Intervals use Student's t on the number of strokes.
//!
//! A sensor offset and a difference of the Coulomb force between the directions shift the two lines
//! alike, so the data cannot separate them. The test is therefore whether the slopes differ.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use super::estimate::{Estimate, LinearFit, t_p_value};
use super::findings::IdentifyError;
use trocar_recording::{Recording, local_velocity};
use trocar_simulate::segment::{Direction, SteadySegment, Stroke, after_start};

const NO_STEADY_SEGMENT: &str = "no constant-velocity segment after the deformation";

/// Mean force and velocity of the steady sliding in one stroke at one speed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StrokeMean {
    /// Index of the recording.
    pub recording: usize,
    /// Number of the plateau of velocity in the recording.
    pub plateau: usize,
    /// First sample.
    pub sample: usize,
    /// Fraction of the motion's time at this speed, 0 to 1.
    pub dwell: f64,
    /// Sense of the motion.
    #[serde(serialize_with = "trocar_simulate::segment::direction_as_word")]
    pub direction: Direction,
    /// Mean velocity, m/s.
    pub velocity_m_s: f64,
    /// Mean reading, N, sensor offset included.
    pub force_n: f64,
    /// Standard error, N, of the mean within the stroke.
    pub standard_error_n: f64,
    /// Standard deviation, N, of the samples about the mean.
    pub scatter_n: f64,
    /// Samples averaged.
    pub samples: usize,
}

/// The straight line of one direction through the readings, offset included: F = ±(F_c + β·|v|).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DirectionLine {
    /// Force at zero speed, N, positive against the motion; includes the sensor offset.
    pub coulomb_force_n: Estimate,
    /// Slope, N s/m.
    pub viscous_damping_n_s_m: Estimate,
}

/// A Stribeck curve that the lack-of-fit test requires and the measured speeds determine.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StribeckFit {
    /// F_s, N: the fitted curve extrapolated to zero speed.
    pub static_force_n: Estimate,
    /// v_s, m/s.
    pub stribeck_velocity_m_s: Estimate,
    /// δ.
    pub stribeck_exponent: f64,
}

/// Outcome of the lack-of-fit test of the straight line against a Stribeck curve.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LackOfFit {
    /// p value of the largest F statistic over all Stribeck velocities, from a seeded simulation
    /// under the line.
    pub p_value: f64,
    /// Best Stribeck velocity, m/s.
    pub stribeck_velocity_m_s: f64,
    /// Excess of the best Stribeck curve over the line at the slowest speed measured, N.
    pub excess_at_slowest_n: f64,
    /// Conclusion of the test.
    pub verdict: String,
}

/// Result of the steady-state step.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SteadyFit {
    /// F_c, N.
    pub coulomb_force_n: Estimate,
    /// β, N s/m.
    pub viscous_damping_n_s_m: Estimate,
    /// F_0, N.
    pub offset_n: Estimate,
    /// Line of the insertions.
    pub insertion: Option<DirectionLine>,
    /// Line of the withdrawals.
    pub withdrawal: Option<DirectionLine>,
    /// p value of the hypothesis that both directions have the same slope; `None` where it could
    /// not be tested.
    pub symmetry_p_value: Option<f64>,
    /// Accepted Stribeck curve.
    pub stribeck: Option<StribeckFit>,
    /// Lack-of-fit test, when enough speeds were measured.
    pub lack_of_fit: Option<LackOfFit>,
    /// Scatter of the mean sliding force between strokes, N.
    pub stroke_mean_scatter_n: f64,
    /// Slowest and fastest speed measured, m/s.
    pub speed_range_m_s: [f64; 2],
    /// The data: one mean per stroke and speed.
    pub means: Vec<StrokeMean>,
}

impl SteadyFit {
    /// Whether the slopes of the two directions differ significantly (1 % level).
    pub fn is_asymmetric(&self) -> bool {
        self.symmetry_p_value.is_some_and(|p| p < 0.01)
    }

    /// Fitted reading, N, at velocity `v`, m/s: the common line (23), or the Stribeck curve (11) if
    /// accepted.
    pub fn line(&self, v: f64) -> f64 {
        let bump = self.stribeck.as_ref().map_or(0.0, |s| {
            let rise = s.static_force_n.value - self.coulomb_force_n.value;
            rise * (-(v.abs() / s.stribeck_velocity_m_s.value).powf(s.stribeck_exponent)).exp()
        });
        self.offset_n.value
            + (self.coulomb_force_n.value + bump) * sign(v)
            + self.viscous_damping_n_s_m.value * v
    }
}

/// Sign, with 0 at rest.
pub(super) fn sign(v: f64) -> f64 {
    if v > 0.0 {
        1.0
    } else if v < 0.0 {
        -1.0
    } else {
        0.0
    }
}

/// Means over the steady part of each stroke: samples of its constant-velocity segments that lie at
/// least `settled(|v|)` metres after the reversal.
///
/// The segments of one plateau form one datum.
pub(super) fn stroke_means(
    index: usize,
    recording: &Recording,
    strokes: &[Stroke],
    steady_segments: &[SteadySegment],
    settled: impl Fn(f64) -> f64,
) -> Vec<StrokeMean> {
    let parts = after_start(recording, strokes, steady_segments, settled);
    let mut means: Vec<StrokeMean> = Vec::new();
    for direction in Direction::BOTH {
        let own: Vec<SteadySegment> =
            parts.iter().filter(|s| strokes[s.stroke].direction == direction).copied().collect();
        for segment in over_common_positions(recording, own) {
            let Some(mean) = mean_of(index, recording, &segment, direction) else { continue };
            match means.iter_mut().rev().find(|m| m.plateau == mean.plateau) {
                Some(earlier) => *earlier = merged(earlier, &mean),
                None => means.push(mean),
            }
        }
    }
    means.sort_by_key(|m| m.sample);
    means
}

/// The parts of the segments over the positions common to (nearly) all of them, if these parts
/// have at least a third of the usual length.
///
/// A friction that changes along the stroke then affects all speeds equally. Otherwise slow
/// strokes, whose plateaus are longer, would include the ends of the stroke.
fn over_common_positions(
    recording: &Recording,
    steady_segments: Vec<SteadySegment>,
) -> Vec<SteadySegment> {
    let x = &recording.position;
    // Ends of the plateaus: a plateau may be split into several segments.
    let mut plateaus: BTreeMap<usize, (f64, f64)> = BTreeMap::new();
    for s in &steady_segments {
        let (a, b) = (x[s.start].min(x[s.end - 1]), x[s.start].max(x[s.end - 1]));
        let ends = plateaus.entry(s.plateau).or_insert((a, b));
        *ends = (ends.0.min(a), ends.1.max(b));
    }
    let quantile = |of: fn(&(f64, f64)) -> f64, part: f64| {
        let mut values: Vec<f64> = plateaus.values().map(of).collect();
        values.sort_by(f64::total_cmp);
        values[(part * (values.len() - 1) as f64).round() as usize]
    };
    if plateaus.len() < 2 {
        return steady_segments;
    }
    let (low, high) = (quantile(|e| e.0, 0.9), quantile(|e| e.1, 0.1));
    if high - low < quantile(|e| e.1 - e.0, 0.5) / 3.0 {
        return steady_segments;
    }
    let inside = |i: &usize| (low..=high).contains(&x[*i]);
    let common = |s: &SteadySegment| {
        let start = (s.start..s.end).find(inside)?;
        let end = (start..s.end).rev().find(inside)? + 1;
        Some(SteadySegment { start, end, ..*s })
    };
    steady_segments.iter().filter_map(common).collect()
}

fn merged(a: &StrokeMean, b: &StrokeMean) -> StrokeMean {
    let (na, nb) = (a.samples as f64, b.samples as f64);
    let blend = |x: f64, y: f64| (na * x + nb * y) / (na + nb);
    StrokeMean {
        velocity_m_s: blend(a.velocity_m_s, b.velocity_m_s),
        force_n: blend(a.force_n, b.force_n),
        standard_error_n: (na * a.standard_error_n).hypot(nb * b.standard_error_n) / (na + nb),
        scatter_n: blend(a.scatter_n.powi(2), b.scatter_n.powi(2)).sqrt(),
        samples: a.samples + b.samples,
        ..a.clone()
    }
}

/// Mean over a segment; its error from the scatter of ten batch means, which includes slow ripple.
fn mean_of(
    index: usize,
    rec: &Recording,
    segment: &SteadySegment,
    direction: Direction,
) -> Option<StrokeMean> {
    let SteadySegment { start, end, .. } = *segment;
    let n = end.saturating_sub(start);
    if n < 5
        || rec.time[end - 1] - rec.time[start] < 0.04
        || (start..end).any(|i| rec.is_clipped(i))
    {
        return None;
    }
    let force = &rec.force[start..end];
    let mean = force.iter().sum::<f64>() / n as f64;
    let batches = if n >= 50 { 10 } else { 5 };
    let batch_mean = |k: usize| {
        let part = &force[k * n / batches..(k + 1) * n / batches];
        part.iter().sum::<f64>() / part.len() as f64
    };
    let variance =
        (0..batches).map(|k| (batch_mean(k) - mean).powi(2)).sum::<f64>() / (batches - 1) as f64;
    let rounding = rec.quality.force_resolution / 12f64.sqrt();
    let velocity =
        (rec.position[end - 1] - rec.position[start]) / (rec.time[end - 1] - rec.time[start]);
    Some(StrokeMean {
        recording: index,
        plateau: segment.plateau,
        sample: start,
        dwell: segment.dwell,
        direction,
        velocity_m_s: velocity,
        force_n: mean,
        standard_error_n: (variance / batches as f64)
            .sqrt()
            .max(rounding / (n as f64).sqrt())
            .max(1e-9),
        scatter_n: (force.iter().map(|f| (f - mean).powi(2)).sum::<f64>() / n as f64).sqrt(),
        samples: n,
    })
}

/// The means of motions whose speed was imposed, if they determine the line; else all.
///
/// Under a constant push the speed responds to the friction of the stroke, so its scatter is an
/// error of the regressor, not of the force. A motion that keeps one speed for half of its time was
/// driven at that speed.
pub(super) fn imposed(means: Vec<StrokeMean>) -> Vec<StrokeMean> {
    const IMPOSED: f64 = 0.5;
    let own: Vec<StrokeMean> = means.iter().filter(|m| m.dwell >= IMPOSED).cloned().collect();
    let determined = Direction::BOTH.into_iter().all(|d| speeds_differ(&own, d));
    if determined && own.len() >= 6 { own } else { means }
}

/// Means over blocks of all sliding motion, for an axis without deformation whose inertia was
/// removed: there the transients between constant speeds follow (23) too.
///
/// A block is `duration` s of motion in one direction, faster than `slowest` m/s.
pub(super) fn moving_means(
    index: usize,
    recording: &Recording,
    strokes: &[Stroke],
    slowest: f64,
    duration: f64,
) -> Vec<StrokeMean> {
    let velocity = local_velocity(recording, (20.0 * recording.quality.median_interval).max(0.05));
    let mut means = Vec::new();
    for (number, stroke) in strokes.iter().enumerate() {
        let sign = stroke.direction.sign();
        let moving: Vec<usize> =
            (stroke.start..stroke.end).filter(|i| sign * velocity[*i] > slowest).collect();
        let samples = ((duration / recording.quality.median_interval) as usize).max(5);
        for block in moving.chunks_exact(samples) {
            let n = samples as f64;
            let mean = |of: &dyn Fn(usize) -> f64| block.iter().map(|i| of(*i)).sum::<f64>() / n;
            let force = mean(&|i| recording.force[i]);
            let scatter = mean(&|i| (recording.force[i] - force).powi(2));
            means.push(StrokeMean {
                recording: index,
                plateau: number,
                sample: block[0],
                dwell: 0.0,
                direction: stroke.direction,
                velocity_m_s: mean(&|i| velocity[i]),
                force_n: force,
                // Within a transient the force follows the speed, so its scatter is no measure of
                // error. All blocks have equal weight.
                standard_error_n: (recording.quality.force_noise / n.sqrt()).max(1e-9),
                scatter_n: scatter.sqrt(),
                samples,
            });
        }
    }
    means
}

/// Fits the steady-state law to the stroke means.
///
/// Never fails: parameters that the means do not determine are returned as not determined, with the
/// reason (EMS (23)).
pub(super) fn fit(means: Vec<StrokeMean>) -> SteadyFit {
    let positive = direction_line(&means, Direction::Insertion);
    let negative = direction_line(&means, Direction::Withdrawal);
    let speeds = means.iter().map(|m| m.velocity_m_s.abs());
    let slowest = speeds.clone().fold(f64::INFINITY, f64::min);
    let fastest = speeds.fold(0.0, f64::max);
    let mut fit = common_line(&means);
    fit.symmetry_p_value = symmetry_p_value(&means);
    fit.speed_range_m_s = if means.is_empty() { [0.0, 0.0] } else { [slowest, fastest] };
    (fit.insertion, fit.withdrawal) = (positive, negative);
    fit.means = means;
    fit
}

/// Negative work, as a fraction of F_c times the path, that shows a force of the wrong sign.
const CLEARLY: f64 = 0.2;

/// Initial forces where no motion is steady; none of them is reliable.
///
/// The force is mostly near the sliding force of either direction: F_0 ± F_c are its 5 % and 95 %
/// quantiles.
///
/// # Errors
/// [`IdentifyError::ForceSign`] when the motion extracts work from the seal.
pub(super) fn from_levels(recordings: &[Recording]) -> Result<SteadyFit, IdentifyError> {
    let mut forces: Vec<f64> = recordings.iter().flat_map(|r| r.force.iter().copied()).collect();
    forces.sort_by(f64::total_cmp);
    let quantile = |part: f64| forces[(part * (forces.len() - 1) as f64) as usize];
    let (low, high) = (quantile(0.05), quantile(0.95));
    let (offset, coulomb) = (0.5 * (low + high), 0.5 * (high - low));
    let work = |r: &Recording| -> f64 {
        let one = |i: usize| {
            (0.5 * (r.force[i] + r.force[i - 1]) - offset) * (r.position[i] - r.position[i - 1])
        };
        r.unbroken().flat_map(|range| range.start + 1..range.end).map(one).sum()
    };
    let path = |r: &Recording| -> f64 { r.position.windows(2).map(|x| (x[1] - x[0]).abs()).sum() };
    let most: f64 = coulomb * recordings.iter().map(path).sum::<f64>();
    if recordings.iter().map(work).sum::<f64>() < -CLEARLY * most {
        return Err(IdentifyError::force_sign(-coulomb, recordings));
    }
    let none = |value, unit| Estimate::undetermined(value, unit, NO_STEADY_SEGMENT);
    let mut levels = blank(none(coulomb, "N"), none(0.0, "N s/m"), none(offset, "N"));
    let mut speeds: Vec<f64> =
        recordings.iter().flat_map(|r| local_velocity(r, 0.05)).map(f64::abs).collect();
    speeds.sort_by(f64::total_cmp);
    let fast = speeds[(0.95 * (speeds.len() - 1) as f64) as usize].max(1e-3);
    levels.speed_range_m_s = [0.1 * fast, fast];
    Ok(levels)
}

fn blank(coulomb: Estimate, viscous: Estimate, offset: Estimate) -> SteadyFit {
    SteadyFit {
        coulomb_force_n: coulomb,
        viscous_damping_n_s_m: viscous,
        offset_n: offset,
        insertion: None,
        withdrawal: None,
        symmetry_p_value: None,
        stribeck: None,
        lack_of_fit: None,
        stroke_mean_scatter_n: 0.0,
        speed_range_m_s: [0.0, 0.0],
        means: Vec::new(),
    }
}

/// Whether the speeds of one direction determine a slope: the fastest is at least a fifth above the
/// slowest, and at least a quarter of the means differ from the usual speed by a tenth. A single
/// odd stroke among many at one speed determines nothing.
fn speeds_differ(means: &[StrokeMean], direction: Direction) -> bool {
    let own = means.iter().filter(|m| m.direction == direction);
    let mut speeds: Vec<f64> = own.map(|m| m.velocity_m_s.abs()).collect();
    speeds.sort_by(f64::total_cmp);
    let (Some(slowest), Some(fastest)) = (speeds.first(), speeds.last()) else { return false };
    let usual = speeds[speeds.len() / 2];
    let off = speeds.iter().filter(|v| (*v / usual - 1.0).abs() > 0.1).count();
    *fastest > 1.2 * slowest && 4 * off >= speeds.len()
}

fn has(means: &[StrokeMean], direction: Direction) -> bool {
    means.iter().any(|m| m.direction == direction)
}

/// F = F_0 + F_c·sgn(v) + β·v, or as much of it as the means determine.
fn common_line(means: &[StrokeMean]) -> SteadyFit {
    let both = has(means, Direction::Insertion) && has(means, Direction::Withdrawal);
    let slope =
        speeds_differ(means, Direction::Insertion) || speeds_differ(means, Direction::Withdrawal);
    if means.is_empty() {
        let none = |unit| Estimate::undetermined(0.0, unit, NO_STEADY_SEGMENT);
        return blank(none("N"), none("N s/m"), none("N"));
    }
    let one_way = "steady sliding in one direction only: a Coulomb force and a sensor offset cannot be distinguished";
    let one_speed = "each direction has one speed: the viscous part cannot be distinguished from the Coulomb force";
    let level = usize::from(both);
    let columns: [fn(f64) -> f64; 3] = [|_| 1.0, sign, |v| v];
    let (fit, scatter) = weighted(means, &columns[1 - level..2 + usize::from(slope)]);
    let Some(fit) = fit else { return common_line(&[]) };
    let coulomb = match (both, slope) {
        (true, true) => fit.estimate(level, "N"),
        (true, false) => Estimate::undetermined(fit.coefficients[level], "N", one_speed),
        (false, _) => Estimate::undetermined(fit.coefficients[level], "N", one_way),
    };
    let viscous = match slope {
        true => fit.estimate(level + 1, "N s/m"),
        false => Estimate::undetermined(0.0, "N s/m", one_speed),
    };
    let offset = match both {
        true => fit.estimate(0, "N"),
        false => Estimate::undetermined(0.0, "N", one_way),
    };
    SteadyFit { stroke_mean_scatter_n: scatter, ..blank(coulomb, viscous, offset) }
}

/// The line of one direction alone, through the readings including the offset.
pub(super) fn direction_line(means: &[StrokeMean], direction: Direction) -> Option<DirectionLine> {
    let own: Vec<StrokeMean> = means.iter().filter(|m| m.direction == direction).cloned().collect();
    if own.is_empty() {
        return None;
    }
    if !speeds_differ(&own, direction) {
        let why = "one speed only: the viscous part cannot be distinguished from the Coulomb force";
        let fit = weighted(&own, &[sign]).0?;
        return Some(DirectionLine {
            coulomb_force_n: Estimate::undetermined(fit.coefficients[0], "N", why),
            viscous_damping_n_s_m: Estimate::undetermined(0.0, "N s/m", why),
        });
    }
    let fit = weighted(&own, &[sign, |v| v]).0?;
    Some(DirectionLine {
        coulomb_force_n: fit.estimate(0, "N"),
        viscous_damping_n_s_m: fit.estimate(1, "N s/m"),
    })
}

/// p value of the hypothesis of equal slopes: t test of a slope difference in addition to the
/// common line.
fn symmetry_p_value(means: &[StrokeMean]) -> Option<f64> {
    if !speeds_differ(means, Direction::Insertion) || !speeds_differ(means, Direction::Withdrawal) {
        return None;
    }
    let (fit, _) = weighted(means, &[|_| 1.0, sign, |v| v, |v| v.abs()]);
    let fit = fit?;
    Some(t_p_value(fit.coefficients[3] / fit.covariance[(3, 3)].sqrt(), fit.degrees))
}

/// Weighted least squares of the means on functions of velocity; also the scatter between strokes
/// τ, N.
///
/// τ² is the value at which the weighted residuals have their expected size (method of Paule and
/// Mandel). The covariance includes the residual variance factor, so intervals follow Student's t
/// with the number of strokes.
pub(super) fn weighted(
    means: &[StrokeMean],
    columns: &[fn(f64) -> f64],
) -> (Option<LinearFit>, f64) {
    let design =
        DMatrix::from_fn(means.len(), columns.len(), |i, j| columns[j](means[i].velocity_m_s));
    weighted_design(means, &design)
}

fn weighted_design(means: &[StrokeMean], design: &DMatrix<f64>) -> (Option<LinearFit>, f64) {
    let data = DVector::from_iterator(means.len(), means.iter().map(|m| m.force_n));
    let fit_with = |tau2: f64| {
        let weights = DVector::from_iterator(
            means.len(),
            means.iter().map(|m| 1.0 / (tau2 + m.standard_error_n.powi(2))),
        );
        LinearFit::new(design, &data, &weights)
    };
    let Some(plain) = fit_with(0.0) else { return (None, 0.0) };
    if plain.degrees <= 0.0 || plain.weighted_rss <= plain.degrees {
        return (Some(plain), 0.0);
    }
    let (mut low, mut high) = (0.0, plain.residuals.norm_squared());
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        match fit_with(middle) {
            Some(f) if f.weighted_rss > f.degrees => low = middle,
            _ => high = middle,
        }
    }
    (fit_with(high), high.sqrt())
}
