//! Creep of the contact below the static force.
//!
//! EMS (11), (13) let the instrument slip only once the force reaches F_s: a seal held at rest keeps its force for ever.
//! Measured seals lose theirs, fast near the sliding force and hardly at all far below it, and trembling does not stop it.
//! The contact then slips at any force, and its force builds up over a small slip speed v_c:
//!
//! ```text
//! F ∈ [g(u) + β·u]·sgn(v_sl)          u = |v_sl|                   EMS (11), (13)
//! F = [g(u)·ρ(u) + β·u]·sgn(v_sl)     ρ(u) = u/√(u² + v_c²)        here, for v_c > 0
//! ```
//!
//! At small force the contact is a dashpot of F_s/v_c; at u >> v_c it is EMS, (1 - ρ) < v_c²/2u². v_c -> 0 is EMS itself.
//! F·v_sl >= 0 at every slip speed: creep only ever takes energy. A held force F below F_s relaxes at first with the rate
//! K·v_c/√(F_s² - F²) (K the stiffness of the bent seal).

use crate::sliding::SlidingFriction;

/// g(u)·ρ(u) + β·u, N, and its slope, N·s/m, at slip speed `u` >= 0, m/s; ρ = 1 without creep.
#[inline(always)]
pub(crate) fn resistance(sliding: &SlidingFriction, creep_velocity: f64, u: f64) -> (f64, f64) {
    let (level, fall) = sliding.level_and_slope(u);
    let beta = sliding.viscous_damping;
    if creep_velocity <= 0.0 {
        return (level + beta * u, fall + beta);
    }
    let inverse = 1.0 / libm::sqrt(u * u + creep_velocity * creep_velocity);
    let part = u * inverse;
    let growth = creep_velocity * creep_velocity * inverse * (inverse * inverse);
    (level * part + beta * u, fall * part + level * growth + beta)
}
