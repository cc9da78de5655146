//! What is wrong with a parameter set. Everything is checked once, when a model is built.

use core::fmt;

use crate::parameter::{
    Declaration, Field, MAX_DEGREE, MAX_ELEMENTS, ParameterId, Parameters, Range,
};

/// Why a parameter set was refused. Values are carried in SI units.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ParamError {
    /// A value is NaN or infinite.
    NotFinite {
        /// Name of the parameter.
        name: &'static str,
        /// The value found.
        value: f64,
    },
    /// A parameter lies outside its range.
    OutOfRange {
        /// Which.
        id: ParameterId,
        /// The value found.
        value: f64,
    },
    /// A length must be zero or above.
    Negative {
        /// What it is.
        name: &'static str,
        /// The value found, m.
        value: f64,
    },
    /// The static force lies below the Coulomb force.
    StaticBelowCoulomb {
        /// F_s, N.
        static_force: f64,
        /// F_c, N.
        coulomb_force: f64,
    },
    /// A lag of the Stribeck curve for a contact that does not creep.
    LagWithoutCreep {
        /// T, s.
        lag: f64,
    },
    /// The damping force sigma(zdot)*zdot falls somewhere as the deformation speed grows.
    DampingForceFalls {
        /// Smallest slope of the damping force over all speeds, N*s/m; minus infinity when it is
        /// unbounded.
        slope: f64,
    },
    /// A polynomial piece has no coefficient or more than [`crate::MAX_DEGREE`] + 1.
    CoefficientCount {
        /// Number of coefficients found.
        count: usize,
    },
    /// A polynomial piece has no length.
    EmptyInterval {
        /// Left end, m.
        from: f64,
        /// Right end, m.
        to: f64,
    },
    /// The two pieces of a branch do not meet.
    PiecesApart {
        /// Right end of the left piece, m.
        left_ends: f64,
        /// Left end of the right piece, m.
        right_starts: f64,
    },
    /// The force of a branch jumps where its two pieces join, against EMS (25).
    ForceJump {
        /// The join, m.
        join: f64,
        /// Force of the left piece there, N.
        left: f64,
        /// Force of the right piece there, N.
        right: f64,
    },
    /// A branch does not span a symmetric interval, or the two branches span different ones.
    IntervalNotCentred {
        /// Left end, m.
        from: f64,
        /// Right end, m.
        to: f64,
        /// Half width asked for, m.
        half_width: f64,
    },
    /// The force at the right end of a branch does not exceed the force at the left end.
    EndForcesNotRising {
        /// Force at -c, N.
        at_left: f64,
        /// Force at +c, N.
        at_right: f64,
    },
    /// A branch misses the static force at an end of the deformation range.
    EndPointConstraint {
        /// The end, m.
        deflection: f64,
        /// Force of the branch there, N.
        force: f64,
        /// Force required there, N.
        expected: f64,
    },
    /// The yield stiffness is below the steepest slope of the half gap between the branches.
    YieldStiffnessTooLow {
        /// The value found, N/m.
        given: f64,
        /// The least value allowed, N/m.
        minimum: f64,
    },
    /// F_s > F_c with neither viscous nor seal damping: the deflection would have to jump.
    UndampedBreakaway {
        /// F_s, N.
        static_force: f64,
        /// F_c, N.
        coulomb_force: f64,
    },
    /// Rotation of a classical model.
    RotationOfClassical,
    /// A model has no element or more than [`crate::MAX_ELEMENTS`].
    ElementCount {
        /// Number of elements found.
        count: usize,
    },
    /// The limit deflection of an element vanishes or is infinite beside the other numbers.
    LimitDeflection {
        /// Index of the element, from 0; messages count from 1.
        index: usize,
        /// C·k/(α·F_c), 1/s.
        rate: f64,
    },
    /// The shares of the elements in the sliding force do not add up to 1.
    SharesNotOne {
        /// The sum found.
        sum: f64,
    },
    /// The limit forces of the hysteresis bank add up to less than the static force: its deflection
    /// would run away.
    BankTooWeak {
        /// Sum of the limit forces, N.
        limit_force: f64,
        /// F_s, N.
        static_force: f64,
    },
}

/// Most coefficients of a piece.
const MOST: usize = MAX_DEGREE + 1;

impl fmt::Display for ParamError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NotFinite { name, value } => write!(f, "{name} must be finite, got {value}"),
            Self::OutOfRange { id, value } => out_of_range(f, id, value),
            Self::Negative { name, value } => {
                write!(f, "{name} must not be negative, got {value} m")
            }
            Self::StaticBelowCoulomb { static_force, coulomb_force } => write!(
                f,
                "static_force_n must be at least coulomb_force_n = {coulomb_force} N, got {static_force} N"
            ),
            Self::LagWithoutCreep { lag } => {
                write!(f, "friction_lag_s = {lag} s needs a creep_velocity_m_s above 0 m/s")
            }
            Self::DampingForceFalls { slope } => write!(
                f,
                "seal damping force must not fall with deformation speed, its slope reaches {slope} N s/m"
            ),
            Self::CoefficientCount { count } => {
                write!(f, "a piece needs 1 to {MOST} Legendre coefficients, got {count}")
            }
            Self::EmptyInterval { from, to } => {
                write!(f, "a piece must end right of its start, got [{from}, {to}] m")
            }
            Self::PiecesApart { left_ends, right_starts } => write!(
                f,
                "the pieces of a branch must meet, left ends at {left_ends} m, right starts at {right_starts} m"
            ),
            Self::ForceJump { join, left, right } => write!(
                f,
                "a branch must be continuous at its join {join} m, got {left} N and {right} N"
            ),
            Self::IntervalNotCentred { from, to, half_width } => write!(
                f,
                "a branch must span [{}, {half_width}] m, got [{from}, {to}] m",
                -half_width
            ),
            Self::EndForcesNotRising { at_left, at_right } => write!(
                f,
                "the force of a branch must be higher at its right end, got {at_left} N and {at_right} N"
            ),
            Self::EndPointConstraint { deflection, force, expected } => write!(
                f,
                "both branches must pass {expected} N (the static force) at {deflection} m, got {force} N"
            ),
            Self::YieldStiffnessTooLow { given, minimum } => write!(
                f,
                "yield_stiffness_n_m must be at least {minimum} N/m, the steepest slope of the half gap, got {given} N/m"
            ),
            Self::UndampedBreakaway { static_force, coulomb_force } => write!(
                f,
                "static_force_n {static_force} N above coulomb_force_n {coulomb_force} N needs viscous_damping_n_s_m or seal damping above zero"
            ),
            Self::RotationOfClassical => {
                write!(f, "rotation needs an EMS model: the classical models know the axis only")
            }
            Self::ElementCount { count } => {
                write!(f, "a model needs 1 to {MAX_ELEMENTS} elements, got {count}")
            }
            Self::LimitDeflection { index, rate } => limit_deflection(f, index, rate),
            Self::SharesNotOne { sum } => {
                write!(f, "the shares of the elements must add up to 1, got {sum}")
            }
            Self::BankTooWeak { limit_force, static_force } => write!(
                f,
                "the limit forces of the elements must add up to at least static_force_n = {static_force} N, got {limit_force} N"
            ),
        }
    }
}

impl core::error::Error for ParamError {}

fn limit_deflection(f: &mut fmt::Formatter<'_>, index: usize, rate: f64) -> fmt::Result {
    let element = index + 1;
    write!(
        f,
        "attraction·stiffness/(share·coulomb_force) of element {element} must be finite and above 0, got {rate} 1/s"
    )
}

fn out_of_range(f: &mut fmt::Formatter<'_>, id: ParameterId, value: f64) -> fmt::Result {
    let Declaration { range, unit, .. } = id.declaration();
    let (gap, unit) = if unit.ending.is_empty() { ("", "") } else { (" ", unit.si) };
    match range {
        Range::Any => write!(f, "{id} must be finite, got {value}"),
        Range::AtLeast(least) => {
            write!(f, "{id} must be finite and at least {least}{gap}{unit}, got {value}{gap}{unit}")
        }
        Range::AboveZero => {
            write!(f, "{id} must be finite and above 0{gap}{unit}, got {value}{gap}{unit}")
        }
        Range::AboveZeroOrInfinite => {
            write!(f, "{id} must be above 0{gap}{unit}, got {value}{gap}{unit}")
        }
    }
}

pub(crate) fn finite(name: &'static str, value: f64) -> Result<f64, ParamError> {
    if value.is_finite() { Ok(value) } else { Err(ParamError::NotFinite { name, value }) }
}

/// `value`, if it lies in the range of the parameter.
pub(crate) fn in_range(id: impl Into<ParameterId>, value: f64) -> Result<f64, ParamError> {
    let id = id.into();
    if id.quantity.range().holds(value) {
        Ok(value)
    } else {
        Err(ParamError::OutOfRange { id, value })
    }
}

/// Checks the range of each number.
pub(crate) fn check_fields<T: Parameters>(params: &T) -> Result<(), ParamError> {
    T::FIELDS.iter().try_for_each(|field| in_range(field.quantity, (field.get)(params)).map(drop))
}

/// The same for an element with the index `index`, from 0, in its model.
pub(crate) fn check_element<T: Parameters>(params: &T, index: usize) -> Result<(), ParamError> {
    let id = |field: &Field<T>| field.quantity.id().of_element(index);
    T::FIELDS.iter().try_for_each(|field| in_range(id(field), (field.get)(params)).map(drop))
}

pub(crate) fn not_negative(name: &'static str, value: f64) -> Result<f64, ParamError> {
    finite(name, value)?;
    if value >= 0.0 { Ok(value) } else { Err(ParamError::Negative { name, value }) }
}
