//! Where mode and branch by the sign of v_d (EMS as printed) go wrong, beside the default law; for
//! `docs/explanation/paper.md`.
//!
//! `cargo run --release -p trocar --example literal_reading -- FOLDER` prints the figures quoted
//! there and writes the drawing to `FOLDER/figures/literal-reading.svg`.

use std::path::Path;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use trocar::report::{Axis, Document, Figure, Panel, Role, Section, Series, vectors};
use trocar_model::{Element, ElementParams};

mod paper_literal;

use paper_literal::{LiteralState, PaperLiteral};

/// s; 1 kHz, as in a recording.
const PERIOD: f64 = 1e-3;

/// m; EMS section IV.
const ENCODER_COUNT: f64 = 4e-6;

/// Both readings of one seal along one motion.
struct Comparison {
    time: Vec<f64>,
    position: Vec<f64>,
    element: Vec<f64>,
    literal: Vec<f64>,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args().nth(1).ok_or("expected a folder for the drawing")?;
    let params = ElementParams::plausible_10_5_mm()?;
    let reversals = compare(params, &partial_reversals())?;
    println!("partial reversals: largest change of force within one sample (20 µm of travel)");
    println!(
        "  literal {:.3} N, default {:.3} N",
        largest_change(&reversals.literal),
        largest_change(&reversals.element)
    );

    let stop = compare(params, &braking())?;
    let decay = decaying(params, &stop);
    let last = stop.time.len() - 1;
    println!(
        "stop from 100 mm/s within 10 ms, 0.3 s later (F_s = {:.3} N)",
        params.insertion.static_force
    );
    println!(
        "  literal {:.3} N, sgn 0 = 0 {:.3} N, default {:.3} N",
        stop.literal[last], decay[last], stop.element[last]
    );

    let hold = compare(params, &noisy_hold())?;
    let from = hold.time.iter().position(|&t| t >= 0.45).ok_or("the hold is longer than that")?;
    println!("hold with encoder noise, from 0.45 s on: peak to peak");
    println!(
        "  literal {:.3} N, default {:.3} N",
        span(&hold.literal[from..]),
        span(&hold.element[from..])
    );

    for (name, svg) in vectors(&document()?)? {
        let place = Path::new(&folder).join("figures").join(name);
        std::fs::write(place.with_extension("svg"), svg)?;
    }
    Ok(())
}

/// The drawing.
pub(crate) fn document() -> Result<Document, Box<dyn std::error::Error>> {
    let params = ElementParams::plausible_10_5_mm()?;
    let [reversals, stop, hold] = [partial_reversals(), braking(), noisy_hold()];
    let [reversals, stop, hold] =
        [compare(params, &reversals)?, compare(params, &stop)?, compare(params, &hold)?];
    let decay = decaying(params, &stop);
    let figure = draw(&reversals, &stop, decay, &hold);
    let section = Section::new("Mode and branch by the sign of the velocity").figure(figure);
    Ok(Document {
        title: "The literal reading".into(),
        sections: vec![section],
        ..Document::default()
    })
}

/// Runs both readings along positions at 1 kHz, from A seal deformed as after a withdrawal.
fn compare(
    params: ElementParams,
    position: &[f64],
) -> Result<Comparison, Box<dyn std::error::Error>> {
    let (element, literal) = (Element::new(params)?, PaperLiteral::new(params));
    let start = -params.deformation.half_width();
    let (mut state, mut literal_state) = (element.rest_state(start), LiteralState::new(start));
    let mut run = Comparison { time: vec![], position: vec![], element: vec![], literal: vec![] };
    for (k, pair) in position.windows(2).enumerate() {
        let displacement = pair[1] - pair[0];
        run.time.push((k + 1) as f64 * PERIOD);
        run.position.push(pair[1]);
        run.element.push(element.step(&mut state, displacement, PERIOD));
        run.literal.push(literal.step_velocity(&mut literal_state, displacement / PERIOD, PERIOD));
    }
    Ok(run)
}

/// Positions at 1 kHz along intervals of constant velocity: (m/s, s).
fn positions(intervals: &[(f64, f64)]) -> Vec<f64> {
    let mut positions = vec![0.0];
    for &(velocity, duration) in intervals {
        let from = positions[positions.len() - 1];
        let samples = (duration / PERIOD).round() as usize;
        positions.extend((1..=samples).map(|k| from + velocity * PERIOD * k as f64));
    }
    positions
}

/// 7 mm in, which does not turn the seal over; 1.5 mm back and forth, three times; on into sliding.
fn partial_reversals() -> Vec<f64> {
    let mut intervals = vec![(0.02, 0.35)];
    for _ in 0..3 {
        intervals.extend([(-0.02, 0.075), (0.02, 0.075)]);
    }
    intervals.push((0.02, 0.65));
    positions(&intervals)
}

/// Sliding at 100 mm/s, braked within 10 ms, then at rest.
fn braking() -> Vec<f64> {
    let mut intervals = vec![(0.1, 0.35)];
    intervals.extend((1..10).map(|k| (0.1 - 0.01 * f64::from(k), PERIOD)));
    intervals.push((0.0, 0.3));
    positions(&intervals)
}

/// 8 mm in, then a hold of 0.4 s whose reading trembles by a count or two.
fn noisy_hold() -> Vec<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let clean = positions(&[(0.02, 0.4), (0.0, 0.4)]);
    let mut read = |x: f64| {
        ((x + random.random_range(-ENCODER_COUNT..ENCODER_COUNT)) / ENCODER_COUNT).round()
            * ENCODER_COUNT
    };
    clean.into_iter().map(&mut read).collect()
}

/// What (14) does at rest if sgn 0 = 0 and the mode stays: β·dz/dt = -F_e(z), from the end of the
/// braking on.
fn decaying(params: ElementParams, stop: &Comparison) -> Vec<f64> {
    const PARTS: usize = 100;
    let mut force = stop.literal.clone();
    let rest = stop.position.windows(2).position(|pair| pair[0] == pair[1]).unwrap_or(force.len());
    let insertion = params.deformation.insertion();
    // The deflection of sliding lies on the straight end of the branch.
    let stiffness = insertion.stiffness(params.deformation.half_width());
    let over = force[rest - 1] - params.insertion.static_force;
    let mut deflection = params.deformation.half_width() + over / stiffness;
    for value in &mut force[rest..] {
        for _ in 0..PARTS {
            deflection -= insertion.force(deflection) / params.insertion.viscous_damping * PERIOD
                / PARTS as f64;
        }
        *value = insertion.force(deflection);
    }
    force
}

fn largest_change(force: &[f64]) -> f64 {
    force.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max)
}

fn span(force: &[f64]) -> f64 {
    force.iter().copied().fold(f64::MIN, f64::max) - force.iter().copied().fold(f64::MAX, f64::min)
}

fn draw(reversals: &Comparison, stop: &Comparison, decay: Vec<f64>, hold: &Comparison) -> Figure {
    let force = || Axis::new("force", "N");
    let time = || Axis::new("time", "s");
    let millimetres = reversals.position.iter().map(|x| 1e3 * x).collect();
    let both = |panel: Panel, run: &Comparison, x: Vec<f64>| {
        panel
            .series(Series::line("literal", Role::Alternative, x.clone(), run.literal.clone()))
            .series(Series::line("default", Role::Model, x, run.element.clone()))
    };
    let stopped = Panel::new(time(), force()).title("a quick stop").series(Series::line(
        "literal with sgn 0 = 0",
        Role::Reference,
        stop.time.clone(),
        decay,
    ));
    Figure::new("literal-reading", 1, "Mode and branch by the sign of the velocity")
        .caption(
            "One seal in two readings of the paper: by the sign of the velocity as printed (literal) and by the force (default). \
             (a) Three partial reversals over 1.5 mm. (b) A stop from 100 mm/s within 10 ms. (c) A hold after 8 mm with \
             the noise of a 4 µm encoder.",
        )
        .panel(both(Panel::new(Axis::new("position", "mm"), force()).title("partial reversals"), reversals, millimetres))
        .panel(both(stopped, stop, stop.time.clone()))
        .panel(both(Panel::new(time(), force()).title("a hold"), hold, hold.time.clone()))
}
