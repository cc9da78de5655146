//! docs/troubleshooting.md holds every message of the program, and none that it no longer has.
//!
//! `TROCAR_WRITE_DOCS=1 cargo test -p trocar-cli --test all messages` writes new messages into the page and takes old ones out;
//! what is explained there stays.
//!
//! A message is a text of three words or more in the sources of Rust and Python, or of any length in `#[error]`; of the scripts of the
//! pages, what is thrown, written to the console, or shown as a refusal. Left out are texts that go elsewhere: into reports, generated files, tables of results, or nowhere (`expect`, assertions, tests).

mod find;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

use find::{of_javascript, of_python, of_rust};

/// Sections of the page, and the sources whose messages they hold. The longest prefix takes a source.
const SECTIONS: [(&str, &[&str]); 17] = [
    (
        "Reading recordings",
        &[
            "trocar-recording/src/formats",
            "trocar-recording/src",
            "trocar-tables/src/ros",
            "trocar-tables/src/text",
        ],
    ),
    (
        "Model files and parameters",
        &["trocar-runtime/src/model_file", "trocar-runtime/src/profile", "trocar-model/src"],
    ),
    ("identify", &["trocar-identify/src", "trocar/src/survey", "trocar-cli/src/verbs/identify"]),
    ("validate", &["trocar-identify/src/validate", "trocar-cli/src/verbs/validate"]),
    ("compare", &["trocar-lab/src/compare", "trocar-cli/src/verbs/compare"]),
    (
        "simulate",
        &[
            "trocar-simulate/src/simulate",
            "trocar-simulate/src/many",
            "trocar-cli/src/verbs/simulate",
        ],
    ),
    (
        "compensate",
        &[
            "trocar/src/compensate",
            "trocar-runtime/src/compensate",
            "trocar-cli/src/verbs/compensate",
        ],
    ),
    ("analyze", &["trocar/src/analyze", "trocar-cli/src/verbs/analyze"]),
    ("plan", &["trocar-lab/src/plan", "trocar-cli/src/verbs/plan"]),
    (
        "bench and ranges",
        &["trocar-simulate/src/bench", "trocar-cli/src/verbs/bench", "trocar-cli/src/verbs/ranges"],
    ),
    ("teleop", &["trocar-lab/src/teleop", "trocar-cli/src/verbs/teleop"]),
    ("fleet", &["trocar-lab/src/fleet", "trocar-cli/src/verbs/fleet"]),
    (
        "export, and inside a simulation program",
        &["trocar/src/export", "trocar-cli/src/verbs/export", "trocar-fmu/src"],
    ),
    (
        "Reports and live pages in a browser",
        &["trocar-report/src/assets", "trocar-web-teleop/src", "trocar-web/src"],
    ),
    (
        "All commands: input, output, reports",
        &[
            "trocar/src",
            "trocar-cli/src",
            "trocar-lab/src",
            "trocar-report/src",
            "trocar-simulate/src",
            "trocar-tables/src",
        ],
    ),
    ("Python", &["trocar-py/src", "python/trocar"]),
    ("C", &["trocar-capi/src"]),
];

/// Sources whose texts are no messages: what they make instead.
const ELSEWHERE: [(&str, &str); 17] = [
    ("trocar-report/src/", "reports; their errors are in lib.rs"),
    ("trocar/src/export/c/", "C sources"),
    ("trocar-cli/src/examples.rs", "help"),
    ("trocar-cli/src/reference.rs", "the page of the command line"),
    ("trocar-cli/src/main.rs", "help"),
    ("trocar-cli/src/verbs/completions.rs", "help"),
    ("trocar-model/src/parameter.rs", "names of parameters"),
    ("trocar-fmu/src/variables.rs", "descriptions in an FMU"),
    ("trocar-fmu/src/package/page.rs", "the page in an FMU"),
    ("trocar-fmu/src/package/description.rs", "descriptions in an FMU"),
    ("trocar-fmu/src/package/source.rs", "sources in an FMU"),
    ("trocar-fmu/src/library.rs", "the build of the program"),
    ("trocar-proof/", "evidence for tests"),
    ("python/trocar/_show.py", "results in a notebook"),
    ("python/trocar/_plot.py", "figures"),
    ("python/trocar/_report.py", "results as text"),
    ("python/trocar/_progress.py", "a bar of progress"),
];

/// Functions and constants whose texts are names of things or parts of tables, by source.
const NAMES: [(&str, &[&str]); 20] = [
    ("trocar-cli/src/table.rs", &["interval"]),
    ("trocar-cli/src/progress.rs", &["new", "left"]),
    ("trocar-cli/src/verbs/ranges.rs", &["details", "drawn", "span"]),
    ("trocar-cli/src/verbs/compare.rs", &["models_help"]),
    ("trocar-cli/src/verbs/plan.rs", &["text"]),
    (
        "trocar-cli/src/verbs/teleop.rs",
        &["text", "z_width_text", "advice_text", "step_text", "tried", "partly_stable", "map_text"],
    ),
    ("trocar-cli/src/verbs/inspect.rs", &["help", "rows_in_words", "column_in_words"]),
    ("trocar-cli/src/verbs/analyze.rs", &["text", "element_text", "branch_text", "steady_table"]),
    ("trocar-simulate/src/bench/published.rs", &["name", "words"]),
    ("trocar-lab/src/compare/mod.rs", &["title"]),
    ("trocar-identify/src/prior.rs", &["words", "weak_priors"]),
    ("trocar-identify/src/terms.rs", &["words"]),
    ("trocar-identify/src/options.rs", &["in_words"]),
    ("trocar-identify/src/classical/kind.rs", &["COULOMB_VISCOUS", "DAHL"]),
    ("trocar-lab/src/plan/goal.rs", &["fmt"]),
    ("trocar-lab/src/plan/blocks.rs", &["fmt"]),
    ("trocar-lab/src/teleop/merit.rs", &["rows"]),
    (
        "trocar-recording/src/formats/rosbag.rs",
        &["list", "definitions", "counts", "first", "page", "connect"],
    ),
    ("trocar-tables/src/ros/definition.rs", &["STANDARD"]),
    ("trocar-fmu/src/package/mod.rs", &["LICENCES"]),
];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// All files below `folder` with this extension, in order.
fn files(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder of sources") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            found.extend(files(&path, extension));
        } else if path.extension().is_some_and(|own| own == extension) {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// The sources by the name that the tables above use, with their texts.
fn sources() -> Vec<(String, String)> {
    let root = root();
    let crates = std::fs::read_dir(root.join("crates")).expect("crates");
    let folders =
        crates.map(|one| one.expect("a crate").path().join("src")).filter(|src| src.is_dir());
    let mut paths: Vec<PathBuf> = folders.flat_map(|src| files(&src, "rs")).collect();
    paths.extend(files(&root.join("crates/trocar-report/src/assets"), "js"));
    // A library of others, which speaks to nobody.
    paths.retain(|path| !path.ends_with("uplot/uPlot.iife.min.js"));
    paths.extend(files(&root.join("python/trocar"), "py"));
    paths.sort();
    let named = |path: PathBuf| {
        let whole = path.strip_prefix(&root).expect("inside the repository").display().to_string();
        let whole = whole.replace('\\', "/");
        let name = whole.strip_prefix("crates/").unwrap_or(&whole).to_owned();
        (name, std::fs::read_to_string(&path).expect("a source"))
    };
    paths.into_iter().map(named).collect()
}

/// The messages of each section, in the order of the sources, each once.
fn messages() -> Vec<Vec<String>> {
    let mut of_sections = vec![Vec::new(); SECTIONS.len()];
    let mut seen = BTreeSet::new();
    let section_of = |name: &str| {
        let fits = |all: &[&str]| {
            all.iter().filter(|prefix| name.starts_with(**prefix)).map(|prefix| prefix.len()).max()
        };
        let sections = SECTIONS.iter().enumerate();
        let longest = sections.filter_map(|(k, (_, all))| Some((fits(all)?, k))).max();
        longest.map(|(_, k)| k)
    };
    let sources = sources();
    for (section, of_section) in of_sections.iter_mut().enumerate() {
        for (name, text) in sources.iter().filter(|(name, _)| section_of(name) == Some(section)) {
            let whole = !ELSEWHERE.iter().any(|(prefix, _)| name.starts_with(prefix));
            let names = NAMES.iter().find(|(file, _)| file == name).map_or(&[][..], |(_, all)| all);
            let found = match name.rsplit('.').next() {
                Some("py") => of_python(text, whole),
                Some("js") => of_javascript(text),
                _ => of_rust(text, whole, names),
            };
            let new = found.into_iter().filter(|message| seen.insert(message.clone()));
            of_section.extend(new);
        }
    }
    of_sections
}

/// A message as code of Markdown.
fn code(message: &str) -> String {
    if message.contains('`') { format!("`` {message} ``") } else { format!("`{message}`") }
}

/// The page in parts: its head, and by title what stands below a section's heading and what explains each message.
struct Page {
    head: String,
    openings: BTreeMap<String, String>,
    explanations: BTreeMap<String, String>,
}

const FURTHER: &str = "**Further messages**";

impl Page {
    fn read(text: &str) -> Self {
        let mut sections = text.split("\n## ");
        let mut page = Self {
            head: sections.next().unwrap_or_default().trim_end().to_owned(),
            openings: BTreeMap::new(),
            explanations: BTreeMap::new(),
        };
        for section in sections {
            let (title, body) = section.split_once('\n').unwrap_or((section, ""));
            let mut entries = format!("\n{body}").replace(FURTHER, "");
            entries.push('\n');
            let mut entries =
                entries.split("\n- `").map(str::to_owned).collect::<Vec<_>>().into_iter();
            let opening = entries.next().unwrap_or_default();
            page.openings.insert(title.to_owned(), opening.trim().to_owned());
            for entry in entries {
                let (message, explanation) = entry.split_once('\n').unwrap_or((&entry, ""));
                let message = message.trim_matches('`').trim();
                page.explanations.insert(message.to_owned(), explanation.trim().to_owned());
            }
        }
        page
    }

    fn write(&self, messages: &[Vec<String>]) -> String {
        let mut text = format!("{}\n", self.head);
        for ((title, _), messages) in SECTIONS.iter().zip(messages) {
            if messages.is_empty() {
                continue;
            }
            text += &format!("\n## {title}\n");
            if let Some(opening) = self.openings.get(*title).filter(|opening| !opening.is_empty()) {
                text += &format!("\n{opening}\n");
            }
            let explanation =
                |message: &&String| self.explanations.get(*message).filter(|e| !e.is_empty());
            let (known, further): (Vec<&String>, Vec<&String>) =
                messages.iter().partition(|message| explanation(message).is_some());
            for message in known {
                let words = explanation(&message).expect("it is known");
                text += &format!("\n- {}\n\n  {words}\n", code(message));
            }
            if !further.is_empty() {
                text += &format!("\n{FURTHER}\n\n");
                text.extend(further.into_iter().map(|message| format!("- {}\n", code(message))));
            }
        }
        text
    }
}

#[test]
fn the_page_holds_every_message() {
    let path = root().join("docs/troubleshooting.md");
    let kept = std::fs::read_to_string(&path).unwrap_or_default();
    let (page, messages) = (Page::read(&kept), messages());
    let written = page.write(&messages);
    if std::env::var_os("TROCAR_WRITE_DOCS").is_some() {
        std::fs::write(&path, &written).expect("the page");
        return;
    }
    let of_program: BTreeSet<&String> = messages.iter().flatten().collect();
    let of_page: BTreeSet<&String> = page.explanations.keys().collect();
    let missing: Vec<_> = of_program.difference(&of_page).collect();
    let old: Vec<_> = of_page.difference(&of_program).collect();
    assert!(
        missing.is_empty() && old.is_empty() && written == kept,
        "docs/troubleshooting.md\nhas not {missing:#?}\nhas, unlike the program, {old:#?}\n\
         run TROCAR_WRITE_DOCS=1 cargo test -p trocar-cli --test all messages, and explain what is new"
    );
}

/// Whether `printed` is `message` with something in place of each name in braces.
fn is_of(printed: &str, message: &str) -> bool {
    let parts = message
        .split('{')
        .flat_map(|part| part.split_once('}').map_or([part, ""], |(_, after)| ["", after]));
    let mut rest = Some(printed);
    for part in parts.filter(|part| !part.trim().is_empty()) {
        rest = rest.and_then(|rest| rest.split_once(part)).map(|(_, after)| after);
    }
    rest.is_some()
}

#[test]
fn what_the_program_prints_is_on_the_page() {
    let page = Page::read(
        &std::fs::read_to_string(root().join("docs/troubleshooting.md")).expect("the page"),
    );
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("numbers.csv"), "0,0,1\n0.001,0.00001,1\n0.002,0.00002,1\n")
        .unwrap();
    std::fs::write(folder.path().join("words.csv"), "time_s,position_m,force_n\n0,0,1\n1,off,1\n")
        .unwrap();
    std::fs::write(folder.path().join("model.json"), "{\"format\": \"other\"}").unwrap();
    std::fs::write(folder.path().join("rig.toml"), "[motor]\nspeed = 3\n").unwrap();
    let cases = [
        "inspect missing.csv",
        "identify numbers.csv --out a",
        "identify words.csv --out a",
        "simulate missing.json words.csv --out b.csv",
        "simulate model.json words.csv --out b.csv",
        "bench steady --out missing/steady.csv",
        "bench steady --rig rig.toml --out steady.csv",
        "compare words.csv --models gauss",
        "teleop --model plausible --draws 3 --advise",
    ];
    for case in cases {
        let mut program = Command::new(env!("CARGO_BIN_EXE_trocar"));
        let output = program.current_dir(folder.path()).args(case.split(' ')).output().unwrap();
        assert!(!output.status.success(), "{case} has no error");
        let printed = String::from_utf8(output.stderr).unwrap();
        let printed = printed.split_whitespace().collect::<Vec<_>>().join(" ");
        // Some words of its own, not names in braces alone.
        let words = |message: &str| message.split(['{', '}']).step_by(2).collect::<String>().len();
        let found =
            page.explanations.keys().any(|message| words(message) > 12 && is_of(&printed, message));
        assert!(found, "trocar {case}: not on the page: {printed}");
    }
}
