//! Recordings of any length: read in parallel, in excerpts and in pieces, and results that do not
//! depend on the length.

use std::fmt::Write as _;
use std::io::Read;
use std::path::PathBuf;

use crate::skipped::skipped;
use trocar::recording::{Choice, Pieces, ReadOptions, Recording, read};
use trocar::simulate::Positions;
use trocar::validate::{Validation, validate, validate_one};
use trocar_model::{Classical, SlidingFriction, StaticFriction, Trocar};

/// Enough rows for several chunks of the reader.
const MANY: usize = 400_000;

struct Scratch(tempfile::TempDir);

impl Scratch {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn file(&self, name: &str, text: &str) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    }
}

/// Strokes of 40 mm at 1 kHz and a Coulomb force with an offset of 0.1 N.
fn row(k: usize) -> (f64, f64, f64) {
    let t = k as f64 * 1e-3;
    let (x, v) = (0.02 - 0.02 * (2.0 * t).cos(), (2.0 * t).sin());
    (t, x, 0.1 + 1.5 * v.signum() + 0.01 * (k as f64 * 0.7).sin())
}

fn plain(rows: usize) -> String {
    let mut text = String::from("time_s,position_m,force_n\n");
    for (t, x, f) in (0..rows).map(row) {
        writeln!(text, "{t:.3},{x:.7},{f:.5}").unwrap();
    }
    text
}

/// The same with additional comments, blank lines, quotes and carriage returns.
fn ruffled(rows: usize) -> String {
    let mut text = String::new();
    for (k, line) in plain(rows).lines().enumerate() {
        match k % 5003 {
            17 => writeln!(text, "# note {k}\n\n{line}").unwrap(),
            1234 => writeln!(text, "\"{}\"", line.replace(',', "\",\"")).unwrap(),
            4321 => write!(text, "{line}\r\n").unwrap(),
            _ => writeln!(text, "{line}").unwrap(),
        }
    }
    text
}

/// Returns a few bytes at a time, as a pipe may.
struct Drip<'a> {
    bytes: &'a [u8],
    next: usize,
}

impl Read for Drip<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        self.next = (self.next * 7 + 3) % 1009;
        let count = (self.next + 1).min(self.bytes.len()).min(buffer.len());
        let (now, later) = self.bytes.split_at(count);
        buffer[..count].copy_from_slice(now);
        self.bytes = later;
        Ok(count)
    }
}

fn options(most_samples: Option<usize>) -> ReadOptions {
    ReadOptions { most_samples, ..ReadOptions::default() }
}

#[test]
fn neither_pieces_nor_dress_change_the_numbers() {
    let scratch = Scratch::new();
    let text = ruffled(MANY);
    let parallel = read(&scratch.file("ruffled.csv", &text), &options(None)).unwrap();
    let expected = read(&scratch.file("plain.csv", &plain(MANY)), &options(None)).unwrap();
    assert_eq!(parallel.time, expected.time);
    assert_eq!(parallel.position, expected.position);
    assert_eq!(parallel.force, expected.force);
    let drip = Drip { bytes: text.as_bytes(), next: 0 };
    let mut dripped = Positions::from_text("drip", drip, &Choice::default()).unwrap();
    let mut count = 0;
    while let Some(step) = dripped.advance().unwrap() {
        assert_eq!((step.time, step.position), (expected.time[count], expected.position[count]));
        count += 1;
    }
    assert_eq!(count, MANY);
}

#[test]
fn the_hash_is_that_of_the_file_however_it_is_read() {
    let scratch = Scratch::new();
    let path = scratch.file("plain.csv", &plain(MANY));
    let sum = std::process::Command::new("sha256sum").arg(&path).output();
    let Ok(sum) = sum.map(|output| String::from_utf8(output.stdout).unwrap()) else {
        skipped("no sha256sum");
        return;
    };
    assert_eq!(read(&path, &options(None)).unwrap().sha256, sum.split_whitespace().next().unwrap());
}

#[test]
fn an_error_deep_in_a_file_names_its_line() {
    let scratch = Scratch::new();
    for line in [2, 131_072, 300_001, MANY + 1] {
        let mut lines: Vec<String> = plain(MANY).lines().map(str::to_owned).collect();
        lines[line - 1] = "1.0,two,3.0".into();
        let message = read(&scratch.file("wrong.csv", &lines.join("\n")), &options(None))
            .unwrap_err()
            .to_string();
        assert!(message.contains(&format!("wrong.csv line {line}: found 'two'")), "{message}");
        // All rows before the wrong one are returned first.
        let mut positions =
            Positions::open(&scratch.0.path().join("wrong.csv"), &Choice::default()).unwrap();
        let before = (0..).take_while(|_| matches!(positions.advance(), Ok(Some(_)))).count();
        assert_eq!(before, line - 2);
    }
}

fn is_a_row(recording: &Recording, i: usize) -> bool {
    let (t, x, f) = row((recording.time[i] * 1e3).round() as usize);
    let close = |a: f64, b: f64| (a - b).abs() < 1e-5;
    close(recording.time[i], t) && close(recording.position[i], x) && close(recording.force[i], f)
}

#[test]
fn excerpts_are_contiguous_and_from_all_over_the_recording() {
    const ROWS: usize = 1_600_000;
    let scratch = Scratch::new();
    let path = scratch.file("long.csv", &plain(ROWS));
    let most = 400_000;
    let found = read(&path, &options(Some(most))).unwrap();
    assert!((most / 4..=most).contains(&found.len()), "{}", found.len());
    assert!((0..found.len()).all(|i| is_a_row(&found, i)));
    assert_eq!(found.quality.warnings, [], "an excerpt's end is no gap");
    assert!(found.unbroken().count() > 1);
    for range in found.unbroken() {
        let length = found.time[range.end - 1] - found.time[range.start];
        assert!(
            (length - (range.len() - 1) as f64 * 1e-3).abs() < 1e-6,
            "no sample is missing inside"
        );
    }
    let note = found.quality.notes.join("\n");
    assert!(note.contains("1600000 rows") && note.contains(&found.len().to_string()), "{note}");
    let whole = read(&path, &options(Some(ROWS))).unwrap();
    assert_eq!(whole.len(), ROWS);
    assert_eq!(found.sha256, whole.sha256, "the hash is that of all of it");
}

#[test]
fn the_beginning_of_a_longer_recording_is_thinned_alike() {
    let scratch = Scratch::new();
    let kept = |rows: usize| {
        let found = read(&scratch.file("long.csv", &plain(rows)), &options(Some(150_000))).unwrap();
        found
            .time
            .iter()
            .map(|t| (t * 1e3).round() as usize)
            .collect::<std::collections::BTreeSet<_>>()
    };
    // Both are decimated three times, so the selection of the longer one begins with that of the
    // shorter one.
    let (shorter, longer) = (kept(700_000), kept(760_000));
    assert!(
        shorter.iter().filter(|row| !longer.contains(row)).count() == 0,
        "{} {}",
        shorter.len(),
        longer.len()
    );
}

fn coulomb() -> Trocar {
    Trocar::of_seal(Classical::Static(
        StaticFriction::new(SlidingFriction::coulomb(1.5, 0.0)).unwrap(),
    ))
}

fn by_pieces(path: &std::path::Path, samples: usize) -> Validation {
    let mut pieces = Pieces::open(path, &options(None), samples).unwrap();
    let mut all: Option<trocar::validate::Scored> = None;
    while let Some(piece) = pieces.next_piece().unwrap() {
        let one = validate_one(&coulomb(), &piece, 0.1);
        all = Some(match all.take() {
            Some(before) => before.plus(one),
            None => one,
        });
    }
    Validation::of(all.into_iter().collect())
}

/// Strokes, then a rest that fills a whole piece.
#[test]
fn a_pause_longer_than_a_piece_is_not_scored() {
    const ROWS: usize = 20_000;
    let scratch = Scratch::new();
    let mut text = plain(ROWS);
    let (_, rest, force) = row(ROWS - 1);
    (ROWS..2 * ROWS).for_each(|k| {
        writeln!(text, "{:.3},{rest:.7},{:.5}", k as f64 * 1e-3, force + 0.5).unwrap()
    });
    let strokes = by_pieces(&scratch.file("strokes.csv", &plain(ROWS)), ROWS);
    let both = by_pieces(&scratch.file("pause.csv", &text), ROWS);
    let (a, b) = (&both.recordings[0], &strokes.recordings[0]);
    assert_eq!((a.samples, a.rms_n, a.worst_n), (b.samples, b.rms_n, b.worst_n));
    assert_eq!(a.samples_before_known, b.samples_before_known + ROWS);
    assert_eq!(a.warnings, [] as [String; 0]);
}

#[test]
fn a_tail_of_missing_numbers_ends_no_validation() {
    const ROWS: usize = 20_000;
    let scratch = Scratch::new();
    let mut text = plain(ROWS + 3);
    (ROWS + 3..ROWS + 40).for_each(|k| writeln!(text, "{:.3},,", k as f64 * 1e-3).unwrap());
    let found = by_pieces(&scratch.file("tail.csv", &text), ROWS);
    assert_eq!(found.recordings[0].samples + found.recordings[0].samples_before_known, ROWS + 3);
}

#[test]
fn a_validation_by_pieces_is_that_of_the_whole() {
    const ROWS: usize = 120_003;
    let scratch = Scratch::new();
    let path = scratch.file("strokes.csv", &plain(ROWS));
    let whole = validate(&coulomb(), &[read(&path, &options(None)).unwrap()], 0.1);
    assert_eq!(by_pieces(&path, ROWS), whole, "one piece is the whole");
    for samples in [20_000, 40_001, ROWS - 3] {
        let pieces = by_pieces(&path, samples);
        let (a, b) = (&pieces.recordings[0], &whole.recordings[0]);
        assert_eq!(a.samples + a.samples_before_known, ROWS);
        // The start of each piece is not scored: less than a stroke of 1.6 s.
        let unknown = ROWS.div_ceil(samples) * 1600;
        assert!(b.samples - a.samples <= unknown, "{} of {}", a.samples, b.samples);
        assert!((a.rms_n / b.rms_n - 1.0).abs() < 0.05, "{} and {} N", a.rms_n, b.rms_n);
        assert!((a.bias_n - b.bias_n).abs() < 0.05 * b.rms_n);
        let samples_by_phase = [a.by_phase.hold, a.by_phase.moving.unwrap()]
            .iter()
            .map(|part| part.samples)
            .sum::<usize>();
        assert_eq!(samples_by_phase, a.samples);
    }
}
