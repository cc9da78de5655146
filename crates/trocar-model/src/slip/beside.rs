//! First-order differences between elements that differ little and one that leads: derivatives of
//! the force, without steps of their own.
//!
//! The step of the leader solves r(u; state, θ) = 0. Differentiated where it arrives,
//!
//! ```text
//! δu = -(∂r/∂state·δstate + δ_θ r)/(dr/du)        δ_θ: by the parameters at fixed state
//! ```
//!
//! and the same at the start of a slide, where seal damping gives the slip speed a jump with the
//! velocity. All that depends on the leader alone is found once a step ([`Course`]). Where it
//! yields, turns or comes to rest a follower takes the step by itself. The weight θ of the step, which decides its order of accuracy, is the
//! leader's.

use super::Motion;
use crate::creep::{Resistance, Rise, resistance_at};
use crate::direction::Direction;
use crate::elastic::{DeflectionLocation, DeformationForce, ShapeDifference};
use crate::ems::{Element, ElementParams, State};
use crate::exponential::{decay, decay_and_mean, logarithm};
use crate::friction::velocity;
use crate::relaxation::MAX_ARMS;
use crate::sliding::SlidingFriction;

/// Models of which one [`Beside`] follows.
pub const BESIDE: usize = 8;

/// One number for each model.
type Each<const N: usize> = [f64; N];

#[inline(always)]
fn each<const N: usize>(of: impl Fn(usize) -> f64) -> Each<N> {
    core::array::from_fn(of)
}

/// How states differ from the leader's.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Apart<const N: usize> {
    deflection: Each<N>,
    yield_force: Each<N>,
    arms: [Each<N>; MAX_ARMS],
    /// Of the force without seal damping, N.
    elastic: Each<N>,
    slip_velocity: Each<N>,
    rise: Each<N>,
    contact_age: Each<N>,
    pub(crate) force: Each<N>,
}

impl<const N: usize> Apart<N> {
    pub(crate) const SAME: Self = Self {
        deflection: [0.0; N],
        yield_force: [0.0; N],
        arms: [[0.0; N]; MAX_ARMS],
        elastic: [0.0; N],
        slip_velocity: [0.0; N],
        rise: [0.0; N],
        contact_age: [0.0; N],
        force: [0.0; N],
    };

    /// How `its` state of `other` differs from `state` of `own`.
    fn set(
        &mut self,
        i: usize,
        (own, state): (&Element, &State),
        (other, its): (&Element, &State),
    ) {
        let elastic = |e: &Element, s: &State| {
            e.params.deformation.mid_and_gap(s.deflection).0 + s.yield_force + s.relaxing_force()
        };
        self.deflection[i] = its.deflection - state.deflection;
        self.yield_force[i] = its.yield_force - state.yield_force;
        for ((more, b), a) in self.arms.iter_mut().zip(its.arms).zip(state.arms) {
            more[i] = b - a;
        }
        self.elastic[i] = elastic(other, its) - elastic(own, state);
        self.slip_velocity[i] = its.slip_velocity - state.slip_velocity;
        self.rise[i] = its.rise - state.rise;
        self.contact_age[i] = its.contact_age - state.contact_age;
        self.force[i] = its.force - state.force;
    }

    /// The state that differs so from `led`.
    fn state(&self, i: usize, led: &State) -> State {
        let mut state = *led;
        state.deflection += self.deflection[i];
        state.yield_force += self.yield_force[i];
        state.arms.iter_mut().zip(&self.arms).for_each(|(a, more)| *a += more[i]);
        state.slip_velocity += self.slip_velocity[i];
        state.rise += self.rise[i];
        state.contact_age += self.contact_age[i];
        state.force += self.force[i];
        state
    }
}

/// By how much M, h (N) and κ (N/m) exceed the leader's where it arrives.
#[derive(Clone, Copy, Debug)]
struct MoreForce<const N: usize> {
    mid: Each<N>,
    gap: Each<N>,
    yield_stiffness: Each<N>,
}

impl<const N: usize> MoreForce<N> {
    const NONE: Self = Self { mid: [0.0; N], gap: [0.0; N], yield_stiffness: [0.0; N] };
}

/// How parameters differ from the leader's; what is the same in all models costs nothing.
#[derive(Clone, Copy, Debug)]
struct Different<const N: usize> {
    shape: Option<ShapeDifference<N>>,
    /// σ_k.
    damping: Option<[Each<N>; 3]>,
    contact: Option<ContactDifference<N>>,
    /// E and τ of each arm.
    arms: Option<[[Each<N>; 2]; MAX_ARMS]>,
    /// Some model has what the leader lacks altogether, or lacks what it has.
    is_another: bool,
}

#[derive(Clone, Copy, Debug)]
struct ContactDifference<const N: usize> {
    /// For withdrawal and insertion.
    sliding: [SlidingDifference<N>; 2],
    creep_velocity: Each<N>,
    friction_lag: Each<N>,
}

#[derive(Clone, Copy, Debug)]
struct SlidingDifference<const N: usize> {
    coulomb_force: Each<N>,
    static_force: Each<N>,
    stribeck_velocity: Each<N>,
    stribeck_exponent: Each<N>,
    viscous_damping: Each<N>,
}

impl<const N: usize> SlidingDifference<N> {
    fn set(&mut self, i: usize, own: &SlidingFriction, other: &SlidingFriction) {
        self.coulomb_force[i] = other.coulomb_force - own.coulomb_force;
        self.static_force[i] = other.static_force - own.static_force;
        self.stribeck_velocity[i] = other.stribeck_velocity - own.stribeck_velocity;
        self.stribeck_exponent[i] = other.stribeck_exponent - own.stribeck_exponent;
        self.viscous_damping[i] = other.viscous_damping - own.viscous_damping;
    }
}

impl<const N: usize> ContactDifference<N> {
    const NONE: Self = Self {
        sliding: [SlidingDifference {
            coulomb_force: [0.0; N],
            static_force: [0.0; N],
            stribeck_velocity: [0.0; N],
            stribeck_exponent: [0.0; N],
            viscous_damping: [0.0; N],
        }; 2],
        creep_velocity: [0.0; N],
        friction_lag: [0.0; N],
    };
}

impl<const N: usize> Different<N> {
    const NONE: Self =
        Self { shape: None, damping: None, contact: None, arms: None, is_another: false };

    /// What `other` has more than `own`.
    fn set(&mut self, i: usize, own: &Element, other: &Element) {
        let is_another = own.creeps != other.creeps;
        let (own, other) = (&own.params, &other.params);
        // Age is not followed to first order.
        let ages = own.dwell_force > 0.0 || other.dwell_force > 0.0;
        self.is_another |=
            is_another || ages || (own.friction_lag > 0.0) != (other.friction_lag > 0.0);
        if own.deformation != other.deformation {
            let shape = self.shape.get_or_insert(ShapeDifference::NONE);
            shape.set(i, &own.deformation, &other.deformation);
        }
        if own.damping != other.damping {
            let all = self.damping.get_or_insert([[0.0; N]; 3]);
            let coefficients = own.damping.coefficients.iter().zip(other.damping.coefficients);
            all.iter_mut().zip(coefficients).for_each(|(more, (a, b))| more[i] = b - a);
        }
        let contact =
            |p: &ElementParams| (p.withdrawal, p.insertion, p.creep_velocity, p.friction_lag);
        if contact(own) != contact(other) {
            let all = self.contact.get_or_insert(ContactDifference::NONE);
            all.sliding[0].set(i, &own.withdrawal, &other.withdrawal);
            all.sliding[1].set(i, &own.insertion, &other.insertion);
            all.creep_velocity[i] = other.creep_velocity - own.creep_velocity;
            all.friction_lag[i] = other.friction_lag - own.friction_lag;
        }
        if own.relaxation != other.relaxation {
            let all = self.arms.get_or_insert([[[0.0; N]; 2]; MAX_ARMS]);
            let arms = own.relaxation.arms.iter().zip(&other.relaxation.arms);
            for ([stiffness, time], (a, b)) in all.iter_mut().zip(arms) {
                (stiffness[i], time[i]) = (b.stiffness - a.stiffness, b.time - a.time);
                self.is_another |= (a.stiffness > 0.0) != (b.stiffness > 0.0);
            }
        }
    }

    /// Difference of D at fixed deformation velocity, N.
    #[inline(always)]
    fn damping_force(&self, deformation_velocity: f64) -> Each<N> {
        let Some([s0, s1, s2]) = &self.damping else { return [0.0; N] };
        let speed = deformation_velocity.abs();
        each(|i| (s0[i] + speed * (s1[i] + speed * s2[i])) * deformation_velocity) // EMS (9)
    }
}

/// Up to [`BESIDE`] elements that differ little from one that leads, and how their states differ
/// from its; see [`Stages::lead`](crate::Stages::lead).
#[derive(Clone, Debug)]
pub struct Beside<'a> {
    /// Place of the leader among its stages.
    pub(crate) stage: usize,
    /// The places past the last repeat it.
    elements: [&'a Element; BESIDE],
    different: Different<BESIDE>,
    apart: Apart<BESIDE>,
}

impl<'a> Beside<'a> {
    /// `None` for no element.
    pub(crate) fn new(
        stage: usize,
        leader: (&Element, &State),
        others: impl Iterator<Item = (&'a Element, State)> + Clone,
    ) -> Option<Self> {
        let last = others.clone().take(BESIDE).last()?;
        let mut beside = Self {
            stage,
            elements: [last.0; BESIDE],
            different: Different::NONE,
            apart: Apart::SAME,
        };
        let all = others.chain(core::iter::repeat(last));
        for (i, ((element, its), own)) in all.zip(&mut beside.elements).enumerate() {
            *own = element;
            beside.different.set(i, leader.0, element);
            beside.apart.set(i, leader, (element, &its));
        }
        Some(beside)
    }

    /// By how much the forces exceed that of the leader, N.
    pub fn forces(&self) -> &[f64; BESIDE] {
        &self.apart.force
    }

    /// Takes the same part of a step as the leader; one of another stage than its own is none.
    #[inline(always)]
    pub fn follow(&mut self, lead: &Lead) {
        if lead.stage == self.stage {
            lead.take(self);
        }
    }

    /// State of element `i`, where the leader is in `led`.
    pub(crate) fn state(&self, i: usize, led: &State) -> State {
        self.apart.state(i, led)
    }
}

/// One ordinate of the deformation force, and how the state of an element differs in which it is
/// a little higher.
#[derive(Clone, Copy, Debug)]
pub struct Ordinate {
    place: OrdinatePlace,
    is_awake: bool,
    apart: Apart<1>,
}

#[derive(Clone, Copy, Debug)]
enum OrdinatePlace {
    /// Force of a branch at `at`, m, falling to 0 over `spacing`, m, on both sides.
    Node { direction: Direction, at: f64, spacing: f64 },
    /// Slope beyond c at `end`, m: c or -c.
    Slope { end: f64 },
}

impl Ordinate {
    /// Height, N, or N/m, of the change that is followed: far below all forces, so that it is
    /// followed to first order.
    const UNIT: f64 = 1e-9;

    /// The force of the branch in `direction` at deflection `at`, between neighbours at a distance
    /// of `spacing`, m.
    pub fn node(direction: Direction, at: f64, spacing: f64) -> Self {
        Self::new(OrdinatePlace::Node { direction, at, spacing })
    }

    /// The slope beyond the end of [-c, c] at `end`, m.
    pub fn end_slope(end: f64) -> Self {
        Self::new(OrdinatePlace::Slope { end })
    }

    fn new(place: OrdinatePlace) -> Self {
        Self { place, is_awake: false, apart: Apart::SAME }
    }

    /// Derivative of the force: by a force of a branch 1, by a slope m.
    pub fn derivative(&self) -> f64 {
        self.apart.force[0] / Self::UNIT
    }

    /// By how much M and h are higher at deflection `z`, m.
    #[inline(always)]
    fn more(&self, z: f64) -> MoreForce<1> {
        let (mid, gap) = match self.place {
            OrdinatePlace::Node { direction, at, spacing } => {
                let half = 0.5 * (1.0 - (z - at).abs() / spacing).max(0.0);
                (half, direction.sign() * half)
            }
            OrdinatePlace::Slope { end } if z.abs() > end.abs() && z * end > 0.0 => (z - end, 0.0),
            OrdinatePlace::Slope { .. } => (0.0, 0.0),
        };
        MoreForce { mid: [Self::UNIT * mid], gap: [Self::UNIT * gap], yield_stiffness: [0.0] }
    }
}

impl Apart<1> {
    /// Whether a change of an ordinate by [`Ordinate::UNIT`] is still in the state.
    fn is_felt(&self) -> bool {
        const FAINT: f64 = 1e-7 * Ordinate::UNIT;
        // A deflection bears on the force by a stiffness, of which little is known here: 100 N/m.
        let felt =
            [100.0 * self.deflection[0], self.elastic[0], self.yield_force[0], self.force[0]];
        felt.iter().chain(self.arms.as_flattened()).any(|force| force.abs() > FAINT)
    }
}

/// One part of a leader's step, for those beside it; see [`Stages::lead`](crate::Stages::lead).
pub struct Lead<'a> {
    /// Place of the leader among its stages.
    pub(crate) stage: usize,
    leader: &'a Element,
    before: State,
    after: State,
    motion: Motion,
    /// `None` where it yielded, turned or came to rest.
    course: Option<Course>,
}

/// How the leader moved.
struct Course {
    deforming: Deforming,
    /// `None` where it deformed without slip.
    slide: Option<Slide>,
}

/// The deformation force where the leader arrives.
struct Deforming {
    location: DeflectionLocation,
    /// z⁺ - z, m.
    travel: f64,
    /// dM/dz and dq/dz there, N/m; the latter is ±h' where q follows ±h, and κ elsewhere.
    mid_slope: f64,
    yield_slope: f64,
    /// Of h in q: ±1 where q follows ±h, 0 elsewhere.
    follows: f64,
    /// Σ of the arms' response, N/m.
    arm_stiffness: f64,
    arm_slopes: [ArmSlopes; MAX_ARMS],
}

/// Derivatives of an arm's step.
#[derive(Clone, Copy, Default)]
struct ArmSlopes {
    /// Of what is left of a, and the response to a change of z: by a, E and τ.
    left: f64,
    left_by_time: f64,
    response: f64,
    response_by_stiffness: f64,
    response_by_time: f64,
}

/// A slide from slip speed `start.speed` to `end.speed`.
struct Slide {
    direction: Direction,
    /// s·dt·(1 - θ) and s·dt·θ, s.
    explicit: f64,
    implicit: f64,
    start: At,
    end: At,
    lag: LagSlopes,
    /// -dr/du at the start and at the end, N·s/m.
    start_drag: f64,
    end_drag: f64,
    /// Whether seal damping makes the slip speed jump with the velocity.
    is_damped: bool,
}

/// The contact at one slip speed with its derivatives.
struct At {
    speed: f64,
    /// v_d, m/s.
    deformation_velocity: f64,
    /// dD/dż, N·s/m.
    damping_slope: f64,
    /// ρ, and g·∂ρ/∂v_c, N·s/m.
    part: f64,
    by_creep: f64,
    /// λ, and F_s - F_c, N.
    rise: f64,
    surplus: f64,
    /// e = exp(-(u/v_s)^δ) and its derivatives by u, v_s and δ.
    curve: f64,
    curve_by_speed: f64,
    curve_by_velocity: f64,
    curve_by_exponent: f64,
}

/// λ⁺ = λ·left + e_0·(mean - left) + e·now, and its derivative by T at fixed e.
struct LagSlopes {
    is_lagged: bool,
    left: f64,
    before: f64,
    now: f64,
    by_lag: f64,
}

impl Element {
    /// As [`Element::step`], part by part: after each `follow` may take others along. The element is
    /// `stage` of a seal.
    pub(crate) fn lead<'a>(
        &'a self,
        stage: usize,
        state: &mut State,
        (displacement, duration): (f64, f64),
        mut follow: impl FnMut(Lead<'a>),
    ) {
        let Some(velocity) = velocity(displacement, duration) else { return };
        let mut part = |time: f64| {
            let motion = Motion { velocity, time };
            let before = *state;
            let course = if self.confined {
                self.step(state, displacement, duration);
                None
            } else {
                self.advance_on_course(state, motion)
            };
            follow(Lead { stage, leader: self, before, after: *state, motion, course });
        };
        if self.confined { part(duration) } else { self.each_part(velocity, duration, part) }
    }

    /// With friction after rest, [`crate::dwell`].
    fn advance_on_course(&self, state: &mut State, motion: Motion) -> Option<Course> {
        if self.params.dwell_force == 0.0 {
            return self.advance_unaged(state, motion);
        }
        let before = *state;
        let aged = self.aged(&before, before.slip_velocity.abs(), motion.time);
        let course = aged.advance_unaged(state, motion);
        let slip = motion.velocity * motion.time - (state.deflection - before.deflection);
        *state = self.with_age(&before, *state, slip.abs(), motion.time);
        course
    }

    fn advance_unaged(&self, state: &mut State, motion: Motion) -> Option<Course> {
        let before = *state;
        if before.slip_velocity == 0.0 && !self.creeps {
            state.commit(self.leave_stick(&before, motion));
            if state.slip_velocity != 0.0 {
                return None;
            }
            return Some(Course { deforming: self.deforming(&before, state, motion), slide: None });
        }
        let onset = self.sliding_on(&before, motion.velocity);
        if onset.speed <= 0.0 {
            state.commit(self.keep_sliding(&before, motion));
            return None;
        }
        let (next, theta) = self.slide_by_theta(onset, motion);
        state.commit(next);
        if state.slip_velocity * before.slip_velocity <= 0.0 {
            return None;
        }
        Some(self.slid(&before, state, motion, onset.speed, theta))
    }

    fn deforming(&self, before: &State, after: &State, motion: Motion) -> Deforming {
        let deformation = &self.params.deformation;
        let local = deformation.local(after.deflection);
        let travel = after.deflection - before.deflection;
        let trial = before.yield_force + deformation.yield_stiffness() * travel;
        let follows = if trial > local.gap {
            1.0
        } else if trial < -local.gap {
            -1.0
        } else {
            0.0
        };
        let yield_slope =
            if follows == 0.0 { deformation.yield_stiffness() } else { follows * local.gap_slope };
        let mut arm_slopes = [ArmSlopes::default(); MAX_ARMS];
        for (slopes, arm) in arm_slopes.iter_mut().zip(&self.params.relaxation.arms) {
            if arm.stiffness > 0.0 {
                let (left, mean) = decay_and_mean(motion.time / arm.time);
                *slopes = ArmSlopes {
                    left,
                    left_by_time: left * motion.time / (arm.time * arm.time),
                    response: arm.stiffness * mean,
                    response_by_stiffness: mean,
                    response_by_time: arm.stiffness * (mean - left) / arm.time,
                };
            }
        }
        let arm_stiffness = arm_slopes.iter().map(|arm| arm.response).sum();
        let location = deformation.locate(after.deflection);
        Deforming {
            location,
            travel,
            mid_slope: local.mid_slope,
            yield_slope,
            follows,
            arm_stiffness,
            arm_slopes,
        }
    }

    fn slid(
        &self,
        before: &State,
        after: &State,
        motion: Motion,
        speed: f64,
        theta: f64,
    ) -> Course {
        let (direction, lag) = (Direction::of(after.slip_velocity), self.params.friction_lag);
        let deforming = self.deforming(before, after, motion);
        let (start, start_contact) =
            self.contact_at(direction, motion.velocity, speed, Rise::at_start(before.rise, lag));
        let lagged = Rise::after(before.rise, lag, motion.time, || start.curve);
        let (end, end_contact) =
            self.contact_at(direction, motion.velocity, after.slip_velocity.abs(), lagged);
        let steep = deforming.mid_slope + deforming.yield_slope + deforming.arm_stiffness;
        let slide = Slide {
            direction,
            explicit: direction.sign() * motion.time * (1.0 - theta),
            implicit: direction.sign() * motion.time * theta,
            start_drag: start_contact.slope + start.damping_slope,
            end_drag: end_contact.slope + end.damping_slope + motion.time * theta * steep,
            lag: LagSlopes::new(before.rise, lag, motion.time, &start, &end),
            is_damped: !self.params.damping.is_zero(),
            start,
            end,
        };
        Course { deforming, slide: Some(slide) }
    }

    /// The contact at slip speed `u`, m/s, with the part of λ that `rise` tells.
    fn contact_at(
        &self,
        direction: Direction,
        velocity: f64,
        u: f64,
        rise: Rise,
    ) -> (At, Resistance) {
        let (sliding, creep) = (self.sliding(direction), self.params.creep_velocity);
        let surplus = sliding.static_force - sliding.coulomb_force;
        let ratio = u / sliding.stribeck_velocity;
        let logarithm = if surplus > 0.0 && ratio > 0.0 { logarithm(ratio) } else { 0.0 };
        let exponent = sliding.exponent(u);
        let curve = decay(exponent);
        let growth = curve * exponent * sliding.stribeck_exponent; // -u·de/du
        let by_speed = if u > 0.0 { -growth / u } else { 0.0 };
        let contact = resistance_at(
            sliding,
            creep,
            rise,
            u,
            (
                sliding.coulomb_force + surplus * curve,
                if surplus > 0.0 { surplus * by_speed } else { 0.0 },
            ),
        );
        let risen = rise.kept + rise.now * curve;
        let level = sliding.coulomb_force + surplus * risen;
        let (part, by_creep) = if creep > 0.0 {
            let inverse = 1.0 / libm::sqrt(u * u + creep * creep);
            (u * inverse, -level * u * creep * inverse * (inverse * inverse))
        } else {
            (1.0, 0.0)
        };
        let deformation_velocity = velocity - direction.sign() * u; // EMS (8)
        let at = At {
            speed: u,
            deformation_velocity,
            damping_slope: self.params.damping.slope(deformation_velocity),
            part,
            by_creep,
            rise: risen,
            surplus,
            curve,
            curve_by_speed: by_speed,
            curve_by_velocity: growth / sliding.stribeck_velocity,
            curve_by_exponent: -curve * exponent * logarithm,
        };
        (at, contact)
    }
}

impl LagSlopes {
    fn new(rise: f64, lag: f64, duration: f64, start: &At, end: &At) -> Self {
        if lag <= 0.0 {
            return Self { is_lagged: false, left: 0.0, before: 0.0, now: 1.0, by_lag: 0.0 };
        }
        let (left, mean) = decay_and_mean(duration / lag);
        let left_by_lag = left * duration / (lag * lag);
        let mean_by_lag = (mean - left) / lag;
        let by_lag = rise * left_by_lag + (mean_by_lag - left_by_lag) * start.curve
            - mean_by_lag * end.curve;
        Self { is_lagged: true, left, before: mean - left, now: 1.0 - mean, by_lag }
    }
}

impl At {
    /// δe at fixed slip speed.
    #[inline(always)]
    fn curve_apart<const N: usize>(&self, by: &SlidingDifference<N>) -> Each<N> {
        each(|i| {
            self.curve_by_velocity * by.stribeck_velocity[i]
                + self.curve_by_exponent * by.stribeck_exponent[i]
        })
    }

    /// Difference of the contact's force at fixed slip speed, where λ differs by `rise`, N, and the
    /// parameters `by` that.
    #[inline(always)]
    fn contact_apart<const N: usize>(
        &self,
        creep_velocity: &Each<N>,
        by: Option<&SlidingDifference<N>>,
        rise: &Each<N>,
    ) -> Each<N> {
        let Some(by) = by else { return each(|i| self.part * (self.surplus * rise[i])) };
        each(|i| {
            let level = by.coulomb_force[i]
                + self.rise * (by.static_force[i] - by.coulomb_force[i])
                + self.surplus * rise[i];
            self.part * level
                + self.by_creep * creep_velocity[i]
                + by.viscous_damping[i] * self.speed
        })
    }
}

impl Deforming {
    #[inline(always)]
    fn more<const N: usize>(
        &self,
        own: &DeformationForce,
        different: &Different<N>,
    ) -> MoreForce<N> {
        let Some(shape) = &different.shape else { return MoreForce::NONE };
        let [mid, gap] = own.more_at(shape, &self.location);
        MoreForce { mid, gap, yield_stiffness: shape.yield_stiffness }
    }

    fn is_clipped(&self) -> bool {
        matches!(self.location, DeflectionLocation::Within { clipped: true, .. })
    }

    /// The deformation where z⁺ differs by `deflection`, m; the slip is not yet in it.
    #[inline(always)]
    fn apart<const N: usize>(
        &self,
        before: &State,
        different: &Different<N>,
        more: &MoreForce<N>,
        apart: &Apart<N>,
        deflection: Each<N>,
    ) -> Apart<N> {
        let MoreForce { mid, gap, yield_stiffness } = more;
        let yield_force = if self.follows == 0.0 {
            each(|i| {
                let moved = deflection[i] - apart.deflection[i];
                apart.yield_force[i] + yield_stiffness[i] * self.travel + self.yield_slope * moved
            })
        } else {
            each(|i| self.follows * gap[i] + self.yield_slope * deflection[i])
        };
        let mut elastic = each(|i| mid[i] + self.mid_slope * deflection[i] + yield_force[i]);
        let mut arms = [[0.0; N]; MAX_ARMS];
        for (k, (arm, more)) in self.arm_slopes.iter().zip(&mut arms).enumerate() {
            if arm.response == 0.0 {
                continue;
            }
            let own = &apart.arms[k];
            *more =
                each(|i| arm.left * own[i] + arm.response * (deflection[i] - apart.deflection[i]));
            if let Some(all) = &different.arms {
                let ([stiffness, time], force) = (&all[k], before.arms[k]);
                let by_time = arm.left_by_time * force + arm.response_by_time * self.travel;
                let by_stiffness = arm.response_by_stiffness * self.travel;
                *more = each(|i| more[i] + by_stiffness * stiffness[i] + by_time * time[i]);
            }
            elastic = each(|i| elastic[i] + more[i]);
        }
        Apart { deflection, yield_force, arms, elastic, force: elastic, ..Apart::SAME }
    }
}

impl Lead<'_> {
    /// The same part for those beside the leader.
    #[inline(always)]
    fn take(&self, beside: &mut Beside) {
        let Beside { elements, different, apart, .. } = beside;
        if let Some(course) = &self.course
            && !different.is_another
        {
            let more = course.deforming.more(&self.leader.params.deformation, different);
            if let Some(next) = self.follow(course, different, &more, apart) {
                *apart = next;
                return;
            }
        }
        self.alone(elements, apart);
    }

    /// The same part for an element of which one ordinate differs.
    pub(crate) fn take_ordinates(&self, ordinates: &mut [Ordinate]) {
        let mut by_itself = None;
        for ordinate in ordinates {
            let more = ordinate.more(self.after.deflection);
            if !ordinate.is_awake && more.mid == [0.0] {
                continue;
            }
            let course = match &self.course {
                Some(course) => course,
                None => by_itself.get_or_insert_with(|| self.course_to_the_end()),
            };
            let clipped = course.deforming.is_clipped();
            let more = MoreForce { gap: if clipped { [0.0] } else { more.gap }, ..more };
            let next = self.follow(course, &Different::NONE, &more, &ordinate.apart);
            ordinate.apart = next.unwrap_or(Apart::SAME);
            ordinate.is_awake = ordinate.apart.is_felt();
        }
    }

    /// The course of a part in which the leader yielded, turned or came to rest, as if it had gone
    /// all the way as it ends.
    fn course_to_the_end(&self) -> Course {
        let Self { leader, before, after, motion, .. } = self;
        if after.slip_velocity == 0.0 {
            return Course { deforming: leader.deforming(before, after, *motion), slide: None };
        }
        leader.slid(before, after, *motion, after.slip_velocity.abs(), 1.0)
    }

    #[inline(always)]
    fn follow<const N: usize>(
        &self,
        Course { deforming, slide }: &Course,
        different: &Different<N>,
        more: &MoreForce<N>,
        apart: &Apart<N>,
    ) -> Option<Apart<N>> {
        if let Some(slide) = slide {
            return self.slide(deforming, slide, different, more, apart);
        }
        let mut next = deforming.apart(&self.before, different, more, apart, apart.deflection);
        let damping = different.damping_force(self.motion.velocity);
        next.force = each(|i| next.force[i] + damping[i]);
        Some(next)
    }

    #[inline(always)]
    fn slide<const N: usize>(
        &self,
        deforming: &Deforming,
        slide: &Slide,
        different: &Different<N>,
        more: &MoreForce<N>,
        apart: &Apart<N>,
    ) -> Option<Apart<N>> {
        let Slide { direction, start, end, lag, start_drag, end_drag, .. } = slide;
        let s = direction.sign();
        let contact = different.contact.as_ref();
        let by = contact.map(|c| &c.sliding[usize::from(*direction == Direction::Insertion)]);
        let creep = contact.map_or([0.0; N], |contact| contact.creep_velocity);
        let curve = by.map_or([0.0; N], |by| start.curve_apart(by));
        let speed: Each<N> = if slide.is_damped || different.damping.is_some() {
            if *start_drag <= 0.0 {
                return None;
            }
            let rise = if lag.is_lagged { &apart.rise } else { &curve };
            let damping = different.damping_force(start.deformation_velocity);
            let contact = start.contact_apart(&creep, by, rise);
            each(|i| (s * (apart.elastic[i] + damping[i]) - contact[i]) / start_drag)
        } else {
            // The last step ended with the sliding force of the last slip speed.
            each(|i| s * apart.slip_velocity[i])
        };
        if *end_drag <= 0.0 {
            return None;
        }
        let deflection: Each<N> = each(|i| apart.deflection[i] - slide.explicit * speed[i]);
        let mut next = deforming.apart(&self.before, different, more, apart, deflection);
        let by_lag = contact.map_or([0.0; N], |contact| contact.friction_lag);
        let end_curve = by.map_or([0.0; N], |by| end.curve_apart(by));
        let rise = each(|i| {
            lag.left * apart.rise[i]
                + lag.before * (curve[i] + start.curve_by_speed * speed[i])
                + lag.by_lag * by_lag[i]
                + lag.now * end_curve[i]
        });
        let damping = different.damping_force(end.deformation_velocity);
        let contact = end.contact_apart(&creep, by, &rise);
        let speed: Each<N> = each(|i| (s * (next.elastic[i] + damping[i]) - contact[i]) / end_drag);
        let shift: Each<N> = each(|i| -slide.implicit * speed[i]);
        next.deflection = each(|i| next.deflection[i] + shift[i]);
        next.yield_force = each(|i| next.yield_force[i] + deforming.yield_slope * shift[i]);
        for (own, arm) in next.arms.iter_mut().zip(&deforming.arm_slopes) {
            *own = each(|i| own[i] + arm.response * shift[i]);
        }
        let steep = deforming.mid_slope + deforming.yield_slope + deforming.arm_stiffness;
        next.elastic = each(|i| next.elastic[i] + steep * shift[i]);
        next.slip_velocity = each(|i| s * speed[i]);
        if lag.is_lagged {
            next.rise = each(|i| rise[i] + lag.now * end.curve_by_speed * speed[i]);
        }
        next.force =
            each(|i| next.elastic[i] + damping[i] - end.damping_slope * next.slip_velocity[i]);
        Some(next)
    }

    /// The steps of `elements` by themselves.
    #[inline(never)]
    fn alone<const N: usize>(&self, elements: &[&Element; N], apart: &mut Apart<N>) {
        let Motion { velocity, time } = self.motion;
        for (i, element) in elements.iter().enumerate() {
            let mut state = apart.state(i, &self.before);
            element.step(&mut state, velocity * time, time);
            apart.set(i, (self.leader, &self.after), (element, &state));
        }
    }
}
