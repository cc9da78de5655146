//! Replacement for reading rows of Parquet files in builds without that feature.

use super::dataset::{DataFile, Job, Metadata, Source};
use super::one::Input;
use trocar_recording::{ReadOptions, RecordingError};

/// The rows of one recording: never constructed.
pub(super) enum Group {}

impl Group {
    pub(super) fn input(
        &self,
        _: &str,
        _: &ReadOptions,
        _: &mut Metadata,
    ) -> Result<Input, RecordingError> {
        match *self {}
    }
}

pub(super) fn values(file: &DataFile, _: &str) -> Result<Vec<String>, RecordingError> {
    Err(refused(&file.name))
}

pub(super) fn jobs(source: &Source) -> Result<Vec<Job>, RecordingError> {
    Err(refused(&source.name))
}

fn refused(file: &str) -> RecordingError {
    RecordingError::NoFeature { file: file.to_owned(), format: "Parquet", feature: "parquet" }
}
