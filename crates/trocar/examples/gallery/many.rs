//! Many seals: published ranges, drawn seals, and a fleet of recordings.

use std::path::Path;

use rayon::prelude::*;
use trocar::bench::published::{self, Quantity};
use trocar::bench::{BenchConfig, PlausibleSeals, random_seal};
use trocar::cancel::Cancel;
use trocar::fleet::{self, Config, Dataset};
use trocar::plan::{Goal, PlanConfig, plan};
use trocar::report::fleet::{Roles, document};
use trocar::report::plan::PlanReport;
use trocar::report::{self, Axis, Figure, Panel, Role, Series};
use trocar::workflow::MovingMass;
use trocar_model::{Element, ElementParams};

use super::{Outcome, chosen};

#[path = "../fleet_dataset/types.rs"]
mod types;

use types::{Specimen, TYPES};

pub(crate) const PICTURES: [&str; 3] = ["published-ranges", "drawn-seals", "plan"];
pub(crate) const FLEET: [&str; 1] = ["fleet"];

const MM: f64 = 1e3;

pub(crate) fn figures() -> Outcome<Vec<Figure>> {
    Ok(vec![published_ranges(), drawn_seals()?, planned()?])
}

/// What the literature prints: forces, and what wetting changes.
fn published_ranges() -> Figure {
    let forces = [Quantity::FrictionForceN, Quantity::ReversalFluctuationN];
    let changes = [Quantity::FrictionChangePercent, Quantity::PeakForceChangePercent];
    Figure::new("published-ranges", 1, "What the literature prints")
        .panel(ranges(&forces, Axis::new("force", "N").logarithmic()))
        .panel(ranges(&changes, Axis::new("change against the dry shaft", "%").with_zero()))
        .caption(
            "Ranges that studies of trocars print: (a) friction force at constant speed and its fluctuation at reversals, (b) the change by a wet or \
             oiled shaft. `trocar ranges` lists them with their conditions and words.",
        )
}

fn ranges(quantities: &[Quantity], axis: Axis) -> Panel {
    let (mut names, mut x, mut y) = (Vec::new(), Vec::new(), Vec::new());
    for study in published::studies().iter().rev() {
        for number in study.numbers.iter().filter(|n| quantities.contains(&n.quantity)) {
            let row = names.len() as f64;
            names.push(format!("{}: {}", study.key, number.quantity.words().0));
            x.extend([number.range[0], number.range[1], f64::NAN]);
            y.extend([row, row, f64::NAN]);
        }
    }
    let height = 0.12 + 0.09 * names.len() as f64;
    Panel::new(axis, Axis::named(names))
        .aspect(height)
        .series(Series::line("printed range", Role::Model, x.clone(), y.clone()))
        .series(Series::points("its ends", Role::Fit, x, y))
}

/// Force over position of seals drawn from published ranges.
fn drawn_seals() -> Outcome<Figure> {
    const SEALS: u64 = 400;
    const STROKE: f64 = 0.03;
    const STEPS: usize = 600;
    let ranges = PlausibleSeals::default();
    let loops: Vec<Vec<f64>> = (1..=SEALS)
        .into_par_iter()
        .map(|seed| one_cycle(random_seal(&ranges, seed), STROKE, STEPS))
        .collect::<Outcome<_>>()?;
    let x: Vec<f64> = (1..=STEPS).map(|k| MM * STROKE * k as f64 / STEPS as f64).collect();
    let at = |sample: usize, part: f64| {
        let mut forces: Vec<f64> = loops.iter().map(|one| one[sample]).collect();
        forces.sort_by(f64::total_cmp);
        forces[((forces.len() - 1) as f64 * part).round() as usize]
    };
    let mut panel = Panel::new(Axis::new("position", "mm"), Axis::new("force", "N")).aspect(0.55);
    for (first, role, name) in
        [(0, Role::Category(0), "insertion"), (STEPS, Role::Category(1), "withdrawal")]
    {
        let x: Vec<f64> =
            if first == 0 { x.clone() } else { x.iter().map(|x| MM * STROKE - x).collect() };
        let quantile =
            |part: f64| (first..first + STEPS).map(|k| at(k, part)).collect::<Vec<f64>>();
        panel = panel
            .series(Series::band(
                format!("{name}, 90 % of the seals"),
                role,
                x.clone(),
                quantile(0.05),
                quantile(0.95),
            ))
            .series(Series::band("", role, x.clone(), quantile(0.25), quantile(0.75)))
            .series(Series::line(format!("{name}, median"), role, x, quantile(0.5)));
    }
    Ok(Figure::new("drawn-seals", 1, "Seals that may be").panel(panel).caption(
        "One cycle at 20 mm/s of 400 seals drawn from plausible ranges: median, and the middle 50 and 90 %.",
    ))
}

/// Forces of the second cycle, insertion then withdrawal.
fn one_cycle(params: ElementParams, stroke: f64, steps: usize) -> Outcome<Vec<f64>> {
    const SPEED: f64 = 0.02;
    let element = Element::new(params)?;
    let mut state = element.rest_state(-params.deformation.half_width());
    let step = stroke / steps as f64;
    let mut forces = Vec::new();
    for direction in [1.0, -1.0, 1.0, -1.0] {
        for _ in 0..steps {
            forces.push(element.step(&mut state, direction * step, step / SPEED));
        }
    }
    Ok(forces.split_off(2 * steps))
}

/// What to record in two minutes.
fn planned() -> Outcome<Figure> {
    let config = PlanConfig { duration_s: 120.0, draws: 3, ..PlanConfig::default() };
    let goal = Goal::All;
    let planned = plan(&config, &goal, &[], &[], &|_, _| {})?;
    let input = PlanReport {
        config: &config,
        config_source: None,
        goal: &goal,
        plan: &planned,
        model: None,
        posterior: None,
        before: Vec::new(),
    };
    Ok(chosen(report::plan::document(&input), &[("motion", "plan")])?.remove(0))
}

const SPECIMENS: u64 = 3;
/// Insertions before each recording of a specimen.
const INSERTIONS: [u64; 4] = [0, 40, 80, 120];

/// Three types of trocars, three specimens of each, which wear.
pub(crate) fn fleet() -> Outcome<Vec<Figure>> {
    let folder = tempfile::tempdir()?;
    let specimens = (0..TYPES.len()).flat_map(|kind| (0..SPECIMENS).map(move |one| (kind, one)));
    let all: Vec<(usize, u64, u64)> = specimens
        .flat_map(|(kind, one)| INSERTIONS.map(|insertions| (kind, one, insertions)))
        .collect();
    let recordings = folder.path().join("recordings");
    all.par_iter().try_for_each(|one| record(&recordings, *one))?;
    let dataset = Dataset::open(&recordings, &[])?;
    let mass = MovingMass { mass: BenchConfig::default().rod.mass_kg, gravity: 0.0 };
    let config = Config { moving_mass: mass, seed: 1, ..Config::default() };
    let table = folder.path().join("table.csv");
    let found = fleet::run(&dataset, &config, &table, 0, &Cancel::default(), &mut |_| {})?;
    chosen(document(&found, &config, &Roles::default()), &[("drift", FLEET[0])])
}

fn record(folder: &Path, (kind, one, insertions): (usize, u64, u64)) -> Outcome<()> {
    let specimen = Specimen {
        kind,
        name: one.to_string(),
        factor: 1.0 + 0.12 * (one as f64 - 1.0),
        branches_seed: 1 + one,
        insertions,
    };
    let mut config = BenchConfig::default();
    config.protocol.validation.increment_m_s = 0.02;
    let seed = 1000 * kind as u64 + 10 * one + insertions;
    types::record(folder, &specimen, &config, (seed, usize::MAX))?;
    Ok(())
}
