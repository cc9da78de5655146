//! Recordings as they are really written: each is read right by itself, or the option in the hint
//! reads it right, or it is refused with a reason. Every option in a hint is run.

use std::fmt::Write as _;
use std::fs;

use crate::common::{Place, Ran};

/// Coulomb force of the recordings that the tests make, N.
const FORCE: f64 = 3.0;

/// Relative difference allowed: noise of 1 % and numbers of four digits.
const CLOSE: f64 = 0.02;

/// Options of the identification: only its first steps, because F_c is compared.
const IDENTIFY: &str = "--paper --out out";

/// Interval between samples, s.
const STEP: f64 = 2e-3;

/// What a file needs.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Way {
    /// No option.
    Plain,
    /// The first option of the hint.
    Hint,
    /// Another file: the refusal says so.
    Refused(&'static str),
}

use Way::{Hint, Plain, Refused};

/// Strokes of 60 mm at four speeds: time in s, position in m, force in N with the friction of 3 N.
fn motion() -> Vec<[f64; 3]> {
    let (mut rows, mut t) = (Vec::new(), 0.0);
    for cycle in 0..4 {
        let speed = 0.02 * (1 + cycle % 4) as f64;
        let count = (0.06 / (speed * STEP)).round() as usize;
        for (sign, from) in [(1.0, 0.0), (-1.0, 0.06)] {
            for k in 0..count {
                let travel = speed * STEP * k as f64;
                let noise = 0.03 * ((rows.len() * 7919 % 101) as f64 / 50.0 - 1.0);
                let force = FORCE * sign * (travel / 0.004 - 1.0).min(1.0) + noise;
                rows.push([t, from + sign * travel, force]);
                t += STEP;
            }
        }
    }
    rows
}

/// A file with these numbers per SI unit.
fn file(header: &str, separator: &str, per_si: [f64; 3]) -> String {
    let mut text = format!("{header}\n");
    for row in motion() {
        let [t, x, f] = [0, 1, 2].map(|k| row[k] * per_si[k]);
        let _ = writeln!(text, "{t:.9}{separator}{x:.9}{separator}{f:.9}");
    }
    text
}

/// Each row written by `cells`.
fn rows(header: &str, cells: impl Fn(usize, [f64; 3]) -> String) -> String {
    let mut text = format!("{header}\n");
    for (k, row) in motion().into_iter().enumerate() {
        let _ = writeln!(text, "{}", cells(k, row));
    }
    text
}

/// `1.234` for 1234.
fn grouped(number: f64) -> String {
    let (sign, size) = (if number < -0.5 { "-" } else { "" }, number.abs().round() as u64);
    match size {
        ..1000 => format!("{sign}{size}"),
        _ => format!("{sign}{}.{:03}", size / 1000, size % 1000),
    }
}

const KP: f64 = 9.80665;

fn units() -> Vec<(String, Way)> {
    let mut all = Vec::new();
    let with_force = |header: &str, per_si: f64| {
        file(&format!("time_s,position_m,{header}"), ",", [1.0, 1.0, per_si])
    };
    for (unit, per_si) in [
        ("N", 1.0),
        ("mN", 1e3),
        ("cN", 1e2),
        ("daN", 0.1),
        ("kp", 1.0 / KP),
        ("kgf", 1.0 / KP),
        ("gf", 1e3 / KP),
        ("dyn", 1e5),
        ("lbf", 1.0 / 4.448_221_615),
        ("µN", 1e6),
    ] {
        let forms = if ["daN", "mN"].contains(&unit) { 5 } else { 1 };
        let headers = ["F [U]", "F (U)", "F_U", "F / U", "F/U"];
        for header in headers.into_iter().take(forms) {
            all.push((with_force(&header.replace('U', unit), per_si), Plain));
        }
        let rows_of_units = format!("Zeit;Weg;Kraft\ns;mm;{unit}");
        all.push((file(&rows_of_units, ";", [1.0, 1e3, per_si]), Plain));
    }
    for (unit, per_si) in [
        ("ft", 1.0 / 0.3048),
        ("mil", 1.0 / 25.4e-6),
        ("in", 1.0 / 25.4e-3),
        ("µm", 1e6),
        ("μm", 1e6),
        ("nm", 1e9),
    ] {
        all.push((
            file(&format!("time_s,position [{unit}],force_n"), ",", [1.0, per_si, 1.0]),
            Plain,
        ));
    }
    for (unit, per_si) in [("h", 1.0 / 3600.0), ("min", 1.0 / 60.0), ("ms", 1e3), ("ns", 1e9)] {
        all.push((
            file(&format!("time [{unit}],position_m,force_n"), ",", [per_si, 1.0, 1.0]),
            Plain,
        ));
    }
    for (unit, what) in [
        ("V", "'F [V]' is a voltage, expected a force in N, mN"),
        ("A", "is a current"),
        ("kPa", "is a pressure"),
        ("Nm", "is a torque"),
        ("counts", "is a count"),
        ("foo", "has a unit that is not known for force, expected one of N, mN"),
    ] {
        all.push((with_force(&format!("F [{unit}]"), 1.0), Refused(what)));
    }
    for (header, what) in [
        ("pos [deg]", "is an angle"),
        ("pos [counts]", "is a count"),
        ("pos [kg]", "not known for position"),
    ] {
        all.push((file(&format!("time_s,{header},force_n"), ",", [1.0, 1.0, 1.0]), Refused(what)));
    }
    all
}

fn names() -> Vec<(String, Way)> {
    vec![
        (file("t,x,Fz", ",", [1e3, 1e3, 1.0]), Hint),
        (file("when,way,pull", ",", [1.0, 1.0, 1e3]), Hint),
        (file("time_s,position,force_n", ",", [1.0, 1e3, 1.0]), Hint),
        (
            rows("time_s,position_m,Fx_n,Fy_n,Fz_n", |_, [t, x, f]| {
                format!("{t:.3},{x},0.1,0.2,{f}")
            }),
            Hint,
        ),
        (
            rows("time_s,position_m,force_n,force_n", |_, [t, x, f]| format!("{t:.3},{x},{f},0.1")),
            Hint,
        ),
        (
            rows("time_s,x_m,y_m,z_m,force_n", |_, [t, x, f]| {
                format!("{t:.3},0.001,0.002,{x},{f}")
            }),
            Plain,
        ),
        (
            rows("time_s,x_m,y_m,z_m,force_n", |k, [t, x, f]| {
                format!("{t:.3},{},0.002,{x},{f}", 1e-5 * (k % 1000) as f64)
            }),
            Hint,
        ),
        (
            rows("time_s,force_x_n,force_z_n,position_m", |_, [t, x, f]| {
                format!("{t:.3},0.1,{f},{x}")
            }),
            Hint,
        ),
        (file(",,\ns,mm,N", ",", [1.0, 1e3, 1.0]), Plain),
        (rows("0.000,0.0,0.0", |_, [t, x, f]| format!("{:.3},{x},{f}", t + 0.001)), Hint),
        (
            rows("time_s,position_m,force_n\nA,B,C\ntime_s,position_m,force_n", |_, [t, x, f]| {
                format!("{t:.3},{x},{f}")
            }),
            Hint,
        ),
        (rows("time_s,position_m,force_n", |_, [t, x, f]| format!("{t:.3},{x},{}", -f)), Hint),
    ]
}

fn sizes() -> Vec<(String, Way)> {
    let whole = |scale: [f64; 3], separator: &'static str| {
        move |_: usize, row: [f64; 3]| [0, 1, 2].map(|k| grouped(row[k] * scale[k])).join(separator)
    };
    vec![
        (file("time_s,position_m,force_n", ",", [1e3, 1.0, 1.0]), Hint),
        (file("time_us,position_m,force_n", ",", [1e3, 1.0, 1.0]), Hint),
        (file("time_s,position_m,force_n", ",", [1.0, 1e3, 1.0]), Hint),
        (file("time_s,position_um,force_n", ",", [1.0, 1e3, 1.0]), Hint),
        (file("time_s,position_m,force_n", ",", [1.0, 1.0, 1e3]), Hint),
        (rows("sample,position_m,force_n", |k, [_, x, f]| format!("{k},{x},{f}")), Hint),
        (rows(",position,force_n", |k, [_, x, f]| format!("{k},{},{f}", 1e3 * x)), Hint),
        (rows("position_m,force_n", |_, [_, x, f]| format!("{x},{f}")), Hint),
        (rows("0,0.0,0.0", |k, [_, x, f]| format!("{},{x},{f}", k + 1)), Hint),
        (rows("Zeit [ms];Weg [µm];Kraft [mN]", whole([1e3, 1e6, 1e3], ";")), Plain),
    ]
}

/// The options in the hint of a message, each as its words; those that belong together are one.
fn options(message: &str) -> Vec<Vec<String>> {
    let Some((_, hint)) = message.split_once("hint:") else { return Vec::new() };
    let mut all: Vec<Vec<String>> = Vec::new();
    let mut rest = hint;
    let mut follows = false;
    while let Some(at) = rest.find("--") {
        follows &= rest[..at].trim().is_empty();
        let (name, behind) = rest[at..].split_once([' ', '\n']).unwrap_or((&rest[at..], ""));
        let mut words = vec![name.trim_end_matches([';', ',', '.']).to_owned()];
        rest = behind;
        // The only one without a value.
        if words[0] != "--flip-force" {
            let (value, behind) = match behind.strip_prefix('\'') {
                Some(quoted) => quoted.split_once('\'').expect("a quote that ends"),
                None => behind.split_once([' ', '\n']).unwrap_or((behind, "")),
            };
            words.push(value.trim_end_matches([';', '.']).to_owned());
            rest = behind;
        }
        match all.last_mut().filter(|_| follows) {
            Some(last) => last.extend(words),
            None => all.push(words),
        }
        follows = true;
    }
    all
}

/// The Coulomb force that was printed, if the identification has come to an end.
fn force(ran: &Ran) -> Option<f64> {
    let line = ran.stdout.lines().find(|line| line.contains("Coulomb force F_c "))?;
    let value = line.split("F_c ").nth(1)?.split_whitespace().next()?.parse().ok()?;
    matches!(ran.code, Some(0 | 3)).then_some(value)
}

fn assert_right(ran: &Ran, what: &str) {
    let found = force(ran).unwrap_or_else(|| panic!("{what}: {ran:#?}"));
    assert!((found / FORCE - 1.0).abs() < CLOSE, "{what}: {found} N: {ran:#?}");
}

#[test]
fn every_odd_file_is_read_right_in_two_commands_and_every_hint_runs() {
    let place = Place::new();
    let run = |options: &[String]| {
        let _ = fs::remove_dir_all(place.path("out"));
        let mut command = place.command(&format!("identify odd.csv {IDENTIFY}"));
        Ran::from(command.args(options).output().unwrap())
    };
    for (contents, way) in units().into_iter().chain(names()).chain(sizes()) {
        let header: String = contents.lines().take(2).collect::<Vec<_>>().join(" | ");
        fs::write(place.path("odd.csv"), &contents).unwrap();
        let first = run(&[]);
        let hints = options(&first.stderr);
        match way {
            Plain => assert_right(&first, &header),
            Hint => {
                assert_eq!(first.code, Some(1), "{header}: {first:#?}");
                let option = hints.first().unwrap_or_else(|| panic!("{header}: {first:#?}"));
                assert_right(&run(option), &format!("{header} with {option:?} of {first:#?}"));
            }
            Refused(why) => {
                assert_eq!((first.code, hints.len()), (Some(1), 0), "{header}: {first:#?}");
                first.says(&[why, "hint: "]);
            }
        }
        // The other ways out are for other files, but none is a wrong use of the program.
        for option in hints.iter().skip(1) {
            let ran = run(option);
            assert!(matches!(ran.code, Some(0 | 1 | 3)), "{header} with {option:?}: {ran:#?}");
        }
    }
}

/// A column that is said stays said, a wrong one is answered with the file's own, and a later option
/// replaces an earlier one.
#[test]
fn hints_complete_what_the_user_has_said() {
    let place = Place::new();
    let contents =
        rows("time,position_m,Fz,Fy", |_, [t, x, f]| format!("{:.0},{x},{f},0.1", 1e3 * t));
    fs::write(place.path("odd.csv"), contents).unwrap();
    for said in ["force_n=Fz", "force_n=Fz,position_m=nowhere", "time_ms=never,force_n=Fz"] {
        let _ = fs::remove_dir_all(place.path("out"));
        let first = place.run(&format!("identify odd.csv {IDENTIFY} --columns {said}"));
        let option = options(&first.stderr).remove(0);
        let mut command = place.command(&format!("identify odd.csv {IDENTIFY} --columns {said}"));
        assert_right(
            &Ran::from(command.args(&option).output().unwrap()),
            &format!("{said}: {option:?}"),
        );
    }
}
