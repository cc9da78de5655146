//! Known truth: over many seeded benches with random plausible seals, what identify finds and how often its 95 %
//! intervals hold the truth.

use rayon::prelude::*;
use trocar::bench::{BenchConfig, PlausibleSeals, Protocol, random_seal, run};
use trocar::identify::{Estimate, IdentifyOptions, identify};
use trocar_model::Element;

/// Benches; the binomial 95 % band of a coverage of 0.95 over so many is [0.92, 0.98].
const BENCHES: u64 = 200;

struct Outcome {
    seed: u64,
    /// Name, truth, estimate.
    parameters: Vec<(&'static str, f64, Estimate)>,
    rms: f64,
}

fn outcome(seed: u64) -> Outcome {
    let seals = PlausibleSeals { friction_asymmetry: 0.0, ..PlausibleSeals::default() };
    let truth = random_seal(&seals, seed);
    let element = [Element::new(truth).expect("a plausible seal is a model")];
    let mut config = BenchConfig::default();
    if std::env::var("TROCAR_NOFLUCT").is_ok() { config.fluctuation.pass_fraction = 0.0; config.fluctuation.ripple_fraction = 0.0; }
    if std::env::var("TROCAR_NORIPPLE").is_ok() { config.fluctuation.ripple_fraction = 0.0; }
    let recordings: Vec<_> = (if std::env::var("TROCAR_STEADYONLY").is_ok() { vec![Protocol::Steady] } else { vec![Protocol::Steady, Protocol::Dynamic] })
        .into_iter()
        .map(|p| run(&config, p, &element, seed).expect("the rig runs").to_recording(p.name()).expect("finite columns"))
        .map(|r| if std::env::var("TROCAR_MASS").is_ok() { r.without_moving_mass(config.rod.mass_kg, 0.0).unwrap() } else { r })
        .collect();
    let options = IdentifyOptions { bootstrap: 0, seed, ..IdentifyOptions::default() };
    let found = identify(&recordings, &options, &|_, _| {}).expect("steady and dynamic protocols suffice");
    let estimate = |name: &str| found.parameter(name).unwrap_or_else(|| panic!("{name} is a parameter")).clone();
    let two_step = |name: &str| found.two_step_parameters.iter().find(|p| p.name == name).unwrap().estimate.clone();
    if std::env::var("TROCAR_PRINT").is_ok() {
        let bare: Vec<_> = recordings.iter().map(|r| r.clone().without_moving_mass(0.04, 0.0).unwrap()).collect();
        let v = trocar::validate::validate(&element, &bare, found.model.offset);
        let w = trocar::validate::validate(&[found.element], &bare, found.model.offset);
        for k in -10..=10 {
            let z = truth.deformation.half_width() * k as f64 / 10.0;
            let (a, b) = (&truth.deformation, &found.element.params().deformation);
            println!("z {:+.3e} rising {:+.3} {:+.3} falling {:+.3} {:+.3}", z, a.rising().force(z), b.rising().force(z), a.falling().force(z), b.falling().force(z));
        }
        for (n, el, off) in [("truth", element[0], found.model.offset), ("found", found.element, found.model.offset)] {
            for b in &bare {
            let r = trocar::replay::replay(&[el], b, off);
            let mut parts = vec![];
            for chunk in 0..12 { let n = b.len() / 12; let e: f64 = (chunk * n..(chunk + 1) * n).map(|i| (b.force[i] - off - r.force[i]).powi(2)).sum::<f64>() / n as f64; parts.push((e.sqrt() * 1e4).round() / 1e4); }
            let v = trocar::validate::validate(&[el], std::slice::from_ref(b), off);
            println!("{n} {} {:.4} {:?} {:?}", b.name, v.rms_n, v.recordings[0].by_phase, parts);
            }
        }
        println!("{seed} truth rms {:.4} found {:.4} mass {:.4} {:?} {:?}", v.rms_n, w.rms_n, found.model.hidden_mass, found.refinement, found.warnings.iter().map(|w| &w.subject).collect::<Vec<_>>());
    }
    Outcome {
        seed,
        parameters: vec![
            ("coulomb_force_n", truth.insertion.coulomb_force, estimate("coulomb_force_n")),
            ("viscous_damping_n_s_m", truth.insertion.viscous_damping, estimate("viscous_damping_n_s_m")),
            ("half_width_m", truth.deformation.half_width(), estimate("half_width_m")),
            ("two-step coulomb_force_n", truth.insertion.coulomb_force, two_step("coulomb_force_n")),
            ("two-step viscous_damping_n_s_m", truth.insertion.viscous_damping, two_step("viscous_damping_n_s_m")),
            ("two-step half_width_m", truth.deformation.half_width(), two_step("half_width_m")),
        ],
        rms: found.residual_rms,
    }
}

#[test]
fn intervals_cover_the_truth_as_often_as_they_say() {
    let n: u64 = std::env::var("TROCAR_BENCHES").ok().and_then(|s| s.parse().ok()).unwrap_or(BENCHES);
    let outcomes: Vec<Outcome> = (std::env::var("TROCAR_FIRST").map_or(1, |v| v.parse().unwrap())..=n).into_par_iter().map(outcome).collect();
    for k in 0..6 {
        let name = outcomes[0].parameters[k].0;
        let covered = outcomes.iter().filter(|o| o.parameters[k].2.covers(o.parameters[k].1)).count();
        let mut z: Vec<f64> = outcomes.iter().map(|o| (o.parameters[k].2.value - o.parameters[k].1) / o.parameters[k].2.half_width() * 1.96).collect();
        let mean = z.iter().sum::<f64>() / n as f64;
        let sd = (z.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n as f64).sqrt();
        z.sort_by(f64::total_cmp);
        let rel: f64 = outcomes.iter().map(|o| (o.parameters[k].2.value / o.parameters[k].1 - 1.0).powi(2)).sum::<f64>() / n as f64;
        println!("{name:32} coverage {:.3}  z mean {mean:+.2} sd {sd:.2}  min {:.1} max {:.1}  rel rms {:.4}", covered as f64 / n as f64, z[0], z[z.len() - 1], rel.sqrt());
    }
    if std::env::var("TROCAR_PRINT").is_ok() {
        for o in &outcomes {
            println!("seed {} rms {:.4} {}", o.seed, o.rms, o.parameters.iter().map(|(n, t, e)| format!("{} {:.6} {:.6} +- {:.6}{}", &n[..5], t, e.value, e.half_width(), if e.covers(*t) { "" } else { " *" })).collect::<Vec<_>>().join(" | "));
        }
    }
}
