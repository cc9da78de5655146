//! How near to the scatter between strokes a seal with a profile along its way comes, on recordings that are not part of
//! this repository.
//!
//! ```text
//! cargo run --release -p trocar --example elastomer_floor -- FOLDER [DELAY_MS ...]
//! ```
//! FOLDER holds the recordings of real seals (ZILLEN). With delays, the positions are freed of glitches and read later.

use std::error::Error;
use std::path::Path;

use trocar::recording::{ReadOptions, Recording, read};

#[path = "../tests/common/elastomer.rs"]
mod elastomer;

fn main() -> Result<(), Box<dyn Error>> {
    let mut words = std::env::args().skip(1);
    let folder = words.next().ok_or("the folder of the recordings is missing")?;
    let file = |name: &str| Path::new(&folder).join(format!("{name}.csv"));
    let load = |name: &&str| read(&file(name), &ReadOptions::default());
    let recordings: Vec<Recording> = elastomer::NAMES.iter().map(load).collect::<Result<_, _>>()?;
    elastomer::table(&recordings, "as recorded", Recording::clone);
    for word in words {
        let delay: f64 = word.parse()?;
        let prepare = |r: &Recording| elastomer::with_delay(&elastomer::without_glitches(r).0, 1e-3 * delay);
        elastomer::table(&recordings, &format!("without glitches, position {delay} ms later"), prepare);
    }
    Ok(())
}
