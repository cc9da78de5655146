//! Elements that differ little from one that leads, each from a state of its own.
//!
//! Where the leader slides on through a step, r(u) of a follower is evaluated once, at the leader's slip speeds. One Newton step from
//! there leaves what the leader's search left, or the follower takes the step by itself: where r differs by more than a search may
//! leave. θ is the leader's, and so are the exponentials of numbers that both have in common.

use super::{Motion, RESIDUAL, Slide};
use crate::creep::{Resistance, Rise, resistance_at};
use crate::ems::{Element, Side, State};
use crate::friction::velocity;
use crate::sliding::SlidingFriction;

/// One part of a leader's step.
pub(crate) struct Lead {
    motion: Motion,
    /// Where the leader slid on without a turn.
    course: Option<Course>,
}

/// How the leader slid.
struct Course {
    side: Side,
    theta: f64,
    /// At the start and at the end.
    start: Speed,
    end: Speed,
    /// What a follower may have in common.
    sliding: SlidingFriction,
}

/// A slip speed >= 0, m/s, with g and dg/du there, and the r that its search left, N.
struct Speed {
    speed: f64,
    level: (f64, f64),
    left: f64,
}

impl Speed {
    fn new(sliding: &SlidingFriction, speed: f64) -> Self {
        Self { speed, level: sliding.level_and_slope(speed), left: 0.0 }
    }
}

impl Course {
    /// g and dg/du of a follower.
    fn level(&self, sliding: &SlidingFriction, at: &Speed) -> (f64, f64) {
        if *sliding == self.sliding { at.level } else { sliding.level_and_slope(at.speed) }
    }
}

impl Element {
    /// As [`Element::step`], part by part: after each `follow` may take others along.
    pub(crate) fn lead(&self, state: &mut State, displacement: f64, duration: f64, mut follow: impl FnMut(&Lead)) {
        let Some(velocity) = velocity(displacement, duration) else { return };
        if self.confined {
            self.step(state, displacement, duration);
            return follow(&Lead { motion: Motion { velocity, time: duration }, course: None });
        }
        self.each_part(velocity, duration, |time| {
            let motion = Motion { velocity, time };
            let before = *state;
            state.commit(self.advance_general(&before, velocity, time));
            follow(&Lead { motion, course: self.course(&before, state, motion) });
        });
    }

    fn course(&self, before: &State, after: &State, motion: Motion) -> Option<Course> {
        let side = Side::of(after.slip_velocity);
        if before.slip_velocity * after.slip_velocity <= 0.0 {
            return None;
        }
        let onset = self.sliding_on(before, motion.velocity);
        if onset.speed <= 0.0 {
            return None;
        }
        let arms = self.params.relaxation.within(&onset.arms, motion.time);
        let sliding = *self.sliding(side);
        let mut course = Course {
            side,
            theta: self.predict(&onset, motion, arms).0,
            start: Speed::new(&sliding, onset.speed),
            end: Speed::new(&sliding, after.slip_velocity.abs()),
            sliding,
        };
        course.start.left = self.at_start(before, motion, &course).0;
        course.end.left = self.at_end(before, motion, &course, onset.speed).residual;
        Some(course)
    }

    /// r at the start of a step, and the drag β + (g·ρ)' + D' there.
    #[inline(always)]
    fn at_start(&self, state: &State, motion: Motion, course: &Course) -> (f64, f64) {
        let (s, speed, damping) = (course.side.sign(), course.start.speed, &self.params.damping);
        let rise = Rise::at_start(state.rise, self.params.friction_lag);
        let contact = self.contact_at(course, &course.start, rise);
        let deformation_velocity = motion.velocity - s * speed; // EMS (8)
        let elastic =
            self.params.deformation.mid_and_gap(state.deflection).0 + state.yield_force + state.relaxing_force();
        let r = s * (elastic + damping.force(deformation_velocity)) - contact.force;
        (r, contact.slope + damping.slope(deformation_velocity))
    }

    /// The end of a step that starts with slip speed `speed`, at the leader's slip speed.
    #[inline(always)]
    fn at_end(&self, state: &State, motion: Motion, course: &Course, speed: f64) -> End {
        let Course { side, theta, start, end, .. } = course;
        let sliding = self.sliding(*side);
        let (level, fall) = course.level(sliding, start);
        let before = || sliding.rise(level + fall * (speed - start.speed));
        let lagged = Rise::after(state.rise, self.params.friction_lag, motion.time, before);
        let arms = self.params.relaxation.within(&state.arms, motion.time);
        let slide = Slide::new((state.deflection, state.yield_force), *side, speed, motion, arms, *theta);
        let contact = self.contact_at(course, end, lagged);
        let (residual, slope) = self.balance(&slide, end.speed, &contact);
        End { slide, contact, residual, slope }
    }

    #[inline(always)]
    fn contact_at(&self, course: &Course, at: &Speed, rise: Rise) -> Resistance {
        let sliding = self.sliding(course.side);
        resistance_at(sliding, self.params.creep_velocity, rise, at.speed, course.level(sliding, at))
    }

    /// The step beside `course`; `None` where it takes more than one evaluation.
    #[inline(always)]
    fn follow(&self, state: &State, motion: Motion, course: &Course) -> Option<State> {
        let Course { side, start, end, .. } = course;
        let last = side.sign() * state.slip_velocity;
        let small = RESIDUAL * self.sliding(*side).static_force;
        if last <= 0.0 {
            return None;
        }
        let speed = if self.params.damping.is_zero() {
            // The last step ended with the sliding force of the last slip speed.
            last
        } else {
            let (r, drag) = self.at_start(state, motion, course);
            let missing = r - start.left;
            if missing.abs() > small || drag <= 0.0 {
                return None;
            }
            start.speed + missing / drag
        };
        let End { slide, contact, residual, slope } = self.at_end(state, motion, course, speed);
        let missing = residual - end.left;
        let u = end.speed - missing / slope;
        let is_one_step_away = missing.abs() <= small && slope < 0.0 && u > 0.0 && speed > 0.0;
        is_one_step_away.then(|| self.arrive(&slide, u, &contact, end.speed))
    }
}

/// The end of a follower's step at the leader's slip speed: the contact, r, N, and dr/du, N·s/m.
struct End {
    slide: Slide,
    contact: Resistance,
    residual: f64,
    slope: f64,
}

impl Lead {
    /// The same part for `element`.
    pub(crate) fn take(&self, element: &Element, state: &mut State) {
        let Motion { velocity, time } = self.motion;
        match self.course.as_ref().and_then(|course| element.follow(state, self.motion, course)) {
            Some(next) => state.commit(next),
            None => _ = element.step(state, velocity * time, time),
        }
    }
}
