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

/// The page's text: without scripts, styles and tags.
fn text_of(page: &str) -> String {
    let mut text = String::new();
    let mut rest = page;
    while let Some(at) = rest.find('<') {
        text += &rest[..at];
        let skipped =
            ["script", "style", "svg"].iter().find(|tag| rest[at + 1..].starts_with(**tag));
        let end = skipped.map_or_else(|| ">".to_owned(), |tag| format!("</{tag}>"));
        let from = rest[at..].find(&end).unwrap() + at + end.len();
        text.push(' ');
        rest = &rest[from..];
    }
    text + rest
}

fn report(place: &Place, options: &str, code: i32) -> (String, String) {
    let command = format!("teleop loop.toml --model plausible --report page.html {options}");
    let ran = place.run(&command).ends_with(code);
    (ran.stdout, fs::read_to_string(place.path("page.html")).unwrap())
}

#[test]
fn the_report_shows_what_the_program_prints_and_needs_nothing_else() {
    let place = place(FAR);
    let fraction = "\n[compensation]\nfraction = 0.9\n";
    fs::write(place.path("loop.toml"), FAR.to_owned() + fraction).unwrap();
    let (printed, page) = report(&place, "--advise", 0);
    let text = text_of(&page);
    let numbers = printed.lines().filter_map(|line| {
        let mut words = line.split_whitespace().rev();
        let is_unit = ["N/m", "N", "1", "mm"].contains(&words.next()?);
        words.next().filter(|word| is_unit && word.parse::<f64>().is_ok())
    });
    let numbers: Vec<&str> = numbers.collect();
    assert_eq!(numbers.len(), 12, "{printed}");
    for number in numbers {
        assert!(text.contains(&format!(" {number} ")), "{number} is not in the page");
    }
    for words in ["stable", "100 %", "67.5 to 150 %", "Seed", "SHA-256", "loop.toml"] {
        assert!(text.contains(words), "{words}");
    }
    assert_eq!(report(&place, "--advise", 0).1, page, "the same loop gives the same bytes");
    let shown = page.split("<script").next().unwrap();
    for outside in ["src=", "href=\"http", "url(", "@import", "<link"] {
        assert!(!shown.contains(outside), "{outside}");
    }
    assert!(!text.contains("NaN") && !text.contains("inf "), "a number that is none");
    let folder = place.path(".").canonicalize().unwrap();
    assert!(!page.contains(folder.to_str().unwrap()), "a folder of this machine");
}

#[test]
fn an_unstable_loop_has_a_report_without_figures_of_merit() {
    let wild = "[control]\nstiffness_n_m = 200000.0\n[channel]\ndelay_s = 0.1\n";
    for (config, words) in [(FAR, "does not come to rest"), (wild, "diverged after 0.3910 s")] {
        let text = text_of(&report(&place(config), "", 3).1);
        assert!(text.contains("unstable") && text.contains(words), "{words}");
        for figure in ["stiffness displayed", "just noticeable differences, rms", "NaN"] {
            assert!(!text.contains(figure), "{figure}");
        }
    }
    let place = place(FAR);
    let ran = place.run("teleop loop.toml --model plausible --report -").ends_with(2);
    ran.says(&["needs a file"]);
}

#[test]
fn the_map_and_the_fractions_are_in_the_report() {
    let (printed, page) = report(&place(SOFT), "--map --json", 0);
    let answer: serde_json::Value = serde_json::from_str(&printed).unwrap();
    let text = text_of(&page);
    for row in answer["map"]["stiffness_n_m"].as_array().unwrap() {
        for stiffness in row.as_array().unwrap() {
            let shown = format!(" {:.0} ", stiffness.as_f64().unwrap());
            assert!(text.contains(&shown), "{shown}");
        }
    }
    assert!(text.contains("Not asked for: --advise"), "what is missing is said");
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
