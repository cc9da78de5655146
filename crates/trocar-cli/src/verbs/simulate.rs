//! `trocar simulate`

use std::path::{Path, PathBuf};

use trocar::model_file::ModelFile;
use trocar::replay::start_states;
use trocar::simulate::{Drive, simulate_file};
use trocar_model::{Element, LiteralState, Mode, PaperLiteral, State, step_parallel};

use crate::Done;
use crate::console::Console;
use crate::input::finite;
use crate::progress::Progress;

/// Replay a model along a motion: force and deflection for every row
///
/// Writes the columns time_s, position_m, force_n, deflection_m and mode, one row per input row. The force is the
/// seal's alone, without the sensor's offset, positive on insertion. Rows are streamed: a file may be of any size.
/// With several elements the deflection is their mean.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Model file (model.json)
    model: PathBuf,
    /// Motion: CSV with time and position columns, '-' for standard input
    motion: PathBuf,
    /// Result: a CSV file, '-' for standard output
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Deflection of the seal before the first row, in mm, positive on insertion [default: from the first force
    /// reading where the motion has one, else 0]
    #[arg(long, value_name = "MM", value_parser = finite, allow_negative_numbers = true)]
    initial_deflection_mm: Option<f64>,
    /// The paper's own reading of its model: mode and branch by the sign of the velocity
    #[arg(long)]
    literal: bool,
    /// Names of the columns in order, with units, '-' to skip one: time_s,position_mm,-
    #[arg(long, value_name = "NAMES")]
    columns: Option<String>,
}

pub(crate) fn run(console: &Console, args: &Args) -> anyhow::Result<Done> {
    let model = ModelFile::read(&args.model)?;
    let start =
        Start { deflection: args.initial_deflection_mm.map(|mm| 1e-3 * mm), offset: offset_of(&model), console };
    if args.literal {
        let elements: Result<Vec<PaperLiteral>, _> =
            model.elements.iter().map(|element| PaperLiteral::new(*element.params())).collect();
        stream(console, args, &mut Literal::new(elements?, start, &model.elements))?;
    } else {
        stream(console, args, &mut Natural::new(&model.elements, start))?;
    }
    Ok(Done::Clean)
}

fn offset_of(model: &ModelFile) -> f64 {
    model.sensor.map_or(0.0, |sensor| sensor.offset_n)
}

fn stream(console: &Console, args: &Args, drive: &mut impl Drive) -> anyhow::Result<()> {
    let progress = Progress::new(console);
    let size = size_of_file(&args.motion);
    let report = |bytes: u64| progress.report("simulating", size.map_or(0.0, |size| bytes as f64 / size as f64));
    let rows = simulate_file(&args.motion, args.columns.as_deref(), drive, &args.out, report)?;
    drop(progress);
    console.remark(&format!("{rows} rows -> {}", args.out.display()));
    Ok(())
}

fn size_of_file(path: &Path) -> Option<u64> {
    let size = std::fs::metadata(path).ok()?.len();
    (size > 0).then_some(size)
}

/// Where the seal stands before the first row.
struct Start<'a> {
    /// As given, m.
    deflection: Option<f64>,
    /// Sensor offset in force readings, N.
    offset: f64,
    console: &'a Console,
}

impl Start<'_> {
    /// States at rest: as given, else from the first reading, else at zero.
    fn states(&self, elements: &[Element], reading: Option<f64>) -> Vec<State> {
        if let Some(deflection) = self.deflection {
            return elements.iter().map(|element| element.rest_state(deflection)).collect();
        }
        let Some(reading) = reading else {
            self.console.remark("start: deflection 0 mm, for the motion has no force; see --initial-deflection-mm");
            return elements.iter().map(|element| element.rest_state(0.0)).collect();
        };
        let states = start_states(elements, reading - self.offset);
        let deflections: Vec<String> = states.iter().map(|state| format!("{:.3}", 1e3 * state.deflection())).collect();
        self.console.remark(&format!(
            "start: deflection {} mm, from the first reading of {reading} N less the offset of {:.3} N",
            deflections.join(", "),
            self.offset
        ));
        states
    }
}

/// The elements with the contact as an inclusion.
struct Natural<'a> {
    elements: &'a [Element],
    states: Vec<State>,
    start: Start<'a>,
}

impl<'a> Natural<'a> {
    fn new(elements: &'a [Element], start: Start<'a>) -> Self {
        Self { elements, states: Vec::new(), start }
    }
}

impl Drive for Natural<'_> {
    fn start(&mut self, reading: Option<f64>) {
        self.states = self.start.states(self.elements, reading);
    }

    fn step(&mut self, displacement: f64, duration: f64) -> f64 {
        step_parallel(self.elements, &mut self.states, displacement, duration)
    }

    fn force(&self) -> f64 {
        self.states.iter().map(State::force).sum()
    }

    fn deflection(&self) -> f64 {
        self.states.iter().map(State::deflection).sum::<f64>() / self.states.len() as f64
    }

    fn mode(&self) -> Mode {
        slides(self.states.iter().map(State::mode))
    }
}

/// The elements as the paper prints them.
struct Literal<'a> {
    elements: Vec<PaperLiteral>,
    states: Vec<LiteralState>,
    start: Start<'a>,
    natural: &'a [Element],
}

impl<'a> Literal<'a> {
    fn new(elements: Vec<PaperLiteral>, start: Start<'a>, natural: &'a [Element]) -> Self {
        Self { elements, states: Vec::new(), start, natural }
    }
}

impl Drive for Literal<'_> {
    fn start(&mut self, reading: Option<f64>) {
        let states = self.start.states(self.natural, reading);
        self.states = states.iter().map(|state| LiteralState::new(state.deflection())).collect();
    }

    fn step(&mut self, displacement: f64, duration: f64) -> f64 {
        let velocity = displacement / duration;
        let pairs = self.elements.iter().zip(&mut self.states);
        pairs.map(|(element, state)| element.step_velocity(state, velocity, duration)).sum()
    }

    fn force(&self) -> f64 {
        self.states.iter().map(LiteralState::force).sum()
    }

    fn deflection(&self) -> f64 {
        self.states.iter().map(LiteralState::deflection).sum::<f64>() / self.states.len() as f64
    }

    fn mode(&self) -> Mode {
        slides(self.states.iter().map(LiteralState::mode))
    }
}

/// The seal slides once all its elements do.
fn slides(mut modes: impl Iterator<Item = Mode>) -> Mode {
    if modes.all(|mode| mode == Mode::Sliding) { Mode::Sliding } else { Mode::Deforming }
}
