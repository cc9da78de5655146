//! JSON lines: each line is an object, and its members are columns; those of an object inside are
//! `name.inner`, the numbers of an array `name[0]`, `name[1]`...
//!
//! The members of the first lines are the columns. Memory: a batch of rows.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::Source;
use super::lengths::WIDEST;
use crate::RecordingError;
use crate::container::{BATCH_ROWS, Batches, Column, Container, Content, Opened, Table};

/// Lines in which columns are sought.
const FIRST_LINES: usize = 300;
/// Longest line, bytes, and most columns.
const LONGEST: u64 = 1 << 20;
const MOST_COLUMNS: usize = 1 << 12;

/// An open file.
struct JsonLines {
    source: Source,
    path: PathBuf,
}

pub(crate) fn open(path: &Path, source: Source) -> Result<Container, RecordingError> {
    let mut lines = Lines::open(path, &source)?;
    let mut columns: Vec<Column> = Vec::new();
    let mut known: HashMap<String, usize> = HashMap::new();
    for _ in 0..FIRST_LINES {
        let Some(object) = lines.next()? else { break };
        members("", &object, &mut |name, value| {
            let at = *known.entry(name.to_owned()).or_insert(columns.len());
            if at == columns.len() {
                columns.push(Column { name: name.to_owned(), unit: None, is_numeric: true });
            }
            columns[at].is_numeric &= number(value).is_some();
        });
        if columns.len() > MOST_COLUMNS {
            return Err(lines.damaged(format!("more than {MOST_COLUMNS} members")));
        }
    }
    if columns.is_empty() {
        return Err(RecordingError::Empty { file: source.file });
    }
    let content = JsonLines { source: source.clone(), path: path.to_owned() };
    Ok(Container::new(source, vec![Table::without_a_name(columns)], content))
}

/// Passes on the plain values of an object by their names.
fn members(above: &str, value: &Value, take: &mut impl FnMut(&str, &Value)) {
    match value {
        Value::Object(inner) => inner.iter().for_each(|(name, value)| {
            let dot = if above.is_empty() { "" } else { "." };
            members(&format!("{above}{dot}{name}"), value, take);
        }),
        Value::Array(inner) if inner.len() as u64 <= WIDEST => {
            inner.iter().enumerate().for_each(|(k, value)| {
                members(&format!("{above}[{k}]"), value, take);
            });
        }
        plain => take(above, plain),
    }
}

/// NaN for null; `None` for other than numbers and Booleans.
fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Null => Some(f64::NAN),
        Value::Bool(truth) => Some(f64::from(u8::from(*truth))),
        Value::Number(number) => number.as_f64(),
        // As json.dumps of Python does not, but others do.
        Value::String(text) if text.eq_ignore_ascii_case("nan") => Some(f64::NAN),
        _ => None,
    }
}

struct Lines {
    source: Source,
    file: BufReader<File>,
    line: Vec<u8>,
    count: u64,
}

impl Lines {
    fn open(path: &Path, source: &Source) -> Result<Self, RecordingError> {
        let file = BufReader::new(File::open(path).map_err(RecordingError::cannot_open(path))?);
        Ok(Self { source: source.clone(), file, line: Vec::new(), count: 0 })
    }

    /// The next object.
    fn next(&mut self) -> Result<Option<Value>, RecordingError> {
        loop {
            self.line.clear();
            let read = (&mut self.file).take(LONGEST).read_until(b'\n', &mut self.line);
            if read.map_err(|error| self.damaged(error))? == 0 {
                return Ok(None);
            }
            self.count += 1;
            let text = self.line.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&self.line).trim_ascii();
            if text.is_empty() {
                continue;
            }
            if self.line.len() as u64 == LONGEST {
                return Err(self.damaged(format!("more than {LONGEST} bytes in a line")));
            }
            return match serde_json::from_slice(text) {
                Ok(object @ Value::Object(_)) => Ok(Some(object)),
                Ok(_) => {
                    Err(self.damaged("a value that is no object, expected {\"name\": number, ...}"))
                }
                Err(error) => Err(self.damaged(error)),
            };
        }
    }

    fn damaged(&self, found: impl std::fmt::Display) -> RecordingError {
        self.source.damaged(format!("line {}", self.count), found)
    }
}

impl Content for JsonLines {
    fn open(&self, _at: usize, table: &Table, columns: &[usize]) -> Opened {
        let mut wanted: HashMap<String, Vec<usize>> = HashMap::new();
        for (k, &column) in columns.iter().enumerate() {
            wanted.entry(table.columns[column].name.clone()).or_default().push(k);
        }
        let lines = Lines::open(&self.path, &self.source)?;
        Ok(Box::new(Rows { lines, wanted, problem: None }))
    }
}

struct Rows {
    lines: Lines,
    /// Places of the columns by their names.
    wanted: HashMap<String, Vec<usize>>,
    /// Why the rows end, once those before are returned.
    problem: Option<RecordingError>,
}

impl Rows {
    /// Adds the next row; `false` at the end.
    fn add(&mut self, columns: &mut [Vec<f64>]) -> Result<bool, RecordingError> {
        let Some(object) = self.lines.next()? else { return Ok(false) };
        let mut row = vec![f64::NAN; columns.len()];
        let mut wrong = None;
        members("", &object, &mut |name, value| {
            for &k in self.wanted.get(name).into_iter().flatten() {
                match number(value) {
                    Some(number) => row[k] = number,
                    None => wrong = Some(format!("{value} in {name}, expected a number")),
                }
            }
        });
        match wrong {
            Some(found) => Err(self.lines.damaged(found)),
            None => {
                columns.iter_mut().zip(row).for_each(|(column, number)| column.push(number));
                Ok(true)
            }
        }
    }
}

impl Batches for Rows {
    fn next(&mut self, columns: &mut [Vec<f64>]) -> Result<bool, RecordingError> {
        columns.iter_mut().for_each(Vec::clear);
        if let Some(problem) = self.problem.take() {
            return Err(problem);
        }
        for row in 0..BATCH_ROWS {
            match self.add(columns) {
                Ok(true) => {}
                Ok(false) => return Ok(row > 0),
                Err(problem) if row == 0 => return Err(problem),
                Err(problem) => {
                    self.problem = Some(problem);
                    break;
                }
            }
        }
        Ok(true)
    }
}
