//! Errors of the library as Python exceptions, with their messages as they are but for the names of
//! options.

use std::fmt::Display;
use std::io;

use pyo3::PyErr;
use pyo3::create_exception;
use pyo3::exceptions::{
    PyFileNotFoundError, PyIsADirectoryError, PyNotADirectoryError, PyOSError, PyPermissionError,
    PyRuntimeError, PyValueError,
};
use trocar::option::{Interface, spelt};

/// Exceptions by name, each with its base and its words.
macro_rules! exceptions {
    ($($name:ident($base:ident) = $words:literal;)*) => {$(
        create_exception!(trocar, $name, $base, $words);
    )*};
}

exceptions! {
    TrocarError(PyValueError) = "Input that cannot be used; the base of all errors of trocar.";
    ArrayError(TrocarError) = "An array of the wrong kind, shape or length, or one not writable.";
    RecordingError(TrocarError) = "A recording that cannot be used.";
    MotionError(TrocarError) = "A motion that a model cannot follow.";
    ModelFileError(TrocarError) = "A file or text that is no model.";
    ParameterError(TrocarError) = "A parameter or option out of its range.";
    IdentifyError(TrocarError) = "Recordings that no model can be identified from.";
    CompareError(TrocarError) = "Recordings that models cannot be compared on.";
    NotConverged(CompareError) = "A model that could not be fitted from any start.";
    BenchError(TrocarError) = "A virtual bench that cannot run.";
    TeleopError(TrocarError) = "A teleoperation loop that cannot run.";
    PlanError(TrocarError) = "A motion that cannot be planned.";
    InternalError(PyRuntimeError) = "A defect of trocar; please report it.";
}

/// An error of the library on its way to Python.
pub(crate) trait Raise {
    /// The exception.
    fn raise(self) -> PyErr;
}

/// Errors that are one exception, whatever they say.
macro_rules! raise {
    ($($error:path => $exception:ident,)*) => {$(
        impl Raise for $error {
            fn raise(self) -> PyErr {
                $exception::new_err(in_python(&self))
            }
        }
    )*};
}

raise! {
    trocar::bench::ConfigError => BenchError,
    trocar::teleop::ConfigError => TeleopError,
    trocar::teleop::StudyError => TeleopError,
    trocar::plan::ConfigError => PlanError,
    trocar::plan::PlanError => PlanError,
    trocar_model::ParamError => ParameterError,
}

impl Raise for trocar::recording::RecordingError {
    fn raise(self) -> PyErr {
        use trocar::recording::RecordingError as E;
        let text = in_python(&self);
        match self {
            E::Open { source, .. } | E::Read { source, .. } => os_error(&source, text),
            E::OutOfRange { .. } | E::HeavyMass { .. } | E::GravityWithoutMass { .. } => {
                ParameterError::new_err(text)
            }
            _ => RecordingError::new_err(text),
        }
    }
}

impl Raise for trocar::model_file::ModelFileError {
    fn raise(self) -> PyErr {
        use trocar::model_file::ModelFileError as E;
        fn unreadable(error: &E) -> Option<&io::Error> {
            match error {
                // Bytes that are no text are a fault of the contents.
                E::Unreadable(source) if source.kind() != io::ErrorKind::InvalidData => {
                    Some(source)
                }
                E::InFile { source, .. } => unreadable(source),
                _ => None,
            }
        }
        let text = in_python(&self);
        match unreadable(&self) {
            Some(source) => os_error(source, text),
            None => ModelFileError::new_err(text),
        }
    }
}

impl Raise for trocar::export::c::CError {
    fn raise(self) -> PyErr {
        match self {
            Self::Model(error) => error.raise(),
            Self::Output(error) => error.raise(),
            Self::Compensate(error) => error.raise(),
            other => ParameterError::new_err(in_python(&other)),
        }
    }
}

impl Raise for trocar::export::values::ValuesError {
    fn raise(self) -> PyErr {
        match self {
            Self::Recording(error) => error.raise(),
            other => ParameterError::new_err(in_python(&other)),
        }
    }
}

impl Raise for trocar::identify::IdentifyError {
    fn raise(self) -> PyErr {
        use trocar::identify::IdentifyError as E;
        let text = in_python(&self);
        match self {
            E::Degree(_) => ParameterError::new_err(text),
            _ => IdentifyError::new_err(text),
        }
    }
}

impl Raise for trocar::compare::CompareError {
    fn raise(self) -> PyErr {
        use trocar::compare::CompareError as E;
        match self {
            E::Identify(error) => error.raise(),
            E::Recording(error) => error.raise(),
            E::NoFit { .. } => NotConverged::new_err(in_python(&self)),
            _ => CompareError::new_err(in_python(&self)),
        }
    }
}

impl Raise for trocar::compensate::CompensateError {
    fn raise(self) -> PyErr {
        use trocar::compensate::CompensateError as E;
        match self {
            E::Model(error) => error.raise(),
            error @ E::NotAState { .. } => ArrayError::new_err(error.to_string()),
            other => ParameterError::new_err(in_python(&other)),
        }
    }
}

impl Raise for trocar::bench::BenchError {
    fn raise(self) -> PyErr {
        match self {
            Self::WhichExperiment => ParameterError::new_err(self.to_string()),
            _ => BenchError::new_err(self.to_string()),
        }
    }
}

impl Raise for trocar::teleop::OptionError {
    fn raise(self) -> PyErr {
        use trocar::teleop::OptionError as E;
        let text = in_python(&self);
        match self {
            E::Value(_) => ParameterError::new_err(text),
            _ => TeleopError::new_err(text),
        }
    }
}

impl Raise for trocar::output::OutputError {
    fn raise(self) -> PyErr {
        use trocar::output::OutputError as E;
        let text = in_python(&self);
        match &self {
            E::Create { source, .. } | E::Write { source, .. } => os_error(source, text),
            _ => PyOSError::new_err(text),
        }
    }
}

impl Raise for trocar::report::ReportError {
    fn raise(self) -> PyErr {
        match self {
            Self::Output(error) => error.raise(),
            other => InternalError::new_err(other.to_string()),
        }
    }
}

/// The exception that Python itself raises for such an error, with our message.
pub(crate) fn os_error(source: &io::Error, text: String) -> PyErr {
    match source.kind() {
        io::ErrorKind::NotFound => PyFileNotFoundError::new_err(text),
        io::ErrorKind::PermissionDenied => PyPermissionError::new_err(text),
        io::ErrorKind::IsADirectory => PyIsADirectoryError::new_err(text),
        io::ErrorKind::NotADirectory => PyNotADirectoryError::new_err(text),
        _ => PyOSError::new_err(text),
    }
}

/// The message with its options as Python writes them.
pub(crate) fn in_python(message: &impl Display) -> String {
    spelt(&message.to_string(), Interface::Python)
}

/// A number in a message: as a power of ten where it would fill the line with zeros.
pub(crate) fn number(value: f64) -> String {
    let is_short = (1e-6..1e9).contains(&value.abs());
    if value == 0.0 || !value.is_finite() || is_short {
        value.to_string()
    } else {
        format!("{value:e}")
    }
}
