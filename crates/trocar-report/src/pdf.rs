//! A scene as a PDF of one page: lines and areas as they are, text in Helvetica and Symbol, which every
//! reader has.

use std::fmt::Write as _;

use kuva::render::color::Color;
use kuva::render::render::{Primitive, Scene, TextAnchor};

use super::draw::PIXELS_PER_MILLIMETRE;

/// Points of a PDF per pixel of a scene.
const SCALE: f64 = 72.0 / 25.4 / PIXELS_PER_MILLIMETRE;

/// Distance of the control points of a quarter of a circle from its ends, in radii.
const ARC: f64 = 0.5523;

/// Advance widths of Helvetica from space to tilde, in thousandths of the font size.
#[rustfmt::skip]
const ADVANCE: [u16; 95] = [
    278, 278, 355, 556, 556, 889, 667, 191, 333, 333, 389, 584, 278, 333, 278, 278, 556, 556, 556, 556, 556, 556, 556,
    556, 556, 556, 278, 278, 584, 584, 584, 556, 1015, 667, 667, 722, 722, 667, 611, 778, 722, 278, 500, 667, 556, 833,
    722, 778, 667, 778, 722, 667, 611, 722, 667, 944, 667, 667, 611, 278, 278, 278, 469, 556, 333, 556, 556, 500, 556,
    556, 278, 556, 556, 222, 222, 500, 222, 833, 556, 556, 556, 556, 333, 500, 278, 556, 500, 722, 500, 500, 500, 334,
    260, 334, 584,
];

/// The code of a character beyond ASCII and its width, in Helvetica.
const IN_HELVETICA: [(char, u8, u16); 10] = [
    ('±', 0xB1, 584),
    ('·', 0xB7, 278),
    ('²', 0xB2, 333),
    ('³', 0xB3, 333),
    ('°', 0xB0, 400),
    ('×', 0xD7, 584),
    ('µ', 0xB5, 556),
    ('–', 0x96, 556),
    ('…', 0x85, 1000),
    ('→', 0x3E, 584),
];

/// The same in Symbol.
const IN_SYMBOL: [(char, u8, u16); 15] = [
    ('−', 0x2D, 549),
    ('α', 0x61, 631),
    ('β', 0x62, 549),
    ('γ', 0x67, 411),
    ('δ', 0x64, 494),
    ('θ', 0x71, 521),
    ('κ', 0x6B, 549),
    ('λ', 0x6C, 549),
    ('ν', 0x6E, 521),
    ('σ', 0x73, 603),
    ('τ', 0x74, 439),
    ('≤', 0xA3, 549),
    ('≥', 0xB3, 549),
    ('√', 0xD6, 549),
    ('∓', 0xB1, 549),
];

/// Raised and lowered characters, by what they raise or lower.
const SMALL: [(&str, &str, f64); 2] =
    [("⁰¹⁴⁵⁶⁷⁸⁹⁺⁻", "01456789+-", 0.35), ("₀₁₂₃₄₅₆₇₈₉", "0123456789", -0.15)];

/// A character as it is drawn: font, code, width in thousandths, size and rise relative to the font's.
struct Glyph {
    font: char,
    code: u8,
    width: f64,
    size: f64,
    rise: f64,
}

impl Glyph {
    fn of(c: char, font: char) -> Self {
        for (from, to, rise) in SMALL {
            if let Some(place) = from.chars().position(|small| small == c) {
                let full = Self::of(char::from(to.as_bytes()[place]), font);
                return Self { size: 0.7, rise, width: 0.7 * full.width, ..full };
            }
        }
        let [helvetica, symbol] = [&IN_HELVETICA[..], &IN_SYMBOL[..]]
            .map(|list| list.iter().find(|own| own.0 == c).copied());
        let ascii = (c as usize).checked_sub(32).and_then(|i| ADVANCE.get(i));
        let (font, code, width) = match (ascii, helvetica, symbol) {
            (Some(width), ..) => (font, c as u8, *width),
            (_, Some((_, code, width)), _) => (font, code, width),
            (.., Some((_, code, width))) => ('S', code, width),
            _ => (font, b'?', 556),
        };
        Self { font, code, width: width.into(), size: 1.0, rise: 0.0 }
    }
}

/// The file.
pub(super) fn file(scene: &Scene) -> Vec<u8> {
    let [width, height] = [scene.width, scene.height].map(|pixels| SCALE * pixels);
    let content = content(scene, height);
    let font =
        |name: &str, coding: &str| format!("<</Type/Font/Subtype/Type1/BaseFont/{name}{coding}>>");
    let states: String =
        (0..=10).map(|part| format!("/O{part}<</ca {}>>", 0.1 * f64::from(part))).collect();
    let objects = [
        "<</Type/Catalog/Pages 2 0 R>>".to_owned(),
        "<</Type/Pages/Kids[3 0 R]/Count 1>>".to_owned(),
        format!(
            "<</Type/Page/Parent 2 0 R/MediaBox[0 0 {width:.2} {height:.2}]/Contents 4 0 R/Resources<</Font<</R 5 0 R/B 6 0 R/S 7 0 \
             R>>/ExtGState<<{states}>>>>>>"
        ),
        format!("<</Length {}>>\nstream\n{content}endstream", content.len()),
        font("Helvetica", "/Encoding/WinAnsiEncoding"),
        font("Helvetica-Bold", "/Encoding/WinAnsiEncoding"),
        font("Symbol", ""),
    ];
    let (mut text, mut offsets) = ("%PDF-1.4\n".to_owned(), String::new());
    for (object, number) in objects.iter().zip(1..) {
        let _ = writeln!(offsets, "{:010} 00000 n ", text.len());
        let _ = write!(text, "{number} 0 obj\n{object}\nendobj\n");
    }
    let (at, count) = (text.len(), objects.len() + 1);
    let _ = write!(
        text,
        "xref\n0 {count}\n0000000000 65535 f \n{offsets}trailer\n<</Size {count}/Root 1 0 R>>\nstartxref\n{at}\n%%EOF\n"
    );
    text.into_bytes()
}

fn content(scene: &Scene, height: f64) -> String {
    let mut out = format!("{SCALE:.5} 0 0 -{SCALE:.5} 0 {height:.2} cm\n1 j 1 J\n");
    let ink = scene.text_color.as_deref().map_or(Color::None, Color::from);
    for primitive in &scene.elements {
        draw(&mut out, primitive, &ink);
    }
    out
}

/// Writing to a String cannot fail.
fn draw(out: &mut String, primitive: &Primitive, ink: &Color) {
    match primitive {
        Primitive::Text { x, y, content, size, anchor, rotate, bold, color } => {
            let font = if *bold { 'B' } else { 'R' };
            let glyphs = content.replace("\\$", "$").chars().map(|c| Glyph::of(c, font)).collect();
            let colour = color.as_ref().unwrap_or(ink);
            words(
                out,
                glyphs,
                ([*x, *y], rotate.unwrap_or(0.0)),
                f64::from(*size),
                *anchor,
                colour,
            );
        }
        Primitive::RichText { x, y, spans, size, anchor, color } => {
            let glyphs = spans.iter().flat_map(|span| {
                span.text.chars().map(move |c| Glyph::of(c, if span.bold { 'B' } else { 'R' }))
            });
            let colour = color.as_ref().unwrap_or(ink);
            words(out, glyphs.collect(), ([*x, *y], 0.0), f64::from(*size), *anchor, colour);
        }
        Primitive::CircleBatch { cx, cy, r, fill, .. } => {
            paint(out, fill, "rg");
            cx.iter().zip(cy).for_each(|(x, y)| circle(out, *x, *y, *r));
            out.push_str("f\n");
        }
        Primitive::Path(path) => {
            let fill = path.fill.as_ref().unwrap_or(&Color::None);
            area(out, fill, path.opacity, &outline(&path.d));
        }
        Primitive::Rect { x, y, width, height, fill, opacity, .. } => {
            area(out, fill, *opacity, &format!("{x:.2} {y:.2} {width:.2} {height:.2} re "));
        }
        Primitive::PolyLine { points, stroke, stroke_width, stroke_dasharray } => {
            line(out, points, stroke, *stroke_width, stroke_dasharray.as_deref());
        }
        Primitive::Line { x1, y1, x2, y2, stroke, stroke_width, stroke_dasharray } => {
            let ends = [(*x1, *y1), (*x2, *y2)];
            line(out, &ends, stroke, *stroke_width, stroke_dasharray.as_deref());
        }
        _ => {}
    }
}

fn paint(out: &mut String, colour: &Color, operator: &str) {
    let [r, g, b] = match colour {
        Color::Rgb(r, g, b) => [r, g, b].map(|part| f64::from(*part) / 255.0),
        _ => [0.0; 3],
    };
    let _ = write!(out, "{r:.3} {g:.3} {b:.3} {operator} ");
}

fn line(out: &mut String, points: &[(f64, f64)], colour: &Color, width: f64, dash: Option<&str>) {
    paint(out, colour, "RG");
    let _ = write!(out, "{width} w [{}] 0 d ", dash.unwrap_or_default());
    for ((x, y), k) in points.iter().zip(0..) {
        let _ = write!(out, "{x:.2} {y:.2} {} ", if k == 0 { 'm' } else { 'l' });
    }
    out.push_str("S\n");
}

fn area(out: &mut String, colour: &Color, opacity: Option<f64>, outline: &str) {
    paint(out, colour, "rg");
    let _ = writeln!(out, "/O{:.0} gs {outline}f /O10 gs", 10.0 * opacity.unwrap_or(1.0));
}

/// A path of straight lines, `M1 2L3 4Z`, in the order of a PDF.
fn outline(path: &str) -> String {
    let mut out = String::new();
    for part in path.split_inclusive(['M', 'L', 'Z']).zip(path.split(['M', 'L', 'Z']).skip(1)) {
        let (before, numbers) = part;
        match before.chars().last() {
            Some('M') => out += &format!("{numbers} m "),
            Some('L') => out += &format!("{numbers} l "),
            _ => out += "h ",
        }
    }
    out
}

fn circle(out: &mut String, x: f64, y: f64, r: f64) {
    let _ = write!(out, "{:.2} {y:.2} m ", x + r);
    for quarter in 0..4 {
        let [(s, c), (t, d)] =
            [quarter, quarter + 1].map(|k| (f64::from(k) * std::f64::consts::FRAC_PI_2).sin_cos());
        for (c, s) in [(c - ARC * s, s + ARC * c), (d + ARC * t, t - ARC * d), (d, t)] {
            let _ = write!(out, "{:.2} {:.2} ", x + r * c, y + r * s);
        }
        out.push_str("c ");
    }
}

fn words(
    out: &mut String,
    glyphs: Vec<Glyph>,
    ([x, y], turned): ([f64; 2], f64),
    size: f64,
    anchor: TextAnchor,
    colour: &Color,
) {
    let width = 1e-3 * size * glyphs.iter().map(|glyph| glyph.width).sum::<f64>();
    let back = width
        * match anchor {
            TextAnchor::Start => 0.0,
            TextAnchor::Middle => 0.5,
            TextAnchor::End => 1.0,
        };
    let (s, c) = turned.to_radians().sin_cos();
    paint(out, colour, "rg");
    let at = [x - back * c, y - back * s];
    let _ = write!(out, "BT {c:.4} {s:.4} {s:.4} {:.4} {:.2} {:.2} Tm ", -c, at[0], at[1]);
    for run in glyphs.chunk_by(|a, b| (a.font, a.size, a.rise) == (b.font, b.size, b.rise)) {
        let Glyph { font, size: part, rise, .. } = run[0];
        let codes: String = run.iter().map(|glyph| format!("{:02X}", glyph.code)).collect();
        let _ = write!(out, "/{font} {:.2} Tf {:.2} Ts <{codes}> Tj ", part * size, rise * size);
    }
    out.push_str("ET\n");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_of_a_file_points_at_its_objects() {
        let mut scene = Scene::new(400.0, 200.0);
        scene.add(Primitive::Rect {
            x: 1.0,
            y: 2.0,
            width: 3.0,
            height: 4.0,
            fill: Color::from("#ff0000"),
            stroke: None,
            stroke_width: None,
            opacity: Some(0.3),
        });
        let file = String::from_utf8(file(&scene)).unwrap();
        let (_, table) = file.split_once("xref\n0 8\n").unwrap();
        for (line, number) in table.lines().skip(1).take(7).zip(1..) {
            let at: usize = line[..10].parse().unwrap();
            assert!(file[at..].starts_with(&format!("{number} 0 obj")), "{line}");
        }
        assert!(file.contains("1.000 0.000 0.000 rg /O3 gs 1.00 2.00 3.00 4.00 re f"));
        assert!(file.contains("MediaBox[0 0 283.46 141.73]"), "100 mm by 50 mm");
    }

    #[test]
    fn texts_keep_their_greek_and_raised_letters() {
        let mut out = String::new();
        let glyphs = "β⁺ (N)".chars().map(|c| Glyph::of(c, 'R')).collect();
        words(&mut out, glyphs, ([10.0, 20.0], 0.0), 10.0, TextAnchor::Start, &Color::None);
        assert!(out.contains("/S 10.00 Tf 0.00 Ts <62> Tj /R 7.00 Tf 3.50 Ts <2B> Tj"), "{out}");
        assert!(out.contains("<20284E29> Tj"), "{out}");
        assert_eq!(outline("M1 2L3 4Z"), "1 2 m 3 4 l h ");
    }
}
