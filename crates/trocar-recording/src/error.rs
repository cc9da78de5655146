//! Errors of reading: what failed, where, what was found, what was expected, and a remedy on a
//! `hint:` line.

use std::fmt;
use std::path::Path;

/// A position in a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Location {
    /// Line of the file, counted from 1.
    Line(u64),
    /// Row of a table, counted from 1.
    Row(u64),
    /// Sample of a recording that was not read from a file, counted from 0.
    Sample(usize),
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Location::Line(line) => write!(f, "line {line}"),
            Location::Row(row) => write!(f, "row {row}"),
            Location::Sample(index) => write!(f, "sample {index}"),
        }
    }
}

/// The way out where a folder was named.
fn of_a_folder(source: &std::io::Error) -> &'static str {
    match source.kind() {
        std::io::ErrorKind::IsADirectory => {
            "\n\nhint: name a file in it; `trocar fleet` takes a folder of recordings"
        }
        _ => "",
    }
}

/// Why a recording cannot be used.
///
/// `file` is the name as the caller gave it, so it can be pasted from the message into a shell.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordingError {
    /// The file cannot be opened.
    #[error("{file}: cannot open: {source}{}", of_a_folder(source))]
    Open {
        /// File name as given by the caller.
        file: String,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The file was opened, but reading failed part way.
    #[error("{file} line {line}: cannot read further: {source}")]
    Read {
        /// File name as given by the caller.
        file: String,
        /// Line reached.
        line: u64,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// Something of the file cannot be used.
    #[error("{place}: {problem}")]
    Unusable {
        /// File name as given by the caller, and where in the file if that is known.
        place: String,
        /// What was found, what was expected, and the remedy.
        problem: String,
    },
    /// No bytes, or only blank and comment lines.
    #[error("{file}: empty, expected a header line and rows of time, position and force")]
    Empty {
        /// File name as given by the caller.
        file: String,
    },
    /// Only a header line.
    #[error("{file} line {line}: a header without any row below it")]
    HeaderOnly {
        /// File name as given by the caller.
        file: String,
        /// Line of the header.
        line: u64,
    },
    /// The first line contains numbers, so the columns have no names.
    #[error(
        "{file} line {line}: no header, the first line is the row of numbers '{found}'\n\nhint: {hint}"
    )]
    NoHeader {
        /// File name as given by the caller.
        file: String,
        /// First line.
        line: u64,
        /// The first line, shortened.
        found: String,
        /// The remedy, with an option that fits the number of columns, if there is one.
        hint: String,
    },
    /// Required columns are missing, could be several, or have no unit.
    #[error("{file}{place}: {problems}\n\nhint: {hint}")]
    UnclearColumns {
        /// File name as given by the caller.
        file: String,
        /// Place in the file, ` line 1`; empty if a table has no lines.
        place: Box<str>,
        /// All that is unclear.
        problems: Box<str>,
        /// Whether columns are only missing: none could be several or has an unclear unit.
        only_missing: bool,
        /// The remedy, with a value for `--columns` if there is one.
        hint: Box<str>,
    },
    /// No topic of a robot log clearly matches a quantity.
    #[error("{file}: {problems}\n\nhint: {option}`trocar inspect` shows all topics")]
    UnclearTopic {
        /// File name as given by the caller.
        file: String,
        /// Each quantity that is unclear, with the available topics.
        problems: String,
        /// An option that says which, if one is likely.
        option: String,
    },
    /// The `--columns` mapping itself is invalid.
    #[error("‹columns› entry '{entry}' is {problem}\n\nhint: {hint}")]
    BadColumns {
        /// The entry concerned.
        entry: Box<str>,
        /// What is wrong with it.
        problem: Box<str>,
        /// The remedy; where the file can be opened, an option that fits it.
        hint: Box<str>,
    },
    /// Too few samples to determine an interval, a velocity and an acceleration.
    #[error("{file}: found {found} usable samples, expected at least {needed}{lost}")]
    TooFewSamples {
        /// File name as given by the caller.
        file: String,
        /// Usable samples.
        found: usize,
        /// What was left out, and the way out.
        lost: String,
        /// Fewest samples of a recording.
        needed: usize,
    },
    /// The range of the position exceeds that of any instrument.
    #[error(
        "{file}: the position covers {stroke} m, expected at most {limit} m\n\nhint: use position_mm instead of position_m if the numbers are millimetres"
    )]
    StrokeTooLong {
        /// File name as given by the caller.
        file: String,
        /// Range of the position, in m.
        stroke: f64,
        /// Longest accepted, in m.
        limit: f64,
    },
    /// The given columns have different lengths.
    #[error("{file}: {column} has {found} samples, expected {expected} as time has")]
    Lengths {
        /// Name of the recording.
        file: String,
        /// The column concerned.
        column: &'static str,
        /// Its length.
        found: usize,
        /// Length of the time column.
        expected: usize,
    },
    /// The recording does not fit into the allowed memory.
    #[error(
        "{file}: about {rows} rows need {needed_mb} MB of memory, expected at most {limit_mb} MB\n\nhint: identify from excerpts, for example ‹most_samples=200000›, or from a part, for example ‹from_s=0› ‹to_s=60›; simulate and validate need no such memory"
    )]
    TooLarge {
        /// File name as given by the caller.
        file: String,
        /// Rows, estimated from the first ones.
        rows: u64,
        /// Memory for the columns, in MB.
        needed_mb: u64,
        /// Memory allowed, in MB.
        limit_mb: u64,
    },
    /// An option with an invalid value.
    #[error("‹{option}› must be {allowed}, got {found} {unit}")]
    OutOfRange {
        /// Name of the option.
        option: &'static str,
        /// What is allowed.
        allowed: &'static str,
        /// The given value.
        found: f64,
        /// Its unit.
        unit: &'static str,
    },
    /// A moving mass whose inertia the readings cannot contain.
    #[error(
        "{name}: ‹moving_mass_kg› is {found} kg, whose inertia would range over {inertia:.1} N, and the readings range over {readings:.1} N\n\n\
         hint: {found} g (grams?) are ‹moving_mass_kg={}›; left out, the mass is estimated",
        1e-3 * found
    )]
    HeavyMass {
        /// The recording.
        name: String,
        /// The given value, kg.
        found: f64,
        /// Range of its inertia, N.
        inertia: f64,
        /// Range of the readings, N.
        readings: f64,
    },
    /// Gravity without a moving mass on which it acts.
    #[error(
        "gravity_m_s2 is {gravity} m/s² without a moving mass on which it acts: give moving_mass_kg above 0, or leave \
         gravity_m_s2 out (the weight then is part of the offset)"
    )]
    GravityWithoutMass {
        /// The given value, m/s².
        gravity: f64,
    },
}

impl RecordingError {
    /// [`RecordingError::Unusable`] at `place`, which names the file.
    pub fn unusable(place: impl fmt::Display, problem: impl Into<String>) -> Self {
        Self::Unusable { place: place.to_string(), problem: problem.into() }
    }

    /// A cell that is empty, NaN or infinite where every row is required (`simulate`).
    pub fn non_finite(file: &str, place: Location, quantity: &str, value: f64) -> Self {
        let found = if value.is_nan() { "empty or nan" } else { "infinite" };
        let problem = format!(
            "{quantity} is {found}, expected a finite number\n\nhint: remove the row or fill it in; a replay needs every position"
        );
        Self::unusable(format_args!("{file} {place}"), problem)
    }

    /// Time that decreases by more than one sampling interval, s.
    pub fn time_goes_back(file: &str, place: Location, from: f64, to: f64) -> Self {
        let problem = format!(
            "time goes back from {from} s to {to} s, expected it to advance\n\nhint: if the clock was reset there, cut the file in two and give both parts"
        );
        Self::unusable(format_args!("{file} {place}"), problem)
    }

    /// [`RecordingError::Open`] of what is at `path`.
    pub(crate) fn cannot_open(path: &Path) -> impl Fn(std::io::Error) -> Self {
        move |source| Self::Open { file: path.display().to_string(), source }
    }

    /// A column of `--columns` that is there twice.
    pub(crate) fn named_twice(column: &str) -> Self {
        Self::bad_columns(column, "a column named for two quantities, expected one".to_owned())
    }

    /// [`RecordingError::BadColumns`] before the file is known.
    pub(crate) fn bad_columns(entry: impl Into<Box<str>>, problem: String) -> Self {
        let hint = "give a name with its unit per column, '-' to skip one, as in time_s,position_mm,force_n,-, \
                    or say by name which column is which, as in position_mm=x,force_n=-fz";
        Self::BadColumns { entry: entry.into(), problem: problem.into(), hint: hint.into() }
    }
}
