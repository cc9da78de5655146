//! The instrument turns: an element along the axis and around the shaft.
//!
//! Both deflections and slip velocities lie at the surface of the shaft: x along the axis, t around
//! it, where an angle φ is the arc r·φ.
//!
//! ```text
//! ẋ   = dz_x/dt + v_x        F   = F_e(z_x) + D(dz_x/dt)        as without rotation, (8), (9)
//! r·φ̇ = dz_t/dt + v_t        F_t = k_t·z_t                      torque M = r·F_t
//! (F, F_t) - β·v ∈ K         v normal to K there                in place of (13)
//! K = {(f_x/F_x)² + (f_t/F_t)² <= 1}      F_x = g⁺ or g⁻ by the sign of f_x, at the slip speed |v|
//! ```
//!
//! K is two half ellipses that meet at (0, ±F_t). F_t is a ratio times the mean of g⁺ and g⁻; with
//! ratio 1 and equal directions the contact is isotropic and friction opposes the slip. The flow is
//! associated, so f·v is the largest that any force of K gives: friction only ever takes energy.
//!
//! - Steady sliding, isotropic: F = F_c·ẋ/√(ẋ² + r²φ̇²) + β·ẋ. Turning takes axial friction away.
//! - At the limit F_c on a straight seal of stiffness k = k_t, then turned by the arc s: F = F_c·sech(k·s/F_c),
//!   F_t = F_c·tanh(k·s/F_c).
//! - With creep the contact gives way at any force: v_x² + v_c² in place of v_x² under the root.
//!
//! An instrument that has never turned runs the step without rotation, to the last bit.

use crate::ems::{Element, State};
use crate::friction::velocity;
use crate::parallel::{MAX_STAGES, Stages, StagesState};
use crate::parameter::parameters;
use crate::row::row;
use crate::sliding::SlidingFriction;

/// How a trocar resists rotation of the instrument. Elements in parallel turn alike: each has the
/// part of k_t that its static forces are of all, so that all begin to slide at the same arc.
///
/// | symbol | field                       | unit | range |
/// |--------|-----------------------------|------|-------|
/// | r      | `shaft_radius`              | m    | > 0   |
/// | k_t    | `circumferential_stiffness` | N/m  | > 0   |
/// | F_t/F_c| `circumferential_ratio`     | 1    | > 0   |
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rotation {
    /// r, m: radius of the shaft in the seal.
    pub shaft_radius: f64,
    /// k_t, N/m: stiffness of the seal around the shaft, at its surface.
    pub circumferential_stiffness: f64,
    /// F_t/F_c: friction around the shaft over the mean of that along it. 1 is isotropic.
    pub circumferential_ratio: f64,
}

parameters!(Rotation {
    shaft_radius: ShaftRadius,
    circumferential_stiffness: CircumferentialStiffness,
    circumferential_ratio: CircumferentialRatio,
});

/// One element around the shaft.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Around {
    /// Its part of k_t, N/m.
    pub stiffness: f64,
    /// Friction: the mean of both directions along the axis, its forces times F_t/F_c.
    pub sliding: SlidingFriction,
    /// Friction of the element depends on the speed nowhere.
    pub(crate) constant: bool,
}

impl Rotation {
    /// Each of `stages` around the shaft; those past the last repeat the first.
    pub(crate) fn around(&self, stages: &Stages) -> [Around; MAX_STAGES] {
        let elements = stages.elements();
        let limit = |own: &Element| {
            own.params().insertion.static_force + own.params().withdrawal.static_force
        };
        let total: f64 = elements.iter().map(limit).sum();
        let part = |own: &Element| if elements.len() > 1 { limit(own) / total } else { 1.0 };
        stages.all().map(|own| {
            let (up, down) = (&own.params().insertion, &own.params().withdrawal);
            let mean = |number: fn(&SlidingFriction) -> f64| 0.5 * (number(up) + number(down));
            let sliding = SlidingFriction {
                coulomb_force: self.circumferential_ratio * mean(|own| own.coulomb_force),
                static_force: self.circumferential_ratio * mean(|own| own.static_force),
                stribeck_velocity: mean(|own| own.stribeck_velocity),
                stribeck_exponent: mean(|own| own.stribeck_exponent),
                viscous_damping: mean(|own| own.viscous_damping),
            };
            let constant = up.is_constant() && down.is_constant();
            Around { stiffness: self.circumferential_stiffness * part(&own), sliding, constant }
        })
    }
}

/// A rotation with what its step knows of each element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Prepared {
    pub(crate) own: Rotation,
    pub(crate) around: [Around; MAX_STAGES],
}

/// State of one element around the shaft.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Turn {
    /// z_t, m.
    pub(crate) deflection: f64,
    /// v_t, m/s.
    pub(crate) slip_velocity: f64,
}

impl Turn {
    pub(crate) const REST: Self = Self { deflection: 0.0, slip_velocity: 0.0 };
}

row!(Turn { deflection, slip_velocity });

/// State of a trocar around the shaft.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turning {
    pub(crate) angle: f64,
    /// M, N·m.
    pub(crate) torque: f64,
    pub(crate) elements: [Turn; MAX_STAGES],
}

row!(Turning { angle, torque, elements });

impl Turning {
    /// Without torque at `angle`, rad.
    pub(crate) fn rest(angle: f64) -> Self {
        Self { angle, torque: 0.0, elements: [Turn::REST; MAX_STAGES] }
    }

    /// φ, rad.
    pub fn angle(&self) -> f64 {
        self.angle
    }

    /// z_t of each element, m; 0 past the last.
    pub fn deflections(&self) -> [f64; MAX_STAGES] {
        self.elements.map(|element| element.deflection)
    }

    /// v_t of each element, m/s; 0 past the last.
    pub fn slip_velocities(&self) -> [f64; MAX_STAGES] {
        self.elements.map(|element| element.slip_velocity)
    }
}

impl Stages {
    /// Advances by `displacement` (m) and to `angle` (rad) within `duration` (s), both at constant
    /// velocity; returns the force around the shaft, N. `None`, with all untouched, where
    /// [`crate::Friction::step`] leaves its state untouched.
    pub(crate) fn step_turning(
        &self,
        rotation: &Prepared,
        (state, turning): (&mut StagesState, &mut Turning),
        displacement: f64,
        angle: f64,
        duration: f64,
    ) -> Option<f64> {
        let arc = rotation.own.shaft_radius * (angle - turning.angle);
        let motion = [velocity(displacement, duration)?, velocity(arc, duration)?];
        let mut force = 0.0;
        let states: &mut [State] = state.states_mut();
        for (((element, around), state), turn) in
            self.elements().iter().zip(&rotation.around).zip(states).zip(&mut turning.elements)
        {
            if arc == 0.0 && *turn == Turn::REST {
                element.step(state, displacement, duration);
            } else {
                element.step_turning(around, (state, turn), motion, duration);
                force += around.stiffness * turn.deflection;
            }
        }
        turning.angle = angle;
        Some(force)
    }
}
