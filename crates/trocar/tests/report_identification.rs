//! The report of an identification draws its results and explains missing figures.

use std::path::Path;
use std::sync::LazyLock;
use std::time::Instant;

use crate::skipped::skipped;
use trocar::bench::{BenchConfig, Protocol, run};
use trocar::identify::{
    FitSummary, FreeMotion, FrictionScale, Identification, IdentifyOptions, StrokeFriction, Term,
    TermTrial, identify,
};
use trocar::motion::MotionRange;
use trocar::output::StagedFolder;
use trocar::recording::loads::Load;
use trocar::recording::{ReadOptions, Recording, read};
use trocar::report::identification::{FigureChoice, IdentificationReport, check_choice, document};
use trocar::report::{
    Cell, Dimension, Document, Figure, Kind, Panel, Role, Section, Series, Table, write_document,
    write_workflow,
};
use trocar::validate::Validated;
use trocar::workflow::{MovingMass, Workflow};
use trocar_model::{Element, ElementParams, Seal, Stages, Trocar};

static OPTIONS: LazyLock<IdentifyOptions> = LazyLock::new(IdentifyOptions::default);

/// A bench, what was identified on it, and the scores on another recording.
struct Bench {
    truth: [Element; 1],
    own: Validated,
    held_out: Validated,
    identification: Identification,
}

static BENCH: LazyLock<Bench> = LazyLock::new(|| {
    let truth = [Element::new(ElementParams::plausible_10_5_mm().unwrap()).unwrap()];
    let config = BenchConfig::default();
    let record = |protocol: Protocol| {
        let record = run(&config, protocol, &truth, 7)
            .unwrap()
            .to_recording(format!("{protocol}.csv"))
            .unwrap();
        record.without_moving_mass(config.rod.mass_kg, 0.0).unwrap()
    };
    let training = vec![record(Protocol::Steady), record(Protocol::Dynamic)];
    let validation = vec![record(Protocol::Validation)];
    let identification = identified(&training);
    let own = Validated::own(&identification, &training);
    let held_out = Validated::held_out(&identification, validation);
    Bench { truth, own, held_out, identification }
});

fn identified(training: &[Recording]) -> Identification {
    let options = IdentifyOptions { paper: true, ..IdentifyOptions::default() };
    identify(training, &options, &|_, _| {}).unwrap()
}

fn full_report(bench: &Bench) -> Document {
    document(&IdentificationReport {
        held_out: Some(&bench.held_out),
        truth: Some(&bench.truth),
        ..plain_input(&bench.identification, &bench.own)
    })
}

fn plain_input<'a>(
    identification: &'a Identification,
    own: &'a Validated,
) -> IdentificationReport<'a> {
    IdentificationReport {
        identification,
        own,
        range: MotionRange::of(&own.recordings, identification.model.offset),
        held_out: None,
        truth: None,
        options: &OPTIONS,
        moving_mass: MovingMass::default(),
        command: None,
        title: "A seal",
        choice: FigureChoice::default(),
    }
}

/// Strokes of a stiff slider: F = 2 N against the motion and 4 N s/m, without visible deformation.
fn stiff_slider(speeds: &[f64], both_ways: bool) -> Recording {
    let (mut time, mut position, mut force) = (vec![0.0], vec![0.0], vec![0.0]);
    let mut noise = 1u32;
    let mut go = |velocity: f64, reading: f64, samples: usize| {
        for _ in 0..samples {
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            time.push(time[time.len() - 1] + 1e-3);
            position.push(position[position.len() - 1] + 1e-3 * velocity);
            force.push(reading + 0.02 * (f64::from(noise) / f64::from(u32::MAX) - 0.5));
        }
    };
    for speed in speeds {
        let samples = (0.05 / speed * 1e3) as usize;
        go(*speed, 2.0 + 4.0 * speed, samples);
        if both_ways {
            go(-speed, -2.0 - 4.0 * speed, samples);
        }
    }
    Recording::from_columns("slider.csv", time, position, force).unwrap()
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
    document
        .sections
        .iter()
        .find(|section| section.heading == heading)
        .unwrap_or_else(|| panic!("no section {heading}"))
}

fn series(panel: &Panel, role: Role) -> &Series {
    panel
        .series
        .iter()
        .find(|series| series.role == role)
        .unwrap_or_else(|| panic!("no series of {role:?}"))
}

fn table<'a>(section: &'a Section, column: &str) -> &'a Table {
    let has = |table: &&Table| table.columns.iter().any(|name| name == column);
    section.tables.iter().find(has).unwrap_or_else(|| panic!("no table with {column}"))
}

/// A number of a table by the text of its row's first cell.
fn number(table: &Table, row: &str, column: &str) -> f64 {
    let column = table.columns.iter().position(|name| name == column).unwrap();
    let row = table
        .rows
        .iter()
        .find(|cells| cells[0] == Cell::from(row))
        .unwrap_or_else(|| panic!("no row {row}"));
    match &row[column] {
        Cell::Number { value, .. } | Cell::Estimate { value, .. } => *value,
        other => panic!("{other:?} is no number"),
    }
}

/// Ordinate of a line at `x`, interpolated between its points.
fn at(series: &Series, x: f64) -> f64 {
    let pairs = series.x.windows(2).zip(series.y.windows(2));
    let around = |(xs, _): &(&[f64], &[f64])| xs[0].min(xs[1]) <= x && x <= xs[0].max(xs[1]);
    let (xs, ys) = pairs.into_iter().find(around).unwrap_or_else(|| panic!("{x} lies outside"));
    ys[0] + (ys[1] - ys[0]) * (x - xs[0]) / (xs[1] - xs[0])
}

fn range(panel: &Panel, wanted: &str) -> (f64, f64) {
    let found = panel.marks.iter().find(|mark| mark.axis == Dimension::X && mark.label == wanted);
    let mark = found.unwrap_or_else(|| panic!("no range {wanted}"));
    (mark.from, mark.to)
}

fn assert_nothing_is_empty(document: &Document) {
    for figure in figures(document) {
        assert!(!figure.panels.is_empty(), "{}", figure.id);
        for panel in &figure.panels {
            let drawn =
                |s: &Series| s.x.iter().zip(&s.y).any(|(x, y)| x.is_finite() && y.is_finite());
            assert!(panel.series.iter().any(drawn), "{} has an empty panel", figure.id);
            assert!(
                panel.series.iter().all(|s| s.x.len() <= 4_000),
                "{} is not thinned",
                figure.id
            );
        }
    }
    for section in &document.sections {
        let parts = section.paragraphs.len() + section.tables.len() + section.figures.len();
        assert!(parts > 0, "{} is empty", section.heading);
    }
}

#[test]
fn every_figure_of_the_paper_is_drawn_once_numbered_in_order_and_without_an_empty_panel() {
    let document = full_report(&BENCH);
    let all = figures(&document);
    let ids: Vec<&str> = all.iter().map(|figure| figure.id.as_str()).collect();
    let expected = [
        "velocity-step",
        "static-friction",
        "deformation-velocity",
        "deformation-force",
        "half-width",
        "cross-validation",
        "residuals",
        "residual-statistics",
        "error-by-speed",
    ];
    assert_eq!(ids, expected);
    assert_nothing_is_empty(&document);
    for (figure, number) in all.iter().zip(1..) {
        assert_eq!(figure.number, number, "{}", figure.id);
        assert!(figure.caption.ends_with('.') && figure.caption.contains(' '), "{}", figure.id);
    }
}

#[test]
fn the_fitted_line_of_static_friction_has_the_coefficients_of_the_table() {
    let document = full_report(&BENCH);
    let panel = &figure(&document, "static-friction").panels[0];
    let fit = series(panel, Role::Fit);
    let parameters = table(section(&document, "Parameters"), "Truth");
    let coulomb = number(parameters, "Coulomb force", "Value");
    let viscous = number(parameters, "Viscous damping", "Value");
    for speed in [20.0, 55.0, 95.0] {
        let line = coulomb + viscous * speed * 1e-3;
        assert!((at(fit, speed) - line).abs() < 1e-9, "{speed} mm/s");
        assert!((at(fit, -speed) + line).abs() < 1e-9, "{speed} mm/s");
        let (low, high) =
            (at(series(panel, Role::Lower), speed), at(series(panel, Role::Upper), speed));
        assert!(low < line && line < high, "{low} {line} {high}");
    }
    // The bench is known, and its offset is subtracted from the points.
    let means = series(panel, Role::Measured);
    let truth = &BENCH.truth[0].params().insertion;
    for (v, force) in means.x.iter().zip(&means.y) {
        let expected = truth.force(v.abs() * 1e-3) * v.signum();
        assert!(
            (force - expected).abs() < 0.05 * expected.abs(),
            "{force} N at {v} mm/s, expected {expected} N"
        );
    }
}

#[test]
fn the_first_transient_ends_before_the_second_begins_and_the_force_dips_in_between() {
    let document = full_report(&BENCH);
    let panel = &figure(&document, "velocity-step").panels[1];
    let (start, hump) = range(panel, "T1");
    let (dip, end) = range(panel, "T2");
    assert!(0.0 <= start && start < hump && hump < dip && dip < end, "{start} {hump} {dip} {end}");
    let model = series(panel, Role::Model);
    let measured = series(panel, Role::Measured);
    for force in [model, measured] {
        let [begins, first, between, last] = [start, hump, dip, end].map(|t| at(force, t));
        let rises = if last > begins { 1.0 } else { -1.0 };
        assert!(rises * (first - begins) > 2.0, "T1 rises from {begins} to {first}");
        assert!(rises * (first - between) > 0.3, "falls from {first} to {between}");
        assert!(rises * (last - between) > 1.5, "T2 rises from {between} to {last}");
    }
    // The velocity changes sign at the origin.
    let velocity = &figure(&document, "velocity-step").panels[0].series[0];
    assert!(at(velocity, -0.02) * at(velocity, 0.02) < 0.0);
}

#[test]
fn branches_lie_on_the_truth_of_the_bench_and_joins_on_their_corners() {
    let document = full_report(&BENCH);
    let panel = &figure(&document, "deformation-force").panels[0];
    let of = |role| {
        panel
            .series
            .iter()
            .filter(move |s| s.role == role && s.kind == Kind::Line)
            .collect::<Vec<_>>()
    };
    for (fit, truth) in of(Role::Fit).into_iter().zip(of(Role::Reference)) {
        for z in [-7.0, -4.0, -1.0, 0.0, 2.0, 6.0] {
            let difference = at(fit, z) - at(truth, z);
            assert!(difference.abs() < 0.1, "{difference} N at {z} mm");
        }
    }
    let joins: Vec<f64> = panel
        .marks
        .iter()
        .filter(|mark| mark.axis == Dimension::X && mark.from == mark.to)
        .map(|mark| mark.from)
        .collect();
    assert_eq!(joins.len(), 2);
    assert!((joins[0] + 2.2).abs() < 0.3 && (joins[1] - 2.2).abs() < 0.3, "{joins:?}");
    // The single polynomial does not fit the corner: its residual is larger.
    for panel in &figure(&document, "deformation-force").panels[1..] {
        let worst = |role| {
            let inner = series(panel, role);
            inner
                .x
                .iter()
                .zip(&inner.y)
                .filter(|(z, _)| z.abs() < 6.0)
                .map(|(_, r)| r.abs())
                .fold(0.0, f64::max)
        };
        assert!(worst(Role::Alternative) > worst(Role::Fit), "{}", panel.title);
    }
}

#[test]
fn truth_stands_beside_the_estimates_in_units_for_people() {
    let beside_truth = full_report(&BENCH);
    let parameters = table(section(&beside_truth, "Parameters"), "Truth");
    for (name, truth) in [
        ("Coulomb force", 3.0),
        ("Viscous damping", 5.0),
        ("Half width of the deformation", 8.0),
        ("Join, insertion", -2.2),
    ] {
        assert!((number(parameters, name, "Truth") - truth).abs() < 1e-9, "{name}");
        let value = number(parameters, name, "Value");
        assert!((value - truth).abs() < 0.15 * truth.abs(), "{name}: {value}");
    }
    let without = document(&plain_input(&BENCH.identification, &BENCH.own));
    assert!(
        section(&without, "Parameters")
            .tables
            .iter()
            .all(|t| !t.columns.contains(&"Truth".to_owned()))
    );
}

#[test]
fn cross_validation_shows_the_slowest_and_the_fastest_speed_without_offset() {
    let document = full_report(&BENCH);
    let figure = figure(&document, "cross-validation");
    let titles: Vec<&str> = figure.panels.iter().map(|panel| panel.title.as_str()).collect();
    assert_eq!(titles, ["20 mm/s", "100 mm/s", "", ""]);
    for panel in &figure.panels[..2] {
        let (measured, model) = (series(panel, Role::Measured), series(panel, Role::Model));
        let last = model.x[model.x.len() - 1];
        for part in [0.3, 0.45, 0.8, 0.95] {
            let difference = at(measured, part * last) - at(model, part * last);
            assert!(difference.abs() < 0.25, "{difference} N at {part} of {}", panel.title);
        }
    }
    for panel in &figure.panels[2..] {
        let deflection = series(panel, Role::Deflection);
        let (low, high) =
            deflection.y.iter().fold((0.0f64, 0.0f64), |(l, h), z| (l.min(*z), h.max(*z)));
        assert!(low < -7.5 && high > 7.5, "{low} to {high} mm");
    }
}

/// Largest interpolation error of a reading between two samples, N.
const BETWEEN_SAMPLES: f64 = 0.2;

#[test]
fn the_live_model_is_the_identified_one_beside_an_excerpt_it_has_not_seen() {
    let bench = &*BENCH;
    let report = full_report(bench);
    let live = section(&report, "The model, live").live.as_ref().expect("a live model");
    let trocar = Trocar::from_numbers(&live.row).unwrap();
    assert_eq!(*trocar.seal(), Seal::Ems(bench.identification.stages));
    let excerpt = live.excerpt.as_ref().expect("an excerpt");
    assert!(
        excerpt.name.starts_with("validation.csv") && excerpt.name.contains("has not seen"),
        "{}",
        excerpt.name
    );
    assert!(
        (7.9..8.1).contains(&(excerpt.interval * excerpt.position.len() as f64)),
        "eight seconds"
    );
    let reach =
        excerpt.position.iter().fold([f64::MAX, f64::MIN], |[a, b], x| [a.min(*x), b.max(*x)]);
    assert!(live.way[0] < reach[0] && reach[1] < live.way[1]);

    // The sensor offset is subtracted from the readings, and from `known_from` on any initial state
    // gives the same force.
    let offset = bench.identification.model.offset;
    let recorded: Vec<f64> =
        bench.held_out.recordings[0].force.iter().map(|reading| reading - offset).collect();
    let near = |force: &f64| recorded.iter().any(|own| (own - force).abs() < BETWEEN_SAMPLES);
    assert!(excerpt.force.iter().all(near));
    let run = |force: f64| {
        let mut state = trocar.rest_at_force(excerpt.position[0], force);
        let step = |x: &f64| trocar.step_to(&mut state, *x, excerpt.interval);
        excerpt.position[1..].iter().map(step).collect::<Vec<f64>>()
    };
    let (low, high) = (run(-10.0), run(10.0));
    let error = |i: usize| (low[i] - high[i]).abs();
    assert!((0..excerpt.known_from / 2).any(|i| error(i) > 0.1), "the start matters at first");
    assert!((excerpt.known_from..low.len()).all(|i| error(i) < 1e-3));
}

#[test]
fn every_parameter_can_be_turned_both_ways_from_the_value_identified() {
    let bench = &*BENCH;
    let report = full_report(bench);
    let live = section(&report, "The model, live").live.as_ref().expect("a live model");
    let seal = Seal::Ems(bench.identification.stages);
    let values: Vec<f64> = live.knobs.iter().map(|knob| knob.value).collect();
    for (at, knob) in live.knobs.iter().enumerate() {
        let Some([low, high]) = knob.range else {
            assert_eq!(knob.name, "Lag of the Stribeck curve", "of use with creep only");
            continue;
        };
        assert!(
            low <= knob.value && knob.value < high,
            "{}: {low} to {high}, value {}",
            knob.name,
            knob.value
        );
        for end in [low, high] {
            let turned: Vec<f64> =
                (0..values.len()).map(|i| if i == at { end } else { values[i] }).collect();
            assert!(seal.tuned(&turned).is_ok(), "{} cannot be {end}", knob.name);
        }
    }
    let named = |name: &str| {
        live.knobs.iter().find(|knob| knob.name == name).unwrap_or_else(|| panic!("no {name}"))
    };
    let coulomb = named("Coulomb force, insertion");
    let estimate = bench.identification.parameter("coulomb_force_n").unwrap();
    assert_eq!((coulomb.interval, coulomb.unit.as_str()), (Some(estimate.ci95), "N"));
    assert_eq!(named("Coulomb force, withdrawal").follows, Some(1), "one value on either side");
    assert_eq!(
        (
            named("Half width of the deformation").unit.as_str(),
            named("Half width of the deformation").scale
        ),
        ("mm", 1e3)
    );
}

#[test]
fn a_forgotten_mass_is_out_of_what_is_drawn() {
    let config = BenchConfig::default();
    let raw = |protocol: Protocol| {
        run(&config, protocol, &BENCH.truth, 7)
            .unwrap()
            .to_recording(format!("{protocol}.csv"))
            .unwrap()
    };
    let training = vec![raw(Protocol::Steady), raw(Protocol::Dynamic)];
    let mut identification = BENCH.identification.clone();
    identification.model.loads[Load::Mass] = config.rod.mass_kg;
    let forgotten =
        document(&plain_input(&identification, &Validated::own(&identification, &training)));
    let declared = document(&plain_input(&BENCH.identification, &BENCH.own));
    for id in ["velocity-step", "cross-validation"] {
        let forces = |document: &Document| {
            let panels = figure(document, id).panels.clone();
            panels.into_iter().find(|panel| panel.y.label == "force").unwrap()
        };
        let (a, b) = (forces(&forgotten), forces(&declared));
        let (a, b) = (series(&a, Role::Measured).clone(), series(&b, Role::Measured).clone());
        assert_eq!(a.x, b.x, "{id}");
        assert!(a.y.iter().zip(&b.y).all(|(a, b)| (a - b).abs() < 1e-9), "{id}");
        assert_eq!([&*a.name, &*b.name], ["measured, inertia subtracted"; 2], "{id}");
    }
}

/// The bench's result as if it came from a fit to all motion, and its recordings with a hand-like
/// one.
fn of_all_motion() -> (Identification, Vec<Recording>) {
    let trial = |term, p_value, gain| TermTrial {
        term,
        kept: p_value < 1e-4,
        p_value,
        gain,
        why_not: None,
        shift: Vec::new(),
    };
    let fit = FitSummary {
        terms: vec![
            trial(Term::SecondStage, 0.3, 0.002),
            trial(Term::SealDamping, 2e-7, 0.2),
            trial(Term::Creep, 3e-6, 0.4),
        ],
        paper_rms_n: 0.0620,
        rms_n: 0.0290,
        iterations: 7,
        converged: true,
    };
    let stroke = |k: usize| StrokeFriction {
        recording: k / 10,
        time_s: 3.0 * (k % 10) as f64,
        scale: 1.0 + 0.002 * k as f64,
        standard_error: 0.004,
        counted: true,
    };
    let friction_scale = FrictionScale {
        strokes: (0..20).map(stroke).collect(),
        scatter: 0.012,
        drift: 0.038,
        jumps: Vec::new(),
    };
    let free_motion = FreeMotion { reversals: 94, partial_reversals: 9, held_s: 17.1 };
    let identification = Identification {
        fit: Some(fit),
        friction_scale,
        free_motion,
        ..BENCH.identification.clone()
    };
    let config = BenchConfig::default();
    let record = run(&config, Protocol::Surgeon, &BENCH.truth, 7)
        .unwrap()
        .to_recording("surgeon.csv")
        .unwrap();
    let surgeon = record.without_moving_mass(config.rod.mass_kg, 0.0).unwrap();
    (identification, BENCH.own.recordings.iter().cloned().chain([surgeon]).collect())
}

fn text(cell: &Cell) -> &str {
    match cell {
        Cell::Text(text) => text,
        other => panic!("{other:?} is no text"),
    }
}

#[test]
fn the_fit_lists_every_term_that_was_tried_and_draws_the_friction_of_every_stroke() {
    let (identification, training) = of_all_motion();
    let fit = identification.fit.as_ref().unwrap();
    let document =
        document(&plain_input(&identification, &Validated::own(&identification, &training)));
    assert_nothing_is_empty(&document);
    let section = section(&document, "Fit to all motion");
    let listed = table(section, "Term");
    assert_eq!(listed.rows.len(), fit.terms.len());
    for (cells, trial) in listed.rows.iter().zip(&fit.terms) {
        assert_eq!(text(&cells[0]).to_lowercase(), trial.term.words().to_lowercase());
        assert_eq!(cells[1], Cell::Number { value: trial.p_value, digits: 2 });
        assert_eq!(cells[2], Cell::Number { value: 1e2 * trial.gain, digits: 2 });
        assert_eq!(text(&cells[3]), if trial.kept { "yes" } else { "no" });
    }
    let drawn = figure(&document, "friction-scale");
    let points: Vec<(f64, f64)> = drawn.panels[0]
        .series
        .iter()
        .flat_map(|s| s.x.iter().copied().zip(s.y.iter().copied()))
        .collect();
    let strokes = &identification.friction_scale.strokes;
    assert_eq!(points.len(), strokes.len());
    assert!(
        strokes.iter().zip(&points).all(|(stroke, (_, scale))| stroke.scale == *scale),
        "{points:?}"
    );
    // The strokes of the second recording follow those of the first.
    assert!(
        points
            .iter()
            .zip(strokes)
            .all(|((x, _), s)| s.recording == 0 || *x >= training[0].duration()),
        "{points:?}"
    );
    assert!(
        drawn.caption.contains("1.2 %") && drawn.caption.contains("3.8 %"),
        "{}",
        drawn.caption
    );
    let words = section.paragraphs.join(" ");
    assert!(
        words.contains("94 reversals, 9 of them partial") && words.contains("17.1 s at rest"),
        "{words}"
    );
    assert!(words.contains("0.062"), "{words}");
}

#[test]
fn rests_and_small_reversals_are_drawn_with_both_models_and_what_they_leave() {
    let (identification, training) = of_all_motion();
    let document =
        document(&plain_input(&identification, &Validated::own(&identification, &training)));
    let [position, force, error] = &figure(&document, "small-motion").panels[..] else {
        panic!("three panels")
    };
    let duration = position.series[0].x.iter().fold(0.0f64, |most, t| most.max(*t));
    assert!((4.9..5.1).contains(&duration), "{duration} s");
    for role in [Role::Model, Role::Alternative] {
        for time in [0.7, 1.9, 3.1, 4.3] {
            let left = at(series(force, Role::Measured), time) - at(series(force, role), time);
            // Each line is decimated separately: they agree within the noise of the sensor.
            assert!((left - at(series(error, role), time)).abs() < 0.15, "{role:?} at {time} s");
        }
    }
    // The bench's own recordings of full strokes contain no such part.
    let words =
        section(&document_of_strokes(&identification), "Fit to all motion").paragraphs.join(" ");
    assert!(words.contains("no recording holds both"), "{words}");
}

fn document_of_strokes(identification: &Identification) -> Document {
    document(&plain_input(identification, &BENCH.own))
}

#[test]
fn a_report_of_the_two_steps_alone_claims_no_fit() {
    let (identification, _) = of_all_motion();
    let fitted = document_of_strokes(&identification);
    let words = section(&fitted, "Parameters").paragraphs.join(" ");
    assert!(
        words.contains("fit to all motion") && words.contains("two steps are shown for comparison"),
        "{words}"
    );
    let plain = document_of_strokes(&BENCH.identification);
    let words = section(&plain, "Parameters").paragraphs.join(" ");
    assert!(words.contains("paper's two steps") && !words.contains("fit to all motion"), "{words}");
    assert!(plain.sections.iter().all(|section| section.heading != "Fit to all motion"));
    assert!(
        figures(&plain)
            .iter()
            .all(|figure| figure.id != "friction-scale" && figure.id != "small-motion")
    );
}

#[test]
fn the_deformation_force_of_a_model_with_two_elements_is_that_of_both() {
    let (mut identification, _) = of_all_motion();
    let deformed = |identification: &Identification| {
        let document = document_of_strokes(identification);
        let panel = figure(&document, "deformation-force").panels[0].clone();
        series(&panel, Role::Model).clone()
    };
    let one = deformed(&identification);
    let element = *identification.element();
    identification.stages = Stages::new(&[element; 2]).unwrap();
    // Limits from which deflections are measured.
    let sliding = &mut identification.two_step;
    [&mut sliding.insertion, &mut sliding.withdrawal]
        .into_iter()
        .for_each(|s| s.static_force *= 2.0);
    let both = deformed(&identification);
    for z in [-6.0, -1.0, 3.0, 7.0] {
        assert!((at(&both, z) - 2.0 * at(&one, z)).abs() < 1e-6, "at {z} mm");
    }
    let measured =
        figure(&document_of_strokes(&BENCH.identification), "deformation-force").panels[0].clone();
    let measured = series_of_line(&measured, Role::Measured);
    for z in [-6.0, 0.0, 6.0] {
        let difference = at(&one, z) - at(&measured, z);
        assert!(difference.abs() < 0.15, "{difference} N at {z} mm");
    }
}

fn series_of_line(panel: &Panel, role: Role) -> Series {
    panel.series.iter().find(|s| s.role == role && s.kind == Kind::Line).unwrap().clone()
}

#[test]
fn without_validation_the_report_says_that_it_looks_at_its_own_data() {
    let document = document(&plain_input(&BENCH.identification, &BENCH.own));
    assert!(document.subtitle.contains("not validated"), "{}", document.subtitle);
    let labels: Vec<&str> = document.card.iter().map(|(label, _)| label.as_str()).collect();
    assert!(labels.contains(&"Error on its own data"), "{labels:?}");
    for id in ["cross-validation", "residuals", "error-by-speed"] {
        let caption = &figure(&document, id).caption;
        assert!(caption.contains("identified from, for there are no others"), "{caption}");
    }
}

/// Numbers of a text, without signs.
fn numbers(text: &str) -> Vec<f64> {
    let parts = text.split(|c: char| !c.is_ascii_digit() && c != '.');
    parts.filter_map(|part| part.trim_end_matches('.').parse().ok()).collect()
}

#[test]
fn every_number_of_the_model_card_is_in_the_summary() {
    let workflow = Workflow::of(
        BENCH.identification.clone(),
        OPTIONS.clone(),
        BENCH.own.recordings.to_vec(),
        BENCH.held_out.recordings.clone(),
        MovingMass { mass: 0.04, gravity: 0.0 },
    );
    let folder = tempfile::tempdir().unwrap();
    let staged = StagedFolder::create(folder.path()).unwrap();
    write_workflow(&workflow, &staged, None, FigureChoice::default()).unwrap();
    staged.commit().unwrap();
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    let (card, known) = (read("card.md"), numbers(&read("summary.json").replace("e-", " ")));
    let rows = card.lines().filter(|row| row.starts_with("| ")).skip(1);
    for (label, value) in rows.filter_map(|row| row.trim_matches('|').split_once('|')) {
        if ["Cite", "Not for"].contains(&label.trim()) {
            continue;
        }
        let value = value.split("SHA-256").next().unwrap().replace(".csv", "");
        let value = value.replace("the paper reports 0.17 N", "").replace("95 % interval", "");
        for number in numbers(&value).into_iter().filter(|number| *number != 25.0) {
            let is_near = |own: &f64| {
                // As shown, perhaps in thousandths, with three digits or more.
                [1.0, 1e3].iter().any(|scale| (own * scale - number).abs() <= 5e-3 * number + 6e-4)
            };
            assert!(
                known.iter().any(is_near),
                "{label}: {number} of {value} is not in the summary"
            );
        }
    }
    let page = read("report.html");
    assert!(page.contains("class=\"card\"") && !page.contains("class=\"tiles\""));
    assert!(page.find("class=\"card\"") < page.find("<h2"), "the card is on top");
}

#[test]
fn an_unresolved_deformation_is_said_in_words_instead_of_drawn() {
    let training = [stiff_slider(&[0.01, 0.02, 0.03, 0.05], true)];
    let identification = identified(&training);
    let why = identification.deformation.as_ref().expect_err("a stiff slider does not deform");
    let document =
        document(&plain_input(&identification, &Validated::own(&identification, &training)));
    let ids: Vec<&str> = figures(&document).iter().map(|figure| figure.id.as_str()).collect();
    for id in ["velocity-step", "deformation-velocity", "deformation-force", "half-width"] {
        assert!(!ids.contains(&id), "{id}");
    }
    assert!(ids.contains(&"static-friction"));
    for heading in ["Velocity reversal", "Deformation"] {
        let words = &section(&document, heading).paragraphs;
        assert!(
            !words.is_empty() && words.iter().all(|words| words.contains(why.as_str())),
            "{heading}: {words:?}"
        );
    }
    assert!(
        document.warnings.iter().any(|w| w.starts_with("Half width of the deformation")),
        "{:?}",
        document.warnings
    );
}

#[test]
fn one_direction_at_one_speed_has_no_confidence_lines_and_a_reason() {
    let training = [stiff_slider(&[0.02], false)];
    let identification = identified(&training);
    let document =
        document(&plain_input(&identification, &Validated::own(&identification, &training)));
    let figure = figure(&document, "static-friction");
    assert!(figure.panels[0].series.iter().all(|s| !matches!(s.role, Role::Lower | Role::Upper)));
    assert!(figure.caption.contains("No confidence lines"), "{}", figure.caption);
    let fit = series(&figure.panels[0], Role::Fit);
    assert!(fit.x.iter().all(|v| *v > 0.0), "nothing was measured on the other side");
    let words = section(&document, "Cross-validation").paragraphs.join(" ");
    assert!(words.contains("no full cycle"), "{words}");
    // All figures can be written.
    let folder = tempfile::tempdir().unwrap();
    write_document(folder.path(), &document).unwrap();
}

#[test]
fn equal_results_give_equal_documents_that_can_be_written() {
    let (first, second) = (full_report(&BENCH), full_report(&BENCH));
    // Compared as text, since a gap (NaN) in a line is not equal to itself.
    assert_eq!(format!("{first:?}"), format!("{second:?}"));
    let folder = tempfile::tempdir().unwrap();
    write_document(folder.path(), &first).unwrap();
    let page = std::fs::read_to_string(folder.path().join("report.html")).unwrap();
    assert!(page.contains("the paper reports 0.17 N on its own data"));
}

#[test]
fn real_recordings_give_reports_without_empty_panels() {
    let shared = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/recordings");
    if !shared.is_dir() {
        assert!(
            std::env::var("TROCAR_REQUIRE_SHARED").is_err(),
            "no recordings in {}",
            shared.display()
        );
        skipped(&format!("no recordings in {}", shared.display()));
        return;
    }
    let sets: [(&[&str], f64); 3] = [
        (&["elastomer_seals/o_ring_1bar.csv"], 0.0),
        (&["emps/identification.csv"], 95.11),
        (&["dvrk_insertion/sweep_positive.csv", "dvrk_insertion/sweep_negative.csv"], 0.0),
    ];
    for (files, mass) in sets {
        let recording = |file: &&str| {
            let recording = read(&shared.join(file), &ReadOptions::default()).unwrap();
            if mass > 0.0 { recording.without_moving_mass(mass, 0.0).unwrap() } else { recording }
        };
        let training: Vec<Recording> = files.iter().map(recording).collect();
        let options = IdentifyOptions::default();
        let identification = identify(&training, &options, &|_, _| {}).unwrap();
        let document =
            document(&plain_input(&identification, &Validated::own(&identification, &training)));
        assert_nothing_is_empty(&document);
        let folder = tempfile::tempdir().unwrap();
        write_document(folder.path(), &document).unwrap();
    }
}

/// The deflections of EMS figure 7 and the speeds of its figure 9 can be selected.
#[test]
fn levels_and_speeds_are_chosen() {
    let bench = &*BENCH;
    let choice = FigureChoice { deflections: &[-6e-3, 5e-3], speeds: &[0.08, 0.03, 0.0505] };
    let input = IdentificationReport {
        held_out: Some(&bench.held_out),
        choice,
        ..plain_input(&bench.identification, &bench.own)
    };
    check_choice(&input).unwrap();
    let document = document(&input);
    let velocity = figure(&document, "deformation-velocity");
    let names: Vec<&str> = velocity.panels[0]
        .series
        .iter()
        .map(|s| s.name.as_str())
        .filter(|n| !n.is_empty())
        .collect();
    assert_eq!(
        names,
        ["z = \u{2212}6.000 mm", "z = \u{2212}6.000 mm", "z = 5.000 mm", "z = 5.000 mm"]
    );
    assert!(velocity.caption.contains("at two deflections"), "{}", velocity.caption);
    // The force at the deflection on the branch of the measured deformations.
    let force = &bench.truth[0].params().deformation;
    for (series, expected) in
        [(0, force.insertion().force(-6e-3)), (4, force.insertion().force(5e-3))]
    {
        let found = &velocity.panels[0].series[series];
        let mean = found.y.iter().sum::<f64>() / found.y.len() as f64;
        assert!((mean - expected).abs() < 0.15, "{mean} N, expected {expected} N");
    }
    let cross = figure(&document, "cross-validation");
    let titles: Vec<&str> = cross.panels.iter().map(|panel| panel.title.as_str()).collect();
    assert_eq!(titles, ["80 mm/s", "30 mm/s", "", "", "50 mm/s", ""]);
    assert!(cross.caption.contains("at 80, 30, 50 mm/s"), "{}", cross.caption);
}

#[test]
fn levels_and_speeds_that_were_not_recorded_are_refused() {
    let bench = &*BENCH;
    let refused = |deflections: &[f64], speeds: &[f64]| {
        let input = IdentificationReport {
            held_out: Some(&bench.held_out),
            choice: FigureChoice { deflections, speeds },
            ..plain_input(&bench.identification, &bench.own)
        };
        check_choice(&input).unwrap_err().to_string()
    };
    let outside = refused(&[0.0, 9e-3], &[]);
    assert!(
        outside.starts_with("figure 7: the deflection 9 mm lies outside ±c = ±7.9"),
        "{outside}"
    );
    let speed = refused(&[], &[0.05, 0.2]);
    assert!(
        speed.starts_with(
            "figure 9: no recorded stroke has a speed within 10 % of 200 mm/s; recorded are 20, 25,"
        ),
        "{speed}"
    );
    assert_eq!(refused(&[0.0; 7], &[]), "figure 7 shows at most 6 deflections, got 7");
}

/// Whatever the units were taken for, a report is drawn in little time and space, or refused.
#[test]
fn recordings_of_any_scale_give_reports_of_bounded_size() {
    let plain = stiff_slider(&[0.02, 0.04, 0.08], true);
    let scaled =
        |column: &[f64], scale: f64| column.iter().map(|x| scale * x).collect::<Vec<f64>>();
    let mut drawn = 0;
    for [time, position, force] in [
        [1.0, 1.0, 1.0],
        [1e9, 1.0, 1.0],
        [1e-9, 1.0, 1.0],
        [1e6, 1e3, 1e3],
        [1.0, 1e-9, 1.0],
        [1.0, 1.0, 1e12],
        [1.0, 1.0, 1e-12],
        [1e-3, 10.0, 1e5],
        [1e12, 1e-6, 1e-6],
    ] {
        let began = Instant::now();
        let columns = [(&plain.time, time), (&plain.position, position), (&plain.force, force)];
        let [time, position, force] = columns.map(|(column, scale)| scaled(column, scale));
        let Ok(recording) = Recording::from_columns("scaled.csv", time, position, force) else {
            continue;
        };
        let options = IdentifyOptions { paper: true, ..IdentifyOptions::default() };
        let training = [recording];
        if let Ok(found) = identify(&training, &options, &|_, _| {}) {
            let folder = tempfile::tempdir().unwrap();
            let out = folder.path().join("report");
            write_document(
                &out,
                &document(&plain_input(&found, &Validated::own(&found, &training))),
            )
            .unwrap();
            let bytes = std::fs::metadata(out.join("report.html")).unwrap().len();
            assert!(bytes < 10_000_000, "{bytes} bytes");
            drawn += 1;
        }
        assert!(began.elapsed().as_secs() < 60, "{:?}", began.elapsed());
    }
    assert!(drawn >= 3, "only {drawn} of the reports were drawn");
    // Hand-like motion, fitted, whose figures weigh excerpts against each other.
    let seal = Element::new(ElementParams::plausible_10_5_mm().unwrap()).unwrap();
    let hand = run(&BenchConfig::default(), Protocol::Surgeon, &[seal], 3).unwrap();
    let hand = hand.to_recording("hand").unwrap();
    let slow = scaled(&hand.time, 1e9);
    let slow = [Recording::from_columns("hand.csv", slow, hand.position, hand.force).unwrap()];
    let options =
        IdentifyOptions { free_motion: false, along: false, ..IdentifyOptions::default() };
    let found = identify(&slow, &options, &|_, _| {}).unwrap();
    let began = Instant::now();
    assert!(found.fit.is_some());
    document(&plain_input(&found, &Validated::own(&found, &slow)));
    assert!(began.elapsed().as_secs() < 30, "{:?}", began.elapsed());
}
