//! Builds the library that `trocar export fmu` puts into an FMU, so that the program carries it inside.
//!
//! The crate `trocar-fmu` is built once more, as a shared library, by the same Cargo in a target folder of its own: no
//! lock is shared with the build that waits for it. Where that is not possible (a target without shared libraries, a
//! packaged crate without its neighbours) the program is built without it, and the verb says why.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

fn main() {
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("Cargo sets OUT_DIR"));
    // Not the folder where this script was compiled: a copied target folder may still hold it.
    let manifest = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("Cargo sets CARGO_MANIFEST_DIR"));
    let root = manifest.join("../..");
    for path in
        ["Cargo.toml", "Cargo.lock", "LICENSE-MIT", "LICENSE-APACHE", "crates/trocar-fmu", "crates/trocar-model"]
    {
        for part in parts(&root.join(path)) {
            println!("cargo::rerun-if-changed={}", part.display());
        }
    }
    println!("cargo::rerun-if-changed=build.rs");
    let (library, reason) = match library(&root, &out) {
        Ok(bytes) => (bytes, String::new()),
        Err(reason) => {
            println!("cargo::warning=trocar export fmu will not work: {reason}");
            (Vec::new(), reason)
        }
    };
    fs::write(out.join("fmu-library"), library).expect("OUT_DIR is writable");
    fs::write(out.join("fmu-reason.txt"), reason).expect("OUT_DIR is writable");
}

/// Of a crate its manifest and sources: its tests do not matter here.
fn parts(path: &Path) -> Vec<PathBuf> {
    if path.is_dir() { vec![path.join("Cargo.toml"), path.join("src")] } else { vec![path.to_owned()] }
}

fn library(root: &Path, out: &Path) -> Result<Vec<u8>, String> {
    let target = env::var("TARGET").map_err(|error| error.to_string())?;
    let folder = out.join("fmu");
    let output = Command::new(env::var_os("CARGO").unwrap_or("cargo".into()))
        .current_dir(root)
        .args(["rustc", "--package", "trocar-fmu", "--lib", "--crate-type", "cdylib"])
        .args(["--profile", "fmu", "--locked", "--quiet", "--target", &target, "--target-dir"])
        .arg(&folder)
        // The library is for other machines: it takes no flags meant for this one, and names no folders of it.
        .env("CARGO_ENCODED_RUSTFLAGS", flags(root))
        .env_remove("RUSTFLAGS")
        // Set by `cargo clippy`, which would check instead of build.
        .env_remove("RUSTC_WORKSPACE_WRAPPER")
        .env_remove("CLIPPY_ARGS")
        .output()
        .map_err(|error| format!("cannot run cargo: {error}"))?;
    if !output.status.success() {
        // The program keeps these words: without the folder of this machine.
        let here = fs::canonicalize(root).unwrap_or_else(|_| root.to_owned());
        let said = String::from_utf8_lossy(&output.stderr).replace(&*here.to_string_lossy(), ".");
        let said: Vec<&str> = said.lines().map(str::trim).filter(|line| !line.is_empty()).take(4).collect();
        return Err(format!("no shared library for {target}: {}", said.join("; ")));
    }
    let built = folder.join(&target).join("fmu");
    let names = ["libtrocar_fmu.so", "trocar_fmu.dll", "libtrocar_fmu.dylib"];
    let found = names.iter().map(|name| built.join(name)).find(|path| path.exists());
    let path = found.ok_or_else(|| format!("no shared library for {target}: Cargo made none"))?;
    fs::read(&path).map_err(|error| format!("{}: {error}", path.display()))
}

/// Flags for rustc that take the folders of this machine out of messages.
fn flags(root: &Path) -> String {
    let root = fs::canonicalize(root).unwrap_or_else(|_| root.to_owned());
    let home = env::var_os("CARGO_HOME").map(PathBuf::from);
    let folders = [(Some(root), "trocar"), (home, "cargo")];
    let named = folders.into_iter().filter_map(|(folder, name)| Some((folder?, name)));
    let flags: Vec<String> =
        named.map(|(folder, name)| format!("--remap-path-prefix={}={name}", folder.display())).collect();
    flags.join("\x1f")
}
