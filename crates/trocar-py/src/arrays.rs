//! Arrays from Python: one that fits is read where it lies, anything else is converted by NumPy, or
//! refused.

use numpy::{
    BorrowError, PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArray1, PyReadwriteArrayDyn,
    PyUntypedArrayMethods,
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

/// A place for results of this shape, called `out` in messages.
pub(crate) fn place<'py>(
    out: &Bound<'py, PyAny>,
    shape: &[usize],
) -> PyResult<PyReadwriteArrayDyn<'py, f64>> {
    let wanted = match shape {
        [length] => format!("{length} float64"),
        _ => {
            let lengths: Vec<String> = shape.iter().map(usize::to_string).collect();
            format!("float64 of shape ({})", lengths.join(", "))
        }
    };
    let refused = |found: &str| {
        ArrayError::new_err(format!(
            "out must be a contiguous, writable NumPy array of {wanted}, got {found}"
        ))
    };
    let array = match out.cast::<PyArrayDyn<f64>>() {
        Ok(array) if array.shape() == shape => array,
        Ok(array) if array.ndim() == 1 && shape.len() == 1 => {
            return Err(refused(&array.len().to_string()));
        }
        _ => return Err(refused(&kind(out)?)),
    };
    if !(array.is_c_contiguous() && array.is_aligned()) {
        return Err(refused("one with gaps between its numbers"));
    }
    array.try_readwrite().map_err(|error| match error {
        BorrowError::NotWriteable => refused("a read-only one"),
        _ => in_use(),
    })
}

/// Whether `out` lies apart from what is read, which two views of one buffer do not; asked before
/// either is touched.
pub(crate) fn apart(out: &PyReadwriteArrayDyn<'_, f64>, read: &[&[f64]]) -> PyResult<()> {
    let first = out.data().cast_const();
    let end = first.wrapping_add(out.len());
    let mut read = read.iter().map(|values| values.as_ptr_range());
    if read.any(|own| own.start < end && first < own.end) { Err(in_use()) } else { Ok(()) }
}

fn in_use() -> PyErr {
    ArrayError::new_err("out is in use, by another call or as an array that this one reads")
}

/// What an argument is, in words.
fn kind(out: &Bound<'_, PyAny>) -> PyResult<String> {
    let py = out.py();
    py.import(intern!(py, "trocar._arrays"))?.call_method1(intern!(py, "kind"), (out,))?.extract()
}
