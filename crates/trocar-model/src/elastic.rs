//! Deformation force of the seal: two direction-dependent branches, each two joined polynomials,
//! EMS (25).
//!
//! A seal that is deformed one way and back shows two branches: the force `F_u` while the
//! deflection rises and `F_d` while it falls. Between them the force depends on the past. With
//!
//! ```text
//! M = (F_u + F_d)/2        h = (F_u - F_d)/2, clipped at 0        q in [-h, h]
//! F_e = M(z) + q           q⁺ = clamp(q + κ·(z⁺ - z), -h(z⁺), h(z⁺))
//! ```
//!
//! the element is a spring M beside a slip element of stiffness κ whose limit is the half gap h.
//! For κ >= max|h'|
//!
//! - a full reversal follows the measured branches exactly: h never widens faster than q can follow;
//! - the force is Lipschitz in the deflection, |dF_e/dz| <= |M'| + κ, so a partial reversal makes no jump;
//! - no closed motion yields work: ∫M dz + q²/(2κ) is stored, and what is not stored is lost;
//! - returning to a turning point restores the force there (return-point memory);
//! - one clamp is exact for a monotone motion of any length.
//!
//! Outside [-c, c] the two branches are one straight line, h = 0.

use crate::direction::Direction;
use crate::error::{ParamError, finite, in_range};
pub use crate::parameter::MAX_DEGREE;
use crate::parameter::Quantity;

pub(crate) const COUNT: usize = MAX_DEGREE + 1;

/// Least slope outside [-c, c], as a fraction of the mean slope of the branch over [-c, c].
///
/// A fitted polynomial may be flat or falling at its end; the line that continues it must rise, or
/// the element would never reach the sliding force (the hypothesis of EMS proposition III.1).
pub(crate) const END_SLOPE_FLOOR: f64 = 0.05;

/// Allowed force jump at a join, as a fraction of the force span of the branch.
const JOIN_TOLERANCE: f64 = 1e-6;

/// Allowed mismatch of two interval ends, as a fraction of the interval.
const END_TOLERANCE: f64 = 1e-9;

/// Default κ over the steepest sampled slope of h: covers what sampling may miss.
const YIELD_STIFFNESS_MARGIN: f64 = 1.01;

/// log2 of the order p of the means by which the largest |h'| is approached smoothly: without their
/// correction they miss a smooth peak by 2^(-1/2p), half a per cent, and one at an end of [-c, c] by
/// twice as much.
const PEAK_ORDER: u32 = 6;

/// Samples of each polynomial piece when its extremes are sought.
const SAMPLES: usize = 256;

/// One polynomial on [from, to], in the Legendre basis of its own interval.
///
/// ```text
/// F(z) = Σ l_k·P_k(t)       t = (2z - from - to)/(to - from)        l_k in N        (25)
/// ```
///
/// In this basis the fit is well conditioned and the coefficients have the unit of the result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    from: f64,
    to: f64,
    count: usize,
    legendre: [f64; COUNT],
    /// The same polynomial as Σ a_k·t^k.
    power: [f64; COUNT],
}

impl Piece {
    /// A polynomial on [`from`, `to`] (m) with Legendre coefficients `legendre` (N), lowest degree
    /// first.
    ///
    /// # Errors
    /// An empty or infinite interval, no or too many coefficients, a coefficient that is not
    /// finite.
    pub fn new(from: f64, to: f64, legendre: &[f64]) -> Result<Self, ParamError> {
        finite("from", from)?;
        finite("to", to)?;
        if to <= from || !(to - from).is_finite() || !(2.0 / (to - from)).is_finite() {
            return Err(ParamError::EmptyInterval { from, to });
        }
        let count = legendre.len();
        if count == 0 || count > COUNT {
            return Err(ParamError::CoefficientCount { count });
        }
        let mut own = [0.0; COUNT];
        for (slot, &value) in own.iter_mut().zip(legendre) {
            *slot = finite("legendre coefficient", value)?;
        }
        Ok(Self { from, to, count, legendre: own, power: legendre_to_power(&own) })
    }

    /// The polynomial Σ θ_i·z^i with the coefficients of EMS (25), θ_i in N/m^i, on [`from`, `to`]
    /// (m).
    ///
    /// # Errors
    /// As [`Piece::new`].
    pub fn from_monomial(from: f64, to: f64, monomial: &[f64]) -> Result<Self, ParamError> {
        let count = monomial.len();
        if count == 0 || count > COUNT {
            return Err(ParamError::CoefficientCount { count });
        }
        let mut padded = [0.0; COUNT];
        for (slot, &value) in padded.iter_mut().zip(monomial) {
            *slot = value;
        }
        let power = compose(&padded, 0.5 * (to - from), 0.5 * (to + from));
        let legendre = power_to_legendre(&power);
        Self::new(from, to, legendre.get(..count).unwrap_or(&legendre))
    }

    /// Left end, m.
    pub fn from(&self) -> f64 {
        self.from
    }

    /// Right end, m.
    pub fn to(&self) -> f64 {
        self.to
    }

    /// Degree of the polynomial.
    pub fn degree(&self) -> usize {
        self.count - 1
    }

    /// Legendre coefficients, N, lowest degree first.
    pub fn legendre(&self) -> &[f64] {
        self.legendre.get(..self.count).unwrap_or(&self.legendre)
    }

    /// The coefficients θ_i of EMS (25) about z = 0, N/m^i. For reporting: badly conditioned for
    /// evaluation.
    pub fn monomial(&self) -> [f64; COUNT] {
        let scale = 2.0 / (self.to - self.from);
        compose(&self.power, scale, -0.5 * (self.from + self.to) * scale)
    }

    /// Force at deflection `z` (m), N. Outside the interval the polynomial itself is continued.
    pub fn force(&self, z: f64) -> f64 {
        horner(&self.power, self.local(z)).0
    }

    /// dF/dz at deflection `z` (m), N/m.
    pub fn stiffness(&self, z: f64) -> f64 {
        horner(&self.power, self.local(z)).1 * 2.0 / (self.to - self.from)
    }

    fn local(&self, z: f64) -> f64 {
        ((z - self.from) + (z - self.to)) / (self.to - self.from)
    }
}

/// One branch of the deformation force: two polynomials joined without a force jump, EMS (25).
///
/// The slope may jump at the join (the seal snaps through there). Outside its interval the branch
/// goes on as a straight line with the slope of its end, at least `END_SLOPE_FLOOR` of its mean
/// slope.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Branch {
    left: Piece,
    right: Piece,
}

impl Branch {
    /// Joins `left` and `right`.
    ///
    /// # Errors
    /// The pieces do not meet, the force jumps at the join, the outer ends are not at -c and +c, or
    /// the force at the right end does not exceed the force at the left end.
    pub fn new(left: Piece, right: Piece) -> Result<Self, ParamError> {
        let width = right.to - left.from;
        if (left.to - right.from).abs() > END_TOLERANCE * width {
            return Err(ParamError::PiecesApart { left_ends: left.to, right_starts: right.from });
        }
        let half_width = right.to;
        if (left.from + right.to).abs() > END_TOLERANCE * width {
            return Err(ParamError::IntervalNotCentred {
                from: left.from,
                to: right.to,
                half_width,
            });
        }
        let (at_left, at_right) = (left.force(left.from), right.force(right.to));
        if at_right <= at_left || !(at_right - at_left).is_finite() {
            return Err(ParamError::EndForcesNotRising { at_left, at_right });
        }
        let (before, after) = (left.force(left.to), right.force(right.from));
        if (before - after).abs() > JOIN_TOLERANCE * (at_right - at_left) {
            return Err(ParamError::ForceJump { join: left.to, left: before, right: after });
        }
        Ok(Self { left, right })
    }

    /// The join a of EMS (25), m.
    pub fn join(&self) -> f64 {
        self.left.to
    }

    /// The piece below the join.
    pub fn left(&self) -> &Piece {
        &self.left
    }

    /// The piece above the join.
    pub fn right(&self) -> &Piece {
        &self.right
    }

    /// c, m.
    pub fn half_width(&self) -> f64 {
        self.right.to
    }

    /// Force at deflection `z` (m), N.
    pub fn force(&self, z: f64) -> f64 {
        let (from, to) = (self.left.from, self.right.to);
        if z > to {
            self.right.force(to) + self.stiffness(z) * (z - to)
        } else if z < from {
            self.left.force(from) + self.stiffness(z) * (z - from)
        } else {
            self.piece(z).force(z)
        }
    }

    /// dF/dz at deflection `z` (m), N/m; at the join the slope of the right piece.
    pub fn stiffness(&self, z: f64) -> f64 {
        let (from, to) = (self.left.from, self.right.to);
        if z > to {
            self.right.stiffness(to).max(self.slope_floor())
        } else if z < from {
            self.left.stiffness(from).max(self.slope_floor())
        } else {
            self.piece(z).stiffness(z)
        }
    }

    fn piece(&self, z: f64) -> &Piece {
        if z < self.left.to { &self.left } else { &self.right } // EMS (25): "if z < a ... else"
    }

    fn slope_floor(&self) -> f64 {
        let (from, to) = (self.left.from, self.right.to);
        END_SLOPE_FLOOR * (self.right.force(to) - self.left.force(from)) / (to - from)
    }
}

/// M and h over one span between neighbouring joins, as power series of t in [-1, 1].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Span {
    pub(crate) mid: f64,
    pub(crate) inverse_half: f64,
    /// [M, h] coefficient by coefficient, N: side by side so that both are evaluated in one vector.
    pub(crate) force: [[f64; 2]; COUNT],
    /// [dM/dz, dh/dz], N/m.
    pub(crate) slope: [[f64; 2]; COUNT],
}

/// The deformation force F_e of one seal: mid curve M, half gap h and yield stiffness κ (module
/// documentation).
///
/// Outside [-c, c]: h = 0 and M is a straight line, with the end slope of `F_u` above +c and of
/// `F_d` below -c, so that the slope is continuous for the motion that goes out there; a floor of
/// `END_SLOPE_FLOOR` keeps it rising.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeformationForce {
    insertion: Branch,
    withdrawal: Branch,
    half_width: f64,
    yield_stiffness: f64,
    /// The two inner joins, ascending.
    pub(crate) joins: [f64; 2],
    pub(crate) spans: [Span; 3],
    /// M at -c and +c.
    pub(crate) end_force: [f64; 2],
    pub(crate) end_stiffness: [f64; 2],
}

/// M, h and their slopes at one deflection.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Local {
    pub(crate) mid: f64,
    pub(crate) gap: f64,
    pub(crate) mid_slope: f64,
    pub(crate) gap_slope: f64,
}

impl DeformationForce {
    /// Deformation force with branch `insertion` = F_u for a growing and `withdrawal` = F_d for a
    /// falling deflection.
    ///
    /// `yield_stiffness` = κ, N/m; `None` takes 1.01 times the steepest slope of h, the softest law
    /// that follows both branches exactly.
    ///
    /// # Errors
    /// The branches span different intervals, or κ is below the steepest slope of h.
    pub fn new(
        insertion: Branch,
        withdrawal: Branch,
        yield_stiffness: Option<f64>,
    ) -> Result<Self, ParamError> {
        let half_width = insertion.half_width();
        let (from, to) = (withdrawal.left.from, withdrawal.right.to);
        if (to - half_width).abs() > END_TOLERANCE * half_width {
            return Err(ParamError::IntervalNotCentred { from, to, half_width });
        }
        let joins =
            [insertion.join().min(withdrawal.join()), insertion.join().max(withdrawal.join())];
        let bounds = [-half_width, joins[0], joins[1], half_width];
        let span =
            |k: usize, left: f64, right: f64| Span::new(&insertion, &withdrawal, left, right, k);
        let spans = [
            span(0, bounds[0], bounds[1]),
            span(1, bounds[1], bounds[2]),
            span(2, bounds[2], bounds[3]),
        ];
        let mean = |z: f64| 0.5 * (insertion.force(z) + withdrawal.force(z));
        let mut this = Self {
            insertion,
            withdrawal,
            half_width,
            yield_stiffness: 0.0,
            joins,
            spans,
            end_force: [mean(-half_width), mean(half_width)],
            end_stiffness: [
                withdrawal.left.stiffness(-half_width).max(withdrawal.slope_floor()),
                insertion.right.stiffness(half_width).max(insertion.slope_floor()),
            ],
        };
        this.yield_stiffness = this.checked_yield_stiffness(yield_stiffness)?;
        Ok(this)
    }

    /// A linear spring without hysteresis, `stiffness` in N/m > 0, on [-`half_width`, `half_width`]
    /// in m.
    ///
    /// # Errors
    /// A value that is not positive and finite.
    pub fn linear(stiffness: f64, half_width: f64) -> Result<Self, ParamError> {
        in_range(Quantity::Stiffness, stiffness)?;
        in_range(Quantity::HalfWidth, half_width)?;
        let half_force = 0.5 * stiffness * half_width;
        let left = Piece::new(-half_width, 0.0, &[-half_force, half_force])?;
        let right = Piece::new(0.0, half_width, &[half_force, half_force])?;
        let branch = Branch::new(left, right)?;
        Self::new(branch, branch, None)
    }

    /// c, m.
    pub fn half_width(&self) -> f64 {
        self.half_width
    }

    /// The branch F_u.
    pub fn insertion(&self) -> &Branch {
        &self.insertion
    }

    /// The branch F_d.
    pub fn withdrawal(&self) -> &Branch {
        &self.withdrawal
    }

    /// The branch that a full stroke in `direction` follows.
    pub fn branch(&self, direction: Direction) -> &Branch {
        match direction {
            Direction::Insertion => &self.insertion,
            Direction::Withdrawal => &self.withdrawal,
        }
    }

    /// κ, N/m.
    pub fn yield_stiffness(&self) -> f64 {
        self.yield_stiffness
    }

    /// The default κ, N/m, to within half a per cent, but differentiable in the coefficients even
    /// where h is equally steep at several deflections.
    ///
    /// ```text
    /// κ = 1.01·2^(1/2p)·(∫|h'|^2p dz / ∫|h'|^p dz)^(1/p)      p = 64
    /// ```
    pub fn smooth_yield_stiffness(&self) -> f64 {
        let mut steepest = 0.0_f64;
        self.sample(0.0, |local, _| steepest = steepest.max(local.gap_slope.abs()));
        if steepest == 0.0 {
            return self.yield_stiffness;
        }
        let raised = |value: f64| (0..PEAK_ORDER).fold(value, |power, _| power * power);
        let (mut single, mut double) = (0.0, 0.0);
        self.sample(0.0, |local, weight| {
            let power = raised(local.gap_slope.abs() / steepest);
            single += weight * power;
            double += weight * power * power;
        });
        let ratio = core::f64::consts::SQRT_2 * double / single;
        let root = (0..PEAK_ORDER).fold(ratio, |root, _| libm::sqrt(root));
        // A peak in a short span has little weight.
        steepest * (YIELD_STIFFNESS_MARGIN * root).max(1.0)
    }

    /// Slopes of the straight lines below -c and above +c, N/m, both positive.
    pub fn end_stiffness(&self) -> (f64, f64) {
        (self.end_stiffness[0], self.end_stiffness[1])
    }

    /// M(z), N.
    pub fn mid(&self, z: f64) -> f64 {
        self.mid_and_gap(z).0
    }

    /// h(z) >= 0, N; 0 outside [-c, c].
    pub fn half_gap(&self, z: f64) -> f64 {
        self.mid_and_gap(z).1
    }

    /// Force and yield force after a monotone motion from deflection `from` with yield force `q` to
    /// deflection `to`.
    #[inline(always)]
    pub(crate) fn reach(&self, from: f64, q: f64, to: f64) -> (f64, f64) {
        let (mid, gap) = self.mid_and_gap(to);
        let trial = q + self.yield_stiffness * (to - from);
        let q = if trial > gap {
            gap
        } else if trial < -gap {
            -gap
        } else {
            trial
        };
        (mid + q, q)
    }

    /// As [`Self::reach`], with the slope of the force for a motion that goes on in direction `to`
    /// - `from`.
    #[inline(always)]
    pub(crate) fn reach_with_slope(&self, from: f64, q: f64, to: f64) -> (f64, f64, f64) {
        let Local { mid, gap, mid_slope, gap_slope } = self.local(to);
        let trial = q + self.yield_stiffness * (to - from);
        let (q, slope) = if trial > gap {
            (gap, mid_slope + gap_slope)
        } else if trial < -gap {
            (-gap, mid_slope - gap_slope)
        } else {
            (trial, mid_slope + self.yield_stiffness)
        };
        (mid + q, q, slope)
    }

    /// Force at an end of [-c, c], the upper or the lower, and the slope beyond it.
    pub(crate) fn end(&self, upper: bool) -> (f64, f64) {
        let k = usize::from(upper);
        (self.end_force[k], self.end_stiffness[k])
    }

    #[inline(always)]
    pub(crate) fn mid_and_gap(&self, z: f64) -> (f64, f64) {
        if z > self.half_width {
            return (self.end_force[1] + self.end_stiffness[1] * (z - self.half_width), 0.0);
        }
        if z < -self.half_width {
            return (self.end_force[0] + self.end_stiffness[0] * (z + self.half_width), 0.0);
        }
        let span = self.span(z);
        let [mid, gap] = estrin(&span.force, span.local(z));
        (mid, gap.max(0.0))
    }

    // In a browser the size of the module counts for more than a fifth of the time of a step.
    #[cfg_attr(not(target_arch = "wasm32"), inline(always))]
    pub(crate) fn local(&self, z: f64) -> Local {
        let (mid, gap) = self.mid_and_gap(z);
        if z > self.half_width || z < -self.half_width {
            let mid_slope = if z > 0.0 { self.end_stiffness[1] } else { self.end_stiffness[0] };
            return Local { mid, gap, mid_slope, gap_slope: 0.0 };
        }
        let span = self.span(z);
        let [mid_slope, gap_slope] = estrin(&span.slope, span.local(z));
        // Where h is clipped it stays at zero.
        Local { mid, gap, mid_slope, gap_slope: if gap > 0.0 { gap_slope } else { 0.0 } }
    }

    fn span(&self, z: f64) -> &Span {
        let [below, between, above] = &self.spans;
        if z < self.joins[0] {
            below
        } else if z < self.joins[1] {
            between
        } else {
            above
        }
    }

    /// The span of [`Self::span`] and the deflections [from, to) for which it is the one.
    pub(crate) fn span_around(&self, z: f64) -> (&Span, f64, f64) {
        let [below, between, above] = &self.spans;
        let [first, last] = self.joins;
        if z < first {
            (below, f64::NEG_INFINITY, first)
        } else if z < last {
            (between, first, last)
        } else {
            (above, last, f64::INFINITY)
        }
    }

    /// The interval outside which both branches rise, EMS (15): from the first to the last
    /// deflection in [-c, c] where dF_u/dz <= 0 or dF_d/dz <= 0. `None` when both rise everywhere.
    pub fn softening_interval(&self) -> Option<(f64, f64)> {
        let softens = |z: f64| self.least_branch_slope(z) <= 0.0;
        let step = 2.0 * self.half_width / (4 * SAMPLES) as f64;
        let grid = |k: usize| (-self.half_width + step * k as f64).min(self.half_width);
        let first = (0..=4 * SAMPLES).find(|&k| softens(grid(k)))?;
        let last = (0..=4 * SAMPLES).rev().find(|&k| softens(grid(k)))?;
        let from = if first == 0 { grid(0) } else { edge(softens, grid(first), grid(first - 1)) };
        let to = if last == 4 * SAMPLES {
            grid(last)
        } else {
            edge(softens, grid(last), grid(last + 1))
        };
        Some((from, to))
    }

    fn least_branch_slope(&self, z: f64) -> f64 {
        let local = self.local(z);
        local.mid_slope - local.gap_slope.abs()
    }

    /// Over [-c, c]: highest force, lowest force, least branch slope.
    pub(crate) fn extremes(&self) -> Extremes {
        let mut extremes = Extremes {
            highest_force: self.end_force[1],
            lowest_force: self.end_force[0],
            least_slope: self.end_stiffness[0].min(self.end_stiffness[1]),
        };
        self.sample(0.0, |local, _| {
            extremes.highest_force = extremes.highest_force.max(local.mid + local.gap);
            extremes.lowest_force = extremes.lowest_force.min(local.mid - local.gap);
            extremes.least_slope =
                extremes.least_slope.min(local.mid_slope - local.gap_slope.abs());
        });
        extremes
    }

    fn checked_yield_stiffness(&self, given: Option<f64>) -> Result<f64, ParamError> {
        // At the ends h is 0 up to rounding, which must not decide whether its slope there counts:
        // it does for κ, and does not against a given one.
        let [low, high] = self.end_force;
        let rounding = END_TOLERANCE * low.abs().max(high.abs());
        let steepest_above = |least_gap: f64| {
            let mut steepest = 0.0_f64;
            self.sample(least_gap, |local, _| steepest = steepest.max(local.gap_slope.abs()));
            steepest
        };
        let Some(given) = given else {
            return Ok(YIELD_STIFFNESS_MARGIN * steepest_above(-rounding));
        };
        in_range(Quantity::YieldStiffness, given)?;
        let steepest = steepest_above(rounding);
        if given < steepest {
            return Err(ParamError::YieldStiffnessTooLow { given, minimum: steepest });
        }
        Ok(given)
    }

    /// Calls `see` on a grid over each span, its two ends included, with the length, m, for which a
    /// sample stands; the slope of h is 0 where h is not above `least_gap`.
    fn sample(&self, least_gap: f64, mut see: impl FnMut(Local, f64)) {
        let bounds = [-self.half_width, self.joins[0], self.joins[1], self.half_width];
        for ((span, &from), &to) in self.spans.iter().zip(&bounds).zip(bounds.iter().skip(1)) {
            if to <= from {
                continue;
            }
            for k in 0..=SAMPLES {
                let t = -1.0 + 2.0 * k as f64 / SAMPLES as f64;
                let [mid, gap] = estrin(&span.force, t);
                let [mid_slope, gap_slope] = estrin(&span.slope, t);
                let gap_slope = if gap > least_gap { gap_slope } else { 0.0 };
                let part = if k == 0 || k == SAMPLES { 0.5 } else { 1.0 };
                let length = part * (to - from) / SAMPLES as f64;
                see(Local { mid, gap: gap.max(0.0), mid_slope, gap_slope }, length);
            }
        }
    }
}

/// By how much M and h of N deformation forces exceed those of another at the same deflection, to
/// first order: each polynomial piece is continued beyond its joins.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ShapeDifference<const N: usize> {
    /// [M, h] over the spans of the other, by powers.
    spans: [[[[f64; N]; 2]; COUNT]; 3],
    end_force: [[f64; N]; 2],
    end_stiffness: [[f64; N]; 2],
    half_width: [f64; N],
    pub(crate) yield_stiffness: [f64; N],
}

/// Where a deflection lies: beyond an end by so much (m), or in a span at t; and whether h is
/// clipped there.
#[derive(Clone, Copy, Debug)]
pub(crate) enum DeflectionLocation {
    Beyond { upper: bool, excess: f64 },
    Within { span: usize, t: f64, clipped: bool },
}

impl<const N: usize> ShapeDifference<N> {
    pub(crate) const NONE: Self = Self {
        spans: [[[[0.0; N]; 2]; COUNT]; 3],
        end_force: [[0.0; N]; 2],
        end_stiffness: [[0.0; N]; 2],
        half_width: [0.0; N],
        yield_stiffness: [0.0; N],
    };

    /// What `other` has more than `own`.
    pub(crate) fn set(&mut self, i: usize, own: &DeformationForce, other: &DeformationForce) {
        for (k, (span, all)) in own.spans.iter().zip(&mut self.spans).enumerate() {
            let Span { mid, inverse_half, force, .. } = span;
            if *inverse_half <= 0.0 {
                continue;
            }
            let [up, down] =
                [(&own.insertion, &other.insertion), (&own.withdrawal, &other.withdrawal)].map(
                    |(own, its)| {
                        let is_left = k == 0 || (k == 1 && *mid < own.join());
                        let piece = if is_left { &its.left } else { &its.right };
                        restrict(piece, *mid, 1.0 / inverse_half)
                    },
                );
            for ((([mid, gap], u), d), own) in all.iter_mut().zip(&up).zip(&down).zip(force) {
                (mid[i], gap[i]) = (0.5 * (u + d) - own[0], 0.5 * (u - d) - own[1]);
            }
        }
        for k in 0..2 {
            self.end_force[k][i] = other.end_force[k] - own.end_force[k];
            self.end_stiffness[k][i] = other.end_stiffness[k] - own.end_stiffness[k];
        }
        self.half_width[i] = other.half_width - own.half_width;
        self.yield_stiffness[i] = other.yield_stiffness - own.yield_stiffness;
    }
}

impl DeformationForce {
    /// Where `z`, m, lies.
    pub(crate) fn locate(&self, z: f64) -> DeflectionLocation {
        if z.abs() > self.half_width {
            return DeflectionLocation::Beyond {
                upper: z > 0.0,
                excess: z.abs() - self.half_width,
            };
        }
        let span = if z < self.joins[0] { 0 } else { 1 + usize::from(z >= self.joins[1]) };
        let own = &self.spans[span];
        let t = own.local(z);
        DeflectionLocation::Within { span, t, clipped: estrin(&own.force, t)[1] <= 0.0 }
    }

    /// `difference` of M and h at `location`, N.
    #[inline(always)]
    pub(crate) fn more_at<const N: usize>(
        &self,
        difference: &ShapeDifference<N>,
        location: &DeflectionLocation,
    ) -> [[f64; N]; 2] {
        match *location {
            DeflectionLocation::Within { span, t, clipped } => {
                let [mid, gap] = series(&difference.spans[span], t);
                [mid, if clipped { [0.0; N] } else { gap }]
            }
            DeflectionLocation::Beyond { upper, excess } => {
                let (k, outwards) = if upper { (1, 1.0) } else { (0, -1.0) };
                let own = self.end_stiffness[k];
                let mid = core::array::from_fn(|i| {
                    let change =
                        difference.end_stiffness[k][i] * excess - own * difference.half_width[i];
                    difference.end_force[k][i] + outwards * change
                });
                [mid, [0.0; N]]
            }
        }
    }
}

/// What the element must know of a deformation force before it can choose its solver.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Extremes {
    pub(crate) highest_force: f64,
    pub(crate) lowest_force: f64,
    pub(crate) least_slope: f64,
}

impl Span {
    /// The span `index` (0, 1, 2) between the joins, from `left` to `right`; an empty one is never
    /// evaluated.
    fn new(insertion: &Branch, withdrawal: &Branch, left: f64, right: f64, index: usize) -> Self {
        let half = 0.5 * (right - left);
        let mid = 0.5 * (left + right);
        if half <= 0.0 || !(1.0 / half).is_finite() {
            let none = [[0.0; 2]; COUNT];
            return Self { mid, inverse_half: 0.0, force: none, slope: none };
        }
        let up = restrict(piece_over(insertion, mid, index), mid, half);
        let down = restrict(piece_over(withdrawal, mid, index), mid, half);
        let mut force = [[0.0; 2]; COUNT];
        for (pair, (u, d)) in force.iter_mut().zip(up.iter().zip(&down)) {
            *pair = [0.5 * (u + d), 0.5 * (u - d)];
        }
        let mut slope = [[0.0; 2]; COUNT];
        for (k, (to, from)) in slope.iter_mut().zip(force.iter().skip(1)).enumerate() {
            let factor = (k + 1) as f64 / half;
            *to = [from[0] * factor, from[1] * factor];
        }
        Self { mid, inverse_half: 1.0 / half, force, slope }
    }

    #[inline(always)]
    fn local(&self, z: f64) -> f64 {
        (z - self.mid) * self.inverse_half
    }
}

/// The piece of `branch` that covers the span with this index and middle.
fn piece_over(branch: &Branch, mid: f64, index: usize) -> &Piece {
    match index {
        0 => &branch.left,
        2 => &branch.right,
        _ => branch.piece(mid),
    }
}

/// `piece` as a power series of t in [-1, 1] over [mid - half, mid + half].
fn restrict(piece: &Piece, mid: f64, half: f64) -> [f64; COUNT] {
    compose(&piece.power, 2.0 * half / (piece.to - piece.from), piece.local(mid))
}

/// Coefficients of p(scale·t + shift).
fn compose(p: &[f64; COUNT], scale: f64, shift: f64) -> [f64; COUNT] {
    let mut result = [0.0; COUNT];
    for &coefficient in p.iter().rev() {
        let mut carry = 0.0;
        for slot in &mut result {
            let old = *slot;
            *slot = old * shift + carry;
            carry = old * scale;
        }
        if let Some(constant) = result.first_mut() {
            *constant += coefficient;
        }
    }
    result
}

/// Σ l_k·P_k(t) as a power series, by P_(k+1) = ((2k+1)·t·P_k - k·P_(k-1))/(k+1).
fn legendre_to_power(legendre: &[f64; COUNT]) -> [f64; COUNT] {
    let mut sum = [0.0; COUNT];
    let mut before = [0.0; COUNT];
    let mut current = [0.0; COUNT];
    current[0] = 1.0;
    for (k, &weight) in legendre.iter().enumerate() {
        for (slot, &value) in sum.iter_mut().zip(&current) {
            *slot += weight * value;
        }
        let k = k as f64;
        let mut next = [0.0; COUNT];
        let mut shifted = 0.0;
        for ((slot, &value), &old) in next.iter_mut().zip(&current).zip(&before) {
            *slot = ((2.0 * k + 1.0) * shifted - k * old) / (k + 1.0);
            shifted = value;
        }
        before = current;
        current = next;
    }
    sum
}

/// A power series as Σ l_k·P_k(t): Horner's scheme in the Legendre basis, t·P_k = ((k+1)·P_(k+1) +
/// k·P_(k-1))/(2k+1).
fn power_to_legendre(power: &[f64; COUNT]) -> [f64; COUNT] {
    let mut result = [0.0; COUNT];
    for &coefficient in power.iter().rev() {
        let mut next = [0.0; COUNT];
        for (k, &value) in result.iter().enumerate() {
            let part = value / (2 * k + 1) as f64;
            if let Some(above) = next.get_mut(k + 1) {
                *above += (k + 1) as f64 * part;
            }
            if k > 0 {
                next[k - 1] += k as f64 * part;
            }
        }
        next[0] += coefficient;
        result = next;
    }
    result
}

/// Value and derivative of a power series.
fn horner(power: &[f64; COUNT], t: f64) -> (f64, f64) {
    power.iter().rev().fold((0.0, 0.0), |(value, slope), &a| (value * t + a, slope * t + value))
}

/// Two power series at once by Estrin's scheme: a short dependency chain, so faster than Horner
/// without fused multiply-add.
#[inline(always)]
fn estrin(a: &[[f64; 2]; COUNT], t: f64) -> [f64; 2] {
    let t2 = t * t;
    let t4 = t2 * t2;
    let lane = |i: usize| {
        let low = (a[0][i] + a[1][i] * t) + (a[2][i] + a[3][i] * t) * t2;
        let high = (a[4][i] + a[5][i] * t) + (a[6][i] + a[7][i] * t) * t2;
        low + high * t4
    };
    [lane(0), lane(1)]
}

/// Two times N power series by Horner's scheme: N chains hide each other's waiting.
#[inline(always)]
fn series<const N: usize>(a: &[[[f64; N]; 2]; COUNT], t: f64) -> [[f64; N]; 2] {
    let mut sum = a[COUNT - 1];
    for more in a[..COUNT - 1].iter().rev() {
        for (sum, more) in sum.iter_mut().zip(more) {
            *sum = core::array::from_fn(|i| sum[i] * t + more[i]);
        }
    }
    sum
}

/// The edge of a region between a point `inside` and a point `outside`, by bisection.
fn edge(is_inside: impl Fn(f64) -> bool, mut inside: f64, mut outside: f64) -> f64 {
    for _ in 0..60 {
        let middle = 0.5 * (inside + outside);
        if is_inside(middle) {
            inside = middle;
        } else {
            outside = middle;
        }
    }
    inside
}
