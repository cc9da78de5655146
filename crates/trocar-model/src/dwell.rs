//! Friction after rest: a contact of rubber that has rested lets go later than one that has just slid.
//!
//! The sliding force and the static force of EMS (11), in both directions, are higher by
//!
//! ```text
//! ΔF·ln(1 + θ/t_0)          dθ/dt = 1 - |v_sl|·θ/D          t_0 = 1 s, D = c/8
//! ```
//!
//! | symbol | what                                                | unit | range |
//! |--------|-----------------------------------------------------|------|-------|
//! | ΔF     | `dwell_force`                                       | N    | >= 0  |
//! | θ      | age of the contact, [`crate::State::contact_age`]   | s    | >= 0  |
//!
//! θ is the time at rest, forgotten over a slip of D (DIETERICH). This law needs no border between rest
//! and motion: a seal that settles slips for ever a little less, and ages all the same. A deformation
//! without slip is rest. In steady sliding at the speed u, θ = D/u: the force is higher by ΔF·ln(1 + D/(u·t_0)),
//! a few hundredths of ΔF in strokes of centimetres a second. ΔF = 0 is EMS.
//!
//! - **t_0 and D are given.** After long rests another t_0 is another F_s. At 1 s the reversals of usual
//!   strokes hardly age the contact, so that F_c and F_s keep what they mean without ΔF. D is the longest
//!   part of a step: even after a minute the contact forgets within c.
//! - **Passive.** What is added opposes the slip and stores nothing; beyond ±c the seal follows its straight end.
//! - **Step.** Within a part of a step the contact has the age to which it comes at the slip speed at the
//!   start; afterwards θ is taken from the slip that was, exact for a constant slip speed, whatever its length.
//!   θ stays between 0 and the time that has passed. Of first order where the slip speed changes.

use crate::ems::{Element, LONGEST_PART, State};
use crate::exponential::{decay_and_mean, logarithm_of_one_plus};
use crate::rotation::Around;
use crate::sliding::SlidingFriction;

/// t_0, s.
const AGEING_TIME: f64 = 1.0;

/// θ, s, after a slip of `slip` (m) within `time`, s.
#[inline(always)]
fn age_after(element: &Element, age: f64, slip: f64, time: f64) -> f64 {
    let distance = LONGEST_PART * element.params.deformation.half_width();
    let (left, mean) = decay_and_mean(slip / distance);
    (age * left + time * mean).min(f64::MAX)
}

impl SlidingFriction {
    /// Higher by `more`, N, at any speed.
    fn raised(&self, more: f64) -> Self {
        Self {
            coulomb_force: self.coulomb_force + more,
            static_force: self.static_force + more,
            ..*self
        }
    }
}

impl Element {
    /// The element within a part of `time` (s) that begins in `state`, with the slip speed `speed`, m/s.
    pub(crate) fn aged(&self, state: &State, speed: f64, time: f64) -> Self {
        let age = age_after(self, state.contact_age, speed * time, time);
        let more = self.params.dwell_force * logarithm_of_one_plus(age / AGEING_TIME);
        let mut aged = *self;
        aged.params.insertion = self.params.insertion.raised(more);
        aged.params.withdrawal = self.params.withdrawal.raised(more);
        aged
    }

    /// [`Element::advance_general`] with friction after rest.
    #[inline(never)]
    pub(crate) fn advance_ageing(&self, state: &State, velocity: f64, time: f64) -> State {
        let aged = self.aged(state, state.slip_velocity.abs(), time);
        let next = aged.advance_general(state, velocity, time);
        let slip = velocity * time - (next.deflection - state.deflection); // EMS (8)
        self.with_age(state, next, slip.abs(), time)
    }

    /// `next` with the age that follows that of `before`.
    pub(crate) fn with_age(&self, before: &State, next: State, slip: f64, time: f64) -> State {
        State { contact_age: age_after(self, before.contact_age, slip, time), ..next }
    }
}

impl Around {
    /// Beside `aged`, of which `own` is the element without age.
    pub(crate) fn aged(&self, own: &Element, aged: &Element) -> Self {
        let ratio = self.sliding.static_force
            / (0.5 * (own.params.insertion.static_force + own.params.withdrawal.static_force));
        let more = aged.params.insertion.coulomb_force - own.params.insertion.coulomb_force;
        Self { sliding: self.sliding.raised(ratio * more), ..*self }
    }
}
