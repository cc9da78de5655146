//! A model of the same trocar type as prior of an identification from a few strokes.
//!
//! ```text
//! θ_j ~ N(θ_j of the model, e_j² + (ρ·size_j)²)     e_j standard error of the model, ρ spread between seals of a type
//! ```
//! | parameter | size |
//! |---|---|
//! | F_c, F_s, forces of the branches | F_c |
//! | β, σ | β + F_c/(0.2 m/s) |
//! | joins | half of c |
//! | c, v_s, δ, κ | their value |
//! | creep, relaxation, second stage | a factor of e |
//!
//! The sensor offset and an unmodelled mass belong to the rig: they keep their weak priors. The
//! element has the optional terms of the model; no others are tried, since a few strokes would not
//! show them.

use std::collections::BTreeMap;

use serde::Serialize;
use trocar_model::{Direction, ParamError, ParameterId, Quantity, Stages};

use super::candidate::{Candidate, EmsTrial, Layout};
use super::likelihood::{self, Fitted, Free, Trial};
use super::load::is_of_rig;
use super::numbers::{self, OnLogarithm};
use super::prior::{Kind, Prior};
use super::shape::BranchShape;
use super::spread::{Dependent, Spread};
use super::stage::SecondStage;
use trocar_runtime::model_file::{Interval, ModelFile, ModelFileError};

/// Speed, m/s, at which the viscous force may differ between seals as the Coulomb force does.
const SPEED: f64 = 0.2;
/// Half width of a 95 % interval in standard errors.
const IN_95: f64 = 1.96;
/// A parameter whose standard deviation the strokes reduce to no less than this fraction is one
/// that they do not inform.
const UNINFORMED: f64 = 0.7;

/// A model of the same trocar type.
#[derive(Debug, Clone, PartialEq)]
pub struct SealPrior {
    stages: Stages,
    intervals: BTreeMap<String, Interval>,
    spread: f64,
    name: String,
}

/// What strokes add to a prior.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PriorUse {
    /// Name of the model.
    pub model: String,
    /// ρ: spread between seals of the type.
    pub spread: f64,
    /// Standard error of each parameter relative to that of the prior, by name: near 1 where the
    /// strokes say nothing.
    pub ratios: BTreeMap<String, f64>,
    /// The parameter farthest outside the range of the prior; `None` where the seal may be of its
    /// type.
    pub contradiction: Option<Contradiction>,
}

/// A parameter for which the strokes contradict the prior, SI.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Contradiction {
    /// The parameter; in JSON its name.
    #[serde(serialize_with = "name")]
    pub parameter: ParameterId,
    /// Range that holds it in 95 % of the seals of the prior.
    pub prior_range: [f64; 2],
    /// Estimate from the strokes and the prior.
    pub estimate: f64,
}

impl SealPrior {
    /// Spread between seals of one type without a better value: wetting alone changes friction by
    /// 15 to 45 % (DOBBELSTEEN).
    pub const SPREAD: f64 = 0.3;

    /// The prior of `model`, called `name`, with the spread ρ > 0 between seals of its type.
    ///
    /// # Errors
    /// [`ModelFileError`] for a classical model, or one of more than two elements.
    pub fn new(model: &ModelFile, name: &str, spread: f64) -> Result<Self, ModelFileError> {
        let stages = *model.stages()?;
        if stages.elements().len() > 2 {
            return Err(ModelFileError::Value {
                place: "elements".to_owned(),
                what: format!("a prior has one or two elements, got {}", stages.elements().len()),
            });
        }
        Ok(Self { stages, intervals: model.intervals.clone(), spread, name: name.to_owned() })
    }

    /// The model and the spread.
    #[must_use]
    pub fn in_words(&self) -> String {
        format!("prior {} with a spread of {:.0} %", self.name, 1e2 * self.spread)
    }

    /// The candidate of the model, with the mean Coulomb force of both directions.
    fn candidate(&self) -> Result<Candidate, ParamError> {
        let first = self.stages.first().params();
        let mut candidate = Candidate::of(first)?;
        candidate.insertion.viscous_damping = first.insertion.viscous_damping;
        candidate.withdrawal.viscous_damping = first.withdrawal.viscous_damping;
        candidate.second = self.stages.elements().get(1).map(|element| {
            let own = element.params();
            let deformation = &own.deformation;
            SecondStage {
                share: own.insertion.coulomb_force / first.insertion.coulomb_force,
                half_width: deformation.half_width(),
                insertion_branch: BranchShape::of(deformation.insertion()),
                withdrawal_branch: BranchShape::of(deformation.withdrawal()),
            }
        });
        Ok(candidate)
    }

    /// The trial that a fit starts from: `layout` with the terms of the model.
    ///
    /// # Errors
    /// As for [`Candidate::of`].
    pub(super) fn trial(&self, layout: Layout) -> Result<EmsTrial, ParamError> {
        let candidate = self.candidate()?;
        let own_slopes =
            candidate.insertion.viscous_damping != candidate.withdrawal.viscous_damping;
        let Layout { offset, loads, largest, narrowest, slowest_creep, .. } = layout;
        let layout = Layout {
            offset,
            loads,
            largest,
            narrowest,
            slowest_creep,
            own_slopes,
            second: candidate.second.is_some(),
            ..Layout::used_by(&candidate)
        };
        Ok(EmsTrial::new(candidate, layout))
    }

    /// The priors of the free parameters of a trial of this model.
    pub(super) fn of(&self, trial: &EmsTrial) -> Vec<Prior> {
        let free = trial.free();
        let weak = likelihood::weak_priors_of(&free);
        let of = |(free, weak): (&Free, Prior)| match free.kind {
            Some(kind) => self.of_kind(&trial.candidate, kind, free.value).unwrap_or(weak),
            None => weak,
        };
        free.iter().zip(weak).map(of).collect()
    }

    /// The prior of one free parameter; `None` for those of the rig.
    fn of_kind(&self, candidate: &Candidate, kind: Kind, value: f64) -> Option<Prior> {
        use Quantity as Q;
        let force = candidate.insertion.coulomb_force;
        let error = |quantity: Quantity| self.standard_error(quantity);
        let relative = |quantity: Quantity| {
            error(quantity).map_or(0.0, |e| e / candidate.value(quantity.id()).abs())
        };
        let (size, own) = match kind {
            Kind::Offset | Kind::UnmodelledMass | Kind::SideFriction => return None,
            Kind::TiltedWeight | Kind::PressureGain => return None,
            Kind::SlidingForce => (force, error(Q::CoulombForce).unwrap_or(0.0)),
            Kind::JoinForce | Kind::Bend => (force, error(Q::JoinForce).unwrap_or(0.0)),
            Kind::Damping => (value + force / SPEED, error(Q::ViscousDamping).unwrap_or(0.0)),
            Kind::HalfWidth => (value, error(Q::HalfWidth).unwrap_or(0.0)),
            Kind::Join => (0.5, error(Q::Join).map_or(0.0, |e| e / candidate.half_width)),
            Kind::StribeckVelocity => (value, error(Q::StribeckVelocity).unwrap_or(0.0)),
            Kind::StribeckExponent => (value, error(Q::StribeckExponent).unwrap_or(0.0)),
            Kind::DwellForce => (value, error(Q::DwellForce).unwrap_or(0.0)),
            Kind::YieldRatio => (value, value * relative(Q::YieldStiffness)),
            Kind::LogCreepVelocity => (1.0, relative(Q::CreepVelocity)),
            Kind::LogFrictionLag => (1.0, relative(Q::FrictionLag)),
            Kind::LogStiffness => (1.0, relative(Q::RelaxationStiffness)),
            Kind::LogRelaxationTime => (1.0, relative(Q::RelaxationTime)),
            Kind::LogShare | Kind::LogHalfWidth => (1.0, 0.0),
        };
        Some(Prior::new(value, own.hypot(self.spread * size)))
    }

    /// Standard error of a parameter of the model, from its interval; the mean over both directions
    /// for one that is given by direction.
    fn standard_error(&self, quantity: Quantity) -> Option<f64> {
        let of = |name: String| {
            let [low, high] = self.intervals.get(&name)?.ci95;
            Some((high? - low?) / (2.0 * IN_95))
        };
        of(quantity.id().to_string()).or_else(|| {
            let both = Direction::BOTH.map(|direction| of(quantity.of(direction).to_string()));
            Some(0.5 * (both[0]? + both[1]?))
        })
    }

    /// What the strokes added, for the parameters of `fitted` with a standard error.
    pub(super) fn used(&self, fitted: &Fitted<EmsTrial>, priors: &[Prior]) -> PriorUse {
        let EmsTrial { layout, .. } = &fitted.best;
        let free = fitted.best.free();
        let spread = Spread::new(fitted);
        let ratio = |(id, _): OnLogarithm| {
            if is_of_rig(id.quantity) {
                return None;
            }
            let value = |t: &EmsTrial| t.candidate.value(id);
            let Dependent { gradient, .. } = Dependent::on(&fitted.best, false, &value);
            let own = gradient.iter().zip(&free).zip(priors);
            let beforehand: f64 = own
                .map(|((g, free), prior)| (g * prior.deviation_within(free.range())).powi(2))
                .sum();
            let ratio = spread.deviation(&value) / beforehand.sqrt();
            ratio.is_finite().then(|| (id.to_string(), ratio))
        };
        PriorUse {
            model: self.name.clone(),
            spread: self.spread,
            ratios: numbers::quantities(*layout).into_iter().filter_map(ratio).collect(),
            contradiction: Contradiction::most(&free, priors),
        }
    }
}

fn name<S: serde::Serializer>(id: &ParameterId, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(id)
}

impl Contradiction {
    /// The farthest of F_c, β and c outside the prior.
    fn most(free: &[Free], priors: &[Prior]) -> Option<Self> {
        let all = free.iter().zip(priors).filter_map(|(free, prior)| {
            let quantity = match free.kind? {
                Kind::SlidingForce => Quantity::CoulombForce,
                Kind::Damping => Quantity::ViscousDamping,
                Kind::HalfWidth => Quantity::HalfWidth,
                _ => return None,
            };
            let Prior { mean, deviation } = *prior;
            let range = [-IN_95, IN_95].map(|far| (mean + far * deviation).max(0.0));
            let own = Self { parameter: quantity.id(), prior_range: range, estimate: free.value };
            let off = (free.value - mean).abs() / deviation;
            (off > IN_95).then_some((off, own))
        });
        all.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, own)| own)
    }

    /// What contradicts, in one line.
    #[must_use]
    pub fn in_words(&self) -> String {
        let Self { parameter, prior_range: [low, high], estimate } = self;
        let unit = parameter.unit().si;
        format!(
            "{estimate:.3e} {unit} is outside the range of the prior, {low:.3e} to {high:.3e} {unit}: the strokes contradict it, and no \
             interval holds; identify without ‹prior› from more strokes, or give a larger ‹prior_spread›"
        )
    }
}

impl PriorUse {
    /// Names of the parameters that the strokes do not inform.
    #[must_use]
    pub fn uninformed(&self) -> Vec<&str> {
        let as_before = self.ratios.iter().filter(|(_, ratio)| **ratio > UNINFORMED);
        as_before.map(|(name, _)| name.as_str()).collect()
    }

    /// What the strokes told and what they did not, in one line.
    #[must_use]
    pub fn in_words(&self) -> String {
        let Self { model, spread, .. } = self;
        let uninformed = self.uninformed();
        let begin = format!("{model}, {:.0} % between seals of its type", 1e2 * spread);
        match uninformed.as_slice() {
            [] => format!("{begin}; the strokes inform all parameters"),
            names => format!(
                "{begin}; the strokes contain almost no information about {}: as in the prior",
                names.join(", ")
            ),
        }
    }
}
