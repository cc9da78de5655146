//! One module for each format other than text: the content of a file, and its columns as numbers.
//!
//! All use a `Source`, which names the file in messages. None allocates the size stated in a
//! header without checking it against the file's length.

use std::fmt::Display;
use std::fs::File;
use std::io;

use super::RecordingError;

#[cfg(feature = "arrow")]
pub(super) mod arrow;
#[cfg(any(feature = "mcap", feature = "rosbag", feature = "ros1"))]
mod bag;
#[cfg(any(feature = "mcap", feature = "ros1"))]
mod chunks;
#[cfg(feature = "hdf5")]
pub(super) mod hdf5;
#[cfg(feature = "json")]
pub(super) mod json_lines;
pub(super) mod lengths;
pub(super) mod mat5;
#[cfg(feature = "mcap")]
pub(super) mod mcap;
pub(super) mod numpy;
#[cfg(any(feature = "mcap", feature = "rosbag", feature = "ros1"))]
mod ordered;
#[cfg(feature = "parquet")]
pub(super) mod parquet;
#[cfg(feature = "ros1")]
pub(super) mod ros1;
#[cfg(feature = "rosbag")]
pub(super) mod rosbag;
#[cfg(feature = "xlsx")]
pub(super) mod xlsx;
#[cfg(any(feature = "xlsx", feature = "npz"))]
mod zipped;

/// A file and its detected format, for messages.
#[derive(Debug, Clone)]
pub(super) struct Source {
    /// File name given by the caller.
    pub(super) file: String,
    /// Name of the format.
    pub(super) format: &'static str,
}

impl Source {
    /// The content at `place` contradicts the format.
    pub(super) fn damaged(&self, place: impl Display, found: impl Display) -> RecordingError {
        let problem = format!(
            "damaged {} file, {place}: {found}\n\nhint: was it cut off while it was written or copied? fetch or export it again",
            self.format
        );
        RecordingError::unusable(&self.file, problem)
    }

    /// The format permits it, but it is not supported; `hint` is the workaround.
    pub(super) fn unsupported(&self, found: impl Display, hint: &'static str) -> RecordingError {
        let format = self.format;
        let problem = format!("{format} with {found}, which is not read\n\nhint: {hint}");
        RecordingError::unusable(&self.file, problem)
    }

    /// A format that this build does not support.
    pub(super) fn no_feature(&self, feature: &str) -> RecordingError {
        let problem = format!(
            "a {} file, and this build has no feature {feature}\n\nhint: build with --features {feature}, or export the recording as CSV",
            self.format
        );
        RecordingError::unusable(&self.file, problem)
    }

    /// The outcome of `read`, which calls a third-party reader: a panic on a damaged file is
    /// converted to an error.
    #[cfg(any(feature = "arrow", feature = "hdf5", feature = "xlsx"))]
    pub(super) fn guard<T>(
        &self,
        place: impl Display,
        read: impl FnOnce() -> Result<T, RecordingError>,
    ) -> Result<T, RecordingError> {
        let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(read));
        outcome.unwrap_or_else(|_| Err(self.damaged(place, "data that its reader cannot decode")))
    }
}

/// Reads at a position of a file shared by several readers.
#[cfg(unix)]
pub(super) fn read_at(file: &File, bytes: &mut [u8], at: u64) -> io::Result<usize> {
    std::os::unix::fs::FileExt::read_at(file, bytes, at)
}

/// Reads at a position of a file shared by several readers.
#[cfg(windows)]
pub(super) fn read_at(file: &File, bytes: &mut [u8], at: u64) -> io::Result<usize> {
    std::os::windows::fs::FileExt::seek_read(file, bytes, at)
}

/// In a page there are no files.
#[cfg(not(any(unix, windows)))]
pub(super) fn read_at(_: &File, _: &mut [u8], _: u64) -> io::Result<usize> {
    Err(io::ErrorKind::Unsupported.into())
}

/// Fills `bytes` from a position of a file shared by several readers.
pub(super) fn read_exact_at(file: &File, mut bytes: &mut [u8], mut at: u64) -> io::Result<()> {
    while !bytes.is_empty() {
        match read_at(file, bytes, at) {
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(read) => {
                bytes = &mut bytes[read..];
                at += read as u64;
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// Replaces `out` by the zstd frames in `data`, of `size` bytes as they state. Memory is reserved
/// for what is likely, and beyond that grows with what is found.
#[cfg(any(feature = "mcap", feature = "rosbag"))]
fn decompress_zstd(data: &[u8], size: usize, out: &mut Vec<u8>) -> io::Result<()> {
    const LIKELY: usize = 256;
    out.clear();
    if size <= LIKELY.saturating_mul(data.len()) {
        out.reserve_exact(size);
        return zstd::bulk::Decompressor::new()?.decompress_to_buffer(data, out).map(drop);
    }
    io::Read::read_to_end(&mut io::Read::take(zstd::Decoder::new(data)?, size as u64), out)
        .map(drop)
}

#[cfg(all(test, feature = "mcap", feature = "rosbag", feature = "ros1"))]
mod log_tests;
