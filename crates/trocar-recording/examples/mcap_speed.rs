//! How fast one joint is read out of an MCAP file: `cargo run --release -p trocar-recording
//! --example mcap_speed --features mcap [MESSAGES]`.
//!
//! Writes a file of `sensor_msgs/msg/JointState` (7 joints, position, velocity and effort) with the
//! crate `mcap`, with zstd and without compression, and reads the stamp and one joint's position
//! from it, seven times. Prints messages per second, the median.

use std::collections::BTreeMap;
use std::io::BufWriter;
use std::path::Path;
use std::time::Instant;

use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions};

const MESSAGES: u64 = 2_000_000;
const RUNS: usize = 7;
const JOINTS: [&str; 7] = [
    "outer_yaw",
    "outer_pitch",
    "outer_insertion",
    "outer_roll",
    "wrist_pitch",
    "wrist_yaw",
    "jaw",
];
const TOPIC: &str = "/psm1/measured_js";
const DEFINITION: &str = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n\
    ================\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n\
    ================\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n";

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let messages = std::env::args().nth(1).map_or(Ok(MESSAGES), |text| text.parse())?;
    let folder = tempfile::tempdir_in(".")?;
    for (name, compression) in [("none", None), ("zstd", Some(Compression::Zstd))] {
        let path = folder.path().join(format!("{name}.mcap"));
        write(&path, messages, compression)?;
        let bytes = std::fs::metadata(&path)?.len() as f64 / messages as f64;
        let mut seconds: Vec<f64> =
            (0..RUNS).map(|_| read(&path, messages)).collect::<Result<_, _>>()?;
        seconds.sort_by(f64::total_cmp);
        let rate = |seconds: f64| messages as f64 / seconds / 1e6;
        let (median, best) = (rate(seconds[RUNS / 2]), rate(seconds[0]));
        println!(
            "{name}: {median:.2} million messages per second (best {best:.2}), {bytes:.0} bytes each in the file"
        );
        std::fs::remove_file(&path)?;
    }
    Ok(())
}

fn read(path: &Path, messages: u64) -> Result<f64, Box<dyn std::error::Error>> {
    let start = Instant::now();
    let columns = trocar_recording::read_columns(
        path,
        TOPIC,
        &["header.stamp_s", "position[outer_insertion]"],
    )?;
    let seconds = start.elapsed().as_secs_f64();
    let is_whole =
        columns[0].len() as u64 == messages && columns[1].iter().all(|value| value.is_finite());
    if is_whole { Ok(seconds) } else { Err("not all messages came back".into()) }
}

fn write(
    path: &Path,
    messages: u64,
    compression: Option<Compression>,
) -> Result<(), Box<dyn std::error::Error>> {
    let options = WriteOptions::new().profile("ros2").compression(compression);
    let mut writer = options.create(BufWriter::new(std::fs::File::create(path)?))?;
    let schema =
        writer.add_schema("sensor_msgs/msg/JointState", "ros2msg", DEFINITION.as_bytes())?;
    let channel_id = writer.add_channel(schema, TOPIC, "cdr", &BTreeMap::new())?;
    let mut payload = Vec::new();
    for k in 0..messages {
        let time = 1_700_000_000_000_000_000 + k * 1_000_000;
        joint_state(&mut payload, k, time);
        let header =
            MessageHeader { channel_id, sequence: k as u32, log_time: time, publish_time: time };
        writer.write_to_known_channel(&header, &payload)?;
    }
    writer.finish()?;
    Ok(())
}

/// One message in plain CDR, little endian.
fn joint_state(payload: &mut Vec<u8>, k: u64, time: u64) {
    payload.clear();
    payload.extend_from_slice(&[0, 1, 0, 0]);
    word(payload, (time / 1_000_000_000) as u32);
    word(payload, (time % 1_000_000_000) as u32);
    text(payload, "psm1_base");
    word(payload, JOINTS.len() as u32);
    JOINTS.iter().for_each(|name| text(payload, name));
    for (array, scale) in [1.0, 0.1, 10.0].into_iter().enumerate() {
        word(payload, JOINTS.len() as u32);
        align(payload, 8);
        for joint in 0..JOINTS.len() {
            // Last digits that no compression can guess, as a sensor has them.
            let noise =
                (k.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> (20 + joint)) as f64 / 2_f64.powi(60);
            let value = scale * ((k as f64 * 1e-3 + joint as f64 + array as f64).sin() + noise);
            payload.extend_from_slice(&value.to_le_bytes());
        }
    }
}

fn align(payload: &mut Vec<u8>, size: usize) {
    payload.resize(4 + (payload.len() - 4).next_multiple_of(size), 0);
}

fn word(payload: &mut Vec<u8>, value: u32) {
    align(payload, 4);
    payload.extend_from_slice(&value.to_le_bytes());
}

fn text(payload: &mut Vec<u8>, value: &str) {
    word(payload, value.len() as u32 + 1);
    payload.extend_from_slice(value.as_bytes());
    payload.push(0);
}
