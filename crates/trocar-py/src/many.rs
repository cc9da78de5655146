//! Many models along one motion, for `simulate_many` and `squared_error_many` in `trocar._many`.

use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyAny;
use trocar::many::ensemble::{Ensemble, Motion, Refusal, Start, Tuned, forces, squared_errors};
use trocar_model::{ParamError, Seal, Trocar};

use crate::arrays::{apart, column, place};
use crate::errors::{ArrayError, ParameterError, RecordingError, number};
use crate::model::{Model, Tunable, tunables, unknown};
use crate::shared::beside_times;
use crate::simulate::{motion, start};
use crate::work::run_borrowing;

/// Forces of models along a motion into `out`, a row for each; with readings, sums of their squared
/// errors against these, one for each. The models are those listed, or one with columns of
/// parameters.
#[pyfunction]
#[pyo3(signature = (models, parameters, time_s, position_m, force_n, *, initial_force_n, initial_deflection_m, out,
    threads))]
#[allow(clippy::too_many_arguments)] // keywords in Python
pub(crate) fn run_many(
    py: Python<'_>,
    models: Vec<Py<Model>>,
    parameters: Option<Vec<(String, Bound<'_, PyAny>)>>,
    time_s: &Bound<'_, PyAny>,
    position_m: &Bound<'_, PyAny>,
    force_n: Option<&Bound<'_, PyAny>>,
    initial_force_n: Option<f64>,
    initial_deflection_m: Option<f64>,
    out: &Bound<'_, PyAny>,
    threads: usize,
) -> PyResult<()> {
    let (time, position) = motion(py, time_s, position_m)?;
    let (time, position) = (time.as_slice()?, position.as_slice()?);
    let readings = force_n.map(|force| column("force_n", force)).transpose()?;
    let readings = readings.as_ref().map(|force| force.as_slice()).transpose()?;
    if let Some(force) = readings {
        check_readings(force, time.len())?;
    }
    let start = start(initial_force_n, initial_deflection_m)?;
    let adjusted = parameters.map(|columns| Adjusted::read(&models, columns)).transpose()?;
    let models = Models::new(&models, adjusted.as_ref(), start)?;
    let mut out = match readings {
        None => place(out, &[models.count(), time.len()])?,
        Some(_) => place(out, &[models.count()])?,
    };
    let columns = models.columns().iter().map(|(_, values)| *values);
    let read: Vec<&[f64]> = [time, position].into_iter().chain(readings).chain(columns).collect();
    apart(&out, &read)?;
    let out = out.as_slice_mut()?;
    let done = run_borrowing(py, threads, || {
        let motion = Motion::new(time, position);
        match readings {
            None => forces(&models, start, &motion, out),
            Some(force) => squared_errors(&models, start, &motion, force, out),
        }
    })?;
    done.map_err(|refusal| raise(refusal, adjusted.as_ref()))
}

fn check_readings(force: &[f64], samples: usize) -> PyResult<()> {
    beside_times("force_n", force.len(), samples)?;
    match force.iter().position(|force| force.is_infinite()) {
        None if samples > 0 && force.iter().all(|force| force.is_nan()) => Err(
            RecordingError::new_err("force_n holds no reading, all are nan: any model would do"),
        ),
        None => Ok(()),
        Some(i) => Err(RecordingError::new_err(format!(
            "sample {i}: force_n is {} N, expected a finite number, or nan where there is no reading",
            force[i]
        ))),
    }
}

/// The models of a call.
enum Models<'a> {
    Listed(Vec<&'a Model>),
    Tuned(Box<Tuned<'a>>),
}

impl<'a> Models<'a> {
    /// The models, all of which can begin as `start` says.
    fn new(
        models: &'a [Py<Model>],
        adjusted: Option<&'a Adjusted<'_>>,
        start: Start,
    ) -> PyResult<Self> {
        let Some(adjusted) = adjusted else {
            let models: Vec<&Model> = models.iter().map(Py::get).collect();
            return match models.iter().position(|model| {
                matches!(start, Start::Deflection(_))
                    && matches!(model.trocar().seal(), Seal::Classical(_))
            }) {
                Some(index) => Err(raise(Refusal::NoDeflection { index }, None)),
                None => Ok(Self::Listed(models)),
            };
        };
        let columns =
            adjusted.columns.iter().map(|column| Ok((column.place, column.values.as_slice()?)));
        let tuned =
            Tuned::new(base(models)?.trocar().borrowed(), columns.collect::<PyResult<_>>()?);
        Ok(Self::Tuned(Box::new(tuned.expect("every place was found among the tunables"))))
    }

    /// Columns of parameters, each with its place.
    fn columns(&self) -> &[(usize, &'a [f64])] {
        match self {
            Self::Listed(_) => &[],
            Self::Tuned(tuned) => tuned.columns(),
        }
    }
}

impl Ensemble for Models<'_> {
    fn count(&self) -> usize {
        match self {
            Self::Listed(models) => models.len(),
            Self::Tuned(tuned) => tuned.count(),
        }
    }

    fn trocar(&self, index: usize) -> Result<Trocar<&[f64]>, ParamError> {
        match self {
            Self::Listed(models) => Ok(models[index].trocar().borrowed()),
            Self::Tuned(tuned) => tuned.trocar(index),
        }
    }
}

/// The model that parameters belong to.
fn base(models: &[Py<Model>]) -> PyResult<&Model> {
    match models {
        [model] => Ok(model.get()),
        _ => Err(PyTypeError::new_err(format!(
            "parameters belong to one model, got {} models",
            models.len()
        ))),
    }
}

/// Columns of parameters in place of those of the model.
struct Adjusted<'py> {
    columns: Vec<Column<'py>>,
}

/// Values of one parameter, one for each model.
struct Column<'py> {
    law: Tunable,
    place: usize,
    values: PyReadonlyArray1<'py, f64>,
}

impl<'py> Adjusted<'py> {
    fn read(models: &[Py<Model>], given: Vec<(String, Bound<'py, PyAny>)>) -> PyResult<Self> {
        let base = base(models)?.trocar();
        let mut columns: Vec<Column<'_>> = Vec::new();
        for (name, values) in given {
            let mut known = tunables(base.seal());
            let found = known.iter().position(|tunable| tunable.name == name);
            let place = found.ok_or_else(|| unknown(&name, &known))?;
            if columns.iter().any(|column| column.place == place) {
                return Err(ParameterError::new_err(format!("parameters: {name} is there twice")));
            }
            let column =
                Column { law: known.swap_remove(place), place, values: column(&name, &values)? };
            column.check(columns.first())?;
            columns.push(column);
        }
        if columns.is_empty() {
            let names: Vec<String> =
                tunables(base.seal()).into_iter().map(|tunable| tunable.name).collect();
            return Err(ParameterError::new_err(format!(
                "parameters has no column; there are {}",
                names.join(", ")
            )));
        }
        Ok(Self { columns })
    }
}

impl Column<'_> {
    /// As many values as the `first` has, each in its range.
    fn check(&self, first: Option<&Self>) -> PyResult<()> {
        let Tunable { name, least, above_least, .. } = &self.law;
        let values = self.values.as_slice()?;
        if let Some(first) = first
            && let (found, expected) = (values.len(), first.values.as_slice()?.len())
            && found != expected
        {
            let other = &first.law.name;
            return Err(ArrayError::new_err(format!(
                "{name} has {found} values, expected {expected} as {other} has"
            )));
        }
        let fits =
            |value: &f64| value.is_finite() && (value > least || (value == least && !above_least));
        let Some(model) = values.iter().position(|value| !fits(value)) else { return Ok(()) };
        let (wanted, unit) = (if *above_least { "above" } else { "at least" }, self.unit());
        Err(ParameterError::new_err(format!(
            "{name} of model {model} must be finite and {wanted} {least}{unit}, got {}{unit}",
            number(values[model])
        )))
    }

    fn unit(&self) -> String {
        if self.law.unit == "1" { String::new() } else { format!(" {}", self.law.unit) }
    }
}

fn raise(refusal: Refusal, adjusted: Option<&Adjusted<'_>>) -> PyErr {
    let columns = adjusted.map_or(&[][..], |adjusted| &adjusted.columns);
    match refusal {
        Refusal::Parameter { index, why } => {
            let values: Vec<String> = columns
                .iter()
                .filter_map(|column| {
                    let value = column.values.as_slice().ok()?.get(index)?;
                    Some(format!("{} = {}{}", column.law.name, number(*value), column.unit()))
                })
                .collect();
            ParameterError::new_err(format!("model {index} with {}: {why}", values.join(", ")))
        }
        Refusal::NoDeflection { index } => ParameterError::new_err(format!(
            "initial_deflection_m is for EMS elements; model {index} is a classical one and has no deflection"
        )),
    }
}
