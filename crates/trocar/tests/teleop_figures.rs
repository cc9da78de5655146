//! The figures and the table of docs/explanation/teleoperation.md are those that their command gives.

use std::path::Path;

#[path = "../examples/teleoperation.rs"]
mod example;

const PAGE: &str = include_str!("../../../docs/explanation/teleoperation.md");
const COMPENSATION: &str = include_str!("../../../docs/explanation/compensation.md");

#[test]
fn the_advice_of_the_docs_is_that_of_the_command() {
    let table = example::advised().unwrap();
    assert!(COMPENSATION.contains(&table), "docs/explanation/compensation.md has not\n{table}");
}

#[test]
fn the_figures_of_the_docs_are_those_of_the_command() {
    let curves = example::curves().unwrap();
    let table = example::table(&curves);
    for table in [table, example::approaches().unwrap()] {
        assert!(PAGE.contains(&table), "docs/explanation/teleoperation.md has not\n{table}");
    }
    let document = example::document(&curves).unwrap();
    let drawn = trocar::report::vectors(&document).unwrap();
    assert_eq!(drawn.len(), 2);
    for (id, svg) in drawn {
        let file = format!("../../docs/figures/{id}.svg");
        let kept = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(file));
        assert!(
            kept.is_ok_and(|kept| kept == svg),
            "docs/figures/{id}.svg: run cargo run --release -p trocar --example teleoperation -- docs"
        );
    }
}
