//! `trocar teleop`: what it prints, what it writes, and what it refuses.

use std::fs;

use crate::common::Place;

const PAGE: &str = include_str!("../../../docs/teleoperation.md");
const SOFT: &str = "[tissue]\nstiffness_n_m = 50.0\n";
const FAR: &str = "[channel]\ndelay_s = 0.01\n[tissue]\nstiffness_n_m = 400.0\n";

fn place(config: &str) -> Place {
    let place = Place::new();
    fs::write(place.path("loop.toml"), config).unwrap();
    place
}

#[test]
fn the_page_shows_what_the_program_prints() {
    let soft = place(SOFT).run("teleop loop.toml --model plausible").ends_with(0);
    let far = place(FAR).run("teleop loop.toml --model plausible --advise").ends_with(3);
    for printed in [soft.stdout, far.stdout] {
        assert!(PAGE.contains(&format!("```text\n{printed}```")), "not in the page:\n{printed}");
    }
}

#[test]
fn a_course_is_written_and_json_printed() {
    let place = place(SOFT);
    let ran = place.run("teleop loop.toml --model plausible --out course.csv --json").ends_with(0);
    assert!(ran.stdout.contains("\"settles\": true"), "{}", ran.stdout);
    let course = fs::read_to_string(place.path("course.csv")).unwrap();
    assert!(course.starts_with("time_s,hand_position_m,master_position_m,slave_position_m,"));
    assert_eq!(course.lines().count(), 4001);
    let again = place.run("teleop loop.toml --model plausible --out - ").ends_with(0);
    assert_eq!(again.stdout, course, "the same loop gives the same course");
}

#[test]
fn the_printed_loop_is_the_default() {
    let printed = Place::new().run("teleop --print-config").ends_with(0).stdout;
    let of = |config: &str| place(config).run("teleop loop.toml --model plausible").ends_with(0);
    assert_eq!(of(&printed).stdout, of("").stdout);
}

#[test]
fn what_is_no_loop_is_refused() {
    for (config, words) in [
        ("[master]\nmass_kg = -1.0", ["loop.toml", "master.mass_kg", "from 1e-6 to 1e15, got -1"]),
        ("[channel]\ndelay_s = 0.0015", ["channel.delay_s", "0.0015 s", "take 0.002 s"]),
        ("[tissue]\nstifness_n_m = 1.0", ["stifness_n_m", "line 2", "--print-config"]),
    ] {
        let place = place(config);
        place.run("teleop loop.toml --model plausible --out none.csv").ends_with(1).says(&words);
        assert!(!place.path("none.csv").exists());
    }
    for (config, options, words) in [
        (SOFT, "--out - --json", "leave out --json"),
        ("[sensor]\nplace = \"tip\"", "--advise", "changes nothing in this loop"),
        ("[control]\narchitecture = \"wave\"", "--map", "changes nothing in this loop"),
    ] {
        let ran = place(config).run(&format!("teleop loop.toml --model plausible {options}"));
        ran.ends_with(2).says(&[words]);
    }
    place("").run("teleop loop.toml --model none.json").ends_with(1).says(&["none.json"]);
}
