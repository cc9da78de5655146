//! A candidate model as a vector of free numbers, for the refinement against simulated force.

use trocar_model::{
    DeformationForce, Element, ElementParams, ParamError, Relaxation, SealDamping, SlidingFriction, Stages,
};

use super::output_error::{Free, Trial};
use super::shape::{BranchShape, Pins};
use super::stage::SecondStage;

/// An EMS element (key EMS in SOURCES.md, (8)-(14)) with the sensor offset beside it, before it is checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Sensor offset F_0, N; not part of the seal.
    pub offset: f64,
    /// Mass between sensor and seal that the readings show beyond the one given, kg.
    pub hidden_mass: f64,
    /// Sliding force in insertion.
    pub insertion: SlidingFriction,
    /// Sliding force in withdrawal.
    pub withdrawal: SlidingFriction,
    /// c, m.
    pub half_width: f64,
    /// Branch of the insertion.
    pub rising: BranchShape,
    /// Branch of the withdrawal.
    pub falling: BranchShape,
    /// σ, N s/m.
    pub seal_damping: f64,
    /// κ over its least value, the steepest change of the half gap; >= 1.
    pub yield_ratio: f64,
    /// v_c, m/s; 0 for a contact that does not creep.
    pub creep_velocity: f64,
    /// T, s: lag of the Stribeck curve of a creeping contact.
    pub friction_lag: f64,
    /// Relaxation of the rubber.
    pub relaxation: Relaxation,
    /// A second stage beside this one.
    pub second: Option<SecondStage>,
}

impl Candidate {
    /// The yield ratio that an element has by default.
    pub const DEFAULT_YIELD_RATIO: f64 = 1.01;

    /// Sliding force of all stages over that of the first.
    pub fn stage_factor(&self) -> f64 {
        1.0 + self.second.as_ref().map_or(0.0, |second| second.share)
    }

    /// Forces at ±c.
    pub fn pins(&self) -> Pins {
        Pins { low: -self.withdrawal.static_force, high: self.insertion.static_force }
    }

    /// The model's parameters.
    ///
    /// # Errors
    /// When the numbers do not make a model.
    pub fn params(&self) -> Result<ElementParams, ParamError> {
        let pins = self.pins();
        let rising = self.rising.branch(self.half_width, pins)?;
        let falling = self.falling.branch(self.half_width, pins)?;
        let softest = DeformationForce::new(rising, falling, None)?;
        let deformation = if self.yield_ratio > Self::DEFAULT_YIELD_RATIO {
            let stiffness = softest.yield_stiffness() * self.yield_ratio / Self::DEFAULT_YIELD_RATIO;
            DeformationForce::new(rising, falling, Some(stiffness))?
        } else {
            softest
        };
        Ok(ElementParams {
            deformation,
            damping: SealDamping { coefficients: [self.seal_damping, 0.0, 0.0] },
            insertion: self.insertion,
            withdrawal: self.withdrawal,
            creep_velocity: self.creep_velocity,
            friction_lag: if self.creep_velocity > 0.0 { self.friction_lag } else { 0.0 },
            relaxation: self.relaxation,
        })
    }

    /// The model, ready to run: one element a stage.
    ///
    /// # Errors
    /// When the numbers do not make a model.
    pub fn stages(&self) -> Result<Stages, ParamError> {
        let first = Element::new(self.params()?)?;
        let Some(second) = &self.second else { return Ok(first.into()) };
        let both = [first, Element::new(second.params(self)?)?];
        Ok(Stages::new(&both).expect("two elements"))
    }
}

/// Range of v_c, m/s: below, a second of creep moves the seal by less than an encoder sees; above, sliding itself is creep.
const CREEP_RANGE: [f64; 2] = [1e-6, 2e-2];
/// Range of T, s.
const LAG_RANGE: [f64; 2] = [1e-3, 1.0];
/// Range of the second stage's share: beyond, one of the stages is none.
const SHARE_RANGE: [f64; 2] = [1e-2, 1e2];
/// Range of relaxation times, s: faster is damping, slower is longer than recordings hold still.
const TIME_RANGE: [f64; 2] = [1e-2, 1e2];

/// Which numbers of a candidate are free, in the order of the parameter vector.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Layout {
    pub(super) symmetric: bool,
    pub(super) viscous: bool,
    pub(super) stribeck: bool,
    pub(super) damping: bool,
    pub(super) hidden_mass: bool,
    /// Minor-loop stiffness.
    pub(super) yielding: bool,
    pub(super) creep: bool,
    /// Lag of the Stribeck curve.
    pub(super) lag: bool,
    /// Relaxing arms.
    pub(super) arms: usize,
    /// A second stage.
    pub(super) second: bool,
}

/// Visits the logarithm of a number that must stay positive.
fn on_log(value: &mut f64, [low, high]: [f64; 2], mut on: impl FnMut(&mut f64, f64, f64, f64)) {
    let mut log = value.max(low).min(high).ln();
    on(&mut log, 1e-3, low.ln(), high.ln());
    *value = log.exp();
}

/// Precisions, 1/variance, of what the steady state estimates.
#[derive(Debug, Clone, Copy)]
pub(super) struct SteadyPrecisions {
    pub(super) offset: f64,
    /// Coulomb force and viscous damping, of both directions.
    pub(super) lines: [[f64; 2]; 2],
    /// Static force and Stribeck velocity.
    pub(super) stribeck: [f64; 2],
}

impl Layout {
    /// Visits every free number of the candidate, in a fixed order.
    fn visit(self, candidate: &mut Candidate, mut on: impl FnMut(&mut f64, f64, f64, f64)) {
        let free = f64::INFINITY;
        let force = 1e-4 * candidate.insertion.coulomb_force;
        on(&mut candidate.offset, force, -free, free);
        if self.hidden_mass {
            on(&mut candidate.hidden_mass, 1e-4, 0.0, free);
        }
        on(&mut candidate.insertion.coulomb_force, force, 10.0 * force, free);
        if self.viscous {
            on(&mut candidate.insertion.viscous_damping, 100.0 * force, 0.0, free);
        }
        if self.stribeck {
            on(&mut candidate.insertion.static_force, force, 10.0 * force, free);
            on(&mut candidate.insertion.stribeck_velocity, 1e-5, 5e-4, 1.0);
        }
        if self.symmetric {
            candidate.withdrawal = candidate.insertion;
        } else {
            on(&mut candidate.withdrawal.coulomb_force, force, 10.0 * force, free);
            if self.viscous {
                on(&mut candidate.withdrawal.viscous_damping, 100.0 * force, 0.0, free);
            }
            if self.stribeck {
                on(&mut candidate.withdrawal.static_force, force, 10.0 * force, free);
                candidate.withdrawal.stribeck_velocity = candidate.insertion.stribeck_velocity;
            }
        }
        for sliding in [&mut candidate.insertion, &mut candidate.withdrawal] {
            if self.stribeck {
                sliding.static_force = sliding.static_force.max(sliding.coulomb_force);
            } else {
                sliding.static_force = sliding.coulomb_force;
            }
        }
        let width = candidate.half_width;
        // Forces far beyond those of sliding are never reached: no reading would hold them.
        let wildest = 10.0 * candidate.insertion.static_force.abs().max(candidate.withdrawal.static_force.abs());
        on(&mut candidate.half_width, 1e-4 * width, 0.3 * width, 3.0 * width);
        for shape in [&mut candidate.rising, &mut candidate.falling] {
            shape.visit(force, wildest, &mut on);
        }
        if self.damping {
            on(&mut candidate.seal_damping, 10.0 * force, 0.0, free);
        }
        if self.yielding {
            on(&mut candidate.yield_ratio, 1e-3, Candidate::DEFAULT_YIELD_RATIO, 20.0);
        }
        if self.creep {
            on_log(&mut candidate.creep_velocity, CREEP_RANGE, &mut on);
        }
        if self.lag {
            on_log(&mut candidate.friction_lag, LAG_RANGE, &mut on);
        }
        // A trial of any numbers may have impossible ones: the range stays one.
        let stiffest = (10.0 * candidate.insertion.coulomb_force / candidate.half_width).abs().clamp(1.0, 1e9);
        for arm in candidate.relaxation.arms.iter_mut().take(self.arms) {
            on_log(&mut arm.stiffness, [1e-3 * stiffest, stiffest], &mut on);
            on_log(&mut arm.time, TIME_RANGE, &mut on);
        }
        if let (true, Some(second)) = (self.second, &mut candidate.second) {
            on_log(&mut second.share, SHARE_RANGE, &mut on);
            on_log(&mut second.half_width, [0.02 * width, 5.0 * width], &mut on);
            for shape in [&mut second.rising, &mut second.falling] {
                shape.visit(force, wildest, &mut on);
            }
        }
    }

    /// The free numbers of a candidate.
    pub(super) fn free(self, candidate: &Candidate) -> Vec<Free> {
        let mut free = Vec::new();
        self.visit(&mut candidate.clone(), |value, step, low, high| {
            free.push(Free { value: *value, step, low, high });
        });
        free
    }

    /// Precisions, 1/variance, of the free numbers of `count` in all that the steady state knows; 0 for the others.
    pub(super) fn precisions(self, known: &SteadyPrecisions, count: usize) -> Vec<f64> {
        let mut all = vec![known.offset];
        all.extend(self.hidden_mass.then_some(0.0));
        for (line, [coulomb, viscous]) in known.lines.iter().enumerate().take(if self.symmetric { 1 } else { 2 }) {
            all.push(*coulomb);
            all.extend(self.viscous.then_some(*viscous));
            if self.stribeck {
                all.extend(if line == 0 { &known.stribeck[..] } else { &[0.0] });
            }
        }
        all.resize(count, 0.0);
        all
    }

    /// The candidate with its free numbers replaced, each held within its range.
    pub(super) fn with(self, candidate: &Candidate, values: &[f64]) -> Candidate {
        self.replaced(candidate, values, |value, low, high| value.clamp(low, high))
    }

    /// The candidate with its free numbers replaced, wherever they fall: for the spread of an estimate, not for a model.
    pub(super) fn with_any(self, candidate: &Candidate, values: &[f64]) -> Candidate {
        self.replaced(candidate, values, |value, _, _| value)
    }

    fn replaced(self, candidate: &Candidate, values: &[f64], held: impl Fn(f64, f64, f64) -> f64) -> Candidate {
        let mut replaced = candidate.clone();
        let mut values = values.iter();
        self.visit(&mut replaced, |value, _, low, high| {
            *value = held(*values.next().expect("one value for each free number"), low, high);
        });
        replaced
    }
}

/// A candidate with the choice of its free numbers: what the output-error fit moves.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct EmsTrial {
    pub(super) candidate: Candidate,
    pub(super) layout: Layout,
}

impl EmsTrial {
    /// How many numbers are free.
    pub(super) fn free_numbers(&self) -> usize {
        self.layout.free(&self.candidate).len()
    }
}

impl Trial for EmsTrial {
    type Model = Stages;

    fn model(&self) -> Option<Stages> {
        self.candidate.stages().ok()
    }

    fn free(&self) -> Vec<Free> {
        self.layout.free(&self.candidate)
    }

    fn with(&self, values: &[f64]) -> Self {
        Self { candidate: self.layout.with(&self.candidate, values), layout: self.layout }
    }

    fn with_any(&self, values: &[f64]) -> Self {
        Self { candidate: self.layout.with_any(&self.candidate, values), layout: self.layout }
    }

    fn offset(&self) -> f64 {
        self.candidate.offset
    }

    fn hidden_mass(&self) -> f64 {
        self.candidate.hidden_mass
    }
}
