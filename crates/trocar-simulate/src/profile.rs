//! Position-dependent force: how a seal's friction depends on the position along the shaft or in
//! the bore.
//!
//! ```text
//! F_reading = F_0(x) + gain(x)·F_seal        x position, m
//! ```
//! F_0 (N) and gain (1) are linear between equally spaced knots. A locally rougher shaft raises the
//! gain there; a slope, a cable or a bore that is not round shifts F_0. Outside the range in which
//! a profile was measured, F_0 fades linearly to 0 and the gain to 1 over [`FADE`] of the range.
//! Beyond that only the force of the seal remains.
//!
//! # Gauge
//!
//! A factor could move from the gain to the seal's force, and a constant from F_0 to the sensor
//! offset. The mean gain over the range is 1, so that the seal's parameters keep their meaning. A
//! fitted F_0 has the mean 0 over the range, and the sensor offset is separate
//! ([`ProfileFit::offset_n`]).
//!
//! # Passivity
//!
//! F_0(x) is the gradient of a potential and does no work over a closed motion. For the remaining
//! force, let z be measured from a deflection at which the mid curve M is zero, u = x − z be the
//! position where the seal grips, q its yield force, q = κ·(x − w) (see `trocar_model::elastic`),
//! and
//!
//! ```text
//! Φ = ∫_u^x gain(s)·M(s − u) ds + ∫_w^x gain(s)·κ·(s − w) ds
//! ```
//! the stored energy with varying gain. Driving the seal by dx takes the work gain·F·dx, of which
//!
//! ```text
//! gain·F·dx − dΦ = gain·σ·dz²/dt + [gain(x)·(F − M − q)]·du
//!                 + [∫_u^x gain(s)·M'(s − u) ds]·du + [∫_w^x gain(s)·κ ds]·dw
//! ```
//! is dissipated. While the seal sticks, du = 0, and dw has the sign of q, so the dissipated energy
//! is not negative. While it slides, du has the sign of F. So **where the mid curve rises, every
//! positive gain is dissipative**; relaxing arms are springs of the same kind, whose end follows
//! their force. Where the mid curve falls by D up to z (a seal that snaps through) and rises by R,
//! R − D + |q| ≥ F_min holds while the seal slides, with F_min the smallest sliding force. With the
//! smallest (least) and the largest (most) gain over the range, including the fades outside it, no
//! energy is released if least·(R + |q|) ≥ most·D, and thus if most/least ≤ 1 + F_min/D:
//!
//! ```text
//! max|dgain/dx|·ℓ <= min gain        ℓ = D·max(|z| at the end of the curve/F_min, 1/K)      K stiffness beyond the end
//! ```
//! ([`storage_length`], [`is_passive`]): sufficient, not necessary.

use trocar_model::{Element, PositionProfile, SlidingFriction, Stages};

pub use trocar_model::profile::FADE;
pub use trocar_runtime::profile::{Departure, LEAST_DEPARTURE, MEAN_TOLERANCE, MOST_KNOTS};

pub use fit::{NoProfile, ProfileFit, ProfileSample, cycles, fit};

mod banded;
mod fit;

/// Whether the gain varies so slowly that no closed motion of a seal with this `storage_length` (m)
/// releases energy.
pub fn is_passive<K: AsRef<[f64]>>(profile: &PositionProfile<K>, storage_length: f64) -> bool {
    let steepness = profile.steepness();
    steepness == 0.0 || steepness * storage_length <= 1.0
}

/// ℓ of a seal, m: that of the element for which it is longest.
pub fn longest_storage(stages: &Stages) -> f64 {
    stages.elements().iter().map(storage_length).fold(0.0, f64::max)
}

/// ℓ, m: the fall of the seal's mid curve divided by the smallest sliding force, times its half
/// width; 0 for a curve that rises throughout.
///
/// ```text
/// ℓ = max over both sides of D·max(|z|/min(F_c, F_s), 1/K)
/// ```
/// with D the sum of all falls between the deflection without force and the end at z, or a smaller
/// z at which the seal is certain to slide, and K the stiffness beyond it.
pub fn storage_length(element: &Element) -> f64 {
    const CELLS: usize = 2000;
    let params = element.params();
    let deformation = &params.deformation;
    let least = |s: &SlidingFriction| s.coulomb_force.min(s.static_force);
    let least_force = least(&params.insertion).min(least(&params.withdrawal));
    let c = deformation.half_width();
    let points: Vec<(f64, f64)> = (0..=CELLS)
        .map(|k| c * (2.0 * k as f64 / CELLS as f64 - 1.0))
        .map(|z| (z, deformation.mid(z)))
        .collect();
    let most_force = params.insertion.static_force.max(params.withdrawal.static_force);
    let is_reached = |z: f64, mid: f64| mid.abs() <= most_force + deformation.half_gap(z);
    let rest = points.partition_point(|(_, mid)| *mid <= 0.0).clamp(1, CELLS);
    let reached = |&&(z, mid): &&(f64, f64)| is_reached(z, mid);
    let last = rest + points[rest..].iter().take_while(reached).count().saturating_sub(1);
    let first = rest - points[..rest].iter().rev().take_while(reached).count();
    let fall = |part: &[(f64, f64)]| {
        part.windows(2).map(|pair| (pair[0].1 - pair[1].1).max(0.0)).sum::<f64>()
    };
    let (low, high) = deformation.end_stiffness();
    let side = |part: &[(f64, f64)], end: f64, stiffness: f64| {
        let fall = fall(part);
        // Rounding errors of the samples of a rising curve.
        let fall = if fall > 1e-9 * least_force { fall } else { 0.0 };
        let reach = ((end - points[rest].0).abs() / least_force).max(if stiffness > 0.0 {
            1.0 / stiffness
        } else {
            0.0
        });
        fall * reach
    };
    let length = side(&points[first..=rest], -c, low).max(side(&points[rest..=last], c, high));
    // A creeping contact slips at any force: no bound holds for a curve that falls.
    if length > 0.0 && params.creep_velocity > 0.0 { f64::INFINITY } else { length }
}
