//! Recordings of repeated strokes: identified from every other cycle, scored on the others, beside
//! the scatter between strokes.
//!
//! ```text
//! cargo run --release -p trocar --example stroke_halves -- RECORDING...
//! ```
//! Prints a table in Markdown: error on the cycles left out, N, their own scatter, N, and the
//! ratio, for both halves.

use std::path::Path;

use rayon::prelude::*;
use trocar::identify::{IdentifyOptions, identify};
use trocar::profile::cycles;
use trocar::recording::{ReadOptions, Recording, read};
use trocar::segment::{reversal_threshold, strokes};
use trocar::validate::{AgainstStrokes, validate};

type AnyError = Box<dyn std::error::Error + Send + Sync>;

/// The cycles of `recording` whose number leaves `rest` when halved, as a recording of their own.
fn half(recording: &Recording, rest: usize) -> Result<Recording, AnyError> {
    let cycle = cycles(recording, &strokes(recording, reversal_threshold(recording)));
    let kept: Vec<usize> = (0..recording.len()).filter(|i| cycle[*i] % 2 == rest).collect();
    let column = |values: &[f64]| kept.iter().map(|i| values[*i]).collect();
    let [time, position, force] =
        [&recording.time, &recording.position, &recording.force].map(|v| column(v));
    Ok(Recording::from_columns(recording.name.clone(), time, position, force)?)
}

/// Identified from the cycles that leave `rest`, scored on the others.
fn scored(recording: &Recording, rest: usize) -> Result<AgainstStrokes, AnyError> {
    let options = IdentifyOptions::default();
    let found = identify(&[half(recording, rest)?], &options, &|_, _| {})?;
    let held_out = found.without_delay(vec![half(recording, 1 - rest)?])?;
    let scores = validate(&found.trocar(), &held_out, found.model.offset);
    scores.recordings[0].strokes.ok_or_else(|| "no strokes that repeat each other".into())
}

fn row(path: &String) -> Result<String, AnyError> {
    let recording = read(Path::new(path), &ReadOptions::default())?.without_glitches();
    let mut row = format!("| `{}` ", recording.name);
    for rest in [0, 1] {
        let AgainstStrokes { rms_n, stroke_scatter_n, rms_over_scatter, .. } =
            scored(&recording, rest)?;
        row.push_str(&format!("| {rms_n:.3} | {stroke_scatter_n:.3} | {rms_over_scatter:.2} "));
    }
    row.push('|');
    Ok(row)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let paths: Vec<String> = std::env::args().skip(1).collect();
    let rows = paths
        .par_iter()
        .map(row)
        .collect::<Result<Vec<_>, _>>()
        .map_err(|error| error.to_string())?;
    println!(
        "| recording | even cycles left out: error, N | scatter, N | ratio | odd ones: error, N | scatter, N | ratio |"
    );
    println!("|---|---|---|---|---|---|---|");
    rows.iter().for_each(|row| println!("{row}"));
    Ok(())
}
