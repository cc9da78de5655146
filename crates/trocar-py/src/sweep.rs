//! `sweep`: one model many times, to a table in memory or in a file; `trocar._sweep` wraps it.

use std::path::PathBuf;

use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyList;
use trocar::output::OutputError;
use trocar::sweep::config::EXAMPLE_TOML;
use trocar::sweep::{Given, Summary, Sweep, SweepConfig, SweepError as Fault};
use trocar::table::Column;

use crate::errors::{Raise, SweepError};
use crate::model::Model;
use crate::posterior::Draws;
use crate::work::{How, Report, run};

/// What to vary in a sweep, every key of it, as a documented TOML text.
#[pyfunction]
pub(crate) fn sweep_config() -> &'static str {
    EXAMPLE_TOML
}

/// A table by the names of its columns; None where it went into a file.
type Columns<'py> = Option<Vec<(String, Bound<'py, PyAny>)>>;

/// Runs the document `text`, TOML or JSON; rows, those failed, the first failure, and the table.
#[pyfunction]
#[pyo3(signature = (text, *, is_json, name, folder, model, posterior, out, traces, seed, threads, progress))]
#[allow(clippy::too_many_arguments)] // keywords in Python
pub(crate) fn sweep<'py>(
    py: Python<'py>,
    text: String,
    is_json: bool,
    name: Option<String>,
    folder: PathBuf,
    model: Option<&Bound<'py, Model>>,
    posterior: Option<&Bound<'py, PyAny>>,
    out: Option<PathBuf>,
    traces: Option<PathBuf>,
    seed: Option<u64>,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<(u64, u64, Option<String>, Columns<'py>)> {
    let given = Given {
        model: model.map(|model| (**model.get().file()).clone()),
        draws: posterior.map(Draws::of).transpose()?.map(|draws| draws.models),
    };
    let work = move |report: &Report| {
        let config = if is_json { of_json(&text)? } else { SweepConfig::from_toml(&text)? };
        let config = SweepConfig { seed: seed.unwrap_or(config.seed), ..config };
        let text = if is_json { "" } else { &text };
        let sweep = Sweep::of(config, text, &folder, given)?;
        if let Some(folder) = &traces {
            let failed = |source| OutputError::Create { path: folder.clone(), source };
            std::fs::create_dir_all(folder).map_err(failed)?;
        }
        let rows = sweep.rows() as f64;
        let tell = |done: u64| report.tell("sweep", done as f64 / rows);
        match &out {
            Some(out) => Ok((sweep.run(out, traces.as_deref(), tell)?, None)),
            None => {
                keep(&sweep, traces.as_deref(), tell).map(|(summary, table)| (summary, Some(table)))
            }
        }
    };
    let (summary, table) =
        run(py, How { progress, threads }, work)?.map_err(|error: Fault| in_file(error, name))?;
    let Summary { rows, failed, first_failure } = summary;
    let array = |(name, column)| Ok((name, array(py, column)?));
    let table = table
        .map(|table| table.into_iter().map(array).collect::<PyResult<Vec<_>>>())
        .transpose()?;
    Ok((rows, failed, first_failure, table))
}

fn of_json(text: &str) -> Result<SweepConfig, Fault> {
    let syntax = |error: serde_json::Error| Fault::Syntax(format!("{error}\n"));
    let value: serde_json::Value = serde_json::from_str(text).map_err(syntax)?;
    serde_json::from_value(value).map_err(syntax)
}

/// The whole table in memory.
fn keep(
    sweep: &Sweep,
    traces: Option<&std::path::Path>,
    tell: impl Fn(u64),
) -> Result<(Summary, Vec<(String, Column)>), Fault> {
    let empty = sweep.fields().into_iter().map(|field| (field.name, Column::new(field.kind)));
    let mut table: Vec<(String, Column)> = empty.collect();
    let summary = sweep.each(traces, |done, columns| {
        table.iter_mut().zip(columns).for_each(|((_, all), new)| all.append(new));
        tell(done);
        Ok(())
    })?;
    Ok((summary, table))
}

/// The error with the file that the document was read from before its message, where it is about
/// the document.
fn in_file(error: Fault, name: Option<String>) -> PyErr {
    let is_elsewhere = matches!(
        error,
        Fault::Model(_)
            | Fault::Recording(_)
            | Fault::Draws(_)
            | Fault::Output(_)
            | Fault::ReadDocument { .. }
            | Fault::Rig { .. }
            | Fault::Loop { .. }
    );
    match name {
        Some(name) if !is_elsewhere => {
            SweepError::new_err(crate::errors::in_python(&format!("{name}: {error}")))
        }
        _ => error.raise(),
    }
}

fn array<'py>(py: Python<'py>, column: Column) -> PyResult<Bound<'py, PyAny>> {
    Ok(match column {
        Column::Number(cells) => PyArray1::from_vec(py, cells).into_any(),
        // All there: the number of the run, its seed, the row of its draw.
        Column::Integer(cells) => {
            PyArray1::from_iter(py, cells.into_iter().map(Option::unwrap_or_default)).into_any()
        }
        Column::Boolean(cells) => PyList::new(py, cells)?.into_any(),
        Column::Text(cells) => {
            PyList::new(py, cells.iter().map(|cell| cell.as_deref()))?.into_any()
        }
    })
}
