//! A seal that the reader moves: its cross-section, and its force over position and deflection. A part of a page, with the model inside.
//!
//! Without JavaScript it is the picture of a seal that slides; with it the page redraws what is marked here, from the steps of the module.

use std::fmt::Write as _;
use std::io::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::GzEncoder;
use serde::Serialize;
use trocar_model::{DeformationForce, Direction, Element, ElementParams, Trocar};

use super::Outcome;

const SCRIPT: &str = include_str!("moving_seal.js");
const STYLE: &str = include_str!("moving_seal.css");
/// The module of the reports, and what moves a model in a page.
const MODULE: &[u8] = include_bytes!("../../../trocar-report/src/assets/model.wasm");
const MODEL_SCRIPTS: [&str; 2] = [
    include_str!("../../../trocar-report/src/assets/handle.js"),
    include_str!("../../../trocar-report/src/assets/model.js"),
];

const MM: f64 = 1e3;

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
/// Between two ticks of the force, N.
const FORCE_STEP: f64 = 2.0;

/// What the script of the page needs to draw as this file does.
#[derive(Serialize)]
struct Page {
    row: String,
    way: [f64; 2],
    speed: f64,
    turns: [f64; 5],
    pause: f64,
    half_width: f64,
    joins: [f64; 2],
    /// Middle of the branches (N) and half their distance, from -c to +c.
    mid: Vec<f64>,
    half_gap: Vec<f64>,
    section: Section,
}

/// Sizes of the cross-section.
#[derive(Serialize)]
struct Section {
    scale: f64,
    clamp: [f64; 2],
    surface: f64,
    thickness: [f64; 2],
    points: usize,
    bulge: f64,
    snap: f64,
    narrowest: f64,
    per_newton: f64,
}

const SECTION: Section = Section {
    scale: SCALE,
    clamp: CLAMP,
    surface: SURFACE,
    thickness: THICKNESS,
    points: POINTS,
    bulge: BULGE,
    snap: SNAP,
    narrowest: NARROWEST,
    per_newton: PER_NEWTON,
};

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
pub(crate) fn moving_seal(params: &ElementParams) -> Outcome<String> {
    let trocar = Trocar::of_seal(Element::new(*params)?);
    let mut row = vec![0.0; trocar.count_numbers()];
    trocar.write_numbers(&mut row)?;
    let (cycle, now) = cycle(&trocar);
    let now = now.ok_or("the seal does not move")?;
    let json = serde_json::to_string(&page(params, &row))?;
    let mut module = GzEncoder::new(Vec::new(), Compression::best());
    module.write_all(MODULE)?;
    Ok(Fragment { params, cycle, now }.html(&json, &STANDARD.encode(module.finish()?)))
}

fn page(params: &ElementParams, row: &[f64]) -> Page {
    let force = &params.deformation;
    let c = force.half_width();
    let grid = || (-64..=64).map(|k| c * f64::from(k) / 64.0);
    Page {
        // 64-bit numbers, little endian: exact.
        row: STANDARD
            .encode(row.iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<u8>>()),
        way: WAY.map(|mm| mm / MM),
        speed: SPEED / MM,
        turns: TURNS.map(|mm| mm / MM),
        pause: PAUSE,
        half_width: c,
        joins: [Direction::Insertion, Direction::Withdrawal].map(|d| force.branch(d).join()),
        mid: grid().map(|z| force.mid(z)).collect(),
        half_gap: grid().map(|z| force.half_gap(z)).collect(),
        section: SECTION,
    }
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

// Writing to a String cannot fail, so the results of `write!` are dropped throughout this file.

impl Fragment<'_> {
    fn html(&self, json: &str, module: &str) -> String {
        let now = &self.now;
        let mut html = format!("<div class=\"moving-seal\">\n<style>\n{STYLE}</style>\n");
        html += &self.section(now);
        html += &status(now);
        html += "<div class=\"seal-charts\">\n";
        html += &self.over_position(now);
        html += &self.over_deflection(now);
        html += "</div>\n<p class=\"seal-tools\"><button type=\"button\" hidden>Play</button> <span>Where JavaScript and \
                 WebAssembly run, this seal moves.</span></p>\n";
        let _ = write!(
            html,
            "<script type=\"application/json\">{json}</script>\n<script type=\"application/gzip\">{module}</script>\n\
             <script>\n\"use strict\";\n(() => {{\n{}{SCRIPT}}})();\n</script>\n</div>\n",
            MODEL_SCRIPTS.concat()
        );
        html
    }

    /// The trocar along its axis: walls, instrument, lips, force; and the deflection between its limits.
    fn section(&self, now: &Shown) -> String {
        let [left, _] = CLAMP;
        let mirror = format!("transform=\"matrix(1 0 0 -1 0 {})\"", 2.0 * (SURFACE + 25.0));
        let wall = format!("class=\"seal-wall\" d=\"M{0} 12H480V30H{0}Z\"/>", left - 40.0);
        let lip = closed(&outline(&self.params.deformation, now));
        let lip = format!("<path class=\"seal-lip\" d=\"{lip}\"/>");
        let along = SCALE * (now.position - WAY[0]);
        let rings = (0..26).map(|ring| format!("M{} {SURFACE}v50", TIP - 25.0 * f64::from(ring)));
        let mut svg = "<svg class=\"seal-section\" viewBox=\"0 0 480 268\" role=\"img\" aria-label=\"Cross-section of a trocar: the lip of the \
                       seal between the wall and the instrument\">\n<defs><pattern class=\"seal-hatch\" id=\"seal-hatch\" width=\"7\" \
                       height=\"7\" patternUnits=\"userSpaceOnUse\" patternTransform=\"rotate(45)\"><rect width=\"7\" height=\"7\"/><path d=\"M0 0V7\"/></pattern></defs>\n"
            .to_owned();
        let _ = write!(
            svg,
            "<g class=\"seal-shaft\" transform=\"translate({along:.2} 0)\">\n\
             <path d=\"M-400 {SURFACE}H{TIP}q26 0 30 25q-4 25 -30 25H-400Z\"/>\n<path class=\"seal-rings\" d=\"{}\"/>\n</g>\n\
             <g class=\"seal-lips\" data-sliding=\"1\">{lip}<g {mirror}>{lip}</g></g>\n\
             <path {wall}\n<path {mirror} {wall}\n",
            rings.collect::<String>()
        );
        let _ = write!(
            svg,
            "<path class=\"seal-force\" d=\"{}\"/>\n<text class=\"seal-force-name\" x=\"{left}\" y=\"{}\">F</text>\n{}\
             <text class=\"seal-side\" x=\"8\" y=\"24\">outside</text>\n\
             <text class=\"seal-side seal-end\" x=\"472\" y=\"245\">insertion →</text>\n</svg>\n",
            arrow(now.force),
            SURFACE + 21.0,
            self.gauge(now)
        );
        svg
    }

    /// The deflection between −c and +c.
    fn gauge(&self, now: &Shown) -> String {
        let half_width = MM * self.params.deformation.half_width();
        let place = |millimetres: f64| CLAMP[0] + SCALE * millimetres;
        let [low, middle, high] = [-half_width, 0.0, half_width].map(place);
        let names = [(low, "−c"), (middle, "0"), (high, "+c")];
        let names = names.map(|(x, name)| format!("<text x=\"{x}\" y=\"260\">{name}</text>\n"));
        format!(
            "<path class=\"seal-gauge\" d=\"M{low} 240H{high}M{low} 235v10M{middle} 235v10M{high} 235v10\"/>\n{}\
             <circle class=\"seal-z\" cx=\"{:.2}\" cy=\"240\" r=\"6\"/>\n\
             <text class=\"seal-side seal-end\" x=\"{}\" y=\"245\">deflection z</text>\n",
            names.concat(),
            place(now.deflection),
            low - 12.0
        )
    }

    fn over_position(&self, now: &Shown) -> String {
        let x = [WAY[0] - 1.0, WAY[1] + 1.0];
        let chart = Chart { x, y: self.forces(), step: 10.0, name: "position (mm)" };
        let loop_of = self.line(|shown| shown.position);
        chart.svg("position", &[("backdrop", loop_of)], [now.position, now.force])
    }

    fn over_deflection(&self, now: &Shown) -> String {
        let c = MM * self.params.deformation.half_width();
        let x = [-1.25 * c, 1.25 * c];
        let chart = Chart { x, y: self.forces(), step: 5.0, name: "deflection z (mm)" };
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
    points.fold(String::new(), |mut text, [x, y]| {
        let _ = write!(text, "{x:.3},{y:.3} ");
        text
    })
}

/// Axes whose lines are in the units of the axes.
struct Chart {
    x: [f64; 2],
    y: [f64; 2],
    /// Between two ticks of x.
    step: f64,
    name: &'static str,
}

impl Chart {
    fn svg(&self, id: &str, lines: &[(&str, String)], [x, y]: [f64; 2]) -> String {
        let [left, top, right, bottom] = MARGIN;
        let [width, height] = AXES;
        let scale = [width / (self.x[1] - self.x[0]), height / (self.y[1] - self.y[0])];
        let place_x = |value: f64| left + scale[0] * (value - self.x[0]);
        let place_y = |value: f64| top + height - scale[1] * (value - self.y[0]);
        let mut svg = format!(
            "<svg class=\"seal-chart\" data-chart=\"{id}\" viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"Force (N) over {}\">\n\
             <path class=\"seal-grid\" d=\"",
            left + width + right,
            top + height + bottom,
            self.name
        );
        let (x_ticks, y_ticks) = (ticks(self.x, self.step), ticks(self.y, FORCE_STEP));
        for (at, _) in &x_ticks {
            let _ = write!(svg, "M{:.2} {top}v{height}", place_x(*at));
        }
        for (at, _) in &y_ticks {
            let _ = write!(svg, "M{left} {:.2}h{width}", place_y(*at));
        }
        let _ = write!(
            svg,
            "\"/>\n<path class=\"seal-frame\" d=\"M{left} {top}h{width}v{height}h-{width}z\"/>\n"
        );
        for (at, label) in &x_ticks {
            let _ = writeln!(
                svg,
                "<text x=\"{:.2}\" y=\"{}\">{label}</text>",
                place_x(*at),
                top + height + 16.0
            );
        }
        for (at, label) in &y_ticks {
            let _ = writeln!(
                svg,
                "<text class=\"seal-end\" x=\"{}\" y=\"{:.2}\">{label}</text>",
                left - 6.0,
                place_y(*at) + 4.0
            );
        }
        let _ = write!(
            svg,
            "<text x=\"{}\" y=\"{}\">{}</text>\n<text transform=\"translate(13 {}) rotate(-90)\">force (N)</text>\n<g transform=\"matrix({} 0 0 {} {} {})\">\n",
            left + width / 2.0,
            top + height + 35.0,
            self.name,
            top + height / 2.0,
            scale[0],
            -scale[1],
            left - scale[0] * self.x[0],
            top + height + scale[1] * self.y[0]
        );
        for (class, points) in lines {
            let _ = writeln!(svg, "<polyline class=\"seal-{class}\" points=\"{points}\"/>");
        }
        let _ = write!(
            svg,
            "<polyline class=\"seal-trail\"/>\n<path class=\"seal-dot\" d=\"M{x:.3} {y:.3}h0\"/>\n</g>\n</svg>\n"
        );
        svg
    }
}

/// Multiples of a whole `step` within a range, and their labels.
fn ticks([low, high]: [f64; 2], step: f64) -> Vec<(f64, String)> {
    let numbers = (low / step).ceil() as i64..=(high / step).floor() as i64;
    let tick = |number: i64| {
        let at = number as f64 * step;
        (at, at.to_string().replace('-', "−"))
    };
    numbers.map(tick).collect()
}

fn status(now: &Shown) -> String {
    let entry = |name: &str, words: &str, value: String| {
        format!("<div><dt>{words}</dt><dd data-seal=\"{name}\">{value}</dd></div>\n")
    };
    let signed = |value: f64, unit: &str| format!("{value:.2} {unit}").replace('-', "−");
    "<dl class=\"seal-status\">\n".to_owned()
        + &entry("force", "Force F", signed(now.force, "N"))
        + &entry("deflection", "Deflection z", signed(now.deflection, "mm"))
        + &entry("position", "Position", signed(now.position, "mm"))
        + &entry("sliding", "Seal", "slides".to_owned())
        + "</dl>\n"
}

/// The force on the seal as an arrow along the axis of the instrument.
fn arrow(force: f64) -> String {
    let (x, y, long) = (CLAMP[0], SURFACE + 25.0, PER_NEWTON * force);
    let head = long.abs().min(8.0) * long.signum();
    format!("M{x} {y}h{long:.2}m{:.2} -5l{head:.2} 5l{:.2} 5", -head, -head)
}

/// How far the surface of the shaft is from where the lip of [`lip_outline`] is clamped, mm.
pub(crate) const LIP_HEIGHT_MM: f64 = (SURFACE - CLAMP[1]) / SCALE;

/// Outline of the lip that [`moving_seal`] shows, mm: from where it is clamped in the wall, along the insertion and towards the shaft.
///
/// `deflection_m` and `force_n` are a state of the seal: the force tells on which branch it is, and so to which side the lip bends. The shape
/// is a drawing, no result of the model.
pub(crate) fn lip_outline(
    deformation: &DeformationForce,
    deflection_m: f64,
    force_n: f64,
) -> Vec<[f64; 2]> {
    let shown = Shown { position: 0.0, deflection: MM * deflection_m, force: force_n };
    let from_clamp = |[x, y]: [f64; 2]| [(x - CLAMP[0]) / SCALE, (y - CLAMP[1]) / SCALE];
    outline(deformation, &shown).into_iter().map(from_clamp).collect()
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
    let point = |k: usize| {
        let t = k as f64 / (POINTS - 1) as f64;
        let single = 6.75 * t * (1.0 - t) * (1.0 - t);
        let x = z * t - bulge * (side * single + 0.6 * double * (std::f64::consts::TAU * t).sin());
        [CLAMP[0] + x, CLAMP[1] + height * t]
    };
    (0..POINTS).map(point).collect()
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
