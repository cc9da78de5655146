//! Effects that a fitted model leaves unexplained: a position delay, an unmodelled mass, damping of
//! the deformation.
//!
//! Each is a column of the normal equations that the model does not have. One step of the joint
//! equations estimates its size ([`Normal::one_step`]). A mass, a damping and a creeping contact
//! may be mistaken for a delay, which is therefore tested together with them.

use serde::Serialize;

use super::candidate::EmsTrial;
use super::estimate::{Estimate, t_p_value, t_quantile};
use super::likelihood::{Extra, Fitted, Free, Normal, OneStep, Trial};
use super::spread::variance;
use super::training::Training;
use trocar_recording::Recording;
use trocar_recording::loads::Load;

/// A delay of the position readings.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PositionDelay {
    /// Time, s, by which the position readings lag.
    pub delay_s: f64,
    /// Standard error, s.
    pub standard_error_s: f64,
    /// p value of the hypothesis of no delay.
    pub p_value: f64,
    /// Fraction of the squared error that it removes, to first order.
    #[serde(skip)]
    pub(super) gain: f64,
}

impl PositionDelay {
    /// p value below which a delay is accepted, and least fraction of the squared error that it
    /// must remove.
    pub(super) const LEVEL: f64 = 1e-3;
    pub(super) const LEAST_GAIN: f64 = 0.01;
    /// p value below which a delay already compensated is corrected.
    pub(super) const CORRECTED: f64 = 0.01;
    /// Most corrections: each is accurate to first order about the last; and most of those after
    /// the optional terms.
    pub(super) const MOST: usize = 10;
    pub(super) const MOST_AFTER: usize = 2;
    /// Fraction of the sampling interval below which a delay is neglected.
    pub(super) const NEGLIGIBLE: f64 = 0.1;
    /// Longest delay, s.
    pub(super) const LONGEST: f64 = 0.15;

    /// Whether the delay is accepted.
    pub(super) fn is_clear(&self) -> bool {
        self.delay_s > 0.0 && self.gain > Self::LEAST_GAIN && self.p_value < Self::LEVEL
    }

    /// The sum of `earlier` and this one.
    pub(super) fn added_to(self, earlier: Option<Self>) -> Self {
        Self { delay_s: self.delay_s + earlier.map_or(0.0, |e| e.delay_s), ..self }
    }
}

/// An effect that the model may lack.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Cause {
    Delay,
    Mass,
    Damping,
    Creep,
}

/// Size of the damping, N s/m, whose secant is the column.
const DAMPING: f64 = 1.0;
/// Sizes of v_c, m/s, whose secants are columns.
const CREEP: [f64; 2] = [3e-4, 3e-3];

/// The normal equations of a fit with a column for each cause that its model lacks.
pub(super) struct Unexplained {
    normal: Normal,
    free: Vec<Free>,
    held: Vec<bool>,
    /// Causes in the order of the columns after those of the free numbers.
    causes: Vec<Cause>,
    sigma2: f64,
}

impl Unexplained {
    /// Omits the delay where the sampling does not resolve the effects that may be mistaken for
    /// one.
    pub(super) fn new(
        recordings: &[Recording],
        training: &Training,
        fitted: &Fitted<EmsTrial>,
    ) -> Option<Self> {
        let EmsTrial { layout, candidate, .. } = &fitted.best;
        let mut columns = Vec::new();
        if recordings.iter().all(Recording::resolves_reversals) {
            columns.push((Cause::Delay, Extra::Delay));
        }
        if !layout.loads[Load::Mass as usize] {
            columns.push((Cause::Mass, Extra::Load(Load::Mass)));
        }
        let mut secant = |cause: Cause, change: &dyn Fn(&mut EmsTrial)| {
            let mut other = fitted.best.clone();
            change(&mut other);
            if other.model().is_some() {
                columns.push((cause, Extra::Secant(other)));
            }
        };
        if layout.shape && !layout.damping {
            secant(Cause::Damping, &|t| {
                t.candidate.seal_damping = candidate.seal_damping + DAMPING
            });
        }
        if layout.shape && !layout.creep {
            CREEP.iter().for_each(|v| secant(Cause::Creep, &|t| t.candidate.creep_velocity = *v));
        }
        let (causes, columns): (Vec<Cause>, Vec<_>) = columns.into_iter().unzip();
        let normal = fitted.with_columns(training, &columns)?;
        Some(Self {
            normal,
            free: fitted.best.free(),
            held: fitted.held.clone(),
            causes,
            sigma2: variance(fitted),
        })
    }

    /// One step of `cause` together with those of `beside`.
    fn step(&self, cause: Cause, beside: &[Cause]) -> Option<OneStep> {
        let own = self.held.len();
        let column = own + self.causes.iter().position(|c| *c == cause)?;
        let beside: Vec<usize> =
            (own..).zip(&self.causes).filter(|(_, c)| beside.contains(c)).map(|(j, _)| j).collect();
        let step = self.normal.one_step((&self.free, &self.held), &beside, column, self.sigma2)?;
        (step.standard_error.is_finite() && step.standard_error > 0.0).then_some(step)
    }

    /// Position delay, together with all effects that may be mistaken for one.
    pub(super) fn lag(&self) -> Option<PositionDelay> {
        self.lag_beside(&[Cause::Mass, Cause::Damping, Cause::Creep])
    }

    /// The same together with mass and damping only: before it is known whether the contact creeps,
    /// and for the remainder, of either sign, of a delay already compensated.
    pub(super) fn lag_left(&self) -> Option<PositionDelay> {
        self.lag_beside(&[Cause::Mass, Cause::Damping])
    }

    fn lag_beside(&self, beside: &[Cause]) -> Option<PositionDelay> {
        let step = self.step(Cause::Delay, beside)?;
        let p_value = t_p_value(step.amplitude / step.standard_error, step.degrees);
        Some(PositionDelay {
            delay_s: step.amplitude,
            standard_error_s: step.standard_error,
            p_value,
            gain: step.gain,
        })
    }

    /// An unmodelled mass, kg, if significant.
    pub(super) fn mass(&self) -> Option<f64> {
        let step = self.step(Cause::Mass, &[])?;
        let p_value = 0.5 * t_p_value(step.amplitude / step.standard_error, step.degrees);
        let shows = step.amplitude > 0.0
            && step.gain > PositionDelay::LEAST_GAIN
            && p_value < PositionDelay::LEVEL;
        shows.then_some(step.amplitude)
    }

    /// Damping of the deformation, N s/m, for a model without: 0, and the upper bound that the data
    /// permit.
    pub(super) fn damping(&self) -> Option<Estimate> {
        let step = self.step(Cause::Damping, &[])?;
        let most =
            DAMPING * (step.amplitude.max(0.0) + t_quantile(step.degrees) * step.standard_error);
        Some(Estimate::from_bounds(0.0, 0.0, most, "N s/m").with_note(
            "none found: the interval holds all values that are compatible with the data",
        ))
    }
}

/// Effects that a fit leaves unexplained.
#[derive(Debug, Clone, Default)]
pub(super) struct UnexplainedEffects {
    pub(super) lag: Option<PositionDelay>,
    /// The same where one was already compensated.
    pub(super) lag_left: Option<PositionDelay>,
    pub(super) mass: Option<f64>,
    pub(super) damping: Option<Estimate>,
}

impl UnexplainedEffects {
    pub(super) fn by(
        recordings: &[Recording],
        training: &Training,
        fitted: &Fitted<EmsTrial>,
    ) -> Self {
        let Some(tests) = Unexplained::new(recordings, training, fitted) else {
            return Self::default();
        };
        Self {
            lag: tests.lag(),
            lag_left: tests.lag_left(),
            mass: tests.mass(),
            damping: tests.damping(),
        }
    }
}
