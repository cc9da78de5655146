//! A teleoperation loop: what the hand feels through a trocar, and the energy of it; and the tissue force without it.

use trocar::bench::{BenchConfig, Protocol, config::TissueKind, run};
use trocar::compensate::{CompensateOptions, Compensator};
use trocar::model_file::{ModelFile, SensorInfo};
use trocar::report::teleop::{Source, SourcedModel, TeleopReport, document};
use trocar::report::{Axis, Figure, Panel, Role, Series};
use trocar::teleop::config::Press;
use trocar::teleop::{Config, Outcome as Loop};

use super::{Outcome, chosen, thinned};

pub(crate) const PICTURES: [&str; 5] =
    ["felt", "course", "energy", "transmitted", "compensation"];

pub(crate) fn figures() -> Outcome<Vec<Figure>> {
    let mut figures = vec![felt()?];
    figures.extend(loop_of_the_report()?);
    figures.push(compensation()?);
    Ok(figures)
}

/// One push by 40 mm from the surface of the tissue and back.
const PUSH: Press = Press { middle_m: 0.14, amplitude_m: 0.02, frequency_hz: 0.5, duration_s: 2.0 };

fn pushed(fraction: f64) -> Config {
    let mut config = Config::default();
    config.motion = PUSH;
    config.compensation.fraction = fraction;
    config
}

/// Force felt over the depth of the tip, with more and more of the trocar taken out.
fn felt() -> Outcome<Figure> {
    let file = ModelFile::plausible_10_5_mm()?;
    let surface = Config::default().tissue.surface_m;
    let mut panel = Panel::new(Axis::new("depth of the tip in the tissue", "mm"), Axis::new("force felt", "N")).aspect(0.6);
    for (k, fraction) in (0..).zip([0.0, 0.5, 0.8, 0.95]) {
        let config = pushed(fraction);
        let outcome = Loop::of(&config, [&file.trocar, &file.trocar])?;
        let samples = outcome.course.map_err(|diverged| diverged.to_string())?;
        let inside: Vec<_> = samples.iter().filter(|s| s.slave_position >= surface).collect();
        let x = inside.iter().step_by(4).map(|s| 1e3 * (s.slave_position - surface)).collect();
        let y = inside.iter().step_by(4).map(|s| config.felt(s)).collect();
        let name = format!("{:.0} % taken out", 1e2 * fraction);
        panel = panel.series(Series::line(name, Role::Category(k), x, y));
        if k == 0 {
            let x = inside.iter().step_by(4).map(|s| 1e3 * (s.slave_position - surface)).collect();
            let y = inside.iter().step_by(4).map(|s| s.tissue_force).collect();
            panel = panel.series(Series::line("tissue alone", Role::Reference, x, y));
        }
    }
    Ok(Figure::new("felt", 1, "What the hand feels").panel(panel).caption(
        "Force felt at the master during one push into the tissue and out again, over the depth of the tip. Position-force architecture, sensor \
         outside the body, plausible seal; the compensator takes out a fraction of its force.",
    ))
}

fn loop_of_the_report() -> Outcome<Vec<Figure>> {
    let file = ModelFile::plausible_10_5_mm()?;
    let config = pushed(0.8);
    let outcome = Loop::of(&config, [&file.trocar, &file.trocar])?;
    let input = TeleopReport {
        config: &config,
        config_source: None,
        trocar: SourcedModel { trocar: &file.trocar, source: Source::new("plausible", b"") },
        compensator: None,
        course: outcome.course.as_deref().map_err(|diverged| *diverged),
        settles: outcome.settles,
        figures: outcome.figures.as_ref(),
        z_width: None,
        advice: None,
        map: None,
    };
    let names = ["course", "energy", "transmitted"].map(|name| (name, name));
    chosen(document(&input), &names)
}

/// The tissue's force from a sensor outside the body, while the seal is wetted.
fn compensation() -> Outcome<Figure> {
    const FROM: usize = 34_000;
    let mut config = BenchConfig::default();
    config.protocol.surgeon.duration_s = 60.0;
    (config.tissue.kind, config.tissue.surface_m) = (TissueKind::HuntCrossley, 0.09);
    (config.lubrication.level, config.lubrication.onset_s) = (0.65, 42.0);
    let plausible = ModelFile::plausible_10_5_mm()?;
    let record = run(&config, Protocol::Surgeon, plausible.stages()?.elements(), 11)?;
    let offset_n = config.force_sensor.tare_n - config.rod.mass_kg * config.rod.gravity_m_s2;
    let moving_mass_kg = config.rod.mass_kg;
    let sensor = Some(SensorInfo { offset_n, moving_mass_kg, position_delay_s: 0.0 });
    let file = ModelFile { sensor, ..plausible };
    let mut observer = Compensator::new(&file, &CompensateOptions::default())?;
    let (mut tissue, mut scale) = (Vec::new(), Vec::new());
    for (k, (position, force)) in record.position.iter().zip(&record.force).enumerate() {
        let estimate = observer.step(*position, *force, if k == 0 { 0.0 } else { 1e-3 });
        tissue.push(estimate.tissue_force);
        scale.push(observer.drift().level);
    }
    let time = thinned(&record.time[FROM..], 10, 1.0);
    let line = |name: &str, role, column: &[f64]| {
        Series::line(name, role, time.clone(), thinned(&column[FROM..], 10, 1.0))
    };
    let axis = || Axis::new("time", "s");
    let reading = Panel::new(axis(), Axis::new("force", "N"))
        .aspect(0.22)
        .series(line("reading outside the body", Role::Measured, &record.force));
    let tissue = Panel::new(axis(), Axis::new("tissue force", "N"))
        .aspect(0.28)
        .series(line("computed", Role::Model, &tissue))
        .series(line("truth", Role::Reference, &record.truth.tissue_force));
    let scale = Panel::new(axis(), Axis::new("friction scale", ""))
        .aspect(0.18)
        .series(line("computed", Role::Model, &scale))
        .series(line("truth", Role::Reference, &record.truth.wetting));
    Ok(Figure::new("compensation", 1, "Tissue force from outside the body")
        .panel(reading)
        .panel(tissue)
        .panel(scale)
        .linked_x()
        .caption(
            "A hand moves the instrument into tissue (Hunt and Crossley, from 90 mm on) and out. What the sensor outside the body reads less the \
             model's trocar force is the tissue force. From 42 s on the seal is wetted, and the observer finds its friction scale.",
        ))
}
