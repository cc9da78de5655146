//! The step of an element along the axis and around it, [`crate::rotation`].
//!
//! At the end of a step of duration dt the slip velocity v = (v_x, v_t) solves
//!
//! ```text
//! P(z⁺) = f(v) + β·v        P = (F_e(z_x⁺) + Σ a⁺ + D(ẋ - v_x), k_t·z_t⁺)
//! z⁺    = z + V·dt - dt·[Θ·v + (1 - Θ)·v_0]
//! Θ     = θ_∥·n·nᵀ + θ_⊥·(1 - n·nᵀ)        n = v_0/|v_0|
//! ```
//!
//! The contact is soft along the slip (β) and stiff across it (F_c/|v|), so each direction has a θ
//! of its own, fitted as in [`super`]. Newton's method finds v from the last one. Where it does not
//! converge, or slip begins or ends within the step, the implicit step (Θ = 1) is solved by a search
//! over the slip speed |v|, upwards as far as the first balance along the slip, and for each speed by
//! one over its direction: across the slip forces balance between the axis and the circumference on
//! the side of P, whether or not the friction law falls with the speed.

use super::{
    DEFLECTION_STRIDE, RESIDUAL, STRIBECK_STRIDE, Search, YIELD_MARGIN, find_root, fit_theta,
    yield_fraction,
};
use crate::creep::Rise;
use crate::direction::Direction;
use crate::ems::{Element, Mode, State};
use crate::exponential::decay;
use crate::friction::sign;
use crate::relaxation::{ArmForces, StepArms};
use crate::rotation::{Around, Turn};
use crate::sliding::SlidingFriction;

/// Newton iterations from the last slip velocity.
const ITERATIONS: usize = 10;

/// Square of the change of the slip velocity, as a part of it, that is the last one: to first order
/// the contact then misses by 1e-7 of its force. The memory of a creeping contact, and a contact whose
/// direction along the axis changes, miss by their change itself, at most 3e-4.
const NEAR: f64 = 1e-7;

/// Square of a slip velocity too slow to have a direction, m²/s².
const NO_SLIP: f64 = 1e-30;

/// Along the axis and around it.
type Pair = [f64; 2];

/// V, m/s, and its size.
#[derive(Clone, Copy)]
struct Motion {
    velocity: Pair,
    speed: f64,
}

/// Start of a step.
#[derive(Clone, Copy)]
struct Start {
    z: Pair,
    q: f64,
    arms: ArmForces,
    /// v_0.
    slip: Pair,
    /// n where the slip begins.
    onset: Pair,
    rise: f64,
}

/// All of the equation but v.
#[derive(Clone, Copy)]
struct Slide<'a> {
    start: &'a Start,
    motion: Motion,
    time: f64,
    arms: &'a StepArms,
    rise: Rise,
    /// z + V·dt - dt·(1 - Θ)·v_0, m, and dt·Θ, s.
    target: Pair,
    weight: [Pair; 2],
}

/// The contact at one slip velocity: f + β·v and its derivatives.
struct Contact {
    force: Pair,
    slope: [Pair; 2],
    rise: f64,
}

/// Where a slide ends with some slip velocity.
struct End {
    slip: Pair,
    z: Pair,
    q: f64,
    force: Pair,
    /// P - f - β·v, and its derivative by -v.
    residual: Pair,
    slope: [Pair; 2],
    contact: Contact,
}

/// An end sought by the speed of the slip and its direction.
struct Towards {
    end: End,
    /// What is missing along the slip, and its derivative by the speed where none is missing across.
    along: (f64, f64),
    /// What is missing across the slip, and its derivative by the part of the direction.
    across: (f64, f64),
}

impl Start {
    /// n·nᵀ: its entry along the axis, the one beside, and that around the shaft; where there is no slip,
    /// of its onset.
    #[inline(always)]
    fn along_slip(&self) -> [f64; 3] {
        let products = |[x, t]: Pair| [x * x, x * t, t * t];
        let square = self.slip[0] * self.slip[0] + self.slip[1] * self.slip[1];
        if square < NO_SLIP {
            return products(self.onset);
        }
        let inverse = 1.0 / square;
        products(self.slip).map(|product| product * inverse)
    }
}

impl Element {
    /// As [`Element::step`], at the velocities `motion` (m/s) along the axis and around the shaft.
    pub(crate) fn step_turning(
        &self,
        around: &Around,
        (state, turn): (&mut State, &mut Turn),
        motion: [f64; 2],
        duration: f64,
    ) {
        let (mut next, mut turned) = (*state, *turn);
        let motion = Motion { velocity: motion, speed: length(motion) };
        self.each_part(motion.speed, duration, |time| {
            let at = (&next, &turned);
            (next, turned) = if self.params.dwell_force > 0.0 {
                self.advance_turning_ageing(around, at, motion, time)
            } else {
                self.advance_turning(around, at, motion, time)
            };
        });
        let finite = next.deflection.abs() <= f64::MAX
            && next.force.abs() <= f64::MAX
            && turned.deflection.abs() <= f64::MAX;
        if finite {
            (*state, *turn) = (next, turned);
        }
    }

    /// With friction after rest, [`crate::dwell`].
    fn advance_turning_ageing(
        &self,
        around: &Around,
        (state, turn): (&State, &Turn),
        motion: Motion,
        time: f64,
    ) -> (State, Turn) {
        let aged = self.aged(state, length([state.slip_velocity, turn.slip_velocity]), time);
        let around = around.aged(self, &aged);
        let (next, turned) = aged.advance_turning(&around, (state, turn), motion, time);
        let slip = [
            motion.velocity[0] * time - (next.deflection - state.deflection),
            motion.velocity[1] * time - (turned.deflection - turn.deflection),
        ];
        (self.with_age(state, next, length(slip), time), turned)
    }

    fn advance_turning(
        &self,
        around: &Around,
        (state, turn): (&State, &Turn),
        motion: Motion,
        time: f64,
    ) -> (State, Turn) {
        let slip = [state.slip_velocity, turn.slip_velocity];
        let z = [state.deflection, turn.deflection];
        let (q, arms, rise) = (state.yield_force, state.arms, state.rise);
        let mut start = Start { z, q, arms, slip, onset: [0.0; 2], rise };
        if slip == [0.0; 2] && !self.creeps {
            return self.leave_stick_turning(around, &start, motion, time);
        }
        if self.creeps || !self.params.damping.is_zero() {
            // The velocity may have changed: the slip at the start is that of the new one.
            let held = self.arms_within(&start, 0.0);
            let rise = Rise::at_start(rise, self.params.friction_lag);
            let now = Slide { rise, ..self.at_rest(&start, &held, motion) };
            if let Some(end) = self.newton_apart(around, &now, slip) {
                start.slip = end.slip;
            }
        }
        self.slide_turning(around, &start, motion, time)
    }

    /// From stick: deforms with the instrument.
    fn leave_stick_turning(
        &self,
        around: &Around,
        start: &Start,
        motion: Motion,
        time: f64,
    ) -> (State, Turn) {
        let arms = self.arms_within(start, time);
        let all = self.stuck_slide(start, &arms, motion, time);
        let trial = self.elastic(around, &all);
        if self.holds(around, trial) {
            return self.stuck_turning(&all, trial);
        }
        self.yield_within_turning(around, start, motion, time)
    }

    /// Deforms up to the yield point within the step and slides from there.
    #[inline(never)]
    fn yield_within_turning(
        &self,
        around: &Around,
        start: &Start,
        motion: Motion,
        time: f64,
    ) -> (State, Turn) {
        let within = |part: f64| self.arms_within(start, part * time);
        let force_at = |part: f64| {
            let arms = within(part);
            self.elastic(around, &self.stuck_slide(start, &arms, motion, part * time))
        };
        let beyond = |part: f64| self.utilisation(around, force_at(part)) - 1.0;
        let part = yield_fraction(beyond, beyond(1.0));
        let arms = within(part);
        let (force, time_left) = (force_at(part), (1.0 - part) * time);
        let z = self.stuck_slide(start, &arms, motion, part * time).target;
        let q = self.params.deformation.reach(start.z[0], start.q, z[0]).1;
        let arms = arms.forces(z[0] - start.z[0]);
        let normal = self.normal(around, force);
        let mut begin = Start { z, q, arms, slip: [0.0; 2], onset: normal, rise: 1.0 };
        if !around.constant {
            // A law that falls at once is left by a jump of the slip speed.
            let margin = 1.0 + YIELD_MARGIN;
            let mut beyond = begin;
            beyond.z[1] *= margin;
            beyond.q += (margin - 1.0) * force[0];
            let held = self.arms_within(&beyond, 0.0);
            let now = self.at_rest(&beyond, &held, motion);
            if let Some(end) =
                self.newton_apart(around, &now, self.guess(around, &now, force, normal))
            {
                begin.slip = end.slip;
            }
        }
        self.slide_turning(around, &begin, motion, time_left)
    }

    fn arms_within(&self, start: &Start, time: f64) -> StepArms {
        self.params.relaxation.within(&start.arms, time)
    }

    /// The contact at the start alone, for a motion that begins there.
    fn at_rest<'a>(&self, start: &'a Start, arms: &'a StepArms, motion: Motion) -> Slide<'a> {
        let (rise, target) = (Rise::INSTANT, start.z);
        Slide { start, motion, time: 0.0, arms, rise, target, weight: [[0.0; 2]; 2] }
    }

    /// A step without slip; `arms` are those of `time`.
    #[inline(always)]
    fn stuck_slide<'a>(
        &self,
        start: &'a Start,
        arms: &'a StepArms,
        motion: Motion,
        time: f64,
    ) -> Slide<'a> {
        let [along, around] = motion.velocity;
        let target = [start.z[0] + along * time, start.z[1] + around * time];
        let weight = [[time, 0.0], [0.0, time]];
        Slide { start, motion, time, arms, rise: Rise::INSTANT, target, weight }
    }

    /// P at the end of `slide` without slip.
    fn elastic(&self, around: &Around, slide: &Slide) -> Pair {
        let Start { z, q, .. } = *slide.start;
        let elastic = self.params.deformation.reach(z[0], q, slide.target[0]).0;
        let arms = slide.arms.force(slide.target[0] - z[0]);
        [
            elastic + arms + self.params.damping.force(slide.motion.velocity[0]),
            around.stiffness * slide.target[1],
        ]
    }

    /// Whether `force` lies in the yield set at rest.
    #[inline(always)]
    fn holds(&self, around: &Around, force: Pair) -> bool {
        let axial = self.sliding(Direction::of(force[0])).static_force;
        let tangential = around.sliding.static_force;
        let [x, t] = [force[0] * tangential, force[1] * axial];
        x * x + t * t <= (axial * tangential) * (axial * tangential)
    }

    /// How much of the yield set at rest `force` takes up: 1 on its boundary.
    #[inline(always)]
    fn utilisation(&self, around: &Around, force: Pair) -> f64 {
        let axial = self.sliding(Direction::of(force[0])).static_force;
        length([force[0] / axial, force[1] / around.sliding.static_force])
    }

    /// Outward normal of the yield set at `force`.
    fn normal(&self, around: &Around, force: Pair) -> Pair {
        let limits =
            [self.sliding(Direction::of(force[0])).static_force, around.sliding.static_force];
        let normal = [force[0] / (limits[0] * limits[0]), force[1] / (limits[1] * limits[1])];
        let size = length(normal);
        normal.map(|part| part / size)
    }

    fn stuck_turning(&self, slide: &Slide, force: Pair) -> (State, Turn) {
        let Start { z, q, .. } = *slide.start;
        let q = self.params.deformation.reach(z[0], q, slide.target[0]).1;
        let arms = slide.arms.forces(slide.target[0] - z[0]);
        let turn = Turn { deflection: slide.target[1], slip_velocity: 0.0 };
        (State::stuck(slide.target[0], q, force[0], arms), turn)
    }

    #[cfg_attr(not(target_arch = "wasm32"), inline(always))]
    fn slide_turning(
        &self,
        around: &Around,
        start: &Start,
        motion: Motion,
        time: f64,
    ) -> (State, Turn) {
        let axial = self.sliding(Direction::of(start.slip[0]));
        let before = || {
            if axial.is_constant() { 1.0 } else { decay(axial.exponent(length(start.slip))) }
        };
        let rise = Rise::after(start.rise, self.params.friction_lag, time, before);
        let arms = self.arms_within(start, time);
        let implicit = Slide { rise, ..self.stuck_slide(start, &arms, motion, time) };
        let (fitted, guess) = self.weigh(around, &implicit);
        if let Some(end) = self.newton(around, &fitted, guess) {
            return self.after_sliding(&fitted, &end);
        }
        self.slide_implicitly(around, &implicit)
    }

    /// Where Newton's method does not arrive with the weights of [`Self::weigh`].
    #[inline(never)]
    fn slide_implicitly(&self, around: &Around, implicit: &Slide) -> (State, Turn) {
        let trial = self.elastic(around, implicit);
        if !self.creeps && self.holds(around, trial) {
            return self.stuck_turning(implicit, trial);
        }
        let guess = self.guess(around, implicit, trial, self.normal(around, trial));
        let end = self.newton_apart(around, implicit, guess);
        let end = end.unwrap_or_else(|| self.search_turning(around, implicit));
        self.after_sliding(implicit, &end)
    }

    /// `implicit` with the weights Θ of the module documentation, and to first order the slip
    /// velocity at its end.
    #[inline(always)]
    fn weigh<'a>(&self, around: &Around, implicit: &Slide<'a>) -> (Slide<'a>, Pair) {
        let Slide { start, motion: Motion { velocity, speed }, time, .. } = *implicit;
        let [nn, nt, tt] = start.along_slip();
        let stiffness = [
            self.one_sided_stiffness(
                &self.params.deformation.local(start.z[0]),
                start.q,
                velocity[0] - start.slip[0],
            ) + implicit.arms.stiffness,
            around.stiffness,
        ];
        let along = stiffness[0] * nn + stiffness[1] * tt;
        let across = stiffness[0] * tt + stiffness[1] * nn;
        let contact = if start.slip == [0.0; 2] {
            None
        } else {
            Some(self.contact_turning(around, implicit.rise, start.slip))
        };
        let damping = self.params.damping.slope(velocity[0] - start.slip[0]);
        let drag = match &contact {
            Some(Contact { slope: [[a, b], [c, d]], .. }) if !around.constant && !self.creeps => {
                a * nn + (b + c) * nt + d * tt
            }
            // A force that depends on the direction of the slip alone has no slope along it; creep is
            // left to the implicit step. Slip begins in the direction of its onset.
            _ => {
                let axial = self.sliding(Direction::of(start.slip[0] + start.onset[0]));
                axial.viscous_damping * nn + around.sliding.viscous_damping * tt
            }
        } + damping * nn;
        // θ = 1 where the start does not decay.
        let theta_along =
            if along > 0.0 && drag > 0.0 { fit_theta(along * time / drag) } else { 1.0 };
        let theta_across =
            fit_theta((across * (speed * time / around.sliding.coulomb_force)).max(0.0));
        let more = theta_along - theta_across;
        let weight = [
            [time * (theta_across + more * nn), time * more * nt],
            [time * more * nt, time * (theta_across + more * tt)],
        ];
        let kept = (1.0 - theta_along) * time;
        let target =
            [implicit.target[0] - kept * start.slip[0], implicit.target[1] - kept * start.slip[1]];
        let fitted = Slide { target, weight, ..*implicit };
        let guess = match contact {
            Some(Contact { mut slope, .. }) => {
                slope[0][0] += damping;
                stiffen(&mut slope, stiffness, &weight);
                let missing = [
                    stiffness[0] * time * (velocity[0] - start.slip[0]),
                    stiffness[1] * time * (velocity[1] - start.slip[1]),
                ];
                self.follow_turning(around, start.slip, solve(&slope, missing))
            }
            None => self.guess(around, implicit, self.elastic(around, implicit), start.onset),
        };
        (fitted, guess)
    }

    /// Slip velocity in `direction` for the force `trial` without slip, where the seal is straight.
    fn guess(&self, around: &Around, slide: &Slide, trial: Pair, direction: Pair) -> Pair {
        let [n, t] = direction;
        let axial = self.sliding(Direction::of(n));
        let excess =
            (self.utilisation(around, trial) - 1.0).max(YIELD_MARGIN) * axial.coulomb_force;
        let stiffness = self.params.deformation.yield_stiffness().max(around.stiffness);
        let drag = axial.viscous_damping + stiffness * slide.time;
        let speed = if drag > 0.0 { excess / drag } else { axial.stribeck_velocity };
        [speed * n, speed * t]
    }

    /// Newton's method from `slip`; `None` where it does not arrive, or at a root that is not stable.
    #[inline(always)]
    fn newton(&self, around: &Around, slide: &Slide, mut slip: Pair) -> Option<End> {
        let small =
            RESIDUAL * self.params.insertion.static_force.min(self.params.withdrawal.static_force);
        let near = 1e5 * small;
        for _ in 0..ITERATIONS {
            let end = self.end_turning(around, slide, slip);
            let [[a, b], [c, d]] = end.slope;
            // NaN is above nothing.
            if !(a * d - b * c > 0.0 && a + d > 0.0) {
                return None;
            }
            if end.residual[0].abs() <= small && end.residual[1].abs() <= small {
                return Some(end);
            }
            let more = solve(&end.slope, end.residual);
            let [change, size] = [more, slip].map(|[x, t]| x * x + t * t);
            if end.residual[0].abs() <= near
                && end.residual[1].abs() <= near
                && change <= NEAR * size
            {
                return Some(self.moved(around, slide, end, more));
            }
            slip = self.follow_turning(around, slip, more);
        }
        None
    }

    /// `slip` changed by `more`; where the friction law may fall at most doubled or halved, but for the
    /// slowest slip: such a law has two stable branches with an unstable one between them, and the
    /// present one is followed.
    #[inline(always)]
    fn follow_turning(&self, around: &Around, slip: Pair, more: Pair) -> Pair {
        if around.constant {
            return [slip[0] + more[0], slip[1] + more[1]];
        }
        let [change, size] = [more, slip].map(|[x, t]| x * x + t * t);
        let feature = STRIBECK_STRIDE * self.sliding(Direction::of(slip[0])).stribeck_velocity;
        let grows = slip[0] * more[0] + slip[1] * more[1] > 0.0;
        let most = (if grows { size } else { 0.25 * size }).max(feature * feature);
        let part = if change <= most { 1.0 } else { libm::sqrt(most / change) };
        [slip[0] + part * more[0], slip[1] + part * more[1]]
    }

    /// [`Self::newton`] off the usual way.
    #[inline(never)]
    fn newton_apart(&self, around: &Around, slide: &Slide, slip: Pair) -> Option<End> {
        self.newton(around, slide, slip)
    }

    /// `end` after a last change of the slip velocity, to first order but for the deformation.
    #[inline(always)]
    fn moved(&self, around: &Around, slide: &Slide, end: End, more: Pair) -> End {
        let [[a, b], [c, d]] = slide.weight;
        let change = [-a * more[0] - b * more[1], -c * more[0] - d * more[1]];
        let z = [end.z[0] + change[0], end.z[1] + change[1]];
        let (elastic, q) = self.params.deformation.reach(slide.start.z[0], slide.start.q, z[0]);
        let slip = [end.slip[0] + more[0], end.slip[1] + more[1]];
        let damping = self.params.damping.force(slide.motion.velocity[0] - slip[0]);
        let axial = elastic + slide.arms.force(z[0] - slide.start.z[0]) + damping;
        End { slip, z, q, force: [axial, around.stiffness * z[1]], ..end }
    }

    #[inline(always)]
    fn end_turning(&self, around: &Around, slide: &Slide, slip: Pair) -> End {
        let Slide { start, weight, target, .. } = slide;
        let z = [
            target[0] - weight[0][0] * slip[0] - weight[0][1] * slip[1],
            target[1] - weight[1][0] * slip[0] - weight[1][1] * slip[1],
        ];
        let (elastic, q, stiffness) =
            self.params.deformation.reach_with_slope(start.z[0], start.q, z[0]);
        let damping = &self.params.damping;
        let speed = slide.motion.velocity[0] - slip[0]; // EMS (8)
        let force = [
            elastic + slide.arms.force(z[0] - start.z[0]) + damping.force(speed),
            around.stiffness * z[1],
        ];
        let contact = self.contact_turning(around, slide.rise, slip);
        let residual = [force[0] - contact.force[0], force[1] - contact.force[1]];
        let stiffness = [stiffness + slide.arms.stiffness, around.stiffness];
        let mut slope = contact.slope;
        stiffen(&mut slope, stiffness, weight);
        slope[0][0] += damping.slope(speed);
        End { slip, z, q, force, residual, slope, contact }
    }

    /// f + β·v, [`crate::rotation`].
    #[inline(always)]
    fn contact_turning(&self, around: &Around, rise: Rise, slip: Pair) -> Contact {
        let axial = self.sliding(Direction::of(slip[0]));
        let speed = if around.constant { 0.0 } else { length(slip) };
        let creep = self.params.creep_velocity;
        let (g, fall, g_t, fall_t, rise) = if around.constant && !self.creeps {
            (axial.coulomb_force, 0.0, around.sliding.coulomb_force, 0.0, Rise::KEPT)
        } else {
            let (g, fall, rise) = self.level(axial, rise, speed);
            let (g_t, fall_t, _) = self.level(&around.sliding, rise, speed);
            (g, fall, g_t, fall_t, rise)
        };
        let squares = [slip[0] * slip[0] + creep * creep, slip[1] * slip[1]];
        let inverse = 1.0 / libm::sqrt(g * g * squares[0] + g_t * g_t * squares[1]);
        let secant = [g * g * inverse, g_t * g_t * inverse];
        let force = [secant[0] * slip[0], secant[1] * slip[1]];
        let cross = -force[0] * force[1] * inverse;
        let mut slope = [
            [secant[0] - force[0] * force[0] * inverse, cross],
            [cross, secant[1] - force[1] * force[1] * inverse],
        ];
        if (fall != 0.0 || fall_t != 0.0) && speed > 0.0 {
            let common = (g * fall * squares[0] + g_t * fall_t * squares[1]) * (inverse * inverse);
            let by_speed =
                [force[0] * (2.0 * fall / g - common), force[1] * (2.0 * fall_t / g_t - common)];
            for (row, change) in slope.iter_mut().zip(by_speed) {
                row.iter_mut().zip(slip).for_each(|(entry, part)| *entry += change * part / speed);
            }
        }
        let beta = [axial.viscous_damping, around.sliding.viscous_damping];
        slope[0][0] += beta[0];
        slope[1][1] += beta[1];
        let force = [force[0] + beta[0] * slip[0], force[1] + beta[1] * slip[1]];
        Contact { force, slope, rise: rise.kept }
    }

    /// g and dg/du with the lag of [`crate::creep`]; and λ as a rise that is kept.
    #[inline(always)]
    fn level(&self, sliding: &SlidingFriction, rise: Rise, speed: f64) -> (f64, f64, Rise) {
        let (level, fall) = sliding.level_and_slope(speed);
        if !self.creeps {
            return (level, fall, Rise::KEPT);
        }
        let now = rise.kept + rise.now * sliding.rise(level);
        let surplus = sliding.static_force - sliding.coulomb_force;
        (sliding.coulomb_force + surplus * now, rise.now * fall, Rise { kept: now, now: 0.0 })
    }

    /// The implicit step by a search over the slip speed from the stick side, and for each by one over
    /// its direction, between the axis (0) and the circumference (1) on the side of the force.
    #[inline(never)]
    fn search_turning(&self, around: &Around, slide: &Slide) -> End {
        let trial = self.elastic(around, slide);
        let s = Direction::of(trial[0]);
        let side = [s.sign(), sign(trial[1])];
        let residual = RESIDUAL * self.sliding(s).static_force;
        let multivalued = self.is_multivalued(s, slide.rise.now);
        let feature = STRIBECK_STRIDE * self.sliding(s).stribeck_velocity;
        let in_speed = if multivalued { feature } else { f64::INFINITY };
        let softens = self.least_stiffness <= 0.0 && slide.time > 0.0;
        let c = self.params.deformation.half_width();
        let in_deflection =
            if softens { DEFLECTION_STRIDE * c / slide.time } else { f64::INFINITY };
        let stride = in_speed.min(in_deflection);
        let normal = self.normal(around, trial);
        let mut part = normal[1].abs() / (normal[0].abs() + normal[1].abs());
        let mut last = self.end_towards(around, slide, side, (0.0, part));
        let guess = length(self.guess(around, slide, trial, normal)).min(stride);
        find_root(
            |speed| {
                if speed == 0.0 {
                    // Outside the yield set there is always slip.
                    return (length(trial), f64::NAN);
                }
                let turned = |part: f64| {
                    last = self.end_towards(around, slide, side, (speed, part.min(1.0)));
                    last.across
                };
                let direction = Search { guess: part, stride: 0.5, residual };
                part = find_root(turned, direction).0.min(1.0);
                last.along
            },
            Search { guess, stride, residual },
        );
        last.end
    }

    /// [`Self::end_turning`] at a slip speed towards v/|v| ~ (1 - p, p) on `side`.
    #[inline(never)]
    fn end_towards(
        &self,
        around: &Around,
        slide: &Slide,
        side: Pair,
        (speed, part): (f64, f64),
    ) -> Towards {
        let size = length([1.0 - part, part]);
        let along = [side[0] * (1.0 - part) / size, side[1] * part / size];
        let across = [-side[0] * part / size, side[1] * (1.0 - part) / size];
        let end = self.end_turning(around, slide, along.map(|n| speed * n));
        let dot = |a: Pair, b: Pair| a[0] * b[0] + a[1] * b[1];
        let slope = end.slope;
        let by = |direction: Pair| slope.map(|row| dot(row, direction));
        let [balance, imbalance] = [along, across].map(|n| dot(end.residual, n));
        let turning = speed * dot(across, by(across)) + balance;
        let follows = speed * dot(along, by(across)) * dot(across, by(along)) / turning;
        Towards {
            end,
            along: (balance, follows - dot(along, by(along))),
            across: (imbalance, -turning / (size * size)),
        }
    }

    #[cfg_attr(not(target_arch = "wasm32"), inline(always))]
    fn after_sliding(&self, slide: &Slide, end: &End) -> (State, Turn) {
        let creeping = if self.creeps {
            length(end.slip) <= self.params.creep_velocity
        } else {
            end.slip == [0.0; 2]
        };
        let state = State {
            deflection: end.z[0],
            yield_force: end.q,
            force: end.force[0],
            slip_velocity: end.slip[0],
            contact_slope: end.contact.slope[0][0].max(-f64::MAX),
            rise: end.contact.rise,
            arms: slide.arms.forces(end.z[0] - slide.start.z[0]),
            contact_age: 0.0,
            mode: if creeping { Mode::Deforming } else { Mode::Sliding },
        };
        (state, Turn { deflection: end.z[1], slip_velocity: end.slip[1] })
    }
}

/// Adds the stiffness of the seal to the derivative of the contact.
#[inline(always)]
fn stiffen(slope: &mut [Pair; 2], stiffness: Pair, weight: &[Pair; 2]) {
    for ((row, weights), stiffness) in slope.iter_mut().zip(weight).zip(stiffness) {
        row.iter_mut().zip(weights).for_each(|(entry, weight)| *entry += stiffness * weight);
    }
}

#[inline(always)]
fn solve([[a, b], [c, d]]: &[Pair; 2], [r, s]: Pair) -> Pair {
    let inverse = 1.0 / (a * d - b * c);
    [(d * r - b * s) * inverse, (a * s - c * r) * inverse]
}

#[inline(always)]
fn length([x, t]: Pair) -> f64 {
    libm::sqrt(x * x + t * t)
}
