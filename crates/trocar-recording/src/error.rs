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
    /// The bytes are not UTF-8 or ASCII text.
    #[error(
        "{file}: looks like {found}, expected text separated by commas, semicolons, tabs or spaces\n\nhint: export the recording as CSV in UTF-8"
    )]
    NotText {
        /// File name as given by the caller.
        file: String,
        /// Probable type of the data, from the first bytes.
        found: &'static str,
    },
    /// A line too long for a row of numbers.
    #[error("{file} line {line}: longer than {limit} bytes, expected one row of numbers per line")]
    LineTooLong {
        /// File name as given by the caller.
        file: String,
        /// Line concerned.
        line: u64,
        /// Longest line accepted, in bytes.
        limit: usize,
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
    /// A stream where a file must be read more than once.
    #[error(
        "{file}: a stream, expected a file that can be read more than once\n\nhint: save it first"
    )]
    IsStream {
        /// Name as given by the caller.
        file: String,
    },
    /// Several tables of a file contain the required quantities.
    #[error(
        "{file}: time, position and force could come from {found}, expected one\n\nhint: say which, for example ‹topic='{example}'›; `trocar inspect` shows them"
    )]
    AmbiguousTable {
        /// File name as given by the caller.
        file: String,
        /// Their names.
        found: String,
        /// One of them.
        example: String,
    },
    /// The required quantities are in different tables of a file.
    #[error(
        "{file}: {found}, expected all as columns of one table\n\nhint: save them together: arrays of equal length in one group, at common times; `trocar inspect` lists all tables"
    )]
    SeparateTables {
        /// File name as given by the caller.
        file: String,
        /// Each quantity with its table.
        found: String,
    },
    /// No table, or more than one, has the requested name.
    #[error(
        "{file}: {found} topics or tables are named '{topic}', expected one\n\nhint: the file holds {expected}"
    )]
    NoSuchTable {
        /// File name as given by the caller.
        file: String,
        /// The requested name.
        topic: String,
        /// Number of tables with that name.
        found: usize,
        /// All names.
        expected: String,
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
    /// An option that does not fit the file.
    #[error("{file}: {option} {problem}")]
    BadOption {
        /// File name as given by the caller.
        file: String,
        /// The option, as on the command line.
        option: &'static str,
        /// What is wrong with it.
        problem: String,
    },
    /// A row has too few or too many fields.
    #[error(
        "{file} line {line}: found {found} fields, expected {expected} as in {reference}{hint}"
    )]
    FieldCount {
        /// File name as given by the caller.
        file: String,
        /// Line concerned.
        line: u64,
        /// Fields in this row.
        found: usize,
        /// Fields in the header or mapping.
        expected: usize,
        /// Source of the expected number.
        reference: &'static str,
        /// Remedy, with its own line break, or empty.
        hint: Box<str>,
    },
    /// A cell of a used column is not a number.
    #[error("{file} line {line}: found '{found}' in column {column}, expected a number{hint}")]
    NotANumber {
        /// File name as given by the caller.
        file: String,
        /// Line concerned.
        line: u64,
        /// Name of the column.
        column: String,
        /// The cell, shortened.
        found: String,
        /// Remedy, with its own line break, or empty.
        hint: Box<str>,
    },
    /// A cell of a used column of a spreadsheet is not a number.
    #[error(
        "{file} sheet '{sheet}' cell {cell}: found '{found}' in column {column}, expected a number\n\nhint: {hint}"
    )]
    CellNotANumber {
        /// File name as given by the caller.
        file: String,
        /// Name of the sheet.
        sheet: Box<str>,
        /// The cell, such as `B17`.
        cell: Box<str>,
        /// Name of the column.
        column: Box<str>,
        /// Its content, shortened.
        found: Box<str>,
        /// Remedy.
        hint: &'static str,
    },
    /// A cell is empty, NaN or infinite where every row is required (`simulate`).
    #[error(
        "{file} {place}: {quantity} is {found}, expected a finite number\n\nhint: remove the row or fill it in; a replay needs every position"
    )]
    NonFinite {
        /// File name as given by the caller.
        file: String,
        /// Where.
        place: Location,
        /// The quantity concerned.
        quantity: &'static str,
        /// `empty or nan` or `infinite`.
        found: &'static str,
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
    /// Time decreases by more than one sampling interval.
    #[error(
        "{file} {place}: time goes back from {from} s to {to} s, expected it to advance\n\nhint: if the clock was reset there, cut the file in two and give both parts"
    )]
    TimeGoesBack {
        /// File name as given by the caller.
        file: String,
        /// Where.
        place: Location,
        /// Time before, in s.
        from: f64,
        /// Time found, in s.
        to: f64,
    },
    /// Time has the same value throughout.
    #[error(
        "{file} {place}: time stays at {value} s in all {samples} samples, expected it to advance\n\nhint: another column may hold the times; `trocar inspect` shows all"
    )]
    ConstantTime {
        /// File name as given by the caller.
        file: String,
        /// First sample.
        place: Location,
        /// The time, in s.
        value: f64,
        /// Samples examined.
        samples: usize,
    },
    /// Many samples have the same time as the previous one.
    #[error(
        "{file} {place}: {found} of {samples} samples carry the same time as the one before but other values, expected time to advance\n\nhint: the clock is coarser than the sampling; record time with more digits"
    )]
    CoarseClock {
        /// File name as given by the caller.
        file: String,
        /// First such sample.
        place: Location,
        /// Samples concerned.
        found: usize,
        /// Total number of samples.
        samples: usize,
    },
    /// The position changes between two rows of the same time (`simulate`).
    #[error(
        "{file} {place}: position goes from {from} m to {to} m while time stays at {time} s, expected time to advance\n\nhint: the clock is coarser than the sampling; record time with more digits"
    )]
    NoDuration {
        /// File name as given by the caller.
        file: String,
        /// Where.
        place: Location,
        /// The time, in s.
        time: f64,
        /// Position before, in m.
        from: f64,
        /// Position found, in m.
        to: f64,
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
    /// A size that hardly occurs, where neither `--columns` nor `--rate-hz` says that it is right.
    #[error("{file}: {problems}\n\nhint: is the unit right? {hint}")]
    Implausible {
        /// File name as given by the caller.
        file: String,
        /// All that is implausible.
        problems: String,
        /// The likely ways out, and how to insist.
        hint: String,
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
    /// The file is inconsistent with its own format: truncated or corrupted.
    #[error(
        "{file}: damaged {format} file, {place}: {found}\n\nhint: was it cut off while it was written or copied? fetch or export it again"
    )]
    Damaged {
        /// File name as given by the caller.
        file: String,
        /// Name of the format.
        format: &'static str,
        /// Place in the file, in terms of the format.
        place: String,
        /// What was found there, and what was expected.
        found: String,
    },
    /// The format allows this, but it is not supported.
    #[error("{file}: {format} with {found}, which is not read\n\nhint: {hint}")]
    Unsupported {
        /// File name as given by the caller.
        file: String,
        /// Name of the format.
        format: &'static str,
        /// What is not supported.
        found: String,
        /// The remedy.
        hint: &'static str,
    },
    /// A format that this build does not support.
    #[error(
        "{file}: a {format} file, and this build has no feature {feature}\n\nhint: build with --features {feature}, or export the recording as CSV"
    )]
    NoFeature {
        /// File name as given by the caller.
        file: String,
        /// Name of the format.
        format: &'static str,
        /// Name of the cargo feature.
        feature: &'static str,
    },
    /// A requested column does not contain numbers.
    #[error(
        "{file}: column '{column}' of this {format} file holds no numbers that are read\n\nhint: trocar inspect lists the columns"
    )]
    NotNumeric {
        /// File name as given by the caller.
        file: String,
        /// Name of the format.
        format: &'static str,
        /// Name of the column.
        column: String,
    },
    /// A requested table or column is not in the file.
    #[error("{file}: no {what} called '{name}', found {found}")]
    NoSuchColumn {
        /// File name as given by the caller.
        file: String,
        /// `table` or `column`.
        what: String,
        /// The requested name.
        name: String,
        /// The existing names.
        found: String,
    },
    /// A robot log that cannot be read.
    #[error("{file}: {problem}")]
    Log {
        /// File name as given by the caller.
        file: String,
        /// The problem and its remedy.
        problem: String,
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
    /// [`RecordingError::Open`] of what is at `path`.
    pub(crate) fn cannot_open(path: &Path) -> impl Fn(std::io::Error) -> Self {
        move |source| Self::Open { file: path.display().to_string(), source }
    }

    /// [`RecordingError::BadColumns`] before the file is known.
    /// A column of `--columns` that is there twice.
    pub(crate) fn named_twice(column: &str) -> Self {
        Self::bad_columns(column, "a column named for two quantities, expected one".to_owned())
    }

    pub(crate) fn bad_columns(entry: impl Into<Box<str>>, problem: String) -> Self {
        let hint = "give a name with its unit per column, '-' to skip one, as in time_s,position_mm,force_n,-, \
                    or say by name which column is which, as in position_mm=x,force_n=-fz";
        Self::BadColumns { entry: entry.into(), problem: problem.into(), hint: hint.into() }
    }
}
