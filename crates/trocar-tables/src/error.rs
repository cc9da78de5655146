//! Errors of all code that writes files: what failed, where, what was found, what was
//! expected, and a remedy on a `hint:` line.

use std::path::PathBuf;

/// Why a result cannot be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OutputError {
    /// The file or its temporary file cannot be created.
    #[error("{}: cannot create: {source}\n\nhint: the folder must exist and be writable; choose another with ‹out›", path.display())]
    Create {
        /// Destination of the output.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// Writing failed, for example on a full disk; nothing remains.
    #[error("{}: cannot write: {source}\n\nhint: nothing was written there; free some space or choose another place with ‹out›", path.display())]
    Write {
        /// Destination of the output.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// It would replace an input.
    #[error(
        "{}: the output would overwrite the input {}\n\nhint: give the output another name or folder; nothing was changed",
        path.display(), input.display()
    )]
    IsInput {
        /// Destination of the output.
        path: PathBuf,
        /// The input that is the same file.
        input: PathBuf,
    },
    /// The extension is that of none of the formats written.
    #[error("{}: cannot write this format, expected a name that ends in .csv, .csv.gz, .csv.zst, .parquet or .arrow", path.display())]
    Extension {
        /// Destination of the output.
        path: PathBuf,
    },
    /// The extension selects a format that this build does not support.
    #[error("{}: this build has no feature {feature}\n\nhint: build with --features {feature}, or let the name end in .csv", path.display())]
    NoFeature {
        /// Destination of the output.
        path: PathBuf,
        /// Name of the cargo feature.
        feature: &'static str,
    },
}

/// Why a table of results cannot be read back.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TableError {
    /// The file cannot be opened.
    #[error("{}: cannot open: {source}", path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// What is in the file cannot be read.
    #[error("{}: {problem}", path.display())]
    Unread {
        /// The file.
        path: PathBuf,
        /// What was found, and the remedy.
        problem: String,
    },
}

#[cfg(not(feature = "parquet"))]
impl TableError {
    /// This build cannot read Parquet.
    pub(crate) fn no_parquet(path: &std::path::Path) -> Self {
        let feature = "parquet";
        let problem =
            format!("this build has no feature {feature}\n\nhint: build with --features {feature}");
        Self::Unread { path: path.to_owned(), problem }
    }
}
