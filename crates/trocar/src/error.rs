//! Errors of everything that reads or writes files: what, where, found, needed, and the way out on a `hint:` line.

use std::fmt;
use std::path::PathBuf;

/// A position in a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// Line of the file, counted from 1.
    Line(u64),
    /// Row of a table, counted from 1.
    Row(u64),
    /// Sample of a recording that was not read from a file, counted from 0.
    Sample(usize),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::Line(line) => write!(f, "line {line}"),
            Place::Row(row) => write!(f, "row {row}"),
            Place::Sample(index) => write!(f, "sample {index}"),
        }
    }
}

/// Why a recording cannot be used.
///
/// `file` is the name as the caller gave it, so the message can be pasted back into a shell.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordingError {
    /// The file cannot be opened.
    #[error("{file}: cannot open: {source}")]
    Open {
        /// File as the caller named it.
        file: String,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The file opened, but reading it failed part way.
    #[error("{file} line {line}: cannot read further: {source}")]
    Read {
        /// File as the caller named it.
        file: String,
        /// Line reached.
        line: u64,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// No bytes, or only blank and comment lines.
    #[error("{file}: empty, expected a header line and rows of time, position and force")]
    Empty {
        /// File as the caller named it.
        file: String,
    },
    /// A header line and nothing after it.
    #[error("{file} line {line}: a header without any row below it")]
    HeaderOnly {
        /// File as the caller named it.
        file: String,
        /// Line of the header.
        line: u64,
    },
    /// The bytes are not text in UTF-8 or ASCII.
    #[error(
        "{file}: looks like {found}, expected text separated by commas, semicolons, tabs or spaces\n\nhint: export the recording as CSV in UTF-8"
    )]
    NotText {
        /// File as the caller named it.
        file: String,
        /// What the first bytes look like.
        found: &'static str,
    },
    /// A line longer than any row of numbers.
    #[error("{file} line {line}: longer than {limit} bytes, expected one row of numbers per line")]
    LineTooLong {
        /// File as the caller named it.
        file: String,
        /// Line concerned.
        line: u64,
        /// Longest line accepted, in bytes.
        limit: usize,
    },
    /// The first line holds numbers, so the columns have no names.
    #[error(
        "{file} line {line}: no header, the first line is the row of numbers '{found}'\n\nhint: name the columns in order, with units, for example --columns {example}"
    )]
    NoHeader {
        /// File as the caller named it.
        file: String,
        /// First line.
        line: u64,
        /// The first line, shortened.
        found: String,
        /// A `--columns` value with the right number of entries.
        example: String,
    },
    /// A needed column is not in the header.
    #[error(
        "{file}{place}: no {quantity} column among '{found}', expected a name such as {expected}\n\nhint: name the columns in order, with units, and '-' for those to skip, for example --columns {example}"
    )]
    MissingColumn {
        /// File as the caller named it.
        file: String,
        /// Where in it, ` line 1`; empty where a table has no lines.
        place: Box<str>,
        /// `time`, `position` or `force`.
        quantity: &'static str,
        /// The names found.
        found: String,
        /// A name that would have been understood.
        expected: &'static str,
        /// A `--columns` value with the right number of entries.
        example: Box<str>,
    },
    /// Several columns could be the same quantity.
    #[error(
        "{file}{place}: {quantity} could be '{first}' or '{second}', expected one\n\nhint: say which, with '-' for columns to skip, for example --columns {example}"
    )]
    AmbiguousColumn {
        /// File as the caller named it.
        file: String,
        /// Where in it, ` line 1`; empty where a table has no lines.
        place: Box<str>,
        /// The quantity concerned.
        quantity: &'static str,
        /// One candidate.
        first: Box<str>,
        /// Another candidate.
        second: Box<str>,
        /// A `--columns` value with the right number of entries.
        example: Box<str>,
    },
    /// A column is named, but not its unit.
    #[error(
        "{file}{place}: column '{column}' has no unit that is understood for {quantity}, expected one of {expected}\n\nhint: rename it, for example {quantity}_{unit}, or give --columns {example}"
    )]
    MissingUnit {
        /// File as the caller named it.
        file: String,
        /// Where in it, ` line 1`; empty where a table has no lines.
        place: Box<str>,
        /// Name of the column.
        column: Box<str>,
        /// The quantity it was taken for.
        quantity: &'static str,
        /// Units understood.
        expected: Box<str>,
        /// The SI unit, as written in names.
        unit: &'static str,
        /// A `--columns` value with the right number of entries.
        example: Box<str>,
    },
    /// No topic of a robot log is clearly a quantity.
    #[error(
        "{file}: no topic is clearly the {quantity}: {found}\n\nhint: say which, for example --columns '{example}'; `trocar inspect` shows all"
    )]
    UnclearTopic {
        /// File as the caller named it.
        file: String,
        /// The quantity needed.
        quantity: &'static str,
        /// What there is.
        found: String,
        /// An entry of `--columns`.
        example: String,
    },
    /// A stream where a file has to be read more than once.
    #[error("{file}: a stream, expected a file that can be read more than once\n\nhint: save it first")]
    IsStream {
        /// As the caller named it.
        file: String,
    },
    /// Several tables of a file hold what is needed.
    #[error(
        "{file}: time, position and force could come from {found}, expected one\n\nhint: say which, for example --topic NAME; `trocar inspect` shows them"
    )]
    AmbiguousTable {
        /// File as the caller named it.
        file: String,
        /// Their names.
        found: String,
    },
    /// No table, or more than one, has the name asked for.
    #[error("{file}: {found} topics or tables are named '{topic}', expected one\n\nhint: the file holds {expected}")]
    NoSuchTable {
        /// File as the caller named it.
        file: String,
        /// The name asked for.
        topic: String,
        /// How many have it.
        found: usize,
        /// All names.
        expected: String,
    },
    /// The `--columns` mapping itself is wrong.
    #[error(
        "--columns entry '{entry}' is {problem}\n\nhint: give a name with its unit per column, '-' to skip one, for example --columns time_s,position_mm,force_n,-, or say by name which column is which, for example --columns position_mm=x,force_n=-fz"
    )]
    BadColumns {
        /// The entry concerned.
        entry: String,
        /// What is wrong with it.
        problem: String,
    },
    /// A row has too few or too many fields.
    #[error("{file} line {line}: found {found} fields, expected {expected} as in {reference}{hint}")]
    FieldCount {
        /// File as the caller named it.
        file: String,
        /// Line concerned.
        line: u64,
        /// Fields in this row.
        found: usize,
        /// Fields in the header or mapping.
        expected: usize,
        /// Where the expectation comes from.
        reference: &'static str,
        /// Way out, with its own line break, or empty.
        hint: &'static str,
    },
    /// A cell of a used column is not a number.
    #[error("{file} line {line}: found '{found}' in column {column}, expected a number{hint}")]
    NotANumber {
        /// File as the caller named it.
        file: String,
        /// Line concerned.
        line: u64,
        /// Name of the column.
        column: String,
        /// The cell, shortened.
        found: String,
        /// Way out, with its own line break, or empty.
        hint: &'static str,
    },
    /// A cell is empty, NaN or infinite where every row must count (`simulate`).
    #[error(
        "{file} {place}: {quantity} is {found}, expected a finite number\n\nhint: remove the row or fill it in; a replay needs every position"
    )]
    NonFinite {
        /// File as the caller named it.
        file: String,
        /// Where.
        place: Place,
        /// The quantity concerned.
        quantity: &'static str,
        /// `empty or nan` or `infinite`.
        found: &'static str,
    },
    /// Too few samples to take an interval, a velocity and an acceleration from.
    #[error("{file}: found {found} usable samples, expected at least {needed}")]
    TooFewSamples {
        /// File as the caller named it.
        file: String,
        /// Usable samples.
        found: usize,
        /// Fewest that make a recording.
        needed: usize,
    },
    /// Time runs backwards by more than one sampling interval.
    #[error(
        "{file} {place}: time goes back from {from} s to {to} s, expected it to advance\n\nhint: if the clock was reset there, cut the file in two and give both parts"
    )]
    TimeGoesBack {
        /// File as the caller named it.
        file: String,
        /// Where.
        place: Place,
        /// Time before, in s.
        from: f64,
        /// Time found, in s.
        to: f64,
    },
    /// Time has one value throughout.
    #[error(
        "{file} {place}: time stays at {value} s in all {samples} samples, expected it to advance\n\nhint: check that the right column is taken for time, with --columns if need be"
    )]
    ConstantTime {
        /// File as the caller named it.
        file: String,
        /// First sample.
        place: Place,
        /// The time, in s.
        value: f64,
        /// Samples looked at.
        samples: usize,
    },
    /// Many samples share their time with the one before.
    #[error(
        "{file} {place}: {found} of {samples} samples carry the same time as the one before but other values, expected time to advance\n\nhint: the clock is coarser than the sampling; record time with more digits"
    )]
    CoarseClock {
        /// File as the caller named it.
        file: String,
        /// First such sample.
        place: Place,
        /// Samples concerned.
        found: usize,
        /// Samples in all.
        samples: usize,
    },
    /// The position changes between two rows of the same time (`simulate`).
    #[error(
        "{file} {place}: position goes from {from} m to {to} m while time stays at {time} s, expected time to advance\n\nhint: the clock is coarser than the sampling; record time with more digits"
    )]
    NoDuration {
        /// File as the caller named it.
        file: String,
        /// Where.
        place: Place,
        /// The time, in s.
        time: f64,
        /// Position before, in m.
        from: f64,
        /// Position found, in m.
        to: f64,
    },
    /// The position covers more than any instrument can.
    #[error(
        "{file}: the position covers {stroke} m, expected at most {limit} m\n\nhint: is the unit right? if the numbers are millimetres, name the column position_mm or give --columns time_s,position_mm,force_n"
    )]
    StrokeTooLong {
        /// File as the caller named it.
        file: String,
        /// Range of the position, in m.
        stroke: f64,
        /// Longest accepted, in m.
        limit: f64,
    },
    /// Columns of different length were handed over.
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
    /// The recording would not fit into the memory allowed.
    #[error(
        "{file}: about {rows} rows need {needed_mb} MB of memory, expected at most {limit_mb} MB\n\nhint: identify from excerpts with --most-samples, or a part with --from-s and --to-s; simulate and validate need no such memory"
    )]
    TooLarge {
        /// File as the caller named it.
        file: String,
        /// Rows, estimated from the first ones.
        rows: u64,
        /// Memory for the columns, in MB.
        needed_mb: u64,
        /// Memory allowed, in MB.
        limit_mb: u64,
    },
    /// The file contradicts its own format: cut off, or changed on the way.
    #[error(
        "{file}: damaged {format} file, {place}: {found}\n\nhint: was it cut off while it was written or copied? fetch or export it again"
    )]
    Damaged {
        /// File as the caller named it.
        file: String,
        /// Name of the format.
        format: &'static str,
        /// Where in the file, in the format's terms.
        place: String,
        /// What was found there, and what was expected.
        found: String,
    },
    /// The format allows it, and it is not read.
    #[error("{file}: {format} with {found}, which is not read\n\nhint: {hint}")]
    Unsupported {
        /// File as the caller named it.
        file: String,
        /// Name of the format.
        format: &'static str,
        /// What is not read.
        found: String,
        /// The way out.
        hint: &'static str,
    },
    /// A format that this build lacks.
    #[error(
        "{file}: a {format} file, and this build has no feature {feature}\n\nhint: build with --features {feature}, or export the recording as CSV"
    )]
    NoFeature {
        /// File as the caller named it.
        file: String,
        /// Name of the format.
        format: &'static str,
        /// Name of the cargo feature.
        feature: &'static str,
    },
    /// A column that was asked for does not hold numbers.
    #[error(
        "{file}: column '{column}' of this {format} file holds no numbers that are read\n\nhint: trocar inspect lists the columns"
    )]
    NotNumeric {
        /// File as the caller named it.
        file: String,
        /// Name of the format.
        format: &'static str,
        /// Name of the column.
        column: String,
    },
    /// The files that a recording lies in have a column of one name and of different kinds.
    #[error(
        "{file}: column '{column}' holds {of_first} in {first} and {of_second} in {second}\n\nhint: write the files again with one schema"
    )]
    PartsDiffer {
        /// The recording.
        file: String,
        /// Name of the column.
        column: Box<str>,
        /// A file of the recording.
        first: Box<str>,
        /// What the column holds there.
        of_first: &'static str,
        /// Another one.
        second: Box<str>,
        /// What the column holds there.
        of_second: &'static str,
    },
    /// The files that a recording lies in do not follow each other in time.
    #[error(
        "{file}: its rows in {second} begin at {from} s, before those in {first} end at {until} s\n\nhint: two recordings under one name \
         need names of their own; rows in no order have to be sorted by recording and time before they are written"
    )]
    PartsOverlap {
        /// The recording.
        file: String,
        /// The file that begins first.
        first: String,
        /// Its last time, s.
        until: f64,
        /// The file that begins before that.
        second: String,
        /// Its first time, s.
        from: f64,
    },
    /// A table or column that was asked for by name is not in the file.
    #[error("{file}: no {what} called '{name}', found {found}")]
    NoSuchColumn {
        /// File as the caller named it.
        file: String,
        /// `table` or `column`.
        what: String,
        /// The name asked for.
        name: String,
        /// The names there are.
        found: String,
    },
    /// A robot log that cannot be read.
    #[error("{file}: {problem}")]
    Log {
        /// File as the caller named it.
        file: String,
        /// What is wrong with it, and the way out.
        problem: String,
    },
    /// A moving mass that is not a mass.
    #[error("moving mass must be finite and not negative, got {found} kg")]
    MovingMass {
        /// What was given, in kg.
        found: f64,
    },
}

/// Why a result cannot be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OutputError {
    /// The file or its temporary companion cannot be made.
    #[error("{}: cannot create: {source}\n\nhint: the folder must exist and be writable; choose another with --out", path.display())]
    Create {
        /// Where the output was to go.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// Writing failed, for example on a full disk; nothing was left behind.
    #[error("{}: cannot write: {source}\n\nhint: nothing was written there; free some space or choose another place with --out", path.display())]
    Write {
        /// Where the output was to go.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The extension asks for a format that this build lacks.
    #[error("{}: this build has no feature {feature}\n\nhint: build with --features {feature}, or let the name end in .csv", path.display())]
    NoFeature {
        /// Where the output was to go.
        path: PathBuf,
        /// Name of the cargo feature.
        feature: &'static str,
    },
}

/// Why a table of results cannot be read back.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TableError {
    /// The file cannot be opened.
    #[error("{}: cannot open: {source}", path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// It is no complete Parquet file.
    #[error("{}: no complete Parquet file: {found}\n\nhint: was it cut off, or is it another format? make it again", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What the reader found.
        found: String,
    },
    /// A column holds something else than flat numbers, truths and text.
    #[error("{}: column '{column}' is no column of numbers, truths or text", path.display())]
    Unread {
        /// The file.
        path: PathBuf,
        /// Name of the column.
        column: String,
    },
    /// This build cannot read Parquet.
    #[error("{}: this build has no feature {feature}\n\nhint: build with --features {feature}", path.display())]
    NoFeature {
        /// The file.
        path: PathBuf,
        /// Name of the cargo feature.
        feature: &'static str,
    },
}
