//! Errors of an importer, and errors in an FMU.

use std::fmt;

use thiserror::Error;
use trocar_model::ParamError;

/// Phase of a simulation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Phase {
    /// After instantiation or reset.
    Instantiated,
    /// Initialization mode.
    Initialization,
    /// Stepping.
    Step,
    /// After the end.
    Terminated,
}

impl fmt::Display for Phase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Instantiated => "instantiated, not yet in initialization mode",
            Self::Initialization => "in initialization mode",
            Self::Step => "stepping",
            Self::Terminated => "terminated",
        })
    }
}

/// Why a call was rejected. A rejected call changes nothing.
#[derive(Debug, Clone, PartialEq, Error)]
pub(crate) enum FmuError {
    /// What the importer asks for, or what the FMU holds, is wrong.
    #[error("{0}")]
    Refused(String),
    /// Inconsistent parameters.
    #[error("{0}; the last valid parameters stay")]
    Parameter(#[from] ParamError),
    /// An internal error of the program.
    #[error("internal error, this instance is lost: {0}")]
    Internal(String),
}

impl FmuError {
    /// [`FmuError::Refused`] in words.
    pub(crate) fn refused(why: impl Into<String>) -> Self {
        Self::Refused(why.into())
    }

    /// A null pointer where a value is required; `what` it should point to.
    pub(crate) fn null(what: &str) -> Self {
        Self::Refused(format!("null pointer for {what}"))
    }

    /// No variable of that type has this value reference.
    pub(crate) fn unknown(reference: u32, kind: &str) -> Self {
        Self::Refused(format!("no variable of type {kind} has value reference {reference}"))
    }

    /// A value or an argument that is not finite.
    pub(crate) fn not_finite(name: &str, value: f64) -> Self {
        Self::Refused(format!("{name} must be finite, got {value}; the old value stays"))
    }

    /// A serialized state with another length, or a buffer that is too small.
    pub(crate) fn state_length(found: usize, expected: usize) -> Self {
        Self::Refused(format!("a state takes {expected} bytes, got {found}"))
    }

    /// A state of another model or another version of the program.
    pub(crate) fn state_foreign() -> Self {
        Self::refused("a state of another model, another input or another version")
    }

    /// A function that this FMU does not support.
    pub(crate) fn unsupported(why: &str) -> Self {
        Self::Refused(format!("not supported: {why}"))
    }
}
