//! What a classical model declares of itself: its members, once, in the order of its row. Rows of
//! numbers, tunable parameters and model files visit them.

use crate::error::ParamError;
use crate::friction::Friction;
pub use crate::parameter::MAX_ELEMENTS;
use crate::parameter::{Blank, Parameters, Quantity};
use crate::sliding::SlidingFriction;

/// Number of elements of a model.
pub(crate) fn check_count(count: usize) -> Result<(), ParamError> {
    if (1..=MAX_ELEMENTS).contains(&count) {
        Ok(())
    } else {
        Err(ParamError::ElementCount { count })
    }
}

/// Visits the members of a model, one after the other: writes, reads or changes them.
pub trait Visit {
    /// Why a member is refused.
    type Error;

    /// A number of the model as a whole.
    ///
    /// # Errors
    /// Of the visitor; so for the other members.
    fn number(&mut self, quantity: Quantity, value: &mut f64) -> Result<(), Self::Error>;

    /// Which form of a law.
    ///
    /// # Errors
    /// Of the visitor.
    fn choice<T: Choice>(&mut self, chosen: &mut T) -> Result<(), Self::Error>;

    /// g and β.
    ///
    /// # Errors
    /// Of the visitor.
    fn sliding(&mut self, sliding: &mut SlidingFriction) -> Result<(), Self::Error>;

    /// Elements side by side.
    ///
    /// # Errors
    /// Of the visitor.
    fn elements<T: Blank>(&mut self, elements: &mut Elements<T>) -> Result<(), Self::Error>;

    /// Every number of a parameter struct.
    ///
    /// # Errors
    /// Of the visitor.
    fn numbers<T: Parameters>(&mut self, params: &mut T) -> Result<(), Self::Error> {
        for field in T::FIELDS {
            let mut value = (field.get)(params);
            self.number(field.quantity, &mut value)?;
            (field.set)(params, value);
        }
        Ok(())
    }
}

/// Forms of a law, of which a model has one.
pub trait Choice: Copy + PartialEq + 'static {
    /// Key in a model file.
    const KEY: &'static str;
    /// All with their names in a model file; the place is the number in a row.
    const ALL: &'static [(Self, &'static str)];
}

/// Elements of a model, unchecked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Elements<T> {
    places: [T; MAX_ELEMENTS],
    count: usize,
}

impl<T: Blank> Elements<T> {
    pub(crate) const NONE: Self = Self { places: [T::BLANK; MAX_ELEMENTS], count: 0 };

    pub(crate) fn of(elements: &[T]) -> Self {
        let mut own = Self { count: elements.len().min(MAX_ELEMENTS), ..Self::NONE };
        own.places.iter_mut().zip(elements).for_each(|(place, element)| *place = *element);
        own
    }

    /// Makes it `count` elements, whose numbers are still to be set.
    ///
    /// # Errors
    /// [`ParamError::ElementCount`] for none or more than [`MAX_ELEMENTS`].
    pub fn resize(&mut self, count: usize) -> Result<(), ParamError> {
        check_count(count)?;
        self.count = count;
        Ok(())
    }

    /// The elements.
    pub fn as_slice(&self) -> &[T] {
        &self.places[..self.count.min(MAX_ELEMENTS)]
    }

    /// The elements, to change them.
    pub fn as_mut_slice(&mut self) -> &mut [T] {
        &mut self.places[..self.count.min(MAX_ELEMENTS)]
    }
}

/// A model of the list in [`crate::classical`].
pub(crate) trait Law: Friction + Sized {
    /// All that makes it, unchecked.
    type Parts;
    /// Parts to be read into.
    const BLANK: Self::Parts;

    fn parts(&self) -> Self::Parts;

    /// Checks the parts.
    fn of_parts(parts: &Self::Parts) -> Result<Self, ParamError>;

    /// Visits the members in order.
    fn visit<V: Visit>(parts: &mut Self::Parts, visitor: &mut V) -> Result<(), V::Error>;

    /// Restores a relation between numbers that were changed one by one.
    fn settle(_old: &Self::Parts, _new: &mut Self::Parts) {}

    /// β, N·s/m: force that grows with the velocity, over the velocity.
    fn viscous_damping(&self) -> f64;
}

/// The parts of a [`Law`] that `new` makes of one struct of parameters alone.
macro_rules! made_of_params {
    ($params:ty) => {
        type Parts = $params;
        const BLANK: $params = <$params>::BLANK;

        fn parts(&self) -> $params {
            *self.params()
        }

        fn of_parts(params: &$params) -> Result<Self, ParamError> {
            Self::new(*params)
        }
    };
}
pub(crate) use made_of_params;

/// Visits the members of `model`.
pub(crate) fn visit<L: Law, V: Visit>(model: &L, visitor: &mut V) -> Result<(), V::Error> {
    L::visit(&mut model.parts(), visitor)
}

/// The model whose members the visitor gives.
pub(crate) fn build<L: Law, V: Visit>(visitor: &mut V) -> Result<L, V::Error>
where
    V::Error: From<ParamError>,
{
    let mut parts = L::BLANK;
    L::visit(&mut parts, visitor)?;
    Ok(L::of_parts(&parts)?)
}

/// `model` with the members that the visitor changes.
pub(crate) fn change<L: Law, V: Visit>(model: &L, visitor: &mut V) -> Result<L, V::Error>
where
    V::Error: From<ParamError>,
{
    let mut parts = model.parts();
    L::visit(&mut parts, visitor)?;
    L::settle(&model.parts(), &mut parts);
    Ok(L::of_parts(&parts)?)
}
