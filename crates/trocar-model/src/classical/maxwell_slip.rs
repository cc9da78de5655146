//! The Maxwell-Slip model: springs with a dry slider each, side by side, EMS (1) to (3).

use crate::block::{BLOCK, Motion, Samples};
use crate::error::{ParamError, check_element, in_range};
use crate::friction::{classical, held, velocity, within};
use crate::law::{Elements, Law, MAX_ELEMENTS, Visit, check_count};
use crate::parameter::{Quantity, parameters};
use crate::row::row;

/// One spring in series with a dry slider.
///
/// | symbol | field         | unit | range |
/// |--------|---------------|------|-------|
/// | k_i    | `stiffness`   | N/m  | > 0   |
/// | F_i    | `limit_force` | N    | > 0   |
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlipElement {
    /// k_i, N/m, > 0.
    pub stiffness: f64,
    /// F_i, N, > 0: force at which the slider gives way.
    pub limit_force: f64,
}

impl SlipElement {
    /// Fills the unused places of a bank.
    pub(crate) const NONE: Self = Self { stiffness: 0.0, limit_force: 0.0 };
}

parameters!(SlipElement { stiffness: Stiffness, limit_force: LimitForce });

/// Slip elements under one motion, checked. Also the memory of the modified Leuven model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bank {
    elements: [SlipElement; MAX_ELEMENTS],
    count: usize,
    /// ΣF_i, N, summed in the order in which the forces are.
    limit: f64,
}

impl Bank {
    pub(crate) fn new(elements: &[SlipElement]) -> Result<Self, ParamError> {
        check_count(elements.len())?;
        let mut bank =
            Self { elements: [SlipElement::NONE; MAX_ELEMENTS], count: elements.len(), limit: 0.0 };
        for (index, (place, element)) in bank.elements.iter_mut().zip(elements).enumerate() {
            check_element(element, index)?;
            bank.limit += element.limit_force;
            *place = *element;
        }
        if bank.limit.is_finite() {
            Ok(bank)
        } else {
            Err(ParamError::NotFinite { name: "sum of limit_force", value: bank.limit })
        }
    }

    #[inline(always)]
    pub(crate) fn elements(&self) -> &[SlipElement] {
        &self.elements[..self.count.min(MAX_ELEMENTS)]
    }

    /// ΣF_i, N.
    pub(crate) fn limit(&self) -> f64 {
        self.limit
    }

    /// Forces that add up to `force` (N), clamped to ±`most`, each in proportion to its limit.
    pub(crate) fn share(&self, force: f64, most: f64) -> [f64; MAX_ELEMENTS] {
        let force = held(force, most);
        self.elements.map(|element| force / self.limit * element.limit_force)
    }
}

/// Everything that changes while a [`MaxwellSlip`] runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MaxwellSlipState {
    pub(crate) forces: [f64; MAX_ELEMENTS],
    pub(crate) count: usize,
    pub(crate) force: f64,
}

impl MaxwellSlipState {
    /// f_i, N: force of each element, |f_i| <= F_i.
    pub fn element_forces(&self) -> &[f64] {
        &self.forces[..self.count.min(MAX_ELEMENTS)]
    }
}

/// Maxwell-Slip model: rate-independent hysteresis with nonlocal memory, and viscous friction.
///
/// # Equations (key EMS in SOURCES.md, section II-A; also IWAN)
/// ```text
/// stick  df_i/dt = k_i·v          until |f_i| = F_i                  (1) (2)
/// slip   df_i/dt = 0              until v changes sign               (1)
/// F = Σ f_i + β·v                                                    (3)
/// step   f_i⁺ = clamp(f_i + k_i·Δx, -F_i, F_i)
/// ```
/// | symbol | parameter            | unit  | range           |
/// |--------|----------------------|-------|-----------------|
/// | k_i, F_i | [`SlipElement`]    | N/m, N | > 0; 1 to [`MAX_ELEMENTS`] elements |
/// | β      | `viscous_damping`    | N·s/m | >= 0            |
///
/// - **Step**: the exact solution for any monotone motion within the step, whatever its length and speed.
/// - **Invariants**: |f_i| <= F_i; at constant v the force settles at ΣF_i·sgn(v) + β·v (4), exactly, after a finite
///   travel; Masing's rules; returning to a turning point restores its force; Σf_i²/(2k_i) is stored, the rest of the
///   work is lost, never gained.
/// - **Limits**: stiffness never grows on the way from a reversal (k_i > 0), so a seal that snaps through is out of reach.
/// - **Errors**: [`ParamError`] from [`MaxwellSlip::new`]; never later.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MaxwellSlip {
    bank: Bank,
    viscous_damping: f64,
}

impl MaxwellSlip {
    /// Checks the parameters; `viscous_damping` is β, N·s/m.
    ///
    /// # Errors
    /// No element or more than [`MAX_ELEMENTS`], or a value that is not finite or out of its range.
    pub fn new(elements: &[SlipElement], viscous_damping: f64) -> Result<Self, ParamError> {
        in_range(Quantity::ViscousDamping, viscous_damping)?;
        Ok(Self { bank: Bank::new(elements)?, viscous_damping })
    }

    /// The elements.
    pub fn elements(&self) -> &[SlipElement] {
        self.bank.elements()
    }

    /// β, N·s/m.
    pub fn viscous_damping(&self) -> f64 {
        self.viscous_damping
    }

    /// ΣF_i, N: summed in the order of the elements.
    pub fn limit_force(&self) -> f64 {
        self.bank.limit
    }

    /// State at rest that holds `force` (N), clamped to ±ΣF_i, shared in proportion to F_i. A force
    /// that is not finite counts as 0.
    pub fn rest_at_force(&self, force: f64) -> MaxwellSlipState {
        let forces = self.bank.share(force, self.bank.limit);
        let count = self.elements().len();
        MaxwellSlipState { forces, count, force: forces[..count].iter().sum() }
    }

    /// Advances `state` by `displacement` (m) within `duration` (s); returns the force (N) at the
    /// end.
    ///
    /// A duration that is not positive, or a displacement, duration or velocity that is not finite,
    /// leaves the state untouched and returns the last force.
    #[inline]
    pub fn step(&self, state: &mut MaxwellSlipState, displacement: f64, duration: f64) -> f64 {
        let Some(velocity) = velocity(displacement, duration) else { return state.force };
        let viscous = self.viscous_damping * velocity;
        // The elements are bounded: only the viscous part can exceed all numbers.
        if viscous.abs() + self.bank.limit > f64::MAX {
            return state.force;
        }
        let mut elastic = 0.0;
        for (force, element) in state.forces.iter_mut().zip(self.bank.elements()) {
            *force = within(*force + element.stiffness * displacement, element.limit_force); // EMS (1), (2)
            elastic += *force;
        }
        state.force = elastic + viscous; // EMS (3)
        state.force
    }

    /// [`MaxwellSlip::step`] for a block of samples; false, with `state` untouched, where a step
    /// would leave it so.
    #[inline(always)]
    pub(crate) fn run_block(
        &self,
        state: &mut MaxwellSlipState,
        motion: &Motion,
        forces: &mut Samples,
    ) -> bool {
        let mut fastest = 0.0_f64;
        for velocity in motion.velocity {
            let viscous = (self.viscous_damping * velocity).abs();
            fastest = if viscous > fastest { viscous } else { fastest };
        }
        if fastest + self.bank.limit > f64::MAX {
            return false;
        }
        // A loop whose length the compiler knows becomes vectors.
        match self.bank.count {
            0..=4 => self.run_elements::<4>(state, motion, forces),
            5..=8 => self.run_elements::<8>(state, motion, forces),
            _ => self.run_elements::<MAX_ELEMENTS>(state, motion, forces),
        }
        true
    }

    /// The first `N` places of the bank: those without an element add a negative zero, which
    /// changes no sum.
    #[inline(always)]
    fn run_elements<const N: usize>(
        &self,
        state: &mut MaxwellSlipState,
        motion: &Motion,
        forces: &mut Samples,
    ) {
        let (mut own, mut stiffness, mut limit) = ([0.0; N], [0.0; N], [0.0; N]);
        for (k, element) in self.bank.elements.iter().enumerate().take(N) {
            (own[k], stiffness[k], limit[k]) =
                (state.forces[k], element.stiffness, element.limit_force);
        }
        let steps = motion.displacement.iter().zip(&motion.velocity);
        for (force, (displacement, velocity)) in forces.iter_mut().zip(steps) {
            let mut elastic = 0.0;
            for k in 0..N {
                own[k] = within(own[k] + stiffness[k] * displacement, limit[k]);
                elastic += own[k];
            }
            *force = elastic + self.viscous_damping * velocity;
        }
        state
            .forces
            .iter_mut()
            .zip(own)
            .take(self.bank.count)
            .for_each(|(force, own)| *force = own);
        state.force = forces[BLOCK - 1];
    }

    /// Force (N) at the very start of motion at `velocity` (m/s); the last force for a velocity
    /// that is not finite.
    pub fn output(&self, state: &MaxwellSlipState, velocity: f64) -> f64 {
        let elastic: f64 =
            state.forces.iter().zip(self.bank.elements()).map(|(force, _)| force).sum();
        let force = elastic + self.viscous_damping * velocity;
        if force.is_finite() { force } else { state.force }
    }
}

row!(MaxwellSlipState { count, force, forces });

impl Law for MaxwellSlip {
    type Parts = (f64, Elements<SlipElement>);
    const BLANK: Self::Parts = (f64::NAN, Elements::NONE);

    fn parts(&self) -> Self::Parts {
        (self.viscous_damping, Elements::of(self.elements()))
    }

    fn of_parts((viscous_damping, bank): &Self::Parts) -> Result<Self, ParamError> {
        Self::new(bank.as_slice(), *viscous_damping)
    }

    fn visit<V: Visit>((damping, bank): &mut Self::Parts, visitor: &mut V) -> Result<(), V::Error> {
        visitor.number(Quantity::ViscousDamping, damping)?;
        visitor.elements(bank)
    }

    fn viscous_damping(&self) -> f64 {
        self.viscous_damping
    }
}

classical!(MaxwellSlip, MaxwellSlipState);

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::ToString;

    use super::*;

    fn two() -> MaxwellSlip {
        let soft = SlipElement { stiffness: 100.0, limit_force: 0.5 };
        let stiff = SlipElement { stiffness: 1000.0, limit_force: 1.0 };
        MaxwellSlip::new(&[stiff, soft], 2.0).unwrap()
    }

    #[test]
    fn virgin_curve_bends_where_each_element_gives_way() {
        let model = two();
        let mut state = model.rest_state();
        // 1 mm: both stick; 5 mm: the soft one gives way; beyond: nothing more but viscous friction
        // of 2 N s/m·0.1 m/s.
        for (position, force) in [(1e-3, 1.1), (5e-3, 1.5), (9e-3, 1.5)] {
            let travel = position - state.element_forces()[1] / 100.0;
            assert!((model.step(&mut state, travel, travel / 0.1) - 0.2 - force).abs() < 1e-14);
        }
        assert_eq!(state.element_forces(), [1.0, 0.5]);
    }

    #[test]
    fn a_hold_keeps_the_elastic_force_and_both_zeros_are_the_same() {
        let model = two();
        for zero in [0.0, -0.0] {
            let mut state = model.rest_state();
            model.step(&mut state, -4e-4, 1e-3);
            let held = state.element_forces()[0] + state.element_forces()[1];
            assert_eq!(model.step(&mut state, zero, 1e-3), held);
            assert_eq!(model.output(&state, zero), held);
        }
    }

    #[test]
    fn rest_at_force_is_shared_by_limit_and_clamped() {
        let model = two();
        let state = model.rest_at_force(0.75);
        assert_eq!(state.element_forces(), [0.5, 0.25]);
        assert_eq!(model.rest_at_force(-99.0).force(), -1.5);
        assert_eq!(model.rest_at_force(f64::NAN), model.rest_state());
    }

    #[test]
    fn bad_parameters_are_named() {
        let bad = MaxwellSlip::new(&[SlipElement { stiffness: -1.0, limit_force: 1.0 }], 0.0)
            .unwrap_err();
        assert_eq!(
            bad.to_string(),
            "element_1_stiffness_n_m must be finite and above 0 N/m, got -1 N/m"
        );
        assert_eq!(MaxwellSlip::new(&[], 0.0), Err(ParamError::ElementCount { count: 0 }));
        let many = [SlipElement { stiffness: 1.0, limit_force: 1.0 }; MAX_ELEMENTS + 1];
        let bad = MaxwellSlip::new(&many, 0.0).unwrap_err();
        assert_eq!(bad.to_string(), "a model needs 1 to 16 elements, got 17");
        let huge = [SlipElement { stiffness: 1.0, limit_force: f64::MAX }; 2];
        assert!(matches!(MaxwellSlip::new(&huge, 0.0), Err(ParamError::NotFinite { .. })));
    }
}
