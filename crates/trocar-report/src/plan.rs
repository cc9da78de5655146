//! Creates a report from a planned motion.

use trocar_model::{Quantity, Unit};

use super::document::{Cell, Document, Section, Table, Tile, origin};
use super::figures::plan as figures;
use super::figures::{MM, name_of, teleop::keys};
use super::number::significant;
use super::teleop::Source;
use trocar_lab::plan::{Goal, Plan, PlanConfig, Prediction};
use trocar_lab::summary::PROGRAM;

/// Precision for which more time is stated, relative.
pub const PRECISION: f64 = 0.05;

/// What a report on a plan shows.
#[derive(Debug, Clone)]
pub struct PlanReport<'a> {
    /// Rig, noise and prior.
    pub config: &'a PlanConfig,
    /// Its file; `None` for the defaults, or limits that were read from a recording.
    pub config_source: Option<Source>,
    /// What the motion is for.
    pub goal: &'a Goal,
    /// The motion, and what to expect of it.
    pub plan: &'a Plan,
    /// Model of the seal; `None` for seals from the prior.
    pub model: Option<Source>,
    /// Posterior draws of the model, for which the motion is planned; `None` for the model itself.
    pub posterior: Option<Source>,
    /// Recordings that were there already.
    pub before: Vec<Source>,
}

/// The report: what to expect, the motion and what its segments tell, the intervals of all
/// parameters, rig and prior.
///
/// Equal input gives equal documents.
pub fn document(input: &PlanReport) -> Document {
    Document {
        title: "What to record".to_owned(),
        subtitle: subtitle(input),
        card: Vec::new(),
        tiles: tiles(input),
        warnings: warning(input).into_iter().collect(),
        notes: Vec::new(),
        sections: vec![motion(input), expected(input), configuration(input.config)],
        provenance: provenance(input),
    }
}

fn subtitle(input: &PlanReport) -> String {
    let seals = match (&input.model, input.config.draws) {
        (Some(model), draws) if input.posterior.is_some() => {
            format!("planned with {draws} posterior draws of {}", model.name())
        }
        (Some(model), _) => format!("planned with {}", model.name()),
        (None, 1) => "planned with a seal from the prior".to_owned(),
        (None, draws) => format!("planned with {draws} seals from the prior"),
    };
    format!("Motion for {}, {seals}", input.goal)
}

fn warning(input: &PlanReport) -> Option<String> {
    let lost: Vec<String> = input.plan.undetermined().map(|p| name_of(p.id)).collect();
    (!lost.is_empty()).then(|| {
        format!(
            "This motion will not determine: {}. More time, a longer travel or a finer encoder may help.",
            lost.join(", ")
        )
    })
}

fn tiles(input: &PlanReport) -> Vec<Tile> {
    let plan = input.plan;
    let cycles = plan.segments.len();
    let mut tiles = vec![Tile::new(
        "Time of the motion",
        format!("{} s", significant(plan.duration_s(), 3)),
        format!("{cycles} cycles of an insertion and a withdrawal"),
    )];
    for quantity in [Quantity::CoulombForce, Quantity::ViscousDamping, Quantity::HalfWidth] {
        let found = plan.expected.iter().find(|p| p.id == quantity.id());
        let Some((prediction, relative)) = found.and_then(|p| Some((p, p.relative_half_width?)))
        else {
            continue;
        };
        let Unit { scale, shown, .. } = prediction.id.unit();
        tiles.push(Tile::new(
            format!("95 % interval of {}", prediction.id.symbol()),
            format!("±{} %", significant(1e2 * relative, 2)),
            format!("±{} {shown}", significant(scale * prediction.half_width, 2)),
        ));
    }
    tiles
}

/// What the end of a motion is for, which turns the instrument from `from`, s, on.
pub fn turning(from: f64) -> String {
    format!(
        "From {} s on the instrument turns: told the diameter of the shaft, identify finds stiffness and friction around it. \
         What is expected of them is that of a seal as stiff and rough around the shaft as along it.",
        significant(from, 4)
    )
}

fn motion(input: &PlanReport) -> Section {
    let table = Table::of(
        "What the motion consists of",
        &input.plan.shares,
        &[
            ("Cycles", &|share| share.block.interruption.to_string().into()),
            ("Speed (mm/s)", &|share| Cell::number(MM * share.block.speed_m_s, 3)),
            ("Stroke (mm)", &|share| Cell::number(MM * share.block.length_m, 3)),
            ("Number", &|share| Cell::number(share.count as f64, share.count.to_string().len())),
            ("Time (s)", &|share| Cell::number(share.duration_s, 3)),
            ("Information (%)", &|share| Cell::number(1e2 * share.information.max(0.0), 2)),
        ],
    );
    let section = Section::new("The motion").paragraph(
        "The order is random, so that a drift of the friction does not look like viscous friction; speeds, lengths, partial reversals \
         and rests are those that tell most in the time. Information of a kind of cycle: the part of the precision about the goal that \
         is lost without it.",
    );
    let turns = input.plan.turning_from_s.map(turning);
    turns
        .into_iter()
        .fold(section, Section::paragraph)
        .figure(figures::motion(input.plan))
        .table(table)
}

fn expected(input: &PlanReport) -> Section {
    let plan = input.plan;
    let paper = plan.paper.as_ref();
    let head = paper.map(|(duration, _)| format!("Paper, {duration:.0} s"));
    let time = format!("More time for ±{:.0} % (s)", 1e2 * PRECISION);
    let columns = ["Parameter", "Unit", "Value", "Half width", "Of the value (%)", "Worst seal"];
    let columns = columns.into_iter().chain(head.as_deref()).chain([time.as_str()]);
    let caption = "Half widths of the 95 % intervals to expect: medians over the seals";
    let listed = plan.expected.iter().filter(|p| !p.is_coefficient());
    let table = listed.fold(Table::new(caption, columns), |table, p| {
        let Unit { scale, shown, .. } = p.id.unit();
        let scaled = |value: f64| Cell::number(scale * value, 3);
        let relative = p.relative_half_width.map_or(f64::NAN, |r| 1e2 * r);
        let mut row = vec![
            format!("{} {}", name_of(p.id), p.id.symbol()).into(),
            shown.into(),
            scaled(p.value),
            if p.determined { scaled(p.half_width) } else { Cell::Undetermined },
            Cell::number(relative, 3),
            scaled(p.largest_half_width),
        ];
        let of_paper = |paper: &[Prediction]| {
            p.among(paper).map_or("–".into(), |own| scaled(own.half_width))
        };
        row.extend(paper.map(|(_, paper)| of_paper(paper)));
        row.push(match plan.time_for(p, PRECISION).map(|time| time - plan.duration_s()) {
            Some(more) if more > 0.0 => Cell::number(more, 3),
            Some(_) => "none".into(),
            None => "–".into(),
        });
        table.row(row)
    });
    let section = Section::new("What to expect").table(table).paragraph(
        "Intervals as identify computes them, with the noise below. Paper: the protocol of its section IV-A on the same rig. More time: of \
         motions like this one, if intervals shrink with the root of the time.",
    );
    let section = match (plan.needed_s, input.goal) {
        (Some(needed), Goal::Parameter(..)) => section.paragraph(needed_in_words(plan, needed)),
        _ => section,
    };
    match paper {
        Some(_) => section,
        None => section.paragraph(format!("{PAPER}.")),
    }
}

/// Why the paper's protocol is not compared.
pub const PAPER: &str = "The paper's protocol is not compared: it needs 120 mm of travel and speeds from 15 to 100 mm/s";

/// How much longer the precision asked for takes.
fn needed_in_words(plan: &Plan, needed: f64) -> String {
    let more = needed - plan.duration_s();
    if needed <= 0.0 {
        "The recordings that are there reach the precision asked for.".to_owned()
    } else if more > 0.0 {
        format!("The precision asked for needs some {more:.0} s more.")
    } else {
        format!("The precision asked for is reached after some {needed:.0} s.")
    }
}

fn configuration(config: &PlanConfig) -> Section {
    Section::new("Rig, noise and prior").table(keys("Rig, noise and prior", config))
}

fn provenance(input: &PlanReport) -> Vec<(String, String)> {
    let config = input.config_source.as_ref().map_or_else(|| "defaults".to_owned(), Source::words);
    let config = match input.before.first() {
        Some(pilot) if input.config_source.is_none() => format!("limits of {}", pilot.name()),
        _ => config,
    };
    let mut all = vec![origin("Program", PROGRAM), origin("Rig", config)];
    all.extend(input.model.iter().map(|model| origin("Model", model.words())));
    all.extend(input.posterior.iter().map(|draws| origin("Draws", draws.words())));
    all.extend(input.before.iter().map(|source| origin("Recording", source.words())));
    all.push(origin("Seed", input.config.seed.to_string()));
    all
}
