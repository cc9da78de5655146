//! Inputs that once made the readers panic, take all memory or never end (`./fuzz`, `tests/fuzz/make.py`).

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

use std::path::Path;
use std::time::Duration;

use mutate::Random;

#[global_allocator]
static MEMORY: peak_alloc::PeakAlloc = peak_alloc::PeakAlloc;

#[test]
fn inputs_that_once_failed_are_read_in_little_time_and_memory() {
    const LONGEST: Duration = Duration::from_secs(5);
    const MOST: usize = 64 << 20;
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz");
    let mut count = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let found = reading::examine(&path, &mut Random::new(1, 0, 1));
        let name = path.display();
        assert!(found.panic.is_none(), "{name}: panic");
        assert!(found.time < LONGEST, "{name}: {:?}", found.time);
        assert!(found.memory < MOST, "{name}: {} bytes", found.memory);
        count += 1;
    }
    assert!(count > 7, "{count} inputs");
}

#[test]
fn messages_in_no_order_end_a_bag() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz/order.db3");
    let read = trocar_recording::read_columns(&path, "/bench/force_n", &["data"]).unwrap();
    assert_eq!(read, [[1.5, 1.5]]);
}
