//! `trocar compare` as a process: exit codes, JSON, order, equal bytes, and that nothing
//! half-written stays behind.

use std::fs;

use serde_json::Value;
use trocar::model_file::ModelFile;
use trocar::recording::{ReadOptions, Recording, read};
use trocar::replay::{Replay, replay};

use crate::common::{Place, Ran};

/// Keys that every model has.
const KEYS: [&str; 11] = [
    "name",
    "elements",
    "parameters",
    "train_rms_n",
    "validate_rms_n",
    "fit_percent",
    "aic",
    "bic",
    "ns_per_sample",
    "fit_s",
    "warnings",
];
/// Models that fit in a moment.
const QUICK: &str = "coulomb-viscous,ems,maxwell-slip:1-2,dahl";

/// Error of one model on one recording by two ways of adding up, N: rounding alone.
const SAME_ERROR: f64 = 1e-9;

/// A folder with recordings of a virtual bench.
fn recorded() -> Place {
    let place = Place::new();
    let speeds = "slowest_m_s = 0.02\nfastest_m_s = 0.08\nincrement_m_s = 0.02\nstroke_m = 0.06\n";
    let rig = format!("[protocol.steady]\n{speeds}\n[protocol.validation]\n{speeds}");
    fs::write(place.path("rig.toml"), rig).unwrap();
    place.run("bench steady --rig rig.toml --out steady.csv").ends_with(0);
    place.run("bench validation --rig rig.toml --seed 2 --out validation.csv").ends_with(0);
    place
}

impl Place {
    /// Compares the quick models without times.
    fn compare(&self, more: &str) -> Ran {
        self.run(&format!("compare steady.csv --moving-mass-kg 0.04 --no-timing {more}"))
    }

    /// A recording as `compare --moving-mass-kg 0.04` scores it.
    fn scored(&self, name: &str) -> Recording {
        let recording = read(&self.path(name), &ReadOptions::default()).unwrap();
        recording.smoothed().into_owned().without_moving_mass(0.04, 0.0).unwrap()
    }

    fn fitted(&self, name: &str) -> ModelFile {
        ModelFile::read(&self.path(name)).unwrap()
    }
}

impl Ran {
    fn json(&self) -> Value {
        serde_json::from_str(&self.stdout).unwrap()
    }
}

fn models(json: &Value) -> &Vec<Value> {
    json["models"].as_array().unwrap()
}

fn numbers(json: &Value, key: &str) -> Vec<f64> {
    models(json).iter().map(|model| model[key].as_f64().unwrap()).collect()
}

#[test]
fn json_holds_every_model_with_all_keys_least_error_first() {
    let place = recorded();
    let json = place
        .compare(&format!("--validate validation.csv --models {QUICK} --json"))
        .ends_with(0)
        .json();
    assert_eq!(models(&json).len(), 5);
    for model in models(&json) {
        for key in KEYS {
            assert!(model.get(key).is_some(), "no {key} in {model}");
        }
        assert!(model["ns_per_sample"].is_null() && model["fit_s"].is_null(), "{model}");
        assert!(model["warnings"].as_array().unwrap().iter().all(Value::is_string));
        let offset = &model["estimates"]["offset_n"];
        assert!(
            offset["value"].is_number()
                && offset["unit"] == "N"
                && offset["determined"].is_boolean(),
            "{offset}"
        );
        assert_eq!(offset["ci95"].as_array().unwrap().len(), 2);
    }
    let errors = numbers(&json, "validate_rms_n");
    assert!(errors.is_sorted(), "{errors:?}");
    assert_eq!(models(&json)[0]["name"], "ems", "the bench is made with an EMS element");
    assert_eq!(json["held_out"], false);
    assert_eq!(json["reversal_claim"].as_array().unwrap().len(), 1, "one family of banks");
    assert!(json["reversal_claim"][0]["sentence"].as_str().unwrap().contains("Maxwell-Slip"));
    assert!(
        json["verdict"].as_str().unwrap().contains("least error: EMS ("),
        "{}",
        json["verdict"]
    );
    assert_eq!(models(&json)[0]["behind_best"]["standard_errors"], 0.0);
    assert!(
        models(&json)[1..]
            .iter()
            .all(|model| model["behind_best"]["standard_errors"].as_f64().unwrap() > 2.0)
    );
    let used: Vec<&str> = json["recordings"]
        .as_array()
        .unwrap()
        .iter()
        .map(|r| r["used_for"].as_str().unwrap())
        .collect();
    assert_eq!(used, ["training", "validation"]);
    assert_eq!(json["recordings"][0]["sha256"].as_str().unwrap().len(), 64);
}

#[test]
fn equal_input_gives_equal_bytes_and_times_are_all_that_differs() {
    let place = recorded();
    let arguments = format!("--validate validation.csv --models {QUICK} --json");
    let first = place.compare(&format!("{arguments} --out first")).ends_with(0);
    let second = place.compare(&format!("{arguments} --out second")).ends_with(0);
    assert_eq!(first.stdout, second.stdout);
    for file in [
        "compare.json",
        "report.html",
        "figures/one-reversal.svg",
        "figures/error-by-parameters.png",
    ] {
        let [a, b] = ["first", "second"].map(|out| fs::read(place.path(out).join(file)).unwrap());
        assert!(a == b, "{file} differs");
    }
    assert_eq!(first.stdout, fs::read_to_string(place.path("first/compare.json")).unwrap());
    let timed =
        place.run(&format!("compare steady.csv --moving-mass-kg 0.04 {arguments}")).ends_with(0);
    let mut json = timed.json();
    for model in json["models"].as_array_mut().unwrap() {
        for key in ["ns_per_sample", "fit_s"] {
            assert!(model[key].as_f64().unwrap() > 0.0, "{model}");
            model[key] = Value::Null;
        }
    }
    assert_eq!(json, first.json());
}

#[test]
fn without_validation_the_last_third_is_held_out_and_it_is_said() {
    let place = recorded();
    let ran = place.compare("--models ems,coulomb --json --out out").ends_with(0);
    ran.says(&["last third", "held out"]);
    let json = ran.json();
    assert_eq!(json["held_out"], true);
    let parts = json["recordings"].as_array().unwrap();
    assert_eq!(parts.len(), 2);
    assert_eq!(parts[0]["sha256"], parts[1]["sha256"], "parts of one file");
    let duration = |k: usize| parts[k]["duration_s"].as_f64().unwrap();
    let part = duration(1) / (duration(0) + duration(1));
    assert!((0.1..0.34).contains(&part), "{part}");
    let page = fs::read_to_string(place.path("out/report.html")).unwrap();
    assert!(page.contains("The last third of each recording was held out"));
}

/// The answer is one row for each family; everything else is asked for.
#[test]
fn the_best_of_each_family_comes_first_and_all_models_on_demand() {
    let place = recorded();
    let compared = "--validate validation.csv --models ems,gms:2,gms:2-3,leuven:1";
    let brief = place.compare(compared).ends_with(0);
    let rows: Vec<&str> = brief.stdout.lines().take_while(|line| !line.is_empty()).collect();
    assert_eq!(rows.len(), 4, "a header and three families: {rows:#?}");
    assert!(rows[0].contains("standard errors behind") && rows[1].contains("EMS"), "{rows:#?}");
    assert!(brief.stdout.contains("least error: EMS ("), "{}", brief.stdout);
    let ran = place.compare(&format!("{compared} --all")).ends_with(0);
    let table = ran.stdout.strip_prefix(&brief.stdout).expect("the answer first");
    let mut lines = table.lines().skip(1);
    let head = lines.next().unwrap();
    for column in [
        "model",
        "elements",
        "parameters",
        "validate N",
        "fit %",
        "AIC",
        "BIC",
        "worst reversal N",
        "warnings",
    ] {
        assert!(head.contains(column), "{head}");
    }
    let rows: Vec<&str> = lines.take_while(|line| !line.is_empty()).collect();
    assert_eq!(rows.len(), 4, "gms:2 is named twice and counts once: {rows:#?}");
    assert!(rows.iter().all(|row| row.contains("  -  ")), "no times: {rows:#?}");
    assert!(
        ran.stdout.contains("GMS matches") || ran.stdout.contains("GMS does not match"),
        "{}",
        ran.stdout
    );
}

#[test]
fn models_that_do_not_exist_are_refused_with_those_that_do() {
    let place = recorded();
    let cases: [(&str, &[&str]); 8] = [
        ("friction", &["\"friction\"", "coulomb-viscous", "lugre-rational", "gms[:N"]),
        ("ems,,gms", &["\"\"", "there are"]),
        ("gms:0", &["gms:N or gms:A-B", "1 to 16", "\"gms:0\""]),
        ("gms:17", &["1 to 16"]),
        ("gms:4-2", &["\"gms:4-2\""]),
        ("gms:x", &["\"gms:x\""]),
        ("lugre:2", &["lugre has no number of elements"]),
        ("GMS", &["\"GMS\"", "there are"]),
    ];
    for (list, essentials) in cases {
        let ran = place.compare(&format!("--models {list}")).ends_with(2);
        ran.says(essentials);
        assert!(ran.stdout.is_empty(), "{ran:#?}");
    }
}

#[test]
fn what_fails_leaves_nothing_behind() {
    let place = recorded();
    let before = place.names();
    place
        .compare("--validate nowhere.csv --out out")
        .ends_with(1)
        .says(&["nowhere.csv", "No such file"]);
    fs::copy(place.path("steady.csv"), place.path("again.csv")).unwrap();
    let same = ["steady.csv", "again.csv", "same bytes", "either fitted or scored on"];
    place.compare("--validate again.csv --out out").ends_with(2).says(&same);
    fs::remove_file(place.path("again.csv")).unwrap();
    place.compare("--models ems --out rig.toml/out").ends_with(1).says(&[
        "cannot create",
        "hint:",
        "--out",
    ]);
    // Flipped, the force pushes: there is no sliding to identify.
    place
        .compare("--flip-force --out out")
        .ends_with(1)
        .says(&["opposes the motion", "--flip-force"]);
    assert_eq!(place.names(), before);
}

#[test]
fn lost_data_and_seals_that_never_slide_end_with_3() {
    let place = recorded();
    let text = fs::read_to_string(place.path("validation.csv")).unwrap();
    let mut lines: Vec<&str> = text.lines().collect();
    lines[700] = "nan,nan,nan,nan";
    fs::write(place.path("lost.csv"), lines.join("\n")).unwrap();
    place
        .compare("--validate lost.csv --models coulomb")
        .ends_with(3)
        .says(&["lost.csv", "left out"]);

    // A tenth of a millimetre to and fro moves the seal, never the rod in it.
    let mut still = String::from("time_s,position_m,force_n\n");
    for k in 0..2000 {
        let t = 1e-3 * f64::from(k);
        still.push_str(&format!(
            "{t:.3},{:.7},{:.4}\n",
            1e-4 * (3.0 * t).sin(),
            0.05 * (3.0 * t).sin()
        ));
    }
    fs::write(place.path("still.csv"), still).unwrap();
    let ran = place.compare("--validate still.csv --models coulomb --json").ends_with(3);
    ran.says(&["still.csv", "never makes the seal slide"]);
    assert_eq!(models(&ran.json()).len(), 1);
}

fn run(model: &ModelFile, recording: &Recording) -> Replay {
    replay(&model.trocar, recording, model.offset())
}

/// Root mean square error, N, over the samples whose state `judge` knows.
fn rms(model: &ModelFile, recording: &Recording, judge: &ModelFile) -> f64 {
    let (run, scored) = (run(model, recording), run(judge, recording).known);
    let offset = model.sensor.unwrap().offset_n;
    let squares: Vec<f64> = scored
        .into_iter()
        .flatten()
        .map(|i| (recording.force[i] - offset - run.force[i]).powi(2))
        .collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// `compare` scores all models on the samples known to the EMS element, `validate` each on those
/// known to itself.
#[test]
fn models_are_left_as_files_that_validate_to_the_same_errors() {
    let place = recorded();
    let models_of = "ems,ems-output-error,coulomb,stribeck,dahl,lugre,lugre-rational,leuven:2,maxwell-slip:2,gms:2";
    let json =
        place.compare(&format!("--validate validation.csv --models {models_of} --json --out out"));
    let json = json.ends_with(0).json();
    let recording = place.scored("validation.csv");
    let ems = place.fitted("out/models/ems.json");
    let mut files: Vec<String> = Vec::new();
    for model in models(&json) {
        let name = model["name"].as_str().unwrap();
        let bank = ["leuven", "maxwell-slip", "gms"].contains(&name);
        let file = format!("out/models/{name}{}.json", if bank { "-2" } else { "" });
        let own = place.fitted(&file);
        let compared = model["validate_rms_n"].as_f64().unwrap();
        let apart = (rms(&own, &recording, &ems) - compared).abs();
        assert!(apart < SAME_ERROR, "{file}: {apart} N on the same samples");
        let ran = place.run(&format!("validate {file} validation.csv --json")).ends_with(0);
        let validated = ran.json()["rms_n"].as_f64().unwrap();
        let apart = (validated - rms(&own, &recording, &own)).abs();
        assert!(apart < SAME_ERROR, "{file}: {apart} N on its own samples");
        if name == "ems" {
            assert!((validated - compared).abs() < SAME_ERROR, "{validated} {compared}");
        }
        files.push(file["out/models/".len()..].to_owned());
    }
    let mut written: Vec<String> = fs::read_dir(place.path("out/models"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    files.sort();
    written.sort();
    assert_eq!(written, files, "one file a model");
}

#[test]
fn models_say_where_they_come_from() {
    let place = recorded();
    let arguments = "--validate validation.csv --models ems,lugre --gravity-m-s2 -9.81 --seed 7 --json --out out";
    let json = place.compare(arguments).ends_with(0).json();
    for model in models(&json) {
        let file = place.fitted(&format!("out/models/{}.json", model["name"].as_str().unwrap()));
        assert_eq!((file.origin.seed, file.origin.recordings.len()), (Some(7), 1));
        assert_eq!(file.origin.recordings[0].name, "steady.csv");
        assert_eq!(
            file.origin.recordings[0].sha256,
            json["recordings"][0]["sha256"].as_str().unwrap()
        );
        let sensor = file.sensor.unwrap();
        assert_eq!(sensor.moving_mass_kg, 0.04);
        // What the sensor reads at rest includes the weight that was subtracted.
        let weight = sensor.offset_n - model["offset_n"].as_f64().unwrap();
        assert!((weight + 0.04 * 9.81).abs() < SAME_ERROR, "{weight} N");
        for (name, interval) in &file.intervals {
            assert_eq!(
                interval.value,
                model["estimates"][name]["value"].as_f64().unwrap(),
                "{name}"
            );
        }
        assert_eq!(file.intervals.len(), model["estimates"].as_object().unwrap().len());
    }
}

#[test]
fn classical_models_simulate_their_force_and_are_no_ems_elements() {
    let place = recorded();
    place.compare("--validate validation.csv --models lugre --out out").ends_with(0);
    let model = "out/models/lugre.json";
    place
        .run(&format!("simulate {model} validation.csv --out force.csv"))
        .ends_with(0)
        .says(&["start: at rest"]);
    let text = fs::read_to_string(place.path("force.csv")).unwrap();
    assert_eq!(text.lines().next(), Some("time_s,position_m,force_n"));
    let raw = read(&place.path("validation.csv"), &ReadOptions::default()).unwrap();
    let forces: Vec<f64> = text
        .lines()
        .skip(1)
        .map(|line| line.rsplit_once(',').unwrap().1.parse().unwrap())
        .collect();
    assert_eq!(forces, run(&place.fitted(model), &raw).force);

    let table = place.run(&format!("validate {model} validation.csv")).ends_with(0).stdout;
    assert!(
        table.contains("moving N") && table.contains("hold N") && !table.contains("sliding N"),
        "{table}"
    );
    let before = place.names();
    let essentials = [model, "holds a lugre model", "expected EMS elements"];
    place
        .run(&format!("analyze {model}"))
        .ends_with(1)
        .says(&essentials)
        .says(&["hint: trocar simulate"]);
    place.run(&format!("bench step --seal {model} --out step.csv")).ends_with(1).says(&essentials);
    let ran = place
        .run(&format!("simulate {model} validation.csv --out other.csv --initial-deflection-mm 1"))
        .ends_with(2);
    ran.says(&["--initial-deflection-mm", "is for EMS elements", model, "lugre"]);
    assert_eq!(place.names(), before);
}

/// A model that was compared states its error, so compensation takes it without further options.
#[test]
fn models_that_were_compared_compensate() {
    let place = recorded();
    place.compare("--validate validation.csv --models maxwell-slip:2 --out out").ends_with(0);
    let model = place.fitted("out/models/maxwell-slip-2.json");
    let error = model.force_error.expect("an error");
    let json: Value =
        serde_json::from_str(&fs::read_to_string(place.path("out/compare.json")).unwrap()).unwrap();
    let overall = models(&json)[0]["validate_rms_n"].as_f64().unwrap();
    let phases = [error.deforming_n, error.sliding_n].map(Option::unwrap);
    assert!(
        phases[0] >= phases[1] && phases.iter().all(|rms| *rms > 0.3 * overall),
        "{phases:?} {overall}"
    );
    place
        .run("compensate out/models/maxwell-slip-2.json validation.csv --out tissue.csv")
        .ends_with(0);
}
