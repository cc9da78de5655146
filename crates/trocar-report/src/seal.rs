//! A seal that the reader moves: its cross-section, and its force over position and deflection. A part of a page, with the model inside.
//!
//! Without JavaScript it is the picture of a seal that slides; with it the page redraws what is marked here, from the steps of the module.

use serde_json::json;
use trocar_model::{DeformationForce, Direction, Element, ElementParams, Trocar};

use super::chart::inert;
use super::codes::encoded;
use super::figures::{MM, row_of};
use super::number::ticks;
use super::{ReportError, live, style};

const SCRIPT: &str = include_str!("assets/seal.js");
const STYLE: &str = include_str!("assets/seal.css");

/// Range of the instrument, mm: more than twice the width of the plausible seal.
const WAY: [f64; 2] = [0.0, 36.0];
/// Speed of the instrument that nobody moves, mm/s.
const SPEED: f64 = 15.0;
/// Where it turns, mm: full strokes, and a partial reversal in the first of them.
const TURNS: [f64; 5] = [0.0, 36.0, 28.0, 36.0, 0.0];
/// s.
const STEP: f64 = 1e-3;
/// At each turn, s.
const PAUSE: f64 = 0.4;
/// Steps between two points of a line.
const SHOWN: usize = 40;

/// Pixels per millimetre of the cross-section.
const SCALE: f64 = 5.0;
/// Where the seal is clamped, and the surface of the shaft below it, pixels.
const CLAMP: [f64; 2] = [180.0, 30.0];
const SURFACE: f64 = 90.0;
/// Where the tip of the instrument is at position 0, pixels.
const TIP: f64 = 250.0;
/// Thickness of the lip at the clamp and at its end, pixels.
const THICKNESS: [f64; 2] = [13.0, 6.0];
/// Points along the lip.
const POINTS: usize = 24;
/// Bulge of a lip that slides, of the half width.
const BULGE: f64 = 0.2;
/// Deflection from the join over which the lip changes sides, of the half width.
const SNAP: f64 = 0.15;
/// Force between the branches below which they are one, N.
const NARROWEST: f64 = 0.02;
/// Length of the arrow of the force, pixels per newton.
const PER_NEWTON: f64 = 15.0;
/// Width and height of the axes of a chart, and what is beside them: left, top, right, bottom; pixels.
const AXES: [f64; 2] = [236.0, 150.0];
const MARGIN: [f64; 4] = [46.0, 8.0, 8.0, 42.0];

/// Styles of the lines, by their names.
const STYLES: [&str; 5] = ["model", "measured", "fit", "deflection", "backdrop"];

/// A state of the seal, mm and N.
struct Shown {
    position: f64,
    deflection: f64,
    force: f64,
}

/// A seal to be dragged, or to be watched, as HTML that a page takes in: `<div data-mode="play">` around it lets it begin by itself.
///
/// It holds the model and all that moves it, and asks no network. Its forces are those of [`Trocar::step_to`] in steps of 1 ms.
///
/// # Errors
/// Parameters that make no element.
pub fn moving_seal(params: &ElementParams) -> Result<String, ReportError> {
    let refused = |reason| ReportError::Live { reason };
    let element = Element::new(*params).map_err(|_| refused("its parameters make no element"))?;
    let trocar = Trocar::of_seal(element);
    let row = row_of(&trocar).map_err(|_| refused("its model cannot be written as numbers"))?;
    let (cycle, now) = cycle(&trocar);
    let now = now.ok_or(refused("its seal does not move"))?;
    let module = live::module().map_err(|_| refused("its numbers cannot be written"))?;
    let json = inert(&page(params, &row).to_string());
    Ok(Fragment { params, cycle, now }.html(&json, &module))
}

/// What the script of the page needs to draw as this file does: middle of the branches (N) and half their distance from -c to +c, sizes of
/// the cross-section.
fn page(params: &ElementParams, row: &[f64]) -> serde_json::Value {
    let force = &params.deformation;
    let c = force.half_width();
    let grid = (-64..=64).map(|k| c * f64::from(k) / 64.0);
    let [mid, half_gap]: [Vec<f64>; 2] =
        [grid.clone().map(|z| force.mid(z)).collect(), grid.map(|z| force.half_gap(z)).collect()];
    json!({
        "row": encoded(row),
        "way": WAY.map(|mm| mm / MM),
        "speed": SPEED / MM,
        "turns": TURNS.map(|mm| mm / MM),
        "pause": PAUSE,
        "half_width": c,
        "joins": [force.insertion().join(), force.withdrawal().join()],
        "mid": mid,
        "half_gap": half_gap,
        "section": {
            "scale": SCALE,
            "clamp": CLAMP,
            "surface": SURFACE,
            "thickness": THICKNESS,
            "points": POINTS,
            "bulge": BULGE,
            "snap": SNAP,
            "narrowest": NARROWEST,
            "per_newton": PER_NEWTON,
        },
    })
}

/// One full cycle from where the instrument is in for the first time, and the seal at rest half way through the next insertion.
fn cycle(trocar: &Trocar) -> (Vec<Shown>, Option<Shown>) {
    let [out, inside] = WAY;
    let middle = 0.5 * (out + inside);
    let mut state = trocar.rest(out / MM);
    let mut stroke = |from: f64, to: f64| -> Vec<Shown> {
        let steps = ((to - from).abs() / SPEED / STEP).round() as usize;
        let pause = (PAUSE / STEP) as usize;
        let moved = (1..=steps).map(|k| from + (to - from) * k as f64 / steps as f64);
        let run = |position: f64| {
            let force = trocar.step_to(&mut state, position / MM, STEP);
            let deflection = state.deformation().map_or(0.0, |d| MM * d.deflection);
            Shown { position, deflection, force }
        };
        moved.chain(std::iter::repeat_n(to, pause)).map(run).collect()
    };
    stroke(out, inside);
    let mut cycle = stroke(inside, out);
    cycle.extend(stroke(out, inside));
    stroke(inside, out);
    (cycle, stroke(out, middle).pop())
}

struct Fragment<'a> {
    params: &'a ElementParams,
    cycle: Vec<Shown>,
    now: Shown,
}

impl Fragment<'_> {
    fn html(&self, json: &str, module: &str) -> String {
        let Shown { position, deflection, force } = self.now;
        format!(
            include_str!("assets/seal.html"),
            colours = colours(),
            style = STYLE,
            section = self.section(),
            force = signed(force, "N"),
            deflection = signed(deflection, "mm"),
            position = signed(position, "mm"),
            charts = self.over_position() + &self.over_deflection(),
            json = json,
            module = module,
            scripts = live::MODEL_SCRIPTS.concat() + SCRIPT,
        )
    }

    /// The trocar along its axis: walls, instrument, lips, force; and the deflection between its limits.
    fn section(&self) -> String {
        let now = &self.now;
        let left = CLAMP[0];
        let half_width = SCALE * MM * self.params.deformation.half_width();
        let rings = (0..26).map(|ring| format!("M{} {SURFACE}v50", TIP - 25.0 * f64::from(ring)));
        format!(
            include_str!("assets/seal-section.svg"),
            along = SCALE * (now.position - WAY[0]),
            surface = SURFACE,
            tip = TIP,
            rings = rings.collect::<String>(),
            lip = closed(&outline(&self.params.deformation, now)),
            mirror = format_args!("transform=\"matrix(1 0 0 -1 0 {})\"", 2.0 * (SURFACE + 25.0)),
            wall = format_args!("M{0} 12H480V30H{0}Z", left - 40.0),
            arrow = arrow(now.force),
            left = left,
            below = SURFACE + 21.0,
            low = left - half_width,
            high = left + half_width,
            deflection = left + SCALE * now.deflection,
            beside = left - half_width - 12.0,
        )
    }

    fn over_position(&self) -> String {
        let now = &self.now;
        let chart =
            Chart { x: [WAY[0] - 1.0, WAY[1] + 1.0], y: self.forces(), name: "position (mm)" };
        let loop_of = self.line(|shown| shown.position);
        chart.svg("position", &[("backdrop", loop_of)], [now.position, now.force])
    }

    fn over_deflection(&self) -> String {
        let now = &self.now;
        let c = MM * self.params.deformation.half_width();
        let chart = Chart { x: [-1.25 * c, 1.25 * c], y: self.forces(), name: "deflection z (mm)" };
        let branches = [Direction::Insertion, Direction::Withdrawal].map(|direction| {
            let branch = self.params.deformation.branch(direction);
            let z = (-60..=60).map(|k| c * f64::from(k) / 60.0);
            points(z.map(|z| [z, branch.force(z / MM)]))
        });
        let [insertion, withdrawal] = branches;
        let lines = [("backdrop", insertion), ("backdrop", withdrawal)];
        chart.svg("deflection", &lines, [now.deflection, now.force])
    }

    fn forces(&self) -> [f64; 2] {
        let most = self.cycle.iter().map(|shown| shown.force.abs()).fold(0.0, f64::max);
        [-1.15 * most, 1.15 * most]
    }

    fn line(&self, x: impl Fn(&Shown) -> f64) -> String {
        let shown = self.cycle.iter().step_by(SHOWN).chain(self.cycle.last());
        points(shown.map(|shown| [x(shown), shown.force]))
    }
}

fn points(points: impl Iterator<Item = [f64; 2]>) -> String {
    points.map(|[x, y]| format!("{x:.3},{y:.3} ")).collect()
}

/// Axes whose lines are in the units of the axes.
struct Chart {
    x: [f64; 2],
    y: [f64; 2],
    name: &'static str,
}

impl Chart {
    fn svg(&self, id: &str, lines: &[(&str, String)], [x, y]: [f64; 2]) -> String {
        let [left, top, right, bottom] = MARGIN;
        let [width, height] = AXES;
        let scale = [width / (self.x[1] - self.x[0]), height / (self.y[1] - self.y[0])];
        let place_x = |value: f64| left + scale[0] * (value - self.x[0]);
        let place_y = |value: f64| top + height - scale[1] * (value - self.y[0]);
        let bottom_line = top + height;
        let [x_ticks, y_ticks] = [self.x, self.y].map(|[low, high]| ticks(low, high, 5));
        let (x_ticks, y_ticks) = (x_ticks.placed(place_x), y_ticks.placed(place_y));
        let grid = x_ticks.iter().map(|(x, _)| format!("M{x:.2} {top}v{height}"));
        let grid = grid.chain(y_ticks.iter().map(|(y, _)| format!("M{left} {y:.2}h{width}")));
        let x_numbers = x_ticks.iter().map(|(x, label)| {
            format!("<text x=\"{x:.2}\" y=\"{}\">{label}</text>\n", bottom_line + 16.0)
        });
        let y_numbers = y_ticks.iter().map(|(y, label)| {
            let (right, line) = (left - 6.0, y + 4.0);
            format!("<text class=\"seal-end\" x=\"{right}\" y=\"{line:.2}\">{label}</text>\n")
        });
        let lines = lines.iter().map(|(class, points)| {
            format!("<polyline class=\"seal-{class}\" points=\"{points}\"/>\n")
        });
        format!(
            include_str!("assets/seal-chart.svg"),
            id = id,
            full_width = left + width + right,
            full_height = top + height + bottom,
            name = self.name,
            grid = grid.collect::<String>(),
            left = left,
            top = top,
            width = width,
            height = height,
            numbers = x_numbers.chain(y_numbers).collect::<String>(),
            centre = left + width / 2.0,
            below = bottom_line + 35.0,
            middle = top + height / 2.0,
            x_scale = scale[0],
            y_scale = scale[1],
            x_origin = left - scale[0] * self.x[0],
            y_origin = bottom_line + scale[1] * self.y[0],
            lines = lines.collect::<String>(),
            x = x,
            y = y,
        )
    }
}

fn signed(value: f64, unit: &str) -> String {
    format!("{value:.2} {unit}").replace('-', "−")
}

/// The force on the seal as an arrow along the axis of the instrument.
fn arrow(force: f64) -> String {
    let (x, y, long) = (CLAMP[0], SURFACE + 25.0, PER_NEWTON * force);
    let head = long.abs().min(8.0) * long.signum();
    format!("M{x} {y}h{long:.2}m{:.2} -5l{head:.2} 5l{:.2} 5", -head, -head)
}

/// How far the surface of the shaft is from where the lip of [`lip_outline`] is clamped, mm.
pub const LIP_HEIGHT_MM: f64 = (SURFACE - CLAMP[1]) / SCALE;

/// Outline of the lip that [`moving_seal`] shows, mm: from where it is clamped in the wall, along the insertion and towards the shaft.
///
/// `deflection_m` and `force_n` are a state of the seal: the force tells on which branch it is, and so to which side the lip bends. The shape
/// is a drawing, no result of the model.
#[must_use]
pub fn lip_outline(
    deformation: &DeformationForce,
    deflection_m: f64,
    force_n: f64,
) -> Vec<[f64; 2]> {
    let shown = Shown { position: 0.0, deflection: MM * deflection_m, force: force_n };
    let points = outline(deformation, &shown).into_iter();
    points.map(|[x, y]| [(x - CLAMP[0]) / SCALE, (y - CLAMP[1]) / SCALE]).collect()
}

/// Outline of the lip over the shaft, pixels: an elastic strip of constant length, clamped in the wall, whose end is on the shaft
/// at the deflection. Up to its join a branch has the lip on one side, after it on the other.
fn outline(force: &DeformationForce, now: &Shown) -> Vec<[f64; 2]> {
    let c = MM * force.half_width();
    let z = now.deflection;
    let gap = force.half_gap(z / MM);
    let part = if gap < NARROWEST {
        0.0
    } else {
        ((now.force - force.mid(z / MM)) / gap).clamp(-1.0, 1.0)
    };
    let [on, off] =
        [Direction::Insertion, Direction::Withdrawal].map(|d| MM * force.branch(d).join());
    let side = ((z - 0.5 * (on + off) - 0.5 * part * (on - off)) / (SNAP * c)).tanh();
    let height = SURFACE - CLAMP[1] - 0.5 * THICKNESS[1];
    let length = length(&strip(SCALE * c, height, BULGE * SCALE * c, 1.0));
    let (mut low, mut high) = (0.0, 3.0 * SCALE * c);
    for _ in 0..30 {
        let bulge = 0.5 * (low + high);
        let is_long = self::length(&strip(SCALE * z, height, bulge, side)) > length;
        if is_long { high = bulge } else { low = bulge }
    }
    around(&strip(SCALE * z, height, low, side))
}

/// The middle line of a strip that bulges to the side away from its deflection; between the sides it is curved like an S.
fn strip(z: f64, height: f64, bulge: f64, side: f64) -> Vec<[f64; 2]> {
    let double = (1.0 - side * side).max(0.0).sqrt();
    let points = (0..POINTS).map(|k| {
        let t = k as f64 / (POINTS - 1) as f64;
        let single = 6.75 * t * (1.0 - t) * (1.0 - t);
        let x = z * t - bulge * (side * single + 0.6 * double * (std::f64::consts::TAU * t).sin());
        [CLAMP[0] + x, CLAMP[1] + height * t]
    });
    points.collect()
}

fn length(line: &[[f64; 2]]) -> f64 {
    line.windows(2).map(|p| (p[1][0] - p[0][0]).hypot(p[1][1] - p[0][1])).sum()
}

/// The points at half the thickness from the line on both sides.
fn around(line: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let last = line.len() - 1;
    let side = |k: usize, sign: f64| {
        let (a, b) = (line[k.saturating_sub(1)], line[(k + 1).min(last)]);
        let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
        let part = k as f64 / last as f64;
        let half =
            0.5 * sign * (THICKNESS[0] + (THICKNESS[1] - THICKNESS[0]) * part) / dx.hypot(dy);
        [line[k][0] - half * dy, (line[k][1] + half * dx).min(SURFACE)]
    };
    (0..=last).map(|k| side(k, 1.0)).chain((0..=last).rev().map(|k| side(k, -1.0))).collect()
}

/// A closed path through points.
fn closed(points: &[[f64; 2]]) -> String {
    let all: Vec<String> = points.iter().map(|[x, y]| format!("{x:.1} {y:.1}")).collect();
    format!("M{}Z", all.join("L"))
}

/// The colours of the roles, on light and on dark pages; a page may choose by `data-theme`.
fn colours() -> String {
    let used = || style::all().iter().filter(|style| STYLES.contains(&style.class));
    let (light, dark) =
        (style::variables(used(), |s| s.light), style::variables(used(), |s| s.dark));
    format!(
        ".moving-seal{{{light}}}\n[data-theme=dark] .moving-seal{{{dark}}}\n\
         @media screen and (prefers-color-scheme:dark){{:root:not(:has([data-theme=light])) .moving-seal{{{dark}}}}}\n"
    )
}
