//! Recordings in which the instrument turns: what that takes from an axial model, and how the seal
//! resists it ([`trocar_model::rotation`]).

use std::f64::consts::PI;

use nalgebra::{DMatrix, DVector, Matrix2, Vector2};
use rayon::prelude::*;
use trocar_model::{Quantity, Rotation, Stages, Trocar};

use super::estimate::{Estimate, t_quantile};
use super::findings::{IdentifyError, Parameter, Warning};
use super::information::{Expected, Noise, Reversals, Rows};
use super::numbers;
use super::options::IdentifyOptions;
use super::result::Identification;
use trocar_recording::Recording;
use trocar_simulate::replay::replay;
use trocar_simulate::segment::{reversal_threshold, strokes};

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

/// Passes of the fit: the first finds the sizes of the errors, by which the next weights.
const PASSES: usize = 2;
/// Most samples that count as one for their correlation.
const MOST_ALIKE: f64 = 1e3;
/// Widest interval of a number that counts as determined, as a factor to either side.
const DETERMINED: f64 = 1.5;
/// Least arc around the shaft that is turning, m: an angle sensor at rest shows none.
const TURNING: f64 = 5e-4;
/// Step of the derivatives, in logarithms of the numbers, and most iterations.
const STEP: f64 = 1e-3;
const ITERATIONS: usize = 20;
/// Where the fit may start: k_t over the mean slope along the axis.
const STARTS: [f64; 5] = [0.1, 0.3, 1.0, 3.0, 10.0];

const QUANTITIES: [Quantity; 2] =
    [Quantity::CircumferentialStiffness, Quantity::CircumferentialRatio];

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
    let parted = recordings.iter().map(|recording| parts(recording, radius));
    let (still, turned): (Vec<_>, Vec<_>) = parted.unzip();
    let [still, mut turned] =
        [still, turned].map(|all| all.into_iter().flatten().collect::<Vec<Recording>>());
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
    let delay = found.position_delay.as_ref().map_or(0.0, |delay| delay.delay_s);
    for recording in &mut turned {
        // One that is too short for the delay tells nothing of rotation.
        if let Ok(in_time) = recording.with_position_delay(delay) {
            *recording = in_time;
        }
        recording.force = recording.force_without(&found.model.loads, found.model.offset);
    }
    let fit = Fit::new(&found, &turned, radius)?;
    let (rotation, estimates) = (fit.rotation(fit.best), fit.estimates());
    found.rotation = Some(rotation);
    for (quantity, estimate) in QUANTITIES.into_iter().zip(estimates) {
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

/// Fewest strokes before or after turning that are a recording of their own: four cycles.
const STILL: usize = 8;

/// The parts of a recording along which the instrument does not turn, and that along which it does.
fn parts(recording: &Recording, radius: f64) -> (Vec<Recording>, Vec<Recording>) {
    let whole = || vec![recording.clone()];
    let angle = recording.angle.as_deref().unwrap_or_default();
    let is_off = |from: f64| move |own: &f64| radius * (own - from).abs() > TURNING;
    let (Some(first), Some(last)) = (angle.first(), angle.last()) else {
        return (whole(), Vec::new());
    };
    let Some(begin) = angle.iter().position(is_off(*first)) else { return (whole(), Vec::new()) };
    let end = angle.iter().rposition(is_off(*last)).map_or(angle.len(), |at| at + 1);
    // An angle that creeps may be off both its first and its last value nowhere.
    let end = end.max(begin);
    let reversal = reversal_threshold(recording);
    let part = |from, to, what| recording.part(from..to, what).ok();
    let still = |own: &Recording| strokes(own, reversal).len() >= STILL;
    let before = part(0, begin, "before it turns").filter(still);
    let after = part(end, angle.len(), "after it has turned").filter(still);
    let from = before.as_ref().map_or(0, |_| begin);
    let to = after.as_ref().map_or(angle.len(), |_| end);
    let still: Vec<Recording> = before.into_iter().chain(after).collect();
    let turned = match part(from, to, "while it turns") {
        None if still.is_empty() => whole(),
        turned => turned.into_iter().collect(),
    };
    (still, turned)
}

/// Least squares of k_t and F_t/F_c by simulation, of the forces and of the torques where they are
/// recorded.
struct Fit<'a> {
    axial: Axial<'a>,
    turned: Vec<Turned<'a>>,
    radius: f64,
    /// Standard deviations of independent errors, N and N·m.
    noise: [f64; 2],
    /// ln k_t and ln F_t/F_c.
    best: [f64; 2],
    /// Errors and their derivatives by `best`.
    errors: Vec<Error>,
    slopes: [Vec<f64>; 2],
}

/// What is known of the seal along the axis.
struct Axial<'a> {
    trocar: Trocar<&'a [f64]>,
    /// Sensor offset, N.
    offset: f64,
    /// Scatter of the friction between strokes, relative, as far as it changes without turning.
    scatter: f64,
    /// [`Identification::deviations`].
    deviations: &'a [(Stages, f64)],
}

impl<'a> Axial<'a> {
    fn of(found: &'a Identification) -> Self {
        let scale = &found.friction_scale;
        let scatter = scatter(scale.scatter, scale.drift);
        let (trocar, offset) = (found.trocar(), found.model.offset);
        Self { trocar, offset, scatter, deviations: &found.deviations }
    }
}

fn scatter(of_strokes: f64, drift: f64) -> f64 {
    of_strokes.hypot(0.5 * drift).max(1e-3)
}

/// Information and score.
type Movement = (Matrix2<f64>, Vector2<f64>);

/// An error in units of its standard deviation.
#[derive(Clone, Copy)]
struct Error {
    value: f64,
    /// 0 of the force, 1 of the torque, `None` of a prior.
    channel: Option<usize>,
    /// The movement, from reversal to reversal, in which it arose.
    movement: usize,
}

/// A recording that turns.
struct Turned<'a> {
    recording: &'a Recording,
    /// The stroke and the movement, along the axis or around it, of every sample.
    strokes: Vec<usize>,
    movements: Vec<usize>,
    /// Samples whose force does not depend on the unknown start. What the errors of two models are
    /// compared over must not depend on them.
    known: Vec<usize>,
}

impl<'a> Turned<'a> {
    fn new(recording: &'a Recording, radius: f64, first_movement: usize) -> Self {
        let reversals = |own: &Recording, threshold| {
            let mut is_first = vec![0; own.len()];
            strokes(own, threshold).iter().skip(1).for_each(|stroke| is_first[stroke.start] = 1);
            is_first
        };
        let arc = recording.angle.iter().flatten().map(|angle| radius * angle).collect();
        let around = Recording { position: arc, expected_acceleration: None, ..recording.clone() };
        let along = reversals(recording, reversal_threshold(recording));
        let both = along.iter().zip(reversals(&around, TURNING)).map(|(a, b)| a | b);
        let sum = |sum: &mut usize, is_first: usize| {
            *sum += is_first;
            Some(*sum)
        };
        let movements = both.scan(first_movement, sum).collect();
        let strokes = along.iter().copied().scan(0, sum).collect();
        Self { recording, strokes, movements, known: Vec::new() }
    }

    /// Errors of a model that gives these forces and torques. Each stroke has a friction scale of its
    /// own, the recording has one and offsets; all are the likeliest by their priors, in closed form.
    fn errors(&self, model: [&[f64]; 2], how: &Level) -> Vec<Error> {
        let count = self.strokes.last().map_or(0, |last| last + 1);
        let (of_recording, offsets) = (count, [count + 1, count + 2]);
        let (mut h, mut g) =
            (DMatrix::<f64>::zeros(count + 3, count + 3), DVector::zeros(count + 3));
        let mut priors: Vec<_> = (0..count).map(|stroke| (stroke, 0.0, how.scatter)).collect();
        priors.push((of_recording, 1.0, SCALE_DEVIATION));
        priors.push((offsets[0], how.offset, OFFSET_DEVIATION));
        // A torque sensor may be tared in any way.
        priors.push((offsets[1], 0.0, 1e3 * how.noise[1]));
        for (j, mean, deviation) in &priors {
            h[(*j, *j)] += deviation.powi(-2);
            g[*j] += mean * deviation.powi(-2);
        }
        let readings = [Some(&self.recording.force), self.recording.torque.as_ref()];
        let channels = || readings.iter().enumerate().filter_map(|(i, own)| Some((i, (*own)?)));
        let row = |channel: usize, k: usize| {
            let weight = 1.0 / how.noise[channel];
            let m = weight * model[channel][k];
            [(self.strokes[k], m), (of_recording, m), (offsets[channel], weight)]
        };
        for (channel, readings) in channels() {
            for k in &self.known {
                let row = row(channel, *k);
                for (i, a) in row {
                    g[i] += a * readings[*k] / how.noise[channel];
                    row.into_iter().for_each(|(j, b)| h[(i, j)] += a * b);
                }
            }
        }
        let own = h.cholesky().map_or(g.clone(), |factor| factor.solve(&g));
        let mut errors = Vec::with_capacity(2 * self.known.len() + priors.len());
        for (channel, readings) in channels() {
            errors.extend(self.known.iter().map(|k| {
                let fitted: f64 = row(channel, *k).iter().map(|(j, a)| a * own[*j]).sum();
                let value = readings[*k] / how.noise[channel] - fitted;
                Error { value, channel: Some(channel), movement: self.movements[*k] }
            }));
        }
        errors.extend(priors.into_iter().map(|(j, mean, deviation)| {
            let first = self.strokes.iter().position(|stroke| *stroke == j).unwrap_or(0);
            let value = (mean - own[j]) / deviation;
            Error { value, channel: None, movement: self.movements[first] }
        }));
        errors
    }
}

/// What is known of friction scales and offsets.
struct Level {
    noise: [f64; 2],
    /// Standard deviation of the friction scale of a stroke.
    scatter: f64,
    /// Sensor offset, N.
    offset: f64,
}

impl<'a> Fit<'a> {
    fn new(
        found: &'a Identification,
        recordings: &'a [Recording],
        radius: f64,
    ) -> Result<Self, IdentifyError> {
        let slope = found.element().params().mean_stiffness();
        let force = found.residual_rms.max(f64::MIN_POSITIVE);
        let mut own = Self::at(Axial::of(found), recordings, [slope.ln(), 0.0], radius, force);
        own.axial.trocar.with_rotation(Some(own.rotation(own.best)))?;
        let sum = |factor: &f64| squares(&own.errors([(factor * slope).ln(), 0.0]));
        let starts = STARTS.iter().map(|factor| (factor, sum(factor)));
        let (start, _) = starts.min_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((&1.0, 0.0));
        own.best = [(start * slope).ln(), 0.0];
        for pass in 0..PASSES {
            own.know();
            if pass > 0 {
                own.noise = own.noise_found(&own.errors(own.best));
            }
            own.best = own.descend(own.best);
        }
        Ok(own.linearised())
    }

    /// At `best`, with independent errors of `force`, N, and not linearised.
    fn at(
        axial: Axial<'a>,
        recordings: &'a [Recording],
        best: [f64; 2],
        radius: f64,
        force: f64,
    ) -> Self {
        let mut turned: Vec<Turned> = Vec::new();
        for recording in recordings {
            let first =
                turned.last().map_or(0, |last| last.movements[last.movements.len() - 1] + 1);
            turned.push(Turned::new(recording, radius, first));
        }
        let (noise, errors, slopes) = ([force, radius * force], Vec::new(), Default::default());
        let mut own = Self { axial, turned, radius, noise, best, errors, slopes };
        own.know();
        own
    }

    /// Finds the samples that are known with the seal at `best`.
    fn know(&mut self) {
        let (trocar, offset) = (self.turning(self.axial.trocar, self.best), self.axial.offset);
        self.turned.par_iter_mut().for_each(|own| {
            own.known =
                replay(&trocar, own.recording, offset).known.into_iter().flatten().collect();
        });
    }

    fn turning<'k>(&self, trocar: Trocar<&'k [f64]>, at: [f64; 2]) -> Trocar<&'k [f64]> {
        trocar.with_rotation(Some(self.rotation(at))).unwrap_or(trocar)
    }

    fn linearised(mut self) -> Self {
        self.errors = self.errors(self.best);
        self.slopes = self.slopes(self.best, &self.errors);
        self
    }

    fn rotation(&self, [stiffness, ratio]: [f64; 2]) -> Rotation {
        Rotation {
            shaft_radius: self.radius,
            circumferential_stiffness: stiffness.exp(),
            circumferential_ratio: ratio.exp(),
        }
    }

    /// Standard deviations of independent errors that would be as uncertain as those found, which
    /// are alike from sample to sample.
    fn noise_found(&self, errors: &[Error]) -> [f64; 2] {
        [0, 1].map(|channel| {
            let own: Vec<f64> =
                errors.iter().filter(|e| e.channel == Some(channel)).map(|e| e.value).collect();
            let sum = |lag: usize| own.iter().zip(&own[lag..]).map(|(a, b)| a * b).sum::<f64>();
            let squares = if own.is_empty() { 0.0 } else { sum(0) };
            if squares <= 0.0 {
                return self.noise[channel];
            }
            let most = (own.len() / 10).min(MOST_ALIKE as usize);
            let lags = (1..most).map(|lag| sum(lag) / squares).take_while(|own| *own > 0.05);
            let alike = 1.0 + 2.0 * lags.sum::<f64>();
            self.noise[channel] * (squares / own.len() as f64 * alike).sqrt()
        })
    }

    fn errors(&self, at: [f64; 2]) -> Vec<Error> {
        self.errors_of(self.axial.trocar, at)
    }

    fn errors_of(&self, trocar: Trocar<&[f64]>, at: [f64; 2]) -> Vec<Error> {
        let trocar = self.turning(trocar, at);
        let Axial { offset, scatter, .. } = self.axial;
        let how = Level { noise: self.noise, scatter, offset };
        let of = |own: &Turned| {
            let model = replay(&trocar, own.recording, offset);
            own.errors([&model.force, &model.torque], &how)
        };
        self.turned.par_iter().flat_map_iter(of).collect()
    }

    fn slopes(&self, at: [f64; 2], errors: &[Error]) -> [Vec<f64>; 2] {
        [0, 1].map(|i| {
            let mut moved = at;
            moved[i] += STEP;
            self.errors(moved).iter().zip(errors).map(|(a, b)| (a.value - b.value) / STEP).collect()
        })
    }

    /// Where Levenberg's method from `at` ends.
    fn descend(&self, mut at: [f64; 2]) -> [f64; 2] {
        let mut errors = self.errors(at);
        let mut least = squares(&errors);
        let mut damping = 1e-3;
        for _ in 0..ITERATIONS {
            let slopes = self.slopes(at, &errors);
            let (h, g) = normal(&slopes, errors.iter().map(|error| error.value));
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
        at
    }

    /// Information and score of each movement.
    fn movements(&self) -> Vec<Movement> {
        let count = self.errors.iter().map(|error| error.movement + 1).max().unwrap_or(0);
        let mut all = vec![(Matrix2::zeros(), Vector2::zeros()); count];
        for ((a, b), error) in self.slopes[0].iter().zip(&self.slopes[1]).zip(&self.errors) {
            let (h, g) = &mut all[error.movement];
            let row = Vector2::new(*a, *b);
            *h += row * row.transpose();
            *g += row * error.value;
        }
        all
    }

    /// Variances of `best` by the jackknife over movements; `inverse` is that of their information `h`.
    fn jackknifed(
        movements: &[Movement],
        [h, inverse]: [Matrix2<f64>; 2],
    ) -> Option<[Vector2<f64>; 1]> {
        let left_out: Option<Vec<Vector2<f64>>> = movements
            .iter()
            .map(|(own, score)| (h - own).try_inverse().map(|inverse| inverse * score))
            .collect();
        let left_out = left_out?;
        let count = left_out.len() as f64;
        let mean = left_out.iter().sum::<Vector2<f64>>() / count;
        let own: Matrix2<f64> = left_out.iter().map(|own| square(own - mean)).sum();
        let scatter = own * ((count - 1.0) / count);
        // Errors that recur in every movement show no scatter; by their size they are seen.
        Some([scatter.diagonal().sup(&inverse.diagonal())])
    }

    /// Variances of `best` with what the sensor, the ripple and the friction of strokes along the axis do to
    /// the forces of a motion without gaps; `inverse` is that of the information.
    fn disturbed(&self, noise: &Noise, inverse: Matrix2<f64>) -> Vector2<f64> {
        let recording = self.turned[0].recording;
        let (x, force) = (&recording.position, &recording.force);
        let half_width = self.axial.trocar.seal().half_width();
        let mut friction = Reversals::new(half_width, noise.scatter_travel_m, 2);
        let (mut sum, mut ripple) = (DMatrix::zeros(2, 2), DVector::zeros(2));
        let rows = self.slopes[0].iter().zip(&self.slopes[1]).zip(&self.errors);
        let readings = rows.filter(|(_, error)| error.channel.is_some());
        let first = x.len() - readings.clone().count();
        for (at, ((a, b), _)) in (first..).zip(readings) {
            let moved = DVector::from_vec(vec![*a, *b]) / self.noise[0];
            let travel = x[at] - x[at.max(first + 1) - 1];
            ripple *= (-travel.abs() / noise.ripple_length_m).exp();
            let own = &moved * (noise.ripple * force[at]);
            // Σ_ik b_i·b_k·exp(−|s_i − s_k|/ℓ) by a sum that fades along the path.
            sum += (&own + &ripple) * own.transpose() + &own * ripple.transpose();
            sum.ger(noise.force_n.powi(2), &moved, &moved, 1.0);
            ripple += own;
            let step = (travel, force[at]);
            friction.step(step, &moved.column(0), &mut sum, noise.scatter.powi(2));
        }
        friction.end(&mut sum, noise.scatter.powi(2));
        let sum = Matrix2::from_fn(|i, j| sum[(i, j)]);
        (inverse * sum * inverse).diagonal()
    }

    /// Standard errors of `best`, N times, with variances of its own, from the movements and their
    /// information and its inverse, and by the errors of the axial model; and their degrees of freedom.
    fn standard_errors<const N: usize>(
        &self,
        variances: impl Fn(&[Movement], [Matrix2<f64>; 2]) -> Option<[Vector2<f64>; N]>,
    ) -> [([f64; N], f64); 2] {
        let movements = self.movements();
        let h: Matrix2<f64> = movements.iter().map(|(own, _)| own).sum();
        let inverse = h.try_inverse();
        let variances = inverse.and_then(|inverse| {
            let own = variances(&movements, [h, inverse])?;
            let shift = |slope: Vec<f64>| square(inverse * normal(&self.slopes, slope).1);
            let axial: Matrix2<f64> = self.axial_errors().map(shift).sum();
            Some(own.map(|own| own + axial.diagonal()))
        });
        [0, 1].map(|i| {
            // Student's t of the movements that tell of it, as if they told alike (CARTER).
            let shares = movements.iter().map(|(own, _)| {
                inverse.map_or(0.0, |inverse| (inverse.row(i) * own * inverse.column(i))[0])
            });
            let (sum, squares) = shares.fold((0.0, 0.0), |(a, b), w| (a + w, b + w * w));
            let errors = variances.map_or([f64::INFINITY; N], |all| all.map(|own| own[i].sqrt()));
            (errors, sum * sum / squares - 1.0)
        })
    }

    /// The intervals.
    fn estimates(&self) -> [Estimate; 2] {
        let errors = self.standard_errors(Self::jackknifed);
        [0, 1].map(|i| {
            let (unit, value) = (QUANTITIES[i].declaration().unit.si, self.best[i].exp());
            let ([error], degrees) = errors[i];
            let half = t_quantile(degrees) * error;
            // NaN where no movement tells of it.
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

    /// Changes of the errors with the axial model, by the deviations whose squares add up to its
    /// covariance.
    fn axial_errors(&self) -> impl Iterator<Item = Vec<f64>> {
        self.axial.deviations.iter().map(|(stages, part)| {
            let profile = self.axial.trocar.profile().copied();
            let moved = self.errors_of(Trocar::new(*stages, profile), self.best);
            moved.iter().zip(&self.errors).map(|(a, b)| (a.value - b.value) / part).collect()
        })
    }
}

impl Rows {
    /// The errors to expect of k_t and F_t/F_c of a seal with `rotation`, from the forces of a motion in
    /// which the instrument turns, after the motion of these rows with their `covariance`. None of its
    /// readings matters.
    ///
    /// Returns `None` where the motion does not turn or has gaps, or the seal is no model.
    pub fn expected_around(
        &self,
        noise: &Noise,
        covariance: &DMatrix<f64>,
        rotation: Rotation,
        mut turning: Recording,
    ) -> Option<[Expected; 2]> {
        if turning.angle.is_none() || turning.unbroken().count() != 1 {
            return None;
        }
        let trocar = Trocar::new(self.stages()?, None);
        let truth = trocar.with_rotation(Some(rotation)).ok()?;
        turning.force = replay(&truth, &turning, 0.0).force;
        turning.torque = None;
        let deviations = self.deviations(covariance);
        let scatter = scatter(noise.scatter, noise.drift);
        let axial = Axial { trocar, offset: 0.0, scatter, deviations: &deviations };
        let Rotation { shaft_radius, circumferential_stiffness, circumferential_ratio } = rotation;
        let best = [circumferential_stiffness.ln(), circumferential_ratio.ln()];
        let force = noise.independent(&turning);
        let recordings = [turning];
        let fit = Fit::at(axial, &recordings, best, shaft_radius, force).linearised();
        let errors = fit.standard_errors(|_, [_, inverse]| {
            let disturbed = fit.disturbed(noise, inverse);
            // identify takes the larger of the scatter and of the size of the errors.
            Some([disturbed, disturbed.sup(&inverse.diagonal())])
        });
        Some([0, 1].map(|i| {
            let (value, ([error, of_interval], degrees)) = (best[i].exp(), errors[i]);
            Expected {
                id: QUANTITIES[i].id(),
                value,
                deviation: value * error,
                half_width: value * t_quantile(degrees) * of_interval,
                on_log: true,
                widest: DETERMINED.ln(),
            }
        }))
    }
}

fn square(off: Vector2<f64>) -> Matrix2<f64> {
    off * off.transpose()
}

fn squares(errors: &[Error]) -> f64 {
    errors.iter().map(|error| error.value * error.value).sum()
}

/// JᵀJ and Jᵀe.
fn normal(
    slopes: &[Vec<f64>; 2],
    errors: impl IntoIterator<Item = f64>,
) -> (Matrix2<f64>, Vector2<f64>) {
    let (mut h, mut g) = (Matrix2::zeros(), Vector2::zeros());
    for ((a, b), error) in slopes[0].iter().zip(&slopes[1]).zip(errors) {
        let row = Vector2::new(*a, *b);
        h += row * row.transpose();
        g += row * error;
    }
    (h, g)
}
