//! The Generalized Maxwell-Slip (GMS) model: slip elements whose limit follows the Stribeck curve,
//! EMS (5) to (7).

use crate::error::{ParamError, check_element, finite};
use crate::exponential::decay;
use crate::friction::{classical, held, sign, velocity};
use crate::law::{Choice, Elements, Law, MAX_ELEMENTS, Visit, check_count};
use crate::parameter::{Blank, parameters};
use crate::row::row;
use crate::sliding::SlidingFriction;

/// Allowed distance of Σα_i from 1.
const SHARE_TOLERANCE: f64 = 1e-9;

/// One element: a spring with a slider that takes a share of the sliding force.
///
/// | symbol | field        | unit  | range                      |
/// |--------|--------------|-------|----------------------------|
/// | k_i    | `stiffness`  | N/m   | > 0                        |
/// | α_i    | `share`      | 1     | > 0, Σα_i = 1 within 1e-9  |
/// | C_i    | `attraction` | m/s   | > 0                        |
/// | σ_i    | `damping`    | N·s/m | >= 0                       |
///
/// ν_i of EMS (5), in m/N, is α_i/k_i. The attraction C of GMS, in N/s, gives C_i = C·α_i/k_i.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GmsElement {
    /// k_i, N/m, > 0.
    pub stiffness: f64,
    /// α_i = k_i·ν_i, > 0: share of the sliding force that this element carries.
    pub share: f64,
    /// C_i, m/s, > 0: speed at which a slipping element seeks its limit.
    pub attraction: f64,
    /// σ_i, N·s/m, >= 0: micro-damping.
    pub damping: f64,
}

parameters!(GmsElement {
    stiffness: Stiffness,
    share: Share,
    attraction: Attraction,
    damping: Damping
});

impl GmsElement {
    /// Fills the unused places of a model.
    pub(crate) const NONE: Self =
        Self { stiffness: 0.0, share: 0.0, attraction: 0.0, damping: 0.0 };
}

/// How fast the deflection of a slipping element may change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SlipRate {
    /// As printed, EMS (5): without bound. For F_s > F_c the model can then yield energy: near v =
    /// 0 an element loads from ν_i·F_c to ν_i·F_s although nothing moves.
    Free,
    /// |dz_i/dt| <= |v|. For σ_i = 0 no motion yields energy; nor with damping if
    /// σ_i·C_i·(F_s/F_c - 1) <= α_i·F_c, which keeps a damper smaller than the slider it is beside.
    Limited,
}

impl Choice for SlipRate {
    const KEY: &str = "slip_rate";
    const ALL: &[(Self, &str)] = &[(Self::Free, "free"), (Self::Limited, "limited")];
}

/// Everything that changes while a [`Gms`] runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GmsState {
    pub(crate) deflections: [f64; MAX_ELEMENTS],
    pub(crate) slipping: [bool; MAX_ELEMENTS],
    /// sgn(v) of the last step: all elements stick anew when it changes.
    pub(crate) direction: f64,
    pub(crate) count: usize,
    pub(crate) force: f64,
}

impl GmsState {
    /// z_i, m: deflection of each element, |z_i| <= ν_i·F_s.
    pub fn deflections(&self) -> &[f64] {
        &self.deflections[..self.count.min(MAX_ELEMENTS)]
    }

    /// Whether each element slips.
    pub fn slipping(&self) -> &[bool] {
        &self.slipping[..self.count.min(MAX_ELEMENTS)]
    }
}

/// Generalized Maxwell-Slip model.
///
/// # Equations (key EMS in SOURCES.md, section II-B; key GMS)
/// ```text
/// stick  dz_i/dt = v                                       until sgn(v)·z_i >= ν_i·g(v)        (5)
/// slip   dz_i/dt = sgn(v)·C_i·(1 - sgn(v)·z_i/(ν_i·g(v)))  until sgn(v) changes                (5)
/// F = Σ(k_i·z_i + σ_i·dz_i/dt) + β·v         ν_i = α_i/k_i                                     (7)
/// ```
/// g and β as in [`SlidingFriction`], the elements as in [`GmsElement`].
///
/// - **Latched modes**: an element slips from its own limit ν_i·g(v) on, also while g rises above it again, until sgn(v)
///   changes. At v = 0 all elements stick and the force is Σk_i·z_i. One that stands above its limit when motion starts
///   or g falls slips at once and relaxes.
/// - **Step**: exact at constant velocity for any length: a sticking element that reaches its limit is at equilibrium
///   there; the others move linearly and then exponentially. The damping force is that at the end of the step.
/// - **Invariants**: |z_i| <= ν_i·F_s; at constant v the force settles at g·sgn(v) + β·v. For F_s = F_c and σ_i = 0 it is
///   the Maxwell-Slip model with F_i = α_i·F_c. Energy: [`SlipRate`].
/// - **Errors**: [`ParamError`] from [`Gms::new`]; never later.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gms {
    elements: [GmsElement; MAX_ELEMENTS],
    /// ν_i, m/N.
    scales: [f64; MAX_ELEMENTS],
    /// C_i/ν_i, N/s.
    rates: [f64; MAX_ELEMENTS],
    count: usize,
    sliding: SlidingFriction,
    slip_rate: SlipRate,
    /// β + Σσ_i, N·s/m.
    damping: f64,
    /// Bound of |F| without what grows with the velocity, N.
    slip_bound: f64,
}

/// The motion of one step, as all elements see it.
#[derive(Clone, Copy)]
struct Drive {
    /// sgn(v), not 0.
    sign: f64,
    speed: f64,
    travel: f64,
    duration: f64,
    /// Bound of |dz_i/dt| in slip, m/s.
    fastest: f64,
    /// g(|v|), N, and its inverse.
    level: f64,
    inverse_level: f64,
    /// The last rate over the whole step, 1/s, and what it leaves: elements often share one.
    fade: (f64, f64),
}

impl Gms {
    /// Checks the parameters.
    ///
    /// # Errors
    /// No element or more than [`MAX_ELEMENTS`], a value that is not finite or out of its range, or
    /// shares that do not add up to 1.
    pub fn new(
        elements: &[GmsElement],
        sliding: SlidingFriction,
        slip_rate: SlipRate,
    ) -> Result<Self, ParamError> {
        sliding.check()?;
        check_count(elements.len())?;
        let mut places = [GmsElement::NONE; MAX_ELEMENTS];
        let mut scales = [0.0; MAX_ELEMENTS];
        let mut rates = [0.0; MAX_ELEMENTS];
        for (index, element) in elements.iter().enumerate() {
            check_element(element, index)?;
            scales[index] = element.share / element.stiffness;
            // Refuses a limit deflection that vanishes beside the other numbers.
            rates[index] = element.attraction / scales[index];
            let rate = rates[index] / sliding.coulomb_force;
            if !(rate > 0.0 && rate.is_finite()) {
                return Err(ParamError::LimitDeflection { index, rate });
            }
            places[index] = *element;
        }
        let sum: f64 = elements.iter().map(|element| element.share).sum();
        if (sum - 1.0).abs() > SHARE_TOLERANCE {
            return Err(ParamError::SharesNotOne { sum });
        }
        let damping =
            sliding.viscous_damping + elements.iter().map(|element| element.damping).sum::<f64>();
        // |z_i| <= ν_i·F_s, so that a slipping element is no faster than C_i·(1 + F_s/F_c).
        let fastest = 1.0 + sliding.static_force / sliding.coulomb_force;
        let dampers = elements.iter().map(|element| element.damping * element.attraction * fastest);
        let slip_bound = finite("bound of the force", sliding.static_force + dampers.sum::<f64>())?;
        let count = elements.len();
        Ok(Self { elements: places, scales, rates, count, sliding, slip_rate, damping, slip_bound })
    }

    /// The elements.
    pub fn elements(&self) -> &[GmsElement] {
        &self.elements[..self.count.min(MAX_ELEMENTS)]
    }

    /// g and β.
    pub fn sliding(&self) -> &SlidingFriction {
        &self.sliding
    }

    /// ν_i = α_i/k_i of each element, m/N.
    pub fn scales(&self) -> &[f64] {
        &self.scales[..self.elements().len()]
    }

    /// C_i/ν_i of each element, N/s.
    pub fn rates(&self) -> &[f64] {
        &self.rates[..self.elements().len()]
    }

    /// β + Σσ_i, N·s/m.
    pub fn damping(&self) -> f64 {
        self.damping
    }

    /// Bound of |F| without what grows with the velocity, N.
    pub fn slip_bound(&self) -> f64 {
        self.slip_bound
    }

    /// How fast a slipping element may change.
    pub fn slip_rate(&self) -> SlipRate {
        self.slip_rate
    }

    /// State at rest that holds `force` (N), clamped to ±F_s, shared in proportion to α_i. A force
    /// that is not finite counts as 0.
    pub fn rest_at_force(&self, force: f64) -> GmsState {
        let force = held(force, self.sliding.static_force);
        let mut state = GmsState {
            deflections: self.scales.map(|nu| nu * force),
            slipping: [false; MAX_ELEMENTS],
            direction: 0.0,
            count: self.count,
            force: 0.0,
        };
        state.force = self.elastic_force(&state);
        state
    }

    /// Advances `state` by `displacement` (m) within `duration` (s) at constant velocity; returns
    /// the force (N) at the end.
    ///
    /// Any size of step is allowed. A duration that is not positive, or a displacement, duration or
    /// velocity that is not finite, leaves the state untouched and returns the last force.
    #[inline]
    pub fn step(&self, state: &mut GmsState, displacement: f64, duration: f64) -> f64 {
        // The deflections are bounded: only the damping forces can exceed all numbers.
        if let Some(velocity) = velocity(displacement, duration)
            && self.slip_bound + self.damping * velocity.abs() <= f64::MAX
        {
            self.advance(state, velocity, displacement, duration);
        }
        state.force
    }

    /// Force (N) at the very start of motion at `velocity` (m/s); the last force for a velocity
    /// that is not finite.
    pub fn output(&self, state: &GmsState, velocity: f64) -> f64 {
        let mut state = *state;
        if self.slip_bound + self.damping * velocity.abs() <= f64::MAX {
            self.advance(&mut state, velocity, 0.0, 0.0);
        }
        state.force
    }

    fn elastic_force(&self, state: &GmsState) -> f64 {
        self.elements()
            .iter()
            .zip(&state.deflections)
            .map(|(element, z)| element.stiffness * z)
            .sum()
    }

    #[inline(always)]
    fn advance(&self, state: &mut GmsState, velocity: f64, displacement: f64, duration: f64) {
        let s = sign(velocity);
        if s != state.direction {
            state.direction = s;
            state.slipping = [false; MAX_ELEMENTS];
        }
        if s == 0.0 {
            state.force = self.elastic_force(state);
            return;
        }
        let speed = velocity.abs();
        let fastest = match self.slip_rate {
            SlipRate::Free => f64::INFINITY,
            SlipRate::Limited => speed,
        };
        let level = self.sliding.level(speed);
        let travel = displacement.abs();
        let inverse_level = 1.0 / level;
        let mut drive = Drive {
            sign: s,
            speed,
            travel,
            duration,
            fastest,
            level,
            inverse_level,
            fade: (0.0, 1.0),
        };
        let mut force = self.sliding.viscous_damping * velocity;
        let deflections = state.deflections.iter_mut().zip(&mut state.slipping);
        let constants = self.scales.iter().zip(&self.rates);
        for ((element, (nu, rate)), (z, slipping)) in
            self.elements().iter().zip(constants).zip(deflections)
        {
            let rate = advance(z, slipping, nu * drive.level, *rate, &mut drive);
            force += element.stiffness * *z + element.damping * rate; // EMS (7)
        }
        state.force = force;
    }
}

row!(GmsState { count, direction, force, deflections, slipping });

impl Law for Gms {
    type Parts = (SlipRate, SlidingFriction, Elements<GmsElement>);
    const BLANK: Self::Parts = (SlipRate::Free, SlidingFriction::BLANK, Elements::NONE);

    fn parts(&self) -> Self::Parts {
        (self.slip_rate, self.sliding, Elements::of(self.elements()))
    }

    fn of_parts((slip_rate, sliding, elements): &Self::Parts) -> Result<Self, ParamError> {
        Self::new(elements.as_slice(), *sliding, *slip_rate)
    }

    fn visit<V: Visit>(parts: &mut Self::Parts, visitor: &mut V) -> Result<(), V::Error> {
        let (slip_rate, sliding, elements) = parts;
        visitor.choice(slip_rate)?;
        visitor.sliding(sliding)?;
        visitor.elements(elements)
    }

    /// Shares that add up to 1.
    fn settle((.., old): &Self::Parts, (.., new): &mut Self::Parts) {
        let mut pairs = new.as_slice().iter().zip(old.as_slice());
        let is_changed = pairs.any(|(new, old)| new.share != old.share);
        let total: f64 = new.as_slice().iter().map(|element| element.share).sum();
        if is_changed && total > 0.0 {
            new.as_mut_slice().iter_mut().for_each(|element| element.share /= total);
        }
    }

    fn viscous_damping(&self) -> f64 {
        self.sliding.viscous_damping
    }
}

classical!(Gms, GmsState);

/// Moves one element with limit ν·g = `limit` (m) and C/ν = `rate` (N/s); returns dz/dt (m/s) at
/// the end.
#[inline(always)]
fn advance(z: &mut f64, slipping: &mut bool, limit: f64, rate: f64, drive: &mut Drive) -> f64 {
    let s = drive.sign;
    let u = s * *z;
    if !*slipping && u < limit {
        let moved = u + drive.travel; // EMS (5), stick
        *slipping = moved >= limit;
        *z = s * if *slipping { limit } else { moved };
        return if *slipping { 0.0 } else { s * drive.speed };
    }
    *slipping = true;
    let distance = limit - u;
    if distance == 0.0 {
        return 0.0;
    }
    let left = relax(distance.abs(), rate * drive.inverse_level, drive);
    let (left, rate) = if distance < 0.0 { (-left.0, -left.1) } else { left };
    *z = s * (limit - left);
    s * rate
}

/// Distance (m) from the limit after a step in slip, and the speed (m/s) at which it then shrinks,
/// EMS (5).
///
/// While `rate`·distance exceeds the bound the approach is linear, then exponential with that rate
/// (1/s).
#[inline(always)]
fn relax(distance: f64, rate: f64, drive: &mut Drive) -> (f64, f64) {
    let linear = distance - drive.fastest / rate;
    let left = if linear > 0.0 {
        if drive.travel <= linear {
            return (distance - drive.travel, drive.fastest);
        }
        (distance - linear) * decay((drive.duration - linear / drive.fastest) * rate)
    } else {
        if rate != drive.fade.0 {
            drive.fade = (rate, decay(drive.duration * rate));
        }
        distance * drive.fade.1
    };
    (left, left * rate)
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::ToString;

    use super::*;

    const STRIBECK: SlidingFriction = SlidingFriction {
        coulomb_force: 2.0,
        static_force: 3.0,
        stribeck_velocity: 0.01,
        stribeck_exponent: 2.0,
        viscous_damping: 1.0,
    };

    fn element(stiffness: f64, share: f64) -> GmsElement {
        GmsElement { stiffness, share, attraction: 0.01, damping: 0.0 }
    }

    fn two(slip_rate: SlipRate) -> Gms {
        Gms::new(&[element(1000.0, 0.4), element(500.0, 0.6)], STRIBECK, slip_rate).unwrap()
    }

    #[test]
    fn an_element_slips_at_its_own_share_of_the_sliding_force() {
        let model = two(SlipRate::Free);
        let mut state = model.rest_state();
        // At 0.1 m/s g = 2 N: the first limit is 0.8 N, at 0.8 mm, where both springs hold 1.2 N.
        model.step_velocity(&mut state, 0.1, 7.999e-3);
        assert_eq!(state.slipping(), [false, false]);
        let force = model.step_velocity(&mut state, 0.1, 0.002e-3);
        assert_eq!(state.slipping(), [true, false]);
        assert!((force - 0.1 - 1.2).abs() < 1e-3);
        // The second gives way at 1.2 N, after 2.4 mm, and the sum is F_c + beta v.
        assert!((model.step_velocity(&mut state, 0.1, 0.017) - 2.1).abs() < 1e-12);
    }

    #[test]
    fn the_damping_force_counts_only_where_an_element_moves() {
        let damped = GmsElement { damping: 3.0, ..element(1000.0, 1.0) };
        let model =
            Gms::new(&[damped], SlidingFriction::coulomb(2.0, 0.0), SlipRate::Free).unwrap();
        let mut state = model.rest_state();
        assert_eq!(model.output(&state, 0.125), 0.375);
        assert!((model.step_velocity(&mut state, 0.125, 8e-3) - 1.375).abs() < 1e-15);
        assert_eq!(model.step_velocity(&mut state, 0.125, 0.02), 2.0);
        assert_eq!(model.output(&state, -0.125), 2.0 - 0.375);
    }

    #[test]
    fn at_rest_every_element_sticks_and_keeps_its_force() {
        for zero in [0.0, -0.0] {
            let model = two(SlipRate::Free);
            let mut state = model.rest_state();
            model.step_velocity(&mut state, -0.1, 1.0);
            let z = [state.deflections()[0], state.deflections()[1]];
            assert_eq!(model.output(&state, zero), -2.0);
            assert_eq!(model.step(&mut state, zero, 10.0), -2.0);
            assert_eq!(state.deflections(), z);
            assert_eq!(state.slipping(), [false, false]);
        }
    }

    #[test]
    fn the_limited_rate_is_never_above_the_speed_of_the_instrument() {
        let model = Gms::new(&[element(1000.0, 1.0)], STRIBECK, SlipRate::Limited).unwrap();
        let mut state = model.rest_state();
        model.step_velocity(&mut state, 0.1, 1.0);
        // g rises by 1 N, the spring needs 1 mm: 1 um/s would take longer than 100 s.
        let z = state.deflections()[0];
        model.step_velocity(&mut state, 1e-6, 100.0);
        assert!((state.deflections()[0] - z - 1e-4).abs() < 1e-12);
    }

    #[test]
    fn rest_at_force_is_shared_and_clamped_to_the_static_force() {
        let model = two(SlipRate::Free);
        let state = model.rest_at_force(1.0);
        assert_eq!(state.deflections(), [0.4e-3, 1.2e-3]);
        assert!((model.rest_at_force(-9.0).force() + 3.0).abs() < 1e-15);
        assert_eq!(model.rest_at_force(f64::INFINITY), model.rest_state());
    }

    #[test]
    fn bad_parameters_are_named() {
        let short =
            Gms::new(&[element(1000.0, 0.4), element(500.0, 0.5)], STRIBECK, SlipRate::Free)
                .unwrap_err();
        assert_eq!(short.to_string(), "the shares of the elements must add up to 1, got 0.9");
        let still = GmsElement { attraction: 0.0, ..element(1000.0, 1.0) };
        let bad = Gms::new(&[still], STRIBECK, SlipRate::Free).unwrap_err();
        assert_eq!(
            bad.to_string(),
            "element_1_attraction_m_s must be finite and above 0 m/s, got 0 m/s"
        );
        let driven = GmsElement { damping: -1.0, ..element(1000.0, 1.0) };
        let bad = Gms::new(&[driven], STRIBECK, SlipRate::Free).unwrap_err();
        assert_eq!(
            bad.to_string(),
            "element_1_damping_n_s_m must be finite and at least 0 N s/m, got -1 N s/m"
        );
        let flat = Gms::new(&[element(1e300, 1e-30), element(1.0, 1.0)], STRIBECK, SlipRate::Free)
            .unwrap_err();
        assert!(matches!(flat, ParamError::LimitDeflection { index: 0, .. }));
    }
}
