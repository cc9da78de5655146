//! The report of a comparison draws the compared models with common samples and offset, and
//! explains missing figures.

use std::collections::HashSet;
use std::sync::LazyLock;

use trocar::bench::{BenchConfig, Protocol, run};
use trocar::compare::{Choice, CompareOptions, Comparison, Outcome, compare, split};
use trocar::identify::IdentifyOptions;
use trocar::identify::classical::Kind;
use trocar::recording::Recording;
use trocar::replay::forces;
use trocar::report::comparison::document;
use trocar::report::{Cell, Document, Figure, Panel, Role, Section, Series, Table, write_document};
use trocar::workflow::MovingMass;
use trocar_model::{Element, ElementParams};

/// Largest distance between a line of decimated points and the samples, N.
const THINNING: f64 = 0.02;

static COMPARISON: LazyLock<Comparison> = LazyLock::new(|| {
    let models = vec![
        Choice::Ems,
        Choice::Classical(Kind::Coulomb),
        Choice::Classical(Kind::CoulombViscous),
        Choice::Classical(Kind::Dahl),
        Choice::Classical(Kind::LuGre),
        Choice::Classical(Kind::MaxwellSlip(1)),
        Choice::Classical(Kind::MaxwellSlip(4)),
        Choice::Classical(Kind::Gms(1)),
    ];
    compared(models, &[record(Protocol::Steady, 7)], &[record(Protocol::Validation, 8)])
});

fn record(protocol: Protocol, seed: u64) -> Recording {
    let truth = [Element::new(ElementParams::plausible_10_5_mm().unwrap()).unwrap()];
    let mut config = BenchConfig::default();
    for speeds in [&mut config.protocol.steady, &mut config.protocol.validation] {
        (speeds.slowest_m_s, speeds.fastest_m_s, speeds.increment_m_s, speeds.stroke_m) =
            (0.02, 0.08, 0.02, 0.06);
    }
    let record = run(&config, protocol, &truth, seed)
        .unwrap()
        .to_recording(format!("{protocol}.csv"))
        .unwrap();
    record.without_moving_mass(config.rod.mass_kg, 0.0).unwrap()
}

fn compared(models: Vec<Choice>, training: &[Recording], validation: &[Recording]) -> Comparison {
    let identify = IdentifyOptions { inertia_removed: true, ..IdentifyOptions::default() };
    let options = CompareOptions { models, identify, timing: false };
    compare(training, validation, &options, &|_, _| {}).unwrap()
}

fn report(comparison: &Comparison, held_out: bool) -> Document {
    let (comparison, moving_mass) = (comparison.clone(), MovingMass::default());
    let outcome = Outcome { comparison, seed: 1, held_out, moving_mass };
    document(&outcome, "Models of a seal")
}

fn figures(document: &Document) -> Vec<&Figure> {
    document.sections.iter().flat_map(|section| &section.figures).collect()
}

fn figure<'a>(document: &'a Document, id: &str) -> &'a Figure {
    figures(document)
        .into_iter()
        .find(|figure| figure.id == id)
        .unwrap_or_else(|| panic!("no figure {id}"))
}

fn section<'a>(document: &'a Document, heading: &str) -> &'a Section {
    let found = document.sections.iter().find(|section| section.heading == heading);
    found.unwrap_or_else(|| panic!("no section {heading}"))
}

fn named<'a>(panel: &'a Panel, name: &str) -> &'a Series {
    panel
        .series
        .iter()
        .find(|series| series.name == name)
        .unwrap_or_else(|| panic!("no series {name}"))
}

/// A number of a table by the text of its row's first cell.
fn number(table: &Table, row: &str, column: &str) -> f64 {
    let column = table
        .columns
        .iter()
        .position(|name| name == column)
        .unwrap_or_else(|| panic!("no column {column}"));
    let row = table
        .rows
        .iter()
        .find(|cells| cells[0] == Cell::from(row))
        .unwrap_or_else(|| panic!("no row {row}"));
    match &row[column] {
        Cell::Number { value, .. } => *value,
        other => panic!("{other:?} is no number"),
    }
}

#[test]
fn figures_are_numbered_in_order_and_no_panel_is_empty() {
    let document = report(&COMPARISON, false);
    let ids: Vec<&str> = figures(&document).iter().map(|figure| figure.id.as_str()).collect();
    assert_eq!(ids, ["one-reversal", "one-cycle", "error-by-parameters"]);
    for (figure, number) in figures(&document).into_iter().zip(1..) {
        assert_eq!(figure.number, number, "{}", figure.id);
        assert!(figure.caption.ends_with('.'), "{}", figure.caption);
        for series in figure.panels.iter().flat_map(|panel| &panel.series) {
            assert!(
                series.x.iter().zip(&series.y).any(|(x, y)| x.is_finite() && y.is_finite()),
                "{}",
                series.name
            );
            assert!(series.x.len() <= 4_000, "{} is not thinned", series.name);
        }
    }
}

#[test]
fn every_family_has_a_panel_and_every_model_compared_a_line_over_the_same_measurement() {
    let document = report(&COMPARISON, false);
    for id in ["one-reversal", "one-cycle"] {
        let panels = &figure(&document, id).panels;
        let titles: Vec<&str> = panels.iter().map(|panel| panel.title.as_str()).collect();
        let expected = [
            "Static",
            "Dahl and LuGre",
            "Maxwell-Slip",
            "Generalized Maxwell-Slip",
            "Extended Maxwell-Slip",
        ];
        assert_eq!(titles, expected, "Leuven was not compared");
        let measured = named(&panels[0], "measured, inertia subtracted");
        assert!(
            panels.iter().all(|panel| named(panel, "measured, inertia subtracted") == measured)
        );
        assert!(
            panels.iter().all(|panel| panel.series[0].role == Role::Backdrop),
            "the measurement lies behind"
        );
        for (panel, names) in panels.iter().zip([
            vec!["Coulomb and viscous", "Coulomb"],
            vec!["Dahl", "LuGre"],
            vec!["Maxwell-Slip 4"],
            vec!["GMS 1"],
            vec!["EMS"],
        ]) {
            let drawn: Vec<&str> =
                panel.series[1..].iter().map(|series| series.name.as_str()).collect();
            assert_eq!(drawn, names);
        }
    }
}

#[test]
fn lines_of_one_panel_look_different_and_those_of_one_family_share_a_colour() {
    let document = report(&COMPARISON, false);
    for panel in &figure(&document, "one-reversal").panels {
        let looks: HashSet<String> =
            panel.series.iter().map(|series| format!("{:?}", series.role)).collect();
        assert_eq!(looks.len(), panel.series.len(), "{}", panel.title);
    }
    let static_panel = &figure(&document, "one-reversal").panels[0];
    assert!(static_panel.series[1..].iter().all(|s| matches!(s.role, Role::Friction("static", _))));
}

#[test]
fn the_reversal_shows_sliding_before_it_and_the_jump_of_the_static_models() {
    let document = report(&COMPARISON, false);
    let panels = &figure(&document, "one-reversal").panels;
    let level = |series: &Series, from: f64, to: f64| {
        let inside = series.x.iter().zip(&series.y).filter(|(x, _)| (from..to).contains(*x));
        let y: Vec<f64> = inside.map(|(_, y)| *y).collect();
        y.iter().sum::<f64>() / y.len() as f64
    };
    let [coulomb, ems] = [named(&panels[0], "Coulomb"), named(&panels[4], "EMS")];
    let measured = named(&panels[0], "measured, inertia subtracted");
    let end = measured.x.iter().copied().fold(0.0, f64::max);
    assert!(end > 1e3 * COMPARISON.reversal_travel, "shown up to {end} mm");
    // Forces count positive along the motion after the reversal.
    let sense = -level(measured, -5.0, -1.0).signum();
    let along = |series: &Series, from: f64, to: f64| sense * level(series, from, to);
    for series in [coulomb, ems, measured] {
        let [before, after] = [along(series, -5.0, -1.0), along(series, end - 2.0, end)];
        assert!(before < -2.0, "{} slides before it turns: {before} N", series.name);
        assert!(after > 2.0, "{} slides at the end: {after} N", series.name);
    }
    // Two millimetres after the reversal the seal is still deformed in the other direction; static
    // friction has no deflection.
    assert!(along(measured, 1.0, 2.5) < 0.0 && along(ems, 1.0, 2.5) < 0.0);
    assert!(along(coulomb, 1.0, 2.5) > 2.0);
}

#[test]
fn what_is_drawn_is_what_the_models_compute() {
    let document = report(&COMPARISON, false);
    let ems = COMPARISON.entries.iter().find(|entry| entry.name == "ems").unwrap();
    let recording = &COMPARISON.validation[0];
    let force = forces(&ems.trocar, recording, ems.offset);
    let line = named(&figure(&document, "one-cycle").panels[4], "EMS");
    let nearest = |x: f64, y: f64| {
        let distance = |(p, f): (&f64, &f64)| (1e3 * p - x).abs().max((f - y).abs());
        recording.position.iter().zip(&force).map(distance).fold(f64::INFINITY, f64::min)
    };
    for (x, y) in line.x.iter().zip(&line.y).step_by(25) {
        assert!(nearest(*x, *y) < THINNING, "no sample at {x} mm, {y} N");
    }
}

#[test]
fn tables_and_points_show_the_scores() {
    let document = report(&COMPARISON, false);
    let summary = &section(&document, "Summary").tables[0];
    let errors = &section(&document, "Errors").tables[0];
    let criteria = &section(&document, "Criteria and cost").tables[0];
    let panel = &figure(&document, "error-by-parameters").panels[1];
    assert_eq!(errors.rows.len(), COMPARISON.entries.len());
    for (name, title) in
        [("ems", "EMS"), ("coulomb", "Coulomb"), ("dahl", "Dahl"), ("gms", "GMS 1")]
    {
        let entry = COMPARISON.entries.iter().find(|entry| entry.name == name).unwrap();
        assert_eq!(number(summary, title, "Validation (N)"), entry.scores.validate_rms_n);
        assert_eq!(number(errors, title, "Sliding"), entry.scores.by_phase.sliding.rms_n);
        assert_eq!(number(criteria, title, "Reversals (N)"), entry.scores.reversal_rms_n);
        let point =
            |s: &&Series| s.y == [entry.scores.reversal_rms_n] && s.x == [entry.parameters as f64];
        assert!(panel.series.iter().any(|s| point(&s)), "{name} is no point of the figure");
    }
    let bank = named(panel, "Maxwell-Slip, 1 to 4 elements");
    assert_eq!(bank.x, [3.0, 9.0]);
}

#[test]
fn the_claim_is_tested_in_words_and_criteria_say_what_they_ignore() {
    let document = report(&COMPARISON, false);
    let claim = section(&document, "Error against number of parameters").paragraphs.join(" ");
    for words in
        ["ten elements", "Maxwell-Slip does not match", "GMS does not match", "up to 4 elements"]
    {
        assert!(claim.contains(words), "no {words:?} in {claim}");
    }
    let criteria = section(&document, "Criteria and cost").paragraphs.join(" ");
    for words in ["independent", "ignore", "training", "No times were measured"] {
        assert!(criteria.contains(words), "no {words:?} in {criteria}");
    }
}

#[test]
fn parameters_of_small_banks_are_listed_with_symbols() {
    let document = report(&COMPARISON, false);
    let tables = &section(&document, "Parameters").tables;
    let captions: Vec<&str> = tables.iter().map(|table| table.caption.as_str()).collect();
    assert!(captions.contains(&"Maxwell-Slip") && captions.contains(&"EMS"), "{captions:?}");
    let bank = tables.iter().find(|table| table.caption == "Maxwell-Slip").unwrap();
    let symbols: Vec<&Cell> = bank.rows.iter().map(|row| &row[2]).collect();
    assert!(
        symbols.contains(&&Cell::from("F_4")) && symbols.contains(&&Cell::from("k_1")),
        "{symbols:?}"
    );
}

#[test]
fn held_out_parts_and_a_missing_cycle_are_said_in_words() {
    let (training, mut validation) = split(&[record(Protocol::Steady, 7)]).unwrap();
    let models = vec![Choice::Ems, Choice::Classical(Kind::Coulomb)];
    // Only a stroke: no complete cycle.
    let stroke = validation[0].part(0..validation[0].len() / 8, "one stroke").unwrap();
    validation = vec![stroke];
    let document = report(&compared(models, &training, &validation), true);
    assert!(
        document.notes.iter().any(|warning| warning.contains("last third")),
        "{:?}",
        document.notes
    );
    assert!(document.subtitle.contains("one stroke"), "{}", document.subtitle);
    let ids: Vec<&str> = figures(&document).iter().map(|figure| figure.id.as_str()).collect();
    assert_eq!(ids, ["error-by-parameters"]);
    for heading in ["One reversal", "One cycle"] {
        assert!(section(&document, heading).paragraphs[0].contains("hold no"), "{heading}");
    }
    let claim = &section(&document, "Error against number of parameters").paragraphs;
    assert!(claim.iter().any(|words| words.contains("not tested")), "{claim:?}");
}

#[test]
fn equal_comparisons_give_equal_pages() {
    let folder = tempfile::tempdir().unwrap();
    let pages = ["a", "b"].map(|name| {
        let out = folder.path().join(name);
        write_document(&out, &report(&COMPARISON, false)).unwrap();
        std::fs::read(out.join("report.html")).unwrap()
    });
    assert!(pages[0] == pages[1]);
}
