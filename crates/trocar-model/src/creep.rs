//! Creep of the contact below the static force.
//!
//! EMS (11), (13) let the instrument slip only once the force reaches F_s: a seal held at rest
//! keeps its force for ever. Measured seals lose theirs, fast near the sliding force and hardly at
//! all far below it, and trembling does not stop it. The contact then slips at any force, and its
//! force builds up over a small slip speed v_c:
//!
//! ```text
//! F ∈ [g(u) + β·u]·sgn(v_sl)          u = |v_sl|                   EMS (11), (13)
//! F = [g(u)·ρ(u) + β·u]·sgn(v_sl)     ρ(u) = u/√(u² + v_c²)        here, for v_c > 0
//! ```
//!
//! At small force the contact is a dashpot of F_s/v_c; at u >> v_c it is EMS, (1 - ρ) < v_c²/2u².
//! v_c -> 0 is EMS itself. F·v_sl >= 0 at every slip speed: creep only ever takes energy. A held
//! force F below F_s relaxes at first with the rate K·v_c/√(F_s² - F²) (K the stiffness of the
//! deformed seal).
//!
//! # Lag of the Stribeck curve
//!
//! On a soft seal a force that falls with speed makes the contact stick and slip
//! ([`crate::Element::velocity_weakening`]). Friction rises and falls with a delay, though
//! (frictional memory, ARMSTRONG), and a lag T of the curve keeps steady sliding steady where T·K +
//! β + σ exceeds the fall of g. For a creeping contact T may be given; the force stays opposed to
//! the slip.

use crate::exponential::decay_and_mean;
use crate::sliding::SlidingFriction;

/// How much of the static force's surplus the contact has, within a step: g = F_c + (F_s - F_c)·λ
/// with
///
/// ```text
/// dλ/dt = (e - λ)/T        e = exp(-(u/v_s)^δ)
/// λ⁺ = λ·p + e_0·(m - p) + e·(1 - m)        p = exp(-dt/T), m = (1 - p)·T/dt
///    = `kept` + `now`·e
/// ```
///
/// where e_0 belongs to the slip speed at the start of the step. This is the exact solution for an
/// e that changes linearly over the step: of second order, and a weighted mean of numbers between 0
/// and 1 at any dt. T = 0 is the curve of EMS (11) itself: `kept` = 0, `now` = 1.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rise {
    pub(crate) kept: f64,
    pub(crate) now: f64,
}

impl Rise {
    /// The curve without lag.
    pub(crate) const INSTANT: Self = Self { kept: 0.0, now: 1.0 };
    /// λ = 1 whatever the slip speed.
    pub(crate) const KEPT: Self = Self { kept: 1.0, now: 0.0 };

    /// λ = `rise` before a step has begun, with lag `lag`, s.
    #[inline(always)]
    pub(crate) fn at_start(rise: f64, lag: f64) -> Self {
        if lag > 0.0 { Self { kept: rise, now: 0.0 } } else { Self::INSTANT }
    }

    /// λ at the end of a step of `duration` (s) that starts at a slip speed with e = `before`.
    #[inline(always)]
    pub(crate) fn after(rise: f64, lag: f64, duration: f64, before: impl FnOnce() -> f64) -> Self {
        if lag > 0.0 {
            let (left, mean) = decay_and_mean(duration / lag);
            Self { kept: rise * left + (mean - left) * before(), now: 1.0 - mean }
        } else {
            Self::INSTANT
        }
    }
}

/// The contact at one slip speed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Resistance {
    /// g(u)·ρ(u) + β·u, N.
    pub(crate) force: f64,
    /// Its slope, N·s/m.
    pub(crate) slope: f64,
    /// λ.
    pub(crate) rise: f64,
}

impl Resistance {
    /// Slip at rest without creep.
    pub(crate) const NONE: Self = Self { force: 0.0, slope: 0.0, rise: 1.0 };
}

/// The contact at slip speed `u` >= 0, m/s; ρ = 1 without creep.
#[inline(always)]
pub(crate) fn resistance(
    sliding: &SlidingFriction,
    creep_velocity: f64,
    rise: Rise,
    u: f64,
) -> Resistance {
    resistance_at(sliding, creep_velocity, rise, u, sliding.level_and_slope(u))
}

/// The same where g and dg/du are known: `level`, `fall`.
#[inline(always)]
pub(crate) fn resistance_at(
    sliding: &SlidingFriction,
    creep_velocity: f64,
    rise: Rise,
    u: f64,
    (level, fall): (f64, f64),
) -> Resistance {
    let beta = sliding.viscous_damping;
    if creep_velocity <= 0.0 {
        return Resistance { force: level + beta * u, slope: fall + beta, rise: 1.0 };
    }
    let surplus = sliding.static_force - sliding.coulomb_force;
    let rise_now = rise.kept + rise.now * sliding.rise(level);
    let level = sliding.coulomb_force + surplus * rise_now;
    let inverse = 1.0 / libm::sqrt(u * u + creep_velocity * creep_velocity);
    let part = u * inverse;
    let growth = creep_velocity * creep_velocity * inverse * (inverse * inverse);
    let slope = rise.now * fall * part + level * growth + beta;
    Resistance { force: level * part + beta * u, slope, rise: rise_now }
}
