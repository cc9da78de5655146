//! The header and the source file.

use std::path::Path;

use super::CError;
use trocar_tables::output::write_together;

/// A model in C: two files that belong together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CFiles {
    /// Types and functions, for C and C++.
    pub header: String,
    /// Constants and code; it includes the header as `STEM.h`.
    pub source: String,
}

impl CFiles {
    /// Stores the source as `path` and the header next to it, with the extension `h`; both files
    /// appear whole, or neither does.
    ///
    /// # Errors
    /// [`CError::Output`] when a file cannot be written.
    pub fn store(&self, path: &Path) -> Result<(), CError> {
        let header = path.with_extension("h");
        write_together(&[(path, self.source.as_bytes()), (&header, self.header.as_bytes())])?;
        Ok(())
    }
}

/// Name of the source file `path` without its extension, as its `#include` needs it.
///
/// # Errors
/// [`CError::FileName`] for a name that does not end in `.c` or cannot be included.
pub fn stem(path: &Path) -> Result<&str, CError> {
    let name = path.file_name().and_then(|name| name.to_str());
    let stem = name.and_then(|name| name.strip_suffix(".c"));
    let plain = stem.filter(|stem| {
        let mut characters = stem.chars();
        characters.all(|c| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.' | ' ' | '+'))
    });
    plain
        .filter(|stem| !stem.is_empty())
        .ok_or_else(|| CError::FileName { found: path.display().to_string() })
}
