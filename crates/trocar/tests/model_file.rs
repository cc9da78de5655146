//! `model.json`: a written file is read back exactly and conforms to the schema, and invalid files
//! are rejected.

use serde_json::{Value, json};
use trocar::bench::random_plausible_seal;
use trocar::model_file::{
    ErrorSource, ForceError, Interval, ModelFile, ModelFileError, Origin, OriginKind, ReadWith,
    RecordingInfo, SensorInfo,
};
use trocar_model::Classical;
use trocar_model::{
    BoucWen, BoucWenParams, Dahl, DahlParams, Element, ElementParams, Gms, GmsElement, Leuven,
    LeuvenParams, LuGre, LuGreParams, MAX_ELEMENTS, MaxwellSlip, PositionProfile, Relaxation,
    RelaxationArm, SealDamping, SlidingFriction, SlipElement, SlipRate, Stages, StaticFriction,
    StribeckCurve, Trocar,
};

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

fn stages<const N: usize>(elements: [ElementParams; N]) -> Stages {
    Stages::new(&elements.map(|params| Element::new(params).unwrap())).unwrap()
}

/// A model with everything a file can contain.
fn complete() -> ModelFile {
    let mut damped = random_plausible_seal(3);
    damped.damping = SealDamping { coefficients: [0.4, -0.1, 1.5] };
    damped.insertion.viscous_damping = 0.1 + 0.2;
    damped.withdrawal.stribeck_exponent = 1.5;
    let elements = [ElementParams::plausible_10_5_mm().unwrap(), damped];
    let mut origin = Origin::new(OriginKind::Identified);
    origin.seed = Some(u64::MAX);
    origin.note = Some("a \"quoted\" note, µ and \n".to_owned());
    origin.recordings = vec![RecordingInfo {
        name: "steady.csv".to_owned(),
        sha256: "0123456789abcdef".repeat(4),
        read_with: Some(ReadWith {
            columns: Some("time_s=t".to_owned()),
            skip_rows: 3,
            ..ReadWith::default()
        }),
    }];
    let mut model = ModelFile::new(stages(elements), origin);
    model.sensor =
        Some(SensorInfo { offset_n: -0.34, moving_mass_kg: 0.04, ..SensorInfo::default() });
    for (name, high) in [("coulomb_force_n", Some(3.1)), ("stribeck_velocity_m_s", None)] {
        let interval = Interval { value: 3.0, ci95: [Some(2.9), high] };
        model.intervals.insert(name.to_owned(), interval);
    }
    model
}

/// A model whose elements creep and relax.
fn slow() -> ModelFile {
    let arm = |stiffness, time| RelaxationArm { stiffness, time };
    let plausible = ElementParams::plausible_10_5_mm().unwrap();
    let two = Relaxation { arms: [arm(1e3 / 7.0, 0.3), arm(50.0, 10.0 / 3.0)] };
    let both = ElementParams {
        creep_velocity: 1e-3 / 7.0,
        friction_lag: 1.0 / 70.0,
        relaxation: two,
        ..plausible
    };
    let one = ElementParams { relaxation: Relaxation::single(120.0, 0.2), ..plausible };
    ModelFile { trocar: Trocar::new(stages([both, one, plausible]), None), ..complete() }
}

/// A model with position-dependent force, from a bench with a position delay.
fn along() -> ModelFile {
    let mut file = complete();
    let profile =
        PositionProfile::new(-0.01, 0.1, vec![0.1, -0.1 / 3.0, 0.1], vec![0.8, 1.2, 0.8]).unwrap();
    file.trocar = Trocar::new(*file.trocar.seal(), Some(profile));
    file.sensor = Some(SensorInfo {
        offset_n: -0.34,
        moving_mass_kg: 0.04,
        position_delay_s: 0.05,
        tilted_weight_n: -0.4,
        ..SensorInfo::default()
    });
    file
}

#[test]
fn profiles_that_make_no_seal_are_refused() {
    let cases = [
        (
            "/position_profile/gain/1",
            json!(-1.0),
            "position_profile: gain 1 is -1, expected a finite number above 0",
        ),
        (
            "/position_profile/gain/1",
            json!(1.6),
            "position_profile: the mean gain over the range is 1.2",
        ),
        ("/position_profile/gain", json!([1.0, 1.0]), "3 values of the offset and 2 of the gain"),
        ("/position_profile/to_m", json!(-1.0), "no interval"),
        ("/position_profile/knots", json!(3), "unknown field `knots`"),
        (
            "/sensor/position_delay_s",
            json!(-0.1),
            "sensor.position_delay_s: must not be negative, got -0.1 s",
        ),
    ];
    for (pointer, replacement, expected) in cases {
        let document = broken(&along(), pointer, Some(replacement));
        let error = ModelFile::from_json(&document.to_string()).unwrap_err().to_string();
        assert!(error.contains(expected), "{pointer}: {error}");
    }
    let mut classical =
        ModelFile::new(classical_models().pop().unwrap(), Origin::new(OriginKind::HandMade));
    classical.trocar = along().trocar.with_seal(*classical.trocar.seal());
    assert!(!schema().is_valid(&value(&classical.to_json())));
    let error = ModelFile::from_json(&classical.to_json()).unwrap_err().to_string();
    assert!(error.starts_with("position_profile: is for elements"), "{error}");
}

/// A model that states the error of its force.
fn with_error() -> ModelFile {
    let mut file = along();
    let source = ErrorSource::Validation;
    file.force_error = Some(ForceError {
        source,
        deforming_n: Some(0.1 / 3.0),
        partial_n: None,
        sliding_n: Some(0.02),
        held_n: Some(0.0),
    });
    file
}

#[test]
fn errors_that_are_none_are_refused() {
    let cases = [
        ("/force_error/held_n", json!(-0.1), "force_error: must not be negative, got -0.1 N"),
        ("/force_error/source", json!("guess"), "unknown variant `guess`"),
    ];
    for (pointer, replacement, expected) in cases {
        let document = broken(&with_error(), pointer, Some(replacement));
        let error = ModelFile::from_json(&document.to_string()).unwrap_err().to_string();
        assert!(error.contains(expected), "{pointer}: {error}");
    }
    assert!(schema().is_valid(&value(&with_error().to_json())));
    assert_eq!(ModelFile::from_json(&with_error().to_json()).unwrap(), with_error());
}

/// Numbers without a short decimal representation.
fn stribeck() -> SlidingFriction {
    SlidingFriction {
        coulomb_force: 2.0 + 1.0 / 3.0,
        static_force: 0.1 + 2.7,
        stribeck_velocity: 0.01_f64.sqrt() / 7.0,
        stribeck_exponent: 2.0 / 3.0,
        viscous_damping: 5.0 / 9.0,
    }
}

/// Every classical model in all its variants, the banks with 1 and with the largest number of
/// elements.
fn classical_models() -> Vec<Classical> {
    let sliding = stribeck();
    let mut models = vec![
        Classical::Static(StaticFriction::new(SlidingFriction::coulomb(3.0, 0.0)).unwrap()),
        Classical::Static(StaticFriction::new(sliding).unwrap()),
    ];
    let dahl = DahlParams {
        stiffness: 1e4 / 3.0,
        coulomb_force: 2.9,
        exponent: 1.1,
        viscous_damping: 0.0,
    };
    models.push(Classical::Dahl(Dahl::new(dahl).unwrap()));
    let bouc_wen = BoucWenParams {
        stiffness: 1e4 / 3.0,
        coulomb_force: 2.9,
        exponent: 1.1,
        unloading_shape: 0.7,
        viscous_damping: 0.0,
    };
    models.push(Classical::BoucWen(BoucWen::new(bouc_wen).unwrap()));
    for (curve, damping_velocity) in
        [(StribeckCurve::Exponential, f64::INFINITY), (StribeckCurve::Rational, 0.07)]
    {
        let params = LuGreParams {
            stiffness: 777.7,
            micro_damping: 1.0 / 3.0,
            damping_velocity,
            sliding,
            curve,
        };
        models.push(Classical::LuGre(LuGre::new(params).unwrap()));
    }
    for n in [1, MAX_ELEMENTS] {
        let part = 1.0 / n as f64;
        let bank: Vec<SlipElement> = (1..=n)
            .map(|i| SlipElement { stiffness: 1e4 / (i as f64), limit_force: 3.0 * part })
            .collect();
        let params = LeuvenParams { sliding, exponent: 1.0 / 0.9, micro_damping: 0.3 };
        models.push(Classical::Leuven(Leuven::new(&bank, params).unwrap()));
        models.push(Classical::MaxwellSlip(MaxwellSlip::new(&bank, 0.7).unwrap()));
        for slip_rate in [SlipRate::Free, SlipRate::Limited] {
            let element = |i: usize| GmsElement {
                stiffness: 1e4 / i as f64,
                share: part,
                attraction: 0.1 / 3.0,
                damping: 0.2,
            };
            let elements: Vec<GmsElement> = (1..=n).map(element).collect();
            models.push(Classical::Gms(Gms::new(&elements, sliding, slip_rate).unwrap()));
        }
    }
    models
}

/// Complete files of all classical models.
fn classical_files() -> Vec<ModelFile> {
    let file = |model| ModelFile { trocar: Trocar::new(model, None), ..complete() };
    classical_models().into_iter().map(file).collect()
}

#[test]
fn every_kind_is_among_the_classical_models_tried() {
    let models = classical_models();
    for kind in Classical::KINDS {
        assert!(models.iter().any(|model| model.kind() == *kind), "{kind}");
    }
    assert!(models.iter().all(|model| Classical::KINDS.contains(&model.kind())));
}

#[test]
fn a_model_of_five_elements_is_refused() {
    let mut document = value(&complete().to_json());
    let elements = document["elements"].as_array_mut().unwrap();
    elements.resize(5, elements[0].clone());
    assert!(!schema().is_valid(&document));
    let error = ModelFile::from_json(&document.to_string()).unwrap_err().to_string();
    assert!(error.starts_with("elements: a model has 1 to 4 elements, got 5"), "{error}");
}

#[test]
fn elements_of_a_classical_model_are_refused_with_its_kind() {
    let file = ModelFile::new(classical_models().pop().unwrap(), Origin::new(OriginKind::HandMade));
    let error = file.stages().unwrap_err().in_file("gms.json".as_ref()).to_string();
    assert!(error.starts_with("gms.json: holds a gms model, expected EMS elements"), "{error}");
    assert_eq!(complete().stages().unwrap().elements().len(), 2);
}

#[test]
fn written_models_conform_and_come_back_to_the_bit() {
    let schema = schema();
    let mut models = vec![complete(), slow(), along(), ModelFile::plausible_10_5_mm().unwrap()];
    models.extend(classical_files());
    for seed in 0..200 {
        let element = Element::new(random_plausible_seal(seed)).unwrap();
        models.push(ModelFile::new(element, Origin::new(OriginKind::Plausible)));
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
fn slow_parts_that_make_no_seal_are_refused() {
    let good = slow();
    let arm = json!({ "stiffness_n_m": 1.0, "time_s": 1.0 });
    let cases = [
        (
            "/elements/0/relaxation",
            json!([arm, arm, arm]),
            "elements[0].relaxation: a seal has at most 2 relaxing arms, got 3",
        ),
        ("/elements/0/relaxation/1/time_s", json!(0), "elements[0]: relaxation_time"),
        ("/elements/0/creep_velocity_m_s", json!(-1e-4), "elements[0]: creep_velocity"),
    ];
    for (pointer, replacement, expected) in cases {
        let error = ModelFile::from_json(&broken(&good, pointer, Some(replacement)).to_string())
            .unwrap_err()
            .to_string();
        assert!(error.starts_with(expected), "{error}");
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
        let units =
            ["_n", "_m", "_s", "_n_m", "_m_s", "_n_s_m", "_n_s2_m2", "_n_s3_m3", "_kg", "_hz"];
        let pure = [
            "version",
            "seed",
            "stribeck_exponent",
            "exponent",
            "unloading_shape",
            "share",
            "value",
            "ci95",
            "gain",
            "skip_rows",
        ];
        match value {
            Value::Object(inner) => inner.iter().for_each(|(key, value)| walk(key, value)),
            Value::Array(inner) => inner.iter().for_each(|value| walk(key, value)),
            Value::Number(_) => {
                assert!(
                    pure.contains(&key) || units.iter().any(|unit| key.ends_with(unit)),
                    "{key} has no unit"
                )
            }
            _ => {}
        }
    }
    walk("", &value(&complete().to_json()));
    walk("", &value(&slow().to_json()));
    walk("", &value(&along().to_json()));
    classical_files().iter().for_each(|file| walk("", &value(&file.to_json())));
}

/// Changes or removes one value of a valid file.
fn broken(good: &ModelFile, pointer: &str, replacement: Option<Value>) -> Value {
    let mut document = value(&good.to_json());
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
        (
            "/version",
            Some(json!(8)),
            "written by another version of trocar: model version 8, this one reads 1",
        ),
        ("/version", Some(json!(0)), "model version 0, this one reads 1"),
        ("/version", Some(json!("1")), "\"version\" must be 1, got \"1\""),
        ("/version", None, "\"version\" must be 1, got nothing"),
        ("/origin", None, "missing field `origin`"),
        ("/origin/kind", Some(json!("measured")), "unknown variant `measured`"),
        ("/origin/seed", Some(json!(-1)), "invalid value: integer `-1`"),
        (
            "/origin/recordings/0/sha256",
            Some(json!("abc")),
            "origin.recordings[0].sha256: must be 64",
        ),
        ("/elements", None, "a model holds elements or friction, got neither"),
        ("/elements", Some(json!([])), "a model has 1 to 4 elements, got 0"),
        ("/elements", Some(json!({})), "expected a sequence"),
        ("/elements/0/stiffness", Some(json!(3)), "unknown field `stiffness`, expected one of"),
        ("/elements/1/insertion/coulomb_force_n", None, "missing field `coulomb_force_n`"),
        (
            "/elements/1/insertion/coulomb_force_n",
            Some(json!("3 N")),
            "elements[1].insertion.coulomb_force_n: must be a number in N, got \"3 N\"",
        ),
        (
            "/elements/1/insertion/coulomb_force_n",
            Some(json!(-0.3)),
            "elements[1]: coulomb_force_n must be finite and above 0 N, got -0.3 N",
        ),
        (
            "/elements/0/withdrawal/viscous_damping_n_s_m",
            Some(json!(null)),
            "elements[0].withdrawal.viscous_damping_n_s_m: must be a number in N s/m, got null",
        ),
        (
            "/elements/0/withdrawal/viscous_damping_n_s_m",
            Some(json!(-1)),
            "elements[0]: viscous_damping",
        ),
        (
            "/elements/0/withdrawal/viscous_damping",
            Some(json!(1)),
            "unknown field `viscous_damping`",
        ),
        (
            "/elements/0/seal_damping/constant_n_s_m",
            Some(json!(-1.0)),
            "elements[0]: seal_damping_n_s_m must be",
        ),
        ("/elements/0/deformation/insertion/pieces/0", None, "invalid length 1"),
        (
            "/elements/0/deformation/withdrawal/pieces/1/legendre_n",
            Some(json!([])),
            "elements[0].deformation.withdrawal.pieces[1]: a piece needs 1 to 8 Legendre coefficients, got 0",
        ),
        ("/elements/0/deformation/half_width_m", Some(json!(-0.008)), "half_width_m is -0.008"),
        (
            "/sensor/moving_mass_kg",
            Some(json!(-0.1)),
            "sensor.moving_mass_kg: must not be negative",
        ),
        ("/sensor/moving_mass_g", Some(json!(40)), "unknown field `moving_mass_g`"),
        ("/intervals/coulomb_force_n/ci95", Some(json!([1.0])), "invalid length 1"),
        ("/intervals/coulomb_force_n/value", None, "missing field `value`"),
    ];
    for (pointer, replacement, message) in cases {
        let document = broken(&complete(), pointer, replacement);
        let error = ModelFile::from_json(&document.to_string()).unwrap_err().to_string();
        assert!(error.contains(message), "{pointer}: {error}");
        assert!(!schema.is_valid(&document), "{pointer}: the schema takes it");
    }
}

/// The last file of a kind: that with the most elements.
fn file_of(kind: &str) -> ModelFile {
    let of_kind = |file: &ModelFile| file.trocar.seal().kind() == kind;
    classical_files().into_iter().rfind(of_kind).unwrap()
}

#[test]
fn classical_models_of_another_form_are_refused_by_reader_and_schema() {
    let schema = schema();
    let elements = value(&complete().to_json())["elements"].clone();
    let many = json!(vec![json!({"stiffness_n_m": 1.0, "limit_force_n": 1.0}); MAX_ELEMENTS + 1]);
    let number = "friction.sliding.coulomb_force_n: must be a number in N, got \"3 N\"";
    let kinds = "friction.kind: must be one of static, dahl, lugre, leuven, maxwell-slip, gms, bouc-wen, got";
    let cases = [
        (
            "static",
            "/elements",
            Some(elements),
            "friction: a model holds elements or friction, got both".to_owned(),
        ),
        ("static", "/friction", Some(json!(null)), "elements or friction, got neither".to_owned()),
        ("static", "/friction", Some(json!([1])), "expected an object".to_owned()),
        ("static", "/friction/kind", None, "friction: missing field `kind`".to_owned()),
        ("static", "/friction/kind", Some(json!("coulomb")), format!("{kinds} \"coulomb\"")),
        ("static", "/friction/kind", Some(json!(7)), format!("{kinds} 7")),
        ("static", "/friction/kind", Some(json!("dahl")), "missing field `stiffness_n_m`".into()),
        ("static", "/friction/sliding", None, "missing field `sliding`".into()),
        ("static", "/friction/sliding/coulomb_force_n", Some(json!("3 N")), number.into()),
        (
            "static",
            "/friction/sliding/coulomb_force",
            Some(json!(3)),
            "unknown field `coulomb_force`".into(),
        ),
        (
            "dahl",
            "/friction/coulomb_force_n",
            Some(json!(-3)),
            "friction: coulomb_force_n must be finite and above 0 N".into(),
        ),
        ("dahl", "/friction/exponent", None, "missing field `exponent`".into()),
        (
            "lugre",
            "/friction/damping_velocity_m_s",
            None,
            "missing field `damping_velocity_m_s`".into(),
        ),
        (
            "lugre",
            "/friction/damping_velocity_m_s",
            Some(json!(0)),
            "damping_velocity_m_s must be above 0 m/s".into(),
        ),
        (
            "lugre",
            "/friction/damping_velocity_m_s",
            Some(json!("inf")),
            "friction.damping_velocity_m_s: must be a number in m/s, got \"inf\"".into(),
        ),
        (
            "lugre",
            "/friction/curve",
            Some(json!("gaussian")),
            "friction.curve: must be exponential or rational, got \"gaussian\"".into(),
        ),
        (
            "lugre",
            "/friction/mass_kg",
            Some(json!(1)),
            "unknown field `mass_kg`, expected one of `kind`".into(),
        ),
        (
            "leuven",
            "/friction/elements",
            Some(json!([])),
            "friction: a model needs 1 to 16 elements, got 0".into(),
        ),
        (
            "leuven",
            "/friction/micro_damping_n_s_m",
            Some(json!(-1)),
            "micro_damping_n_s_m must be finite and at least 0 N s/m".into(),
        ),
        ("maxwell-slip", "/friction/elements", Some(many), "1 to 16 elements, got 17".into()),
        (
            "maxwell-slip",
            "/friction/elements/1/limit_force_n",
            Some(json!(0)),
            "element_2_limit_force_n must".into(),
        ),
        (
            "maxwell-slip",
            "/friction/elements/1/share",
            Some(json!(0)),
            "unknown field `share`".into(),
        ),
        (
            "gms",
            "/friction/slip_rate",
            Some(json!("bounded")),
            "friction.slip_rate: must be free or limited, got \"bounded\"".into(),
        ),
        (
            "gms",
            "/friction/elements/0/attraction_m_s",
            None,
            "missing field `attraction_m_s`".into(),
        ),
        (
            "gms",
            "/friction/elements/0/damping_n_s_m",
            Some(json!(-1)),
            "element_1_damping_n_s_m must be".into(),
        ),
    ];
    for (kind, pointer, replacement, message) in cases {
        let document = broken(&file_of(kind), pointer, replacement);
        let error = ModelFile::from_json(&document.to_string()).unwrap_err().to_string();
        assert!(error.contains(&message), "{kind} {pointer}: {error}");
        assert!(!schema.is_valid(&document), "{kind} {pointer}: the schema takes it");
    }
}

#[test]
fn impossible_classical_models_are_refused_by_the_reader() {
    let cases = [
        (
            "lugre",
            "/friction/sliding/static_force_n",
            json!(1.0),
            "friction: static_force_n must be at least",
        ),
        (
            "leuven",
            "/friction/sliding/static_force_n",
            json!(3.5),
            "friction: the limit forces of the elements",
        ),
        (
            "gms",
            "/friction/elements/0/share",
            json!(0.5),
            "friction: the shares of the elements must add up to 1",
        ),
    ];
    for (kind, pointer, replacement, message) in cases {
        let document = broken(&file_of(kind), pointer, Some(replacement));
        let error = ModelFile::from_json(&document.to_string()).unwrap_err().to_string();
        assert!(error.contains(message), "{kind} {pointer}: {error}");
    }
}

#[test]
fn impossible_seals_are_refused_by_the_reader() {
    let cases = [
        (
            "/elements/0/deformation/insertion/join_m",
            json!(0.001),
            "insertion: join_m is 0.001, but the pieces meet",
        ),
        (
            "/elements/0/deformation/half_width_m",
            json!(8.0),
            "half_width_m is 8, but the pieces end at 0.008",
        ),
        (
            "/elements/0/deformation/insertion/pieces/0/legendre_n/0",
            json!(1.5),
            "deformation.insertion: a branch must be continuous",
        ),
        (
            "/elements/0/deformation/insertion/pieces/1/to_m",
            json!(-0.02),
            "insertion.pieces[1]: a piece must end right of its start",
        ),
        (
            "/elements/0/deformation/yield_stiffness_n_m",
            json!(1.0),
            "yield_stiffness_n_m must be at least",
        ),
        ("/elements/0/insertion/static_force_n", json!(2.0), "static_force_n must be at least"),
        ("/elements/0/insertion/static_force_n", json!(3.5), "both branches must pass 3.5 N"),
        (
            "/intervals/coulomb_force_n/value",
            json!(9.0),
            "intervals.coulomb_force_n: value 9 lies outside",
        ),
    ];
    for (pointer, replacement, message) in cases {
        let document = broken(&complete(), pointer, Some(replacement));
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
    assert!(
        matches!(error, ModelFileError::NotJson { line, .. } if line.abs_diff(lines) <= 1),
        "{error}"
    );
    let typo = good.replacen("half_width_m\":", "half_width\":", 1);
    let at = 1 + typo.lines().position(|l| l.contains("half_width\":")).unwrap();
    let error = ModelFile::from_json(&typo).unwrap_err();
    assert!(matches!(error, ModelFileError::WrongKey { line, .. } if line == at), "{error}");
    for text in ["", "time_s,position_m\n0,0", "[1,2]", "{\"format\":1e999}", "null"] {
        assert!(ModelFile::from_json(text).is_err(), "{text:?}");
    }
    for member in ["\"version\": 1,", "\"coulomb_force_n\": 3.0,"] {
        let twice = good.replacen(member, &format!("{member} {member}"), 1);
        assert_ne!(twice, good);
        let error = ModelFile::from_json(&twice).unwrap_err().to_string();
        assert!(error.contains("duplicate field"), "{error}");
    }
}

#[test]
fn a_file_of_another_version_is_recognised_whatever_else_it_holds() {
    for version in [0, 2, 8, 99] {
        let text = json!({"format": "trocar-model", "version": version, "seals": {}});
        let error = ModelFile::from_json(&text.to_string()).unwrap_err();
        assert!(matches!(error, ModelFileError::OtherVersion { found } if found == version));
        assert!(error.to_string().contains("hint: update"));
    }
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

/// Changed at random, a model file is refused or read as a model that writes itself back: never a
/// panic.
#[test]
fn damaged_models_are_refused_or_read() {
    let mut texts = vec![complete().to_json(), slow().to_json(), along().to_json()];
    texts.extend(classical_files().iter().map(ModelFile::to_json));
    let pieces =
        ["-", "e999", "1e-320", "null", "{", "[", "\"", "0", "NaN", ",", "insertion", "\u{0}"];
    let mut random = 1u64;
    let mut draw = |below: usize| {
        random =
            random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (random >> 33) as usize % below
    };
    let mut read = 0;
    for round in 0..20_000 {
        let mut text: Vec<char> = texts[round % texts.len()].chars().collect();
        for _ in 0..=draw(3) {
            let at = draw(text.len());
            match draw(4) {
                0 => drop(text.splice(at..at, pieces[draw(pieces.len())].chars())),
                1 => drop(text.drain(at..(at + 1 + draw(20)).min(text.len()))),
                2 if text[at].is_ascii_digit() => text[at] = char::from(b'0' + draw(10) as u8),
                _ => text[at] = [' ', '9', '-', '.', 'e', ':'][draw(6)],
            }
        }
        let text: String = text.into_iter().collect();
        if let Ok(model) = ModelFile::from_json(&text) {
            let again =
                ModelFile::from_json(&model.to_json()).expect("what was read can be written");
            assert_eq!(again.to_json(), model.to_json());
            let mut state = model.trocar.rest(0.0);
            for k in 0..50 {
                model.trocar.step(&mut state, 1e-4 * f64::from(k % 7 - 3), 1e-3);
            }
            assert!(state.force().is_finite());
            read += 1;
        }
    }
    assert!(read > 500, "{read} were read");
}
