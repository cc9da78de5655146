//! `trocar simulate`

use std::path::PathBuf;

use trocar::model_file::{Model, ModelFile};
use trocar::recording::position_resolution;
use trocar::replay::start_states;
use trocar::simulate::{Drive, Guarded, Simulated, Single, simulate_file};
use trocar::travel::TravelProfile;
use trocar_model::Classical;
use trocar_model::{Deformation, Element, LiteralState, Mode, PaperLiteral, PlayGuard, State, step_parallel};

use crate::Done;
use crate::console::{BadArgument, Console};
use crate::input::{Choosing, finite, not_negative};
use crate::progress::Progress;
use crate::table::number;

/// Replay a model along a motion: force and deflection for every row
///
/// Writes the columns time_s, position_m, force_n, deflection_m and mode, one row per input row; for a classical model
/// (Coulomb to GMS) without the last two, since it knows no deflection. The force is the seal's alone, without the
/// sensor's offset, positive on insertion; where the model holds a profile along the way, it depends on the position. Rows are streamed: a file may be of any size. With several elements the
/// deflection is their mean.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Model file (model.json, or one of those that compare writes)
    model: PathBuf,
    /// Motion: CSV with time and position columns, '-' for standard input
    motion: PathBuf,
    /// Result: CSV, or Parquet, Arrow or packed CSV by its ending (.parquet, .arrow, .csv.gz, .csv.zst); '-' for CSV to
    /// standard output
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Deflection of the seal before the first row, in mm, positive on insertion [default: from the first force
    /// reading where the motion has one, else 0]; for EMS elements only
    #[arg(long, value_name = "MM", value_parser = finite, allow_negative_numbers = true)]
    initial_deflection_mm: Option<f64>,
    /// The paper's own reading of its model: mode and branch by the sign of the velocity; for EMS elements only
    #[arg(long)]
    literal: bool,
    /// Play between position and model, in m to either side: keeps the flicker of a resting encoder out of the force. 0
    /// is none; 'auto' takes 1.5 times the resolution that the first rows of a file show
    #[arg(long, default_value = "0", value_name = "WIDTH", value_parser = guard_width, allow_negative_numbers = true)]
    guard_m: GuardWidth,
    #[command(flatten)]
    choosing: Choosing,
}

/// Width of the play guard.
#[derive(Debug, Clone, Copy, PartialEq)]
enum GuardWidth {
    /// As given, m; 0 for none.
    Given(f64),
    /// From the resolution of the positions.
    Auto,
}

fn guard_width(text: &str) -> Result<GuardWidth, String> {
    if text == "auto" {
        return Ok(GuardWidth::Auto);
    }
    not_negative(text).map(GuardWidth::Given).map_err(|error| format!("{error}, in metres, or 'auto'"))
}

pub(crate) fn run(console: &Console, args: &Args) -> anyhow::Result<Done> {
    let model = ModelFile::read(&args.model)?;
    let offset = model.sensor.map_or(0.0, |sensor| sensor.offset_n);
    let elements = match &model.model {
        Model::Ems(elements) => elements,
        Model::Classical(classical) => {
            refuse_what_is_for_elements(args, classical)?;
            console.remark(&format!(
                "start: at rest with the first force reading less the offset of {offset:.3} N, or without force where \
                 the motion has none"
            ));
            stream(console, args, &mut Single::new(*classical, offset))?;
            return Ok(Done::Clean);
        }
    };
    if model.travel.is_some() && args.literal {
        console.remark("note: --literal leaves out how the force depends on the position");
    }
    let start = Start { deflection: args.initial_deflection_mm.map(|mm| 1e-3 * mm), offset, console };
    if args.literal {
        let literal: Result<Vec<PaperLiteral>, _> =
            elements.iter().map(|element| PaperLiteral::new(*element.params())).collect();
        stream(console, args, &mut Literal::new(literal?, start, elements))?;
    } else {
        let simulated = stream(console, args, &mut Natural::new(elements, model.travel.as_ref(), start))?;
        let profile = model.travel.as_ref();
        if let Some(departure) = profile.and_then(|p| p.departure(simulated.lowest, simulated.highest)) {
            console.warn(&departure.to_string());
        }
    }
    Ok(Done::Clean)
}

fn refuse_what_is_for_elements(args: &Args, classical: &Classical) -> Result<(), BadArgument> {
    let given = [("--literal", args.literal), ("--initial-deflection-mm", args.initial_deflection_mm.is_some())];
    let Some((flag, _)) = given.into_iter().find(|(_, given)| *given) else { return Ok(()) };
    let (file, kind) = (args.model.display(), classical.kind());
    Err(BadArgument(format!("{flag} is for EMS elements, but {file} holds a {kind} model")))
}

fn stream(console: &Console, args: &Args, drive: &mut impl Drive) -> anyhow::Result<Simulated> {
    match guard(console, args)? {
        Some(guard) => stream_bare(console, args, &mut Guarded::new(drive, guard)),
        None => stream_bare(console, args, drive),
    }
}

/// The play guard asked for, if any.
fn guard(console: &Console, args: &Args) -> anyhow::Result<Option<PlayGuard>> {
    match args.guard_m {
        GuardWidth::Given(width) => Ok(if width > 0.0 { Some(PlayGuard::new(width)?) } else { None }),
        GuardWidth::Auto => Ok(Some(guard_for_resolution(console, args)?)),
    }
}

/// The guard for what the first rows show: so only a file that can be read twice has one.
fn guard_for_resolution(console: &Console, args: &Args) -> anyhow::Result<PlayGuard> {
    let refuse = |why: &str| {
        let motion = args.motion.display();
        let hint = "give the width in metres, 1.5 resolutions of the encoder: --guard-m 6e-6 for 4 um";
        BadArgument(format!("--guard-m auto needs the resolution of the positions, {why}: {motion}\n\nhint: {hint}"))
    };
    if args.motion.as_os_str() == "-" || std::fs::metadata(&args.motion).is_ok_and(|data| !data.is_file()) {
        return Err(refuse("which a stream does not tell beforehand").into());
    }
    let resolution = position_resolution(&args.motion, &args.choosing.choice())?;
    if resolution == 0.0 {
        return Err(refuse("but they are whole multiples of no step").into());
    }
    let guard = PlayGuard::for_resolution(resolution)?;
    let (width, resolution) = (number(1e6 * guard.width()), number(1e6 * resolution));
    console.remark(&format!("guard: {width} um to either side, 1.5 times the resolution of {resolution} um"));
    Ok(guard)
}

fn stream_bare(console: &Console, args: &Args, drive: &mut impl Drive) -> anyhow::Result<Simulated> {
    let progress = Progress::new(console);
    let report = |part, rows| progress.report_rows("simulating", part, rows);
    let simulated = simulate_file(&args.motion, &args.choosing.choice(), drive, &args.out, report)?;
    drop(progress);
    console.remark(&format!("{} rows -> {}", simulated.rows, args.out.display()));
    Ok(simulated)
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
    travel: Option<&'a TravelProfile>,
    /// Where the instrument is, m.
    position: f64,
    states: Vec<State>,
    start: Start<'a>,
}

impl<'a> Natural<'a> {
    fn new(elements: &'a [Element], travel: Option<&'a TravelProfile>, start: Start<'a>) -> Self {
        Self { elements, travel, position: 0.0, states: Vec::new(), start }
    }
}

impl Drive for Natural<'_> {
    fn start_at(&mut self, position: f64, reading: Option<f64>) {
        self.position = position;
        let offset = self.start.offset;
        let level = |reading: f64| self.travel.map_or(reading, |t| offset + t.without(position, reading - offset));
        self.states = self.start.states(self.elements, reading.map(level));
    }

    fn step(&mut self, displacement: f64, duration: f64) -> f64 {
        self.step_to(self.position + displacement, displacement, duration)
    }

    fn step_to(&mut self, position: f64, displacement: f64, duration: f64) -> f64 {
        self.position = position;
        step_parallel(self.elements, &mut self.states, displacement, duration);
        self.force()
    }

    fn force(&self) -> f64 {
        let force = self.states.iter().map(State::force).sum();
        self.travel.map_or(force, |travel| travel.apply(self.position, force))
    }

    fn deformation(&self) -> Option<Deformation> {
        Some(Deformation::of(&self.states))
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

    fn deformation(&self) -> Option<Deformation> {
        let deflection = self.states.iter().map(LiteralState::deflection).sum::<f64>() / self.states.len() as f64;
        let slides = self.states.iter().all(|state| state.mode() == Mode::Sliding);
        Some(Deformation { deflection, mode: if slides { Mode::Sliding } else { Mode::Deforming } })
    }
}
