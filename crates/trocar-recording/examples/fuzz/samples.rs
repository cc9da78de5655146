//! The files that are changed: those of the tests, and text in several dialects.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// A file, or a folder of files.
#[derive(Clone)]
pub(crate) struct Sample {
    pub(crate) name: String,
    /// Names inside the folder, and contents; one file if it is no folder.
    pub(crate) files: Vec<(String, Vec<u8>)>,
    pub(crate) is_folder: bool,
    pub(crate) kind: Kind,
}

/// What a sample is made of.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Bytes,
    Text,
    /// Text to be compressed.
    Gzip,
    Zstd,
}

impl Sample {
    /// Length of its files.
    pub(crate) fn len(&self) -> usize {
        self.files.iter().map(|(_, bytes)| bytes.len()).sum()
    }

    /// Writes it into `folder`, whose content it replaces, and returns what to read.
    pub(crate) fn write(&self, folder: &Path) -> PathBuf {
        _ = std::fs::remove_dir_all(folder);
        std::fs::create_dir_all(folder).expect("the folder can be made");
        for (name, bytes) in &self.files {
            std::fs::write(folder.join(name), bytes).expect("the folder can be written to");
        }
        if self.is_folder { folder.to_owned() } else { folder.join(&self.files[0].0) }
    }

    /// Compresses it if it is to be.
    pub(crate) fn compress(&mut self) {
        for (_, bytes) in &mut self.files {
            *bytes = match self.kind {
                Kind::Bytes | Kind::Text => continue,
                Kind::Gzip => {
                    let mut encoder =
                        flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
                    encoder
                        .write_all(bytes)
                        .and_then(|()| encoder.finish())
                        .expect("memory can be written to")
                }
                Kind::Zstd => zstd::encode_all(&bytes[..], 1).expect("memory can be written to"),
            };
        }
        self.kind = Kind::Bytes;
    }
}

/// Length of a file, or of the files in a folder.
pub(crate) fn bytes_of(path: &Path) -> usize {
    let length = |path: &Path| std::fs::metadata(path).map_or(0, |data| data.len() as usize);
    match std::fs::read_dir(path) {
        Ok(entries) => entries.flatten().map(|entry| length(&entry.path())).sum(),
        Err(_) => length(path),
    }
}

/// All samples, by name.
pub(crate) fn samples() -> Vec<Sample> {
    let mut all = texts();
    for folder in ["formats", "bags", "fuzz"] {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests").join(folder);
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        all.extend(entries.filter_map(|entry| stored(&entry.path())));
    }
    all.sort_by(|a, b| a.name.cmp(&b.name));
    all
}

/// A file or a folder of the tests.
fn stored(path: &Path) -> Option<Sample> {
    let name = path.file_name()?.to_str()?.to_owned();
    if name.ends_with(".py") || name.ends_with(".txt") {
        return None;
    }
    let is_folder = path.is_dir();
    let mut paths = vec![path.to_owned()];
    if is_folder {
        paths = std::fs::read_dir(path).ok()?.flatten().map(|entry| entry.path()).collect();
        paths.sort();
    }
    let file =
        |path: PathBuf| Some((path.file_name()?.to_str()?.to_owned(), std::fs::read(&path).ok()?));
    Some(Sample {
        name,
        files: paths.into_iter().filter_map(file).collect(),
        is_folder,
        kind: Kind::Bytes,
    })
}

/// Recordings as text: headers with and without units, separators, quotes, comments, line ends.
fn texts() -> Vec<Sample> {
    let plain = text(60, ",", "\n", "time_s,position_mm,force_n");
    let semicolons = text(60, ";", "\r\n", "time [s];position [mm];force [N]").replace('.', ",");
    let tabs = text(60, "\t", "\n", "time\tposition\tforce\ns\tmm\tN");
    let spaces = text(60, " ", "\n", "# made up\n# rig 7\ntime_s position_mm force_n");
    let quoted =
        text(60, ",", "\n", "\"time, s\",\"position_mm\",\"force_n\"").replace("0.5", "\"0.5\"");
    let unnamed = text(60, ",", "\n", "0,0,0");
    let marked =
        format!("\u{feff}{}", text(60, ",", "\r\n", "time_ms,velocity_mm_s,position_mm,force_mn"));
    let gaps = plain.replace(",0.9", ",nan,").replace(",1.2", ",").replace(",1.3", ",-inf");
    let long = text(9000, ",", "\n", "time_s,position_mm,force_n");
    let preamble = format!(
        "Writer\t2\nSamples\t10\t10\nX0\t0.0\t0.0\n{}",
        text(60, "\t", "\n", "Zeit [s]\tWeg [mm]\tKraft [N]")
    );
    let repeated = plain.repeat(3);
    let untimed = text(60, ";", "\n", "pos;Fz;Fx");
    let dated = plain.replace("\n0.", "\n2026-11-22T10:15:00.").replace("time_s", "timestamp");
    let blanks =
        text(60, " ", "\n", "time position_mm force_n").replace("\n0.", "\n2026-11-22 10:15:00.");
    let units = std::iter::once(0xfeff).chain(plain.encode_utf16());
    let utf16: Vec<u8> = units.flat_map(u16::to_le_bytes).collect();
    let of = |name: &str, text: &str, kind| {
        let file = (name.to_owned(), text.as_bytes().to_vec());
        Sample { name: name.to_owned(), files: vec![file], is_folder: false, kind }
    };
    let utf16 = vec![("utf16.csv".to_owned(), utf16)];
    vec![
        Sample { name: "utf16.csv".to_owned(), files: utf16, is_folder: false, kind: Kind::Bytes },
        of("preamble.tsv", &preamble, Kind::Text),
        of("repeated.csv", &repeated, Kind::Text),
        of("untimed.csv", &untimed, Kind::Text),
        of("dated.csv", &dated, Kind::Text),
        of("blanks.txt", &blanks, Kind::Text),
        of("plain.csv", &plain, Kind::Text),
        of("semicolons.csv", &semicolons, Kind::Text),
        of("tabs.tsv", &tabs, Kind::Text),
        of("spaces.txt", &spaces, Kind::Text),
        of("quoted.csv", &quoted, Kind::Text),
        of("unnamed.csv", &unnamed, Kind::Text),
        of("marked.csv", &marked, Kind::Text),
        of("gaps.csv", &gaps, Kind::Text),
        of("long.csv", &long, Kind::Text),
        of("plain.csv.gz", &plain, Kind::Gzip),
        of("semicolons.csv.zst", &semicolons, Kind::Zstd),
    ]
}

/// Rows of a slow stroke and back.
fn text(rows: usize, separator: &str, end: &str, header: &str) -> String {
    let mut text = header.replace('\n', end) + end;
    for k in 0..rows {
        let (time, x) = (k as f64 * 0.01, 30.0 * (1.0 - (k as f64 * 0.03).cos()));
        let force = 1.5 * (k as f64 * 0.03).sin();
        _ = write!(text, "{time:.3}{separator}{x:.3}{separator}{force:.4}{end}");
    }
    text
}
