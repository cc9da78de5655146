//! Simulation of a motion as a stream, and output that is complete or absent.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use trocar::output::{AtomicFile, StagedFolder, remove_unfinished};
use trocar::recording::{Choice, ReadOptions, read};

use trocar::simulate::{SimulateOptions, simulate_file};
use trocar_model::{
    Classical, DeformationForce, Element, ElementParams, SlidingFriction, StaticFriction, Trocar,
};

const OPTIONS: SimulateOptions =
    SimulateOptions { initial_deflection: None, offset: 0.0, filter: None };

/// A seal that is a spring of 1 kN/m up to its static force of 10 N, so that a row can be checked
/// by hand.
fn spring() -> Trocar {
    let deformation = DeformationForce::linear(1e3, 0.01).unwrap();
    let friction = SlidingFriction::coulomb(10.0, 0.0);
    let params =
        ElementParams { deformation, insertion: friction, withdrawal: friction, ..plausible() };
    Trocar::of_seal(Element::new(params).unwrap())
}

fn plausible() -> ElementParams {
    ElementParams::plausible_10_5_mm().unwrap()
}

struct Scratch(tempfile::TempDir);

impl Scratch {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn motion(&self, text: &str) -> PathBuf {
        std::fs::write(self.path("motion.csv"), text).unwrap();
        self.path("motion.csv")
    }

    /// All files in the folder except the motion, including hidden ones.
    fn leftovers(&self) -> Vec<String> {
        let names =
            std::fs::read_dir(self.0.path()).unwrap().map(|entry| entry.unwrap().file_name());
        names.map(|name| name.into_string().unwrap()).filter(|name| name != "motion.csv").collect()
    }
}

/// Simulates the spring along a motion given as text; the error as text if there is one.
fn run(scratch: &Scratch, text: &str, columns: Option<&str>) -> Result<String, String> {
    let output = scratch.path("out.csv");
    let choice = Choice { columns: columns.map(str::to_owned), ..Choice::default() };
    let outcome = simulate_file(
        &scratch.motion(text),
        &choice,
        &spring(),
        None,
        &OPTIONS,
        &output,
        |_, _| (),
    );
    outcome.map(|_| std::fs::read_to_string(&output).unwrap()).map_err(|error| error.to_string())
}

#[test]
fn every_row_gives_one_row_with_the_named_columns() {
    let text = "time_s,position_mm,note\n0.5,20,a\n0.6,25,b\n0.6,25,b\n0.7,32,c\n";
    let out = run(&Scratch::new(), text, None).unwrap();
    let expected = "time_s,position_m,force_n,deflection_m,mode\n\
        0.5,0.02,0.0,0.0,deforming\n\
        0.6,0.025,5.0,0.005,deforming\n\
        0.6,0.025,5.0,0.005,deforming\n\
        0.7,0.032,10.0,0.01,sliding\n";
    let rounded: String = out.lines().fold(String::new(), |mut all, line| {
        let cells = line
            .split(',')
            .map(|cell| cell.parse::<f64>().map_or(cell.into(), |x| format!("{:?}", round(x))));
        writeln!(all, "{}", cells.collect::<Vec<_>>().join(",")).unwrap();
        all
    });
    assert_eq!(rounded, expected);
}

#[test]
fn a_classical_model_gives_its_force_alone_and_starts_with_the_first_reading() {
    let scratch = Scratch::new();
    let text = "time_s,position_mm,force_n\n0,0,1.5\n1,0,9\n2,50,9\n3,0,9\n";
    let model = StaticFriction::new(SlidingFriction::coulomb(3.0, 5.0)).unwrap();
    let out = |text: &str| {
        let output = scratch.path("out.csv");
        let (trocar, choice) = (Trocar::of_seal(Classical::Static(model)), Choice::default());
        let options = SimulateOptions { offset: 0.5, ..OPTIONS };
        simulate_file(&scratch.motion(text), &choice, &trocar, None, &options, &output, |_, _| ())
            .unwrap();
        std::fs::read_to_string(&output).unwrap()
    };
    assert_eq!(
        out(text),
        "time_s,position_m,force_n\n0.0,0.0,1.0\n1.0,0.0,1.0\n2.0,0.05,3.25\n3.0,0.0,-3.25\n"
    );
    let without_force = text.replace(",force_n", "").replace(",1.5", "").replace(",9", "");
    assert!(
        out(&without_force)
            .starts_with("time_s,position_m,force_n\n0.0,0.0,0.0\n1.0,0.0,0.0\n2.0,0.05,3.25")
    );
}

fn round(x: f64) -> f64 {
    (x * 1e9).round() / 1e9
}

#[test]
fn the_output_is_a_recording_again() {
    let scratch = Scratch::new();
    let mut motion = String::from("t_ms;x_mm\n");
    for k in 0..2000 {
        writeln!(motion, "{k};{:.3}", 8.0 * (f64::from(k) * 5e-3).sin()).unwrap();
    }
    run(&scratch, &motion, None).unwrap();
    let recording = read(&scratch.path("out.csv"), &ReadOptions::default()).unwrap();
    assert_eq!(recording.len(), 2000);
    assert!(
        recording.position.iter().zip(&recording.force).all(|(x, f)| (f - 1e3 * x).abs() < 1e-9)
    );
}

#[test]
fn a_headerless_motion_needs_its_columns_named() {
    let scratch = Scratch::new();
    let text = "0.0 0.1 7\n0.1 0.2 7\n";
    let message = run(&scratch, text, None).unwrap_err();
    assert!(message.contains("motion.csv line 1") && message.contains("‹columns"), "{message}");
    assert_eq!(run(&scratch, text, Some("time_s,position_m,-")).unwrap().lines().count(), 3);
}

#[test]
fn a_bad_row_stops_the_replay_with_its_line_and_leaves_no_file() {
    for (row, essentials) in [
        ("0.3,nan", ["line 5", "position is empty or nan"]),
        (",0.1", ["line 5", "time is empty or nan"]),
        ("inf,0.1", ["line 5", "time is infinite"]),
        ("0.3,abc", ["line 5", "found 'abc' in column position_m"]),
        ("0.3", ["line 5", "found 1 fields, expected 2"]),
        ("0.05,0.1", ["line 5", "time goes back from 0.2 s to 0.05 s"]),
        ("0.2,0.1", ["line 5", "while time stays at 0.2 s"]),
        ("0.3,10.0", ["covers", "position_mm"]),
    ] {
        let scratch = Scratch::new();
        let text = format!("time_s,position_m\n0.0,0.0\n0.1,0.01\n0.2,0.02\n{row}\n0.4,0.04\n");
        let message = run(&scratch, &text, None).unwrap_err();
        assert!(message.contains("motion.csv"), "{message}");
        assert!(essentials.iter().all(|essential| message.contains(essential)), "{row}: {message}");
        assert_eq!(scratch.leftovers(), [""; 0], "{row}");
    }
}

#[test]
fn a_failed_replay_keeps_the_earlier_result() {
    let scratch = Scratch::new();
    let good = run(&scratch, "time_s,position_m\n0.0,0.0\n0.1,0.01\n", None).unwrap();
    run(&scratch, "time_s,position_m\n0.0,0.0\n0.1,?\n", None).unwrap_err();
    assert_eq!(std::fs::read_to_string(scratch.path("out.csv")).unwrap(), good);
    assert_eq!(scratch.leftovers(), ["out.csv"]);
}

#[test]
#[cfg(target_os = "linux")]
fn a_full_disk_is_reported_with_the_path() {
    let scratch = Scratch::new();
    let mut motion = String::from("time_s,position_m\n");
    (0..20_000).for_each(|k| writeln!(motion, "{k},{}", f64::from(k) * 1e-6).unwrap());
    let motion = scratch.motion(&motion);
    let outcome = simulate_file(
        &motion,
        &Choice::default(),
        &spring(),
        None,
        &OPTIONS,
        Path::new("/dev/full"),
        |_, _| (),
    );
    let message = outcome.unwrap_err().to_string();
    assert!(message.contains("/dev/full: cannot write") && message.contains("space"), "{message}");
}

#[test]
fn a_place_that_cannot_be_written_is_named() {
    let scratch = Scratch::new();
    let motion = scratch.motion("time_s,position_m\n0,0\n1,0\n");
    let missing = scratch.path("no/such/out.csv");
    let message =
        simulate_file(&motion, &Choice::default(), &spring(), None, &OPTIONS, &missing, |_, _| ());
    let message = message.unwrap_err().to_string();
    assert!(
        message.contains("no/such/out.csv: cannot create") && message.contains("hint: "),
        "{message}"
    );
    let folder = AtomicFile::create(scratch.0.path()).unwrap_err().to_string();
    assert!(folder.contains("directory"), "{folder}");
    let below_a_file = StagedFolder::create(motion.join("out")).unwrap_err().to_string();
    assert!(below_a_file.contains("motion.csv/out: cannot create"), "{below_a_file}");
}

#[test]
#[cfg(unix)]
fn a_finished_file_has_the_usual_permissions_and_links_stay_links() {
    use std::os::unix::fs::PermissionsExt;
    let scratch = Scratch::new();
    std::fs::write(scratch.path("plain"), "").unwrap();
    std::os::unix::fs::symlink(scratch.path("plain"), scratch.path("link")).unwrap();
    let usual = std::fs::metadata(scratch.path("plain")).unwrap().permissions().mode();
    let mut file = AtomicFile::create(scratch.path("link")).unwrap();
    file.write_all(b"new").unwrap();
    file.commit().unwrap();
    assert_eq!(std::fs::read_to_string(scratch.path("plain")).unwrap(), "new");
    assert_eq!(std::fs::metadata(scratch.path("plain")).unwrap().permissions().mode(), usual);
    assert!(std::fs::symlink_metadata(scratch.path("link")).unwrap().is_symlink());
}

#[test]
fn a_folder_appears_with_all_its_files_or_not_at_all() {
    let scratch = Scratch::new();
    let target = scratch.path("deep/out");
    let dropped = StagedFolder::create(&target).unwrap();
    dropped.write("model.json", b"{}").unwrap();
    drop(dropped);
    assert_eq!(scratch.leftovers(), [""; 0]);
    let staged = StagedFolder::create(&target).unwrap();
    staged.write("model.json", b"{}").unwrap();
    staged.write("figures/a.svg", b"<svg/>").unwrap();
    assert!(!target.exists());
    staged.commit().unwrap();
    assert_eq!(std::fs::read(target.join("figures/a.svg")).unwrap(), b"<svg/>");
    std::fs::write(target.join("notes.txt"), "mine").unwrap();
    let again = StagedFolder::create(&target).unwrap();
    again.write("model.json", b"{1}").unwrap();
    again.write("figures/b.svg", b"<svg/>").unwrap();
    assert_eq!(std::fs::read(target.join("model.json")).unwrap(), b"{}");
    again.commit().unwrap();
    assert_eq!(std::fs::read(target.join("model.json")).unwrap(), b"{1}");
    assert_eq!(std::fs::read(target.join("notes.txt")).unwrap(), b"mine");
    let mut names: Vec<_> =
        std::fs::read_dir(&target).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["figures", "model.json", "notes.txt"]);
}

/// In a separate process, because it removes the unfinished files of other tests.
#[test]
fn an_interruption_removes_what_is_unfinished() {
    const IN_CHILD: &str = "TROCAR_TEST_INTERRUPTED_FOLDER";
    const INTERRUPTED: i32 = 42;
    if let Some(folder) = std::env::var_os(IN_CHILD) {
        let folder = PathBuf::from(folder);
        let mut file = AtomicFile::create(folder.join("out.csv")).unwrap();
        file.write_all(b"half").unwrap();
        let staged = StagedFolder::create(folder.join("out")).unwrap();
        staged.write("model.json", b"{").unwrap();
        remove_unfinished();
        // Exits without running destructors, as a signal handler does.
        std::process::exit(INTERRUPTED);
    }
    let scratch = Scratch::new();
    let status = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "simulate::an_interruption_removes_what_is_unfinished"])
        .env(IN_CHILD, scratch.0.path())
        .output()
        .unwrap()
        .status;
    assert_eq!(status.code(), Some(INTERRUPTED), "the child ran another test or none");
    assert_eq!(scratch.leftovers(), [""; 0]);
}
