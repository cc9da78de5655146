//! The comparison models against trajectories that other solvers made: `reference/` at the root of
//! the repository.

use std::collections::BTreeSet;
use std::path::PathBuf;

use serde_json::Value;
use trocar_model::{
    BoucWen, BoucWenParams, Dahl, DahlParams, Friction, Gms, GmsElement, Leuven, LeuvenParams,
    LuGre, LuGreParams, MaxwellSlip, SlidingFriction, SlipElement, SlipRate, StribeckCurve,
};

/// N: exact steps on both sides, rounding in forces of a few newtons.
const EXACT_TOLERANCE: f64 = 1e-10;

/// N: the reference integrates with a relative tolerance of 1e-12 and finds its switches to that.
const SWITCHING_TOLERANCE: f64 = 1e-8;

/// N: the step of the Leuven model for n other than 1 is of second order in the change of r =
/// F_h/s(v), at most 1/8.
const LEUVEN_TOLERANCE: f64 = 6e-3;

/// N: the same with every interval in 512 parts.
const LEUVEN_FINE_TOLERANCE: f64 = 5e-6;

/// N: the step of the Bouc–Wen model for n other than 1 is of second order in the change of f/F_c, at
/// most 1/16.
const BOUC_WEN_TOLERANCE: f64 = 2e-3;

/// N: the same with every interval in 512 parts.
const BOUC_WEN_FINE_TOLERANCE: f64 = 2e-6;

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../reference/vectors")
}

fn parameters() -> serde_json::Map<String, Value> {
    let text = std::fs::read_to_string(folder().join("parameters.json")).unwrap();
    match serde_json::from_str(&text).unwrap() {
        Value::Object(sets) => sets,
        other => panic!("parameters.json holds {other}"),
    }
}

/// State and force at the start of an interval, and the interval.
struct Row {
    velocity: f64,
    displacement: f64,
    duration: f64,
    force: f64,
}

fn rows(name: &str) -> Vec<Row> {
    let text = std::fs::read_to_string(folder().join(format!("{name}.csv"))).unwrap();
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let column = |wanted: &str| header.iter().position(|&found| found == wanted).unwrap();
    let columns = ["time_s", "position_m", "velocity_m_s", "force_n"].map(column);
    let samples: Vec<[f64; 4]> = lines
        .map(|line| {
            let words: Vec<&str> = line.split(',').collect();
            columns.map(|index| words[index].parse().unwrap())
        })
        .collect();
    let next = samples.iter().skip(1).map(Some).chain([None]);
    let row = |(&[time, position, velocity, force], next): (&[f64; 4], Option<&[f64; 4]>)| {
        let (displacement, duration) =
            next.map_or((0.0, 1.0), |next| (next[1] - position, next[0] - time));
        assert_eq!(velocity, displacement / duration, "{name} at {time} s");
        Row { velocity, displacement, duration, force }
    };
    samples.iter().zip(next).map(row).collect()
}

/// Largest difference of force over the rows of a set, N; each interval is driven in `parts` equal
/// steps.
fn largest_difference<M: Friction>(
    name: &str,
    model: &M,
    mut state: M::State,
    output: fn(&M, &M::State, f64) -> f64,
    parts: u32,
) -> f64 {
    let mut worst = 0.0_f64;
    let rows = rows(name);
    for (index, row) in rows.iter().enumerate() {
        let difference = (output(model, &state, row.velocity) - row.force).abs();
        assert!(difference.is_finite(), "{name} row {index}");
        worst = worst.max(difference);
        for _ in 0..parts {
            model.step(
                &mut state,
                row.displacement / f64::from(parts),
                row.duration / f64::from(parts),
            );
        }
    }
    println!("{name}: {worst:.1e} N over {} rows in {parts} parts", rows.len());
    worst
}

/// The sets of one model: all of them, as many as are known here.
fn sets(model: &str, count: usize) -> Vec<(String, Value)> {
    let chosen: Vec<_> =
        parameters().into_iter().filter(|(_, set)| set["model"] == model).collect();
    assert_eq!(chosen.len(), count, "{model}");
    chosen
}

fn number(object: &Value, key: &str) -> f64 {
    object[key].as_f64().unwrap_or_else(|| panic!("{key} in {object}"))
}

fn sliding(set: &Value) -> SlidingFriction {
    let curve = &set["sliding"];
    SlidingFriction {
        coulomb_force: number(curve, "coulomb_force_n"),
        static_force: number(curve, "static_force_n"),
        stribeck_velocity: number(curve, "stribeck_velocity_m_s"),
        stribeck_exponent: number(curve, "stribeck_exponent"),
        viscous_damping: number(curve, "viscous_damping_n_s_m"),
    }
}

fn elements<T>(set: &Value, element: impl Fn(&Value) -> T) -> Vec<T> {
    set["elements"].as_array().unwrap().iter().map(element).collect()
}

fn slip_element(element: &Value) -> SlipElement {
    SlipElement {
        stiffness: number(element, "stiffness_n_m"),
        limit_force: number(element, "limit_force_n"),
    }
}

#[test]
fn every_file_has_its_parameters() {
    let files: BTreeSet<String> = std::fs::read_dir(folder())
        .unwrap()
        .filter_map(|entry| {
            Some(entry.unwrap().file_name().to_str()?.strip_suffix(".csv")?.to_owned())
        })
        .collect();
    assert_eq!(files, parameters().keys().cloned().collect());
}

#[test]
fn maxwell_slip_agrees_with_opensees() {
    for (name, set) in sets("maxwell_slip", 5) {
        let bank = elements(&set, slip_element);
        let model = MaxwellSlip::new(&bank, number(&set, "viscous_damping_n_s_m")).unwrap();
        let worst = largest_difference(&name, &model, model.rest_state(), MaxwellSlip::output, 1);
        assert!(worst < EXACT_TOLERANCE, "{name}: {worst:e} N");
    }
}

#[test]
fn lugre_agrees_with_mujoco_and_with_an_integration() {
    for (name, set) in sets("lugre", 8) {
        let model = LuGre::new(LuGreParams {
            stiffness: number(&set, "stiffness_n_m"),
            micro_damping: number(&set, "micro_damping_n_s_m"),
            damping_velocity: set["damping_velocity_m_s"].as_f64().unwrap_or(f64::INFINITY),
            sliding: sliding(&set),
            curve: match set["curve"].as_str() {
                Some("exponential") => StribeckCurve::Exponential,
                Some("rational") => StribeckCurve::Rational,
                other => panic!("{name}: {other:?}"),
            },
        })
        .unwrap();
        let worst = largest_difference(&name, &model, model.rest_state(), LuGre::output, 1);
        assert!(worst < EXACT_TOLERANCE, "{name}: {worst:e} N");
    }
}

#[test]
fn dahl_agrees_with_mujoco_and_with_an_integration() {
    for (name, set) in sets("dahl", 6) {
        let model = Dahl::new(DahlParams {
            stiffness: number(&set, "stiffness_n_m"),
            coulomb_force: number(&set, "coulomb_force_n"),
            exponent: number(&set, "exponent"),
            viscous_damping: 0.0,
        })
        .unwrap();
        let worst = largest_difference(&name, &model, model.rest_state(), Dahl::output, 1);
        assert!(worst < EXACT_TOLERANCE, "{name}: {worst:e} N");
    }
}

fn bouc_wen(set: &Value) -> BoucWen {
    BoucWen::new(BoucWenParams {
        stiffness: number(set, "stiffness_n_m"),
        coulomb_force: number(set, "coulomb_force_n"),
        exponent: number(set, "exponent"),
        unloading_shape: number(set, "unloading_shape"),
        viscous_damping: 0.0,
    })
    .unwrap()
}

#[test]
fn bouc_wen_agrees_with_an_integration_of_wens_equation() {
    for (name, set) in sets("bouc_wen", 5) {
        let model = bouc_wen(&set);
        let worst = largest_difference(&name, &model, model.rest_state(), BoucWen::output, 1);
        let tolerance =
            if model.params().exponent == 1.0 { EXACT_TOLERANCE } else { BOUC_WEN_TOLERANCE };
        assert!(worst < tolerance, "{name}: {worst:e} N");
    }
}

#[test]
fn bouc_wen_converges_to_the_integration() {
    let curved = |(_, set): &(String, Value)| number(set, "exponent") != 1.0;
    for (name, set) in sets("bouc_wen", 5).into_iter().filter(curved) {
        let model = bouc_wen(&set);
        let worst =
            |parts| largest_difference(&name, &model, model.rest_state(), BoucWen::output, parts);
        let (coarse, fine) = (worst(64), worst(512));
        // Second order would be 1/64.
        assert!(
            fine < coarse / 50.0 && fine < BOUC_WEN_FINE_TOLERANCE,
            "{name}: {coarse:e} N, then {fine:e} N"
        );
    }
}

#[test]
fn gms_agrees_with_an_event_driven_integration() {
    for (name, set) in sets("gms", 6) {
        let bank = elements(&set, |element| GmsElement {
            stiffness: number(element, "stiffness_n_m"),
            share: number(element, "share"),
            attraction: number(element, "attraction_m_s"),
            damping: number(element, "damping_n_s_m"),
        });
        let slip_rate = match set["slip_rate"].as_str() {
            Some("free") => SlipRate::Free,
            Some("limited") => SlipRate::Limited,
            other => panic!("{name}: {other:?}"),
        };
        let model = Gms::new(&bank, sliding(&set), slip_rate).unwrap();
        let worst = largest_difference(&name, &model, model.rest_state(), Gms::output, 1);
        assert!(worst < SWITCHING_TOLERANCE, "{name}: {worst:e} N");
    }
}

fn leuven(set: &Value) -> Leuven {
    let params = LeuvenParams {
        sliding: sliding(set),
        exponent: number(set, "exponent"),
        micro_damping: number(set, "micro_damping_n_s_m"),
    };
    Leuven::new(&elements(set, slip_element), params).unwrap()
}

#[test]
fn leuven_agrees_with_an_event_driven_integration() {
    for (name, set) in sets("leuven", 6) {
        let model = leuven(&set);
        let worst = largest_difference(&name, &model, model.rest_state(), Leuven::output, 1);
        let tolerance =
            if model.params().exponent == 1.0 { SWITCHING_TOLERANCE } else { LEUVEN_TOLERANCE };
        assert!(worst < tolerance, "{name}: {worst:e} N");
    }
}

#[test]
fn leuven_of_exponent_2_converges_to_the_integration() {
    let quadratic = |(_, set): &(String, Value)| number(set, "exponent") == 2.0;
    for (name, set) in sets("leuven", 6).into_iter().filter(quadratic) {
        let model = leuven(&set);
        let worst =
            |parts| largest_difference(&name, &model, model.rest_state(), Leuven::output, parts);
        let (coarse, fine) = (worst(64), worst(512));
        // Second order would be 1/64.
        assert!(
            fine < coarse / 50.0 && fine < LEUVEN_FINE_TOLERANCE,
            "{name}: {coarse:e} N, then {fine:e} N"
        );
    }
}
