//! Runs a model along a motion in the WebAssembly module that reports carry, and prints one force
//! (N) a row.
//!
//! ```text
//! cargo run --release -p trocar-web --example drive_module -- MODEL MOTION
//! ```
//! MODEL is a `model.json`, MOTION a CSV file with the columns `time_s,position_m`. The first row
//! is where the seal is at rest; a row with the time of the one above changes nothing.

use std::error::Error;
use std::path::Path;

use trocar::model_file::ModelFile;

#[path = "../tests/module/mod.rs"]
#[allow(dead_code)] // the tests turn tunables, too
mod module;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [model, motion] = &arguments[..] else { return Err("name a model and a motion".into()) };
    let file = ModelFile::read(Path::new(model))?;
    let mut page = module::Page::start(&module::artefact())?;
    page.load(&file.trocar.borrowed())?;
    for (force, _) in page.drive(&module::read_motion(Path::new(motion))?)? {
        println!("{force}");
    }
    Ok(())
}
