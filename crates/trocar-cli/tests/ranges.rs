//! `trocar ranges`, and `trocar bench --like`.

use std::fs;

use crate::common::Place;

#[test]
fn the_page_shows_what_the_program_prints() {
    let page = fs::read_to_string("../../docs/reference/published.md").unwrap();
    let place = Place::new();
    for study in ["", "dobbelsteen-2007", "imeche-2015", "ems-2010"] {
        let printed = place.run(&format!("ranges {study}")).ends_with(0).stdout;
        assert!(page.contains(&format!("```text\n{printed}```")), "not in the page:\n{printed}");
    }
}

#[test]
fn json_holds_the_same_studies() {
    let place = Place::new();
    let json = |arguments: &str| -> serde_json::Value {
        serde_json::from_str(&place.run(arguments).ends_with(0).stdout).unwrap()
    };
    let all = json("ranges --json");
    assert_eq!(all[0], json("ranges dobbelsteen-2007 --json"));
    assert_eq!(all[0]["numbers"][0]["quantity"], "friction_force_n");
    assert_eq!(all[0]["drawn"]["coulomb_force_n"], serde_json::json!([0.25, 3.0]));
    assert_eq!(json("ranges ems-2010 --json")["drawn"], serde_json::Value::Null);
}

#[test]
fn the_bench_draws_a_seal_by_the_seed() {
    let place = Place::new();
    let record = |options: &str| {
        let ran = place.run(&format!("bench step --like dobbelsteen-2007 --out - {options}"));
        ran.ends_with(0)
    };
    let (first, again, other) = (record("--seed 1"), record("--seed 1"), record("--seed 2"));
    first.says(&["drawn from dobbelsteen-2007: F_c", "made up: β"]);
    assert_eq!(first.stdout, again.stdout);
    assert_ne!(first.stderr, other.stderr, "another seal");
}

#[test]
fn what_cannot_be_drawn_is_refused() {
    let place = Place::new();
    for (arguments, essentials) in [
        ("ranges none", ["\"none\"", "dobbelsteen-2007, imeche-2015, ems-2010"]),
        ("bench step --like none --out a.csv", ["\"none\"", "trocar ranges"]),
        ("bench step --like ems-2010 --out a.csv", ["no friction force", "imeche-2015"]),
        ("bench step --like ems-2010 --seal m --out a.csv", ["--like", "--seal"]),
    ] {
        place.run(arguments).ends_with(2).says(&essentials);
    }
    assert!(place.names().is_empty());
}
