//! Inputs that once made the readers panic, take all memory or never end (`./fuzz`,
//! `tests/fuzz/make.py`).

// Only a part of the program is needed here.
#[allow(dead_code)]
#[path = "../examples/fuzz/mutate.rs"]
mod mutate;
#[allow(dead_code)]
#[path = "../examples/fuzz/reading.rs"]
mod reading;
#[allow(dead_code)]
#[path = "../examples/fuzz/samples.rs"]
mod samples;

use std::io::Write;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Duration;

use mutate::Random;

#[global_allocator]
static MEMORY: peak_alloc::PeakAlloc = peak_alloc::PeakAlloc;

/// One test, since the memory is that of the whole process.
#[test]
fn inputs_that_once_failed_are_read_in_little_time_and_memory() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz");
    let kept: Vec<_> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert!(kept.len() > 7, "{} inputs", kept.len());
    kept.iter().for_each(|path| check(path));
    let folder = tempfile::tempdir().unwrap();
    check(&with_a_chunk_of_2_gb(folder.path()));
    check(&with_120_000_columns(folder.path()));
    check(&with_20_000_data_sets(folder.path()));
    for (name, parts) in workbooks() {
        let path = workbook(folder.path(), &parts);
        check(&path);
        let refused = trocar_recording::tables(&path).map(drop).map_err(|error| error.to_string());
        // Rows that only repeat a short number are read.
        let refused = refused.and_then(|()| match name {
            "rows" => Err("hint: ".to_owned()),
            _ => Ok(()),
        });
        assert!(refused.is_err_and(|error| error.contains("hint: ")), "{name}");
    }
}

fn with_20_000_data_sets(folder: &Path) -> PathBuf {
    let path = folder.join("many.h5");
    let mut file = hdf5_pure::FileBuilder::new();
    for k in 0..20_000 {
        file.create_dataset(&format!("channel_{k}")).with_f64_data(&[0.0, 1.0]);
    }
    file.write(&path).unwrap();
    path
}

/// Workbooks of a few hundred kB whose sheet or shared texts unpack to far more.
fn workbooks() -> Vec<(&'static str, [String; 2])> {
    const SHEET: [&str; 2] = ["<worksheet><sheetData>", "</sheetData></worksheet>"];
    let sheet = |rows: &str| format!("{}{rows}{}", SHEET[0], SHEET[1]);
    let texts = |head: &str, items: &str| format!("<sst {head}>{items}</sst>");
    let cell = |text: &str| {
        format!("<row r=\"1\"><c r=\"A1\" t=\"inlineStr\"><is><t>{text}</t></is></c></row>")
    };
    let row = "<row>".to_owned() + &"<c t=\"s\"><v>0</v></c>".repeat(16_000) + "</row>";
    let numbers = "<row><c><v>0</v></c><c><v>1</v></c></row>";
    vec![
        ("text", [sheet(&cell(&"x".repeat(200 << 20))), texts("", "")]),
        ("tag", [sheet(&format!("<row {}/>", "x".repeat(200 << 20))), texts("", "")]),
        ("shared", [sheet(""), texts("", &"<si><t/></si>".repeat(15 << 20))]),
        ("count", [sheet(""), texts("uniqueCount=\"100000000000\"", "")]),
        (
            "repeated",
            [sheet(&row.repeat(50)), texts("", &format!("<si><t>{}</t></si>", "x".repeat(30_000)))],
        ),
        ("rows", [sheet(&numbers.repeat(100_000)), texts("", "")]),
    ]
}

fn workbook(folder: &Path, [sheet, texts]: &[String; 2]) -> PathBuf {
    const RELATION: &str = "http://schemas.openxmlformats.org/officeDocument/2006/relationships";
    let relations = |id: &str, kind: &str, target: &str| {
        format!(
            "<Relationships><Relationship Id=\"{id}\" Type=\"{RELATION}/{kind}\" Target=\"{target}\"/></Relationships>"
        )
    };
    let book = format!(
        "<workbook xmlns:r=\"{RELATION}\"><sheets><sheet name=\"Data\" sheetId=\"1\" r:id=\"a\"/></sheets></workbook>"
    );
    let path = folder.join("bomb.xlsx");
    let mut archive = zip::ZipWriter::new(std::fs::File::create(&path).unwrap());
    for (name, text) in [
        ("_rels/.rels", &relations("b", "officeDocument", "xl/workbook.xml")),
        ("xl/workbook.xml", &book),
        ("xl/_rels/workbook.xml.rels", &relations("a", "worksheet", "worksheets/sheet1.xml")),
        ("xl/worksheets/sheet1.xml", sheet),
        ("xl/sharedStrings.xml", texts),
    ] {
        archive.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
        archive.write_all(text.as_bytes()).unwrap();
    }
    archive.finish().unwrap();
    path
}

fn check(path: &Path) {
    const LONGEST: Duration = Duration::from_secs(5);
    const MOST: usize = 64 << 20;
    let found = reading::examine(path, &mut Random::new(1, 0, 1));
    let name = path.display();
    assert!(found.panic.is_none(), "{name}: panic");
    assert!(found.time < LONGEST, "{name}: {:?}", found.time);
    assert!(found.memory < MOST, "{name}: {} bytes", found.memory);
}

/// An HDF5 file in which the stored length of a compressed chunk is overwritten.
fn with_a_chunk_of_2_gb(folder: &Path) -> PathBuf {
    const LENGTH: Range<usize> = 20_616..20_620;
    let mut bytes =
        std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/formats/h5py.h5")).unwrap();
    assert_eq!(bytes[LENGTH], 0x27c_u32.to_le_bytes());
    bytes[LENGTH].copy_from_slice(&0x8000_0000_u32.to_le_bytes());
    let path = folder.join("chunk.h5");
    std::fs::write(&path, bytes).unwrap();
    path
}

fn with_120_000_columns(folder: &Path) -> PathBuf {
    let path = folder.join("wide.tsv");
    std::fs::write(&path, format!("time_s{}\n0{}\n", "\t".repeat(120_000), "\t1".repeat(120_000)))
        .unwrap();
    path
}

#[test]
fn messages_in_no_order_end_a_bag() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz/order.db3");
    let read = trocar_recording::read_columns(&path, "/bench/force_n", &["data"]).unwrap();
    assert_eq!(read, [[1.5, 1.5]]);
}
