//! How often the 95 % intervals of a fit to free motion hold the truth.
//!
//! ```text
//! cargo run --release --example free_motion_coverage -- [BENCHES]
//! ```
//! Each bench has a random plausible seal that creeps and relaxes, moved as by a hand for half a
//! minute, with all sensor errors and fluctuations of the default bench. Prints a table in
//! Markdown; the same count gives the same table.

use rayon::prelude::*;
use trocar::bench::{BenchConfig, PlausibleSeals, Protocol, random_seal, run};
use trocar::identify::{Estimate, IdentifyOptions, Term, identify};
use trocar::recording::loads::Load;
use trocar_model::{Element, ElementParams, Relaxation, SealDamping};

/// Parameters with known truth.
const NAMES: [&str; 7] = [
    "coulomb_force_n",
    "viscous_damping_n_s_m",
    "half_width_m",
    "seal_damping_n_s_m",
    "creep_velocity_m_s",
    "relaxation_stiffness_n_m",
    "relaxation_time_s",
];
/// Length of each recording, s.
const DURATION: f64 = 30.0;

fn seal(seed: u64) -> ElementParams {
    let ranges = PlausibleSeals {
        friction_asymmetry: 0.0,
        half_width: (2e-3, 5e-3),
        ..PlausibleSeals::default()
    };
    let mut seal = random_seal(&ranges, seed);
    // Spread over their ranges without a second random source: golden-ratio steps.
    let part = |step: f64| (seed as f64 * step).fract();
    seal.damping = SealDamping { coefficients: [1.0 + 3.0 * part(0.618_034), 0.0, 0.0] };
    seal.creep_velocity = 1e-4 * 4f64.powf(part(0.754_878));
    let stiffness = (0.1 + 0.3 * part(0.569_840)) * seal.insertion.coulomb_force
        / seal.deformation.half_width();
    seal.relaxation = Relaxation::single(stiffness, 0.1 * 10f64.powf(part(0.819_173)));
    seal
}

fn truths(seal: &ElementParams) -> [f64; NAMES.len()] {
    let arm = seal.relaxation.arms[0];
    [
        seal.insertion.coulomb_force,
        seal.insertion.viscous_damping,
        seal.deformation.half_width(),
        seal.damping.coefficients[0],
        seal.creep_velocity,
        arm.stiffness,
        arm.time,
    ]
}

/// Truth and estimate of each parameter; `None` for one that the fit left out.
type Found = [(f64, Option<Estimate>); NAMES.len()];

fn bench(seed: u64) -> Result<Found, Box<dyn std::error::Error + Send + Sync>> {
    let seal = seal(seed);
    let mut config = BenchConfig::default();
    config.protocol.surgeon.duration_s = DURATION;
    let recording =
        run(&config, Protocol::Surgeon, &[Element::new(seal)?], seed)?.to_recording("surgeon")?;
    let recording = recording.without_moving_mass(config.rod.mass_kg, config.rod.gravity_m_s2)?;
    let without = vec![Term::SecondStage, Term::SecondRelaxation, Term::Load(Load::Mass)];
    let options = IdentifyOptions { seed, without, ..IdentifyOptions::default() };
    let found = identify(&[recording], &options, &|_, _| {})?;
    let truths = truths(&seal);
    Ok(std::array::from_fn(|k| (truths[k], found.parameter(NAMES[k]).cloned())))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let benches: u64 = std::env::args().nth(1).map_or(Ok(40), |text| text.parse())?;
    let all = (1..=benches).into_par_iter().map(bench).collect::<Result<Vec<Found>, _>>();
    let all = all.map_err(|error| error.to_string())?;
    println!(
        "| parameter | found | determined | interval holds the truth | median error |\n| --- | --- | --- | --- | --- |"
    );
    for (k, name) in NAMES.iter().enumerate() {
        let found: Vec<(f64, &Estimate)> =
            all.iter().filter_map(|bench| Some((bench[k].0, bench[k].1.as_ref()?))).collect();
        let determined: Vec<&(f64, &Estimate)> =
            found.iter().filter(|(_, e)| e.determined).collect();
        let covered = determined.iter().filter(|(truth, e)| e.covers(*truth)).count();
        let mut errors: Vec<f64> =
            determined.iter().map(|(truth, e)| (e.value / truth - 1.0).abs()).collect();
        errors.sort_by(f64::total_cmp);
        let median = errors.get(errors.len() / 2).copied().unwrap_or(f64::NAN);
        println!(
            "| `{name}` | {} of {benches} | {} | {covered} of {} | {:.2} % |",
            found.len(),
            determined.len(),
            determined.len(),
            1e2 * median
        );
    }
    Ok(())
}
