//! `trocar export fmu`

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use trocar::export::c::{CFiles, COptions, from_file};
use trocar::model_file::ModelFile;
use trocar::output::write_whole;
use trocar_fmu::{Binary, Contents, Embedded, Input, Platform, Source, Version, package};

use crate::Completion;
use crate::console::{BadArgument, Console};
use crate::output::Output;

/// The libraries that this program carries.
const INSIDE: Embedded = include!(concat!(env!("OUT_DIR"), "/fmu.rs"));

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
    out: Output,
    /// Version of FMI: 2 is read by most programs
    #[arg(long, value_name = "VERSION", default_value = "2", value_parser = version())]
    fmi: Version,
    /// What drives the model: the velocity during a step, which is what importers set at its beginning,
    /// or the position at its end, which most importers give one step late
    #[arg(long, value_name = "QUANTITY", default_value = "velocity", value_parser = input())]
    input: Input,
    /// Name of the model in the description [default: name of the model file]. With --source the
    /// model identifier is trocar_NAME; the C functions of the FMU have this prefix
    #[arg(long)]
    name: Option<String>,
    /// Platform to include of those that this program carries libraries for, such as x86_64-linux;
    /// may be repeated [default: all of them]
    #[arg(long, value_name = "PLATFORM")]
    platform: Vec<Platform>,
    /// Library of the crate trocar-fmu to include for a platform, such as
    /// x86_64-windows=trocar_fmu.dll, in place of the one that this program carries; may be repeated
    #[arg(long, value_name = "PLATFORM=FILE", value_parser = library)]
    library: Vec<(Platform, PathBuf)>,
    /// Source code in C in place of a library: for any platform whose importer compiles it. The
    /// parameters are then constants
    #[arg(long, conflicts_with_all = ["library", "platform"])]
    source: bool,
}

fn version() -> impl TypedValueParser<Value = Version> {
    let versions =
        [("2", "2.0"), ("3", "3.0")].map(|(name, other)| PossibleValue::new(name).alias(other));
    PossibleValuesParser::new(versions).try_map(|text| text.parse())
}

fn input() -> impl TypedValueParser<Value = Input> {
    PossibleValuesParser::new(["position", "velocity"]).try_map(|text| text.parse())
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
    let code = args.source.then(|| source(&args.model)).transpose()?;
    let binaries =
        if args.source { Vec::new() } else { binaries(INSIDE, &args.platform, &args.library)? };
    let name = args.name.clone().unwrap_or_else(|| name_of(&args.model));
    let bytes = package(&Contents {
        name: &name,
        trocar: model.trocar.borrowed(),
        input: args.input,
        version: args.fmi,
        text: &model.to_json(),
        binaries: &binaries,
        source: code.as_ref().map(|files| Source { header: &files.header, code: &files.source }),
    })?;
    write_whole(&args.out, &bytes)?;
    let platforms: Vec<String> =
        binaries.iter().map(|binary| binary.platform.to_string()).collect();
    let runs_on =
        if args.source { "importers that compile C".to_owned() } else { platforms.join(", ") };
    console.remark(&format!("{} bytes for {runs_on} -> {}", bytes.len(), args.out.display()));
    Ok(Completion::Clean)
}

/// The model in C as an FMU takes it.
fn source(model: &Path) -> anyhow::Result<CFiles> {
    Ok(from_file(model, COptions::IN_FMU)?)
}

fn name_of(model: &Path) -> String {
    model
        .file_stem()
        .map_or_else(|| "trocar".to_owned(), |stem| stem.to_string_lossy().into_owned())
}

/// The libraries `inside` for `platforms` (all, if none is given), and the named ones, which
/// replace those of the same platform.
fn binaries(
    inside: Embedded,
    platforms: &[Platform],
    named: &[(Platform, PathBuf)],
) -> anyhow::Result<Vec<Binary>> {
    let mut binaries = read(named)?;
    let chosen = if platforms.is_empty() { inside.platforms()? } else { platforms.to_vec() };
    let mut wanted: Vec<Platform> = Vec::new();
    for platform in chosen {
        let is_named = named.iter().any(|(other, _)| *other == platform);
        if !is_named && !wanted.contains(&platform) {
            wanted.push(platform);
        }
    }
    if !wanted.is_empty() || binaries.is_empty() {
        let carried = inside.binaries(Some(&wanted)).map_err(|error| {
            let hint =
                "hint: name libraries of trocar-fmu with --library, see docs/reference/fmu.md";
            BadArgument(format!("{error}\n\n{hint}"))
        })?;
        binaries.extend(carried);
    }
    Ok(binaries)
}

/// Libraries from files, one for each platform.
fn read(named: &[(Platform, PathBuf)]) -> anyhow::Result<Vec<Binary>> {
    let mut binaries: Vec<Binary> = Vec::new();
    for (platform, path) in named {
        let bytes = fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
        let binary = Binary { platform: *platform, bytes };
        if binaries.iter().any(|other| other.platform == *platform) {
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
    Ok(binaries)
}

#[cfg(test)]
mod tests {
    use super::*;

    const NONE: Embedded = Embedded { libraries: &[], reason: "no linker for this target" };
    const TWO: Embedded = Embedded {
        libraries: &[("x86_64-linux", b"\x7fELF inside"), ("x86_64-windows", b"MZ inside")],
        reason: "",
    };

    fn platform(name: &str) -> Platform {
        name.parse().unwrap()
    }

    #[test]
    fn a_program_without_a_library_says_why_and_takes_named_ones() {
        let text = binaries(NONE, &[], &[]).unwrap_err().to_string();
        assert!(text.contains("contains no FMU library: no linker for this target"), "{text}");
        assert!(text.contains("hint: name libraries of trocar-fmu with --library"), "{text}");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trocar_fmu.dll");
        fs::write(&path, "MZ").unwrap();
        let named = binaries(NONE, &[], &[(platform("win64"), path)]).unwrap();
        assert_eq!(named.len(), 1);
    }

    #[test]
    fn platforms_are_chosen_and_libraries_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trocar_fmu.dll");
        fs::write(&path, "MZ named").unwrap();
        let windows = (platform("win64"), path);
        let bytes = |platforms: &[Platform], named: &[(Platform, PathBuf)]| -> Vec<Vec<u8>> {
            let binaries = binaries(TWO, platforms, named).unwrap();
            binaries.into_iter().map(|binary| binary.bytes).collect()
        };
        assert_eq!(bytes(&[], &[]), [b"\x7fELF inside".to_vec(), b"MZ inside".to_vec()]);
        let linux = [platform("linux64"), platform("x86_64-linux")];
        assert_eq!(bytes(&linux, &[]), [b"\x7fELF inside"]);
        assert_eq!(
            bytes(&[], std::slice::from_ref(&windows)),
            [b"MZ named".to_vec(), b"\x7fELF inside".to_vec()]
        );
        assert_eq!(bytes(&[platform("win64")], &[windows]), [b"MZ named"]);
    }
}
