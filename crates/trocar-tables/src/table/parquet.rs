//! Tables as Parquet.

use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::Arc;

use arrow_schema::SchemaRef;
use parquet::arrow::arrow_writer::{ArrowWriter, ArrowWriterOptions};
use parquet::basic::{Compression, ConvertedType, Repetition, Type as Physical, ZstdLevel};
use parquet::errors::ParquetError;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field as Value;
use parquet::schema::types::{ColumnPath, Type};

use super::{Column, Field, Kind, Table, TableError, arrow};
use crate::output::AtomicFile;

/// Rows of a row group: the number buffered in memory, and what a reader can skip.
const ROW_GROUP: usize = 1 << 17;

pub(super) struct Writer {
    file: ArrowWriter<AtomicFile>,
    schema: SchemaRef,
}

impl Writer {
    pub(super) fn new(file: AtomicFile, fields: &[Field]) -> io::Result<Self> {
        let schema = Arc::new(arrow::schema(fields));
        let options = properties(fields).map(|properties| {
            ArrowWriterOptions::new().with_properties(properties).with_schema_root("schema".into())
        });
        let file = options
            .and_then(|options| ArrowWriter::try_new_with_options(file, schema.clone(), options));
        Ok(Self { file: file.map_err(io_error)?, schema })
    }

    pub(super) fn write(&mut self, columns: &[Column]) -> io::Result<()> {
        // Pages end only at multiples of 1024 rows of a batch. All callers write such multiples, so the
        // bytes are those of one batch.
        let batch = arrow::batch(&self.schema, columns)?;
        self.file.write(&batch).map_err(io_error)
    }

    pub(super) fn finish(self) -> io::Result<AtomicFile> {
        self.file.into_inner().map_err(io_error)
    }
}

/// The same columns give the same bytes: the file contains no version and no time.
fn properties(fields: &[Field]) -> Result<WriterProperties, ParquetError> {
    let mut properties = WriterProperties::builder()
        .set_created_by("trocar".to_owned())
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(1)?))
        .set_statistics_enabled(EnabledStatistics::Chunk)
        .set_offset_index_disabled(true)
        .set_max_row_group_row_count(Some(ROW_GROUP))
        // Numbers hardly repeat: a dictionary would only take time.
        .set_dictionary_enabled(false);
    for field in fields.iter().filter(|field| field.kind == Kind::Text) {
        properties = properties
            .set_column_dictionary_enabled(ColumnPath::new(vec![field.name.clone()]), true);
    }
    Ok(properties.build())
}

/// The error of the operating system, if it caused this one.
fn io_error(error: ParquetError) -> io::Error {
    match error {
        ParquetError::External(source) => match source.downcast::<io::Error>() {
            Ok(source) => *source,
            Err(source) => io::Error::other(source),
        },
        other => io::Error::other(other),
    }
}

fn open(path: &Path) -> Result<SerializedFileReader<File>, TableError> {
    let file =
        File::open(path).map_err(|source| TableError::Open { path: path.to_owned(), source })?;
    SerializedFileReader::new(file).map_err(damaged(path))
}

/// Not a complete Parquet file.
fn damaged(path: &Path) -> impl Fn(ParquetError) -> TableError {
    move |found| {
        let problem = format!(
            "no complete Parquet file: {found}\n\nhint: was it cut off, or is it another format? write it again"
        );
        TableError::Unread { path: path.to_owned(), problem }
    }
}

pub(super) fn read(path: &Path) -> Result<Table, TableError> {
    let reader = open(path)?;
    let other = |column: &str| TableError::Unread {
        path: path.to_owned(),
        problem: format!("column '{column}' holds neither numbers, Booleans nor text"),
    };
    let schema = reader.metadata().file_metadata().schema_descr_ptr();
    let mut table = Table::default();
    for field in schema.root_schema().get_fields() {
        let kind = kind(field).ok_or_else(|| other(field.name()))?;
        table.columns.push(Column::new(kind));
        table.fields.push(field.name().to_owned());
    }
    for row in reader.get_row_iter(None).map_err(damaged(path))? {
        let row = row.map_err(damaged(path))?;
        for ((name, value), column) in row.get_column_iter().zip(&mut table.columns) {
            push(column, value).ok_or_else(|| other(name))?;
        }
    }
    Ok(table)
}

/// Names of the columns of a Parquet file.
pub(super) fn names(path: &Path) -> Result<Vec<String>, TableError> {
    let schema = open(path)?.metadata().file_metadata().schema_descr_ptr();
    Ok(schema.root_schema().get_fields().iter().map(|field| field.name().to_owned()).collect())
}

/// Type of the table column for a Parquet column.
fn kind(field: &Type) -> Option<Kind> {
    if !field.is_primitive() || field.get_basic_info().repetition() == Repetition::REPEATED {
        return None;
    }
    let text = field.get_basic_info().converted_type() == ConvertedType::UTF8;
    match field.get_physical_type() {
        Physical::BOOLEAN => Some(Kind::Boolean),
        Physical::INT32 | Physical::INT64 => Some(Kind::Integer),
        Physical::FLOAT | Physical::DOUBLE => Some(Kind::Number),
        Physical::BYTE_ARRAY if text => Some(Kind::Text),
        _ => None,
    }
}

fn push(column: &mut Column, value: &Value) -> Option<()> {
    match column {
        Column::Number(cells) => cells.push(match value {
            Value::Null => f64::NAN,
            Value::Double(value) => *value,
            Value::Float(value) => f64::from(*value),
            _ => return None,
        }),
        Column::Integer(cells) => cells.push(whole(value)?),
        Column::Boolean(cells) => cells.push(match value {
            Value::Null => None,
            Value::Bool(value) => Some(*value),
            _ => return None,
        }),
        Column::Text(cells) => cells.push(match value {
            Value::Null => None,
            Value::Str(value) => Some(value.clone().into()),
            _ => return None,
        }),
    }
    Some(())
}

fn whole(value: &Value) -> Option<Option<i64>> {
    Some(match value {
        Value::Null => None,
        Value::Byte(value) => Some(i64::from(*value)),
        Value::Short(value) => Some(i64::from(*value)),
        Value::Int(value) => Some(i64::from(*value)),
        Value::Long(value) => Some(*value),
        Value::UByte(value) => Some(i64::from(*value)),
        Value::UShort(value) => Some(i64::from(*value)),
        Value::UInt(value) => Some(i64::from(*value)),
        Value::ULong(value) => Some(i64::try_from(*value).ok()?),
        _ => return None,
    })
}
