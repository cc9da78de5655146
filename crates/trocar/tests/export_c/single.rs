//! The C code in single precision beside the library in double precision.

use super::*;

/// Largest difference of the force from the library over `conformance/motion.csv`, N, and a few
/// digits of room for another `logf`; by positions (`step_to`) and by displacements (`step`). A
/// position of 0.1 m has a resolution of 7 nm in single precision, so its differences carry an
/// error that displacements do not have.
const BOUNDS: [(&str, f64, f64); 16] = [
    ("bouc_wen", 1.5e-4, 2e-6),
    ("dahl", 1.5e-4, 1e-5),
    ("ems", 2e-5, 1e-4),
    ("ems_dwell", 1.5e-4, 1.3e-4),
    ("ems_profile", 1e-4, 8e-5),
    ("ems_slow", 7e-5, 7e-5),
    ("ems_stages", 3e-4, 2.5e-4),
    ("ems_stribeck", 4.5e-4, 2e-4),
    ("ems_weakening", 4.5e-3, 4e-3),
    ("gms", 2.5e-4, 7e-6),
    ("gms_free", 2.5e-4, 7e-6),
    ("leuven", 3e-4, 2e-6),
    ("lugre", 5e-4, 1.5e-5),
    ("lugre_rational", 3.5e-4, 7e-6),
    ("maxwell_slip", 1.5e-4, 1.5e-5),
    ("static", 9e-4, 4e-7),
];

fn single(prefix: &str) -> COptions<'_> {
    COptions { precision: Precision::Single, ..options(prefix) }
}

/// A program with all `models` in single precision, built with `flags`.
fn build(models: &[(String, ModelFile)], folder: &Path, flags: &[&str]) -> PathBuf {
    for (name, model) in models {
        store_as(model, folder, single(name));
    }
    let names: Vec<String> = models.iter().map(|(name, _)| name.clone()).collect();
    fs::write(folder.join("driver.c"), driver(&names, "float")).unwrap();
    let fixed = ["-Werror", "driver.c", "-o", "single", "-lm"];
    gcc(folder, &[flags, &fixed].concat());
    folder.join("single")
}

/// The same motion by displacements.
fn by_displacement(start: f64, calls: &[Call]) -> Vec<Call> {
    let mut position = start;
    let mut call = |call: &Call| {
        let way = call.way - std::mem::replace(&mut position, call.way);
        Call { to: false, way, ..*call }
    };
    calls.iter().map(&mut call).collect()
}

/// Largest and root-mean-square difference of the forces, and the largest force, N.
pub(super) fn differences(
    model: &ModelFile,
    start: f64,
    calls: &[Call],
    outcomes: &[Outcome],
) -> [f64; 3] {
    let trocar = model.trocar.borrowed();
    let mut state = trocar.rest(start);
    let (mut largest, mut squares, mut force) = (0.0_f64, 0.0, 0.0_f64);
    for (call, outcome) in calls.iter().zip(&outcomes[1..]) {
        let exact = match call.to {
            true => trocar.step_to(&mut state, call.way, call.duration),
            false => trocar.step(&mut state, call.way, call.duration),
        };
        let difference = outcome.force - exact;
        assert!(difference.is_finite());
        largest = largest.max(difference.abs());
        squares += difference * difference;
        force = force.max(exact.abs());
    }
    [largest, (squares / calls.len() as f64).sqrt(), force]
}

/// Prints the table of docs/reference/exported-c.md.
#[test]
fn single_precision_is_as_near_as_documented() {
    if !has_gcc() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let models = conformance_models();
    let program = build(&models, folder.path(), &["-O2"]);
    let (start, positions) = conformance_motion();
    let displacements = by_displacement(start, &positions);
    let by_positions = run_c(&program, start, &positions, models.len());
    let by_displacements = run_c(&program, start, &displacements, models.len());
    println!(
        "| model | largest force | step_to, largest/mN | mean square/mN | step, largest/mN | mean square/mN |"
    );
    assert_eq!(models.len(), BOUNDS.len());
    for (k, (name, model)) in models.iter().enumerate() {
        let [to, to_mean, force] = differences(model, start, &positions, &by_positions[k]);
        let [by, by_mean, _] = differences(model, start, &displacements, &by_displacements[k]);
        let milli = [to, to_mean, by, by_mean].map(|newton| format!("{:.4}", 1e3 * newton));
        println!("| {name} | {force:.2} N | {} |", milli.join(" | "));
        let (known, to_bound, by_bound) = BOUNDS[k];
        assert_eq!(name, known);
        assert!(to <= to_bound && by <= by_bound, "{name}: {to:e} N, {by:e} N");
    }
    let expected = fs::read_to_string(repository().join("docs/reference/exported-c.md")).unwrap();
    for (name, to, by) in BOUNDS {
        let row = format!("| {name} | ");
        let row = expected.lines().filter(|line| line.starts_with(&row));
        let cells: Vec<Vec<&str>> = row.map(|line| line.split(" | ").collect()).collect();
        // The largest force stands in the second column of this table alone.
        let is_own = |row: &&Vec<&str>| row.get(1).is_some_and(|cell| cell.ends_with(" N"));
        let value = |cell: &str| cell.parse::<f64>().ok();
        let documented = cells
            .iter()
            .filter(is_own)
            .find_map(|row| Some((value(row.get(2)?)?, value(row.get(4)?)?)));
        let (shown_to, shown_by) = documented.unwrap_or_else(|| panic!("{name} is not documented"));
        assert!(shown_to <= 1e3 * to && shown_by <= 1e3 * by, "{name}: the table is out of date");
    }
}

/// Whatever happens, a step in single precision ends with a finite force, without undefined
/// behaviour, and changes nothing if it is refused.
#[test]
fn single_precision_survives_any_motion() {
    if !has_gcc() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let models = [conformance_models(), random_models(), classical_models()].concat();
    let flags = ["-O1", "-fsanitize=undefined", "-fno-sanitize-recover"];
    let program = build(&models, folder.path(), &flags);
    let calls = adversarial_motion();
    let rows = run_c(&program, 0.05, &calls, models.len());
    for ((name, _), outcomes) in models.iter().zip(&rows) {
        let mut position = outcomes[0].position as f32;
        for (k, (call, outcome)) in calls.iter().zip(&outcomes[1..]).enumerate() {
            let (way, duration) = (call.way as f32, call.duration as f32);
            let goes = duration > 0.0
                && duration.is_finite()
                && (way / duration).is_finite()
                && (position + way).is_finite();
            assert!(outcome.force.is_finite(), "{name}, step {k}");
            assert!(goes || !outcome.touched, "{name}, step {k}: the state changed");
            position = outcome.position as f32;
        }
    }
}

/// For a Cortex-M4F nothing is left to the routines that emulate a double.
#[test]
fn a_processor_without_doubles_needs_none() {
    if !builds::has(builds::ARM) {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for (name, model) in conformance_models() {
        store_as(&model, folder.path(), single("seal"));
        builds::for_cortex_m4f(folder.path(), "seal");
        let mut symbols = Command::new("arm-none-eabi-nm");
        let symbols = symbols.current_dir(folder.path()).args(["-u", "seal.o"]).output().unwrap();
        let symbols = String::from_utf8(symbols.stdout).unwrap();
        let needed: Vec<&str> = symbols.split_whitespace().filter(|name| *name != "U").collect();
        let known = ["log1pf", "logf", "sqrtf", "memcpy", "memset"];
        assert!(needed.iter().all(|name| known.contains(name)), "{name}: {needed:?}");
    }
}

/// Constants beyond a float are refused, not rounded to infinity or nothing.
#[test]
fn a_model_beyond_single_precision_is_refused() {
    let dahl =
        DahlParams { stiffness: 1e42, coulomb_force: 3.0, exponent: 1.0, viscous_damping: 1.0 };
    let model = Classical::Dahl(Dahl::new(dahl).unwrap());
    let model = ModelFile::new(model, Origin::new(OriginKind::HandMade));
    let refused = write(&model, "a test", single("p")).unwrap_err();
    assert!(matches!(refused, CError::Single { .. }));
    assert!(refused.to_string().contains("contains 1e42"), "{refused}");
    assert!(write(&model, "a test", options("p")).is_ok());
}
