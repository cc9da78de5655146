//! The virtual bench: recorded, identified, compared, and drawn from the posterior.

use trocar::bench::{BenchConfig, Protocol, run};
use trocar::compare::{self, Choice, CompareOptions, compare};
use trocar::identify::classical::Kind;
use trocar::identify::posterior::{Draws, Posterior};
use trocar::identify::{IdentifyOptions, identify};
use trocar::model_file::ModelFile;
use trocar::recording::Recording;
use trocar::recording::loads::Loads;
use trocar::replay::replay;
use trocar::report::identification::{self, FigureChoice, IdentificationReport};
use trocar::report::{Axis, Figure, Mark, Panel, Role, Series, Width, comparison};
use trocar::workflow::{MovingMass, Workflow};
use trocar_model::Unit;

use super::{Outcome, chosen, thinned};

pub(crate) const IDENTIFIED: [&str; 9] = [
    "static-friction",
    "deformation-velocity",
    "deformation-force",
    "cross-validation",
    "velocity-step",
    "friction-scale",
    "residual-statistics",
    "hand",
    "intervals",
];
pub(crate) const COMPARED: [&str; 2] = ["every-model", "error-by-parameters"];
pub(crate) const DRAWN: [&str; 2] = ["posterior", "draws-of-the-branch"];

/// Of noise, fluctuation and hand.
const SEED: u64 = 1;
const MM: f64 = 1e3;

fn record(protocol: Protocol) -> Outcome<Recording> {
    let file = ModelFile::plausible_10_5_mm()?;
    let mut config = BenchConfig::default();
    config.protocol.surgeon.duration_s = 30.0;
    let done = run(&config, protocol, file.stages()?.elements(), SEED)?;
    Ok(done.to_recording(protocol.name())?)
}

fn options() -> IdentifyOptions {
    IdentifyOptions { seed: SEED, ..IdentifyOptions::default() }
}

/// As `trocar demo` does, with the rod weighed.
fn workflow() -> Outcome<Workflow> {
    let training = [Protocol::Steady, Protocol::Dynamic].map(record);
    let held_out = [Protocol::Validation, Protocol::Surgeon].map(record);
    let mass = MovingMass { mass: BenchConfig::default().rod.mass_kg, gravity: 0.0 };
    let training = training.into_iter().collect::<Outcome<Vec<_>>>()?;
    let held_out = held_out.into_iter().collect::<Outcome<Vec<_>>>()?;
    Ok(Workflow::run(training, held_out, mass, options(), &|_, _| {})?)
}

pub(crate) fn identified() -> Outcome<Vec<Figure>> {
    let done = workflow()?;
    let truth = ModelFile::plausible_10_5_mm()?;
    let document = identification::document(&IdentificationReport {
        identification: &done.identification,
        own: &done.own,
        range: done.range,
        held_out: done.held_out.as_ref(),
        truth: Some(truth.stages()?.elements()),
        options: &done.options,
        moving_mass: done.moving_mass,
        command: None,
        title: "",
        choice: FigureChoice::default(),
    });
    let own: Vec<(&str, &str)> = IDENTIFIED[..7].iter().map(|id| (*id, *id)).collect();
    let mut figures = chosen(document, &own)?;
    figures.push(hand(&done)?);
    figures.push(intervals(&done)?);
    Ok(figures)
}

/// Ten seconds of a hand-like motion that the identification has not seen.
fn hand(done: &Workflow) -> Outcome<Figure> {
    let held_out = done.held_out.iter().flat_map(|held_out| &held_out.recordings);
    let recording = held_out.last().ok_or("a hand was recorded")?;
    let (from, to) = (8_000, 18_000);
    let model = &done.identification;
    let replayed = replay(&model.trocar(), recording, model.model.offset);
    let time = thinned(&recording.time[from..to], 5, 1.0);
    let line = |name: &str, role, column: &[f64], scale| {
        Series::line(name, role, time.clone(), thinned(&column[from..to], 5, scale))
    };
    let measured: Vec<f64> = recording.force.iter().map(|f| f - model.model.offset).collect();
    let axis = || Axis::new("time", "s");
    let position = Panel::new(axis(), Axis::new("position", "mm")).aspect(0.18).series(line(
        "position",
        Role::Neutral,
        &recording.position,
        MM,
    ));
    let forces = Panel::new(axis(), Axis::new("force", "N"))
        .aspect(0.34)
        .series(line("measured", Role::Measured, &measured, 1.0))
        .series(line("model", Role::Model, &replayed.force, 1.0));
    let error: Vec<f64> = measured.iter().zip(&replayed.force).map(|(a, b)| a - b).collect();
    let residual = Panel::new(axis(), Axis::new("difference", "N")).aspect(0.14).series(line(
        "measured − model",
        Role::Residual,
        &error,
        1.0,
    ));
    Ok(Figure::new("hand", 1, "A hand, measured and modelled")
        .panel(position)
        .panel(forces)
        .panel(residual)
        .linked_x()
        .caption(
            "Hand-like motion on the virtual bench: sub-movements, rests, small reversals and tremor. The model was identified from constant-velocity \
             strokes and has not seen this recording.",
        ))
}

/// What the parameters are, relative to the truth.
fn intervals(done: &Workflow) -> Outcome<Figure> {
    let truth = ModelFile::plausible_10_5_mm()?;
    let truth = *truth.stages()?.first().params();
    let (mut names, mut low, mut high, mut found) = (vec![], vec![], vec![], vec![]);
    for parameter in &done.identification.parameters {
        let id = parameter.id;
        let real = truth.value(id.direction, id.quantity);
        let Some(real) = real.filter(|value| *value > 0.0 && id.element.is_none()) else {
            continue;
        };
        let percent = |value: f64| 100.0 * (value / real - 1.0);
        let ends = parameter.estimate.ci95.map(percent);
        if parameter.estimate.determined && ends.iter().all(|end| end.is_finite()) {
            names.push(id.symbol().to_string());
            found.push(percent(parameter.estimate.value));
            low.push(ends[0]);
            high.push(ends[1]);
        }
    }
    let rows: Vec<f64> = (0..names.len()).map(|k| k as f64).collect();
    let bars = rows.iter().zip(low.iter().zip(&high)).fold(
        (Vec::new(), Vec::new()),
        |(mut x, mut y), (row, (low, high))| {
            x.extend([*low, *high, f64::NAN]);
            y.extend([*row, *row, f64::NAN]);
            (x, y)
        },
    );
    let panel = Panel::new(Axis::new("deviation from the truth", "%"), Axis::named(names))
        .aspect(0.42)
        .series(Series::line("95 % interval", Role::Model, bars.0, bars.1))
        .series(Series::points("estimate", Role::Fit, found, rows))
        .mark(Mark::x(0.0, ""));
    Ok(Figure::new("intervals", 1, "Parameters with their intervals").panel(panel).caption(
        "Estimates and 95 % intervals from two recordings of the virtual bench, relative to the parameters that the bench was run with.",
    ))
}

/// Models that are compared.
fn models() -> Vec<Choice> {
    let classical = [Kind::Coulomb, Kind::Stribeck, Kind::Dahl, Kind::LuGre, Kind::Leuven(4)];
    let banks = [1, 4, 10].into_iter().flat_map(|n| [Kind::MaxwellSlip(n), Kind::Gms(n)]);
    let all = classical.into_iter().chain(banks).map(Choice::Classical);
    [Choice::Ems, Choice::EmsOutputError].into_iter().chain(all).collect()
}

pub(crate) fn compared() -> Outcome<Vec<Figure>> {
    let mass = MovingMass { mass: BenchConfig::default().rod.mass_kg, gravity: 0.0 };
    let read = |protocol| Ok(mass.subtracted_from(record(protocol)?, &Loads::default(), 0.0)?);
    let read = |all: &[Protocol]| all.iter().map(|p| read(*p)).collect::<Outcome<Vec<_>>>();
    let training = read(&[Protocol::Steady])?;
    let validation = read(&[Protocol::Step, Protocol::Validation])?;
    let identify = IdentifyOptions { inertia_removed: true, ..options() };
    let options = CompareOptions { models: models(), identify, timing: false };
    let comparison = compare(&training, &validation, &options, &|_, _| {})?;
    let outcome = compare::Outcome { comparison, seed: SEED, held_out: false, moving_mass: mass };
    let names = [("one-reversal", COMPARED[0]), (COMPARED[1], COMPARED[1])];
    chosen(comparison::document(&outcome, ""), &names)
}

fn posterior() -> Outcome<Posterior> {
    let recordings = [record(Protocol::Steady)?, record(Protocol::Dynamic)?];
    let options = IdentifyOptions { free_motion: false, posterior: Draws::new(600), ..options() };
    let found = identify(&recordings, &options, &|_, _| {})?;
    Ok(found.posterior.ok_or("there are no draws")?)
}

/// Parameters of the corner plot.
const CORNER: [&str; 3] = ["coulomb_force_n", "viscous_damping_n_s_m", "half_width_m"];

pub(crate) fn drawn() -> Outcome<Vec<Figure>> {
    let posterior = posterior()?;
    Ok(vec![corner(&posterior)?, branch(&posterior)?])
}

/// Name and unit for an axis, the draws in that unit, and the truth.
fn column(posterior: &Posterior, name: &str) -> Outcome<(Axis, Vec<f64>, f64)> {
    let at = posterior.parameters.iter().position(|p| p.id.to_string() == name);
    let at = at.ok_or_else(|| format!("no draws of {name}"))?;
    let id = posterior.parameters[at].id;
    let Unit { scale, shown, .. } = id.unit();
    let values = posterior.draws.iter().map(|draw| scale * draw.values[at]).collect();
    let truth = *ModelFile::plausible_10_5_mm()?.stages()?.first().params();
    let truth = truth.value(id.direction, id.quantity);
    let truth = truth.ok_or_else(|| format!("no true {name}"))?;
    Ok((Axis::new(id.symbol().to_string(), shown), values, scale * truth))
}

fn corner(posterior: &Posterior) -> Outcome<Figure> {
    let columns = CORNER.iter().map(|name| column(posterior, name)).collect::<Outcome<Vec<_>>>()?;
    let mut figure = Figure::new("posterior", 1, "Draws of the posterior").columns(3).caption(
        "600 draws of Coulomb force, viscous damping and half width after two recordings of the virtual bench: pairs and, on the diagonal, their \
         distribution. Dashed: the truth.",
    );
    for (row, (y_axis, y, y_true)) in columns.iter().enumerate() {
        for (at, (x_axis, x, x_true)) in columns.iter().enumerate() {
            let panel = if row == at {
                let (edges, counts) = histogram(x);
                Panel::new(x_axis.clone(), Axis::new("draws", "").with_zero())
                    .series(Series::band(
                        "",
                        Role::Model,
                        edges.clone(),
                        vec![0.0; edges.len()],
                        counts.clone(),
                    ))
                    .series(Series::line("", Role::Model, edges, counts))
            } else {
                Panel::new(x_axis.clone(), y_axis.clone())
                    .series(Series::points("", Role::Category(0), x.clone(), y.clone()))
                    .mark(Mark::y(*y_true, ""))
            };
            figure = figure.panel(panel.aspect(0.9).mark(Mark::x(*x_true, "")));
        }
    }
    Ok(figure)
}

/// Edges and counts as steps.
fn histogram(values: &[f64]) -> (Vec<f64>, Vec<f64>) {
    const BINS: usize = 24;
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let mut counts = [0.0; BINS];
    for value in values {
        counts[(((value - low) / (high - low) * BINS as f64) as usize).min(BINS - 1)] += 1.0;
    }
    let edge = |k: usize| low + (high - low) * k as f64 / BINS as f64;
    let x = (0..BINS).flat_map(|k| [edge(k), edge(k + 1)]).collect();
    (x, counts.iter().flat_map(|count| [*count; 2]).collect())
}

/// The branches of many draws.
fn branch(posterior: &Posterior) -> Outcome<Figure> {
    let models = trocar::draws::models(&trocar::draws::table(posterior))?;
    let truth = *ModelFile::plausible_10_5_mm()?.stages()?.first().params();
    let grid: Vec<f64> = (-120..=120).map(|k| 1e-4 * f64::from(k)).collect();
    let [mut low, mut high, mut x] = [Vec::new(), Vec::new(), Vec::new()];
    for z in &grid {
        let mut forces: Vec<f64> = models
            .iter()
            .map(|stages| {
                stages.first().params().deformation.insertion().force(*z)
                    - truth.deformation.insertion().force(*z)
            })
            .collect();
        forces.sort_by(f64::total_cmp);
        let at = |part: f64| forces[((forces.len() - 1) as f64 * part).round() as usize];
        if z.abs() <= truth.deformation.half_width() {
            x.push(MM * z);
            low.push(1e3 * at(0.025));
            high.push(1e3 * at(0.975));
        }
    }
    let zero = Series::line("truth", Role::Reference, x.clone(), vec![0.0; x.len()]);
    let panel = Panel::new(Axis::new("deflection z", "mm"), Axis::new("difference", "mN"))
        .aspect(0.5)
        .series(Series::band("95 % of the draws", Role::Model, x, low, high))
        .series(zero)
        .mark(Mark::x(MM * truth.deformation.insertion().join(), "join"));
    Ok(Figure::new("draws-of-the-branch", 1, "How well the branch is known")
        .width(Width::Narrow)
        .panel(panel)
        .caption("The branch of insertion in 600 draws less the true one, over the deflection."))
}
