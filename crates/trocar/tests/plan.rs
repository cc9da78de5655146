//! `plan`: the error it predicts beside the error that identifications make, and motions within
//! their limits.

use rayon::prelude::*;
use trocar::bench::{BenchConfig, Course, run_motion};
use trocar::identify::{IdentifyOptions, identify};
use trocar::plan::{Goal, PlanConfig, PlanError, Prediction, plan};
use trocar::recording::Recording;
use trocar_model::{Element, ElementParams, ParameterId, Quantity};

fn seal() -> ElementParams {
    ElementParams::plausible_10_5_mm().expect("a seal")
}

/// The noise of the virtual bench, whose friction does not drift.
fn config(duration_s: f64) -> PlanConfig {
    let mut config = PlanConfig { duration_s, ..PlanConfig::default() };
    config.noise.drift = 3e-3;
    config
}

fn recorded(motion: &Course, seed: u64) -> Recording {
    let element = [Element::new(seal()).expect("a model")];
    let mut bench = BenchConfig::default();
    // Weight and inertia of the rod are subtracted before identification.
    bench.rod.mass_kg = 0.0;
    let run = run_motion(&bench, motion, &element, seed).expect("the rig runs");
    run.to_recording(format!("plan-{seed}")).expect("finite columns")
}

/// The estimates of one parameter over benches, and how often its interval holds the truth.
fn estimates(motion: &Course, benches: u64, ids: &[ParameterId]) -> Vec<Vec<(f64, [f64; 2])>> {
    let of = |seed: u64| {
        let options = IdentifyOptions {
            bootstrap: 0,
            seed,
            free_motion: false,
            ..IdentifyOptions::default()
        };
        let found = identify(&[recorded(motion, seed)], &options, &|_, _| {}).expect("it slides");
        let one = |id: &ParameterId| {
            let parameter = found.parameters.iter().find(|p| p.id == *id).expect("it is estimated");
            (parameter.estimate.value, parameter.estimate.ci95)
        };
        ids.iter().map(one).collect::<Vec<_>>()
    };
    (1..=benches).into_par_iter().map(of).collect()
}

fn main_ones() -> Vec<ParameterId> {
    let [insertion, withdrawal] = trocar_model::Direction::BOTH;
    vec![
        Quantity::CoulombForce.id(),
        Quantity::ViscousDamping.id(),
        Quantity::HalfWidth.id(),
        Quantity::Join.of(insertion),
        Quantity::Join.of(withdrawal),
        Quantity::JoinForce.of(insertion),
        Quantity::JoinForce.of(withdrawal),
    ]
}

fn of(expected: &[Prediction], id: ParameterId) -> &Prediction {
    expected.iter().find(|p| p.id == id).expect("it is expected")
}

/// 200 benches with `./test --statistics`; the standard deviation of n values is known to 1/√(2n).
#[test]
fn the_predicted_error_is_the_one_that_identifications_make() {
    let is_long = std::env::var_os("TROCAR_STATISTICS").is_some();
    let (benches, tolerance, least) = if is_long { (200, 0.50, 0.90) } else { (16, 0.60, 0.75) };
    let planned = plan(&config(40.0), &Goal::All, &[seal()], &[], &|_, _| {}).expect("a plan");
    let ids = main_ones();
    let all = estimates(&planned.course, benches, &ids);
    let mut outside = Vec::new();
    for (k, id) in ids.iter().enumerate() {
        let expected = of(&planned.expected, *id);
        let n = all.len() as f64;
        let mean = all.iter().map(|found| found[k].0).sum::<f64>() / n;
        let variance = all.iter().map(|found| (found[k].0 - mean).powi(2)).sum::<f64>() / (n - 1.0);
        let ratio = variance.sqrt() / expected.standard_deviation;
        let holds = |ci: [f64; 2]| ci[0] <= expected.value && expected.value <= ci[1];
        let covered = all.iter().filter(|found| holds(found[k].1)).count() as f64 / n;
        println!(
            "{id}: predicted {:.3e}, realised over predicted {ratio:.2}, coverage {covered:.3}",
            expected.standard_deviation
        );
        if (ratio - 1.0).abs() > tolerance || covered < least {
            outside.push((id.to_string(), ratio, covered));
        }
    }
    assert!(outside.is_empty(), "{outside:?}");
}

/// At equal time: half the error of the paper's protocol.
#[test]
fn viscous_damping_is_known_better_than_after_the_papers_protocol_in_less_time() {
    let goal: Goal = "viscous_damping_n_s_m".parse().expect("a goal");
    let config = PlanConfig { duration_s: 100.0, ..PlanConfig::default() };
    let planned = plan(&config, &goal, &[], &[], &|_, _| {}).expect("a plan");
    let (duration, paper) = planned.paper.expect("the rig can make it");
    let id = Quantity::ViscousDamping.id();
    let [ours, theirs] =
        [&planned.expected, &paper].map(|e| of(e, id).relative_half_width.expect("a value"));
    println!(
        "viscous damping ±{:.2} % after 100 s, ±{:.2} % after the paper's {duration:.0} s",
        1e2 * ours,
        1e2 * theirs
    );
    assert!(ours < 0.5 * theirs, "{ours} {theirs}");
}

#[test]
fn a_motion_keeps_to_the_limits_of_its_rig_and_is_smooth() {
    for (goal, seed) in [("all", 1), ("compensation", 2), ("half_width_m", 3)] {
        let config = PlanConfig { duration_s: 40.0, seed, draws: 3, ..PlanConfig::default() };
        let planned =
            plan(&config, &goal.parse().expect("a goal"), &[], &[], &|_, _| {}).expect("a plan");
        let Course { time, position } = &planned.course;
        let rig = config.rig;
        assert!(time[time.len() - 1] <= config.duration_s, "{goal} takes {}", time[time.len() - 1]);
        assert!(position.iter().all(|x| (rig.lowest_m..=rig.highest_m).contains(x)));
        let differences = |values: &[f64]| -> Vec<f64> {
            values.windows(2).map(|pair| (pair[1] - pair[0]) * rig.sample_rate_hz).collect()
        };
        let largest = |values: &[f64]| values.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
        let velocity = differences(position);
        let acceleration = differences(&velocity);
        let jerk = differences(&acceleration);
        assert!(largest(&velocity) <= rig.fastest_m_s * (1.0 + 1e-9), "{}", largest(&velocity));
        assert!(
            largest(&acceleration) <= rig.acceleration_m_s2 * 1.001,
            "{}",
            largest(&acceleration)
        );
        // Rounding of the positions is 1e-17 m.
        assert!(
            largest(&jerk) < 4.0 * rig.acceleration_m_s2.powi(2) / rig.slowest_m_s,
            "{}",
            largest(&jerk)
        );
        let again =
            plan(&config, &goal.parse().expect("a goal"), &[], &[], &|_, _| {}).expect("a plan");
        assert_eq!(again, planned, "same seed, same motion");
    }
}

#[test]
fn what_is_recorded_already_counts() {
    let goal: Goal = "viscous_damping_n_s_m:1%".parse().expect("a goal");
    let first = plan(&config(30.0), &goal, &[seal()], &[], &|_, _| {}).expect("a plan");
    let recording = recorded(&first.course, 1);
    let next = plan(&config(30.0), &goal, &[seal()], &[recording], &|_, _| {}).expect("a plan");
    let id = Quantity::ViscousDamping.id();
    let [alone, both] = [&first, &next].map(|p| of(&p.expected, id).half_width);
    assert!(both < 0.85 * alone, "{both} after both, {alone} after the first alone");
    let needed = [&first, &next].map(|p| p.needed_s.expect("a precision is asked for"));
    assert!(needed[1] < needed[0], "{needed:?}");
}

#[test]
fn what_cannot_be_planned_is_refused_with_the_way_out() {
    let short = plan(&config(2.0), &Goal::All, &[seal()], &[], &|_, _| {}).expect_err("too short");
    assert!(matches!(short, PlanError::TooShort { least, .. } if least > 2.0), "{short}");
    let mut narrow = config(60.0);
    narrow.rig.highest_m = narrow.rig.lowest_m + 0.02;
    let narrow = plan(&narrow, &Goal::All, &[seal()], &[], &|_, _| {}).expect_err("too narrow");
    assert!(matches!(narrow, PlanError::TooNarrow { .. }), "{narrow}");
    let absent = "stribeck_velocity_m_s".parse().expect("a parameter");
    let absent =
        plan(&config(60.0), &absent, &[seal()], &[], &|_, _| {}).expect_err("the seal has none");
    assert!(matches!(absent, PlanError::NotThere(..)), "{absent}");
    assert!("speed".parse::<Goal>().is_err());
    assert!("viscous_damping_n_s_m:-5%".parse::<Goal>().is_err());
    for wrong in
        ["duration_s = nan", "[rig]\nfastest_m_s = 0.001", "[noise]\nscatter = 0", "speed = 1"]
    {
        assert!(PlanConfig::from_toml(wrong).is_err(), "{wrong}");
    }
}

#[test]
fn the_documented_rig_is_the_default() {
    let read = PlanConfig::from_toml(trocar::plan::config::EXAMPLE_TOML).expect("it is valid");
    assert_eq!(read, PlanConfig::default());
}
