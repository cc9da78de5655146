//! Sweeps: rows that depend only on the document, and the results of a run.

use std::path::Path;
use std::time::Duration;

use trocar::cancel::{Cancel, Stopped};
use trocar::model_file::ModelFile;
use trocar::sweep::{Summary, Sweep};
use trocar::table::{Column, Table, read};
use trocar::teleop::{Config, Outcome};

const HEAD: &str = "runs = 150\nseed = 7\n[motion]\nprotocol = \"step\"\n";

/// The table of `document` on `threads` threads.
fn table(document: &str, threads: usize) -> (Table, Summary) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("table.parquet");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let sweep = Sweep::new(document, Path::new("")).unwrap();
    let summary = pool.install(|| sweep.run(&out, None, |_| {})).unwrap();
    (read(&out).unwrap(), summary)
}

fn numbers<'t>(table: &'t Table, name: &str) -> &'t [f64] {
    match table.column(name) {
        Some(Column::Number(cells)) => cells,
        other => panic!("{name}: {other:?}"),
    }
}

fn refusal(document: &str) -> String {
    Sweep::new(document, Path::new("")).map(|_| ()).unwrap_err().to_string()
}

#[test]
fn the_number_of_threads_does_not_show() {
    let document = format!("{HEAD}[seal]\nhalf_width_m = {{ normal = [0.005, 0.0005] }}\n");
    let ((one, _), (three, _)) = (table(&document, 1), table(&document, 3));
    assert_eq!(one.rows(), 150);
    // Compared as text: a missing number (NaN) is not equal to itself.
    assert!(format!("{one:?}") == format!("{three:?}"));
    let (again, _) = table(&document.replace("seed = 7", "seed = 8"), 3);
    assert_ne!(numbers(&one, "half_width_m"), numbers(&again, "half_width_m"));
}

#[test]
fn more_runs_keep_the_rows_there_were() {
    let document = format!("{HEAD}[seal]\nhalf_width_m = {{ uniform = [0.004, 0.006] }}\n");
    let ((few, _), (more, _)) = (table(&document, 2), table(&document.replace("150", "300"), 2));
    assert_eq!(numbers(&few, "work_j"), &numbers(&more, "work_j")[..150]);
}

#[test]
fn draws_have_the_distribution_asked_for() {
    let document = "runs = 4000\n[motion]\nprotocol = \"step\"\n[seal]\n\
        half_width_m = { uniform = [0.004, 0.006] }\n\
        insertion_coulomb_force_n = { normal = [3.0, 0.2] }\n\
        withdrawal_coulomb_force_n = { lognormal = [3.0, 0.1] }\n\
        insertion_viscous_damping_n_s_m = { triangular = [0.0, 2.0, 10.0] }\n\
        withdrawal_viscous_damping_n_s_m = { list = [1.0, 2.0, 6.0] }\n";
    let (table, _) = table(document, 2);
    /// Standard errors of a mean that a correct sample of 4000 does not exceed.
    const FAR: f64 = 5.0;
    let about = |name: &str, mean: f64, deviation: f64| {
        let values = numbers(&table, name);
        let found = values.iter().sum::<f64>() / values.len() as f64;
        assert!(
            (found - mean).abs() < FAR * deviation / 4000_f64.sqrt(),
            "{name}: {found} for {mean}"
        );
    };
    about("half_width_m", 0.005, 0.002 / 12_f64.sqrt());
    about("insertion_coulomb_force_n", 3.0, 0.2);
    about("withdrawal_coulomb_force_n", 3.0 * 0.005_f64.exp(), 0.31);
    about("insertion_viscous_damping_n_s_m", 4.0, 2.2);
    about("withdrawal_viscous_damping_n_s_m", 3.0, 2.2);
}

#[test]
fn grids_are_combined_and_relative_numbers_are_multiples() {
    let document = "runs = 2\n[motion]\nprotocol = \"step\"\n[seal]\n\
        half_width_m = { grid = [0.5, 1.0, 2.0], relative = true }\n\
        seal_damping_n_s_m = { grid = [0.0, 1.0] }\n";
    let (table, _) = table(document, 2);
    let widths = numbers(&table, "half_width_m");
    assert_eq!(table.rows(), 12);
    assert_eq!(widths[4] / widths[0], 2.0);
    assert_eq!(widths[8] / widths[0], 4.0);
    let damping = numbers(&table, "seal_damping_n_s_m");
    assert_eq!(&damping[..6], [0.0, 0.0, 1.0, 1.0, 0.0, 0.0]);
}

#[test]
fn results_follow_the_parameters() {
    let document = "[motion]\nprotocol = \"validation\"\n[seal]\n\
        insertion_coulomb_force_n = { grid = [2.0, 3.0, 4.0] }\n\
        insertion_viscous_damping_n_s_m = 0\nwithdrawal_viscous_damping_n_s_m = 0\n\
        withdrawal_coulomb_force_n = 2\n";
    let (table, _) = table(document, 1);
    // Friction independent of speed: the sliding force is the maximum force.
    for (peak, force) in numbers(&table, "peak_force_n").iter().zip([2.0, 3.0, 4.0]) {
        assert!((peak - force).abs() < 1e-9, "{peak} N for {force} N");
    }
    for name in ["work_j", "rms_force_n", "work_per_metre_n"] {
        let values = numbers(&table, name);
        assert!(values[0] < values[1] && values[1] < values[2], "{name}: {values:?}");
    }
    let per_metre = numbers(&table, "work_per_metre_n");
    assert!(
        per_metre[0] > 1.0 && per_metre[0] < 2.0,
        "never more than the sliding force: {per_metre:?}"
    );
    assert!(numbers(&table, "deforming_share").iter().all(|share| *share > 0.0 && *share < 1.0));
}

#[test]
fn a_rig_of_its_own_for_each_run() {
    let document = "runs = 2\n[motion]\nprotocol = \"step\"\n[rig]\n\"rod.mass_kg\" = { grid = [0.02, 0.2] }\n";
    let (table, summary) = table(document, 2);
    assert_eq!((table.rows(), summary.failed), (4, 0));
    let error = numbers(&table, "rms_error_n");
    assert!(error[2] > error[0], "the sensor feels the rod: {error:?}");
    assert_ne!(error[0], error[1], "every run has noise of its own");
}

#[test]
fn a_run_without_a_model_is_a_row_with_its_reason() {
    let document = format!("{HEAD}[seal]\nhalf_width_m = {{ normal = [0.001, 0.001] }}\n");
    let (table, summary) = table(&document, 2);
    let Some(Column::Text(failures)) = table.column("failure") else { panic!("no failures") };
    let failed = failures.iter().flatten().count() as u64;
    assert!(failed > 0 && failed == summary.failed);
    let peaks = numbers(&table, "peak_force_n");
    assert!(failures.iter().zip(peaks).all(|(failure, peak)| failure.is_some() == peak.is_nan()));
    assert!(
        summary
            .first_failure
            .is_some_and(|why| why.contains("half_width_m must be finite and above 0 m"))
    );
}

#[test]
fn a_recording_is_compared_with_and_traces_are_written() {
    let folder = tempfile::tempdir().unwrap();
    let rows: String = (0..400)
        .map(|k| format!("{},{},1.5\n", f64::from(k) * 1e-3, f64::from(k) * 1e-4))
        .collect();
    std::fs::write(folder.path().join("motion.csv"), format!("time_s,position_m,force_n\n{rows}"))
        .unwrap();
    let document = "runs = 3\n[motion]\nfile = \"motion.csv\"\n[seal]\nhalf_width_m = { uniform = [0.004, 0.006] }\n";
    let sweep = Sweep::new(document, folder.path()).unwrap();
    let out = folder.path().join("table.parquet");
    sweep.run(&out, Some(folder.path()), |_| {}).unwrap();
    let summary = read(&out).unwrap();
    for run in 0..3 {
        let trace = read(folder.path().join(format!("run_{run:09}.parquet"))).unwrap();
        let forces = numbers(&trace, "force_n");
        assert_eq!(forces.len(), 400);
        let error = (forces.iter().map(|force| (1.5 - force).powi(2)).sum::<f64>() / 400.0).sqrt();
        assert!((error - numbers(&summary, "rms_error_n")[run]).abs() < 1e-12, "run {run}");
        let peak = forces.iter().fold(0.0, |peak: f64, force| peak.max(force.abs()));
        assert_eq!(peak, numbers(&summary, "peak_force_n")[run]);
    }
}

#[test]
fn a_sweep_that_is_cancelled_writes_no_more_traces() {
    const THREADS: usize = 2;
    let shared = "runs = 100000\n[motion]\nprotocol = \"step\"\n[seal]\nhalf_width_m = { uniform = [0.004, 0.006] }\n";
    let rigs =
        "runs = 100000\n[motion]\nprotocol = \"validation\"\n[rig]\n\"rod.mass_kg\" = 0.05\n";
    for document in [shared, rigs] {
        let folder = tempfile::tempdir().unwrap();
        let count = || std::fs::read_dir(folder.path()).unwrap().count();
        let sweep = Sweep::new(document, Path::new("")).unwrap();
        let cancel = Cancel::default();
        let (written, outcome) = std::thread::scope(|scope| {
            let (flag, path, sweep) = (cancel.clone(), folder.path(), &sweep);
            let work = move || flag.run(THREADS, || sweep.each(Some(path), |_, _| Ok(())).is_ok());
            let worker = scope.spawn(work);
            while count() < 3 && !worker.is_finished() {
                std::thread::sleep(Duration::from_millis(1));
            }
            cancel.cancel();
            (count(), worker.join().unwrap())
        });
        assert!(matches!(outcome, Err(Stopped::Cancelled)));
        // Runs in progress, one per thread, are completed.
        assert!(count() <= written + THREADS, "{} files after {written}", count());
    }
}

#[test]
fn the_example_is_a_sweep() {
    let sweep = Sweep::new(trocar::sweep::config::EXAMPLE_TOML, Path::new("")).unwrap();
    assert_eq!(sweep.rows(), 1000);
}

#[test]
fn faults_are_told_with_their_place() {
    let seal = |line: &str| refusal(&format!("[motion]\nprotocol = \"step\"\n[seal]\n{line}\n"));
    let cases = [
        (seal("half_width_mm = 3"), "line 4: [seal] has no \"half_width_mm\""),
        (
            seal("half_width_m = { uniform = [2, 1] }"),
            "line 4: half_width_m: expected the lower number first",
        ),
        (
            seal("half_width_m = { normal = [2, -1] }"),
            "line 4: half_width_m: expected a standard deviation",
        ),
        (seal("half_width_m = { list = [] }"), "line 4: half_width_m: expected one number or more"),
        (
            seal("half_width_m = { uniform = [nan, 1] }"),
            "line 4: half_width_m: expected finite numbers",
        ),
        (seal("half_width_m = { gauss = [1, 1] }"), "unknown field `gauss`"),
        (seal("half_width_m = { relative = true }"), "expected one of uniform"),
        (seal("half_width_m = \"wide\""), "expected a number or a form"),
        (refusal("rums = 3\n[motion]\nprotocol = \"step\"\n"), "unknown field `rums`"),
        (refusal("runs = 0\n[motion]\nprotocol = \"step\"\n"), "line 1: runs must be 1 or more"),
        (refusal("[motion]\n"), "none of protocol, file and teleop"),
        (refusal("[motion]\nprotocol = \"fast\"\n"), "unknown protocol \"fast\""),
        (refusal("[motion]\nprotocol = \"step\"\nfile = \"a.csv\"\n"), "exclude each other"),
        (refusal("[motion]\nfile = \"nowhere.csv\"\n"), "nowhere.csv"),
        (refusal("model = \"nowhere.json\"\n[motion]\nprotocol = \"step\"\n"), "nowhere.json"),
        (
            refusal("[motion]\nprotocol = \"step\"\n[rig]\n\"rod.mas_kg\" = 1\n"),
            "line 4: [rig] has no number \"rod.mas_kg\"",
        ),
        (
            refusal("runs = 9000000000\n[motion]\nprotocol = \"step\"\n"),
            "more than 1000000000 rows",
        ),
    ];
    for (found, wanted) in cases {
        assert!(found.contains(wanted), "{found}\nwithout: {wanted}");
    }
}

const LOOP: &str = "runs = 1\n[motion]\nteleop = \"default\"\n[teleop]\n\
    \"motion.duration_s\" = 2.0\n\
    \"tissue.stiffness_n_m\" = 50.0\n\
    \"compensation.fraction\" = { grid = [0.0, 0.5, 1.0] }\n";

#[test]
fn a_row_of_a_loop_is_what_the_loop_gives() {
    let folder = tempfile::tempdir().unwrap();
    let (out, traces) = (folder.path().join("table.parquet"), folder.path());
    let sweep = Sweep::new(LOOP, Path::new("")).unwrap();
    let summary = sweep.run(&out, Some(traces), |_| {}).unwrap();
    assert_eq!((summary.rows, summary.failed), (3, 0));
    let table = read(&out).unwrap();
    let trocar = ModelFile::plausible_10_5_mm().unwrap().trocar;
    for (row, fraction) in [0.0, 0.5, 1.0].into_iter().enumerate() {
        let mut config = Config::default();
        config.motion.duration_s = 2.0;
        config.tissue.stiffness_n_m = 50.0;
        config.compensation.fraction = fraction;
        let own = Outcome::of(&config, [&trocar, &trocar]).unwrap();
        let figures = own.figures.unwrap();
        assert_eq!(numbers(&table, "settles")[row], 1.0);
        assert_eq!(numbers(&table, "force_error_rms_n")[row], figures.force_error_rms_n);
        let displayed = numbers(&table, "displayed_stiffness_n_m")[row];
        assert_eq!(displayed, figures.displayed_stiffness_n_m.unwrap());
        let trace = read(traces.join(format!("run_{row:09}.parquet"))).unwrap();
        let slave: Vec<f64> = own.course.unwrap().iter().map(|s| s.slave_position).collect();
        assert_eq!(numbers(&trace, "slave_position_m"), slave);
    }
}

#[test]
fn a_loop_that_is_unstable_is_a_row_without_figures() {
    let unstable = LOOP.replace("[teleop]\n", "[teleop]\n\"channel.delay_s\" = 0.01\n");
    let (table, summary) = table(&unstable.replace("50.0", "400.0"), 2);
    assert_eq!(summary.failed, 0);
    assert_eq!(numbers(&table, "settles"), [0.0, 0.0, 1.0]);
    let errors = numbers(&table, "force_error_rms_n");
    assert!(errors[0].is_nan() && errors[1].is_nan() && errors[2] > 0.0, "{errors:?}");
}

#[test]
fn seals_of_loops_vary_while_the_compensator_keeps_its_model() {
    let seal = "[seal]\ninsertion_coulomb_force_n = { grid = [0.8, 1.0, 1.2], relative = true }\n\
        withdrawal_coulomb_force_n = { list = [1.0], relative = true }\n";
    let document = LOOP.replace("{ grid = [0.0, 0.5, 1.0] }", "1.0") + seal;
    let ((one, _), (three, _)) = (table(&document, 1), table(&document, 3));
    assert!(format!("{one:?}") == format!("{three:?}"));
    let errors = numbers(&one, "force_error_rms_n");
    assert!(errors[1] < 0.2 * errors[0] && errors[1] < 0.2 * errors[2], "{errors:?}");
}

#[test]
fn faults_of_loops_are_told_with_their_place() {
    for (from, to, wanted) in [
        (
            "tissue.stiffness_n_m",
            "tissue.stiffnes",
            "line 6: [teleop] has no number \"tissue.stiffnes\"",
        ),
        ("\"default\"", "\"none.toml\"", "none.toml: cannot read the document"),
        (
            "teleop = \"default\"",
            "protocol = \"step\"",
            "[teleop] changes a loop, and none is given",
        ),
        ("\"motion.duration_s\" = 2.0", "seed = 3", "seed: expected no value: each run has a seed"),
        (
            "{ grid = [0.0, 0.5, 1.0] }",
            "{ uniform = [0.5, 1.5], relative = true }",
            "it is 0, and so is",
        ),
        ("[teleop]\n", "file = \"motion.csv\"\n[teleop]\n", "exclude each other"),
        ("[teleop]\n", "rig = \"rig.toml\"\n[teleop]\n", "neither a file nor a loop"),
    ] {
        assert!(LOOP.contains(from));
        let refused = refusal(&LOOP.replacen(from, to, 1));
        assert!(refused.contains(wanted), "{refused}");
    }
    let (table, summary) = table(&LOOP.replace("= 50.0", "= { list = [-1.0] }"), 1);
    assert_eq!((table.rows(), summary.failed), (3, 3));
    assert!(summary.first_failure.unwrap().contains("tissue.stiffness_n_m must be"));
}
