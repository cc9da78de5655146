use std::path::Path;
use trocar::identify::position_lag;
use trocar::recording::{ReadOptions, read};
fn main() {
    for w in std::env::args().skip(1) {
        let c = read(Path::new(&w), &ReadOptions::default()).unwrap().without_glitches();
        println!(
            "{} {:?} {}",
            c.name,
            position_lag(std::slice::from_ref(&c)).map(|l| l.lag_s),
            c.quality.median_interval
        );
    }
}
