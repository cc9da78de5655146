//! `Stepper`: a model and its state, one step at a time.

use numpy::PyArray1;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyAny, PyDict};
use trocar_model::flat::STATE_NUMBERS;
use trocar_model::{Mode, TrocarState};

use crate::arrays::column;
use crate::errors::number;
use crate::errors::{ArrayError, MotionError};
use crate::model::Model;
use crate::shared::finite;

/// A model under way: feed it displacements or positions as they come, and it gives the force.
///
/// Begins at rest at `position_m`, undeformed, or with `initial_force_n`. A step that is refused
/// leaves the state as it was. Steppers can be copied and pickled; the copy goes on from the same
/// state.
///
/// >>> seal = trocar.Stepper(model)
/// >>> for _ in range(400):  # 20 mm in 0.4 s
/// ...     force_n = seal.step(displacement_m=50e-6, duration_s=1e-3)
/// >>> round(force_n, 2), seal.mode
/// (3.25, 'sliding')
#[pyclass(module = "trocar")]
pub(crate) struct Stepper {
    model: Py<Model>,
    state: TrocarState,
}

#[pymethods]
impl Stepper {
    #[new]
    #[pyo3(signature = (model, position_m=0.0, *, initial_force_n=None))]
    fn new(
        model: &Bound<'_, Model>,
        position_m: f64,
        initial_force_n: Option<f64>,
    ) -> PyResult<Self> {
        finite("position_m", position_m, "m")?;
        let trocar = model.get().trocar();
        let state = match initial_force_n {
            None => trocar.rest(position_m),
            Some(force) => {
                finite("initial_force_n", force, "N")?;
                trocar.rest_at_force(position_m, force)
            }
        };
        Ok(Self { model: model.clone().unbind(), state })
    }

    /// Moves by `displacement_m` within `duration_s` at constant velocity; returns the force at the
    /// end, N.
    fn step(&mut self, displacement_m: f64, duration_s: f64) -> PyResult<f64> {
        check("displacement_m", displacement_m, displacement_m, duration_s)?;
        finite("position_m", self.state.position() + displacement_m, "m")?;
        Ok(self.model.get().trocar().step(&mut self.state, displacement_m, duration_s))
    }

    /// Moves to `position_m` within `duration_s` at constant velocity; returns the force at the
    /// end, N.
    fn step_to(&mut self, position_m: f64, duration_s: f64) -> PyResult<f64> {
        check("position_m", position_m, position_m - self.state.position(), duration_s)?;
        Ok(self.model.get().trocar().step_to(&mut self.state, position_m, duration_s))
    }

    /// Moves to `position_m` and turns to `angle_rad` (0 at the beginning) within `duration_s`, both
    /// at constant velocity; returns the force at the end, N. The torque is then `torque_n_m`.
    fn turn_to(&mut self, position_m: f64, angle_rad: f64, duration_s: f64) -> PyResult<f64> {
        check("position_m", position_m, position_m - self.state.position(), duration_s)?;
        let Some(turning) = self.state.turning() else {
            return Err(MotionError::new_err(
                "the model knows the axis only\n\nhint: a model with 'rotation' in its model.json can turn",
            ));
        };
        check("angle_rad", angle_rad, angle_rad - turning.angle(), duration_s)?;
        Ok(self.model.get().trocar().turn_to(&mut self.state, position_m, angle_rad, duration_s))
    }

    /// The model.
    #[getter]
    fn model(&self, py: Python<'_>) -> Py<Model> {
        self.model.clone_ref(py)
    }

    /// Force after the last step, N: that of the instrument on the seal.
    #[getter]
    fn force_n(&self) -> f64 {
        self.state.force()
    }

    /// Torque after the last step, N·m: that of the instrument on the seal; 0 for a model without
    /// rotation.
    #[getter]
    fn torque_n_m(&self) -> f64 {
        self.state.torque()
    }

    /// Where the instrument is, m.
    #[getter]
    fn position_m(&self) -> f64 {
        self.state.position()
    }

    /// Deflection of the seal, m, the mean of several elements; None for a classical model.
    #[getter]
    fn deflection_m(&self) -> Option<f64> {
        self.state.deformation().map(|deformation| deformation.deflection)
    }

    /// "deforming" or "sliding"; None for a classical model, which has no mode.
    #[getter]
    fn mode(&self) -> Option<&'static str> {
        self.state.deformation().map(|deformation| match deformation.mode {
            Mode::Deforming => "deforming",
            Mode::Sliding => "sliding",
        })
    }

    /// Everything that changes, as an array of numbers; setting it goes back to that state.
    #[getter]
    fn state<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.state.to_numbers())
    }

    #[setter]
    fn set_state(&mut self, state: &Bound<'_, PyAny>) -> PyResult<()> {
        let numbers = column("state", state)?;
        let numbers = numbers.as_slice()?;
        if numbers.len() != STATE_NUMBERS {
            let found = numbers.len();
            return Err(ArrayError::new_err(format!(
                "state has {found} numbers, expected {STATE_NUMBERS}"
            )));
        }
        let read = self.model.get().trocar().state_from_numbers(numbers);
        self.state = read.map_err(|error| {
            ArrayError::new_err(format!("the state does not belong to this model: {error}"))
        })?;
        Ok(())
    }

    fn __repr__(&self) -> String {
        let (position, force) = (1e3 * self.state.position(), self.state.force());
        let mode = self.mode().map(|mode| format!(", {mode}")).unwrap_or_default();
        format!("<trocar.Stepper at {position:.3} mm, {force:.4} N{mode}>")
    }

    fn __copy__(&self, py: Python<'_>) -> Self {
        Self { model: self.model.clone_ref(py), state: self.state }
    }

    fn __deepcopy__(&self, py: Python<'_>, _memo: &Bound<'_, PyDict>) -> Self {
        // The model does not change, so it is shared.
        self.__copy__(py)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let py = slf.py();
        let own = slf.borrow();
        let state = (own.model(py), own.state(py)).into_pyobject(py)?.into_any();
        Ok((slf.get_type().getattr(intern!(py, "_restore"))?, state))
    }

    /// What unpickling calls.
    #[staticmethod]
    fn _restore(model: &Bound<'_, Model>, state: &Bound<'_, PyAny>) -> PyResult<Self> {
        let mut own = Self::new(model, 0.0, None)?;
        own.set_state(state)?;
        Ok(own)
    }
}

/// Refuses what the model would ignore.
fn check(name: &str, given: f64, displacement: f64, duration: f64) -> PyResult<()> {
    let unit = if name == "angle_rad" { "rad" } else { "m" };
    let problem = if !given.is_finite() {
        format!("{name} must be finite, got {} {unit}", number(given))
    } else if !(duration.is_finite() && duration > 0.0) {
        format!("duration_s must be positive and finite, got {} s", number(duration))
    } else if !(displacement / duration).is_finite() {
        let (displacement, duration) = (number(displacement), number(duration));
        format!("{displacement} {unit} within {duration} s is no finite velocity")
    } else {
        return Ok(());
    };
    Err(MotionError::new_err(problem))
}
