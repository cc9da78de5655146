//! Seconds to read a recording: `cargo run --release -p trocar --example reading_speed -- FILE`.
//!
//! Prints the wall time of [`trocar::recording::read`], which hashes the file and looks the samples
//! over, too.

use std::path::Path;
use std::time::Instant;

use trocar::recording::{ReadOptions, read};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("expected a file")?;
    for _ in 0..5 {
        let start = Instant::now();
        let recording = read(Path::new(&path), &ReadOptions::default())?;
        println!("{:.3} s, {} samples", start.elapsed().as_secs_f64(), recording.len());
    }
    Ok(())
}
