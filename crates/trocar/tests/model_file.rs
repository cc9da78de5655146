//! `model.json`: what is written is read back to the bit, conforms to the schema, and what is broken is refused.

use serde_json::{Value, json};
use trocar::bench::random_plausible_seal;
use trocar::model_file::{Interval, ModelFile, ModelFileError, Origin, OriginKind, RecordingInfo, SensorInfo};
use trocar_model::{Element, ElementParams, SealDamping};

fn schema() -> jsonschema::Validator {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../schema/model.schema.json");
    let schema: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    assert_eq!(schema["$schema"], "https://json-schema.org/draft/2020-12/schema");
    assert!(jsonschema::meta::is_valid(&schema));
    jsonschema::validator_for(&schema).unwrap()
}

fn value(text: &str) -> Value {
    serde_json::from_str(text).unwrap()
}

/// A model with everything a file can hold.
fn complete() -> ModelFile {
    let mut damped = random_plausible_seal(3);
    damped.damping = SealDamping { coefficients: [0.4, -0.1, 1.5] };
    damped.insertion.viscous_damping = 0.1 + 0.2;
    damped.withdrawal.stribeck_exponent = 1.5;
    let elements = [ElementParams::plausible_10_5_mm().unwrap(), damped];
    let mut origin = Origin::new(OriginKind::Identified);
    origin.seed = Some(u64::MAX);
    origin.note = Some("a \"quoted\" note, µ and \n".to_owned());
    origin.recordings = vec![RecordingInfo { name: "steady.csv".to_owned(), sha256: "0123456789abcdef".repeat(4) }];
    let mut model = ModelFile::new(elements.map(|e| Element::new(e).unwrap()).to_vec(), origin);
    model.sensor = Some(SensorInfo { offset_n: -0.34, moving_mass_kg: 0.04 });
    for (name, high) in [("coulomb_force_n", Some(3.1)), ("stribeck_velocity_m_s", None)] {
        let interval = Interval { value: 3.0, ci95: [Some(2.9), high] };
        model.intervals.insert(name.to_owned(), interval);
    }
    model
}

#[test]
fn written_models_conform_and_come_back_to_the_bit() {
    let schema = schema();
    let mut models = vec![complete(), ModelFile::plausible_10_5_mm().unwrap()];
    for seed in 0..200 {
        let element = Element::new(random_plausible_seal(seed)).unwrap();
        models.push(ModelFile::new(vec![element], Origin::new(OriginKind::Plausible)));
    }
    for model in models {
        let text = model.to_json();
        let read = ModelFile::from_json(&text).unwrap();
        assert_eq!(read, model);
        assert_eq!(read.to_json(), text);
        assert!(schema.is_valid(&value(&text)));
    }
}

#[test]
fn plausible_model_says_so() {
    let text = ModelFile::plausible_10_5_mm().unwrap().to_json();
    assert_eq!(value(&text)["origin"]["kind"], "plausible");
}

#[test]
fn every_number_says_its_unit() {
    fn walk(key: &str, value: &Value) {
        let units = ["_n", "_m", "_n_m", "_m_s", "_n_s_m", "_n_s2_m2", "_n_s3_m3", "_kg"];
        let pure = ["version", "seed", "stribeck_exponent", "value", "ci95"];
        match value {
            Value::Object(inner) => inner.iter().for_each(|(key, value)| walk(key, value)),
            Value::Array(inner) => inner.iter().for_each(|value| walk(key, value)),
            Value::Number(_) => {
                assert!(pure.contains(&key) || units.iter().any(|unit| key.ends_with(unit)), "{key} has no unit")
            }
            _ => {}
        }
    }
    walk("", &value(&complete().to_json()));
}

/// Changes one place of a good file, or removes it.
fn broken(pointer: &str, replacement: Option<Value>) -> Value {
    let mut document = value(&complete().to_json());
    let (parent, key) = pointer.rsplit_once('/').unwrap();
    let parent = document.pointer_mut(parent).unwrap();
    match (parent, replacement) {
        (Value::Object(map), Some(value)) => {
            map.insert(key.to_owned(), value);
        }
        (Value::Object(map), None) => assert!(map.remove(key).is_some(), "{pointer}"),
        (Value::Array(list), Some(value)) => list[key.parse::<usize>().unwrap()] = value,
        (Value::Array(list), None) => {
            list.remove(key.parse().unwrap());
        }
        _ => panic!("{pointer} has no parent"),
    }
    document
}

#[test]
fn files_of_another_form_are_refused_by_reader_and_schema() {
    let schema = schema();
    let cases = [
        ("/format", Some(json!("other")), "must be \"trocar-model\", got \"other\""),
        ("/format", None, "must be \"trocar-model\", got nothing"),
        ("/version", Some(json!(2)), "written by a newer trocar: model version 2, this one reads 1"),
        ("/version", Some(json!(0)), "\"version\" must be 1, got 0"),
        ("/version", Some(json!("1")), "\"version\" must be 1, got \"1\""),
        ("/version", None, "\"version\" must be 1, got nothing"),
        ("/origin", None, "missing field `origin`"),
        ("/origin/kind", Some(json!("measured")), "unknown variant `measured`"),
        ("/origin/seed", Some(json!(-1)), "invalid value: integer `-1`"),
        ("/origin/recordings/0/sha256", Some(json!("abc")), "origin.recordings[0].sha256: must be 64"),
        ("/elements", Some(json!([])), "at least one element"),
        ("/elements", Some(json!({})), "expected a sequence"),
        ("/elements/0/stiffness", Some(json!(3)), "unknown field `stiffness`, expected one of"),
        ("/elements/1/insertion/coulomb_force_n", None, "missing field `coulomb_force_n`"),
        ("/elements/1/insertion/coulomb_force_n", Some(json!("3 N")), "invalid type: string \"3 N\""),
        (
            "/elements/1/insertion/coulomb_force_n",
            Some(json!(-0.3)),
            "elements[1]: coulomb_force must be positive, got -0.3 N",
        ),
        ("/elements/0/withdrawal/viscous_damping_n_s_m", Some(json!(null)), "invalid type: null"),
        ("/elements/0/withdrawal/viscous_damping_n_s_m", Some(json!(-1)), "elements[0]: viscous_damping"),
        ("/elements/0/withdrawal/viscous_damping", Some(json!(1)), "unknown field `viscous_damping`"),
        ("/elements/0/seal_damping/constant_n_s_m", Some(json!(-1.0)), "elements[0]: seal damping"),
        ("/elements/0/deformation/rising/pieces/0", None, "invalid length 1"),
        (
            "/elements/0/deformation/falling/pieces/1/legendre_n",
            Some(json!([])),
            "elements[0].deformation.falling.pieces[1]: a piece needs 1 to 8 Legendre coefficients, got 0",
        ),
        ("/elements/0/deformation/half_width_m", Some(json!(-0.008)), "half_width_m is -0.008"),
        ("/sensor/moving_mass_kg", Some(json!(-0.1)), "sensor.moving_mass_kg: must not be negative"),
        ("/sensor/moving_mass_g", Some(json!(40)), "unknown field `moving_mass_g`"),
        ("/intervals/coulomb_force_n/ci95", Some(json!([1.0])), "invalid length 1"),
        ("/intervals/coulomb_force_n/value", None, "missing field `value`"),
    ];
    for (pointer, replacement, message) in cases {
        let document = broken(pointer, replacement);
        let error = ModelFile::from_json(&document.to_string()).unwrap_err().to_string();
        assert!(error.contains(message), "{pointer}: {error}");
        assert!(!schema.is_valid(&document), "{pointer}: the schema takes it");
    }
}

#[test]
fn impossible_seals_are_refused_by_the_reader() {
    let cases = [
        ("/elements/0/deformation/rising/join_m", json!(0.001), "rising: join_m is 0.001, but the pieces meet"),
        ("/elements/0/deformation/half_width_m", json!(8.0), "half_width_m is 8, but the pieces end at 0.008"),
        (
            "/elements/0/deformation/rising/pieces/0/legendre_n/0",
            json!(1.5),
            "deformation.rising: a branch must be continuous",
        ),
        (
            "/elements/0/deformation/rising/pieces/1/to_m",
            json!(-0.02),
            "rising.pieces[1]: a piece must end right of its start",
        ),
        ("/elements/0/deformation/yield_stiffness_n_m", json!(1.0), "yield_stiffness must be at least"),
        ("/elements/0/insertion/static_force_n", json!(2.0), "static_force must be at least"),
        ("/elements/0/insertion/static_force_n", json!(3.5), "both branches must pass 3.5 N"),
        ("/intervals/coulomb_force_n/value", json!(9.0), "intervals.coulomb_force_n: value 9 lies outside"),
    ];
    for (pointer, replacement, message) in cases {
        let document = broken(pointer, Some(replacement));
        let error = ModelFile::from_json(&document.to_string()).unwrap_err().to_string();
        assert!(error.contains(message), "{pointer}: {error}");
    }
}

#[test]
fn errors_name_line_and_column() {
    let good = complete().to_json();
    let cut = &good[..good.len() / 2];
    let lines = cut.lines().count();
    let error = ModelFile::from_json(cut).unwrap_err();
    assert!(matches!(error, ModelFileError::NotJson { line, .. } if line.abs_diff(lines) <= 1), "{error}");
    let typo = good.replacen("coulomb_force_n\":", "coulomb_force\":", 1);
    let at = 1 + typo.lines().position(|l| l.contains("coulomb_force\":")).unwrap();
    let error = ModelFile::from_json(&typo).unwrap_err();
    assert!(matches!(error, ModelFileError::WrongKey { line, .. } if line == at), "{error}");
    for text in ["", "time_s,position_m\n0,0", "[1,2]", "{\"format\":1e999}", "null"] {
        assert!(ModelFile::from_json(text).is_err(), "{text:?}");
    }
    let twice = good.replacen("\"version\": 1,", "\"version\": 1, \"version\": 1,", 1);
    assert!(ModelFile::from_json(&twice).is_err());
}

#[test]
fn a_newer_file_is_recognised_whatever_else_it_holds() {
    let text = "{\"format\": \"trocar-model\", \"version\": 7, \"seals\": {}}";
    let error = ModelFile::from_json(text).unwrap_err();
    assert!(matches!(error, ModelFileError::Newer { found: 7 }), "{error}");
    assert!(error.to_string().contains("hint: update"));
}

#[test]
fn a_missing_file_is_named() {
    let error = ModelFile::read("no/such/model.json".as_ref()).unwrap_err().to_string();
    assert!(error.starts_with("no/such/model.json: "), "{error}");
}

#[test]
fn unbounded_intervals_are_null() {
    let mut model = complete();
    let interval = Interval { value: 1.0, ci95: [None, None] };
    model.intervals.insert("seal_damping_n_s_m".to_owned(), interval);
    let text = model.to_json();
    assert_eq!(value(&text)["intervals"]["seal_damping_n_s_m"]["ci95"], json!([null, null]));
    assert_eq!(ModelFile::from_json(&text).unwrap(), model);
}
