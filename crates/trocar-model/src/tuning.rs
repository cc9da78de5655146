//! Parameters by number, for programs that let somebody turn them: sliders, tunable variables of a co-simulation.
//!
//! The parameters of an element hang together: both branches end at ±F_s. So the numbers here are chosen such that each
//! can be turned by itself. A new force F_s stretches the branches between the new ends (an affine map of their forces,
//! which keeps them joined and pinned, and takes the yield stiffness and the second relaxing arm along; the first has numbers of its
//! own); a new half width stretches them along the deflection.
//!
//! - **Rest**: where the two directions are turned apart, the deflection without force moves away from 0; an undeformed seal then
//!   pushes with M(0). [`crate::Trocar::rest_at_force`] starts it without force.
//! - **What does not go alone**: a lag needs creep; the bank of a Leuven model must bear the static force; the shares of a GMS
//!   model are scaled so that they add up to 1.

use crate::classical::Classical;
use crate::dahl::{Dahl, DahlParams};
use crate::damping::SealDamping;
use crate::elastic::{Branch, DeformationForce, MAX_DEGREE, Piece};
use crate::ems::{Element, ElementParams};
use crate::error::{ParamError, positive};
use crate::gms::{Gms, GmsElement};
use crate::leuven::{Leuven, LeuvenParams};
use crate::lugre::{LuGre, LuGreParams};
use crate::maxwell_slip::{MAX_ELEMENTS, MaxwellSlip, SlipElement};
use crate::parallel::{MAX_STAGES, Stages};
use crate::relaxation::{Relaxation, RelaxationArm};
use crate::seal::Seal;
use crate::sliding::SlidingFriction;
use crate::stribeck::StaticFriction;

/// A number of a model that can be turned by itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tunable {
    /// Name, with its unit at the end.
    pub name: &'static str,
    /// Unit in SI; "1" for a pure number.
    pub unit: &'static str,
    /// What it is.
    pub description: &'static str,
    /// Which of the elements it belongs to, from 0; `None` for what the model has once.
    pub element: Option<usize>,
    /// Present value.
    pub value: f64,
    /// Least value allowed.
    pub least: f64,
    /// Whether the least value itself is left out.
    pub above_least: bool,
}

/// Most numbers of a model.
pub const MAX_TUNABLES: usize = 6 + 4 * MAX_ELEMENTS;

struct Law {
    name: &'static str,
    unit: &'static str,
    description: &'static str,
    least: f64,
    above_least: bool,
}

const fn above(name: &'static str, unit: &'static str, description: &'static str) -> Law {
    Law { name, unit, description, least: 0.0, above_least: true }
}

const fn from(name: &'static str, unit: &'static str, description: &'static str, least: f64) -> Law {
    Law { name, unit, description, least, above_least: false }
}

const ELEMENT: [Law; 14] = [
    above("half_width_m", "m", "c: half width of the deformation range"),
    above("insertion_coulomb_force_n", "N", "F_c on insertion: sliding force without its viscous part"),
    from("insertion_static_ratio", "1", "F_s/F_c on insertion: force that begins a slide over the sliding force", 1.0),
    above("insertion_stribeck_velocity_m_s", "m/s", "v_s on insertion: speed over which F_s falls to F_c"),
    from("insertion_viscous_damping_n_s_m", "N.s/m", "beta on insertion", 0.0),
    above("withdrawal_coulomb_force_n", "N", "F_c on withdrawal"),
    from("withdrawal_static_ratio", "1", "F_s/F_c on withdrawal", 1.0),
    above("withdrawal_stribeck_velocity_m_s", "m/s", "v_s on withdrawal"),
    from("withdrawal_viscous_damping_n_s_m", "N.s/m", "beta on withdrawal", 0.0),
    from("seal_damping_n_s_m", "N.s/m", "sigma: damping of the seal while it deforms", 0.0),
    from("creep_velocity_m_s", "m/s", "v_c: slip speed over which the contact's force builds up; 0 is none", 0.0),
    from("friction_lag_s", "s", "T: lag of the Stribeck curve, with creep only", 0.0),
    from("relaxation_stiffness_n_m", "N/m", "E: stiffness that a seal held deformed loses", 0.0),
    above("relaxation_time_s", "s", "tau: time over which it does"),
];

const SLIDING: [Law; 5] = [
    above("coulomb_force_n", "N", "F_c: sliding force without its viscous part"),
    from("static_ratio", "1", "F_s/F_c: force that begins a slide over the sliding force", 1.0),
    above("stribeck_velocity_m_s", "m/s", "v_s: speed over which F_s falls to F_c"),
    above("stribeck_exponent", "1", "delta: shape of that fall"),
    from("viscous_damping_n_s_m", "N.s/m", "sliding force that grows with the speed", 0.0),
];

const STIFFNESS: Law = above("stiffness_n_m", "N/m", "stiffness before sliding");
const MICRO_DAMPING: Law = from("micro_damping_n_s_m", "N.s/m", "sigma_1: damping before sliding", 0.0);
const DAMPING_VELOCITY: Law = above("damping_velocity_m_s", "m/s", "v_d: speed over which that damping dies out");
const EXPONENT: Law = above("exponent", "1", "shape of the approach to sliding");
const LIMIT_FORCE: Law = above("limit_force_n", "N", "F_i: force at which the element slips");
const SHARE: Law = above("share", "1", "alpha_i: share of the sliding force; scaled so that all add up to 1");
const ATTRACTION: Law = above("attraction_m_s", "m/s", "C_i: speed at which a slipping element seeks its limit");
const DAMPING: Law = from("damping_n_s_m", "N.s/m", "sigma_i: damping of the element", 0.0);

/// Laws and values of a model in order, and new values in the same order.
struct Row {
    tunables: [Option<Tunable>; MAX_TUNABLES],
    count: usize,
}

impl Row {
    fn new() -> Self {
        Self { tunables: [None; MAX_TUNABLES], count: 0 }
    }

    fn put(&mut self, law: &Law, element: Option<usize>, value: f64) {
        let Law { name, unit, description, least, above_least } = *law;
        if let Some(slot) = self.tunables.get_mut(self.count) {
            *slot = Some(Tunable { name, unit, description, element, value, least, above_least });
            self.count += 1;
        }
    }

    fn put_sliding(&mut self, sliding: &SlidingFriction) {
        let values = [
            sliding.coulomb_force,
            sliding.static_force / sliding.coulomb_force,
            sliding.stribeck_velocity,
            sliding.stribeck_exponent,
            sliding.viscous_damping,
        ];
        SLIDING.iter().zip(values).for_each(|(law, value)| self.put(law, None, value));
    }
}

/// New values, taken in order; one that equals the old is the old, to the last bit.
struct New<'a> {
    values: &'a [f64],
    place: usize,
}

impl New<'_> {
    fn take(&mut self, old: f64) -> f64 {
        let value = self.values.get(self.place).copied().unwrap_or(old);
        self.place += 1;
        value
    }

    fn force_and_ratio(&mut self, old: &SlidingFriction) -> (f64, f64) {
        let ratio = old.static_force / old.coulomb_force;
        let (force, new_ratio) = (self.take(old.coulomb_force), self.take(ratio));
        let unchanged = force == old.coulomb_force && new_ratio == ratio;
        (force, if unchanged { old.static_force } else { force * new_ratio })
    }

    fn sliding(&mut self, old: &SlidingFriction) -> SlidingFriction {
        let (coulomb_force, static_force) = self.force_and_ratio(old);
        SlidingFriction {
            coulomb_force,
            static_force,
            stribeck_velocity: self.take(old.stribeck_velocity),
            stribeck_exponent: self.take(old.stribeck_exponent),
            viscous_damping: self.take(old.viscous_damping),
        }
    }

    /// The same without the exponent, which an element keeps.
    fn side(&mut self, old: &SlidingFriction) -> SlidingFriction {
        let (coulomb_force, static_force) = self.force_and_ratio(old);
        SlidingFriction {
            coulomb_force,
            static_force,
            stribeck_velocity: self.take(old.stribeck_velocity),
            stribeck_exponent: old.stribeck_exponent,
            viscous_damping: self.take(old.viscous_damping),
        }
    }

    fn bank(&mut self, old: &[SlipElement]) -> [SlipElement; MAX_ELEMENTS] {
        let mut bank = [SlipElement { stiffness: 0.0, limit_force: 0.0 }; MAX_ELEMENTS];
        for (new, old) in bank.iter_mut().zip(old) {
            *new = SlipElement { stiffness: self.take(old.stiffness), limit_force: self.take(old.limit_force) };
        }
        bank
    }
}

impl Seal {
    /// The numbers that can be turned, in the order of [`Seal::tuned`]. Per element of EMS: sliding on either side, half
    /// width, damping, creep, lag, first relaxing arm.
    pub fn tunables(&self) -> impl Iterator<Item = Tunable> {
        let mut row = Row::new();
        match self {
            Self::Ems(stages) => {
                let several = stages.elements().len() > 1;
                for (i, element) in stages.elements().iter().enumerate() {
                    let laws = ELEMENT.iter().zip(element_values(element.params()));
                    laws.for_each(|(law, value)| row.put(law, several.then_some(i), value));
                }
            }
            Self::Classical(model) => list_classical(&mut row, model),
        }
        row.tunables.into_iter().flatten()
    }

    /// The model with new `values`, in the order of [`Seal::tunables`]; missing ones stay. The same values give the same
    /// model, to the last bit.
    ///
    /// # Errors
    /// [`ParamError`] for a value out of its range.
    pub fn tuned(&self, values: &[f64]) -> Result<Seal, ParamError> {
        let mut new = New { values, place: 0 };
        match self {
            Self::Ems(stages) => {
                let mut elements = [*stages.first(); MAX_STAGES];
                for (slot, element) in elements.iter_mut().zip(stages.elements()) {
                    *slot = Element::new(tuned_element(element.params(), &mut new)?)?;
                }
                let count = stages.elements().len();
                Ok(elements.get(..count).and_then(Stages::new).map_or(*self, Seal::Ems))
            }
            Self::Classical(model) => tuned_classical(model, &mut new).map(Seal::Classical),
        }
    }
}

fn element_values(params: &ElementParams) -> [f64; ELEMENT.len()] {
    let ElementParams { insertion, withdrawal, damping, relaxation, .. } = params;
    let arm = relaxation.arms[0];
    [
        params.deformation.half_width(),
        insertion.coulomb_force,
        insertion.static_force / insertion.coulomb_force,
        insertion.stribeck_velocity,
        insertion.viscous_damping,
        withdrawal.coulomb_force,
        withdrawal.static_force / withdrawal.coulomb_force,
        withdrawal.stribeck_velocity,
        withdrawal.viscous_damping,
        damping.coefficients[0],
        params.creep_velocity,
        params.friction_lag,
        arm.stiffness,
        arm.time,
    ]
}

fn tuned_element(old: &ElementParams, new: &mut New) -> Result<ElementParams, ParamError> {
    let half_width = positive("half_width", new.take(old.deformation.half_width()), "m")?;
    let (insertion, withdrawal) = (new.side(&old.insertion), new.side(&old.withdrawal));
    insertion.check()?;
    withdrawal.check()?;
    let before = [-old.withdrawal.static_force, old.insertion.static_force];
    let after = [-withdrawal.static_force, insertion.static_force];
    let stretch = Stretch::new(old.deformation.half_width(), half_width, before, after);
    let [_, linear, quadratic] = old.damping.coefficients;
    let damping = SealDamping { coefficients: [new.take(old.damping.coefficients[0]), linear, quadratic] };
    let (creep_velocity, friction_lag) = (new.take(old.creep_velocity), new.take(old.friction_lag));
    let [arm, second] = old.relaxation.arms;
    let first = RelaxationArm { stiffness: new.take(arm.stiffness), time: new.take(arm.time) };
    let relaxation = Relaxation { arms: [first, stretch.arm(second)] };
    let deformation = stretch.deformation(&old.deformation)?;
    Ok(ElementParams { deformation, damping, insertion, withdrawal, creep_velocity, friction_lag, relaxation })
}

/// z' = width·z, F' = shift + scale·F.
struct Stretch {
    width: f64,
    shift: f64,
    scale: f64,
}

impl Stretch {
    fn new(old_width: f64, new_width: f64, before: [f64; 2], after: [f64; 2]) -> Self {
        let width = if new_width == old_width { 1.0 } else { new_width / old_width };
        if before == after {
            return Self { width, shift: 0.0, scale: 1.0 };
        }
        let scale = (after[1] - after[0]) / (before[1] - before[0]);
        Self { width, shift: after[0] - scale * before[0], scale }
    }

    fn is_none(&self) -> bool {
        self.width == 1.0 && self.shift == 0.0 && self.scale == 1.0
    }

    fn arm(&self, old: RelaxationArm) -> RelaxationArm {
        RelaxationArm { stiffness: old.stiffness * (self.scale / self.width), ..old }
    }

    fn deformation(&self, old: &DeformationForce) -> Result<DeformationForce, ParamError> {
        if self.is_none() {
            return Ok(*old);
        }
        let (rising, falling) = (self.branch(old.rising())?, self.branch(old.falling())?);
        DeformationForce::new(rising, falling, Some(old.yield_stiffness() * self.scale / self.width))
    }

    fn branch(&self, old: &Branch) -> Result<Branch, ParamError> {
        Branch::new(self.piece(old.left())?, self.piece(old.right())?)
    }

    fn piece(&self, old: &Piece) -> Result<Piece, ParamError> {
        let mut legendre = [0.0; MAX_DEGREE + 1];
        let count = old.legendre().len();
        legendre.iter_mut().zip(old.legendre()).for_each(|(new, old)| *new = self.scale * old);
        legendre[0] += self.shift;
        Piece::new(self.width * old.from(), self.width * old.to(), legendre.get(..count).unwrap_or(&legendre))
    }
}

fn list_classical(row: &mut Row, model: &Classical) {
    match model {
        Classical::Static(model) => row.put_sliding(model.params()),
        Classical::Dahl(model) => {
            let DahlParams { stiffness, coulomb_force, exponent, viscous_damping } = *model.params();
            let [force, _, _, _, viscous] = &SLIDING;
            row.put(&STIFFNESS, None, stiffness);
            row.put(force, None, coulomb_force);
            row.put(&EXPONENT, None, exponent);
            row.put(viscous, None, viscous_damping);
        }
        Classical::LuGre(model) => {
            let params = model.params();
            row.put(&STIFFNESS, None, params.stiffness);
            row.put(&MICRO_DAMPING, None, params.micro_damping);
            row.put(&DAMPING_VELOCITY, None, params.damping_velocity);
            row.put_sliding(&params.sliding);
        }
        Classical::Leuven(model) => {
            row.put(&EXPONENT, None, model.params().exponent);
            row.put(&MICRO_DAMPING, None, model.params().micro_damping);
            row.put_sliding(&model.params().sliding);
            list_bank(row, model.elements());
        }
        Classical::MaxwellSlip(model) => {
            let [.., viscous] = &SLIDING;
            row.put(viscous, None, model.viscous_damping());
            list_bank(row, model.elements());
        }
        Classical::Gms(model) => {
            row.put_sliding(model.sliding());
            for (i, GmsElement { stiffness, share, attraction, damping }) in model.elements().iter().enumerate() {
                let laws = [(&STIFFNESS, stiffness), (&SHARE, share), (&ATTRACTION, attraction), (&DAMPING, damping)];
                laws.into_iter().for_each(|(law, value)| row.put(law, Some(i), *value));
            }
        }
    }
}

fn list_bank(row: &mut Row, elements: &[SlipElement]) {
    for (i, element) in elements.iter().enumerate() {
        row.put(&STIFFNESS, Some(i), element.stiffness);
        row.put(&LIMIT_FORCE, Some(i), element.limit_force);
    }
}

fn tuned_classical(model: &Classical, new: &mut New) -> Result<Classical, ParamError> {
    Ok(match model {
        Classical::Static(model) => Classical::Static(StaticFriction::new(new.sliding(model.params()))?),
        Classical::Dahl(model) => {
            let old = model.params();
            Classical::Dahl(Dahl::new(DahlParams {
                stiffness: new.take(old.stiffness),
                coulomb_force: new.take(old.coulomb_force),
                exponent: new.take(old.exponent),
                viscous_damping: new.take(old.viscous_damping),
            })?)
        }
        Classical::LuGre(model) => {
            let old = model.params();
            Classical::LuGre(LuGre::new(LuGreParams {
                stiffness: new.take(old.stiffness),
                micro_damping: new.take(old.micro_damping),
                damping_velocity: new.take(old.damping_velocity),
                sliding: new.sliding(&old.sliding),
                curve: old.curve,
            })?)
        }
        Classical::Leuven(model) => {
            let old = model.params();
            let (exponent, micro_damping) = (new.take(old.exponent), new.take(old.micro_damping));
            let sliding = new.sliding(&old.sliding);
            let bank = new.bank(model.elements());
            let count = model.elements().len();
            Classical::Leuven(Leuven::new(&bank[..count], LeuvenParams { sliding, exponent, micro_damping })?)
        }
        Classical::MaxwellSlip(model) => {
            let viscous_damping = new.take(model.viscous_damping());
            let bank = new.bank(model.elements());
            let count = model.elements().len();
            Classical::MaxwellSlip(MaxwellSlip::new(&bank[..count], viscous_damping)?)
        }
        Classical::Gms(model) => Classical::Gms(tuned_gms(model, new)?),
    })
}

fn tuned_gms(model: &Gms, new: &mut New) -> Result<Gms, ParamError> {
    let sliding = new.sliding(model.sliding());
    let mut elements = [GmsElement { stiffness: 0.0, share: 0.0, attraction: 0.0, damping: 0.0 }; MAX_ELEMENTS];
    for (slot, old) in elements.iter_mut().zip(model.elements()) {
        *slot = GmsElement {
            stiffness: new.take(old.stiffness),
            share: new.take(old.share),
            attraction: new.take(old.attraction),
            damping: new.take(old.damping),
        };
    }
    let count = model.elements().len();
    let is_turned = elements.iter().zip(model.elements()).any(|(new, old)| new.share != old.share);
    let total: f64 = elements.iter().map(|element| element.share).sum();
    if is_turned && total > 0.0 {
        elements.iter_mut().for_each(|element| element.share /= total);
    }
    Gms::new(&elements[..count], sliding, model.slip_rate())
}
