//! `trocar fleet` as a process: one table whatever the threads, kills and order of work; faults are
//! rows.

use std::collections::HashSet;
use std::fs;
use std::process::Stdio;
use std::time::{Duration, Instant};

use crate::common::{Place, names_in};
use trocar::table::{self, Column, Table};

/// A folder of recordings by type and use, two of them no recordings.
fn place() -> Place {
    let place = Place::new();
    let rig = "[protocol.validation]\nstroke_m = 0.04\nslowest_m_s = 0.04\nfastest_m_s = 0.1\nincrement_m_s = 0.02\n";
    fs::write(place.path("rig.toml"), rig).unwrap();
    for (seed, folder) in
        (1..).zip(["a", "b"].iter().flat_map(|kind| [0, 20, 40].map(|n| (kind, n))))
    {
        let folder = format!("set/trocar_type={}/insertion_count={}", folder.0, folder.1);
        fs::create_dir_all(place.path(&folder)).unwrap();
        place
            .run(&format!(
                "--quiet bench validation --rig rig.toml --seed {seed} --out {folder}/strokes.csv"
            ))
            .ends_with(0);
    }
    fs::write(place.path("set/words.csv"), "these,are,words\n").unwrap();
    fs::write(place.path("set/short.csv"), "time_s,position_m,force_n\n0,0,0\n1,1,1\n").unwrap();
    fs::write(place.path("set/notes.md"), "not a recording\n").unwrap();
    place
}

fn texts<'a>(table: &'a Table, name: &str) -> Vec<&'a str> {
    let Some(Column::Text(cells)) = table.column(name) else { panic!("no text column {name}") };
    cells.iter().map(|cell| cell.as_deref().unwrap_or("")).collect()
}

/// Folders called key=value become columns, and what fails is a row with its reason and exit code
/// 3.
#[test]
fn failures_are_rows() {
    let place = place();
    place.run("fleet set --out t.parquet").ends_with(3).says(&[
        "2 failed",
        "notes.md",
        "short.csv",
        "1 more failed (cannot read): the table has their reasons",
    ]);
    let table = table::read(place.path("t.parquet")).unwrap();
    assert_eq!(table.rows(), 8);
    assert_eq!(texts(&table, "path")[0], "short.csv", "in the order of names");
    let status = texts(&table, "status");
    assert_eq!(status.iter().filter(|status| **status == "failed").count(), 2);
    let reasons = texts(&table, "reason");
    assert!(
        status
            .iter()
            .zip(&reasons)
            .all(|(status, reason)| (*status == "failed") != reason.is_empty())
    );
    let Some(Column::Integer(counts)) = table.column("insertion_count") else {
        panic!("insertions are whole numbers")
    };
    assert_eq!(counts.iter().flatten().copied().collect::<Vec<i64>>(), [0, 20, 40, 0, 20, 40]);
    let Some(Column::Number(forces)) = table.column("coulomb_force_n") else { panic!("no force") };
    // The bench's seal has 3 N.
    assert!(forces.iter().filter(|f| f.is_finite()).all(|f| (f - 3.0).abs() < 0.3), "{forces:?}");
    let page = fs::read_to_string(place.path("t.html")).unwrap();
    assert!(page.contains("Drift with") && page.contains("short.csv"));
    assert_eq!(
        names_in(place.0.path()),
        ["rig.toml", "set", "t.html", "t.parquet"],
        "no journal is left"
    );
}

/// Killed again and again, the table is that of one run, and no recording is identified twice.
#[cfg(unix)]
#[test]
fn kills_change_nothing() {
    let place = place();
    place.run("fleet set --out whole.parquet --threads 1 --quiet").ends_with(3);
    let mut kills = 0;
    while !place.path("t.parquet").exists() {
        let mut child = place
            .command("fleet set --out t.parquet --threads 2 --quiet")
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let done = |text: String| text.lines().count();
        let before = fs::read_to_string(place.path("t.parquet.journal")).map_or(0, done);
        let begun = Instant::now();
        // As soon as a recording more is done.
        while kills < 4
            && child.try_wait().unwrap().is_none()
            && fs::read_to_string(place.path("t.parquet.journal")).map_or(0, done) <= before
            && begun.elapsed() < Duration::from_secs(60)
        {
            std::thread::sleep(Duration::from_millis(1));
        }
        if kills < 4 {
            // SIGKILL.
            child.kill().unwrap();
            kills += 1;
        }
        child.wait().unwrap();
        let Ok(journal) = fs::read_to_string(place.path("t.parquet.journal")) else { continue };
        let whole = journal.split_inclusive('\n').filter(|line| line.ends_with('\n'));
        let names: Vec<&str> = whole.map(|line| line.split('"').nth(3).unwrap()).collect();
        assert_eq!(
            names.iter().collect::<HashSet<_>>().len(),
            names.len(),
            "done twice: {names:?}"
        );
        // A torn line, as a power cut leaves it.
        let mut torn = journal.clone();
        torn.push_str("{\"name\":\"torn");
        fs::write(place.path("t.parquet.journal"), torn).unwrap();
    }
    assert!(kills >= 2, "{kills} kills");
    let same = |extension: &str| {
        fs::read(place.path(&format!("whole.{extension}"))).unwrap()
            == fs::read(place.path(&format!("t.{extension}"))).unwrap()
    };
    assert!(same("parquet") && same("html"));
    assert!(!place.path("t.parquet.journal").exists());
}

/// What is in the journal is reused while the recording and the configuration are the same.
#[test]
fn a_changed_recording_is_done_again() {
    let place = place();
    let first = place.run("fleet set --out /dev/full/t.parquet").ends_with(1);
    first.says(&["cannot create"]);
    // A folder in the table's place: everything is identified, and the table cannot be written.
    fs::create_dir(place.path("t.parquet")).unwrap();
    place.run("fleet set --out t.parquet").ends_with(1);
    fs::remove_dir(place.path("t.parquet")).unwrap();
    let path = place.path("set/trocar_type=a/insertion_count=0/strokes.csv");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, text.lines().take(3000).collect::<Vec<_>>().join("\n")).unwrap();
    place.run("fleet set --out t.parquet").ends_with(3).says(&["7 reused"]);
    fs::create_dir(place.path("u.parquet")).unwrap();
    place.run("fleet set --out u.parquet").ends_with(1);
    fs::remove_dir(place.path("u.parquet")).unwrap();
    place.run("fleet set --out u.parquet --seed 2").ends_with(3).says(&["0 reused"]);
}

/// A manifest names files and carries its columns along.
#[test]
fn a_manifest_names_files() {
    let place = place();
    let [a, b] =
        ["a", "b"].map(|kind| format!("set/trocar_type={kind}/insertion_count=20/strokes.csv"));
    fs::write(
        place.path("list.csv"),
        format!("path,lubricant,samples\n{a},none,3\n{b},\"gel, thin\",\n"),
    )
    .unwrap();
    place.run("fleet list.csv --out m.parquet").ends_with(0);
    let manifest = table::read(place.path("m.parquet")).unwrap();
    assert_eq!(texts(&manifest, "lubricant"), ["none", "gel, thin"]);
    assert!(
        manifest.column("dataset_samples").is_some(),
        "a name of the table's own is not overwritten"
    );
    fs::write(place.path("list.csv"), format!("path\n{a}\n{a}\n")).unwrap();
    place
        .run("fleet list.csv --out m.parquet")
        .ends_with(1)
        .says(&["row 2", "is already in row 1"]);
    place.run(&format!("fleet {a} --out m.parquet")).ends_with(1).says(&[
        "no manifest",
        "trocar identify",
        "rows-of-tables",
    ]);
    fs::create_dir(place.path("empty")).unwrap();
    place.run("fleet empty --out m.parquet").ends_with(1).says(&["no recordings"]);
}

#[test]
fn every_format_that_is_known_is_part_of_a_data_set() {
    let place = Place::new();
    fs::create_dir(place.path("set")).unwrap();
    let endings: Vec<&str> = trocar::recording::registry::endings().collect();
    for ending in &endings {
        fs::write(place.path(&format!("set/run.{ending}")), "no recording").unwrap();
    }
    fs::create_dir(place.path("set/bag")).unwrap();
    fs::write(place.path("set/bag/metadata.yaml"), "no recording").unwrap();
    let ran = place.run("fleet set --out table.csv").ends_with(3);
    assert!(!ran.stderr.contains("left out"), "{ran:#?}");
    let table = fs::read_to_string(place.path("table.csv")).unwrap();
    assert!(table.contains("\nbag,"), "{table}");
    assert!(endings.iter().all(|ending| table.contains(&format!("\nrun.{ending},"))), "{table}");
    assert!(endings.contains(&"xlsx") && endings.contains(&"npz"));
}

/// A name that a spreadsheet would execute is harmless in the table, which can be a manifest.
#[test]
fn names_are_no_formulas_in_the_table() {
    let place = Place::new();
    fs::create_dir(place.path("set")).unwrap();
    for name in ["=1+1.csv", "@x.csv", "-2.csv", "plain.csv"] {
        fs::write(place.path(&format!("set/{name}")), "no recording").unwrap();
    }
    place.run("fleet set --out set/table.csv").ends_with(3);
    let table = fs::read_to_string(place.path("set/table.csv")).unwrap();
    assert!(table.lines().all(|line| !line.starts_with(['=', '+', '-', '@'])), "{table}");
    let again = place.run("fleet set/table.csv --out again.csv").ends_with(3);
    assert!(!again.stderr.contains("No such file"), "{again:#?}");
    let again = fs::read_to_string(place.path("again.csv")).unwrap();
    assert!(again.contains("\n'=1+1.csv,"), "{again}");
}
