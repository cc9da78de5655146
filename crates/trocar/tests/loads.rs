//! Side force, weight by tilt and gas pressure: in readings, in the identification, and out of both again.

use trocar::bench::config::Loading;
use trocar::bench::{BenchConfig, Protocol, run};
use trocar::identify::{IdentifyOptions, Term};
use trocar::recording::loads::{Load, Loads};
use trocar::recording::{Readings, Recording};
use trocar::validate::{Validation, validate_one};
use trocar::workflow::{Correction, MovingMass, Workflow};
use trocar_model::{Element, ElementParams};

/// To and fro by 10 mm at 10 mm/s, with a rest of a second at either end.
fn to_and_fro(loads: &Loads, offset: f64) -> (Recording, Vec<f64>) {
    let time: Vec<f64> = (0..12_000).map(|k| 1e-3 * f64::from(k)).collect();
    let speed = |t: f64| [10e-3, 0.0, -10e-3, 0.0_f64][t as usize % 4];
    let mut at = 0.0;
    let step = |t: &f64| {
        at += 1e-3 * speed(*t);
        at
    };
    let position = time.iter().map(step).collect();
    let of_seal: Vec<f64> = time.iter().map(|t| 2.0 * (1.3 * t).sin()).collect();
    let side: Vec<f64> = time.iter().map(|t| 3.0 + 2.0 * t.sin()).collect();
    let tilt: Vec<f64> = time.iter().map(|t| 0.1 * t).collect();
    let pressure: Vec<f64> = time.iter().map(|t| 1000.0 + 100.0 * t).collect();
    let reading = |k: usize| {
        let friction = loads[Load::Side] * side[k] * speed(time[k]).signum();
        let weight = loads[Load::Weight] * tilt[k].cos();
        offset + (1.0 + loads[Load::Pressure] * pressure[k]) * of_seal[k] + friction - weight
    };
    let force = (0..time.len()).map(reading).collect();
    let columns = [Some(side), Some(tilt), Some(pressure)];
    let readings = Readings { time, position, force, loads: columns, ..Readings::default() };
    (Recording::from_readings("loaded", &readings, None).unwrap(), of_seal)
}

#[test]
fn the_readings_without_loads_are_those_of_the_seal() {
    let (loads, offset) = (Loads([0.0, 0.2, 1.5, 2e-4]), 0.4);
    let (recording, of_seal) = to_and_fro(&loads, offset);
    let effects = recording.effects();
    let [Some(side), Some(_), Some(_)] = &effects else { panic!("all loads are recorded") };
    let alone = recording.clone().without_loads(&loads, offset);
    let mut known = 0;
    for k in 0..recording.len() {
        // Where the instrument rests or has just turned nobody knows the friction of the cannula.
        let is_moving = (recording.time[k] as usize).is_multiple_of(2);
        assert!(is_moving || recording.time[k].fract() < 0.6 || side[k].is_nan(), "{k}");
        if side[k].is_finite() && is_moving {
            assert!((alone.force[k] - offset - of_seal[k]).abs() < 1e-12, "{k}");
            known += 1;
        }
    }
    assert!(known > 5_500, "{known} of 6000 samples in motion");
    assert_eq!(alone.loads, [None, None, None], "they are not taken out twice");
    let unloaded = recording.clone().without_loads(&Loads::default(), offset);
    assert_eq!(unloaded.force, recording.force);
}

fn bench() -> BenchConfig {
    let mut config = BenchConfig::default();
    config.loads =
        Loading { side_force_n: 4.0, tilt_rad: 1.0, pressure_pa: 2000.0, ..config.loads };
    config.rod.mass_kg = 0.1;
    config
}

fn record(config: &BenchConfig, protocol: Protocol) -> Recording {
    let seal = Element::new(ElementParams::plausible_10_5_mm().unwrap()).unwrap();
    run(config, protocol, &[seal], 4).unwrap().to_recording(protocol.name()).unwrap()
}

/// With all loads at once, the seal is found as without, and a held-out recording is predicted; the model alone knows what to
/// take out of it.
#[test]
fn loads_are_identified_beside_the_seal() {
    let config = bench();
    let recordings = [Protocol::Steady, Protocol::Dynamic].map(|p| record(&config, p)).to_vec();
    let held_out = record(&config, Protocol::Validation);
    let mass = MovingMass { mass: config.rod.mass_kg, gravity: 0.0 };
    let options = IdentifyOptions::default();
    let done =
        Workflow::run(recordings, vec![held_out.clone()], mass, options, &|_, _| {}).unwrap();
    let found = &done.identification;
    let weight = config.rod.mass_kg * config.rod.gravity_m_s2;
    let truths = [
        ("side_friction", config.loads.side_friction),
        ("tilted_weight_n", weight),
        ("pressure_gain_per_pa", config.loads.pressure_gain_per_pa),
        ("coulomb_force_n", 3.0),
        ("viscous_damping_n_s_m", 5.0),
        ("half_width_m", 8e-3),
        ("offset_n", config.force_sensor.tare_n),
    ];
    for (name, truth) in truths {
        let own = found.parameters.iter().find(|p| p.id.to_string() == name);
        let own = &own.unwrap_or_else(|| panic!("{name} is reported")).estimate;
        assert!(own.determined, "{name}");
        // Half as wide again: seven intervals of 95 %.
        let margin = 0.75 * (own.ci95[1] - own.ci95[0]);
        assert!((own.value - truth).abs() < margin, "{name}: {} for {truth}", own.value);
        assert!(margin < 0.1 * truth.abs().max(0.5 * weight), "{name}: {:?}", own.ci95);
    }
    let model = done.model_file();
    let of_model = Correction::of(&model, None, None).unwrap();
    let seal = of_model.taken_out_of(held_out.clone()).unwrap();
    let rms = |own: Recording| {
        Validation::of(vec![validate_one(&model.trocar, &own, of_model.offset_n)]).rms_n
    };
    let own = done.validation().expect("it was held out").rms_n;
    assert!((own - rms(seal)).abs() < 1e-9, "{own}");
    assert!(own < 0.1 && rms(held_out) > 4.0 * own, "{own}");
}

/// A column alone is no load: nothing acts here, and nothing is found.
#[test]
fn loads_that_do_not_act_are_not_found() {
    let mut config = bench();
    config.loads.side_friction = 0.0;
    config.loads.pressure_gain_per_pa = 0.0;
    config.rod.gravity_m_s2 = 0.0;
    let recordings = [Protocol::Steady, Protocol::Dynamic].map(|p| record(&config, p)).to_vec();
    assert!(recordings.iter().all(|r| r.loads.iter().all(Option::is_some)));
    let mass = MovingMass { mass: config.rod.mass_kg, gravity: 0.0 };
    let done = Workflow::run(recordings, Vec::new(), mass, IdentifyOptions::default(), &|_, _| {})
        .unwrap();
    let terms = &done.identification.fit.as_ref().unwrap().terms;
    for load in Load::RECORDED {
        let own = terms.iter().find(|t| t.term == Term::Load(load)).expect("it is tried");
        assert!(!own.kept, "{own:?}");
    }
    assert_eq!(done.identification.model.loads, Loads::default());
}
