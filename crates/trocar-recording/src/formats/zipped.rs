//! ZIP archives, and what they may unpack to.

use std::fs::File;
use std::io::{self, BufReader};
use std::path::Path;

use zip::ZipArchive;

use super::Source;
use crate::RecordingError;

/// Ratio of the parts to the archive, above that of any workbook of readings (8 to 14).
const DENSEST: u64 = 100;
/// Bytes that any archive may unpack to.
const FREE: u64 = 4 << 20;

pub(super) fn open(path: &Path) -> io::Result<ZipArchive<BufReader<File>>> {
    Ok(ZipArchive::new(BufReader::new(File::open(path)?))?)
}

/// Refuses parts of `unpacked` bytes that an archive of `length` bytes does not justify.
///
/// # Errors
/// [`Source::unsupported`].
pub(super) fn check(unpacked: u64, length: u64, source: &Source) -> Result<(), RecordingError> {
    let most = DENSEST.saturating_mul(length).saturating_add(FREE);
    if unpacked <= most {
        return Ok(());
    }
    let found = format!("more than {most} bytes unpacked, {DENSEST} times those of the file");
    Err(source.unsupported(found, "export the recording as CSV, which is read row by row"))
}
