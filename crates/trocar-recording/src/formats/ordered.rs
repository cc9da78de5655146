//! Messages in the order of the log's time.
//!
//! Recorders write messages as they arrive, and the chunks of a file may overlap in time. Rows wait
//! here until no later chunk can contain an earlier one: up to the first time of the following
//! chunks if the file states it, otherwise until [`WINDOW`] more rows have been read. Rows of equal
//! time keep the order of the file. Rows that are further out of order are rejected instead of
//! being sorted wrongly.

use trocar_tables::ros::Block;

use crate::RecordingError;
use crate::container::{BATCH_ROWS, Batches};

/// Rows that wait if the file does not state the times of the following chunks.
const WINDOW: usize = 1 << 16;

/// Most rows that may wait for overlapping chunks.
const MOST_WAITING: usize = 1 << 22;

/// Consecutive parts of a file.
pub(crate) trait Blocks: Send {
    /// The next part; `None` at the end.
    fn next(&mut self) -> Result<Option<Block>, RecordingError>;

    /// Losses so far, as messages.
    fn warnings(&self) -> Vec<String>;
}

/// Rows sorted by log time.
pub(crate) struct Ordered<B> {
    file: String,
    topic: String,
    blocks: B,
    waiting: Block,
    /// Number of rows of `waiting` already returned, and of those that may be.
    from: usize,
    ready: usize,
    is_sorted: bool,
    has_ended: bool,
    /// Log time of the last row returned.
    last: u64,
    undecoded: u64,
    rows: u64,
    expected: Option<u64>,
}

impl<B: Blocks> Ordered<B> {
    /// The rows of `blocks`, of which there are `expected` if the file states it.
    pub(crate) fn new(
        file: &str,
        topic: &str,
        blocks: B,
        width: usize,
        expected: Option<u64>,
    ) -> Self {
        Self {
            file: file.to_owned(),
            topic: topic.to_owned(),
            blocks,
            waiting: Block::new(width),
            from: 0,
            ready: 0,
            is_sorted: true,
            has_ended: false,
            last: 0,
            undecoded: 0,
            rows: 0,
            expected,
        }
    }

    /// Adds one more block and determines which rows are settled.
    fn pull(&mut self) -> Result<(), RecordingError> {
        let Some(mut block) = self.blocks.next()? else {
            self.has_ended = true;
            return self.settle(None);
        };
        self.undecoded += block.undecoded;
        self.waiting.log.drain(..self.from);
        let joins = self
            .waiting
            .log
            .last()
            .is_none_or(|last| block.log.first().is_none_or(|first| last <= first));
        self.is_sorted &= joins && block.log.is_sorted();
        self.waiting.log.append(&mut block.log);
        for (column, more) in self.waiting.columns.iter_mut().zip(&mut block.columns) {
            column.drain(..self.from);
            column.append(more);
        }
        self.from = 0;
        self.settle(block.settled)
    }

    fn settle(&mut self, settled: Option<u64>) -> Result<(), RecordingError> {
        let log = &self.waiting.log;
        let can_settle = settled.is_some() || self.has_ended || log.len() > WINDOW;
        if !self.is_sorted && can_settle {
            self.sort();
        }
        let log = &self.waiting.log;
        self.ready = match settled {
            _ if self.has_ended => log.len(),
            Some(time) => log.partition_point(|&row| row <= time),
            None => log.len().saturating_sub(WINDOW),
        };
        let goes_back = log[self.from..self.ready].first().filter(|&&first| first < self.last);
        if goes_back.is_some() || log.len() > MOST_WAITING {
            let problem = format!(
                "messages of {} are out of the order of their log times by more than {} messages, row {}\n\nhint: sort the log, for example with `mcap sort`",
                self.topic,
                if goes_back.is_some() { WINDOW } else { MOST_WAITING },
                self.rows
            );
            return Err(RecordingError::unusable(&self.file, problem));
        }
        Ok(())
    }

    fn sort(&mut self) {
        let mut order: Vec<usize> = (0..self.waiting.log.len()).collect();
        order.sort_by_key(|&row| self.waiting.log[row]);
        self.waiting.log = order.iter().map(|&row| self.waiting.log[row]).collect();
        for column in &mut self.waiting.columns {
            *column = order.iter().map(|&row| column[row]).collect();
        }
        self.is_sorted = true;
    }
}

impl<B: Blocks> Batches for Ordered<B> {
    fn next(&mut self, columns: &mut [Vec<f64>]) -> Result<bool, RecordingError> {
        columns.iter_mut().for_each(Vec::clear);
        while !self.has_ended && self.ready - self.from < BATCH_ROWS {
            self.pull()?;
        }
        let to = self.ready.min(self.from + BATCH_ROWS);
        if to == self.from {
            return Ok(false);
        }
        for (column, waiting) in columns.iter_mut().zip(&self.waiting.columns) {
            column.extend_from_slice(&waiting[self.from..to]);
        }
        self.last = self.waiting.log[to - 1];
        self.rows += (to - self.from) as u64;
        self.from = to;
        Ok(true)
    }

    fn warnings(&self) -> Vec<String> {
        let mut warnings = self.blocks.warnings();
        let is_at_end = self.has_ended && self.from == self.waiting.log.len();
        if let Some(expected) = self.expected.filter(|&expected| is_at_end && expected != self.rows)
        {
            let (rows, topic) = (self.rows, &self.topic);
            warnings.push(format!(
                "{rows} messages of {topic} were found, and the file's index counts {expected}"
            ));
        }
        if self.undecoded > 0 {
            let (count, topic) = (self.undecoded, &self.topic);
            warnings.push(format!(
                "{count} messages of {topic} end before the fields asked for; they count as missing"
            ));
        }
        warnings
    }
}

impl Blocks for Box<dyn Blocks> {
    fn next(&mut self) -> Result<Option<Block>, RecordingError> {
        (**self).next()
    }

    fn warnings(&self) -> Vec<String> {
        (**self).warnings()
    }
}
