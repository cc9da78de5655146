//! Estimates the profile from readings and the simulated force for them.
//!
//! Linear least squares with a penalty on second differences. The number of knots and the weight of
//! the penalty minimize the error on held-out cycles. A profile is returned only if it predicts
//! held-out cycles better than a constant does. Readings with large residuals (after a reversal,
//! where a millisecond matters) are downweighted with Huber's weights, whose scale is the median
//! absolute residual.

use rayon::prelude::*;
use serde::Serialize;
use trocar_model::profile::place;
use trocar_model::{PositionProfile, ProfileError};
use trocar_runtime::profile::mean_between_knots;

use super::banded::{Banded, Factor};
use super::is_passive;
use crate::segment::Stroke;
use trocar_recording::Recording;
use trocar_recording::cancel;

/// Candidate numbers of intervals between knots.
const INTERVALS: [usize; 8] = [4, 8, 16, 32, 48, 64, 96, 128];
/// Candidate weights of the squared second differences, in units of the readings per knot.
const ROUGHNESS: [f64; 5] = [1e-4, 1e-3, 1e-2, 1e-1, 1.0];
/// The same for the squared deviations from constants; it matters only where the readings do not
/// determine the values.
const RIDGE: f64 = 1e-3;
/// The same for gains fixed at 1.
const HELD: f64 = 1e9;
/// Fewest readings per knot.
const FEWEST_PER_KNOT: usize = 8;
/// Fewest and most folds of the cross-validation over cycles.
const FOLDS: [usize; 2] = [3, 10];
/// Smallest relative decrease of the held-out error.
const LEAST_GAIN: f64 = 0.03;
/// Smallest fraction of the folds in which the profile is better.
const LEAST_FOLDS: f64 = 0.75;
/// Held-out errors within this factor of the smallest count as equal, and the smoother profile is
/// chosen.
const AS_GOOD: f64 = 1.005;
/// Residuals beyond this many robust standard deviations are downweighted.
const HUBER: f64 = 2.5;
/// Fraction of the readings that may lie beyond the last knot at either end.
const BEYOND: f64 = 1e-3;

/// One reading with the simulated force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProfileSample {
    /// Position, m.
    pub position: f64,
    /// Simulated force of the seal, N, without the sensor offset.
    pub seal_force: f64,
    /// Reading, N.
    pub reading: f64,
    /// Number of the cycle; samples of one cycle are held out together.
    pub cycle: usize,
}

/// A profile with its supporting statistics.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ProfileFit {
    /// The profile.
    #[serde(serialize_with = "trocar_runtime::profile::serialize")]
    pub profile: PositionProfile<Vec<f64>>,
    /// Sensor offset estimated with it, N.
    pub offset_n: f64,
    /// Root mean square error over the readings used for the fit, N.
    pub rms_n: f64,
    /// The same over held-out cycles.
    pub held_out_rms_n: f64,
    /// The same for a constant offset and gain 1.
    pub constant_held_out_rms_n: f64,
    /// Folds of the cross-validation.
    pub folds: usize,
    /// Folds in which the profile is better than the constant.
    pub better_folds: usize,
    /// Chosen weight of the penalty, in units of the readings per knot.
    pub roughness: f64,
    /// Effective number of parameters (trace of the smoother), including the sensor offset.
    pub effective_parameters: f64,
}

impl ProfileFit {
    /// Free parameters: one offset and one gain per knot, less the mean gain and the sensor offset,
    /// which is counted elsewhere.
    pub fn free_parameters(&self) -> usize {
        2 * self.profile.gains().len() - 2
    }
}

/// Why there is no profile.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NoProfile {
    /// A non-finite number.
    #[error("sample {0} holds a value that is not finite")]
    NotFinite(usize),
    /// Too few cycles for cross-validation.
    #[error("{cycles} cycles, expected at least {}: a position profile is accepted only if it predicts cycles left out of the fit", FOLDS[0])]
    TooFewCycles {
        /// Cycles found.
        cycles: usize,
    },
    /// Too few readings, or all at one position.
    #[error("{samples} readings from {from} m to {to} m are too few for a profile")]
    TooFewReadings {
        /// Readings.
        samples: usize,
        /// Lowest position, m.
        from: f64,
        /// Highest position, m.
        to: f64,
    },
    /// Held-out cycles are not predicted better.
    #[error(
        "the error on held-out cycles is {profile:.4} N with a profile and {constant:.4} N without, smaller in \
         {better_folds} of {folds} parts: no repeatable dependence on the position"
    )]
    NotBetter {
        /// Held-out error with the best profile, N, with Huber's weights; that of the constant where the
        /// seal permits no profile.
        profile: f64,
        /// Held-out error of the constant, N, likewise.
        constant: f64,
        /// Folds in which the profile is better.
        better_folds: usize,
        /// Folds.
        folds: usize,
    },
    /// Held-out cycles are predicted better, but the gain varies too fast for the seal.
    #[error(
        "the error on held-out cycles is {:.4} N with a profile and {:.4} N without, but this seal, whose deformation \
         force falls in parts, could yield energy where its gain varies so fast",
        .any.held_out_rms_n, .any.constant_held_out_rms_n
    )]
    NotDissipative {
        /// The best profile of any slope.
        any: Box<ProfileFit>,
        /// ℓ, m.
        storage_length: f64,
    },
    /// The estimated values are not a valid profile.
    #[error(transparent)]
    Profile(#[from] ProfileError),
}

/// Number of the cycle (one motion there and one back) to which each sample belongs.
pub fn cycles(recording: &Recording, strokes: &[Stroke]) -> Vec<usize> {
    let mut numbers = vec![0; recording.len()];
    for (k, stroke) in strokes.iter().enumerate() {
        let until = strokes.get(k + 1).map_or(recording.len(), |next| next.start);
        numbers[stroke.start..until].fill(stroke.motion / 2);
    }
    numbers
}

/// Fits a profile. The gain is constrained so that a seal with `storage_length` (m, see
/// [`super::storage_length`]) stays dissipative; it is fixed at 1 if that length is infinite.
///
/// # Errors
/// [`NoProfile`] with the reason; [`NoProfile::NotBetter`] when the force does not depend on the
/// position, [`NoProfile::NotDissipative`] when it does, but too fast.
pub fn fit(samples: &[ProfileSample], storage_length: f64) -> Result<ProfileFit, NoProfile> {
    match passive(samples, storage_length) {
        Err(NoProfile::NotBetter { .. }) if storage_length > 0.0 => {
            let any = passive(samples, 0.0)?;
            if is_passive(&any.profile, storage_length) {
                return Ok(any);
            }
            Err(NoProfile::NotDissipative { any: Box::new(any), storage_length })
        }
        found => found,
    }
}

/// The best profile with which a seal of `storage_length` stays dissipative.
fn passive(samples: &[ProfileSample], storage_length: f64) -> Result<ProfileFit, NoProfile> {
    let mut data = Data::new(samples)?;
    data.gain_is_free = storage_length.is_finite();
    let mut weights = huber(&data.residuals(|s| data.constant_reading(s)));
    let mut best = data.choose(&weights, storage_length)?;
    weights = huber(&data.residuals(|s| best.reading(s)));
    best = data.choose(&weights, storage_length)?;
    let [profile, constant] = data.judge(&best, &weights)?;
    Ok(ProfileFit {
        rms_n: rms(data.residuals(|s| best.reading(s)).iter().copied()),
        offset_n: best.offset,
        held_out_rms_n: profile,
        constant_held_out_rms_n: constant,
        folds: data.folds,
        better_folds: best.better_folds,
        roughness: best.roughness,
        effective_parameters: best.effective_parameters,
        profile: best.profile,
    })
}

fn rms(errors: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = errors.fold((0.0, 0usize), |(sum, n), e| (sum + e * e, n + 1));
    (sum / count.max(1) as f64).sqrt()
}

/// Huber's weights; all 1 if the median residual is 0.
fn huber(residuals: &[f64]) -> Vec<f64> {
    let mut sizes: Vec<f64> = residuals.iter().map(|e| e.abs()).collect();
    let middle = sizes.len() / 2;
    let limit = HUBER * 1.4826 * *sizes.select_nth_unstable_by(middle, f64::total_cmp).1;
    residuals
        .iter()
        .map(|e| if e.abs() <= limit || limit == 0.0 { 1.0 } else { limit / e.abs() })
        .collect()
}

/// Data of the fit.
struct Data<'a> {
    samples: &'a [ProfileSample],
    /// Fold of each sample.
    fold: Vec<usize>,
    folds: usize,
    from: f64,
    to: f64,
    /// Root mean square of the seal's force, N; scales gains and offsets alike.
    force: f64,
    /// Mean difference between reading and seal force, N.
    offset: f64,
    /// Whether the gain may vary.
    gain_is_free: bool,
}

/// A candidate profile.
struct Candidate {
    profile: PositionProfile<Vec<f64>>,
    /// Sensor offset estimated with it, N.
    offset: f64,
    roughness: f64,
    /// Weighted mean squared error over held-out cycles, N².
    held_out: f64,
    constant: f64,
    better_folds: usize,
    effective_parameters: f64,
}

impl Candidate {
    /// Predicted reading of the sample, N.
    fn reading(&self, sample: &ProfileSample) -> f64 {
        self.offset + self.profile.apply(sample.position, sample.seal_force)
    }
}

/// Weighted sums over some samples: Σw·φ·φᵀ, Σw·φ·F and Σw·F². For each knot φ contains the hat
/// function (offset) and the hat function times the seal's force (gain).
#[derive(Clone)]
struct Sums {
    matrix: Banded,
    vector: Vec<f64>,
    power: f64,
    weight: f64,
}

impl Sums {
    fn zero(knots: usize) -> Self {
        let (matrix, vector) = (Banded::zero(2 * knots), vec![0.0; 2 * knots]);
        Self { matrix, vector, power: 0.0, weight: 0.0 }
    }

    fn combine(&self, other: &Self, sign: f64) -> Self {
        Self {
            matrix: self.matrix.plus(&other.matrix, sign),
            vector: self.vector.iter().zip(&other.vector).map(|(a, b)| a + sign * b).collect(),
            power: self.power + sign * other.power,
            weight: self.weight + sign * other.weight,
        }
    }

    /// Weighted sum of squared errors for the values `x`.
    fn squares(&self, x: &[f64]) -> f64 {
        (self.power - 2.0 * dot(&self.vector, x) + dot(x, &self.matrix.times(x))).max(0.0)
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl<'a> Data<'a> {
    fn new(samples: &'a [ProfileSample]) -> Result<Self, NoProfile> {
        let finite = |s: &ProfileSample| {
            s.position.is_finite() && s.seal_force.is_finite() && s.reading.is_finite()
        };
        if let Some(bad) = samples.iter().position(|s| !finite(s)) {
            return Err(NoProfile::NotFinite(bad));
        }
        let mut numbers: Vec<usize> = samples.iter().map(|s| s.cycle).collect();
        numbers.sort_unstable();
        numbers.dedup();
        if numbers.len() < FOLDS[0] {
            return Err(NoProfile::TooFewCycles { cycles: numbers.len() });
        }
        let folds = numbers.len().min(FOLDS[1]);
        let fold =
            samples.iter().map(|s| numbers.partition_point(|n| *n < s.cycle) % folds).collect();
        let mut positions: Vec<f64> = samples.iter().map(|s| s.position).collect();
        let beyond = (BEYOND * samples.len() as f64) as usize;
        let [from, to] = [beyond, samples.len() - 1 - beyond]
            .map(|place| *positions.select_nth_unstable_by(place, f64::total_cmp).1);
        if to <= from || samples.len() < FEWEST_PER_KNOT * (INTERVALS[0] + 1) {
            return Err(NoProfile::TooFewReadings { samples: samples.len(), from, to });
        }
        let count = samples.len() as f64;
        let force = rms(samples.iter().map(|s| s.seal_force)).max(f64::MIN_POSITIVE);
        let offset = samples.iter().map(|s| s.reading - s.seal_force).sum::<f64>() / count;
        Ok(Self { samples, fold, folds, from, to, force, offset, gain_is_free: true })
    }

    /// Predicted reading without a profile, N.
    fn constant_reading(&self, sample: &ProfileSample) -> f64 {
        self.offset + sample.seal_force
    }

    fn residuals(&self, says: impl Fn(&ProfileSample) -> f64) -> Vec<f64> {
        self.samples.iter().map(|s| s.reading - says(s)).collect()
    }

    /// Sums of each fold, with offsets relative to the mean offset and gains in units of the seal's
    /// force.
    fn sums(&self, knots: usize, weights: &[f64]) -> Vec<Sums> {
        let mut all = vec![Sums::zero(knots); self.folds];
        for ((sample, fold), w) in self.samples.iter().zip(&self.fold).zip(weights) {
            let (knot, part) = place(self.from, self.to, knots, sample.position);
            let force = sample.seal_force / self.force;
            let first = 2 * knot;
            let row = [1.0 - part, (1.0 - part) * force, part, part * force];
            let reading = sample.reading - self.offset;
            let sums = &mut all[*fold];
            for (i, a) in row.iter().enumerate() {
                row[..=i]
                    .iter()
                    .enumerate()
                    .for_each(|(j, b)| sums.matrix.add(first + i, first + j, w * a * b));
                sums.vector[first + i] += w * a * reading;
            }
            sums.power += w * reading * reading;
            sums.weight += w;
        }
        all
    }

    /// The candidate that predicts held-out cycles best, or equally well with fewer parameters.
    fn choose(&self, weights: &[f64], storage_length: f64) -> Result<Candidate, NoProfile> {
        let most = self.samples.len() / FEWEST_PER_KNOT;
        let with_knots = |knots: usize| {
            let parts = self.sums(knots, weights);
            let all = parts[1..].iter().fold(parts[0].clone(), |sum, part| sum.combine(part, 1.0));
            ROUGHNESS.iter().filter_map(move |rough| self.candidate(&parts, &all, knots, *rough))
        };
        let knots = INTERVALS.par_iter().map(|n| n + 1).filter(|knots| *knots <= most);
        let mut candidates: Vec<Candidate> = knots.flat_map_iter(with_knots).collect();
        candidates.retain(|c: &Candidate| is_passive(&c.profile, storage_length));
        let least = candidates.iter().map(|c| c.held_out).fold(f64::INFINITY, f64::min);
        let as_good = candidates.into_iter().filter(|c| c.held_out <= AS_GOOD * AS_GOOD * least);
        let stiffest =
            as_good.min_by(|a, b| a.effective_parameters.total_cmp(&b.effective_parameters));
        stiffest.ok_or_else(|| {
            let constant = rms(self.residuals(|s| self.constant_reading(s)).into_iter());
            let (better_folds, folds) = (0, self.folds);
            NoProfile::NotBetter { profile: constant, constant, better_folds, folds }
        })
    }

    fn candidate(
        &self,
        parts: &[Sums],
        all: &Sums,
        knots: usize,
        roughness: f64,
    ) -> Option<Candidate> {
        cancel::check();
        let penalty = self.penalty(knots, roughness);
        let (mut held_out, mut constant, mut better_folds) = (0.0, 0.0, 0);
        for part in parts {
            let others = all.combine(part, -1.0);
            let solved = Solved::new(&others, &penalty, knots, self.force)?;
            let with = part.squares(&solved.values);
            let without = part.squares(&constant_values(&others, knots, self.force));
            held_out += with / all.weight;
            constant += without / all.weight;
            better_folds += usize::from(with < without);
        }
        let solved = Solved::new(all, &penalty, knots, self.force)?;
        let offset: Vec<f64> = solved.values.iter().step_by(2).copied().collect();
        let mean = mean_between_knots(&offset);
        let offset = offset.iter().map(|o| o - mean).collect();
        let gain_of = |value: &f64| if self.gain_is_free { value / self.force } else { 1.0 };
        let gain: Vec<f64> = solved.values.iter().skip(1).step_by(2).map(gain_of).collect();
        let profile = PositionProfile::new(self.from, self.to, offset, gain).ok()?;
        let effective_parameters = solved.effective_parameters(all);
        Some(Candidate {
            profile,
            offset: self.offset + mean,
            roughness,
            held_out,
            constant,
            better_folds,
            effective_parameters,
        })
    }

    fn penalty(&self, knots: usize, roughness: f64) -> Banded {
        let unit = self.samples.len() as f64 / knots as f64;
        let of_gain = if self.gain_is_free { RIDGE } else { HELD };
        penalty(knots, roughness * unit, [RIDGE * unit, of_gain * unit])
    }

    /// Unweighted held-out errors of the candidate and of the constant, N.
    ///
    /// # Errors
    /// [`NoProfile::NotBetter`] when the weighted error decreases too little or in too few folds,
    /// or the unweighted one increases.
    fn judge(&self, best: &Candidate, weights: &[f64]) -> Result<[f64; 2], NoProfile> {
        let (profile, constant) = (best.held_out.sqrt(), best.constant.sqrt());
        let refuse = |[profile, constant]: [f64; 2]| NoProfile::NotBetter {
            profile,
            constant,
            better_folds: best.better_folds,
            folds: self.folds,
        };
        let enough = best.better_folds as f64 >= LEAST_FOLDS * self.folds as f64;
        if profile > (1.0 - LEAST_GAIN) * constant || !enough {
            return Err(refuse([profile, constant]));
        }
        let knots = best.profile.gains().len();
        let penalty = self.penalty(knots, best.roughness);
        let weighted = self.sums(knots, weights);
        let plain = self.sums(knots, &vec![1.0; self.samples.len()]);
        let all =
            weighted[1..].iter().fold(weighted[0].clone(), |sum, part| sum.combine(part, 1.0));
        let mut squares = [0.0; 2];
        for (part, scored) in weighted.iter().zip(&plain) {
            let others = all.combine(part, -1.0);
            let solved = Solved::new(&others, &penalty, knots, self.force)
                .ok_or_else(|| refuse([profile, constant]))?;
            squares[0] += scored.squares(&solved.values);
            squares[1] += scored.squares(&constant_values(&others, knots, self.force));
        }
        let errors = squares.map(|sum| (sum / self.samples.len() as f64).sqrt());
        if errors[0] >= errors[1] { Err(refuse(errors)) } else { Ok(errors) }
    }
}

/// Squared second differences of offsets and of gains, and a ridge on the first differences of
/// both.
fn penalty(knots: usize, roughness: f64, ridges: [f64; 2]) -> Banded {
    let mut matrix = Banded::zero(2 * knots);
    for (side, ridge) in ridges.into_iter().enumerate() {
        let mut add = |knot: usize, row: &[f64], weight: f64| {
            let at = |k: usize| 2 * (knot + k) + side;
            for (i, a) in row.iter().enumerate() {
                row[..=i]
                    .iter()
                    .enumerate()
                    .for_each(|(j, b)| matrix.add(at(i), at(j), weight * a * b));
            }
        };
        (0..knots - 2).for_each(|knot| add(knot, &[1.0, -2.0, 1.0], roughness));
        (0..knots - 1).for_each(|knot| add(knot, &[1.0, -1.0], ridge));
        add(0, &[1.0], 1e-3 * ridge);
    }
    matrix
}

/// Values of all knots, offset and gain.
fn all_knots(knots: usize, offset: impl Fn(usize) -> f64, gain: impl Fn(usize) -> f64) -> Vec<f64> {
    (0..knots).flat_map(|k| [offset(k), gain(k)]).collect()
}

/// Only the offset by least squares, gain 1.
fn constant_values(sums: &Sums, knots: usize, force: f64) -> Vec<f64> {
    let gain = all_knots(knots, |_| 0.0, |_| force);
    let ones = all_knots(knots, |_| 1.0, |_| 0.0);
    let with_ones = sums.matrix.times(&ones);
    let offset = (dot(&sums.vector, &ones) - dot(&with_ones, &gain)) / dot(&with_ones, &ones);
    all_knots(knots, |_| offset, |_| force)
}

/// The penalised least-squares values with the gauge constraint: mean gain 1.
struct Solved {
    values: Vec<f64>,
    factor: Factor,
    gauge: Vec<f64>,
    /// S⁻¹·gauge.
    along: Vec<f64>,
}

impl Solved {
    /// `None` if the sums determine nothing.
    fn new(sums: &Sums, penalty: &Banded, knots: usize, force: f64) -> Option<Self> {
        let factor = sums.matrix.plus(penalty, 1.0).factor()?;
        let share = |i: usize| {
            let mut unit = vec![0.0; knots];
            unit[i] = 1.0;
            mean_between_knots(&unit)
        };
        let gauge = all_knots(knots, |_| 0.0, share);
        let free = factor.solve(&sums.vector);
        let along = factor.solve(&gauge);
        let missing = (force - dot(&gauge, &free)) / dot(&gauge, &along);
        let values = free.iter().zip(&along).map(|(free, along)| free + missing * along).collect();
        Some(Self { values, factor, gauge, along })
    }

    /// Trace of the smoother with the gauge constraint.
    fn effective_parameters(&self, sums: &Sums) -> f64 {
        let free = self.factor.inverse_in_band().trace_of_product(&sums.matrix);
        free - dot(&self.along, &sums.matrix.times(&self.along)) / dot(&self.gauge, &self.along)
    }
}
