//! Random plausible seals: known parameters for tests of the identification.

use trocar_model::{
    Branch, DeformationForce, Element, ElementParams, ParamError, Piece, SlidingFriction,
};

use super::noise::{Noise, Source};

/// Points at which a random shape is checked.
const CHECK_POINTS: u32 = 200;
/// Largest force of a branch before its last twentieth, as a fraction of the force at which the
/// seal slides.
const HIGHEST_INSIDE: f64 = 0.9;

/// Ranges from which seals are drawn: (lowest, highest).
///
/// The default spans reported values for trocars of 5 to 12 mm: friction up to several newtons,
/// deformations up to about a centimetre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlausibleSeals {
    /// F_c = F_s in N, uniform, positive.
    pub coulomb_force: (f64, f64),
    /// β in N s/m, log-uniform, positive.
    pub viscous_damping: (f64, f64),
    /// c in m, uniform, positive.
    pub half_width: (f64, f64),
    /// Largest relative deviation of F_c, and of β, from the mean over the two directions, 0 to
    /// 0.2.
    pub friction_asymmetry: f64,
    /// Largest relative difference of a shape value between the two branches, 0 to 0.2.
    pub branch_asymmetry: f64,
}

impl Default for PlausibleSeals {
    fn default() -> Self {
        Self {
            coulomb_force: (0.5, 6.0),
            viscous_damping: (0.5, 15.0),
            half_width: (2e-3, 9e-3),
            friction_asymmetry: 0.02,
            branch_asymmetry: 0.1,
        }
    }
}

/// A random plausible seal from the default ranges of [`PlausibleSeals`]. The same seed gives the
/// same seal.
pub fn random_plausible_seal(seed: u64) -> ElementParams {
    random_seal(&PlausibleSeals::default(), seed)
}

/// A random seal from `ranges`. The same ranges and seed give the same seal.
///
/// Friction is Coulomb and viscous, and the seal has no damping. Half of the seals snap through:
/// their branches have a hump followed by an interval of negative stiffness. The other half rise
/// throughout. The hump stays below the force at which the seal slides, the branches enclose a
/// positive gap, and [`Element::new`] accepts the result. The mean over the two directions of F_c
/// and β is within `ranges`.
pub fn random_seal(ranges: &PlausibleSeals, seed: u64) -> ElementParams {
    let mut noise = Noise::new(seed, Source::RandomSeal);
    let between = |range: (f64, f64), noise: &mut Noise| noise.uniform(range.0, range.1);
    let coulomb_force = between(ranges.coulomb_force, &mut noise);
    let half_width = between(ranges.half_width, &mut noise);
    let (low, high) = ranges.viscous_damping;
    let viscous_damping = noise.log_uniform(low, high);
    let tilt = ranges.friction_asymmetry;
    let (tilt_force, tilt_damping) = (noise.uniform(-tilt, tilt), noise.uniform(-tilt, tilt));
    let [insertion, withdrawal] = [1.0, -1.0].map(|side| {
        SlidingFriction::coulomb(
            coulomb_force * (1.0 + side * tilt_force),
            viscous_damping * (1.0 + side * tilt_damping),
        )
    });
    // Most draws pass the checks; the others are repeated.
    loop {
        let shape = Shape::draw(&mut noise);
        let other = shape.perturbed(ranges.branch_asymmetry, &mut noise);
        let forces = [insertion.static_force, withdrawal.static_force];
        if let Ok(deformation) = deformation(half_width, forces, [&shape, &other])
            && let params = ElementParams::new(deformation, insertion, withdrawal)
            && plausible(&params)
            && Element::new(params).is_ok()
        {
            return params;
        }
    }
}

/// Shape of a branch in multiples of the sliding force F and the half width c.
#[derive(Debug, Clone, Copy)]
struct Shape {
    /// Position of the join, c.
    join: f64,
    /// Force at the join, F.
    force_at_join: f64,
    /// Slope at -c, in multiples of the mean slope of the first piece.
    first_rise: f64,
    /// Slope before the join, F/c.
    slope_before: f64,
    /// Slope after the join, F/c.
    slope_after: f64,
    /// Slope at +c, in multiples of the mean slope of the second piece.
    last_rise: f64,
    /// Bulge of the two pieces, F.
    bulges: [f64; 2],
}

impl Shape {
    fn draw(noise: &mut Noise) -> Self {
        let snaps_through = noise.unit() < 0.5;
        let (force_at_join, slope_before, slope_after) = if snaps_through {
            (noise.uniform(0.2, 0.5), noise.uniform(-0.1, 0.3), noise.uniform(-0.8, -0.2))
        } else {
            (noise.uniform(-0.1, 0.4), noise.uniform(0.3, 1.0), noise.uniform(0.2, 0.6))
        };
        Self {
            join: noise.uniform(-0.45, -0.1),
            force_at_join,
            first_rise: noise.uniform(1.2, 2.6),
            slope_before,
            slope_after,
            last_rise: noise.uniform(1.2, 2.5),
            bulges: [noise.uniform(-0.05, 0.05), noise.uniform(-0.05, 0.05)],
        }
    }

    /// Every value changed by a random fraction of itself, at most `most`.
    fn perturbed(&self, most: f64, noise: &mut Noise) -> Self {
        let mut change = |value: f64| value * (1.0 + noise.uniform(-most, most));
        Self {
            join: change(self.join),
            force_at_join: change(self.force_at_join),
            first_rise: change(self.first_rise),
            slope_before: change(self.slope_before),
            slope_after: change(self.slope_after),
            last_rise: change(self.last_rise),
            bulges: self.bulges.map(&mut change),
        }
    }

    /// Two pieces from (-c, `ends.0`) to (c, `ends.1`).
    fn pieces(&self, c: f64, ends: (f64, f64)) -> Result<(Piece, Piece), ParamError> {
        let scale = 0.5 * (ends.1 - ends.0);
        let slope = scale / c;
        let (join, middle) = (self.join * c, self.force_at_join * scale);
        let first = (middle - ends.0) / (join + c);
        let last = (ends.1 - middle) / (c - join);
        let left = Quartic {
            from: (-c, ends.0, self.first_rise * first),
            to: (join, middle, self.slope_before * slope),
            bulge: self.bulges[0] * scale,
        };
        let right = Quartic {
            from: (join, middle, self.slope_after * slope),
            to: (c, ends.1, self.last_rise * last),
            bulge: self.bulges[1] * scale,
        };
        Ok((left.piece()?, right.piece()?))
    }
}

/// Quartic through two points with given slopes; `bulge` is its additional value in the middle.
struct Quartic {
    /// z in m, force in N, slope in N/m.
    from: (f64, f64, f64),
    to: (f64, f64, f64),
    bulge: f64,
}

impl Quartic {
    fn piece(&self) -> Result<Piece, ParamError> {
        let half = 0.5 * (self.to.0 - self.from.0);
        let (p0, p1) = (self.from.1, self.to.1);
        let (m0, m1) = (self.from.2 * half, self.to.2 * half);
        // Power series in t on [-1, 1]: the cubic Hermite polynomial and the bulge (1 - t²)², which
        // does not change the values and slopes at the ends.
        let a0 = 0.5 * (p0 + p1) - 0.25 * (m1 - m0) + self.bulge;
        let a1 = 0.75 * (p1 - p0) - 0.25 * (m0 + m1);
        let a2 = 0.25 * (m1 - m0) - 2.0 * self.bulge;
        let a3 = 0.25 * (m0 + m1) - 0.25 * (p1 - p0);
        let a4 = self.bulge;
        // t² = (P0 + 2 P2)/3, t³ = (3 P1 + 2 P3)/5, t⁴ = (7 P0 + 20 P2 + 8 P4)/35.
        let legendre = [
            a0 + a2 / 3.0 + a4 / 5.0,
            a1 + 0.6 * a3,
            2.0 / 3.0 * a2 + 4.0 / 7.0 * a4,
            0.4 * a3,
            8.0 / 35.0 * a4,
        ];
        Piece::new(self.from.0, self.to.0, &legendre)
    }
}

/// Branches with these static forces and shapes, insertion first; the shape of the withdrawal is
/// reflected through the origin.
fn deformation(
    c: f64,
    forces: [f64; 2],
    shapes: [&Shape; 2],
) -> Result<DeformationForce, ParamError> {
    let (left, right) = shapes[0].pieces(c, (-forces[1], forces[0]))?;
    let (first, last) = shapes[1].pieces(c, (-forces[0], forces[1]))?;
    let withdrawal = Branch::new(turned(&last)?, turned(&first)?)?;
    DeformationForce::new(Branch::new(left, right)?, withdrawal, None)
}

/// -F(-z).
fn turned(piece: &Piece) -> Result<Piece, ParamError> {
    let mut legendre = piece.legendre().to_vec();
    for even in legendre.iter_mut().step_by(2) {
        *even = -*even;
    }
    Piece::new(-piece.to(), -piece.from(), &legendre)
}

/// The seal deforms before it slides, and unloading is below loading.
fn plausible(params: &ElementParams) -> bool {
    let force = &params.deformation;
    let c = force.half_width();
    let (lowest, highest) = (-params.withdrawal.static_force, params.insertion.static_force);
    (1..CHECK_POINTS).all(|i| {
        let z = c * (2.0 * f64::from(i) / f64::from(CHECK_POINTS) - 1.0);
        let (insertion, withdrawal) = (force.insertion().force(z), force.withdrawal().force(z));
        let part = if z < 0.9 * c { HIGHEST_INSIDE } else { 1.0 };
        let mirrored = if z > -0.9 * c { HIGHEST_INSIDE } else { 1.0 };
        insertion > withdrawal && insertion < part * highest && withdrawal > mirrored * lowest
    })
}
