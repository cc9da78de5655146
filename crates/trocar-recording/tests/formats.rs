//! Files written by third-party libraries (`formats/make.py`), compared with the signal they
//! contain.

use std::f64::consts::PI;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use trocar_recording::registry::{FORMATS, endings, in_words};
use trocar_recording::{Choice, ReadOptions, Recording, Table, read, read_columns, tables};

/// Rows of every file.
const ROWS: usize = 240;

/// Largest difference between the sines of NumPy and Rust, in the unit of the column.
const SINES: f64 = 1e-12;

/// Excel's days resolve 0.6 µs; two of them, rounded to microseconds, differ by at most this, s.
const DAYS: f64 = 2e-6;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/formats").join(name)
}

fn time(k: usize) -> f64 {
    k as f64 / 100.0
}

fn position(k: usize) -> f64 {
    30.0 * (1.0 - (2.0 * PI * k as f64 / 200.0).cos())
}

fn force(k: usize) -> f64 {
    1.5 * (2.0 * PI * k as f64 / 200.0).sin() + 0.01 * (k % 7) as f64
}

/// The column `name` of a table is `expected`, within `tolerance`, over `rows` rows.
fn compare(
    file: &str,
    table: &str,
    name: &str,
    rows: usize,
    tolerance: f64,
    expected: impl Fn(usize) -> f64,
) {
    let read =
        read_columns(fixture(file), table, &[name]).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(read[0].len(), rows, "{file} {table} {name}");
    for (k, &number) in read[0].iter().enumerate() {
        let expected = expected(k);
        let close =
            (number.is_nan() && expected.is_nan()) || (number - expected).abs() <= tolerance;
        assert!(close, "{file} {table} {name} row {k}: {number}, expected {expected}");
    }
}

fn signal(file: &str, table: &str) {
    compare(file, table, "time_s", ROWS, 0.0, time);
    compare(file, table, "force_n", ROWS, SINES, force);
    let names = column_names(file, table);
    if let Some(name) = names.iter().find(|name| name.starts_with("position")) {
        compare(file, table, name, ROWS, SINES, position);
    }
}

fn all_tables(file: &str) -> Vec<Table> {
    tables(fixture(file)).unwrap_or_else(|error| panic!("{error}"))
}

fn column_names(file: &str, table: &str) -> Vec<String> {
    let tables = all_tables(file);
    let table = tables
        .iter()
        .find(|known| known.name == table)
        .unwrap_or_else(|| panic!("{file}: {tables:?}"));
    table.columns.iter().map(|column| column.name.clone()).collect()
}

fn unit(file: &str, table: &str, column: &str) -> Option<String> {
    let tables = all_tables(file);
    let table = tables.into_iter().find(|known| known.name == table).unwrap();
    table.columns.into_iter().find(|known| known.name == column).unwrap().unit
}

fn refusal(file: &str) -> String {
    tables(fixture(file)).unwrap_err().to_string()
}

fn gappy(k: usize) -> f64 {
    if k % 5 == 2 { f64::NAN } else { k as f64 }
}

/// All column types that Parquet and Arrow share.
fn every_kind(file: &str) {
    signal(file, "");
    compare(file, "", "force_f32", ROWS, 0.0, |k| f64::from(force(k) as f32));
    compare(file, "", "count", ROWS, 0.0, |k| (k * k) as f64 - 50.0);
    compare(file, "", "small", ROWS, 0.0, |k| k as f64 - 200.0);
    compare(file, "", "unsigned", ROWS, 0.0, |k| ((1 << 63) + k as u64) as f64);
    compare(file, "", "is_in", ROWS, 0.0, |k| f64::from(u8::from(k % 3 == 0)));
    compare(file, "", "gappy", ROWS, 0.0, gappy);
    compare(file, "", "elapsed", ROWS, 0.0, time);
    // An f64 cannot resolve a nanosecond since 1970, but it can since the first row.
    compare(file, "", "stamp", ROWS, 0.0, |k| (k * 10_000_001) as f64 / 1e9);
    compare(file, "", "last", ROWS, 2.0 * SINES, |k| 2.0 * force(k));
    assert_eq!(unit(file, "", "position").as_deref(), Some("mm"));
    assert_eq!(unit(file, "", "stamp").as_deref(), Some("s"));
    assert_eq!(unit(file, "", "elapsed").as_deref(), Some("s"));
    assert_eq!(unit(file, "", "force_n"), None);
    for name in ["note", "kind"] {
        let error = read_columns(fixture(file), "", &[name]).unwrap_err().to_string();
        assert!(error.contains("holds no numbers"), "{error}");
    }
    let error = read_columns(fixture(file), "", &["forec"]).unwrap_err().to_string();
    assert!(error.contains("no column called 'forec', found time_s, position"), "{error}");
    assert_eq!(all_tables(file)[0].rows, Some(ROWS as u64));
}

#[test]
fn parquet_of_pyarrow_pandas_and_polars() {
    every_kind("pyarrow_snappy.parquet");
    for packing in ["none", "zstd", "gzip", "lz4", "v2"] {
        let file = format!("pyarrow_{packing}.parquet");
        signal(&file, "");
        compare(&file, "", "gappy", ROWS, 0.0, gappy);
    }
    signal("pyarrow_split.parquet", "");
    compare("pyarrow_delta.parquet", "", "count", ROWS, 0.0, |k| (k * k) as f64 - 50.0);
    // INT96 keeps all nanoseconds.
    compare("pyarrow_int96.parquet", "", "stamp", ROWS, 0.0, |k| (k * 10_000_001) as f64 / 1e9);
    compare("pyarrow_nested.parquet", "", "pose.x", ROWS, 0.0, |k| k as f64);
    signal("pandas_index.parquet", "");
    signal("polars.parquet", "");
    let read =
        read_columns(fixture("pyarrow_brotli.parquet"), "", &["time_s"]).unwrap_err().to_string();
    assert!(
        read.to_lowercase().contains("brotli") && read.contains("hint: write it again"),
        "{read}"
    );
}

#[test]
fn several_columns_come_in_the_order_asked_for() {
    let read =
        read_columns(fixture("pyarrow_snappy.parquet"), "", &["last", "time_s", "gappy"]).unwrap();
    assert!(read.iter().all(|column| column.len() == ROWS));
    assert_eq!(read[1][7], 0.07);
    assert!(read[2][7].is_nan());
}

#[test]
fn arrow_files_and_streams_of_pyarrow_and_polars() {
    every_kind("pyarrow_lz4.feather");
    for name in ["pyarrow_uncompressed.feather", "pyarrow_zstd.feather", "pyarrow.arrows"] {
        signal(name, "");
        compare(name, "", "gappy", ROWS, 0.0, gappy);
    }
    signal("polars.arrow", "");
}

#[test]
fn matlab_5_of_scipy() {
    for file in ["scipy_plain.mat", "scipy_compressed.mat"] {
        signal(file, "");
        signal(file, "run");
        for class in [
            "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "single",
            "double",
        ] {
            compare(file, "[100]", &format!("as_{class}"), 100, 0.0, |k| k as f64);
        }
        compare(file, "", "is_in", ROWS, 0.0, |k| f64::from(u8::from(k % 3 == 0)));
        compare(file, "", "wide[0]", ROWS, 0.0, time);
        compare(file, "", "wide[2]", ROWS, SINES, force);
        compare(file, "", "tall[1]", ROWS, SINES, force);
        compare(file, "[1]", "gain", 1, 0.0, |_| 2.5);
        compare(file, "run[1]", "fs_hz", 1, 0.0, |_| 100.0);
        compare(file, "run.inner", "force_n", 50, SINES, force);
        compare(file, "samples", "speed", 5, 0.0, |k| k as f64 / 4.0);
        compare(file, "samples(3)", "trace", 12, SINES, force);
        compare(file, "cell", "{1}", 20, SINES, force);
        let refused: Vec<String> = all_tables(file).into_iter().map(|table| table.kind).collect();
        for reason in [
            "sparse (sparse; save full(x))",
            "complex (complex; save",
            "cube (of more than two dimensions)",
        ] {
            assert!(refused.iter().any(|kind| kind.contains(reason)), "{reason}: {refused:?}");
        }
        let text = all_tables(file)
            .into_iter()
            .flat_map(|table| table.columns)
            .find(|column| column.name == "name");
        assert!(!text.unwrap().is_numeric);
    }
    signal("scipy_column.mat", "");
    assert!(refusal("scipy_v4.mat").contains("save it again with -v7"));
}

#[test]
fn hdf5_of_h5py() {
    let (file, table) = ("h5py.h5", "runs/first");
    signal(file, table);
    compare(file, table, "force_f32", ROWS, 0.0, |k| f64::from(force(k) as f32));
    compare(file, table, "big_endian", ROWS, 0.0, |k| (k * k) as f64 - 50.0);
    compare(file, table, "is_in", ROWS, 0.0, |k| f64::from(u8::from(k % 3 == 0)));
    compare(file, table, "tall[1]", ROWS, SINES, force);
    compare(file, "runs/first[1]", "gain", 1, 0.0, |_| 2.5);
    compare(file, "", "force_n", 30, SINES, force);
    assert_eq!(unit(file, table, "time_s").as_deref(), Some("s"));
    assert_eq!(unit(file, table, "position").as_deref(), Some("mm"));
    assert!(
        read_columns(fixture(file), table, &["note"])
            .unwrap_err()
            .to_string()
            .contains("holds no numbers")
    );
    assert!(all_tables(file).iter().any(|table| table.kind.contains("pairs (a compound")));
    signal("h5py_v110.h5", "");
}

#[test]
fn the_newest_layout_of_hdf5_has_a_way_out() {
    let said = read_columns(fixture("h5py_latest.h5"), "", &["time_s"]).unwrap_err().to_string();
    assert!(said.contains("h5repack --high=V110") && said.contains("libver='v110'"), "{said}");
    // Data stored in the old format can be read.
    compare("h5py_latest.h5", "", "force_n", ROWS, SINES, force);
}

#[test]
fn matlab_7_3() {
    signal("mat73.mat", "");
    signal("mat73.mat", "run");
    compare("mat73.mat", "", "tall[1]", ROWS, SINES, force);
    compare("mat73.mat", "", "is_in", ROWS, 0.0, |k| f64::from(u8::from(k % 3 == 0)));
    compare("mat73.mat", "run[1]", "fs_hz", 1, 0.0, |_| 100.0);
    let tables = all_tables("mat73.mat");
    assert!(tables[0].kind.contains("ts (an object; save its vectors"), "{tables:?}");
    let text =
        tables.into_iter().flat_map(|table| table.columns).find(|column| column.name == "name");
    assert!(!text.unwrap().is_numeric);
}

#[test]
fn excel_sheets_of_openpyxl() {
    let file = "openpyxl.xlsx";
    assert_eq!(
        all_tables(file).iter().map(|table| table.name.as_str()).collect::<Vec<_>>(),
        ["Data", "Dates", "Fault"]
    );
    assert_eq!(
        column_names(file, "Data"),
        ["Time", "Position", "Force", "gappy", "double", "note"]
    );
    assert_eq!(unit(file, "Data", "Position").as_deref(), Some("mm"));
    compare(file, "Data", "Time", ROWS, 0.0, time);
    compare(file, "Data", "Position", ROWS, SINES, position);
    compare(file, "Data", "gappy", ROWS, 0.0, gappy);
    // A formula counts with its result.
    compare(file, "Data", "double", ROWS, 2.0 * SINES, |k| 2.0 * force(k));
    // Dates across midnight, of Excel's days and as text.
    compare(file, "Dates", "Stamp", ROWS, DAYS, time);
    compare(file, "Dates", "iso", ROWS, 0.0, time);
    compare(file, "Fault", "force_n", ROWS, SINES, |k| if k == 7 { f64::NAN } else { force(k) });
    let error =
        read_columns(fixture(file), "Fault", &["time_s", "position_mm"]).unwrap_err().to_string();
    assert!(
        error.contains(
            "sheet 'Fault' cell B17: found 'off' in column position_mm, expected a number"
        ),
        "{error}"
    );
    assert!(error.contains("hint: correct the cell, or clear it"), "{error}");
    let error = read_columns(fixture(file), "Data", &["note"]).unwrap_err().to_string();
    assert!(error.contains("holds no numbers"), "{error}");
}

#[test]
fn quantities_in_several_tables_are_located_with_the_remedy() {
    let path = fixture("h5py_apart.h5");
    let error = read(&path, &ReadOptions::default()).unwrap_err().to_string();
    let found = "time in 'load', position in 'position', force in 'load'";
    assert!(error.contains(found) && error.contains("hint: save them together"), "{error}");
    let all = tables(&path).unwrap();
    let named = |name: &str| all.iter().find(|table| table.name == name);
    assert_eq!(named("position").unwrap().columns.len(), 2);
    assert_eq!(named("load").unwrap().rows, Some(ROWS as u64 / 2));
    // What cannot be read is listed with its reason.
    let root = named("").unwrap();
    assert!(root.kind.contains("log (a compound; save each field as an array)"), "{root:?}");
    // Of one table alone its own columns are the matter.
    let choice = Choice { topics: vec!["load".to_owned()], ..Choice::default() };
    let options = ReadOptions { choice, ..ReadOptions::default() };
    let error = read(&path, &options).unwrap_err().to_string();
    assert!(error.contains("no position column among 'force_n, time_s'"), "{error}");
}

/// A table in which only a choice is open tells more than where the quantities are.
#[test]
fn an_ambiguous_column_is_reported_before_separate_tables() {
    let topics = vec!["TwoForces".to_owned(), "OneForce".to_owned()];
    let choice = Choice { topics, ..Choice::default() };
    let options = ReadOptions { choice, ..ReadOptions::default() };
    let error = read(&fixture("openpyxl_odd.xlsx"), &options).unwrap_err().to_string();
    let found = "force could be 'Force A (N)' or 'Force B (N)', expected one";
    assert!(error.contains(found), "{error}");
}

/// The signal of a sheet of `openpyxl_odd.xlsx`.
fn odd_sheet(sheet: &str, skip_rows: u64) -> Result<Recording, String> {
    let choice = Choice { topics: vec![sheet.to_owned()], skip_rows, ..Choice::default() };
    let options = ReadOptions { choice, ..ReadOptions::default() };
    read(&fixture("openpyxl_odd.xlsx"), &options).map_err(|error| error.to_string())
}

#[test]
fn rows_of_a_sheet_that_are_no_readings_are_left_out_and_counted() {
    for (sheet, skip_rows, warning) in [
        ("Again", 0, "2 rows that repeat the header left out: rows 103, 104"),
        ("Results", 0, "2 rows of text at the end of the table left out: rows 244, 245"),
        ("Skip", 2, ""),
        // The times are last, and so are the words.
        ("Last", 0, "2 rows of text at the end of the table left out: rows 243, 244"),
    ] {
        let found = odd_sheet(sheet, skip_rows).unwrap();
        assert_eq!(found.len(), ROWS, "{sheet}");
        for k in 0..ROWS {
            assert!((found.time[k] - time(k)).abs() < 1e-12, "{sheet} row {k}");
            assert!((found.position[k] - 1e-3 * position(k)).abs() < 1e-15, "{sheet} row {k}");
            assert!((found.force[k] - force(k)).abs() <= SINES, "{sheet} row {k}");
        }
        let warnings = found.quality.warnings.iter().map(|warning| warning.message.as_str());
        assert_eq!(warnings.collect::<Vec<_>>().join("; "), warning, "{sheet}");
    }
    let middle = odd_sheet("Middle", 0).unwrap_err();
    assert!(middle.contains("sheet 'Middle' cell A103: found 'paused' in column Time"), "{middle}");
    let units = odd_sheet("Units", 0).unwrap_err();
    assert!(units.contains("cell C103: found '1.2 N' in column Force"), "{units}");
    assert!(units.contains("hint: write the numbers alone into the cells and the unit"), "{units}");
    // The word is named, not the first cell of its row.
    let middle = odd_sheet("LastMiddle", 0).unwrap_err();
    assert!(middle.contains("cell C103: found 'Mean' in column Time, expected"), "{middle}");
    let units = odd_sheet("AllUnits", 0).unwrap_err();
    assert!(units.contains("column 'Force' holds numbers with their unit, such as '"), "{units}");
    assert!(units.contains("write the numbers alone into the cells and the unit"), "{units}");
    let too_many = odd_sheet("Again", 5000).unwrap_err();
    assert!(too_many.contains("‹skip_rows› 5000 leaves no rows of numbers"), "{too_many}");
    let choice = Choice { skip_rows: 2, ..Choice::default() };
    let options = ReadOptions { choice, ..ReadOptions::default() };
    let refused = read(&fixture("polars.parquet"), &options).unwrap_err().to_string();
    assert!(refused.contains("‹skip_rows› is for text and spreadsheets"), "{refused}");
}

/// A date is in seconds, also in a column that is named otherwise or declared in other units.
#[test]
fn dates_and_durations_of_parquet_and_arrow_are_times() {
    for file in ["pyarrow_snappy.parquet", "pyarrow_lz4.feather"] {
        for (column, exact) in [("stamp", 1e-6), ("stamp_ms", 1e-3), ("elapsed", 1e-6)] {
            let columns = format!("time_ms={column}");
            let options =
                ReadOptions { choice: Choice::columns(&columns), ..ReadOptions::default() };
            let found = read(&fixture(file), &options).unwrap();
            let raw = read_columns(fixture(file), "", &[column]).unwrap();
            let last = found.time[ROWS - 1] - found.time[0];
            assert!((last - (raw[0][ROWS - 1] - raw[0][0])).abs() < exact, "{file} {column}");
        }
    }
}

#[test]
fn a_sheet_becomes_a_recording_as_a_text_file_does() {
    let of = |topic: &str| {
        let choice = Choice { topics: vec![topic.to_owned()], ..Choice::default() };
        read(&fixture("openpyxl.xlsx"), &ReadOptions { choice, ..ReadOptions::default() }).unwrap()
    };
    for (sheet, note) in [
        ("Data", "sheet 'Data': 2 lines before the header skipped"),
        ("Dates", "column 'Stamp' taken as time"),
    ] {
        let recording = of(sheet);
        assert_eq!(recording.len(), ROWS);
        for k in 0..ROWS {
            assert!((recording.time[k] - time(k)).abs() < DAYS, "{sheet} row {k}");
            assert!((recording.position[k] - 1e-3 * position(k)).abs() < 1e-15, "{sheet} row {k}");
            assert!((recording.force[k] - force(k)).abs() <= SINES, "{sheet} row {k}");
        }
        assert!(
            recording.quality.notes.iter().any(|own| own.contains(note)),
            "{:?}",
            recording.quality.notes
        );
    }
    let error = read(&fixture("openpyxl.xlsx"), &ReadOptions::default()).unwrap_err().to_string();
    assert!(
        error.contains("could come from Data, Fault") && error.contains("‹topic='Data'›"),
        "{error}"
    );
}

#[test]
fn an_archive_that_is_no_workbook_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recordings.zip");
    // An archive without entries but for its end, behind the mark of a file.
    let end = [&b"PK\x03\x04PK\x05\x06"[..], &[0; 18]].concat();
    std::fs::write(&path, end).unwrap();
    let error = tables(&path).unwrap_err().to_string();
    assert!(error.contains("hint: "), "{error}");
}

#[test]
fn decimals_and_half_floats_of_parquet() {
    // The first file holds decimals in whole numbers where they fit, the second in bytes of one
    // length.
    for file in ["pyarrow_decimal.parquet", "pyarrow_fixed_decimal.parquet"] {
        compare(file, "", "time_s", ROWS, 0.0, time);
        // 10 bits of fraction, of numbers up to 60.
        compare(file, "", "position_mm", ROWS, 0.016, position);
        compare(file, "", "force_n", ROWS, 0.6e-9, force);
        compare(file, "", "wide", ROWS, SINES, force);
        compare(file, "", "gappy", ROWS, 0.0, gappy);
    }
}

#[test]
fn numbers_of_another_byte_order_are_refused() {
    let error = refusal("big_endian.arrows");
    assert!(
        error.contains("numbers in big-endian byte order, which is not read")
            && error.contains("hint: "),
        "{error}"
    );
}

#[test]
fn a_later_version_in_the_text_of_a_matlab_file_changes_nothing() {
    assert_eq!(all_tables("mat74.mat"), all_tables("mat73.mat"));
    signal("mat74.mat", "");
    // The block of text may be longer.
    let whole = std::fs::read(fixture("h5py_block.mat")).unwrap();
    assert_eq!(whole.iter().position(|byte| *byte == 0x89), Some(2048));
    signal("h5py_block.mat", "");
}

#[test]
fn the_bytes_decide_and_never_the_ending() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.parquet");
    std::fs::write(&path, "time_s,force_n\n0,1\n0.1,2\n").unwrap();
    assert_eq!(read_columns(&path, "", &["force_n"]).unwrap(), [[1.0, 2.0]]);
    std::fs::copy(fixture("polars.parquet"), folder.path().join("recording.csv")).unwrap();
    assert_eq!(
        read_columns(folder.path().join("recording.csv"), "", &["time_s"]).unwrap()[0][7],
        0.07
    );
}

/// A custom generator (xorshift), so that the same bytes are damaged on every platform.
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % end as u64) as usize
    }
}

/// All data that can be read from a damaged file, or its errors as text.
fn read_all(path: &Path) -> Vec<String> {
    let mut faults = Vec::new();
    match tables(path) {
        Err(error) => faults.push(error.to_string()),
        Ok(tables) => {
            for table in tables {
                let names = table
                    .columns
                    .iter()
                    .filter(|column| column.is_numeric)
                    .map(|column| column.name.as_str());
                let names: Vec<&str> = names.collect();
                faults.extend(
                    read_columns(path, &table.name, &names).err().map(|error| error.to_string()),
                );
            }
        }
    }
    faults
}

#[test]
fn damaged_files_are_errors_and_never_end_the_program() {
    const VARIANTS: usize = 200;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged");
    let shown = path.display().to_string();
    for entry in std::fs::read_dir(fixture("")).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        if name.ends_with(".py") || name.ends_with(".txt") {
            continue;
        }
        let whole = std::fs::read(fixture(&name)).unwrap();
        let mut random = Random(0x2545_f491_4f6c_dd1d);
        for variant in 0..VARIANTS {
            let mut bytes = whole.clone();
            if variant % 4 == 0 {
                bytes.truncate(random.below(whole.len()));
            } else {
                // Headers are at the ends of files: every other variant is damaged there.
                for _ in 0..1 + random.below(4) {
                    let near = random.below(whole.len().min(600));
                    let at = [near, whole.len() - 1 - near, random.below(whole.len())][variant % 3];
                    bytes[at] = random.below(256) as u8;
                }
            }
            std::fs::write(&path, &bytes).unwrap();
            for fault in read_all(&path) {
                assert!(fault.contains(&shown), "{name} variant {variant}: {fault}");
            }
        }
    }
}

/// The size of a buffer is reserved before it is decompressed: what it states is not believed.
#[test]
fn buffers_of_arrow_that_state_too_much_are_refused_before_memory_is_reserved() {
    /// Numbers of 8 bytes in the first record batch of the fixtures.
    const STATED: i64 = 150 * 8;
    for file in ["pyarrow_lz4.feather", "pyarrow_zstd.feather"] {
        let bytes = std::fs::read(fixture(file)).unwrap();
        let table = &all_tables(file)[0].name;
        let mut refused = 0;
        for place in (0..bytes.len() - 8).step_by(8) {
            if bytes[place..place + 8] != STATED.to_le_bytes() {
                continue;
            }
            let mut changed = bytes.clone();
            changed[place..place + 8].copy_from_slice(&(1_i64 << 44).to_le_bytes());
            let mut copy = tempfile::NamedTempFile::with_suffix(".feather").unwrap();
            copy.write_all(&changed).unwrap();
            let names = column_names(file, table);
            let found = names.iter().map(|name| read_columns(copy.path(), table, &[name]));
            let words = found.filter_map(Result::err).map(|error| error.to_string());
            refused +=
                usize::from(words.into_iter().any(|text| text.contains("when decompressed")));
        }
        assert!(refused >= 2, "{file}: {refused}");
    }
}

#[test]
fn a_column_of_a_log_is_one_quantity() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/bags/plain.mcap");
    let same = "/psm1/measured_cf.wrench.force.z";
    let choice = Choice::columns(&format!("position_m={same},force_n={same}"));
    let error =
        read(&path, &ReadOptions { choice, ..ReadOptions::default() }).unwrap_err().to_string();
    assert!(error.contains("two quantities"), "{error}");
}

#[test]
fn files_cut_off_say_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut");
    for name in [
        "pyarrow_snappy.parquet",
        "pyarrow_lz4.feather",
        "scipy_plain.mat",
        "mat73.mat",
        "openpyxl.xlsx",
    ] {
        let whole = std::fs::read(fixture(name)).unwrap();
        std::fs::write(&path, &whole[..whole.len() * 2 / 3]).unwrap();
        let faults = read_all(&path);
        assert!(!faults.is_empty(), "{name}");
        assert!(faults.iter().all(|fault| fault.contains("hint: ")), "{name}: {faults:?}");
    }
}

/// A `.npy` file of format 1.0, after NumPy Enhancement Proposal 1.
fn npy(kind: &str, fortran_order: &str, shape: &str, numbers: &[u8]) -> Vec<u8> {
    let text = format!("{{'descr': {kind}, 'fortran_order': {fortran_order}, 'shape': {shape}, }}");
    let text = format!("{text:<117}\n");
    [b"\x93NUMPY\x01\x00", &(text.len() as u16).to_le_bytes()[..], text.as_bytes(), numbers]
        .concat()
}

fn bytes_of<const N: usize>(numbers: impl Iterator<Item = f64>, of: fn(f64) -> [u8; N]) -> Vec<u8> {
    numbers.flat_map(of).collect()
}

/// The signal as a recording, however it was saved.
fn is_the_signal(path: &Path) {
    let found = read(path, &ReadOptions::default()).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(found.len(), ROWS, "{}", path.display());
    for k in 0..ROWS {
        assert_eq!(found.time[k], time(k), "{} row {k}", path.display());
        assert!((found.position[k] - 1e-3 * position(k)).abs() < 1e-15, "row {k}");
        assert_eq!(found.force[k], force(k), "{} row {k}", path.display());
    }
}

#[test]
fn arrays_of_numpy() {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    let rows = || (0..ROWS).flat_map(|k| [time(k), position(k), force(k)]);
    let kind = "[('time_s', '<f8'), ('position_mm', '<f8'), ('force_n', '<f8')]";
    is_the_signal(&put(
        "fields.npy",
        &npy(kind, "False", "(240,)", &bytes_of(rows(), f64::to_le_bytes)),
    ));
    let columns = || (0..ROWS).map(time).chain((0..ROWS).map(position)).chain((0..ROWS).map(force));
    for (order, numbers) in [
        ("False", bytes_of(rows(), f64::to_be_bytes)),
        ("True", bytes_of(columns(), f64::to_be_bytes)),
    ] {
        let path = put("matrix.npy", &npy("'>f8'", order, "(240, 3)", &numbers));
        let read = read_columns(&path, "", &["value[2]", "value[0]"]).unwrap();
        assert!((0..ROWS).all(|k| read[0][k] == force(k) && read[1][k] == time(k)), "{order}");
    }
    let flags = npy("'|b1'", "False", "(2,)", &[0, 1]);
    assert_eq!(read_columns(put("flags.npy", &flags), "", &["value"]).unwrap(), [[0.0, 1.0]]);
    // What is no vector of numbers is listed with the way out; what is cut off is an error.
    let objects = tables(put("objects.npy", &npy("'|O'", "False", "(2,)", b"pickle"))).unwrap();
    assert!(objects[0].kind.contains("save vectors of numbers"), "{objects:?}");
    let huge = tables(put("huge.npy", &npy("'<f8'", "False", "(99999999999,)", b""))).unwrap();
    assert!(huge[0].kind.contains("more than the file has bytes for"), "{huge:?}");
    let path = folder.path().join("run.npz");
    let mut archive = zip::ZipWriter::new(std::fs::File::create(&path).unwrap());
    for (name, of) in
        [("time_s", time as fn(usize) -> f64), ("position_mm", position), ("force_n", force)]
    {
        archive
            .start_file(format!("{name}.npy"), zip::write::SimpleFileOptions::default())
            .unwrap();
        let numbers = bytes_of((0..ROWS).map(of), f64::to_le_bytes);
        archive.write_all(&npy("'<f8'", "False", "(240,)", &numbers)).unwrap();
    }
    archive.finish().unwrap();
    is_the_signal(&path);
}

#[test]
fn json_lines_and_text_in_xz() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.jsonl");
    let line = |k: usize| {
        format!(
            "{{\"time_s\": {}, \"note\": \"a\", \"position_mm\": {}, \"force_n\": {}}}\n",
            time(k),
            position(k),
            force(k)
        )
    };
    let whole: String = (0..ROWS).map(line).collect();
    std::fs::write(&path, &whole).unwrap();
    is_the_signal(&path);
    // Members inside, missing ones, and a line that is damaged after others were read.
    let text = "{\"a\": {\"x\": 1, \"y\": [2, true]}}\n\n{\"a\": {\"x\": null}}\n{\"a\": ";
    std::fs::write(&path, text).unwrap();
    let error = tables(&path).unwrap_err().to_string();
    assert!(error.contains("line 4"), "{error}");
    std::fs::write(&path, text.trim_end_matches("{\"a\": ")).unwrap();
    let read = read_columns(&path, "", &["a.y[1]", "a.x"]).unwrap();
    assert!(read[0][0] == 1.0 && read[0][1].is_nan() && read[1][0] == 1.0 && read[1][1].is_nan());
    let csv: String =
        (0..ROWS).map(|k| format!("{},{},{}\n", time(k), position(k), force(k))).collect();
    let mut packed = Vec::new();
    let csv = format!("time_s,position_mm,force_n\n{csv}");
    liblzma::read::XzEncoder::new(csv.as_bytes(), 6).read_to_end(&mut packed).unwrap();
    let path = folder.path().join("run.csv.xz");
    std::fs::write(&path, packed).unwrap();
    is_the_signal(&path);
}

#[test]
fn formats_that_are_not_read_are_named_with_the_way_out() {
    let folder = tempfile::tempdir().unwrap();
    let ods = [
        b"PK\x03\x04",
        &[0; 22][..],
        &[8, 0, 0, 0],
        b"mimetype",
        b"application/vnd.oasis.opendocument.spreadsheet",
    ]
    .concat();
    for (name, bytes, essentials) in [
        (
            "a.xls",
            &b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1 and sectors"[..],
            ["Excel 97", "save the spreadsheet as .xlsx"],
        ),
        ("a.ods", &ods, ["OpenDocument", "save the spreadsheet as .xlsx"]),
        ("a.tdms", b"TDSm\x0e\0\0\0", ["TDMS", "nptdms"]),
        ("a.feather", b"FEA1\0\0\0\0", ["Feather 1", "version=2"]),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let error = tables(&path).unwrap_err().to_string();
        assert!(essentials.iter().all(|own| error.contains(own)), "{error}");
        assert!(error.contains("hint: "), "{error}");
        let ending = name.split_once('.').unwrap().1;
        assert!(endings().any(|own| own == ending), "{name}");
    }
}

/// The page for users has every format of the list, by its endings.
#[test]
fn every_format_is_on_the_page() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/reference/formats.md");
    let page = std::fs::read_to_string(page).unwrap();
    for format in FORMATS.iter().filter(|format| format.is_read()) {
        let missing: Vec<_> =
            format.endings.iter().filter(|own| !page.contains(&format!("`.{own}`"))).collect();
        assert!(missing.is_empty(), "{}: {missing:?}", format.name);
        assert!(in_words().contains(format.name), "{}", in_words());
    }
}
