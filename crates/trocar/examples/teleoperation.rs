//! What an operator feels through seals of different friction, where a loop is stable, and how much to compensate: the
//! figures of docs/explanation/teleoperation.md, and a table of docs/explanation/compensation.md.
//!
//! ```text
//! cargo run --release -p trocar --example teleoperation [-- FOLDER]
//! ```
//! prints the stiffness that is displayed, and writes the drawings to `FOLDER/figures/displayed-stiffness.svg` and
//! `stability-map.svg`.

use std::error::Error;
use std::path::Path;

use trocar::model_file::ModelFile;
use trocar::report::{
    Axis, Document, Figure, Mark, Panel, Role, Section, Series, teleop, write_document,
};
use trocar::teleop::advise::{Advice, Tried, advise, map};
use trocar::teleop::config::Press;
use trocar::teleop::merit::Merit;
use trocar::teleop::{Candidates, Config, Outcome, candidates};
use trocar_model::{PositionProfile, Trocar};

/// Friction of the seals in sliding, N: what is reported for trocars.
const FRICTION: [f64; 6] = [0.25, 0.5, 1.0, 2.0, 4.0, 8.0];
/// Those of them in the table.
const IN_TABLE: [f64; 2] = [1.0, 4.0];
/// Stiffness of the tissues, N/m.
const TISSUES: [f64; 2] = [50.0, 200.0];
/// Friction of the plausible seal, N.
const PLAUSIBLE: f64 = 3.0;
/// Largest fraction that is drawn.
const MOST: f64 = 1.25;
/// One push by 40 mm from the surface of the tissue: with the default grip even the stiffest seal slides.
const PUSH: Press = Press {
    middle_m: 0.14,
    amplitude_m: 0.02,
    frequency_hz: 0.5,
    duration_s: 1.0,
    turning_rad_s: 0.0,
};
/// Cells of the map along each axis, with the distance of delays (s) and of fractions.
const CELLS: u32 = 11;
const APART: [f64; 2] = [2e-3, 0.15];

#[allow(dead_code)] // the test takes what it calls
fn main() -> Result<(), Box<dyn Error>> {
    let curves = curves()?;
    if let Some(folder) = std::env::args().nth(1) {
        write_document(Path::new(&folder), &document(&curves)?)?;
    }
    print!("{}\n{}\n{}", table(&curves), approaches()?, advised()?);
    Ok(())
}

/// The plausible seal with all its forces scaled so that it slides at `friction`, N.
fn scaled(friction: f64) -> Result<Trocar<Vec<f64>>, Box<dyn Error>> {
    let seal = *ModelFile::plausible_10_5_mm()?.trocar.seal();
    let gain = vec![friction / PLAUSIBLE; 2];
    Ok(Trocar::new(seal, Some(PositionProfile::new(-1.0, 1.0, vec![0.0; 2], gain)?)))
}

/// What was tried with one tissue and one seal.
pub(crate) struct Curve {
    tissue: f64,
    friction: f64,
    tried: Vec<Tried>,
}

pub(crate) fn curves() -> Result<Vec<Curve>, Box<dyn Error>> {
    let mut curves = Vec::new();
    for tissue in TISSUES {
        for friction in FRICTION {
            let mut config = Config::default();
            config.tissue.stiffness_n_m = tissue;
            config.motion = PUSH;
            let trocar = scaled(friction)?;
            let tried = advise(&config, &[[trocar.clone(), trocar]], || ())?.tried;
            curves.push(Curve { tissue, friction, tried });
        }
    }
    Ok(curves)
}

/// A contact by name, with the stiffness that it displays.
type Contact = (&'static str, fn(&Merit) -> Option<f64>);
const CONTACTS: [Contact; 2] = [
    ("from rest", |merit| merit.displayed_from_rest_n_m),
    ("while sliding", |merit| merit.displayed_sliding_n_m),
];

/// Stiffness displayed at some fractions, as a table of Markdown.
pub(crate) fn table(curves: &[Curve]) -> String {
    let shown = [0.0, 0.5, 0.8, 0.9, 1.0, 1.1];
    let heads: String = shown.iter().map(|f| format!(" γ = {f} |")).collect();
    let mut text = format!(
        "| tissue, N/m | friction, N | contact |{heads}\n|---|---|---|{}\n",
        "---|".repeat(shown.len())
    );
    for Curve { tissue, friction, tried } in
        curves.iter().filter(|curve| IN_TABLE.contains(&curve.friction))
    {
        for (contact, of) in CONTACTS {
            let cell = |fraction: &f64| {
                let at = tried.iter().find(|tried| (tried.fraction - fraction).abs() < 1e-9);
                match at.and_then(|tried| tried.merit).map(|merit| of(&merit)) {
                    None => " unstable |".to_owned(),
                    Some(None) => " no contact |".to_owned(),
                    Some(Some(value)) => format!(" {value:.0} |"),
                }
            };
            let cells: String = shown.iter().map(cell).collect();
            text += &format!("| {tissue} | {friction} | {contact} |{cells}\n");
        }
    }
    text
}

/// Ways to the tissue, m.
const APPROACHES: [f64; 6] = [0.0, 0.005, 0.01, 0.02, 0.04, 0.06];

/// Stiffness displayed without compensation, and stiffness of the tissue, over the way to it: one push 40 mm deep into tissue of
/// 50 N/m through the seal of 4 N, as a table of Markdown.
pub(crate) fn approaches() -> Result<String, Box<dyn Error>> {
    let trocar = scaled(4.0)?;
    let mut text = "| approach, mm | displayed, N/m | tissue, N/m |\n|---|---|---|\n".to_owned();
    for approach in APPROACHES {
        let mut config = Config::default();
        config.tissue.stiffness_n_m = TISSUES[0];
        config.motion = Press {
            middle_m: PUSH.middle_m - 0.5 * approach,
            amplitude_m: PUSH.amplitude_m + 0.5 * approach,
            ..PUSH
        };
        let merit = Outcome::of(&config, [&trocar, &trocar])?.figures.ok_or("unstable")?;
        let [displayed, own] = [merit.displayed_stiffness_n_m, merit.true_stiffness_n_m]
            .map(|value| value.map_or("none".to_owned(), |value| format!("{value:.0}")));
        text += &format!("| {:.0} | {displayed} | {own} |\n", 1e3 * approach);
    }
    Ok(text)
}

/// Delays, s, and tissues, N/m, of the loops for which advice is given.
const LOOPS: [(f64, f64); 6] =
    [(0.0, 50.0), (0.0, 200.0), (0.005, 200.0), (0.01, 200.0), (0.01, 400.0), (0.02, 400.0)];

/// How much to compensate of the plausible seal's force in some loops, as a table of Markdown: if it is as the model says, and if
/// it may be wetted, down to 0.55 of its friction.
pub(crate) fn advised() -> Result<String, Box<dyn Error>> {
    let file = ModelFile::plausible_10_5_mm()?;
    let mut text = "| delay, ms | tissue, N/m | stable with γ, % | best | best if wetted to 0.55 | error felt with it, N rms |\n\
                    |---|---|---|---|---|---|\n"
        .to_owned();
    for (delay_s, stiffness_n_m) in LOOPS {
        let mut config = Config::default();
        config.channel.delay_s = delay_s;
        config.tissue.stiffness_n_m = stiffness_n_m;
        let found = |least_friction_scale: f64| {
            let wanted = Candidates { least_friction_scale, ..Candidates::default() };
            advise(&config, &candidates([&file; 2], &wanted)?, || ())
                .map_err(Box::<dyn Error>::from)
        };
        let [dry, wetted] = [found(1.0)?, found(0.55)?];
        let percent = |fraction: f64| format!("{:.1}", 100.0 * fraction);
        let best = |advice: &Advice| advice.fraction.map_or("none".to_owned(), percent);
        let stable: Vec<String> = dry
            .stable
            .iter()
            .map(|[low, high]| format!("{} to {}", percent(*low), percent(*high)))
            .collect();
        let error = wetted.with.map_or("-".to_owned(), |m| format!("{:.2}", m.force_error_rms_n));
        text += &format!(
            "| {} | {stiffness_n_m} | {} | {} | {} | {error} |\n",
            1e3 * delay_s,
            stable.join(", "),
            best(&dry),
            best(&wetted)
        );
    }
    Ok(text)
}

/// Both figures.
///
/// # Errors
/// None in practice: loops and seals are constants.
pub(crate) fn document(curves: &[Curve]) -> Result<Document, Box<dyn Error>> {
    let section = Section::new("Teleoperation").figure(displayed(curves)).figure(stability()?);
    let mut document =
        Document { title: "Teleoperation".into(), sections: vec![section], ..Document::default() };
    document.sections[0].figures.iter_mut().zip(1..).for_each(|(figure, n)| figure.number = n);
    Ok(document)
}

/// Displayed stiffness over the fraction, a panel for each tissue and contact.
fn displayed(curves: &[Curve]) -> Figure {
    let caption = format!(
        "Slope of the force felt over the depth of the tip while it goes deeper, in one push 40 mm deep into the tissue, for seals \
         that slide at {} N (the plausible seal, scaled): from rest at the surface with the seal undeformed, and after an approach of 20 mm, \
         with the seal sliding. Position-force without delay, sensor outside the body, firm grip. A gap: not stable.",
        FRICTION.map(|friction| friction.to_string()).join(", ")
    );
    let figure = Figure::new("displayed-stiffness", 1, "Stiffness displayed through a trocar");
    let panels = TISSUES.iter().flat_map(|tissue| CONTACTS.map(|contact| (tissue, contact)));
    panels.fold(figure.caption(caption).columns(2), |figure, (tissue, (contact, of))| {
        let mut panel = Panel::new(
            Axis::new("fraction compensated γ", "%").with_zero(),
            Axis::new("stiffness displayed", "N/m").logarithmic(),
        )
        .title(format!("{tissue} N/m, contact {contact}"))
        .aspect(0.95);
        for (k, curve) in (0..).zip(curves.iter().filter(|curve| curve.tissue == *tissue)) {
            let shown: Vec<&Tried> = curve.tried.iter().filter(|t| t.fraction <= MOST).collect();
            let x = shown.iter().map(|tried| 100.0 * tried.fraction).collect();
            let value = |tried: &&Tried| tried.merit.and_then(|m| of(&m));
            let y = shown.iter().map(|tried| value(tried).unwrap_or(f64::NAN)).collect();
            let name = format!("{} N", curve.friction);
            panel = panel.series(Series::line(name, Role::Category(k), x, y));
        }
        figure.panel(panel.mark(Mark::y(*tissue, "")))
    })
}

/// The map of the default loop with the plausible seal.
fn stability() -> Result<Figure, Box<dyn Error>> {
    let config = Config::default();
    let trocar = ModelFile::plausible_10_5_mm()?.trocar;
    let steps = |apart: f64| (0..CELLS).map(|k| apart * f64::from(k)).collect::<Vec<f64>>();
    let [delays, fractions] = APART.map(steps);
    let map = map(&config, [&trocar, &trocar], &delays, &fractions, || {})?;
    let mut figure = teleop::stability_map(&config, &map);
    figure.id = "stability-map".into();
    Ok(figure)
}
