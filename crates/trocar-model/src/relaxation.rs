//! Slow relaxation of the seal's rubber: springs that let go with time, in parallel with the
//! branches.
//!
//! A deformed seal that is held loses force, and A seal deformed fast is stiffer than one deformed
//! slowly. Each arm is a spring and a dashpot in series (Maxwell's element; a sum of them is a
//! Prony series, CHRISTENSEN):
//!
//! ```text
//! da/dt = E·dz/dt - a/τ        F_e(z) + Σ a  in place of F_e(z) in EMS (9)
//! ```
//!
//! An arm stores a²/2E and loses a²/(E·τ) a second, so it never gives back more than it took. While
//! the seal slides its deflection rests and the arm fades: steady sliding is that of the element
//! without arms. A full reversal slower than τ follows the branches, a faster one lies above them.

use crate::error::{ParamError, check_fields};
use crate::exponential::decay_and_mean;
use crate::parameter::parameters;

/// Most arms of one seal.
pub const MAX_ARMS: usize = 2;

/// One arm: a spring that relaxes.
///
/// | symbol | field       | unit | range |
/// |--------|-------------|------|-------|
/// | E      | `stiffness` | N/m  | >= 0  |
/// | τ      | `time`      | s    | > 0   |
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelaxationArm {
    /// E, N/m, >= 0: stiffness of the arm when deformed fast. 0 switches it off.
    pub stiffness: f64,
    /// τ, s, > 0: time in which a held arm falls to 1/e.
    pub time: f64,
}

parameters!(RelaxationArm { stiffness as "stiffness_n_m": RelaxationStiffness, time as "time_s": RelaxationTime });

/// The arms of one seal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Relaxation {
    /// The arms; those of stiffness 0 do nothing.
    pub arms: [RelaxationArm; MAX_ARMS],
}

/// Force of each arm, N.
pub(crate) type ArmForces = [f64; MAX_ARMS];

/// What the arms do within one step: a force that is there whatever happens, and a spring from
/// where the step starts.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StepArms {
    /// a·e^(-t/τ) of each arm, N.
    left: ArmForces,
    /// E·(τ/t)·(1 - e^(-t/τ)) of each arm, N/m.
    response: [f64; MAX_ARMS],
    /// Σ a·e^(-t/τ), N.
    held: f64,
    /// Σ E·(τ/t)·(1 - e^(-t/τ)), N/m.
    pub(crate) stiffness: f64,
}

impl StepArms {
    /// Sum of the forces at the end of the step when the deflection has moved by `change`, m.
    #[inline(always)]
    pub(crate) fn force(&self, change: f64) -> f64 {
        self.held + self.stiffness * change
    }

    /// The force of each arm then, N.
    #[inline(always)]
    pub(crate) fn forces(&self, change: f64) -> ArmForces {
        let mut forces = self.left;
        for (force, response) in forces.iter_mut().zip(&self.response) {
            *force += response * change;
        }
        forces
    }
}

impl RelaxationArm {
    /// No arm.
    pub const NONE: Self = Self { stiffness: 0.0, time: 1.0 };

    /// e^(-t/τ), and E·(τ/t)·(1 - e^(-t/τ)): exact for a constant dz/dt.
    #[inline(always)]
    fn response(&self, duration: f64) -> (f64, f64) {
        let (left, mean) = decay_and_mean(duration / self.time);
        (left, self.stiffness * mean)
    }
}

impl Relaxation {
    /// Rubber that does not relax.
    pub const NONE: Self = Self { arms: [RelaxationArm::NONE; MAX_ARMS] };

    /// One arm.
    pub const fn single(stiffness: f64, time: f64) -> Self {
        Self { arms: [RelaxationArm { stiffness, time }, RelaxationArm::NONE] }
    }

    /// Whether nothing relaxes.
    pub fn is_none(&self) -> bool {
        self.arms.iter().all(|arm| arm.stiffness == 0.0)
    }

    /// Σ E, N/m: what the arms add to the stiffness of a seal that is deformed fast.
    pub fn fast_stiffness(&self) -> f64 {
        self.arms.iter().map(|arm| arm.stiffness).sum()
    }

    /// What `forces` do within a step of `duration`, s.
    #[inline(always)]
    pub(crate) fn within(&self, forces: &ArmForces, duration: f64) -> StepArms {
        let mut step =
            StepArms { left: *forces, response: [0.0; MAX_ARMS], held: 0.0, stiffness: 0.0 };
        for ((arm, left), response) in self.arms.iter().zip(&mut step.left).zip(&mut step.response)
        {
            if arm.stiffness > 0.0 {
                let (part, stiffness) = arm.response(duration);
                *left *= part;
                *response = stiffness;
                step.held += *left;
                step.stiffness += stiffness;
            }
        }
        step
    }

    pub(crate) fn check(&self) -> Result<(), ParamError> {
        self.arms.iter().try_for_each(check_fields)
    }
}
