//! Reading, checking and writing recordings.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use proptest::prelude::*;
use skipped::skipped;
use trocar_recording::{
    Choice, ReadOptions, Readings, Recording, Reset, RowList, WarningKind, local_acceleration,
    local_velocity, read,
};
use trocar_tables::option::{Interface, spelt};

#[path = "../../trocar-model/tests/common/skipped.rs"]
mod skipped;

/// Force noise in N of standard deviation 0.01, the same for every run.
fn noise(k: usize) -> f64 {
    let scrambled = (k as f64 * 12.9898).sin() * 43_758.545_3;
    0.035 * (scrambled - scrambled.floor() - 0.5)
}

/// Insertion and withdrawal over 20 mm at 1 kHz: position in m, force in N with the sign of the
/// motion.
fn cycle(k: usize) -> (f64, f64, f64) {
    let t = k as f64 * 1e-3;
    let phase = std::f64::consts::TAU * t;
    (t, 0.01 - 0.01 * phase.cos(), 2.0 * phase.sin() + noise(k))
}

fn rows(count: usize) -> Vec<String> {
    (0..count).map(cycle).map(|(t, x, f)| format!("{t:.3},{x:.6},{f:.4}")).collect()
}

const HEADER: &str = "time_s,position_m,force_n";

fn text(header: &str, rows: &[String]) -> String {
    let mut text = String::new();
    for line in std::iter::once(header).chain(rows.iter().map(String::as_str)) {
        writeln!(text, "{line}").unwrap();
    }
    text
}

struct Scratch(tempfile::TempDir);

impl Scratch {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn file(&self, contents: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.path().join("rec.csv");
        std::fs::write(&path, contents).unwrap();
        path
    }
}

fn read_text(contents: impl AsRef<[u8]>) -> Recording {
    read(&Scratch::new().file(contents), &ReadOptions::default()).unwrap_or_else(|e| panic!("{e}"))
}

fn message(contents: impl AsRef<[u8]>) -> String {
    message_with(contents, &ReadOptions::default())
}

fn message_with(contents: impl AsRef<[u8]>, options: &ReadOptions) -> String {
    let error = read(&Scratch::new().file(contents), options).expect_err("must be refused");
    spelt(&error.to_string(), Interface::CommandLine)
}

fn columns(mapping: &str) -> ReadOptions {
    ReadOptions { choice: Choice::columns(mapping), ..ReadOptions::default() }
}

/// The hint of its first warning.
fn way_out(recording: &Recording) -> String {
    let hint = recording.quality.warnings[0].hint.as_deref().unwrap();
    spelt(hint, Interface::CommandLine)
}

#[track_caller]
fn assert_says(message: &str, essentials: &[&str]) {
    for essential in essentials {
        assert!(message.contains(essential), "'{essential}' not in: {message}");
    }
}

fn kinds(recording: &Recording) -> Vec<WarningKind> {
    recording.quality.warnings.iter().map(|warning| warning.kind).collect()
}

fn replaced(line: usize, with: &str) -> String {
    let mut rows = rows(200);
    rows[line - 2] = with.into();
    text(HEADER, &rows)
}

#[test]
fn a_clean_file_gives_its_numbers_and_no_warning() {
    let recording = read_text(text(HEADER, &rows(2000)));
    assert_eq!(recording.len(), 2000);
    assert_eq!(recording.name, "rec.csv");
    assert_eq!(recording.sha256.len(), 64);
    assert_eq!(recording.time[1999], 1.999);
    assert!((recording.quality.median_interval - 1e-3).abs() < 1e-12);
    assert_eq!(recording.quality.warnings, []);
    assert!(recording.unbroken().eq(std::iter::once(0..2000)));
}

#[test]
fn the_same_recording_in_any_dress_gives_the_same_numbers() {
    let plain = read_text(text(HEADER, &rows(300)));
    let swap = |separator: &str| {
        rows(300).iter().map(|row| row.replace(',', separator)).collect::<Vec<_>>()
    };
    let millimetres: Vec<String> = (0..300)
        .map(|k| (k, plain.position[k] * 1e3, plain.force[k] * 1e3))
        .map(|(k, x, f)| format!("{k};{x:.3};{f:.1};ok").replace('.', ","))
        .collect();
    let quoted: Vec<String> =
        rows(300).iter().map(|row| format!("\"{}\"", row.replace(',', "\",\""))).collect();
    let dresses = [
        text("Time [s];Position (m);Force_N", &swap(";")),
        text("t_s\tx_m\tf_n", &swap("\t")),
        text("time_s | position_m | force_n", &swap(" | ")),
        text("time_s  position_m  force_n", &swap("   ")),
        text(HEADER, &swap(", ")),
        text("time,position,force\ns,m,N", &rows(300)),
        text("\"time, s\",\"position, m\",\"force, N\"", &quoted),
        text("t_ms;Position (mm);Force [mN];status", &millimetres),
        text("# made by a bench\n\n# time_s,position_m,force_n", &rows(300)),
        format!("\u{feff}{}", text(HEADER, &rows(300))),
        text(HEADER, &rows(300)).replace('\n', "\r\n"),
        text(HEADER, &rows(300)).trim_end().to_owned(),
    ];
    for dress in dresses {
        let recording = read_text(&dress);
        let head: String = dress.chars().take(60).collect();
        assert_eq!(recording.time, plain.time, "{head}");
        for (of, expected) in
            [(&recording.position, &plain.position), (&recording.force, &plain.force)]
        {
            // A number in mm is rounded once more than one in m.
            assert!(
                of.iter().zip(expected).all(|(a, b)| (a - b).abs() <= 2.0 * f64::EPSILON * b.abs()),
                "{head}"
            );
        }
    }
}

#[test]
fn columns_can_be_named_and_skipped() {
    let rows: Vec<String> = rows(100).iter().map(|row| format!("ok,{row}")).collect();
    let headerless = rows.join("\n");
    assert_says(&message(&headerless), &["rec.csv line 1", "no header", "--columns"]);
    let scratch = Scratch::new();
    let recording =
        read(&scratch.file(&headerless), &columns("-,time_s,position_m,force_n")).unwrap();
    assert_eq!(recording.len(), 100);
    let with_names = text("a,b,c,d", &rows);
    assert_says(
        &message(&with_names),
        &[
            "rec.csv line 1",
            "no time, position or force column",
            "a, b, c, d",
            "--columns 'time_s=b,position_m=c,force_n=d'",
        ],
    );
    let named =
        read(&scratch.file(&with_names), &columns("skip,time_s,position_m,force_n")).unwrap();
    assert_eq!(named.force, recording.force);
}

#[test]
fn columns_can_be_given_by_name_with_unit_and_sign() {
    let scratch = Scratch::new();
    let plain = read(&scratch.file(text(HEADER, &rows(100))), &ReadOptions::default()).unwrap();
    let odd = scratch.file(text("stamp_s,x,fz", &rows(100)));
    let found = read(&odd, &columns("time_s=stamp_s, position_mm=X, force_n=-fz")).unwrap();
    assert_eq!(found.time, plain.time);
    assert!(found.position.iter().zip(&plain.position).all(|(a, b)| (a - 1e-3 * b).abs() < 1e-15));
    assert!(found.force.iter().zip(&plain.force).all(|(a, b)| *a == -b));
    // Columns that are not named are found automatically, and a declared unit need not be repeated.
    let flipped =
        read(&scratch.file(text(HEADER, &rows(100))), &columns("force=-force_n")).unwrap();
    assert!(flipped.force.iter().zip(&plain.force).all(|(a, b)| *a == -b));
    assert_eq!(flipped.position, plain.position);
    for (mapping, essentials) in [
        ("position_m=depth", &["'depth'", "no column has", "time_s, position_m, force_n"][..]),
        ("position_m=position_m,force_n", &["'force_n'", "without '='"]),
        ("banana_m=position_m", &["'banana_m=position_m'", "not understood"]),
        ("force_n=force_n,force_mn=force_n", &["force more than once"]),
        ("position_m=position_m,force_n=position_m", &["'position_m'", "two quantities"]),
        ("force=time_s", &["force without a unit", "N, mN, uN"]),
        (
            "position_foo=position_m",
            &["'position_foo=position_m'", "not understood", "m, mm, cm, um, nm, dm, in"],
        ),
    ] {
        assert_says(&message_with(text(HEADER, &rows(20)), &columns(mapping)), essentials);
    }
    assert_says(
        &message_with(rows(20).join("\n"), &columns("force_n=x")),
        &["no header", "--columns"],
    );
}

#[test]
fn a_crop_counts_from_the_first_row() {
    let scratch = Scratch::new();
    let later: Vec<String> =
        (0..200).map(cycle).map(|(t, x, f)| format!("{:.3},{x:.6},{f:.4}", t + 1e3)).collect();
    let path = scratch.file(text(HEADER, &later));
    let cropped = |from, to| {
        let choice = Choice { from, to, ..Choice::default() };
        read(&path, &ReadOptions { choice, ..ReadOptions::default() })
    };
    let all = cropped(None, None).unwrap();
    let middle = cropped(Some(0.0495), Some(0.0995)).unwrap();
    assert_eq!(middle.time, all.time[50..100]);
    assert_eq!(middle.force, all.force[50..100]);
    assert_eq!(cropped(None, Some(0.0995)).unwrap().len(), 100);
    assert_eq!(middle.sha256, all.sha256, "the hash is that of the file");
    assert_says(
        &cropped(Some(5.0), None).unwrap_err().to_string(),
        &["found 0 usable samples", "from_s› to ‹to_s›, which count from the first row"],
    );
}

#[test]
fn a_wrong_mapping_is_explained() {
    for (mapping, essentials) in [
        ("time_s,position,force_n", &["--columns", "'position'", "without a unit"][..]),
        ("time_s,depth_foo,force_n", &["'depth_foo'", "m, mm, cm, um"]),
        (
            "time_s,position_m,force_v",
            &["'force_v' is a voltage", "calibration, as in force_n=22.2*U"],
        ),
        ("time_s,banana,force_n", &["'banana'", "not understood"]),
        ("time_s,force_n", &["position 0 times"]),
        ("time_s,position_m,force_n,force_n", &["force 2 times"]),
    ] {
        assert_says(&message_with(text(HEADER, &rows(20)), &columns(mapping)), essentials);
    }
}

#[test]
fn doubtful_headers_are_explained() {
    for (header, essentials) in [
        (
            "time_s,position,force_n",
            &["line 1", "'position' has no unit", "m, mm", "--columns"][..],
        ),
        ("time_s,position_m,status", &["no force column", "force_n"]),
        ("force_n,position_m,force_mn", &["no time column"]),
    ] {
        assert_says(&message(text(header, &rows(20))), essentials);
    }
    let rows: Vec<String> = rows(20).iter().map(|row| format!("{row},1")).collect();
    assert_says(
        &message(text("time_s,position_m,force_n,force_mn", &rows)),
        &["line 1", "could be 'force_n' or 'force_mn'", "--columns"],
    );
}

#[test]
fn every_unit_gives_the_same_recording() {
    let plain = read_text(text(HEADER, &rows(300)));
    let (lbf, gf, inch) = (4.4482216152605, 9.80665e-3, 25.4e-3);
    for (header, [per_time, per_position, per_force]) in [
        ("t_ms,position_in,force_lbf", [1e-3, inch, lbf]),
        ("stamp_ns,x (inch),F [lb]", [1e-9, inch, lbf]),
        ("time_us,depth (inches),load_kg", [1e-6, inch, 1e3 * gf]),
        ("time [µs],depth (mm),load (g)", [1e-6, 1e-3, gf]),
        ("time (min),depth (cm),load [kgf]", [60.0, 1e-2, 1e3 * gf]),
        ("elapsed_s,x_um,force_gf", [1.0, 1e-6, gf]),
        ("elapsed_s,x_m,force_ozf", [1.0, 1.0, lbf / 16.0]),
    ] {
        let row = |k: usize| {
            format!(
                "{},{},{}",
                plain.time[k] / per_time,
                plain.position[k] / per_position,
                plain.force[k] / per_force
            )
        };
        let found = read_text(text(header, &(0..300).map(row).collect::<Vec<_>>()));
        for (of, expected) in [
            (&found.time, &plain.time),
            (&found.position, &plain.position),
            (&found.force, &plain.force),
        ] {
            assert!(
                of.iter().zip(expected).all(|(a, b)| (a - b).abs() <= 1e-15 * b.abs()),
                "{header}"
            );
        }
    }
}

/// Volts and counts, with the calibration of their sensors in the choice of columns.
#[test]
fn a_column_may_have_a_factor() {
    let with = |columns: &str| {
        let rows = (0..20).map(|k| format!("{},{},{}\n", k, 250 * k, 0.5 * f64::from(k % 3)));
        let text = format!("t,counts,U [V]\n{}", rows.collect::<String>());
        let choice = Choice { columns: Some(columns.to_owned()), ..Choice::default() };
        read(&Scratch::new().file(text), &ReadOptions { choice, ..ReadOptions::default() })
    };
    let scaled = with("time_ms=t,position_mm=0.004*counts,force_n=-22.2*U [V]").unwrap();
    assert!((scaled.position[19] - 0.019).abs() < 1e-12, "{}", scaled.position[19]);
    assert!((scaled.force[1] + 11.1).abs() < 1e-12, "{}", scaled.force[1]);
    // As it is kept for the next file of this kind.
    assert_eq!(
        scaled.choice.columns.as_deref(),
        Some("time_ms=t,position_mm=0.004*counts,force_n=-22.2*U [V]")
    );
    for (columns, essential) in [
        ("time_ms=t,position_mm=counts,force_n=0*U [V]", "factor"),
        ("time_ms=t,position_mm=0.004*counts,force=2*U [V]", "to no unit"),
        ("time_ms=t,position_mm=0.004*counts,force_n=U [V]", "force_n=22.2*U"),
    ] {
        let message = with(columns).unwrap_err().to_string();
        assert!(message.contains(essential), "{columns}: {message}");
    }
}

/// A position that the recording computer made of a speed has no step of an encoder.
#[test]
fn a_constant_speed_is_no_step_of_an_encoder() {
    let of = |step: f64, speed: f64| {
        let strokes = (0..4000).map(|k: i32| f64::from((k % 1000 - 500).abs()) * 1e-3 * speed);
        let position = strokes.map(|x| if step > 0.0 { (x / step).round() * step } else { x });
        let time = (0..4000).map(|k| f64::from(k) * 1e-3).collect();
        let force = (0..4000).map(noise).collect();
        let recording = Recording::from_columns("speed", time, position.collect(), force);
        recording.unwrap().quality.position_resolution
    };
    for (step, speed, found) in
        [(0.0, 0.048, 0.0), (0.0, 0.072, 0.0), (4e-6, 0.0483, 4e-6), (4e-6, 0.0012, 4e-6)]
    {
        let seen = of(step, speed);
        assert!((seen - found).abs() < 1e-12, "{speed} m/s, step {step}: {seen}");
    }
}

/// A step that is no round decimal number is one, too: single counts are no jumps, and rows between
/// them hold no old position.
#[test]
fn the_step_of_an_encoder_may_be_any_number() {
    let time: Vec<f64> = (0..20_000).map(|k| f64::from(k) * 1e-3).collect();
    for step in [4.887_312_59e-6, 10.834_712_946e-6, 36.412_345_678_9e-6] {
        // Slow strokes, and digits as many as a double has.
        let counts = time.iter().map(|t| (0.03 * (1.0 - (0.7 * t).cos()) / step).round());
        let position: Vec<f64> = counts.map(|count| count * step).collect();
        let force = (0..20_000).map(noise).collect();
        let recording = Recording::from_columns("counts", time.clone(), position, force).unwrap();
        let quality = &recording.quality;
        let seen = quality.position_resolution;
        assert!((seen - step).abs() < 1e-6 * step, "step {step}: {seen}");
        assert_eq!((quality.resets.len(), &quality.warnings[..]), (0, &[][..]), "step {step}");
    }
}

#[test]
fn a_unit_that_is_not_known_is_never_taken_for_one_of_si() {
    for (header, essentials) in [
        ("time_s,position_m,force [foo]", &["'force [foo]'", "N, mN, uN, cN, daN, kN, dyn"][..]),
        ("time_s,position (foo),force_n", &["'position (foo)'", "um, nm, dm, in, ft, mil"]),
        ("time_s,position_kg,force_n", &["'position_kg'", "um, nm, dm, in, ft, mil"]),
        ("stamp_ticks,position_m,force_n", &["'stamp_ticks' is a count", "s, ms, us, ns, min, h"]),
        ("time,position,force\ns,foo,n", &["'position'", "um, nm, dm, in, ft, mil"]),
        ("time_s,position_m,F [V]", &["'F [V]' is a voltage", "multiply the voltage"]),
        ("time,position,force\ns,mm,V", &["'force' is a voltage", "multiply the voltage"]),
    ] {
        let message = message(text(header, &rows(20)));
        assert_says(&message, essentials);
        assert!(!message.contains("--columns"), "a guess of its unit: {message}");
    }
    // A meganewton is hardly meant, but it is asked.
    let message = message(text("time_s,position_m,force [MN]", &rows(20)));
    assert_eq!(proposed(&message), "force_mn=force [MN]");
}

/// The value of `--columns` that a message proposes, as a shell passes it on.
fn proposed(message: &str) -> String {
    let quoted =
        message.split_once("--columns '").unwrap_or_else(|| panic!("no option in: {message}")).1;
    let value = quoted.replace(r"'\''", "\u{1}").split('\'').next().unwrap().replace('\u{1}', "'");
    println!("{message}\n");
    value
}

fn scaled(time: f64, position: f64) -> Vec<String> {
    (0..300).map(cycle).map(|(t, x, f)| format!("{},{},{f:.4}", t * time, x * position)).collect()
}

#[test]
fn an_option_proposed_for_unclear_columns_works_as_it_is() {
    let plain = read_text(text(HEADER, &rows(300)));
    for (header, rows, option) in [
        ("time,pos,Fz", scaled(1.0, 1.0), "time_s=time,position_m=pos,force_n=Fz"),
        ("time,pos,Fz", scaled(1e3, 1e3), "time_ms=time,position_mm=pos,force_n=Fz"),
        ("ts,enc,cell", scaled(1e6, 1e6), "time_us=ts,position_um=enc,force_n=cell"),
        ("ticks,way,it's", scaled(1e9, 1e3), "time_ns=ticks,position_mm=way,force_n=it's"),
        ("time_s,position,force_n", scaled(1.0, 1e3), "position_mm=position"),
        ("a;b;\"c, raw\"", scaled(1.0, 1e3), "time_s=a,position_mm=b,force_n=\"c, raw\""),
    ] {
        let rows: Vec<String> = if header.contains(';') {
            rows.iter().map(|row| row.replace(',', ";")).collect()
        } else {
            rows
        };
        let contents = text(header, &rows);
        let message = message(&contents);
        assert_eq!(proposed(&message), option, "{message}");
        assert_says(&message, &["(guessed from the first rows: check the units)"]);
        let found = read(&Scratch::new().file(&contents), &columns(option))
            .unwrap_or_else(|e| panic!("{e}"));
        for (of, expected) in [
            (&found.time, &plain.time),
            (&found.position, &plain.position),
            (&found.force, &plain.force),
        ] {
            assert!(of.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{header}");
        }
    }
    // A file without names gets the other form.
    let contents = scaled(1e3, 1e3).join("\n");
    assert_says(
        &message(&contents),
        &["--columns time_ms,position_mm,force_n (guessed from the first rows"],
    );
}

#[test]
fn all_that_is_unclear_is_said_at_once() {
    let message = message(text(
        "when,pos,Fz,Fy",
        &rows(50).iter().map(|row| format!("{row},1")).collect::<Vec<_>>(),
    ));
    assert_says(
        &message,
        &[
            "line 1: no time or force column among 'when, pos, Fz, Fy', expected names such as time_s, force_n",
            "; column 'pos' has no unit that is understood for position, expected one of m, mm, cm, um, nm, dm, in, ft, mil",
            "hint: say which column is which, for example --columns 'time_s=when,position_m=pos,force_n=Fz'",
        ],
    );
}

#[test]
fn a_header_in_another_language_is_understood_by_its_units() {
    let plain = read_text(text(HEADER, &rows(300)));
    let millimetres: Vec<String> = (0..300)
        .map(|k| format!("{};{};{}", plain.time[k], 1e3 * plain.position[k], plain.force[k]))
        .collect();
    for header in ["Zeit [s];Weg [mm];Kraft [N]", "Zeit/s;s/mm;Fz_n", "Temps;Course;Effort\ns;mm;N"]
    {
        let found = read_text(text(header, &millimetres));
        assert_eq!(found.time, plain.time);
        assert_eq!(found.force, plain.force);
        assert!(found.position.iter().zip(&plain.position).all(|(a, b)| (a - b).abs() < 1e-15));
        assert_eq!(found.quality.notes.len(), 3, "{:?}", found.quality.notes);
        assert_says(
            &found.quality.notes.join("; "),
            &["taken as time, by its unit", "taken as position, by its unit"],
        );
    }
    // Two of a kind are never decided.
    let two: Vec<String> = rows(300).iter().map(|row| format!("{row},0.5")).collect();
    let contents = text("t_s,x_m,Fz_n,Fx_n", &two);
    let message = message(&contents);
    assert_says(
        &message,
        &["force could be 'Fz_n' or 'Fx_n', expected one", "--columns 'force_n=Fz_n'"],
    );
    let found = read(&Scratch::new().file(&contents), &columns(&proposed(&message))).unwrap();
    assert_eq!(found.force, plain.force);
}

#[test]
fn files_without_a_recording_are_explained() {
    assert_says(&message(""), &["rec.csv", "empty"]);
    assert_says(&message("\n# nothing\n"), &["rec.csv", "empty"]);
    assert_says(&message(format!("{HEADER}\n")), &["rec.csv line 1", "header without any row"]);
    assert_says(
        &message(text(HEADER, &rows(1))),
        &["rec.csv", "found 1 usable samples", "at least"],
    );
    assert_says(
        &message(text(HEADER, &vec!["0,1,nan".to_owned(); 9])),
        &["found 0 usable samples", "and 9 rows with an empty, NaN", "hint: `trocar inspect`"],
    );
    assert_says(&message([0_u8, 1, 2, 3]), &["binary data", "CSV"]);
    assert_says(
        &message([0xff_u8, 0xfe, b't', 0]),
        &[
            "rec.csv line 1",
            "no position or force column",
            "hint: no column is left that could be position or force: is it the right file",
        ],
    );
    let missing = read(Path::new("no/such.csv"), &ReadOptions::default()).unwrap_err().to_string();
    assert_says(&missing, &["no/such.csv", "cannot open"]);
    let folder = read(&std::env::temp_dir(), &ReadOptions::default()).unwrap_err().to_string();
    assert_says(&folder, &["cannot open", "directory"]);
    assert_says(&message("1".repeat(1 << 20)), &["line 1", "longer than"]);
}

/// The same numbers as [`rows`], with this separator.
fn same_as(plain: &Recording, contents: impl AsRef<[u8]>, options: &ReadOptions) -> Recording {
    let path = Scratch::new();
    let path = path.file(contents);
    let found = read(&path, options).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(found.time, plain.time);
    assert_eq!(found.position, plain.position);
    assert_eq!(found.force, plain.force);
    found
}

#[test]
fn lines_before_the_header_are_skipped() {
    let plain = read_text(text(HEADER, &rows(300)));
    let tabs: Vec<String> = rows(300).iter().map(|row| row.replace(',', "\t")).collect();
    let lvm = "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDate\t2026/11/22\n***End_of_Header***\t\n\t\n\
        Channels\t2\t\t\nSamples\t10\t10\t\nX0\t0.0\t0.0\t\n***End_of_Header***\t\t\t\n";
    let kept = |text: &str| text.to_owned();
    for (contents, lines) in [
        (kept(lvm) + &text("time_s\tposition_m\tforce_n", &tabs), 10),
        (kept(lvm) + &text("time_s\tposition_m\tforce_n\tComment", &tabs), 10),
        (kept("Operator: A. B.\nDate, 2026-11-22\n\n") + &text(HEADER, &rows(300)), 3),
        (kept("Rig;3\nSensor;ATI\n") + &text("Zeit;Weg;Kraft\ns;m;N", &tabs).replace('\t', ";"), 2),
        (kept("bench 4\n") + &text(HEADER, &rows(300)), 1),
    ] {
        let found = same_as(&plain, &contents, &ReadOptions::default());
        let plural = if lines == 1 { "line" } else { "lines" };
        assert_says(
            &found.quality.notes.join("; "),
            &[&format!("{lines} {plural} before the header skipped")],
        );
    }
    // Columns in order need no header.
    let headerless = kept("Rig;3\nSensor;ATI\n") + &tabs.join("\n").replace('\t', ";");
    assert_says(
        &message(&headerless),
        &["line 3: no header", "--columns time_s,position_m,force_n (guessed"],
    );
    same_as(&plain, &headerless, &columns("time_s,position_m,force_n"));
    // What looks like rows is skipped only if the caller says so.
    let odd = kept("1,2,3\n4,5,6\n") + &text(HEADER, &rows(300));
    assert_says(&message(&odd), &["line 1: no header"]);
    let skipping = |skip_rows| {
        let choice = Choice { skip_rows, ..Choice::default() };
        ReadOptions { choice, ..ReadOptions::default() }
    };
    same_as(&plain, &odd, &skipping(2));
    let titles = kept("time_s,operator,date\nA,B,C\n") + &text(HEADER, &rows(300));
    assert_says(&message(&titles), &["line 1", "no position or force column"]);
    let titles = kept("time_s,position_m,force_n\nA,B,C\n") + &text(HEADER, &rows(300));
    assert_says(
        &message(&titles),
        &["line 2: found 'A'", "hint: if the header is further below", "--skip-rows"],
    );
    same_as(&plain, &titles, &skipping(2));
    assert_says(&message_with(&odd, &skipping(500)), &["--skip-rows 500 leaves no line of 303"]);
}

#[test]
fn a_header_that_is_repeated_is_skipped_and_counted() {
    let plain = read_text(text(HEADER, &rows(300)));
    for (header, at) in [(HEADER, [102, 203]), ("time,position,force\ns,m,N", [103, 205])] {
        let mut lines = rows(300);
        lines.insert(200, header.to_owned());
        lines.insert(100, header.to_owned());
        let found = same_as(&plain, text(header, &lines), &ReadOptions::default());
        assert_eq!(kinds(&found), [WarningKind::Source]);
        let count = 2 * header.lines().count();
        let message = &found.quality.warnings[0].message;
        assert_says(
            message,
            &[&format!("{count} lines that repeat the header left out: lines {}", at[0])],
        );
        assert_says(message, &[&at[1].to_string()]);
    }
}

#[test]
fn results_at_the_end_are_left_out_and_counted() {
    let plain = read_text(text(HEADER, &rows(300)));
    let whole = text(HEADER, &rows(300));
    for (end, warning) in [
        (
            "\nMean,0.01,0\nRange,0.02,4\n",
            "2 lines of text at the end of the table left out: lines 303, 304",
        ),
        ("Test finished\n", "1 line of text at the end of the table left out: line 302"),
    ] {
        let found = same_as(&plain, whole.clone() + end, &ReadOptions::default());
        assert_eq!(found.quality.warnings[0].message, warning);
    }
    // Rows that follow, a reading that is text, and a row cut off are no results.
    assert_says(
        &message(&(whole.clone() + "Mean,0.01,0\n0.300,0.01,1\n")),
        &["line 302", "'Mean'"],
    );
    assert_says(&message(&(whole.clone() + "0.300,0.01,off\n")), &["line 302", "'off'"]);
    assert_says(&message(&(whole.clone() + "0.300,0.0")), &["line 302", "cut off"]);
    assert_says(&message(&(whole + &"Mean,0.01,0\n".repeat(80))), &["line 302", "'Mean'"]);
}

#[test]
fn missing_numbers_and_comments_of_other_programs_are_understood() {
    let gap = |cell: &str| {
        let mut lines = rows(300);
        lines[100] = format!("0.100,{cell},1.0");
        text(HEADER, &lines)
    };
    let plain = read_text(gap("nan"));
    assert_eq!(plain.quality.non_finite_rows.count, 1);
    for cell in ["", "NA", "N/A", "#N/A", "null", "None", "-", "<NA>"] {
        same_as(&plain, gap(cell), &ReadOptions::default());
    }
    let whole = read_text(text(HEADER, &rows(300)));
    for sign in ["%", "//", "#"] {
        let commented = format!("{sign} a trocar of 10 mm\n{}", text(HEADER, &rows(300)));
        same_as(&whole, commented, &ReadOptions::default());
        let names = format!("{sign} Test 1 2\n{sign} {}\n{}", HEADER, rows(300).join("\n"));
        same_as(&whole, names, &ReadOptions::default());
    }
}

/// An older program writes µ as one byte, which is no UTF-8.
#[test]
fn units_in_latin_1_are_never_taken_for_others() {
    let scaled = |row: &String| {
        let cells: Vec<f64> = row.split(',').map(|cell| cell.parse().unwrap()).collect();
        format!("{},{},{}", 1e6 * cells[0], 1e6 * cells[1], 1e3 * cells[2])
    };
    let lines: Vec<String> = rows(300).iter().map(scaled).collect();
    let mut bytes = b"Time (\xb5s),Position (\xb5m),Pr\xfcfkraft (mN)\n".to_vec();
    bytes.extend(lines.join("\n").into_bytes());
    let plain = read_text(text("Time (us),Position (um),Force (mN)", &lines));
    assert!((plain.time[299] - 0.299).abs() < 1e-12);
    let found = same_as(&plain, bytes, &ReadOptions::default());
    assert_says(&found.quality.notes.join("; "), &["'Prüfkraft (mN)' taken as force"]);
}

#[test]
fn columns_of_one_name_are_told_apart() {
    let double = |row: &String| format!("{row},0.1");
    let lines: Vec<String> = rows(300).iter().map(double).collect();
    let contents = text("time_s,position_m,force_n,force_n", &lines);
    assert_says(
        &message(&contents),
        &["'force_n#1' or 'force_n#2'", "--columns 'force_n=force_n#1'"],
    );
    let plain = read_text(text(HEADER, &rows(300)));
    same_as(&plain, &contents, &columns("force_n=force_n#1"));
    assert!(
        read(&Scratch::new().file(&contents), &columns("force_n=force_n#2"))
            .unwrap()
            .force
            .iter()
            .all(|f| *f == 0.1)
    );
    assert_says(
        &message_with(&contents, &columns("force_n=force_n")),
        &["the name of 2 columns, expected one of force_n#1, force_n#2"],
    );
}

#[test]
fn of_several_forces_the_one_that_changes_most_is_proposed() {
    let six = |row: &String| format!("{row},0.01,0.02").replacen(',', ",0.5,", 2);
    let lines: Vec<String> = rows(300).iter().map(six).collect();
    let header = "time_s,Fx_n,position_m,Fy_n,Fz_n,Tx,Ty";
    assert_says(&message(text(header, &lines)), &["--columns 'force_n=Fz_n'"]);
}

#[test]
fn what_is_no_table_of_numbers_is_named() {
    let json =
        "{\"time_s\": [0.0, 0.1],\n \"position_m\": [0.1, 0.1],\n \"force_n\": [1.0, 1.0]}\n";
    assert_says(&message(json), &["damaged JSON lines file, line 1", "hint"]);
    let american = |(k, row): (usize, &String)| {
        format!("11/22/2026 10:15:00.{k:03} AM,{}", row.split_once(',').unwrap().1)
    };
    let lines: Vec<String> = rows(300).iter().enumerate().map(american).collect();
    let said = message(text("time,position_m,force_n", &lines));
    assert_says(&said, &["column 'time' holds text", "or as dates such as 2026", "--rate-hz"]);
    assert!(!said.contains("--columns"), "an option that would fail: {said}");
}

#[test]
fn an_empty_column_is_named_as_empty() {
    let without = |row: &String| format!("{},", row.rsplit_once(',').unwrap().0);
    let lines: Vec<String> = rows(300).iter().map(without).collect();
    let said = message(text("time_s,position_m,force", &lines));
    assert_says(&said, &["column 'force' is empty in the first rows, expected force as numbers"]);
    assert!(!said.contains("text"), "{said}");
}

#[test]
fn a_cell_with_its_unit_is_named_with_the_remedy() {
    let remedy = "write the numbers alone into the cells and the unit into the name of the column";
    let lines: Vec<String> = rows(300).iter().map(|row| format!("{row} N")).collect();
    let said = message(text("time_s,position_m,force", &lines));
    let found = "column 'force' holds numbers with their unit, such as '";
    assert_says(&said, &[found, " N', expected force as numbers", remedy]);
    for cell in ["1.2 N", "1.2N", "-1.2e-3 mN", "3 newton"] {
        let mut lines = rows(300);
        lines[100] = format!("0.100,0.01,{cell}");
        assert_says(&message(text(HEADER, &lines)), &["line 102", cell, remedy]);
    }
    for cell in ["N", "1.2 x", "overload", "1.2 N 3"] {
        let mut lines = rows(300);
        lines[100] = format!("0.100,0.01,{cell}");
        let said = message(text(HEADER, &lines));
        assert!(said.contains("expected a number") && !said.contains(remedy), "{cell}: {said}");
    }
}

#[test]
fn a_name_in_a_comment_keeps_its_slash() {
    for comment in [
        "#/arm/time_s,/arm/position_m,/sensor/force_n",
        "% /arm/time_s,/arm/position_m,/sensor/force_n",
    ] {
        let contents = text(comment, &rows(300));
        let columns = "time_s=/arm/time_s,position_m=/arm/position_m,force_n=/sensor/force_n";
        same_as(&read_text(text(HEADER, &rows(300))), contents, &self::columns(columns));
    }
}

#[test]
fn text_in_utf_16_is_read() {
    let contents = text("Zeit [s],Weg [m],Kraft [N]", &rows(300));
    let plain = read_text(&contents);
    let units: Vec<u16> = std::iter::once(0xfeff).chain(contents.encode_utf16()).collect();
    let little: Vec<u8> = units.iter().flat_map(|unit| unit.to_le_bytes()).collect();
    let big: Vec<u8> = units.iter().flat_map(|unit| unit.to_be_bytes()).collect();
    let found = same_as(&plain, &little, &ReadOptions::default());
    assert_eq!(found.sha256, plain.sha256, "the hash is that of the text");
    same_as(&plain, &big, &ReadOptions::default());
}

#[test]
fn timestamps_are_seconds_from_the_first() {
    let plain = read_text(text(HEADER, &rows(300)));
    let stamped = |date: &str, zone: &str, separator: &str| {
        let row = |(k, row): (usize, &String)| {
            let (second, millisecond) = (59 + k / 1000, k % 1000);
            let rest = row.split_once(',').unwrap().1.replace(',', separator);
            format!("{date}10:14:{second:02}.{millisecond:03}{zone}{separator}{rest}")
        };
        rows(300).iter().enumerate().map(row).collect::<Vec<_>>()
    };
    for (header, date, zone, separator) in [
        ("timestamp,position_m,force_n", "2026-11-22T", "", ","),
        ("time_ms,position_m,force_n", "2026-11-22T", "Z", ","),
        ("Datum;Weg [m];Kraft [N]", "2026-11-22 ", "+01:00", ";"),
        ("timestamp  position_m  force_n", "2026-11-22 ", "", "  "),
    ] {
        same_as(&plain, text(header, &stamped(date, zone, separator)), &ReadOptions::default());
    }
    let rows = stamped("2026-11-22T", "", ",");
    same_as(&plain, rows.join("\n"), &columns("time_s,position_m,force_n"));
    same_as(&plain, text("a,b,c", &rows), &columns("time_s=a,position_m=b,force_n=c"));
    let mut damaged = rows;
    damaged[50] = damaged[50].replacen("2026", "20x6", 1);
    assert_says(
        &message(text("timestamp,position_m,force_n", &damaged)),
        &["line 52", "found '20x6-11-22T"],
    );
}

#[test]
fn a_file_without_times_is_read_at_its_rate() {
    let plain = read_text(text(HEADER, &rows(300)));
    let untimed: Vec<String> =
        rows(300).iter().map(|row| row.split_once(',').unwrap().1.to_owned()).collect();
    let at = |rate_hz: f64, columns: Option<&str>| {
        let choice = Choice {
            rate_hz: Some(rate_hz),
            columns: columns.map(str::to_owned),
            ..Choice::default()
        };
        ReadOptions { choice, ..ReadOptions::default() }
    };
    let contents = text("position_m,force_n", &untimed);
    let message_without = message(&contents);
    println!("{message_without}");
    assert_says(
        &message_without,
        &["no time column", "give the rows per second, for example --rate-hz 1000"],
    );
    let found = same_as(&plain, &contents, &at(1000.0, None));
    assert_eq!(found.quality.notes, ["times from 0 at 1000 rows per second"]);
    same_as(&plain, untimed.join("\n"), &at(1000.0, Some("position_m,force_n")));
    // A column of times is then not used, unless it is named as well.
    let found = same_as(&plain, text(HEADER, &rows(300)), &at(1000.0, None));
    assert_says(&found.quality.notes[0], &["column 'time_s' not used"]);
    let both =
        message_with(text(HEADER, &rows(300)), &at(1000.0, Some("time_s,position_m,force_n")));
    assert_says(&both, &["--rate-hz is given although --columns names the time"]);
    assert_says(
        &message_with(&contents, &at(0.0, None)),
        &["--rate-hz is 0, expected a number above 0"],
    );
}

#[test]
fn wrong_cells_are_named_with_their_line() {
    assert_says(
        &message(replaced(57, "0.055,abc,1.0")),
        &["rec.csv line 57", "found 'abc'", "position_m", "a number"],
    );
    assert_says(&message(replaced(57, "0.055,0.1")), &["line 57", "found 2 fields, expected 3"]);
    assert_says(&message(replaced(57, "0.055,0.1,1.0,9")), &["line 57", "found 4 fields"]);
    assert_says(&message(replaced(201, "0.2,0.1")), &["line 201", "cut off"]);
}

#[test]
fn a_clock_that_stands_or_runs_back_is_refused() {
    assert_says(
        &message(replaced(57, "0.010,0.1,1.0")),
        &["line 57", "goes back from 0.054", "0.01 s", "cut the file"],
    );
    let constant: Vec<String> = rows(50).iter().map(|row| format!("1.0{}", &row[5..])).collect();
    assert_says(
        &message(text(HEADER, &constant)),
        &["line 2", "stays at 1 s in all 50 samples", "trocar inspect"],
    );
    let coarse: Vec<String> =
        (0..400).map(cycle).map(|(t, x, f)| format!("{:.2},{x},{f}", t)).collect();
    assert_says(&message(text(HEADER, &coarse)), &["line 3", "same time", "more digits"]);
    let backwards: Vec<String> = rows(50).into_iter().rev().collect();
    assert_says(
        &message(text(HEADER, &backwards)),
        &["line 3", "goes back from 0.049 s to 0.048 s"],
    );
}

#[test]
fn rows_that_add_nothing_are_dropped_and_counted() {
    let mut rows = rows(200);
    rows[10] = "0.010,nan,1.0".into();
    rows[20] = "0.020,,1.0".into();
    rows[30] = "0.030,0.1,-inf".into();
    rows.insert(100, rows[99].clone());
    rows.swap(150, 151);
    let recording = read_text(text(HEADER, &rows));
    let quality = &recording.quality;
    assert_eq!(quality.non_finite_rows, RowList { count: 3, lines: vec![12, 22, 32] });
    assert_eq!(quality.repeated_rows, RowList { count: 1, lines: vec![102] });
    assert_eq!(quality.unordered_rows, RowList { count: 1, lines: vec![153] });
    assert_eq!(recording.len(), 201 - 5);
    assert!(recording.time.windows(2).all(|pair| pair[1] > pair[0]));
    assert_eq!(
        kinds(&recording),
        [WarningKind::NonFiniteRows, WarningKind::RepeatedRows, WarningKind::UnorderedRows]
    );
    assert_says(&quality.warnings[0].message, &["3 rows", "lines 12, 22, 32"]);
}

#[test]
fn gaps_and_resets_end_an_unbroken_part() {
    let mut rows = rows(2000);
    rows.drain(1000..1100);
    for row in &mut rows[1500..] {
        let (t, rest) = row.split_once(',').unwrap();
        let (x, f) = rest.split_once(',').unwrap();
        *row = format!("{t},{},{f}", x.parse::<f64>().unwrap() + 0.05);
    }
    let recording = read_text(text(HEADER, &rows));
    let gap = recording.quality.gaps[0];
    assert_eq!((gap.line, gap.from, gap.to), (1002, 0.999, 1.1));
    let Reset { line, jump, .. } = recording.quality.resets[0];
    assert_eq!(line, 1502);
    assert!((jump - 0.05).abs() < 1e-4);
    assert_eq!(recording.unbroken().collect::<Vec<_>>(), [0..1000, 1000..1500, 1500..1900]);
    assert_eq!(kinds(&recording), [WarningKind::Gaps, WarningKind::Resets]);
}

#[test]
fn a_stalled_logger_is_told_from_a_reset() {
    let mut rows = rows(2000);
    for first in [100, 110, 120] {
        for k in first + 1..first + 5 {
            let held = rows[first].split_once(',').unwrap().1.to_owned();
            rows[k] = format!("{:.3},{held}", k as f64 * 1e-3);
        }
    }
    let recording = read_text(text(HEADER, &rows));
    assert_eq!(kinds(&recording), [WarningKind::HeldRows]);
    assert_eq!(recording.quality.held_rows.count, 12);
    assert_eq!(recording.quality.held_rows.lines[..4], [103, 104, 105, 106]);
    assert_eq!(recording.len(), 2000);
}

/// Slow, four rows of rest, fast: nothing is caught up.
#[test]
fn a_short_rest_is_no_stall() {
    // No multiples of each other: that would be the step of an encoder, and none of its jumps.
    let (slow_m, fast_m) = (1.0137e-5, 5.3791e-5);
    let out_and_back_m = |k: usize| match k % 200 {
        slow @ 0..100 => slow_m * slow as f64,
        100..104 => slow_m * 99.0,
        fast => (slow_m * 99.0 - fast_m * (fast - 103) as f64).max(0.0),
    };
    let rows: Vec<String> = (0..2000)
        .map(|k| (k as f64, out_and_back_m(k)))
        .map(|(k, x)| format!("{:.3},{x:.12},{}", k * 1e-3, (k * 0.091).sin()))
        .collect();
    assert_eq!(read_text(text(HEADER, &rows)).quality.held_rows.count, 0);
}

#[test]
fn a_start_from_rest_is_no_reset() {
    let rows: Vec<String> = (0..500)
        .map(|k| (k as f64 * 0.01, if k < 200 { 0.0 } else { (k - 199) as f64 * 1e-3 }))
        .map(|(t, x)| format!("{t},{x},{}", (t * 91.0).sin()))
        .collect();
    assert_eq!(read_text(text(HEADER, &rows)).quality.resets, []);
}

#[test]
fn rounding_of_a_position_at_rest_is_no_jump() {
    let rows: Vec<String> = (0..500)
        .map(|k| {
            (
                k as f64 * 0.01,
                if k % 100 == 57 { 0.1 + 1.4e-17 } else { 0.1 },
                if k == 300 { 1e-17 } else { 0.0 },
            )
        })
        .map(|(t, x, more)| {
            format!("{t},{:e},{}", if more > 0.0 { 0.1 + 2.8e-17 } else { x }, (t * 91.0).sin())
        })
        .collect();
    let recording = read_text(text(HEADER, &rows));
    assert_eq!(recording.quality.resets, []);
    let near_zero: Vec<String> = (0..500)
        .map(|k| (k as f64 * 0.01, if (250..260).contains(&k) { 1e-17 } else { 0.0 }))
        .map(|(t, x)| format!("{t},{x:e},{}", (t * 91.0).sin()))
        .collect();
    let recording = read_text(text(HEADER, &near_zero));
    assert_eq!((recording.quality.resets, recording.quality.held_rows.count), (vec![], 0));
}

#[test]
fn a_saturated_sensor_is_found() {
    let clipped: Vec<String> =
        (0..2000).map(cycle).map(|(t, x, f)| format!("{t:.3},{x:.6},{:.4}", f.min(1.5))).collect();
    let recording = read_text(text(HEADER, &clipped));
    assert_eq!(kinds(&recording), [WarningKind::Saturation]);
    let end = recording.quality.saturated[0];
    assert_eq!(end.level, 1.5);
    assert!(end.count > 300);
    assert_says(&recording.quality.warnings[0].message, &["1.5 N", "line 13"]);
}

#[test]
fn a_part_keeps_velocity_notes_and_sensor_limit() {
    let time: Vec<f64> = (0..400).map(|k| 1e-3 * f64::from(k)).collect();
    let velocity: Vec<f64> = time.iter().map(|t| 0.1 * (20.0 * t).cos()).collect();
    let position: Vec<f64> = time.iter().map(|t| 5e-3 * (20.0 * t).sin()).collect();
    let force: Vec<f64> =
        velocity.iter().enumerate().map(|(k, v)| (40.0 * v + noise(k)).clamp(-3.0, 3.0)).collect();
    let readings =
        Readings { time, position, force, velocity: Some(velocity.clone()), ..Default::default() };
    let mut whole = Recording::from_readings("whole", &readings, Some(3.0)).unwrap();
    whole.quality.notes.push("declared".to_owned());
    let part = whole.part(100..350, "middle").unwrap();
    assert_eq!(part.velocity.as_deref(), Some(&velocity[100..350]));
    assert_eq!(
        (part.name.as_str(), part.quality.notes.contains(&"declared".to_owned())),
        ("whole, middle", true)
    );
    for range in [100..350, 0..40, 250..280] {
        let part = whole.part(range.clone(), "a part").unwrap();
        let clipped: Vec<bool> = (0..part.len()).map(|k| part.is_clipped(k)).collect();
        assert_eq!(clipped, range.map(|k| whole.is_clipped(k)).collect::<Vec<_>>());
    }
}

#[test]
fn a_given_sensor_limit_finds_saturation_without_noise() {
    let square: Vec<String> = (0..2000)
        .map(cycle)
        .map(|(t, x, f)| format!("{t:.3},{x:.6},{}", 5.0 * f.signum()))
        .collect();
    let square = text(HEADER, &square);
    assert_eq!(read_text(&square).quality.saturated, []);
    let options = ReadOptions { sensor_limit: Some(5.0), ..ReadOptions::default() };
    let recording = read(&Scratch::new().file(&square), &options).unwrap();
    assert_eq!(recording.quality.saturated.len(), 2);
}

#[test]
fn an_angle_is_never_a_position() {
    let rows = rows(50);
    for name in ["position_deg", "Position [rad]", "pos (°)", "motor angle deg"] {
        let message = message(text(&format!("time_s,{name},force_n"), &rows));
        assert_says(
            &message,
            &[
                &format!("column '{name}' is an angle, expected a position in m"),
                "as in position_mm=12.5*phi for 12.5 mm per radian",
            ],
        );
        assert!(!message.contains("--columns 'position"), "{message}");
        let forced = message_with(
            text(&format!("time_s,{name},force_n"), &rows),
            &columns(&format!("position_mm={name}")),
        );
        assert_says(&forced, &["an angle, expected a position in m"]);
    }
    let message = message_with(text(HEADER, &rows), &columns("time_s,position_deg,force_n"));
    assert_says(&message, &["'position_deg' is an angle", "lever arm"]);
    // Beside a position an angle does not matter.
    let beside: Vec<String> = rows.iter().map(|row| format!("{row},1")).collect();
    let recording = read_text(text("time_s,position_m,force_n,position_deg", &beside));
    assert_eq!(recording.position, read_text(text("time_s,position_m,force_n", &rows)).position);
}

#[test]
fn a_flipped_force_is_noticed_and_can_be_flipped_back() {
    let flipped: Vec<String> =
        (0..2000).map(cycle).map(|(t, x, f)| format!("{t:.3},{x:.6},{:.4}", 0.7 - f)).collect();
    let flipped = text(HEADER, &flipped);
    let recording = read_text(&flipped);
    assert_eq!(kinds(&recording), [WarningKind::ForceSign]);
    let (time, position) = (&recording.time, &recording.position);
    let hint = way_out(&recording);
    // A reversed sensor and a reversed encoder look the same: both ways are offered, and both help.
    assert_says(
        &hint,
        &[
            "use --flip-force if the sensor",
            "or use --columns 'position_m=-position_m' if the encoder",
        ],
    );
    let turned = read(&Scratch::new().file(&flipped), &columns("position_m=-position_m")).unwrap();
    assert_eq!(turned.quality.warnings, []);
    assert_eq!((&turned.time, -turned.position[7]), (time, position[7]));
    let rows: Vec<String> = (0..2000)
        .map(cycle)
        .map(|(t, x, f)| format!("{t:.3};{};{:.4}", 1e3 * x, 0.7 - f))
        .collect();
    let own = read(
        &Scratch::new().file(text("Zeit [s];Weg, [mm];Kraft [N]", &rows)),
        &ReadOptions::default(),
    )
    .unwrap();
    let hint = way_out(&own);
    let option =
        hint.split("--columns '").nth(1).and_then(|rest| rest.split("' if").next()).unwrap();
    assert_eq!(option, "position_mm=-\"Weg, [mm]\"");
    let turned =
        read(&Scratch::new().file(text("Zeit [s];Weg, [mm];Kraft [N]", &rows)), &columns(option))
            .unwrap();
    assert_eq!(turned.quality.warnings, []);
    let options = ReadOptions {
        choice: Choice { flip_force: true, ..Choice::default() },
        ..ReadOptions::default()
    };
    let back = read(&Scratch::new().file(&flipped), &options).unwrap();
    assert_eq!(back.quality.warnings, []);
    assert_eq!(back.force[7], -recording.force[7]);
}

/// Numbers of the same recording in other units, under a name that says SI units.
fn mislabelled([per_time, per_position, per_force]: [f64; 3]) -> String {
    let row = |(t, x, f): (f64, f64, f64)| {
        format!("{},{},{}", t * per_time, x * per_position, f * per_force)
    };
    text(HEADER, &(0..2000).map(cycle).map(row).collect::<Vec<_>>())
}

#[test]
fn sizes_that_make_a_unit_doubtful_are_questioned() {
    let plain = read_text(text(HEADER, &rows(2000)));
    for (factors, essentials, option) in [
        (
            [1e3, 1.0, 1.0],
            &["the samples are 1.0e0 s apart", "if the time is in ms"][..],
            "time_ms=time_s,position_m=position_m,force_n=force_n",
        ),
        (
            [1e9, 1.0, 1.0],
            &["the samples are 1.0e6 s apart", "if the time is in ns"],
            "time_ns=time_s,position_m=position_m,force_n=force_n",
        ),
        (
            [1.0, 1e3, 1.0],
            &["covers 20 m", "at most 2 m", "if the position is in mm"],
            "time_s=time_s,position_mm=position_m,force_n=force_n",
        ),
        (
            [1.0, 1.0, 1e3],
            &["the force reaches", "20", "if the force is in mN"],
            "time_s=time_s,position_m=position_m,force_mn=force_n",
        ),
        (
            [1e3, 1.0, 1e3],
            &["apart", "reaches", "if the time is in ms and the force is in mN"],
            "time_ms=time_s,position_m=position_m,force_mn=force_n",
        ),
    ] {
        let contents = mislabelled(factors);
        let message = message(&contents);
        assert_says(&message, essentials);
        assert_eq!(proposed(&message), option, "{message}");
        let found = read(&Scratch::new().file(&contents), &columns(option)).unwrap();
        for (of, expected) in [
            (&found.time, &plain.time),
            (&found.position, &plain.position),
            (&found.force, &plain.force),
        ] {
            assert!(of.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-4), "{option}");
        }
        // Who names columns and units insists; only a stroke of 20 m is never read.
        let insisting = "time_s=time_s,position_m=position_m,force_n=force_n";
        match read(&Scratch::new().file(&contents), &columns(insisting)) {
            Ok(found) => assert!(kinds(&found).contains(&WarningKind::Units), "{insisting}"),
            Err(error) => assert_says(&error.to_string(), &["at most 2 m"]),
        }
    }
    // Microseconds read as such, though they count milliseconds: 60 m/s.
    let fast = mislabelled([1e3, 1.0, 1.0]).replace("time_s", "time_us");
    let said = message(&fast);
    assert_says(&said, &["the position moves at 6.", "e1 m/s"]);
    assert_eq!(proposed(&said), "time_ms=time_us,position_m=position_m,force_n=force_n");
    let small = text(HEADER, &rows(2000)).replace("position_m", "position_um");
    let said = message(&small);
    assert_says(&said, &["the position covers only 0.0000 mm"]);
    assert_eq!(proposed(&said), "time_s=time_s,position_m=position_um,force_n=force_n");
    let insisting = "time_s=time_s,position_um=position_um,force_n=force_n";
    let found = read(&Scratch::new().file(&small), &columns(insisting)).unwrap();
    assert_eq!(kinds(&found), [WarningKind::Stroke]);
    let heavy = plain.clone().without_moving_mass(40.0, 0.0).unwrap_err();
    assert_says(
        &heavy.to_string(),
        &["is 40 kg, whose inertia would range", "(grams?) are", "=0.04›"],
    );
    assert_eq!(plain.without_moving_mass(0.5, 0.0).unwrap().quality.warnings, []);
}

#[test]
fn row_numbers_are_no_times() {
    let plain = read_text(text(HEADER, &rows(2000)));
    let numbered = |name: &str| {
        let row = |(k, row): (usize, &String)| format!("{k},{}", row.split_once(',').unwrap().1);
        let lines: Vec<String> = rows(2000).iter().enumerate().map(row).collect();
        text(&format!("{name},position_m,force_n"), &lines)
    };
    let rate = |columns: Option<&str>| ReadOptions {
        choice: Choice {
            rate_hz: Some(1000.0),
            columns: columns.map(str::to_owned),
            ..Choice::default()
        },
        ..ReadOptions::default()
    };
    for name in ["sample", "index", "Sample #", "", "a", "ticks"] {
        let said = message(numbered(name));
        assert_says(&said, &["no time column", "--rate-hz 1000 (replace it by your sample rate)"]);
        assert!(!said.contains("--columns"), "{said}");
        same_as(&plain, numbered(name), &rate(None));
    }
    let said = message_with(numbered("sample"), &columns("time_ms=sample,position_m=position_m"));
    assert_says(&said, &["'sample' numbers the rows, expected a time", "' --rate-hz 1000"]);
    assert_eq!(proposed(&said), "position_m=position_m");
    same_as(&plain, numbered("sample"), &rate(Some("position_m=position_m")));
    // A name that says seconds: milliseconds, or row numbers.
    let said = message(numbered("time_s"));
    assert_says(
        &said,
        &[
            "if the time is in ms; --columns 'position_m=position_m,force_n=force_n' --rate-hz 1000",
            "if the column of times numbers the rows",
        ],
    );
    let lines: Vec<String> = numbered("a").lines().skip(1).map(str::to_owned).collect();
    let said = message(lines.join("\n"));
    assert_says(
        &said,
        &["--columns -,position_m,force_n --rate-hz 1000 (replace it by your sample rate; guessed"],
    );
    same_as(&plain, lines.join("\n"), &rate(Some("-,position_m,force_n")));
    // A counter that skips is none of rows, and milliseconds by name count by one.
    same_as(&plain, numbered("time_ms"), &ReadOptions::default());
    let named = columns("time_ms=sample_time_ms,position_m=position_m,force_n=force_n");
    same_as(&plain, numbered("sample_time_ms"), &named);
}

#[test]
fn of_the_axes_of_a_place_the_one_that_moves_is_taken_or_all_are_asked() {
    let plain = read_text(text(HEADER, &rows(2000)));
    let with = |across: f64| {
        let row = |(t, x, f): (f64, f64, f64)| {
            format!("{t:.3},{:.6},{:.6},{x:.6},{f:.4}", across * x, 0.01 * x)
        };
        (0..2000).map(cycle).map(row).collect::<Vec<_>>()
    };
    for header in ["time_s,x_m,y_m,z_m,force_n", "time_s,pos_x_m,pos_y_m,pos_z_m,force_n"] {
        let found = same_as(&plain, text(header, &with(0.02)), &ReadOptions::default());
        let notes = found.quality.notes.join("; ");
        assert_says(&notes, &["taken as position: it has nearly all of the travel", "0.0200"]);
        let said = message(text(header, &with(0.5)));
        let (x, z) = (&header[7..].split(',').next().unwrap(), header.split(',').nth(3).unwrap());
        assert_says(&said, &[&format!("position could be '{x}'"), &format!("or '{z}'")]);
        assert_eq!(proposed(&said), format!("position_m={z}"));
    }
    // Neither is the force of one axis taken in silence.
    let six = |row: &String| row.replacen(',', ",0.5,", 1) + ",0.3";
    let lines: Vec<String> = rows(300).iter().map(six).collect();
    let said = message(text("time_s,force_x_n,position_m,force_z_n,force_y_n", &lines));
    assert_eq!(proposed(&said), "force_n=force_z_n");
}

#[test]
fn thousands_are_no_decimals() {
    let whole = |k: usize| {
        let (_, x, f) = cycle(k);
        let (x, f) = ((1e6 * x).round() as i64, (1e3 * f).round() as i64);
        (k, x, f)
    };
    let grouped = |number: i64, mark: char| {
        let size = number.unsigned_abs();
        let sign = if number < 0 { "-" } else { "" };
        if size < 1000 {
            format!("{sign}{size}")
        } else {
            format!("{sign}{}{mark}{:03}", size / 1000, size % 1000)
        }
    };
    let lines = |separator: &str, mark: Option<char>| {
        let cell = |number: i64| mark.map_or(number.to_string(), |mark| grouped(number, mark));
        let row = |(k, x, f): (usize, i64, i64)| [k as i64, x, f].map(cell).join(separator);
        (0..3000).map(whole).map(row).collect::<Vec<_>>()
    };
    let plain = read_text(text("time_ms,x_um,force_mn", &lines(",", None)));
    for (header, separator, mark, note) in [
        ("Zeit [ms];Weg [µm];Kraft [mN]", ";", '.', "the point groups thousands, as in 1.234"),
        ("time_ms\tx_um\tforce_mn", "\t", ',', "the comma groups thousands, as in 1,234"),
    ] {
        let contents = text(header, &lines(separator, Some(mark)));
        let found = same_as(&plain, contents, &ReadOptions::default());
        assert_says(&found.quality.notes.join("; "), &[note]);
    }
    // With decimal commas a point can only group.
    let german = |row: &String| format!("{},0", row.replace(';', ",0;"));
    let dotted: Vec<String> = lines(";", Some('.')).iter().map(german).collect();
    let contents = text("Zeit [ms];Weg [µm];Kraft [mN]", &dotted);
    same_as(&plain, contents, &ReadOptions::default());
    // Without any point there is nothing to say.
    let commas: Vec<String> = lines(";", None).iter().map(german).collect();
    let contents = text("Zeit [ms];Weg [µm];Kraft [mN]", &commas);
    let found = same_as(&plain, contents, &ReadOptions::default());
    assert!(found.quality.notes.iter().all(|note| !note.contains("thousands")));
}

#[test]
fn the_sign_stays_with_the_sensor_where_a_file_is_read_by_its_own_header() {
    let plain = read_text(text(HEADER, &rows(300)));
    for (mapping, flip_force) in
        [("time_s=t,position_m=x,force_n=-Fz", false), ("time_s=t,position_m=x,force_n=Fz", true)]
    {
        let mut options = columns(mapping);
        (options.choice.flip_force, options.choice.from_another_file) = (flip_force, true);
        assert!(options.choice.reverses_force(), "{mapping}");
        let found = read(&Scratch::new().file(text(HEADER, &rows(300))), &options).unwrap();
        assert_eq!(found.force[10], -plain.force[10], "{mapping}");
    }
    assert!(columns("time_s,position_m,-force_n").choice.reverses_force());
    let mut twice = columns("time_s=t,position_m=x,force_n=-Fz");
    twice.choice.flip_force = true;
    assert!(!twice.choice.reverses_force());
}

#[test]
fn columns_without_a_name_can_be_named() {
    let plain = read_text(text(HEADER, &rows(300)));
    let contents = text(",,", &[vec!["s,m,N".to_owned()], rows(300)].concat());
    let found = same_as(&plain, &contents, &ReadOptions::default());
    assert_eq!(found.quality.notes.len(), 3);
    let named = columns("time_s=#1,position_m=#2,force_n=#3");
    same_as(&plain, &contents, &named);
}

#[test]
fn a_recording_too_large_for_the_memory_says_what_it_needs() {
    let options = ReadOptions { memory_limit: Some(10_000), ..ReadOptions::default() };
    assert_says(&message_with(text(HEADER, &rows(2000)), &options), &["rows need", "MB", "hint"]);
}

proptest! {
    #[test]
    fn what_is_written_reads_back_as_the_same_numbers(
        steps in prop::collection::vec((1e-4..1.0_f64, -0.9..0.9_f64, -1e3..1e3_f64, -1.0..1.0_f64), 8..60),
    ) {
        let time: Vec<f64> = steps.iter().scan(0.0, |t, step| { *t += step.0; Some(*t) }).collect();
        let of = |take: fn(&(f64, f64, f64, f64)) -> f64| steps.iter().map(take).collect::<Vec<_>>();
        let (position, force, velocity) = (of(|s| s.1), of(|s| s.2), of(|s| s.3));
        let (angle, torque) = (Some(of(|s| 9.0 * s.1)), Some(of(|s| 1e-3 * s.2)));
        let velocity = Some(velocity);
        let loads = [Some(of(|s| s.2 * s.3)), Some(of(|s| 3.0 * s.3)), Some(of(|s| 1e3 * s.1))];
        let written = Readings { time, position, force, velocity, angle, torque, loads };
        let mut bytes = Vec::new();
        Recording::from_readings("all", &written, None).unwrap().write(&mut bytes).unwrap();
        // Whatever the size: the units are named.
        let named = columns("time_s=time_s,position_m=position_m,force_n=force_n");
        let recording = read(&Scratch::new().file(&bytes), &named).unwrap();
        let Recording { time, position, force, velocity, angle, torque, loads, .. } = recording;
        prop_assert_eq!(Readings { time, position, force, velocity, angle, torque, loads }, written);
    }

    #[test]
    fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let _ = read(&Scratch::new().file(&bytes), &ReadOptions::default());
    }

    #[test]
    fn arbitrary_damage_to_a_file_never_panics(at in 0..2000_usize, byte in any::<u8>()) {
        let mut bytes = text(HEADER, &rows(100)).into_bytes();
        let at = at % bytes.len();
        bytes[at] = byte;
        let _ = read(&Scratch::new().file(&bytes), &ReadOptions::default());
    }
}

/// Sampling times with intervals between 0.2 and 1.8 ms.
fn uneven(count: usize) -> Vec<f64> {
    let step = |k: usize| 1e-3 * (1.0 + 0.8 * (k as f64 * 2.3).sin());
    (0..count)
        .scan(1000.0, |t, k| {
            *t += step(k);
            Some(*t)
        })
        .collect()
}

fn moving(time: Vec<f64>, position: impl Fn(f64) -> f64) -> Recording {
    let position: Vec<f64> = time.iter().map(|&t| position(t)).collect();
    let force = time.iter().map(|t| (t * 700.0).sin()).collect();
    Recording::from_columns("made", time, position, force).unwrap()
}

#[test]
fn a_parabola_gives_its_acceleration_everywhere_under_uneven_sampling() {
    let recording =
        moving(uneven(5000), |t| 0.3 + 0.02 * (t - 1002.0) - 0.05 * (t - 1002.0).powi(2));
    for window in [1e-3, 10e-3, 0.2] {
        let acceleration = local_acceleration(&recording, window);
        let velocity = local_velocity(&recording, window);
        // Position rounds at 1e-16 m, time at 1e-13 s; the shortest window of 4 ms divides by its
        // square.
        let tolerance = if window < 5e-3 { 1e-7 } else { 1e-8 };
        for k in 0..recording.len() {
            assert!((acceleration[k] + 0.1).abs() < tolerance, "{window} {k} {}", acceleration[k]);
            let expected = 0.02 - 0.1 * (recording.time[k] - 1002.0);
            assert!((velocity[k] - expected).abs() < tolerance, "{window} {k} {}", velocity[k]);
        }
    }
}

#[test]
fn a_sine_gives_its_acceleration_within_the_bandwidth() {
    let omega = std::f64::consts::TAU * 2.0;
    let recording = moving(uneven(5000), |t| 0.05 * (omega * t).sin());
    let acceleration = local_acceleration(&recording, 20e-3);
    let amplitude = 0.05 * omega * omega;
    for (k, found) in acceleration.iter().enumerate().skip(20).take(recording.len() - 40) {
        let expected = -amplitude * (omega * recording.time[k]).sin();
        assert!((found - expected).abs() < 0.01 * amplitude, "{k}");
    }
}

/// A pulse below the noise of the positions is in the accelerations where it repeats in every stroke.
#[test]
fn a_small_pulse_that_repeats_is_not_lost_in_the_noise() {
    let (strokes, period) = (100, 1000);
    let acceleration = |k: usize| match k % period {
        0..50 => 1.0,
        300..320 => 0.05,
        500..550 => -1.0,
        800..820 => -0.05,
        _ => 0.0,
    };
    // Its strokes begin a third of a count apart.
    let (mut x, mut v) = (0.0, -0.025 + 1.3e-6);
    let mut motion = Vec::new();
    for k in 0..strokes * period {
        motion.push((k as f64 * 1e-3, (x / 4e-6_f64).round() * 4e-6));
        x += 1e-3 * (v + 5e-4 * acceleration(k));
        v += 1e-3 * acceleration(k);
    }
    let (time, position): (Vec<f64>, Vec<f64>) = motion.into_iter().unzip();
    let force = (0..time.len()).map(noise).collect();
    let recording = Recording::from_columns("pulses", time, position, force).unwrap();
    let mean = |values: &[f64]| {
        let inside = values.iter().enumerate().filter(|(k, _)| (305..315).contains(&(k % period)));
        inside.map(|(_, a)| a).sum::<f64>() / (10 * strokes) as f64
    };
    let found = mean(&recording.acceleration());
    println!("a pulse of 0.05 m/s²: {found:.4}");
    assert!((found - 0.05).abs() < 0.01, "{found}");
}

/// m/s: no whole number of counts a sample.
const SPEED: f64 = 0.0473;

/// Strokes of 40 mm that turn with `turn` m/s²: positions and accelerations at `time`.
fn strokes(time: &[f64], turn: f64) -> [Vec<f64>; 2] {
    let (mut x, mut v, mut a) = (0.0, 0.0, turn);
    let mut all = [vec![], vec![]];
    for pair in time.windows(2) {
        all.iter_mut().zip([x, a]).for_each(|(column, own)| column.push(own));
        let h = pair[1] - pair[0];
        a = match v {
            v if x > 0.04 => (-turn).max((-SPEED - v) / h),
            v if x < 0.0 => turn.min((SPEED - v) / h),
            _ => a,
        };
        if v.abs() >= SPEED && v * a > 0.0 {
            a = 0.0;
        }
        (x, v) = (x + h * (v + 0.5 * h * a), v + h * a);
    }
    all
}

/// The counts of an encoder tell more than their step: at constant speed the velocity from one
/// sample to the next errs by less than a fiftieth of what that of the counts does, where the
/// instrument turns by less than a third, even within 19 samples; on an uneven clock, too.
#[test]
fn smoothed_positions_are_nearer_to_the_motion_than_the_counts() {
    for (step, turn) in [(50e-6, 0.5), (20e-6, 2.0), (5e-6, 5.0)] {
        for time in [uneven(20_000), (0..20_001).map(|k| 1e-3 * f64::from(k)).collect()] {
            let [exact, acceleration] = strokes(&time, turn);
            let time = time[..exact.len()].to_vec();
            let counts: Vec<f64> = exact.iter().map(|x| (x / step).round() * step).collect();
            let force: Vec<f64> = (0..time.len()).map(noise).collect();
            let recording =
                Recording::from_columns("counts", time.clone(), counts.clone(), force).unwrap();
            let smooth = recording.smoothed();
            assert_eq!(smooth.smoothed().position, smooth.position, "smoothed twice");
            // By class: at constant speed, and within 10 ms of an acceleration.
            let is_near = |k: usize| acceleration[k - 10..k + 10].iter().any(|a| *a != 0.0);
            let rms = |near: bool, error: &dyn Fn(usize) -> f64| {
                let own = (20..time.len() - 20).filter(|k| is_near(*k) == near);
                let (squares, n) = own.fold((0.0, 0.0), |s, k| (s.0 + error(k).powi(2), s.1 + 1.0));
                (squares / n).sqrt()
            };
            let ratio = |near: bool, of: fn(&[f64], &[f64], &[f64], usize) -> f64| {
                let each =
                    [&smooth.position, &counts].map(|x| rms(near, &|k| of(x, &exact, &time, k)));
                each[0] / each[1]
            };
            let place = |x: &[f64], exact: &[f64], _: &[f64], k: usize| x[k] - exact[k];
            let speed = |x: &[f64], exact: &[f64], t: &[f64], k: usize| {
                (x[k] - x[k - 1] - exact[k] + exact[k - 1]) / (t[k] - t[k - 1])
            };
            let found =
                [ratio(false, place), ratio(false, speed), ratio(true, place), ratio(true, speed)];
            println!("steps of {step} m, turning with {turn} m/s²: {found:.3?}");
            assert!(
                found[0] < 0.3 && found[1] < 0.02 && found[2] < 0.8 && found[3] < 0.3,
                "{found:?}"
            );
        }
    }
}

/// A mass is estimated through the accelerations: their noise would bias it towards zero, as blur would
/// away from it. At 0.1 to 1 ms, for counts of 5 to 50 µm and for scatter of 2 to 20 µm.
#[test]
fn accelerations_show_the_mass_that_they_act_on() {
    let counts = [(50e-6, 0.5), (50e-6, 5.0), (20e-6, 2.0), (5e-6, 5.0)].map(|c| (c, 0.0));
    let scatter = [(0.0, 2e-6), (0.0, 2e-5), (1e-6, 2e-5)].map(|(step, s)| ((step, 2.0), s));
    for ((step, turn), scatter) in counts.into_iter().chain(scatter) {
        for interval in [1e-4, 5e-4, 1e-3] {
            let time: Vec<f64> = (0..40_001).map(|k| interval * f64::from(k)).collect();
            let [exact, acceleration] = strokes(&time, turn);
            let reading = |(k, x): (usize, &f64)| {
                // About normal, with a standard deviation of 1.
                let random = (0..12).map(|j| noise(12 * k + j)).sum::<f64>() / 0.035;
                let noisy = x + scatter * random;
                if step > 0.0 { (noisy / step).round() * step } else { noisy }
            };
            let position: Vec<f64> = exact.iter().enumerate().map(reading).collect();
            let (time, force) = (time[..exact.len()].to_vec(), vec![0.0; exact.len()]);
            let recording = Recording::from_columns("noisy", time, position, force).unwrap();
            for found in [recording.acceleration(), recording.smoothed().acceleration()] {
                let inside = 20..found.len() - 20;
                let (both, square) = inside.fold((0.0, 0.0), |(both, square), k| {
                    let truth = 0.5 * (acceleration[k - 1] + acceleration[k]);
                    (both + found[k] * truth, square + found[k] * found[k])
                });
                let mass = both / square;
                println!("{step:.0e} m, {turn} m/s², {scatter:.0e} m, {interval} s: {mass:.3}");
                assert!((0.95..1.05).contains(&mass), "{mass}");
            }
        }
    }
}

/// Scatter beyond the rounding may be that of the clock: it stays, and is still named.
#[test]
fn scatter_beyond_the_counts_is_not_smoothed() {
    let time: Vec<f64> = (0..20_001).map(|k| 1e-2 * f64::from(k)).collect();
    let [exact, _] = strokes(&time, 1.0);
    let time = time[..exact.len()].to_vec();
    let counts = (0..exact.len()).map(|k| ((exact[k] + 4e-4 * noise(k)) / 1e-6).round() * 1e-6);
    let (position, force): (Vec<f64>, Vec<f64>) = (counts.collect(), vec![0.0; time.len()]);
    let recording = Recording::from_columns("clock", time, position, force).unwrap();
    let smooth = recording.smoothed();
    let pairs = smooth.position.iter().zip(&recording.position);
    let moved = pairs.fold(0.0_f64, |worst, (a, b)| worst.max((a - b).abs()));
    let (position, force) = (smooth.position.clone(), vec![0.0; smooth.len()]);
    let again = Recording::from_columns("again", smooth.time.clone(), position, force).unwrap();
    let [before, after] = [&recording, &again].map(|own| own.quality.position_noise);
    assert_eq!(smooth.position_noise(), before, "it is still named");
    println!("moved by {moved:.1e} m, noise {before:.1e} and {after:.1e} m");
    assert!(moved < 2e-6 && before > 3e-6 && (after / before - 1.0).abs() < 0.05);
}

/// A long recording is smoothed in pieces, which does not show, and a jump of the counter is no motion.
#[test]
fn neither_pieces_nor_resets_show_in_smoothed_positions() {
    let time: Vec<f64> = (0..12_001).map(|k| 1e-3 * f64::from(k)).collect();
    let [exact, _] = strokes(&time, 1.0);
    let smooth = |from: usize, jump: f64| {
        let counts = exact.iter().enumerate().skip(from);
        let counts = counts.map(|(k, x)| (x / 1e-5).round() * 1e-5 + f64::from(k > 6000) * jump);
        let (time, position): (Vec<f64>, Vec<f64>) =
            (time[from..exact.len()].to_vec(), counts.collect());
        let force = vec![0.0; time.len()];
        let recording = Recording::from_columns("counts", time, position, force).unwrap();
        (recording.quality.resets.len(), recording.smoothed().position.clone())
    };
    let (none, whole) = smooth(0, 0.0);
    let (_, later) = smooth(1500, 0.0);
    let (resets, jumped) = smooth(0, 1.0);
    assert_eq!((none, resets), (0, 1));
    let off = |k: usize, other: f64| (whole[k] - other).abs();
    let by_pieces =
        (2000..exact.len()).fold(0.0_f64, |worst, k| worst.max(off(k, later[k - 1500])));
    let before = (0..5900).fold(0.0_f64, |worst, k| worst.max(off(k, jumped[k])));
    let after = (6100..exact.len()).fold(0.0_f64, |worst, k| worst.max(off(k, jumped[k] - 1.0)));
    println!("pieces {by_pieces:.1e} m, before a reset {before:.1e} m, after it {after:.1e} m");
    assert!(by_pieces < 5e-7 && before < 2e-6 && after < 2e-6);
}

/// A part of a smoothed recording, and one whose positions are shifted in time, has the accelerations of its
/// samples.
#[test]
fn expected_accelerations_stay_with_their_samples() {
    let clock = |k: u32| 1e-3 * f64::from(k) + if k > 6000 { 2.0 } else { 0.0 };
    let [exact, _] = strokes(&(0..12_001).map(|k| 1e-3 * f64::from(k)).collect::<Vec<_>>(), 1.0);
    let time: Vec<f64> = (0..exact.len() as u32).map(clock).collect();
    let position = exact.iter().map(|x| (x / 1e-5).round() * 1e-5).collect();
    let force = vec![0.0; time.len()];
    let recording = Recording::from_columns("counts", time, position, force).unwrap();
    assert_eq!(recording.quality.breaks.len(), 1);
    let smooth = recording.smoothed().into_owned();
    let whole = smooth.acceleration();
    let off = |own: &Recording, at: usize, by: usize| {
        let inside = 10..own.len() - 10;
        let beside_gap = |k: usize| (k + at).abs_diff(6000) < 10;
        let own = own.acceleration();
        let pairs = inside.filter(|k| !beside_gap(*k)).map(|k| (own[k] - whole[k + at + by]).abs());
        pairs.fold(0.0, f64::max)
    };
    let [middle, end] = [2000..7000, 9000..20_000].map(|range| smooth.part(range, "part").unwrap());
    for (part, at) in [(&middle, 2000), (&end, 9000)] {
        let of = |own: &Recording| [own.quality.position_resolution, own.quality.position_noise];
        assert!(of(part) == of(&smooth) && of(part)[0] > 0.0, "{:?}", of(part));
        assert!(off(part, at, 0) < 1e-6, "{}", off(part, at, 0));
    }
    let before_gap = smooth.part(0..5500, "before the gap").unwrap();
    let delayed = before_gap.with_position_delay(3e-3).unwrap();
    assert!(off(&delayed, 0, 3) < 1e-6 && off(&delayed, 0, 0) > 0.1, "{}", off(&delayed, 0, 3));
}

/// Intervals of any size leave numbers, near the readings.
#[test]
fn smoothed_positions_are_numbers_whatever_the_clock() {
    for interval in [1e-90, 1e-30, 1e-3, 1e6, 1e60] {
        let time: Vec<f64> = (0..500).map(|k| interval * f64::from(k)).collect();
        let position: Vec<f64> = (0..500).map(|k| 1e-5 * f64::from(k % 97)).collect();
        let Ok(recording) =
            Recording::from_columns("odd", time, position, (0..500).map(noise).collect())
        else {
            continue;
        };
        let off =
            recording.smoothed().position.iter().zip(&recording.position).fold(
                0.0_f64,
                |worst, (a, b)| {
                    worst.max(if a.is_finite() { (a - b).abs() } else { f64::INFINITY })
                },
            );
        println!("intervals of {interval:e} s: {off:.1e} m off");
        assert!(off < 1e-3, "{interval}: {off}");
    }
}

/// Positions without an error stay what they are, however suddenly the instrument is pushed.
#[test]
fn exact_positions_are_not_smoothed() {
    let time: Vec<f64> = (0..20_001).map(|k| 1e-3 * f64::from(k)).collect();
    for turn in [0.5, 50.0] {
        let [exact, _] = strokes(&time, turn);
        let (time, force) = (time[..exact.len()].to_vec(), vec![0.0; exact.len()]);
        let recording = Recording::from_columns("exact", time, exact.clone(), force).unwrap();
        let off = recording
            .smoothed()
            .position
            .iter()
            .zip(&exact)
            .fold(0.0_f64, |worst, (a, b)| worst.max((a - b).abs()));
        println!("turning with {turn} m/s²: {off:.1e} m off");
        assert!(off < 1e-6, "{off}");
    }
}

/// A coarse encoder does not put its counts into the force from which inertia is subtracted.
#[test]
fn the_steps_of_an_encoder_do_not_become_inertia() {
    let (omega, step) = (std::f64::consts::TAU * 0.7, 50e-6_f64);
    let time: Vec<f64> = (0..8000).map(|k| f64::from(k) * 5e-4).collect();
    let exact: Vec<f64> = time.iter().map(|t| 0.01 * (omega * t).sin()).collect();
    let force: Vec<f64> = exact.iter().map(|x| -0.04 * omega * omega * x).collect();
    let position = exact.iter().map(|x| (x / step).round() * step).collect();
    let noisy = force.iter().zip(0..).map(|(f, k)| f + 0.02 * (f64::from(k * k % 17) / 8.0 - 1.0));
    let recording = Recording::from_columns("counts", time, position, noisy.collect()).unwrap();
    assert_eq!(recording.coarse_step(), recording.quality.position_resolution);
    let left = recording.without_moving_mass(0.04, 0.0).unwrap().force;
    // Where the recording ends nothing tells what follows the last count.
    let inside = &left[20..left.len() - 20];
    let worst = inside.iter().fold(0.0_f64, |worst, f| worst.max(f.abs()));
    assert!(worst < 0.05, "{worst} N beside noise of 0.02 N");
}

#[test]
fn a_moving_mass_leaves_the_friction_behind() {
    // 4 µm encoder, 0.5 kg, oscillating at 3 Hz over 20 mm: 3.6 N of inertia peak to peak and 1 N
    // of friction.
    let omega = std::f64::consts::TAU * 3.0;
    let time: Vec<f64> = (0..8000).map(|k| f64::from(k) * 1e-3).collect();
    let position: Vec<f64> =
        time.iter().map(|t| (0.01 * (omega * t).sin() / 4e-6).round() * 4e-6).collect();
    let friction = |t: f64| (20.0 * (omega * t).cos()).tanh();
    let force = time.iter().enumerate().map(|(k, &t)| {
        friction(t) + 0.5 * (9.81 - 0.01 * omega * omega * (omega * t).sin()) + noise(k)
    });
    let recording =
        Recording::from_columns("made", time.clone(), position, force.collect()).unwrap();
    let corrected = recording.without_moving_mass(0.5, 9.81).unwrap();
    let squares: f64 =
        corrected.force.iter().zip(&time).map(|(f, &t)| (f - friction(t)).powi(2)).sum();
    let rms = (squares / time.len() as f64).sqrt();
    // The force noise alone has 0.01 N; the remainder is at the ends of the recording.
    assert!(rms < 0.03, "{rms}");
    assert!(moving(uneven(100), |t| t - 1000.0).without_moving_mass(-1.0, 0.0).is_err());
}

#[test]
fn a_force_that_never_changes_feels_no_mass() {
    let time: Vec<f64> = (0..1000).map(|k| f64::from(k) * 1e-3).collect();
    let position: Vec<f64> = time.iter().map(|t| 0.01 * (20.0 * t).sin()).collect();
    let force: Vec<f64> = (0..1000).map(|k| if k % 7 == 0 { 0.1 + 0.2 } else { 0.3 }).collect();
    let recording = Recording::from_columns("made", time, position, force.clone()).unwrap();
    let corrected = recording.without_moving_mass(0.5, 0.0).unwrap();
    assert_eq!(corrected.force, force);
    assert_says(
        &corrected.quality.notes.join("; "),
        &["the force is constant: inertia of 0.5 kg not subtracted"],
    );
}

#[test]
fn windows_do_not_reach_across_a_reset() {
    let time: Vec<f64> = (0..1000).map(|k| f64::from(k) * 1e-3).collect();
    let recording = moving(time, |t| 0.1 * t + if t < 0.5 { 0.0 } else { 0.03 });
    assert_eq!(recording.quality.resets.len(), 1);
    let velocity = local_velocity(&recording, 50e-3);
    assert!(velocity.iter().all(|v| (v - 0.1).abs() < 1e-9));
}

/// Folder of real recordings next to the workspace, if it exists.
fn shared() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/recordings");
    if folder.is_dir() {
        return Some(folder);
    }
    assert!(
        std::env::var_os("TROCAR_REQUIRE_SHARED").is_none(),
        "{} is required",
        folder.display()
    );
    skipped(&format!("no {}", folder.display()));
    None
}

#[test]
fn real_recordings_read_with_a_quality_that_makes_sense() {
    let Some(folder) = shared() else { return };
    let read = |name: &str| read(&folder.join(name), &ReadOptions::default()).unwrap();
    for name in ["steady", "dynamic", "validation", "surgeon"] {
        let recording = read(&format!("seal_a/{name}.csv"));
        let quality = &recording.quality;
        println!("{name}: {}", serde_json::to_string(quality).unwrap());
        assert_eq!(quality.position_resolution, 4e-6, "{name}");
        assert!((0.015..0.035).contains(&quality.force_noise), "{name}: {}", quality.force_noise);
        assert_eq!(quality.warnings, [], "{name}");
    }
    let mut gaps = 0;
    for entry in std::fs::read_dir(folder.join("elastomer_seals")).unwrap() {
        let name = entry.unwrap().file_name();
        let recording = read(&format!("elastomer_seals/{}", name.display()));
        println!("{}: {}", name.display(), serde_json::to_string(&recording.quality).unwrap());
        gaps += recording.quality.gaps.len();
        assert!(recording.quality.jitter > 1e-4);
        assert!(recording.quality.saturated.is_empty() && recording.quality.resets.is_empty());
        assert!(!recording.quality.force_opposes_motion);
    }
    assert!(gaps >= 4, "{gaps}");
    // The logger of this arm stalls for 40 ms occasionally.
    let faults = |name: &str| {
        let recording = read(name);
        println!("{name}: {}", serde_json::to_string(&recording.quality).unwrap());
        assert_eq!(recording.velocity.is_some(), name.starts_with("dvrk"));
        (kinds(&recording), recording.quality.held_rows.count)
    };
    for name in ["negative", "positive"] {
        let (kinds, held) = faults(&format!("dvrk_insertion/sweep_{name}.csv"));
        assert_eq!(kinds, [WarningKind::HeldRows]);
        assert!(held > 50, "{held}");
    }
    assert_eq!(faults("emps/identification.csv").0, []);
}

#[test]
fn the_published_friction_of_the_real_axis_appears_once_its_mass_is_out() {
    let Some(folder) = shared() else { return };
    let recording = read(&folder.join("emps/identification.csv"), &ReadOptions::default()).unwrap();
    let velocity = local_velocity(&recording, 0.02);
    let corrected = recording.without_moving_mass(95.1089, 0.0).unwrap();
    println!("{:?}", corrected.quality.notes);
    // Published: 203.5034 N s/m, 20.3935 N, offset -3.1648 N (Janot, Gautier, Brunot 2019).
    let squares: Vec<f64> = (0..corrected.len())
        .filter(|&k| velocity[k].abs() > 0.01)
        .map(|k| {
            let v: f64 = velocity[k];
            corrected.force[k] - (203.5034 * v + 20.3935 * v.signum() - 3.1648)
        })
        .map(|e| e * e)
        .collect();
    let rms = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    println!("rms {rms}");
    assert!(rms < 4.0, "{rms}");
}

/// Never without a unit, and never in the place of the force along the instrument.
#[test]
fn loads_beside_the_seal_are_read_with_their_units() {
    let text_of = |name: &str, per_si: f64| {
        let row = |k: u32| {
            let k = f64::from(k);
            format!("{},{k},{},{}\n", 0.1 * k, 0.1 * k, 1e-2 * k * per_si)
        };
        format!("time_s,position_mm,force_n,{name}\n{}", (0..20).map(row).collect::<String>())
    };
    let names = [
        ("side_force_n", 0, 1.0),
        ("Lateral force [mN]", 0, 1e3),
        ("tilt_rad", 1, 1.0),
        ("tilt angle (deg)", 1, 180.0 / std::f64::consts::PI),
        ("pressure_pa", 2, 1.0),
        ("Insufflation pressure [mmHg]", 2, 1.0 / 133.322_387_415),
        ("gas_pressure_kpa", 2, 1e-3),
    ];
    for (name, place, per_si) in names {
        let found = read(&Scratch::new().file(text_of(name, per_si)), &ReadOptions::default());
        let found = found.unwrap_or_else(|e| panic!("{name}: {e}"));
        let own = found.loads[place].as_ref().unwrap_or_else(|| panic!("{name} is a load"));
        assert!((own[19] - 0.19).abs() < 1e-12, "{name}: {}", own[19]);
        assert!((found.force[19] - 1.9).abs() < 1e-12 && found.angle.is_none(), "{name}");
        assert_eq!(found.loads.iter().flatten().count(), 1, "{name}");
    }
    for name in ["tilt", "side", "pressure", "side_valve_state"] {
        let found = read(&Scratch::new().file(text_of(name, 1.0)), &ReadOptions::default());
        assert_eq!(found.unwrap_or_else(|e| panic!("{name}: {e}")).loads, [None, None, None]);
    }
    let mapped = columns("time_s=time_s,position_mm=position_mm,force_n=force_n,side_force_n=fy");
    let found = read(&Scratch::new().file(text_of("fy", 1.0)), &mapped).unwrap();
    assert!((found.loads[0].as_ref().unwrap()[19] - 0.19).abs() < 1e-12);
}

/// As a column of any unit, named or mapped, in its place or by its name; never without a unit.
#[test]
fn a_torque_is_read_with_its_unit() {
    let text_of = |name: &str, per_si: f64| {
        let row = |k: u32| {
            let k = f64::from(k);
            format!("{},{k},{},{}\n", 0.1 * k, 0.1 * k, 1e-3 * k * per_si)
        };
        format!("time_s,position_mm,force_n,{name}\n{}", (0..20).map(row).collect::<String>())
    };
    let torque = |text: &str, options: &ReadOptions| {
        read(&Scratch::new().file(text), options).unwrap_or_else(|e| panic!("{e}")).torque
    };
    for (name, per_si) in [
        ("torque_n_m", 1.0),
        ("Torque [Nm]", 1.0),
        ("torque_nm", 1.0),
        ("moment (N mm)", 1e3),
        ("roll torque mNm", 1e3),
        ("torque_n_cm", 1e2),
    ] {
        let found = torque(&text_of(name, per_si), &ReadOptions::default());
        let found = found.unwrap_or_else(|| panic!("{name} is a torque"));
        assert!((found[19] - 0.019).abs() < 1e-12, "{name}: {}", found[19]);
    }
    for name in ["torque", "torque [N]", "effort"] {
        assert_eq!(torque(&text_of(name, 1.0), &ReadOptions::default()), None, "{name}");
    }
    for (name, mapping) in [
        ("Mz", "time_s=time_s,position_mm=position_mm,force_n=force_n,torque_n_mm=-Mz"),
        (
            "Mz [Nm]",
            "time_s=time_s,position_mm=position_mm,force_n=force_n,torque_n_m=-1e-3*Mz [Nm]",
        ),
        ("Mz", "time_s,position_mm,force_n,-torque_n_mm"),
    ] {
        let found = torque(&text_of(name, 1e3), &columns(mapping)).expect(mapping);
        assert!((found[19] + 0.019).abs() < 1e-12, "{mapping}: {}", found[19]);
    }
    // Both are in the reading of a force-torque sensor.
    let sensor = text_of("torque_n_m", 1.0).replace("force_n", "force_torque_fz_n");
    let found = read(&Scratch::new().file(sensor), &ReadOptions::default()).unwrap();
    assert!((found.force[19] - 1.9).abs() < 1e-12 && found.torque.is_some());
}
