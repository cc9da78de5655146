//! Builds the library that `Model.export_fmu` puts into an FMU, so that the package carries it
//! inside.

use std::env;
use std::fs;
use std::path::PathBuf;

fn main() {
    let set =
        |name: &str| env::var(name).unwrap_or_else(|error| panic!("Cargo sets {name}: {error}"));
    let out = PathBuf::from(set("OUT_DIR"));
    // Not the folder where this script was compiled: a copied target folder may still hold it.
    let root = PathBuf::from(set("CARGO_MANIFEST_DIR")).join("../..");
    let library = trocar_fmu::library::build(&root, &out, &set("TARGET"));
    for path in &library.sources {
        println!("cargo::rerun-if-changed={}", path.display());
    }
    println!("cargo::rerun-if-changed=build.rs");
    if library.bytes.is_empty() {
        println!("cargo::warning=Model.export_fmu will not work: {}", library.reason);
    }
    fs::write(out.join("fmu-library"), library.bytes).expect("OUT_DIR is writable");
    fs::write(out.join("fmu-reason.txt"), library.reason).expect("OUT_DIR is writable");
}
