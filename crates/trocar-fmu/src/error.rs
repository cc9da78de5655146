//! Errors of an importer, and errors in an FMU.

use std::fmt;

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
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum FmuError {
    /// A null pointer where a value is required.
    Null {
        /// What it should point to.
        what: &'static str,
    },
    /// Text that is not UTF-8.
    NotText {
        /// Name of the text.
        what: &'static str,
    },
    /// The resource location of FMI 2.0 is not a file URI.
    Location {
        /// As given.
        given: String,
    },
    /// A resource cannot be read.
    Resource {
        /// Path.
        path: String,
        /// Error of the operating system.
        what: String,
    },
    /// A resource that contains no valid model.
    Damaged {
        /// Path.
        path: String,
        /// Its length in bytes.
        bytes: usize,
        /// The error, unless the length is wrong.
        source: Option<FlatError>,
    },
    /// GUID or instantiation token of another FMU.
    Token {
        /// As given.
        given: String,
    },
    /// A call that is not allowed in this phase of the simulation.
    Phase {
        /// The phase.
        phase: Phase,
    },
    /// No variable of that type has this value reference.
    Unknown {
        /// Value reference.
        reference: u32,
        /// The requested type.
        kind: &'static str,
    },
    /// A variable that cannot be set now, or never.
    NotSettable {
        /// Name of the variable.
        name: String,
        /// The phase, or `None` if never.
        phase: Option<Phase>,
    },
    /// A value that is not finite.
    NotFinite {
        /// Name of the variable or argument.
        name: String,
        /// As given.
        value: f64,
    },
    /// A value below its minimum.
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
    Parameter(ParamError),
    /// Both initial force and initial deflection are set.
    TwoStarts {
        /// Force, N.
        force: f64,
        /// Deflection, m.
        deflection: f64,
    },
    /// A stop time that is not after the start time.
    Stop {
        /// Start, s.
        start: f64,
        /// Stop, s.
        stop: f64,
    },
    /// A communication step without positive length.
    StepSize {
        /// As given, s.
        given: f64,
    },
    /// A communication point that differs from the time of the simulation.
    Point {
        /// As given, s.
        given: f64,
        /// Time of the simulation, s.
        expected: f64,
    },
    /// A step beyond the stop time.
    BeyondStop {
        /// End of the step, s.
        to: f64,
        /// Stop, s.
        stop: f64,
    },
    /// A step whose displacement or speed is not finite.
    TooFast {
        /// The input, m or m/s.
        input: f64,
        /// Length of the step, s.
        duration: f64,
    },
    /// The numbers of values and references differ.
    Count {
        /// Number of references.
        references: usize,
        /// Number of values.
        values: usize,
    },
    /// A serialized state with another length, or a buffer that is too small.
    StateLength {
        /// Bytes found.
        found: usize,
        /// Bytes of a state.
        expected: usize,
    },
    /// A state of another model or another version of the program.
    StateForeign,
    /// A corrupted state.
    StateDamaged,
    /// An unknown log category.
    Category {
        /// As given.
        given: String,
    },
    /// A function that this FMU does not support.
    Unsupported {
        /// The reason.
        why: &'static str,
    },
    /// An internal error of the program.
    Internal {
        /// Its message.
        what: String,
    },
}

impl From<ParamError> for FmuError {
    fn from(error: ParamError) -> Self {
        Self::Parameter(error)
    }
}

impl fmt::Display for FmuError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Null { what } => write!(f, "null pointer for {what}"),
            Self::NotText { what } => write!(f, "{what} is not UTF-8"),
            Self::Category { given } => write!(f, "no log category \"{given}\""),
            Self::Unsupported { why } => write!(f, "not supported: {why}"),
            Self::Internal { what } => write!(f, "internal error, this instance is lost: {what}"),
            Self::Phase { phase } => write!(f, "not allowed now: the FMU is {phase}"),
            Self::Location { .. }
            | Self::Resource { .. }
            | Self::Damaged { .. }
            | Self::Token { .. } => self.of_resources(f),
            Self::Stop { .. }
            | Self::StepSize { .. }
            | Self::Point { .. }
            | Self::BeyondStop { .. }
            | Self::TooFast { .. } => self.of_steps(f),
            Self::StateLength { .. } | Self::StateForeign | Self::StateDamaged => self.of_states(f),
            _ => self.of_values(f),
        }
    }
}

impl FmuError {
    fn of_resources(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Location { given } => {
                write!(f, "resource location must be a file: URI, got \"{given}\"")
            }
            Self::Resource { path, what } => write!(f, "cannot read the model {path}: {what}"),
            Self::Damaged { path, bytes, source: None } => {
                write!(f, "the model {path} is damaged: {bytes} bytes are not one whole model")
            }
            Self::Damaged { path, source: Some(source), .. } => {
                write!(f, "the model {path} is damaged: {source}")
            }
            Self::Token { given } => write!(
                f,
                "GUID or token {given} is not that of the model in the resources: description and resources belong to \
                 different FMUs"
            ),
            _ => Ok(()),
        }
    }

    fn of_steps(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Stop { start, stop } => {
                write!(f, "stop time must be above the start time {start} s, got {stop} s")
            }
            Self::StepSize { given } => {
                write!(f, "step size must be positive and finite, got {given} s")
            }
            Self::Point { given, expected } => {
                write!(
                    f,
                    "communication point must be {expected} s, where the last step ended, got {given} s"
                )
            }
            Self::BeyondStop { to, stop } => {
                write!(f, "step ends at {to} s, beyond the stop time {stop} s")
            }
            Self::TooFast { input, duration } => {
                write!(
                    f,
                    "input {input} within {duration} s gives a displacement or velocity that is not finite"
                )
            }
            _ => Ok(()),
        }
    }

    fn of_states(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::StateLength { found, expected } => {
                write!(f, "a state takes {expected} bytes, got {found}")
            }
            Self::StateForeign => {
                f.write_str("a state of another model, another input or another version")
            }
            Self::StateDamaged => f.write_str("the serialised state is damaged"),
            _ => Ok(()),
        }
    }

    fn of_values(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown { reference, kind } => {
                write!(f, "no variable of type {kind} has value reference {reference}")
            }
            Self::NotSettable { name, phase: None } => write!(f, "{name} cannot be set"),
            Self::NotSettable { name, phase: Some(phase) } => {
                write!(f, "{name} cannot be set while the FMU is {phase}")
            }
            Self::NotFinite { name, value } => {
                write!(f, "{name} must be finite, got {value}; the old value stays")
            }
            Self::TooSmall { name, value, least, above } => {
                let bound = if *above { "above" } else { "at least" };
                write!(f, "{name} must be {bound} {least}, got {value}; the old value stays")
            }
            Self::Parameter(error) => {
                write!(f, "{error}; the last valid parameters stay")
            }
            Self::TwoStarts { force, deflection } => write!(
                f,
                "initial_force_n = {force} N and initial_deflection_m = {deflection} m: at most one may differ from 0"
            ),
            Self::Count { references, values } => {
                write!(f, "{references} value references need as many values, got {values}")
            }
            _ => Ok(()),
        }
    }
}

impl std::error::Error for FmuError {}
