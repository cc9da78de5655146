//! `compensate`, and `Compensator` for live samples.

use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyAny, PyDict};
use serde_json::json;
use trocar::compensate::{
    CompensateOptions, Compensator as Observer, Drift, Estimate, Fault, MOST_DRAWS,
};
use trocar::many::evenly;

use crate::arrays::column;
use crate::errors::{ArrayError, MotionError, ParameterError, Raise};
use crate::keys::{changed, given};
use crate::model::{Model, given_model};
use crate::posterior::Draws;
use crate::shared::beside_times;
use crate::simulate::goes_back;
use crate::work::in_chunks;

/// Samples between two looks at the signals: some milliseconds of work.
const CHUNK: usize = 1 << 15;

/// Estimate of the observer for one sample; it can be pickled.
///
/// >>> now = trocar.Compensator(found.model).step(position_m=0.05, force_n=3.1, duration_s=1e-3)
/// >>> now.tissue_force_n + now.trocar_force_n < 4.0
/// True
#[pyclass(module = "trocar", frozen, get_all)]
pub(crate) struct TissueForce {
    /// Force of the instrument on seal and trocar, N.
    trocar_force_n: f64,
    /// Torque of the instrument on the seal, N·m; 0 for a model without rotation.
    torque_n_m: f64,
    /// Force of the instrument on the tissue, N; nan where the reading does not determine it.
    tissue_force_n: f64,
    /// Standard deviation of both, N.
    std_n: f64,
    /// Whether friction and viscosity are being followed.
    adapting: bool,
    /// What cannot be right about the sample, such as "saturated"; None if nothing.
    fault: Option<&'static str>,
}

#[pymethods]
impl TissueForce {
    fn _repr_html_(slf: Bound<'_, Self>) -> PyResult<Bound<'_, PyAny>> {
        let py = slf.py();
        py.import(intern!(py, "trocar._show"))?.call_method1(intern!(py, "fields"), (slf,))
    }

    fn __repr__(&self) -> String {
        let Self { tissue_force_n, trocar_force_n, std_n, fault, .. } = self;
        let fault = fault.map(|fault| format!(", {fault}")).unwrap_or_default();
        format!(
            "<trocar.TissueForce {tissue_force_n:.4} N ± {std_n:.4} N, trocar {trocar_force_n:.4} N{fault}>"
        )
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let (py, own) = (slf.py(), slf.get());
        let forces = (own.trocar_force_n, own.tissue_force_n, own.std_n);
        let fields = (forces.0, forces.1, forces.2, own.adapting, own.fault, own.torque_n_m);
        let restore = slf.get_type().getattr(intern!(py, "_restore"))?;
        Ok((restore, fields.into_pyobject(py)?.into_any()))
    }

    /// What unpickling calls.
    #[staticmethod]
    fn _restore(
        trocar_force_n: f64,
        tissue_force_n: f64,
        std_n: f64,
        adapting: bool,
        fault: Option<&str>,
        torque_n_m: f64,
    ) -> PyResult<Self> {
        let fault = fault.map(|given| {
            let known = Fault::ALL.into_iter().map(name).find(|known| *known == given);
            known.ok_or_else(|| ArrayError::new_err(format!("{given:?} is no fault of a sample")))
        });
        let fault = fault.transpose()?;
        Ok(Self { trocar_force_n, torque_n_m, tissue_force_n, std_n, adapting, fault })
    }
}

fn name(fault: Fault) -> &'static str {
    match fault {
        Fault::NoReading => "no_reading",
        Fault::NoPosition => "no_position",
        Fault::NoDuration => "no_duration",
        Fault::Saturated => "saturated",
        Fault::Frozen => "frozen",
        Fault::Jump => "jump",
        Fault::Gap => "gap",
        Fault::OppositeSign => "opposite_sign",
    }
}

/// Takes the force of the trocar out of live readings, sample by sample, without looking ahead.
///
/// Whatever is None comes from the model. Readings have the sign that the sensor gives them: where
/// the recordings of the model were read with the sign reversed, the observer reverses the readings
/// too; `flip_force=False` is for readings that have the sign of the model already. A step never fails: what cannot be right about a sample
/// is named in its `fault`. Compensators can be copied and pickled; the copy goes on from the same
/// state.
///
/// >>> observer = trocar.Compensator(found.model)
/// >>> observer.step(position_m=0.05, force_n=3.1, duration_s=1e-3).fault is None
/// True
#[pyclass(module = "trocar")]
pub(crate) struct Compensator {
    model: Py<Model>,
    options: CompensateOptions,
    /// The posterior whose draws the observer has.
    posterior: Option<Py<PyAny>>,
    observer: Observer,
    /// Of the last sample, s.
    time: Option<f64>,
}

#[pymethods]
impl Compensator {
    #[new]
    #[pyo3(signature = (model, *, posterior=None, **options), text_signature = "(model, *, offset_n=None, \
        flip_force=None, moving_mass_kg=None, gravity_m_s2=0.0, sensor_limit_n=None, force_error_n=None, adaptation=True, \
        posterior=None)")]
    fn new(
        model: &Bound<'_, Model>,
        posterior: Option<&Bound<'_, PyAny>>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let options = options.map(given).transpose()?.unwrap_or_default();
        Self::of(model, options, posterior)
    }

    /// Takes the next sample, `duration_s` after the last one; the first one starts, whatever its
    /// duration. Without `angle_rad` the instrument does not turn.
    #[pyo3(signature = (position_m, force_n, duration_s, angle_rad=None))]
    fn step(
        &mut self,
        position_m: f64,
        force_n: f64,
        duration_s: f64,
        angle_rad: Option<f64>,
    ) -> TissueForce {
        let estimate = match angle_rad {
            Some(angle) => self.observer.turn(position_m, angle, force_n, duration_s),
            None => self.observer.step(position_m, force_n, duration_s),
        };
        self.time = Some(
            self.time.unwrap_or(0.0)
                + if duration_s > 0.0 && duration_s.is_finite() { duration_s } else { 0.0 },
        );
        TissueForce {
            trocar_force_n: estimate.trocar_force,
            torque_n_m: estimate.trocar_torque,
            tissue_force_n: estimate.tissue_force,
            std_n: estimate.std,
            adapting: estimate.adapting,
            fault: estimate.fault.map(name),
        }
    }

    /// Takes many samples; times are those of a clock that goes on from call to call.
    ///
    /// Gives a `Compensation`. Positions and readings may be nan: that is a fault of the sample,
    /// not an error. Without `angle_rad` the instrument does not turn.
    #[pyo3(signature = (time_s, position_m, force_n, angle_rad=None))]
    fn run<'py>(
        &mut self,
        py: Python<'py>,
        time_s: &Bound<'py, PyAny>,
        position_m: &Bound<'py, PyAny>,
        force_n: &Bound<'py, PyAny>,
        angle_rad: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let columns = [
            column("time_s", time_s)?,
            column("position_m", position_m)?,
            column("force_n", force_n)?,
        ];
        let angle = angle_rad.map(|angle| column("angle_rad", angle)).transpose()?;
        let (estimates, time) = along(py, &mut self.observer, self.time, &columns, angle)?;
        self.time = time;
        let result =
            py.import(intern!(py, "trocar.results"))?.getattr(intern!(py, "Compensation"))?;
        let [time, position, force] = columns;
        result.call_method1(
            intern!(py, "_of"),
            ((&*time, &*position, &*force), estimates, self.drift()),
        )
    }

    /// Friction and viscosity over those of the model, with standard deviations: (level, level_std,
    /// viscosity, viscosity_std).
    #[getter]
    fn drift(&self) -> (f64, f64, f64, f64) {
        numbers(self.observer.drift())
    }

    /// Whether the last pair of strokes indicated contact with tissue.
    #[getter]
    fn is_in_contact(&self) -> bool {
        self.observer.is_in_contact()
    }

    /// The model.
    #[getter]
    fn model(&self, py: Python<'_>) -> Py<Model> {
        self.model.clone_ref(py)
    }

    fn __copy__(&self, py: Python<'_>) -> Self {
        Self {
            model: self.model.clone_ref(py),
            options: self.options.clone(),
            posterior: self.posterior.as_ref().map(|posterior| posterior.clone_ref(py)),
            observer: self.observer.clone(),
            time: self.time,
        }
    }

    fn __deepcopy__(&self, py: Python<'_>, _memo: &Bound<'_, PyDict>) -> Self {
        // The model does not change, so it is shared.
        self.__copy__(py)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let py = slf.py();
        let own = slf.borrow();
        let options = json!(own.options).to_string();
        let numbers = PyArray1::from_vec(py, own.observer.state());
        let posterior = own.posterior.as_ref().map(|posterior| posterior.clone_ref(py));
        let state = (own.model(py), options, numbers, own.time, posterior);
        let state = state.into_pyobject(py)?.into_any();
        Ok((slf.get_type().getattr(intern!(py, "_restore"))?, state))
    }

    /// What unpickling calls.
    #[staticmethod]
    fn _restore(
        model: &Bound<'_, Model>,
        options: &str,
        state: &Bound<'_, PyAny>,
        time_s: Option<f64>,
        posterior: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let options = changed(CompensateOptions::default(), options, ParameterError::new_err)?;
        let mut own = Self::of(model, options, posterior)?;
        own.observer.set_state(column("state", state)?.as_slice()?).map_err(Raise::raise)?;
        own.time = time_s;
        Ok(own)
    }

    fn __repr__(&self) -> String {
        let Drift { level, viscosity, .. } = self.observer.drift();
        format!(
            "<trocar.Compensator: friction {level:.3}, viscosity {viscosity:.3} of the model's>"
        )
    }
}

impl Compensator {
    fn of(
        model: &Bound<'_, Model>,
        options: CompensateOptions,
        posterior: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let (observer, posterior) = observer(model.get(), &options, posterior)?;
        Ok(Self { model: model.clone().unbind(), options, posterior, observer, time: None })
    }
}

/// An observer with the draws of `posterior`, and these as a `trocar.Posterior`.
fn observer(
    model: &Model,
    options: &CompensateOptions,
    posterior: Option<&Bound<'_, PyAny>>,
) -> PyResult<(Observer, Option<Py<PyAny>>)> {
    let observer = Observer::new(model.file(), options).map_err(Raise::raise)?;
    let Some(given) = posterior else { return Ok((observer, None)) };
    let Draws { posterior, models } = Draws::of(given)?;
    let observer = observer.with_draws(&evenly(&models, MOST_DRAWS)).map_err(Raise::raise)?;
    Ok((observer, Some(posterior)))
}

/// Trocar force, tissue force, standard deviation, adapting, fault (place in `faults`, -1 for
/// none), and of a model with rotation the torque.
type Estimates<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<i8>>,
    Option<Bound<'py, PyArray1<f64>>>,
);

/// Names of the faults, and what they mean.
#[pyfunction]
pub(crate) fn faults() -> Vec<(&'static str, &'static str)> {
    Fault::ALL.map(|fault| (name(fault), fault.words())).to_vec()
}

/// Takes the force of the trocar out of a whole recording; `trocar.compensate` wraps it.
#[pyfunction]
#[pyo3(signature = (model, time_s, position_m, force_n, *, angle_rad, posterior, **options))]
#[allow(clippy::too_many_arguments)] // keywords in Python
pub(crate) fn compensate<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = given_model)] model: Bound<'py, Model>,
    time_s: &Bound<'py, PyAny>,
    position_m: &Bound<'py, PyAny>,
    force_n: &Bound<'py, PyAny>,
    angle_rad: Option<&Bound<'py, PyAny>>,
    posterior: Option<&Bound<'py, PyAny>>,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<(Estimates<'py>, (f64, f64, f64, f64))> {
    let options = options.map(given).transpose()?.unwrap_or_default();
    let (mut observer, _) = observer(model.get(), &options, posterior)?;
    let columns =
        [column("time_s", time_s)?, column("position_m", position_m)?, column("force_n", force_n)?];
    let angle = angle_rad.map(|angle| column("angle_rad", angle)).transpose()?;
    let (estimates, _) = along(py, &mut observer, None, &columns, angle)?;
    Ok((estimates, numbers(observer.drift())))
}

fn numbers(drift: Drift) -> (f64, f64, f64, f64) {
    (drift.level, drift.level_std, drift.viscosity, drift.viscosity_std)
}

/// Runs the observer along arrays; also the last time, s.
fn along<'py>(
    py: Python<'py>,
    observer: &mut Observer,
    mut before: Option<f64>,
    [time, position, force]: &[PyReadonlyArray1<'py, f64>; 3],
    angle: Option<PyReadonlyArray1<'py, f64>>,
) -> PyResult<(Estimates<'py>, Option<f64>)> {
    let (time, position, force) = (time.as_slice()?, position.as_slice()?, force.as_slice()?);
    let angle = angle.as_ref().map(|angle| angle.as_slice()).transpose()?;
    let angles = angle.map_or(time.len(), <[f64]>::len);
    for (name, length) in
        [("position_m", position.len()), ("force_n", force.len()), ("angle_rad", angles)]
    {
        beside_times(name, length, time.len())?;
    }
    check(time, before)?;
    let mut estimates: Vec<Estimate> = Vec::with_capacity(time.len());
    in_chunks(py, time.len(), CHUNK, |range| {
        for i in range {
            let duration = before.map_or(0.0, |before| time[i] - before);
            estimates.push(match angle {
                Some(angle) => observer.turn(position[i], angle[i], force[i], duration),
                None => observer.step(position[i], force[i], duration),
            });
            before = Some(time[i]);
        }
    })?;
    let numbers = |of: fn(&Estimate) -> f64| PyArray1::from_iter(py, estimates.iter().map(of));
    let faults = estimates.iter().map(|estimate| estimate.fault.map_or(-1, |fault| fault as i8));
    let arrays = (
        numbers(|estimate| estimate.trocar_force),
        numbers(|estimate| estimate.tissue_force),
        numbers(|estimate| estimate.std),
        PyArray1::from_iter(py, estimates.iter().map(|estimate| estimate.adapting)),
        PyArray1::from_iter(py, faults),
        observer.turns().then(|| numbers(|estimate| estimate.trocar_torque)),
    );
    Ok((arrays, before))
}

/// Refuses a clock that is none; a time that stands still is a fault of its sample.
fn check(time: &[f64], before: Option<f64>) -> PyResult<()> {
    let mut last = before;
    for (i, &t) in time.iter().enumerate() {
        if !t.is_finite() {
            return Err(MotionError::new_err(format!(
                "sample {i}: time_s is {t} s, expected a finite number"
            )));
        }
        if let Some(from) = last.filter(|from| t < *from) {
            return Err(MotionError::new_err(goes_back(i, from, t)));
        }
        last = Some(t);
    }
    Ok(())
}
