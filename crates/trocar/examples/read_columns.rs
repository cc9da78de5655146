//! Reads columns over and over, beside other programs (`reference/reading`): `read_columns
//! COLUMN...`, then files by name on standard input, one a line; answers each with seconds by the
//! clock and of the processors (Linux), rows and the sum of the numbers.

use std::io::{BufRead, Write};
use std::time::Instant;

use trocar::recording::read_columns;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let names: Vec<String> = std::env::args().skip(1).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    for file in std::io::stdin().lock().lines() {
        let file = file?;
        let (before, start) = (processor_ticks(), Instant::now());
        let columns = read_columns(&file, "", &names)?;
        let (seconds, ticks) = (start.elapsed().as_secs_f64(), processor_ticks() - before);
        let sum: f64 = columns.iter().flatten().sum();
        println!("{seconds} {ticks} {} {sum}", columns.first().map_or(0, Vec::len));
        std::io::stdout().flush()?;
    }
    Ok(())
}

/// Ticks that this process has spent on processors; 0 where the system does not tell.
fn processor_ticks() -> u64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields = stat.rsplit(") ").next().unwrap_or_default().split(' ').skip(11).take(2);
    fields.filter_map(|ticks| ticks.parse::<u64>().ok()).sum()
}
