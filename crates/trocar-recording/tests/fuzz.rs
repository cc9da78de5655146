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
