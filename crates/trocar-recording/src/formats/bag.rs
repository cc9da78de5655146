//! A robot log in one file: its topics as tables.

use std::path::{Path, PathBuf};

use trocar_tables::ros::{self, Epochs, Extractor, Topic};

use super::ordered::{Blocks, Ordered};
use crate::container::{Batches, Container};
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
    tables: Vec<Table>,
    notes: Vec<String>,
    warnings: Vec<String>,
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
            tables: topics.iter().map(|topic| topic.table.clone()).collect(),
            notes: ros::epoch_notes(topics.iter(), epochs),
            topics,
            warnings,
            messages,
        }
    }
}

impl Container for Log {
    fn format(&self) -> &'static str {
        self.format
    }

    fn tables(&self) -> &[Table] {
        &self.tables
    }

    fn notes(&self) -> &[String] {
        &self.notes
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }

    fn clock(&self, table: usize, column: usize) -> usize {
        self.topics[table].clock(column, self.epochs)
    }

    fn open(&self, table: usize, columns: &[usize]) -> Result<Box<dyn Batches>, RecordingError> {
        let Table { name, rows, .. } = &self.tables[table];
        check(&self.path, self.format, &self.tables[table], columns)?;
        let extractor = self.topics[table].extractor(columns, self.epochs);
        let blocks = self.messages.blocks(table, extractor)?;
        let file = self.path.display().to_string();
        Ok(Box::new(Ordered::new(&file, name, blocks, columns.len(), *rows)))
    }
}

/// Rejects columns that are not numeric.
pub(super) fn check(
    path: &Path,
    format: &'static str,
    table: &Table,
    columns: &[usize],
) -> Result<(), RecordingError> {
    match columns.iter().map(|&column| &table.columns[column]).find(|column| !column.is_numeric) {
        None => Ok(()),
        Some(column) => {
            let (file, column) =
                (path.display().to_string(), format!("{} of {}", column.name, table.name));
            Err(RecordingError::NotNumeric { file, format, column })
        }
    }
}
