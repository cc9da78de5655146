//! Sweeps: one model simulated many times, with parameters of seal, rig and motion drawn at random
//! or taken from a grid.
//!
//! Every run is a row of a table: its number, its seed, its parameters, and its results
//! ([`Outcome`]). A row depends only on the document and on its number, so any number of threads
//! gives the same table. A run with invalid parameters is a row with the reason; it does not stop
//! the sweep.
//!
//! - **Seals only**: all runs share one motion, and the seals are stepped in parallel
//!   ([`trocar_simulate::many`]).
//! - **Rigs and experiments**: each run moves its own virtual bench, and its seal is then stepped
//!   along the true motion.
//! - **Loops**: each run is a teleoperation loop with its seal as the trocar ([`crate::teleop`]).
//!
//! The seal starts in the state after the homing of the bench, fully deformed backwards; along a
//! file it starts undeformed.
//!
//! Memory: [`WINDOW`] rows for each thread at a time, with traces also their forces, and the
//! table's writer ([`trocar_tables::table::TableWriter`]).

pub mod config;
mod draw;
mod tally;
mod teleop;

use std::path::{Path as FilePath, PathBuf};

use rayon::prelude::*;
use thiserror::Error;
use trocar_model::batch::Many;
use trocar_model::{
    Element, ElementParams, Friction, ParamError, ParameterId, Seal, Stages, Tunable,
};

use crate::teleop::config as loops;
use trocar_identify::posterior::{self, DrawsError};
use trocar_recording::Choice as Columns;
use trocar_recording::RecordingError;
use trocar_runtime::model_file::{ModelFile, ModelFileError, file_of};
use trocar_simulate::bench::published::{self, PublishedError};
use trocar_simulate::bench::{self, BenchConfig, PlausibleSeals, Protocol, random_seal};
use trocar_simulate::cancel;
use trocar_simulate::many;
use trocar_simulate::simulate::Positions;
use trocar_tables::error::OutputError;
use trocar_tables::output::refuse_inputs;
use trocar_tables::table::{Column, Field, Kind, TableWriter};

pub use config::SweepConfig;
use config::line_of;
use draw::Drawn;
pub use tally::Outcome;
use tally::{Path, RESULTS, Tally};

/// Rows that one thread processes at a time.
pub const WINDOW: u64 = 256;

/// Rows of one task.
const TASK: u64 = 64;

/// Force that fully deforms every seal backwards, N.
const BACKWARDS: f64 = -1e6;

/// Columns of a seal drawn from published ranges or from a posterior.
const DRAWN_SEAL: [&str; 5] = [
    "half_width_m",
    "insertion_coulomb_force_n",
    "insertion_viscous_damping_n_s_m",
    "withdrawal_coulomb_force_n",
    "withdrawal_viscous_damping_n_s_m",
];

/// Column of the posterior draw that a run has: its row in the file, from 0.
const POSTERIOR_ROW: &str = "posterior_row";

/// Why a sweep is not possible.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SweepError {
    /// The document is not valid TOML, or has unknown keys or wrong types of values.
    #[error("{0}\nhint: `trocar sweep --print-config` prints an example with every key")]
    Syntax(String),
    /// A distribution with invalid numbers. Here and below, line 0 means unknown.
    #[error("{}{key}: expected {wanted}", at(*line))]
    Form {
        /// Line of the document.
        line: usize,
        /// Name of the parameter.
        key: String,
        /// What was expected.
        wanted: &'static str,
    },
    /// The number of runs is zero.
    #[error("{}runs must be 1 or more", at(*line))]
    NoRuns {
        /// Line of the document.
        line: usize,
    },
    /// More rows than a table may have.
    #[error(
        "runs times the points of the grid make more than {limit} rows\n\nhint: fewer runs, or fewer values in `grid`"
    )]
    TooMany {
        /// Most rows.
        limit: u64,
    },
    /// No motion, or two.
    #[error(
        "[motion]: {why}\n\nhint: give protocol = \"validation\", file = \"motion.csv\", or teleop = \"default\""
    )]
    Motion {
        /// The problem.
        why: &'static str,
    },
    /// No such protocol.
    #[error("[motion]: {unknown}")]
    Protocol {
        /// The name found and those available.
        unknown: String,
    },
    /// Published ranges together with a model or its parameters.
    #[error("{}like draws the whole seal of each run\n\nhint: leave out model and [seal]", at(*line))]
    LikeAlone {
        /// Line of the document.
        line: usize,
    },
    /// Posterior draws together with published ranges or parameters of the seal.
    #[error("{}posterior gives the whole seal of each run\n\nhint: leave out like and [seal]", at(*line))]
    PosteriorAlone {
        /// Line of the document.
        line: usize,
    },
    /// Posterior draws without the model they belong to.
    #[error(
        "{}posterior needs the model whose parameters were drawn\n\nhint: give model, the model.json beside the draws",
        at(*line)
    )]
    PosteriorNeedsModel {
        /// Line of the document.
        line: usize,
    },
    /// The draws cannot be read.
    #[error(transparent)]
    Draws(#[from] DrawsError),
    /// No published ranges of this key, or none of forces.
    #[error(transparent)]
    Published(#[from] PublishedError),
    /// A parameter that the model does not have.
    #[error("{}[seal] has no {key:?} for this model\n\nhint: it has {known}", at(*line))]
    UnknownParameter {
        /// Line of the document.
        line: usize,
        /// The key found.
        key: String,
        /// Keys that exist.
        known: String,
    },
    /// A key that the rig or the loop does not have, or that is not a number there.
    #[error(
        "{}[{section}] has no number {key:?}\n\nhint: `{command} --print-config` prints them; write \"{example}\"",
        at(*line)
    )]
    UnknownKey {
        /// Line of the document.
        line: usize,
        /// Its section.
        section: &'static str,
        /// Command that prints the keys.
        command: &'static str,
        /// A key that there is.
        example: &'static str,
        /// The key found.
        key: String,
    },
    /// A rig with a model that the bench does not support.
    #[error(
        "[rig]: the virtual bench holds EMS elements, not a {kind} model\n\nhint: leave [rig] empty"
    )]
    RigNeedsElements {
        /// Kind of the model.
        kind: &'static str,
    },
    /// The document of the rig or of the loop cannot be read.
    #[error("{}: cannot read the document: {source}", path.display())]
    ReadDocument {
        /// Its file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The rig's document is invalid.
    #[error("{}: {source}", path.display())]
    Rig {
        /// Its file.
        path: PathBuf,
        /// The problem.
        source: bench::ConfigError,
    },
    /// The loop's document is invalid.
    #[error("{}: {source}", path.display())]
    Loop {
        /// Its file.
        path: PathBuf,
        /// The problem.
        source: loops::ConfigError,
    },
    /// The experiment that defines the motion does not end.
    #[error(transparent)]
    Bench(#[from] bench::BenchError),
    /// Error of the model file.
    #[error(transparent)]
    Model(#[from] ModelFileError),
    /// Invalid parameters.
    #[error(transparent)]
    Parameter(#[from] ParamError),
    /// Error of the motion file.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The motion has fewer than two rows.
    #[error("{}: a motion needs two rows or more", path.display())]
    TooShort {
        /// Its file.
        path: PathBuf,
    },
    /// Error of the table or a trace.
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// The line in a document, if known.
fn at(line: usize) -> String {
    if line == 0 { String::new() } else { format!("line {line}: ") }
}

/// A sweep, ready to run.
pub struct Sweep {
    config: SweepConfig,
    model: ModelFile,
    seals: Seals,
    protocol: Option<Protocol>,
    /// The complete document of the rig, or of the loop.
    document: toml::Table,
    /// Files that the document names.
    inputs: Vec<PathBuf>,
    /// The motion shared by all runs; none if each run has its own rig or loop.
    shared: Option<Path>,
    /// For each parameter of the seal, the indices of [`Seal::tunables`] that it sets.
    places: Vec<Vec<usize>>,
    /// Current values of the parameters, the seal's before the rig's.
    present: Vec<f64>,
}

/// Where the seal of a run is from.
enum Seals {
    /// The model, with the parameters of the run.
    Model,
    /// Published ranges, from which each run draws its own.
    Like(Box<PlausibleSeals>),
    /// Posterior draws of the model.
    Draws(Vec<Stages>),
}

/// What a caller gives in place of what a document names.
#[derive(Default)]
pub struct Given {
    /// Model.
    pub model: Option<ModelFile>,
    /// Posterior draws of its parameters.
    pub draws: Option<Vec<Stages>>,
}

/// Summary of a sweep.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Summary {
    /// Rows of the table.
    pub rows: u64,
    /// Rows without a result.
    pub failed: u64,
    /// Reason of the first failure.
    pub first_failure: Option<String>,
}

/// One row before it is written.
struct SweepRow {
    drawn: Drawn,
    outcome: Result<Vec<f64>, String>,
}

impl Sweep {
    /// Reads the files named in the document `text`, relative to `folder`.
    ///
    /// # Errors
    /// [`SweepError`] with the line: the document, a name that model or rig does not have, a file.
    pub fn new(text: &str, folder: &FilePath) -> Result<Self, SweepError> {
        Self::of(SweepConfig::from_toml(text)?, text, folder, Given::default())
    }

    /// The same with a document already parsed from `text` (for the lines in messages; may be
    /// empty), and with what is `given` in place of what it names.
    ///
    /// # Errors
    /// As for [`Sweep::new`].
    pub fn of(
        config: SweepConfig,
        text: &str,
        folder: &FilePath,
        given: Given,
    ) -> Result<Self, SweepError> {
        config.check(text)?;
        let seals = Seals::of(&config, text, folder, &given)?;
        let model = match (given.model, &config.model) {
            (Some(model), _) => model,
            (None, Some(path)) => ModelFile::read(&folder.join(path))?,
            (None, None) => ModelFile::plausible_10_5_mm()?,
        };
        let seal = *model.trocar.seal();
        let mut present = Vec::new();
        let mut places = Vec::new();
        for name in config.seal.keys() {
            let (own, value) =
                places_of(&seal, name).ok_or_else(|| unknown_parameter(text, &seal, name))?;
            places.push(own);
            present.push(value);
        }
        let document = match &config.motion.teleop {
            Some(name) => read_loop(name, folder)?,
            None => read_rig(config.motion.rig.as_deref().map(|path| folder.join(path)))?,
        };
        for (key, _) in config.surroundings() {
            if key == "seed" {
                let wanted = "no value: each run has a seed of its own, from that of the sweep";
                let line = line_of(text, "seed");
                return Err(SweepError::Form { line, key: key.clone(), wanted });
            }
            let unknown = || unknown_key(config.motion.teleop.is_some(), text, key);
            present.push(number_at(&document, key).ok_or_else(unknown)?);
        }
        let choices = config.seal.iter().chain(config.surroundings());
        for ((key, choice), present) in choices.zip(&present) {
            if choice.relative && *present == 0.0 {
                let wanted = "values of its own: it is 0, and so is every multiple of it";
                return Err(SweepError::Form {
                    line: line_of(text, key),
                    key: key.clone(),
                    wanted,
                });
            }
        }
        let protocol = config.motion.protocol.as_deref().and_then(|name| name.parse().ok());
        let motion = &config.motion;
        let named = [&config.model, &config.posterior, &motion.file, &motion.rig];
        let named = named.into_iter().flatten().map(PathBuf::as_path);
        let named = named.chain(motion.teleop.as_deref().map(FilePath::new));
        let inputs = named.map(|name| file_of(&folder.join(name))).collect();
        let mut sweep = Self {
            config,
            model,
            seals,
            protocol,
            document,
            inputs,
            shared: None,
            places,
            present,
        };
        sweep.shared = sweep.shared_path(folder)?;
        Ok(sweep)
    }

    fn shared_path(&self, folder: &FilePath) -> Result<Option<Path>, SweepError> {
        let own_rigs = !self.config.rig.is_empty();
        match (self.model.trocar.seal(), self.protocol, &self.config.motion.file) {
            (Seal::Classical(model), Some(_), _) if own_rigs => {
                Err(SweepError::RigNeedsElements { kind: model.kind() })
            }
            (_, Some(_), _) if own_rigs => Ok(None),
            (Seal::Ems(stages), Some(protocol), _) => Ok(Some(
                self.path_of_rig(&self.document, protocol, stages.elements(), self.config.seed)?
                    .without_readings(),
            )),
            (Seal::Classical(_), Some(protocol), _) => {
                let stand_in = ModelFile::plausible_10_5_mm()?;
                let path = self.path_of_rig(
                    &self.document,
                    protocol,
                    stand_in.stages()?.elements(),
                    self.config.seed,
                )?;
                Ok(Some(path.without_readings()))
            }
            (_, None, Some(file)) => read_path(&folder.join(file)).map(Some),
            (_, None, None) => Ok(None),
        }
    }

    /// Rows of the table.
    pub fn rows(&self) -> u64 {
        self.config.rows().unwrap_or(config::MAX_ROWS)
    }

    /// Samples of each run; 0 if the runs differ.
    pub fn samples(&self) -> usize {
        self.shared.as_ref().map_or(0, |path| path.position.len())
    }

    /// Runs all rows on all threads and writes the table `out`, and one file per run into the
    /// folder `traces`. `report` receives the number of rows done.
    ///
    /// # Errors
    /// [`SweepError::Output`], also where a file that the document names would be replaced; the table
    /// is then not created.
    pub fn run(
        &self,
        out: &FilePath,
        traces: Option<&FilePath>,
        mut report: impl FnMut(u64),
    ) -> Result<Summary, SweepError> {
        refuse_inputs([out], &self.inputs)?;
        let mut table = TableWriter::create(out, &self.fields())?;
        let summary = self.each(traces, |done, columns| {
            table.write(columns)?;
            report(done);
            Ok(())
        })?;
        table.commit()?;
        Ok(summary)
    }

    /// The same, passing the table to `take` piece by piece: the number of rows done and the
    /// columns of the new rows, in the order of [`Sweep::fields`].
    ///
    /// # Errors
    /// Those of `take`, and [`SweepError::Output`] for a trace that cannot be written.
    pub fn each(
        &self,
        traces: Option<&FilePath>,
        mut take: impl FnMut(u64, &[Column]) -> Result<(), SweepError>,
    ) -> Result<Summary, SweepError> {
        refuse_inputs(traces.map(|folder| folder.join("run_*.parquet")), &self.inputs)?;
        let mut summary = Summary { rows: self.rows(), ..Summary::default() };
        let window = WINDOW * rayon::current_num_threads() as u64;
        for from in (0..self.rows()).step_by(window as usize) {
            let to = (from + window).min(self.rows());
            let tasks: Vec<u64> = (from..to).step_by(TASK as usize).collect();
            let part = |first: &u64| self.part(*first, (first + TASK).min(to), traces);
            let parts: Result<Vec<Vec<SweepRow>>, SweepError> =
                tasks.par_iter().map(part).collect();
            let rows: Vec<SweepRow> = parts?.into_iter().flatten().collect();
            summary.see(&rows);
            take(to, &self.columns(from, &rows))?;
        }
        Ok(summary)
    }

    /// Columns of the table.
    pub fn fields(&self) -> Vec<Field> {
        let whole = ["run", "seed"].map(|name| Field::new(name, Kind::Integer));
        let surroundings = self.config.surroundings().map(|(key, _)| key);
        let parameters = self.config.seal.keys().chain(surroundings).map(Field::number);
        let row = Field::new(POSTERIOR_ROW, Kind::Integer);
        let row = matches!(self.seals, Seals::Draws(_)).then_some(row);
        let has_own = !matches!(self.seals, Seals::Model);
        let own = DRAWN_SEAL.iter().filter(|_| has_own).copied().map(Field::number);
        let drawn = row.into_iter().chain(own);
        let results = self.results().iter().copied().map(Field::number);
        let failure = Field::new("failure", Kind::Text);
        whole.into_iter().chain(parameters).chain(drawn).chain(results).chain([failure]).collect()
    }

    /// Names of the results.
    fn results(&self) -> &'static [&'static str] {
        if self.config.motion.teleop.is_some() { &teleop::RESULTS } else { &RESULTS }
    }

    fn columns(&self, first: u64, rows: &[SweepRow]) -> Vec<Column> {
        let numbers = (first..).take(rows.len()).map(|row| i64::try_from(row).ok()).collect();
        let seeds = rows.iter().map(|row| i64::try_from(row.drawn.seed).ok()).collect();
        let mut columns = vec![Column::Integer(numbers), Column::Integer(seeds)];
        for k in 0..self.config.seal.len() {
            columns.push(Column::Number(rows.iter().map(|row| row.drawn.seal[k]).collect()));
        }
        for k in 0..self.config.surroundings().count() {
            let number = |row: &SweepRow| row.drawn.surroundings[k];
            columns.push(Column::Number(rows.iter().map(number).collect()));
        }
        if matches!(self.seals, Seals::Draws(_)) {
            let row = |row: &SweepRow| row.drawn.posterior_row.and_then(|k| i64::try_from(k).ok());
            columns.push(Column::Integer(rows.iter().map(row).collect()));
        }
        if !matches!(self.seals, Seals::Model) {
            let own: Vec<[f64; 5]> = rows.iter().map(|row| drawn_numbers(&row.drawn)).collect();
            for k in 0..DRAWN_SEAL.len() {
                columns.push(Column::Number(own.iter().map(|numbers| numbers[k]).collect()));
            }
        }
        for k in 0..self.results().len() {
            let result =
                |row: &SweepRow| row.outcome.as_ref().map_or(f64::NAN, |numbers| numbers[k]);
            columns.push(Column::Number(rows.iter().map(result).collect()));
        }
        let failures =
            rows.iter().map(|row| row.outcome.as_ref().err().map(|why| why.clone().into()));
        columns.push(Column::Text(failures.collect()));
        columns
    }

    /// Rows from `from` up to, but not including, `to`.
    fn part(
        &self,
        from: u64,
        to: u64,
        traces: Option<&FilePath>,
    ) -> Result<Vec<SweepRow>, SweepError> {
        cancel::check();
        let drawn: Vec<Drawn> = (from..to).map(|row| self.draw(row)).collect();
        let seals: Vec<Result<Seal, String>> =
            drawn.iter().map(|drawn| self.tuned(drawn)).collect();
        let in_numbers = |found: Vec<Result<Outcome, String>>| {
            found.into_iter().map(|one| one.map(|found| found.numbers().to_vec())).collect()
        };
        let outcomes: Vec<Result<Vec<f64>, String>> = match &self.shared {
            Some(path) => in_numbers(self.along(path, &seals, from, traces)?),
            None if self.config.motion.teleop.is_some() => {
                self.loops(&seals, &drawn, from, traces)?
            }
            None => {
                let mut outcomes = Vec::with_capacity(seals.len());
                for (k, (seal, drawn)) in seals.iter().zip(&drawn).enumerate() {
                    cancel::check();
                    outcomes.push(self.on_rig(seal, drawn, from + k as u64, traces)?);
                }
                in_numbers(outcomes)
            }
        };
        Ok(drawn
            .into_iter()
            .zip(outcomes)
            .map(|(drawn, outcome)| SweepRow { drawn, outcome })
            .collect())
    }

    /// The parameters of a run, as absolute values.
    fn draw(&self, row: u64) -> Drawn {
        let mut drawn = Drawn::new(&self.config, row);
        let choices = self.config.seal.iter().chain(self.config.surroundings());
        let values = drawn.seal.iter_mut().chain(&mut drawn.surroundings);
        for ((value, (_, choice)), present) in values.zip(choices).zip(&self.present) {
            if choice.relative {
                *value *= present;
            }
        }
        match &self.seals {
            Seals::Model => {}
            Seals::Like(ranges) => {
                let own = Element::new(random_seal(ranges, drawn.seed));
                drawn.own = Some(own.map(Seal::from).map_err(|error| error.to_string()));
            }
            Seals::Draws(all) => {
                let (run, runs, count) =
                    (row % self.config.runs, self.config.runs, all.len() as u64);
                // Evenly spaced where there are more draws than runs at a point.
                let k = if runs < count { run * count / runs } else { run % count } as usize;
                (drawn.own, drawn.posterior_row) = (Some(Ok(all[k].into())), Some(k));
            }
        }
        drawn
    }

    fn tuned(&self, drawn: &Drawn) -> Result<Seal, String> {
        if let Some(own) = &drawn.own {
            return own.clone();
        }
        let mut values: Vec<f64> =
            self.model.trocar.seal().tunables().map(|tunable| tunable.value).collect();
        for (places, value) in self.places.iter().zip(&drawn.seal) {
            places.iter().for_each(|place| values[*place] = *value);
        }
        self.model.trocar.seal().tuned(&values).map_err(|error| error.to_string())
    }

    /// Runs all `seals` along one path in parallel.
    fn along(
        &self,
        path: &Path,
        seals: &[Result<Seal, String>],
        first: u64,
        traces: Option<&FilePath>,
    ) -> Result<Vec<Result<Outcome, String>>, SweepError> {
        let sound: Vec<Seal> = seals.iter().flatten().copied().collect();
        let singles: Option<Vec<Element>> = sound.iter().map(single).collect();
        let mut forces =
            vec![0.0; if traces.is_some() { sound.len() * path.position.len() } else { 0 }];
        let mut outcomes = match singles {
            // A quarter of the memory of seals, which may have four elements.
            Some(elements) => {
                let states: Vec<_> = elements.iter().map(|element| self.start(element)).collect();
                self.tally(path, &elements, &states, &mut forces)
            }
            None => {
                let states: Vec<_> = sound.iter().map(|seal| self.start(seal)).collect();
                self.tally(path, &sound, &states, &mut forces)
            }
        }
        .into_iter();
        if let Some(folder) = traces {
            let rows = (first..).zip(seals).filter(|(_, seal)| seal.is_ok()).map(|(row, _)| row);
            for (row, forces) in rows.zip(forces.chunks_exact(path.position.len())) {
                cancel::check();
                write_trace(folder, row, path, forces)?;
            }
        }
        let outcome = |seal: &Result<Seal, String>| match seal {
            Ok(_) => Ok(outcomes.next().unwrap_or(Outcome::NONE)),
            Err(why) => Err(why.clone()),
        };
        Ok(seals.iter().map(outcome).collect())
    }

    fn start<M: Friction>(&self, model: &M) -> M::State {
        model.rest_at_force(if self.protocol.is_some() { BACKWARDS } else { 0.0 })
    }

    fn tally<M: Many>(
        &self,
        path: &Path,
        models: &[M],
        states: &[M::State],
        forces: &mut [f64],
    ) -> Vec<Outcome> {
        let trocar = self.model.trocar.borrowed();
        let profile = trocar.profile().copied();
        let at_start = |state: &M::State| {
            let own = M::force(state);
            profile.map_or(own, |profile| profile.apply(path.start(), own))
        };
        let at_start: Vec<f64> = states.iter().map(at_start).collect();
        let mut tally = Tally::new(path, profile, &at_start, forces);
        many::alone(models, states, &path.steps, &mut tally);
        tally.outcomes()
    }

    /// One run on its own rig.
    fn on_rig(
        &self,
        seal: &Result<Seal, String>,
        drawn: &Drawn,
        row: u64,
        traces: Option<&FilePath>,
    ) -> Result<Result<Outcome, String>, SweepError> {
        let path =
            seal.as_ref().map_err(String::clone).and_then(|seal| self.path_of_run(seal, drawn));
        match path {
            Ok(path) => Ok(self.along(&path, std::slice::from_ref(seal), row, traces)?.remove(0)),
            Err(why) => Ok(Err(why)),
        }
    }

    fn path_of_run(&self, seal: &Seal, drawn: &Drawn) -> Result<Path, String> {
        let (Seal::Ems(stages), Some(protocol)) = (seal, self.protocol) else {
            return Err("no motion".into());
        };
        let mut rig = self.document.clone();
        for (key, value) in self.config.rig.keys().zip(&drawn.surroundings) {
            set_number(&mut rig, key, *value)?;
        }
        self.path_of_rig(&rig, protocol, stages.elements(), drawn.seed)
            .map_err(|error| error.to_string())
    }

    /// The true motion of a rig, with the readings of its sensor.
    fn path_of_rig(
        &self,
        rig: &toml::Table,
        protocol: Protocol,
        elements: &[Element],
        seed: u64,
    ) -> Result<Path, bench::BenchError> {
        let text = toml::to_string(rig).expect("a table has a TOML form");
        let run = bench::run(&BenchConfig::from_toml(&text)?, protocol, elements, seed)?;
        Ok(Path::new(run.time, run.truth.position, run.force))
    }
}

impl Summary {
    fn see(&mut self, rows: &[SweepRow]) {
        for why in rows.iter().filter_map(|row| row.outcome.as_ref().err()) {
            self.failed += 1;
            self.first_failure.get_or_insert_with(|| why.clone());
        }
    }
}

impl Seals {
    fn of(
        config: &SweepConfig,
        text: &str,
        folder: &FilePath,
        given: &Given,
    ) -> Result<Self, SweepError> {
        let draws = match (&given.draws, &config.posterior) {
            (Some(draws), _) => Some(draws.clone()),
            (None, Some(path)) => Some(posterior::read_models(&folder.join(path))?),
            (None, None) => None,
        };
        let has_model = given.model.is_some() || config.model.is_some();
        match (draws, &config.like) {
            (None, None) => Ok(Self::Model),
            (None, Some(_)) if has_model => {
                Err(SweepError::LikeAlone { line: line_of(text, "like") })
            }
            (None, Some(key)) => Ok(Self::Like(Box::new(published::study(key)?.seals()?))),
            (Some(_), like) if like.is_some() || !config.seal.is_empty() => {
                Err(SweepError::PosteriorAlone { line: line_of(text, "posterior") })
            }
            (Some(draws), _) if has_model => Ok(Self::Draws(draws)),
            (Some(_), _) => {
                Err(SweepError::PosteriorNeedsModel { line: line_of(text, "posterior") })
            }
        }
    }
}

/// The columns [`DRAWN_SEAL`]: of several elements the first.
fn drawn_numbers(drawn: &Drawn) -> [f64; 5] {
    let Some(Ok(Seal::Ems(stages))) = &drawn.own else { return [f64::NAN; 5] };
    let ElementParams { deformation, insertion, withdrawal, .. } = stages.first().params();
    [
        deformation.half_width(),
        insertion.coulomb_force,
        insertion.viscous_damping,
        withdrawal.coulomb_force,
        withdrawal.viscous_damping,
    ]
}

/// The element of a seal that has exactly one.
fn single(seal: &Seal) -> Option<Element> {
    match seal {
        Seal::Ems(stages) => {
            <[Element; 1]>::try_from(stages.elements()).ok().map(|[element]| element)
        }
        Seal::Classical(_) => None,
    }
}

/// The indices of [`Seal::tunables`] named `name`, of all elements if it names none, and the value
/// of the first.
fn places_of(seal: &Seal, name: &str) -> Option<(Vec<usize>, f64)> {
    let id: ParameterId = name.parse().ok()?;
    let fits = |own: &Tunable| own.id == id || ParameterId { element: None, ..own.id } == id;
    let found: Vec<_> = seal.tunables().enumerate().filter(|(_, tunable)| fits(tunable)).collect();
    let value = found.first()?.1.value;
    Some((found.iter().map(|(place, _)| *place).collect(), value))
}

fn unknown_parameter(text: &str, seal: &Seal, key: &str) -> SweepError {
    let mut known: Vec<String> = Vec::new();
    for Tunable { id, .. } in seal.tunables() {
        let name = ParameterId { element: None, ..id }.to_string();
        if !known.contains(&name) {
            known.push(name);
        }
    }
    SweepError::UnknownParameter {
        line: line_of(text, key),
        key: key.to_owned(),
        known: known.join(", "),
    }
}

fn unknown_key(is_loop: bool, text: &str, key: &str) -> SweepError {
    let [section, command, example] = match is_loop {
        true => ["teleop", "trocar teleop", "channel.delay_s"],
        false => ["rig", "trocar bench", "rod.mass_kg"],
    };
    let line = line_of(text, key);
    SweepError::UnknownKey { line, section, command, example, key: key.to_owned() }
}

/// The complete document of the loop `name`: one that is shipped, or a file.
fn read_loop(name: &str, folder: &FilePath) -> Result<toml::Table, SweepError> {
    let (path, text) = match loops::shipped(name) {
        Some(text) => (PathBuf::from(name), text.to_owned()),
        None => {
            let path = folder.join(name);
            let read = std::fs::read_to_string(&path);
            let failed = |source| SweepError::ReadDocument { path: path.clone(), source };
            (path.clone(), read.map_err(failed)?)
        }
    };
    let config = loops::Config::from_toml(&text);
    let config = config.map_err(|source| SweepError::Loop { path, source })?;
    Ok(toml::Table::try_from(config).expect("numbers and words always have a TOML form"))
}

/// The complete document of the rig.
fn read_rig(path: Option<PathBuf>) -> Result<toml::Table, SweepError> {
    let config = match path {
        None => BenchConfig::default(),
        Some(path) => {
            let read = std::fs::read_to_string(&path);
            let failed = |source| SweepError::ReadDocument { path: path.clone(), source };
            let text = read.map_err(failed)?;
            BenchConfig::from_toml(&text).map_err(|source| SweepError::Rig { path, source })?
        }
    };
    Ok(toml::Table::try_from(config).expect("numbers and words always have a TOML form"))
}

fn number_at(rig: &toml::Table, key: &str) -> Option<f64> {
    if let Some((section, rest)) = key.split_once('.') {
        return number_at(rig.get(section)?.as_table()?, rest);
    }
    let value = rig.get(key)?;
    value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64))
}

/// Sets the existing `key` to `value`; as an integer if the rig has one there.
fn set_number(rig: &mut toml::Table, key: &str, value: f64) -> Result<(), String> {
    if let Some((section, rest)) = key.split_once('.') {
        let inner =
            rig.get_mut(section).and_then(toml::Value::as_table_mut).ok_or("no such section")?;
        return set_number(inner, rest, value);
    }
    match rig.get_mut(key) {
        Some(toml::Value::Float(number)) => *number = value,
        Some(toml::Value::Integer(number)) if value.fract() == 0.0 && value.abs() < 1e9 => {
            *number = value as i64
        }
        _ => return Err(format!("{key} must be a whole number, got {value}")),
    }
    Ok(())
}

fn read_path(file: &FilePath) -> Result<Path, SweepError> {
    let mut rows = Positions::open(file, &Columns::default())?;
    let (mut time, mut position, mut reading) = (Vec::new(), Vec::new(), Vec::new());
    while let Some(step) = rows.advance()? {
        time.push(step.time);
        position.push(step.position);
        reading.push(step.reading.unwrap_or(f64::NAN));
    }
    match time.len() {
        0 | 1 => Err(SweepError::TooShort { path: file.to_owned() }),
        _ => Ok(Path::new(time, position, reading)),
    }
}

/// File of the trace of a row.
fn trace_file(folder: &FilePath, row: u64) -> PathBuf {
    folder.join(format!("run_{row:09}.parquet"))
}

fn write_trace(folder: &FilePath, row: u64, path: &Path, forces: &[f64]) -> Result<(), SweepError> {
    let fields = ["time_s", "position_m", "force_n"].map(Field::number);
    let mut table = TableWriter::create(trace_file(folder, row), &fields)?;
    let columns = [path.time.clone(), path.position.clone(), forces.to_vec()].map(Column::Number);
    table.write(&columns)?;
    Ok(table.commit()?)
}
