//! `model.json`: a seal as a file, with units in its keys and its origin.
//!
//! A file contains either `elements`, those of the EMS model, with `position_profile` if their
//! force depends on the position and `rotation` if they resist that of the instrument, or `friction`, one classical model. `schema/model.schema.json`
//! (JSON Schema, draft 2020-12) describes the format. The schema defines keys and types. Reading
//! also checks what a schema cannot express, such as continuous branches.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;
use thiserror::Error;
use trocar_model::{
    Branch, Classical, DeformationForce, Element, ElementParams, MAX_ARMS, MAX_STAGES, ParamError,
    Piece, PositionProfile, Relaxation, Seal, Stages, Trocar,
};

use crate::profile::ProfileText;

use members::{Member, Members, Reader, Refused};

mod members;

/// Name of the model file in the folder of a result.
pub const FILE_NAME: &str = "model.json";

/// The file that is read at `path`: that path, or the [`FILE_NAME`] of the folder there.
pub fn file_of(path: &Path) -> PathBuf {
    let inside = path.join(FILE_NAME);
    if path.is_dir() && inside.is_file() { inside } else { path.to_owned() }
}

/// Value of the key `format`.
pub const FORMAT: &str = "trocar-model";
/// Version of the format, the only one that is read.
pub const VERSION: u32 = 1;

/// Largest difference between a joint and the ends of its pieces, as a fraction of the half width.
const INTERVAL_TOLERANCE: f64 = 1e-9;

/// A trocar with its origin.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelFile {
    /// The model that all interfaces run; a position profile only with EMS elements.
    pub trocar: Trocar<Vec<f64>>,
    /// Origin of the model.
    pub origin: Origin,
    /// The sensor of the recordings used for the model; not part of the seal's force.
    pub sensor: Option<SensorInfo>,
    /// Intervals of identified parameters by name with unit, such as `coulomb_force_n`; may be
    /// empty.
    pub intervals: BTreeMap<String, Interval>,
    /// Error of the model's force.
    pub force_error: Option<ForceError>,
}

/// Error of a model's force: root mean square difference from readings, by phase. `None` (`null` in
/// the file) is unknown, because no recording contains that phase.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ForceError {
    /// Source of the values.
    pub source: ErrorSource,
    /// While the seal deforms after a full reversal, N, ≥ 0.
    pub deforming_n: Option<f64>,
    /// While the seal deforms after a partial reversal, until it slides again, N, ≥ 0.
    #[serde(default)]
    pub partial_n: Option<f64>,
    /// While the instrument slides, N, ≥ 0.
    pub sliding_n: Option<f64>,
    /// While the instrument is held, N, ≥ 0.
    pub held_n: Option<f64>,
}

/// Source of a model error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ErrorSource {
    /// Recordings held out of the identification and those used for it: for each phase the larger
    /// of both.
    Validation,
    /// Only the recordings used for identification: an underestimate if there are few.
    Identification,
    /// Stated by the user.
    Stated,
}

impl ForceError {
    /// The same standard deviation `std_n`, N, in all phases, as stated by the user.
    pub fn everywhere(std_n: f64) -> Self {
        let std = Some(std_n);
        Self {
            source: ErrorSource::Stated,
            deforming_n: std,
            partial_n: std,
            sliding_n: std,
            held_n: std,
        }
    }

    /// For each phase the larger error of both, with the given `source`. A phase unknown to one of
    /// them has the error of the other.
    #[must_use]
    pub fn worse(&self, other: &Self, source: ErrorSource) -> Self {
        Self {
            source,
            deforming_n: larger(self.deforming_n, other.deforming_n),
            partial_n: larger(self.partial_n, other.partial_n),
            sliding_n: larger(self.sliding_n, other.sliding_n),
            held_n: larger(self.held_n, other.held_n),
        }
    }

    fn phases(&self) -> [Option<f64>; 4] {
        [self.deforming_n, self.partial_n, self.sliding_n, self.held_n]
    }

    /// The largest known error of a phase, N; `None` if none is known.
    pub fn largest(&self) -> Option<f64> {
        self.phases().into_iter().flatten().reduce(f64::max)
    }
}

/// The larger of both; what is not known is less than any number.
fn larger(a: Option<f64>, b: Option<f64>) -> Option<f64> {
    if a >= b { a } else { b }
}

/// How a model was created.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OriginKind {
    /// Estimated from recordings.
    Identified,
    /// Plausible values that describe no particular trocar.
    Plausible,
    /// Written or changed by hand.
    HandMade,
}

/// Origin of a model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Origin {
    /// How the model was created.
    pub kind: OriginKind,
    /// Program and version.
    pub program: String,
    /// Seed of all random numbers, if any were used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// Remarks for the user.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
    /// Recordings used for the model.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub recordings: Vec<RecordingInfo>,
}

impl Origin {
    /// Origin with this program's version only.
    pub fn new(kind: OriginKind) -> Self {
        Self {
            kind,
            program: concat!("trocar ", env!("CARGO_PKG_VERSION")).to_owned(),
            seed: None,
            note: None,
            recordings: Vec::new(),
        }
    }

    /// Origin of a model estimated from `recordings`, with all random numbers from `seed`.
    pub fn identified(
        seed: u64,
        recordings: impl IntoIterator<Item = impl Into<RecordingInfo>>,
    ) -> Self {
        let recordings = recordings.into_iter().map(Into::into).collect();
        Self { seed: Some(seed), recordings, ..Self::new(OriginKind::Identified) }
    }
}

/// A recording used for a model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordingInfo {
    /// File name.
    pub name: String,
    /// SHA-256 of the file's bytes, 64 lower-case hexadecimal digits.
    pub sha256: String,
    /// How the file was read, if not by its own header alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub read_with: Option<ReadWith>,
}

/// Options a recording was read with; other recordings of the same test bench need the same.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReadWith {
    /// Names of the columns, in the syntax of `--columns`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub columns: Option<String>,
    /// Topics, groups or other tables searched.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub topics: Vec<String>,
    /// Whether the sign of the force was reversed besides what `columns` say.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub flip_force: bool,
    /// Whether the sign of the force was reversed, all in all: by `flip_force`, or by a minus before
    /// its column. An observer reverses live readings, too.
    pub force_reversed: bool,
    /// Lines skipped before the header of a text.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub skip_rows: u64,
    /// Rows per second of a file without a column of times.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate_hz: Option<f64>,
}

/// The sensor of the recordings used for a model.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorInfo {
    /// Reading without any force of the seal, N.
    pub offset_n: f64,
    /// Mass between sensor and seal, kg, ≥ 0.
    pub moving_mass_kg: f64,
    /// Delay of the position readings relative to the forces, s, ≥ 0.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub position_delay_s: f64,
    /// Friction of the cannula, N for each N of the recorded side force, ≥ 0.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub side_friction: f64,
    /// Weight on the sensor while the instrument points down, N, which the recorded tilt turns.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub tilted_weight_n: f64,
    /// Gain of the seal's force with the recorded pressure of the gas, 1/Pa, ≥ 0. The model is that of
    /// the seal without pressure.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub pressure_gain_per_pa: f64,
}

impl SensorInfo {
    /// The recorded loads beside the force of the seal: friction of the cannula, weight that the tilt
    /// turns, N, and gain with the pressure, 1/Pa; 0 for none.
    pub fn loads(&self) -> [f64; 3] {
        [self.side_friction, self.tilted_weight_n, self.pressure_gain_per_pa]
    }
}

/// An estimate with its 95 % interval, in the unit of the parameter's name.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Interval {
    /// Estimate.
    pub value: f64,
    /// Lower and upper end; `None` where the data give no bound.
    pub ci95: [Option<f64>; 2],
}

/// Why a file is not a model.
#[non_exhaustive]
#[derive(Debug, Error)]
pub enum ModelFileError {
    /// The file cannot be read.
    #[error("cannot read the model: {0}")]
    Unreadable(#[from] io::Error),
    /// The text is not JSON.
    #[error(
        "line {line} column {column}: not JSON: {what}\n\nhint: a model is the model.json that `trocar identify` writes, or its folder"
    )]
    NotJson {
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// Error of the parser.
        what: String,
    },
    /// JSON of another format.
    #[error("not a model: the key \"format\" must be \"trocar-model\", got {found}")]
    WrongFormat {
        /// What was found.
        found: String,
    },
    /// A file of another version.
    #[error(
        "written by another version of trocar: model version {found}, this one reads {VERSION}\n\nhint: update trocar; a \
         model from before the first release must be identified again"
    )]
    OtherVersion {
        /// Version found.
        found: u64,
    },
    /// A version that is no whole number.
    #[error("the key \"version\" must be {VERSION}, got {found}")]
    WrongVersion {
        /// What was found.
        found: String,
    },
    /// A key is missing, unknown or has a value of another type.
    #[error("line {line} column {column}: {what}")]
    WrongKey {
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// What is wrong.
        what: String,
    },
    /// Keys and types are correct, but a value is not valid.
    #[error("{place}: {what}")]
    Value {
        /// Place in the file, such as `elements[0].deformation.insertion`.
        place: String,
        /// What is wrong.
        what: String,
    },
    /// A classical model where EMS elements are required.
    #[error(
        "holds a {kind} model, expected EMS elements\n\nhint: trocar simulate and trocar validate take any model"
    )]
    NotEms {
        /// Kind of the model.
        kind: &'static str,
    },
    /// Invalid parameters of a seal.
    #[error("{place}: {source}")]
    Parameter {
        /// Place in the file.
        place: String,
        /// What is wrong.
        source: ParamError,
    },
    /// An error with the file in which it occurred.
    #[error("{}: {source}", path.display())]
    InFile {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: Box<ModelFileError>,
    },
}

impl ModelFileError {
    /// The error with the file in which it occurred.
    pub fn in_file(self, path: &Path) -> Self {
        Self::InFile { path: path.to_owned(), source: Box::new(self) }
    }
}

impl ModelFile {
    /// A model without profile, sensor and intervals.
    pub fn new(seal: impl Into<Seal>, origin: Origin) -> Self {
        let trocar = Trocar::new(seal, None);
        Self { trocar, origin, sensor: None, intervals: BTreeMap::new(), force_error: None }
    }

    /// The EMS elements.
    ///
    /// # Errors
    /// [`ModelFileError::NotEms`] for a classical model.
    pub fn stages(&self) -> Result<&Stages, ModelFileError> {
        let seal = self.trocar.seal();
        seal.stages().ok_or_else(|| ModelFileError::NotEms { kind: seal.kind() })
    }

    /// The reading of the sensor without any force of the seal, N; 0 if no sensor is known.
    pub fn offset(&self) -> f64 {
        self.sensor.map_or(0.0, |sensor| sensor.offset_n)
    }

    /// The plausible one-stage 10.5 mm trocar; its origin is [`OriginKind::Plausible`].
    ///
    /// # Errors
    /// None in practice: the values are constants, and a test builds them.
    pub fn plausible_10_5_mm() -> Result<Self, ParamError> {
        let element = Element::new(ElementParams::plausible_10_5_mm()?)?;
        let mut origin = Origin::new(OriginKind::Plausible);
        origin.note = Some("made-up one-stage 10.5 mm trocar; no trocar was measured".to_owned());
        Ok(Self::new(element, origin))
    }

    /// Reads the file at `path`, or the [`FILE_NAME`] of the folder there.
    ///
    /// # Errors
    /// [`ModelFileError::InFile`] with the error of [`ModelFile::from_json`] or of the operating
    /// system.
    pub fn read(path: &Path) -> Result<Self, ModelFileError> {
        let path = file_of(path);
        let read = || Self::from_json(&fs::read_to_string(&path)?);
        read().map_err(|error| error.in_file(&path))
    }

    /// How the recordings of the model were read, if all in the same way and not by their own
    /// headers alone.
    pub fn read_with(&self) -> Option<&ReadWith> {
        let mut all = self.origin.recordings.iter().map(|recording| recording.read_with.as_ref());
        let first = all.next()?;
        if all.all(|other| other == first) { first } else { None }
    }

    /// Whether the sign of the sensor was reversed when the recordings of the model were read;
    /// `None` where only some of them were read so. Not reversed without recordings.
    pub fn flips_force(&self) -> Option<bool> {
        let recordings = self.origin.recordings.iter();
        let mut all = recordings
            .map(|recording| recording.read_with.as_ref().is_some_and(|own| own.force_reversed));
        let Some(first) = all.next() else { return Some(false) };
        all.all(|other| other == first).then_some(first)
    }

    /// Reads and checks the text of a model file.
    ///
    /// # Errors
    /// See [`ModelFileError`]: invalid JSON, another format, a newer version, invalid keys, values
    /// or parameters.
    pub fn from_json(text: &str) -> Result<Self, ModelFileError> {
        let header: Value =
            serde_json::from_str(text).map_err(|error| ModelFileError::NotJson {
                line: error.line(),
                column: error.column(),
                what: without_place(&error),
            })?;
        check_header(&header)?;
        let document: Document = serde_json::from_str(text).map_err(wrong_key)?;
        document.into_file()
    }

    /// The text of a model file: the same model gives the same text, and reading it gives the same
    /// model.
    pub fn to_json(&self) -> String {
        let (elements, friction) = match self.trocar.seal() {
            Seal::Ems(stages) => {
                let elements = stages.elements().iter().map(Element::params);
                (Some(elements.map(ElementText::from).collect()), None)
            }
            Seal::Classical(model) => (None, Some(friction(model))),
        };
        let document = Document {
            format: FORMAT.to_owned(),
            version: VERSION,
            origin: self.origin.clone(),
            sensor: self.sensor,
            position_profile: self.trocar.profile().map(ProfileText::from),
            rotation: self.trocar.rotation().map(Members::of),
            elements,
            friction,
            intervals: self.intervals.clone(),
            force_error: self.force_error,
        };
        let mut text = serde_json::to_string_pretty(&document).expect("every key is a string");
        text.push('\n');
        text
    }
}

/// The key `friction`: one classical model, beginning with its kind.
fn friction(model: &Classical) -> Members {
    let mut members = Members::default();
    members.put("kind", Member::Word(model.kind().to_owned()));
    let Ok(()) = model.visit(&mut members);
    members
}

fn read_friction(members: Members) -> Result<Classical, ModelFileError> {
    let mut reader = Reader::new("friction", members);
    let kind = reader.take("kind")?;
    let built = match &kind {
        Member::Word(word) => Classical::build(word, &mut reader),
        _ => None,
    };
    let Some(built) = built else {
        let what = format!("must be one of {}, got {kind}", Classical::KINDS.join(", "));
        return Err(impossible("friction.kind", &what));
    };
    let model = built.map_err(|refused| match refused {
        Refused::Member(error) => error,
        Refused::Value(error) => parameter("friction")(error),
    })?;
    reader.end()?;
    Ok(model)
}

/// Format and version are checked first, since a newer file may differ in any other key.
fn check_header(header: &Value) -> Result<(), ModelFileError> {
    let format = header.get("format");
    if format.and_then(Value::as_str) != Some(FORMAT) {
        return Err(ModelFileError::WrongFormat { found: shown(format) });
    }
    let version = header.get("version");
    match version.and_then(Value::as_u64) {
        Some(found) if found == u64::from(VERSION) => Ok(()),
        Some(found) => Err(ModelFileError::OtherVersion { found }),
        None => Err(ModelFileError::WrongVersion { found: shown(version) }),
    }
}

fn shown(value: Option<&Value>) -> String {
    value.map_or_else(|| "nothing".to_owned(), ToString::to_string)
}

fn wrong_key(error: serde_json::Error) -> ModelFileError {
    ModelFileError::WrongKey {
        line: error.line(),
        column: error.column(),
        what: without_place(&error),
    }
}

/// The message of the parser without its " at line L column C".
fn without_place(error: &serde_json::Error) -> String {
    let message = error.to_string();
    let place = format!(" at line {} column {}", error.line(), error.column());
    message.strip_suffix(&place).unwrap_or(&message).to_owned()
}

/// The form of the file.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    format: String,
    version: u32,
    origin: Origin,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    sensor: Option<SensorInfo>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    position_profile: Option<ProfileText>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    rotation: Option<Members>,
    #[serde(skip_serializing_if = "Option::is_none")]
    elements: Option<Vec<ElementText>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    friction: Option<Members>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    intervals: BTreeMap<String, Interval>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    force_error: Option<ForceError>,
}

fn is_zero<T: PartialEq + Default>(value: &T) -> bool {
    *value == T::default()
}

#[derive(Serialize, Deserialize)]
struct ElementText {
    deformation: DeformationText,
    seal_damping: Members,
    insertion: Members,
    withdrawal: Members,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    relaxation: Vec<Members>,
    /// Numbers of the element itself; one that is missing has no effect.
    #[serde(flatten)]
    own: Members,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct DeformationText {
    half_width_m: f64,
    yield_stiffness_n_m: f64,
    insertion: BranchText,
    withdrawal: BranchText,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct BranchText {
    join_m: f64,
    pieces: [PieceText; 2],
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PieceText {
    from_m: f64,
    to_m: f64,
    legendre_n: Vec<f64>,
}

impl Document {
    fn into_file(self) -> Result<ModelFile, ModelFileError> {
        self.check_values()?;
        let seal = match (self.elements, self.friction) {
            (Some(elements), None) => Seal::Ems(read_elements(elements)?),
            (None, Some(friction)) => Seal::Classical(read_friction(friction)?),
            (Some(_), Some(_)) => {
                return Err(impossible("friction", "a model holds elements or friction, got both"));
            }
            (None, None) => {
                return Err(impossible(
                    "elements",
                    "a model holds elements or friction, got neither",
                ));
            }
        };
        for (i, recording) in self.origin.recordings.iter().enumerate() {
            check_hash(&recording.sha256, &format!("origin.recordings[{i}].sha256"))?;
        }
        for (name, interval) in &self.intervals {
            check_interval(name, interval)?;
        }
        let Self { origin, position_profile, rotation, sensor, intervals, force_error, .. } = self;
        let profile = position_profile.map(PositionProfile::try_from).transpose();
        let profile =
            profile.map_err(|error| impossible("position_profile", &error.to_string()))?;
        let rotation = rotation.map(|rotation| rotation.params("rotation")).transpose()?;
        let trocar = Trocar::new(seal, profile).with_rotation(rotation);
        let trocar = trocar.map_err(parameter("rotation"))?;
        Ok(ModelFile { trocar, origin, sensor, intervals, force_error })
    }

    /// Checks of values that no other type makes.
    fn check_values(&self) -> Result<(), ModelFileError> {
        let SensorInfo {
            moving_mass_kg,
            position_delay_s,
            side_friction,
            pressure_gain_per_pa,
            ..
        } = self.sensor.unwrap_or_default();
        let not_negative = [
            ("sensor.moving_mass_kg", moving_mass_kg, " kg"),
            ("sensor.position_delay_s", position_delay_s, " s"),
            ("sensor.side_friction", side_friction, ""),
            ("sensor.pressure_gain_per_pa", pressure_gain_per_pa, "/Pa"),
        ];
        if let Some((key, found, unit)) = not_negative.into_iter().find(|own| own.1 < 0.0) {
            return Err(impossible(key, &format!("must not be negative, got {found}{unit}")));
        }
        if self.position_profile.is_some() && self.friction.is_some() {
            return Err(impossible("position_profile", "is for elements, got a classical model"));
        }
        let errors = self.force_error.iter().flat_map(ForceError::phases).flatten();
        if let Some(found) = errors.into_iter().find(|value| *value < 0.0) {
            return Err(impossible("force_error", &format!("must not be negative, got {found} N")));
        }
        Ok(())
    }
}

fn read_elements(elements: Vec<ElementText>) -> Result<Stages, ModelFileError> {
    let count = elements.len();
    let mut read = Vec::new();
    for (i, element) in elements.into_iter().enumerate() {
        read.push(element.read(&format!("elements[{i}]"))?);
    }
    Stages::new(&read).ok_or_else(|| {
        impossible("elements", &format!("a model has 1 to {MAX_STAGES} elements, got {count}"))
    })
}

fn impossible(place: &str, what: &str) -> ModelFileError {
    ModelFileError::Value { place: place.to_owned(), what: what.to_owned() }
}

fn check_hash(hash: &str, place: &str) -> Result<(), ModelFileError> {
    if hash.len() == 64
        && hash.bytes().all(|byte| byte.is_ascii_digit() || (b'a'..=b'f').contains(&byte))
    {
        return Ok(());
    }
    let what = format!("must be 64 lower-case hexadecimal digits, got {hash:?}");
    Err(impossible(place, &what))
}

fn check_interval(name: &str, interval: &Interval) -> Result<(), ModelFileError> {
    let [low, high] = interval.ci95;
    let ordered = low.is_none_or(|low| low <= interval.value)
        && high.is_none_or(|high| interval.value <= high);
    if ordered {
        return Ok(());
    }
    let what = format!("value {} lies outside its own interval", interval.value);
    Err(impossible(&format!("intervals.{name}"), &what))
}

impl From<&ElementParams> for ElementText {
    fn from(params: &ElementParams) -> Self {
        let force = &params.deformation;
        let deformation = DeformationText {
            half_width_m: force.half_width(),
            yield_stiffness_n_m: force.yield_stiffness(),
            insertion: BranchText::from(force.insertion()),
            withdrawal: BranchText::from(force.withdrawal()),
        };
        let arms = params.relaxation.arms.iter().filter(|arm| arm.stiffness > 0.0);
        Self {
            deformation,
            seal_damping: Members::of(&params.damping),
            insertion: Members::of(&params.insertion),
            withdrawal: Members::of(&params.withdrawal),
            relaxation: arms.map(Members::of).collect(),
            own: Members::of_nonzero(params),
        }
    }
}

impl ElementText {
    fn read(self, place: &str) -> Result<Element, ModelFileError> {
        let deformation = self.deformation.force(&format!("{place}.deformation"))?;
        let insertion = self.insertion.params(&format!("{place}.insertion"))?;
        let withdrawal = self.withdrawal.params(&format!("{place}.withdrawal"))?;
        let damping = self.seal_damping.params(&format!("{place}.seal_damping"))?;
        let relaxation = read_relaxation(self.relaxation, &format!("{place}.relaxation"))?;
        let plain = ElementParams {
            damping,
            relaxation,
            ..ElementParams::new(deformation, insertion, withdrawal)
        };
        Element::new(self.own.change(plain, place)?).map_err(parameter(place))
    }
}

fn read_relaxation(arms: Vec<Members>, place: &str) -> Result<Relaxation, ModelFileError> {
    if arms.len() > MAX_ARMS {
        let what = format!("a seal has at most {MAX_ARMS} relaxing arms, got {}", arms.len());
        return Err(impossible(place, &what));
    }
    let mut relaxation = Relaxation::NONE;
    for (i, (arm, members)) in relaxation.arms.iter_mut().zip(arms).enumerate() {
        *arm = members.params(&format!("{place}[{i}]"))?;
    }
    Ok(relaxation)
}

/// Adds the place to the error of the model.
fn parameter(place: &str) -> impl Fn(ParamError) -> ModelFileError {
    move |source| ModelFileError::Parameter { place: place.to_owned(), source }
}

impl DeformationText {
    fn force(&self, place: &str) -> Result<DeformationForce, ModelFileError> {
        let insertion = self.insertion.branch(&format!("{place}.insertion"))?;
        let withdrawal = self.withdrawal.branch(&format!("{place}.withdrawal"))?;
        let force = DeformationForce::new(insertion, withdrawal, Some(self.yield_stiffness_n_m))
            .map_err(parameter(place))?;
        let (c, stated) = (force.half_width(), self.half_width_m);
        if (c - stated).abs() > INTERVAL_TOLERANCE * c {
            let what = format!("half_width_m is {stated}, but the pieces end at {c}");
            return Err(impossible(place, &what));
        }
        Ok(force)
    }
}

impl From<&Branch> for BranchText {
    fn from(branch: &Branch) -> Self {
        Self {
            join_m: branch.join(),
            pieces: [branch.left(), branch.right()].map(|piece| PieceText {
                from_m: piece.from(),
                to_m: piece.to(),
                legendre_n: piece.legendre().to_vec(),
            }),
        }
    }
}

impl BranchText {
    fn branch(&self, place: &str) -> Result<Branch, ModelFileError> {
        let [before, after] = [0, 1].map(|i| {
            let text = &self.pieces[i];
            Piece::new(text.from_m, text.to_m, &text.legendre_n)
                .map_err(parameter(&format!("{place}.pieces[{i}]")))
        });
        let branch = Branch::new(before?, after?).map_err(parameter(place))?;
        let (join, stated) = (branch.join(), self.join_m);
        if (join - stated).abs() > INTERVAL_TOLERANCE * branch.half_width() {
            let what = format!("join_m is {stated}, but the pieces meet at {join}");
            return Err(impossible(place, &what));
        }
        Ok(branch)
    }
}
