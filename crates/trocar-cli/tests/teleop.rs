//! `trocar teleop`: what it prints, what it writes, and what it refuses.

use std::fs;

use trocar::table;

use crate::common::{Place, names_in};

const PAGE: &str = include_str!("../../../docs/explanation/teleoperation.md");
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
    let advised = far.stdout.split_once("compensate 100").expect("an advice").1;
    for printed in [&soft.stdout, advised] {
        assert!(PAGE.contains(&format!("{printed}```")), "not in the page:\n{printed}");
    }
}

#[test]
fn the_results_are_a_folder_and_json_is_its_summary() {
    let place = place(SOFT);
    let run = |folder: &str| {
        let command = format!("teleop loop.toml --model plausible --out {folder} --json");
        place.run(&command).ends_with(0).stdout
    };
    let printed = run("one");
    assert!(printed.contains("\"settles\": true"), "{printed}");
    let names = ["course.parquet", "figures", "hybrid.parquet", "report.html", "summary.json"];
    assert_eq!(names_in(&place.path("one")), names);
    assert_eq!(fs::read_to_string(place.path("one/summary.json")).unwrap(), printed);
    let course = table::read(place.path("one/course.parquet")).unwrap();
    assert_eq!((course.rows(), course.column("time_s").unwrap().len()), (4000, 4000));
    let drawn = names_in(&place.path("one/figures"));
    for figure in ["course", "depth", "energy", "hybrid", "transmitted"] {
        assert!(drawn.contains(&format!("{figure}.svg")), "{drawn:?}");
        assert!(drawn.contains(&format!("{figure}.png")), "{drawn:?}");
    }
    assert_eq!(run("two"), printed);
    for name in ["course.parquet", "hybrid.parquet", "report.html"] {
        let read = |folder: &str| fs::read(place.path(&format!("{folder}/{name}"))).unwrap();
        assert!(read("one") == read("two"), "{name}: the same loop gives the same bytes");
    }
}

/// A loop that diverges has no course; that of an earlier run is named.
#[test]
fn a_loop_that_diverges_leaves_no_course() {
    let place = place("[control]\nforce_gain = 50.0\n[channel]\ndelay_s = 0.01\n");
    let run = || place.run("teleop loop.toml --model plausible --out found").ends_with(3);
    run().says(&["diverged after"]);
    assert!(!names_in(&place.path("found")).contains(&"course.parquet".to_owned()));
    fs::write(place.path("found/course.parquet"), "earlier").unwrap();
    run().says(&["course.parquet is that of an earlier run"]);
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
    let command = format!("teleop loop.toml --model plausible --out found {options}");
    let ran = place.run(&command).ends_with(code);
    (ran.stdout, fs::read_to_string(place.path("found/report.html")).unwrap())
}

#[test]
fn the_report_shows_what_the_program_prints_and_needs_nothing_else() {
    let place = place(FAR);
    let fraction = "\n[compensation]\nfraction = 0.9\n";
    fs::write(place.path("loop.toml"), FAR.to_owned() + fraction).unwrap();
    let (printed, page) = report(&place, "--advise", 0);
    let text = text_of(&page);
    // All numbers of the lines that end with a unit.
    let numbers = printed.lines().flat_map(|line| {
        let mut words = line.split_whitespace().rev();
        let is_unit =
            words.next().is_some_and(|word| ["N/m", "N", "1", "mm", "mJ"].contains(&word));
        words.filter(move |word| is_unit && word.parse::<f64>().is_ok())
    });
    let numbers: Vec<&str> = numbers.collect();
    assert_eq!(numbers.len(), 2 * 12 + 3, "{printed}");
    for number in numbers {
        // A page writes a minus sign.
        let number = number.replace('-', "\u{2212}");
        assert!(text.contains(&format!(" {number} ")), "{number} is not in the page");
    }
    for words in ["stable", "100 %", "55 to 150 %", "Seed", "SHA-256", "loop.toml"] {
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
fn a_report_has_no_empty_axes() {
    let never = "[control]\nstiffness_n_m = 200000.0\n[channel]\ndelay_s = 0.1\n";
    let (_, page) = report(&place(never), "--advise", 3);
    let text = text_of(&page);
    assert!(
        text.contains(
            "There is no figure \u{201c}Error and stiffness over the fraction compensated"
        )
    );
    assert!(!page.contains("id=\"figure-fractions\""), "axes without a stable loop");
    let far_off = "[tissue]\nsurface_m = 0.5\n";
    let (_, page) = report(&place(far_off), "--advise", 3);
    assert!(page.contains("id=\"figure-fractions\"") && !page.contains("stiffness (N/m)"));
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
    let ran = place.run("teleop loop.toml --model plausible --out -").ends_with(2);
    ran.says(&["the results are a folder"]);
}

#[test]
fn the_map_and_the_fractions_are_in_the_report() {
    let (printed, page) = report(&place(SOFT), "--map --json", 0);
    let answer: serde_json::Value = serde_json::from_str(&printed).unwrap();
    let text = text_of(&page);
    let rows = answer["map"]["z_width_n_m"].as_array().unwrap().iter();
    for range in rows.flat_map(|row| row.as_array().unwrap()).filter_map(|cell| cell.get(0)) {
        let shown = format!("{:.0}", range[1].as_f64().unwrap());
        assert!(text.contains(&shown), "{shown}");
    }
    assert!(text.contains("Not computed: --advise"), "what is missing is stated");
}

/// Which loop ran comes first, what it means last; of a map eight rows of eight numbers.
#[test]
fn a_loop_is_named_and_put_into_words() {
    let ran = Place::new().run("teleop --model plausible --map").ends_with(0);
    let lines: Vec<&str> = ran.stdout.lines().collect();
    assert!(lines[0].starts_with("loop: the default "), "{}", ran.stdout);
    let last = lines.last().unwrap();
    assert!(last.contains(" N/m feels like ") && last.contains("masked"), "{last}");
    let head = lines.iter().position(|line| line.starts_with("stiffest tissue")).unwrap() + 1;
    let rows = lines[head..].iter().take_while(|line| !line.is_empty());
    let counts: Vec<usize> = rows.map(|row| row.split_whitespace().count()).collect();
    assert_eq!(counts, [8, 9, 9, 9, 9, 9, 9, 9, 9], "{}", ran.stdout);
}

#[test]
fn the_printed_loop_is_the_default() {
    let printed = Place::new().run("teleop --print-config").ends_with(0).stdout;
    let of = |config: &str| place(config).run("teleop loop.toml --model plausible").ends_with(0);
    assert_eq!(of(&printed).stdout, of("").stdout);
}

#[test]
fn loops_of_devices_are_printed_and_run() {
    for device in ["dvrk", "phantom"] {
        let printed = Place::new().run(&format!("teleop --print-config {device}")).ends_with(0);
        let ran = place(&printed.stdout).run("teleop loop.toml --model plausible").ends_with(0);
        assert!(ran.stdout.starts_with("loop: loop.toml, "), "{}", ran.stdout);
        assert!(ran.stdout.contains("\nstable with tissue of 0 to "), "{}", ran.stdout);
    }
    Place::new().run("teleop --print-config omni").ends_with(2).says(&["dvrk, phantom"]);
    Place::new().run("teleop omni").ends_with(2).says(&["omni: no such loop", "dvrk or phantom"]);
}

/// Intervals of 20 % for the Coulomb forces: with how many of the draws a fraction is stable is printed.
#[test]
fn advice_over_draws_counts_them() {
    let ems = include_str!("../../../conformance/models/ems.json");
    let mut model: serde_json::Value = serde_json::from_str(ems).unwrap();
    for direction in ["insertion", "withdrawal"] {
        let value = model["elements"][0][direction]["coulomb_force_n"].as_f64().unwrap();
        let ci95 = [0.8 * value, 1.2 * value];
        let interval = serde_json::json!({ "value": value, "ci95": ci95 });
        model["intervals"][format!("{direction}_coulomb_force_n")] = interval;
    }
    let place = place(&format!("{FAR}[motion]\nduration_s = 1.0\n"));
    fs::write(place.path("model.json"), model.to_string()).unwrap();
    let ran = place.run("teleop loop.toml --model model.json --advise --draws 4 --json");
    let printed: serde_json::Value = serde_json::from_str(&ran.stdout).unwrap();
    assert_eq!(printed["advice"]["pairs"], 7, "{ran:#?}");
    let shares = printed["advice"]["tried"].as_array().unwrap().iter();
    let shares: Vec<f64> = shares.map(|tried| tried["stable_share"].as_f64().unwrap()).collect();
    assert!(shares.contains(&1.0), "{shares:?}");
    let text = place.run("teleop loop.toml --model model.json --advise --draws 4").stdout;
    assert!(
        text.contains("best for each of the 7 pairs of compensator and trocar by itself: "),
        "{text}"
    );
    let both = "teleop loop.toml --model model.json --advise --compensator-draws 2 --json";
    let printed: serde_json::Value = serde_json::from_str(&place.run(both).stdout).unwrap();
    // The model, both ends for the trocar, both ends and two draws for the compensator.
    assert_eq!(printed["advice"]["pairs"], 7);
}

/// The hybrid matrix is that of strokes of the motion: without strokes there is none.
#[test]
fn a_hybrid_matrix_is_written_where_the_motion_has_strokes() {
    let written = |config: &str| {
        let place = place(config);
        place.run("teleop loop.toml --model plausible --out found");
        let path = place.path("found/hybrid.parquet");
        path.exists().then(|| table::read(path).unwrap())
    };
    let matrix = written(SOFT).unwrap();
    assert!(matrix.rows() == 61 && matrix.column("h11_real_n_s_m").is_some());
    assert!(written("[motion]\namplitude_m = 0.0\n").is_none());
}

#[test]
fn a_map_goes_up_to_the_delay_that_is_given() {
    let ran = place(SOFT).run("teleop loop.toml --model plausible --map 0.002 --json").ends_with(0);
    let printed: serde_json::Value = serde_json::from_str(&ran.stdout).unwrap();
    assert_eq!(printed["map"]["delays_s"], serde_json::json!([0.0, 0.001, 0.002]));
    assert_eq!(printed["map"]["fractions"].as_array().unwrap().len(), 20);
}

#[test]
fn energy_that_the_trocar_gives_back_is_printed_where_there_is_a_credit() {
    let passive = format!("{SOFT}[control]\npassivity = true\npassivity_reserve_j = 0.05\n");
    let credited = format!("{passive}passivity_credit = \"trocar\"\n");
    let printed = |config: &str| place(config).run("teleop loop.toml --model plausible").stdout;
    assert!(!printed(&passive).contains("energy credited from the trocar"));
    let with = printed(&credited);
    let line = with.lines().find(|line| line.contains("energy credited from the trocar")).unwrap();
    let credit: f64 = line.split_whitespace().rev().nth(1).unwrap().parse().unwrap();
    assert!(line.ends_with("mJ") && credit > 1.0, "{with}");
}

#[test]
fn four_channels_say_that_the_hand_needs_a_mass() {
    let four = "[control]\narchitecture = \"four_channel\"\n";
    place(four).run("teleop loop.toml --model plausible").ends_with(3).says(&["operator.mass_kg"]);
    let with = format!("[operator]\nmass_kg = 0.1\n{four}");
    place(&with).run("teleop loop.toml --model plausible").ends_with(0);
}

#[test]
fn a_tip_that_does_not_reach_the_tissue_is_reported() {
    let far_off = "[tissue]\nsurface_m = 0.5\n";
    let ran = place(far_off).run("teleop loop.toml --model plausible").ends_with(3);
    ran.says(&["does not reach the tissue"]);
    let none = "[tissue]\nsurface_m = 0.5\nkind = \"none\"\n";
    let free = place(none).run("teleop loop.toml --model plausible").ends_with(0);
    assert!(!free.stdout.contains("stable with tissue"), "{}", free.stdout);
    let inside = place("[motion]\namplitude_m = -0.02\n").run("teleop loop.toml --model plausible");
    inside.ends_with(3).says(&["begins in the tissue"]);
    let advised = place(far_off).run("teleop loop.toml --model plausible --advise").ends_with(3);
    assert!(
        advised.stdout.contains("no advice: the tip does not reach the tissue"),
        "{advised:#?}"
    );
    assert!(!advised.stdout.contains("\ncompensate "), "{}", advised.stdout);
}

/// A light grip and too much compensated: in the tissue the loop rests, without it it does not.
#[test]
fn an_unstable_loop_is_told_from_one_that_is_unstable_without_tissue() {
    let stiff = "[channel]\ndelay_s = 0.01\n[tissue]\nstiffness_n_m = 3000.0\n[compensation]\nfraction = 1.0\n";
    let light =
        "[operator]\nstiffness_n_m = 20.0\ndamping_n_s_m = 2.0\n[compensation]\nfraction = 1.25\n";
    for (config, finding, words) in [
        (stiff, "push_into_tissue", "a push into the tissue"),
        (light, "push_without_tissue", "a push without tissue"),
    ] {
        let place = place(config);
        let ran = place.run("teleop loop.toml --model plausible").ends_with(3);
        ran.says(&[&format!("it does not come to rest after {words}")]);
        let json = place.run("teleop loop.toml --model plausible --json").stdout;
        assert!(json.contains(&format!("\"unsettled_by\": \"{finding}\"")), "{json}");
    }
}

#[test]
fn adaptation_needs_the_error_of_the_model() {
    let adaptive = "[compensation]\nadaptation = true\nfraction = 1.0\n";
    let ran = place(adaptive).run("teleop loop.toml --model plausible").ends_with(1);
    ran.says(&["compensation.force_error_n"]);
    let stated = format!("{adaptive}force_error_n = 0.1\n");
    place(&stated).run("teleop loop.toml --model plausible").ends_with(0);
}

#[test]
fn what_is_no_loop_is_refused() {
    for (config, words) in [
        ("seed = 9007199254740993", ["loop.toml", "seed", "at most 9007199254740992"]),
        ("[leader]\nmass_kg = -1.0", ["loop.toml", "leader.mass_kg", "from 1e-6 to 1e15, got -1"]),
        ("[channel]\ndelay_s = 0.0015", ["channel.delay_s", "0.0015 s", "take 0.002 s"]),
        ("[tissue]\nstifness_n_m = 1.0", ["stifness_n_m", "line 2", "--print-config"]),
    ] {
        let place = place(config);
        place.run("teleop loop.toml --model plausible --out none").ends_with(1).says(&words);
        assert!(!place.path("none").exists());
    }
    for (config, options, words) in [
        (
            SOFT,
            "--advise --compensator-draws 5",
            "--compensator-draws needs a model with 95 % intervals",
        ),
        (SOFT, "--advise --draws 5", "a model with 95 % intervals"),
        (SOFT, "--least-friction 0.5", "--advise"),
        (SOFT, "--advise --least-friction 1.5", "must be from 0.01 to 1"),
        (SOFT, "--map 0.0001", "from the sample time, 0.001 s, to 10 000 times that, got 0.0001 s"),
        ("[tissue]\nkind = \"none\"", "--map", "there is no tissue"),
        ("[tissue]\nkind = \"none\"", "--advise", "there is no tissue"),
        ("[sensor]\nplace = \"tip\"", "--advise", "changes nothing in this loop"),
        ("[control]\narchitecture = \"wave\"", "--map", "changes nothing in this loop"),
    ] {
        let ran = place(config).run(&format!("teleop loop.toml --model plausible {options}"));
        ran.ends_with(2).says(&[words]);
    }
    place("").run("teleop loop.toml --model none.json").ends_with(1).says(&["none.json"]);
}
