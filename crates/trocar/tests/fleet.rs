//! One table, however often the work is interrupted, and wherever it is done.

use std::fs::{self, File};
use std::path::Path;

use tempfile::TempDir;
use trocar::bench::{BenchConfig, Protocol, run};
use trocar::cancel::Cancel;
use trocar::fleet::{self, Collector, Config, Dataset, FleetError, identify_source};
use trocar::model_file::ModelFile;

/// Four recordings in folders, and a file that is none.
fn dataset(folder: &Path) -> Dataset {
    let seal = ModelFile::plausible_10_5_mm().unwrap();
    let mut rig = BenchConfig::default();
    rig.protocol.steady.increment_m_s = 0.05;
    for seed in 1..=4 {
        let recorded =
            run(&rig, Protocol::Steady, seal.stages().unwrap().elements(), seed).unwrap();
        let inner = folder.join(format!("insertion_count={}", 10 * seed));
        fs::create_dir_all(&inner).unwrap();
        let file = File::create(inner.join("strokes.csv")).unwrap();
        recorded.to_recording("strokes").unwrap().write(file).unwrap();
    }
    fs::write(folder.join("words.csv"), "these,are,words\n").unwrap();
    Dataset::open(folder, &[]).unwrap()
}

/// Runs that are cancelled after each recording until none remains; returns their number, and how
/// many rows the last run reused.
fn stopped_again_and_again(dataset: &Dataset, table: &Path) -> (usize, usize) {
    let mut stopped = 0;
    loop {
        let cancel = Cancel::default();
        let outcome = fleet::run(dataset, &Config::default(), table, 1, &cancel, &mut |tally| {
            if tally.done > tally.reused {
                cancel.cancel();
            }
        });
        match outcome {
            Ok(fleet) => return (stopped, fleet.tally.reused),
            Err(FleetError::Stopped(_)) => stopped += 1,
            Err(other) => panic!("{other}"),
        }
    }
}

/// Cancelled after each recording and continued elsewhere: the same bytes, and no recording is
/// processed twice.
#[test]
fn interrupted_and_elsewhere_the_table_is_the_same() {
    let place = TempDir::new().unwrap();
    let dataset = dataset(&place.path().join("set"));
    let path = |name: &str| place.path().join(name);
    let config = Config::default();
    let whole = path("whole.csv");
    fleet::run(&dataset, &config, &whole, 1, &Cancel::default(), &mut |_| ()).unwrap();
    let whole = fs::read(whole).unwrap();
    let (times, reused) = stopped_again_and_again(&dataset, &path("again.csv"));
    assert!(times > 0 && reused > 0, "stopped {times} times, {reused} reused");
    assert_eq!(fs::read(path("again.csv")).unwrap(), whole);
    // Elsewhere, with the results of the second of five.
    let mut first = Collector::open(&dataset, &config, &path("elsewhere.csv")).unwrap();
    let orders = first.orders().unwrap();
    first.add(1, &identify_source(&orders[1], &config).unwrap()).unwrap();
    drop(first);
    let mut second = Collector::open(&dataset, &config, &path("elsewhere.csv")).unwrap();
    for (k, order) in second.orders().unwrap().iter().enumerate().rev() {
        let tally = second.add(k, &identify_source(order, &config).unwrap()).unwrap();
        assert_eq!(tally.reused, usize::from(k <= 1), "{k}");
    }
    second.write().unwrap();
    assert_eq!(fs::read(path("elsewhere.csv")).unwrap(), whole);
}

/// A table without the row of a recording is refused, as is a result that nobody asked for.
#[test]
fn results_must_belong_to_the_data_set() {
    let place = TempDir::new().unwrap();
    let dataset = dataset(&place.path().join("set"));
    let table = place.path().join("table.csv");
    let mut collector = Collector::open(&dataset, &Config::default(), &table).unwrap();
    assert!(matches!(collector.add(9, "null"), Err(FleetError::WorkerResult(_))));
    assert!(matches!(collector.add(0, "null"), Err(FleetError::WorkerResult(_))));
    collector.lose(0, "worker_died", "it died").unwrap();
    assert!(matches!(collector.write(), Err(FleetError::WorkerResult(_))));
    assert!(!table.exists());
}
