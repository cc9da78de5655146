//! Common style of all figures: colours that remain distinguishable with colour blindness and in
//! grey print, in light and in dark mode.

use trocar_model::Classical;

use super::document::Role;

/// Drawing style of a role.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Style {
    /// Name of the CSS custom property (`--<class>`), shared with the script.
    pub(super) class: &'static str,
    /// Colour on white, with a contrast of at least 3:1.
    pub(super) light: &'static str,
    /// Colour on the dark background, with a contrast of at least 3:1.
    pub(super) dark: &'static str,
    /// Line width in pixels (1 px = 0.25 mm on paper).
    pub(super) width: f64,
    /// Dash and gap lengths in pixels; empty for a solid line.
    pub(super) dash: &'static [f64],
    /// Marker of points.
    pub(super) marker: Marker,
}

/// Marker shapes, distinguishable without colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Marker {
    Circle,
    Square,
    Triangle,
    Diamond,
}

impl Marker {
    /// Name used by the script.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Marker::Circle => "circle",
            Marker::Square => "square",
            Marker::Triangle => "triangle",
            Marker::Diamond => "diamond",
        }
    }
}

const fn style(
    class: &'static str,
    [light, dark]: [&'static str; 2],
    width: f64,
    dash: &'static [f64],
    marker: Marker,
) -> Style {
    Style { class, light, dark, width, dash, marker }
}

const SOLID: &[f64] = &[];
const DASHED: &[f64] = &[8.0, 6.0];
const DOTTED: &[f64] = &[2.0, 4.0];

/// Kinds of friction models that have a colour of their own: EMS, then the classical ones in the
/// order of their declaration.
const KINDS: usize = 8;

/// Colours of the kinds, light and dark, and darker ones for their dashed variants, so that dashes
/// are visible on a coincident solid line.
const BLUE: [&str; 2] = ["#0064b0", "#5db3ff"];
const BLUE_DEEP: [&str; 2] = ["#00284d", "#cfe8ff"];
const GOLD: [&str; 2] = ["#856a00", "#d9b93a"];
const GOLD_DEEP: [&str; 2] = ["#3a2e00", "#fff0b0"];
const VIOLET: [&str; 2] = ["#6a4fc0", "#b8a2ff"];
const VIOLET_DEEP: [&str; 2] = ["#2b1766", "#e9e2ff"];
const MAGENTA: [&str; 2] = ["#c02a7c", "#ff8fc4"];
const MAGENTA_DEEP: [&str; 2] = ["#6b0c40", "#ffdcee"];
const GREEN: [&str; 2] = ["#00785a", "#4fd1a5"];
const GREEN_DEEP: [&str; 2] = ["#003326", "#c9f7e6"];
const ORANGE: [&str; 2] = ["#c04a00", "#ff9a55"];
const ORANGE_DEEP: [&str; 2] = ["#4d1d00", "#ffe0c8"];
const RED: [&str; 2] = ["#a32020", "#ff7a70"];
const RED_DEEP: [&str; 2] = ["#3d0505", "#ffd9d5"];
const OLIVE: [&str; 2] = ["#4d6b00", "#a9cf4a"];
const OLIVE_DEEP: [&str; 2] = ["#1f2b00", "#e6f7b8"];

/// Classes of a map's values.
const LEVELS: usize = 7;

/// A class of a map: the same area in both modes, so one colour.
const fn level(class: &'static str, colour: &'static str) -> Style {
    style(class, [colour, colour], 0.0, SOLID, Marker::Square)
}

// Okabe and Ito's hues, darkened (brightened) to a contrast of 3:1 with white (the dark page).
// Lightness differs between roles in the same panel; where it cannot, dashes and markers differ.
const STYLES: [Style; 16 + 3 * KINDS + 1 + LEVELS] = [
    style("measured", ["#4a4a4a", "#bdbdbd"], 1.0, &[], Marker::Circle),
    style("model", ["#0064b0", "#5db3ff"], 2.4, &[], Marker::Square),
    style("fit", ["#c8420a", "#ff9a66"], 1.8, &[], Marker::Diamond),
    style("alternative", ["#00785a", "#4fd1a5"], 1.5, &[6.0, 3.0], Marker::Triangle),
    style("lower", ["#0064b0", "#5db3ff"], 1.3, &[6.0, 3.0], Marker::Triangle),
    style("upper", ["#202020", "#e6e6e6"], 1.3, &[2.0, 2.0], Marker::Diamond),
    style("deflection", ["#8e3a80", "#e08fd2"], 1.6, &[], Marker::Triangle),
    style("residual", ["#4a4a4a", "#bdbdbd"], 0.8, &[], Marker::Circle),
    style("reference", ["#202020", "#e6e6e6"], 1.5, &[8.0, 3.0, 2.0, 3.0], Marker::Diamond),
    style("neutral", ["#707070", "#9c9c9c"], 1.0, &[3.0, 3.0], Marker::Circle),
    style("category-0", ["#0072b2", "#56b4e9"], 1.5, &[], Marker::Circle),
    style("category-1", ["#c8500a", "#ff9955"], 1.5, &[6.0, 3.0], Marker::Square),
    style("category-2", ["#007a5a", "#3fd1a0"], 1.5, &[2.0, 2.0], Marker::Triangle),
    style("category-3", ["#a6467e", "#e79ac6"], 1.5, &[8.0, 3.0, 2.0, 3.0], Marker::Diamond),
    style("category-4", ["#806600", "#e6c84b"], 1.5, &[12.0, 3.0], Marker::Square),
    style("category-5", ["#303030", "#dddddd"], 1.5, &[4.0, 2.0], Marker::Triangle),
    style("friction-0-0", BLUE, 2.0, SOLID, Marker::Diamond),
    style("friction-0-1", BLUE_DEEP, 1.6, DASHED, Marker::Diamond),
    style("friction-0-2", BLUE_DEEP, 1.6, DOTTED, Marker::Diamond),
    style("friction-1-0", GOLD, 1.6, SOLID, Marker::Triangle),
    style("friction-1-1", GOLD_DEEP, 1.6, DASHED, Marker::Triangle),
    style("friction-1-2", GOLD_DEEP, 1.6, DOTTED, Marker::Triangle),
    style("friction-2-0", VIOLET, 1.6, SOLID, Marker::Square),
    style("friction-2-1", VIOLET_DEEP, 1.6, DASHED, Marker::Square),
    style("friction-2-2", VIOLET_DEEP, 1.6, DOTTED, Marker::Square),
    style("friction-3-0", MAGENTA, 1.6, DASHED, Marker::Circle),
    style("friction-3-1", MAGENTA_DEEP, 1.6, DOTTED, Marker::Circle),
    style("friction-3-2", MAGENTA_DEEP, 1.6, SOLID, Marker::Circle),
    style("friction-4-0", GREEN, 1.6, SOLID, Marker::Triangle),
    style("friction-4-1", GREEN_DEEP, 1.6, DASHED, Marker::Triangle),
    style("friction-4-2", GREEN_DEEP, 1.6, DOTTED, Marker::Triangle),
    style("friction-5-0", ORANGE, 1.6, SOLID, Marker::Square),
    style("friction-5-1", ORANGE_DEEP, 1.6, DASHED, Marker::Square),
    style("friction-5-2", ORANGE_DEEP, 1.6, DOTTED, Marker::Square),
    style("friction-6-0", RED, 1.6, SOLID, Marker::Circle),
    style("friction-6-1", RED_DEEP, 1.6, DASHED, Marker::Circle),
    style("friction-6-2", RED_DEEP, 1.6, DOTTED, Marker::Circle),
    style("friction-7-0", OLIVE, 1.6, DASHED, Marker::Diamond),
    style("friction-7-1", OLIVE_DEEP, 1.6, DOTTED, Marker::Diamond),
    style("friction-7-2", OLIVE_DEEP, 1.6, SOLID, Marker::Diamond),
    style("backdrop", ["#a9afb5", "#6f777f"], 3.2, SOLID, Marker::Circle),
    level("level-0", "#440154"),
    level("level-1", "#443983"),
    level("level-2", "#31688e"),
    level("level-3", "#21918c"),
    level("level-4", "#35b779"),
    level("level-5", "#90d743"),
    level("level-6", "#fde725"),
];

/// Every style, for the style sheet.
pub(super) const fn all() -> &'static [Style] {
    &STYLES
}

/// Place of a kind of friction models among the styles; EMS is the first, and after the last colour
/// they begin anew.
pub(super) fn place(kind: &str) -> usize {
    Classical::KINDS.iter().position(|own| *own == kind).map_or(0, |at| at + 1) % KINDS
}

/// CSS custom properties that hold a colour of each of `styles`.
pub(super) fn variables<'s>(
    styles: impl IntoIterator<Item = &'s Style>,
    colour: fn(&Style) -> &'static str,
) -> String {
    styles.into_iter().map(|style| format!("--{}:{};", style.class, colour(style))).collect()
}

/// The style of a role.
pub(super) fn of(role: Role) -> Style {
    let index = match role {
        Role::Measured => 0,
        Role::Model => 1,
        Role::Fit => 2,
        Role::Alternative => 3,
        Role::Lower => 4,
        Role::Upper => 5,
        Role::Deflection => 6,
        Role::Residual => 7,
        Role::Reference => 8,
        Role::Neutral => 9,
        Role::Category(n) => 10 + usize::from(n) % 6,
        Role::Backdrop => 16 + 3 * KINDS,
        Role::Level(n) => 16 + 3 * KINDS + 1 + usize::from(n).min(LEVELS - 1),
        Role::Friction(kind, variant) => 16 + 3 * place(kind) + usize::from(variant) % 3,
    };
    STYLES[index]
}

/// Colour of a text upon an area of a map: white upon the lower half of the classes, black upon the others.
pub(super) fn ink_upon(role: Role) -> &'static str {
    if matches!(role, Role::Level(0..=2)) { "#ffffff" } else { "#1a1a1a" }
}

/// Opacity of a filled band.
pub(super) const BAND_OPACITY: f64 = 0.18;

/// Radius of a marker in pixels: smaller where there are many.
pub(super) const fn marker_radius(count: usize) -> f64 {
    match count {
        0..=80 => 2.6,
        81..=400 => 1.9,
        _ => 1.2,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative luminance (WCAG 2.2).
    fn luminance(colour: &str) -> f64 {
        let channel = |at: usize| {
            let value =
                f64::from(u8::from_str_radix(&colour[at..at + 2], 16).expect("hexadecimal"))
                    / 255.0;
            if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
        };
        0.2126 * channel(1) + 0.7152 * channel(3) + 0.0722 * channel(5)
    }

    fn contrast(a: &str, b: &str) -> f64 {
        let (a, b) = (luminance(a), luminance(b));
        (a.max(b) + 0.05) / (a.min(b) + 0.05)
    }

    #[test]
    fn every_role_contrasts_with_both_pages() {
        // Wide lines behind all others need less contrast, and areas stand beside each other.
        let is_line = |style: &&Style| style.class != "backdrop" && style.width > 0.0;
        for style in all().iter().filter(is_line) {
            assert!(contrast(style.light, "#ffffff") >= 4.5, "{} on white", style.class);
            assert!(contrast(style.dark, "#16191d") >= 4.5, "{} on the dark page", style.class);
        }
    }
}
