//! A report with all its parts, from artificial recordings that resemble those of a seal.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rand::RngExt as _;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use trocar::report::{
    Axis, Cell, Document, Figure, Mark, Panel, ReportError, Role, Section, Series, Table, Tile,
    Width, write_document,
};

const HOSTILE: &str =
    "</script><script>alert(1)</script>\"'><img src=x onerror=alert(2)>&$a$\u{7}.csv";

/// Half the travel over which the seal deforms, in millimetres.
const HALF_WIDTH: f64 = 8.0;

/// An artificial seal: it deforms with the rod up to `HALF_WIDTH` and then slides. Millimetres,
/// seconds, newtons.
struct Demo {
    time: Vec<f64>,
    force: Vec<f64>,
    model: Vec<f64>,
    deflection: Vec<f64>,
}

/// Force of the seal deformed by `z` mm in the direction of `sign`, with the hump of the reversal.
fn deformation_force(z: f64, sign: f64) -> f64 {
    let u = z * sign / HALF_WIDTH;
    let hump =
        0.55 * (-((u + 0.25) / 0.22).powi(2)).exp() - 0.35 * (-((u - 0.3) / 0.2).powi(2)).exp();
    sign * (2.1 * u + hump * (1.0 - u * u))
}

fn noise(random: &mut ChaCha8Rng) -> f64 {
    (0..6).map(|_| random.random_range(-1.0..1.0)).sum::<f64>() * 0.707
}

/// Strokes of 40 mm back and forth at `speed` mm/s, sampled at 1 kHz.
fn demo(speed: f64, cycles: usize, seed: u64) -> Demo {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let half_period = 40.0 / speed;
    let samples = (2.0 * half_period * cycles as f64 * 1000.0) as usize;
    let mut demo = Demo { time: vec![], force: vec![], model: vec![], deflection: vec![] };
    let mut z: f64 = -HALF_WIDTH;
    for i in 0..samples {
        let time = i as f64 / 1000.0;
        let sign = if ((time / half_period) as usize).is_multiple_of(2) { 1.0 } else { -1.0 };
        z = (z + sign * speed / 1000.0).clamp(-HALF_WIDTH, HALF_WIDTH);
        let sliding = if z.abs() >= HALF_WIDTH { 0.004 * speed * sign } else { 0.0 };
        let model = deformation_force(z, sign) + sliding;
        demo.time.push(time);
        demo.force.push(model + 0.025 * noise(&mut random) + 0.06 * (z * 0.9).sin());
        demo.model.push(model);
        demo.deflection.push(z);
    }
    demo
}

fn time() -> Axis {
    Axis::new("time t", "s")
}

fn force() -> Axis {
    Axis::new("force F", "N")
}

fn velocity_step() -> Figure {
    let demo = demo(40.0, 1, 1);
    let from = demo.time.iter().position(|&t| t >= 0.85).expect("long enough");
    let shown: Vec<f64> = demo.time[from..].iter().map(|t| t - 1.0).collect();
    let count = shown.iter().filter(|&&t| t < 0.7).count();
    let panel = Panel::new(time(), force())
        .series(Series::line(
            "measured",
            Role::Measured,
            shown[..count].to_vec(),
            demo.force[from..][..count].to_vec(),
        ))
        .series(Series::line(
            "EMS model",
            Role::Model,
            shown[..count].to_vec(),
            demo.model[from..][..count].to_vec(),
        ))
        .mark(Mark::x_range(0.0, 0.16, "T1"))
        .mark(Mark::x_range(0.25, 0.4, "T2"))
        .mark(Mark::x(0.4, "sliding"))
        .aspect(0.5);
    Figure::new("velocity-step", 3, "Force upon a reversal of the velocity")
        .caption("Two transients, T1 and T2, follow the reversal at t = 0: the seal snaps through between them.")
        .panel(panel)
}

fn static_friction() -> Figure {
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let speeds: Vec<f64> =
        (3..=20).flat_map(|i| [5.0 * f64::from(i), -5.0 * f64::from(i)]).collect();
    let truth = |v: f64, f_c: f64, beta: f64| f_c * v.signum() + beta * v;
    let y: Vec<f64> =
        speeds.iter().map(|&v| truth(v, 2.10, 0.004) + 0.03 * noise(&mut random)).collect();
    let edge = |offset: f64| y.iter().map(|y| y + offset).collect::<Vec<_>>();
    let grid: Vec<f64> = (-100..=100).map(f64::from).collect();
    let gap = |f: &dyn Fn(f64) -> f64| -> Vec<f64> {
        grid.iter().map(|&v| if v.abs() < 0.5 { f64::NAN } else { f(v) }).collect()
    };
    let width = |v: f64| 0.02 + 0.0004 * v.abs();
    let (low, high) =
        (gap(&|v| truth(v, 2.1, 0.004) - width(v)), gap(&|v| truth(v, 2.1, 0.004) + width(v)));
    let panel = Panel::new(Axis::new("velocity v", "mm/s"), Axis::new("steady force F", "N"))
        .series(Series::band("95 % band", Role::Fit, grid.clone(), low.clone(), high.clone()))
        .series(Series::line("lower limit", Role::Lower, grid.clone(), low))
        .series(Series::line("upper limit", Role::Upper, grid.clone(), high))
        .series(Series::line("fit", Role::Fit, grid.clone(), gap(&|v| truth(v, 2.1, 0.004))))
        .series(Series::error_bars(
            "stroke means",
            Role::Measured,
            speeds,
            y.clone(),
            edge(-0.06),
            edge(0.06),
        ))
        .mark(Mark::y(2.1, "F_c"))
        .mark(Mark::y(-2.1, "−F_c"));
    Figure::new("static-friction", 6, "Static friction")
        .caption("One mean per stroke with its 95 % interval.")
        .panel(panel)
}

fn deformation_velocity() -> Figure {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let mut figure =
        Figure::new("deformation-velocity", 7, "Deformation force against deformation velocity")
            .caption("No influence of the velocity at any of the four amplitudes.")
            .columns(2);
    for amplitude in [-5.0, -2.0, 2.0, 5.0] {
        let level = deformation_force(amplitude, 1.0);
        let x: Vec<f64> = (3..=20).map(|i| 5.0 * f64::from(i)).collect();
        let y: Vec<f64> = x.iter().map(|_| level + 0.03 * noise(&mut random)).collect();
        let panel = Panel::new(Axis::new("deformation velocity dz/dt", "mm/s"), force())
            .title(format!("z = {amplitude} mm"))
            .series(Series::points("measured", Role::Measured, x, y))
            .mark(Mark::y_range(level - 0.08, level + 0.08, ""))
            .aspect(0.6);
        figure = figure.panel(panel);
    }
    figure
}

fn deformation() -> Figure {
    let demo = demo(40.0, 5, 8);
    let grid: Vec<f64> = (-80..=80).map(|i| f64::from(i) / 10.0).collect();
    let insertion = grid.iter().map(|&z| deformation_force(z, 1.0)).collect();
    let withdrawal = grid.iter().map(|&z| deformation_force(z, -1.0)).collect();
    let single = grid.iter().map(|&z| deformation_force(z, 1.0) + 0.15 * (z * 1.9).sin()).collect();
    let panel = Panel::new(Axis::new("deflection z", "mm"), Axis::new("deformation force F", "N"))
        .series(Series::line("measured, five cycles", Role::Measured, demo.deflection, demo.force))
        .series(Series::line("two joined polynomials", Role::Fit, grid.clone(), insertion))
        .series(Series::line("two joined polynomials", Role::Fit, grid.clone(), withdrawal))
        .series(Series::line("one polynomial of degree 7", Role::Alternative, grid, single))
        .mark(Mark::x(2.4, "join"))
        .mark(Mark::x(2.9, "join, falling"));
    Figure::new("deformation-force", 8, "Deformation force")
        .caption("Both branches with both fits.")
        .panel(panel)
}

fn comparison() -> Figure {
    let mut figure = Figure::new("comparison", 9, "Model against measurement")
        .caption("Force and computed deflection at the lowest and at the highest speed.")
        .columns(2);
    let speeds = [15.0, 80.0].map(|speed| (speed, demo(speed, 2, 9)));
    for (speed, demo) in &speeds {
        let panel = Panel::new(time(), force())
            .title(format!("{speed} mm/s"))
            .series(Series::line("measured", Role::Measured, demo.time.clone(), demo.force.clone()))
            .series(Series::line("EMS model", Role::Model, demo.time.clone(), demo.model.clone()));
        figure = figure.panel(panel);
    }
    for (_, demo) in speeds {
        let panel = Panel::new(time(), Axis::new("deflection z", "mm"))
            .series(Series::line("deflection", Role::Deflection, demo.time, demo.deflection))
            .aspect(0.4);
        figure = figure.panel(panel);
    }
    figure
}

fn residuals() -> Figure {
    let demo = demo(20.0, 40, 10);
    let error: Vec<f64> = demo.force.iter().zip(&demo.model).map(|(f, m)| f - m).collect();
    let above = Panel::new(time(), force())
        .series(Series::line("measured", Role::Measured, demo.time.clone(), demo.force))
        .series(Series::line("EMS model", Role::Model, demo.time.clone(), demo.model))
        .aspect(0.3);
    let below = Panel::new(time(), Axis::new("residual", "N"))
        .series(Series::line("residual", Role::Residual, demo.time, error))
        .mark(Mark::y_range(-0.05, 0.05, "±2σ"))
        .aspect(0.2);
    Figure::new("residuals", 10, "Residuals over time")
        .caption("160 s at 1 kHz.")
        .panel(above)
        .panel(below)
        .linked_x()
}

fn error_by_speed() -> Figure {
    let speeds: Vec<f64> = (3..=20).map(|i| 5.0 * f64::from(i)).collect();
    let mut panel = Panel::new(Axis::new("speed", "mm/s"), Axis::new("RMS error", "N").with_zero());
    for n in 0..6 {
        let y: Vec<f64> =
            speeds.iter().map(|v| 0.03 + 0.0002 * v * (1.0 + f64::from(n) * 0.4)).collect();
        panel = panel.series(Series::line(
            format!("validation-{n}.csv"),
            Role::Category(n),
            speeds.clone(),
            y.clone(),
        ));
        panel = panel.series(Series::points(
            format!("validation-{n}.csv"),
            Role::Category(n),
            speeds.clone(),
            y,
        ));
    }
    let panel = panel.series(Series::points(
        HOSTILE,
        Role::Reference,
        vec![50.0, f64::NAN],
        vec![0.08, 0.05],
    ));
    Figure::new("error-by-speed", 11, "Error per speed").panel(panel).width(Width::Narrow)
}

fn awkward() -> Figure {
    let nothing = Panel::new(Axis::new("x", ""), Axis::new("y", ""))
        .title("no finite value")
        .series(Series::line("nothing", Role::Neutral, vec![f64::NAN; 3], vec![f64::INFINITY; 3]));
    let constant = Panel::new(Axis::new("x", ""), Axis::new("y", ""))
        .title("constant")
        .series(Series::line("constant", Role::Neutral, vec![0.0, 1.0], vec![2.0; 2]));
    Figure::new("awkward", 12, HOSTILE).caption(HOSTILE).panel(nothing).panel(constant).columns(2)
}

fn loops(id: &str, number: u32, speed: f64) -> Figure {
    let demo = demo(speed, 3, u64::from(number));
    let panel = Panel::new(Axis::new("deflection z", "mm"), force())
        .series(Series::line("measured", Role::Measured, demo.deflection.clone(), demo.force))
        .series(Series::line("EMS model", Role::Model, demo.deflection, demo.model));
    Figure::new(id, number, format!("Loop at {speed} mm/s")).panel(panel).width(Width::Narrow)
}

fn parameters() -> Table {
    let row = |name: &str, symbol: &str, value: f64, [low, high]: [f64; 2], unit: &str| {
        [
            name.into(),
            symbol.into(),
            Cell::Estimate { value, interval: [low, high] },
            Cell::Interval { low, high },
            unit.into(),
        ]
    };
    let undetermined = Cell::Number { value: 7.0, digits: 3 };
    Table::new("Parameters", ["Parameter", "Symbol", "Value", "95 % interval", "Unit"])
        .row(row("Coulomb force", "F_c", 2.1034, [2.0891, 2.1177], "N"))
        .row(row("Viscous damping", "β", 4.02, [3.61, 4.43], "N·s/m"))
        .row(row("Half width of the deformation", "c", 8.01, [7.93, 8.09], "mm"))
        .row([
            "Stribeck velocity".into(),
            "v_s".into(),
            undetermined,
            Cell::Undetermined,
            "mm/s".into(),
        ])
}

fn document() -> Document {
    let quality = Table::new("Recordings", ["File", "Samples", "RMS (N)", "Remark"])
        .row([
            Cell::Code("steady.csv".into()),
            Cell::Number { value: 128_000.0, digits: 6 },
            0.051.into_cell(),
            "".into(),
        ])
        .row([
            Cell::Code(HOSTILE.into()),
            Cell::Number { value: 12.0, digits: 2 },
            f64::NAN.into_cell(),
            Cell::Warning("saturated".into()),
        ]);
    Document {
        title: "Identification of a one-stage seal".into(),
        subtitle: "Extended Maxwell-Slip model, four recordings".into(),
        card: vec![("Held out".into(), "surgeon.csv, 60 s".into())],
        tiles: vec![
            Tile::new("Coulomb force", "2.103 N", "2.089 to 2.118"),
            Tile::new("Viscous damping", "4.02 N·s/m", "3.61 to 4.43"),
            Tile::new("Validation RMS", "0.051 N", "sensor noise 0.025 N"),
            Tile::new("Fit", "97.1 %", ""),
        ],
        notes: Vec::new(),
        warnings: vec![
            "The Stribeck velocity is not determined: the slowest stroke is at 15 mm/s.".into(),
            HOSTILE.into(),
        ],
        sections: vec![
            Section::new("Parameters")
                .paragraph("Estimates with their 95 % intervals.")
                .table(parameters()),
            Section::new("Data").table(quality).figure(velocity_step()),
            Section::new("Identification")
                .figure(static_friction())
                .figure(deformation_velocity())
                .figure(deformation()),
            Section::new("Validation")
                .figure(comparison())
                .figure(residuals())
                .figure(error_by_speed()),
            Section::new("More")
                .figure(awkward())
                .figure(loops("loop-slow", 13, 15.0))
                .figure(loops("loop-fast", 14, 90.0)),
        ],
        provenance: vec![
            ("trocar".into(), "0.1.0".into()),
            ("steady.csv".into(), "9f86d081884c7d65".repeat(4)),
        ],
    }
}

trait IntoCell {
    fn into_cell(self) -> Cell;
}

impl IntoCell for f64 {
    fn into_cell(self) -> Cell {
        Cell::Number { value: self, digits: 2 }
    }
}

/// Writes the report into a new folder, or below `TROCAR_REPORT_DIR` for inspection.
fn written(name: &str) -> (PathBuf, Option<tempfile::TempDir>) {
    let (folder, guard) = match std::env::var_os("TROCAR_REPORT_DIR") {
        Some(parent) => (PathBuf::from(parent).join(name), None),
        None => {
            let guard = tempfile::tempdir().expect("a temporary folder");
            (guard.path().join(name), Some(guard))
        }
    };
    write_document(&folder, &document()).expect("a report");
    (folder, guard)
}

fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let all = ["", "figures"]
        .into_iter()
        .flat_map(|part| std::fs::read_dir(folder.join(part)).expect("a folder"));
    all.map(|entry| entry.expect("an entry").path())
        .filter(|path| path.is_file())
        .map(|path| {
            (
                path.strip_prefix(folder).expect("inside").to_owned(),
                std::fs::read(&path).expect("readable"),
            )
        })
        .collect()
}

fn page(folder: &Path) -> String {
    std::fs::read_to_string(folder.join("report.html")).expect("the page")
}

/// All texts between `open` and `close`.
fn between<'t>(text: &'t str, open: &'t str, close: &'t str) -> impl Iterator<Item = &'t str> {
    text.split(open).skip(1).filter_map(move |rest| rest.split_once(close).map(|(inner, _)| inner))
}

#[test]
fn equal_documents_give_equal_bytes() {
    let (first, _first) = written("first");
    let (second, _second) = written("second");
    let (first, second) = (files(&first), files(&second));
    assert_eq!(first.len(), 1 + 3 * 10);
    assert!(first == second);
}

#[test]
fn the_page_asks_nobody_for_anything() {
    let (folder, _guard) = written("offline");
    let page = page(&folder);
    // The licence text of the embedded library and the namespaces of SVG are text, not requests.
    let markup = between(&page, "<body>", "<!-- uPlot").next().expect("a body");
    let text_free: String =
        markup.split('<').filter_map(|part| part.split_once('>')).map(|(tag, _)| tag).collect();
    for attribute in [" src=", " srcset=", " data=", "url(", "http:", "https:", "iframe", " on"] {
        assert!(!text_free.contains(attribute), "{attribute} in a tag");
    }
    assert!(between(markup, "href=\"", "\"").all(|target| target.starts_with('#')));
    for css in between(&page, "<style>", "</style>") {
        assert!(!css.contains("url(") && !css.contains("@import"));
    }
    for script in between(&page, "<script>", "</script>") {
        for call in ["fetch(", "XMLHttpRequest", "WebSocket", "sendBeacon", "import("] {
            assert!(!script.contains(call), "{call}");
        }
    }
    assert!(page.contains("default-src 'none'"));
    assert!(page.len() < 1_500_000, "{} bytes", page.len());
}

#[test]
fn hostile_names_stay_text() {
    let (folder, _guard) = written("hostile");
    let page = page(&folder);
    assert_eq!(page.matches("<script").count(), page.matches("</script>").count());
    // Two scripts that run, one block of styles, one block of data for each of the ten figures.
    assert_eq!(page.matches("<script").count(), 13);
    assert!(!page.contains("<img"));
    assert!(page.contains("&lt;/script&gt;&lt;script&gt;alert(1)"));
    for (path, bytes) in files(&folder) {
        assert!(
            !String::from_utf8_lossy(&bytes).contains('\u{7}')
                || path.extension().is_some_and(|e| e == "png")
        );
    }
}

#[test]
fn chart_data_is_json_even_where_values_are_missing() {
    let (folder, _guard) = written("json");
    let page = page(&folder);
    let blocks: Vec<serde_json::Value> =
        between(&page, "<script type=\"application/json\">", "</script>")
            .map(|json| serde_json::from_str(json).expect("JSON"))
            .collect();
    assert_eq!(blocks.len(), 10);
    let awkward = blocks.iter().find(|block| block["id"] == "awkward").expect("the awkward figure");
    let panels = awkward["panels"].as_array().expect("panels");
    assert_eq!(panels.len(), 1, "axes without a value are left out");
    assert_eq!(panels[0]["title"], "constant");
    let named = blocks
        .iter()
        .find(|block| block["id"] == "error-by-speed")
        .expect("the figure with a hostile name");
    let series = named["panels"][0]["series"].as_array().expect("series");
    assert!(series.iter().any(|series| series["name"] == HOSTILE));
}

#[test]
fn pictures_are_well_formed_and_of_the_declared_size() {
    let (folder, _guard) = written("pictures");
    let all = files(&folder);
    for (path, bytes) in all.iter().filter(|(path, _)| path.extension().is_some_and(|e| e == "svg"))
    {
        let svg = std::str::from_utf8(bytes).expect("UTF-8");
        assert_well_formed(path, svg);
        let view_box = between(svg, "viewBox=\"0 0 ", "\"").next().expect("a view box");
        let (width, height) = view_box.split_once(' ').expect("two numbers");
        let [width, height] =
            [width, height].map(|number| number.parse::<f64>().expect("a number"));
        let png = &all[&path.with_extension("png")];
        assert_eq!(png[..8], *b"\x89PNG\r\n\x1a\n");
        let number =
            |at: usize| u32::from_be_bytes([png[at], png[at + 1], png[at + 2], png[at + 3]]);
        assert_eq!(
            [number(16), number(20)],
            [(2.5 * width).ceil() as u32, (2.5 * height).ceil() as u32],
            "{path:?}"
        );
        assert!(!svg.contains("NaN") && !svg.contains("\"inf"), "{path:?}");
    }
}

/// Elements are closed in order, attributes are quoted, and every ampersand is escaped.
fn assert_well_formed(path: &Path, svg: &str) {
    let mut open = Vec::new();
    let mut rest = svg;
    while let Some((text, tail)) = rest.split_once('<') {
        assert!(!text.contains('>'), "{path:?}: a bare > in {text:?}");
        for entity in text.split('&').skip(1) {
            assert!(
                entity.split_once(';').is_some_and(|(name, _)| name.len() <= 5),
                "{path:?}: {entity:?}"
            );
        }
        if let Some(comment) = tail.strip_prefix("!--") {
            rest = comment.split_once("-->").expect("a closed comment").1;
            continue;
        }
        let (tag, after) = tail.split_once('>').expect("a closed tag");
        assert!(tag.matches('"').count() % 2 == 0, "{path:?}: {tag}");
        let name = tag.split([' ', '/']).find(|part| !part.is_empty()).expect("a name");
        if tag.starts_with('/') {
            assert_eq!(open.pop(), Some(name), "{path:?}");
        } else if !tag.ends_with('/') {
            open.push(name);
        }
        rest = after;
    }
    assert!(open.is_empty(), "{path:?}: {open:?} stay open");
}

#[test]
fn what_the_data_do_not_pin_is_said_and_numbers_follow_their_interval() {
    let (folder, _guard) = written("table");
    let page = page(&folder);
    let row = between(&page, "<th scope=\"row\">Stribeck velocity</th>", "</tr>")
        .next()
        .expect("the row");
    assert!(row.contains("not determined by the data") && !row.contains("inf"));
    let row =
        between(&page, "<th scope=\"row\">Coulomb force</th>", "</tr>").next().expect("the row");
    assert!(row.contains(">2.103<") && row.contains("[2.089, 2.118]"), "{row}");
}

#[test]
fn malformed_documents_are_refused_before_anything_is_written() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let target = folder.path().join("report");
    let refused = |change: &dyn Fn(&mut Document)| {
        let mut document = document();
        change(&mut document);
        let error = write_document(&target, &document).expect_err("a refusal");
        assert!(!target.exists());
        error.to_string()
    };
    let path = refused(&|document| document.sections[1].figures[0].id = "../../etc/passwd".into());
    assert!(path.contains("must consist of a-z"), "{path}");
    let twice = refused(&|document| document.sections[1].figures[0].id = "comparison".into());
    assert!(twice.contains("\"comparison\" occurs twice"), "{twice}");
    let short =
        refused(&|document| document.sections[1].figures[0].panels[0].series[0].y.truncate(3));
    assert!(short.contains("columns of different lengths"), "{short}");
    let ragged = refused(&|document| document.sections[0].tables[0].rows[1].truncate(2));
    assert!(ragged.contains("rows of different lengths"), "{ragged}");
}

#[test]
fn a_logarithmic_axis_takes_equal_ratios_for_equal_lengths_and_leaves_out_what_has_none() {
    let axes = Panel::new(
        Axis::new("parameters", "").logarithmic(),
        Axis::new("error", "N").logarithmic(),
    );
    let points = Series::points(
        "found",
        Role::Model,
        vec![1.0, 10.0, 100.0, 5.0],
        vec![0.1, 1.0, 10.0, 0.0],
    );
    let text = Series::labelled("", Role::Fit, vec![3.0], vec![0.3], vec!["A & B".to_owned()]);
    let figure = Figure::new("ratios", 1, "Ratios")
        .panel(axes.series(points).series(text).mark(Mark::y(-1.0, "no place")));
    let mut document =
        Document { sections: vec![Section::new("Ratios").figure(figure)], ..Document::default() };
    let folder = tempfile::tempdir().expect("a temporary folder");
    write_document(folder.path(), &document).expect("a report");
    let svg =
        std::fs::read_to_string(folder.path().join("figures/ratios.svg")).expect("the figure");
    assert!(!svg.contains("NaN") && !svg.contains("inf") && !svg.contains("no place"), "{svg}");
    assert!(svg.contains("A &amp; B"));
    let page = page(folder.path());
    let json = between(&page, "<script type=\"application/json\">", "</script>")
        .next()
        .expect("chart data");
    let panel = &serde_json::from_str::<serde_json::Value>(json).expect("JSON")["panels"][0];
    assert_eq!(panel["logarithmic"], serde_json::json!([true, true]));
    assert_eq!(panel["series"][1]["labels"], serde_json::json!(["A & B"]));
    // 2 % of the decades on both sides.
    let limit = |k: usize| panel["limits"][k].as_f64().expect("a limit").log10();
    assert!(
        (limit(0) + 0.04).abs() < 1e-9 && (limit(1) - 2.04).abs() < 1e-9,
        "{}",
        panel["limits"]
    );
    document.sections[0].figures[0].panels[0].series[1] =
        Series::labelled("", Role::Fit, vec![3.0, 4.0], vec![0.3, 0.4], vec!["one".to_owned()]);
    let error =
        write_document(&folder.path().join("other"), &document).expect_err("a text is missing");
    assert!(error.to_string().contains("columns of different lengths"), "{error}");
}

#[test]
fn a_file_in_the_way_is_named() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let blocked = folder.path().join("report");
    std::fs::write(&blocked, "a file, not a folder").expect("writable");
    let error = write_document(&blocked, &document()).expect_err("no folder can be made there");
    assert!(matches!(&error, ReportError::Output(_)));
    assert!(error.to_string().contains("report"), "{error}");
}

/// `cargo test --release -p trocar --test all report:: -- --ignored --nocapture` prints both
/// figures.
#[test]
#[ignore = "measures time and memory: run alone, in a release build"]
fn ten_figures_take_less_than_half_a_second_and_little_memory() {
    let document = document();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let before = peak_memory_mib();
    let start = std::time::Instant::now();
    write_document(folder.path(), &document).expect("a report");
    let elapsed = start.elapsed();
    let added = peak_memory_mib().zip(before).map(|(after, before)| after - before);
    println!("ten figures and the page: {elapsed:.2?}");
    if let (Some(added), Some(before)) = (added, before) {
        println!("peak memory +{added:.1} MiB, from {before:.1} MiB");
    }
    assert!(elapsed.as_secs_f64() < 0.5);
    assert!(added.is_none_or(|mebibytes| mebibytes < 100.0));
}

/// Peak resident memory so far; `None` if the system has no `/proc`.
fn peak_memory_mib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let kibibytes: f64 = between(&status, "VmHWM:", "kB").next()?.trim().parse().ok()?;
    Some(kibibytes / 1024.0)
}
