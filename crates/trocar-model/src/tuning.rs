//! Parameters by number, for programs that change them one by one: sliders, tunable variables of a
//! co-simulation.
//!
//! The parameters of an element depend on each other: both branches end at ±F_s. So the numbers
//! here are chosen such that each can be changed by itself. A new force F_s stretches the branches
//! between the new ends (an affine map of their forces, which keeps them joined and at their end
//! points, and takes the yield stiffness and the second relaxing arm along; the first has numbers
//! of its own); a new half width stretches them along the deflection.
//!
//! - **Rest**: where the two directions are changed apart, the deflection without force moves away from 0; an undeformed seal then
//!   pushes with M(0). [`crate::Trocar::rest_at_force`] starts it without force.
//! - **Dependencies**: a lag needs creep; the bank of a Leuven model must bear the static force; the shares of a GMS
//!   model are scaled so that they add up to 1.

use core::convert::Infallible;

use crate::direction::Direction;
use crate::elastic::{Branch, DeformationForce, MAX_DEGREE, Piece};
use crate::ems::{Element, ElementParams};
use crate::error::{ParamError, in_range};
use crate::law::{Choice, Elements, MAX_ELEMENTS, Visit};
use crate::parallel::{MAX_STAGES, Stages};
use crate::parameter::{Blank, ParameterId, Parameters, Quantity};
use crate::relaxation::RelaxationArm;
use crate::seal::Seal;
use crate::sliding::SlidingFriction;

/// A number of a model that can be changed by itself. Its unit, range and description:
/// [`ParameterId::declaration`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tunable {
    /// Which; with the number of its element where the model has several.
    pub id: ParameterId,
    /// Present value, SI.
    pub value: f64,
}

/// Most numbers of a model.
pub const MAX_TUNABLES: usize = 6 + 4 * MAX_ELEMENTS;

/// What can be changed on an element: for each direction the sliding friction but for its exponent.
fn tunables_of_element() -> impl Iterator<Item = ParameterId> {
    use Quantity::{
        CoulombForce, HalfWidth, SealDamping, StaticRatio, StribeckVelocity, ViscousDamping,
    };
    let own = ElementParams::FIELDS.iter().map(|field| field.quantity.id());
    let relaxation = RelaxationArm::FIELDS.iter().map(|field| field.quantity.id());
    let of_parts =
        core::iter::once(HalfWidth.id()).chain(Direction::BOTH.into_iter().flat_map(|direction| {
            [CoulombForce, StaticRatio, StribeckVelocity, ViscousDamping].map(|q| q.of(direction))
        }));
    of_parts.chain([SealDamping.id()]).chain(own).chain(relaxation)
}

impl SlidingFriction {
    /// The value of `quantity`, if sliding friction has it; also F_s/F_c.
    pub fn value(&self, quantity: Quantity) -> Option<f64> {
        match quantity {
            Quantity::StaticRatio => Some(self.static_force / self.coulomb_force),
            other => self.number(other),
        }
    }
}

impl ElementParams {
    /// The value of `quantity`, SI; without a direction the mean of both. `None` for what an
    /// element does not have, such as a join of both branches, the time of a relaxing arm that is
    /// off, or anything of the sensor.
    pub fn value(&self, direction: Option<Direction>, quantity: Quantity) -> Option<f64> {
        if let Some(value) = self.number(quantity).or_else(|| self.damping.number(quantity)) {
            return Some(value);
        }
        let [first, second] = &self.relaxation.arms;
        let branch = || direction.map(|direction| self.deformation.branch(direction));
        match quantity {
            Quantity::HalfWidth => Some(self.deformation.half_width()),
            Quantity::YieldStiffness => Some(self.deformation.yield_stiffness()),
            Quantity::Join => Some(branch()?.join()),
            Quantity::JoinForce => branch().map(|branch| branch.force(branch.join())),
            Quantity::Coefficient { piece, power } => {
                let piece = if piece == 1 { branch()?.left() } else { branch()?.right() };
                piece.monomial().get(usize::from(power)).copied()
            }
            Quantity::SecondRelaxationStiffness => Some(second.stiffness),
            Quantity::SecondRelaxationTime => Some(second.time).filter(|_| second.stiffness > 0.0),
            _ => first.number(quantity).or_else(|| match direction {
                Some(direction) => self.sliding(direction).value(quantity),
                None => Some(
                    0.5 * (self.insertion.value(quantity)? + self.withdrawal.value(quantity)?),
                ),
            }),
        }
    }
}

/// Parameters of a model in order.
struct List {
    tunables: [Option<Tunable>; MAX_TUNABLES],
    count: usize,
}

impl List {
    fn new() -> Self {
        Self { tunables: [None; MAX_TUNABLES], count: 0 }
    }

    fn put(&mut self, id: ParameterId, value: f64) {
        if let Some(slot) = self.tunables.get_mut(self.count) {
            *slot = Some(Tunable { id, value });
            self.count += 1;
        }
    }
}

/// Lists the members of a model, with F_s/F_c in place of F_s.
impl Visit for List {
    type Error = Infallible;

    fn number(&mut self, quantity: Quantity, value: &mut f64) -> Result<(), Infallible> {
        self.put(quantity.id(), *value);
        Ok(())
    }

    fn choice<T: Choice>(&mut self, _: &mut T) -> Result<(), Infallible> {
        Ok(())
    }

    fn sliding(&mut self, sliding: &mut SlidingFriction) -> Result<(), Infallible> {
        for field in SlidingFriction::FIELDS {
            let is_static = field.quantity == Quantity::StaticForce;
            let quantity = if is_static { Quantity::StaticRatio } else { field.quantity };
            self.put(quantity.id(), sliding.value(quantity).unwrap_or(f64::NAN));
        }
        Ok(())
    }

    fn elements<T: Blank>(&mut self, elements: &mut Elements<T>) -> Result<(), Infallible> {
        for (index, element) in elements.as_slice().iter().enumerate() {
            for field in T::FIELDS {
                self.put(field.quantity.id().of_element(index), (field.get)(element));
            }
        }
        Ok(())
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

    /// F_s from its ratio to the new F_c; unchanged where both are.
    fn static_force(&mut self, old: &SlidingFriction, new: &mut SlidingFriction) {
        let ratio = old.static_force / old.coulomb_force;
        let new_ratio = self.take(ratio);
        if new.coulomb_force != old.coulomb_force || new_ratio != ratio {
            new.static_force = new.coulomb_force * new_ratio;
        }
    }
}

/// Changes the members of a model.
impl Visit for New<'_> {
    type Error = ParamError;

    fn number(&mut self, _: Quantity, value: &mut f64) -> Result<(), ParamError> {
        *value = self.take(*value);
        Ok(())
    }

    fn choice<T: Choice>(&mut self, _: &mut T) -> Result<(), ParamError> {
        Ok(())
    }

    fn sliding(&mut self, sliding: &mut SlidingFriction) -> Result<(), ParamError> {
        let old = *sliding;
        for field in SlidingFriction::FIELDS {
            match field.quantity {
                Quantity::StaticForce => self.static_force(&old, sliding),
                _ => (field.set)(sliding, self.take((field.get)(&old))),
            }
        }
        Ok(())
    }

    fn elements<T: Blank>(&mut self, elements: &mut Elements<T>) -> Result<(), ParamError> {
        elements.as_mut_slice().iter_mut().try_for_each(|element| self.numbers(element))
    }
}

impl Seal {
    /// The numbers that can be changed, in the order of [`Seal::tuned`]. Per element of EMS: half
    /// width, sliding in either direction, damping, creep, lag, first relaxing arm.
    pub fn tunables(&self) -> impl Iterator<Item = Tunable> {
        let mut list = List::new();
        match self {
            Self::Ems(stages) => {
                let several = stages.elements().len() > 1;
                for (index, element) in stages.elements().iter().enumerate() {
                    for id in tunables_of_element() {
                        let named = if several { id.of_element(index) } else { id };
                        list.put(
                            named,
                            element.params().value(id.direction, id.quantity).unwrap_or(f64::NAN),
                        );
                    }
                }
            }
            Self::Classical(model) => {
                let Ok(()) = model.visit(&mut list);
            }
        }
        list.tunables.into_iter().flatten()
    }

    /// The model with new `values`, in the order of [`Seal::tunables`]; missing ones stay. The same
    /// values give the same model, to the last bit.
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
            Self::Classical(model) => model.change(&mut new).map(Seal::Classical),
        }
    }
}

fn tuned_element(old: &ElementParams, new: &mut New) -> Result<ElementParams, ParamError> {
    let mut params = *old;
    let mut half_width = old.deformation.half_width();
    for id in tunables_of_element() {
        match (id.quantity, id.direction) {
            (Quantity::HalfWidth, _) => {
                half_width = in_range(Quantity::HalfWidth, new.take(half_width))?
            }
            (Quantity::StaticRatio, Some(direction)) => {
                new.static_force(old.sliding(direction), params.sliding_mut(direction));
            }
            _ => params.set(id, new.take(old.value(id.direction, id.quantity).unwrap_or(f64::NAN))),
        }
    }
    params.insertion.check()?;
    params.withdrawal.check()?;
    let rescaling =
        Rescaling::new(old.deformation.half_width(), half_width, old.ends(), params.ends());
    params.relaxation.arms[1] = rescaling.arm(old.relaxation.arms[1]);
    params.deformation = rescaling.deformation(&old.deformation)?;
    Ok(params)
}

impl ElementParams {
    /// Where the branches end, N: at the static forces.
    fn ends(&self) -> [f64; 2] {
        [-self.withdrawal.static_force, self.insertion.static_force]
    }

    fn sliding_mut(&mut self, direction: Direction) -> &mut SlidingFriction {
        match direction {
            Direction::Insertion => &mut self.insertion,
            Direction::Withdrawal => &mut self.withdrawal,
        }
    }

    /// Sets a number that stands in a field of its own.
    fn set(&mut self, id: ParameterId, value: f64) {
        match id.direction {
            Some(direction) => set(self.sliding_mut(direction), id.quantity, value),
            None => {
                set(self, id.quantity, value);
                set(&mut self.damping, id.quantity, value);
                set(&mut self.relaxation.arms[0], id.quantity, value);
            }
        }
    }
}

/// Sets `quantity`, if it is one of the fields.
fn set<T: Parameters>(params: &mut T, quantity: Quantity, value: f64) {
    let own = T::FIELDS.iter().filter(|field| field.quantity == quantity);
    own.for_each(|field| (field.set)(params, value));
}

/// Rescaling of the branches to new ends: z' = width·z, F' = shift + scale·F.
struct Rescaling {
    width: f64,
    shift: f64,
    scale: f64,
}

impl Rescaling {
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
        let (insertion, withdrawal) =
            (self.branch(old.insertion())?, self.branch(old.withdrawal())?);
        DeformationForce::new(
            insertion,
            withdrawal,
            Some(old.yield_stiffness() * self.scale / self.width),
        )
    }

    fn branch(&self, old: &Branch) -> Result<Branch, ParamError> {
        Branch::new(self.piece(old.left())?, self.piece(old.right())?)
    }

    fn piece(&self, old: &Piece) -> Result<Piece, ParamError> {
        let mut legendre = [0.0; MAX_DEGREE + 1];
        let count = old.legendre().len();
        legendre.iter_mut().zip(old.legendre()).for_each(|(new, old)| *new = self.scale * old);
        legendre[0] += self.shift;
        Piece::new(
            self.width * old.from(),
            self.width * old.to(),
            legendre.get(..count).unwrap_or(&legendre),
        )
    }
}
