//! A model as C: a source file of constants and one step function, and its header, for a
//! microcontroller.
//!
//! The C code performs the operations of `trocar_model` in the same order with the same numbers and
//! its own exponential. So a compiler that follows IEEE 754 gives the same bits, except for `log1p`
//! and `log` of its library in rare corner cases. The files contain only what the model needs. The
//! templates next to this file are the code; `element` and `classical` fill in the constants.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::str::FromStr;

use thiserror::Error;
use trocar_model::profile::FADE;
use trocar_model::{PositionProfile, Seal, Stages};

use crate::compensate::{CompensateError, CompensateOptions, Compensator};
use trocar_recording::sha256;
use trocar_runtime::model_file::{ModelFile, ModelFileError, OriginKind};
use trocar_tables::output::OutputError;

pub use files::{CFiles, stem};

use template::{Filling, hexadecimal, number, remark};

mod classical;
mod compensator;
mod element;
mod files;
mod single;
mod template;

/// Default prefix of all names in the files.
pub const DEFAULT_PREFIX: &str = "trocar";

/// Longest prefix: C99 guarantees 31 significant characters in external names, and `_compensate`
/// follows.
pub(crate) const LONGEST_PREFIX: usize = 20;

/// Why a model cannot be written as C.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CError {
    /// The prefix is not valid in C names.
    #[error(
        "the prefix of C names must be 1 to {LONGEST_PREFIX} letters, digits and '_', beginning with a letter, got '{found}'"
    )]
    Prefix {
        /// What was found.
        found: String,
    },
    /// The name of the source file does not end in `.c` or cannot be part of an `#include`.
    #[error(
        "the C file must be named NAME.c with letters, digits, blanks and '_', '-', '.', '+' in NAME (NAME.h is written beside it), got '{found}'"
    )]
    FileName {
        /// What was found.
        found: String,
    },
    /// No precision.
    #[error("‹precision› {found:?}: expected double or single")]
    Precision {
        /// What was found.
        found: String,
    },
    /// A constant that a `float` cannot hold.
    #[error(
        "the model cannot be written in single precision: it contains {constant}, and a float holds magnitudes from 1.2e-38 to 3.4e38"
    )]
    Single {
        /// The constant.
        constant: String,
    },
    /// The observer of a model that resists rotation.
    #[error(
        "the exported observer knows the axis only, and the model has 'rotation'\n\nhint: the observer of the C library takes the angle; or export the model alone; or take 'rotation' out of the model file"
    )]
    Rotation,
    /// The model cannot be read or run.
    #[error(transparent)]
    Model(#[from] ModelFileError),
    /// The model cannot compensate.
    #[error(transparent)]
    Compensate(#[from] CompensateError),
    /// The files cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// Numbers of the C code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Precision {
    /// `double`, 64 bits: the forces of the library.
    #[default]
    Double,
    /// `float`, 32 bits, and no `double` anywhere, for processors that compute in single precision.
    Single,
}

impl FromStr for Precision {
    type Err = CError;

    fn from_str(name: &str) -> Result<Self, CError> {
        match name {
            "double" => Ok(Self::Double),
            "single" => Ok(Self::Single),
            _ => Err(CError::Precision { found: name.to_owned() }),
        }
    }
}

/// How a model is written.
#[derive(Debug, Clone, Copy)]
pub struct COptions<'a> {
    /// Beginning of all names in C.
    pub prefix: &'a str,
    /// Name of the files without extension, from [`stem`].
    pub stem: &'a str,
    /// Numbers.
    pub precision: Precision,
    /// The observer of the tissue force beside the model.
    pub compensator: Option<&'a CompensateOptions>,
    /// Only static functions, for a source file that includes the code.
    pub internal: bool,
}

impl COptions<'_> {
    /// As the source code inside an FMU: `seal.c` and `seal.h`, the forces of the library.
    pub const IN_FMU: Self = COptions {
        prefix: "seal",
        stem: "seal",
        precision: Precision::Double,
        compensator: None,
        internal: true,
    };
}

/// What a kind of models puts into the files; all are templates.
struct Parts {
    /// Members of the state, for the header.
    state: &'static str,
    types: &'static str,
    constants: String,
    code: String,
}

/// The model file at `path` in C.
///
/// # Errors
/// [`CError::Prefix`] for an invalid prefix, [`CError::Model`] for an invalid model,
/// [`CError::Single`] for one that single precision cannot hold, [`CError::Compensate`] for one that
/// cannot compensate.
pub fn from_file(path: &Path, options: COptions) -> Result<CFiles, CError> {
    check_prefix(options.prefix)?;
    let read = || {
        let text = fs::read_to_string(path).map_err(ModelFileError::from)?;
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
        from_text(&text, &name, options)
    };
    read().map_err(|error| match error {
        CError::Model(error) => error.in_file(path).into(),
        other => other,
    })
}

/// The model file called `name` with this `text` in C.
///
/// # Errors
/// As for [`from_file`].
pub fn from_text(text: &str, name: &str, options: COptions) -> Result<CFiles, CError> {
    let origin = format!("{name}, SHA-256 {}", sha256(text.as_bytes()));
    write(&ModelFile::from_json(text)?, &origin, options)
}

/// `model` in C; `origin` describes the source of the model.
///
/// # Errors
/// As for [`from_file`].
pub fn write(model: &ModelFile, origin: &str, options: COptions) -> Result<CFiles, CError> {
    let COptions { prefix, stem, precision, compensator, internal } = options;
    check_prefix(prefix)?;
    let trocar = &model.trocar;
    if trocar.rotation().is_some() && compensator.is_some() {
        return Err(CError::Rotation);
    }
    let mut filling = Filling::default();
    filling.set("single", precision == Precision::Single);
    filling.set("profile", trocar.profile().is_some());
    let observer = compensator.map(|options| Compensator::new(model, options)).transpose()?;
    let known = observer.as_ref().map(Compensator::constants);
    let observed =
        known.map_or_else(String::new, |known| compensator::constants(&known, &mut filling));
    let stiff = known.and_then(|known| known.stiff?.stages()).map_or(&[][..], Stages::elements);
    let Parts { state, types, constants, code } = match trocar.seal() {
        Seal::Ems(stages) => {
            let rotation = (trocar.rotation(), trocar.around());
            element::parts(stages.elements(), stiff, rotation, &mut filling, prefix)
        }
        Seal::Classical(model) => classical::parts(model, &mut filling),
    };
    filling.value("STEM", stem);
    filling.value("ANGLE", if filling.has("turning") { "state->angle_rad, " } else { "" });
    filling.value("LINKAGE", if internal { "static " } else { "" });
    filling.value(
        "TITLE",
        format!("{}, written as C by trocar {}", title(trocar.seal()), env!("CARGO_PKG_VERSION")),
    );
    filling.value("ORIGIN", origin_lines(model, origin));
    filling.set("integers", filling.has("bits") || known.is_some());
    let profile = trocar.profile().map_or_else(String::new, profile_constants);
    let source = [
        include_str!("head.c"),
        types,
        &constants,
        &profile,
        &observed,
        include_str!("arithmetic.c"),
        include_str!("sliding.c"),
        &code,
        include_str!("public.c"),
        if known.is_some() { include_str!("compensator.c") } else { "" },
    ];
    let with_state = include_str!("header.h").replace("//@state\n", state);
    let header = [
        with_state.as_str(),
        if known.is_some() { include_str!("compensator.h") } else { "" },
        include_str!("header_end.h"),
    ];
    let write = |template: &str| {
        let code = filling.fill(template, prefix);
        if precision == Precision::Single { single::to_single(&code) } else { Ok(code) }
    };
    Ok(CFiles { header: write(&header.concat())?, source: write(&source.concat())? })
}

/// Whether names in C may begin with `prefix`.
///
/// # Errors
/// [`CError::Prefix`] if not.
pub fn check_prefix(prefix: &str) -> Result<(), CError> {
    let begins = prefix.starts_with(|first: char| first.is_ascii_alphabetic());
    let goes_on = prefix.chars().all(|next| next.is_ascii_alphanumeric() || next == '_');
    if begins && goes_on && prefix.len() <= LONGEST_PREFIX {
        return Ok(());
    }
    Err(CError::Prefix { found: prefix.to_owned() })
}

fn title(seal: &Seal) -> String {
    match seal {
        Seal::Ems(stages) => match stages.elements().len() {
            1 => "Force of a trocar seal: one Extended Maxwell-Slip (EMS) element".to_owned(),
            count => format!(
                "Force of a trocar seal: {count} Extended Maxwell-Slip (EMS) elements in parallel"
            ),
        },
        Seal::Classical(model) => {
            format!("Force of a trocar seal: {} friction model", model.kind())
        }
    }
}

/// The origin of the model as lines of a comment.
fn origin_lines(model: &ModelFile, origin: &str) -> String {
    let made = match model.origin.kind {
        OriginKind::Identified => "estimated from recordings",
        OriginKind::Plausible => "made up so as to be plausible; describes no particular trocar",
        OriginKind::HandMade => "written or changed by hand",
    };
    let mut lines = format!(" * From: {}\n", remark(origin));
    let _ = writeln!(lines, " * Model: {made}, {}", remark(&model.origin.program));
    if let Some(note) = &model.origin.note {
        let _ = writeln!(lines, " * Note: {}", remark(note));
    }
    if let Some(sensor) = model.sensor {
        let _ = writeln!(
            lines,
            " * The sensor's offset of {} N is left out: not part of the seal's force.",
            sensor.offset_n
        );
    }
    lines
}

/// The position profile; its values are named in `public.c`.
fn profile_constants(profile: &PositionProfile<Vec<f64>>) -> String {
    let mut text = String::from(
        "/* How the force depends on the position: F = F_0(x) + gain(x)*F_seal, straight between even knots. Outside, F_0\n \
         * fades to 0 and the gain to 1 over a fraction of the range. */\n",
    );
    let knots = profile.gains().len();
    let _ = writeln!(text, "enum {{ trocar_knots = {knots} }};");
    constant(&mut text, "trocar_from_m", profile.from());
    constant(&mut text, "trocar_to_m", profile.to());
    constant(&mut text, "trocar_fade", FADE);
    table(&mut text, "trocar_offset_n", profile.offsets());
    table(&mut text, "trocar_gain", profile.gains());
    text.push('\n');
    text
}

/// One constant.
fn constant(text: &mut String, name: &str, value: f64) {
    let _ = writeln!(text, "static const double {name} = {};", number(value));
}

/// A row of constants.
fn table(text: &mut String, name: &str, values: &[f64]) {
    let _ = writeln!(text, "static const double {name}[{}] = {{", values.len());
    for value in values {
        let _ = writeln!(text, "    {},", number(*value));
    }
    text.push_str("};\n");
}

/// Pairs of constants, one pair per line.
fn pairs(text: &mut String, indent: &str, values: &[[f64; 2]]) {
    for [first, second] in values {
        let _ = writeln!(text, "{indent}{{ {}, {} }},", hexadecimal(*first), hexadecimal(*second));
    }
}

/// Dependence of g on speed: the shapes that occur and their requirements.
fn stribeck_shapes(exponents: impl Iterator<Item = f64>, filling: &mut Filling) {
    for exponent in exponents {
        filling.need(&["stribeck", "decay", "bits"]);
        match exponent {
            2.0 => filling.need(&["gaussian"]),
            1.0 => (),
            _ => filling.need(&["shaped", "power", "logarithm"]),
        }
    }
}
