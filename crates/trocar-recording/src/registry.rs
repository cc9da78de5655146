//! The formats, in one list: how each is recognised, and what reads it.
//!
//! Whatever else knows of formats follows from [`FORMATS`]: what a file is, the feature that a build lacks
//! for it, the files of a folder that may be recordings, the help of the command line.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::RecordingError;
use super::container::Container;
use super::formats::{Source, mat5, numpy, read_exact_at};
use super::text::TextTable;

/// A format of files.
pub struct Format {
    /// Its name in messages.
    pub name: &'static str,
    /// Endings of its files, without a dot. What a file is does not depend on its ending.
    pub endings: &'static [&'static str],
    /// Whether a file or folder is of this format.
    is: fn(&Input) -> bool,
    reader: Reader,
}

/// What reads a format.
enum Reader {
    /// The reader of text, of files and of streams.
    Text,
    /// A reader that this build has.
    Own(Open),
    /// A reader that only builds with this feature have.
    #[cfg_attr(feature = "all-formats", allow(dead_code, reason = "nothing is left out"))]
    LeftOut(&'static str),
    /// None: what the file holds, and the way out.
    Refused(&'static str, &'static str),
}

type Open = fn(&Input, Source) -> Result<Container, RecordingError>;

/// A file or folder that is to be read.
struct Input<'a> {
    path: &'a Path,
    /// Its first bytes; none of a folder.
    head: Vec<u8>,
    /// Its size in bytes.
    length: u64,
    /// Rows of each sheet of a workbook that are not read.
    #[cfg_attr(
        not(feature = "xlsx"),
        allow(dead_code, reason = "no other format has lines to skip")
    )]
    skip_rows: u64,
}

/// The reader `open` in a build with `feature`.
macro_rules! with {
    ($feature:literal, $open:expr) => {{
        #[cfg(feature = $feature)]
        {
            Reader::Own($open)
        }
        #[cfg(not(feature = $feature))]
        {
            Reader::LeftOut($feature)
        }
    }};
}

/// Name of workbooks, which have lines to skip as text has.
const WORKBOOK: &str = "Excel workbook";

const SAVE_SHEET: &str = "save the spreadsheet as .xlsx or CSV";

/// All formats, in the order in which they are tried; what is none of the others is the first.
pub const FORMATS: [Format; 19] = [
    Format {
        name: "text",
        endings: &["csv", "tsv", "txt", "dat", "log", "gz", "zst", "xz"],
        is: |_| false,
        reader: Reader::Text,
    },
    Format {
        name: "Parquet",
        endings: &["parquet", "pq"],
        is: |input| input.has(0, b"PAR1") || input.has(0, b"PARE"),
        reader: with!("parquet", |input, source| {
            super::formats::parquet::open(input.file()?, input.length, source)
        }),
    },
    Format {
        name: "Arrow",
        endings: &["arrow", "feather", "ipc"],
        is: |input| input.has(0, b"ARROW1"),
        reader: with!("arrow", |input, source| {
            super::formats::arrow::open(input.file()?, input.length, source)
        }),
    },
    Format {
        name: "MCAP",
        endings: &["mcap"],
        is: |input| input.has(0, b"\x89MCAP0\r\n"),
        reader: with!("mcap", |input, _| Ok(super::formats::mcap::open(input.path)?.into())),
    },
    Format {
        name: "ROS 1 bag",
        endings: &["bag"],
        is: |input| input.has(0, b"#ROSBAG V"),
        reader: with!("ros1", |input, _| Ok(super::formats::ros1::open(input.path)?.into())),
    },
    Format {
        name: "ROS 2 bag",
        endings: &["db3"],
        is: |input| input.has(0, b"SQLite format 3\0") || is_folder(input.path),
        reader: with!("rosbag", |input, _| super::formats::rosbag::open(input.path)),
    },
    Format {
        name: "MATLAB 5",
        endings: &["mat"],
        is: |input| input.has(124, b"\x00\x01IM") || input.has(124, b"\x01\x00MI"),
        reader: Reader::Own(|input, source| mat5::open(input.file()?, input.length, source)),
    },
    Format {
        name: "MATLAB 7.3",
        endings: &[],
        is: |input| input.has(0, b"MATLAB 7.") && is_hdf5(input),
        reader: with!("hdf5", |input, source| {
            super::formats::hdf5::open(input.path, input.length, source)
        }),
    },
    Format {
        name: "HDF5",
        endings: &["h5", "hdf5"],
        is: is_hdf5,
        reader: with!("hdf5", |input, source| {
            super::formats::hdf5::open(input.path, input.length, source)
        }),
    },
    Format {
        name: WORKBOOK,
        endings: &["xlsx", "xlsm"],
        is: |input| input.is_archive() && !is_npz(input) && !is_ods(input),
        reader: with!("xlsx", |input, source| {
            super::formats::xlsx::open(input.path, source, input.skip_rows)
        }),
    },
    Format {
        name: "NumPy array",
        endings: &["npy"],
        is: |input| input.has(0, numpy::MAGIC),
        reader: Reader::Own(|input, source| numpy::open(input.path, input.length, source)),
    },
    Format {
        name: numpy::NPZ,
        endings: &["npz"],
        is: is_npz,
        reader: with!("npz", |input, source| { numpy::open(input.path, input.length, source) }),
    },
    Format {
        name: "JSON lines",
        endings: &["jsonl", "ndjson"],
        is: is_object,
        reader: with!("json", |input, source| {
            super::formats::json_lines::open(input.path, source)
        }),
    },
    Format {
        name: "Arrow stream",
        endings: &["arrows"],
        is: is_arrow_stream,
        reader: with!("arrow", |input, source| {
            super::formats::arrow::stream(input.file()?, input.length, source)
        }),
    },
    Format {
        name: "MATLAB 4",
        endings: &[],
        is: |input| mat5::is_version_4(&input.head),
        reader: Reader::Refused("variables in its layout of before 1996", mat5::SAVE_AGAIN),
    },
    Format {
        name: "Excel 97 workbook",
        endings: &["xls"],
        is: |input| input.has(0, b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"),
        reader: Reader::Refused("cells of the binary Excel format (before 2007)", SAVE_SHEET),
    },
    Format {
        name: "OpenDocument",
        endings: &["ods"],
        is: is_ods,
        reader: Reader::Refused("OpenDocument cells", SAVE_SHEET),
    },
    Format {
        name: "TDMS",
        endings: &["tdms"],
        is: |input| input.has(0, b"TDSm"),
        reader: Reader::Refused(
            "the segments of LabVIEW",
            "export it from LabVIEW or DIAdem as CSV, or in Python: nptdms.TdmsFile.read('run.tdms').as_dataframe().to_csv('run.csv')",
        ),
    },
    Format {
        name: "Feather 1",
        endings: &[],
        is: |input| input.has(0, b"FEA1"),
        reader: Reader::Refused(
            "the Feather layout before 2020",
            "write it again with pyarrow.feather.write_feather(table, 'run.feather', version=2)",
        ),
    },
];

impl Format {
    /// Whether there is a reader of it, perhaps in another build.
    pub fn is_read(&self) -> bool {
        !matches!(self.reader, Reader::Refused(..))
    }
}

/// Endings of the files that may be recordings, without a dot.
pub fn endings() -> impl Iterator<Item = &'static str> {
    FORMATS.iter().flat_map(|format| format.endings).copied()
}

/// The formats that are read, with the endings of their files, in one sentence.
pub fn in_words() -> String {
    let words =
        FORMATS.iter().filter(|format| format.is_read()).map(|format| match format.endings {
            [] => format.name.to_owned(),
            endings => format!("{} (.{})", format.name, endings.join(", .")),
        });
    words.collect::<Vec<_>>().join(", ")
}

/// Whether a folder is one recording: a ROS 2 bag.
pub fn is_folder(path: &Path) -> bool {
    path.join("metadata.yaml").is_file()
}

/// Opens a file of any format; text is one table.
///
/// # Errors
/// [`RecordingError`] when the file cannot be opened, is damaged, or has an unsupported format.
pub fn any(path: &Path) -> Result<Container, RecordingError> {
    any_after(path, 0)
}

/// The same, of text and of each sheet of a workbook only the part after `skip_rows` lines.
///
/// # Errors
/// As for [`any`].
pub fn any_after(path: &Path, skip_rows: u64) -> Result<Container, RecordingError> {
    match open(path, skip_rows)? {
        Some(container) => Ok(container),
        None => TextTable::open(path, skip_rows),
    }
}

/// The same; `None` if it is text.
///
/// Only regular files and folders are examined, since the bytes of a pipe can be read only once.
///
/// # Errors
/// As for [`any`], and when rows are to be skipped in a format that has no lines.
pub fn open(path: &Path, skip_rows: u64) -> Result<Option<Container>, RecordingError> {
    let file = path.display().to_string();
    if file == "-" {
        return Ok(None);
    }
    let input = Input::open(path, skip_rows).map_err(RecordingError::cannot_open(path))?;
    let format = FORMATS.iter().find(|format| (format.is)(&input)).unwrap_or(&FORMATS[0]);
    let Format { name, reader, .. } = format;
    if skip_rows > 0 && !matches!(reader, Reader::Text) && *name != WORKBOOK {
        let problem = format!(
            "‹skip_rows› is for text and spreadsheets, and this is a file of the format {name}"
        );
        return Err(RecordingError::unusable(file, problem));
    }
    let source = Source { file, format: name };
    match reader {
        Reader::Text => Ok(None),
        Reader::Own(open) => open(&input, source).map(Some),
        Reader::LeftOut(feature) => Err(source.no_feature(feature)),
        Reader::Refused(found, hint) => Err(source.unsupported(found, hint)),
    }
}

/// Number of first bytes examined: up to the second possible position of the HDF5 signature.
const HEAD: usize = 520;

impl<'a> Input<'a> {
    fn open(path: &'a Path, skip_rows: u64) -> std::io::Result<Self> {
        let metadata = std::fs::metadata(path)?;
        let mut head = Vec::new();
        if metadata.is_file() {
            File::open(path)?.take(HEAD as u64).read_to_end(&mut head)?;
        }
        Ok(Self { path, head, length: metadata.len(), skip_rows })
    }

    /// The file itself.
    fn file(&self) -> Result<File, RecordingError> {
        File::open(self.path).map_err(RecordingError::cannot_open(self.path))
    }

    /// Whether these bytes are at a place near the beginning.
    fn has(&self, at: usize, bytes: &[u8]) -> bool {
        self.head.get(at..).is_some_and(|rest| rest.starts_with(bytes))
    }

    fn is_archive(&self) -> bool {
        self.has(0, b"PK\x03\x04")
    }

    /// Name and first bytes of the first entry of an archive.
    fn first_entry(&self) -> (&[u8], &[u8]) {
        let bytes = self.head.get(26..28).map_or([0; 2], |bytes| [bytes[0], bytes[1]]);
        let end = 30 + usize::from(u16::from_le_bytes(bytes));
        (self.head.get(30..end).unwrap_or_default(), self.head.get(end..).unwrap_or_default())
    }
}

fn is_npz(input: &Input) -> bool {
    input.is_archive() && input.first_entry().0.ends_with(b".npy")
}

fn is_ods(input: &Input) -> bool {
    let (name, content) = input.first_entry();
    input.is_archive() && name == b"mimetype" && content.starts_with(b"application/vnd.oasis")
}

/// Whether the bytes begin an object of JSON with members.
fn is_object(input: &Input) -> bool {
    let head = input.head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&input.head).trim_ascii_start();
    head.strip_prefix(b"{").is_some_and(|rest| rest.trim_ascii_start().starts_with(b"\""))
}

/// First bytes of an HDF5 file, or of what follows a block of the user's.
const HDF5: &[u8] = b"\x89HDF\r\n\x1a\n";

/// Whether HDF5 is at the beginning, or follows a block of text as MATLAB writes it: by the definition of
/// HDF5 any power of two, usually 512 bytes.
fn is_hdf5(input: &Input) -> bool {
    let is_of_matlab = input.has(0, b"MATLAB");
    input.has(0, HDF5)
        || input.has(512, HDF5)
        || (is_of_matlab
            && [1024, 2048, 4096, 8192].into_iter().any(|at| {
                let mut bytes = [0; HDF5.len()];
                input.file().is_ok_and(|file| read_exact_at(&file, &mut bytes, at).is_ok())
                    && bytes == *HDF5
            }))
}

/// Whether a message marker is followed by what can be the length of a schema, which begins every stream.
fn is_arrow_stream(input: &Input) -> bool {
    let length = input.head.get(4..8).and_then(|bytes| bytes.try_into().ok());
    let length = length.map_or(0, u32::from_le_bytes);
    input.has(0, &[0xff; 4]) && (16..1 << 24).contains(&length) && length.is_multiple_of(8)
}
