//! EMS as printed: mode and branch follow sgn(v_d). For reproducing the paper's figures, not for
//! use.
//!
//! ```text
//! deforming   dz/dt = v_d                      F = F_e(z) + D(v_d)                                  (10)
//!             until F reaches F_s·sgn(v_d)                                                          (12)
//! sliding     dz/dt = [g(v_d - dz/dt)·sgn(v_d) + β·v_d - F_e(z)] / (σ + β)     F = F_e(z) + D(dz/dt)  (14)
//!             until v_d changes sign
//! F_e = F_u for v_d > 0, F_d for v_d < 0                                                            (25)
//! ```
//!
//! What the paper leaves open is read like this: at v_d = 0 the element deforms with dz/dt = 0 and
//! keeps its last branch; a stop counts as a change of sign; an element that starts to deform
//! beyond its limit slides at once; with σ = β = 0 the deflection stands still while sliding.
//!
//! Where this goes wrong, and `Element` does not:
//!
//! - **Reversal while the seal is still strained beyond F_s.** At the end of a braking the seal has not yet relaxed
//!   (its time constant is β/K), but (14) ends with the sign of v_d: the element then deforms at |F| > F_s. The error
//!   grows with β/K against the braking time, to more than 1 N at β = 20 N·s/m.
//! - **Partial reversal.** The branch flips with the sign of v_d, so the force jumps by F_u - F_d: encoder noise of 4 µm
//!   turns into 1.5 N.
//! - **Hold.** sgn(0) decides whether a hold keeps the force or lets it decay to zero.
//! - **sgn(v_sl) read as sgn(v_d).** A seal that snaps ahead of the instrument is pulled on instead of braked.
//!
//! Inside a step the switching instant is located and the sliding equation is solved by an
//! extrapolated linearly implicit scheme, so that what is seen is the paper's law and not an
//! explicit Euler that blows up at dt > 2·β/K. Damping of the seal is constant here.

#![allow(dead_code)] // examples and tests use their own parts

use trocar_model::{Direction, ElementParams, Mode};

/// Columns of the extrapolation: order 7.
const COLUMNS: usize = 7;

/// Extrapolated parts of one step: good to 1e-10 N up to K·dt/β = 2.
const PARTS: u32 = 8;

/// Search steps for the switching instant within one step.
const SWITCH_STEPS: u32 = 16;

/// Halvings in a search for a root: down to the last bit.
const HALVINGS: u32 = 100;

/// The paper's own reading of its element; see the module documentation for where it goes wrong.
pub(crate) struct PaperLiteral {
    params: ElementParams,
}

/// State of [`PaperLiteral`].
#[derive(Clone, Copy)]
pub(crate) struct LiteralState {
    deflection: f64,
    force: f64,
    mode: Mode,
    /// Direction of the last motion: chooses the branch.
    direction: Direction,
}

impl LiteralState {
    /// Deforming at `deflection` (m) with zero force until the first step, as if the last motion
    /// had been an insertion.
    pub(crate) fn new(deflection: f64) -> Self {
        Self { deflection, force: 0.0, mode: Mode::Deforming, direction: Direction::Insertion }
    }

    /// z, m.
    pub(crate) fn deflection(&self) -> f64 {
        self.deflection
    }

    /// F after the last step, N.
    pub(crate) fn force(&self) -> f64 {
        self.force
    }

    /// The latched mode.
    pub(crate) fn mode(&self) -> Mode {
        self.mode
    }
}

impl PaperLiteral {
    /// The element with `params`. Branches need not meet the end-point constraint;
    /// `yield_stiffness` has no meaning here.
    pub(crate) fn new(params: ElementParams) -> Self {
        Self { params }
    }

    /// Advances at constant `velocity` (m/s) for `duration` (s); returns the force (N) at the end,
    /// with that velocity.
    ///
    /// A duration that is not positive, or a number that is not finite, leaves the state untouched.
    pub(crate) fn step_velocity(
        &self,
        state: &mut LiteralState,
        velocity: f64,
        duration: f64,
    ) -> f64 {
        let proper = duration > 0.0 && duration.is_finite() && (velocity * duration).is_finite();
        if proper && velocity.is_finite() {
            let next = self.advance(self.enter(*state, velocity), velocity, duration);
            if next.force.is_finite() && next.deflection.is_finite() {
                *state = next;
            }
        }
        state.force
    }

    /// Force (N) in `state` at the moment at which `velocity` (m/s) sets in.
    pub(crate) fn force(&self, state: &LiteralState, velocity: f64) -> f64 {
        self.output(&self.enter(*state, velocity), velocity)
    }

    /// Mode, branch and force at the start of an interval with this velocity.
    fn enter(&self, mut state: LiteralState, velocity: f64) -> LiteralState {
        let direction = match velocity {
            0.0 => state.direction,
            velocity if velocity < 0.0 => Direction::Withdrawal,
            _ => Direction::Insertion,
        };
        if velocity == 0.0 || direction != state.direction {
            state.mode = Mode::Deforming; // section III-B, after (14)
        }
        state.direction = direction;
        if velocity != 0.0 && self.excess(&state, velocity) >= 0.0 {
            state.mode = Mode::Sliding; // (12)
        }
        state
    }

    fn advance(&self, mut state: LiteralState, velocity: f64, mut duration: f64) -> LiteralState {
        if velocity != 0.0 && state.mode == Mode::Deforming {
            let time = self.switching_time(&state, velocity, duration);
            state.deflection += velocity * time; // (10)
            duration -= time;
            if duration > 0.0 {
                state.mode = Mode::Sliding; // (12)
            }
        }
        if state.mode == Mode::Sliding && duration > 0.0 {
            for _ in 0..PARTS {
                state.deflection = self.extrapolate(&state, velocity, duration / f64::from(PARTS));
            }
        }
        if velocity != 0.0 && state.mode == Mode::Deforming && self.excess(&state, velocity) >= 0.0
        {
            state.mode = Mode::Sliding;
        }
        state.force = self.output(&state, velocity);
        state
    }

    /// sgn(v_d)·F - F_s in deformation mode, (12).
    fn excess(&self, state: &LiteralState, velocity: f64) -> f64 {
        let force = self.elastic(state, state.deflection).0 + self.params.damping.force(velocity);
        state.direction.sign() * force - self.params.sliding(state.direction).static_force
    }

    /// First time in [0, duration] at which (12) holds; `duration` if it never does.
    fn switching_time(&self, state: &LiteralState, velocity: f64, duration: f64) -> f64 {
        let excess = |time: f64| {
            let moved = LiteralState { deflection: state.deflection + velocity * time, ..*state };
            self.excess(&moved, velocity)
        };
        let grid = |k: u32| duration * f64::from(k) / f64::from(SWITCH_STEPS);
        let Some(k) = (1..=SWITCH_STEPS).find(|&k| excess(grid(k)) >= 0.0) else {
            return duration;
        };
        let (mut before, mut after) = (grid(k - 1), grid(k));
        for _ in 0..HALVINGS {
            let middle = 0.5 * (before + after);
            if excess(middle) >= 0.0 {
                after = middle;
            } else {
                before = middle;
            }
        }
        after
    }

    /// F_e(z) and its slope on the branch of the last motion, (25).
    fn elastic(&self, state: &LiteralState, z: f64) -> (f64, f64) {
        let branch = self.params.deformation.branch(state.direction);
        (branch.force(z), branch.stiffness(z))
    }

    fn output(&self, state: &LiteralState, velocity: f64) -> f64 {
        let deformation_velocity = match state.mode {
            Mode::Deforming => velocity,
            Mode::Sliding => self.rate(state, state.deflection, velocity).0,
        };
        self.elastic(state, state.deflection).0 + self.params.damping.force(deformation_velocity) // (10), (14)
    }

    /// dz/dt of (14) and its derivative by z.
    ///
    /// Solved for the slip speed u = |v_d - dz/dt|, of either sign here. Where the law has several
    /// roots, one of them.
    fn rate(&self, state: &LiteralState, z: f64, velocity: f64) -> (f64, f64) {
        let sliding = self.params.sliding(state.direction);
        let damping = &self.params.damping;
        let (elastic, stiffness) = self.elastic(state, z);
        let s = state.direction.sign();
        if sliding.viscous_damping == 0.0 && damping.is_zero() {
            return (0.0, 0.0);
        }
        let residual = |u: f64| {
            s * (elastic + damping.force(velocity - s * u))
                - sliding.level(u)
                - sliding.viscous_damping * u
        };
        let u = withdrawal_root(residual, velocity.abs());
        let deformation_velocity = velocity - s * u; // (8)
        let drag = sliding.viscous_damping + damping.coefficient(deformation_velocity);
        (deformation_velocity, if drag > 0.0 { -stiffness / drag } else { 0.0 })
    }

    /// z after sliding for `duration`: linearly implicit Euler with 1, 2, 3... sub-steps,
    /// extrapolated to none.
    fn extrapolate(&self, state: &LiteralState, velocity: f64, duration: f64) -> f64 {
        let mut row = [0.0; COLUMNS];
        for j in 0..COLUMNS {
            let mut value = self.sub_steps(state, velocity, duration, j + 1);
            for k in 1..=j {
                let ratio = (j + 1) as f64 / (j + 1 - k) as f64;
                let previous = row[k - 1];
                row[k - 1] = value;
                value += (value - previous) / (ratio - 1.0); // Aitken and Neville
            }
            row[j] = value;
        }
        row[COLUMNS - 1]
    }

    fn sub_steps(&self, state: &LiteralState, velocity: f64, duration: f64, count: usize) -> f64 {
        let h = duration / count as f64;
        (0..count).fold(state.deflection, |z, _| {
            let (rate, slope) = self.rate(state, z, velocity);
            z + h * rate / (1.0 - h * slope.min(0.0))
        })
    }
}

/// A root of `residual`, positive far below it and negative far above it.
fn withdrawal_root(residual: impl Fn(f64) -> f64, scale: f64) -> f64 {
    let mut reach = scale.max(1e-3);
    while reach < 1e300 && !(residual(-reach) > 0.0 && residual(reach) < 0.0) {
        reach *= 2.0;
    }
    let (mut low, mut high) = (-reach, reach);
    let (mut at_low, mut at_high) = (residual(low), residual(high));
    for k in 0..HALVINGS {
        // A chord first: it hits at once when the residual is straight. Bisection every other time.
        let chord = (low * at_high - high * at_low) / (at_high - at_low);
        let u = if k % 2 == 0 && chord > low && chord < high { chord } else { 0.5 * (low + high) };
        let r = residual(u);
        if r == 0.0 || u == low || u == high {
            return u;
        }
        if r > 0.0 {
            (low, at_low) = (u, r);
        } else {
            (high, at_high) = (u, r);
        }
    }
    0.5 * (low + high)
}
