//! Parameters that an identification keeps at a value, or within a range.

use std::fmt;
use std::str::FromStr;

use trocar_model::Quantity;

/// What can be kept.
const QUANTITIES: [Quantity; 14] = [
    Quantity::CoulombForce,
    Quantity::ViscousDamping,
    Quantity::HalfWidth,
    Quantity::StaticForce,
    Quantity::StribeckVelocity,
    Quantity::SealDamping,
    Quantity::UnmodelledMass,
    Quantity::SideFriction,
    Quantity::TiltedWeight,
    Quantity::PressureGain,
    Quantity::CreepVelocity,
    Quantity::DwellForce,
    Quantity::RelaxationStiffness,
    Quantity::RelaxationTime,
];

/// Ranges of parameters in place of those that the fit would give them; a single value is a range
/// without width. A term with such a parameter is in the model from the start, and stays. A seal of
/// which anything is kept has one stage; where F_c or β is, it is the same in both directions.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Kept([Option<[f64; 2]>; QUANTITIES.len()]);

/// Why a parameter cannot be kept so.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum KeptError {
    /// Not NAME=VALUE or NAME=LOW..HIGH.
    #[error("{0:?}: expected NAME=VALUE or NAME=LOW..HIGH, such as half_width_m=0.006")]
    Form(String),
    /// No parameter, or one that cannot be kept.
    #[error("{name:?}: expected one of {}", names())]
    Name {
        /// As given.
        name: String,
    },
    /// A range outside what the parameter can be.
    #[error("{name} {low} to {high}: expected finite numbers above 0, the lower one first")]
    Range {
        /// Of the parameter.
        name: String,
        /// As given.
        low: f64,
        /// As given.
        high: f64,
    },
    /// The same parameter again.
    #[error("{name}: given twice")]
    Twice {
        /// Of the parameter.
        name: String,
    },
}

fn names() -> String {
    QUANTITIES.map(|quantity| quantity.id().to_string()).join(", ")
}

impl Kept {
    /// Keeps one more parameter, by its name with the unit, within a range in that unit.
    ///
    /// # Errors
    /// A name that is none of those which can be kept, or was given before; ends that are not finite
    /// or not above 0, or in the wrong order.
    pub fn keep(&mut self, name: &str, [low, high]: [f64; 2]) -> Result<(), KeptError> {
        let name = name.trim().to_owned();
        let place = QUANTITIES.iter().position(|quantity| quantity.id().to_string() == name);
        let Some(place) = place else { return Err(KeptError::Name { name }) };
        if !(low > 0.0 && low <= high && high.is_finite()) {
            return Err(KeptError::Range { name, low, high });
        }
        match self.0[place].replace([low, high]) {
            Some(_) => Err(KeptError::Twice { name }),
            None => Ok(()),
        }
    }

    /// The range of a parameter that is kept.
    pub(super) fn range(&self, quantity: Quantity) -> Option<[f64; 2]> {
        let place = QUANTITIES.iter().position(|own| *own == quantity)?;
        self.0[place]
    }

    /// The value of a parameter whose range has no width.
    pub(super) fn value(&self, quantity: Quantity) -> Option<f64> {
        self.range(quantity).filter(|[low, high]| low == high).map(|[value, _]| value)
    }

    /// Whether nothing is kept.
    pub fn is_empty(&self) -> bool {
        self.0.iter().all(Option::is_none)
    }
}

/// One NAME=VALUE or NAME=LOW..HIGH.
#[derive(Debug, Clone, PartialEq)]
pub struct KeptParameter {
    name: String,
    range: [f64; 2],
}

impl FromStr for KeptParameter {
    type Err = KeptError;

    fn from_str(text: &str) -> Result<Self, KeptError> {
        let wrong = || KeptError::Form(text.to_owned());
        let number = |text: &str| text.trim().parse::<f64>().map_err(|_| wrong());
        let (name, range) = text.split_once('=').ok_or_else(wrong)?;
        let (low, high) = range.split_once("..").unwrap_or((range, range));
        let parameter = Self { name: name.to_owned(), range: [number(low)?, number(high)?] };
        Kept::default().keep(&parameter.name, parameter.range)?;
        Ok(parameter)
    }
}

impl TryFrom<&[KeptParameter]> for Kept {
    type Error = KeptError;

    fn try_from(all: &[KeptParameter]) -> Result<Self, KeptError> {
        let mut kept = Self::default();
        all.iter().try_for_each(|one| kept.keep(&one.name, one.range))?;
        Ok(kept)
    }
}

impl fmt::Display for Kept {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let kept =
            QUANTITIES.iter().zip(&self.0).filter_map(|(q, range)| Some((q.id(), (*range)?)));
        let words = kept.map(|(id, [low, high])| match low == high {
            true => format!("{id} {low}"),
            false => format!("{id} {low} to {high}"),
        });
        f.write_str(&words.collect::<Vec<_>>().join(", "))
    }
}
