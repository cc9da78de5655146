//! Arrays from Python: one that fits is read where it lies, anything else is converted by NumPy, or refused.

use numpy::{BorrowError, PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadwriteArray1, PyUntypedArrayMethods};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::PyAny;

use crate::errors::ArrayError;

/// The numbers of `values`, called `name` in messages: without a copy where they are contiguous 64-bit floats.
pub(crate) fn column<'py>(name: &str, values: &Bound<'py, PyAny>) -> PyResult<PyReadonlyArray1<'py, f64>> {
    let fits = values.cast::<PyArray1<f64>>().ok().filter(|array| array.is_contiguous() && array.is_aligned());
    if let Some(array) = fits {
        return borrow(name, array);
    }
    let py = values.py();
    let converted = py.import(intern!(py, "trocar._arrays"))?.call_method1(intern!(py, "column"), (name, values))?;
    borrow(name, converted.cast::<PyArray1<f64>>()?)
}

fn borrow<'py>(name: &str, array: &Bound<'py, PyArray1<f64>>) -> PyResult<PyReadonlyArray1<'py, f64>> {
    array.try_readonly().map_err(|_| ArrayError::new_err(format!("{name} is being written to by another call")))
}

/// A place for `length` results, called `out` in messages.
pub(crate) fn place<'py>(out: &Bound<'py, PyAny>, length: usize) -> PyResult<PyReadwriteArray1<'py, f64>> {
    let refuse = |found: String| {
        ArrayError::new_err(format!("out must be a contiguous, writable NumPy array of {length} float64, got {found}"))
    };
    let Ok(array) = out.cast::<PyArray1<f64>>() else {
        let py = out.py();
        let kind = py.import(intern!(py, "trocar._arrays"))?.call_method1(intern!(py, "kind"), (out,))?;
        return Err(refuse(kind.extract()?));
    };
    if array.len() != length {
        return Err(refuse(format!("{}", array.len())));
    }
    if !(array.is_contiguous() && array.is_aligned()) {
        return Err(refuse("one with gaps between its numbers".to_owned()));
    }
    array.try_readwrite().map_err(|error| match error {
        BorrowError::NotWriteable => refuse("a read-only one".to_owned()),
        _ => ArrayError::new_err("out is in use, by another call or as time_s or position_m of this one"),
    })
}
