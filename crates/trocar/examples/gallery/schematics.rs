//! Schematics of trocar, models and bench. Lips are those of the plausible seal at states of its model.

use trocar_model::{DeformationForce, Direction, ElementParams};

use super::Outcome;
use super::moving_seal::{LIP_HEIGHT_MM, lip_outline};
use super::sheet::{
    Align, BLUE, EDGE, GREY, HATCHED, INK, NONE, ORANGE, PALE, PALE_BLUE, PALE_ORANGE, PALE_PURPLE,
    PURPLE, Pen, Point, STEEL, Sheet, WHITE,
};

const MM: f64 = 1e3;
/// Of the instrument, as in the paper.
const RADIUS_MM: f64 = 5.0;
/// Thickness of the wall of a trocar.
const WALL_MM: f64 = 3.6;

const MOVES: Pen = Pen::new(BLUE, 2.2);
const DEFLECTS: Pen = Pen::new(PURPLE, 1.6);
const SLIDES: Pen = Pen::new(ORANGE, 1.8);
const GUIDE: Pen = Pen::dashed(GREY);

fn deformation() -> Outcome<DeformationForce> {
    Ok(ElementParams::plausible_10_5_mm()?.deformation)
}

/// A section through wall, lip and instrument, whose upper lip is clamped at `clamp`, in pixels.
struct Section {
    clamp: Point,
    pixels_per_mm: f64,
}

impl Section {
    fn surface(&self) -> f64 {
        self.clamp[1] + self.pixels_per_mm * LIP_HEIGHT_MM
    }

    fn axis(&self) -> f64 {
        self.surface() + self.pixels_per_mm * RADIUS_MM
    }

    fn x(&self, mm: f64) -> f64 {
        self.clamp[0] + self.pixels_per_mm * mm
    }

    /// Both sides of what is above the axis.
    fn twice(&self, sheet: &mut Sheet, above: &[Point], fill: &str, pen: Pen) {
        let below: Vec<Point> = above.iter().map(|[x, y]| [*x, 2.0 * self.axis() - y]).collect();
        sheet.area(above, fill, pen);
        sheet.area(&below, fill, pen);
    }

    fn lips(&self, sheet: &mut Sheet, force: &DeformationForce, z_m: f64, direction: Direction) {
        let outline = lip_outline(force, z_m, force.branch(direction).force(z_m));
        let place = |[x, y]: [f64; 2]| [self.x(x), self.clamp[1] + self.pixels_per_mm * y];
        let lip: Vec<Point> = outline.into_iter().map(place).collect();
        self.twice(sheet, &lip, PURPLE, Pen::new(PURPLE, 1.0));
    }

    fn walls(&self, sheet: &mut Sheet, [from, to]: [f64; 2]) {
        let [_, y] = self.clamp;
        let top = y - self.pixels_per_mm * WALL_MM;
        self.twice(sheet, &[[from, top], [to, top], [to, y], [from, y]], HATCHED, EDGE);
    }

    /// The instrument from `from` to its round tip.
    fn instrument(&self, sheet: &mut Sheet, from: f64, tip: f64) {
        let (top, radius) = (self.surface(), self.axis() - self.surface());
        let flank = tip - 1.2 * radius;
        let d = format!(
            "M{from:.1} {top:.1}H{flank:.1}Q{tip:.1} {top:.1} {tip:.1} {:.1}Q{tip:.1} {:.1} {flank:.1} {:.1}H{from:.1}",
            top + radius,
            top + 2.0 * radius,
            top + 2.0 * radius
        );
        sheet.path(&d, STEEL, EDGE);
    }
}

/// One reversal in four states.
pub(crate) fn trocar() -> Outcome<Sheet> {
    /// Deflection, how far the instrument is from where it reversed, and where the lip is on the way.
    const STATES: [(char, &str, f64, f64, Direction); 4] = [
        ('a', "inserted: the seal slides", 8.0, 0.0, Direction::Insertion),
        ('b', "reversed: the seal deforms", 4.5, -3.5, Direction::Withdrawal),
        ('c', "the lip snaps through", -0.5, -8.5, Direction::Withdrawal),
        ('d', "withdrawn: the seal slides", -8.0, -20.0, Direction::Withdrawal),
    ];
    let force = deformation()?;
    let mut sheet = Sheet::new(640.0, 582.0);
    for (k, (letter, words, z, moved, direction)) in STATES.into_iter().enumerate() {
        let left = if k % 2 == 0 { 10.0 } else { 335.0 };
        let top = if k < 2 { 0.0 } else { 275.0 };
        let section = Section { clamp: [left + 135.0, top + 64.0], pixels_per_mm: 5.0 };
        let (axis, contact) = (section.axis(), section.x(z));
        sheet.heading([left, top + 24.0], letter, words);
        section.instrument(&mut sheet, left, left + 285.0 + 5.0 * moved);
        section.lips(&mut sheet, &force, z / MM, direction);
        section.walls(&mut sheet, [left + 65.0, left + 225.0]);
        let way = if moved < 0.0 { [left + 78.0, left + 28.0] } else { [left + 28.0, left + 78.0] };
        sheet.arrow(&way.map(|x| [x, axis + 8.0]), MOVES);
        sheet.text([left + 53.0, axis - 2.0], Align::Middle, BLUE, "{v|d}");
        let below = 2.0 * axis - section.clamp[1] + 34.0;
        sheet.line(&[[section.x(0.0), below - 16.0], [section.x(0.0), below + 6.0]], GUIDE);
        if z.abs() > 2.0 {
            sheet.line(
                &[[contact, 2.0 * axis - section.surface()], [contact, below + 6.0]],
                Pen::dashed(PURPLE),
            );
            sheet.arrow(&[[section.x(0.0), below], [contact, below]], DEFLECTS);
        }
        let name = match k {
            0 => "{z} = {c}",
            2 => "{z} ≈ 0",
            3 => "{z} = −{c}",
            _ => "{z}",
        };
        let beside = section.x(0.0) + if z > 0.0 { -8.0 } else { 8.0 };
        let align = if z > 0.0 { Align::End } else { Align::Start };
        sheet.text([beside, below + 4.0], align, PURPLE, name);
        if k == 0 {
            sheet.text([left + 222.0, section.clamp[1] + 18.0], Align::End, GREY, "wall");
            sheet.text([section.x(0.0) - 12.0, section.clamp[1] + 34.0], Align::End, PURPLE, "lip");
            sheet.text([left + 165.0, axis + 5.0], Align::Start, INK, "instrument");
        }
    }
    sheet.text([320.0, 572.0], Align::Middle, GREY, "outside the body ← → inside");
    Ok(sheet)
}

/// One stage of a seal, and the element.
pub(crate) fn ems_element() -> Outcome<Sheet> {
    let mut sheet = Sheet::new(640.0, 350.0);
    let force = deformation()?;
    sheet.heading([10.0, 24.0], 'a', "one stage of the seal");
    let section = Section { clamp: [140.0, 84.0], pixels_per_mm: 4.6 };
    let z = 5.5;
    section.instrument(&mut sheet, 10.0, 290.0);
    section.lips(&mut sheet, &force, z / MM, Direction::Insertion);
    section.walls(&mut sheet, [75.0, 285.0]);
    let (fixed, contact, point) = (section.x(0.0), section.x(z), 232.0);
    let (surface, low) = (section.surface(), 290.0);
    sheet.line(&[[fixed, 48.0], [fixed, low + 22.0]], GUIDE);
    sheet.line(&[[contact, surface], [contact, low]], Pen::dashed(PURPLE));
    sheet.line(&[[point, surface], [point, low + 22.0]], Pen::dashed(BLUE));
    sheet.dot([fixed, section.clamp[1]], INK);
    sheet.dot([contact, surface], PURPLE);
    sheet.dot([point, surface], BLUE);
    sheet.text([fixed - 8.0, 56.0], Align::End, INK, "{O}");
    sheet.text([contact + 8.0, surface - 8.0], Align::Start, PURPLE, "{A}");
    sheet.text([point + 8.0, surface - 8.0], Align::Start, BLUE, "{B}");
    sheet.arrow(&[[fixed, low - 6.0], [contact, low - 6.0]], DEFLECTS);
    sheet.text([contact + 8.0, low - 2.0], Align::Start, PURPLE, "{z|def}");
    sheet.arrow(&[[fixed, low + 16.0], [point, low + 16.0]], MOVES);
    sheet.text([point + 8.0, low + 20.0], Align::Start, BLUE, "{x}");
    element(&mut sheet);
    sheet.text([485.0, 338.0], Align::Middle, INK, "{v|d} = {ż|def} + {v|sl}");
    Ok(sheet)
}

/// The right half: spring, damper, contact and instrument.
fn element(sheet: &mut Sheet) {
    const WALL: f64 = 354.0;
    const BLOCK: [f64; 2] = [462.0, 522.0];
    sheet.heading([335.0, 24.0], 'b', "EMS element");
    sheet.rect([WALL - 14.0, 74.0], [14.0, 106.0], HATCHED, EDGE);
    sheet.text([WALL - 7.0, 66.0], Align::Middle, INK, "{O}");
    sheet.spring([WALL, 98.0], BLOCK[0], DEFLECTS);
    sheet.arrow(&[[386.0, 116.0], [432.0, 78.0]], DEFLECTS);
    sheet.text([400.0, 70.0], Align::Middle, PURPLE, "{k}({z|def})");
    sheet.damper([WALL, 150.0], BLOCK[0], DEFLECTS);
    sheet.text([408.0, 182.0], Align::Middle, PURPLE, "{σ}({ż|def})");
    sheet.rect([BLOCK[0], 80.0], [BLOCK[1] - BLOCK[0], 86.0], PALE_PURPLE, DEFLECTS);
    sheet.text([492.0, 128.0], Align::Middle, PURPLE, "{A}");
    sheet.line(&[[BLOCK[0] + 2.0, 168.0], [BLOCK[1] - 2.0, 168.0]], Pen::new(ORANGE, 3.5));
    sheet.rect([440.0, 170.0], [185.0, 28.0], STEEL, EDGE);
    sheet.text([530.0, 156.0], Align::Start, ORANGE, "sliding force");
    sheet.dot([580.0, 184.0], BLUE);
    sheet.text([590.0, 189.0], Align::Start, BLUE, "{B}");
    sheet.line(&[[WALL, 180.0], [WALL, 256.0]], GUIDE);
    sheet.line(&[[492.0, 198.0], [492.0, 256.0]], Pen::dashed(PURPLE));
    sheet.line(&[[580.0, 190.0], [580.0, 300.0]], Pen::dashed(BLUE));
    sheet.distance([WALL, 250.0], [492.0, 250.0], DEFLECTS);
    sheet.text([423.0, 268.0], Align::Middle, PURPLE, "{z|def}");
    sheet.arrow(&[[492.0, 222.0], [540.0, 222.0]], SLIDES);
    sheet.text([546.0, 226.0], Align::Start, ORANGE, "{v|sl}");
    sheet.arrow(&[[580.0, 290.0], [628.0, 290.0]], MOVES);
    sheet.text([604.0, 282.0], Align::Middle, BLUE, "{v|d}");
}

/// Elements in parallel, of which the weakest slides.
pub(crate) fn maxwell_slip() -> Outcome<Sheet> {
    /// Index, height, and deflection in pixels.
    const ELEMENTS: [(&str, f64, f64); 3] =
        [("1", 66.0, 26.0), ("2", 152.0, 44.0), ("N", 262.0, 44.0)];
    const WALL: f64 = 34.0;
    const REST: f64 = 190.0;
    const CARRIER: f64 = 500.0;
    let mut sheet = Sheet::new(640.0, 366.0);
    sheet.rect([WALL - 14.0, 26.0], [14.0, 326.0], HATCHED, EDGE);
    sheet.rect([CARRIER, 26.0], [14.0, 326.0], STEEL, EDGE);
    sheet.line(&[[REST, 26.0], [REST, 290.0]], GUIDE);
    for (k, (index, y, z)) in ELEMENTS.into_iter().enumerate() {
        let block = REST + z;
        sheet.spring([WALL, y], block, EDGE);
        sheet.text([112.0, y - 16.0], Align::Middle, INK, &format!("{{k|{index}}}"));
        sheet.rect([block, y - 17.0], [90.0, 34.0], PALE_PURPLE, DEFLECTS);
        sheet.text([block + 45.0, y + 5.0], Align::Middle, PURPLE, &format!("{{F|{index}}}"));
        sheet.ground([REST + 8.0, y + 20.0], 410.0);
        sheet.line(&[[410.0, y + 20.0], [430.0, y + 20.0], [430.0, y], [CARRIER, y]], EDGE);
        sheet.arrow(&[[REST, y - 27.0], [block, y - 27.0]], DEFLECTS);
        sheet.text([block + 6.0, y - 23.0], Align::Start, PURPLE, &format!("{{z|{index}}}"));
        if k == 0 {
            sheet.line(&[[block + 2.0, y + 18.0], [block + 88.0, y + 18.0]], Pen::new(ORANGE, 3.0));
        }
        let (colour, words) =
            if k == 0 { (ORANGE, "slides: {k|1}{z|1} = {F|1}") } else { (GREY, "sticks") };
        sheet.text([block + 98.0, y - 4.0], Align::Start, colour, words);
    }
    for y in [197.0, 207.0, 217.0] {
        sheet.path(&format!("M278 {y}h0.1"), NONE, Pen::new(INK, 3.0));
    }
    sheet.text([REST, 306.0], Align::Middle, GREY, "springs relaxed");
    sheet.damper([WALL, 330.0], CARRIER, EDGE);
    sheet.text([267.0, 358.0], Align::Middle, INK, "{β}");
    sheet.arrow(&[[514.0, 189.0], [586.0, 189.0]], MOVES);
    sheet.text([550.0, 178.0], Align::Middle, BLUE, "{v}, {F|f}");
    Ok(sheet)
}

/// Motor, sensor, rod and trocar.
pub(crate) fn test_bench() -> Outcome<Sheet> {
    let mut sheet = Sheet::new(640.0, 346.0);
    motor(&mut sheet);
    let section = Section { clamp: [452.0, 88.0], pixels_per_mm: 2.6 };
    let (axis, surface) = (section.axis(), section.surface());
    section.instrument(&mut sheet, 298.0, 596.0);
    section.lips(&mut sheet, &deformation()?, 6.0 / MM, Direction::Insertion);
    let [_, inner] = section.clamp;
    let cannula = surface - 5.0;
    let wall = [
        [424.0, inner - 12.0],
        [500.0, inner - 12.0],
        [500.0, cannula - 8.0],
        [624.0, cannula - 8.0],
        [624.0, cannula],
        [488.0, cannula],
        [488.0, inner],
        [424.0, inner],
    ];
    section.twice(&mut sheet, &wall, HATCHED, EDGE);
    let foot = 2.0 * axis - inner + 12.0;
    sheet.line(&[[462.0, foot], [462.0, foot + 26.0]], EDGE);
    sheet.ground([432.0, foot + 26.0], 492.0);
    sheet.text([462.0, inner - 22.0], Align::Middle, INK, "trocar, fixed");
    sheet.text([418.0, inner + 8.0], Align::End, PURPLE, "seal");
    sheet.line(&[[420.0, inner + 4.0], [455.0, inner + 10.0]], Pen::new(PURPLE, 1.0));
    sheet.text([352.0, axis + 5.0], Align::Middle, INK, "rod");
    sheet.arrow(&[[306.0, axis + 34.0], [396.0, axis + 34.0]], MOVES);
    sheet.text([300.0, axis + 54.0], Align::Start, BLUE, "{x}, {v}, {F} &gt; 0");
    sheet.rect([254.0, axis - 25.0], [44.0, 50.0], PALE_ORANGE, Pen::new(ORANGE, 1.8));
    sheet.text([276.0, axis + 5.0], Align::Middle, ORANGE, "{F}");
    sheet.text([276.0, axis - 50.0], Align::Middle, ORANGE, "force");
    sheet.text([276.0, axis - 34.0], Align::Middle, ORANGE, "sensor");
    signals(&mut sheet, axis);
    Ok(sheet)
}

/// Stator, slider and encoder.
fn motor(sheet: &mut Sheet) {
    let axis = Section { clamp: [0.0, 88.0], pixels_per_mm: 2.6 }.axis();
    sheet.rect([16.0, axis - 70.0], [166.0, 140.0], PALE, EDGE);
    sheet.text([99.0, axis - 80.0], Align::Middle, INK, "linear motor");
    for k in 0..7 {
        for y in [axis - 38.0, axis + 20.0] {
            sheet.rect(
                [30.0 + 21.0 * f64::from(k), y],
                [12.0, 18.0],
                "#c9d3dc",
                Pen::new(GREY, 1.0),
            );
        }
    }
    sheet.rect([26.0, axis - 15.0], [228.0, 30.0], STEEL, EDGE);
    sheet.text([140.0, axis + 5.0], Align::Middle, INK, "slider");
    sheet.rect([30.0, axis + 44.0], [76.0, 24.0], PALE_BLUE, Pen::new(BLUE, 1.5));
    sheet.text([68.0, axis + 61.0], Align::Middle, BLUE, "encoder");
    sheet.line(&[[44.0, axis + 44.0], [44.0, axis + 15.0]], Pen::dashed(BLUE));
}

/// What the controller sends and what it records.
fn signals(sheet: &mut Sheet, axis: f64) {
    const TOP: f64 = 276.0;
    sheet.rect([40.0, TOP], [330.0, 56.0], WHITE, EDGE);
    sheet.text([205.0, TOP + 24.0], Align::Middle, INK, "controller and recorder");
    sheet.text([205.0, TOP + 44.0], Align::Middle, GREY, "time, position, force");
    sheet.arrow(&[[68.0, axis + 68.0], [68.0, TOP]], Pen::new(BLUE, 1.5));
    sheet.text([76.0, TOP - 18.0], Align::Start, BLUE, "{x}");
    sheet.arrow(&[[150.0, TOP], [150.0, axis + 70.0]], EDGE);
    sheet.text([158.0, TOP - 18.0], Align::Start, INK, "current");
    sheet.arrow(&[[276.0, axis + 25.0], [276.0, TOP]], Pen::new(ORANGE, 1.5));
    sheet.text([284.0, TOP - 18.0], Align::Start, ORANGE, "{F}");
}
