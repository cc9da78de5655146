//! Coverage of the 95 % band of the compensator on seals that the program has never met, on the
//! virtual bench.
//!
//! ```text
//! cargo run --release -p trocar --example compensation_band [-- SEALS [FOLDER]]
//! ```
//! prints the table of docs/explanation/compensation.md. Every seal is drawn at random, with a law between its
//! branches of its own, and identified from full strokes alone. Its model is validated on full
//! strokes, or on a hand's motion as well. Then the compensator runs on other motions with other
//! noise, dry and wetted on the way.
//!
//! FOLDER holds recordings of another seal, without tissue: steady.csv, dynamic.csv, validation.csv
//! and surgeon.csv of an instrument of 40 g. Its model is validated on full strokes, or on the
//! first half of surgeon.csv as well; scored is the second.

use std::error::Error;
use std::path::Path;

use rayon::prelude::*;
use trocar::bench::config::Lubrication;
use trocar::bench::random::random_plausible_seal;
use trocar::bench::{BenchConfig, Protocol, run};
use trocar::compensate::{CompensateOptions, Compensator};
use trocar::identify::{Identification, IdentifyOptions, identify};
use trocar::model_file::ModelFile;
use trocar::recording::{ReadOptions, Recording, read};
use trocar::workflow::{MovingMass, Workflow};
use trocar_model::{DeformationForce, Element, ElementParams};

/// Half-width of a 95 % band, in standard deviations.
const BAND: f64 = 1.96;
/// Time after which the start is forgotten, s.
const START: f64 = 5.0;
/// The wetting: friction that remains, when it begins, s, and how long it takes, s.
const WET: (f64, f64, f64) = (0.7, 12.0, 5.0);
/// Time from the beginning of the wetting on that is given apart, s.
const CHANGE: f64 = 15.0;
/// Seals without an argument.
const SEALS: u64 = 12;
/// Stiffest law between the branches over the softest: seals are drawn between the two, evenly in
/// proportion.
const STIFFEST: f64 = 10.0;

type Failure = Box<dyn Error + Send + Sync>;

/// Inside, outside and all samples.
#[derive(Clone, Copy, Default)]
struct Count {
    inside: f64,
    all: f64,
}

impl Count {
    fn percent(self) -> f64 {
        100.0 * self.inside / self.all.max(1.0)
    }
}

const MODELS: [&str; 2] = ["validated on full strokes", "validated on a hand's motion as well"];
const MOTIONS: [&str; 2] = ["full strokes", "hand"];
const PARTS: [&str; 3] = ["dry", "wetted", "of that the 15 s from the wetting on"];

/// By model, motion, adaptation and part.
type Counts = [[[[Count; 3]; 2]; 2]; 2];

fn main() -> Result<(), Failure> {
    let seals = std::env::args().nth(1).map_or(Ok(SEALS), |text| text.parse())?;
    if let Some(folder) = std::env::args().nth(2) {
        recorded(Path::new(&folder))?;
    }
    let found: Vec<Counts> = (0..seals).into_par_iter().map(one).collect::<Result<_, Failure>>()?;
    println!("| model | motion | adaptation | {} |", PARTS.join(" | "));
    println!("|---|---|---|{}", "---|".repeat(PARTS.len()));
    for (m, model) in MODELS.iter().enumerate() {
        for (k, motion) in MOTIONS.iter().enumerate() {
            for (a, adaptation) in ["no", "yes"].iter().enumerate() {
                let cell = |part: usize| {
                    let counts = found.iter().map(|counts| counts[m][k][a][part]);
                    let each: Vec<f64> = counts.clone().map(Count::percent).collect();
                    let sum = counts.fold(Count::default(), |s, c| Count {
                        inside: s.inside + c.inside,
                        all: s.all + c.all,
                    });
                    let low = each.iter().copied().fold(f64::INFINITY, f64::min);
                    let high = each.iter().copied().fold(0.0, f64::max);
                    format!("{:.1} ({low:.0} to {high:.0})", sum.percent())
                };
                let cells: Vec<String> = (0..PARTS.len()).map(cell).collect();
                println!("| {model} | {motion} | {adaptation} | {} |", cells.join(" | "));
            }
        }
    }
    Ok(())
}

/// The model with the error that its identification and `held_out` show.
fn model_of(
    found: &Identification,
    options: &IdentifyOptions,
    recordings: &[Recording],
    held_out: &[Recording],
    moving_mass: MovingMass,
) -> ModelFile {
    let (found, options) = (found.clone(), options.clone());
    Workflow::of(found, options, recordings.to_vec(), held_out.to_vec(), moving_mass).model_file()
}

/// Coverage on recordings without tissue.
fn recorded(folder: &Path) -> Result<(), Failure> {
    let mass = MovingMass { mass: 0.04, gravity: 0.0 };
    let file = |name: &str| read(&folder.join(name), &ReadOptions::default());
    let lighter = |recording: Recording| recording.without_moving_mass(mass.mass, 0.0);
    let training = [lighter(file("steady.csv")?)?, lighter(file("dynamic.csv")?)?];
    let options = IdentifyOptions { inertia_removed: true, ..IdentifyOptions::default() };
    let (strokes, hand) = (file("validation.csv")?, file("surgeon.csv")?);
    let half = hand.len() / 2;
    let held_out = [lighter(strokes.clone())?, lighter(hand.part(0..half, "first half")?)?];
    let second = hand.part(half..hand.len(), "second half")?;
    let found = identify(&training, &options, &|_, _| {})?;
    for (name, number) in MODELS.iter().zip([1, 2]) {
        let held_out = &held_out[..number];
        let model = model_of(&found, &options, &training, held_out, mass);
        println!("{name}: {:?}", model.force_error);
        for (motion, recording) in MOTIONS.iter().zip([&strokes, &second]) {
            for adaptation in [false, true] {
                let options = CompensateOptions { adaptation, ..CompensateOptions::default() };
                let mut observer = Compensator::new(&model, &options)?;
                let (mut count, mut squares) = (Count::default(), 0.0);
                for i in 0..recording.len() {
                    let duration =
                        if i == 0 { 0.0 } else { recording.time[i] - recording.time[i - 1] };
                    let said = observer.step(recording.position[i], recording.force[i], duration);
                    if recording.time[i] > recording.time[0] + START {
                        count.all += 1.0;
                        count.inside +=
                            f64::from(u8::from(said.tissue_force.abs() <= BAND * said.std));
                        squares += said.tissue_force.powi(2);
                    }
                }
                let rms = (squares / count.all).sqrt();
                println!(
                    "  {motion}, adaptation {adaptation}: {rms:.3} N rms, the band holds {:.1} %",
                    count.percent()
                );
            }
        }
    }
    Ok(())
}

/// A random seal with a random law between its branches; the first is the bench's own.
fn seal(seed: u64) -> Result<Element, Failure> {
    if seed == 0 {
        return Ok(Element::new(ElementParams::plausible_10_5_mm()?)?);
    }
    let mut params = random_plausible_seal(1000 + seed);
    let force = params.deformation;
    // A sequence that fills [0, 1) evenly.
    let part = (seed as f64 * 0.618_033_988_75).fract();
    let stiffness = force.yield_stiffness() * STIFFEST.powf(part);
    params.deformation =
        DeformationForce::new(*force.insertion(), *force.withdrawal(), Some(stiffness))?;
    Ok(Element::new(params)?)
}

fn one(seed: u64) -> Result<Counts, Failure> {
    let seal = [seal(seed)?];
    let config = BenchConfig::default();
    let mass = MovingMass { mass: config.rod.mass_kg, gravity: 0.0 };
    let record = |protocol, number: u64| -> Result<Recording, Failure> {
        let made = run(&config, protocol, &seal, 100 * seed + number)?.to_recording("bench")?;
        Ok(made.without_moving_mass(config.rod.mass_kg, 0.0)?)
    };
    let training = [record(Protocol::Steady, 1)?, record(Protocol::Dynamic, 2)?];
    let options = IdentifyOptions { inertia_removed: true, ..IdentifyOptions::default() };
    let found = identify(&training, &options, &|_, _| {})?;
    let strokes = record(Protocol::Validation, 3)?;
    let hand = record(Protocol::Surgeon, 4)?;
    let model = |held_out: &[Recording]| model_of(&found, &options, &training, held_out, mass);
    let models = [model(std::slice::from_ref(&strokes)), model(&[strokes.clone(), hand])];
    let mut counts = Counts::default();
    for (k, protocol) in [Protocol::Steady, Protocol::Surgeon].into_iter().enumerate() {
        for (wet, number) in [(false, 5), (true, 6)] {
            let mut config = config.clone();
            config.protocol.surgeon.duration_s = 60.0;
            (config.protocol.steady.stroke_m, config.protocol.steady.slowest_m_s) = (0.045, 0.02);
            if wet {
                let (level, onset_s, spread_s) = WET;
                config.lubrication = Lubrication { level, onset_s, spread_s, ..config.lubrication };
            }
            let record = run(&config, protocol, &seal, 100 * seed + number)?;
            for (m, model) in models.iter().enumerate() {
                for (a, adaptation) in [false, true].into_iter().enumerate() {
                    let options = CompensateOptions { adaptation, ..CompensateOptions::default() };
                    let mut observer = Compensator::new(model, &options)?;
                    for i in 0..record.time.len() {
                        let duration =
                            if i == 0 { 0.0 } else { record.time[i] - record.time[i - 1] };
                        let said = observer.step(record.position[i], record.force[i], duration);
                        let time = record.time[i];
                        if time < START {
                            continue;
                        }
                        let error = said.tissue_force - record.truth.tissue_force[i];
                        let changes = (WET.1..WET.1 + CHANGE).contains(&time);
                        for part in [Some(usize::from(wet)), (wet && changes).then_some(2)]
                            .into_iter()
                            .flatten()
                        {
                            let count = &mut counts[m][k][a][part];
                            count.all += 1.0;
                            count.inside += f64::from(u8::from(error.abs() <= BAND * said.std));
                        }
                    }
                }
            }
        }
    }
    Ok(counts)
}
