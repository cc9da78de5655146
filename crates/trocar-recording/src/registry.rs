//! The formats, each identified by its first bytes: which file becomes which [`Container`].

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::RecordingError;
use super::container::Container;
use super::formats::{Source, mat5, numpy, read_exact_at};
use super::text::TextTable;

/// Opens a file of any format; text is one table.
///
/// # Errors
/// [`RecordingError`] when the file cannot be opened, is damaged, or has an unsupported format.
pub fn any(path: &Path) -> Result<Box<dyn Container>, RecordingError> {
    any_after(path, 0)
}

/// The same, of text and of each sheet of a workbook only the part after `skip_rows` lines.
///
/// # Errors
/// As for [`any`].
pub fn any_after(path: &Path, skip_rows: u64) -> Result<Box<dyn Container>, RecordingError> {
    match open(path, skip_rows)? {
        Some(container) => Ok(container),
        None => Ok(Box::new(TextTable::open(path, skip_rows)?)),
    }
}

/// Opens the file if its first bytes identify a format other than text; of each sheet of a
/// workbook without its first `skip_rows` rows.
///
/// Only regular files and folders that are ROS 2 bags are examined, since the bytes of a pipe can
/// be read only once.
///
/// # Errors
/// As for [`any`], and when rows are to be skipped in a format that has no lines.
pub fn open(path: &Path, skip_rows: u64) -> Result<Option<Box<dyn Container>>, RecordingError> {
    let name = path.display().to_string();
    let refused = |source| RecordingError::Open { file: name.clone(), source };
    if name == "-" {
        return Ok(None);
    }
    let metadata = std::fs::metadata(path).map_err(refused)?;
    let cannot_skip = |format: &str| RecordingError::BadOption {
        file: name.clone(),
        option: "‹skip_rows›",
        problem: format!("is for text and spreadsheets, and this is a file of the format {format}"),
    };
    if metadata.is_dir() {
        return match open_folder(path, name.clone())? {
            Some(container) if skip_rows > 0 => Err(cannot_skip(container.format())),
            container => Ok(container),
        };
    }
    if !metadata.is_file() {
        return Ok(None);
    }
    let file = File::open(path).map_err(refused)?;
    let length = file.metadata().map_err(refused)?.len();
    let mut head = Vec::new();
    (&file).take(HEAD as u64).read_to_end(&mut head).map_err(refused)?;
    let kind = Kind::of(&head).or_else(|| is_hdf5_after_text(&file, &head).then_some(Kind::Hdf5));
    let Some(kind) = kind else { return Ok(None) };
    let format = if kind == Kind::Hdf5 && head.starts_with(b"MATLAB 7.") {
        "MATLAB 7.3"
    } else {
        kind.name()
    };
    if skip_rows > 0 && kind != Kind::Xlsx {
        return Err(cannot_skip(format));
    }
    let source = Source { file: name, format };
    kind.open(path, file, length, source, skip_rows).map(Some)
}

/// Opens a folder as a bag, if it is one.
fn open_folder(path: &Path, file: String) -> Result<Option<Box<dyn Container>>, RecordingError> {
    if !path.join("metadata.yaml").is_file() {
        return Ok(None);
    }
    if cfg!(not(feature = "rosbag")) {
        return Err(RecordingError::NoFeature { file, format: "ROS 2 bag", feature: "rosbag" });
    }
    #[cfg(feature = "rosbag")]
    return super::formats::rosbag::open(path).map(Some);
    #[cfg(not(feature = "rosbag"))]
    Ok(None)
}

/// Number of first bytes examined: up to the second possible position of the HDF5 signature.
const HEAD: usize = 520;

/// A format identified by its first bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Parquet,
    Arrow,
    ArrowStream,
    Mat4,
    Mat5,
    Hdf5,
    Mcap,
    Rosbag,
    Ros1,
    Xlsx,
    Npy,
    Npz,
    JsonLines,
    /// Recognised by name only.
    Xls,
    Ods,
    Tdms,
    Feather1,
}

/// Endings of files of text, compressed or not.
const TEXT: [&str; 8] = ["csv", "tsv", "txt", "dat", "log", "gz", "zst", "xz"];

/// Endings of the files that may be recordings, without a dot: of text, and of every format.
pub fn endings() -> impl Iterator<Item = &'static str> {
    TEXT.into_iter().chain(Kind::ALL.into_iter().flat_map(|kind| kind.endings().iter().copied()))
}

impl Kind {
    const ALL: [Self; 17] = [
        Self::Parquet,
        Self::Arrow,
        Self::ArrowStream,
        Self::Mat4,
        Self::Mat5,
        Self::Hdf5,
        Self::Mcap,
        Self::Rosbag,
        Self::Ros1,
        Self::Xlsx,
        Self::Npy,
        Self::Npz,
        Self::JsonLines,
        Self::Xls,
        Self::Ods,
        Self::Tdms,
        Self::Feather1,
    ];

    fn endings(self) -> &'static [&'static str] {
        match self {
            Self::Parquet => &["parquet", "pq"],
            Self::Arrow => &["arrow", "feather", "ipc"],
            Self::ArrowStream => &["arrows"],
            Self::Mat4 | Self::Feather1 => &[],
            Self::Mat5 => &["mat"],
            Self::Hdf5 => &["h5", "hdf5"],
            Self::Mcap => &["mcap"],
            Self::Rosbag => &["db3"],
            Self::Ros1 => &["bag"],
            Self::Xlsx => &["xlsx", "xlsm"],
            Self::Npy => &["npy"],
            Self::Npz => &["npz"],
            Self::JsonLines => &["jsonl", "ndjson"],
            Self::Xls => &["xls"],
            Self::Ods => &["ods"],
            Self::Tdms => &["tdms"],
        }
    }

    fn of(head: &[u8]) -> Option<Self> {
        let version = head.get(124..128).unwrap_or_default();
        Some(match head {
            _ if head.starts_with(b"PAR1") || head.starts_with(b"PARE") => Self::Parquet,
            _ if head.starts_with(b"ARROW1") => Self::Arrow,
            _ if head.starts_with(b"\x89MCAP0\r\n") => Self::Mcap,
            _ if head.starts_with(b"#ROSBAG V") => Self::Ros1,
            _ if head.starts_with(b"SQLite format 3\0") => Self::Rosbag,
            _ if head.starts_with(HDF5)
                || head.get(512..).is_some_and(|head| head.starts_with(HDF5)) =>
            {
                Self::Hdf5
            }
            _ if version == b"\x00\x01IM" || version == b"\x01\x00MI" => Self::Mat5,
            _ if head.starts_with(b"PK\x03\x04") => Self::of_archive(head),
            _ if head.starts_with(numpy::MAGIC) => Self::Npy,
            _ if head.starts_with(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1") => Self::Xls,
            _ if head.starts_with(b"TDSm") => Self::Tdms,
            _ if head.starts_with(b"FEA1") => Self::Feather1,
            _ if is_object(head) => Self::JsonLines,
            _ if head.starts_with(&[0xff; 4]) && is_arrow_message(head) => Self::ArrowStream,
            _ if mat5::is_version_4(head) => Self::Mat4,
            _ => return None,
        })
    }

    /// Of a ZIP archive, by its first entry.
    fn of_archive(head: &[u8]) -> Self {
        let length =
            head.get(26..28).map_or(0, |bytes| usize::from(bytes[0]) + 256 * usize::from(bytes[1]));
        let name = head.get(30..30 + length).unwrap_or_default();
        let content = head.get(30 + length..).unwrap_or_default();
        match () {
            () if name.ends_with(b".npy") => Self::Npz,
            () if name == b"mimetype" && content.starts_with(b"application/vnd.oasis") => Self::Ods,
            () => Self::Xlsx,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Parquet => "Parquet",
            Self::Arrow => "Arrow",
            Self::ArrowStream => "Arrow stream",
            Self::Mat4 => "MATLAB 4",
            Self::Mat5 => "MATLAB 5",
            Self::Hdf5 => "HDF5",
            Self::Mcap => "MCAP",
            Self::Rosbag => "SQLite",
            Self::Ros1 => "ROS 1 bag",
            Self::Xlsx => "Excel workbook",
            Self::Npy => "NumPy array",
            Self::Npz => numpy::NPZ,
            Self::JsonLines => "JSON lines",
            Self::Xls => "Excel 97 workbook",
            Self::Ods => "OpenDocument",
            Self::Tdms => "TDMS",
            Self::Feather1 => "Feather 1",
        }
    }

    /// Opens the file, or reports the feature that this build lacks for it.
    #[cfg_attr(
        not(feature = "all-formats"),
        allow(unused_variables, reason = "every format takes its own")
    )]
    fn open(
        self,
        path: &Path,
        file: File,
        length: u64,
        source: Source,
        skip_rows: u64,
    ) -> Result<Box<dyn Container>, RecordingError> {
        #[cfg(not(feature = "all-formats"))]
        let lacks = |feature| {
            Err(RecordingError::NoFeature {
                file: source.file.clone(),
                format: source.format,
                feature,
            })
        };
        match self {
            #[cfg(feature = "parquet")]
            Self::Parquet => {
                Ok(Box::new(super::formats::parquet::Parquet::open(file, length, source)?))
            }
            #[cfg(feature = "arrow")]
            Self::Arrow => Ok(Box::new(super::formats::arrow::Arrow::open(file, length, source)?)),
            #[cfg(feature = "arrow")]
            Self::ArrowStream => {
                Ok(Box::new(super::formats::arrow::Arrow::stream(file, length, source)?))
            }
            #[cfg(feature = "hdf5")]
            Self::Hdf5 => Ok(Box::new(super::formats::hdf5::Hdf5::open(path, length, source)?)),
            Self::Mat5 => Ok(Box::new(mat5::Mat5::open(file, length, source)?)),
            Self::Mat4 => {
                Err(source.unsupported("variables in its layout of before 1996", mat5::SAVE_AGAIN))
            }
            #[cfg(feature = "mcap")]
            Self::Mcap => Ok(Box::new(super::formats::mcap::open(path)?)),
            #[cfg(feature = "rosbag")]
            Self::Rosbag => super::formats::rosbag::open(path),
            #[cfg(feature = "ros1")]
            Self::Ros1 => Ok(Box::new(super::formats::ros1::open(path)?)),
            #[cfg(not(feature = "ros1"))]
            Self::Ros1 => lacks("ros1"),
            #[cfg(feature = "xlsx")]
            Self::Xlsx => Ok(Box::new(super::formats::xlsx::Xlsx::open(path, source, skip_rows)?)),
            #[cfg(not(feature = "xlsx"))]
            Self::Xlsx => lacks("xlsx"),
            Self::Npy => Ok(Box::new(numpy::Numpy::open(path, length, source)?)),
            #[cfg(feature = "npz")]
            Self::Npz => Ok(Box::new(numpy::Numpy::open(path, length, source)?)),
            #[cfg(not(feature = "npz"))]
            Self::Npz => lacks("npz"),
            #[cfg(feature = "json")]
            Self::JsonLines => {
                Ok(Box::new(super::formats::json_lines::JsonLines::open(path, source)?))
            }
            #[cfg(not(feature = "json"))]
            Self::JsonLines => lacks("json"),
            Self::Xls => Err(source.unsupported("cells of the binary Excel format (before 2007)", SAVE_SHEET)),
            Self::Ods => Err(source.unsupported("OpenDocument cells", SAVE_SHEET)),
            Self::Tdms => {
                Err(source.unsupported("the segments of LabVIEW", "export it from LabVIEW or DIAdem as CSV, or in Python: nptdms.TdmsFile.read('run.tdms').as_dataframe().to_csv('run.csv')"))
            }
            Self::Feather1 => {
                Err(source.unsupported("the Feather layout before 2020", "write it again with pyarrow.feather.write_feather(table, 'run.feather', version=2)"))
            }
            #[cfg(not(feature = "mcap"))]
            Self::Mcap => lacks("mcap"),
            #[cfg(not(feature = "rosbag"))]
            Self::Rosbag => lacks("rosbag"),
            #[cfg(not(feature = "parquet"))]
            Self::Parquet => lacks("parquet"),
            #[cfg(not(feature = "arrow"))]
            Self::Arrow | Self::ArrowStream => lacks("arrow"),
            #[cfg(not(feature = "hdf5"))]
            Self::Hdf5 => lacks("hdf5"),
        }
    }
}

const SAVE_SHEET: &str = "save the spreadsheet as .xlsx or CSV";

/// Whether the bytes begin an object of JSON with members.
fn is_object(head: &[u8]) -> bool {
    let head = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head).trim_ascii_start();
    head.strip_prefix(b"{").is_some_and(|rest| rest.trim_ascii_start().starts_with(b"\""))
}

/// First bytes of an HDF5 file, or of what follows a block of the user's.
const HDF5: &[u8] = b"\x89HDF\r\n\x1a\n";

/// Whether HDF5 follows a block of text as MATLAB writes it, longer than its usual 512 bytes: by
/// the definition of HDF5 any power of two.
fn is_hdf5_after_text(file: &File, head: &[u8]) -> bool {
    let is_there = |at: u64| {
        let mut bytes = [0; HDF5.len()];
        read_exact_at(file, &mut bytes, at).is_ok() && bytes == *HDF5
    };
    head.starts_with(b"MATLAB") && [1024, 2048, 4096, 8192].into_iter().any(is_there)
}

/// Whether the bytes after the message marker can be the length of a schema, which begins every
/// stream.
fn is_arrow_message(head: &[u8]) -> bool {
    let length =
        head.get(4..8).and_then(|bytes| bytes.try_into().ok()).map_or(0, u32::from_le_bytes);
    (16..1 << 24).contains(&length) && length % 8 == 0
}
