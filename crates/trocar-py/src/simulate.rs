//! `simulate` and `simulate_full`: a model along whole arrays.

use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyAny;
use trocar::many::along;
use trocar::many::ensemble::Start;
use trocar::recording::{LONGEST_STROKE, range};
use trocar_model::{Mode, Trocar, TrocarState};

use crate::arrays::{apart, column, place};
use crate::errors::number;
use crate::errors::{MotionError, ParameterError};
use crate::model::{Model, given_model};
use crate::shared::{beside_times, finite};
use crate::work::in_chunks;

/// Samples between two looks at the signals: some milliseconds of work.
const CHUNK: usize = 1 << 17;
/// Samples whose durations are made at a time: what the first cache holds.
const PART: usize = 1 << 10;

/// Force of the model along a motion, N: that of the instrument on the seal, without any sensor
/// offset.
///
/// The first sample is the start: at rest there, undeformed, or with `initial_force_n` or
/// `initial_deflection_m`. Times may be uneven; a sample with the time and position of the one
/// before changes nothing. `out` takes the result: a contiguous, writable array of float64. Other
/// threads of Python run meanwhile.
///
/// >>> trocar.simulate(model, [0.0, 0.4], [0.0, 0.02]).round(2).tolist()
/// [0.0, 3.25]
#[pyfunction]
#[pyo3(signature = (model, time_s, position_m, *, initial_force_n=None, initial_deflection_m=None, out=None))]
pub(crate) fn simulate<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = given_model)] model: Bound<'py, Model>,
    time_s: &Bound<'py, PyAny>,
    position_m: &Bound<'py, PyAny>,
    initial_force_n: Option<f64>,
    initial_deflection_m: Option<f64>,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let (time, position) = motion(py, time_s, position_m)?;
    let (time, position) = (time.as_slice()?, position.as_slice()?);
    let trocar = model.get().trocar();
    let mut state = first_state(trocar, position, start(initial_force_n, initial_deflection_m)?)?;
    let result = match out {
        Some(out) => out.clone(),
        None => PyArray1::<f64>::zeros(py, time.len(), false).into_any(),
    };
    let mut out = place(&result, &[time.len()])?;
    apart(&out, &[time, position])?;
    let forces = out.as_slice_mut()?;
    let mut before = time.first().copied().unwrap_or(0.0);
    in_chunks(py, time.len(), CHUNK, |range| {
        let mut durations = [0.0; PART];
        for ((forces, time), position) in forces[range.clone()]
            .chunks_mut(PART)
            .zip(time[range.clone()].chunks(PART))
            .zip(position[range].chunks(PART))
        {
            for (duration, &t) in durations.iter_mut().zip(time) {
                *duration = t - before;
                before = t;
            }
            // No time passes at the first sample and at repeated ones: the state stays.
            along(trocar, &mut state, position, &durations, forces);
        }
    })?;
    drop(out);
    Ok(result)
}

/// The same with the deflection, m, and whether the seal slides: (force, deflection, sliding).
///
/// Deflection and sliding are None for a classical model, which has neither.
#[pyfunction]
#[pyo3(signature = (model, time_s, position_m, *, initial_force_n=None, initial_deflection_m=None))]
#[allow(clippy::type_complexity)]
pub(crate) fn simulate_full<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = given_model)] model: Bound<'py, Model>,
    time_s: &Bound<'py, PyAny>,
    position_m: &Bound<'py, PyAny>,
    initial_force_n: Option<f64>,
    initial_deflection_m: Option<f64>,
) -> PyResult<(
    Bound<'py, PyArray1<f64>>,
    Option<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<bool>>)>,
)> {
    let (time, position) = motion(py, time_s, position_m)?;
    let (time, position) = (time.as_slice()?, position.as_slice()?);
    let trocar = model.get().trocar();
    let mut state = first_state(trocar, position, start(initial_force_n, initial_deflection_m)?)?;
    let tells = state.deformation().is_some();
    let mut forces = Vec::with_capacity(time.len());
    let mut deformations = Vec::with_capacity(if tells { time.len() } else { 0 });
    let mut before = time.first().copied().unwrap_or(0.0);
    in_chunks(py, time.len(), CHUNK, |range| {
        for (&t, &x) in time[range.clone()].iter().zip(&position[range]) {
            // No time passes at the first sample and at repeated ones: the state stays.
            forces.push(trocar.step_to(&mut state, x, t - before));
            deformations.extend(state.deformation());
            before = t;
        }
    })?;
    let deformation = tells.then(|| {
        let deflection = PyArray1::from_iter(py, deformations.iter().map(|own| own.deflection));
        let slides = deformations.iter().map(|own| own.mode == Mode::Sliding);
        (deflection, PyArray1::from_iter(py, slides))
    });
    Ok((PyArray1::from_vec(py, forces), deformation))
}

/// How the seal stands at the first sample.
pub(crate) fn start(
    initial_force_n: Option<f64>,
    initial_deflection_m: Option<f64>,
) -> PyResult<Start> {
    match (initial_force_n, initial_deflection_m) {
        (None, None) => Ok(Start::Undeformed),
        (Some(force), None) => finite("initial_force_n", force, "N").map(|()| Start::Force(force)),
        (None, Some(deflection)) => {
            finite("initial_deflection_m", deflection, "m").map(|()| Start::Deflection(deflection))
        }
        _ => Err(PyTypeError::new_err("give initial_force_n or initial_deflection_m, not both")),
    }
}

/// A model at the first position of a motion.
fn first_state(trocar: &Trocar<Vec<f64>>, position: &[f64], start: Start) -> PyResult<TrocarState> {
    let first = position.first().copied().unwrap_or(0.0);
    start.state(trocar, first).ok_or_else(|| {
        ParameterError::new_err(
            "initial_deflection_m is for EMS elements; a classical model has no deflection",
        )
    })
}

/// Times and positions of a motion that a model can follow.
pub(crate) fn motion<'py>(
    py: Python<'py>,
    time_s: &Bound<'py, PyAny>,
    position_m: &Bound<'py, PyAny>,
) -> PyResult<(PyReadonlyArray1<'py, f64>, PyReadonlyArray1<'py, f64>)> {
    let arrays = (column("time_s", time_s)?, column("position_m", position_m)?);
    let (time, position) = (arrays.0.as_slice()?, arrays.1.as_slice()?);
    beside_times("position_m", position.len(), time.len())?;
    py.detach(|| check(time, position)).map_err(MotionError::new_err)?;
    Ok(arrays)
}

/// What a model cannot follow, in words: where, found, expected.
fn check(time: &[f64], position: &[f64]) -> Result<(), String> {
    if is_plain(time, position) {
        return Ok(());
    }
    let mut pairs = time.windows(2).zip(position.windows(2));
    if !all_finite(time) || !all_finite(position) || !pairs.all(|(t, x)| follows(t, x)) {
        return Err(first_fault(time, position));
    }
    let (low, high) = range(position);
    let stroke = high - low;
    if stroke > LONGEST_STROKE {
        return Err(format!(
            "position_m covers {} m, expected at most {LONGEST_STROKE} m\n\nhint: is the unit right? divide millimetres by 1000",
            number(stroke)
        ));
    }
    Ok(())
}

/// Whether a model can go from one sample to the next; one that is there twice changes nothing.
fn follows(t: &[f64], x: &[f64]) -> bool {
    let (duration, displacement) = (t[1] - t[0], x[1] - x[0]);
    (duration > 0.0 && (displacement / duration).is_finite())
        || (duration == 0.0 && displacement == 0.0)
}

fn all_finite(values: &[f64]) -> bool {
    values.iter().all(|value| value.is_finite())
}

/// Whether nothing needs a closer look: all time advances, and all positions lie within a metre of
/// the first. Without a branch in the loop, since it stands beside some nanoseconds of simulation
/// per sample.
fn is_plain(time: &[f64], position: &[f64]) -> bool {
    /// Shortest duration, s, whose velocity over two metres is finite for sure.
    const SHORTEST: f64 = 1e-300;
    let (Some(&t), Some(&x)) = (time.first(), position.first()) else { return true };
    let advances = time.windows(2).fold(true, |all, t| {
        let duration = t[1] - t[0];
        all & (duration > SHORTEST) & (duration < f64::INFINITY)
    });
    let is_near =
        position.iter().fold(true, |all, other| all & ((other - x).abs() <= 0.5 * LONGEST_STROKE));
    t.is_finite() && advances && is_near
}

/// A clock that runs backwards at sample `i`, in words.
pub(crate) fn goes_back(i: usize, from: f64, to: f64) -> String {
    let [from, to] = [from, to].map(number);
    format!("sample {i}: time_s goes back from {from} s to {to} s, expected it to advance")
}

#[cold]
fn first_fault(time: &[f64], position: &[f64]) -> String {
    for (i, (&t, &x)) in time.iter().zip(position).enumerate() {
        for (name, value, unit) in [("time_s", t, "s"), ("position_m", x, "m")] {
            if !value.is_finite() {
                return format!("sample {i}: {name} is {value} {unit}, expected a finite number");
            }
        }
        let Some(before) = i.checked_sub(1) else { continue };
        let (from_t, from_x) = (time[before], position[before]);
        let [from_time, to_time] = [from_t, t].map(number);
        if t < from_t {
            return goes_back(i, from_t, t);
        }
        if x != from_x && !((x - from_x) / (t - from_t)).is_finite() {
            let [from, to] = [from_x, x].map(number);
            return format!(
                "sample {i}: position_m goes from {from} m to {to} m while time_s goes from {from_time} s to \
                 {to_time} s, expected a finite velocity"
            );
        }
    }
    "the motion changed while it was read".to_owned()
}
