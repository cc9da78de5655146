//! A contributed measured seal: a folder with `model.json`, `conditions.toml` and, at least while
//! it is checked, the recordings that the model was identified from (docs/reference/published.md).

use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use serde::Deserialize;
use sha2::{Digest, Sha256};
use thiserror::Error;

use trocar_runtime::model_file::{self, ModelFile, ModelFileError, OriginKind, RecordingInfo};

/// Name of the file of the conditions.
pub const CONDITIONS: &str = "conditions.toml";

/// Bytes read at a time for a hash.
const BLOCK: usize = 1 << 16;

/// What was measured, and how. Field names are the keys of the file.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Conditions {
    /// Maker, name and catalogue number of the trocar.
    pub trocar: String,
    /// Nominal size of the trocar, mm, positive.
    pub size_mm: f64,
    /// Its seals, such as "lip seal and duckbill".
    pub seals: String,
    /// Instrument or rod and the material of its shaft.
    pub instrument: String,
    /// Diameter of the shaft, mm, positive.
    pub instrument_diameter_mm: f64,
    /// "dry", or the liquid.
    pub lubrication: String,
    /// Insufflation pressure, Pa, ≥ 0.
    pub gas_pressure_pa: f64,
    /// Temperature, °C, if measured.
    #[serde(default)]
    pub temperature_c: Option<f64>,
    /// Rig and force sensor.
    pub rig: String,
    /// Who measured.
    pub measured_by: String,
    /// Licence of model and recordings.
    pub licence: String,
    /// Where the recordings are published: DOI or URL.
    pub recordings_at: String,
    /// Remarks.
    #[serde(default)]
    pub note: Option<String>,
}

/// A contribution without faults.
#[derive(Debug, Clone, PartialEq)]
pub struct Contribution {
    /// The model.
    pub model: ModelFile,
    /// Its conditions.
    pub conditions: Conditions,
    /// For each recording of the model whether its file is in the folder, with the right hash.
    pub recordings: Vec<(RecordingInfo, bool)>,
}

/// Why a folder is not a valid contribution.
#[non_exhaustive]
#[derive(Debug, Error)]
pub enum ContributionError {
    /// Error of the model file.
    #[error(transparent)]
    Model(#[from] ModelFileError),
    /// A model that was not identified.
    #[error("{}: origin.kind must be \"identified\": a contributed seal is measured", path.display())]
    NotIdentified {
        /// The model file.
        path: PathBuf,
    },
    /// A model without recordings.
    #[error("{}: origin.recordings must name one recording or more", path.display())]
    NoRecordings {
        /// The model file.
        path: PathBuf,
    },
    /// A file cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
    /// The conditions are not TOML, lack a key or have an unknown one.
    #[error("{}: {what}\n\nhint: docs/reference/published.md describes every key", path.display())]
    Syntax {
        /// The file of the conditions.
        path: PathBuf,
        /// Error of the parser, with the line.
        what: String,
    },
    /// An impossible value in the conditions.
    #[error("{}: {key} must be {expected}, got {found}", path.display())]
    Value {
        /// The file of the conditions.
        path: PathBuf,
        /// Its key.
        key: &'static str,
        /// What was expected.
        expected: &'static str,
        /// What was found.
        found: String,
    },
    /// A recording that is not the one the model was identified from.
    #[error("{}: SHA-256 is {found}, the model was identified from {expected}", path.display())]
    Hash {
        /// The recording.
        path: PathBuf,
        /// Its hash.
        found: String,
        /// The hash in the model.
        expected: String,
    },
}

/// Checks the contribution in `folder`.
///
/// The model must be valid (all that `schema/model.schema.json` asks for, and continuous branches),
/// identified, and name its recordings. Recordings are looked for in the folder by name; one that is
/// there must have its hash, one that is not is no error.
///
/// # Errors
/// [`ContributionError`]: the first fault found, with its file.
pub fn check(folder: &Path) -> Result<Contribution, ContributionError> {
    let path = folder.join(model_file::FILE_NAME);
    let model = ModelFile::read(&path)?;
    if model.origin.kind != OriginKind::Identified {
        return Err(ContributionError::NotIdentified { path });
    }
    if model.origin.recordings.is_empty() {
        return Err(ContributionError::NoRecordings { path });
    }
    let conditions = read_conditions(&folder.join(CONDITIONS))?;
    let recordings = model.origin.recordings.iter();
    let found = recordings.map(|own| Ok((own.clone(), is_here(folder, own)?)));
    let recordings = found.collect::<Result<_, ContributionError>>()?;
    Ok(Contribution { model, conditions, recordings })
}

fn read_conditions(path: &Path) -> Result<Conditions, ContributionError> {
    let unreadable = |source| ContributionError::Unreadable { path: path.to_owned(), source };
    let text = std::fs::read_to_string(path).map_err(unreadable)?;
    let conditions: Conditions = toml::from_str(&text).map_err(|error| {
        ContributionError::Syntax { path: path.to_owned(), what: error.to_string() }
    })?;
    conditions.check(path)?;
    Ok(conditions)
}

impl Conditions {
    fn check(&self, path: &Path) -> Result<(), ContributionError> {
        let fault = |key, expected, found| {
            Err(ContributionError::Value { path: path.to_owned(), key, expected, found })
        };
        let texts = [
            ("trocar", &self.trocar),
            ("seals", &self.seals),
            ("instrument", &self.instrument),
            ("lubrication", &self.lubrication),
            ("rig", &self.rig),
            ("measured_by", &self.measured_by),
            ("licence", &self.licence),
            ("recordings_at", &self.recordings_at),
        ];
        if let Some((key, _)) = texts.into_iter().find(|(_, text)| text.trim().is_empty()) {
            return fault(key, "a text", "an empty one".to_owned());
        }
        let sizes =
            [("size_mm", self.size_mm), ("instrument_diameter_mm", self.instrument_diameter_mm)];
        if let Some((key, size)) =
            sizes.into_iter().find(|(_, size)| !(*size > 0.0 && size.is_finite()))
        {
            return fault(key, "finite and above 0 mm", format!("{size} mm"));
        }
        let pressure = self.gas_pressure_pa;
        if !(pressure >= 0.0 && pressure.is_finite()) {
            return fault("gas_pressure_pa", "finite and 0 Pa or more", format!("{pressure} Pa"));
        }
        match self.temperature_c {
            Some(celsius) if !celsius.is_finite() => {
                fault("temperature_c", "finite", format!("{celsius} °C"))
            }
            _ => Ok(()),
        }
    }
}

/// Whether the file of `recording` is in `folder`.
fn is_here(folder: &Path, recording: &RecordingInfo) -> Result<bool, ContributionError> {
    let Some(name) = Path::new(&recording.name).file_name() else { return Ok(false) };
    let path = folder.join(name);
    let found = match hash_of(&path) {
        Ok(found) => found,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(false),
        Err(source) => return Err(ContributionError::Unreadable { path, source }),
    };
    if found == recording.sha256 {
        return Ok(true);
    }
    Err(ContributionError::Hash { path, found, expected: recording.sha256.clone() })
}

/// SHA-256 of a file's bytes, lower-case hexadecimal.
fn hash_of(path: &Path) -> io::Result<String> {
    let (mut file, mut hash, mut block) = (File::open(path)?, Sha256::new(), vec![0; BLOCK]);
    loop {
        match file.read(&mut block)? {
            0 => break,
            count => hash.update(&block[..count]),
        }
    }
    Ok(hash.finalize().iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    }))
}
