//! Arguments for reading recordings, shared by several verbs.

use std::path::{Path, PathBuf};

use anyhow::Context;
use trocar::compensate::CompensateOptions;
use trocar::model_file::ModelFile;
use trocar::recording::registry::FORMATS;
use trocar::recording::rows::BY_OWN_HEADER;
use trocar::recording::{
    Choice, Pieces, ReadOptions, Recording, RecordingError, WarningKind, read,
};
use trocar::summary::choice_for;
use trocar::workflow::MovingMass;

use crate::console::{BadArgument, Console};
use crate::progress::Progress;

/// Ratio of the peak memory of a whole identification to that of the recordings.
const PEAK_TO_COLUMNS: u64 = 5;

/// Headings of the options in the help of several commands. `-h` shows the options that most people need,
/// `--help` all of them.
const READING: &str = "Reading recordings";
const MOTION: &str = "Moving mass";
pub(crate) const STATISTICS: &str = "Statistics";
pub(crate) const OUTPUT: &str = "Output";

/// Help of an argument for files of any format that is read.
pub(crate) fn files(what: &str) -> String {
    let formats = FORMATS.iter().filter(|format| format.is_read()).map(|format| format.name);
    let others = formats.filter(|name| *name != FORMATS[0].name).collect::<Vec<_>>().join(", ");
    format!("{what}: CSV and other text ('-' for standard input), {others}")
}

/// What to take from a file.
#[derive(clap::Args)]
#[command(next_help_heading = READING)]
pub(crate) struct Choosing {
    /// Columns with their units: by name, with a minus to reverse the sign and a factor to scale, as
    /// in position_mm=x,force_n=-22.2*U (names with commas in double quotes); or in order, '-' to
    /// skip one, as in time_s,position_mm,-,force_n
    #[arg(long, value_name = "NAMES", overrides_with = "columns", allow_hyphen_values = true)]
    columns: Option<String>,
    /// Topic of a robot log, or group of a MATLAB or HDF5 file; may be repeated (see `trocar
    /// inspect`)
    #[arg(long, value_name = "NAME")]
    pub(crate) topic: Vec<String>,
    /// Leave out rows before this time, in s from the first row
    #[arg(long, value_name = "S", value_parser = finite, allow_negative_numbers = true, hide_short_help = true)]
    from_s: Option<f64>,
    /// Leave out rows from this time on, in s from the first row
    #[arg(long, value_name = "S", value_parser = finite, allow_negative_numbers = true, hide_short_help = true)]
    to_s: Option<f64>,
    /// Reverse the sign of the force, for a sensor mounted the other way round
    #[arg(long)]
    flip_force: bool,
    /// Lines to skip at the beginning of a text, before its header, if they are not recognised
    #[arg(long, default_value_t = 0, value_name = "N", hide_short_help = true)]
    skip_rows: u64,
    /// Rows per second of a file without a column of times
    #[arg(long, value_name = "HZ", value_parser = positive, overrides_with = "rate_hz")]
    rate_hz: Option<f64>,
}

impl Choosing {
    pub(crate) fn choice(&self) -> Choice {
        Choice {
            columns: self.columns.clone(),
            topics: self.topic.clone(),
            from: self.from_s,
            to: self.to_s,
            flip_force: self.flip_force,
            skip_rows: self.skip_rows,
            rate_hz: self.rate_hz,
            from_another_file: false,
        }
    }

    /// What to read for `model`: without options as its own recordings were read.
    pub(crate) fn choice_for(&self, console: &Console, model: &ModelFile) -> Choice {
        let own = self.choice();
        let Some(choice) = choice_for(model, &own) else { return own };
        console.remark(&format!(
            "note: read like the recordings of the model, with {}, unless the file lacks them",
            options_of(&choice)
        ));
        choice
    }
}

/// Says that `file` was read by its own header, not like the recordings of the model.
pub(crate) fn say_own_header(console: &Console, file: &Path) {
    console.remark(&format!("note: {}: {BY_OWN_HEADER}", file.display()));
}

/// The options of the command line that make this choice.
fn options_of(choice: &Choice) -> String {
    let columns = choice.columns.iter().map(|columns| format!("--columns '{columns}'"));
    let topics = choice.topics.iter().map(|topic| format!("--topic '{topic}'"));
    let flip = choice.flip_force.then(|| "--flip-force".to_owned());
    let skip = (choice.skip_rows > 0).then(|| format!("--skip-rows {}", choice.skip_rows));
    let rate = choice.rate_hz.map(|rate| format!("--rate-hz {rate}"));
    columns.chain(topics).chain(flip).chain(skip).chain(rate).collect::<Vec<_>>().join(" ")
}

/// Samples in memory when a recording is read in pieces: a quarter of an hour at 1 kHz.
const SAMPLES_IN_A_PIECE: usize = 1 << 20;

/// How to read the recordings.
#[derive(clap::Args)]
#[command(next_help_heading = READING)]
pub(crate) struct Reading {
    #[command(flatten)]
    pub(crate) choosing: Choosing,
    /// Largest force the sensor can read, in N; readings there count as saturated
    #[arg(long, value_name = "N", allow_negative_numbers = true, hide_short_help = true)]
    sensor_limit_n: Option<f64>,
    /// Most samples of a recording to identify from; of a longer recording, excerpts spread over
    /// the whole are used
    #[arg(long, default_value_t = 2_000_000, value_name = "N", hide_short_help = true)]
    most_samples: usize,
    /// Most memory to use, in MB (10^6 bytes) [default: what the system has available]
    #[arg(long, value_name = "MB", hide_short_help = true)]
    memory_limit_mb: Option<u64>,
}

impl Reading {
    /// Reads all files, prints what they have lost, and rejects files that do not fit into memory
    /// together. The caller says how they were read.
    pub(crate) fn recordings(
        &self,
        console: &Console,
        paths: &[PathBuf],
    ) -> anyhow::Result<Vec<Recording>> {
        one_standard_input(paths)?;
        let mut left = self.memory_limit_mb.map(|mb| mb * 1_000_000).or_else(available_memory);
        let mut recordings = Vec::with_capacity(paths.len());
        for path in paths {
            let recording =
                read(path, &self.options(left)).map_err(with_the_peak)?.without_glitches();
            left = left.map(|left| left.saturating_sub(PEAK_TO_COLUMNS * bytes_of(&recording)));
            recordings.push(recording);
        }
        let names = paths.iter().map(|path| path.display().to_string());
        say_losses(console, names.zip(&recordings));
        Ok(recordings)
    }

    /// Passes a recording on piece by piece, so that its length is not limited, and prints warnings
    /// about each piece. [`Choosing::choice_for`] gives the choice.
    pub(crate) fn pieces(
        &self,
        console: &Console,
        path: &Path,
        choice: &Choice,
        mut take: impl FnMut(Recording) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let options = ReadOptions { choice: choice.clone(), ..self.options(None) };
        let mut pieces = Pieces::open(path, &options, SAMPLES_IN_A_PIECE)?;
        let progress = Progress::new(console);
        let mut count = 0;
        while let Some(piece) = pieces.next_piece()? {
            let (part, rows) = pieces.progress();
            progress.report_rows("validating", part, rows);
            let mut piece = piece.without_glitches();
            if count > 0 {
                // A piece may consist of a rest only.
                piece.quality.warnings.retain(|warning| warning.kind != WarningKind::Stroke);
            }
            say_losses(console, [(path.display().to_string(), &piece)]);
            say_how_read(console, [&piece]);
            take(piece)?;
            count += 1;
        }
        drop(progress);
        if count > 1 {
            console.remark(&format!(
                "note: {}: taken in {count} pieces of {SAMPLES_IN_A_PIECE} samples, each from an unknown start; whiteness and scatter between \
                 strokes are those of the first",
                path.display()
            ));
        }
        Ok(())
    }

    /// The same for `count` recordings at a time. Each gets its share of the memory, a fifth of
    /// which its columns may fill.
    pub(crate) fn for_each_of(&self, count: usize) -> ReadOptions {
        let memory = self.memory_limit_mb.map(|mb| mb * 1_000_000).or_else(available_memory);
        ReadOptions {
            memory_limit: memory.map(|bytes| bytes / count.max(1) as u64),
            ..self.options(None)
        }
    }

    fn options(&self, memory: Option<u64>) -> ReadOptions {
        ReadOptions {
            choice: self.choosing.choice(),
            sensor_limit: self.sensor_limit_n,
            most_samples: Some(self.most_samples),
            memory_limit: memory.map(|bytes| bytes / PEAK_TO_COLUMNS),
        }
    }
}

/// What moves between sensor and seal.
#[derive(clap::Args)]
#[command(next_help_heading = MOTION)]
pub(crate) struct Rod {
    /// Mass between sensor and seal, in kg: its inertia is subtracted from the readings [default:
    /// estimated, if the motion determines it]
    #[arg(long, value_name = "KG", allow_negative_numbers = true)]
    moving_mass_kg: Option<f64>,
    /// Gravity along the insertion, in m/s^2, as it acts on the reading of the moving mass (9.81
    /// for a withdrawal downwards, -9.81 for an insertion downwards); needs --moving-mass-kg; 0
    /// leaves the weight in the offset
    #[arg(
        long,
        default_value_t = 0.0,
        value_name = "G",
        allow_negative_numbers = true,
        hide_short_help = true
    )]
    gravity_m_s2: f64,
}

impl Rod {
    pub(crate) fn moving_mass(&self) -> Result<MovingMass, RecordingError> {
        MovingMass::new(self.moving_mass_kg.unwrap_or(0.0), self.gravity_m_s2)
    }
}

/// States the memory for the whole computation, not only that of the columns.
fn with_the_peak(error: RecordingError) -> RecordingError {
    match error {
        RecordingError::TooLarge { file, rows, needed_mb, limit_mb } => RecordingError::TooLarge {
            file,
            rows,
            needed_mb: PEAK_TO_COLUMNS * needed_mb,
            limit_mb: PEAK_TO_COLUMNS * limit_mb,
        },
        other => other,
    }
}

/// Messages with what they concern; what several things have in common is said once.
pub(crate) fn said_once<M: ToString>(all: impl IntoIterator<Item = (String, M)>) -> Vec<String> {
    let mut lines: Vec<(String, String)> = Vec::new();
    for (subject, message) in all {
        let message = message.to_string();
        match lines.iter_mut().find(|(_, said)| *said == message) {
            Some((subjects, _)) => *subjects = format!("{subjects}, {subject}"),
            None => lines.push((subject, message)),
        }
    }
    lines.into_iter().map(|(subjects, message)| format!("{subjects}: {message}")).collect()
}

/// What the recordings have lost.
fn say_losses<'r>(
    console: &Console,
    recordings: impl IntoIterator<Item = (String, &'r Recording)>,
) {
    let warnings = recordings.into_iter().flat_map(|(name, recording)| {
        recording.quality.warnings.iter().map(move |warning| (name.clone(), warning))
    });
    said_once(warnings).iter().for_each(|warning| console.warn(warning));
}

/// How the files were read, in at most one line a file, if there is anything to say.
pub(crate) fn say_how_read<'r>(
    console: &Console,
    recordings: impl IntoIterator<Item = &'r Recording>,
) {
    let all = recordings.into_iter().map(|one| (one.name.clone(), one.quality.notes.join("; ")));
    let said = said_once(all.filter(|(_, notes)| !notes.is_empty()));
    said.iter().for_each(|line| console.remark(&format!("note: {line}")));
}

fn one_standard_input(paths: &[PathBuf]) -> Result<(), BadArgument> {
    if paths.iter().filter(|path| path.as_os_str() == "-").count() > 1 {
        return Err(BadArgument("standard input ('-') can be read once only".into()));
    }
    Ok(())
}

fn bytes_of(recording: &Recording) -> u64 {
    let columns = if recording.velocity.is_some() { 4 } else { 3 };
    (columns * size_of::<f64>() * recording.len()) as u64
}

/// Memory that the system can provide without swapping, in bytes; `None` if it does not report
/// this.
fn available_memory() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(1024 * kib)
}

/// The `what` that a file of TOML describes.
pub(crate) fn toml<T, E: std::error::Error + Send + Sync + 'static>(
    path: &Path,
    what: &str,
    parse: fn(&str) -> Result<T, E>,
) -> anyhow::Result<T> {
    let name = path.display();
    let text =
        std::fs::read_to_string(path).with_context(|| format!("{name}: cannot read the {what}"))?;
    parse(&text).with_context(|| name.to_string())
}

/// A finite number.
pub(crate) fn finite(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| "expected a number".to_owned())?;
    if number.is_finite() { Ok(number) } else { Err("expected a finite number".to_owned()) }
}

/// A positive finite number.
pub(crate) fn positive(text: &str) -> Result<f64, String> {
    finite(text).and_then(|number| {
        if number > 0.0 { Ok(number) } else { Err("expected a number above 0".to_owned()) }
    })
}

/// A finite number ≥ 0.
pub(crate) fn not_negative(text: &str) -> Result<f64, String> {
    finite(text).and_then(|number| {
        if number >= 0.0 { Ok(number) } else { Err("expected 0 or more".to_owned()) }
    })
}

/// Options of an observer of the tissue force.
#[derive(clap::Args)]
pub(crate) struct Observing {
    /// Reading of the sensor without any force, in N [default: that of the model file]
    #[arg(long, value_name = "N", value_parser = finite, allow_negative_numbers = true)]
    pub(crate) offset_n: Option<f64>,
    /// Mass between sensor and seal, in kg: its inertia is subtracted [default: that of the model
    /// file]
    #[arg(long, value_name = "KG", value_parser = finite, allow_negative_numbers = true)]
    pub(crate) moving_mass_kg: Option<f64>,
    /// Gravity along the insertion, in m/s^2, as it acts on the reading of the moving mass; needs
    /// an --offset-n without the weight, which the offset of a model file includes; 0 leaves the
    /// weight in the offset
    #[arg(long, default_value_t = 0.0, value_name = "G", value_parser = finite, allow_negative_numbers = true)]
    pub(crate) gravity_m_s2: f64,
    /// Largest force the sensor can read, in N: readings there count as saturated
    #[arg(long, value_name = "N", value_parser = positive)]
    pub(crate) sensor_limit_n: Option<f64>,
    /// Standard deviation of the model's force, in N [default: that of the model file, by phase]
    #[arg(long, value_name = "N", value_parser = positive, allow_negative_numbers = true)]
    pub(crate) force_error_n: Option<f64>,
    /// Keep friction and viscosity as identified
    #[arg(long)]
    pub(crate) no_adaptation: bool,
}

impl Observing {
    pub(crate) fn options(&self) -> CompensateOptions {
        CompensateOptions {
            offset_n: self.offset_n,
            flip_force: None,
            moving_mass_kg: self.moving_mass_kg,
            gravity_m_s2: self.gravity_m_s2,
            sensor_limit_n: self.sensor_limit_n,
            force_error_n: self.force_error_n,
            adaptation: !self.no_adaptation,
        }
    }
}
