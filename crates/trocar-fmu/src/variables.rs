//! The variables of an FMU: one table, used both for the description and by the functions of the
//! library.

use trocar_model::{Declaration, Seal, Trocar, Tunable};

use crate::hash::fnv_128;

/// Version of the table and of serialized states; part of every token.
const LAYOUT: &[u8] = b"trocar-fmu 2";

/// Driving input of the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Input {
    /// Position of the instrument at the end of the step, m.
    Position,
    /// Velocity of the instrument, m/s, constant over the step.
    Velocity,
}

impl Input {
    /// All kinds.
    pub const ALL: [Self; 2] = [Self::Position, Self::Velocity];
}

/// Meaning of a variable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Role {
    /// Simulated time.
    Time,
    /// The driving input.
    Input(Input),
    /// Force of the instrument on the seal.
    Force,
    /// Deflection of the seal.
    Deflection,
    /// Whether the seal slides.
    Mode,
    /// Position of the instrument, if it is driven by velocity.
    Position,
    /// Initial force of the seal.
    InitialForce,
    /// Initial deflection of the seal.
    InitialDeflection,
    /// Initial position of the instrument, if it is driven by velocity.
    InitialPosition,
    /// How the instrument turns: its angle, or its angular velocity where it is driven by velocity.
    Turn,
    /// Torque of the instrument on the seal.
    Torque,
    /// Parameter of the model, by its index in [`Seal::tunables`].
    Tunable(usize),
}

/// Value reference of the first parameter of the model.
const FIRST_TUNABLE: u32 = 100;

impl Role {
    /// Value reference, the same in every FMU.
    pub(crate) fn reference(self) -> u32 {
        match self {
            Self::Time => 0,
            Self::Input(_) => 1,
            Self::Force => 2,
            Self::Deflection => 3,
            Self::Mode => 4,
            Self::Position => 5,
            Self::InitialForce => 6,
            Self::InitialDeflection => 7,
            Self::InitialPosition => 8,
            Self::Turn => 9,
            Self::Torque => 10,
            Self::Tunable(place) => FIRST_TUNABLE + place as u32,
        }
    }
}

/// A variable.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Variable {
    /// Its meaning.
    pub(crate) role: Role,
    /// Name with its unit, unique.
    pub(crate) name: String,
    /// Unit in SI; empty for the mode, which is an enumeration.
    pub(crate) unit: &'static str,
    /// Readable description.
    pub(crate) description: String,
    /// Initial value; `None` for outputs.
    pub(crate) start: Option<f64>,
    /// Minimum, and whether the minimum itself is excluded.
    pub(crate) least: Option<(f64, bool)>,
}

/// Variables of `trocar` driven by `input`, in increasing order of their value references.
///
/// An infinite parameter (a disabled law) is omitted, since not every importer can read an infinite
/// start value.
pub(crate) fn variables<K: AsRef<[f64]>>(trocar: &Trocar<K>, input: Input) -> Vec<Variable> {
    let is_ems = matches!(trocar.seal(), Seal::Ems(_));
    let (is_driven, turns) = (input == Input::Velocity, trocar.rotation().is_some());
    let ((along, unit, is_along), (around, unit_around, is_around)) = inputs(input);
    let (start, mode) = (Some(0.0), "whether the seal deforms or slides");
    let rows = [
        (true, Role::Time, "time", "s", "simulated time", None),
        (true, Role::Input(input), along, unit, is_along, start),
        (true, Role::Force, "force_n", "N", FORCE, None),
        (is_ems, Role::Deflection, "deflection_m", "m", DEFLECTION, None),
        (is_ems, Role::Mode, "mode", "", mode, None),
        (is_driven, Role::Position, "position_m", "m", "where the instrument is", None),
        (true, Role::InitialForce, "initial_force_n", "N", FORCE_AT_START, start),
        (is_ems, Role::InitialDeflection, "initial_deflection_m", "m", DEFLECTION_AT_START, start),
        (is_driven, Role::InitialPosition, "initial_position_m", "m", POSITION_AT_START, start),
        (turns, Role::Turn, around, unit_around, is_around, start),
        (turns, Role::Torque, "torque_n_m", "N m", TORQUE, None),
    ];
    let fixed = rows.into_iter().filter(|(is_there, ..)| *is_there);
    let fixed = fixed.map(|(_, role, name, unit, description, start)| {
        let (name, description) = (name.to_owned(), description.to_owned());
        Variable { role, name, unit, description, start, least: None }
    });
    fixed.chain(parameters(trocar.seal())).collect()
}

const FORCE: &str =
    "force of the instrument on the seal, positive on insertion; the instrument feels its negative";
const TORQUE: &str = "torque of the instrument on the seal, positive with the angle; the instrument feels its negative";
const DEFLECTION: &str = "deflection of the seal, the mean of several elements";
const FORCE_AT_START: &str = "force to begin with, at rest; 0: that of an undeformed seal";
const DEFLECTION_AT_START: &str =
    "deflection to begin with, at rest; at most one of this and initial_force_n";
const POSITION_AT_START: &str = "where the instrument begins";

/// Name, unit and description.
type Described = (&'static str, &'static str, &'static str);

/// The inputs along and around the axis.
fn inputs(input: Input) -> (Described, Described) {
    match input {
        Input::Position => {
            let along = "where the instrument is at the end of the step; before the first step: where it stands";
            let around = "angle of the instrument at the end of the step; before the first step: where it stands";
            (("position_m", "m", along), ("angle_rad", "rad", around))
        }
        Input::Velocity => {
            let along = "velocity of the instrument during the step, positive on insertion";
            let around = "angular velocity of the instrument during the step";
            (("velocity_m_s", "m/s", along), ("angular_velocity_rad_s", "rad/s", around))
        }
    }
}

fn parameters(seal: &Seal) -> impl Iterator<Item = Variable> {
    let finite = seal.tunables().enumerate().filter(|(_, tunable)| tunable.value.is_finite());
    finite.map(|(place, Tunable { id, value })| {
        let Declaration { unit, range, .. } = id.declaration();
        let above = if range.excludes_least() {
            format!("; above {}", range.least())
        } else {
            String::new()
        };
        Variable {
            role: Role::Tunable(place),
            name: id.to_string(),
            unit: unit.si,
            description: format!("{}: {}{above}", id.symbol(), id.words()),
            start: Some(value),
            least: range.least().is_finite().then(|| (range.least(), range.excludes_least())),
        }
    })
}

/// Identity of an FMU: a hash of the model `row`, the driving input and this version.
pub(crate) fn identity(row: &[f64], input: Input) -> u128 {
    let kind = match input {
        Input::Position => 0,
        Input::Velocity => 1,
    };
    let numbers = row.iter().flat_map(|number| number.to_le_bytes());
    fnv_128(LAYOUT.iter().copied().chain([kind]).chain(numbers))
}

/// GUID (FMI 2.0) or instantiation token (3.0) of the FMU of the model `row` driven by `input`.
pub fn token(row: &[f64], input: Input) -> String {
    let hex = format!("{:032x}", identity(row, input));
    format!("{{{}-{}-{}-{}-{}}}", &hex[..8], &hex[8..12], &hex[12..16], &hex[16..20], &hex[20..])
}
