//! A candidate model as a vector of free parameters, for the fit of the simulated force.

use nalgebra::DMatrix;
use rand::{Rng, RngExt};
use rayon::prelude::*;
use trocar_model::{
    BESIDE, Beside, Branch, DeformationForce, Direction, Element, ElementParams, Friction, Lead,
    MAX_ARMS, Ordinate, ParamError, ParameterId, Parameters, Quantity, Relaxation, SealDamping,
    SlidingFriction, Stages, StagesState,
};

use trocar_recording::loads::{ByLoad, Load, Loads};

use super::kept::Kept;
use super::likelihood::{BLOCK, Column, Free, LEAP, Trial, each_alone, with_rows};
use super::load::{OfLoad, load_of, of_load};
use super::prior::Kind;
use super::shape::{BranchShape, EndForces, Span};
use super::stage::{SecondStage, yielding};
use super::training::Step;

/// An EMS element (key EMS in SOURCES.md, (8)-(14)) and the sensor offset, not yet validated.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Sensor offset F_0, N; not part of the seal.
    pub offset: f64,
    /// Loads that the readings show beside the force of the seal; the mass in addition to the declared
    /// one.
    pub loads: Loads,
    /// Sliding force in insertion.
    pub insertion: SlidingFriction,
    /// Sliding force in withdrawal.
    pub withdrawal: SlidingFriction,
    /// c, m.
    pub half_width: f64,
    /// Branch of the insertion.
    pub insertion_branch: BranchShape,
    /// Branch of the withdrawal.
    pub withdrawal_branch: BranchShape,
    /// σ, N s/m.
    pub seal_damping: f64,
    /// κ relative to its least value, the steepest change of the half gap; >= 1.
    pub yield_ratio: f64,
    /// v_c, m/s; 0 for a contact that does not creep.
    pub creep_velocity: f64,
    /// T, s: lag of the Stribeck curve of a creeping contact.
    pub friction_lag: f64,
    /// ΔF, N: friction after rest.
    pub dwell_force: f64,
    /// Relaxation of the rubber.
    pub relaxation: Relaxation,
    /// A second stage in parallel.
    pub second: Option<SecondStage>,
}

impl Candidate {
    /// An element with the mean sliding of both directions, as a sensor without a known tare sees it:
    /// half the difference of the directions counts as offset, in the branches, too.
    ///
    /// # Errors
    /// When the mean sliding and the branches do not form a valid model.
    pub(super) fn of(params: &ElementParams) -> Result<Self, ParamError> {
        let deformation = &params.deformation;
        let (insertion, withdrawal) = (&params.insertion, &params.withdrawal);
        let mean = |of: fn(&SlidingFriction) -> f64| 0.5 * (of(insertion) + of(withdrawal));
        let sliding = SlidingFriction {
            coulomb_force: mean(|s| s.coulomb_force),
            static_force: mean(|s| s.static_force),
            viscous_damping: mean(|s| s.viscous_damping),
            ..*insertion
        };
        let offset = 0.5 * (insertion.static_force - withdrawal.static_force);
        let [insertion_branch, withdrawal_branch] =
            [deformation.insertion(), deformation.withdrawal()].map(|branch| {
                let shape = BranchShape::of(branch);
                BranchShape { join_force: shape.join_force - offset, ..shape }
            });
        let softest =
            DeformationForce::new(*deformation.insertion(), *deformation.withdrawal(), None)?;
        Ok(Self {
            offset: 0.0,
            loads: Loads::default(),
            insertion: sliding,
            withdrawal: sliding,
            half_width: deformation.half_width(),
            insertion_branch,
            withdrawal_branch,
            seal_damping: params.damping.coefficients[0],
            yield_ratio: Self::DEFAULT_YIELD_RATIO * deformation.yield_stiffness()
                / softest.yield_stiffness(),
            creep_velocity: params.creep_velocity,
            friction_lag: params.friction_lag,
            dwell_force: params.dwell_force,
            relaxation: params.relaxation,
            second: None,
        })
    }

    /// The default yield ratio of an element.
    pub const DEFAULT_YIELD_RATIO: f64 = 1.01;

    /// Sliding force of all stages relative to that of the first.
    pub(crate) fn stage_factor(&self) -> f64 {
        1.0 + self.second.as_ref().map_or(0.0, |second| second.share)
    }

    /// Forces at ±c.
    pub fn end_forces(&self) -> EndForces {
        EndForces { low: -self.withdrawal.static_force, high: self.insertion.static_force }
    }

    /// Sliding force in `direction`.
    pub fn sliding(&self, direction: Direction) -> &SlidingFriction {
        direction.pick([&self.insertion, &self.withdrawal])
    }

    /// Branch in `direction`.
    pub fn branch(&self, direction: Direction) -> &BranchShape {
        direction.pick([&self.insertion_branch, &self.withdrawal_branch])
    }

    /// The value of a parameter, SI; NaN for what the candidate does not have. Sliding and damping
    /// of all stages together, in both directions on average, unless `id` names one of them.
    pub fn value(&self, id: ParameterId) -> f64 {
        use Quantity as Q;
        let ParameterId { element, direction, quantity } = id;
        let all_stages = |sliding: &SlidingFriction| match quantity {
            Q::StribeckVelocity | Q::StribeckExponent | Q::StaticRatio => sliding.value(quantity),
            _ => sliding.value(quantity).map(|value| self.stage_factor() * value),
        };
        let [first, second] = &self.relaxation.arms;
        let of_second = |of: fn(&SecondStage) -> f64| self.second.as_ref().map(of);
        let value = match (element, direction, quantity) {
            (Some(2), None, Q::CoulombForce) => {
                let whole = self.value(Q::CoulombForce.id());
                of_second(|stage| stage.share).map(|share| whole * share / self.stage_factor())
            }
            (Some(2), None, Q::HalfWidth) => of_second(|stage| stage.half_width),
            (Some(2), Some(direction), _) => self.of_second_branch(direction, quantity),
            (Some(_), ..) => None,
            (None, Some(direction), Q::CoulombForceWithOffset) => {
                let level = self.stage_factor() * self.sliding(direction).coulomb_force;
                Some(level + direction.sign() * self.offset)
            }
            (None, Some(direction), Q::Join) => Some(self.branch(direction).join * self.half_width),
            (None, Some(direction), Q::JoinForce) => Some(self.branch(direction).join_force),
            (None, Some(direction), Q::Coefficient { piece, power }) => {
                self.coefficient(direction, piece, power)
            }
            (None, Some(direction), _) => all_stages(self.sliding(direction)),
            (None, None, Q::Offset) => Some(self.offset),
            (None, None, Q::HalfWidth) => Some(self.half_width),
            (None, None, Q::SealDamping) => Some(self.stage_factor() * self.seal_damping),
            (None, None, Q::YieldStiffness) => {
                self.params().ok().map(|params| params.deformation.yield_stiffness())
            }
            (None, None, Q::CreepVelocity) => Some(self.creep_velocity),
            (None, None, Q::FrictionLag) => Some(self.friction_lag),
            (None, None, Q::DwellForce) => Some(self.stage_factor() * self.dwell_force),
            (None, None, Q::SecondRelaxationStiffness) => Some(second.stiffness),
            (None, None, Q::SecondRelaxationTime) => Some(second.time),
            (None, None, Q::StribeckVelocity | Q::StribeckExponent | Q::StaticRatio) => {
                self.insertion.value(quantity)
            }
            (None, None, _) if load_of(quantity).is_some() => {
                load_of(quantity).map(|load| self.loads[load])
            }
            (None, None, _) => first.number(quantity).or_else(|| {
                let both = self.insertion.value(quantity)? + self.withdrawal.value(quantity)?;
                Some(0.5 * self.stage_factor() * both)
            }),
        };
        value.unwrap_or(f64::NAN)
    }

    /// θ of EMS (25).
    fn coefficient(&self, direction: Direction, piece: u8, power: u8) -> Option<f64> {
        let branch = self.branch(direction).branch(self.half_width, self.end_forces()).ok()?;
        coefficient_of(&branch, piece, power)
    }

    /// A parameter of a branch of the second stage.
    fn of_second_branch(&self, direction: Direction, quantity: Quantity) -> Option<f64> {
        let stage = self.second.as_ref()?;
        let shape = stage.branch(direction);
        match quantity {
            Quantity::Join => Some(shape.join * stage.half_width),
            Quantity::JoinForce => Some(shape.join_force),
            Quantity::Coefficient { piece, power } => {
                let ends = stage.end_forces(&self.insertion, &self.withdrawal);
                coefficient_of(&shape.branch(stage.half_width, ends).ok()?, piece, power)
            }
            _ => None,
        }
    }

    /// The model's parameters.
    ///
    /// # Errors
    /// When the parameters do not form a valid model.
    pub fn params(&self) -> Result<ElementParams, ParamError> {
        let end_forces = self.end_forces();
        let insertion_branch = self.insertion_branch.branch(self.half_width, end_forces)?;
        let withdrawal_branch = self.withdrawal_branch.branch(self.half_width, end_forces)?;
        let softest = DeformationForce::new(insertion_branch, withdrawal_branch, None)?;
        let deformation = yielding(softest, self.yield_ratio / Self::DEFAULT_YIELD_RATIO)?;
        Ok(ElementParams {
            damping: SealDamping { coefficients: [self.seal_damping, 0.0, 0.0] },
            creep_velocity: self.creep_velocity,
            friction_lag: if self.creep_velocity > 0.0 { self.friction_lag } else { 0.0 },
            dwell_force: self.dwell_force,
            relaxation: self.relaxation,
            ..ElementParams::new(deformation, self.insertion, self.withdrawal)
        })
    }

    /// The model, ready to run: one element per stage.
    ///
    /// # Errors
    /// When the parameters do not form a valid model.
    pub fn stages(&self) -> Result<Stages, ParamError> {
        let params = self.params()?;
        let first = Element::new(params)?;
        let Some(second) = &self.second else { return Ok(first.into()) };
        let both = [first, Element::new(second.params(&params)?)?];
        Ok(Stages::new(&both).expect("two elements"))
    }

    /// The same with δ = `exponent`.
    pub(super) fn with_exponent(mut self, exponent: f64) -> Self {
        for sliding in [&mut self.insertion, &mut self.withdrawal] {
            sliding.stribeck_exponent = exponent;
        }
        self
    }
}

/// Number of cells of a branch between its ordinates.
const CELLS: usize = 50;
/// Ordinates of both branches.
pub(super) const ORDINATES: usize = 2 * CELLS;

/// The ordinates of a branch: z/c of the inner nodes.
pub(super) fn nodes() -> impl Iterator<Item = f64> {
    (1..CELLS).map(|k| 2.0 * k as f64 / CELLS as f64 - 1.0)
}

impl Candidate {
    /// The ordinates of both branches: the forces at the inner nodes, and after them the slope at
    /// the end to which the branch leads.
    fn ordinates(&self) -> Vec<Ordinate> {
        let c = self.half_width;
        let of_branch = |direction: Direction| {
            let spacing = 2.0 * c / CELLS as f64;
            let inner = nodes().map(move |u| Ordinate::node(direction, u * c, spacing));
            inner.chain([Ordinate::end_slope(direction.sign() * c)])
        };
        Direction::BOTH.into_iter().flat_map(of_branch).collect()
    }

    /// Whether the line beyond the end to which the branch in `direction` leads has the least slope,
    /// rather than that of the branch.
    pub(super) fn end_is_at_floor(&self, direction: Direction) -> bool {
        let Ok(branch) = self.branch(direction).branch(self.half_width, self.end_forces()) else {
            return true;
        };
        let ends = [(self.half_width, branch.right()), (-self.half_width, branch.left())];
        let (end, piece) = direction.pick(ends);
        branch.stiffness(2.0 * end) > piece.stiffness(end)
    }
}

/// A coefficient of one piece of a branch.
fn coefficient_of(branch: &Branch, piece: u8, power: u8) -> Option<f64> {
    let piece = if piece == 1 { branch.left() } else { branch.right() };
    piece.monomial().get(usize::from(power)).copied()
}

/// Expected bound on the curvature term of a branch, in units of the sliding force, for a finely
/// sampled deformation.
const WILDEST_BEND: f64 = 6.0;
/// Ranges without bounds.
const ANY: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];
const POSITIVE: [f64; 2] = [0.0, f64::INFINITY];
/// Range of v_c, m/s. Below it, the seal creeps by less than the encoder resolution in a second;
/// above it, sliding itself is creep.
const CREEP_RANGE: [f64; 2] = [1e-6, 2e-2];
/// Range of v_s, m/s.
pub(super) const STRIBECK_RANGE: [f64; 2] = [5e-4, 1.0];
/// Range of T, s.
const LAG_RANGE: [f64; 2] = [1e-3, 1.0];
/// Range of the second stage's share; outside it, one of the stages is negligible.
const SHARE_RANGE: [f64; 2] = [1e-2, 1e2];
/// Range of relaxation times, s. Faster relaxation acts as damping; slower relaxation exceeds the
/// holds in recordings.
const TIME_RANGE: [f64; 2] = [1e-2, 1e2];

/// Which parameters of a candidate are free, in the order of the parameter vector.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Layout {
    /// The sensor offset, unless it is given.
    pub(super) offset: bool,
    pub(super) loads: ByLoad<bool>,
    /// F_c and F_s by direction; only where the offset is given, since otherwise only their sum is
    /// identifiable.
    pub(super) own_levels: bool,
    /// β by direction.
    pub(super) own_slopes: bool,
    pub(super) viscous: bool,
    pub(super) stribeck: bool,
    /// δ, else 2 as in EMS (11).
    pub(super) exponent: bool,
    /// Largest Coulomb and static force, N, that the range of the readings permits.
    pub(super) largest: f64,
    /// Least and greatest static force, N, and half width, m, where a seal that sticks and slips is seen
    /// to let go.
    pub(super) lets_go: Option<[[f64; 2]; 2]>,
    /// c and the branches.
    pub(super) shape: bool,
    /// Least c, m, that encoder and sampling resolve.
    pub(super) narrowest: f64,
    /// Whether few positions lie within the deformation. The curvature of branches is then expected
    /// to stay within the sliding force.
    pub(super) is_coarse: bool,
    /// Whether the steps of an encoder are so coarse that they look like creep and a static force.
    pub(super) has_coarse_steps: bool,
    pub(super) damping: bool,
    /// Minor-loop stiffness.
    pub(super) yielding: bool,
    pub(super) creep: bool,
    /// Least v_c, m/s, that the motion can reveal.
    pub(super) slowest_creep: f64,
    /// Lag of the Stribeck curve.
    pub(super) lag: bool,
    /// Whether partial reversals can show that lag.
    pub(super) shows_lag: bool,
    /// Friction after rest.
    pub(super) dwell: bool,
    /// Relaxing arms.
    pub(super) arms: usize,
    /// A second stage.
    pub(super) second: bool,
    pub(super) kept: Kept,
}

/// δ of EMS (11).
pub(super) const GAUSSIAN: f64 = 2.0;

impl Layout {
    /// The element of the paper: (23), c and the branches.
    pub(super) fn paper() -> Self {
        let (offset, viscous, shape, largest) = (true, true, true, f64::INFINITY);
        Self { offset, viscous, shape, largest, ..Self::default() }
    }

    /// The parameters that `candidate` uses.
    pub(super) fn used_by(candidate: &Candidate) -> Self {
        let sliding = &candidate.insertion;
        let arms = &candidate.relaxation.arms;
        let stribeck = sliding.static_force > sliding.coulomb_force;
        Self {
            stribeck,
            exponent: stribeck && sliding.stribeck_exponent != GAUSSIAN,
            damping: candidate.seal_damping > 0.0,
            yielding: candidate.yield_ratio > 1.001 * Candidate::DEFAULT_YIELD_RATIO,
            creep: candidate.creep_velocity > 0.0,
            lag: candidate.creep_velocity > 0.0 && candidate.friction_lag > 0.0,
            dwell: candidate.dwell_force > 0.0,
            arms: arms.iter().filter(|arm| arm.stiffness > 0.0).count(),
            ..Self::paper()
        }
    }

    /// Every parameter that a fit may have.
    pub(super) fn every() -> Self {
        Self {
            loads: [true; 4],
            own_levels: true,
            own_slopes: true,
            stribeck: true,
            exponent: true,
            damping: true,
            yielding: true,
            creep: true,
            lag: true,
            dwell: true,
            arms: MAX_ARMS,
            second: true,
            ..Self::paper()
        }
    }
}

/// Visits the logarithm of a positive parameter.
fn on_log(kind: Kind, value: &mut f64, [low, high]: [f64; 2], mut on: impl FnMut(&mut f64, Span)) {
    let mut log = value.max(low).min(high).ln();
    on(&mut log, Span::new(kind, 1e-3, [low.ln(), high.ln()]));
    *value = log.exp();
}

impl Layout {
    /// Range of a parameter: the one in which it is kept, or that of the fit.
    pub(super) fn range(self, quantity: Quantity, of_fit: [f64; 2]) -> [f64; 2] {
        self.kept.range(quantity).unwrap_or(of_fit)
    }

    /// How a fit visits a number of this kind, whose range is kept or that of the fit.
    fn span(self, quantity: Quantity, kind: Kind, step: f64, of_fit: [f64; 2]) -> Span {
        Span::new(kind, step, self.range(quantity, of_fit))
    }

    /// Visits every free parameter of the candidate, in a fixed order.
    fn visit(self, candidate: &mut Candidate, mut on: impl FnMut(&mut f64, Span)) {
        let force = 1e-4 * candidate.insertion.coulomb_force;
        if self.offset {
            on(&mut candidate.offset, Span::new(Kind::Offset, force, ANY));
        }
        for load in self.free_loads() {
            let OfLoad { id: [id], kind, step, least, .. } = *of_load(load);
            let of_fit = [least, f64::INFINITY];
            on(&mut candidate.loads[load], self.span(id.quantity, kind, step, of_fit));
        }
        self.visit_sliding(candidate, force, &mut on);
        let width = candidate.half_width;
        let sliding =
            candidate.insertion.static_force.abs().max(candidate.withdrawal.static_force.abs());
        let bend = if self.is_coarse { sliding } else { WILDEST_BEND * sliding };
        if self.shape {
            let near = [0.3, 3.0].map(|part| (part * width).max(self.narrowest));
            let of_fit = self.lets_go.map_or(near, |[_, of_width]| of_width);
            let span = self.span(Quantity::HalfWidth, Kind::HalfWidth, 1e-4 * width, of_fit);
            on(&mut candidate.half_width, span);
            for shape in [&mut candidate.insertion_branch, &mut candidate.withdrawal_branch] {
                shape.visit(force, [sliding, bend], &mut on);
            }
        }
        if self.damping {
            let span = self.span(Quantity::SealDamping, Kind::Damping, 10.0 * force, POSITIVE);
            on(&mut candidate.seal_damping, span);
        }
        self.visit_time(candidate, force, &mut on);
        if let (true, Some(second)) = (self.second, &mut candidate.second) {
            on_log(Kind::LogShare, &mut second.share, SHARE_RANGE, &mut on);
            let widths = [0.02 * width, 5.0 * width];
            on_log(Kind::LogHalfWidth, &mut second.half_width, widths, &mut on);
            for shape in [&mut second.insertion_branch, &mut second.withdrawal_branch] {
                shape.visit(force, [sliding, bend], &mut on);
            }
        }
    }

    /// Those of sliding; `force` (N) is the step of a force.
    fn visit_sliding(
        self,
        candidate: &mut Candidate,
        force: f64,
        on: &mut impl FnMut(&mut f64, Span),
    ) {
        use Quantity as Q;
        let stages = candidate.stage_factor();
        let Candidate { insertion, withdrawal, .. } = candidate;
        let forces = [10.0 * force, self.largest.max(10.0 * force)];
        let other = *withdrawal;
        on(
            &mut insertion.coulomb_force,
            self.span(Q::CoulombForce, Kind::SlidingForce, force, forces),
        );
        if self.viscous {
            let span = self.span(Q::ViscousDamping, Kind::Damping, 10.0 * force, POSITIVE);
            on(&mut insertion.viscous_damping, span);
        }
        if self.stribeck {
            let [low, high] = forces;
            let of_fit = [low, high.min(10.0 * insertion.coulomb_force)];
            // What is seen is the force of all stages.
            let of_fit = self.lets_go.map_or(of_fit, |[seen, _]| seen.map(|force| force / stages));
            let span = self.span(Q::StaticForce, Kind::SlidingForce, force, of_fit);
            on(&mut insertion.static_force, span);
            let span = self.span(Q::StribeckVelocity, Kind::StribeckVelocity, 1e-5, STRIBECK_RANGE);
            on(&mut insertion.stribeck_velocity, span);
            if self.exponent {
                let span = Span::new(Kind::StribeckExponent, 1e-2, [0.5, 3.0]);
                on(&mut insertion.stribeck_exponent, span);
            }
        } else {
            insertion.static_force = insertion.coulomb_force;
        }
        *withdrawal = *insertion;
        let of_force = Span::new(Kind::SlidingForce, force, forces);
        if self.own_levels {
            withdrawal.coulomb_force = other.coulomb_force;
            on(&mut withdrawal.coulomb_force, of_force);
            withdrawal.static_force = withdrawal.coulomb_force;
            if self.stribeck {
                withdrawal.static_force = other.static_force;
                on(&mut withdrawal.static_force, of_force);
            }
        }
        if self.own_slopes && self.viscous {
            withdrawal.viscous_damping = other.viscous_damping;
            let span = Span::new(Kind::Damping, 10.0 * force, POSITIVE);
            on(&mut withdrawal.viscous_damping, span);
        }
        for sliding in [insertion, withdrawal] {
            sliding.static_force = sliding.static_force.max(sliding.coulomb_force);
        }
    }

    /// Those by which the seal changes in time.
    fn visit_time(
        self,
        candidate: &mut Candidate,
        force: f64,
        mut on: &mut impl FnMut(&mut f64, Span),
    ) {
        use Quantity as Q;
        if self.yielding {
            let span = Span::new(Kind::YieldRatio, 1e-3, [Candidate::DEFAULT_YIELD_RATIO, 20.0]);
            on(&mut candidate.yield_ratio, span);
        }
        if self.creep {
            let [low, high] = CREEP_RANGE;
            let range = self.range(Q::CreepVelocity, [low.max(self.slowest_creep), high]);
            on_log(Kind::LogCreepVelocity, &mut candidate.creep_velocity, range, &mut on);
        }
        if self.lag {
            on_log(Kind::LogFrictionLag, &mut candidate.friction_lag, LAG_RANGE, &mut on);
        }
        if self.dwell {
            let span = self.span(Q::DwellForce, Kind::DwellForce, force, POSITIVE);
            on(&mut candidate.dwell_force, span);
        }
        // A trial may hold impossible values: the range must remain valid.
        let stiffest =
            (10.0 * candidate.insertion.coulomb_force / candidate.half_width).abs().clamp(1.0, 1e9);
        for (k, arm) in candidate.relaxation.arms.iter_mut().take(self.arms).enumerate() {
            let range = |of: Quantity, own| if k == 0 { self.range(of, own) } else { own };
            let stiffness = range(Q::RelaxationStiffness, [1e-3 * stiffest, stiffest]);
            on_log(Kind::LogStiffness, &mut arm.stiffness, stiffness, &mut on);
            let time = range(Q::RelaxationTime, TIME_RANGE);
            on_log(Kind::LogRelaxationTime, &mut arm.time, time, &mut on);
        }
    }

    /// The free parameters of a candidate.
    pub(super) fn free(self, candidate: &Candidate) -> Vec<Free> {
        let mut free = Vec::new();
        self.visit(&mut candidate.clone(), |value, span| {
            let Span { kind, step, low, high, expected } = span;
            let (value, column) = (*value, Column::Simulated);
            free.push(Free { kind: Some(kind), value, step, low, high, expected, column });
        });
        let linear = self.offset.then_some(Column::Offset).into_iter();
        let linear = linear.chain(self.free_loads().map(Column::Load));
        free.iter_mut().zip(linear).for_each(|(free, column)| free.column = column);
        free
    }

    pub(super) fn free_loads(self) -> impl Iterator<Item = Load> {
        Load::ALL.into_iter().filter(move |load| self.loads[*load as usize])
    }

    /// The candidate with its free parameters replaced, each clamped to its range.
    pub(super) fn with(self, candidate: &Candidate, values: &[f64]) -> Candidate {
        self.replaced(candidate, values, |value, low, high| value.max(low).min(high))
    }

    /// The candidate with its free parameters replaced without clamping: for the spread of an
    /// estimate, not for a model.
    pub(super) fn with_any(self, candidate: &Candidate, values: &[f64]) -> Candidate {
        self.replaced(candidate, values, |value, _, _| value)
    }

    fn replaced(
        self,
        candidate: &Candidate,
        values: &[f64],
        held: impl Fn(f64, f64, f64) -> f64,
    ) -> Candidate {
        let mut replaced = candidate.clone();
        let mut values = values.iter();
        self.visit(&mut replaced, |value, Span { low, high, .. }| {
            *value = held(*values.next().expect("one value for each free number"), low, high);
        });
        replaced
    }
}

/// A candidate with its free parameters: the variable of the fit.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct EmsTrial {
    pub(super) candidate: Candidate,
    pub(super) layout: Layout,
    /// d_k: drift of the friction scale.
    pub(super) drift: Vec<f64>,
}

impl EmsTrial {
    pub(super) fn new(candidate: Candidate, layout: Layout) -> Self {
        Self { candidate, layout, drift: Vec::new() }
    }

    /// The trial with another join of one branch, whose polynomials come nearest to its own.
    pub(super) fn with_join(&self, direction: Direction, join: f64) -> Option<Self> {
        let moved =
            self.candidate.branch(direction).with_join(join, self.candidate.end_forces())?;
        let mut other = self.clone();
        let Candidate { insertion_branch, withdrawal_branch, .. } = &mut other.candidate;
        *direction.pick([insertion_branch, withdrawal_branch]) = moved;
        Some(other)
    }

    /// The trial with a moderate random change of width, branches and creep.
    pub(super) fn shaken(&self, rng: &mut impl Rng) -> Self {
        let mut shaken = self.clone();
        let candidate = &mut shaken.candidate;
        let mut by = |size: f64| size * (2.0 * rng.random::<f64>() - 1.0);
        candidate.half_width *= by(0.2).exp();
        candidate.creep_velocity *= by(0.5).exp();
        let force = 0.2 * candidate.insertion.static_force;
        for shape in [&mut candidate.insertion_branch, &mut candidate.withdrawal_branch] {
            shape.join += by(0.2);
            shape.join_force += by(force);
            shape.left.iter_mut().chain(&mut shape.right).for_each(|bend| *bend += by(force));
        }
        shaken.clamped()
    }

    /// With each free parameter within its range.
    pub(super) fn clamped(&self) -> Self {
        self.with(&self.free().iter().map(|free| free.value).collect::<Vec<_>>())
    }

    /// Number of free model parameters.
    pub(super) fn free_numbers(&self) -> usize {
        self.layout.free(&self.candidate).iter().filter(|free| free.low < free.high).count()
    }

    fn replaced(
        &self,
        values: &[f64],
        with: impl Fn(Layout, &Candidate, &[f64]) -> Candidate,
    ) -> Self {
        let (own, drift) = values.split_at(values.len() - self.drift.len());
        Self {
            candidate: with(self.layout, &self.candidate, own),
            layout: self.layout,
            drift: drift.to_vec(),
        }
    }
}

impl Trial for EmsTrial {
    type Model = Stages;
    type Followers = Vec<Ordinate>;

    fn model(&self) -> Option<Stages> {
        self.candidate.stages().ok()
    }

    fn free(&self) -> Vec<Free> {
        let of_drift = |(k, value): (usize, &f64)| Free {
            kind: None,
            value: *value,
            step: 1e-3,
            low: f64::NEG_INFINITY,
            high: f64::INFINITY,
            expected: f64::INFINITY,
            column: Column::Drift(k),
        };
        let mut free = self.layout.free(&self.candidate);
        free.extend(self.drift.iter().enumerate().map(of_drift));
        free
    }

    fn with(&self, values: &[f64]) -> Self {
        self.replaced(values, Layout::with)
    }

    fn with_any(&self, values: &[f64]) -> Self {
        self.replaced(values, Layout::with_any)
    }

    fn within(&self) -> Self {
        if self.layout.kept.is_empty() { self.clone() } else { self.clamped() }
    }

    fn offset(&self) -> f64 {
        self.candidate.offset
    }

    fn loads(&self) -> Loads {
        self.candidate.loads
    }

    fn drift(&self) -> &[f64] {
        &self.drift
    }

    /// The steps of the free numbers change a force by a thousandth of the static force at most.
    fn leap(&self) -> f64 {
        LEAP * self.candidate.stage_factor() * self.candidate.insertion.static_force.abs()
    }

    fn limit(model: &Stages, direction: Direction) -> f64 {
        let of = |element: &Element| {
            let ElementParams { insertion, withdrawal, .. } = element.params();
            direction.pick([insertion, withdrawal]).static_force
        };
        direction.sign() * model.elements().iter().map(of).sum::<f64>()
    }

    fn followers(&self) -> Vec<Ordinate> {
        self.candidate.ordinates()
    }

    fn follow(
        ordinates: &mut Vec<Ordinate>,
        model: &Stages,
        state: &mut StagesState,
        steps: &[Step],
    ) -> DMatrix<f64> {
        let mut rates = DMatrix::zeros(ordinates.len(), steps.len());
        for (step, mut rates) in steps.iter().zip(rates.column_iter_mut()) {
            let before: Vec<f64> = ordinates.iter().map(Ordinate::derivative).collect();
            model.step_beside_ordinates(state, ordinates, step.displacement, step.duration);
            for ((rate, before), ordinate) in rates.iter_mut().zip(before).zip(&*ordinates) {
                *rate = step.at_centre(before, ordinate.derivative());
            }
        }
        rates
    }

    fn forces(
        models: &[Stages],
        states: &mut [StagesState],
        close: usize,
        steps: &[Step],
    ) -> DMatrix<f64> {
        let (near, alone) = models.split_at(close);
        let (of_near, of_alone) = states.split_at_mut(close);
        match (near, alone) {
            ([], _) => each_alone(alone, of_alone, steps),
            (_, []) => led(near, of_near, steps),
            _ => with_rows(led(near, of_near, steps), &each_alone(alone, of_alone, steps)),
        }
    }
}

/// The models that differ in a stage from the first, and their places.
fn companies<'a>(models: &'a [Stages], states: &[StagesState]) -> Vec<(Beside<'a>, Vec<usize>)> {
    let (leading, state) = (&models[0], &states[0]);
    let mut all = Vec::new();
    for stage in 0..leading.elements().len() {
        let different: Vec<usize> = (1..models.len())
            .filter(|k| {
                models[*k].elements().get(stage) != leading.elements().get(stage)
                    || states[*k].states().get(stage) != state.states().get(stage)
            })
            .collect();
        for places in different.chunks(BESIDE) {
            let own: Vec<_> = places.iter().map(|k| (&models[*k], states[*k])).collect();
            let beside = leading.beside(state, stage, &own).expect("models of equal stages");
            all.push((beside, places.to_vec()));
        }
    }
    all
}

/// Forces of models that differ little from the first, which leads, N: a row for each.
fn led(models: &[Stages], states: &mut [StagesState], steps: &[Step]) -> DMatrix<f64> {
    let mut forces = DMatrix::zeros(models.len(), steps.len());
    let (mut beside, places): (Vec<Beside>, Vec<Vec<usize>>) =
        companies(models, states).into_iter().unzip();
    let mut leading = states[0];
    let mut before: Vec<f64> = states.iter().map(Stages::force).collect();
    for (block, steps) in steps.chunks(BLOCK).enumerate() {
        let mut forces = forces.columns_mut(block * BLOCK, steps.len());
        let led = Led::by(&models[0], &mut leading, steps);
        for (mut after, force) in forces.column_iter_mut().zip(&led.forces) {
            after.fill(*force);
        }
        let apart: Vec<Vec<[f64; BESIDE]>> =
            beside.par_iter_mut().map(|own| followed(&led, own)).collect();
        for (apart, places) in apart.iter().zip(&places) {
            for (mut after, apart) in forces.column_iter_mut().zip(apart) {
                places.iter().zip(apart).for_each(|(k, more)| after[*k] += more);
            }
        }
        for (mut forces, step) in forces.column_iter_mut().zip(steps) {
            for (force, before) in forces.iter_mut().zip(&mut before) {
                let after = std::mem::replace(force, step.at_centre(*before, *force));
                *before = after;
            }
        }
    }
    for state in &mut states[1..] {
        *state = leading;
    }
    for (beside, places) in beside.iter().zip(&places) {
        places.iter().enumerate().for_each(|(i, k)| beside.put_state(i, &leading, &mut states[*k]));
    }
    states[0] = leading;
    forces
}

/// The steps of a model that leads.
struct Led<'a> {
    parts: Vec<Lead<'a>>,
    /// Number of parts up to the end of each step.
    ends: Vec<usize>,
    /// After each step, N.
    forces: Vec<f64>,
}

impl<'a> Led<'a> {
    fn by(model: &'a Stages, state: &mut StagesState, steps: &[Step]) -> Self {
        // A step of the usual length has one part, or two.
        let mut parts = Vec::with_capacity(2 * steps.len());
        let mut ends = Vec::with_capacity(steps.len());
        let of = |step: &Step| {
            let keep = |part| parts.push(part);
            let force = model.lead(state, step.displacement, step.duration, keep);
            ends.push(parts.len());
            force
        };
        let forces = steps.iter().map(of).collect();
        Self { parts, ends, forces }
    }
}

/// By how much the forces of models beside one that leads exceed its own after each step, N.
fn followed(led: &Led, beside: &mut Beside) -> Vec<[f64; BESIDE]> {
    let mut all = Vec::with_capacity(led.ends.len());
    let mut from = 0;
    for end in &led.ends {
        for part in &led.parts[from..*end] {
            beside.follow(part);
        }
        from = *end;
        all.push(*beside.forces());
    }
    all
}
