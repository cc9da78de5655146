//! `trocar export fmu`

use std::fs;
use std::io::Write as _;
use std::path::PathBuf;

use anyhow::Context;
use clap::ValueEnum;
use trocar::model_file::ModelFile;
use trocar::output::AtomicFile;
use trocar_fmu::{Binary, Contents, Input, Platform, Version, package};

use crate::Completion;
use crate::console::{BadArgument, Console};

/// The library for the platform of this program; empty if there is none.
const LIBRARY: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/fmu-library"));
/// The reason if there is none.
const REASON: &str = include_str!(concat!(env!("OUT_DIR"), "/fmu-reason.txt"));

/// Write a functional mock-up unit (FMU) for co-simulation in other programs, FMI 2.0 or 3.0
///
/// Holds the model and a library that runs it: position or velocity in, force out (with deflection
/// and mode for EMS elements), every parameter tunable. Its steps are those of 'trocar simulate'.
/// The same model gives the same bytes.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Model file (model.json, or one of those that compare writes)
    model: PathBuf,
    /// Result: an FMU file, '-' for standard output
    #[arg(long, value_name = "FILE.fmu")]
    out: PathBuf,
    /// Version of FMI: 2 is read by most programs
    #[arg(long, value_name = "VERSION", default_value = "2")]
    fmi: Fmi,
    /// What drives the model: the position at the end of a step, or the velocity during it
    #[arg(long, value_name = "QUANTITY", default_value = "position")]
    input: Drive,
    /// Name of the model in the description [default: name of the model file]
    #[arg(long)]
    name: Option<String>,
    /// Library of the crate trocar-fmu for another platform, such as x86_64-windows=trocar_fmu.dll;
    /// may be repeated
    #[arg(long, value_name = "PLATFORM=FILE", value_parser = library)]
    library: Vec<(Platform, PathBuf)>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Fmi {
    #[value(name = "2", alias = "2.0")]
    V2,
    #[value(name = "3", alias = "3.0")]
    V3,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Drive {
    Position,
    Velocity,
}

fn library(text: &str) -> Result<(Platform, PathBuf), String> {
    let (platform, file) = text
        .split_once('=')
        .ok_or("must be PLATFORM=FILE, such as x86_64-windows=trocar_fmu.dll")?;
    let platform = platform.parse::<Platform>().map_err(|error| error.to_string())?;
    Ok((platform, PathBuf::from(file)))
}

pub(crate) fn run(console: &Console, args: &Args) -> anyhow::Result<Completion> {
    let model = ModelFile::read(&args.model)?;
    let binaries = binaries(&args.library, LIBRARY, REASON)?;
    let name = args.name.clone().unwrap_or_else(|| name_of(&args.model));
    let bytes = package(&Contents {
        name: &name,
        trocar: model.trocar.borrowed(),
        input: match args.input {
            Drive::Position => Input::Position,
            Drive::Velocity => Input::Velocity,
        },
        version: match args.fmi {
            Fmi::V2 => Version::V2,
            Fmi::V3 => Version::V3,
        },
        text: &model.to_json(),
        binaries: &binaries,
    })?;
    let mut file = AtomicFile::create(&args.out)?;
    let outcome = file.write_all(&bytes);
    outcome.map_err(|source| file.write_error(source))?;
    file.commit()?;
    let platforms: Vec<String> =
        binaries.iter().map(|binary| binary.platform.to_string()).collect();
    console.remark(&format!(
        "{} bytes for {} -> {}",
        bytes.len(),
        platforms.join(", "),
        args.out.display()
    ));
    Ok(Completion::Clean)
}

fn name_of(model: &std::path::Path) -> String {
    model
        .file_stem()
        .map_or_else(|| "trocar".to_owned(), |stem| stem.to_string_lossy().into_owned())
}

/// The embedded library `inside`, unless it is missing for a `reason`, and the named ones; a named
/// library for this platform replaces the embedded one.
fn binaries(
    named: &[(Platform, PathBuf)],
    inside: &[u8],
    reason: &str,
) -> anyhow::Result<Vec<Binary>> {
    let mut binaries = Vec::new();
    for (platform, path) in named {
        let bytes = fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
        let binary = Binary { platform: *platform, bytes };
        if binaries.iter().any(|other: &Binary| other.platform == *platform) {
            return Err(BadArgument(format!("--library names {platform} twice")).into());
        }
        if !binary.is_plausible() {
            let path = path.display();
            return Err(
                BadArgument(format!("{path} is not a shared library for {platform}")).into()
            );
        }
        binaries.push(binary);
    }
    let native = Platform::native().filter(|_| !inside.is_empty());
    let is_new = |platform: &Platform| binaries.iter().all(|binary| binary.platform != *platform);
    if let Some(platform) = native.filter(is_new) {
        binaries.push(Binary { platform, bytes: inside.to_vec() });
    }
    if binaries.is_empty() {
        let reason = if reason.is_empty() { "FMI has no name for this platform" } else { reason };
        let hint = "hint: name libraries of trocar-fmu with --library, see docs/fmu.md";
        return Err(BadArgument(format!(
            "this trocar carries no library for FMUs: {reason}\n\n{hint}"
        ))
        .into());
    }
    Ok(binaries)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_without_a_library_says_why_and_takes_named_ones() {
        let refusal =
            binaries(&[], &[], "no shared library for x86_64-unknown-linux-musl").unwrap_err();
        let text = refusal.to_string();
        assert!(
            text.contains(
                "carries no library for FMUs: no shared library for x86_64-unknown-linux-musl"
            ),
            "{text}"
        );
        assert!(text.contains("hint: name libraries of trocar-fmu with --library"), "{text}");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trocar_fmu.dll");
        fs::write(&path, "MZ").unwrap();
        let named = binaries(&[("win64".parse().unwrap(), path)], &[], "").unwrap();
        assert_eq!(named.len(), 1);
    }
}
