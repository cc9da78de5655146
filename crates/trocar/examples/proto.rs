use std::path::Path;
use trocar::identify::timing::position_lag;
use trocar::recording::{ReadOptions, read};
fn main() {
    for w in std::env::args().skip(1) {
        let r = read(Path::new(&w), &ReadOptions::default()).unwrap();
        let raw = position_lag(std::slice::from_ref(&r));
        let c = r.clone().without_glitches();
        let t = std::time::Instant::now();
        println!(
            "{} raw {:?}\n   clean {:?}  {:?} {:?}",
            r.name,
            raw,
            position_lag(std::slice::from_ref(&c)),
            c.quality.notes.last(),
            t.elapsed()
        );
    }
}
