//! Creates the FMU file: description, libraries and model in a ZIP archive.

use std::fmt;
use std::str::FromStr;

use thiserror::Error;
use trocar_model::Trocar;

use crate::resource::{MODEL, to_bytes, to_row};
use crate::variables::{Input, Role, token, variables};
use description::{Description, build_description};
use page::page;
use zip::Archive;

mod description;
mod page;
mod source;
mod zip;

/// Base name of the libraries, `modelIdentifier` in the description of an FMU that holds them.
const IDENTIFIER: &str = "trocar";

/// Licences of the embedded library, under the name required by FMI 3.0.
const LICENCES: &str = concat!(
    "Licensed under either of MIT or Apache-2.0, at your option.\n\n",
    include_str!("../../../../LICENSE-MIT"),
    "\n\n",
    include_str!("../../../../LICENSE-APACHE"),
);

/// Version of FMI.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Version {
    /// FMI 2.0.
    V2,
    /// FMI 3.0.
    V3,
}

impl FromStr for Version {
    type Err = PackageError;

    /// Parses its number.
    fn from_str(text: &str) -> Result<Self, PackageError> {
        match text {
            "2" | "2.0" => Ok(Self::V2),
            "3" | "3.0" => Ok(Self::V3),
            _ => refused(format!("‹fmi› must be 2 or 3, got {text}")),
        }
    }
}

impl FromStr for Input {
    type Err = PackageError;

    fn from_str(name: &str) -> Result<Self, PackageError> {
        match name {
            "position" => Ok(Self::Position),
            "velocity" => Ok(Self::Velocity),
            _ => refused(format!("‹input› \"{name}\": expected position or velocity")),
        }
    }
}

/// Whether an FMU holds libraries or source code.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Form {
    Library,
    Source,
}

/// The model in C as `trocar export c --name seal --out seal.c` writes it, but with static functions
/// only.
#[derive(Debug, Clone, Copy)]
pub struct Source<'a> {
    /// `seal.h`.
    pub header: &'a str,
    /// `seal.c`.
    pub code: &'a str,
}

/// Contents of an FMU.
#[derive(Debug, Clone)]
pub struct Contents<'a> {
    /// Displayed name of the model. The model identifier of an FMU with source code is `trocar_` and
    /// this name, with `_` for characters that a name in C cannot contain.
    pub name: &'a str,
    /// The model.
    pub trocar: Trocar<&'a [f64]>,
    /// The driving input.
    pub input: Input,
    /// Version of FMI.
    pub version: Version,
    /// The model as readable text; the library does not read it.
    pub text: &'a str,
    /// This crate as a library, one per platform.
    pub binaries: &'a [Binary],
    /// Source code in place of libraries; the importer compiles it. Parameters are then constants,
    /// and the seal begins undeformed.
    pub source: Option<Source<'a>>,
}

/// This crate as a shared library.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Binary {
    /// Its platform.
    pub platform: Platform,
    /// The file.
    pub bytes: Vec<u8>,
}

impl Binary {
    /// Whether the file begins like a library of its platform.
    pub fn is_plausible(&self) -> bool {
        self.platform.takes(&self.bytes)
    }
}

/// A platform that FMI has a name for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Platform {
    /// Name in FMI 3.0, such as `x86_64-linux`.
    tuple: &'static str,
    /// Name in FMI 2.0, or that of 3.0 if there is none.
    short: &'static str,
}

const PLATFORMS: [Platform; 8] = [
    Platform { tuple: "x86_64-linux", short: "linux64" },
    Platform { tuple: "x86-linux", short: "linux32" },
    Platform { tuple: "aarch64-linux", short: "aarch64-linux" },
    Platform { tuple: "x86_64-windows", short: "win64" },
    Platform { tuple: "x86-windows", short: "win32" },
    Platform { tuple: "aarch64-windows", short: "aarch64-windows" },
    Platform { tuple: "x86_64-darwin", short: "darwin64" },
    Platform { tuple: "aarch64-darwin", short: "aarch64-darwin" },
];

impl Platform {
    /// The platform of a processor and an operating system as Rust names them; `None` if FMI has no
    /// name for it.
    pub(crate) fn of(processor: &str, system: &str) -> Option<Self> {
        let system = if system == "macos" { "darwin" } else { system };
        format!("{processor}-{system}").parse().ok()
    }

    /// Name of the library in the folder of the platform.
    pub(crate) fn file(self) -> String {
        format!("{IDENTIFIER}.{}", self.extension())
    }

    fn extension(self) -> &'static str {
        match self.system() {
            "windows" => "dll",
            "darwin" => "dylib",
            _ => "so",
        }
    }

    fn system(self) -> &'static str {
        self.tuple.split_once('-').map_or("", |(_, system)| system)
    }

    /// Whether `bytes` begin like a library of this system: ELF, PE or Mach-O.
    fn takes(self, bytes: &[u8]) -> bool {
        match self.system() {
            "windows" => bytes.starts_with(b"MZ"),
            "darwin" => {
                bytes.starts_with(&[0xcf, 0xfa, 0xed, 0xfe])
                    || bytes.starts_with(&[0xca, 0xfe, 0xba, 0xbe])
            }
            _ => bytes.starts_with(b"\x7fELF"),
        }
    }
}

impl fmt::Display for Platform {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.tuple)
    }
}

impl FromStr for Platform {
    type Err = PackageError;

    /// Parses its name in FMI 3.0 or 2.0.
    fn from_str(name: &str) -> Result<Self, PackageError> {
        let found =
            PLATFORMS.into_iter().find(|platform| name == platform.tuple || name == platform.short);
        found.ok_or_else(|| {
            let known = listed(&PLATFORMS);
            PackageError::Refused(format!("no platform \"{name}\", must be one of {known}"))
        })
    }
}

/// Why there is no FMU.
#[non_exhaustive]
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum PackageError {
    /// What is asked for makes no FMU.
    #[error("{0}")]
    Refused(String),
    /// A library that this program does not carry.
    #[error("this build contains no FMU library{}{}", .platform.map_or(String::new(), |one| format!(" for {one}")), carried_instead(.carried, .reason))]
    NotCarried {
        /// Its platform; `None` where any would do.
        platform: Option<Platform>,
        /// Platforms of the libraries that it carries.
        carried: Vec<Platform>,
        /// Why it carries none; empty if it carries one.
        reason: &'static str,
    },
    /// Libraries beside source code, whose parameters are constants.
    #[error("an FMU holds either libraries or source code")]
    Both,
    /// An archive larger than the format allows.
    #[error("an FMU cannot be larger than 4 GB")]
    TooLarge,
}

fn refused<T>(why: impl Into<String>) -> Result<T, PackageError> {
    Err(PackageError::Refused(why.into()))
}

fn listed(platforms: &[Platform]) -> String {
    let names: Vec<&str> = platforms.iter().map(|platform| platform.tuple).collect();
    names.join(", ")
}

/// What this program carries in place of a library, or why it carries none.
fn carried_instead(carried: &[Platform], reason: &str) -> String {
    match carried {
        [] => format!(": {reason}"),
        carried => format!(", only for {}", listed(carried)),
    }
}

/// The bytes of an FMU: the same contents give the same bytes.
///
/// # Errors
/// [`PackageError`] without a library, for two libraries of one platform, or for an invalid one.
pub fn package(contents: &Contents) -> Result<Vec<u8>, PackageError> {
    let Contents { name, trocar, input, version, text, binaries, source } = *contents;
    let form = if source.is_some() { Form::Source } else { Form::Library };
    let row = to_row(&trocar);
    let mut variables = variables(&trocar, input);
    let mut token = token(&row, input);
    if form == Form::Source {
        variables.retain(|variable| {
            !matches!(variable.role, Role::InitialForce | Role::InitialDeflection)
        });
        token = token.replace('}', "-source}");
    }
    let has_mode = variables.iter().any(|variable| variable.role == Role::Mode);
    let identifier = match form {
        Form::Library => IDENTIFIER.to_owned(),
        Form::Source => source::identifier(name),
    };
    let description = Description {
        name,
        identifier: &identifier,
        token: &token,
        variables: &variables,
        form,
        has_mode,
    };
    let mut archive = Archive::default();
    archive.add("modelDescription.xml", description.to_xml(version).as_bytes())?;
    for (place, binary) in binaries.iter().enumerate() {
        let Binary { platform, bytes } = binary;
        if !binary.is_plausible() {
            return refused(format!("not a shared library for {platform}"));
        }
        if binaries[..place].iter().any(|other| other.platform == *platform) {
            return refused(format!("two libraries for {platform}"));
        }
        let folder = if version == Version::V2 { platform.short } else { platform.tuple };
        archive.add(&format!("binaries/{folder}/{}", platform.file()), bytes)?;
    }
    match source {
        None if binaries.is_empty() => {
            return refused("an FMU needs a library for at least one platform");
        }
        None => archive.add(&format!("resources/{MODEL}"), &to_bytes(&row))?,
        Some(_) if !binaries.is_empty() => return Err(PackageError::Both),
        Some(model) => {
            let elements = trocar.seal().stages().map_or(0, |stages| stages.elements().len());
            let header = source::header(&description, version, source::Model { input, elements });
            let own = [("seal.c", model.code), ("seal.h", model.header), ("variables.h", &header)];
            for (name, text) in own.into_iter().chain(source::interface(version)) {
                archive.add(&format!("sources/{name}"), text.as_bytes())?;
            }
            if version == Version::V3 {
                let build = build_description(&identifier);
                archive.add("sources/buildDescription.xml", build.as_bytes())?;
            }
        }
    }
    archive.add("resources/model.json", text.as_bytes())?;
    archive.add("documentation/index.html", page(name, &variables, input, form).as_bytes())?;
    archive.add("documentation/licenses/license.txt", LICENCES.as_bytes())?;
    archive.finish()
}
