//! Builds the shared library inside FMUs: for the build scripts of programs that carry it.
//!
//! This crate is built once more, as a shared library, by the same Cargo in a target folder of its
//! own: no lock is shared with the build that waits for it. Where that is not possible (a target
//! without shared libraries, a packaged crate without its neighbours) there is a reason instead.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The library that was built, or why there is none.
#[derive(Debug, Clone, Default)]
struct Library {
    /// Bytes of the library; empty if there is none.
    bytes: Vec<u8>,
    /// Why there is none; empty if there is one.
    reason: String,
    /// Files and folders from which it is built.
    sources: Vec<PathBuf>,
}

/// For the build script of a program in a folder of `crates/`: writes the library and the reason why
/// there is none to `fmu-library` and `fmu-reason.txt` in `OUT_DIR`. `user` is what needs it.
///
/// # Panics
/// Outside a build script, and when `OUT_DIR` cannot be written.
pub fn embed(user: &str) {
    let set =
        |name: &str| env::var(name).unwrap_or_else(|error| panic!("Cargo sets {name}: {error}"));
    let out = PathBuf::from(set("OUT_DIR"));
    // Not the folder where the script was compiled: a copied target folder may still hold it.
    let root = PathBuf::from(set("CARGO_MANIFEST_DIR")).join("../..");
    let library = build(&root, &out, &set("TARGET"));
    for path in &library.sources {
        println!("cargo::rerun-if-changed={}", path.display());
    }
    println!("cargo::rerun-if-changed=build.rs");
    if library.bytes.is_empty() {
        println!("cargo::warning={user} will not work: {}", library.reason);
    }
    fs::write(out.join("fmu-library"), library.bytes).expect("OUT_DIR is writable");
    fs::write(out.join("fmu-reason.txt"), library.reason).expect("OUT_DIR is writable");
}

/// Builds the library of the workspace at `root` for `target` in the folder `out`.
fn build(root: &Path, out: &Path, target: &str) -> Library {
    let paths = [
        "Cargo.toml",
        "Cargo.lock",
        "LICENSE-MIT",
        "LICENSE-APACHE",
        "crates/trocar-fmu",
        "crates/trocar-model",
    ];
    let sources = paths.iter().flat_map(|path| parts(&root.join(path))).collect();
    match built(root, out, target) {
        Ok(bytes) => Library { bytes, reason: String::new(), sources },
        Err(reason) => Library { bytes: Vec::new(), reason, sources },
    }
}

/// Of a crate its manifest and sources: its tests do not matter here.
fn parts(path: &Path) -> Vec<PathBuf> {
    if path.is_dir() {
        vec![path.join("Cargo.toml"), path.join("src")]
    } else {
        vec![path.to_owned()]
    }
}

fn built(root: &Path, out: &Path, target: &str) -> Result<Vec<u8>, String> {
    let folder = out.join("fmu");
    let output = Command::new(env::var_os("CARGO").unwrap_or("cargo".into()))
        .current_dir(root)
        .args(["rustc", "--package", "trocar-fmu", "--lib", "--crate-type", "cdylib"])
        .args(["--profile", "fmu", "--locked", "--quiet", "--target", target, "--target-dir"])
        .arg(&folder)
        // The library is for other machines: it takes no flags meant for this one, and names no
        // folders of it.
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
        let said: Vec<&str> =
            said.lines().map(str::trim).filter(|line| !line.is_empty()).take(4).collect();
        return Err(format!("no shared library for {target}: {}", said.join("; ")));
    }
    let built = folder.join(target).join("fmu");
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
    let flags: Vec<String> = named
        .map(|(folder, name)| format!("--remap-path-prefix={}={name}", folder.display()))
        .collect();
    flags.join("\x1f")
}
