//! Libraries inside FMUs: for the build scripts of programs that carry them.
//!
//! The environment variable [`FOLDER`] names a folder of finished libraries, laid out like
//! `binaries` in an FMU of version 3.0 (`x86_64-windows/trocar.dll`): the program carries those and
//! no others. Without it this crate is built once more for the target of the program, as a shared
//! library, by the same Cargo in a target folder of its own: no lock is shared with the build that
//! waits for it. Where that is not possible (a target without shared libraries, a packaged crate
//! without its neighbours) there is a reason instead.

use std::env;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::package::{Binary, Platform};

/// Environment variable that names a folder of finished libraries when a program is built.
pub const FOLDER: &str = "TROCAR_FMU_LIBRARIES";

/// For the build script of a program in a folder of `crates/`: writes the libraries and the reason
/// why there are none as an expression of type [`Embedded`](crate::Embedded) to `fmu.rs` in
/// `OUT_DIR`. `user` is what needs it.
///
/// # Panics
/// Outside a build script, when `OUT_DIR` cannot be written, and when the folder that [`FOLDER`]
/// names holds anything but libraries for different platforms.
pub fn embed(user: &str) {
    let out = PathBuf::from(set("OUT_DIR"));
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed={FOLDER}");
    let (binaries, reason) = match env::var_os(FOLDER) {
        Some(folder) => {
            println!("cargo::rerun-if-changed={}", Path::new(&folder).display());
            let found = finished(Path::new(&folder));
            (found.unwrap_or_else(|error| panic!("{FOLDER}: {error}")), String::new())
        }
        None => match native(&out) {
            Ok(binary) => (vec![binary], String::new()),
            Err(reason) => (Vec::new(), reason),
        },
    };
    if binaries.is_empty() {
        println!("cargo::warning={user} will not work: {reason}");
    }
    write(&out, &binaries, &reason);
}

/// What Cargo sets for build scripts.
fn set(name: &str) -> String {
    env::var(name).unwrap_or_else(|error| panic!("Cargo sets {name}: {error}"))
}

/// Writes `fmu.rs`, and the libraries beside it.
fn write(out: &Path, binaries: &[Binary], reason: &str) {
    let mut libraries = String::new();
    for Binary { platform, bytes } in binaries {
        fs::write(out.join(format!("fmu-{platform}")), bytes).expect("OUT_DIR is writable");
        let bytes = format!("include_bytes!(concat!(env!(\"OUT_DIR\"), \"/fmu-{platform}\"))");
        write!(libraries, "(\"{platform}\", {bytes}), ").expect("a string takes all text");
    }
    let text =
        format!("trocar_fmu::Embedded {{ libraries: &[{libraries}], reason: {reason:?} }}\n");
    fs::write(out.join("fmu.rs"), text).expect("OUT_DIR is writable");
}

/// Libraries in a folder laid out like `binaries` in an FMU of version 3.0, by name of platform.
fn finished(folder: &Path) -> Result<Vec<Binary>, String> {
    let within = |error: std::io::Error| format!("{}: {error}", folder.display());
    let entries: Result<Vec<_>, _> = fs::read_dir(folder).map_err(within)?.collect();
    let mut names: Vec<_> = entries.map_err(within)?.iter().map(fs::DirEntry::file_name).collect();
    names.sort();
    let binaries: Result<Vec<Binary>, String> = names
        .iter()
        .map(|name| {
            let platform: Platform =
                name.to_string_lossy().parse().map_err(|error: crate::package::PackageError| {
                    format!("{}: {error}", folder.display())
                })?;
            let path = folder.join(name).join(platform.file());
            let read = fs::read(&path).map_err(|error| format!("{}: {error}", path.display()));
            let binary = Binary { platform, bytes: read? };
            let is_library = binary.is_plausible();
            is_library
                .then_some(binary)
                .ok_or_else(|| format!("{} is not a shared library for {platform}", path.display()))
        })
        .collect();
    let binaries = binaries?;
    if binaries.is_empty() {
        return Err(format!("{} is empty", folder.display()));
    }
    Ok(binaries)
}

/// Builds the library for the target of the build script, whose own folder is `out`.
fn native(out: &Path) -> Result<Binary, String> {
    // Not the folder where the script was compiled: a copied target folder may still hold it.
    let root = PathBuf::from(set("CARGO_MANIFEST_DIR")).join("../..");
    for path in sources(&root) {
        println!("cargo::rerun-if-changed={}", path.display());
    }
    let (target, system) = (set("TARGET"), set("CARGO_CFG_TARGET_OS"));
    let platform = Platform::of(&set("CARGO_CFG_TARGET_ARCH"), &system)
        .ok_or_else(|| format!("FMI has no name for {target}"))?;
    let bytes = build(&root, out, &target)?;
    Ok(Binary { platform, bytes })
}

/// Files and folders from which the library is built.
fn sources(root: &Path) -> Vec<PathBuf> {
    let paths = ["Cargo.toml", "Cargo.lock", "crates/trocar-fmu", "crates/trocar-model"];
    paths.iter().flat_map(|path| parts(&root.join(path))).collect()
}

/// Of a crate its manifest and sources: its tests do not matter here.
fn parts(path: &Path) -> Vec<PathBuf> {
    if path.is_dir() {
        vec![path.join("Cargo.toml"), path.join("src")]
    } else {
        vec![path.to_owned()]
    }
}

fn build(root: &Path, out: &Path, target: &str) -> Result<Vec<u8>, String> {
    // Beside the folder `build` of `build/CRATE/out`, for all programs of a profile.
    let folder = out.ancestors().nth(3).unwrap_or(out).join("fmu-library");
    let output = Command::new(env::var_os("CARGO").unwrap_or("cargo".into()))
        .current_dir(root)
        .args(["rustc", "--package", "trocar-fmu", "--lib", "--crate-type", "cdylib"])
        .args(["--profile", "fmu", "--locked", "--quiet", "--target", target, "--target-dir"])
        .arg(&folder)
        // The library is for other machines: it takes no flags meant for this one, and names no
        // folders of it.
        .env("CARGO_ENCODED_RUSTFLAGS", flags(root, target))
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
    // What a second build that finds all done leaves alone.
    let built = folder.join(target).join("fmu").join("deps");
    let names = ["libtrocar_fmu.so", "trocar_fmu.dll", "libtrocar_fmu.dylib"];
    let found = names.iter().map(|name| built.join(name)).find(|path| path.exists());
    let path = found.ok_or_else(|| format!("no shared library for {target}: Cargo made none"))?;
    fs::read(&path).map_err(|error| format!("{}: {error}", path.display()))
}

/// Flags for rustc that take the folders of this machine out of messages, and out of the name that
/// a library for macOS has inside.
fn flags(root: &Path, target: &str) -> String {
    let root = fs::canonicalize(root).unwrap_or_else(|_| root.to_owned());
    let home = env::var_os("CARGO_HOME").map(PathBuf::from);
    let folders = [(Some(root), "trocar"), (home, "cargo")];
    let named = folders.into_iter().filter_map(|(folder, name)| Some((folder?, name)));
    let mut flags: Vec<String> = named
        .map(|(folder, name)| format!("--remap-path-prefix={}={name}", folder.display()))
        .collect();
    if target.contains("-apple-") {
        flags.push("-Clink-arg=-Wl,-install_name,@rpath/trocar.dylib".to_owned());
    }
    flags.join("\x1f")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A folder of libraries with these files.
    fn folder(files: &[(&str, &[u8])]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (name, bytes) in files {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, bytes).unwrap();
        }
        folder
    }

    #[test]
    fn all_libraries_of_a_folder_are_found() {
        let (dll, so) = (b"MZ rest".as_slice(), b"\x7fELF rest".as_slice());
        let files = folder(&[("x86_64-windows/trocar.dll", dll), ("aarch64-linux/trocar.so", so)]);
        let found = finished(files.path()).unwrap();
        let found: Vec<_> =
            found.iter().map(|found| (found.platform.to_string(), &*found.bytes)).collect();
        assert_eq!(found, [("aarch64-linux".to_owned(), so), ("x86_64-windows".to_owned(), dll)]);
    }

    #[test]
    fn other_folders_are_refused() {
        for (files, words) in [
            (&[][..], "is empty"),
            (&[("beos/trocar.so", b"\x7fELF".as_slice())], "no platform \"beos\""),
            (&[("x86_64-windows/trocar.so", b"MZ")], "trocar.dll: "),
            (
                &[("x86_64-windows/trocar.dll", b"\x7fELF")],
                "trocar.dll is not a shared library for x86_64-windows",
            ),
        ] {
            let error = finished(folder(files).path()).unwrap_err();
            assert!(error.contains(words), "{words} expected in {error}");
        }
        assert!(finished(Path::new("no/such/folder")).unwrap_err().contains("no/such/folder"));
    }
}
