//! The live model of a report in a browser, as a reader uses it, against the library.
//!
//! Needs Node, npm and Chromium; `playwright-core` is put into the folder of the build. Skipped
//! with a message where one of them is missing; with `CI=true` that is a failure.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Deserialize;
use trocar_model::{Seal, Trocar, TrocarState};

use crate::common::Ran;
use crate::skipped::skipped;

const PLAYWRIGHT: &str = "playwright-core@1.64.1";
const BROWSERS: [&str; 4] =
    ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];
/// Sums of squares may be rounded otherwise in the page: relative.
const ROUNDING: f64 = 1e-12;
/// Largest growth of a report by its live model, bytes.
const LARGEST: usize = 100_000;

/// What the page holds.
#[derive(Deserialize)]
struct Page {
    row: String,
    knobs: Vec<Knob>,
    excerpt: Excerpt,
}

#[derive(Deserialize)]
struct Knob {
    name: String,
    value: f64,
    follows: Option<usize>,
    range: Option<[f64; 2]>,
    interval: Option<[f64; 2]>,
}

#[derive(Deserialize)]
struct Excerpt {
    interval: f64,
    position: Codes,
    force: Codes,
    known: usize,
}

#[derive(Deserialize)]
struct Codes {
    low: f64,
    high: f64,
    codes: String,
}

impl Codes {
    fn values(&self) -> Vec<f64> {
        let step = (self.high - self.low) / 65534.0;
        let bytes = STANDARD.decode(&self.codes).unwrap();
        bytes
            .chunks_exact(2)
            .map(|b| self.low + f64::from(u16::from_le_bytes([b[0], b[1]])) * step)
            .collect()
    }
}

/// What the browser saw.
#[derive(Debug, Deserialize)]
struct Seen {
    text: BTreeMap<String, String>,
    value: BTreeMap<String, String>,
    knobs: BTreeMap<String, String>,
    #[serde(default)]
    message: String,
}

impl Seen {
    fn number(&self, name: &str) -> f64 {
        self.value[name].parse().unwrap()
    }
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Desktop {
    start: Seen,
    turned: Seen,
    impossible: Seen,
    reset: Seen,
    dragged: Seen,
    dragged_turned: Seen,
    before_keys: f64,
    after_keys: f64,
    drawn: Seen,
}

#[derive(Debug, Deserialize)]
struct Telephone {
    before: f64,
    after: f64,
    overflow: f64,
    player: bool,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Paper {
    on_screen: bool,
    notice: bool,
    live: bool,
    overflow: f64,
    tables: Vec<bool>,
}

#[derive(Debug, Deserialize)]
struct Without {
    absent: bool,
    figures: usize,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Result {
    desktop: Desktop,
    telephone: Telephone,
    paper: Paper,
    complaints: Vec<String>,
    asked: Vec<String>,
    no_script: Without,
    no_web_assembly: Without,
}

/// A motion with the forces of the page, as it was downloaded.
pub(crate) struct Motion {
    pub(crate) time: Vec<f64>,
    pub(crate) position: Vec<f64>,
    pub(crate) force: Vec<f64>,
}

/// The rows of a file with this header.
pub(crate) fn rows<const N: usize>(path: &Path, header: [&str; N]) -> Vec<[f64; N]> {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some(&*header.join(",")));
    let row = |line: &str| line.split(',').map(|value| value.parse().unwrap()).collect::<Vec<_>>();
    lines.map(|line| row(line).try_into().unwrap()).collect()
}

impl Motion {
    pub(crate) fn read(path: &Path) -> Self {
        let rows = rows(path, ["time_s", "position_m", "force_n"]);
        let column = |k: usize| rows.iter().map(|row| row[k]).collect();
        Self { time: column(0), position: column(1), force: column(2) }
    }

    /// Forces that the library gives from `state` on.
    fn host(&self, trocar: &Trocar<&[f64]>, mut state: TrocarState) -> Vec<f64> {
        let mut all = vec![state.force()];
        for i in 1..self.time.len() {
            all.push(trocar.step_to(&mut state, self.position[i], self.time[i] - self.time[i - 1]));
        }
        all
    }

    pub(crate) fn assert_forces(&self, what: &str, trocar: &Trocar<&[f64]>, state: TrocarState) {
        let host = self.host(trocar, state);
        let differs = host.iter().zip(&self.force).position(|(a, b)| a.to_bits() != b.to_bits());
        assert_eq!(host.len(), self.force.len(), "{what}");
        assert_eq!(
            differs.map(|i| (i, host[i], self.force[i])),
            None,
            "{what}: row, library, page"
        );
    }

    pub(crate) fn travel(&self) -> f64 {
        self.position.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum()
    }
}

/// Reports why nothing is tested; in CI it fails.
pub(crate) fn skip(why: &str) {
    assert_ne!(std::env::var("CI").as_deref(), Ok("true"), "{why}");
    skipped(why);
}

/// Where a program is.
fn find(program: &str) -> Option<PathBuf> {
    let paths = std::env::var_os("PATH")?;
    std::env::split_paths(&paths).map(|folder| folder.join(program)).find(|file| file.is_file())
}

/// Browser and folder of `playwright-core`, or what is missing.
pub(crate) fn tools() -> std::result::Result<[PathBuf; 2], String> {
    if let Some(program) = ["node", "npm"].into_iter().find(|program| find(program).is_none()) {
        return Err(format!("no {program}"));
    }
    let browser = BROWSERS.into_iter().find_map(find).ok_or("no Chromium")?;
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("playwright");
    fs::create_dir_all(&folder).map_err(|error| error.to_string())?;
    let made = folder.join("made-of.txt");
    if !fs::read_to_string(&made).is_ok_and(|version| version == PLAYWRIGHT) {
        fs::write(folder.join("package.json"), "{}\n").map_err(|error| error.to_string())?;
        let mut install = Command::new("npm");
        install
            .args(["install", "--no-save", "--no-audit", "--no-fund", "--silent", PLAYWRIGHT])
            .current_dir(&folder);
        let output = install.output().map_err(|error| error.to_string())?;
        if !output.status.success() {
            return Err(format!(
                "npm cannot install {PLAYWRIGHT}: {}",
                String::from_utf8_lossy(&output.stderr)
            ));
        }
        fs::write(made, PLAYWRIGHT).map_err(|error| error.to_string())?;
    }
    Ok([browser, folder])
}

fn demo(folder: &Path) -> Ran {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trocar"));
    Ran::from(command.args(["demo", "--quiet", "--out"]).arg(folder).output().unwrap())
}

/// The numbers inside the page, and the bytes that the model takes there.
fn page_of(html: &str) -> (Page, usize) {
    let live = &html[html.find("<div id=\"live\"").expect("a live model")..];
    let live = &live[..live.find("</div>").unwrap()];
    let json = live
        .split_once("<script type=\"application/json\">")
        .unwrap()
        .1
        .split_once("</script>")
        .unwrap()
        .0;
    (serde_json::from_str(json).unwrap(), live.len())
}

#[test]
fn a_reader_turns_drags_and_draws_and_sees_the_forces_of_the_library() {
    let [browser, modules] = match tools() {
        Ok(tools) => tools,
        Err(why) => return skip(&why),
    };
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("demo");
    demo(&folder);
    let report = folder.join("report.html");
    let (page, size) = page_of(&fs::read_to_string(&report).unwrap());
    assert!(size < LARGEST, "{size} bytes");
    let mut drive = Command::new("node");
    drive.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/live/drive.mjs"));
    let ran =
        Ran::from(drive.arg(modules).arg(browser).arg(&report).arg(place.path()).output().unwrap())
            .ends_with(0);
    let seen: Result = serde_json::from_str(&ran.stdout).unwrap();
    assert!(
        seen.complaints.is_empty() && seen.asked.is_empty(),
        "{:?} {:?}",
        seen.complaints,
        seen.asked
    );
    check_desktop(&page, &seen.desktop, place.path());
    assert_simulate_agrees(&folder.join("model.json"), &place.path().join("dragged.csv"));
    check_telephone(&seen.telephone);
    check_paper(&seen.paper);
    for (without, what) in [(&seen.no_script, "JavaScript"), (&seen.no_web_assembly, "WebAssembly")]
    {
        assert!(without.absent && without.figures > 5, "without {what}: {without:?}");
    }
}

fn check_desktop(page: &Page, seen: &Desktop, folder: &Path) {
    let bytes = STANDARD.decode(&page.row).unwrap();
    let row: Vec<f64> =
        bytes.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap())).collect();
    let found = Trocar::from_numbers(&row).unwrap();
    let motion = |name: &str| Motion::read(&folder.join(name));
    let (position, force) = (page.excerpt.position.values(), page.excerpt.force.values());

    let recorded = motion("recorded.csv");
    assert_eq!(recorded.position, position);
    assert!(
        recorded.time.iter().enumerate().all(|(i, time)| *time == i as f64 * page.excerpt.interval)
    );
    recorded.assert_forces("recorded", &found, found.rest_at_force(position[0], force[0]));
    check_error(&seen.start, page, &recorded.force);

    // What was turned, both directions alike, and nothing else.
    assert!(
        page.knobs[1].name.contains("insertion") && page.knobs[5].follows == Some(1),
        "Coulomb force"
    );
    let turned: f64 = seen.turned.knobs["1"].parse().unwrap();
    let [low, high] = page.knobs[1].range.unwrap();
    assert!(turned > page.knobs[1].value + 0.04 * (high - low), "{turned} N");
    let tuned = found.with_seal(turned_seal(page, &found, turned));
    let by_slider = motion("recorded-turned.csv");
    by_slider.assert_forces("turned", &tuned, tuned.rest_at_force(position[0], force[0]));
    check_error(&seen.turned, page, &by_slider.force);
    assert!(seen.turned.number("error") > 2.0 * seen.start.number("error"));
    assert!(seen.turned.text["error"].contains("as identified"), "{:?}", seen.turned.text);
    assert!(seen.impossible.message.contains("no model"), "{:?}", seen.impossible.message);
    assert_eq!(seen.impossible.value, seen.turned.value, "the last one that works is shown");
    assert_eq!((&seen.reset.value, &seen.reset.knobs), (&seen.start.value, &seen.start.knobs));

    let dragged = motion("dragged.csv");
    assert!(
        dragged.time.len() > 200 && dragged.travel() > 0.02,
        "{} rows, {} m",
        dragged.time.len(),
        dragged.travel()
    );
    dragged.assert_forces("dragged", &found, found.rest(dragged.position[0]));
    assert_eq!(seen.dragged.number("force").to_bits(), dragged.force.last().unwrap().to_bits());
    let shown = format!("{:.2} N", dragged.force.last().unwrap()).replace('-', "\u{2212}");
    assert_eq!(seen.dragged.text["force"], shown);
    let again = motion("dragged-turned.csv");
    assert_eq!(
        (&again.time, &again.position),
        (&dragged.time, &dragged.position),
        "the same motion once more"
    );
    let most = seen.dragged_turned.knobs["1"].parse().unwrap();
    let tuned = found.with_seal(turned_seal(page, &found, most));
    again.assert_forces("dragged, turned", &tuned, tuned.rest(again.position[0]));
    assert_eq!(
        seen.after_keys,
        (10.0 * (seen.before_keys - 5.0)).round() / 10.0,
        "five presses, a millimetre each"
    );

    let drawn = motion("drawn.csv");
    assert!(
        drawn.time.len() > 7_000 && drawn.travel() > 0.05,
        "{} rows, {} m",
        drawn.time.len(),
        drawn.travel()
    );
    drawn.assert_forces("drawn", &found, found.rest(drawn.position[0]));
    assert_eq!(seen.drawn.number("force").to_bits(), drawn.force.last().unwrap().to_bits());
    assert!(
        page.knobs.iter().any(|knob| knob.interval.is_some_and(|[low, high]| low < high)),
        "an interval is marked"
    );
}

/// The identified model with another Coulomb force on either side.
fn turned_seal(page: &Page, found: &Trocar<&[f64]>, force: f64) -> Seal {
    let turned = |(at, knob): (usize, &Knob)| {
        if at == 1 || knob.follows == Some(1) { force } else { knob.value }
    };
    let values: Vec<f64> = page.knobs.iter().enumerate().map(turned).collect();
    found.seal().tuned(&values).unwrap()
}

/// The error on the page is that of these forces against the excerpt, from where the start is
/// forgotten.
fn check_error(seen: &Seen, page: &Page, force: &[f64]) {
    assert_eq!(seen.number("force").to_bits(), force.last().unwrap().to_bits());
    let measured = page.excerpt.force.values();
    let squares: Vec<f64> =
        (page.excerpt.known..force.len()).map(|i| (measured[i] - force[i]).powi(2)).collect();
    let error = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    assert!(
        (seen.number("error") / error - 1.0).abs() < ROUNDING,
        "{} N, expected {error} N",
        seen.number("error")
    );
}

/// `trocar simulate` gives the forces of the page for the motion that was dragged there.
fn assert_simulate_agrees(model: &Path, motion: &Path) {
    let page = Motion::read(motion);
    let rows =
        page.time.iter().zip(&page.position).map(|(time, position)| format!("{time},{position}\n"));
    let bare = motion.with_extension("bare.csv");
    fs::write(&bare, format!("time_s,position_m\n{}", rows.collect::<String>())).unwrap();
    let mut simulate = Command::new(env!("CARGO_BIN_EXE_trocar"));
    simulate.arg("simulate").args([model, &bare]).args(["--out", "-", "--quiet"]);
    let text = Ran::from(simulate.output().unwrap()).ends_with(0).stdout;
    let forces: Vec<f64> =
        text.lines().skip(1).map(|line| line.split(',').nth(2).unwrap().parse().unwrap()).collect();
    let differs = forces.iter().zip(&page.force).position(|(a, b)| a != b);
    assert_eq!(differs.map(|i| (i, forces[i], page.force[i])), None, "row, trocar simulate, page");
    assert_eq!(forces.len(), page.force.len());
}

fn check_telephone(seen: &Telephone) {
    assert!(
        seen.after < seen.before - 2.0,
        "a finger moved it from {} to {} mm",
        seen.before,
        seen.after
    );
    assert!(seen.overflow <= 0.0, "{} px wider than the screen", seen.overflow);
    assert!(!seen.player, "nothing plays where motion is to be reduced");
}

/// On paper a sentence stands for the live model, collapsed tables are open, and nothing is clipped.
fn check_paper(seen: &Paper) {
    assert!(seen.notice && !seen.on_screen && !seen.live, "{seen:?}");
    assert!(seen.tables.len() > 3 && seen.tables.iter().all(|is_visible| *is_visible), "{seen:?}");
    assert!(seen.overflow <= 0.0, "{} px wider than the paper", seen.overflow);
}
