//! Identification of one recording into one row.

use std::any::Any;
use std::borrow::Cow;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::row::{DEGREES, FleetCell, FleetRow};
use crate::summary::PROGRAM;
use crate::workflow::MovingMass;
use trocar_identify::{
    Estimate, Identification, IdentifyError, IdentifyOptions, Subject, identify,
};
use trocar_recording::cancel;
use trocar_recording::loads::Loads;
use trocar_recording::rows::Crop;
use trocar_recording::{
    ReadOptions, Readings, Recording, RecordingError, check_sensor_limit, digest_of, read, sha256,
};

/// Peak memory of an identification, in units of the recording's columns.
const PEAK_TO_COLUMNS: u64 = 5;

/// Extent of the identification of each recording.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Depth {
    /// The fit without the optional terms that only rests and partial reversals reveal.
    #[default]
    Quick,
    /// The same as `trocar identify`: if there are rests and partial reversals, the optional terms
    /// that need them are tried too.
    Full,
}

impl Depth {
    /// Name on the command line and in the table.
    pub fn name(self) -> &'static str {
        match self {
            Self::Quick => "quick",
            Self::Full => "full",
        }
    }
}

/// Configuration of the identification of each recording.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Config {
    /// Reading options; the memory limit is that of one identification as a whole.
    #[serde(flatten)]
    pub reading: ReadOptions,
    /// Extent of the identification.
    pub depth: Depth,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Mass between sensor and seal.
    pub moving_mass: MovingMass,
}

impl Config {
    /// Abbreviated SHA-256 of all that a row depends on in addition to the recording: this
    /// configuration and the program version.
    ///
    /// The memory limit is excluded: it decides whether there is a row, not its content.
    pub fn hash(&self) -> String {
        let mut all = serde_json::to_value(self).expect("a configuration is plain values");
        all["program"] = PROGRAM.into();
        // The journal holds cells by their place.
        all["table"] = super::row::columns().into_iter().map(|field| field.name).collect();
        all.as_object_mut().map(|keys| keys.remove("memory_limit_bytes"));
        let mut digest = sha256(all.to_string().as_bytes());
        digest.truncate(16);
        digest
    }

    /// Rejects a moving mass or a sensor that cannot be.
    ///
    /// # Errors
    /// [`RecordingError::OutOfRange`], or those of [`MovingMass::new`].
    pub fn check(&self) -> Result<(), RecordingError> {
        check_sensor_limit(self.reading.sensor_limit)?;
        MovingMass::new(self.moving_mass.mass, self.moving_mass.gravity).map(drop)
    }

    /// Reading options for columns that may use one part in `parts` of the memory.
    fn reading_of_columns(&self, parts: u64) -> ReadOptions {
        ReadOptions {
            memory_limit: self.reading.memory_limit.map(|bytes| bytes / parts),
            ..self.reading.clone()
        }
    }

    fn options(&self) -> IdentifyOptions {
        let usual = IdentifyOptions::default();
        IdentifyOptions {
            seed: self.seed,
            degrees: DEGREES,
            inertia_removed: self.moving_mass.mass > 0.0,
            free_motion: usual.free_motion && self.depth == Depth::Full,
            ..usual
        }
    }
}

/// Source of a recording.
#[derive(Debug, Clone)]
pub enum Input {
    /// A file of any format that [`read`] supports.
    File(PathBuf),
    /// Columns in memory; the name is used in the table.
    Columns {
        /// Name of the recording.
        name: String,
        /// The columns.
        readings: Box<Readings>,
    },
}

/// Why a row holds no parameters: the kind, for counting, and the full message.
struct Failure {
    kind: &'static str,
    message: String,
}

impl From<RecordingError> for Failure {
    fn from(error: RecordingError) -> Self {
        let kind = match &error {
            RecordingError::Open { .. } => CANNOT_OPEN,
            RecordingError::TooLarge { .. } => TOO_LARGE,
            _ => "cannot_read",
        };
        Self { kind, message: error.to_string() }
    }
}

impl From<IdentifyError> for Failure {
    fn from(error: IdentifyError) -> Self {
        let kind = match &error {
            IdentifyError::NoSteadySliding { .. } => "nothing_to_identify_from",
            IdentifyError::ForceSign { .. } => "force_sign",
            IdentifyError::NotAModel(_) => "not_a_model",
            _ => "cannot_identify",
        };
        Self { kind, message: error.to_string() }
    }
}

const CANNOT_OPEN: &str = "cannot_open";
const TOO_LARGE: &str = "too_large_for_memory";

/// Whether the failure may be temporary or specific to this machine: the recording itself may be
/// valid.
pub(super) fn is_passing(row: &FleetRow) -> bool {
    row.text("reason_kind").is_some_and(|kind| [CANNOT_OPEN, TOO_LARGE].contains(&kind))
}

/// Identifies one recording on its own: a pure function of the recording and `config`.
///
/// Failures are part of the row: `status` is `ok`, `doubtful` (data of the recording were lost, or
/// do not determine every parameter) or `failed`, with `reason_kind` and `reason`. A panic is a
/// failure, too.
///
/// Parallel parts run in the thread pool of the caller; [`Cancel::run`](cancel::Cancel::run) with
/// one thread keeps to one.
pub fn identify_one(input: &Input, config: &Config) -> FleetRow {
    let mut row = FleetRow::empty();
    describe(&mut row, input, config);
    let outcome = catch_unwind(AssertUnwindSafe(|| work(&mut row, input, config)));
    let failure = match outcome {
        Ok(Ok(())) => return row,
        Ok(Err(failure)) => failure,
        // Work that is cancelled is no fault of the recording: the journal would keep it as one.
        Err(panic) if cancel::is_cancelled(&*panic) => resume_unwind(panic),
        Err(panic) => Failure { kind: "panic", message: words_of(&*panic) },
    };
    fail(&mut row, failure.kind, &failure.message);
    row
}

fn fail(row: &mut FleetRow, kind: &str, reason: &str) {
    row.set("status", FleetCell::text("failed"));
    row.set("reason_kind", FleetCell::text(kind));
    row.set("reason", FleetCell::message(reason));
}

/// The row of a recording that no worker could finish.
pub(super) fn lost(name: &str, config: &Config, kind: &str, reason: &str) -> FleetRow {
    let mut row = FleetRow::empty();
    describe(&mut row, &Input::File(name.into()), config);
    fail(&mut row, kind, reason);
    row
}

fn words_of(panic: &(dyn Any + Send)) -> String {
    let text = panic
        .downcast_ref::<String>()
        .map(String::as_str)
        .or_else(|| panic.downcast_ref::<&str>().copied());
    format!("a defect of the program: {}", text.unwrap_or("no message"))
}

fn describe(row: &mut FleetRow, input: &Input, config: &Config) {
    let path = match input {
        Input::File(path) => path.display().to_string(),
        Input::Columns { name, .. } => name.clone(),
    };
    row.set("path", FleetCell::text(path));
    row.set("program", FleetCell::text(PROGRAM));
    row.set("config", FleetCell::text(config.hash()));
    row.set("depth", FleetCell::text(config.depth.name()));
    row.set("moving_mass_kg", FleetCell::number(config.moving_mass.mass));
}

fn work(row: &mut FleetRow, input: &Input, config: &Config) -> Result<(), Failure> {
    let recording = match input {
        Input::File(path) => {
            read(path, &config.reading_of_columns(PEAK_TO_COLUMNS)).inspect_err(|_| {
                row.set("sha256", sha256_of(path).map_or(FleetCell::Empty, FleetCell::Text));
            })?
        }
        Input::Columns { name, readings } => {
            // The reader of a file does both on its way.
            let chosen = cropped(flipped(readings, &config.reading), &config.reading);
            Recording::from_readings(name, &chosen, config.reading.sensor_limit)?
        }
    };
    let recording = recording.without_glitches();
    row.set_data(&recording);
    warnings(row, recording.quality.warnings.iter().map(|w| w.message.clone()).collect());
    let recordings = [config.moving_mass.subtracted_from(recording, &Loads::default(), 0.0)?];
    let found = identify(&recordings, &config.options(), &|_, _| ())?;
    result(row, &found, &recordings[0]);
    Ok(())
}

/// The readings with the requested sign of the force.
fn flipped<'a>(readings: &'a Readings, reading: &ReadOptions) -> Cow<'a, Readings> {
    if !reading.choice.flip_force {
        return Cow::Borrowed(readings);
    }
    Cow::Owned(Readings {
        force: readings.force.iter().map(|force| -force).collect(),
        ..readings.clone()
    })
}

/// The readings between the requested times, counted from the first.
fn cropped<'a>(readings: Cow<'a, Readings>, reading: &ReadOptions) -> Cow<'a, Readings> {
    let Some(kept) = Crop::new(&reading.choice).kept(&readings.time) else { return readings };
    Cow::Owned(readings.at(kept.iter().copied()))
}

/// The hash of a file, as for its recording; `None` if it cannot be read.
pub(super) fn sha256_of(path: &Path) -> Option<String> {
    digest_of(path).ok()
}

fn warnings(row: &mut FleetRow, all: Vec<String>) {
    row.set("warning_count", FleetCell::count(all.len()));
    row.set(
        "warnings",
        if all.is_empty() { FleetCell::Empty } else { FleetCell::message(&all.join("\n")) },
    );
}

fn parameter(row: &mut FleetRow, name: &str, estimate: &Estimate) {
    let [low, high] = estimate.ci95;
    row.set(name, FleetCell::number(estimate.value));
    row.set(&format!("{name}_lower"), FleetCell::number(low));
    row.set(&format!("{name}_upper"), FleetCell::number(high));
    row.set(&format!("{name}_determined"), FleetCell::Boolean(estimate.determined));
}

fn result(row: &mut FleetRow, found: &Identification, recording: &Recording) {
    for p in &found.parameters {
        parameter(row, &p.id.to_string(), &p.estimate);
    }
    let lost = !recording.quality.warnings.is_empty();
    let status = if lost || found.is_doubtful() { "doubtful" } else { "ok" };
    row.set("status", FleetCell::text(status));
    let messages = found.warnings.iter().map(|w| match &w.subject {
        // The recording's name has its own column.
        Subject::Recording(_) => w.message.clone(),
        subject => format!("{subject}: {}", w.message),
    });
    warnings(row, messages.collect());
    row.set_fit(found);
}
