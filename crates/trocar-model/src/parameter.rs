//! The parameters of all models and identifications, each declared once: name, symbol, unit and
//! range.
//!
//! A parameter is a [`Quantity`] of one direction or of both, and of one element or of the whole
//! model. Its name is the same in files, messages and every interface:
//! `element_2_insertion_coulomb_force_n`, without what does not apply. Elements count from 1. A
//! parameter struct lists its numbers in [`Parameters::FIELDS`]; rows of numbers, tunable
//! parameters and model files follow that list.

use core::fmt;

use crate::direction::Direction;

/// Highest degree of a polynomial piece: the single polynomial that EMS (25) is compared with has
/// degree 7.
pub const MAX_DEGREE: usize = 7;
/// Largest number of elements of a model.
pub const MAX_ELEMENTS: usize = 16;

/// Unit of a quantity in files, and as shown to people.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unit {
    /// SI unit; "1" for a pure number.
    pub si: &'static str,
    /// Last part of the names of its quantities; empty for a pure number.
    pub ending: &'static str,
    /// Unit in tables and figures; empty for a pure number.
    pub shown: &'static str,
    /// Factor from SI to that unit.
    pub scale: f64,
}

impl Unit {
    const fn new(si: &'static str, ending: &'static str, shown: &'static str, scale: f64) -> Self {
        Self { si, ending, shown, scale }
    }

    /// Pure number.
    pub const ONE: Self = Self::new("1", "", "", 1.0);
    /// Force.
    pub const NEWTON: Self = Self::new("N", "n", "N", 1.0);
    /// Length.
    pub const METRE: Self = Self::new("m", "m", "mm", 1e3);
    /// Velocity.
    pub const METRE_PER_SECOND: Self = Self::new("m/s", "m_s", "mm/s", 1e3);
    /// Damping.
    pub const NEWTON_SECOND_PER_METRE: Self = Self::new("N s/m", "n_s_m", "N·s/m", 1.0);
    /// Damping that grows with the speed.
    pub(crate) const NEWTON_SECOND_2_PER_METRE_2: Self =
        Self::new("N s^2/m^2", "n_s2_m2", "N·s²/m²", 1.0);
    /// Damping that grows with the square of the speed.
    pub(crate) const NEWTON_SECOND_3_PER_METRE_3: Self =
        Self::new("N s^3/m^3", "n_s3_m3", "N·s³/m³", 1.0);
    /// Stiffness.
    pub const NEWTON_PER_METRE: Self = Self::new("N/m", "n_m", "N/mm", 1e-3);
    /// Rate of a force.
    pub(crate) const NEWTON_PER_SECOND: Self = Self::new("N/s", "n_s", "N/s", 1.0);
    /// Time.
    pub const SECOND: Self = Self::new("s", "s", "s", 1.0);
    /// Time of a few milliseconds.
    pub const MILLISECOND: Self = Self::new("s", "s", "ms", 1e3);
    /// Mass.
    pub const KILOGRAM: Self = Self::new("kg", "kg", "g", 1e3);
    /// Gain with a pressure.
    pub(crate) const PER_PASCAL: Self = Self::new("1/Pa", "per_pa", "1/kPa", 1e3);
}

/// Range of a quantity; always finite but for [`Range::AboveZeroOrInfinite`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Range {
    /// Any finite number.
    Any,
    /// Above 0.
    AboveZero,
    /// Above 0; infinite takes the effect away.
    AboveZeroOrInfinite,
    /// At least this.
    AtLeast(f64),
}

impl Range {
    /// Lower end; minus infinity without one.
    pub fn least(self) -> f64 {
        match self {
            Self::Any => f64::NEG_INFINITY,
            Self::AboveZero | Self::AboveZeroOrInfinite => 0.0,
            Self::AtLeast(least) => least,
        }
    }

    /// Whether the lower end itself is left out.
    pub fn excludes_least(self) -> bool {
        matches!(self, Self::AboveZero | Self::AboveZeroOrInfinite)
    }

    /// Whether `value` lies in it.
    pub fn holds(self, value: f64) -> bool {
        let is_above =
            if self.excludes_least() { value > self.least() } else { value >= self.least() };
        is_above
            && (value.is_finite() || (self == Self::AboveZeroOrInfinite && value == f64::INFINITY))
    }
}

/// What is to be known about a quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Declaration {
    /// Name with unit.
    pub key: &'static str,
    /// Symbol in equations and figures.
    pub symbol: &'static str,
    /// In words, in the middle of a sentence.
    pub words: &'static str,
    /// Unit.
    pub unit: Unit,
    /// Values that it may have.
    pub range: Range,
}

macro_rules! quantities {
    ($($name:ident: $key:literal, $symbol:literal, $unit:ident, $range:expr, $words:literal;)*) => {
        /// What a parameter is, apart from direction and element.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum Quantity {
            $(#[doc = concat!($symbol, ": ", $words, ", `", $key, "`.")] $name,)*
            /// θ: coefficient of a branch, EMS (25), about z = 0.
            Coefficient {
                /// Piece of the branch: 1 left of the join, 2 right of it.
                piece: u8,
                /// Power of z, 0 to [`crate::MAX_DEGREE`].
                power: u8,
            },
        }

        impl Quantity {
            /// All but the coefficients.
            pub const ALL: &[Self] = &[$(Self::$name),*];

            /// Values that it may have; apart, so that a program that checks them holds no words.
            pub const fn range(self) -> Range {
                match self {
                    $(Self::$name => $range,)*
                    Self::Coefficient { .. } => Any,
                }
            }

            /// Its declaration.
            pub const fn declaration(self) -> Declaration {
                match self {
                    $(Self::$name => Declaration {
                        key: $key, symbol: $symbol, words: $words, unit: Unit::$unit, range: $range,
                    },)*
                    Self::Coefficient { piece, power } => coefficient(piece, power),
                }
            }
        }
    };
}

use Range::{AboveZero, AboveZeroOrInfinite, Any};

const FROM_ZERO: Range = Range::AtLeast(0.0);

quantities! {
    // Sliding friction, EMS (11).
    CoulombForce: "coulomb_force_n", "F_c", NEWTON, AboveZero, "Coulomb force";
    StaticForce: "static_force_n", "F_s", NEWTON, AboveZero, "static force";
    StaticRatio: "static_ratio", "F_s/F_c", ONE, Range::AtLeast(1.0), "static over Coulomb force";
    StribeckVelocity: "stribeck_velocity_m_s", "v_s", METRE_PER_SECOND, AboveZero, "Stribeck velocity";
    StribeckExponent: "stribeck_exponent", "δ", ONE, AboveZero, "Stribeck exponent";
    ViscousDamping: "viscous_damping_n_s_m", "β", NEWTON_SECOND_PER_METRE, FROM_ZERO, "viscous damping";
    // Element of EMS.
    HalfWidth: "half_width_m", "c", METRE, AboveZero, "half width of the deformation";
    Join: "join_m", "a", METRE, Any, "join";
    JoinForce: "join_force_n", "F(a)", NEWTON, Any, "force at the join";
    YieldStiffness: "yield_stiffness_n_m", "κ", NEWTON_PER_METRE, FROM_ZERO, "minor-loop stiffness";
    SealDamping: "seal_damping_n_s_m", "σ", NEWTON_SECOND_PER_METRE, FROM_ZERO, "seal damping";
    SealDampingLinear: "seal_damping_linear_n_s2_m2", "σ_1", NEWTON_SECOND_2_PER_METRE_2, Any, "seal damping, linear part";
    SealDampingQuadratic: "seal_damping_quadratic_n_s3_m3", "σ_2", NEWTON_SECOND_3_PER_METRE_3, FROM_ZERO,
        "seal damping, quadratic part";
    CreepVelocity: "creep_velocity_m_s", "v_c", METRE_PER_SECOND, FROM_ZERO, "creep velocity of the contact";
    FrictionLag: "friction_lag_s", "T", MILLISECOND, FROM_ZERO, "lag of the Stribeck curve";
    DwellForce: "dwell_force_n", "ΔF", NEWTON, FROM_ZERO, "friction after rest, per e-fold";
    RelaxationStiffness: "relaxation_stiffness_n_m", "E", NEWTON_PER_METRE, FROM_ZERO, "stiffness of the relaxing spring";
    RelaxationTime: "relaxation_time_s", "τ", SECOND, AboveZero, "relaxation time";
    SecondRelaxationStiffness: "second_relaxation_stiffness_n_m", "E_2", NEWTON_PER_METRE, FROM_ZERO,
        "stiffness of the second relaxing spring";
    SecondRelaxationTime: "second_relaxation_time_s", "τ_2", SECOND, AboveZero, "second relaxation time";
    // Rotation of the instrument.
    ShaftRadius: "shaft_radius_m", "r", METRE, AboveZero, "radius of the shaft";
    CircumferentialStiffness: "circumferential_stiffness_n_m", "k_t", NEWTON_PER_METRE, AboveZero,
        "stiffness around the shaft";
    CircumferentialRatio: "circumferential_ratio", "F_t/F_c", ONE, AboveZero, "friction around the shaft over that along it";
    // Sensor, in identifications.
    Offset: "offset_n", "F_0", NEWTON, Any, "sensor offset";
    CoulombForceWithOffset: "coulomb_force_with_offset_n", "F_c", NEWTON, Any, "Coulomb force with offset";
    UnmodelledMass: "unmodelled_mass_kg", "m", KILOGRAM, Any, "unmodelled mass";
    SideFriction: "side_friction", "μ", ONE, FROM_ZERO, "friction of the cannula under side load";
    TiltedWeight: "tilted_weight_n", "W", NEWTON, Any, "weight that the tilt turns";
    PressureGain: "pressure_gain_per_pa", "κ_p", PER_PASCAL, FROM_ZERO, "gain of the force with the gas pressure";
    // The other models.
    Stiffness: "stiffness_n_m", "k", NEWTON_PER_METRE, AboveZero, "stiffness";
    MicroDamping: "micro_damping_n_s_m", "σ_1", NEWTON_SECOND_PER_METRE, FROM_ZERO, "damping before sliding";
    DampingVelocity: "damping_velocity_m_s", "v_d", METRE_PER_SECOND, AboveZeroOrInfinite,
        "velocity over which that damping ends";
    Exponent: "exponent", "n", ONE, AboveZero, "exponent of the transition to sliding";
    UnloadingShape: "unloading_shape", "σ", ONE, Range::AtLeast(0.5), "shape of the unloading";
    LimitForce: "limit_force_n", "F", NEWTON, AboveZero, "limit force";
    Share: "share", "α", ONE, AboveZero, "share of the sliding force";
    Attraction: "attraction_m_s", "C", METRE_PER_SECOND, AboveZero, "attraction of a slipping element";
    AttractionRate: "attraction_n_s", "C", NEWTON_PER_SECOND, AboveZero, "attraction of all elements";
    Damping: "damping_n_s_m", "σ", NEWTON_SECOND_PER_METRE, FROM_ZERO, "damping of an element";
}

/// Powers of z in a branch.
const POWERS: usize = 8;

const fn coefficient(piece: u8, power: u8) -> Declaration {
    const UNITS: [Unit; POWERS] = [
        Unit::NEWTON,
        Unit::new("N/m", "n_m1", "N/m", 1.0),
        Unit::new("N/m^2", "n_m2", "N/m²", 1.0),
        Unit::new("N/m^3", "n_m3", "N/m³", 1.0),
        Unit::new("N/m^4", "n_m4", "N/m⁴", 1.0),
        Unit::new("N/m^5", "n_m5", "N/m⁵", 1.0),
        Unit::new("N/m^6", "n_m6", "N/m⁶", 1.0),
        Unit::new("N/m^7", "n_m7", "N/m⁷", 1.0),
    ];
    let unit = UNITS[if (power as usize) < POWERS { power as usize } else { POWERS - 1 }];
    let words = if piece < 2 { "left of the join" } else { "right of the join" };
    Declaration { key: "theta", symbol: "θ", words, unit, range: Any }
}

impl Quantity {
    /// Coefficients of the two pieces of a branch whose degrees are `degrees`.
    pub fn coefficients(degrees: [usize; 2]) -> impl Iterator<Item = Self> {
        [1, 2].into_iter().zip(degrees).flat_map(|(piece, degree)| {
            (0..POWERS as u8).take(degree + 1).map(move |power| Self::Coefficient { piece, power })
        })
    }

    /// Of both directions, of the whole model.
    pub const fn id(self) -> ParameterId {
        ParameterId { element: None, direction: None, quantity: self }
    }

    /// Of one direction.
    pub const fn of(self, direction: Direction) -> ParameterId {
        ParameterId { element: None, direction: Some(direction), quantity: self }
    }

    /// `theta1_3_n_m3`: power 3 left of the join.
    fn coefficient_named(key: &str) -> Option<Self> {
        let (piece, rest) = key.strip_prefix("theta")?.split_once('_')?;
        let (power, unit) = rest.split_once('_')?;
        let digit = |text: &str| (text.len() == 1).then(|| text.parse::<u8>().ok()).flatten();
        let found = Self::coefficients([POWERS - 1; 2]).find(|quantity| match *quantity {
            Self::Coefficient { piece: own, power: at } => {
                digit(piece) == Some(own) && digit(power) == Some(at)
            }
            _ => false,
        })?;
        (found.declaration().unit.ending == unit).then_some(found)
    }

    /// The quantity with that key.
    fn with_key(key: &str) -> Option<Self> {
        let plain = Self::ALL.iter().copied().find(|quantity| quantity.declaration().key == key);
        plain.or_else(|| Self::coefficient_named(key))
    }
}

/// Which parameter. Displayed as its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ParameterId {
    /// Number of the element, from 1; `None` of the whole model, or of its only element.
    pub element: Option<u8>,
    /// Direction; `None` of both.
    pub direction: Option<Direction>,
    /// What it is.
    pub quantity: Quantity,
}

impl From<Quantity> for ParameterId {
    fn from(quantity: Quantity) -> Self {
        quantity.id()
    }
}

impl ParameterId {
    /// The same of the element with the index `index`, from 0.
    #[must_use]
    pub const fn of_element(self, index: usize) -> Self {
        Self { element: Some((index + 1) as u8), ..self }
    }

    /// Declaration of the quantity.
    pub const fn declaration(self) -> Declaration {
        self.quantity.declaration()
    }

    /// Unit of the quantity.
    pub const fn unit(self) -> Unit {
        self.declaration().unit
    }

    /// Displays it in words, such as "Coulomb force, insertion, element 2".
    pub fn words(self) -> impl fmt::Display {
        Words(self)
    }

    /// Displays its symbol, such as "F_c⁺".
    pub fn symbol(self) -> impl fmt::Display {
        Symbol(self)
    }
}

impl fmt::Display for ParameterId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(element) = self.element {
            write!(f, "element_{element}_")?;
        }
        let Declaration { key, unit, .. } = self.declaration();
        f.write_str(self.direction.map_or("", Direction::prefix))?;
        f.write_str(key)?;
        match self.quantity {
            Quantity::Coefficient { piece, power } => write!(f, "{piece}_{power}_{}", unit.ending),
            _ => Ok(()),
        }
    }
}

impl ParameterId {
    /// The parameter that [`fmt::Display`] writes as `name`; `None` where it names none.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        let (element, rest) = match name.strip_prefix("element_") {
            None => (None, name),
            Some(numbered) => {
                let (number, rest) = numbered.split_once('_')?;
                let digits =
                    number.bytes().all(|byte| byte.is_ascii_digit()) && !number.starts_with('0');
                let number: u8 = number.parse().ok().filter(|_| digits)?;
                (Some(number), rest)
            }
        };
        let (direction, key) = match Direction::BOTH.iter().find_map(|direction| {
            rest.strip_prefix(direction.prefix()).map(|key| (*direction, key))
        }) {
            Some((direction, key)) => (Some(direction), key),
            None => (None, rest),
        };
        let quantity = Quantity::with_key(key)?;
        Some(Self { element, direction, quantity })
    }
}

/// A parameter in words, [`ParameterId::words`].
#[derive(Clone, Copy, Debug)]
struct Words(ParameterId);

impl fmt::Display for Words {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ParameterId { element, direction, quantity } = self.0;
        if let Quantity::Coefficient { power, .. } = quantity {
            write!(f, "coefficient of z^{power} ")?;
        }
        f.write_str(quantity.declaration().words)?;
        if let Some(direction) = direction {
            write!(f, ", {}", direction.name())?;
        }
        element.map_or(Ok(()), |element| write!(f, ", element {element}"))
    }
}

/// The symbol of a parameter, [`ParameterId::symbol`].
#[derive(Clone, Copy, Debug)]
struct Symbol(ParameterId);

impl fmt::Display for Symbol {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ParameterId { element, direction, quantity } = self.0;
        let symbol = quantity.declaration().symbol;
        let raised = match direction {
            Some(Direction::Insertion) => "⁺",
            Some(Direction::Withdrawal) => "⁻",
            None => "",
        };
        match (quantity, direction) {
            (Quantity::JoinForce, Some(_)) => write!(f, "F(a{raised})")?,
            (Quantity::CoulombForceWithOffset, Some(Direction::Withdrawal)) => {
                write!(f, "{symbol}{raised} − F_0")?
            }
            (Quantity::CoulombForceWithOffset, _) => write!(f, "{symbol}{raised} + F_0")?,
            (Quantity::Coefficient { piece, power }, _) => {
                write!(f, "{symbol}{piece}_{power}{raised}")?
            }
            _ => write!(f, "{symbol}{raised}")?,
        }
        let Some(element) = element else { return Ok(()) };
        write!(f, "{}{element}", if symbol.contains('_') { "," } else { "_" })
    }
}

/// One number of a parameter struct.
pub struct Field<T: 'static> {
    /// Key in the struct's object in a model file, with unit.
    pub key: &'static str,
    /// What it is.
    pub quantity: Quantity,
    /// Its value.
    pub get: fn(&T) -> f64,
    /// Sets it.
    pub set: fn(&mut T, f64),
}

impl<T> Field<T> {
    pub(crate) const fn new(quantity: Quantity, get: fn(&T) -> f64, set: fn(&mut T, f64)) -> Self {
        Self { key: quantity.declaration().key, quantity, get, set }
    }

    /// With a shorter key, where the object's name says the rest.
    pub(crate) const fn with_key(self, key: &'static str) -> Self {
        Self { key, ..self }
    }
}

/// A struct of parameters, some of which may be structs of their own.
pub trait Parameters: Copy + 'static {
    /// Its numbers, in the order of rows and tables.
    const FIELDS: &'static [Field<Self>];

    /// The value of `quantity`, if it is one of the fields.
    fn number(&self, quantity: Quantity) -> Option<f64> {
        Self::FIELDS.iter().find(|field| field.quantity == quantity).map(|field| (field.get)(self))
    }

    /// All values in order.
    fn numbers(&self) -> impl Iterator<Item = f64> {
        Self::FIELDS.iter().map(|field| (field.get)(self))
    }
}

/// Parameters that can be read number by number into a value made beforehand.
pub trait Blank: Parameters {
    /// All numbers NaN.
    const BLANK: Self;
}

/// No numbers.
impl Parameters for () {
    const FIELDS: &'static [Field<Self>] = &[];
}

/// Lists the fields of a parameter struct with their quantities and, where it differs, the key in a
/// model file; then the other members, for [`Blank`].
macro_rules! parameters {
    (
        $type:ident { $($name:ident $(as $key:literal)?: $quantity:ident),* $(,)? }
        $(with { $($other:ident: $value:expr),* $(,)? })?
    ) => {
        impl crate::parameter::Parameters for $type {
            const FIELDS: &'static [crate::parameter::Field<Self>] =
                crate::parameter::fields![$($name $(as $key)?: $quantity),*];
        }

        impl crate::parameter::Blank for $type {
            const BLANK: Self = Self { $($name: f64::NAN,)* $($($other: $value),*)? };
        }
    };
}

/// The fields alone.
macro_rules! fields {
    ($($name:ident $(as $key:literal)?: $quantity:ident),*) => {
        &[$(crate::parameter::Field::new(
            crate::parameter::Quantity::$quantity,
            |own: &Self| own.$name,
            |own: &mut Self, value| own.$name = value,
        )$(.with_key($key))?),*]
    };
}

pub(crate) use {fields, parameters};

#[cfg(test)]
mod tests {
    extern crate std;

    use std::collections::HashSet;
    use std::string::ToString;

    use super::*;

    fn every() -> impl Iterator<Item = ParameterId> {
        let all = Quantity::ALL.iter().copied().chain(Quantity::coefficients([7, 7]));
        all.flat_map(|quantity| {
            let directions = [None, Some(Direction::Insertion), Some(Direction::Withdrawal)];
            directions.into_iter().flat_map(move |direction| {
                [None, Some(1), Some(12)].map(|element| ParameterId {
                    element,
                    direction,
                    quantity,
                })
            })
        })
    }

    #[test]
    fn a_name_tells_its_parameter() {
        let mut seen = HashSet::new();
        for id in every() {
            let name = id.to_string();
            assert_eq!(ParameterId::named(&name), Some(id), "{name}");
            assert!(seen.insert(name), "{id} twice");
        }
        for text in [
            "",
            "coulomb_force",
            "element_0_",
            "element_2",
            "insertion_",
            "element_x_share",
            "element_0_share",
            "element_02_share",
            "element_+2_share",
            "theta1_+3_n_m3",
        ] {
            assert_eq!(ParameterId::named(text), None, "{text}");
        }
    }

    #[test]
    fn every_key_ends_with_its_unit() {
        for id in every() {
            let (name, unit) = (id.to_string(), id.unit());
            assert!(name.ends_with(unit.ending), "{name}");
        }
    }

    #[test]
    fn words_and_symbols_name_direction_and_element() {
        let id = Quantity::CoulombForce.of(Direction::Withdrawal).of_element(1);
        assert_eq!(id.to_string(), "element_2_withdrawal_coulomb_force_n");
        assert_eq!(id.words().to_string(), "Coulomb force, withdrawal, element 2");
        assert_eq!(id.symbol().to_string(), "F_c⁻,2");
        assert_eq!(
            Quantity::CoulombForceWithOffset.of(Direction::Withdrawal).symbol().to_string(),
            "F_c⁻ − F_0"
        );
    }

    #[test]
    fn a_range_holds_what_it_says() {
        assert!(
            Range::AboveZero.holds(1e-300)
                && !Range::AboveZero.holds(0.0)
                && !Range::AboveZero.holds(f64::NAN)
        );
        assert!(Range::AtLeast(1.0).holds(1.0) && !Range::AtLeast(1.0).holds(f64::INFINITY));
        assert!(
            Range::AboveZeroOrInfinite.holds(f64::INFINITY) && !Range::Any.holds(f64::NEG_INFINITY)
        );
    }
}
