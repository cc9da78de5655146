//! `trocar plan` and `trocar bench --motion`: what they print, what they write, and what they refuse.

use std::fs;

use crate::common::Place;

const PAGE: &str = include_str!("../../../docs/explanation/plan.md");

/// A plan that takes little time: two seals, the reserve and little more.
const SMALL: &str = "duration_s = 60.0\ndraws = 2\n[rig]\nsample_rate_hz = 200.0\n";

fn place(rig: &str) -> Place {
    let place = Place::new();
    fs::write(place.path("rig.toml"), rig).unwrap();
    place
}

/// Columns of a table of numbers.
fn columns(text: &str) -> Vec<Vec<f64>> {
    let rows = text.lines().skip(1).map(|line| line.split(',').map(|cell| cell.parse().unwrap()));
    let rows: Vec<Vec<f64>> = rows.map(Iterator::collect).collect();
    (0..rows[0].len()).map(|k| rows.iter().map(|row| row[k]).collect()).collect()
}

#[test]
fn a_plan_is_a_motion_that_the_bench_makes() {
    let place = place(SMALL);
    let ran = place.run("plan rig.toml --out motion.csv").ends_with(0);
    assert!(ran.stdout.contains("viscous damping β"), "{}", ran.stdout);
    let motion = fs::read_to_string(place.path("motion.csv")).unwrap();
    assert!(motion.starts_with("time_s,position_m\n"));
    let planned = columns(&motion);
    let end = *planned[0].last().unwrap();
    assert!((40.0..=60.0).contains(&end), "{end} s of the 60 s allowed");
    assert!(planned[1].iter().all(|x| (0.02..=0.14).contains(x)));
    place.run("bench --motion motion.csv --out recorded.csv").ends_with(0);
    let recorded = columns(&fs::read_to_string(place.path("recorded.csv")).unwrap());
    // The drive follows within a millimetre, at a rate of its own.
    let at =
        |time: f64| planned[1][planned[0].partition_point(|t| *t < time).min(planned[0].len() - 1)];
    let off =
        recorded[0].iter().zip(&recorded[1]).map(|(t, x)| (x - at(*t)).abs()).fold(0.0, f64::max);
    assert!(off < 1e-3, "{off} m beside the motion");
}

/// Words and numbers of the lines of a text.
fn numbers(text: &str) -> Vec<(Vec<&str>, Vec<f64>)> {
    text.lines()
        .map(|line| {
            let (numbers, words): (Vec<&str>, Vec<&str>) =
                line.split_whitespace().partition(|word| word.parse::<f64>().is_ok());
            (words, numbers.iter().map(|n| n.parse().unwrap()).collect())
        })
        .collect()
}

/// Processors round differently: the motion is the same, intervals agree within a per cent.
#[test]
fn the_page_shows_the_plan_for_a_rig_like_the_papers() {
    let printed = Place::new().run("plan --out motion.csv").ends_with(0).stdout;
    let from = PAGE.find("for all parameters:").expect("the plan is shown");
    let shown = &PAGE[from..from + PAGE[from..].find("```").expect("its end")];
    let shown = shown.split("\n$ ").next().unwrap();
    let pairs = numbers(&printed);
    assert_eq!(numbers(shown).len(), pairs.len(), "the page does not show\n{printed}");
    for ((words, own), (others, theirs)) in numbers(shown).into_iter().zip(pairs) {
        assert_eq!(words, others);
        let near = |(a, b): (&f64, &f64)| (a - b).abs() <= 1e-2 * a.abs() + 1e-4;
        assert!(own.iter().zip(&theirs).all(near), "{words:?} {own:?}, found {theirs:?}");
    }
}

#[test]
fn json_holds_what_the_text_shows_and_seeds_draw_other_seals() {
    let place = place(SMALL);
    let json = |options: &str| -> serde_json::Value {
        let ran = place.run(&format!("plan rig.toml --json --out motion.csv {options}"));
        serde_json::from_str(&ran.ends_with(0).stdout).unwrap()
    };
    let value = |plan: &serde_json::Value, name: &str| {
        let all = plan["expected"].as_array().unwrap();
        all.iter().find(|p| p["name"] == name).unwrap()["value"].as_f64().unwrap()
    };
    let plan = json("--for viscous_damping_n_s_m:5%");
    assert_eq!(plan["goal"], "viscous_damping_n_s_m to 5 %");
    assert!(plan["needed_s"].as_f64().unwrap() > 0.0);
    assert_eq!(plan, json("--for viscous_damping_n_s_m:5%"), "the same again");
    let like = json("--like dobbelsteen-2007");
    assert!((0.25..=3.0).contains(&value(&like, "coulomb_force_n")), "{like}");
    fs::write(place.path("rig.toml"), SMALL.replacen("draws", "seed = 2\ndraws", 1)).unwrap();
    let other = json("--for viscous_damping_n_s_m:5%");
    assert_ne!(value(&plan, "half_width_m"), value(&other, "half_width_m"), "other seals");
}

#[test]
fn a_pilot_gives_the_limits_and_counts() {
    let place = Place::new();
    place.run("bench steady --out pilot.csv").ends_with(0);
    place.run("identify pilot.csv --moving-mass-kg 0.04 --out pilot").ends_with(0);
    let command = "plan --model pilot --after pilot.csv --for viscous_damping_n_s_m --duration-s 40 --out next.csv";
    let ran = place.run(command);
    assert!(matches!(ran.code, Some(0 | 3)), "{ran:#?}");
    // The paper's protocol on the rig that has just made it.
    assert!(ran.stdout.contains("paper's protocol, 10"), "{}", ran.stdout);
    let motion = columns(&fs::read_to_string(place.path("next.csv")).unwrap());
    let speeds = motion[1].windows(2).zip(motion[0].windows(2));
    let fastest = speeds.map(|(x, t)| ((x[1] - x[0]) / (t[1] - t[0])).abs()).fold(0.0, f64::max);
    assert!((0.095..0.105).contains(&fastest), "{fastest} m/s, the pilot's fastest is 0.1 m/s");
}

#[test]
fn the_report_shows_the_motion_and_what_to_expect() {
    let place = place(SMALL);
    let ran = place.run("plan rig.toml --out motion.csv --report page.html").ends_with(0);
    let page = fs::read_to_string(place.path("page.html")).unwrap();
    for part in [
        "What to record",
        "id=\"figure-motion\"",
        "Half widths of the 95 % intervals",
        "rig.toml, SHA-256",
    ] {
        assert!(page.contains(part), "no {part}");
    }
    assert!(!page.contains("src=\"http"), "the page needs nothing else");
    let rows =
        ran.stdout.lines().filter(|line| line.contains(" strokes ") || line.contains(" of "));
    assert!(rows.count() > 3, "{}", ran.stdout);
}

#[test]
fn what_cannot_be_planned_is_refused_and_leaves_nothing() {
    let place = place(SMALL);
    for (rig, arguments, code, essentials) in [
        ("", "plan rig.toml", 2, ["--out", "required"]),
        ("", "plan rig.toml --out a.csv --for speed", 2, ["\"speed\"", "viscous_damping_n_s_m"]),
        ("", "plan rig.toml --out a.csv --like none", 2, ["\"none\"", "dobbelsteen-2007"]),
        ("", "plan rig.toml --out a.csv --like ems-2010", 2, ["no friction force", "imeche-2015"]),
        ("", "plan rig.toml --out a.csv --after b.csv", 2, ["--after", "--model"]),
        ("", "plan rig.toml --out - --json", 2, ["--out -", "hint"]),
        ("", "plan rig.toml --out a.csv --report -", 2, ["--report -", "file"]),
        ("", "plan absent.toml --out a.csv", 1, ["absent.toml", "cannot read the rig"]),
        ("", "plan --out a.csv --model absent", 1, ["absent", "No such"]),
        ("duration_s = 8.0\n", "plan rig.toml --out a.csv", 1, ["duration_s = 8 s", "takes"]),
        (
            "[rig]\nhighest_m = 0.05\n",
            "plan rig.toml --out a.csv",
            1,
            ["travel of 30.0 mm is too short", "hint"],
        ),
        (
            "[rig]\nspeed_m_s = 1.0\n",
            "plan rig.toml --out a.csv",
            1,
            ["speed_m_s", "--print-config"],
        ),
        ("draws = 0\n", "plan rig.toml --out a.csv", 1, ["draws must be from 1 to 1000", "got 0"]),
        ("[noise]\nforce_n = nan\n", "plan rig.toml --out a.csv", 1, ["noise.force_n", "NaN"]),
        ("[prior]\nlike = \"none\"\n", "plan rig.toml --out a.csv", 1, ["prior.like", "\"none\""]),
        (
            "[prior]\nlike = \"imeche-2015\"\ncoulomb_force_n = [1.0, 2.0]\n",
            "plan rig.toml --out a.csv",
            1,
            ["prior.like and prior.coulomb_force_n", "leave out one"],
        ),
    ] {
        fs::write(place.path("rig.toml"), rig).unwrap();
        place.run(arguments).ends_with(code).says(&essentials);
        assert_eq!(place.names(), ["rig.toml"], "{arguments}");
    }
}

#[test]
fn the_least_time_that_is_named_suffices() {
    let place = place("duration_s = 8.0\ndraws = 1\n[rig]\nsample_rate_hz = 200.0\n");
    let refused = place.run("plan rig.toml --out a.csv").ends_with(1).stderr;
    let words: Vec<&str> = refused.split_whitespace().collect();
    let at = words.iter().position(|word| *word == "takes").unwrap();
    let least: f64 = words[at + 1].parse().unwrap();
    place.run(&format!("plan rig.toml --out a.csv --duration-s {least}")).ends_with(0);
    let less = least - 0.01;
    place.run(&format!("plan rig.toml --out b.csv --duration-s {less}")).ends_with(1);
}

#[test]
fn motions_that_the_bench_cannot_make_are_refused() {
    let place = Place::new();
    fs::write(place.path("good.csv"), "t,x\n0,20\n1,30\n2,20\n").unwrap();
    for (motion, options, code, essentials) in [
        ("time_s,position_m\n0,0.02\n1,0.5\n", "", 1, ["0.5 m", "0 to 0.16 m"]),
        ("time_s,position_m\n0,0.02\n1e7,0.03\n", "", 1, ["1.000e7 s", "at most 5e6 samples"]),
        ("time_s,position_m\n0,0.02\n", "", 1, ["motion.csv", "1 times"]),
        ("time_s,position_m\n0,0.02\n1,nan\n2,0.02\n", "", 1, ["motion.csv line 3", "nan"]),
        ("time_s,position_m\n0,0.02\n2,0.03\n1,0.02\n", "", 1, ["motion.csv line 4", "goes back"]),
        ("when,where\n0,0.02\n1,0.03\n", "", 1, ["motion.csv line 1", "--columns"]),
        ("time_s,position_m\n0,0.02\n1,0.03\n", "steady", 2, ["--motion", "cannot be used"]),
    ] {
        fs::write(place.path("motion.csv"), motion).unwrap();
        let command = format!("bench {options} --motion motion.csv --out a.csv");
        place.run(&command).ends_with(code).says(&essentials);
        assert_eq!(place.names(), ["good.csv", "motion.csv"], "{command}");
    }
    place.run("bench steady --rate-hz 100 --out a.csv").ends_with(2).says(&["--motion"]);
    place.run("bench --motion good.csv --columns time_s,position_mm --out a.csv").ends_with(0);
}
