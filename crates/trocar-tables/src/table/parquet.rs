//! Tables as Parquet.

use std::borrow::Cow;
use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::Arc;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use parquet::basic::{
    Compression, ConvertedType, LogicalType, Repetition, Type as Physical, ZstdLevel,
};
use parquet::column::writer::ColumnWriter;
use parquet::data_type::ByteArray;
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::record::Field as Value;
use parquet::schema::types::{ColumnPath, Type, TypePtr};

use super::{Column, Field, Kind, Table, TableError};
use crate::output::AtomicFile;

/// Rows of a row group: the number buffered in memory, and what a reader can skip.
const ROW_GROUP: usize = 1 << 17;

/// Key under which Arrow readers look for their schema, with the metadata of fields.
const ARROW_SCHEMA: &str = "ARROW:schema";

pub(super) struct Writer {
    file: SerializedFileWriter<AtomicFile>,
    waiting: Vec<Column>,
}

impl Writer {
    pub(super) fn new(file: AtomicFile, fields: &[Field]) -> io::Result<Self> {
        let waiting = fields.iter().map(|field| Column::new(field.kind)).collect();
        let made =
            || SerializedFileWriter::new(file, schema(fields)?, Arc::new(properties(fields)?));
        Ok(Self { file: made().map_err(io_error)?, waiting })
    }

    pub(super) fn write(&mut self, columns: &[Column]) -> io::Result<()> {
        let rows = columns.first().map_or(0, Column::len);
        let mut from = 0;
        while from < rows {
            let room = ROW_GROUP - self.waiting.first().map_or(0, Column::len);
            let to = rows.min(from + room);
            for (all, more) in self.waiting.iter_mut().zip(columns) {
                all.extend(more, from, to);
            }
            from = to;
            if self.waiting.first().map_or(0, Column::len) == ROW_GROUP {
                self.row_group().map_err(io_error)?;
            }
        }
        Ok(())
    }

    pub(super) fn finish(mut self) -> io::Result<AtomicFile> {
        if self.waiting.first().is_some_and(|column| !column.is_empty()) {
            self.row_group().map_err(io_error)?;
        }
        self.file.into_inner().map_err(io_error)
    }

    fn row_group(&mut self) -> Result<(), ParquetError> {
        let mut group = self.file.next_row_group()?;
        for column in &mut self.waiting {
            write_column(&mut group, column)?;
            column.clear();
        }
        group.close().map(drop)
    }
}

fn schema(fields: &[Field]) -> Result<TypePtr, ParquetError> {
    let columns = fields
        .iter()
        .map(|field| {
            let (physical, logical) = match field.kind {
                Kind::Number => (Physical::DOUBLE, None),
                Kind::Integer => (Physical::INT64, None),
                Kind::Boolean => (Physical::BOOLEAN, None),
                Kind::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
            };
            let column = Type::primitive_type_builder(&field.name, physical)
                .with_repetition(Repetition::OPTIONAL);
            column.with_logical_type(logical).build().map(Arc::new)
        })
        .collect::<Result<_, _>>()?;
    Ok(Arc::new(Type::group_type_builder("schema").with_fields(columns).build()?))
}

/// The same columns give the same bytes: the file contains no version and no time.
fn properties(fields: &[Field]) -> Result<WriterProperties, ParquetError> {
    let mut properties = WriterProperties::builder()
        .set_created_by("trocar".to_owned())
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(1)?))
        .set_statistics_enabled(EnabledStatistics::Chunk)
        .set_offset_index_disabled(true)
        .set_key_value_metadata(Some(vec![KeyValue::new(
            ARROW_SCHEMA.to_owned(),
            arrow_schema(fields),
        )]))
        .set_dictionary_enabled(false);
    for field in fields.iter().filter(|field| field.kind == Kind::Text) {
        properties = properties
            .set_column_dictionary_enabled(ColumnPath::new(vec![field.name.clone()]), true);
    }
    Ok(properties.build())
}

/// The schema as Arrow readers expect it: a message of the stream format in base64.
fn arrow_schema(fields: &[Field]) -> String {
    let message = super::arrow::schema_message(&super::arrow::schema(fields));
    let mut framed = vec![0xff; 4];
    framed.extend_from_slice(&(message.len() as u32).to_le_bytes());
    framed.extend_from_slice(&message);
    STANDARD.encode(framed)
}

fn write_column(
    group: &mut SerializedRowGroupWriter<'_, AtomicFile>,
    cells: &Column,
) -> Result<(), ParquetError> {
    let Some(mut column) = group.next_column()? else { return Ok(()) };
    match (column.untyped(), cells) {
        (ColumnWriter::DoubleColumnWriter(writer), Column::Number(cells)) => {
            let levels: Vec<i16> = cells.iter().map(|cell| i16::from(!cell.is_nan())).collect();
            let missing = levels.contains(&0);
            let present: Cow<'_, [f64]> = match missing {
                true => cells.iter().copied().filter(|cell| !cell.is_nan()).collect(),
                false => cells.into(),
            };
            writer.write_batch(&present, Some(&levels), None)?;
        }
        (ColumnWriter::Int64ColumnWriter(writer), Column::Integer(cells)) => {
            let present: Vec<i64> = cells.iter().copied().flatten().collect();
            writer.write_batch(&present, Some(&levels(cells)), None)?;
        }
        (ColumnWriter::BoolColumnWriter(writer), Column::Boolean(cells)) => {
            let present: Vec<bool> = cells.iter().copied().flatten().collect();
            writer.write_batch(&present, Some(&levels(cells)), None)?;
        }
        (ColumnWriter::ByteArrayColumnWriter(writer), Column::Text(cells)) => {
            let bytes = |text: &Cow<'static, str>| ByteArray::from(text.as_bytes().to_vec());
            let present: Vec<ByteArray> = cells.iter().flatten().map(bytes).collect();
            writer.write_batch(&present, Some(&levels(cells)), None)?;
        }
        _ => return Err(ParquetError::General("a column of another kind than its field".into())),
    }
    column.close()
}

fn levels<T>(cells: &[Option<T>]) -> Vec<i16> {
    cells.iter().map(|cell| i16::from(cell.is_some())).collect()
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

pub(super) fn read(path: &Path) -> Result<Table, TableError> {
    let damaged = |error: ParquetError| TableError::Damaged {
        path: path.to_owned(),
        found: error.to_string(),
    };
    let reader = SerializedFileReader::new(
        File::open(path).map_err(|source| TableError::Open { path: path.to_owned(), source })?,
    )
    .map_err(damaged)?;
    let schema = reader.metadata().file_metadata().schema_descr_ptr();
    let mut table = Table::default();
    for field in schema.root_schema().get_fields() {
        table.columns.push(Column::new(kind(field).ok_or_else(|| TableError::Unread {
            path: path.to_owned(),
            column: field.name().to_owned(),
        })?));
        table.fields.push(field.name().to_owned());
    }
    for row in reader.get_row_iter(None).map_err(damaged)? {
        let row = row.map_err(damaged)?;
        for ((name, value), column) in row.get_column_iter().zip(&mut table.columns) {
            push(column, value).ok_or_else(|| TableError::Unread {
                path: path.to_owned(),
                column: name.clone(),
            })?;
        }
    }
    Ok(table)
}

/// Names of the columns of a Parquet file.
pub(super) fn names(path: &Path) -> Result<Vec<String>, TableError> {
    let reader = SerializedFileReader::new(
        File::open(path).map_err(|source| TableError::Open { path: path.to_owned(), source })?,
    )
    .map_err(|error| TableError::Damaged { path: path.to_owned(), found: error.to_string() })?;
    let schema = reader.metadata().file_metadata().schema_descr_ptr();
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
