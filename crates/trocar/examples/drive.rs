//! Runs a model file along a motion through the library: the driver that the other programs are
//! compared with.
//!
//! ```text
//! cargo run -p trocar --example drive -- MODEL.json MOTION.csv
//! ```
//! prints one force (N) per row, in the shortest digits that read back as the same number. The
//! first row is where the seal stands, undeformed; each further row is one step to its position in
//! the time since the row above. Where a third column is the angle (rad), the instrument turns to it,
//! and a torque (N·m) follows each force.

use std::error::Error;
use std::path::Path;

use trocar::model_file::ModelFile;
use trocar_model::TrocarState;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [model, motion] = &arguments[..] else {
        return Err("expected MODEL.json MOTION.csv".into());
    };
    let file = ModelFile::read(Path::new(model))?;
    let trocar = file.trocar.borrowed();
    let text = std::fs::read_to_string(motion)?;
    let mut rows = text.lines().skip(1).map(|line| -> Result<Vec<f64>, Box<dyn Error>> {
        Ok(line.split(',').map(str::parse).collect::<Result<_, _>>()?)
    });
    let expected = "expected time_s,position_m or time_s,position_m,angle_rad";
    let first = rows.next().ok_or("the motion is empty")??;
    let [mut before, position, ref angle @ ..] = first[..] else { return Err(expected.into()) };
    let mut state = trocar.rest(position).with_angle(angle.first().copied().unwrap_or(0.0));
    let print = |state: &TrocarState| match angle {
        [] => println!("{}", state.force()),
        _ => println!("{}\n{}", state.force(), state.torque()),
    };
    print(&state);
    for row in rows {
        let time = match row?[..] {
            [time, position] => {
                trocar.step_to(&mut state, position, time - before);
                time
            }
            [time, position, angle] => {
                trocar.turn_to(&mut state, position, angle, time - before);
                time
            }
            _ => return Err(expected.into()),
        };
        print(&state);
        before = time;
    }
    Ok(())
}
