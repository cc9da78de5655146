//! Made-up types of trocars, and recordings of their specimens in the folders that `trocar fleet` reads.

use std::error::Error;
use std::fs::{self, File};
use std::io::BufWriter;
use std::path::Path;

use trocar::bench::{BenchConfig, PlausibleSeals, Protocol, random_seal, run};
use trocar::recording::Readings;
use trocar_model::Element;

/// Name, F_c in N, β in N s/m, c in m.
pub(crate) const TYPES: [(&str, [f64; 3]); 3] =
    [("gel", [1.5, 8.0, 4e-3]), ("leaf", [2.5, 4.0, 6e-3]), ("membrane", [3.5, 2.0, 3e-3])];
/// Part of F_c lost with each insertion.
const WEAR: f64 = 1e-3;

/// A specimen, numbered among all, whose F_c is that of its type times a factor, after some insertions.
pub(crate) struct Specimen {
    pub(crate) kind: usize,
    pub(crate) name: String,
    pub(crate) factor: f64,
    pub(crate) branches_seed: u64,
    pub(crate) insertions: u64,
}

/// Path of the recording below `folder`, and the true F_c, β and c. At most `samples` of it are kept.
pub(crate) fn record(
    folder: &Path,
    specimen: &Specimen,
    config: &BenchConfig,
    (seed, samples): (u64, usize),
) -> Result<(String, [f64; 3]), Box<dyn Error + Send + Sync>> {
    let (kind, [force, viscous, width]) = TYPES[specimen.kind];
    let force = force * specimen.factor * (1.0 - WEAR * specimen.insertions as f64);
    let ranges = PlausibleSeals {
        coulomb_force: (force, force),
        viscous_damping: (viscous, viscous),
        half_width: (width, width),
        friction_asymmetry: 0.0,
        branch_asymmetry: 0.1,
    };
    let seal = [Element::new(random_seal(&ranges, specimen.branches_seed))?];
    let run = run(config, Protocol::Validation, &seal, seed)?;
    let samples = samples.min(run.time.len());
    let Specimen { name, insertions, .. } = specimen;
    let place = format!("trocar_type={kind}/specimen={kind}-{name}/insertion_count={insertions}");
    fs::create_dir_all(folder.join(&place))?;
    let path = format!("{place}/strokes.csv");
    let file = BufWriter::new(File::create(folder.join(&path))?);
    let readings = Readings { velocity: None, ..run.readings() };
    readings.at(0..samples).write(file)?;
    Ok((path, [force, viscous, width]))
}
