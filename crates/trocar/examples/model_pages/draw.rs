//! A model as a figure: its loop, its response to a reversal, and what its page shows beside them.

use std::error::Error;

use trocar::report::{Axis, Figure, Mark, Panel, Role, Series};
use trocar_model::Trocar;

use super::paper_literal::LiteralState;
use super::shown::{First, Law, Line, Shown, seal};

/// s.
const PERIOD: f64 = 1e-3;
/// Travel or time between two points of a line.
const SHOWN_M: f64 = 0.2e-3;
const SHOWN_S: f64 = 2e-3;
/// Of the loop, m/s: slow, so that the viscous force is small.
const SLOW: f64 = 0.015;
/// Where the instrument turns in the loop, m: full strokes, then partial reversals where the seal deforms.
const TURNS: [f64; 8] = [0.02, -0.02, 0.02, -0.02, -0.013, -0.0155, -0.006, -0.0085];
/// Before the turns that are drawn, so that the loop is closed.
const UNSEEN: usize = 1;
/// Of the reversal, m/s; its duration and that of the rest after it, s.
const FAST: f64 = 0.05;
const MOVES: f64 = 0.5;
const RESTS: f64 = 0.5;

const MM: f64 = 1e3;

struct Run {
    time: Vec<f64>,
    position: Vec<f64>,
    deflection: Vec<f64>,
    force: Vec<f64>,
}

/// A law along positions at 1 kHz, from an undeformed seal on.
fn run(law: &Law, position: &[f64]) -> Run {
    let mut run = Run { time: vec![], position: vec![], deflection: vec![], force: vec![] };
    let mut put = |k: usize, deflection: f64, force: f64| {
        run.time.push(k as f64 * PERIOD);
        run.position.push(position[k]);
        run.deflection.push(deflection);
        run.force.push(force);
    };
    match law {
        Law::Trocar(trocar) => {
            let mut state = trocar.rest(position[0]);
            for (k, &x) in position.iter().enumerate().skip(1) {
                let force = trocar.step_to(&mut state, x, PERIOD);
                put(k, state.deformation().map_or(f64::NAN, |now| now.deflection), force);
            }
        }
        Law::Literal(model) => {
            let mut state = LiteralState::new(0.0);
            for k in 1..position.len() {
                let velocity = (position[k] - position[k - 1]) / PERIOD;
                let force = model.step_velocity(&mut state, velocity, PERIOD);
                put(k, state.deflection(), force);
            }
        }
    }
    run
}

/// Positions along segments: displacement (m) and duration (s).
fn positions(segments: &[(f64, f64)]) -> Vec<f64> {
    let mut positions = vec![0.0];
    for &(way, duration) in segments {
        let from = positions[positions.len() - 1];
        let count = (duration / PERIOD).round() as usize;
        positions.extend((1..=count).map(|k| from + way * k as f64 / count as f64));
    }
    positions
}

/// The motion of the loop, and how many of its samples are not drawn.
fn strokes() -> (Vec<f64>, usize) {
    let mut segments = Vec::new();
    let mut at = 0.0;
    for to in TURNS.into_iter().chain([0.02]) {
        segments.push((to - at, (to - at).abs() / SLOW));
        at = to;
    }
    let unseen = positions(&segments[..=UNSEEN]).len() - 1;
    (positions(&segments), unseen)
}

/// The line over x of the samples from `from` on, one in `every`.
fn line(Line { name, role, .. }: &Line, [x, y]: [&[f64]; 2], from: usize, every: usize) -> Series {
    let some = |values: &[f64]| values[from..].iter().step_by(every).copied().collect();
    Series::line(*name, *role, some(x), some(y))
}

fn scaled(values: &[f64]) -> Vec<f64> {
    values.iter().map(|value| MM * value).collect()
}

pub(crate) fn figure(shown: &Shown) -> Result<Figure, Box<dyn Error>> {
    let behind = Line {
        name: "the seal: EMS element",
        role: Role::Backdrop,
        law: Law::Trocar(Box::new(Trocar::of_seal(seal()?))),
    };
    let lines: Vec<&Line> =
        shown.beside_seal.then_some(&behind).into_iter().chain(&shown.lines).collect();
    let mut figure = Figure::new(shown.id, 1, shown.title).caption(shown.caption).columns(2);
    match shown.first {
        First::None => {}
        First::Curve => figure = figure.panel(curve(shown)),
        First::Branches => figure = figure.panel(branches(&lines)),
    }
    Ok(figure.panel(cycle(&lines)).panel(reversal(&lines)))
}

/// Force over position: two full strokes and two partial reversals.
fn cycle(lines: &[&Line]) -> Panel {
    let (position, unseen) = strokes();
    let every = (SHOWN_M / (SLOW * PERIOD)).round() as usize;
    let panel = Panel::new(Axis::new("position", "mm"), Axis::new("force", "N"))
        .title("strokes at 15 mm/s")
        .aspect(0.7);
    lines.iter().fold(panel, |panel, one| {
        let run = run(&one.law, &position);
        panel.series(line(one, [&scaled(&run.position), &run.force], unseen, every))
    })
}

/// Force over time: sliding out, one reversal, and a rest.
fn reversal(lines: &[&Line]) -> Panel {
    let way = FAST * MOVES;
    let segments = [(-2.0 * way, 2.0 * MOVES), (way, MOVES), (0.0, RESTS)];
    let position = positions(&segments);
    let turn = 2.0 * MOVES;
    let from = ((turn - 0.1) / PERIOD).round() as usize;
    let every = (SHOWN_S / PERIOD).round() as usize;
    let panel = Panel::new(Axis::new("time since the reversal", "s"), Axis::new("force", "N"))
        .title("a reversal at 50 mm/s, a rest")
        .mark(Mark::x(MOVES, "rest"))
        .aspect(0.7);
    lines.iter().fold(panel, |panel, one| {
        let run = run(&one.law, &position);
        let time: Vec<f64> = run.time.iter().map(|time| time - turn).collect();
        panel.series(line(one, [&time, &run.force], from, every))
    })
}

/// Sliding force over speed, from the models themselves: each moved long enough at constant speed.
fn curve(shown: &Shown) -> Panel {
    let speeds: Vec<f64> = (1..=60).map(|k| 2e-3 * f64::from(k)).collect();
    let panel =
        Panel::new(Axis::new("speed", "mm/s").with_zero(), Axis::new("force", "N").with_zero())
            .title("sliding force")
            .aspect(0.7);
    shown.lines.iter().fold(panel, |panel, one| {
        let last = |speed: &f64| {
            let run = run(&one.law, &positions(&[(speed * 0.05, 0.05)]));
            run.force[run.force.len() - 1]
        };
        let force = speeds.iter().map(last).collect();
        panel.series(Series::line(one.name, one.role, scaled(&speeds), force))
    })
}

/// Force over the deflection of the seal, with the minor loops between the branches.
fn branches(lines: &[&Line]) -> Panel {
    let (position, unseen) = strokes();
    let every = (SHOWN_M / (SLOW * PERIOD)).round() as usize;
    let panel = Panel::new(Axis::new("deflection z", "mm"), Axis::new("deformation force", "N"))
        .title("branches and minor loops")
        .aspect(0.7);
    lines.iter().fold(panel, |panel, one| {
        let run = run(&one.law, &position);
        panel.series(line(one, [&scaled(&run.deflection), &run.force], unseen, every))
    })
}
