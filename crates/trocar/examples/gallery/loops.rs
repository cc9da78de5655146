//! A teleoperation loop: what the hand feels through a trocar, and the energy at both ports.

use trocar::model_file::ModelFile;
use trocar::report::teleop::{Source, Sources, document};
use trocar::report::{Axis, Figure, Panel, Role, Series};
use trocar::teleop::config::Press;
use trocar::teleop::{Config, Outcome as Loop, Questions, Study};

use super::{Outcome, chosen};

pub(crate) const PICTURES: [&str; 4] = ["felt", "course", "energy", "transmitted"];

pub(crate) fn figures() -> Outcome<Vec<Figure>> {
    let mut figures = vec![felt()?];
    figures.extend(loop_of_the_report()?);
    Ok(figures)
}

/// One push by 40 mm from the surface of the tissue and back.
const PUSH: Press = Press {
    middle_m: 0.14,
    amplitude_m: 0.02,
    frequency_hz: 0.5,
    duration_s: 2.0,
    turning_rad_s: 0.0,
};

fn pushed(fraction: f64) -> Config {
    let mut config = Config { motion: PUSH, ..Config::default() };
    config.compensation.fraction = fraction;
    config.compensation.adaptation = false;
    config
}

/// Force felt over the depth of the tip, with more and more of the trocar compensated.
fn felt() -> Outcome<Figure> {
    let file = ModelFile::plausible_10_5_mm()?;
    let surface = Config::default().tissue.surface_m;
    let mut panel =
        Panel::new(Axis::new("depth of the tip in the tissue", "mm"), Axis::new("force felt", "N"))
            .aspect(0.6);
    for (k, fraction) in (0..).zip([0.0, 0.5, 0.8, 0.95]) {
        let config = pushed(fraction);
        let outcome = Loop::of(&config, [&file.trocar, &file.trocar])?;
        let samples = outcome.course.map_err(|diverged| diverged.to_string())?;
        let inside: Vec<_> = samples.iter().filter(|s| s.follower_position >= surface).collect();
        let x = inside.iter().step_by(4).map(|s| 1e3 * (s.follower_position - surface)).collect();
        let y = inside.iter().step_by(4).map(|s| config.felt(s)).collect();
        let name = format!("{:.0} % compensated", 1e2 * fraction);
        panel = panel.series(Series::line(name, Role::Category(k), x, y));
        if k == 0 {
            let x =
                inside.iter().step_by(4).map(|s| 1e3 * (s.follower_position - surface)).collect();
            let y = inside.iter().step_by(4).map(|s| s.tissue_force).collect();
            panel = panel.series(Series::line("tissue alone", Role::Reference, x, y));
        }
    }
    Ok(Figure::new("felt", 1, "What the hand feels").panel(panel).caption(
        "Force felt at the leader during one push into the tissue and out again, over the depth of the tip. Position-force architecture, sensor \
         outside the body, plausible seal; the compensator subtracts a fraction of its force.",
    ))
}

fn loop_of_the_report() -> Outcome<Vec<Figure>> {
    let file = ModelFile::plausible_10_5_mm()?;
    let study = Study::new(pushed(0.8), [&file, &file], &Questions::default(), &|_, _| {})?;
    let sources =
        Sources { config: None, trocar: Source::new("plausible", b""), compensator: None };
    let names = ["course", "energy", "transmitted"].map(|name| (name, name));
    chosen(document(&study, &sources), &names)
}
