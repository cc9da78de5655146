//! Cancelled work ends and leaves nothing; work that is not cancelled gives the same result as
//! without the flag.

use std::time::{Duration, Instant};

use trocar::bench::{BenchConfig, Protocol, run};
use trocar::cancel::{Cancel, Stopped, most_threads};
use trocar::identify::posterior::Draws;
use trocar::identify::{IdentifyOptions, identify};
use trocar::model_file::ModelFile;
use trocar::recording::Recording;

/// Time, s, in which cancelled work must end on a busy machine.
const ENDS: Duration = Duration::from_secs(5);

fn recordings() -> Vec<Recording> {
    let seal = ModelFile::plausible_10_5_mm().unwrap();
    let record = |protocol: Protocol| {
        let run =
            run(&BenchConfig::default(), protocol, seal.stages().unwrap().elements(), 1).unwrap();
        run.to_recording(protocol.name()).unwrap().without_moving_mass(0.04, 0.0).unwrap()
    };
    [Protocol::Steady, Protocol::Dynamic].map(record).to_vec()
}

#[test]
fn cancelled_work_ends_where_it_is() {
    let recordings = recordings();
    let cancel = Cancel::default();
    // So many draws that the work takes far longer than the test.
    let options =
        IdentifyOptions { posterior: Draws::new(4_000_000), ..IdentifyOptions::default() };
    let flag = cancel.clone();
    let work = move || flag.run(0, || identify(&recordings, &options, &|_, _| ()).is_ok());
    let worker = std::thread::spawn(work);
    std::thread::sleep(Duration::from_millis(500));
    let clock = Instant::now();
    cancel.cancel();
    assert!(matches!(worker.join().unwrap(), Err(Stopped::Cancelled)));
    assert!(clock.elapsed() < ENDS);
}

#[test]
fn work_that_nobody_calls_off_comes_to_the_same() {
    let recordings = recordings();
    let options = IdentifyOptions::default();
    let plain = identify(&recordings, &options, &|_, _| ()).unwrap();
    let watched =
        Cancel::default().run(3, || identify(&recordings, &options, &|_, _| ())).unwrap().unwrap();
    assert_eq!(plain.model, watched.model);
    assert_eq!(plain.parameters, watched.parameters);
}

#[test]
fn nobody_waits_for_a_million_threads() {
    let clock = Instant::now();
    let threads = Cancel::default().run(1_000_000, rayon::current_num_threads).unwrap();
    assert!(clock.elapsed() < ENDS);
    assert_eq!(threads, most_threads());
    let processors = std::thread::available_parallelism().unwrap().get();
    assert!(
        threads >= 64 && threads >= processors,
        "{threads} threads for {processors} processors"
    );
}

#[test]
fn a_panic_stays_a_panic() {
    let outcome =
        std::panic::catch_unwind(|| Cancel::default().run(1, || panic!("a fault of the work")));
    let text = outcome.unwrap_err();
    assert_eq!(text.downcast_ref::<&str>(), Some(&"a fault of the work"));
}
