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
//! yields, turns or comes to rest, or differences are too large for the first order, a follower
//! takes the step by itself. The weight θ of the step, which decides its order of accuracy, is the
//! leader's.

use super::Motion;
use crate::creep::{Resistance, Rise, resistance_at};
use crate::damping::SealDamping;
use crate::direction::Direction;
use crate::elastic::{DeflectionLocation, DeformationForce, ShapeDifference};
use crate::ems::{Element, State};
use crate::exponential::{decay, decay_and_mean, logarithm};
use crate::friction::velocity;
use crate::relaxation::{ArmForces, MAX_ARMS};
use crate::sliding::SlidingFriction;

/// Largest difference of r, as a fraction of the static force, that is followed to first order.
const LARGEST: f64 = 1e-4;

/// How a state differs from the leader's.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Apart {
    deflection: f64,
    yield_force: f64,
    arms: ArmForces,
    /// Of the force without seal damping, N.
    elastic: f64,
    slip_velocity: f64,
    rise: f64,
    pub(crate) force: f64,
}

/// By how much M, h (N) and κ (N/m) exceed the leader's where it arrives.
#[derive(Clone, Copy, Debug, Default)]
struct MoreForce {
    mid: f64,
    gap: f64,
    yield_stiffness: f64,
}

/// How the parameters differ from the leader's.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Different {
    /// `None` where the shapes are the same.
    shape: Option<ShapeDifference>,
    damping: SealDamping,
    /// For withdrawal and insertion.
    sliding: [SlidingFriction; 2],
    creep_velocity: f64,
    friction_lag: f64,
    /// E and τ of each arm.
    arms: [[f64; 2]; MAX_ARMS],
    /// Has what the leader lacks altogether, or lacks what it has.
    is_another: bool,
}

const NO_SLIDING: SlidingFriction = SlidingFriction {
    coulomb_force: 0.0,
    static_force: 0.0,
    stribeck_velocity: 0.0,
    stribeck_exponent: 0.0,
    viscous_damping: 0.0,
};

impl Different {
    const NONE: Self = Self {
        shape: None,
        damping: SealDamping::ZERO,
        sliding: [NO_SLIDING; 2],
        creep_velocity: 0.0,
        friction_lag: 0.0,
        arms: [[0.0; 2]; MAX_ARMS],
        is_another: false,
    };
}

/// Each number of `other` less that of `own`.
fn more_of_sliding(own: &SlidingFriction, other: &SlidingFriction) -> SlidingFriction {
    SlidingFriction {
        coulomb_force: other.coulomb_force - own.coulomb_force,
        static_force: other.static_force - own.static_force,
        stribeck_velocity: other.stribeck_velocity - own.stribeck_velocity,
        stribeck_exponent: other.stribeck_exponent - own.stribeck_exponent,
        viscous_damping: other.viscous_damping - own.viscous_damping,
    }
}

impl Element {
    /// What `other` has more.
    pub(crate) fn difference(&self, other: &Self) -> Different {
        let (own, its) = (&self.params, &other.params);
        let shape = (own.deformation != its.deformation)
            .then(|| own.deformation.difference(&its.deformation));
        let mut different = Different {
            shape,
            sliding: [(&own.withdrawal, &its.withdrawal), (&own.insertion, &its.insertion)]
                .map(|(a, b)| more_of_sliding(a, b)),
            creep_velocity: its.creep_velocity - own.creep_velocity,
            friction_lag: its.friction_lag - own.friction_lag,
            is_another: self.creeps != other.creeps
                || (own.friction_lag > 0.0) != (its.friction_lag > 0.0),
            ..Different::NONE
        };
        let coefficients = different.damping.coefficients.iter_mut();
        coefficients
            .zip(own.damping.coefficients)
            .zip(its.damping.coefficients)
            .for_each(|((more, a), b)| *more = b - a);
        for ((more, a), b) in
            different.arms.iter_mut().zip(&own.relaxation.arms).zip(&its.relaxation.arms)
        {
            *more = [b.stiffness - a.stiffness, b.time - a.time];
            different.is_another |= (a.stiffness > 0.0) != (b.stiffness > 0.0);
        }
        different
    }

    /// Force of the seal without its damping, N.
    fn undamped_force(&self, state: &State) -> f64 {
        let (mid, _) = self.params.deformation.mid_and_gap(state.deflection);
        mid + state.yield_force + state.relaxing_force()
    }

    /// How `other` in `its` state differs from this element in `state`.
    pub(crate) fn apart(&self, state: &State, other: &Self, its: &State) -> Apart {
        let mut arms = [0.0; MAX_ARMS];
        arms.iter_mut().zip(its.arms).zip(state.arms).for_each(|((more, b), a)| *more = b - a);
        Apart {
            deflection: its.deflection - state.deflection,
            yield_force: its.yield_force - state.yield_force,
            arms,
            elastic: other.undamped_force(its) - self.undamped_force(state),
            slip_velocity: its.slip_velocity - state.slip_velocity,
            rise: its.rise - state.rise,
            force: its.force - state.force,
        }
    }
}

/// One ordinate of the deformation force, and how the state of an element differs in which it is
/// a little higher.
#[derive(Clone, Copy, Debug)]
pub struct Ordinate {
    place: OrdinatePlace,
    is_awake: bool,
    apart: Apart,
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
        Self { place, is_awake: false, apart: Apart::default() }
    }

    /// Derivative of the force: by a force of a branch 1, by a slope m.
    pub fn derivative(&self) -> f64 {
        self.apart.force / Self::UNIT
    }

    /// By how much M and h are higher at deflection `z`, m.
    #[inline(always)]
    fn more(&self, z: f64) -> MoreForce {
        let (mid, gap) = match self.place {
            OrdinatePlace::Node { direction, at, spacing } => {
                let half = 0.5 * (1.0 - (z - at).abs() / spacing).max(0.0);
                (half, direction.sign() * half)
            }
            OrdinatePlace::Slope { end } if z.abs() > end.abs() && z * end > 0.0 => (z - end, 0.0),
            OrdinatePlace::Slope { .. } => (0.0, 0.0),
        };
        MoreForce { mid: Self::UNIT * mid, gap: Self::UNIT * gap, yield_stiffness: 0.0 }
    }
}

impl Apart {
    /// Whether a change of an ordinate by [`Ordinate::UNIT`] is still in the state.
    fn is_felt(&self) -> bool {
        const FAINT: f64 = 1e-7 * Ordinate::UNIT;
        // A deflection bears on the force by a stiffness, of which little is known here: 100 N/m.
        let felt = [100.0 * self.deflection, self.elastic, self.yield_force, self.force];
        felt.iter().chain(&self.arms).any(|force| force.abs() > FAINT)
    }

    /// The state that differs so from `led`.
    pub(crate) fn state_beside(&self, led: &State) -> State {
        let mut state = *led;
        state.deflection += self.deflection;
        state.yield_force += self.yield_force;
        state.arms.iter_mut().zip(self.arms).for_each(|(a, more)| *a += more);
        state.slip_velocity += self.slip_velocity;
        state.rise += self.rise;
        state.force += self.force;
        state
    }
}

/// One part of a leader's step.
pub(crate) struct Lead<'a> {
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
    /// As [`Element::step`], part by part: after each `follow` may take others along.
    pub(crate) fn lead(
        &self,
        state: &mut State,
        displacement: f64,
        duration: f64,
        mut follow: impl FnMut(&Lead),
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
            follow(&Lead { leader: self, before, after: *state, motion, course });
        };
        if self.confined { part(duration) } else { self.each_part(velocity, duration, part) }
    }

    fn advance_on_course(&self, state: &mut State, motion: Motion) -> Option<Course> {
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
    fn curve_apart(&self, by: &SlidingFriction) -> f64 {
        self.curve_by_velocity * by.stribeck_velocity
            + self.curve_by_exponent * by.stribeck_exponent
    }

    /// Difference of the contact's force at fixed slip speed, where λ differs by `rise`, N.
    #[inline(always)]
    fn contact_apart(&self, different: &Different, by: &SlidingFriction, rise: f64) -> f64 {
        let level = by.coulomb_force
            + self.rise * (by.static_force - by.coulomb_force)
            + self.surplus * rise;
        self.part * level
            + self.by_creep * different.creep_velocity
            + by.viscous_damping * self.speed
    }
}

impl Deforming {
    #[inline(always)]
    fn more(&self, own: &DeformationForce, different: &Different) -> MoreForce {
        let Some(shape) = &different.shape else { return MoreForce::default() };
        let (mid, gap) = own.more_at(shape, &self.location);
        MoreForce { mid, gap, yield_stiffness: shape.yield_stiffness }
    }

    fn is_clipped(&self) -> bool {
        matches!(self.location, DeflectionLocation::Within { clipped: true, .. })
    }

    /// The deformation where z⁺ differs by `deflection`, m; the slip is not yet in it.
    #[inline(always)]
    fn apart(
        &self,
        before: &State,
        different: &Different,
        more: MoreForce,
        apart: &Apart,
        deflection: f64,
    ) -> Apart {
        let MoreForce { mid, gap, yield_stiffness } = more;
        let moved = deflection - apart.deflection;
        let yield_force = if self.follows == 0.0 {
            apart.yield_force + yield_stiffness * self.travel + self.yield_slope * moved
        } else {
            self.follows * gap + self.yield_slope * deflection
        };
        let mut arms = [0.0; MAX_ARMS];
        let each = arms
            .iter_mut()
            .zip(&self.arm_slopes)
            .zip(&different.arms)
            .zip(apart.arms)
            .zip(before.arms);
        for ((((more, arm), [stiffness, time]), own), force) in each {
            let response = arm.response_by_stiffness * stiffness + arm.response_by_time * time;
            *more = arm.left * own
                + arm.left_by_time * time * force
                + response * self.travel
                + arm.response * moved;
        }
        let elastic = mid + self.mid_slope * deflection + yield_force + arms.iter().sum::<f64>();
        Apart {
            deflection,
            yield_force,
            arms,
            elastic,
            slip_velocity: 0.0,
            rise: 0.0,
            force: elastic,
        }
    }
}

impl Lead<'_> {
    /// The same part for `element`, which is `different` and `apart`.
    #[inline(always)]
    pub(crate) fn take(&self, element: &Element, different: &Different, apart: &mut Apart) {
        let course = self.course.as_ref().filter(|_| !different.is_another);
        let followed = course.and_then(|course| {
            let more = course.deforming.more(&self.leader.params.deformation, different);
            self.follow(course, different, more, apart)
        });
        *apart = followed.unwrap_or_else(|| self.alone(element, apart));
    }

    /// The same part for an element of which one ordinate differs.
    pub(crate) fn take_ordinates(&self, ordinates: &mut [Ordinate]) {
        let mut by_itself = None;
        for ordinate in ordinates {
            let more = ordinate.more(self.after.deflection);
            if !ordinate.is_awake && more.mid == 0.0 {
                continue;
            }
            let course = match &self.course {
                Some(course) => course,
                None => by_itself.get_or_insert_with(|| self.course_to_the_end()),
            };
            let clipped = course.deforming.is_clipped();
            let more = MoreForce { gap: if clipped { 0.0 } else { more.gap }, ..more };
            let next = self.follow(course, &Different::NONE, more, &ordinate.apart);
            ordinate.apart = next.unwrap_or_default();
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
    fn follow(
        &self,
        Course { deforming, slide }: &Course,
        different: &Different,
        more: MoreForce,
        apart: &Apart,
    ) -> Option<Apart> {
        match slide {
            Some(slide) => self.slide(deforming, slide, different, more, apart),
            None => Some(self.deforming(deforming, different, more, apart)),
        }
    }

    #[inline(always)]
    fn deforming(
        &self,
        deforming: &Deforming,
        different: &Different,
        more: MoreForce,
        apart: &Apart,
    ) -> Apart {
        let mut next = deforming.apart(&self.before, different, more, apart, apart.deflection);
        next.force += different.damping.force(self.motion.velocity);
        next
    }

    #[inline(always)]
    fn slide(
        &self,
        deforming: &Deforming,
        slide: &Slide,
        different: &Different,
        more: MoreForce,
        apart: &Apart,
    ) -> Option<Apart> {
        let Slide { direction, start, end, lag, .. } = slide;
        let s = direction.sign();
        let by = &different.sliding[usize::from(*direction == Direction::Insertion)];
        let small = LARGEST * self.leader.sliding(*direction).static_force;
        let curve = start.curve_apart(by);
        let speed = if slide.is_damped || !different.damping.is_zero() {
            let rise = if lag.is_lagged { apart.rise } else { curve };
            let missing = s * (apart.elastic + different.damping.force(start.deformation_velocity))
                - start.contact_apart(different, by, rise);
            if missing.abs() > small || slide.start_drag <= 0.0 {
                return None;
            }
            missing / slide.start_drag
        } else {
            // The last step ended with the sliding force of the last slip speed.
            s * apart.slip_velocity
        };
        let mut next = deforming.apart(
            &self.before,
            different,
            more,
            apart,
            apart.deflection - slide.explicit * speed,
        );
        let curve_before = curve + start.curve_by_speed * speed;
        let rise = lag.left * apart.rise
            + lag.before * curve_before
            + lag.by_lag * different.friction_lag
            + lag.now * end.curve_apart(by);
        let damping = different.damping.force(end.deformation_velocity);
        let missing = s * (next.elastic + damping) - end.contact_apart(different, by, rise);
        if missing.abs() > small || slide.end_drag <= 0.0 {
            return None;
        }
        let speed = missing / slide.end_drag;
        let shift = -slide.implicit * speed;
        next.deflection += shift;
        next.yield_force += deforming.yield_slope * shift;
        next.arms
            .iter_mut()
            .zip(&deforming.arm_slopes)
            .for_each(|(a, arm)| *a += arm.response * shift);
        next.elastic +=
            (deforming.mid_slope + deforming.yield_slope + deforming.arm_stiffness) * shift;
        next.slip_velocity = s * speed;
        next.rise = if lag.is_lagged { rise + lag.now * end.curve_by_speed * speed } else { 0.0 };
        next.force = next.elastic + damping - end.damping_slope * next.slip_velocity;
        Some(next)
    }

    /// The step of `element` by itself.
    #[inline(never)]
    fn alone(&self, element: &Element, apart: &Apart) -> Apart {
        let Motion { velocity, time } = self.motion;
        let mut state = apart.state_beside(&self.before);
        element.step(&mut state, velocity * time, time);
        self.leader.apart(&self.after, element, &state)
    }
}
