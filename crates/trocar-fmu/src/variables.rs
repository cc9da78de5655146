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

impl Variable {
    fn new(
        role: Role,
        name: &str,
        unit: &'static str,
        description: &str,
        start: Option<f64>,
    ) -> Self {
        let (name, description) = (name.to_owned(), description.to_owned());
        Self { role, name, unit, description, start, least: None }
    }
}

/// Variables of `trocar` driven by `input`, in increasing order of their value references.
///
/// An infinite parameter (a disabled law) is omitted, since not every importer can read an infinite
/// start value.
pub(crate) fn variables<K: AsRef<[f64]>>(trocar: &Trocar<K>, input: Input) -> Vec<Variable> {
    let is_ems = matches!(trocar.seal(), Seal::Ems(_));
    let driven = input == Input::Velocity;
    let mut table =
        vec![Variable::new(Role::Time, "time", "s", "simulated time", None), input_variable(input)];
    let force = "force of the instrument on the seal, positive on insertion; the instrument feels its negative";
    table.push(Variable::new(Role::Force, "force_n", "N", force, None));
    if is_ems {
        let deflection = "deflection of the seal, the mean of several elements";
        table.push(Variable::new(Role::Deflection, "deflection_m", "m", deflection, None));
        table.push(Variable::new(
            Role::Mode,
            "mode",
            "",
            "whether the seal deforms or slides",
            None,
        ));
    }
    if driven {
        table.push(Variable::new(
            Role::Position,
            "position_m",
            "m",
            "where the instrument is",
            None,
        ));
    }
    let begins = "force to begin with, at rest; 0: that of an undeformed seal";
    table.push(Variable::new(Role::InitialForce, "initial_force_n", "N", begins, Some(0.0)));
    if is_ems {
        let begins = "deflection to begin with, at rest; at most one of this and initial_force_n";
        table.push(Variable::new(
            Role::InitialDeflection,
            "initial_deflection_m",
            "m",
            begins,
            Some(0.0),
        ));
    }
    if driven {
        let begins = "where the instrument begins";
        table.push(Variable::new(
            Role::InitialPosition,
            "initial_position_m",
            "m",
            begins,
            Some(0.0),
        ));
    }
    if trocar.rotation().is_some() {
        table.extend(turning_variables(input));
    }
    table.extend(parameters(trocar.seal()));
    table
}

fn turning_variables(input: Input) -> [Variable; 2] {
    let (name, unit, is) = match input {
        Input::Position => (
            "angle_rad",
            "rad",
            "angle of the instrument at the end of the step; before the first step: where it stands",
        ),
        Input::Velocity => (
            "angular_velocity_rad_s",
            "rad/s",
            "angular velocity of the instrument during the step",
        ),
    };
    let torque = "torque of the instrument on the seal, positive with the angle; the instrument feels its negative";
    [
        Variable::new(Role::Turn, name, unit, is, Some(0.0)),
        Variable::new(Role::Torque, "torque_n_m", "N m", torque, None),
    ]
}

fn input_variable(input: Input) -> Variable {
    let role = Role::Input(input);
    match input {
        Input::Position => {
            let is = "where the instrument is at the end of the step; before the first step: where it stands";
            Variable::new(role, "position_m", "m", is, Some(0.0))
        }
        Input::Velocity => {
            let is = "velocity of the instrument during the step, positive on insertion";
            Variable::new(role, "velocity_m_s", "m/s", is, Some(0.0))
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
