//! What a file holds, before anything is selected from it: tables of named columns, described.

/// A column of a table.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Name as in the file; for a message, the path to the field, such as `position[insertion]` or
    /// `wrench.force.z`.
    pub name: String,
    /// Unit that the file declares for the name (an attribute, a field's metadata, a message's
    /// definition).
    pub unit: Option<String>,
    /// Whether it holds numbers; other columns are listed and cannot be read.
    pub is_numeric: bool,
}

/// Columns of equal length.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// Topic, group or variable; empty where a file is one table.
    pub name: String,
    /// Its type in the terms of its format, such as `sensor_msgs/msg/JointState`; empty if there is
    /// none.
    pub kind: String,
    /// Number of rows, if the file states it without being read.
    pub rows: Option<u64>,
    /// Its columns, in the file's order.
    pub columns: Vec<Column>,
}

/// How a file stores a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs, reason = "their names say all")]
pub enum Storage {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Storage {
    /// Size in bytes.
    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// The number at the start of `bytes`, in big-endian order if `big`.
    ///
    /// # Panics
    /// With fewer bytes than [`Storage::size`].
    #[inline]
    pub fn number(self, bytes: &[u8], big: bool) -> f64 {
        match self {
            Self::I8 => f64::from(i8::from_le_bytes(little(bytes, big))),
            Self::U8 => f64::from(bytes[0]),
            Self::I16 => f64::from(i16::from_le_bytes(little(bytes, big))),
            Self::U16 => f64::from(u16::from_le_bytes(little(bytes, big))),
            Self::I32 => f64::from(i32::from_le_bytes(little(bytes, big))),
            Self::U32 => f64::from(u32::from_le_bytes(little(bytes, big))),
            Self::I64 => i64::from_le_bytes(little(bytes, big)) as f64,
            Self::U64 => u64::from_le_bytes(little(bytes, big)) as f64,
            Self::F32 => f64::from(f32::from_le_bytes(little(bytes, big))),
            Self::F64 => f64::from_le_bytes(little(bytes, big)),
        }
    }
}

/// The first bytes in little-endian order.
fn little<const N: usize>(bytes: &[u8], big: bool) -> [u8; N] {
    let mut own = [0; N];
    own.copy_from_slice(&bytes[..N]);
    if big {
        own.reverse();
    }
    own
}

/// Columns of the times of a log: when a message was logged and published, and the stamp that it carries.
pub const LOG_TIME: &str = "log_time_s";
/// See [`LOG_TIME`].
#[cfg(feature = "ros")]
pub(crate) const PUBLISH_TIME: &str = "publish_time_s";
/// See [`LOG_TIME`].
pub const HEADER_STAMP: &str = "header.stamp_s";

impl Table {
    /// The single table of a text file, of unknown length.
    pub fn without_a_name(columns: Vec<Column>) -> Self {
        Self { columns, ..Self::default() }
    }
}
