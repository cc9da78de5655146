//! What needs a process: exit codes, messages, pipes, interruption, and that nothing half-written
//! stays behind.

use std::fmt::Write as _;
use std::fs;
use std::io::Write as _;
use std::path::PathBuf;
use std::process::{Command, Stdio};

use trocar::model_file::VERSION;

use crate::common::{Place, Ran};

impl Place {
    fn text(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap()
    }

    fn put(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).unwrap();
    }

    /// A small rig: few speeds and short strokes, so that a test takes no time.
    fn rig(&self) -> &'static str {
        let speeds =
            "slowest_m_s = 0.02\nfastest_m_s = 0.08\nincrement_m_s = 0.02\nstroke_m = 0.06\n";
        self.put(
            "rig.toml",
            &format!("[protocol.steady]\n{speeds}\n[protocol.validation]\n{speeds}"),
        );
        "--rig rig.toml"
    }

    /// A recording that pins everything, as `name`.
    fn recording(&self, name: &str) {
        let rig = self.rig();
        self.run(&format!("bench steady {rig} --out {name}")).done();
    }

    /// The made-up seal as a model file.
    fn model(&self) -> &'static str {
        self.recording("for-model.csv");
        self.run("identify for-model.csv --moving-mass-kg 0.04 --out model").done();
        fs::rename(self.path("model/model.json"), self.path("model.json")).unwrap();
        fs::remove_dir_all(self.path("model")).unwrap();
        fs::remove_file(self.path("for-model.csv")).unwrap();
        "model.json"
    }
}

impl Ran {
    fn done(self) -> Self {
        self.ends_with(0)
    }

    /// Failed with one error that says all of `essentials`.
    fn fails_saying(self, essentials: &[&str]) -> Self {
        let ran = self.ends_with(1);
        ran.says(essentials);
        assert!(ran.stderr.contains("error: ") && ran.stdout.is_empty(), "{ran:#?}");
        ran
    }
}

/// A saw tooth of 50 mm strokes with a plausible force, changed row by row: (row, time, position,
/// force).
fn saw(change: impl Fn(usize, [f64; 3]) -> String) -> String {
    let mut text = String::from("time_s,position_m,force_n\n");
    for k in 0..4000 {
        let t = 1e-3 * k as f64;
        let phase = t % 2.0;
        let (position, sign) =
            if phase < 1.0 { (0.05 * phase, 1.0) } else { (0.05 * (2.0 - phase), -1.0) };
        let since_reversal = 0.05 * (phase % 1.0);
        let noise = 0.01 * ((k * 7919 % 101) as f64 / 50.0 - 1.0);
        let force = 2.0 * sign * (since_reversal / 0.003 - 1.0).min(1.0) + noise;
        let _ = writeln!(text, "{}", change(k, [t, position, force]));
    }
    text
}

fn row([time, position, force]: [f64; 3]) -> String {
    format!("{time:.3},{position:.6},{force:.4}")
}

#[test]
fn unreadable_recordings_are_refused_with_file_line_and_way_out() {
    let at = |line: usize, text: &'static str| {
        saw(move |k, values| if k + 2 == line { text.to_owned() } else { row(values) })
    };
    let cases = [
        ("empty", String::new(), vec!["empty.csv", "empty", "header"]),
        (
            "header",
            "time_s,position_m,force_n\n".into(),
            vec!["header.csv line 1", "without any row"],
        ),
        (
            "columns",
            at(1, "").replace("time_s,position_m", "a,b"),
            vec!["columns.csv line 1", "a, b", "hint:", "--columns"],
        ),
        (
            "text",
            at(700, "0.698,oops,1.0"),
            vec!["text.csv line 700", "'oops'", "position_m", "number"],
        ),
        ("back", at(900, "0.1,0.04,1.0"), vec!["back.csv line 900", "goes back", "0.1 s", "hint:"]),
        (
            "still",
            saw(|_, [_, x, f]| row([3.0, x, f])),
            vec!["still.csv line 2", "time stays at 3 s", "hint:"],
        ),
        (
            "one",
            "time_s,position_m,force_n\n0,0,0\n".into(),
            vec!["one.csv", "1 usable", "at least 8"],
        ),
        (
            "metres",
            saw(|_, [t, x, f]| row([t, 200.0 * x, f])),
            vec!["metres.csv", "10 m", "at most 2 m", "position_mm"],
        ),
        (
            "cut",
            at(4001, "3.999,0.0"),
            vec!["cut.csv line 4001", "2 fields", "expected 3", "cut off"],
        ),
    ];
    let place = Place::new();
    for (name, text, essentials) in cases {
        place.put(&format!("{name}.csv"), &text);
        place.run(&format!("identify {name}.csv --out result")).fails_saying(&essentials);
        assert!(!place.path("result").exists(), "{name}");
        fs::remove_file(place.path(&format!("{name}.csv"))).unwrap();
    }
    place.run("identify nowhere.csv --out result").fails_saying(&["nowhere.csv", "No such file"]);
    assert_eq!(place.names(), Vec::<String>::new(), "nothing is left behind");
}

#[test]
fn lost_data_are_reported_and_end_with_3() {
    let cases = [
        (
            "nan",
            saw(|k, v| if k == 1233 { "1.233,nan,1".into() } else { row(v) }),
            vec!["nan.csv", "line 1235", "left out"],
        ),
        (
            "saturated",
            saw(|_, [t, x, f]| row([t, x, f.clamp(-9.0, 1.5)])),
            vec!["saturated.csv", "stuck at 1.5 N", "hint:"],
        ),
    ];
    let place = Place::new();
    for (name, text, essentials) in cases {
        place.put(&format!("{name}.csv"), &text);
        let ran = place.run(&format!("--quiet identify {name}.csv --out result")).ends_with(3);
        ran.says(&essentials);
        assert!(place.path("result/summary.json").exists(), "{name}");
    }
}

#[test]
fn a_sensor_mounted_the_other_way_round_is_noticed_and_can_be_turned() {
    let place = Place::new();
    place.put("flipped.csv", &saw(|_, [t, x, f]| row([t, x, -f])));
    place.put("also.csv", &saw(|_, [t, x, f]| row([t, x, -f - 1e-3])));
    let ran = place.run("identify flipped.csv --validate also.csv --out result");
    ran.says(&[
        "warning: flipped.csv, also.csv: the force ",
        "opposes the motion",
        "hint:",
        "--flip-force",
    ]);
    assert_ne!(ran.code, Some(0));
    let json = place.run("inspect flipped.csv --json").stdout;
    serde_json::from_str::<serde_json::Value>(&json).unwrap();
    assert!(json.contains("use --flip-force if") && !json.contains('‹'), "{json}");
    let turned = place.run("identify flipped.csv --validate also.csv --flip-force --out result");
    assert!(!turned.stderr.contains("opposes"), "{turned:#?}");
    turned.says(&["note: flipped.csv, also.csv: sign of the force reversed"]);
}

#[test]
fn what_the_data_do_not_determine_is_reported_before_fitting_and_ends_with_3() {
    let place = Place::new();
    place.put("one-speed.csv", &saw(|_, values| row(values)));
    let ran = place.run("identify one-speed.csv --json --out result").ends_with(3);
    let (before, after) = ran.stderr.split_once("warning:").unwrap();
    assert!(before.contains("one speed: the viscous part cannot be distinguished"), "{before}");
    assert!(after.contains("viscous damping β") && after.contains("not determined"), "{after}");
    let summary: serde_json::Value = serde_json::from_str(&ran.stdout).unwrap();
    let damping = &summary["parameters"]["viscous_damping_n_s_m"];
    assert_eq!(damping["determined"], false);
    assert_eq!(damping["ci95"], serde_json::json!([null, null]));
    assert_eq!(ran.stdout, place.text("result/summary.json"));

    let text = saw(|_, values| row(values));
    let sliding: Vec<&str> = text.lines().take(1).chain(text.lines().skip(400).take(600)).collect();
    place.put("no-reversal.csv", &sliding.join("\n"));
    let ran = place.run("identify no-reversal.csv --out result").ends_with(3);
    ran.says(&[
        "no reversal",
        "in one direction only",
        "half width of the deformation c: not determined",
    ]);
}

#[test]
fn models_that_cannot_be_read_are_explained() {
    let place = Place::new();
    let model = place.text(place.model());
    let cases = [
        (
            "cut",
            model[..200].to_owned(),
            vec!["cut.json: line", "not JSON", "hint: a model is the model.json"],
        ),
        (
            "newer",
            model.replace(&format!("\"version\": {VERSION}"), "\"version\": 99"),
            vec!["newer.json", "another version", "hint: update"],
        ),
        ("other", "{}".to_owned(), vec!["other.json", "not a model", "format"]),
        (
            "key",
            model.replace("half_width_m", "half_width_mm"),
            vec!["key.json: line", "half_width_mm"],
        ),
    ];
    place.put("motion.csv", &saw(|_, values| row(values)));
    for (name, text, essentials) in cases {
        place.put(&format!("{name}.json"), &text);
        place.run(&format!("analyze {name}.json")).fails_saying(&essentials);
        place
            .run(&format!("simulate {name}.json motion.csv --out force.csv"))
            .fails_saying(&essentials);
        place.run(&format!("validate {name}.json motion.csv")).fails_saying(&essentials);
    }
    assert!(!place.path("force.csv").exists());
}

#[test]
fn bad_arguments_end_with_2() {
    let place = Place::new();
    place.put("saw.csv", &saw(|_, values| row(values)));
    for arguments in [
        "",
        "identify",
        "identify saw.csv",
        "identify saw.csv --out result --degrees 9,4",
        "identify saw.csv --out result --moving-mass-kg -1",
        "identify saw.csv --out result --moving-mass-kg nan",
        "identify saw.csv --out result --columns time_s,nonsense,force_n",
        "identify saw.csv --out result --offset-n inf",
        "identify saw.csv --out result --figure-7-deflection-mm nan",
        "identify saw.csv --out result --figure-9-speed-mm-s -80",
        "identify - --validate - --out result",
        "simulate model.json saw.csv",
        "bench sideways --out x.csv",
        "bench steady",
        "completions abacus",
    ] {
        let ran = place.run(arguments).ends_with(2);
        assert!(!ran.stderr.is_empty() && ran.stdout.is_empty(), "{ran:#?}");
    }
    assert_eq!(place.names(), ["saw.csv"]);
}

#[test]
fn places_that_cannot_be_written_are_refused_before_the_work() {
    let place = Place::new();
    place.put("saw.csv", &saw(|_, values| row(values)));
    place.put("file", "");
    for out in ["file", "file/result", "/proc/result"] {
        let ran = place.run(&format!("identify saw.csv --out {out}"));
        ran.fails_saying(&[out, "cannot create", "hint:", "--out"]);
    }
    place.run("bench step --out missing/step.csv").fails_saying(&[
        "missing/step.csv",
        "cannot create",
        "hint:",
    ]);
    assert_eq!(place.names(), ["file", "saw.csv"]);
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_an_error_and_not_a_success() {
    let place = Place::new();
    let model = place.model();
    place.put("saw.csv", &saw(|_, values| row(values)));
    place.run("bench step --out /dev/full").fails_saying(&["/dev/full", "No space left", "hint:"]);
    let ran = place.run(&format!("simulate {model} saw.csv --out /dev/full"));
    ran.fails_saying(&["/dev/full", "No space left"]);
    let full = fs::File::options().write(true).open("/dev/full").unwrap();
    let ran = place.command(&format!("analyze {model}")).stdout(full).output().unwrap();
    let ran = Ran::from(ran).ends_with(1);
    assert!(ran.stderr.contains("No space left"), "{ran:#?}");
}

#[cfg(unix)]
#[test]
fn an_interruption_leaves_nothing_half_written() {
    let place = Place::new();
    let model = place.model();
    let before = place.names();
    // A motion that never ends keeps the program in the middle of its work.
    let mut child = place
        .command(&format!("simulate {model} - --out force.csv"))
        .stdin(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut motion = child.stdin.take().unwrap();
    motion.write_all(saw(|_, values| row(values)).as_bytes()).unwrap();
    while !place.names().iter().any(|name| name.starts_with(".trocar-")) {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
    let ran = Ran::from(child.wait_with_output().unwrap());
    drop(motion);
    assert_eq!(ran.code, Some(130), "{ran:#?}");
    assert_eq!(place.names(), before);
}

#[test]
fn a_failed_replay_leaves_the_earlier_result_untouched() {
    let place = Place::new();
    let model = place.model();
    place.put("force.csv", "earlier\n");
    place.put(
        "broken.csv",
        &saw(|k, values| if k == 3000 { "3.0,x,1".into() } else { row(values) }),
    );
    place
        .run(&format!("simulate {model} broken.csv --out force.csv"))
        .fails_saying(&["broken.csv line 3002", "'x'"]);
    assert_eq!(place.text("force.csv"), "earlier\n");
    assert!(place.names().iter().all(|name| !name.starts_with('.')));
}

#[test]
fn motion_and_force_pass_through_pipes() {
    let place = Place::new();
    let model = place.model();
    place.put("saw.csv", &saw(|_, values| row(values)));
    place.run(&format!("simulate {model} saw.csv --out force.csv")).done();
    let piped = place.command(&format!("--quiet simulate {model} - --out -"));
    let piped = fed(piped, &place.path("saw.csv")).done();
    assert_eq!(piped.stdout, place.text("force.csv"));
    assert_eq!(piped.stderr, "");
    assert_eq!(piped.stdout.lines().count(), 4001);
    assert_eq!(piped.stdout.lines().next(), Some("time_s,position_m,force_n,deflection_m,mode"));
}

#[test]
fn the_start_is_taken_from_the_first_reading_or_as_given() {
    let place = Place::new();
    let model = place.model();
    place.put("saw.csv", &saw(|_, values| row(values)));
    let first = |place: &Place| place.text("force.csv").lines().nth(1).unwrap().to_owned();
    let run =
        |more: &str| place.run(&format!("simulate {model} saw.csv --out force.csv {more}")).done();
    run("").says(&["first reading", "deflection -"]);
    assert!(first(&place).split(',').nth(3).unwrap().starts_with("-0.00"), "{}", first(&place));
    run("--initial-deflection-mm 2");
    assert!(first(&place).ends_with(",0.002,deforming"), "{}", first(&place));
    let motion: String = place
        .text("saw.csv")
        .lines()
        .map(|line| line.rsplit_once(',').unwrap().0.to_owned() + "\n")
        .collect();
    place.put("saw.csv", &motion);
    run("").says(&["has no force"]);
    assert!(first(&place).ends_with(",0.0,deforming"), "{}", first(&place));
}

/// A push of 3 mm read in steps of 4 um, then a hold that flickers by one step.
fn flickering_hold() -> String {
    let reading =
        |k: i32| if k <= 300 { f64::from(k) * 2.5 } else { 750.0 + f64::from(k * 7919 % 3 - 1) };
    let rows =
        (0..1000).map(|k| format!("{:.3},{:.6}\n", 1e-3 * f64::from(k), 4e-6 * reading(k).round()));
    "time_s,position_m\n".to_owned() + &rows.collect::<String>()
}

#[test]
fn a_backlash_filter_silences_a_resting_encoder() {
    let place = Place::new();
    let model = place.model();
    place.put("hold.csv", &flickering_hold());
    let forces = |more: &str| {
        let ran = place.run(&format!("simulate {model} hold.csv --out force.csv {more}")).done();
        let text = place.text("force.csv");
        let forces: Vec<String> =
            text.lines().skip(1).map(|l| l.split(',').nth(2).unwrap().to_owned()).collect();
        (ran, forces)
    };
    let rests = |forces: &[String]| forces[400..].iter().all(|force| *force == forces[400]);
    let (plain, none, given, auto) = (
        forces(""),
        forces("--backlash-m 0"),
        forces("--backlash-m 6e-6"),
        forces("--backlash-m auto"),
    );
    assert_eq!(plain.1, none.1);
    assert!(!rests(&plain.1) && rests(&given.1));
    assert_eq!(given.1, auto.1);
    auto.0.says(&["backlash filter: 6.000 um", "resolution of 4.000 um"]);
    assert!(!plain.0.stderr.contains("filter"), "{:#?}", plain.0);
    let piped = place.command(&format!("--quiet simulate {model} - --backlash-m 6e-6 --out -"));
    let piped = fed(piped, &place.path("hold.csv")).done();
    assert!(piped.stdout.lines().skip(1).map(|l| l.split(',').nth(2).unwrap()).eq(given.1.iter()));
}

#[test]
fn an_automatic_backlash_needs_a_resolution() {
    let place = Place::new();
    let model = place.model();
    place.put("hold.csv", &flickering_hold());
    let stream = place.command(&format!("simulate {model} - --backlash-m auto --out -"));
    let refused = fed(stream, &place.path("hold.csv")).ends_with(2);
    refused.says(&["--backlash-m auto", "resolution", "stream", "hint:", "6e-6"]);
    let smooth = (0..100).map(|k| format!("{k},{:.17}\n", 0.01 * (0.1 * f64::from(k)).sin()));
    place.put("smooth.csv", &("time_s,position_m\n".to_owned() + &smooth.collect::<String>()));
    let refused = place
        .run(&format!("simulate {model} smooth.csv --backlash-m auto --out force.csv"))
        .ends_with(2);
    refused.says(&["smooth.csv", "no step", "hint:"]);
    for width in ["-0.001", "nan", "wide"] {
        place
            .run(&format!("simulate {model} hold.csv --backlash-m {width} --out force.csv"))
            .ends_with(2)
            .says(&["auto"]);
    }
    place
        .run(&format!("simulate {model} gone.csv --backlash-m auto --out force.csv"))
        .fails_saying(&["gone.csv"]);
    assert!(!place.path("force.csv").exists());
}

/// A run with a file as standard input.
fn fed(mut command: Command, file: &std::path::Path) -> Ran {
    Ran::from(command.stdin(fs::File::open(file).unwrap()).output().unwrap())
}

#[test]
fn a_reader_that_stops_early_is_no_error() {
    let place = Place::new();
    let model = place.model();
    place.recording("long.csv");
    let mut child = place
        .command(&format!("--quiet simulate {model} long.csv --out -"))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let ran = Ran::from(child.wait_with_output().unwrap()).done();
    assert_eq!(ran.stderr, "");
}

#[test]
fn equal_seeds_give_equal_bytes() {
    let place = Place::new();
    let rig = place.rig();
    for (name, seed) in [("a", 5), ("b", 5), ("c", 6)] {
        place
            .run(&format!(
                "bench steady {rig} --seed {seed} --out {name}.csv --truth-out {name}-truth.csv"
            ))
            .done();
    }
    assert_eq!(place.text("a.csv"), place.text("b.csv"));
    assert_eq!(place.text("a-truth.csv"), place.text("b-truth.csv"));
    assert_ne!(place.text("a.csv"), place.text("c.csv"));
    for out in ["one", "two"] {
        place.run(&format!("identify a.csv --validate c.csv --seed 3 --out {out}")).done();
    }
    for file in files(&place.path("one")) {
        let read = |folder: &str| fs::read(place.path(folder).join(&file)).unwrap();
        assert_eq!(read("one"), read("two"), "{}", file.display());
        let text = String::from_utf8_lossy(&read("one")).into_owned();
        assert!(
            !text.contains(place.0.path().to_str().unwrap()),
            "a path of this machine in {}",
            file.display()
        );
    }
}

/// Files below a folder, relative to it.
fn files(folder: &std::path::Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = PathBuf::from(path.file_name().unwrap());
        if path.is_dir() {
            found.extend(files(&path).into_iter().map(|inner| name.join(inner)));
        } else {
            found.push(name);
        }
    }
    found
}

/// A seal that was wetted before the validation: identified as asked for, but doubtful, and why.
#[test]
fn a_validation_that_contradicts_ends_with_3() {
    let place = Place::new();
    place.recording("dry.csv");
    let mut rig = place.text("rig.toml");
    rig.push_str("[lubrication]\nlevel = 0.7\nonset_s = 0.0\nspread_s = 0.0\n");
    place.put("wet.toml", &rig);
    place.run("bench validation --rig wet.toml --seed 9 --out wet.csv").done();
    let ran = place
        .run("identify dry.csv --validate wet.csv --moving-mass-kg 0.04 --json --out found")
        .ends_with(3);
    let essentials = [
        "wet.csv: validation error",
        "times the model's own error",
        "record such motion to identify from",
    ];
    ran.says(&essentials);
    place.run("identify dry.csv --moving-mass-kg 0.04 --out alone").done();
    place.run("validate alone wet.csv").ends_with(3).says(&["times the model's own error"]);
    let summary: serde_json::Value = serde_json::from_str(&ran.stdout).unwrap();
    assert_eq!(summary["doubtful"], true);
    let warnings = summary["warnings"].as_array().unwrap();
    let warning =
        warnings.iter().find(|warning| warning["subject"] == "wet.csv").expect("a warning");
    assert!(
        warning["doubtful"] == true && warning["message"].as_str().unwrap().contains(essentials[1]),
        "{warning}"
    );
    assert!(place.text("found/report.html").contains(essentials[2]));
    let model: serde_json::Value = serde_json::from_str(&place.text("found/model.json")).unwrap();
    let error = &model["force_error"];
    assert!(error["sliding_n"].as_f64().unwrap() > 0.5 && error["partial_n"].is_null(), "{error}");
}

/// Figures 7 and 9 show what is asked for, if it was recorded.
/// What a person reads first: how each file was read in one line, at most three notes, and the parameters
/// asked for before those of the rig and the joins.
#[test]
fn identify_says_little_and_the_essential_first() {
    let place = Place::new();
    place.recording("rec.csv");
    let renamed =
        place.text("rec.csv").replace("position_m", "Weg/m").replace("force_n", "Kraft/N");
    place.put("rec.csv", &renamed);
    let ran = place.run("identify rec.csv --moving-mass-kg 0.04 --out model").done();
    let of_file: Vec<&str> = ran.stderr.lines().filter(|line| line.contains("taken as")).collect();
    assert!(of_file.len() == 1 && of_file[0].contains("Kraft/N"), "{ran:#?}");
    let notes = ran.stderr.lines().filter(|line| line.starts_with("note: "));
    assert!(notes.count() <= 3, "{ran:#?}");
    let said = format!("{}{}", ran.stdout, ran.stderr);
    for silent in ["yield_stiffness", "no position profile", "1.01 times", "_n_s_m"] {
        assert!(!said.contains(silent), "{silent}: {ran:#?}");
    }
    let symbols = ["F_c ", "β ", "c ", "F_0 ", "a⁺ "].map(|symbol| format!(" {symbol}"));
    let places = symbols.map(|symbol| ran.stdout.find(&symbol).expect("a row"));
    assert!(places.is_sorted(), "{}", ran.stdout);
    let summary = place.text("model/summary.json");
    assert!(summary.contains("no_position_profile") && summary.contains("1.01 times"));
}

#[test]
fn the_seal_and_the_loop_that_come_with_the_program_have_names() {
    let place = Place::new();
    place.recording("rec.csv");
    place.run("simulate plausible rec.csv --out force.csv").done();
    assert_eq!(place.text("force.csv").lines().count(), place.text("rec.csv").lines().count());
    let ran = place.run("teleop dvrk --out loop");
    assert!(
        ran.stdout.starts_with("loop: dvrk, ") && ran.stdout.contains("in words: "),
        "{ran:#?}"
    );
    let page = place.text("loop/report.html");
    assert!(page.contains("dvrk, SHA-256") && page.contains("leader") && !page.contains("aster's"));
    // A folder of that name is the user's own.
    place.run("identify rec.csv --moving-mass-kg 0.04 --paper --out plausible");
    place.put("plausible/model.json", "{}");
    place.run("simulate plausible rec.csv --out force.csv").ends_with(2).says(&["model.json"]);
}

/// The force from which inertia is subtracted is the same in `identify`, `validate` and figures: a coarse
/// encoder is named once, and costs no accuracy of the validation.
#[test]
fn a_coarse_encoder_is_named_once_with_what_it_costs() {
    let place = Place::new();
    place.put("rig.toml", "[rig]\nsample_rate_hz = 2000.0\n[encoder]\nresolution_m = 50e-6\n");
    for protocol in ["dynamic", "validation"] {
        place.run(&format!("bench {protocol} --rig rig.toml --out {protocol}.csv"));
    }
    let ran = place
        .run("identify dynamic.csv --validate validation.csv --moving-mass-kg 0.04 --out seal");
    assert_eq!(ran.stderr.matches("50 µm is coarse").count(), 1, "{ran:#?}");
    let scores = place.run("validate seal validation.csv --moving-mass-kg 0.04 --json").stdout;
    let scores: serde_json::Value = serde_json::from_str(&scores).unwrap();
    let [rms, worst] =
        ["rms_n", "worst_n"].map(|key| scores["recordings"][0][key].as_f64().unwrap());
    assert!(rms < 0.05 && worst < 0.25, "{rms} N rms, {worst} N at worst");
}

/// What a paper takes over stands in the folder, with the numbers of the summary.
#[test]
fn a_result_has_its_parameters_as_tables_and_what_to_cite() {
    let place = Place::new();
    place.recording("rec.csv");
    place.run("identify rec.csv --moving-mass-kg 0.04 --paper --out seal");
    let summary: serde_json::Value =
        serde_json::from_str(&place.text("seal/summary.json")).unwrap();
    let (csv, tex) = (place.text("seal/table.csv"), place.text("seal/table.tex"));
    let own = &summary["parameters"]["coulomb_force_n"]["value"];
    assert!(
        csv.lines().nth(1).unwrap().starts_with(&format!("coulomb_force_n,\"F_c\",{own},")),
        "{csv}"
    );
    assert_eq!(csv.lines().count(), 1 + summary["parameters"].as_object().unwrap().len());
    let line = tex.lines().find(|line| line.contains("$\\beta $")).expect("the viscous damping");
    assert!(line.contains("$\\mathrm{N\\,s/m}$ \\\\") && tex.is_ascii(), "{tex}");
    assert_eq!(tex.matches(" & ").count(), 4 * tex.matches(" \\\\\n").count(), "{tex}");
    assert!(place.text("seal/citation.bib").contains(env!("CARGO_PKG_VERSION")));
}

#[test]
fn a_mass_in_grams_is_refused_by_every_verb() {
    let place = Place::new();
    place.recording("rec.csv");
    place.run("identify rec.csv --moving-mass-kg 0.04 --paper --out model");
    for verb in
        ["identify rec.csv --out other", "compare rec.csv --out other", "validate model rec.csv"]
    {
        let refused = place.run(&format!("{verb} --moving-mass-kg 40")).ends_with(2);
        refused.says(&[
            "--moving-mass-kg is 40 kg, whose inertia would range over",
            "--moving-mass-kg 0.04",
        ]);
    }
    assert!(!place.path("other").exists());
}

#[test]
fn figures_show_what_is_asked_for() {
    let place = Place::new();
    place.recording("strokes.csv");
    let identify = "identify strokes.csv --moving-mass-kg 0.04 --offset-n=-0.34";
    let chosen = "--figure-7-deflection-mm -5 --figure-7-deflection-mm 5 --figure-9-speed-mm-s 40";
    place.run(&format!("{identify} {chosen} --out found")).done();
    let report = place.text("found/report.html");
    assert!(
        report.contains("Force at two deflections")
            && report.contains("The cycles chosen are at 40 mm/s.")
    );
    let refused = place.run(&format!("{identify} --figure-9-speed-mm-s 300 --out none"));
    refused.fails_saying(&[
        "figure 9: no recorded stroke has a speed within 10 % of 300 mm/s; recorded are 40, 60, 80 mm/s",
    ]);
    let refused = place.run(&format!("{identify} --figure-7-deflection-mm 20 --out none"));
    refused.fails_saying(&["figure 7: the deflection 20 mm lies outside ±c"]);
    assert!(!place.path("none").exists());
}

#[test]
fn validation_names_the_recordings_as_given() {
    let place = Place::new();
    let model = place.model();
    fs::create_dir(place.path("held")).unwrap();
    let rig = place.rig();
    place.run(&format!("bench validation {rig} --seed 9 --out held/v.csv")).done();
    let ran = place.run(&format!("validate {model} held/v.csv --json")).done();
    let found: serde_json::Value = serde_json::from_str(&ran.stdout).unwrap();
    assert_eq!(found["recordings"][0]["path"], "held/v.csv");
    // The bench's noise is 0.025 N rms and its seal fluctuates by one percent.
    let rms = found["rms_n"].as_f64().unwrap();
    assert!((0.02..0.08).contains(&rms), "{rms}");
    let without_offset =
        place.run(&format!("validate {model} held/v.csv --json --offset-n 0")).ends_with(3);
    let found: serde_json::Value = serde_json::from_str(&without_offset.stdout).unwrap();
    assert!(
        (found["recordings"][0]["bias_n"].as_f64().unwrap() + 0.342).abs() < 0.05,
        "tare and weight: {found:#}"
    );
    let table = place.run(&format!("validate {model} held/v.csv")).done().stdout;
    assert!(table.contains("held/v.csv") && table.contains("fit %"), "{table}");
}

#[test]
fn an_analysis_is_data_and_ends_with_0() {
    let place = Place::new();
    let model = place.model();
    let ran = place.run(&format!("analyze {model}")).done();
    for essential in
        ["Proposition III.1", "Proposition III.2", "Proposition III.3", "mm/s", "Energy", "Step"]
    {
        assert!(ran.stdout.contains(essential), "{essential}");
    }
    let json: serde_json::Value =
        serde_json::from_str(&place.run(&format!("analyze {model} --json")).done().stdout).unwrap();
    assert_eq!(json["elements"][0]["steady_state"]["holds"], true);
    assert_eq!(json["cycle_work"]["holds"], true);
}

#[test]
fn the_demo_runs_the_whole_chain() {
    let place = Place::new();
    let ran = place.run("demo").done();
    assert!(ran.stdout.lines().count() <= 14, "{}", ran.stdout);
    assert!(ran.stdout.contains("truth") && ran.stdout.contains("Coulomb force"), "{}", ran.stdout);
    for name in [
        "model.json",
        "summary.json",
        "truth.json",
        "recordings/steady.csv",
        "recordings/surgeon.csv",
    ] {
        assert!(place.path("trocar-demo").join(name).exists(), "{name}");
    }
    assert_eq!(place.names(), ["trocar-demo"]);
    let summary: serde_json::Value =
        serde_json::from_str(&place.text("trocar-demo/summary.json")).unwrap();
    let rms = summary["validation"]["rms_n"].as_f64().unwrap();
    assert!(rms < 0.06, "{rms}");
    place.run("validate trocar-demo/model.json trocar-demo/recordings/validation.csv").done();
    place
        .run("simulate trocar-demo/truth.json trocar-demo/recordings/step.csv --out force.csv")
        .done();
}

/// What bash offers for the last of `words`, with the script in `completions.bash`, after the options
/// by which the script asks bash for more.
#[cfg(unix)]
fn offered(place: &Place, words: &[&str]) -> Vec<String> {
    let script = "source completions.bash; compopt() { printf '%s\\n' \"$*\"; }
        COMP_WORDS=(\"$@\"); COMP_CWORD=$(($# - 1))
        _trocar trocar \"${@: -1}\" \"${@: -2:1}\"; printf '%s\\n' \"${COMPREPLY[@]}\"";
    let mut bash = std::process::Command::new("bash");
    bash.current_dir(place.path("")).args(["-c", script, "bash"]).args(words);
    let text = String::from_utf8(bash.output().unwrap().stdout).unwrap();
    let mut lines: Vec<String> =
        text.lines().filter(|line| !line.is_empty()).map(str::to_owned).collect();
    lines.sort_unstable();
    lines
}

#[cfg(unix)]
#[test]
fn completions_offer_names_folders_and_files() {
    let place = Place::new();
    place.put("completions.bash", &place.run("completions bash").done().stdout);
    place.put("strokes.csv", "");
    std::fs::create_dir(place.path("studies")).unwrap();
    let last = |words: &[&str]| offered(&place, words);
    assert_eq!(last(&["trocar", "identify", "--without", "st"]), ["stribeck", "stribeck_exponent"]);
    assert_eq!(last(&["trocar", "compare", "--models", "lu"]), ["lugre", "lugre-rational"]);
    assert_eq!(last(&["trocar", "fleet", "x", "--depth", "f"]), ["full"]);
    assert_eq!(last(&["trocar", "identify", "--validate", "st"]), ["strokes.csv", "studies"]);
    // Bash adds the folders by itself.
    assert_eq!(last(&["trocar", "identify", "--out", "st"]), ["-o plusdirs"]);
    // A number is nobody's file name, and a list of columns names those of the recording.
    for option in ["--moving-mass-kg", "--columns"] {
        assert_eq!(last(&["trocar", "identify", option, "st"]), ["-o nospace", "st"]);
    }
}

#[test]
fn helpers_print_what_they_are_asked_for() {
    let place = Place::new();
    assert!(place.run("completions bash").done().stdout.contains("_trocar()"));
    assert!(place.run("man").done().stdout.contains(".TH trocar 1"));
    let index = place.run("man index").done().stdout;
    assert!(
        index.contains("\nI have a test bench:\nRecord, identify") && !index.contains(":::"),
        "{index}"
    );
    let page = place.run("man how-to/columns").done().stdout;
    assert!(!page.contains("setup") && page.contains("```console"), "{page}");
    assert!(page.starts_with("# ") && page.contains("--columns"), "{page}");
    place.run("man --out man").done();
    assert!(place.text("man/trocar-identify.1").contains("moving\\-mass\\-kg"));
    let config = place.run("bench --print-config").done().stdout;
    place.put("rig.toml", &config);
    let same = place.run("bench --print-config --rig rig.toml").done().stdout;
    assert!(same.contains("stroke_limit_m = 0.16"), "{same}");
    place.put("rig.toml", "[motor]\npeak_force_n = -1.0\n");
    place.run("bench step --rig rig.toml --out x.csv").fails_saying(&[
        "rig.toml: line 2",
        "peak_force_n",
        "-1",
    ]);
}

/// The columns of `name` under other names and in millimetres, with the sign of the force reversed.
fn as_a_logger_writes(place: &Place, name: &str) -> String {
    let rows = place.text(name).lines().skip(1).fold(String::new(), |mut text, line| {
        let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
        let _ = writeln!(text, "{},{},{}", cells[0], 1e3 * cells[1], -cells[cells.len() - 1]);
        text
    });
    format!("t,pos,Fz\n{rows}")
}

#[test]
fn recordings_for_a_model_are_read_like_its_own() {
    let place = Place::new();
    place.recording("plain.csv");
    place.put("logger.csv", &as_a_logger_writes(&place, "plain.csv"));
    let options = "--columns time_s=t,position_mm=pos,force_n=Fz --flip-force";
    let identify = format!("identify logger.csv {options} --moving-mass-kg 0.04 --out found");
    place.run(&identify).done();
    let said = "read like the recordings of the model, with --columns 'time_s=t,position_mm=pos,force_n=Fz' --flip-force";

    let given = place.run(&format!("validate found/model.json logger.csv {options}")).done();
    let remembered = place.run("validate found logger.csv").done();
    remembered.says(&[said]);
    assert_eq!(remembered.stdout, given.stdout);

    place.run("simulate found logger.csv --out simulated.csv").done().says(&[said]);
    place.run("compensate found logger.csv --out tissue.csv").done().says(&[said]);
    no_tissue_is_found(&place);
    // The sign is remembered where only the columns are named anew.
    let named = "--columns time_s=t,position_mm=pos,force_n=Fz";
    let again = place.run(&format!("compensate found logger.csv {named} --out tissue.csv")).done();
    again.says(&["the force is reversed, as in the recordings of the model"]);
    no_tissue_is_found(&place);
    place.run("export c found/model.json --compensator --out seal.c").done();
    assert!(place.text("seal.h").contains("the observer reverses it"));
    place.run("export c found/model.json --compensator --flip-force=false --out seal.c").done();
    assert!(!place.text("seal.h").contains("the observer reverses it"));

    // A file of the same sensor with a header of its own, and one with neither.
    let own = place.text("logger.csv").replacen("t,pos,Fz", "time_s,position_mm,force_n", 1);
    place.put("own.csv", &own);
    place.run("validate found own.csv").says(&["read by its own header"]);
    place.put("other.csv", &place.text("logger.csv").replacen("t,pos,Fz", "a,b,c", 1));
    place
        .run("validate found other.csv")
        .fails_saying(&["other.csv line 1: no time, position or force column among 'a, b, c'"]);
    streams_for_a_model_are_read_like_files(&place);
    // One of the other sign is noticed.
    place.run("compensate found plain.csv --out tissue.csv").ends_with(3).says(&["opposite sign"]);
    // Options of one's own replace those of the model.
    let ran =
        place.run("validate found plain.csv --columns time_s=time_s,position_m=position_m,force_n=force_n").done();
    assert!(!ran.stderr.contains("read like"), "{ran:#?}");
}

/// The recording met none; readings of the other sign would be several N of it.
fn no_tissue_is_found(place: &Place) {
    let table = place.text("tissue.csv");
    let cells = table.lines().skip(1).map(|line| line.split(',').nth(4).unwrap());
    let forces: Vec<f64> = cells.map(|cell| cell.parse().unwrap()).collect();
    let squares: f64 = forces.iter().map(|force| force * force).sum();
    let rms = (squares / forces.len() as f64).sqrt();
    assert!(rms < 0.3, "{rms} N");
}

/// With the columns of the model's recordings and with a header of its own, from a pipe as from a file.
fn streams_for_a_model_are_read_like_files(place: &Place) {
    for verb in ["compensate", "simulate"] {
        for file in ["logger.csv", "own.csv"] {
            let ran = place.run(&format!("{verb} found {file} --out file.csv")).done();
            let stream =
                fed(place.command(&format!("{verb} found - --out stream.csv")), &place.path(file))
                    .done();
            assert_eq!(place.text("stream.csv"), place.text("file.csv"), "{verb} {file}");
            for ran in [ran, stream] {
                ran.says(&["read like the recordings of the model", "unless the file lacks them"]);
                let is_own = ran.stderr.contains("read by its own header");
                assert_eq!(is_own, file == "own.csv", "{ran:#?}");
            }
        }
        let ran = fed(
            place.command(&format!("{verb} found - --out stream.csv")),
            &place.path("other.csv"),
        );
        ran.fails_saying(&["line 1: no time", "column among 'a, b, c'"]);
    }
}

/// Gravity acts on the moving mass: alone it would change nothing.
#[test]
fn gravity_without_a_moving_mass_is_refused() {
    let place = Place::new();
    place.recording("rec.csv");
    fs::create_dir(place.path("many")).unwrap();
    fs::rename(place.path("rec.csv"), place.path("many/rec.csv")).unwrap();
    for verb in ["identify many/rec.csv", "compare many/rec.csv", "fleet many"] {
        for mass in ["", "--moving-mass-kg 0"] {
            let ran = place.run(&format!("{verb} {mass} --gravity-m-s2 -9.81 --out out"));
            ran.ends_with(2).says(&[
                "gravity_m_s2 is -9.81 m/s² without a moving mass on which it acts",
                "give moving_mass_kg above 0",
            ]);
            assert!(!place.path("out").exists(), "{verb}");
        }
    }
}

#[test]
fn a_folder_and_exchanged_arguments_are_recognised() {
    let place = Place::new();
    let model = place.model();
    place.recording("rec.csv");
    let ran = place.run(&format!("validate rec.csv {model}")).ends_with(2);
    ran.says(&[
        "rec.csv is no model, but model.json is",
        "give the model first: model.json rec.csv",
    ]);
    fs::create_dir(place.path("models")).unwrap();
    place
        .run("compensate models rec.csv --out out.csv")
        .ends_with(2)
        .says(&["models: a folder without model.json"]);
    fs::rename(place.path("model.json"), place.path("models/lugre.json")).unwrap();
    let ran = place.run("simulate models rec.csv --out out.csv").ends_with(2);
    ran.says(&["give one of its models: models/lugre.json"]);
}

/// `compensate`, `plan` and `teleop --advise` with the draws of the result `found`.
fn draws_are_taken_by_the_other_verbs(place: &Place) {
    let draws = "--posterior found/posterior.parquet";
    let compensate = "compensate found strokes.csv --no-adaptation --out";
    place.run(&format!("{compensate} plain.csv"));
    place.run(&format!("{compensate} drawn.csv {draws}"));
    let column = |file: &str, k: usize| -> Vec<String> {
        let cell = |line: &str| line.split(',').nth(k).unwrap().to_owned();
        place.text(file).lines().skip(1).map(cell).collect()
    };
    // tissue_force_n stays; tissue_force_std_n is another.
    assert_eq!(column("plain.csv", 4), column("drawn.csv", 4));
    assert_ne!(column("plain.csv", 5), column("drawn.csv", 5));

    place
        .run(&format!("plan --model found {draws} --duration-s 40 --out next.csv --report p.html"));
    assert!(place.text("p.html").contains("8 posterior draws of"));
    place.run(&format!("plan {draws} --out none.csv")).ends_with(2).says(&["--model"]);

    let advised = place.run(&format!("teleop --model found --advise {draws} --draws 6"));
    assert!(advised.stdout.contains("of the 7 pairs"), "{advised:#?}");
    place.run(&format!("teleop --model found {draws}")).ends_with(2).says(&["--advise"]);

    place
        .run(&format!("compensate plain.csv strokes.csv {draws} --out none.csv"))
        .fails_saying(&[]);
    assert!(!place.path("none.csv").exists());
}

#[test]
fn draws_of_identify_give_simulate_a_band_and_a_model_serves_as_prior() {
    let place = Place::new();
    place.recording("strokes.csv");
    let identify = "identify strokes.csv --moving-mass-kg 0.04";
    let ran = place.run(&format!("{identify} --posterior 2000 --out found")).done();
    assert!(ran.stdout.contains("2000 posterior draws of "), "{}", ran.stdout);
    let summary: serde_json::Value =
        serde_json::from_str(&place.text("found/summary.json")).unwrap();
    assert!(summary["posterior"]["r_hat"].as_f64().unwrap() <= 1.01, "{summary:#}");
    let along = "simulate found strokes.csv --posterior found/posterior.parquet --out band.csv";
    place.run(along).done();
    let text = place.text("band.csv");
    let mut lines = text.lines();
    let names = "time_s,position_m,force_n,deflection_m,mode,force_low_n,force_high_n";
    assert_eq!(lines.next(), Some(names));
    let inside = lines.filter(|line| {
        let cell = |k: usize| line.split(',').nth(k).unwrap().parse::<f64>().unwrap();
        cell(5) <= cell(2) && cell(2) <= cell(6)
    });
    let rows = text.lines().count() - 1;
    assert!(inside.count() > 9 * rows / 10, "the model lies in the band of its own draws");

    draws_are_taken_by_the_other_verbs(&place);

    // A few strokes, with that model as prior.
    let ran = place.run(&format!("{identify} --to-s 6 --prior found --out in-use"));
    assert!(ran.stdout.contains("prior: found"), "{ran:#?}");
    let summary: serde_json::Value =
        serde_json::from_str(&place.text("in-use/summary.json")).unwrap();
    assert_eq!(summary["prior"]["spread"], 0.3);

    place.run(&format!("{identify} --posterior 10 --out none")).ends_with(2).says(&["from 400"]);
    place
        .run("simulate found strokes.csv --posterior strokes.csv --out none.csv")
        .fails_saying(&["strokes.csv"]);
    assert!(!place.path("none").exists() && !place.path("none.csv").exists());
}

/// Sums of equal numbers are rounded, their course is not.
#[test]
fn a_constant_column_is_drawn_flat() {
    let place = Place::new();
    for (rows, value) in [(1000, 0.1), (3333, 0.3), (7777, -1.7), (20_000, 1e6 / 3.0)] {
        let text: String = (0..rows).map(|k| format!("{k},{value}\n")).collect();
        place.put("constant.csv", &format!("time_ms,constant\n{text}"));
        let shown = Ran::from(place.command("inspect constant.csv").output().unwrap()).stdout;
        let line = shown.lines().find(|line| line.trim_start().starts_with("constant ")).unwrap();
        let bars = line.chars().filter(|c| ('▁'..='█').contains(c));
        assert!(bars.clone().count() > 8 && bars.clone().all(|bar| bar == '▁'), "{line}");
    }
}
