//! `Recording`.

use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

use numpy::PyArray1;
use pyo3::exceptions::PyTypeError;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyAny, PySlice, PyTuple, PyType};
use trocar::option::{Interface, spelt};
use trocar::output::AtomicFile;
use trocar::recording::{
    Choice, Quality, Quantity, Readings, Recording as Record, TableColumn, TableColumns,
};
use trocar::report::recording::document;

use crate::arrays::column;
use crate::errors::{ArrayError, InternalError, ParameterError, Raise, in_python};
use crate::shared::{Picture, figures, finite};

/// One recording in SI units: time, position and force of an instrument in a seal.
///
/// Position grows on insertion; the force is that of the instrument on the seal. Arrays may be
/// anything that NumPy turns into numbers. What is lost or doubtful about the data is in
/// `warnings`, what was assumed in `notes`.
///
/// >>> same = trocar.Recording(recording.time_s, recording.position_m, recording.force_n)
/// >>> len(same) == len(recording)
/// True
#[pyclass(module = "trocar", frozen)]
pub(crate) struct Recording {
    record: Arc<Record>,
    columns: [PyOnceLock<Py<PyArray1<f64>>>; Quantity::ALL.len()],
}

impl Recording {
    pub(crate) fn new(record: Record) -> Self {
        Self {
            record: Arc::new(record),
            columns: [const { PyOnceLock::new() }; Quantity::ALL.len()],
        }
    }

    pub(crate) fn record(&self) -> &Record {
        &self.record
    }

    /// The samples in `range` as a recording of its own.
    fn part(&self, py: Python<'_>, range: Range<usize>) -> PyResult<Self> {
        let what = format!("samples {} to {}", range.start, range.end);
        let record = self.record.clone();
        Ok(Self::new(py.detach(|| record.part(range, &what)).map_err(Raise::raise)?))
    }

    /// A column as a read-only array, made when it is asked for first.
    fn column(&self, py: Python<'_>, place: usize, values: &[f64]) -> PyResult<Py<PyArray1<f64>>> {
        Ok(self.columns[place]
            .get_or_try_init(py, || {
                let array = PyArray1::from_slice(py, values);
                array.call_method1(intern!(py, "setflags"), (false,))?;
                Ok::<_, PyErr>(array.unbind())
            })?
            .clone_ref(py))
    }

    /// One of the recorded loads, likewise.
    fn load(&self, py: Python<'_>, load: usize) -> PyResult<Option<Py<PyArray1<f64>>>> {
        let values = self.record.loads[load].as_ref();
        values.map(|values| self.column(py, 6 + load, values)).transpose()
    }
}

/// Recordings as they are worked on: copies without single glitches of the position, as the command
/// line does it.
pub(crate) fn records(recordings: &[PyRef<'_, Recording>]) -> Vec<Record> {
    recordings.iter().map(|recording| recording.record().clone().without_glitches()).collect()
}

/// Columns in SI units become a recording.
fn recording_of(
    py: Python<'_>,
    name: String,
    mut readings: Readings,
    sensor_limit_n: Option<f64>,
    choice: Choice,
) -> PyResult<Record> {
    if choice.flip_force {
        readings.force.iter_mut().for_each(|force| *force = -*force);
    }
    let mut record = py
        .detach(|| Record::from_readings(name, &readings, sensor_limit_n))
        .map_err(Raise::raise)?;
    if choice.flip_force {
        record.quality.notes.push("sign of the force reversed".to_owned());
    }
    record.choice = choice;
    Ok(record)
}

/// `columns` as the library takes it: a text as it is, a mapping as `ours=theirs`.
pub(crate) fn columns_in_words(columns: &Bound<'_, PyAny>) -> PyResult<String> {
    let py = columns.py();
    py.import(intern!(py, "trocar._arrays"))?
        .call_method1(intern!(py, "columns_in_words"), (columns,))?
        .extract()
}

/// The columns of a data frame in SI units, found by their names or as `columns` says, and what was
/// assumed.
///
/// Where no column is the time, the frame's index is.
pub(crate) fn readings_of_frame(
    frame: &Bound<'_, PyAny>,
    name: &str,
    columns: Option<&str>,
) -> PyResult<(Readings, Vec<String>)> {
    let py = frame.py();
    let helpers = py.import(intern!(py, "trocar._arrays"))?;
    let table = helpers.call_method1(intern!(py, "table"), (frame,))?;
    let find = |table: &Bound<'_, PyAny>| {
        let described = helpers.call_method1(intern!(py, "described"), (table,))?;
        let (names, units, timestamps): (Vec<String>, Vec<String>, Vec<usize>) =
            described.extract()?;
        let found = TableColumns::find_with_units(name, &names, &units, &timestamps, columns);
        Ok::<_, PyErr>((names, found))
    };
    let (mut table, (mut names, mut found)) = (table.clone(), find(&table)?);
    let indexed = helpers.call_method1(intern!(py, "with_index"), (&table,))?;
    if found.is_err() && !indexed.is_none() {
        (names, found) = find(&indexed)?;
        table = indexed;
    }
    let found = found.map_err(Raise::raise)?;
    let series = |index: usize| helpers.call_method1(intern!(py, "series"), (&table, index));
    let values = |TableColumn { index, per_si }: TableColumn| -> PyResult<Vec<f64>> {
        Ok(column(&names[index], &series(index)?)?
            .as_slice()?
            .iter()
            .map(|value| value / per_si)
            .collect())
    };
    let times = |time: TableColumn| -> PyResult<Vec<f64>> {
        let seconds = helpers.call_method1(intern!(py, "seconds"), (series(time.index)?,))?;
        match seconds.is_none() {
            true => values(time),
            false => Ok(column(&names[time.index], &seconds)?.as_slice()?.to_vec()),
        }
    };
    let mut columns = Quantity::ALL.map(|_| None);
    for (quantity, of) in Quantity::ALL.into_iter().zip(found.columns) {
        columns[quantity as usize] = match (quantity, of) {
            (Quantity::Time, Some(time)) => Some(times(time)?),
            (_, of) => of.map(values).transpose()?,
        };
    }
    let readings = Readings::from(columns);
    Ok((readings, found.notes))
}

#[pymethods]
impl Recording {
    #[new]
    #[pyo3(signature = (time_s, position_m, force_n, velocity_m_s=None, *, angle_rad=None, torque_n_m=None, side_force_n=None, tilt_rad=None, pressure_pa=None, name="recording".to_owned(),
        sensor_limit_n=None, flip_force=false), text_signature = "(time_s, position_m, force_n, velocity_m_s=None, *, angle_rad=None, torque_n_m=None, side_force_n=None, tilt_rad=None, pressure_pa=None, name='recording', \
        sensor_limit_n=None, flip_force=False)")]
    #[allow(clippy::too_many_arguments)] // keywords in Python
    fn from_arrays(
        py: Python<'_>,
        time_s: &Bound<'_, PyAny>,
        position_m: &Bound<'_, PyAny>,
        force_n: &Bound<'_, PyAny>,
        velocity_m_s: Option<&Bound<'_, PyAny>>,
        angle_rad: Option<&Bound<'_, PyAny>>,
        torque_n_m: Option<&Bound<'_, PyAny>>,
        side_force_n: Option<&Bound<'_, PyAny>>,
        tilt_rad: Option<&Bound<'_, PyAny>>,
        pressure_pa: Option<&Bound<'_, PyAny>>,
        name: String,
        sensor_limit_n: Option<f64>,
        flip_force: bool,
    ) -> PyResult<Self> {
        let values = |name: &'static str, values: &Bound<'_, PyAny>| -> PyResult<Vec<f64>> {
            Ok(column(name, values)?.as_slice()?.to_vec())
        };
        let optional = |name: &'static str, own: Option<&Bound<'_, PyAny>>| {
            own.map(|own| values(name, own)).transpose()
        };
        let readings = Readings {
            time: values("time_s", time_s)?,
            position: values("position_m", position_m)?,
            force: values("force_n", force_n)?,
            velocity: optional("velocity_m_s", velocity_m_s)?,
            angle: optional("angle_rad", angle_rad)?,
            torque: optional("torque_n_m", torque_n_m)?,
            loads: [
                optional("side_force_n", side_force_n)?,
                optional("tilt_rad", tilt_rad)?,
                optional("pressure_pa", pressure_pa)?,
            ],
        };
        let choice = Choice { flip_force, ..Choice::default() };
        Ok(Self::new(recording_of(py, name, readings, sensor_limit_n, choice)?))
    }

    /// A recording from a pandas or polars data frame, an xarray data set, or a dictionary of
    /// columns.
    ///
    /// Columns are found by their names, units included, as in the header of a file: `time_s`,
    /// `Position (mm)`, `force_N`. `columns` says instead which they are, by our names:
    /// `{"position_mm": "pos", "force_n": "fz"}`, or in order, `-` skips one:
    /// `"time_s,position_mm,-,force_n"`. Times may be dates or durations, also those of the frame's
    /// index.
    #[classmethod]
    #[pyo3(signature = (frame, *, columns=None, name="frame".to_owned(), sensor_limit_n=None, flip_force=false),
        text_signature = "(frame, *, columns=None, name='frame', sensor_limit_n=None, flip_force=False)")]
    fn from_frame(
        _class: &Bound<'_, PyType>,
        frame: &Bound<'_, PyAny>,
        columns: Option<&Bound<'_, PyAny>>,
        name: String,
        sensor_limit_n: Option<f64>,
        flip_force: bool,
    ) -> PyResult<Self> {
        let py = frame.py();
        let columns = columns.map(columns_in_words).transpose()?;
        let (readings, notes) = readings_of_frame(frame, &name, columns.as_deref())?;
        let choice = Choice { columns, flip_force, ..Choice::default() };
        let mut record = recording_of(py, name, readings, sensor_limit_n, choice)?;
        record.quality.notes.extend(notes);
        Ok(Self::new(record))
    }

    /// Name of the recording: that of its file without the folder.
    #[getter]
    fn name(&self) -> &str {
        &self.record.name
    }

    /// SHA-256 of the file's bytes, or of the columns when there is no file.
    #[getter]
    fn sha256(&self) -> &str {
        &self.record.sha256
    }

    /// Time, s; a read-only array.
    #[getter]
    fn time_s(&self, py: Python<'_>) -> PyResult<Py<PyArray1<f64>>> {
        self.column(py, 0, &self.record.time)
    }

    /// Position, m, growing on insertion; a read-only array.
    #[getter]
    fn position_m(&self, py: Python<'_>) -> PyResult<Py<PyArray1<f64>>> {
        self.column(py, 1, &self.record.position)
    }

    /// Force of the instrument on the seal, N; a read-only array.
    #[getter]
    fn force_n(&self, py: Python<'_>) -> PyResult<Py<PyArray1<f64>>> {
        self.column(py, 2, &self.record.force)
    }

    /// Velocity, m/s, a read-only array; None if the recording has none.
    #[getter]
    fn velocity_m_s(&self, py: Python<'_>) -> PyResult<Option<Py<PyArray1<f64>>>> {
        self.record.velocity.as_ref().map(|velocity| self.column(py, 3, velocity)).transpose()
    }

    /// Angle of the instrument about its axis, rad, or None.
    #[getter]
    fn angle_rad(&self, py: Python<'_>) -> PyResult<Option<Py<PyArray1<f64>>>> {
        self.record.angle.as_ref().map(|angle| self.column(py, 4, angle)).transpose()
    }

    /// Torque of the instrument on the seal, N m, positive with the angle, or None.
    #[getter]
    fn torque_n_m(&self, py: Python<'_>) -> PyResult<Option<Py<PyArray1<f64>>>> {
        self.record.torque.as_ref().map(|torque| self.column(py, 5, torque)).transpose()
    }

    /// Force of the instrument on the wall of its cannula, N, or None.
    #[getter]
    fn side_force_n(&self, py: Python<'_>) -> PyResult<Option<Py<PyArray1<f64>>>> {
        self.load(py, 0)
    }

    /// Angle between the direction of insertion and straight down, rad, or None.
    #[getter]
    fn tilt_rad(&self, py: Python<'_>) -> PyResult<Option<Py<PyArray1<f64>>>> {
        self.load(py, 1)
    }

    /// Pressure of the gas above that of the room, Pa, or None.
    #[getter]
    fn pressure_pa(&self, py: Python<'_>) -> PyResult<Option<Py<PyArray1<f64>>>> {
        self.load(py, 2)
    }

    /// Time from the first to the last sample, s.
    #[getter]
    fn duration_s(&self) -> f64 {
        self.record.duration()
    }

    /// Range of the position, m.
    #[getter]
    fn stroke_m(&self) -> f64 {
        self.record.quality.stroke
    }

    /// Median interval between samples, s.
    #[getter]
    fn median_interval_s(&self) -> f64 {
        self.record.quality.median_interval
    }

    /// Everything lost or doubtful about the data.
    #[getter]
    fn warnings<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.record.quality.warnings.iter().map(in_python))
    }

    /// What was assumed, such as which columns were taken.
    #[getter]
    fn notes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.record.quality.notes.iter().map(in_python))
    }

    /// What was found about the data: sampling, resolution, noise, gaps, as in summary.json.
    #[getter]
    fn quality<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let text = spelt(&quality_json(&self.record.quality)?, Interface::Json);
        py.import("json")?.call_method1("loads", (text,))
    }

    /// The samples from `from_s` on and before `to_s`, s after the first sample, as a recording of
    /// its own.
    #[pyo3(signature = (from_s=None, to_s=None))]
    fn crop(&self, py: Python<'_>, from_s: Option<f64>, to_s: Option<f64>) -> PyResult<Self> {
        let time = &self.record.time;
        for (name, value) in [("from_s", from_s), ("to_s", to_s)] {
            finite(name, value.unwrap_or(0.0), "s")?;
        }
        let (from, to) = (from_s.unwrap_or(0.0), to_s.unwrap_or(f64::MAX));
        if from >= to {
            return Err(ParameterError::new_err(format!(
                "from_s is {from} s, expected less than to_s, {to} s"
            )));
        }
        let [first, end] =
            [from, to].map(|seconds| time.partition_point(|t| t - time[0] < seconds));
        self.part(py, first..end)
    }

    /// Some samples in a row, as in `recording[1000:5000]`, as a recording of its own; `crop` takes
    /// times.
    fn __getitem__(&self, py: Python<'_>, index: &Bound<'_, PyAny>) -> PyResult<Self> {
        let wrong = || {
            let text = "a recording is sliced by samples, as in recording[1000:5000]; columns are recording.force_n and so on, and \
                        recording.crop(from_s, to_s) takes times";
            PyTypeError::new_err(text)
        };
        let slice = index.cast::<PySlice>().map_err(|_| wrong())?;
        let length = isize::try_from(self.record.len())?;
        let indices = slice.indices(length).map_err(|_| wrong())?;
        if indices.step != 1 {
            let step = indices.step;
            let text =
                format!("step {step}: a recording keeps its sampling, expected samples in a row");
            return Err(ParameterError::new_err(text));
        }
        let from = usize::try_from(indices.start)?;
        self.part(py, from..from + indices.slicelength)
    }

    /// Force and position over time: matplotlib's axes, or a `Figure` (SVG) where matplotlib is not
    /// installed.
    ///
    /// `ax` are two axes to draw the force and the position into, or one for the force alone.
    #[pyo3(signature = (ax=None))]
    fn plot<'py>(
        slf: Bound<'py, Self>,
        ax: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let py = slf.py();
        py.import(intern!(py, "trocar._plot"))?.call_method1(intern!(py, "recording"), (slf, ax))
    }

    /// The same figure as SVG: name, title, caption, text.
    fn _figures(&self, py: Python<'_>) -> PyResult<Vec<Picture>> {
        let record = self.record.clone();
        figures(py, move || document(&record))
    }

    /// Writes the recording as CSV, in SI units; the file appears whole or not at all.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| {
            let mut file = AtomicFile::create(&path)?;
            self.record.write(&mut file).map_err(|source| file.write_error(source))?;
            file.commit()
        })
        .map_err(Raise::raise)
    }

    fn __len__(&self) -> usize {
        self.record.len()
    }

    fn __repr__(&self) -> String {
        let (name, samples, seconds) =
            (&self.record.name, self.record.len(), self.record.duration());
        let stroke = 1e3 * self.record.quality.stroke;
        let doubts = match self.record.quality.warnings.len() {
            0 => String::new(),
            1 => ", 1 warning".to_owned(),
            count => format!(", {count} warnings"),
        };
        format!(
            "<trocar.Recording {name:?}: {samples} samples, {seconds:.1} s, stroke {stroke:.1} mm{doubts}>"
        )
    }

    fn _repr_html_(slf: Bound<'_, Self>) -> PyResult<Bound<'_, PyAny>> {
        let py = slf.py();
        py.import(intern!(py, "trocar._show"))?.call_method1(intern!(py, "recording"), (slf,))
    }

    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let py = slf.py();
        let own = slf.get();
        let quality = quality_json(&own.record.quality)?;
        let columns =
            (own.time_s(py)?, own.position_m(py)?, own.force_n(py)?, own.velocity_m_s(py)?);
        let (name, sha256) = (own.name(), own.sha256());
        let (angle, torque) = (own.angle_rad(py)?, own.torque_n_m(py)?);
        let loads = [own.load(py, 0)?, own.load(py, 1)?, own.load(py, 2)?];
        let state = (
            columns.0, columns.1, columns.2, columns.3, name, sha256, quality, angle, torque, loads,
        );
        Ok((slf.get_type().getattr(intern!(py, "_restore"))?, state.into_pyobject(py)?))
    }

    /// What unpickling calls.
    #[staticmethod]
    #[allow(clippy::too_many_arguments)] // the columns of a pickle
    fn _restore(
        time_s: &Bound<'_, PyAny>,
        position_m: &Bound<'_, PyAny>,
        force_n: &Bound<'_, PyAny>,
        velocity_m_s: Option<&Bound<'_, PyAny>>,
        name: String,
        sha256: String,
        quality: &str,
        angle_rad: Option<&Bound<'_, PyAny>>,
        torque_n_m: Option<&Bound<'_, PyAny>>,
        loads: [Option<Bound<'_, PyAny>>; 3],
    ) -> PyResult<Self> {
        let py = time_s.py();
        let [side_force_n, tilt_rad, pressure_pa] = loads.each_ref().map(Option::as_ref);
        let mut own = Self::from_arrays(
            py,
            time_s,
            position_m,
            force_n,
            velocity_m_s,
            angle_rad,
            torque_n_m,
            side_force_n,
            tilt_rad,
            pressure_pa,
            name,
            None,
            false,
        )?;
        let length = column("time_s", time_s)?.as_slice()?.len();
        let quality: Quality = serde_json::from_str(quality)
            .map_err(|error| InternalError::new_err(error.to_string()))?;
        if own.record.len() != length || quality.breaks.iter().any(|at| *at >= length) {
            return Err(ArrayError::new_err(
                "the columns of a pickled recording do not belong together",
            ));
        }
        let record = Arc::make_mut(&mut own.record);
        (record.sha256, record.quality) = (sha256, quality);
        Ok(own)
    }
}

fn quality_json(quality: &Quality) -> PyResult<String> {
    serde_json::to_string(quality).map_err(|error| InternalError::new_err(error.to_string()))
}
