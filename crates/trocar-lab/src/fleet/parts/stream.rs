//! Time, position and force of a recording, file by file in chronological order.

use super::joined::Joined;
use super::{Cells, Selected, Taken, Value};
use crate::fleet::one::Input;
use trocar_recording::block::Block;
use trocar_recording::columns::Quantity;
use trocar_recording::container::BATCH_ROWS;
use trocar_recording::{
    ReadOptions, Readings, Recording, RecordingError, TableColumns, check_memory, check_topics,
    most_held,
};

/// A column to read, and the number of its units per SI unit.
struct Chosen<'a> {
    column: &'a Joined,
    per_si: f64,
}

/// Reads the recording in the files `parts`, with columns chosen among those `offered`; only
/// excerpts of one with too many samples.
pub(super) fn input(
    name: &str,
    parts: &[Taken<'_>],
    offered: &[&Joined],
    reading: &ReadOptions,
) -> Result<Input, RecordingError> {
    check_topics(name, &reading.choice)?;
    let skips = (reading.choice.skip_rows > 0)
        .then_some(("--skip-rows", "is for text, not for rows of a table"));
    let rate = reading
        .choice
        .rate_hz
        .map(|_| ("--rate-hz", "is for a file without times, not for rows of a table"));
    if let Some((option, problem)) = skips.or(rate) {
        return Err(RecordingError::BadOption {
            file: name.to_owned(),
            option,
            problem: problem.to_owned(),
        });
    }
    let names: Vec<String> = offered.iter().map(|column| column.name.clone()).collect();
    let units: Vec<String> = offered.iter().map(|column| column.unit.clone()).collect();
    let found = TableColumns::find_with_units(
        name,
        &names,
        &units,
        &[],
        reading.choice.columns.as_deref(),
    )?;
    let columns = found.needed.into_iter().chain(found.velocity);
    let mut chosen: Vec<Chosen> = columns
        .map(|column| Chosen { column: offered[column.index], per_si: column.per_si })
        .collect();
    chosen.iter().try_for_each(|chosen| chosen.column.check(name, parts))?;
    let rows: u64 = parts.iter().map(|part| part.rows).sum();
    let most = most_held(reading.most_samples);
    check_memory(name, rows.min(most), chosen.len() as u64, reading.memory_limit)?;
    if rows <= most {
        let readings = Stream::open(name, parts, chosen)?.readings(rows as usize)?;
        return Ok(Input::Columns { name: name.to_owned(), readings });
    }
    if reading.choice.flip_force {
        chosen[Quantity::Force as usize].per_si *= -1.0;
    }
    let has_velocity = chosen.len() > Quantity::Velocity as usize;
    let mut stream = Stream::open(name, parts, chosen)?;
    let recording =
        Recording::from_blocks(name, has_velocity, reading, &mut |block| stream.next(block))?;
    Ok(Input::Recording(Box::new(recording)))
}

/// Rows in blocks, file by file.
struct Stream<'a> {
    name: &'a str,
    /// In the order of their first times.
    parts: Vec<(usize, &'a Taken<'a>)>,
    /// Time, position, force, and velocity if there is one.
    chosen: Vec<Chosen<'a>>,
    /// The first timestamp, if times are timestamps.
    origin: i64,
    /// The file being read: its index in `parts`, its columns, and its next piece.
    part: usize,
    open: Option<Vec<Option<Selected>>>,
    piece: usize,
    rows: u64,
    /// Of the previous file, and of this one.
    spans: [Option<Span>; 2],
}

/// Times of a file, s.
#[derive(Clone, Copy)]
struct Span {
    part: usize,
    first: f64,
    last: f64,
    samples: usize,
}

impl<'a> Stream<'a> {
    fn open(
        name: &'a str,
        parts: &'a [Taken<'a>],
        chosen: Vec<Chosen<'a>>,
    ) -> Result<Self, RecordingError> {
        let time = chosen[Quantity::Time as usize].column;
        let mut ordered = Vec::with_capacity(parts.len());
        for (k, part) in parts.iter().enumerate() {
            ordered.push((first_time(part, time.places[k])?, k, part));
        }
        // The sort is stable: files with equal first times keep the order of their names; a file
        // without any time comes last.
        ordered.sort_by(|((a, raw_a), ..), ((b, raw_b), ..)| a.total_cmp(b).then(raw_a.cmp(raw_b)));
        let origin = ordered.first().map_or(0, |((_, raw), ..)| *raw);
        let parts = ordered.into_iter().map(|(_, k, part)| (k, part)).collect();
        Ok(Self {
            name,
            parts,
            chosen,
            origin,
            part: 0,
            open: None,
            piece: 0,
            rows: 0,
            spans: [None; 2],
        })
    }

    /// All rows, of which there are approximately `rows`.
    fn readings(mut self, rows: usize) -> Result<Readings, RecordingError> {
        let mut columns: Vec<Vec<f64>> =
            self.chosen.iter().map(|_| Vec::with_capacity(rows)).collect();
        let mut block = Block::new(Quantity::ALL.len());
        while self.next(&mut block)? {
            columns
                .iter_mut()
                .zip(&block.columns)
                .for_each(|(all, more)| all.extend_from_slice(more));
        }
        let mut columns = columns.into_iter();
        let mut column = || columns.next();
        let [time, position, force] = [column(), column(), column()].map(Option::unwrap_or_default);
        Ok(Readings { time, position, force, velocity: column() })
    }

    /// Replaces the content of the block by the next rows of one file; `false` at the end.
    fn next(&mut self, block: &mut Block) -> Result<bool, RecordingError> {
        block.clear();
        while let Some(&(k, part)) = self.parts.get(self.part) {
            let open = self.open.get_or_insert_with(|| {
                let select = |chosen: &Chosen| Some(part.select(chosen.column.places[k]?.0));
                self.chosen.iter().map(select).collect()
            });
            while let Some(piece) = part.pieces.get(self.piece) {
                let rows = block.len() + piece.rows.len();
                if rows > BATCH_ROWS && !block.is_empty() {
                    break;
                }
                for ((selected, chosen), column) in
                    open.iter_mut().zip(&self.chosen).zip(&mut block.columns)
                {
                    let before = column.len();
                    match selected {
                        Some(selected) => drop(selected.numbers(self.origin, column)?),
                        None => column.resize(rows, f64::NAN),
                    }
                    let si = |x: f64| if x.is_finite() { x / chosen.per_si } else { f64::NAN };
                    column[before..].iter_mut().for_each(|x| *x = si(*x));
                }
                self.piece += 1;
            }
            if !block.is_empty() {
                block.count_from(0, self.rows);
                self.rows += block.len() as u64;
                self.check_order(&block.columns[Quantity::Time as usize])?;
                return Ok(true);
            }
            (self.part, self.piece, self.open) = (self.part + 1, 0, None);
            self.spans = [self.spans[1].or(self.spans[0]), None];
        }
        Ok(false)
    }

    /// Rejects a file that starts before the end of the previous one, by more than an interval.
    fn check_order(&mut self, times: &[f64]) -> Result<(), RecordingError> {
        let mut times = times.iter().copied().filter(|time| time.is_finite()).peekable();
        let Some(&first) = times.peek() else { return Ok(()) };
        let [before, own] = &mut self.spans;
        let own = own.get_or_insert(Span { part: self.part, first, last: first, samples: 0 });
        for time in times {
            own.last = time;
            own.samples += 1;
        }
        let Some(before) = before else { return Ok(()) };
        let interval =
            (before.last - before.first) / before.samples.saturating_sub(1).max(1) as f64;
        if own.first >= before.last - interval {
            return Ok(());
        }
        let name = |span: &Span| self.parts[span.part].1.name.to_owned();
        let (file, first, second) = (self.name.to_owned(), name(before), name(own));
        Err(RecordingError::PartsOverlap {
            file,
            first,
            until: before.last,
            second,
            from: own.first,
        })
    }
}

/// The first time of a file, as stored and as a timestamp; infinite if there is none.
fn first_time(
    part: &Taken<'_>,
    place: Option<(usize, Option<Cells>)>,
) -> Result<(f64, i64), RecordingError> {
    let mut found = (f64::INFINITY, 0);
    let Some((column, cells)) = place else { return Ok(found) };
    part.select(column).runs(&mut |value, _| {
        found = match (value, cells) {
            (Value::Integer(raw), Some(Cells::Timestamp(per_second))) => {
                (raw as f64 / per_second, raw)
            }
            (Value::Integer(value), _) => (value as f64, 0),
            (Value::Number(value), _) => (value, 0),
            _ => return true,
        };
        false
    })?;
    Ok(found)
}
