//! States and models as numbers in order: what is read from a row, and what each part of a state
//! puts there.

use crate::error::ParamError;
use crate::parameter::Parameters;

/// Why a row is no model or no state.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FlatError {
    /// The row ends too early, or the place for it is too small.
    Length {
        /// Numbers there are.
        found: usize,
    },
    /// A type tag, which determines what the next numbers are, is not valid.
    Tag {
        /// Where it stands, from 0.
        place: usize,
        /// What was found.
        found: f64,
    },
    /// Parameters that make no model.
    Parameter(ParamError),
}

impl From<ParamError> for FlatError {
    fn from(error: ParamError) -> Self {
        Self::Parameter(error)
    }
}

impl core::fmt::Display for FlatError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Length { found } => write!(f, "{found} numbers are too few"),
            Self::Tag { place, found } => {
                write!(f, "number {place} must be a valid type tag, got {found}")
            }
            Self::Parameter(error) => error.fmt(f),
        }
    }
}

impl core::error::Error for FlatError {}

/// The number at a place, or why there is none.
pub(crate) trait Numbers: Fn(usize) -> Result<f64, FlatError> {}

impl<F: Fn(usize) -> Result<f64, FlatError>> Numbers for F {}

/// Takes numbers from the front.
pub(crate) struct Reader<F> {
    number: F,
    pub(crate) place: usize,
}

impl<F: Numbers> Reader<F> {
    pub(crate) fn new(number: F) -> Self {
        Self { number, place: 0 }
    }

    /// `params` with its numbers from the row.
    pub(crate) fn fields<T: Parameters>(&mut self, mut params: T) -> Result<T, FlatError> {
        for field in T::FIELDS {
            (field.set)(&mut params, self.one()?);
        }
        Ok(params)
    }

    pub(crate) fn fill(&mut self, values: &mut [f64]) -> Result<(), FlatError> {
        values.iter_mut().try_for_each(|value| self.one().map(|number| *value = number))
    }

    pub(crate) fn take<const N: usize>(&mut self) -> Result<[f64; N], FlatError> {
        let mut values = [0.0; N];
        self.fill(&mut values)?;
        Ok(values)
    }

    pub(crate) fn one(&mut self) -> Result<f64, FlatError> {
        let value = (self.number)(self.place)?;
        self.place += 1;
        Ok(value)
    }

    /// A whole number from `least` to `most`.
    pub(crate) fn count(&mut self, least: usize, most: usize) -> Result<usize, FlatError> {
        let found = self.one()?;
        if found >= least as f64 && found <= most as f64 && libm::floor(found) == found {
            return Ok(found as usize);
        }
        Err(FlatError::Tag { place: self.place - 1, found })
    }

    pub(crate) fn flag(&mut self) -> Result<bool, FlatError> {
        let found = self.one()?;
        match found {
            0.0 => Ok(false),
            1.0 => Ok(true),
            _ => Err(FlatError::Tag { place: self.place - 1, found }),
        }
    }

    pub(crate) fn expect(&mut self, value: f64) -> Result<(), FlatError> {
        let found = self.one()?;
        if found == value { Ok(()) } else { Err(FlatError::Tag { place: self.place - 1, found }) }
    }
}

/// A state, or a part of it, as numbers in order.
pub(crate) trait Row {
    fn see(&self, see: &mut impl FnMut(f64));

    fn set(&mut self, from: &mut Reader<impl Numbers>) -> Result<(), FlatError>;
}

/// Lists the parts of a state in the order of its row.
macro_rules! row {
    ($type:ident { $($part:ident),* $(,)? }) => {
        impl crate::row::Row for $type {
            fn see(&self, see: &mut impl FnMut(f64)) {
                $(crate::row::Row::see(&self.$part, see);)*
            }

            fn set(
                &mut self,
                from: &mut crate::row::Reader<impl crate::row::Numbers>,
            ) -> Result<(), crate::row::FlatError> {
                $(crate::row::Row::set(&mut self.$part, from)?;)*
                Ok(())
            }
        }
    };
}

pub(crate) use row;

impl Row for f64 {
    fn see(&self, see: &mut impl FnMut(f64)) {
        see(*self);
    }

    fn set(&mut self, from: &mut Reader<impl Numbers>) -> Result<(), FlatError> {
        *self = from.one()?;
        Ok(())
    }
}

impl Row for bool {
    fn see(&self, see: &mut impl FnMut(f64)) {
        see(f64::from(u8::from(*self)));
    }

    fn set(&mut self, from: &mut Reader<impl Numbers>) -> Result<(), FlatError> {
        *self = from.flag()?;
        Ok(())
    }
}

/// A number of parts, which the model determines.
impl Row for usize {
    fn see(&self, see: &mut impl FnMut(f64)) {
        see(*self as f64);
    }

    fn set(&mut self, from: &mut Reader<impl Numbers>) -> Result<(), FlatError> {
        from.expect(*self as f64)
    }
}

impl<T: Row, const N: usize> Row for [T; N] {
    fn see(&self, see: &mut impl FnMut(f64)) {
        self.iter().for_each(|part| part.see(see));
    }

    fn set(&mut self, from: &mut Reader<impl Numbers>) -> Result<(), FlatError> {
        self.iter_mut().try_for_each(|part| part.set(from))
    }
}
