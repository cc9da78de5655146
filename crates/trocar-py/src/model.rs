//! `Model` and its `Tunable` parameters.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::Arc;

use pyo3::exceptions::PyTypeError;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyAny, PyDict, PyTuple};
use trocar::compensate::CompensateOptions;
use trocar::export::c::{COptions, DEFAULT_PREFIX, from_text, stem};
use trocar::export::values;
use trocar::model_file::{ModelFile, Origin, OriginKind};
use trocar::output::write_whole;
use trocar_fmu::{Contents, Embedded, Input, PackageError, Platform, Source, Version, package};
use trocar_model::{Declaration, ParameterId, Seal, Trocar};

use crate::errors::{InternalError, ParameterError, Raise, TrocarError, in_python, number};
use crate::recording::{Recording, records};

/// The libraries for FMUs that this package carries.
const INSIDE: Embedded = include!(concat!(env!("OUT_DIR"), "/fmu.rs"));

/// A model of the force between instrument and trocar: EMS elements, or one classical friction
/// model.
///
/// Models do not change: `tuned` gives another one. Two models are equal when their files would be.
///
/// >>> model = trocar.Model.plausible()
/// >>> stiff = model.tuned(F_c=4.0)
/// >>> stiff.save("stiff.json")
/// >>> trocar.Model.load("stiff.json") == stiff
/// True
#[pyclass(module = "trocar", frozen)]
pub(crate) struct Model(Arc<ModelFile>);

impl Model {
    pub(crate) fn file(&self) -> &Arc<ModelFile> {
        &self.0
    }

    /// The model as every program runs it.
    pub(crate) fn trocar(&self) -> &Trocar<Vec<f64>> {
        &self.0.trocar
    }
}

impl From<ModelFile> for Model {
    fn from(file: ModelFile) -> Self {
        Self(Arc::new(file))
    }
}

/// A number of a model that can be adjusted by itself; it can be pickled.
///
/// >>> width = model.tunables[0]
/// >>> width.name, width.value, width.unit
/// ('half_width_m', 0.008, 'm')
#[pyclass(module = "trocar", frozen, get_all)]
pub(crate) struct Tunable {
    /// Name, with its unit at the end; where a model has several elements, it begins with
    /// `element_1_` and so on.
    pub(crate) name: String,
    /// Present value.
    value: f64,
    /// Unit in SI; "1" for a pure number.
    pub(crate) unit: &'static str,
    /// What it is.
    description: String,
    /// Least value allowed.
    pub(crate) least: f64,
    /// Whether the least value itself is left out.
    pub(crate) above_least: bool,
}

#[pymethods]
impl Tunable {
    fn _repr_html_(slf: Bound<'_, Self>) -> PyResult<Bound<'_, PyAny>> {
        let py = slf.py();
        py.import(intern!(py, "trocar._show"))?.call_method1(intern!(py, "fields"), (slf,))
    }

    fn __repr__(&self) -> String {
        let Self { name, value, unit, least, above_least, .. } = self;
        let relation = if *above_least { ">" } else { ">=" };
        format!("<trocar.Tunable {name} = {} {unit}, {relation} {least}>", number(*value))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (String, f64))> {
        let own = slf.get();
        let restore = slf.get_type().getattr(intern!(slf.py(), "_restore"))?;
        Ok((restore, (own.name.clone(), own.value)))
    }

    /// What unpickling calls: the name stands for all but the value.
    #[staticmethod]
    fn _restore(name: &str, value: f64) -> PyResult<Self> {
        Ok(Self::of(trocar_model::Tunable { id: parameter(name)?, value }))
    }
}

impl Tunable {
    fn of(trocar_model::Tunable { id, value }: trocar_model::Tunable) -> Self {
        let Declaration { unit, range, .. } = id.declaration();
        Self {
            name: id.to_string(),
            value,
            unit: unit.si,
            description: format!("{}: {}", id.symbol(), id.words()),
            least: range.least(),
            above_least: range.excludes_least(),
        }
    }
}

impl Tunable {
    /// By its name or its symbol (F_c, beta, c); one without a direction is that of both.
    fn is_called(&self, name: &str) -> bool {
        let symbol = latin(self.description.split(':').next().unwrap_or_default());
        let of_both = self.name.replace("insertion_", "").replace("withdrawal_", "");
        let names = [self.name.clone(), of_both, symbol.replace(['⁺', '⁻'], ""), symbol];
        names.contains(&latin(name))
    }
}

fn parameter(name: &str) -> PyResult<ParameterId> {
    ParameterId::named(name)
        .ok_or_else(|| ParameterError::new_err(format!("no parameter is named {name:?}")))
}

/// Lower end of the range of a parameter of a model or of its fit, minus infinity without one.
#[pyfunction]
pub(crate) fn parameter_least(name: &str) -> PyResult<f64> {
    Ok(parameter(name)?.declaration().range.least())
}

/// The symbol of a parameter, as the tables of the command line have it: F_c, β.
#[pyfunction]
pub(crate) fn parameter_symbol(name: &str) -> PyResult<String> {
    Ok(parameter(name)?.symbol().to_string())
}

pub(crate) fn tunables(seal: &Seal) -> Vec<Tunable> {
    seal.tunables().map(Tunable::of).collect()
}

#[pymethods]
impl Model {
    /// Reads a model file (model.json).
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        Ok(py.detach(|| ModelFile::read(&path)).map_err(Raise::raise)?.into())
    }

    /// Reads the text of a model file.
    #[staticmethod]
    fn from_json(text: &str) -> PyResult<Self> {
        Ok(ModelFile::from_json(text).map_err(Raise::raise)?.into())
    }

    /// The model of a dictionary such as `to_dict` gives; numbers may be NumPy's.
    #[staticmethod]
    fn from_dict(values: &Bound<'_, PyAny>) -> PyResult<Self> {
        let py = values.py();
        let text = py
            .import(intern!(py, "trocar._arrays"))?
            .call_method1(intern!(py, "json_text"), (values,))?;
        Self::from_json(&text.extract::<String>()?)
    }

    /// A made-up, plausible one-stage 10.5 mm trocar; describes no particular one.
    #[staticmethod]
    fn plausible() -> PyResult<Self> {
        Ok(ModelFile::plausible_10_5_mm().map_err(Raise::raise)?.into())
    }

    /// The text of a model file: equal models give equal text.
    fn to_json(&self) -> String {
        self.0.to_json()
    }

    /// Writes a model file; it appears whole or not at all.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| write_whole(&path, self.0.to_json().as_bytes())).map_err(Raise::raise)
    }

    /// Writes the model in C99 (`trocar export c`): `path`, which ends in .c, and beside it a header
    /// that ends in .h. Both files appear whole, or neither does.
    ///
    /// All names in the files begin with `prefix`. `precision` is that of the numbers: "double", or
    /// "single" for processors that compute in 32 bits only. `compensator` adds the observer of the
    /// tissue force with the sensor of the model file; the command line takes other values. The
    /// first comment of the header
    /// explains the use; docs/reference/exported-c.md has an example.
    #[pyo3(
        signature = (path, *, prefix=DEFAULT_PREFIX.to_owned(), precision="double", compensator=false),
        text_signature = "($self, path, *, prefix='trocar', precision='double', compensator=False)"
    )]
    fn export_c(
        &self,
        py: Python<'_>,
        path: PathBuf,
        prefix: String,
        precision: &str,
        compensator: bool,
    ) -> PyResult<()> {
        py.detach(|| {
            let observing = CompensateOptions::default();
            let options = COptions {
                prefix: &prefix,
                stem: stem(&path)?,
                precision: precision.parse()?,
                compensator: compensator.then_some(&observing),
                internal: false,
            };
            from_text(&self.0.to_json(), "model.json", options)?.store(&path)
        })
        .map_err(Raise::raise)
    }

    /// Writes the model as a functional mock-up unit (`trocar export fmu`); the file appears whole
    /// or not at all.
    ///
    /// `fmi` is the version of FMI, 2 or 3; `input` is what drives the model: "position" (m, at the
    /// end of a step) or "velocity" (m/s, during it); `name` that of the model in the description
    /// (with `source` also in its model identifier, trocar_NAME).
    /// The FMU runs on all `platforms` that this package carries a library for, or on those named
    /// ("x86_64-linux", "x86_64-windows"); the command line can add libraries for others. With `source`
    /// it holds source code in C instead, which the importer compiles, and its parameters are constants.
    #[pyo3(signature = (path, *, fmi=2, input="velocity", name="model", platforms=None, source=false))]
    #[allow(clippy::too_many_arguments)] // keywords in Python
    fn export_fmu(
        &self,
        py: Python<'_>,
        path: PathBuf,
        fmi: u32,
        input: &str,
        name: &str,
        platforms: Option<Vec<String>>,
        source: bool,
    ) -> PyResult<()> {
        let refuse = |error: PackageError| match error {
            PackageError::NotCarried { .. } => TrocarError::new_err(error.to_string()),
            _ => ParameterError::new_err(in_python(&error)),
        };
        let version: Version = fmi.to_string().parse().map_err(refuse)?;
        let input: Input = input.parse().map_err(refuse)?;
        let platforms: Option<Result<Vec<Platform>, _>> =
            platforms.map(|names| names.iter().map(|name| name.parse()).collect());
        let platforms = platforms.transpose().map_err(refuse)?;
        if source && platforms.is_some() {
            return Err(refuse(PackageError::Both));
        }
        let (trocar, text) = (self.trocar().borrowed(), self.0.to_json());
        let code = source.then(|| from_text(&text, "model.json", COptions::IN_FMU)).transpose();
        let code = code.map_err(Raise::raise)?;
        let binaries = match code {
            Some(_) => Vec::new(),
            None => INSIDE.binaries(platforms.as_deref()).map_err(refuse)?,
        };
        let contents = Contents {
            name,
            trocar,
            input,
            version,
            text: &text,
            binaries: &binaries,
            source: code
                .as_ref()
                .map(|files| Source { header: &files.header, code: &files.source }),
        };
        let bytes = package(&contents).map_err(refuse)?;
        py.detach(|| write_whole(&path, &bytes)).map_err(Raise::raise)
    }

    /// The numbers of the model in the names, units and conventions of another program (`trocar
    /// export values`), as text to paste: "mujoco", "isaac", "urdf", "sdf", "ur", "simulink", or
    /// "json" with all of them. Comments state what that program cannot express; with recordings to
    /// `validate` on, also how large the error becomes by that.
    #[pyo3(signature = (target, *, validate=Vec::new()), text_signature = "($self, target, *, validate=())")]
    fn export_values(
        &self,
        py: Python<'_>,
        target: &str,
        validate: Vec<PyRef<'_, Recording>>,
    ) -> PyResult<String> {
        let recordings = records(&validate);
        py.detach(|| values::text(&self.0, target, recordings)).map_err(Raise::raise)
    }

    /// Kind of the model: "ems", or the kind of a classical model as in its file, such as "lugre".
    #[getter]
    fn kind(&self) -> &'static str {
        self.trocar().seal().kind()
    }

    /// Offset of the force sensor behind the model, N: no part of the seal's force; 0 if there was
    /// no sensor.
    #[getter]
    fn sensor_offset_n(&self) -> f64 {
        self.0.sensor.map_or(0.0, |sensor| sensor.offset_n)
    }

    /// Mass between that sensor and the seal, kg; 0 if there was none.
    #[getter]
    fn moving_mass_kg(&self) -> f64 {
        self.0.sensor.map_or(0.0, |sensor| sensor.moving_mass_kg)
    }

    /// Time by which positions were read later than forces, s.
    #[getter]
    fn position_delay_s(&self) -> f64 {
        self.0.sensor.map_or(0.0, |sensor| sensor.position_delay_s)
    }

    /// Whether the force depends on the position, too.
    #[getter]
    fn has_position_profile(&self) -> bool {
        self.trocar().profile().is_some()
    }

    /// The whole model file as a dictionary: origin, sensor, elements or friction, intervals.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        py.import("json")?.call_method1("loads", (self.0.to_json(),))
    }

    /// The numbers that `tuned` can change.
    #[getter]
    fn tunables<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let all = tunables(self.trocar().seal()).into_iter().map(|tunable| Py::new(py, tunable));
        PyTuple::new(py, all.collect::<PyResult<Vec<_>>>()?)
    }

    /// Another model with some numbers changed, as in `model.tuned(half_width_m=5e-3)` or, by its
    /// symbol, `model.tuned(F_c=4.0)`; see `tunables`. A name without a direction changes both.
    ///
    /// A new force stretches the branches of the deformation with it. The new model keeps sensor
    /// and position profile, loses the intervals, and says in its origin that it was made by hand.
    #[pyo3(signature = (**values), text_signature = "($self, **values)")]
    fn tuned(&self, values: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let old = tunables(self.trocar().seal());
        let mut new: Vec<f64> = old.iter().map(|tunable| tunable.value).collect();
        let mut note = "tuned:".to_owned();
        for (name, value) in values.into_iter().flat_map(|values| values.iter()) {
            let name: String = name.extract()?;
            let places: Vec<usize> = (0..old.len()).filter(|i| old[*i].is_called(&name)).collect();
            if places.is_empty() {
                return Err(unknown(&name, &old));
            }
            // Python and NumPy take a truth value for 0 or 1.
            let read = if matches!(&*type_of(&value), "bool" | "bool_") {
                None
            } else {
                value.extract().ok()
            };
            let read = read.ok_or_else(|| {
                PyTypeError::new_err(format!("{name} must be a number, got {}", type_of(&value)))
            })?;
            for place in places {
                new[place] = read;
                // Writing to a string cannot fail.
                let _ = write!(note, " {} = {}", old[place].name, number(read));
            }
        }
        let seal = self.trocar().seal().tuned(&new).map_err(Raise::raise)?;
        let mut file =
            ModelFile::new(seal, Origin { note: Some(note), ..Origin::new(OriginKind::HandMade) });
        (file.trocar, file.sensor) = (self.trocar().with_seal(seal), self.0.sensor);
        Ok(file.into())
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.0 == other.0
    }

    fn __hash__(&self, py: Python<'_>) -> PyResult<isize> {
        self.0.to_json().into_pyobject(py)?.hash()
    }

    fn __repr__(&self) -> PyResult<String> {
        let kind = match self.trocar().seal().stages().map(|stages| stages.elements().len()) {
            Some(count) if count > 1 => format!("ems, {count} elements"),
            _ => self.kind().to_owned(),
        };
        let along = if self.trocar().profile().is_some() { ", position profile" } else { "" };
        let origin = serde_json::to_value(self.0.origin.kind);
        let origin = origin.map_err(|error| InternalError::new_err(error.to_string()))?;
        Ok(format!("<trocar.Model {kind}{along}, {}>", origin.as_str().unwrap_or_default()))
    }

    fn _repr_html_(slf: Bound<'_, Self>) -> PyResult<Bound<'_, PyAny>> {
        let py = slf.py();
        py.import(intern!(py, "trocar._show"))?.call_method1(intern!(py, "model"), (slf,))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (String,))> {
        Ok((slf.get_type().getattr(intern!(slf.py(), "from_json"))?, (slf.get().to_json(),)))
    }
}

pub(crate) fn unknown(name: &str, known: &[Tunable]) -> PyErr {
    let names: Vec<&str> = known.iter().map(|tunable| tunable.name.as_str()).collect();
    let near = names.iter().find(|own| own.contains(name) || name.contains(**own));
    let hint = near.map_or(String::new(), |near| format!("\n\nhint: did you mean {near}?"));
    let names = names.join(", ");
    ParameterError::new_err(format!("no parameter {name:?} to tune; there are {names}{hint}"))
}

/// The model that a function is given; a path and a result say where their model is.
pub(crate) fn given_model<'py>(value: &Bound<'py, PyAny>) -> PyResult<Bound<'py, Model>> {
    value.cast::<Model>().cloned().map_err(|_| {
        let hint = if value.extract::<PathBuf>().is_ok() {
            format!(
                "; read it with trocar.Model.load({})",
                value.repr().map_or_else(|_| "path".into(), |path| path.to_string())
            )
        } else if value.hasattr("model").unwrap_or(false) {
            "; give its attribute model".to_owned()
        } else {
            String::new()
        };
        PyTypeError::new_err(format!("expected a trocar.Model, got {}{hint}", type_of(value)))
    })
}

fn type_of(value: &Bound<'_, PyAny>) -> String {
    value.get_type().name().map_or_else(|_| "something else".to_owned(), |name| name.to_string())
}

fn latin(text: &str) -> String {
    text.replace('β', "beta").replace('σ', "sigma").replace('τ', "tau")
}
