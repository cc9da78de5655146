//! What the literature prints about trocar friction, and seals drawn from it.
//!
//! `data/published.toml` holds the numbers and is part of the library. The sources print ranges
//! over trocars, speeds and directions, never the parameters of a seal. Of a drawn seal only F_c
//! is from the source; the other ranges are those of [`PlausibleSeals::default`].

use std::sync::LazyLock;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::PlausibleSeals;

static STUDIES: LazyLock<Vec<Study>> = LazyLock::new(|| {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Document {
        study: Vec<Study>,
    }
    let document: Document = toml::from_str(include_str!("../../data/published.toml"))
        .expect("the shipped document holds studies");
    document.study
});

/// One publication.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Study {
    /// Name on the command line.
    pub key: String,
    /// Key of the citation in SOURCES.md.
    pub source: String,
    read: Extent,
    /// The trocars.
    pub trocar: String,
    /// The seals, where they are described.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seal: Option<String>,
    /// What moved through the trocar.
    pub instrument: String,
    /// Findings without a number.
    #[serde(default)]
    pub notes: Vec<String>,
    /// The numbers.
    #[serde(rename(deserialize = "number"))]
    pub numbers: Vec<Printed>,
}

/// How much of a publication was read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
enum Extent {
    #[serde(rename = "abstract")]
    Abstract,
    #[serde(rename = "full text")]
    FullText,
}

/// A printed number or range.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Printed {
    /// What was measured.
    pub quantity: Quantity,
    /// Lowest and highest value in the unit of the quantity; equal for a single value.
    pub range: [f64; 2],
    /// Whether the source calls it approximate.
    #[serde(default)]
    pub about: bool,
    /// Conditions under which it holds.
    pub conditions: String,
    /// Words of the source.
    pub words: String,
}

/// Quantities that the sources print.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Friction force without sign, N.
    FrictionForceN,
    /// Fluctuation of the force at the start or reversal of the motion, N.
    ReversalFluctuationN,
    /// Change of the friction against the dry shaft, %.
    FrictionChangePercent,
    /// Change of the peak force against the dry shaft, %.
    PeakForceChangePercent,
    /// Deformation of the seal, m.
    DeformationM,
    /// Speed of the instrument, m/s.
    SpeedMS,
    /// Error of the source's model, N rms.
    ModelErrorN,
}

impl Quantity {
    /// Name and unit for people.
    pub const fn words(self) -> (&'static str, &'static str) {
        match self {
            Self::FrictionForceN => ("friction force", "N"),
            Self::ReversalFluctuationN => ("fluctuation at reversals", "N"),
            Self::FrictionChangePercent => ("change of friction", "%"),
            Self::PeakForceChangePercent => ("change of peak force", "%"),
            Self::DeformationM => ("deformation", "m"),
            Self::SpeedMS => ("speed", "m/s"),
            Self::ModelErrorN => ("rms error of its model", "N"),
        }
    }
}

/// Why there are no seals for a key.
#[non_exhaustive]
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum PublishedError {
    /// No such study.
    #[error("no published ranges {key:?}\n\nhint: there are {known}; `trocar ranges` lists them")]
    Unknown {
        /// The key found.
        key: String,
        /// Keys that exist.
        known: String,
    },
    /// The study prints no friction force.
    #[error(
        "{key} prints no friction force, so no seal can be drawn from it\n\nhint: {known} print one"
    )]
    NoForce {
        /// The key of the study.
        key: String,
        /// Keys of studies that print one.
        known: String,
    },
}

/// Friction of a wet shaft over that of a dry one: lowest and highest of the published changes.
pub fn wet_friction() -> [f64; 2] {
    let changes = STUDIES.iter().flat_map(|study| &study.numbers);
    let changes = changes.filter(|number| number.quantity == Quantity::FrictionChangePercent);
    let ends = changes.flat_map(|number| number.range).map(|percent| 1.0 + 1e-2 * percent);
    ends.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], end| [low.min(end), high.max(end)])
}

/// All studies, in the order of the document.
pub fn studies() -> &'static [Study] {
    &STUDIES
}

/// The study called `key`.
///
/// # Errors
/// [`PublishedError::Unknown`] with the keys that exist.
pub fn study(key: &str) -> Result<&'static Study, PublishedError> {
    STUDIES
        .iter()
        .find(|study| study.key == key)
        .ok_or_else(|| PublishedError::Unknown { key: key.to_owned(), known: keys(|_| true) })
}

fn keys(wanted: impl Fn(&&Study) -> bool) -> String {
    let keys: Vec<&str> = STUDIES.iter().filter(wanted).map(|study| study.key.as_str()).collect();
    keys.join(", ")
}

impl Study {
    /// How much of it was read: "abstract" or "full text".
    pub const fn read(&self) -> &'static str {
        match self.read {
            Extent::Abstract => "abstract",
            Extent::FullText => "full text",
        }
    }

    /// The printed friction force, N: from the lowest to the highest of all its ranges.
    pub fn friction_force(&self) -> Option<[f64; 2]> {
        let forces = self.numbers.iter().filter(|own| own.quantity == Quantity::FrictionForceN);
        let ranges = forces.map(|number| number.range);
        ranges.reduce(|[low, high], [from, to]| [low.min(from), high.max(to)])
    }

    /// Ranges of seals with F_c of both directions within the printed friction force; all else as
    /// in [`PlausibleSeals::default`]. In a narrow range the directions differ less.
    ///
    /// The printed force includes the viscous part of its speeds, which the sources do not
    /// separate; F_c + β·v of a drawn seal may exceed the printed range.
    ///
    /// # Errors
    /// [`PublishedError::NoForce`] when the study prints no friction force.
    pub fn seals(&self) -> Result<PlausibleSeals, PublishedError> {
        let rest = PlausibleSeals::default();
        let Some([low, high]) = self.friction_force() else {
            let known = keys(|study| study.friction_force().is_some());
            return Err(PublishedError::NoForce { key: self.key.clone(), known });
        };
        // The mean of both directions keeps this distance from the ends, which must not cross.
        let tilt = rest.friction_asymmetry.min((high - low) / (high + low));
        let coulomb_force = (low / (1.0 - tilt), high / (1.0 + tilt));
        Ok(PlausibleSeals { coulomb_force, friction_asymmetry: tilt, ..rest })
    }
}
