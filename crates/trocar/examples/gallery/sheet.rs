//! A sheet to draw schematics on. Lengths are pixels: four to a millimetre of paper, as in the figures of the reports.

use std::fmt::Write as _;

pub(crate) const INK: &str = "#1a1a1a";
pub(crate) const GREY: &str = "#5c6670";
/// Motion of the instrument.
pub(crate) const BLUE: &str = "#0064b0";
/// The seal and its deflection.
pub(crate) const PURPLE: &str = "#8e3a80";
/// Sliding and force.
pub(crate) const ORANGE: &str = "#c8420a";
pub(crate) const WHITE: &str = "#ffffff";
pub(crate) const STEEL: &str = "#d9dde1";
pub(crate) const PALE: &str = "#f1f3f5";
pub(crate) const PALE_BLUE: &str = "#e7f0fb";
pub(crate) const PALE_PURPLE: &str = "#f4e9f2";
pub(crate) const PALE_ORANGE: &str = "#fbeee7";
/// What does not move.
pub(crate) const HATCHED: &str = "url(#hatch)";
pub(crate) const NONE: &str = "none";

const PIXELS_PER_MM: f64 = 4.0;
/// Length and half width of the head of an arrow.
const HEAD: [f64; 2] = [8.0, 3.4];

pub(crate) type Point = [f64; 2];

/// Colour, width and dashes of a line.
#[derive(Clone, Copy)]
pub(crate) struct Pen(&'static str, f64, &'static str);

impl Pen {
    pub(crate) const fn new(colour: &'static str, width: f64) -> Self {
        Self(colour, width, "none")
    }

    pub(crate) const fn dashed(colour: &'static str) -> Self {
        Self(colour, 1.0, "4 4")
    }
}

pub(crate) const EDGE: Pen = Pen::new(INK, 1.5);

#[derive(Clone, Copy)]
pub(crate) enum Align {
    Start,
    Middle,
    End,
}

pub(crate) struct Sheet {
    size: Point,
    body: String,
}

// Writing to a String cannot fail, so the results of `write!` are dropped throughout this file.

impl Sheet {
    pub(crate) const fn new(width: f64, height: f64) -> Self {
        Self { size: [width, height], body: String::new() }
    }

    /// The file, with its title and what it shows in words.
    pub(crate) fn svg(&self, name: &str, title: &str, words: &str) -> String {
        let [width, height] = self.size;
        let [paper_width, paper_height] = self.size.map(|pixels| pixels / PIXELS_PER_MM);
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{paper_width}mm\" height=\"{paper_height}mm\" viewBox=\"0 0 {width} {height}\" \
             role=\"img\" aria-labelledby=\"{name}-title {name}-text\" font-family=\"'DejaVu Sans', Verdana, Arial, Helvetica, sans-serif\" \
             font-size=\"13\" stroke-linejoin=\"round\" stroke-linecap=\"round\">\n<title id=\"{name}-title\">{title}</title>\n<desc id=\"{name}-text\">{words}</desc>\n\
             <defs><pattern id=\"hatch\" width=\"7\" height=\"7\" patternUnits=\"userSpaceOnUse\" patternTransform=\"rotate(45)\">\
             <rect width=\"7\" height=\"7\" fill=\"#eceef0\"/><path d=\"M0 0V7\" stroke=\"{GREY}\" stroke-width=\"1.6\"/></pattern></defs>\n\
             <rect width=\"{width}\" height=\"{height}\" fill=\"{WHITE}\"/>\n{}</svg>\n",
            self.body
        )
    }

    /// A path in the words of SVG.
    pub(crate) fn path(&mut self, d: &str, fill: &str, Pen(colour, width, dashes): Pen) {
        let _ = writeln!(
            self.body,
            "<path d=\"{d}\" fill=\"{fill}\" stroke=\"{colour}\" stroke-width=\"{width}\" stroke-dasharray=\"{dashes}\"/>"
        );
    }

    pub(crate) fn line(&mut self, points: &[Point], pen: Pen) {
        self.path(&format!("M{}", joined(points)), NONE, pen);
    }

    pub(crate) fn area(&mut self, points: &[Point], fill: &str, pen: Pen) {
        self.path(&format!("M{}Z", joined(points)), fill, pen);
    }

    /// A box from its upper left corner.
    pub(crate) fn rect(&mut self, [x, y]: Point, [width, height]: Point, fill: &str, pen: Pen) {
        self.path(&format!("M{x:.1} {y:.1}h{width:.1}v{height:.1}h{:.1}Z", -width), fill, pen);
    }

    pub(crate) fn dot(&mut self, [x, y]: Point, colour: &'static str) {
        self.path(
            &format!("M{:.1} {y:.1}a4 4 0 1 0 8 0a4 4 0 1 0 -8 0Z", x - 4.0),
            colour,
            Pen::new(WHITE, 1.0),
        );
    }

    /// Words, of which `{z}` is a symbol and `{z|def}` one with an index.
    pub(crate) fn text(&mut self, [x, y]: Point, align: Align, colour: &str, words: &str) {
        let anchor = match align {
            Align::Start => "start",
            Align::Middle => "middle",
            Align::End => "end",
        };
        let _ = writeln!(
            self.body,
            "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" fill=\"{colour}\">{}</text>",
            set(words)
        );
    }

    /// Letter and heading of a panel.
    pub(crate) fn heading(&mut self, at: Point, letter: char, words: &str) {
        let [x, y] = at;
        let _ = writeln!(
            self.body,
            "<text x=\"{x}\" y=\"{y}\" fill=\"{INK}\" font-weight=\"bold\">({letter})</text>"
        );
        self.text([x + 28.0, y], Align::Start, INK, words);
    }

    /// A line whose last point is the tip of an arrow.
    pub(crate) fn arrow(&mut self, points: &[Point], pen: Pen) {
        let [.., [x0, y0], [x, y]] = *points else { return };
        let length = (x - x0).hypot(y - y0);
        let [dx, dy] = [(x - x0) / length, (y - y0) / length];
        let [long, half] = HEAD;
        let back = [x - long * dx, y - long * dy];
        let side = |sign: f64| [back[0] - sign * half * dy, back[1] + sign * half * dx];
        let mut line = points[..points.len() - 1].to_vec();
        line.push(back);
        self.line(&line, pen);
        self.area(&[[x, y], side(1.0), side(-1.0)], pen.0, Pen::new(pen.0, 0.5));
    }

    /// A distance, between two arrows.
    pub(crate) fn distance(&mut self, from: Point, to: Point, pen: Pen) {
        let middle = [0.5 * (from[0] + to[0]), 0.5 * (from[1] + to[1])];
        self.arrow(&[middle, from], pen);
        self.arrow(&[middle, to], pen);
    }

    /// A spring along the x-axis.
    pub(crate) fn spring(&mut self, [x, y]: Point, to: f64, pen: Pen) {
        const TURNS: usize = 12;
        const END: f64 = 16.0;
        let step = (to - x - 2.0 * END) / TURNS as f64;
        let mut points = vec![[x, y], [x + END, y]];
        points.extend((0..TURNS).map(|k| {
            let side = if k % 2 == 0 { 8.0 } else { -8.0 };
            [x + END + step * (k as f64 + 0.5), y + side]
        }));
        points.extend([[to - END, y], [to, y]]);
        self.line(&points, pen);
    }

    /// A damper along the x-axis.
    pub(crate) fn damper(&mut self, [x, y]: Point, to: f64, pen: Pen) {
        let middle = 0.5 * (x + to);
        let (cup, piston) = (middle - 12.0, middle + 3.0);
        self.line(&[[x, y], [cup, y]], pen);
        self.line(
            &[[middle + 12.0, y - 9.0], [cup, y - 9.0], [cup, y + 9.0], [middle + 12.0, y + 9.0]],
            pen,
        );
        self.line(&[[piston, y - 6.0], [piston, y + 6.0]], pen);
        self.line(&[[piston, y], [to, y]], pen);
    }

    /// A surface that does not move, hatched below.
    pub(crate) fn ground(&mut self, [x, y]: Point, to: f64) {
        let count = ((to - x) / 12.0) as usize;
        let marks = (0..count).map(|k| format!("M{:.1} {y:.1}l-6 7", x + 6.0 + 12.0 * k as f64));
        self.path(&marks.collect::<String>(), NONE, Pen::new(GREY, 1.0));
        self.line(&[[x, y], [to, y]], EDGE);
    }
}

fn joined(points: &[Point]) -> String {
    let all: Vec<String> = points.iter().map(|[x, y]| format!("{x:.1} {y:.1}")).collect();
    all.join("L")
}

/// `{z|def}` as tags.
fn set(words: &str) -> String {
    let mut parts = words.split('{');
    let mut text = parts.next().unwrap_or_default().to_owned();
    let mut up = "";
    for part in parts {
        let (symbol, rest) = part.split_once('}').unwrap_or((part, ""));
        let (letter, index) = symbol.split_once('|').unwrap_or((symbol, ""));
        let _ = write!(text, "<tspan font-style=\"italic\"{up}>{letter}</tspan>");
        up = "";
        if !index.is_empty() {
            let _ = write!(text, "<tspan dy=\"4\" font-size=\"10\">{index}</tspan>");
            up = " dy=\"-4\"";
        }
        if !rest.is_empty() {
            let _ = write!(text, "<tspan{up}>{rest}</tspan>");
            up = "";
        }
    }
    text
}
