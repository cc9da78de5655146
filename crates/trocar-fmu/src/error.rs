//! Errors of an importer, and errors in an FMU.

use std::fmt;

use thiserror::Error;
use trocar_model::ParamError;
use trocar_model::flat::FlatError;

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
#[non_exhaustive]
#[derive(Debug, Clone, PartialEq, Error)]
pub(crate) enum FmuError {
    /// A null pointer where a value is required.
    #[error("null pointer for {what}")]
    Null {
        /// What it should point to.
        what: &'static str,
    },
    /// Text that is not UTF-8.
    #[error("{what} is not UTF-8")]
    NotText {
        /// Name of the text.
        what: &'static str,
    },
    /// The resource location of FMI 2.0 is not a file URI.
    #[error("resource location must be a file: URI, got \"{given}\"")]
    Location {
        /// As given.
        given: String,
    },
    /// A resource cannot be read.
    #[error("cannot read the model {path}: {what}")]
    Resource {
        /// Path.
        path: String,
        /// Error of the operating system.
        what: String,
    },
    /// A resource that contains no valid model.
    #[error("the model {path} is damaged: {}", damage(*.bytes, .source.as_ref()))]
    Damaged {
        /// Path.
        path: String,
        /// Its length in bytes.
        bytes: usize,
        /// The error, unless the length is wrong.
        source: Option<FlatError>,
    },
    /// GUID or instantiation token of another FMU.
    #[error(
        "GUID or token {given} is not that of the model in the resources: description and resources belong to different FMUs"
    )]
    Token {
        /// As given.
        given: String,
    },
    /// A call that is not allowed in this phase of the simulation.
    #[error("not allowed now: the FMU is {phase}")]
    Phase {
        /// The phase.
        phase: Phase,
    },
    /// No variable of that type has this value reference.
    #[error("no variable of type {kind} has value reference {reference}")]
    Unknown {
        /// Value reference.
        reference: u32,
        /// The requested type.
        kind: &'static str,
    },
    /// A variable that cannot be set now, or never.
    #[error("{name} cannot be set{}", .phase.map_or(String::new(), |phase| format!(" while the FMU is {phase}")))]
    NotSettable {
        /// Name of the variable.
        name: String,
        /// The phase, or `None` if never.
        phase: Option<Phase>,
    },
    /// A value that is not finite.
    #[error("{name} must be finite, got {value}; the old value stays")]
    NotFinite {
        /// Name of the variable or argument.
        name: String,
        /// As given.
        value: f64,
    },
    /// A value below its minimum.
    #[error("{name} must be {} {least}, got {value}; the old value stays", if *.above { "above" } else { "at least" })]
    TooSmall {
        /// Name of the variable.
        name: String,
        /// As given.
        value: f64,
        /// The minimum.
        least: f64,
        /// Whether the minimum itself is excluded.
        above: bool,
    },
    /// Inconsistent parameters.
    #[error("{0}; the last valid parameters stay")]
    Parameter(#[from] ParamError),
    /// Both initial force and initial deflection are set.
    #[error(
        "initial_force_n = {force} N and initial_deflection_m = {deflection} m: at most one may differ from 0"
    )]
    TwoStarts {
        /// Force, N.
        force: f64,
        /// Deflection, m.
        deflection: f64,
    },
    /// A stop time that is not after the start time.
    #[error("stop time must be above the start time {start} s, got {stop} s")]
    Stop {
        /// Start, s.
        start: f64,
        /// Stop, s.
        stop: f64,
    },
    /// A communication step without positive length.
    #[error("step size must be positive and finite, got {given} s")]
    StepSize {
        /// As given, s.
        given: f64,
    },
    /// A communication point that differs from the time of the simulation.
    #[error("communication point must be {expected} s, where the last step ended, got {given} s")]
    Point {
        /// As given, s.
        given: f64,
        /// Time of the simulation, s.
        expected: f64,
    },
    /// A step beyond the stop time.
    #[error("step ends at {to} s, beyond the stop time {stop} s")]
    BeyondStop {
        /// End of the step, s.
        to: f64,
        /// Stop, s.
        stop: f64,
    },
    /// A step whose displacement or speed is not finite.
    #[error(
        "input {input} within {duration} s gives a displacement or velocity that is not finite"
    )]
    TooFast {
        /// The input, m or m/s.
        input: f64,
        /// Length of the step, s.
        duration: f64,
    },
    /// The numbers of values and references differ.
    #[error("{references} value references need as many values, got {values}")]
    Count {
        /// Number of references.
        references: usize,
        /// Number of values.
        values: usize,
    },
    /// A serialized state with another length, or a buffer that is too small.
    #[error("a state takes {expected} bytes, got {found}")]
    StateLength {
        /// Bytes found.
        found: usize,
        /// Bytes of a state.
        expected: usize,
    },
    /// A state of another model or another version of the program.
    #[error("a state of another model, another input or another version")]
    StateForeign,
    /// A corrupted state.
    #[error("the serialised state is damaged")]
    StateDamaged,
    /// An unknown log category.
    #[error("no log category \"{given}\"")]
    Category {
        /// As given.
        given: String,
    },
    /// A function that this FMU does not support.
    #[error("not supported: {why}")]
    Unsupported {
        /// The reason.
        why: &'static str,
    },
    /// An internal error of the program.
    #[error("internal error, this instance is lost: {what}")]
    Internal {
        /// Its message.
        what: String,
    },
}

/// What is wrong with a resource of `bytes` bytes.
fn damage(bytes: usize, fault: Option<&FlatError>) -> String {
    match fault {
        Some(fault) => fault.to_string(),
        None => format!("{bytes} bytes are not one whole model"),
    }
}
