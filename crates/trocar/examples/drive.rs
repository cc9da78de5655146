//! Runs a model file along a motion through the library: the driver that the other programs are
//! compared with.
//!
//! ```text
//! cargo run -p trocar --example drive -- MODEL.json MOTION.csv
//! ```
//! prints one force (N) per row, in the shortest digits that read back as the same number. The
//! first row is where the seal stands, undeformed; each further row is one step to its position in
//! the time since the row above.

use std::error::Error;
use std::path::Path;

use trocar::model_file::ModelFile;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [model, motion] = &arguments[..] else {
        return Err("expected MODEL.json MOTION.csv".into());
    };
    let file = ModelFile::read(Path::new(model))?;
    let trocar = file.trocar.borrowed();
    let text = std::fs::read_to_string(motion)?;
    let mut rows = text.lines().skip(1).map(|line| -> Result<(f64, f64), Box<dyn Error>> {
        let (time, position) = line.split_once(',').ok_or("expected time_s,position_m")?;
        Ok((time.parse()?, position.parse()?))
    });
    let (mut before, position) = rows.next().ok_or("the motion is empty")??;
    let mut state = trocar.rest(position);
    println!("{}", state.force());
    for row in rows {
        let (time, position) = row?;
        println!("{}", trocar.step_to(&mut state, position, time - before));
        before = time;
    }
    Ok(())
}
