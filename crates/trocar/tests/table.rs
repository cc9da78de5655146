//! Tables of results in every output format.

use std::io::Read;
use std::path::{Path, PathBuf};

use crate::skipped::skipped;
use trocar::table::{Column, Field, Kind, TableWriter, read};

/// Three blocks, so that row groups and batches begin and end inside and between them.
const PIECES: usize = 3;

/// Rows of a block: more than half a row group.
const ROWS: usize = 70_000;

fn fields() -> Vec<Field> {
    vec![
        Field::number("force_n"),
        Field::new("count", Kind::Integer),
        Field::new("is_good", Kind::Boolean),
        Field::new("warnings", Kind::Text),
    ]
}

fn piece(k: usize) -> Vec<Column> {
    let rows = || k * ROWS..(k + 1) * ROWS;
    let sometimes = |row: usize| row % 7 != 3;
    vec![
        Column::Number(
            rows().map(|row| if sometimes(row) { row as f64 / 3.0 } else { f64::NAN }).collect(),
        ),
        Column::Integer(
            rows().map(|row| sometimes(row).then_some(row as i64 - (1 << 60))).collect(),
        ),
        Column::Boolean(rows().map(|row| sometimes(row).then_some(row % 2 == 0)).collect()),
        Column::Text(
            rows().map(|row| sometimes(row).then(|| format!("a, \"b\" {row}").into())).collect(),
        ),
    ]
}

fn written(folder: &Path, name: &str) -> PathBuf {
    let path = folder.join(name);
    let mut writer = TableWriter::create(&path, &fields()).unwrap();
    (0..PIECES).for_each(|k| writer.write(&piece(k)).unwrap());
    writer.commit().unwrap();
    path
}

fn bits(column: &Column) -> Vec<u64> {
    let Column::Number(cells) = column else { panic!("{:?}", column.kind()) };
    cells.iter().map(|cell| cell.to_bits()).collect()
}

#[test]
fn parquet_gives_back_every_cell_and_the_same_bytes_each_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), "a.parquet");
    let table = read(&path).unwrap();
    assert_eq!(table.fields, ["force_n", "count", "is_good", "warnings"]);
    assert_eq!(table.rows(), PIECES * ROWS);
    let all: Vec<Vec<Column>> = (0..PIECES).map(piece).collect();
    let numbers: Vec<u64> = all.iter().flat_map(|piece| bits(&piece[0])).collect();
    assert_eq!(bits(&table.columns[0]), numbers);
    for k in 1..4 {
        let expected: Vec<String> = all.iter().flat_map(|piece| cells(&piece[k])).collect();
        assert_eq!(cells(&table.columns[k]), expected);
    }
    let again = written(folder.path(), "b.parquet");
    assert_eq!(std::fs::read(path).unwrap(), std::fs::read(again).unwrap());
}

fn cells(column: &Column) -> Vec<String> {
    match column {
        Column::Number(cells) => cells.iter().map(|cell| format!("{cell:?}")).collect(),
        Column::Integer(cells) => cells.iter().map(|cell| format!("{cell:?}")).collect(),
        Column::Boolean(cells) => cells.iter().map(|cell| format!("{cell:?}")).collect(),
        Column::Text(cells) => cells.iter().map(|cell| format!("{cell:?}")).collect(),
    }
}

#[test]
fn compressed_text_is_the_plain_text() {
    let folder = tempfile::tempdir().unwrap();
    let plain = std::fs::read(written(folder.path(), "a.csv")).unwrap();
    let head =
        b"force_n,count,is_good,warnings\n0.0,-1152921504606846976,true,\"a, \"\"b\"\" 0\"\n";
    assert!(plain.starts_with(head));
    assert_eq!(plain.split(|&byte| byte == b'\n').nth(4).unwrap(), b",,,");
    let mut text = Vec::new();
    let file = std::fs::File::open(written(folder.path(), "a.csv.gz")).unwrap();
    flate2::read::GzDecoder::new(file).read_to_end(&mut text).unwrap();
    assert!(text == plain);
    let file = std::fs::File::open(written(folder.path(), "a.csv.zst")).unwrap();
    assert!(zstd::decode_all(file).unwrap() == plain);
}

#[test]
fn a_table_appears_whole_or_not_at_all() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.parquet", "a.arrow", "a.csv", "a.csv.gz", "a.csv.zst"] {
        let mut writer = TableWriter::create(folder.path().join(name), &fields()).unwrap();
        writer.write(&piece(0)).unwrap();
        let mut uneven = piece(1);
        uneven[2] = Column::Boolean(Vec::new());
        assert!(writer.write(&uneven).unwrap_err().to_string().contains("fields"));
        drop(writer);
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn an_empty_table_has_its_columns() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("empty.parquet");
    TableWriter::create(&path, &fields()).unwrap().commit().unwrap();
    let table = read(&path).unwrap();
    assert_eq!((table.rows(), table.fields.len()), (0, 4));
}

#[test]
fn what_is_no_table_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("no.parquet");
    assert!(read(&path).unwrap_err().to_string().contains("cannot open"));
    std::fs::write(&path, b"PAR1 and nothing more").unwrap();
    assert!(read(&path).unwrap_err().to_string().contains("no complete Parquet file"));
}

#[test]
fn pyarrow_reads_what_we_write() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.parquet", "a.arrow", "a.csv", "a.csv.gz", "a.csv.zst"] {
        written(folder.path(), name);
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/formats/read_back.py");
    let python = match pyarrow() {
        Ok(python) => python,
        Err(reason) => {
            assert!(std::env::var_os("CI").is_none_or(|ci| ci != "true"), "no pyarrow: {reason}");
            skipped(&format!("no pyarrow: {reason}"));
            return;
        }
    };
    run(python.to_str().unwrap(), &[script.to_str().unwrap(), folder.path().to_str().unwrap()])
        .unwrap();
}

/// A Python with pyarrow, in its own folder under `target`.
fn pyarrow() -> Result<PathBuf, String> {
    let place = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("pyarrow-venv");
    let python = place.join("bin/python");
    let has = |python: &Path| run(python.to_str().unwrap_or_default(), &["-c", "import pyarrow"]);
    if has(&python).is_ok() {
        return Ok(python);
    }
    run("python3", &["-m", "venv", "--clear", &place.to_string_lossy()])?;
    run(&python.to_string_lossy(), &["-m", "pip", "install", "--quiet", "pyarrow==26.0.1"])?;
    has(&python).map(|()| python)
}

fn run(program: &str, arguments: &[&str]) -> Result<(), String> {
    let output = std::process::Command::new(program).args(arguments).output();
    let output = output.map_err(|error| format!("{program}: {error}"))?;
    match output.status.success() {
        true => Ok(()),
        false => Err(String::from_utf8_lossy(&output.stderr).into_owned()),
    }
}

#[test]
fn arrow_and_parquet_are_read_back_as_recordings_with_units() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.parquet", "a.arrow", "a.csv", "a.csv.gz", "a.csv.zst"] {
        let path = written(folder.path(), name);
        let read = trocar::recording::read_columns(&path, "", &["force_n"]).unwrap();
        let expected: Vec<u64> = (0..PIECES).flat_map(|k| bits(&piece(k)[0])).collect();
        assert_eq!(
            read[0].iter().map(|cell| cell.to_bits()).collect::<Vec<_>>(),
            expected,
            "{name}"
        );
        if !name.contains("csv") {
            let tables = trocar::recording::tables(&path).unwrap();
            assert_eq!(tables[0].columns[0].unit.as_deref(), Some("N"));
        }
    }
}
