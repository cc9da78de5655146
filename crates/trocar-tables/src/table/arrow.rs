//! Tables as Arrow files (Feather version 2).

use std::io;
use std::sync::Arc;

use arrow_array::{ArrayRef, BooleanArray, Float64Array, Int64Array, RecordBatch, StringArray};
use arrow_ipc::CompressionType;
use arrow_ipc::writer::{FileWriter, IpcWriteOptions};
use arrow_schema::{ArrowError, DataType, Metadata, Schema, SchemaRef};

use super::{Column, Field, Kind};
use crate::output::AtomicFile;

pub(super) struct Writer {
    file: FileWriter<AtomicFile>,
    schema: SchemaRef,
}

impl Writer {
    pub(super) fn new(file: AtomicFile, fields: &[Field]) -> io::Result<Self> {
        let schema = Arc::new(schema(fields));
        let made = || {
            let options = IpcWriteOptions::default()
                .try_with_compression(Some(CompressionType::LZ4_FRAME))?;
            FileWriter::try_new_with_options(file, &schema, options)
        };
        Ok(Self { file: made().map_err(io_error)?, schema })
    }

    pub(super) fn write(&mut self, columns: &[Column]) -> io::Result<()> {
        if columns.first().is_none_or(Column::is_empty) {
            return Ok(());
        }
        let batch = batch(&self.schema, columns)?;
        self.file.write(&batch).map_err(io_error)
    }

    pub(super) fn finish(mut self) -> io::Result<AtomicFile> {
        self.file.finish().and_then(|()| self.file.into_inner()).map_err(io_error)
    }
}

pub(super) fn schema(fields: &[Field]) -> Schema {
    Schema::new(fields.iter().map(nullable).collect::<Vec<_>>())
}

fn nullable(field: &Field) -> arrow_schema::Field {
    let kind = match field.kind {
        Kind::Number => DataType::Float64,
        Kind::Integer => DataType::Int64,
        Kind::Boolean => DataType::Boolean,
        Kind::Text => DataType::Utf8,
    };
    let unit = field.unit().map(|unit| ("unit".to_owned(), unit.to_owned()));
    arrow_schema::Field::new(&field.name, kind, true)
        .with_metadata(unit.into_iter().collect::<Metadata>())
}

/// The columns of a table as a batch of its schema.
pub(super) fn batch(schema: &SchemaRef, columns: &[Column]) -> io::Result<RecordBatch> {
    let arrays = columns.iter().map(array).collect();
    RecordBatch::try_new(schema.clone(), arrays).map_err(io_error)
}

fn array(column: &Column) -> ArrayRef {
    match column {
        Column::Number(cells) => Arc::new(
            cells
                .iter()
                .map(|cell| Some(*cell).filter(|cell| !cell.is_nan()))
                .collect::<Float64Array>(),
        ),
        Column::Integer(cells) => Arc::new(cells.iter().copied().collect::<Int64Array>()),
        Column::Boolean(cells) => Arc::new(cells.iter().copied().collect::<BooleanArray>()),
        Column::Text(cells) => {
            Arc::new(cells.iter().map(Option::as_deref).collect::<StringArray>())
        }
    }
}

/// The error of the operating system, if it caused this one.
fn io_error(error: ArrowError) -> io::Error {
    match error {
        ArrowError::IoError(_, source) => source,
        other => io::Error::other(other),
    }
}
