//! Arrays from Python: one that fits is read where it lies, anything else is converted by NumPy, or
//! refused.

use numpy::{
    BorrowError, PyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadwriteArray,
    PyReadwriteArray1, PyReadwriteArray2, PyUntypedArrayMethods, ndarray,
};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::PyAny;

use crate::errors::ArrayError;

/// The numbers of `values`, called `name` in messages: without a copy where they are contiguous
/// 64-bit floats.
pub(crate) fn column<'py>(
    name: &str,
    values: &Bound<'py, PyAny>,
) -> PyResult<PyReadonlyArray1<'py, f64>> {
    let py = values.py();
    let fits = values
        .cast::<PyArray1<f64>>()
        .ok()
        .filter(|array| array.is_contiguous() && array.is_aligned());
    // A masked array is an array whose numbers do not all count.
    if let Some(array) = fits
        && (array.is_exact_instance_of::<PyArray1<f64>>() || !array.hasattr(intern!(py, "mask"))?)
    {
        return borrow(name, array);
    }
    let converted = py
        .import(intern!(py, "trocar._arrays"))?
        .call_method1(intern!(py, "column"), (name, values))?;
    borrow(name, converted.cast::<PyArray1<f64>>()?)
}

fn borrow<'py>(
    name: &str,
    array: &Bound<'py, PyArray1<f64>>,
) -> PyResult<PyReadonlyArray1<'py, f64>> {
    array
        .try_readonly()
        .map_err(|_| ArrayError::new_err(format!("{name} is being written to by another call")))
}

/// A place for `length` results, called `out` in messages.
pub(crate) fn place<'py>(
    out: &Bound<'py, PyAny>,
    length: usize,
) -> PyResult<PyReadwriteArray1<'py, f64>> {
    let wanted = format!("{length} float64");
    let Ok(array) = out.cast::<PyArray1<f64>>() else { return Err(refused(&wanted, &kind(out)?)) };
    if array.len() != length {
        return Err(refused(&wanted, &array.len().to_string()));
    }
    writable(array, &wanted)
}

/// A place for `rows` rows of `length` results, one after the other.
pub(crate) fn rows<'py>(
    out: &Bound<'py, PyAny>,
    rows: usize,
    length: usize,
) -> PyResult<PyReadwriteArray2<'py, f64>> {
    let wanted = format!("float64 of shape ({rows}, {length})");
    match out.cast::<PyArray2<f64>>() {
        Ok(array) if array.shape() == [rows, length] => writable(array, &wanted),
        _ => Err(refused(&wanted, &kind(out)?)),
    }
}

fn writable<'py, D: ndarray::Dimension>(
    array: &Bound<'py, PyArray<f64, D>>,
    wanted: &str,
) -> PyResult<PyReadwriteArray<'py, f64, D>> {
    if !(array.is_c_contiguous() && array.is_aligned()) {
        return Err(refused(wanted, "one with gaps between its numbers"));
    }
    array.try_readwrite().map_err(|error| match error {
        BorrowError::NotWriteable => refused(wanted, "a read-only one"),
        _ => in_use(),
    })
}

/// Whether `out` lies apart from what is read, which two views of one buffer do not; asked before
/// either is touched.
pub(crate) fn apart<D: ndarray::Dimension>(
    out: &PyReadwriteArray<'_, f64, D>,
    read: &[&[f64]],
) -> PyResult<()> {
    let first = out.data().cast_const();
    let end = first.wrapping_add(out.len());
    let mut read = read.iter().map(|values| values.as_ptr_range());
    if read.any(|own| own.start < end && first < own.end) { Err(in_use()) } else { Ok(()) }
}

fn in_use() -> PyErr {
    ArrayError::new_err("out is in use, by another call or as an array that this one reads")
}

fn refused(wanted: &str, found: &str) -> PyErr {
    ArrayError::new_err(format!(
        "out must be a contiguous, writable NumPy array of {wanted}, got {found}"
    ))
}

/// What an argument is, in words.
fn kind(out: &Bound<'_, PyAny>) -> PyResult<String> {
    let py = out.py();
    py.import(intern!(py, "trocar._arrays"))?.call_method1(intern!(py, "kind"), (out,))?.extract()
}
