//! Error of the tissue force from a sensor outside the body, compensated in four ways, on the
//! virtual bench.
//!
//! ```text
//! cargo run --release -p trocar --example compensation [-- FOLDER]
//! ```
//! prints the tables of docs/explanation/compensation.md, and writes its drawing to
//! `FOLDER/figures/compensation.svg`.
//!
//! The bench identifies a seal from the steady and dynamic experiments and holds the validation
//! back. Then a hand moves the instrument into tissue and out again, with a load on the tip for a
//! while; half way through the seal is wetted. Every method gets the same readings; the truth is
//! the bench's own.

use std::error::Error;
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

use rayon::prelude::*;
use trocar::bench::config::{Lubrication, TissueKind};
use trocar::bench::random::random_plausible_seal;
use trocar::bench::{BenchConfig, BenchRun, Protocol, run};
use trocar::compensate::{CompensateOptions, Compensator};
use trocar::identify::{IdentifyOptions, identify};
use trocar::model_file::ErrorSource;
use trocar::model_file::{ModelFile, Origin, OriginKind, SensorInfo};
use trocar::recording::Recording;
use trocar::report::{Axis, Document, Figure, Panel, Role, Section, Series, vectors};
use trocar::validate::validate;
use trocar_model::{
    BacklashFilter, BacklashState, Classical, Element, ElementParams, Seal, StaticFriction, Trocar,
};

/// Seeds of the runs scored.
const SEEDS: [u64; 5] = [11, 12, 13, 14, 15];
/// Normal quantile of a band of 95 %.
const BAND: f64 = 1.96;
/// Travel after a reversal that counts as its surroundings, m: the seal has snapped through.
const REVERSAL: f64 = 0.016;
/// Least travel that makes a reversal, m.
const TURN: f64 = 0.5e-3;
/// When the seal is wetted, s; from when on it counts as settled.
const ONSET: f64 = 60.0;
const SETTLED: f64 = 75.0;
/// Backlash width that keeps tremor from reversing the Coulomb friction, m.
const BACKLASH: f64 = 0.5e-3;
/// Friction of the wet seal over that of the dry one.
const WET: f64 = 0.65;
/// Random seals that are wetted, and the error of their models, N: that of the bench's sensor.
const WETTED_SEALS: u64 = 60;
const MODEL_ERROR_N: f64 = 0.05;
/// Error of the friction scale up to which it is followed, 1.
const FOLLOWED: f64 = 0.05;

fn main() -> Result<(), Box<dyn Error>> {
    for (title, kind) in
        [("Hunt-Crossley", TissueKind::HuntCrossley), ("Kelvin-Voigt", TissueKind::KelvinVoigt)]
    {
        let scores = scores(kind)?;
        println!("\n{title}: RMS error of the tissue force, N\n\n{}", scores.table());
        println!("the 95 % band of EMS and adaptation holds the truth in {}", scores.coverage());
    }
    println!("\n{}", adaptation(&adaptation_times()?));
    print_cost()?;
    if let Some(folder) = std::env::args().nth(1) {
        for (name, svg) in vectors(&document()?)? {
            let place = Path::new(&folder).join("figures").join(name);
            std::fs::write(place.with_extension("svg"), svg)?;
        }
    }
    Ok(())
}

/// The drawing.
pub(crate) fn document() -> Result<Document, Box<dyn Error>> {
    let seal = [Element::new(ElementParams::plausible_10_5_mm()?)?];
    let (ems, _) = models(&seal)?;
    let record = run(&surgery(TissueKind::HuntCrossley), Protocol::Surgeon, &seal, SEEDS[0])?;
    let section = Section::new("Compensation").figure(draw(&record, &ems)?);
    Ok(Document { title: "Compensation".into(), sections: vec![section], ..Document::default() })
}

/// Seconds from the beginning of the wetting until the friction scale has come within [`FOLLOWED`] of the true one to stay
/// there, for random seals in a hand's motion, each with its own model in the compensator; shortest first.
pub(crate) fn adaptation_times() -> Result<Vec<f64>, Box<dyn Error>> {
    let time = |seed: u64| -> Result<f64, Box<dyn Error + Send + Sync>> {
        let seal = [Element::new(random_plausible_seal(seed))?];
        let config = surgery(TissueKind::HuntCrossley);
        let record = run(&config, Protocol::Surgeon, &seal, seed)?;
        let mut model = ModelFile::new(seal[0], Origin::new(OriginKind::HandMade));
        let moving_mass_kg = config.rod.mass_kg;
        model.sensor = Some(SensorInfo { offset_n: 0.0, moving_mass_kg, ..SensorInfo::default() });
        let force_error_n = Some(MODEL_ERROR_N);
        let options = CompensateOptions { force_error_n, ..CompensateOptions::default() };
        let mut observer = Compensator::new(&model, &options)?;
        let mut late = ONSET;
        for k in 0..record.time.len() {
            let duration = if k == 0 { 0.0 } else { record.time[k] - record.time[k - 1] };
            observer.step(record.position[k], record.force[k], duration);
            if (observer.drift().level - record.truth.wetting[k]).abs() > FOLLOWED {
                late = record.time[k];
            }
        }
        let is_within = late < record.time[record.time.len() - 1];
        Ok(if is_within { late - ONSET } else { f64::INFINITY })
    };
    let times = (1..=WETTED_SEALS).into_par_iter().map(time);
    let mut times = times.collect::<Result<Vec<f64>, _>>().map_err(|e| -> Box<dyn Error> { e })?;
    times.sort_by(f64::total_cmp);
    Ok(times)
}

/// The times in words.
pub(crate) fn adaptation(times: &[f64]) -> String {
    let never = times.iter().filter(|time| time.is_infinite()).count();
    let held = &times[..times.len() - never];
    let at = |part: f64| held[(part * (held.len() - 1) as f64).round() as usize];
    format!(
        "Of {} random seals wetted to {WET} in a hand's motion, {} were followed to within {FOLLOWED} of the true friction scale in the \
         60 s that remained, after {:.0} to {:.0} s (median {:.0} s, 90 % within {:.0} s).",
        times.len(),
        held.len(),
        at(0.0),
        at(1.0),
        at(0.5),
        at(0.9)
    )
}

/// Time of a step, median over repetitions.
fn print_cost() -> Result<(), Box<dyn Error>> {
    let seal = [Element::new(ElementParams::plausible_10_5_mm()?)?];
    let (ems, _) = models(&seal)?;
    let record = run(&surgery(TissueKind::HuntCrossley), Protocol::Surgeon, &seal, SEEDS[0])?;
    for (name, adaptation) in [("fixed", false), ("adapting", true)] {
        let options = CompensateOptions { adaptation, ..CompensateOptions::default() };
        let mut times = Vec::new();
        for _ in 0..11 {
            let mut observer = Compensator::new(&ems, &options)?;
            let start = Instant::now();
            for (x, y) in record.position.iter().zip(&record.force) {
                black_box(observer.step(*x, *y, 1e-3));
            }
            times.push(1e9 * start.elapsed().as_secs_f64() / record.time.len() as f64);
        }
        times.sort_by(f64::total_cmp);
        println!("one sample, {name}: {:.0} ns (median of 11 runs)", times[5]);
    }
    Ok(())
}

/// Six seconds into the tissue dry and as long wet: motion, reading, tissue, level.
fn draw(record: &BenchRun, ems: &ModelFile) -> Result<Figure, Box<dyn Error>> {
    let mut observer = Compensator::new(ems, &CompensateOptions::default())?;
    let mut said = Vec::new();
    for k in 0..record.time.len() {
        let estimate =
            observer.step(record.position[k], record.force[k], if k == 0 { 0.0 } else { 1e-3 });
        said.push((estimate, observer.drift()));
    }
    let shown: Vec<usize> = (0..record.time.len()).step_by(20).collect();
    let of = |value: &dyn Fn(usize) -> f64| shown.iter().map(|k| value(*k)).collect::<Vec<f64>>();
    let time = of(&|k| record.time[k]);
    let line = |name: &str, role, value: &dyn Fn(usize) -> f64| {
        Series::line(name, role, time.clone(), of(value))
    };
    let band = |name: &str, low: &dyn Fn(usize) -> f64, high: &dyn Fn(usize) -> f64| {
        Series::band(name, Role::Model, time.clone(), of(low), of(high))
    };
    let panel = |name: &str, unit: &str| Panel::new(Axis::new("time", "s"), Axis::new(name, unit));
    let position = panel("position", "mm")
        .series(line("position", Role::Measured, &|k| 1e3 * record.position[k]))
        .aspect(0.16);
    let reading = panel("force", "N")
        .series(line("reading", Role::Measured, &|k| record.force[k]))
        .series(line("trocar, computed", Role::Deflection, &|k| said[k].0.trocar_force))
        .aspect(0.3);
    // The band before the first slide would hide the rest.
    let std = |k: usize| BAND * said[k].0.std.min(1.0);
    let tissue = panel("tissue force", "N")
        .series(band("95 % band", &|k| said[k].0.tissue_force - std(k), &|k| {
            said[k].0.tissue_force + std(k)
        }))
        .series(line("computed", Role::Model, &|k| said[k].0.tissue_force))
        .series(line("truth", Role::Reference, &|k| record.truth.tissue_force[k]))
        .aspect(0.3);
    let spread = |k: usize| BAND * said[k].1.level_std;
    let level = panel("friction scale", "1")
        .series(band("95 % band", &|k| said[k].1.level - spread(k), &|k| {
            said[k].1.level + spread(k)
        }))
        .series(line("followed", Role::Model, &|k| said[k].1.level))
        .series(line("truth", Role::Reference, &|k| record.truth.wetting[k]))
        .aspect(0.2);
    let caption = "(a) A hand's motion on the virtual bench, with tissue from 90 mm on (Hunt and Crossley) and a load of 1 N on the tip from 30 to 45 s; \
                   (b) reading of the sensor outside the body and the trocar's force as computed from the motion; (c) what is left for the \
                   tissue, beside the truth; (d) the seal's friction over that of the model: from 60 to 65 s the seal is wetted.";
    let figure =
        Figure::new("compensation", 1, "The tissue's force from a sensor outside the body");
    Ok(figure.panel(position).panel(reading).panel(tissue).panel(level).linked_x().caption(caption))
}

/// The EMS element from the bench's experiments, and Coulomb and viscous friction of the same
/// sliding force.
fn models(seal: &[Element]) -> Result<(ModelFile, ModelFile), Box<dyn Error>> {
    let config = BenchConfig::default();
    let record = |protocol| -> Result<Recording, Box<dyn Error>> {
        let made = run(&config, protocol, seal, 1)?.to_recording("bench")?;
        Ok(made.without_moving_mass(config.rod.mass_kg, 0.0)?)
    };
    let found = identify(
        &[record(Protocol::Steady)?, record(Protocol::Dynamic)?],
        &IdentifyOptions::default(),
        &|_, _| {},
    )?;
    let sensor = Some(SensorInfo {
        offset_n: found.model.offset,
        moving_mass_kg: config.rod.mass_kg,
        ..SensorInfo::default()
    });
    let held_out = [record(Protocol::Validation)?, record(Protocol::Surgeon)?];
    let file = |seal: Seal, error| ModelFile {
        sensor,
        force_error: Some(error),
        ..ModelFile::new(seal, Origin::new(OriginKind::Identified))
    };
    let error = validate(&Trocar::of_seal(found.stages), &held_out, found.model.offset)
        .force_error(ErrorSource::Validation);
    let sliding = found.element().params().insertion;
    let coulomb = Classical::Static(StaticFriction::new(sliding)?);
    let coarse = validate(&Trocar::of_seal(coulomb), &held_out, found.model.offset)
        .force_error(ErrorSource::Validation);
    Ok((file(found.stages.into(), error), file(coulomb.into(), coarse)))
}

fn surgery(kind: TissueKind) -> BenchConfig {
    let mut config = BenchConfig::default();
    config.protocol.surgeon.duration_s = 120.0;
    config.tissue.kind = kind;
    config.tissue.surface_m = 0.09;
    (config.tissue.load_n, config.tissue.load_from_s, config.tissue.load_until_s) =
        (1.0, 30.0, 45.0);
    config.lubrication =
        Lubrication { level: WET, onset_s: ONSET, spread_s: 5.0, ..config.lubrication };
    config
}

#[derive(Clone, Copy, Default)]
struct Sum {
    squares: f64,
    count: f64,
}

impl Sum {
    fn add(&mut self, value: f64) {
        self.squares += value * value;
        self.count += 1.0;
    }

    fn plus(self, other: Self) -> Self {
        Self { squares: self.squares + other.squares, count: self.count + other.count }
    }

    fn rms(self) -> f64 {
        (self.squares / self.count.max(1.0)).sqrt()
    }
}

/// Samples within [`REVERSAL`] after a turn of at least [`TURN`].
fn after_reversals(position: &[f64]) -> Vec<bool> {
    let (mut turned, mut direction, mut extreme) = (f64::NAN, 0.0, position[0]);
    let mut marks = Vec::with_capacity(position.len());
    for &x in position {
        if direction * (x - extreme) >= 0.0 && direction != 0.0 {
            extreme = x;
        } else if (x - extreme).abs() > TURN {
            (turned, direction, extreme) = (extreme, (x - extreme).signum(), x);
        }
        marks.push((x - turned).abs() < REVERSAL);
    }
    marks
}

/// Squares by method, part of the run (dry, changing, wet) and whether after a reversal; covered
/// samples by part.
#[derive(Default)]
pub(crate) struct Scores {
    errors: [[[Sum; 2]; 3]; 5],
    covered: [Sum; 3],
}

const METHODS: [&str; 5] =
    ["none", "Coulomb", "Coulomb after a backlash filter of 0.5 mm", "EMS", "EMS and adaptation"];

/// Every method along one run.
fn score(
    record: &BenchRun,
    [ems, coulomb]: [&ModelFile; 2],
    scores: &mut Scores,
) -> Result<(), Box<dyn Error>> {
    let fixed = CompensateOptions { adaptation: false, ..CompensateOptions::default() };
    let adapting = CompensateOptions::default();
    let mut sign = Compensator::new(coulomb, &fixed)?;
    let mut after_backlash = Compensator::new(coulomb, &fixed)?;
    let mut element = Compensator::new(ems, &fixed)?;
    let mut observer = Compensator::new(ems, &adapting)?;
    let (filter, mut backlash) = (BacklashFilter::new(BACKLASH)?, BacklashState::default());
    let offset = ems.sensor.map_or(0.0, |sensor| sensor.offset_n);
    let behind = after_reversals(&record.truth.position);
    let mut filtered = record.position[0];
    for k in 0..record.time.len() {
        let (x, y) = (record.position[k], record.force[k]);
        let duration = if k == 0 { 0.0 } else { record.time[k] - record.time[k - 1] };
        filtered += filter.displacement(&mut backlash, x);
        let truth = record.truth.tissue_force[k];
        let said = observer.step(x, y, duration);
        let errors = [
            y - offset - truth,
            sign.step(x, y, duration).tissue_force - truth,
            after_backlash.step(filtered, y, duration).tissue_force - truth,
            element.step(x, y, duration).tissue_force - truth,
            said.tissue_force - truth,
        ];
        let time = record.time[k];
        if time < 5.0 {
            continue;
        }
        let part = usize::from(time >= ONSET) + usize::from(time >= SETTLED);
        for (sum, error) in scores.errors.iter_mut().zip(errors) {
            sum[part][usize::from(behind[k])].add(error);
        }
        scores.covered[part].add(f64::from(u8::from(errors[4].abs() <= BAND * said.std)));
    }
    Ok(())
}

/// All runs with one law of the tissue.
pub(crate) fn scores(kind: TissueKind) -> Result<Scores, Box<dyn Error>> {
    let seal = [Element::new(ElementParams::plausible_10_5_mm()?)?];
    let (ems, coulomb) = models(&seal)?;
    let mut scores = Scores::default();
    for seed in SEEDS {
        let record = run(&surgery(kind), Protocol::Surgeon, &seal, seed)?;
        score(&record, [&ems, &coulomb], &mut scores)?;
    }
    Ok(scores)
}

impl Scores {
    pub(crate) fn table(&self) -> String {
        let mut table = "| compensation | dry | 15 s of change | wet | reversals, dry | reversals, change | reversals, wet |\n\
                         |---|---|---|---|---|---|---|\n"
            .to_owned();
        let rms = |sums: &[&Sum]| sums.iter().fold(Sum::default(), |a, b| a.plus(**b)).rms();
        for (name, sum) in METHODS.into_iter().zip(&self.errors) {
            let whole = sum.iter().map(|part| rms(&[&part[0], &part[1]]));
            let behind = sum.iter().map(|part| part[1].rms());
            let cells: Vec<String> =
                whole.chain(behind).map(|value| format!("{value:.3}")).collect();
            table += &format!("| {name} | {} |\n", cells.join(" | "));
        }
        table
    }

    /// How often the band of EMS with adaptation holds the true force, in words.
    pub(crate) fn coverage(&self) -> String {
        let [dry, change, wet] = self.covered.map(|sum| 100.0 * sum.squares / sum.count.max(1.0));
        format!("{dry:.1} % of the samples dry, {change:.1} % during the change and {wet:.1} % wet")
    }
}
