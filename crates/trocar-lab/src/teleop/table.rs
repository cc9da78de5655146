//! The course of a loop and its hybrid matrix as tables.

use std::path::Path;

use super::hybrid::Response;
use super::simulation::Sample;
use trocar_tables::error::OutputError;
use trocar_tables::table::{Field, TableCell, TableWriter};

/// A column of a table with a row for each `R`: its name with the unit, and its values.
type Column<R> = (&'static str, fn(&R) -> f64);

const RESPONSE_COLUMNS: [Column<Response>; 14] = [
    ("frequency_hz", |r| r.frequency_hz),
    ("h11_real_n_s_m", |r| r.hybrid.h11.re),
    ("h11_imaginary_n_s_m", |r| r.hybrid.h11.im),
    ("h12_real", |r| r.hybrid.h12.re),
    ("h12_imaginary", |r| r.hybrid.h12.im),
    ("h21_real", |r| r.hybrid.h21.re),
    ("h21_imaginary", |r| r.hybrid.h21.im),
    ("h22_real_m_n_s", |r| r.hybrid.h22.re),
    ("h22_imaginary_m_n_s", |r| r.hybrid.h22.im),
    ("llewellyn_margin", |r| r.llewellyn),
    ("tissue_real_n_s_m", |r| r.tissue.re),
    ("tissue_imaginary_n_s_m", |r| r.tissue.im),
    ("transmitted_real_n_s_m", |r| r.transmitted.re),
    ("transmitted_imaginary_n_s_m", |r| r.transmitted.im),
];

/// The columns of `rows`: names with their units, and values.
pub fn response_columns(rows: &[Response]) -> Vec<(&'static str, Vec<f64>)> {
    columns_of(rows, &RESPONSE_COLUMNS)
}

/// Writes `rows` as a table; the format follows from the file extension.
///
/// # Errors
/// A file that cannot be written.
pub fn write_response(rows: &[Response], path: impl AsRef<Path>) -> Result<(), OutputError> {
    write(rows, &RESPONSE_COLUMNS, path)
}

fn columns_of<R>(rows: &[R], columns: &[Column<R>]) -> Vec<(&'static str, Vec<f64>)> {
    columns.iter().map(|(name, of)| (*name, rows.iter().map(of).collect())).collect()
}

fn write<R>(rows: &[R], columns: &[Column<R>], path: impl AsRef<Path>) -> Result<(), OutputError> {
    let fields: Vec<Field> = columns.iter().map(|(name, _)| Field::number(*name)).collect();
    let mut table = TableWriter::create(path, &fields)?;
    for row in rows {
        let cells: Vec<TableCell> =
            columns.iter().map(|(_, of)| TableCell::Number(of(row))).collect();
        table.row(&cells)?;
    }
    table.commit()
}

const COLUMNS: [Column<Sample>; 12] = [
    ("time_s", |s| s.time),
    ("hand_position_m", |s| s.hand_position),
    ("leader_position_m", |s| s.leader_position),
    ("follower_position_m", |s| s.follower_position),
    ("operator_force_n", |s| s.operator_force),
    ("leader_force_n", |s| s.leader_force),
    ("follower_force_n", |s| s.follower_force),
    ("trocar_force_n", |s| s.trocar_force),
    ("tissue_force_n", |s| s.tissue_force),
    ("estimate_n", |s| s.estimate),
    ("network_energy_j", |s| s.network_energies().iter().sum()),
    ("credit_j", |s| s.credit),
];

/// The columns of `samples`: names with their units, and values.
pub fn course_columns(samples: &[Sample]) -> Vec<(&'static str, Vec<f64>)> {
    columns_of(samples, &COLUMNS)
}

/// Writes `samples` as a table, one row each; the format follows from the file extension.
///
/// # Errors
/// A file that cannot be written.
pub fn write_course(samples: &[Sample], path: impl AsRef<Path>) -> Result<(), OutputError> {
    write(samples, &COLUMNS, path)
}
