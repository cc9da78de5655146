//! The discrete step in its general form: speed-dependent sliding force, seal damping, or branches
//! that pass the sliding force inside [-c, c].
//!
//! At the end of a step of duration dt the slip speed u >= 0 in the direction s = ±1 solves
//!
//! ```text
//! r(u) = s·[F_e(z⁺) + Σ a⁺ + D(v_d - s·u)] - g(u)·ρ(u) - β·u = 0              (13) with (8), (11)
//! z⁺   = z + v_d·dt - s·dt·[θ·u + (1 - θ)·u_0]                               (8)
//! ```
//!
//! where u_0 is the slip speed at the start. θ is fitted so that the step is exact for a straight
//! spring and a straight friction law; it lies between 1/2 (second order) and 1 (stiff limit), so
//! no stiffness is too high for any dt. If r(0) <= 0 the seal sticks: the contact is an inclusion,
//! sgn(v_d) decides nothing. With creep, r(0) = 0 only where the force is zero; there the slip
//! changes its direction. Within a step the relaxing arms a are one more spring
//! ([`crate::relaxation`]), exact at a constant dz/dt.

use crate::creep::{Resistance, Rise};
use crate::direction::Direction;
use crate::elastic::Local;
use crate::ems::{Element, Mode, State};
use crate::exponential::decay;
use crate::relaxation::{ArmForces, StepArms};

pub(crate) mod beside;
pub(crate) mod turn;

/// Limit on evaluations of r in one search: keeps the work of a step bounded.
const MAX_EVALUATIONS: usize = 240;

/// Evaluations inside a bracket after which the search bisects.
const NEWTON_EVALUATIONS: usize = 24;

/// Evaluations after which a march doubles its stride.
const EVEN_STRIDES: usize = 100;

/// Residual, as a fraction of the static force, at which a search ends: some nanonewtons, ten
/// million times the rounding of the forces.
const RESIDUAL: f64 = 1e-9;

/// Change of the slip speed, as a fraction of it, up to which the one at the start of a step
/// follows to first order: g and ρ, functions of powers of u, then miss by less than 1e-4 of
/// themselves. It only weighs in with 1 - θ < 1/2 and a factor K·dt.
const SMALL_CHANGE: f64 = 1e-2;

/// How far the force has passed the static force when a slip starts, as a fraction of it: rounding,
/// 1e-7 in single precision, must not decide whether a law that falls at once is left by a jump.
const YIELD_MARGIN: f64 = 1e-5;

/// March stride as a fraction of the Stribeck speed: a tenth of the narrowest feature of g.
const STRIBECK_STRIDE: f64 = 0.1;

/// Longest stride from rest, m/s: no seal slips that fast.
const LONGEST_STRIDE: f64 = 1.0;

/// March stride as a fraction of c, in deflection.
const DEFLECTION_STRIDE: f64 = 1.0 / 32.0;

/// A motion at constant velocity.
#[derive(Clone, Copy)]
struct Motion {
    velocity: f64,
    time: f64,
}

/// Start of a slip: where, in which direction, how fast.
#[derive(Clone, Copy)]
struct Onset {
    z: f64,
    q: f64,
    /// The deformation force around z.
    local: Local,
    arms: ArmForces,
    direction: Direction,
    speed: f64,
    /// d(r)/du at fixed z with the sign changed: β + (g·ρ)' + D'.
    drag: f64,
    /// λ of [`crate::creep`].
    rise: f64,
}

/// A slide through one motion: all of r(u) but the contact.
#[derive(Clone, Copy)]
struct Slide {
    z: f64,
    q: f64,
    direction: Direction,
    s: f64,
    motion: Motion,
    arms: StepArms,
    /// z + v_d·dt - s·dt·(1 - θ)·u_0, m, and θ·dt, s.
    target: f64,
    implicit: f64,
}

impl Slide {
    /// From (z, q), slip speed `speed` and weight θ = `theta`.
    #[inline(always)]
    fn new(
        (z, q): (f64, f64),
        direction: Direction,
        speed: f64,
        motion: Motion,
        arms: StepArms,
        theta: f64,
    ) -> Self {
        let s = direction.sign();
        let target = z + motion.velocity * motion.time - s * motion.time * (1.0 - theta) * speed;
        Self { z, q, direction, s, motion, arms, target, implicit: theta * motion.time }
    }

    /// z⁺, m, for a slip speed `u` at the end.
    #[inline(always)]
    fn reached(&self, u: f64) -> f64 {
        self.target - self.s * self.implicit * u
    }
}

/// The end of a slide with some slip speed.
struct End {
    deflection: f64,
    yield_force: f64,
    force: f64,
    /// r and dr/du.
    residual: f64,
    slope: f64,
    contact: Resistance,
}

impl End {
    const NOWHERE: Self = Self {
        deflection: f64::NAN,
        yield_force: f64::NAN,
        force: f64::NAN,
        residual: f64::NAN,
        slope: f64::NAN,
        contact: Resistance::NONE,
    };
}

/// How far a search for a root may stride, and from where it starts.
#[derive(Clone, Copy)]
struct Search {
    guess: f64,
    stride: f64,
    residual: f64,
}

impl Element {
    /// One step of the general law; `state` is at most c/8 of travel away from the result, or in a
    /// long slide.
    #[inline(always)]
    pub(crate) fn advance_general(&self, state: &State, velocity: f64, time: f64) -> State {
        let motion = Motion { velocity, time };
        if state.slip_velocity == 0.0 && !self.creeps {
            return self.leave_stick(state, motion);
        }
        self.keep_sliding(state, motion)
    }

    /// From a slide; the velocity may have changed since, so that it sticks at once or slips the
    /// other way.
    fn keep_sliding(&self, state: &State, motion: Motion) -> State {
        let mut onset = self.sliding_on(state, motion.velocity);
        if onset.speed == 0.0 {
            if !self.creeps {
                return self.leave_stick(state, motion);
            }
            onset.direction = onset.direction.opposite();
            let rise = Rise::at_start(state.rise, self.params.friction_lag);
            let elastic = onset.local.mid + onset.q + state.relaxing_force();
            (onset.speed, onset.drag) =
                self.slip_at(onset.direction, elastic, motion.velocity, rise, 0.0);
        }
        self.slide(onset, motion)
    }

    /// The running slide when the velocity becomes `velocity`; at speed 0 it ends.
    #[inline(always)]
    fn sliding_on(&self, state: &State, velocity: f64) -> Onset {
        let direction = Direction::of(state.slip_velocity);
        let (z, q, arms) = (state.deflection, state.yield_force, state.arms);
        let local = self.params.deformation.local(z);
        let elastic = local.mid + q + state.relaxing_force();
        let (speed, drag) = self.slip_after(state, direction, elastic, velocity);
        Onset { z, q, local, arms, direction, speed, drag, rise: state.rise }
    }

    /// From stick: deforms with the instrument, EMS (10).
    #[inline(always)]
    fn leave_stick(&self, state: &State, motion: Motion) -> State {
        let (z, q) = (state.deflection, state.yield_force);
        let damping = self.params.damping.force(motion.velocity);
        let target = z + motion.velocity * motion.time;
        let (elastic, yield_force) = self.params.deformation.reach(z, q, target);
        let arms = self.params.relaxation.within(&state.arms, motion.time);
        let force = elastic + arms.force(target - z) + damping;
        let sticks = force <= self.params.insertion.static_force
            && -force <= self.params.withdrawal.static_force;
        if sticks {
            return State::stuck(target, yield_force, force, arms.forces(target - z));
        }
        self.yield_within(state, motion, force)
    }

    /// Deforms up to the yield point within the step, (12), and slides from there; `trial` is the
    /// force without slip.
    #[inline(never)]
    fn yield_within(&self, state: &State, motion: Motion, trial: f64) -> State {
        let (z, q) = (state.deflection, state.yield_force);
        let damping = self.params.damping.force(motion.velocity);
        let direction = Direction::of(trial);
        let s = direction.sign();
        let limit = self.sliding(direction).static_force;
        let moved = |part: f64| part * motion.velocity * motion.time;
        let arms_at = |part: f64| {
            self.params.relaxation.within(&state.arms, part * motion.time).forces(moved(part))
        };
        let force_at = |part: f64| {
            let elastic = self.params.deformation.reach(z, q, z + moved(part)).0;
            s * (elastic + arms_at(part).iter().sum::<f64>() + damping) - limit
        };
        let part = yield_fraction(force_at, s * trial - limit);
        let reached = z + moved(part);
        let yield_force = self.params.deformation.reach(z, q, reached).1;
        let local = self.params.deformation.local(reached);
        let arms = arms_at(part);
        let elastic = local.mid + yield_force + arms.iter().sum::<f64>();
        let drive = (s * (elastic + damping)).max((1.0 + YIELD_MARGIN) * limit);
        let (speed, drag) =
            self.slip_at(direction, s * drive - damping, motion.velocity, Rise::INSTANT, 0.0);
        let onset =
            Onset { z: reached, q: yield_force, local, arms, direction, speed, drag, rise: 1.0 };
        self.slide(onset, Motion { time: (1.0 - part) * motion.time, ..motion })
    }

    /// Slip speed and drag in a running slide when the velocity becomes `velocity`.
    ///
    /// The last force is the sliding force at the last slip speed, (13): it tells g without an
    /// exponential. A small change of slip speed is taken to first order.
    fn slip_after(
        &self,
        state: &State,
        direction: Direction,
        elastic: f64,
        velocity: f64,
    ) -> (f64, f64) {
        let s = direction.sign();
        let last = state.slip_velocity.abs();
        if self.is_free(direction) {
            return (last, 0.0);
        }
        let sliding = self.sliding(direction);
        let deformation_velocity = velocity - s * last; // EMS (8)
        let slope = match self.creeps {
            true => state.contact_slope,
            false => {
                let beta = sliding.viscous_damping;
                beta + sliding.slope_at_level(last, s * state.force - beta * last)
            }
        };
        let drag = slope + self.params.damping.slope(deformation_velocity);
        let surplus = s * (elastic + self.params.damping.force(deformation_velocity) - state.force);
        let change = surplus / drag;
        if change.abs() <= SMALL_CHANGE * last {
            (last + change, drag)
        } else {
            self.slip_at(
                direction,
                elastic,
                velocity,
                Rise::at_start(state.rise, self.params.friction_lag),
                last,
            )
        }
    }

    /// Slip speed at a given elastic force, and the drag β + g' + D' there. With neither β nor σ
    /// the speed is free: 0.
    fn slip_at(
        &self,
        direction: Direction,
        elastic: f64,
        velocity: f64,
        rise: Rise,
        guess: f64,
    ) -> (f64, f64) {
        let s = direction.sign();
        let sliding = self.sliding(direction);
        let damping = &self.params.damping;
        let residual = |u: f64| {
            let contact = self.resistance(direction, rise, u);
            let deformation_velocity = velocity - s * u; // EMS (8)
            let drive = s * (elastic + damping.force(deformation_velocity));
            (drive - contact.force, -(contact.slope + damping.slope(deformation_velocity)))
        };
        if self.is_free(direction) {
            return (guess, 0.0);
        }
        let stride = if self.is_multivalued(direction, rise.now) {
            STRIBECK_STRIDE * sliding.stribeck_velocity
        } else {
            f64::INFINITY
        };
        let (speed, slope) = find_root(
            residual,
            Search { guess, stride, residual: RESIDUAL * sliding.static_force },
        );
        (speed, -slope)
    }

    /// Slides through `motion`, EMS (14).
    fn slide(&self, onset: Onset, motion: Motion) -> State {
        self.slide_by_theta(onset, motion).0
    }

    /// The same, with θ of the slide that was begun.
    #[inline(always)]
    fn slide_by_theta(&self, onset: Onset, motion: Motion) -> (State, f64) {
        let arms = self.params.relaxation.within(&onset.arms, motion.time);
        let (mut theta, guess) = self.predict(&onset, motion, arms);
        let mut next = self.slide_with(&onset, motion, arms, theta, guess);
        if next.slip_velocity == 0.0 && self.stops_too_late(&onset, motion, arms, theta) {
            (next, theta) = (self.slide_with(&onset, motion, arms, 1.0, 0.0), 1.0);
        }
        let across = onset.direction.opposite();
        let limit = if self.creeps { 0.0 } else { self.sliding(across).static_force };
        if next.slip_velocity == 0.0 && across.sign() * next.force > limit {
            // It stuck and then yielded the other way within the step.
            let onset = Onset { direction: across, speed: 0.0, ..onset };
            return (self.slide_with(&onset, motion, arms, 1.0, 0.0), theta);
        }
        (next, theta)
    }

    /// Whether a slide that ends at rest had slipped on where it must have stopped: a contact that
    /// slips carries at least F_c, a creeping one has the sign of its slip. The slip at the start,
    /// held for (1 - θ)·dt, may take a seal that stiffens on its way back further.
    #[inline(never)]
    fn stops_too_late(&self, onset: &Onset, motion: Motion, arms: StepArms, theta: f64) -> bool {
        let (s, sliding) = (onset.direction.sign(), self.sliding(onset.direction));
        let slip = (1.0 - theta) * onset.speed * motion.time;
        let change = s * ((s * motion.velocity * motion.time).max(0.0) - slip);
        let elastic = self.params.deformation.reach(onset.z, onset.q, onset.z + change).0;
        let damping = self.params.damping.force(motion.velocity).abs();
        self.creeps || s * (elastic + arms.force(change)) < sliding.coulomb_force - damping
    }

    fn slide_with(
        &self,
        onset: &Onset,
        motion: Motion,
        arms: StepArms,
        theta: f64,
        guess: f64,
    ) -> State {
        let Onset { z, q, direction, speed, .. } = *onset;
        let slide = Slide::new((z, q), direction, speed, motion, arms, theta);
        let sliding = self.sliding(direction);
        let before = || if sliding.is_constant() { 1.0 } else { decay(sliding.exponent(speed)) };
        let lagged = Rise::after(onset.rise, self.params.friction_lag, motion.time, before);
        let mut end = End::NOWHERE;
        let residual = |u: f64| {
            end = self.end(&slide, lagged, u);
            (end.residual, end.slope)
        };
        let search = self.search(onset, slide.implicit, lagged.now, guess);
        let u = find_root(residual, search).0;
        let mode = if u <= self.params.creep_velocity { Mode::Deforming } else { Mode::Sliding };
        State {
            deflection: end.deflection,
            yield_force: end.yield_force,
            force: end.force,
            slip_velocity: slide.s * u,
            // Falls at an infinite rate at u = 0 where the shape exponent is below 1: finite, for a
            // state to be finite numbers.
            contact_slope: end.contact.slope.max(-f64::MAX),
            rise: end.contact.rise,
            arms: arms.forces(end.deflection - z),
            contact_age: 0.0,
            mode,
        }
    }

    /// Where `slide` ends with slip speed `u`, EMS (14), and r(u) there, EMS (13).
    #[inline(always)]
    fn end(&self, slide: &Slide, rise: Rise, u: f64) -> End {
        let Slide { z, q, direction, s, motion, arms, .. } = slide;
        let contact = self.resistance(*direction, rise, u);
        let deflection = slide.reached(u);
        let (elastic, yield_force, stiffness) =
            self.params.deformation.reach_with_slope(*z, *q, deflection);
        let deformation_velocity = motion.velocity - s * u; // EMS (8)
        let damping = &self.params.damping;
        let force = elastic + arms.force(deflection - z) + damping.force(deformation_velocity);
        let drag = contact.slope + damping.slope(deformation_velocity);
        End {
            deflection,
            yield_force,
            force,
            residual: s * force - contact.force,
            slope: -drag - slide.implicit * (stiffness + arms.stiffness),
            contact,
        }
    }

    /// Where the slip speed at the end of the step is sought.
    ///
    /// With a single root any start will do, and the last speed is the nearest. A multivalued
    /// friction law is followed on its present branch. Where only the seal softens (K·dt < -β) the
    /// root of least slip, met first from the stick side, is the stable one.
    fn search(&self, onset: &Onset, implicit: f64, now: f64, guess: f64) -> Search {
        let sliding = self.sliding(onset.direction);
        let residual = RESIDUAL * sliding.static_force;
        let multivalued = self.is_multivalued(onset.direction, now);
        let softens =
            self.least_stiffness * implicit + self.least_drag(onset.direction, now) <= 0.0;
        if !multivalued && !softens {
            return Search { guess, stride: f64::INFINITY, residual };
        }
        let in_speed =
            if multivalued { STRIBECK_STRIDE * sliding.stribeck_velocity } else { f64::INFINITY };
        let c = self.params.deformation.half_width();
        let in_deflection = if self.least_stiffness <= 0.0 {
            DEFLECTION_STRIDE * c / implicit
        } else {
            f64::INFINITY
        };
        let guess = if multivalued {
            guess.min(onset.speed + in_speed).max(onset.speed - in_speed)
        } else {
            0.0
        };
        Search { guess, stride: in_speed.min(in_deflection), residual }
    }

    /// θ of the module documentation, from the rate K/(β + g' + D') at the start, and the slip
    /// speed at the end if the seal does not deform. θ = 1 where the start does not decay.
    ///
    /// A creeping contact is slow and may let go within the step: there θ follows the drag of
    /// sliding, which is exact for what comes, and costs nothing where the slip is small.
    fn predict(&self, onset: &Onset, motion: Motion, arms: StepArms) -> (f64, f64) {
        let s = onset.direction.sign();
        let deformation_velocity = motion.velocity - s * onset.speed;
        let stiffness =
            self.one_sided_stiffness(&onset.local, onset.q, deformation_velocity) + arms.stiffness;
        let stiffening = stiffness * motion.time;
        if stiffening <= 0.0 || onset.drag <= 0.0 {
            return (1.0, onset.speed);
        }
        let theta = match self.creeps {
            true => {
                let sliding = self.sliding(onset.direction).viscous_damping
                    + self.params.damping.slope(deformation_velocity);
                fit_theta(stiffening / sliding.min(onset.drag))
            }
            false => fit_theta(stiffening / onset.drag),
        };
        let change = stiffening * s * deformation_velocity / (onset.drag + theta * stiffening);
        (theta, (onset.speed + change).max(0.0))
    }

    /// dF_e/dz where the deformation force is `local` and q, for a motion in the direction of
    /// `deformation_velocity`.
    fn one_sided_stiffness(&self, local: &Local, q: f64, deformation_velocity: f64) -> f64 {
        if deformation_velocity >= 0.0 && q >= local.gap {
            local.mid_slope + local.gap_slope
        } else if deformation_velocity <= 0.0 && q <= -local.gap {
            local.mid_slope - local.gap_slope
        } else {
            local.mid_slope + self.params.deformation.yield_stiffness()
        }
    }
}

/// θ(y) = 1/(1 - e^-y) - 1/y, from 1/2 at y = 0 to 1 at infinity: makes one step exact for a linear
/// decay of rate y/dt.
fn fit_theta(y: f64) -> f64 {
    // The usual case by the series, good to 1e-6 up to 1: θ decides the order of accuracy, not the
    // force itself.
    if y < 1.0 {
        let y2 = y * y;
        0.5 + y * (1.0 / 12.0 - y2 * (1.0 / 720.0 - y2 / 30_240.0))
    } else {
        1.0 / (1.0 - decay(y)) - 1.0 / y
    }
}

/// Part of the step before the force reaches the static force: a chord and one correction.
///
/// `force_at(part)` is the force above the limit; `end` its value at the end, > 0.
fn yield_fraction(force_at: impl Fn(f64) -> f64, end: f64) -> f64 {
    let start = force_at(0.0);
    if start >= 0.0 {
        return 0.0;
    }
    let chord = -start / (end - start);
    let there = force_at(chord);
    if there > 0.0 {
        chord - chord * there / (there - start)
    } else {
        chord + (1.0 - chord) * -there / (end - there)
    }
}

/// A root u >= 0 of a residual that is positive left of it, and the slope there; 0 when the
/// residual is not positive at 0. What is returned is what was evaluated last.
///
/// Newton steps inside a bracket. Until there is a bracket the search marches from the guess
/// towards the root, never further at once than the stride, so that it stops at the nearest root.
/// No step is taken on trust: near the end of a branch of a multivalued law the slope all but
/// vanishes, and a small residual may lie far from any root.
fn find_root(mut residual: impl FnMut(f64) -> (f64, f64), search: Search) -> (f64, f64) {
    let Search { guess: mut u, mut stride, residual: small } = search;
    let (mut low, mut high): (Option<f64>, Option<f64>) = (None, None);
    let mut bracketed = 0_usize;
    let (mut r, mut slope) = residual(u);
    for evaluations in 0..MAX_EVALUATIONS {
        if (r <= 0.0 && u == 0.0) || (r.abs() <= small && slope < 0.0) {
            break;
        }
        if r > 0.0 {
            low = Some(u);
        } else {
            high = Some(u);
        }
        if evaluations > EVEN_STRIDES {
            stride *= 2.0;
        }
        let newton = if slope < 0.0 { u - r / slope } else { f64::NAN };
        let next = match (low, high) {
            (Some(low), Some(high)) => {
                // Saturates: a sum that might overflow is a panic to the proof that there is none.
                bracketed = bracketed.saturating_add(1);
                let inside = newton > low && newton < high && bracketed < NEWTON_EVALUATIONS;
                if inside { newton } else { 0.5 * (low + high) }
            }
            // A slope that vanishes leads anywhere: at most doubled, u stays a number.
            (_, None) => newton.min(u + stride.min(u + LONGEST_STRIDE)),
            (None, _) => newton.max(u - stride).max(0.0),
        };
        if next == u {
            break;
        }
        u = next;
        (r, slope) = residual(u);
    }
    (u, slope)
}
