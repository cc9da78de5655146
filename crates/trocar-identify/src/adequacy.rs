//! Which parameters the data determine, and whether the model is adequate. Both are judged from the
//! simulated motion of the model over the recordings.
//!
//! - F_c, c and the branches need reversals with sliding before and after: the model slides in one direction
//!   and, after the reversal, in the other. Each slide covers a stated travel, and the measured force is constant
//!   while the model slides.
//! - Separating F_c from β needs sliding at two speeds; otherwise the sliding force at rest is an
//!   extrapolation.
//! - The residual of each phase is compared with the sensor noise and the scatter between strokes.

use rayon::prelude::*;
use serde::Serialize;
use trocar_model::{ParameterId, Quantity, Trocar};

use super::candidate::Candidate;
use super::element::Input;
use super::estimate::t_p_value;
use super::findings::Warning;
use super::scale::FrictionScale;
use trocar_recording::{Recording, local_velocity, velocity_window};
use trocar_simulate::replay::replay_rest;
use trocar_simulate::stick_slip::{StickSlip, Swings};

/// Sliding travel, in half widths, needed to show that the force stays constant.
const SHOWS_SLIDING: f64 = 0.5;
/// Fewest reversals with sliding before and after.
const FEWEST_REVERSALS: usize = 2;
/// Least ratio of fast to slow sliding speed that separates F_c from β (a tenth of the travel is
/// faster or slower, respectively).
const SPEED_RATIO: f64 = 1.5;
/// Largest relative change of the force over the travel in which the model slides.
const FLAT: f64 = 0.1;
/// Ratio of the residual to sensor noise and scatter between strokes above which the result is
/// doubtful.
const EXCESS: f64 = 4.0;
/// Model error that is always tolerated, as a fraction of the sliding force.
const TOLERATED: f64 = 0.03;

/// Error of the model in one phase of the motion, with the friction scale of each stroke removed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Phase {
    /// `deforming` or `sliding`.
    pub phase: &'static str,
    /// Samples.
    pub samples: usize,
    /// Root mean square error, N.
    pub rms_n: f64,
    /// Error that sensor noise and the scatter between strokes explain, N.
    pub expected_n: f64,
}

/// Parameters that are undetermined for the same reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Group {
    /// Sliding forces of both directions.
    Sliding,
    /// Viscous coefficient, and F_c with it.
    Speed,
    /// Stribeck velocity and exponent.
    Stribeck,
    /// c, joins, branches.
    Shape,
}

impl Group {
    /// Whether a parameter belongs to the group.
    pub(super) fn holds(self, id: ParameterId) -> bool {
        use Quantity as Q;
        let stribeck = matches!(id.quantity, Q::StribeckVelocity | Q::StribeckExponent);
        let sliding = stribeck
            || matches!(
                id.quantity,
                Q::CoulombForce | Q::CoulombForceWithOffset | Q::StaticForce | Q::ViscousDamping
            );
        match self {
            Self::Sliding => sliding,
            Self::Speed => sliding && id.element.is_none(),
            Self::Stribeck => stribeck,
            Self::Shape => match id.quantity {
                Q::HalfWidth
                | Q::Join
                | Q::JoinForce
                | Q::Coefficient { .. }
                | Q::YieldStiffness => true,
                Q::SealDamping | Q::SecondRelaxationStiffness | Q::SecondRelaxationTime => true,
                Q::CoulombForce => id.element.is_some(),
                _ => false,
            },
        }
    }
}

/// Result of [`judge`].
pub(super) struct Adequacy {
    pub(super) phases: Vec<Phase>,
    /// Parameters that are not determined, and why.
    pub(super) undetermined: Vec<(Group, String)>,
    /// Why the result is doubtful.
    pub(super) doubts: Vec<Warning>,
    pub(super) stick_slip: Option<StickSlip>,
    /// Root mean square error, N, without the friction scale of strokes.
    pub(super) residual_rms: f64,
}

/// The model and its run over the recordings.
pub(super) struct Model<'a> {
    pub(super) candidate: &'a Candidate,
    pub(super) trocar: Trocar<&'a [f64]>,
    pub(super) scale: &'a FrictionScale,
    /// Whether c and the branches were fitted.
    pub(super) has_shape: bool,
}

/// Fraction of the travel that counts as slow sliding, and least fraction of F_s − F_c that must
/// remain there for the Stribeck curve to be visible.
const SLOW: f64 = 0.02;
const SEEN_RISE: f64 = 0.1;
/// Largest fraction of F_s − F_c that may remain at the fastest sliding.
const LEFT_RISE: f64 = 0.5;

/// Sums over one recording.
#[derive(Default)]
struct RecordingSums {
    /// Σ e² and samples: deforming, sliding; and Σ e² without the friction scale of strokes.
    squares: [f64; 2],
    samples: [usize; 2],
    plain_squares: f64,
    /// Σ F².
    power: f64,
    /// Reversals before and after which the model slides.
    sliding_reversals: usize,
    /// Speed, m/s, and travel, m, of sliding.
    speeds: Vec<(f64, f64)>,
    /// Ratio of measured to simulated force for each stroke, in the first and the second half of
    /// its sliding.
    halves: Vec<[f64; 2]>,
}

/// Judges the model.
pub(super) fn judge(input: &Input, model: &Model) -> Adequacy {
    let seen: Vec<RecordingSums> =
        (0..input.recordings.len()).into_par_iter().map(|k| look(input, model, k)).collect();
    let mut undetermined = Vec::new();
    if model.has_shape {
        let why = sliding_reversals(input, model, &seen);
        undetermined.extend(
            why.into_iter().flat_map(|why| [(Group::Sliding, why.clone()), (Group::Shape, why)]),
        );
    }
    let speeds = Speeds::new(&seen);
    undetermined.extend(speeds.separated());
    undetermined.extend(speeds.slow_enough(model.candidate));
    undetermined.extend(speeds.fast_enough(model.candidate));
    let phases = phases(input, model, &seen);
    let mut doubts: Vec<Warning> = phases.iter().filter_map(doubt).collect();
    let Candidate { insertion, offset, .. } = model.candidate;
    let falls = insertion.static_force > insertion.coulomb_force;
    let swings =
        Swings::of(input.recordings, input.segments, *offset, falls).filter(|_| model.has_shape);
    let are_left_out = input.stick_slip.is_some() && !input.options.paper;
    doubts.extend(swings.iter().map(|swings| swing_warning(swings, are_left_out)));
    doubts.extend(left_out(input));
    let stick_slip = swings.and_then(Swings::stick_slip);
    let samples: usize = seen.iter().flat_map(|s| s.samples).sum();
    let squares: f64 = seen.iter().map(|s| s.plain_squares).sum();
    Adequacy {
        phases,
        undetermined,
        doubts,
        stick_slip,
        residual_rms: (squares / samples.max(1) as f64).sqrt(),
    }
}

fn look(input: &Input, model: &Model, index: usize) -> RecordingSums {
    let (recording, segments) = (&input.recordings[index], &input.segments[index]);
    let candidate = model.candidate;
    let force = recording.force_without(&candidate.loads, candidate.offset);
    let reading = |i: usize| force[i] - candidate.offset;
    let run = replay_rest(&model.trocar, recording, reading, &input.left_out[index]);
    let velocity = local_velocity(recording, velocity_window(recording));
    let mut known = vec![false; recording.len()];
    run.known.iter().cloned().for_each(|range| known[range].fill(true));
    let mut seen = RecordingSums::default();
    let x = &recording.position;
    let mut slid_before: Option<f64> = None;
    for stroke in &segments.strokes {
        let scale = model.scale.at(index, recording.time[stroke.start] - recording.time[0]);
        let (mut slid, mut sums) = (0.0, Vec::new());
        for i in (stroke.start + 1..=stroke.end).filter(|i| known[*i] && !recording.is_clipped(*i))
        {
            let step = (x[i] - x[i - 1]).abs();
            let error = reading(i) - scale * run.force[i];
            let phase = usize::from(run.sliding[i]);
            seen.squares[phase] += error * error;
            seen.samples[phase] += 1;
            seen.plain_squares += (reading(i) - run.force[i]).powi(2);
            seen.power += run.force[i].powi(2);
            if run.sliding[i] && step > 0.0 {
                slid += step;
                seen.speeds.push((velocity[i].abs(), step));
                sums.push((slid, reading(i) / run.force[i]));
            }
        }
        let slides = slid >= SHOWS_SLIDING * candidate.half_width;
        let turned =
            slid_before.is_some_and(|d| d != stroke.direction.sign()) && stroke.starts_at_reversal;
        seen.sliding_reversals += usize::from(slides && turned);
        slid_before = slides.then_some(stroke.direction.sign());
        if slides {
            let mean = |first: bool| {
                let part = sums.iter().filter(|(at, _)| (*at < 0.5 * slid) == first).map(|s| s.1);
                part.clone().sum::<f64>() / part.count().max(1) as f64
            };
            seen.halves.push([mean(true), mean(false)]);
        }
    }
    seen
}

/// Checks that there are enough reversals with sliding before and after, and that the force is
/// constant where the model slides; else says why neither sliding nor shape is determined.
fn sliding_reversals(input: &Input, model: &Model, seen: &[RecordingSums]) -> Option<String> {
    let count: usize = seen.iter().map(|s| s.sliding_reversals).sum();
    let longest = input.recordings.iter().map(|r| r.quality.stroke).fold(0.0, f64::max);
    if count < FEWEST_REVERSALS {
        return Some(format!(
            "{count} reversals with sliding before and after, at least {FEWEST_REVERSALS} are needed: record strokes of several \
             centimetres in both directions (longest here: {:.1} mm)",
            1e3 * longest
        ));
    }
    let halves: Vec<f64> =
        seen.iter().flat_map(|s| &s.halves).map(|[a, b]| b - a).filter(|d| d.is_finite()).collect();
    let n = halves.len() as f64;
    let mean = halves.iter().sum::<f64>() / n.max(1.0);
    let error =
        (halves.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0) / n.max(1.0))
            .sqrt();
    let short = longest
        < 4.0 * SHOWS_SLIDING * model.candidate.half_width + 2.0 * model.candidate.half_width;
    let changes = mean.abs() > FLAT && t_p_value(mean / error, n - 1.0) < 0.01;
    (changes || (short && mean.abs() > 0.5 * FLAT)).then(|| {
        format!(
            "the force still changes by {:.0} % while the model slides, so nothing shows that the instrument slides at all: record \
             strokes that are longer than the deformation (longest here: {:.1} mm)",
            1e2 * mean,
            1e3 * longest
        )
    })
}

/// Fraction of the rise from F_c to F_s that remains at `speed`, m/s; `None` without a rise.
fn rise_left(candidate: &Candidate, speed: f64) -> Option<f64> {
    let friction = candidate.insertion;
    let rise = friction.static_force - friction.coulomb_force;
    (rise > 0.0).then(|| (friction.level(speed) - friction.coulomb_force) / rise)
}

/// Sliding speeds, m/s, with the travel at each, m, in ascending order.
struct Speeds(Vec<(f64, f64)>);

impl Speeds {
    fn new(seen: &[RecordingSums]) -> Self {
        let mut speeds: Vec<(f64, f64)> =
            seen.iter().flat_map(|s| s.speeds.iter().copied()).collect();
        speeds.sort_by(|a, b| a.0.total_cmp(&b.0));
        Self(speeds)
    }

    /// Speed below which this fraction of the travel lies.
    fn quantile(&self, part: f64) -> f64 {
        let total: f64 = self.0.iter().map(|s| s.1).sum();
        let mut travelled = 0.0;
        let beyond = |(_, step): &&(f64, f64)| {
            travelled += step;
            travelled >= part * total
        };
        self.0.iter().find(beyond).map_or(0.0, |s| s.0)
    }

    /// Checks that the sliding speeds separate F_c from β.
    fn separated(&self) -> Option<(Group, String)> {
        let [slow, fast] = [0.1, 0.9].map(|part| self.quantile(part));
        (fast < SPEED_RATIO * slow || self.0.is_empty()).then(|| {
            let why = format!(
                "sliding was seen at {:.0} to {:.0} mm/s only: F_c and β cannot be distinguished; record strokes at speeds that differ by a \
                 factor of 3 or more",
                1e3 * slow,
                1e3 * fast
            );
            (Group::Speed, why)
        })
    }

    /// Checks that there is sliding where the Stribeck curve falls. Breakaway alone does not
    /// determine the speed of the fall.
    fn slow_enough(&self, candidate: &Candidate) -> Option<(Group, String)> {
        let slow = self.quantile(SLOW);
        (rise_left(candidate, slow)? < SEEN_RISE).then(|| {
            let why = format!(
                "the sliding force falls below {:.1} mm/s, the slowest sliding that was seen, so only breakaway shows it: record strokes \
                 at {:.1} mm/s and slower, too",
                1e3 * slow,
                0.3 * 1e3 * slow
            );
            (Group::Stribeck, why)
        })
    }

    /// Checks that there is sliding where the Stribeck curve has decayed. Otherwise its remainder
    /// cannot be separated from F_c and β.
    fn fast_enough(&self, candidate: &Candidate) -> Option<(Group, String)> {
        let fast = self.0.last().map(|_| self.quantile(1.0 - SLOW))?;
        (rise_left(candidate, fast)? > LEFT_RISE).then(|| {
            let why = format!(
                "the sliding force still falls at {:.0} mm/s, the fastest sliding that was seen: F_c, β and the Stribeck curve cannot be \
                 distinguished; record faster strokes, too",
                1e3 * fast
            );
            (Group::Speed, why)
        })
    }
}

fn phases(input: &Input, model: &Model, seen: &[RecordingSums]) -> Vec<Phase> {
    let noise = input.noise();
    let samples: usize = seen.iter().flat_map(|s| s.samples).sum();
    let force = (seen.iter().map(|s| s.power).sum::<f64>() / samples.max(1) as f64).sqrt();
    let expected_n = noise.hypot(model.scale.scatter.max(TOLERATED) * force);
    let of = |(k, phase): (usize, &'static str)| {
        let samples: usize = seen.iter().map(|s| s.samples[k]).sum();
        let squares: f64 = seen.iter().map(|s| s.squares[k]).sum();
        (samples > 0).then(|| Phase {
            phase,
            samples,
            rms_n: (squares / samples as f64).sqrt(),
            expected_n,
        })
    };
    [(0, "deforming"), (1, "sliding")].into_iter().filter_map(of).collect()
}

fn doubt(phase: &Phase) -> Option<Warning> {
    (phase.rms_n > EXCESS * phase.expected_n).then(|| {
        let message = format!(
            "while {} the model's error is {:.3} N rms, of which sensor noise and the scatter between strokes explain {:.3} N: the seal is no \
             EMS element, or the recording contains something else (another load, a late signal); see the residuals in the report",
            phase.phase, phase.rms_n, phase.expected_n
        );
        Warning::doubt(phase.phase, message)
    })
}

/// The warning about a force that swings at constant velocity.
fn swing_warning(swings: &Swings, are_left_out: bool) -> Warning {
    let (subject, text) = match swings {
        Swings::StickSlip(found) => ("stick-slip", in_words(found, are_left_out)),
        Swings::Rig { speed_m_s, frequency_hz: [least, most] } => {
            let text = format!(
                "at {} mm/s the force swings, {least:.1} to {most:.1} times a second, at slower speeds it does not: no stick-slip, \
                     but a resonance of the rig",
                speeds_in_words(*speed_m_s)
            );
            return Warning::advice("vibration", text);
        }
        Swings::Position { period } => (
            "ripple",
            format!(
                "at constant velocity the force swings with a period of {:.1} mm in the position, at the same places whatever the \
                     speed: not stick-slip, but cogging of the drive, a screw or a rough shaft; c and the joins may be off. Turn the \
                     instrument or use another drive",
                1e3 * period
            ),
        ),
        Swings::Interference { frequency } => (
            "interference",
            format!(
                "at constant velocity the force swings at {frequency:.0} Hz whatever the speed: not stick-slip, but interference or \
                     a vibration of the rig; find its source, or filter force and position alike before identification"
            ),
        ),
    };
    Warning::doubt(subject, text)
}

/// The remark about strokes that are not fitted.
fn left_out(input: &Input) -> Option<Warning> {
    let count: usize = input.left_out.iter().map(|out| out.strokes.len()).sum();
    let all: usize = input.segments.iter().map(|segments| segments.strokes.len()).sum();
    let how = match input.stick_slip {
        Some(_) => "fitted up to the first slip alone",
        None => "not fitted",
    };
    let text = || {
        format!(
            "in {count} of {all} strokes the force swings as where a seal sticks and slips: they are {how}"
        )
    };
    (count > 0 && !input.options.paper).then(|| Warning::remark("swings", text()))
}

fn in_words(found: &StickSlip, are_left_out: bool) -> String {
    let speeds = speeds_in_words(found.speed_m_s);
    let ([low, high], [rare, often]) = (found.force_n, found.frequency_hz);
    let consequence = match are_left_out {
        true => {
            "No model predicts when each slip begins, so slow strokes are fitted up to the first one alone: c, the joins and \
             what changes in time may be off; record faster strokes, too"
        }
        false => {
            "The static force F_s is the upper of the two, whatever the fit gives: no model predicts when each slip begins, so \
             sliding forces, Stribeck velocity and c may be off; record faster strokes, too"
        }
    };
    format!(
        "at {speeds} mm/s the force swings between {low:.2} and {high:.2} N, {rare:.1} to {often:.1} times a second: the seal \
             sticks and slips. {consequence}"
    )
}

fn speeds_in_words(speed_m_s: [f64; 2]) -> String {
    let [slow, fast] = speed_m_s.map(|v| format!("{:.0}", 1e3 * v));
    if slow == fast { slow } else { format!("{slow} to {fast}") }
}

/// Names of the recordings.
pub(super) fn names(recordings: &[Recording]) -> Vec<&str> {
    recordings.iter().map(|r| r.name.as_str()).collect()
}
