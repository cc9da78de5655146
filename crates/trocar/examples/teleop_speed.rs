//! What a teleoperation loop costs: `cargo run --release -p trocar --example teleop_speed`.
//!
//! One second of the default loop at 1 kHz on one core, with the EMS element, with adaptation, and with a Dahl model, which
//! `reference/teleop_speed.py` runs as a plain Python loop; then a stability map of 20 x 20 points on all cores. With
//! `--end` it prints nothing but the positions at the end of the run with the Dahl model, m.

use std::hint::black_box;
use std::time::Instant;

use trocar::model_file::ModelFile;
use trocar::teleop::advise::map;
use trocar::teleop::{Config, Loop};
use trocar_model::{Classical, Dahl, DahlParams, Trocar};

/// Repetitions, of which the fastest counts: the machine may do other things.
const REPETITIONS: u32 = 200;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let ems = ModelFile::plausible_10_5_mm()?.trocar;
    let params =
        DahlParams { stiffness: 600.0, coulomb_force: 2.0, exponent: 1.0, viscous_damping: 0.0 };
    let dahl = Trocar::new(Classical::Dahl(Dahl::new(params)?), None);
    let mut config = Config::default();
    (config.motion.duration_s, config.compensation.fraction) = (1.0, 0.8);
    if std::env::args().nth(1).as_deref() == Some("--end") {
        let course = run(&config, &dahl)?;
        println!("{} {}", course[0], course[1]);
        return Ok(());
    }
    println!("one second of the loop at 1 kHz, one core:");
    for (name, trocar, adaptation) in
        [("EMS", &ems, false), ("EMS, adaptation", &ems, true), ("Dahl", &dahl, false)]
    {
        (config.compensation.adaptation, config.compensation.force_error_n) =
            (adaptation, Some(0.1));
        println!("  {name:16} {:6.3} ms", 1e3 * fastest(|| run(&config, trocar))?);
    }
    config = Config::default();
    let delays: Vec<f64> = (0..20).map(|k| 1e-3 * f64::from(k)).collect();
    let fractions: Vec<f64> = (0..20).map(|k| 0.075 * f64::from(k)).collect();
    let start = Instant::now();
    black_box(map(&config, [&ems, &ems], &delays, &fractions, || ())?);
    let (seconds, threads) = (start.elapsed().as_secs_f64(), rayon::current_num_threads());
    println!("stability map of 20 x 20 points, {threads} threads: {seconds:.1} s");
    Ok(())
}

/// Positions of leader and follower after the last sample.
fn run(config: &Config, trocar: &Trocar<Vec<f64>>) -> Result<[f64; 2], Box<dyn std::error::Error>> {
    let start = config.motion.start_m();
    let mut tried = Loop::new(config, trocar.clone(), trocar.clone(), start)?;
    let mut last = [start; 2];
    for _ in 0..config.samples() {
        let sample = tried.step(|time| config.motion.at(time))?;
        last = [sample.leader_position, sample.follower_position];
    }
    Ok(last)
}

/// Seconds of the fastest of [`REPETITIONS`].
fn fastest<T>(
    mut of: impl FnMut() -> Result<T, Box<dyn std::error::Error>>,
) -> Result<f64, Box<dyn std::error::Error>> {
    let mut fastest = f64::INFINITY;
    for _ in 0..REPETITIONS {
        let start = Instant::now();
        black_box(of()?);
        fastest = fastest.min(start.elapsed().as_secs_f64());
    }
    Ok(fastest)
}
