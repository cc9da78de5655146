//! `read`.

use std::path::PathBuf;

use pyo3::prelude::*;
use pyo3::types::PyAny;
use trocar::recording::{self, Choice, ReadOptions};
use trocar::summary::choice_for;

use crate::model::Model;
use crate::recording::{Recording, columns_in_words};
use crate::work::{How, attempt};

/// Reads a recording from a file of any format that `trocar inspect` lists.
///
/// Columns are found by their names, units included; `columns` says instead which they are, by our
/// names: `{"position_mm": "x", "force_n": "-fz"}` or `"position_mm=x,force_n=-fz"`, where `-`
/// reverses the sign and `22.2*U` scales, or in order, where `-` skips one: `"time_s,position_mm,-,force_n"`. `topics`
/// are the tables or topics to look in. Rows before `from_s` and from `to_s` on (s after the first
/// row) are left out. `flip_force` reverses the sign of the force; readings at `sensor_limit_n`
/// count as saturated. `skip_rows` lines at the beginning of a text are skipped, and `rate_hz` is
/// the number of rows per second of a file without a column of times. Without any of these, a file is
/// read as the recordings of the model `like` were, unless it lacks their columns.
///
/// >>> recording = trocar.read("strokes.csv")
/// >>> half = trocar.read("strokes.csv", columns={"force_n": "0.5*force_n", "position_m": "position_m", "time_s": "time_s"})
/// >>> bool(np.allclose(half.force_n, 0.5 * recording.force_n))
/// True
#[pyfunction]
#[pyo3(signature = (path, *, like=None, columns=None, topics=Vec::new(), from_s=None, to_s=None, flip_force=false,
    sensor_limit_n=None, skip_rows=0, rate_hz=None), text_signature = "(path, *, like=None, columns=None, topics=[], from_s=None, to_s=None, \
    flip_force=False, sensor_limit_n=None, skip_rows=0, rate_hz=None)")]
#[expect(clippy::too_many_arguments, reason = "keywords in Python")]
pub(crate) fn read(
    py: Python<'_>,
    path: PathBuf,
    like: Option<&Model>,
    columns: Option<&Bound<'_, PyAny>>,
    topics: Vec<String>,
    from_s: Option<f64>,
    to_s: Option<f64>,
    flip_force: bool,
    sensor_limit_n: Option<f64>,
    skip_rows: u64,
    rate_hz: Option<f64>,
) -> PyResult<Recording> {
    let columns = columns.map(columns_in_words).transpose()?;
    let choice = Choice {
        columns,
        topics,
        from: from_s,
        to: to_s,
        flip_force,
        skip_rows,
        rate_hz,
        ..Choice::default()
    };
    let choice = like.and_then(|model| choice_for(model.file(), &choice)).unwrap_or(choice);
    let options = ReadOptions { choice, sensor_limit: sensor_limit_n, ..ReadOptions::default() };
    let record = attempt(py, How::default(), move |_| recording::read(&path, &options))?;
    Ok(Recording::new(record))
}
