//! Random plausible seals, motions, and a slow reference integrator that shares nothing with the
//! step of the library but the deformation force.
#![allow(dead_code)] // every test binary uses its own part

pub(crate) mod promise;

use proptest::prelude::*;
use trocar_model::{
    Branch, DeformationForce, Element, ElementParams, Piece, Relaxation, SealDamping,
    SlidingFriction,
};

/// Legendre coefficients of a cubic on its own interval through `from` and `to` at the ends with
/// bends `b`, `d`.
fn cubic(from: f64, to: f64, b: f64, d: f64) -> [f64; 4] {
    [0.5 * (from + to) - b, 0.5 * (to - from) - d, b, d]
}

/// Numbers of a random seal, all plain numbers so that failing cases shrink.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seal {
    pub(crate) half_width: f64,
    pub(crate) insertion_force: f64,
    pub(crate) withdrawal_force: f64,
    pub(crate) viscous: [f64; 2],
    pub(crate) join: f64,
    pub(crate) level: f64,
    pub(crate) gap: f64,
    pub(crate) bends: [f64; 4],
}

impl Seal {
    pub(crate) fn params(&self) -> ElementParams {
        let c = self.half_width;
        let a = self.join * c;
        let (low, high) = (-self.withdrawal_force, self.insertion_force);
        let scale = self.insertion_force.min(self.withdrawal_force);
        let up = (self.level + self.gap).min(0.8) * scale;
        let down = (self.level - self.gap).max(-0.8) * scale;
        let branch = |join: f64, middle: f64, bends: [f64; 2]| {
            let left = Piece::new(-c, join, &cubic(low, middle, bends[0] * scale, 0.0)).unwrap();
            let right = Piece::new(join, c, &cubic(middle, high, bends[1] * scale, 0.0)).unwrap();
            Branch::new(left, right).unwrap()
        };
        let [b0, b1, b2, b3] = self.bends;
        let insertion = branch(a, up, [-b0, b1]);
        let withdrawal = branch(-a, down, [-b2, b3]);
        ElementParams {
            deformation: DeformationForce::new(insertion, withdrawal, None).unwrap(),
            damping: SealDamping::ZERO,
            insertion: SlidingFriction::coulomb(self.insertion_force, self.viscous[0]),
            withdrawal: SlidingFriction::coulomb(self.withdrawal_force, self.viscous[1]),
            creep_velocity: 0.0,
            friction_lag: 0.0,
            dwell_force: 0.0,
            relaxation: Relaxation::NONE,
        }
    }

    pub(crate) fn element(&self) -> Element {
        Element::new(self.params()).unwrap()
    }
}

/// Seals of 3 to 15 mm and 0.25 to 8 N, as found in trocars; some soften inside, some are elastic
/// in places.
pub(crate) fn seals() -> impl Strategy<Value = Seal> {
    (
        3e-3..15e-3_f64,
        0.25..8.0_f64,
        0.7..1.4_f64,
        [0.0..20.0_f64, 0.0..20.0_f64],
        -0.5..0.3_f64,
        -0.1..0.3_f64,
        0.0..0.5_f64,
        [0.0..0.35_f64, 0.0..0.35_f64, 0.0..0.35_f64, 0.0..0.35_f64],
    )
        .prop_map(|(half_width, force, ratio, viscous, join, level, gap, bends)| Seal {
            half_width,
            insertion_force: force,
            withdrawal_force: force * ratio,
            viscous,
            join,
            level,
            gap,
            bends,
        })
}

/// With Stribeck friction, with and without velocity weakening, and seal damping.
pub(crate) fn general_elements() -> impl Strategy<Value = Element> {
    (seals(), 0.6..1.0_f64, 1e-3..0.1_f64, 0.7..2.5_f64, 0.0..3.0_f64).prop_map(
        |(seal, ratio, stribeck_velocity, stribeck_exponent, sigma)| {
            let mut params = seal.params();
            for sliding in [&mut params.insertion, &mut params.withdrawal] {
                sliding.coulomb_force *= ratio;
                sliding.stribeck_velocity = stribeck_velocity;
                sliding.stribeck_exponent = stribeck_exponent;
                sliding.viscous_damping += 0.01;
            }
            params.damping = SealDamping::constant(sigma);
            Element::new(params).unwrap()
        },
    )
}

/// Position at time t of a trapezoidal stroke: `speed` and `acceleration` up and down over
/// `stroke`, repeated.
pub(crate) fn trapezoid(speed: f64, acceleration: f64, stroke: f64, t: f64) -> f64 {
    let ramp = speed / acceleration;
    let half = stroke / speed + ramp;
    let phase = (t / half).floor();
    let r = t - phase * half;
    let travelled = if r < ramp {
        0.5 * acceleration * r * r
    } else if r < half - ramp {
        speed * (r - 0.5 * ramp)
    } else {
        stroke - 0.5 * acceleration * (half - r) * (half - r)
    };
    if (phase as i64) % 2 == 0 { travelled } else { stroke - travelled }
}

/// Forces at the samples from an explicit integration of the natural law
/// dz/dt = v - u, H(u) = |F|, with `parts` steps per sample and its own root search.
///
/// Forward Euler in z with the slip speed found by bisection over H: first order, so the caller
/// extrapolates or takes `parts` large. Knows nothing of return maps, θ or brackets.
pub(crate) fn brute_force(
    params: &ElementParams,
    displacements: &[f64],
    period: f64,
    parts: usize,
) -> Vec<f64> {
    let deformation = &params.deformation;
    let kappa = deformation.yield_stiffness();
    let (mut z, mut q) = (0.0_f64, 0.0_f64);
    let h = period / parts as f64;
    let mut forces = Vec::with_capacity(displacements.len());
    for displacement in displacements {
        let v = displacement / period;
        let mut force = 0.0;
        for _ in 0..parts {
            let elastic = deformation.mid(z) + q;
            let dz = h * deformation_velocity(params, elastic, v);
            z += dz;
            let gap = deformation.half_gap(z);
            q = (q + kappa * dz).clamp(-gap, gap);
        }
        let elastic = deformation.mid(z) + q;
        force += elastic + params.damping.force(deformation_velocity(params, elastic, v));
        forces.push(force);
    }
    forces
}

/// v - v_sl for which elastic + D(v - v_sl) lies on the sliding curve, or v in stick.
fn deformation_velocity(params: &ElementParams, elastic: f64, v: f64) -> f64 {
    let trial = elastic + params.damping.force(v);
    let (s, sliding) =
        if trial < 0.0 { (-1.0, &params.withdrawal) } else { (1.0, &params.insertion) };
    if s * trial <= sliding.static_force {
        return v;
    }
    let excess = |u: f64| s * (elastic + params.damping.force(v - s * u)) - sliding.force(u);
    let mut high = 1.0;
    while excess(high) > 0.0 {
        high *= 2.0;
    }
    let mut low = 0.0;
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if excess(middle) > 0.0 { low = middle } else { high = middle }
    }
    v - s * 0.5 * (low + high)
}

/// A seal whose hump (1.3 N) lies above its sliding force (1 N): it may slide before it snaps
/// through.
pub(crate) fn humped(beta: f64) -> ElementParams {
    let branch = |join: f64, middle: f64, left: f64, right: f64| {
        let left = Piece::new(-8e-3, join, &cubic(-1.0, middle, left, 0.0)).unwrap();
        let right = Piece::new(join, 8e-3, &cubic(middle, 1.0, right, 0.0)).unwrap();
        Branch::new(left, right).unwrap()
    };
    let insertion = branch(-2e-3, 1.0, -0.7, 0.4);
    let withdrawal = branch(2e-3, -1.0, -0.4, 0.7);
    let sliding = SlidingFriction::coulomb(1.0, beta);
    ElementParams {
        deformation: DeformationForce::new(insertion, withdrawal, None).unwrap(),
        damping: SealDamping::ZERO,
        insertion: sliding,
        withdrawal: sliding,
        creep_velocity: 0.0,
        friction_lag: 0.0,
        dwell_force: 0.0,
        relaxation: Relaxation::NONE,
    }
}
