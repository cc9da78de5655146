//! The Extended Maxwell-Slip (EMS) element: a seal that first deforms with the instrument, then
//! lets it slide.

use crate::creep::{Resistance, Rise, resistance};
use crate::damping::SealDamping;
use crate::direction::Direction;
use crate::elastic::DeformationForce;
use crate::error::{ParamError, check_fields};
use crate::exponential::decay;
use crate::friction::{friction, velocity};
use crate::parameter::{Field, Parameters, fields};
use crate::relaxation::{ArmForces, MAX_ARMS, Relaxation};
use crate::sliding::SlidingFriction;

/// Allowed distance between a branch end and the static force, as a fraction of the static force.
const PIN_TOLERANCE: f64 = 1e-6;

/// Longest part of a general step, as a fraction of c.
pub(crate) const LONGEST_PART: f64 = 0.125;

/// Parts of a general step before the rest is taken in as many longer ones: 4 half widths of
/// travel, two full reversals.
const EVEN_PARTS: u32 = 32;

/// Parameters of one element. Checked by [`Element::new`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElementParams {
    /// F_e(z): force of the deformed seal, EMS (25).
    pub deformation: DeformationForce,
    /// σ(ż): damping of the seal, EMS (9).
    pub damping: SealDamping,
    /// Sliding friction for v_sl > 0.
    pub insertion: SlidingFriction,
    /// Sliding friction for v_sl < 0.
    pub withdrawal: SlidingFriction,
    /// v_c, m/s, >= 0: slip speed over which the contact's force builds up, [`crate::creep`]. 0 is
    /// EMS: no slip at all below the static force.
    pub creep_velocity: f64,
    /// T, s, >= 0: lag of the Stribeck curve, [`crate::creep`]; above 0 for a creeping contact
    /// only. 0 is EMS (11).
    pub friction_lag: f64,
    /// ΔF, N, >= 0: friction after rest, [`crate::dwell`]. 0 is EMS.
    pub dwell_force: f64,
    /// Slow relaxation of the rubber; [`Relaxation::NONE`] is EMS.
    pub relaxation: Relaxation,
}

/// What the seal does at the moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// The seal sticks to the instrument and deforms: v_sl = 0, EMS (10); with creep, |v_sl| <=
    /// v_c.
    Deforming,
    /// The instrument slides through the seal, EMS (14).
    Sliding,
}

/// Everything that changes while an element runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    pub(crate) deflection: f64,
    pub(crate) yield_force: f64,
    pub(crate) force: f64,
    pub(crate) slip_velocity: f64,
    /// d(g·ρ + β·u)/du, N·s/m, near the last slip speed.
    pub(crate) contact_slope: f64,
    /// λ of [`crate::creep`], 0 to 1.
    pub(crate) rise: f64,
    pub(crate) arms: ArmForces,
    /// θ of [`crate::dwell`], s.
    pub(crate) contact_age: f64,
    pub(crate) mode: Mode,
}

impl State {
    /// Deformation without any slip.
    #[inline(always)]
    pub(crate) fn stuck(deflection: f64, yield_force: f64, force: f64, arms: ArmForces) -> Self {
        Self {
            deflection,
            yield_force,
            force,
            slip_velocity: 0.0,
            contact_slope: 0.0,
            rise: 1.0,
            arms,
            contact_age: 0.0,
            mode: Mode::Deforming,
        }
    }

    /// z, m: deflection of the seal.
    pub fn deflection(&self) -> f64 {
        self.deflection
    }

    /// q, N: force beyond the mid curve, |q| <= h(z).
    pub fn yield_force(&self) -> f64 {
        self.yield_force
    }

    /// v_sl, m/s: velocity of the instrument against the seal at the end of the last step.
    pub fn slip_velocity(&self) -> f64 {
        self.slip_velocity
    }

    /// Σ a, N: part of the force that relaxes, [`Relaxation`].
    pub fn relaxing_force(&self) -> f64 {
        self.arms.iter().sum()
    }

    /// θ, s: how long the contact has rested, [`crate::dwell`]; 0 without friction after rest.
    pub fn contact_age(&self) -> f64 {
        self.contact_age
    }

    /// Takes over `next` unless a number grew beyond all bounds.
    #[inline(always)]
    pub(crate) fn commit(&mut self, next: Self) {
        if next.force.abs() <= f64::MAX && next.deflection.abs() <= f64::MAX {
            *self = next;
        }
    }

    /// Whether the seal deforms or slides.
    pub fn mode(&self) -> Mode {
        self.mode
    }
}

/// Whether the sliding force of one direction falls with the slip speed somewhere, damping
/// included. Where it does, one force belongs to several slip speeds: the friction law is
/// multivalued.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum VelocityWeakening {
    /// Nowhere: β + min dD/dż exceeds the steepest fall of g, and every force has one slip speed.
    None,
    /// Between these slip speeds (m/s) the sliding force falls with speed. Steady sliding is
    /// unstable there, and the seal sticks and slips.
    Between {
        /// Where the fall begins, m/s; 0 for a shape exponent of 1 or less.
        from: f64,
        /// Where the fall ends, m/s; infinite without any damping at high speed.
        to: f64,
    },
}

/// One EMS element: validated, immutable; many states may share it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Element {
    pub(crate) params: ElementParams,
    /// Sliding happens on the straight ends only, with constant friction and no damping: the step
    /// is exact.
    pub(crate) confined: bool,
    /// Slip without yielding: v_c > 0.
    pub(crate) creeps: bool,
    /// Smallest dF_e/dz over both branches and both ends, N/m.
    pub(crate) least_stiffness: f64,
    pub(crate) withdrawal: Contact,
    pub(crate) insertion: Contact,
}

/// What is known beforehand about sliding in one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Contact {
    pub(crate) weakening: VelocityWeakening,
    /// β + min dD/dż, N·s/m.
    pub(crate) damping: f64,
    /// max|g'|, N·s/m.
    pub(crate) steepest_fall: f64,
    /// Neither β nor σ: the force does not decide the slip speed.
    pub(crate) free: bool,
    /// |F_e| at the end of the deformation range, N, and its slope beyond, N/m.
    pub(crate) end_force: f64,
    pub(crate) end_stiffness: f64,
    /// K/β on that straight end, 1/s, and β/K, s; infinite and 0 without β.
    pub(crate) rate: f64,
    pub(crate) lag: f64,
}

/// The numbers of the element itself; those of the paper's element are in its parts.
impl Parameters for ElementParams {
    const FIELDS: &'static [Field<Self>] =
        fields![creep_velocity: CreepVelocity, friction_lag: FrictionLag, dwell_force: DwellForce];
}

impl ElementParams {
    /// (F_s⁺ + F_s⁻)/(2c), N/m: the slope of the chord between the sliding ends.
    pub fn mean_stiffness(&self) -> f64 {
        let limits = self.insertion.static_force + self.withdrawal.static_force;
        0.5 * limits / self.deformation.half_width()
    }

    /// The element of EMS without seal damping; its further terms are off.
    pub const fn new(
        deformation: DeformationForce,
        insertion: SlidingFriction,
        withdrawal: SlidingFriction,
    ) -> Self {
        Self {
            deformation,
            damping: SealDamping::ZERO,
            insertion,
            withdrawal,
            creep_velocity: 0.0,
            friction_lag: 0.0,
            dwell_force: 0.0,
            relaxation: Relaxation::NONE,
        }
    }

    /// Sliding friction in `direction`.
    pub fn sliding(&self, direction: Direction) -> &SlidingFriction {
        match direction {
            Direction::Insertion => &self.insertion,
            Direction::Withdrawal => &self.withdrawal,
        }
    }
}

impl Element {
    /// Checks the parameters and prepares the step.
    ///
    /// # Errors
    /// A value out of its range, or a branch that misses (-c, -F_s) or (+c, +F_s).
    pub fn new(params: ElementParams) -> Result<Self, ParamError> {
        params.insertion.check()?;
        params.withdrawal.check()?;
        params.damping.check()?;
        params.relaxation.check()?;
        check_fields(&params)?;
        if params.friction_lag > 0.0 && params.creep_velocity == 0.0 {
            return Err(ParamError::LagWithoutCreep { lag: params.friction_lag });
        }
        check_end_points(&params)?;
        let extremes = params.deformation.extremes();
        let constant = params.insertion.is_constant() && params.withdrawal.is_constant();
        let highest = (1.0 + PIN_TOLERANCE) * params.insertion.static_force;
        let lowest = -(1.0 + PIN_TOLERANCE) * params.withdrawal.static_force;
        Ok(Self {
            confined: constant
                && params.damping.is_zero()
                && params.relaxation.is_none()
                && params.creep_velocity == 0.0
                && params.dwell_force == 0.0
                && extremes.highest_force <= highest
                && extremes.lowest_force >= lowest,
            creeps: params.creep_velocity > 0.0,
            least_stiffness: extremes.least_slope,
            withdrawal: Contact::new(&params, Direction::Withdrawal)?,
            insertion: Contact::new(&params, Direction::Insertion)?,
            params,
        })
    }

    /// The parameters.
    pub fn params(&self) -> &ElementParams {
        &self.params
    }

    /// Velocity weakening of the sliding force, for insertion and for withdrawal.
    pub fn velocity_weakening(&self) -> (VelocityWeakening, VelocityWeakening) {
        (self.insertion.weakening, self.withdrawal.weakening)
    }

    /// State at rest with zero yield force at `deflection`, m. A deflection that is not finite
    /// counts as 0.
    pub fn rest_state(&self, deflection: f64) -> State {
        self.state(deflection, 0.0)
    }

    /// State at rest at `deflection` (m) with `yield_force` (N), the latter clamped to ±h. What is
    /// not finite counts as 0.
    pub fn state(&self, deflection: f64, yield_force: f64) -> State {
        let deflection = if deflection.is_finite() { deflection } else { 0.0 };
        let yield_force = if yield_force.is_finite() { yield_force } else { 0.0 };
        let (force, yield_force) =
            self.params.deformation.reach(deflection, yield_force, deflection);
        State::stuck(deflection, yield_force, force, [0.0; MAX_ARMS])
    }

    /// State at rest on the mid curve M that holds `force`, N.
    ///
    /// Of several deflections with that force (a seal that snaps through has three) the one of
    /// least amount; beyond the sliding limits the nearer end. A force that is not finite counts as
    /// 0.
    pub fn rest_at_force(&self, force: f64) -> State {
        const CELLS: i32 = 200;
        let force = if force.is_finite() { force } else { 0.0 };
        let c = self.params.deformation.half_width();
        let at = |k: f64| c * k / f64::from(CELLS);
        let excess = |z: f64| self.params.deformation.mid(z) - force;
        let ends = |k: i32| (at(f64::from(k)), at(f64::from(k) + 1.0));
        let brackets = (-CELLS..CELLS).filter(|k| excess(ends(*k).0) * excess(ends(*k).1) <= 0.0);
        // The cell nearest to 0: -1 - k is !k, which cannot overflow.
        let Some(cell) = brackets.min_by_key(|k| if *k < 0 { !k } else { *k }) else {
            return self.rest_state(if force > 0.0 { c } else { -c });
        };
        let (mut low, mut high) = ends(cell);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if excess(low) * excess(middle) <= 0.0 { high = middle } else { low = middle }
        }
        self.rest_state(0.5 * (low + high))
    }

    /// State at rest after a slide in `direction` that holds `force`, N: the seal let go at the end of
    /// the branch and has moved back from there, up to the first deflection with that force, or up to
    /// the other end. A greater force than that of the end lies on the slope beyond. A force that is not
    /// finite counts as 0.
    pub fn rest_after(&self, direction: Direction, force: f64) -> State {
        const CELLS: i32 = 400;
        let force = if force.is_finite() { force } else { 0.0 };
        let (s, deformation) = (direction.sign(), &self.params.deformation);
        let end = s * deformation.half_width();
        let at = |k: i32| end * (1.0 - 2.0 * f64::from(k) / f64::from(CELLS));
        let back = |z: f64| deformation.reach(end, 0.0, z);
        let excess = |z: f64| s * (back(z).0 - force);
        let stays = |z: f64| self.state(z, back(z).1);
        if excess(end) < 0.0 {
            let (_, slope) = deformation.end(s > 0.0);
            return stays(if slope > 0.0 { end - excess(end) * s / slope } else { end });
        }
        let Some(cell) = (0..CELLS).find(|k| excess(at(*k + 1)) < 0.0) else {
            return stays(-end);
        };
        stays(boundary(|z| excess(z) >= 0.0, at(cell), at(cell + 1)))
    }

    /// Advances `state` by `displacement` (m) within `duration` (s) at constant velocity; returns
    /// the force (N) at the end.
    ///
    /// Any size of step is allowed. A duration that is not positive, or a displacement, duration or
    /// velocity that is not finite, leaves the state untouched and returns the last force.
    ///
    /// After a step the law of the contact holds to 2e-9 of the forces, |F| <= F_max =
    /// max(F_s + β·v + D(2v), max|F_e|) with v the greatest speed so far, and |ΔF| <= (max|F_e'| +
    /// κ)·|Δx| + D'(2v)·|Δv| + F_max - F_c: the last part is what one change between deforming and
    /// sliding can release. Relaxing arms add their stiffness and force; creep gives way in time.
    /// Friction after rest raises F_s and F_c by ΔF·ln(1 + θ/t_0), [`crate::dwell`].
    pub fn step(&self, state: &mut State, displacement: f64, duration: f64) -> f64 {
        if let Some(velocity) = velocity(displacement, duration) {
            // Two commits, so that the exact step stays in registers.
            if self.confined {
                state.commit(self.advance_confined(state, velocity, duration));
            } else {
                state.commit(self.advance_in_parts(state, velocity, duration));
            }
        }
        state.force
    }

    /// The general step in parts of at most c/8 of travel, so that the order of yielding and
    /// snapping through is kept.
    ///
    /// Past [`EVEN_PARTS`] such parts the seal slides for good, and the rest is divided evenly: the
    /// work is bounded.
    fn advance_in_parts(&self, state: &State, velocity: f64, duration: f64) -> State {
        let mut state = *state;
        self.each_part(velocity, duration, |time| {
            state = if self.params.dwell_force > 0.0 {
                self.advance_ageing(&state, velocity, time)
            } else {
                self.advance_general(&state, velocity, time)
            }
        });
        state
    }

    /// Calls `advance` with the duration of each part.
    #[inline(always)]
    pub(crate) fn each_part(&self, velocity: f64, duration: f64, mut advance: impl FnMut(f64)) {
        let stride = LONGEST_PART * self.params.deformation.half_width();
        let travel = velocity.abs() * duration;
        if travel <= stride {
            return advance(duration);
        }
        let strides = travel / stride;
        let mut all =
            |count: u32, time: f64| (0..count).for_each(|_| advance(time / f64::from(count)));
        if strides <= f64::from(EVEN_PARTS) {
            all(libm::ceil(strides) as u32, duration);
        } else {
            let first = duration * f64::from(EVEN_PARTS) / strides;
            all(EVEN_PARTS, first);
            all(EVEN_PARTS, duration - first);
        }
    }

    /// Advances `state` at constant `velocity` (m/s) for `duration` (s); returns the force (N) at
    /// the end.
    pub fn step_velocity(&self, state: &mut State, velocity: f64, duration: f64) -> f64 {
        self.step(state, velocity * duration, duration)
    }

    /// β·v_sl, N: the part of the force that grows with the slip speed, EMS (11).
    pub fn viscous_force(&self, state: &State) -> f64 {
        self.sliding(Direction::of(state.slip_velocity)).viscous_damping * state.slip_velocity
    }

    pub(crate) fn sliding(&self, direction: Direction) -> &SlidingFriction {
        self.params.sliding(direction)
    }

    /// The contact at slip speed `u` >= 0, m/s.
    #[inline(always)]
    pub(crate) fn resistance(&self, direction: Direction, rise: Rise, u: f64) -> Resistance {
        resistance(self.sliding(direction), self.params.creep_velocity, rise, u)
    }

    fn contact(&self, direction: Direction) -> &Contact {
        match direction {
            Direction::Withdrawal => &self.withdrawal,
            Direction::Insertion => &self.insertion,
        }
    }

    /// Whether one force may belong to several slip speeds when `now` of a change of g shows within
    /// the step.
    pub(crate) fn is_multivalued(&self, direction: Direction, now: f64) -> bool {
        self.contact(direction).weakening != VelocityWeakening::None
            && self.least_drag(direction, now) <= 0.0
    }

    /// β + min dD/dż - `now`·max|g'|, N·s/m: above zero the slip speed is unique in continuous
    /// time.
    pub(crate) fn least_drag(&self, direction: Direction, now: f64) -> f64 {
        let Contact { damping, steepest_fall, .. } = *self.contact(direction);
        if now > 0.0 { damping - now * steepest_fall } else { damping }
    }

    pub(crate) fn is_free(&self, direction: Direction) -> bool {
        self.contact(direction).free
    }

    /// The exact solution at constant velocity when sliding only happens on the straight ends.
    #[inline(always)]
    fn advance_confined(&self, state: &State, velocity: f64, mut time: f64) -> State {
        let c = self.params.deformation.half_width();
        let mut z = state.deflection;
        let mut q = state.yield_force;
        // Each side is a branch of its own: a choice by data would put the exponential between one
        // step and the next.
        if z > c {
            let (next, left) = self.slide_on_end(Direction::Insertion, z - c, velocity, time);
            if left <= 0.0 {
                return next;
            }
            (z, q, time) = (c, 0.0, left);
        } else if z < -c {
            let (next, left) = self.slide_on_end(Direction::Withdrawal, -z - c, velocity, time);
            if left <= 0.0 {
                return next;
            }
            (z, q, time) = (-c, 0.0, left);
        }
        let target = z + velocity * time;
        if target > c {
            return self
                .slide_on_end(Direction::Insertion, 0.0, velocity, (target - c) / velocity)
                .0;
        }
        if target < -c {
            return self
                .slide_on_end(Direction::Withdrawal, 0.0, velocity, (target + c) / velocity)
                .0;
        }
        let (force, yield_force) = self.params.deformation.reach(z, q, target);
        State::stuck(target, yield_force, force, state.arms)
    }

    /// Slides for at most `time` beyond an end, from `excess` = |z| - c; gives the state and the
    /// time left.
    #[inline(always)]
    fn slide_on_end(
        &self,
        direction: Direction,
        excess: f64,
        velocity: f64,
        time: f64,
    ) -> (State, f64) {
        let deformation = &self.params.deformation;
        let Contact { end_force, end_stiffness, rate, lag, .. } = *self.contact(direction);
        let s = direction.sign();
        // (20) on a straight spring: the excess relaxes towards β·v_d/K with the rate K/β.
        let settled = lag * s * velocity;
        let end = settled + (excess - settled) * decay(rate * time);
        let mut left = 0.0;
        if end < 0.0 || (end <= 0.0 && s * velocity < 0.0) {
            let reached = if settled < 0.0 { lag * libm::log1p(-excess / settled) } else { 0.0 };
            left = time - reached;
        }
        let end = end.max(0.0);
        let slip_velocity = if lag > 0.0 { s * rate * end } else { velocity };
        let state = State {
            deflection: s * (deformation.half_width() + end),
            yield_force: 0.0,
            force: s * (end_force + end_stiffness * end),
            slip_velocity,
            contact_slope: 0.0,
            rise: 1.0,
            arms: [0.0; MAX_ARMS],
            contact_age: 0.0,
            mode: if slip_velocity == 0.0 { Mode::Deforming } else { Mode::Sliding },
        };
        (state, left)
    }
}

friction!(
    Element,
    State,
    fn rest_after(&self, direction: Direction, force: f64) -> State {
        Element::rest_after(self, direction, force)
    }
);

/// Both branches must end where sliding begins: (-c, -F_s) and (+c, +F_s).
fn check_end_points(params: &ElementParams) -> Result<(), ParamError> {
    let c = params.deformation.half_width();
    let ends = [(-c, -params.withdrawal.static_force), (c, params.insertion.static_force)];
    for (deflection, expected) in ends {
        for branch in [params.deformation.insertion(), params.deformation.withdrawal()] {
            let force = branch.force(deflection);
            if (force - expected).abs() > PIN_TOLERANCE * expected.abs() {
                return Err(ParamError::EndPointConstraint { deflection, force, expected });
            }
        }
    }
    Ok(())
}

impl Contact {
    fn new(params: &ElementParams, direction: Direction) -> Result<Self, ParamError> {
        let (sliding, damping) = (params.sliding(direction), &params.damping);
        let free = sliding.viscous_damping == 0.0 && damping.is_zero();
        if free && !sliding.is_constant() {
            return Err(ParamError::UndampedBreakaway {
                static_force: sliding.static_force,
                coulomb_force: sliding.coulomb_force,
            });
        }
        let (end_force, end_stiffness) = params.deformation.end(direction == Direction::Insertion);
        let rate = end_stiffness / sliding.viscous_damping;
        Ok(Self {
            weakening: weakening(sliding, params.creep_velocity, damping.least_slope()),
            damping: sliding.viscous_damping + damping.least_slope(),
            steepest_fall: sliding.steepest_fall(),
            free,
            end_force: direction.sign() * end_force,
            end_stiffness,
            rate,
            lag: if rate.is_finite() { sliding.viscous_damping / end_stiffness } else { 0.0 },
        })
    }
}

/// Stationary points of H(u) = g(u)·ρ(u) + b·u with b = β + min dD/dż.
fn weakening(
    sliding: &SlidingFriction,
    creep_velocity: f64,
    least_damping: f64,
) -> VelocityWeakening {
    let b = sliding.viscous_damping + least_damping;
    if b > sliding.steepest_fall() || sliding.is_constant() {
        return VelocityWeakening::None;
    }
    let steepest = sliding.steepest_speed();
    let falls =
        |u: f64| resistance(sliding, creep_velocity, Rise::INSTANT, u).slope + least_damping < 0.0;
    let Some(inside) = first_fall(falls, steepest.max(creep_velocity), sliding.stribeck_velocity)
    else {
        return VelocityWeakening::None;
    };
    let from = if inside > 0.0 { boundary(falls, inside, 0.0) } else { 0.0 };
    if b == 0.0 {
        return VelocityWeakening::Between { from, to: f64::INFINITY };
    }
    let mut beyond = inside + sliding.stribeck_velocity;
    for _ in 0..1000 {
        if !falls(beyond) {
            break;
        }
        beyond *= 2.0;
    }
    VelocityWeakening::Between { from, to: boundary(falls, inside, beyond) }
}

/// A slip speed at which the force falls with speed, from the steepest of g upwards: creep may fill
/// the fall in.
fn first_fall(falls: impl Fn(f64) -> bool, steepest: f64, stribeck_velocity: f64) -> Option<f64> {
    const CELLS: u32 = 40;
    (0..=CELLS).map(|k| steepest + 0.1 * f64::from(k) * stribeck_velocity).find(|u| falls(*u))
}

/// Where `holds` changes between `yes` and `no`, by bisection.
fn boundary(holds: impl Fn(f64) -> bool, mut yes: f64, mut no: f64) -> f64 {
    for _ in 0..100 {
        let middle = 0.5 * (yes + no);
        if holds(middle) {
            yes = middle;
        } else {
            no = middle;
        }
    }
    0.5 * (yes + no)
}
