//! `bench`: recordings of the virtual test bench.

use pyo3::prelude::*;
use trocar::bench::config::DEFAULT_TOML;
use trocar::bench::{BenchConfig, BenchError, Course, Experiment, UnknownProtocol};
use trocar::recording::Recording as Record;

use crate::arrays::column;
use crate::errors::{ParameterError, Raise};
use crate::model::Model;
use crate::recording::Recording;
use crate::work::{How, attempt};

/// Records an experiment on the virtual test bench: a motor moves a rod through a seal, and sensors
/// record it.
///
/// `protocol` is "steady", "dynamic", "validation", "step", "surgeon", "rest", "roll" or "hold-and-turn"; or `motion` holds the times, s, and
/// positions, m, of a motion to make in its place, such as `plan` gives. `seal` is a model of EMS
/// elements, by default the made-up plausible one. `config` is TOML text as `bench_config()` gives
/// it; keys left out keep their defaults.
///
/// >>> recording = trocar.bench("steady")
/// >>> recording.duration_s > 100.0
/// True
#[pyfunction]
#[pyo3(signature = (protocol=None, *, motion=None, seal=None, seed=1, config=None))]
pub(crate) fn bench(
    py: Python<'_>,
    protocol: Option<&str>,
    motion: Option<(Bound<'_, PyAny>, Bound<'_, PyAny>)>,
    seal: Option<&Bound<'_, Model>>,
    seed: u64,
    config: Option<&str>,
) -> PyResult<Recording> {
    let protocol = protocol.map(str::parse).transpose();
    let protocol =
        protocol.map_err(|error: UnknownProtocol| ParameterError::new_err(error.to_string()))?;
    let motion = match motion {
        Some((time_s, position_m)) => Some(Course {
            time: column("time_s", &time_s)?.as_slice()?.to_vec(),
            position: column("position_m", &position_m)?.as_slice()?.to_vec(),
            angle: None,
        }),
        None => None,
    };
    let experiment = Experiment::of(protocol, motion).map_err(Raise::raise)?;
    let mut config =
        config.map(BenchConfig::from_toml).transpose().map_err(Raise::raise)?.unwrap_or_default();
    let file = match seal {
        Some(seal) => seal.get().file().clone(),
        None => trocar::model_file::ModelFile::plausible_10_5_mm().map_err(Raise::raise)?.into(),
    };
    config.rotation = file.trocar.rotation().copied();
    let elements = file.stages().map_err(Raise::raise)?.elements().to_vec();
    let (record, events) = attempt(py, How::default(), move |_| -> Result<_, BenchError> {
        let run = experiment.run(&config, &elements, seed)?;
        let events = run.events;
        let limit = Some(config.force_sensor.range_n);
        Ok((Record::from_readings(experiment.name(), &run.readings(), limit), events))
    })?;
    let mut record = record.map_err(Raise::raise)?;
    record.quality.notes.extend(events.warnings().into_iter().chain(events.note()));
    Ok(Recording::new(record))
}

/// The virtual bench and its protocols as a documented TOML text.
///
/// >>> slow = trocar.bench("steady", config="[rig]\nsample_rate_hz = 200.0")
/// >>> "sample_rate_hz" in trocar.bench_config()
/// True
#[pyfunction]
pub(crate) fn bench_config() -> &'static str {
    DEFAULT_TOML
}
