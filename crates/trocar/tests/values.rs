//! Numbers of models for other programs: what they are, and what is said to be lost. The programs
//! themselves read them in `integrations/values`.

use serde_json::Value;
use trocar::bench::{BenchConfig, Protocol, run};
use trocar::export::values::{TARGETS, text};
use trocar::model_file::{ModelFile, Origin, OriginKind};
use trocar::recording::Recording;
use trocar::validate::validate;
use trocar_model::{
    Classical, Element, ElementParams, LuGre, LuGreParams, Seal, SlidingFriction, StaticFriction,
    StribeckCurve, Trocar,
};

fn file(seal: impl Into<Seal>) -> ModelFile {
    let mut model = ModelFile::plausible_10_5_mm().unwrap();
    model.trocar = Trocar::new(seal, None);
    model.origin = Origin::new(OriginKind::HandMade);
    model
}

/// Strokes of the bench, without its moving mass.
fn strokes() -> Recording {
    let config = BenchConfig::default();
    let seal = Element::new(ElementParams::plausible_10_5_mm().unwrap()).unwrap();
    let made = run(&config, Protocol::Validation, &[seal], 1).unwrap();
    made.to_recording("strokes").unwrap().without_moving_mass(config.rod.mass_kg, 0.0).unwrap()
}

fn places(model: &ModelFile, recordings: Vec<Recording>) -> (Value, Vec<Value>) {
    let all: Value = serde_json::from_str(&text(model, "json", recordings).unwrap()).unwrap();
    let places = all["places"].as_array().unwrap().clone();
    (all, places)
}

#[test]
fn the_error_of_the_numbers_is_that_of_the_law_they_make() {
    let params = ElementParams::plausible_10_5_mm().unwrap();
    let model = ModelFile::plausible_10_5_mm().unwrap();
    let (all, places) = places(&model, vec![strokes()]);
    let of = |seal: Seal| validate(&Trocar::of_seal(seal), &[strokes()], 0.0).rms_n;
    let SlidingFriction { coulomb_force, viscous_damping, .. } = params.insertion;
    let coulomb = SlidingFriction::coulomb(coulomb_force, viscous_damping);
    let bristles = LuGre::new(LuGreParams {
        stiffness: coulomb_force / params.deformation.half_width(),
        micro_damping: 0.0,
        damping_velocity: f64::INFINITY,
        sliding: coulomb,
        curve: StribeckCurve::Exponential,
    });
    let expected = [
        Classical::Static(StaticFriction::new(coulomb).unwrap()),
        Classical::LuGre(bristles.unwrap()),
    ];
    for (place, law) in places.iter().zip(expected) {
        assert_eq!(place["rms_n"].as_f64().unwrap(), of(law.into()), "{place}");
    }
    let own = all["model_rms_n"].as_f64().unwrap();
    assert_eq!(own, of(*model.trocar.seal()));
    // A law without deformation is wrong over the deformation after each reversal.
    assert!(places[0]["rms_n"].as_f64().unwrap() > 4.0 * own);
    let pasted = text(&model, "mujoco", vec![strokes()]).unwrap();
    assert!(
        pasted.contains("Lost: the deformation over ±8 mm with its snap-through; "),
        "{pasted}"
    );
    assert!(pasted.contains(" N rms on strokes, against "), "{pasted}");
    let unknown = text(&model, "mujoco", Vec::new()).unwrap();
    assert!(unknown.contains("unknown without a recording to validate on"), "{unknown}");
}

#[test]
fn both_directions_are_one_number_and_that_is_said() {
    let mut params = ElementParams::plausible_10_5_mm().unwrap();
    let rise = 1.0 + 2.0e-7; // The branches still end at the force of their direction.
    params.insertion = SlidingFriction::coulomb(rise * params.insertion.coulomb_force, 7.0);
    params.withdrawal.viscous_damping = 3.0;
    let (_, places) = places(&file(Element::new(params).unwrap()), Vec::new());
    let named = |place: &Value, name: &str| {
        let found = place["values"].as_array().unwrap().iter().find(|v| v["name"] == name).cloned();
        found.unwrap()["value"].as_f64().unwrap()
    };
    assert_eq!(named(&places[0], "damping"), 5.0, "the mean of 7 and 3");
    let between = named(&places[0], "frictionloss");
    assert!(params.withdrawal.coulomb_force < between && between < params.insertion.coulomb_force);
    for place in places {
        let lost = place["lost"].to_string();
        assert!(lost.contains("the direction (F_c is "), "{lost}");
    }
}

#[test]
fn a_law_that_the_program_has_loses_nothing() {
    let sliding = SlidingFriction { static_force: 3.6, ..SlidingFriction::coulomb(3.0, 5.0) };
    let stribeck = file(Classical::Static(StaticFriction::new(sliding).unwrap()));
    let (all, places) = places(&stribeck, vec![strokes()]);
    for place in &places {
        let keeps_all = ["isaac", "simulink"].contains(&place["program"].as_str().unwrap());
        assert_eq!(place["lost"].as_array().unwrap().is_empty(), keeps_all, "{place}");
        assert_eq!(place["rms_n"] == all["model_rms_n"], keeps_all, "{place}");
    }
    // Nothing deflects before it slides: there is no stiffness to give to bristles.
    assert_eq!(places.len(), TARGETS.len() - 1);
    let text = text(&stribeck, "isaac", Vec::new()).unwrap();
    assert!(text.contains("# Nothing is lost.\n"), "{text}");
    assert!(text.contains("friction=3.6, dynamic_friction=3, viscous_friction=5,"), "{text}");
}

#[test]
fn another_program_is_refused_with_those_there_are() {
    let error = text(&ModelFile::plausible_10_5_mm().unwrap(), "bullet", Vec::new()).unwrap_err();
    let expected =
        "no program \"bullet\": expected one of mujoco, isaac, urdf, sdf, ur, simulink, json";
    assert_eq!(error.to_string(), expected);
}
