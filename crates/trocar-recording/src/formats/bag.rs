//! A robot log in one file: its topics as tables.

use std::path::{Path, PathBuf};

use trocar_tables::ros::{self, Epochs, Extractor, Topic};

use super::Source;
use super::ordered::{Blocks, Ordered};
use crate::container::{Container, Content, Opened};
use crate::{RecordingError, Table};

/// The messages of the topics of a log.
pub(super) trait Messages {
    /// Rows of one topic, by its index, in the order of the file.
    fn blocks(&self, topic: usize, extractor: Extractor)
    -> Result<Box<dyn Blocks>, RecordingError>;
}

/// A log.
pub(crate) struct Log {
    pub(super) path: PathBuf,
    format: &'static str,
    pub(super) topics: Vec<Topic>,
    /// First log time, ns: by it the files of one bag are put in order.
    #[cfg(feature = "rosbag")]
    pub(super) start: Option<u64>,
    epochs: Epochs,
    pub(super) warnings: Vec<String>,
    pub(super) messages: Box<dyn Messages>,
}

impl Log {
    pub(super) fn new(
        path: &Path,
        format: &'static str,
        start: Option<u64>,
        topics: Vec<Topic>,
        warnings: Vec<String>,
        messages: Box<dyn Messages>,
    ) -> Self {
        let epochs = ros::epochs(topics.iter(), start.unwrap_or(0) as i64);
        Self {
            path: path.to_owned(),
            format,
            #[cfg(feature = "rosbag")]
            start,
            epochs,
            topics,
            warnings,
            messages,
        }
    }
}

impl From<Log> for Container {
    fn from(mut log: Log) -> Self {
        let warnings = std::mem::take(&mut log.warnings);
        let notes = ros::epoch_notes(log.topics.iter(), log.epochs);
        let tables = log.topics.iter().map(|topic| topic.table.clone()).collect();
        let source = Source { file: log.path.display().to_string(), format: log.format };
        Self { notes, warnings, ..Self::new(source, tables, log) }
    }
}

impl Content for Log {
    fn clock(&self, at: usize, _table: &Table, column: usize) -> usize {
        self.topics[at].clock(column, self.epochs)
    }

    fn open(&self, at: usize, Table { name, rows, .. }: &Table, columns: &[usize]) -> Opened {
        let extractor = self.topics[at].extractor(columns, self.epochs);
        let blocks = self.messages.blocks(at, extractor)?;
        let file = self.path.display().to_string();
        Ok(Box::new(Ordered::new(&file, name, blocks, columns.len(), *rows)))
    }
}
