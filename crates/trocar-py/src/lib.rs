//! The Python package `trocar`, its native part: thin types over the library, arrays in and out
//! without a copy, long work off the interpreter's lock. The rest of the package is Python, in
//! `python/trocar/`.
//!
//! ```text
//! NumPy, pandas, polars, files ─▶ Recording ─▶ identify, validate, compare ─▶ Identified, Validated, Compared ─▶ Python results
//!                  time, position ─▶ simulate, simulate_many, Stepper ◀─ Model ─▶ teleop, plan
//! ```
//! Nothing here estimates, simulates or draws by itself. Whatever fails becomes a Python exception
//! with the library's message; a panic becomes `InternalError` and never reaches the interpreter.

mod arrays;
mod bench;
mod compare;
mod compensate;
mod errors;
mod fleet;
mod identify;
mod keys;
mod many;
mod model;
mod plan;
mod posterior;
mod read;
mod recording;
mod shared;
mod simulate;
mod stepper;
mod teleop;
mod validate;
mod work;

/// Native part of the package `trocar`.
#[pyo3::pymodule]
mod _core {
    use pyo3::prelude::*;

    #[pymodule_export]
    use crate::bench::{bench, bench_config};
    #[pymodule_export]
    use crate::compare::{Compared, compare};
    #[pymodule_export]
    use crate::compensate::{Compensator, TissueForce, compensate, faults};
    #[pymodule_export]
    use crate::errors::{
        ArrayError, BenchError, CompareError, IdentifyError, InternalError, ModelFileError,
        MotionError, NotConverged, ParameterError, PlanError, RecordingError, TeleopError,
        TrocarError,
    };
    #[pymodule_export]
    use crate::fleet::{
        FleetConfig, FleetTable, fleet_columns, fleet_file, fleet_frame, fleet_source,
    };
    #[pymodule_export]
    use crate::identify::{Identified, identify};
    #[pymodule_export]
    use crate::many::run_many;
    #[pymodule_export]
    use crate::model::{Model, Tunable, parameter_least, parameter_symbol};
    #[pymodule_export]
    use crate::plan::{plan, plan_example};
    #[pymodule_export]
    use crate::posterior::{PosteriorTable, read_posterior};
    #[pymodule_export]
    use crate::read::read;
    #[pymodule_export]
    use crate::recording::Recording;
    #[pymodule_export]
    use crate::simulate::{simulate, simulate_full};
    #[pymodule_export]
    use crate::stepper::Stepper;
    #[pymodule_export]
    use crate::teleop::{Studied, teleop, teleop_example, teleop_presets};
    #[pymodule_export]
    use crate::validate::{Validated, validate};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
