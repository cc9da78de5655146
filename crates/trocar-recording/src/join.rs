//! Topics of a log aligned in time: rows at the times of one topic, the others interpolated to
//! them.
//!
//! # Method
//! - Rows are at the stamps of one topic, by default that of the position. Its values are
//!   unchanged.
//! - The values of every other topic are interpolated linearly between the two samples around the
//!   row; a sample at exactly the time of the row is used alone. Nothing is extrapolated: rows
//!   before the first sample or after the last are left out, with a note.
//! - Nor is anything interpolated across a gap: an interval longer than [`LONGEST_GAP`] times the
//!   95th percentile of that topic's intervals (determined to within 1 %) gives NaN.
//! - The clock is `header.stamp` if every topic has it, all follow the same clock, and it advances
//!   in each; otherwise the log's time. If the difference between stamps and the log's time is a
//!   constant beyond its scatter, and another constant in each topic, the clocks disagree, which is
//!   reported.
//! - Samples are sorted by the clock within [`WINDOW`] rows; those that come later, repeat a time
//!   or have none are omitted and counted.
//!
//! Each topic is read twice: first only its clocks, for its rate and gaps, then the requested
//! columns. Memory is bounded by the batches of each topic, whatever its length; the result does
//! not depend on how the file is divided.

use std::collections::BTreeMap;

use trocar_tables::content::{HEADER_STAMP, LOG_TIME};

use super::container::{BATCH_ROWS, Batches, Container};
use super::{RecordingError, Table};

/// Longest interval across which values are interpolated, in 95th percentiles of a topic's
/// intervals.
const LONGEST_GAP: f64 = 3.0;

/// Rows within which samples are sorted.
const WINDOW: usize = 4096;

/// Most differences of stamps and log times that are stored; if there are more, every second,
/// fourth, ... one.
const MOST_KEPT: usize = 4096;

/// Largest fraction of the intervals that may be zero or negative in a clock that advances.
const STANDING: f64 = 0.01;

/// Least distance between constant differences of stamps and log times, in units of their scatter,
/// that indicates different clocks.
const CLEARLY: f64 = 3.0;

/// Smallest difference between clocks that is reported, in s.
const SMALLEST_SHIFT: f64 = 1e-4;

/// Columns of one topic.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Pick {
    pub(crate) table: usize,
    /// The clock, if it is given.
    pub(crate) clock: Option<usize>,
    pub(crate) values: Vec<usize>,
}

impl Pick {
    /// The name of its topic.
    fn name<'a>(&self, container: &'a Container) -> &'a str {
        &container.tables[self.table].name
    }
}

/// Topics aligned on one clock: its times, then the values of each pick.
pub(crate) struct Joined {
    /// Name of the clock's column.
    pub(crate) clock: String,
    pub(crate) batches: Box<dyn Batches>,
    /// The method, and properties of each topic.
    pub(crate) notes: Vec<String>,
    /// Clocks that disagree.
    pub(crate) warnings: Vec<String>,
}

/// Aligns `picks` to the times of the pick with index `onto`; `given` are the entries of
/// `--columns` so far.
///
/// # Errors
/// [`RecordingError`] when the file cannot be read, or a topic has no clock that advances.
pub(crate) fn join(
    container: &Container,
    picks: &[Pick],
    onto: usize,
    given: &[String],
) -> Result<Joined, RecordingError> {
    let surveys =
        picks.iter().map(|pick| survey(container, pick)).collect::<Result<Vec<_>, _>>()?;
    let (clocks, mut notes) = choose(container, picks, &surveys)?;
    overlap(container, picks, &surveys, (&clocks, onto), given)?;
    let mut warnings = Vec::new();
    let uses_stamps =
        clocks.iter().zip(&surveys).all(|(clock, survey)| Some(*clock) == survey.stamp_column);
    if uses_stamps {
        warnings.extend(shifts(container, picks, &surveys));
    }
    let mut lanes = Vec::new();
    for ((pick, survey), &clock) in picks.iter().zip(&surveys).zip(&clocks) {
        let pace = survey.pace(clock).expect("the clock chosen was surveyed");
        let columns: Vec<usize> =
            std::iter::once(clock).chain(pick.values.iter().copied()).collect();
        let name = &container.tables[pick.table].name;
        lanes.push(Lane::new(name, container.open(pick.table, &columns)?, columns.len(), pace));
    }
    let main = &container.tables[picks[onto].table];
    if picks.len() > 1 {
        notes.push(format!(
            "rows at the times of {}; other topics interpolated linearly between two samples",
            main.name
        ));
    }
    let clock = main.columns[clocks[onto]].name.clone();
    Ok(Joined { clock, batches: Box::new(Join { lanes, onto }), notes, warnings })
}

/// Chooses the clock of each pick.
fn choose(
    container: &Container,
    picks: &[Pick],
    surveys: &[Survey],
) -> Result<(Vec<usize>, Vec<String>), RecordingError> {
    if let Some(clocks) = picks.iter().map(|pick| pick.clock).collect::<Option<Vec<usize>>>() {
        return Ok((clocks, Vec::new()));
    }
    let kinds: Vec<Option<usize>> = picks
        .iter()
        .zip(surveys)
        .map(|(pick, survey)| {
            let table = &container.tables[pick.table];
            Some(container.content.clock(pick.table, table, survey.stamp_column?))
        })
        .collect();
    let unusable =
        surveys.iter().position(|survey| !survey.stamps.as_ref().is_some_and(Pace::advances));
    if unusable.is_none() && kinds.iter().all(|kind| *kind == kinds[0]) {
        let clocks = surveys.iter().filter_map(|survey| survey.stamp_column).collect();
        return Ok((clocks, vec![format!("times are {HEADER_STAMP}")]));
    }
    let why = match unusable {
        Some(place) if surveys[place].stamp_column.is_none() => {
            format!("{} has no {HEADER_STAMP}", picks[place].name(container))
        }
        Some(place) => {
            format!("{HEADER_STAMP} of {} does not advance", picks[place].name(container))
        }
        None => format!("the topics' {HEADER_STAMP} are of different clocks"),
    };
    let mut clocks = Vec::new();
    for (pick, survey) in picks.iter().zip(surveys) {
        match survey.log_column.filter(|_| survey.logs.as_ref().is_some_and(Pace::advances)) {
            Some(clock) => clocks.push(clock),
            None => {
                let problem = format!(
                    "{} has no times that advance: {why}, and no log times either",
                    pick.name(container)
                );
                return Err(RecordingError::unusable(container.format, problem));
            }
        }
    }
    Ok((clocks, vec![format!("times are {LOG_TIME}, because {why}")]))
}

/// Rejects topics that have no time in common with the one at `onto`, with their times and, if
/// their times of receipt do overlap, the option that uses these.
fn overlap(
    container: &Container,
    picks: &[Pick],
    surveys: &[Survey],
    (clocks, onto): (&[usize], usize),
    given: &[String],
) -> Result<(), RecordingError> {
    let ranges: Vec<(f64, f64)> = surveys
        .iter()
        .zip(clocks)
        .map(|(survey, clock)| survey.pace(*clock).map_or((0.0, 0.0), |pace| pace.range))
        .collect();
    let Some(other) = ranges.iter().position(|range| are_apart(*range, ranges[onto])) else {
        return Ok(());
    };
    let [said, said_of_other] = [onto, other].map(|k| {
        let (from, to) = ranges[k];
        format!("{} from {from:.3} to {to:.3} s", picks[k].name(container))
    });
    let [log, log_of_other] = [onto, other].map(|k| surveys[k].logs.as_ref().map(|log| log.range));
    let received =
        clocks.iter().zip(surveys).any(|(clock, survey)| Some(*clock) != survey.log_column)
            && log.zip(log_of_other).is_some_and(|(a, b)| !are_apart(a, b));
    let hint = if received {
        let time = format!("time_s={}.{LOG_TIME}", picks[onto].name(container));
        let entries: Vec<&str> =
            std::iter::once(&*time).chain(given.iter().map(String::as_str)).collect();
        format!(
            "their stamps are of different clocks, but they were received at the same time: align them by {LOG_TIME}, with ‹columns='{}'›",
            entries.join(",")
        )
    } else {
        "choose topics that were recorded at the same time, or record them again on one clock; `trocar inspect` shows them".to_owned()
    };
    let clock = &container.tables[picks[onto].table].columns[clocks[onto]].name;
    let problem = format!(
        "the topics have no time in common: {said}, {said_of_other} ({clock})\n\nhint: {hint}"
    );
    Err(RecordingError::unusable(container.format, problem))
}

fn are_apart(a: (f64, f64), b: (f64, f64)) -> bool {
    a.1 < b.0 || b.1 < a.0
}

/// Stamps whose distance from the log's time differs between topics by more than its scatter.
fn shifts(container: &Container, picks: &[Pick], surveys: &[Survey]) -> Vec<String> {
    let mut warnings = Vec::new();
    for (a, one) in surveys.iter().enumerate() {
        for (b, two) in surveys.iter().enumerate().skip(a + 1) {
            let (Some(first), Some(second)) = (one.lag.spread(), two.lag.spread()) else {
                continue;
            };
            let apart = (first.median - second.median).abs();
            if apart > CLEARLY * first.width.max(second.width) && apart > SMALLEST_SHIFT {
                warnings.push(format!(
                    "{HEADER_STAMP} lies {:.6} s after the log's time in {} (90 % within {:.6} s) and {:.6} s in {} ({:.6} s): the clocks of the two, or the delays of their messages, differ by {apart:.6} s",
                    first.median,
                    picks[a].name(container),
                    first.width,
                    second.median,
                    picks[b].name(container),
                    second.width,
                ));
            }
        }
    }
    warnings
}

/// Properties of the clocks of a topic.
struct Survey {
    stamp_column: Option<usize>,
    log_column: Option<usize>,
    /// A requested clock that is neither.
    own_column: Option<usize>,
    stamps: Option<Pace>,
    logs: Option<Pace>,
    own: Option<Pace>,
    lag: Lag,
}

impl Survey {
    fn pace(&self, clock: usize) -> Option<Pace> {
        let columns = [self.stamp_column, self.log_column, self.own_column];
        let paces = [&self.stamps, &self.logs, &self.own];
        let place = columns.iter().position(|column| *column == Some(clock))?;
        paces[place].clone()
    }
}

fn survey(container: &Container, pick: &Pick) -> Result<Survey, RecordingError> {
    let table: &Table = &container.tables[pick.table];
    let [stamp_column, log_column] = [HEADER_STAMP, LOG_TIME].map(|name| {
        table.columns.iter().position(|column| column.name == name && column.is_numeric)
    });
    let own_column =
        pick.clock.filter(|clock| Some(*clock) != stamp_column && Some(*clock) != log_column);
    let columns: Vec<usize> =
        [stamp_column, log_column, own_column].into_iter().flatten().collect();
    let mut paces = vec![Pace::default(); columns.len()];
    let mut lag = Lag::default();
    let mut batches = container.open(pick.table, &columns)?;
    let mut rows = vec![Vec::new(); columns.len()];
    while batches.next(&mut rows)? {
        for (pace, times) in paces.iter_mut().zip(&rows) {
            times.iter().for_each(|&time| pace.add(time));
        }
        if let [stamps, logs, ..] = &rows[..]
            && stamp_column.is_some()
            && log_column.is_some()
        {
            stamps.iter().zip(logs).for_each(|(stamp, log)| lag.add(log - stamp));
        }
    }
    let mut paces = paces.into_iter();
    let [stamps, logs, own] =
        [stamp_column, log_column, own_column].map(|column| column.and_then(|_| paces.next()));
    Ok(Survey { stamp_column, log_column, own_column, stamps, logs, own, lag })
}

/// Intervals of a clock.
#[derive(Debug, Clone, Default)]
struct Pace {
    last: Option<f64>,
    /// Earliest and latest time, s.
    range: (f64, f64),
    span: f64,
    /// Positive intervals, by the leading bits of their length: 128 bins per doubling.
    bins: BTreeMap<u64, u64>,
    advancing: u64,
    standing: u64,
}

/// Bits of a number's fraction that are dropped in bins.
const DROPPED: u32 = 52 - 7;

impl Pace {
    fn add(&mut self, time: f64) {
        if !time.is_finite() {
            self.standing += 1;
            return;
        }
        let last = self.last.replace(time);
        self.range = match last {
            None => (time, time),
            Some(_) => (self.range.0.min(time), self.range.1.max(time)),
        };
        let interval = last.map_or(0.0, |last| time - last);
        self.span += interval;
        if interval > 0.0 {
            self.advancing += 1;
            *self.bins.entry(interval.to_bits() >> DROPPED).or_default() += 1;
        } else if last.is_some() {
            self.standing += 1;
        }
    }

    fn advances(&self) -> bool {
        self.advancing > 0 && self.standing as f64 <= STANDING * self.advancing as f64
    }

    /// Upper end of the bin of the interval that the fraction `share` of them do not exceed, in s.
    fn quantile(&self, share: f64) -> f64 {
        let mut left = (share * self.advancing as f64).ceil() as u64;
        for (bin, count) in &self.bins {
            if left <= *count {
                return f64::from_bits((bin + 1) << DROPPED);
            }
            left -= count;
        }
        f64::INFINITY
    }

    /// Samples per second.
    fn rate(&self) -> f64 {
        self.advancing as f64 / self.span
    }
}

/// Log time minus stamp.
#[derive(Debug, Clone)]
struct Lag {
    kept: Vec<f64>,
    every: u64,
    seen: u64,
}

/// Middle of the lags, and the width that contains nine of ten, in s.
struct Spread {
    median: f64,
    width: f64,
}

impl Default for Lag {
    fn default() -> Self {
        Self { kept: Vec::new(), every: 1, seen: 0 }
    }
}

impl Lag {
    fn add(&mut self, lag: f64) {
        if self.seen.is_multiple_of(self.every) && lag.is_finite() {
            self.kept.push(lag);
        }
        self.seen += 1;
        // What is kept stays evenly spread over the log, however long it becomes.
        if self.kept.len() == MOST_KEPT {
            let mut place = 0;
            self.kept.retain(|_| {
                place += 1;
                place % 2 == 1
            });
            self.every *= 2;
        }
    }

    fn spread(&self) -> Option<Spread> {
        let mut sorted = self.kept.clone();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| {
            sorted.get(((sorted.len() as f64 - 1.0) * share).round() as usize).copied()
        };
        Some(Spread { median: at(0.5)?, width: at(0.95)? - at(0.05)? })
    }
}

/// The samples of one topic in the order of its clock.
struct Lane {
    name: String,
    batches: Box<dyn Batches>,
    /// Samples as read from the file, and the number already used.
    inbox: Vec<Vec<f64>>,
    taken: usize,
    /// In order from `from` to `ready`; the clock is the first column.
    rows: Vec<Vec<f64>>,
    from: usize,
    ready: usize,
    has_ended: bool,
    last: f64,
    left_out: u64,
    rate: f64,
    longest: f64,
    /// The sample before the current row.
    before: Option<Vec<f64>>,
    outside: u64,
    in_gaps: u64,
    furthest: f64,
}

impl Lane {
    fn new(name: &str, batches: Box<dyn Batches>, width: usize, pace: Pace) -> Self {
        Self {
            name: name.to_owned(),
            batches,
            inbox: vec![Vec::new(); width],
            taken: 0,
            rows: vec![Vec::new(); width],
            from: 0,
            ready: 0,
            has_ended: false,
            last: f64::NEG_INFINITY,
            left_out: 0,
            rate: pace.rate(),
            longest: LONGEST_GAP * pace.quantile(0.95),
            before: None,
            outside: 0,
            in_gaps: 0,
            furthest: 0.0,
        }
    }

    /// Reads the next [`WINDOW`] rows of the file and sorts them with those waiting. The number is
    /// constant, so the result does not depend on the batches of the file.
    fn fill(&mut self) -> Result<(), RecordingError> {
        for column in &mut self.rows {
            column.drain(..self.from);
        }
        self.from = 0;
        let mut missing = WINDOW;
        while missing > 0 && !self.has_ended {
            let held = self.inbox[0].len();
            if self.taken == held {
                self.taken = 0;
                self.has_ended = !self.batches.next(&mut self.inbox)?;
                continue;
            }
            let to = held.min(self.taken + missing);
            for (column, inbox) in self.rows.iter_mut().zip(&self.inbox) {
                column.extend_from_slice(&inbox[self.taken..to]);
            }
            missing -= to - self.taken;
            self.taken = to;
        }
        self.order();
        let waiting = self.rows[0].len();
        self.ready = if self.has_ended { waiting } else { waiting.saturating_sub(WINDOW) };
        Ok(())
    }

    /// Sorts the waiting rows by the clock, without rows that have no time or come too late.
    fn order(&mut self) {
        let clock = &self.rows[0];
        if clock.iter().all(|time| *time >= self.last) && clock.is_sorted() {
            return;
        }
        let mut order: Vec<usize> =
            (0..clock.len()).filter(|&row| clock[row] >= self.last).collect();
        self.left_out += (clock.len() - order.len()) as u64;
        order.sort_by(|&a, &b| clock[a].total_cmp(&clock[b]));
        for column in &mut self.rows {
            *column = order.iter().map(|&row| column[row]).collect();
        }
    }

    /// Time of the next sample.
    fn head(&mut self) -> Result<Option<f64>, RecordingError> {
        while self.from == self.ready {
            if self.has_ended && self.from == self.rows[0].len() {
                return Ok(None);
            }
            self.fill()?;
        }
        Ok(Some(self.rows[0][self.from]))
    }

    /// Removes the next sample.
    fn pop(&mut self) -> Vec<f64> {
        let row: Vec<f64> = self.rows.iter().map(|column| column[self.from]).collect();
        self.from += 1;
        self.last = row[0];
        row
    }

    /// Adds the values at `time`, which never decreases, to `columns`; `false` if that is before
    /// the first sample or after the last.
    fn at(&mut self, time: f64, columns: &mut [Vec<f64>]) -> Result<bool, RecordingError> {
        while self.head()?.is_some_and(|head| head <= time) {
            let sample = self.pop();
            match &self.before {
                Some(before) if before[0] == sample[0] => self.left_out += 1,
                _ => self.before = Some(sample),
            }
        }
        let after = self.head()?;
        let mut is_covered = true;
        let between = match (&self.before, after) {
            (Some(before), _) if before[0] == time => Some((before, 0.0)),
            (Some(before), Some(after)) => {
                let interval = after - before[0];
                if interval > self.longest {
                    self.in_gaps += 1;
                    None
                } else {
                    self.furthest = self.furthest.max((time - before[0]).min(after - time));
                    Some((before, (time - before[0]) / interval))
                }
            }
            _ => {
                self.outside += 1;
                is_covered = false;
                None
            }
        };
        for (place, column) in columns.iter_mut().enumerate() {
            column.push(match between {
                None => f64::NAN,
                Some((before, 0.0)) => before[place + 1],
                Some((before, share)) => {
                    let (from, to) = (before[place + 1], self.rows[place + 1][self.from]);
                    from + share * (to - from)
                }
            });
        }
        Ok(is_covered)
    }
}

/// Rows at the times of one lane.
struct Join {
    lanes: Vec<Lane>,
    onto: usize,
}

impl Batches for Join {
    fn next(&mut self, columns: &mut [Vec<f64>]) -> Result<bool, RecordingError> {
        columns.iter_mut().for_each(Vec::clear);
        let (clock, values) = columns.split_first_mut().expect("the clock is a column");
        while clock.len() < BATCH_ROWS {
            let Some(time) = self.lanes[self.onto].head()? else { break };
            let row = self.lanes[self.onto].pop();
            clock.push(time);
            let mut is_covered = true;
            let mut from = 0;
            for (place, lane) in self.lanes.iter_mut().enumerate() {
                let columns = &mut values[from..from + lane.rows.len() - 1];
                from += columns.len();
                if place == self.onto {
                    columns
                        .iter_mut()
                        .zip(&row[1..])
                        .for_each(|(column, value)| column.push(*value));
                } else {
                    is_covered &= lane.at(time, columns)?;
                }
            }
            if !is_covered {
                clock.pop();
                values.iter_mut().for_each(|column| column.truncate(clock.len()));
            }
        }
        Ok(!clock.is_empty())
    }

    fn notes(&self) -> Vec<String> {
        let mut notes: Vec<String> =
            self.lanes.iter().flat_map(|lane| lane.batches.notes()).collect();
        for (_, lane) in self.lanes.iter().enumerate().filter(|(place, _)| *place != self.onto) {
            let main = &self.lanes[self.onto];
            let (name, rate, furthest) = (&lane.name, lane.rate, lane.furthest * 1e3);
            let slower = if lane.rate < 0.9 * main.rate { "slower than the rows and " } else { "" };
            notes.push(format!(
                "{name} ({rate:.1} per second on average) is {slower}interpolated; the nearest sample of a row is at most {furthest:.3} ms away"
            ));
            let (outside, in_gaps, longest) = (lane.outside, lane.in_gaps, lane.longest * 1e3);
            if outside > 0 {
                notes.push(format!("{outside} rows before the first sample of {name} or after its last are left out"));
            }
            if in_gaps > 0 {
                notes.push(format!(
                    "{name} has no value at {in_gaps} rows in gaps longer than {longest:.3} ms"
                ));
            }
        }
        notes
    }

    fn warnings(&self) -> Vec<String> {
        let mut warnings: Vec<String> =
            self.lanes.iter().flat_map(|lane| lane.batches.warnings()).collect();
        for lane in self.lanes.iter().filter(|lane| lane.left_out > 0) {
            let (name, count) = (&lane.name, lane.left_out);
            warnings.push(format!(
                "{count} samples of {name} without a time, of a time twice or too late are left out"
            ));
        }
        warnings
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::Column;
    use crate::container::{Content, Opened};
    use crate::formats::Source;

    /// Difference allowed between a line and its interpolation, in its own unit: rounding of
    /// numbers up to 10.
    const EXACT: f64 = 1e-11;

    /// Topics in memory, returned in pieces.
    struct Log {
        columns: Vec<Vec<Vec<f64>>>,
        piece: usize,
    }

    struct Pieces {
        columns: Vec<Vec<f64>>,
        at: usize,
        piece: usize,
    }

    impl Log {
        /// Topics with stamps, log times and one value each.
        fn of(piece: usize, topics: &[(&str, Vec<[f64; 3]>)]) -> Container {
            let column = |name: &str| Column { name: name.into(), unit: None, is_numeric: true };
            let split = |(_, rows): &(&str, Vec<[f64; 3]>)| {
                (0..3).map(|k| rows.iter().map(|row| row[k]).collect()).collect::<Vec<Vec<f64>>>()
            };
            let tables = topics.iter().map(|(name, _)| Table {
                name: (*name).into(),
                kind: String::new(),
                rows: None,
                columns: vec![column(HEADER_STAMP), column(LOG_TIME), column("value")],
            });
            let source = Source { file: "log".into(), format: "test" };
            let log = Self { columns: topics.iter().map(split).collect(), piece };
            Container::new(source, tables.collect(), log)
        }
    }

    impl Content for Log {
        fn open(&self, table: usize, _: &Table, columns: &[usize]) -> Opened {
            let columns =
                columns.iter().map(|&column| self.columns[table][column].clone()).collect();
            Ok(Box::new(Pieces { columns, at: 0, piece: self.piece }))
        }
    }

    impl Batches for Pieces {
        fn next(&mut self, columns: &mut [Vec<f64>]) -> Result<bool, RecordingError> {
            let to = self.columns[0].len().min(self.at + self.piece);
            for (column, all) in columns.iter_mut().zip(&self.columns) {
                column.clear();
                column.extend_from_slice(&all[self.at..to]);
            }
            let any = to > self.at;
            self.at = to;
            Ok(any)
        }
    }

    fn picks(log: &Container) -> Vec<Pick> {
        (0..log.tables.len()).map(|table| Pick { table, clock: None, values: vec![2] }).collect()
    }

    fn joined(log: &Container) -> (Vec<Vec<f64>>, Joined) {
        let picks = picks(log);
        let mut joined = join(log, &picks, 0, &[]).unwrap();
        let mut all = vec![Vec::new(); 1 + picks.len()];
        let mut batch = all.clone();
        while joined.batches.next(&mut batch).unwrap() {
            all.iter_mut().zip(&batch).for_each(|(all, batch)| all.extend_from_slice(batch));
        }
        (all, joined)
    }

    /// A topic from `start` s with `intervals`, on the line `value = 3 + 2 (t - late)`, logged 1 ms
    /// after its stamp.
    fn line(start: f64, intervals: &[f64], late: f64) -> Vec<[f64; 3]> {
        let mut time = start;
        intervals
            .iter()
            .map(|interval| {
                time += interval;
                [time, time + 1e-3, 3.0 + 2.0 * (time - late)]
            })
            .collect()
    }

    proptest! {
        #[test]
        fn lines_are_joined_exactly_and_never_beyond_their_ends(
            main in prop::collection::vec(0.5e-3..1.5e-3, 20..200),
            other in prop::collection::vec(2e-3..3e-3, 5..80),
            start in -0.05..0.05,
        ) {
            let other = line(start, &other, 0.0);
            let (first, last) = (other[0][0], other[other.len() - 1][0]);
            let log = Log::of(7, &[("/a", line(0.0, &main, 0.0)), ("/b", other)]);
            let times = line(0.0, &main, 0.0).into_iter().map(|row| row[0]);
            let covered: Vec<f64> = times.filter(|time| (first..=last).contains(time)).collect();
            if covered.is_empty() {
                let error = join(&log, &picks(&log), 0, &[]).err().map(|error| error.to_string());
                prop_assert!(error.is_some_and(|text| text.contains("no time in common")));
                return Ok(());
            }
            let (columns, _) = joined(&log);
            prop_assert_eq!(&columns[0], &covered);
            for (row, &time) in columns[0].iter().enumerate() {
                prop_assert!((columns[2][row] - (3.0 + 2.0 * time)).abs() < EXACT);
            }
        }

        #[test]
        fn the_result_depends_neither_on_pieces_nor_on_the_order_within_them(
            main in prop::collection::vec(0.5e-3..1.5e-3, 20..300),
            other in prop::collection::vec(1e-3..4e-3, 20..80),
            piece in 1_usize..100,
            seed in any::<u64>(),
        ) {
            let (a, b) = (line(0.0, &main, 0.0), line(0.0, &other, 0.0));
            let (expected, _) = joined(&Log::of(1 << 16, &[("/a", a.clone()), ("/b", b.clone())]));
            let turned = |rows: &[[f64; 3]]| {
                let mut rows = rows.to_vec();
                rows.chunks_mut(2 + (seed % 20) as usize).for_each(<[_]>::reverse);
                rows
            };
            // Stamps out of order would not count as advancing: the clock is the same because it is
            // requested.
            let log = Log::of(piece, &[("/a", turned(&a)), ("/b", turned(&b))]);
            let picks: Vec<Pick> = (0..2).map(|table| Pick { table, clock: Some(0), values: vec![2] }).collect();
            let mut found = vec![Vec::new(); 3];
            let mut batch = found.clone();
            let mut joined = join(&log, &picks, 0, &[]).unwrap();
            while joined.batches.next(&mut batch).unwrap() {
                found.iter_mut().zip(&batch).for_each(|(all, batch)| all.extend_from_slice(batch));
            }
            prop_assert_eq!(&found[..2], &expected[..2]);
            // The gaps were determined in the order of the file, the only permitted difference.
            for (found, expected) in found[2].iter().zip(&expected[2]) {
                prop_assert!(found.is_nan() || expected.is_nan() || found == expected);
            }
        }

        #[test]
        fn a_lag_shows_as_it_is(lag in -5e-3..5e-3) {
            let intervals = [1e-3; 100];
            let log = Log::of(16, &[("/a", line(0.0, &intervals, 0.0)), ("/b", line(0.0, &intervals, lag))]);
            let (columns, _) = joined(&log);
            for (one, other) in columns[1].iter().zip(&columns[2]) {
                prop_assert!((one - other - 2.0 * lag).abs() < EXACT);
            }
        }
    }

    #[test]
    fn topics_without_a_common_time_are_refused_with_both_ranges() {
        let refused = |late_stamps: f64, late_logs: f64| {
            let other = line(0.0, &[0.01; 50], 0.0)
                .iter()
                .map(|[stamp, log, value]| [stamp + late_stamps, log + late_logs, *value])
                .collect();
            let log = Log::of(7, &[("/rows", line(0.0, &[0.01; 50], 0.0)), ("/other", other)]);
            let pick = |table| Pick { table, clock: None, values: vec![2] };
            join(&log, &[pick(0), pick(1)], 0, &[]).err().map(|error| error.to_string())
        };
        let clocks = refused(100.0, 0.0).unwrap();
        for essential in [
            "/rows from 0.010 to 0.500 s",
            "/other from 100.010 to 100.500 s (header.stamp_s)",
            "‹columns='time_s=/rows.log_time_s'›",
        ] {
            assert!(clocks.contains(essential), "{clocks}");
        }
        let apart = refused(100.0, 100.0).unwrap();
        assert!(apart.contains("recorded at the same time, or record them again"), "{apart}");
        assert_eq!(refused(0.4, 0.4), None, "a part in common is read");
    }

    #[test]
    fn nothing_is_made_up_in_gaps() {
        let mut intervals = vec![2e-3; 60];
        intervals[30] = 20e-3;
        let log = Log::of(
            16,
            &[("/a", line(2e-3 + 0.5e-3, &[1e-3; 145], 0.0)), ("/b", line(0.0, &intervals, 0.0))],
        );
        let (columns, joined) = joined(&log);
        for (row, &time) in columns[0].iter().enumerate() {
            let is_inside = time > 60e-3 && time < 80e-3;
            assert_eq!(columns[2][row].is_nan(), is_inside, "{time} s");
        }
        assert!(columns[0].iter().all(|time| *time < 138.1e-3), "nothing after the last sample");
        let notes = joined.batches.notes();
        assert!(notes.iter().any(|note| note.contains("at 20 rows in gaps")), "{notes:?}");
        assert!(notes.iter().any(|note| note.contains("after its last are left out")), "{notes:?}");
        assert!(notes.iter().any(|note| note.contains("slower than the rows")), "{notes:?}");
    }

    #[test]
    fn clocks_that_disagree_are_reported_with_their_numbers() {
        let mut b = line(0.0, &[1e-3; 100], 0.0);
        b.iter_mut().enumerate().for_each(|(k, row)| row[1] += 0.25 + 1e-5 * (k % 3) as f64);
        let log = Log::of(16, &[("/a", line(0.0, &[1e-3; 100], 0.0)), ("/b", b)]);
        let (_, joined) = joined(&log);
        assert_eq!(joined.clock, HEADER_STAMP);
        assert_eq!(joined.warnings.len(), 1);
        assert!(joined.warnings[0].contains("differ by 0.2500"), "{}", joined.warnings[0]);
    }

    #[test]
    fn stamps_that_stand_still_give_way_to_the_log() {
        let mut b = line(0.0, &[1e-3; 100], 0.0);
        b.iter_mut().for_each(|row| row[0] = 0.0);
        let log = Log::of(16, &[("/a", line(0.0, &[1e-3; 100], 0.0)), ("/b", b)]);
        let (_, joined) = joined(&log);
        assert_eq!(joined.clock, LOG_TIME);
        assert!(
            joined.notes[0].contains("header.stamp_s of /b does not advance"),
            "{:?}",
            joined.notes
        );
    }

    #[test]
    fn repeated_and_missing_times_are_left_out_and_counted() {
        let mut b = line(0.0, &[1e-3; 1000], 0.0);
        b[10][0] = b[9][0];
        b[20][0] = f64::NAN;
        let log = Log::of(16, &[("/a", line(0.0, &[1e-3; 1000], 0.0)), ("/b", b)]);
        let (columns, joined) = joined(&log);
        assert!(
            joined.batches.warnings()[0].starts_with("2 samples of /b"),
            "{:?}",
            joined.batches.warnings()
        );
        assert!(
            (columns[2][10] - columns[1][10]).abs() < EXACT
                && (columns[2][20] - columns[1][20]).abs() < EXACT
        );
    }
}
