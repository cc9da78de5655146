//! Recordings in which the instrument turns: what that takes from an axial model, and how the seal
//! resists it ([`trocar_model::rotation`]).

use std::f64::consts::PI;

use nalgebra::{Matrix2, Vector2};
use rayon::prelude::*;
use trocar_model::{Quantity, Rotation, Trocar, Tunable};

use super::estimate::{Estimate, MANY_DEGREES, t_quantile};
use super::findings::{IdentifyError, Parameter, Warning};
use super::numbers;
use super::options::IdentifyOptions;
use super::result::Identification;
use trocar_recording::{Recording, range};
use trocar_simulate::replay::replay;

/// Shaft of the usual 10 mm instrument, m: the radius for the size of the effect.
const SHAFT_RADIUS: f64 = 5e-3;

/// Time over which the motion is followed, s, and least speed along the axis, m/s: below it there
/// is hardly any sliding.
const STRIDE: f64 = 0.02;
const SLOWEST: f64 = 1e-3;

/// Part of the Coulomb force that may be lost unnoticed.
const TOO_MUCH: f64 = 0.01;

/// What turning takes from the axial force while the instrument slides.
struct Loss {
    /// Part of an isotropic Coulomb force, mean over the travel.
    part: f64,
    /// Fastest turning, rad/s.
    fastest: f64,
}

impl Loss {
    /// `None` without an angle or without sliding.
    fn of(recording: &Recording) -> Option<Self> {
        let (angle, x, t) = (recording.angle.as_ref()?, &recording.position, &recording.time);
        let (mut travel, mut kept, mut fastest) = (0.0, 0.0, 0.0_f64);
        for range in recording.unbroken() {
            let mut from = range.start;
            for to in range {
                let duration = t[to] - t[from];
                if duration < STRIDE {
                    continue;
                }
                let (dx, turned) = ((x[to] - x[from]).abs(), (angle[to] - angle[from]).abs());
                if dx > SLOWEST * duration {
                    travel += dx;
                    kept += dx * dx / dx.hypot(SHAFT_RADIUS * turned); // steady sliding, `trocar_model::rotation`
                    fastest = fastest.max(turned / duration);
                }
                from = to;
            }
        }
        (travel > 0.0).then(|| Self { part: 1.0 - kept / travel, fastest })
    }
}

/// Names the recordings whose friction turning makes too small.
pub(super) fn unmodelled(recordings: &[Recording]) -> impl Iterator<Item = Warning> {
    recordings.iter().filter_map(|recording| {
        let Loss { part, fastest } = Loss::of(recording).filter(|loss| loss.part > TOO_MUCH)?;
        let message = format!(
            "the instrument turns by up to {:.0} deg/s while it slides, which takes {:.0} % of the Coulomb force away on a \
             10 mm shaft with equal friction around and along it; the friction found here is too small by as much\n\nhint: \
             ‹shaft_diameter_mm› takes the rotation into account; or leave out the part that turns with ‹from_s› and ‹to_s›",
            fastest * 180.0 / PI,
            1e2 * part
        );
        Some(Warning::doubt(recording, message))
    })
}

/// Prior standard deviations of the friction scale of a recording and of its offset, N: friction
/// changes by a per cent or two from recording to recording.
const SCALE_DEVIATION: f64 = 0.02;
const OFFSET_DEVIATION: f64 = 0.1;

/// Samples whose errors count as dependent, s.
const BLOCK: f64 = 1.0;
/// Widest interval of a number that counts as determined, as a factor to either side.
const DETERMINED: f64 = 1.5;
/// Least arc around the shaft that is turning, m: an angle sensor at rest shows none.
const TURNING: f64 = 5e-4;
/// Step of the derivatives, in logarithms of the numbers, and most iterations.
const STEP: f64 = 1e-3;
const ITERATIONS: usize = 20;

const ADVICE: [&str; 2] = [
    "hold the instrument after a stroke and turn it by 90 degrees, to and fro",
    "record strokes while turning, at three or more ratios of the speeds, 20 mm/s at 0.2, 1 and 3 turns a second",
];

/// Identifies along the axis from the recordings that do not turn, and around it from those that do.
///
/// The axial model is that of its own recordings: rotation neither biases it nor narrows its
/// intervals.
pub(super) fn identified(
    recordings: &[Recording],
    options: &IdentifyOptions,
    axial: impl Fn(&[Recording]) -> Result<Identification, IdentifyError>,
) -> Result<Identification, IdentifyError> {
    let Some(radius) = options.shaft_radius else { return axial(recordings) };
    let (turned, still): (Vec<_>, Vec<_>) =
        recordings.iter().cloned().partition(|recording| turns(recording, radius));
    if turned.is_empty() || still.is_empty() {
        let mut found = axial(recordings)?;
        let message = if turned.is_empty() {
            format!("no recording turns, nothing is known of rotation: {}", ADVICE[0])
        } else {
            "all recordings turn, rotation is not identified: add strokes without turning"
                .to_owned()
        };
        found.warnings.push(Warning::doubt("rotation", message));
        return Ok(found);
    }
    let mut found = axial(&still)?;
    let fit = Fit::new(&found, &turned, radius)?;
    let [stiffness, ratio] = fit.estimates();
    found.rotation = Some(fit.rotation(fit.best));
    for (quantity, estimate) in
        [(Quantity::CircumferentialStiffness, stiffness), (Quantity::CircumferentialRatio, ratio)]
    {
        let parameter = Parameter { id: quantity.id(), estimate };
        if !parameter.estimate.determined {
            found.warnings.push(Warning::undetermined(&parameter));
        }
        found.parameters.push(parameter);
    }
    found.parameters.sort_by_key(|parameter| numbers::rank(parameter.id));
    found.free_parameters += 2;
    Ok(found)
}

fn turns(recording: &Recording, radius: f64) -> bool {
    let (low, high) = recording.angle.as_deref().map_or((0.0, 0.0), range);
    radius * (high - low) > TURNING
}

/// Least squares of k_t and F_t/F_c by simulation. Each recording has a friction scale and an offset
/// of its own, eliminated in closed form.
struct Fit<'a> {
    found: &'a Identification,
    turned: &'a [Recording],
    radius: f64,
    /// ln k_t and ln F_t/F_c.
    best: [f64; 2],
    /// Errors (N), their derivatives by `best`, and the block of each sample.
    errors: Vec<f64>,
    slopes: [Vec<f64>; 2],
    blocks: Vec<usize>,
}

impl<'a> Fit<'a> {
    fn new(
        found: &'a Identification,
        turned: &'a [Recording],
        radius: f64,
    ) -> Result<Self, IdentifyError> {
        let element = found.element().params();
        let c = element.deformation.half_width();
        let slope = 0.5 * (element.insertion.static_force + element.withdrawal.static_force) / c;
        let own = Self {
            found,
            turned,
            radius,
            best: [slope.ln(), 0.0],
            errors: Vec::new(),
            slopes: [Vec::new(), Vec::new()],
            blocks: blocks(turned),
        };
        found.trocar().with_rotation(Some(own.rotation(own.best)))?;
        let start = |factor: f64| own.descend([(factor * slope).ln(), 0.0]);
        let all = [start(1.0), start(0.2), start(5.0)];
        let best =
            all.into_iter().min_by(|a, b| a.1.total_cmp(&b.1)).map_or(own.best, |best| best.0);
        let errors = own.errors(best);
        let slopes = own.slopes(best, &errors);
        Ok(Self { best, errors, slopes, ..own })
    }

    fn rotation(&self, [stiffness, ratio]: [f64; 2]) -> Rotation {
        Rotation {
            shaft_radius: self.radius,
            circumferential_stiffness: stiffness.exp(),
            circumferential_ratio: ratio.exp(),
        }
    }

    /// Readings less the simulation at all samples; 0 where the initial state matters.
    fn errors(&self, at: [f64; 2]) -> Vec<f64> {
        self.errors_of(self.found.trocar(), at)
    }

    fn errors_of(&self, trocar: Trocar<&[f64]>, at: [f64; 2]) -> Vec<f64> {
        let trocar = trocar.with_rotation(Some(self.rotation(at))).unwrap_or(trocar);
        let offset = self.found.model.offset;
        let noise = self.found.residual_rms.max(f64::MIN_POSITIVE);
        let of = |recording: &Recording| {
            let model = replay(&trocar, recording, offset);
            let known: Vec<usize> = model.known.into_iter().flatten().collect();
            let mut errors = vec![0.0; recording.len()];
            let pairs = || known.iter().map(|k| (model.force[*k], recording.force[*k]));
            let [scale, own] = level(pairs(), offset, noise);
            known.iter().zip(pairs()).for_each(|(k, (m, y))| errors[*k] = y - own - scale * m);
            errors
        };
        self.turned.par_iter().flat_map_iter(of).collect()
    }

    fn slopes(&self, at: [f64; 2], errors: &[f64]) -> [Vec<f64>; 2] {
        [0, 1].map(|i| {
            let mut moved = at;
            moved[i] += STEP;
            self.errors(moved).iter().zip(errors).map(|(a, b)| (a - b) / STEP).collect()
        })
    }

    /// Levenberg's method from `at`; where it ends, and the sum of squares there.
    fn descend(&self, mut at: [f64; 2]) -> ([f64; 2], f64) {
        let mut errors = self.errors(at);
        let mut least = squares(&errors);
        let mut damping = 1e-3;
        for _ in 0..ITERATIONS {
            let slopes = self.slopes(at, &errors);
            let (h, g) = normal(&slopes, &errors);
            let damped = h + Matrix2::from_diagonal(&(h.diagonal() * damping));
            let Some(step) = damped.try_inverse().map(|inverse| -(inverse * g)) else { break };
            let next = [0, 1].map(|i| at[i] + step[i].clamp(-1.0, 1.0));
            let tried = self.errors(next);
            let sum = squares(&tried);
            if sum < least {
                let change = least - sum;
                (at, errors, least) = (next, tried, sum);
                damping *= 0.1;
                if change < 1e-6 * least {
                    break;
                }
            } else {
                damping *= 10.0;
                if damping > 1e6 {
                    break;
                }
            }
        }
        (at, least)
    }

    /// Intervals from the scatter of the blocks, whose errors are independent of each other.
    fn estimates(&self) -> [Estimate; 2] {
        let (h, _) = normal(&self.slopes, &self.errors);
        let count = self.blocks.last().map_or(0, |last| last + 1);
        let mut scores = vec![Vector2::zeros(); count];
        for ((k, block), error) in self.blocks.iter().enumerate().zip(&self.errors) {
            scores[*block] += Vector2::new(self.slopes[0][k], self.slopes[1][k]) * *error;
        }
        let meat: Matrix2<f64> = scores.iter().map(|score| score * score.transpose()).sum();
        // What no number of the model explains is not independent from block to block.
        let samples = self.errors.iter().filter(|error| **error != 0.0).count().max(1) as f64;
        let misfit = squares(&self.errors) / samples / self.found.residual_rms.powi(2);
        let covariance = h.try_inverse().map(|inverse| {
            let axial: Matrix2<f64> = self
                .axial_errors()
                .map(|errors| inverse * normal(&self.slopes, &errors).1)
                .map(|shift| shift * shift.transpose())
                .sum();
            inverse * meat * inverse * misfit.max(1.0) + axial
        });
        let quantities = [Quantity::CircumferentialStiffness, Quantity::CircumferentialRatio];
        [0, 1].map(|i| {
            let unit = quantities[i].declaration().unit.si;
            let value = self.best[i].exp();
            let blocks = self.informative(i, count);
            let error = covariance.map(|c| (c[(i, i)] * blocks / (blocks - 2.0)).sqrt());
            let half = error.map_or(f64::INFINITY, |error| t_quantile(blocks - 2.0) * error);
            // NaN where too few blocks tell of it.
            let is_determined = half < DETERMINED.ln();
            if !is_determined {
                return Estimate::undetermined(
                    value,
                    unit,
                    format!("to determine it, {}", ADVICE[i]),
                );
            }
            let bounds = [-half, half].map(|end| (self.best[i] + end).exp());
            Estimate::from_bounds(value, bounds[0], bounds[1], unit)
        })
    }

    /// Change of the errors, N, with each number of the axial model by its standard error.
    fn axial_errors(&self) -> impl Iterator<Item = Vec<f64>> {
        let trocar = self.found.trocar();
        let numbers: Vec<Tunable> = trocar.seal().tunables().collect();
        [Quantity::HalfWidth, Quantity::CoulombForce, Quantity::ViscousDamping]
            .into_iter()
            .filter_map(move |quantity| {
                let error = self.found.estimate(quantity)?.half_width() / t_quantile(MANY_DEGREES);
                let more = |own: &Tunable| {
                    own.value + if own.id.quantity == quantity { error } else { 0.0 }
                };
                let values: Vec<f64> = numbers.iter().map(more).collect();
                let seal = trocar.seal().tuned(&values).ok()?;
                let moved = self.errors_of(trocar.with_seal(seal), self.best);
                Some(moved.iter().zip(&self.errors).map(|(a, b)| a - b).collect())
            })
    }

    /// How many blocks tell of number `i`.
    fn informative(&self, i: usize, count: usize) -> f64 {
        let mut weights = vec![0.0; count];
        for (k, block) in self.blocks.iter().enumerate() {
            weights[*block] += self.slopes[i][k] * self.slopes[i][k];
        }
        let (sum, sum_of_squares) = weights.iter().fold((0.0, 0.0), |(a, b), w| (a + w, b + w * w));
        if sum_of_squares > 0.0 { sum * sum / sum_of_squares } else { 0.0 }
    }
}

/// The block of every sample, counted through all recordings.
fn blocks(recordings: &[Recording]) -> Vec<usize> {
    let mut all = Vec::new();
    for recording in recordings {
        let first = all.last().map_or(0, |last| last + 1);
        let start = recording.time[0];
        all.extend(recording.time.iter().map(|t| first + ((t - start) / BLOCK) as usize));
    }
    all
}

/// Friction scale and offset (N) of readings y = offset + scale·m, with their priors.
fn level(pairs: impl Iterator<Item = (f64, f64)>, offset: f64, noise: f64) -> [f64; 2] {
    let weights = [SCALE_DEVIATION, OFFSET_DEVIATION].map(|sd| (noise / sd).powi(2));
    let mut h = Matrix2::from_diagonal(&Vector2::from(weights));
    let mut g = Vector2::new(weights[0], weights[1] * offset);
    for (m, y) in pairs {
        let row = Vector2::new(m, 1.0);
        h += row * row.transpose();
        g += row * y;
    }
    h.try_inverse().map_or([1.0, offset], |inverse| (inverse * g).into())
}

fn squares(errors: &[f64]) -> f64 {
    errors.iter().map(|error| error * error).sum()
}

/// JᵀJ and Jᵀe.
fn normal(slopes: &[Vec<f64>; 2], errors: &[f64]) -> (Matrix2<f64>, Vector2<f64>) {
    let (mut h, mut g) = (Matrix2::zeros(), Vector2::zeros());
    for ((a, b), error) in slopes[0].iter().zip(&slopes[1]).zip(errors) {
        let row = Vector2::new(*a, *b);
        h += row * row.transpose();
        g += row * *error;
    }
    (h, g)
}
